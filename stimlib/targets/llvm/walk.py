"""From Python to LLVM's text, for the Python that a step may use and a little more.

A function is walked once, along its syntax, with stand-ins for what it gets: each
operation of a stand-in writes an instruction.  Numbers, tuples and functions that are
known now stay Python's own: a helper is walked where it is called, and a branch on a
known condition is not written.  ``stimlib.core.steps`` checks what a step may use, so
the walk has no rules of its own; what it does not know ends in ``Unknown``.

Variables that are set in a loop or a branch are memory, which LLVM turns into
registers.  Such a variable has one kind: where a later value is of a wider one, the
walk begins anew with that.
"""

from __future__ import annotations

import ast
import inspect
import types
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir

from ...core import steps
from ...errors import StimlibError
from .instructions import BYTES, DOUBLE, I64, TRUTH, known, room
from .values import (
    FLOATS,
    KINDS,
    PYTHON,
    SIGNS,
    Array,
    Intermediate,
    Known,
    Outer,
    Pointer,
    Unknown,
    Value,
    binary,
    cast,
    common,
    exported,
    like,
    llvm_type,
    number,
    parts,
    plain,
    several,
    stand_in,
)

WIDER = "b1", "i8", "f8"  # a variable of one may become one of the next


# Walking ------------------------------------------------------------------------------
class _Anew(Exception):
    """A variable must have a wider kind."""


class Slot(NamedTuple):
    """A variable in memory: what it looks like, and the memory of each of its parts."""

    like: Any
    memory: list[ir.Value]


@cache
def _syntax(f: Callable, code: types.CodeType) -> ast.FunctionDef:
    (node,) = ast.parse(steps.source(f)).body
    assert isinstance(node, ast.FunctionDef)
    return node


OPEN = ast.For | ast.If | ast.While


@cache
def _set_within(node: ast.FunctionDef) -> frozenset[str]:
    """Return the variables that are set in a loop or a branch, loops' own left out."""
    found = set[str]()
    inner = [n for part in node.body if isinstance(part, OPEN) for n in ast.walk(part)]
    loops = [n for n in inner if isinstance(n, ast.For)]
    own = {id(n.target) for n in loops}
    for n in inner:
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store) and id(n) not in own:
            found.add(n.id)
    for name in {n.target.id for n in loops if isinstance(n.target, ast.Name)}:
        inside = {id(v) for n in loops if getattr(n.target, "id", "") == name for v in ast.walk(n)}
        uses = [n for n in ast.walk(node) if isinstance(n, ast.Name) and n.id == name]
        mine = [n for n in loops if getattr(n.target, "id", "") == name]
        nested = any(m is not n and m in ast.walk(n) for m in mine for n in mine)
        if nested or any(id(n) not in inside for n in uses):  # behind, or set elsewhere too
            found.add(name)
    return frozenset(found)


class Frame:
    """A function in the middle of its walk."""

    def __init__(self, f: Any, node: ast.FunctionDef, path: tuple[int, ...]):
        self.f, self.space, self.node, self.path = f, f.__globals__, node, path
        self.names: dict[str, Any] = {}
        self.within = _set_within(node)
        self.calls = 0
        self.end: ir.Block | None = None
        self.loops: list[tuple[ir.Block, ir.Block]] = []  # where continue and break go


RESULT = "return"


