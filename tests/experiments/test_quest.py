"""QUEST+: as another program has it; with nuisance parameters, the psi-marginal method
(Prins 2013); and at the ends of its grid.
"""

import dataclasses as dc
import itertools
import math
from collections import Counter

import numpy as np
import pytest
from experiments.some import TASK, experiment, nothing, observer, simulate, some
from laws import STRESS
from refusals import refused
from scipy.special import ndtr
from scipy.stats import norm

from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    Quest,
    Roved,
    Stimulus,
    TwoInterval,
    observed,
    stream,
)
from stimlib.experiments.designs import trials_of

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
        ({}, {"levels": [77.0], "outcomes": [1]}, "1 level and 1 outcome, with 77.0"),
        ({}, {"levels": [], "outcomes": [1]}, "0 levels and 1 outcome are"),
        ({}, {"levels": [ROWS["levels"][0]], "outcomes": [2]}, "with 2, are no state"),
        ({"guesses": (0.1, 0.6), "lapses": (0.0, 0.39)}, {"levels": []}, "no column 'outcomes'"),
        ({"precision": {"sigma": 0.1}}, {}, "no parameter 'sigma'; there are mean, deviation"),
        ({"precision": {"mean": 0.0}}, {}, "standard deviations above 0"),
        ({"precision": {"mean": 0.1}, "min_trials": -1}, {}, "min_trials = -1"),
    ],
)
def test_a_nuisance_or_a_state_that_is_none(words, state, why):
    usual = {"task": PAIR, **ROWS, "deviations": (0.2, 0.4)}
    refused((BadValue, UnknownName), why, lambda: Quest(**usual | words).estimate(state))


LEVELS = tuple(0.25 * k for k in range(1, 17))
PRECISE = Quest(
    TASK,
    LEVELS,
    means=LEVELS,
    deviations=(0.2, 0.4, 0.8, 1.6),
    trials=90,
    precision={"mean": 0.2, "deviation": 0.2},
)


def test_it_ends_as_soon_as_all_are_known_precisely_and_not_before():
    def errors(n):
        found = PRECISE.estimate({k: v[:n] for k, v in state.items() if k != "seed"})
        return [found[name].error <= 0.2 for name in ("mean", "deviation")]

    lengths = []
    for seed in range(6):
        state = PRECISE.init(seed)
        for _, answer in observed(PRECISE, seed, observer, stream(seed, "observer")):
            state = PRECISE.update(state, answer)
        lengths.append(n := len(state["levels"]))
        assert PRECISE.next(state) is None
        assert not any(all(errors(k)) for k in range(20, n)) and (n == 90 or all(errors(n)))
        refused(BadValue, f"no trial of {n} is left", PRECISE.update, state, answer)
    assert len(set(lengths)) > 2 and 20 <= min(lengths) < 90
    assert trials_of(PRECISE) is None and trials_of(dc.replace(PRECISE, precision={})) == 90
    for given, n in (({}, 20), ({"min_trials": 7}, 7)):
        least = dc.replace(PRECISE, precision={"mean": 9.0, "deviation": 9.0}, **given)
        assert len(list(observed(least, 1, observer, stream(1, "observer")))) == n


def test_a_session_that_ends_on_precision_is_resumed(tmp_path):
    """And has the trials, through a sink, that it has without one."""
    made = experiment(design=PRECISE, bounds={"k": (0.1, 8.0)})
    found = [simulate(tmp_path / "whole", made)]
    for left_at, show in ((5, nothing), (21, "offline")):
        some(tmp_path / str(left_at), left_at, made)
        found.append(simulate(tmp_path / str(left_at), made, show=show, resume=True))
    facts = [[(r.number, r.trial, r.answer.values) for r in s.records] for s in found]
    assert facts[0] == facts[1] == facts[2] and 20 <= len(facts[0]) < 90


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
    shape = (
        norm.cdf(level, v["mean"], v["deviation"])
        if "deviation" in v
        else 1 - math.exp(-((level / v["mean"]) ** v["slope"]))
    )
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


