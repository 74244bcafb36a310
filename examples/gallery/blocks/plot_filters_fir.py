"""
FIR filters: the differentiator
===============================

The rate of change of pink noise, dp/dt, up to a pass edge. Look at the spectrum: it
rises to the edge and falls steeply behind it. See :doc:`/reference/blocks/filters`.
"""

from math import pi

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import differentiator, pink_noise

p = pink_noise(1 / pi, seed=7, f_low=10)
scene = stimlib.Scene({"p": p, "rate": differentiator(p, passband=1000)})
result = stimlib.render(scene, {}, fs=8000, seconds=2.0)
listen(result, "rate", "rate_of_pink_noise.wav")
figure = result.plot()
