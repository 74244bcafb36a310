"""Observers of parameters and of rendered samples, and whole experiments that they take
part in.
"""

import math

import numpy as np
import pytest
from experiments.some import TASK, experiment
from refusals import refused

import stimlib
from stimlib.blocks import white_noise
from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    ConstantStimuli,
    Listener,
    OneInterval,
    Psychometric,
    Rate,
    Sequential,
    Stimulus,
    Trial,
    TwoInterval,
    distances,
    paired,
    power,
    simulate,
    stream,
    wilson,
)
from stimlib.motion.generators import sinusoid

SPRING = stimlib.Scene({"force": stimlib.Param("k", 100.0, "N/m") * stimlib.Input("x", "m")})
HAND = {"x": sinusoid(0.01, 5.0)}
PAIR = TwoInterval("k", "stiffer", Stimulus("spring"), Stimulus("spring"), "k")


def listener(measure="rms", sigma=0.1, **other):
    return Listener({"spring": SPRING}, HAND, 1000.0, 1.0, measure, sigma, **other)


# Of parameters ------------------------------------------------------------------------
def test_an_observer_of_parameters_answers_as_often_as_its_curve():
    observer = Psychometric({"k": 100.0, "other": 1.0}, 20.0, lapse=0.05)
    trial = PAIR.trial(120.0, 1, 0)
    assert observer.chance(trial) == pytest.approx(0.05 + 0.9 * 0.841344746068543)
    rng = np.random.default_rng(1)
    more = np.mean([trial.scores[observer(trial, rng).values["stiffer"]] for _ in range(4000)])
    assert more == pytest.approx(observer.chance(trial), abs=0.02)
    assert Psychometric(100.0, 0.1, log=True).chance(trial) == pytest.approx(
        0.5 * (1 + math.erf(math.log10(1.2) / 0.1 / math.sqrt(2)))
    )


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
    assert listener(measure, figure=figure).figure_of(
        Stimulus("spring", {"k": 200.0})
    ) == pytest.approx(value, rel=1e-3)


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
    told = listener(sigma=0.0, criterion=1.0)
    assert [
        told(task.trial(name, 1, 0), stream(1)).values["which"] for name in ("hard", "soft")
    ] == ["hard", "soft"]
    show = Rate("k", ("rough",), Stimulus("spring", {"k": 300.0})).trial(None, 1, 0)
    rated = [listener(sigma=0.0, gain=g)(show, stream(1)) for g in (-1, 1, 2, 9)]
    assert [a.values["rough"] for a in rated] == [1, 2, 4, 7]  # the force has an rms of 2.12 N
    assert {a.simulated for a in [*rated, told(task.trial("hard", 1, 0), stream(1))]} == {True}

    def coin(k):
        """The last number that an observer draws, after that of the interval and the
        one that decides on a lapse.
        """
        rng = stream(k)
        return (rng.normal(), *rng.random(2))[-1]

    absent = listener(sigma=0.0, criterion=1.0, lapse=0.5)  # never attends
    for k in range(20):
        assert absent(task.trial("hard", 1, 0), stream(k)).values["which"] == (
            "hard" if coin(k) < 0.5 else "soft"
        )
        # each of 1 to 7 as often
        assert absent(show, stream(k)).values["rough"] == 1 + int(7 * coin(k))


def test_a_listener_hears_the_noise_of_its_trial():
    scene = stimlib.Scene({"force": white_noise(3)})
    hears = Listener({"noise": scene}, {}, 1000.0, 0.1, "rms", 0.1)
    felt = [hears.figure_of(Stimulus("noise", seed=seed)) for seed in (5, 6, 5)]
    y = [stimlib.render(scene, {}, 1000.0, 0.1, seed=seed)["force"] for seed in (5, 6, 5)]
    assert (
        felt == pytest.approx(np.sqrt(np.mean(np.square(y), axis=1)), rel=1e-12)
        and felt[0] != felt[1]
    )


