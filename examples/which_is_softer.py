"""Does vibration make an object feel softer?  An experiment in one page, after the
UGrip paper, section 2.2.

    stimlib experiment run examples/which_is_softer.py:softer --participant P07
    stimlib experiment simulate examples/which_is_softer.py:softer

As a program it lets one simulated participant answer, every stimulus rendered.
"""

# [experiment]
import argparse
import tempfile

import numpy as np

from stimlib.experiments import (
    Answer,
    Experiment,
    Interleaved,
    Sequential,
    Session,
    Simulated,
    Staircase,
    Stimulus,
    Timing,
    TwoInterval,
    choice,
    columns,
    read,
    run,
    status,
)
from stimlib.motion import minimum_jerk
from stimlib.run import Safety
from stimlib.scenes import squeeze

K0 = 2000.0  # N/m, of the standard, which does not vibrate
BOUNDS = (500.0, 8000.0)  # N/m: they protect the hand


def staircases(vibration: float) -> Interleaved:
    """Two of them at a time, one from above and one from below."""
    standard, comparison = (
        Stimulus("squeeze", {"k": K0, "A": 0.0}),
        Stimulus("squeeze", {"A": vibration}),
    )
    task = TwoInterval(
        f"A = {vibration:g}", "softer", standard, comparison, varies="k", asks_less=True
    )
    starts = {"high": (2.0 * K0, 2.5 * K0), "low": (K0 / 2.5, K0 / 2.0)}
    return Interleaved(
        {name: Staircase(task, start, BOUNDS, reversals=8) for name, start in starts.items()}
    )


def felt(trial, rng) -> Answer:
    """A simulated participant: stiffness in ratios of 20 %, and less of it where the
    object vibrates.
    """
    stiffness = [
        np.log(s.params["k"]) - 0.15 * (s.params["A"] > 0) + 0.2 * rng.normal()
        for s in trial.stimuli
    ]
    return Answer({"softer": "first" if stiffness[0] < stiffness[1] else "second"})


def means(sessions) -> str:
    """Of each condition the geometric mean of all levels, a first look at the point of
    subjective equality.
    """
    table, lines = columns(sessions), []
    for name in sorted(set(table["condition"])):
        levels = [
            k
            for k, condition in zip(table["level"], table["condition"], strict=True)
            if condition == name
        ]
        lines.append(
            f"{name}: felt as the standard at about {np.exp(np.mean(np.log(levels))):.0f} N/m"
        )
    return "\n".join(lines)


softer = Experiment(
    name="softer",
    version="1",
    scenes={"squeeze": squeeze(fingers=1)},
    design=Sequential(
        {"still": staircases(0.0), "vibrating": staircases(3.4)}, pause=120.0, shuffle=True
    ),
    questions=(
        choice("softer", "Which one was softer, the first or the second?", "first", "second"),
    ),
    fs=8000.0,
    safety=Safety(full_scale=50.0, peak=40.0),
    bounds={"k": BOUNDS},
    # a squeeze in each interval; for a hand of yours: Live(), or Signals of the device
    motion={"x1": minimum_jerk(depth=0.005, rest=0.7)},
    timing=Timing(interval=1.0, gap=0.5),
    instructions="Squeeze both objects. Then say which one was softer.",
    observer=felt,
    analysis=means,
)
# [end]


def plot(saved, path: str) -> None:
    """The staircases."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(7, 4), layout="constrained")
    ax = fig.subplots()
    for track in dict.fromkeys(r.trial.track for r in saved.records):
        levels = [(r.number, r.trial.level) for r in saved.records if r.trial.track == track]
        ax.semilogy(*zip(*levels, strict=True), "o-", label=track)
    ax.set(xlabel="trial", ylabel="stiffness of the comparison (N/m)")
    ax.legend()
    fig.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the staircases")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as data:
        with Session(softer, data, "P01", pilot=True) as session:
            run(session, Simulated(session, felt), "offline")
        saved = read(session.folder, pilot=True)
    told = status(saved)
    print(f"{told['trials']} trials, {told['lost']} samples lost, {told['limited']} limited")
    print(means([saved]))
    if arguments.plot:
        plot(saved, arguments.plot)


if __name__ == "__main__":
    main()
