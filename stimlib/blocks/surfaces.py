"""Surfaces: bumps, noise and gratings over position, and uniform displacement."""

from __future__ import annotations

import math
import os
from collections import namedtuple
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core import units as un
from ..core.graph import NONE, ONE, Block, Const, as_block, scratch, unitless
from ..core.maths import as_float, each, floor, fma, pairs, sqrt, where
from ..core.parameter import Param
from ..core.pointwise import clip, maximum
from ..core.units import unit
from ..design.noise import octaves
from ..errors import Above0, BadValue, UnitError, one_of, public
from ..system import safe_files
from ..system.limits import limits
from .impedance import with_unit
from .movement import Over, PlaceState, gap, regular, sinpi
from .noise import noise_key, pair_of_words
from .tables import KINDS, OUTSIDE, lut

# Bumps ------------------------------------------------------------------------------
# Envelopes tied to the finger's place: bumps, each sampled by area, a sample being the
# mean over the movement of one period.
#
# Only sums and products are used, no mathematical library, so that the bits are the
# same on every machine.
U, INT = np.uint64, np.int64

WAVEFORMS = ("square", "sine", "sawtooth", "half_sine")
SAMPLINGS = ("area", "point")
LEAST = 1e-6
"""Smallest duty of a parameter."""


# Envelopes ----------------------------------------------------------------------------
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
        one_of("bump: sampling", self.sampling, SAMPLINGS)
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


# Noise and gratings over place ------------------------------------------------------
# Surfaces: what is felt at a place, the same whenever a finger comes there, each sample
# the mean over its movement.
#
# Only sums, products and square roots are used, no mathematical library, so that the
# bits are the same on every machine.
SURFACE = 3  # what a key is used for: 0 white noise, 1 its stationary start, 2 an order of trials
SLOPES = 0.5, 4.0
MOST = 1e9  # longest by shortest wavelength: 33 octaves

# Noise over place ---------------------------------------------------------------------
FIELD, SHIFT_16, SHIFT_32, SHIFT_48 = U(0xFFFF), U(16), U(32), U(48)
MIDDLE, DEVIATION = 131070.0, math.sqrt(3 / (65536**2 - 1))
FAR = 2.0**50  # cells from 0: beyond, a place is held
WINDOW = 72.0  # lattice values that are made at once: 64 samples of less than a cell have no more


def sum_of_fields(v):
    """Return the sum of a word's four 16-bit fields, scaled to unit variance.

    It has mean 0 and variance 1, is nearly normal, and lies within 3.46.
    """
    s = (v & FIELD) + ((v >> SHIFT_16) & FIELD) + ((v >> SHIFT_32) & FIELD) + (v >> SHIFT_48)
    return (as_float(s) - MIDDLE) * DEVIATION


def lattice(key, m):
    """Return the random heights at lattice points 2m and 2m + 1 of an octave."""
    a, b = pair_of_words(key, m)
    return sum_of_fields(a), sum_of_fields(b)


def spline_mean(n0, n1, n2, a, b):
    """Return the mean of a quadratic B-spline from a to b within one cell, 0 .. 1.

    It is the value in the middle, plus curvature times (b - a)^2/24.
    """
    t, d = 0.5 * (a + b), b - a
    q = 1.0 - t
    return (
        0.5 * q * q * n0
        + (0.5 + t * q) * n1
        + 0.5 * t * t * n2
        + (n0 - 2.0 * n1 + n2) * (d * d) * (1 / 24)
    )


def heard(r):
    """Return the fraction of an octave's power that is kept at r cells per sample.

    It is 1 up to 2 cells per sample, and 0 from 4 on.
    """
    t = where(r > 2.0, where(r < 4.0, 0.5 * r - 1.0, 1.0), 0.0)
    return 1.0 - t * t * (3.0 - 2.0 * t)


def gain(r, own, finer):
    """Return the amplitude of one octave of the noise over position.

    It includes the power that finer octaves lose, which is white noise at this speed.
    """
    return sqrt(heard(r) * (own + (1.0 - heard(2.0 * r)) * finer))


