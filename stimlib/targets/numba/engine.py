"""Streaming on the CPU: one compiled segment per block class, called from a table.

Compiling a scene only fills tables; what takes time, a segment, is compiled once per
machine (``segments``, ``cache``).
"""

from __future__ import annotations

import copy
import threading
import types
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np

from ...blocks.noise import PinkNoise, White
from ...core import steps
from ...core.graph import Block, Map, Param, Pick, at_rest, pack
from ...core.program import PARAMS, ROOT, Instance, Program, design_of, first_states, lower
from . import calls, lanes
from .cache import load
from .segments import Form, kinds, segment

TILE = 64


KERNELS = "fir", "modes", "memory"


@cache
def runtime() -> types.ModuleType:
    """The compiled runtime; segments find its kernels by name, so none can be loaded
    before.
    """
    module = load(Path(__file__).with_name("runtime.py").read_text(), "runtime")
    for name in KERNELS:
        llvmlite.binding.add_symbol(f"stimlib_{name}", getattr(module, name).address)
    return module


@cache
def _together() -> types.ModuleType:
    return load(Path(__file__).with_name("together.py").read_text(), "together")


# A program to a table -----------------------------------------------------------------
class Engine:
    """Tables and memory of one compiled program; ``words`` is its whole state."""

    def __init__(self, program: Program, design: list[tuple[Any, Any]], fs: float):
        machine = runtime()
        instances, clocks = program.instances, len(program.parents)
        slot: dict[Any, int] = {}
        for i in program.inputs.values():
            slot[i] = len(slot) * TILE
        P: list[np.ndarray] = []
        p_at = 0
        A: list[int] = []
        rows: list[tuple[int, ...]] = []
        self.segments: list[str] = [""] * len(instances)
        state = np.cumsum([0, *(pack(s).size for _, s in design)]).tolist()
        self._place = {i: state[i] for i in program.params.values()}
        still = _still(program, design)
        constants = []
        scratch = TILE
        work_slots: list[int] = []

        def place(key: Any) -> int:
            return slot.setdefault(key, len(slot) * TILE)

        def row(
            address: int,
            i: int,
            words: list[int],
            p: int = 0,
            clock: int | None = None,
            stands: bool = False,
        ) -> None:
            q = instances[i]
            rows.append(
                (
                    address,
                    p,
                    state[i],
                    len(A),
                    q.clock if clock is None else clock,
                    q.autonomous,
                    stands,
                    0,
                )
            )
            A.extend(words)

        def arg(i: int, clock: int) -> int:
            """Slot of an argument; a parameter or an input is first gathered onto a
            child clock.
            """
            q = instances[i]
            if q.kind == "pick":
                return slot["output", q.args[0], q.block.place]  # type: ignore[attr-defined]
            if q.kind == "const" or clock <= ROOT or (q.clock != PARAMS and q.kind != "input"):
                return place(i)
            if (i, clock) not in slot:
                row(
                    machine.GATHER,
                    i,
                    [place(i), place((i, clock))],
                    clock=clock,
                    stands=q.clock == PARAMS,
                )
            return slot[i, clock]

        def parameters(words: np.ndarray, payload: list[np.ndarray]) -> int:
            nonlocal p_at
            P.extend([words, *payload])
            p_at += words.size + sum(v.size for v in payload)
            return p_at - words.size - sum(v.size for v in payload)

        def places(i: int) -> list[int]:
            """Slots of a block's outputs, one after the other."""
            names = instances[i].block.outputs
            return [place(("output", i, j)) for j in range(len(names))] if names else [place(i)]

        listened = {(q.args[0], q.block.place) for q in instances if q.kind == "pick"}  # type: ignore[attr-defined]
        for i, q in enumerate(instances):
            if q.kind == "const":
                constants.append((place(i), q.block.value))  # type: ignore[attr-defined]
        for together in _order(program, design):
            i = together[0]
            q = instances[i]
            cls = q.block.definition
            if q.kind == "pick":
                continue
            if q.kind == "open":
                row(machine.OPEN, i, [arg(q.args[0], q.clock), q.child])
            elif q.kind == "close":
                row(machine.CLOSE, i, [arg(q.args[1], q.child), place(i), q.child])
            elif cls in lanes.OPERATIONS:
                words = [arg(a, q.clock) for a in q.args]
                row(
                    machine.OPERATION + lanes.OPERATIONS.index(cls),
                    i,
                    [*words, place(i)],
                    stands=still[i],
                )
            else:
                p, s = design[i]
                f = cls.tile or cls.step
                assert f is not None, f"{cls.__name__} has neither step nor tile"
                contact = instances[q.args[-1]] if cls.resettable else None
                resets = contact is not None and not _always(contact)
                count = len(q.args) - cls.resettable
                code = (
                    f.__code__,
                    (() if str(f.__module__).startswith("stimlib.") else steps.meaning(f)),
                )
                read = tuple((i, j) in listened for j in range(len(cls.outputs))) or (True,)
                form = Form(
                    cls, code, type(p), kinds(p), type(s), kinds(s), count, len(together), read
                )
                compiled = segment(form)
                address, words, at = compiled._sl_segment.address, [], []
                for k in together:
                    self.segments[k] = compiled.__name__
                    p, s = design[k]
                    sizes = [v.size for v in s if isinstance(v, np.ndarray)]
                    words += [*(arg(a, q.clock) for a in instances[k].args[:count]), *places(k)]
                    if cls.work:
                        sizes.append(cls.work(p))
                        scratch = max(scratch, sizes[-1])
                    numbers, payload = _parameter_words(p, sizes)
                    at.append(
                        parameters(numbers, [*payload, *([pack(at_rest(s))] if resets else [])])
                    )
                words += [
                    w
                    for k, p_of in zip(together[1:], at[1:], strict=True)
                    for w in (p_of - at[0], state[k] - state[i])
                ]
                if resets:
                    rest = pack(at_rest(s))
                    outs = places(i)
                    words = [
                        arg(q.args[-1], q.clock),
                        outs[0],
                        len(outs),
                        p_at - at[0] - rest.size,
                        rest.size,
                        address,
                        *words,
                    ]
                    address = machine.RESETTABLE
                if cls.work:
                    work_slots.append(len(A) + len(words))
                    words.append(-1)
                row(address, i, words, at[0], stands=still[i])
        outs_at = len(A)
        A += [slot[o] for o in program.outputs.values()]
        for j in work_slots:
            A[j] = len(slot) * TILE
        self.table = np.array(rows, np.int64).reshape(-1, 8)
        self.P = np.concatenate([np.zeros(0, np.uint64), *P]) if P else np.zeros(1, np.uint64)
        self.A = np.array(A, np.int64)
        self._param = {i: j for j, i in enumerate(program.params.values())}
        self.size = state[-1]
        self._empty = np.zeros((len(program.inputs), 0)), np.zeros((len(program.outputs), 0))
        self._constants = constants
        self._outs_at, self._clocks = outs_at, clocks
        self._buffers = len(slot) * TILE + scratch + TILE  # a stretch may begin late in its tile
        self._allot()

    def _allot(self) -> None:
        """Memory of one run, in whole lines of the cache: threads that run copies write
        into no line of each other.
        """
        machine, params = runtime(), len(self._param)
        words = (
            max(self.size, 1),
            self._buffers,
            self._clocks,
            self._clocks * 2 * TILE,
            4 * max(1, params),
            20,
        )
        ends = np.cumsum([-(-n // 8) * 8 for n in words])
        memory = np.zeros(ends[-1] + 8, np.uint64)
        self.nbytes = memory.nbytes
        first = -memory.ctypes.data // 8 % 8
        self.S, W, *rest = np.split(memory[first : first + ends[-1]], ends[:-1])
        self.W = W.view(np.float64)
        self.N, self.index, pending, self.ctx = (a.view(np.int64) for a in rest)
        self.pending = pending.reshape(-1, 4)
        for k, v in self._constants:
            self.W[k : k + TILE] = v
        for i, j in self._param.items():
            self.pending[j, 1] = self._place[i]
        self.ctx[:17] = [
            len(self.table),
            *(a.ctypes.data for a in (self.table, self.P, self.S, self.W, self.A)),
            self._empty[0].shape[0],
            self._empty[1].shape[0],
            self._outs_at,
            self.N.ctypes.data,
            self.index.ctypes.data,
            self._clocks,
            -1,
            self.pending.ctypes.data,
            params,
            0,
            machine.entry.address,
        ]
        self.ctx[18:20] = calls.array_words()
        self.address = int(machine.entry.address), int(self.ctx.ctypes.data)
        self.process = calls.function(machine.process.address, self.address[1])
        """process(x, out): fill out (n_outputs, n) from x (n_inputs, n); nonzero when
        they are no such arrays.
        """

    def copy(self) -> Engine:
        """Another run of the same program: with memory of its own, all tables
        shared.
        """
        other = copy.copy(self)
        other._allot()
        return other

    @staticmethod
    def together(
        engines: Sequence[Engine],
    ) -> Callable[[np.ndarray, np.ndarray, np.ndarray], object]:
        """run(turn, x, out), for each of several threads: what of copies of one program
        no other thread has taken, without Python's lock.  turn is one number, 0 at the
        start; x (1 or copies, n_inputs, n) and out (copies, n_outputs, n) fit.
        """
        contexts, process = np.array([e.ctx.ctypes.data for e in engines]), _together().process

        def run(
            turn: np.ndarray, x: np.ndarray, out: np.ndarray, kept: object = tuple(engines)
        ) -> None:
            """A thread whose caller was interrupted goes on for a while: what it runs
            lives as long.
            """
            process(contexts, turn, x, out)

        return run

    @staticmethod
    def start(block: Block, p: Any, s: Any, seed: int) -> Any:
        """The first state of a block in a run with this seed: that of the block, drawn
        from compiled noise.
        """
        return (
            block.start(p, s, seed, normals)
            if isinstance(block, PinkNoise)
            else block.start(p, s, seed)
        )

    def warm(self, clock: int, n: int) -> None:
        """Run only what is autonomous, for n samples of one clock."""
        self.ctx[12] = clock
        self.process(np.zeros((len(self._empty[0]), n)), np.zeros((len(self._empty[1]), n)))
        self.ctx[12] = -1

    def set(self, i: int, target: float, left: float) -> None:
        """Send Param instance i towards target over so many samples, from the next
        sample on.
        """
        q = self.pending[self._param[i]]
        q[2:4] = np.array([target, left]).view(np.int64)
        q[0] = 1

    @property
    def count(self) -> int:
        """Samples processed."""
        return int(self.ctx[15])

    @count.setter
    def count(self, n: int) -> None:
        self.ctx[15] = n

    def peek(self) -> np.ndarray:
        """The states as they are, without touching anything; safe while another thread
        runs the program.
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


_one = threading.Lock()


@cache
def _white() -> Engine:
    program = lower({"white": White(0)})
    design = design_of(program, 1000.0)  # deviates are the same at every rate
    engine = Engine(program, design, 1000.0)
    engine.words = first_states(program, design)(0)
    return engine


def normals(key: np.uint64, n: int) -> np.ndarray:
    """The first n deviates of a stream, as ``stimlib.blocks.noise.normals``.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.blocks import noise
    >>> from stimlib.targets.numba.engine import normals
    >>> bool(np.all(normals(np.uint64(7), 5) == noise.normals(np.uint64(7), 5)))
    True
    """
    y = np.empty((1, n))
    with _one:
        engine = _white()
        engine.S[0], engine.S[1] = key, 0  # see WhiteState
        engine.process(np.empty((0, n)), y)
    return y[0]


def _always(q: Instance) -> bool:
    """Whether a contact is a number above 0."""
    return q.kind == "const" and q.block.value > 0.0  # type: ignore[attr-defined]


def _still(program: Program, design: list[tuple[Any, Any]]) -> list[bool]:
    """What is one number as long as no parameter moves: those, and maps of them."""
    still: list[bool] = []
    for q, (_, s) in zip(program.instances, design, strict=True):
        of_them = (
            q.kind in ("block", "pick") and not s and bool(q.args) and all(still[a] for a in q.args)
        )
        still.append(
            q.kind == "const"
            or isinstance(q.block, Param)
            or (of_them and isinstance(q.block, Map | Pick))
        )
    return still


NEAR = 16
"""So many blocks at most run earlier than written, for two recursions to stand side by
side.
"""


def _order(program: Program, design: list[tuple[Any, Any]]) -> list[tuple[int, ...]]:
    """Instances in running order; two of one class that step along one clock run in one
    loop, each in the other's latency.
    """
    instances = program.instances
    opened = {q.child: i for i, q in enumerate(instances) if q.kind == "open"}
    done = [q.kind in ("const", "input") for q in instances]
    alike: dict[Any, list[int]] = {}
    for i in reversed(range(len(instances))):
        if key := _recursion(program, design, i):
            alike.setdefault(key, []).append(i)

    def before(j: int) -> list[int] | None:
        """What must run before an instance and has not; None if that is much."""
        found: set[int] = set()
        todo = [j]
        while todo and len(found) <= NEAR:
            q = instances[todo.pop()]
            need = [
                a
                for a in (*q.args, *((opened[q.clock],) if q.clock > ROOT else ()))
                if not done[a] and a not in found
            ]
            found.update(need)
            todo += need
        return None if todo else sorted(found)

    order: list[tuple[int, ...]] = []
    for i in range(len(instances)):
        if done[i]:
            continue
        group: tuple[int, ...] = (i,)
        if key := _recursion(program, design, i):
            others = alike[key]
            while others and (done[others[-1]] or others[-1] <= i):
                others.pop()
            first = before(others[-1]) if others else None
            if first is not None and i not in first:
                order += [(k,) for k in first]
                group = (i, others.pop())
                for k in first:
                    done[k] = True
        for k in group:
            done[k] = True
        order.append(group)
    return order


def _recursion(program: Program, design: list[tuple[Any, Any]], i: int) -> Any:
    """What two instances have in common that can step side by side; None where one
    cannot.
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


def _parameter_words(p: Any, sizes: list[int]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Words of one row: numbers, (offset, size) of arrays, sizes of state arrays and
    scratch; then the arrays.
    """
    arrays = [np.ascontiguousarray(v).view(np.uint64) for v in p if isinstance(v, np.ndarray)]
    end = sum(2 if isinstance(v, np.ndarray) else 1 for v in p) + len(sizes)
    words: list[np.ndarray] = []
    for v in p:
        if isinstance(v, np.ndarray):
            words.append(np.array([end, v.size], np.uint64))
            end += v.size
        else:
            words.append(pack((v,)))
    words.append(np.array(sizes, np.uint64))
    return np.concatenate(words), arrays
