"""``Sink.crossfade``: a scene that follows another on its device, within its limits."""

import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import count

import numpy as np
import pytest
from devices.servers import Seen, begun, faded, kept, offline, until
from devices.stands import FAILS, FS
from refusals import refused

from stimlib import (
    BadValue,
    FaultError,
    Input,
    MotionError,
    Param,
    Scene,
    SinkError,
    StimlibError,
    constant,
)
from stimlib.blocks.oscillators import carrier
from stimlib.cli.play import _ending
from stimlib.devices import (
    Calibration,
    Live,
    NullSink,
    Recorded,
    Signal,
    Signals,
    Sink,
    Stream,
    crossfade,
)
from stimlib.devices.process import open_sinks
from stimlib.files import read_log
from stimlib.run.safety import Safety

SPRING = Scene({"y": Param("k", 3.0) * Input("x")})
LEVEL = Scene({"y": constant(0.5)})


class Taken(Sink):
    """A device of its own that keeps what it is given."""

    device, pace = "taken", 8  # times as fast as its rate

    def _open(self):
        self.block = self.block or 48
        self._frames, self.got = self.make_frames(), []
        self.start_loop(self._loop)

    def _loop(self):
        while not self.closing:
            self.pump.block(self.block)
            self.got.append(self._frames.copy())
            self._let_go.wait(self.block / self.rate / self.pace)


def followed(sink, scenes, block=64, seconds=None, **options):
    """The sessions of a sink, each of which has played for a while."""
    made = [sink]
    with begun(sink, seconds, block=block):
        for scene in scenes:
            until(lambda: made[-1].pump.index > 400)
            made.append(made[-1].crossfade(scene, **options))
            until(lambda: made[-2].finished)
        until(lambda: made[-1].pump.index > 400)
    return made


def test_equal_constants_are_constant_on_every_device(stand):
    """The two gains add up to 1: neither a gap nor a bump, in any block size."""
    level = Scene({"y": constant(0.5), "z": constant(-0.25)})
    sink = stand.make(level)
    sessions = followed(sink, [level, level, level], 300 if stand.kind == "null" else 64)
    assert [s.finished for s in sessions] == 4 * [True] and not any(s.error for s in sessions)
    if (heard := stand.heard()) is None or any(s.report().lost for s in sessions):
        return
    there = np.flatnonzero(heard[:, 0] > 0.4999)
    steady = heard[there[0] : there[-1] + 1]
    assert len(steady) > 4 * 400 and np.abs(steady - [0.5, -0.25]).max() < 1e-7


@pytest.mark.parametrize("block", [1, 48, 256, 700])
def test_the_sum_is_that_of_two_sessions(block):
    """Each is the offline render of its log; a device has one, both, then the other."""
    wave = Scene({"y": 0.9 * carrier(110.0, phase=1.0)})
    other = Scene({"y": 0.9 * carrier(70.0, phase=1.0)})
    logs, safety = [Seen(), Seen()], Safety(1.0)
    sink = Taken(wave, safety, log=logs[0], realtime=False)
    first, second = followed(sink, [other], block, log=logs[1])
    got = np.concatenate(sink.got, axis=1)[0]
    start = np.flatnonzero(got)[0] - 1  # the first fade-in has one frame of silence
    ends = next(at for at, kind, _ in logs[0].events if kind == "stop")
    a, b = (np.concatenate(log.frames)[:, 0] for log in logs)
    for log, scene, frames in ((logs[0], wave, a), (logs[1], other, b)):
        whole = offline(scene, safety, {}, FS, len(frames), log.events)[:, 0]
        assert np.array_equal(frames, whole[kept(log.events, len(frames))])
    begin = start + 160  # frame of sample 0
    assert np.array_equal(got[begin : begin + ends], a[:ends]) and len(a) == ends + 160
    both = a[ends:].astype(float) + b[:160]
    assert np.abs(got[begin + ends : begin + ends + 160] - both).max() < 2**-23
    assert np.array_equal(got[begin + ends + 160 :][: len(b) - 160], b[160:])
    assert second.report().rise == 0 and second.report().lateness["max"] < 0.5
    assert (ends, "stop", {"reason": "next"}) in logs[0].events


