"""The papers' experiments, with few trials: what is shown, how it is ordered, and the
numbers of their tables.
"""

import dataclasses
from collections import Counter
from itertools import combinations
from math import dist, pi, radians
from types import SimpleNamespace

import numpy as np
import pytest
from experiments.some import simulate as answered, trials_of
from laws import STRESS
from refusals import refused
from typer.testing import CliRunner

import stimlib
from stimlib.cli import app
from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    ConstantStimuli,
    Listener,
    PsychometricObserver,
    Session,
    Simulated,
    Stimulus,
    Timing,
    check_graeco_latin,
    columns,
    grouped,
    integrated,
    paired,
    present,
    run,
    sessions,
    simulate,
    stream,
)
from stimlib.experiments.papers import (
    nodule_places as place,
    nodule_sizes as size,
    nodules as nod,
    roughness as rough,
)
from stimlib.experiments.papers.bounciness import (
    PAIRS,
    REFERENCES,
    SQUARE,
    bounciness,
    jnds,
    pair_of,
    person as bouncy,
    phase,
    text as bounciness_text,
)
from stimlib.experiments.papers.ugrip import (
    K0,
    SPREAD,
    SQUEEZES,
    comparisons,
    feels,
    fits,
    integrates,
    text,
    ugrip,
)
from stimlib.motion import constant_speed
from stimlib.scenes import soft_surface, squeeze, viscoelastic
from stimlib.soft import block, buried, sides


def ideal(alpha):
    """The phase of a springpot that has forgotten its beginning."""
    return alpha * pi / 2


# UGrip --------------------------------------------------------------------------------
def test_ugrip_has_the_papers_staircases_one_pair_for_each_condition():
    paper, person = ugrip(), PsychometricObserver(K0, 0.1, log=True)
    trials, other = (trials_of(ugrip(reversals=2), person, "P01", seed=seed) for seed in (5, 7))
    conditions, of_other = ([*dict.fromkeys(t.condition for t in v)] for v in (trials, other))
    assert sorted(conditions) == [
        f"{f}, {v}" for f in ("one finger", "two fingers") for v in ("silent", "vibrating")
    ]
    assert conditions != of_other, "another order for another person"
    assert [t.pause for t in trials if t.pause] == [120.0] * 3, "two minutes between pairs"
    first = {t.track: t.level for t in reversed(trials)}
    assert len(first) == 8, "two of each condition"
    for track, level in first.items():
        low, high = (2 * K0, 2.5 * K0) if track.endswith("high") else (K0 / 2.5, K0 / 2)
        assert low <= level <= high
    for t in trials:
        paper.check(t)
        by = {s.name: s.params for s in t.stimuli}
        assert by["standard"] == {"k": 2000.0, "A": 0.0}
        assert by["comparison"]["A"] == (3.4 if "vibrating" in t.condition else 0.0)
    for stairs in (s for pair in paper.design.parts.values() for s in pair.tracks.values()):
        told = stairs.steps, stairs.reversals, stairs.bounds, stairs.up, stairs.down
        assert told == ((12.0,) * 5 + (3.0,), 20, (250.0, 16000.0), 1, 1)
        assert stairs.task.asks_less


