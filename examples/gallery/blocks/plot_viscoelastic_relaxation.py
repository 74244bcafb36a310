"""
Relaxation and creep
====================

A spring in parallel with two Maxwell arms is pressed and held. Look at the force: it
falls fast at first and slowly later, with two time constants. See
:doc:`/reference/blocks/viscoelastic`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import generalized_maxwell, maxwell
from stimlib.motion import ramp_and_hold

y = stimlib.Input("y", "m")
arms = [(50.0, 0.05), (20.0, 0.5)]  # stiffness in N/m, time constant in s
scene = stimlib.Scene(
    {"soft": generalized_maxwell(y, 30.0, arms), "fluid": maxwell(y, 50.0, tau=0.5)}
)
press = ramp_and_hold(depth=0.01, rise=0.1, start_time=0.2, hold=1.0, fall=0.1)
result = stimlib.render(scene, {"y": press}, fs=1000, seconds=2.0)
figure = Figure(figsize=(8, 4), layout="constrained")
axes = figure.subplots()
axes.plot(result.t, result.y.T, label=result.outputs)
axes.set(xlabel="time / s", ylabel="force / N")
axes.legend()
