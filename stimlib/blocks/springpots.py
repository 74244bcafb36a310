"""Springpots: fractional derivatives of a displacement, by several schemes."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass
from functools import cache

import numpy as np

from ..core import units as un
from ..core.graph import NONE, ONE, Block, as_block, in_unit, scratch, unitless
from ..core.maths import (
    chebyshev,
    copy,
    each,
    exp,
    fir,
    floor,
    fma,
    log,
    memory,
    moderate_exp,
    sin,
    where,
)
from ..core.response import backward
from ..core.units import unit
from ..design import fractional as soe, responses
from ..design.padding import eights, padded
from ..errors import Above0, BadValue, UnitError, one_of
from ..system.limits import limits
from .onset import ONSETS, check_onset
from .tables import Table, TableParams

# The springpot f = chi D^alpha y: between a spring (alpha = 0) and a dashpot (alpha =
# 1), with all of its history.
#
# The order acts on the differences d[n] = y[n] - y[n-1]: f[n] = chi h^-alpha sum_j v_j
# d[n-j]. The newest eight weights are taps, the others exponential modes
# (``stimlib.design.fractional``), so a sample costs the same in the first second and
# after hours.
METHODS = ("gl", "l1", "gl-downsampled", "gl-short-memory")

NAN, PI = math.nan, math.pi
COEFFICIENTS = soe.DEGREE + 1
# scratch: 73 positions, 72 differences, 64 sums, 512 for ``memory``
DIFFERENCES, SUMS, WORK = 80, 160, 224
# while an order moves, weights are made for so many samples at once; in the scratch are
# taps and weights of modes
RAMP, TAPS, ROWS = 16, 400, 736


# Shared by all ------------------------------------------------------------------------
def origin(cold, last, x):
    """Return the position before the sample x.

    At the first sample it is x itself, or 0 if the onset is a step.
    """
    return where(cold > 0.0, where(cold > 1.0, 0.0, x), last)


def begin(s, x):
    """Return the position before contact.

    At the first sample the stored nine positions are set to it.
    """
    first = origin(s.cold, s.first, x)
    for i in range(s.line.size):
        s.line[i] = where(s.cold > 0.0, first, s.line[i])
    return first


def difference(line, x, w):
    """Compute the differences of positions from nine samples ago on, in the scratch."""
    z, d = w[: x.size + 9], w[DIFFERENCES : DIFFERENCES + x.size + 8]
    copy(line, z)
    copy(x, z[9:])
    for i in range(d.size):
        d[i] = z[i + 1] - z[i]
    copy(z[x.size :], line)


def remember(e, r, taps, constant, scale, q, low, first, y, w):
    """Compute the springpot's sum over the whole history of position differences.

    The differences are in the scratch array.
    """
    n = y.size
    part = w[SUMS : SUMS + n]
    memory(e, r, q, low, w[DIFFERENCES : DIFFERENCES + n], part, w[WORK:])
    fir(taps, w[DIFFERENCES + 1 : DIFFERENCES + 8 + n], y)
    for i in range(n):
        y[i] = scale * fma(constant, w[i + 1] - first, y[i] + part[i])


def plain(alpha, fs, first, y, w):
    """Compute springpots of order 0 (displacement) and 1 (difference times fs)."""
    for i in range(y.size):
        y[i] = where(alpha > 0.5, w[DIFFERENCES + 8 + i] * fs, w[9 + i] - first)


# Parameters of `Springpot` at a sample rate.
#   e         leaks of the modes, rising; padded with ones
#   r         their weights
#   taps      v_7 .. v_0
#   constant  weight of the mode that never decays
#   scale     fs^alpha
SpringpotParams = namedtuple("SpringpotParams", "e r taps constant scale alpha fs")

# State of `Springpot` between samples.
#   line   the last nine positions
#   q      modes
#   low    second words of the slowest
#   first  position before contact
SpringpotState = namedtuple("SpringpotState", "line q low first cold")


def first_state(onset: str, modes: int = 0, fine: int = 0) -> SpringpotState:
    """Return the first state of a springpot's sum."""
    return SpringpotState(
        np.zeros(9), np.zeros(eights(modes)), np.zeros(eights(fine)), 0.0, ONSETS[onset]
    )


