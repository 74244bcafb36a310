"""
White noise
===========

The same samples on every machine; a seed names the noise, a stream each of its
independent copies. See
:doc:`/reference/blocks/noise`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import white_noise

scene = stimlib.Scene(
    {"left": white_noise(seed=1, stream=0), "right": white_noise(seed=1, stream=1)}
)
result = stimlib.render(scene, {}, fs=8000, seconds=1.0)
listen(result, "left", "white_noise.wav")
figure = result.plot()