def test_limits_hold_between_any_two():
    """Full scale both ways: 20 ms add at most 2 / 160 to the steps of the two."""
    rng, tops = np.random.default_rng(5), []
    for _ in range(6):
        levels, tones = rng.uniform(-3, 3, 2), rng.uniform(20, 200, 2)
        pair = [Scene({"y": v + 0.8 * carrier(f)}) for v, f in zip(levels, tones, strict=True)]
        sink = Taken(pair[0], Safety(1.0, slew=300.0), realtime=False)
        followed(sink, [pair[1], pair[0]], int(rng.integers(1, 300)))
        got = np.concatenate(sink.got, axis=1)[0].astype(float)
        tops.append(np.abs(got).max())
        assert np.abs(np.diff(got)).max() <= 300.0 / FS + 2 / 160 + 1e-6
    assert 0.9 < max(tops) <= 1.0


def test_parameters_and_a_motion_of_time_go_on(monkeypatch):
    """From y = 3 t to y = 3 t: what is heard stays within a fade of it."""
    monkeypatch.setattr(crossfade, "AHEAD", 0.5)  # in time on a busy machine, too
    motion = {"x": lambda t: 0.01 + 0.1 * t}
    sink = NullSink(SPRING, 1.0, motion=motion, params={"k": 2.0}, realtime=False)
    with begun(sink, block=64):
        sink.set("k", 1.0, ramp=0.0)
        until(lambda: sink.pump.index > 800)
        log = Seen()
        other = Scene({"y": Param("k", 5.0) * Input("x") * Param("more", 1.0)})
        new = sink.crossfade(other, motion=motion, log=log, params={"more": 2.0})
        until(lambda: new.pump.index > 800)
        assert sink.newest is new and new.params == {"k": 1.0, "more": 2.0}
        third = new.crossfade(other, motion=motion)
        assert third.since == new.since + third.at
    x = np.concatenate(log.x, axis=1)[0]
    assert x[:800] == pytest.approx(0.01 + 0.1 * (new.at / FS + np.arange(800) / FS), abs=1e-12)
    assert new.since == new.at and sink.report().produced == new.at + 160


def test_a_recorded_motion_goes_on_to_its_end(monkeypatch):
    """Whatever time the disk takes to begin a log."""
    x = np.linspace(0.0, 0.5, 16_000)
    log, make, slow = Seen(), Sink._make_log, iter([0.0, 1.0])
    monkeypatch.setattr(crossfade, "AHEAD", 0.5)  # in time on a busy machine, too
    monkeypatch.setattr(Sink, "_make_log", lambda s: (time.sleep(next(slow, 0.0)), make(s))[1])
    with begun(NullSink(SPRING, 5.0, motion={"x": x}, realtime=False), block=64) as sink:
        until(lambda: sink.pump.index > 400)
        new = sink.crossfade(SPRING, motion={"x": x}, log=log)
        new.wait(60)
    assert sink.pump.read("FADE_AT") == new.at
    assert np.array_equal(np.concatenate(log.x, axis=1)[0], x[new.since :])
    assert new.report().produced == 16_000 - new.since
    assert crossfade.later(Recorded(x[None]), 17_000, FS).x.tolist() == [[0.5]]  # after its end


def test_what_a_device_and_its_user_have_set_goes_on():
    """Channels, latency, calibration, marks, what watches; the log before ends."""
    logs, see = [Seen(), Seen()], lambda at, x, y: None
    level = Scene({"y": constant(0.5, "m/s^2")})
    f, band = [10.0, 80.0, 400.0, 3900.0], (80.0, 400.0)  # a short filter, soon made
    device = Calibration(f, 4 * [2.0], 4 * [0.0], "m/s^2", band=band)
    sink = NullSink(level, Safety(2.0), calibration=device, log=logs[0], realtime=False)
    with begun(sink, channels=[None, "y"], block=64):
        sink.watch(see)
        new = sink.crossfade(level, Safety(2.0), log=logs[1])
        sink.mark("here")
        until(lambda: logs[0].end)
        assert new._recorder.see is see and new.map == sink.map == (-1, 0)
        assert new.safety.inverse is sink.safety.inverse is not None
        assert new.report().latency == sink.report().latency > 0
    assert ["mark" in {kind for _, kind, _ in log.events} for log in logs] == [False, True]


