"""The protocol, on the sink without a device: life, errors, changes, reports, and every
way out.
"""

import json
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
import warnings

import numpy as np
import pytest
from devices.servers import (
    SLACK,
    Seen,
    begun,
    faded,
    kept,
    largest_step,
    offline,
    played,
    replayed,
    textured,
)
from refusals import refused, warned

import stimlib
from stimlib import BadValue, FaultError, Input, Param, Scene, SinkError, UnknownName, constant
from stimlib.devices.null import NullSink
from stimlib.devices.sink import CLOSE_WITHIN, Sink
from stimlib.devices.sources import Live
from stimlib.motion.generators import minimum_jerk
from stimlib.run.safety import Safety
from stimlib.scenes import pulse, squeeze

FS = 8000
HAND = {"x1": minimum_jerk(0.02), "x2": minimum_jerk(0.01)}


def steady(value=1.0):
    return Scene({"y": Param("level", value) * 1})


def fast(scene, full_scale=50.0, **options):
    return NullSink(scene, full_scale, clocked=False, **options)


def clocked(scene, full_scale=1.0, **options):
    return NullSink(scene, full_scale, realtime=False, **options)


def test_the_log_tells_when_the_device_was_open(caplog):
    caplog.set_level("INFO", "stimlib.devices")
    sink = played(fast(steady()), 0.1)
    scene = "NullSink(Scene(level [1] -> y [1]), 8000 Hz, 1 channels, blocks of 64)"
    assert caplog.messages == [f"null: opened {scene}", f"null: closed {scene}, {sink.report()}"]


@pytest.mark.parametrize(
    "motion", [lambda t: 0.5 - t, 0.5 - np.arange(800) / FS], ids=["function", "recorded"]
)
def test_the_rise_before_sample_0_leads_to_it(motion):
    scene = Scene({"y": Param("level", 1.0) * Input("x") + 0.01 * stimlib.blocks.white_noise(1)})
    with fast(scene, 10.0, motion={"x": motion}, params={"level": 3.0}, seed=5) as sink:
        sink.open(FS)
        start, firsts = sink.pump.start, []
        sink.pump.start = lambda frames, first: (firsts.append(first), start(frames, first))
        sink.start(seconds=0.1)
        sink.wait()
    y = stimlib.render(scene, {"x": motion}, FS, 0.1, {"level": 3.0}, seed=5)["y"]
    assert firsts[0].tolist() == [y[0]] and y[0] > 1.4 and y[0] != y[1]


@pytest.mark.parametrize("fs", [1000, 8000, 48000])
@pytest.mark.parametrize("block", [16, 32, 64])
@pytest.mark.parametrize("channels", [2, 8, 24])
def test_what_is_delivered_is_the_offline_render(fs, block, channels):
    log, safety = Seen(), Safety(50.0)
    scene = textured()
    sink = played(
        fast(scene, safety, motion=HAND, log=log, seed=3),
        1.0,
        fs=fs,
        channels=channels,
        block=block,
    )
    frames = np.concatenate(log.frames)
    places = [0, 1] + [-1] * (channels - 2)
    assert np.array_equal(frames, offline(scene, safety, HAND, fs, fs, log.events, places, seed=3))
    # all of it is float32(render / full scale): the fades lie outside
    plain = stimlib.render(scene, HAND, fs, 1.0, seed=3).y
    assert np.array_equal(frames[:, :2], (plain / 50.0).astype(np.float32).T)
    assert sink.report().produced == sink.report().delivered == fs
    assert sink.report().rise == sink.report().fall == safety.samples(fs)


def test_channels_by_name():
    log = Seen()
    played(
        fast(Scene({"a": constant(1.0), "b": constant(2.0)}), 4.0, log=log),
        0.1,
        channels=["b", None, "a", "b"],
    )
    assert np.concatenate(log.frames)[400].tolist() == [0.5, 0.0, 0.25, 0.5]


