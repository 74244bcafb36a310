"""The memory of a springpot as a sum of exponentials, with an error bound.

A fractional difference is f[n] = h^-alpha sum_j v_j d[n-j] with d[n] = y[n] - y[n-1]
and weights v_j > 0 that decay like a power of j.  The first ``DIRECT`` weights are used
as they are.  The others are integrals of exponentials,

    v_j = (sin(pi alpha)/pi) Int_0^inf exp(-s j) phi(s) ds,

    gl:  phi = (exp(s) - 1)^(alpha - 1)
         v_j = Gamma(j + 1 - alpha)/(Gamma(1 - alpha) j!)
    l1:  phi = (1 - exp(-s)) s^(alpha - 2)
         v_j = ((j + 1)^(1 - alpha) - j^(1 - alpha))/Gamma(2 - alpha)

Creep needs a third, for d[n] = force/fs that is straight between samples, with p = 2 -
alpha and v_0 = 1/Gamma(1 + p):

    straight:  phi = (2 sinh(s/2))^2 s^(alpha - 3)
               v_j = ((j + 1)^p - 2 j^p + (j - 1)^p)/Gamma(1 + p)

and the trapezoidal rule in log(s) turns the integral into few terms, with an error that
falls like exp(-pi^2/delta) with the step delta.  All of the grid below s0 =
0.25/horizon acts as a few nodes in [0, s0] with the same moments.  So the rates s_k
depend on tol and the horizon only, and the order alpha enters by the weights, in closed
form.

Sampled: Gruenwald-Letnikov (``gl``) is eq. (3.1) of Çaldıran's thesis in terms of
differences; ``l1`` is exact for straight lines between samples.
"""

from __future__ import annotations

import math
from decimal import Context, Decimal
from fractions import Fraction
from functools import cache
from typing import NamedTuple

import numpy as np

from ..errors import BadValue

SCHEMES = ("gl", "l1")
STRAIGHT = "straight"
DIRECT = 8  # weights v_0 .. v_7 are direct taps
SMALLEST_TOL = 1e-14
LONGEST = 2.0**62  # samples of a run, as of a processor
ROUNDING = 32 * 2.0**-53  # of some twenty operations on numbers of one sign
# of the polynomials in alpha that stand for weights without a closed form of few
# operations
DEGREE = 24


class Rates(NamedTuple):
    """The parts of a springpot's sum of exponentials that do not depend on alpha."""

    tol: float
    samples: float  # the horizon
    delta: float  # step of the grid in log(s)
    s0: float
    x: tuple[float, ...]  # nodes of the part below s0, as fractions of s0; the first is 0
    grid: np.ndarray  # s0, s0 exp(delta), ..
    fine: int  # that many of the slowest modes need a second word of state

    @property
    def s(self) -> np.ndarray:
        """Rates of all modes except the one with s = 0, ascending."""
        return np.concatenate([self.s0 * np.array(self.x[1:]), self.grid])


class Weights(NamedTuple):
    """The weights of taps, a constant and modes in a springpot's sum.

    f[n] = sum_j taps[j] d[n-j] + constant (y[n-8] - y[-1]) + sum_k modes[k] b_k[n].
    """

    taps: np.ndarray  # v_0 .. v_7
    constant: float
    modes: np.ndarray  # of b_k[n] = sum_j exp(-s_k j) d[n-8-j]


