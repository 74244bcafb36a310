"""Staircases: types of steps, targets, and the estimate from reversals."""

import dataclasses as dc
import json
import math
from functools import partial

import numpy as np
import pytest
from laws import STRESS
from refusals import refused
from scipy.special import ndtr

from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    Answer,
    PsychometricObserver,
    Roved,
    Staircase,
    Stimulus,
    Trial,
    TwoInterval,
    observed,
    outcome,
    stream,
)


class Quick:
    """A comparison without stimuli."""

    condition = "quick"

    def trial(self, level, seed, n):
        return Trial("quick", (), ("which",), level, scores={"less": 0.0, "more": 1.0})


PAIR = Quick()
FELT = TwoInterval("felt", "which", Stimulus("a", {"k": 0.0}), Stimulus("a"), "k")
WIDE = {"start": 0.0, "bounds": (-6.0, 6.0), "step_type": "lin"}


def after(stairs, state, more):
    says = next(c for c, score in stairs.next(state).scores.items() if score == more)
    return stairs.update(state, Answer({"which": says}))


def asked(stairs, outcomes):
    """The levels of one track, and its outcomes, until it ends or these do."""
    state, table = stairs.init(1), {"level": [], "outcome": []}
    said = outcomes if callable(outcomes) else partial(next, iter(outcomes), None)
    while (trial := stairs.next(state)) is not None:
        more = said(trial.level) if callable(outcomes) else said()
        if more is None:
            break
        table["level"].append(trial.level)
        table["outcome"].append(float(more))
        state = after(stairs, state, more)
    return table, state


# PsychoPy -----------------------------------------------------------------------------
ANSWERS = "110111010111011101111100"
PSYCHOPY = {  # what StairHandler of PsychoPy 2026.2.5 does with nUp=1, nDown=2
    "db": (
        (5.0, (8.0, 4.0, 2.0), (0.9, 20.0)),
        "5 1.990536 0.9 1.426404 1.426404 1.133033 1.133033 1.426404 1.426404 1.795736 1.795736"
        " 1.426404 1.426404 1.795736 1.795736 1.426404 1.426404 1.795736 1.795736 1.426404"
        " 1.426404 1.133033 1.133033 1.426404",
        "0.9 1.426404 1.133033 1.795736 1.426404 1.795736 1.426404 1.795736 1.133033",
    ),
    "log": (
        (2.0, (0.5, 0.2, 0.1), (0.1, 20.0)),
        "2 0.632456 0.2 0.316979 0.316979 0.251785 0.251785 0.316979 0.316979 0.399052 0.399052"
        " 0.316979 0.316979 0.399052 0.399052 0.316979 0.316979 0.399052 0.399052 0.316979"
        " 0.316979 0.251785 0.251785 0.316979",
        "0.2 0.316979 0.251785 0.399052 0.316979 0.399052 0.316979 0.399052 0.251785",
    ),
    "lin": (
        (0.5, (1.0, 0.5, 0.25), (-1.0, 2.0)),
        "0.5 -0.5 -1 -0.5 -0.5 -0.75 -0.75 -0.5 -0.5 -0.25 -0.25 -0.5 -0.5 -0.25 -0.25 -0.5 -0.5"
        " -0.25 -0.25 -0.5 -0.5 -0.75 -0.75 -0.5",
        "-1 -0.5 -0.75 -0.25 -0.5 -0.25 -0.5 -0.25 -0.75",
    ),
}


BY_HAND = {  # the reversals of some of them
    "the whole rule from the first step on": (
        (0.0, (-9.0, 9.0), (1.0,), 3),
        {"down": 2, "initial_rule": False},
        ("1111010110", "0 0 -1 -1 -2 -1 -1 0 0 -1", "-2 0 -1"),
    ),
    "steps through 0 and a schedule": (
        (1.0, (-3.0, 3.0), (2.0, 1.0, 0.5), 4),
        {},
        ("1101101", "1 -1 -3 -2 -2.5 -3 -2.5", ""),  # it ends with reversal 4
    ),
    "a target": ((1.0, (-9.0, 9.0), (1.0,)), {"target": 0.75}, ("100", "1 0 3", "")),
    "a target of log steps": (
        (1.0, (0.01, 99.0), (0.1,)),
        {"step_type": "log", "target": 0.75},
        ("00", f"1 {10**0.3}", ""),
    ),
}
BY_HAND |= {
    kind: ((start, bounds, steps, None), {"down": 2, "step_type": kind}, (ANSWERS, *told))
    for kind, ((start, steps, bounds), *told) in PSYCHOPY.items()
}


