"""The compiled callback, called from here: any cut into blocks, losses, changes, motion
that stays away, full rings.
"""

import ctypes
import sys
import time

import numpy as np
import pytest
from devices.servers import kept, replayed

import stimlib
from stimlib import Input, Param, Scene
from stimlib.devices import Live, Recorded, Scripted, Signal, Signals, words
from stimlib.devices.engine import Pump
from stimlib.run.safety import Safety, protect
from stimlib.scenes import squeeze

FS = 8000


class Bench:
    """A pump with buffers for its channels; ``out`` collects what a device would
    hear.
    """

    def __init__(self, scene, source, channels=None, fs=FS, full_scale=50.0):
        self.scene, self.fs, self.safety = scene, fs, Safety(full_scale)
        self.channels = list(range(len(scene.outputs))) if channels is None else channels
        proc = stimlib.compile(protect(scene, self.safety), fs)
        self.pump = Pump(proc, self.safety, self.channels, source, log=True)
        self.buffer = np.full((len(self.channels), 4096), np.nan, np.float32)
        self.pump.buffers("OUTS")[:] = [row.ctypes.data for row in self.buffer]
        self.out, self.events, self.motion, self.logged = [], [], [], []

    def block(self, n, lost=0):
        self.pump.block(n, lost)
        self.out.append(self.buffer[:, :n].T.copy())
        self.buffer[:] = np.nan
        self.drain()

    def blocks(self, sizes):
        for n in sizes:
            self.block(n)

    def begun(self, *how):
        self.pump.start(*how or (None,))
        return self

    def drain(self):
        self.events += self.pump.events()
        while len(x := self.pump.motion()):
            self.motion.append(x.copy())
        while len(f := self.pump.frames()):
            self.logged.append(f.copy())

    def heard(self):
        return np.concatenate(self.out)

    def reference(self, x):
        """The same from the processor alone: motion and events are all it needs."""
        return replayed(self.scene, self.safety, x, self.fs, self.events, self.channels)


def fingers(n):
    t = np.arange(n) / FS
    return np.stack(
        [0.01 * (1 - np.cos(2 * np.pi * 2 * t)), 0.004 * (1 - np.cos(2 * np.pi * 3 * t))]
    )