def test_live_motion_is_pushed_into_the_newest():
    with begun(NullSink(SPRING, 5.0, motion=Live(), realtime=False), block=64) as sink:
        sink.push([[0.5]])
        until(lambda: sink.pump.index > 400)
        new = sink.crossfade(Scene({"y": Input("z") * Input("x")}), motion=Live())
        until(lambda: sink.finished or not new.push({"x": 0.5, "z": 1.0}))
        until(lambda: new.pump.index > 400)
    assert new.report().silent == "" and sink.report().silent == ""


def test_what_cannot_follow_is_refused_and_the_session_goes_on(stand):
    sink = stand.make(LEVEL)
    refused(SinkError, "start the sink first", sink.crossfade, LEVEL)
    with begun(sink, None, block=64):
        in_newton = Scene({"y": constant(0.5, "N")})
        for error, says, *given in (
            (SinkError, r"outputs y \[N\] .* one with y \[1\]: end", in_newton),
            (BadValue, "fade = 0.1 must be 0.02", LEVEL, Safety(1.0, fade=0.1)),
            (BadValue, r"full_scale = \[2.0\] must be \[1.0\]", LEVEL, 2.0),
            (BadValue, "takes a Scene, got function", followed),
            (BadValue, "needs the motion of x", SPRING),
        ):
            refused(error, says, sink.crossfade, *given)
        before = sink.pump.index
        until(lambda: sink.pump.index > before)
        assert sink.newest is sink and not sink.error
    refused(SinkError, "session was stopped", sink.crossfade, LEVEL)


def test_a_scene_that_fails_can_be_followed_by_another():
    sink = NullSink(LEVEL, 1.0, realtime=False)
    with ExitStack() as ends:
        ends.enter_context(pytest.raises(FaultError, match="output y was not finite"))
        ends.enter_context(begun(sink, None, block=64))
        fails = sink.crossfade(Scene({"y": FAILS}))
        refused(FaultError, None, fails.wait, 60)
        until(lambda: fails.finished)
        good = sink.crossfade(Scene({"y": constant(0.25)}))
        until(lambda: good.pump.index > 400)
        assert good.error is None and sink.newest is good
        fails.check()


def test_a_device_that_goes_takes_all_with_it_and_the_end_fades(stand):
    level, logs = Scene({"y": constant(1.0)}), [Seen(), Seen()]
    sessions = followed(stand.make(level, log=logs[0]), [level], log=logs[1])
    faded(np.concatenate(logs[1].frames), logs[1].events)
    assert logs[1].end["produced"] == sessions[1].report().produced
    lost = stand.make(level)
    with pytest.raises(SinkError, match="it went"), begun(lost, None, block=64):
        new = lost.crossfade(level)
        lost.device_lost("it went")
        new.wait(60)
    assert "it went" in str(new.error) and new.finished or new._device_gone


def test_many_follow_and_few_are_kept():
    sink = NullSink(LEVEL, 1.0, realtime=False)
    sessions = followed(sink, 8 * [LEVEL])
    assert len(sink.kept) == 3 and sink.newest is sessions[-1]
    assert all(s._closed for s in sessions) and all(not s._worker.is_alive() for s in sessions)


def test_whoever_asks_at_once_takes_turns_and_the_first_ends_all():
    with (
        begun(NullSink(LEVEL, 1.0, realtime=False), block=64) as sink,
        ThreadPoolExecutor(4) as pool,
    ):
        made = [f.result() for f in [pool.submit(sink.crossfade, LEVEL) for _ in range(6)]]
        assert len({*map(id, made)}) == 6 and sink.newest in made
        sink.newest.crossfade(LEVEL)  # not begun yet
        sink.stop()
        assert sink.finished and sink.newest.finished
        refused(SinkError, "session was stopped", sink.crossfade, LEVEL)