def held_place(v):
    """Return a position limited to the numbered cells; NaN becomes an end."""
    return where(v > -FAR, where(v < FAR, v, FAR), -FAR)


# One cell of an octave, with its three spline coefficients.
#   place  of its beginning
Cell = namedtuple("Cell", "n0 n1 n2 place scale at amplitude")


def inside(q, before, v, y):
    """Return y plus the contribution of an octave, for a movement within one cell."""
    return y + q.amplitude * spline_mean(
        q.n0, q.n1, q.n2, before * q.scale + q.at - q.place, v * q.scale + q.at - q.place
    )


# An octave whose cells are all longer than the path of a sample.
Octave = namedtuple("Octave", "scale at amplitude")


def near(q, before, v, n0, n1, n2, n3, y):
    """Return y plus an octave's contribution, for a movement in one cell or two."""
    a, b = before * q.scale + q.at, v * q.scale + q.at
    lo, hi = where(a < b, a, b), where(a < b, b, a)
    f, g = floor(lo), floor(hi)
    one, r = spline_mean(n0, n1, n2, lo - f, hi - f), where(f == g, 1.0, hi - lo)
    two = (f + 1.0 - lo) * spline_mean(n0, n1, n2, lo - f, 1.0) + (hi - g) * spline_mean(
        n1, n2, n3, 0.0, hi - g
    )
    return y + q.amplitude * where(f == g, one, two / r)


# Parameters of `SpatialNoise` at a sample rate.
#   scale  finest cells in a unit of length
#   at     place of 0, in cells
#   own    a^2
#   finer  what all finer octaves together have at low frequencies, as a^2
SpatialParams = namedtuple("SpatialParams", "scale keys at own finer")


