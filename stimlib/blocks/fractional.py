"""The springpot f = chi D^alpha y: between a spring (alpha = 0) and a dashpot (alpha =
1), with all of its history.

The order acts on the differences d[n] = y[n] - y[n-1]: f[n] = chi h^-alpha sum_j v_j
d[n-j].  The newest eight weights are taps, the others exponential modes
(``stimlib.design.exponentials``), so a sample costs the same in the first second and
after hours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from ..core import units as un
from ..core.graph import Block, as_block, positive
from ..core.maths import copy, exp, fir, fma, memory, sin, where
from ..core.response import backward
from ..core.units import unit
from ..design import exponentials as soe
from ..design import responses
from ..design.eights import eights, padded
from ..errors import BadValue, UnitError
from .onset import ONSETS, check_onset
from .table import Table, TableParams

METHODS = ("gl", "l1", "gl-downsampled", "gl-short-memory")

NAN, PI = math.nan, math.pi
COEFFICIENTS = soe.DEGREE + 1
# scratch: 73 positions, 72 differences, 64 sums, 512 for ``memory``
DIFFERENCES, SUMS, WORK = 80, 160, 224


# Shared by all ------------------------------------------------------------------------
def origin(cold, last, x):
    """Position before x: at the first sample x itself, or 0 if the onset is a step."""
    return where(cold > 0.0, where(cold > 1.0, 0.0, x), last)


def begin(s, x):
    """Position before contact; at the first sample the last nine are set to it."""
    first = origin(s.cold, s.first, x)
    for i in range(s.line.size):
        s.line[i] = where(s.cold > 0.0, first, s.line[i])
    return first


def difference(line, x, w):
    """Positions from nine samples ago on, and their differences, into the scratch."""
    z, d = w[: x.size + 9], w[DIFFERENCES : DIFFERENCES + x.size + 8]
    copy(line, z)
    copy(x, z[9:])
    for i in range(d.size):
        d[i] = z[i + 1] - z[i]
    copy(z[x.size :], line)


def remember(e, r, taps, constant, scale, q, low, first, y, w):
    """Sum over the whole history of the differences in the scratch."""
    n = y.size
    part = w[SUMS : SUMS + n]
    memory(e, r, q, low, w[DIFFERENCES : DIFFERENCES + n], part, w[WORK:])
    fir(taps, w[DIFFERENCES + 1 : DIFFERENCES + 8 + n], y)
    for i in range(n):
        y[i] = scale * fma(constant, w[i + 1] - first, y[i] + part[i])


def plain(alpha, fs, first, y, w):
    """The orders 0 and 1: way from the first position, and difference times fs."""
    for i in range(y.size):
        y[i] = where(alpha > 0.5, w[DIFFERENCES + 8 + i] * fs, w[9 + i] - first)


class SpringpotParams(NamedTuple):
    e: np.ndarray  # leaks of the modes, rising; padded with ones
    r: np.ndarray  # their weights
    taps: np.ndarray  # v_7 .. v_0
    constant: float  # weight of the mode that never decays
    scale: float  # fs^alpha
    alpha: float
    fs: float


class SpringpotState(NamedTuple):
    line: np.ndarray  # the last nine positions
    q: np.ndarray  # modes
    low: np.ndarray  # second words of the slowest
    first: float  # position before contact
    cold: float


def first_state(onset: str, modes: int = 0, fine: int = 0) -> SpringpotState:
    return SpringpotState(
        np.zeros(9), np.zeros(eights(modes)), np.zeros(eights(fine)), 0.0, ONSETS[onset]
    )


def leaks(r: soe.Rates) -> np.ndarray:
    """1 - exp(-s): the slow modes live on its last digits."""
    return padded(-np.expm1(-r.s), 1.0)


def transfer(p, alpha, scale, taps, constant, r, z):
    """Response of the sum, from differences on; 0 Hz is what is left of a movement
    after an endless hold.
    """
    zi = 1 / z
    if alpha == 0:
        return np.ones_like(z)
    if alpha == 1:
        return p.fs * backward(z)
    d, near = backward(z), np.polyval(taps, zi)
    modes = np.sum(r / (d[..., None] + p.e * zi[..., None]), axis=-1)
    return scale * (d * (near + zi**soe.DIRECT * modes) + constant * zi**soe.DIRECT)


def force_unit(name: str, y: un.Unit) -> un.Unit:
    """N from a position in m; no unit from a number without one."""
    if y == un.ONE:
        return un.ONE
    if y != unit("m"):
        raise UnitError(f"{name}: the position y is in {y}, not in m")
    return unit("N")


def check_fields(b, schemes: tuple[str, ...] = soe.SCHEMES) -> None:
    """Raise BadValue where a design number of a springpot makes no sense."""
    positive(b, "seconds" if hasattr(b, "seconds") else "horizon")
    check_onset("springpot", getattr(b, "onset", "step"))
    if hasattr(b, "tol"):
        soe.rates(b.tol, 1e6)
        if b.scheme not in schemes:
            raise BadValue(f"springpot: scheme = {b.scheme!r}; choose one of {', '.join(METHODS)}")
    if hasattr(b, "order") and not 0 <= b.order <= 1:
        raise BadValue(f"springpot: alpha = {b.order:g} must be from 0 (spring) to 1 (dashpot)")


# A fixed order ------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Springpot(Block):
    """D^alpha y of a fixed order, for chi = 1.

    f[n] = fs^alpha (sum_{j<8} v_j d[n-j] + c (y[n-8] - y[-1]) + sum_k r_k b_k),
    b_k += d[n-8] - e_k b_k.

    With the scheme "straight", y is the running sum of a force that is straight between
    samples, and what comes out is that force's fractional integral: see ``compliance``.
    """

    y: Block
    contact: Block
    order: float
    scheme: str
    tol: float
    horizon: float
    onset: str
    resettable = True

    def check(self):
        check_fields(self, (*soe.SCHEMES, soe.STRAIGHT))

    def units(self, *u):
        return force_unit("springpot", u[0])

    def design(self, fs):
        if self.order in (0.0, 1.0):
            none = np.zeros(0)
            return SpringpotParams(none, none, none, 0.0, 1.0, self.order, fs), first_state(
                self.onset
            )
        rates = soe.rates(self.tol, self.horizon * fs, self.scheme)
        w = soe.weights(rates, self.scheme, self.order)
        e = leaks(rates)
        p = SpringpotParams(
            e,
            padded(w.modes),
            w.taps[::-1].copy(),
            w.constant,
            math.pow(fs, self.order),
            self.order,
            fs,
        )
        return p, first_state(self.onset, rates.s.size, rates.fine)

    def laws(self, fs):
        if self.horizon * fs < responses.SHORTEST:
            return ()
        return (responses.springpot(self.order, self.scheme, self.tol, self.horizon, fs),)

    @staticmethod
    def work(p):
        return WORK + 512

    @staticmethod
    def tile(p, s, x, y, w):
        first = begin(s, x[0])
        difference(s.line, x, w)
        if p.alpha == 0.0 or p.alpha == 1.0:
            plain(p.alpha, p.fs, first, y, w)
        else:
            remember(p.e, p.r, p.taps, p.constant, p.scale, s.q, s.low, first, y, w)
        return SpringpotState(s.line, s.q, s.low, first, 0.0)

    @staticmethod
    def transfer(p, z):
        return transfer(p, p.alpha, p.scale, p.taps, p.constant, p.r, z)


# A live order -------------------------------------------------------------------------
class LiveParams(NamedTuple):
    e: np.ndarray
    # weight of mode k: g a exp(alpha L); the first is the mode that never decays, then
    # as e
    a: np.ndarray
    high: np.ndarray  # L in two words
    rest: np.ndarray
    poly: np.ndarray
    nodes: float  # that many have a polynomial for g
    fs_high: float  # log(fs) in two words
    fs_rest: float
    fs: float


class LiveState(NamedTuple):
    line: np.ndarray
    q: np.ndarray
    low: np.ndarray
    r: np.ndarray  # weights that belong to alpha
    taps: np.ndarray
    constant: float
    scale: float
    alpha: float  # -1: none yet
    first: float
    cold: float


def power(alpha, high, rest):
    """exp(alpha (high + rest)), the product in two words."""
    t = alpha * high
    e = exp(t)
    return fma(e, fma(alpha, high, -t) + alpha * rest, e)


def chebyshev(c, start, n, t):
    """sum_{k<n} c[start + k] T_k(t), Clenshaw's recurrence."""
    a, b = 0.0, 0.0
    for k in range(1, n):
        now = fma(2.0 * t, a, c[start + n - k] - b)
        b = a
        a = now
    return fma(t, a, c[start] - b)


