"""The papers' experiments, with few trials: what is shown, how it is ordered, and the
numbers of their tables.
"""

import dataclasses
from itertools import combinations
from math import dist, pi, radians

import numpy as np
import pytest
from experiments.some import experiment, still
from refusals import refused
from typer.testing import CliRunner

import stimlib
from stimlib.cli import app
from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    ConstantStimuli,
    Listener,
    Psychometric,
    Session,
    Simulated,
    Stimulus,
    Timing,
    check_graeco_latin,
    columns,
    fechner,
    observed,
    paired,
    present,
    run,
    sessions,
    simulate,
    stream,
    write_report,
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
)
from stimlib.experiments.papers.ugrip import K0, SQUEEZES, comparisons, feels, text, ugrip
from stimlib.scenes import soft_surface, squeeze, viscoelastic
from stimlib.soft import block, buried


# UGrip --------------------------------------------------------------------------------
def test_ugrip_has_the_papers_staircases_one_pair_for_each_condition():
    paper, quick = ugrip(), ugrip(reversals=2)

    def session(seed):
        return [
            t
            for t, _ in observed(
                quick.designed("P01"), seed, Psychometric(K0, 0.1, log=True), stream(5, "observer")
            )
        ]

    trials = session(5)
    for t in trials:
        paper.check(t)
    assert len({t.track for t in trials}) == 8, "two of each condition"
    conditions = list(dict.fromkeys(t.condition for t in trials))
    assert sorted(conditions) == [
        f"{f}, {v}" for f in ("one finger", "two fingers") for v in ("silent", "vibrating")
    ]
    assert [t.pause for t in trials if t.pause] == [120.0] * 3, "two minutes between pairs"
    first = {t.track: t.level for t in reversed(trials)}
    for track, level in first.items():
        low, high = (2 * K0, 2.5 * K0) if track.endswith("high") else (K0 / 2.5, K0 / 2)
        assert low <= level <= high
    for t in trials:
        by = {s.name: s for s in t.stimuli}
        assert by["standard"].params == {"k": 2000.0, "A": 0.0}
        assert by["comparison"].params["A"] == (3.4 if "vibrating" in t.condition else 0.0)
    for pair in paper.design.parts.values():
        for stairs in pair.tracks.values():
            assert (stairs.steps, stairs.reversals, stairs.bounds) == (
                (12.0,) * 5 + (3.0,),
                20,
                (250.0, 16000.0),
            )
            assert (stairs.up, stairs.down, stairs.task.asks_less) == (1, 1, True)
    assert conditions != list(dict.fromkeys(t.condition for t in session(7))), (
        "another order for another person"
    )


def test_ugrip_finds_what_its_observers_feel():
    """Of parameters, with the paper's points of subjective equality and slopes; the
    tests are those within people.
    """
    pse = {
        "one finger, silent": 2020.0,
        "one finger, vibrating": 2340.0,
        "two fingers, silent": 2020.0,
        "two fingers, vibrating": 2020.0,
    }
    sigma = {name: 1 / 7.9 if "one" in name else 1 / 17.5 for name in pse}
    answers = simulate(ugrip(), Psychometric(pse, sigma, log=True), 3, seed=2)
    found = comparisons(answers)
    assert [(t.what, t.a, t.b) for t in found][:4] == [
        ("pse", "one finger, silent", "one finger, vibrating"),
        ("slope", "one finger, silent", "one finger, vibrating"),
        ("intercept", "one finger, silent", "one finger, vibrating"),
        ("pse", "two fingers, silent", "two fingers, vibrating"),
    ]
    assert (found[0].mean_a, found[0].mean_b) == (
        pytest.approx(2.02, abs=0.15),
        pytest.approx(2.34, abs=0.15),
    )
    assert (found[3].mean_a, found[3].mean_b) == (
        pytest.approx(2.02, abs=0.07),
        pytest.approx(2.02, abs=0.07),
    )
    assert found[7].mean_b > 1.5 * found[7].mean_a > 9.0, "two fingers feel finer differences"
    assert found[2].mean_a == pytest.approx(-found[1].mean_a * np.log10(2.02), rel=0.3), (
        "over k in N/mm"
    )
    line = text(found[:1])
    assert (
        line.startswith("pse")
        and "F(1, 2)" in line
        and line.endswith("paper: 2.02, 2.34: F > 5.6, p < .03")
    )


