"""Laws of linear blocks: responses in closed form, and convolutions with inputs.

Nothing of a recursion is run.  A response is taps, or a sum of modes r exp(n L) in
extended precision, whose poles come from their formulas (of pinking, whose poles are
fitted, from the design: the law of its spectrum holds them).  The same responses, at
frequencies, are the reference laws of check (a2).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

# which loads its parts where they are used: all of them would be a second of each start
import scipy

from ..blocks.noise import FilteredNoise, White
from ..design.responses import Law, below_nyquist, largest, whole_band
from . import laws
from .rows import FADED, Row, Rows, law, touched

LONG, COMPLEX = np.longdouble, np.clongdouble
PI = np.arctan(LONG(1)) * 4


@dataclass(frozen=True, eq=False)
class Modes:
    """An impulse response as a sum of modes.

    h[0] = direct, h[n] = sum of r exp((n - 1) L).
    """

    direct: Any
    r: np.ndarray
    L: np.ndarray

    def response(self, n: int) -> Row:
        """Return the first n samples of the impulse response.

        Powers are products of those of 64 samples and of one.
        """
        n = min(n, int(min(n, FADED / max(-float(self.L.real.max(initial=-LONG(1e9))), 1e-9))) + 2)
        far, near = (
            np.exp(np.multiply.outer(k, self.L)) for k in (np.arange(0, n, 64), np.arange(64))
        )
        return np.r_[self.direct, ((far * self.r) @ near.T).real.ravel()][:n]

    def at(self, f: Row, fs: float) -> Row:
        """Return the frequency response at some frequencies."""
        turn = 2j * PI * f[:, None] / LONG(fs)
        return (
            self.direct - np.sum(self.r / np.expm1(self.L - turn) * np.exp(-turn), axis=1)
        ).astype(complex)

    def lost(self, n: int) -> float:
        """Return the rounding of the first n samples, summed.

        In the first periods of a narrow band, modes cancel that are far larger than
        their sum.
        """
        last = np.minimum(n, 1 / np.maximum(-self.L.real, LONG(1e-30)))
        each = np.abs(self.r) * last * (self.r.size + np.abs(self.L) * last)
        return float(2 * np.finfo(LONG).eps * np.sum(each))


def prototype(kind: str, n: int, ripple: float, attenuation: float) -> tuple[Row, Row, Any]:
    """Return the zeros, poles and gain of the low-pass prototype with the edge 1."""
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
    """Return the zeros, poles and gain of a filter in s = (z - 1)/(z + 1).

    Edges are in cycles per sample.
    """
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
    """Return the roots of s^2 - b s + c, the smaller one from their product."""
    root = np.sqrt(b * b - 4 * c)
    large = np.where(np.abs(b + root) > np.abs(b - root), b + root, b - root) / 2
    return np.r_[large, c / large]


def digital(zeros: Row, poles: Row, gain: Any) -> Modes:
    """Return the modes of a filter given by zeros, poles and gain in s.

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


RESPONSES: dict[str, Callable[[Any, float], Modes | Callable[[int], Row]]] = {}
"""By the name of a class: its modes, or a function that gives the first n samples of
its response.
"""
EXACT: set[str] = set()
"""Names of classes whose responses are also laws at frequencies."""


def response(*names: str, exact: bool = True) -> Callable:
    """Register the impulse response of the classes with these names.

    It is not an exact law at frequencies if it is fitted by the design, or has no end.
    """

    def enter(f: Callable) -> Callable:
        RESPONSES.update(dict.fromkeys(names, f))
        EXACT.update(names if exact else ())
        law(*names, since=settled)(_linear)
        return f

    return enter


def taps(h: Any) -> Callable[[int], Row]:
    """Return a finite impulse response."""
    return lambda n: np.asarray(h, float)[:n]


def straight(L: Any, size: Any) -> tuple[Any, Row, Row]:
    """Return the modes of size/(s - L fs), for inputs linear between samples.

    The result is h[0], r and L. Several modes are summed in h[0]; the formulas keep
    their digits for small L.
    """
    L = np.asarray(L, COMPLEX)
    first = np.where(
        np.abs(L) < 1e-4,
        0.5 + L / 6 + L**2 / 24 + L**3 / 120,
        (np.expm1(L) - L) / np.where(L == 0, 1, L) ** 2,
    )
    kernel = np.where(L == 0, 1, (np.expm1(L) / np.where(L == 0, 1, L)) ** 2)
    return np.sum(size * first).real, size * kernel, L


FREE = 1e-12  # of the largest row: what is left beside a state that is not known
SHORT = 512  # samples of a response that are summed one by one
START = 1e-5  # of a state that is drawn: what its factor may lose


@lru_cache(32)
def _made(b: Any, fs: float) -> Modes | Callable[[int], Row]:
    made = RESPONSES[type(b).__name__](b, fs)
    return _equal(made.direct, *map(tuple, (made.r, made.L))) if isinstance(made, Modes) else made


def laws_of(b: Any, fs: float) -> tuple[Law, ...]:
    """Return the laws of a block's frequency response: its own, and the exact one."""
    if type(b).__name__ not in EXACT:
        return b.laws(fs)
    made, edge = _made(b, fs), getattr(b, "low", None) or getattr(b, "high", None)
    text, low = "the response of its numbers", edge or getattr(b, "freq", None)
    if isinstance(made, Modes):
        points = (lambda fs: np.geomspace(low / 30, 0.45 * fs, 401)) if low else whole_band(200)
        # errors are relative; in a stop band, to a part of what passes
        exact = Law(
            points, made.at, 1e-10, text, shapes=bool(edge),
            size=lambda H: np.abs(H) + 1e-3 * np.abs(H).max(),
        )  # fmt: skip
    else:
        h = np.asarray(made(1 << 62), float)
        n, tol = 2 * (below_nyquist(fs).size - 1), max(1e-12, 2e-15 * h.size)
        # at the n frequencies of a transform, taps that are n apart count as one
        folded = np.pad(h, (0, -h.size % n)).reshape(-1, n).sum(axis=0)
        exact = Law(below_nyquist, lambda f, fs: np.fft.rfft(folded), tol, text, size=largest)
    return (*b.laws(fs), exact)


