"""From Python to LLVM's text, for the Python that a step may use and a little more.

Each operation of a stand-in writes an instruction, and a helper is walked where it is
called.  Variables that are set in a loop or a branch are memory, which LLVM turns into
registers.
"""

from __future__ import annotations

import ast
import inspect
import types
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from llvmlite import ir

from ..walk import TYPES, Anew, Frame, Walk, syntax
from .instructions import BYTES, DOUBLE, I64, TRUTH, room
from .values import (
    KINDS,
    Array,
    Builder,
    Intermediate,
    Known,
    Outer,
    Pointer,
    Unknown,
    Value,
    cast,
    common,
    exported,
    like,
    llvm_type,
    number,
    parts,
    plain,
    stand_in,
)


class Variable(NamedTuple):
    """A variable in memory: what it looks like, and the memory of each of its parts."""

    like: Any
    memory: list[ir.Value]


RESULT = "return"


class Writer(Walk):
    """One function of LLVM, written by walking Python."""

    def set(self, name: str, x: Any) -> None:
        """Set a variable."""
        # set once, in the open: what it stands for is its value, and needs no memory
        frame = self.frame
        if name not in frame.within and name != RESULT:
            frame.names[name] = x
            return
        if name not in frame.names:
            leaves = [
                self._kept(new_part, (frame.path, name, part))
                for part, new_part in enumerate(parts(x))
            ]
            memory = [
                self._memory(new_part.v.type) if hasattr(new_part, "v") else new_part
                for new_part in leaves
            ]
            frame.names[name] = Variable(like(x, iter(leaves)), memory)
        variable = frame.names[name]
        old, new = [*parts(variable.like)], [*parts(x)]
        if len(old) != len(new):
            raise Unknown(f"{name} changes what it is made of")
        for part, (old_part, new_part, to) in enumerate(
            zip(old, new, variable.memory, strict=True)
        ):
            if isinstance(old_part, Value):
                new_part = number(new_part)
                if new_part.kind != old_part.kind:
                    self._widen(old_part.kind, new_part.kind, (frame.path, name, part))
                self.b.store(cast(self.b, new_part, old_part.kind).v, to)
            elif isinstance(old_part, Pointer):
                if not isinstance(new_part, Pointer) or new_part.kind != old_part.kind:
                    raise Unknown(f"{name} changes its kind")
                self.b.store(new_part.v, to)
            elif old_part is not new_part:
                raise Unknown(f"{name} is one function or another")

    def _memory(self, kind: ir.Type) -> ir.Value:
        """Return memory that is 0 where no branch sets it."""
        # it is read back only where Python would say that it has no value; undefined
        # bits there would depend on LLVM
        memory = room(self.b, kind)
        with self.b.goto_entry_block():
            self.b.store(ir.Constant(kind, None), memory)
        return memory

    def _kept(self, part: Any, key: Any) -> Any:
        if not plain(part) and not isinstance(part, Value):
            return part
        part = number(part)
        kind = self.wider.get(key, part.kind)
        return Value(ir.Constant(KINDS[kind], ir.Undefined), kind)

    @property
    def ended(self) -> bool:
        """Whether nothing runs here any more."""
        return self.b.block.is_terminated

    def read(self, variable: Any) -> Any:
        """Return what is in a variable's memory."""
        if not isinstance(variable, Variable):
            return variable
        pairs = zip(parts(variable.like), variable.memory, strict=True)
        return like(
            variable.like,
            (
                part._replace(v=self.b.load(memory)) if hasattr(part, "v") else part
                for part, memory in pairs
            ),
        )

    def put(self, element: Pointer, given: Any) -> None:
        """Write a number to an element."""
        self.b.store(cast(self.b, given, element.kind).v, element.v)

    def part(self, of: Array, ends: Iterator[tuple[Value | None, Value]]) -> Array:
        """Return a slice of an array: its ends, each with that of the array."""
        b, zero = self.b, I64(0)

        def bound(x: Value | None, default: Value) -> ir.Value:
            if x is None:
                return default.v
            if x.kind == "u8":
                return b.select(b.icmp_unsigned(">", x.v, of.n.v), of.n.v, x.v)
            v = self.from_end(x, of.n).v
            v = b.select(b.icmp_signed("<", v, zero), zero, v)
            return b.select(b.icmp_signed(">", v, of.n.v), of.n.v, v)

        low, high = (bound(x, end) for x, end in ends)
        size = b.sub(high, low, flags=("nsw",))
        size = b.select(b.icmp_signed("<", size, zero), zero, size)
        return Array(Pointer(b.gep(of.p.v, [low]), of.p.kind), Value(size, "i8", True))

    def either(self, test: Value, *write: Callable[[], Any]) -> Value:
        """Return what one or the other writes, of which only that one runs."""
        b, found = self.b, []
        ends = []
        with b.if_else(test.v) as sides:
            for side, one in zip(sides, write, strict=True):
                with side:
                    found.append(number(one()))
                    ends.append(b.block)
        # the kind is known after both, and is cast where each ends
        kind = "b1" if found[0].kind == found[1].kind == "b1" else common(*found)
        after = b.block
        values = []
        for end, side_value in zip(ends, found, strict=True):
            b.position_before(end.terminator)
            values.append(cast(b, side_value, kind).v)
        b.position_at_start(after)
        made = b.phi(KINDS[kind])
        for end, cast_value in zip(ends, values, strict=True):
            made.add_incoming(cast_value, end)
        b.position_at_end(after)
        return Value(made, kind)

    def outside(self, outer: Outer, given: Sequence[Any]) -> Any:
        """Return the result of a function that is called by its name."""
        of = ir.FunctionType(llvm_type(outer.result), [llvm_type(kind) for kind in outer.kinds])
        found = self.b.module.globals.get(outer.name)
        return self.called(found or ir.Function(self.b.module, of, outer.name), outer, given)

    def called(self, function: ir.Value, outer: Outer, given: Sequence[Any]) -> Any:
        """Return the result of a function of LLVM: of 32 bits, as one of 64."""
        arguments = [
            argument.v if isinstance(argument, Pointer) else cast(self.b, argument, kind).v
            for argument, kind in zip(given, outer.kinds, strict=True)
        ]
        result = self.b.call(function, arguments)
        if outer.result in ("i4", "u4"):
            return cast(self.b, Value(result, outer.result), "i8")
        return None if outer.result == "void" else stand_in(result, outer.result)

    def walk(self, f: Any, given: Sequence[Any], named: Any = None) -> Any:
        """Return the result of a function, written here."""
        node = self.syntax.get(f.__code__) or syntax(f, f.__code__)
        # a helper is written where it is called: what it gets may be known now.
        # The path tells its variables from those of another call.
        outer = self.frame
        path = () if outer is None else (*outer.path, outer.calls)
        if outer is not None:
            outer.calls += 1
        frame = self.frame = Frame(f, node, path)
        try:
            bound = inspect.signature(f).bind(*given, **(named or {}))
            bound.apply_defaults()
            for name, x in bound.arguments.items():
                self.set(name, x)
            # a single return at the end needs neither memory nor a branch
            *body, last = node.body
            returns = [n for n in ast.walk(node) if isinstance(n, ast.Return)]
            if returns in ([], [last]):
                self.statements(body if returns else node.body)
                return self.value(returns[0].value) if returns and returns[0].value else None
            frame.end = self.b.append_basic_block("returned")
            self.statements(node.body)
            if not self.b.block.is_terminated:
                self.b.branch(frame.end)
            self.b.position_at_end(frame.end)
            return self.read(frame.names[RESULT]) if RESULT in frame.names else None
        finally:
            self.frame = outer

    def _Return(self, node: Any) -> None:
        frame = self.frame
        if node.value is not None:
            self.set(RESULT, self.value(node.value))
        assert frame.end is not None
        self.b.branch(frame.end)

    def fill(self, to: Array, x: Any) -> None:
        """Write a number, or an array's elements, into an array."""
        b = self.b
        if isinstance(x, Array):
            if x.p.kind != to.p.kind:
                raise Unknown("elements of another kind")
            one = b.icmp_signed("==", x.n.v, I64(1))
            with b.if_else(one) as (alone, many):
                with alone:
                    self.fill(to, Value(b.load(x.p.v), x.p.kind))
                with many:  # never more than there are
                    n = b.select(b.icmp_signed("<", x.n.v, to.n.v), x.n.v, to.n.v)
                    given = [b.bitcast(p.v, BYTES) for p in (to.p, x.p)]
                    move = b.module.declare_intrinsic("llvm.memmove", [BYTES, BYTES, I64])
                    b.call(move, [*given, b.mul(n, I64(8)), TRUTH(0)])
            return
        v = cast(b, x, to.p.kind).v
        with self.turns(number(0), to.n, 1) as i:
            b.store(v, b.gep(to.p.v, [i.v]))

    def choose(self, test: Value, node: ast.If) -> None:
        """Write the two sides of a branch."""
        b = self.b
        then, other, end = (b.append_basic_block(n) for n in ("then", "else", "endif"))
        b.cbranch(test.v, then, other)
        goes_on = False
        for block, nodes in ((then, node.body), (other, node.orelse)):
            b.position_at_end(block)
            self.statements(nodes)
            if not b.block.is_terminated:
                b.branch(end)
                goes_on = True
        b.position_at_end(end)
        if not goes_on:
            b.unreachable()

    def repeat(self, node: ast.While) -> None:
        """Write a loop that ends with its condition."""
        b = self.b
        head, body, end = (b.append_basic_block(n) for n in ("while", "turn", "endwhile"))
        b.branch(head)
        b.position_at_end(head)
        b.cbranch(self.truth(self.value(node.test)).v, body, end)
        b.position_at_end(body)
        self._inside(node.body, head, end)
        b.position_at_end(end)

    def _inside(self, nodes: Sequence[Any], again: ir.Block, end: ir.Block) -> None:
        self.frame.loops.append((again, end))
        self.statements(nodes)
        self.frame.loops.pop()
        if not self.b.block.is_terminated:
            self.b.branch(again)

    def _Break(self, node: Any) -> None:
        self.b.branch(self.frame.loops[-1][1])

    def _Continue(self, node: Any) -> None:
        self.b.branch(self.frame.loops[-1][0])

    @contextmanager
    def turns(self, start: Value, stop: Value, by: int) -> Iterator[Value]:
        """Write a loop; the block gets the number of a turn."""
        b = self.b
        head, body, again, end = (
            b.append_basic_block(n) for n in ("for", "turn", "next", "endfor")
        )
        before = b.block
        b.branch(head)
        b.position_at_end(head)
        i = b.phi(I64)
        b.cbranch(b.icmp_signed("<" if by > 0 else ">", i, stop.v), body, end)
        b.position_at_end(body)
        self.frame.loops.append((again, end))
        yield Value(i, "i8", start.low and by > 0)
        self.frame.loops.pop()
        if not b.block.is_terminated:
            b.branch(again)
        b.position_at_end(again)
        i.add_incoming(start.v, before)
        i.add_incoming(b.add(i, I64(by), flags=("nsw",)), again)
        if abs(by) == 1:
            b.branch(head)
        else:  # the next may lie beyond 64 bits
            left = b.sub(stop.v, i) if by > 0 else b.sub(i, stop.v)
            b.cbranch(b.icmp_unsigned(">", left, I64(abs(by))), head, end)
        b.position_at_end(end)