class Walk:
    """One function of LLVM, written by walking Python."""

    def __init__(self, twins: dict[Any, Any], wider: dict[Any, str], syntax: dict[Any, Any]):
        self.twins, self.wider, self.syntax = twins, wider, syntax
        self.b: Any = None  # the builder of instructions
        self.frame: Frame = None  # type: ignore[assignment]

    # Variables ------------------------------------------------------------------------
    def set(self, name: str, x: Any) -> None:
        """Set a variable."""
        frame = self.frame
        if name not in frame.within and name != RESULT:
            frame.names[name] = x
            return
        if name not in frame.names:
            leaves = [self._kept(v, (frame.path, name, k)) for k, v in enumerate(parts(x))]
            memory = [self._memory(v.v.type) if hasattr(v, "v") else v for v in leaves]
            frame.names[name] = Slot(like(x, iter(leaves)), memory)
        slot = frame.names[name]
        old, new = [*parts(slot.like)], [*parts(x)]
        if len(old) != len(new):
            raise Unknown(f"{name} changes what it is made of")
        for k, (a, v, to) in enumerate(zip(old, new, slot.memory, strict=True)):
            if isinstance(a, Value):
                v = number(v)
                if v.kind != a.kind:
                    self._widen(a.kind, v.kind, (frame.path, name, k))
                self.b.store(cast(self.b, v, a.kind).v, to)
            elif isinstance(a, Pointer):
                if not isinstance(v, Pointer) or v.kind != a.kind:
                    raise Unknown(f"{name} changes its kind")
                self.b.store(v.v, to)
            elif a is not v:
                raise Unknown(f"{name} is one function or another")

    def _memory(self, t: ir.Type) -> ir.Value:
        """Return memory that is 0 where no branch sets it."""
        p = room(self.b, t)
        with self.b.goto_entry_block():
            self.b.store(ir.Constant(t, None), p)
        return p

    def _kept(self, v: Any, key: Any) -> Any:
        if not plain(v) and not isinstance(v, Value):
            return v
        v = number(v)
        kind = self.wider.get(key, v.kind)
        return Value(ir.Constant(KINDS[kind], ir.Undefined), kind)

    def _widen(self, old: str, new: str, key: Any) -> None:
        if old not in WIDER or new not in WIDER:
            raise Unknown(f"{key[1]} is {old} and becomes {new}")
        if WIDER.index(new) > WIDER.index(old):
            self.wider[key] = new
            raise _Anew

    def get(self, name: str) -> Any:
        """Return the value of a variable, or of a global name."""
        frame = self.frame
        if name not in frame.names:
            if name in frame.space:
                return frame.space[name]
            if name in BUILTINS:
                return BUILTINS[name]
            raise Unknown(f"{name} has no value yet")
        found = frame.names[name]
        return self.read(found) if isinstance(found, Slot) else found

    def read(self, slot: Slot) -> Any:
        """Return what is in a variable's memory."""
        pairs = zip(parts(slot.like), slot.memory, strict=True)
        return like(
            slot.like,
            (a._replace(v=self.b.load(m)) if hasattr(a, "v") else a for a, m in pairs),
        )

    # Expressions ----------------------------------------------------------------------
    def value(self, node: Any) -> Any:
        """Return the value of an expression."""
        form = getattr(self, f"_{type(node).__name__}", None)
        if form is None:
            raise Unknown(f"{ast.unparse(node)[:60]} has no form")
        return form(node)

    def _Constant(self, node: Any) -> Any:
        return node.value

    def _Name(self, node: Any) -> Any:
        return self.get(node.id)

    def _Tuple(self, node: Any) -> Any:
        return tuple(self.several(node.elts))

    def several(self, nodes: Sequence[Any]) -> list[Any]:
        """Return the values of expressions, of which some are unpacked."""
        found: list[Any] = []
        for n in nodes:
            if not isinstance(n, ast.Starred):
                found.append(self.value(n))
            elif several(x := self.value(n.value)):
                found += x
            else:
                raise Unknown(f"{ast.unparse(n)}: only a tuple can be unpacked")
        return found

    def _Attribute(self, node: Any) -> Any:
        of = self.value(node.value)
        fields = of._fields if several(of) and hasattr(of, "_fields") else ()
        size = isinstance(of, Array) and node.attr == "size"
        if isinstance(of, types.ModuleType) or size or node.attr in fields:
            return getattr(of, node.attr)
        raise Unknown(f"{ast.unparse(node)}: only fields of NamedTuples and names of modules")

    def _Subscript(self, node: Any) -> Any:
        of = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            return self.cut(of, node.slice)
        i = self.value(node.slice)
        if several(of):
            return of[i]
        p = self.place(of, i)
        return Value(self.b.load(p.v), p.kind)

    def place(self, of: Any, i: Any) -> Pointer:
        """Return the address of an element; in arrays, -1 is the last."""
        if isinstance(of, Array):
            i = self.from_end(number(i), of.n)
            of = of.p
        if not isinstance(of, Pointer):
            raise Unknown("an index of a number")
        i = cast(self.b, i, "i8")
        return Pointer(self.b.gep(of.v, [i.v]), of.kind)

    def from_end(self, i: Value, n: Value) -> Value:
        """Return an index that counts from the start."""
        if i.kind in FLOATS:
            raise Unknown("an index that is a float")
        if i.kind == "b1":
            raise Unknown("an index that is a comparison")
        if i.kind == "u8" or i.low:
            return i
        i = cast(self.b, i, "i8")
        later = self.b.add(i.v, n.v, flags=("nsw",))
        return Value(self.b.select(self.b.icmp_signed("<", i.v, I64(0)), later, i.v), "i8", True)

    def cut(self, of: Any, node: Any) -> Any:
        """Return a slice of an array or a tuple, as Python cuts it."""
        if several(of):
            ends = (node.lower, node.upper, node.step)
            return of[slice(*(n and self.value(n) for n in ends))]
        if not isinstance(of, Array) or node.step is not None:
            raise Unknown("a slice of a number, or with a step: write a loop over the samples")
        b, zero = self.b, I64(0)

        def bound(part: Any, default: Value) -> ir.Value:
            if part is None:
                return default.v
            x = number(self.value(part))
            if x.kind == "u8":
                return b.select(b.icmp_unsigned(">", x.v, of.n.v), of.n.v, x.v)
            v = self.from_end(x, of.n).v
            v = b.select(b.icmp_signed("<", v, zero), zero, v)
            return b.select(b.icmp_signed(">", v, of.n.v), of.n.v, v)

        low, high = bound(node.lower, number(0)), bound(node.upper, of.n)
        size = b.sub(high, low, flags=("nsw",))
        size = b.select(b.icmp_signed("<", size, zero), zero, size)
        return Array(Pointer(b.gep(of.p.v, [low]), of.p.kind), Value(size, "i8", True))

    def _UnaryOp(self, node: Any) -> Any:
        x = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return (not x) if plain(x) else Value(self.b.not_(self.truth(x)), "b1")
        if plain(x):
            return +x if isinstance(node.op, ast.UAdd) else -x
        if isinstance(node.op, ast.USub):
            x = cast(self.b, x, "i8") if x.kind == "b1" else x
            neg = self.b.fneg if x.kind in FLOATS else self.b.neg
            return Value(neg(x.v), x.kind)
        raise Unknown(f"{ast.unparse(node)[:60]} has no form")

    def _BinOp(self, node: Any) -> Any:
        return binary(self.b, type(node.op), self.value(node.left), self.value(node.right))

    def _Compare(self, node: Any) -> Any:
        left, found = self.value(node.left), None
        for op, part in zip(node.ops, node.comparators, strict=True):
            right = self.value(part)
            one = self._compared(type(op), left, right)
            found = one if found is None else binary(self.b, ast.BitAnd, found, one)
            left = right
        return found

    def _compared(self, op: type, x: Any, y: Any) -> Any:
        """Return x op y."""
        if op in (ast.Is, ast.IsNot) and plain(x) and plain(y):
            return (x is y) == (op is ast.Is)
        if op in (ast.In, ast.NotIn) and several(y):
            found: Any = False
            for v in y:
                found = binary(self.b, ast.BitOr, found, binary(self.b, ast.Eq, x, v))
            return found if op is ast.In else binary(self.b, ast.Eq, found, False)
        if op not in SIGNS:
            raise Unknown("`is` and `in` with a number of the signal: compare with ==")
        return binary(self.b, op, x, y)

    def truth(self, x: Any) -> ir.Value:
        """Return a condition."""
        return cast(self.b, x, "b1").v

    def _BoolOp(self, node: Any) -> Any:
        first, *rest = node.values
        both = isinstance(node.op, ast.And)
        x = self.value(first)
        if not rest:
            return x
        others = ast.BoolOp(node.op, rest)
        if plain(x):
            return self.value(others) if bool(x) == both else x
        one, other = (lambda: self.value(others)), (lambda: x)
        return self.either(self.truth(x), *((one, other) if both else (other, one)))

    def _IfExp(self, node: Any) -> Any:
        test = self.value(node.test)
        if plain(test):
            return self.value(node.body if test else node.orelse)
        one, other = (lambda: self.value(node.body)), (lambda: self.value(node.orelse))
        return self.either(self.truth(test), one, other)

    def either(self, test: ir.Value, *write: Callable[[], Any]) -> Value:
        """Return what one or the other writes, of which only that one runs."""
        b, found = self.b, []
        ends = []
        with b.if_else(test) as sides:
            for side, one in zip(sides, write, strict=True):
                with side:
                    found.append(number(one()))
                    ends.append(b.block)
        kind = "b1" if found[0].kind == found[1].kind == "b1" else common(*found)
        after = b.block
        values = []
        for end, x in zip(ends, found, strict=True):
            b.position_before(end.terminator)
            values.append(cast(b, x, kind).v)
        b.position_at_start(after)
        made = b.phi(KINDS[kind])
        for end, v in zip(ends, values, strict=True):
            made.add_incoming(v, end)
        b.position_at_end(after)
        return Value(made, kind)

    def _Call(self, node: Any) -> Any:
        f = self.value(node.func)
        given = self.several(node.args)
        named = {k.arg: self.value(k.value) for k in node.keywords}
        return self.call(f, given, named)

    def call(self, f: Any, given: Sequence[Any], named: Any = None) -> Any:
        """Return the result of a call."""
        f = self.twins.get(f, f) if isinstance(f, types.FunctionType | type) or f is abs else f
        if isinstance(f, type) and hasattr(f, "_fields"):
            return f(*given, **(named or {}))
        outer = getattr(f, "exported", f)
        if isinstance(f, types.FunctionType) and not isinstance(outer, Outer):
            return self.walk(f, given, named)
        if named:
            raise Unknown(f"give {', '.join(map(str, named))} by place")
        if isinstance(f, Known):
            return f.f(self, *given)
        if isinstance(outer, Outer):
            return self.outside(outer, given)
        raise Unknown(f"a call of {getattr(f, '__name__', f)!s:.60}")

    def outside(self, f: Outer, given: Sequence[Any]) -> Any:
        """Return the result of a function that is called by its name."""
        of = ir.FunctionType(llvm_type(f.result), [llvm_type(k) for k in f.kinds])
        found = self.b.module.globals.get(f.name)
        return self.called(found or ir.Function(self.b.module, of, f.name), f, given)

    def called(self, function: ir.Value, f: Outer, given: Sequence[Any]) -> Any:
        """Return the result of a function of LLVM: of 32 bits, as one of 64."""
        arguments = [
            v.v if isinstance(v, Pointer) else cast(self.b, v, kind).v
            for v, kind in zip(given, f.kinds, strict=True)
        ]
        y = self.b.call(function, arguments)
        if f.result in ("i4", "u4"):
            return cast(self.b, Value(y, f.result), "i8")
        return None if f.result == "void" else stand_in(y, f.result)

    # Functions ------------------------------------------------------------------------
    def walk(self, f: Any, given: Sequence[Any], named: Any = None) -> Any:
        """Return the result of a function, written here."""
        node = self.syntax.get(f.__code__) or _syntax(f, f.__code__)
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
            *body, last = node.body
            early = [n for part in body for n in ast.walk(part) if isinstance(n, ast.Return)]
            if not isinstance(last, ast.Return):
                early += [n for n in ast.walk(last) if isinstance(n, ast.Return)]
            if not early:
                self.statements(body)
                if isinstance(last, ast.Return):
                    return None if last.value is None else self.value(last.value)
                self.statement(last)
                return None
            frame.end = self.b.append_basic_block("returned")
            self.statements(node.body)
            if not self.b.block.is_terminated:
                self.b.branch(frame.end)
            self.b.position_at_end(frame.end)
            return self.read(frame.names[RESULT]) if RESULT in frame.names else None
        finally:
            self.frame = outer

    # Statements -----------------------------------------------------------------------
    def statements(self, nodes: Sequence[Any]) -> None:
        """Write statements, up to one after which nothing runs."""
        for node in nodes:
            if self.b.block.is_terminated:
                return
            self.statement(node)

    def statement(self, node: Any) -> None:
        """Write a statement."""
        try:
            form = getattr(self, f"_{type(node).__name__}", None)
            if form is None:
                raise Unknown(f"{type(node).__name__} has no form")
            form(node)
        except StimlibError:  # of what it calls
            raise
        except RecursionError:
            why = Unknown("an expression that is too deep: split it into several lines")
            raise why from None
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as why:
            e = why if isinstance(why, Unknown) else Unknown(f"{ast.unparse(node)[:60]}: {why}")
            f = self.frame.f
            if not e.where and f.__code__ not in self.syntax and not steps.ours(f):
                line = node.lineno + steps._source(f, f.__code__)[1]
                e.where = f"{f.__code__.co_filename}:{line}: "
            raise e from None

    def _Expr(self, node: Any) -> None:
        if not isinstance(node.value, ast.Constant):  # a docstring
            self.value(node.value)

    def _Pass(self, node: Any) -> None:
        pass

    def _Return(self, node: Any) -> None:
        frame = self.frame
        if node.value is not None:
            self.set(RESULT, self.value(node.value))
        assert frame.end is not None
        self.b.branch(frame.end)

    def _Assign(self, node: Any) -> None:
        x = self.value(node.value)
        for target in node.targets:
            self.assign(target, x)

    def _AugAssign(self, node: Any) -> None:
        target = node.target
        if isinstance(target, ast.Subscript):
            p = self.place(self.value(target.value), self.value(target.slice))
            old: Any = Value(self.b.load(p.v), p.kind)
            self.put(p, binary(self.b, type(node.op), old, self.value(node.value)))
        else:
            self.set(
                target.id,
                binary(self.b, type(node.op), self.get(target.id), self.value(node.value)),
            )

    def assign(self, target: Any, x: Any) -> None:
        """Write an assignment to a name, an element, a slice or several of them."""
        if isinstance(target, ast.Name):
            self.set(target.id, x)
        elif isinstance(target, ast.Tuple):
            if not several(x):
                raise Unknown("a number has no parts")
            for one, v in zip(target.elts, x, strict=True):
                self.assign(one, v)
        elif isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            self.fill(self.cut(self.value(target.value), target.slice), x)
        elif isinstance(target, ast.Subscript):
            self.put(self.place(self.value(target.value), self.value(target.slice)), x)
        else:
            raise Unknown(f"{ast.unparse(target)[:60]} cannot be set")

    def put(self, p: Pointer, x: Any) -> None:
        """Write a number to its place."""
        self.b.store(cast(self.b, x, p.kind).v, p.v)

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
        with self.turns(I64(0), to.n.v, 1) as i:
            b.store(v, b.gep(to.p.v, [i]))

    def _If(self, node: Any) -> None:
        test = self.value(node.test)
        if plain(test):
            self.statements(node.body if test else node.orelse)
            return
        b = self.b
        then, other, end = (b.append_basic_block(n) for n in ("then", "else", "endif"))
        b.cbranch(self.truth(test), then, other)
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

    def _While(self, node: Any) -> None:
        self._no_break(node)
        b = self.b
        head, body, end = (b.append_basic_block(n) for n in ("while", "turn", "endwhile"))
        b.branch(head)
        b.position_at_end(head)
        b.cbranch(self.truth(self.value(node.test)), body, end)
        b.position_at_end(body)
        self._inside(node.body, head, end)
        b.position_at_end(end)
        self.statements(node.orelse)

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

    def _no_break(self, node: Any) -> None:
        """Refuse a loop with an ``else`` that a break would leave out."""
        if node.orelse and any(isinstance(n, ast.Break) for n in ast.walk(node)):
            raise Unknown("`else` of a loop with `break`: write it below the loop")

    def _For(self, node: Any) -> None:
        self._no_break(node)
        if not isinstance(node.iter, ast.Call):
            each = self.value(node.iter)
            leaves = any(isinstance(n, ast.Break | ast.Continue) for n in ast.walk(node))
            if several(each) and not leaves:
                for x in each:  # written once for each
                    self.set(node.target.id, x)
                    self.statements(node.body)
                self.statements(node.orelse)
                return
        if not (isinstance(node.iter, ast.Call) and self.value(node.iter.func) is range):
            raise Unknown("loop with for i in range(..)")
        ends = [number(v) for v in self.several(node.iter.args)]
        if any(v.kind in FLOATS for v in ends):
            raise Unknown("numbers of range are whole: range(np.int64(n))")
        start, stop, by = (
            [number(0), *ends, number(1)] if len(ends) == 1 else [*ends, number(1)][:3]
        )
        if not isinstance(by.v, ir.Constant):
            raise Unknown("the step of a range must be a number")
        first, last = (cast(self.b, v, "i8").v for v in (start, stop))
        with self.turns(first, last, by.v.constant) as i:
            self.set(node.target.id, Value(i, "i8", start.low and by.v.constant > 0))
            self.statements(node.body)
        if node.target.id not in self.frame.within:
            del self.frame.names[node.target.id]
        self.statements(node.orelse)

    @contextmanager
    def turns(self, start: ir.Value, stop: ir.Value, by: int) -> Iterator[ir.Value]:
        """Write a loop; the block gets the number of a turn."""
        b = self.b
        head, body, again, end = (
            b.append_basic_block(n) for n in ("for", "turn", "next", "endfor")
        )
        before = b.block
        b.branch(head)
        b.position_at_end(head)
        i = b.phi(I64)
        b.cbranch(b.icmp_signed("<" if by > 0 else ">", i, stop), body, end)
        b.position_at_end(body)
        self.frame.loops.append((again, end))
        yield i
        self.frame.loops.pop()
        if not b.block.is_terminated:
            b.branch(again)
        b.position_at_end(again)
        i.add_incoming(start, before)
        i.add_incoming(b.add(i, I64(by), flags=("nsw",)), again)
        b.branch(head)
        b.position_at_end(end)