# The exact weights --------------------------------------------------------------------
def kernel(scheme: str, alpha: float, j) -> np.ndarray:
    """Return the exact history weights v_j of a springpot, to a few roundings.

    Parameters
    ----------
    scheme : {"gl", "l1", "straight"}
    alpha : float
        From 0 to 1.
    j : array_like of int

    Returns
    -------
    ndarray

    Examples
    --------
    >>> from stimlib.design.fractional import kernel
    >>> kernel("gl", 0.5, [0, 1, 2])
    array([1.   , 0.5  , 0.375])
    """
    j = np.asarray(j, float)
    if scheme == STRAIGHT:
        return _straight(alpha, j)
    if scheme == "l1":
        k = np.maximum(j, 1)
        one = k ** (1 - alpha) * np.expm1((1 - alpha) * np.log1p(1 / k))
        return np.where(j == 0, 1.0, one) / math.gamma(2 - alpha)
    few = np.cumprod([1.0, *((i - alpha) / i for i in range(1, 64))])
    # Gamma(n + a)/Gamma(n + b), n large, by its series about n + (a + b - 1)/2: rho =
    # (1 + a - b)/2
    w, rho = np.maximum(j, 63) + (1 - alpha) / 2, (1 - alpha) / 2
    square = 1 / w**2
    series = 1 + alpha * (1 - alpha) * square * _ratio_series(alpha, rho, square)
    many = series * w**-alpha / math.gamma(1 - alpha) if alpha < 1 else np.zeros_like(w)
    return np.where(j < 64, few[np.minimum(j, 63).astype(int)], many)


def _straight(alpha: float, j: np.ndarray) -> np.ndarray:
    """Return the kernel of the scheme "straight", without cancellation.

    ((j + 1)^p - 2 j^p + (j - 1)^p)/Gamma(1 + p) with p = 2 - alpha; 1/Gamma(1 + p) for
    j = 0.
    """
    k, i = np.maximum(j, 2), np.arange(2, 64, 2)
    # binom(p, i), none below 0
    series = np.cumprod((4 - i - alpha) * (3 - i - alpha) / (i * (i - 1)))
    far = 2 * k**-alpha * np.polynomial.polynomial.polyval(k**-2, series)
    near = np.where(j == 0, 1.0, 2 * math.expm1((1 - alpha) * math.log(2)))
    return np.where(j < 2, near, far) / math.gamma(3 - alpha)


def _ratio_series(alpha: float, rho: float, u: np.ndarray) -> np.ndarray:
    """Return the first terms of a ratio of gamma functions, less 1 and scaled.

    (Gamma(w + rho) / (Gamma(w + rho + alpha) w^-alpha) - 1) / (alpha (1 - alpha) u)
    with w = 1/sqrt(u).
    """
    # generalised Bernoulli numbers B_2n^(2 rho)(rho), 2 rho = 1 - alpha
    b2, b4, b6 = -rho / 6, rho * (5 * rho + 1) / 60, -rho * (35 * rho**2 + 21 * rho + 4) / 504
    first = alpha * (alpha + 1) / 2
    second = first * (alpha + 2) * (alpha + 3) / 12
    third = second * (alpha + 4) * (alpha + 5) / 30
    scale = alpha * (1 - alpha)
    if scale == 0:
        return np.zeros_like(u)
    return (first * b2 + u * (second * b4 + u * third * b6)) / scale


def _phi(scheme: str, alpha: float, s: np.ndarray) -> np.ndarray:
    if scheme == "gl":
        # alpha - 1 would be rounded
        return np.array([math.expm1(v) ** alpha / math.expm1(v) for v in s])
    if scheme == STRAIGHT:
        return np.array([v**alpha * (2 * math.sinh(v / 2) / v) ** 2 / v for v in s])
    return np.array([v**alpha * (-math.expm1(-v) / v) / v for v in s])


def _sin(alpha: float) -> float:
    """Return sin(pi alpha)/pi, accurate also near alpha = 1."""
    return math.sin(math.pi * min(alpha, 1 - alpha)) / math.pi


