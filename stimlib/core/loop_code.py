"""Feedback loops: the nodes of a cycle become one block with a composed step.

A ``Cycle`` exists in programs only.  Its step is a text like any other: the
interpreter, the compiler and JAX take it as they take the step of a class.  Where a
node has a tile alone, the whole is a tile that calls it with one sample.
"""

from __future__ import annotations

import ast
import graphlib
import hashlib
import linecache
from collections import defaultdict, namedtuple
from collections.abc import Callable, Iterable, Sequence
from itertools import count, islice
from typing import Any, NamedTuple

import numpy as np

from ..errors import SceneError
from . import codegen, maths, steps
from .graph import Block, Const, Pick, at_rest, memo
from .loops import Last
from .steps import fields
from .subsystems import Subsystem


# Finding them -------------------------------------------------------------------------
def closed(
    nodes: Sequence[Any], bodies: dict[int, int], roots: list[int], number: Callable[..., int]
) -> list[int]:
    """Return the roots of a graph after replacing each cycle by one block.

    Nodes (block, kids) that depend on each other form a cycle.

    bodies maps each ``Last`` to the number of the node whose last value it is.
    number(block, kids) numbers the nodes of the new graph.
    """
    reached = _below(nodes, bodies, roots)
    for n in sorted(reached):
        b = nodes[n].block
        if isinstance(b, Last) and n not in bodies:
            raise SceneError(
                f"{b!r} is used, but its loop is not; let the function given to loop return what"
                " uses it, in a tuple"
            )
    group = _groups(nodes, bodies, reached)
    heard = {k for n in reached for k in nodes[n].kids if group[k] != group[n]} | set(roots)
    needs: dict[int, set[int]] = defaultdict(set)
    inside: dict[int, list[int]] = defaultdict(list)
    for n in sorted(reached):
        inside[group[n]].append(n)
        needs[group[n]] |= {group[k] for k in _kids(nodes, bodies, n)} - {group[n]}
    for n in sorted(reached):
        if isinstance(nodes[n].block, Subsystem):
            _check_subsystem(nodes, bodies, len(inside[group[n]]) > 1, n)
    new: dict[int, int] = {}
    for g in graphlib.TopologicalSorter(needs).static_order():
        if not any(n in bodies for n in inside[g]):
            (n,) = inside[g]
            new[n] = number(nodes[n].block, tuple(new[k] for k in nodes[n].kids))
            continue
        results = [n for n in inside[g] if n in heard]
        cycle, outside = _cycle(nodes, bodies, inside[g], results)
        c = number(cycle, tuple(new[k] for k in outside))
        for j, n in enumerate(results):
            new[n] = number(Pick(cycle, cycle.outputs[j]), (c,)) if cycle.outputs else c
    return [new[n] for n in roots]


def _kids(nodes: Sequence[Any], bodies: dict[int, int], n: int) -> tuple[int, ...]:
    """Return the nodes that a node needs, at this sample or the last."""
    return (*nodes[n].kids, *([bodies[n]] if n in bodies else []))


def _below(nodes: Sequence[Any], bodies: dict[int, int], roots: Iterable[int]) -> set[int]:
    found = set(roots)
    todo = list(found)
    while todo:
        new = [k for k in _kids(nodes, bodies, todo.pop()) if k not in found]
        found.update(new)
        todo += new
    return found


