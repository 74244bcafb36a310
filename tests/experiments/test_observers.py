"""Observers of parameters and of rendered samples, and whole experiments that they take
part in.
"""

import math

import numpy as np
import pytest
from experiments.some import TASK, experiment
from laws import STRESS
from refusals import refused
from scipy.special import ndtr
from statsmodels.genmod.families import Binomial, links
from statsmodels.genmod.generalized_linear_model import GLM

import stimlib
from stimlib.blocks import white_noise
from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    ConstantStimuli,
    Listener,
    OneInterval,
    PsychometricObserver,
    Rate,
    Sequential,
    Stimulus,
    Trial,
    TwoInterval,
    distances,
    power,
    simulate,
    stream,
    wilson,
)
from stimlib.motion.generators import sinusoid
from stimlib.sweep import measure

SPRING = stimlib.Scene({"force": stimlib.Param("k", 100.0, "N/m") * stimlib.Input("x", "m")})
HAND = {"x": sinusoid(0.01, 5.0)}
PAIR = TwoInterval("k", "stiffer", Stimulus("spring"), Stimulus("spring"), "k")


@measure("N")
def nothing(rendering):
    return math.nan


def listener(measure="rms", sigma=0.1, **other):
    return Listener({"spring": SPRING}, HAND, 1000.0, 1.0, measure, sigma, **other)


# Of parameters ------------------------------------------------------------------------
def test_an_observer_of_parameters_answers_as_often_as_its_curve():
    observer = PsychometricObserver({"k": 100.0, "other": 1.0}, 20.0, lapse=0.05)
    trial = PAIR.trial(120.0, 1, 0)
    assert observer.chance(trial) == pytest.approx(0.05 + 0.9 * ndtr(1.0))
    rng = np.random.default_rng(1)
    more = np.mean([trial.scores[observer(trial, rng).values["stiffer"]] for _ in range(4000)])
    assert more == pytest.approx(observer.chance(trial), abs=0.02)
    logs = PsychometricObserver(100.0, 0.1, log=True)
    assert logs.chance(trial) == pytest.approx(ndtr(math.log10(1.2) / 0.1))


# Of samples ---------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("measure", "figure", "value"),
    [
        ("rms", "", 2.0 * math.sqrt(0.5)),
        ("band(2, 20)", "", 2.0 * math.sqrt(0.5)),
        ("cues", "k_fit_force", 200.0),
        ("cues", "W_force", 10 * 0.5 * 200 * 0.01**2),  # every quarter that goes out, of ten
    ],
)
def test_what_a_listener_feels_is_that_of_the_samples(measure, figure, value):
    felt = listener(measure, figure=figure).figure_of(Stimulus("spring", {"k": 200.0}))
    assert felt == pytest.approx(value, rel=1e-3)
    scene = stimlib.Scene({"force": white_noise(3)})
    hears = Listener({"noise": scene}, {}, 1000.0, 0.1, "rms", 0.1)
    for seed in (5, 6, 5):  # the noise of its trial
        y = stimlib.render(scene, {}, 1000.0, 0.1, seed=seed)["force"]
        felt = hears.figure_of(Stimulus("noise", seed=seed))
        assert felt == pytest.approx(np.sqrt(np.mean(np.square(y))), rel=1e-12)


def test_a_listener_compares_what_it_feels():
    """By the same draws: an error of its own for each interval, on the axis of the
    logarithm.
    """
    trial = PAIR.trial(150.0, 1, 0)
    hears, answers, wanted = listener(sigma=0.2, log=True), [], []
    for k in range(30):
        rng, same = stream(k, "it"), stream(k, "it")
        answers.append(trial.scores[hears(trial, rng).values["stiffer"]])
        first, second = 0.2 * same.normal(), 0.2 * same.normal()
        felt = {
            s.name: e + math.log10(s.params.get("k", 100.0))
            for s, e in zip(trial.stimuli, (first, second), strict=True)
        }
        wanted.append(float(felt["comparison"] > felt["standard"]))
    assert answers == wanted and 0 < sum(wanted) < 30