@dataclass(frozen=True, eq=False)
class SpatialNoise(Over):
    """Octaves of random splines over position, averaged over each movement.

    sum_j a_j mean of sum_m n_j[m] B(place/D_j - m) over the movement, D_j = 2^j D_0;
    n_j[m] from Philox(key_j, m).
    """

    u: Block
    contact: Block
    slope: float
    seed: int
    shortest: Above0
    longest: Above0

    def check(self):
        if isinstance(self.seed, bool) or not 0 <= self.seed < 2**64:
            raise BadValue(
                f"spatial_noise: seed = {self.seed!r} must be a whole number from 0 to {2**64 - 1}"
            )
        if not SLOPES[0] <= self.slope <= SLOPES[1]:
            raise BadValue(
                f"spatial_noise: slope = {self.slope:g} must be from {SLOPES[0]:g} to {SLOPES[1]:g}"
            )
        if not self.shortest < self.longest <= MOST * self.shortest:
            raise BadValue(
                f"spatial_noise: longest = {self.longest:g} must be above shortest ="
                f" {self.shortest:g}, at most {MOST:g} times it"
            )

    units = unitless

    def design(self, fs):
        found = octaves(self.slope, 1 / self.longest, 1 / self.shortest)
        n = found.cells.size
        density = found.power * found.cells
        finer = np.concatenate([[0.0], np.cumsum(density)[:-1]]) / found.cells
        keys = np.array([noise_key(0, self.seed, 2 * j, SURFACE) for j in range(n)])
        at = np.array(
            [float(noise_key(0, self.seed, 2 * j + 1, SURFACE)) * 2.0**-64 for j in range(n)]
        )
        return SpatialParams(
            1 / float(found.cells[0]), keys, at, np.array(found.power), finer
        ), PlaceState(0.0, 1.0)

    work = scratch(460)

    @staticmethod
    def tile(p, s, u, y, w):
        n = y.size
        before, v, z = w[:n], w[64 : 64 + n], w[384:]
        n0, n1, n2, n3 = w[128 : 128 + n], w[192 : 192 + n], w[256 : 256 + n], w[320 : 320 + n]
        last = where(s.cold > 0.0, held_place(u[0] * p.scale), held_place(s.last))
        low, high, fastest, scale = last, last, 0.0, 1.0
        for i in range(n):
            before[i] = last
            last = held_place(u[i] * p.scale)
            v[i] = last
            fastest = where(abs(last - before[i]) > fastest, abs(last - before[i]), fastest)
            low, high = where(last < low, last, low), where(last > high, last, high)
            y[i] = u[i] - u[i]  # nan where it is not finite
        for j in range(p.own.size):
            at, own, finer, whole = p.at[j], p.own[j], p.finer[j], sqrt(p.own[j])
            first, end = floor(low * scale + at), floor(high * scale + at) + 3.0
            base = 2.0 * floor(0.5 * first)
            size = where(end - base < WINDOW, end - base, WINDOW)
            pairs(lattice, p.keys[j], U(INT(0.5 * base)), z[: INT(size)])
            if end - first == 3.0:
                k = INT(first - base)
                each(
                    inside,
                    Cell(z[k], z[k + 1], z[k + 2], first, scale, at, whole),
                    (before, v, y),
                    y,
                )
            elif fastest * scale < 0.75:
                for i in range(n):
                    k = INT(floor(where(before[i] < v[i], before[i], v[i]) * scale + at) - base)
                    n0[i], n1[i], n2[i], n3[i] = z[k], z[k + 1], z[k + 2], z[k + 3]
                each(near, Octave(scale, at, whole), (before, v, n0, n1, n2, n3, y), y)
            else:
                for i in range(n):
                    a, b = before[i] * scale + at, v[i] * scale + at
                    lo, hi = where(a < b, a, b), where(a < b, b, a)
                    r = hi - lo
                    if r < 4.0:
                        f, g = floor(lo), floor(hi)
                        if f < base or g + 3.0 > base + size:
                            base, size = (
                                2.0 * floor(0.5 * where(a > b, g + 4.0 - WINDOW, f)),
                                WINDOW,
                            )
                            pairs(lattice, p.keys[j], U(INT(0.5 * base)), z[: INT(size)])
                        k = INT(f - base)
                        if f == g:
                            mean = spline_mean(z[k], z[k + 1], z[k + 2], lo - f, hi - f)
                        else:
                            area = (f + 1.0 - lo) * spline_mean(
                                z[k], z[k + 1], z[k + 2], lo - f, 1.0
                            )
                            for c in range(1, INT(g - f)):
                                area = area + spline_mean(
                                    z[k + c], z[k + c + 1], z[k + c + 2], 0.0, 1.0
                                )
                            k = INT(g - base)
                            mean = (
                                area + (hi - g) * spline_mean(z[k], z[k + 1], z[k + 2], 0.0, hi - g)
                            ) / r
                        if r > 1.0:
                            y[i] = y[i] + gain(r, own, finer) * mean
                        else:
                            y[i] = y[i] + whole * mean
            scale = 0.5 * scale
        return PlaceState(last, 0.0)


