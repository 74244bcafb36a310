"""Noise and gratings over place: the same whenever a finger comes there."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from ..core.graph import Block, as_block, scratch, unitless
from ..core.maths import as_float, each, floor, pairs, sqrt, where
from ..core.units import unit
from ..design.noise import octaves
from ..errors import Above0, BadValue, public
from ..system.limits import limits
from .movement import Over, PlaceState, averaged, sine_of_half_turns
from .noise import noise_key, pair_of_words

# Each sample is the mean over the movement. Only sums, products and square roots are
# used, no mathematical library, so that the bits are the same on every machine.
U, INT = np.uint64, np.int64

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
            p = GratingParams(depth.copy(), 1 / wavelength, phase / (2 * math.pi))
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
            y = y + p.depth[i] * sine_of_half_turns(
                2.0 * (middle * p.per[i] + p.start[i])
            ) * averaged(way * p.per[i])
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
