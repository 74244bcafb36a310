"""Springpots and Maxwell arms: against the full sum over the history in long double,
and against formulas in continuous time.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from itertools import product
from math import gamma

import numpy as np
from scipy import fft, signal

from stimlib.blocks import maxwell, springpot

from . import compiled, filter_loops
from .problem import Ladder, Method, Problem, Signal, apart, on, own, searched

FS, SECONDS, ALPHA = 1000.0, 10.0, 0.5
N = int(FS * SECONDS)
TAU = 0.02  # s, of a Maxwell arm
LD = np.longdouble


def sinusoid(t: np.ndarray) -> np.ndarray:
    """A finger that begins to press at 1 Hz, from rest, in m."""
    return 0.01 * np.sin(2 * np.pi * t)


X = sinusoid(np.arange(N) / FS)


# Springpot ----------------------------------------------------------------------------
def gl_weights(n: int) -> np.ndarray:
    """Gamma(j + 1 - alpha)/(Gamma(1 - alpha) j!) in long double."""
    j = np.arange(1, n, dtype=LD)
    return np.cumprod(np.r_[LD(1), (j - LD(ALPHA)) / j])


def full_sum(at: np.ndarray) -> np.ndarray:
    """The Gruenwald-Letnikov sum over the whole history, in long double."""
    d, v = np.diff(X.astype(LD), prepend=LD(X[0])), gl_weights(N)
    return np.array([LD(FS) ** LD(ALPHA) * np.dot(v[: n + 1], d[n::-1]) for n in at]).astype(float)


def derivative(t: np.ndarray) -> np.ndarray:
    """Caputo's derivative of the sinusoid from rest: that of one that was always there,
    less what its past would add.
    """
    w, h = 2 * np.pi, 0.15
    u = np.arange(-40, 14, h)
    cut = h * np.exp((1 + ALPHA) * u) / (1 + np.exp(2 * u)) * w**ALPHA
    past = np.concatenate(
        [
            np.exp(-np.outer(part, w * np.exp(u))) @ cut
            for part in np.array_split(t, max(1, t.size // 2000))
        ]
    )
    return 0.01 * (
        w**ALPHA * np.sin(w * t + ALPHA * np.pi / 2) - np.sin(np.pi * ALPHA) / np.pi * past
    )


def against_the_sum(f: Signal) -> float:
    at = np.unique(np.geomspace(1, N - 1, 400).astype(int))
    return apart(f(X)[at], full_sum(at))


def against_the_derivative(f: Signal) -> float:
    return apart(f(X)[1:], derivative(np.arange(1, N) / FS))


def thesis(memory: int, downsampled: bool) -> Signal:
    """The thesis' two ways to keep the sum short (section 3.2): the last N samples, or
    N samples spread over all of it.

    Spread over the history of n samples, each stands for those since the one before.
    """
    v = gl_weights(N).astype(float) * FS**ALPHA
    if not downsampled:
        return lambda x: signal.oaconvolve(np.diff(x, prepend=x[0]), v[:memory])[: x.size]

    loop = _downsampled()
    return lambda x: loop(x, v, memory)


@cache
def _downsampled() -> Callable[[np.ndarray, np.ndarray, int], np.ndarray]:
    from numba import njit

    @njit(error_model="numpy")
    def run(x, v, memory):
        out = np.zeros(x.size)
        for n in range(x.size):
            step = max(1, -(-n // memory))
            total, j = 0.0, 0
            for k in range(n, step - 1, -step):
                total += v[j] * (x[k] - x[k - step])
                j += 1
            out[n] = total * float(step) ** -ALPHA
        return out

    return run


def weights(scheme: str, n: int) -> np.ndarray:
    """Of the differences: the sum's, or those of straight lines between samples."""
    if scheme == "gl":
        return gl_weights(n).astype(float) * FS**ALPHA
    return np.diff(np.arange(n + 1.0) ** (1 - ALPHA)) * FS**ALPHA / gamma(2 - ALPHA)