def test_ugrip_finds_what_its_observers_feel():
    """Of parameters, with the paper's points of subjective equality and slopes; the
    tests are those within people.
    """
    names = [f"{f} {v}" for f in ("one finger,", "two fingers,") for v in ("silent", "vibrating")]
    pse = dict.fromkeys(names, 2020.0) | {"one finger, vibrating": 2340.0}
    sigma = {name: 1 / 7.9 if "one" in name else 1 / 17.5 for name in names}
    people = 8 if STRESS else 4
    answers = simulate(ugrip(), PsychometricObserver(pse, sigma, log=True), people, seed=2)
    found = comparisons(answers)
    compared = [(t.what, t.a, t.b) for t in found][:4]
    assert compared[:3] == [(what, *names[:2]) for what in ("pse", "slope", "intercept")]
    assert compared[3] == ("pse", *names[2:])
    one, two = ((found[k].mean_a, found[k].mean_b) for k in (0, 3))
    assert one == pytest.approx((2.02, 2.34), abs=0.15)
    assert two == pytest.approx((2.02, 2.02), abs=0.07)
    assert found[7].mean_b > 1.5 * found[7].mean_a > 9.0, "two fingers feel finer differences"
    over = -found[1].mean_a * np.log10(2.02)  # k in N/mm
    assert found[2].mean_a == pytest.approx(over, rel=0.3)
    # somebody who has felt one finger alone, so far; a step has no slope
    slopes = {key: fit.slope for key, fit in fits(answers, interval="none").items()}
    clear = (w for w in answers["participant"] if all(np.isfinite(slopes[w, c]) for c in names))
    begun = next(clear)
    pairs = zip(answers["participant"], answers["condition"], strict=True)
    part = {"condition": [c if who != begun or c.startswith("one") else "" for who, c in pairs]}
    counted = [t.people for t in comparisons(answers | part)]
    assert counted == [t.people for t in found[:3]] + [t.people - 1 for t in found[3:]]
    none = {k: v[:9] for k, v in answers.items()} | {"condition": [names[0]] * 9}
    refused(BadValue, "paired: give a row of at least 2 values", comparisons, none)
    line = text(found[:1])
    assert line.startswith("pse") and f"F(1, {people - 1})" in line
    assert line.endswith("paper: 2.02, 2.34: F > 5.6, p < .03")


@pytest.mark.parametrize(("softer", "felt"), [(0.0, 2340.0), (35.1, 2000.0)])
def test_one_finger_feels_a_vibrating_object_of_2340_as_a_silent_one_of_2000(softer, felt):
    """The paper's point of subjective equality; every 3 s of the rendering count."""
    one = Listener({"one finger": squeeze(fingers=1)}, SQUEEZES, 8000.0, 3.0, feels(softer), 0.1)
    assert np.mean(
        [one.figure_of(Stimulus("one finger", {"k": 2340.0, "A": 3.4}, seed)) for seed in range(4)]
    ) == pytest.approx(felt, rel=0.01)
    assert one.figure_of(Stimulus("one finger", {"k": 1500.0, "A": 0.0})) == pytest.approx(1500.0)


# Bounciness ---------------------------------------------------------------------------


def test_people_who_combine_cues_have_the_shift_of_maximum_likelihood():
    """With two fingers vibration counts less, as the paper's discussion predicts."""
    error, shift, people = 1 / 7.9, 0.128, 12 if STRESS else 2
    found = comparisons(simulate(ugrip(), integrates(error, shift), people, seed=1))
    for pse, spread in zip((found[0], found[3]), SPREAD.values(), strict=True):
        weight = spread**2 / (spread**2 + error**2)
        assert np.log10(pse.mean_b / pse.mean_a) == pytest.approx(weight * shift, abs=0.02), pse


def test_cues_are_weighed_by_their_reliability():
    """Against the least squares of a row for each cue."""
    values, sds = np.array([3.0, -1.0, 2.5]), np.array([0.3, 2.0, 1e-3])
    found = integrated(values, sds)
    (mean, sum_of_weights) = np.average(values, weights=sds**-2.0, returned=True)
    assert (found.value, found.sd) == pytest.approx((mean, sum_of_weights**-0.5), rel=1e-12)
    assert sum(found.weights) == pytest.approx(1.0) and integrated([1.0], [1e-300]).sd == 1e-300
    for says, *given in (
        *(("one above 0 for each cue", [1.0], v) for v in ([], [0.0], [1.0, 2.0], [np.inf])),
        ("one above 0 for each cue", [[1.0]], [[1.0]]),
        (r"values\[1\] = nan must be finite", [1.0, np.nan], [1.0, 1.0]),
    ):
        refused(BadValue, says, integrated, *given)


