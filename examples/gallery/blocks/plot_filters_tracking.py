"""
Tracking slow reports
=====================

A touch screen reports 60 times a second, which is a staircase. Look at how ``track``
turns it into a smooth movement, a little later. See :doc:`/reference/blocks/filters`.
"""

import numpy as np
from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import track, track_velocity
from stimlib.motion import sinusoid

x = stimlib.Input("x", "m")
scene = stimlib.Scene({"tracked": track(x, bandwidth=10), "rate": track_velocity(x, bandwidth=10)})
finger = sinusoid(0.02, 1.0)
reports = finger(np.floor(np.arange(2000) / 1000 * 60) / 60)
result = stimlib.render(scene, {"x": reports}, fs=1000)
figure = Figure(figsize=(8, 6), layout="constrained")
rows = figure.subplots(len(result.outputs), 1, sharex=True)
for axes, name, y in zip(rows, result.outputs, result.y, strict=True):
    axes.plot(result.t, y)
    axes.set(ylabel=f"{name} / {result.units[name]}", xlabel="time / s")
rows[0].plot(result.t, reports, linewidth=0.7)
