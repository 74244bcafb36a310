"""The JACK sink against real servers: exact samples, accounts of what is lost, every
way out, and faults.
"""

import itertools
import json
import os
import signal
import statistics
import subprocess
import sys
import textwrap
import threading
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from devices.servers import (
    SLACK,
    Capture,
    Jackd,
    Seen,
    aligned,
    busy,
    captured_fades,
    faded,
    kept,
    largest_step,
    needs_jack,
    offline,
    replayed,
    textured,
    unjudged,
    until_judged,
    without,
)

import stimlib
from stimlib import BadValue, FaultError, Input, Param, Scene, SinkError
from stimlib.devices.sink import CLOSE_WITHIN
from stimlib.devices.sources import Recorded, Signal, Signals
from stimlib.motion.generators import minimum_jerk
from stimlib.run.safety import Safety
from stimlib.scenes import squeeze

pytestmark = needs_jack

FS = 8000
HAND = {"x1": minimum_jerk(0.02), "x2": minimum_jerk(0.01)}


@pytest.fixture(scope="module")
def servers():
    kept = []
    yield kept
    for s in kept:
        s.__exit__()


@pytest.fixture
def server(servers):
    """One for all tests, as long as it lives; what it said when it ended is shown with
    the test that failed.
    """
    if not servers or servers[-1].process.poll() is not None:
        servers.append(Jackd(FS, 64).__enter__())
    yield servers[-1]
    if (code := servers[-1].process.poll()) is not None:
        print(f"jackd has ended ({code}): {servers[-1].log}")


def sink(scene, safety=50.0, **options):
    from stimlib.devices.jack import JackSink

    return JackSink(scene, safety, **({"realtime": False} | options))


def steady():
    return Scene({"y": Param("level", 1.0) * 1})


# Exactness ----------------------------------------------------------------------------
def freewheel(server, channels, seconds):
    """A session in freewheel mode, captured: equal to the offline render from its first
    sample on.

    False where the server's own time has jumped in it: it began before everybody had
    ended their last cycle in real time, and who captures may be a cycle off from then
    on.
    """
    fs, outputs = server.rate, min(channels, 2)
    scene, n = textured(outputs), round(seconds * fs)
    hand = {name: HAND[name] for name in scene.inputs}
    log = Seen()
    with Capture(server.name, channels, n + 30 * fs) as capture:
        with sink(
            scene, motion=hand, server=server.name, connect=capture.names, log=log, seed=7
        ) as s:
            s.open(fs, channels, server.block)
            before = len(capture.times)
            s.freewheel(True)
            s.start(seconds)
            s.wait(60)
            s.freewheel(False)
        frames, times = capture.frames.copy(), capture.times.copy()
    report = s.report()
    assert (report.produced, report.lost) == (n, 0)
    start = int(np.flatnonzero(frames.any(axis=1))[0])
    if np.any(np.diff(times[before : start + n]) != 1):
        return False
    places = list(range(outputs)) + [-1] * (channels - outputs)
    expected = offline(scene, Safety(50.0), hand, fs, n, log.events, places, seed=7)
    assert np.array_equal(aligned(frames, expected), expected)
    head = Safety(50.0).samples(fs)  # and between the fades it is float32(render / full scale)
    plain = (stimlib.render(scene, hand, fs, seconds, seed=7).y / 50.0).astype(np.float32).T
    assert np.array_equal(aligned(frames, expected)[head:-head, :outputs], plain[head:-head])
    assert np.abs(plain).max() > 0.3
    return True


@pytest.mark.parametrize(
    "fs, block, channels", [(1000, 16, 24), (8000, 64, 1), (8000, 32, 2), (48000, 64, 8)]
)
def test_freewheel_is_exact(fs, block, channels):
    for _ in range(5):
        with Jackd(fs, block) as server:
            if freewheel(server, channels, 2.0):
                return
    unjudged("the server's time jumped in each of 5 sessions")


