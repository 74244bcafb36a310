"""Sessions: presented to the sample, logged line by line, resumed after any end, and
refused where something was changed.
"""

import inspect
import json
import os
import random
import shutil
import signal
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
    Scripted,
    experiment,
    nothing,
    observer,
    simulate,
    some,
    still,
)
from hypothesis import example, given, strategies as st
from laws import STRESS, assert_same, mostly, random_cuts, run as cut_run
from logged import play
from refusals import refused

import stimlib
import stimlib.experiments.random_streams
from stimlib.blocks import lowpass
from stimlib.design.texture import made_up
from stimlib.devices import Calibration, Live, NullSink
from stimlib.errors import BadValue, SinkError, StimlibError, UnitError, UnknownName
from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    Cursor,
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
    folder_of,
    measured,
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
    stream,
)
from stimlib.experiments.bids import subject
from stimlib.experiments.session import LOG, Session
from stimlib.files import LogWriter, read_log, replay
from stimlib.run.safety import GAIN, Safety
from stimlib.scenes import SHIPPED
from stimlib.system import safe_files

ODD = OneInterval("a", "odd", {"red": Stimulus("spring"), "green": Stimulus("spring")})
VOLTS = stimlib.Scene(SPRING.outputs | {"v": stimlib.constant(1.0, "V")})
HIGH = Own(ConstantStimuli(((TASK, 9.0),)))


def forks(test):
    """A test that forks, of a process that may have the threads of JAX."""
    skips = pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks")
    return pytest.mark.filterwarnings("ignore:os.fork")(skips(test))


# Trials are scenes --------------------------------------------------------------------
def pair(seed=0, **other):
    return Trial(
        "a",
        (Stimulus("spring", {"k": 1.0}, seed), Stimulus("spring", {"k": 3.0}, seed)),
        ("softer",),
        **other,
    )


def test_intervals_are_there_to_the_sample_and_nothing_between(tmp_path):
    made, marks = experiment(), []
    shown = present(made, pair(seed=5), "file", tmp_path / "a.stimlog", send=marks.append)
    assert [(m.name, m.value, m.sample) for m in marks] == [
        ("trial", 1.0, 0),
        ("stimulus", 1.0, 128),
        ("stimulus", 2.0, 278),
    ]
    assert shown["intervals"] == [(128, 228), (278, 378)]
    assert shown["delivered"] == shown["produced"] == 378 + 128
    for what in ("peak", "rms"):
        assert shown[what]["force"] == pytest.approx([1.0, 3.0], rel=1e-6)
    log = read_log(tmp_path / "a.stimlog")
    assert log.seed == 5 and replay(log).matches
    assert (tmp_path / "a.stimlog" / "delivered.caf").stat().st_size > 4 * shown["delivered"]
    scene, params = program(made, pair())
    force = stimlib.render(scene, {"x": still}, fs=1000, seconds=0.5, params=params)["force"]
    wanted = np.zeros(500)
    wanted[128:228], wanted[278:378] = 1.0, 3.0
    assert (force == wanted).all()


def test_what_the_device_did_not_take_is_not_measured(tmp_path):
    x = np.where(np.arange(400) < 200, 1.0, 3.0)
    on = [(0, GAIN, 1.0, 0)]
    play(tmp_path, SPRING, Safety(10.0), x[None], fs=1000, sets=on, lost=[(200, 100)])
    found = measured(experiment(), tmp_path, [(100, 300), (200, 300)])
    for what, value in (("peak", 2.0), ("rms", 2**0.5)):
        assert found[what]["force"] == pytest.approx([value, 0.0], rel=1e-6)


def window(long, ramp, fs):
    """Raised cosines within the interval, written again."""
    t = np.arange(long) / fs
    edge = np.minimum(np.minimum(t, long / fs - t), ramp) / ramp if ramp else np.ones(long)
    return (1 - np.cos(np.pi * edge)) / 2


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


