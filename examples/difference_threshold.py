"""Measure a difference threshold: two intervals, a vibration of 200 Hz and one of
another frequency, and QUEST+ over the frequency itself.

    stimlib experiment run examples/difference_threshold.py:pitch --participant P01
    stimlib experiment analyse examples/difference_threshold.py:pitch

As a program it lets five simulated participants answer and prints a table of their
just-noticeable differences and Weber fractions.
"""

import argparse

from stimlib import Param, Scene
from stimlib.blocks import burst, oscillator
from stimlib.experiments import (
    Experiment,
    PsychometricObserver,
    Quest,
    Roved,
    Stimulus,
    Timing,
    TwoInterval,
    choice,
    columns,
    difference_thresholds,
    fitted,
    simulate,
)

STANDARD = 200.0  # Hz

frequency, amplitude = Param("frequency", STANDARD, "Hz"), Param("amplitude", 0.3, "V")
tone = Scene({"drive": amplitude * oscillator(frequency) * burst(0.0, 0.5, ramp=0.05)})

# the level is the frequency of the comparison: 200 Hz is no difference
pair = TwoInterval(
    "200 Hz",
    "higher",
    Stimulus("tone", {"frequency": STANDARD, "amplitude": 0.3}),
    Stimulus("tone", {"amplitude": 0.3}),
    "frequency",
)
design = Quest(
    # each interval has another amplitude, so that how strong it feels is no cue
    Roved(pair, "amplitude", 1.2),
    levels=tuple(range(120, 281, 10)),
    means=tuple(range(180, 221, 5)),
    deviations=(6.0, 8.5, 12.0, 17.0, 24.0, 34.0, 48.0, 68.0, 96.0),
    trials=120,
)


def analysis(sessions) -> str:
    """Print the JND of each participant, and its part of the standard."""
    return table(columns(sessions))


def table(answers) -> str:
    """Return a line for each participant."""
    lines = ["        JND / Hz   95 %           Weber fraction"]
    for (who, _), found in difference_thresholds(answers, STANDARD).items():
        interval = f"{found.jnd_low:.1f} to {found.jnd_high:.1f}"
        problems = "; problems: " + ", ".join(found.problems) if found.problems else ""
        lines.append(f"{who}     {found.jnd:8.1f}   {interval:14} {found.weber:.1%}{problems}")
    return "\n".join(lines)


pitch = Experiment(
    name="pitch",
    version="1",
    scenes={"tone": tone},
    design=design,
    questions=(choice("higher", "Which vibration was faster?", "first", "second"),),
    fs=8000.0,
    safety=1.0,  # V at the device's full scale
    bounds={"frequency": (100.0, 300.0), "amplitude": (0.0, 0.5)},
    timing=Timing(interval=0.5, gap=0.5),
    instructions="Both intervals vibrate. Say which vibration was faster.",
    # notices a difference of 16 Hz in 75 % of the pairs
    observer=PsychometricObserver(pse=STANDARD, sigma=16 / 0.6745),
    analysis=analysis,
)


def main() -> None:
    """Simulate five participants, and draw the first one's fit if asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the psychometric function")
    arguments = parser.parse_args()
    answers = simulate(pitch, pitch.observer, participants=5, progress=False)
    print(table(answers))
    if arguments.plot:
        fit = fitted(answers, ["participant"], pse=STANDARD, unit="Hz")[("P01",)]
        fit.plot().savefig(arguments.plot)


if __name__ == "__main__":
    main()
