"""
A material between spring and dashpot
=====================================

A viscoelastic material is pressed and held. Look at the force, which relaxes, and at
the loop over the position, whose area is the lost work. See
:doc:`/reference/scenes/viscoelastic`.
"""

import stimlib
from stimlib.motion import ramp_and_hold
from stimlib.scenes import viscoelastic

press = ramp_and_hold(depth=0.01, rise=0.3, start_time=0.2, hold=1.0, fall=0.3)
result = stimlib.render(viscoelastic(alpha=0.25), {"y": press}, fs=1000, seconds=2.5)
figure = result.plot()
