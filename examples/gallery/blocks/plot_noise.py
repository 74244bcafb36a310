"""
White noise
===========

White noise has the same samples on every machine. A seed names the noise, and a stream
names each of its independent copies. Look at the flat spectrum. See
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
