"""Functions given by points."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ..core.graph import Block, as_block
from ..core.maths import fma, search, where
from ..core.units import unit
from ..errors import BadValue, public

KINDS = ("linear", "pchip", "cubic", "polynomial")
MOST = 8  # knots of a polynomial
OUTSIDE = ("hold", "zero", "error")
STEEP = "lut: the knots are too unequal, or too close for their values; check both units"
POLICY = {"hold": (0.0, 1.0), "zero": (0.0, 0.0), "error": (math.nan, 0.0)}


class TableParams(NamedTuple):
    knots: np.ndarray
    c: np.ndarray  # 4 coefficients of each piece, highest power of (x - knot) first
    outside: float  # value added outside: 0, or nan
    keep: float  # 0: nothing is left of the value outside


class Table(Block, abstract=True):
    """A piecewise cubic: c0 d^3 + c1 d^2 + c2 d + c3 with d = x - knot of the piece."""

    @staticmethod
    def step(p, s, x):
        low, high = p.knots[0], p.knots[p.knots.size - 1]
        held = where(x < low, low, where(x > high, high, x))
        i = search(p.knots, held)
        d = held - p.knots[i]
        y = fma(fma(fma(p.c[4 * i], d, p.c[4 * i + 1]), d, p.c[4 * i + 2]), d, p.c[4 * i + 3])
        return where(held == x, y, where(p.keep > 0.0, y, where(x == x, p.outside, x))), s


@dataclass(frozen=True, eq=False)
class Lut(Table):
    """A table of values over knots."""

    x: Block
    knots: np.ndarray
    values: np.ndarray
    kind: str
    outside: str
    value_unit: str

    def check(self):
        check_points(self)

    def units(self, *u):
        return unit(self.value_unit)

    def design(self, fs):
        c = np.zeros((4, len(self.knots) - 1))
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("error")  # of a system that scipy cannot solve to its digits
            try:
                if self.kind == "linear":
                    c[2], c[3] = np.diff(self.values) / np.diff(self.knots), self.values[:-1]
                else:
                    from scipy import interpolate

                    make = {
                        "pchip": interpolate.PchipInterpolator,
                        "cubic": interpolate.CubicSpline,
                    }[self.kind]
                    c[:] = make(self.knots, self.values).c
            except (ValueError, RuntimeWarning):  # slopes that are not finite
                c[:] = np.inf
        if not np.isfinite(c).all():
            raise BadValue(STEEP)
        return TableParams(np.array(self.knots), c.T.ravel().copy(), *POLICY[self.outside]), ()


class PolynomialParams(NamedTuple):
    # the ends first, then each as far as possible from those before: that rounds least
    knots: np.ndarray
    c: np.ndarray  # divided differences
    outside: float
    keep: float


@dataclass(frozen=True, eq=False)
class Polynomial(Block):
    """One polynomial through all knots in Newton's form, c0 + (x - knot0) (c1 + (x -
    knot1) (c2 + ..)).
    """

    x: Block
    knots: np.ndarray
    values: np.ndarray
    outside: str
    value_unit: str

    def check(self):
        check_points(self)

    def units(self, *u):
        return unit(self.value_unit)

    def design(self, fs):
        left = dict(zip(map(Fraction, self.knots), map(Fraction, self.values), strict=True))
        knots, c = [min(left)], [left.pop(min(left))]
        while left:
            knots.append(max(left, key=lambda x: math.prod(abs(x - k) for k in knots)))
            c.append(left.pop(knots[-1]))
        for j in range(1, len(c)):
            for i in range(len(c) - 1, j - 1, -1):
                c[i] = (c[i] - c[i - 1]) / (knots[i] - knots[i - j])
        try:
            places, values = (np.array([float(v) for v in row]) for row in (knots, c))
        except OverflowError:
            raise BadValue(STEEP) from None
        return PolynomialParams(places, values, *POLICY[self.outside]), ()

    @staticmethod
    def step(p, s, x):
        low, high = p.knots[0], p.knots[1]
        held = where(x < low, low, where(x > high, high, x))
        y = p.c[p.c.size - 1]
        for i in range(1, p.c.size):
            y = fma(held - p.knots[p.c.size - 1 - i], y, p.c[p.c.size - 1 - i])
        return where(held == x, y, where(p.keep > 0.0, y, where(x == x, p.outside, x))), s

    @staticmethod
    def work(p):
        return 64

    @staticmethod
    def tile(p, s, x, y, w):
        low, high = p.knots[0], p.knots[1]
        for i in range(y.size):
            w[i] = where(x[i] < low, low, where(x[i] > high, high, x[i]))
            y[i] = p.c[p.c.size - 1]
        for j in range(1, p.c.size):
            knot, c = p.knots[p.c.size - 1 - j], p.c[p.c.size - 1 - j]
            for i in range(y.size):
                y[i] = fma(w[i] - knot, y[i], c)
        for i in range(y.size):
            y[i] = where(
                w[i] == x[i], y[i], where(p.keep > 0.0, y[i], where(x[i] == x[i], p.outside, x[i]))
            )
        return s


def check_points(b: Lut | Polynomial) -> None:
    """Raise BadValue where knots, values or policies make no sense."""
    knots, values = b.knots, b.values
    if np.ndim(knots) != 1 or np.shape(knots) != np.shape(values) or len(knots) < 2:
        raise BadValue(
            f"lut: knots and values must be rows of one length, at least 2; got {np.shape(knots)},"
            f" {np.shape(values)}"
        )
    if not (np.diff(knots) > 0).all():
        raise BadValue(
            f"lut: knots must rise; knot {int(np.argmin(np.diff(knots) > 0)) + 1} does not"
        )
    for v, known, name in (
        (getattr(b, "kind", KINDS[0]), KINDS, "kind"),
        (b.outside, OUTSIDE, "outside"),
    ):
        if v not in known:
            raise BadValue(f"lut: {name} = {v!r}; choose one of {', '.join(known)}")
    if isinstance(b, Polynomial) and len(knots) > MOST:
        raise BadValue(
            f"lut: a polynomial through {len(knots)} knots swings between them; at most {MOST}, or"
            " use kind='cubic'"
        )


@public
def lut(
    x: Block | float, knots, values, kind: str = "linear", outside: str = "hold", unit: str = ""
) -> Block:
    """A function of x given by points.

    Parameters
    ----------
    x : Block
    knots : array_like, shape (m,)
        Rising, in the unit of x.
    values : array_like, shape (m,), or callable
        In ``unit``; a callable is sampled at the knots now.
    kind : {"linear", "pchip", "cubic", "polynomial"}
        Straight lines; a monotone cubic; a cubic spline; one polynomial through all
        knots, of which there are at most 8.
    outside : {"hold", "zero", "error"}
        What happens beyond the first and last knot; "error" gives nan, which the
        output's guard stops as a fault.
    unit : str
        Unit of the values.

    Raises
    ------
    BadValue
        Knots that do not rise, lengths that differ, numbers that are not finite, an
        unknown kind or policy, a polynomial through more than 8 knots.

    References
    ----------
    The UGrip paper, section 2.1: the geometry factor Gamma(x) of the voice coils is
    such a table.  The touch-screen thesis, section 4.2: "a simple look-up table and a
    polynomial interpolation function".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import lut
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": lut(stimlib.Input("x"), [0, 1, 2], [0, 10, 0])}),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[0.5, 1.0, 1.75, 9.0]]))
    array([[ 5. , 10. ,  2.5,  0. ]])
    """
    if callable(values):
        values = [float(values(k)) for k in knots]
    if kind == "polynomial":
        return Polynomial(as_block(x), knots, values, outside, unit)
    return Lut(as_block(x), knots, values, kind, outside, unit)
