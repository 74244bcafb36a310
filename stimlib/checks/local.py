"""Checks of each block of a scene against its own law, on its actual input signals.

The composition does not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from ..blocks.filters import Delay, DelayParams, DelayState
from ..blocks.noise import White
from ..core.graph import NONE, Block, Const, Input, Map, Pick, named, reach, signals, type_name
from ..core.loops import Last, Loop, Tap
from ..core.maths import SILENT
from ..core.parameter import Param
from ..core.program import lead
from ..core.scene import Scene
from ..core.subsystems import Segment, Subsystem
from ..errors import BadValue, counted
from ..run.driver import walk
from ..run.processor import Change, compile
from . import (
    families as families,  # it enters the laws
    laws,
    rows,
)
from .evidence import DEVIATES, Check, Evidence, lost_by_ramps, ramped
from .rows import Rows

# samples that are looked at: the first, and stretches that the seed places
FIRST, LATER, PLACES = 1 << 13, 1 << 12, 4
# no difference: what recursive blocks count as 0, times a gain
FADED = 1e10 * SILENT
FAR = 64  # samples between two that are asked for together
GONE = 1e-18  # of the largest sample of a stretch: what may be left there of what was before
WIRES = Pick | Tap | Loop | Const
Row = np.ndarray


class Held(NamedTuple):
    """The result of checking one block against its law."""

    block: Block
    where: str  # the subsystems that it is in
    samples: int  # that were looked at
    error: float  # largest, over its tolerance
    why: str = ""  # it is not held
    least: float = np.inf  # the smallest part by which its row could be larger, and be refused
    above: int = 0  # samples in which its frequency was fs/2 or above

    @property
    def kind(self) -> str:
        """The class of the block, as named in a scene file."""
        return type_name(type(self.block))


class Run(NamedTuple):
    """The blocks that run on one clock, with their inputs and parameters."""

    outputs: Mapping[str, Block]
    fs: float
    seed: int
    x: Mapping[str, Any]  # of each input what gives its samples at:stop, such as a row
    n: int
    params: dict[str, float]  # at the first sample
    changes: Sequence[Change]  # of parameters, by sample
    spans: Sequence[tuple[int, int]]  # the samples that are looked at: the first ones, and others
    where: str = ""  # the subsystems that it is in


class Part(NamedTuple):
    """The rows of all blocks in one span."""

    at: int  # its first sample
    n: int
    # of each block; in the first span from before sample 0 on, where the block begins
    # there
    rows: dict[int, Row]
    past: dict[int, int]  # ``rows.SUMS`` of the samples before

    def row(self, b: Block, n: int) -> Row:
        """Return the last n samples of a signal."""
        if isinstance(b, Const):
            return np.full(n, b.value)
        row = self.rows[id(b)]
        return row[..., row.shape[-1] - n :]

    def early(self, b: Block, fs: float) -> int:
        """Return how many samples of a block's row are before sample 0."""
        return lead(fs) if b.autonomous and not self.at else 0


class Driven(NamedTuple):
    """An input of a recording, whose samples are computed on demand."""

    e: Evidence
    input: int

    def __getitem__(self, key: slice) -> Row:  # type: ignore[override]
        return self.e.motion_at(key.start, key.stop)[self.input]


class Clock(NamedTuple):
    """The samples at which a gate is open.

    It holds where the gate opens and closes, and the number of open samples before each
    opening.
    """

    opens: np.ndarray
    closes: np.ndarray
    before: np.ndarray

    @staticmethod
    def of(edges: np.ndarray, n: int) -> Clock:
        """Return the clock of n samples for a gate that switches at given samples."""
        edges = np.minimum(np.append(edges, n) if edges.size % 2 else edges, n)
        opens, closes = edges[::2], edges[1::2]
        return Clock(opens, closes, np.cumsum(closes - opens) - (closes - opens))

    @property
    def total(self) -> int:
        """The number of samples at which the gate is open."""
        return int(np.sum(self.closes - self.opens))

    def until(self, n: int) -> int:
        """Return the number of open samples before sample n."""
        return int(np.sum(np.clip(n, self.opens, self.closes) - self.opens))

    def samples(self, first: int, stop: int) -> np.ndarray:
        """Return the sample numbers of the open samples first .. stop - 1."""
        k = np.arange(first, stop)
        at = np.searchsorted(self.before, k, "right") - 1
        return self.opens[at] + k - self.before[at]


