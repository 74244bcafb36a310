"""Tests between groups and within people: against other programs, printed examples, the
papers' counts, and chance.
"""

from functools import partial
from itertools import product

import numpy as np
import pytest
from refusals import refused
from scipy import stats
from scipy.stats import chi2_contingency, norm

from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    anova,
    detection,
    diagnosis,
    dunn,
    kruskal,
    mixed,
    paired,
    repeated,
    shapiro,
    wilson,
)

# R's airquality, by month, without the days that are missing
OZONE = {
    month: [int(v) for v in days.split()]
    for month, days in {
        "5": "41 36 12 18 28 23 19 8 7 16 11 14 18 14 34 6 30 11 1 11 4 32 23 45 115 37",
        "6": "29 71 39 23 21 37 20 12 13",
        "7": "135 49 32 64 40 77 97 97 85 10 27 7 48 35 61 79 63 16 80 108 20 52 82 50 64 59",
        "8": "39 9 16 78 35 66 122 89 110 44 28 65 22 59 23 31 44 21 9 45 168 73 76 118 84 85",
        "9": "96 78 73 91 47 32 20 23 21 24 44 21 28 9 13 46 18 13 24 16 13 23 36 7 14 30 14 18 20",
    }.items()
}


# Between groups -----------------------------------------------------------------------
def test_ranks_of_the_example_of_r():
    """kruskal.test(Ozone ~ Month, airquality) prints 29.267; dunn.test of the same,
    these z.
    """
    found = kruskal(OZONE)
    assert found.value == pytest.approx(29.2666, abs=5e-5) and found.df == (4,)
    assert found.p == pytest.approx(6.901e-06, rel=1e-4)
    printed = {
        ("5", "6"): -0.925158,
        ("5", "7"): -4.419470,
        ("6", "7"): -2.244208,
        ("5", "8"): -4.132813,
        ("5", "9"): -1.321202,
        ("7", "8"): 0.286657,
        ("7", "9"): 3.217199,
        ("8", "9"): 2.922827,
    }
    z = {(p.a, p.b): p.statistic for p in dunn(OZONE)}
    assert {k: z[k] for k in printed} == pytest.approx(printed, abs=5e-6)


@pytest.mark.parametrize(("found", "n"), [((183, 236, 239), 252), ((294, 343, 351), 364)])
def test_dunn_of_the_counts_of_the_nodules(found, n):
    """Of zeros and ones, of the nodules alone or of all sides: H is chi squared of the
    table times (N - 1)/N; of equal groups it is 2/3 of the sum of z^2.
    """
    groups = {k: np.repeat([1, 0], [v, n - v]) for k, v in enumerate(found)}
    table = chi2_contingency([found, np.subtract(n, found)], correction=False).statistic
    H, pairs, N = kruskal(groups).value, dunn(groups, adjustment="none"), 3 * n
    assert H == pytest.approx(table * (N - 1) / N, rel=1e-10)
    assert H == pytest.approx(2 / 3 * sum(p.statistic**2 for p in pairs), rel=1e-10)
    uneven = dunn({"a": groups[0], "b": np.repeat(groups[1], 2)}, adjustment="none")
    a, b, pooled = found[0] / n, found[1] / n, (found[0] + 2 * found[1]) / N
    error = np.sqrt(pooled * (1 - pooled) * N / (N - 1) * (1 / n + 1 / (2 * n)))
    assert uneven[0].statistic == pytest.approx((a - b) / error, rel=1e-10)


def test_the_printed_z_of_the_nodules():
    """Table 1 of Li et al.: H follows from the z with -3.804, not with the -3.040 that
    is printed; p is one-sided, times 3.
    """
    assert 2 / 3 * (3.637**2 + 3.804**2 + 0.167**2) == pytest.approx(18.482, abs=0.01)
    assert 3 * norm.sf([3.804, 3.040]) == pytest.approx([0.0002, 0.0035], abs=5e-5)
    a, b = (dunn(OZONE, sides)[1].p for sides in ("one-sided", "two-sided"))
    assert b == pytest.approx(2 * a) and a == pytest.approx(10 * norm.sf(4.419470), rel=1e-5)
    assert dunn(OZONE, adjustment="none")[1].p == pytest.approx(b / 10)
    assert dunn(OZONE)[0].p == 1.0


