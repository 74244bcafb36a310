"""One contract for all sinks: what is delivered is the offline render, what was lost is
counted, every way out fades, and what is wrong is named with its remedy.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext, suppress
from pathlib import Path

import numpy as np
import pytest
from devices.servers import (
    Jackd,
    Seen,
    begun,
    faded,
    kept,
    largest_step,
    needs_jack,
    offline,
    played,
    until,
    without,
)
from devices.stands import (
    FAILS,
    FS,
    STEADY,
    Task,
    alsa,
    from_file,
    needs_portaudio,
    nidaqmx,
)
from refusals import refused

import stimlib
from stimlib import BadValue, FaultError, Param, Scene, SinkError, UnknownName, blocks, constant
from stimlib.blocks.oscillators import carrier
from stimlib.devices import available, devices
from stimlib.run.safety import Safety

WAVE = Param("level", 1.0) * (0.5 * carrier(110.0, phase=0.3) + 0.05 * blocks.white_noise(3))
SCENE = Scene({"wave": WAVE, "other": 0.25 * carrier(60.0)})


def inside(heard, expected, rise):
    """What the device got from sample 0 on, and what came before and after."""
    first, start = (int(np.flatnonzero(a.any(axis=1))[0]) for a in (expected, heard))
    begin = start - first + (rise - 1) * (rise > 0 and first == 0)
    end = begin + len(expected)
    return heard[begin:end], heard[:begin], heard[end:]


def test_what_is_delivered_is_the_offline_render(stand, caplog):
    """With a parameter from the start, which changes at the sample that is told."""
    caplog.set_level("INFO", "stimlib.devices")
    log, safety = Seen(), Safety(1.0)
    sink = stand.make(SCENE, safety, seed=5, params={"level": 0.5}, log=log)
    with begun(sink, 0.4, fs=FS, block=64):
        until(lambda: sink.pump.index > 0)
        sink.set("level", 0.25, ramp=0.01)
        sink.wait(60)
    report, frames = sink.report(), np.concatenate(log.frames)
    assert report.produced == 3200 == report.delivered + report.lost
    assert log.end == report.to_dict() | {"latency": log.end["latency"]}
    told = {"seed": 5, "params": {"level": 0.5}}
    whole = offline(SCENE, safety, {}, FS, 3200, log.events, **told)
    assert np.array_equal(frames, whole[kept(log.events, 3200)]) and np.abs(whole).max() > 0.2
    lead = 160 if stand.kind == "control loop" else 0  # whose gain rises along the samples
    plain = stimlib.render(SCENE, fs=FS, seconds=0.4, **told).y.T.astype(np.float32)
    changes = [at for at, kind, e in log.events if kind == "set" and e["name"] == "level"]
    first = changes[0] if changes else 3200
    assert np.array_equal(whole[lead:first], plain[lead:first]) and first > 0
    if (heard := stand.heard()) is not None and not report.lost:
        got, before, after = inside(heard.astype(np.float32), whole, report.rise)
        assert np.array_equal(got, whole) and not after[-1].any()
        assert np.abs(np.diff(np.r_[before, got[:1]], axis=0)).max(initial=0) <= 0.01 or lead
        assert not before[: -report.rise or None].any() and not after[report.fall :].any()
    assert caplog.messages[0].endswith(f"8000 Hz, 2 channels, blocks of {sink.block})")
    assert caplog.messages[-1].startswith(f"{sink.device}: closed {sink!r}, {sink.report()}"[:80])


def test_a_ramp_from_the_first_sample_begins_at_the_value_that_was_given(stand):
    """At the start, or by a jump before it."""
    log, safety, told = Seen(), Safety(1.0), {"params": {"level": 0.25}}
    with stand.make(STEADY, safety, log=log, **told) as sink:
        sink.open(FS, block=64)
        sink.set("level", 0.5, ramp=0.0)
        sink.set("level", 0.75, ramp=0.05)
        sink.start(0.1)
        sink.wait(60)
    change = next(at for at, kind, e in log.events if kind == "set" and e["name"] == "level")
    whole = offline(STEADY, safety, {}, FS, 800, log.events, seed=0, **told)
    steps = np.diff(whole[:, 0])
    assert change == 0 and steps.min() > -1e-6 and 0.25 / 401 <= steps.max() < 0.01
    assert np.array_equal(np.concatenate(log.frames), whole[kept(log.events, 800)])


def test_channels_carry_the_outputs_that_are_named(stand):
    log = Seen()
    scene = Scene({"a": constant(0.5), "b": constant(1.0)})
    options = {"name": "Dev1/ao0:3"} if stand.kind == "nidaq" else {}
    sink = stand.make(scene, log=log, **options)
    played(sink, 0.1, channels=["b", None, "a", "b"], block=64)
    assert np.concatenate(log.frames)[-1].tolist() == [1.0, 0.0, 0.5, 1.0] and sink.channels == 4


def test_what_a_stall_loses_is_told_and_accounted(stand):
    """The processor goes on through what the device skips."""
    if not stand.skips:
        pytest.skip(f"{stand.kind} waits for a late block, or ends")
    log = Seen()
    with begun(stand.make(SCENE, log=log), 1.0, block=64) as sink:
        until(lambda: sink.pump.index > 800)
        sink.pump.write("STALL", 300_000)
        sink.wait(60)
    r, lost = sink.report(), [e["frames"] for _, kind, e in log.events if kind == "lost"]
    assert r.produced == FS == r.delivered + r.lost and sum(lost) == r.lost > 0.25 * FS
    assert max(lost) > 0.2 * FS and len(lost) >= r.underruns > 0 and r.block_time["max"] >= 0.3
    whole = offline(SCENE, Safety(1.0), {}, FS, FS, log.events)
    assert np.array_equal(np.concatenate(log.frames), whole[kept(log.events, FS)])
    assert r.to_dict()["lateness"] == r.lateness
    assert [*r.lateness] == [*r.block_time] == ["p50", "p99", "p99.9", "max"]
    assert f"; late p50 {1e6 * r.lateness['p50']:.0f} us, p99 " in str(r)


WAYS = {
    "end": lambda sink: sink.wait(60),
    "stop": lambda sink: sink.stop(),
    "close": lambda sink: sink.close(),
    "leave": lambda sink: None,
    "exception": lambda sink: 1 / 0,
    "keyboard": lambda sink: signal.default_int_handler(signal.SIGINT, None),
}


@pytest.mark.parametrize("way", WAYS)
def test_every_way_out_fades(stand, way):
    log = Seen()
    with (
        suppress(ZeroDivisionError, KeyboardInterrupt),
        begun(stand.make(STEADY, log=log), 0.2 if way == "end" else None, block=64) as sink,
    ):
        until(lambda: sink.pump.index > 1000)
        WAYS[way](sink)
    faded(np.concatenate(log.frames), log.events)
    assert sink.finished and log.end["produced"] == sink.report().produced
    if (heard := stand.heard()) is not None and not sink.report().lost:
        assert largest_step(heard, []) <= 0.0101 and not heard[-1].any() and heard.max() == 1.0


def test_an_output_that_fails_ends_the_session_with_its_name(stand):
    """The good output fades too, when the guard of the bad one has: two fades at once
    would be steeper.
    """
    log = Seen()
    sink = stand.make(Scene({"good": constant(1.0), "bad": FAILS}), log=log)
    says = "output bad was not finite at sample 4001"
    refused(FaultError, says, played, sink, 60.0, patience=60, block=64)
    y = np.concatenate(log.frames)
    assert np.isfinite(y).all() and largest_step(y[:, :1], log.events) < 0.01
    assert min(at for at, kind, _ in log.events if kind == "stop") >= 4001 + FS // 50 + 1
    assert sink.report().faults == log.end["faults"] == {"bad": 4001}
    assert (4001, "fault", {"output": "bad"}) in log.events and sink.finished


def test_life_in_the_wrong_order_is_told(stand):
    sink = stand.make(STEADY)
    for says, call, *given in (
        ("open the sink first", sink.start),
        ("open the sink first", sink.set, "level", 1.0),
        ("never open", sink.report),
        ("wait: start the sink first", sink.wait),
        ("start the sink first", sink.mark, "x"),
    ):
        refused(SinkError, says, call, *given)
    sink.close()
    refused(SinkError, "make a new one", sink.open, FS)
    sink = stand.make(STEADY)
    sink.open(FS)
    refused(SinkError, "opened before", sink.open, FS)
    sink.start(0.1)
    refused(SinkError, "plays once", sink.start)
    for end in (sink.stop, sink.close):
        end()
        end()
    for call, *given in ((sink.start,), (sink.set, "level", 1.0)):
        refused(SinkError, "closed", call, *given)
    assert type(sink).__name__ in repr(sink)


def test_what_no_device_takes_is_refused_before_it_opens(stand):
    sink = stand.make(Scene({"a": constant(1.0), "b": Param("level", 1.0) * 1}))
    for told, error, says in (
        ({"rate": 0}, BadValue, "sample rate"),
        ({"rate": None}, BadValue, "fs = None"),
        ({"channels": 1}, BadValue, "fewer than 2"),
        ({"channels": ["a", "c"]}, UnknownName, "no output 'c'"),
        ({"channels": "a"}, BadValue, "list"),
        ({"channels": []}, BadValue, "list"),
        ({"block": 0}, BadValue, "block"),
        ({"block": 1.5}, BadValue, "block"),
    ):
        refused(error, says, sink.open, **{"rate": FS} | told)
    refused(UnknownName, "there are level", stand.make(STEADY, params={"sink_gain": 1.0}).open, FS)


def test_what_cannot_be_set_or_started(stand):
    with stand.make(STEADY) as sink:
        sink.open(FS)
        for error, says, call, *given in (
            (UnknownName, "there are level", sink.set, "sink_gain", 0.5),
            (BadValue, "level = nan .*finite", sink.set, "level", np.nan),
            (BadValue, "must be a number", sink.set, "level", "loud"),
            *((BadValue, "ramp", sink.set, "level", 1.0, v) for v in (-1, np.inf, 1e18, None)),
            *((BadValue, "seconds", sink.start, v) for v in (0, -1, 1e-5, np.nan, np.inf, "long")),
        ):
            refused(error, says, call, *given)
        for k in range(256):
            sink.set("level", k)
        refused(SinkError, "256 changes", sink.set, "level", 1.0)


def test_several_play_at_once_in_threads(stand):
    barrier = threading.Barrier(4)

    def play():
        with stand.make(STEADY) as sink:
            try:
                sink.open(FS, block=64)
            finally:
                barrier.wait(60)
            sink.start(0.05)
            sink.wait(60)
        assert sink.report().produced == 400

    usual = sys.getswitchinterval()
    try:
        sys.setswitchinterval(1e-5)
        with ThreadPoolExecutor(4) as pool:
            for played in [pool.submit(play) for _ in range(4)]:
                played.result()
    finally:
        sys.setswitchinterval(usual)


# Signals and the end of the program ---------------------------------------------------
CHILD = """
import json, os, signal, sys
from devices.servers import Seen
import numpy as np
import stimlib
from stimlib.devices import available
from stimlib.run.safety import Safety