def _groups(nodes: Sequence[Any], bodies: dict[int, int], reached: set[int]) -> list[int]:
    """Return the group number of each node.

    Nodes that depend on each other are in one group.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = [(n, k) for n in reached for k in _kids(nodes, bodies, n)]
    size = len(nodes), len(nodes)
    needs = coo_array((np.ones(len(edges)), np.array(edges).T), size)
    return connected_components(needs.tocsr(), connection="strong")[1].tolist()


def _check_subsystem(nodes: Sequence[Any], bodies: dict[int, int], on_cycle: bool, n: int) -> None:
    """Raise SceneError where a subsystem conflicts with a loop.

    It must not be on a cycle, or run nodes outside it.
    """
    b = nodes[n].block
    inside = _below(nodes, {}, nodes[n].kids[:1])
    if on_cycle or any(k in bodies and bodies[k] not in inside for k in inside):
        raise SceneError(
            f"{b!r} is inside a loop, or uses the last value of one: the loop's signal would be"
            " undefined while it is held; enable the whole loop, or only what does not use its last"
            " value,"
            " or choose with where(gate, new, last)"
        )


def _cycle(
    nodes: Sequence[Any], bodies: dict[int, int], inside: list[int], results: list[int]
) -> tuple[Cycle, list[int]]:
    """Return a block made of these nodes, and the numbers of its signals."""
    lasts = [n for n in inside if n in bodies]
    names = dict(zip(lasts, _numbered("last", len(lasts)), strict=True))
    outside: list[int] = []
    constants: list[float] = []
    members: list[Block] = []
    wiring: list[tuple[str, ...]] = []

    def name(k: int) -> str:
        if k not in names:
            b = nodes[k].block
            if isinstance(b, Const):
                names[k] = f"c{len(constants)}"
                constants.append(b.value)
            else:
                names[k] = f"x{len(outside)}"
                outside.append(k)
        return names[k]

    for n in inside:  # children have smaller numbers
        b, kids = nodes[n]
        if n in bodies:
            continue
        if isinstance(b, Pick):
            names[n] = f"{names[kids[0]]}_{b.place}"
            continue
        wiring.append(tuple(map(name, kids)))
        names[n] = f"v{len(members)}"
        members.append(b)
    ends = tuple(name(bodies[n]) for n in lasts)
    dims = tuple(nodes[n].block.dim for n in results)
    starts = [nodes[n].block.first for n in lasts]
    found = [names[n] for n in results]
    whole = Cycle(members, wiring, ends, starts, constants, len(outside), found, dims)
    return whole, outside


# One block of them --------------------------------------------------------------------
class Cycle(Block, abstract=True):
    """The nodes of a cycle, as one block.

    It is complete, with a ``definition``, after ``design``.
    """

    autonomous = begins_early = False

    def __init__(self, members, wiring, ends, starts, constants, inputs, results, dims):
        self.members, self.wiring, self.ends, self.starts = members, tuple(wiring), ends, starts
        self.constants, self.inputs, self.results = constants, inputs, tuple(results)
        self.outputs = tuple(_numbered("y", len(results))) if len(results) > 1 else ()  # type: ignore[misc]
        self.dim = dims if self.outputs else dims[0]  # type: ignore[misc]
        self.made: Any = None

    @property
    def definition(self):
        """The composed class."""
        return self.made

    def structure(self, numbers: Callable[[Block], Any]) -> tuple[Any, ...]:
        """Return a tuple that identifies the cycle.

        ``numbers`` returns the design numbers of a block.
        """
        parts = [(type(m), numbers(m)) for m in self.members]
        return (
            *parts,
            self.wiring,
            self.ends,
            repr(self.starts),
            repr(self.constants),
            self.results,
        )

    @property
    def horizon(self) -> float | None:
        """The shortest horizon of the members."""
        every = [getattr(m, "horizon", None) for m in self.members]
        return min((h for h in every if h is not None), default=None)

    def design(self, fs):
        """Design the members and compose their step."""
        designs = []
        for m in self.members:
            designs.append(steps.designed(m, fs))
            if not steps.ours(type(m)):
                steps.rehearse(m, *designs[-1])
        rows = map(self._member, count(), self.members, self.wiring, designs)
        made = compose(tuple(rows), self.ends, len(self.constants), self.inputs, self.results)
        if self.made not in (None, made):
            raise SceneError(
                f"{self!r}: at fs = {fs:g} Hz the design of one of its blocks has other fields than"
                " at another sample rate"
            )
        self.made = made
        s = made.S(*self.starts, *(v for _, s in designs for v in s))
        return self._parameters(designs), s

    def _parameters(self, designs: list[tuple[Any, Any]]) -> Any:
        """Return the parameters of the whole, from those of its members."""
        values, rests, words = list(self.constants), [], [self.made.words]
        for m, (p, s) in zip(self.made.members, designs, strict=True):
            values += p
            if m.contact:
                rests += at_rest(s)
            if m.scratch:
                work = self.members[m.number].definition.work(p)
                words += [words[-1], words[-1] + work]
        ends = map(float, words[1:] + words[-1:] if self.made.tile else ())
        return self.made.P(*values, *rests, *ends) if fields(self.made.P) else ()

    def _member(self, k: int, b: Block, args: tuple[str, ...], made: tuple[Any, Any]) -> Member:
        kind, contact, (p, s) = b.definition, None, made
        if kind.resettable:
            *args, contact = args  # type: ignore[assignment]
            always = contact[0] == "c" and self.constants[int(contact[1:])] > 0.0
            if not always and (kind.step is None or any(isinstance(v, np.ndarray) for v in s)):
                raise SceneError(
                    f"{b!r} is inside a loop, where its contact must be a number: its state has"
                    " arrays, which cannot be reset there; move it out of the loop, or multiply its"
                    " output by the contact"
                )
            contact = "" if always else contact
        f: Any = kind.step or kind.tile
        tile = kind.step is None
        scratch = tile and kind.work is not None
        types, outputs = (type(p), type(s)), len(b.outputs)
        return Member(k, tuple(args), f, f.__code__, tile, scratch, *types, outputs, contact)

    def start(self, p, s, seed):
        """Return the first state of all members for a seed."""
        values = list(self.starts)
        for b, (of_p, of_s) in zip(self.members, self.parts(p, s), strict=True):
            values += b.start(of_p, of_s, seed)
        return type(s)(*values)

    def parts(self, p: Any, s: Any) -> list[tuple[Any, Any]]:
        """Return the parameters and state of each member, from those of the whole."""
        found, of_p, of_s = [], iter(p[len(self.constants) :]), iter(s[len(self.ends) :])
        for m in self.made.members:
            own = islice(of_p, len(fields(m.p))), islice(of_s, len(fields(m.s)))
            found.append((m.p(*own[0]), m.s(*own[1])))
        return found

    def walk(self, signal: dict[str, Any], through: Callable[..., Any]) -> None:
        """Visit the members once, in running order.

        Each signal (by name) that has no value yet gets what through(member, number,
        names of its input signals) returns.
        """
        for k, (m, args) in enumerate(zip(self.members, self.wiring, strict=True)):
            y = None if f"v{k}_0" in signal or f"v{k}" in signal else through(m, k, args)
            if y is not None and m.outputs:
                signal |= zip(_numbered(f"v{k}_", len(m.outputs)), y, strict=True)
            elif y is not None:
                signal[f"v{k}"] = y


def _repr(self: Cycle) -> str:
    return f"Cycle({', '.join(type(m).__name__ for m in self.members)})"


Cycle.__repr__ = _repr  # type: ignore[method-assign, assignment]  # Block gives every class its own


# Its step -----------------------------------------------------------------------------
class Member(NamedTuple):
    """One node of a cycle, as the composed step calls it."""

    number: int
    args: tuple[str, ...]  # last0 | x3 | c0 | v2 | v2_1
    f: Any  # step or tile
    code: Any  # a notebook may change a function in place
    tile: bool
    scratch: bool
    p: type
    s: type
    outputs: int  # 0: one, not a tuple
    contact: str | None  # None: not resettable; "": always; else a name as in args

    def named(self, what: str, t: type) -> list[str]:
        """Return the names that the node's fields have in the whole cycle."""
        return codegen.each(f"{what}{self.number}_%s", fields(t))

    @property
    def values(self) -> list[str]:
        """Names of the node's outputs."""
        return _numbered(f"v{self.number}_", self.outputs) or [f"v{self.number}"]


