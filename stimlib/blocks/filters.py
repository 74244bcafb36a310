"""Recursive filters: low-pass, high-pass, band-pass and band-stop of four families, and
sections given by their numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt, tan
from typing import NamedTuple

import numpy as np

from ..core.graph import Block
from ..core.maths import TINY, flush, fma
from ..core.response import backward
from ..design import responses
from ..design.sections import BANDS, KINDS, ORDERS, Sections, designed, from_polynomials, sections
from ..errors import BadValue, public
from .onset import begun


class CascadeParams(NamedTuple):
    """Those of ``Sections``; and where the latency is told, in cycles per sample."""

    a: np.ndarray
    c: np.ndarray
    b: np.ndarray
    d: np.ndarray
    h0: np.ndarray
    e1: np.ndarray
    e0: np.ndarray
    at: float


class CascadeState(NamedTuple):
    s1: np.ndarray
    s2: np.ndarray
    low1: np.ndarray  # what rounding took from s1
    low2: np.ndarray


class Cascade(Block, abstract=True):
    """Second-order sections one behind the other, by the trapezoidal rule: see
    ``Sections`` for the formula.

    Each state has a second word, so nothing that a low cutoff adds is rounded away.
    """

    @staticmethod
    def step(p, s, x):
        v = x
        for k in range(p.a.size):
            s1, s2 = s.s1[k], s.s2[k]
            h = v - s2
            v = fma(p.h0[k], h, fma(p.e1[k], s1, p.e0[k] * s2))
            t1 = fma(p.a[k], h, fma(-p.c[k], s1, TINY)) + s.low1[k]
            t2 = fma(p.d[k], h, p.b[k] * s1) + s.low2[k]
            n1, n2 = s1 + t1, s2 + t2
            s.s1[k], s.s2[k], s.low1[k], s.low2[k] = n1, n2, t1 - (n1 - s1), t2 - (n2 - s2)
        return flush(v), s

    @staticmethod
    def transfer(p, z):
        above, below = quadratics(p, z)
        return np.prod(above[0] / below[0], axis=-1)

    def delay(self, p):
        """Group delay in the middle of what passes."""
        z = np.exp(2j * pi * p.at)
        (n, dn), (d, dd) = quadratics(p, z)
        return float(np.sum((z * (dd / d - dn / n)).real))


def quadratics(p, z):
    """Numerator and denominator of each section, on a last axis, and their derivatives,
    in u = z - 1.
    """
    z = np.asarray(z)[..., None]
    u, ab = z * backward(z), p.a * p.b
    above = p.h0 * u * (u + p.c) + p.e1 * p.a * u + p.e0 * (p.d * (u + p.c) + ab)
    below = (u + p.d) * (u + p.c) + ab
    slopes = p.h0 * (2 * u + p.c) + p.e1 * p.a + p.e0 * p.d, 2 * u + p.c + p.d
    return (above, slopes[0]), (below, slopes[1])


def cascade(rows: Sections, at: float) -> tuple[CascadeParams, CascadeState]:
    """Parameters and rest state."""
    return CascadeParams(*rows, at), CascadeState(*np.zeros((4, rows.a.size)))


def below_half(name: str, fs: float, **edges: float) -> list[float]:
    """Edges in cycles per sample, each below half the sample rate."""
    for what, f in edges.items():
        if f >= fs / 2:
            raise BadValue(
                f"{name}: {what} = {f:g} Hz does not fit below fs/2 = {fs / 2:g} Hz; lower it, or"
                " raise fs"
            )
    return [f / fs for f in edges.values()]


@dataclass(frozen=True, eq=False)
class Filter(Cascade):
    """A filter of one of four families; ``low`` is its one edge, or the lower of
    two.
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
        if self.kind not in KINDS:
            raise BadValue(f"{self.band}: kind = {self.kind!r}; choose one of {', '.join(KINDS)}")
        if self.order not in ORDERS:
            raise BadValue(
                f"{self.band}: order = {self.order} must be from {ORDERS[0]} to {ORDERS[-1]}; for a"
                " steeper filter put two in a row, or take kind='elliptic'"
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
        """By their names."""
        return {"cutoff": self.low} if self.high is None else {"low": self.low, "high": self.high}

    def design(self, fs):
        edges = below_half(self.band, fs, **self.edges)
        rows = designed(self.band, edges, self.order, self.kind, self.ripple, self.attenuation)
        middle = {
            "highpass": 0.5,
            "bandpass": np.arctan(sqrt(tan(pi * edges[0]) * tan(pi * edges[-1]))) / pi,
        }
        return cascade(sections(rows), float(middle.get(self.band, 0.0)))

    def laws(self, fs):
        return (
            responses.family(
                self.band,
                tuple(self.edges.values()),
                self.order,
                self.kind,
                self.ripple,
                self.attenuation,
            ),
        )


def _level(y: Filter) -> float:
    """Gain at 0 Hz of a filter that passes it: of an even order, ripples begin with a
    trough.
    """
    return (
        10 ** (-y.ripple / 20) if y.kind in ("chebyshev1", "elliptic") and y.order % 2 == 0 else 1.0
    )


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
    """Pass what is slower than the cutoff.

    Its response is that of the analogue filter at the frequency i tan(pi f/fs), scaled
    so that the cutoff is where it should be (the bilinear transform).  It is computed
    to 1e-13 of its peak, whatever the cutoff is, from 1e-6 to 0.45 fs.

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
    """Pass what is faster than the cutoff; see ``lowpass`` for parameters, errors and
    sources.

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
    """Pass what lies between two frequencies.

    It is computed to 2e-13 + 4e-15 high/(high - low) of its peak: a narrow band is as
    exact as its poles are numbers.

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
    """Take away what lies between two frequencies; see ``bandpass`` for parameters and
    errors.

    It is computed to 2e-13 + 4e-15 high/(high - low) + 4e-14 high/low of its peak.

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
    """A cascade given by the numbers of its sections."""

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
    """Run second-order sections with given numbers, such as those of ``scipy.signal``,
    which are for one sample rate.

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
