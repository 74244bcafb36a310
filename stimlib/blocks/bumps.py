"""Bumps: envelopes tied to the finger's place."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from ..core import units as un
from ..core.graph import NONE, ONE, Block, Const, as_block, scratch
from ..core.maths import each, floor, fma, where
from ..core.parameter import Param
from ..errors import BadValue, UnitError, one_of, public
from .movement import Over, PlaceState, gap, regular, sinpi

# Each sample is the mean over the movement of one period.
#
# Only sums and products are used, no mathematical library, so that the bits are the
# same on every machine.
U = np.uint64

WAVEFORMS = ("square", "sine", "sawtooth", "half_sine")
LEAST = 1e-6
"""Smallest duty of a parameter."""


# A place on a ridge is its part z of 0..1.  The mean of each envelope over z from a to
# b is written without a division by b - a and without a difference of nearly equal
# numbers; the mean over any movement follows from it.
def cell(u):
    """Return the integer part and the fraction (0 .. below 1) of a spatial phase."""
    k = floor(u)
    w = u - k  # may round up to 1
    return where(w >= 1.0, k + 1.0, k), where(w >= 1.0, 0.0, w)


def held_duty(d):
    """Return a duty cycle limited to 1e-6 .. 1."""
    return where(d < LEAST, LEAST, where(d > 1.0, 1.0, d))


def on_ridge(w, d, r):
    """Return the fraction of the ridge that lies behind a position in its cell.

    The ridge has the width d = 1/r.
    """
    return where(w < d, w * r, 1.0)


def bounded(y):
    """Return a value limited to 0 .. 1 against rounding; NaN stays NaN."""
    return where(y <= 0.0, 0.0, where(y > 1.0, 1.0, y))


def average(k0, w0, k1, w1, du, d, a, b, mean, whole):
    """Return the mean of the envelope over a movement du.

    It is computed from the mean between a and b of a ridge and the mean over a whole
    ridge.
    """
    part = d * fma(k1 - k0, whole, (b - a) * mean) / du
    y = where(du == 0.0, 0.0 * d, part)
    return bounded(where(k0 == k1, where(w0 < d, where(w1 < d, mean, y), y), y))


def began(p, last, cold, u):
    """Return the position at which the movement of this sample began.

    It is the present position at a start, and for point sampling.
    """
    return where(p.area > 0.0, where(cold > 0.0, u, last), u)


def cells(first, u, d, k, w):
    """Compute the cells of all samples and of the point where the movement began.

    Return how many of the samples are on the same ridge or in the same groove.
    """
    k[0], w[0] = cell(first)
    k1, w1, together, place, ridge = k[1:], w[1:], NONE, k[0], where(w[0] < d, ONE, NONE)
    for i in range(u.size):
        k1[i], w1[i] = cell(u[i])
        together = together + where(k1[i] == place, where(w1[i] < d, ridge, ONE - ridge), NONE)
    return together


@dataclass(frozen=True, eq=False)
class Bump(Over, abstract=True):
    """Base class of bumps: the mean of a unipolar envelope e(u) over each movement.

    The envelope has period 1 and is averaged over u[n-1] .. u[n]. It is a function of z
    = frac(u)/duty on the ridge, frac(u) < duty, and 0 in the groove. Each tile has a
    fast path for the usual case of a constant duty cycle, and within it for tiles on
    one ridge or in one groove.
    """

    u: Block
    duty: Block
    contact: Block
    sampling: str

    def check(self):
        one_of("bump: sampling", self.sampling, ("area", "point"))
        d = self.duty
        if isinstance(d, (Const, Param)) and not 0 < d.value <= 1:
            raise BadValue(f"bump: duty = {d.value!r} must be above 0 and at most 1")

    def units(self, *u):
        for name, v in zip(("u", "duty"), u, strict=False):
            if v != un.ONE:
                hint = ": divide the position by the wavelength" if name == "u" else ""
                raise UnitError(
                    f"bump: {name} = {getattr(self, name)!r} [{v}] must have no unit{hint}"
                )
        return un.ONE

    def delay(self, p):
        """Return half a sample, the delay of a mean over the last sample period."""
        return 0.5 * p.area

    @property
    def area(self) -> float:
        """1 if each sample is the mean over its path, else 0."""
        return float(self.sampling == "area")


# Parameters of `LinearBump` at a sample rate.
LinearParams = namedtuple("LinearParams", "area start slope whole")

# A ridge with a linear profile, for a duty cycle.
#   r      1/d
#   whole  mean over a ridge
LinearShape = namedtuple("LinearShape", "d r start slope whole")


def linear_shape(p, duty):
    """Return the ridge numbers that depend only on the duty cycle."""
    d = held_duty(duty)
    return LinearShape(d, 1.0 / d, p.start, p.slope, p.whole)


def linear_mean(q, a, b):
    """Return the mean of a straight line, which is its value in the middle."""
    return fma(q.slope, 0.5 * (a + b), q.start)


def linear(q, k0, w0, k1, w1, u0, u):
    """Return the mean of the envelope over a movement."""
    a, b = on_ridge(w0, q.d, q.r), on_ridge(w1, q.d, q.r)
    return average(k0, w0, k1, w1, u - u0, q.d, a, b, linear_mean(q, a, b), q.whole)


def linear_sample(p, last, cold, u, duty):
    """Return the mean for one sample, for any kind of movement."""
    u0 = began(p, last, cold, u)
    k0, w0 = cell(u0)
    k1, w1 = cell(u)
    return linear(linear_shape(p, duty), k0, w0, k1, w1, u0, u)


def linear_point(q, w, u):
    """Return the envelope at a position."""
    e = where(w < q.d, bounded(linear_mean(q, w * q.r, w * q.r)), 0.0 * q.d)
    return where(u - u == 0.0, e, u - u)


def linear_inside(q, w0, w1):
    """Return the mean of the envelope over a movement within one ridge."""
    return bounded(linear_mean(q, w0 * q.r, w1 * q.r))


@dataclass(frozen=True, eq=False)
class LinearBump(Bump):
    """Bumps with a linear profile: square (e = 1) or sawtooth (e = z)."""

    waveform: str

    def design(self, fs):
        start, slope = (1.0, 0.0) if self.waveform == "square" else (0.0, 1.0)
        return LinearParams(self.area, start, slope, start + slope / 2), PlaceState(0.0, 1.0)

    work = scratch(130)

    @staticmethod
    def step(p, s, u, duty):
        return linear_sample(p, s.last, s.cold, u, duty), PlaceState(u, 0.0)

    @staticmethod
    def tile(p, s, u, duty, y, w):
        n, all_of = y.size - 1, U(y.size)
        before, v, now, out = u[:n], u[1:], duty[1:], y[1:]
        if regular(duty) < all_of:
            y[0] = linear_sample(p, s.last, s.cold, u[0], duty[0])
            for i in range(n):
                out[i] = linear_sample(p, before[i], 0.0, v[i], now[i])
        else:
            q, first = linear_shape(p, duty[0]), began(p, s.last, s.cold, u[0])
            k, z = w[:65], w[65:]
            together = cells(first, u, q.d, k, z)
            k1, z1 = k[1:], z[1:]
            if together == all_of and z[0] >= q.d:
                y[:] = 0.0
            elif p.area == 0.0:
                each(linear_point, q, (z1, u), y)
            elif together == all_of:
                each(linear_inside, q, (z, z1), y)
            else:
                y[0] = linear(q, k[0], z[0], k[1], z[1], first, u[0])
                each(linear, q, (k1, z1, k[2:], z[2:], before, v), out)
        return PlaceState(u[n], 0.0)


# Parameters of `SineBump` at a sample rate.
SineParams = namedtuple("SineParams", "area half")

# A ridge with a sinusoidal profile, for a duty cycle.
#   r      1/d
#   k      half periods of the sinusoid on a ridge
#   h      1/sin(pi k/2)^2
#   whole  mean over a ridge
SineShape = namedtuple("SineShape", "d r k h whole")


def sine_shape(p, duty):
    """Return the ridge numbers that depend only on the duty cycle."""
    d = held_duty(duty)
    k = where(p.half > 0.0, 0.5, d)
    s = sinpi(0.5 * k)
    h = 1.0 / (s * s)
    return SineShape(d, 1.0 / d, k, h, fma(-0.5 * h, gap(k), 1.0))


def sine_top(q, z):
    """Return the envelope at a point z of the ridge."""
    s = sinpi(q.k * (z - 0.5))
    return fma(-(s * s), q.h, 1.0)


def sine_mean(q, a, b):
    """Return the mean of the envelope from a to b.

    e(m) - g (e(m) + h/2 - 1), m = (a+b)/2, g = 1 - sin(x)/x, x = pi k (b-a).
    """
    e = sine_top(q, 0.5 * (a + b))
    return fma(-gap(q.k * (b - a)), fma(0.5, q.h, e - 1.0), e)


def sine(q, k0, w0, k1, w1, u0, u):
    """Return the mean of the envelope over a movement."""
    a, b = on_ridge(w0, q.d, q.r), on_ridge(w1, q.d, q.r)
    return average(k0, w0, k1, w1, u - u0, q.d, a, b, sine_mean(q, a, b), q.whole)


def sine_point(q, w, u):
    """Return the envelope at a position."""
    e = where(w < q.d, bounded(sine_top(q, on_ridge(w, q.d, q.r))), 0.0 * q.d)
    return where(u - u == 0.0, e, u - u)


def sine_inside(q, w0, w1):
    """Return the mean of the envelope over a movement within one ridge."""
    return bounded(sine_mean(q, w0 * q.r, w1 * q.r))


def sine_sample(p, last, cold, u, duty):
    """Return the mean for one sample, for any kind of movement."""
    u0 = began(p, last, cold, u)
    k0, w0 = cell(u0)
    k1, w1 = cell(u)
    return sine(sine_shape(p, duty), k0, w0, k1, w1, u0, u)


@dataclass(frozen=True, eq=False)
class SineBump(Bump):
    """Bumps with a sinusoidal profile.

    e = 1 - (sin(pi k (z - 1/2))/sin(pi k/2))^2, with k = duty for a sine, and k = 1/2
    for a half_sine, so that e = sin(pi z). This equals
    (cos t - cos(pi k))/(1 - cos(pi k)), t = 2 pi k (z - 1/2): the top of a cosine.
    """

    waveform: str

    def design(self, fs):
        return SineParams(self.area, float(self.waveform == "half_sine")), PlaceState(0.0, 1.0)

    work = scratch(130)

    @staticmethod
    def step(p, s, u, duty):
        return sine_sample(p, s.last, s.cold, u, duty), PlaceState(u, 0.0)

    @staticmethod
    def tile(p, s, u, duty, y, w):
        n, all_of = y.size - 1, U(y.size)
        before, v, now, out = u[:n], u[1:], duty[1:], y[1:]
        if regular(duty) < all_of:
            y[0] = sine_sample(p, s.last, s.cold, u[0], duty[0])
            for i in range(n):
                out[i] = sine_sample(p, before[i], 0.0, v[i], now[i])
        else:
            q, first = sine_shape(p, duty[0]), began(p, s.last, s.cold, u[0])
            k, z = w[:65], w[65:]
            together = cells(first, u, q.d, k, z)
            k1, z1 = k[1:], z[1:]
            if together == all_of and z[0] >= q.d:
                y[:] = 0.0
            elif p.area == 0.0:
                each(sine_point, q, (z1, u), y)
            elif together == all_of:
                each(sine_inside, q, (z, z1), y)
            else:
                y[0] = sine(q, k[0], z[0], k[1], z[1], first, u[0])
                each(sine, q, (k1, z1, k[2:], z[2:], before, v), out)
        return PlaceState(u[n], 0.0)


# Parameters of `TableBump` at a sample rate.
#   values  at both ends of each piece
#   sums    of the pieces' means, up to each knot
TableBumpParams = namedtuple("TableBumpParams", "area values sums pieces whole")


def piece(p, z):
    """Return the number, as a float, of the piece that contains z (0 for NaN)."""
    i = floor(z * p.pieces)
    return where(i > 0.0, where(i < p.pieces, i, p.pieces - 1.0), 0.0)


def on_piece(p, i, q):
    """Return the value of piece i at the fraction q of its length."""
    a, b = p.values[U(i)], p.values[U(i) + ONE]
    return fma(b - a, q, a)


def table_mean(p, a, b):
    """Return the mean of a table between a and b, in either order.

    It is the sum of the rest of one piece, whole pieces, and a part of the last piece.
    """
    low, high = where(a < b, a, b), where(a < b, b, a)
    i, j = piece(p, low), piece(p, high)
    x, y = fma(low, p.pieces, -i), fma(high, p.pieces, -j)
    first = (1.0 - x) * (0.5 * (on_piece(p, i, x) + p.values[U(i) + ONE]))
    last = y * (0.5 * (p.values[U(j)] + on_piece(p, j, y)))
    between = p.sums[U(j)] - p.sums[U(i) + ONE]
    return where(
        i == j, on_piece(p, i, 0.5 * (x + y)), (first + between + last) / ((high - low) * p.pieces)
    )


@dataclass(frozen=True, eq=False)
class TableBump(Bump):
    """Bumps with a profile given by values, spread evenly over the ridge.

    Between the values, z = 0 .. 1, the profile is a straight line.
    """

    values: np.ndarray

    def check(self):
        Bump.check(self)
        v = self.values
        if np.ndim(v) != 1 or len(v) < 2:
            raise BadValue(
                "bump: a waveform given as a table needs one row of at least 2 values, got shape"
                f" {np.shape(v)}"
            )
        if not ((np.asarray(v) >= 0) & (np.asarray(v) <= 1)).all():
            raise BadValue(
                "bump: the values of a waveform must lie in 0 .. 1; multiply the bump by its"
                " amplitude"
            )

    def design(self, fs):
        v = np.array(self.values)
        sums = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]))])
        return TableBumpParams(
            self.area, v, sums, float(v.size - 1), sums[-1] / (v.size - 1)
        ), PlaceState(0.0, 1.0)

    @staticmethod
    def step(p, s, u, duty):
        u0, d = began(p, s.last, s.cold, u), held_duty(duty)
        k0, w0 = cell(u0)
        k1, w1 = cell(u)
        a, b = on_ridge(w0, d, 1.0 / d), on_ridge(w1, d, 1.0 / d)
        y = average(k0, w0, k1, w1, u - u0, d, a, b, table_mean(p, a, b), p.whole)
        return y, PlaceState(u, 0.0)


@public
def bump(
    u: Block | float,
    waveform="square",
    duty: Block | float = 0.5,
    sampling: str = "area",
    contact: Block | float = 1.0,
) -> Block:
    """Make bumps on a surface: an envelope tied to the position of the finger.

    The envelope is unipolar, 0 .. 1.

    With w = frac(u) the envelope e(u) is, on the ridge w < duty,

    * ``"square"``: 1;
    * ``"sawtooth"``: w/duty, a ramp from 0 to 1;
    * ``"sine"``: (cos t - cos(pi duty))/(1 - cos(pi duty)), t = 2 pi (w - duty/2): the
      top of a cosine, 0 at both ends;
    * ``"half_sine"``: sin(pi w/duty);
    * a table: straight lines between its values, which are spread evenly over the
      ridge;

    and 0 in the groove.  With area sampling, y[n] is the exact mean of e over u[n-1] ..
    u[n], for any length and direction of the movement; so over any movement the sum of
    y[n] (u[n] - u[n-1]) is the integral of e.  The mean lies half a sample back.  While
    the finger stands still, y[n] = e(u[n]).

    Parameters
    ----------
    u : Block
        Spatial phase, position/wavelength, without unit; one bump is 1.
    waveform : {"square", "sine", "sawtooth", "half_sine"} or array_like, shape (m,)
        A table has m >= 2 values in 0 .. 1.
    duty : float or Block
        Part of the period that is ridge, above 0, at most 1.  Any is held to 1e-6 or
        more, a parameter or signal to 1 or less.
    sampling : {"area", "point"}
        "point" takes e(u[n]), with its aliases, for comparison.
    contact : Block
        Where it is not above 0 the output is 0 and u is not looked at.  At re-contact,
        as at the first sample, u[n-1] = u[n]: the way between plays no bumps.

    Returns
    -------
    Block
        0 .. 1, without unit.

    Raises
    ------
    BadValue
        A duty outside (0, 1], an unknown waveform or sampling, values outside 0 .. 1.
    UnitError
        u or duty with a unit.

    References
    ----------
    The touch-screen thesis, chapter 3 (unipolar waves, duty cycle, number of bumps) and
    figure 4.1.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import bump
    >>> u = np.array([[0.0, 0.2, 0.4, 0.6, 1.6, 1.6, 1.2]])
    >>> for waveform in ("square", [0.0, 1.0]):
    ...     proc = stimlib.compile(
    ...         stimlib.Scene({"e": bump(stimlib.Input("u"), waveform, duty=0.5)}),
    ...         fs=1000,
    ...     )
    ...     print(proc.process(u).round(6))
    [[1.   1.   1.   0.5  0.5  0.   0.75]]
    [[0.     0.2    0.6    0.45   0.25   0.     0.525]]
    """
    u, duty, contact = as_block(u), as_block(duty), as_block(contact)
    if not isinstance(waveform, str):
        return TableBump(u, duty, contact, sampling, waveform)
    if waveform not in WAVEFORMS:
        raise BadValue(
            f"bump: waveform {waveform!r}; choose one of {', '.join(WAVEFORMS)}, or give a table of"
            " values"
        )
    if waveform in ("square", "sawtooth"):
        return LinearBump(u, duty, contact, sampling, waveform)
    return SineBump(u, duty, contact, sampling, waveform)
