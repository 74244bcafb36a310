"""Designs: the levels of a staircase, orders that own their draws, squares, and states
that are plain data.
"""

import dataclasses as dc
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from laws import STRESS
from refusals import refused

import stimlib
from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    Experiment,
    Interleaved,
    OneInterval,
    Psychometric,
    Quest,
    Rate,
    Roved,
    Sequential,
    Staircase,
    Stimulus,
    Trial,
    TwoInterval,
    analogue,
    check_graeco_latin,
    choice,
    graeco_latin,
    observed,
    places,
    psychometric,
    ranking,
    rating,
    seed_of,
    shuffled,
    stream,
    turn_of,
)

PAIR = TwoInterval(
    "silent",
    "softer",
    Stimulus("squeeze", {"k": 2.0}),
    Stimulus("squeeze", {"A": 3.4}),
    "k",
    asks_less=True,
)
STAIRS = Staircase(PAIR, start=5.0, bounds=(0.1, 100.0))
SPRING = stimlib.Scene({"force": stimlib.Param("k", 100.0, "N/m") * stimlib.Input("x", "m")})


def says(trial: Trial, more: bool) -> Answer:
    return Answer(
        {trial.questions[0]: next(c for c, score in trial.scores.items() if score == more)}
    )


def levels(design, answers, seed=1):
    """Levels that a list of outcomes leads to; a function of the level answers for
    somebody.
    """
    state, found = design.init(seed), []
    while (trial := design.next(state)) is not None and (
        callable(answers) or len(found) < len(answers)
    ):
        found.append(trial.level)
        state = design.update(
            state,
            says(trial, answers(trial.level) if callable(answers) else answers[len(found) - 1]),
        )
    return found


# The levels that a design may reach -------------------------------------------------
K = st.integers(1, 300).map(float)
LEVELS = st.lists(K, min_size=2, max_size=4, unique=True).map(sorted).map(tuple)


@st.composite
def designs(draw, depth=2):
    """Return a design over a spring, and all values that bound those of its trials."""
    standard, levels, rove = draw(K), draw(LEVELS), draw(st.sampled_from([1.0, 1.2]))
    kind = draw(st.sampled_from(["stairs", "quest", "constant", "one", "both"][: 3 + depth]))
    if kind == "both":
        parts = {"a": draw(designs(depth=0)), "b": draw(designs(depth=0))}
        made = draw(st.sampled_from([Interleaved, Sequential]))
        return made({k: d for k, (d, _) in parts.items()}), [
            v for _, w in parts.values() for v in w
        ]
    spring = Stimulus("spring", {"k": standard})
    task = TwoInterval("a", "softer", spring, Stimulus("spring"), "k")
    values = [standard, *levels]
    if kind == "one":  # and a catch trial
        two = {"first": spring, "second": Stimulus("spring", {"k": levels[0]})}
        task, levels, values = OneInterval("a", "softer", two), tuple(two), values[:2]
    if rove > 1 and kind != "quest":
        task, values = Roved(task, "k", rove), [v * f for v in values for f in (1 / rove, rove)]
        if draw(st.booleans()):
            task, values = Roved(task, "k", 1.1), [v * f for v in values for f in (1 / 1.1, 1.1)]
    if kind == "stairs":
        return Staircase(task, levels[0], (levels[0], levels[-1]), stuck=2, max_trials=30), values
    if kind == "quest":
        means, n = (levels[0], levels[-1]), 3
        return Quest(task, levels, means=means, deviations=(10.0, 90.0), trials=n), values
    return ConstantStimuli(tuple((task, level) for level in levels), repeats=2), values


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    designs(), st.sampled_from([-0.25, 0, 0.25]), st.sampled_from([-0.25, 0, 0.25]), st.booleans()
)
def test_a_design_stays_within_the_bounds_of_its_experiment_or_is_refused(
    drawn, below, above, called
):
    """A staircase of 1 to 300 ended an experiment of 0 to 100 at trial 48."""
    design, values = drawn
    low = min(values) - below
    high = max(max(values) + above, low + 0.1)
    words = {"scenes": {"spring": SPRING}, "bounds": {"k": (low, high)}, "fs": 1000.0}
    words |= {"questions": (choice("softer", "?", "first", "second"),), "safety": 10.0}

    def make():
        if not called:
            return Experiment("a", "1", design=design, **words)
        made = Experiment("a", "1", design=lambda who, session: design, **words)
        return made.designed("P01") and made

    if min(below, above) < 0:
        refused(BadValue, "is beyond its bounds, .*; keep all levels", make)
        return
    made = make()
    for who in (lambda trial, rng: says(trial, True), lambda trial, rng: says(trial, False)):
        for trial, _ in observed(design, 1, who, stream(1, "who")):
            made.check(trial)


