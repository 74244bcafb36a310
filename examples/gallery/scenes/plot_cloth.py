"""
Ribbed cloth
============

A texture of ribs that are tied to the place, and a rustle that is tied to the speed.
Look at the force: the rustle grows with the speed, and the ribs come more often. Listen
to it. The tutorial writes it: :doc:`/tutorial/own_stimulus`.
"""

from math import pi

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import clip, constant, sin, velocity, white_noise
from stimlib.motion import minimum_jerk

x = stimlib.Input("x", "m")
ribs = sin(2 * pi * x / constant(2e-3, "m"))
speed = abs(velocity(x, cutoff=20.0)) / constant(0.1, "m/s")
rustle = clip(speed, 0, 1) * white_noise(seed=1)
scene = stimlib.Scene({"force": constant(0.2, "N") * ribs + constant(0.02, "N") * rustle})

stroke = minimum_jerk(depth=0.04, rise=0.5, hold=0.3, fall=0.5)
result = stimlib.render(scene, {"x": stroke}, fs=8000, seconds=1.5)
listen(result, "force", "cloth.wav")
figure = result.plot()