def cuts(kind, n):
    if isinstance(kind, int):
        return [kind] * (n // kind) + [n % kind] * (n % kind > 0)
    rng, sizes = np.random.default_rng(1), []
    while sum(sizes) < n:
        sizes.append(
            int(min(rng.choice([1, 2, 7, 63, 64, 65, 255, 256, 257, 1000]), n - sum(sizes)))
        )
    return sizes


def test_rows_are_told_as_they_were_processed_and_once():
    bench = Bench(squeeze(), Recorded(fingers(1000))).begun()
    pump = bench.pump  # which writes into the buffer of the bench
    for n in (64, 7):
        pump.block(n)
        reads = pump.motion, pump.motion, pump.frames, pump.frames
        assert [len(read()) for read in reads] == [n, 0, n, 0]


@pytest.mark.parametrize("kind", [1, 16, 64, 100, 256, 1000, "mixed"])
def test_the_samples_do_not_depend_on_the_block(kind):
    x = fingers(3000)
    x[:, 0] = 0.01, 0.02  # what comes before sample 0 leads to it
    bench = Bench(squeeze(), Recorded(x), channels=[1, -1, 0]).begun(3000, np.array([20.0, 40.0]))
    bench.blocks(cuts(kind, 3400))
    heard = bench.heard()
    played = heard[160:3160]
    assert (
        np.array_equal(played, bench.reference(x))
        and played[0].tolist() == np.float32([0.8, 0, 0.4]).tolist()
    )
    part = np.arange(160)[:, None] / 160
    assert np.array_equal(heard[:160], np.float32(part * [0.8, 0, 0.4]))
    assert np.allclose(heard[3160:3320], part[::-1] * played[-1], rtol=1e-6, atol=0)
    assert not heard[3319:].any() and not np.isnan(heard).any()
    assert np.abs(heard).max() > 0.5
    assert np.array_equal(np.concatenate(bench.logged), played)
    assert np.array_equal(np.concatenate(bench.motion), x.T)
    assert [(at, e["value"]) for at, kind, e in bench.events if kind == "set"] == [(0, 1.0)]
    assert [(at, kind, e["frames"]) for at, kind, e in bench.events if kind != "set"] == [
        (0, "rise", 160),
        (3000, "fall", 160),
    ]
    assert bench.pump.state == words.DONE and bench.pump.index == 3000
    assert (bench.pump.read("ROSE"), bench.pump.read("FELL"), bench.pump.read("DELIVERED")) == (
        160,
        160,
        3000,
    )


STEADY = Scene({"y": stimlib.constant(50.0)})


@pytest.mark.skipif(sys.platform == "win32", reason="the clock of Windows is another")
def test_a_machine_that_is_late_by_nine_blocks_has_lost_nine():
    """With a clock that moves while the pump sleeps: once, by 10 blocks more."""
    bench, slept, calls = Bench(STEADY, None).begun(), [], []
    pump = bench.pump  # which writes into the buffer of the bench
    time_of_day = pump.buffers("TIME")

    def clock(_id, _at):
        time_of_day[:] = 1, sum(slept)
        return 0

    def sleep(us):
        slept.append(1000 * us + (len(slept) == 20) * 10 * 64 * 10**9 // FS)
        if len(slept) == 30:
            pump.write("STATE", words.CLOSED)
        return 0

    i4, i8, form = ctypes.c_int, ctypes.c_int64, ctypes.CFUNCTYPE
    for word, call in ("CLOCK", form(i4, i4, i8)(clock)), ("SLEEP", form(i4, i4)(sleep)):
        calls.append(call)
        pump.write(word, ctypes.cast(call, ctypes.c_void_p).value)
    pump.native.null(pump.context, 64, float(FS), 1)
    assert pump.read("LOST") == 9 * 64


@pytest.mark.parametrize(
    ("before", "rises", "length", "earliest", "begins", "index", "silent"),
    [
        (0, True, 1000, 0, [0], 0, 0),
        (50, True, 1000, 0, [0], 0, 100),
        (159, True, 1000, 0, [0], 0, 318),
        (160, True, 1000, 0, [1], 161, 321),
        (200, True, 1000, 0, [40], 200, 360),
        (1120, True, 1000, 0, [960], 1000, 1320),
        (80, False, None, 0, [80], 240, 240),
        (100, False, 100, 0, [], 100, 260),
        (300, False, None, 700, [700], 860, 860),
    ],
)
def test_a_stop_fades_from_where_it_is(before, rises, length, earliest, begins, index, silent):
    """Before sample 0 it goes back at once, close to the end no sample more is made,
    and none begins before the earliest.
    """
    bench = Bench(STEADY, None).begun(length, np.array([50.0]) if rises else None)
    bench.block(before)
    bench.pump.stop("error", earliest)
    bench.block(1000)
    y = bench.heard()[:, 0]
    assert np.abs(np.diff(y, prepend=0)).max() < 0.01
    assert not y[silent:].any() and (y[max(silent - 3, 0) : max(silent - 1, 0)] > 0).all()
    assert (bench.pump.state, bench.pump.index) == (words.DONE, index)
    stops = [(at, e["reason"]) for at, kind, e in bench.events if kind == "stop"]
    assert stops == [(at, "error") for at in begins]


def test_fades_have_room_where_changes_have_none():
    """A program that floods a sink with changes can neither keep it silent nor keep it
    from ending.
    """
    bench = Bench(Scene({"y": Param("level", 1.0) * 1}), None, full_scale=1.0)
    fill = lambda: sum(bench.pump.set("level", 1.0, 1) for _ in range(300))  # noqa: E731
    assert fill() == 256 == words.COMMANDS
    bench.pump.start(None)
    bench.block(512)
    assert bench.out[-1][-1] == 1
    assert fill() == 256
    bench.pump.stop("stop")
    bench.block(512)
    assert bench.pump.state == words.DONE and not bench.out[-1][-1]
    assert np.abs(np.diff(bench.heard()[:, 0], prepend=0)).max() <= 0.01
    assert [kind for _, kind, _ in bench.events].count("set") == 2 * 256 + 2


def test_lost_frames_are_produced_and_told_from_sample_0_on():
    x = fingers(4000)
    bench = Bench(squeeze(), Recorded(x))
    bench.block(64, lost=1000)
    bench.begun(4000, np.zeros(2))
    for lost in (0, 64, 1000):  # the first two end before sample 0
        bench.block(64, lost)
    assert (bench.pump.index, bench.pump.read("LOST")) == (3 * 64 - 160, 0)
    plan = [(64, 0), (64, 100), (64, 0), (64, 2000), (256, 0), (64, 3)]
    lost, at = [], bench.pump.index
    for n, gone in plan:
        if gone:
            lost.append((at, gone))
        at += n + gone
        bench.block(n, gone)
    assert [(at, e["frames"]) for at, kind, e in bench.events if kind == "lost"] == lost
    there = kept(bench.events, at)
    assert np.array_equal(bench.heard()[64 + 160 :], bench.reference(x[:, :at])[there])
    assert np.array_equal(np.concatenate(bench.motion), x[:, :at].T), (
        "the motion of what was lost is in the log too"
    )
    p = bench.pump
    assert p.read("DELIVERED") + p.read("LOST") == p.index == at
    assert (p.read("LOST"), p.read("UNDERRUNS")) == (2103, 3)


def live(keep=0.05):
    return Bench(Scene({"y": 1.0 * Input("x")}), Live(keep), full_scale=1.0)


def test_motion_that_stays_away_is_held_then_faded():
    bench = live().begun()
    bench.pump.put_motion(np.full((1, 400), 0.8))
    bench.blocks([64] * 25)
    y = bench.heard()[:, 0]
    stale = [(at, e["samples"]) for at, kind, e in bench.events if kind == "stale"]
    assert len(stale) == 1 and 800 <= stale[0][0] < 864, (
        "50 ms after the last column, at a block's start"
    )
    assert np.abs(np.diff(y)).max() < 0.01
    assert y[700] == np.float32(0.8) and not y[stale[0][0] + 160 :].any()
    bench.pump.put_motion(np.full((1, 400), -0.8))
    bench.blocks([64] * 6)
    y = bench.heard()[:, 0]
    assert (
        bench.events[-2][1] == "fresh"
        and np.abs(np.diff(y)).max() < 0.01
        and y[-1] == np.float32(-0.8)
    )


@pytest.mark.parametrize("keep", [0.05, 1e-5])
def test_a_slow_tracker_is_held_between_its_reports(keep):
    bench = live(keep).begun()
    for k in range(20):
        bench.pump.put_motion(np.full((1, 1), 0.01 * k))
        bench.block(64)  # 125 reports a second
    assert np.array_equal(np.concatenate(bench.motion)[:, 0], np.repeat(0.01 * np.arange(20), 64))
    assert "stale" not in [kind for _, kind, _ in bench.events]
    size = bench.pump.read("M_SIZE")
    assert bench.pump.put_motion(np.zeros((1, size + 5))) == size, "a full ring takes no more"
    assert bench.pump.put_motion(np.zeros((1, 5))) == 0


def test_no_delay_grows_behind_a_live_motion():
    bench = live(keep=0.01).begun()
    for k in range(50):
        bench.pump.put_motion(np.full((1, 100), 0.01 * k))  # faster than the device
        bench.block(64)
        assert bench.motion[-1][-1, 0] >= 0.01 * (k - 1)
    assert bench.pump.read("SKIPPED") == 5000 - 50 * 64 - (
        bench.pump.read("M_WRITE") - bench.pump.read("M_READ")
    )


def test_a_scripted_column_belongs_to_its_sample():
    bench = Bench(Scene({"y": 1.0 * Input("x")}), Scripted({"x": np.cos}), full_scale=1.0).begun()
    bench.pump.put_motion(np.arange(100.0)[None] * 1e-3)
    bench.block(64)
    bench.block(64)  # 36 columns, then held
    assert bench.pump.next_motion() == 128, "what is late is left out"
    bench.pump.put_motion(np.arange(128.0, 192.0)[None] * 1e-3)
    bench.block(64)
    x = np.concatenate(bench.motion)[:, 0] * 1e3
    assert np.allclose(x, np.r_[np.arange(100), [99] * 28, np.arange(128, 192)])


def test_signals_as_positions():
    source = Signals({"x": Signal(0.05, 0.01), "z": Signal(2.0)})
    bench = Bench(Scene({"y": 1.0 * Input("x"), "w": 1 * Input("z")}), source, full_scale=1.0)
    ins = np.random.default_rng(0).uniform(-0.4, 0.4, (2, 1000)).astype(np.float32)
    bench.pump.start(None)
    bench.pump.write("CONNECTED", 1)
    for k in range(0, 1000, 100):
        bench.pump.buffers("INS")[:] = [ins[a, k:].ctypes.data for a in range(2)]
        bench.block(100)
    x = np.stack([ins[0].astype(float) * 0.05 + 0.01, ins[1].astype(float) * 2.0])
    assert np.array_equal(np.concatenate(bench.motion).T, x)
    assert np.array_equal(bench.heard(), bench.reference(x))
    bench.pump.write("CONNECTED", 0)  # a port of JACK gives zeros then
    silent = np.zeros(100, np.float32)
    bench.pump.buffers("INS")[:] = silent.ctypes.data
    bench.blocks([100] * 10)
    assert (np.concatenate(bench.motion)[1000:] == x[:, -1]).all(), "it is held"
    assert [kind for _, kind, _ in bench.events if kind != "set"] == ["fresh", "stale"]
    assert not bench.heard()[-100:].any()


def test_a_log_that_is_not_read_says_what_it_lacks():
    """Gaps and losses do not overlap, and what comes after is logged again."""
    scene, x = Scene({"y": Param("a", 0.5) * Input("x")}), np.ones((1, 10**5))
    bench = Bench(scene, Recorded(x), fs=2000, full_scale=1.0).begun()
    size = bench.pump.read("L_SIZE")
    bench.pump.block(4096)
    bench.pump.block(size - 4096 - 300)
    bench.pump.block(64, lost=1000)  # 300 of these have room
    n = bench.pump.index
    bench.drain()
    lost = [(at, e["frames"]) for at, kind, e in bench.events if kind == "lost"]
    gaps = [(at, e["frames"], e["delivered"]) for at, kind, e in bench.events if kind == "gap"]
    told = np.zeros(n, int)
    for at, k in lost + [g[:2] for g in gaps]:
        told[at : at + k] += 1
    logged = sum(map(len, bench.logged))
    assert told.max() == 1 and not told[: size - 300].any() and told[size - 300 :].all()
    assert bench.pump.read("LOST") == 1000 and sum(k for _, k in lost) == 256
    assert logged == size - 300
    assert sum(map(len, bench.motion)) == size - 300 + 256 == n - bench.pump.read("UNLOGGED")
    bench.block(1000)
    assert sum(map(len, bench.logged)) == logged + 1000


def test_percentiles_of_block_times():
    pump = Bench(squeeze(), Recorded(fingers(1000))).pump
    assert pump.percentiles(50, 100) == [0.0, 0.0]
    for ns, count in ((3, 10), (1000, 80), (10**6, 10)):
        octave = ns.bit_length() - 4
        pump.histogram[ns if ns < 8 else 8 * (octave + 1) + (ns >> octave & 7)] += count
    p5, p50, p99 = pump.percentiles(5, 50, 99)
    assert pump.percentiles(10, 10.5) == [p5, p50], "10.5 % of 100 blocks are 11"
    assert 3e-9 <= p5 <= 4e-9 and 1000e-9 <= p50 <= 1125e-9 and 1e-3 <= p99 <= 1.125e-3


def test_how_late_blocks_begin():
    """A block is due one block after the one before began, not before the first."""
    bench = Bench(squeeze(), Recorded(fingers(4000)))
    pump = bench.pump
    bench.block(160)  # before the start
    time.sleep(0.03)
    pump.start(None)
    longest, before = 0.0, None
    for late in (0.0, 0.04, 0.0, 0.0):
        begun = time.perf_counter()
        bench.block(160)  # 20 ms
        ended = time.perf_counter()
        longest, before = max(longest, ended - (before or begun)), begun
        time.sleep(0.02 + late)
    assert pump.lateness.sum() == 3
    assert 0.04 <= pump.percentiles(100, of=pump.lateness)[0] <= 1.125 * (longest - 0.02)
    bench.block(160)
    early = pump.lateness[0]
    bench.block(160)
    assert pump.lateness[0] == early + 1 and pump.lateness.sum() == 5
    assert pump.histogram.sum() == 6
