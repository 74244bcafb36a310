"""Estimates at an end of what they can be: each says so, and others do not."""

import dataclasses as dc

import numpy as np
import pytest
from scipy.special import ndtr

from stimlib.experiments import (
    Psychometric,
    Quest,
    Staircase,
    Stimulus,
    TwoInterval,
    observed,
    outcome,
    psychometric,
    psychometrics,
    stream,
)

PAIR = TwoInterval("a", "softer", Stimulus("s", {"k": 1.0}), Stimulus("s"), "k", detection=False)
GRID = tuple(np.linspace(0.3, 3.0, 10).round(3).tolist())  # a step is 0.3
QUEST = Quest(
    PAIR, tuple(np.linspace(0.2, 3.2, 9).tolist()), GRID, deviations=(0.2, 0.4, 0.8), trials=25
)
STAIRS = Staircase(
    PAIR, 2.0, (1.0, 10.0), steps=(1.0, 0.5, 0.25), step_type="lin", down=2, reversals=12
)


def found_by(design, truth, deviation, seed):
    """Return the estimates that a design makes of an observer."""
    who, state, rows = Psychometric(truth, deviation), design.init(seed), []
    for trial, answer in observed(design, seed, who, stream(seed, "who")):
        state = design.update(state, answer)
        # as a file of few digits has it
        rows.append((trial.level * (1 + 1e-12), outcome(trial, answer)))
    if isinstance(design, Staircase):
        return design.estimate(
            dict(zip(("level", "outcome"), zip(*rows, strict=True), strict=True))
        )
    return design.estimate(state)


def test_quest_says_where_its_grid_ends():
    """A truth of 8 in a grid of 0.3 to 3 gave 2.998 with an error of 0.5, and no word.

    Of 30 runs each, a truth at least one step outside is named in 360 of 360, one three
    steps inside in 0 of 60, on the last value in 95 %, on the one before in 22 %.
    """
    rng = np.random.default_rng(1)
    for seed in range(20):
        far, deviation = 0.3 + rng.exponential(1.0), rng.choice([0.4, 0.8])
        truth = rng.choice([0.3 - far, 3.0 + far])
        one = found_by(QUEST, truth, deviation, seed)["mean"]
        assert one.problem == "edge" and "problem: the estimate is at an end" in str(one)
        inside = rng.uniform(1.2, 2.1)
        one = found_by(QUEST, inside, deviation, seed)["mean"]
        assert one.problem == "" and "problem" not in str(one)
        assert one.low < one.value < one.high and one.error > 0.08 and abs(one.value - inside) < 1


def test_quest_says_it_of_every_parameter_of_interest():
    state = {"seed": 1, "levels": [], "outcomes": []}
    rng = np.random.default_rng(2)
    for level in QUEST.levels * 40:  # a deviation of 3, and a lapse in 30 of 100
        p = 0.3 + 0.4 * ndtr((level - 1.6) / 0.5)
        state["levels"].append(level)
        state["outcomes"].append(int(rng.random() < p))
    wide = dc.replace(QUEST, lapses=(0.0, 0.02, 0.05, 0.1))
    for name, rows in (("lapse", {}), ("deviation", {"lapses": (0.02,)})):
        design = dc.replace(wide, **rows)
        found = design.estimate(state)
        assert (found[name].problem, found["mean"].problem) == ("edge", "")
        assert dc.replace(design, nuisance=(name,)).estimate(state)[name].problem == ""
    alone = found["lapse"]  # a single value, which is known
    assert dc.astuple(alone) == (0.02, 0.0, 0.02, 0.02, "")
    steady = {**state, "outcomes": [int(level > 1.6) for level in state["levels"]]}
    found = dc.replace(wide, guesses=(0.0, 0.05, 0.1)).estimate(steady)
    assert found["lapse"].problem == found["guess"].problem == "", "no rate is below 0"
    assert found["deviation"].problem == "edge"
    both = dc.replace(wide, deviations=(0.2, 0.8))
    few = {"seed": 1, "levels": [*QUEST.levels], "outcomes": [0, 0, 1, 0, 0, 1, 0, 1, 1]}
    assert {one.problem for one in both.estimate(few).values()} == {""}
    fresh = both.estimate({"seed": 1, "levels": [], "outcomes": []})["mean"]
    # uniform from 0.15 to 3.15, as a value stands for its neighbourhood
    assert dc.astuple(fresh)[:4] == pytest.approx((1.65, 3 / 12**0.5, 0.15, 3.15))
    for means in (np.arange(41.0), np.arange(41.0)[::-1], np.roll(np.arange(41.0), 9)):
        fine = dc.replace(both, means=tuple(means))
        fresh = fine.estimate({"seed": 1, "levels": [], "outcomes": []})["mean"]
        assert dc.astuple(fresh)[:4] == pytest.approx((20.0, 41 / 12**0.5, 0.5, 39.5))
    for levels, answer in (((0.2, 0.5, 0.8), 0), ((2.4, 2.7, 3.0), 1)):
        state = {"seed": 1, "levels": [levels[1]] * 9, "outcomes": [answer] * 9}
        aside = dc.replace(wide, levels=levels)
        assert aside.estimate(state)["mean"].problem == "beyond"


