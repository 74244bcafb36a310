"""What a loop runs: all nodes of a cycle as one block, whose step is composed of
theirs.

A ``Cycle`` exists in programs only.  Its step is a text like any other: the
interpreter, the compiler and JAX take it as they take the step of a class.  Where a
node has a tile alone, the whole is a tile that calls it with one sample.
"""

from __future__ import annotations

import ast
import graphlib
import hashlib
import linecache
from collections import Counter, namedtuple
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import SceneError
from . import maths, steps
from .graph import Block, Const, Pick, Subsystem, at_rest, memo
from .loops import Last


# Finding them -------------------------------------------------------------------------
def closed(
    nodes: Sequence[Any], bodies: dict[int, int], roots: list[int], number: Callable[..., int]
) -> list[int]:
    """The roots of a graph without cycles: nodes (block, kids) that depend on each
    other have become one block.

    bodies tells the number of the node whose last value a ``Last`` is.  number(block,
    kids) numbers the nodes of the new graph.
    """
    reached = _below(nodes, bodies, roots)
    for n in sorted(reached):
        b = nodes[n].block
        if isinstance(b, Last) and n not in bodies:
            raise SceneError(
                f"{b!r} is used, and its loop is not: let the function given to loop return what"
                " uses it, in a tuple"
            )
    group = _groups(nodes, bodies, reached)
    together = Counter(group[n] for n in reached)
    for n in sorted(reached):
        if isinstance(nodes[n].block, Subsystem):
            _check_subsystem(nodes, bodies, together[group[n]] > 1, n)
    heard = {k for n in reached for k in nodes[n].kids if group[k] != group[n]} | set(roots)
    needs: dict[int, set[int]] = {}
    inside: dict[int, list[int]] = {}
    for n in sorted(reached):
        inside.setdefault(group[n], []).append(n)
        needs.setdefault(group[n], set()).update(
            group[k] for k in _kids(nodes, bodies, n) if group[k] != group[n]
        )
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
    """What a node needs, at this sample or the last."""
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
    """Of each node the number of its group: nodes of one group depend on each other."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = [(n, k) for n in reached for k in _kids(nodes, bodies, n)]
    size = len(nodes), len(nodes)
    needs = coo_array((np.ones(len(edges)), np.array(edges).T), size)
    return connected_components(needs.tocsr(), connection="strong")[1].tolist()


def _check_subsystem(nodes: Sequence[Any], bodies: dict[int, int], on_cycle: bool, n: int) -> None:
    """Raise SceneError where an ``enabled`` or ``segment`` is on a cycle, or runs what
    is outside of it.
    """
    b = nodes[n].block
    inside = _below(nodes, {}, nodes[n].kids[:1])
    if on_cycle or any(k in bodies and bodies[k] not in inside for k in inside):
        raise SceneError(
            f"{b!r} is inside a loop, or uses the last value of one: nobody could say what the loop"
            " hears while it is held; enable the whole loop, or what does not use its last value,"
            " or choose with where(gate, new, last)"
        )


def _cycle(
    nodes: Sequence[Any], bodies: dict[int, int], inside: list[int], results: list[int]
) -> tuple[Cycle, list[int]]:
    """A block of these nodes, and the numbers of its signals."""
    lasts = [n for n in inside if n in bodies]
    names = {n: f"last{j}" for j, n in enumerate(lasts)}
    outside: list[int] = []
    constants: list[float] = []
    members: list[Block] = []
    wiring: list[tuple[str, ...]] = []

    def name(k: int) -> str:
        if k not in names:
            b, into = nodes[k].block, constants if isinstance(nodes[k].block, Const) else outside
            names[k] = f"{'c' if into is constants else 'x'}{len(into)}"
            into.append(b.value if into is constants else k)
        return names[k]

    for n in inside:  # children have smaller numbers
        b, kids = nodes[n]
        if n in bodies:
            continue
        if isinstance(b, Pick):
            names[n] = f"{names[kids[0]]}_{b.place}"
            continue
        wiring.append(tuple(name(k) for k in kids))
        names[n] = f"v{len(members)}"
        members.append(b)
    ends = tuple(name(bodies[n]) for n in lasts)
    dims = tuple(nodes[n].block.dim for n in results)
    starts = [nodes[n].block.first for n in lasts]
    return (
        Cycle(
            members,
            wiring,
            ends,
            starts,
            constants,
            len(outside),
            [names[n] for n in results],
            dims,
        ),
        outside,
    )


# One block of them --------------------------------------------------------------------
class Cycle(Block, abstract=True):
    """The nodes of a cycle.  It is ready, with a ``definition``, once ``design`` has
    run.
    """

    autonomous = begins_early = False

    def __init__(self, members, wiring, ends, starts, constants, inputs, results, dims):
        self.members, self.wiring, self.ends, self.starts = members, tuple(wiring), ends, starts
        self.constants, self.inputs, self.results = constants, inputs, tuple(results)
        self.outputs = tuple(f"y{j}" for j in range(len(results))) if len(results) > 1 else ()  # type: ignore[misc]
        self.dim = dims if self.outputs else dims[0]  # type: ignore[misc]
        self.made: Any = None

    @property
    def definition(self):
        return self.made

    def structure(self, numbers: Callable[[Block], Any]) -> tuple[Any, ...]:
        """What it is, given the design numbers of a block."""
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
        """The shortest of the members'."""
        return min(
            (h for m in self.members if (h := getattr(m, "horizon", None)) is not None),
            default=None,
        )

    def design(self, fs):
        designs = [steps.designed(m, fs) for m in self.members]
        for m, (p, s) in zip(self.members, designs, strict=True):
            if not steps.ours(type(m)):
                steps.rehearse(m, p, s)
        rows = [
            self._member(m, args, *d)
            for m, args, d in zip(self.members, self.wiring, designs, strict=True)
        ]
        made = compose(tuple(rows), self.ends, len(self.constants), self.inputs, self.results)
        if self.made not in (None, made):
            raise SceneError(
                f"{self!r}: at fs = {fs:g} Hz the design of a block in it has other fields than at"
                " another rate"
            )
        self.made = made
        s = made.S(*self.starts, *(v for _, s in designs for v in s))
        return (
            made.parameters(self.constants, designs, [m.definition.work for m in self.members]),
            s,
        )

    def _member(self, b: Block, args: tuple[str, ...], p: Any, s: Any) -> Member:
        kind, contact = b.definition, None
        if kind.resettable:
            *args, contact = args  # type: ignore[assignment]
            always = contact[0] == "c" and self.constants[int(contact[1:])] > 0.0
            if not always and (kind.step is None or any(isinstance(v, np.ndarray) for v in s)):
                raise SceneError(
                    f"{b!r} is inside a loop, where its contact must be a number: it keeps arrays,"
                    " which nothing there clears; move it out of the loop, or multiply by the"
                    " contact behind it"
                )
            contact = "" if always else contact
        f = kind.step or kind.tile
        tile, scratch = kind.step is None, kind.step is None and kind.work is not None
        return Member(
            tuple(args), f, f.__code__, tile, scratch, type(p), type(s), len(b.outputs), contact
        )

    def start(self, p, s, seed):
        values = list(self.starts)
        for m, (mp, ms) in zip(self.members, self.made.parts(p, s), strict=True):
            values += m.start(mp, ms, seed)
        return type(s)(*values)

    def walk(self, signal: dict[str, Any], through: Callable[..., Any]) -> None:
        """Go once along the members: signal, by name, gets what through(member, number,
        names of its signals) makes of them, but where it has that already."""
        for k, (m, args) in enumerate(zip(self.members, self.wiring, strict=True)):
            y = None if f"v{k}_0" in signal or f"v{k}" in signal else through(m, k, args)
            if y is not None:
                signal |= (
                    {f"v{k}_{j}": part for j, part in enumerate(y)} if m.outputs else {f"v{k}": y}
                )


