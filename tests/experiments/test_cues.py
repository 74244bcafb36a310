"""Which cue explains the answers of the bounciness experiment: from a session's logs,
against numbers made by another route.
"""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from refusals import refused
from scipy.special import ndtri

import stimlib
from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    OneInterval,
    Session,
    Simulated,
    Timing,
    displayed,
    distances,
    present,
    read,
    recorded,
    run,
    spans,
)
from stimlib.experiments.papers.bounciness import PAIRS, analysis, bounciness, known
from stimlib.experiments.papers.springpots import cues_text, explained
from stimlib.motion.generators import sinusoid
from stimlib.scenes import viscoelastic

NAME = "0.5 and 0.65"
TRIALS, WRONG = 12, (3, 6)  # one of each material is taken for the other
TASK = OneInterval(
    NAME, "bouncier", {"green": known("P01", 9)["green"], "red": known("P01", 9)["red"]}
)


def moves(k):
    """Amplitude in m and frequency in Hz of the k-th trial: a hand that follows
    badly.
    """
    return 0.01 * (1 + 0.1 * np.sin(5.0 * k)), 1.5 * (1 + 0.1 * np.sin(3.0 * k))


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    design = ConstantStimuli(((TASK, "red"), (TASK, "green")), TRIALS // 2, shuffle="none")
    short = replace(
        bounciness(), design=design, timing=Timing(interval=2.0), cursor=None, familiarisation={}
    )

    def said(trial, rng):
        other = {"red": "green", "green": "red"}
        right = trial.correct["bouncier"]
        return Answer({"bouncier": other[right] if len(running.records) in WRONG else right})

    def moved(trial, folder):
        hand = {"y": sinusoid(*moves(len(running.records)))}
        return present(replace(short, motion=hand), trial, "offline", folder)

    with Session(short, data, "P01") as running:
        run(running, Simulated(running, said), moved)
    return short, read(running.folder)


def by_hand(experiment, saved):
    """Phase, work and slope of each trial, of the scene rendered anew; and the
    answers.
    """
    rows = []
    for k, record in enumerate(saved.records):
        amplitude, f = moves(k)
        ((a, b),) = spans(experiment, record.trial)
        y = sinusoid(amplitude, f)(np.arange(a, b) / 1000)
        # which knows of no motion before its interval
        scene = viscoelastic(float(record.trial.stimuli[0].scene))
        force = stimlib.render(scene, {"y": y}, 1000)["force"]
        rise = (1 - np.cos(pi * np.arange(20) / 20)) / 2
        force[:20] *= rise
        force[-20:] *= 1 - rise
        turn, n = np.exp(-2j * pi * f * np.arange(b - a) / 1000), b - a
        waves = np.stack([turn.real, -turn.imag, np.ones(n)], axis=1)
        weight = np.sin(pi * (np.arange(n) + 0.5) / n)
        of = [np.linalg.lstsq(waves * weight[:, None], u * weight)[0] for u in (y, force)]
        y_wave, force_wave = (c - 1j * s for c, s, _ in of)
        work = np.sum(np.maximum(force * np.gradient(y), 0))
        said = record.answer.values["bouncier"] == "green"
        rows.append((np.angle(force_wave / y_wave), work, force @ y / (y @ y), said))
    return np.array(rows, float).T


def test_the_ratios_are_those_of_the_scene_rendered_anew(session):
    phase, work, slope, said = by_hand(*session)
    table = recorded([session[1]], "y", "force")
    assert table["outcome"] == said.tolist() and len(table["phi"]) == TRIALS
    np.testing.assert_allclose(table["phi"], phase, rtol=2e-5)
    np.testing.assert_allclose(table["k_fit"], slope, rtol=1e-5)
    np.testing.assert_allclose(table["W"], work, rtol=2e-3)  # the trapezoid counts half of its ends
    found = explained(table)
    d = 2 * ndtri(5 / 6)  # five of six of each
    assert found.d == {0.5: pytest.approx(d)}
    for name in ("phi", "k_fit", "W"):
        (one,) = distances({name: table[name]}, said)
        assert found.ratio[0.5, name][0] == pytest.approx(one.value / d)
    assert found.left_out == 0 and found.ratio[0.5, "phi"][0] == pytest.approx(1.0, abs=0.01)
    assert 2 * found.ratio[0.5, "W"][0] < found.ratio[0.5, "phi"][0], "what parts them is phase"


def test_what_has_no_cues_is_said(session):
    saved = session[1]
    bare = replace(saved, records=[replace(r, displayed=[]) for r in saved.records])
    for call, why in (
        (lambda: recorded([saved], "x", "force"), "no signal 'x'; there are y, force"),
        (lambda: recorded([bare], "y", "force"), "trial 1: no log"),
        (lambda: recorded([saved], "y", "force", window="flat"), "window"),
        (lambda: analysis([bare]), "P01 has no session"),
    ):
        refused((BadValue, UnknownName), why, call)


def test_the_analysis_prints_both_tables(session):
    """Twelve sessions of the same four trials, each under the name of another
    condition: all references get the same numbers.
    """
    saved = session[1]
    named = [
        replace(
            saved,
            records=[replace(r, trial=replace(r.trial, condition=c)) for r in saved.records[:4]],
            header=saved.header | {"session": k},
        )
        for k, c in enumerate(PAIRS, start=1)
    ]
    told = analysis(named).splitlines()
    assert told[0].startswith("alpha = 0     JND") and told[6].startswith("normalised distance")
    assert told[7].split() == ["alpha", "0", "0.25", "0.5", "0.75"]
    (row,) = [line.split() for line in told if line.startswith("k_fit")]
    assert row[1:4] == row[4:7] and len(row) == 13, "four references"
    assert row[3] == "(3)*", "three sessions of each"


def test_a_trial_without_movement_is_left_out(session, monkeypatch):
    """The last two of them, one of each material: all numbers are those of the ten
    before.
    """
    saved = session[1]

    def still(folder, record):
        (signals,) = displayed(folder, record)
        return [signals | {"y": 0.0 * signals["y"]} if record.number > TRIALS - 2 else signals]

    before = explained(recorded([replace(saved, records=saved.records[:-2])], "y", "force"))
    monkeypatch.setattr("stimlib.experiments.cue_distances.displayed", still)
    found = explained(recorded([saved], "y", "force"))
    assert (found.d, found.ratio, found.left_out) == (before.d, before.ratio, 2)
    assert cues_text(found).endswith("less than two periods: 2")
