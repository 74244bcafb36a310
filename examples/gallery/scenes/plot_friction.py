"""
Stick-slip
==========

A stroking finger sticks like a spring and slips every 0.3 mm. Look at the sawtooth of
the force, and listen: at 100 mm/s it is a tone of 330 Hz. See
:doc:`/reference/scenes/friction`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.motion import minimum_jerk
from stimlib.scenes import friction

hand = minimum_jerk(depth=0.03, rise=0.6, hold=0.2, fall=0.6)
result = stimlib.render(friction(), {"x": hand}, fs=8000, seconds=1.6)
listen(result, "force", "friction.wav")
figure = result.plot()
