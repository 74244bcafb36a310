"""The course of a sweep, from the call to the resulting table."""

from __future__ import annotations

import dataclasses as dc
import json
import os
import pickle
import time
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np

from .. import errors
from ..core.program import rate, warn_beyond
from ..core.scene import Scene
from ..errors import BadValue, SceneError, counted, outside, public
from ..motion.source import sources_of, warn_fast
from ..run.rendering import Rendering
from ..system.limits import limits
from ..system.pool import Pool, WorkerDied, ended, note, terminable
from ..system.progress import progress as bar
from .keys import code_keys, measure_keys, motion_digest, row_keys, shared_key, versions
from .measures import NAMED, Measure, measures_of
from .plan import Plan, frames, in_order, motion_of
from .resume import confirmed, missing, places
from .rows import MADE, OWN, Table, arguments_of, arrow, checked, name_of, roles_of, table_of
from .scheduler import Scheduler, joined
from .store import Store
from .worker import Motions, Runner, as_bytes, error_text, from_bytes, packed


class Forecast(NamedTuple):
    """An estimate of the time and memory of a sweep, from a few of its rows."""

    rows: int
    there: int
    """Number of rows already in the folder."""
    row_seconds: float
    """Seconds per row on one core."""
    samples: int
    """Samples per row."""
    memory: float
    """Memory of all figures in bytes."""

    def hours(self, workers: int) -> float:
        """Return the hours that a number of otherwise idle cores of this kind need."""
        return (self.rows - self.there) * self.row_seconds / workers / 3600

    def __str__(self) -> str:
        cores = sorted({1, 2, 4, 8, 16, 64, os.cpu_count() or 1})
        lines = [
            f"{counted(self.rows, 'row')}, {self.there} of them there;"
            f" {1000 * self.row_seconds:.3g} ms a row"
            f" of {counted(self.samples, 'sample')}; {self.memory / 1e6:.3g} MB of figures"
        ]
        return "\n".join(
            lines
            + [
                f"{n:5d} {'core: ' if n == 1 else 'cores:'} {_time(3600 * self.hours(n))}"
                for n in cores
            ]
        )


def _time(seconds: float) -> str:
    for longest, unit_, size in ((100, "s", 1), (6000, "min", 60)):
        if seconds < longest:
            return f"{seconds / size:.3g} {unit_}"
    return f"{seconds / 3600:.3g} h"


