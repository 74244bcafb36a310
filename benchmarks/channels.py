"""Many copies of a scene, each with its own seed and parameters: the one-finger
squeeze, 64 times.

python benchmarks/channels.py             print
python benchmarks/channels.py --record    and keep the figures in results/channels.csv
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
from bench import NS, TIMES, Row, main, row
from noise_chain import FS, movements
from timing import interleaved, medians, ratio

import stimlib
from stimlib.run.processor import Copies, Processor
from stimlib.scenes import squeeze

COPIES, SAMPLES = 64, 1 << 14


def copies(threads: int | None = None) -> Copies:
    """Runs of one scene that differ in seed, stiffness and gain."""
    runs = stimlib.compile(squeeze(fingers=1), FS).many(range(COPIES), threads=threads)
    runs.set("k", np.linspace(500, 3000, COPIES).tolist(), ramp=0.0)
    runs.set("A", np.linspace(0.5, 4.0, COPIES).tolist(), ramp=0.0)
    return runs


def one_after_another(
    procs: Iterable[Processor], x: np.ndarray, out: np.ndarray
) -> Callable[[], None]:
    """A call of ``process`` for each."""

    def job() -> None:
        for proc, y in zip(procs, out, strict=True):
            proc.process(x, y)

    return job


def measure() -> list[Row]:
    """All rows."""
    x = movements(SAMPLES)["gate open"][None]
    out = np.empty((COPIES, 1, SAMPLES))
    jobs = {
        "1 copy": one_after_another([copies()[0]], x, out[:1]),
        "one after another": one_after_another(list(copies()), x, out),
    }
    jobs |= {f"{threads} thread(s)": partial(copies(threads).process, x, out) for threads in (1, 2)}
    times = interleaved(jobs)
    samples = {what: SAMPLES * (1 if what == "1 copy" else COPIES) for what in jobs}
    rows = [
        row(f"{COPIES} copies, {what}", seconds / samples[what] * 1e9, NS)
        for what, seconds in medians(times).items()
    ]
    several = list(jobs)[1:]
    return rows + [
        row(f"rate: {what}, against 1 copy", COPIES / ratio(times, what, "1 copy"), TIMES)
        for what in several
    ]


if __name__ == "__main__":
    main("channels", __doc__, measure, cores=None)