@pytest.mark.parametrize(("softer", "felt"), [(0.0, 2340.0), (316.0, 2000.0)])
def test_one_finger_feels_a_vibrating_object_of_2340_as_a_silent_one_of_2000(softer, felt):
    """The paper's point of subjective equality; every 3 s of the rendering count."""
    one = Listener({"one finger": squeeze(fingers=1)}, SQUEEZES, 8000.0, 3.0, feels(softer), 0.1)
    mean = np.mean(
        [one.figure_of(Stimulus("one finger", {"k": 2340.0, "A": 3.4}, seed)) for seed in range(4)]
    )
    assert mean == pytest.approx(felt, rel=0.01)
    assert one.figure_of(Stimulus("one finger", {"k": 1500.0, "A": 0.0})) == pytest.approx(1500.0)


def test_a_trial_takes_of_the_hands_inputs_those_that_its_scene_has():
    some = experiment(motion={"x": still, "x2": still})
    trial = some.design.next(some.design.init(1))
    assert present(some, trial)["delivered"] > 0


# Bounciness ---------------------------------------------------------------------------
def ideal(alpha):
    """The phase of a springpot that has forgotten its beginning."""
    return alpha * pi / 2


def test_bounciness_has_the_thesis_square_and_its_sessions():
    square = [
        [("βγζθ".index(pair[0]), "ABCD".index(pair[1])) for pair in row.split()] for row in SQUARE
    ]
    check_graeco_latin(square)
    for participant in ("P01", "P02", "P03", "P04"):
        assert sorted(pair_of(participant, n) for n in range(1, 13)) == sorted(PAIRS), (
            "each pair once"
        )
    assert [pair_of("P03", n) for n in (4, 5, 6)] == [
        "0.75 and 0.8",
        "0.75 and 0.85",
        "0.75 and 0.9",
    ], "theta A"
    refused(BadValue, "there are 12", pair_of, "P01", 13)
    experiment = bounciness()
    trials = [
        t
        for t, _ in observed(experiment.designed("P02", 3), 1, bouncy(ideal), stream(1, "observer"))
    ]
    assert [t.training for t in trials] == 2 * (10 * [True] + 50 * [False])
    assert [n for n, t in enumerate(trials) if t.pause] == [60]
    shown = [t.stimuli[0].scene for t in trials if not t.training]
    assert {name: shown.count(name) for name in shown} == {"0.25": 50, "0.3": 50}
    assert {t.correct["bouncier"] for t in trials if t.stimuli[0].scene == "0.25"} == {"red"}
    assert experiment.familiar("P02", 3)["green"].scene == "0.3"
    assert (
        experiment.scenes["0.25"].hash
        == viscoelastic(alpha=0.25).hash
        != experiment.scenes["0.3"].hash
    )


def test_bounciness_finds_the_jnds_that_its_observer_has():
    answers = simulate(bounciness(), bouncy(ideal), ["P01"], seed=3)
    found = jnds(answers)
    assert list(found.jnd) == list(REFERENCES.values())
    assert list(found.jnd.values()) == pytest.approx([0.03, 0.0351, 0.0714, 0.1077], rel=0.35)
    a, b, c = found.d["P01", 0.5]
    assert found.jnd[0.5] == pytest.approx(3 / (a / 0.05 + b / 0.1 + c / 0.15)) and a < b < c
    assert found.line.slope * 0.25 + found.line.intercept == pytest.approx(
        found.jnd[0.25], abs=0.03
    )
    late = {name: column[120:] for name, column in answers.items()}
    refused(BadValue, "P01 has no session of", jnds, late)


def test_the_phase_is_that_of_the_rendered_force():
    assert phase(0.25) == pytest.approx(0.25 * pi / 2, rel=0.02)


# Roughness ----------------------------------------------------------------------------
def print_of(name):
    """The RMS as table 6.1 has it."""
    s = rough.STIMULI[name]
    return rough.PRINTED[s.duty, s.amplitude, s.waveform][0]


