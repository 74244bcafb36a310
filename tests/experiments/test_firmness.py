"""The firmness experiment of Çaldıran's thesis, chapter 4, from end to end; roving."""

import dataclasses
from math import isnan

import numpy as np
import pytest
from refusals import refused
from scipy.stats import norm

from stimlib.errors import BadValue
from stimlib.experiments import (
    ConstantStimuli,
    OneInterval,
    Roved,
    Session,
    Simulated,
    Stimulus,
    Timing,
    Trial,
    TwoInterval,
    check_graeco_latin,
    columns,
    observed,
    run,
    sessions,
    stream,
    write_report,
)
from stimlib.experiments.papers import bounciness as bouncy, firmness as firm
from stimlib.experiments.papers.firmness import PAIRS, firmness, pair_of, person, weber_fractions
from stimlib.experiments.papers.springpots import by_cues, cues_of_stimulus
from stimlib.scenes import viscoelastic


def exact(alpha, firmness):
    """The strength of a material that has forgotten its beginning."""
    return 300 * firmness


def test_sessions_and_their_order():
    check_graeco_latin(
        [[("αβγδε".index(g), "ABCDE".index(k)) for g, k in row.split()] for row in firm.SQUARE]
    )
    assert list(firm.REFERENCES.values()) == [0, 0.25, 0.5, 0.75, 1]  # section 4.1
    steps = [[pair_of(f"P0{n}", k).split("+")[1] for k in (1, 2, 3)] for n in (1, 2, 3, 4, 5)]
    assert ["30 %", "10 %", "20 %"] in steps and ["20 %", "10 %", "30 %"] in steps  # C, E
    for participant in ("P01", "P02", "P03", "P04", "P05"):
        assert sorted(pair_of(participant, n) for n in range(1, 16)) == sorted(PAIRS)
    for session in (0, 16):
        refused(BadValue, "there are 15", pair_of, "P01", session)
    experiment = firmness()
    trials = [
        t for t, _ in observed(experiment.designed("P01", 3), 1, person(exact), stream(1, "person"))
    ]
    assert [t.training for t in trials] == 2 * (10 * [True] + 50 * [False])
    assert [n for n, t in enumerate(trials) if t.pause] == [60]
    counted = [t.stimuli[0].params["firmness"] for t in trials if not t.training]
    assert sorted(counted) == 50 * [1.0] + 50 * [1.3]
    for t in trials:
        green = t.stimuli[0].params["firmness"] > 1
        assert t.correct == {"firmer": "green" if green else "red"} and t.level == float(green)
    assert experiment.scenes["0.25"].hash == viscoelastic(alpha=0.25).hash
    assert experiment.sessions == 15 and experiment.cursor is None


def test_an_observer_by_several_cues_has_the_d_of_all_of_them():
    """d'^2 is the sum of the cues' own; the errors are set so that it is 1 + 0.25."""
    red, green = firm.pair_stimuli("0.5 and +20 %")
    of = [cues_of_stimulus(0.5, s.params["firmness"]) for s in (red, green)]
    assert red.params["firmness"] == 1.0 and green.params["firmness"] == 1.2
    errors = {"k_S": of[1].k_S - of[0].k_S, "W": 2 * (of[1].W - of[0].W)}
    rng, n = stream(1, "person"), 4000
    observer = by_cues("firmer", firm.pair_stimuli, errors)
    said = [
        [
            observer(Trial("0.5 and +20 %", (s,), ("firmer",)), rng).values["firmer"]
            for _ in range(n)
        ]
        for s in (red, green)
    ]
    alarms, hits = (sum(a == "green" for a in answers) / n for answers in said)
    d = norm.ppf(hits) - norm.ppf(alarms)
    assert d == pytest.approx(np.sqrt(1.25), abs=0.12)
    # the criterion is in the middle: 0.03 is a standard error
    assert norm.ppf(hits) + norm.ppf(alarms) == pytest.approx(0.0, abs=0.12)
    for wrong in ({"weight": 1.0}, {"W": 0.0}, {"W": np.inf}):
        refused(BadValue, "by_cues", by_cues, "firmer", firm.pair_stimuli, wrong)


@pytest.mark.parametrize("alpha, rel", [(0.0, 1e-12), (0.5, 0.01), (1.0, 0.01)])
def test_all_references_are_equally_strong_at_one_hertz(alpha, rel):
    """Section 4.1: chi_0 = 0.3 N/mm, eq. (4.1)."""
    assert firm.strength(alpha, 1.0) == pytest.approx(300, rel=rel)
    assert firm.strength(alpha, 1.2) == pytest.approx(1.2 * firm.strength(alpha, 1.0))


def answered(weber, people):
    """Columns as of all sessions of people who judge firmness with this error."""
    rng, rows = np.random.default_rng(3), []
    for who in people:
        for condition, (_, step) in PAIRS.items():
            for level in 50 * [0.0, 1.0]:
                judged = 1 + level * step + weber * rng.normal()
                rows.append((who, condition, level, float(judged > 1 + step / 2)))
    names = "participant", "condition", "level", "outcome"
    return dict(zip(names, zip(*rows, strict=True), strict=True))


