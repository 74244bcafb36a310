"""How cost grows: processor time against blocks, channels, duration, sample rate, block
size, rows of a sweep and participants, with the exponent of each.

    python benchmarks/growth.py             print
    python benchmarks/growth.py --record    and keep the figures

They are kept in results/growth.csv; recording also writes docs/explanation/cost.csv and
the picture docs/pictures/cost.svg.
"""

from __future__ import annotations

import csv
import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from bench import Job, Row, options, row, save
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from timing import interleaved, machine, medians

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import first_order
from stimlib.experiments.fits import psychometrics
from stimlib.motion.generators import minimum_jerk, sinusoid
from stimlib.scenes import squeeze
from stimlib.sweep import grid
from stimlib.sweep.rows import table_of
from stimlib.sweep.study import planned
from stimlib.sweep.worker import Runner

DOCS = Path(__file__).parents[1] / "docs"
FS, SAMPLES, ROUNDS, FITTED = 8000, 1 << 14, 3, 3
HAND = sinusoid(0.02, 1.0)


class Axis(NamedTuple):
    """Something that grows, and what is timed for each size of it."""

    name: str
    timed: str
    sizes: tuple[int, ...]
    job: Callable[[int], Job]
    unit: str = ""


def chain(n: int) -> Job:
    """Compile a chain of n filters, each with a time constant of its own."""
    y: Any = Input("x")
    for k in range(n):
        y = first_order(y, 1e-3 + 1e-6 * k)
    scene = Scene({"y": y})
    return lambda: stimlib.compile(scene, FS)


def fingers(n: int, fs: int = FS, samples: int = SAMPLES, block: int = SAMPLES) -> Job:
    """Run squeezes of n fingers."""
    proc = stimlib.compile(squeeze(fingers=n), fs)
    x = np.tile(HAND(np.arange(block) / fs), (n, 1))
    out = np.empty_like(x)

    def job() -> None:
        for _ in range(samples // block):
            proc.process(x, out)

    return job


def second(fs: int) -> Job:
    """Run a second of one finger's squeeze at a sample rate."""
    return fingers(1, fs, fs, fs)


def blocks_of(n: int) -> Job:
    """Run one finger's squeeze in blocks of n samples."""
    return fingers(1, block=n)


def rendered(seconds: int) -> Job:
    """Render one finger's squeeze."""
    scene = squeeze(fingers=1)
    return lambda: stimlib.render(scene, {"x1": HAND}, FS, seconds)


def verified(seconds: int) -> Job:
    """Verify a rendering of one finger's squeeze."""
    scene, motion = squeeze(fingers=1), {"x1": HAND}
    made = stimlib.render(scene, motion, FS, seconds)
    return lambda: stimlib.verify(scene, motion, made)


def swept(rows: int) -> Job:
    """Run rows of a sweep of 0.5 s in this process."""
    words = {"motion": minimum_jerk(), "measures": ["rms", "peak"], "fs": FS, "seconds": 0.5}
    table, plan, motions, *_ = planned(
        squeeze(fingers=1), table_of(grid(seed=range(rows))), words | {"live": None, "kept": True}
    )
    return functools.partial(Runner(plan, motions).run, table.to_pylist())


def fitted(participants: int) -> Job:
    """Fit psychometric functions of participants, with profile intervals."""
    levels, rng = np.linspace(-2, 2, 9), np.random.default_rng(1)
    yes = rng.binomial(20, 1 / (1 + np.exp(-2 * levels)), (participants, levels.size))
    data = {k: (levels, y, np.full(levels.size, 20)) for k, y in enumerate(yes)}
    return lambda: psychometrics(data)


AXES = (
    Axis("blocks", "compile a chain of filters", (100, 300, 1000, 3000), chain),
    Axis("channels", "run squeezes for 2 s", (1, 4, 16, 64, 256), fingers),
    Axis("duration", "render a squeeze", (4, 16, 64, 256, 1024), rendered, "s"),
    Axis("duration, verified", "verify a squeeze", (4, 16, 64, 256), verified, "s"),
    Axis("sample rate", "run a squeeze for 1 s", (8000, 24000, 48000, 96000, 192000), second, "Hz"),
    Axis("block size", "run a squeeze for 2 s", (1, 4, 16, 64, 256, 1024), blocks_of),
    Axis("rows", "run rows of a sweep", (10, 30, 100, 300), swept),
    Axis("participants", "fit psychometric functions", (16, 64, 256), fitted),
)


def exponent(sizes: np.ndarray, seconds: np.ndarray) -> float:
    """Return the slope of log time over log size at the largest sizes."""
    return float(np.polyfit(np.log(sizes[-FITTED:]), np.log(seconds[-FITTED:]), 1)[0])


def measured(axis: Axis) -> np.ndarray:
    """Return the median processor time for each size, in s."""
    jobs = {str(n): axis.job(n) for n in axis.sizes}
    found = medians(interleaved(jobs, ROUNDS, 1, time.process_time))
    return np.array([found[str(n)] for n in axis.sizes])


def drawn(found: dict[str, np.ndarray]) -> None:
    """Draw a panel for each axis."""
    with rc_context({"svg.hashsalt": "stimlib", "svg.fonttype": "none", "font.size": 9}):
        fig = Figure(figsize=(11, 5.5), layout="constrained")
        for ax, axis in zip(fig.subplots(2, 4).flat, AXES, strict=True):
            seconds = found[axis.name]
            sizes = np.array(axis.sizes, float)
            ax.loglog(sizes, seconds, "o-", ms=4)
            linear = seconds[-1] * (sizes / sizes[-1])
            if exponent(sizes, seconds) > 0.1:
                ax.loglog(sizes, linear, ":", color="gray", label="in proportion")
                ax.legend(frameon=False)
            ax.set_title(f"{axis.timed}\nexponent {exponent(sizes, seconds):.2f}", fontsize=9)
            ax.set(xlabel=f"{axis.name}{f' / {axis.unit}' * bool(axis.unit)}")
            ax.set_ylabel("processor time / s")
            ax.grid(alpha=0.3)
            for one in (ax.xaxis, ax.yaxis):
                one.set_minor_formatter(NullFormatter())
        meta = {"Date": None, "Creator": None}
        fig.savefig(DOCS / "pictures" / "cost.svg", format="svg", metadata=meta)


def main() -> None:
    """Measure, print and keep."""
    given = options(__doc__).parse_args()
    found = {axis.name: measured(axis) for axis in AXES}
    rows: list[Row] = [row(machine())]
    table = []
    for axis in AXES:
        seconds = found[axis.name]
        slope = exponent(np.array(axis.sizes, float), seconds)
        for size, each in zip(axis.sizes, seconds, strict=True):
            what = f"{axis.name} {size}{f' {axis.unit}' * bool(axis.unit)}: {axis.timed}"
            rows.append(row(what, float(each), "s"))
        rows.append(row(f"{axis.name}: exponent", slope, "-"))
        ends = f"{axis.sizes[0]} to {axis.sizes[-1]} {axis.unit}".strip()
        each = f"{seconds[0]:.2g} to {seconds[-1]:.2g}"
        table.append([axis.name, axis.timed, ends, each, f"{slope:.2f}"])
    save("growth", rows, given.record)
    if given.record:
        drawn(found)
        with (DOCS / "explanation" / "cost.csv").open("w", newline="") as f:
            csv.writer(f, lineterminator="\n").writerows(table)


if __name__ == "__main__":
    main()
