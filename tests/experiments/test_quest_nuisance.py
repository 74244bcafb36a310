"""QUEST+ with nuisance parameters: the psi-marginal method (Prins 2013)."""

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from laws import STRESS
from refusals import refused
from scipy.stats import norm

from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import Quest, Stimulus, TwoInterval, stream

PAIR = TwoInterval("silent", "which", Stimulus("a", {"k": 1.0}), Stimulus("a"), "k")
FELT = TwoInterval("felt", "which", Stimulus("a", {"k": 0.0}), Stimulus("a"), "k")
ROWS = {
    "levels": (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 9.0),
    "means": (1.0, 1.5, 2.0, 2.5),
    "lapses": (0.0, 0.1, 0.3),
}
KINDS = {
    "comparison": (PAIR, {"deviations": (0.2, 0.4, 0.8)}),
    "detection": (FELT, {"slopes": (1.0, 3.0)}),
    "yes-no": (PAIR, {"slopes": (1.0, 3.0), "guesses": (0.0, 0.2, 0.4)}),
}


def expected(kind, nuisance, levels, outcomes):
    """Expected entropy of each level, by going through every combination of parameters,
    outcomes and levels, one at a time.
    """
    grid, prior, p = posterior(kind, levels, outcomes)
    kept = [k for k, name in enumerate(curves(kind)) if name not in nuisance]
    found = []
    for level in ROWS["levels"]:
        total = 0.0
        for then in (prior * p[level], prior * (1 - p[level])):
            marginal = Counter()
            for values, weight in zip(grid, then, strict=True):
                marginal[tuple(values[k] for k in kept)] += weight
            q = np.array(list(marginal.values())) / then.sum()
            total -= then.sum() * (q[q > 0] * np.log(q[q > 0])).sum()
        found.append(total)
    return np.array(found)


@pytest.mark.parametrize(
    ("kind", "nuisance"),
    [
        ("comparison", ()),
        ("comparison", ["lapse", "lapse"]),  # a list, in which each counts once
        ("comparison", ("lapse", "deviation")),
        ("detection", ("mean",)),
        ("detection", ("guess", "lapse")),
        ("yes-no", ("lapse", "slope")),
        ("yes-no", ("guess", "lapse")),
    ],
    ids=str,
)
def test_each_level_has_the_least_expected_entropy_of_the_marginal(kind, nuisance):
    """And each estimate is the mean over all that was possible."""
    task, more = KINDS[kind]
    design = Quest(task, **ROWS, **more, nuisance=nuisance)
    rng, state = stream(4, kind, *nuisance), design.init(1)
    for _ in range(8 if STRESS else 4):
        level = design.next(state).level
        entropies = expected(kind, nuisance, state["levels"], state["outcomes"])
        assert entropies[ROWS["levels"].index(level)] == pytest.approx(entropies.min(), abs=1e-9)
        outcomes = [*state["outcomes"], int(rng.random() < 0.6)]
        state = state | {"levels": [*state["levels"], level], "outcomes": outcomes}
    grid, weights, _ = posterior(kind, state["levels"], state["outcomes"])
    found = design.estimate(state)
    means = dict(zip(curves(kind), weights @ np.array(grid), strict=True))
    assert {name: found[name].value for name in means} == pytest.approx(means, rel=1e-8)


@pytest.mark.parametrize(
    ("words", "state", "why"),
    [
        ({"nuisance": ("lapses",)}, {}, "no parameter 'lapses'; there are mean, deviation, lapse"),
        ({"nuisance": ("slope",)}, {}, "no parameter 'slope'"),
        ({"nuisance": ("guess",)}, {}, "no parameter 'guess'"),
        ({"nuisance": ("mean", "deviation", "lapse")}, {}, "names all parameters"),
        ({"nuisance": "lapse"}, {}, "nuisance = 'lapse' must be a tuple"),
        ({"nuisance": (1,)}, {}, "nuisance = .* must be a tuple"),
        ({"guesses": (0.1, 0.6), "lapses": (0.0, 0.4)}, {}, "add up to 1"),
        ({}, {"levels": [77.0], "outcomes": [1]}, "1 levels and 1 outcomes, with 77.0"),
        ({}, {"levels": [], "outcomes": [1]}, "0 levels and 1 outcomes"),
        ({}, {"levels": [ROWS["levels"][0]], "outcomes": [2]}, "with 2, are no state"),
        ({"guesses": (0.1, 0.6), "lapses": (0.0, 0.39)}, {"levels": []}, "no column 'outcomes'"),
    ],
)
def test_a_nuisance_or_a_state_that_is_none(words, state, why):
    usual = {"task": PAIR, **ROWS, "deviations": (0.2, 0.4)}
    refused((BadValue, UnknownName), why, lambda: Quest(**usual | words).estimate(state))


@pytest.mark.filterwarnings("error")
def test_numbers_near_the_largest_are_taken():
    usual = {"task": PAIR, **ROWS}
    for rows in (
        {"deviations": (5e-324,)},
        {"deviations": (1.0,), "levels": (-1e308, 1e308), "means": (-1e308, 1e308)},
        {"slopes": (1e300,)},
    ):
        design = Quest(**usual | rows)
        assert np.isfinite(design.next(design.init(1)).level)


def curves(kind):
    """Names and values of the parameters, in their order."""
    _, more = KINDS[kind]
    rows = {"mean": ROWS["means"], "slope": more.get("slopes"), "lapse": ROWS["lapses"]}
    rows |= {"deviation": more.get("deviations"), "guess": more.get("guesses", (0.5,))}
    unused = {name for name, values in rows.items() if values is None}
    unused |= {"guess"} if kind == "comparison" else set()
    return {name: values for name, values in rows.items() if name not in unused}


def probability(rows, values, level):
    v = dict(zip(rows, values, strict=True))
    if "deviation" in v:
        shape = norm.cdf(level, v["mean"], v["deviation"])
    else:
        shape = 1 - math.exp(-((level / v["mean"]) ** v["slope"]))
    low = v.get("guess", v["lapse"])
    return min(max(low + (1 - low - v["lapse"]) * shape, 1e-10), 1 - 1e-10)


def posterior(kind, levels, outcomes):
    """Every combination of parameters, its probability, and that of 1 at each level."""
    rows = curves(kind)
    grid = list(itertools.product(*rows.values()))
    p = {level: np.array([probability(rows, v, level) for v in grid]) for level in ROWS["levels"]}
    weights = np.ones(len(grid))
    for level, outcome in zip(levels, outcomes, strict=True):
        weights *= p[level] if outcome else 1 - p[level]
    return grid, weights / weights.sum(), p