def test_nothing_is_lost_where_the_server_s_time_jumps_in_freewheel():
    """A client that is late when it begins makes jackd's time jump by millions of
    frames: the sink had counted them as lost.
    """
    log, fs = Seen(), 8000
    with Jackd(fs, 32) as server, Capture(server.name, 1, 60 * fs) as capture:
        with sink(
            textured(1),
            motion={"x1": HAND["x1"]},
            server=server.name,
            connect=capture.names,
            log=log,
            seed=7,
        ) as s:
            s.open(fs)
            s.pump.write("STALL", 300_000)
            time.sleep(0.05)
            s.freewheel(True)
            s.start(2.0)
            s.wait(60)
        assert np.abs(np.diff(capture.times)).max() > fs, "it jumped"
    assert (s.report().produced, s.report().lost) == (2 * fs, 0)
    expected = offline(
        textured(1), Safety(50.0), {"x1": HAND["x1"]}, fs, 2 * fs, log.events, [0], seed=7
    )
    assert np.array_equal(np.concatenate(log.frames), expected)


def test_a_sink_closed_in_freewheel_leaves_the_server_as_it_was():
    with Jackd(1000, 16) as server:
        for _ in range(3):
            with sink(textured(1), motion={"x1": HAND["x1"]}, server=server.name) as s:
                s.open(1000)
                s.freewheel(True)
                s.start(1.0)
                s.wait(20)
        real = time.monotonic()
        with sink(steady(), 1.0, server=server.name) as s:
            s.open(1000)
            s.start(0.5)
            s.wait(20)
        assert time.monotonic() - real > 0.5, "at its own pace"


class Take:
    """What a session has left behind: its log, its report, and what a second client has
    captured of it, by JACK's time.
    """

    def __init__(self, s, log, capture):
        self.scene, self.safety, self.fs, self.map = s.scene, s.safety, s.rate, s.map
        self.params, self.report, self.log = s.params, s.report(), log
        self.frames = capture.frames[:, : len(s.map)].copy()
        self.index = capture.times[: len(self.frames)] - s.pump.read("ORIGIN")

    def accounted(self, missed=0):
        """captured + reported lost = produced, and every sample captured is the one of
        its time.

        False where the capturing client itself has missed more frames than that, as its
        own times tell, or where the server went on without us and played what it had:
        nothing can be said then.
        """
        log, report = self.log, self.report
        produced = report.produced
        assert report.delivered + report.lost == produced
        assert sum(e["frames"] for _, kind, e in log.events if kind == "lost") == report.lost
        x = np.concatenate(log.x, axis=1) if log.x else np.empty((0, produced))
        whole = replayed(self.scene, self.safety, x, self.fs, log.events, self.map, self.params)
        assert len(whole) == produced
        delivered = kept(log.events, produced)
        assert np.array_equal(np.concatenate(log.frames), whole[delivered]), (
            "what was logged as delivered"
        )
        inside = (self.index >= 0) & (self.index < produced)
        captured = np.zeros(produced, bool)
        captured[self.index[inside]] = True
        old = ~delivered[self.index[inside]]
        unseen = (delivered & ~captured).sum()
        if self.frames[inside][old].any() or unseen > missed:
            return False
        assert (captured & delivered).sum() + unseen + report.lost == produced
        assert np.array_equal(self.frames[inside][~old], whole[self.index[inside]][~old]), (
            "what was captured"
        )
        rise = np.interp(self.index, [-report.rise, 0], [0, 1])[:, None] * whole[0]
        fall = np.interp(self.index - produced + 1, [0, report.fall], [1, 0])[:, None] * whole[-1]
        fades = np.where(self.index[:, None] < 0, rise, fall)[~inside]
        # a block that is late in a fade shifts the rest of it
        return bool(np.allclose(self.frames[~inside], fades, rtol=1e-6, atol=0))


def taken(make, missed=0):
    """A take that can be judged, of several: this machine is shared, and the capturing
    client may be late too.
    """
    for _ in range(5):
        take = make()
        if take.accounted(missed):
            return take
    unjudged("the capturing client was late in each of 5 takes")


