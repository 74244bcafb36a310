"""Sessions: presented to the sample, logged line by line, resumed after any end, and
refused where something was changed.
"""

import inspect
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from experiments.some import (
    QUESTION,
    SPRING,
    TASK,
    Own,
    experiment,
    nothing,
    observer,
    simulate,
    some,
    still,
)
from laws import assert_same, random_cuts, run as cut_run
from refusals import refused

import stimlib
import stimlib.experiments.random_streams
from stimlib.blocks import lowpass, timeline
from stimlib.design.texture import made_up
from stimlib.devices.calibration import Calibration
from stimlib.devices.null import NullSink
from stimlib.devices.sources import Live
from stimlib.errors import BadValue, SinkError, StimlibError, UnitError, UnknownName
from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    Cursor,
    Experiment,
    Masking,
    OneInterval,
    Rate,
    Record,
    Sequential,
    Simulated,
    Staircase,
    Stimulus,
    Timing,
    Trial,
    blinded,
    columns,
    outcome,
    prepare,
    present,
    program,
    rating,
    read,
    run,
    sessions,
    spans,
    status,
)
from stimlib.experiments.session import LOG, Session
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import replay
from stimlib.run.safety import Safety
from stimlib.scenes import SHIPPED


# Trials are scenes --------------------------------------------------------------------
def pair(seed=0, **other):
    return Trial(
        "a",
        (Stimulus("spring", {"k": 1.0}, seed), Stimulus("spring", {"k": 3.0}, seed)),
        ("softer",),
        **other,
    )


def test_intervals_are_there_to_the_sample_and_nothing_between(tmp_path):
    made = experiment()
    marks = []
    shown = present(made, pair(seed=5), "file", tmp_path / "a.stimlog", send=marks.append)
    assert [(m.name, m.value, m.sample) for m in marks] == [
        ("trial", 1.0, 0),
        ("stimulus", 1.0, 128),
        ("stimulus", 2.0, 278),
    ]
    assert (
        shown["intervals"] == [(128, 228), (278, 378)]
        and shown["delivered"] == shown["produced"] == 378 + 128
    )
    assert shown["peak"]["force"] == pytest.approx([1.0, 3.0], rel=1e-6) and shown["rms"][
        "force"
    ] == pytest.approx([1.0, 3.0], rel=1e-6)
    log = read_log(tmp_path / "a.stimlog")
    assert log.seed == 5 and replay(log).matches
    assert (tmp_path / "a.stimlog" / "delivered.caf").stat().st_size > 4 * shown["delivered"]
    scene, params = program(made, pair())
    force = stimlib.render(scene, {"x": still}, fs=1000, seconds=0.5, params=params)["force"]
    wanted = np.zeros(500)
    wanted[128:228], wanted[278:378] = 1.0, 3.0
    assert (force == wanted).all()


def window(long, ramp, fs):
    """Raised cosines within the interval, written again."""
    t = np.arange(long) / fs
    edge = np.minimum(np.minimum(t, long / fs - t), ramp) / ramp if ramp else np.ones(long)
    return (1 - np.cos(np.pi * edge)) / 2


def test_a_stimulus_is_its_own_rendering_bit_for_bit():
    """In its interval, whatever the rate; ramps are within it."""
    noisy = stimlib.Scene(
        {
            "force": (
                stimlib.Param("k", 2.0, "N/m")
                * stimlib.Input("x", "m")
                * (1 + 0.1 * stimlib.blocks.white_noise(1))
            )
        }
    )
    made = experiment(
        scenes={"spring": noisy},
        fs=1234.5,
        timing=Timing(interval=0.1, gap=0.05, before=0.01, ramp=0.02),
    )
    hand = np.sin(np.arange(800) / 30)
    trial = Trial(
        "a", (Stimulus("spring", {"k": 1.0}, 9), Stimulus("spring", {"k": 3.0}, 4)), ("softer",)
    )
    at, (scene, params) = spans(made, trial), program(made, trial)
    assert params == {"k_1": 1.0, "k_2": 3.0}
    whole = stimlib.render(scene, {"x": hand}, fs=made.fs, seed=9, params=params)["force"]
    for (a, b), k, seed in zip(at, (1.0, 3.0), (9, 4), strict=True):
        alone = stimlib.render(noisy, {"x": hand[a:b]}, fs=made.fs, seed=seed, params={"k": k})[
            "force"
        ]
        assert b - a == 123 and (whole[a + 26 : b - 26] == alone[26:-26]).all()
        assert np.abs(whole[a:b] - window(b - a, 0.02, made.fs) * alone).max() < 1e-14
    assert (
        (whole[: at[0][0]] == 0).all()
        and (whole[at[0][1] : at[1][0]] == 0).all()
        and (whole[at[1][1] :] == 0).all()
    )
    assert at[1][0] - at[0][1] == round(0.05 * 1234.5)


