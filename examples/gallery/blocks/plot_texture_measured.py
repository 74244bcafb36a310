"""
A measured texture
==================

Noise whose spectrum follows speed and normal force, as it was measured; this surface is
invented. Look at how strength and spectrum change with the stroke, and listen to it.
See :doc:`/reference/blocks/texture`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import texture, timeline
from stimlib.design.texture import made_up

speed = timeline([(0.0, 0.0), (0.8, 0.15), (1.6, 0.0)], unit="m/s")
force = timeline([(0.0, 0.2), (1.6, 2.5)], unit="N")
scene = stimlib.Scene(
    {"speed": speed, "force": force, "acceleration": texture(speed, force, made_up(), seed=1)}
)
result = stimlib.render(scene, {}, fs=8000, seconds=1.6)
listen(result, "acceleration", "texture_sweep.wav")
figure = result.plot()