def _round(walk: Walk, given: Any) -> Any:
    nearest = walk.b.module.declare_intrinsic("llvm.rint", [DOUBLE])
    return cast(walk.b, Value(walk.b.call(nearest, [cast(walk.b, given, "f8").v]), "f8"), "i8")


def written(
    functions: dict[str, Any], twins: dict[Any, Any], syntax: dict[Any, Any] | None = None
) -> Intermediate:
    """Return functions that are ``exported`` as LLVM's text.

    Parameters
    ----------
    functions : dict of str to function
    twins : dict
        What stands for functions and types that a function may use.
    syntax : dict
        Syntax trees by the code of functions whose source is in no file.
    """
    module = ir.Module()
    for f in functions.values():
        wider: dict[Any, str] = {}
        while not _write(
            module, f, Writer(twins | TYPES | {round: Known(_round)}, wider, syntax or {})
        ):
            pass
    return Intermediate(str(module), list(functions))


def _write(module: ir.Module, f: Any, walk: Writer) -> bool:
    """Write a function into a module; False where it must be done anew."""
    name, result, kinds = f.exported
    of = ir.FunctionType(llvm_type(result), [llvm_type(k) for k in kinds])
    made = module.globals.get(name) or ir.Function(module, of, name)
    # memory stands in a block of its own, in front: it is asked for in the middle of
    # others
    entry, start = made.append_basic_block("entry"), made.append_basic_block("start")
    walk.b = Builder(start)
    try:
        y = walk.walk(f, [stand_in(v, k) for v, k in zip(made.args, kinds, strict=True)])
    except Anew:
        made.blocks.clear()
        return False
    if not walk.b.block.is_terminated:
        walk.b.ret_void() if result == "void" else walk.b.ret(cast(walk.b, y, result).v)
    ir.IRBuilder(entry).branch(start)
    return True