def drawn(scene, rng, n):
    """Parameters and a hand, drawn: moving, held or jumping, from the first sample
    on.
    """
    params = {
        name: p.value * rng.uniform(0.6, 1.4)
        for name, p in scene.params.items()
        if rng.random() < 0.7
    }
    motion = {}
    for name in scene.inputs:
        x = 0.01 * (1.1 + np.sin(np.arange(n) * rng.uniform(0.002, 0.02) + rng.uniform(0, 6)))
        motion[name] = (
            (np.cumsum(rng.normal(0, 1, n // 90 + 1) > 0).repeat(90)[:n] % 2.0)
            if name == "contact"
            else x
        )
    return params, motion


@pytest.mark.parametrize(
    ("name", "target"),
    [
        pytest.param(
            name,
            target,
            marks=[pytest.mark.stress]
            * (target == "python" and name not in ("wall", "viscoelastic")),
        )
        for name in SHIPPED
        for target in ("numba", "python")
    ],
)
def test_every_scene_is_its_own_rendering_in_every_interval(name, target):
    """Of any parameters, also inside enabled, and seeds; times the window; in random
    cuts; nothing of it runs between.
    """
    rng, fs = np.random.default_rng(len(name)), 8000.0
    takes = inspect.signature(SHIPPED[name]).parameters
    kinds = (
        [{}]
        if name == "texture" or "contact" not in takes or target == "python"
        else [{}, {"contact": True}]
    )
    for options, count in zip(kinds, (2, 3), strict=False):
        scene = SHIPPED[name](**({"model": made_up()} if name == "texture" else {}) | options)
        timing = Timing(
            interval=0.2 if target == "numba" else 0.012, gap=0.004, before=0.0, ramp=0.003
        )
        made = experiment(scenes={"it": scene}, fs=fs, bounds={}, timing=timing)
        told = [drawn(scene, rng, 1)[0] for _ in range(count)]
        trial = Trial(
            "a", tuple(Stimulus("it", p, int(rng.integers(3))) for p in told), ("softer",)
        )
        at, (whole, params) = spans(made, trial), program(made, trial)
        hand = drawn(scene, rng, at[-1][1] + 50)[1]
        proc = stimlib.compile(whole, fs, target, trial.stimuli[0].seed)
        for param, value in params.items():
            proc.set(param, value, 0.0)
        x = np.array([hand[i] for i in proc.inputs]).reshape(len(proc.inputs), at[-1][1] + 50)
        y = dict(zip(proc.outputs, cut_run(proc, x, random_cuts(x.shape[1], rng)), strict=True))
        long = at[0][1] - at[0][0]
        shape = timeline(
            [(0.0, 0.0), (0.003, 1.0), (long / fs - 0.003, 1.0), (long / fs, 0.0)], "cosine"
        )
        shape = stimlib.render(stimlib.Scene({"w": shape}), {}, fs, long / fs)["w"]
        assert np.abs(shape - window(long, 0.003, fs)).max() < 1e-14
        within = np.zeros(x.shape[1], bool)
        for (a, b), s in zip(at, trial.stimuli, strict=True):
            part = {i: v[a:b] for i, v in hand.items()}
            alone = stimlib.render(scene, part, fs, long / fs, s.params, s.seed, target)
            within[a:b] = True
            for output in scene.outputs:
                assert_same(y[output][a:b], shape * alone[output], output)
        assert not any(v[~within].any() for v in y.values())


def test_what_depends_on_the_time_is_there_in_every_interval():
    """A burst, events, a sweep and a timeline began with the trial once: the second
    interval was silent, without a word.
    """
    timed = {
        "burst": (
            stimlib.blocks.oscillator(250.0) * stimlib.blocks.burst(0.01, duration=0.05, ramp=0.01)
        ),
        "at": stimlib.blocks.at([0.02, 0.03]),
        "chirp": stimlib.blocks.chirp(20.0, 200.0, 0.08),
        "timeline": stimlib.blocks.timeline([(0.0, 1.0), (0.05, 2.0)]),
    }
    made = experiment(scenes={"it": stimlib.Scene(timed)}, bounds={}, motion={})
    trial = Trial("a", (Stimulus("it"), Stimulus("it"), Stimulus("it")), ("softer",))
    whole = stimlib.render(program(made, trial)[0], {}, made.fs, 0.7)
    alone = stimlib.render(made.scenes["it"], {}, made.fs, 0.1)
    for name in timed:
        assert alone[name].any() and all(
            (whole[name][a:b] == alone[name]).all() for a, b in spans(made, trial)
        ), name


def test_two_scenes_in_one_trial():
    other = stimlib.Scene({"force": stimlib.Param("c", 1.0, "N") * 1.0})
    made = experiment(scenes={"spring": SPRING, "weight": other})
    trial = Trial(
        "a", (Stimulus("weight", {"c": 4.0}), Stimulus("spring", {"k": 3.0})), ("softer",)
    )
    scene, params = program(made, trial)
    force = stimlib.render(scene, {"x": still}, fs=1000, seconds=0.5, params=params)["force"]
    assert (
        params == {"c_1": 4.0, "k_2": 3.0}
        and (force[[127, 128, 227, 228, 278, 377, 378]] == [0, 4, 4, 0, 3, 3, 0]).all()
    )


def test_a_channel_is_the_same_in_every_trial():
    """Whatever the order of the intervals, and where one scene lacks it: an actuator
    gets no other's signal.
    """
    other = stimlib.Scene(
        {"buzz": stimlib.Input("y", "N") * 1.0, "force": stimlib.Param("c", 1.0, "N") * 1.0}
    )
    made = experiment(scenes={"spring": SPRING, "weight": other}, motion={"x": still, "y": still})
    for order in (["spring", "weight"], ["weight", "spring"], ["spring"]):
        assert list(
            program(made, Trial("a", tuple(map(Stimulus, order)), ("softer",)))[0].outputs
        ) == ["force", "buzz"]
    spring = Trial("a", (Stimulus("spring"),), ("softer",))
    assert present(made, spring)["lost"] == 0  # though it has no input y
    assert (
        stimlib.render(program(made, spring)[0], {"x": still}, fs=1000, seconds=0.4)["buzz"] == 0
    ).all()


def test_bounds_hold_for_what_a_stimulus_leaves_as_it_is(tmp_path):
    high = Own(ConstantStimuli(((TASK, 9.0),)))
    with Session(experiment(design=high), tmp_path, "P01") as session:
        # before anything is displayed
        refused(BadValue, "k = 9 is beyond its bounds", session.due)
    refused(
        BadValue,
        "k = 2 is beyond its bounds, 0.5 to 1.5",
        program,
        experiment(bounds={"k": (0.5, 1.5)}, design=high),
        Trial("a", (Stimulus("spring"),), ("softer",)),
    )


def test_parameters_of_two_scenes_are_kept_apart(tmp_path):
    """Of one name, with other values, units and defaults; the log has each with the
    number of its interval.
    """
    other = stimlib.Scene({"force": stimlib.Param("k", 7.0, "N") * stimlib.Param("k_1", 1.0)})
    made = experiment(scenes={"spring": SPRING, "weight": other}, bounds={})
    trial = Trial(
        "a",
        (Stimulus("spring", {"k": 3.0}), Stimulus("weight"), Stimulus("spring", {"k": 3.0})),
        ("softer",),
    )
    shown = present(made, trial, "offline", tmp_path / "a.stimlog")
    assert shown["params"] == {"k_1": 3.0, "k_3": 3.0} and shown["peak"]["force"] == pytest.approx(
        [3.0, 7.0, 3.0]
    )
    assert list(read_log(tmp_path / "a.stimlog").scene.params) == ["k_3", "k_2", "k_1_2", "k_1"]


def test_sessions_of_shared_time_are_read_and_replayed_and_say_so(tmp_path):
    """Two trials of a burst, displayed when all intervals of a trial had one time: the
    second had no burst.
    """
    shutil.copytree(Path(__file__).with_name("shared_time"), tmp_path / "data")
    (saved,) = sessions("old", tmp_path / "data")
    assert [r.time for r in saved.records] == ["shared", "shared"] and status(saved)["shared"] == 2
    log = read_log(saved.folder / "trial-0001-1.stimlog")
    assert replay(log).matches
    course = (
        1
        + stimlib.blocks.burst(0.01, duration=0.02, ramp=0.005)
        + 0.1 * stimlib.blocks.white_noise(1)
    )
    noisy = stimlib.Scene({"force": SPRING.outputs["force"] * course})
    made = experiment(
        name="old", design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0))), scenes={"spring": noisy},
        timing=Timing(interval=0.05, gap=0.02, before=0.0, ramp=0.01),
    )  # fmt: skip
    shown = present(made, saved.records[0].trial, "offline", tmp_path / "now.stimlog")
    then = saved.records[0].displayed[0]
    assert shown["intervals"] == [tuple(a) for a in then["intervals"]]
    assert shown["peak"]["force"][0] > 1.5 * then["peak"]["force"][0]  # twice, where the burst is
    record = Record(1, saved.records[0].trial, saved.records[0].answer, [shown])
    # as displayed last
    assert record.time == Record(1, record.trial, record.answer, [then, shown]).time == "own"
    assert Record(1, record.trial, record.answer, [nothing(None, None)]).time == ""
    refused(
        BadValue,
        "another experiment or version: experiment.design",
        Session(made, tmp_path / "data", "P01", resume=True).__enter__,
    )