def test_independent_and_paired_are_not_the_same():
    a, b = np.array([2.4, 2.3, 2.6, 2.1, 2.9]), np.array([2.0, 2.1, 2.1, 2.0, 2.5])
    for found, other, df in (
        (anova({"a": a, "b": b}), stats.f_oneway(a, b), (1, 8)),
        (paired(a, b), stats.ttest_rel(a, b), (4,)),
    ):
        assert (found.value, found.p) == pytest.approx((other.statistic, other.pvalue), rel=1e-12)
        assert found.df == df
    assert paired(a, b).p < 0.02 < anova({"a": a, "b": b}).p
    assert paired(a, b).effect == pytest.approx((a - b).mean() / (a - b).std(ddof=1), rel=1e-12)


@pytest.mark.parametrize(
    "groups",
    [
        {"a": [1, 2], "b": [3, 4]},
        {"a": [1, 2], "b": [2, 1]},
        {"a": [2.4, 2.3, 2.6, 2.1], "b": [2.0, 2.1, 2.1, 2.0], "c": [1.0, 1.4, 1.9]},
    ],
)
def test_the_effect_size_of_groups_is_their_part_of_the_squares(groups):
    every = np.concatenate([*groups.values()])
    between = sum(len(x) * (np.mean(x) - every.mean()) ** 2 for x in groups.values())
    part = between / np.sum((every - every.mean()) ** 2)
    assert anova(groups).effect == pytest.approx(part, abs=1e-12)
    # of groups that do not overlap it is the largest that ranks allow
    apart = kruskal({"a": [1, 2, 3], "b": [4, 5, 6]})
    assert apart.effect == pytest.approx(apart.value / 5) == pytest.approx(27 / 35)


def test_a_small_p_of_shapiro_is_not_normal():
    rng = np.random.default_rng(1)
    assert shapiro(rng.normal(size=100)).p > 0.05 > shapiro(rng.exponential(size=100)).p
    assert np.isnan(shapiro([1.0, 2.0, 4.0, 3.0]).effect)
    # whatever the unit
    assert len({repr(shapiro(np.ldexp([1.0, 2.0, 4.0, 9.0], k))) for k in (-200, 0, 200)}) == 1


# Within people ------------------------------------------------------------------------
def test_repeated_measures_are_those_of_statsmodels():
    import pandas as pd
    from statsmodels.stats.anova import AnovaRM

    y = (
        np.random.default_rng(2).normal(size=(6, 3, 2, 4))
        + np.arange(4) * np.arange(3)[:, None, None]
    )
    rows = [(*at, y[at]) for at in product(*map(range, y.shape))]
    table = pd.DataFrame(rows, columns=["participant", "wave", "duty", "amplitude", "rating"])
    factors = ["wave", "duty", "amplitude"]
    other = AnovaRM(table, "rating", "participant", within=factors).fit().anova_table
    for effect in repeated(y, factors):
        F, *df, p = other.loc[effect.name]
        assert (effect.F, effect.p) == pytest.approx((F, p), rel=1e-8) and effect.df == tuple(df)


def test_effect_sizes_are_those_of_pingouin():
    """Of its rm_anova (0.7.0), printed with effsize "np2" and "ng2"."""
    rng = np.random.default_rng(1)
    y = rng.normal(size=(8, 3, 2)) + np.arange(3)[:, None] * 0.5 + rng.normal(size=(8, 1, 1))
    sizes = [(e.eta2, e.generalized_eta2) for e in repeated(y, ("a", "b"))]
    printed = [0.689457, 0.321108, 0.009509, 0.000318, 0.026852, 0.006388]
    assert np.ravel(sizes) == pytest.approx(printed, abs=5e-7)
    assert repeated(np.array([y, 2 * y]), ("a", "b"))[0].generalized_eta2.shape == (2,)