def test_bounciness_has_the_thesis_square_and_its_sessions():
    pairs = [row.split() for row in SQUARE]
    check_graeco_latin([[("βγζθ".index(a), "ABCD".index(b)) for a, b in row] for row in pairs])
    people = {code: [pair_of(code, n) for n in range(1, 13)] for code in ("P01", "P02", "P03")}
    assert all(sorted(of) == sorted(PAIRS) for of in people.values()), "each pair once"
    assert people["P03"][3:6] == [f"0.75 and {b}" for b in ("0.8", "0.85", "0.9")], "theta A"
    refused(BadValue, "there are 12", pair_of, "P01", 13)
    experiment = bounciness()
    trials = trials_of(experiment, bouncy(ideal), "P02", 3)
    assert [t.training for t in trials] == 2 * (10 * [True] + 50 * [False])
    assert [n for n, t in enumerate(trials) if t.pause] == [60]
    assert Counter(t.stimuli[0].scene for t in trials if not t.training) == {"0.25": 50, "0.3": 50}
    assert {t.correct["bouncier"] for t in trials if t.stimuli[0].scene == "0.25"} == {"red"}
    assert experiment.familiar("P02", 3)["green"].scene == "0.3"
    scenes = experiment.scenes
    assert scenes["0.25"].hash == viscoelastic(alpha=0.25).hash != scenes["0.3"].hash
    assert phase(0.25) == pytest.approx(ideal(0.25), rel=0.02), "of the rendered force"


def test_bounciness_finds_the_jnds_that_its_observer_has():
    answers = simulate(bounciness(), bouncy(ideal), ["P01"], seed=3)
    found = jnds(answers)
    assert list(found.jnd) == list(REFERENCES.values())
    assert list(found.jnd.values()) == pytest.approx([0.03, 0.0351, 0.0714, 0.1077], rel=0.35)
    a, b, c = found.d["P01", 0.5]
    assert found.jnd[0.5] == pytest.approx(3 / (a / 0.05 + b / 0.1 + c / 0.15)) and a < b < c
    at = found.line.slope * 0.25 + found.line.intercept
    assert at == pytest.approx(found.jnd[0.25], abs=0.03)
    guessed = jnds(answers | {"outcome": [1.0] * len(answers["level"])})  # one key, always
    assert guessed.line is None and np.isnan(list(guessed.jnd.values())).all()
    assert bounciness_text(guessed).count("JND nan") == 4
    late = {name: column[120:] for name, column in answers.items()}
    refused(BadValue, "P01 has no session of", jnds, late)


@pytest.fixture(scope="module", autouse=True)
def formulas():
    """The RMS as table 6.1 has it, and a swing that needs no rendering."""
    with pytest.MonkeyPatch.context() as patch:
        s = rough.STIMULI
        printed = {k: rough.PRINTED[v.duty, v.amplitude, v.waveform][0] for k, v in s.items()}
        kept = rough.rms, rough.swing
        patch.setattr(rough, "rms", printed.__getitem__)
        patch.setattr(rough, "swing", bumpiness_of)
        yield SimpleNamespace(rms=kept[0], swing=kept[1])


# Roughness ----------------------------------------------------------------------------


def days(made):
    """The trials of both days of a person, and of the second day of another."""
    who = ("P01", 1), ("P01", 2), ("P02", 2)
    return [trials_of(made, rough.person(), *day, made.seeded(*day)) for day in who]


def test_roughness_shows_all_stimuli_twice_a_day_in_an_order_of_ones_own():
    experiment = rough.roughness()
    first, second, other = days(experiment)
    assert [t.training for t in first] == 48 * [True] + 162 * [False]
    for a in (48, 129):  # a set is each stimulus once
        assert sorted(t.condition for t in first[a : a + 81]) == sorted(rough.STIMULI)
    orders = [[t.condition for t in trials] for trials in (first[48:], second, other)]
    assert len(second) == 162 and orders[0] != orders[1] != orders[2]
    shown = second[orders[1].index("square, 18 bumps, duty 0.2, 7.5 V")].stimuli[0]
    assert (shown.scene, dict(shown.params)) == ("square 18", {"duty": 0.2, "A": 7.5})
    assert (experiment.replays, experiment.timing.interval, experiment.sessions) == (1, 15.0, 2)
    assert [(q.name, q.choices, q.most) for q in experiment.questions] == [
        ("roughness", ("smooth", "rough"), 7),
        ("bumpiness", ("flat", "bumpy"), 7),
    ]


