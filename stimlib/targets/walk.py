"""One walk along the syntax of a step, for the compiler and for the export to C.

A function is walked once, with stand-ins for what it gets.  Numbers, tuples and
functions that are known now stay Python's own, and a branch on a known condition is not
written; what else happens, a printer writes: instructions of LLVM (``llvm/walk.py``) or
C (``export/translate.py``).  ``stimlib.core.steps`` checks what a step may use, so the
walk has no rules of its own; what it does not know ends in ``Unknown``.

A variable that is set in a loop or a branch has one kind: where a later value is of a
wider one, the walk begins anew with that.
"""

from __future__ import annotations

import ast
import types
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir

from ..core import steps
from ..errors import StimlibError
from .llvm.values import (
    FLOATS,
    PYTHON,
    SIGNS,
    Array,
    Known,
    Outer,
    Pointer,
    Unknown,
    Value,
    binary,
    cast,
    common,
    number,
    plain,
    several,
)

WIDER = "b1", "i8", "f8"  # a variable of one may become one of the next


class Anew(Exception):
    """A variable must have a wider kind."""


@cache
def syntax(f: Callable, code: types.CodeType) -> ast.FunctionDef:
    """Return the syntax tree of a function."""
    (node,) = ast.parse(steps.source(f)).body
    assert isinstance(node, ast.FunctionDef)
    return node


OPEN = ast.For | ast.If | ast.While


@cache
def _set_within(node: ast.FunctionDef) -> frozenset[str]:
    """Return the variables that are set in a loop or a branch, loops' own left out."""
    # A loop's own variable is a register, unless it is used behind its loop or set
    # elsewhere: then it is memory, like all others that are set here.
    inner = [n for part in node.body if isinstance(part, OPEN) for n in ast.walk(part)]
    loops = [n for n in inner if isinstance(n, ast.For)]
    own = {id(n.target) for n in loops}
    found = {
        n.id
        for n in inner
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store) and id(n) not in own
    }
    for name in {n.target.id for n in loops if isinstance(n.target, ast.Name)}:
        mine = [n for n in loops if getattr(n.target, "id", "") == name]
        inside = {id(v) for n in mine for v in ast.walk(n)}
        uses = {id(n) for n in ast.walk(node) if isinstance(n, ast.Name) and n.id == name}
        nested = any(m is not n and m in ast.walk(n) for m in mine for n in mine)
        if nested or uses - inside:  # behind, or set elsewhere too
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


