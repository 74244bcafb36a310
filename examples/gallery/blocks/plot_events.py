"""
Events
======

A finger strokes lines 5 mm apart; each passage is an event, negative on the way back.
See :doc:`/reference/blocks/events`.
"""

import stimlib
from stimlib.blocks import count, crossing
from stimlib.motion import sinusoid

x = stimlib.Input("x", "m")
passed = crossing(x, spacing=0.005, hysteresis=1e-4)
scene = stimlib.Scene({"x": x, "event": passed, "cell": count(passed)})
result = stimlib.render(scene, {"x": sinusoid(0.02, 0.5)}, fs=8000, seconds=3.0)
figure = result.plot()
