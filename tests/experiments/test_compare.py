"""Tests between groups and within people: against other programs, printed examples, the
papers' counts, and chance.
"""

from itertools import product

import numpy as np
import pytest
from refusals import refused

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

# of 252 nodules found, of 112 empty sides
COUNTS = {"deformation": (183, 111), "speed": (236, 107), "both": (239, 112)}
OZONE = {  # R's airquality, by month, without the days that are missing
    "5": [
        41,
        36,
        12,
        18,
        28,
        23,
        19,
        8,
        7,
        16,
        11,
        14,
        18,
        14,
        34,
        6,
        30,
        11,
        1,
        11,
        4,
        32,
        23,
        45,
        115,
        37,
    ],
    "6": [29, 71, 39, 23, 21, 37, 20, 12, 13],
    "7": [
        135,
        49,
        32,
        64,
        40,
        77,
        97,
        97,
        85,
        10,
        27,
        7,
        48,
        35,
        61,
        79,
        63,
        16,
        80,
        108,
        20,
        52,
        82,
        50,
        64,
        59,
    ],
    "8": [
        39,
        9,
        16,
        78,
        35,
        66,
        122,
        89,
        110,
        44,
        28,
        65,
        22,
        59,
        23,
        31,
        44,
        21,
        9,
        45,
        168,
        73,
        76,
        118,
        84,
        85,
    ],
    "9": [
        96,
        78,
        73,
        91,
        47,
        32,
        20,
        23,
        21,
        24,
        44,
        21,
        28,
        9,
        13,
        46,
        18,
        13,
        24,
        16,
        13,
        23,
        36,
        7,
        14,
        30,
        14,
        18,
        20,
    ],
}


# Between groups -----------------------------------------------------------------------
def test_ranks_of_the_example_of_r():
    """kruskal.test(Ozone ~ Month, airquality) prints 29.267; dunn.test of the same,
    these z.
    """
    assert kruskal(OZONE).value == pytest.approx(29.2666, abs=5e-5) and kruskal(OZONE).df == (4,)
    assert kruskal(OZONE).p == pytest.approx(6.901e-06, rel=1e-4)
    z = {(p.a, p.b): p.statistic for p in dunn(OZONE)}
    printed = {
        ("5", "6"): -0.925158,
        ("5", "7"): -4.419470,
        ("6", "7"): -2.244208,
        ("5", "8"): -4.132813,
    }
    printed |= {
        ("5", "9"): -1.321202,
        ("7", "8"): 0.286657,
        ("7", "9"): 3.217199,
        ("8", "9"): 2.922827,
    }
    assert {k: z[k] for k in printed} == pytest.approx(printed, abs=5e-6)


def answers(which):
    """1 and 0 of every technique: what was found of the nodules, or told right of all
    sides.
    """
    k = {name: found + (right if which == "all" else 0) for name, (found, right) in COUNTS.items()}
    n = 252 if which == "nodules" else 364
    return {name: np.repeat([1, 0], [v, n - v]) for name, v in k.items()}


@pytest.mark.parametrize("which", ["nodules", "all"])
def test_dunn_of_the_counts_of_the_nodules(which):
    """H of zeros and ones is chi squared of the table times (N - 1)/N; of equal groups
    it is 2/3 of the sum of z^2.
    """
    from scipy.stats import chi2_contingency

    groups = answers(which)
    n = sum(map(len, groups.values()))
    table = [[g.sum() for g in groups.values()], [(1 - g).sum() for g in groups.values()]]
    H = kruskal(groups).value
    assert H == pytest.approx(
        chi2_contingency(table, correction=False).statistic * (n - 1) / n, rel=1e-10
    )
    pairs = dunn(groups, adjustment="none")
    assert H == pytest.approx(2 / 3 * sum(p.statistic**2 for p in pairs), rel=1e-10)
    (a, b, _), size = map(np.mean, groups.values()), n / 3
    pooled = np.mean(np.concatenate(list(groups.values())))
    assert pairs[0].statistic == pytest.approx(
        (a - b) / np.sqrt(pooled * (1 - pooled) * n / (n - 1) * 2 / size), rel=1e-10
    )


