"""A start at a given time: of devices whose time is known, and of real servers."""

import time
from itertools import count

import numpy as np
import pytest
from devices.servers import Capture, Jackd, Seen, needs_jack, until
from devices.stands import needs_portaudio, portaudio
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, SinkError
from stimlib.devices import JackSink, Live, NullSink, PortAudioSink
from stimlib.devices.markers import behind

FS = 8000
STEADY = Scene({"y": stimlib.constant(1.0)})


class Known(NullSink):
    """A device whose time of each frame is known; its calls are late by chance."""

    drift, lost_at, latency = 0.0, -1, 0.0

    def _loop(self):
        rng, self.zero = np.random.default_rng(self.seed), time.monotonic()
        self.frames, at = [], 0
        for block in count():
            if self.closing:
                return
            lost = 5 * (block == self.lost_at)  # which comes while it waits
            at += lost
            due = self.zero + at * (1 - self.drift) / self.rate + rng.exponential(3e-4)
            time.sleep(max(0.0, due - time.monotonic()))
            self.pump.block(self.block, lost=lost)
            if self._frames.any():
                self.frames.append((at, self._frames[0].copy()))
            at += self.block

    def _latency(self):
        return self.latency

    def off(self, at):
        """Samples from the time until sample 0 has left, the first of full scale."""
        frame = next(at + np.argmax(y == 1.0) for at, y in self.frames if (y == 1.0).any())
        return (self.zero + self.latency - at) * self.rate + frame * (1 - self.drift)


@pytest.mark.parametrize("drift", [0.0, 200e-6, -200e-6])
@pytest.mark.parametrize("lost_at", [-1, 12])
def test_sample_0_leaves_at_the_given_time(drift, lost_at):
    """Whatever the device's drift and latency, and what it has lost while it waited."""
    errors = []
    for seed in range(3):
        sink = Known(STEADY, 1.0, seed=seed, realtime=False)
        sink.drift, sink.lost_at, sink.latency = drift, lost_at, 0.013 * seed
        with sink:
            sink.open(FS, block=32)
            at = time.monotonic() + 0.5 + 0.1 * seed
            sink.start(0.1, at=at)
            due, uncertainty = sink.time_of(0)
            assert abs(due - at) < 0.1 or np.isnan(due)
            until(lambda sink=sink: sink.pump.index > 0)
            sink.wait()
        report = sink.report()
        assert (report.rise, report.produced) == (160, 800)
        assert sum(np.count_nonzero(y) for _, y in sink.frames) <= 160 + 800 + 160
        errors.append(sink.off(at))
        assert f"began {1e3 * report.start_error:.3f} ms after the given time" in str(report)
    # of several: a loop in Python on a busy machine is late for long now and then
    assert min(abs(off) for off in errors) < 3


def test_what_waits_can_be_stopped_changed_and_marked():
    told, log = [], Seen()
    scene = Scene({"y": Param("a", 0.25) * stimlib.constant(1.0)})
    sink = NullSink(scene, 1.0, log=log, send=told.append, realtime=False)
    with begun_at(sink, 0.4, 0.2):
        refused(SinkError, "let it begin", sink.crossfade, scene)
        sink.set("a", 0.5, ramp=0.0)
        sink.mark("first", sample=0)
        until(lambda: sink.time_of(0)[0] > 0)
        sink.wait()
    # the clock has heard more since the marker; on a busy machine that changes its mind
    later = sink.report().start_error
    near = pytest.approx(later, abs=max(1e-4, 2 * told[0].uncertainty))
    assert told[0].time - sink._at == near
    assert set(np.concatenate(log.frames)[:, 0]) == {0.5} and log.events[0][:2] == (0, "set")
    assert log.end["start_error"] == later
    assert [kind for _, kind, _ in log.events].count("rise") == 1
    told.clear()
    for scene, motion in (STEADY, None), (Scene({"y": 1.0 * Input("x")}), Live()):
        sink = NullSink(scene, 1.0, motion=motion, send=told.append, realtime=False)
        with begun_at(sink, 100.0):
            sink.mark("first", sample=0)
            until(lambda sink=sink: sink.pump.read("FRAMES") > 800)
            began = time.monotonic()
            sink.stop()
            assert sink.finished and time.monotonic() - began < 10
        report = sink.report()
        assert (report.produced, report.start_error) == (0, None)
        assert "given time" not in str(report) and not report.silent
        assert told == []  # no marker of what was not felt