@pytest.mark.parametrize("name", BY_HAND)
def test_levels_and_reversals_are_those_of_psychopy(name):
    given, words, (answers, *told) = BY_HAND[name]
    table, state = asked(
        Staircase(PAIR, *given, **{"step_type": "lin"} | words), [c == "1" for c in answers]
    )
    levels, reversals = ([float(v) for v in text.split()] for text in told)
    assert table["level"] == pytest.approx(levels, abs=1e-6)
    assert not reversals or state["reversals"] == pytest.approx(reversals, abs=1e-6)


# Targets ------------------------------------------------------------------------------
def settled(stairs):
    """The exact proportion of 1 in the long run, and at the mean of the reversals, of
    an observer who is a standard cumulative normal. The states of its last step are a
    Markov chain, whose stationary distribution is solved for.
    """

    def key(state):
        return round(state["level"], 9), state["run"], state["way"]

    begin = stairs.init(1) | {"reversals": [0.0] * len(stairs.steps), "way": 1}
    known, todo, moves = {key(begin): 0}, [begin], []
    while todo:
        state = todo.pop()
        for more in (False, True):
            then = after(stairs, state, more)
            turned = len(then["reversals"]) > len(state["reversals"])
            then |= {"reversals": state["reversals"], "n": 0, "still": 0}
            if key(then) not in known:
                known[key(then)] = len(known)
                todo.append(then)
            p = ndtr(state["level"] if more else -state["level"])
            moves.append((known[key(state)], known[key(then)], p, turned, state["level"]))
    n, (i, j, p, turned, level) = len(known), map(np.array, zip(*moves, strict=True))
    chain = np.zeros((n, n))
    np.add.at(chain, (i, j), p)
    equations = chain.T - np.eye(n)
    equations[-1] = 1.0
    often = np.linalg.solve(equations, np.eye(n)[-1])
    turns = often[i] * p * turned
    return often @ ndtr([k[0] for k in known]), ndtr(turns @ level / turns.sum())


TARGETS = {
    "50 %": ({}, 0.5, 0.5),
    "70.7 %": ({"down": 2}, 0.5**0.5, 0.708),
    "79.4 %": ({"down": 3}, 0.5 ** (1 / 3), 0.795),
    "29.3 %": ({"up": 2}, 1 - 0.5**0.5, 0.292),
    "75 %": ({"target": 0.75}, 0.75, 0.7825),
    "25 %": ({"target": 0.25}, 0.25, 0.239),
    "90 %": ({"target": 0.9}, 0.9, 0.963),
}


@pytest.mark.parametrize("rule", TARGETS)
def test_a_staircase_settles_at_its_target(rule):
    """With steps of a quarter of the observer's sigma, within 0.5 %; a weighted one
    exactly (Kaernbach 1991). The mean of its reversals does so only with small steps.
    """
    words, target, at_reversals = TARGETS[rule]
    ones, turns = settled(Staircase(PAIR, **WIDE, steps=(0.25,), **words))
    assert ones == pytest.approx(target, abs=2e-5 if "target" in words else 0.002)
    assert turns == pytest.approx(at_reversals, abs=0.001)


