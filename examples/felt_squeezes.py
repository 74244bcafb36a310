"""Which recorded squeezes would be felt to vibrate: a sweep over gains and hands,
against a threshold.

python examples/felt_squeezes.py [--data FOLDER] [--threshold 0.01] [--plot FILE]

FOLDER is grip-trials of the recordings, by default beside the repository.  The hands
pressed a load cell: as displacement serves what would have compressed the reference
spring of 2000 N/m to the same force.
"""

import argparse
import sys
from math import pi, sqrt
from pathlib import Path

import numpy as np

from stimlib.motion import recording
from stimlib.scenes import squeeze
from stimlib.sweep import grid, measure, sweep

DATA = Path(__file__).parents[2] / "shared" / "data" / "grip-trials"
FS, K = 8000, 2000.0  # Hz, N/m
GAINS = 3.4 * 2.0 ** np.arange(-2, 4)  # around A0 of the UGrip paper
# N rms from 20 to 1000 Hz: an assumption, the UGrip paper measures none; on a plate of
# 17 g it is 0 dB SL (docs/reference/felt.rst)
THRESHOLD = 0.01
WINDOW = 0.2  # s over which a hand is taken to add up: an assumption too
# rms of dF / (A v), N/(m/s): k tau, and tau dp/dt up to 1000 Hz
VIBRATION = K / FS * pi * 1000 / FS * sqrt(2 / pi)


# [measure]
def strongest(y: np.ndarray) -> float:
    """The largest rms over a window."""
    total, n = np.r_[0.0, np.cumsum(y**2)], int(WINDOW * FS)
    return np.sqrt(np.max(total[n:] - total[:-n]) / n)


def moved(inputs: dict[str, np.ndarray], fs: float) -> tuple[np.ndarray, float]:
    """Of one hand, for all gains: where it is, and how fast it loads."""
    x = inputs["x1"]
    return x, strongest(np.maximum(np.gradient(x, 1 / fs), 0.0))


@measure(level="N", speed="m/s", prepare=moved)
def vibration(run, hand):
    x, speed = hand
    f = np.fft.rfftfreq(x.size, 1 / FS)
    # without the spring, whose force follows the hand
    spectrum = np.fft.rfft(run["force1"] - K * x)
    return strongest(np.fft.irfft(np.where((f >= 20) & (f <= 1000), spectrum, 0.0), x.size)), speed


# [study]
def recorded(folder: Path) -> dict:
    """Every trial: four persons, pinch and power grasp, three levels of difficulty,
    five of each.
    """
    hands = {}
    for path in sorted(folder.glob("grip_p*.csv")):
        log = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
        for trial in np.unique(log[["grasp", "level", "trial"]]):
            rows = log[log[["grasp", "level", "trial"]] == trial]
            hands[" ".join([path.stem, *map(str, trial)])] = recording(
                {"t_s": rows["t_s"], "force_N": rows["force_N"]}, {"x": f"force_N/{K}"}
            )
    return hands


def study(hands: dict):
    rows = grid(motion=hands, A=GAINS)
    return sweep(
        squeeze(k=K, fingers=1, level=1.0),
        rows,
        motion=hands,
        measures=vibration,
        fs=FS,
        seconds=3.2,
    )


# [end]
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", metavar="FOLDER", type=Path, default=DATA)
    parser.add_argument(
        "--threshold", type=float, default=THRESHOLD, help="N rms from 20 to 1000 Hz"
    )
    parser.add_argument(
        "--plot", metavar="FILE", help="also draw every squeeze, and the line between felt and not"
    )
    given = parser.parse_args()
    if not (given.data / "grip_p1.csv").is_file():
        sys.exit(f"the recordings are not there: {given.data}")
    hands = recorded(given.data)
    table = study(hands)
    A, level, speed = (np.asarray(table[name]) for name in ("A", "level", "speed"))
    v = 1000 * np.unique(speed)
    print(
        f"{len(hands)} hands, loading at {v[0]:.1f} to {v[-1]:.1f} mm/s; {table.num_rows}"
        " renderings"
    )
    ratio = level / (A * speed * VIBRATION)
    print(
        f"their vibration is {ratio.mean():.2f} times that of the formula, from {ratio.min():.2f}"
        f" to {ratio.max():.2f}"
    )
    for gain in GAINS:
        felt = np.mean(level[A == gain] >= given.threshold)
        least = 1000 * given.threshold / (gain * VIBRATION)
        print(
            f"A = {gain:5.2f}: {100 * felt:3.0f} % would be felt; by the formula those from"
            f" {least:5.1f} mm/s"
        )
    if given.plot is not None:
        draw(A, level, speed, given.threshold).savefig(given.plot)


def draw(A: np.ndarray, level: np.ndarray, speed: np.ndarray, threshold: float):
    """Each rendering as a dot, and the line A v = threshold / (k tau rms(tau
    dp/dt)).
    """
    from matplotlib.colors import TwoSlopeNorm
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.subplots()
    over = 20 * np.log10(level / threshold)
    dots = axes.scatter(
        1000 * speed, A, s=10, c=over, cmap="RdBu_r", norm=TwoSlopeNorm(0.0, -25.0, 25.0)
    )
    figure.colorbar(dots, label=f"vibration, dB above {1000 * threshold:g} mN rms")
    v = np.geomspace(speed.min(), speed.max(), 50)
    axes.plot(1000 * v, threshold / (v * VIBRATION), "k", lw=1, label="formula")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="loading speed of the hand (mm/s)",
        ylabel="A",
        ylim=(GAINS[0] / 1.3, GAINS[-1] * 1.3),
    )
    axes.legend(loc="lower left")
    return figure


if __name__ == "__main__":
    main()
