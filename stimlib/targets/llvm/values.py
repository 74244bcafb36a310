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
# numpy's names without the sign of byte order; a truth is one bit, and b1
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


# a NamedTuple, as the tuples of a source are: several() tells them apart. low saves a
# wrap of an index that counts from the end.
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

    # a mark, no wrapper: the walk reads the function's source
    def mark(function):
        function.exported = Outer(function.__name__, result, kinds)
        return function

    return mark


def llvm_type(kind: str) -> ir.Type:
    """Return the type of a kind of arguments or results."""
    if kind == "void":
        return ir.VoidType()
    return KINDS[kind[:-1]].as_pointer() if kind.endswith("*") else KINDS[kind]


def stand_in(value: ir.Value, kind: str) -> Any:
    """Return the stand-in for an argument."""
    return Pointer(value, kind[:-1]) if kind.endswith("*") else Value(value, kind)


# Numbers ------------------------------------------------------------------------------
def plain(value: Any) -> bool:
    """Return whether a number is known now."""
    # numpy's numbers too: design's constants and np.uint64(1) are such
    return isinstance(value, bool | int | float | np.generic)


def number(given: Any) -> Value:
    """Return a number as one of LLVM."""
    if isinstance(given, Value):
        return given
    # a truth before whole numbers: to Python, True is one
    if isinstance(given, bool | np.bool_):
        return Value(TRUTH(int(given)), "b1", True)
    # the one unsigned kind that a step has: keys and counters of noise, phases
    if isinstance(given, np.uint64):
        return Value(I64(int(given)), "u8", True)
    if isinstance(given, int | np.integer):
        # Python's whole numbers have no end, and those of a processor do
        if not -(2**63) <= given < 2**63:
            raise Unknown(f"{given} has more than 64 bits")
        return Value(I64(int(given)), "i8", bool(given >= 0))
    if isinstance(given, float | np.floating):
        return Value(ir.Constant(DOUBLE, float(given)), "f8")
    if isinstance(given, Array):
        raise Unknown("arithmetic with a whole array: write a loop over the samples, or each(..)")
    raise Unknown(f"{type(given).__name__} is no number")


def cast(builder: Any, given: Any, kind: str) -> Value:
    """Return a number as one of another kind."""
    # known now: converted here, and no instruction
    if kind == "f8" and plain(given) and not isinstance(given, float):
        given = float(given)
    given = number(given)
    return given if given.kind == kind else builder.converted(given, kind)


def common(left: Value, right: Value) -> str:
    """Return the kind in which two numbers meet."""
    # as numpy 2 has it, but for a uint64 with a whole number that may be below 0: numpy
    # makes a float of these two, and here they are refused
    kinds = {left.kind, right.kind}
    # a float wins over all whole numbers; one beside a float32 makes a float64, because
    # it has more digits than a float32
    if kinds & {*FLOATS}:
        return "f4" if kinds == {"f4"} else "f8"
    if "u8" in kinds and kinds != {"u8"}:
        # a whole number that is known, and not below 0, is one of uint64 as well
        other = right if left.kind == "u8" else left
        if other.kind != "b1" and not (isinstance(other.v, ir.Constant) and other.low):
            raise Unknown("a uint64 and a whole number: write np.uint64(1), or make both np.int64")
    return "u8" if "u8" in kinds else "i8"


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


def binary(builder: Any, operator_type: type, left: Any, right: Any) -> Any:
    """Return left op right, an operator of Python's arithmetic or a comparison."""
    # both are known now: Python computes, and nothing is written
    if plain(left) and plain(right):
        try:
            with np.errstate(all="ignore"):
                return PYTHON[operator_type](
                    *(
                        float(side) if isinstance(side, np.floating) else side
                        for side in (left, right)
                    )
                )
        except ZeroDivisionError:  # no error where it runs
            pass
    left, right = number(left), number(right)
    # truths know and, or, xor; sums of them would be one bit
    if left.kind == right.kind == "b1" and operator_type not in SIGNS:
        if operator_type not in ON_BITS:
            raise Unknown("arithmetic with comparisons: use where(c, 1.0, 0.0)")
        kind = "b1"
    # a division makes a float, also of whole numbers
    elif operator_type is ast.Div and {left.kind, right.kind} <= {*WHOLE}:
        kind = "f8"
    elif operator_type in SHIFTS:
        if {left.kind, right.kind} & {*FLOATS}:
            raise Unknown("a shift of a float")
        kind = "u8" if "u8" in (left.kind, right.kind) else "i8"
    else:
        kind = common(left, right)
    # before anything is written: a message, instead of an error of LLVM
    if operator_type not in SIGNS and operator_type not in (
        OF_FLOATS if kind in FLOATS else OF_WHOLE
    ):
        raise Unknown(
            f"{operator_type.__name__} of {'floats' if kind in FLOATS else 'whole numbers'}"
        )
    left, right = cast(builder, left, kind), cast(builder, right, kind)
    low = (
        left.low
        if operator_type in SHIFTS
        else right.low
        if operator_type is ast.Mod
        else left.low and right.low
    )
    low = operator_type in RISING and (
        low or operator_type is ast.BitAnd and (left.low or right.low)
    )
    return Value(
        builder.computed(operator_type, left, right, kind),
        "b1" if operator_type in SIGNS else kind,
        low,
    )