def _numbered(name: str, count: int) -> list[str]:
    return codegen.each(f"{name}%d", range(count))


class _Names:
    """Globals of a composed step, in which every object has a name of its own."""

    def __init__(self, **fixed: Any):
        self.space: dict[str, Any] = dict(fixed)
        self.known: dict[Any, str] = {}

    def __call__(self, v: Any) -> str:
        # -0.0 is not 0.0
        key = (type(v), repr(v)) if isinstance(v, (int, float, np.generic)) else id(v)
        if key not in self.known:
            self.known[key] = f"_{len(self.known)}"
            self.space[self.known[key]] = v
        return self.known[key]


class _Writer:
    """Writer of the source lines that run the members of a cycle for a sample.

    It also collects the lines that come before a tile's loop.
    """

    def __init__(self, tiled: bool, names: _Names):
        self.tiled, self.names = tiled, names
        self.before: list[str] = []
        self.lines: list[str] = []
        self.words = 0  # of scratch, for signals of the tiles among the members

    def at(self, a: str) -> str:
        """Return the source text for a signal named as in ``Member.args``."""
        if a[0] == "c":
            return f"p.{a}"
        return f"{a}[i]" if self.tiled and a[0] == "x" else a

    def add(self, m: Member) -> None:
        """Append a member: lines for its outputs, and for its new state t{number}."""
        args = [*map(self.at, m.args)]
        if not (fields(m.s) or fields(m.p) or m.tile or m.outputs):
            short = _expression(m.f, args, self.names)
            if short:
                self.lines.append(f"{m.values[0]} = _F({short})")
                return
        t = f"t{m.number}"
        state = m.named("s.m", m.s)
        if state and self.tiled:
            self.before.append(f"{t} = {self._record(m.s, state)}")
            state = codegen.each(f"{t}.%s", fields(m.s))
        if m.contact:
            state = self._enter(m, state)
        p = self._record(m.p, m.named("p.m", m.p))
        if m.tile:
            self._call_tile(m, p, t if state else "()", args)
        else:
            s = self._record(m.s, state)
            made = codegen.several(m.values, bool(m.outputs))
            self.lines.append(f"{made}, {t} = {codegen.call(self.names(m.f), p, s, *args)}")
            self.lines += codegen.each("%s = _F(%s)", m.values, m.values)
        if m.contact:
            self._leave(m)
        elif m.contact is not None:
            self.lines.append(f"{t} = {codegen.warm(self.names(m.s), fields(m.s), t)}")

    def _record(self, t: type, values: list[str]) -> str:
        # without a field it has no name either
        return codegen.call(self.names(t), *values) if values else "()"

    def _call_tile(self, m: Member, p: str, s: str, args: list[str]) -> None:
        """Write the call of a tile.

        Its signals are slices of the scratch array, one sample long.
        """
        start, first = self.words, self.words + len(args)
        self.words = first + len(m.values)
        places = codegen.each(
            "w[%d:%d]", range(start, self.words), range(start + 1, self.words + 1)
        )
        self.lines += codegen.each("w[%d] = %s", range(start, first), args)
        if m.scratch:
            places.append(f"w[_I(p.w{m.number}):_I(p.w{m.number}_end)]")
        self.lines.append(f"t{m.number} = {codegen.call(self.names(m.f), p, s, *places)}")
        self.lines += codegen.each("%s = w[%d]", m.values, range(first, self.words))

    def _enter(self, m: Member, state: list[str]) -> list[str]:
        """Return the state with which a member starts a sample: at rest off contact."""
        cold = state[-1]
        self.lines.append(f"on{m.number} = {self.at(m.contact or '')} > 0.0")
        self.lines.append(f"cold{m.number} = _where({cold} == 0.0, 1.0, {cold})")
        return [*self._or_at_rest(m, state[:-1]), cold]

    def _leave(self, m: Member) -> None:
        """Write a member's outputs and new state.

        Off contact the outputs are 0 and the state is at rest.
        """
        k = m.number
        new = self._or_at_rest(m, codegen.each(f"t{k}.%s", fields(m.s)[:-1]))
        self.lines += codegen.each(f"%s = _where(on{k}, %s, 0.0)", m.values, m.values)
        made = codegen.call(self.names(m.s), *new, f"_where(on{k}, 0.0, cold{k})")
        self.lines.append(f"t{k} = {made}")

    def _or_at_rest(self, m: Member, state: list[str]) -> list[str]:
        rest = m.named("p.r", m.s)[:-1]
        return codegen.each(f"_where(on{m.number}, %s, %s)", state, rest)


