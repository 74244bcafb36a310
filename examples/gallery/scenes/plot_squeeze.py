"""
Squeeze
=======

A spring between thumb and index finger. Look at the vibration: it is there while the
spring is compressed, and only then. See :doc:`/reference/scenes/squeeze`.

Press Start, turn the sound on, and move the pointer over the field
(:doc:`/howto/share`):

.. played:: squeeze
"""

import stimlib
from stimlib.analysis import listen
from stimlib.motion import minimum_jerk
from stimlib.scenes import squeeze

thumb, index = minimum_jerk(depth=0.02), minimum_jerk(depth=0.015)
result = stimlib.render(squeeze(), {"x1": thumb, "x2": index}, fs=8000, seconds=2.5)
listen(result, "force1", "squeeze.wav")
figure = result.plot()
