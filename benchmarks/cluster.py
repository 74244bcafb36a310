"""What a job costs on a Dask cluster beside its rows, and by that the schedule of a
million rows on a thousand workers.

python benchmarks/cluster.py             print
python benchmarks/cluster.py --record    and keep the figures in results/cluster.csv

Costs are processor seconds, which others on the machine change less than the clock: of
this process, which is client and scheduler, and of the two workers.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from heapq import heappop, heappush
from typing import Any

import numpy as np
from bench import Row, main, row

from stimlib.motion.generators import minimum_jerk
from stimlib.scenes import squeeze
from stimlib.sweep import grid
from stimlib.sweep.keys import row_keys
from stimlib.sweep.rows import table_of
from stimlib.sweep.scheduler import QUEUED, Scheduler, job_rows, joined
from stimlib.sweep.store import Store
from stimlib.sweep.study import planned
from stimlib.sweep.worker import from_bytes

ROWS, WORKERS = 1_000_000, 1000
FEW, MANY = 1, 41  # rows of a job


def simulated(
    rows: int,
    workers: int,
    row_seconds: float,
    central: float,
    beside: float,
    *,
    arrive: float = 0.0,
    cold: float = 0.0,
) -> tuple[float, int]:
    """Return seconds and jobs of a sweep cut as `stimlib.sweep.scheduler` cuts it,
    where client and scheduler do one thing at a time.

    Parameters
    ----------
    rows, workers : int
    row_seconds : float
        Of a row, in s.
    central : float
        Of client and scheduler for a job, in s: half when it is sent, half when it is
        taken.
    beside : float
        Of the worker for a job beside its rows, in s.
    arrive : float
        Workers come one after another over so many s.
    cold : float
        Each compiles for so many s before its first row.

    Examples
    --------
    >>> simulated(1000, 10, 1.0, 0.0, 0.0)
    (100.0, 320)
    """
    # when each worker has done what it was sent; a heap
    free = [(arrive * w / workers + cold) for w in range(workers)]
    flying: list[float] = []  # ends of jobs
    clock, at, jobs = 0.0, 0, 0
    while at < rows or flying:
        if at < rows and len(flying) < QUEUED * workers:
            n = job_rows(rows - at, workers, row_seconds)
            clock += central / 2
            end = max(heappop(free), clock) + beside + n * row_seconds
            heappush(free, end)
            heappush(flying, end)
            at, jobs = at + n, jobs + 1
        else:
            clock = max(clock, heappop(flying)) + central / 2
    return clock, jobs


def nothing(k: int) -> int:
    return k


class Costs:
    """Processor seconds a job of this process and of the workers, over many jobs."""

    def __init__(self, client: Any):
        self._client = client

    def of(self, work: Callable[[], int]) -> tuple[float, float]:
        """Of client and scheduler, and of the workers, for each job that ``work``
        did.
        """
        here, there = time.process_time(), self._workers()
        jobs = work()
        return (time.process_time() - here) / jobs, (self._workers() - there) / jobs

    def _workers(self) -> float:
        return sum(self._client.run(time.process_time).values())


def parts(scheduler: Scheduler, store: Store, todo: Any, size: int, jobs: int) -> int:
    """Jobs of so many rows, as a sweep sends and keeps them."""
    sent = done = 0
    while done < jobs:
        while sent < jobs and scheduler.room > 0:
            scheduler.submit(todo.slice(sent * size, size), 0, False, 1e9)
            sent += 1
        rows, _, result = scheduler.take()
        assert isinstance(result, tuple)
        store.add(joined(scheduler.plan, rows, from_bytes(result[0])))
        done += 1
    return jobs


def measured(client: Any) -> dict[str, float]:
    """Seconds: of a task that does nothing and of a job, in client and scheduler and in
    a worker; and of a row.
    """
    words: Any = {
        "motion": minimum_jerk(depth=0.02),
        "measures": ["rms", "peak"],
        "fs": 8000,
        "seconds": 3.0,
    }
    words |= {"live": None, "kept": False}
    table, plan, motions, *_ = planned(
        squeeze(), table_of(grid(seed=range(20), k=np.linspace(500, 3000, 400))), words
    )
    todo = table.append_column(
        "key", row_keys(plan, table, {name: digest for name, (digest, _) in motions.items()})
    )
    costs = Costs(client)

    def no_ops() -> int:
        return len(client.gather([client.submit(nothing, k, pure=False) for k in range(1000)]))

    no_ops()
    found = {}
    found["no-op, client and scheduler"], found["no-op, worker"] = np.min(
        [costs.of(no_ops) for _ in range(3)], axis=0
    )
    with (
        Store(None, {}, {}) as store,
        Scheduler(plan, motions, client.get_executor(), workers=2) as scheduler,
    ):
        parts(scheduler, store, todo, MANY, 4)  # compiles
        rounds = [
            [costs.of(lambda n=n: parts(scheduler, store, todo, n, 100)) for n in (FEW, MANY)]
            for _ in range(3)
        ]
    (few, alone), (many, together) = np.min(rounds, axis=0)
    found["row"] = (together - alone) / (MANY - FEW)
    return found | {
        "job, client and scheduler": max(few, many),
        "job, worker": alone - FEW * found["row"],
    }


def measure() -> list[Row]:
    """All rows."""
    from dask.distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        found = measured(client)
    rows = [row(f"processor time: {name}", 1e3 * seconds, "ms") for name, seconds in found.items()]
    central, beside = found["job, client and scheduler"], found["job, worker"]
    for row_seconds in (found["row"], 0.01, 0.05, 0.2, 1.0):
        for words in ({}, {"arrive": 20.0}, {"cold": 10.0}):
            seconds, jobs = simulated(ROWS, WORKERS, row_seconds, central, beside, **words)
            name = f"1e6 rows of {1e3 * row_seconds:.3g} ms, 1000 workers" + "".join(
                f", {w} {v:g} s" for w, v in words.items()
            )
            share = 100 * ROWS * row_seconds / WORKERS / seconds
            rows += [
                row(f"simulated, {name}: {jobs} jobs", seconds, "s"),
                row("    of their time in rows", share, "%"),
            ]
    return rows


if __name__ == "__main__":
    main("cluster", __doc__, measure, cores=None)