def leaks(r: soe.Rates) -> np.ndarray:
    """Return 1 - exp(-s), accurate even for the slowest modes."""
    return padded(-np.expm1(-r.s), 1.0)


def transfer(p, alpha, scale, taps, constant, r, z):
    """Return the frequency response of the springpot's sum over differences.

    At 0 Hz it is the response that remains when a position is held for ever.
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
    """Return the unit N for a position in m, and no unit for one without."""
    if y == un.ONE:
        return un.ONE
    if y != unit("m"):
        raise UnitError(f"{name}: the position y is in {y}, not in m")
    return unit("N")


def check_fields(b, schemes: tuple[str, ...] = soe.SCHEMES) -> None:
    """Raise BadValue where a design number of a springpot makes no sense."""
    check_onset("springpot", getattr(b, "onset", "step"))
    if hasattr(b, "tol"):
        soe.rates(b.tol, 1e6)
        one_of("springpot: scheme", b.scheme, schemes)
    if hasattr(b, "order") and not 0 <= b.order <= 1:
        raise BadValue(f"springpot: alpha = {b.order:g} must be from 0 (spring) to 1 (dashpot)")


# A fixed order ------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Springpot(Block):
    """Fractional derivative D^alpha y of a fixed order (a springpot with chi = 1).

    f[n] = fs^alpha (sum_{j<8} v_j d[n-j] + c (y[n-8] - y[-1]) + sum_k r_k b_k),
    b_k += d[n-8] - e_k b_k.

    With the scheme "straight", y is the running sum of a force that is linear between
    samples, and the output is the fractional integral of that force: see
    ``compliance``.
    """

    y: Block
    contact: Block
    order: float
    scheme: str
    tol: float
    horizon: Above0
    onset: str
    begins_early = False
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

    work = scratch(WORK + 512)

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
# Parameters of `SpringpotLive` at a sample rate.
#   a        weight of mode k: g a exp(alpha L); the first is the mode that never
#            decays, then as e
#   high     L in two words
#   poly     Chebyshev coefficients beside each other: those of the taps v_7 .. v_0,
#            then g of the slowest modes
#   nodes    that many have a polynomial for g
#   fs_high  log(fs) in two words
LiveParams = namedtuple("LiveParams", "e a high rest poly nodes fs_high fs_rest fs")

# State of `SpringpotLive` between samples.
#   r      weights that belong to alpha
#   alpha  -1: none yet
LiveState = namedtuple("LiveState", "line q low r taps constant scale alpha first cold")


def power(alpha, high, rest):
    """Return exp(alpha (high + rest)), where high + rest is a logarithm."""
    t = alpha * high
    e = moderate_exp(t)
    return fma(e, fma(alpha, high, -t) + alpha * rest, e)


def limited(order):
    """Return an order limited to 0 to 1, and 0 for NaN."""
    return where(order >= 0.0, where(order <= 1.0, order, 1.0), 0.0)


def finish(order, y, step, way):
    """Return the output for any order; y is the output for orders between 0 and 1.

    An order outside of 0 to 1 is a fault.
    """
    alpha = limited(order)
    ends = where(alpha > 0.5, step, way)
    y = where(alpha == 0.0, ends, where(alpha == 1.0, ends, y))
    return where(alpha == order, y, NAN)


def near_sum(taps, d):
    """Return one output of an FIR filter of eight taps, with the bits of maths.fir."""
    a, e = fma(taps[0], d[0], 0.0), fma(taps[4], d[4], 0.0)
    b, f = fma(taps[1], d[1], 0.0), fma(taps[5], d[5], 0.0)
    c, g = fma(taps[2], d[2], 0.0), fma(taps[6], d[6], 0.0)
    h, k = fma(taps[3], d[3], 0.0), fma(taps[7], d[7], 0.0)
    return ((a + e) + (c + g)) + ((b + f) + (h + k))


# A factor that depends on the order: factor exp(alpha (high + rest)).
Power = namedtuple("Power", "factor high rest")

# An order of a springpot.
Order = namedtuple("Order", "alpha")


def at_order(p, order):
    """Return a factor that depends on the order."""
    return p.factor * power(limited(order), p.high, p.rest)


def gain_at(p, order):
    """Return the factor of all weights on the grid."""
    alpha = limited(order)
    return sin(PI * where(alpha > 0.5, 1.0 - alpha, alpha)) / PI


def weight(p, gain, a, high, rest):
    """Return the weight of a mode for an order."""
    return gain * (a * power(p.alpha, high, rest))


def centred(p, order):
    """Return an order, from 0 to 1, as a number from -1 to 1."""
    return 2.0 * limited(order) - 1.0


def reweigh(p, orders, r, taps, w):
    """Compute the weights of modes and taps for up to 16 orders, one row for each.

    w receives the weights of the mode that never decays, from element 0 on, and the
    scales, from element 16 on; the rest of it is scratch.
    """
    k, n, m = orders.size, p.e.size, np.int64(p.nodes)
    many = 8 * np.int64(floor(0.125 * p.nodes + 1.875))
    constants, gains, series = w[:k], w[32 : 32 + k], w[48 : 48 + many * k]
    each(at_order, Power(1.0, p.fs_high, p.fs_rest), (orders,), w[16 : 16 + k])
    each(at_order, Power(p.a[0], p.high[0], p.rest[0]), (orders,), constants)
    each(centred, (), (orders,), gains)
    chebyshev(p.poly, gains, series)
    each(gain_at, (), (orders,), gains)
    for i in range(k):
        left, own, row = 1.0 - limited(orders[i]), series[many * i :], r[n * i : n * (i + 1)]
        for j in range(7):
            taps[8 * i + j] = left * own[j]
        taps[8 * i + 7] = own[7]
        constants[i] = left * own[8] * constants[i]
        row[:] = gains[i]
        for j in range(m - 1):
            row[j] = left * own[9 + j]
    for i in range(k):
        row = r[n * i : n * (i + 1)]
        each(weight, Order(limited(orders[i])), (row, p.a[1:], p.high[1:], p.rest[1:]), row)


@cache  # every scene with a live order needs it, mostly with the same numbers
def live_orders(tol: float, samples: float, scheme: str) -> tuple[soe.Rates, soe.LiveOrders]:
    """Return the rates and weights of a springpot whose order is a signal."""
    rates = soe.rates(tol, samples)
    return rates, soe.live(rates, scheme)


@dataclass(frozen=True, eq=False)
class SpringpotLive(Block):
    """Fractional derivative like ``Springpot``, with the order as a signal.

    The modes do not depend on the order; their weights are recomputed when it changes.
    """

    y: Block
    alpha: Block
    contact: Block
    scheme: str
    tol: float
    horizon: Above0
    onset: str
    begins_early = False
    resettable = True

    check = check_fields

    def units(self, *u):
        in_unit("springpot: alpha", self.alpha, u[1], "")
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
        m = len(rates.x)
        rows = live.poly.reshape(-1, COEFFICIENTS)
        series = np.concatenate([rows[: m - 1 : -1], rows[:m], np.zeros((-m % 8, COEFFICIENTS))])
        p = LiveParams(e, a, longs, shorts, series.T.ravel().copy(), float(m), high, rest, fs)
        s = first_state(self.onset, rates.s.size, rates.fine)
        return p, LiveState(
            s.line, s.q, s.low, np.zeros(e.size), np.zeros(8), 0.0, 0.0, -1.0, s.first, s.cold
        )

    @staticmethod
    def work(p):
        return ROWS + 48 + RAMP * (p.e.size + p.poly.size // COEFFICIENTS)

    @staticmethod
    def tile(p, s, x, order, y, w):
        first, n, size = begin(s, x[0]), x.size, p.e.size
        constant, scale, alpha, start, stays = s.constant, s.scale, s.alpha, 0, NONE
        difference(s.line, x, w)
        for i in range(n):
            stays = stays + where(order[i] == order[0], ONE, NONE)
        for i in range(np.int64(where(stays == np.uint64(n), n - 1.0, 0.0)), n):
            m, last = i + 1 - start, i + 1 == n
            if start + 1 < n and order[start] != order[start + 1]:  # it moves
                if last or m == RAMP or (i + 2 < n and order[i + 1] == order[i + 2]):
                    rows, taps, made = w[ROWS : ROWS + m * size], w[TAPS:], w[ROWS + RAMP * size :]
                    d, part = w[DIFFERENCES + start :], w[SUMS + start : SUMS + i + 1]
                    reweigh(p, order[start : i + 1], rows, taps, made)
                    memory(p.e, rows, s.q, s.low, d[:m], part, w[WORK:])
                    for k in range(m):
                        near = near_sum(taps[8 * k :], d[k + 1 :]) + part[k]
                        one = made[RAMP + k] * fma(made[k], w[start + k + 1] - first, near)
                        step, way = d[8 + k] * p.fs, w[start + k + 9] - first
                        y[start + k] = finish(order[start + k], one, step, way)
                    copy(rows[(m - 1) * size :], s.r)
                    copy(taps[8 * m - 8 : 8 * m], s.taps)
                    constant, scale, alpha = made[m - 1], made[RAMP + m - 1], limited(order[i])
                    start = i + 1
            elif last or order[i] != order[i + 1]:
                if limited(order[i]) != alpha:
                    alpha = limited(order[i])
                    reweigh(p, order[i : i + 1], s.r, s.taps, w[ROWS:])
                    constant, scale = w[ROWS], w[ROWS + RAMP]
                out, here = y[start : i + 1], w[start:]
                remember(p.e, s.r, s.taps, constant, scale, s.q, s.low, first, out, here)
                if alpha == 0.0 or alpha == 1.0 or alpha != order[i]:
                    for k in range(m):
                        step, way = here[DIFFERENCES + 8 + k] * p.fs, here[9 + k] - first
                        out[k] = finish(order[i], out[k], step, way)
                start = i + 1
        return LiveState(s.line, s.q, s.low, s.r, s.taps, constant, scale, alpha, first, 0.0)


# The certificate ----------------------------------------------------------------------
# State of `PathLength` between samples.
PathState = namedtuple("PathState", "length last cold")


@dataclass(frozen=True, eq=False)
class PathLength(Block):
    """Length of the path since contact, sum |y[n] - y[n-1]|.

    A monotone movement with the same steps would have this displacement.
    """

    y: Block
    contact: Block
    onset: str
    begins_early = False
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
    """Return an array of orders and ``soe.bound`` of each."""
    knots = np.concatenate([[0.0], np.geomspace(1e-7, 1e-2, 24), np.linspace(0.02, 1.0, 99)])
    return knots, np.array([soe.bound(soe.rates(tol, samples), float(a)) for a in knots])


@dataclass(frozen=True, eq=False)
class Accuracy(Table):
    """The relative error bound e(alpha) of ``soe.bound``.

    It is the error of a springpot relative to its response to a monotone movement with
    the same steps.
    """

    alpha: Block
    tol: float
    horizon: Above0

    def check(self):
        soe.rates(self.tol, 1e6)

    units = unitless

    def design(self, fs):
        knots, bounds = bounds_of_orders(self.tol, self.horizon * fs)
        # straight lines between knots; the sum of moduli is made with the same modes
        margin = 1.02 + 2 * self.tol
        values = margin * bounds
        c = np.zeros((4, knots.size - 1))
        c[2], c[3] = np.diff(values) / np.diff(knots), values[:-1]
        return TableParams(knots, c.T.ravel().copy(), 0.0, 1.0, 0.0), ()


# The thesis' methods ----------------------------------------------------------------
# The thesis' own methods for a springpot: a history that is thinned out, and one that
# is cut off.
POINTS = 100  # of history that gl-downsampled sums
LONGEST = 1 << 24  # samples of history that gl-downsampled keeps at most


def binomials(alpha: float, n: int) -> np.ndarray:
    """Return the binomial weights w_j = (-1)^j binom(alpha, j) for j < n."""
    return np.cumprod([1.0, *((j - 1 - alpha) / j for j in range(1, n))])


@dataclass(frozen=True, eq=False)
class Method(Block, abstract=True):
    """Base class of the thesis's methods for the fractional derivative D^alpha y."""

    y: Block
    contact: Block
    order: float
    begins_early = False

    check = check_fields

    def units(self, *u):
        return force_unit("springpot", u[0])