def real_time(seconds, server, stall_at=None, **options):
    log = Seen()
    with Capture(server.name, 2, round((seconds + 15) * FS)) as capture:
        with sink(
            squeeze(), motion=HAND, server=server.name, connect=capture.names, log=log, **options
        ) as s:
            s.open(FS)
            s.start(seconds)
            if stall_at is not None:
                s.wait(stall_at)
                s.pump.write("STALL", 300_000)
            s.wait(seconds + 30)
        time.sleep(0.05)
        return Take(s, log, capture)


def test_real_time_is_accounted(server):
    report = taken(lambda: real_time(3.0, server)).report
    assert report.produced == 3 * FS
    assert 0 < report.block_time["p50"] < 0.008


def test_a_stall_is_reported_and_accounted(server):
    take = taken(lambda: real_time(3.0, server, stall_at=1.0))
    assert (
        take.report.lost > 0.25 * FS
        and take.report.underruns >= 1
        and take.report.block_time["max"] >= 0.3
    )


def test_changes_while_it_plays(server):
    def make():
        log = Seen()
        with Capture(server.name, 2, 30 * FS) as capture:
            with sink(
                squeeze(),
                motion=HAND,
                server=server.name,
                connect=capture.names,
                log=log,
                params={"A": 1.0},
            ) as s:
                s.open(FS)
                s.start(1.5)
                for k in range(10):
                    s.wait(0.1)
                    s.set("k", 500.0 + 100 * k, ramp=0.03)
                s.wait(30)
            return Take(s, log, capture)

    events = taken(make).log.events
    assert sum(kind == "set" and e["name"] == "k" for _, kind, e in events) == 10


def test_a_callback_in_python_plays_the_same(server):
    taken(lambda: real_time(1.0, server, compiled=False))


def test_a_process_that_was_stopped_goes_on_in_time(server):
    """SIGSTOP for 300 ms: what a debugger, a suspended machine or a stall of the whole
    program do.
    """

    def take():
        with Capture(server.name, 1, 120 * FS) as capture:
            child = player(server, "sink.wait(20)")
            try:
                assert child.stdout.readline() == "playing\n", child.stderr.read()
                child.send_signal(signal.SIGSTOP)
                time.sleep(0.3)
                child.send_signal(signal.SIGCONT)
                time.sleep(0.2)
                child.send_signal(signal.SIGTERM)
                out, _ = child.communicate(timeout=30)
            finally:
                child.kill()
            report = json.loads(out)["report"]
            frames = capture.frames.copy()
            times = capture.times[: len(frames)].copy()
        assert (
            report["produced"] == report["delivered"] + report["lost"]
            and report["lost"] > 0.25 * FS
        )
        first, last = np.flatnonzero(frames[:, 0])[[0, -1]]
        more = np.sum(np.diff(times[first : last + 1]) - 1) - report["lost"]
        assert more >= -10 * 64, (
            "what is told is missing, but for what was lost before the first sound or behind the"
            " last"
        )
        return more <= 10 * 64  # else the client that captures has missed some itself

    until_judged(take)


def test_a_session_replays_from_its_log(server, tmp_path):
    from stimlib.files.log_reader import read_log
    from stimlib.files.log_replay import replay

    folder = tmp_path / "session.stimlog"
    with sink(
        squeeze(), motion=HAND, server=server.name, log=folder, params={"A": 2.0}, seed=11
    ) as s:
        s.open(FS, channels=4)
        s.start(4.0)
        for k in range(5):
            s.wait(0.2)
            s.set("k", 800.0 + 200 * k, ramp=0.05)
            if k == 2:
                s.pump.write("STALL", 300_000)
        s.wait(30)
    log, report = read_log(folder), s.report()
    again = replay(log)
    assert again.matches and report.lost > 0.25 * FS
    assert sum(c.name == "k" for c in log.changes) == 5
    assert (log.frames, sum(n for _, n in log.lost)) == (report.produced, report.lost)


def test_another_jack_client_falls_back_to_python_with_a_warning(server, monkeypatch):
    import jack

    monkeypatch.setattr(jack, "_ffi", Refusing(jack._ffi))
    with sink(steady(), 1.0, server=server.name, connect=None) as s:
        with pytest.warns(RuntimeWarning, match="no compiled callback"):
            s.open(FS)
        s.start(0.3)
        s.wait(20)
    assert s.report().produced == 2400


