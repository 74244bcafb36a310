"""Filters far below the sample rate, against poles in closed form in long double; one
that moves, against its equation.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from math import factorial

import numpy as np
from scipy import integrate, signal

from stimlib.blocks import bandpass, lowpass, svf
from stimlib.core.graph import Block

from . import filter_loops, products
from .problem import Ladder, Method, Problem, Signal, always, apart, on, own, response

FS, SAMPLES, ORDER = 8000.0, 1 << 16, 4
LONG = 1 << 18  # of an impulse response, of a cutoff of 1e-4 fs
X = np.random.default_rng(0).standard_normal(SAMPLES)
LD = np.longdouble


def butterworth(cutoff: float) -> np.ndarray:
    """H at the bins of an impulse response: ORDER poles on a circle, i tan(pi f/fs)
    for s.
    """
    pi = 4 * np.arctan(LD(1))
    k = np.arange(ORDER, dtype=LD)
    angle = pi * (2 * k + ORDER + 1) / (2 * ORDER)
    poles = np.cos(angle) + 1j * np.sin(angle)
    f = np.arange(LONG // 2, dtype=LD) / LONG  # but fs/2, where s has no end
    s = 1j * np.tan(pi * f) / np.tan(pi * LD(cutoff) / LD(FS))
    return np.prod([-p / (s - p) for p in poles], axis=0).astype(complex)


def response_error(wanted: np.ndarray, noise: np.ndarray, f: Signal) -> float:
    """Largest error of the response; or of an answer to noise, in which every sample is
    rounded, of its maximum.
    """
    return max(float(np.abs(response(f, LONG)[:-1] - wanted).max()), apart(f(X), noise))


def transfer_function(cutoff: float) -> Signal:
    b, a = signal.butter(ORDER, cutoff, fs=FS)
    return lambda x: signal.lfilter(b, a, x)


def biquads(cutoff: float) -> Signal:
    sos = signal.butter(ORDER, cutoff, fs=FS, output="sos")
    return lambda x: signal.sosfilt(sos, x)


def long_biquads(s: np.ndarray, gain: np.ndarray, zeros: tuple[int, int]) -> Signal:
    """Poles at s, of each pair one, in second-order sections of long double: their
    design and their arithmetic; zeros at z = these two.
    """
    z = (1 + s) / (1 - s)
    b = np.poly(zeros).astype(LD)
    rows = [
        np.r_[b * g, 1, -2 * p.real, p.real**2 + p.imag**2] for p, g in zip(z, gain, strict=True)
    ]
    sos = np.array(rows, LD)
    return lambda x: signal.sosfilt(sos, x.astype(LD)).astype(float)


def long_modes(
    s: np.ndarray, gain: np.ndarray, zeros: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same as modes in parallel, each for a pair: e = 1 - p, what each has of the
    answer, and what of the input comes straight through.
    """
    z, whole = (1 + s) / (1 - s), np.prod(gain)
    around = np.r_[z, z.conj()]
    found = [
        whole
        * np.prod([(p - q) ** z.size for q in zeros])
        / np.prod(p - np.delete(around, k))
        / p
        * 2
        for k, p in enumerate(z)
    ]
    r = np.array(found)
    return -2 * s / (1 - s), r, np.array([whole - r.real.sum()])


def answer(s: np.ndarray, gain: np.ndarray, zeros: tuple[int, int]) -> np.ndarray:
    """What these poles make of X, in long double."""
    e, r, direct = long_modes(s, gain, zeros)
    x, one = X.astype(np.clongdouble), np.ones(1, np.clongdouble)
    y = direct * X
    for k, v in zip(e, r, strict=True):
        y = y + (v * signal.lfilter(one, np.array([1, k - 1]), x)).real
    return y.astype(float)