# Parameters of `Downsampled` at a sample rate.
DownsampledParams = namedtuple("DownsampledParams", "weights scale alpha")

# State of `Downsampled` between samples.
#   past  all positions since contact
#   k     samples since contact
DownsampledState = namedtuple("DownsampledState", "past first k cold")


@dataclass(frozen=True, eq=False)
class Downsampled(Method):
    """D^alpha y from every m-th sample of the whole history.

    At step k, m = ceil(k/100), and the step size is m/fs.
    """

    horizon: Above0
    onset: str

    def design(self, fs):
        n = self.horizon * fs
        if n > LONGEST:
            raise BadValue(
                f"springpot: gl-downsampled keeps the whole history, {n:.9g} samples for horizon ="
                f" {self.horizon:g} s at {fs:g} Hz; give the longest contact as horizon, at most"
                f" {0.999 * LONGEST / fs:.4g}"
            )
        p = DownsampledParams(
            binomials(self.order, POINTS + 1), math.pow(fs, self.order), self.order
        )
        return p, DownsampledState(np.zeros(max(math.ceil(n), 1)), 0.0, 0.0, ONSETS[self.onset])

    @staticmethod
    def tile(p, s, x, contact, y):
        most = s.past.size * 1.0
        k = where(s.k > 0.0, where(s.k < most, s.k, most), 0.0)  # a state may come from anywhere
        first, cold = s.first, s.cold
        stride, scale = 1.0, p.scale
        for i in range(x.size):
            if contact[i] > 0.0:
                first, k, cold = origin(cold, first, x[i]), where(cold > 0.0, 0.0, k), 0.0
                if k < most:
                    now = np.uint64(k)
                    s.past[now] = x[i] - first
                    m = where(k > 0.0, floor((k + (POINTS - 1)) / POINTS), 1.0)
                    if m != stride:  # each of a hundred samples
                        stride = m
                        scale = p.scale * where(m > 1.0, exp(-p.alpha * log(m)), 1.0)
                    total = 0.0
                    for j in range(np.int64(floor(k / m)) + 1):
                        total = fma(p.weights[j], s.past[now - np.uint64(j) * np.uint64(m)], total)
                    y[i] = scale * total
                    k = k + 1.0
                else:
                    y[i] = NAN
            else:
                y[i], first, k, cold = 0.0, 0.0, 0.0, where(cold > 0.0, cold, 1.0)
        return DownsampledState(s.past, first, k, cold)


