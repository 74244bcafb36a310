"""What a walk computes with: stand-ins for numbers, addresses and arrays.

Operators on them write instructions, or compute at once what is known now.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir

from .instructions import DOUBLE, I32, I64, TRUTH, known

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


class Members(tuple):
    """What belongs to each of several blocks that run side by side."""


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
    # numpy's numbers too: design's constants and np.uint64(1) are such
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


def cast(b: Any, x: Any, kind: str) -> Value:
    """Return a number as one of another kind."""
    if kind == "f8" and plain(x) and not isinstance(x, float):
        x = float(x)
    x = number(x)
    return x if x.kind == kind else b.converted(x, kind)


def common(x: Value, y: Value) -> str:
    """Return the kind in which two numbers meet."""
    # as numpy 2 has it, but for a uint64 with a whole number that may be below 0: numpy
    # makes a float of these two, and here they are refused
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
ON_FLOATS: dict[type, str] = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
ON_WHOLE: dict[type, str] = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
ON_BITS: dict[type, str] = {ast.BitAnd: "and_", ast.BitOr: "or_", ast.BitXor: "xor"}
SHIFTS = ast.LShift, ast.RShift
RISING = ast.Add, ast.Mult, ast.FloorDiv, ast.Mod, ast.RShift, *ON_BITS
OF_FLOATS, OF_WHOLE = (*ON_FLOATS, ast.Mod), (*RISING, ast.Sub, ast.LShift)


def binary(b: Any, op: type, x: Any, y: Any) -> Any:
    """Return x op y, an operator of Python's arithmetic or a comparison."""
    if plain(x) and plain(y):
        try:
            with np.errstate(all="ignore"):
                return PYTHON[op](*(float(v) if isinstance(v, np.floating) else v for v in (x, y)))
        except ZeroDivisionError:  # no error where it runs
            pass
    x, y = number(x), number(y)
    if x.kind == y.kind == "b1" and op not in SIGNS:
        if op not in ON_BITS:
            raise Unknown("arithmetic with comparisons: use where(c, 1.0, 0.0)")
        kind = "b1"
    elif op is ast.Div and {x.kind, y.kind} <= {*WHOLE}:
        kind = "f8"
    elif op in SHIFTS:
        if {x.kind, y.kind} & {*FLOATS}:
            raise Unknown("a shift of a float")
        kind = "u8" if "u8" in (x.kind, y.kind) else "i8"
    else:
        kind = common(x, y)
    if op not in SIGNS and op not in (OF_FLOATS if kind in FLOATS else OF_WHOLE):
        raise Unknown(f"{op.__name__} of {'floats' if kind in FLOATS else 'whole numbers'}")
    x, y = cast(b, x, kind), cast(b, y, kind)
    low = x.low if op in SHIFTS else y.low if op is ast.Mod else x.low and y.low
    low = op in RISING and (low or op is ast.BitAnd and (x.low or y.low))
    return Value(b.computed(op, x, y, kind), "b1" if op in SIGNS else kind, low)