@pytest.mark.parametrize("target", ["llvm", "python"])
@pytest.mark.parametrize("name", mostly(["wall", "viscoelastic", "texture"], SHIPPED))
def test_every_scene_is_its_own_rendering_in_every_interval(name, target):
    """Of any parameters, also inside enabled, and seeds; times the window; in random
    cuts; nothing of it runs between.
    """
    rng, fs = (
        np.random.default_rng(len(name)),
        4310.5 if target == "python" and name != "texture" else 8000.0,
    )
    takes = inspect.signature(SHIPPED[name]).parameters
    options = {"model": made_up()} if name == "texture" else {"contact": True}
    scene = SHIPPED[name](**{k: v for k, v in options.items() if k in takes})
    long = 0.2 if target == "llvm" else 0.04
    timing = Timing(interval=long, gap=0.004, before=0.0, ramp=0.01)
    made = experiment(scenes={"it": scene}, fs=fs, bounds={}, timing=timing)
    told = [drawn(scene, rng, 1)[0] for _ in range(2)]
    trial = Trial("a", tuple(Stimulus("it", p, int(rng.integers(3))) for p in told), ("softer",))
    at, (whole, params) = spans(made, trial), program(made, trial)
    n = at[-1][1] + 50
    hand = drawn(scene, rng, n)[1]
    proc = stimlib.compile(whole, fs, target, trial.stimuli[0].seed)
    for param, value in params.items():
        proc.set(param, value, 0.0)
    x = np.array([hand[i] for i in proc.inputs]).reshape(len(proc.inputs), n)
    y = dict(zip(proc.outputs, cut_run(proc, x, random_cuts(n, rng)), strict=True))
    within = np.zeros(n, bool)
    for (a, b), s in zip(at, trial.stimuli, strict=True):
        part, shape = {i: v[a:b] for i, v in hand.items()}, window(b - a, 0.01, fs)
        alone = stimlib.render(scene, part, fs, (b - a) / fs, s.params, s.seed, target)
        within[a:b] = True
        for output in scene.outputs:
            assert b - a == int(long * fs)
            tol = 1e-14 * np.abs(alone[output]).max()
            np.testing.assert_allclose(y[output][a:b], shape * alone[output], 0, tol)
            flat = slice(int(0.011 * fs) + 1, -int(0.011 * fs) - 1)
            assert_same(y[output][a:b][flat], alone[output][flat], output)
    assert not any(v[~within].any() for v in y.values())


def test_a_channel_is_the_same_in_every_trial():
    """Whatever the order of the intervals, and where one scene lacks it: an actuator
    gets no other's signal.
    """
    other = {"buzz": stimlib.Input("y", "N") * 1.0, "force": stimlib.Param("c", 1.0, "N") * 1.0}
    scenes = {"spring": SPRING, "weight": stimlib.Scene(other)}
    made = experiment(scenes=scenes, motion={"x": still, "y": still})
    for order in (["spring", "weight"], ["weight", "spring"], ["spring"]):
        trial = Trial("a", tuple(map(Stimulus, order)), ("softer",))
        scene = program(made, trial)[0]
        assert list(scene.outputs) == ["force", "buzz"]
    assert present(made, trial)["lost"] == 0  # though it has no input y
    assert (stimlib.render(scene, {"x": still}, fs=1000, seconds=0.4)["buzz"] == 0).all()


def test_a_recording_of_a_trial_that_cannot_be_opened_is_closed(tmp_path, monkeypatch):
    ended, close = [], LogWriter.close
    monkeypatch.setattr(LogWriter, "close", lambda log: (close(log), ended.append(log.folder)))
    scene = stimlib.Scene({"force": lowpass(SPRING.outputs["force"], 600.0)})
    made = experiment(scenes={"spring": scene})
    cut = "cutoff = 600 Hz does not fit"
    refused(StimlibError, cut, present, made, pair(), "file", tmp_path / "a.stimlog")
    assert ended == [tmp_path / "a.stimlog"]


def test_parameters_of_two_scenes_are_kept_apart(tmp_path):
    """Of one name, with other values, units and defaults; the log has each with the
    number of its interval.
    """
    unheard = 0 * stimlib.Param("gone", 1.0, "N")
    other = stimlib.Scene(
        {"force": stimlib.Param("k", 7.0, "N") * stimlib.Param("k_1", 1.0) + unheard}
    )
    soft = stimlib.Scene({"force": SPRING.outputs["force"] + 0 * stimlib.Param("gone", 2.0, "N")})
    made = experiment(scenes={"spring": soft, "weight": other}, bounds={})
    spring = Stimulus("spring", {"k": 3.0})
    trial = Trial("a", (spring, Stimulus("weight"), spring), ("softer",))
    shown = present(made, trial, "offline", tmp_path / "a.stimlog")
    assert shown["params"] == {"k_1": 3.0, "k_3": 3.0}
    assert shown["peak"]["force"] == pytest.approx([3.0, 7.0, 3.0])
    names = set(read_log(tmp_path / "a.stimlog").scene.params)
    assert names == {"k_1", "k_2", "k_1_2", "k_3", "gone_1", "gone_2", "gone_3"}


def test_sessions_of_shared_time_are_read_and_replayed_and_say_so(tmp_path):
    """They were displayed when all intervals of a trial had one time."""
    shutil.copytree(Path(__file__).with_name("shared_time"), tmp_path / "data")
    (saved,) = sessions("old", tmp_path / "data")
    assert [r.time for r in saved.records] == ["shared", "shared"] and status(saved)["shared"] == 2
    assert replay(read_log(saved.folder / "trial-0001-1.stimlog")).matches
    first = saved.records[0]
    now, then = present(experiment(), pair(), "offline"), first.displayed[0]
    # as displayed last
    for shown, time in (([now], "own"), ([then, now], "own"), ([nothing(None, None)], "")):
        assert Record(1, first.trial, first.answer, shown).time == time


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


