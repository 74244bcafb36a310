"""What `stimlib demo` renders, in one picture: python docs/pictures/demo.py writes
docs/pictures/demo.svg.
"""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

import stimlib
from stimlib.analysis import vibration
from stimlib.analysis.overview import INPUT, OUTPUT, curve
from stimlib.demo import FS, SECONDS, STIMULI

mpl.rcParams.update({"svg.hashsalt": "stimlib", "svg.fonttype": "none", "font.size": 9})
fig = Figure(figsize=(11, 4.2), layout="constrained")
fig.get_layout_engine().set(wspace=0.06)
for (top, bottom), s in zip(fig.subplots(2, 3).T, STIMULI, strict=True):
    made = stimlib.render(s.make(), s.motion, FS, SECONDS)
    y, x = made[s.output], next(iter(s.motion.values()))(made.t)
    curve(top, made.t, 1e3 * x, color=INPUT)
    top.set(title=s.make.__name__, xlabel="time / s", ylabel="position / mm", xmargin=0)
    if s.output == "force1":
        curve(bottom, made.t, vibration(y, FS), color=OUTPUT)
        bottom.set(xlabel="time / s", ylabel="vibration / N", xmargin=0)
    elif s.output == "voltage":
        curve(bottom, made.t, y, color=OUTPUT)
        bottom.set(xlabel="time / s", ylabel="voltage / V", xmargin=0)
    else:
        bottom.plot(1e3 * x[::16], y[::16], color=OUTPUT, lw=0.7)
        bottom.set(xlabel="position / mm", ylabel="force / N")
    for ax in (top, bottom):
        ax.grid(alpha=0.3)
fig.savefig(Path(__file__).with_name("demo.svg"), metadata={"Date": None})
