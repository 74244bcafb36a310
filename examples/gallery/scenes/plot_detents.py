"""
A knob with detents
===================

A knob is turned forth and back over six detents. Look at the torque: friction shifts it
to one side on the way forth, and to the other on the way back. See
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
