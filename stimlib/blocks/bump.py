"""Envelopes tied to the finger's place: bumps, each sampled by area, a sample being the
mean over the movement of one period.

Only sums and products are used, no mathematical library, so that the bits are the same
on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import units as un
from ..core.graph import NONE, ONE, Block, Const, Param, as_block
from ..core.maths import each, floor, fma, where
from ..errors import BadValue, UnitError, public

U, INT = np.uint64, np.int64

WAVEFORMS = ("square", "sine", "sawtooth", "half_sine")
SAMPLINGS = ("area", "point")
LEAST = 1e-6
"""Smallest duty of a parameter."""

# sin(pi x)/x in x^2 for |x| <= 1/2;  (1 - sin(pi x)/(pi x))/x^2 in x^2 for |x| <= 1:
# relative errors below 1e-16
P0, P1, P2, P3 = 3.141592653589793, -5.167712780049969, 2.5501640398773007, -0.5992645293189447
P4, P5, P6, P7 = (
    0.0821458865731029,
    -0.007370430505916944,
    0.0004662998161898394,
    -2.1903497074626018e-05,
)
P8 = 7.697826768224191e-07
G0, G1, G2, G3 = 1.6449340668482264, -0.8117424252833536, 0.19075182412208397, -0.026147847817651126
G4, G5, G6, G7 = (
    0.002346081035426408,
    -0.000148428792893624,
    6.975873261074044e-06,
    -2.531209900320938e-07,
)
G8, G9, G10 = 7.303807539233181e-09, -1.709751764178703e-10, 3.058160916927997e-12


def sinpi(x):
    """sin(pi x) for |x| <= 1/2."""
    z = x * x
    return x * fma(
        fma(fma(fma(fma(fma(fma(fma(P8, z, P7), z, P6), z, P5), z, P4), z, P3), z, P2), z, P1),
        z,
        P0,
    )


def gap(x):
    """1 - sin(pi x)/(pi x) for |x| <= 1: what averaging over x half periods takes from
    a sinusoid.
    """
    z = x * x
    q = fma(fma(fma(fma(fma(G10, z, G9), z, G8), z, G7), z, G6), z, G5)
    return z * fma(fma(fma(fma(fma(q, z, G4), z, G3), z, G2), z, G1), z, G0)


# Envelopes ----------------------------------------------------------------------------
# A place on a ridge is its part z of 0..1.  The mean of each envelope over z from a to
# b is written without a division by b - a and without a difference of nearly equal
# numbers; the mean over any movement follows from it.
def cell(u):
    """(whole number, rest in 0..1 and below 1) of a spatial phase."""
    k = floor(u)
    w = u - k  # may round up to 1
    return where(w >= 1.0, k + 1.0, k), where(w >= 1.0, 0.0, w)


def held_duty(d):
    """A live duty, held between 1e-6 and 1."""
    return where(d < LEAST, LEAST, where(d > 1.0, 1.0, d))


def on_ridge(w, d, r):
    """Part of the ridge, of width d = 1/r, that lies behind a place in its cell."""
    return where(w < d, w * r, 1.0)


def bounded(y):
    """Held in 0 .. 1 against rounding; nan stays."""
    return where(y <= 0.0, 0.0, where(y > 1.0, 1.0, y))


def average(k0, w0, k1, w1, du, d, a, b, mean, whole):
    """Mean of the envelope over a movement du, from its mean between a and b of a ridge
    and over a whole ridge.
    """
    part = d * fma(k1 - k0, whole, (b - a) * mean) / du
    y = where(du == 0.0, 0.0 * d, part)
    return bounded(where(k0 == k1, where(w0 < d, where(w1 < d, mean, y), y), y))


def began(p, last, cold, u):
    """Where this sample's movement began: here, after a start or for point sampling."""
    return where(p.area > 0.0, where(cold > 0.0, u, last), u)


def regular(duty):
    """Samples that have the first one's duty."""
    n = NONE
    for i in range(duty.size):
        n = n + where(duty[i] == duty[0], ONE, NONE)
    return n


def cells(first, u, d, k, w):
    """Cells of where the movement began and of all samples; how many of these are on
    the same ridge or in the same groove.
    """
    k[0], w[0] = cell(first)
    k1, w1, together, place, ridge = k[1:], w[1:], NONE, k[0], where(w[0] < d, ONE, NONE)
    for i in range(u.size):
        k1[i], w1[i] = cell(u[i])
        together = together + where(k1[i] == place, where(w1[i] < d, ridge, ONE - ridge), NONE)
    return together


