"""
Velocity and impedances
=======================

A spring answers the position and a damper the velocity; both together are a Kelvin-
Voigt element. Look at the area of the loop, which is the lost energy. See
:doc:`/reference/blocks/impedance`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import kelvin_voigt, spring, velocity
from stimlib.motion import sinusoid

x = stimlib.Input("x", "m")
both = kelvin_voigt(x, k=300.0, b=20.0)
scene = stimlib.Scene({"v": velocity(x, cutoff=50), "spring": spring(x, 300.0), "both": both})
hand = sinusoid(0.01, 1.0)
result = stimlib.render(scene, {"x": hand}, fs=1000, seconds=3.0)
figure = Figure(figsize=(8, 6), layout="constrained")
speed, loops = figure.subplots(2, 1, height_ratios=(1, 2))
speed.plot(result.t, result["v"])
speed.set(xlabel="time / s", ylabel="velocity / (m/s)")
for name in ("spring", "both"):
    loops.plot(1000 * hand(result.t), result[name], label=name)
loops.set(xlabel="position / mm", ylabel="force / N")
loops.legend()
