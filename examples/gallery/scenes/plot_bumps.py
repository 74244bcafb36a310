"""
Bumps on a touch screen
=======================

A vibration of 158 Hz whose strength follows the place of the finger. Look at the
voltage over the position: it is large on each bump and zero between them. See
:doc:`/reference/scenes/bumps`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.motion import minimum_jerk
from stimlib.scenes import bumps

stroke = minimum_jerk(depth=0.1, rise=1.0, hold=0.2, fall=1.0)
result = stimlib.render(
    bumps("sine", bumps=6, duty=0.5, amplitude=4.0), {"x": stroke}, fs=8000, seconds=2.4
)
listen(result, "voltage", "bumps.wav")
figure = result.plot()
