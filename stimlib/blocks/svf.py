"""Resonances of one section: fixed ones, and one whose frequency and quality are
signals.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import pi, tan
from typing import NamedTuple

import numpy as np

from ..core import units as un
from ..core.graph import Block, Const, Param, as_block, in_unit, positive
from ..core.maths import TINY, flush, fma, where
from ..design import responses
from ..design.sections import sections
from ..errors import BadValue, UnitError, public
from .bump import regular, sinpi
from .filters import Cascade, CascadeParams, CascadeState, below_half, cascade
from .impedance import with_unit
from .onset import begun

U = np.uint64

MODES = {"lowpass": (0, 0, 1), "bandpass": (0, 1, 0), "highpass": (1, 0, 0), "notch": (1, 0, 1)}
"""What passes, as factors of s^2, s b and g^2."""


def section(g: float, b: float, mode: str) -> CascadeParams:
    """Return the parameters of what passes over s^2 + s b + g^2, s = (z - 1)/(z +
    1).
    """
    bottom = Fraction(1), Fraction(b), Fraction(g) ** 2
    top = [m * v for m, v in zip(MODES[mode], bottom, strict=True)]
    return cascade(sections([(top, bottom)]), 0.0)[0]


@dataclass(frozen=True, eq=False)
class Resonator(Cascade):
    """One section with g = tan(pi freq/fs) and b = (1 + g^2) tan(pi freq/(q fs)): see
    ``section``.

    The two frequencies where its gain is -3 dB are then exactly freq/q apart.
    """

    x: Block
    freq: float
    q: float
    notched: bool
    live = "svf(x, cutoff, q, mode) has a frequency and a quality that move"

    def check(self):
        positive(self, "freq", "q")

    def design(self, fs):
        name = "notch" if self.notched else "resonator"
        r, w = below_half(name, fs, freq=self.freq, width=self.freq / self.q)
        g = tan(pi * r)
        p = section(g, (1 + g * g) * tan(pi * w), "notch" if self.notched else "bandpass")
        return p._replace(at=0.0 if self.notched else r), CascadeState(*np.zeros((4, 1)))

    def laws(self, fs):
        return (responses.resonance(self.freq, self.q, self.notched),)


@public
def resonator(x: Block | float, freq: float, q: float, onset: str = "step") -> Block:
    """Pass what is near a frequency, with gain 1 there: a mode that rings.

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
    less a part of 2 W^2/3 where W is small: 7e-6 of it for 158 Hz, q = 20 at 8 kHz, and
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
    """Take away one frequency, such as a hum.

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


class SvfParams(NamedTuple):
    per: float  # 1/fs
    high: float  # what passes
    band: float
    low: float


class SvfState(NamedTuple):
    s1: float
    s2: float


LEAST = 1e-3
"""Smallest quality of a signal."""


class Turn(NamedTuple):
    """Of a cutoff and a quality: halves of what the states get, and 1/q."""

    a: float
    c: float
    d: float
    k: float
    wrong: float  # 0, or nan


def turn(p, cutoff, q):
    """Numbers of one sample."""
    r = cutoff * p.per
    r = where(r > 0.0, where(r < 0.5, r, 0.5), 0.0)
    k = 1.0 / where(q > LEAST, q, LEAST)
    si, co = sinpi(r), sinpi(0.5 - r)
    sd = si / fma(k * si, co, 1.0)
    return Turn(sd * co, sd * fma(k, co, si), sd * si, k, (cutoff + q) - (cutoff + q))


def turned(p, t, s, x):
    """The output and the new state."""
    h = x - s.s2
    low = s.s2 + fma(t.d, h, t.a * s.s1)
    band = s.s1 + fma(t.a, h, -t.c * s.s1)
    high = fma(-t.k, band, x - low)
    y = flush(fma(p.high, high, fma(p.band * t.k, band, p.low * low)))
    s1, s2 = (
        s.s1 + fma(2.0 * t.a, h, fma(-2.0 * t.c, s.s1, TINY)),
        s.s2 + fma(2.0 * t.d, h, 2.0 * t.a * s.s1),
    )
    return where(t.wrong == 0.0, y, t.wrong), SvfState(s1, s2)


@dataclass(frozen=True, eq=False)
class Svf(Block):
    """``section`` of this sample's g = tan(pi cutoff/fs) = s/c and b = k g, k = 1/q,
    with D = c^2 (1 + k g + g^2) = 1 + k s c:

    h = x - s2;  band = s1 + (s c h - s (s + k c) s1)/D;
    low = s2 + (s^2 h + s c s1)/D;  high = x - k band - low;
    s1 -> 2 band - s1;  s2 -> 2 low - s2.
    """

    x: Block
    cutoff: Block
    q: Block
    mode: str

    def check(self):
        if self.mode not in MODES:
            raise BadValue(f"svf: mode = {self.mode!r}; choose one of {', '.join(MODES)}")
        for name, v in (("cutoff", self.cutoff), ("q", self.q)):
            if isinstance(v, (Const, Param)) and not v.value > 0:
                raise BadValue(f"svf: {name} = {v.value!r} must be above 0")

    def units(self, *u):
        in_unit("svf: cutoff", self.cutoff, u[1], "Hz")
        if u[2] != un.ONE:
            raise UnitError(f"svf: q {self.q!r} [{u[2]}] must have no unit")
        return u[0]

    def design(self, fs):
        if isinstance(self.cutoff, (Const, Param)):
            below_half("svf", fs, cutoff=self.cutoff.value)
        return SvfParams(1 / fs, *map(float, MODES[self.mode])), SvfState(0.0, 0.0)

    def through(self, p, fs, z, H, value):
        cutoff, q = value[1:]
        if H[0] is None or cutoff is None or q is None or not (0 < cutoff < fs / 2 and q > 0):
            return None
        g = tan(pi * cutoff / fs)
        return Cascade.transfer(section(g, g / q, self.mode), z) * H[0]

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
    """Filter with two poles whose frequency and quality may move at every sample,
    without a click.

    It cannot blow up: with no input, s1^2 + s2^2 never grows, however cutoff and q
    move.  See the notes.

    Parameters
    ----------
    x : Block
    cutoff : float or Block
        Hz; a signal is held in 0 .. fs/2.
    q : float or Block
        Quality; 0.707 is Butterworth's filter.  A signal is held at 0.001 and above.
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
