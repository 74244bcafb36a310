"""
Touch screen, down to the finger
================================

The voltage on the patches of a glass plate, and the displacement of the plate under the
finger. Look at the envelopes of both, bump by bump. See
:doc:`/reference/scenes/touch_screen`.
"""

import stimlib
from stimlib.motion import constant_speed
from stimlib.scenes import touch_screen

result = stimlib.render(
    touch_screen(bumps=20), {"x": constant_speed(0.1, 0.1)}, fs=8000, seconds=1.0
)
figure = result.plot()
