"""Streaming on the CPU: one compiled segment per form of block, called from a table.

Compiling a scene only fills tables; what takes time, a segment, is compiled once per
machine (``segments``, ``cache``).
"""

from __future__ import annotations

import copy
import ctypes
import itertools
import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding
import numpy as np

from ...blocks.noise import FilteredNoise, Modes, White
from ...core import steps
from ...core.clocks import PARAMS, ROOT, Instance
from ...core.graph import Block, Map, Pick, at_rest, pack
from ...core.parameter import Param
from ...core.program import Program, design_of, first_states, lower
from ...system.cache_folder import lock
from . import entry_points, lanes, rows
from .cache import Code, load
from .segments import Form, chained, kinds, noise_behind, plan, segment, written

TILE = 64  # samples at most in one turn; the runtime and the kernels have it spelled out
_P, _I = ctypes.c_void_p, ctypes.c_int64
TOGETHER = ctypes.CFUNCTYPE(None, _P, _I, _P, _P, _I, _I, _P, _I, _I)


RUNTIME, SLOW_MODES, CONTACT, THREADS = (
    (Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8"), name)
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
    code = load(*piece)
    for name in kernels:
        llvmlite.binding.add_symbol(f"stimlib_{name}", code.addresses[name])
    return code


# A program to a table -----------------------------------------------------------------
class _Table:
    """The rows of a program, with the indices and parameters that they use.

    ``operands`` and ``numbers`` hold what compiled code knows as A (the slots of a
    row's signals, and what else it needs) and P (numbers of its blocks). A slot is the
    memory of one signal in W, for one tile, and given by its first word.
    """

    def __init__(self, program: Program, design: list[tuple[Any, Any]]):
        self.program, self.design = program, design
        self.slots: dict[Any, int] = {}
        self.fresh, self.free = itertools.count(0, TILE), list[int]()  # slots for later rows
        self.rows: list[tuple[int, ...]] = []
        self.numbers: list[np.ndarray] = []
        self.operands: list[int] = []
        self.numbers_at, self.scratch = 0, TILE  # words so far; the most that a tile needs
        self.segments = [""] * len(program.instances)
        self.state = np.cumsum([0, *(pack(state).size for _, state in design)]).tolist()
        self.still = _still(program, design)
        self.listened: set[tuple[int, int]] = set()  # (instance, output) that a pick takes
        outputs = [*program.outputs.values()]
        self.readers: dict[int, set[int]] = {}
        for index, instance in enumerate(program.instances):
            for argument in instance.args:
                self.readers.setdefault(argument, set()).add(index)
        self.read = {*self.readers} | {index for index in outputs if outputs.count(index) > 1}
        # what is made anew for each tile, and read in it alone
        self.passing = {
            index
            for index, instance in enumerate(program.instances)
            if instance.kind in ("block", "close")
            and not (self.still[index] or instance.block.outputs)
        } - {*outputs}
        self.at: dict[int, int] = {}  # the row of an instance
        # inputs first: the runtime copies input j to slot j
        for index in program.inputs.values():
            self.slot(index)
        self.constants = []
        for index, instance in enumerate(program.instances):
            block: Any = instance.block
            if instance.kind == "const":
                self.constants.append((self.slot(index), block.value))
            elif instance.kind == "pick":
                self.listened.add((instance.args[0], block.output_index))
        works: list[int] = []
        order = _rows(program, _order(program, design), self.still)
        # before any segment, which is linked to the kernels
        runtime()
        # guards whose output nobody reads run last: they write where the caller wants
        # it, while their tile is checked. An output that is read, or there twice, needs
        # a buffer.
        ends = {index: (index,) for index in outputs if index not in self.read}
        for group in (*(members for members in order if members[0] not in ends), *ends.values()):
            self.add(group)
            self.release(group)
            if program.instances[group[0]].block.definition.work:
                works.append(len(self.operands) - 1)
        self.main, self.outputs_at = len(self.rows) - len(ends), len(self.operands)
        self.operands += [self.at[index] for index in outputs]
        # one scratch for all, behind the last slot, which was not known before
        self.memory = next(self.fresh)
        for word in works:
            self.operands[word] = self.memory

    def slot(self, key: Any) -> int:
        """Return the slot of a signal, assigning one if necessary."""
        if key not in self.slots:
            self.slots[key] = (
                self.free.pop() if self.free and key in self.passing else next(self.fresh)
            )
        return self.slots[key]

    def release(self, group: tuple[int, ...]) -> None:
        """Let later rows have the slots that nobody reads after this group."""
        for member in group:
            for argument in {*self.program.instances[member].args}:
                self.readers[argument].discard(member)
                # what stays in registers has no slot
                if (
                    not self.readers[argument]
                    and argument in self.passing
                    and argument in self.slots
                ):
                    self.free.append(self.slots[argument])

    def arg(self, index: int, clock: int) -> int:
        """Return the slot of an argument.

        A parameter or an input is first gathered onto a child clock.
        """
        instance = self.program.instances[index]
        if instance.kind == "pick":
            return self.slots[
                "output",
                instance.args[0],
                instance.block.output_index,  # type: ignore[attr-defined]
            ]
        if (
            instance.kind == "const"
            or clock <= ROOT
            or (instance.clock != PARAMS and instance.kind != "input")
        ):
            return self.slot(index)
        if (index, clock) not in self.slots:
            operands = [self.slot(index), self.slot((index, clock))]
            self.row(rows.GATHER, index, operands, 0, clock, instance.clock == PARAMS)
        return self.slots[index, clock]

    def output_slots(self, index: int) -> list[int]:
        """Return the slots of a block's outputs, in order."""
        count = len(self.program.instances[index].block.outputs)
        return [self.slot(("output", index, output)) for output in range(count)] or [
            self.slot(index)
        ]

    def row(
        self, address: int, index: int, operands: list[int], numbers: int, clock: int, stands: bool
    ) -> None:
        autonomous = self.program.instances[index].autonomous
        self.at[index], read = len(self.rows), index in self.read
        self.rows.append(
            (
                address,
                numbers,
                self.state[index],
                len(self.operands),
                clock,
                autonomous,
                stands,
                read,
            )
        )
        self.operands.extend(operands)

    def add(self, group: tuple[int, ...]) -> None:
        """Add the row of an instance, or of several that run side by side."""
        index, numbers = group[0], 0
        instance = self.program.instances[index]
        cls = instance.block.definition
        if instance.kind == "pick":
            return
        if instance.kind == "open":
            address, operands = (
                rows.OPEN,
                [self.arg(instance.args[0], instance.clock), instance.child],
            )
        elif instance.kind == "close":
            address = rows.CLOSE
            operands = [
                self.arg(instance.args[1], instance.child),
                self.slot(index),
                instance.child,
            ]
        elif _operation(instance) and len(group) > 1:
            text, given, read = self.chain(group)
            operands = [self.arg(argument, instance.clock) for argument in given]
            operands += [self.slot(member) for member in read]
            address = load(*text, partial(chained, *text)).addresses["_sl_segment"]
        elif _operation(instance):
            address = rows.OPERATION + rows.OPERATIONS.index(cls)
            operands = [
                *(self.arg(argument, instance.clock) for argument in instance.args),
                self.slot(index),
            ]
        else:
            address, operands, numbers = self.call(group)
        self.row(address, index, operands, numbers, instance.clock, self.still[index])

    def chain(self, group: tuple[int, ...]) -> tuple[tuple[str, str], list[int], list[int]]:
        """Return the text of operations in a row, and the signals of its segment.

        These are what comes from elsewhere, and what others read.
        """
        instances = self.program.instances
        args = [argument for index in group for argument in instances[index].args]
        given = [index for index in dict.fromkeys(args) if index not in group]
        read = [index for index in group if self.readers.get(index, set()) - set(group)]
        number = {index: k for k, index in enumerate([*given, *group])}
        operations = [
            (
                rows.OPERATIONS.index(instances[index].block.definition),
                [number[argument] for argument in instances[index].args],
            )
            for index in group
        ]
        return plan(len(given), operations, [number[index] for index in read]), given, read

    def call(self, group: tuple[int, ...]) -> tuple[int, list[int], int]:
        """Return address, operands and numbers of a segment of one or more blocks."""
        index, instances = group[0], self.program.instances
        instance, cls = instances[index], instances[index].block.definition
        form = self.form(group)
        text, _ = written(form)
        if "memory" in text or "chebyshev" in text:
            _part(SLOW_MODES, "memory", "moving_memory", "chebyshev")
        compiled = segment(form)
        resets = cls.resettable and not _always(instances[instance.args[-1]])
        # what a reset copies into the state lies behind the block's own numbers
        rest = pack(at_rest(self.design[index][1])) if resets else np.zeros(0, np.uint64)
        address, operands, starts = compiled.addresses["_sl_segment"], [], []
        for member, part in zip(group, form.parts, strict=True):
            self.segments[member] = compiled.name
            numbers, state = self.design[member]
            args = instances[member].args[: part.inputs]
            operands += [
                *(self.arg(argument, instance.clock) for argument in args),
                *self.output_slots(member),
            ]
            sizes = [field.size for field in state if isinstance(field, np.ndarray)]
            if part.cls.work:
                sizes.append(part.cls.work(numbers))
                self.scratch = max(self.scratch, sizes[-1])
            self.numbers.append(np.concatenate([_parameter_words(numbers, sizes), rest]))
            starts.append(self.numbers_at)
            self.numbers_at += self.numbers[-1].size
        # a segment gets one address of numbers and one of states: those of a second
        # block are so many words further on, which no text of a segment may depend on
        for member, start in zip(group[1:], starts[1:], strict=True):
            operands += [start - starts[0], self.state[member] - self.state[index]]
        if noise_behind(form):
            noise = segment(self.form(group[:1])).addresses["_sl_segment"]
            # see segments.NOISE_BEHIND: its tile ahead, what that is, and how it is
            # made if not
            operands += [
                self.slot(("ahead", index)),
                self.slot(("mark", index)),
                noise,
                operands[0],
            ]
        if resets:
            outputs, at = self.output_slots(index), self.numbers_at - starts[0] - rest.size
            contact = self.arg(instance.args[-1], instance.clock)
            # a segment around the segment: loops over stretches in each class made
            # springpots 8 to 25 % slower, without a contact too
            operands = [contact, outputs[0], len(outputs), at, rest.size, address, *operands]
            address = _part(CONTACT).addresses["stretches"]
        if cls.work:
            operands.append(-1)  # the slot of the scratch, which is behind all others
        return address, operands, starts[0]

    def form(self, group: tuple[int, ...]) -> Form:
        (numbers, state), instance = self.design[group[0]], self.program.instances[group[0]]
        cls = instance.block.definition
        code = cls.tile or cls.step
        assert code is not None, f"{cls.__name__} has neither step nor tile"
        meaning = () if str(code.__module__).startswith("stimlib.") else steps.meaning(code)
        # a step without the outputs that nobody takes is another segment: these are
        # few, and what is not computed takes no time
        outputs = range(len(cls.outputs))
        read = tuple((group[0], output) in self.listened for output in outputs) or (True,)
        types = type(numbers), kinds(numbers), type(state), kinds(state)
        inputs = instance.args[: len(instance.args) - cls.resettable]
        constants = tuple(self.program.instances[argument].kind == "const" for argument in inputs)
        return Form(
            cls,
            (code.__code__, meaning),
            *types,
            inputs=len(inputs),
            beside=tuple(self.form((member,)) for member in group[1:]),
            read=read,
            fixed=() if cls.tile else constants,
        )


class Engine:
    """Tables and memory of one compiled program; ``packed`` is its whole state."""

    def __init__(self, program: Program, design: list[tuple[Any, Any]], fs: float):
        with np.errstate(all="ignore"):  # words known now wrap as those that are not
            table = _Table(program, design)
        self.segments, self._constants = table.segments, table.constants
        self.table = np.array(table.rows, np.int64).reshape(-1, rows.ROW_WORDS)
        self.numbers = np.concatenate(table.numbers) if table.numbers else np.zeros(1, np.uint64)
        self.operands = np.array(table.operands, np.int64)
        self.size = table.state[-1]
        self._state_at = {index: table.state[index] for index in program.params.values()}
        self._param = {index: number for number, index in enumerate(program.params.values())}
        self._empty = np.zeros((len(program.inputs), 0)), np.zeros((len(program.outputs), 0))
        self._main, self._outputs_at, self._clocks = (
            table.main,
            table.outputs_at,
            len(program.parents),
        )
        # a stretch may begin late in its tile, and its last vector reaches further
        self._buffer_words = table.memory + table.scratch + TILE
        self._allot()

    def _allot(self) -> None:
        """Allocate the memory of one run, in whole cache lines.

        Threads that run copies then never write to the same line.
        """
        machine, params, clocks = runtime().addresses, len(self._param), self._clocks
        words = (
            max(self.size, 1),
            self._buffer_words,
            clocks,
            clocks * 2 * TILE,
            rows.SETTING_WORDS * max(1, params),
            rows.CONTEXT_WORDS,
        )
        ends = np.cumsum([-(-count // 8) * 8 for count in words])
        memory = np.zeros(ends[-1] + 8, np.uint64)
        self.nbytes = memory.nbytes
        first = -memory.ctypes.data // 8 % 8  # words up to the next line
        self.states, buffers, *rest = np.split(memory[first : first + ends[-1]], ends[:-1])
        self.buffers = buffers.view(np.float64)
        self.counts, self.ticks, pending, self.ctx = (array.view(np.int64) for array in rest)
        self.ticks[(2 * ROOT + 1) * TILE : (2 * ROOT + 2) * TILE] = range(TILE)
        self.pending = pending.reshape(-1, rows.SETTING_WORDS)
        # constants take no time: nothing writes their slots again
        for word, value in self._constants:
            self.buffers[word : word + TILE] = value
        for index, number in self._param.items():
            self.pending[number, rows.PARAM_STATE] = self._state_at[index]
        # seen and still done stay 0: a run begins with no sample, and no row has run
        context = {
            rows.ROWS: self._main,
            rows.TABLE: self.table.ctypes.data,
            rows.NUMBERS: self.numbers.ctypes.data,
            rows.STATES: self.states.ctypes.data,
            rows.BUFFERS: self.buffers.ctypes.data,
            rows.OPERANDS: self.operands.ctypes.data,
            rows.INPUTS: self._empty[0].shape[0],
            rows.OUTPUTS: self._empty[1].shape[0],
            rows.OUTPUT_ROWS: self._outputs_at,
            rows.COUNTS: self.counts.ctypes.data,
            rows.TICKS: self.ticks.ctypes.data,
            rows.CLOCKS: clocks,
            rows.WARM: -1,
            rows.PENDING: self.pending.ctypes.data,
            rows.PARAMS: params,
            rows.ENTRY: machine["entry"],
        }
        self.ctx[[*context]] = [*context.values()]
        known = entry_points.array_words()
        self.ctx[rows.ARRAY_TYPE], self.ctx[rows.FLOAT64] = known or (0, 0)
        self.address = int(machine["entry"]), int(self.ctx.ctypes.data)
        self.process = (
            entry_points.function(machine["process"], self.address[1])
            if known
            else entry_points.checked(
                *self.address, (self.ctx[rows.INPUTS], self.ctx[rows.OUTPUTS])
            )
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
        contexts = np.array([engine.ctx.ctypes.data for engine in engines])
        process = TOGETHER(_part(THREADS).addresses["process"])

        def run(
            turn: np.ndarray, x: np.ndarray, out: np.ndarray, kept: object = tuple(engines)
        ) -> None:
            """Run copies; the engines live as long as this function."""
            # the context of a copy is an address: only ``kept`` keeps its memory alive
            of_x, of_y = (math.prod(array.shape[1:]) for array in (x, out))
            first, motions = contexts.ctypes.data, (x.ctypes.data, x.shape[0], of_x)
            to = out.ctypes.data, of_y, out.shape[2]
            process(first, contexts.size, turn.ctypes.data, *motions, *to)

        return run

    @staticmethod
    def start(block: Block, numbers: Any, state: Any, seed: int) -> Any:
        """Return the first state of a block, drawn from compiled noise."""
        return (
            block.start(numbers, state, seed, normals)
            if isinstance(block, FilteredNoise)
            else block.start(numbers, state, seed)
        )

    def warm(self, clocks: Sequence[int], count: int) -> None:
        """Run only blocks that no input reaches, for ``count`` samples of some clocks.

        None of these clocks may be a child of another.
        """
        early = np.array(clocks, np.int64)
        try:
            self.ctx[rows.WARM], self.ctx[rows.WARM_CLOCKS] = early.size, early.ctypes.data
            entry_points.ENTRY(self.address[0])(self.address[1], None, None, count)  # no signals
        finally:  # an interrupt comes here: ``early`` ends with this function
            self.ctx[rows.WARM] = -1  # all rows again

    def set(self, index: int, target: float, left: float) -> None:
        """Ramp a parameter to a target over ``left`` samples, from the next call on."""
        # not into the state: another thread may be running, which takes it in when
        # it is called next
        waiting, at_once = self.pending[self._param[index]], left <= 1.0
        target, left = np.array([target, left]).view(np.int64)
        # the word that says that something waits is written last
        if at_once:
            waiting[rows.TARGET : rows.Y + 1] = target, 0, target
            waiting[rows.WAITS] = 2
        else:
            waiting[rows.TARGET : rows.Y] = target, left
            # a jump that still waits stays: the ramp begins there
            waiting[rows.WAITS] = max(1, waiting[rows.WAITS])

    @property
    def count(self) -> int:
        """Number of samples processed."""
        return int(self.ctx[rows.SEEN])

    @count.setter
    def count(self, n: int) -> None:
        self.ctx[rows.SEEN] = n

    def peek(self) -> np.ndarray:
        """Return the states without side effects.

        It is safe while another thread runs the program.
        """
        return self.states[: self.size].copy()

    @property
    def packed(self) -> np.ndarray:
        """All states in canonical order (a copy)."""
        self.process(*self._empty)  # takes pending settings in
        return self.states[: self.size].copy()

    @packed.setter
    def packed(self, w: np.ndarray) -> None:
        self.pending[:, rows.WAITS] = 0
        self.ctx[rows.STILL_DONE] = 0  # parameters may have moved
        self.states[: self.size] = w


@cache
def _white() -> Engine:
    program = lower({"white": White(0)})
    design = design_of(program, 1000.0)  # deviates are the same at every rate
    engine = Engine(program, design, 1000.0)
    engine.packed = first_states(program, design)(0)
    return engine


def normals(key: np.uint64, count: int) -> np.ndarray:
    """Return the first n deviates of a stream, as ``stimlib.blocks.noise.normals``.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.blocks import noise
    >>> from stimlib.targets.llvm.engine import normals
    >>> bool(np.all(normals(np.uint64(7), 5) == noise.normals(np.uint64(7), 5)))
    True
    """
    deviates = np.empty((1, count))
    with lock:
        engine = _white()
        # one engine for all keys: a key is the state of a noise, no number of its
        # design
        engine.states[0], engine.states[1] = key, 0  # see WhiteState
        engine.process(np.empty((0, count)), deviates)
    return deviates[0]


def _always(instance: Instance) -> bool:
    """Return whether a contact is a constant number above 0."""
    return instance.kind == "const" and instance.block.value > 0.0  # type: ignore[attr-defined]


def _still(program: Program, design: list[tuple[Any, Any]]) -> list[bool]:
    """Return for each instance whether it is constant while no parameter changes.

    Such instances are parameters, constants, and maps of them.
    """
    still: list[bool] = []
    for instance, (_, state) in zip(program.instances, design, strict=True):
        maps = (
            instance.kind in ("block", "pick")
            and isinstance(instance.block, Map | Pick)
            and not state
        )
        of_them = (
            maps and bool(instance.args) and all(still[argument] for argument in instance.args)
        )
        still.append(of_them or instance.kind == "const" or isinstance(instance.block, Param))
    return still


LANES = 8
"""So many blocks at most run in the lanes of vectors: one vector with AVX-512, and with
sixteen each took as long.
"""

NEAR = 16
"""So many blocks at most run earlier than written, for one more recursion to stand side
by side with others.  Further away, the order would leave that of the graph, and what
was written last would have left the cache.
"""


NOISE, BANK = White.tile, Modes.tile
"""Tiles that run in one segment; a class that has another is not put into it."""


def _order(program: Program, design: list[tuple[Any, Any]]) -> list[tuple[int, ...]]:
    """Return groups of instances in running order.

    Instances of one class that step on one clock run side by side, up to LANES in the
    lanes of vectors or, where vectors lack an operation, two in one loop, each during
    the other's latency. So do white noise and the first bank of modes that filters it.
    """
    instances = program.instances
    behind: dict[int, int] = {}  # of a white noise, the modes that filter it
    for index, instance in enumerate(instances):
        if instance.kind == "block" and instance.block.definition.tile is BANK:
            white = instances[instance.args[0]]
            if white.block.definition.tile is NOISE and white.clock == instance.clock:
                behind.setdefault(instance.args[0], index)
    opened = {
        instance.child: index for index, instance in enumerate(instances) if instance.kind == "open"
    }
    done = [instance.kind in ("const", "input") for instance in instances]
    keys = [_recursion(program, design, index) for index in range(len(instances))]
    # of each kind of recursion, its instances: the next one last, where pop finds it
    alike: dict[Any, list[int]] = {None: []}
    for index in reversed(range(len(instances))):
        if keys[index]:
            alike.setdefault(keys[index], []).append(index)
    most = {
        key: LANES if key.least or _trial(key.cls)(*key.form) else 2
        for key, indices in alike.items()
        if len(indices) > 1
    }

    order: list[tuple[int, ...]] = []
    for index, key in enumerate(keys):
        if done[index]:
            continue
        group: tuple[int, ...] = (index,)
        if index in behind:
            group = index, behind[index]
        # partners are the next of its kind, unless they need one of the group
        others, first = alike[key], list[int]()
        while len(group) < most.get(key, 1):
            while others and (done[others[-1]] or others[-1] <= group[-1]):
                others.pop()
            before = _before(instances, opened, done, others[-1]) if others else None
            if before is None or set(group) & set(before):
                break
            group = *group, others.pop()
            first += before
            for earlier in before:
                done[earlier] = True
        # of 2, 4 or 8: each number is a segment of its own
        whole = 1 << (len(group).bit_length() - 1)
        if key and whole < key.least:
            whole = 1
        others += reversed(group[whole:])
        order += [*((earlier,) for earlier in first), group[:whole]]
        for earlier in group[:whole]:
            done[earlier] = True
    return order


_tried = cache(lanes.go_abreast)


def _trial(cls: type[Block]) -> Callable[..., bool]:
    """Return the trial of a step in lanes; of a step that cannot change, made once."""
    return _tried if steps.ours(cls) else lanes.go_abreast


LONG, MOST = 4, 512
"""So many operations in a row, at least and at most, share a segment: each saves 0.1 ns
a sample. A new form of such a row takes 20 to 50 ms to compile, once a machine; one of
4000 took 5 s.
"""


def _operation(instance: Instance) -> bool:
    return instance.kind == "block" and instance.block.definition in rows.OPERATIONS


def _rows(
    program: Program, order: list[tuple[int, ...]], still: list[bool]
) -> list[tuple[int, ...]]:
    """Return an order in which long runs of single operations are groups."""
    joined: list[tuple[int, ...]] = []
    for _, run in itertools.groupby(order, partial(_run_of, program.instances, still)):
        groups = list(run)
        if LONG <= len(groups) <= MOST and _operation(program.instances[groups[0][0]]):
            groups = [tuple(index for (index,) in groups)]
        joined += groups
    return joined


def _run_of(instances: list[Instance], still: list[bool], group: tuple[int, ...]) -> Any:
    """Return what operations of one run have in common."""
    instance = instances[group[0]]
    return _operation(instance) and (instance.clock, instance.autonomous, still[group[0]])


def _before(
    instances: list[Instance], opened: dict[int, int], done: list[bool], index: int
) -> list[int] | None:
    """Return the instances that must still run before another; None if many."""
    found: set[int] = set()
    todo = [index]
    while todo and len(found) <= NEAR:
        instance = instances[todo.pop()]
        need = (
            {*instance.args, opened[instance.clock]} if instance.clock > ROOT else {*instance.args}
        )
        new = {argument for argument in need - found if not done[argument]}
        found |= new
        todo += new
    return None if todo else sorted(found)


class _Kind(NamedTuple):
    """What instances must have in common to run side by side."""

    form: tuple[Any, ...]  # the arguments of lanes.go_abreast
    cls: type[Block]
    clock: int
    autonomous: bool
    sizes: tuple[int, ...]  # of a tile's numbers and state
    least: int  # so many tiles in lanes are faster than one after the other


def _recursion(program: Program, design: list[tuple[Any, Any]], index: int) -> _Kind | None:
    """Return the kind of recursion that an instance is; None if it runs alone."""
    instance, (numbers, state) = program.instances[index], design[index]
    cls = instance.block.definition
    arrays = [isinstance(field, np.ndarray) for field in state]
    least = cls.abreast(numbers) if cls.tile and cls.abreast else 0
    # steps in one loop share a state only as numbers: an array or several outputs have
    # loops of their own; and without a state nothing waits
    alone = (
        instance.kind != "block"
        or cls.outputs
        or not state
        or (not 0 < least <= LANES or not all(arrays) if cls.tile else any(arrays))
    )
    if alone or (cls.resettable and not _always(program.instances[instance.args[-1]])):
        return None
    inputs = len(instance.args) - cls.resettable
    form = cls.tile or cls.step, type(numbers), kinds(numbers), type(state), kinds(state), inputs
    sizes = tuple(np.size(field) for field in (*numbers, *state)) if cls.tile else ()
    return _Kind(form, cls, instance.clock, instance.autonomous, sizes, least)


def _parameter_words(numbers: Any, sizes: list[int]) -> np.ndarray:
    """Return the parameter words of one row.

    They are numbers, (offset, size) of arrays, sizes of state arrays and scratch; then
    the arrays.
    """
    arrays = [pack((field,)) for field in numbers if isinstance(field, np.ndarray)]
    # an array has two words among the numbers; all arrays lie behind all words
    end = len(numbers) + len(arrays) + len(sizes)
    words: list[np.ndarray] = []
    for field in numbers:
        if isinstance(field, np.ndarray):
            words.append(np.array([end, field.size], np.uint64))
            end += field.size
        else:
            words.append(pack((field,)))
    return np.concatenate([*words, np.array(sizes, np.uint64), *arrays])