def test_what_is_displayed_was_compiled_before_and_nothing_is_displayed_for_it(
    tmp_path, monkeypatch
):
    """The first of a kind would begin late, and tell that it is one."""
    opened, started = [], []

    def noted(name, sinks):
        method = getattr(NullSink, name)
        monkeypatch.setattr(
            NullSink, name, lambda sink, *how: (sinks.append(sink), method(sink, *how))
        )

    def forms(sinks):  # blocks and how they hang together, without their numbers
        programs = [sink.scene.program.instances for sink in sinks]
        return {tuple((type(q.block), q.kind, q.clock, q.args) for q in p) for p in programs}

    noted("open", opened)
    noted("start", started)
    squared = {"force": SPRING.outputs["force"] * stimlib.Input("x", "m")}
    other = OneInterval("w", "softer", {n: Stimulus(n) for n in ("first", "second")})
    main = ConstantStimuli(((TASK, 4.0), (TASK, 1.0), (TASK, 2.0), (other, "second")))
    made = experiment(
        scenes={"spring": SPRING, "first": SPRING, "second": stimlib.Scene(squared)},
        design=main,
        familiarisation={"soft": Stimulus("second")},
    )
    face = Scripted(*["first"] * 4, picks=["soft"])
    with Session(made, tmp_path, "P01") as session:
        told = prepare(session, "null")
        assert told == len(opened) > 1 and not started
        assert sum(s.clock for s in opened) == 1, "a device is opened once"
        assert session.number == 1
        before = forms(opened)
        opened.clear()
        run(session, face, "null", realtime=False)
    assert len(session.records) == 4 and len(started) == 5
    assert forms(started) <= before and len(before) > 1
    assert len(opened) == told + 5, "and a session does so by itself"


def failing():
    """Return words of an experiment, a sink, its options, and what the error says."""
    x = SPRING.outputs["force"]
    fast = {"spring": SPRING, "fast": stimlib.Scene({"force": lowpass(x, 600.0)})}
    first, last = (
        ConstantStimuli(((TASK, 4.0),), repeats=40),
        ConstantStimuli(((Rate("a", ("softer",), Stimulus("fast")), None),)),
    )
    late = {"scenes": fast, "design": Sequential({"a": first, "b": last})}
    high = Rate("a", ("softer",), Stimulus("spring", {"k": 9.0}))
    beyond = {"design": Own(ConstantStimuli(((TASK, 4.0), (high, None)), shuffle="none"))}
    explored = {"scenes": fast, "familiarisation": {"soft": Stimulus("fast")}}
    ones = np.ones(3)
    motor = Calibration(np.array([10.0, 100.0, 400.0]), ones + 0j, 0.01 * ones, "m/s^2")
    cut = "cutoff = 600 Hz does not fit"
    return {
        "no server": ({}, "jack", {"server": "none_of_this_name"}, "none_of_this_name|jack"),
        "no card": ({}, "portaudio", {"name": "none of this"}, "none of this|sounddevice"),
        "no rack": ({}, "nidaq", {"name": "Dev9/ao0"}, "nidaqmx|Dev9"),
        "a filter above fs/2 in trial 41": (late, "null", {}, cut),
        "the same without a clock": (late, "offline", {}, cut),
        "what is explored first": (explored, "offline", {}, cut),
        "a level beyond the bounds in trial 2": (beyond, "offline", {}, "k = 9 is beyond"),
        "a calibration of another unit": ({}, "offline", {"calibration": motor}, "force is in N"),
    }


@pytest.mark.parametrize(
    ("words", "trial", "why"),
    [
        (
            {},
            {"stimuli": (Stimulus("spring", {"k": 9.0}),)},
            "k = 9 is beyond its bounds, 0.5 to 8",
        ),
        ({}, {"stimuli": (Stimulus("spring", {"k": 0.4}),)}, "k = 0.4 is beyond"),
        ({"bounds": {"k": (2.5, 9.5)}, "design": HIGH}, {}, "k = 2 is beyond"),
        ({}, {"stimuli": (Stimulus("spring", {"k": "2"}),)}, "k = '2' is no number"),
        ({}, {"stimuli": (Stimulus("spring", {"k": np.int64(2)}),)}, "cannot be kept.*float"),
        ({}, {"stimuli": (Stimulus("springs"),)}, "no scene 'springs'"),
        ({}, {"stimuli": (Stimulus("spring", {"q": 1.0}),)}, "no parameter 'q'"),
        ({}, {"questions": ()}, "one question at least"),
        ({}, {"questions": ("harder",)}, "no question 'harder'"),
        ({}, {"scores": {"A": 1.0}}, "counts A: they must be the same"),
        ({}, {"level": np.nan}, "level = nan is not finite"),
        ({"scenes": {}}, {}, "scenes must be"),
        ({"questions": (QUESTION, QUESTION)}, {}, "name of its own"),
        ({"bounds": {"q": (1.0, 2.0)}}, {}, "bounds: there is no parameter 'q'"),
        ({"bounds": {"k": (0.5, np.inf)}}, {}, "finite numbers that rise"),
        ({"bounds": {"k": (2.0, 1.0)}}, {}, "finite numbers that rise"),
        ({"masking": Masking("force")}, {}, "'force' is an output"),
        ({"cursor": Cursor("y", 1.0)}, {}, "Cursor: there is no input 'y'; there are x"),
        ({"fs": 0.0}, {}, "fs = 0.0 must be in Hz"),
        ({"fs": 4.0}, {}, "a sample in each interval"),
        ({"replays": -1}, {}, "replays = -1 must be"),
    ],
)
def test_experiments_and_trials_that_make_no_sense(words, trial, why):
    told = {"condition": "a", "stimuli": (Stimulus("spring"),), "questions": ("softer",)} | trial
    refused((BadValue, UnknownName), why, lambda: program(experiment(**words), Trial(**told)))


