"""Straight-line functions on several numbers at once.

A function is run on stand-ins, each operation of which writes its vector instruction.

So a loop over a helper is vectors by construction.  Left to LLVM, it would take shorter
vectors or none.
"""

from __future__ import annotations

import types as python
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir

from ...core import maths
from ...core.steps import used
from .instructions import DOUBLE, I64, TRUTH, flush, known, splat


class Lanes:
    """Float64, uint64 or truth values, side by side in a vector."""

    __array_ufunc__ = None  # a numpy scalar on the left leaves the operation to us

    def __init__(self, b: ir.IRBuilder, v: ir.Value):
        self.b, self.v = b, v
        if b.function.name == "trial" and len(b.block.instructions) > 1024:  # 2 s of LLVM
            raise TypeError("it has more than 1024 operations, of all turns of its loops")

    @property
    def kind(self) -> ir.Type:
        """The type of a lane."""
        return self.v.type.element

    def __bool__(self):
        # as a < b < c asks for
        raise TypeError("each lane has a truth value of its own: use where(c, a, b)")

    def like(self, x: Any) -> ir.Value:
        """Return a value in every lane; raise TypeError if it is of another kind.

        Unlike numpy, this converts no kind into another.
        """
        if isinstance(x, Lanes):
            return x.are(self.kind)
        if self.kind == DOUBLE:
            return splat(self.b, ir.Constant(DOUBLE, float(x)), self.v.type.count)
        if self.kind != I64 or not isinstance(x, (int, np.uint64)) or x < 0:
            raise TypeError(f"{x!r} is of another kind")
        return splat(self.b, ir.Constant(I64, int(x)), self.v.type.count)

    def are(self, kind: ir.Type) -> ir.Value:
        """Return the vector; raise TypeError if it is of another kind."""
        if self.kind != kind:
            raise TypeError(f"lanes of {self.kind}, not {kind}")
        return self.v

    def of(self, kind: ir.Type) -> ir.VectorType:
        """Return the vector type for another kind of number, with as many lanes."""
        return ir.VectorType(kind, self.v.type.count)

    def __neg__(self):
        return Lanes(self.b, self.b.fneg(self.are(DOUBLE)))

    def __abs__(self):
        return Lanes(self.b, known(self.b, "fabs", self.are(DOUBLE)))


def _operator(of_floats: str, of_words: str, swapped: bool) -> Callable:
    def operate(self, other):
        left, right = self.v, self.like(other)
        name = of_floats if self.kind == DOUBLE else of_words
        if not name or (self.kind == TRUTH and name not in ("and_", "or_", "xor")):
            raise TypeError("a truth value is no number: write where(c, 1.0, 0.0)")
        amount = self if swapped else other
        left, right = (right, left) if swapped else (left, right)
        made = getattr(self.b, name)(left, right)
        # numpy shifts by 64 bits and more to 0, LLVM to anything
        if name in ("shl", "lshr") and (isinstance(amount, Lanes) or amount > 63):
            most = splat(self.b, I64(63), left.type.count)
            fits = self.b.icmp_unsigned("<=", right, most)
            made = self.b.select(fits, made, ir.Constant(left.type, None))
        return Lanes(self.b, made)

    return operate


def _comparison(sign: str) -> Callable:
    def f(self, other):
        of_floats = self.b.fcmp_unordered if sign == "!=" else self.b.fcmp_ordered
        compare = of_floats if self.kind == DOUBLE else self.b.icmp_unsigned
        return Lanes(self.b, compare(sign, self.v, self.like(other)))

    return f


for _name, _floats, _words in (
    ("add", "fadd", "add"), ("sub", "fsub", "sub"), ("mul", "fmul", "mul"),
    ("truediv", "fdiv", ""), ("and", "", "and_"), ("or", "", "or_"), ("xor", "", "xor"),
    ("lshift", "", "shl"), ("rshift", "", "lshr"),
):  # fmt: skip
    setattr(Lanes, f"__{_name}__", _operator(_floats, _words, swapped=False))
    setattr(Lanes, f"__r{_name}__", _operator(_floats, _words, swapped=True))
for _name, _sign in (
    ("lt", "<"),
    ("le", "<="),
    ("gt", ">"),
    ("ge", ">="),
    ("eq", "=="),
    ("ne", "!="),
):
    setattr(Lanes, f"__{_name}__", _comparison(_sign))


def _one_of(*given: Any) -> Lanes:
    for value in given:
        if isinstance(value, Lanes):
            return value
    raise TypeError("nothing but numbers")


def _where(c: Any, x: Any, y: Any) -> Lanes:
    truth = _one_of(c).are(TRUTH)
    words = all(isinstance(value, np.uint64) for value in (x, y))
    some = _one_of(
        x,
        y,
        Lanes(c.b, ir.Constant(c.of(I64 if words else DOUBLE), ir.Undefined)),
    )
    if some.kind == TRUTH:
        raise TypeError("a truth value is no number")
    return Lanes(c.b, c.b.select(truth, some.like(x), some.like(y)))


