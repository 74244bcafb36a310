"""Laws of linear blocks: responses in closed form, and rows as sums over inputs.

Nothing of a recursion is run.  A response is taps, or a sum of modes r exp(n L) in
extended precision, whose poles come from their formulas (of pinking, whose poles are
fitted, from the design: the law of its spectrum holds them).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

# which loads its parts where they are used: all of them would be a second of each start
import scipy

from ..blocks.noise import White
from . import laws
from .rows import Row, Rows, law, touched

LONG, COMPLEX = np.longdouble, np.clongdouble
PI = np.arctan(LONG(1)) * 4
GONE = 48.0  # of a decay, in time constants: 1e-21


class Modes(NamedTuple):
    """h[0] = direct, h[n] = sum of r exp((n - 1) L)."""

    direct: Any
    r: np.ndarray
    L: np.ndarray

    def response(self, n: int) -> Row:
        """h[0] .. h[n - 1]; powers as products of those of 64 samples and of one."""
        n = min(n, int(min(n, GONE / max(-float(self.L.real.max(initial=-LONG(1e9))), 1e-9))) + 2)
        far, near = (
            np.exp(np.multiply.outer(k, self.L)) for k in (np.arange(0, n, 64), np.arange(64))
        )
        return np.r_[self.direct, ((far * self.r) @ near.T).real.ravel()][:n]


# Poles and zeros of the four families -------------------------------------------------
def prototype(kind: str, n: int, ripple: float, attenuation: float) -> tuple[Row, Row, Any]:
    """Zeros, poles and gain of the low-pass whose edge is 1."""
    e = np.sqrt(np.expm1(LONG(ripple) * np.log(LONG(10)) / 10))
    zeros, level, turns = np.zeros(0, COMPLEX), LONG(1), PI * (2 * np.arange(n) + 1) / (2 * n)
    if kind == "butterworth":
        poles = np.exp(1j * (turns + PI / 2))
    elif kind == "chebyshev1":
        poles = -np.sinh(np.arcsinh(1 / e) / n) * np.sin(turns) + 1j * np.cosh(
            np.arcsinh(1 / e) / n
        ) * np.cos(turns)
    elif kind == "bessel":
        f = np.array(
            [
                math.factorial(n + k) / (2**k * math.factorial(k) * math.factorial(n - k))
                for k in range(n + 1)
            ],
            LONG,
        )
        edge = scipy.optimize.brentq(
            lambda w: abs(np.polyval(f, 1j * w) / f[-1]) ** 2 - 2,
            0.5 * math.sqrt(n),
            math.sqrt(2 * n),
            xtol=1e-16,
        )
        poles = np.roots(f.astype(float)).astype(COMPLEX)
        for _ in range(6):  # Newton's method doubles the digits
            poles = poles - np.polyval(f, poles) / np.polyval(np.polyder(f), poles)
        poles = poles / edge
    # theta functions of the nome q, which the order takes to the root (Orfanidis 2006,
    # Lecture Notes on Elliptic Filters)
    else:
        m1 = float(e * e / np.expm1(LONG(attenuation) * np.log(LONG(10)) / 10))
        q = np.exp(-PI * LONG(scipy.special.ellipkm1(m1)) / scipy.special.ellipk(m1) / n)
        j = np.arange(40)
        one = 2 * q**0.25 * np.sum(q ** (j * (j + 1.0)))
        other = 1 + 2 * np.sum(q ** (j[1:] ** 2.0))

        def cd(u: Row) -> Row:  # of quarter periods
            z = np.multiply.outer(u, (2 * j + 1) * PI / 2), np.multiply.outer(u, 2 * j[1:] * PI / 2)
            top = 2 * q**0.25 * np.sum(q ** (j * (j + 1.0)) * np.cos(z[0]), axis=-1)
            return other / one * top / (1 + 2 * np.sum(q ** (j[1:] ** 2.0) * np.cos(z[1]), axis=-1))

        v = scipy.special.ellipkinc(float(np.arctan(1 / e)), 1 - m1) / (
            n * scipy.special.ellipk(m1)
        )
        poles = 1j * cd((2 * np.arange(1, n + 1) - 1) / LONG(n) - 1j * v)
        zeros = 1j / ((one / other) ** 2 * cd((2 * np.arange(1, n // 2 + 1) - 1) / LONG(n)))
        zeros = np.r_[zeros, -zeros]
    if kind in ("chebyshev1", "elliptic") and n % 2 == 0:
        level = 1 / np.sqrt(1 + e * e)
    return zeros, poles, level * (np.prod(-poles) / np.prod(-zeros)).real


def analogue(band: str, edges: tuple[float, ...], *family: Any) -> tuple[Row, Row, Any]:
    """Zeros, poles and gain in s = (z - 1)/(z + 1), edges in cycles per sample."""
    zeros, poles, gain = prototype(*family)
    w, more = [np.tan(PI * LONG(e)) for e in edges], np.zeros(poles.size - zeros.size, COMPLEX)
    if band == "lowpass":
        return w[0] * zeros, w[0] * poles, gain * w[0] ** more.size
    if band in ("highpass", "bandstop"):
        zeros, poles, gain = 1 / zeros, 1 / poles, gain * (np.prod(-zeros) / np.prod(-poles)).real
    if band == "highpass":
        return np.r_[w[0] * zeros, more], w[0] * poles, gain
    width, middle = w[1] - w[0], w[0] * w[1]
    if band == "bandpass":
        return (
            np.r_[_two(width * zeros, middle), more],
            _two(width * poles, middle),
            gain * width**more.size,
        )
    return np.r_[_two(width * zeros, middle), _two(more, middle)], _two(width * poles, middle), gain


def _two(b: Row, c: Any) -> Row:
    """Roots of s^2 - b s + c; the smaller by their product."""
    root = np.sqrt(b * b - 4 * c)
    large = np.where(np.abs(b + root) > np.abs(b - root), b + root, b - root) / 2
    return np.r_[large, c / large]


def digital(zeros: Row, poles: Row, gain: Any) -> Modes:
    """Return the modes of what has these zeros, poles and gain in s.

    z - z' is 2 (s - s')/((1 - s)(1 - s')).
    """
    direct = gain * np.prod(1 - zeros) / np.prod(1 - poles)
    r = direct * np.ones(poles.size, COMPLEX)
    for j, p in enumerate(poles):
        rest = np.delete(poles, j)
        r[j] *= np.prod(2 * (p - zeros) / (1 - p) / (1 - zeros)) * (2 / (1 - p)) ** (
            poles.size - zeros.size
        )
        r[j] /= np.prod(2 * (p - rest) / (1 - p) / (1 - rest))
    return Modes(direct.real, r, 2 * np.arctanh(poles))


# The response of each class -----------------------------------------------------------
RESPONSES: dict[str, Callable[[Any, float], Modes | Callable[[int], Row]]] = {}
"""By the name of a class: its modes, or a function that gives the first n samples of
its response.
"""


def response(*names: str) -> Callable:
    """Enter the response of the classes of these names."""

    def enter(f: Callable) -> Callable:
        RESPONSES.update(dict.fromkeys(names, f))
        return f

    return enter


def taps(h: Any) -> Callable[[int], Row]:
    """Return a response that ends."""
    return lambda n: np.asarray(h, float)[:n]


def straight(L: Any, size: Any) -> tuple[Any, Row, Row]:
    """Return h[0], r and L of size/(s - L fs), for straight inputs between samples.

    Sums are taken; sinh keeps its digits.
    """
    L = np.asarray(L, COMPLEX)
    first = np.where(
        np.abs(L) < 1e-4,
        0.5 + L / 6 + L**2 / 24 + L**3 / 120,
        (np.expm1(L) - L) / np.where(L == 0, 1, L) ** 2,
    )
    kernel = np.where(L == 0, 1, (np.expm1(L) / np.where(L == 0, 1, L)) ** 2)
    return np.sum(size * first).real, size * kernel, L


@response("Taps")
def _taps(b, fs):
    return taps(b.taps)


@response("Differentiator")
def _differentiator(b, fs):  # its taps are a best fit, which (a2) holds
    p = b.design(fs)[0]
    return taps(p.taps[::-1][: int(p.order) + 1])


@response("MovingAverage")
def _moving_average(b, fs):
    n = round(b.seconds * fs)
    return taps(np.full(n, 1 / n))


@response("Grain")
def _grain(b, fs):
    from ..design.filters import resampled  # as of ``Playback``

    return taps(resampled(b.samples, b.rate, fs))


@response("ShortMemory")
def _short_memory(b, fs):
    j = np.arange(1, max(1, round(b.seconds * fs)), dtype=LONG)
    return taps(LONG(fs) ** b.order * np.cumprod(np.r_[LONG(1), (j - 1 - b.order) / j]))


@response("FirstOrder")
def _first_order(b, fs):
    a = 1 / (LONG(b.tau) * LONG(fs))
    return Modes(*straight([-a], a))


@response("Integrate")
def _integrate(b, fs):
    if b.held:
        return Modes(1 / fs, np.array([1 / LONG(fs)]), np.zeros(1, LONG))
    return Modes(*straight([-b.leak / LONG(fs)], 1 / LONG(fs)))


@response("Mode")
def _mode(b, fs):
    a, c = 2 * PI * b.freq / LONG(fs), 0.5 / LONG(b.q)
    h = np.sqrt(1 - c * c)
    L = a * np.array([-c + 1j * h, -c - 1j * h])
    return Modes(*straight(L, a / (2j * h) * np.array([1, -1])))


@response("MaxwellArms")
def _arms(b, fs):
    a = 1 / (np.asarray(b.tau, LONG) * LONG(fs))
    g = b.k * -np.expm1(-a) / a
    return Modes(np.sum(g), g * np.expm1(-a), -a)


@response("KelvinChain")
def _chain(b, fs):
    a = np.r_[1 / (np.asarray(b.tau, LONG) * LONG(fs)), [0.0] * (b.fluidity > 0)]
    direct, r, L = straight(
        -a, np.r_[b.j * a[: b.j.size], [b.fluidity / LONG(fs)] * (b.fluidity > 0)]
    )
    return Modes(b.j0 + direct, r, L)


@response("Pinking", "PinkNoise")
def _pink(b, fs):  # poles and weights are a best fit, which (a2) holds
    p = b.design(fs)[0]
    some = p.r != 0
    return Modes(
        p.d + p.r.sum(),
        p.r[some] * p.p[some],
        np.log(np.where(p.p[some] == 0, 1e-300, p.p[some]).astype(COMPLEX)),
    )


@response("Filter")
def _filter(b, fs):
    edges = tuple(f / LONG(fs) for f in (b.low, b.high) if f is not None)
    return digital(*analogue(b.band, edges, b.kind, b.order, b.ripple, b.attenuation))


@response("BandNoise")
def _band_noise(b, fs):
    zeros, poles, gain = analogue(
        "bandpass", (b.low / LONG(fs), b.high / LONG(fs)), "butterworth", b.order, 1.0, 60.0
    )
    return digital(zeros, poles, gain * np.sqrt(b.psd * LONG(fs) / 2))


@response("Resonator")
def _resonator(b, fs):
    w = 2 * PI * b.freq / LONG(fs)
    t = np.tan(w / 2)
    c = (1 + t * t) * np.tan(w / b.q / 2)
    zeros = np.array([1j * t, -1j * t]) if b.notched else np.zeros(1, COMPLEX)
    return digital(zeros, _two(np.array([-c], COMPLEX), t * t), LONG(1) if b.notched else c)


@response("PoleSwap")
def _pole_swap(b, fs):
    r = b.freq / LONG(fs)
    narrow, wide = LONG(b.q), b.q / LONG(b.gain)
    turns = [
        2 * PI * r * (-0.5 / q + np.array([1j, -1j]) * np.sqrt(COMPLEX(1 - 0.25 / q**2)))
        for q in (narrow, wide)
    ]
    zeros, poles = (np.tanh(turn / 2) for turn in turns)
    s = 1j * np.tan(PI * r)
    size = np.abs(np.prod(s - poles) / np.prod(s - zeros))
    return digital(zeros, poles, size)


@response("Sos")
def _sos(b, fs):
    return lambda n: scipy.signal.sosfilt(
        (b.rows / b.rows[:, 3:4]).astype(LONG), np.r_[LONG(1), np.zeros(n - 1, LONG)]
    )


@response("Series")
def _series(b, fs):
    """Return f = g (y - z), f = S z, both as power series of 1/z: g S/(g + S).

    The reciprocal is by Newton's method.
    """

    def first(n: int) -> Row:
        S = np.diff(
            laws.springpot_weights(b.scheme, b.order, n) * b.chi * LONG(fs) ** LONG(b.order),
            prepend=LONG(0),
        )
        g = np.zeros(n, LONG)
        g[:2] = (b.other * fs, -b.other * fs)[:n] if b.dashpot else (b.other, 0.0)[:n]
        size = g[0] + S[0]
        whole, v = (g + S) / size, np.ones(1, LONG)
        while v.size < n:
            m = min(2 * v.size, n)
            v = np.pad(v, (0, m - v.size))
            v = (
                v
                + scipy.signal.fftconvolve(
                    v, np.eye(1, m)[0] - scipy.signal.fftconvolve(v, whole[:m])[:m]
                )[:m]
            )
        return scipy.signal.fftconvolve(scipy.signal.fftconvolve(S, g / size)[:n], v)[:n].astype(
            float
        )

    return first


# The laws -----------------------------------------------------------------------------
FREE = 1e-12  # of the largest row: what is left beside a state that is not known
SHORT = 512  # samples of a response that are summed one by one
START = 1e-5  # of a state that is drawn: what its factor may lose


@lru_cache(32)
def _made(b: Any, fs: float) -> Modes | Callable[[int], Row]:
    return RESPONSES[type(b).__name__](b, fs)


def summed(h: Row, x: Row) -> Row:
    """Return h * x, as long as x."""
    h = h[: x.size].astype(float)
    return (np.convolve(x, h) if min(h.size, x.size) <= SHORT else scipy.signal.fftconvolve(x, h))[
        : x.size
    ]


def settled(b: Any, fs: float, x: Rows) -> float:
    """Return after how many samples all of a response has been seen.

    Of modes, what went before is found.
    """
    made = _made(b, fs)
    if isinstance(made, Modes) or type(b).resettable:
        return 1
    h = np.abs(made(x[0].size + 1))
    return int(np.flatnonzero(h > 1e-20 * h.max())[-1])


@law(*RESPONSES, since=settled)
def _linear(b, fs, x, y):
    made, want, tol = _made(b, fs), np.zeros(y.size), np.full(y.size, 1e-300)
    step = getattr(b, "onset", "steady") == "step" and x.rest
    for k, s in enumerate(touched(x[-1]) if type(b).resettable else [slice(0, y.size)]):
        way = x[0][s] - (x[0][s.start] if type(b).resettable and not (step and k == 0) else 0.0)
        h = made.response(way.size) if isinstance(made, Modes) else made(way.size)
        want[s] = summed(h, way)
        loss = rounding(b, 3e-15 if callable(made) and h.size <= SHORT else 1e-13)
        tol[s] = (
            float(np.abs(h).sum()) * (loss * np.abs(way).max() + 2.0**-50 * np.abs(x[0][s]).max())
            + 1e-300
        )
        if not isinstance(made, Modes):
            tol[s] = np.inf if type(b).resettable and not (x.rest or s.start) else tol[s]
        elif s.start == 0 and (not x.rest or type(b).__name__ == "PinkNoise"):
            before = free(made.L, y[s] - want[s])
            if x.rest:
                began = stationary(b, made, fs, x.seed, y[s].size)
                before = (
                    before if np.abs(before - began).max() < START * np.abs(began).max() else began
                )
            want[s] += before
            tol[s] += FREE * np.abs(y[s]).max()
    return want, tol


def stationary(b: Any, made: Modes, fs: float, seed: int, n: int) -> Row:
    """Return what pink noise has left of what was before.

    It is a state q of the covariance 1/(1 - p p'), drawn by the published generator.
    """
    if not isinstance(b.white, White):
        return np.zeros(n)
    p = np.exp(made.L).real
    C = 1 / (1 - np.multiply.outer(p, p))
    lower = np.zeros(C.shape, LONG)  # Cholesky's factor in extended precision
    for j in range(p.size):
        column = C[j:, j] - lower[j:, :j] @ lower[j, :j]
        lower[j:, j] = column / np.sqrt(column[0])
    q = lower @ laws.white(seed, *b.white.noise_key, 0, p.size, 1)
    powers = np.exp(np.multiply.outer(np.arange(n), made.L))
    return (powers @ (made.r * q)).real.astype(float)


def free(L: Row, rest: Row) -> Row:
    """Return the part of a row that decays by these modes from whatever there was.

    It is the nearest at some samples, most of them early.
    """
    at = np.unique(
        np.r_[
            np.arange(min(64, rest.size)), np.geomspace(1, rest.size, 16 * L.size).astype(int) - 1
        ]
    )
    L = L[L.imag >= -1e-12 * np.abs(L)]

    def columns(n: Row) -> Row:
        powers = np.exp(np.multiply.outer(n, L))
        return np.hstack([powers.real, powers.imag]).astype(float)

    size = np.abs(A := columns(at)).max(axis=0) + 1e-300
    c = np.linalg.lstsq(A / size, rest[at], rcond=1e-15)[0] / size
    return columns(np.arange(rest.size)) @ c


def rounding(b: Any, least: float) -> float:
    """Return what a step may lose, as a part of the largest possible sum."""
    wide = b.high / b.low if getattr(b, "band", "") == "bandstop" else 0.0
    narrow = b.high / (b.high - b.low) if getattr(b, "high", None) else 0.0
    return least * (1 + narrow / 20 + wide) + 10 * getattr(b, "tol", 0.0) * (
        type(b).__name__ == "Series"
    )


def late(b: Any, fs: float) -> int:
    """Return the samples of a delay."""
    return round(b.seconds * fs) if b.samples is None else b.samples


@law("Delay", since=lambda b, fs, x: late(b, fs))
def _delay(b, fs, x, y):
    return np.r_[np.zeros(late(b, fs)), x[0]][: y.size], 0.0


@law("Track", "TrackVelocity", since=lambda b, fs, x: 65 * fs / (2 * math.pi * b.bandwidth))
def _track(b, fs, x, y):
    """Return steps of a held input through 1 - (1 + w t) exp(-w t).

    They begin where it was caught last.
    """
    place, touching = x[0], x[1] > 0
    most = math.inf if b.max_jump is None else b.max_jump
    q = 2 * PI * b.bandwidth / LONG(fs)
    t = np.arange(1, y.size + 1) * q
    if type(b).__name__ == "Track":
        h = -np.expm1(-t) - t * np.exp(-t)
    else:
        h = fs * np.exp(-t + q) * ((1 + t - q) * -np.expm1(-q) - q * np.exp(-q))
    rate = type(b).__name__ != "Track"
    h, want = h.astype(float), np.full(y.size, 0.0 if x.rest or rate else y[0])
    jump = np.abs(np.diff(place, prepend=place[:1])) > most
    starts = np.flatnonzero(touching & (np.r_[True, ~touching[:-1]] | jump))
    ends = np.flatnonzero(~touching & np.r_[False, touching[:-1]])
    edges = np.r_[starts, y.size]
    for k, a in enumerate(starts):
        after = np.searchsorted(ends, a)
        e = min(edges[k + 1], ends[after] if after < ends.size else y.size)
        way = place[a:e] - place[a]
        want[a:e] = summed(h, np.diff(way, prepend=0.0)) + (0.0 if rate else place[a])
        if not rate:
            want[e : edges[k + 1]] = want[e - 1] if x.rest or a else y[e - 1]
    return want, 1e-12 * (fs if rate else 1.0) * max(
        float(np.abs(place[touching]).max(initial=0.0)), 1e-300
    )