# Instructions -------------------------------------------------------------------------
class Builder(ir.IRBuilder):
    """What writes operations of numbers, as instructions."""

    def converted(self, x: Value, kind: str) -> Value:
        """Return a number as one of another kind."""
        v, own, t = x.v, x.kind, KINDS[kind]
        if kind == "b1":
            zero = ir.Constant(v.type, 0)
            same = self.fcmp_unordered if own in FLOATS else self.icmp_unsigned
            return Value(same("!=", v, zero), kind, True)
        if own in FLOATS and kind in FLOATS:
            return Value((self.fpext if kind == "f8" else self.fptrunc)(v, t), kind)
        if own in FLOATS:
            return Value((self.fptoui if kind[0] == "u" else self.fptosi)(v, t), kind)
        if kind in FLOATS:
            return Value((self.uitofp if own[0] in "ub" else self.sitofp)(v, t), kind)
        if v.type.width < t.width:
            wider, low = (self.zext, True) if own[0] in "ub" else (self.sext, x.low)
            return Value(wider(v, t), kind, low)
        # a uint64 of 2**63 or more is below 0 as an int64
        low = x.low and (own != "u8" or isinstance(v, ir.Constant) and v.constant < 2**63)
        return Value(v if v.type == t else self.trunc(v, t), kind, low)

    def word(self, x: Value) -> ir.Value:
        """Return a float as a uint64: of one beyond, what numpy on x86 makes."""
        most, least = ir.Constant(DOUBLE, 2.0**63), I64(-(2**63))
        high = self.fcmp_ordered(">=", x.v, most)
        v = self.select(high, self.fsub(x.v, most), x.v)
        fits = self.fcmp_ordered("<", known(self, "fabs", v), most)
        whole = self.select(fits, self.fptosi(v, I64), least)
        return self.xor(whole, self.select(high, least, I64(0)))

    def computed(self, op: type, one: Value, other: Value, kind: str) -> ir.Value:
        """Return one op other, which are of one kind."""
        x, y = one.v, other.v
        if op in SIGNS:
            if kind in FLOATS:
                same = self.fcmp_unordered if op is ast.NotEq else self.fcmp_ordered
            else:
                same = self.icmp_unsigned if kind == "u8" else self.icmp_signed
            return same(SIGNS[op], x, y)
        if kind in FLOATS:
            return _modulo(self, x, y) if op is ast.Mod else getattr(self, ON_FLOATS[op])(x, y)
        if op in ON_WHOLE:
            # they wrap; not so next to a place, or searches would take a tenth longer
            small = any(isinstance(v, ir.Constant) and abs(v.constant) < 2**31 for v in (x, y))
            flags = ("nsw",) if kind == "i8" and small and op is not ast.Mult else ()
            return getattr(self, ON_WHOLE[op])(x, y, flags=flags)
        if op in ON_BITS:
            return getattr(self, ON_BITS[op])(x, y)
        if op in SHIFTS:
            return _shifted(self, op, x, y, kind)
        by, none = y, self.icmp_signed("==", y, I64(0))
        if not isinstance(y, ir.Constant) or y.constant in (0, -1):
            bad = none
            if kind == "i8":
                least = self.icmp_signed("==", x, I64(-(2**63)))
                bad = self.or_(none, self.and_(least, self.icmp_signed("==", y, I64(-1))))
            by = self.select(bad, I64(1), y)  # else the processor ends the process
        if kind == "u8":
            return (
                self.urem(x, by) if op is ast.Mod else self.select(none, I64(0), self.udiv(x, by))
            )
        # the processor rounds towards 0, Python down
        quotient, rest = self.select(none, I64(0), self.sdiv(x, by)), self.srem(x, by)
        apart = self.icmp_signed("<", self.xor(rest, y), I64(0))
        turned = self.and_(self.icmp_signed("!=", rest, I64(0)), apart)
        if op is ast.Mod:
            return self.select(turned, self.add(rest, y), rest)
        return self.select(turned, self.sub(quotient, I64(1)), quotient)

    def negative(self, x: Value) -> ir.Value:
        """Return -x."""
        return (self.fneg if x.kind in FLOATS else self.neg)(x.v)

    def size(self, x: Value) -> ir.Value:
        """Return the absolute value."""
        if x.kind in FLOATS:
            return known(self, "fabs", x.v)
        return self.select(self.icmp_signed("<", x.v, I64(0)), self.neg(x.v), x.v)

    def chosen(self, c: Value, x: Value, y: Value) -> ir.Value:
        """Return x where c is true, else y; both are of one kind."""
        return self.select(c.v, x.v, y.v)

    def element(self, p: Pointer, i: Value) -> Pointer:
        """Return the address of an element."""
        return Pointer(self.gep(p.v, [i.v]), p.kind)

    def loaded(self, p: Pointer, fixed: bool = False) -> Value:
        """Return the number at an address; fixed: the same in all turns of a loop."""
        if fixed:  # in a loop over vectors, LLVM looks for ever at what follows from one number
            return Value(self.load_atomic(p.v, "unordered", int(p.kind[1])), p.kind)
        return Value(self.load(p.v), p.kind)

    def from_end(self, i: Value, n: Value) -> ir.Value:
        """Return the index i, which counts from the end where it is below 0."""
        later = self.add(i.v, n.v, flags=("nsw",))
        return self.select(self.icmp_signed("<", i.v, I64(0)), later, i.v)


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
    return rebuilt(type(x), [like(v, leaves) for v in x])


def rebuilt(t: type, values: Iterable[Any]) -> Any:
    """Return a tuple of a type."""
    return t(*values) if hasattr(t, "_fields") else tuple(values)