def _known(name: str) -> Callable:
    def call(*given):
        some = _one_of(*given)
        some.are(DOUBLE)
        return Lanes(some.b, known(some.b, name, *map(some.like, given)))

    return call


def _of(kind: ir.Type, code: Callable) -> Callable:
    """Return a function on lanes that emits code for one value of a given kind."""
    return lambda x: Lanes(_one_of(x).b, code(x.b, x.are(kind), x))


TWINS: dict[str, Callable] = {name: _known(name) for name in ("fma", "sqrt", "floor")} | {
    "where": _where,
    "flush": _of(DOUBLE, lambda b, v, x: flush(b, v)),
    "as_float": _of(I64, lambda b, v, x: b.uitofp(v, x.of(DOUBLE))),
    "bits": _of(DOUBLE, lambda b, v, x: b.bitcast(v, x.of(I64))),
    "unbits": _of(I64, lambda b, v, x: b.bitcast(v, x.of(DOUBLE))),
}
_scope = {"__builtins__": {"abs": abs}, **maths.CONSTANTS, **TWINS}
for _name, _f in maths.ELEMENTARY.items():
    TWINS[_name] = _scope[_name] = python.FunctionType(_f.__code__, _scope, _name)
"""What names of ``maths`` do to stand-ins."""


NAMESPACE = python.SimpleNamespace(**TWINS, SILENT=maths.SILENT, TINY=maths.TINY)


def twin(v: Any) -> Any:
    """Return the object that replaces a global of a helper, or None."""
    if (
        isinstance(v, (float, np.uint64))
        or v is abs
        or v is range
        or (isinstance(v, type) and hasattr(v, "_fields"))
    ):
        return v
    if v is maths:
        return NAMESPACE
    for name in TWINS:
        if v is getattr(maths, name):
            return TWINS[name]
    return (
        bind(v) if isinstance(v, python.FunctionType) and v.__module__ != maths.__name__ else None
    )


def bind(function: python.FunctionType) -> Callable | None:
    """Return a step or helper as a function on lanes.

    None if it uses something that has no replacement.
    """
    scope = {
        name: twin(function.__globals__[name])
        for name, _ in used(function.__code__)
        if name in function.__globals__
    }
    of_maths = (
        [name for name in function.__code__.co_names if hasattr(maths, name)]
        if NAMESPACE in scope.values()
        else []
    )
    lacking = not all(hasattr(NAMESPACE, name) for name in of_maths)
    if lacking or None in scope.values() or function.__closure__:
        return None
    return python.FunctionType(
        function.__code__,
        {"__builtins__": {"abs": abs, "range": range}, **scope},
        None,
        function.__defaults__,
    )


def number(b: ir.IRBuilder, v: Any, width: int = 8) -> ir.Value:
    """Return a helper's result, lanes or a single number, as a vector of a width."""
    if isinstance(v, Lanes) and v.v.type.element != DOUBLE:
        raise TypeError("it must return a number; write where(c, 1.0, 0.0)")
    return v.v if isinstance(v, Lanes) else splat(b, ir.Constant(DOUBLE, float(v)), width)


def fault(helper: Callable | None, p_type: Any, p_kinds: str, kinds: str) -> str:
    """Return why a helper(p, *x) cannot run in vectors, or "".

    f: a float, u: np.uint64. The answer comes from trying it.
    """
    # Tried on a module that is thrown away: the operations themselves know what lanes
    # can do, and a list of what they can would be a second one.
    if helper is None or p_kinds != p_kinds.lower():  # a capital: an array
        return "it uses something that they do not support"
    vectors = [ir.VectorType(I64 if letter == "u" else DOUBLE, 8) for letter in p_kinds + kinds]
    trial = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), vectors), "trial")
    b = ir.IRBuilder(trial.append_basic_block())
    stand_ins = [Lanes(b, x) for x in trial.args]
    try:
        result = helper(
            p_type(*stand_ins[: len(p_kinds)]) if p_kinds else (), *stand_ins[len(p_kinds) :]
        )
        for part in result if isinstance(result, tuple) else (result,):
            for one in part if isinstance(part, tuple) else (part,):
                number(b, one)
    except Exception as e:  # of an author's code
        return str(e)
    return ""


def in_vectors(step: Any, p_type: Any, p_kinds: str, inputs: int) -> bool:
    """Return whether a step without state can run in vectors."""
    run = twin(step)
    return not fault(run and (lambda p, *x: run(p, (), *x)[0]), p_type, p_kinds, "f" * inputs)


def go_abreast(
    step: Any, p_type: Any, p_kinds: str, s_type: Any, s_kinds: str, inputs: int
) -> bool:
    """Return whether two blocks can run side by side, one in each lane.

    Their state must consist of floats.
    """
    run, count = twin(step), len(s_kinds)
    call = run and (lambda p, *given: run(p, s_type(*given[:count]), *given[count:]))
    return set(s_kinds) == {"f"} and not fault(call, p_type, p_kinds, "f" * (count + inputs))
