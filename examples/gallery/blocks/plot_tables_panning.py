"""
Arrays: a point that moves over the skin
========================================

Four actuators, 30 mm apart, and a vibration that moves from the first to the last in
0.8 s. Look at two neighbours: one fades as the other grows, and their squares add up to
1. See :doc:`/howto/arrays`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import oscillator, panning, timeline

tactors = [0.0, 0.03, 0.06, 0.09]  # m
place = timeline([(0.1, 0.0), (0.9, 0.09)], unit="m")
wave = timeline([(0.0, 0.0), (0.05, 1.0), (0.95, 1.0), (1.0, 0.0)]) * oscillator(250)
gains = panning(place, tactors)
scene = stimlib.Scene({f"tactor{k + 1}": gain * wave for k, gain in enumerate(gains)})
result = stimlib.render(scene, fs=8000, seconds=1.0)
listen(result, "tactor2", "second_of_four.wav")
figure = Figure(figsize=(8, 5), layout="constrained")
for axes, name, y in zip(
    figure.subplots(4, 1, sharex=True, sharey=True), result.outputs, result.y, strict=True
):
    axes.plot(result.t, y, linewidth=0.5)
    axes.set(ylabel=name, xlabel="time / s")
