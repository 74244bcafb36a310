"""
Events
======

A finger strokes lines that are 5 mm apart. Look at the spikes: each passage of a line
is one event, and its sign is the direction. See :doc:`/reference/blocks/events`.
"""

import stimlib
from stimlib.blocks import count, crossing
from stimlib.motion import sinusoid

x = stimlib.Input("x", "m")
passed = crossing(x, spacing=0.005, hysteresis=1e-4)
scene = stimlib.Scene({"x": x, "event": passed, "cell": count(passed)})
result = stimlib.render(scene, {"x": sinusoid(0.02, 0.5)}, fs=8000, seconds=3.0)
figure = result.plot()
