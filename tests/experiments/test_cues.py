"""Which cue explains the answers of the bounciness experiment: from a session's logs,
against numbers made by another route.
"""

import dataclasses
from math import pi

import numpy as np
import pytest
from refusals import refused
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtri

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
    present,
    read,
    recorded,
    run,
    spans,
)
from stimlib.experiments.papers.bounciness import PAIRS, analysis, bounciness, known
from stimlib.experiments.papers.springpots import CUES, Explained, cues_text, explained
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
    short = dataclasses.replace(
        bounciness(), design=design, timing=Timing(interval=2.0), cursor=None, familiarisation={}
    )

    def said(trial, rng):
        other = {"red": "green", "green": "red"}
        right = trial.correct["bouncier"]
        return Answer({"bouncier": other[right] if len(running.records) in WRONG else right})

    def moved(trial, folder):
        hand = {"y": sinusoid(*moves(len(running.records)))}
        return present(dataclasses.replace(short, motion=hand), trial, "offline", folder)

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
        t = np.arange(b) / 1000
        alpha = float(record.trial.stimuli[0].scene)
        y = sinusoid(amplitude, f)(t)[a:b]
        # which knows of no motion before its interval
        force = stimlib.render(viscoelastic(alpha), {"y": y}, 1000)["force"]
        rise = (1 - np.cos(pi * np.arange(20) / 20)) / 2
        force[:20] *= rise
        force[-20:] *= 1 - rise
        n = len(y)
        waves = np.stack(
            [np.cos(2 * pi * f * t[:n]), np.sin(2 * pi * f * t[:n]), np.ones(n)], axis=1
        )
        weight = np.sin(pi * (np.arange(n) + 0.5) / n)
        (yc, ys, _), (fc, fs, _) = (
            np.linalg.lstsq(waves * weight[:, None], u * weight)[0] for u in (y, force)
        )
        phase = np.angle((fc - 1j * fs) / (yc - 1j * ys))
        work = np.sum(np.maximum(force * np.gradient(y), 0))
        rows.append((phase, work, force @ y / (y @ y), record.answer.values["bouncier"] == "green"))
    return np.array(rows, float).T


def distance(cue, said):
    """Of a probit by an optimiser that knows no more than the likelihood."""
    x = (cue - cue.mean()) / cue.std()
    z = lambda p: p[0] + p[1] * x  # noqa: E731
    best = minimize(
        lambda p: -np.sum(log_ndtr(np.where(said, z(p), -z(p)))),
        (0.0, 0.0),
        method="BFGS",
        options={"gtol": 1e-9},
    )
    z = z(best.x)
    return z[z > 0].mean() - z[z <= 0].mean()


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
    for name, cue in (("phi", phase), ("k_fit", slope), ("W", np.array(table["W"]))):
        assert found.ratio[0.5, name][0] == pytest.approx(
            distance(cue, said.astype(bool)) / d, rel=2e-3
        ), name
    assert found.left_out == 0 and 2 * found.ratio[0.5, "W"][0] < found.ratio[0.5, "phi"][
        0
    ] == pytest.approx(1.0, abs=0.01), "what parts them is phase"


def test_the_table_has_the_three_largest_of_each_reference():
    ratio = {(a, name): (k / 10, 0.01, 2) for a in (0.0, 0.5) for k, name in enumerate(CUES)}
    ratio[0.5, "phi"] = (9.0, float("nan"), 1)
    ratio[0.0, "b_fit"] = (float("nan"), float("nan"), 0)
    rows = {
        line.split("  ")[0]: line
        for line in cues_text(Explained({0.0: 1.5, 0.5: 2.5}, ratio)).splitlines()
    }
    assert rows["mean d'"].split()[2:] == ["1.500", "2.500"] and len(rows) == 17
    assert rows["phi"].split() == ["phi", "0.400", "±0.010", "(2)", "9.000", "(1)*"]
    assert rows["b_fit"].split() == ["b_fit", "-", "1.400", "±0.010", "(2)*"]
    assert (
        rows["k_fit"].count("*") == 2
        and rows["k_I"].count("*") == 1
        and rows["v_mean"].count("*") == 1
    )


def test_what_has_no_cues_is_said(session, tmp_path):
    experiment, saved = session
    refused(UnknownName, "no signal 'x'; there are y, force", recorded, [saved], "x", "force")
    bare = dataclasses.replace(
        saved, records=[dataclasses.replace(r, displayed=[]) for r in saved.records]
    )
    refused(BadValue, "trial 1: no log of it was kept", recorded, [bare], "y", "force")
    refused(BadValue, "window", recorded, [saved], "y", "force", window="flat")
    refused(BadValue, "P01 has no session of", analysis, [bare])


def test_the_analysis_prints_both_tables(session):
    """Twelve sessions of the same four trials, each under the name of another
    condition: all references get the same numbers.
    """
    _, saved = session
    four = saved.records[:4]
    named = [
        [dataclasses.replace(r, trial=dataclasses.replace(r.trial, condition=c)) for r in four]
        for c in PAIRS
    ]
    heads = [saved.header | {"session": k} for k in range(1, 1 + len(named))]
    told = analysis(
        [
            dataclasses.replace(saved, records=records, header=header)
            for records, header in zip(named, heads, strict=True)
        ]
    ).splitlines()
    assert told[0].startswith("alpha = 0     JND") and told[6].startswith(
        "normalised distance over d', mean over sessions"
    )
    (row,) = [line.split() for line in told if line.startswith("k_fit")]
    assert (
        told[7].split() == ["alpha", "0", "0.25", "0.5", "0.75"]
        and row[1:4] == row[4:7]
        and len(row) == 13
        and row[3] == "(3)*"
    ), "four references, three sessions of each"


def test_a_trial_without_movement_is_left_out(session, monkeypatch):
    """The last two of them, one of each material: all numbers are those of the ten
    before.
    """
    _, saved = session
    real, calls = displayed, []

    def still(folder, record):
        calls.append(record.number)
        (signals,) = real(folder, record)
        return [signals | {"y": 0.0 * signals["y"]} if record.number > TRIALS - 2 else signals]

    monkeypatch.setattr("stimlib.experiments.cue_distances.displayed", still)
    found = explained(recorded([saved], "y", "force"))
    monkeypatch.undo()
    before = explained(
        recorded([dataclasses.replace(saved, records=saved.records[:-2])], "y", "force")
    )
    assert (found.d, found.ratio, found.left_out) == (before.d, before.ratio, 2) and len(
        calls
    ) == TRIALS
    assert cues_text(found).endswith(
        "trials left out, because the hand moved for less than two periods: 2"
    )
