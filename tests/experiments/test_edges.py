"""Estimates at an end of what they can be: each says so, and others do not."""

import dataclasses as dc

import numpy as np
import pytest
from laws import STRESS
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


def found_by(stairs, truth, deviation, seed):
    """Return the estimate that a staircase makes of an observer."""
    answers = observed(stairs, seed, Psychometric(truth, deviation), stream(seed, "who"))
    # as a file of few digits has it
    rows = [(trial.level * (1 + 1e-12), outcome(trial, answer)) for trial, answer in answers]
    return stairs.estimate(dict(zip(("level", "outcome"), zip(*rows, strict=True), strict=True)))


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


def test_a_staircase_says_that_it_sits_on_a_bound():
    """In 40 runs of each of 8 rules a target one sigma outside is named in all, and one
    three sigma inside in none.
    """
    rng, near = np.random.default_rng(1), dc.replace(STAIRS, stuck=1000)  # by its reversals alone
    for seed in range(8 if STRESS else 2):
        truth = rng.choice([1.0 - rng.uniform(1.0, 3.0), 10.0 + rng.uniform(0.2, 6.0)])
        for stairs, at, problem in (
            (STAIRS, truth, "edge"),
            (STAIRS, rng.uniform(2.5, 8.0), ""),
            (near, 10.2, "edge"),
            (near, 9.0, ""),
        ):
            assert found_by(stairs, at, 0.6, seed)["problem"] == problem
    at_once = found_by(dc.replace(STAIRS, stuck=3, reversals=2), 99.0, 0.6, 1)
    assert (at_once["problem"], at_once["reversals"]) == ("edge", 0)


def test_a_fit_says_that_it_is_beyond_its_levels():
    levels, asked = np.linspace(1.0, 3.0, 6), np.full(6, 20)
    far = psychometric(levels, [0, 0, 0, 2, 4, 7], asked)
    assert far.pse > 3 and "outside of the levels" in far.advice()[0]
    assert far.problems == ("beyond",) and str(far).endswith("problems: beyond")
    low = psychometric(levels, [8, 12, 18, 20, 20, 20], asked)  # between the first two
    assert 1 < low.pse < 1.4 and not {"beyond", "edge"} & {*low.problems}


@pytest.mark.parametrize(
    ("yes", "rates", "at_edge"),
    [
        ([0, 0, 3, 19, 19, 20], {"guess": 0.0, "lapse": "free"}, False),
        ([0, 0, 1, 15, 15, 15], {"guess": 0.0, "lapse": "free"}, True),
        ([0, 0, 1, 15, 15, 15], {"guess": 0.0, "lapse": "shared"}, True),
        ([0, 0, 2.87, 15.23, 18.08, 18.1], {"guess": 0.0, "lapse": "free"}, False),
        ([17, 17.02, 17.48, 19.52, 19.98, 20], {"guess": "free", "lapse": 0.0}, True),
        ([15, 15.04, 15.8, 19.2, 19.96, 20], {"guess": "free", "lapse": 0.0}, False),
    ],
)
def test_a_fit_says_that_a_rate_is_at_its_largest(yes, rates, at_edge):
    yes, asked = np.rint(100 * np.array(yes)), np.full(6, 2000)
    fit = psychometrics({1: (np.arange(6.0), yes, asked)}, **rates)[1]
    assert ("edge" in fit.problems) == at_edge
    if at_edge and rates["lapse"]:
        assert fit.lapse == pytest.approx(0.1, abs=1e-4)