# What is known everywhere -------------------------------------------------------------
def _abs(w: Walk, x: Any) -> Any:
    if plain(x):
        return abs(x)
    if x.kind in FLOATS:
        return Value(known(w.b, "fabs", cast(w.b, x, "f8").v), "f8")
    if x.kind == "u8":
        return x
    x = cast(w.b, x, "i8")
    below = w.b.icmp_signed("<", x.v, I64(0))
    return Value(w.b.select(below, w.b.neg(x.v), x.v), "i8", True)


def _extreme(op: type) -> Known:
    def f(w: Walk, *x: Any) -> Any:
        best, *rest = x
        for v in rest:
            if plain(v) and plain(best):
                best = v if PYTHON[op](v, best) else best
                continue
            one, other = number(v), number(best)
            kind = common(one, other)
            one, other = cast(w.b, one, kind), cast(w.b, other, kind)
            better = binary(w.b, op, one, other)
            both = one.low and other.low if op is ast.Lt else one.low or other.low
            best = Value(w.b.select(better.v, one.v, other.v), kind, both)
        return best

    return Known(f)


def _round(w: Walk, x: Any) -> Any:
    nearest = w.b.module.declare_intrinsic("llvm.rint", [DOUBLE])
    return cast(w.b, Value(w.b.call(nearest, [cast(w.b, x, "f8").v]), "f8"), "i8")


