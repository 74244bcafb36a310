"""Finite impulse responses: any taps, the differentiator, and moving averages."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from ..core import units as un
from ..core.graph import NONE, Block, scratch
from ..core.maths import copy, fir as fir_sum
from ..core.units import unit
from ..design import responses
from ..design.filters import MAX_ORDER, asked_by, differentiator_order, differentiator_taps
from ..errors import Above0, BadValue, Count, public
from ..system.limits import limits
from .filters import DelayState
from .onset import begun

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
        usual = max(2, min(2 * round(64 * fs / 8000), MAX_ORDER))
        order = usual if self.order is None else self.order
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
                f" or tol={1.1 * d.error:.2g}"
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
        Even.  Default 2 round(64 fs / 8000), from 2 to 8192, which is reached at 512
        kHz: order 128 at 8 kHz, as in the paper.
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