def reweigh(p, alpha, r, taps):
    """Weights of the modes and taps at an order; the constant mode's comes back."""
    n = COEFFICIENTS
    t = 2.0 * alpha - 1.0
    left = 1.0 - alpha
    gain = sin(PI * where(alpha > 0.5, left, alpha)) / PI
    m = np.int64(p.nodes)
    for k in range(1, m):
        r[k - 1] = (
            left * chebyshev(p.poly, k * n, n, t) * (p.a[k] * power(alpha, p.high[k], p.rest[k]))
        )
    for k in range(m, p.a.size):
        r[k - 1] = gain * (p.a[k] * power(alpha, p.high[k], p.rest[k]))
    for j in range(taps.size - 1):
        taps[j] = left * chebyshev(p.poly, (m + taps.size - 1 - j) * n, n, t)
    taps[taps.size - 1] = chebyshev(p.poly, m * n, n, t)
    return left * chebyshev(p.poly, 0, n, t) * (p.a[0] * power(alpha, p.high[0], p.rest[0]))


@cache  # every scene with a live order needs it, mostly with the same numbers
def live_orders(tol: float, samples: float, scheme: str) -> tuple[soe.Rates, soe.LiveOrders]:
    rates = soe.rates(tol, samples)
    return rates, soe.live(rates, scheme)


