"""Designs: the levels of a staircase, orders that own their draws, squares, and states
that are plain data.
"""

import dataclasses as dc
import json
import math
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from experiments.some import SPRING, experiment
from refusals import refused

from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    Interleaved,
    OneInterval,
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
    williams,
)

PAIR = TwoInterval(
    "silent",
    "softer",
    Stimulus("squeeze", {"k": 2.0}),
    Stimulus("squeeze", {"A": 3.4}),
    "k",
    asks_less=True,
)
SOFT, FIRM = Stimulus("spring", {"k": 2.0}), Stimulus("spring", {"k": 9.0})
NAMED = OneInterval("a", "softer", {"first": SOFT, "second": FIRM})
PLAIN = TwoInterval("a", "softer", SOFT, Stimulus("spring"), "k")
STAIRS = Staircase(PAIR, start=5.0, bounds=(0.1, 100.0))


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


@pytest.mark.parametrize(
    ("design", "low", "high"),
    [
        (Staircase(PLAIN, 3.0, (1.0, 5.0), stuck=2, max_trials=30), 1.0, 5.0),
        (Staircase(PLAIN, 3.0, (2.5, 5.0), stuck=2, max_trials=30), 2.0, 5.0),  # its standard
        (Quest(PLAIN, (1.0, 5.0), means=(1.0, 5.0), deviations=(1.0, 9.0), trials=3), 1.0, 5.0),
        (ConstantStimuli(((PLAIN, 4.0), (PLAIN, 1.0)), 2), 1.0, 4.0),
        (
            ConstantStimuli(((NAMED, "first"), (NAMED, "second"))),
            2.0,
            9.0,
        ),
        (ConstantStimuli(((Roved(PLAIN, "k", 1.2), 4.0),), 2), 2.0 / 1.2, 4.8),
        (ConstantStimuli(((Roved(Roved(PLAIN, "k", 1.2), "k", 1.1), 4.0),), 2), 2.0 / 1.32, 5.28),
        *(
            (
                both(
                    {"a": ConstantStimuli(((PLAIN, 4.0),)), "b": ConstantStimuli(((PLAIN, 1.0),))}
                ),
                1.0,
                4.0,
            )
            for both in (Interleaved, Sequential)
        ),
    ],
)
@pytest.mark.parametrize("called", [False, True])
def test_a_design_stays_within_the_bounds_of_its_experiment_or_is_refused(
    design, low, high, called
):
    """A staircase of 1 to 300 ended an experiment of 0 to 100 at trial 48."""

    def make(low, high):
        of = (lambda who, session: design) if called else design
        made = experiment(design=of, bounds={"k": (low, high)})
        return made.designed("P01") and made

    made = make(low * (1 - 1e-12), high * (1 + 1e-12))
    for more in (True, False):
        for trial, _ in observed(design, 1, lambda t, rng, more=more: says(t, more), stream(1)):
            made.check(trial)
    for wrong in ((low + 0.01, high), (low, high - 0.01)):
        refused(BadValue, "is beyond its bounds", make, *wrong)


def test_staircase_of_the_paper_has_22_levels():
    found = levels(STAIRS, lambda k: k > 2.0)
    big, small = 10 ** (12 / 20), 10 ** (3 / 20)
    a, b = 5.0 / big, 5.0 / big * small
    assert found[:6] == pytest.approx([5.0, a, 5.0, a, 5.0, a], rel=1e-14)
    assert found[6:] == pytest.approx([b, b * small] * 8, rel=1e-14)
    assert round(found[1], 3) == 1.256


def test_no_staircase_passes_its_bounds_and_each_ends():
    design = Staircase(PAIR, 5.0, (1.5, 20.0), reversals=None, max_trials=9)
    answers = observed(design, 1, lambda trial, rng: says(trial, False), stream(1))
    trials = [trial for trial, _ in answers]
    assert [t.level for t in trials[1:]] == [5.0 * 10**0.6] + 7 * [20.0] and len(trials) == 9
    assert trials[2].wanted == pytest.approx(5.0 * 10**1.2)  # asked for, and not shown
    ended = {**design.init(1), "n": 9}
    refused(BadValue, "no trial of 9 is left", design.update, ended, Answer({"softer": "first"}))