def test_a_staircase_says_that_it_sits_on_a_bound():
    """In 40 runs of each of 8 rules a target one sigma outside is named in all, and one
    three sigma inside in none.
    """
    rng = np.random.default_rng(1)
    for seed in range(8):
        truth = rng.choice([1.0 - rng.uniform(1.0, 3.0), 10.0 + rng.uniform(0.2, 6.0)])
        assert found_by(STAIRS, truth, 0.6, seed)["problem"] == "edge"
        assert found_by(STAIRS, rng.uniform(2.5, 8.0), 0.6, seed)["problem"] == ""
        near = dc.replace(STAIRS, stuck=1000)  # by its reversals alone
        assert found_by(near, 10.2, 0.6, seed)["problem"] == "edge"
        assert found_by(near, 9.0, 0.6, seed)["problem"] == ""
    at_once = found_by(dc.replace(STAIRS, stuck=3, reversals=2), 99.0, 0.6, 1)
    assert (at_once["problem"], at_once["reversals"]) == ("edge", 0)


def test_a_fit_says_that_it_is_beyond_its_levels_or_that_a_rate_is_at_its_largest():
    """All of 300 comparisons with a PSE one sigma beyond the levels name a problem (290
    of 300 detections), and none of 300 in the middle has one of these.
    """
    rng, levels, asked = np.random.default_rng(1), np.linspace(1.0, 3.0, 6), np.full(6, 20)
    named = {}
    for truth in (0.0, 2.0, 4.0):
        drawn = rng.binomial(20, ndtr(levels - truth), (60, 6))
        fits = psychometrics(
            {k: (levels, yes, asked) for k, yes in enumerate(drawn)}, interval="none"
        )
        named[truth] = [fit.problems for fit in fits.values()]
    assert all(named[0.0]) and all(named[4.0])
    assert sum("beyond" in one for one in named[4.0]) > 30
    assert not {"beyond", "edge"} & {name for one in named[2.0] for name in one}
    far = psychometric(levels, [0, 0, 0, 2, 4, 7], asked)
    assert (
        far.problems == ("beyond",) and far.pse > 3 and "outside of the levels" in far.advice()[0]
    )
    assert str(far).endswith("problems: beyond")
    low = psychometric(levels, [8, 12, 18, 20, 20, 20], asked)  # between the first two
    assert 1 < low.pse < 1.4 and "beyond" not in low.problems
    few = psychometric(np.arange(6.0), [0, 0, 3, 19, 19, 20], asked, guess=0.0, lapse="free")
    assert few.problems == () and 0.01 < few.lapse < 0.09
    lapses = psychometric(np.arange(6.0), [0, 0, 1, 15, 15, 15], asked, guess=0.0, lapse="free")
    assert lapses.problems == ("edge",) and lapses.lapse == pytest.approx(0.1, abs=1e-4)
    curve = ndtr((np.arange(6.0) - 2.5) / 0.5)
    asked = np.full(6, 2000)
    for guess, lapse, named in ((0.0, 0.095, ()), (0.85, 0.0, ("edge",)), (0.75, 0.0, ())):
        yes = np.rint(2000 * (guess + (1 - guess - lapse) * curve)).astype(int)
        rates = {"guess": "free", "lapse": 0.0} if guess else {"guess": 0.0, "lapse": "free"}
        fit = psychometric(np.arange(6.0), yes, asked, **rates)
        assert [p for p in fit.problems if p == "edge"] == [*named]
    shared = psychometrics(
        {1: (np.arange(6.0), [0, 0, 1, 15, 15, 15], np.full(6, 20))}, guess=0.0, lapse="shared"
    )
    assert shared[1].problems == ("edge",)
