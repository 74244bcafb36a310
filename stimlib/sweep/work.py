"""What a worker does with some rows: programs, motions and buffers are kept from row to row."""

from __future__ import annotations

import pickle
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from ..core.scene import Scene
from ..errors import BadValue
from ..motion.source import positions, sources_of
from ..run.processor import Processor
from ..run.rendering import Rendering
from .measures import Measure, figures_of, measures_of, prepared
from .plan import Plan, frames, motion_of, versions
from .rows import arrow

T = TypeVar("T")
Motions = Mapping[str, tuple[bytes, Any]]
"""By name: digest of the content, and the motion as it was given."""
PROGRAMS = 4  # kept by a worker; rows come sorted
MOTION_BYTES = 64e6  # of motions that are kept, at least one
LONGEST_TEXT = 500  # of an error


@dataclass(frozen=True)
class Program:
    """A compiled scene, and the measures of its renderings."""

    scene: Scene
    proc: Processor
    measures: list[Measure]


@dataclass(frozen=True)
class Moved:
    """One motion, sampled, and what measures have made of it."""

    motion: dict[str, Any]
    x: np.ndarray
    ready: list[Any]


class Kept(OrderedDict[Any, T]):
    """The last few things that were made, by key."""

    def get_or(self, key: Any, most: int, make: Callable[[], T]) -> T:
        """What is kept under a key, made where it is not."""
        if key not in self:
            self[key] = make()
            while len(self) > most:
                self.popitem(last=False)
        self.move_to_end(key)
        return self[key]


class Runner:
    """Runs rows of one plan, one after another, in one thread.

    A row is reset, set and processed: the bits are those of ``render`` with its numbers, whatever ran before.
    """

    def __init__(self, plan: Plan, motions: Motions):
        self.plan, self.motions = plan, dict(motions)
        self._programs: Kept[Program] = Kept()
        self._moved: Kept[Moved] = Kept()
        self._y = np.empty((0, 0))

    def rendering(self, row: Mapping[str, Any]) -> tuple[Rendering, Program, Moved]:
        """A row's rendering, whose samples are valid until the next."""
        plan = self.plan
        arguments = repr([row[n] for n in plan.roles.arguments])
        program = self._programs.get_or(arguments, PROGRAMS, lambda: self._compiled(row))
        proc = program.proc
        digest, given = self.motions[row.get("motion", "")]
        moved = self._moved.get_or((digest, *proc.inputs), self._most(), lambda: self._sampled(given, program))
        shape = len(proc.outputs), moved.x.shape[1]
        if self._y.shape != shape:
            self._y = np.empty(shape)
        proc.reset(row.get("seed", 0))
        for n in plan.roles.live:
            proc.set(n, row[n], ramp=0.0)
        y = proc.process(moved.x, self._y)
        made = Rendering(program.scene, proc.fs, proc.seed, dict(proc.params), y, proc.outputs, proc.fault, moved.motion)
        return made, program, moved

    @property
    def samples(self) -> int:
        """Of the last row."""
        return self._y.shape[1]

    def figures(self, row: Mapping[str, Any]) -> tuple[list[float], str | None]:
        """A row's figures, and its fault."""
        rendering, program, moved = self.rendering(row)
        values = figures_of(program.measures, rendering, moved.ready)
        return values, None if rendering.fault is None else "{} at sample {}".format(*rendering.fault)

    def run(self, rows: list[dict[str, Any]]) -> tuple[list[list[float] | None], list[str | None], list[str | None]]:
        """Figures, faults and errors of rows; an error is what that row says, not the end of the others."""
        results: list[list[float] | None] = []
        faults: list[str | None] = []
        errors: list[str | None] = []
        for row in rows:
            values = fault = error = None
            try:
                values, fault = self.figures(row)
            except Exception as e:
                error = error_text(e)
            results.append(values)
            faults.append(fault)
            errors.append(error)
        return results, faults, errors

    def _compiled(self, row: Mapping[str, Any]) -> Program:
        scene = self.plan.scene(row)
        measures = measures_of(self.plan.measures, scene)
        units = {name: u for m in measures for name, u in m.units.items()}
        if units != self.plan.units:
            raise BadValue(
                f"the scene of this row gives {', '.join(units)} and the first one {', '.join(self.plan.units)}: "
                "name outputs that all rows have, such as rms(force1)"
            )
        return Program(scene, Processor(scene, self.plan.fs), measures)

    def _sampled(self, given: Any, program: Program) -> Moved:
        motion = motion_of(given, program.scene)
        n = frames(motion, self.plan.fs, self.plan.seconds)
        x = positions(sources_of(motion, program.proc.inputs, n), 0, n, self.plan.fs)
        return Moved(motion, x, prepared(program.measures, program.proc.inputs, x, self.plan.fs))

    def _most(self) -> int:
        each = 2 * next(reversed(self._moved.values())).x.nbytes if self._moved else 0
        return max(1, int(MOTION_BYTES / max(each, 1)))


def error_text(e: Exception) -> str:
    """An error as a row tells it."""
    return f"{type(e).__name__}: {e}"[:LONGEST_TEXT]


# As a job ------------------------------------------------------------------------------------------------------------
_here = threading.local()  # a processor is for one thread at a time


def run_part(plan: Plan, motions: Motions, data: bytes) -> tuple[bytes, float]:
    """Rows as bytes of Arrow to their figures as bytes of Arrow, and the seconds that took."""
    began = time.perf_counter()
    runner = _here.__dict__.get("runner")
    if runner is None or (runner.plan.key, runner.plan.seconds) != (plan.key, plan.seconds):
        if (here := versions()) != plan.versions:
            raise BadValue(f"this worker has other versions: {differing(here, plan.versions)}")
        runner = _here.runner = Runner(plan, motions)
    runner.motions.update(motions)
    results = runner.run(from_bytes(data).to_pylist())
    return as_bytes(figures_table(plan, *results)), time.perf_counter() - began


def differing(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """The packages of which two processes have different versions."""
    return ", ".join(f"{p} {here.get(p)}, and not {v}" for p, v in there.items() if here.get(p) != v)


def begin(data: bytes) -> None:
    """Take plan and motions, in a process of the pool."""
    global _plan
    _plan = pickle.loads(data)


_plan: tuple[Plan, Motions]


def run_kept(data: bytes) -> tuple[bytes, float]:
    """`run_part` of what `begin` took."""
    return run_part(*_plan, data)


def figures_table(plan: Plan, results: list[list[float] | None], faults: list[str | None], errors: list[str | None]) -> Any:
    """Results of some rows as columns."""
    pa = arrow()
    columns = {name: pa.array([None if r is None else r[k] for r in results], pa.float64()) for k, name in enumerate(plan.units)}
    return pa.table(columns | {"fault": pa.array(faults, pa.string()), "error": pa.array(errors, pa.string())})


def as_bytes(table: Any) -> bytes:
    """A table as a stream of Arrow."""
    sink = arrow().BufferOutputStream()
    with arrow("pyarrow.ipc").new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return sink.getvalue().to_pybytes()


def from_bytes(data: bytes) -> Any:
    """The table that `as_bytes` wrote."""
    return arrow("pyarrow.ipc").open_stream(data).read_all()
