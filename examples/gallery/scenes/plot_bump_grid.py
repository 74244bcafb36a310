"""
Bumps along two directions
==========================

A finger goes in circles over a field of bumps along x and y. Look at the voltage: it is
on where a ridge along x meets a ridge along y. See :doc:`/reference/scenes/bump_grid`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.motion import sinusoid
from stimlib.scenes import bump_grid

finger = {"x": sinusoid(0.04, 0.5, 0.05), "y": sinusoid(0.018, 1.5, 0.02)}
result = stimlib.render(bump_grid("sine", along=6, across=3), finger, fs=8000, seconds=2.0)
listen(result, "voltage", "bump_grid.wav")
figure = result.plot()
