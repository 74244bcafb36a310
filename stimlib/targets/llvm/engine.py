"""Streaming on the CPU: one compiled segment per block class, called from a table.

Compiling a scene only fills tables; what takes time, a segment, is compiled once per
machine (``segments``, ``cache``).
"""

from __future__ import annotations

import copy
import ctypes
import math
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np

from ...blocks.noise import FilteredNoise, Modes, White
from ...core import steps
from ...core.clocks import PARAMS, ROOT, Instance
from ...core.graph import Block, Map, Pick, at_rest, pack
from ...core.parameter import Param
from ...core.program import Program, design_of, first_states, lower
from ...system.cache_folder import lock
from . import entry_points, rows
from .cache import Code, expect, load
from .segments import Form, kinds, noise_behind, segment, written

TILE = 64
_P, _I = ctypes.c_void_p, ctypes.c_int64
TOGETHER = ctypes.CFUNCTYPE(None, _P, _I, _P, _P, _I, _I, _P, _I, _I)


RUNTIME, SLOW_MODES, CONTACT, THREADS = (
    (Path(__file__).with_name(f"{name}.py").read_text(), name)
    for name in ("runtime", "slow_modes", "contact", "threads")
)


def runtime() -> Code:
    """Return the compiled runtime.

    Segments find its kernels by name, so it must be loaded before any of them.
    """
    return _part(RUNTIME, "fir", "modes")


@cache
def _part(piece: tuple[str, str], *kernels: str) -> Code:
    """Return a compiled part of the runtime, after giving its kernels their names."""
    expect([piece])
    code = load(*piece)
    for name in kernels:
        llvmlite.binding.add_symbol(f"stimlib_{name}", code.addresses[name])
    return code


