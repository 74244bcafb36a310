"""The firmness experiment of Çaldıran's thesis, chapter 4, from end to end; roving."""

import dataclasses
from math import isnan

import numpy as np
import pytest
from experiments.some import simulate, trials_of
from refusals import refused
from scipy.stats import norm, t as student, ttest_rel

import stimlib
from stimlib.errors import BadValue
from stimlib.experiments import (
    ConstantStimuli,
    OneInterval,
    Roved,
    Stimulus,
    Timing,
    Trial,
    TwoInterval,
    check_graeco_latin,
    columns,
    sessions,
    stream,
    write_report,
)
from stimlib.experiments.papers import bounciness as bouncy, firmness as firm
from stimlib.experiments.papers.firmness import PAIRS, firmness, pair_of, person, weber_fractions
from stimlib.experiments.papers.springpots import (
    by_cues,
    cues_of_stimulus,
    explained,
    touched,
    varying_hand,
)
from stimlib.scenes import viscoelastic


def test_sessions_and_their_order():
    square = [[("αβγδε".index(g), "ABCDE".index(k)) for g, k in row.split()] for row in firm.SQUARE]
    check_graeco_latin(square)
    assert list(firm.REFERENCES.values()) == [0, 0.25, 0.5, 0.75, 1]  # section 4.1
    people = [[pair_of(f"P0{n}", k) for k in range(1, 16)] for n in range(1, 6)]
    assert all(sorted(pairs) == sorted(PAIRS) for pairs in people)
    steps = [[pair.split("+")[1] for pair in pairs[:3]] for pairs in people]
    assert ["30 %", "10 %", "20 %"] in steps and ["20 %", "10 %", "30 %"] in steps  # C, E
    for session in (0, 16):
        refused(BadValue, "there are 15", pair_of, "P01", session)
    experiment = firmness()
    trials = trials_of(experiment, person(lambda alpha, firmness: 300 * firmness), "P01", 3)
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
    pair = "0.5 and +20 %"
    red, green = firm.pair_stimuli(pair)
    assert (red.params["firmness"], green.params["firmness"]) == (1.0, 1.2)
    of = [cues_of_stimulus(0.5, s.params["firmness"]) for s in (red, green)]
    errors = {"k_S": of[1].k_S - of[0].k_S, "W": 2 * (of[1].W - of[0].W)}
    rng, observer = stream(1, "person"), by_cues("firmer", firm.pair_stimuli, errors)
    alarms, hits = (
        norm.ppf(np.mean([observer(t, rng).values["firmer"] == "green" for _ in range(4000)]))
        for t in (Trial(pair, (s,), ("firmer",)) for s in (red, green))
    )
    assert hits - alarms == pytest.approx(np.sqrt(1.25), abs=0.12)
    # the criterion is in the middle: 0.03 is a standard error
    assert hits + alarms == pytest.approx(0.0, abs=0.12)
    for wrong in ({"weight": 1.0}, {"W": 0.0}, {"W": np.inf}):
        refused(BadValue, "by_cues", by_cues, "firmer", firm.pair_stimuli, wrong)


@pytest.mark.parametrize("alpha, rel", [(0.0, 1e-12), (0.5, 0.01), (1.0, 0.01)])
def test_all_references_are_equally_strong_at_one_hertz(alpha, rel):
    """Section 4.1: chi_0 = 0.3 N/mm, eq. (4.1)."""
    assert firm.strength(alpha, 1.0) == pytest.approx(300, rel=rel)
    assert firm.strength(alpha, 1.2) == pytest.approx(1.2 * firm.strength(alpha, 1.0))


