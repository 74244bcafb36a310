"""What a sink without a device shows of all: rises, pushed hands, logs that fail,
devices that hang, and the process that sinks share.
"""

import gc
import os
import signal
import threading
import warnings
import weakref
from contextlib import suppress

import numpy as np
import pytest
from devices.servers import Seen, begun, played, until
from devices.stands import FS, STEADY
from refusals import refused

import stimlib
from stimlib import BadValue, FaultError, Input, Param, Scene, SinkError
from stimlib.devices import NullSink, Sink, null, words
from stimlib.devices.process import open_sinks
from stimlib.files.log_reader import read_log
from stimlib.run.safety import Safety
from stimlib.scenes import pulse


def fast(scene=STEADY, full_scale=50.0, **options):
    return NullSink(scene, full_scale, clocked=False, **options)


def clocked(scene=STEADY, full_scale=1.0, **options):
    return NullSink(scene, full_scale, realtime=False, **options)


@pytest.mark.parametrize(
    "motion", [lambda t: 0.5 - t, 0.5 - np.arange(800) / FS], ids=["function", "recorded"]
)
@pytest.mark.parametrize("jump", [0.0, 2.0])
def test_the_rise_before_sample_0_leads_to_it(motion, jump):
    scene = Scene({"y": Param("level", 1.0) * Input("x") + 0.01 * stimlib.blocks.white_noise(1)})
    params = {"level": 3.0 - jump}
    with fast(scene, 10.0, motion={"x": motion}, params=params, seed=5) as sink:
        sink.open(FS)
        if jump:
            sink.set("level", 3.0, ramp=0.0)
        start, firsts = sink.pump.start, []
        sink.pump.start = lambda frames, first: (firsts.append(first), start(frames, first))
        sink.start(seconds=0.1)
        sink.wait()
    y = stimlib.render(scene, {"x": motion}, FS, 0.1, {"level": 3.0}, seed=5)["y"]
    assert firsts[0].tolist() == [y[0]] and y[0] > 1.4 and y[0] != y[1]


def test_a_marker_waits_until_its_time_is_known():
    """Blocks may follow each other so quickly that none of their times is read.

    A short session reads three times at its end alone: no more than two may fail here.
    """
    log = Seen()
    with fast(STEADY, log=log, markers=["y"]) as sink:
        sink.open(FS)
        timed, unread = sink.pump.timed, iter(range(2))
        sink.pump.timed = lambda: timed() if next(unread, None) is None else None
        sink.start(0.2)
        sink.wait()
    marks = [e for _, kind, e in log.events if kind == "mark"]
    assert next(unread, None) is None and len(marks) == 1
    assert np.isfinite([marks[0]["time"], marks[0]["uncertainty"]]).all()


def test_a_log_that_fails_ends_with_what_it_has(tmp_path):
    """Whatever the thread that writes it dies of: its files are closed."""
    sink = fast(STEADY, log=tmp_path / "log", motion={})
    with pytest.raises(SinkError, match="log cannot be written"), sink:
        sink.open(FS)
        sink.start()
        writer = sink._recorder.writer
        sink.watch(lambda at, x, y: 1 / 0)
        sink.wait(60)
    assert writer._events.closed and not (tmp_path / "log" / "report.json").exists()


def test_no_stop_after_a_fault_begins_before_the_guard_has_faded():
    with pytest.raises(FaultError, match="y failed"), begun(clocked()) as sink:
        stop, asked = sink.pump.stop, []
        sink.pump.stop = lambda reason, earliest=0: (
            asked.append((reason, earliest)),
            stop(reason, earliest),
        )
        sink._fail(FaultError("y failed"), 800)
        sink._fail(OSError("the disk is full"))
        sink.stop()
    assert asked == [("fault", 800), ("error", 800), ("stop", 800)]


# Logs ---------------------------------------------------------------------------------
def test_a_log_that_cannot_take_every_change_is_told():
    with pytest.raises(SinkError, match="the log cannot follow"), begun(clocked(log=Seen())) as s:
        s.pump.write("DROPPED", 1)
        s.wait(60)