# Instructions -------------------------------------------------------------------------
class Builder(ir.IRBuilder):
    """What writes operations of numbers, as instructions."""

    wraps = False  # whether sums of whole numbers may leave 64 bits

    def converted(self, given: Value, kind: str) -> Value:
        """Return a number as one of another kind."""
        value, source, target = given.v, given.kind, KINDS[kind]
        # unordered, so that NaN is true, as in Python
        if kind == "b1":
            zero = ir.Constant(value.type, 0)
            same = self.fcmp_unordered if source in FLOATS else self.icmp_unsigned
            return Value(same("!=", value, zero), kind, True)
        # a wider float has all numbers of the narrower
        if source in FLOATS and kind in FLOATS:
            return Value((self.fpext if kind == "f8" else self.fptrunc)(value, target), kind)
        if source in FLOATS:
            return Value((self.fptoui if kind[0] == "u" else self.fptosi)(value, target), kind)
        if kind in FLOATS:
            return Value((self.uitofp if source[0] in "ub" else self.sitofp)(value, target), kind)
        # zeros or the sign in the new upper bits
        if value.type.width < target.width:
            wider, low = (self.zext, True) if source[0] in "ub" else (self.sext, given.low)
            return Value(wider(value, target), kind, low)
        # a uint64 of 2**63 or more is below 0 as an int64
        low = given.low and (
            source != "u8" or isinstance(value, ir.Constant) and value.constant < 2**63
        )
        return Value(value if value.type == target else self.trunc(value, target), kind, low)

    def beyond(self, given: Value, kind: str) -> ir.Value:
        """Return a float as a whole number: of one beyond, what numpy on x86 makes."""
        most, least = ir.Constant(DOUBLE, 2.0**63), I64(-(2**63))
        # numpy converts what is below 2**63 as an int64, and for a uint64 what is not
        # after 2**63 is taken away
        high = self.fcmp_ordered(">=", given.v, most) if kind == "u8" else TRUTH(0)
        value = self.select(high, self.fsub(given.v, most), given.v)
        fits = self.fcmp_ordered("<", known(self, "fabs", value), most)
        whole = self.select(fits, self.fptosi(value, I64), least)
        return self.xor(whole, self.select(high, least, I64(0)))

    def computed(self, operator_type: type, one: Value, other: Value, kind: str) -> ir.Value:
        """Return one op other, which are of one kind."""
        left, right = one.v, other.v
        if operator_type in SIGNS:
            if kind in FLOATS:
                # NaN equals nothing, so != alone is true of it
                same = self.fcmp_unordered if operator_type is ast.NotEq else self.fcmp_ordered
            else:
                same = self.icmp_unsigned if kind == "u8" else self.icmp_signed
            return same(SIGNS[operator_type], left, right)
        if kind in FLOATS:
            return (
                _modulo(self, left, right)
                if operator_type is ast.Mod
                else getattr(self, ON_FLOATS[operator_type])(left, right)
            )
        if operator_type in ON_WHOLE:
            # they wrap; not so our own indices, or searches would take a tenth longer
            small = any(
                isinstance(side, ir.Constant) and abs(side.constant) < 2**31
                for side in (left, right)
            )
            never = kind == "i8" and small and operator_type is not ast.Mult and not self.wraps
            flags = ("nsw",) if never else ()
            return getattr(self, ON_WHOLE[operator_type])(left, right, flags=flags)
        if operator_type in ON_BITS:
            return getattr(self, ON_BITS[operator_type])(left, right)
        # LLVM leaves shifts by 64 and more undefined
        if operator_type in SHIFTS:
            return _shifted(self, operator_type, left, right, kind)
        # a divisor of 0, and the one quotient that has no int64, end the process on
        # x86: they get 1 instead, and the result is chosen behind
        divisor, none = right, self.icmp_signed("==", right, I64(0))
        if not isinstance(right, ir.Constant) or right.constant in (0, -1):
            bad = none
            if kind == "i8":
                least = self.icmp_signed("==", left, I64(-(2**63)))
                bad = self.or_(none, self.and_(least, self.icmp_signed("==", right, I64(-1))))
            divisor = self.select(bad, I64(1), right)  # else the processor ends the process
        if kind == "u8":
            return (
                self.urem(left, divisor)
                if operator_type is ast.Mod
                else self.select(none, I64(0), self.udiv(left, divisor))
            )
        # the processor rounds towards 0, Python down
        quotient, rest = (
            self.select(none, I64(0), self.sdiv(left, divisor)),
            self.srem(left, divisor),
        )
        # signs differ where their bits do, and then the two roundings
        apart = self.icmp_signed("<", self.xor(rest, right), I64(0))
        turned = self.and_(self.icmp_signed("!=", rest, I64(0)), apart)
        if operator_type is ast.Mod:
            return self.select(turned, self.add(rest, right), rest)
        return self.select(turned, self.sub(quotient, I64(1)), quotient)

    def negative(self, given: Value) -> ir.Value:
        """Return -x."""
        return (self.fneg if given.kind in FLOATS else self.neg)(given.v)

    def size(self, given: Value) -> ir.Value:
        """Return the absolute value."""
        if given.kind in FLOATS:
            return known(self, "fabs", given.v)
        # fabs would be the float's; of the least int64 this is itself, as in numpy
        return self.select(self.icmp_signed("<", given.v, I64(0)), self.neg(given.v), given.v)

    def chosen(self, condition: Value, first: Value, second: Value) -> ir.Value:
        """Return x where c is true, else y; both are of one kind."""
        return self.select(condition.v, first.v, second.v)

    def element(self, pointer: Pointer, index: Value) -> Pointer:
        """Return the address of an element."""
        return Pointer(self.gep(pointer.v, [index.v]), pointer.kind)

    def loaded(self, pointer: Pointer, fixed: bool = False) -> Value:
        """Return the number at an address; fixed: the same in all turns of a loop."""
        if fixed:  # in a loop over vectors, LLVM looks for ever at what follows from one number
            return Value(
                self.load_atomic(pointer.v, "unordered", int(pointer.kind[1])), pointer.kind
            )
        return Value(self.load(pointer.v), pointer.kind)

    def from_end(self, index: Value, count: Value) -> ir.Value:
        """Return the index i, which counts from the end where it is below 0."""
        later = self.add(index.v, count.v, flags=("nsw",))
        return self.select(self.icmp_signed("<", index.v, I64(0)), later, index.v)