def test_an_outcome_is_what_the_first_question_counts_for():
    trial = Trial("a", (), ("softer", "sure"), scores={"first": 0.0, "second": 1.0})
    assert outcome(trial, Answer({"sure": "first", "softer": "second"})) == 1.0
    refused(BadValue, "is no choice", outcome, trial, Answer({"softer": ["second"]}))


def test_limits_show_in_what_was_displayed(tmp_path):
    shown = present(
        experiment(safety=2.5, motion={"x": lambda t: -still(t)}),
        pair(),
        "offline",
        tmp_path / "a.stimlog",
    )
    assert (
        shown["peak"]["force"] == pytest.approx([1.0, 2.5], rel=1e-6)
        and shown["clips"]["clip"]["force"] == 100
    )


def test_masking_has_a_channel_of_its_own_and_a_cursor_is_followed(tmp_path):
    hand = {"x": lambda t: 0.8 * np.sin(2 * np.pi * 10 * (t - 0.128) - 0.3)}
    made = experiment(masking=Masking(rms=0.05), motion=hand, cursor=Cursor("x", 1.0, 10.0))
    shown = present(made, pair(), "offline", tmp_path / "a.stimlog")
    assert shown["rms"]["masking"] == pytest.approx([0.05, 0.05], rel=0.3)
    assert shown["rms"]["force"] == pytest.approx([0.8 / 2**0.5, 3 * 0.8 / 2**0.5], rel=1e-5)
    assert shown["following"][0]["gain"] == pytest.approx(0.8, abs=1e-9)
    assert shown["following"][0]["lag"] == pytest.approx(0.3 / (20 * np.pi), abs=1e-9)


def test_a_hand_pushes_its_positions_while_the_trial_plays(tmp_path):
    def hand(sink):  # all of it at once, so that no busy machine comes between
        assert sink.push(np.full((1, 600), 0.5)) == 600

    made = experiment(motion=Live(keep=1.0), hand=hand)
    shown = present(made, pair(), "null", tmp_path / "a.stimlog", realtime=False)
    assert shown["peak"]["force"] == pytest.approx([0.5, 1.5], rel=1e-6)


def forms(opened):
    """What is compiled of each program: its blocks and how they hang together, without
    their numbers.
    """
    return {
        tuple((type(q.block).__name__, q.kind, q.clock, q.args) for q in scene.program.instances)
        for scene in opened
    }


