"""Weber, Fechner and Stevens, the JND from d', and scales of pairs and rankings: the
papers' own numbers, other programs, simulated people.
"""

import math

import numpy as np
import pytest
from laws import STRESS
from refusals import refused
from scipy.optimize import minimize
from scipy.special import logsumexp
from scipy.stats import norm

from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import bradley_terry, detection, fechner, jnd_from_dprime, line, stevens
from stimlib.experiments.papers.roughness import PRINTED

RMS, ROUGH = np.array(list(PRINTED.values())).T


def test_the_line_of_the_bounciness_jnds():
    """Fig. 3.6 of Çaldıran's thesis; it prints t = 20.0065, p = .0318, intercept -.0012
    with t = -.3088, p = .8093.
    """
    found = line([0.25, 0.5, 0.75], [0.03615, 0.0693, 0.10875])
    assert (found.slope, found.intercept, found.df) == pytest.approx((0.1452, -0.0012, 1), abs=1e-9)
    assert (
        found.slope / found.slope_error == pytest.approx(20.0, abs=0.05)
        and round(found.slope_p, 4) == 0.0319
    )
    assert found.intercept_p == pytest.approx(0.811, abs=0.002) and found.r2 == pytest.approx(
        0.998, abs=1e-3
    )
    t = found.intercept / found.intercept_error  # with one degree of freedom it is Cauchy's
    assert found.intercept_p == pytest.approx(1 + 2 * np.arctan(t) / np.pi, rel=1e-12)


def test_roughness_over_rms():
    """Of tables 6.1 and 6.2 of the thesis on bumps."""
    law, power = fechner(RMS, ROUGH), stevens(RMS, ROUGH)
    found = law.line.intercept, law.line.slope, law.r2, np.corrcoef(RMS, ROUGH)[0, 1]
    assert found == pytest.approx((3.9201, 2.2464, 0.9563, 0.9024), abs=5e-5)
    assert law(1.0) == pytest.approx(law.line.intercept)
    assert power.line.slope == pytest.approx(0.3319, abs=5e-5)
    assert power(2.0) == pytest.approx(10**0.574830 * 2**0.331901, rel=1e-5)
    rest = ROUGH - power(RMS)
    r2 = 1 - np.sum(rest**2) / np.var(ROUGH) / 27
    assert power.r2 == pytest.approx(r2, rel=1e-10) and power.r2 != power.line.r2
    assert power.aic == pytest.approx(27 * np.log(np.mean(rest**2)) + 4)


def test_jnds_of_simulated_people_follow_their_line():
    """4000 times four people of Çaldıran's thesis, whose JNDs are .1452 alpha - .0012:
    corrections take little from it.
    """
    alphas, step = np.array([0.25, 0.5, 0.75]), 0.05 * np.arange(1, 4)
    true = step / (0.1452 * alphas - 0.0012)[:, None]  # d' of each reference and increment
    rng = np.random.default_rng(7)
    H, F = (rng.binomial(50, norm.cdf(s * true / 2), (4000, 4, 3, 3)) for s in (1, -1))
    d_of = {(h, f): detection(h, 50, f, 50).d for h, f in {*zip(H.flat, F.flat, strict=True)}}
    d = np.vectorize(lambda h, f: d_of[h, f])(H, F)
    studies = d if STRESS else d[:1000]
    jnds = [[jnd_from_dprime(v, step) for v in np.moveaxis(study, 1, 0)] for study in studies]
    mean = line(alphas, np.mean(jnds, axis=0))  # of a mean is the mean of the lines
    assert mean.slope == pytest.approx(0.144, abs=0.002)
    assert mean.intercept == pytest.approx(-0.0012, abs=0.001)
    # where nobody tells them apart there is none
    assert np.isnan([jnd_from_dprime([-0.1, last], [0.1, 0.1]) for last in (0.0, 0.1)]).all()


# Pairs and rankings -------------------------------------------------------------------
TEAMS = ("Milwaukee", "Detroit", "Toronto", "New York", "Boston", "Cleveland", "Baltimore")
WINS = [  # of each row against each column; Agresti (2002), table 10.10, home and away
    [0, 7, 9, 7, 7, 9, 11],
    [6, 0, 7, 5, 11, 9, 9],
    [4, 6, 0, 7, 7, 8, 12],
    [6, 8, 6, 0, 6, 7, 10],
    [6, 2, 6, 7, 0, 7, 12],
    [4, 4, 5, 6, 6, 0, 6],
    [2, 4, 1, 3, 1, 7, 0],
]
GAMES = [
    (a, b)
    for a, row in zip(TEAMS, WINS, strict=True)
    for b, k in zip(TEAMS, row, strict=True)
    for _ in range(k)
]


def test_baseball_of_agresti():
    """Categorical Data Analysis (2002), table 10.11, and errors as R's BradleyTerry2
    prints them; a mean of 0 changes no difference.
    """
    found = {c.name: c for c in bradley_terry(GAMES, reference="Baltimore")}
    values = [1.58, 1.44, 1.29, 1.25, 1.11, 0.68, 0.0]
    errors = [0.343, 0.340, 0.337, 0.336, 0.334, 0.332, 0.0]
    assert [round(found[t].value, 2) for t in TEAMS] == values
    assert [round(found[t].error, 3) for t in TEAMS] == errors
    first = found["Milwaukee"]
    assert first.z == pytest.approx(first.value / first.error)
    assert first.p == pytest.approx(math.erfc(first.z / math.sqrt(2)))  # of both sides
    assert first.high - first.low == pytest.approx(2 * 1.959964 * first.error, rel=1e-6)
    middle = {c.name: c.value for c in bradley_terry(GAMES)}
    assert sum(middle.values()) == pytest.approx(0, abs=1e-12)
    assert middle["Milwaukee"] - middle["Boston"] == pytest.approx(
        first.value - found["Boston"].value
    )