# Another program ----------------------------------------------------------------------
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["comparison", "detection", "weibull", "yes-no"])
def test_quest_has_the_levels_and_estimates_of_the_package_questplus(kind):
    """Levels equal, estimates to rounding: 1000 runs of these kinds were, by hand."""
    from questplus import QuestPlus

    rng = stream(3, kind)
    for _ in range(6 if STRESS else 1):
        rows = {
            "levels": np.sort(rng.uniform(0.1, 3.0, rng.integers(3, 12))),
            "means": np.sort(rng.uniform(0.2, 2.5, rng.integers(1, 9))).tolist(),
            "lapses": rng.uniform(0.0, 0.1, 2),
        }
        wide = rng.uniform(0.1, 1.0, 3)
        steep = kind in ("weibull", "yes-no")
        rows |= {"slopes": 5 * wide} if steep else {"deviations": wide}
        rows |= {"guesses": (0.0, 0.1, 0.2)} if kind == "yes-no" else {}
        design = Quest(FELT if kind in ("detection", "weibull") else PAIR, **rows, trials=15)
        low = {"comparison": {}, "yes-no": {"lower_asymptote": [0.0, 0.1, 0.2]}}
        theirs = QuestPlus(
            stim_domain={"intensity": list(design.levels)},
            param_domain={
                "threshold" if steep else "mean": list(design.means),
                "slope" if steep else "sd": list(design.slopes or design.deviations),
                "lapse_rate": list(design.lapses),
                **low.get(kind, {"lower_asymptote": [0.5]}),
            },
            outcome_domain={"response": ["yes", "no"]},
            func="weibull" if steep else "norm_cdf_2" if kind == "comparison" else "norm_cdf",
            stim_scale="linear",
        )
        state = design.init(1)
        while (trial := design.next(state)) is not None:
            assert trial.level == theirs.next_stim["intensity"]
            more = bool(rng.random() < 0.6)
            theirs.update(
                stim={"intensity": trial.level}, outcome={"response": "yes" if more else "no"}
            )
            state = {
                **state,
                "levels": [*state["levels"], trial.level],
                "outcomes": [*state["outcomes"], int(more)],
            }
        np.testing.assert_allclose(
            [found.value for found in design.estimate(state).values()],
            list(theirs.param_estimate.values()),
            rtol=1e-12,
        )


def test_quest_and_a_trial_of_another_chance_level_are_refused():
    """Quest reads the task's, fits the trial's: of an odd-one-out in three it would
    search a curve without guesses.
    """

    class Oddity:
        condition = "odd"

        def trial(self, level, seed, n):
            return dc.replace(PAIR.trial(level, seed, n), chance=1 / 3)

    design = Quest(Oddity(), (1.0, 2.0), means=(1.0, 2.0), deviations=(0.5,))
    refused(
        BadValue,
        r"Quest: the task has the chance level None, its trial 0.333; give the task's class",
        design.next,
        design.init(seed=1),
    )
    Oddity.chance = 1 / 3
    assert design.next(design.init(seed=1)).chance == 1 / 3
    roved = dc.replace(design, task=Roved(FELT, "k", 1.2))
    state = {"seed": 1, "levels": [], "outcomes": []}
    assert Roved(Oddity(), "k", 1.2).chance == 1 / 3 and roved.estimate(state)["guess"].value == 0.5


def test_quest_goes_on_after_many_answers_and_after_a_slip():
    """A session of any length is read back, and no answer leaves all curves at 0."""
    rows = ((1.0, 1.5, 2.0, 2.5, 3.0), (1.5, 2.0, 2.5), (0.2, 0.4))
    long = Quest(PAIR, *rows, trials=3000)
    state = {"seed": 1, "levels": [1.5, 2.5] * 1000, "outcomes": [0, 1] * 1000}
    assert long.estimate(state)["mean"].value == pytest.approx(2.0, abs=1e-9)
    assert long.next(state).level in rows[0]
    weibull = Quest(PAIR, (0.0, 0.5, 1.0, 2.0), (0.8, 1.6), slopes=(2.0,), lapses=(0.0,))
    assert weibull.next(weibull.init(1)).level > 0.0  # at 0 nothing is learnt
    sharp = Quest(PAIR, (1.0, 2.0, 3.0), (1.5, 2.5), (1e-3,), lapses=(0.0,))
    slip = {"seed": 1, "levels": [1.0, 2.0, 1.0], "outcomes": [0, 1, 1]}
    assert 1.5 <= sharp.estimate(slip)["mean"].value <= 2.5


