"""Where motion comes from, and how a scripted hand keeps up."""

import subprocess
import sys

import numpy as np
import pytest
from devices.servers import Seen, begun, played
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Scene, SinkError, UnknownName
from stimlib.devices import ControlLoop, NullSink
from stimlib.devices.sources import (
    Live,
    Recorded,
    Scripted,
    Signal,
    Signals,
    columns_of,
    length,
    source_of,
)
from stimlib.motion.generators import minimum_jerk

FS = 8000


def test_a_mapping_is_a_recording_or_a_hand():
    both = source_of({"b": np.arange(5), "a": np.zeros(7)}, ("a", "b"))
    assert isinstance(both, Recorded) and both.x.shape == (2, 5)
    assert both.x[1].tolist() == [0, 1, 2, 3, 4]
    hand = source_of({"a": np.sin, "b": np.zeros(7)}, ("a", "b"))
    endless = source_of({"a": np.sin}, ("a",))
    assert isinstance(hand, Scripted) and source_of(None, ()) is None
    assert [length(s) for s in (both, hand, endless, Live())] == [5, 7, None, None]


ZEROS = np.zeros(3)
SCENE = Scene({"y": 1 * Input("x")})
STILL = Scene({"y": stimlib.constant(1.0)})


@pytest.mark.parametrize(
    ("call", "error", "says"),
    [
        *(
            (lambda motion=motion: source_of(motion, ("a", "b")), error, None)
            for motion, error in [
                (None, BadValue),
                (3, BadValue),
                ({"a": ZEROS}, UnknownName),
                ({"a": ZEROS, "b": ZEROS, "c": ZEROS}, UnknownName),
                ({"a": np.zeros((2, 3)), "b": ZEROS}, BadValue),
                ({"a": np.zeros(0), "b": ZEROS}, BadValue),
                (Recorded(np.zeros((3, 10))), BadValue),
                (Signals({"a": Signal(1.0)}), UnknownName),
                (Scripted({"a": np.sin}), UnknownName),
            ]
        ),
        (lambda: Live(0.0), BadValue, "keep"),
        (lambda: Signal(np.nan), BadValue, "finite"),
        (lambda: Recorded(ZEROS), BadValue, "shape"),
        (lambda: columns_of("push: ", np.zeros((2, 3)), ["x"]), BadValue, "push: x must be"),
        (lambda: columns_of("push: ", [["far"]], ["x"]), BadValue, "push: x must be numbers"),
        (lambda: NullSink("squeeze", 1.0), BadValue, "Scene"),
        (lambda: NullSink(SCENE, 1.0), BadValue, "motion"),
        (lambda: NullSink(SCENE, motion={"x": ZEROS}), BadValue, "safety is missing"),
        (lambda: NullSink(STILL, 1.0, motion={"x": np.sin}), UnknownName, None),
    ],
)
def test_what_does_not_fit(call, error, says):
    refused(error, says, call)


@pytest.mark.parametrize("order", [("a", "b"), ("b", "a")])
@pytest.mark.parametrize("one", [True, False])
def test_rows_of_several_inputs_are_pushed_and_read_by_name(order, one):
    """In whatever order they are given, and no array can take the place of another."""
    scene = Scene({"y": Input("a") - 2.0 * Input("b")})
    rows = {"a": 3.0, "b": 1.0} if one else {"a": np.full(4, 3.0), "b": np.ones(4)}
    given = {name: rows[name] for name in order}
    assert np.array_equal(
        columns_of("push: ", given, ["b", "a"]), [[1.0] * (4 - 3 * one), [3.0] * (4 - 3 * one)]
    )
    with NullSink(scene, 50.0, motion=Live(), clocked=False) as sink:
        sink.open(FS)
        odd = [1.0, 2.0, 3.0], np.ma.array([1, 2], mask=[0, 1]), [[1.0], [2.0, 3.0]]
        lost = [2, np.nan], np.ma.array([2, 3], mask=[0, 1], dtype=float)
        for error, says, pushed in (
            (BadValue, "push: .* no names; give {'a': .., 'b': ..}", np.ones((2, 4))),
            (UnknownName, "push: b is missing", {"a": 1.0}),
            (UnknownName, "push: there is no input c", given | {"c": 0.0}),
            *((BadValue, "push: x must be numbers", {"a": [1.0, 2.0], "b": bad}) for bad in odd),
            *((BadValue, "push: b is nan in column 1", {"a": [0, 1], "b": bad}) for bad in lost),
        ):
            refused(error, says, sink.push, pushed)
        assert sink.push(given) == (1 if one else 4)
    written = []
    loop = ControlLoop(scene, 50.0, lambda: given, written.append, realtime=False)
    played(loop, 0.3, fs=1000)
    assert max(float(y[0]) for y in written) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("clocked", [False, True])