def test_roughness_shows_all_stimuli_twice_a_day_in_an_order_of_ones_own(monkeypatch):
    monkeypatch.setattr(rough, "rms", print_of)
    monkeypatch.setattr(rough, "swing", bumpiness_of)
    experiment = rough.roughness()

    def shown(code, session):
        seed = experiment.seeded(code, session)
        return [
            t
            for t, _ in observed(
                experiment.designed(code, session), seed, rough.person(), stream(1, "observer")
            )
        ]

    first, second, other = shown("P01", 1), shown("P01", 2), shown("P02", 2)
    assert [t.training for t in first] == 48 * [True] + 162 * [False]
    for a in (48, 129):
        assert sorted(t.condition for t in first[a : a + 81]) == sorted(rough.STIMULI), (
            "a set is each stimulus once"
        )
    orders = [[t.condition for t in trials] for trials in (first[48:], second, other)]
    assert len(second) == 162 and orders[0] != orders[1] != orders[2]
    (shown_once,) = [
        t.stimuli[0] for t in second[:81] if t.condition == "square, 18 bumps, duty 0.2, 7.5 V"
    ]
    assert (shown_once.scene, dict(shown_once.params)) == ("square 18", {"duty": 0.2, "A": 7.5})
    assert (experiment.replays, experiment.timing.interval, experiment.sessions) == (1, 15.0, 2)
    assert [(q.name, q.choices, q.most) for q in experiment.questions] == [
        ("roughness", ("smooth", "rough"), 7),
        ("bumpiness", ("flat", "bumpy"), 7),
    ]


@pytest.fixture(scope="module")
def rated():
    """Answers of three people who judge by formulas, and their roughness."""
    with pytest.MonkeyPatch.context() as formulas:
        formulas.setattr(rough, "rms", print_of)
        formulas.setattr(rough, "swing", bumpiness_of)
        people = {f"P{n}": rough.person(stream(n, "person")) for n in (1, 2, 3)}
        answers = simulate(rough.roughness(), people, list(people), seed=1)
        return people, answers, rough.ratings(answers)


def test_roughness_gives_the_thesis_tables_and_law(rated):
    people, answers, found = rated
    assert found.law.line.intercept == pytest.approx(3.92 + 0.05, abs=0.6)
    assert found.law.line.slope == pytest.approx(2.25, abs=0.3) and found.pearson > 0.8
    assert list(found.mean)[:2] == [(0.5, 0.2, "sine"), (0.5, 0.2, "square")]
    assert found.rms[7.5, 0.8, "square"] == 3.35 == max(found.rms.values())
    rows = [
        v
        for v, c in zip(answers["outcome"], answers["condition"], strict=True)
        if c.startswith("square") and c.endswith("duty 0.8, 7.5 V")
    ]
    assert len(rows) == 3 * 3 * 4 and found.mean[7.5, 0.8, "square"] == pytest.approx(np.mean(rows))
    assert [e.name for e in found.effects[:4]] == ["waveform", "bumps", "duty", "amplitude"]
    assert (
        min(found.effects[:4], key=lambda e: e.p).name == "amplitude" and len(found.effects) == 15
    )
    means = [
        [
            np.mean(
                [
                    v
                    for v, w, c in zip(
                        answers["outcome"],
                        answers["participant"],
                        answers["condition"],
                        strict=True,
                    )
                    if w == who and c.endswith(f", {volt} V")
                ]
            )
            for who in people
        ]
        for volt in ("4", "7.5")
    ]
    assert found.pairs["amplitude", "4.0", "7.5"] == pytest.approx(3 * paired(*means).p), (
        "Bonferroni"
    )
    assert "4     0.5   square    1.41 (1.41)" in rough.text(found)
    refused(
        BadValue,
        "P1 has not rated",
        rough.ratings,
        {name: column[:80] for name, column in answers.items()},
    )


def bumpiness_of(name):
    """The swing of slow bumps: A times the standard deviation of the envelope."""
    s, d = rough.STIMULI[name], rough.STIMULI[name].duty
    u = (np.arange(2000) + 0.5) / 2000
    cosine = np.cos(2 * np.pi * (u - d / 2)) - np.cos(np.pi * d)
    e = {"square": 1.0, "sawtooth": u / d, "sine": cosine / (1 - np.cos(np.pi * d))}
    return s.amplitude * float(np.std(np.where(u < d, e[s.waveform], 0.0)))


