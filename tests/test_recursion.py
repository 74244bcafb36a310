"""What laws and thresholds compute without scipy, against scipy."""

import numpy as np
import pytest
import scipy

from stimlib.analysis.recursion import all_pole, solve_banded
from stimlib.analysis.spectra import crossing, sum_p


@pytest.mark.parametrize("a", [[-0.9], [-1.8, 0.81], [-1.2, 0.3, 0.1]])
def test_pieces_make_what_lfilter_makes(a):
    x, last, got = np.random.default_rng(1).normal(size=200), None, []
    for piece in np.split(x, [0, 1, 1, 3, 6, 100]):
        y, last = all_pole(0.3, a, piece, last)
        got.append(y)
    want = scipy.signal.lfilter([0.3], [1, *a], x)
    assert np.abs(np.concatenate(got) - want).max() < 1e-13 * np.abs(want).max()
    assert np.array_equal(last, np.concatenate(got)[-len(a) :])


@pytest.mark.parametrize("n", [6, 31, 32, 33, 200])
def test_banded_systems_are_solved_as_by_lapack(n):
    bands, want = np.zeros((5, n)), np.random.default_rng(n).normal(size=n)
    differences = np.diff(np.eye(n), 4, axis=0)
    matrix = 1e3 * differences.T @ differences + np.eye(n)
    for k in range(5):
        bands[k, : n - k] = np.diag(matrix, -k)
    exact = scipy.linalg.solveh_banded(bands, want, lower=True)
    assert np.abs(solve_banded(bands, want) - exact).max() < 1e-10 * np.abs(exact).max()


@pytest.mark.parametrize("m", [1, 8, 100, 3000])
def test_sums_of_exponentials_are_gamma_distributed(m):
    for total in m * np.array([1e-3, 0.3, 0.9, 0.999, 1.0, 1.001, 1.1, 3.0]):
        want = 2 * min(scipy.special.gammaincc(m, total), scipy.special.gammainc(m, total))
        assert abs(sum_p(m, total) - want) <= 1e-9 * want
    assert sum_p(m, 0.0) < 1e-290 and sum_p(m, np.inf) == 0.0


def test_a_crossing_is_found_in_few_steps():
    calls = []

    def steep(x):
        calls.append(x)
        return np.expm1(20 * (x - 0.3))

    assert abs(crossing(steep, 0.0, 1.0) - 0.3) < 1e-15
    assert len(calls) < 40