class Refusing:
    """An ffi that does not know the callbacks' types."""

    def __init__(self, ffi):
        self._of = ffi

    def __getattr__(self, name):
        return getattr(self._of, name)

    def cast(self, what, value):
        if "Callback" in what:
            raise TypeError("no such type")
        return self._of.cast(what, value)


# Position as a signal -----------------------------------------------------------------
def test_a_position_comes_in_as_a_signal(server):
    """One sink plays a position, another one feels it."""
    position = Scene({"x": 1.0 * Input("p", "m")})
    felt = Scene({"force": stimlib.constant(2000.0, "N/m") * Input("x", "m")})

    def make():
        log = Seen()
        with Capture(server.name, 2, 60 * FS) as capture:
            with sink(
                position,
                0.05,
                motion={"p": HAND["x1"]},
                server=server.name,
                name="hand",
                connect=None,
            ) as hand:
                hand.open(FS)
                source = Signals({"x": Signal(0.05, connect="hand:x")})
                with sink(
                    felt,
                    50.0,
                    motion=source,
                    server=server.name,
                    connect=capture.names[:1],
                    log=log,
                ) as s:
                    s.open(FS)
                    s.start()
                    hand.start(1.0)
                    hand.wait(20)
                    s.wait(0.1)
                    # the wire is pulled: the last position is held, then the gain fades
                    hand.close()
                    s.wait(0.5)
            return Take(s, log, capture)

    take = taken(make)
    x = np.concatenate(take.log.x, axis=1)
    assert x.max() > 0.0199 and x[0, -1] == 0
    assert [kind for _, kind, _ in take.log.events if kind in ("fresh", "stale")] == [
        "fresh",
        "stale",
    ]
    assert take.report.stale == 1


def test_what_is_not_finite_never_reaches_the_port(server):
    x = np.full((2, 3 * FS), 0.01)
    x[0, FS // 2] = np.nan
    x[1, FS // 2 + 10] = np.inf
    log = Seen()
    with Capture(server.name, 2, 30 * FS) as capture:
        with pytest.raises(FaultError, match="force1 was not finite at sample 4000"):
            with sink(
                textured(), motion=Recorded(x), server=server.name, connect=capture.names, log=log
            ) as s:
                s.open(FS)
                s.start()
                s.wait(20)
        frames = capture.frames.copy()
    assert (
        np.isfinite(frames).all()
        and np.abs(frames).max() == np.float32(0.4)
        and not frames[-1].any()
    )
    assert s.report().faults == {"force1": 4000, "force2": 4010}
    delivered = np.concatenate(log.frames)
    assert np.isfinite(delivered).all() and largest_step(delivered, log.events) < 0.01


# Ways out -----------------------------------------------------------------------------
@pytest.mark.parametrize("way", ["stop", "close", "exception", "end"])
@pytest.mark.longer
def test_every_way_out_fades(server, way):
    def take():
        log = Seen()
        with Capture(server.name, 1, 30 * FS) as capture:
            try:
                with sink(steady(), 1.0, server=server.name, connect=capture.names, log=log) as s:
                    s.open(FS)
                    s.start(0.3 if way == "end" else None)
                    s.wait(0.4)
                    if way == "stop":
                        s.stop()
                        time.sleep(0.1)
                    elif way == "close":
                        began = time.monotonic()
                        s.close()
                        assert time.monotonic() - began < CLOSE_WITHIN + SLACK
                    elif way == "exception":
                        raise ValueError("an experiment's mistake")
            except ValueError:
                assert way == "exception"
            time.sleep(0.05)
            frames = capture.frames.copy()
            return captured_fades(
                frames,
                capture.times[: len(frames)] - s.pump.read("ORIGIN"),
                log.events,
                capture.xruns,
            )

    until_judged(take)


@pytest.mark.parametrize("error", [SystemExit(3), KeyboardInterrupt()], ids=repr)
def test_a_motion_that_exits_fades_out_and_is_told(server, error):
    """More ways, on other sinks that share this code: test_functions.py."""

    def motion(t):
        if t[-1] > 0.7:
            raise error
        return np.ones_like(t)

    log, scene = Seen(), Scene({"y": 1.0 * Input("x")})
    with pytest.raises(SinkError, match="jack: the motion failed: "):
        with sink(scene, 1.0, motion={"x": motion}, server=server.name, connect=None, log=log) as s:
            s.open(FS)
            s.start()
            s.wait(20)
    faded(np.concatenate(log.frames), log.events)
    assert [more["reason"] for _, kind, more in log.events if kind == "stop"] == ["error"]


CHILD = """
import atexit, json, sys, time
import stimlib
from devices.servers import Seen
from stimlib.devices.jack import JackSink
log = Seen()
scene, port = stimlib.Scene({"y": stimlib.constant(1.0)}), "capture:in_1"
sink = JackSink(scene, 1.0, server=sys.argv[1], connect=port, realtime=False, log=log)
sink.open(8000)
sink.start()

@atexit.register
def end():
    sink.close()
    told = {"report": sink.report().to_dict(), "events": log.events}
    told["origin"] = sink.pump.read("ORIGIN")
    print(json.dumps(told), flush=True)

time.sleep(0.3)
print("playing", flush=True)
"""


def player(server, more):
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(CHILD) + more, server.name],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
    )


