"""What Python's operators and numpy's functions mean on blocks: more blocks, or an error that names the remedy.

Nothing here computes a number: a block stands for all samples of a signal, and none is known while the graph is built.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from .errors import BadValue, SceneError

LARGEST_POWER = 64


def _refused(what: str, remedy: str) -> Any:
    def method(self: Any, *others: Any) -> Any:
        raise SceneError(f"{what} of {self!r}: a block is a signal, not a number, while the graph is built; {remedy}")

    return method


_ROUND = "no block rounds; a staircase is lut(x, knots, values, ..)"
_MODULO = "a shape that repeats along a signal is bump(u, ..) or carrier(freq), a staircase is lut(x, ..)"
_SHIFT = "a shift in time is delay(x, samples=n)"
_LOGIC = "of conditions, which are 1 or 0, `and` is minimum(a, b), `or` is maximum(a, b), `not` is 1 - a"
_NUMBER = (
    "render(..) gives its samples; functions of the module math take numbers: use abs, and sqrt, exp, log, sin, cos, tanh of "
    "stimlib.blocks"
)
_PARTS = "it has no length and no parts; the sample before this one is delay(x, samples=1)"


class Operators:
    """The operators of a block."""

    # fmt: off
    def __add__(self, o): return graph.Add(self, o)
    def __radd__(self, o): return graph.Add(o, self)
    def __sub__(self, o): return graph.Sub(self, o)
    def __rsub__(self, o): return graph.Sub(o, self)
    def __mul__(self, o): return graph.Mul(self, o)
    def __rmul__(self, o): return graph.Mul(o, self)
    def __truediv__(self, o): return graph.Div(self, o)
    def __rtruediv__(self, o): return graph.Div(o, self)
    def __neg__(self): return graph.Neg(self)
    def __pos__(self): return self
    def __abs__(self): return graph.Abs(self)
    def __gt__(self, o): return graph.Greater(self, o)
    def __lt__(self, o): return graph.Greater(o, self)
    def __ge__(self, o): return graph.AtLeast(self, o)
    def __le__(self, o): return graph.AtLeast(o, self)
    def __eq__(self, o: Any) -> Any: return graph.Equal(self, o)
    def __ne__(self, o: Any) -> Any: return graph.NotEqual(self, o)
    # fmt: on

    __hash__ = object.__hash__  # keys of tables are the blocks themselves, whatever == means

    def __pow__(self, n: Any) -> Any:
        if not isinstance(n, graph.NUMBERS):
            raise BadValue(
                f"({self!r}) ** {n!r:.80}: the exponent must be a number; a ** b of signals, a above 0, is exp(b * log(a))"
            )
        if n == 0.5:
            return _functions()["sqrt"](self)
        if n != n // 1 or abs(n) > LARGEST_POWER:
            raise BadValue(
                f"({self!r}) ** {n!s:.40}: the exponent must be 0.5 or a whole number from {-LARGEST_POWER} to {LARGEST_POWER}; "
                "other powers of a signal above 0 without unit are exp(n * log(x))"
            )
        if n < 0:
            return 1.0 / _power(self, -int(n))
        return _power(self, int(n)) if n else graph.Const(1.0)

    def __rpow__(self, base: Any) -> Any:
        raise BadValue(f"{base!r} ** {self!r}: the exponent must be a number; a ** x, a above 0, is exp(x * log(a))")

    def __bool__(self):
        raise SceneError(
            f"{self!r} has no truth value while the graph is built: use where(c, a, b) instead of if, and/or, max and min; "
            f"{_LOGIC}"
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

    # numpy asks here before it computes anything
    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        f = _functions().get(ufunc.__name__)
        if method != "__call__" or options or f is None:
            return _no_numpy(ufunc.__name__)
        return f(*(graph.as_block(v) for v in inputs))

    def __array__(self, *args: Any, **options: Any) -> Any:
        return _no_numpy("array")


def _power(x: Any, n: int) -> Any:
    """x**n by squares and products, in one order: x**6 = (x x x)(x x x), x**3 = (x x) x."""
    if n == 1:
        return x
    half = _power(x, n // 2)
    return half * half * x if n % 2 else half * half


def _functions() -> dict[str, Callable[..., Any]]:
    """Functions of numpy that have a meaning on blocks, by numpy's name."""
    from .blocks import maps

    same = ("sqrt", "exp", "log", "sin", "cos", "tanh", "maximum", "minimum", "clip")
    return {name: getattr(maps, name) for name in same} | {
        "add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "divide": operator.truediv,
        "negative": operator.neg, "positive": operator.pos, "absolute": abs, "fabs": abs, "square": lambda x: x * x,
        "greater": operator.gt, "greater_equal": operator.ge, "less": operator.lt, "less_equal": operator.le,
        "equal": operator.eq, "not_equal": operator.ne, "power": lambda x, n: x ** (n.value if isinstance(n, graph.Const) else n),
    }  # fmt: skip


def _no_numpy(name: str) -> Any:
    raise BadValue(
        f"numpy ({name}) cannot take a block: it is a signal, not a number, while the graph is built; there are + - * / ** abs, "
        "comparisons, and sqrt, exp, log, sin, cos, tanh, maximum, minimum, clip, where of stimlib.blocks"
    )


from . import graph as _blocks  # noqa: E402  # it builds on this file

graph: Any = _blocks
