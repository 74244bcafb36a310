"""Figure 4 of the UGrip paper, redrawn from a rendering: python
docs/pictures/squeeze.py writes docs/pictures/squeeze.svg.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import stimlib
from stimlib.motion import ramp_and_hold
from stimlib.scenes import squeeze

FS, K = 8000, 2000.0
motion = ramp_and_hold(depth=0.02, rise=0.4, start_time=0.1, hold=0.2, fall=0.4)
y = stimlib.render(squeeze(fingers=1), {"x1": motion}, FS, seconds=1.3, params={"k": K})
x, force = motion(y.t), y["force1"]

mpl.rcParams.update({"svg.hashsalt": "stimlib", "font.size": 9})
fig = Figure(figsize=(9, 4.2), layout="constrained")
left, right = fig.subfigures(1, 2, width_ratios=(3, 2))
rows = {"position / mm": 1e3 * x, "k x / N": K * x, "dF / N": force - K * x, "force / N": force}
for ax, (name, curve) in zip(left.subplots(4, 1, sharex=True), rows.items(), strict=True):
    ax.plot(y.t, curve, lw=0.8)
    ax.set_ylabel(name)
    ax.grid(alpha=0.3)
ax.set(xlabel="time / s", xlim=(0, 1.3))
ax = right.subplots()
rising = np.diff(x, prepend=0) > 0
ax.plot(1e3 * x[~rising], force[~rising], color="0.6", lw=0.8, label="held, unloading")
ax.plot(1e3 * x[rising], force[rising], color="#d55e00", lw=0.5, label="loading")
ax.set(xlabel="position / mm", ylabel="force / N")
ax.grid(alpha=0.3)
ax.legend(loc="upper left")
fig.savefig(Path(__file__).with_name("squeeze.svg"), metadata={"Date": None})
