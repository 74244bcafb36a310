"""
Friction
========

A finger moves to and fro over a growing distance. Look at the small loops, where the
surface acts as a spring, and at the edges of the large ones, where it slips: smoothly,
or tooth by tooth. Listen for the slips. See :doc:`/reference/blocks/contact`.
"""

import numpy as np
from matplotlib.figure import Figure

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import friction, stick_slip

x = stimlib.Input("x", "m")
laws = {
    law: friction(x, 1.0, 0.6, 1000.0, law, elastic=0.3)
    for law in ("coulomb", "elastoplastic", "dahl")
}
scene = stimlib.Scene(laws | {"stick_slip": stick_slip(x, 1.0, 0.8, 0.5, 1000.0)})
result = stimlib.render(
    scene, {"x": lambda t: 1e-3 * t * np.sin(2 * np.pi * t)}, fs=8000, seconds=3.0
)
listen(result, "stick_slip", "stick_slip.wav")
figure = Figure(figsize=(8, 6), layout="constrained")
for axes, name in zip(figure.subplots(2, 2, sharey=True).flat, result.outputs, strict=True):
    axes.plot(result.t * np.sin(2 * np.pi * result.t), result[name])
    axes.set(title=name, xlabel="position / mm", ylabel="force / N")
