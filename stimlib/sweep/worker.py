"""The work of one process of a sweep: rows, one after another.

Programs, motions and buffers are reused from row to row.
"""

from __future__ import annotations

import hashlib
import math
import pickle
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..checks.local import read_only
from ..core.scene import Scene
from ..errors import BadValue, said_as
from ..motion.source import positions, sources_of
from ..run.processor import Processor
from ..run.rendering import Rendering
from ..system import pool
from ..system.limits import limits
from ..system.packages import package
from .keys import KEY, code_keys, measure_keys, scene_digest, versions
from .measures import Measure, figures_of, measures_of, prepared, unwritable
from .plan import Plan, frames, motion_of
from .rows import arrow

T = TypeVar("T")
Motions = Mapping[str, tuple[bytes, Any]]
"""For each name, the digest of the content, and the motion as given."""
PROGRAMS = 4  # kept by a worker; rows come sorted
SCENES = 64  # kept by a worker, not compiled
MOTION_BYTES = 64e6  # of motions that are kept, at least one
LONGEST_TEXT = 500  # of an error


NO_SCENE = bytes(KEY)
"""Content of a row whose scene could not be made."""


@dataclass(frozen=True)
class Program:
    """A compiled scene with the measures of its renderings."""

    scene: Scene
    proc: Processor
    measures: list[Measure]


class Made(NamedTuple):
    """A scene that was made of a row's arguments."""

    scene: Scene
    digest: bytes
    """Digest of its content."""
    inputs: dict[str, str]
    """Inputs with their units, on which a recording depends."""


@dataclass
class Moved:
    """A sampled motion with the data that the measures prepared from it."""

    motion: dict[str, Any]
    x: np.ndarray
    ready: list[Any] | None = None


class Kept(OrderedDict[Any, T]):
    """A cache of the most recently used objects, by key."""

    def get_or(self, key: Any, most: int, make: Callable[[], T]) -> T:
        """Return the object under a key; make it if it is missing."""
        if key not in self:
            self[key] = make()
            while len(self) > most:
                self.popitem(last=False)
        self.move_to_end(key)
        return self[key]