# The estimate -------------------------------------------------------------------------
DRIFTING = 4 * "11110" + 8 * "0011" + 6 * "11110"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("reversals", "used"), [(9, 6), (10, 8), (30, 28)])
@pytest.mark.parametrize("kind", ["db", "log", "lin"])
def test_the_mean_of_the_last_reversals(kind, reversals, used):
    """In pairs, after the step became the last one: an odd one out is the first. Thirty
    are those of somebody who drifts, whose pairs are not independent.
    """
    steps = (0.4, 0.2, 0.1) if kind == "log" else (2.0, 1.0, 0.5)
    stairs = Staircase(PAIR, 4.0, (0.5, 9.0), steps, reversals, down=2, step_type=kind, stuck=99)
    table, state = asked(stairs, [c == "1" for c in (ANSWERS * 2 if reversals < 30 else DRIFTING)])
    turns = np.array(state["reversals"])
    assert len(turns) == reversals and json.loads(json.dumps(state)) == state
    z = {"db": 20 * np.log10(turns), "log": np.log10(turns), "lin": turns}[kind]
    back = {"db": lambda v: 10 ** (v / 20), "log": lambda v: 10**v, "lin": lambda v: v}[kind]
    found, two = stairs.estimate(table), stairs.estimate(table, 2)
    assert found["reversals"] == used and stairs.estimate(table, 40)["reversals"] == 2 * (
        reversals // 2
    )
    assert found["level"] == pytest.approx(back(z[-used:].mean()), rel=1e-12)
    pairs = z[-used:].reshape(-1, 2).mean(1)
    off = pairs - pairs.mean()
    rho = max(0.0, (off[1:] * off[:-1]).sum() / (off**2).sum())
    assert (rho > 0.7) == (reversals == 30)
    error = pairs.std(ddof=1) / math.sqrt(used / 2) * math.sqrt((1 + rho) / (1 - rho))
    assert found["error"] == pytest.approx(error, rel=1e-9)
    assert two["level"] == pytest.approx(back(z[-2:].mean()), rel=1e-12)
    assert math.isnan(two["error"])


@pytest.mark.filterwarnings("error")
def test_an_estimate_of_few_reversals_is_none():
    stairs = Staircase(PAIR, **WIDE, steps=(0.5,))
    for n in (0, 1, 3):
        found = stairs.estimate(asked(stairs, n * [True])[0])
        assert math.isnan(found["level"]) and math.isnan(found["error"])
        assert (found["reversals"], found["problem"]) == (0, "few")
    far = dc.replace(stairs, start=1e-8, bounds=(1e-12, 1e2), step_type="db")
    assert far.estimate(asked(far, 9 * [True, False])[0])["level"] == pytest.approx(
        10 ** (-8 - 0.25 / 20)
    )
    steady = stairs.estimate(asked(stairs, 9 * [True, False])[0])
    assert steady == {"level": -0.25, "error": 0.0, "reversals": 16, "problem": ""}


@pytest.mark.stress
@pytest.mark.parametrize("words", [{}, {"down": 2}, {"down": 3}, {"target": 0.75}], ids=str)
def test_the_error_of_the_estimate_is_the_true_one(words):
    """As if pairs of reversals were independent it would be 0.5 to 0.7 of it."""
    stairs = Staircase(PAIR, **WIDE, steps=(1.0, 0.5, 0.25), reversals=42, **words)
    rng, found = np.random.default_rng(5), []
    for _ in range(200):
        found.append(stairs.estimate(asked(stairs, lambda x: rng.random() < ndtr(x))[0]))
    spread = np.std([f["level"] for f in found])
    assert np.sqrt(np.mean([f["error"] ** 2 for f in found])) / spread == pytest.approx(1, abs=0.15)


BOUNDED = Staircase(
    PAIR, 2.0, (1.0, 10.0), steps=(1.0, 0.5, 0.25), step_type="lin", down=2, reversals=12
)


def found_by(stairs, truth, deviation, seed):
    """Return the estimate that a staircase makes of an observer."""
    answers = observed(stairs, seed, PsychometricObserver(truth, deviation), stream(seed, "who"))
    # as a file of few digits has it
    rows = [(trial.level * (1 + 1e-12), outcome(trial, answer)) for trial, answer in answers]
    return stairs.estimate(dict(zip(("level", "outcome"), zip(*rows, strict=True), strict=True)))


