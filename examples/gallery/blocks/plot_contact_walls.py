"""
Walls, detents and buttons
==========================

A finger moves into a wall, over detents and through a button, and back. Look at the
force over the position: where both ways differ, the finger loses energy. See
:doc:`/reference/blocks/contact`.
"""

import numpy as np
from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import button, detents, wall

x = stimlib.Input("x", "m")
key = button(x, peak=2.0, drop=0.4, at=1e-3)
outputs = {
    "wall": wall(x, k=2000.0, b=20.0, at=1e-3),
    "detents": detents(x, spacing=1e-3),
    "button": key.force,
}
hand = {"x": lambda t: 1e-3 * (1 - np.cos(2 * np.pi * t))}
result = stimlib.render(stimlib.Scene(outputs), hand, fs=8000, seconds=1.0)
figure = Figure(figsize=(9, 3), layout="constrained")
for axes, name in zip(figure.subplots(1, 3, sharex=True), result.outputs, strict=True):
    axes.plot(2 * np.sin(np.pi * result.t) ** 2, result[name])
    axes.set(title=name, xlabel="position / mm", ylabel="force / N")
