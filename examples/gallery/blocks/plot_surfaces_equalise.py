"""
Equal displacement
==================

A plate moves more in its middle. Look at how ``equalize`` raises the voltage towards
the edges, where the plate moves less. See :doc:`/reference/blocks/surfaces`.
"""

import stimlib
from stimlib.blocks import carrier, constant, equalize
from stimlib.motion import constant_speed

knots = [0.0, 0.025, 0.05, 0.075, 0.1]  # m
measured = [65e-6, 105e-6, 120e-6, 105e-6, 65e-6]  # m, all at the same voltage
voltage = constant(100.0, "V") * carrier(158.0)
scene = stimlib.Scene(
    {"voltage": equalize(stimlib.Input("x", "m"), (knots, measured), signal=voltage)}
)
result = stimlib.render(scene, {"x": constant_speed(0.1, 0.1)}, fs=8000, seconds=2.0)
figure = result.plot()