@pytest.mark.parametrize("more", [False, True])
def test_a_staircase_ends_where_every_answer_asks_for_a_level_beyond_its_bound(more):
    """Somebody who is always wrong, or presses one key, was asked 1000 times; a fit
    then says that all answers are the same.
    """
    found = levels(Staircase(PAIR, 5.0, (1.5, 20.0), up=1, down=3), lambda k: more)
    assert found[-1] == (1.5 if more else 20.0) and found.count(found[-1]) == 20
    assert psychometric(found, [more] * len(found)).problems == ("few",)
    # on the bound, and no end of it: not all answers ask for more
    long = Staircase(PAIR, 20.0, (1.5, 20.0), down=3, reversals=99, max_trials=140)
    assert len(levels(long, [True, True, False] * 50)) == 140


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
        by = {s.name: s.params for s in t.stimuli}
        assert by == {"standard": {"k": 2.0}, "comparison": {"A": 3.4, "k": 5.0}}
        # the standard was softer: the comparison is more
        softer = "second" if t.stimuli[0].name == "comparison" else "first"
        assert t.scores[softer] == 1.0
    # noise of its own in each interval
    assert len({s.seed for t in trials for s in t.stimuli}) == 800


@pytest.mark.parametrize("make", [Interleaved, partial(Sequential, shuffle=True)])
def test_one_more_track_or_part_changes_no_other_draw(make):
    def seen(*names):
        design = make({n: Staircase(PAIR, (2.0, 9.0), (0.1, 20.0), reversals=4) for n in names})
        found = {}
        for t, _ in observed(design, 5, lambda t, rng: says(t, t.level > 2.0), stream(1)):
            found.setdefault(t.track, []).append((t.level, [(s.name, s.seed) for s in t.stimuli]))
        return found

    two, three = seen("high", "low"), seen("high", "new", "low")
    assert {k: three[k] for k in two} == two and len(three) == 3
    assert two["high"] != two["low"]


def test_interleaved_tracks_take_turns_at_random():
    design = Interleaved({n: Staircase(PAIR, 5.0, (0.1, 20.0)) for n in ("high", "low")})
    answers = observed(design, 1, lambda t, rng: says(t, t.level > 2.0), stream(1))
    order = [t.track for t, _ in answers]
    assert order.count("high") == order.count("low") == 22
    assert 10 < sum(a != b for a, b in pairwise(order)) < 35


def shown(design, seed=3):
    """The trials of a design whose questions are rated 1."""
    return [t for t, _ in observed(design, seed, lambda t, r: Answer({"q": 1}), stream(1))]


def test_parts_rest_between_and_nowhere_else():
    items = ((Rate("a", ("q",), Stimulus("bumps")), None),)
    part = ConstantStimuli(items, repeats=2, training=True)
    two = Sequential({"1": part, "2": part}, pause=60.0)
    trials = shown(two)
    assert [(t.track, t.pause) for t in trials] == [("1", 0), ("1", 0), ("2", 60), ("2", 0)]
    assert all(t.training for t in trials)
    assert trials[0].stimuli[0].seed != trials[2].stimuli[0].seed
    nested = shown(Sequential({"a": two, "b": part}, pause=90.0))
    assert [t.pause for t in nested] == [0.0, 0.0, 60.0, 0.0, 90.0, 0.0]


def test_a_state_is_plain_data_and_update_leaves_it_alone():
    both = Interleaved({"x": STAIRS, "y": STAIRS})
    listed = ConstantStimuli(((PAIR, 2.0), (PAIR, 4.0)), 2)
    found = Quest(PAIR, (1.5, 2.0, 2.5), (1.5, 2.5), (0.2, 0.4), trials=6)
    design = Sequential({"a": both, "b": listed, "c": found}, 60, True)
    state, shown = design.init(9), []
    while (trial := design.next(state)) is not None:
        shown.append(trial)
        text = json.dumps(state, allow_nan=False)
        assert Trial.from_dict(json.loads(json.dumps(trial.to_dict()))) == trial
        after = design.update(state, says(trial, trial.level > 2.0))
        assert json.dumps(state) == text and after != state
        cold = json.loads(text)  # as a resumed session has it
        assert design.next(cold) == trial
        assert design.update(cold, says(trial, trial.level > 2.0)) == after
        state = after
    assert len({s.seed for t in shown if t.track == "c" for s in t.stimuli}) == 2 * 6


