"""Sensitivity in forced choices and rating ROCs: against integrals in 25 digits, other
programs' printed results, and simulated people.
"""

import numpy as np
import pytest
from laws import mostly
from mpmath import mp, mpf, ncdf, npdf, quad
from refusals import refused
from scipy.stats import binom, norm

from stimlib.errors import BadValue
from stimlib.experiments.signal_detection import PROBLEMS, detection, forced_choice, roc


# Forced choice ------------------------------------------------------------------------
def right(d, m):
    """Return the proportion of right answers, integrated in 25 digits."""
    with mp.workdps(25):
        return quad(
            lambda x: npdf(x - mpf(d)) * ncdf(x) ** (m - 1), [-20, -3, 0, 1, 2, 3, 4, 6, 8, 20]
        )


@pytest.mark.parametrize(
    "case", mostly([(2, 99), (32, 3)], [(2, 3), (2, 99), (3, 80), (8, 99), (32, 3), (1000, 80)])
)
def test_d_of_a_forced_choice_is_where_the_integral_is_the_proportion(case):
    """Hacker and Ratcliff (1979) print these to two digits."""
    m, k = case
    assert float(right(forced_choice(k, 100, m).d, m)) == pytest.approx(k / 100, abs=1e-13)
    assert forced_choice(10, 10 * m, m).d == pytest.approx(0, abs=1e-12)
    assert forced_choice(10**9 - 1, 10**9).d == pytest.approx(2**0.5 * 5.99780701, rel=1e-7)


@pytest.mark.parametrize("m", [2, 4])
def test_intervals_of_a_forced_choice_contain_the_truth(m):
    """Exactly, by the binomial distribution: in at least 95 % of experiments, for any
    d', and in not many more.
    """
    n, cover = 50, []
    low, high = np.transpose([forced_choice(k, n, m).interval for k in range(n + 1)])
    x = np.linspace(-9, 15, 4801)
    for d in np.arange(0, 3.6, 0.1):
        p = np.trapezoid(norm.pdf(x - d) * norm.cdf(x) ** (m - 1), x)
        cover.append(binom.pmf(range(n + 1), n, p) @ ((low <= d) & (d <= high)))
    assert min(cover) >= 0.95 and np.mean(cover) < 0.98


def test_problems_of_a_forced_choice():
    assert forced_choice(32, 40, 4).problems == ()
    ceiling, guessed, mistaken, none = (forced_choice(k, 40, 4) for k in (40, 12, 2, 0))
    assert ceiling.problems == ("ceiling",) and ceiling.d == ceiling.interval[1] == np.inf
    assert 2.0 < ceiling.interval[0] < np.inf
    assert guessed.problems == ("chance",) and guessed.interval[0] < 0 < guessed.interval[1]
    assert mistaken.problems == none.problems == ("below chance",)
    assert forced_choice(39, 40, 4).problems == ()
    few = forced_choice(9, 40, 4)  # below chance, and chance itself is in the interval
    assert few.d < 0 and few.problems == ("chance",)
    assert none.d == none.interval[0] == -np.inf
    # two of two: all right, and yet no evidence
    assert forced_choice(2, 2).problems == ("ceiling", "chance")
    assert {*PROBLEMS} >= {"ceiling", "chance", "below chance"}
    wide, narrow = forced_choice(32, 40, confidence=0.99), forced_choice(32, 40, confidence=0.5)
    assert wide.interval[0] < narrow.interval[0] < narrow.d < narrow.interval[1]


# Ratings ------------------------------------------------------------------------------
SIGNAL, NOISE = [3, 2, 2, 11, 33], [33, 6, 6, 11, 2]  # Hanley and McNeil (1982), CT images


def test_roc_of_the_images_of_hanley_and_mcneil():
    """They print an area of .893; Stata's roctab an error of .0307 (DeLong), its rocfit
    an intercept of 1.656782, a slope of .713002 (error .2159), an area of .911331 and
    d_a 1.907771 (error .2598), with errors of the observed instead of the expected
    information.
    """
    found, less = roc(SIGNAL, NOISE), roc(SIGNAL, NOISE, confidence=0.5)
    slope = found.slope
    assert (found.area.value, found.area.error) == pytest.approx((0.8932, 0.0307), abs=5e-5)
    a = found.d_a.value / np.sqrt(2 / (1 + slope.value**2))
    printed = 1.656782, 0.713002, 0.911331, 1.907771
    assert (a, slope.value, found.area_z, found.d_a.value) == pytest.approx(printed, abs=1e-6)
    assert (slope.error, found.d_a.error) == pytest.approx((0.2159, 0.2598), rel=5e-3)
    assert found.hit_rates == pytest.approx([33 / 51, 44 / 51, 46 / 51, 48 / 51])
    assert found.false_alarm_rates == pytest.approx([2 / 58, 13 / 58, 19 / 58, 25 / 58])
    assert found.criteria == tuple(sorted(found.criteria, reverse=True)) and not found.problems
    for one, other in ((found.area, less.area), (slope, less.slope), (found.d_a, less.d_a)):
        assert one.low < other.low < one.value == other.value < other.high < one.high
    wide = np.exp(1.959963985 * slope.error / slope.value)  # on the log scale
    assert (slope.low, slope.high) == pytest.approx((slope.value / wide, slope.value * wide))
    # a category that nobody used changes nothing
    unused = (np.insert(row, 2, 0) for row in (SIGNAL, NOISE))
    assert roc(*unused).d_a.value == pytest.approx(found.d_a.value, rel=1e-7)