class Still(NullSink):
    """A device that never asks for a block."""

    def start_loop(self, loop):
        pass


def test_a_device_that_goes_before_its_first_block_leaves_a_whole_log(tmp_path):
    sink = begun(Still(STEADY, 1.0, realtime=False, log=tmp_path))
    sink.mark("trial", sample=0)
    sink.device_lost("it has gone")
    sink.close()
    log = read_log(tmp_path)
    assert log.report["delivered"] == log.report["markers"] == 0


def test_a_log_may_close_its_sink():
    class Closes(Seen):
        def event(self, at, kind, **data):
            super().event(at, kind, **data)
            if data.get("name") == "level":
                sink.close()

    log = Closes()
    sink = begun(clocked(log=log))
    sink.set("level", 0.5)
    sink._worker.join(60)
    assert sink.error is None and log.end["produced"] == sum(map(len, log.frames)) + log.end["lost"]


def test_a_sink_that_is_closed_while_it_begins_ends_its_threads_and_its_log(tmp_path):
    def leaves(t):
        if hasattr(sink, "pump"):
            sink.close()
        return 0.0 * t

    sink = clocked(Scene({"y": 1 * Input("x")}), motion={"x": leaves}, log=tmp_path)
    refused(SinkError, "closed meanwhile", begun, sink)
    for thread in (sink._feeder, sink._telling.thread, sink._worker):
        thread.join(60)
        assert not thread.is_alive()
    assert read_log(tmp_path).report["produced"] == 0


def test_a_sink_that_is_stopped_while_it_begins_plays_nothing():
    sink = clocked()
    sink._start = sink.stop  # as another thread does, while a device settles
    assert played(sink, patience=20.0).finished and sink.report().produced == 0


# The process --------------------------------------------------------------------------
def test_a_program_that_ends_needs_no_new_thread_to_close(monkeypatch):
    """From Python 3.12 on none can be started then."""

    def no(self):
        raise RuntimeError("can't create new thread at interpreter shutdown")

    log = Seen()
    sink = begun(clocked(log=log))
    monkeypatch.setattr(threading.Thread, "start", no)
    sink.close()
    assert not sink._thread.is_alive() and log.end["produced"] == sink.report().produced


def test_real_time_warns_once_and_is_given_back_by_the_last_sink():
    """The first to close leaves signals and memory as the second needs them."""
    # where another test's last sink has ended in another thread it was kept
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    before = gc.get_freeze_count()
    first, second = NullSink(STEADY, 1.0, realtime=True), NullSink(STEADY, 1.0, realtime=True)
    with first, second, warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        for sink in (first, second):
            begun(sink)
        assert len(seen) <= 2 and all("not permitted" in str(w.message) for w in seen)
        first.close()
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        assert gc.get_freeze_count() > before
        assert os.sched_getscheduler(0) == os.SCHED_OTHER, "only the device's thread is raised"
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL and gc.get_freeze_count() == 0


@pytest.mark.parametrize("granted", [True, False])
def test_a_thread_that_is_given_no_real_time_priority_says_so(monkeypatch, granted):
    monkeypatch.setattr(null, "fifo", lambda: granted)
    with NullSink(STEADY, 1.0) as sink, warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        sink.open(FS)
        until(lambda: sink.pump.read("CALLS"))
        sink.start()
    assert any("ulimit -r" in str(w.message) for w in seen) != granted


def test_an_open_sink_is_kept_though_nobody_holds_it():
    """The device calls into its memory."""

    class Silent(NullSink):
        def _open(self):
            self.block = 64

    sink = Silent(STEADY, 1.0)
    sink.open(FS)
    seen = weakref.ref(sink)
    del sink
    gc.collect()
    assert seen() is not None
    seen().close()


# Devices that hang, or come late ------------------------------------------------------
class Stuck(NullSink):
    """A device whose close never comes back."""

    device = "stuck"

    def _close(self):
        self.let_go.wait(60)
        super()._close()


