"""Gains of low-pass prototypes in closed form: nothing of their poles is used, so a
filter's design can be held against them.

The edge of the pass band is x = 1.
"""

from __future__ import annotations

import math

import numpy as np


def squared(decibels: float) -> float:
    """e^2 of a gain 1/sqrt(1 + e^2)."""
    return math.expm1(decibels * math.log(10) / 10)


def butterworth(x: np.ndarray, n: int, ripple: float, attenuation: float) -> np.ndarray:
    """1/sqrt(1 + x^(2n))."""
    return 1 / np.sqrt(1 + x ** (2 * n))


def chebyshev1(x: np.ndarray, n: int, ripple: float, attenuation: float) -> np.ndarray:
    """1/sqrt(1 + e^2 T_n(x)^2)."""
    t = np.cos(n * np.arccos(x + 0j)).real
    return 1 / np.sqrt(1 + squared(ripple) * t * t)


def elliptic(x: np.ndarray, n: int, ripple: float, attenuation: float) -> np.ndarray:
    """1/sqrt(1 + e^2 R_n(x)^2), the elliptic rational function from its zeros cd((2i -
    1) K/n) and its nome.

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
    """|theta_n(0)/theta_n(i w x)|, theta_n the reverse Bessel polynomial and w where
    this is 1/sqrt(2).
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