class Walk:
    """The forms of expressions and statements.

    What follows is the printer's: variables, elements, slices, choices and loops.
    """

    ended: Any = False  # whether nothing runs here any more
    set: Callable[[str, Any], None]
    put: Callable[[Pointer, Any], None]
    part: Callable[[Array, Iterator[tuple[Value | None, Value]]], Array]
    fill: Callable[[Array, Any], None]
    either: Callable[..., Value]
    walk: Callable[..., Any]
    outside: Callable[..., Any]
    choose: Callable[[Value, ast.If], None]
    repeat: Callable[[ast.While], None]
    turns: Callable[[Value, Value, int], AbstractContextManager[Value]]

    def __init__(self, twins: dict[Any, Any], wider: dict[Any, str], syntax: dict[Any, Any]):
        self.twins, self.wider, self.syntax = twins, wider, syntax
        self.b: Any = None  # the builder of instructions
        self.frame: Frame = None  # type: ignore[assignment]

    # Variables ------------------------------------------------------------------------
    def _widen(self, old: str, new: str, key: Any) -> None:
        if old not in WIDER or new not in WIDER:
            raise Unknown(f"{key[1]} is {old} and becomes {new}")
        # What is written already counts on the narrower kind.  A second walk is simpler
        # than an analysis of kinds before the first, and rare: none of the 144
        # functions of all blocks and shipped scenes takes one.
        if WIDER.index(new) > WIDER.index(old):
            self.wider[key] = new
            raise Anew

    def get(self, name: str) -> Any:
        """Return the value of a variable, or of a global name."""
        frame = self.frame
        # Python's order: variables, globals, builtins
        if name not in frame.names:
            if name in frame.space:
                return frame.space[name]
            if name in BUILTINS:
                return BUILTINS[name]
            raise Unknown(f"{name} has no value yet")
        return self.read(frame.names[name])

    def read(self, x: Any) -> Any:
        """Return the value of what stands for a variable."""
        return x

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
        for node in nodes:
            if not isinstance(node, ast.Starred):
                found.append(self.value(node))
            elif several(unpacked := self.value(node.value)):
                found += unpacked
            else:
                raise Unknown(f"{ast.unparse(node)}: only a tuple can be unpacked")
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
        return self.b.loaded(self.address(of, i), fixed=plain(i))

    def address(self, of: Any, i: Any) -> Pointer:
        """Return the address of an element; in arrays, -1 is the last."""
        if isinstance(of, Array):
            i = self.from_end(number(i), of.n)
            of = of.p
        if not isinstance(of, Pointer):
            raise Unknown("an index of a number")
        return self.b.element(of, cast(self.b, i, "i8"))

    def index(self, i: Value) -> Value:
        """Return a number that is an index."""
        if i.kind in FLOATS:
            raise Unknown("an index that is a float")
        if i.kind == "b1":
            raise Unknown("an index that is a comparison")
        return i

    def from_end(self, i: Value, n: Value) -> Value:
        """Return an index that counts from the start."""
        if self.index(i).kind == "u8" or i.low:
            return i
        return Value(self.b.from_end(cast(self.b, i, "i8"), n), "i8", True)

    def cut(self, of: Any, node: Any) -> Any:
        """Return a slice of an array or a tuple, as Python cuts it."""
        if several(of):
            return of[slice(*(n and self.value(n) for n in (node.lower, node.upper, node.step)))]
        if not isinstance(of, Array) or node.step is not None:
            raise Unknown("a slice of a number, or with a step: write a loop over the samples")
        given = (n and number(self.value(n)) for n in (node.lower, node.upper))
        return self.part(of, zip(given, (number(0), of.n), strict=True))

    def _UnaryOp(self, node: Any) -> Any:
        x = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return (not x) if plain(x) else binary(self.b, ast.BitXor, self.truth(x), True)
        if plain(x):
            return +x if isinstance(node.op, ast.UAdd) else -x
        if isinstance(node.op, ast.USub):
            x = cast(self.b, x, "i8") if x.kind == "b1" else x
            return Value(self.b.negative(x), x.kind)
        raise Unknown(f"{ast.unparse(node)[:60]} has no form")

    def _BinOp(self, node: Any) -> Any:
        return self.computed(node, self.value(node.left), self.value(node.right))

    @property
    def authors(self) -> bool:
        """Whether the function that is walked is an author's."""
        f = self.frame.f
        return f.__code__ not in self.syntax and not steps.ours(f)

    def computed(self, node: Any, left: Any, right: Any) -> Any:
        """Return the result of a node's operator."""
        # our own indices stay far below 2**63, an author's np.int64(x) may not
        self.b.wraps = self.authors
        return binary(self.b, type(node.op), left, right)

    def _Compare(self, node: Any) -> Any:
        left, found = self.value(node.left), None
        for op, part in zip(node.ops, node.comparators, strict=True):
            right = self.value(part)
            one = self._compared(type(op), left, right)
            found = one if found is None else binary(self.b, ast.BitAnd, found, one)
            left = right
        return found

    def _compared(self, op: type, x: Any, y: Any) -> Any:
        if op in (ast.Is, ast.IsNot) and plain(x) and plain(y):
            return (x is y) == (op is ast.Is)
        if op in (ast.In, ast.NotIn) and several(y):
            found: Any = False
            for element in y:
                if (
                    not (plain(x) or plain(element))
                    and number(x).kind == number(element).kind == "f8"
                ):
                    raise Unknown("`in` with numbers of the signal, which may be nan: use ==")
                found = binary(
                    self.b, ast.BitOr, found, x is element or binary(self.b, ast.Eq, x, element)
                )
            return found if op is ast.In else binary(self.b, ast.Eq, found, False)
        if op not in SIGNS:
            raise Unknown("`is` and `in` with a number of the signal: compare with ==")
        return binary(self.b, op, x, y)

    def truth(self, x: Any) -> Value:
        """Return a condition."""
        return cast(self.b, x, "b1")

    def _BoolOp(self, node: Any) -> Any:
        # one at a time: what is not needed must not be written where the first is known
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
        return self.either(
            self.truth(test), lambda: self.value(node.body), lambda: self.value(node.orelse)
        )

    def _Call(self, node: Any) -> Any:
        # in Python's order
        return self.call(
            self.value(node.func),
            self.several(node.args),
            {k.arg: self.value(k.value) for k in node.keywords},
        )

    def call(self, f: Any, given: Sequence[Any], named: Any = None) -> Any:
        """Return the result of a call."""
        # a twin first: a function of ``maths`` is Python, too, and would be walked
        f = self.twins.get(f, f) if isinstance(f, WITH_TWINS) else f
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

    def statements(self, nodes: Sequence[Any]) -> None:
        """Write statements, up to one after which nothing runs."""
        for node in nodes:
            if self.ended:
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
        # Python's own errors come from arithmetic with what is known now; the author
        # reads the line of the innermost statement, which is the first to get here
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as why:
            error = why if isinstance(why, Unknown) else Unknown(f"{ast.unparse(node)[:60]}: {why}")
            if not error.where and self.authors:
                function = self.frame.f
                line = node.lineno + steps._source(function, function.__code__)[1]
                error.where = f"{function.__code__.co_filename}:{line}: "
            raise error from None

    def _Expr(self, node: Any) -> None:
        if not isinstance(node.value, ast.Constant):  # a docstring
            self.value(node.value)

    def _Pass(self, node: Any) -> None:
        pass

    def _Assign(self, node: Any) -> None:
        x = self.value(node.value)
        for target in node.targets:
            self.assign(target, x)

    def _AugAssign(self, node: Any) -> None:
        target = node.target
        if isinstance(target, ast.Subscript):
            element = self.address(self.value(target.value), self.value(target.slice))
            self.put(element, self.computed(node, self.b.loaded(element), self.value(node.value)))
        else:
            self.set(target.id, self.computed(node, self.get(target.id), self.value(node.value)))

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
            self.put(self.address(self.value(target.value), self.value(target.slice)), x)
        else:
            raise Unknown(f"{ast.unparse(target)[:60]} cannot be set")

    def _If(self, node: Any) -> None:
        test = self.value(node.test)
        if plain(test):
            self.statements(node.body if test else node.orelse)
            return
        self.choose(self.truth(test), node)

    def _While(self, node: Any) -> None:
        self._no_break(node)
        self.repeat(node)
        self.statements(node.orelse)

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
        # its sign decides the comparison that ends the loop
        if not isinstance(by.v, ir.Constant) or by.v.constant == 0:
            raise Unknown("the step of a range must be a number, and not 0")
        first, last = (cast(self.b, v, "i8") for v in (start, stop))
        with self.turns(first, last, by.v.constant) as i:
            self.set(node.target.id, i)
            self.statements(node.body)
        if node.target.id not in self.frame.within:
            del self.frame.names[node.target.id]
        self.statements(node.orelse)