@dataclass(frozen=True, eq=False)
class SpringpotLive(Block):
    """``Springpot`` with the order as a signal: modes do not depend on it, weights are
    made anew where it changes.
    """

    y: Block
    alpha: Block
    contact: Block
    scheme: str
    tol: float
    horizon: float
    onset: str
    resettable = True

    def check(self):
        check_fields(self)

    def units(self, *u):
        if u[1] != un.ONE:
            raise UnitError(
                f"springpot: the order alpha {self.alpha!r} is in {u[1]}, it must be without unit"
            )
        return force_unit("springpot", u[0])

    def fixed(self, *values):
        alpha, contact = values
        return Springpot(
            self.y, as_block(contact), alpha, self.scheme, self.tol, self.horizon, self.onset
        )

    def design(self, fs):
        rates, live = live_orders(self.tol, self.horizon * fs, self.scheme)
        e, (high, rest) = leaks(rates), soe.two_words(fs)
        n = e.size + 1
        a, longs, shorts = (padded(v, n=n) for v in (live.a, live.high, live.low))
        p = LiveParams(e, a, longs, shorts, live.poly, float(len(rates.x)), high, rest, fs)
        s = first_state(self.onset, rates.s.size, rates.fine)
        return p, LiveState(
            s.line, s.q, s.low, np.zeros(e.size), np.zeros(8), 0.0, 0.0, -1.0, s.first, s.cold
        )

    @staticmethod
    def work(p):
        return WORK + 512

    @staticmethod
    def tile(p, s, x, order, y, w):
        first, constant, scale, alpha, start = begin(s, x[0]), s.constant, s.scale, s.alpha, 0
        for i in range(x.size):
            if i + 1 == x.size or order[i] != order[i + 1]:
                part, out = x[start : i + 1], y[start : i + 1]
                a = where(order[i] >= 0.0, where(order[i] <= 1.0, order[i], 1.0), 0.0)
                if a != alpha:
                    alpha = a
                    constant = reweigh(p, alpha, s.r, s.taps)
                    scale = power(alpha, p.fs_high, p.fs_rest)
                difference(s.line, part, w)
                remember(p.e, s.r, s.taps, constant, scale, s.q, s.low, first, out, w)
                if alpha == 0.0 or alpha == 1.0:
                    plain(alpha, p.fs, first, out, w)
                if a != order[i]:  # outside 0 .. 1, or nan
                    for k in range(out.size):
                        out[k] = NAN
                start = i + 1
        return LiveState(s.line, s.q, s.low, s.r, s.taps, constant, scale, alpha, first, 0.0)


# The certificate ----------------------------------------------------------------------
class PathState(NamedTuple):
    length: float
    last: float
    cold: float


@dataclass(frozen=True, eq=False)
class PathLength(Block):
    """sum |y[n] - y[n-1]| since contact: the monotone movement with the same steps."""

    y: Block
    contact: Block
    onset: str
    resettable = True

    def check(self):
        check_onset("path length", self.onset)

    def design(self, fs):
        return (), PathState(0.0, 0.0, ONSETS[self.onset])

    @staticmethod
    def step(p, s, y):
        length = s.length + abs(y - origin(s.cold, s.last, y))
        return length, PathState(length, y, 0.0)


@cache  # 123 bounds take longer than all else of a springpot
def bounds_of_orders(tol: float, samples: float) -> tuple[np.ndarray, np.ndarray]:
    """Orders, and ``soe.bound`` of each."""
    knots = np.concatenate([[0.0], np.geomspace(1e-7, 1e-2, 24), np.linspace(0.02, 1.0, 99)])
    return knots, np.array([soe.bound(soe.rates(tol, samples), float(a)) for a in knots])


@dataclass(frozen=True, eq=False)
class Accuracy(Table):
    """e(alpha) of ``soe.bound``: the error of a springpot over what the same movement
    without any way back would make.
    """

    alpha: Block
    tol: float
    horizon: float

    def check(self):
        positive(self, "horizon")
        soe.rates(self.tol, 1e6)

    def units(self, *u):
        return un.ONE

    def design(self, fs):
        knots, bounds = bounds_of_orders(self.tol, self.horizon * fs)
        # straight lines between knots; the sum of moduli is made with the same modes
        margin = 1.02 + 2 * self.tol
        values = margin * bounds
        c = np.zeros((4, knots.size - 1))
        c[2], c[3] = np.diff(values) / np.diff(knots), values[:-1]
        return TableParams(knots, c.T.ravel().copy(), 0.0, 1.0), ()
