"""Filters: delays, FIR, moving averages, second-order sections, levels, tracking."""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass
from math import pi, sqrt, tan
from typing import Any

import numpy as np

from ..core import units as un
from ..core.graph import NONE, ONE, Block, as_block, below_half, constant, scratch
from ..core.maths import TINY, copy, each, fir as fir_sum, flush, fma, series, where
from ..core.response import backward
from ..core.units import unit
from ..design import responses
from ..design.filters import (
    BANDS,
    KINDS,
    ORDERS,
    Sections,
    asked_by,
    designed,
    differentiator_order,
    differentiator_taps,
    from_polynomials,
    sections,
)
from ..errors import Above0, BadValue, Count, From0, one_of, public
from ..system.limits import limits

# Before the first sample ------------------------------------------------------------
# What was before the first sample: 0, so that it is a step, or a signal that has always
# been as it is there.
#
# A linear block begins steady by one mechanism, whatever its state is: it is given what
# x moves away from its first value, and its answer to that value, which is its gain at
# 0 Hz, is added.
ONSETS = {"steady": 1.0, "step": 2.0}  # what ``cold`` is before the first sample


# State of `First` between samples.
FirstState = namedtuple("FirstState", "x cold")


@dataclass(frozen=True, eq=False)
class First(Block):
    """The first sample of a signal, held for ever."""

    x: Block
    begins_early = False

    def design(self, fs):
        return (), FirstState(0.0, 1.0)

    def through(self, p, fs, z, H, value):
        return 0.0 * H[0]  # what x does later does not reach it

    @staticmethod
    def step(p, s, x):
        y = where(s.cold > 0.0, x, s.x)
        return y, FirstState(y, 0.0)

    def delay(self, p):
        return math.inf


def check_onset(name: str, onset: str) -> None:
    """Raise BadValue if the onset is unknown."""
    one_of(f"{name}: onset", onset, ONSETS)


def begun(
    name: str,
    x: Any,
    onset: str,
    make: Callable[[Block], Block],
    gain: Callable[[Any], float] = lambda y: 0.0,
) -> Block:
    """Return a linear block of x with the initial state that an onset asks for.

    Parameters
    ----------
    name : str
        Of the public function, for errors.
    x : Block
    onset : {"step", "steady"}
    make : callable
        From a signal to the block.
    gain : callable
        From the block to its gain at 0 Hz; infinite where it answers a constant without
        end.

    Raises
    ------
    BadValue
        An unknown onset; a steady start where there is none.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.filters import Delay
    >>> from stimlib.blocks.filters import begun
    >>> y = begun(
    ...     "delay",
    ...     stimlib.Input("x"),
    ...     "steady",
    ...     lambda x: Delay(x, 1, None),
    ...     lambda y: 1.0,
    ... )
    >>> stimlib.compile(stimlib.Scene({"y": y}), fs=1000).process(
    ...     np.array([[3.0, 4.0, 5.0]])
    ... )
    array([[3., 3., 4.]])
    """
    check_onset(name, onset)
    x = as_block(x)
    if onset == "step":
        return make(x)
    first = First(x)
    y = make(x - first)
    g = gain(y)
    if not math.isfinite(g):
        raise BadValue(
            f"{name}: the response to a constant grows without end, so there is no steady start;"
            " use"
            " onset='step'"
        )
    return y + first * constant(g, str(y.dim / x.dim)) if g else y


# Delay ------------------------------------------------------------------------------
# Delay by whole samples.
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


# Finite impulse responses -----------------------------------------------------------
# Finite impulse responses: any taps, and the band-limited differentiator.
# Parameters of `Fir` at a sample rate.
#   taps  oldest first, zeros in front up to a multiple of 8
FirParams = namedtuple("FirParams", "taps order")


SPAN = 448
"""So many samples, at least, are taken in before the last ones are moved back to the
beginning.
"""