# Whole experiments --------------------------------------------------------------------
def test_a_participant_more_changes_no_other():
    two, three = (simulate(experiment(), Psychometric(2.34, 0.3), n) for n in (2, 3))
    assert set(two) == {
        "participant",
        "number",
        "condition",
        "track",
        "level",
        "chance",
        "outcome",
        "correct",
        "seconds",
        "simulated",
        "softer",
    }
    assert {name: column[: len(two["level"])] for name, column in three.items()} == two
    first = [v for v, who in zip(two["level"], two["participant"], strict=True) if who == "P01"]
    assert two["number"][: len(first)] == list(range(1, len(first) + 1)) and len(first) < len(
        two["level"]
    )
    assert (
        simulate(experiment(), Psychometric(2.34, 0.3), ["P03"])["level"]
        == three["level"][len(two["level"]) :]
    )
    assert simulate(experiment(), Psychometric(2.34, 0.3), 2, seed=1) != two


@pytest.mark.stress
def test_workers_change_nothing():
    rendered = [simulate(experiment(), listener_of(experiment()), 3, workers=w) for w in (1, 2)]
    assert rendered[0] == rendered[1]


def listener_of(e):
    return Listener(e.scenes, e.motion, e.fs, e.timing.interval, "rms", 0.3)


def test_power_bias_and_length():
    """By the mean of each staircase's last levels: a PSE of 2.6 is told from 2, and 2
    seldom.
    """

    def analyse(columns):
        level, who = np.array(columns["level"]), np.array(columns["participant"])
        means = [level[who == p][-8:].mean() for p in dict.fromkeys(columns["participant"])]
        return float(np.mean(means)), paired(means, np.full(len(means), 2.0)).p

    def run(pse):
        return power(
            experiment(),
            lambda rng: Psychometric(pse, 0.2),
            analyse,
            3,
            truth=pse,
            experiments=8,
            progress=False,
        )

    found, nothing = run(2.6), run(2.0)
    assert (
        found.found > 0.7 > 0.4 > nothing.found
        and found.interval[0] < found.found <= found.interval[1]
    )
    assert (
        abs(found.bias) < 0.15
        and found.bias == pytest.approx(found.estimate - 2.6)
        and found.spread < 0.3
    )
    assert found.failed == 0 and 16 < found.trials[0] <= found.trials[1] < 200


def test_power_counts_all_experiments_and_everybody_is_somebody_else():
    told, people, draws = iter([(1.0, 0.1), (math.nan, math.nan), (3.0, 0.01), (2.0, 0.5)]), [], []

    def anybody(rng):
        def one(trial, rng):
            draws.append(rng.random())
            return Psychometric(2.0, 1.0)(trial, rng)

        people.append(rng.random())
        return one

    short = experiment(design=ConstantStimuli(((TASK, 4.0),)), sessions=2)
    found = power(
        short,
        anybody,
        lambda columns: next(told),
        2,
        truth=1.5,
        experiments=4,
        alpha=0.2,
        progress=False,
    )
    assert (found.found, found.interval) == (0.5, (wilson(2, 4).low, wilson(2, 4).high))
    assert (found.estimate, found.bias, found.spread, found.failed) == (2.0, 0.5, 1.0, 1)
    assert (len(set(people)), len(set(draws)), found.trials) == (8, 16, (2.0, 2))


def test_training_is_left_out():
    practice, real = ConstantStimuli(((TASK, 2.5),), training=True), ConstantStimuli(((TASK, 4.0),))
    found = simulate(
        experiment(design=Sequential({"first": practice, "then": real})), Psychometric(2.0, 1.0), 1
    )
    assert (found["level"], found["number"]) == ([4.0], [2])