@pytest.mark.parametrize(
    ("call", "why"),
    [
        # its gain and lag are divided by them
        *(
            (partial(Cursor, "x", *wrong), "must be above 0|frequency = nan is not finite")
            for wrong in ((0.0, 1.0), (1.0, 0.0), (1.0, np.nan))
        ),
        (partial(Timing, gap=-1), "gap = -1 must be"),
        (partial(Timing, interval=0.04), "longer than its two ramps"),
        (partial(Answer, {"softer": "first"}, np.nan), "seconds = nan is not finite"),
        (partial(Session, experiment(), "data", "P07", 10**6), "a whole number from 1 on"),
        (partial(present, experiment(), pair(), "jak"), "no sink 'jak'; there are null, jack"),
        *(
            (partial(Session, experiment(), "data", name), f"must be a code: .*{why}")
            for why, names in (
                ("A to Z", ["P07 ", "../P07", "P07\n", "a@b.c1", "P.7", "-7", "7-", "7" * 65, ""]),
                ("A to Z", ["\u0667", "P\u00f6l7", "P\uff17", "Po\u0308l7"]),
                ("no digit", ["Anna", "P", "A-B"]),
                ("marks the folders of pilots", ["pilot-7"]),
                (
                    "a date",
                    ["1990-05-17", "19900517", "20040517", "03041985", "85-04-03", "P03-04-85"]
                    + ["05171990", "17-05-1990", "12-31-85", "P_03-04-85"],
                ),
                (
                    "may be a name",
                    ["Maximilian1", "Anna1", "Maria1", "anna_1", "P7-Anna", "StrokeAnna3"]
                    + ["anna1234", "Personal1"],
                ),
            )
            for name in names
        ),
        *(
            (partial(Session, experiment(design=design), "data", "P01"), why)
            for design, why in (
                (lambda p, s: None, "gives None, no design"),
                (lambda p, s: [][0], r"design\('P01', 1\) \(.*, line \d+\): IndexError"),
            )
        ),
        (
            partial(outcome, Trial("a", (), ("q",), scores={"a": 0.0}), Answer({"q": ["a"]})),
            "is no choice",
        ),
    ],
)
def test_parts_that_make_no_sense(call, why):
    refused((BadValue, UnknownName), why, call)


@pytest.mark.parametrize("what", failing())
def test_what_fails_fails_before_the_participant_reads_a_word(what, tmp_path):
    words, sink, options, says = failing()[what]
    face = Scripted("first", "first")
    with Session(experiment(instructions="Read this.", **words), tmp_path, "P01") as session:
        refused(StimlibError, says, run, session, face, sink, **options)
    assert face.noted == [] and not list(tmp_path.rglob("*.stimlog"))
    assert read(session.folder).records == []


# Sessions -----------------------------------------------------------------------------
def test_a_session_is_its_log(tmp_path):
    session = simulate(tmp_path)
    saved = read(tmp_path / "pair" / "P01-s1")
    assert saved.records == session.records and 16 < len(saved.records) < 80
    assert [r.number for r in saved.records] == list(range(1, len(saved.records) + 1))
    assert saved.header["seed"] == experiment().seeded("P01", 1) != experiment().seeded("P02", 1)
    assert not (session.folder / "spare").exists() and sessions("pair", tmp_path) == [saved]
    assert {r.outcome for r in saved.records} == {0.0, 1.0}
    some(tmp_path / "b", 7)  # that was left goes on as it would have
    left = simulate(tmp_path / "b", resume=True)
    facts = [[(r.number, r.trial, r.answer.values) for r in s.records] for s in (left, session)]
    assert facts[0] == facts[1]


def rewritten(change, name="trials.jsonl"):
    """Change the lines of a file of a session, which are tables."""

    def act(folder):
        data = [json.loads(line) for line in (folder / name).read_text().splitlines()]
        change(data)
        text = "".join(json.dumps(line, sort_keys=True) + "\n" for line in data)
        (folder / name).write_text(text)

    return act


def replaced(name, old, new):
    def act(folder):
        path = folder / name
        path.write_bytes(new if old is None else path.read_bytes().replace(old, new, 1))

    return act


