"""
A measured surface
==================

Strokes that become harder, over an invented surface. Look at the acceleration, which
grows with the force, and listen to it. See :doc:`/reference/scenes/texture`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.motion import ramp_and_hold, sinusoid
from stimlib.scenes import texture

hand = {"x": sinusoid(0.04, 0.8), "force": ramp_and_hold(depth=2.5, rise=2.0)}
result = stimlib.render(texture(), hand, fs=8000, seconds=2.5)
listen(result, "acceleration", "texture.wav")
figure = result.plot()