class BumpState(NamedTuple):
    last: float
    cold: float


@dataclass(frozen=True, eq=False)
class Bump(Block, abstract=True):
    """The mean of a unipolar envelope e(u) of period 1 over u[n-1] .. u[n].

    e is a function of z = frac(u)/duty on the ridge, frac(u) < duty, and 0 in the
    groove.  Each tile has a fast way for what is usual, one duty, and within it for
    tiles on one ridge or in one groove.
    """

    u: Block
    duty: Block
    contact: Block
    sampling: str
    resettable = True

    def check(self):
        if self.sampling not in SAMPLINGS:
            raise BadValue(
                f"bump: sampling = {self.sampling!r}; choose one of {', '.join(SAMPLINGS)}"
            )
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
        """A mean over the last sample period lies half a sample back."""
        return 0.5 * p.area

    @property
    def area(self) -> float:
        """1 or 0, for the parameters."""
        return float(self.sampling == "area")


class LinearParams(NamedTuple):
    area: float
    start: float
    slope: float
    whole: float


class LinearShape(NamedTuple):
    d: float
    r: float  # 1/d
    start: float
    slope: float
    whole: float  # mean over a ridge


def linear_shape(p, duty):
    """Numbers that depend on the duty alone."""
    d = held_duty(duty)
    return LinearShape(d, 1.0 / d, p.start, p.slope, p.whole)


def linear_mean(q, a, b):
    """A straight line's mean is its value in the middle."""
    return fma(q.slope, 0.5 * (a + b), q.start)


def linear(q, k0, w0, k1, w1, u0, u):
    """The mean over a movement."""
    a, b = on_ridge(w0, q.d, q.r), on_ridge(w1, q.d, q.r)
    return average(k0, w0, k1, w1, u - u0, q.d, a, b, linear_mean(q, a, b), q.whole)


def linear_sample(p, last, cold, u, duty):
    """One sample, whatever happens."""
    u0 = began(p, last, cold, u)
    k0, w0 = cell(u0)
    k1, w1 = cell(u)
    return linear(linear_shape(p, duty), k0, w0, k1, w1, u0, u)


def linear_point(q, w, u):
    """The envelope at a place."""
    e = where(w < q.d, bounded(linear_mean(q, w * q.r, w * q.r)), 0.0 * q.d)
    return where(u - u == 0.0, e, u - u)


def linear_inside(q, w0, w1):
    """The mean over a movement on one ridge."""
    return bounded(linear_mean(q, w0 * q.r, w1 * q.r))


@dataclass(frozen=True, eq=False)
class LinearBump(Bump):
    """square: e = 1;  sawtooth: e = z."""

    waveform: str

    def design(self, fs):
        start, slope = (1.0, 0.0) if self.waveform == "square" else (0.0, 1.0)
        return LinearParams(self.area, start, slope, start + slope / 2), BumpState(0.0, 1.0)

    @staticmethod
    def work(p):
        return 130

    @staticmethod
    def step(p, s, u, duty):
        return linear_sample(p, s.last, s.cold, u, duty), BumpState(u, 0.0)

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
        return BumpState(u[n], 0.0)


class SineParams(NamedTuple):
    area: float
    half: float


class SineShape(NamedTuple):
    d: float
    r: float  # 1/d
    k: float  # half periods of the sinusoid on a ridge
    h: float  # 1/sin(pi k/2)^2
    whole: float  # mean over a ridge


def sine_shape(p, duty):
    """Numbers that depend on the duty alone."""
    d = held_duty(duty)
    k = where(p.half > 0.0, 0.5, d)
    s = sinpi(0.5 * k)
    h = 1.0 / (s * s)
    return SineShape(d, 1.0 / d, k, h, fma(-0.5 * h, gap(k), 1.0))


def sine_top(q, z):
    """The envelope itself."""
    s = sinpi(q.k * (z - 0.5))
    return fma(-(s * s), q.h, 1.0)


def sine_mean(q, a, b):
    """e(m) - g (e(m) + h/2 - 1), m = (a+b)/2, g = 1 - sin(x)/x, x = pi k (b-a)."""
    e = sine_top(q, 0.5 * (a + b))
    return fma(-gap(q.k * (b - a)), fma(0.5, q.h, e - 1.0), e)