def test_what_is_displayed_was_compiled_before_and_nothing_is_displayed_for_it(
    tmp_path, monkeypatch
):
    """The first of a kind would begin late, and tell that it is one."""
    opened, clocks, started = [], [], []
    take, begin = NullSink.open, NullSink.start

    def seen(sink, *how):
        opened.append(sink.scene)
        clocks.append(sink.clock)
        take(sink, *how)

    monkeypatch.setattr(NullSink, "open", seen)
    monkeypatch.setattr(
        NullSink,
        "start",
        lambda sink, seconds: (started.append(sink.scene), begin(sink, seconds))[1],
    )
    force = SPRING.outputs["force"]
    twice, square = (
        stimlib.Scene({"force": f})
        for f in (2.0 * force, force * force / stimlib.constant(1.0, "N"))
    )
    tasks = ConstantStimuli(
        (
            (TASK, 4.0),
            (TASK, 2.0),
            (OneInterval("w", "softer", {n: Stimulus(n) for n in ("first", "second")}), "second"),
        )
    )
    made = experiment(
        scenes={"spring": SPRING, "first": SPRING, "second": square, "third": twice},
        design=Sequential(
            {"learnt": ConstantStimuli(((TASK, 4.0),), training=True), "main": tasks}
        ),
        familiarisation={"soft": Stimulus("third")},
    )
    with Session(made, tmp_path, "P01") as session:
        face, state = (
            Simulated(session, lambda trial, rng: Answer({"softer": "first"})),
            session.state,
        )
        for sink in ("offline", "null"):
            opened.clear()
            clocks.clear()
            told = prepare(session, sink)
            assert told == len(opened) > 2 and not started
            assert sum(clocks) == (sink == "null"), "a device is opened once"
        assert session.state == state and session.number == 1
        before = forms(opened)
        picks = iter(["soft", None])
        monkeypatch.setattr(face, "pick", lambda names: next(picks), raising=False)
        opened.clear()
        run(session, face, "null", realtime=False)
    assert (
        len(session.records) == 4
        and len(started) == 5
        and forms(started) <= before
        and len(before) > 2
    )
    assert len(opened) == told + 5, "and a session does so by itself"


def test_one_full_scale_for_several_units_is_refused_before_the_session(tmp_path):
    both = {"spring": stimlib.Scene(SPRING.outputs | {"v": stimlib.constant(1.0, "V")})}
    says = r"units \(force \[N\], v \[V\]\); give Safety\(full_scale={'force': .., 'v': ..}\)"
    refused(UnitError, says, Session(experiment(scenes=both), tmp_path, "P01").check_ahead)
    each = Safety(full_scale={"force": 10.0, "v": 2.0})
    Session(experiment(scenes=both, safety=each), tmp_path, "P01").check_ahead()
    assert not list(tmp_path.iterdir())


class Odd(ConstantStimuli):
    """A design that fails on every answer."""

    def update(self, state, answer):
        return {}["no answer of this kind"]


def failing():
    """Return words of an experiment, a sink, its options, and what the error says."""
    x = SPRING.outputs["force"]
    fast = {"spring": SPRING, "fast": stimlib.Scene({"force": lowpass(x, 600.0)})}
    task = Rate("a", ("softer",), Stimulus("fast"))
    parts = {
        "a": ConstantStimuli(((TASK, 4.0),), repeats=250),
        "b": ConstantStimuli(((task, None),)),
    }
    late = {"scenes": fast, "design": Sequential(parts)}
    high = Rate("a", ("softer",), Stimulus("spring", {"k": 9.0}))
    items = ((TASK, 4.0), (high, None))
    beyond = {"design": Own(ConstantStimuli(items, shuffle="none"))}
    explored = {"scenes": fast, "familiarisation": {"soft": Stimulus("fast")}}
    ones = np.ones(3)
    motor = Calibration(np.array([10.0, 100.0, 400.0]), ones + 0j, 0.01 * ones, "m/s^2")
    cut = "lowpass: cutoff = 600 Hz does not fit below fs/2"
    return {
        "no server": ({}, "jack", {"server": "none_of_this_name"}, "none_of_this_name|jack"),
        "no card": ({}, "portaudio", {"name": "none of this"}, "none of this|sounddevice"),
        "no rack": ({}, "nidaq", {"name": "Dev9/ao0"}, "nidaqmx|Dev9"),
        "a filter above fs/2 in trial 251": (late, "null", {}, cut),
        "the same without a clock": (late, "offline", {}, cut),
        "what is explored first": (explored, "offline", {}, cut),
        "a level beyond the bounds in trial 2": (beyond, "offline", {}, "k = 9 is beyond"),
        "a calibration of another unit": ({}, "offline", {"calibration": motor}, "force is in N"),
    }


@pytest.mark.parametrize("what", failing())
def test_what_fails_fails_before_the_participant_reads_a_word(what, tmp_path):
    words, sink, options, says = failing()[what]
    face = Scripted("first", "first")
    with Session(experiment(instructions="Read this.", **words), tmp_path, "P01") as session:
        refused(StimlibError, says, run, session, face, sink, **options)
    assert face.noted == [] and not list(tmp_path.rglob("*.stimlog"))
    assert read(session.folder).records == []


def test_a_design_that_fails_on_a_guess_begins(tmp_path):
    with Session(experiment(design=Odd(((TASK, 4.0),))), tmp_path, "P01") as session:
        assert prepare(session, "null") == 1


@pytest.mark.parametrize(
    "trial, error, why",
    [
        (
            Trial("a", (Stimulus("spring", {"k": 9.0}),), ("softer",)),
            BadValue,
            "k = 9 is beyond its bounds, 0.5 to 8",
        ),
        (
            Trial("a", (Stimulus("spring", {"k": 0.4}),), ("softer",)),
            BadValue,
            "k = 0.4 is beyond its bounds",
        ),
        (
            Trial("a", (Stimulus("spring", {"k": "2"}),), ("softer",)),
            BadValue,
            "k = '2' is no number",
        ),
        (
            Trial("a", (Stimulus("spring", {"k": np.int64(2)}),), ("softer",)),
            BadValue,
            "cannot be kept in a log.*float",
        ),
        (Trial("a", (Stimulus("spring"),), ()), BadValue, "one question at least"),
        (
            Trial("a", (Stimulus("spring"),), ("softer",), scores={"A": 1.0}),
            BadValue,
            "the task counts A: they must be the same",
        ),
        (Trial("a", (Stimulus("springs"),), ("softer",)), UnknownName, "no scene 'springs'"),
        (Trial("a", (Stimulus("spring", {"q": 1.0}),), ("softer",)), UnknownName, "no parameter q"),
        (Trial("a", (Stimulus("spring"),), ("harder",)), UnknownName, "no question 'harder'"),
    ],
)
def test_trials_that_the_experiment_does_not_allow(trial, error, why):
    refused(error, why, program, experiment(), trial)
    refused(
        UnknownName, "no sink 'jak'; there are null, jack", present, experiment(), pair(), "jak"
    )


