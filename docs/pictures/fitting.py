"""Recorded tissue and its springpots: python docs/pictures/fitting.py writes
fitting.svg beside it and prints its table.
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import scipy
from matplotlib.figure import Figure

from stimlib.fitting import fit_generalized_maxwell, fit_springpot, thin

DATA = Path(__file__).parents[3] / "shared" / "data"
# told apart by people who do not see red and green as others do (Okabe and Ito)
COLOURS = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7"
RAMPS = {"0p1s": 0.1, "1s": 1.0, "10s": 10.0, "100s": 100.0}


def row(name, used, fit, arms):
    low, high = fit.intervals["alpha"]
    print(
        f"{name:20} {used:4d}   {fit.alpha:.4f} ({low:.4f} .. {high:.4f})   {fit.chi:6.4g}  "
        f" {100 * fit.relative_error:4.2f} %  {100 * fit.largest_relative_error:4.1f} %  "
        f" {100 * arms.relative_error:4.2f} %"
    )


if not DATA.is_dir():
    sys.exit(f"the recordings are not there: {DATA}")
mpl.rcParams.update({"svg.hashsalt": "stimlib", "font.size": 9})
fig = Figure(figsize=(10, 6), layout="constrained")
top, below = fig.subplots(2, 3, sharex="col", height_ratios=(3, 1))
print(f"Python {sys.version.split()[0]}, numpy {np.__version__}, scipy {scipy.__version__}")
for column, (condition, title) in enumerate(
    (("Relaxed", "muscle, relaxed"), ("pCa4p4", "muscle, with calcium"))
):
    for i, (name, ramp) in enumerate(RAMPS.items()):
        table = np.loadtxt(
            DATA / "muscle-relaxation" / f"Avg{condition}_{name}.csv", delimiter=",", skiprows=1
        )
        t, y, f = table.T[:3]
        hold = t > 2.0 + ramp
        fit = fit_springpot(t, y - y[0], f, where=hold)
        fit.draw(top[column], below[column], f"ramp of {ramp:g} s", COLOURS[i])
        row(
            f"{condition} {ramp:g} s",
            hold.sum(),
            fit,
            fit_generalized_maxwell(t, y - y[0], f, arms=2, where=hold),
        )
    top[column].set(title=title, ylabel="stress / kPa", xlim=(4e-3, None))

with np.load(DATA / "afm-relaxation" / "afm_relaxation_5khz.npz") as z:
    t, place, force, part = z["t_s"], z["separation_m"], z["force_N"], z["segment"]
start = float(t[part == 1][0])
touch = np.searchsorted(t, 0.124)
t, y, f = thin(
    t, np.where(t >= t[touch], place[touch] - place, 0.0), force, start=start, before=160
)
later = t > start + 0.02
fit = fit_springpot(t, y, f, where=later)
fit.draw(top[2], below[2], "ramp of 36 ms", COLOURS[4])
top[2].set(
    title="soft sample, indented",
    ylabel="force / N",
    yscale="log",
    ylim=(1e-7, 3e-6),
    xlim=(4e-3, None),
)
row("indented, from 20 ms", later.sum(), fit, fit_generalized_maxwell(t, y, f, arms=2, where=later))
fig.savefig(Path(__file__).with_name("fitting.svg"), metadata={"Date": None})