@pytest.mark.parametrize(
    "more, what, code",
    [
        ("sink.wait(20)", signal.SIGTERM, 143),
        ("with sink: sink.wait(20)", signal.SIGINT, -2),
        ("1 / 0", None, 1),
        ("", None, 0),
    ],
)
def test_signals_and_the_end_of_the_program_fade(server, more, what, code):
    def take():
        with Capture(server.name, 1, 120 * FS) as capture:
            child = player(server, more)
            try:
                assert child.stdout.readline() == "playing\n", child.stderr.read()
                if what:
                    child.send_signal(what)
                told = json.loads(child.communicate(timeout=30)[0])
            finally:
                child.kill()
            time.sleep(0.05)
            assert child.returncode == code
            frames = capture.frames.copy()
            return captured_fades(
                frames, capture.times[: len(frames)] - told["origin"], told["events"], capture.xruns
            )

    until_judged(take)


# Faults -------------------------------------------------------------------------------
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.longer
def test_a_server_that_is_killed_is_a_typed_error_within_a_second(how):
    log = Seen()
    with Jackd(FS, 64) as server:
        s = sink(steady(), 1.0, server=server.name, log=log)
        s.open(FS)
        s.start()
        s.wait(0.3)
        server.process.send_signal(how)
        server.process.wait(10)  # a server that ends takes its time; from its end on it is our turn
        began = time.monotonic()
        with pytest.raises(SinkError, match="the server has ended"):
            s.wait(1.0 + SLACK)
        assert time.monotonic() - began < 1.0 + SLACK
        with pytest.raises(SinkError, match="the server has ended"):
            s.set("level", 0.5)
        began = time.monotonic()
        s.close()
        assert time.monotonic() - began < CLOSE_WITHIN + SLACK
    report = s.report()
    assert report.delivered + report.lost == report.produced > 0
    assert sum(map(len, log.frames)) == report.delivered and log.end["produced"] == report.produced


@pytest.mark.longer
def test_a_latency_is_asked_while_the_client_of_a_dead_server_is_closed():
    """Both in libjack, where a client that is gone ended the whole process."""
    for _ in range(8):
        with Jackd(FS, 64) as server:
            s = sink(steady(), 1.0, server=server.name)
            s.open(FS)
            s.start()
            asked, over = [], threading.Event()

            def ask(s=s, asked=asked, over=over):
                while not over.is_set():
                    asked.append(s._latency())

            threads = [threading.Thread(target=ask) for _ in range(3)]
            for t in threads:
                t.start()
            server.process.send_signal(signal.SIGTERM)
            server.process.wait(10)
            s.close()
            over.set()
            for t in threads:
                t.join()
        assert asked and s._latency() == 0.0


