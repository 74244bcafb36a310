"""What a walk computes with: stand-ins for numbers, addresses and arrays.

Operators on them write instructions, or compute at once what is known now.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir

from .instructions import DOUBLE, I32, I64, TRUTH

SINGLE = ir.FloatType()
KINDS: dict[str, ir.Type] = {
    "f8": DOUBLE, "f4": SINGLE, "i8": I64, "u8": I64, "i4": I32, "u4": I32, "b1": TRUTH,
}  # fmt: skip
FLOATS, WHOLE = ("f8", "f4"), ("i8", "u8", "i4", "u4", "b1")


class Unknown(TypeError):
    """What the walk has no form for; where: file and line, as a message begins."""

    where = ""


class Intermediate(NamedTuple):
    """Functions as LLVM's text, and their names."""

    llvm: str
    names: list[str]


class Value(NamedTuple):
    """A number that is known when the code runs; low: surely not below 0."""

    v: ir.Value
    kind: str
    low: bool = False


class Pointer(NamedTuple):
    """The address of numbers of one kind."""

    v: ir.Value
    kind: str


class Array(NamedTuple):
    """Numbers side by side, and how many."""

    p: Pointer
    n: Value

    @property
    def size(self) -> Value:
        """How many numbers."""
        return self.n


class Known(NamedTuple):
    """A function that writes instructions: f(walk, *arguments)."""

    f: Callable[..., Any]

    def __call__(self, *arguments: Any) -> Any:
        """Refuse to run: a walk writes it."""
        raise TypeError("this function is for sources that are compiled")


class Outer(NamedTuple):
    """A function of the process, by its name."""

    name: str
    result: str
    kinds: tuple[str, ...]


def exported(result: str, *kinds: str) -> Callable:
    """Let others call a function by its name: with arguments of these kinds.

    A kind is "f8", "i8", .., with a star for a pointer; the result may be "void".
    """

    def mark(f):
        f.exported = Outer(f.__name__, result, kinds)
        return f

    return mark


def llvm_type(kind: str) -> ir.Type:
    """Return the type of a kind of arguments or results."""
    if kind == "void":
        return ir.VoidType()
    return KINDS[kind[:-1]].as_pointer() if kind.endswith("*") else KINDS[kind]


def stand_in(v: ir.Value, kind: str) -> Any:
    """Return the stand-in for an argument."""
    return Pointer(v, kind[:-1]) if kind.endswith("*") else Value(v, kind)


# Numbers ------------------------------------------------------------------------------
def plain(x: Any) -> bool:
    """Return whether a number is known now."""
    return isinstance(x, bool | int | float | np.generic)


def number(x: Any) -> Value:
    """Return a number as one of LLVM."""
    if isinstance(x, Value):
        return x
    if isinstance(x, bool | np.bool_):
        return Value(TRUTH(int(x)), "b1", True)
    if isinstance(x, np.uint64):
        return Value(I64(int(x)), "u8", True)
    if isinstance(x, int | np.integer):
        if not -(2**63) <= x < 2**63:
            raise Unknown(f"{x} has more than 64 bits")
        return Value(I64(int(x)), "i8", bool(x >= 0))
    if isinstance(x, float | np.floating):
        return Value(ir.Constant(DOUBLE, float(x)), "f8")
    if isinstance(x, Array):
        raise Unknown("arithmetic with a whole array: write a loop over the samples, or each(..)")
    raise Unknown(f"{type(x).__name__} is no number")