class Runner:
    """A runner of one plan's rows, one after another, in one thread.

    For each row the processor is reset, set and run, so the bits are those of
    ``render`` with the row's numbers, whatever ran before.
    """

    def __init__(self, plan: Plan, motions: Motions):
        self.plan, self.motions = plan, dict(motions)
        self._scenes: Kept[Made] = Kept()
        self._programs: Kept[Program] = Kept()
        self._moved: Kept[Moved] = Kept()
        self._contents: Kept[bytes] = Kept()
        self._digests: dict[Any, bytes] = {}
        self._y = self._seen = np.empty((0, 0))

    def content(self, row: Mapping[str, Any], at: int = 0) -> bytes:
        """Return 16 bytes that identify a row's scene and motion.

        If the scene has to be made, the row's number is noted before.
        """
        if not self.plan.measure_keys:  # nothing is kept
            return NO_SCENE
        name = row.get("motion", "")

        def made() -> bytes:
            pool.note(at, NO_SCENE)
            made = self._made(row)
            key = self.motions[name][0], *made.inputs.items()
            if key not in self._digests:
                self._moved_of(name, made)
            return hashlib.sha256(made.digest + self._digests[key]).digest()[:KEY]

        return self._contents.get_or((self._arguments(row), self.motions[name][0]), SCENES, made)

    def rendering(self, row: Mapping[str, Any]) -> tuple[Rendering, Program, Moved]:
        """Return a row's rendering, whose samples are valid until the next call.

        They cannot be written.
        """
        plan = self.plan
        program = self._programs.get_or(self._arguments(row), PROGRAMS, lambda: self._compiled(row))
        proc = program.proc
        moved = self._moved_of(row.get("motion", ""), self._made(row))
        if moved.ready is None:
            moved.ready = prepared(program.measures, proc.inputs, moved.x, plan.fs)
        shape = len(proc.outputs), moved.x.shape[1]
        if self._y.shape != shape:
            self._y = np.empty(shape)
            self._seen = read_only(self._y)
        proc.reset(row.get("seed", 0))
        for n in plan.roles.live:
            proc.set(n, row[n], ramp=0.0)
        proc.process(moved.x, self._y)
        made = Rendering(
            program.scene,
            proc.fs,
            proc.seed,
            dict(proc.params),
            self._seen,
            proc.outputs,
            proc.fault,
            moved.motion.copy(),
        )
        return made, program, moved

    def figures(self, row: Mapping[str, Any]) -> tuple[list[float], str | None]:
        """Return a row's figures and its fault, if any."""
        rendering, program, moved = self.rendering(row)
        values = figures_of(program.measures, rendering, moved.ready or [])
        return values, rendering.fault and "{} at sample {}".format(*rendering.fault)

    def run(self, rows: list[dict[str, Any]], look: bool = False, seconds: float = math.inf) -> Any:
        """Return figures, fault, error and content of as many rows as time allows.

        The rows are taken in order from the first. An error concerns its row only, and
        the others continue.

        Parameters
        ----------
        rows : list of dict
        look : bool
            Only determine the content, without running the rows.
        seconds : float
            Time after which no other row is begun.
        """
        until = time.perf_counter() + seconds
        done: list[dict[str, Any]] = []
        for at, row in enumerate(rows):
            told: dict[str, Any] = {"content": NO_SCENE}
            done.append(told)
            try:
                told["content"] = self.content(row, at)
                pool.note(at, told["content"])
                if not look:
                    values, told["fault"] = self.figures(row)
                    told |= dict(zip(self.plan.units, values, strict=True))
            except BaseException as e:
                if pool.ended(e):
                    raise
                told["error"] = error_text(e)
            if time.perf_counter() > until:
                break
        return figures_table(self.plan, done)

    def _arguments(self, row: Mapping[str, Any]) -> str:
        return repr([row[n] for n in self.plan.roles.arguments])

    def _made(self, row: Mapping[str, Any]) -> Made:
        """Return a row's scene."""

        def make() -> Made:
            scene = self.plan.scene(row)
            units = {n: str(b.dim) for n, b in scene.inputs.items()}
            return Made(scene, scene_digest(scene, self.plan.fs), units)

        return self._scenes.get_or(self._arguments(row), SCENES, make)

    def _compiled(self, row: Mapping[str, Any]) -> Program:
        scene = self._made(row).scene
        measures = measures_of(self.plan.measures, scene)
        units = {name: u for m in measures for name, u in m.units.items()}
        if units != self.plan.units:
            raise BadValue(
                f"the scene of this row gives {', '.join(units)} and the first one"
                f" {', '.join(self.plan.units)}: name outputs that all rows have, such as"
                " rms(force1)"
            )
        return Program(scene, Processor(scene, self.plan.fs), measures)

    def _moved_of(self, name: str, made: Made) -> Moved:
        digest, given = self.motions[name]
        inputs, key = tuple(made.inputs), (digest, *made.inputs.items())

        def sampled() -> Moved:
            motion = motion_of(given, made.scene)
            n = frames(motion, self.plan.fs, self.plan.seconds)
            x = positions(sources_of(motion, inputs, n), 0, n, self.plan.fs)
            data = repr((inputs, x.shape)).encode() + x.tobytes()
            self._digests[key] = hashlib.sha256(data).digest()
            return Moved(unwritable(motion), x)

        return self._moved.get_or(key, self._most(), sampled)

    def _most(self) -> int:
        each = 2 * next(reversed(self._moved.values())).x.nbytes if self._moved else 0
        return max(1, int(MOTION_BYTES / max(each, 1)))


def error_text(e: BaseException) -> str:
    """Return an error as text, for the column ``error``."""
    try:
        text = str(e)
    except BaseException as other:  # of a class of the user's
        if pool.ended(other):
            raise
        text = f"its text cannot be made: {type(other).__name__}"
    return f"{type(e).__name__}: {text}"[:LONGEST_TEXT]