class Inside(NamedTuple):
    """An input on the clock of a gate."""

    row: Any
    clock: Clock

    def __getitem__(self, key: slice) -> Row:  # type: ignore[override]
        at = self.clock.samples(key.start, key.stop)
        if not at.size or at[-1] - at[0] + 1 == at.size:
            return self.row[int(at[0]) : int(at[-1]) + 1] if at.size else np.empty(0)
        near = np.split(at, np.flatnonzero(np.diff(at) > FAR) + 1)
        return np.concatenate([self.row[int(k[0]) : int(k[-1]) + 1][k - k[0]] for k in near])


class Gated:
    """The times at which a subsystem runs, and its changing parameters.

    The parameters are those at its first sample, and their later changes.
    """

    def __init__(self) -> None:
        self.edges: list[np.ndarray] = []  # samples at which it begins to run, or ends
        self.params: dict[str, float] = {}
        self.changes: list[Change] = []  # on its own clock
        self._on, self._count = False, 0
        self._last: dict[str, float] = {}

    def add(self, at: int, on: np.ndarray, moving: Mapping[str, Row]) -> None:
        """Add the next samples: whether the subsystem runs, and its parameters."""
        self.edges.append(at + np.flatnonzero(np.diff(on, prepend=self._on)))
        for name, row in moving.items():
            row = row[on]
            if row.size:
                self.params.setdefault(name, float(row[0]))
                steps = np.flatnonzero(np.diff(row, prepend=self._last.get(name, row[0])))
                self.changes += [
                    Change(self._count + int(k), name, float(row[k]), 0.0) for k in steps
                ]
                self._last[name] = float(row[-1])
        self._on, self._count = bool(on[-1]), self._count + int(np.count_nonzero(on))

    def until(self, n: int) -> np.ndarray:
        """Return the samples below n at which the subsystem starts and stops."""
        edges = np.minimum(np.concatenate(self.edges), n)
        return np.append(edges, n) if edges.size % 2 else edges


@dataclass(frozen=True, eq=False)
class Early(Block):
    """A signal delayed by the lead, to render its samples before sample 0."""

    x: Block
    step = staticmethod(Delay.step)

    def design(self, fs):
        """Return the parameters and rest state of a delay by the lead."""
        return DelayParams(float(lead(fs))), DelayState(np.zeros(lead(fs)), NONE)


def blocks_held(e: Evidence) -> list[Check]:
    """Check each class of block against its law.

    Blocks without a law, or that could not be observed, are listed in ``skipped``.
    """
    n, ends = e.frames, e.scene.outputs.values()
    # what has no effect, and is no part of the program, may have any value
    x: dict[str, Any] = {name: np.broadcast_to(0.0, n) for name in named(ends, Input)}
    x |= {name: Driven(e, k) for k, name in enumerate(e.proc.inputs)}
    params = {name: p.value for name, p in named(ends, Param).items()} | e.params
    found = e.held = held(
        Run(e.scene.outputs, e.fs, e.seed, x, n, params, e.changes, spans(n, e.seed))
    )
    for kind in dict.fromkeys((h.kind, h.why) for h in found if h.why):
        same = [h for h in found if (h.kind, h.why) == kind]
        e.skipped.append(
            f"{same[0].block!r}{same[0].where}{f' and {len(same) - 1} more' if same[1:] else ''}:"
            f" {kind[1]}"
        )
    e.numbers += [
        f"{h.block.rated} was fs/2 = {e.fs / 2:g} Hz or above in {h.above} of {h.samples}"
        f" samples{h.where}, which no output at this rate can have"
        for h in found
        if h.above
    ]
    checks = []
    for name in dict.fromkeys(_group(h.block) for h in found if not h.why):
        same = [h for h in found if not h.why and _group(h.block) == name]
        worst = max(same, key=lambda h: h.error)
        text = (
            f"error over tolerance, {counted(len(same), 'block')},"
            f" {counted(max(h.samples for h in same), 'sample')}"
        )
        text += f"; the largest is that of {worst.block!r}{worst.where}" if worst.error > 1 else ""
        checks.append(Check("f", name, worst.error, 1.0, text))
    return checks


