"""Difference thresholds: the recipes of the page, of simulated people whose JND is
known; Weber fractions of several people; and first guesses that are refused.
"""

import runpy
from pathlib import Path

import numpy as np
import pandas
import pytest
from experiments.some import experiment
from laws import STRESS
from refusals import refused

import stimlib
from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    Answer,
    Interleaved,
    PsychometricObserver,
    Quest,
    Staircase,
    Stimulus,
    TwoInterval,
    difference_thresholds,
    fitted,
    observed,
    outcome,
    simulate,
    stream,
    to_pandas,
)

EXAMPLE = runpy.run_path(
    str(Path(__file__).parents[2] / "examples" / "difference_threshold.py"), run_name="example"
)
JND = 16.0
PERSON = PsychometricObserver(200.0, JND / 0.6744898)
PAIR = EXAMPLE["pair"]
DELTA = TwoInterval("200 Hz", "higher", Stimulus("tone", {"delta": 0.0}), Stimulus("tone"), "delta")
RULE = {"step_type": "lin", "reversals": None, "initial_rule": False}


def mirrored():
    how = RULE | {"steps": (16.0, 8.0), "max_trials": 60}
    tracks = {
        "above": Staircase(PAIR, 260.0, (200.0, 300.0), down=2, **how),
        "below": Staircase(PAIR, 140.0, (100.0, 200.0), up=2, **how),
    }
    return Interleaved(tracks)


def staircase():
    """Over the difference, which the page advises against."""
    return Staircase(DELTA, 60.0, (1.0, 100.0), (6.0, 3.0), down=3, max_trials=120, **RULE)


def notices(trial, rng):
    """Somebody for whom the level is a difference, whatever the task's chance level."""
    more = PERSON.chance(stimlib.experiments.Trial("", (), (), 200.0 + trial.level))
    said = {score: choice for choice, score in trial.scores.items()}[float(rng.random() < more)]
    return Answer({"higher": said})


def answers(design, people, observer=PERSON):
    columns = {name: [] for name in ("participant", "level", "outcome", "chance")}
    for who in range(people):
        for trial, answer in observed(design, who, observer, stream(who, "observer")):
            row = who, trial.level, outcome(trial, answer), trial.chance
            for column, value in zip(columns.values(), row, strict=True):
                column.append(value)
    return columns


@pytest.mark.parametrize(
    ("made", "observer", "most", "few"),
    [
        pytest.param(lambda: EXAMPLE["design"], PERSON, 200, 8, id="QUEST+"),
        pytest.param(mirrored, PERSON, 60, 6, id="mirrored"),
        pytest.param(staircase, notices, 60, 6, id="difference"),
    ],
)
def test_recipes_find_the_jnd_of_simulated_people(made, observer, most, few):
    """All are usable, the median is near, and 95 % intervals hold 16 Hz."""
    people = most if STRESS else few
    found = list(
        difference_thresholds(answers(made(), people, observer), 200.0, ["participant"]).values()
    )
    # each of which is named in one of a hundred by chance
    assert {name for one in found for name in one.problems} <= {"overdispersed", "lapses"}
    assert sum(one.problems != () for one in found) <= max(2, 0.04 * people)
    assert np.median([one.jnd for one in found]) == pytest.approx(JND, rel=0.05 if STRESS else 0.15)
    held = np.mean([one.jnd_low <= JND <= one.jnd_high for one in found])
    assert np.isfinite([one.jnd_high for one in found]).all()
    assert held >= (0.92 if STRESS else 0.8)
    assert {one.weber for one in found} == {one.jnd / 200 for one in found}
    assert {one.pse for one in found} == {0.0 if made is staircase else 200.0}


def test_several_people_and_conditions_are_a_table():
    columns = simulate(EXAMPLE["pitch"], PERSON, ["P01", "P02"])
    found = difference_thresholds(columns, {"200 Hz": 200.0})
    fit = fitted(columns, pse=200.0)["P01", "200 Hz"]
    one = found["P01", "200 Hz"]
    assert (one.jnd, one.jnd_low, one.jnd_high) == (fit.jnd, *fit.jnd_interval)
    assert (one.pse, one.weber, one.trials) == (200.0, fit.jnd / 200, 120)
    table = to_pandas(found, ["participant", "condition"])
    assert list(table.participant) == ["P01", "P02"] and (table.weber_low < table.weber).all()
    # pandas has nan where there is no chance level
    frame = pandas.DataFrame(columns).astype({"chance": float})
    assert difference_thresholds(frame, 200.0) == difference_thresholds(columns, 200.0)
    assert difference_thresholds(columns, {"200 Hz": np.int64(200)}) == found
    free = difference_thresholds(columns, 200.0, pse=None)["P01", "200 Hz"]
    fit = fitted(columns)["P01", "200 Hz"]
    assert (free.pse, free.jnd) == (fit.pse, fit.jnd) and free.pse != 200.0
    logs = difference_thresholds(columns, 200.0, log=True)["P01", "200 Hz"]
    assert logs.jnd == pytest.approx(one.jnd, rel=0.2)  # in Hz, too
    assert difference_thresholds(
        {**columns, "level": [level - 200.0 for level in columns["level"]]}, 200.0, pse=0.0
    )["P01", "200 Hz"].jnd == pytest.approx(one.jnd, rel=1e-9)


@pytest.mark.parametrize(
    ("standard", "error", "says"),
    [
        (0.0, BadValue, "standard = 0.0 must be a number above 0"),
        ({"100 Hz": 100.0}, UnknownName, "no condition 'a'; there are 100 Hz"),
        ({"a": 1.0, "b": 2.0}, BadValue, "one for each group"),
    ],
)
def test_a_standard_that_is_none(standard, error, says):
    columns = {"participant": ["P"] * 3, "condition": ["a", "b", "b"]}
    columns |= {"level": [1, 2, 3], "outcome": [0, 1, 1]}
    refused(error, says, difference_thresholds, columns, standard, ["participant"])


# First guesses ------------------------------------------------------------------------
def composed(unit, low=0.0, **task):
    scene = stimlib.Scene({"force": stimlib.Param("delta", 0.0, unit) * stimlib.Input("x", "m")})
    pair = TwoInterval(
        "a", "softer", Stimulus("tone", {"delta": 0.0}), Stimulus("tone"), "delta", **task
    )
    design = Quest(pair, (low, 8.0), means=(1.0, 4.0), deviations=(2.0, 4.0))
    return experiment(scenes={"tone": scene}, design=design, bounds={"delta": (-9.0, 9.0)})


@pytest.mark.parametrize("unit", ["Hz", "s"])
def test_a_difference_that_is_taken_as_a_detection_is_refused(unit):
    refused(BadValue, f"delta = 0 {unit}, which is taken as no stimulus", composed, unit)
    assert composed(unit, detection=True) and composed(unit, -8.0, detection=False)


def test_a_level_below_no_stimulus_is_refused():
    refused(
        BadValue, "delta = -8 is below the standard's 0.*detection=False", composed, "N/m", -8.0
    )
    assert composed("N/m") and composed("N/m", -8.0, detection=False)