# Rates --------------------------------------------------------------------------------
@cache
def rates(tol: float, samples: float, scheme: str = "gl") -> Rates:
    """Return modes whose error bound is below tol for every order.

    The bound holds up to a horizon in samples.

    Parameters
    ----------
    tol : float
        |error of f[n]| <= tol h^-alpha sum_j v_j |d[n-j]|; from 1e-14 to 0.1.
    samples : float
        Horizon; the bound on the slowest part holds up to there.
    scheme : {"gl", "l1", "straight"}
        The first two have the same modes; the third has a few more at the fast end.

    Raises
    ------
    BadValue
        A tol outside its range; more samples than a run can have.

    Examples
    --------
    >>> from stimlib.design.fractional import rates
    >>> rates(1e-10, 86400 * 1000.0).s.size
    63
    """
    if not SMALLEST_TOL <= tol <= 0.1:
        raise BadValue(
            f"springpot: tol = {tol:g} must be from {SMALLEST_TOL:g}, the limit of double"
            f" precision, to 0.1; use tol={SMALLEST_TOL if tol < SMALLEST_TOL else 0.1:g}"
        )
    if not samples <= LONGEST:
        raise BadValue(
            f"springpot: a horizon of {samples:g} samples is longer than any run; at most"
            f" {LONGEST:g} are possible"
        )
    samples = max(float(samples), 64.0)
    share = tol / 16
    delta = _step(tol - 4 * share - ROUNDING)
    s0 = 0.25 / samples
    n = math.ceil(math.log(0.5 / s0) / delta)
    while _beyond(1.0, s0 * math.exp(n * delta), delta, DIRECT - (scheme == STRAIGHT)) > share:
        n += 1
    grid = s0 * np.exp(delta * np.arange(n))
    m = 2
    while (
        max(_lump_error(a, delta, _nodes(m)) for a in (0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0))
        > share
    ):
        m += 1
    made = Rates(tol, samples, delta, s0, _nodes(m), grid, 0)
    return made._replace(fine=int(np.sum(made.s < 2.0**-53 / share)))


def _step(room: float) -> float:
    """Return the grid step at which 1.5 times the aliasing equals ``room``.

    Aliasing is largest at alpha = 1.
    """
    y = 10.0
    for _ in range(50):
        y = 2 / math.pi * math.log(3 * math.sqrt(2 * math.pi * y) / room)
    return 2 * math.pi / y


def aliasing(alpha: float, delta: float) -> float:
    """Return the relative error that a grid step causes in all weights.

    It is 2 |Gamma(alpha + 2 pi i/delta)|/Gamma(alpha).
    """
    # |Gamma(a + iy)| from Stirling's series at a + 8 + iy
    z = complex(alpha, 2 * math.pi / delta)
    below = 0.0
    for _ in range(8):
        below += math.log(abs(z))
        z += 1
    log = complex(math.log(abs(z)), math.atan2(z.imag, z.real))
    stirling = (
        (z - 0.5) * log
        - z
        + 0.5 * math.log(2 * math.pi)
        + 1 / (12 * z)
        - 1 / (360 * z**3)
        + 1 / (1260 * z**5)
    )
    return 2 * math.exp(stirling.real - below) * alpha / math.gamma(1 + alpha)


def _beyond(alpha: float, s: float, delta: float, first: int = DIRECT) -> float:
    """Return the relative error of truncating the grid at the rate s.

    It is relative to v_8 and computed for gl; that of l1 is smaller, and that of
    straight is smaller with first = 7.
    """
    v = s * np.exp(delta * np.arange(64))
    v = v[v < 80]
    if alpha == 1:  # the limit of both factors over 1 - alpha
        return float(delta * np.sum(v * np.exp(-first * v)) * DIRECT)
    return float(
        _sin(alpha)
        * delta
        * np.sum(v * np.expm1(v) ** (alpha - 1) * np.exp(-DIRECT * v))
        / kernel("gl", alpha, DIRECT)
    )


def _nodes(m: int) -> tuple[float, ...]:
    """Return 0 and m - 1 nodes in (0, 1), denser towards both ends.

    They are short fractions, so that moments are matched exactly.
    """
    return tuple(round((1 - math.cos(math.pi * i / (m - 0.5))) * 2048) / 4096 for i in range(m))


def _lump_error(alpha: float, delta: float, x: tuple[float, ...]) -> float:
    """Return the relative error at the horizon of the part below s0."""
    k = np.exp(-delta * np.arange(1, 400))
    omega = np.abs(np.prod(k[:, None] - np.array(x), axis=1))
    gain = 1.0 if alpha == 1 else _sin(alpha) * math.gamma(1 - alpha)
    return (
        gain
        * delta
        * float(np.sum(k**alpha * omega))
        * 0.25 ** (len(x) + alpha)
        / math.factorial(len(x))
    )