def test_what_is_explored_before_the_session_is_within_the_bounds():
    words = {"scenes": {"spring": SPRING}, "bounds": {"k": (1.0, 50.0)}, "fs": 1000.0}
    words |= {"questions": (choice("softer", "?", "first", "second"),), "safety": 10.0}
    task = Rate("a", ("softer",), Stimulus("spring", {"k": 2.0}))
    words |= {"design": ConstantStimuli(((task, None),))}
    known = {"red": Stimulus("spring")}  # which leaves its 100 N/m
    refused(
        BadValue,
        "familiarisation': k = 100 is",
        Experiment,
        "a",
        "1",
        **words,
        familiarisation=known,
    )


# The up-down rule as PsychoPy's StairHandler has it, written down from its documentatio
def reference(answers, level, up, down, steps, low, high):
    found, way, run, turns = [], 0, 0, 0
    for more in answers:
        found.append(level)
        run = (
            run + 1
            if more and run >= 0
            else run - 1
            if not more and run <= 0
            else 1
            if more
            else -1
        )
        needed = 1 if turns == 0 else down if more else up
        if abs(run) >= needed:
            new = -1 if more else 1
            turns += way == -new
            way, run = new, 0
            factor = 10 ** (steps[min(turns, len(steps) - 1)] / 20)
            level = level / factor if more else level * factor
            level = low if level < low else high if level > high else level
    return found


def test_staircase_of_the_paper_has_22_levels():
    found = levels(STAIRS, lambda k: k > 2.0)
    big, small = 10 ** (12 / 20), 10 ** (3 / 20)
    a, b = 5.0 / big, 5.0 / big * small
    assert found[:6] == pytest.approx([5.0, a, 5.0, a, 5.0, a], rel=1e-14)
    assert found[6:] == pytest.approx([b, b * small] * 8, rel=1e-14)
    assert round(found[1], 3) == 1.256


@pytest.mark.parametrize("up, down", [(1, 1), (1, 2), (2, 1), (1, 3)])
def test_staircase_is_the_up_down_rule_on_any_answers(up, down):
    answers = stream(3, up, down).integers(2, size=120).astype(bool).tolist()
    design = Staircase(
        PAIR, 5.0, (0.5, 20.0), steps=(8.0, 4.0, 2.0), reversals=10**6, up=up, down=down
    )
    assert levels(design, answers) == pytest.approx(
        reference(answers, 5.0, up, down, (8.0, 4.0, 2.0), 0.5, 20.0), rel=1e-12
    )


def test_no_staircase_passes_its_bounds_and_each_ends():
    state, trials = (design := Staircase(PAIR, 5.0, (1.5, 20.0), max_trials=9)).init(1), []
    while (trial := design.next(state)) is not None:
        trials.append(trial)
        state = design.update(state, says(trial, False))
    assert [t.level for t in trials[1:]] == [5.0 * 10**0.6] + 7 * [20.0] and len(trials) == 9
    assert trials[2].wanted == pytest.approx(5.0 * 10**1.2)  # asked for, and not shown
    refused(BadValue, "ended after 9 trials", design.update, state, Answer({"softer": "first"}))


@pytest.mark.parametrize("more", [False, True])
def test_a_staircase_ends_where_every_answer_asks_for_a_level_beyond_its_bound(more):
    """Somebody who is always wrong, or presses one key, was asked 1000 times; a fit
    then says that all answers are the same.
    """
    found = levels(Staircase(PAIR, 5.0, (1.5, 20.0), up=1, down=3), lambda k: more)
    assert found[-1] == (1.5 if more else 20.0) and found.count(found[-1]) == 20
    assert psychometric(found, [more] * len(found)).problems == ("few",)
    # on the bound, and no end of it: not all answers ask for more
    turns = iter([True, True, False] * 50)
    assert (
        len(
            levels(
                Staircase(PAIR, 20.0, (1.5, 20.0), down=3, reversals=99, max_trials=140),
                lambda k: next(turns),
            )
        )
        == 140
    )


