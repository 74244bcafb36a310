"""Sensitivity in forced choices and rating ROCs: against integrals in 25 digits, other
programs' printed results, and simulated people.
"""

import numpy as np
import pytest
from mpmath import mp, mpf, ncdf, npdf, quad

from stimlib.errors import BadValue
from stimlib.experiments.signal_detection import PROBLEMS, forced_choice


# Forced choice ------------------------------------------------------------------------
def right(d, m):
    """Return the proportion of right answers, integrated in 25 digits."""
    with mp.workdps(25):
        return quad(
            lambda x: npdf(x - mpf(d)) * ncdf(x) ** (m - 1), [-20, -3, 0, 1, 2, 3, 4, 6, 8, 20]
        )


@pytest.mark.parametrize("m", [2, 3, 4, 8, 32, 1000])
@pytest.mark.parametrize("k", [3, 80, 99])
def test_d_of_a_forced_choice_is_where_the_integral_is_the_proportion(m, k):
    """Hacker and Ratcliff (1979) print these to two digits."""
    assert float(right(forced_choice(k, 100, m).d, m)) == pytest.approx(k / 100, abs=1e-13)


def test_d_of_a_forced_choice_has_known_values():
    """At d' = 1 an observer is right in 76.0 % of 2AFC trials: Phi(1/sqrt 2), and in
    63.4 and 55.2 % of 3AFC and 4AFC trials; at d' = 0 in 1/m.
    """
    for m, k in ((2, 7602), (3, 6337), (4, 5520)):
        assert forced_choice(k, 10000, m).d == pytest.approx(1, abs=5e-4)
    assert all(forced_choice(10, 10 * m, m).d == pytest.approx(0, abs=1e-12) for m in (2, 5, 10))
    assert forced_choice(10**9 - 1, 10**9).d == pytest.approx(2**0.5 * 5.99780701, rel=1e-7)


@pytest.mark.parametrize("m", [2, 4])
def test_intervals_of_a_forced_choice_contain_the_truth(m):
    """Exactly, by the binomial distribution: in at least 95 % of experiments, for any
    d', and in not many more.
    """
    from scipy.integrate import quad
    from scipy.stats import binom, norm

    n = 50
    found = [forced_choice(k, n, m) for k in range(n + 1)]
    cover = []
    for d in np.arange(0, 3.6, 0.1):
        inside = np.array([f.interval[0] <= d <= f.interval[1] for f in found])
        p = quad(lambda x, d=d: norm.pdf(x - d) * norm.cdf(x) ** (m - 1), -9, 15)[0]
        cover.append(binom.pmf(range(n + 1), n, p) @ inside)
    assert min(cover) >= 0.95 and np.mean(cover) < 0.98


def test_problems_of_a_forced_choice():
    assert forced_choice(32, 40, 4).problems == ()
    ceiling, guessed, mistaken, none = (forced_choice(k, 40, 4) for k in (40, 12, 2, 0))
    assert ceiling.problems == ("ceiling",) and ceiling.d == ceiling.interval[1] == np.inf
    assert 2.0 < ceiling.interval[0] < np.inf
    assert guessed.problems == ("chance",) and guessed.interval[0] < 0 < guessed.interval[1]
    assert mistaken.problems == none.problems == ("below chance",)
    assert none.d == none.interval[0] == -np.inf
    # two of two: all right, and yet no evidence
    assert forced_choice(2, 2).problems == ("ceiling", "chance")
    assert {*PROBLEMS} >= {"ceiling", "chance", "below chance"}
    wide, narrow = forced_choice(32, 40, confidence=0.99), forced_choice(32, 40, confidence=0.5)
    assert wide.interval[0] < narrow.interval[0] < narrow.d < narrow.interval[1]


# What cannot be used ------------------------------------------------------------------
@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: forced_choice(41, 40), "forced_choice: 41 of 40"),
        (lambda: forced_choice(3, 4, 1), "alternatives = 1 must be from 2 to 1000"),
        (lambda: forced_choice(3, 4, confidence=95), "confidence = 95"),
    ],
)
def test_what_cannot_be_used_is_said(call, said):
    with pytest.raises(BadValue, match=said):
        call()
