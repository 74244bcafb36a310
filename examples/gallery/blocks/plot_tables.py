"""
Tables: a detent
================

A force that is given by points, here a notch. Look at its sign: on both sides it pulls
the finger towards the middle. See :doc:`/reference/blocks/tables`.
"""

import numpy as np
from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import lut
from stimlib.motion import minimum_jerk

place = np.linspace(0.0, 0.02, 21)  # m
# N, towards the middle on both sides
force = 2.0 * np.sin(np.pi * (place - 0.01) / 0.01) * np.hanning(21)
scene = stimlib.Scene({"force": lut(stimlib.Input("x", "m"), place, force, kind="pchip", unit="N")})
hand = minimum_jerk(depth=0.02, rise=0.5, fall=0.5)
result = stimlib.render(scene, {"x": hand}, fs=8000, seconds=1.4)
figure = Figure(figsize=(8, 4), layout="constrained")
axes = figure.subplots()
axes.plot(1000 * hand(result.t), result["force"])
axes.set(xlabel="position / mm", ylabel="force / N")
