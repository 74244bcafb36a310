"""Springs, dampers and springpots in series, and arms beside each other: against closed
forms in continuous time.

The drive is a smooth push of parabolas, of which every one of them makes a power of
time or a Mittag-Leffler function.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from itertools import product
from math import gamma

import numpy as np
from scipy import fft, signal
from scipy.special import erfcx

from stimlib.blocks import (
    compliance,
    compliance_generalized_kelvin_voigt,
    generalized_maxwell,
    springpot_series,
)

from . import compiled
from .problem import Ladder, Method, Problem, Signal, always, apart, on, own, searched

SECONDS, RATES = 2.0, (500.0, 1000.0, 2000.0, 4000.0, 8000.0, 16000.0)
ALPHA = 0.5
ERROR = "largest error to the formula in continuous time, of its maximum"


def pushed(t: np.ndarray, answer: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The answer to a push from 0 to 1/2 within a second, which then stays, from that
    to t^2.
    """
    return answer(t) - 2 * answer(np.maximum(t - 0.5, 0)) + answer(np.maximum(t - 1, 0))


def push(t: np.ndarray) -> np.ndarray:
    return pushed(t, np.square)


def lagging(t: np.ndarray, tau: float) -> np.ndarray:
    """Of t^2, by a lag: tau y' + y = t^2 from rest."""
    return t * t - 2 * tau * t - 2 * tau * tau * np.expm1(-t / tau)


def methods(make: Callable[[float, np.ndarray], list[Method]]) -> list[Method]:
    return [m for fs in RATES for m in make(fs, np.arange(int(SECONDS * fs)) / fs)]


def first_order(parts: list[tuple[float, float, float, float]], rule: str, fs: float) -> Signal:
    """Sum of (b1 s + b0)/(a1 s + a0), each a filter of scipy by one rule."""
    found = []
    for b1, b0, a1, a0 in parts:
        if "foh" in rule:
            ratio = ([b1, b0], [a1, a0]) if a1 else ([b0], [a0])
            with warnings.catch_warnings():  # of an arm whose weight is nearly 0
                warnings.simplefilter("ignore", signal.BadCoefficients)
                made = signal.cont2discrete(ratio, 1 / fs, "foh") if a1 else (ratio[:1], [a0])
            found.append((made[0][0], made[1]))
            continue
        d = {"backward Euler": (fs, -fs, 1.0, 0.0), "bilinear": (2 * fs, -2 * fs, 1.0, 1.0)}[rule]
        b = np.array([b1 * d[0] + b0 * d[2], b1 * d[1] + b0 * d[3]])
        a = np.array([a1 * d[0] + a0 * d[2], a1 * d[1] + a0 * d[3]])
        found.append((b / a[0], a / a[0]))
    return lambda x: sum(signal.lfilter(b, a, x) for b, a in found)


def rules(parts: list[tuple[float, float, float, float]], fs: float) -> dict[str, Ladder]:
    return {
        f"{rule} in scipy lfilter, fs": ([fs], partial(first_order, parts, rule))
        for rule in ("backward Euler", "bilinear", "cont2discrete(.., 'foh')")
    }


# Eight arms beside a spring -----------------------------------------------------------
ARMS = [(50.0 / (k + 1), tau) for k, tau in enumerate(np.geomspace(1e-3, 3.0, 8).tolist())]


def relaxation(fs: float, t: np.ndarray) -> list[Method]:
    y = push(t)
    wanted = pushed(
        t, lambda t: 100.0 * t * t + sum(k * (t * t - lagging(t, tau)) for k, tau in ARMS)
    )
    parts = [(0.0, 100.0, 0.0, 1.0), *((k * tau, 0.0, tau, 1.0) for k, tau in ARMS)]
    ladders = {
        "stimlib generalized_maxwell, fs": (
            [fs],
            own(lambda y, _: generalized_maxwell(y, 100.0, ARMS), fs, "m"),
        )
    }
    for name, bent in (("straight lines", False), ("parabolas", True)):
        made = compiled.arms(np.array(ARMS), fs, bent, spring=100.0)
        ladders[f"{name}, compiled, fs"] = [fs], always(made)
    return on(y, lambda f: apart(f(y), wanted), ladders | rules(parts, fs))


# A chain of Kelvin-Voigt elements, a spring and a damper ------------------------------
CHAIN, K0, B = [(100.0, 0.005), (200.0, 0.1), (80.0, 1.0)], 1000.0, 300.0