@memo
def compose(
    members: tuple[Member, ...],
    ends: tuple[str, ...],
    constants: int,
    inputs: int,
    results: tuple[str, ...],
) -> Any:
    """Return a class with the step or tile of a cycle, and the types of its data."""
    tiled = any(m.tile for m in members)
    names = _Names(_F=np.float64, _settle=maths.settle, _where=maths.where, _I=np.int64)
    writer = _Writer(tiled, names)
    lasts, p_names, kept = _numbered("last", len(ends)), _numbered("c", constants), []
    xs, ys = _numbered("x", inputs), _numbered("y", len(results))
    s_names, at_rests, scratch = list(lasts), [], []
    for m in members:
        writer.add(m)
        p_names += m.named("m", m.p)
        s_names += m.named("m", m.s)
        kept += codegen.each(f"t{m.number}.%s", fields(m.s))
        if m.contact:
            at_rests += m.named("r", m.s)
        if m.scratch:
            scratch += [f"w{m.number}", f"w{m.number}_end"]
    if tiled:
        scratch.append("words")
    P = namedtuple("LoopParams", [*p_names, *at_rests, *scratch])  # type: ignore[misc]
    S = namedtuple("LoopState", s_names)  # type: ignore[misc]
    names.space["_S"] = S
    settled = codegen.each("_settle(_F(%s))", map(writer.at, ends))
    found = [*map(writer.at, results)]
    body = [*codegen.each("%s = s.%s", lasts, lasts), *writer.before]
    if tiled:
        each = codegen.each("%s[i] = %s", ys, found)
        each.append(f"{', '.join(lasts)} = {', '.join(settled)}")
        body += ["for i in range(y0.size):", *codegen.indented([*writer.lines, *each])]
        body.append(f"return {codegen.call('_S', *lasts, *kept)}")
        text = codegen.define("tile", ["p", "s", *xs, *ys, "w"], body)
    else:
        body += writer.lines
        made = codegen.several(found, len(results) > 1)
        body.append(f"return {made}, {codegen.call('_S', *settled, *kept)}")
        text = codegen.define("step", ["p", "s", *xs], body)
    f = staticmethod(_function(text, names.space))
    definition = {"P": P, "S": S, "members": members, "words": writer.words, "resettable": False}
    definition |= {"step": None, "tile": None, "work": None, "tile" if tiled else "step": f}
    if tiled:
        definition["work"] = staticmethod(lambda p: int(p.words))
    definition["outputs"] = tuple(ys) if len(ys) > 1 else ()
    return type("Loop", (), definition)