@pytest.mark.parametrize(
    "change, why",
    [
        (
            rewritten(lambda d: d[1]["answer"].update(values={"softer": "neither"})),
            "trials.jsonl, line 2: ",
        ),
        (rewritten(lambda d: d.pop(0)), "trials.jsonl, line 1: "),
        (rewritten(lambda d: d.insert(1, d[0])), "trials.jsonl, line 2: "),
        (rewritten(lambda d: d[2].pop("answer")), "trials.jsonl, line 3: "),
        (rewritten(lambda d: d[0].update(number=2)), "trials.jsonl, line 1: "),
        (replaced("session.json", b'"P01"', b'"P02"'), "line 1: it is not as it was written"),
        (replaced("session.json", None, b"{}"), "stimlib_experiment is missing"),
        *(
            (replaced("answered", None, text), "answered is damaged")
            for text in (b"", b"two", b"\xff", b"9" * 9000)
        ),
        (replaced("trials.jsonl", b", ", b",\r "), None),  # white space of JSON
        (lambda folder: shutil.copytree(folder, f"{folder} copy"), "a copy would count twice"),
    ],
)
def test_what_was_edited_is_named(tmp_path, change, why):
    session = some(tmp_path, 3)
    change(session.folder)
    if why is None:
        assert some(tmp_path, 0, resume=True).records == session.records
    elif "copy" in why:
        refused(BadValue, why, sessions, "pair", tmp_path)
    else:
        for act in (read, lambda folder: some(tmp_path, 0, resume=True)):
            refused((SinkError, BadValue), why, act, session.folder)


def dying(name, left):
    """A call of the system in the midst of which the process is killed when so many
    calls have been made.
    """
    real = getattr(os, name)

    def call(*args, **how):
        if not left:
            if name == "write":
                real(args[0], args[1][: len(args[1]) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
        left.pop()
        return real(*args, **how)

    return call


def plain(folder):
    records = read(folder).records if (folder / "session.json").exists() else []
    return [(r.number, r.trial, r.answer.values) for r in records]


@forks
@pytest.mark.parametrize("seed", range(40 if STRESS else 1))
def test_killed_at_any_moment_nothing_is_lost_and_nothing_doubled(tmp_path, seed):
    """A child plays and is killed, and another goes on, until one comes to the end; the
    log has every answer that was kept.
    """
    made = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0)), 4))
    whole = plain(simulate(tmp_path / "whole", made).folder)
    folder, rng, saved, killed = tmp_path / "pair" / "P01-s1", random.Random(seed), [], True

    def play(told):
        with Session(made, tmp_path, "P01", resume=(folder / "session.json").exists()) as session:
            put = session.put
            session.put = lambda *answer: (put(*answer), told.write(b"."))[0]
            run(session, Simulated(session, observer), nothing)

    while killed:
        left = [None] * rng.randrange(20)
        with (tmp_path / "told").open("wb", buffering=0) as told:
            if (pid := os.fork()) == 0:
                try:
                    for name in ("open", "write", "fsync", "replace", "unlink"):
                        setattr(os, name, dying(name, left))
                    play(told)
                    os._exit(0)
                finally:
                    os._exit(1)
        status = os.waitpid(pid, 0)[1]
        killed = status == signal.SIGKILL
        assert killed or status == 0
        kept, saved = len(saved) + (tmp_path / "told").stat().st_size, plain(folder)
        assert kept <= len(saved) and saved == whole[: len(saved)]
    assert saved == whole


@pytest.mark.parametrize("cut", [1, 40, -1])
def test_a_line_that_was_cut_short_is_dropped_and_its_trial_comes_again(tmp_path, cut):
    session = some(tmp_path, 3)
    path = session.folder / "trials.jsonl"
    *lines, last = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines) + last[:cut])
    (session.folder / "answered").write_text("2\n")  # it is written after the line
    with Session(experiment(), tmp_path, "P01", resume=True) as again:
        assert again.number == 3 and again.due() == session.records[2].trial
        again.put(session.records[2].answer, [])
    assert len(read(session.folder).records) == 3


@pytest.mark.parametrize("lines", [4, 0, None])
@pytest.mark.parametrize("witness", ["answered", "the logs", "both"])
def test_lines_that_are_missing_at_the_end_are_told(tmp_path, lines, witness):
    folder = some(tmp_path, 5).folder
    path = folder / "trials.jsonl"
    for n in range(1, 6):
        (folder / f"trial-{n:04}-1.stimlog").mkdir()
    assert len(read(folder).records) == 5 and not list(folder.glob("*.part"))
    (folder / "answered").unlink() if witness == "the logs" else None
    kept = path.read_bytes().splitlines(keepends=True)[:lines]
    path.unlink() if lines is None else path.write_bytes(b"".join(kept))
    if witness == "the logs" and lines == 4:  # as of a session that was killed before the answer
        assert len(read(folder).records) == 4
        return
    last = 4 if witness == "the logs" else 5
    for act in (lambda: read(folder), lambda: some(tmp_path, 0, resume=True)):
        refused(SinkError, f"trials {(lines or 0) + 1} to {last} are missing", act)