def test_epsilon_is_one_of_spherical_data_and_small_of_a_trend():
    """Of two conditions it is 1; of people who differ in one direction only it is 1/df;
    by the printed formula of Greenhouse and Geisser between.
    """
    y = np.random.default_rng(3).normal(size=(9, 4))
    (effect,) = repeated(y)
    S = np.cov((y - y.mean(1)[:, None]).T)  # centred: tr(S)^2/((k - 1) sum S^2)
    assert effect.epsilon == pytest.approx(np.trace(S) ** 2 / (3 * np.sum(S**2)), rel=1e-10)
    assert 1 / 3 < effect.epsilon < 1 and repeated(y[:, :2])[0].epsilon == pytest.approx(1)
    trend = np.outer(np.arange(9.0), [0, 1, 2, 3]) + [0, 0, 1, 0]
    assert repeated(trend)[0].epsilon == pytest.approx(1 / 3)
    df = 3 * effect.epsilon, 24 * effect.epsilon
    assert effect.p_corrected == pytest.approx(stats.f.sf(effect.F, *df), rel=1e-10)
    assert effect.eta2 == pytest.approx(effect.F * 3 / (effect.F * 3 + 24))


def drifting(rng, shared, studies=2000, people=10, conditions=9, repetitions=4):
    """Mean ratings where nothing differs but the time: all drift alike, people's
    answers vary.
    """
    trials = conditions * repetitions
    times = np.argsort(rng.random((studies, 1 if shared else people, trials)), axis=-1) / trials
    y = 0.77 * times + rng.normal(size=(studies, people, trials))
    y = y.reshape(studies, people, conditions, repetitions).mean(-1)
    return y + 0.42 * rng.normal(size=(studies, people, 1))


def test_one_order_for_all_makes_findings_of_drift():
    """An order of each participant's own keeps the rate of false positives; one for all
    takes it from .05 to .2 (paper 003).
    """
    own, shared = (
        np.mean(repeated(drifting(np.random.default_rng(4), s))[0].p < 0.05) for s in (False, True)
    )
    assert own == pytest.approx(0.05, abs=0.01)
    assert shared == pytest.approx(0.21, abs=0.02)


def test_a_mixed_model_is_that_of_statsmodels_and_takes_drift_away():
    from statsmodels.regression.mixed_linear_model import MixedLM  # a second of each worker

    rng = np.random.default_rng(5)
    person, trial = np.repeat(np.arange(8), 12), np.tile(np.arange(12.0), 8)
    level = rng.integers(3, size=96)
    rating = 0.5 * trial + level + 2 * rng.normal(size=8)[person] + rng.normal(size=96)
    table = {"participant": person, "trial": trial, "level": level, "rating": rating}
    found = mixed(table, "rating ~ level + trial")
    other = MixedLM(rating, np.column_stack([np.ones(96), level, trial]), person).fit()
    theirs = zip(other.fe_params, other.bse_fe, other.tvalues, other.pvalues, strict=False)
    for c, of in zip(found.coefficients, theirs, strict=True):
        assert (c.value, c.error, c.z, c.p) == pytest.approx(of, rel=1e-5)
    of_all = found.group_variance, found.residual_variance, found.loglik
    of = float(other.cov_re[0, 0]), other.scale, other.llf
    assert of_all == pytest.approx(of, rel=1e-8) and found.converged
    assert found.coefficients[2].low < 0.5 < found.coefficients[2].high


def test_a_mixed_model_leaves_out_answers_with_gaps():
    whole = {"y": [1.0, 2, 3, 5, 2, 4, 6, 3, 4, 6, 7], "x": [0, 1, 2, 3, 0, 1, 3, 0, 1, 2, 3]}
    whole |= {"participant": [*"aaaabbbcccc"]}
    more = {"y": [None, 3.0], "x": [2.0, np.nan], "participant": [*"bc"]}
    found = mixed({name: [*row, *more[name]] for name, row in whole.items()}, "y ~ x")
    assert found == mixed(whole, "y ~ x") and found.converged