def test_the_printed_z_of_the_nodules():
    """Table 1 of Li et al.: H follows from the z with -3.804, not with the -3.040 that
    is printed; p is one-sided, times 3.
    """
    from scipy.stats import norm

    assert 2 / 3 * (3.637**2 + 3.804**2 + 0.167**2) == pytest.approx(18.482, abs=0.01)
    assert (
        3 * norm.sf(3.804)
        == pytest.approx(0.0002, abs=5e-5)
        != pytest.approx(3 * norm.sf(3.040), abs=5e-5)
    )
    a, b = (dunn(OZONE, sides)[1].p for sides in ("one-sided", "two-sided"))
    assert b == pytest.approx(2 * a) and a == pytest.approx(10 * norm.sf(4.419470), rel=1e-5)
    assert dunn(OZONE, adjustment="none")[1].p == pytest.approx(b / 10)
    assert dunn(OZONE)[0].p == 1.0


def test_independent_and_paired_are_not_the_same():
    from scipy import stats

    a, b = [2.4, 2.3, 2.6, 2.1, 2.9], [2.0, 2.1, 2.1, 2.0, 2.5]
    between, within = anova({"a": a, "b": b}), paired(a, b)
    assert (between.value, between.p) == pytest.approx(
        (stats.f_oneway(a, b).statistic, stats.f_oneway(a, b).pvalue), rel=1e-12
    )
    assert between.df == (1, 8) and within.df == (4,)
    assert (within.value, within.p) == pytest.approx(
        (stats.ttest_rel(a, b).statistic, stats.ttest_rel(a, b).pvalue), rel=1e-12
    )
    assert within.p < 0.02 < between.p


def test_a_small_p_of_shapiro_is_not_normal():
    rng = np.random.default_rng(1)
    assert shapiro(rng.normal(size=100)).p > 0.05 > shapiro(rng.exponential(size=100)).p


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
    """Of its rm_anova (0.7.0), printed with effsize "np2" and "ng2"; the generalized
    one leaves out only the other effects.
    """
    rng = np.random.default_rng(1)
    y = rng.normal(size=(8, 3, 2)) + np.arange(3)[:, None] * 0.5 + rng.normal(size=(8, 1, 1))
    found = repeated(y, ("a", "b"))
    assert [e.eta2 for e in found] == pytest.approx([0.689457, 0.009509, 0.026852], abs=5e-7)
    assert [e.generalized_eta2 for e in found] == pytest.approx(
        [0.321108, 0.000318, 0.006388], abs=5e-7
    )
    cells = y.mean(axis=0)
    a = 16 * np.sum((cells.mean(axis=1) - y.mean()) ** 2)
    others = 8 * np.sum((cells - y.mean()) ** 2) - a
    rest = np.sum((y - y.mean()) ** 2) - others
    assert found[0].generalized_eta2 == pytest.approx(a / rest, rel=1e-10)
    assert repeated(np.array([y, 2 * y]), ("a", "b"))[0].generalized_eta2.shape == (2,)


def test_effect_sizes_of_groups_and_pairs():
    a, b = np.array([2.4, 2.3, 2.6, 2.1]), np.array([2.0, 2.1, 2.1, 2.0])
    assert paired(a, b).effect == pytest.approx((a - b).mean() / (a - b).std(ddof=1), rel=1e-12)
    both = np.append(a, b)
    between = sum(4 * (x.mean() - both.mean()) ** 2 for x in (a, b))
    assert anova({"a": a, "b": b}).effect == pytest.approx(
        between / np.sum((both - both.mean()) ** 2), rel=1e-12
    )
    assert anova({"a": [1, 2], "b": [3, 4]}).effect == pytest.approx(0.8)
    three = {"a": a, "b": b, "c": np.array([1.0, 1.4, 1.9])}
    every = np.concatenate([*three.values()])
    between = sum(x.size * (x.mean() - every.mean()) ** 2 for x in three.values())
    assert anova(three).effect == pytest.approx(between / np.sum((every - every.mean()) ** 2))
    assert anova({"a": [1, 2], "b": [2, 1]}).effect == pytest.approx(0, abs=1e-12)
    # of groups that do not overlap it is the largest that ranks allow
    apart = kruskal({"a": [1, 2, 3], "b": [4, 5, 6]})
    assert apart.effect == pytest.approx(apart.value / 5) == pytest.approx(27 / 35)
    assert np.isnan(shapiro([1.0, 2.0, 4.0, 3.0]).effect)


