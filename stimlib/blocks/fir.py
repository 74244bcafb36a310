"""Finite impulse responses: any taps, and the band-limited differentiator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import units as un
from ..core.graph import Block, positive
from ..core.maths import copy
from ..core.maths import fir as fir_sum
from ..core.units import unit
from ..design import responses
from ..design.differentiator import differentiator_order, differentiator_taps
from ..design.minimax import asked_by
from ..errors import BadValue, public
from .onset import begun


class FirParams(NamedTuple):
    taps: np.ndarray  # oldest first, zeros in front up to a multiple of 8
    order: float


class FirState(NamedTuple):
    line: np.ndarray  # inputs, oldest first: the last taps.size - 1 end at the place of the next
    at: np.uint64  # how far that place has moved


SPAN = 448
"""So many samples, at least, are taken in before the last ones are moved back to the
beginning.
"""


class Fir(Block, abstract=True):
    """y[n] = sum_k h[k] x[n-k]."""

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
        return FirState(s.line, np.uint64(at))

    @staticmethod
    def transfer(p, z):
        return np.polyval(p.taps, 1 / z)  # oldest first: highest power of 1/z first

    def delay(self, p):
        """Half the order for linear phase, else the centre of the taps' energy."""
        h = p.taps[::-1][: int(p.order) + 1]
        if np.array_equal(h, h[::-1]) or np.array_equal(h, -h[::-1]):
            return p.order / 2
        return float(np.sum(np.arange(h.size) * h**2) / np.sum(h**2))

    def memory(self, p):
        return int(p.order)


def line(taps: np.ndarray) -> tuple[FirParams, FirState]:
    """Parameters and rest state for taps h[0..order]."""
    n = -(-taps.size // 8) * 8
    p = FirParams(np.concatenate([np.zeros(n - taps.size), taps[::-1]]), float(taps.size - 1))
    return p, FirState(np.zeros(n - 1 + max(n - 1, SPAN)), np.uint64(0))


@dataclass(frozen=True, eq=False)
class Taps(Fir):
    """A FIR filter given by its taps."""

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
    """Run a filter with finite impulse response, y[n] = sum_k taps[k] x[n-k].

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
    """D(f) = i 2 pi f up to the pass edge, 0 from the stop edge on; linear phase, delay
    order/2 samples.
    """

    x: Block
    passband: float | None = None
    stopband: float | None = None
    order: int | None = None
    tol: float = 1e-6

    def check(self):
        positive(
            self,
            *(n for n in ("passband", "stopband", "order", "tol") if getattr(self, n) is not None),
        )

    def units(self, *u):
        return u[0] * RATE

    def design(self, fs):
        order = 2 * round(64 * fs / 8000) if self.order is None else self.order
        passband = 0.45 * fs if self.passband is None else self.passband
        if passband < 1e-9 * fs:
            raise BadValue(
                f"differentiator: nothing passes to {passband:g} Hz at fs = {fs:g} Hz; give a"
                " larger passband"
            )
        if passband >= fs / 2:
            good = (
                p for p in fs / 2 ** np.arange(3.0, 9) if self._taps(fs, p, order).error <= self.tol
            )
            raise BadValue(
                f"differentiator: a pass band to {passband:g} Hz does not fit below fs/2 ="
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
        """Stop edge for this pass edge, which may be another than that asked for; None
        where nothing is left to be stopped.
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
    """Differentiate in a band by a FIR filter with linear phase (type III,
    near-minimax).

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
