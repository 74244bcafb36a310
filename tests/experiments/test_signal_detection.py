"""Sensitivity in forced choices and rating ROCs: against integrals in 25 digits, other
programs' printed results, and simulated people.
"""

import numpy as np
import pytest
from mpmath import mp, mpf, ncdf, npdf, quad

from stimlib.errors import BadValue
from stimlib.experiments.signal_detection import PROBLEMS, detection, forced_choice, roc


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
    found = roc(SIGNAL, NOISE)
    assert (found.area.value, found.area.error) == pytest.approx((0.8932, 0.0307), abs=5e-5)
    a = found.d_a.value / np.sqrt(2 / (1 + found.slope.value**2))
    assert (a, found.slope.value) == pytest.approx((1.656782, 0.713002), abs=1e-6)
    assert (found.area_z, found.d_a.value) == pytest.approx((0.911331, 1.907771), abs=1e-6)
    assert (found.slope.error, found.d_a.error) == pytest.approx((0.2159, 0.2598), rel=5e-3)
    assert found.hit_rates == pytest.approx([33 / 51, 44 / 51, 46 / 51, 48 / 51])
    assert found.false_alarm_rates == pytest.approx([2 / 58, 13 / 58, 19 / 58, 25 / 58])
    assert found.criteria == tuple(sorted(found.criteria, reverse=True)) and not found.problems
    less = roc(SIGNAL, NOISE, confidence=0.5)
    for one, other in ((found.area, less.area), (found.slope, less.slope), (found.d_a, less.d_a)):
        assert one.low < other.low < one.value == other.value < other.high < one.high


def test_the_interval_of_a_slope_is_on_the_log_scale():
    slope = roc(SIGNAL, NOISE).slope
    assert slope.high / slope.value == pytest.approx(slope.value / slope.low)
    wanted = np.exp(1.959963985 * slope.error / slope.value)
    assert slope.high / slope.value == pytest.approx(wanted)


def test_the_area_is_the_part_of_pairs_that_are_ordered_rightly():
    """And its error that of DeLong's placements, trial by trial."""
    found = roc(SIGNAL, NOISE).area
    signal, noise = np.repeat(np.arange(5), SIGNAL), np.repeat(np.arange(5), NOISE)
    higher = (np.sign(signal[:, None] - noise) + 1) / 2
    parts = higher.mean(1), higher.mean(0)
    error = sum(part.var(ddof=1) / part.size for part in parts) ** 0.5
    assert (found.value, found.error) == pytest.approx((higher.mean(), error), rel=1e-12)
    turned = roc(NOISE, SIGNAL).area
    assert (turned.value, turned.error) == pytest.approx((1 - found.value, found.error))
    assert (turned.low, turned.high) == pytest.approx((1 - found.high, 1 - found.low))


def test_no_parameters_are_more_likely():
    """scipy's BFGS, from near the maximum, finds no better ones; a category that nobody
    used changes nothing.
    """
    from scipy.optimize import minimize
    from scipy.special import ndtr, xlogy

    def worse(theta, counts):
        a, b, c = theta[0], theta[1], theta[2:]
        p = np.diff(ndtr([-c, a - b * c]), prepend=0, append=1)
        return -xlogy(counts, np.maximum(p, 1e-300)).sum()

    rng = np.random.default_rng(1)
    for low, high, size in ((0.3, 0.7, 30), (0.4, 0.6, 60), (0.7, 0.4, 40), (0.2, 0.8, 200)):
        signal, noise = (
            np.bincount(rng.binomial(4, p, size), minlength=5) + 1 for p in (high, low)
        )
        found, counts = roc(signal, noise), np.array([noise[::-1], signal[::-1]])
        b = found.slope.value
        theta = np.array([found.d_a.value / np.sqrt(2 / (1 + b * b)), b, *found.criteria])
        best = minimize(worse, theta + 0.05 * rng.normal(size=theta.size), counts, method="BFGS")
        assert worse(theta, counts) <= best.fun + 1e-9
        assert theta == pytest.approx(best.x, abs=2e-3)
        unused = (np.insert(row, 2, 0) for row in (signal, noise))
        assert roc(*unused).d_a.value == pytest.approx(found.d_a.value, rel=1e-7)


def test_d_a_of_equal_variances_is_d():
    """Exact proportions of a model give its parameters; each point alone gives d'."""
    from scipy.stats import norm

    c, n = np.array([-1.0, 0.0, 0.5, 1.2]), 10**8
    for d, b in ((1.5, 1.0), (1.2, 0.6)):
        noise, signal = (np.diff([0.0, *norm.cdf(s * c - a), 1.0]) for s, a in ((1, 0), (b, d * b)))
        counts = np.round(np.array([signal, noise]) * n)
        found = roc(*counts)
        assert found.slope.value == pytest.approx(b, abs=1e-5)
        assert found.d_a.value == pytest.approx(d * b * np.sqrt(2 / (1 + b * b)), abs=1e-5)
        assert found.criteria == pytest.approx(c[::-1], abs=1e-5)
    (signals, yes), (noises, false) = ((row.sum(), np.cumsum(row[:0:-1])) for row in counts)
    each = [detection(h, signals, f, noises).d for h, f in zip(yes, false, strict=True)]
    assert np.ptp(each) > 0.5  # where variances differ, d' depends on the criterion


def test_intervals_of_ratings_contain_the_truth():
    from scipy.stats import norm

    rng, b, a = np.random.default_rng(3), 0.8, 1.2
    c = np.array([-0.7, 0.0, 0.4, 0.9, 1.5])
    noise, signal = (np.diff([0.0, *norm.cdf(s), 1.0]) for s in (c, b * c - a))
    area = np.sum(signal * (np.cumsum(noise) - noise / 2))
    truth = {"area": area, "slope": b, "d_a": a * np.sqrt(2 / (1 + b * b))}
    studies = [roc(rng.multinomial(80, signal), rng.multinomial(80, noise)) for _ in range(400)]
    for name, value in truth.items():
        found = [getattr(study, name) for study in studies]
        assert 0.92 < np.mean([one.low <= value <= one.high for one in found]) < 0.98
        spread = np.std([one.value for one in found])
        assert np.mean([one.error for one in found]) == pytest.approx(spread, rel=0.12)


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
        (lambda: forced_choice(3, 4, 1), "alternatives = 1 must be from 2 to 1000"),
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
    with pytest.raises(BadValue, match=said):
        call()