# A program to a table -----------------------------------------------------------------
class _Table:
    """The rows of a program, with the indices and parameters that they use.

    A holds indices (slots), P parameter words.
    """

    def __init__(self, program: Program, design: list[tuple[Any, Any]]):
        self.program, self.design = program, design
        self.slot: dict[Any, int] = {}
        self.rows: list[tuple[int, ...]] = []
        self.P: list[np.ndarray] = []
        self.A: list[int] = []
        self.p_at, self.scratch = 0, TILE
        self.segments = [""] * len(program.instances)
        self.state = np.cumsum([0, *(pack(s).size for _, s in design)]).tolist()
        self.still = _still(program, design)
        self.listened: set[tuple[int, int]] = set()
        outputs = [*program.outputs.values()]
        self.read = {a for q in program.instances for a in q.args} | {
            i for i in outputs if outputs.count(i) > 1
        }
        self.at: dict[int, int] = {}  # the row of an instance
        for i in program.inputs.values():
            self.place(i)
        self.constants = []
        for i, q in enumerate(program.instances):
            block: Any = q.block
            if q.kind == "const":
                self.constants.append((self.place(i), block.value))
            elif q.kind == "pick":
                self.listened.add((q.args[0], block.place))
        works: list[int] = []
        order = _order(program, design)
        expect(
            written(self.form(group))
            for group in order
            if (q := program.instances[group[0]]).kind == "block"
            and q.block.definition not in rows.OPERATIONS
        )
        runtime()
        ends = {i: (i,) for i in outputs if i not in self.read}
        for group in (*(g for g in order if g[0] not in ends), *ends.values()):
            self.add(group)
            if program.instances[group[0]].block.definition.work:
                works.append(len(self.A) - 1)
        self.main, self.outputs_at = len(self.rows) - len(ends), len(self.A)
        self.A += [self.at[i] for i in outputs]
        for j in works:
            self.A[j] = len(self.slot) * TILE

    def place(self, key: Any) -> int:
        """Return the slot of a signal, assigning one if necessary."""
        return self.slot.setdefault(key, len(self.slot) * TILE)

    def arg(self, i: int, clock: int) -> int:
        """Return the slot of an argument.

        A parameter or an input is first gathered onto a child clock.
        """
        q = self.program.instances[i]
        if q.kind == "pick":
            return self.slot["output", q.args[0], q.block.place]  # type: ignore[attr-defined]
        if q.kind == "const" or clock <= ROOT or (q.clock != PARAMS and q.kind != "input"):
            return self.place(i)
        if (i, clock) not in self.slot:
            words = [self.place(i), self.place((i, clock))]
            self.row(rows.GATHER, i, words, 0, clock, q.clock == PARAMS)
        return self.slot[i, clock]

    def places(self, i: int) -> list[int]:
        """Return the slots of a block's outputs, in order."""
        count = len(self.program.instances[i].block.outputs)
        return [self.place(("output", i, j)) for j in range(count)] or [self.place(i)]

    def row(self, address: int, i: int, words: list[int], p: int, clock: int, stands: bool) -> None:
        autonomous = self.program.instances[i].autonomous
        self.at[i], read = len(self.rows), i in self.read
        self.rows.append((address, p, self.state[i], len(self.A), clock, autonomous, stands, read))
        self.A.extend(words)

    def add(self, group: tuple[int, ...]) -> None:
        """Add the row of an instance, or of two that run side by side."""
        i, p = group[0], 0
        q = self.program.instances[i]
        cls = q.block.definition
        if q.kind == "pick":
            return
        if q.kind == "open":
            address, words = rows.OPEN, [self.arg(q.args[0], q.clock), q.child]
        elif q.kind == "close":
            address = rows.CLOSE
            words = [self.arg(q.args[1], q.child), self.place(i), q.child]
        elif cls in rows.OPERATIONS:
            address = rows.OPERATION + rows.OPERATIONS.index(cls)
            words = [*(self.arg(a, q.clock) for a in q.args), self.place(i)]
        else:
            address, words, p = self.call(group)
        self.row(address, i, words, p, q.clock, self.still[i])

    def call(self, group: tuple[int, ...]) -> tuple[int, list[int], int]:
        """Return address, words and parameters of a segment of one block or of two."""
        i, instances = group[0], self.program.instances
        q, cls = instances[i], instances[i].block.definition
        form = self.form(group)
        if "memory" in written(form)[0]:
            _part(SLOW_MODES, "memory", "moving_memory", "chebyshev")
        compiled = segment(form)
        resets = cls.resettable and not _always(instances[q.args[-1]])
        rest = pack(at_rest(self.design[i][1])) if resets else np.zeros(0, np.uint64)
        address, words, starts = compiled.addresses["_sl_segment"], [], []
        for k, part in zip(group, form.parts, strict=True):
            self.segments[k] = compiled.name
            p, s = self.design[k]
            args = instances[k].args[: part.inputs]
            words += [*(self.arg(a, q.clock) for a in args), *self.places(k)]
            sizes = [v.size for v in s if isinstance(v, np.ndarray)]
            if part.cls.work:
                sizes.append(part.cls.work(p))
                self.scratch = max(self.scratch, sizes[-1])
            self.P.append(np.concatenate([_parameter_words(p, sizes), rest]))
            starts.append(self.p_at)
            self.p_at += self.P[-1].size
        for k, start in zip(group[1:], starts[1:], strict=True):
            words += [start - starts[0], self.state[k] - self.state[i]]
        if noise_behind(form):
            noise = segment(self.form(group[:1])).addresses["_sl_segment"]
            words += [self.place(("ahead", i)), self.place(("mark", i)), noise, words[0]]
        if resets:
            outs, at = self.places(i), self.p_at - starts[0] - rest.size
            contact = self.arg(q.args[-1], q.clock)
            words = [contact, outs[0], len(outs), at, rest.size, address, *words]
            address = _part(CONTACT).addresses["stretches"]
        if cls.work:
            words.append(-1)  # the slot of the scratch, which is behind all others
        return address, words, starts[0]

    def form(self, group: tuple[int, ...]) -> Form:
        (p, s), q = self.design[group[0]], self.program.instances[group[0]]
        cls = q.block.definition
        f = cls.tile or cls.step
        assert f is not None, f"{cls.__name__} has neither step nor tile"
        meaning = () if str(f.__module__).startswith("stimlib.") else steps.meaning(f)
        outputs = range(len(cls.outputs))
        read = tuple((group[0], j) in self.listened for j in outputs) or (True,)
        types = type(p), kinds(p), type(s), kinds(s)
        inputs = q.args[: len(q.args) - cls.resettable]
        constants = tuple(self.program.instances[a].kind == "const" for a in inputs)
        return Form(
            cls,
            (f.__code__, meaning),
            *types,
            inputs=len(inputs),
            beside=tuple(self.form((k,)) for k in group[1:]),
            read=read,
            fixed=() if cls.tile else constants,
        )


