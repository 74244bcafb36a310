"""Many copies of a scene, each with its own seed and parameters: the one-finger squeeze, 64 times.

python benchmarks/channels.py             print
python benchmarks/channels.py --record    and keep the figures in results/channels.csv
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from bench import NS, TIMES, Row, main, row

import stimlib
from stimlib.run.processor import Processor
from stimlib.scenes import squeeze
from stimlib.speed.chain import FS, movements
from stimlib.speed.timing import interleaved, medians, ratio

COPIES, SAMPLES = 64, 1 << 14


def copies(many: int) -> list[Processor]:
    """Processors of one scene that differ in seed, stiffness and gain."""
    made = [stimlib.compile(squeeze(fingers=1), FS, seed=i) for i in range(many)]
    for proc, k, A in zip(made, np.linspace(500, 3000, many), np.linspace(0.5, 4.0, many), strict=True):
        proc.set("k", k, ramp=0.0)
        proc.set("A", A, ramp=0.0)
    return made


def one_after_another(procs: list[Processor], x: np.ndarray, out: np.ndarray) -> Callable[[], None]:
    """A call of ``process`` for each."""

    def job() -> None:
        for proc, y in zip(procs, out, strict=True):
            proc.process(x, y)

    return job


WAYS = {"one after another": one_after_another}  # a way to run all in one call comes here


def measure() -> list[Row]:
    """All rows."""
    x = movements(SAMPLES)["gate open"][None]
    one = {"1 copy": one_after_another(copies(1), x, np.empty((1, 1, SAMPLES)))}
    many = {f"{COPIES} copies, {way}": f(copies(COPIES), x, np.empty((COPIES, 1, SAMPLES))) for way, f in WAYS.items()}
    times = interleaved(one | many)
    samples = dict.fromkeys(one, SAMPLES) | dict.fromkeys(many, COPIES * SAMPLES)
    rows = [row(what, seconds / samples[what] * 1e9, NS) for what, seconds in medians(times).items()]
    return rows + [row(f"rate: {what}, against 1 copy", COPIES / ratio(times, what, "1 copy"), TIMES) for what in many]


if __name__ == "__main__":
    main("channels", __doc__, measure, cores=None)
