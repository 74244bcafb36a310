"""
Impacts
=======

A finger taps on a hard surface, faster each time. Look at the vibration of each tap,
which grows with the velocity, and listen to it. See :doc:`/reference/scenes/impact`.
"""

import numpy as np

import stimlib
from stimlib.analysis import listen
from stimlib.scenes import impact


def hand(t):
    return 4e-3 * t * np.sin(2 * np.pi * 3 * t)


result = stimlib.render(impact(freq=200.0), {"x": hand}, fs=8000, seconds=1.5)
listen(result, "force", "impact.wav")
figure = result.plot()