def test_a_pair_knows_whether_it_is_a_detection():
    silent = TwoInterval("felt", "which", Stimulus("tone", {"A": 0}), Stimulus("tone"), "A")
    assert PAIR.chance is None and silent.chance == 0.5
    assert (
        dc.replace(PAIR, detection=True).chance == 0.5
        and dc.replace(silent, detection=False).chance is None
    )
    trial = silent.trial(0.2, seed=1, n=0)
    assert trial.chance == 0.5 and Trial.from_dict(trial.to_dict()) == trial
    old = {name: value for name, value in trial.to_dict().items() if name != "chance"}
    assert Trial.from_dict(old).chance is None  # a log of 0.2.0


@pytest.mark.parametrize(
    "wrong, why",
    [
        ({"start": 30.0}, "start = 30.0 violates the bounds, 0.1 to 20"),
        ({"start": (5.0, 4.0)}, "violates"),
        ({"bounds": (0.0, 20.0)}, "rise from a level above 0"),
        ({"bounds": (5.0, 5.0)}, "rise from"),
        ({"bounds": (0.1, np.inf)}, "must be numbers"),
        ({"steps": ()}, "dB above 0"),
        ({"steps": (0.0,)}, "dB above 0"),
        ({"reversals": 0}, "reversals = 0"),
        ({"up": 0}, "up = 0"),
        ({"down": 0}, "down = 0"),
        ({"max_trials": 0}, "max_trials = 0"),
        ({"stuck": 0}, "stuck = 0"),
        ({"task": dc.replace(PAIR, detection=True)}, "chance level of this task; give down=3"),
    ],
)
def test_a_staircase_that_makes_no_sense(wrong, why):
    refused(BadValue, why, Staircase, **{"task": PAIR, "start": 5.0, "bounds": (0.1, 20.0)} | wrong)


def test_a_start_is_drawn_between_its_two_levels_and_from_a_stream_of_its_own():
    design = Staircase(PAIR, (4.0, 5.0), (0.1, 20.0))
    starts = np.array([design.init(seed)["level"] for seed in range(400)])
    assert (
        4.0 <= starts.min() < 4.05
        and 4.95 < starts.max() <= 5.0
        and abs(starts.mean() - 4.5) < 0.05
    )
    assert design.init(7)["level"] == 4.0 + stream(7, "start").random()


def test_order_of_a_pair_is_random_and_scores_follow_it():
    trials = [PAIR.trial(5.0, seed=2, n=n) for n in range(400)]
    first = np.array([t.stimuli[0].name == "comparison" for t in trials])
    assert 160 < first.sum() < 240 and abs(np.corrcoef(first[1:], first[:-1])[0, 1]) < 0.15
    for t in trials[:20]:
        standard = next(i for i, s in enumerate(t.stimuli) if s.name == "standard")
        # the standard was softer: the comparison is more
        assert t.scores[("first", "second")[standard]] == 1.0
        assert t.stimuli[standard].params == {"k": 2.0} and t.stimuli[1 - standard].params == {
            "A": 3.4,
            "k": 5.0,
        }
    # noise of its own in each interval
    assert len({s.seed for t in trials for s in t.stimuli}) == 800


def test_one_more_track_or_part_changes_no_other_draw():
    def seen(*names, make):
        design = make({n: Staircase(PAIR, (2.0, 9.0), (0.1, 20.0), reversals=4) for n in names})
        found = {}
        for trial, _ in observed(
            design, 5, lambda t, rng: says(t, t.level > 2.0), np.random.default_rng(1)
        ):
            found.setdefault(trial.track, []).append(
                (trial.level, [(s.name, s.seed) for s in trial.stimuli])
            )
        return found

    for make in (Interleaved, lambda parts: Sequential(parts, shuffle=True)):
        two, three = seen("high", "low", make=make), seen("high", "new", "low", make=make)
        assert {k: three[k] for k in two} == two and len(three) == 3
    assert (
        seen("high", "low", make=Interleaved)["high"]
        != seen("high", "low", make=Interleaved)["low"]
    )


