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
    # An edge from each last value to its body closes the cycles: what is then strongly
    # connected must run together, sample by sample. So nested loops, several values fed
    # back and values handed out need no rules of their own.
    reached = _below(nodes, bodies, roots)
    for node in sorted(reached):
        block = nodes[node].block
        if isinstance(block, Last) and node not in bodies:
            raise SceneError(
                f"{block!r} is used, but its loop is not; let the function given to loop return"
                " what uses it, in a tuple"
            )
    group = _groups(nodes, bodies, reached)
    looped = {group[node] for node in reached & bodies.keys()}
    for node in reached:
        # an output that only the outside reads is in no cycle, but what is heard of a
        # cycle are numbers, and a sample of a block with several outputs is a tuple
        if isinstance(nodes[node].block, Pick) and group[nodes[node].kids[0]] in looped:
            group[node] = group[nodes[node].kids[0]]
    heard = {
        kid for node in reached for kid in nodes[node].kids if group[kid] != group[node]
    } | set(roots)
    needs: dict[int, set[int]] = defaultdict(set)
    inside: dict[int, list[int]] = defaultdict(list)
    for node in sorted(reached):
        inside[group[node]].append(node)
        needs[group[node]] |= {group[kid] for kid in _kids(nodes, bodies, node)} - {group[node]}
    for node in sorted(reached):
        if isinstance(nodes[node].block, Subsystem):
            _check_subsystem(nodes, bodies, len(inside[group[node]]) > 1, node)
    new: dict[int, int] = {}
    for members in graphlib.TopologicalSorter(needs).static_order():
        if members not in looped:
            (node,) = inside[members]
            new[node] = number(nodes[node].block, tuple(new[kid] for kid in nodes[node].kids))
            continue
        # a cycle gives out what somebody outside uses, each by a pick
        results = [node for node in inside[members] if node in heard]
        cycle, outside = _cycle(nodes, bodies, inside[members], results)
        whole = number(cycle, tuple(new[kid] for kid in outside))
        for output, node in enumerate(results):
            new[node] = (
                number(Pick(cycle, cycle.outputs[output]), (whole,)) if cycle.outputs else whole
            )
    return [new[node] for node in roots]


def _kids(nodes: Sequence[Any], bodies: dict[int, int], node: int) -> tuple[int, ...]:
    """Return the nodes that a node needs, at this sample or the last."""
    return (*nodes[node].kids, *([bodies[node]] if node in bodies else []))


def _below(nodes: Sequence[Any], bodies: dict[int, int], roots: Iterable[int]) -> set[int]:
    found = set(roots)
    todo = list(found)
    while todo:
        new = [kid for kid in _kids(nodes, bodies, todo.pop()) if kid not in found]
        found.update(new)
        todo += new
    return found