def spans(n: int, seed: int) -> list[tuple[int, int]]:
    """Return the stretches that are checked.

    They cover all of a short run; of a long run they are its start, and others drawn
    with its seed.
    """
    if n <= FIRST + PLACES * LATER:
        return [(0, n)]
    free = (
        np.sort(
            np.random.default_rng([seed, n]).integers(0, n - FIRST - PLACES * LATER + 1, PLACES)
        )
        + FIRST
    )
    return [(0, FIRST), *((int(a), int(a) + LATER) for a in free + LATER * np.arange(PLACES))]


def _group(b: Block) -> str:
    """Return the name under which a block is listed."""
    if isinstance(b, Input | Param):
        return "inputs and parameters"
    return (
        "arithmetic"
        if isinstance(b, Map) and type_name(type(b)) in rows.LAWS
        else type_name(type(b))
    )


def held(run: Run) -> list[Held]:
    """Check every block of a scene, including those in its subsystems.

    Each is checked on its own clock.
    """
    return _held(run)[0]


def _held(run: Run) -> tuple[list[Held], list[Part]]:
    """Return the results of all blocks, and their rows."""
    blocks = outside(run.outputs.values())
    if all(isinstance(b, Const) for b in blocks):
        return [], [Part(a, z - a, {}, {}) for a, z in run.spans]
    gated: list[Any] = [b for b in blocks if isinstance(b, Subsystem)]
    seen, whole = _seen(run, blocks, gated)
    found = []
    for b in blocks:
        if isinstance(b, Loop):
            found.append(_fed_back(b, run, seen))
        elif isinstance(b, Subsystem):
            found += _inside(b, run, seen, whole)
        elif not isinstance(b, WIRES | Last):
            found.append(_one(b, run, seen))
    return found, seen


def _fed_back(b: Any, run: Run, seen: list[Part]) -> Held:
    """Check the last value of a loop against the output of its body."""
    error, least, last = 0.0, np.inf, b.last
    for part in (part for part in seen if part.n):
        y, body = part.row(last, part.n), part.row(b.body, part.n)
        want = np.r_[y[0] if part.at else last.first, body[:-1]]
        error, least = max(error, _error(y, want, FADED)), min(least, _least(want, FADED))
    return Held(last, run.where, sum(part.n for part in seen), error, least=least)


def outside(roots: Iterable[Block]) -> list[Block]:
    """Return all blocks that are in no subsystem, children first."""
    found: dict[int, Block] = {}
    todo = list(roots)
    while todo:
        new = [b for b in reach(todo, Subsystem) if id(b) not in found]
        found |= {id(b): b for b in new}
        todo = [b.by for b in new if isinstance(b, Subsystem)]  # type: ignore[attr-defined]
    return [b for b in reach(list(roots)) if id(b) in found]


def _seen(
    run: Run, blocks: list[Block], gated: list[Any]
) -> tuple[list[Part], dict[int, tuple[Gated, Row]]]:
    """Return the rows of each block in each span, and the gates of subsystems.

    The gates, and the parameters inside, are returned for all samples.

    Rows end where one is not finite.
    """
    moved = _moved(run, gated)
    driven = [b for b in gated if moved[id(b)] or not isinstance(b.by, Const)]
    whole = {id(b): Gated() for b in driven}
    shown, names, early = _shown([*blocks, *chain(*moved.values())])
    proc = compile(Scene(shown), run.fs, seed=run.seed)
    order, lag = {name: k for k, name in enumerate(proc.outputs)}, lead(run.fs)
    place = {key: order[its[0]] for key, its in names.items()}
    stop = max(lag, run.n if driven else run.spans[-1][1])
    # what runs early is seen in each span from 0 on: several, where a gate opens late
    kept = [np.empty((len(proc.outputs), z - a if a else max(z, lag))) for a, z in run.spans]
    counts = _Counts(blocks, run)
    set_ = [Change(0, name, float(v), 0.0) for name, v in run.params.items()]
    changes = [c for c in [*set_, *run.changes] if c.name in proc.params]
    for at, y in walk(proc, _motion_of(run, proc.inputs), stop, changes):
        row_of = partial(_row_of, y, place)
        _keep(kept, run.spans, at, y)
        counts.add(at, row_of)
        for b in driven if at < run.n else ():
            values = {p.name: row_of(p)[: run.n - at] for p in moved[id(b)]}
            whole[id(b)].add(at, (row_of(b.by) > 0)[: run.n - at], values)
    # a row that is not finite closes the guard of its output
    known = proc.fault[1] if proc.fault else stop
    seen = []
    for (a, z), out, past in zip(run.spans, kept, counts.past, strict=True):
        n, row = max(0, min(z, known) - a), dict(zip(proc.outputs, out, strict=True))
        seen.append(Part(a, n, _rows(row, names, {} if a else early, n, lag), past))
    return seen, {key: (its, its.until(min(known, run.n))) for key, its in whole.items()}