def test_interleaved_tracks_take_turns_at_random():
    tracks = {n: Staircase(PAIR, 5.0, (0.1, 20.0)) for n in ("high", "low")}
    answers = observed(
        Interleaved(tracks), 1, lambda t, rng: says(t, t.level > 2.0), np.random.default_rng(1)
    )
    order = [t.track for t, _ in answers]
    assert order.count("high") == order.count("low") == 22
    turns = sum(a != b for a, b in zip(order, order[1:], strict=False))
    assert 10 < turns < 35


def test_listed_trials_come_each_as_often_as_asked():
    task = OneInterval("0.25", "bouncier", {"red": Stimulus("S1"), "green": Stimulus("S2")})
    shown = [
        t
        for t, _ in observed(
            ConstantStimuli(((task, "red"), (task, "green")), 50),
            3,
            lambda t, r: Answer({"bouncier": "red"}),
            stream(1, "observer"),
        )
    ]
    names = [t.stimuli[0].name for t in shown]
    assert names.count("red") == names.count("green") == 50 and names[:50].count("red") not in (
        0,
        50,
    )
    assert all(
        t.correct == {"bouncier": n} and t.scores == {"red": 1.0, "green": 0.0}
        for t, n in zip(shown, names, strict=True)
    )


def test_each_repeat_by_itself_and_as_listed():
    tasks = tuple((Rate(f"{i}", ("rough",), Stimulus("bumps")), None) for i in range(8))
    rate = lambda t, rng: Answer({"rough": 4})  # noqa: E731
    each = [
        t.condition
        for t, _ in observed(ConstantStimuli(tasks, 3, "each"), 3, rate, stream(1, "observer"))
    ]
    assert [sorted(each[i : i + 8]) for i in (0, 8, 16)] == 3 * [[str(i) for i in range(8)]]
    assert each[:8] != each[8:16]
    assert [
        t.condition
        for t, _ in observed(ConstantStimuli(tasks, 2, "none"), 3, rate, stream(1, "observer"))
    ] == 2 * [str(i) for i in range(8)]
    assert [
        t.condition for t, _ in observed(ConstantStimuli(tasks, 1), 4, rate, stream(1, "observer"))
    ] != each[:8]  # another participant, another order


def test_parts_rest_between_and_nowhere_else():
    part = ConstantStimuli(
        ((Rate("a", ("rough",), Stimulus("bumps")), None),), repeats=2, training=True
    )
    trials = [
        t
        for t, _ in observed(
            Sequential({"1": part, "2": part}, pause=60.0),
            1,
            lambda t, r: Answer({"rough": 1}),
            stream(1, "observer"),
        )
    ]
    assert [t.pause for t in trials] == [0.0, 0.0, 60.0, 0.0] and [t.track for t in trials] == [
        "1",
        "1",
        "2",
        "2",
    ]
    nested = Sequential(
        {"a": Sequential({"1": part, "2": part}, pause=60.0), "b": part}, pause=90.0
    )
    assert [
        t.pause
        for t, _ in observed(nested, 1, lambda t, r: Answer({"rough": 1}), stream(1, "observer"))
    ] == [
        0.0,
        0.0,
        60.0,
        0.0,
        90.0,
        0.0,
    ]
    assert (
        all(t.training for t in trials) and trials[0].stimuli[0].seed != trials[2].stimuli[0].seed
    )


DESIGNS = {
    "staircase": STAIRS,
    "interleaved": Sequential(
        {
            "a": Interleaved({"x": STAIRS, "y": STAIRS}),
            "b": ConstantStimuli(((PAIR, 2.0), (PAIR, 4.0)), 2),
        },
        60,
        True,
    ),
}


@pytest.mark.parametrize("name", DESIGNS)
def test_a_state_is_plain_data_and_update_leaves_it_alone(name):
    design = DESIGNS[name]
    state = design.init(9)
    for _ in range(12):
        text = json.dumps(state, allow_nan=False)
        trial = design.next(state)
        assert Trial.from_dict(json.loads(json.dumps(trial.to_dict()))) == trial
        after = design.update(state, says(trial, trial.level > 2.0))
        assert json.dumps(state) == text and after != state
        assert design.update(json.loads(text), says(trial, trial.level > 2.0)) == after
        state = after