@pytest.mark.parametrize("n", [3, 4, 5, 7, 8, 9, 10, 12, 14, 18, 22, 26, 30, 32])
def test_graeco_latin_squares_are_orthogonal(n):
    square = graeco_latin(n)
    assert len({tuple(pair) for pair in square.reshape(-1, 2).tolist()}) == n * n
    for letters in (square[:, :, 0], square[:, :, 1]):
        for axis, wanted in ((0, np.arange(n)[:, None]), (1, np.arange(n))):
            assert (np.sort(letters, axis) == wanted).all()


def test_streams_are_their_words():
    assert stream(1, "a", 1).random() != stream(1, "a", 2).random() != stream(2, "a", 2).random()
    assert stream(1, "ab", "c").random() != stream(1, "a", "bc").random()
    assert 0 <= seed_of(2**64 - 1, "x") < 2**53
    # a session that goes on draws what it would have drawn
    assert stream(1, "a").random() == 0.24298954765102643
    assert seed_of(1, "x") == 2552818200496343
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


def stairs(**words):
    return Staircase(**{"task": PAIR, "start": 5.0, "bounds": (0.1, 20.0)} | words)


def quest(**words):
    return Quest(**{"task": PAIR, "levels": (1.0, 2.0), "means": (1.0,)} | words)


ODD = OneInterval("c", "q", {"red": Stimulus("s"), "green": Stimulus("s")})


NORMAL = {"deviations": (1.0,)}