@pytest.fixture(scope="module")
def rated(formulas):
    """Answers of three people who judge by formulas, their roughness and bumpiness; and
    the mean of each question, person and stimulus.
    """
    people = {f"P{n}": rough.person(stream(n, "person")) for n in (1, 2, 3)}
    answers, means = simulate(rough.roughness(), people, list(people), seed=1), {}
    for question in ("roughness", "bumpiness"):
        rows = grouped(answers, ("participant", "condition"))
        means[question] = {k: np.mean(v[question]) for k, v in rows.items()}
    return answers, rough.ratings(answers), rough.ratings(answers, "bumpiness"), means


def of(means, *parts, who=""):
    """Those of the stimuli whose names have these parts."""
    return [v for (p, c), v in means.items() if who in p and all(w in f"{c}," for w in parts)]


def test_roughness_can_show_all_stimuli_in_one_order_to_all():
    of_days = days(rough.roughness(order="same"))
    first, *orders = ([trial.condition for trial in trials] for trials in of_days)
    assert orders[0] == orders[1] != first[48:]
    assert sorted(orders[0][:81]) == sorted(orders[0][81:]) == sorted(rough.STIMULI)
    assert orders[0][:81] != orders[0][81:] and len(first) == 48 + 162


@pytest.mark.parametrize("mode", ["cursor", "deformation", "combined", "vibration"])
def test_sizes_can_be_told_by_other_modes(mode):
    experiment = size.nodule_sizes(mode, as_printed=mode == "cursor")
    (scene, *_) = experiment.scenes.values()
    assert set(experiment.safety.full_scale) == set(scene.outputs)
    assert ("vibration" in scene.outputs) == (mode == "vibration")
    assert scene == soft_surface(mode, S=block(0.0), frames=mode == "cursor")


def test_as_printed_nodules_follow_the_equations_once_a_frame():
    name = "cursor, A1 and C1"
    fast, slow = (nod.nodules(as_printed=printed).scenes[name] for printed in (False, True))
    letter = soft_surface("cursor", device="mouse", S=sides("A1", "C1"), frames=True)
    way = {"x": constant_speed(0.1, 0.12), "y": lambda t: 0.06 + 0 * t}
    y, z, want = (stimlib.render(s, way, 1000, 1.0).y[0] for s in (fast, slow, letter))
    assert (z == want).all() and np.abs(y - z).max() > 1e-4
    (surface, *_) = place.nodule_places(as_printed=True).scenes.values()
    assert surface == soft_surface("combined", S=block(radians(30)), frames=True)


def test_roughness_gives_the_thesis_tables_and_law(rated):
    answers, found, _, means = rated
    assert found.law.line.intercept == pytest.approx(3.92 + 0.05, abs=0.6)
    assert found.law.line.slope == pytest.approx(2.25, abs=0.3) and found.pearson > 0.8
    assert list(found.mean)[:2] == [(0.5, 0.2, "sine"), (0.5, 0.2, "square")]
    assert found.rms[7.5, 0.8, "square"] == 3.35 == max(found.rms.values())
    rows = of(means["roughness"], "square", "duty 0.8, 7.5 V")
    assert len(rows) == 3 * 3 and found.mean[7.5, 0.8, "square"] == pytest.approx(np.mean(rows))
    names = ["waveform", "bumps", "duty", "amplitude"]
    assert [e.name for e in found.effects[:4]] == names and len(found.effects) == 15
    assert min(found.effects[:4], key=lambda e: e.p).name == "amplitude"
    by_volt = (
        [np.mean(of(means["roughness"], f", {volt} V,", who=f"P{n}")) for n in (1, 2, 3)]
        for volt in ("4", "7.5")
    )
    p = 3 * paired(*by_volt).p  # Bonferroni
    assert found.pairs["amplitude", "4.0", "7.5"] == pytest.approx(p)
    assert "4     0.5   square    1.41 (1.41)" in rough.text(found)
    few = {name: column[:80] for name, column in answers.items()}
    refused(BadValue, "P1 has not rated", rough.ratings, few)