def test_an_answer_that_is_none():
    state = STAIRS.init(1)
    refused(
        BadValue,
        "softer: 'third' is no choice; there are first, second",
        STAIRS.update,
        state,
        Answer({"softer": "third"}),
    )
    refused(BadValue, "'softer' is not answered", STAIRS.update, state, Answer({"other": "first"}))


def test_quest_finds_the_mean_and_goes_on_from_its_state():
    design = Quest(
        PAIR, (1.0, 1.5, 2.0, 2.5, 3.0, 3.5), (1.5, 2.0, 2.5, 3.0), (0.2, 0.4), trials=10
    )
    state, trials = design.init(1), []
    while (trial := design.next(state)) is not None:
        trials.append(trial)
        state = design.update(state, says(trial, trial.level > 2.4))
    assert abs(design.estimate(state)["mean"].value - 2.4) < 0.25 and {t.level for t in trials} == {
        2.0,
        2.5,
    }
    assert len(trials) == 10 == len({t.stimuli[0].seed for t in trials})
    again = dc.replace(design, trials=11)  # nothing of it is known yet: as a resumed session has it
    cold = {k: v if k == "seed" else v[:9] for k, v in state.items()}
    assert again.next(cold) == trials[9]


def test_quest_finds_a_threshold_where_half_is_guessed():
    """As a comparison's, its curve had to be flat and low: the levels stayed far from a
    threshold of 0.1.
    """
    task = TwoInterval("felt", "which", Stimulus("tone", {"A": 0.0}), Stimulus("tone"), "A")
    steps = tuple(0.02 * k for k in range(1, 16))
    design = Quest(task, steps, steps, (0.02, 0.05), trials=50)
    observer = Psychometric(0.1, 0.03, lapse=0.02)
    state = design.init(1)
    rng = stream(5, "observer")
    while (trial := design.next(state)) is not None:
        state = design.update(state, observer(trial, rng))
    assert design.estimate(state)["mean"].value == pytest.approx(0.1, abs=0.025)
    assert design.estimate(state)["guess"].value == pytest.approx(0.5, rel=1e-12)


def test_quest_goes_on_after_many_answers_and_after_a_slip():
    """A session of any length is read back, and no answer leaves all curves at 0."""
    rows = ((1.0, 1.5, 2.0, 2.5, 3.0), (1.5, 2.0, 2.5), (0.2, 0.4))
    long = Quest(PAIR, *rows, trials=3000)
    state = {"seed": 1, "levels": [1.5, 2.5] * 1000, "outcomes": [0, 1] * 1000}
    assert long.estimate(state)["mean"].value == pytest.approx(2.0, abs=1e-9)
    assert long.next(state).level in rows[0]
    weibull = Quest(PAIR, (0.0, 0.5, 1.0, 2.0), (0.8, 1.6), slopes=(2.0,), lapses=(0.0,))
    assert weibull.next(weibull.init(1)).level > 0.0  # at 0 nothing is learnt
    sharp = Quest(PAIR, (1.0, 2.0, 3.0), (1.5, 2.5), (1e-3,), lapses=(0.0,))
    slip = {"seed": 1, "levels": [1.0, 2.0, 1.0], "outcomes": [0, 1, 1]}
    assert 1.5 <= sharp.estimate(slip)["mean"].value <= 2.5