def test_the_swing_is_that_of_the_envelope():
    """Of two bumps on 0.1 m, which pass slowly; 18 of them are hardly counted."""
    for waveform in ("sine", "square", "sawtooth"):
        name = f"{waveform}, 2 bumps, duty 0.5, 7.5 V"
        assert rough.swing(name) == pytest.approx(bumpiness_of(name), rel=0.15)
    square = {d: rough.swing(f"square, 2 bumps, duty {d}, 4 V") for d in (0.2, 0.5, 0.8)}
    assert square[0.5] == pytest.approx(4 * 0.5, rel=0.11)
    assert square[0.2] == pytest.approx(square[0.8], rel=0.01)  # d (1 - d)
    fast = rough.swing("square, 18 bumps, duty 0.5, 4 V")
    # the line of 18 a second counts 1/(1 + 1.8^2), and turning adds slower ones
    assert fast == pytest.approx(4 * 2 / np.pi / 2**0.5 / (1 + 1.8**2), rel=0.2)
    refused(UnknownName, "swing: no stimulus 'x'", rough.swing, "x")


def test_bumpiness_is_a_parabola_over_the_duty_cycle(rated):
    """The finding of the thesis, in the analysis of the second question, whose numbers
    are recomputed here from the answers.
    """
    people, answers, roughness = rated
    bumpy = rough.ratings(answers, "bumpiness")
    assert bumpy.middles["duty"].value > 2 and bumpy.middles["duty"].p < 0.1
    assert roughness.middles["duty"].value < bumpy.middles["duty"].value
    values = {}
    for v, who, c in zip(
        answers["bumpiness"], answers["participant"], answers["condition"], strict=True
    ):
        values.setdefault((who, c), []).append(v)
    means = {key: np.mean(v) for key, v in values.items()}

    def of(*parts):
        return [m for (_, c), m in means.items() if all(p in f"{c}," for p in parts)]

    assert len(of("duty 0.5,")) == 3 * 27
    boxed = {
        "duty 0.2,": ("duty", "0.2"),
        "18 bumps": ("bumps", "18"),
        "sine": ("waveform", "sine"),
    }
    boxed |= {"duty 0.5,": ("duty", "0.5"), " 7.5 V": ("amplitude", "7.5")}
    for part, key in boxed.items():
        assert bumpy.boxes[key] == pytest.approx(np.percentile(of(part), [0, 25, 50, 75, 100]))
    for w, a, n in bumpy.by_bumps:
        want = np.mean(of(f"{w}, {n} bumps", f", {a:g} V"))
        assert bumpy.by_bumps[w, a, n] == pytest.approx(want)
    assert len(bumpy.by_bumps) == 27
    by_duty = [
        [
            np.mean([m for (w, c), m in means.items() if w == who and f"duty {d}," in c])
            for who in people
        ]
        for d in (0.2, 0.5, 0.8)
    ]
    t = paired(by_duty[1], (np.array(by_duty[0]) + by_duty[2]) / 2)
    assert bumpy.middles["duty"].value == pytest.approx(t.value)
    told = rough.text(bumpy, "bumpiness")
    assert "a parabola over the duty cycle" in told and "(printed)  bumpiness\n" in told
    assert told.count("\nduty ") == 2 * 3 and "bumpiness at 2, 6, 18 bumps" in told


def test_roughness_from_the_session_to_the_report(monkeypatch, tmp_path):
    """Two people, each stimulus once and shortly, of which a few are played; the
    command line analyses both scales.
    """
    monkeypatch.setattr(rough, "rms", print_of)
    monkeypatch.setattr(rough, "swing", bumpiness_of)
    items = rough.day("P01", 2).parts["sets"].items
    made = dataclasses.replace(
        rough.roughness(),
        design=ConstantStimuli(items, shuffle="each"),
        timing=Timing(interval=0.05, gap=0.0, before=0.0),
        sessions=1,
    )

    def shown(trial, folder):
        return (
            present(made, trial, "offline", folder)
            if len(played) < 5 and not played.append(1)
            else {}
        )

    played = []
    for code in ("P01", "P02"):
        with Session(made, tmp_path, code, 1) as session:
            run(session, Simulated(session, rough.person(stream(3, code))), shown)
    done = CliRunner().invoke(app, ["experiment", "analyse", "roughness", "--data", str(tmp_path)])
    assert done.exit_code == 0, done.output
    rated, bumpy = done.output.split("\n\n")[-2:]
    assert "roughness (printed)" in rated and "1.41 (1.41)" in rated
    assert "thesis, bumpiness and duty: is a parabola" in bumpy and "bumpiness = " in bumpy
    saved = sessions("roughness", tmp_path)
    assert rough.analysis(saved) in done.output
    columns_of = columns(saved)
    second = rough.ratings(columns_of, "bumpiness")
    assert (
        rough.text(second, "bumpiness") == bumpy.strip()
        and second.mean != rough.ratings(columns_of).mean
    )
    write_report(
        tmp_path / "report.html",
        "Bumps",
        "Two people.",
        columns_of,
        tables={"Bumpiness": second.effects},
    )
    page = (tmp_path / "report.html").read_text()
    assert "Bumpiness" in page and "waveform" in page


