"""Resonances: state-variable filters and the modes of a plate."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass
from fractions import Fraction
from math import pi, tan

import numpy as np
from numpy.polynomial import legendre

from ..core import units as un
from ..core.graph import Block, Const, as_block, below_half, in_unit, scratch
from ..core.maths import TINY, each, floor, flush, fma, where
from ..core.parameter import Param
from ..core.pointwise import clip
from ..core.response import backward
from ..design.filters import Quadratic, sections
from ..errors import Above0, BadValue, one_of, public
from .equalization import within
from .filters import Cascade, CascadeParams, CascadeState, cascade
from .impedance import with_unit
from .movement import regular, sinpi
from .onset import begun

# Resonances of one section ----------------------------------------------------------
# Resonances of one section: fixed ones, and one whose frequency and quality are
# signals.
U = np.uint64

MODES = {"lowpass": (0, 0, 1), "bandpass": (0, 1, 0), "highpass": (1, 0, 0), "notch": (1, 0, 1)}
"""What passes, as factors of s^2, s b and g^2."""


def section(g: float, b: float, mode: str) -> CascadeParams:
    """Return the parameters of a section with the denominator s^2 + s b + g^2.

    s = (z - 1)/(z + 1).
    """
    bottom = Fraction(1), Fraction(b), Fraction(g) ** 2
    top = [m * v for m, v in zip(MODES[mode], bottom, strict=True)]
    return cascade(sections([(top, bottom)]), 0.0)[0]


@dataclass(frozen=True, eq=False)
class Resonator(Cascade):
    """A second-order resonator with an exact -3 dB bandwidth of freq/q.

    It is ``section`` with g = tan(pi freq/fs) and b = (1 + g^2) tan(pi freq/(q fs)). So
    the two frequencies at which its gain is -3 dB are exactly freq/q apart.
    """

    x: Block
    freq: Above0
    q: Above0
    notched: bool
    live = "svf(x, cutoff, q, mode) has a frequency and a quality that move"

    def design(self, fs):
        name = "notch" if self.notched else "resonator"
        r, w = below_half(name, fs, freq=self.freq, width=self.freq / self.q)
        g = tan(pi * r)
        p = section(g, (1 + g * g) * tan(pi * w), "notch" if self.notched else "bandpass")
        return p._replace(at=0.0 if self.notched else r), CascadeState(*np.zeros((4, 1)))


@public
def resonator(x: Block | float, freq: float, q: float, onset: str = "step") -> Block:
    """Pass a band around a frequency, with gain 1 there: a mode that rings.

    Parameters
    ----------
    x : Block
    freq : float
        Hz.
    q : float
        Quality: freq over the width, the distance of the two frequencies where the gain
        is -3 dB.  The width is exact at every sample rate; it must be below fs/2.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        freq or q not above 0; at compile time, freq or the width freq/q not below fs/2.

    See Also
    --------
    svf : a resonance whose frequency and quality move.
    mode : rings for exactly q/(pi freq) seconds at every sample rate.

    Notes
    -----
    With W = pi freq/(q fs), the response is 1/(1 + i X), X = (cos w0 - cos w)/(sin w
    tan W), w = 2 pi f/fs.

    It rings with a time constant of 1/(fs artanh(tan W)) seconds.  That is q/(pi freq),
    less a part of 2 W^2/3 where W is small: 6e-6 of it for 158 Hz, q = 20 at 8 kHz, and
    1 % where the width is fs/26.  No filter of this form has both the width and the
    ring of the analogue one: a wide resonance near fs/2 rings shorter, and from a width
    of fs/4 on not at all.

    References
    ----------
    Orfanidis, "Introduction to Signal Processing" (1996), section 11.3: peaking and
    notch filters of a given width.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import resonator
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": resonator(stimlib.Input("x"), 158, q=20)}), fs=8000
    ... )
    >>> abs(proc.response("y", "x", np.array([79.0, 158, 162]))).round(3)
    array([0.033, 1.   , 0.707])
    """
    return begun("resonator", x, onset, lambda u: Resonator(u, freq, q, False))


@public
def notch(x: Block | float, freq: float, q: float, onset: str = "step") -> Block:
    """Remove one frequency, such as mains hum.

    Parameters
    ----------
    x : Block
    freq : float
        What is taken away, in Hz.
    q : float
        freq over the width, the distance of the two frequencies where the gain is -3
        dB.  The width is exact at every sample rate; it must be below fs/2.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        freq or q not above 0; at compile time, freq or the width freq/q not below fs/2.

    See Also
    --------
    resonator : what a notch takes away; its notes give response and ring.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import notch
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": notch(stimlib.Input("x"), 50, q=10)}), fs=8000
    ... )
    >>> abs(proc.response("y", "x", np.array([5.0, 50, 500]))).round(3)
    array([1., 0., 1.])
    """
    return begun("notch", x, onset, lambda u: Resonator(u, freq, q, True), lambda y: 1.0)


# Parameters of `Svf` at a sample rate.
#   per   1/fs
#   high  what passes
SvfParams = namedtuple("SvfParams", "per high band low")

# State of `Svf` between samples.
SvfState = namedtuple("SvfState", "s1 s2")


LEAST = 1e-3
"""Smallest quality of a signal."""


# Coefficients for a cutoff and a quality: half of each state's change, and 1/q.
#   wrong  0, or nan
Turn = namedtuple("Turn", "a c d k wrong")


def turn(p, cutoff, q):
    """Return the coefficients at one sample."""
    r = cutoff * p.per
    r = where(r > 0.0, where(r < 0.5, r, 0.5), 0.0)
    k = 1.0 / where(q > LEAST, q, LEAST)
    si, co = sinpi(r), sinpi(0.5 - r)
    sd = si / fma(k * si, co, 1.0)
    return Turn(sd * co, sd * fma(k, co, si), sd * si, k, (cutoff + q) - (cutoff + q))


def turned(p, t, s, x):
    """Return the output at one sample, and the new state."""
    h = x - s.s2
    low = s.s2 + fma(t.d, h, t.a * s.s1)
    band = s.s1 + fma(t.a, h, -t.c * s.s1)
    high = fma(-t.k, band, x - low)
    y = flush(fma(p.high, high, fma(p.band * t.k, band, p.low * low)))
    s1 = s.s1 + fma(2.0 * t.a, h, fma(-2.0 * t.c, s.s1, TINY))
    s2 = s.s2 + fma(2.0 * t.d, h, 2.0 * t.a * s.s1)
    return where(t.wrong == 0.0, y, t.wrong), SvfState(s1, s2)


@dataclass(frozen=True, eq=False)
class Svf(Block):
    """A two-pole filter whose cutoff and quality may change at every sample.

    It is ``section`` with g = tan(pi cutoff/fs) = s/c and b = k g of each sample, where
    k = 1/q and D = c^2 (1 + k g + g^2) = 1 + k s c:

    h = x - s2;  band = s1 + (s c h - s (s + k c) s1)/D;
    low = s2 + (s^2 h + s c s1)/D;  high = x - k band - low;
    s1 -> 2 band - s1;  s2 -> 2 low - s2.
    """

    x: Block
    cutoff: Block
    q: Block
    mode: str
    rated = "svf: cutoff"

    def check(self):
        one_of("svf: mode", self.mode, MODES)
        for name, v in (("cutoff", self.cutoff), ("q", self.q)):
            if isinstance(v, (Const, Param)) and not v.value > 0:
                raise BadValue(f"svf: {name} = {v.value!r} must be above 0")

    def units(self, *u):
        in_unit("svf: cutoff", self.cutoff, u[1], "Hz")
        in_unit("svf: q", self.q, u[2], "")
        return u[0]

    def design(self, fs):
        return SvfParams(1 / fs, *map(float, MODES[self.mode])), SvfState(0.0, 0.0)

    def through(self, p, fs, z, H, value):
        cutoff, q = value[1:]
        if H[0] is None or cutoff is None or q is None or not (0 < cutoff < fs / 2 and q > 0):
            return None
        g = tan(pi * cutoff / fs)
        return Cascade.transfer(section(g, g / max(q, LEAST), self.mode), z) * H[0]

    @staticmethod
    def step(p, s, x, cutoff, q):
        return turned(p, turn(p, cutoff, q), s, x)

    @staticmethod
    def tile(p, s, x, cutoff, q, y):
        t = turn(p, cutoff[0], q[0])
        moves = regular(cutoff) < U(y.size) or regular(q) < U(y.size)
        for i in range(y.size):
            if moves:
                t = turn(p, cutoff[i], q[i])
            y[i], s = turned(p, t, s, x[i])
        return s


@public
def svf(
    x: Block | float,
    cutoff: Block | float,
    q: Block | float = 0.5**0.5,
    mode: str = "lowpass",
    onset: str = "step",
) -> Block:
    """Filter with two poles whose frequency and quality may change at every sample.

    Changes make no click.

    The filter cannot become unstable: without input, s1^2 + s2^2 never grows, however
    cutoff and q change. See the notes.

    Parameters
    ----------
    x : Block
    cutoff : float or Block
        Hz; a signal is held in 0 .. fs/2.
    q : float or Block
        Quality; 0.707 is Butterworth's filter.  It is held at 0.001 and above.
        It promises no width: see the notes.
    mode : {"lowpass", "bandpass", "highpass", "notch"}
        What passes; the gain at the cutoff is q, 1, q and 0.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        An unknown mode; a number or parameter not above 0; at compile time, a cutoff
        not below fs/2.
    UnitError
        A cutoff that is not in Hz, or a q with a unit.

    Notes
    -----
    The response is that of the analogue filter at i tan(pi f/fs)/tan(pi cutoff/fs).  So
    the cutoff is where it should be, and widths shrink towards fs/2: of a quality q, 5
    % below cutoff/q for 700 Hz at 8 kHz, 36 % for 250 Hz at 1 kHz, 77 % for 400 Hz at 1
    kHz.  ``resonator`` and ``notch`` keep their width.

    One sample is Cayley's step of s' = M s with M = ((-k, -1), (1, 0)) g.  From s' . s
    = -k g s1^2 <= 0 follows that the new state is at most as long as the old one, for
    every g and every k >= 0.  The coefficients of other forms of the filter are states
    of another filter as soon as the cutoff moves, and energy comes out of that change.

    References
    ----------
    Zavalishin, "The Art of VA Filter Design" (2012), chapter 4; sines in place of the
    tangent, so fs/2 is no pole.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import svf
    >>> sweep = svf(stimlib.Input("x"), stimlib.Input("f", "Hz"), q=5)
    >>> proc = stimlib.compile(stimlib.Scene({"y": sweep}), fs=8000)
    >>> proc.process(np.array([[1.0, 1.0, 1.0], [0.0, 500.0, 2000.0]])).round(3)
    array([[0.   , 0.037, 0.662]])
    """
    f, q = with_unit(cutoff, "Hz"), as_block(q)
    return begun("svf", x, onset, lambda u: Svf(u, f, q, mode), lambda y: float(MODES[mode][2]))


# Plates -----------------------------------------------------------------------------
# Surfaces that vibrate in modes: one mode, its shape over the places of a finger, and a
# drive that makes it answer faster.
INT = np.int64
CELLS = 256.0  # pieces of a shape along each axis


# Parameters of `Mode` at a sample rate.
#   r    c - s/q
#   lag  of q behind a slope of x
#   m    1 - c
ModeParams = namedtuple("ModeParams", "c s r lag rise m")

# State of `Mode` between samples.
#   e  q - x
#   v  q'/w0
ModeState = namedtuple("ModeState", "e v last")


@dataclass(frozen=True, eq=False)
class Mode(Block):
    """A mass on a spring, q'' + (w0/Q) q' + w0^2 q = w0^2 x.

    It is exact for an x that is linear between samples. With a = w0/fs, b = 1/(2 Q),
    e = q - x, dx = x[n] - x[n-1]:

    e[n] = c e + s v - (s + 2 b (1 - c))/a dx;
    v[n] = -s e + (c - 2 b s) v + (1 - c)/a dx;
    s = exp(-a b) sin(a h)/h, c = exp(-a b) cos(a h) + b s, h^2 = 1 - b^2.
    """

    x: Block
    freq: Above0
    q: float

    def check(self):
        if not self.q > 0.5:
            raise BadValue(
                f"mode: q = {self.q:g} must be above 0.5: below that it does not ring; take two"
                " first_order"
            )

    def design(self, fs):
        (r,) = below_half("mode", fs, freq=self.freq)
        a, b = 2 * math.pi * r, 0.5 / self.q
        h = math.sqrt(1 - b * b)
        s = math.exp(-a * b) * math.sin(a * h) / h
        # 1 - c, with its digits
        m = 2 * math.sin(a * h / 2) ** 2 - math.expm1(-a * b) * math.cos(a * h) - b * s
        return ModeParams(1 - m, s, 1 - m - 2 * b * s, (s + 2 * b * m) / a, m / a, m), ModeState(
            0.0, 0.0, 0.0
        )

    @staticmethod
    def step(p, s, x):
        dx = x - s.last
        e = fma(p.c, s.e, fma(p.s, s.v, fma(-p.lag, dx, TINY)))
        v = fma(-p.s, s.e, fma(p.r, s.v, p.rise * dx))
        return flush(x + e), ModeState(e, v, x)

    @staticmethod
    def transfer(p, z):
        d = backward(z)
        one, other = d + p.m / z, d + (1 - p.r) / z
        return 1 + d * (p.s * p.rise / z - p.lag * other) / (one * other + (p.s / z) ** 2)

    def delay(self, p):
        """Return the group delay at 0 Hz, 2 b/a."""
        return (p.c - p.r) / p.s * p.rise / p.m


@public
def mode(x: Block | float, freq: float, q: float, onset: str = "step") -> Block:
    """Compute the motion of one mode of a vibrating body, a mass on a spring.

    Its gain is 1 at 0 Hz and q at the resonance.

    Like ``first_order``, it is exact at every sample rate for an x that is linear
    between samples.

    Parameters
    ----------
    x : Block
    freq : float
        Natural frequency in Hz.
    q : float
        Quality, above 0.5: the gain at the resonance.  It rings with a time constant of
        q/(pi freq) seconds.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        freq not above 0, q not above 0.5; at compile time, freq not below fs/2.

    See Also
    --------
    svf : a mode whose frequency and quality move, by the trapezoidal rule.
    stimlib.plate.plate : all modes of a plate under a finger.

    References
    ----------
    Franklin, Powell and Workman, "Digital Control of Dynamic Systems" (1998), section
    6.3: the triangle-hold equivalent.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import mode
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": mode(stimlib.Input("x"), 158, q=10)}), fs=8000
    ... )
    >>> abs(proc.response("y", "x", np.array([0.0, 79.0, 158.0, 316.0]))).round(3)
    array([1.   , 1.33 , 9.987, 0.331])
    """
    return begun("mode", x, onset, lambda u: Mode(u, freq, q), lambda y: 1.0)


# Dimensions of the grid of pieces in which a mode shape is stored.
#   along  pieces for each metre
Grid = namedtuple("Grid", "length width along across")

# Parameters of `Shape` at a sample rate.
#   c  of each piece, 16 factors: powers of x and of y, highest first
ShapeParams = namedtuple("ShapeParams", "length width along across c")

# Coefficients of one bicubic piece of a mode shape.
#   c    x^3 y^3
#   g    x^2 y^3
#   t    1
#   row  number of the piece along x
Piece = namedtuple("Piece", "c d e f g h i j k s m n o q r t row column")


def in_pieces(v, size, per):
    """Return a position in units of pieces, limited to the plate; NaN stays NaN."""
    return where(v <= 0.0, 0.0, where(v >= size, size, v)) * per


def along(p, x):
    """Return a position along x, in pieces from the corner."""
    return in_pieces(x, p.length, p.along)


def across(p, y):
    """Return a position along y, in pieces from the corner."""
    return in_pieces(y, p.width, p.across)


def number(a):
    """Return the number of the piece at a position; the last piece includes its end."""
    return floor(where(a < CELLS, a, CELLS - 1.0))


def cell(p, a, b):
    """Return the number of the piece that contains a position given in pieces."""
    return number(a) * CELLS + number(b)


def bicubic(p, a, b):
    """Return the value of a piece at a position given in pieces."""
    a, b = a - p.row, b - p.column
    one, two = (
        fma(fma(fma(p.c, b, p.d), b, p.e), b, p.f),
        fma(fma(fma(p.g, b, p.h), b, p.i), b, p.j),
    )
    three, four = (
        fma(fma(fma(p.k, b, p.s), b, p.m), b, p.n),
        fma(fma(fma(p.o, b, p.q), b, p.r), b, p.t),
    )
    return fma(fma(fma(one, a, two), a, three), a, four)


def piece(c, cell):
    """Return the coefficients of a piece."""
    k, row = INT(cell) * 16, floor(cell / CELLS)
    return Piece(
        c[k], c[k + 1], c[k + 2], c[k + 3], c[k + 4], c[k + 5], c[k + 6], c[k + 7],
        c[k + 8], c[k + 9], c[k + 10], c[k + 11], c[k + 12], c[k + 13], c[k + 14], c[k + 15],
        row, cell - row * CELLS,
    )  # fmt: skip


def pieces(terms: int) -> np.ndarray:
    """Return cubic pieces that match values and slopes of Legendre polynomials.

    They match at the ends of equal pieces; shape (CELLS, 4, terms).
    """
    knots = np.linspace(-1, 1, int(CELLS) + 1)
    f = legendre.legvander(knots, terms - 1)
    g = legendre.legval(knots, legendre.legder(np.eye(terms))).T * (2 / CELLS)
    rise, g0, g1 = np.diff(f, axis=0), g[:-1], g[1:]
    return np.stack([g0 + g1 - 2 * rise, 3 * rise - 2 * g0 - g1, g0, f[:-1]], axis=1)


@dataclass(frozen=True, eq=False)
class Shape(Block):
    """A mode shape, sum_ij c_ij P_i(2 x/length - 1) P_j(2 y/width - 1).

    It is stored as pieces that are cubic in x and in y.

    Beyond an edge it keeps the value at the edge.
    """

    x: Block
    y: Block
    c: np.ndarray
    length: Above0
    width: Above0

    def check(self):
        if self.c.ndim != 2 or not 0 < min(self.c.shape) <= max(self.c.shape) <= 64:
            raise BadValue(
                f"mode_shape: c must be a matrix of 1 to 64 x 64 numbers, got shape {self.c.shape}"
            )

    def units(self, *u):
        in_unit("mode_shape: x", self.x, u[0], "m")
        in_unit("mode_shape: y", self.y, u[1], "m")
        return un.ONE

    def design(self, fs):
        u, v = (pieces(n).reshape(-1, n) for n in self.c.shape)
        c = (u @ self.c @ v.T).reshape(int(CELLS), 4, int(CELLS), 4).transpose(0, 2, 1, 3)
        return (
            ShapeParams(
                self.length, self.width, CELLS / self.length, CELLS / self.width, c.ravel()
            ),
            (),
        )

    @staticmethod
    def step(p, s, x, y):
        a, b = along(p, x), across(p, y)
        return bicubic(piece(p.c, cell((), a, b)), a, b), s

    work = scratch(192)

    @staticmethod
    def tile(p, s, x, y, phi, w):
        """Compute a tile, loading the coefficients of a piece only when it changes.

        A finger stays on one piece for many samples.
        """
        n = phi.size
        cells, a, b = w[:n], w[64 : 64 + n], w[128 : 128 + n]
        grid = Grid(p.length, p.width, p.along, p.across)
        each(along, grid, (x,), a)
        each(across, grid, (y,), b)
        each(cell, (), (a, b), cells)
        each(bicubic, piece(p.c, cells[0]), (a, b), phi)
        here = cells[0]
        for i in range(1, n):
            if cells[i] != here:
                here = cells[i]
                each(bicubic, piece(p.c, here), (a[i:n], b[i:n]), phi[i:n])
        return s


@public
def mode_shape(x: Block | float, y: Block | float, c, length: float, width: float) -> Block:
    """Compute a plate's mode shape at a position: how strongly a mode is felt there.

    The mode shape is a function of x and y on a rectangle, given by a Legendre series.

    Parameters
    ----------
    x, y : Block
        Place in m, from the rectangle's corner.  Beyond its edges the value there is
        held.
    c : array_like, shape (m, n)
        Factors of P_i(2 x/length - 1) P_j(2 y/width - 1).
    length, width : float
        Of the rectangle, in m.

    Returns
    -------
    Block
        Without unit.

    Raises
    ------
    BadValue
        Not a matrix; sizes not above 0.
    UnitError
        A place that is not in m.

    Notes
    -----
    It is computed by 256 x 256 pieces with the right values, slopes and twists at their
    corners.  Of a wave of k rad along the rectangle that is within (k/256)^4/384: 3e-10
    for a clamped plate's first mode.  Where the edges give, a shape bends within
    millimetres of them: there it is 7e-9 of the largest for the glass plate of the
    scene ``touch_screen`` (12 terms).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import mode_shape
    >>> x, y = stimlib.Input("x", "m"), stimlib.Input("y", "m")
    >>> scene = stimlib.Scene(
    ...     {"phi": mode_shape(x, y, [[0.0], [1.0]], 0.2, 0.1)}
    ... )  # from -1 to 1 along x
    >>> stimlib.compile(scene, fs=8000).process(
    ...     np.array([[0.0, 0.05, 0.2], [0.05, 0.05, 0.05]])
    ... )
    array([[-1. , -0.5,  1. ]])
    """
    return Shape(as_block(x), as_block(y), c, length, width)


def matched(r: float, q: float) -> Quadratic:
    """Return a quadratic in (z - 1)/(z + 1) with the exact discrete poles of a mode.

    The frequency r is in cycles per sample.
    """
    b = 0.5 / q
    root = np.tanh(math.pi * r * complex(-b, math.sqrt(1 - b * b)))
    return (
        Fraction(1),
        -2 * Fraction(root.real),
        Fraction(root.real) ** 2 + Fraction(root.imag) ** 2,
    )


@dataclass(frozen=True, eq=False)
class PoleSwap(Cascade):
    """A filter that replaces the poles of a mode by more strongly damped ones.

    k (s^2 + s w0/Q + w0^2)/(s^2 + s w0 gain/Q + w0^2), with k such that it is 1 at w0.
    """

    x: Block
    freq: Above0
    q: Above0
    gain: float

    def check(self):
        if not 1 <= self.gain < 2 * self.q:
            raise BadValue(
                f"pole_swap: gain = {self.gain:g} must be from 1, where nothing happens, to below 2"
                f" q = {2 * self.q:g}, where the mode would not ring at all"
            )

    def design(self, fs):
        (r,) = below_half("pole_swap", fs, freq=self.freq)
        top, bottom = matched(r, self.q), matched(r, self.q / self.gain)
        s = 1j * math.tan(math.pi * r)
        size = [abs(s * s + s * float(v[1]) + float(v[2])) for v in (bottom, top)]
        scale = Fraction(size[0] / size[1])
        return cascade(sections([([scale * v for v in top], bottom)]), r)


@public
def pole_swap(
    x: Block | float, freq: float, q: float, gain: float, v_max: float | Block | None = None
) -> Block:
    """Drive a resonance so that it responds ``gain`` times as fast.

    The filter cancels the poles of the mode and puts more strongly damped ones in their
    place.

    A mode of quality q follows an envelope up to its half bandwidth freq/(2 q): 7.9 Hz
    for 158 Hz and q = 10. Behind this filter it has the quality q/gain, and the same
    gain at its frequency. The price is voltage: fast changes are driven up to ``gain``
    times as hard. ``stimlib.plate.envelope_behind`` computes how much voltage a
    stimulus needs, and the resulting envelope.

    Parameters
    ----------
    x : Block
        The voltage for a slow stimulus.
    freq, q : float
        Of the mode; measure them, ``stimlib.plate.identify``: a carrier that is 1 % off
        loses what q/2 % of width can.
    gain : float
        From 1 to below 2 q.
    v_max : float or Block, optional
        The result is held within -v_max .. v_max, in the unit of x.  A signal below 0
        counts as 0.

    Returns
    -------
    Block
        In the unit of x; before the first sample x was 0.

    Raises
    ------
    BadValue
        freq or q not above 0; a gain outside its range; v_max not above 0; at compile
        time, freq not below fs/2.

    References
    ----------
    Zeros on lightly damped poles: Franklin, Powell and Emami-Naeini, "Feedback Control
    of Dynamic Systems" (2015): notch compensation.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import mode, pole_swap
    >>> v = stimlib.Input("v", "V")
    >>> scene = stimlib.Scene(
    ...     {
    ...         "before": mode(v, 158, 10),
    ...         "after": mode(pole_swap(v, 158, 10, gain=4), 158, 10),
    ...     }
    ... )
    >>> proc = stimlib.compile(scene, fs=8000)
    >>> f = np.array([138.0, 158.0, 178.0])  # side bands of 20 bumps/s
    >>> [
    ...     (abs(proc.response(name, "v", f)) / 10).round(2).tolist()
    ...     for name in ("before", "after")
    ... ]
    [[0.4, 1.0, 0.34], [0.95, 1.0, 0.76]]
    """
    return within(PoleSwap(as_block(x), freq, q, gain), v_max, name="v_max")


@public
def amplifier(
    x: Block | float, gain: float = 50.0, lowest: float = -100.0, highest: float = 400.0
) -> Block:
    """Compute the output of a voltage amplifier, clipped to the limits of the patches.

    Parameters
    ----------
    x : Block
        In V.
    gain : float
        Not 0.
    lowest, highest : float
        In V at its output; the default is the range of the touch-screen thesis'
        patches.  ``Plate.voltages`` is that of a plate.

    Returns
    -------
    Block
        In V.  Samples that were held: ``np.sum((y == lowest) | (y == highest))``.

    Raises
    ------
    BadValue
        lowest not below highest, or a gain of 0.
    UnitError
        A signal that is not in V.

    References
    ----------
    The touch-screen thesis, sections 2.2 and 4.2: a driver for these patches, set to
    50.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import amplifier
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"v": amplifier(stimlib.Input("x", "V"))}), fs=8000
    ... )
    >>> proc.process(np.array([[-4.0, 2.0, 9.0]]))
    array([[-100.,  100.,  400.]])
    """
    signal = with_unit(x, "V")
    in_unit("amplifier: x", signal, signal.dim, "V")
    if not (-math.inf < lowest < highest < math.inf and gain != 0):
        raise BadValue(
            f"amplifier: lowest = {lowest:g} V must be below highest = {highest:g} V, both be"
            " numbers, and gain not 0; Patch(lowest=, highest=) holds the limits of a plate's"
            " patches"
        )
    return clip(gain * signal, with_unit(lowest, "V"), with_unit(highest, "V"))
