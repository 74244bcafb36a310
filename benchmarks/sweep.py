"""A row of a sweep against `render` in a loop: the two-finger squeeze, 3 s a row, rms
and peak of each; and what keeps rows.

python benchmarks/sweep.py             print
python benchmarks/sweep.py --record    and keep the figures in results/sweep.csv
"""

from __future__ import annotations

import os
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from bench import TIMES, Row, main, row
from timing import interleaved, medians, ratio

import stimlib
from stimlib.motion.generators import minimum_jerk
from stimlib.scenes import squeeze
from stimlib.sweep import grid, sweep
from stimlib.sweep.keys import row_keys
from stimlib.sweep.rows import table_of
from stimlib.sweep.scheduler import Scheduler, joined
from stimlib.sweep.store import LARGEST, Store
from stimlib.sweep.study import planned
from stimlib.sweep.worker import Runner, figures_table

MS = "ms/row"
HAND = minimum_jerk(depth=0.02)
WORDS: dict[str, Any] = {"motion": HAND, "measures": ["rms", "peak"], "fs": 8000, "seconds": 3.0}
PLANNED = {**WORDS, "live": None, "kept": True}
FEW = grid(seed=[1, 2], k=np.linspace(500, 3000, 5), A=np.linspace(1, 4, 5))


def rendered(scene: stimlib.Scene) -> list[tuple[float, float]]:
    """What somebody writes without a sweep."""
    figures = []
    for seed, k, A in zip(*FEW.values(), strict=True):
        run = stimlib.render(
            scene, {"x1": HAND, "x2": HAND}, 8000, 3.0, {"k": k, "A": A}, seed=int(seed)
        )
        figures += [(float(np.sqrt(np.mean(y**2))), float(np.abs(y).max())) for y in run.y]
    return figures


def processes(plan: Any, motions: Any, todo: Any, workers: int, row_seconds: float) -> float:
    """Rows a second of so many processes, once they have begun."""
    kept: list[Any] = []
    with Scheduler(plan, motions, workers=workers) as scheduler:
        scheduler.workers = workers
        scheduler.drive(todo.slice(0, 100 * workers), kept.append, row_seconds, lambda done: None)
        began = time.perf_counter()
        scheduler.drive(todo, kept.append, row_seconds, lambda done: None)
        return todo.num_rows / (time.perf_counter() - began)


def measure() -> list[Row]:
    """All rows."""
    scene = squeeze()
    table, plan, motions, *_ = planned(scene, table_of(FEW), PLANNED)
    rows, runner, n = table.to_pylist(), Runner(plan, motions), table.num_rows
    times = interleaved(
        {"render in a loop": partial(rendered, scene), "sweep": partial(runner.run, rows)}, 9
    )
    found = [
        row(f"one core, {what}", 1e3 * seconds / n, MS) for what, seconds in medians(times).items()
    ]
    found.append(
        row("ratio: render in a loop / sweep", ratio(times, "render in a loop", "sweep"), TIMES)
    )
    many, plan, motions, *_ = planned(
        scene, table_of(grid(seed=range(80), k=np.linspace(500, 3000, 50))), PLANNED
    )
    todo = many.append_column(
        "key", row_keys(plan, many, {name: digest for name, (digest, _) in motions.items()})
    )
    each = medians(times)["sweep"] / n
    cores = min(2, os.cpu_count() or 1)
    speeds = [[processes(plan, motions, todo, w, each) for w in (1, cores)] for _ in range(3)]
    one, several = (float(np.median([s[k] for s in speeds])) for k in (0, 1))
    found += [row("1 process", 1e3 / one, MS), row(f"{cores} processes", 1e3 / several, MS)]
    found.append(
        row(
            f"rate: {cores} processes / 1 process",
            float(np.median([b / a for a, b in speeds])),
            TIMES,
        )
    )
    return [*found, *a_million(scene), *scenes()]


def a_million(scene: stimlib.Scene) -> list[Row]:
    """Rows that are planned, and rows that are all there, in a folder of figures that
    somebody else made (here: drawn).
    """
    rows = grid(seed=range(4000), k=np.linspace(500, 3000, 250))
    began = time.perf_counter()
    sweep(scene, rows, **WORDS, dry=True)
    planning = time.perf_counter() - began
    table, plan, motions, facts, about, _ = planned(scene, table_of(rows), PLANNED)
    drawn = np.random.default_rng(0).normal(size=(len(plan.units), table.num_rows))
    # one scene and one motion for all
    content = Runner(plan, motions).content(table.slice(0, 1).to_pylist()[0])
    figures = figures_table(
        plan,
        [
            dict(zip(plan.units, values, strict=True), content=content)
            for values in drawn.T.tolist()
        ],
    )
    keyed = table.append_column(
        "key", row_keys(plan, table, {name: digest for name, (digest, _) in motions.items()})
    )
    with tempfile.TemporaryDirectory() as folder:
        with Store(Path(folder), facts, about) as store:
            for at in range(0, table.num_rows, LARGEST):
                store.add(joined(plan, keyed.slice(at, LARGEST), figures.slice(at, LARGEST)))
        began = time.perf_counter()
        again = sweep(scene, rows, **WORDS, out=folder)
        resuming = time.perf_counter() - began
    assert np.array_equal(again.column(table.num_columns), drawn[0])
    return [row("1e6 rows, planned", planning, "s"), row("1e6 rows, resumed", resuming, "s")]


def scenes() -> list[Row]:
    """Return what it costs to compare kept rows, each of a scene of its own, with
    today's.
    """
    rows = {"k": np.linspace(500, 3000, 2000), "seed": np.arange(2000)}
    words = {**WORDS, "seconds": 0.01, "live": [], "progress": False}
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        sweep(squeeze, rows, **words, out=folder)
        running = time.perf_counter() - began
        began = time.perf_counter()
        sweep(squeeze, rows, **words, out=folder)
        again = time.perf_counter() - began
    cores = min(2, os.cpu_count() or 1)
    return [
        row(f"a scene for each row, run (10 ms), {cores} processes", 1e3 * running / 2000, MS),
        row(
            f"a scene for each row, compared with what is kept, {cores} processes",
            1e3 * again / 2000,
            MS,
        ),
    ]


if __name__ == "__main__":
    main("sweep", __doc__, measure, cores=None)