def bumpiness_of(name):
    """The swing of slow bumps: A times the standard deviation of the envelope."""
    s, d = rough.STIMULI[name], rough.STIMULI[name].duty
    u = (np.arange(2000) + 0.5) / 2000
    cosine = np.cos(2 * np.pi * (u - d / 2)) - np.cos(np.pi * d)
    e = {"square": 1.0, "sawtooth": u / d, "sine": cosine / (1 - np.cos(np.pi * d))}
    return s.amplitude * float(np.std(np.where(u < d, e[s.waveform], 0.0)))


@pytest.mark.parametrize("waveform", ["sine", "square", "sawtooth"])
def test_the_swing_is_that_of_the_envelope(waveform, formulas):
    """Of two bumps on 0.1 m, which pass slowly; 18 of them are hardly counted."""
    name = f"{waveform}, 2 bumps, duty 0.5, 7.5 V"
    assert formulas.swing(name) == pytest.approx(bumpiness_of(name), rel=0.15)
    # the line of 18 a second counts 1/(1 + 1.8^2), and turning adds slower ones
    if waveform == "square":
        fast = formulas.swing("square, 18 bumps, duty 0.5, 4 V")
        assert fast == pytest.approx(4 * 2 / np.pi / 2**0.5 / (1 + 1.8**2), rel=0.2)
        two = [formulas.swing(f"square, 2 bumps, duty {d}, 4 V") for d in (0.2, 0.8)]
        assert two[0] == pytest.approx(two[1], rel=0.01)  # d (1 - d)
    refused(UnknownName, "no stimulus 'x'", formulas.swing, "x")


def test_bumpiness_is_a_parabola_over_the_duty_cycle(rated):
    """The finding of the thesis, in the analysis of the second question, whose numbers
    are recomputed here from the answers.
    """
    _, roughness, bumpy, means = rated
    means = means["bumpiness"]
    assert bumpy.middles["duty"].value > 2 and bumpy.middles["duty"].p < 0.1
    assert roughness.middles["duty"].value < bumpy.middles["duty"].value
    for part, key in (
        ("duty 0.2,", ("duty", "0.2")),
        ("duty 0.5,", ("duty", "0.5")),
        ("18 bumps", ("bumps", "18")),
        ("sine", ("waveform", "sine")),
        (" 7.5 V", ("amplitude", "7.5")),
    ):
        five = np.percentile(of(means, part), [0, 25, 50, 75, 100])
        assert bumpy.boxes[key] == pytest.approx(five)
    assert len(bumpy.by_bumps) == 27
    for (w, a, n), found in bumpy.by_bumps.items():
        assert found == pytest.approx(np.mean(of(means, f"{w}, {n} bumps", f", {a:g} V")))
    by_duty = np.array(
        [
            [np.mean(of(means, f"duty {d},", who=f"P{n}")) for n in (1, 2, 3)]
            for d in (0.2, 0.5, 0.8)
        ]
    )
    t = paired(by_duty[1], (by_duty[0] + by_duty[2]) / 2)
    assert bumpy.middles["duty"].value == pytest.approx(t.value)
    told = rough.text(bumpy, "bumpiness")
    assert "a parabola over the duty cycle" in told and "(printed)  bumpiness\n" in told
    assert told.count("\nduty ") == 2 * 3 and "bumpiness at 2, 6, 18 bumps" in told


