"""
Velocity and impedances
=======================

A spring answers the position and a damper the velocity; both together are a Kelvin-
Voigt element. Look at the width of the loops, which is the lost energy. See
:doc:`/reference/blocks/impedance`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import kelvin_voigt, spring, velocity
from stimlib.motion import sinusoid

x = stimlib.Input("x", "m")
scene = stimlib.Scene(
    {
        "v": velocity(x, cutoff=50),
        "spring": spring(x, 300.0),
        "both": kelvin_voigt(x, k=300.0, b=20.0),
    }
)
result = stimlib.render(scene, {"x": sinusoid(0.01, 1.0)}, fs=1000, seconds=3.0)
figure = Figure(figsize=(8, 6), layout="constrained")
rows = figure.subplots(len(result.outputs), 1, sharex=True)
for axes, name, y in zip(rows, result.outputs, result.y, strict=True):
    axes.plot(result.t, y)
    axes.set(ylabel=name, xlabel="time / s")
