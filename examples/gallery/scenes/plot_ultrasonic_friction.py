"""
Friction reduced by ultrasound
==============================

A finger slides over a plate that vibrates by ultrasound on half of each bump. Look at
the force over the position: it is small where the plate vibrates. See
:doc:`/reference/scenes/ultrasonic_friction`.
"""

import stimlib
from stimlib.motion import minimum_jerk
from stimlib.scenes import ultrasonic_friction

stroke = minimum_jerk(depth=0.1, rise=1.0, hold=0.2, fall=1.0)
result = stimlib.render(ultrasonic_friction(), {"x": stroke}, fs=8000, seconds=2.4)
figure = result.plot()