FELT = TwoInterval("felt", "which", Stimulus("tone", {"A": 0.0}), Stimulus("tone"), "A")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["comparison", "detection", "weibull", "yes-no"])
def test_quest_has_the_levels_and_estimates_of_the_package_questplus(kind):
    """Levels equal, estimates to rounding: 1000 runs of these kinds were, by hand."""
    from questplus import QuestPlus

    rng = stream(3, kind)
    for _ in range(6 if STRESS else 3):
        rows = {
            "levels": np.sort(rng.uniform(0.1, 3.0, rng.integers(3, 12))),
            "means": np.sort(rng.uniform(0.2, 2.5, rng.integers(1, 9))),
            "lapses": rng.uniform(0.0, 0.1, 2),
        }
        wide = rng.uniform(0.1, 1.0, 3)
        steep = kind in ("weibull", "yes-no")
        rows |= {"slopes": 5 * wide} if steep else {"deviations": wide}
        rows |= {"guesses": (0.0, 0.1, 0.2)} if kind == "yes-no" else {}
        design = Quest(FELT if kind in ("detection", "weibull") else PAIR, **rows, trials=15)
        low = {"comparison": {}, "yes-no": {"lower_asymptote": [0.0, 0.1, 0.2]}}
        theirs = QuestPlus(
            stim_domain={"intensity": list(design.levels)},
            param_domain={
                "threshold" if steep else "mean": list(design.means),
                "slope" if steep else "sd": list(design.slopes or design.deviations),
                "lapse_rate": list(design.lapses),
                **low.get(kind, {"lower_asymptote": [0.5]}),
            },
            outcome_domain={"response": ["yes", "no"]},
            func="weibull" if steep else "norm_cdf_2" if kind == "comparison" else "norm_cdf",
            stim_scale="linear",
        )
        state = design.init(1)
        while (trial := design.next(state)) is not None:
            assert trial.level == theirs.next_stim["intensity"]
            more = bool(rng.random() < 0.6)
            theirs.update(
                stim={"intensity": trial.level}, outcome={"response": "yes" if more else "no"}
            )
            state = {
                **state,
                "levels": [*state["levels"], trial.level],
                "outcomes": [*state["outcomes"], int(more)],
            }
        np.testing.assert_allclose(
            [found.value for found in design.estimate(state).values()],
            list(theirs.param_estimate.values()),
            rtol=1e-12,
        )


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ({}, "give deviations for a normal curve, or slopes for a Weibull"),
        ({"deviations": (1.0,), "slopes": (1.0,)}, "give deviations for a normal curve, or"),
        ({"slopes": (0.0,)}, "deviations and slopes must be above 0"),
        ({"deviations": (1.0,), "lapses": (0.5,)}, "lapses from 0 to below 0.5"),
        ({"deviations": (1.0,), "guesses": (1.0,)}, "guesses = .* must be from 0 to below 1"),
        ({"slopes": (1.0,), "means": (0.0,)}, "means above 0 and levels of 0 or above"),
        ({"slopes": (1.0,), "levels": (-1.0,)}, "means above 0 and levels of 0 or above"),
        ({"deviations": (1.0,), "levels": ()}, "one of each at least"),
        ({"deviations": (1.0, math.nan)}, "deviations = .* finite numbers"),
        ({"deviations": (1.0,), "means": (1.0, math.inf)}, "means = .* finite numbers"),
    ],
)
def test_quest_refuses_what_is_no_curve(words, why):
    usual = {"levels": (1.0, 2.0), "means": (1.0,)}
    refused(BadValue, f"Quest: .*{why}", Quest, PAIR, **usual | words)


@pytest.mark.parametrize("n", [3, 4, 5, 7, 8, 9, 10, 12, 14, 18, 22, 26, 30, 32])
def test_graeco_latin_squares_are_orthogonal(n):
    square = graeco_latin(n)
    assert len({tuple(pair) for pair in square.reshape(-1, 2).tolist()}) == n * n
    for letters in (square[:, :, 0], square[:, :, 1]):
        assert (np.sort(letters, 0) == np.arange(n)[:, None]).all() and (
            np.sort(letters, 1) == np.arange(n)
        ).all()


def test_squares_that_are_none():
    refused(BadValue, "graeco_latin: n = 4.0 must be a whole number", graeco_latin, 4.0)
    for n in (1, 2, 6, 33):
        refused(BadValue, f"graeco_latin.{n}.*take one that has a square", graeco_latin, n)
    square = graeco_latin(4)
    same = square.copy()
    same[:, :, 1] = same[:, :, 0]
    refused(BadValue, "pair .0, 0. is there 4 times", check_graeco_latin, same)
    refused(
        BadValue,
        "column 1 has not each Greek letter once",
        check_graeco_latin,
        np.tile(np.arange(3)[:, None], (3, 1, 2)),
    )
    for shape in ((3, 2, 2), (2, 3, 2), (3, 3, 1)):
        refused(
            BadValue,
            f"shape .n, n, 2., got .{shape[0]}, {shape[1]}, {shape[2]}",
            check_graeco_latin,
            np.zeros(shape),
        )
    square[0, 0, 1] = 1
    refused(BadValue, "row 1 has not each Latin letter once", check_graeco_latin, square)


