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

from ..errors import BadValue, SceneError, outside
from ..system.limits import limits
from . import steps, units as un
from .clocks import ROOT, Instance, Node, count, layout
from .graph import Add, Block, Const, Input, Map, Mul, Named, pack, reach, signals, type_name
from .guard import Guard
from .loop_code import Cycle, closed
from .loops import Last, Loop, Tap
from .parameter import Param
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

    def __init__(self):
        self.nodes: list[Node] = []
        self.numbers: dict[Any, int] = {}
        self.removed: dict[str, None] = {}
        self.bodies: dict[int, int] = {}  # of each Last, the number of what it is the last value of

    def number(self, b: Block, kids: tuple[int, ...]) -> int:
        key = (type(b), kids, _numbers(b))
        n = self.numbers.setdefault(key, len(self.nodes))
        if n == len(self.nodes):
            self.nodes.append(Node(b, kids))
        return n

    def const(self, value: float, like: Block) -> int:
        return self.number(Const(value, "" if like.dim == un.ONE else str(like.dim)), ())

    def value(self, n: int) -> float | None:
        b = self.nodes[n].block
        return b.value if isinstance(b, Const) else None

    def autonomous(self, n: int) -> bool:
        return self.nodes[n].block.autonomous

    def intern(self, b: Block, kids: tuple[int, ...]) -> int:
        """Return the number of a block over rewritten inputs.

        Numbers are folded, and literal zeros and ones removed.
        """
        if isinstance(b, Last | Loop | Tap):
            return self.feedback(b, kids)
        values = [self.value(k) for k in kids]
        if foldable(b) and kids and None not in values:
            with np.errstate(all="ignore"):
                v = float(steps.sample(b, (), (), [np.float64(v) for v in values])[0])
            if not math.isfinite(v):
                raise SceneError(f"{b!r} with the plain numbers {values} is {v}")
            return self.const(v, b)
        for here, there in ((0, 1), (1, 0)) if isinstance(b, (Mul, Add)) else ():
            if values[here] == (1.0 if isinstance(b, Mul) else 0.0):
                return kids[there]
            if isinstance(b, Mul) and values[here] == 0.0 and self.autonomous(kids[there]):
                self.removed[f"{self.nodes[kids[there]].block!r}: multiplied by a literal 0"] = None
                return self.const(0.0, b)
        if isinstance(b, Subsystem):
            if values[0] == 0.0 or (values[1] is not None and values[1] <= 0.0):
                self.removed[
                    f"{b!r}: {'nothing in it' if values[0] == 0.0 else 'never enabled'}"
                ] = None
                return self.const(0.0, b)
        return self.number(b, kids)

    def feedback(self, b: Block, kids: tuple[int, ...]) -> int:
        """Return the number of a part of a loop.

        A loop has the number of its body, and a tap that of the signal inside.
        """
        if isinstance(b, Last):  # two loops have two, equal or not
            self.nodes.append(Node(b, ()))
            return len(self.nodes) - 1
        if isinstance(b, Loop):
            body, last = kids
            if self.bodies.setdefault(last, body) != body:
                raise SceneError(
                    f"{b!r} and another loop share one last value; make each with loop(..)"
                )
            return body
        return kids[1]

    def closed(self, roots: list[int]) -> tuple[_Graph, list[int]]:
        """Return the graph and its roots with each loop replaced by one block."""
        new = _Graph()
        new.removed = self.removed
        return new, closed(self.nodes, self.bodies, roots, new.number)


def _numbers(b: Block) -> tuple[Any, ...]:
    """Return the design numbers of a block."""
    if isinstance(b, Cycle):
        return b.structure(_numbers)
    return tuple(_key(getattr(b, f.name)) for f in dc.fields(b) if f.name not in signals(type(b)))  # type: ignore[arg-type]


def foldable(b: Block) -> bool:
    """Return whether a block can be folded into a constant if its inputs are constant.

    This holds for blocks without memory whose step needs no design.
    """
    return (
        isinstance(b, Map)
        and not b.outputs
        and type(b).step is not None
        and type(b).design is Block.design
    )


def _key(v: Any) -> Any:
    return ("array", v.shape, v.tobytes()) if isinstance(v, np.ndarray) else repr(v)