def in_parallel(
    s: np.ndarray, gain: np.ndarray, zeros: tuple[int, int], unit: str, knob: float
) -> dict[str, Ladder]:
    """Poles in long double: three ways to run their modes, and sections of scipy."""
    e, r, direct = long_modes(s, gain, zeros)
    ways = {
        "poles in a compiled loop, in parallel": filter_loops.modes(e, r, direct),
        "poles in a compiled loop, states in two words": filter_loops.modes(e, r, direct, True),
        "poles in products of matrices": products.modes(e, r, direct[0], 64),
        "poles in scipy sosfilt, long double": long_biquads(s, gain, zeros),
    }
    return {f"{name}, {unit}": ([knob], always(f)) for name, f in ways.items()}


def long_butter(cutoff: float) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    pi = 4 * np.arctan(LD(1))
    w = np.tan(pi * LD(cutoff) / LD(FS))
    angle = pi * (2 * np.arange(ORDER // 2, dtype=LD) + 1) / (2 * ORDER)
    s = w * (-np.sin(angle) + 1j * np.cos(angle))
    return s, w * w / (1 + 2 * w * np.sin(angle) + w * w), (-1, -1)


def low_passes() -> list[Method]:
    found = []
    for part in (1e-1, 1e-2, 1e-3, 1e-4):
        cutoff = part * FS
        poles = long_butter(cutoff)
        ladders = {
            "stimlib lowpass, cutoff Hz": (
                [cutoff],
                own(lambda x, cutoff: lowpass(x, cutoff, ORDER), FS),
            ),
            "scipy butter in sosfilt, cutoff Hz": ([cutoff], biquads),
            "scipy butter in lfilter, cutoff Hz": ([cutoff], transfer_function),
            **in_parallel(*poles, "cutoff Hz", cutoff),
        }
        found += on(X, partial(response_error, butterworth(cutoff), answer(*poles)), ladders)
    return found


# A band-pass with ripples -------------------------------------------------------------
RIPPLE, WIDE = 1.0, 1.25  # dB, and the middle over the lower edge


def chebyshev(edges: tuple[float, float]) -> np.ndarray:
    """H at the bins of an impulse response: poles on an ellipse, and (s^2 + low
    high)/(s (high - low)) for s.
    """
    pi = 4 * np.arctan(LD(1))
    low, high = (np.tan(pi * LD(f) / LD(FS)) for f in edges)
    epsilon = np.sqrt(LD(10) ** (LD(RIPPLE) / 10) - 1)
    a, angle = (
        np.arcsinh(1 / epsilon) / ORDER,
        pi * (2 * np.arange(ORDER, dtype=LD) + 1) / (2 * ORDER),
    )
    poles = -np.sinh(a) * np.sin(angle) + 1j * np.cosh(a) * np.cos(angle)
    s = 1j * np.tan(pi * np.arange(1, LONG // 2, dtype=LD) / LONG)
    s = (s * s + low * high) / (s * (high - low))
    top = np.prod(-poles) / np.sqrt(1 + epsilon * epsilon)  # an even order begins in a valley
    return np.r_[0.0, (top / np.prod([s - p for p in poles], axis=0)).astype(complex)]


def long_chebyshev(
    edges: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """The same poles, of each the half of the two that it becomes in the band."""
    pi = 4 * np.arctan(LD(1))
    low, high = (np.tan(pi * LD(f) / LD(FS)) for f in edges)
    epsilon = np.sqrt(LD(10) ** (LD(RIPPLE) / 10) - 1)
    a = np.arcsinh(1 / epsilon) / ORDER
    angle = pi * (2 * np.arange(ORDER, dtype=LD) + 1) / (2 * ORDER)
    half = (-np.sinh(a) * np.sin(angle) + 1j * np.cosh(a) * np.cos(angle)) * (high - low) / 2
    s = half + np.sqrt(half * half - low * high)
    s = np.where(s.imag < 0, half - np.sqrt(half * half - low * high), s)
    other = np.abs(s[:, None] - s.conj()[None]) < 1e-30
    assert not other.any() and (s.imag > 0).all()
    top = np.abs(np.prod(half)) * 2**ORDER / np.sqrt(1 + epsilon * epsilon)
    gain = 1 / np.abs(1 - s) ** 2
    gain[0] *= top
    return s, gain, (1, -1)


def wide_bandpass(edges: tuple[float, float], x: Block, _: float) -> Block:
    return bandpass(x, *edges, ORDER, "chebyshev1", RIPPLE)


def short(sos: np.ndarray, x: np.ndarray) -> np.ndarray:
    return signal.sosfilt(sos, x.astype(np.float32))


def band_passes() -> list[Method]:
    found = []
    for part in (1e-1, 1e-2, 1e-3):
        middle = part * FS
        edges = middle / WIDE, middle * WIDE
        poles = long_chebyshev(edges)
        sos, ba = (
            signal.cheby1(ORDER, RIPPLE, edges, "bandpass", output=kind, fs=FS)
            for kind in ("sos", "ba")
        )
        ladders = {
            "stimlib bandpass, middle Hz": ([middle], own(partial(wide_bandpass, edges), FS)),
            "scipy cheby1 in sosfilt, middle Hz": ([middle], always(partial(signal.sosfilt, sos))),
            "scipy cheby1 in sosfilt, float32, middle Hz": (
                [middle],
                always(partial(short, sos.astype(np.float32))),
            ),
            **in_parallel(*poles, "middle Hz", middle),
            "scipy cheby1 in lfilter, middle Hz": ([middle], always(partial(signal.lfilter, *ba))),
        }
        found += on(X, partial(response_error, chebyshev(edges), answer(*poles)), ladders)
    return found


# A cutoff that moves ------------------------------------------------------------------
SECONDS, Q, TONE = 0.25, 3.0, 250.0


def cutoff(t):
    """From 100 Hz to 900 Hz and back, four times a second."""
    return 300.0 * 3.0 ** -np.cos(2 * np.pi * 4.0 * t)


def tone(t):
    return np.sin(2 * np.pi * TONE * t)


@cache
def swept() -> integrate.OdeSolution:
    """Of the analogue filter: band' = w (x - band/q - low), low' = w band."""

    def slope(t: float, y: np.ndarray) -> tuple[float, float]:
        w = 2 * np.pi * cutoff(t)
        return w * (tone(t) - y[0] / Q - y[1]), w * y[0]

    return integrate.solve_ivp(
        slope, (0.0, SECONDS), [0.0, 0.0], "DOP853", rtol=1e-11, atol=1e-13, dense_output=True
    ).sol


def renewed(every: int, fs: float) -> Signal:
    """A biquad of scipy (bilinear), whose coefficients are those of the first of so
    many samples.
    """

    def run(rows: np.ndarray) -> np.ndarray:
        x, f = rows
        g = np.tan(np.pi * f[::every] / fs)
        top, bottom = g * g, np.array([1 + g / Q + g * g, 2 * (g * g - 1), 1 - g / Q + g * g])
        b, a = np.array([top, 2 * top, top]) / bottom[0], bottom / bottom[0]
        y, zi = np.empty(x.size), np.zeros(2)
        for k in range(g.size):
            at = slice(k * every, (k + 1) * every)
            y[at], zi = signal.lfilter(b[:, k], a[:, k], x[at], zi=zi)
        return y

    return run


@cache
def _trapezoids() -> Callable[[np.ndarray, float], np.ndarray]:
    from numba import njit

    @njit(error_model="numpy")
    def run(rows, fs):
        y, s1, s2 = np.empty(rows.shape[1]), 0.0, 0.0
        for n in range(y.size):
            g = np.tan(np.pi * rows[1, n] / fs)
            band = (g * (rows[0, n] - s2) + s1) / (1.0 + g * (g + 1.0 / Q))
            y[n] = s2 + g * band
            s1, s2 = 2.0 * band - s1, 2.0 * y[n] - s2
        return y

    return run


@cache
def _turned() -> Callable[[np.ndarray, float], np.ndarray]:
    """The analogue filter turns by the integral of its cutoff, whatever that does:
    exact but for Simpson's rule of what comes in, at samples and halfway, between which
    cutoff and tone are cubic.
    """
    from numba import njit

    pole = complex(-0.5 / Q, np.sqrt(1 - 0.25 / Q**2))
    c = [pole**k / factorial(k) for k in range(13)]
    re, im = tuple(v.real for v in c), tuple(v.imag for v in c)
    scale = 1 / pole.imag

    @njit(error_model="numpy", fastmath=True)
    def middle(v, n):
        if n == 0:
            return (5 * v[0] + 15 * v[1] - 5 * v[2] + v[3]) / 16
        if n == v.size - 2:
            return (5 * v[n + 1] + 15 * v[n] - 5 * v[n - 1] + v[n - 2]) / 16
        return (9 * (v[n] + v[n + 1]) - v[n - 1] - v[n + 2]) / 16

    @njit(error_model="numpy", fastmath=True)
    def turn(d):
        a, b = re[12], im[12]
        for k in range(11, -1, -1):
            a, b = a * d + re[k], b * d + im[k]
        return a, b

    @njit(error_model="numpy", fastmath=True)
    def run(rows, fs):
        x, f = rows[0], rows[1]
        y, s, t, w = np.zeros(x.size), 0.0, 0.0, 2 * np.pi / fs
        for n in range(x.size - 1):
            half = middle(f, n)
            a, b = turn(w / 24 * (5 * f[n] + 8 * half - f[n + 1]))
            s += w / 6 * f[n] * x[n]
            s, t = s * a - t * b, s * b + t * a
            a, b = turn(w / 24 * (5 * f[n + 1] + 8 * half - f[n]))
            s += w / 6 * 4 * half * middle(x, n)
            s, t = s * a - t * b, s * b + t * a
            s += w / 6 * f[n + 1] * x[n + 1]
            y[n + 1] = t * scale
        return y

    return run


def swept_at(fs: float) -> list[Method]:
    t = np.arange(int(SECONDS * fs)) / fs
    rows, wanted = np.array([tone(t), cutoff(t)]), swept()(t)[1]
    ladders = {
        "stimlib svf, fs": ([fs], own(lambda x, f, _: svf(x, f, Q), fs, ("", "Hz"))),
        "state variables by trapezoids, compiled, fs": (
            [fs],
            lambda fs: lambda rows: _trapezoids()(rows, fs),
        ),
        "exact turns and Simpson's rule, compiled, whole file, fs": (
            [fs],
            lambda fs: lambda rows: _turned()(rows, fs),
        ),
        "biquad in scipy lfilter, renewed at every sample, fs": ([fs], lambda fs: renewed(1, fs)),
        "biquad in scipy lfilter, renewed every 32 samples, fs": ([fs], lambda fs: renewed(32, fs)),
    }
    return on(rows, lambda f: apart(f(rows), wanted), ladders)


def moving() -> list[Method]:
    return [m for fs in (4000.0, 8000.0, 16000.0, 32000.0) for m in swept_at(fs)]


PROBLEMS = (
    Problem(
        "lowpass",
        "Butterworth low-pass of order 4, 0.8 to 800 Hz at 8 kHz",
        "largest error of the response, or of an answer to noise, of its maximum",
        SAMPLES,
        low_passes,
        asked=True,
    ),
    Problem(
        "bandpass",
        "Chebyshev's band-pass of order 4, 8 to 800 Hz at 8 kHz",
        "largest error of the response, or of an answer to noise, of its maximum",
        SAMPLES,
        band_passes,
        asked=True,
    ),
    Problem(
        "svf",
        "a resonant low-pass from 100 to 900 Hz and back",
        "largest error to the analogue filter",
        int(SECONDS * 1000),
        moving,
        "a millisecond",
    ),
)
