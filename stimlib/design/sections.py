"""Recursive filters as second-order sections in trapezoidal form, from analogue poles
and zeros.

s stands for (z - 1)/(z + 1) = i tan(pi f/fs) throughout (the bilinear transform).
Nothing is ever written as a polynomial in z: near z = 1 its coefficients have lost the
digits that a low cutoff is made of.  Doubles are exact fractions, so each number of a
section is computed exactly and rounded once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ..errors import BadValue

KINDS = {
    "butterworth": "butter",
    "bessel": "bessel_mag",
    "chebyshev1": "cheby1",
    "elliptic": "ellip",
}
"""Families, and what scipy calls them."""

BANDS = {"lowpass": 1, "highpass": 1, "bandpass": 2, "bandstop": 2}
"""Kinds of pass band, and how many edges each has."""

ORDERS = range(1, 13)
# what numbers at the ends of float64's range end in
ARITHMETIC = (ZeroDivisionError, OverflowError)


class Sections(NamedTuple):
    """One number of each section, in running order.  A section maps v to h0 h + e1 s1 +
    e0 s2, h = v - s2, and then

    s1 += a h - c s1;  s2 += d h + b s1.

    It is (n2 s^2 + n1 s + n0)/(s^2 + d1 s + d0) with D = 1 + d1 + d0, g^2 = d0 and a =
    b = 2g/D, c = 2(d0 + d1)/D, d = 2 d0/D, h0 = (n2 + n1 + n0)/D, e1 = (n1 + n0 - n2
    (d1 + d0))/(g D), e0 = n0/d0: what is added to the states, and not what is left of
    them, so a low cutoff loses nothing to 1 - small.
    """

    a: np.ndarray
    c: np.ndarray
    b: np.ndarray
    d: np.ndarray
    h0: np.ndarray
    e1: np.ndarray
    e0: np.ndarray


Quadratic = Sequence[Fraction]  # factors of s^2, s and 1


def sections(rows: Sequence[tuple[Quadratic, Quadratic]]) -> Sections:
    """Sections from (numerator, denominator) of each, as polynomials in s; all factors
    of a denominator are above 0.

    Raises
    ------
    BadValue
        Numbers beyond the range of a float.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from stimlib.design.sections import sections
    >>> one, none = Fraction(1), Fraction(0)
    >>> sections([((none, none, one), (one, one, one))]).e0  # the gain at 0 Hz
    array([1.])
    """
    try:
        return Sections(*np.array([_section(n, d) for n, d in rows], np.float64).T.copy())
    except ARITHMETIC:
        raise BadValue(
            "a filter's numbers are beyond what a float can hold; take a higher frequency, or"
            " smaller factors"
        ) from None


def _section(n: Quadratic, d: Quadratic) -> tuple[Fraction, ...]:
    (n2, n1, n0), (d1, d0) = (v / d[0] for v in n), (v / d[0] for v in d[1:])
    g, D = Fraction(math.sqrt(d0)), 1 + d1 + d0  # any g near the root will do: it scales s1
    return (
        *(2 * g / D, 2 * (d0 + d1) / D, 2 * d0 / (g * D), 2 * d0 / D),
        *((n2 + n1 + n0) / D, (n1 + n0 - n2 * (d1 + d0)) / (g * D), n0 / d0),
    )


def designed(
    band: str, edges: Sequence[float], order: int, kind: str, ripple: float, attenuation: float
) -> list[tuple[Quadratic, Quadratic]]:
    """Sections, lowest Q first, of a filter with these edges in cycles per sample, by
    scipy's analogue design.

    Raises
    ------
    BadValue
        An order that these edges, ripple and attenuation do not allow.
    """
    from scipy.signal import iirfilter

    w = np.tan(np.pi * np.array(edges, float))
    edge, shape = (w[0], band) if w.size == 1 else (1.0, "lowpass")
    try:
        with np.errstate(all="ignore"):
            z, p, k = iirfilter(order, edge, ripple, attenuation, shape, True, KINDS[kind], "zpk")
            if w.size == 2:
                z, p, k = _between(z, p, k, w[0], w[1], band == "bandstop")
        if np.isfinite([*z, *p, k]).all() and (p.real < 0).all() and k != 0:
            return paired(z, p, float(k))
    except (*ARITHMETIC, ValueError):  # as scipy tells it of an elliptic filter
        pass
    what = f"{band}: no {kind} filter of order {order} has these edges, ripple and attenuation"
    raise BadValue(f"{what}; lower the order or move the edges apart")


def _between(
    z: np.ndarray, p: np.ndarray, k: float, low: float, high: float, stop: bool
) -> tuple[np.ndarray, np.ndarray, float]:
    """A low-pass between two edges: s becomes (s^2 + low high)/(s (high - low)), or its
    inverse.

    Of each two roots the smaller is found by their product: as a difference it loses
    digits where the edges are far apart.
    """
    half, middle, more = (high - low) / 2, low * high, len(p) - len(z)

    def both(r: np.ndarray) -> np.ndarray:
        """The roots of s^2 - 2 r s + middle."""
        d = np.sqrt(r * r - middle + 0j)
        large = np.where(np.abs(r + d) >= np.abs(r - d), r + d, r - d)
        return np.concatenate((large, middle / large))

    if not stop:
        return (
            np.concatenate((both(half * z), np.zeros(more))),
            both(half * p),
            k * (2 * half) ** more,
        )
    far = 1j * np.sqrt(middle) * np.repeat([1.0, -1.0], more)
    return (
        np.concatenate((both(half / z), far)),
        both(half / p),
        k * float(np.real(np.prod(-z) / np.prod(-p))),
    )


def paired(z: np.ndarray, p: np.ndarray, k: float) -> list[tuple[Quadratic, Quadratic]]:
    """Sections of a filter whose zeros lie on the imaginary axis: the highest Q takes
    the nearest zeros, and runs last.

    Each has its peak near 1; the gain that is left is in the first.
    """
    turning = np.abs(p.imag) > 1e-14 * np.abs(p)
    poles = [
        (-2 * Fraction(q.real), Fraction(q.real) ** 2 + Fraction(q.imag) ** 2)
        for q in p[turning & (p.imag > 0)].tolist()
    ]
    real = sorted(Fraction(-q) for q in p[~turning].real.tolist())
    alone = real.pop() if len(real) % 2 else None
    poles += [(a + b, a * b) for a, b in zip(real[::2], real[1::2], strict=True)]
    poles.sort(key=lambda q: math.sqrt(q[1]) / q[0])
    # beside a pole and a zero at z = 0, which cancel exactly: a section like all others
    if alone is not None:
        poles.insert(0, (1 + alone, alone))
    squares = [Fraction(q.imag) ** 2 for q in z.tolist() if q.imag > 0]  # each s^2 + w^2
    rows: dict[int, Quadratic] = {}
    free, gain = list(range(len(poles))), Fraction(k)
    while squares:
        i = free.pop()
        nearest = min(squares, key=lambda q: abs(math.log(q / poles[i][1])))
        squares.remove(nearest)
        rows[i] = (Fraction(1), Fraction(0), nearest)
    zeros = int(np.sum(z == 0))  # each section left gets one, and then another
    for j, i in enumerate(reversed(free)):
        count = len(range(j, zeros, len(free)))
        g = Fraction(math.sqrt(poles[i][1]))
        if i == 0 and alone is not None:
            rows[i] = (
                (Fraction(1), Fraction(1), Fraction(0)) if count else (Fraction(0), alone, alone)
            )
            gain /= 1 if count else alone
        else:
            rows[i] = tuple(g ** (2 - count) if m == 2 - count else Fraction(0) for m in range(3))
            gain /= g ** (2 - count)
    rows[0] = tuple(gain * v for v in rows[0])
    return [(rows[i], (Fraction(1), *poles[i])) for i in range(len(poles))]


def from_polynomials(b: Sequence[float], a: Sequence[float]) -> tuple[Quadratic, Quadratic]:
    """A section (b0 + b1/z + b2/z^2)/(a0 + a1/z + a2/z^2) as polynomials in s, exactly.

    Its poles are inside the unit circle where all factors of the denominator have one
    sign.

    Examples
    --------
    >>> from stimlib.design.sections import from_polynomials
    >>> [int(v) for v in from_polynomials([1, 1, 0], [4, 0, 0])[1]]  # 4 (s + 1)^2
    [4, 8, 4]
    """
    made = []
    for p0, p1, p2 in (map(Fraction, map(float, b)), map(Fraction, map(float, a))):
        made.append((p0 - p1 + p2, 2 * (p0 - p2), p0 + p1 + p2))
    return made[0], made[1]