def _function(text: str, space: dict[str, Any]) -> Any:
    """Return the function with this source, registered so that Python can find it."""
    file = f"<loop {hashlib.sha256(text.encode()).hexdigest()[:16]}>"
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    # a text of this module: nothing of a scene's file is in it
    exec(compile(text, file, "exec"), space)
    f = space["tile" if text.startswith("def tile") else "step"]
    steps.source(f)  # read now: anybody may empty linecache
    return f


def _expression(f: Callable, args: list[str], names: _Names) -> str | None:
    """Return the expression that a memoryless step returns, or None.

    An expression compiles faster than a call. None stands for any other step.
    """
    (tree,) = ast.parse(steps.source(f)).body
    assert isinstance(tree, ast.FunctionDef)
    *first, last = tree.body
    # a docstring
    said = all(isinstance(v, ast.Expr) and isinstance(v.value, ast.Constant) for v in first)
    if (
        not said
        or tree.args.defaults
        or not isinstance(last, ast.Return)
        or not isinstance(last.value, ast.Tuple)
    ):
        return None
    given = dict(zip([a.arg for a in tree.args.args[2:]], args, strict=True))
    known = steps.names(f)

    class Put(ast.NodeTransformer):
        def visit_Name(self, node):
            v = known.get(node.id)
            text = given.get(node.id) or (node.id if v in (abs, range) else names(v))
            return ast.parse(text, mode="eval").body

    value = last.value.elts[0]
    used = {v.id for v in ast.walk(value) if isinstance(v, ast.Name)}
    return ast.unparse(Put().visit(value)) if used <= {*given, *known} else None