def creep(fs: float, t: np.ndarray) -> list[Method]:
    f = push(t)
    wanted = pushed(
        t, lambda t: t * t / K0 + t**3 / (3 * B) + sum(lagging(t, tau) / k for k, tau in CHAIN)
    )
    parts = [
        (0.0, 1 / K0, 0.0, 1.0),
        (0.0, 1 / B, 1.0, 0.0),
        *((0.0, 1 / k, tau, 1.0) for k, tau in CHAIN),
    ]

    def chain(f, _):
        return compliance_generalized_kelvin_voigt(f, CHAIN, k0=K0, b=B)

    ladders = {"stimlib Kelvin-Voigt chain, fs": ([fs], own(chain, fs, "N"))}
    lags, spring = (
        np.array([(-1 / k, tau) for k, tau in CHAIN]),
        1 / K0 + sum(1 / k for k, _ in CHAIN),
    )
    for name, bent in (("straight lines", False), ("parabolas", True)):
        made = compiled.arms(lags, fs, bent, spring, 1 / B)
        ladders[f"{name}, compiled, fs"] = [fs], always(made)
    return on(f, lambda g: apart(g(f), wanted), ladders | rules(parts, fs))


# A springpot under a force ------------------------------------------------------------
CHI = 100.0


# Gauss' rule for an integral over a step
U, WEIGHT = (np.polynomial.legendre.leggauss(24) + np.array([[1.0], [0.0]])) / 2


def by_fft(weights: np.ndarray) -> Signal:
    """A sum over the whole file, with the transform of its weights made once."""
    n = fft.next_fast_len(2 * weights.size, real=True)
    answer = fft.rfft(weights, n)
    return lambda x: fft.irfft(fft.rfft(x, n) * answer, n)[: x.size]


def curved(weights: np.ndarray, more: np.ndarray) -> np.ndarray:
    """Weights of samples, with those of their second differences."""
    return weights + np.diff(np.r_[0.0, 0.0, more], 2)


def fractional(parabolas: bool, fs: float) -> Signal:
    """The fractional integral of straight lines between samples (Diethelm's product
    rule), or of the parabola through three, by FFT of the whole file.
    """
    j = np.arange(SECONDS * fs + 1)
    weights = np.diff(j ** (ALPHA + 1), 2, prepend=0.0)  # of straight lines from rest
    weights = np.r_[1.0, weights[1:]] / gamma(ALPHA + 2)
    more = (j[:, None] + 1 - U) ** (ALPHA - 1) * (U * U - U) / 2 @ WEIGHT / gamma(ALPHA)
    more[0] = -0.5 / gamma(ALPHA + 3) * ALPHA
    return by_fft(curved(weights, parabolas * more[:-1]) / (fs**ALPHA * CHI))


def oustaloup(fs: float, low: float, high: float) -> Signal:
    """s^-alpha between low and high fs/2 by 17 poles and zeros, bilinear."""
    wb, wh, k = 2 * np.pi * low, np.pi * fs * high, np.arange(-8, 9)
    zeros, poles = (-wb * (wh / wb) ** ((k + 8 + (1 + sign * -ALPHA) / 2) / 17) for sign in (-1, 1))
    sos = signal.zpk2sos(*signal.bilinear_zpk(zeros, poles, wh**-ALPHA / CHI, fs))
    return lambda f: signal.sosfilt(sos, f)


def compliances(fs: float, t: np.ndarray) -> list[Method]:
    f = push(t)
    wanted = pushed(t, lambda t: 2 * t ** (2 + ALPHA) / (gamma(3 + ALPHA) * CHI))

    def ours(scheme: str):
        return own(lambda f, _: compliance(f, CHI, ALPHA, scheme), fs, "N")

    def error(g: Signal) -> float:
        return apart(g(f), wanted)

    grid = product([fs], 10.0 ** np.arange(-4, 0.1, 0.5), [0.5, 1.0, 2.0])
    return on(f, error, {
        "stimlib compliance l1, fs": ([fs], ours("l1")),
        "stimlib compliance gl, fs": ([fs], ours("gl")),
        "product trapezoid by FFT, whole file, fs": ([fs], partial(fractional, False)),
        "product rule of parabolas by FFT, whole file, fs": ([fs], partial(fractional, True)),
        **banks("force", error, fs),
        "Oustaloup in scipy sosfilt, fs": ([fs], lambda _: searched(error, grid, oustaloup)),
    })  # fmt: skip