def test_streams_are_their_words():
    assert stream(1, "a", 1).random() != stream(1, "a", 2).random() != stream(2, "a", 2).random()
    assert stream(1, "ab", "c").random() != stream(1, "a", "bc").random()
    assert 0 <= seed_of(2**64 - 1, "x") < 2**53
    # a session that goes on draws what it would have drawn
    assert stream(1, "a").random() == 0.24298954765102643
    assert seed_of(1, "x") == 2552818200496343
    for wrong in (-1, 1.0, True, 2**64):
        refused(BadValue, "seed", stream, wrong, "a")


def test_turns_go_by_the_number_of_the_participant():
    assert [turn_of(f"P{i}", 3) for i in (1, 2, 3, 4)] == [0, 1, 2, 0] and turn_of("G2-P03", 4) == 2
    refused(BadValue, "number at the end", turn_of, "Anna", 3)
    assert sorted(shuffled(1, "x", ["a", "b", "c"])) == ["a", "b", "c"]


@pytest.mark.parametrize(
    "question, good, bad",
    [
        (choice("q", "?", "yes", "no", keys="yn"), "yes", ["y", 1, None]),
        (rating("q", "?", "smooth", "rough"), 7, [0, 8, 3.0, True, "3"]),
        (analogue("q", "?", "smooth", "rough"), 0, [-0.1, 100.1, True, "3", float("nan")]),
        (analogue("q", "?", "smooth", "rough"), 100, [101]),
        (ranking("q", "?", "A", "B", "C"), ["C", "A", "B"], [["A", "B"], ["A", "A", "B"], "ABC"]),
        (
            places("q", "?", 2),
            [[0.1, 0.2], [0.3, 0.4]],
            [[[0, 1], [1, 2], [2, 3]], [[1]], [["a", "b"]], [[float("nan"), 0.0]]],
        ),
    ],
)
def test_answers_are_held_against_their_question(question, good, bad):
    question.check(good)
    question.check(question.guess(np.random.default_rng(1)))
    for value in bad:
        refused(BadValue, "q: .* is no answer; answer ", question.check, value)


def test_questions_and_tasks_that_make_no_sense():
    for words, keys in (
        (("a", "b"), "x"),
        (("a", "b"), "xx"),
        (("a", "b"), "x "),
        (("a", "b"), "x\x1b"),
        (("a", "a"), ""),
        (("a",), ""),
    ):
        refused(BadValue, "one key for each", choice, "q", "?", *words, keys=keys)
    for names in (("a",), ("a", "a"), ("a", "two words")):
        refused(BadValue, "two names of one word, each once", ranking, "q", "?", *names)
    for make, most in (
        (lambda n: rating("q", "?", "low", "high", n), 1),
        (lambda n: places("q", "?", n), 0),
    ):
        refused(BadValue, f"most = {most} must be", make, most)
    for wrong in ({"deviations": (0.0,)}, {"lapses": (0.5,)}, {"trials": 0}):
        refused(
            BadValue,
            "Quest: ",
            Quest,
            **{"task": PAIR, "levels": (1.0,), "means": (1.0,), "deviations": (1.0,)} | wrong,
        )
    refused(BadValue, "two stimuli", OneInterval, "c", "q", {"one": Stimulus("s")})
    refused(
        UnknownName,
        "no stimulus 'blue'",
        OneInterval("c", "q", {"red": Stimulus("s"), "green": Stimulus("s")}).trial,
        "blue",
        1,
        0,
    )
    refused(BadValue, "twice", ConstantStimuli, ((PAIR, 1.0), (PAIR, 1.0)))
    refused(BadValue, "repeats of at least 1", ConstantStimuli, ((PAIR, 1.0),), repeats=0)


