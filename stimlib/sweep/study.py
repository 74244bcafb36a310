"""A sweep from its call to its table."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core.pool import terminable
from ..core.program import rate, warn_beyond
from ..core.progress import progress as bar
from ..core.scene import Scene
from ..errors import BadValue, SceneError, StimlibError
from ..motion.source import sources_of, warn_fast
from ..run.rendering import Rendering
from .drive import drive, joined
from .engines import Cluster, Here, Local
from .measures import NAMED, Measure, measures_of
from .plan import Plan, frames, in_order, motion_digest, motion_of, row_keys, shared_key, versions
from .rows import MADE, arguments_of, arrow, checked, name_of, roles_of, table_of
from .store import Store
from .work import Motions, Runner, error_text

if TYPE_CHECKING:
    import pyarrow as pa

QUICK = 4.0  # s of work for which no process is started


class Forecast(NamedTuple):
    """What a sweep will take, from a few of its rows."""

    rows: int
    there: int
    """Rows that are in the folder already."""
    row_seconds: float
    """Of one core."""
    samples: int
    """Of a row."""
    memory: float
    """Bytes of all figures."""

    def hours(self, workers: int) -> float:
        """For so many cores of this kind, where they have nothing else to do."""
        return (self.rows - self.there) * self.row_seconds / workers / 3600

    def __str__(self) -> str:
        cores = sorted({1, 2, 4, 8, 16, 64, os.cpu_count() or 1})
        lines = [
            f"{self.rows} rows, {self.there} of them there; {1000 * self.row_seconds:.3g} ms a row of {self.samples} samples; "
            f"{self.memory / 1e6:.3g} MB of figures"
        ]
        return "\n".join(lines + [f"{n:5d} cores: {_time(3600 * self.hours(n))}" for n in cores])


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds < 100 else f"{seconds / 60:.3g} min" if seconds < 6000 else f"{seconds / 3600:.3g} h"


def sweep(
    make: Scene | Callable[..., Scene],
    rows: Any,
    *,
    motion: Any,
    measures: Sequence[str | Measure] | str | Measure,
    fs: float,
    seconds: float | None = None,
    live: Collection[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    on: Any = None,
    workers: int | None = None,
    retry: bool = False,
    dry: bool = False,
    progress: bool = True,
) -> pa.Table | Forecast:
    """Run a scene for every row of a table, and keep a few figures of each rendering.

    A row that fails is a row with its error; the others go on.  With ``out``, what is done is kept: a sweep that was stopped or
    killed goes on when it is called again, and one with more rows runs only those.  The figures of a row are the same bits
    whatever ran beside it, in any order, number of workers or engine; processors of another kind may round differently.

    Parameters
    ----------
    make : Scene or callable
        The scene; or a function that makes one, where rows change its arguments.
    rows : mapping of str to sequence, table, or path
        ``grid(..)``, columns by name, a table of Arrow, pandas or polars, a CSV or Parquet file.  The column ``seed`` is that of
        the noise (0 without it), ``motion`` the name of a motion; all others are parameters or arguments.
    motion : motion, Recording or dict
        As ``render`` takes it: input to function of time or samples.  One function, array or recording is of all inputs.  Where
        the rows have a column ``motion``: a dict of such motions by name.
    measures : str, Measure or sequence of them
        Names, such as ``"rms"``, ``"band(20, 1000)"``, ``"peak(force1)"``, ``"psd"``, ``"cues"``, ``"verify"``
        (``stimlib.sweep.measures.NAMED``), and functions of a rendering with ``@measure``.
    fs : float
        Sample rate in Hz.
    seconds : float, optional
        Length of a run; by default that of its recording or array.
    live : collection of str, optional
        With a function: which columns are parameters that are set, and not arguments.  Needed where a name is both.
    out : path, optional
        Folder for the figures, as Parquet.
    on : distributed.Client or str, optional
        A Dask cluster, or its address such as ``"tcp://head:8786"``; by default this machine.
    workers : int, optional
        Processes on this machine; by default one for each core, and none where the work takes only seconds.
    retry : bool
        Run rows that failed before once more.
    dry : bool
        Run a few rows only, and tell what all will take.
    progress : bool
        A progress bar on stderr, if that is a terminal.

    Returns
    -------
    pyarrow.Table, or Forecast
        The rows in their order, with a column of float64 for each figure (null where the row failed), ``fault`` (output and
        sample from which on a rendering was not finite, or null) and ``error`` (or null).  The field metadata has units.

    Raises
    ------
    UnknownName, BadValue, UnitError, SceneError
        What is wrong with rows, motion, measures or scene, before the first run; an error that the first, the middle and the
        last row have in common; versions on a cluster that differ from those here.
    SinkError
        The folder cannot be written or is that of something else; the cluster went away.
    MissingPackage
        pyarrow, or for a cluster distributed, is not installed: ``pip install 'stimlib[sweep]'``.
    KeyboardInterrupt
        On Ctrl-C; it says how many rows were done.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.motion.generators import minimum_jerk
    >>> from stimlib.scenes import squeeze
    >>> from stimlib.sweep import grid, sweep
    >>> rows = grid(A=[0.0, 3.4], seed=range(3))
    >>> table = sweep(squeeze(fingers=1), rows, motion=minimum_jerk(), measures=["peak"], fs=8000, seconds=0.2)
    >>> table.column_names, table.num_rows
    (['A', 'seed', 'peak_force1', 'fault', 'error'], 6)
    >>> table.field("peak_force1").metadata
    {b'unit': b'N'}
    """
    table, plan, motions, facts, about = planned(make, rows, motion=motion, measures=measures, fs=fs, seconds=seconds, live=live)
    if not plan.units:
        raise BadValue(f'a sweep needs measures, such as ["rms", "peak"]; there are {", ".join(NAMED)}')
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise BadValue(f"sweep: workers = {workers!r} must be a whole number, at least 1")
    digests = {name: digest for name, (digest, _) in motions.items()}
    keyed = table.append_column("key", row_keys(plan, table, digests))
    with Store(out if not dry or _is_folder(out) else None, facts, about, dry) as store:
        done = store.done([*plan.units, "fault", "error"])
        places = _places(keyed, done)
        todo = _missing(keyed, done, places, retry)
        pilot = _pilot(plan, motions, todo, new=not store.tables) if todo.num_rows else None
        if dry:
            return _forecast(table, todo, plan, pilot)
        if pilot is not None:
            _run(plan, motions, todo, store, pilot, on, workers, progress)
            done = store.done(done.column_names[1:])
            places = _places(keyed, done)
        result = joined(plan, keyed.drop_columns(["key"]), done.drop_columns(["key"]).take(places))
        return result.replace_schema_metadata({"stimlib_sweep": json.dumps({**facts, **about})})


def rendering(
    make: Scene | Callable[..., Scene],
    rows: Any,
    at: int,
    *,
    motion: Any,
    fs: float,
    seconds: float | None = None,
    live: Collection[str] | None = None,
) -> Rendering:
    """One row of a sweep alone, to look at: the same samples, bit for bit, of which its figures were made.

    Parameters
    ----------
    make, rows, motion, fs, seconds, live
        As for ``sweep``.
    at : int
        Number of the row; the first is 0.

    Returns
    -------
    Rendering
        ``measured`` gives its figures, ``plot`` shows it, ``stimlib.verify`` proves it.

    Raises
    ------
    BadValue
        No such row; and what the row's error says.

    Examples
    --------
    >>> from stimlib.motion.generators import minimum_jerk
    >>> from stimlib.scenes import squeeze
    >>> from stimlib.sweep import grid, measured, rendering
    >>> rows = grid(A=[0.0, 3.4], seed=range(3))
    >>> run = rendering(squeeze(fingers=1), rows, 5, motion=minimum_jerk(), fs=8000, seconds=0.2)
    >>> run.params["A"], run.seed, list(measured(run, "peak"))
    (3.4, 2, ['peak_force1'])
    """
    whole = table_of(rows)
    if not isinstance(at, int | np.integer) or not 0 <= at < whole.num_rows:
        raise BadValue(f"rendering: there is no row {at!r}: give a number from 0 to {whole.num_rows - 1}")
    table, plan, motions, *_ = planned(
        make, whole.slice(int(at), 1), motion=motion, measures=(), fs=fs, seconds=seconds, live=live
    )
    return Runner(plan, motions).rendering(table.to_pylist()[0])[0]


# Before the first run ------------------------------------------------------------------------------------------------
Planned = tuple["pa.Table", Plan, Motions, dict[str, Any], dict[str, Any]]


def planned(
    make: Any, rows: Any, *, motion: Any, measures: Any, fs: float, seconds: float | None, live: Collection[str] | None
) -> Planned:
    """Everything that can be known without a run, checked: rows, plan, motions, and what a sidecar tells."""
    if not isinstance(make, Scene) and not callable(make):
        raise BadValue(f"a sweep is of a scene, or of a function that makes one; got {type(make).__name__}")
    fs, table = rate(fs), table_of(rows)
    scene = some_scene(make, table)
    roles = roles_of(make, scene, table.column_names, live)
    named = "motion" in table.column_names
    if named and not isinstance(motion, Mapping):
        raise BadValue(f"the rows have a column motion, so motion must be a dict of motions by name, got {type(motion).__name__}")
    given = dict(motion) if named else {"": motion}
    table = checked(table, scene, roles, given)
    used = table["motion"].unique().to_pylist() if named else [""]
    for name in used:
        sources = sources_of(motion_of(given[name], scene), tuple(scene.inputs), 0)
        n = frames(sources, fs, seconds)
        sources_of(sources, tuple(scene.inputs), n)
        warn_fast(sources, scene, n / fs)
        warn_beyond(scene.program, fs, n)
    motions = {name: (motion_digest(given[name], fs, seconds), given[name]) for name in used}
    asked = tuple(measures if isinstance(measures, Sequence) and not isinstance(measures, str) else [measures])
    found = measures_of(asked, scene)
    units = {name: u for m in found for name, u in m.units.items()}
    if own := [name for name in units if name in MADE]:
        raise BadValue(f"measures: a sweep adds a column {own[0]} of its own: give your figure another name")
    if clash := [name for name in units if name in table.column_names]:
        raise BadValue(f"rows have a column {clash[0]}, and so do the measures: give yours another name")
    key, facts = shared_key(make, scene, asked, fs, roles)
    plan = Plan(make, asked, units, fs, seconds, roles, versions(), key)
    about = {
        "units": units,
        "motion": {name: f"{digest.hex()} {m!r:.1000}" for name, (digest, m) in motions.items()},
        "scene_json": scene.to_dict() if isinstance(make, Scene) else None,
    }
    return table, plan, motions, {"key": key, **facts}, about


def some_scene(make: Scene | Callable[..., Scene], table: pa.Table) -> Scene:
    """The scene, or what the factory makes of the first, the middle or the last row."""
    if isinstance(make, Scene):
        return make
    known = arguments_of(make)
    error: Exception | None = None
    for at in _probes(table.num_rows):
        row = table.slice(at, 1).to_pylist()[0]
        try:
            scene = make(**{n: v for n, v in row.items() if n in known and n not in ("seed", "motion")})
        except Exception as e:
            error = error or e
            continue
        if not isinstance(scene, Scene):
            raise SceneError(f"{name_of(make)} returns {type(scene).__name__}, not a Scene")
        return scene
    raise BadValue(f"{name_of(make)} makes no scene of the first row: {type(error).__name__}: {error}") from error


def _probes(n: int) -> list[int]:
    return sorted({0, n // 2, n - 1})


@dataclass(frozen=True)
class Pilot:
    """The first runs: the runner that did them, and how long one of them took."""

    runner: Runner
    row_seconds: float


def _pilot(plan: Plan, motions: Motions, todo: pa.Table, new: bool) -> Pilot:
    """Run the first, the middle and the last row; what all of them have wrong is an error now, and no lost night."""
    runner = Runner(plan, motions)
    errors: list[Exception] = []
    times: list[float] = []
    probes = [0, *_probes(todo.num_rows)]
    for at in probes:  # the first once more: the first time is that of its scene
        began = time.perf_counter()
        try:
            runner.figures(todo.slice(at, 1).to_pylist()[0])
        except Exception as e:
            errors.append(e)
        times.append(time.perf_counter() - began)
    if new and len(errors) == len(probes):
        first = errors[0]
        text = f"sweep: the first row fails, and so do others: {error_text(first)}"
        raise (type(first) if isinstance(first, StimlibError) else BadValue)(text) from first
    return Pilot(runner, sorted(times[1:])[len(times) // 2 - 1])


def _is_folder(out: Any) -> bool:
    return out is not None and os.path.isdir(out)


def _forecast(table: pa.Table, todo: pa.Table, plan: Plan, pilot: Pilot | None) -> Forecast:
    n, there = table.num_rows, table.num_rows - todo.num_rows
    if pilot is None:
        return Forecast(n, there, 0.0, 0, 8.0 * n * (len(plan.units) + table.num_columns))
    samples = pilot.runner.samples
    return Forecast(n, there, pilot.row_seconds, samples, 8.0 * n * (len(plan.units) + table.num_columns))


# The runs --------------------------------------------------------------------------------------------------------------
def _places(keyed: pa.Table, done: pa.Table) -> pa.Array:
    """Where each row is among those that are done, or null."""
    return arrow("pyarrow.compute").index_in(keyed["key"].combine_chunks(), value_set=done["key"].combine_chunks())


def _missing(keyed: pa.Table, done: pa.Table, places: pa.Array, retry: bool) -> pa.Table:
    """Rows that are not there yet, each once; with retry those that failed, too."""
    pa, pc = arrow(), arrow("pyarrow.compute")
    if retry:
        places = pc.if_else(pc.is_valid(done["error"].take(places)).combine_chunks(), None, places)
    keyed = keyed.filter(pc.is_null(places)) if places.null_count < keyed.num_rows else keyed
    codes = keyed["key"].combine_chunks().dictionary_encode() if keyed.num_rows else None
    if codes is None or len(codes.dictionary) == keyed.num_rows:
        return keyed
    _, first = np.unique(codes.indices.to_numpy(), return_index=True)
    return keyed.take(pa.array(np.sort(first)))


def _run(
    plan: Plan, motions: Motions, todo: pa.Table, store: Store, pilot: Pilot, on: Any, workers: int | None, progress: bool
) -> None:
    todo = todo.take(arrow().array(in_order(todo, plan.roles)))
    n, began = todo.num_rows, store.rows
    quick = n * pilot.row_seconds < QUICK
    try:
        with terminable(), bar("sweeping", n, progress) as advance:
            if on is not None:
                engine: Any = Cluster(on, plan, motions)
            elif workers == 1 or (workers is None and (quick or (os.cpu_count() or 1) == 1)):
                engine = Here(pilot.runner)
            else:
                engine = Local(plan, motions, min(workers or os.cpu_count() or 1, n))
            with engine:
                drive(plan, todo, store, engine, pilot.row_seconds, advance)
    except KeyboardInterrupt:
        what = f"{store.rows - began} of {n} rows were done"
        kept = "; run it again for the rest" if store.folder is not None else ", and are lost: with out= they are kept"
        raise KeyboardInterrupt(what + kept) from None