def _to(kind: str, of: Callable[[Any], Any]) -> Known:
    return Known(lambda w, x: of(x) if plain(x) else cast(w.b, x, kind))


BUILTINS = {
    "float": _to("f8", float),
    "range": range, "abs": Known(_abs), "min": _extreme(ast.Lt), "max": _extreme(ast.Gt),
    "round": Known(_round), "True": True, "False": False,
}  # fmt: skip
TYPES: dict[Any, Known] = {
    abs: Known(_abs), np.float64: _to("f8", float), np.int64: _to("i8", int),
    np.uint64: _to("u8", lambda x: np.uint64(int(x) % 2**64)),
}  # fmt: skip


def written(
    functions: dict[str, Any], twins: dict[Any, Any], syntax: dict[Any, Any] | None = None
) -> Intermediate:
    """Return functions that are ``exported`` as LLVM's text.

    Parameters
    ----------
    functions : dict of str to function
    twins : dict
        What stands in the place of functions and types that a function may use.
    syntax : dict
        Syntax trees by the code of functions whose source is in no file.
    """
    module = ir.Module()
    for f in functions.values():
        wider: dict[Any, str] = {}
        while not _write(module, f, Walk(twins | TYPES, wider, syntax or {})):
            pass
    return Intermediate(str(module), list(functions))


