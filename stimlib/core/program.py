"""From a scene to a flat program: rewriting, clocks, running order.

Every target runs the same program.
"""

from __future__ import annotations

import dataclasses as dc
import hashlib
import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import BadValue, SceneError, counted, outside
from ..system.limits import limits
from . import steps, units as un
from .clocks import ROOT, Instance, Node, count, layout
from .graph import Add, Block, Const, Input, Map, Mul, Named, pack, reach, signals, type_name
from .guard import Guard
from .loop_code import Cycle, closed
from .loops import Last, Loop, Tap
from .parameter import Param
from .pointwise import Where
from .silence import silenced
from .subsystems import Segment, Subsystem


def lead(fs: float) -> int:
    """Return for how many samples parts without an input run before sample 0.

    It depends on fs only.

    It must not depend on the graph: an output added to a scene would then change the
    bits of the others.

    Examples
    --------
    >>> from stimlib.core.program import lead
    >>> lead(8000.0), lead(48000.0)
    (256, 1536)
    """
    return max(256, math.ceil(0.032 * fs - 1e-9))


class Program(NamedTuple):
    """A scene as a flat list of block instances, ready for any target."""

    instances: list[Instance]  # in running order
    outputs: dict[str, int]
    inputs: dict[str, int]
    params: dict[str, int]
    noises: dict[str, int]
    parents: list[int]  # parent of each clock
    clocks: list[str]  # what each clock is called
    runs: list[str]  # what tells the segments that each clock is in; "" where there are none
    seeds: list[int | None]  # of noises on each clock; None: that of the run
    removed: list[str]  # what rewriting took out, and why
    hash: int  # of structure and design numbers: 64 bits


class _Graph:
    """The blocks of a scene as numbered nodes; equal sub-graphs share a number."""

    def __init__(self, removed: dict[str, None]):
        self.nodes: list[Node] = []
        self.numbers: dict[Any, int] = {}
        self.removed = removed
        self.bodies: dict[int, int] = {}  # of each Last, the number of what it is the last value of

    def number(self, block: Block, kids: tuple[int, ...]) -> int:
        key = (type(block), kids, _numbers(block), block.autonomous)
        index = self.numbers.setdefault(key, len(self.nodes))
        if index == len(self.nodes):
            self.nodes.append(Node(block, kids))
        return index

    def const(self, value: float, like: Block) -> int:
        return self.number(Const(value, "" if like.dim == un.ONE else str(like.dim)), ())

    def value(self, node: int) -> float | None:
        block = self.nodes[node].block
        return block.value if isinstance(block, Const) else None

    def autonomous(self, node: int) -> bool:
        return self.nodes[node].block.autonomous

    def intern(self, block: Block, kids: tuple[int, ...]) -> int:
        """Return the number of a block over rewritten inputs.

        Numbers are folded, and literal zeros and ones removed.
        """
        if isinstance(block, Last | Loop | Tap):
            return self.feedback(block, kids)
        values = [self.value(kid) for kid in kids]
        if foldable(block) and kids and None not in values:
            with np.errstate(all="ignore"):
                value = float(
                    steps.sample(block, (), (), [np.float64(value) for value in values])[0]
                )
            if not math.isfinite(value):
                raise SceneError(f"{block!r} with the plain numbers {values} is {value}")
            return self.const(value, block)
        for here, there in ((0, 1), (1, 0)) if isinstance(block, (Mul, Add)) else ():
            if values[here] == (1.0 if isinstance(block, Mul) else 0.0):
                return kids[there]
            if isinstance(block, Mul) and values[here] == 0.0 and self.autonomous(kids[there]):
                self.removed[f"{self.nodes[kids[there]].block!r}: multiplied by a literal 0"] = None
                return self.const(0.0, block)
        if isinstance(block, Where) and values[0] is not None:
            side, other = kids[1:] if values[0] > 0.0 else kids[:0:-1]
            # or what follows would begin before sample 0, which it did not
            if self.autonomous(other) or not self.autonomous(side):
                self.removed[f"{self.nodes[other].block!r}: never chosen"] = None
                return side
        if isinstance(block, Subsystem) and (
            values[0] == 0.0 or (values[1] is not None and values[1] <= 0.0)
        ):
            self.removed[
                f"{block!r}: {'nothing in it' if values[0] == 0.0 else 'never enabled'}"
            ] = None
            return self.const(0.0, block)
        return self.number(block, kids)

    def feedback(self, block: Block, kids: tuple[int, ...]) -> int:
        """Return the number of a part of a loop.

        A loop has the number of its body, and a tap that of the signal inside.
        """
        if isinstance(block, Last):  # two loops have two, equal or not
            self.nodes.append(Node(block, ()))
            return len(self.nodes) - 1
        if isinstance(block, Loop):
            body, last = kids
            if self.bodies.setdefault(last, body) != body:
                raise SceneError(
                    f"{block!r} and another loop share one last value; make each with loop(..)"
                )
            return body
        return kids[1]

    def closed(self, roots: list[int]) -> tuple[_Graph, list[int]]:
        """Return the graph and its roots with each loop replaced by one block."""
        new = _Graph(self.removed)
        return new, closed(self.nodes, self.bodies, roots, new.number)

    def silenced(self, roots: list[int]) -> tuple[_Graph, list[int]]:
        """Return the graph and its roots with sources that rest when unheard."""
        new = _Graph(self.removed)
        changed = silenced(self.nodes, roots, new.number)
        return (self, roots) if changed is None else (new, changed)


