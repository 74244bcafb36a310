"""
Actuators and their limits
==========================

A force passes a clip at its peak, a limit on its rate of change, and the current of a
voice coil. Look at where each curve leaves the one before it. See
:doc:`/reference/blocks/contact`.
"""

from matplotlib.figure import Figure

import stimlib
from stimlib.blocks import force_limit, motor_current, slew_limit, spring
from stimlib.motion import ramp_and_hold

x = stimlib.Input("x", "m")
wanted = spring(x, 4000.0)
limited = slew_limit(force_limit(wanted, peak=60.0), rate=500.0)
current = motor_current(limited, x, motor_constant=10.0)
scene = stimlib.Scene({"wanted": wanted, "limited": limited, "current": current})
press = ramp_and_hold(depth=0.02, rise=0.1, start_time=0.1, hold=0.3, fall=0.1)
result = stimlib.render(scene, {"x": press}, fs=8000, seconds=0.8)
figure = Figure(figsize=(8, 6), layout="constrained")
rows = figure.subplots(len(result.outputs), 1, sharex=True)
for axes, name, y in zip(rows, result.outputs, result.y, strict=True):
    axes.plot(result.t, y)
    axes.set(ylabel=f"{name} / {result.units[name]}", xlabel="time / s")