# A springpot behind a spring ----------------------------------------------------------
K = 1000.0


def mittag_leffler(t: np.ndarray, beta: float) -> np.ndarray:
    """t^(beta - 1) E_{1/2, beta}(-z), z = K/CHI sqrt(t), of beta = 1, 3/2, 2, ..: from
    E_{1/2, 1} = exp(z^2) erfc(z) up.
    """
    z, b = K / CHI * np.sqrt(t), 1.0
    found = erfcx(z)
    while b < beta:
        found, b = (1 / gamma(b) - found) / np.where(z > 0, z, 1.0), b + 0.5
    small = z < 0.3  # where the recursion would cancel: the series
    found[small] = sum((-z[small]) ** n / gamma(n / 2 + beta) for n in range(40))
    return t ** (beta - 1) * found


def kernel(parabolas: bool, fs: float) -> Signal:
    """Relaxation of the arm, its mean over each sample known in closed form, by FFT of
    the whole file; of straight lines, or of the parabola through three samples.
    """
    m = np.arange(SECONDS * fs)
    mean = K * np.diff(mittag_leffler(np.r_[m, m.size] / fs, 2.0)) * fs

    def falls(v: np.ndarray) -> np.ndarray:
        return K * erfcx(K / CHI * np.sqrt(v / fs))

    more = falls(m[:, None] + 1 - U) * (U - 0.5) @ WEIGHT
    more[0] = falls(U * U) * (0.5 - U * U) * 2 * U @ WEIGHT  # from the root's corner
    return by_fft(curved(np.diff(mean, prepend=0.0), parabolas * more))


def prony(kind: str, arms: int, fs: float, first: float, last: float) -> Signal:
    """The answer to a step fitted by exponentials for as long as the signal is: what is
    done where there is no springpot.  Under a force it also has a spring and a damper.
    """
    t, tau = np.geomspace(1e-5, 2.5, 600), np.geomspace(first, last, arms)
    a = np.exp(-t[:, None] / tau)
    if kind == "force":
        a, wanted = np.c_[a, np.ones(t.size), t], t**ALPHA / (gamma(ALPHA + 1) * CHI)
    else:
        a, wanted = np.c_[a, np.zeros((t.size, 2))], K * mittag_leffler(t, 1.0)
    k, *_ = np.linalg.lstsq(a, wanted, rcond=None)
    return compiled.arms(np.c_[k[:-2], tau], fs, True, *k[-2:].tolist())


def banks(kind: str, error: Callable[[Signal], float], fs: float) -> dict[str, Ladder]:
    """Fitted arms of parabolas, the first and last of their time constants searched."""

    def best(arms: int, fs: float) -> Signal:
        grid = product([kind], [arms], [fs], 10.0 ** np.arange(-7, -2), [1.0, 3.0, 10.0, 30.0])
        return searched(error, grid, prony)

    return {f"{n} fitted arms, compiled, fs": ([fs], partial(best, n)) for n in (8, 16, 24, 32)}


def series(fs: float, t: np.ndarray) -> list[Method]:
    y = push(t)
    wanted = pushed(t, lambda t: 2 * K * mittag_leffler(t, 3.0))

    def ours(scheme: str):
        return own(lambda y, _: springpot_series(y, CHI, ALPHA, k=K, scheme=scheme), fs, "m")

    def error(f: Signal) -> float:
        return apart(f(y), wanted)

    return on(y, error, {
        "stimlib springpot_series l1, fs": ([fs], ours("l1")),
        "stimlib springpot_series gl, fs": ([fs], ours("gl")),
        "Mittag-Leffler kernel by FFT, whole file, fs": ([fs], partial(kernel, False)),
        "the same of parabolas, whole file, fs": ([fs], partial(kernel, True)),
        **banks("position", error, fs),
    })  # fmt: skip


PROBLEMS = tuple(
    Problem(name, title, ERROR, int(SECONDS * 1000), partial(methods, make), "a millisecond")
    for name, title, make in (
        ("relaxation", "a spring and eight Maxwell arms, pushed", relaxation),
        ("creep", "three Kelvin-Voigt elements, a spring and a damper, pushed", creep),
        ("compliance", "a springpot of order 1/2 under a force", compliances),
        ("series", "a springpot of order 1/2 behind a spring, pushed", series),
    )
)