@public
def spatial_noise(
    u: Block | float,
    slope: float = 1.0,
    seed: int = 0,
    shortest: float = 2e-5,
    longest: float = 0.2,
    contact: Block | float = 1.0,
) -> Block:
    """Compute roughness: noise with spectrum 1/f^slope over position.

    The noise at a position is always the same, however the finger gets there.

    Its one-sided spectrum over position is C f^-slope, f in cycles per unit of u, from
    1/longest to 1/shortest; C makes the power between them 1. It is a sum of octaves,
    each a quadratic B-spline over random lattice values, which Philox computes from
    seed, octave and lattice number, at any position and in any order. So the surface
    has no period and needs no table; it ends after 2^50 of the finest cells (4e9 m),
    and is constant beyond. The sum is within 0.05 dB of the law for slope 1, 0.1 dB for
    2, 0.25 dB for 3 and 0.35 dB for 4.

    y[n] is the mean over u[n-1] .. u[n], and depends on these two positions only. An
    octave of which a sample passes 2 to 4 cells is faded out, as it would only appear
    as white noise, and its noise power is added to the next octave. So at a constant
    speed the spectrum is that of the law times sinc(f du)^2, within 0.5 dB, up to 0.35
    cycles per sample. The mean lies half a sample back.

    Parameters
    ----------
    u : Block
        Position, usually in m.
    slope : float
        0.5 to 4; 1 is pink, 2 that of a random walk.
    seed : int
        Name of the surface, 0 to 2^64 - 1.  Not the run's seed: a surface stays what it
        is in every run, and two fingers over one seed touch one surface.
    shortest, longest : float
        Wavelengths between which the law holds, in the unit of u; outside, the spectrum
        falls and levels off.
    contact : Block
        Where it is not above 0 the output is 0; at re-contact the first sample is the
        value at its place.

    Returns
    -------
    Block
        Without unit, of variance 1 (a little more, with what lies outside the two
        wavelengths).

    Raises
    ------
    BadValue
        A slope or seed out of range; wavelengths not above 0, or the longest not above
        the shortest or 1e9 times it.

    References
    ----------
    Salmon, Moraes, Dror and Shaw 2011 (Philox); Perlin, "An image synthesizer",
    SIGGRAPH 1985 (octaves of lattice noise); Unser 1999 (B-splines); for spectra of
    rough surfaces: Persson et al., J. Phys.: Condens. Matter 17, R1, 2005.

    Examples
    --------
    There and back again, over two ways:

    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import spatial_noise
    >>> proc = stimlib.compile(
    ...     stimlib.Scene(
    ...         {"y": spatial_noise(stimlib.Input("x", "m"), slope=1.0, seed=4)}
    ...     ),
    ...     fs=8000,
    ... )
    >>> y = proc.process(np.array([[0.01, 0.02, 0.02, 0.03, 0.02, 0.02]]))[0]
    >>> bool(y[2] == y[5] != 0)
    True
    """
    return SpatialNoise(as_block(u), as_block(contact), slope, seed, shortest, longest)


# Gratings -----------------------------------------------------------------------------
PI = math.pi


def sine_of_turns(t):
    """Return sin(2 pi t), t in turns."""
    x = 2.0 * (t - floor(t + 0.5))
    return sinpi(where(x > 0.5, 1.0 - x, where(x < -0.5, -1.0 - x, x)))


def sinc(d):
    """Return sin(pi d)/(pi d) for d >= 0.

    It is the factor by which averaging over d periods reduces a sinusoid.
    """
    near = where(d < 1.0, d, 1.0)
    return where(d < 1.0, 1.0 - gap(near), sine_of_turns(0.5 * d) / (PI * where(d < 1.0, 1.0, d)))


# Parameters of `Grating` at a sample rate.
#   per    periods in a unit of length
#   start  phase in turns
GratingParams = namedtuple("GratingParams", "depth per start")


@dataclass(frozen=True, eq=False)
class Grating(Over):
    """Sinusoids over position, averaged over each movement.

    sum of depth sin(2 pi m/wavelength + phase) sinc(d/wavelength), where m is the
    middle of a movement and d its length.
    """

    u: Block
    contact: Block
    parts: np.ndarray
    depth_unit: str

    def check(self):
        v = self.parts
        if v.ndim != 2 or v.shape[1] != 3 or not len(v):
            raise BadValue(
                "grating: parts must be rows of three, [(wavelength, depth, phase), ..]; got shape"
                f" {v.shape}"
            )
        limits.check("table_knots", len(v), "grating: parts")
        if not (v[:, 0] > 0).all():
            at = int(np.argmin(v[:, 0] > 0))
            raise BadValue(f"grating: wavelength = {v[at, 0]:g} of part {at} must be above 0")

    def units(self, *u):
        return unit(self.depth_unit)

    def design(self, fs):
        wavelength, depth, phase = self.parts.T
        with np.errstate(over="ignore"):
            p = GratingParams(depth.copy(), 1 / wavelength, phase / (2 * PI))
        if not np.isfinite(p.per).all():
            raise BadValue(
                f"grating: wavelength = {wavelength.min():g} is too short to compute with; check"
                " the unit"
            )
        return p, PlaceState(0.0, 1.0)

    @staticmethod
    def step(p, s, u):
        before = where(s.cold > 0.0, u, s.last)
        middle, way, y = 0.5 * (before + u), abs(u - before), u - u
        for i in range(p.depth.size):
            y = y + p.depth[i] * sine_of_turns(middle * p.per[i] + p.start[i]) * sinc(
                way * p.per[i]
            )
        return y, PlaceState(u, 0.0)