def test_rankings_of_any_length_have_the_largest_likelihood():
    """As scipy's BFGS finds it, with the errors of its second differences."""
    rng, true, orders = np.random.default_rng(8), np.array([0.0, 0.5, 1.0, -0.4, 1.4]), []
    for size in (2, 3, 5, 4, 2) * (8 if STRESS else 2):
        shown = rng.choice(5, size, replace=False)
        orders.append(shown[np.argsort(-true[shown] - rng.gumbel(size=size))].tolist())
    found = sorted(bradley_terry(orders, reference=0), key=lambda c: int(c.name))

    def cost(x):  # choice by choice
        theta = np.append(0.0, x)
        return sum(
            logsumexp(theta[order[i:]]) - theta[order[i]]
            for order in orders
            for i in range(len(order))
        )

    values = np.array([c.value for c in found[1:]])
    best = minimize(cost, values + 0.01, method="BFGS", options={"gtol": 1e-7})
    assert values == pytest.approx(best.x, abs=1e-5)
    h, axes = 1e-3, 1e-3 * np.eye(4)
    signs = [(s, r) for s in (1, -1) for r in (1, -1)]
    second = [
        [sum(s * r * cost(values + s * a + r * b) for s, r in signs) for a in axes] for b in axes
    ]
    errors = np.sqrt(np.diag(np.linalg.inv(np.array(second) / (4 * h * h))))
    assert [c.error for c in found[1:]] == pytest.approx(errors, rel=1e-4)


def test_people_who_differ_have_wider_intervals():
    """Of two items and one answer count for each person the sandwich is the error of a
    mean of people.
    """
    rng = np.random.default_rng(9)
    wins = rng.binomial(10, 1 / (1 + np.exp(-(0.5 + rng.normal(size=20)))))
    pairs = [("a", "b") if k < w else ("b", "a") for w in wins for k in range(10)]
    plain, _ = bradley_terry(pairs, None, "b")
    robust, _ = bradley_terry(pairs, np.repeat(np.arange(20), 10).tolist(), "b")
    p = wins.mean() / 10
    error = np.sqrt(20 / 19 * np.sum((wins - 10 * p) ** 2)) / (200 * p * (1 - p))
    assert robust.error == pytest.approx(error, rel=1e-9) and plain.error < 0.75 * error
    assert plain.value == robust.value
    assert robust.high - robust.value == pytest.approx(2.093024 * robust.error)


@pytest.mark.parametrize(
    ("pairs", "groups"),
    [
        ([("a", "b"), ("b", "a"), ("c", "a")], "a, b | c"),
        ([("a", "b"), ("b", "a"), ("c", "d"), ("d", "c")], "a, b | c, d"),
        ([("a", "b", "c")] * 5, "a | b | c"),
        ([("a", "b"), ("b", "a"), ("a", "c"), ("c", "d"), ("d", "a")], None),
        ([("a", "b", "c"), ("c", "a")], None),
    ],
)
def test_items_without_a_finite_ability_are_named(pairs, groups):
    """Those that a chain of preferences leads to and from have one (Hunter 2004)."""
    if groups is None:
        assert np.isfinite([c.error for c in bradley_terry(pairs)]).all()
    else:
        refused(BadValue, f"the groups {groups} have".replace("|", r"\|"), bradley_terry, pairs)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: line([1, 2], [1, 2]), "three points"),
        (lambda: line([1, 2, 3], [1, 2]), "of one length"),
        (lambda: line([1, 2, 3], [1, np.nan, 2]), "y = nan, number 1"),
        (lambda: line([1, 1, 1], [1, 2, 3]), "two places"),
        (lambda: fechner([1, 0, 2], [1, 2, 3]), r"intensity\[1\] = 0"),
        (lambda: stevens([1, 0, 3], [1, 2, 3]), r"intensity\[1\] = 0"),
        (lambda: stevens([1, 2, 3], [1, 2, 0]), r"rating\[2\] = 0"),
        (lambda: jnd_from_dprime([1, 2], [0.1, 0.2, 0.3]), "increments must be"),
        (lambda: fechner([1, 2, 3], [2, 2, 2]), "all ratings are 2"),
        (lambda: line([1, 2, "x"], [2, 2, 2]), "line: x = .* must be a list of numbers"),
        (lambda: jnd_from_dprime([], []), "no d'"),
        (lambda: jnd_from_dprime([1, 2], [0.0, 0.2]), r"increment\[0\]"),
        (lambda: bradley_terry([("a", "b"), ("a",)]), "ranking 1"),
        (lambda: bradley_terry([("a", "b", "a")]), "each once"),
        (lambda: bradley_terry(["silk", "cork"]), "must be a list"),
        (lambda: bradley_terry([]), r"ranking 0, \(\)"),
        (
            lambda: bradley_terry([("a", "b"), ("b", "a")], ["p"]),
            "1 participant, 1 different, of 2",
        ),
        (lambda: bradley_terry([("a", "b"), ("b", "a")], ["p", "p"]), "at least two people"),
        (lambda: bradley_terry([("a", "b"), ("b", "a")], confidence=2.0), "confidence = 2.0"),
        (lambda: bradley_terry([("a", "b"), ("b", "a")], reference="c"), "no item 'c'"),
    ],
)
def test_what_cannot_be_used_is_said(call, said):
    refused((BadValue, UnknownName), said, call)
