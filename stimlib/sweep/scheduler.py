"""The scheduler of a sweep, which groups rows into jobs and handles dead workers."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from .plan import Plan
from .worker import as_bytes, figures_table, from_bytes

if TYPE_CHECKING:
    import pyarrow as pa

# s of work in one job: what a killed sweep can lose of finished work, besides what
# waits to be written
TASK = 1.0
SENT = 0.015  # s of client and scheduler for one job, one after another (benchmarks/cluster.py)
MOST_ROWS = 20_000  # of a job
START = 2.0  # s until a process runs its first row, if none has yet
DEATHS = 3  # of a process by one row alone, until the row is what is wrong


class Death(NamedTuple):
    """The death of a process in the middle of a job."""

    why: str
    at: int
    """Number of the row that was running."""
    content: bytes
    """Content of that row, if known."""
    final: bool
    """Whether the row must not run again because it exceeded a limit."""


class Engine(Protocol):
    """A place where jobs run."""

    def room(self) -> int:
        """Return how many jobs the engine can accept now."""

    def workers(self) -> int:
        """Return how many jobs the engine runs at once."""

    def start_seconds(self) -> float:
        """Return how long a worker took to begin, or 0 if that is not known."""

    def widen(self, workers: int) -> None:
        """Use a number of workers, each as soon as it has begun."""

    def submit(self, what: Any, data: bytes, look: bool, seconds: float) -> None:
        """Submit a job."""

    def take(self) -> tuple[Any, tuple[bytes, float] | Death]:
        """Return the next finished job, with its result or the death of its process."""


class Job(NamedTuple):
    """A group of rows that run together."""

    rows: Any
    deaths: int = 0


def drive(
    plan: Plan,
    todo: pa.Table,
    engine: Engine,
    keep: Callable[[pa.Table], None],
    row_seconds: float,
    advance: Callable[..., None],
    look: bool = False,
) -> None:
    """Run all rows of a sweep in jobs of about a second.

    The number of jobs at once is just enough to keep all workers busy.

    Parameters
    ----------
    plan : Plan
    todo : Table
        The rows.
    engine : Engine
    keep : callable
        Called with rows and their figures, some at a time.
    row_seconds : float
        Estimated time of a row.
    advance : callable
        Called with the number of finished rows.
    look : bool
        Only determine the content of the rows, without running them.
    """
    again: deque[Job] = deque()
    at = flying = 0
    while flying or again or at < todo.num_rows:
        while engine.room() and (again or at < todo.num_rows):
            if again:
                job = again.popleft()
            else:
                job = Job(
                    todo.slice(at, job_rows(todo.num_rows - at, engine.workers(), row_seconds))
                )
                at += job.rows.num_rows
            engine.submit(job, as_bytes(job.rows), look, job_seconds(engine.workers()))
            flying += 1
        job, result = engine.take()
        flying -= 1
        rows = job.rows
        if isinstance(result, Death):
            alone = Job(rows.slice(result.at, 1), job.deaths + 1 if rows.num_rows == 1 else 1)
            parts = rows.slice(0, result.at), rows.slice(result.at + 1)
            again.extend(Job(part) for part in parts if part.num_rows)
            if not result.final and alone.deaths < DEATHS:
                again.append(alone)
                continue
            times = "" if result.final else f"{DEATHS} times: "
            figures = figures_table(
                plan, [{"error": times + result.why, "content": result.content}]
            )
            rows = alone.rows
        else:
            figures, seconds = from_bytes(result[0]), result[1]
            row_seconds = 0.5 * row_seconds + 0.5 * seconds / figures.num_rows
            if rest := rows.num_rows - figures.num_rows:
                again.append(Job(rows.slice(figures.num_rows)))
                rows = rows.slice(0, rows.num_rows - rest)
        keep(joined(plan, rows, figures))
        advance(rows.num_rows)


def widen(
    engine: Engine, workers: int | None, rows: int, row_seconds: float, first: float = 0.0
) -> None:
    """Start more workers if they save more time than one of them takes to start.

    The worker that has begun goes on meanwhile.

    Parameters
    ----------
    engine : Engine
    workers : int or None
        Most workers; None for one a core.
    rows : int
    row_seconds : float
        Estimated time of a row.
    first : float
        How long the first row of a worker took.
    """
    workers = min(workers or os.cpu_count() or 1, rows)
    start = max(engine.start_seconds() or START, first)
    if rows * row_seconds * (1 - 1 / max(1, workers)) > start:
        engine.widen(workers)


def job_seconds(workers: int) -> float:
    """Return how long a job runs before it returns its results.

    It is long enough that no worker has to wait for the client.
    """
    return max(TASK, SENT * workers)


def job_rows(left: int, workers: int, row_seconds: float) -> int:
    """Return the number of rows in the next job, which decreases towards the end."""
    seconds = max(SENT * workers, min(TASK, left * row_seconds / (2 * workers)))
    return max(1, min(int(seconds / row_seconds), left, MOST_ROWS))


def joined(plan: Plan, rows: pa.Table, figures: pa.Table) -> pa.Table:
    """Return rows with their figures, as the columns of a stored part."""
    for name in figures.column_names:
        field = figures.field(name)
        rows = rows.append_column(
            field.with_metadata({"unit": plan.units[name]}) if name in plan.units else field,
            figures[name],
        )
    return rows