def test_experiments_that_make_no_sense():
    for wrong, error, why in (
        ({"scenes": {}}, BadValue, "scenes must be"),
        ({"questions": (QUESTION, QUESTION)}, BadValue, "a name of its own"),
        ({"bounds": {"q": (1.0, 2.0)}}, UnknownName, "no scene has a parameter 'q'"),
        ({"bounds": {"k": (0.5, np.inf)}}, BadValue, "finite numbers that rise"),
        ({"masking": Masking("force")}, BadValue, "'force' is an output of a scene"),
        (
            {"cursor": Cursor("y", 1.0)},
            UnknownName,
            "Cursor: no scene has an input 'y'; there are x",
        ),
        ({"fs": 0.0}, BadValue, "fs = 0.0 must be in Hz"),
        ({"fs": 4.0}, BadValue, "a sample in each interval"),
        ({"replays": -1}, BadValue, "replays = -1 must be a whole number"),
        ({"bounds": {"k": (2.0, 1.0)}}, BadValue, "finite numbers that rise"),
    ):
        refused(error, why, experiment, **wrong)
    for cursor in ((0.0, 1.0), (1.0, 0.0), (1.0, np.nan)):  # its gain and lag are divided by them
        refused(BadValue, "must be above 0|frequency = nan is not finite", Cursor, "x", *cursor)
    refused(
        BadValue,
        "Trial: level = nan is not finite",
        Trial,
        "a",
        (Stimulus("spring"),),
        ("softer",),
        level=np.nan,
    )
    refused(BadValue, "gap = -1 must be a time", Timing, gap=-1)
    refused(BadValue, "longer than its two ramps", Timing, interval=0.04)


# Sessions -----------------------------------------------------------------------------
def test_a_session_is_its_log(tmp_path):
    session = simulate(tmp_path)
    saved = read(tmp_path / "pair" / "P01-s1")
    assert saved.records == session.records and 16 < len(saved.records) < 80
    assert [r.number for r in saved.records] == list(range(1, len(saved.records) + 1))
    assert saved.header["seed"] == experiment().seeded("P01", 1) != experiment().seeded("P02", 1)
    assert not (session.folder / "spare").exists()
    assert {r.outcome for r in saved.records} == {0.0, 1.0}
    assert sessions("pair", tmp_path) == [saved]


def test_a_session_that_was_left_goes_on_as_it_would_have(tmp_path):
    whole = simulate(tmp_path / "a")
    some(tmp_path / "b", 7)
    simulate(tmp_path / "b", resume=True)
    facts = [
        [(r.number, r.trial, r.answer.values) for r in read(tmp_path / d / "pair/P01-s1").records]
        for d in "ab"
    ]
    assert facts[0] == facts[1] and len(facts[0]) == len(whole.records)


@pytest.mark.parametrize("kills", [8, pytest.param(200, marks=pytest.mark.stress)])
def test_killed_at_random_moments_nothing_is_lost_and_nothing_doubled(tmp_path, kills):
    command = [
        sys.executable,
        str(Path(__file__).with_name("killed.py")),
        str(tmp_path),
        str(kills),
        "1",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0 and int(done.stdout.split()[0]) >= kills, done.stdout + done.stderr


@pytest.mark.parametrize("cut", [1, 40, -1])
def test_a_line_that_was_cut_short_is_dropped_and_its_trial_comes_again(tmp_path, cut):
    session = some(tmp_path, 3)
    path = session.folder / "trials.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:2]) + lines[2][:cut])
    (session.folder / "answered").write_text("2\n")  # it is written after the line
    with Session(experiment(), tmp_path, "P01", resume=True) as again:
        assert again.number == 3 and again.due() == session.records[2].trial
        again.put(session.records[2].answer, [])
    assert len(read(session.folder).records) == 3


def test_an_end_of_line_that_no_line_has_drops_nothing(tmp_path):
    session = some(tmp_path, 3)
    path = session.folder / "trials.jsonl"
    path.write_bytes(path.read_bytes().replace(b", ", b",\r ", 1))  # white space of JSON
    assert some(tmp_path, 0, resume=True).records == session.records == read(session.folder).records


@pytest.mark.parametrize("lines", [4, 3, 1, 0, None])
@pytest.mark.parametrize("witness", ["answered", "the logs", "both"])
def test_lines_that_are_missing_at_the_end_are_told(tmp_path, lines, witness):
    session = some(tmp_path, 5)
    path = session.folder / "trials.jsonl"
    for n in range(1, 6):
        (session.folder / f"trial-{n:04}-1.stimlog").mkdir()
    assert len(read(session.folder).records) == 5 and not list(session.folder.glob("*.part"))
    if witness == "the logs":
        (session.folder / "answered").unlink()
    if lines is None:
        path.unlink()
    else:
        path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:lines]))
    if witness == "the logs" and lines == 4:  # as of a session that was killed before the answer
        assert len(read(session.folder).records) == 4
        return
    last = 4 if witness == "the logs" else 5
    for act in (lambda: read(session.folder), lambda: some(tmp_path, 0, resume=True)):
        refused(
            SinkError,
            f"trials {(lines or 0) + 1} to {last} are missing at its end. Put back a whole copy",
            act,
        )


def test_a_damaged_number_of_answers_is_told(tmp_path):
    path = some(tmp_path, 2).folder / "answered"
    for text in (b"", b"two", b"\xff", b"9" * 9000):
        path.write_bytes(text)
        refused(SinkError, "answered is damaged", read, path.parent)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks")