@public
def grating(u: Block | float, parts, unit: str = "", contact: Block | float = 1.0) -> Block:
    """Make a grating: a sum of sinusoids over position.

    The sum is of depth sin(2 pi u/wavelength + phase).

    Each sample is the exact mean over u[n-1] .. u[n]: the sinusoid in the middle of the
    movement, times sin(pi d)/(pi d), d = |u[n] - u[n-1]|/wavelength. So ribs that pass
    faster than half the sample rate alias to lower frequencies, but more weakly, and
    vanish where exactly one passes per sample. Over a closed path a force along u does
    no work. The mean lies half a sample back.

    Parameters
    ----------
    u : Block
        Position, usually in m.
    parts : array_like, shape (n, 3)
        Rows (wavelength, depth, phase): in the unit of u, above 0; from the middle to
        the top, in ``unit`` (a measured groove is twice as deep); at u = 0, in rad.
    unit : str
        Of the depths.
    contact : Block
        Where it is not above 0 the output is 0; at re-contact the first sample is the
        value at its place.

    Returns
    -------
    Block
        In ``unit``.

    Raises
    ------
    BadValue
        Rows that are not three finite numbers, a wavelength not above 0, more rows than
        ``stimlib.limits`` allow.

    References
    ----------
    The mean of a sinusoid over an interval, in closed form; for gratings as stimuli:
    Wiertlewski, Lozada and Hayward, "The spatial spectrum of tangential skin
    displacement can encode tactual texture", IEEE Trans. Robotics 27, 2011.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import grating
    >>> ribs = grating(
    ...     stimlib.Input("x", "m"),
    ...     [(2e-3, 0.2, 0.0), (0.5e-3, 0.05, np.pi / 2)],
    ...     unit="N",
    ... )
    >>> proc = stimlib.compile(stimlib.Scene({"force": ribs}), fs=8000)
    >>> proc.process(np.array([[0.0, 0.0, 0.5e-3, 0.5e-3]])).round(4)
    array([[0.05  , 0.05  , 0.1273, 0.25  ]])
    """
    return Grating(as_block(u), as_block(contact), parts, unit)


# Position equalisation --------------------------------------------------------------
# Equal displacement everywhere on a surface that vibrates more in its middle than at
# its edges.
HEADROOM = ("clip", "scale")


@dataclass(frozen=True, eq=False)
class Midpoint(Over):
    """The mean of this and the last sample; at the first sample, x itself."""

    x: Block
    contact: Block

    def design(self, fs):
        return (), PlaceState(0.0, 1.0)

    @staticmethod
    def step(p, s, x):
        return where(s.cold > 0.0, x, 0.5 * (s.last + x)), PlaceState(x, 0.0)


def read_profile(path: str | os.PathLike) -> tuple[list[float], list[float]]:
    """Read positions and displacements from two columns of a CSV file.

    A heading and lines that start with # are skipped.

    Raises
    ------
    BadValue
        No file that can be read, or a larger one than ``stimlib.limits`` allow; a line
        that is not two numbers; fewer than two lines of numbers.
    """
    file = os.fspath(path)
    rows: list[tuple[float, float]] = []
    try:
        lines = safe_files.read(file, "sidecar_bytes", BadValue).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as e:
        raise BadValue(f"equalize: cannot read {file}: {e}") from None
    heading = False
    for number, line in enumerate(lines, 1):
        row = line.split(",")
        if not line.strip() or row[0].lstrip().startswith("#"):
            continue
        try:
            position, displacement = (float(word.strip().strip('"')) for word in row)
        except ValueError:
            if rows or heading:
                raise BadValue(
                    f"{file}, line {number}: expected position,displacement, got {line[:80]!r}"
                ) from None
            heading = True
            continue
        rows.append((position, displacement))
        limits.check("table_knots", len(rows), f"{file}: rows")
    if len(rows) < 2:
        raise BadValue(f"{file}: {len(rows)} rows of position,displacement; give at least 2")
    return [r[0] for r in rows], [r[1] for r in rows]