def test_roughness_from_the_session_to_the_tables(tmp_path):
    """Two people, each stimulus once and shortly, of which a few are played; the
    command line analyses both scales.
    """
    made = dataclasses.replace(
        rough.roughness(),
        design=ConstantStimuli(rough.day("P01", 2).parts["sets"].items, shuffle="each"),
        timing=Timing(interval=0.05, gap=0.0, before=0.0),
        sessions=1,
    )

    def shown(trial, folder):
        return present(made, trial, "offline", folder) if session.number < 4 else {}

    for code in ("P01", "P02"):
        with Session(made, tmp_path, code, 1) as session:
            run(session, Simulated(session, rough.person(stream(3, code))), shown)
    done = CliRunner().invoke(app, ["experiment", "analyse", "roughness", "--data", str(tmp_path)])
    rated, bumpy = done.output.split("\n\n")[-2:]
    assert "roughness (printed)" in rated and "1.41 (1.41)" in rated
    assert "thesis, bumpiness and duty: is a parabola" in bumpy and "bumpiness = " in bumpy
    saved = sessions("roughness", tmp_path)
    assert rough.analysis(saved) in done.output
    assert rough.text(rough.ratings(columns(saved), "bumpiness"), "bumpiness") == bumpy.strip()


def test_the_rendered_rms_is_the_formulas(formulas):
    """A sqrt(d)/2, and A sqrt(d/12) for the sawtooth, which the thesis prints up to 15
    % lower.
    """
    for waveform, rms in (("square", 4 * 0.2**0.5 / 2), ("sawtooth", 4 * (0.2 / 12) ** 0.5)):
        assert formulas.rms(f"{waveform}, 6 bumps, duty 0.2, 4 V") == pytest.approx(rms, rel=0.01)


# Nodules ------------------------------------------------------------------------------


def test_nodules_shows_each_surface_once_and_begins_with_another_technique():
    experiment = nod.nodules()
    firsts, scenes = [], experiment.scenes
    for code in ("P01", "P02", "P03"):
        trials = trials_of(experiment, nod.person, code)
        assert sorted(t.condition for t in trials) == sorted(nod.SURFACES) and len(trials) == 39
        techniques = [nod.SURFACES[t.condition][0] for t in trials]
        assert techniques == sorted(techniques, key=techniques.index), "one after another"
        firsts.append(techniques[0])
        for t in trials:
            assert t.stimuli[0].scene == t.condition and t.correct == nod.right_answers(t.condition)
    assert firsts == ["deformation", "cursor", "combined"]
    sides = Counter(v for t in trials if "cursor" in t.condition for v in t.correct.values())
    assert sides == {"nodule": 18, "none": 8}
    assert nod.right_answers("combined, none and C1") == {"left": "none", "right": "nodule"}
    assert scenes["combined, none and none"].hash != scenes["combined, A1 and none"].hash
    assert list(scenes["cursor, A1 and B1"].outputs) == ["x", "y", "depth"]
    # of 14 people; 14.3 % found two techniques the same, 7.1 % said one was quick
    printed = {"combined": 71.4, "deformation": 7.1, "cursor": 0.0}
    assert {mode: round(100 * n / 14, 1) for mode, n in nod.PREFERRED.items()} == printed