def by_fft(scheme: str) -> Signal:
    """With the whole history; what is known of the weights is made before."""
    n = fft.next_fast_len(2 * N - 1, real=True)
    known = fft.rfft(weights(scheme, N), n)

    def run(x: np.ndarray) -> np.ndarray:
        d = np.zeros(n)
        np.subtract(x[1:], x[:-1], out=d[1 : x.size])
        return fft.irfft(fft.rfft(d) * known, n, overwrite_x=True)[: x.size]

    return run


def fitted(scheme: str, modes: int, first: float, last: float) -> Signal:
    """Exponentials fitted to the weights of ten seconds but the first two, in a
    compiled loop; first and last are the ends of their time constants, in samples.
    """
    w, direct = weights(scheme, N), 2
    j = np.unique(np.geomspace(direct, N - 1, 600).astype(int))
    e = -np.expm1(-1 / np.geomspace(first, last, modes))
    shapes = np.exp(np.log1p(-e) * j[:, None]) / w[j, None]
    r, *_ = np.linalg.lstsq(shapes, np.ones(j.size), rcond=1e-14)
    last_tap = (1 - e) ** (direct - 1) @ r - w[direct - 1]
    r *= -e / (1 - e)  # of samples, and not of their differences
    h = np.diff(w[:direct], prepend=0.0) - (1 - e) ** np.arange(direct)[:, None] @ r
    h = np.r_[h, last_tap]
    run = filter_loops.modes(e, r, h)
    return lambda x: run(x - x[0])


def oustaloup(order: int, low: float, high: float) -> Signal:
    """s^alpha between low and high fs/2 by 2 order + 1 poles and zeros, bilinear,
    second-order sections.
    """
    wb, wh = 2 * np.pi * low, np.pi * FS * high
    k = np.arange(-order, order + 1)
    zeros, poles = (
        -wb * (wh / wb) ** ((k + order + (1 + sign * ALPHA) / 2) / (2 * order + 1))
        for sign in (-1, 1)
    )
    sos = signal.zpk2sos(*signal.bilinear_zpk(zeros, poles, wh**ALPHA, FS))
    return lambda x: signal.sosfilt(sos, x - x[0])


def rivals() -> dict[str, Ladder]:
    """What is installed of fracmem and pycaputo."""
    found: dict[str, Ladder] = {}
    try:
        from fracmem import CompressedFractionalFilter

        make = CompressedFractionalFilter.from_analytic
        found["fracmem, whole file, p"] = (
            [8, 16, 32],
            lambda p: make(ALPHA, 1 / FS, L=32, p=p, definition="caputo", j_max=N).predict,
        )
    except ImportError:
        pass
    try:
        from pycaputo.derivatives import CaputoDerivative  # noqa: F401
        from pycaputo.differentiation import caputo, diff
        from pycaputo.grid import make_uniform_points

        points = make_uniform_points(N, 0, (N - 1) / FS)
        found["pycaputo L1, whole file"] = (
            [""],
            lambda _: lambda x: np.nan_to_num(diff(caputo.L1(ALPHA), x, points)),
        )
    except ImportError:
        pass
    return found


def springpots(error: Callable[[Signal], float], scheme: str, other: str) -> list[Method]:
    tols, some, counts = (
        [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14],
        [1e-4, 1e-10],
        [10, 30, 100, 300, 1000, 3000],
    )

    firsts, lasts = [0.5, 1.0, 2.0, 4.0], [1e4, 3e4, 1e5]

    def ours(scheme: str, dtype: str = ""):
        return own(lambda y, tol: springpot(y, 1.0, ALPHA, scheme=scheme, tol=tol), FS, "m", dtype)

    ladders: dict[str, Ladder] = {
        f"stimlib springpot {scheme}, tol": (tols, ours(scheme)),
        f"stimlib springpot {other}, tol": (some, ours(other)),
        "stimlib on JAX, float64, tol": (some, ours(scheme, "float64")),
        "stimlib on JAX, float32, tol": (some, ours(scheme, "float32")),
        "short memory (thesis), N": (counts, lambda n: thesis(n, downsampled=False)),
        "downsampled history (thesis), N": (counts, lambda n: thesis(n, downsampled=True)),
        "full sum by FFT, whole file": ([""], lambda _: by_fft("gl")),
        "L1 by FFT, whole file": ([""], lambda _: by_fft("l1")),
        "modes fitted to 10 s in a compiled loop, modes": (
            [4, 6, 8, 10, 13, 16],
            lambda n: searched(error, product([scheme], [n], firsts, lasts), fitted),
        ),
        "Oustaloup in scipy sosfilt, order": (
            [3, 6, 12, 24],
            lambda order: searched(
                error,
                product([order], 10.0 ** np.arange(-4, 0.6, 0.5), [0.5, 1.0, 2.0, 4.0, 8.0]),
                oustaloup,
            ),
        ),
    }
    return on(X, error, ladders | rivals())


