"""QUEST+ with nuisance parameters: the psi-marginal method (Prins 2013)."""

import itertools
import math

import numpy as np
import pytest
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
NAMES = ("mean", "deviation", "slope", "lapse", "guess")


def expected(kind, nuisance, levels, outcomes):
    """Expected entropy of each level, by going through every combination of parameters,
    outcomes and levels, one at a time.
    """
    task, more = KINDS[kind]
    rows = {"mean": ROWS["means"]}
    rows |= {
        "slope" if "slopes" in more else "deviation": more.get("slopes", more.get("deviations"))
    }
    rows |= {"lapse": ROWS["lapses"]}
    rows |= {"guess": more.get("guesses", (0.5,))} if kind != "comparison" else {}

    def p(values, level):
        v = dict(zip(rows, values, strict=True))
        shape = (
            norm.cdf(level, v["mean"], v["deviation"])
            if "deviation" in v
            else 1 - math.exp(-((level / v["mean"]) ** v["slope"]))
        )
        low = v.get("guess", v["lapse"])
        return min(max(low + (1 - low - v["lapse"]) * shape, 1e-10), 1 - 1e-10)

    grid = list(itertools.product(*rows.values()))
    prior = np.ones(len(grid))
    for level, outcome in zip(levels, outcomes, strict=True):
        prior *= [p(v, level) if outcome else 1 - p(v, level) for v in grid]
    prior /= prior.sum()
    kept = [k for k, name in enumerate(rows) if name not in nuisance]
    found = []
    for level in ROWS["levels"]:
        total = 0.0
        for outcome in (0, 1):
            then = prior * [p(v, level) if outcome else 1 - p(v, level) for v in grid]
            marginal = {}
            for values, weight in zip(grid, then, strict=True):
                key = tuple(values[k] for k in kept)
                marginal[key] = marginal.get(key, 0.0) + weight
            q = np.array(list(marginal.values())) / then.sum()
            total -= then.sum() * (q[q > 0] * np.log(q[q > 0])).sum()
        found.append(total)
    return np.array(found)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "nuisance", [(), ("lapse",), ("mean",), ("lapse", "second"), ("guess", "lapse")], ids=str
)
def test_each_level_has_the_least_expected_entropy_of_the_marginal(kind, nuisance):
    task, more = KINDS[kind]
    second = "slope" if "slopes" in more else "deviation"
    nuisance = tuple(second if n == "second" else n for n in nuisance)
    if kind == "comparison" and "guess" in nuisance:
        refused(UnknownName, "no parameter 'guess'", Quest, task, **ROWS, **more, nuisance=nuisance)
        return
    design = Quest(task, **ROWS, **more, nuisance=nuisance)
    rng = stream(4, kind, *nuisance)
    state = design.init(1)
    for _ in range(8):
        level = design.next(state).level
        entropies = expected(kind, nuisance, state["levels"], state["outcomes"])
        assert entropies[ROWS["levels"].index(level)] == pytest.approx(entropies.min(), abs=1e-9)
        outcomes = [*state["outcomes"], int(rng.random() < 0.6)]
        state = state | {"levels": [*state["levels"], level], "outcomes": outcomes}


def test_fewer_trials_are_spent_on_lapses_that_are_a_nuisance():
    """At the highest levels little but the lapse rate is learnt: of 120 trials, 35 were
    there, and 10 with the lapse rate as nuisance (means of 12 runs).
    """
    high = {}
    for nuisance in ((), ("lapse",)):
        design = Quest(
            FELT,
            (*np.linspace(0.0, 4.0, 17).tolist(), 9.0),
            means=np.linspace(1.0, 3.0, 11),
            deviations=np.geomspace(0.2, 1.5, 7),
            lapses=(0.0, 0.02, 0.05, 0.1, 0.15, 0.2),
            nuisance=nuisance,
            trials=61,
        )
        rng, state = np.random.default_rng(1), design.init(1)
        for _ in range(60):
            level = design.next(state).level
            right = 0.5 + 0.45 * norm.cdf(level, 2.0, 0.5)
            outcomes = [*state["outcomes"], int(rng.random() < right)]
            state = state | {"levels": [*state["levels"], level], "outcomes": outcomes}
        high[nuisance] = sum(level >= 4.0 for level in state["levels"])
        assert set(design.estimate(state)) == {"mean", "deviation", "lapse", "guess"}
    assert high[("lapse",)] < high[()] / 2, high


@pytest.mark.parametrize(
    "nuisance, error, why",
    [
        (("lapses",), UnknownName, "no parameter 'lapses'; there are mean, deviation, lapse"),
        (("slope",), UnknownName, "no parameter 'slope'"),
        (("mean", "deviation", "lapse"), BadValue, "names all parameters; leave out"),
        ("lapse", BadValue, "nuisance = 'lapse' must be a tuple"),
        ((1,), BadValue, "nuisance = .* must be a tuple"),
    ],
)
def test_a_nuisance_that_is_none(nuisance, error, why):
    refused(error, f"Quest: .*{why}", Quest, PAIR, **ROWS, deviations=(0.2, 0.4), nuisance=nuisance)


def test_a_list_of_nuisances_is_taken_and_each_counts_once():
    usual = {"task": PAIR, **ROWS, "deviations": (0.2, 0.4)}
    once, twice = Quest(**usual, nuisance=("lapse",)), Quest(**usual, nuisance=["lapse", "lapse"])
    assert once == twice and once.next(once.init(1)) == twice.next(twice.init(1))


def test_rates_that_add_up_to_1_are_refused():
    usual = {"task": PAIR, **ROWS, "deviations": (0.2, 0.4)}
    why = "guess and lapse rates add up to 1, where no curve rises"
    refused(BadValue, why, Quest, **usual | {"guesses": (0.1, 0.6), "lapses": (0.0, 0.4)})
    Quest(**usual | {"guesses": (0.1, 0.6), "lapses": (0.0, 0.39)})


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


@pytest.mark.parametrize(
    "state, error, why",
    [
        ({"levels": [77.0], "outcomes": [1]}, BadValue, "1 levels and 1 outcomes, with 77.0, are"),
        ({"levels": [], "outcomes": [1]}, BadValue, "0 levels and 1 outcomes are no state"),
        ({"levels": [ROWS["levels"][0]], "outcomes": [2]}, BadValue, "with 2, are no state"),
        ({"levels": []}, UnknownName, "no column 'outcomes'"),
    ],
)
def test_a_state_of_another_design_is_refused(state, error, why):
    design = Quest(PAIR, **ROWS, deviations=(0.2, 0.4))
    refused(error, f"Quest.estimate: .*{why}", design.estimate, state)