def test_nodules_gives_the_papers_rates_of_the_papers_counts():
    """Answers with these counts: the rates are the printed ones, the intervals those of
    252, 112 and 364 sides.
    """
    names = [*nod.SURFACES] * 14
    people = [f"P{k // len(nod.SURFACES)}" for k in range(len(names))]
    answers = {"participant": people, "condition": names, "left": [], "right": []}
    left = {
        mode: {"nodule": hits, "none": rejections}
        for mode, (hits, rejections) in nod.COUNTS.items()
    }
    for name in names:
        for side, under in nod.right_answers(name).items():
            of_mode = left[nod.SURFACES[name][0]]
            of_mode[under] -= 1
            other = {"nodule": "none", "none": "nodule"}[under]
            answers[side].append(under if of_mode[under] >= 0 else other)
    found = nod.found(answers)
    for mode, printed in nod.PRINTED.items():
        rates = found.rates[mode]
        three = (rates.sensitivity, rates.specificity, rates.accuracy)
        assert [100 * p.value for p in three] == pytest.approx(printed, abs=0.051)
        assert [p.n for p in three] == [252, 112, 364]
    test, pairs = found.tests["Se"]
    assert [(p.a, p.b) for p in pairs] == list(combinations(nod.MODES, 2))
    assert pairs[0].statistic < -1.5 and test.df == (2.0,)
    assert {p.sides for p in found.tests["ACC"][1]} == {"one-sided"}
    assert "Se 94.8 % [91.4, 97.0] (94.8)" in nod.text(found)
    # somebody who has begun, with a surface that has nodules on both sides
    more = zip(answers, ("P14", "deformation, A1 and C1", "nodule", "nodule"), strict=True)
    assert nod.found({k: [*answers[k], v] for k, v in more}).tests == found.tests
    refused(UnknownName, "no column 'left'", nod.found, {"condition": [], "right": []})


def test_sizes_the_mark_that_is_right_has_the_hardest_place():
    """The level of the map under each mark; the marks stay where they are while the
    nodules go round.
    """
    experiment, firsts = size.nodule_sizes(), []
    for k, code in enumerate(("P01", "P02", "P03")):
        (trial,) = trials_of(experiment, size.person, code)
        S, marks = block(k * 2 * pi / 3), zip("123", buried().values(), strict=True)
        hard = {m: S.levels[round(y / 0.002), round(x / 0.002)] for m, (x, y) in marks}
        assert trial.correct["order"] == sorted(hard, key=hard.get, reverse=True)
        assert experiment.scenes[trial.condition].hash == soft_surface("combined", S=S).hash
        firsts.append(trial.correct["order"][0])
    assert firsts == ["1", "2", "3"] and experiment.timing.interval == 180.0


def test_sizes_gives_the_printed_rates_and_places():
    """20 orders, each counted by hand: the rates, their intervals and the mean places
    are those of the paper.
    """
    orders = [order for order, n in size.ORDERS.items() for _ in range(n)]
    names = (list(size.UNDER) * 7)[:20]
    mark = [{n: m for m, n in size.UNDER[name].items()} for name in names]
    marked = [[m[n] for n in o] for m, o in zip(mark, orders, strict=True)]
    found = size.sorted_rightly({"condition": names, "order": marked})
    counts = {pair: (p.k, p.n) for pair, p in found.pairs.items()}
    assert counts == {("A", "B"): (17, 20), ("A", "C"): (18, 20), ("B", "C"): (14, 20)}
    assert found.rank == pytest.approx(size.PRINTED_RANK)
    told = size.text(found)
    for line in (
        "A before B  85.0 % [64.0, 94.8] of 20 (85.0)",
        "all pairs   81.7 % [70.1, 89.4] of 60 (81.7)",
        "B before C  70.0 % [48.1, 85.5] of 20 (70.0)",
    ):
        assert line in told
    drawn = simulate(size.nodule_sizes(), size.person, 60, seed=1)
    assert size.sorted_rightly(drawn).rank == pytest.approx(size.PRINTED_RANK, abs=0.2)
    refused(UnknownName, "no column 'order'", size.sorted_rightly, {"condition": []})