def test_a_session_with_changes_and_parameters():
    log = Seen()
    with begun(
        clocked(squeeze(), 50.0, motion=HAND, params={"k": 1500.0}, log=log), 1.0, block=64
    ) as sink:
        time.sleep(0.3)
        sink.set("k", 800.0, ramp=0.1)
        sink.wait(5)
    produced = sink.report().produced
    assert produced == FS and sink.report().delivered + sink.report().lost == produced
    change = next((at, e) for at, kind, e in log.events if kind == "set" and e["name"] == "k")
    assert (change[0] + 160) % 64 == 0 and change[1] == {"name": "k", "value": 800.0, "ramp": 800}
    whole = replayed(
        squeeze(), Safety(50.0), np.concatenate(log.x, axis=1), FS, log.events, params={"k": 1500.0}
    )
    assert np.array_equal(np.concatenate(log.frames), whole[kept(log.events, produced)])
    assert log.end == sink.report().to_dict() | {"latency": log.end["latency"]}


def test_a_stall_is_told_and_accounted():
    log = Seen()
    with begun(clocked(squeeze(), 50.0, motion=HAND, log=log), 1.5, block=64) as sink:
        time.sleep(0.3)
        sink.pump.write("STALL", 300_000)
        sink.wait(5)
    r = sink.report()
    assert [*r.lateness] == [*r.block_time] == ["p50", "p99", "p99.9", "max"]
    assert f"; late p50 {1e6 * r.lateness['p50']:.0f} us, p99 " in str(r)
    assert r.to_dict()["lateness"] == r.lateness
    sink.pump.lateness[0] += 10_000  # blocks in time
    late = sink.report()
    assert late.lateness["p50"] < 1e-8 < late.block_time["p50"] == r.block_time["p50"]
    assert r.delivered + r.lost == r.produced == 1.5 * FS
    lost = [(at, e["frames"]) for at, kind, e in log.events if kind == "lost"]
    assert (
        max(n for _, n in lost) > 0.25 * FS
        and sum(n for _, n in lost) == r.lost
        and len(lost) == r.underruns
    )
    assert sum(map(len, log.frames)) == r.delivered
    whole = replayed(squeeze(), Safety(50.0), np.concatenate(log.x, axis=1), FS, log.events)
    assert np.array_equal(np.concatenate(log.frames), whole[kept(log.events, 12000)])


def test_the_hand_may_be_pushed():
    log = Seen()
    with fast(Scene({"y": 1 * Input("x")}), 1.0, motion=Live(), log=log) as sink:
        sink.open(FS)
        refused(BadValue, "push: x must be", sink.push, np.zeros((2, 3)))
        assert sink.push(np.full((1, 64), 0.5)) == 64
        sink.start(1.0)
        while not sink.finished:
            sink.push(np.full((1, 64), 0.5))
    assert sink.report().produced == FS
    with pytest.raises(SinkError, match="Live"):
        with fast(steady()) as other:
            other.open(FS)
            other.push(np.zeros((0, 1)))


# Protocol -----------------------------------------------------------------------------
def test_life_in_the_wrong_order():
    sink = fast(steady())
    refused(SinkError, "open the sink first", sink.start)
    refused(SinkError, "never open", sink.report)
    refused(SinkError, "open the sink first", sink.set, "level", 1.0)
    sink.close()
    refused(SinkError, "or closed: make a new one", sink.open, FS)
    sink = fast(steady())
    sink.open(FS)
    refused(SinkError, "opened before", sink.open, FS)
    sink.start(seconds=0.1)
    refused(SinkError, "plays once", sink.start)
    sink.stop()
    sink.stop()
    sink.close()
    sink.close()
    refused(SinkError, "closed", sink.start)
    refused(SinkError, "closed", sink.set, "level", 1.0)
    assert "NullSink" in repr(sink)


