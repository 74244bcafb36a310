"""
A knob with detents
===================

It is turned forth and back over six detents; the friction is the difference between
both ways. See
:doc:`/reference/scenes/detents`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.motion import minimum_jerk
from stimlib.scenes import detents

hand = minimum_jerk(depth=1.57, rise=0.6, hold=0.2, fall=0.6)
result = stimlib.render(detents(count=24), {"angle": hand}, fs=8000, seconds=1.6)
listen(result, "torque", "detents.wav")
figure = result.plot()