def test_places_nine_people_have_nine_orders_and_no_place_twice():
    experiment = place.nodule_places()
    seen = [trials_of(experiment, place.person, f"P{n + 1}") for n in range(9)]
    for trials in seen:
        assert {place.SURFACES[t.condition][0] for t in trials} == set(place.FEEDBACK)
        where = [at for t in trials for at in t.correct["nodules"]] + list(buried().values())
        nearest = min(dist(a, b) for a, b in combinations(where, 2))
        assert nearest > place.NEAR, "what was learnt does not help"
    for t in {t.condition: t for trials in seen for t in trials}.values():
        how, turn = place.SURFACES[t.condition]
        S = block(radians(turn))
        assert experiment.scenes[t.condition].hash == soft_surface(place.FEEDBACK[how], S=S).hash
        levels = [S.levels[round(y / 0.002), round(x / 0.002)] for x, y in t.correct["nodules"]]
        assert levels == sorted(levels, reverse=True), "hard where it is right, A first"
        assert levels[-1] > 1.2 * S.levels[0, 0]
    assert len({tuple(t.condition for t in trials) for trials in seen}) == 9
    assert (experiment.timing.interval, experiment.timing.until) == (300.0, "answer")
    for column in zip(*seen, strict=True):  # each thrice in each place
        assert sorted(t.condition for t in column) == sorted(place.SURFACES)


def test_places_gives_the_printed_rates():
    tests = [(how, place.TURNS[k % 3]) for how in place.FEEDBACK for k in range(20)]
    marks = [[list(at) for at in buried(turn * pi / 180).values()] for _, turn in tests]
    for k in (*range(5), *range(20, 27), *range(40, 43)):  # 5, 7 and 3 misses
        marks[k][k % 20 % 3][0] += 0.0101  # 10 mm are near
    answers = {
        "participant": [f"P{k % 20}" for k in range(60)],
        "condition": [f"{how}, {turn} degrees" for how, turn in tests],
        "nodules": marks,
    }
    found = place.located(answers)
    counts = {how: (p.k, p.n) for how, p in found.rates.items()}
    assert counts == {how: (k, 60) for how, k in place.FOUND.items()}
    assert [found.nodules["single-point", name].k for name in "AC"] == [18, 19]
    assert found.test.df == (2.0,) and found.test.value == pytest.approx(2.0978, abs=1e-4)
    assert [p.sides for p in found.pairs] == ["one-sided"] * 3
    told = place.text(found)
    assert "single-point  91.7 % [81.9, 96.4] (91.7 [82.0, 96.4])" in told
    assert "multi-point   88.3 % [77.8, 94.2]" in told
    for n, k in ((20, 55), (1, 2)):  # one feedback cannot be compared
        one = place.located({name: column[:n] for name, column in answers.items()})
        assert one.test is None and one.pairs == () and one.rates["single-point"].k == k
    x, y = buried(0.5 * pi)["A"]
    near = [place.hit("vibration, 90 degrees", [[x, y + d]])["A"] for d in (0.00995, 0.01005)]
    assert near == [True, False]
    people, off = (200, 0.03) if STRESS else (40, 0.07)
    drawn = place.located(simulate(place.nodule_places(), place.person, people, seed=1))
    printed = [k / 60 for k in place.FOUND.values()]
    assert [p.value for p in drawn.rates.values()] == pytest.approx(printed, abs=off)


OVER_ALL = {  # once around, over all three nodules
    "x": lambda t: 0.06 + 0.03 * np.cos(pi * t),
    "y": lambda t: 0.06 + 0.03 * np.sin(pi * t),
    "press": size.held,
}


def test_places_are_displayed_and_analysed_from_their_log(tmp_path):
    quick = dataclasses.replace(place.nodule_places(), timing=Timing(interval=2.0), motion=OVER_ALL)
    answered(tmp_path, quick, quick.observer, "offline")
    (saved,) = sessions(quick.name, tmp_path)
    shown = {}
    for r in saved.records:
        told = r.displayed[0]
        felt = {name for name, (peak,) in told["peak"].items() if peak > 0}
        shown[place.SURFACES[r.trial.condition][0]] = felt
        assert told["clips"] == {}, "nothing is out of the device's range"
    assert shown == {
        "single-point": {"x1", "y1", "depth1", "force"},
        "vibration": {"x1", "y1", "force", "vibration"},
        "multi-point": {f"{k}{i}" for k in ("x", "y", "depth") for i in (1, 2, 3)} | {"force"},
    }
    assert "single-point" in quick.analysis([saved])