# Weights ------------------------------------------------------------------------------
def weights(r: Rates, scheme: str, alpha: float) -> Weights:
    """Return the weights of the order alpha, 0 < alpha < 1, for given rates.

    Parameters
    ----------
    r : Rates
    scheme : {"gl", "l1", "straight"}
    alpha : float

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.design.fractional import kernel, rates, weights
    >>> r = rates(1e-10, 1e6)
    >>> w = weights(r, "gl", 0.3)
    >>> j = np.array([8, 100, 1000])
    >>> v = w.constant + np.exp(-np.outer(j - 8, r.s)) @ w.modes
    >>> bool(np.abs(v / kernel("gl", 0.3, j) - 1).max() < 1e-10)
    True
    """
    if scheme == "gl":
        exact, taps = Fraction(1), [1.0]
        for j in range(1, DIRECT):
            exact *= (j - Fraction(alpha)) / j
            taps.append(float(exact))
    else:
        taps = [float(v) for v in kernel(scheme, alpha, np.arange(DIRECT))]
    low = _lump(r, scheme, alpha)
    first = [r.s0**alpha * w * math.exp(-x * r.s0 * DIRECT) for w, x in zip(low, r.x, strict=True)]
    grid = _sin(alpha) * r.delta * r.grid * _phi(scheme, alpha, r.grid) * np.exp(-DIRECT * r.grid)
    return Weights(np.array(taps), first[0], np.concatenate([first[1:], grid]))


def _lump(r: Rates, scheme: str, alpha: float) -> list[float]:
    """Return the weights of the nodes in [0, s0], divided by s0^alpha.

    Their moments equal those of the grid below s0.
    """
    series = _series(scheme, alpha)

    def moment(e):
        return _sin(alpha) * r.delta / math.expm1(e * r.delta) if e > 1e-200 else 1.0

    m = len(r.x)
    moments = [
        Fraction(math.fsum(g * r.s0**q * moment(alpha + i + q) for q, g in enumerate(series)))
        for i in range(m)
    ]
    return [
        float(sum((c * v for c, v in zip(row, moments, strict=True)), Fraction(0)))
        for row in _lagrange(r.x)
    ]


def _series(scheme: str, alpha: float, n: int = 8) -> list[float]:
    """Return the power series of phi(s) s^(1 - alpha)."""
    if scheme == "l1":
        return [(-1) ** k / math.factorial(k + 1) for k in range(n)]
    if scheme == STRAIGHT:
        return [0.0 if k % 2 else 2 / math.factorial(k + 2) for k in range(n)]
    base = [1 / math.factorial(k + 1) for k in range(n)]  # ((exp(s) - 1)/s)^(alpha - 1)
    out = [1.0]
    for k in range(1, n):
        out.append(
            sum(((alpha - 1) * i - (k - i)) * base[i] * out[k - i] for i in range(1, k + 1)) / k
        )
    return out


@cache
def _lagrange(x: tuple[float, ...]) -> list[list[Fraction]]:
    """Return the coefficients of the Lagrange polynomials of the nodes.

    Each is 1 at one node and 0 at the others. They are exact, lowest power first.
    """
    nodes = [Fraction(v) for v in x]
    rows = []
    for i, a in enumerate(nodes):
        c = [Fraction(1)]
        for k, b in enumerate(nodes):
            if k != i:
                up, down = [Fraction(0), *c], [*(-b * v for v in c), Fraction(0)]
                c = [(p + q) / (a - b) for p, q in zip(up, down, strict=True)]
        rows.append(c)
    return rows