def cast(b: ir.IRBuilder, x: Any, kind: str) -> Value:
    """Return a number as one of another kind."""
    if kind == "f8" and plain(x) and not isinstance(x, float):
        x = float(x)
    x = number(x)
    v, own, t = x.v, x.kind, KINDS[kind]
    if own == kind:
        return x
    if kind == "b1":
        zero = ir.Constant(v.type, 0)
        same = b.fcmp_unordered if own in FLOATS else b.icmp_unsigned
        return Value(same("!=", v, zero), kind, True)
    if own in FLOATS and kind in FLOATS:
        return Value((b.fpext if kind == "f8" else b.fptrunc)(v, t), kind)
    if own in FLOATS:
        return Value((b.fptoui if kind[0] == "u" else b.fptosi)(v, t), kind)
    if kind in FLOATS:
        return Value((b.uitofp if own[0] in "ub" else b.sitofp)(v, t), kind)
    if v.type.width < t.width:
        return Value((b.zext if own[0] in "ub" else b.sext)(v, t), kind, x.low or own[0] in "ub")
    # a uint64 of 2**63 or more is below 0 as an int64
    low = x.low and (own != "u8" or isinstance(v, ir.Constant) and v.constant < 2**63)
    return Value(v if v.type == t else b.trunc(v, t), kind, low)


def common(x: Value, y: Value) -> str:
    """Return the kind in which two numbers meet."""
    both = {x.kind, y.kind}
    if both & {"f8"}:
        return "f8"
    if both & {"f4"}:
        return "f4" if both == {"f4"} else "f8"
    if "u8" in both and both != {"u8"}:
        other = y if x.kind == "u8" else x
        if other.kind != "b1" and not (isinstance(other.v, ir.Constant) and other.low):
            raise Unknown("a uint64 and a whole number: write np.uint64(1), or make both np.int64")
    return "u8" if "u8" in both else "i8"


PYTHON: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod, ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_, ast.BitXor: operator.xor, ast.LShift: operator.lshift,
    ast.RShift: operator.rshift, ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt,
    ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge, ast.Pow: operator.pow,
}  # fmt: skip
SIGNS: dict[type, str] = {
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
}  # fmt: skip
ON_FLOATS = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
ON_WHOLE = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
ON_BITS = {ast.BitAnd: "and_", ast.BitOr: "or_", ast.BitXor: "xor"}
RISING = ast.Add, ast.Mult, ast.FloorDiv, ast.Mod, ast.RShift, ast.BitAnd


def binary(b: ir.IRBuilder, op: type, x: Any, y: Any) -> Any:
    """Return x op y, an operator of Python's arithmetic or a comparison."""
    if plain(x) and plain(y):
        try:
            with np.errstate(all="ignore"):
                return PYTHON[op](*(float(v) if isinstance(v, np.floating) else v for v in (x, y)))
        except ZeroDivisionError:
            pass
    x, y = number(x), number(y)
    if x.kind == y.kind == "b1" and op not in SIGNS:
        if op not in ON_BITS:
            raise Unknown("arithmetic with comparisons: use where(c, 1.0, 0.0)")
        return Value(getattr(b, ON_BITS[op])(x.v, y.v), "b1")
    if op is ast.Div and {x.kind, y.kind} <= {*WHOLE}:
        kind = "f8"
    elif op in (ast.LShift, ast.RShift):
        if {x.kind, y.kind} & {*FLOATS}:
            raise Unknown("a shift of a float")
        kind = "u8" if "u8" in (x.kind, y.kind) else "i8"
    else:
        kind = common(x, y)
    x, y = cast(b, x, kind), cast(b, y, kind)
    if op in SIGNS:
        if kind in FLOATS:
            same = b.fcmp_unordered if op is ast.NotEq else b.fcmp_ordered
        else:
            same = b.icmp_unsigned if kind == "u8" else b.icmp_signed
        return Value(same(SIGNS[op], x.v, y.v), "b1")
    if kind in FLOATS:
        if op in ON_FLOATS:
            return Value(getattr(b, ON_FLOATS[op])(x.v, y.v), kind)
        if op is ast.Mod:
            return Value(_modulo(b, x.v, y.v), kind)
        raise Unknown(f"{op.__name__} of floats")
    low = x.low and y.low and op in RISING
    if op in ON_WHOLE:
        # places do not wrap, or searches would take a quarter longer; randomness may
        large = any(isinstance(v.v, ir.Constant) and abs(v.v.constant) >= 2**31 for v in (x, y))
        flags = ("nsw",) if kind == "i8" and not large else ()
        return Value(getattr(b, ON_WHOLE[op])(x.v, y.v, flags=flags), kind, low)
    if op in ON_BITS:
        both = x.low and y.low or op is ast.BitAnd and (x.low or y.low)
        return Value(getattr(b, ON_BITS[op])(x.v, y.v), kind, both)
    if op in (ast.LShift, ast.RShift):
        return Value(_shifted(b, op, x.v, y.v, kind), kind, x.low and op is ast.RShift)
    if op not in (ast.Mod, ast.FloorDiv):
        raise Unknown(f"{op.__name__} of whole numbers")
    by, none = y.v, b.icmp_signed("==", y.v, I64(0))
    if not isinstance(y.v, ir.Constant) or y.v.constant in (0, -1):
        bad = none
        if kind == "i8":
            least = b.icmp_signed("==", x.v, I64(-(2**63)))
            bad = b.or_(none, b.and_(least, b.icmp_signed("==", y.v, I64(-1))))
        by = b.select(bad, I64(1), y.v)  # else the processor ends the process
    if kind == "u8":
        found = b.urem(x.v, by) if op is ast.Mod else b.select(none, I64(0), b.udiv(x.v, by))
        return Value(found, kind, True)
    quotient, rest = b.select(none, I64(0), b.sdiv(x.v, by)), b.srem(x.v, by)
    apart = b.icmp_signed("<", b.xor(rest, y.v), I64(0))
    turned = b.and_(b.icmp_signed("!=", rest, I64(0)), apart)
    if op is ast.Mod:
        return Value(b.select(turned, b.add(rest, y.v), rest), kind, y.low)
    return Value(b.select(turned, b.sub(quotient, I64(1)), quotient), kind, low)


