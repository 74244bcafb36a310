"""The sum of exponentials against exact weights (mpmath), and its bound against the
error it really makes.
"""

import math
from functools import cache

import mpmath
import numpy as np
import pytest
from laws import STRESS, mostly
from refusals import refused
from scipy.interpolate import BarycentricInterpolator

from stimlib.design import fractional as soe
from stimlib.errors import BadValue

TOLS = [1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14]
ALPHAS = [1e-6, 0.05, 0.25, 0.5, 0.75, 0.95, 1 - 1e-6]
ALL = (*soe.SCHEMES, soe.STRAIGHT)
DAY = 86400.0
U = 2.0**-53


@cache
def exact(scheme, alpha, j):
    """v_j to 40 digits."""
    with mpmath.workdps(40):
        a, j = mpmath.mpf(alpha), mpmath.mpf(int(j))
        if scheme == "gl":
            return mpmath.exp(
                mpmath.loggamma(j + 1 - a) - mpmath.loggamma(j + 1) - mpmath.loggamma(1 - a)
            )
        if scheme == "straight":
            return (
                (j + 1) ** (2 - a) - 2 * j ** (2 - a) + max(j - 1, 0) ** (2 - a)
            ) / mpmath.gamma(3 - a)
        return ((j + 1) ** (1 - a) - j ** (1 - a)) / mpmath.gamma(2 - a)


def summed(rates, weights, j):
    """What the modes make of v_j, without rounding of the sum."""
    with mpmath.workdps(40):
        terms = (
            mpmath.mpf(c) * mpmath.exp(-mpmath.mpf(s) * int(j - 8))
            for c, s in zip(weights.modes, rates.s, strict=True)
        )
        return mpmath.mpf(weights.constant) + mpmath.fsum(terms)


def lags(samples, n):
    return np.unique(np.r_[8, 9, 11, 16, np.round(np.geomspace(20, samples, n))]).astype(int)


def worst(rates, scheme, alpha, j, weights=None):
    """Largest relative error of v_j over these lags."""
    w = weights or soe.weights(rates, scheme, alpha)
    return max(float(abs(summed(rates, w, k) / exact(scheme, alpha, k) - 1)) for k in j)


@pytest.mark.parametrize("scheme", ALL)
@pytest.mark.parametrize("alpha", ALPHAS)
def test_exact_weights(scheme, alpha):
    j = np.array([0, 1, 2, 7, 8, 62, 63, 64, 65, 100, 1000, 10**5, 7 * 10**8])
    for a, k in zip(soe.kernel(scheme, alpha, j), j, strict=True):
        assert abs(a / exact(scheme, alpha, k) - 1) < 2e-15


@pytest.mark.parametrize("scheme", soe.SCHEMES)
def test_weights_of_the_ends(scheme):
    j = np.arange(100)
    np.testing.assert_array_equal(soe.kernel(scheme, 1.0, j), j == 0)
    np.testing.assert_allclose(soe.kernel(scheme, 0.0, j), 1.0, rtol=1e-15)


@pytest.mark.parametrize("scheme", ALL)
@pytest.mark.parametrize("tol", mostly({1e-6, 1e-14}, TOLS))
@pytest.mark.parametrize("samples", [DAY * 8000, 60e3])
def test_every_weight_is_within_the_bound(scheme, tol, samples):
    """From the eighth to a day at 8 kHz, and for a horizon of a minute."""
    r = soe.rates(tol, samples, scheme)
    for alpha in ALPHAS if STRESS else ALPHAS[::2]:
        e = worst(r, scheme, alpha, lags(samples, 12 if STRESS else 5))
        assert e <= soe.bound(r, alpha) - soe.ROUNDING / 2 <= tol


@pytest.mark.parametrize(("tol", "alpha"), [(1e-4, 0.05), (1e-8, 0.5), (1e-12, 0.95)])
def test_the_bound_is_not_far_from_the_error(tol, alpha):
    r = soe.rates(tol, DAY * 1000)
    assert soe.bound(r, alpha) - soe.ROUNDING <= 10 * worst(r, "gl", alpha, lags(1e4, 60))


@pytest.mark.parametrize("tol", [*TOLS, 0.1, 3e-5, 1e-13])
@pytest.mark.parametrize("samples", [1, 500, 1e6, 1e10])
def test_the_bound_is_below_tol_for_every_order(tol, samples):
    r = soe.rates(tol, samples)
    values = [soe.bound(r, a) for a in (*np.linspace(0, 1, 41), *ALPHAS, 1e-300, 5e-324, 1 - U)]
    assert tol >= max(values) > 0.4 * tol and min(values) > 0


@pytest.mark.parametrize(("tol", "size"), list(zip(TOLS, [32, 44, 56, 69, 81, 95], strict=True)))
def test_how_many_modes(tol, size):
    """The price grows with the logarithms of 1/tol and of the horizon."""
    r = soe.rates(tol, DAY * 8000)
    assert r.s.size == size and np.all(np.diff(r.s) > 0) and r.s[0] > 0
    assert 0 <= r.fine <= size
    assert r.fine == 0 or r.s[r.fine :].min() >= 16 * U / tol > r.s[r.fine - 1]
    assert np.diff([soe.rates(tol, n).s.size for n in 10.0 ** np.arange(3, 11)]).max() <= 9


@pytest.mark.parametrize("alpha", [5e-324, 1e-300, 1e-20, 1 - U])
@pytest.mark.parametrize("scheme", ALL)
def test_orders_next_to_the_ends(scheme, alpha):
    r = soe.rates(1e-10, 1e7)
    w = soe.weights(r, scheme, alpha)
    assert np.isfinite(np.r_[w.taps, w.constant, w.modes]).all()
    assert worst(r, scheme, alpha, [8, 100, 10**6], w) <= soe.bound(r, alpha)


@pytest.mark.parametrize("v", [1e-11, 0.3, 8000.0])
def test_two_words(v):
    with mpmath.workdps(40):
        high, low = map(mpmath.mpf, soe.two_words(v))
        assert abs(high + low - mpmath.log(mpmath.mpf(v))) < 1e-30


@pytest.mark.parametrize(
    ("tol", "say"),
    [
        (1e-15, "tol=1e-14"),
        (0.0, "tol=1e-14"),
        (-1.0, "tol=1e-14"),
        (0.5, "tol=0.1"),
        (math.nan, "tol"),
    ],
)
def test_a_tol_out_of_reach_is_an_error_that_names_the_reachable_one(tol, say):
    refused(BadValue, say, soe.rates, tol, 1e6)


@pytest.mark.parametrize("alpha", [0.02, 0.5, 1.0])
def test_modes_below_the_grid_are_off_by_what_interpolation_is(alpha):
    """Between nodes, at a quarter of the horizon's rate, by a polynomial of its own."""
    nodes = np.array(soe._nodes(4))
    k = np.exp(-np.arange(1, 60))
    lumped = BarycentricInterpolator(nodes, np.exp(-nodes / 4))(k)
    gain = 1.0 if alpha == 1 else math.sin(math.pi * alpha) / math.pi * math.gamma(1 - alpha)
    error = gain * 0.25**alpha * np.sum(k**alpha * np.abs(np.exp(-k / 4) - lumped))
    assert error <= soe._lump_error(alpha, 1.0, tuple(nodes)) <= math.exp(0.25) * error