@pytest.mark.parametrize(
    "arguments, error, text",
    [
        ({"rate": 0}, BadValue, "sample rate"),
        ({"rate": None}, BadValue, "fs = None must be a number"),
        ({"rate": FS, "channels": 1}, BadValue, "fewer"),
        ({"rate": FS, "channels": ["a", "c"]}, UnknownName, "no output 'c'"),
        ({"rate": FS, "channels": "a"}, BadValue, "list"),
        ({"rate": FS, "channels": []}, BadValue, "list"),
        ({"rate": FS, "block": 0}, BadValue, "block"),
        ({"rate": FS, "block": 1.5}, BadValue, "block"),
    ],
)
def test_what_cannot_be_opened(arguments, error, text):
    refused(error, text, fast(Scene({"a": constant(1.0), "b": constant(2.0)})).open, **arguments)


def test_what_cannot_be_set():
    with fast(steady()) as sink:
        sink.open(FS)
        refused(
            UnknownName,
            "no parameter 'sink_gain'; this scene has level",
            sink.set,
            "sink_gain",
            0.5,
        )
        refused(
            UnknownName,
            "no parameter 'sink_gain'; this scene has level",
            fast(steady(), params={"sink_gain": 1.0}).open,
            FS,
        )
        refused(BadValue, "finite", sink.set, "level", np.nan)
        refused(BadValue, "level = loud must be a number", sink.set, "level", "loud")
        for ramp in (-1, np.inf, 1e18, None):
            refused(BadValue, "ramp", sink.set, "level", 1.0, ramp=ramp)
        for k in range(256):
            sink.set("level", k)
        refused(SinkError, "256 changes", sink.set, "level", 1.0)
    with fast(steady()) as sink:
        sink.open(FS)
        for seconds in (0, -1, 1e-5, np.nan, np.inf, "long"):
            refused(BadValue, "seconds", sink.start, seconds)
    with fast(Scene({"y": 1 * Input("x")}), motion=Live()) as sink:
        sink.open(FS)
        refused(BadValue, "push: x must be numbers", sink.push, [["far"]])
    refused(BadValue, "Scene", NullSink, "squeeze", 1.0)


def test_no_stop_after_a_fault_begins_before_the_guard_has_faded():
    with pytest.raises(FaultError, match="y failed"), begun(clocked(steady())) as sink:
        stop, asked = sink.pump.stop, []
        sink.pump.stop = lambda reason, earliest=0: (
            asked.append((reason, earliest)),
            stop(reason, earliest),
        )
        sink._fail(FaultError("y failed"), 800)
        sink._fail(OSError("the disk is full"))
        sink.stop()
    assert asked == [("fault", 800), ("error", 800), ("stop", 800)]


def test_an_output_that_fails_ends_the_session_with_its_name():
    log = Seen()
    x = np.ones((1, 4 * FS))
    x[0, 4000] = np.nan
    scene = Scene({"good": constant(1.0), "bad": 1 * Input("x")})
    with pytest.raises(FaultError, match="output bad was not finite at sample 4000"):
        with begun(clocked(scene, motion={"x": x[0]}, log=log)) as sink:
            sink.wait(10)
    assert sink.report().faults == {"bad": 4000}
    y = np.concatenate(log.frames)
    assert largest_step(y, log.events) < 0.01 and not y[-1].any(), "the good output is faded too"
    assert sink._earliest == 4000 + FS // 50 + 1, (
        "the session fades when the output has: two fades at once are steeper"
    )
    assert len(y) < 2 * FS
    assert (4000, "fault", {"output": "bad"}) in log.events and log.end["faults"] == {"bad": 4000}


def test_what_was_limited_is_counted():
    log = Seen()
    sink = played(fast(steady(5.0), 1.0, log=log), 0.5)
    assert sink.report().clips == {"clip": {"y": 4000}} and "4000 samples limited (clip)" in str(
        sink.report()
    )
    assert [e for _, kind, e in log.events if kind == "clip"][-1] == {
        "counts": {"clip": {"y": 4000}}
    }


