"""
Pink noise
==========

Its power falls like 1/f, 3 dB an octave, from the first sample on. See
:doc:`/reference/blocks/noise`.
"""

from math import pi

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import pink_noise

result = stimlib.render(
    stimlib.Scene({"p": pink_noise(1 / pi, seed=7, f_low=10)}), {}, fs=8000, seconds=2.0
)
listen(result, "p", "pink_noise.wav")
figure = result.plot()