def _row_of(y: Row, place: Mapping[int, int], b: Block) -> Row:
    """Return the samples of a block that has one output."""
    return np.full(y.shape[1], b.value) if isinstance(b, Const) else y[place[id(b)]]


def _moved(run: Run, gated: list[Any]) -> dict[int, list[Param]]:
    """Return the parameters of each subsystem that change during the run."""
    live = {c.name for c in run.changes}
    return {
        id(b): [p for p in reach([b.block]) if isinstance(p, Param) and p.name in live]
        for b in gated
    }


class _Counts:
    """What some blocks have counted up to the start of each span."""

    def __init__(self, blocks: list[Block], run: Run):
        self.run, self.blocks = run, [b for b in blocks if type_name(type(b)) in rows.SUMS]
        self.past: list[dict[int, int]] = [{} for _ in run.spans]
        self._totals = dict.fromkeys(map(id, self.blocks), 0)

    def add(self, at: int, row_of: Callable[[Block], Row]) -> None:
        """Add the steps of samples that start at ``at``."""
        for b in self.blocks:
            step = rows.SUMS[type_name(type(b))](row_of(b.children[0]), self.run.fs)
            for (a, _), past in zip(self.run.spans, self.past, strict=True):
                if 0 <= a - at < step.size:
                    past[id(b)] = self._totals[id(b)] + int(step[: a - at].sum())
            self._totals[id(b)] += int(step.sum())


def _keep(kept: list[Row], spans: Sequence[tuple[int, int]], at: int, y: Row) -> None:
    """Copy the samples that lie in each span, from samples that start at ``at``."""
    for (a, _), out in zip(spans, kept, strict=True):
        low, high = max(a, at), min(a + out.shape[1], at + y.shape[1])
        out[:, max(low - a, 0) : max(high - a, 0)] = y[:, low - at : max(high, low) - at]


def _rows(
    row: Mapping[str, Row],
    names: Mapping[int, list[str]],
    early: Mapping[int, list[str]],
    n: int,
    lag: int,
) -> dict[int, Row]:
    """Return the rows of each block, including samples before sample 0."""
    found = {}
    for key, its in names.items():
        rows_of = [row[name][:n] for name in its]
        if early.get(key):
            pieces = zip(early[key], rows_of, strict=True)
            rows_of = [np.concatenate([row[name][:lag], its_own]) for name, its_own in pieces]
        found[key] = rows_of[0] if len(rows_of) == 1 else np.array(rows_of)
    return found


def _shown(
    blocks: list[Block],
) -> tuple[dict[str, Block], dict[int, list[str]], dict[int, list[str]]]:
    """Return outputs that show all blocks, and the names of each block's rows.

    For blocks that start before sample 0, the names of their early rows are returned
    too.
    """
    around = _loops(blocks)
    shown: dict[str, Block] = {}
    names: dict[int, list[str]] = {}
    early: dict[int, list[str]] = {}
    for b in blocks:
        if isinstance(b, Const):
            continue
        parts: list[Block] = [Pick(b, name) for name in b.outputs] if b.outputs else [b]
        parts = [reduce(lambda v, loop: Tap(loop, v), around.get(id(b), []), p) for p in parts]
        before: list[Block] = [Early(p) for p in parts] if b.autonomous else []
        for found, those in ((names, parts), (early, before)):
            found[id(b)] = [f"row{len(shown) + k}" for k in range(len(those))]
            shown |= dict(zip(found[id(b)], those, strict=True))
    return shown, names, early


def _motion_of(run: Run, inputs: Sequence[str]) -> Callable[[int, int], Row]:
    """Return the motion of a run, held constant after its last sample."""

    def motion(a: int, b: int) -> Row:
        x = np.empty((len(inputs), b - a))
        for row, name in zip(x, inputs, strict=True):
            row[: max(run.n - a, 0)] = run.x[name][a : max(min(b, run.n), a)]
            row[max(run.n - a, 0) :] = run.x[name][run.n - 1 : run.n] if b > run.n else 0.0
        return x

    return motion