def _repr(self: Cycle) -> str:
    return f"Cycle({', '.join(type(m).__name__ for m in self.members)})"


Cycle.__repr__ = _repr  # type: ignore[method-assign, assignment]  # Block gives every class its own


# Its step -----------------------------------------------------------------------------
class Member(NamedTuple):
    """One node of a cycle, as far as the composed step knows it."""

    args: tuple[str, ...]  # last0 | x3 | c0 | v2 | v2_1
    f: Any  # step or tile
    code: Any  # a notebook may change a function in place
    tile: bool
    scratch: bool
    p: type
    s: type
    outputs: int  # 0: one, not a tuple
    contact: str | None  # None: not resettable; "": always; else a name as in args


def _fields(t: type) -> tuple[str, ...]:
    return getattr(t, "_fields", ())


class _Names:
    """Globals of a composed step: everything of its members under a name of its own."""

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


@memo
def compose(
    members: tuple[Member, ...],
    ends: tuple[str, ...],
    constants: int,
    inputs: int,
    results: tuple[str, ...],
) -> Any:
    """A class with the step, or the tile, of a cycle, and the types of its parameters
    and state.
    """
    tiled = any(m.tile for m in members)
    names = _Names(_F=np.float64, _settle=maths.settle, _where=maths.where, _I=np.int64)

    def at(a: str) -> str:
        return f"p.{a}" if a[0] == "c" else f"{a}[i]" if tiled and a[0] == "x" else a

    states, lines, words = _lines(members, tiled, at, names)
    own = [(k, f"m{k}_{f}") for k, m in enumerate(members) for f in _fields(m.s)]
    p_fields = [f"c{j}" for j in range(constants)] + [
        f"m{k}_{f}" for k, m in enumerate(members) for f in _fields(m.p)
    ]
    p_fields += [f"r{k}_{f}" for k, m in enumerate(members) if m.contact for f in _fields(m.s)]
    p_fields += [
        name for k, m in enumerate(members) if m.scratch for name in (f"w{k}", f"w{k}_end")
    ] + ["words"] * tiled
    lasts, xs, ys = (
        [f"{v}{j}" for j in range(n)]
        for v, n in (("last", len(ends)), ("x", inputs), ("y", len(results)))
    )
    P, S = (
        namedtuple("LoopParams", p_fields),
        namedtuple("LoopState", [*lasts, *(f for _, f in own)]),
    )
    names.space["_S"] = S
    kept = [f"t{k}.{f.partition('_')[2]}" for k, f in own]
    before = [f"{v} = s.{v}" for v in lasts]
    settled = [f"_settle(_F({at(e)}))" for e in ends]
    if tiled:
        lines += [f"{y}[i] = {at(r)}" for y, r in zip(ys, results, strict=True)]
        lines.append(f"{', '.join(lasts)} = {', '.join(settled)}")
        body = [*before, *states, "for i in range(y0.size):", *(f"    {line}" for line in lines)]
        body.append(f"return _S({', '.join([*lasts, *kept])})")
        head = f"def tile({', '.join(['p', 's', *xs, *ys, 'w'])}):"
    else:
        y = ", ".join(at(r) for r in results)
        body = [
            *before,
            *lines,
            f"return {f'({y})' if len(results) > 1 else y}, _S({', '.join([*settled, *kept])})",
        ]
        head = f"def step({', '.join(['p', 's', *xs])}):"
    f = staticmethod(
        _function("\n".join([head, *(f"    {line}" for line in body)]) + "\n", names.space)
    )

    def parameters(constants: list[float], designs: list[Any], works: list[Any]) -> Any:
        """Of one cycle, from those of its members."""
        values = [*constants, *(v for p, _ in designs for v in p)]
        values += [
            v for m, (_, s) in zip(members, designs, strict=True) if m.contact for v in at_rest(s)
        ]
        end = words
        for m, (p, _), work in zip(members, designs, works, strict=True):
            if m.scratch:
                values += [float(end), float(end := end + work(p))]
        return P(*values, *[float(end)] * tiled) if p_fields else ()

    def parts(p: Any, s: Any) -> list[tuple[Any, Any]]:
        """Parameters and state of each member."""
        p, s = iter(p[constants:]), iter(s[len(ends) :])
        return [
            tuple(t(*(next(v) for _ in _fields(t))) for t, v in ((m.p, p), (m.s, s)))
            for m in members
        ]

    return type(
        "Loop",
        (),
        {
            "step": None if tiled else f,
            "tile": f if tiled else None,
            "resettable": False,
            "S": S,
            "work": staticmethod(lambda p: int(p.words)) if tiled else None,
            "outputs": tuple(ys) if len(ys) > 1 else (),
            "parameters": staticmethod(parameters),
            "parts": staticmethod(parts),
        },
    )