@pytest.mark.parametrize(
    ("made", "words", "why"),
    [
        (stairs, {"start": 30.0}, "start = 30.0 violates"),
        (stairs, {"start": (5.0, 4.0)}, "violates"),
        (stairs, {"bounds": (0.0, 20.0)}, "above 0"),
        (stairs, {"bounds": (5.0, 5.0)}, "rise from"),
        (stairs, {"bounds": (0.1, np.inf)}, "must be numbers"),
        (stairs, {"steps": ()}, "dB above 0"),
        (stairs, {"steps": (0.0,)}, "dB above 0"),
        (stairs, {"steps": 3.0}, "steps = 3.0 must be a tuple"),
        *((stairs, {name: 0}, f"{name} = 0") for name in ("reversals", "up", "down", "stuck")),
        (stairs, {"max_trials": 0}, "max_trials = 0"),
        (stairs, {"reversals": 2.5}, "reversals = 2.5 must be a whole"),
        (stairs, {"task": (PAIR, 5.0)}, "task = .* must be a task"),
        (stairs, {"task": dc.replace(PAIR, detection=True)}, "chance level.*give down=3"),
        (
            stairs().update,
            dict(state=stairs().init(1), answer=Answer({"softer": "x"})),
            "no choice",
        ),
        (stairs().update, dict(state=stairs().init(1), answer=Answer({"q": "x"})), "not answered"),
        (quest, {}, "give deviations .* or slopes"),
        (quest, NORMAL | {"slopes": (1.0,)}, "give deviations .* or"),
        (quest, {"slopes": (0.0,)}, "slopes must be above 0"),
        (quest, {"deviations": (0.0,)}, "must be above 0"),
        (quest, NORMAL | {"lapses": (0.5,)}, "to below 0.5"),
        (quest, NORMAL | {"trials": 0}, "trials"),
        (quest, NORMAL | {"guesses": (1.0,)}, "guesses = .* to below 1"),
        (quest, {"slopes": (1.0,), "means": (0.0,)}, "means above 0"),
        (quest, {"slopes": (1.0,), "levels": (-1.0,)}, "levels of 0"),
        (quest, NORMAL | {"levels": ()}, "one of each"),
        (quest, NORMAL | {"levels": 1.0}, "levels = 1.0 must be a tuple"),
        (quest, NORMAL | {"means": ("a",)}, r"means = \('a',\) must be a tuple"),
        (quest, {"deviations": (1.0, math.nan)}, "deviations = .* finite"),
        (quest, NORMAL | {"means": (1.0, math.inf)}, "means = .* finite"),
        (ConstantStimuli, {"items": (PAIR, 5.0)}, "items = .* must be a tuple"),
        (ConstantStimuli, {"items": zip([PAIR], [5.0], strict=True)}, "must be a tuple"),
        (ConstantStimuli, {"items": ((PAIR, 5.0),), "repeats": 2.5}, "repeats = 2.5"),
        (ConstantStimuli, {"items": ((PAIR, 5.0),), "repeats": 0}, "at least 1"),
        (ConstantStimuli, {"items": ((PAIR, 1.0),) * 2}, "twice"),
        (
            ConstantStimuli,
            {"items": ((PAIR, 1.0),), "repeats": 2, "shuffle": "apart"},
            "two items or more",
        ),
        *((williams, {"n": n}, f"n = {n} must be .* 2 to 1000") for n in (1, 0, -4, 1001)),
        (williams, {"n": 2.5}, "n = 2.5 must be a whole number"),
        (Interleaved, {"tracks": [STAIRS]}, "tracks = .* must be a dict"),
        (Interleaved, {"tracks": {}}, "name of its track"),
        (Sequential, {"parts": [STAIRS]}, "parts = .* must be a dict"),
        (Sequential, {"parts": {}}, "name of its part"),
        (Sequential, {"parts": {"a": PAIR}}, "parts = {'a': TwoInterval.* must be a dict"),
        (partial(dc.replace, PAIR), {"standard": "s"}, "standard = 's' must be a Stimulus"),
        (
            OneInterval,
            dict(condition="c", question="q", stimuli={"a": Stimulus("s")}),
            "two stimuli",
        ),
        (ODD.trial, dict(level="blue", seed=1, n=0), "no stimulus 'blue'"),
        (graeco_latin, {"n": 4.0}, "n = 4.0 must be a whole"),
        *((graeco_latin, {"n": n}, f"{n}.*that has a square") for n in (1, 2, 6, 33)),
        (partial(check_graeco_latin, graeco_latin(4)[:, :, [0, 0]]), {}, "0, 0. is there 4 times"),
        (partial(check_graeco_latin, np.tile([[0], [1], [2]], (3, 1, 2))), {}, "column 1 .*Greek"),
        *(
            (check_graeco_latin, {"square": np.zeros(shape)}, "shape .n, n, 2., got")
            for shape in ((3, 2, 2), (2, 3, 2), (3, 3, 1))
        ),
        *((partial(stream, wrong, "a"), {}, "seed") for wrong in (-1, 1.0, True, 2**64)),
        (partial(turn_of, "Anna", 3), {}, "number at the end"),
        (partial(shuffled, 1, "x"), {"names": ["a", "b", "a"]}, "each must be there once"),
        (experiment, {"questions": choice("q", "?", "first", "second")}, "questions = .* a tuple"),
        (experiment, {"questions": ("q",)}, "questions = .* must be a tuple"),
        (experiment, {"scenes": [SPRING]}, "scenes = .* must be a dict"),
        (experiment, {"timing": {"interval": 1.0}}, "timing = .* must be a Timing"),
        (experiment, {"design": PAIR}, "design = TwoInterval.* must be a design"),
        (
            experiment,
            {"design": ConstantStimuli(((dc.replace(PAIR, choices=("A", "B")), 4.0),))},
            "must be the same",
        ),
        (experiment, {"bounds": {"k": 500.0}}, "bounds = .* must be a dict"),
        (experiment, {"bounds": [("k", 0.0, 1.0)]}, "bounds = .* must be a dict"),
        (
            experiment,
            {"familiarisation": {"red": Stimulus("spring", {"k": 9.0})}},
            "familiarisation': k = 9 is",
        ),
        *(
            (partial(choice, "q", "?", *words), {"keys": keys}, "one key for each")
            for words, keys in (
                ("ab", "x"),
                ("ab", "xx"),
                ("ab", "x "),
                ("ab", "x\x1b"),
                ("aa", ""),
            )
        ),
        (partial(choice, "q", "?", "a"), {}, "one key for each"),
        *(
            (partial(ranking, "q", "?", *names), {}, "two names of one word")
            for names in (("a",), ("a", "a"), ("a", "two words"))
        ),
        (partial(rating, "q", "?", "low", "high", 1), {}, "most = 1 must be"),
        (partial(places, "q", "?", 0), {}, "most = 0 must be"),
    ],
)
def test_what_makes_no_sense_is_refused_where_it_is_made(made, words, why):
    refused((BadValue, UnknownName), why, made, **words)