def test_a_log_that_fails_ends_the_session():
    class Full(Seen):
        def delivered(self, frames):
            if sum(map(len, self.frames)) > 2000:
                raise OSError(28, "No space left on device")
            super().delivered(frames)

    with pytest.raises(SinkError, match="log cannot be written.*No space"):
        with begun(clocked(steady(), log=Full())) as sink:
            sink.wait(10)
    assert sink.finished and sink.pump.index < 5 * FS, "it has faded out"


def test_a_log_that_cannot_take_every_change_is_told():
    with pytest.raises(SinkError, match="the log cannot follow"):
        with begun(clocked(steady(), log=Seen())) as sink:
            sink.pump.write("DROPPED", 1)
            sink.wait(10)


def test_a_log_may_close_its_sink():
    class Closes(Seen):
        def event(self, at, kind, **data):
            super().event(at, kind, **data)
            if data.get("name") == "level":
                sink.close()

    log = Closes()
    sink = begun(clocked(steady(), log=log))
    sink.set("level", 0.5)
    sink._worker.join(10)
    assert sink.error is None and log.end["produced"] == sum(map(len, log.frames)) + log.end["lost"]


def test_a_log_that_fails_does_not_cut_the_fade_short():
    """The device is still there: close waits for the fade."""

    class Full(Seen):
        def delivered(self, frames):
            raise OSError(28, "No space left on device")

    sink = begun(clocked(steady(), log=Full()))
    end = time.monotonic() + 10
    while sink.error is None and time.monotonic() < end:
        time.sleep(0.001)
    sink.close()
    assert sink.finished


# Ways out -----------------------------------------------------------------------------
@pytest.mark.parametrize("way", ["stop", "close", "leave", "exception", "keyboard", "end"])
def test_every_way_out_fades(way):
    log = Seen()
    try:
        with begun(clocked(steady(), log=log), 0.2 if way == "end" else None) as sink:
            time.sleep(0.3)
            if way == "stop":
                sink.stop()
            elif way == "close":
                sink.close()
            elif way == "exception":
                raise ValueError("an experiment's mistake")
            elif way == "keyboard":
                raise KeyboardInterrupt
    except (ValueError, KeyboardInterrupt):
        assert way in ("exception", "keyboard")
    faded(np.concatenate(log.frames), log.events)
    assert sink.finished


CHILD = """
import json, signal, sys, time, threading
import numpy as np
import stimlib
from stimlib.devices.null import NullSink
frames, events = [], []
class Log:
    def motion(self, x): pass
    def delivered(self, f): frames.append(f.copy())
    def event(self, at, kind, **data): events.append((at, kind, data))
    def close(self, report):
        np.savez(sys.argv[1], frames=np.concatenate(frames), events=json.dumps(events))
sink = NullSink(stimlib.Scene({"y": stimlib.constant(1.0)}), 1.0, log=Log(), realtime=False)
sink.open(8000)
sink.start()
time.sleep(0.2)
print("playing", flush=True)
"""


@pytest.mark.parametrize(
    "more, what, code",
    [
        ("sink.wait(20)", signal.SIGTERM, 143),
        ("sink.wait(20)", signal.SIGINT, -2),
        ("sink.wait(20)", signal.SIGHUP, 129),
        ("with sink: sink.wait(20)", signal.SIGTERM, 143),
        ("with sink: sink.wait(20)", signal.SIGINT, -2),
        ("raise SystemExit(3)", None, 3),
        ("", None, 0),
        ("1 / 0", None, 1),
    ],
)
@pytest.mark.longer
def test_signals_and_the_end_of_the_program_fade(tmp_path, more, what, code):
    path = tmp_path / "frames.npz"
    child = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(CHILD) + more, path],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert child.stdout.readline() == "playing\n", child.stderr.read()
        began = time.monotonic()
        if what:
            child.send_signal(what)
        child.communicate(timeout=30)
        assert time.monotonic() - began < CLOSE_WITHIN + 1 + SLACK
    finally:
        child.kill()
    assert child.returncode == code
    with np.load(path) as saved:
        y, events = saved["frames"], json.loads(str(saved["events"]))
    faded(y, events)