# Ends ---------------------------------------------------------------------------------
GRID = tuple(np.linspace(0.3, 3.0, 10).round(3).tolist())  # a step is 0.3
QUEST = Quest(
    PAIR, tuple(np.linspace(0.2, 3.2, 9).tolist()), GRID, deviations=(0.2, 0.4, 0.8), trials=25
)


WIDE = dc.replace(QUEST, lapses=(0.0, 0.02, 0.05, 0.1))


def answers(chance, levels=QUEST.levels, repeats=40):
    rng, levels = np.random.default_rng(2), list(levels) * repeats
    return {"levels": levels, "outcomes": [int(rng.random() < chance(v)) for v in levels]}


FLAT = answers(lambda level: 0.3 + 0.4 * ndtr((level - 1.6) / 0.5))  # lapses in 30 of 100


STEADY, HIGH, LOW = (answers(lambda level, at=at: level > at) for at in (1.6, 3.1, 0.25))


FEW = {"levels": [*QUEST.levels], "outcomes": [0, 0, 1, 0, 0, 1, 0, 1, 1]}


@pytest.mark.parametrize(
    ("more", "state", "problems"),
    [
        ({}, FLAT, {"lapse": "edge", "mean": ""}),
        ({"nuisance": ("lapse",)}, FLAT, {"lapse": ""}),
        ({"lapses": (0.02,)}, FLAT, {"deviation": "edge", "mean": "", "lapse": ""}),
        ({"lapses": (0.02,), "nuisance": ("deviation",)}, FLAT, {"deviation": ""}),
        # no rate is below 0
        ({"guesses": (0.0, 0.1)}, STEADY, {"lapse": "", "guess": "", "deviation": "edge"}),
        ({"deviations": (0.2, 0.8)}, FEW, {"mean": "", "deviation": "", "lapse": ""}),
        ({}, HIGH, {"mean": "edge"}),
        ({}, LOW, {"mean": "edge"}),
        ({"levels": (0.2, 0.8)}, answers(lambda v: False, [0.2], 9), {"mean": "beyond"}),
        ({"levels": (2.4, 3.0)}, answers(lambda v: True, [3.0], 9), {"mean": "beyond"}),
    ],
)
def test_quest_says_it_of_every_parameter_of_interest(more, state, problems):
    found = dc.replace(WIDE, **more).estimate({"seed": 1} | state)
    assert {name: found[name].problem for name in problems} == problems
    assert ("at an end" in str(found["mean"])) == (found["mean"].problem == "edge")
    if more.get("lapses"):  # a single value, which is known
        assert dc.astuple(found["lapse"]) == (0.02, 0.0, 0.02, 0.02, "")


@pytest.mark.parametrize(
    ("means", "wanted"),
    [
        (GRID, (1.65, 3 / 12**0.5, 0.15, 3.15)),
        *((at, (20.0, 41 / 12**0.5, 0.5, 39.5)) for at in (range(41), np.roll(range(41), 9))),
    ],
)
def test_before_any_answer_an_estimate_is_uniform_over_its_grid(means, wanted):
    """A value stands for its neighbourhood, whatever their order."""
    design = dc.replace(WIDE, means=tuple(map(float, means)))
    found = design.estimate({"seed": 1, "levels": [], "outcomes": []})["mean"]
    assert dc.astuple(found)[:4] == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("rows", "ends"),
    [
        ({}, {"lapse": (0.0, 0.125), "deviation": (0.1, 1.0), "mean": (0.15, 3.15)}),
        ({"deviations": (0.1, 1.0)}, {"deviation": (0.0, 1.45)}),
        ({"means": (-1.0, 1.0, 9.0)}, {"mean": (-2.0, 13.0)}),
        (
            {"means": (1.0, 2.0, 8.0), "deviations": (), "slopes": (1.0, 9.0), "guesses": (0, 0.8)},
            {"mean": (0.5, 11.0), "slope": (0.0, 13.0), "guess": (0.0, 1.0)},
        ),
    ],
)
def test_an_interval_ends_half_way_to_the_next_value_and_at_0(rows, ends):
    found = dc.replace(WIDE, **rows).estimate({"levels": [], "outcomes": []})
    for name, wanted in ends.items():
        assert (found[name].low, found[name].high) == pytest.approx(wanted)
    sure = dc.replace(WIDE, means=(0.5, 1.6, 2.6)).estimate(STEADY)["mean"]
    assert (sure.low, sure.high) == pytest.approx((1.05, 2.1))
