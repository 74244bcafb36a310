"""What is it made of?  Stiffness, springpot and order from a force that was rendered
with other numbers, and 1 % of noise.

python examples/recover_springpot.py [--plot FILE]
"""

import argparse

import numpy as np

import stimlib
from stimlib import Input, Param
from stimlib.blocks import spring, springpot

FS = 1000  # Hz


def press(t):
    """Position in m of a finger that presses twice, and trembles."""
    return 0.01 * np.sin(4.0 * t) ** 2 + 2e-4 * np.sin(2 * np.pi * 9 * t)


def main() -> None:
    y = Input("y", "m")
    k, chi, alpha = Param("k", 300.0, "N/m"), Param("chi", 150.0), Param("alpha", 0.5)
    scene = stimlib.Scene({"force": spring(y, k) + springpot(y, chi, alpha, scheme="l1")})

    truth = {"k": 800.0, "chi": 60.0, "alpha": 0.3}
    force = stimlib.render(scene, {"y": press}, FS, seconds=2.0, params=truth)["force"]
    force += 0.01 * np.std(force) * np.random.default_rng(0).standard_normal(force.size)

    start = {"k": 300.0, "chi": 150.0, "alpha": (0.5, 0, 1)}
    fit = stimlib.fit(scene, {"y": press}, force, start, fs=FS)
    print(fit)
    inside = [name for name, (low, high) in fit.intervals.items() if low <= truth[name] <= high]
    print(f"inside their intervals: {', '.join(inside)}")
    # [end]

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--plot", metavar="FILE", help="also draw the force, the fit and their difference"
    )
    if (path := parser.parse_args().plot) is not None:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7, 5), layout="constrained")
        top, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        t = np.arange(force.size) / FS
        top.plot(t, force, label="rendered, with noise", linewidth=0.8)
        top.plot(t, fit.signals["force"], label="found", linewidth=0.8)
        top.set_ylabel("force (N)")
        top.legend()
        below.plot(t, fit.signals["force"] - force, linewidth=0.5)
        below.set(ylabel="difference (N)", xlabel="time (s)")
        figure.savefig(path)


if __name__ == "__main__":
    main()