def _write(module: ir.Module, f: Any, walk: Walk) -> bool:
    """Write a function into a module; False where it must be done anew."""
    name, result, kinds = f.exported
    of = ir.FunctionType(llvm_type(result), [llvm_type(k) for k in kinds])
    made = module.globals.get(name) or ir.Function(module, of, name)
    entry, start = made.append_basic_block("entry"), made.append_basic_block("start")
    walk.b = ir.IRBuilder(start)
    try:
        y = walk.walk(f, [stand_in(v, k) for v, k in zip(made.args, kinds, strict=True)])
    except _Anew:
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
    tree = ast.parse(source)
    exec(compile(tree, "<generated>", "exec", dont_inherit=True), space)
    syntax = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            syntax[space[node.name].__code__] = node
    for name, (result, *kinds) in exports.items():
        exported(result, *kinds)(space[name])
    return written({name: space[name] for name in exports}, twins, syntax)


def of_module(text: str, name: str, twins: dict[Any, Any]) -> Intermediate:
    """Return what a source file has ``exported`` as LLVM's text."""
    tree = ast.parse(text)
    module = types.ModuleType(name)
    exec(compile(tree, f"<{name}>", "exec", dont_inherit=True), module.__dict__)
    syntax, found = {}, {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            f = module.__dict__[node.name]
            if isinstance(f, types.FunctionType):
                syntax[f.__code__] = node
                if hasattr(f, "exported"):
                    found[node.name] = f
    return written(found, twins, syntax)