def test_one_interval_and_ratings():
    task = OneInterval(
        "k", "which", {"hard": Stimulus("spring", {"k": 200.0}), "soft": Stimulus("spring")}
    )
    told, hard = listener(sigma=0.0, criterion=1.0), task.trial("hard", 1, 0)
    assert told(hard, stream(1)).values["which"] == "hard" and told(hard, stream(1)).simulated
    assert told(task.trial("soft", 1, 0), stream(1)).values["which"] == "soft"
    show = Rate("k", ("rough",), Stimulus("spring", {"k": 300.0})).trial(None, 1, 0)
    rated = [listener(sigma=0.0, gain=g)(show, stream(1)) for g in (-1, 1, 2, 9)]
    assert [a.values["rough"] for a in rated] == [1, 2, 4, 7]  # the force has an rms of 2.12 N
    absent = listener(sigma=0.0, criterion=1.0, lapse=0.5)  # never attends
    for k in range(20):
        # the last of three: of the interval, of whether it is a lapse, and this
        rng = stream(k)
        coin = (rng.normal(), *rng.random(2))[-1]
        assert absent(hard, stream(k)).values["which"] == ("hard" if coin < 0.5 else "soft")
        # each of 1 to 7 as often
        assert absent(show, stream(k)).values["rough"] == 1 + int(7 * coin)


# Whole experiments --------------------------------------------------------------------
def test_a_participant_more_changes_no_other():
    two, three, third = (simulate(experiment(), FELT, n) for n in (2, 3, ["P03"]))
    names = "participant session number condition track level chance outcome correct seconds"
    assert set(two) == {*names.split(), "simulated", "softer"}
    n, first = len(two["level"]), two["participant"].count("P01")
    assert {name: column[:n] for name, column in three.items()} == two
    assert two["number"][:first] == list(range(1, first + 1)) and first < n
    assert third["level"] == three["level"][n:]
    assert simulate(experiment(), FELT, 2, seed=1) != two
    practice, real = ConstantStimuli(((TASK, 2.5),), training=True), ConstantStimuli(((TASK, 4.0),))
    made = experiment(design=Sequential({"first": practice, "then": real}))
    found = simulate(made, FELT, 1)
    assert (found["level"], found["number"]) == ([4.0], [2]), "without training"
    if STRESS:
        of = Listener(made.scenes, made.motion, made.fs, made.timing.interval, "rms", 0.3)
        assert simulate(made, of, 3, workers=1) == simulate(made, of, 3, workers=2)


FELT = PsychometricObserver(2.34, 0.3)


def test_power_counts_all_experiments_and_everybody_is_somebody_else():
    told, people, draws = iter([(1.0, 0.1), (math.nan, math.nan), (3.0, 0.01), (2.0, 0.5)]), [], []

    def anybody(rng):
        def one(trial, rng):
            draws.append(rng.random())
            return FELT(trial, rng)

        people.append(rng.random())
        return one

    short = experiment(design=ConstantStimuli(((TASK, 4.0),)), sessions=2)
    how = {"truth": 1.5, "experiments": 4, "alpha": 0.2, "progress": False}
    found = power(short, anybody, lambda columns: next(told), 2, **how)
    assert (found.found, found.interval) == (0.5, (wilson(2, 4).low, wilson(2, 4).high))
    assert (found.estimate, found.bias, found.spread, found.failed) == (2.0, 0.5, 1.0, 1)
    assert (len(set(people)), len(set(draws)), found.trials) == (8, 16, (2.0, 2))
    assert simulate(short, FELT, 2)["session"] == [1, 2, 1, 2]