@pytest.mark.parametrize("part", [0.25, 0.5, 0.75])
def test_an_end_within_the_crossfade_adds_nothing(part):
    """The session before ends by itself: the gains add up to 1, or less, not 1.25."""
    with begun(Taken(LEVEL, 1.0, realtime=False), 0.2, block=16) as sink:
        until(lambda: sink.pump.index > 100)
        made = sink.crossfade(LEVEL)
        sink.pump.write("END", made.at + round(part * 160))
        until(lambda: made.pump.index > 400)
    got = np.concatenate(sink.got, axis=1)[0]
    assert got.max() == 0.5 and np.abs(np.diff(got)).max() <= 0.5 / 160 + 1e-6


class Stepped(Taken):
    """A device whose blocks the test asks for."""

    clock = False

    def start_loop(self, loop):
        pass

    def step(self, n, lost=0):
        self.pump.block(n, lost)
        return self._frames[0, :n].copy()


@pytest.mark.parametrize("kind", ["time", "recorded"])
@pytest.mark.parametrize("ahead, end", [(0.05, 4000), (-0.05, 4000), (0.05, 1300), (0.05, 1100)])
def test_the_fade_in_which_both_play_is_counted_once(ahead, end, kind, monkeypatch):
    """Also where the request came late, which delays no motion, or where the other
    begins at a natural end.
    """
    monkeypatch.setattr(crossfade, "AHEAD", ahead)
    motion = {"x": np.arange(4000) / FS if kind == "recorded" else lambda t: t}
    sink = Stepped(SPRING, 4.0, motion=motion, realtime=False)
    with begun(sink, end / FS, block=1000):
        timed = kind == "time"
        until(lambda: not timed or sink.pump.next_motion() >= min(end, 3000))
        sink.step(1000)
        made = sink.crossfade(SPRING, motion=motion)
        until(lambda: not timed or made.pump.next_motion() > 1000)
        y = sink.step(1000)
        # up to there the other had played, or it ended
        assert made.since == (end if end < 4000 else max(made.at, 840))
        assert 4 * y[-1] == pytest.approx(3 * (2000 - 160 - 1) / FS, abs=1e-6)
        assert timed or made.pump.read("END") == 4000 - made.since, "of a recording"
        # of 2000 frames, the first 160 rise
        assert _ending([sink, made]) == f"played {(2000 - 160) / FS:.4g} s, nothing lost"


def test_what_is_lost_where_another_begins_delays_no_motion():
    """It is where it would be if the session had begun in time."""
    motion = {"x": np.arange(8000) / FS}
    with begun(Stepped(SPRING, 4.0, motion=motion, realtime=False), block=1000) as sink:
        sink.step(1000)
        made = sink.crossfade(SPRING, motion=motion)
        sink.step(500, lost=700)
        last = [sink.step(500)[-1] for _ in range(2)][-1]
        assert 4 * last == pytest.approx(3 * (1000 - 160 + 700 + 1500 - 1) / FS, abs=1e-6)
        assert made.since == made.at + 300 and made.pump.read("END") == 8000 - made.since


def test_at_a_natural_end_the_other_begins_there_and_a_loss_counts_once():
    """The fade would not end before it; blocks are longer than what is made at once."""
    with begun(Stepped(LEVEL, 1.0, realtime=False), 0.1, block=850) as sink:
        sink.step(850)  # up to sample 690 of 800
        made = sink.crossfade(LEVEL)
        refused(SinkError, "the session before has not faded out", made.crossfade, LEVEL)
        assert np.abs(sink.step(700) - 0.5).max() <= 0.5 / 160 + 1e-7
        assert made.pump.index == 700 - 110 and sink.report().produced == 800
        sink.step(700, lost=10)
        assert made.report().lost == 10 and made.pump.index == 1300
        last = sink.crossfade(LEVEL)
        last.stop()
        assert last.finished  # it has not begun