def _shifted(
    builder: ir.IRBuilder, operator_type: type, value: ir.Value, amount: ir.Value, kind: str
) -> ir.Value:
    """Emit a shift, as numpy has it for 64 bits and more too."""
    shift = (
        builder.shl
        if operator_type is ast.LShift
        else builder.lshr
        if kind == "u8"
        else builder.ashr
    )
    # known now: nothing to choose when it runs
    if isinstance(amount, ir.Constant) and 0 <= amount.constant < 64:
        return shift(value, amount)
    fits = builder.icmp_unsigned("<", amount, I64(64))
    # far to the right only the sign is left, and 0 of what has none
    if kind == "i8" and operator_type is ast.RShift:
        return builder.ashr(value, builder.select(fits, amount, I64(63)))
    return builder.select(fits, shift(value, builder.and_(amount, I64(63))), I64(0))


def _modulo(builder: ir.IRBuilder, left: ir.Value, right: ir.Value) -> ir.Value:
    """Emit Python's x % y of floats: of the sign of y; NaN where y is 0."""
    zero = ir.Constant(left.type, 0.0)
    rest, below = builder.frem(left, right), builder.fcmp_ordered("<", right, zero)
    apart = builder.xor(below, builder.fcmp_ordered("<", rest, zero))
    turned = builder.select(apart, builder.fadd(rest, right), rest)
    nothing = builder.select(below, ir.Constant(left.type, -0.0), zero)
    # a rest of 0 has the sign of the divisor in Python
    made = builder.select(builder.fcmp_unordered("!=", rest, zero), turned, nothing)
    return builder.select(builder.fcmp_ordered("==", right, zero), rest, made)


# Tuples -------------------------------------------------------------------------------
def several(given: Any) -> bool:
    """Return whether something is a tuple of a source."""
    return isinstance(given, tuple) and not isinstance(
        given, Value | Pointer | Array | Known | Outer
    )


def parts(given: Any) -> Iterator[Any]:
    """Yield the numbers, addresses and fixed objects that something consists of."""
    # a number and an address have fields too, and are leaves
    if isinstance(given, Value | Pointer) or not isinstance(given, tuple):
        yield given
    else:
        for member in given:
            yield from parts(member)


def like(given: Any, leaves: Iterator[Any]) -> Any:
    """Return something that looks like x, of other parts."""
    if isinstance(given, Value | Pointer) or not isinstance(given, tuple):
        return next(leaves)
    return rebuilt(type(given), [like(member, leaves) for member in given])


def rebuilt(kind: type, values: Iterable[Any]) -> Any:
    """Return a tuple of a type."""
    # a NamedTuple takes its fields one by one, a tuple takes a list
    return kind(*values) if hasattr(kind, "_fields") else tuple(values)