def test_the_weber_fractions_are_those_of_the_observers():
    answers = answered(0.15, ["P01", "P02"])
    found = weber_fractions(answers)
    assert list(found.group) == [0, 0.25, 0.5, 0.75, 1]
    for a, (mean, low, high) in found.group.items():
        slopes = [np.mean(np.divide(found.d[who, a], firm.STEPS)) for who in ("P01", "P02")]
        half = 12.7062047 * np.std(slopes, ddof=1) / 2**0.5  # t of one degree of freedom
        assert mean == pytest.approx(1 / np.mean(slopes)) == pytest.approx(0.15, rel=0.25)
        assert low == pytest.approx(1 / (np.mean(slopes) + half), rel=1e-4)
        wanted = 1 / (np.mean(slopes) - half) if half < np.mean(slopes) else np.inf
        assert high == pytest.approx(wanted, rel=1e-4)
        assert found.people["P01", a] == pytest.approx(1 / slopes[0])
    assert found.effect.df == (4, 4) and 0 < found.effect.p < 1
    assert "thesis: F(4, 16), p = 0.3981" in firm.text(found)
    alone = weber_fractions({k: v[: len(v) // 2] for k, v in answers.items()})
    assert alone.effect is None and isnan(alone.group[0.5][1]) and "95 %" not in firm.text(alone)
    late = {name: column[100:] for name, column in answers.items()}
    refused(BadValue, "P01 has no session of .*all 15", weber_fractions, late)


def test_from_the_session_to_the_report(tmp_path):
    """Fifteen short sessions, whose observer judges the rendered force."""

    def short(participant, session):
        pair = pair_of(participant, session)
        task = OneInterval(pair, "firmer", firm.known(participant, session))
        return ConstantStimuli(((task, "red"), (task, "green")), 2)

    made = dataclasses.replace(
        firmness(), design=short, timing=Timing(interval=2.0, gap=0.0, before=0.0)
    )
    for number in range(1, 16):
        with Session(made, tmp_path, "P01", number) as session:
            run(session, Simulated(session, person(weber=0.01)), "offline")
    saved = sessions("firmness", tmp_path)
    told = firm.analysis(saved)
    assert told.count("Weber fraction") == 5 and "k_S" in told and "normalised distance" in told
    right = [r.answer.values["firmer"] == r.trial.correct["firmer"] for s in saved for r in s.data]
    assert len(right) == 60 and all(right)
    write_report(tmp_path / "report.html", "Firmness", "One person.", columns(saved))
    assert "0.25 and +10 %" in (tmp_path / "report.html").read_text()


def test_a_roved_parameter_is_no_cue():
    pair = {n: Stimulus(n, {"firmness": 2.0}) for n in ("red", "green")}
    task = Roved(OneInterval("0.25", "bouncier", pair), "firmness", 1.5)
    plain = task.task
    values = [task.trial("red", 1, n).stimuli[0].params["firmness"] for n in range(400)]
    assert min(values) >= 2 / 1.5 and max(values) <= 3.0
    logs = np.log(np.divide(values, 2)) / np.log(1.5)
    assert np.mean(logs) == pytest.approx(0, abs=0.1) and np.std(logs) == pytest.approx(
        3**-0.5, rel=0.1
    )
    trial, same = task.trial("green", 1, 7), plain.trial("green", 1, 7)
    assert dataclasses.replace(trial, stimuli=same.stimuli) == same
    assert trial.stimuli[0].seed == same.stimuli[0].seed and task.condition == "0.25"
    both = Roved(
        TwoInterval("c", "q", Stimulus("a", {"A": 1.0, "k": 1.0}), Stimulus("a", {"A": 1.0}), "k"),
        "A",
        2.0,
    ).trial(3.0, 1, 0)
    first, second = (s.params["A"] for s in both.stimuli)
    assert first != second and {s.params["k"] for s in both.stimuli} == {1.0, 3.0}
    refused(BadValue, "does not set 'gain'; give", Roved(plain, "gain", 2.0).trial, "red", 1, 0)
    for factor in (1.0, 0.5, float("inf"), float("nan")):
        refused(BadValue, "above 1|finite number", Roved, plain, "firmness", factor)


def test_bounciness_roves_firmness():
    made = bouncy.bounciness(rove=0.2)
    trials = [
        t for t, _ in observed(made.designed("P01", 1), 1, made.observer, stream(1, "person"))
    ]
    values = {t.stimuli[0].params["firmness"] for t in trials}
    assert len(values) == 120 and min(values) >= 1 / 1.2 and max(values) <= 1.2
    assert {
        t.stimuli[0].params["firmness"]
        for t, _ in observed(
            bouncy.bounciness().designed("P01", 1), 1, made.observer, stream(1, "person")
        )
    } == {1.0}
    facts = [bouncy.bounciness(rove).facts() for rove in (0.0, 0.2, 0.3)]
    assert len({f["key"] for f in facts}) == 3  # their sessions are not analysed as one
    assert facts[0]["design"].endswith(".bounciness.session")
    assert facts[1]["design"]["keywords"] == {"rove": 0.2}