def test_what_does_not_fit_the_server(server):
    cases = [
        ({}, {"rate": 48000}, "the server runs at 8000 Hz, not at 48000"),
        ({}, {"rate": FS, "block": 32}, "blocks have 64 frames, not 32"),
        ({}, {"rate": FS, "channels": 25}, "24 physical outputs, fewer than the 25 channels"),
        ({"connect": ["nobody:in_1"]}, {"rate": FS}, "no input port 'nobody:in_1'"),
        (
            {"server": "stimlib_none"},
            {"rate": FS},
            "no server 'stimlib_none' is running: start one",
        ),
    ]
    for options, arguments, text in cases:
        with pytest.raises(SinkError, match=text):
            sink(steady(), 1.0, **({"server": server.name} | options)).open(**arguments)
    with pytest.raises(BadValue, match="2 ports for 1 channels"):
        sink(steady(), 1.0, server=server.name, connect=["a", "b"]).open(FS)


def test_a_second_client_of_the_same_name(server):
    with sink(steady(), 1.0, server=server.name) as first:
        first.open(FS)
        with pytest.raises(SinkError, match="has a client 'stimlib' already"):
            sink(steady(), 1.0, server=server.name).open(FS)
        with sink(steady(), 1.0, server=server.name, name="another") as second:
            second.open(FS)
    with sink(steady(), 1.0, server=server.name) as again:
        again.open(FS)


def test_ports_are_named_like_the_outputs(server):
    import jack

    scene = Scene({"a": stimlib.constant(1.0), "b": stimlib.constant(1.0)})
    with sink(scene, 1.0, server=server.name, connect="system") as s:
        s.open(FS, channels=["b", None, "a", "b"])
        client = jack.Client("looker", no_start_server=True, servername=server.name)
        names = [p.name for p in client.get_ports("stimlib:.*")]
        assert names == ["stimlib:b", "stimlib:silent_2", "stimlib:a", "stimlib:b_4"]
        assert [p.name for p in client.get_all_connections("stimlib:a")] == ["system:playback_3"]
        # the server counts latencies anew some time after a connection was made
        for _ in range(100):
            if s.report().latency:
                break
            time.sleep(0.05)
        assert s.report().latency > 0
        client.close()


@pytest.mark.parametrize(
    "missing, text",
    [
        (ImportError("No module named 'jack'"), "JACK-Client"),
        (OSError("JACK library not found"), "library"),
    ],
)
def test_what_is_missing_is_named_with_its_command(monkeypatch, missing, text):
    without(monkeypatch, "jack", missing)
    with pytest.raises(
        SinkError, match=rf"{text}.*pip install 'stimlib\[jack\]'.*apt-get install jackd2"
    ):
        sink(steady(), 1.0).open(FS)


def test_real_time_set_up(server):
    """Where it is permitted it is done, and where it is not there is one warning (this
    server runs without -R).
    """
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        with sink(steady(), 1.0, server=server.name, realtime=True) as s:
            s.open(FS)
            s.start(0.2)
            s.wait(20)
    assert len(seen) == 1 and "jackd runs without -R" in str(seen[0].message)


@pytest.mark.stress
@pytest.mark.parametrize("fs, block", list(itertools.product((1000, 8000, 48000), (16, 32, 64))))
def test_freewheel_is_exact_everywhere(fs, block):
    with Jackd(fs, block) as server:
        for channels in (1, 2, 8, 24):
            assert any(freewheel(server, channels, 10.0) for _ in range(3))


@pytest.mark.stress
def test_a_minute_in_real_time_is_accounted(server):
    # by the client that captures, in a minute
    take = taken(lambda: real_time(60.0, server, stall_at=20.0), missed=FS)
    assert take.report.produced == 60 * FS and take.report.lost > 0.25 * FS
    print(take.report)


@pytest.mark.stress
def test_a_busy_interpreter_does_not_reach_the_compiled_callback(server):
    found = {True: [], False: []}
    for _ in range(5):
        for compiled in found:
            found[compiled].append(busy(server, compiled).underruns)
    print("underruns of the compiled callback and of Python's:", *found.values())
    if statistics.median(found[False]) < 50:
        pytest.skip(f"Python's callback had only {found[False]} underruns")
    assert statistics.median(found[True]) <= 0.1 * statistics.median(found[False])
