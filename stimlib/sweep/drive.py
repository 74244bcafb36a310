"""From rows to jobs and back: jobs of some seconds, and what becomes of those whose process dies."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from .plan import Plan
from .store import Store
from .work import as_bytes, figures_table, from_bytes

if TYPE_CHECKING:
    import pyarrow as pa

TASK = 3.0  # s of work in one job: what a job costs beside is then below 1 %
SENT = 0.015  # s of client and scheduler for one job, one after another (benchmarks/cluster.py)
MOST_ROWS = 20_000  # of a job
DEATHS = 3  # of a process by one row alone, until the row is what is wrong


class Engine(Protocol):
    """Where jobs run."""

    def room(self) -> int:
        """How many jobs it takes now."""

    def workers(self) -> int:
        """How many run at once."""

    def submit(self, what: Any, data: bytes) -> None:
        """Give it a job."""

    def take(self) -> tuple[Any, tuple[bytes, float] | None, str]:
        """The next job that is done: its result, or why its process died."""


class Job(NamedTuple):
    """Some rows that run together."""

    rows: Any
    deaths: int = 0


def drive(plan: Plan, todo: pa.Table, store: Store, engine: Engine, row_seconds: float, advance: Callable[..., None]) -> None:
    """Jobs of some seconds that shrink towards the end, no more of them than are needed to keep all workers busy."""
    again: deque[Job] = deque()
    at = flying = 0
    while flying or again or at < todo.num_rows:
        while engine.room() and (again or at < todo.num_rows):
            if again:
                job = again.popleft()
            else:
                job = Job(todo.slice(at, job_rows(todo.num_rows - at, engine.workers(), row_seconds)))
                at += job.rows.num_rows
            engine.submit(job, as_bytes(job.rows))
            flying += 1
        job, result, death = engine.take()
        flying -= 1
        size = job.rows.num_rows
        if result is None:
            if size > 1:
                again.extend((Job(job.rows.slice(0, size // 2)), Job(job.rows.slice(size // 2))))
                continue
            if job.deaths + 1 < DEATHS:
                again.append(Job(job.rows, job.deaths + 1))
                continue
            figures = figures_table(plan, [None], [None], [f"{DEATHS} times: {death}"])
        else:
            figures, seconds = from_bytes(result[0]), result[1]
            row_seconds = 0.5 * row_seconds + 0.5 * seconds / size
        store.add(joined(plan, job.rows, figures))
        advance(size)


def job_rows(left: int, workers: int, row_seconds: float) -> int:
    """Rows of the next job: TASK seconds, less towards the end, and never so short that workers wait for the client."""
    seconds = max(SENT * workers, min(TASK, left * row_seconds / (2 * workers)))
    return max(1, min(int(seconds / row_seconds), left, MOST_ROWS))


def joined(plan: Plan, rows: pa.Table, figures: pa.Table) -> pa.Table:
    """Rows with their figures, in the columns of a part."""
    for name in figures.column_names:
        field = figures.field(name)
        rows = rows.append_column(field.with_metadata({"unit": plan.units[name]}) if name in plan.units else field, figures[name])
    return rows