# As a job -----------------------------------------------------------------------------
def take(data: bytes) -> None:
    """Take the plan of a sweep, and motions; later more motions of the same sweep."""
    global _runner
    plan, motions = pickle.loads(data)
    given = {name: motion for name, (_, motion) in motions.items()}
    for name, value in plan.limits.items():
        setattr(limits, name, value)
    if plan.measure_keys and plan.measure_keys != measure_keys(plan.measures):
        raise BadValue(
            "measures: a file of yours has changed since the sweep began, or a module that they use"
            " has another state here (a cache, an attribute that was set); start it again, or state"
            ' @measure(.., version="1")'
        )
    for name, key in code_keys(plan.make, given).items():
        if key != plan.code_keys.get(name, key):
            raise BadValue(
                f"{name}: a file of yours has changed since the sweep began; start it again"
            )
    if _runner is None:
        _runner = Runner(plan, motions)
    _runner.motions.update(motions)


_runner: Runner | None = None


def run_job(
    rows: bytes, look: bool, seconds: float, runner: Runner | None = None
) -> tuple[bytes, float]:
    """Run rows as Arrow bytes; return their figures likewise, and the seconds it took.

    They are rows of the sweep that `take` has taken, if no other runner is given.
    """
    began = time.perf_counter()
    runner = runner or _runner
    assert runner
    table = runner.run(from_bytes(rows).to_pylist(), look, seconds)
    return as_bytes(table), time.perf_counter() - began


def differing(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """Return a text with the packages whose versions differ between two processes."""
    return ", ".join(
        f"{p} {here.get(p)}, and not {v}" for p, v in there.items() if here.get(p) != v
    )


def figures_table(plan: Plan, rows: list[dict[str, Any]]) -> Any:
    """Return the results of some rows as a table."""
    pa = arrow()
    kinds = dict.fromkeys(plan.units, pa.float64())
    kinds |= {"fault": pa.string(), "error": pa.string(), "content": pa.binary(KEY)}
    return pa.table(
        {name: pa.array([row.get(name) for row in rows], kind) for name, kind in kinds.items()}
    )


def as_bytes(table: Any) -> bytes:
    """Return a table as bytes in Arrow's stream format."""
    sink = arrow().BufferOutputStream()
    with arrow("pyarrow.ipc").new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return sink.getvalue().to_pybytes()


def from_bytes(data: bytes) -> Any:
    """Return the table that `as_bytes` wrote."""
    return arrow("pyarrow.ipc").open_stream(data).read_all()


def packed(what: Any) -> bytes:
    """Return a pickle that can include functions of a script or a notebook."""
    with said_as(
        BadValue,
        "sweep: scene, motion or measures cannot be sent to another process",
        Exception,  # of objects of the user's, too
    ):
        return package("cloudpickle", "a sweep in several processes").dumps(what)


# Where the executor runs a job --------------------------------------------------------
_pools: dict[str, pool.Pool] = {}
"""The processes next to this one, by sweep; closed where that has ended here."""


def pool_of(sweep: str, memory: float = 0.0) -> pool.Pool:
    """Return the processes of a sweep next to this one."""
    return _pools.setdefault(sweep, pool.Pool(int(min(memory, 2**62))))


def run_beside(
    number: int,
    sweep: str,
    told: dict[str, str],
    limits: dict[str, float],
    names: set[str],
    given: bytes,
    *job: Any,
) -> tuple[bytes, float] | Exception | None:
    """Run a job in a process next to this one, and return its result or its error.

    If a row crashes that process, only the row fails, and this process continues.

    Parameters
    ----------
    number : int
        Number of the job.
    sweep : str
        Name of the sweep: each has processes of its own.
    told, limits : dict
        Versions that this process must have, too, and limits of a row.
    names : set of str
        Motions of the rows.
    given : bytes
        Plan and motions. If empty, they are known from another job, or None is
        returned.
    *job
        As for `run_job`.
    """
    with pool_of(sweep, limits["row_bytes"]).worker(start=bool(given)) as worker:
        if worker is None or not (given or names <= worker.known):
            return None
        try:
            if given:
                if (here := versions()) != told:
                    raise BadValue(
                        f"a worker has {differing(here, told)} as here: the figures would differ;"
                        " install the same there"
                    )
                worker.ask(take, given)
                worker.known |= names
            return worker.ask(run_job, *job, seconds=limits["row_seconds"])
        except Exception as e:
            # of a process that had no plan yet, the rows are not the reason
            return (
                pool.JobFailed(str(e)) if isinstance(e, pool.WorkerDied) and not worker.known else e
            )