@lru_cache(32)
def _equal(direct: Any, r: tuple[Any, ...], L: tuple[Any, ...]) -> Modes:
    """Return one object for equal modes, so that what follows from them is kept."""
    return Modes(direct, np.array(r), np.array(L))


@lru_cache(8)
def _first(made: Modes, n: int) -> Row:
    """Return ``made.response(n)``; nobody may write into it."""
    return made.response(n)


def summed(h: Row, x: Row) -> Row:
    """Return the convolution h * x, as long as x."""
    h = h[: x.size].astype(float)
    if min(h.size, x.size) <= SHORT:
        return np.convolve(x, h)[: x.size]
    size = 1 << (x.size + h.size - 2).bit_length()
    # as scipy.signal.fftconvolve, whose import takes most of a second of processor time
    return np.fft.irfft(np.fft.rfft(x, size) * np.fft.rfft(h, size), size)[: x.size]


def settled(b: Any, fs: float, x: Rows) -> float:
    """Return the number of samples after which a response has decayed.

    It is 1 for modes, as their state before is estimated from the row.
    """
    made = _made(b, fs)
    if isinstance(made, Modes) or type(b).resettable:
        return 1
    h = np.abs(made(x[0].size + 1))
    return int(np.flatnonzero(h > 1e-20 * h.max())[-1])


def _linear(b, fs, x, y):
    made, want, tol = _made(b, fs), np.zeros(y.size), np.full(y.size, 1e-300)
    step = getattr(b, "onset", "steady") == "step" and x.rest
    for k, s in enumerate(touched(x[-1]) if type(b).resettable else [slice(0, y.size)]):
        way = x[0][s] - (x[0][s.start] if type(b).resettable and not (step and k == 0) else 0.0)
        h = _first(made, way.size) if isinstance(made, Modes) else made(way.size)
        want[s] = summed(h, way)
        loss = rounding(b, 3e-15 if callable(made) and h.size <= SHORT else 1e-13)
        tol[s] = (
            float(np.abs(h).sum()) * (loss * np.abs(way).max() + 2.0**-50 * np.abs(x[0][s]).max())
            + (made.lost(h.size) * np.abs(way).max() if isinstance(made, Modes) else 0.0)
            + 1e-300
        )
        if not isinstance(made, Modes):
            tol[s] = np.inf if type(b).resettable and not (x.rest or s.start) else tol[s]
        elif s.start == 0 and (not x.rest or isinstance(b, FilteredNoise)):
            before = free(made, y[s] - want[s])
            if x.rest:
                began = stationary(b, made, fs, x.seed, y[s].size)
                before = (
                    before if np.abs(before - began).max() < START * np.abs(began).max() else began
                )
            want[s] += before
            tol[s] += FREE * np.abs(y[s]).max()
    return want, tol


def stationary(b: Any, made: Modes, fs: float, seed: int, n: int) -> Row:
    """Return the contribution of pink noise's past to the present run.

    It is a state q of the covariance 1/(1 - p p'), drawn by the published generator.
    """
    if not isinstance(b.white, White):
        return np.zeros(n)
    lower, powers = _past(made, n)
    q = lower @ laws.white(seed, *b.white.noise_key, 0, made.L.size, 1)
    return (powers @ (made.r * q)).real.astype(float)


@lru_cache(2)
def _past(made: Modes, n: int) -> tuple[Row, Row]:
    """Return Cholesky's factor of 1/(1 - p p'), and the powers of all modes."""
    p = np.exp(made.L).real
    C = 1 / (1 - np.multiply.outer(p, p))
    lower = np.zeros(C.shape, LONG)  # in extended precision
    for j in range(p.size):
        column = C[j:, j] - lower[j:, :j] @ lower[j, :j]
        lower[j:, j] = column / np.sqrt(column[0])
    return lower, np.exp(np.multiply.outer(np.arange(n), made.L))


def free(made: Modes, rest: Row) -> Row:
    """Return the free decay of these modes that fits a row best.

    It is fitted at some samples, most of them early.
    """
    at, decays = _decays(made, rest.size)
    size = np.abs(A := decays[at]).max(axis=0) + 1e-300
    c = np.linalg.lstsq(A / size, rest[at], rcond=1e-15)[0] / size
    return decays @ c


@lru_cache(2)
def _decays(made: Modes, n: int) -> tuple[Row, Row]:
    """Return the samples at which decays are fitted, and n samples of each decay."""
    L = made.L
    # sorted, as np.unique does, which loads numpy.ma
    at = np.array(sorted({*range(min(64, n)), *(np.geomspace(1, n, 16 * L.size) // 1 - 1)}), int)
    powers = np.exp(np.multiply.outer(np.arange(n), L[L.imag >= -1e-12 * np.abs(L)]))
    return at, np.hstack([powers.real, powers.imag]).astype(float)


def rounding(b: Any, least: float) -> float:
    """Return the rounding error of a step, relative to the largest possible sum."""
    wide = b.high / b.low if getattr(b, "band", "") == "bandstop" else 0.0
    narrow = b.high / (b.high - b.low) if getattr(b, "high", None) else 0.0
    return least * (1 + narrow / 20 + wide) + 10 * getattr(b, "tol", 0.0) * (
        type(b).__name__ == "Series"
    )