@pytest.mark.parametrize("block", [64, 1000])
def test_signals_go_on_in_blocks_of_any_size(block):
    """Each frame has its own sample of the device's input, and its own time."""
    wave = (0.5 * np.sin(2 * np.pi * 5 * np.arange(24000) / FS)).astype(np.float32)
    both_ears = np.stack([wave, -wave], axis=1)  # interleaved, as of PortAudio

    class Wired(Taken):
        def _loop(self):
            self.pump.write("CONNECTED", 1)
            self.pump.write("IN_STRIDE", 2)
            for at in range(0, len(wave) - block, block):
                if self.closing:
                    return
                self.pump.buffers("INS")[:] = both_ears.ctypes.data + 8 * at
                self.pump.block(block)
                self.got.append(self._frames.copy())
                self._let_go.wait(block / self.rate)

    motion = Signals({"x": Signal(1.0)})
    twice = Scene({"y": Param("k", 1.0) * Input("x")})
    sink = Wired(twice, 1.0, motion=motion, realtime=False)
    with begun(sink, None, block=block):
        until(lambda: sink.pump.index > 1000)
        new = sink.crossfade(twice)
        until(lambda: new.pump.index > 3000)
        lateness, before = new.report().lateness["max"], sink.pump.timed()
        assert lateness < 0.09 and before is not None
        other = Scene({"y": Input("x") + Input("z")})
        both = Signals({"x": Signal(1.0), "z": Signal(1.0)})
        refused(BadValue, "has opened no others", sink.crossfade, other, motion=both)
        played = block * len(sink.got)
    heard = np.concatenate(sink.got, axis=1)[0][:played]
    steady = slice(np.flatnonzero(heard)[0] + 2000, played)  # it starts a while after the device
    assert played > steady.start and np.abs(heard - wave[:played])[steady].max() < 1e-6


def rows_every(seconds):
    """A stream of one position."""
    rows = count()

    def receive(timeout):
        time.sleep(seconds)
        return [[0.5]], [float(next(rows))]

    return Stream(receive=receive, columns={"x": 0})


def test_a_stream_goes_on_from_its_last_row():
    """However rarely rows come: the new session begins at the position before."""
    sink = Taken(Scene({"y": Input("x")}), 1.0, motion=rows_every(0.04), realtime=False)
    sink.pace = 1
    with begun(sink, None, block=64):
        until(lambda: sink.pump.index > 4000)
        new = sink.crossfade(Scene({"y": 1.0 * Input("x")}))
        until(lambda: new.pump.index > 2000)
        before, now = sink.report().rows, new.report().rows
        until(lambda: new.report().rows > now + 5)
        assert sink.report().rows == before  # all are the new one's
    got = np.concatenate(sink.got, axis=1)[0]
    there = np.flatnonzero(got > 0.4999)
    assert got[there[0] : there[-1]].min() > 0.4999 and new.report().rows > 0


@pytest.mark.parametrize("rows", [0, 1])
def test_a_motion_that_has_stayed_away_stays_away(rows):
    """No force comes back to the last position, and what never moved is an error."""
    sink = Stepped(SPRING, 4.0, motion=Live(), realtime=False)
    with pytest.raises(MotionError, match="nothing was pushed"), begun(sink, block=1000):
        sink.push(np.full((1, rows), 0.5))
        before = [np.abs(sink.step(1000)).max() for _ in range(3)]
        made = sink.crossfade(SPRING)
        assert [sink.step(1000).any() for _ in range(3)] == [False] * 3
        assert (before[0] > 0.3, before[2]) == (rows > 0, 0.0) and made.report().silent


def test_what_cannot_start_leaves_the_session_before_as_it_was(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "file").write_text("")
    sink = NullSink(Scene({"y": Input("x")}), 1.0, motion=rows_every(0.01), realtime=False)
    with begun(sink, None, block=64):
        until(lambda: sink.pump.index > 800)
        for wrong in ({"log": tmp_path / "there"}, {"log": tmp_path / "new", "seconds": -1.0}):
            refused(StimlibError, None, sink.crossfade, sink.scene, **wrong)
        at, rows_then = sink.pump.index, sink.report().rows
        until(lambda: sink.pump.index > at + 800 and sink.report().rows > rows_then)
        assert sink.newest is sink and open_sinks == {sink}
    assert read_log(tmp_path / "new").frames == 0


def test_what_a_device_loop_says_reaches_the_newest():
    class Unplugged(Taken):
        def _loop(self):
            while self.newest is self or self.newest.pump.index < 100:
                self.pump.block(64)
                self._let_go.wait(0.004)
            raise OSError("unplugged")

    sink = Unplugged(LEVEL, 1.0, realtime=False)
    with pytest.raises(SinkError, match="unplugged"), begun(sink, None, block=64):
        sink.crossfade(LEVEL).wait(60)
