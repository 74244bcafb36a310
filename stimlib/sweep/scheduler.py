"""The scheduler of a sweep, which groups rows into jobs of an executor."""

from __future__ import annotations

import os
import queue
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from itertools import count
from uuid import uuid4

from ..errors import SinkError
from ..system.pool import TimedOut, WorkerDied
from ..system.watchdog import TICK
from .plan import Plan
from .rows import Table
from .worker import (
    Motions,
    Runner,
    as_bytes,
    figures_table,
    from_bytes,
    packed,
    pool_of,
    run_beside,
    run_job,
)

# s of work in one job: what a killed sweep can lose of finished work, besides what
# waits to be written
TASK = 1.0
SENT = 0.015  # s of client and scheduler for one job, one after another (benchmarks/cluster.py)
MOST_ROWS = 20_000  # of a job
START = 1.0  # s until a process runs its first row, at least
DEATHS = 3  # of a process by one row alone, until the row is what is wrong
QUEUED = 2  # jobs for each worker of an executor: one that runs and one that waits


class Scheduler(AbstractContextManager["Scheduler"]):
    """The rows of a sweep as jobs of an executor.

    Parameters
    ----------
    plan : Plan
    motions : Motions
    executor : Executor, optional
        By default threads of this process.
    workers : int, optional
        How many jobs the executor runs at once, and without one, how many processes
        there are at most (by default one for each core); 0 for this process itself.
    """

    def __init__(
        self,
        plan: Plan,
        motions: Motions,
        executor: Executor | None = None,
        workers: int | None = None,
    ):
        self.most = (os.cpu_count() or 1) if workers is None else max(1, workers)
        self.workers = self.most if executor else 1
        """Number of jobs that run at once."""
        self.plan, self._motions = plan, motions
        self._sweep, self._number = uuid4().hex, count()
        self._own = executor is None
        self._executor = executor or ThreadPoolExecutor(self.most)
        self._runner = Runner(plan, motions) if workers == 0 else None
        self.flying: dict[Future, tuple[Table, int, bool, float]] = {}
        self._done: queue.SimpleQueue[Future] = queue.SimpleQueue()
        if self._own and not self._runner:
            with pool_of(self._sweep, plan.limits["row_bytes"]).worker():
                pass  # it begins while the rows are compared with what is kept

    def __exit__(self, *_: object) -> None:
        for future in self.flying:
            future.cancel()
        pool_of(self._sweep).__exit__()
        if self._own:
            self._executor.shutdown()

    def widen(self, rows: int, row_seconds: float, first: float = 0.0) -> None:
        """Use more workers if they save more time than one of them takes to start.

        Parameters
        ----------
        rows : int
        row_seconds : float
            Estimated time of a row.
        first : float
            How long the first row of a worker took.
        """
        workers = min(self.most, rows)
        if rows * row_seconds * (1 - 1 / max(1, workers)) > max(START, first):
            self.workers = max(self.workers, workers)

    def drive(
        self,
        todo: Table,
        keep: Callable[[Table], None],
        row_seconds: float,
        advance: Callable[..., None],
        look: bool = False,
    ) -> None:
        """Run all rows of a sweep in jobs of about a second.

        The number of jobs at once is just enough to keep all workers busy.

        Parameters
        ----------
        todo : Table
            The rows.
        keep : callable
            Called with rows and their figures, some at a time.
        row_seconds : float
            Estimated time of a row.
        advance : callable
            Called with the number of finished rows.
        look : bool
            Only determine the content of the rows, without running them.
        """
        again: deque[tuple[Table, int]] = deque()
        at = 0
        while self.flying or again or at < todo.num_rows:
            while self.room > 0 and (again or at < todo.num_rows):
                if not again:
                    again.append(
                        (todo.slice(at, job_rows(todo.num_rows - at, self.workers, row_seconds)), 0)
                    )
                    at += again[0][0].num_rows
                # so long that no worker has to wait for the client
                self.submit(*again.popleft(), look, max(TASK, SENT * self.workers))
            rows, deaths, result = self.take()
            if isinstance(result, WorkerDied):
                parts = rows.slice(0, result.at), rows.slice(result.at + 1)
                again.extend((part, 0) for part in parts if part.num_rows)
                deaths = deaths + 1 if rows.num_rows == 1 else 1
                rows, final = rows.slice(result.at, 1), isinstance(result, TimedOut)
                if not final and deaths < DEATHS:
                    again.append((rows, deaths))
                    continue
                times = "" if final else f"{DEATHS} times: "
                figures = figures_table(
                    self.plan, [{"error": f"{times}{result}", "content": result.data}]
                )
            else:
                figures, seconds = from_bytes(result[0]), result[1]
                row_seconds = 0.5 * row_seconds + 0.5 * seconds / figures.num_rows
                if rows.num_rows > figures.num_rows:
                    again.append((rows.slice(figures.num_rows), 0))
                    rows = rows.slice(0, figures.num_rows)
            keep(joined(self.plan, rows, figures))
            advance(rows.num_rows)

    @property
    def room(self) -> int:
        """The number of jobs that can be submitted now."""
        return self.workers * (1 if self._own else QUEUED) - len(self.flying)

    def submit(
        self, rows: Table, deaths: int, look: bool, seconds: float, whole: bool = False
    ) -> None:
        """Submit a job.

        Parameters
        ----------
        rows : Table
        deaths : int
            How many processes it has ended.
        look : bool
            Only determine the content of the rows.
        seconds : float
            Time after which no other row is begun.
        whole : bool
            With plan and motions, for a process that does not have them.
        """
        data = as_bytes(rows)
        if self._runner:
            future: Future = Future()
            future.set_result(run_job(data, look, seconds, self._runner))
        else:
            named = "motion" in rows.column_names
            names = set(rows["motion"].unique().to_pylist()) if named else {""}
            motions = {name: self._motions[name] for name in names}
            given = packed((self.plan, motions)) if whole else b""
            told = self.plan.versions, self.plan.limits
            # Dask runs equal jobs once, so they have numbers
            job = next(self._number), self._sweep, *told, names, given, data, look, seconds
            with _failures_of_the_executor():
                future = self._executor.submit(run_beside, *job)
        self.flying[future] = rows, deaths, look, seconds
        future.add_done_callback(self._done.put)

    def take(self) -> tuple[Table, int, tuple[bytes, float] | WorkerDied]:
        """Return rows and deaths of a job that has ended, with its result or error."""
        while True:
            with suppress(queue.Empty):  # for Ctrl-C, which does not end a wait on Windows
                future = self._done.get(timeout=TICK)
                rows, deaths, look, seconds = self.flying.pop(future)
                with _failures_of_the_executor():
                    result = future.result()
                if isinstance(result, Exception) and not isinstance(result, WorkerDied):
                    raise result
                if result is not None:
                    return rows, deaths, result
                self.submit(rows, deaths, look, seconds, whole=True)


@contextmanager
def _failures_of_the_executor() -> Iterator[None]:
    try:
        yield
    except Exception as e:
        raise SinkError(
            f"the executor failed ({type(e).__name__}: {e}); what is done is kept where out= was"
            " given"
        ) from e


def job_rows(left: int, workers: int, row_seconds: float) -> int:
    """Return the number of rows in the next job, which decreases towards the end."""
    seconds = max(SENT * workers, min(TASK, left * row_seconds / (2 * workers)))
    return max(1, min(int(seconds / row_seconds), left, MOST_ROWS))


def joined(plan: Plan, rows: Table, figures: Table) -> Table:
    """Return rows with their figures, as the columns of a stored part."""
    for name in figures.column_names:
        field = figures.field(name)
        rows = rows.append_column(
            field.with_metadata({"unit": plan.units[name]}) if name in plan.units else field,
            figures[name],
        )
    return rows