def of_source(
    source: str, space: dict[str, Any], exports: dict[str, Any], twins: dict[Any, Any]
) -> Intermediate:
    """Return functions of a generated source as LLVM's text.

    Parameters
    ----------
    source : str
    space : dict
        What its names stand for.
    exports : dict of str to (result, *kinds)
    twins : dict
        As in ``written``.
    """
    functions, syntax = _of_text(source, "generated", space)
    for name, (result, *kinds) in exports.items():
        exported(result, *kinds)(space[name])
    return written({name: functions[name] for name in exports}, twins, syntax)


def of_module(text: str, name: str, twins: dict[Any, Any]) -> Intermediate:
    """Return what a source file has ``exported`` as LLVM's text."""
    functions, syntax = _of_text(text, name, types.ModuleType(name).__dict__)
    return written({n: f for n, f in functions.items() if hasattr(f, "exported")}, twins, syntax)


def _of_text(text: str, name: str, space: dict[str, Any]) -> tuple[dict[str, Any], dict[Any, Any]]:
    """Return the functions of a source, and their syntax trees by their code."""
    tree = ast.parse(text)
    exec(compile(tree, f"<{name}>", "exec", dont_inherit=True), space)
    nodes = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    functions = {own: space[own] for own in nodes if isinstance(space[own], types.FunctionType)}
    return functions, {function.__code__: nodes[own] for own, function in functions.items()}