def test_the_rendered_rms_is_the_formulas():
    """A sqrt(d)/2, and A sqrt(d/12) for the sawtooth, which the thesis prints up to 15
    % lower.
    """
    assert rough.rms("square, 6 bumps, duty 0.2, 4 V") == pytest.approx(4 * 0.2**0.5 / 2, rel=0.01)
    assert rough.rms("sawtooth, 6 bumps, duty 0.2, 4 V") == pytest.approx(
        4 * (0.2 / 12) ** 0.5, rel=0.01
    )


def test_fechners_law_of_the_printed_tables():
    x, r = np.transpose(list(rough.PRINTED.values()))
    law = fechner(x, r)
    assert (law.line.intercept, law.line.slope, law.r2) == pytest.approx(
        (3.9201, 2.2464, 0.9563), abs=5e-5
    )
    assert np.corrcoef(x, r)[0, 1] == pytest.approx(0.9024, abs=5e-5)


# Nodules ------------------------------------------------------------------------------
def test_nodules_has_the_printed_preferences():
    """Of 14 people; 14.3 % found two techniques the same, 7.1 % said one was quick."""
    printed = {"combined": 71.4, "deformation": 7.1, "cursor": 0.0}
    assert {mode: round(100 * n / 14, 1) for mode, n in nod.PREFERRED.items()} == printed


def test_nodules_shows_each_surface_once_and_begins_with_another_technique():
    experiment = nod.nodules()
    firsts = []
    for code in ("P01", "P02", "P03"):
        trials = [
            t for t, _ in observed(experiment.designed(code), 1, nod.person, stream(1, "observer"))
        ]
        assert sorted(t.condition for t in trials) == sorted(nod.SURFACES) and len(trials) == 39
        techniques = [nod.SURFACES[t.condition][0] for t in trials]
        assert techniques == sorted(techniques, key=techniques.index), "one after another"
        firsts.append(techniques[0])
        for t in trials:
            assert t.stimuli[0].scene == t.condition and t.correct == nod.right_answers(t.condition)
    assert firsts == ["deformation", "cursor", "combined"]
    sides = [
        side for t in trials if t.condition.startswith("cursor") for side in t.correct.values()
    ]
    assert (sides.count("nodule"), sides.count("none")) == (18, 8)
    assert nod.right_answers("combined, none and C1") == {"left": "none", "right": "nodule"}
    flat, nodule = (experiment.scenes[f"combined, {left} and none"].hash for left in ("none", "A1"))
    assert flat != nodule and list(experiment.scenes["cursor, A1 and B1"].outputs) == [
        "x",
        "y",
        "depth",
    ]


def test_nodules_gives_the_papers_rates_of_the_papers_counts():
    """Answers with these counts: the rates are the printed ones, the intervals those of
    252, 112 and 364 sides.
    """
    answers = simulate(nod.nodules(), nod.person, 14, seed=1)
    for mode, (hits, rejections) in nod.COUNTS.items():
        left = {"nodule": hits, "none": rejections}
        for k, name in enumerate(answers["condition"]):
            for side, under in nod.right_answers(name).items():
                if nod.SURFACES[name][0] == mode:
                    left[under] -= 1
                    answers[side][k] = (
                        under if left[under] >= 0 else {"nodule": "none", "none": "nodule"}[under]
                    )
    found = nod.found(answers)
    for mode, printed in nod.PRINTED.items():
        rates = found.rates[mode]
        three = (rates.sensitivity, rates.specificity, rates.accuracy)
        assert [100 * p.value for p in three] == pytest.approx(printed, abs=0.051) and [
            p.n for p in three
        ] == [252, 112, 364]
    assert (
        found.rates["combined"].sensitivity.low,
        found.rates["combined"].accuracy.high,
    ) == pytest.approx((0.9138, 0.9790), abs=5e-5)
    test, pairs = found.tests["Se"]
    assert [(p.a, p.b) for p in pairs] == list(combinations(nod.MODES, 2)) and pairs[
        0
    ].statistic < -1.5
    assert test.df == (2.0,) and {p.sides for p in found.tests["ACC"][1]} == {"one-sided"}
    assert "Se 94.8 % [91.4, 97.0] (94.8)" in nod.text(found)