# The bound ----------------------------------------------------------------------------
def bound(r: Rates, alpha: float) -> float:
    """Return a bound e(alpha) <= tol on the relative error of a springpot's sum.

    error of f[n]| <= e h^-alpha sum_j v_j |d[n-j]|, the same for gl and l1.

    It is the sum of four parts: 1.5 times the aliasing of the grid; the truncation of
    the grid above its end and below its beginning; the rounding of modes whose state is
    one word (a sum that leaks with the rate s has a relative error of up to 2^-53/s);
    and 32 roundings.

    Parameters
    ----------
    r : Rates
    alpha : float
        From 0 to 1.

    Examples
    --------
    >>> from stimlib.design.fractional import bound, rates
    >>> r = rates(1e-10, 1e8)
    >>> bound(r, 0.05) < 0.1 * bound(r, 0.9) < 1e-11
    True
    """
    e = 1.5 * aliasing(alpha, r.delta) + ROUNDING
    top = r.grid[-1] * math.exp(r.delta)
    return e + _beyond(alpha, top, r.delta) + _lump_error(alpha, r.delta, r.x) + _coarse(r, alpha)


def _coarse(r: Rates, alpha: float) -> float:
    """Return the rounding error of the modes whose state is one word.

    It is the largest sum_k c_k exp(-s_k j) 2^-53/s_k over v_j.
    """
    s = r.s[r.fine :]
    a = min(alpha, 1 - 1e-9)
    c = _sin(a) * r.delta * s * np.expm1(s) ** (a - 1)
    j = np.unique(np.floor(np.geomspace(DIRECT, max(r.samples, 100.0), 200)))
    error = np.exp(-np.outer(j, s)) @ (c / s) * 2.0**-53
    return float(np.max(error / kernel("gl", a, j)))


# Live orders --------------------------------------------------------------------------
class LiveOrders(NamedTuple):
    """Weights of a springpot's sum as functions of alpha.

    modes[k] = g_k a_k exp(alpha (high_k + low_k)), with g = sin(pi alpha)/pi on the
    grid.

    For the nodes below s0 (the constant first), and for the direct taps, g = (1 -
    alpha) times a polynomial.
    """

    a: np.ndarray
    high: np.ndarray
    low: np.ndarray
    # Chebyshev coefficients, DEGREE + 1 in a row: nodes below s0, then v_0/(1 -
    # alpha)^0, v_j/(1 - alpha)
    poly: np.ndarray


def live(r: Rates, scheme: str) -> LiveOrders:
    """Return the parameters for an order that is a signal; see ``LiveOrders``.

    Parameters
    ----------
    r : Rates
    scheme : {"gl", "l1"}
    """
    x = np.array(r.x)
    if scheme == "gl":
        inner = np.array([math.expm1(v) for v in r.grid])
        a = r.delta * r.grid / inner * np.exp(-DIRECT * r.grid)
    else:
        inner = r.grid
        a = (
            r.delta
            * np.array([-math.expm1(-v) for v in r.grid])
            / r.grid
            * np.exp(-DIRECT * r.grid)
        )
    logs = [two_words(v) for v in (*[r.s0] * x.size, *inner)]
    n = DEGREE + 1
    odd = 2 * np.arange(n) + 1  # nodes at cos(pi odd/2n)
    cosine = np.array([math.sin(math.pi * (n - k) / (2 * n)) for k in range(2 * n + 1)])
    turn = np.outer(np.arange(n), odd) % (4 * n)
    basis = cosine[np.minimum(turn, 4 * n - turn)] * 2 / n
    rows = []
    for t in cosine[odd]:
        alpha = (1 + float(t)) / 2
        w = weights(r, scheme, alpha)
        rest = 1 - alpha
        rows.append([*(v / rest for v in _lump(r, scheme, alpha)), w.taps[0], *(w.taps[1:] / rest)])
    values = np.array(rows)
    basis[0] /= 2
    longs, shorts = np.array(logs).T.copy()
    nodes = np.concatenate([np.exp(-DIRECT * r.s0 * x), a])
    return LiveOrders(nodes, longs, shorts, (basis @ values).T.ravel().copy())


def two_words(v: float) -> tuple[float, float]:
    """Return log(v) as a sum of two floats."""
    exact = Context(prec=40).ln(Decimal(v))
    high = float(exact)
    return high, float(exact - Decimal(high))