# of JAX, where another test in this process has loaded it
@pytest.mark.filterwarnings("ignore:os.fork")
def test_a_fork_of_a_session_writes_nothing(tmp_path):
    with Session(experiment(), tmp_path, "P01") as session:
        trial = session.due()
        answer = observer(trial, np.random.default_rng(1))
        session.put(answer, [])
        pid = os.fork()
        if pid == 0:
            said = []
            for act in (session.due, lambda: session.put(answer, [])):
                try:
                    act()
                except SinkError as e:
                    said.append("no fork of it" in str(e))
            session._close()
            os._exit(0 if said == [True, True] else 1)
        assert os.waitpid(pid, 0)[1] == 0
        assert (session.folder / "spare").exists()
        session.due()
        session.put(answer, [])
        refused(SinkError, "one participant cannot be in two", some, tmp_path, 0, resume=True)
    assert len(read(session.folder).records) == 2


@pytest.mark.parametrize("change", ["unlink", "replace", "truncate", "append"])
def test_a_log_that_others_replaced_or_changed_takes_no_answer(tmp_path, change):
    """An answer written to a file that has no name any more would be lost without a
    word.
    """
    with Session(experiment(), tmp_path, "P01") as session:
        session.put(observer(session.due(), np.random.default_rng(1)), [])
        path, answer = (
            session.folder / "trials.jsonl",
            observer(session.due(), np.random.default_rng(1)),
        )
        kept = path.read_bytes()
        match change:
            case "unlink":
                path.unlink()
            case "replace":
                (tmp_path / "copy").write_bytes(kept)
                (tmp_path / "copy").rename(path)
            case "truncate":
                path.write_bytes(kept[:-10])
            case "append":
                path.write_bytes(kept + b"{}")
        for act in (session.due, lambda: session.put(answer, [])):
            refused(
                SinkError,
                r"trials.jsonl is not as this session wrote it: .*resume the session",
                act,
            )
        assert len(session.records) == 1
    path.write_bytes(kept)
    with Session(experiment(), tmp_path, "P01", resume=True) as session:
        session.put(answer, [])
    assert len(read(session.folder).records) == 2


def edited(path, change):
    data = [json.loads(line) for line in path.read_text().splitlines()]
    change(data)
    path.write_text("".join(json.dumps(line, sort_keys=True) + "\n" for line in data))


@pytest.mark.parametrize(
    "change, line",
    [
        (
            lambda d: d[1]["answer"]["values"].update(
                softer="first" if d[1]["answer"]["values"]["softer"] == "second" else "second"
            ),
            2,
        ),
        (lambda d: d.pop(0), 1),
        (lambda d: d.insert(1, d[0]), 2),
        (lambda d: d[2].pop("answer"), 3),
        (lambda d: d[0].update(number=2), 1),
    ],
)
def test_lines_that_were_edited_are_named(tmp_path, change, line):
    session = some(tmp_path, 3)
    edited(session.folder / "trials.jsonl", change)
    for act in (lambda: read(session.folder), lambda: some(tmp_path, 0, resume=True)):
        refused(SinkError, f"trials.jsonl, line {line}: ", act)


def test_a_header_that_was_edited_is_seen_by_the_first_line(tmp_path):
    session = some(tmp_path, 1)
    path = session.folder / "session.json"
    path.write_text(path.read_text().replace('"P01"', '"P02"'))
    refused(SinkError, "line 1: it is not as it was written", read, session.folder)
    path.write_text("{}")
    refused(SinkError, "session.json: stimlib_experiment is missing", read, session.folder)


def test_a_log_of_another_experiment_or_version_is_refused(tmp_path):
    some(tmp_path, 2)
    for other, what in (
        ({"version": "2"}, "experiment.version"),
        ({"bounds": {"k": (0.5, 8.5)}}, "experiment.bounds"),
        ({"seed": 1}, "seed, experiment.seed"),
        (
            {"scenes": {"spring": stimlib.Scene({"force": 2.0 * SPRING.outputs["force"]})}},
            "experiment.scenes",
        ),
    ):
        refused(
            BadValue,
            f"another experiment or version: {what} differs",
            some,
            tmp_path,
            0,
            experiment(**other),
            resume=True,
        )
    assert len(some(tmp_path, 1, resume=True).records) == 3


def test_an_answer_is_on_the_disk_and_its_log_has_room(tmp_path, monkeypatch):
    made = experiment(timing=Timing(interval=2.0, gap=1.0, before=0.0, ramp=0.0))
    synced, fsync = [], os.fsync
    monkeypatch.setattr(os, "fsync", lambda fd: (synced.append(os.fstat(fd).st_size), fsync(fd)))
    with Session(made, tmp_path, "P01") as session:
        session.put(observer(session.due(), np.random.default_rng(1)), [nothing(None, None)])
        assert (session.folder / "trials.jsonl").stat().st_size in synced
        four = Trial("a", 4 * pair().stimuli[:1], ("softer",))
        # 4 intervals and 3 gaps: motion, and what was delivered
        assert session._log_bytes(four) - LOG >= 11 * 1000 * (8 + 4)


def test_a_design_that_gives_other_trials_is_refused(tmp_path, monkeypatch):
    session = some(tmp_path, 4)
    monkeypatch.setattr("stimlib.experiments.tasks.seed_of", lambda *words: 1)
    refused(
        BadValue,
        "trials.jsonl, line 1: the design gives another trial there",
        some,
        tmp_path,
        0,
        resume=True,
    )
    assert len(read(session.folder).records) == 4


def test_trials_ahead_are_checked_before_there_is_a_folder(tmp_path):
    good, bad = (TASK, 4.0), (TASK, 80.0)
    fixed = experiment(design=Own(ConstantStimuli((good, bad), shuffle="none")))
    with pytest.raises(BadValue, match="k = 80 is beyond its bounds"):
        Session(fixed, tmp_path, "P01").check_ahead()
    beyond = Own(Staircase(TASK, (7.9, 8.0), (0.5, 80.0), reversals=8))
    known = {"red": Stimulus("spring")}
    Session(experiment(design=beyond, familiarisation=known), tmp_path, "P01").check_ahead()
    first = Own(Staircase(TASK, (70.0, 80.0), (0.5, 80.0), reversals=8))
    with pytest.raises(BadValue, match="is beyond its bounds"):
        Session(experiment(design=first, familiarisation=known), tmp_path, "P01").check_ahead()
    odd = OneInterval("a", "odd", {"red": Stimulus("spring"), "green": Stimulus("spring")})
    unknown = experiment(design=Own(ConstantStimuli(((odd, "red"),))))
    with pytest.raises(UnknownName, match="no question 'odd'"):
        Session(unknown, tmp_path, "P01").check_ahead()
    assert not list(tmp_path.iterdir())


