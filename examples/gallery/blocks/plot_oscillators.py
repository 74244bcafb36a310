"""
Bumps and carriers
==================

The envelope is tied to the place of the finger, the vibration to time. Look at the
close-up: the bumps get shorter when the finger is faster, the waves do not. See
:doc:`/reference/blocks/oscillators`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import bump, carrier, constant
from stimlib.motion import constant_speed

u = stimlib.Input("x", "m") / constant(0.02, "m")  # one bump every 20 mm
scene = stimlib.Scene(
    {"envelope": bump(u, "sawtooth", duty=0.6), "y": bump(u, "sawtooth", duty=0.6) * carrier(158.0)}
)
result = stimlib.render(scene, {"x": constant_speed(0.05, 0.1)}, fs=8000, seconds=2.0)
listen(result, "y", "sawtooth_bumps.wav")
figure = result.plot()