# What they went by --------------------------------------------------------------------
def test_the_cue_that_explains_the_answers_has_a_distance_of_d():
    """Answers by phase alone: its distance is that of a probit by statsmodels; work,
    which follows it loosely, has less.
    """
    rng = np.random.default_rng(2)
    phase = np.repeat([0.0, 1.0], 100) + 0.3 * rng.normal(size=200)
    work, force = phase + rng.normal(size=200), rng.normal(size=200)
    said = (phase - 0.5 + 0.6 * rng.normal(size=200) > 0).astype(float)
    found = distances({"force": force, "work": work, "phase": -phase}, said, d=1.5)
    assert [v.cue for v in found] == ["phase", "work", "force"]
    x = np.column_stack([np.ones(200), -phase])
    a, b = GLM(said, x, family=Binomial(links.Probit())).fit(tol=1e-14).params
    z = a - b * phase
    assert found[0].value == pytest.approx(z[z > 0].mean() - z[z <= 0].mean(), rel=1e-8)
    assert found[0].slope == pytest.approx(b, rel=1e-8) and found[0].slope < 0 < found[1].slope
    assert found[0].ratio == pytest.approx(found[0].value / 1.5)
    # all that z is known by are trials that hardly differ
    nearly = np.r_[np.zeros(100), 1 + 1e-6 * np.arange(100)]
    (far,) = distances({"cue": nearly}, np.r_[np.zeros(102), 1.0, 0.0, np.ones(96)])
    parted = distances({"cue": said, "none": np.ones(200), "phase": phase}, said)
    problems = [(v.cue, v.problem) for v in (far, *parted[1:])]
    assert problems == [("cue", "separated"), ("cue", "separated"), ("none", "few")]
    assert np.isnan([far.value, parted[1].value]).all()


# What cannot be used ------------------------------------------------------------------
@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda t: PsychometricObserver(1.0, 0.0)(t, None), "sigma"),
        (lambda t: PsychometricObserver(1.0, 1.0, lapse=0.6)(t, None), "lapse = 0.6"),
        (lambda t: PsychometricObserver({"a": 1.0}, 1.0)(t, None), "pse of condition 'k'"),
        (lambda t: PsychometricObserver(1.0, 1.0)(Trial("k", t.stimuli, ("q",)), None), "no level"),
        (
            lambda t: PsychometricObserver(1.0, 1.0, log=True)(
                Trial("k", t.stimuli, ("q",), -2.0), stream(1)
            ),
            "the level -2, and pse = 1: log10 needs both above 0",
        ),
        (
            lambda t: PsychometricObserver(1.0, 1.0)(Trial("k", t.stimuli, ("q",), 1.0), stream(1)),
            "no scores",
        ),
        (lambda t: listener("cues")(t, stream(1)), "several figures"),
        (lambda t: listener(nothing)(t, stream(1)), "nothing of 'spring' is nan"),
        (lambda t: listener(figure="rms")(t, stream(1)), "there are rms_force"),
        (lambda t: listener().figure_of(Stimulus("wall")), "no scene 'wall'"),
        (
            lambda t: listener(log=True)(
                Trial("k", (Stimulus("spring", {"k": 0.0}),), ("q",)), stream(1)
            ),
            "logarithm",
        ),
        (
            lambda t: listener()(Trial("k", t.stimuli[:1], ("q",), scores={"a": 1.0}), stream(1)),
            "criterion",
        ),
        (
            lambda t: listener()(
                Trial(
                    "k", (Stimulus("spring", name="a"), *t.stimuli[:1]), ("q",), scores={"a": 1.0}
                ),
                stream(1),
            ),
            "named",
        ),
        (lambda t: simulate(experiment(), PsychometricObserver(2.0, 1.0), 0), "participant"),
        (lambda t: simulate(experiment(), {"P01": PsychometricObserver(2.0, 1.0)}, 2), "P02"),
        (
            lambda t: power(experiment(), lambda rng: None, lambda found: None, 1, experiments=0),
            "experiments",
        ),
        # as a sequence, "P01" would be three people: P, 0 and 1
        (lambda t: simulate(experiment(), FELT, "P01"), "participants = 'P01' must be"),
        (lambda t: simulate(experiment(), FELT, 2.0), "participants = 2.0 must be"),
        (lambda t: distances({}, [0, 1]), "one cue"),
        (lambda t: distances({"a": [1, 2]}, [0, 2]), "0 and 1"),
        (lambda t: distances({"a": [1, 2, 3]}, [0, 1]), r"\(3,\)"),
        (lambda t: distances({"a": [1, np.nan]}, [0, 1]), r"a\[1\]"),
    ],
)
def test_what_cannot_be_used_is_said(call, said):
    refused((BadValue, UnknownName), said, call, PAIR.trial(120.0, 1, 0))
