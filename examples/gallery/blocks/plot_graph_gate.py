"""
Gates
=====

``loading`` is 1 while something is compressed, and ``enabled`` runs a noise only then.
Look at the bursts of noise: they end when the compression does. See
:doc:`/reference/blocks/graph`.
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