@pytest.mark.parametrize(("d", "b"), [(1.5, 1.0), (1.2, 0.6)])
def test_d_a_of_equal_variances_is_d(d, b):
    """Exact proportions of a model give its parameters; each point alone gives d'."""
    c, n = np.array([-1.0, 0.0, 0.5, 1.2]), 10**8
    noise, signal = (np.diff([0.0, *norm.cdf(s * c - a), 1.0]) for s, a in ((1, 0), (b, d * b)))
    counts = np.round(np.array([signal, noise]) * n)
    found = roc(*counts)
    wanted = b, d * b * np.sqrt(2 / (1 + b * b))
    assert (found.slope.value, found.d_a.value) == pytest.approx(wanted, abs=1e-5)
    assert found.criteria == pytest.approx(c[::-1], abs=1e-5)
    yes, false = (np.cumsum(row[:0:-1]) for row in counts)
    each = [detection(h, n, f, n).d for h, f in zip(np.round(yes), np.round(false), strict=True)]
    # where variances differ, d' depends on the criterion
    assert np.ptp(each) > 0.5 or (b == 1 and each == pytest.approx([d] * 4, abs=1e-5))


def test_as_many_trials_as_a_float_counts():
    """1e15 of them: the ends of the interval and the area are numbers still."""
    many = 10**15
    for k in (0, 1, many - 1, many):
        for m in (2, 1000):
            found = forced_choice(k, many, m)
            assert found.interval[0] <= found.d <= found.interval[1]
    area = roc([1, many - 1], [many - 1, 1]).area
    assert 0 < 1 - area.value < 1e-14 and area.low < area.value < area.high


def test_problems_of_ratings():
    apart, single, pair = (
        roc([0, 0, 5, 5], [5, 5, 0, 0]),
        roc([3, 7], [8, 2]),
        roc([2, 4, 0], [3, 3, 0]),
    )
    assert apart.problems == ("apart", "slope") and apart.area.value == 1
    assert np.isnan([apart.area.low, apart.area.high, apart.d_a.value, apart.area_z]).all()
    assert single.problems == pair.problems == ("slope",)
    assert 0.5 < single.area.low < single.area.value == 0.75 and single.criteria == ()
    # one criterion has the same false alarms as the next: any steep line fits
    assert roc([3, 4, 5], [8, 0, 4]).problems == ("slope",)
    assert roc([0, 0, 4], [0, 0, 4]).problems == ("apart", "slope")


# What cannot be used ------------------------------------------------------------------
@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: forced_choice(41, 40), "forced_choice: 41 of 40"),
        (lambda: forced_choice(3, 4, 1), "alternatives = 1 must be .* from 2 to 1000"),
        (lambda: forced_choice(3, 4, confidence=95), "confidence = 95"),
        (lambda: roc([1, 2], [1, 2, 3]), r"shapes \(2,\) and \(3,\)"),
        (lambda: roc([3], [3]), "two or more ratings"),
        (lambda: roc([0, 1], [2, 3]), "at least two trials"),
        (lambda: roc([0, 0], [2, 3]), "roc: 0.0 of 0.0"),
        (lambda: roc([1, 2.5], [2, 3]), "roc: 1.0 of 3.5: give whole numbers"),
        (lambda: roc([1, 2], [2, -3]), "roc: 2.0 of -1.0"),
        (lambda: roc([1, 2], [2, np.nan]), "roc: 2.0 of nan"),
        (lambda: roc([1, 2], [2, 3], 1.0), "confidence = 1.0"),
        (lambda: roc([np.inf, -np.inf], [1, 1]), "roc: inf of nan"),
        (lambda: roc([1e308, 1e308], [1, 1]), r"roc: 1e\+308 of inf"),
        (lambda: roc([1, 1e17], [1e17, 1]), r"at most 1e\+15"),
        (lambda: forced_choice(1, 1e300), r"at most 1e\+15"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_what_cannot_be_used_is_said(call, said):
    refused(BadValue, said, call)