@forks
def test_a_fork_of_a_session_writes_nothing(tmp_path):
    with Session(experiment(), tmp_path, "P01") as session:
        answer = observer(session.due(), stream(1))
        session.put(answer, [])
        if (pid := os.fork()) == 0:
            try:
                for act in (session.due, lambda: session.put(answer, [])):
                    refused(SinkError, "no fork of it", act)
                session._close()
                os._exit(0)
            finally:
                os._exit(1)
        assert os.waitpid(pid, 0)[1] == 0
        assert (session.folder / "spare").exists()
        session.due()
        session.put(answer, [])
        refused(SinkError, "cannot be in two", some, tmp_path, 0, resume=True)
    assert len(read(session.folder).records) == 2
    refused(BadValue, "is there already: resume it", some, tmp_path, 0)
    refused(BadValue, "no session .* to resume", some, tmp_path, 0, session=2, resume=True)


TWICE = stimlib.Scene({"force": 2.0 * SPRING.outputs["force"]})


@pytest.mark.parametrize(
    "change",
    [
        Path.unlink,
        lambda path: path.with_name("copy").write_bytes(b"") or path.with_name("copy").rename(path),
        lambda path: path.write_bytes(path.read_bytes()[:-10]),
        lambda path: path.write_bytes(path.read_bytes() + b"{}"),
    ],
)
def test_a_log_that_others_replaced_or_changed_takes_no_answer(tmp_path, change):
    """An answer written to a file that has no name any more would be lost without a
    word.
    """
    with Session(experiment(), tmp_path, "P01") as session:
        first, answer = (observer(session.due(), stream(seed)) for seed in (1, 2))
        session.put(first, [])
        path = session.folder / "trials.jsonl"
        kept = path.read_bytes()
        change(path)
        for act in (session.due, lambda: session.put(answer, [])):
            refused(SinkError, "not as this session wrote it: .*resume", act)
        assert len(session.records) == 1
    path.write_bytes(kept)
    with Session(experiment(), tmp_path, "P01", resume=True) as session:
        session.put(answer, [])
    assert len(read(session.folder).records) == 2


def test_a_log_of_another_experiment_or_version_is_refused(tmp_path, monkeypatch):
    some(tmp_path, 2)
    for other, what in (
        ({"version": "2"}, "experiment.version"),
        ({"bounds": {"k": (0.5, 8.5)}}, "experiment.bounds"),
        ({"seed": 1}, "seed, experiment.seed"),
        ({"scenes": {"spring": TWICE}}, "experiment.scenes"),
    ):
        why = f"another experiment or version: {what} differs"
        refused(BadValue, why, some, tmp_path, 0, experiment(**other), resume=True)
    assert len(some(tmp_path, 1, resume=True).records) == 3
    monkeypatch.setattr("stimlib.experiments.tasks.seed_of", lambda *words: 1)
    refused(BadValue, "line 1: the design gives another trial", some, tmp_path, 0, resume=True)


def test_an_answer_is_on_the_disk_and_its_log_has_room(tmp_path, monkeypatch):
    made = experiment(
        scenes={"spring": stimlib.Scene({"force": SPRING.outputs["force"] * stimlib.Input("y")})},
        motion={"x": still, "y": still},
        timing=Timing(interval=2.0, gap=1.0, before=0.0, ramp=0.0),
    )
    synced, fsync = [], os.fsync
    monkeypatch.setattr(os, "fsync", lambda fd: (synced.append(os.fstat(fd).st_size), fsync(fd)))
    with Session(made, tmp_path, "P01") as session:
        session.put(observer(session.due(), np.random.default_rng(1)), [nothing(None, None)])
        assert (session.folder / "trials.jsonl").stat().st_size in synced
        four = Trial("a", 4 * pair().stimuli[:1], ("softer",))
        # 4 intervals and 3 gaps: two inputs, and what was delivered
        assert session._log_bytes(four) - LOG >= 11 * 1000 * (2 * 8 + 4)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (
            {"design": Own(ConstantStimuli(((TASK, 4.0), (TASK, 80.0)), shuffle="none"))},
            "k = 80 is",
        ),
        ({"design": Own(Staircase(TASK, (7.9, 8.0), (0.5, 80.0), reversals=8))}, None),
        ({"design": Own(Staircase(TASK, (70.0, 80.0), (0.5, 80.0), reversals=8))}, "is beyond"),
        ({"design": Own(ConstantStimuli(((ODD, "red"),)))}, "no question 'odd'"),
        ({"scenes": {"spring": VOLTS}}, r"units \(force \[N\], v \[V\]\); give Safety"),
        (
            {"scenes": {"spring": VOLTS}, "safety": Safety(full_scale={"force": 10.0, "v": 2.0})},
            None,
        ),
    ],
)
def test_trials_ahead_are_checked_before_there_is_a_folder(tmp_path, words, why):
    made = experiment(**{"familiarisation": {"red": Stimulus("spring")}} | words)
    session = Session(made, tmp_path, "P01")
    if why:
        refused((BadValue, UnknownName, UnitError), why, session.check_ahead)
    else:
        session.check_ahead()
    assert not list(tmp_path.iterdir())