class Fir(Block, abstract=True):
    """A finite impulse response: y[n] = sum_k h[k] x[n-k]."""

    @staticmethod
    def tile(p, s, x, y):
        h, start = p.taps.size - 1, 0
        span = s.line.size - h
        at = np.int64(s.at % np.uint64(span))  # a state may come from anywhere
        for _ in range(2):  # a tile is shorter than the way to the end
            n = x.size - start
            if n > span - at:
                n = span - at
            if n > 0:
                copy(x[start : start + n], s.line[at + h : at + h + n])
                fir_sum(p.taps, s.line[at : at + h + n], y[start : start + n])
                start, at = start + n, at + n
                if at == span:
                    copy(s.line[span:], s.line[:h])
                    at = np.int64(0)
        return DelayState(s.line, np.uint64(at))

    @staticmethod
    def transfer(p, z):
        return np.polyval(p.taps, 1 / z)  # oldest first: highest power of 1/z first

    def delay(self, p):
        """Return half the order for linear phase, else the centroid of the energy."""
        h = p.taps[::-1][: int(p.order) + 1]
        if np.array_equal(h, h[::-1]) or np.array_equal(h, -h[::-1]):
            return p.order / 2
        return float(np.sum(np.arange(h.size) * h**2) / np.sum(h**2))

    def memory(self, p):
        return int(p.order)