def test_the_weber_fractions_are_those_of_the_observers():
    """Of two people who judge firmness with an error of 0.15."""
    rng, people = np.random.default_rng(3), ("P01", "P02")
    rows = [
        (who, condition, level, float(1 + level * step + 0.15 * rng.normal() > 1 + step / 2))
        for who in people
        for condition, (_, step) in PAIRS.items()
        for level in 50 * [0.0, 1.0]
    ]
    names = "participant", "condition", "level", "outcome"
    answers = dict(zip(names, zip(*rows, strict=True), strict=True))
    found = weber_fractions(answers)
    assert list(found.group) == [0, 0.25, 0.5, 0.75, 1]
    for a, interval in found.group.items():
        slopes = [np.mean(np.divide(found.d[who, a], firm.STEPS)) for who in people]
        mean, half = np.mean(slopes), student.ppf(0.975, 1) * np.std(slopes, ddof=1) / 2**0.5
        assert 1 / mean == pytest.approx(0.15, rel=0.25)
        high = 1 / (mean - half) if half < mean else np.inf
        assert interval == pytest.approx((1 / mean, 1 / (mean + half), high))
        assert found.people["P01", a] == pytest.approx(1 / slopes[0])
    assert found.effect.df == (4, 4) and 0 < found.effect.p < 1
    assert "thesis: F(4, 16), p = 0.3981" in firm.text(found)
    one, other = ([found.people[who, a] for who in people] for a in (0.25, 1.0))
    assert found.pairs[0.25, 1.0] == pytest.approx(min(1.0, 10 * ttest_rel(one, other).pvalue))
    assert len(found.pairs) == firm.text(found).count("thesis: p > .5") == 10
    alone = weber_fractions({k: v[: len(v) // 2] for k, v in answers.items()})
    assert (
        alone.effect is None
        and not alone.pairs
        and isnan(alone.group[0.5][1])
        and "95 %" not in firm.text(alone)
    )
    guessed = weber_fractions(answers | {"outcome": [1.0] * len(rows)})  # one key, always
    assert {interval[1:] for interval in guessed.group.values()} == {(np.inf, np.inf)}
    for sure in ((0.0, 0.25), firm.REFERENCES.values()):  # nobody errs: no differences
        keep = [PAIRS[name][0] in sure for name in answers["condition"]]
        said = np.where(keep, answers["level"], answers["outcome"]).tolist()
        felt = weber_fractions(answers | {"outcome": said})
        assert (felt.effect is None) == (len(sure) == 5) and isnan(felt.pairs[0.0, 0.25])
        assert sum(map(isnan, felt.pairs.values())) == len(sure) * (len(sure) - 1) / 2
    late = {name: column[100:] for name, column in answers.items()}
    refused(BadValue, "P01 has no session of .*all 15", weber_fractions, late)


def test_from_the_session_to_the_report(tmp_path):
    """Fifteen short sessions, whose observer judges the rendered force."""

    def short(participant, session):
        pair = pair_of(participant, session)
        task = OneInterval(pair, "firmer", firm.known(participant, session))
        return ConstantStimuli(((task, "red"), (task, "green")))

    timing = Timing(interval=2.0, gap=0.0, before=0.0)
    made = dataclasses.replace(firmness(), design=short, timing=timing)
    for number in range(1, 16):
        simulate(tmp_path, made, person(weber=0.01), "offline", session=number)
    saved = sessions("firmness", tmp_path)
    told = firm.analysis(saved)
    assert told.count("Weber fraction") == 5 and "k_S" in told and "normalised distance" in told
    right = [r.answer.values["firmer"] == r.trial.correct["firmer"] for s in saved for r in s.data]
    assert len(right) == 30 and all(right)
    write_report(tmp_path / "report.html", "Firmness", "One person.", columns(saved))
    assert "0.25 and +10 %" in (tmp_path / "report.html").read_text("utf-8")


def test_no_ratio_is_above_1_if_people_go_by_firmness_and_their_own_cue_is_if_not():
    """Figure 4.3 with a hand that varies; a cue with one value for each material (a
    spring's stiffness, a dashpot's damping) has d' itself.
    """
    pairs = ["0 and +20 %", "0.5 and +20 %", "1 and +20 %"]

    def ratios(felt):
        found = explained(varying_hand(pairs, firm.pair_stimuli, felt, 0.12, trials=80)).ratio
        return {key: ratio for key, (ratio, _, n) in found.items() if n}

    by_firmness = ratios(lambda stimulus, cues: stimulus.params["firmness"])
    assert max(by_firmness.values()) == pytest.approx(1.0, abs=1e-3)
    assert by_firmness[0.0, "k_S"] == pytest.approx(1.0, abs=1e-6) != by_firmness[0.5, "k_S"]
    assert all(by_firmness[a, "f_max"] < 0.6 for a in (0.0, 0.5, 1.0))
    by_force = ratios(lambda stimulus, cues: cues.f_max)
    assert all(by_force[a, "f_max"] > 1.6 for a in (0.0, 0.5, 1.0))
    refused(BadValue, "vary = 0.4", varying_hand, pairs, firm.pair_stimuli, len, 0.1, 0.4)


@pytest.mark.parametrize("make", [firm.firmness, bouncy.bounciness])
def test_a_trial_can_begin_after_half_a_second_of_contact(make):
    assert not make().timing.self_paced
    timing = make(starts=touched()).timing
    assert timing.self_paced and (timing.interval, timing.wait) == (3.0, 10.0)
    y = 0.01 * (np.arange(2000) >= 500)
    begins = stimlib.compile(stimlib.Scene({"begins": timing.starts}), 1000).process(y[None])[0]
    assert np.flatnonzero(begins >= 0.5)[0] == pytest.approx(1000, abs=2)
    printed = make(as_printed=True)
    assert printed.timing.starts is not None and printed.timing.wait == 10.0
    assert printed.scenes["0.5"] == viscoelastic(0.5, scheme="gl-downsampled")
    hand = printed.motion["y"](np.arange(2000) / 1000)  # touches from the beginning
    begins = stimlib.compile(stimlib.Scene({"begins": timing.starts}), 1000).process(hand[None])[0]
    assert np.flatnonzero(begins >= 0.5)[0] == pytest.approx(500, abs=2)


def test_a_roved_parameter_is_no_cue():
    pair = {n: Stimulus(n, {"firmness": 2.0}) for n in ("red", "green")}
    plain = OneInterval("0.25", "bouncier", pair)
    task = Roved(plain, "firmness", 1.5)
    values = [task.trial("red", 1, n).stimuli[0].params["firmness"] for n in range(400)]
    logs = np.log(np.divide(values, 2)) / np.log(1.5)
    assert np.abs(logs).max() <= 1 + 1e-12 and np.mean(logs) == pytest.approx(0, abs=0.1)
    assert np.std(logs) == pytest.approx(3**-0.5, rel=0.1)
    trial, same = task.trial("green", 1, 7), plain.trial("green", 1, 7)
    assert dataclasses.replace(trial, stimuli=same.stimuli) == same
    assert trial.stimuli[0].seed == same.stimuli[0].seed
    two = TwoInterval("c", "q", Stimulus("a", {"A": 1.0, "k": 1.0}), Stimulus("a", {"A": 1.0}), "k")
    first, second = (s.params for s in Roved(two, "A", 2.0).trial(3.0, 1, 0).stimuli)
    assert first["A"] != second["A"] and {first["k"], second["k"]} == {1.0, 3.0}
    refused(BadValue, "does not set 'gain'", Roved(plain, "gain", 2.0).trial, "red", 1, 0)
    for factor in (1.0, 0.5, float("inf"), float("nan")):
        refused(BadValue, "above 1|finite number", Roved, plain, "firmness", factor)


def test_bounciness_roves_firmness():
    plain, made, more = (bouncy.bounciness(rove) for rove in (0.0, 0.2, 0.3))
    roved, steady = (
        {t.stimuli[0].params["firmness"] for t in trials_of(experiment, made.observer, "P01")}
        for experiment in (made, plain)
    )
    assert len(roved) == 120 and min(roved) >= 1 / 1.2 and max(roved) <= 1.2 and steady == {1.0}
    facts = [experiment.facts() for experiment in (plain, made, more)]
    assert len({f["key"] for f in facts}) == 3  # their sessions are not analysed as one
    assert facts[0]["design"].endswith(".bounciness.session")
    assert facts[1]["design"]["keywords"] == {"rove": 0.2}