@pytest.mark.parametrize(("made", "what"), [(Sequential, "part"), (Interleaved, "track")])
def test_designs_of_nothing(made, what):
    refused(
        BadValue, f"{made.__name__}: give at least one design, by the name of its {what}", made, {}
    )


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (
            lambda: Staircase(PAIR, 5.0, (0.1, 100.0), steps=3.0),
            "Staircase: steps = 3.0 must be a tuple",
        ),
        (
            lambda: Staircase(PAIR, 5.0, (0.1, 100.0), reversals=2.5),
            "Staircase: reversals = 2.5 must be a whole number",
        ),
        (
            lambda: Staircase((PAIR, 5.0), 5.0, (0.1, 100.0)),
            "Staircase: task = .* must be a task, such as TwoInterval",
        ),
        (
            lambda: ConstantStimuli((PAIR, 5.0)),
            (
                r"ConstantStimuli: items = .* must be a tuple \(a tuple \(a task, such as Two"
                r"Interval, any value\), ...\)"
            ),
        ),
        (
            lambda: ConstantStimuli(zip([PAIR], [5.0], strict=True)),
            "ConstantStimuli: items = .* must be a tuple",
        ),
        (lambda: ConstantStimuli(((PAIR, 5.0),), repeats=2.5), "ConstantStimuli: repeats = 2.5"),
        (
            lambda: Interleaved([STAIRS]),
            "Interleaved: tracks = .* must be a dict {name: a design, such as Staircase or Const",
        ),
        (
            lambda: Sequential([STAIRS]),
            "Sequential: parts = .* must be a dict {name: a design, such as",
        ),
        (
            lambda: Sequential({"a": PAIR}),
            (
                "Sequential: parts = {'a': TwoInterval.* must be a dict {name: a design, such as"
                " Staircase or ConstantStimuli"
            ),
        ),
        (
            lambda: TwoInterval("a", "q", "squeeze", Stimulus("squeeze"), "k"),
            "TwoInterval: standard = 'squeeze' must be a Stimulus",
        ),
    ],
)
def test_a_design_of_wrong_parts_is_refused_where_it_is_made(made, says):
    refused(BadValue, says, made)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            {"questions": choice("q", "?", "first", "second")},
            r"questions = .* must be a tuple \(a Question, ...\)",
        ),
        ({"questions": ("q",)}, "questions = .* must be a tuple"),
        ({"scenes": SPRING}, "scenes = .* must be a dict {name: a Scene"),
        (
            {"timing": {"interval": 1.0}},
            r"timing = .* must be a Timing, such as Timing\(interval=1.0\)",
        ),
        (
            {"design": PAIR},
            "design = TwoInterval.* must be a design, such as Staircase or ConstantStimuli, which",
        ),
        (
            {"bounds": {"k": 500.0}},
            "bounds = .* must be a dict {name: a tuple .a number, a number.}",
        ),
        ({"bounds": [("k", 0.0, 1.0)]}, "bounds = .* must be a dict"),
    ],
)
def test_an_experiment_of_wrong_parts_is_refused_where_it_is_made(words, says):
    usual = {
        "scenes": {"spring": SPRING},
        "design": STAIRS,
        "questions": (choice("q", "?", "first", "second"),),
        "fs": 1000.0,
    }
    refused(BadValue, says, Experiment, "e", "1", **{**usual, "safety": 10.0, **words})


def test_quest_and_a_trial_of_another_chance_level_are_refused():
    """Quest reads the task's, fits the trial's: of an odd-one-out in three it would
    search a curve without guesses.
    """

    class Oddity:
        condition = "odd"

        def trial(self, level, seed, n):
            return dc.replace(PAIR.trial(level, seed, n), chance=1 / 3)

    design = Quest(Oddity(), (1.0, 2.0), means=(1.0, 2.0), deviations=(0.5,))
    refused(
        BadValue,
        r"Quest: the task has the chance level None, its trial 0.333; give the task's class",
        design.next,
        design.init(seed=1),
    )
    Oddity.chance = 1 / 3
    assert design.next(design.init(seed=1)).chance == 1 / 3


def test_quest_takes_rows_of_numpy_and_lists():
    """As np.linspace gives them; a list failed at the first trial, an array where it
    was made.
    """
    plain = Quest(PAIR, (1.0, 1.5, 2.0), means=(1.0, 1.5), deviations=(0.5,), trials=3)
    rows = Quest(
        PAIR, np.linspace(1.0, 2.0, 3), means=[1.0, 1.5], deviations=np.array([0.5]), trials=3
    )
    assert rows == plain and rows.next(rows.init(seed=1)) == plain.next(plain.init(seed=1))
    refused(
        BadValue,
        "Quest: levels = 1.0 must be a tuple",
        Quest,
        PAIR,
        1.0,
        means=(1.0,),
        deviations=(0.5,),
    )
    refused(
        BadValue,
        r"Quest: means = \('a',\) must be a tuple",
        Quest,
        PAIR,
        (1.0,),
        means=("a",),
        deviations=(0.5,),
    )