def test_a_mixed_model_of_people_who_do_not_differ_has_errors_of_its_slopes():
    """A variance of 0 has no standard error; the slopes have theirs."""
    same = {"y": [1, 2, 3, 4] * 3, "x": [0, 1] * 6, "participant": [*"aaaabbbbcccc"]}
    found = mixed(same, "y ~ x")
    assert found.coefficients[1].value == pytest.approx(1) and not found.converged
    assert found.coefficients[1].error == pytest.approx(0.4**0.5, rel=1e-6)


# Detection ----------------------------------------------------------------------------
def test_sensitivity_to_six_digits():
    counts = 50, 50, 0, 50
    sure, plain = detection(*counts), detection(41, 50, 9, 50)
    assert round(sure.d, 6) == 4.123833 and sure.corrected
    assert round(plain.d, 6) == 1.830730 and not plain.corrected
    assert plain.criterion == pytest.approx(0) and detection(30, 50, 5, 50).criterion > 0
    # -(z(.9) + z(.4))/2
    assert detection(45, 50, 20, 50).criterion == pytest.approx(-0.5141022, abs=1e-6)
    half, none = detection(*counts, "half"), detection(*counts, "none")
    assert (half.hit_rate, half.false_alarm_rate) == (0.99, 0.01)
    assert none.d == none.standard_error == np.inf
    assert detection(0, 40, 1, 50).hit_rate == 1 / 41
    # 10 of 10, and none, with half an answer more of each kind
    ten, H = detection(10, 10, 0, 10, "loglinear"), 10.5 / 11
    assert ten.hit_rate == H and ten.standard_error == pytest.approx(
        np.sqrt(2 * H * (1 - H) / (11 * norm.pdf(norm.ppf(H)) ** 2)), rel=1e-6
    )


def test_proportions_of_the_nodules():
    """Li et al. print intervals of n = 28; of the trials that there were they are
    these.
    """
    found, less = diagnosis(239, 252, 112, 112), diagnosis(239, 252, 112, 112, 0.8)
    ends = [(p.low, p.high) for p in (found.sensitivity, found.specificity, found.accuracy)]
    assert np.ravel(ends) == pytest.approx([0.9138, 0.9696, 0.9668, 1.0, 0.9399, 0.9790], abs=5e-5)
    z, p, n = norm.ppf(0.975), 239 / 252, 252  # as Wilson writes it
    half = z * np.sqrt(p * (1 - p) / n + z**2 / 4 / n**2)
    wanted = [(p + z**2 / 2 / n + s * half) / (1 + z**2 / n) for s in (-1, 1)]
    assert ends[0] == pytest.approx(wanted, rel=1e-10)
    parts = [wilson(k, n, 0.8) for k, n in ((239, 252), (112, 112), (351, 364))]
    assert [less.sensitivity, less.specificity, less.accuracy] == parts
    assert wilson(27, 28).low < wilson(27, 28, 0.8).low
    # counts of one byte: their sum has two
    assert diagnosis(*np.uint8([239, 252, 112, 112])) == found
    assert detection(*np.uint8([255, 255, 0, 255])) == detection(255, 255, 0, 255)