def test_epsilon_is_one_of_spherical_data_and_small_of_a_trend():
    from scipy.stats import f

    """Of two conditions it is 1; of people who differ in one direction only it is 1/df;
    by the printed formula between.
    """
    y = np.random.default_rng(3).normal(size=(9, 4))
    (effect,) = repeated(y)
    S = np.cov(y.T)
    S = (
        S - S.mean(0) - S.mean(1)[:, None] + S.mean()
    )  # Greenhouse and Geisser: tr(S)^2/((k - 1) sum S^2) of the centred covariance
    assert effect.epsilon == pytest.approx(np.trace(S) ** 2 / (3 * np.sum(S**2)), rel=1e-10)
    assert 1 / 3 < effect.epsilon < 1 and repeated(y[:, :2])[0].epsilon == pytest.approx(1)
    trend = np.outer(np.arange(9.0), [0, 1, 2, 3]) + [0, 0, 1, 0]
    assert repeated(trend)[0].epsilon == pytest.approx(1 / 3)
    assert repeated(trend)[0].p_corrected > repeated(trend)[0].p
    df = 3 * effect.epsilon, 3 * (len(y) - 1) * effect.epsilon
    assert effect.p_corrected == pytest.approx(f.sf(effect.F, *df), rel=1e-10)
    assert 0 < effect.eta2 < 1 and effect.eta2 == pytest.approx(effect.F * 3 / (effect.F * 3 + 24))


def drifting(
    rng, shared, studies=2000, people=10, conditions=9, repetitions=4, drift=0.77, spread=0.42
):
    """Mean ratings where nothing differs but the time: all drift alike, people's
    answers vary.
    """
    trials = conditions * repetitions
    times = np.argsort(rng.random((studies, 1 if shared else people, trials)), axis=-1) / trials
    y = drift * times + rng.normal(size=(studies, people, trials))
    return y.reshape(studies, people, conditions, repetitions).mean(-1) + spread * rng.normal(
        size=(studies, people, 1)
    )


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
    from statsmodels.regression.mixed_linear_model import MixedLM

    rng = np.random.default_rng(5)
    person, trial, level = (
        np.repeat(np.arange(8), 12),
        np.tile(np.arange(12.0), 8),
        rng.integers(3, size=96),
    )
    rating = 0.5 * trial + level + 2 * rng.normal(size=8)[person] + rng.normal(size=96)
    columns = {"participant": person, "trial": trial, "level": level, "rating": rating}
    found = mixed(columns, "rating ~ level + trial")
    other = MixedLM(rating, np.column_stack([np.ones(96), level, trial]), person).fit()
    assert [c.value for c in found.coefficients] == pytest.approx(list(other.fe_params), rel=1e-8)
    assert [c.error for c in found.coefficients] == pytest.approx(list(other.bse_fe), rel=1e-8)
    assert [c.z for c in found.coefficients] == pytest.approx(list(other.tvalues[:3]), rel=1e-6)
    assert [c.p for c in found.coefficients] == pytest.approx(list(other.pvalues[:3]), rel=1e-5)
    of_all = found.group_variance, found.residual_variance, found.loglik
    assert (
        of_all == pytest.approx((float(other.cov_re[0, 0]), other.scale, other.llf), rel=1e-8)
        and found.converged
    )
    assert found.coefficients[2].low < 0.5 < found.coefficients[2].high


