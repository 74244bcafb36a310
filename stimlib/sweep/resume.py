"""The rows of a sweep that are stored, that are still valid, and that are to be run."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import BadValue
from ..system.progress import progress as bar
from .plan import Plan
from .rows import Table, arrow
from .scheduler import Scheduler

LOOK_SECONDS = 0.003  # for making a scene, to compare it with one that was run


def places(keyed: Table, done: Table) -> Any:
    """Return the index of each row among the finished rows, or null.

    Parameters
    ----------
    keyed, done : Table
        All rows and the finished ones, with a column ``key``.
    """
    return arrow("pyarrow.compute").index_in(
        keyed["key"].combine_chunks(), value_set=done["key"].combine_chunks()
    )


def missing(keyed: Table, done: Table, retry: bool) -> Table:
    """Return the rows that have not run, each once; with ``retry``, failed ones too."""
    pa, pc = arrow(), arrow("pyarrow.compute")
    at = places(keyed, done)
    if retry:
        failed = pc.is_valid(done["error"].take(at)).combine_chunks()
        at = pc.if_else(failed, None, at)
    if at.null_count < keyed.num_rows:
        keyed = keyed.filter(pc.is_null(at))
    if not keyed.num_rows:
        return keyed
    codes = keyed["key"].combine_chunks().dictionary_encode()
    if len(codes.dictionary) == keyed.num_rows:
        return keyed
    _, first = np.unique(codes.indices.to_numpy(), return_index=True)
    return keyed.take(pa.array(np.sort(first)))


def confirmed(plan: Plan, keyed: Table, done: Table, scheduler: Scheduler, progress: bool) -> Table:
    """Return the finished rows that are still valid.

    Rows that failed with a scene or motion that has changed since are left out. The
    scene of every stored row is made again, once for each combination of arguments and
    motion, and compared with the one that was run.

    Raises
    ------
    BadValue
        A row has figures of another scene or motion than those of today.
    """
    pa, pc = arrow(), arrow("pyarrow.compute")
    at = places(keyed, done)
    there = keyed.filter(pc.is_valid(at))
    if not there.num_rows:
        return done
    first, which = _combinations(there, [*plan.roles.arguments, "motion"])
    rows = there.take(pa.array(first)).append_column("at", pa.array(np.arange(first.size)))
    scheduler.widen(first.size, LOOK_SECONDS)
    looked: list[Any] = []
    with bar("checking what is kept", first.size, progress) as advance:
        scheduler.drive(rows, looked.append, LOOK_SECONDS, advance, look=True)
    made = pa.concat_tables(looked).sort_by("at")
    now = made["content"].combine_chunks().take(pa.array(which))
    stored = done.take(at.drop_null())
    other = np.asarray(pc.not_equal(now, stored["content"].combine_chunks()))
    failed = np.asarray(pc.is_valid(stored["error"]).combine_chunks())
    changed = np.flatnonzero(other & ~failed)
    if changed.size:
        row = np.flatnonzero(np.asarray(pc.is_valid(at)))[changed[0]]
        why = made["error"][int(which[changed[0]])].as_py()
        raise BadValue(
            f"row {row} (the first is 0) is kept with the figures of another scene or motion than"
            f" those of today{f' ({why})' if why else ''}: a function, a block or a file has"
            " changed since; name another folder"
        )
    outdated = there["key"].combine_chunks().filter(pa.array(other))
    return done.filter(pc.invert(pc.is_in(done["key"], value_set=outdated)))


def _combinations(table: Table, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the first row of each combination of values, and the one of each row."""
    codes = np.zeros(table.num_rows, np.int64)
    for name in names:
        if name in table.column_names:
            column = table[name].combine_chunks().dictionary_encode().indices.to_numpy()
            codes = np.unique(codes * (column.max() + 1) + column, return_inverse=True)[1]
    _, first, which = np.unique(codes, return_index=True, return_inverse=True)
    return first, which