def _shifted(b: ir.IRBuilder, op: type, x: ir.Value, by: ir.Value, kind: str) -> ir.Value:
    """Emit a shift, as numpy has it for 64 bits and more too."""
    shift = b.shl if op is ast.LShift else b.lshr if kind == "u8" else b.ashr
    if isinstance(by, ir.Constant):
        return shift(x, by)
    fits = b.icmp_unsigned("<", by, I64(64))
    if kind == "i8" and op is ast.RShift:
        return b.ashr(x, b.select(fits, by, I64(63)))
    return b.select(fits, shift(x, b.and_(by, I64(63))), I64(0))


def _modulo(b: ir.IRBuilder, x: ir.Value, y: ir.Value) -> ir.Value:
    """Emit Python's x % y of floats: of the sign of y; NaN where y is 0."""
    zero = ir.Constant(x.type, 0.0)
    rest, below = b.frem(x, y), b.fcmp_ordered("<", y, zero)
    apart = b.xor(below, b.fcmp_ordered("<", rest, zero))
    turned = b.select(apart, b.fadd(rest, y), rest)
    nothing = b.select(below, ir.Constant(x.type, -0.0), zero)
    made = b.select(b.fcmp_unordered("!=", rest, zero), turned, nothing)
    return b.select(b.fcmp_ordered("==", y, zero), rest, made)


# Tuples -------------------------------------------------------------------------------
def several(x: Any) -> bool:
    """Return whether something is a tuple of a source."""
    return isinstance(x, tuple) and not isinstance(x, Value | Pointer | Array | Known | Outer)


def parts(x: Any) -> Iterator[Any]:
    """Yield the numbers, addresses and fixed objects that something consists of."""
    if isinstance(x, Value | Pointer) or not isinstance(x, tuple):
        yield x
    else:
        for v in x:
            yield from parts(v)


def like(x: Any, leaves: Iterator[Any]) -> Any:
    """Return something that looks like x, of other parts."""
    if isinstance(x, Value | Pointer) or not isinstance(x, tuple):
        return next(leaves)
    made = [like(v, leaves) for v in x]
    return type(x)(*made) if hasattr(x, "_fields") else tuple(made)