def test_data_are_never_overwritten_and_nobody_is_in_two_sessions_at_once(tmp_path):
    some(tmp_path, 2)
    refused(BadValue, "is there already: resume it", some, tmp_path, 0)
    refused(BadValue, "there is no session .* to resume", some, tmp_path, 0, session=2, resume=True)
    with (
        Session(experiment(), tmp_path, "P01", resume=True),
        pytest.raises(SinkError, match="one participant cannot be in two"),
    ):
        some(tmp_path, 0, resume=True)
    assert len(read(tmp_path / "pair" / "P01-s1").records) == 2


def test_a_run_that_comes_second_overwrites_nothing(tmp_path, monkeypatch):
    lock, first = stimlib.system.safe_files.lock, []

    def late(*words):  # another run begins and ends before this one has the lock
        if not first:
            first.append(None)
            first.append(some(tmp_path, 2))
        return lock(*words)

    monkeypatch.setattr("stimlib.experiments.session.safe_files.lock", late)
    refused(BadValue, "is there already", some, tmp_path, 0)
    assert read(first[1].folder).records == first[1].records


def test_a_copy_of_a_session_is_not_counted(tmp_path):
    folder = some(tmp_path, 1).folder
    shutil.copytree(folder, f"{folder} copy")
    refused(
        BadValue,
        "has the session P01-s1: a copy would count twice; move it",
        sessions,
        "pair",
        tmp_path,
    )


@pytest.mark.parametrize("name", ["Anna", "P", "07", "P07 ", "../P07", "P07\n", "Maximilian1"])
def test_participants_are_codes(tmp_path, name):
    refused(BadValue, "must be a code", Session, experiment(), tmp_path, name)


def test_a_pilot_is_none_of_the_data(tmp_path):
    pilot = some(tmp_path, 2, pilot=True)
    some(tmp_path, 1)
    assert (
        pilot.folder.name == "PILOT-P01-s1"
        and len(sessions("pair", tmp_path)) == len(sessions("pair", tmp_path, pilot=True)) == 1
    )
    refused(BadValue, "is a pilot, and no data", read, pilot.folder)
    pilot.folder.rename(tmp_path / "pair" / "P03-s1")  # renamed by hand
    refused(BadValue, "is a pilot", sessions, "pair", tmp_path)
    assert all(
        json.loads(line)["pilot"]
        for line in (tmp_path / "pair" / "P03-s1" / "trials.jsonl").read_text().splitlines()
    )


def test_an_answer_that_is_none_is_not_written(tmp_path):
    with Session(experiment(), tmp_path, "P01") as session:
        for values, why in (
            ({}, "not answered"),
            ({"softer": "third"}, "no answer; answer one of first, second"),
        ):
            refused(BadValue, why, session.put, Answer(values))
        refused(
            BadValue, "Answer: seconds = nan is not finite", Answer, {"softer": "first"}, np.nan
        )
        refused(
            BadValue,
            "trial 1: .* is no JSON data",
            session.put,
            Answer({"softer": "first"}),
            [{"lost": np.int64(1)}],
        )
        with pytest.raises(BadValue, match="None is no answer"):  # it would be asked for ever
            run(session, Simulated(session, lambda trial, rng: Answer({})), nothing)
        assert session.number == 1
    assert read(session.folder).records == []


def test_what_the_experimenter_sees_is_blinded(tmp_path):
    task = OneInterval(
        "secret", "softer", {"first": Stimulus("spring"), "second": Stimulus("spring", {"k": 3.0})}
    )
    made = experiment(design=ConstantStimuli(((task, "first"), (task, "second")), 2, training=True))
    with Session(made, tmp_path, "P01") as session:
        run(
            session,
            Simulated(session, lambda t, rng: Answer({"softer": "first"}, replays=0)),
            nothing,
        )
    told = status(read(session.folder))
    assert (
        told["trials"] == told["training"] == 4
        and read(session.folder).data == []
        and told["limited"] == 8
    )
    assert list(told["conditions"].values()) == [4] and "secret" not in json.dumps(told)
    assert blinded(session.seed, session.records[0].trial.condition) in told["conditions"]


def test_columns_have_the_trials_that_count(tmp_path):
    pairs = ((TASK, 4.0), (TASK, 1.0))
    made = experiment(
        design=Sequential(
            {"learn": ConstantStimuli(pairs, training=True), "test": ConstantStimuli(pairs, 2)}
        )
    )
    with Session(made, tmp_path, "P01", pilot=True) as session:
        run(session, Simulated(session, observer), nothing)
    found = sessions("pair", tmp_path, pilot=True)
    assert columns(found)["number"] == [3, 4, 5, 6] and not any(columns(found)["training"])
    assert columns(found, training=True)["training"] == 2 * [True] + 4 * [False]
    assert "secret" not in " ".join(p.name for p in tmp_path.rglob("*"))


def test_times_of_a_sink_without_a_clock_are_unknown(tmp_path):
    """Trial 1 would end at 1.7 s and trial 2 begin at 0.7 s, because nobody waits."""
    made = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0))))

    def fast(trial, folder):
        return present(made, trial, partial(NullSink, clocked=False), folder)

    for k, sink in enumerate(["offline", "file", fast, "null"]):
        with Session(made, tmp_path / str(k), "P01") as session:
            how = {"realtime": False} if sink == "null" else {}
            run(session, Simulated(session, observer), sink, **how)
        (saved,) = sessions("pair", tmp_path / str(k))
        times = [t for r in saved.records for _, *t in r.intervals(saved.header["started"])]
        if sink == "null":
            assert np.diff(times).ravel() == pytest.approx([0.1] * 4, abs=1e-6)
        else:
            assert times == [[None, None]] * 4
    old = {k: v for k, v in saved.records[0].displayed[0].items() if k != "clock"}
    for sink, known in (("null", True), ("jack", True), ("offline", False), ("file", False)):
        r = replace(saved.records[0], displayed=[old | {"sink": sink}])
        assert all((t is not None) == known for t in r.intervals(old["started"])[0][1:])


