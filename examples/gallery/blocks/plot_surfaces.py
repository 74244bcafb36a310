"""
Surfaces: noise tied to place
=============================

Roughness over 20 mm, stroked slowly and fast. Look at the same hills at the same
places, in a quarter of the time. See :doc:`/reference/blocks/surfaces`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import grating, spatial_noise
from stimlib.motion import minimum_jerk

x = stimlib.Input("x", "m")
rough = spatial_noise(x, slope=1.0, seed=1, longest=0.02)
scene = stimlib.Scene({"rough": rough, "ribs": grating(x, [(2e-3, 1.0, 0.0)])})
stroke = minimum_jerk(depth=0.02, rise=0.8, hold=0.1, fall=0.2)
result = stimlib.render(scene, {"x": stroke}, fs=8000, seconds=1.2)
listen(result, "rough", "roughness.wav")
figure = Figure(figsize=(8, 4), layout="constrained")
axes = figure.subplots()
for name in scene.outputs:
    axes.plot(1000 * stroke(result.t), result[name], label=name)
axes.set(xlabel="position / mm", ylabel="height")
axes.legend()