told = json.loads(sys.argv[1])
safety = Safety(1.0, fade=told.get("fade", 0.02))
scene = stimlib.Scene({"y": stimlib.constant(1.0)})
with available.make("null", scene, safety, realtime=False, clocked=False) as sink:
    sink.open(8000)  # compiles what all of them run
for more in told["cases"]:
    if pid := os.fork():
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
        continue
    log = Seen()
    path = f"{told['folder']}/{os.getpid()}.npz"
    log.close = lambda report: np.savez(
        path, x=np.concatenate(log.frames), events=json.dumps(log.events)
    )
    sink = available.make(told["sink"], scene, safety, log=log, realtime=False, **told["options"])
    sink.open(8000)
    sink.start()
    sink.wait(0.3 + told.get("fade", 0.0))
    print(os.getpid(), flush=True)
    exec(more)
    break
"""
ENDS = {
    "sink.wait(60)": [(signal.SIGTERM, 143), (signal.SIGINT, -2), (signal.SIGHUP, 129)],
    "with sink: sink.wait(60)": [(signal.SIGINT, -2)],
    "raise SystemExit(3)": [(None, 3)],
    "": [(None, 0)],
    "1 / 0": [(None, 1)],
}


@pytest.fixture
def program(tmp_path):
    """Starts a program that plays a session for each way in which it ends."""
    started = []

    def start(sink, cases, options, **more):
        told = {"cases": cases, "sink": sink, "options": options, "folder": str(tmp_path)} | more
        env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])} | alsa(tmp_path)
        started.append(
            subprocess.Popen(
                [sys.executable, "-c", CHILD, json.dumps(told)],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env=env,
            )
        )
        return started[0]

    yield start
    for child in started:
        child.kill()
        child.communicate()


def saved(folder, pid, fade=160):
    with np.load(folder / f"{pid}.npz") as told:
        faded(told["x"], json.loads(str(told["events"])), fade)


@pytest.mark.parametrize(
    "kind",
    [
        "null",
        pytest.param("jack", marks=needs_jack),
        pytest.param("portaudio", marks=needs_portaudio()),
    ],
)
def test_signals_and_the_end_of_the_program_fade(kind, program, tmp_path):
    cases = [(more, *end) for more, ends in ENDS.items() for end in ends]
    if kind != "null":
        cases = [cases[0], cases[-2]]
    with Jackd(FS, 64) if kind == "jack" else nullcontext() as server:
        options = {"clocked": False, "name": "stimfile"} if kind == "portaudio" else {}
        options |= {"server": server.name, "connect": None} if kind == "jack" else {}
        child = program(kind, [more for more, *_ in cases], options)
        for more, what, code in cases:
            pid = child.stdout.readline().strip()
            assert pid.isdecimal(), child.stderr.read()
            if what:
                os.kill(int(pid), what)
            assert (more, what, child.stdout.readline().strip()) == (more, what, str(code))
            saved(tmp_path, pid)
    if kind == "portaudio":  # of the last one: each begins its file anew
        heard = from_file(tmp_path, 1)
        assert largest_step(heard, []) <= 0.0101 and not heard[-1].any()


def test_an_impatient_signal_does_not_cut_the_fade_or_the_log(program, tmp_path):
    """Ctrl-C again and again: the fade is half a second here, and the device takes
    another half to close.
    """
    slow = "import time; sink._close_now, sink._close = sink._close, lambda: (time.sleep(0.5),"
    cases = 2 * [f"{slow} sink._close_now())\nwith sink: sink.wait(60)"]
    child = program("null", cases, {}, fade=0.5)
    for what, codes in ((signal.SIGINT, (-2,)), (signal.SIGTERM, (-15, 143))):
        pid = child.stdout.readline().strip()
        for _ in range(4):
            with suppress(ProcessLookupError):
                os.kill(int(pid), what)
            time.sleep(0.15)  # how far it has come by then does not matter
        assert int(child.stdout.readline()) in codes
        saved(tmp_path, pid, fade=4000)


# What a device does not have ----------------------------------------------------------
@pytest.mark.parametrize(
    ("kind", "package", "error", "says"),
    [
        ("jack", "jack", ImportError("No module"), r"JACK-Client.*stimlib\[jack\].*jackd2"),
        ("jack", "jack", OSError("not found"), r"library.*stimlib\[jack\].*jackd2"),
        ("portaudio", "sounddevice", ImportError("No"), r"sounddevice.*\[portaudio\].*apt-get"),
        ("portaudio", "sounddevice", OSError("no"), r"library.*\[portaudio\].*libportaudio2"),
        ("portaudio", "sounddevice", RuntimeError("initializing"), "not start .*other programs"),
    ],
)
def test_what_is_missing_is_named_with_its_command(monkeypatch, kind, package, error, says):
    without(monkeypatch, package, error)
    refused(SinkError, says, available.make(kind, STEADY, 1.0, realtime=False).open, FS)
    (row,) = (d for d in devices("stimlib_none") if d.sink == kind)
    assert not row.ready and row.how


@pytest.mark.parametrize(
    ("how", "told", "says"),
    [
        ({"name": "Nothing/ao0"}, {}, "cannot be opened: .*identifier"),
        ({"name": "Dev1/ao0:1"}, {}, "2 outputs, not 1"),
        ({}, {"rate": 100_000}, "plays at 50000 Hz, not 100000"),
        ({}, {"block": 400}, "400 frames a stop would come 1 s late: at most 100"),
    ],
)
def test_what_an_ni_device_does_not_have_is_refused(monkeypatch, how, told, says):
    nidaqmx(monkeypatch)
    sink = available.make("nidaq", STEADY, 4.0, realtime=False, **how)
    refused(SinkError, says, sink.open, **{"rate": 2000} | told)
    assert Task.made.closed


def test_an_ni_device_plays_volts_in_blocks_of_10_ms_until_it_stops(monkeypatch):
    local = nidaqmx(monkeypatch)
    scene = Scene({"force": constant(2.0, "N")})
    sink = available.make("nidaq", scene, 4.0, volts=5.0, realtime=False)
    with begun(sink, 60.0, fs=2000):
        until(lambda: sink.pump.index > 400)
        assert sink.report().latency == 0.04 and Task.made.limits == (-5.0, 5.0)
        Task.made.unplugged = True
        refused(SinkError, "nidaq: the device ended: The generation", sink.wait, 60.0)
        sink.error = None
    task = Task.made
    assert task.closed and sink.block == 20 and {y.shape for y in task.written} == {(1, 20)}
    assert np.concatenate(task.written, axis=1).max() == 2.5  # 2 N of 4 N, at 5 V
    for volts in (0.0, -1.0, 11.0):
        refused(BadValue, "volts = .* above 0, at most 10", available.make, "nidaq", scene, 4.0,
                volts=volts)  # fmt: skip
    assert available.make("nidaq", scene, 4.0, volts=10.0).volts == 10.0

    def row():
        return next(d for d in devices("stimlib_none") if d.sink == "nidaq")

    assert (row().ready, row().what) == (True, "Dev1 (USB-6211)") and "Dev1/ao0" in row().how
    local.devices.clear()
    assert (row().ready, row().what) == (False, "NI-DAQmx finds no device")
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    assert not row().ready and "install NI-DAQmx" in row().how