# Detection ----------------------------------------------------------------------------
def test_sensitivity_to_six_digits():
    assert round(detection(50, 50, 0, 50).d, 6) == 4.123833 and detection(50, 50, 0, 50).corrected
    plain = detection(41, 50, 9, 50)
    assert (
        round(plain.d, 6) == 1.830730
        and not plain.corrected
        and plain.criterion == pytest.approx(0)
    )
    rather_yes, rather_no = detection(45, 50, 20, 50), detection(30, 50, 5, 50)
    # -(z(.9) + z(.4))/2
    assert rather_yes.criterion == pytest.approx(-0.5141022, abs=1e-6) and rather_no.criterion > 0
    assert detection(50, 50, 0, 50, "loglinear").hit_rate == 50.5 / 51
    assert (
        detection(50, 50, 0, 50, "half").false_alarm_rate == 0.01
        and detection(50, 50, 0, 50, "half").hit_rate == 0.99
    )
    # 10 of 10, and none, with half an answer more of each kind
    H, z = 10.5 / 11, 1.6906216295848984
    error = np.sqrt(2 * H * (1 - H) / (11 * (np.exp(-z * z / 2) / np.sqrt(2 * np.pi)) ** 2))
    assert detection(10, 10, 0, 10, "loglinear").standard_error == pytest.approx(error, rel=1e-6)
    assert (
        detection(50, 50, 0, 50, "none").d
        == np.inf
        == detection(50, 50, 0, 50, "none").standard_error
    )
    assert detection(0, 40, 1, 50).hit_rate == 1 / 41


def test_the_standard_error_of_d_is_its_spread():
    from scipy.stats import norm

    rng = np.random.default_rng(6)
    H, F = (
        rng.binomial(200, norm.cdf(0.75), 20000) / 200,
        rng.binomial(300, norm.cdf(-0.75), 20000) / 300,
    )
    spread = (norm.ppf(H) - norm.ppf(F)).std()
    assert detection(
        round(200 * norm.cdf(0.75)), 200, round(300 * norm.cdf(-0.75)), 300
    ).standard_error == pytest.approx(spread, rel=0.03)


def test_proportions_of_the_nodules():
    """Li et al. print intervals of n = 28; of the trials that there were they are
    these.
    """
    found = diagnosis(239, 252, 112, 112)
    ends = [
        (round(100 * p.low, 2), round(100 * p.high, 2))
        for p in (found.sensitivity, found.specificity, found.accuracy)
    ]
    assert ends == [(91.38, 96.96), (96.68, 100.0), (93.99, 97.90)]
    z, p, n = 1.959963984540054, 239 / 252, 252  # as Wilson writes it
    middle, half = (
        (p + z**2 / 2 / n) / (1 + z**2 / n),
        z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / 4 / n**2),
    )
    assert (found.sensitivity.low, found.sensitivity.high) == pytest.approx(
        (middle - half, middle + half), rel=1e-10
    )
    assert wilson(27, 28).low < wilson(27, 28, 0.8).low
    less = diagnosis(239, 252, 112, 112, 0.8)
    parts = [wilson(k, n, 0.8) for k, n in ((239, 252), (112, 112), (351, 364))]
    assert [less.sensitivity, less.specificity, less.accuracy] == parts


# What cannot be used ------------------------------------------------------------------
@pytest.mark.parametrize(
    ("call", "said"),
    [
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
    ],
)
def test_what_cannot_be_used_is_said(call, said):
    with pytest.raises((BadValue, UnknownName), match=said):
        call()


def test_values_without_sums_of_squares_are_refused():
    for call in (anova, kruskal, dunn):
        for row, why in (([1e101, 1.0], "larger than 1e"), ([1e-200, 2e-200], "another unit")):
            name = f"{call.__name__}.*{why}"
            refused(BadValue, name, call, {"a": row, "b": [0.0, row[0]]})
    refused(BadValue, "paired.*larger than", paired, [1e308, -1e308], [-1e308, 1e308])
    refused(BadValue, "paired.*another unit", paired, [1e-200, 2e-200], [0.0, 3e-200])
    refused(BadValue, "repeated.*larger than", repeated, [[1e308, -1e308], [1.0, 2.0]])
    refused(BadValue, "repeated.*another unit", repeated, [[1e-200, 0.0], [0.0, 5e-200]])


@pytest.mark.filterwarnings("error")
def test_differences_without_error_are_refused_but_in_simulations():
    for rows in ([[1.0, 1.0]] * 3, [[0.1, 0.3], [0.2, 0.4], [0.3, 0.5]]):
        refused(BadValue, "repeated: condition: the differences are the same", repeated, rows)
    (effect,) = repeated([[[0.0, 0.0]] * 3, [[1.0, 2.0]] * 3, [[1, 2], [1, 3], [2, 2]]])
    assert np.isnan(effect.F[0]) and np.isinf(effect.F[1]) and np.isfinite(effect.F[2])
    assert np.isnan(effect.eta2[0]) and effect.eta2[1] == 1