def test_data_are_never_overwritten_and_nobody_is_in_two_sessions_at_once(tmp_path, monkeypatch):
    lock, first = safe_files.lock, []

    def late(*words):  # another run begins and ends before this one has the lock
        if not first:
            first.append(None)
            first.append(some(tmp_path, 2))
        return lock(*words)

    monkeypatch.setattr(safe_files, "lock", late)
    refused(BadValue, "is there already", some, tmp_path, 0)
    assert read(first[1].folder).records == first[1].records


def test_a_pilot_is_none_of_the_data(tmp_path):
    pilot = some(tmp_path, 2, pilot=True)
    some(tmp_path, 1)
    assert pilot.folder.name == "PILOT-P01-s1"
    assert [len(sessions("pair", tmp_path, pilot=v)) for v in (False, True)] == [1, 1]
    refused(BadValue, "is a pilot, and no data", read, pilot.folder)
    pilot.folder.rename(tmp_path / "pair" / "P03-s1")  # renamed by hand
    refused(BadValue, "is a pilot", sessions, "pair", tmp_path)
    lines = (tmp_path / "pair" / "P03-s1" / "trials.jsonl").read_text().splitlines()
    assert all(json.loads(line)["pilot"] for line in lines)


def test_an_answer_that_is_none_is_not_written(tmp_path):
    with Session(experiment(), tmp_path, "P01") as session:
        number = [{"lost": np.int64(1)}]
        empty = Simulated(session, lambda trial, rng: Answer({}))
        for put, why in (
            (partial(session.put, Answer({})), "not answered"),
            (partial(session.put, Answer({"softer": "third"})), "answer one of first, second"),
            (partial(session.put, Answer({"softer": "first"}), number), "trial 1: .* no JSON"),
            # it would be asked for ever
            (partial(run, session, empty, nothing), "None is no answer"),
        ):
            refused(BadValue, why, put)
        assert session.number == 1
    assert read(session.folder).records == []


def test_what_the_experimenter_sees_is_blinded(tmp_path):
    shown = {"first": Stimulus("spring"), "second": Stimulus("spring", {"k": 3.0})}
    task = OneInterval("secret", "softer", shown)
    made = experiment(design=ConstantStimuli(((task, "first"), (task, "second")), 2, training=True))
    session = simulate(tmp_path, made, lambda t, rng: Answer({"softer": "first"}))
    saved = read(session.folder)
    told = status(saved)
    assert told["trials"] == told["training"] == 4 and saved.data == [] and told["limited"] == 8
    assert list(told["conditions"].values()) == [4] and "secret" not in json.dumps(told)
    assert blinded(session.seed, "secret") in told["conditions"]
    assert len({blinded(seed, str(k)) for seed in range(5) for k in range(81)}) == 5 * 81


@pytest.mark.parametrize("sink", ["offline", "file", partial(NullSink, clocked=False), "null"])
def test_times_of_a_sink_without_a_clock_are_unknown(tmp_path, sink):
    """Trial 1 would end at 1.7 s and trial 2 begin at 0.7 s, because nobody waits."""
    made = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0))))
    how = {"realtime": False} if sink == "null" else {}
    show = sink if isinstance(sink, str) else lambda trial, at: present(made, trial, sink, at)
    simulate(tmp_path, made, show=show, **how)
    (saved,) = sessions("pair", tmp_path)
    times = [t for r in saved.records for _, *t in r.intervals(saved.header["started"])]
    if sink == "null":
        assert np.diff(times).ravel() == pytest.approx([0.1] * 4, abs=1e-6)
    else:
        assert times == [[None, None]] * 4
    old = {k: v for k, v in saved.records[0].displayed[0].items() if k != "clock"}
    for name, known in (("null", True), ("jack", True), ("offline", False), ("file", False)):
        r = replace(saved.records[0], displayed=[old | {"sink": name}])
        assert all((t is not None) == known for t in r.intervals(old["started"])[0][1:])


def test_a_session_has_simulated_answers_or_those_of_a_participant(tmp_path):
    person, face = tmp_path / "person", Scripted()
    some(person, 2, by=None)
    some(tmp_path / "observer", 2)
    with Session(experiment(), person, "P01", resume=True) as session:
        fake = Simulated(session, observer)
        refused(BadValue, "would get a simulated one", run, session, fake, nothing)
        refused(BadValue, "would get", session.put, fake.answer(session.due()))
    with Session(experiment(), tmp_path / "observer", "P01", resume=True) as session:
        refused(BadValue, "would get one of a participant", run, session, face, nothing)
    assert face.noted == [] and len(session.records) == 2
    simulate(person / "two")
    with Session(experiment(), person / "two", "P09"):
        pass  # it has no answer yet, so it is of neither kind
    saved, empty = sessions("pair", person / "two")
    assert not empty.simulated and all(columns([saved, empty])["simulated"])
    assert saved.simulated and status(saved)["simulated"]
    assert (saved.folder / "trials.jsonl").read_text().count('"simulated": true') == len(saved.data)
    simulate(person, code="P02")
    refused(BadValue, "P02-s1 has simulated answers, .*P01", sessions, "pair", person)


