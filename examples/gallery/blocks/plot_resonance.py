"""
Modes, and a faster resonance
=============================

A burst at a mode's frequency, and the answer of the mode without and with
``pole_swap``. Look at how much sooner the second answer follows the burst. See
:doc:`/reference/blocks/resonance`.
"""

import stimlib
from stimlib.blocks import burst, carrier, constant, every, mode, pole_swap

drive = constant(10.0, "V") * burst(every(0.25), 0.06, ramp=0.005) * carrier(158.0)
swapped = pole_swap(drive, 158.0, q=10, gain=4)
scene = stimlib.Scene(
    {"drive": drive, "slow": mode(drive, 158.0, q=10), "fast": mode(swapped, 158.0, q=10)}
)
result = stimlib.render(scene, {}, fs=8000, seconds=0.5)
figure = result.plot()