def test_sizes_the_mark_that_is_right_has_the_hardest_place():
    """The level of the map under each mark; the marks stay where they are while the
    nodules go round.
    """
    experiment = size.nodule_sizes()
    marks = list(buried().values())
    firsts = []
    for k, code in enumerate(("P01", "P02", "P03")):
        (trial,) = [
            t for t, _ in observed(experiment.designed(code), 1, size.person, stream(1, "observer"))
        ]
        S = block(k * 2 * pi / 3).levels
        hard = {
            m: S[round(y / 0.002), round(x / 0.002)] for m, (x, y) in zip("123", marks, strict=True)
        }
        assert trial.correct["order"] == sorted(hard, key=hard.get, reverse=True)
        assert (
            experiment.scenes[trial.condition].hash
            == soft_surface("combined", S=block(k * 2 * pi / 3)).hash
        )
        firsts.append(trial.correct["order"][0])
    assert firsts == ["1", "2", "3"]


def test_sizes_gives_the_printed_rates_and_places():
    """20 orders, each counted by hand: the rates, their intervals and the mean places
    are those of the paper.
    """
    orders = [order for order, n in size.ORDERS.items() for _ in range(n)]
    names = list(size.UNDER) * 7
    mark = [{n: m for m, n in size.UNDER[name].items()} for name in names]
    answers = {
        "condition": names[:20],
        "order": [[m[n] for n in o] for m, o in zip(mark, orders, strict=False)],
    }
    found = size.sorted_rightly(answers)
    assert {pair: (p.k, p.n) for pair, p in found.pairs.items()} == {
        ("A", "B"): (17, 20),
        ("A", "C"): (18, 20),
        ("B", "C"): (14, 20),
    }
    assert found.rank == pytest.approx(size.PRINTED_RANK) and (found.every.k, found.every.n) == (
        49,
        60,
    )
    told = size.text(found)
    assert (
        "A before B  85.0 % [64.0, 94.8] of 20 (85.0)" in told
        and "all pairs   81.7 % [70.1, 89.4] of 60 (81.7)" in told
    )
    assert (
        "B before C  70.0 % [48.1, 85.5] of 20 (70.0)" in told
        and size.nodule_sizes().timing.interval == 180.0
    )
    drawn = simulate(size.nodule_sizes(), size.person, 60, seed=1)
    assert size.sorted_rightly(drawn).rank == pytest.approx(size.PRINTED_RANK, abs=0.2)
    refused(UnknownName, "no column 'order'", size.sorted_rightly, {"condition": []})


def test_places_nine_people_have_nine_orders_and_no_place_twice():
    experiment = place.nodule_places()
    seen = {}
    for n in range(9):
        seen[n] = [
            t
            for t, _ in observed(
                experiment.designed(f"P{n + 1}"), 1, place.person, stream(1, "observer")
            )
        ]
        assert {place.SURFACES[t.condition][0] for t in seen[n]} == set(place.FEEDBACK)
        where = [at for t in seen[n] for at in t.correct["nodules"]] + list(buried().values())
        assert min(dist(a, b) for a, b in combinations(where, 2)) > place.NEAR, (
            "what was learnt does not help"
        )
        for t in seen[n]:
            how, turn = place.SURFACES[t.condition]
            S = block(radians(turn))
            assert (
                experiment.scenes[t.condition].hash == soft_surface(place.FEEDBACK[how], S=S).hash
            )
            levels = [S.levels[round(y / 0.002), round(x / 0.002)] for x, y in t.correct["nodules"]]
            assert levels == sorted(levels, reverse=True) and levels[-1] > 1.2 * S.levels[0, 0], (
                "hard where it is right, A first"
            )
    assert len({tuple(t.condition for t in trials) for trials in seen.values()}) == 9 and (
        experiment.timing.interval,
        experiment.timing.until,
    ) == (300.0, "answer")
    for k in range(3):
        assert sorted(trials[k].condition for trials in seen.values()) == sorted(place.SURFACES), (
            "each thrice in each place"
        )