# Around the trials --------------------------------------------------------------------
def test_rests_replays_familiarisation_and_feedback(tmp_path):
    shown = {"first": Stimulus("spring"), "second": Stimulus("spring", {"k": 3.0})}
    day = ConstantStimuli(((OneInterval("c", "softer", shown), "first"),))
    made = experiment(
        design=Sequential({"1": day, "2": day}, pause=60.0),
        familiarisation={"red": Stimulus("spring", {"k": 3.0})},
        replays=1,
        feedback=True,
        instructions="Squeeze.",
    )
    logs, face = [], Scripted(None, None, "first", "second", picks=["red", "red"])

    def show(trial, folder):
        logs.append(folder.name.removesuffix(".stimlog"))
        folder.mkdir()
        return {"log": folder.name}

    session = simulate(tmp_path, made, face, show)
    trials = ["trial-0001-1", "trial-0001-2", "trial-0002-1"]
    assert logs == ["familiarisation-1", "familiarisation-2", *trials]
    asked = [("softer", 1), ("softer", 0), ("softer", 0)]  # the second replay is not there
    assert face.noted[:6] == ["Squeeze.", "Trial 1 of 2", *asked, "Right"]
    assert face.noted[6:9] == [("rest", 60), "Trial 2 of 2", ("softer", 1)]
    assert face.noted[9:] == ["Wrong", "That was the last one. Thank you."]
    first = read(session.folder).records[0]
    assert first.answer.replays == 1
    assert [d["log"] for d in first.displayed] == [f"{name}.stimlog" for name in trials[:2]]


def test_a_rest_is_counted_from_the_last_answer_also_after_a_resume(tmp_path):
    task = Rate("c", ("roughness", "bumpiness"), Stimulus("spring"))
    day = ConstantStimuli(((task, None),), training=True)
    asked = tuple(rating(name, "?", "little", "much") for name in task.questions)
    made = experiment(design=Sequential({"1": day, "2": day}, pause=60.0), questions=asked)
    with Session(made, tmp_path, "P01") as session:
        session.put(Answer({"roughness": 3, "bumpiness": 7}))
    with Session(made, tmp_path, "P01", resume=True) as session:
        assert 55 < session.rest(session.due()) <= 60
        now, record = datetime.now(UTC), session.records[0]
        # a clock that was set back keeps nobody longer
        for passed, left in ((40, 20), (70, 0), (-30, 60)):
            object.__setattr__(record, "ended", (now - timedelta(seconds=passed)).isoformat())
            assert session.rest(session.due()) == pytest.approx(left, abs=2)


@given(
    st.lists(
        st.from_regex(r"\A[A-Za-z0-9]([A-Za-z0-9_-]{0,10}[0-9A-Za-z])?\Z"), min_size=2, max_size=8
    ),
    st.integers(1, 12),
)
@example(["12", "007", "7", "sub-01", "P_01", "P01", "5f3a9bc2d4e18a0012ab34cd", "P01-s1"], 1)
@example(["Group12", "Pilot03", "stroke12", "HC-03", "ANMU12", "A2ZQXKLMNOP1", "010203"], 1)
@example(["Sub1", "ann-1", "Anna12345", "Groups3"], 2)
@example(["7" * 64, "P1", "p1"], 999_999)
@example(["aQd1", "a-1", "qqd1", "q-1", "aqu1", "a_1"], 1)
def test_one_code_is_one_folder_on_every_file_system(tmp_path_factory, codes, session):
    data, made = tmp_path_factory.mktemp("data"), {}
    for code in codes:
        for pilot in (False, True):
            try:
                folder = folder_of("pair", data, code, session, pilot)
            except BadValue as error:
                alike = {c.casefold() for c in {c for c, _ in made} - {code}}
                assert code.casefold() in alike or "must be a code" in str(error)
                continue
            folder.mkdir(parents=True, exist_ok=True)
            made[code, pilot] = folder.name.casefold()
    assert len(set(made.values())) == len(made)
    kept = {c for c, _ in made}
    labels = {subject(c).casefold() for c in kept}
    assert len(labels) == len(kept) and all(v.isascii() and v.isalnum() for v in labels)
    taken = {"12", "007", "sub-01", "P_01", "Group12", "ANMU12", "7" * 64, "HC-03", "q-1"}
    taken |= {
        "5f3a9bc2d4e18a0012ab34cd",
        "Sub1",
        "ann-1",
        "Anna12345",
        "Groups3",
    }  # short, or with a number of many digits
    assert not taken & set(codes) - kept


def test_codes_that_have_sessions_and_are_refused_today_are_read(tmp_path):
    for name in (kept := ["P1-s1", "p1-s1", "Anna1-s1"]):
        (tmp_path / "pair" / name).mkdir(parents=True)
    assert [folder_of("pair", tmp_path, who).name for who in ("P1", "p1", "Anna1")] == kept