def _groups(nodes: Sequence[Any], bodies: dict[int, int], reached: set[int]) -> list[int]:
    """Return the group number of each node.

    Nodes that depend on each other are in one group.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = [(node, kid) for node in reached for kid in _kids(nodes, bodies, node)]
    size = len(nodes), len(nodes)
    needs = coo_array((np.ones(len(edges)), np.array(edges).T), size)
    return connected_components(needs.tocsr(), connection="strong")[1].tolist()


def _check_subsystem(
    nodes: Sequence[Any], bodies: dict[int, int], on_cycle: bool, node: int
) -> None:
    """Raise SceneError where a subsystem conflicts with a loop.

    It must not be on a cycle, or run nodes outside it.
    """
    block = nodes[node].block
    inside = _below(nodes, {}, nodes[node].kids[:1])
    if on_cycle or any(below in bodies and bodies[below] not in inside for below in inside):
        raise SceneError(
            f"{block!r} is inside a loop, or uses the last value of one: the loop's signal would be"
            " undefined while it is held; enable the whole loop, or only what does not use its last"
            " value,"
            " or choose with where(gate, new, last)"
        )


def _cycle(
    nodes: Sequence[Any], bodies: dict[int, int], inside: list[int], results: list[int]
) -> tuple[Cycle, list[int]]:
    """Return a block made of these nodes, and the numbers of its signals."""
    lasts = [node for node in inside if node in bodies]
    names = dict(zip(lasts, _numbered("last", len(lasts)), strict=True))
    outside: list[int] = []
    constants: list[float] = []
    members: list[Block] = []
    wiring: list[tuple[str, ...]] = []

    def name(kid: int) -> str:
        if kid not in names:
            block = nodes[kid].block
            if isinstance(block, Const):
                names[kid] = f"c{len(constants)}"
                constants.append(block.value)
            else:
                names[kid] = f"x{len(outside)}"
                outside.append(kid)
        return names[kid]

    for node in inside:  # children have smaller numbers
        block, kids = nodes[node]
        if node in bodies:
            continue
        if isinstance(block, Pick):
            names[node] = f"{names[kids[0]]}_{block.output_index}"
            continue
        wiring.append(tuple(map(name, kids)))
        names[node] = f"v{len(members)}"
        members.append(block)
    ends = tuple(name(bodies[node]) for node in lasts)
    dims = tuple(nodes[node].block.dim for node in results)
    starts = [nodes[node].block.first for node in lasts]
    found = [names[node] for node in results]
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
        self.outputs = (  # type: ignore[misc]
            tuple(_numbered("y", len(results))) if len(results) > 1 else ()
        )
        self.dim = dims if self.outputs else dims[0]  # type: ignore[misc]
        self.made: Any = None

    @property
    def definition(self):
        """The composed class."""
        return self.made

    def structure(
        self, numbers: Callable[[Block], Any], known: Callable[[type], Any]
    ) -> tuple[Any, ...]:
        """Return a tuple that identifies the cycle.

        ``numbers`` returns the design numbers of a block, and ``known`` what its class
        is known by.
        """
        parts = [(known(type(member)), numbers(member)) for member in self.members]
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
        every = [getattr(member, "horizon", None) for member in self.members]
        return min((horizon for horizon in every if horizon is not None), default=None)

    def design(self, fs):
        """Design the members and compose their step."""
        designs = []
        for member in self.members:
            designs.append(steps.designed(member, fs))
            if not steps.ours(type(member)):
                steps.rehearse(member, *designs[-1])
        rows = map(self._member, count(), self.members, self.wiring, designs)
        made = compose(tuple(rows), self.ends, len(self.constants), self.inputs, self.results)
        both = [(fields(one.P), fields(one.S)) for one in (self.made, made) if one]
        if both[0] != both[-1]:
            raise SceneError(
                f"{self!r}: at fs = {fs:g} Hz the design of one of its blocks has other fields than"
                " at another sample rate"
            )
        self.made = made
        state = made.S(*self.starts, *(field for _, state in designs for field in state))
        return self._parameters(designs), state

    def _parameters(self, designs: list[tuple[Any, Any]]) -> Any:
        """Return the parameters of the whole, from those of its members."""
        values, rests, words = list(self.constants), [], [self.made.words]
        for member, (numbers, state) in zip(self.made.members, designs, strict=True):
            values += numbers
            if member.contact:
                rests += at_rest(state)
            if member.scratch:
                work = self.members[member.number].definition.work(numbers)
                words += [words[-1], words[-1] + work]
        ends = map(float, words[1:] + words[-1:] if self.made.tile else ())
        return self.made.P(*values, *rests, *ends) if fields(self.made.P) else ()

    def _member(
        self, number: int, block: Block, args: tuple[str, ...], made: tuple[Any, Any]
    ) -> Member:
        kind, contact, (numbers, state) = block.definition, None, made
        if kind.resettable:
            *args, contact = args  # type: ignore[assignment]
            always = contact[0] == "c" and self.constants[int(contact[1:])] > 0.0
            if not always and (
                kind.step is None or any(isinstance(field, np.ndarray) for field in state)
            ):
                raise SceneError(
                    f"{block!r} is inside a loop, where its contact must be a number: its state has"
                    " arrays, which cannot be reset there; move it out of the loop, or multiply its"
                    " output by the contact"
                )
            contact = "" if always else contact
        code: Any = kind.step or kind.tile
        tile = kind.step is None
        scratch = tile and kind.work is not None
        types, outputs = (type(numbers), type(state)), len(block.outputs)
        meaning = () if steps.ours(code) else steps.meaning(code)
        return Member(
            number,
            tuple(args),
            code,
            (code.__code__, meaning),
            tile,
            scratch,
            *types,
            outputs,
            contact,
        )

    def start(self, numbers, state, seed):
        """Return the first state of all members for a seed."""
        values = list(self.starts)
        for member, (of_p, of_s) in zip(self.members, self.parts(numbers, state), strict=True):
            values += member.start(of_p, of_s, seed)
        return type(state)(*values)

    def parts(self, numbers: Any, state: Any) -> list[tuple[Any, Any]]:
        """Return the parameters and state of each member, from those of the whole."""
        found, of_p, of_s = [], iter(numbers[len(self.constants) :]), iter(state[len(self.ends) :])
        for member in self.made.members:
            own = islice(of_p, len(fields(member.p))), islice(of_s, len(fields(member.s)))
            found.append((member.p(*own[0]), member.s(*own[1])))
        return found

    def walk(self, signal: dict[str, Any], through: Callable[..., Any]) -> None:
        """Visit the members once, in running order.

        Each signal (by name) that has no value yet gets what through(member, number,
        names of its input signals) returns.
        """
        for number, (member, args) in enumerate(zip(self.members, self.wiring, strict=True)):
            outputs = (
                None
                if f"v{number}_0" in signal or f"v{number}" in signal
                else through(member, number, args)
            )
            if outputs is not None and member.outputs:
                signal |= zip(_numbered(f"v{number}_", len(member.outputs)), outputs, strict=True)
            elif outputs is not None:
                signal[f"v{number}"] = outputs


def _repr(self: Cycle) -> str:
    return f"Cycle({', '.join(type(member).__name__ for member in self.members)})"


Cycle.__repr__ = _repr  # type: ignore[method-assign, assignment]  # Block gives every class its own


# Its step -----------------------------------------------------------------------------
class Member(NamedTuple):
    """One node of a cycle, as the composed step calls it."""

    number: int
    args: tuple[str, ...]  # last0 | x3 | c0 | v2 | v2_1
    f: Any  # step or tile
    code: Any  # a notebook may change a function in place, and numbers that it uses
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

    def at(self, name: str) -> str:
        """Return the source text for a signal named as in ``Member.args``."""
        if name[0] == "c":
            return f"p.{name}"
        return f"{name}[i]" if self.tiled and name[0] == "x" else name

    def add(self, member: Member) -> None:
        """Append a member: lines for its outputs, and for its new state t{number}."""
        args = [*map(self.at, member.args)]
        # without memory it is an expression: a function for each node took 60 ms to
        # compile
        if not (fields(member.s) or fields(member.p) or member.tile or member.outputs):
            short = _expression(member.f, args, self.names)
            if short:
                self.lines.append(f"{member.values[0]} = _F({short})")
                return
        new = f"t{member.number}"
        state = member.named("s.m", member.s)
        if state and self.tiled:
            self.before.append(f"{new} = {codegen.record(self.names(member.s), state)}")
            state = codegen.each(f"{new}.%s", fields(member.s))
        if member.contact:
            state = self._enter(member, state)
        numbers = codegen.record(self.names(member.p), member.named("p.m", member.p))
        if member.tile:
            self._call_tile(member, numbers, new if state else "()", args)
        else:
            old = codegen.record(self.names(member.s), state)
            made = codegen.several(member.values, bool(member.outputs))
            self.lines.append(
                f"{made}, {new} = {codegen.call(self.names(member.f), numbers, old, *args)}"
            )
            self.lines += codegen.each("%s = _F(%s)", member.values, member.values)
        if member.contact:
            self._leave(member)
        elif member.contact is not None:
            self.lines.append(
                f"{new} = {codegen.warm(self.names(member.s), fields(member.s), new)}"
            )

    def _call_tile(self, member: Member, numbers: str, state: str, args: list[str]) -> None:
        """Write the call of a tile.

        Its signals are slices of the scratch array, one sample long.
        """
        start, first = self.words, self.words + len(args)
        self.words = first + len(member.values)
        slices = codegen.each(
            "w[%d:%d]", range(start, self.words), range(start + 1, self.words + 1)
        )
        self.lines += codegen.each("w[%d] = %s", range(start, first), args)
        if member.scratch:
            slices.append(f"w[_I(p.w{member.number}):_I(p.w{member.number}_end)]")
        self.lines.append(
            f"t{member.number} = {codegen.call(self.names(member.f), numbers, state, *slices)}"
        )
        self.lines += codegen.each("%s = w[%d]", member.values, range(first, self.words))

    def _enter(self, member: Member, state: list[str]) -> list[str]:
        """Return the state with which a member starts a sample: at rest off contact."""
        cold = state[-1]
        self.lines.append(f"on{member.number} = {self.at(member.contact or '')} > 0.0")
        self.lines.append(f"cold{member.number} = _where({cold} == 0.0, 1.0, {cold})")
        return [*self._or_at_rest(member, state[:-1]), cold]

    def _leave(self, member: Member) -> None:
        """Write a member's outputs and new state.

        Off contact the outputs are 0 and the state is at rest.
        """
        number = member.number
        new = self._or_at_rest(member, codegen.each(f"t{number}.%s", fields(member.s)[:-1]))
        self.lines += codegen.each(
            f"%s = _where(on{number}, %s, 0.0)", member.values, member.values
        )
        made = codegen.call(self.names(member.s), *new, f"_where(on{number}, 0.0, cold{number})")
        self.lines.append(f"t{number} = {made}")

    def _or_at_rest(self, member: Member, state: list[str]) -> list[str]:
        rest = member.named("p.r", member.s)[:-1]
        return codegen.each(f"_where(on{member.number}, %s, %s)", state, rest)


@memo
def compose(
    members: tuple[Member, ...],
    ends: tuple[str, ...],
    constants: int,
    inputs: int,
    results: tuple[str, ...],
) -> Any:
    """Return a class with the step or tile of a cycle, and the types of its data."""
    # numbers are parameters, so the text has only the structure: loops that differ in
    # numbers share a segment
    tiled = any(member.tile for member in members)
    names = _Names(_F=np.float64, _settle=maths.settle, _where=maths.where, _I=np.int64)
    writer = _Writer(tiled, names)
    lasts, p_names, kept = _numbered("last", len(ends)), _numbered("c", constants), []
    signals, outputs = _numbered("x", inputs), _numbered("y", len(results))
    s_names, at_rests, scratch = list(lasts), [], []
    for member in members:
        writer.add(member)
        p_names += member.named("m", member.p)
        s_names += member.named("m", member.s)
        kept += codegen.each(f"t{member.number}.%s", fields(member.s))
        if member.contact:
            at_rests += member.named("r", member.s)
        if member.scratch:
            scratch += [f"w{member.number}", f"w{member.number}_end"]
    if tiled:
        scratch.append("words")
    Parameters = namedtuple("LoopParams", [*p_names, *at_rests, *scratch])  # type: ignore[misc]
    State = namedtuple("LoopState", s_names)  # type: ignore[misc]
    names.space["_S"] = State
    # with a branch that is hardly ever taken: a selection would lengthen the recursion
    # by 2.3 ns
    settled = codegen.each("_settle(_F(%s))", map(writer.at, ends))
    found = [*map(writer.at, results)]
    body = [*codegen.each("%s = s.%s", lasts, lasts), *writer.before]
    if tiled:
        each = codegen.each("%s[i] = %s", outputs, found)
        each.append(f"{', '.join(lasts)} = {', '.join(settled)}")
        body += ["for i in range(y0.size):", *codegen.indented([*writer.lines, *each])]
        body.append(f"return {codegen.call('_S', *lasts, *kept)}")
        text = codegen.define("tile", ["p", "s", *signals, *outputs, "w"], body)
    else:
        body += writer.lines
        made = codegen.several(found, len(results) > 1)
        body.append(f"return {made}, {codegen.call('_S', *settled, *kept)}")
        text = codegen.define("step", ["p", "s", *signals], body)
    function = staticmethod(_function(text, names.space))
    definition = {
        "P": Parameters,
        "S": State,
        "members": members,
        "words": writer.words,
        "resettable": False,
        "step": None if tiled else function,
        "tile": function if tiled else None,
        "work": staticmethod(lambda p: int(p.words)) if tiled else None,
        "abreast": None,
        "outputs": tuple(outputs) if len(outputs) > 1 else (),
    }
    return type("Loop", (), definition)


def _function(text: str, space: dict[str, Any]) -> Any:
    """Return the function with this source, registered so that Python can find it."""
    # named by its content: the same loop, made again, is the same file
    file = f"<loop {hashlib.sha256(text.encode()).hexdigest()[:16]}>"
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    # a text of this module: nothing of a scene's file is in it
    exec(compile(text, file, "exec"), space)
    function = space["tile" if text.startswith("def tile") else "step"]
    steps.source(function)  # read now: anybody may empty linecache
    return function


def _expression(function: Callable, args: list[str], names: _Names) -> str | None:
    """Return the expression that a memoryless step returns, or None.

    An expression compiles faster than a call. None stands for any other step.
    """
    (tree,) = ast.parse(steps.source(function)).body
    assert isinstance(tree, ast.FunctionDef)
    *first, last = tree.body
    # a docstring
    said = all(
        isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant) for part in first
    )
    if (
        not said
        or tree.args.defaults
        or not isinstance(last, ast.Return)
        or not isinstance(last.value, ast.Tuple)
    ):
        return None
    given = dict(zip([argument.arg for argument in tree.args.args[2:]], args, strict=True))
    known = steps.names(function)

    class Put(ast.NodeTransformer):
        def visit_Name(self, node):
            part = known.get(node.id)
            text = given.get(node.id) or (node.id if part in (abs, range) else names(part))
            return ast.parse(text, mode="eval").body

    value = last.value.elts[0]
    used = {part.id for part in ast.walk(value) if isinstance(part, ast.Name)}
    return ast.unparse(Put().visit(value)) if used <= {*given, *known} else None
