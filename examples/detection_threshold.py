"""Measure a detection threshold: two intervals, one with a vibration of 250 Hz, and a
staircase that lowers its amplitude.

    stimlib experiment run examples/detection_threshold.py:threshold --participant P01
    stimlib experiment analyse examples/detection_threshold.py:threshold

As a program it lets a simulated participant answer and prints the threshold.
"""

import argparse

from stimlib import Param, Scene
from stimlib.blocks import burst, oscillator
from stimlib.experiments import (
    Experiment,
    Interleaved,
    PsychometricObserver,
    Staircase,
    Stimulus,
    Timing,
    TwoInterval,
    choice,
    columns,
    psychometric,
    simulate,
)

BOUNDS = (0.001, 1.0)  # V: no trial leaves them

amplitude = Param("amplitude", 0.5, "V")
tone = Scene({"drive": amplitude * oscillator(250.0) * burst(0.0, 0.5, ramp=0.05)})

# 2IFC: the standard is no vibration, so half of the answers of a guesser are correct
task = TwoInterval(
    "250 Hz", "where", Stimulus("tone", {"amplitude": 0.0}), Stimulus("tone"), "amplitude"
)
# three correct answers lower the level, one error raises it: 79.4 % correct
steps = {"steps": (6.0, 2.0), "down": 3, "reversals": 10}
staircases = Interleaved(
    {
        "high": Staircase(task, 0.5, BOUNDS, **steps),
        "low": Staircase(task, 0.01, BOUNDS, **steps),
    }
)


def analysis(sessions) -> str:
    """Fit all answers with a chance level of 0.5, which they carry with them."""
    fit = psychometric(columns(sessions), log=True)
    low, high = fit.pse_interval
    return f"threshold {fit.pse:.3f} V, 95 % interval {low:.3f} to {high:.3f} V"


threshold = Experiment(
    name="threshold",
    version="1",
    scenes={"tone": tone},
    design=staircases,
    questions=(choice("where", "In which interval was the vibration?", "first", "second"),),
    fs=8000.0,
    safety=1.0,  # V at the device's full scale
    bounds={"amplitude": (0.0, BOUNDS[1])},
    timing=Timing(interval=0.5, gap=0.5),
    instructions="One of the two intervals has a vibration. Say which.",
    observer=PsychometricObserver(pse=0.08, sigma=0.2, log=True),
    analysis=analysis,
)


def main() -> None:
    """Simulate one participant, and draw the fit if asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the psychometric function")
    arguments = parser.parse_args()
    answers = simulate(threshold, threshold.observer, participants=1)
    fit = psychometric(answers, log=True)
    print(f"{len(answers['level'])} trials, threshold {fit.pse:.3f} V")
    if arguments.plot:
        fit.plot().savefig(arguments.plot)


if __name__ == "__main__":
    main()
