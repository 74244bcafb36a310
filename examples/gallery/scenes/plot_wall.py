"""
A wall
======

A finger taps on a wall, harder each time. Look at the force over the position: it
pushes on the way in, and never pulls on the way out. See :doc:`/reference/scenes/wall`.
"""

import numpy as np

import stimlib
from stimlib.analysis import listen
from stimlib.scenes import wall


def hand(t):
    return 1e-3 * t * np.sin(2 * np.pi * 4 * t)


result = stimlib.render(wall(k=2000.0, b=5.0), {"x": hand}, fs=8000, seconds=1.5)
listen(result, "force", "wall.wav")
figure = result.plot()
