"""A generalized Maxwell model of a recorded soft sample: stiffnesses of arms whose time
constants lie on a grid, by gradients.

python examples/fit_arms.py [--data FOLDER] [--plot FILE]

FOLDER is afm-relaxation of the recordings, by default beside the repository: an
indentation by 2 um in 40 ms, held for 15 s.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import stimlib
from stimlib import Input, Param
from stimlib.blocks import generalized_maxwell
from stimlib.fitting import fit_generalized_maxwell, maxwell_force, thin

DATA = Path(__file__).parents[2] / "shared" / "data" / "afm-relaxation"
FS = 1000  # Hz; five recorded samples are averaged into one
# s: when the probe touches; how long after the ramp the machine settles
CONTACT, SETTLED = 0.124, 0.02


def recorded(path: Path):
    """Time (s, 0 where the hold begins), indentation (m) and force (N) at 5 kHz."""
    with np.load(path) as z:
        t, place, force, part = z["t_s"], z["separation_m"], z["force_N"], z["segment"]
    touch = np.searchsorted(t, CONTACT)
    return t - t[part == 1][0], np.where(t >= t[touch], place[touch] - place, 0.0), force


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", metavar="FOLDER", type=Path, default=DATA)
    parser.add_argument(
        "--plot", metavar="FILE", help="also draw the force, and the errors of both models"
    )
    given = parser.parse_args()
    path = given.data / "afm_relaxation_5khz.npz"
    if not path.is_file():
        sys.exit(f"the recording is not there: {path}")

    t, y, force = recorded(path)
    n = t.size // 5
    ours = [a[: 5 * n].reshape(n, 5).mean(axis=1) for a in (t, y, force)]
    taus = np.geomspace(0.02, 10.0, 5)
    names = [f"k{i}" for i in range(1, 6)]
    arms = [(Param(name, 0.05, "N/m"), tau) for name, tau in zip(names, taus.tolist(), strict=True)]
    scene = stimlib.Scene(
        {"force": generalized_maxwell(Input("y", "m"), Param("k0", 0.4, "N/m"), arms)}
    )
    later = ours[0] > SETTLED
    # relative errors, even in log time
    weight = np.where(later, 1 / (np.where(later, ours[0], 1.0) * ours[2] ** 2), 0.0)
    start = {name: p.value for name, p in scene.params.items()}
    fit = stimlib.fit(scene, {"y": ours[1]}, ours[2], start, fs=FS, weight=weight)
    print(fit)

    # the same recording, averaged in bins even in log time, for models with time
    # constants of their own
    bins = thin(t, y, force, start=0.0, before=160)
    used = bins[0] > SETTLED
    grid = maxwell_force(
        bins[0],
        bins[1],
        fit.params["k0"],
        [(fit.params[a], tau) for a, tau in zip(names, taus, strict=True)],
    )
    errors = {"5 arms on a grid": grid / bins[2] - 1}
    for count in (2, 3):
        free = fit_generalized_maxwell(*bins, arms=count, where=used)
        errors[f"{count} free arms"] = free.fitted / bins[2] - 1
    for what, error in errors.items():
        print(
            f"{what}: {100 * np.sqrt(np.mean(error[used] ** 2)):.2f} % rms, largest"
            f" {100 * np.abs(error[used]).max():.1f} %"
        )
    # [end]
    if given.plot is not None:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7, 5), layout="constrained")
        top, below = figure.subplots(2, 1, sharex=True)
        top.loglog(bins[0][used], 1e6 * bins[2][used], ".", label="recorded")
        top.loglog(bins[0][used], 1e6 * grid[used], label="5 arms on a grid")
        top.set_ylabel("force (uN)")
        top.legend()
        for what, error in errors.items():
            below.semilogx(bins[0][used], 100 * error[used], label=what)
        below.set(xlabel="time since the ramp (s)", ylabel="error (%)")
        below.legend()
        figure.savefig(given.plot)


if __name__ == "__main__":
    main()