# What is known everywhere -------------------------------------------------------------
def _abs(walk: Walk, given: Any) -> Any:
    if plain(given):
        return abs(given)
    if given.kind == "u8":
        return given
    kind = "f8" if given.kind in FLOATS else "i8"
    return Value(walk.b.size(cast(walk.b, given, kind)), kind, kind == "i8")


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
            best = Value(w.b.chosen(better, one, other), kind, both)
        return best

    return Known(f)


def _to(kind: str, of: Callable[[Any], Any]) -> Known:
    """Return a conversion: of an author's float beyond, what numpy on x86 makes."""

    def convert(walk: Walk, given: Any) -> Any:
        if plain(given) or kind == "f8" or number(given).kind not in FLOATS or not walk.authors:
            return of(given) if plain(given) else cast(walk.b, given, kind)
        return Value(walk.b.beyond(cast(walk.b, given, "f8"), kind), kind)

    return Known(convert)


WITH_TWINS = types.FunctionType | types.BuiltinFunctionType | type
BUILTINS = {
    "float": _to("f8", float),
    "range": range, "abs": abs, "round": round, "min": _extreme(ast.Lt), "max": _extreme(ast.Gt),
    "True": True, "False": False,
}  # fmt: skip
TYPES: dict[Any, Known] = {
    abs: Known(_abs), np.float64: _to("f8", float), np.int64: _to("i8", np.int64),
    np.uint64: _to("u8", np.uint64),
}  # fmt: skip
