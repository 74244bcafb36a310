"""Filters once more, by another route: poles in closed form with many digits, and samples as sums of their powers."""

from __future__ import annotations

import mpmath as mp
import numpy as np

DIGITS = 60


def prototype(kind, n, ripple, attenuation):
    """Zeros, poles and gain of the low-pass whose edge is 1."""
    e = mp.sqrt(mp.mpf(10) ** (mp.mpf(ripple) / 10) - 1)
    zeros, level = [], mp.mpf(1)
    if kind == "butterworth":
        poles = [mp.expjpi(mp.mpf(2 * k + n + 1) / (2 * n)) for k in range(n)]
    elif kind == "chebyshev1":
        a = mp.asinh(1 / e) / n
        angles = [mp.pi * (2 * k + 1) / (2 * n) for k in range(n)]
        poles = [mp.mpc(-mp.sinh(a) * mp.sin(t), mp.cosh(a) * mp.cos(t)) for t in angles]
        level = 1 / mp.sqrt(1 + e * e) if n % 2 == 0 else level
    elif kind == "bessel":
        f = [mp.factorial(2 * n - k) / (2 ** (n - k) * mp.factorial(k) * mp.factorial(n - k)) for k in range(n + 1)]

        def theta(s, derivative=0):
            return mp.fsum(c * (k if derivative else 1) * s ** (k - derivative) for k, c in enumerate(f) if k >= derivative)

        w = mp.findroot(lambda w: abs(theta(1j * w) / f[0]) ** 2 - 2, (0.8 * mp.sqrt(n), mp.sqrt(2 * n)), solver="anderson")
        poles = [mp.mpc(complex(q)) for q in np.roots([float(c) for c in reversed(f)])]
        for _ in range(8):  # Newton's method doubles the digits
            poles = [q - theta(q) / theta(q, 1) for q in poles]
        poles = [q / w for q in poles]
    else:
        m1 = e * e / (mp.mpf(10) ** (mp.mpf(attenuation) / 10) - 1)
        m = mp.mfrom(q=mp.qfrom(m=m1) ** (mp.mpf(1) / n))
        K, v = mp.ellipk(m), mp.ellipf(mp.atan(1 / e), 1 - m1) / (n * mp.ellipk(m1))

        def cd(u):
            return mp.ellipfun("cd", u * K, m=m)

        poles = [1j * cd(mp.mpf(2 * i - 1) / n - 1j * v) for i in range(1, n + 1)]
        zeros = [s * 1j / (mp.sqrt(m) * cd(mp.mpf(2 * i - 1) / n)) for i in range(1, n // 2 + 1) for s in (1, -1)]
        level = 1 / mp.sqrt(1 + e * e) if n % 2 == 0 else level
    gain = level
    for q in poles:
        gain *= -q
    for q in zeros:
        gain /= -q
    return zeros, poles, gain


def analogue(band, edges, kind, n, ripple=1.0, attenuation=60.0):
    """Zeros, poles and gain in s = (z - 1)/(z + 1), edges in cycles per sample."""
    zeros, poles, gain = prototype(kind, n, ripple, attenuation)
    w = [mp.tan(mp.pi * mp.mpf(e)) for e in edges]
    extra = len(poles) - len(zeros)
    if band == "lowpass":
        return [w[0] * q for q in zeros], [w[0] * q for q in poles], gain * w[0] ** extra
    if band in ("highpass", "bandstop"):
        for q in poles:
            gain /= -q
        for q in zeros:
            gain *= -q
    if band == "highpass":
        return [w[0] / q for q in zeros] + [mp.mpf(0)] * extra, [w[0] / q for q in poles], gain
    width, middle = w[1] - w[0], w[0] * w[1]

    def two(q):
        root = mp.sqrt(q * q - 4 * middle)
        return [(q + root) / 2, (q - root) / 2]

    if band == "bandpass":
        turned = [[r for q in some for r in two(width * q)] for some in (zeros, poles)]
        return turned[0] + [mp.mpf(0)] * extra, turned[1], gain * width**extra
    turned = [[r for q in some for r in two(width / q)] for some in (zeros, poles)]
    return turned[0] + [s * 1j * mp.sqrt(middle) for s in (1, -1)] * extra, turned[1], gain


class Modes:
    """Samples of the digital filter: h[0] = direct, h[n] = sum of r P^(n-1)."""

    def __init__(self, zeros, poles, gain):
        def in_z(s):
            return (1 + s) / (1 - s)

        Z = [in_z(q) for q in zeros] + [mp.mpf(-1)] * (len(poles) - len(zeros))
        self.P = [in_z(q) for q in poles]
        self.direct = gain
        for q in zeros:
            self.direct *= 1 - q
        for q in poles:
            self.direct /= 1 - q
        self.r = []
        for j, p in enumerate(self.P):
            r = self.direct
            for q in Z:
                r *= p - q
            for i, q in enumerate(self.P):
                r /= p - q if i != j else 1
            self.r.append(r)

    def impulse(self, n):
        """h[n]."""
        return mp.re(self.direct) if n == 0 else mp.re(mp.fsum(r * p ** (n - 1) for r, p in zip(self.r, self.P, strict=True)))

    def step(self, n):
        """h[0] + .. + h[n]."""
        return mp.re(self.direct + mp.fsum(r * (1 - p**n) / (1 - p) for r, p in zip(self.r, self.P, strict=True)))


def answers(band, edges, kind, n, at, **ripples):
    """Impulse and step responses at samples, two arrays."""
    with mp.workdps(DIGITS):
        m = Modes(*analogue(band, edges, kind, n, **ripples))
        return [np.array([float(f(int(i))) for i in at]) for f in (m.impulse, m.step)]
