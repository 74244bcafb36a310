"""
Maps: a wall
============

Arithmetic, comparisons and ``where`` make a force of any position. Look at the corner:
there is nothing outside, and a stiff spring inside. See
:doc:`/reference/blocks/pointwise`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import clip, constant, where
from stimlib.motion import minimum_jerk

depth = stimlib.Input("x", "m") - constant(0.01, "m")  # the wall stands at 10 mm
wall = where(depth > 0, constant(3000.0, "N/m") * depth, 0)
scene = stimlib.Scene({"force": clip(wall, constant(0.0, "N"), constant(20.0, "N"))})
hand = minimum_jerk(depth=0.02)
result = stimlib.render(scene, {"x": hand}, fs=8000, seconds=1.2)
figure = Figure(figsize=(8, 4), layout="constrained")
axes = figure.subplots()
axes.plot(1000 * hand(result.t), result["force"])
axes.set(xlabel="position / mm", ylabel="force / N")