def test_a_motion_in_real_time_begins_with_its_newest():
    scene = Scene({"y": 1.0 * Input("x")})
    with begun_at(NullSink(scene, 1.0, motion=Live(), realtime=False), 0.5) as sink:
        for k in range(1, 5000):  # more than the ring holds, were it not emptied
            sink.push(np.full((1, 40), k * 1e-4))
            time.sleep(1e-4 if k % 10 else 2e-3)
            if sink.pump.index:
                break
        assert sink.pump.buffers("HOLD")[0] == pytest.approx(k * 1e-4, abs=0.01)
        assert sink.report().skipped < 1000


@pytest.mark.parametrize("seconds", [-1.0, 0.0, 0.1])
def test_a_time_that_cannot_be_kept_is_refused_with_the_reason(seconds):
    with NullSink(STEADY, 1.0, realtime=False) as sink:
        sink.open(FS)
        at = time.monotonic() + seconds
        said = refused(BadValue, "on its clock: give a time at least 0.1", sink.start, at=at)
        assert ("s ago" in str(said)) == (seconds <= 0.0)
        refused(BadValue, "must be finite", sink.start, at=float("nan"))
        refused(BadValue, "at most a day", sink.start, at=time.monotonic() + 1e6)
        refused(BadValue, "start: at", sink.start, at="noon")
        sink.start(0.05, at=time.monotonic() + 0.5)  # it can still be started
        sink.wait()
    assert sink.report().produced == 400
    sink = Known(STEADY, 1.0, realtime=False)
    sink.latency = 0.013
    with sink:  # 0.1 s, the fade-in, the latency and three blocks
        sink.open(FS, block=800)
        at = time.monotonic() + 0.42
        refused(BadValue, "at least 0.433 s, and", sink.start, at=at)
    with NullSink(STEADY, 1.0, clocked=False) as sink:
        sink.open(FS)
        refused(SinkError, "null has no clock here", sink.start, at=time.monotonic() + 1.0)


def test_any_clock_gives_the_time():
    pylsl = pytest.importorskip("pylsl")
    for clock in (pylsl.local_clock, time.time, lambda: time.monotonic() - 1e4):
        with NullSink(STEADY, 1.0, realtime=False) as sink:
            sink.open(FS)
            at = clock() + 0.4
            sink.start(0.05, at=at, clock=clock)
            sink.wait()
            assert sink._at - time.monotonic() == pytest.approx(at - clock(), abs=2e-3)


def test_a_clock_is_read_in_the_middle_of_its_shortest_call():
    calls = []

    def slow():
        calls.append(time.sleep(0.01 + 0.1 * (not calls)))
        now = time.monotonic()
        time.sleep(0.01)
        return now - 7.0

    assert behind(slow) == pytest.approx(7.0, abs=5e-3)


def begun_at(sink, ahead, seconds=None):
    """Open this sink, and start it so many seconds from now."""
    sink.open(FS, None, 64)
    sink.start(seconds, at=time.monotonic() + ahead)
    return sink


@needs_jack
@needs_portaudio()
@pytest.mark.parametrize("kind", ["jack", "portaudio"])
def test_a_real_server_plays_sample_0_in_the_frame_that_is_told(kind):
    with (
        Jackd(FS, 64) as server,
        portaudio({"JACK_DEFAULT_SERVER": server.name}),
        Capture(server.name, 1, 30 * FS) as capture,
    ):
        if kind == "jack":
            how = {"server": server.name, "connect": capture.names}
            sink = JackSink(STEADY, 1.0, realtime=False, **how)
        else:
            sink = PortAudioSink(STEADY, 1.0, name="system", realtime=False)
        sink.open(FS)
        with sink:
            if kind == "portaudio":
                (port,) = capture.client.get_ports("PortAudio:out_.*")
                capture.client.connect(port, capture.names[0])
            at = time.monotonic() + 2.0
            sink.start(0.5, at=at)
            assert time.monotonic() < at
            sink.wait()
            until(lambda: capture.frames.any() and not capture.frames[-1].any())
        full = np.flatnonzero(capture.frames[:, 0] == 1.0)
        report = sink.report()
        if kind == "jack" and not report.lost and not capture.xruns:
            assert capture.times[full[0]] == sink.pump.read("ORIGIN")
        assert abs(report.start_error) < 0.2  # a starved server moves its clock
        assert (report.rise, report.delivered + report.lost) == (160, 4000)
