"""Delays, recursive filters in second-order sections, and the level of a vibration."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass
from math import pi, sqrt, tan

import numpy as np

from ..core.graph import NONE, ONE, Block, as_block, below_half
from ..core.maths import TINY, copy, each, flush, fma, series, where
from ..core.response import backward
from ..design import responses
from ..design.filters import BANDS, KINDS, ORDERS, Sections, designed, from_polynomials, sections
from ..errors import Above0, BadValue, Count, From0, one_of, public
from ..system.limits import limits
from .onset import begun

# Delay by whole samples --------------------------------------------------------------
# Parameters of `Delay` at a sample rate.
DelayParams = namedtuple("DelayParams", "n")

# State of `Delay`, and of an FIR filter, between samples.
#   at  place of the oldest sample: samples seen, modulo the line's size
DelayState = namedtuple("DelayState", "line at")


@dataclass(frozen=True, eq=False)
class Delay(Block):
    """A delay: y[n] = x[n - samples], and 0 before."""

    x: Block
    samples: Count | None
    seconds: Above0 | None

    def check(self):
        if (self.samples is None) == (self.seconds is None):
            raise BadValue("delay: give either samples or seconds")

    def design(self, fs):
        length = self.seconds * fs if self.samples is None else float(self.samples)
        limits.check("state_bytes", 8 * length, f"delay: bytes of its samples at fs = {fs:g} Hz")
        n = round(length)
        if n < 1:
            raise BadValue(
                f"delay: {self.seconds:g} s is less than half a sample at fs = {fs:g} Hz"
            )
        return DelayParams(float(n)), DelayState(np.zeros(n), np.uint64(0))

    def laws(self, fs):
        return (
            responses.delay(round(self.seconds * fs) if self.samples is None else self.samples),
        )

    @staticmethod
    def step(p, s, x):
        size = np.uint64(s.line.size)
        at = where(s.at < size, s.at, NONE)  # a state may come from anywhere
        i = np.int64(at)
        y = s.line[i]
        s.line[i] = x
        return y, DelayState(s.line, where(at + ONE == size, NONE, at + ONE))

    @staticmethod
    def tile(p, s, x, y):
        n, size = x.size, s.line.size
        at = np.int64(where(s.at < np.uint64(size), s.at, NONE))
        first, after = size - at, at + n  # first: samples up to the line's end
        if after >= size:
            after = after % size
        if n <= size:
            if first > n:
                first = n
            copy(s.line[at : at + first], y)
            copy(x[:first], s.line[at:])
            if first < n:
                copy(s.line[:after], y[first:])
                copy(x[first:], s.line)
        else:
            copy(s.line[at:], y)
            copy(s.line[:at], y[first:])
            copy(x[: n - size], y[size:])
            copy(x[n - after :], s.line)
            copy(x[n - size : n - after], s.line[after:])
        return DelayState(s.line, np.uint64(after))

    @staticmethod
    def transfer(p, z):
        return z**-p.n

    def delay(self, p):
        return p.n

    def memory(self, p):
        return int(p.n)


@public
def delay(
    x: Block | float,
    samples: float | None = None,
    seconds: float | None = None,
    onset: str = "step",
) -> Block:
    """Delay a signal by a whole number of samples.

    Parameters
    ----------
    x : Block
    samples : int, optional
        At least 1.
    seconds : float, optional
        Rounded to whole samples at compile time.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Raises
    ------
    BadValue
        Neither or both given; less than one sample; an unknown onset.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import delay
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": delay(stimlib.Input("x"), samples=2)}), fs=1000
    ... )
    >>> proc.process(np.array([[1.0, 2.0, 3.0]]))
    array([[0., 0., 1.]])
    """
    if isinstance(samples, float):
        raise BadValue(
            f"delay: samples = {samples!r} must be a whole number; a time is delay(x,"
            f" seconds={samples!r})"
        )
    return begun("delay", x, onset, lambda u: Delay(u, samples, seconds), lambda y: 1.0)


# Recursive filters in second-order sections -------------------------------------------
# Recursive filters: low-pass, high-pass, band-pass and band-stop of four families, and
# sections given by their numbers.
# Parameters of `Cascade`: its sections, and the frequency of its latency.
CascadeParams = namedtuple("CascadeParams", "a c b d h0 e1 e0 at")

# State of `Cascade` between samples.
#   low1  what rounding took from s1
CascadeState = namedtuple("CascadeState", "s1 s2 low1 low2")


def section(p, s, x):
    """Return the output and the new state of one second-order section."""
    h = x - s.s2
    y = fma(p.h0, h, fma(p.e1, s.s1, p.e0 * s.s2))
    t1 = fma(p.a, h, fma(-p.c, s.s1, TINY)) + s.low1
    t2 = fma(p.d, h, p.b * s.s1) + s.low2
    n1, n2 = s.s1 + t1, s.s2 + t2
    return y, CascadeState(n1, n2, t1 - (n1 - s.s1), t2 - (n2 - s.s2))


def audible(p, x):
    """Return x, or 0 where it is so small that only TINY is left of a signal."""
    return flush(x)


class Cascade(Block, abstract=True):
    """Second-order sections in series, discretised by the trapezoidal rule.

    See ``Sections`` for the formula.

    Each state has a second word, so rounding loses nothing even at a low cutoff.
    """

    @staticmethod
    def step(p, s, x):
        v = x
        for k in range(p.a.size):
            v, new = section(
                CascadeParams(p.a[k], p.c[k], p.b[k], p.d[k], p.h0[k], p.e1[k], p.e0[k], p.at),
                CascadeState(s.s1[k], s.s2[k], s.low1[k], s.low2[k]),
                v,
            )
            s.s1[k], s.s2[k], s.low1[k], s.low2[k] = new.s1, new.s2, new.low1, new.low2
        return flush(v), s

    @staticmethod
    def tile(p, s, x, y):
        series(section, p, s, x, y)
        each(audible, (), (y,), y)
        return s

    @staticmethod
    def abreast(p):
        return p.a.size + 1  # one block has its sections in lanes

    @staticmethod
    def transfer(p, z):
        above, below = quadratics(p, z)
        return np.prod(above[0] / below[0], axis=-1)

    def delay(self, p):
        """Return the group delay in the middle of the pass band."""
        z = np.exp(2j * pi * p.at)
        (n, dn), (d, dd) = quadratics(p, z)
        return float(np.sum((z * (dd / d - dn / n)).real))


def quadratics(p, z):
    """Return numerator and denominator of each section, with their derivatives.

    The sections are polynomials in u = z - 1, along the last axis.
    """
    z = np.asarray(z)[..., None]
    u, ab = z * backward(z), p.a * p.b
    above = p.h0 * u * (u + p.c) + p.e1 * p.a * u + p.e0 * (p.d * (u + p.c) + ab)
    below = (u + p.d) * (u + p.c) + ab
    slopes = p.h0 * (2 * u + p.c) + p.e1 * p.a + p.e0 * p.d, 2 * u + p.c + p.d
    return (above, slopes[0]), (below, slopes[1])


def cascade(rows: Sections, at: float) -> tuple[CascadeParams, CascadeState]:
    """Return the parameters and rest state of a cascade of sections."""
    return CascadeParams(*rows, at), CascadeState(*np.zeros((4, rows.a.size)))


@dataclass(frozen=True, eq=False)
class Filter(Cascade):
    """A low-pass, high-pass, band-pass or band-stop filter of one of four families.

    ``low`` is the only edge, or the lower of two.
    """

    x: Block
    band: str
    low: float
    high: float | None
    order: int
    kind: str
    ripple: float
    attenuation: float
    live = "svf(x, cutoff, q, mode) has a cutoff that moves"

    def check(self):
        if self.band not in BANDS or (self.high is None) != (BANDS[self.band] == 1):
            raise BadValue(
                f"filter: band = {self.band!r} with high = {self.high!r}; use one of"
                f" {', '.join(BANDS)}"
            )
        one_of(f"{self.band}: kind", self.kind, KINDS)
        if self.order not in ORDERS:
            raise BadValue(
                f"{self.band}: order = {self.order} must be from {ORDERS[0]} to {ORDERS[-1]}; for a"
                " steeper filter put two in series, or take kind='elliptic'"
            )
        if not all(f > 0 for f in self.edges.values()):
            raise BadValue(
                f"{self.band}: {', '.join(f'{k} = {f:g} Hz' for k, f in self.edges.items())} must"
                " be above 0"
            )
        if self.high is not None and not self.low < self.high:
            raise BadValue(
                f"{self.band}: low = {self.low:g} Hz must be below high = {self.high:g} Hz"
            )
        if not 0 < self.ripple < self.attenuation:
            raise BadValue(
                f"{self.band}: ripple = {self.ripple:g} dB must be above 0, and below attenuation ="
                f" {self.attenuation:g} dB"
            )

    @property
    def edges(self) -> dict[str, float]:
        """The band edges in Hz, by name."""
        return {"cutoff": self.low} if self.high is None else {"low": self.low, "high": self.high}

    def design(self, fs):
        edges = below_half(self.band, fs, **self.edges)
        rows = designed(self.band, edges, self.order, self.kind, self.ripple, self.attenuation)
        middle = {
            "highpass": 0.5,
            "bandpass": np.arctan(sqrt(tan(pi * edges[0]) * tan(pi * edges[-1]))) / pi,
        }
        return cascade(sections(rows), float(middle.get(self.band, 0.0)))


def _level(y: Filter) -> float:
    """Return the gain at 0 Hz of a filter.

    With an even order, a band with ripples begins at their minimum there.
    """
    passes = y.band in ("lowpass", "bandstop")
    ripples = y.kind == "elliptic" or (passes and y.kind == "chebyshev1")
    if ripples and y.order % 2 == 0:
        return 10 ** (-(y.ripple if passes else y.attenuation) / 20)
    return float(passes)


@public
def lowpass(
    x: Block | float,
    cutoff: float,
    order: int = 2,
    kind: str = "butterworth",
    ripple: float = 1.0,
    attenuation: float = 60.0,
    onset: str = "step",
) -> Block:
    """Pass frequencies below the cutoff.

    The response is that of the analogue filter at the frequency i tan(pi f/fs), scaled
    so that the cutoff is exact (the bilinear transform). It is computed to 1e-13 of its
    peak for any cutoff from 1e-6 to 0.45 fs.

    Parameters
    ----------
    x : Block
    cutoff : float
        Edge of the pass band in Hz: where the gain is -3 dB, and -ripple for the kinds
        that have ripples.
    order : int
        Number of poles, 1 to 12: far from the pass band 6 dB an octave each.
    kind : {"butterworth", "bessel", "chebyshev1", "elliptic"}
        Flat gain; a step without overshoot; steeper, with ripples where it passes;
        steepest, with ripples on both sides.
    ripple : float
        Of the pass band in dB; for chebyshev1 and elliptic.
    attenuation : float
        Of the stop band in dB; for elliptic.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there:
        "steady" for a position, which would else begin with a jump from 0.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        An unknown kind or onset, an order that there is not, a cutoff not above 0,
        ripple not between 0 and attenuation; at compile time, a cutoff not below fs/2.

    References
    ----------
    Zavalishin, "The Art of VA Filter Design" (2012), chapter 4: trapezoidal integration
    of the state-variable filter. Oppenheim and Schafer, "Discrete-Time Signal
    Processing" (2010), appendix B: the families.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import lowpass
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": lowpass(stimlib.Input("x"), 100, order=4)}), fs=8000
    ... )
    >>> (20 * np.log10(abs(proc.response("y", "x", np.array([1.0, 100, 200]))))).round(
    ...     1
    ... ) + 0.0
    array([  0. ,  -3. , -24.2])
    """
    return begun(
        "lowpass",
        x,
        onset,
        lambda u: Filter(u, "lowpass", cutoff, None, order, kind, ripple, attenuation),
        _level,
    )


@public
def highpass(
    x: Block | float,
    cutoff: float,
    order: int = 2,
    kind: str = "butterworth",
    ripple: float = 1.0,
    attenuation: float = 60.0,
    onset: str = "step",
) -> Block:
    """Pass frequencies above the cutoff; see ``lowpass`` for the rest.

    Parameters, errors and sources are the same.

    Parameters
    ----------
    x : Block
    cutoff, order, kind, ripple, attenuation, onset
        As of ``lowpass``.

    Returns
    -------
    Block
        In the unit of x.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import highpass
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": highpass(stimlib.Input("x"), 100, order=1)}), fs=8000
    ... )
    >>> abs(proc.response("y", "x", np.array([0.0, 100, 4000]))).round(3)
    array([0.   , 0.707, 1.   ])
    """
    return begun(
        "highpass",
        x,
        onset,
        lambda u: Filter(u, "highpass", cutoff, None, order, kind, ripple, attenuation),
        _level,
    )


@public
def bandpass(
    x: Block | float,
    low: float,
    high: float,
    order: int = 2,
    kind: str = "butterworth",
    ripple: float = 1.0,
    attenuation: float = 60.0,
    onset: str = "step",
) -> Block:
    """Pass frequencies between two edges.

    The response is computed to 2e-13 + 4e-15 high/(high - low) of its peak: the
    precision in a narrow band is that of its poles as numbers.

    Parameters
    ----------
    x : Block
    low, high : float
        Edges of the pass band in Hz; the gain there is as at the cutoff of ``lowpass``.
    order : int
        Of each flank, 1 to 12: the filter has twice as many poles, as in scipy.
    kind, ripple, attenuation, onset
        As of ``lowpass``.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        As of ``lowpass``; low not below high.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import bandpass
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": bandpass(stimlib.Input("x"), 100, 300)}), fs=8000
    ... )
    >>> abs(proc.response("y", "x", np.array([0.0, 100, 170, 300, 1000]))).round(3)
    array([0.   , 0.707, 1.   , 0.707, 0.038])
    """
    return begun(
        "bandpass",
        x,
        onset,
        lambda u: Filter(u, "bandpass", low, high, order, kind, ripple, attenuation),
        _level,
    )


@public
def bandstop(
    x: Block | float,
    low: float,
    high: float,
    order: int = 2,
    kind: str = "butterworth",
    ripple: float = 1.0,
    attenuation: float = 60.0,
    onset: str = "step",
) -> Block:
    """Remove frequencies between two edges; see ``bandpass`` for the rest.

    Parameters and errors are the same.

    The response is computed to 2e-13 + 4e-15 high/(high - low) + 4e-14 high/low of its
    peak.

    Parameters
    ----------
    x : Block
    low, high, order, kind, ripple, attenuation, onset
        As of ``bandpass``.

    Returns
    -------
    Block
        In the unit of x.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import bandstop
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": bandstop(stimlib.Input("x"), 40, 60)}), fs=8000
    ... )
    >>> abs(proc.response("y", "x", np.array([10.0, 49, 60, 200]))).round(2)
    array([1.  , 0.  , 0.71, 1.  ])
    """
    return begun(
        "bandstop",
        x,
        onset,
        lambda u: Filter(u, "bandstop", low, high, order, kind, ripple, attenuation),
        _level,
    )


@dataclass(frozen=True, eq=False)
class Sos(Cascade):
    """A cascade given by the coefficients of its sections."""

    x: Block
    rows: np.ndarray

    def check(self):
        if self.rows.ndim != 2 or self.rows.shape[1] != 6 or not 0 < len(self.rows) <= ORDERS[-1]:
            raise BadValue(
                f"sos: rows must be 1 to {ORDERS[-1]} sections of b0, b1, b2, a0, a1, a2 as scipy"
                f" makes them, got shape {self.rows.shape}"
            )
        for k, row in enumerate(self.rows):
            bottom = from_polynomials(row[:3], row[3:])[1]
            if not (all(v > 0 for v in bottom) or all(v < 0 for v in bottom)):
                raise BadValue(
                    f"sos: section {k} is not stable: a pole of {row[3:].tolist()} is on or outside"
                    " the unit circle"
                )

    def design(self, fs):
        made = cascade(sections([from_polynomials(r[:3], r[3:]) for r in self.rows]), 0.0)
        f = np.linspace(0, 0.5, 2049)
        return (
            made[0]._replace(
                at=float(f[np.argmax(np.abs(self.transfer(made[0], np.exp(2j * pi * f))))])
            ),
            made[1],
        )

    def laws(self, fs):
        return (responses.biquads(self.rows),)


@public
def sos(x: Block | float, rows, onset: str = "step") -> Block:
    """Filter with second-order sections whose coefficients are given.

    Such coefficients come, for example, from ``scipy.signal``; they hold for one sample
    rate.

    Parameters
    ----------
    x : Block
    rows : array_like, shape (sections, 6)
        b0, b1, b2, a0, a1, a2 of each of at most 12.  The same cascade as all filters
        here computes them, so they lose nothing more; what scipy lost at a low cutoff
        when it made them is lost: ``lowpass`` and the others make their own.
    onset : {"step", "steady"}
        As of ``lowpass``; "steady" is what ``sosfilt_zi`` is for.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        Not rows of six; a section that is not stable.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import sos
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": sos(stimlib.Input("x"), [[0.5, 0, 0, 1, -0.5, 0]])}),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[1.0, 0.0, 0.0, 0.0]]))
    array([[0.5   , 0.25  , 0.125 , 0.0625]])
    """
    return begun(
        "sos",
        x,
        onset,
        lambda u: Sos(u, rows),
        lambda y: np.prod(y.rows[:, :3].sum(axis=1) / y.rows[:, 3:].sum(axis=1)),
    )


# Level of a vibration ---------------------------------------------------------------
# Parameters of `Follower` at a sample rate.
FollowerParams = namedtuple("FollowerParams", "up down")

# State of `Follower` between samples.
#   before  y one sample earlier
FollowerState = namedtuple("FollowerState", "y before")


def nearer(g, a, s):
    """Return (1 - g) y + g a, of which only one product waits for the last y.

    The low word of 1 - g, which is below rounding, multiplies the y before.
    """
    keep = 1.0 - g
    return fma(keep, s.y, fma((1.0 - keep) - g, s.before, g * a))


@dataclass(frozen=True, eq=False)
class Follower(Block):
    """The level of a signal, with separate attack and release times.

    y += g (|x| - y), g = 1 - exp(-1/(T fs)), where T is the attack time while |x| is
    above y, else the release time.
    """

    x: Block
    attack: From0
    release: From0

    def design(self, fs):
        up, down = (
            -math.expm1(-1 / (t * fs)) if t * fs > 1e-3 else 1.0
            for t in (self.attack, self.release)
        )
        return FollowerParams(up, down), FollowerState(0.0, 0.0)

    @staticmethod
    def step(p, s, x):
        a = abs(x) + TINY
        y = where(a > s.y, nearer(p.up, a, s), nearer(p.down, a, s))
        return flush(y), FollowerState(y, s.y)


@public
def envelope_follower(x: Block | float, attack: float = 0.001, release: float = 0.05) -> Block:
    """Follow the level of a vibration.

    The output approaches the absolute value, with one time constant for rises and
    another for falls.

    Parameters
    ----------
    x : Block
    attack, release : float
        Time constants in s; 0 is at once.

    Returns
    -------
    Block
        In the unit of x, 0 or above; starts at 0.

    Raises
    ------
    BadValue
        A time below 0.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import envelope_follower
    >>> proc = stimlib.compile(
    ...     stimlib.Scene(
    ...         {"y": envelope_follower(stimlib.Input("x"), attack=0, release=0.01)}
    ...     ),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[0.0, -2.0, 0.0, 1.0]])).round(3)
    array([[0.   , 2.   , 1.81 , 1.733]])
    """
    return Follower(as_block(x), attack, release)