def line(taps: np.ndarray) -> tuple[FirParams, DelayState]:
    """Return the parameters and rest state of an FIR filter with taps h[0..order]."""
    n = -(-taps.size // 8) * 8
    p = FirParams(np.concatenate([np.zeros(n - taps.size), taps[::-1]]), float(taps.size - 1))
    return p, DelayState(np.zeros(n - 1 + max(n - 1, SPAN)), np.uint64(0))


@dataclass(frozen=True, eq=False)
class Taps(Fir):
    """An FIR filter given by its taps."""

    x: Block
    taps: np.ndarray
    gain_unit: str = ""

    def check(self):
        if np.ndim(self.taps) != 1 or np.size(self.taps) == 0 or not np.any(self.taps):
            raise BadValue(
                "fir: taps must be one row with at least one nonzero, got shape"
                f" {np.shape(self.taps)}"
            )

    def units(self, *u):
        return u[0] * unit(self.gain_unit)

    def design(self, fs):
        return line(self.taps)

    def laws(self, fs):
        return (responses.sum_of(self.taps),)


@public
def fir(x: Block, taps, unit: str = "", onset: str = "step") -> Block:
    """Filter with a finite impulse response, y[n] = sum_k taps[k] x[n-k].

    Parameters
    ----------
    x : Block
    taps : array_like, shape (order + 1,)
    unit : str
        Unit of the taps.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Raises
    ------
    BadValue
        No taps, all zero, or not finite; an unknown onset.

    Notes
    -----
    The taps are padded with zeros to a multiple of eight, for vectors, and 0 times
    infinity is NaN. An infinite or NaN sample therefore affects this multiple of eight
    outputs, up to 7 more than taps.size.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import fir
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": fir(stimlib.Input("x"), [0.5, 0.5])}), fs=1000
    ... )
    >>> proc.process(np.array([[1.0, 1.0, 3.0]]))
    array([[0.5, 1. , 2. ]])
    """
    return begun("fir", x, onset, lambda u: Taps(u, taps, unit), lambda y: float(y.taps.sum()))


@dataclass(frozen=True, eq=False)
class Differentiator(Fir):
    """An FIR differentiator: i 2 pi f in the pass band, 0 in the stop band.

    It has linear phase and a delay of order/2 samples.
    """

    x: Block
    passband: Above0 | None = None
    stopband: Above0 | None = None
    order: Count | None = None
    tol: Above0 = 1e-6

    def units(self, *u):
        return u[0] * RATE

    def design(self, fs):
        order = 2 * round(64 * fs / 8000) if self.order is None else self.order
        passband = 0.45 * fs if self.passband is None else self.passband
        if passband < 1e-9 * fs:
            raise BadValue(
                f"differentiator: a pass band up to {passband:g} Hz is too narrow at fs = {fs:g}"
                " Hz; give a"
                " larger passband"
            )
        if passband >= fs / 2:
            good = (
                p for p in fs / 2 ** np.arange(3.0, 9) if self._taps(fs, p, order).error <= self.tol
            )
            raise BadValue(
                f"differentiator: a pass band up to {passband:g} Hz does not fit below fs/2 ="
                f" {fs / 2:g} Hz; give a smaller passband"
                + next((f", such as {p:g}" for p in good), "")
            )
        d = self._taps(fs, passband, order)
        if d.error > self.tol:
            with asked_by("differentiator"):
                need = differentiator_order(fs, passband, self._stop(fs, passband), self.tol)
            raise BadValue(
                f"differentiator: order {order} at fs = {fs:g} Hz has a relative error of"
                f" {d.error:.1e} up to {passband:g} Hz, above tol = {self.tol:g}; use order={need},"
                f" or tol={d.error:.1g}"
            )
        return line(d.taps)

    def laws(self, fs):
        return (responses.differentiator(self.passband, self.order, self.tol),)

    def _stop(self, fs, passband):
        """Return the stop edge for a pass edge, or None without a stop band.

        The pass edge may differ from the requested one; there is no stop band if it
        would begin above fs/2.
        """
        if self.passband is None:
            return None if self.stopband is None or self.stopband > fs / 2 else self.stopband
        stopband = (
            1.5 * passband if self.stopband is None else self.stopband + (passband - self.passband)
        )
        return stopband if stopband <= fs / 2 else None

    def _taps(self, fs, passband, order):
        with asked_by("differentiator"):
            return differentiator_taps(fs, passband, self._stop(fs, passband), order)


RATE = un.Unit((("second", -1.0),))


@public
def differentiator(
    x: Block,
    passband: float | None = None,
    stopband: float | None = None,
    order: int | None = None,
    tol: float = 1e-6,
    onset: str = "step",
) -> Block:
    """Differentiate a signal in a band with a linear-phase FIR filter.

    The filter is of type III (antisymmetric, even order) and near-minimax.

    Parameters
    ----------
    x : Block
    passband : float, optional
        Upper edge of the pass band in Hz.  Default: 0.45 fs, without a stop band.
    stopband : float, optional
        Lower edge of the stop band in Hz; there is none where this is above fs/2.
        Default: 1.5 passband where a passband is given.
    order : int, optional
        Even.  Default 2 round(64 fs / 8000): order 128 at 8 kHz, as in the paper.
    tol : float
        Largest relative error in the pass band; an order that cannot meet it is an
        error.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there:
        "steady" for a position, which would else begin with the velocity of a jump from
        0.

    Returns
    -------
    Block
        In the unit of x per second.

    Raises
    ------
    BadValue
        An unknown onset; at compile time, a pass band that does not fit below fs/2, or
        an order too low for tol (the message names the order needed).

    References
    ----------
    The UGrip paper, section 1.1: "D(s) is band limited to limit gain and prevent
    aliasing ... a FIR filter of order 128".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import differentiator
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"v": differentiator(stimlib.Input("x"), passband=1000)}),
    ...     fs=8000,
    ... )
    >>> abs(proc.response("v", "x", np.array([100.0])) / (2 * np.pi * 100)).round(5)
    array([1.])
    """
    return begun(
        "differentiator", x, onset, lambda u: Differentiator(u, passband, stopband, order, tol)
    )


# Moving averages ---------------------------------------------------------------------
# A mean of more samples than TAPPED is the sum of two. The samples are divided into
# rows as long as the mean; the window has all samples of the present row, and those of
# the row before that came after this place, whose sums were made when that row ended.
# Groups of eight samples are added first, and the sum of groups has a second word.
TAPPED = 63


def grown(high, low, group):
    """Return the two words of a sum to which a group has been added."""
    new = high + group
    return new, low + ((high - (new - (new - high))) + (group - (new - high)))


def suffix_sums(row):
    """Replace each sample of a row by the sum of those after it."""
    high, low = 0.0, 0.0
    for end in range(row.size, 0, -8):
        part, base, group = row[end - 8 : end], high + low, 0.0
        for k in range(7, -1, -1):
            group, part[k] = group + part[k], base + group
        high, low = grown(high, low, group)


@dataclass(frozen=True, eq=False)
class MovingAverage(Fir):
    """The mean of the last samples: an FIR filter with equal taps.

    A long one has a state of its own: a row of samples, then later sums, up to a
    multiple of eight, and the two words of the sum of the row's whole groups.
    """

    x: Block
    seconds: float

    def design(self, fs):
        limits.check(
            "state_bytes",
            64 * self.seconds * fs,
            f"moving_average: bytes of its samples at fs = {fs:g} Hz",
        )
        n = round(self.seconds * fs)
        if n < 1:
            raise BadValue(
                f"moving_average: {self.seconds:g} s is less than half a sample at fs = {fs:g} Hz"
            )
        p, _ = line(np.full(n, 1 / n))
        words = p.taps.size + (2 if n > TAPPED else -1)
        return p, DelayState(np.zeros(words), NONE)

    work = scratch(128)  # a short row and what comes to it, or whole groups of eight

    @staticmethod
    def tile(p, s, x, y, w):  # type: ignore[override]
        size, start, n = np.int64(p.order) + 1, 0, x.size
        if size <= TAPPED:
            before = p.taps.size - 1
            copy(s.line, w[:before])
            copy(x, w[before : before + n])
            fir_sum(p.taps, w[: before + n], y)
            copy(w[n : n + before], s.line)
            return s
        row, words = s.line[: p.taps.size], s.line[p.taps.size :]
        at, high, low = np.int64(s.at % np.uint64(size)), words[0], words[1]
        for _ in range(2):  # no tile is longer than a row
            n = x.size - start
            if n > size - at:
                n = size - at
            made, kept, new, first = y[start : start + n], row[at : at + n], x[start:], at & 7
            for k in range(n):
                made[k], kept[k] = kept[k], new[k]
            for k in range(at - first, at + n, 8):
                part, sums = row[k : k + 8], w[k - at + first : k - at + first + 8]
                base, group = high + low, 0.0
                for i in range(8):
                    group = group + part[i]
                    sums[i] = base + group
                if k + 8 <= at + n:
                    high, low = grown(high, low, group)
            for k in range(n):
                made[k] = (w[np.uint64(first + k)] + made[k]) * p.taps[p.taps.size - 1]
            start, at = start + n, at + n
            if at == size:
                suffix_sums(row)
                high, low, at = 0.0, 0.0, np.int64(0)
        words[0], words[1] = high, low
        return DelayState(s.line, np.uint64(at))

    def laws(self, fs):
        return (responses.mean_of(round(self.seconds * fs)),)


@public
def moving_average(x: Block | float, seconds: float, onset: str = "step") -> Block:
    """Return the average over the last seconds.

    It is an FIR filter with equal taps: no rounding accumulates over time, and after
    silence as long as the average it is exactly 0. From 64 samples on its cost does not
    depend on their number, and the last bit of a sample depends on how many samples
    were before it. An infinite or NaN sample affects as many outputs as the average has
    samples; below 64 samples, this number is rounded up to a multiple of eight, as in
    ``fir``.

    Parameters
    ----------
    x : Block
    seconds : float
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Returns
    -------
    Block
        In the unit of x, half the time later.

    Raises
    ------
    BadValue
        An unknown onset; at compile time, less than half a sample.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import moving_average
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": moving_average(stimlib.Input("x"), 0.004)}), fs=1000
    ... )
    >>> proc.process(np.array([[4.0, 4.0, 4.0, 4.0, 4.0, 0.0]]))
    array([[1., 2., 3., 4., 4., 3.]])
    """
    return begun("moving_average", x, onset, lambda u: MovingAverage(u, seconds), lambda y: 1.0)


# Recursive filters in second-order sections -----------------------------------------
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
    """Return the gain at 0 Hz of a filter that passes 0 Hz.

    For even orders, the pass-band ripple starts at its minimum.
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


# Tracking of positions that are reported slowly -------------------------------------
# Following motion that arrives slowly: reports of 60 to 250 Hz, with jitter, held in
# between.
# Parameters of `Track` at a sample rate.
#   q  w/fs
#   g  1 - exp(-q)
TrackParams = namedtuple("TrackParams", "q g fs max_jump")

# State of `Track` between samples.
#   y     position
#   v     movement of y in the last sample
#   e     x - y
#   h     velocity of the filter, per sample
#   last  x
#   cold  1: starts at the next x in contact
TrackState = namedtuple("TrackState", "y v e h last cold")


def follow(p, s, x, contact):
    """Return the state of the tracker after x has been held for one sample."""
    d = x - s.last
    fresh = where(s.cold > 0.0, 1.0, where(abs(d) > p.max_jump, 1.0, 0.0))
    e = where(fresh > 0.0, 0.0, s.e + (d + TINY))
    h = where(fresh > 0.0, 0.0, s.h)
    u = fma(p.q, e, -h)
    a, b = e + u, fma(p.q, u, h)
    after, move = fma(-p.g, a, a), fma(p.g, a, -u)
    on = contact > 0.0
    y, v = where(on, flush(x - after), s.y), where(on, flush(move), 0.0)
    e, h = where(on, after, 0.0), where(on, fma(-p.g, b, b), 0.0)
    return TrackState(y, v, e, h, where(on, x, s.last), where(on, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Tracker(Block, abstract=True):
    """A critically damped tracker, w^2/(s + w)^2, of an input held between samples.

    Its state is e = x - y and h = v/fs.

    With q = w/fs, g = 1 - exp(-q), and e already increased by the change of x in this
    sample:

    u = q e - h;  e -> (1 - g)(e + u);  h -> (1 - g)(h + q u);  y = x - e.

    These are the exact solutions of y'' = w^2 (x - y) - 2 w y' at the end of the
    sample.  Only differences of x enter e and h, so a held position leaves nothing in
    them, however small q is.
    """

    x: Block
    contact: Block
    bandwidth: Above0
    max_jump: Above0 | None

    def design(self, fs):
        if self.bandwidth >= fs / 2:
            raise BadValue(
                f"track: bandwidth = {self.bandwidth:g} Hz does not fit below fs/2 = {fs / 2:g} Hz"
            )
        q = 2 * math.pi * self.bandwidth / fs
        jump = math.inf if self.max_jump is None else float(self.max_jump)
        return TrackParams(q, -math.expm1(-q), fs, jump), TrackState(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def response(p, z):
    """Return the tracker's frequency response from input to position.

    (1 - (1-g)(1+q) + (1-g)(q-g)/z) / (1 - (1-g)/z)^2.
    """
    c = p.q - p.g
    return (p.q * p.g - c + (1 - p.g) * c / z) / (backward(z) + p.g / z) ** 2


def lag(p):
    """Return the group delay of the tracked position at 0 Hz in samples.

    It is 2/q - 1/2, up to terms of the order of q.
    """
    return (1 - p.g) * (2 + (p.q - p.g) / p.g) / p.g


@dataclass(frozen=True, eq=False)
class Track(Tracker):
    """Position of the tracker."""

    def laws(self, fs):
        return (responses.tracker(self.bandwidth),)

    @staticmethod
    def step(p, s, x, contact):
        after = follow(p, s, x, contact)
        return after.y, after

    @staticmethod
    def transfer(p, z):
        return response(p, z)

    def delay(self, p):
        return lag(p)


@dataclass(frozen=True, eq=False)
class TrackVelocity(Tracker):
    """Velocity of the tracker: the change of its position per sample, times fs."""

    def units(self, *u):
        return u[0] * RATE

    def laws(self, fs):
        return (responses.tracker(self.bandwidth, rate=True),)

    @staticmethod
    def step(p, s, x, contact):
        after = follow(p, s, x, contact)
        return after.v * p.fs, after

    @staticmethod
    def transfer(p, z):
        return p.fs * backward(z) * response(p, z)

    def delay(self, p):
        return lag(p) + 0.5  # of the difference


@public
def track(
    x: Block, bandwidth: float = 20.0, contact: Block | float = 1.0, max_jump: float | None = 0.05
) -> Block:
    """Smooth slow, jittered position reports causally.

    The tracker is a critically damped second-order system, H(s) = w^2/(s + w)^2 with w
    = 2 pi bandwidth, discretised exactly for an input that is held between samples:
    y[n] is the value that the continuous filter reaches after x[n] has been held for
    one sample. The gain at 0 Hz is exactly 1, and a step does not overshoot.

    Parameters
    ----------
    x : Block
        Position, usually in m, held between reports.
    bandwidth : float
        Frequency of both poles in Hz; the gain there is 1/2.  Latency 2/w = 1/(pi
        bandwidth) seconds (less half a sample): 16 ms at 20 Hz.  Regular reports at r
        Hz leave a ripple of at most 3.3 (bandwidth/r)^2 of the velocity: 7 % for 70 Hz
        and 10 Hz, 8 % for 125 Hz and 20 Hz.
    contact : Block
        Where it is not above 0 the output holds its value (0 before the first contact)
        and x is not looked at.  At re-contact the tracker starts at the new position
        with velocity 0, so the way between invents no movement.
    max_jump : float, optional
        In the unit of x.  A change of x from one sample to the next that is larger
        restarts the tracker there with velocity 0: a fault of the device invents no
        movement either.  As reports are held, a whole report's movement arrives in one
        sample: choose the highest speed times the longest normal gap.  The default 0.05
        is 1 m/s for 50 ms.  None: never.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        bandwidth or max_jump not above 0; at compile time, bandwidth not below fs/2.

    See Also
    --------
    track_velocity : the rate of the same tracker.

    Notes
    -----
    It always begins steady, at the first value of x with velocity 0.

    It is linear and time-invariant as long as contact lasts and no jump occurs;
    ``Processor.response`` describes that case.

    References
    ----------
    The touch-screen thesis, chapter 3, eq. (17): bumps are tied to the finger's
    position, which an infrared frame acquires. The filter is our own choice, the papers
    give none.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import track
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": track(stimlib.Input("x", "m"), bandwidth=20.0)}),
    ...     fs=8000,
    ... )
    >>> t = np.arange(8000) / 8000
    >>> reports = 0.1 * np.floor(t * 100) / 100  # 0.1 m/s, a report every 10 ms
    >>> y = proc.process(reports[None])[0]
    >>> bool(
    ...     np.abs(np.diff(y)).max() * 8000 < 0.12
    ... )  # the reports themselves jump by 8 m/s
    True
    >>> round(proc.latency["y", "x"][0] / 8000, 4)
    0.0159
    """
    return Track(x, as_block(contact), bandwidth, max_jump)


@public
def track_velocity(
    x: Block, bandwidth: float = 20.0, contact: Block | float = 1.0, max_jump: float | None = 0.05
) -> Block:
    """Return the rate of change of ``track`` with the same arguments.

    v[n] = (y[n] - y[n-1]) fs, computed without that difference. The sum of v/fs is
    exactly the tracked position, so position and rate from one tracker describe the
    same movement.

    Parameters
    ----------
    x, bandwidth, contact, max_jump
        As for ``track``.  The velocity is 0 off contact, and at the sample of a jump.

    Returns
    -------
    Block
        In the unit of x per second.

    Raises
    ------
    BadValue
        bandwidth or max_jump not above 0; at compile time, bandwidth not below fs/2.

    See Also
    --------
    track : position.
    stimlib.blocks.velocity : for positions sampled at the full rate.

    Notes
    -----
    Reports that are held leave a ripple. At a constant speed and the default bandwidth,
    its largest error is 30 % of the speed for reports at 60 Hz, 8 % at 125 Hz and 3 %
    at 250 Hz; with reports that come up to half an interval late, 58, 22 and 8 %. Half
    the bandwidth has about a third of the error, and twice the latency.

    References
    ----------
    The UGrip paper, section 1.1: the compression rate v.  The filter is our own choice.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import track_velocity
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"v": track_velocity(stimlib.Input("x", "m"))}), fs=8000
    ... )
    >>> proc.process(0.1 * np.arange(8000)[None] / 8000)[0, -1].round(9)
    np.float64(0.1)
    """
    return TrackVelocity(x, as_block(contact), bandwidth, max_jump)
