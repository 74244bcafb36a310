"""
Gates
=====

``loading`` is 1 while something is compressed; ``enabled`` runs a noise only then. See
:doc:`/reference/blocks/impedance`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import enabled, loading, velocity, white_noise
from stimlib.motion import minimum_jerk

pressing = loading(velocity(stimlib.Input("x", "m"), cutoff=100))
scene = stimlib.Scene({"gate": pressing, "noise": enabled(white_noise(seed=1), by=pressing)})
result = stimlib.render(scene, {"x": minimum_jerk(depth=0.02)}, fs=8000, seconds=2.5)
listen(result, "noise", "gated_noise.wav")
figure = result.plot()