@pytest.mark.parametrize("what", [signal.SIGINT, signal.SIGTERM])
def test_an_impatient_signal_does_not_cut_the_fade_or_the_log(tmp_path, what):
    """Ctrl-C again and again: the fade is half a second here, the device takes another
    half to close.
    """
    slow = """
sink._close_now, sink._close = sink._close, lambda: (time.sleep(0.5), sink._close_now())
with sink: sink.wait(20)"""
    path, text = tmp_path / "frames.npz", CHILD
    text = text.replace("1.0)}), 1.0,", "1.0)}), Safety(1.0, fade=0.5),").replace(
        "time.sleep(0.2)", "time.sleep(0.8)"
    )
    text = "from stimlib.run.safety import Safety\n" + text + slow
    child = subprocess.Popen(
        [sys.executable, "-c", text, path],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert child.stdout.readline() == "playing\n", child.stderr.read()
        for _ in range(4):
            child.send_signal(what)
            time.sleep(0.15)
        child.communicate(timeout=30)
    finally:
        child.kill()
    # on a busy machine the last one may come when the session is over, and all is given
    # back
    late = -what
    assert child.returncode in (late, 143 if what == signal.SIGTERM else -2)
    with np.load(path) as saved:
        y, events = saved["frames"], json.loads(str(saved["events"]))
    faded(y, events, fade=4000)


def test_a_program_that_ends_needs_no_new_thread_to_close(monkeypatch):
    """From Python 3.12 on none can be started then."""

    def no(self):
        raise RuntimeError("can't create new thread at interpreter shutdown")

    log = Seen()
    sink = begun(clocked(steady(), log=log))
    monkeypatch.setattr(threading.Thread, "start", no)
    sink.close()
    assert not sink._thread.is_alive() and log.end["produced"] == sink.report().produced


def test_sinks_share_the_process():
    """The first to close leaves signals and memory as the second needs them."""
    import gc

    with (
        NullSink(steady(), 1.0, realtime=True) as first,
        NullSink(steady(), 1.0, realtime=True) as second,
    ):
        for sink in (first, second):
            sink.open(FS)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # what is not permitted here
                sink.start()
        first.close()
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        assert gc.get_freeze_count() > 0
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    assert gc.get_freeze_count() == 0


def test_sigterm_is_given_back():
    # where another test's last sink has ended in another thread it was kept
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with begun(clocked(steady())):
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


class Stuck(NullSink):
    """A device whose close never comes back, and (dead) which calls no more."""

    device = "stuck"
    let_go = threading.Event()

    def _close(self):
        self.let_go.wait(20)
        super()._close()


@pytest.mark.longer
def test_close_comes_back_from_a_device_that_hangs():
    Stuck.let_go.clear()
    sink = begun(Stuck(steady(), 1.0, realtime=False))
    time.sleep(0.2)
    began = time.monotonic()
    warned(RuntimeWarning, "left behind", sink.close)
    assert time.monotonic() - began < CLOSE_WITHIN + SLACK
    assert sink.pump.state == sink.pump.native.CLOSED
    Stuck.let_go.set()


@pytest.mark.longer
def test_close_comes_back_while_another_thread_stops():
    """Their times together."""
    Stuck.let_go.clear()
    sink = begun(Stuck(steady(), Safety(1.0, fade=0.5), realtime=False))
    time.sleep(0.2)
    other = threading.Thread(target=sink.stop)
    other.start()
    while not sink._stopped:
        time.sleep(0.001)
    began = time.monotonic()
    warned(RuntimeWarning, "left behind", sink.close)
    assert time.monotonic() - began < CLOSE_WITHIN + SLACK
    other.join()
    Stuck.let_go.set()


class Dead(Sink):
    device, clock = "dead", False

    def _open(self):
        pass


def test_a_device_with_a_clock_that_never_calls_is_lost(monkeypatch):
    monkeypatch.setattr(Dead, "clock", True)
    assert 0 < Sink.silent_for < 10
    monkeypatch.setattr(Sink, "silent_for", 0.2)
    with pytest.raises(SinkError, match=r"dead: the device has taken no samples for 0\.2 s"):
        with begun(Dead(steady(), 1.0, realtime=False)) as sink:
            sink.wait(5)


@pytest.mark.longer
def test_close_comes_back_from_a_device_that_calls_no_more():
    sink = begun(Dead(steady(), 1.0))
    began = time.monotonic()
    sink.close()
    assert time.monotonic() - began < CLOSE_WITHIN + SLACK
    assert sink.report().produced == 0


def test_a_device_that_cannot_be_opened_is_let_go():
    class Busy(NullSink):
        closed = False

        def _open(self):
            raise SinkError("busy")

        def _close(self):
            self.closed = True

    sink = Busy(steady(), 1.0)
    refused(SinkError, "busy", sink.open, FS)
    assert sink.closed
    sink.close()


def test_a_device_that_comes_later_can_be_opened_then():
    class Late(NullSink):
        there = False

        def _open(self):
            if not self.there:
                raise SinkError("no server")
            super()._open()

    sink = Late(steady(), 1.0, clocked=False)
    refused(SinkError, "no server", sink.open, FS)
    sink.there = True
    with begun(sink, 0.1):
        sink.wait(10)
    assert sink.report().produced == 800 and not sink._thread.is_alive()


def test_blocks_that_are_longer_than_a_stop_may_take_are_refused():
    refused(
        SinkError,
        "blocks of 2001 frames are 0.25 s.*at most 2000",
        clocked(steady()).open,
        FS,
        block=2001,
    )
    sink = played(clocked(steady()), block=2000, patience=0.6)
    assert sink.pump.read("FADING") == 1 and sink.pump.index == sink.pump.read("END"), (
        "it has faded out"
    )
    with fast(steady()) as sink:  # no clock, no time
        sink.open(FS, block=8000)


def test_an_open_sink_is_kept_though_nobody_holds_it():
    """The device calls into its memory."""
    import gc
    import weakref

    class Silent(NullSink):
        def _open(self):
            self.block = 64

    sink = Silent(steady(), 1.0)
    sink.open(FS)
    seen = weakref.ref(sink)
    del sink
    gc.collect()
    assert seen() is not None
    seen().close()


# Real time ----------------------------------------------------------------------------
def test_real_time_set_up_warns_at_most_once_and_is_undone():
    import gc

    before = gc.get_freeze_count()
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        with begun(NullSink(steady(), 1.0, realtime=True), 0.3) as sink:
            assert gc.get_freeze_count() > before
            sink.wait(5)
    assert gc.get_freeze_count() == 0
    assert len(seen) <= 1 and all("not permitted" in str(w.message) for w in seen)
    assert os.sched_getscheduler(0) == os.SCHED_OTHER, "only the device's thread has a priority"


def test_a_rendering_plays_itself():
    result = stimlib.render(pulse(1.0, repeats=1, channels=2), fs=8000, seconds=0.1)
    report = result.play(sink="null", clocked=False, channels=3, log=(log := Seen()))
    assert (report.delivered, report.lost, report.clips) == (800, 0, {})
    y = np.concatenate(log.frames)  # 20 dB below full scale
    scaled = (np.stack([result["signal0"], result["signal1"]]) / 10).astype(np.float32)
    assert np.array_equal(y.T, [*scaled, np.zeros(800)]) and y.max() == np.float32(0.1)
    with pytest.raises(BadValue, match="choose one of null, jack, portaudio"):
        result.play(sink="speaker")
    force = stimlib.render(pulse(unit="N"), fs=8000, seconds=0.1)
    with pytest.raises(BadValue, match="signal is in N"):
        force.play(sink="null")
    assert force.play(sink="null", clocked=False, full_scale=2.0).delivered == 800
