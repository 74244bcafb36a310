"""
Springpot
=========

Springpots from a spring (order 0) to a dashpot (order 1) are pressed and held. Look at
how fast each force relaxes: faster for a higher order. See
:doc:`/reference/blocks/fractional`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import equal_force, springpot
from stimlib.motion import ramp_and_hold

y = stimlib.Input("y", "m")
orders = (0.0, 0.25, 0.5)
scene = stimlib.Scene(
    {
        f"order_{100 * a:03.0f}": springpot(y, equal_force(300.0, 0.0, a), a, scheme="l1")
        for a in orders
    }
)
press = ramp_and_hold(depth=0.01, rise=0.2, start_time=0.2)
result = stimlib.render(scene, {"y": press}, fs=1000, seconds=2.0)
figure = Figure(figsize=(8, 4), layout="constrained")
axes = figure.subplots()
axes.plot(result.t, result.y.T, label=result.outputs)
axes.set(xlabel="time / s", ylabel="force / N")
axes.legend()
