"""
Pink noise
==========

The power of pink noise falls like 1/f, by 3 dB an octave. Look at the straight slope of
its spectrum, and listen to how much darker it is than white noise. See
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