def _numbers(block: Block, known: Callable[[type], Any] = lambda cls: cls) -> tuple[Any, ...]:
    """Return the design numbers of a block; known(cls) is a class of a cycle."""
    if isinstance(block, Cycle):
        return block.structure(_numbers, known)
    return tuple(
        _key(getattr(block, field.name))
        for field in dc.fields(block)  # type: ignore[arg-type]
        if field.name not in signals(type(block))
    )


def foldable(block: Block) -> bool:
    """Return whether a block can be folded into a constant if its inputs are constant.

    This holds for blocks without memory whose step needs no design.
    """
    return (
        isinstance(block, Map)
        and not block.outputs
        and type(block).step is not None
        and type(block).design is Block.design
    )


def _key(value: Any) -> Any:
    return ("array", value.shape, value.tobytes()) if isinstance(value, np.ndarray) else repr(value)


def lower(outputs: dict[str, Block]) -> Program:
    """Rewrite a scene's outputs and arrange them on their clocks.

    Raises
    ------
    SceneError
        Names used twice with different meaning; noise sources with one key, or one
        source on two clocks, unless shared; numbers that fold to something non-finite;
        more blocks than ``limits.scene_blocks``.
    """
    guards = [Guard(block) for block in outputs.values()]
    objects = reach(guards)
    limits.check("scene_blocks", len(objects), "blocks of a scene", SceneError)
    _check_names(objects)
    graph = _Graph({})
    number: dict[int, int] = {}
    for block in objects:
        number[id(block)] = graph.intern(
            block, tuple(number[id(child)] for child in block.children)
        )
    roots = [number[id(guard)] for guard in guards]
    if graph.bodies or any(isinstance(block, Last) for block in objects):
        graph, roots = graph.closed(roots)
    graph, roots = graph.silenced(roots)
    # counted before any is made: a few gates inside each other would fill the memory
    copies = count(graph.nodes, roots)
    limits.check(
        "scene_blocks",
        copies,
        "blocks of a scene after each enabled or segment has got its own copies",
        SceneError,
    )
    # on the objects as they were given: two equal noises are one node of the graph by
    # now
    _check_noise_objects(guards)
    made, instances, clocks = layout(graph.nodes, roots)
    blocks = [block for block in objects if not isinstance(block, (Loop, Tap))]
    merged = len(blocks) - len({number[id(block)] for block in blocks})
    removed = list(graph.removed) + (
        [f"{counted(merged, 'block')}: equal to others, or folded into numbers"] if merged else []
    )
    noises: dict[str, int] = {}
    for index, instance in enumerate(instances):
        if instance.block.noise_key:
            name = "white({}, {})".format(*instance.block.noise_key) + clocks.runs[instance.clock]
            if name in noises and not instance.block.shared:
                raise SceneError(
                    f"noise {instance.block!r} is used on two clocks (inside enabled and outside,"
                    " or in two gates): each clock would run its own copy; give each its own"
                    " stream, or give shared=True if one noise everywhere is meant"
                )
            noises.setdefault(name, index)
    inputs, params = (
        {q.block.name: index for index, q in enumerate(instances) if isinstance(q.block, kind)}
        for kind in (Input, Param)
    )
    # of what runs: names of outputs are not in it
    text = repr(
        [
            (
                type_name(type(instance.block)),
                _numbers(instance.block, type_name),  # a class may move to another module
                instance.kind,
                instance.clock,
                instance.args,
            )
            for instance in instances
        ]
    )
    ends = {name: made["block", node, ROOT] for name, node in zip(outputs, roots, strict=True)}
    own = int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
    parents, names, runs, seeds, _ = clocks
    return Program(
        instances, ends, inputs, params, noises, parents, names, runs, seeds, removed, own
    )