def points(displacement) -> tuple[np.ndarray, np.ndarray]:
    """Return the knots and displacements of a profile, after checking them."""
    if isinstance(displacement, (str, os.PathLike)):
        displacement = read_profile(displacement)
    if not isinstance(displacement, (Sequence, np.ndarray)) or len(displacement) != 2:
        raise BadValue(
            "equalize: displacement must be (knots, displacement), or the path of a CSV file with"
            " these columns"
        )
    try:
        knots, d = (np.array(v, np.float64) for v in displacement)
    except (TypeError, ValueError):
        raise BadValue(
            "equalize: displacement must be two rows of numbers, (knots, displacement)"
        ) from None
    limits.check("table_knots", knots.size, "equalize: knots")
    if knots.ndim != 1 or knots.shape != d.shape or knots.size < 2:
        raise BadValue(
            f"equalize: need as many displacements as knots, at least 2; got {knots.shape} and"
            f" {d.shape}"
        )
    for name, v in (("knot", knots), ("displacement", d)):
        if not np.isfinite(v).all():
            raise BadValue(f"equalize: {name} {int(np.argmin(np.isfinite(v)))} is not finite")
    if not (np.diff(knots) > 0).all():
        raise BadValue(
            f"equalize: knots must rise; knot {int(np.argmin(np.diff(knots) > 0)) + 1} does not"
        )
    if not (d > 0).all():
        at = int(np.argmin(d > 0))
        raise BadValue(
            f"equalize: displacement {at} = {d[at]:g} must be above 0: no voltage moves a node of"
            " the mode"
        )
    return knots, d


def smallest(table, knots: np.ndarray) -> float:
    """Return the smallest value of a table between its knots.

    It is computed with the table's own step at 65 positions of each piece.
    """
    p, _ = table.design(1.0)
    places = np.concatenate(
        [np.linspace(a, b, 65) for a, b in zip(knots[:-1], knots[1:], strict=True)]
    )
    return float(min(table.step(p, (), x)[0] for x in places))