def _lines(
    members: tuple[Member, ...], tiled: bool, at: Callable[[str], str], names: _Names
) -> tuple[list[str], list[str], int]:
    """Lines that take the members' states, those that run them for a sample, and the
    words that tiles among them need.
    """
    before: list[str] = []
    lines: list[str] = []
    words = 0
    for k, m in enumerate(members):
        args, state = [at(a) for a in m.args], [f"s.m{k}_{f}" for f in _fields(m.s)]
        if state and tiled:
            before.append(f"t{k} = {names(m.s)}({', '.join(state)})")
            state = [f"t{k}.{f}" for f in _fields(m.s)]
        plain = not (state or _fields(m.p) or m.tile or m.outputs)
        short = _expression(m.f, args, names) if plain else None
        lines += (
            [f"v{k} = _F({short})"]
            if short
            else _one(k, m, state, args, m.contact and at(m.contact), words, names)
        )
        words += len(m.args) + max(1, m.outputs) if m.tile else 0
    return before, lines, words


def _one(
    k: int,
    m: Member,
    state: list[str],
    args: list[str],
    contact: str | None,
    words: int,
    names: _Names,
) -> list[str]:
    """Lines that run one member for a sample: v{k} or v{k}_0, .., and its new state
    t{k}.
    """
    lines = []
    rest = [f"p.r{k}_{f}" for f in _fields(m.s)]
    if contact:
        lines += [
            f"on{k} = {contact} > 0.0",
            f"cold{k} = _where({state[-1]} == 0.0, 1.0, {state[-1]})",
        ]
        state = [f"_where(on{k}, {v}, {r})" for v, r in zip(state[:-1], rest, strict=False)] + [
            state[-1]
        ]
    p = f"{names(m.p)}({', '.join(f'p.m{k}_{f}' for f in _fields(m.p))})" if _fields(m.p) else "()"
    s = f"{names(m.s)}({', '.join(state)})" if state else "()"
    values = [f"v{k}_{j}" for j in range(m.outputs)] or [f"v{k}"]
    if m.tile:
        s = f"t{k}" if state else s
        places = [f"w[{words + j}:{words + j + 1}]" for j in range(len(args) + len(values))]
        lines += [f"w[{words + j}] = {a}" for j, a in enumerate(args)]
        scratch = [f"w[_I(p.w{k}):_I(p.w{k}_end)]"] * m.scratch
        lines.append(f"t{k} = {names(m.f)}({', '.join([p, s, *places, *scratch])})")
        lines += [f"{v} = w[{words + len(args) + j}]" for j, v in enumerate(values)]
    else:
        left = f"({', '.join(values)})" if m.outputs else values[0]
        lines.append(f"{left}, t{k} = {names(m.f)}({', '.join([p, s, *args])})")
        lines += [f"{v} = _F({v})" for v in values]
    if m.contact is not None:
        new = [f"t{k}.{f}" for f in _fields(m.s)[:-1]]
        if contact:
            new = [f"_where(on{k}, {v}, {r})" for v, r in zip(new, rest, strict=False)]
            lines += [f"{v} = _where(on{k}, {v}, 0.0)" for v in values]
        cold = f"_where(on{k}, 0.0, cold{k})" if contact else "0.0"
        lines.append(f"t{k} = {names(m.s)}({', '.join([*new, cold])})")
    return lines


def _function(text: str, space: dict[str, Any]) -> Any:
    """The function with this text, which is where Python looks for the text of any
    other.
    """
    file = f"<loop {hashlib.sha256(text.encode()).hexdigest()[:16]}>"
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    # a text of this module: nothing of a scene's file is in it
    exec(compile(text, file, "exec"), space)
    f = space["tile" if text.startswith("def tile") else "step"]
    steps.source(f)  # read now: anybody may empty linecache
    return f


def _expression(f: Callable, args: list[str], names: _Names) -> str | None:
    """What a step without memory returns, over these arguments, if it is one
    expression: quicker to compile than a call.
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
