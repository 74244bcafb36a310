"""How much a vibration differs from noise to noise: 8 gains, 40 noises of each, in one
call.

python examples/many_noises.py [--plot FILE]
"""

import argparse

import numpy as np

import stimlib
from stimlib.motion import minimum_jerk
from stimlib.scenes import squeeze

FS, STIFFNESS = 8000, 2000.0  # Hz, N/m
GAINS, NOISES = np.linspace(0.5, 4.0, 8), 40


def main() -> None:
    runs = stimlib.compile(squeeze(k=STIFFNESS, fingers=1), FS).many(
        seeds=range(GAINS.size * NOISES)
    )
    runs.set("A", np.repeat(GAINS, NOISES), ramp=0.0)
    # one squeeze, 1 s, for all
    x = minimum_jerk(depth=0.02, rise=0.4, hold=0.1, fall=0.4)(np.arange(FS) / FS)[None]
    vibration = runs.process(x)[:, 0] - STIFFNESS * x
    rms = 1000 * np.sqrt(np.mean(vibration**2, axis=1)).reshape(GAINS.size, NOISES)
    for A, level in zip(GAINS, rms, strict=True):
        print(
            f"A = {A:.1f}: {level.mean():5.2f} mN rms, {100 * level.std() / level.mean():.1f} %"
            " from noise to noise"
        )
    # [end]

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", metavar="FILE", help="also draw each run")
    if (path := parser.parse_args().plot) is not None:
        from matplotlib.figure import Figure

        figure = Figure(layout="constrained")
        axes = figure.subplots()
        axes.plot(GAINS, rms, ".k", markersize=2)
        axes.set(xlabel="A", ylabel="vibration (mN rms)")
        figure.savefig(path)


if __name__ == "__main__":
    main()