def _check_names(objects: list[Block]) -> None:
    seen: dict[str, Block] = {}
    for block in objects:
        if isinstance(block, Named):
            old = seen.setdefault(block.name, block)
            if type(old) is not type(block) or repr(old) != repr(block):
                raise SceneError(
                    f"the name {block.name!r} is used for {old!r} and for {block!r}: give them"
                    " different names"
                )


def _check_noise_objects(roots: Sequence[Block]) -> None:
    """Raise SceneError where two signals would silently share one noise.

    Noises are compared by object, before equal sub-graphs are merged, and within each
    segment.
    """
    seen: dict[Any, Block] = {}
    todo = {"": list(roots)}
    while todo:
        run, tops = todo.popitem()
        for block in reach(tops, Segment):
            if isinstance(block, Segment):
                todo.setdefault(run + block.run, []).append(block.block)
            if (key := block.noise_key) is None:
                continue
            old = seen.setdefault((run, key), block)
            if old is not block and not (block.shared and old.shared):  # type: ignore[attr-defined]
                raise SceneError(
                    f"two noise sources have the key seed={key[0]}, stream={key[1]}: they would be"
                    f" one and the same noise; give one another seed (seed={key[0] + 1}) or stream,"
                    " or shared=True to both if that is meant"
                )


def program_of(scene: Any) -> Program:
    """Return the program of a scene; raise SceneError for anything else."""
    program = getattr(scene, "program", None)
    if not isinstance(program, Program):
        raise SceneError(
            f'expected a Scene, such as Scene({{"force": force}}), got {type(scene).__name__}'
        )
    return program


def start(block: Block, p: Any, s: Any, seed: int) -> Any:
    """Return the first state of a block in a run with this seed."""
    return block.start(p, s, seed)


def prepare(
    scene: Any, fs: float, cost: float = 20.0, start: Callable[..., Any] = start
) -> tuple[Program, list[tuple[Any, Any]], Callable[[int], np.ndarray]]:
    """Return the program of a scene, its design at a rate, and its states by seed.

    ``cost`` and ``start`` are those of ``design_of`` and ``first_states``, whose errors
    it raises; SceneError if filters of a noise need more samples than the lead.
    """
    program = program_of(scene)
    design = design_of(program, fs, cost)
    _check_memory(program, design, fs)
    return program, design, first_states(program, design, start)