@pytest.mark.parametrize("also", ["alone", "while another thread stops"])
def test_close_comes_back_from_a_device_that_hangs(also):
    sink = begun(Stuck(STEADY, Safety(1.0, fade=0.5), realtime=False))
    sink.let_go = threading.Event()
    until(lambda: sink.pump.index > 100)
    other = threading.Thread(target=sink.stop if also != "alone" else sink.check)
    other.start()
    until(lambda: sink._stopped or also == "alone")
    refused(RuntimeWarning, "left behind", sink.close)  # warnings are errors in tests
    assert sink.pump.state == words.CLOSED and sink._closer.is_alive()
    assert sink not in open_sinks and not sink._worker.is_alive()
    sink.let_go.set()
    other.join()


def test_a_start_whose_warning_is_an_error_leaves_nothing_playing(monkeypatch):
    monkeypatch.setattr("stimlib.devices.sink.begin_playing", lambda sink: ["real time"])
    sink = NullSink(STEADY, 1.0)
    sink.open(FS)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refused(RuntimeWarning, "not permitted here: .*real time", sink.start)
    assert sink.pump.state == words.CLOSED and sink not in open_sinks


class Dead(Sink):
    """A device that never calls."""

    device, clock = "dead", False

    def _open(self):
        pass


def test_a_close_in_the_last_fade_waits_for_its_end():
    """It is of whole blocks, and has no samples."""
    with begun(clocked(STEADY, Safety(1.0, fade=0.5)), 0.1, block=1600) as sink:
        until(lambda: sink.pump.index == 800)
    assert sink.report().fall == 4000


def test_a_device_that_never_calls_is_lost_or_closed(monkeypatch):
    with begun(Dead(STEADY, 1.0)) as sink:
        sink.close()
    assert sink.report().produced == 0 and 0 < Sink.silent_for < 10
    monkeypatch.setattr(Dead, "clock", True)
    monkeypatch.setattr(Sink, "silent_for", 0.2)
    says = r"dead: the device has taken no samples for 0\.2 s"
    refused(SinkError, says, played, Dead(STEADY, 1.0, realtime=False), patience=60)


def test_a_device_that_cannot_be_opened_is_let_go_and_can_be_opened_later():
    class Late(NullSink):
        there, closed = False, 0

        def _open(self):
            if not self.there:
                raise SinkError("busy")
            super()._open()

        def _close(self):
            self.closed += 1
            with suppress(AttributeError):  # it has no loop yet
                super()._close()

    sink = Late(STEADY, 1.0, clocked=False)
    refused(SinkError, "busy", sink.open, FS)
    assert sink.closed == 1
    sink.there = True
    played(sink, 0.1)
    assert sink.report().produced == 800 and not sink._thread.is_alive() and sink.closed == 2


def test_blocks_that_are_longer_than_a_stop_may_take_are_refused():
    refused(SinkError, "2001 frames.*at most 2000", clocked().open, FS, block=2001)
    sink = played(clocked(), block=2000, patience=0.6)
    assert sink.pump.read("FADING") == 1 and sink.pump.index == sink.pump.read("END")
    with fast() as sink:  # no clock, no time
        sink.open(FS, block=8000)


def test_a_rendering_plays_itself():
    result = stimlib.render(pulse(1.0, repeats=1, channels=2), fs=8000, seconds=0.1)
    report = result.play(sink="null", clocked=False, channels=3, log=(log := Seen()))
    assert (report.delivered, report.lost, report.clips) == (800, 0, {})
    y = np.concatenate(log.frames)  # 20 dB below full scale
    scaled = (np.stack([result["signal0"], result["signal1"]]) / 10).astype(np.float32)
    assert np.array_equal(y.T, [*scaled, np.zeros(800)]) and y.max() == np.float32(0.1)
    refused(BadValue, "choose one of null", result.play, sink="speaker")
    force = stimlib.render(pulse(unit="N"), fs=8000, seconds=0.1)
    refused(BadValue, "signal is in N", force.play, sink="null")
    assert force.play(sink="null", clocked=False, full_scale=2.0).delivered == 800