# Maxwell arm --------------------------------------------------------------------------
def arm_force(t: np.ndarray) -> np.ndarray:
    """k = 1 N/m, tau, from rest: the steady sinusoid less the exponential that begins
    it.
    """
    w = 2 * np.pi
    wt = w * TAU
    return 0.01 * wt / (1 + wt**2) * (wt * np.sin(w * t) + np.cos(w * t) - np.exp(-t / TAU))


RULES = "forward Euler", "backward Euler", "bilinear", "cont2discrete(.., 'foh')"


def recursion(rule: str, fs: float) -> Signal:
    """q' = y' - q/tau by one rule, as one filter of scipy."""
    h = 1 / fs / TAU
    if "foh" in rule:
        (b,), a, _ = signal.cont2discrete(([TAU, 0.0], [TAU, 1.0]), 1 / fs, "foh")
        return lambda y: signal.lfilter(b, a, y - y[0])
    a = {
        "forward Euler": 1 - h,
        "backward Euler": 1 / (1 + h),
        "bilinear": (1 - h / 2) / (1 + h / 2),
    }[rule]
    gain = {"forward Euler": 1.0, "backward Euler": a, "bilinear": (1 + a) / 2}[rule]
    return lambda y: signal.lfilter(gain * np.array([1.0, -1.0]), [1.0, -a], y - y[0])


def parabolas(fs: float) -> Signal:
    """Exact for the parabola through three samples, after a straight first step, as one
    filter of scipy.
    """
    keep, first, second = (float(v) for v in compiled.steps(np.array(1 / (fs * TAU)), True))
    b = [first + second, -first - 2 * second, second]
    return lambda y: signal.lfilter(b, [1.0, -keep], y - y[0], zi=[0.0, second * (y[0] - y[1])])[0]


def arms_at(fs: float) -> list[Method]:
    """A sample rate is the knob: errors in continuous time, times for each millisecond
    of motion.
    """
    t = np.arange(int(fs * SECONDS)) / fs
    y, wanted = sinusoid(t), arm_force(t)
    ladders: dict[str, Ladder] = {
        "stimlib maxwell, fs": ([fs], own(lambda y, _: maxwell(y, 1.0, tau=TAU), fs, "m")),
        **{f"{rule} in scipy lfilter, fs": ([fs], partial(recursion, rule)) for rule in RULES},
        "parabolas in scipy lfilter, fs": ([fs], parabolas),
        "parabolas, compiled, fs": ([fs], lambda fs: compiled.arms(np.array([[1.0, TAU]]), fs)),
    }
    return on(y, lambda f: apart(f(y), wanted), ladders)


def arms() -> list[Method]:
    return [m for fs in (500.0, 1000.0, 2000.0, 4000.0, 8000.0, 16000.0) for m in arms_at(fs)]


PROBLEMS = (
    Problem(
        "springpot_gl",
        "springpot of order 1/2, 10 s at 1 kHz: the discrete sum",
        "largest error to the full sum, of its maximum",
        N,
        partial(springpots, against_the_sum, "gl", "l1"),
    ),  # fmt: skip
    Problem(
        "springpot_l1",
        "springpot of order 1/2, 10 s at 1 kHz: the derivative",
        "largest error to Caputo's derivative, of its maximum",
        N,
        partial(springpots, against_the_derivative, "l1", "gl"),
    ),  # fmt: skip
    Problem(
        "arm",
        "Maxwell arm, tau = 20 ms, pressed at 1 Hz",
        "largest error to the force in continuous time, of its maximum",
        N,
        arms,
        "a millisecond",
    ),  # fmt: skip
)