def test_a_staircase_says_that_it_sits_on_a_bound():
    """In 40 runs of each of 8 rules a target one sigma outside is named in all, and one
    three sigma inside in none.
    """
    rng, near = np.random.default_rng(1), dc.replace(BOUNDED, stuck=1000)  # by its reversals alone
    for seed in range(8 if STRESS else 2):
        truth = rng.choice([1.0 - rng.uniform(1.0, 3.0), 10.0 + rng.uniform(0.2, 6.0)])
        for stairs, at, problem in (
            (BOUNDED, truth, "edge"),
            (BOUNDED, rng.uniform(2.5, 8.0), ""),
            (near, 10.2, "edge"),
            (near, 9.0, ""),
        ):
            assert found_by(stairs, at, 0.6, seed)["problem"] == problem
    at_once = found_by(dc.replace(BOUNDED, stuck=3, reversals=2), 99.0, 0.6, 1)
    assert (at_once["problem"], at_once["reversals"]) == ("edge", 0)


# Errors -------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "wrong, why",
    [
        ({"step_type": "dB"}, "step_type = 'dB' must be one of db, log, lin"),
        ({"step_type": "db"}, "rise from a level above 0: steps are in dB; .*step_type='lin'"),
        ({"step_type": "log"}, "above 0: steps are in log10 units"),
        ({"step_type": "log", "bounds": (0.1, 9.0), "steps": (11.0,)}, "log10 units .* at most 10"),
        ({"bounds": (5.0, 5.0)}, r"bounds = \(5.0, 5.0\) must rise$"),
        ({"bounds": (-math.inf, 5.0)}, "must be numbers"),
        ({"steps": (-1.0,)}, "units of the level above 0, up and down at most 10"),
        ({"steps": (11.0,)}, "at most 10"),
        ({"steps": (4.0,), "target": 0.75}, "at most 10"),  # that up would be 12
        ({"steps": Staircase.steps}, "units of the level"),  # its dB were not meant
        ({"target": 0.0}, "target = 0.0 .* probability between 0 and 1"),
        ({"target": 1.0}, "target = 1.0 .* probability between 0 and 1"),
        ({"target": math.nan}, "target = nan"),
        ({"target": 0.9999}, "at most a factor of 1000"),
        ({"target": 0.1, "down": 4}, "at most a factor of 1000"),
        ({"reversals": 0}, "reversals = 0"),
        ({"task": Roved(FELT, "k", 1.2)}, "settle at or below 0.5, the chance level"),
        ({"task": FELT, "target": 0.5}, "target = 0.5 settle at or below 0.5, the chance level"),
        ({"task": FELT, "down": 2, "up": 2}, "chance level of this task; give down=3"),
    ],
)
def test_a_staircase_that_makes_no_sense(wrong, why):
    usual = {"task": PAIR, "start": 5.0, "bounds": (-5.0, 5.0), "step_type": "lin", "steps": (1.0,)}
    refused(BadValue, why, Staircase, **usual | wrong)


@pytest.mark.parametrize(
    "answers, last, why",
    [
        ({"level": [0.0, 1.0]}, None, "no column 'outcome'"),
        ({"level": [0.0, 1.0], "outcome": [1.0]}, None, "two rows of finite numbers"),
        ({"level": [0.0, math.nan], "outcome": [0, 0]}, None, "two rows of finite numbers"),
        ({"level": ["a"], "outcome": [0]}, None, "two rows of finite numbers"),
        ({"level": [None], "outcome": [0]}, None, "two rows of finite numbers"),
        ({"level": [0.0, 1.0], "outcome": [1, 0]}, None, "trial 2 has the level 1, where .* -0.5"),
        ({"level": [0.0], "outcome": [0.5]}, None, "outcomes 0 or 1"),
        ({"level": [0.0], "outcome": [1]}, 3, "last = 3 must be an even number"),
        ({"level": [0.0], "outcome": [1]}, 0, "last = 0 must be an even number"),
    ],
)
def test_an_estimate_of_other_answers_is_refused(answers, last, why):
    stairs = Staircase(PAIR, **WIDE, steps=(0.5,))
    error = UnknownName if "column" in why else BadValue
    refused(error, f"Staircase.estimate: .*{why}", stairs.estimate, answers, last)