# Parameters of `ShortMemory` at a sample rate.
#   taps  oldest first, zeros in front
ShortMemoryParams = namedtuple("ShortMemoryParams", "taps")

# State of `ShortMemory` between samples.
ShortMemoryState = namedtuple("ShortMemoryState", "line first cold")


@dataclass(frozen=True, eq=False)
class ShortMemory(Method):
    """D^alpha y from only the last seconds of the history."""

    seconds: Above0
    onset: str
    resettable = True

    def design(self, fs):
        limits.check(
            "state_bytes",
            8 * self.seconds * fs,
            f"gl-short-memory: bytes of its samples at fs = {fs:g} Hz",
        )
        taps = padded(
            math.pow(fs, self.order) * binomials(self.order, max(1, round(self.seconds * fs)))
        )[::-1].copy()
        return ShortMemoryParams(taps), ShortMemoryState(
            np.zeros(taps.size - 1), 0.0, ONSETS[self.onset]
        )

    @staticmethod
    def work(p):
        return p.taps.size + 63

    @staticmethod
    def tile(p, s, x, y, w):
        first, n, h = origin(s.cold, s.first, x[0]), x.size, s.line.size
        copy(s.line, w)
        for k in range(n):
            w[h + k] = x[k] - first
        fir(p.taps, w[: h + n], y)
        copy(w[n : n + h], s.line)
        return ShortMemoryState(s.line, first, 0.0)

    @staticmethod
    def transfer(p, z):
        return np.polyval(p.taps, 1 / z)
