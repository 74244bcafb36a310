"""Frequency responses of linear blocks in closed form.

``verify`` holds a block's response against poles, zeros and taps that are written
again (``stimlib.checks.linear``).  Here the same responses are derived in another way:
as sums of the aliases of a continuous one, as gains of prototypes, and as sums of taps.
Nothing of a block's design or step is used, nor of ``stimlib.checks``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stimlib.design.responses import (
    ALIASES,
    POINTS,
    Law,
    below_nyquist,
    difference,
    largest,
    whole_band,
)

Numbers = Sequence[float] | np.ndarray


def squared(decibels: float) -> float:
    """Return e^2 for a ripple in dB, where the gain is 1/sqrt(1 + e^2)."""
    return math.expm1(decibels * math.log(10) / 10)


def butterworth(x: np.ndarray, n: int, ripple: float, attenuation: float) -> np.ndarray:
    """Return the Butterworth magnitude, 1/sqrt(1 + x^(2n))."""
    return 1 / np.sqrt(1 + x ** (2 * n))


def chebyshev1(x: np.ndarray, n: int, ripple: float, attenuation: float) -> np.ndarray:
    """Return the Chebyshev type I magnitude, 1/sqrt(1 + (e T(x))^2)."""
    t = np.cos(n * np.arccos(x + 0j)).real
    return 1 / np.sqrt(1 + squared(ripple) * t * t)


def elliptic(x: np.ndarray, n: int, ripple: float, attenuation: float) -> np.ndarray:
    """Return the elliptic magnitude, 1/sqrt(1 + e^2 R_n(x)^2).

    The rational function R_n is computed from its zeros cd((2i - 1) K/n) and its nome.

    Lutovac, Tosic and Evans, "Filter Design for Signal Processing" (2000), chapters 12
    and 13.
    """
    from scipy.special import ellipj, ellipk, ellipkm1

    m1 = squared(ripple) / squared(attenuation)
    nome = math.exp(-math.pi * ellipkm1(m1) / ellipk(m1) / n)
    j = np.arange(40)
    m = 16 * nome * (np.sum(nome ** (j * (j + 1.0))) / (2 * np.sum(nome ** (j * j * 1.0)) - 1)) ** 4
    _, cn, dn, _ = ellipj((2 * np.arange(1, n // 2 + 1) - 1) * ellipk(m) / n, m)

    def r(x):
        y = x ** (n % 2)
        for zero in (cn / dn) ** 2:
            y = y * (x * x - zero) / (1 - m * zero * x * x)
        return y

    return 1 / np.sqrt(1 + squared(ripple) * (r(x) / r(1.0)) ** 2)


def bessel(x: np.ndarray, n: int, ripple: float, attenuation: float) -> np.ndarray:
    """Return the Bessel magnitude, |theta_n(0)/theta_n(i w x)|.

    theta_n is the reverse Bessel polynomial, and w the frequency where the magnitude is
    1/sqrt(2).
    """
    from scipy.optimize import brentq

    factors = [
        math.factorial(2 * n - k) / (2 ** (n - k) * math.factorial(k) * math.factorial(n - k))
        for k in range(n, -1, -1)
    ]

    def gain(w):
        return factors[-1] / np.abs(np.polyval(factors, 1j * w))

    w = brentq(lambda w: gain(w) ** 2 - 0.5, 0.1, 20.0, xtol=1e-15, rtol=1e-15)
    return gain(w * x)


GAINS = {
    "butterworth": butterworth,
    "bessel": bessel,
    "chebyshev1": chebyshev1,
    "elliptic": elliptic,
}


def sum_of(taps: Numbers) -> Law:
    """Return the law of an FIR filter; errors scale with its largest response.

    Two computations differ in the phase of a sample's delay by the rounding of a turn,
    at most 2e-15, and a sum of n taps changes with that phase by at most n times its
    largest value (Bernstein's inequality).
    """

    def law(f, fs):
        return sum(h * np.exp(-2j * np.pi * f * k / fs) for k, h in enumerate(taps))

    tol = max(1e-12, 2e-15 * len(taps))
    return Law(below_nyquist, law, tol, f"sum of {len(taps)} taps", size=largest)


def mean_of(n: int) -> Law:
    """Return the law of a mean of n samples: Dirichlet's kernel with its delay."""

    def law(f, fs):
        half = np.pi * f / fs
        return np.sin(n * half) / (n * np.sin(half)) * np.exp(-1j * (n - 1) * half)

    return Law(whole_band(200), law, 1e-12, f"mean of {n} samples", size=largest)


def resonance(freq: float, q: float, notched: bool = False) -> Law:
    """Return the law of a resonator, or of a notch (1 minus the resonator).

    1/(1 + i (cos w0 - cos w)/(sin w tan(W/2))), w0 = 2 pi freq/fs, W = w0/q.

    The power is half where cos w0 = cos(w -+ W/2)/cos(W/2): at two frequencies that are
    freq/q apart.
    """

    def law(f, fs):
        w, w0 = 2 * np.pi * f / fs, 2 * math.pi * freq / fs
        apart = 2 * np.sin((w + w0) / 2) * np.sin((w - w0) / 2) / (np.sin(w) * math.tan(w0 / q / 2))
        return 1j * apart / (1 + 1j * apart) if notched else 1 / (1 + 1j * apart)

    return Law(whole_band(200), law, 1e-10, f"resonance at {freq:g} Hz, q = {q:g}", size=largest)


def oscillator(freq: float, q: float) -> Law:
    """Return the law of a mass on a spring, for inputs linear between samples.

    It is 1/(1 - g^2 + i g/q), g = f/freq, summed over all aliases with the spectrum of
    a triangle.
    """

    def law(f, fs):
        g = (f[:, None] + ALIASES * fs) / freq
        return np.sum(np.sinc(f[:, None] / fs + ALIASES) ** 2 / (1 - g * g + 1j * g / q), axis=1)

    return Law(
        whole_band(200),
        law,
        1e-8,
        f"mode at {freq:g} Hz, q = {q:g}, of straight lines",
        size=largest,
    )


def pole_swap(freq: float, q: float, gain: float) -> Law:
    """Return the law of a pole swap, (z - p)(z - p*)/((z - r)(z - r*)), 1 at freq.

    p and r are the discrete poles for the qualities q and q/gain.
    """

    def poles(z, fs, q):
        turn = 2j * math.pi * freq / fs * np.array([1, -1]) * math.sqrt(
            1 - 0.25 / q**2
        ) - math.pi * freq / (fs * q)
        return np.prod(z[:, None] - np.exp(turn), axis=1)

    def law(f, fs):
        z = np.exp(2j * np.pi * np.r_[f, freq] / fs)
        h = poles(z, fs, q) / poles(z, fs, q / gain)
        return h[:-1] / abs(h[-1])

    return Law(
        whole_band(200),
        law,
        1e-10,
        f"poles at {freq:g} Hz from q = {q:g} to {q / gain:g}",
        size=largest,
    )


def family(
    band: str, edges: Numbers, order: int, kind: str, ripple: float, attenuation: float
) -> Law:
    """Return the law for the gain of a filter of one of four families.

    It is the gain of the prototype, whose edge is 1, at the transformed frequency x.

    x = tan(pi f/fs)/tan(pi cutoff/fs) for a low-pass, its inverse for a high-pass, (t^2
    - t1 t2)/(t (t2 - t1)) for a band-pass, and the inverse of that for a band-stop.
    """

    def law(f, fs):
        t, edge = np.tan(np.pi * f / fs), [math.tan(math.pi * e / fs) for e in edges]
        with np.errstate(divide="ignore"):
            x = t / edge[0] if len(edge) == 1 else (t - edge[0] * edge[1] / t) / (edge[1] - edge[0])
            x = np.clip(1 / x if band in ("highpass", "bandstop") else x, -1e12, 1e12)
        return GAINS[kind](x, order, ripple, attenuation)

    def below(fs):
        return np.geomspace(edges[0] / 30, 0.45 * fs, POINTS)

    def gain(H, f, fs):
        return np.abs(H)

    return Law(below, law, 1e-9, f"{kind} {band} of order {order}", gain, largest, shapes=True)


def band_noise(low: float, high: float, psd: float, order: int) -> Law:
    """Return the law of a filter that gives white noise a PSD between two edges.

    The white noise has unit variance and the one-sided PSD 2/fs.
    """
    band = family("bandpass", (low, high), order, "butterworth", 1.0, 60.0)

    def law(f, fs):
        return math.sqrt(psd * fs / 2) * band.law(f, fs)

    return band._replace(law=law, text=f"S = {psd:.4g} from {low:g} to {high:g} Hz")


def ramp_invariant(tau: float) -> Law:
    """Return the law of a lag 1/(1 + i w tau), for inputs linear between samples.

    It is summed over all aliases with the spectrum of a triangle.
    """

    def law(f, fs):
        part, a, end = f / fs, 2 * np.pi * fs * tau, ALIASES[-1] + 0.5
        g = part[:, None] + ALIASES
        near = np.sum(np.sinc(g) ** 2 / (1 + 1j * a * g), axis=1)
        # all further aliases: the integrals of 1/(x^2 (1 + i a x)) from both ends on
        far = sum(
            1 / x - 1j * s * np.log1p(-1j / (s * x)) for x, s in ((end + part, a), (end - part, -a))
        )
        return near + (np.sin(np.pi * part) / np.pi) ** 2 * far

    return Law(whole_band(40), law, 1e-7, f"1/(1 + s {tau:g}) of straight lines")


def arms(k: Numbers, tau: Numbers, k0: float = 0.0) -> Law:
    """Return the law of Maxwell arms, for inputs linear between samples.

    It is k0 + sum k i w tau/(1 + i w tau), where each arm is computed as a spring less
    a lag.
    """
    total = k0 + sum(k)

    def law(f, fs):
        return total - sum(c * ramp_invariant(t).law(f, fs) for c, t in zip(k, tau, strict=True))

    return Law(
        whole_band(40), law, 1e-7, f"{len(k)} Maxwell arms", size=lambda h: np.full(h.shape, total)
    )


def chain(j0: float, j: Numbers, tau: Numbers, fluidity: float) -> Law:
    """Return the law of a Kelvin-Voigt chain, for inputs linear between samples.

    j0 + sum j/(1 + i w tau) + fluidity/(i w); an integral is the trapezoidal rule.
    """

    def law(f, fs):
        d = difference(f, fs)
        lags = sum(c * ramp_invariant(t).law(f, fs) for c, t in zip(j, tau, strict=True))
        return j0 + lags + fluidity / fs * (1 / d - 0.5)

    return Law(whole_band(40), law, 1e-7, f"{len(j)} Kelvin-Voigt elements in series")


def integral(leak: float) -> Law:
    """Return the law of an integral 1/(i w + leak), for inputs linear between samples.

    Without a leak it is the trapezoidal rule.
    """

    def law(f, fs):
        return (
            ramp_invariant(1 / leak).law(f, fs) / leak
            if leak
            else (1 / difference(f, fs) - 0.5) / fs
        )

    return Law(whole_band(40), law, 1e-7, f"integral with a leak of {leak:g} 1/s")


def running_sum() -> Law:
    """Return the law of an integral 1/(i w) computed as a sum of samples."""
    return Law(
        whole_band(200), lambda f, fs: 1 / (fs * difference(f, fs)), 1e-12, "sum over samples / fs"
    )
