"""
Soft objects: a cursor over a nodule
====================================

The hand moves evenly. Look at the cursor: it is held back where the object is hard, and
returns along the way it went. See :doc:`/reference/blocks/soft`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import cursor
from stimlib.motion import ramp_and_hold
from stimlib.soft import nodules

nodule = nodules([(0.04, 0.06, 0.006)])
x, y = stimlib.Input("x", "m"), stimlib.constant(0.06, "m")
hand = ramp_and_hold(0.12, 2.4)  # m, s
result = stimlib.render(
    stimlib.Scene({"x": cursor(x, y, nodule).x}),
    {"x": hand},
    fs=1000,
    seconds=2.4,
)
figure = Figure(figsize=(8, 4), layout="constrained")
axes = figure.subplots()
axes.plot(result.t, 1000 * hand(result.t), label="hand")
axes.plot(result.t, 1000 * result["x"], label="cursor")
axes.set(xlabel="time / s", ylabel="place / mm")
axes.legend()