def test_a_scripted_hand_is_its_function_of_time(clocked):
    hand, log, seconds = minimum_jerk(0.02), Seen(), 1.5 if clocked else 30.0
    scene, n = Scene({"y": 1.0 * Input("x", "m"), "z": Input("w") * 1}), round(seconds * FS)
    motion = {"x": hand, "w": np.linspace(0, 1, n)}
    how = {"motion": motion, "clocked": clocked, "log": log, "realtime": False}
    with begun(NullSink(scene, {"y": 1.0, "z": 1.0}, **how)) as sink:
        sink.wait(60)
        assert sink.finished
    x = np.concatenate(log.x, axis=1)
    expected = np.stack([hand(np.arange(n) / FS), motion["w"]])
    late = (x != expected).any(axis=0)
    # on a busy machine the hand may be late: then it is held, and goes on where it
    # belongs
    assert x.shape == expected.shape and not late[:64].any() and late.any() <= clocked


@pytest.mark.parametrize("w", [np.cos, np.zeros(800)])
def test_arrays_beside_a_function_end_the_session_and_alone_are_held(w):
    scene = Scene({"y": Input("x") + 0.0 * Input("w")})
    sink = NullSink(scene, 1.0, motion={"x": np.full(400, 0.5), "w": w}, clocked=False)
    report = played(sink, 0.1, patience=20.0).report()
    assert (report.produced, report.stale) == (400 if w is np.cos else 800, 0)


def test_a_log_may_keep_what_it_is_given():
    """Also the motion of one input, whose row lies in the memory of the sink."""
    log, x = Seen(), np.arange(20_000) * 1e-5
    scene = Scene({"y": 1 * Input("x")})
    played(NullSink(scene, 1.0, motion={"x": x}, clocked=False, log=log))
    assert np.array_equal(np.concatenate(log.x, axis=1), [x])


FIRST = """
import sys
import stimlib
from stimlib.devices import Live, NullSink

with NullSink(stimlib.Scene({"y": 1.0 * stimlib.Input("x")}), 1.0, motion=Live()) as sink:
    sink.open(8000)
    there = {*sys.modules}
    sink.push({"x": 0.5})
print(*{*sys.modules} - there)
"""


def test_the_first_push_of_a_program_loads_nothing():
    """It took longer than a watchdog waits for the first period of a control loop."""
    done = subprocess.run([sys.executable, "-c", FIRST], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "\n"), done.stdout + done.stderr


def test_a_session_begins_with_the_newest_of_what_was_pushed_before():
    """A tracker's thread may run for long: its reports are not the next samples."""
    log = Seen()
    sink = NullSink(Scene({"y": 1.0 * Input("x")}), 400.0, motion=Live(), log=log, realtime=False)
    with sink:
        sink.open(8000)
        for k in range(300):
            assert sink.push({"x": float(k)}) == 1
        sink.start(0.1)
        sink.wait()
    assert {*np.concatenate(log.x, axis=1)[0].tolist()} == {299.0}


def test_a_hand_that_is_no_number_is_told_with_its_sample():
    """At once, where it is seen before the start; how it fades: test_functions."""
    broken = {"x": lambda t: np.where(t < 1.0, 0.5, np.nan)}
    sink = NullSink(SCENE, 1.0, motion=broken, clocked=False)
    refused(SinkError, "the motion failed: .* at sample 8000", played, sink, 10)
    with NullSink(SCENE, 1.0, motion={"x": lambda t: t * np.nan}) as sink:
        refused(BadValue, "not finite", begun, sink)
