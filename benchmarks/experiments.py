"""A whole simulated UGrip experiment: 8 participants, 64 staircases, every stimulus
rendered; and the analysis of its 32 fits.

    python benchmarks/experiments.py             print
    python benchmarks/experiments.py --record    and keep in results/experiments.csv

Observers feel the rendered samples; participants are spread over all cores. Both scenes
are compiled before.
"""

from __future__ import annotations

import os
import time

from bench import Row, main, row

from stimlib.experiments.observers import simulate
from stimlib.experiments.papers.ugrip import comparisons, fits, person, text, ugrip
from stimlib.experiments.random_streams import stream

PEOPLE = [f"P{n:02d}" for n in range(1, 9)]


def cpu() -> float:
    """Seconds of all cores, of this process and of its children that have ended."""
    t = os.times()
    return t.user + t.system + t.children_user + t.children_system


def measure() -> list[Row]:
    """All rows."""
    simulate(ugrip(reversals=1), person(), ["P00"])  # compiles
    experiment = ugrip()
    observers = {code: person(stream(1, "person", code)) for code in PEOPLE}
    began, used = time.perf_counter(), cpu()
    answers = simulate(experiment, observers, PEOPLE, workers=None)
    simulated, rendering = time.perf_counter() - began, cpu() - used
    print(text(comparisons(answers)))
    spent = {}
    for interval in ("none", "profile"):
        began = time.perf_counter()
        found = fits(answers, interval)
        spent[interval] = time.perf_counter() - began
    return [
        row("participants", len(PEOPLE), ""),
        row("staircases", len(set(zip(answers["participant"], answers["track"], strict=True))), ""),
        row("stimuli rendered", 2 * len(answers["level"]), ""),
        row("cores", len(os.sched_getaffinity(0)), ""),
        row("simulation", simulated, "s"),
        row("simulation: of all cores", rendering, "s"),
        row("fits", len(found), ""),
        row("fits: that failed", sum(bool(fit.problems) for fit in found.values()), ""),
        row("fits, all", spent["none"], "s"),
        row("fits, all, with profile intervals", spent["profile"], "s"),
    ]


if __name__ == "__main__":
    main("experiments", __doc__, measure, cores=None)
