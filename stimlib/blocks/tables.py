"""Functions given by points, along a line and over a plane."""

from __future__ import annotations

import math
import warnings
from collections import namedtuple
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from ..core.graph import Block, Const, as_block, scratch
from ..core.maths import floor, fma, search, where
from ..core.pointwise import maximum, sqrt
from ..core.units import unit
from ..errors import BadValue, UnitError, one_of, public
from ..system.limits import limits

# One variable -----------------------------------------------------------------------
# Functions given by points.
KINDS = ("linear", "pchip", "cubic", "polynomial")
MOST = 8  # knots of a polynomial
OUTSIDE = ("hold", "zero", "error")
STEEP = "lut: the knots are too unequal, or too close for their values; check both units"
POLICY = {"hold": (0.0, 1.0), "zero": (0.0, 0.0), "error": (math.nan, 0.0)}


# Parameters of `Table` at a sample rate.
#   c        4 coefficients of each piece, highest power of (x - knot) first
#   outside  value added outside: 0, or nan
#   keep     0: nothing is left of the value outside
#   per      see ``maths.search``
TableParams = namedtuple("TableParams", "knots c outside keep per")


class Table(Block, abstract=True):
    """A piecewise cubic, c0 d^3 + c1 d^2 + c2 d + c3, d the distance from the knot."""

    @staticmethod
    def step(p, s, x):
        low, high = p.knots[0], p.knots[p.knots.size - 1]
        held = where(x < low, low, where(x > high, high, x))
        i = search(p.knots, held, p.per)
        d = held - p.knots[i]
        y = fma(fma(fma(p.c[4 * i], d, p.c[4 * i + 1]), d, p.c[4 * i + 2]), d, p.c[4 * i + 3])
        return where(held == x, y, where(p.keep > 0.0, y, where(x == x, p.outside, x))), s


EVEN = 8  # pieces from which a product finds one faster than the search by halves


def evenness(knots: np.ndarray) -> float:
    """Return the pieces in a unit of x, for `search`; 0 where knots are few or uneven.

    Rounding is monotone: if (knot[i] - knot[0]) per, rounded as in the search, is
    within 0.5 of i for each i, then that of an x in piece i is between i - 0.5 and
    i + 1.5, and 0.5 below it names the piece or the one before.
    """
    n = len(knots) - 1
    with np.errstate(all="ignore"):
        per = n / (knots[-1] - knots[0])
        for kind in (np.float64, np.float32):  # of the C export
            k = knots.astype(kind)
            if n < EVEN or not (np.abs((k - k[0]) * kind(per) - np.arange(n + 1)) < 0.5).all():
                return 0.0
    return float(per)


def check_points(b: Any) -> None:
    """Raise BadValue where knots, values or options make no sense."""
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
        one_of(f"lut: {name}", v, known)
    if isinstance(b, Polynomial) and len(knots) > MOST:
        raise BadValue(
            f"lut: a polynomial through {len(knots)} knots swings between them; at most {MOST}, or"
            " use kind='cubic'"
        )


@dataclass(frozen=True, eq=False)
class Lut(Table):
    """A lookup table: values at knots, with interpolation between them."""

    x: Block
    knots: np.ndarray
    values: np.ndarray
    kind: str
    outside: str
    value_unit: str

    check = check_points

    def units(self, *u):
        return unit(self.value_unit)

    def design(self, fs):
        c = np.zeros((4, len(self.knots) - 1))
        with np.errstate(all="ignore"), warnings.catch_warnings():
            # of a system that scipy cannot solve to its digits
            warnings.simplefilter("error", RuntimeWarning)
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
        knots, policy = np.array(self.knots), POLICY[self.outside]
        return TableParams(knots, c.T.ravel().copy(), *policy, evenness(knots)), ()


# Parameters of `Polynomial` at a sample rate.
#   knots  the ends first, then each as far as possible from those before: that rounds
#          least
#   c      divided differences
PolynomialParams = namedtuple("PolynomialParams", "knots c outside keep")