def lower(outputs: dict[str, Block]) -> Program:
    """Rewrite a scene's outputs and arrange them on their clocks.

    Raises
    ------
    SceneError
        Names used twice with different meaning; noise sources with one key, or one
        source on two clocks, unless shared; numbers that fold to something non-finite;
        more blocks than ``limits.scene_blocks``.
    """
    guards = [Guard(b) for b in outputs.values()]
    objects = reach(guards)
    limits.check("scene_blocks", len(objects), "blocks of a scene", SceneError)
    _check_names(objects)
    graph = _Graph()
    number: dict[int, int] = {}
    for b in objects:
        number[id(b)] = graph.intern(b, tuple(number[id(c)] for c in b.children))
    roots = [number[id(g)] for g in guards]
    if graph.bodies or any(isinstance(b, Last) for b in objects):
        graph, roots = graph.closed(roots)
    copies = count(graph.nodes, roots)
    limits.check(
        "scene_blocks",
        copies,
        "blocks of a scene after each enabled or segment has got its own copies",
        SceneError,
    )
    _check_noise_objects(guards)
    made, instances, clocks = layout(graph.nodes, roots)
    blocks = [b for b in objects if not isinstance(b, (Loop, Tap))]
    merged = len(blocks) - len({number[id(b)] for b in blocks})
    removed = list(graph.removed) + (
        [f"{merged} blocks: equal to others, or folded into numbers"] if merged else []
    )
    noises: dict[str, int] = {}
    for i, q in enumerate(instances):
        if q.block.noise_key:
            name = "white({}, {})".format(*q.block.noise_key) + clocks.runs[q.clock]
            if name in noises and not q.block.shared:
                raise SceneError(
                    f"noise {q.block!r} is used on two clocks (inside enabled and outside, or in"
                    " two gates): each clock would run its own copy; give each its own stream, or"
                    " give shared=True if one noise everywhere is meant"
                )
            noises.setdefault(name, i)
    inputs = {q.block.name: i for i, q in enumerate(instances) if isinstance(q.block, Input)}
    params = {q.block.name: i for i, q in enumerate(instances) if isinstance(q.block, Param)}
    text = repr(
        [(type_name(type(q.block)), _numbers(q.block), q.kind, q.clock, q.args) for q in instances]
    )
    ends = {name: made["block", n, ROOT] for name, n in zip(outputs, roots, strict=True)}
    own = int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
    parents, names, runs, seeds, _ = clocks
    return Program(
        instances, ends, inputs, params, noises, parents, names, runs, seeds, removed, own
    )


def _check_names(objects: list[Block]) -> None:
    seen: dict[str, Block] = {}
    for b in objects:
        if isinstance(b, Named):
            old = seen.setdefault(b.name, b)
            if type(old) is not type(b) or repr(old) != repr(b):
                raise SceneError(
                    f"the name {b.name!r} is used for {old!r} and for {b!r}: give them different"
                    " names"
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
        for b in reach(tops, Segment):
            if isinstance(b, Segment):
                todo.setdefault(run + b.run, []).append(b.block)
            if (key := b.noise_key) is None:
                continue
            old = seen.setdefault((run, key), b)
            if old is not b and not (b.shared and old.shared):  # type: ignore[attr-defined]
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
    work = 0.0
    used = 8.0 * lead(fs) * (len(program.inputs) + len(program.outputs))
    made = []
    for q in program.instances:
        p, s = steps.designed(q.block, fs) if q.kind == "block" else ((), ())
        used += 8 * 64 + sum(np.size(v) * 8 for v in (*p, *s))
        limits.check(
            "state_bytes",
            used,
            f"bytes, at least, of the scene's states, parameters and buffers at fs = {fs:g} Hz",
        )
        work += lead(fs) * (cost + np.size(getattr(p, "taps", ())) / 20) * q.autonomous
        limits.check(
            "design_work",
            work,
            f"operations of the {lead(fs)} samples before sample 0 at fs = {fs:g} Hz; lower fs",
        )
        if q.kind == "block" and not steps.ours(type(q.block)):
            steps.rehearse(q.block, p, s)
        made.append((p, s))
    return made


def _check_memory(program: Program, design: list[tuple[Any, Any]], fs: float) -> None:
    """Raise SceneError if filters of a noise need more samples than the lead.

    The noise would start with a transient.
    """
    total = [0] * len(program.instances)
    noisy = [False] * len(program.instances)
    for i, q in enumerate(program.instances):
        noisy[i] = q.block.noise_key is not None or any(noisy[a] for a in q.args)
        if q.autonomous and noisy[i]:
            total[i] = max((total[a] for a in q.args), default=0) + (
                q.block.memory(design[i][0]) if q.kind == "block" else 0
            )
            if total[i] > lead(fs):
                raise SceneError(
                    f"{q.block!r}: {total[i]} samples of filter memory on the path of a noise, more"
                    f" than the {lead(fs)} that run before sample 0 at fs = {fs:g} Hz; use lower"
                    " orders or shorter delays"
                )


def first_states(
    program: Program, design: list[tuple[Any, Any]], start: Callable[..., Any] = start
) -> Callable[[int], np.ndarray]:
    """Return a function of the seed that gives all states before the lead.

    The result is an array of words in canonical order: instance order, then field
    order.
    """
    own, parts, at = [], [np.zeros(0, np.uint64)], 0
    for q, (p, s) in zip(program.instances, design, strict=True):
        if q.kind == "block":
            if type(q.block).start is not Block.start:
                own.append((at, q.block, p, s, program.seeds[q.clock]))
            parts.append(pack(s))
            at += parts[-1].size
    rest = np.concatenate(parts)

    def first(seed: int) -> np.ndarray:
        words = rest.copy()
        with np.errstate(all="ignore"):
            for at, block, p, s, its in own:
                new = pack(start(block, p, s, seed if its is None else its))
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
    for q in program.instances:
        horizon = getattr(q.block, "horizon", None)
        if horizon is not None and frames / fs > horizon:
            warnings.warn(
                f"{q.block!r}: the run of {frames / fs:g} s is longer than horizon = {horizon:g} s,"
                " up to which its tolerance holds; beyond, the error grows: give a longer horizon",
                RuntimeWarning,
                stacklevel=outside(),
            )
            return
