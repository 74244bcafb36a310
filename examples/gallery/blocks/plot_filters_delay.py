"""
Delay
=====

A force that comes 50 ms after the press, as in a slow control loop. Look at the
distance between both curves. See :doc:`/reference/blocks/filters`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import delay, spring
from stimlib.motion import minimum_jerk

force = spring(stimlib.Input("x", "m"), 1000.0)
scene = stimlib.Scene({"now": force, "late": delay(force, seconds=0.05)})
result = stimlib.render(
    scene, {"x": minimum_jerk(depth=0.02, rise=0.1, fall=0.1)}, fs=8000, seconds=1.0
)
figure = Figure(figsize=(8, 4), layout="constrained")
axes = figure.subplots()
axes.plot(result.t, result.y.T, label=result.outputs)
axes.set(xlabel="time / s", ylabel="force / N")
axes.legend()