def test_places_gives_the_printed_rates():
    tests = [(how, place.TURNS[k % 3]) for how in place.FEEDBACK for k in range(20)]
    names = [f"{how}, {turn} degrees" for how, turn in tests]
    marks = [[list(at) for at in buried(turn * pi / 180).values()] for _, turn in tests]
    for first, misses in ((0, 5), (20, 7), (40, 3)):
        for k in range(misses):
            marks[first + k][k % 3][0] += 0.0101  # 10 mm are near
    answers = {
        "participant": [f"P{k % 20}" for k in range(60)],
        "condition": names,
        "nodules": marks,
    }
    found = place.located(answers)
    assert {how: (p.k, p.n) for how, p in found.rates.items()} == {
        how: (k, 60) for how, k in place.FOUND.items()
    }
    assert found.nodules["single-point", "A"].k == 18 and found.nodules["single-point", "C"].k == 19
    assert (
        found.test.df == (2.0,)
        and found.test.value == pytest.approx(2.0978, abs=1e-4)
        and len(found.pairs) == 3
    )
    told = place.text(found)
    assert (
        "single-point  91.7 % [81.9, 96.4] (91.7 [82.0, 96.4])" in told
        and "multi-point   88.3 % [77.8, 94.2]" in told
    )
    assert {p.sides for p in found.pairs} == {"one-sided"}
    one = place.located({name: column[:20] for name, column in answers.items()})
    assert one.test is None and one.pairs == (), "one feedback cannot be compared"
    x, y = buried(0.5 * pi)["A"]
    near = [place.hit("vibration, 90 degrees", [[x, y + d]])["A"] for d in (0.00995, 0.01005)]
    assert near == [True, False]
    drawn = place.located(simulate(place.nodule_places(), place.person, 200, seed=1))
    assert [p.value for p in drawn.rates.values()] == pytest.approx(
        [drawn_of / 60 for drawn_of in place.FOUND.values()], abs=0.03
    )
    alike = place.located({name: column[:1] for name, column in answers.items()})
    assert alike.test is None and alike.rates["single-point"].k == 2


OVER_ALL = {  # once around, over all three nodules
    "x": lambda t: 0.06 + 0.03 * np.cos(pi * t),
    "y": lambda t: 0.06 + 0.03 * np.sin(pi * t),
    "press": size.held,
}


def test_sizes_are_displayed_within_the_devices_range():
    quick = dataclasses.replace(size.nodule_sizes(), timing=Timing(interval=2.0), motion=OVER_ALL)
    design = quick.designed("P01")
    shown = present(quick, design.next(design.init(1)), log=None)
    assert shown["clips"] == {} and shown["delivered"] > 2000 and size.PEN["press"] is size.held
    force = stimlib.render(soft_surface("combined", S=block()), OVER_ALL, fs=1000, seconds=2.0)[
        "force"
    ]
    assert max(force) == pytest.approx(0.83, abs=0.005), "half of what a pen can tell"


def test_places_are_displayed_and_analysed_from_their_log(tmp_path):
    quick = dataclasses.replace(place.nodule_places(), timing=Timing(interval=2.0), motion=OVER_ALL)
    with Session(quick, tmp_path, "P01") as session:
        run(session, Simulated(session, quick.observer))
    saved = sessions(quick.name, tmp_path)
    peaks = {place.SURFACES[r.trial.condition][0]: r.displayed[0]["peak"] for r in saved[0].records}
    shown = {how: {name for name, (peak,) in of.items() if peak > 0} for how, of in peaks.items()}
    assert shown["single-point"] == {"x1", "y1", "depth1", "force"} and shown["vibration"] == {
        "x1",
        "y1",
        "force",
        "vibration",
    }
    assert shown["multi-point"] == {f"{k}{i}" for k in ("x", "y", "depth") for i in (1, 2, 3)} | {
        "force"
    }
    assert all(r.displayed[0]["clips"] == {} for r in saved[0].records), (
        "nothing is out of the device's range"
    )
    assert "single-point" in quick.analysis(saved)
