"""Python operators and numpy functions on blocks: they make blocks or raise errors.

Nothing here computes a number: a block stands for all samples of a signal, and none is
known while the graph is built.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import BadValue, SceneError

NUMBERS: Any = (int, float, np.integer, np.floating)
LARGEST_POWER = 64


def _refused(what: str, remedy: str) -> Any:
    def method(self: Any, *others: Any) -> Any:
        raise SceneError(
            f"{what} of {self!r}: a block is a signal, not a number, while the graph is built;"
            f" {remedy}"
        )

    return method


_ROUND = "no block rounds; a staircase is lut(x, knots, values, ..)"
_MODULO = (
    "a shape that repeats along a signal is bump(u, ..) or carrier(freq), a staircase is lut(x, ..)"
)
_SHIFT = "a shift in time is delay(x, samples=n)"
_LOGIC = (
    "of conditions, which are 1 or 0, `and` is minimum(a, b), `or` is maximum(a, b), `not` is 1 - a"
)
_NUMBER = (
    "render(..) gives its samples; functions of the module math take numbers: use abs, and sqrt,"
    " exp, log, sin, cos, tanh of stimlib.blocks"
)
_SIGN = (
    "a sign is where(x > 0, 1.0, -1.0), or (x > 0) - (x < 0), which is 0 at 0; x with a soft sign"
    " is tanh(x / width)"
)
_PARTS = "it has no length and no parts; the sample before this one is delay(x, samples=1)"


class Refusals:
    """Base class for operations that no block supports, with helpful errors."""

    def __rpow__(self, base: Any) -> Any:
        raise BadValue(
            f"{base!r} ** {self!r}: the exponent must be a number; a ** x, a above 0, is exp(x *"
            " log(a))"
        )

    def __bool__(self):
        raise SceneError(
            f"{self!r} has no truth value while the graph is built: use where(c, a, b) instead of"
            f" if, and/or, max and min; {_LOGIC}"
        )

    __mod__ = __rmod__ = _refused("%", _MODULO)
    __floordiv__ = __rfloordiv__ = _refused("//", _MODULO)
    __divmod__ = __rdivmod__ = _refused("divmod", _MODULO)
    __matmul__ = __rmatmul__ = _refused("@", "a filter is fir(x, taps)")
    __lshift__ = __rlshift__ = _refused("<<", _SHIFT)
    __rshift__ = __rrshift__ = _refused(">>", _SHIFT)
    __and__ = __rand__ = _refused("&", _LOGIC)
    __or__ = __ror__ = _refused("|", _LOGIC)
    __xor__ = __rxor__ = _refused("^", f"{_LOGIC}; a power is x ** n")
    __invert__ = _refused("~", _LOGIC)
    __float__ = _refused("float", _NUMBER)
    __int__ = __index__ = _refused("int", _NUMBER)
    __complex__ = _refused("complex", _NUMBER)
    __round__ = _refused("round", _ROUND)
    __floor__ = _refused("floor", _ROUND)
    __ceil__ = _refused("ceil", _ROUND)
    __trunc__ = _refused("trunc", _ROUND)
    __len__ = _refused("len", _PARTS)
    __getitem__ = _refused("indexing, `in` or iteration", _PARTS)

    def __array__(self, *args: Any, **options: Any) -> Any:
        return no_numpy("array")


def power(x: Any, n: Any) -> Any:
    """Return x**n, for n = 0.5 or any whole number other than 0.

    Whole powers are squares and products in a fixed order: x**3 = (x x) x.
    """
    if not isinstance(n, NUMBERS):
        raise BadValue(
            f"({x!r}) ** {n!r:.80}: the exponent must be a number; a ** b of signals, a above 0, is"
            " exp(b * log(a))"
        )
    if n == 0.5:
        return FUNCTIONS["sqrt"](x)
    if n != n // 1 or abs(n) > LARGEST_POWER:
        raise BadValue(
            f"({x!r}) ** {n!s:.40}: the exponent must be 0.5 or a whole number from"
            f" {-LARGEST_POWER} to {LARGEST_POWER}; other powers of a signal above 0 without unit"
            " are exp(n * log(x))"
        )
    whole: int = int(n)
    return 1.0 / _power(x, -whole) if whole < 0 else _power(x, whole)


def _power(x: Any, n: int) -> Any:
    if n == 1:
        return x
    half = _power(x, n // 2)
    return half * half * x if n % 2 else half * half


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "square": lambda x: x * x,
    "reciprocal": lambda x: 1.0 / x,
    "power": operator.pow,
}
"""Functions of numpy that have a meaning on blocks, by numpy's name; ``core.pointwise``
adds its own.
"""
FUNCTIONS |= {
    "absolute": abs,
    "negative": operator.neg,
    "positive": operator.pos,
    "fabs": abs,
    "greater": operator.gt,
    "greater_equal": operator.ge,
    "less": operator.lt,
    "less_equal": operator.le,
    "equal": operator.eq,
    "not_equal": operator.ne,
}


_THERE = (
    "there are + - * / ** abs, comparisons, and sqrt, exp, log, sin, cos, tanh, maximum, minimum,"
    " clip, where of stimlib.blocks"
)
_REMEDIES = {  # of functions of numpy, what to write
    "floor ceil rint trunc": _ROUND,
    "remainder fmod floor_divide divmod modf": _MODULO,
    "sign copysign signbit": _SIGN,
    "logical_and logical_or logical_not bitwise_and bitwise_or invert": _LOGIC,
    "isnan isfinite isinf": (
        "what is not finite ends an output by itself; x != x is 1 where x is nan"
    ),
    "log2 log10": "log to a base b is log(x) / math.log(b)",
    "exp2 float_power cbrt": "a ** x, a above 0, is exp(x * math.log(a))",
    "expm1": "write exp(x) - 1",
    "log1p": "write log(1 + x)",
    "tan": "write sin(x) / cos(x)",
    "hypot": "write sqrt(a**2 + b**2)",
    "sinh": "write (exp(x) - exp(-x)) / 2",
    "cosh": "write (exp(x) + exp(-x)) / 2",
    "heaviside": "write x > 0",
}


def no_numpy(name: str) -> Any:
    """Raise the error for a numpy function applied to a block."""
    why = next((why for names, why in _REMEDIES.items() if name in names.split()), _THERE)
    raise BadValue(
        f"numpy ({name}) cannot take a block: it is a signal, not a number, while the graph is"
        f" built; {why}"
    )