@public
def equalize(
    x: Block | float,
    displacement,
    limit: Block | float | None = None,
    headroom: str = "clip",
    *,
    signal: Block | float = 1.0,
    peak: Block | float | None = None,
    contact: Block | float = 1.0,
    kind: str | Callable | None = None,
    outside: str = "hold",
) -> Block:
    """Scale a voltage so that all positions of a plate have the same displacement.

    y = signal d_max/d(x): the measured displacements are interpolated and the result is
    inverted (interpolating the gains instead is an order of magnitude worse), in the
    middle between x[n-1] and x[n], where an area-sampled envelope lies. With five
    points of a clamped beam's mode, 1.84 times higher in the middle, the amplitude is
    constant to 0.04 % with a polynomial, 0.4 % with a cubic spline, 1.8 % with pchip,
    and 3.3 % with straight lines.

    Parameters
    ----------
    x : Block
        Position, usually in m.
    displacement : (knots, displacement) or path
        Two rows of one length, positions in the unit of x, rising, and displacement
        amplitudes at equal voltage, above 0, in any unit; or the path of a CSV file
        with these two columns, which is read now.
    limit : float or Block, optional
        Largest absolute value of the result, in the unit of ``signal``: what the
        amplifier can give.
    headroom : {"clip", "scale"}
        What happens where the limit is passed.  "clip": the samples beyond it are held
        there; count them in a recording, ``np.sum(np.abs(y) >= limit)``, a block cannot
        know.  "scale": the whole stimulus is reduced by min(1, limit/(peak largest
        gain)), everywhere and all the time, so that it is never passed.
    signal : float or Block
        What is equalised.  Default 1: the result is the gain.
    peak : float or Block, optional
        Largest absolute value of ``signal``, live or not; needed for "scale" unless the
        signal is a number.
    contact : Block
        At re-contact x[n-1] = x[n].
    kind : {"linear", "pchip", "cubic", "polynomial"} or callable, optional
        Interpolation; default: one polynomial for up to 6 knots, a cubic spline beyond.
        A function makes a finer table out of knots and displacements, which a cubic
        spline interpolates: ``stimlib.plate.mode_fit`` fits the shape of a plate's
        mode.
    outside : {"hold", "zero", "error"}
        Beyond the first and last knot: their gain; silence; or a fault.

    Returns
    -------
    Block
        In the unit of ``signal``.

    Raises
    ------
    BadValue
        A profile that is not finite, not rising, not above 0 at a knot or between them;
        a file that cannot be read; a limit not above 0; an unknown policy; "scale"
        without a limit or a peak.
    UnitError
        A limit or peak in another unit than the signal.

    References
    ----------
    The touch-screen thesis, section 4.2 and figure 4.2: "we increase all the
    displacements along the horizontal axis to the max value".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import equalize
    >>> profile = [0.0, 0.05, 0.1], [100e-6, 120e-6, 100e-6]
    >>> gain = equalize(stimlib.Input("x", "m"), profile, limit=1.1)
    >>> proc = stimlib.compile(stimlib.Scene({"gain": gain}), fs=8000)
    >>> proc.process(np.array([[0.05, 0.05, 0.0, 0.0]])).round(3)
    array([[1.   , 1.   , 1.043, 1.1  ]])
    """
    knots, d = points(displacement)
    one_of("equalize: outside", outside, OUTSIDE)
    if callable(kind):
        knots, d = points(kind(knots, d))
        kind = "cubic"
    elif kind not in (None, *KINDS):
        raise BadValue(
            f"equalize: kind = {kind!r}; choose one of {', '.join(KINDS)}, or a function, such as"
            " stimlib.plate.mode_fit(model)"
        )
    kind = kind or ("polynomial" if knots.size <= 6 else "cubic")
    x, y, contact = as_block(x), as_block(signal), as_block(contact)
    middle = Midpoint(x, contact)
    table = lut(middle, knots, d, kind, "error" if outside == "error" else "hold")
    lowest = smallest(table, knots)
    if not lowest > 0:
        raise BadValue(
            f"equalize: between its knots the {kind} displacement falls to {lowest:g}; measure more"
            " points"
        )
    if isinstance(y, Const) and peak is None:
        peak = Const(abs(y.value), y.unit)
    y = y * (float(d.max()) / table)
    if outside == "zero":
        low, high = (
            Const(float(v), "" if str(x.dim) == "1" else str(x.dim)) for v in knots[[0, -1]]
        )
        y = y * (middle >= low) * (middle <= high)
    if limit is not None:
        return within(
            y,
            limit,
            headroom,
            None if peak is None else with_unit(peak, str(y.dim)) * (float(d.max()) / lowest),
        )
    if headroom != "clip":
        raise BadValue(
            f"equalize: headroom = {headroom!r} needs a limit"
            if headroom in HEADROOM
            else f"equalize: headroom = {headroom!r}; choose one of {', '.join(HEADROOM)}"
        )
    return y


def within(y: Block, limit, headroom: str, peak=None) -> Block:
    """Return y limited to -limit .. limit.

    It is clipped, or first scaled by limit/peak where the peak is larger.
    """
    one_of("headroom", headroom, HEADROOM)
    top = with_unit(limit, str(y.dim))
    if isinstance(top, Const) and not top.value > 0:
        raise BadValue(f"limit = {top.value:g} must be above 0")
    if headroom == "scale":
        if peak is None:
            raise BadValue("headroom='scale' needs the largest absolute value of the signal, peak=")
        y = y * (top / maximum(top, peak))
    return clip(y, -top, top)