@public
def sweep(
    make: Scene | Callable[..., Scene],
    rows: Any,
    *,
    motion: Any = None,
    measures: Sequence[str | Measure] | str | Measure,
    fs: float,
    seconds: float | None = None,
    live: Collection[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    executor: Executor | None = None,
    workers: int | None = None,
    retry: bool = False,
    dry: bool = False,
    progress: bool = True,
) -> Table | Forecast:
    """Run a scene for every row of a table, and keep a few figures of each rendering.

    A row that fails keeps its error, and the others continue.  With ``out``, finished
    rows are stored: calling a stopped or killed sweep again resumes it, and a sweep
    with additional rows runs only those.  The figures of a row have the same bits for
    any other rows, order, number of workers or executor; a different type of processor
    may round differently.

    All rows run in separate processes.  A row that takes longer than
    ``stimlib.limits.row_seconds``, needs more memory than ``row_bytes``, or crashes its
    process, fails with that error.

    Parameters
    ----------
    make : Scene or callable
        The scene, or a function that makes one if rows change its arguments.
    rows : mapping of str to sequence, table, or path
        ``grid(..)``, columns by name, a table of Arrow, pandas or polars, a CSV or
        Parquet file.  The column ``seed`` is the seed of the noise (default 0), and
        ``motion`` the name of a motion; all others are parameters or arguments.
    motion : motion, Recording or dict, optional
        As for ``render``: a function of time or samples for each input.  A single
        function, array or recording applies to all inputs.  If the rows have a column
        ``motion``, a dict of such motions by name.  A scene without inputs needs no
        motion.
    measures : str, Measure or sequence of them
        Names, such as ``"rms"``, ``"band(20, 1000)"``, ``"peak(force1)"``, ``"psd"``,
        ``"cues"``, ``"verify"`` (``stimlib.sweep.measures.NAMED``), and your own
        functions of a rendering with ``@measure``.
    fs : float
        Sample rate in Hz.
    seconds : float, optional
        Length of a run; by default that of its recording or array.
    live : collection of str, optional
        If ``make`` is a function: columns that are parameters, not arguments. Required
        if a name is both.
    out : path, optional
        Folder for the figures, as Parquet.
    executor : concurrent.futures.Executor, optional
        Where to run, such as ``client.get_executor()`` of a Dask cluster; by default on
        this machine.
    workers : int, optional
        Number of processes on this machine; by default one per core, or a single one if
        the work takes only seconds.  With 0, the rows run in this process, where a
        debugger can follow, without limits and without protection from crashes.
        Required with ``executor``: how many jobs that runs at once.
    retry : bool
        Run rows that failed before again.
    dry : bool
        Run a few rows only, and estimate what all rows will take.
    progress : bool
        A progress bar on stderr, if that is a terminal.

    Returns
    -------
    pyarrow.Table, or Forecast
        The rows in their order, with a column of float64 for each figure (null if the
        row failed), ``fault`` (output and sample at which a rendering became NaN or
        infinite, or null) and ``error`` (or null).  The field metadata has units.

    Raises
    ------
    UnknownName, BadValue, UnitError, SceneError
        Rows, motion, measures or scene are invalid, which is found before the first
        run; the first, the middle and the last row have the same error; versions of a
        worker differ from those here; the folder has figures of another scene, motion
        or version; or, with ``out``, a measure uses something whose content cannot be
        inspected.
    SinkError
        The folder cannot be written or contains something else, or the executor failed.
    MissingPackage
        pyarrow is not installed: ``pip install 'stimlib[sweep]'``.
    KeyboardInterrupt
        On Ctrl-C; the message has the number of finished rows.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.motion import minimum_jerk
    >>> from stimlib.scenes import squeeze
    >>> from stimlib.sweep import grid, sweep
    >>> rows = grid(A=[0.0, 3.4], seed=range(3))
    >>> table = sweep(
    ...     squeeze(fingers=1),
    ...     rows,
    ...     motion=minimum_jerk(),
    ...     measures=["peak"],
    ...     fs=8000,
    ...     seconds=0.2,
    ... )
    >>> table.column_names, table.num_rows
    (['A', 'seed', 'peak_force1', 'fault', 'error'], 6)
    >>> table.field("peak_force1").metadata
    {b'unit': b'N'}
    """
    words = _words(motion, measures, fs, seconds, live, out is not None)
    if workers is not None and (
        isinstance(workers, bool) or not isinstance(workers, int) or workers < 0
    ):
        raise BadValue(
            f"sweep: workers = {workers!r} must be a whole number: processes, or 0 for this process"
            " itself"
        )
    if executor is not None and not (isinstance(executor, Executor) and workers):
        raise BadValue(
            f"executor = {executor!r:.80} must be a concurrent.futures.Executor, and workers ="
            f" {workers} how many jobs it runs at once: 1 or more"
        )
    apart = workers != 0 and not isinstance(make, Scene)  # a function may end its process
    table, plan, motions, facts, about, samples = (_planned_apart if apart else planned)(
        make, table_of(rows), words
    )
    if not plan.units:
        raise BadValue(
            f'a sweep needs measures, such as ["rms", "peak"]; there are {", ".join(NAMED)}'
        )
    digests = {name: digest for name, (digest, _) in motions.items()}
    keyed = table.append_column("key", row_keys(plan, table, digests))
    folder = None if dry and not (out and os.path.isdir(out)) else out
    with Store(folder, facts, about, dry) as store, terminable():
        with Scheduler(plan, motions, executor, workers) as scheduler:
            names = [*plan.units, "fault", "error"]
            done = store.done(names)
            done = confirmed(plan, keyed, done, scheduler, progress)
            todo = missing(keyed, done, retry)
            began, row_seconds = store.rows, 0.0
            try:
                if todo.num_rows:
                    row_seconds = _run(plan, todo, store, scheduler, dry, progress)
            except KeyboardInterrupt:
                what = f"{store.rows - began} of {counted(todo.num_rows, 'row')} done"
                if store.folder is None:
                    raise KeyboardInterrupt(
                        f"{what}, and are lost: with out= they are kept"
                    ) from None
                raise KeyboardInterrupt(f"{what}; run it again for the rest") from None
        if dry:
            n, columns = table.num_rows, len(plan.units) + table.num_columns
            return Forecast(n, n - todo.num_rows, row_seconds, samples, 8.0 * n * columns)
        done = store.done(names)
        result = joined(
            plan, table, done.drop_columns(["key", "content"]).take(places(keyed, done))
        )
        return result.replace_schema_metadata({"stimlib_sweep": json.dumps({**facts, **about})})


@public
def rendering(
    make: Scene | Callable[..., Scene],
    rows: Any,
    at: int,
    *,
    motion: Any = None,
    fs: float,
    seconds: float | None = None,
    live: Collection[str] | None = None,
) -> Rendering:
    """Render a single row of a sweep.

    The samples are bit-identical to those from which its figures were computed.

    Parameters
    ----------
    make, rows, motion, fs, seconds, live
        As for ``sweep``.
    at : int
        Number of the row; the first is 0.

    Returns
    -------
    Rendering
        ``measured`` returns its figures, ``plot`` shows it, and ``stimlib.verify``
        checks it.

    Raises
    ------
    BadValue
        There is no such row, or the row fails.

    Examples
    --------
    >>> from stimlib.motion import minimum_jerk
    >>> from stimlib.scenes import squeeze
    >>> from stimlib.sweep import grid, measured, rendering
    >>> rows = grid(A=[0.0, 3.4], seed=range(3))
    >>> run = rendering(
    ...     squeeze(fingers=1), rows, 5, motion=minimum_jerk(), fs=8000, seconds=0.2
    ... )
    >>> run.params["A"], run.seed, list(measured(run, "peak"))
    (3.4, 2, ['peak_force1'])
    """
    whole = table_of(rows)
    if not isinstance(at, int | np.integer) or not 0 <= at < whole.num_rows:
        raise BadValue(
            f"rendering: there is no row {at!r}: give a number from 0 to {whole.num_rows - 1}"
        )
    words = _words(motion, (), fs, seconds, live, False)
    table, plan, motions, *_ = planned(make, whole.slice(int(at), 1), words)
    made = Runner(plan, motions).rendering(table.to_pylist()[0])[0]
    return dc.replace(made, y=made.y.copy())


# Before the first run -----------------------------------------------------------------
def _words(
    motion: Any, measures: Any, fs: float, seconds: float | None, live: Any, kept: bool
) -> dict[str, Any]:
    """Return the arguments of a sweep that its plan depends on, with their defaults."""
    one = isinstance(measures, str) or not isinstance(measures, Sequence)
    return {
        "motion": {} if motion is None else motion,
        "measures": (measures,) if one else tuple(measures),
        "fs": rate(fs),
        "seconds": seconds,
        "live": live,
        "kept": kept,
    }


class Planned(NamedTuple):
    """The facts of a sweep that are known before the first run."""

    table: Table
    plan: Plan
    motions: Motions
    facts: dict[str, Any]
    """Facts from which the key of a folder is computed."""
    about: dict[str, Any]
    """Further contents of the sidecar."""
    samples: int
    """Samples per row."""


class Seen(NamedTuple):
    """The facts found with the scene of one row, as plain data."""

    table: bytes
    plan: dict[str, Any]
    """Fields of the plan, by name."""
    digests: dict[str, bytes]
    facts: dict[str, Any]
    about: dict[str, Any]
    samples: int
    warned: list[str]


def planned(make: Any, table: Table, words: Mapping[str, Any]) -> Planned:
    """Check a sweep, and return the facts known before the first run.

    The scene of one row is made in this process.
    """
    return _complete(make, words, seen(make, table, words, 0))


def _planned_apart(make: Any, table: Table, words: Mapping[str, Any]) -> Planned:
    """Return the result of `planned`, with scenes made in another process.

    Making a scene may crash that process.
    """
    data = packed((make, as_bytes(table), {**words, "limits": dc.asdict(limits)}))
    memory = int(min(limits.row_bytes, 2**62))
    first = 0
    with Pool(memory) as pool:
        while True:
            try:
                with pool.worker() as worker:
                    assert worker
                    worker.ask(take_given, data)
                    found = worker.ask(seen_apart, first, seconds=limits.row_seconds)
                    break
            except WorkerDied as e:
                first = e.at + 1
                if first >= len(_rows_to_try(table.num_rows)):
                    raise
    given = words["motion"] if "motion" in table.column_names else {"": words["motion"]}
    here, there = code_keys(make, given), found.plan["code_keys"]
    other = [name for name, key in there.items() if key != here.get(name, key)]
    if other:
        found.warned.append(
            f"sweep: {other[0]} is not the same in the processes that run the rows: they import"
            " your modules anew, so an attribute that was set later, or a file that has changed,"
            " counts as it is in the file; give such values as arguments or columns, or use"
            " workers=0"
        )
    return _complete(make, words, found)


def _complete(make: Any, words: Mapping[str, Any], found: Seen) -> Planned:
    for text in found.warned:
        warnings.warn(text, RuntimeWarning, stacklevel=outside())
    given = words["motion"] if list(found.digests) != [""] else {"": words["motion"]}
    plan = Plan(
        make=make,
        measures=words["measures"],
        fs=words["fs"],
        seconds=words["seconds"],
        versions=versions(),
        limits=dc.asdict(limits),
        **found.plan,
    )
    motions = {name: (digest, given[name]) for name, digest in found.digests.items()}
    return Planned(from_bytes(found.table), plan, motions, found.facts, found.about, found.samples)


def take_given(data: bytes) -> None:
    """Store the data that `seen_apart` needs, in a process of the pool."""
    global _given
    _given = pickle.loads(data)
    for name, value in _given[2]["limits"].items():
        setattr(limits, name, value)


_given: tuple[Any, bytes, dict[str, Any]]


def seen_apart(first: int) -> Seen:
    """Return the result of `seen`, in a process of the pool."""
    make, table, words = _given
    with warnings.catch_warnings(record=True) as caught:
        found = seen(make, from_bytes(table), words, first)
    return found._replace(warned=[str(w.message) for w in caught])


def seen(make: Any, table: Table, words: Mapping[str, Any], first: int) -> Seen:
    """Check rows, motions and measures against the scene of one row."""
    if not isinstance(make, Scene) and not callable(make):
        raise BadValue(
            f"a sweep is of a scene, or of a function that makes one; got {type(make).__name__}"
        )
    fs, seconds, motion = words["fs"], words["seconds"], words["motion"]
    named = "motion" in table.column_names
    if named and not isinstance(motion, Mapping):
        raise BadValue(
            "the rows have a column motion, so motion must be a dict of motions by name, got"
            f" {type(motion).__name__}"
        )
    given = dict(motion) if named else {"": motion}
    asked, code = words["measures"], code_keys(make, given)
    # before anything runs that may keep something
    keys = measure_keys(asked) if words["kept"] else []
    scene = some_scene(make, table, first)
    roles = roles_of(make, scene, table.column_names, words["live"])
    table = checked(table, scene, roles, given)
    used = table["motion"].unique().to_pylist() if named else [""]
    for name in used:
        sources = sources_of(motion_of(given[name], scene), tuple(scene.inputs), 0)
        n = frames(sources, fs, seconds)
        sources_of(sources, tuple(scene.inputs), n)
        warn_fast(sources, scene, n / fs, fs)
        warn_beyond(scene.program, fs, n)
    digests = {name: motion_digest(given[name], name, fs, seconds) for name in used}
    units = {name: u for m in measures_of(asked, scene) for name, u in m.units.items()}
    for name in units:
        if name in MADE:
            raise BadValue(
                f"measures: a sweep adds a column {name} of its own: give your figure another name"
            )
        if name in table.column_names:
            raise BadValue(
                f"rows have a column {name}, and so do the measures: give yours another name"
            )
    key, facts = shared_key(make, keys, fs, roles)
    told = {name: f"{digest.hex()} {given[name]!r:.1000}" for name, digest in digests.items()}
    about = {
        "units": units,
        "motion": told,
        "scene_json": scene.to_dict() if isinstance(make, Scene) else None,
    }
    plan = {"units": units, "roles": roles, "key": key, "measure_keys": keys, "code_keys": code}
    return Seen(as_bytes(table), plan, digests, {"key": key, **facts}, about, n, [])


def some_scene(make: Scene | Callable[..., Scene], table: Table, first: int = 0) -> Scene:
    """Return the given scene, or the first that the factory makes from some rows.

    Parameters
    ----------
    make : Scene or callable
    table : Table
    first : int
        Number of these rows to skip.
    """
    if isinstance(make, Scene):
        return make
    known = arguments_of(make)
    error: BaseException | None = None
    rows = _rows_to_try(table.num_rows)
    for k in range(first, len(rows)):
        note(k, bytes(16))
        row = table.slice(rows[k], 1).to_pylist()[0]
        given = {n: v for n, v in row.items() if n in known and n not in OWN}
        try:
            scene = make(**given)
        except BaseException as e:
            if ended(e):
                raise
            error = error or e
            continue
        if not isinstance(scene, Scene):
            raise SceneError(f"{name_of(make)} returns {type(scene).__name__}, not a Scene")
        return scene
    assert error is not None
    raise BadValue(
        f"{name_of(make)} makes no scene of the first row: {error_text(error)}"
    ) from error


def _rows_to_try(n: int) -> list[int]:
    """Return the indices of rows to try: first, last, middle, then some between."""
    parts = (0, 1 - 1e-9, 0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875)
    return list(dict.fromkeys(int(n * part) for part in parts))


# The runs -----------------------------------------------------------------------------
def _run(
    plan: Plan,
    todo: Table,
    store: Store,
    scheduler: Scheduler,
    dry: bool,
    progress: bool,
) -> float:
    """Run the rows, a few of them first, and return the time of a row.

    If the first, the middle and the last row fail with the same kind of error, it is
    raised before the others run.
    """
    todo = todo.take(arrow().array(in_order(todo, plan.roles)))
    n, new = todo.num_rows, not store.tables
    probes = sorted({0, min(1, n - 1), n // 2, n - 1})
    times = []
    with bar("sweeping, rows", n, progress, counted=True) as advance:
        for at in probes:
            began = time.perf_counter()
            scheduler.drive(todo.slice(at, 1), store.add, 1.0, advance)
            times.append(time.perf_counter() - began)
        row_seconds = float(np.median(times[1:] or times))  # the first time is that of its scene
        errors_of = [t["error"][0].as_py() or "" for t in store.tables[-len(probes) :]]
        kinds = {text.partition(":")[0] for text in errors_of}
        if new and len(kinds) == 1 and (name := kinds.pop()).isidentifier():
            raise getattr(errors, name, BadValue)(
                f"sweep: the first row fails, and so do others: {errors_of[0]}"
            )
        if not dry:
            rest = todo.take(arrow().array(np.setdiff1d(np.arange(n), probes)))
            scheduler.widen(rest.num_rows, row_seconds, times[0])
            scheduler.drive(rest, store.add, row_seconds, advance)
    return row_seconds
