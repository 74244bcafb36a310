"""
Pulses
======

Three pulses of 20 ms, each with ramps of half its length, so that it is a Hann window.
Look at the shape. An actuator that is given it shows how it follows a slow push. See
:doc:`/reference/scenes/pulse`.
"""

import stimlib
from stimlib.scenes import pulse

scene = pulse(duration=0.02, ramp=0.01, period=0.05, repeats=3, unit="N")
result = stimlib.render(scene, fs=8000, seconds=0.15)
figure = result.plot()