# What they went by --------------------------------------------------------------------
def test_the_cue_that_explains_the_answers_has_a_distance_of_d():
    """Answers by phase alone: its distance is that of a probit by statsmodels; work,
    which follows it loosely, has less.
    """
    from statsmodels.genmod.families import Binomial, links
    from statsmodels.genmod.generalized_linear_model import GLM

    rng = np.random.default_rng(2)
    phase = np.repeat([0.0, 1.0], 100) + 0.3 * rng.normal(size=200)
    work, force = phase + rng.normal(size=200), rng.normal(size=200)
    said = (phase - 0.5 + 0.6 * rng.normal(size=200) > 0).astype(float)
    found = distances({"force": force, "work": work, "phase": -phase}, said, d=1.5)
    assert [v.cue for v in found] == ["phase", "work", "force"]
    z = GLM(said, np.column_stack([np.ones(200), -phase]), family=Binomial(links.Probit())).fit(
        tol=1e-14
    )
    z_of = z.params[0] - z.params[1] * phase
    assert found[0].value == pytest.approx(z_of[z_of > 0].mean() - z_of[z_of <= 0].mean(), rel=1e-8)
    assert (
        found[0].slope == pytest.approx(z.params[1], rel=1e-8)
        and found[0].slope < 0 < found[1].slope
    )
    assert found[0].ratio == pytest.approx(found[0].value / 1.5)
    nearly = np.r_[np.zeros(100), 1 + 1e-6 * np.arange(100)]
    (far,) = distances({"cue": nearly}, np.r_[np.zeros(102), 1.0, 0.0, np.ones(96)])
    assert far.problem == "separated" and np.isnan(far.value), (
        "all that z is known by are trials that hardly differ"
    )
    parted = distances({"cue": said, "none": np.ones(200), "phase": phase}, said)
    assert [(v.cue, v.problem) for v in parted[1:]] == [
        ("cue", "separated"),
        ("none", "few"),
    ] and np.isnan(parted[1].value)


# What cannot be used ------------------------------------------------------------------
@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda t: Psychometric(1.0, 0.0)(t, None), "sigma"),
        (lambda t: Psychometric(1.0, 1.0, lapse=0.6)(t, None), "lapse = 0.6"),
        (lambda t: Psychometric({"a": 1.0}, 1.0)(t, None), "pse of condition 'k'"),
        (lambda t: Psychometric(1.0, 1.0)(Trial("k", t.stimuli, ("q",)), None), "no level"),
        (
            lambda t: Psychometric(1.0, 1.0, log=True)(
                Trial("k", t.stimuli, ("q",), -2.0), stream(1)
            ),
            "the level -2, and pse = 1: log10 needs both above 0",
        ),
        (
            lambda t: Psychometric(1.0, 1.0)(Trial("k", t.stimuli, ("q",), 1.0), stream(1)),
            "no scores",
        ),
        (lambda t: listener("cues")(t, stream(1)), "several figures"),
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
        (lambda t: simulate(experiment(), Psychometric(2.0, 1.0), 0), "participant"),
        (lambda t: simulate(experiment(), {"P01": Psychometric(2.0, 1.0)}, 2), "P02"),
        (
            lambda t: power(experiment(), lambda rng: None, lambda found: None, 1, experiments=0),
            "experiments",
        ),
        (lambda t: distances({}, [0, 1]), "one cue"),
        (lambda t: distances({"a": [1, 2]}, [0, 2]), "0 and 1"),
        (lambda t: distances({"a": [1, 2, 3]}, [0, 1]), r"\(3,\)"),
        (lambda t: distances({"a": [1, np.nan]}, [0, 1]), r"a\[1\]"),
    ],
)
def test_what_cannot_be_used_is_said(call, said):
    refused((BadValue, UnknownName), said, call, PAIR.trial(120.0, 1, 0))


def test_one_code_is_no_row_of_letters():
    """As a sequence, "P01" would be three people: P, 0 and 1."""
    refused(
        BadValue,
        "simulate: participants = 'P01' must be a whole number or a list",
        simulate,
        experiment(),
        Psychometric(2.0, 0.5),
        "P01",
    )
    refused(
        BadValue,
        "simulate: participants = 2.0 must be",
        simulate,
        experiment(),
        Psychometric(2.0, 0.5),
        2.0,
    )