def test_a_session_has_simulated_answers_or_those_of_a_participant(tmp_path):
    some(tmp_path / "person", 2, by=None)
    some(tmp_path / "observer", 2)
    face = Scripted()
    with Session(experiment(), tmp_path / "person", "P01", resume=True) as session:
        fake = Simulated(session, observer)
        refused(BadValue, "has answers, and would get a simulated one", run, session, fake, nothing)
        refused(BadValue, "would get", session.put, fake.answer(session.due()))
    with Session(experiment(), tmp_path / "observer", "P01", resume=True) as session:
        refused(BadValue, "would get one of a participant", run, session, face, nothing)
    assert face.noted == [] and len(session.records) == 2
    simulate(tmp_path / "person" / "two")
    with Session(experiment(), tmp_path / "person" / "two", "P09"):
        pass  # it has no answer yet, so it is of neither kind
    saved, empty = sessions("pair", tmp_path / "person" / "two")
    assert not empty.simulated and columns([saved, empty])["simulated"]
    assert saved.simulated and status(saved)["simulated"] and all(columns([saved])["simulated"])
    assert (saved.folder / "trials.jsonl").read_text().count('"simulated": true') == len(saved.data)
    with Session(experiment(), tmp_path / "person", "P02") as session:
        run(session, Simulated(session, observer), nothing)
    refused(BadValue, "P02-s1 has simulated answers, .*P01", sessions, "pair", tmp_path / "person")


# Around the trials --------------------------------------------------------------------
class Scripted:
    """A front end that notes what it is asked, and answers from a list."""

    def __init__(self, *answers, picks=()):
        self.answers, self.picks, self.noted = list(answers), list(picks), []

    def tell(self, text):
        self.noted.append(text)

    def rest(self, seconds):
        self.noted.append(("rest", round(seconds)))

    def ready(self, text):
        self.noted.append(text)

    def pick(self, names):
        return self.picks.pop(0) if self.picks else None

    def ask(self, trial, question, replays):
        self.noted.append((question.name, replays))
        return self.answers.pop(0)


def test_rests_replays_familiarisation_and_feedback(tmp_path):
    task = OneInterval(
        "c", "softer", {"first": Stimulus("spring"), "second": Stimulus("spring", {"k": 3.0})}
    )
    day = ConstantStimuli(((task, "first"),))
    logs = []
    made = experiment(
        design=Sequential({"1": day, "2": day}, pause=60.0),
        familiarisation={"red": Stimulus("spring", {"k": 3.0})},
        replays=1,
        feedback=True,
        instructions="Squeeze.",
    )

    def show(trial, folder):
        logs.append(folder.name)
        folder.mkdir()
        return {"log": folder.name}

    face = Scripted(None, None, "first", "second", picks=["red", "red"])
    with Session(made, tmp_path, "P01") as session:
        run(session, face, show)
    assert logs == [f"familiarisation-{k}.stimlog" for k in (1, 2)] + [
        "trial-0001-1.stimlog",
        "trial-0001-2.stimlog",
        "trial-0002-1.stimlog",
    ]
    asked = [("softer", 1), ("softer", 0), ("softer", 0)]  # the second replay is not there
    assert face.noted[:6] == ["Squeeze.", "Trial 1 of 2", *asked, "Right"]
    assert face.noted[6:] == [
        ("rest", 60),
        "Trial 2 of 2",
        ("softer", 1),
        "Wrong",
        "That was the last one. Thank you.",
    ]
    first = read(session.folder).records[0]
    assert first.answer.replays == 1 and [d["log"] for d in first.displayed] == logs[2:4]


def test_a_rest_is_counted_from_the_last_answer_also_after_a_resume(tmp_path):
    task = Rate("c", ("roughness", "bumpiness"), Stimulus("spring"))
    day = ConstantStimuli(((task, None),), training=True)
    made = experiment(
        design=Sequential({"1": day, "2": day}, pause=60.0),
        questions=(
            rating("roughness", "?", "smooth", "rough"),
            rating("bumpiness", "?", "flat", "bumpy"),
        ),
    )
    with Session(made, tmp_path, "P01") as session:
        session.put(Answer({"roughness": 3, "bumpiness": 7}))
    with Session(made, tmp_path, "P01", resume=True) as session:
        assert 55 < session.rest(session.due()) <= 60
        now = datetime.now(UTC)
        # a clock that was set back keeps nobody longer
        for passed, left in ((40, 20), (70, 0), (-30, 60)):
            object.__setattr__(
                session.records[0], "ended", (now - timedelta(seconds=passed)).isoformat()
            )
            assert session.rest(session.due()) == pytest.approx(left, abs=2)


def test_a_design_may_depend_on_the_participant(tmp_path):
    def of(participant, session):
        return ConstantStimuli(((TASK, float(participant[1:]) + session),))

    made = experiment(design=of)
    for code, number, level in (("P01", 1, 2.0), ("P02", 1, 3.0), ("P02", 2, 4.0)):
        with Session(made, tmp_path, code, number) as session:
            assert session.due().level == level
    for wrong, why in (
        (lambda p, s: None, "gives None, no design"),
        (lambda p, s: [][0], r"design\('P01', 1\) \(.*, line \d+\): IndexError"),
    ):
        refused(BadValue, why, Session, experiment(design=wrong), tmp_path, "P01")
    assert isinstance(made, Experiment) and len(sessions("pair", tmp_path)) == 3