@dataclass(frozen=True, eq=False)
class Polynomial(Block):
    """One polynomial through all knots, in Newton's form.

    c0 + (x - knot0) (c1 + (x - knot1) (c2 + ..)).
    """

    x: Block
    knots: np.ndarray
    values: np.ndarray
    outside: str
    value_unit: str

    check = check_points

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

    work = scratch(64)

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


@public
def lut(
    x: Block | float, knots, values, kind: str = "linear", outside: str = "hold", unit: str = ""
) -> Block:
    """Compute a function of x that is given by points.

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


@public
def panning(place: Block | float, places) -> tuple[Block, ...]:
    """Return the gains of a row of actuators for a point that is felt between them.

    Between two neighbours at the distance d, the point is at the part b = (place -
    left)/d.  Their gains are sqrt(1 - b) and sqrt(b), and those of the others 0, so
    that the sum of the squares is 1 at every place.

    Parameters
    ----------
    place : float or Block
        Of the point, in the unit of ``places``; before the first and beyond the last
        actuator it is at that one.
    places : array_like, shape (n,)
        Of the actuators, rising.

    Returns
    -------
    tuple of n Blocks
        Gains from 0 to 1.

    Raises
    ------
    BadValue
        Fewer than two places, or places that do not rise.

    References
    ----------
    A. Israr and I. Poupyrev, "Tactile Brush: Drawing on Skin with a Tactile Grid
    Display", CHI 2011, 2019-2028, doi 10.1145/1978942.1979235: the energy summation
    model of phantom sensations.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.blocks import panning
    >>> gains = panning(0.0225, [0.0, 0.03, 0.06])
    >>> scene = stimlib.Scene({f"tactor{k}": gain for k, gain in enumerate(gains)})
    >>> stimlib.render(scene, fs=1000, seconds=0.001).y[:, 0].round(3)
    array([0.5  , 0.866, 0.   ])
    """
    energies = [lut(place, places, row) for row in np.eye(np.size(places))]
    return tuple(sqrt(maximum(energy, 0.0)) for energy in energies)  # above 0 but for rounding


# Two variables ----------------------------------------------------------------------
# Functions of two places given by a regular grid of points.
U = np.uint64


# Parameters of `Grid` at a sample rate.
#   c      coefficients, row by row
#   width  of a row
#   px     points in a unit of length
#   nx     pieces
GridParams = namedtuple("GridParams", "c width x0 y0 px py nx ny")


def piece(v, origin, per, n):
    """Return the number of a grid piece, the position within it, and its derivative.

    Beyond the grid, the position is that of the edge.
    """
    t = (v - origin) * per
    held = where(t > 0.0, where(t < n, t, n), 0.0)
    i = floor(held)
    i = where(i < n, i, n - 1.0)
    return i, held - i, where(held == t, per, 0.0)


def spoiled(x, y):
    """Return 0, or NaN where x or y is NaN."""
    return where(x == x, where(y == y, 0.0, y), x)


@dataclass(frozen=True, eq=False)
class Grid(Block, abstract=True):
    """Base class of functions of two positions, with gradient, given on a grid.

    The points of the grid are (origin + i spacing, origin + j spacing).
    """

    x: Block
    y: Block
    table: np.ndarray  # [i, j]: x first
    spacing: np.ndarray
    origin: np.ndarray
    value_unit: str
    outputs = ("value", "slope_x", "slope_y")

    def check(self):
        if np.ndim(self.table) != 2 or min(self.table.shape) < 2:
            raise BadValue(
                "lut2: table must have rows for x and columns for y, at least 2 of each; got shape"
                f" {self.table.shape}"
            )
        limits.check("map_points", self.table.size, "lut2: points")
        for name, v in (("spacing", self.spacing), ("origin", self.origin)):
            if v.shape != (2,):
                raise BadValue(
                    f"lut2: {name} must be a number, or two, of x and of y; got shape {v.shape}"
                )
        if not (self.spacing > 0).all():
            raise BadValue(f"lut2: spacing = {self.spacing.min():g} must be above 0")

    def units(self, *u):
        v = unit(self.value_unit)
        return v, v / u[0], v / u[1]

    def params(self, c: np.ndarray) -> GridParams:
        """Return the parameters of a step, from the coefficients."""
        with np.errstate(all="ignore"):
            per = 1 / self.spacing
            steepest = 4 * np.abs(c).max() * max(1.0, *per)
        pieces = np.array(self.table.shape, float) - 1
        if not np.isfinite(steepest):
            raise BadValue(
                "lut2: values too large, or spacing too small, to compute with; check the units"
            )
        return GridParams(
            c.ravel().copy(), float(c.shape[1]), *map(float, (*self.origin, *per, *pieces))
        )


@dataclass(frozen=True, eq=False)
class LinearGrid(Grid):
    """A table over two positions with bilinear interpolation."""

    def design(self, fs):
        return self.params(self.table), ()

    @staticmethod
    def step(p, s, x, y):
        i, a, dx = piece(x, p.x0, p.px, p.nx)
        j, b, dy = piece(y, p.y0, p.py, p.ny)
        k = i * p.width + j
        c00, c01 = p.c[U(k)], p.c[U(k + 1.0)]
        rise, over = p.c[U(k + p.width)] - c00, p.c[U(k + p.width + 1.0)] - c01
        low, high, bad = c00 + a * rise, c01 + a * over, spoiled(x, y)
        return (
            low + b * (high - low) + bad,
            (rise + b * (over - rise)) * dx + bad,
            (high - low) * dy + bad,
        ), s


def spline(a, b, c, d, t):
    """Return a uniform cubic B-spline with four coefficients at t, 0 .. 1."""
    q = 1.0 - t
    inner = a * (q * q * q) + b * (4.0 - 3.0 * t * t * (1.0 + q))
    return (inner + c * (4.0 - 3.0 * q * q * (1.0 + t)) + d * (t * t * t)) * (1 / 6)


def spline_slope(a, b, c, d, t):
    """Return the derivative of ``spline``."""
    q = 1.0 - t
    return 0.5 * ((b - a) * q * q + (c - b) * (1.0 + 2.0 * t * q) + (d - c) * t * t)


def along(p, k, t):
    """Return the spline along y in the row of coefficients that starts at k."""
    return spline(p.c[U(k)], p.c[U(k + 1.0)], p.c[U(k + 2.0)], p.c[U(k + 3.0)], t)


def slope_along(p, k, t):
    """Return the derivative of ``along``."""
    return spline_slope(p.c[U(k)], p.c[U(k + 1.0)], p.c[U(k + 2.0)], p.c[U(k + 3.0)], t)


def bicubic(p, x, y):
    """Return the value of the bicubic spline, and its slopes along x and y.

    p has the fields of GridParams.
    """
    i, a, dx = piece(x, p.x0, p.px, p.nx)
    j, b, dy = piece(y, p.y0, p.py, p.ny)
    k, m, bad = i * p.width + j, p.width, spoiled(x, y)
    c0, c1, c2, c3 = (
        along(p, k, b),
        along(p, k + m, b),
        along(p, k + 2.0 * m, b),
        along(p, k + 3.0 * m, b),
    )
    d0, d1 = slope_along(p, k, b), slope_along(p, k + m, b)
    d2, d3 = slope_along(p, k + 2.0 * m, b), slope_along(p, k + 3.0 * m, b)
    value, tilt = spline(c0, c1, c2, c3, a), spline(d0, d1, d2, d3, a)
    return value + bad, spline_slope(c0, c1, c2, c3, a) * dx + bad, tilt * dy + bad


def spline_coefficients(v: np.ndarray) -> np.ndarray:
    """Return the coefficients of a cubic spline through equally spaced values.

    The spacing is 1, along the first axis, with not-a-knot ends: c = v - v''/6, and one
    more coefficient at each end.
    """
    from scipy.interpolate import CubicSpline

    n = np.arange(len(v))
    bend = CubicSpline(n, v)(n, 2)
    c = v - bend / 6
    return np.concatenate([[2 * c[0] - c[1] + bend[0]], c, [2 * c[-1] - c[-2] + bend[-1]]])


@dataclass(frozen=True, eq=False)
class CubicGrid(Grid):
    """A bicubic spline through all points, sum_ij c_ij B(x - i) B(y - j).

    Its curvature is continuous.
    """

    def design(self, fs):
        try:
            with np.errstate(all="ignore"):
                c = spline_coefficients(spline_coefficients(self.table).T).T
        except ValueError:  # a system that overflows
            c = np.full((1, 1), np.inf)
        return self.params(c), ()

    @staticmethod
    def step(p, s, x, y):
        return bicubic(p, x, y), s


def plain(name: str, v, *axes: Block) -> np.ndarray:
    """Return two numbers, for x and for y, from one or two numbers or constants.

    Constants must be in the unit of their axis.
    """
    given = v if isinstance(v, (list, tuple, np.ndarray)) else (v, v)
    if len(given) != len(axes):
        raise BadValue(f"lut2: {name} must be a number, or two, of x and of y; got {v!r:.200}")
    for one, axis in zip(given, axes, strict=True):
        if isinstance(one, Const) and one.unit and one.dim != axis.dim:
            raise UnitError(
                f"lut2: {name} = {one!r} [{one.dim}] must be in the unit of {axis!r} [{axis.dim}]"
            )
    return np.array([one.value if isinstance(one, Const) else one for one in given])


@public
def lut2(
    x: Block | float,
    y: Block | float,
    table,
    spacing,
    origin=0.0,
    kind: Literal["linear", "cubic"] = "linear",
    unit: str = "",
) -> Grid:
    """Compute a function of two positions, and its gradient, from a regular grid.

    Parameters
    ----------
    x, y : Block
        Places, usually in m.
    table : array_like, shape (n, m)
        Values in ``unit``: ``table[i, j]`` at x = origin + i spacing, y = origin + j
        spacing; at least 2 each way.
    spacing, origin : number or (number, number)
        Of the points; one for both ways, or that of x and that of y, in their units:
        plain, or ``constant(1e-3, "m")``.
    kind : {"linear", "cubic"}
        Straight lines along x and y (the slope jumps from piece to piece); a bicubic
        spline through all points, whose slope and curvature have no jumps, and which
        may overshoot beside an edge.
    unit : str
        Of the values.

    Returns
    -------
    Block
        With the outputs ``value``, in ``unit``, and ``slope_x`` and ``slope_y``, the
        derivatives along x and y, in ``unit`` per unit of x and y.  What nobody listens
        to is not computed.  Beyond its edges the map is held: the value is that of the
        nearest place on the edge, the slope across it 0.

    Raises
    ------
    BadValue
        A table that is not two-dimensional, less than 2 points each way, more points
        than ``stimlib.limits.map_points``, values that are not finite, a spacing not
        above 0, an unknown kind.
    UnitError
        A spacing or origin in another unit than its place.

    References
    ----------
    de Boor, "Bicubic spline interpolation", J. Mathematics and Physics 41, 1962; Unser
    1999 (uniform B-splines).

    Examples
    --------
    The stiffness of a soft object with a hard lump at 10 mm, 10 mm, and how it rises
    along x:

    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import constant, lut2
    >>> far = np.hypot(*np.meshgrid(np.arange(21) - 10, np.arange(21) - 10))  # mm
    >>> x, y = stimlib.Input("x", "m"), stimlib.Input("y", "m")
    >>> S = lut2(
    ...     x,
    ...     y,
    ...     300 + 500 * np.exp(-(far**2) / 18),
    ...     constant(1e-3, "m"),
    ...     kind="cubic",
    ...     unit="N/m",
    ... )
    >>> scene = stimlib.Scene({"S": S.value, "rise": S.slope_x})
    >>> scene
    Scene(x [m], y [m] -> S [N/m], rise [Pa])
    >>> stimlib.compile(scene, fs=1000).process(
    ...     np.array([[0.01, 0.0085], [0.01, 0.01]])
    ... ).round()
    array([[  800.,   741.],
           [    0., 73567.]])
    """
    x, y = as_block(x), as_block(y)
    make = {"linear": LinearGrid, "cubic": CubicGrid}[kind]
    return make(x, y, table, plain("spacing", spacing, x, y), plain("origin", origin, x, y), unit)