def design_of(program: Program, fs: float, cost: float = 20.0) -> list[tuple[Any, Any]]:
    """Return parameters and state at rest of every instance at a sample rate (Hz).

    ``cost`` is the number of operations that a block needs per sample. SceneError if a
    block's code is faulty; BadValue before more memory is taken than
    ``limits.state_bytes``, or more work than ``limits.design_work``.
    """
    # checked block by block, before the next takes its memory
    work = 0.0
    used = 8.0 * lead(fs) * (len(program.inputs) + len(program.outputs))
    made = []
    for instance in program.instances:
        numbers, state = (
            steps.designed(instance.block, fs) if instance.kind == "block" else ((), ())
        )
        used += 8 * 64 + sum(np.size(field) * 8 for field in (*numbers, *state))
        limits.check(
            "state_bytes",
            used,
            f"bytes, at least, of the scene's states, parameters and buffers at fs = {fs:g} Hz",
        )
        work += lead(fs) * (cost + np.size(getattr(numbers, "taps", ())) / 20) * instance.autonomous
        limits.check(
            "design_work",
            work,
            f"operations of the {lead(fs)} samples before sample 0 at fs = {fs:g} Hz; lower fs",
        )
        if instance.kind == "block" and not steps.ours(type(instance.block)):
            steps.rehearse(instance.block, numbers, state)
        made.append((numbers, state))
    return made


def _check_memory(program: Program, design: list[tuple[Any, Any]], fs: float) -> None:
    """Raise SceneError if filters of a noise need more samples than the lead.

    The noise would start with a transient.
    """
    total = [0] * len(program.instances)
    noisy = [False] * len(program.instances)
    for index, instance in enumerate(program.instances):
        noisy[index] = instance.block.noise_key is not None or any(
            noisy[argument] for argument in instance.args
        )
        if instance.autonomous and noisy[index]:
            total[index] = max((total[argument] for argument in instance.args), default=0) + (
                instance.block.memory(design[index][0]) if instance.kind == "block" else 0
            )
            if total[index] > lead(fs):
                raise SceneError(
                    f"{instance.block!r}: {counted(total[index], 'sample')} of filter memory on"
                    " the path of a"
                    f" noise, more than the {lead(fs)} that run before sample 0 at fs = {fs:g} Hz;"
                    " use lower orders or shorter delays"
                )


def first_states(
    program: Program, design: list[tuple[Any, Any]], start: Callable[..., Any] = start
) -> Callable[[int], np.ndarray]:
    """Return a function of the seed that gives all states before the lead.

    The result is an array of words in canonical order: instance order, then field
    order.
    """
    own, parts, at = [], [np.zeros(0, np.uint64)], 0
    for instance, (numbers, state) in zip(program.instances, design, strict=True):
        if instance.kind == "block":
            if type(instance.block).start is not Block.start:
                own.append((at, instance.block, numbers, state, program.seeds[instance.clock]))
            parts.append(pack(state))
            at += parts[-1].size
    rest = np.concatenate(parts)

    def first(seed: int) -> np.ndarray:
        words = rest.copy()
        with np.errstate(all="ignore"):
            for at, block, numbers, state, its in own:
                new = pack(start(block, numbers, state, seed if its is None else its))
                words[at : at + new.size] = new
        return words

    return first


def rate(fs: Any) -> float:
    """Return a sample rate in Hz; raise BadValue unless it is finite and above 0."""
    if fs is None:
        raise BadValue("fs is missing: give the sample rate in Hz, such as fs=8000")
    fs = number(fs, "fs")
    if not (math.isfinite(fs) and fs > 0):
        raise BadValue(f"fs = {fs} Hz: the sample rate must be a finite number above 0")
    return fs


def number(v: Any, what: str) -> float:
    """Return a value as a float; raise BadValue with its name if it is not a number."""
    try:
        if isinstance(v, (str, bytes)):
            raise TypeError
        return float(v)
    except OverflowError:
        raise BadValue(f"{what} is too large; the largest number is 1.8e308") from None
    except (TypeError, ValueError):
        raise BadValue(f"{what} must be a number, got {v!r}") from None


def warn_beyond(program: Program, fs: float, frames: int) -> None:
    """Warn if a run is longer than the horizon of a block.

    The stated accuracy of the block holds only up to its horizon.
    """
    for instance in program.instances:
        horizon = getattr(instance.block, "horizon", None)
        if horizon is not None and frames / fs > horizon:
            warnings.warn(
                f"{instance.block!r}: the run of {frames / fs:g} s is longer than horizon ="
                f" {horizon:g} s, up to which its tolerance holds; beyond, the error grows: give a"
                " longer horizon",
                RuntimeWarning,
                stacklevel=outside(),
            )
            return
