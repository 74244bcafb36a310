"""Many copies of a scene, each with its own seed and parameters: the one-finger
squeeze, 64 times.  And one scene of many equal channels: a block in each.

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
from stimlib import blocks
from stimlib.core.graph import Block
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
    rows += [
        row(f"rate: {what}, against 1 copy", COPIES / ratio(times, what, "1 copy"), TIMES)
        for what in several
    ]
    return rows + [row(what, seconds * 1e9, NS) for what, seconds in channels()]


BLOCKS: dict[str, Callable[[Block, int], Block]] = {
    "input to output": lambda x, k: x,
    "lowpass, order 2": lambda x, k: blocks.lowpass(x, 100.0 + k, 2),
    "lowpass, order 4": lambda x, k: blocks.lowpass(x, 100.0 + k, 4),
    "lowpass, order 8": lambda x, k: blocks.lowpass(x, 100.0 + k, 8),
    "first_order": lambda x, k: blocks.first_order(x, 1e-3 + 1e-6 * k),
    "velocity": lambda x, k: blocks.velocity(x, cutoff=100.0 + k),
    "oscillator": lambda x, k: x * blocks.oscillator(250.0 + k),
}


def channels() -> Iterable[tuple[str, float]]:
    """Seconds a sample and channel, of one block in each of some channels."""
    for name, make in BLOCKS.items():
        jobs, cost = {}, {}
        for n in (1, 8, 64, 1000):
            scene = stimlib.Scene({f"y{k}": make(stimlib.Input(f"x{k}"), k) for k in range(n)})
            x = np.random.default_rng(n).standard_normal((n, max(256, SAMPLES // n)))
            what = f"{name}, a channel of {n}"
            jobs[what] = partial(stimlib.compile(scene, FS).process, x, np.empty(x.shape))
            cost[what] = x.size
        for what, seconds in medians(interleaved(jobs)).items():
            yield what, seconds / cost[what]


if __name__ == "__main__":
    main("channels", __doc__, measure, cores=None)