def _loops(blocks: list[Block]) -> dict[int, list[Block]]:
    """Return the loops that contain each block, the outermost last.

    A loop contains the blocks that depend on its last value.
    """
    found: dict[int, list[Block]] = {}
    of = {id(b.last): b for b in blocks if isinstance(b, Loop)}
    for b in blocks:
        inside = () if isinstance(b, Subsystem) else b.children
        below = [loop for c in inside for loop in found[id(c)]]
        around = {id(v): v for v in below}
        if isinstance(b, Last):
            around = {id(of[id(b)]): of[id(b)]} | around
        elif isinstance(b, Loop | Tap):  # which show the loop's signal outside it
            around.pop(id(b.loop if isinstance(b, Tap) else b), None)
        found[id(b)] = list(around.values())
    return found


def _one(b: Block, run: Run, seen: list[Part]) -> Held:
    """Check a block's output against its law, or against what the run itself states."""
    law, error, least, samples = type(b).law or rows.LAWS.get(type_name(type(b))), 0.0, np.inf, 0
    above = 0
    none = Held(b, run.where, 0, 0.0, "no law of its output from its inputs is known")
    if law is None and not isinstance(b, Input | Param | White):
        return none
    for part in (part for part in seen if part.n):
        before, since, y = part.early(b, run.fs), 0, part.rows[id(b)]
        n, at = part.n + before, part.at - before
        if isinstance(b, Input):
            want, tol = run.x[b.name][at : at + n], 0.0
        elif isinstance(b, Param):
            want, tol = _param(b, run, part, before)
        elif isinstance(b, White):
            want, tol = (
                laws.white(run.seed, *b.noise_key, at - at % 2, n + at % 2)[at % 2 :],
                DEVIATES,
            )
        else:
            got = Rows(part.row(getattr(b, s), n) for s in signals(type(b)))
            got.at, got.rest, got.seed = at, not part.at, run.seed
            got.past = part.past.get(id(b), 0)
            if b.frequency is not None:
                above += int(np.sum(part.row(b.frequency, n)[before:] >= run.fs / 2))
            since = rows.since(b, run.fs, got) if part.at else 0
            if since >= n:
                continue
            made = _stated(law, b, run.fs, got, y)
            if made is None:
                return none
            want, tol = made
            if part.at:
                tol = tol + GONE * float(np.abs(y).max())
        cut = [np.broadcast_to(v, y.shape)[..., since:] for v in (y, want, tol)]
        limited = np.isfinite(np.atleast_2d(cut[2])).any(axis=0)
        samples += min(part.n, int(np.count_nonzero(limited)))
        error, least = max(error, _error(*cut)), min(least, _least(*cut[1:]))
    if not samples and not seen[0].n and run.n:
        return Held(b, run.where, 0, 0.0, "something in the scene is not finite at sample 0")
    return Held(b, run.where, samples, error, least=least, above=above)


def _param(b: Param, run: Run, part: Part, before: int) -> tuple[Row, float]:
    """Return a parameter's samples in a span as it was set, and their tolerance."""
    moves = [c for c in run.changes if c.name == b.name]
    after = ramped(run.params[b.name], moves, run.fs, part.at + part.n, part.at)
    want = np.r_[np.full(before, b.value), after]
    return want, (1e-12 + lost_by_ramps(moves, run.fs)) * float(np.abs(want).max())


def _stated(law: Any, b: Block, fs: float, got: Rows, y: Row) -> tuple[Row, Any] | None:
    """Return the row and the tolerance that a law gives.

    None if the law does not cover these numbers.
    """
    name = f"{type_name(type(b))}.law"
    got[:] = map(read_only, got)
    try:
        with np.errstate(all="ignore"):
            made = law(b, fs, got, read_only(y))
    except Exception as error:
        if type(b).law is None:
            raise
        raise BadValue(
            f"{name} raises {type(error).__name__}: {error}; correct it, or define no law"
        ) from error
    if made is None:
        return None
    parts = made if isinstance(made, tuple) else (made, 0.0)
    if len(parts) != 2:
        raise BadValue(
            f"{name} returned {len(parts)} things; return a row, or a row and a tolerance"
        )
    want, tol = parts
    if np.shape(want) != y.shape:
        shape = f"returned the shape {np.shape(want)}, where the block has {y.shape}"
        raise BadValue(f"{name} {shape}; return a row for each output")
    if type(b).law is not None and np.shape(tol) not in ((), y.shape):
        raise BadValue(
            f"{name} returned a tolerance of the shape {np.shape(tol)}; return a number, or a"
            " row of the shape of its output"
        )
    if type(b).law is not None and not np.all(np.asarray(tol) >= 0):
        raise BadValue(
            f"{name} returned a tolerance that is not 0 or above; return one that is, or the"
            " row alone"
        )
    return want, tol