def sine(q, k0, w0, k1, w1, u0, u):
    """The mean over a movement."""
    a, b = on_ridge(w0, q.d, q.r), on_ridge(w1, q.d, q.r)
    return average(k0, w0, k1, w1, u - u0, q.d, a, b, sine_mean(q, a, b), q.whole)


def sine_point(q, w, u):
    """The envelope at a place."""
    e = where(w < q.d, bounded(sine_top(q, on_ridge(w, q.d, q.r))), 0.0 * q.d)
    return where(u - u == 0.0, e, u - u)


def sine_inside(q, w0, w1):
    """The mean over a movement on one ridge."""
    return bounded(sine_mean(q, w0 * q.r, w1 * q.r))


def sine_sample(p, last, cold, u, duty):
    """One sample, whatever happens."""
    u0 = began(p, last, cold, u)
    k0, w0 = cell(u0)
    k1, w1 = cell(u)
    return sine(sine_shape(p, duty), k0, w0, k1, w1, u0, u)


@dataclass(frozen=True, eq=False)
class SineBump(Bump):
    """e = 1 - (sin(pi k (z - 1/2))/sin(pi k/2))^2.

    For a sine k = duty; for a half_sine k = 1/2, so e = sin(pi z).  That is
    (cos t - cos(pi k))/(1 - cos(pi k)), t = 2 pi k (z - 1/2): the top of a cosine.
    """

    waveform: str

    def design(self, fs):
        return SineParams(self.area, float(self.waveform == "half_sine")), BumpState(0.0, 1.0)

    @staticmethod
    def work(p):
        return 130

    @staticmethod
    def step(p, s, u, duty):
        return sine_sample(p, s.last, s.cold, u, duty), BumpState(u, 0.0)

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
        return BumpState(u[n], 0.0)


class TableBumpParams(NamedTuple):
    area: float
    values: np.ndarray  # at both ends of each piece
    sums: np.ndarray  # of the pieces' means, up to each knot
    pieces: float
    whole: float


def piece(p, z):
    """Number of the piece, as a float, that holds z (0 for nan)."""
    i = floor(z * p.pieces)
    return where(i > 0.0, where(i < p.pieces, i, p.pieces - 1.0), 0.0)


def on_piece(p, i, q):
    """Value of piece i at its part q."""
    a, b = p.values[U(i)], p.values[U(i) + ONE]
    return fma(b - a, q, a)


def table_mean(p, a, b):
    """Mean over a to b, whichever is larger: the rest of one piece, whole pieces, a
    part of the last.
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
    """e = straight lines between values that are spread evenly over the ridge, z = 0 ..
    1.
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
        ), BumpState(0.0, 1.0)

    @staticmethod
    def step(p, s, u, duty):
        u0, d = began(p, s.last, s.cold, u), held_duty(duty)
        k0, w0 = cell(u0)
        k1, w1 = cell(u)
        a, b = on_ridge(w0, d, 1.0 / d), on_ridge(w1, d, 1.0 / d)
        y = average(k0, w0, k1, w1, u - u0, d, a, b, table_mean(p, a, b), p.whole)
        return y, BumpState(u, 0.0)


@public
def bump(
    u: Block | float,
    waveform="square",
    duty: Block | float = 0.5,
    sampling: str = "area",
    contact: Block | float = 1.0,
) -> Block:
    """Bumps on a surface: a unipolar envelope, 0 .. 1, tied to the place of the finger.

    With w = frac(u) the envelope e(u) is, on the ridge w < duty,

    * ``"square"``: 1;
    * ``"sawtooth"``: w/duty, a ramp from 0 to 1;
    * ``"sine"``: (cos t - cos(pi duty))/(1 - cos(pi duty)), t = 2 pi (w - duty/2): the
      top of a cosine, 0 at both ends;
    * ``"half_sine"``: sin(pi w/duty);
    * a table: straight lines between its values, which are spread evenly over the
      ridge;

    and 0 in the groove.  With area sampling, y[n] is the exact mean of e over u[n-1] ..
    u[n], however far that is and in whichever direction; so over any movement the sum
    of y[n] (u[n] - u[n-1]) is the integral of e.  It lies half a sample back.  Where
    the finger stands, y[n] = e(u[n]).

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