# What cannot be used ------------------------------------------------------------------
@pytest.mark.parametrize(
    ("call", "said"),
    [
        *(
            (partial(call, {"a": row, "b": [0.0, row[0]]}), f"{call.__name__}.*{why}")
            for call in (anova, kruskal, dunn)
            for row, why in (([1e101, 1.0], "larger than 1e"), ([1e-200, 2e-200], "another unit"))
        ),
        (lambda: paired([1e308, -1e308], [-1e308, 1e308]), "larger than"),
        (lambda: paired([1e-200, 2e-200], [0.0, 3e-200]), "another unit"),
        (lambda: repeated([[1e308, -1e308], [1.0, 2.0]]), "larger than"),
        (lambda: repeated([[1e-200, 0.0], [0.0, 5e-200]]), "another unit"),
        (lambda: repeated([[1.0, 1.0]] * 3), "condition: the differences are the same"),
        (lambda: repeated([[0.1, 0.3], [0.2, 0.4], [0.3, 0.5]]), "the differences are the same"),
        (lambda: kruskal({"a": [1, 2]}), "two groups"),
        (lambda: kruskal({"a": [1, 2], "b": []}), "kruskal: b"),
        (lambda: dunn({"a": [1], "b": [1, np.inf]}), "b: value 1"),
        (lambda: dunn({"a": [1, 1], "b": [1]}), "the same"),
        (lambda: dunn(OZONE, "one"), "one-sided"),
        (lambda: dunn(OZONE, adjustment="holm"), "bonferroni"),
        (lambda: anova({"a": [1], "b": [2]}), "no error"),
        (lambda: paired([1, 2], [1, 2, 3]), "same order"),
        (lambda: paired([1, 2], [2, 3]), "no spread"),
        (lambda: paired([0.1, 0.2], [0.2, 0.3]), "no spread"),  # but for rounding
        (lambda: paired([0, 0, 0], [0.3, 0.1 + 0.2, 0.3]), "no spread"),
        (lambda: anova({"a": [0.3, 0.1 + 0.2], "b": [0.3, 0.3]}), "all values are the same"),
        (lambda: shapiro([1, 1, 1]), "no spread"),
        (lambda: repeated([1, 2]), "no axis"),
        (lambda: shapiro([1, 2]), "at least 3 values"),
        (lambda: repeated([[1, 2]]), "at least two"),
        (lambda: repeated([[1], [2]]), "at least two"),
        (lambda: repeated([[1, 2], [3, np.nan]]), "mixed"),
        (lambda: mixed({"participant": [1, 2], "y": [1, 2]}, "y ~ x"), "x"),
        (lambda: mixed({"y": [1, 2]}, "y ~ 1"), "participant"),
        (lambda: detection(51, 50, 1, 50), "51 of 50"),
        (lambda: detection(-1, 50, 1, 50), "-1 of 50"),
        (lambda: wilson(1.5, 2), "1.5 of 2"),
        (lambda: detection(1, 50, 1, 0), "1 of 0"),
        (lambda: detection(1, 2, 1, 2, "add"), "loglinear"),
        (lambda: detection(1, 2, np.nan, 2), "false_alarms = nan is not finite"),
        (lambda: wilson(1, np.inf), "n = inf is not finite"),
        (lambda: wilson(1, 2, 95), "confidence"),
        (lambda: kruskal({1: [1, 2], "1": [3, 4], 2: [5, 6]}), "same name"),
        (lambda: anova({"a": ["x"], "b": [1]}), "anova: a must be rows of numbers"),
        (lambda: repeated(np.eye(4).reshape(4, 2, 2), ("c", "c")), "name of its own"),
        (
            lambda: mixed({"participant": [1, 1, 1], "y": [1, 2, 4]}, "y ~ 1"),
            "at least two of them",
        ),
        (lambda: mixed({"participant": [1, 2], "y": [1, 2, 4]}, "y ~ 1"), "same length"),
        (lambda: mixed({"participant": [1, 1, 2, 2], "y": [0] * 4}, "y ~ 1"), "error of nan"),
    ],
)
def test_what_cannot_be_used_is_said(call, said):
    refused((BadValue, UnknownName), said, call)


@pytest.mark.filterwarnings("error")
def test_differences_without_error_are_taken_in_simulations():
    rounded = [[0.3, 0.1 + 0.2], [0.7, 0.6 + 0.1], [0.5, 0.5]]
    (effect,) = repeated(
        [[[0.0, 0.0]] * 3, [[1.0, 2.0]] * 3, [[1, 2], [1, 3], [2, 2]], rounded]
        + [[[0.1, 0.3], [0.2, 0.4], [0.3, 0.5]]]
    )
    assert np.isnan(effect.F[[0, 3]]).all() and np.isinf(effect.F[[1, 4]]).all()
    assert np.isfinite(effect.F[2])
    assert np.isnan(effect.eta2[0]) and effect.eta2[1] == 1
