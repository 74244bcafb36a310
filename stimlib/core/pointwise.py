"""Functions of the present sample: where, clip, maximum, minimum, sqrt, exp, sin .."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from inspect import Parameter, Signature

from ..errors import BadValue, UnitError, public
from . import maths, units as un
from .graph import Block, Const, Map, Pair, as_block, same_unit, unitless
from .operators import FUNCTIONS


@dataclass(frozen=True, eq=False)
class Where(Map):
    """A choice between two signals: a where c > 0, else b."""

    c: Block
    a: Block
    b: Block

    def units(self, *u):
        return same_unit("choose between", self.a, self.b, u[1], u[2])

    @staticmethod
    def step(p, s, c, a, b):
        return maths.where(c > 0.0, a, b), s


class _OneOf(Pair, abstract=True):
    def units(self, *u):
        return same_unit("compare", self.a, self.b, *u)


@dataclass(frozen=True, eq=False)
class Maximum(_OneOf):
    """The larger of two signals of one unit; nan if the first is."""

    @staticmethod
    def step(p, s, a, b):
        return maths.where(a < b, b, a), s


@dataclass(frozen=True, eq=False)
class Minimum(_OneOf):
    """The smaller of two signals of one unit; nan if the first is."""

    @staticmethod
    def step(p, s, a, b):
        return maths.where(a > b, b, a), s


@dataclass(frozen=True, eq=False)
class Sqrt(Map):
    """Square root; nan below zero."""

    x: Block

    def units(self, *u):
        return u[0] ** 0.5

    @staticmethod
    def step(p, s, x):
        return maths.sqrt(x), s


@dataclass(frozen=True, eq=False)
class _Transcendental(Map, abstract=True):
    x: Block

    def units(self, *u):
        if u[0] != un.ONE:
            raise UnitError(
                f"{type(self).__name__.lower()} of {self.children[0]!r} [{u[0]}]: the argument must"
                " have no unit"
            )
        return un.ONE


@dataclass(frozen=True, eq=False)
class Exp(_Transcendental):
    """Exponential function exp(x) of a signal without unit."""

    @staticmethod
    def step(p, s, x):
        return maths.exp(x), s


@dataclass(frozen=True, eq=False)
class Log(_Transcendental):
    """Natural logarithm of a signal without unit; -inf at 0, nan below."""

    @staticmethod
    def step(p, s, x):
        return maths.log(x), s


@dataclass(frozen=True, eq=False)
class Sin(_Transcendental):
    """Sine sin(x) of a signal in rad."""

    @staticmethod
    def step(p, s, x):
        return maths.sin(x), s


@dataclass(frozen=True, eq=False)
class Cos(_Transcendental):
    """Cosine cos(x) of a signal in rad."""

    @staticmethod
    def step(p, s, x):
        return maths.cos(x), s


@dataclass(frozen=True, eq=False)
class Tanh(_Transcendental):
    """Hyperbolic tangent tanh(x) of a signal without unit: a soft clip."""

    @staticmethod
    def step(p, s, x):
        return maths.tanh(x), s


@dataclass(frozen=True, eq=False)
class Nonzero(Map):
    """A signal that is 1 where x is not 0 (or is nan), else 0.

    ``A * enabled(noise, by=nonzero(A))`` does no work while A is 0.
    """

    x: Block
    rests = True

    units = unitless

    @staticmethod
    def step(p, s, x):
        return maths.where(x == 0.0, 0.0, 1.0), s


@public
def where(c: Block | float, a: Block | float, b: Block | float) -> Block:
    """Choose between two signals: a where the condition c is above 0, else b.

    Both are computed, unless the condition is a constant number.

    Parameters
    ----------
    c, a, b : Block or float
        a and b of one unit.

    Raises
    ------
    UnitError
        Different units of a and b.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import where
    >>> x = Input("x")
    >>> where(x > 1.0, x, 0.0)
    Where(Greater(..), Input('x'), Const(0.0))
    """
    return Where(as_block(c), as_block(a), as_block(b))


@public
def clip(x: Block | float, low: Block | float, high: Block | float) -> Block:
    """Limit x to an interval whose ends have the unit of x.

    Parameters
    ----------
    x, low, high : Block or float
        Where live limits pass each other, the upper one holds.

    Raises
    ------
    UnitError
        Different units.
    BadValue
        Numbers of which low is above high.

    Examples
    --------
    >>> from stimlib import Input, constant
    >>> from stimlib.blocks import clip
    >>> str(clip(Input("F", "N"), 0.0, constant(100.0, "N")).dim)
    'N'
    """
    held = Minimum(Maximum(as_block(x), as_block(low)), as_block(high))
    least, most = as_block(low), as_block(high)
    if isinstance(least, Const) and isinstance(most, Const) and least.value > most.value:
        raise BadValue(
            f"clip: low = {least.value:g} must not be above high = {most.value:g}; give the lower"
            " limit first"
        )
    return held


def _function(cls: type[Map]) -> Callable[..., Block]:
    """Return the function that makes a block of a class, with its docstring."""
    name, signals = (
        cls.__name__.lower(),
        ("Input('x')", "Const(0.5)")[: len(fields(cls))],  # type: ignore[arg-type]
    )

    def make(*signals: Block | float, **named: Block | float) -> Block:
        return cls(*signals, **named)

    make.__name__ = make.__qualname__ = name
    arguments = [
        Parameter(f.name, Parameter.POSITIONAL_OR_KEYWORD, annotation=Block | float)
        for f in fields(cls)  # type: ignore[arg-type]
    ]
    make.__signature__ = Signature(arguments)  # type: ignore[attr-defined]
    make.__doc__ = f"""{cls.__doc__}

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import {name}
    >>> {name}({", ".join(signals).replace("Const(0.5)", "0.5")})
    {cls.__name__}({", ".join(signals)})
    """
    return public(make)


maximum, minimum = _function(Maximum), _function(Minimum)
sqrt, exp, log, sin, cos, tanh, nonzero = map(_function, (Sqrt, Exp, Log, Sin, Cos, Tanh, Nonzero))
FUNCTIONS.update({f.__name__: f for f in (sqrt, exp, log, sin, cos, tanh, maximum, minimum, clip)})