class Engine:
    """Tables and memory of one compiled program; ``words`` is its whole state."""

    def __init__(self, program: Program, design: list[tuple[Any, Any]], fs: float):
        table = _Table(program, design)
        self.segments, self._constants = table.segments, table.constants
        self.table = np.array(table.rows, np.int64).reshape(-1, 8)
        self.P = np.concatenate(table.P) if table.P else np.zeros(1, np.uint64)
        self.A = np.array(table.A, np.int64)
        self.size = table.state[-1]
        self._place = {i: table.state[i] for i in program.params.values()}
        self._param = {i: j for j, i in enumerate(program.params.values())}
        self._empty = np.zeros((len(program.inputs), 0)), np.zeros((len(program.outputs), 0))
        self._main, self._outs_at, self._clocks = table.main, table.outputs_at, len(program.parents)
        # a stretch may begin late in its tile
        self._buffers = len(table.slot) * TILE + table.scratch + TILE
        self._allot()

    def _allot(self) -> None:
        """Allocate the memory of one run, in whole cache lines.

        Threads that run copies then never write to the same line.
        """
        machine, params, clocks = runtime().addresses, len(self._param), self._clocks
        words = max(self.size, 1), self._buffers, clocks, clocks * 2 * TILE, 8 * max(1, params), 21
        ends = np.cumsum([-(-n // 8) * 8 for n in words])
        memory = np.zeros(ends[-1] + 8, np.uint64)
        self.nbytes = memory.nbytes
        first = -memory.ctypes.data // 8 % 8
        self.S, W, *rest = np.split(memory[first : first + ends[-1]], ends[:-1])
        self.W = W.view(np.float64)
        self.N, self.index, pending, self.ctx = (a.view(np.int64) for a in rest)
        self.index[(2 * ROOT + 1) * TILE : (2 * ROOT + 2) * TILE] = range(TILE)
        self.pending = pending.reshape(-1, 8)
        for k, v in self._constants:
            self.W[k : k + TILE] = v
        for i, j in self._param.items():
            self.pending[j, 1] = self._place[i]
        arrays = {1: self.table, 2: self.P, 3: self.S, 4: self.W, 5: self.A, 9: self.N}
        for k, a in (arrays | {10: self.index, 13: self.pending}).items():
            self.ctx[k] = a.ctypes.data
        self.ctx[0], self.ctx[14], self.ctx[16] = self._main, params, machine["entry"]
        self.ctx[6:9] = *(a.shape[0] for a in self._empty), self._outs_at
        self.ctx[11:13] = clocks, -1
        known = entry_points.array_words()
        self.ctx[18:20] = known or 0
        self.address = int(machine["entry"]), int(self.ctx.ctypes.data)
        self.process = (
            entry_points.function(machine["process"], self.address[1])
            if known
            else entry_points.checked(*self.address, (self.ctx[6], self.ctx[7]))
        )
        """process(x, out): fill out (n_outputs, n) from x (n_inputs, n); nonzero when
        they are no such arrays.
        """

    def copy(self) -> Engine:
        """Return an independent run of the same compiled program.

        Its memory is its own; all tables are shared.
        """
        other = copy.copy(self)
        other._allot()
        return other

    @staticmethod
    def together(
        engines: Sequence[Engine],
    ) -> Callable[[np.ndarray, np.ndarray, np.ndarray], object]:
        """Return a function run(turn, x, out), to be called by each of several threads.

        Without holding Python's lock, it runs those copies of a program that no other
        thread has taken. turn is one number, 0 at the start; x (1 or copies, n_inputs,
        n) and out (copies, n_outputs, n) must fit.
        """
        contexts = np.array([e.ctx.ctypes.data for e in engines])
        process = TOGETHER(_part(THREADS).addresses["process"])

        def run(
            turn: np.ndarray, x: np.ndarray, out: np.ndarray, kept: object = tuple(engines)
        ) -> None:
            """Run copies; the engines live as long as this function."""
            of_x, of_y = (math.prod(a.shape[1:]) for a in (x, out))
            first, rows = contexts.ctypes.data, (x.ctypes.data, x.shape[0], of_x)
            to = out.ctypes.data, of_y, out.shape[2]
            process(first, contexts.size, turn.ctypes.data, *rows, *to)

        return run

    @staticmethod
    def start(block: Block, p: Any, s: Any, seed: int) -> Any:
        """Return the first state of a block, drawn from compiled noise."""
        return (
            block.start(p, s, seed, normals)
            if isinstance(block, FilteredNoise)
            else block.start(p, s, seed)
        )

    def warm(self, clocks: Sequence[int], n: int) -> None:
        """Run only blocks that no input reaches, for n samples of some clocks.

        None of these clocks may run another.
        """
        early = np.array(clocks, np.int64)
        self.ctx[12], self.ctx[20] = early.size, early.ctypes.data
        entry_points.ENTRY(self.address[0])(self.address[1], None, None, n)  # without signals
        self.ctx[12] = -1

    def set(self, i: int, target: float, left: float) -> None:
        """Ramp parameter instance i to a target over ``left`` samples, starting now."""
        q, at_once = self.pending[self._param[i]], left <= 1.0  # see runtime: pending
        target, left = np.array([target, left]).view(np.int64)
        if at_once:
            q[2:5] = target, 0, target
            q[0] = 2
        else:
            q[2:4] = target, left
            q[0] = max(1, q[0])

    @property
    def count(self) -> int:
        """Number of samples processed."""
        return int(self.ctx[15])

    @count.setter
    def count(self, n: int) -> None:
        self.ctx[15] = n

    def peek(self) -> np.ndarray:
        """Return the states without side effects.

        It is safe while another thread runs the program.
        """
        return self.S[: self.size].copy()

    @property
    def words(self) -> np.ndarray:
        """All states in canonical order (a copy)."""
        self.process(*self._empty)  # takes pending settings in
        return self.S[: self.size].copy()

    @words.setter
    def words(self, w: np.ndarray) -> None:
        self.pending[:, 0] = 0
        self.ctx[17] = 0  # parameters may have moved
        self.S[: self.size] = w


@cache
def _white() -> Engine:
    program = lower({"white": White(0)})
    design = design_of(program, 1000.0)  # deviates are the same at every rate
    engine = Engine(program, design, 1000.0)
    engine.words = first_states(program, design)(0)
    return engine


def normals(key: np.uint64, n: int) -> np.ndarray:
    """Return the first n deviates of a stream, as ``stimlib.blocks.noise.normals``.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.blocks import noise
    >>> from stimlib.targets.llvm.engine import normals
    >>> bool(np.all(normals(np.uint64(7), 5) == noise.normals(np.uint64(7), 5)))
    True
    """
    y = np.empty((1, n))
    with lock:
        engine = _white()
        engine.S[0], engine.S[1] = key, 0  # see WhiteState
        engine.process(np.empty((0, n)), y)
    return y[0]


def _always(q: Instance) -> bool:
    """Return whether a contact is a constant number above 0."""
    return q.kind == "const" and q.block.value > 0.0  # type: ignore[attr-defined]


def _still(program: Program, design: list[tuple[Any, Any]]) -> list[bool]:
    """Return for each instance whether it is constant while no parameter changes.

    Such instances are parameters, constants, and maps of them.
    """
    still: list[bool] = []
    for q, (_, s) in zip(program.instances, design, strict=True):
        maps = q.kind in ("block", "pick") and isinstance(q.block, Map | Pick) and not s
        of_them = maps and bool(q.args) and all(still[a] for a in q.args)
        still.append(of_them or q.kind == "const" or isinstance(q.block, Param))
    return still


NEAR = 16
"""So many blocks at most run earlier than written, for two recursions to stand side by
side.
"""


NOISE, BANK = White.tile, Modes.tile
"""Tiles that run in one segment; a class that has another is not put into it."""


def _order(program: Program, design: list[tuple[Any, Any]]) -> list[tuple[int, ...]]:
    """Return groups of instances in running order.

    Two instances of one class that step on one clock run in one loop, each during the
    other's latency. So do white noise and the first bank of modes that filters it.
    """
    instances = program.instances
    behind: dict[int, int] = {}
    for i, q in enumerate(instances):
        if q.kind == "block" and q.block.definition.tile is BANK:
            white = instances[q.args[0]]
            if white.block.definition.tile is NOISE and white.clock == q.clock:
                behind.setdefault(q.args[0], i)
    opened = {q.child: i for i, q in enumerate(instances) if q.kind == "open"}
    done = [q.kind in ("const", "input") for q in instances]
    keys = [_recursion(program, design, i) for i in range(len(instances))]
    alike: dict[Any, list[int]] = {None: []}
    for i in reversed(range(len(instances))):
        if keys[i]:
            alike.setdefault(keys[i], []).append(i)

    order: list[tuple[int, ...]] = []
    for i, key in enumerate(keys):
        if done[i]:
            continue
        group: tuple[int, ...] = (i,)
        if i in behind:
            group = i, behind[i]
        others = alike[key]
        while others and (done[others[-1]] or others[-1] <= i):
            others.pop()
        first = _before(instances, opened, done, others[-1]) if others else None
        if first is None or i in first:
            first = []
        else:
            group = i, others.pop()
        order += [*((k,) for k in first), group]
        for k in (*first, *group):
            done[k] = True
    return order


def _before(
    instances: list[Instance], opened: dict[int, int], done: list[bool], j: int
) -> list[int] | None:
    """Return the instances that must still run before another; None if many."""
    found: set[int] = set()
    todo = [j]
    while todo and len(found) <= NEAR:
        q = instances[todo.pop()]
        need = {*q.args, opened[q.clock]} if q.clock > ROOT else {*q.args}
        new = {a for a in need - found if not done[a]}
        found |= new
        todo += new
    return None if todo else sorted(found)


def _recursion(program: Program, design: list[tuple[Any, Any]], i: int) -> Any:
    """Return what two instances must have in common to step side by side.

    None if an instance cannot.
    """
    q, (p, s) = program.instances[i], design[i]
    cls = q.block.definition
    alone = (
        q.kind != "block"
        or cls.tile
        or cls.outputs
        or not s
        or any(isinstance(v, np.ndarray) for v in s)
    )
    if alone or (cls.resettable and not _always(program.instances[q.args[-1]])):
        return None
    return cls, type(p), kinds(p), type(s), kinds(s), q.clock, q.autonomous


def _parameter_words(p: Any, sizes: list[int]) -> np.ndarray:
    """Return the parameter words of one row.

    They are numbers, (offset, size) of arrays, sizes of state arrays and scratch; then
    the arrays.
    """
    arrays = [pack((v,)) for v in p if isinstance(v, np.ndarray)]
    end = len(p) + len(arrays) + len(sizes)
    words: list[np.ndarray] = []
    for v in p:
        if isinstance(v, np.ndarray):
            words.append(np.array([end, v.size], np.uint64))
            end += v.size
        else:
            words.append(pack((v,)))
    return np.concatenate([*words, np.array(sizes, np.uint64), *arrays])
