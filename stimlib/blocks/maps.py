"""Functions of the present sample."""

from __future__ import annotations

from dataclasses import dataclass

from ..core import maths
from ..core import units as un
from ..core.graph import Block, Map, as_block, same_unit
from ..errors import UnitError


@dataclass(frozen=True, eq=False)
class Where(Map):
    """a where c > 0, else b."""

    c: Block
    a: Block
    b: Block

    def units(self, *u):
        return same_unit("choose between", self.a, self.b, u[1], u[2])

    @staticmethod
    def step(p, s, c, a, b):
        return maths.where(c > 0.0, a, b), s


@dataclass(frozen=True, eq=False)
class Maximum(Map):
    """The larger of two; nan if a is."""

    a: Block
    b: Block

    def units(self, *u):
        return same_unit("compare", self.a, self.b, *u)

    @staticmethod
    def step(p, s, a, b):
        return maths.where(a < b, b, a), s


@dataclass(frozen=True, eq=False)
class Minimum(Map):
    """The smaller of two; nan if a is."""

    a: Block
    b: Block

    def units(self, *u):
        return same_unit("compare", self.a, self.b, *u)

    @staticmethod
    def step(p, s, a, b):
        return maths.where(a > b, b, a), s


@dataclass(frozen=True, eq=False)
class Sqrt(Map):
    """The square root; nan below zero."""

    x: Block

    def units(self, *u):
        return u[0] ** 0.5

    @staticmethod
    def step(p, s, x):
        return maths.sqrt(x), s


class _Transcendental(Map, abstract=True):
    def units(self, *u):
        if u[0] != un.ONE:
            raise UnitError(f"{type(self).__name__.lower()} of {self.children[0]!r} [{u[0]}]: the argument must have no unit")
        return un.ONE


@dataclass(frozen=True, eq=False)
class Exp(_Transcendental):
    """exp(x)."""

    x: Block

    @staticmethod
    def step(p, s, x):
        return maths.exp(x), s


@dataclass(frozen=True, eq=False)
class Log(_Transcendental):
    """Natural logarithm; -inf at 0, nan below."""

    x: Block

    @staticmethod
    def step(p, s, x):
        return maths.log(x), s


@dataclass(frozen=True, eq=False)
class Sin(_Transcendental):
    """sin(x), x in rad."""

    x: Block

    @staticmethod
    def step(p, s, x):
        return maths.sin(x), s


@dataclass(frozen=True, eq=False)
class Cos(_Transcendental):
    """cos(x), x in rad."""

    x: Block

    @staticmethod
    def step(p, s, x):
        return maths.cos(x), s


@dataclass(frozen=True, eq=False)
class Tanh(_Transcendental):
    """tanh(x), a soft clip."""

    x: Block

    @staticmethod
    def step(p, s, x):
        return maths.tanh(x), s


@dataclass(frozen=True, eq=False)
class Nonzero(Map):
    """1 where x is not 0, else 0 (nan counts as not 0)."""

    x: Block

    def units(self, *u):
        return un.ONE

    @staticmethod
    def step(p, s, x):
        return maths.where(x == 0.0, 0.0, 1.0), s


def where(c, a, b) -> Block:
    """a where the condition c > 0, else b; both are computed.

    Parameters
    ----------
    c, a, b : Block or float
        a and b of one unit.

    Returns
    -------
    Block

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


def maximum(a, b) -> Block:
    """The larger of two signals of one unit.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import maximum
    >>> maximum(Input("x"), 0.0)
    Maximum(Input('x'), Const(0.0))
    """
    return Maximum(as_block(a), as_block(b))


def minimum(a, b) -> Block:
    """The smaller of two signals of one unit.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import minimum
    >>> minimum(Input("x"), 1.0)
    Minimum(Input('x'), Const(1.0))
    """
    return Minimum(as_block(a), as_block(b))


def clip(x, low, high) -> Block:
    """x held between two limits of its unit.

    Parameters
    ----------
    x, low, high : Block or float

    Returns
    -------
    Block

    Raises
    ------
    UnitError
        Different units.

    Examples
    --------
    >>> from stimlib import Input, constant
    >>> from stimlib.blocks import clip
    >>> str(clip(Input("F", "N"), 0.0, constant(100.0, "N")).dim)
    'N'
    """
    return Minimum(Maximum(as_block(x), as_block(low)), as_block(high))


def sqrt(x) -> Block:
    """Square root.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import sqrt
    >>> str(sqrt(Input("a", "m**2")).dim)
    'm'
    """
    return Sqrt(as_block(x))


def exp(x) -> Block:
    """exp(x) of a signal without unit.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import exp
    >>> exp(Input("x"))
    Exp(Input('x'))
    """
    return Exp(as_block(x))


def log(x) -> Block:
    """Natural logarithm of a signal without unit.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import log
    >>> log(Input("x"))
    Log(Input('x'))
    """
    return Log(as_block(x))


def sin(x) -> Block:
    """sin(x), x in rad.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import sin
    >>> sin(Input("phase"))
    Sin(Input('phase'))
    """
    return Sin(as_block(x))


def cos(x) -> Block:
    """cos(x), x in rad.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import cos
    >>> cos(Input("phase"))
    Cos(Input('phase'))
    """
    return Cos(as_block(x))


def tanh(x) -> Block:
    """tanh(x) of a signal without unit: a soft clip.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import tanh
    >>> tanh(Input("x"))
    Tanh(Input('x'))
    """
    return Tanh(as_block(x))


def nonzero(x) -> Block:
    """1 where x is not 0, else 0: ``A * enabled(noise, by=nonzero(A))`` does no work while A is 0.

    Examples
    --------
    >>> from stimlib import Param
    >>> from stimlib.blocks import nonzero
    >>> nonzero(Param("A", 3.4))
    Nonzero(Param('A'))
    """
    return Nonzero(as_block(x))