def read_only(row: np.ndarray) -> np.ndarray:
    """Return a read-only view of a row, as several laws read it."""
    view = row.view()
    view.flags.writeable = False
    return view


def _error(y: np.ndarray, want: Any, tol: Any) -> float:
    """Return the largest difference over its tolerance; equal NaNs count as 0."""
    if np.array_equal(y, want):  # as of most blocks
        return 0.0
    want, tol = np.asarray(want, float), np.broadcast_to(tol, y.shape)
    tol = np.where(tol > 0, np.maximum(tol, FADED), tol)
    with np.errstate(all="ignore"):
        ratio = np.abs(y - want) / tol
    same = (y == want) | (np.isnan(y) & np.isnan(want)) | np.isinf(tol)
    return float(np.max(np.where(same, 0.0, np.where(np.isnan(ratio), np.inf, ratio)), initial=0.0))


def _least(want: Any, tol: Any) -> float:
    """Return the smallest relative change of a row that would be refused.

    It is at least one rounding.
    """
    with np.errstate(all="ignore"):
        part = np.asarray(tol) / np.abs(want)
    return max(
        float(np.min(part, where=np.isfinite(want) & (np.asarray(want) != 0), initial=np.inf)),
        2.0**-53,
    )


def _inside(
    b: Any, run: Run, seen: list[Part], whole: dict[int, tuple[Gated, np.ndarray]]
) -> list[Held]:
    """Check a subsystem's blocks by rendering them alone on its own clock.

    Where the subsystem runs, its samples must have the same bits, and elsewhere be 0.
    """
    before = seen[0].early(b, run.fs)
    early = seen[0].row(b.by, seen[0].n + before)[:before] > 0
    its, edges = whole.get(id(b), (Gated(), np.arange(isinstance(b.by, Const) and b.by.value > 0)))
    opened, ran = (
        np.flatnonzero(np.diff(early, prepend=False, append=False)),
        int(np.count_nonzero(early)),
    )
    clock = Clock.of(np.r_[opened, edges + before], run.n + before)
    ends = [(part.at + before * (part.at > 0), part.at + before + part.n) for part in seen]
    inside = [(clock.until(a), clock.until(z)) for a, z in ends]
    found: list[Held] = []
    alone: list[Part] = []
    if clock.total:
        params, changes = {}, [c._replace(at=c.at + ran) for c in its.changes]
        for p in (p for p in reach([b.block]) if isinstance(p, Param)):
            params[p.name] = first = its.params.get(p.name, run.params[p.name])
            if ran:
                params[p.name] = p.value
                changes += [Change(ran, p.name, first, 0.0)] if first != p.value else []
        seed = run.seed if getattr(b, "seed", None) is None else b.seed
        where = f"{run.where} in {'a segment' if isinstance(b, Segment) else 'enabled'}"
        x = {name: Inside(run.x[name], clock) for name in named([b.block], Input)}
        changes.sort(key=lambda c: c.at)
        found, alone = _held(
            Run({"y": b.block}, run.fs, seed, x, clock.total, params, changes, inside, where)
        )
    error, size = 0.0, 0
    for k, ((a, z), part) in enumerate(zip(ends, seen, strict=True)):
        y, want, places = part.rows[id(b)], np.zeros(z - a), clock.samples(*inside[k]) - a
        if places.size:
            row = alone[k].row(b.block, alone[k].n)
            want[places[: row.size]] = row
            y = y[: places[row.size] if row.size < places.size else None]
        error, size = max(error, _error(y, want[: y.size], 0.0)), size + y.size
    return [Held(b, run.where, size, error, least=2.0**-53 if clock.total else np.inf), *found]
