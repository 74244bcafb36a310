"""
Gratings and roughness
======================

A grooved, rough surface. Look at the force over the position: the way back is the way
there. See :doc:`/reference/scenes/grating`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.motion import minimum_jerk
from stimlib.scenes import grating

stroke = minimum_jerk(depth=0.06, rise=0.7, hold=0.2, fall=0.4)
result = stimlib.render(grating(), {"x": stroke}, fs=8000, seconds=1.5)
listen(result, "force", "grating.wav")
figure = result.plot()
