"""The JACK sink against real servers: exact samples, accounts of what is lost, and what
a second client hears of every way out and of a server that ends.
"""

import signal
import threading
import time
import warnings
from functools import partial

import numpy as np
import pytest
from devices.servers import (
    Capture,
    Jackd,
    Seen,
    begun,
    kept,
    needs_jack,
    played,
    replayed,
    unjudged,
    until,
)
from devices.stands import FS, HAND, STEADY, is_exact, textured_sink
from refusals import refused

import stimlib
from stimlib import BadValue, Scene, SinkError
from stimlib.devices import available
from stimlib.scenes import squeeze

pytestmark = needs_jack


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


def sink(server, scene=STEADY, safety=1.0, /, **options):
    from stimlib.devices.jack import JackSink

    return JackSink(scene, safety, **{"realtime": False, "server": server.name} | options)


# Exactness ----------------------------------------------------------------------------
def freewheel(server, channels, seconds=1.0):
    """A session in freewheel mode, captured: equal to the offline render from its first
    sample on.

    False where the server's own time has jumped in it: it began before everybody had
    ended their last cycle in real time, and who captures may be a cycle off from then
    on.  False, too, where the server has dropped who captures, as too late: nothing is
    in its frames.
    """
    fs = server.rate
    n = round(seconds * fs)
    with Capture(server.name, channels, n + 30 * fs) as capture:
        s, log = textured_sink(partial(sink, server), channels, connect=capture.names)
        with s:
            s.open(fs, channels, server.block)
            before = len(capture.times)
            s.freewheel(True)
            s.start(seconds)
            s.wait(60)
            s.freewheel(False)
        frames, times = capture.frames.copy(), capture.times.copy()
    assert (s.report().produced, s.report().lost) == (n, 0)
    heard = np.flatnonzero(frames.any(axis=1))
    if not heard.size or np.any(np.diff(times[before : heard[0] + n]) != 1):
        return False
    is_exact(frames, s, log, seconds)
    return True


@pytest.mark.parametrize(
    ("fs", "block", "channels"), [(1000, 16, 24), (8000, 32, 2), (48000, 64, 8)]
)
def test_freewheel_is_exact(fs, block, channels):
    for _ in range(5):
        with Jackd(fs, block) as server:
            if freewheel(server, channels):
                return
    unjudged("the server's time jumped, or it dropped who captures, in each of 5 sessions")


def test_nothing_is_lost_where_the_server_s_time_jumps_in_freewheel():
    """A client that is late when it begins makes jackd's time jump by millions of
    frames: the sink had counted them as lost.
    """
    with Jackd(FS, 32) as server, Capture(server.name, 1, 60 * FS) as capture:
        s, log = textured_sink(partial(sink, server), 1, connect=capture.names)
        with s:
            s.open(FS)
            s.pump.write("STALL", 300_000)
            until(lambda: s.pump.read("STALL") == 0)
            s.freewheel(True)
            s.start(1.0)
            s.wait(60)
        jumps = np.abs(np.diff(capture.times)).max()
        real = time.monotonic()  # and the server has its own pace again
        played(sink(server), 0.5)
        assert time.monotonic() - real > 0.5
    assert (s.report().produced, s.report().lost) == (FS, 0) and jumps > 1
    is_exact(np.concatenate(log.frames), s, log, 1.0)


class Take:
    """What a session has left behind: its log, its report, and what a second client has
    captured of it, by JACK's time.
    """

    def __init__(self, s, log, capture):
        self.scene, self.safety, self.fs, self.map = s.scene, s.safety, s.rate, s.map
        self.params, self.report, self.log = s.params, s.report(), log
        self.frames = capture.frames[:, : len(s.map)].copy()
        self.index = capture.times[: len(self.frames)] - s.pump.read("ORIGIN")

    def accounted(self):
        """captured + reported lost = produced, and every sample captured is the one of
        its time.

        False where the capturing client itself has missed frames, as its own times
        tell, or where the server went on without us and played what it had: nothing can
        be said then.
        """
        log, report = self.log, self.report
        produced = report.produced
        assert report.delivered + report.lost == produced
        x = np.concatenate(log.x, axis=1) if log.x else np.empty((0, produced))
        whole = replayed(self.scene, self.safety, x, self.fs, log.events, self.map, self.params)
        delivered = kept(log.events, produced)
        assert len(whole) == produced
        assert np.array_equal(np.concatenate(log.frames), whole[delivered])
        inside = (self.index >= 0) & (self.index < produced)
        captured = np.zeros(produced, bool)
        captured[self.index[inside]] = True
        old = ~delivered[self.index[inside]]
        unseen = (delivered & ~captured).sum()
        if self.frames[inside][old].any() or unseen:
            return False
        assert (captured & delivered).sum() + unseen + report.lost == produced
        assert np.array_equal(self.frames[inside][~old], whole[self.index[inside]][~old])
        rise = np.interp(self.index, [-report.rise, 0], [0, 1])[:, None] * whole[0]
        fall = np.interp(self.index - produced + 1, [0, report.fall], [1, 0])[:, None] * whole[-1]
        fades = np.where(self.index[:, None] < 0, rise, fall)[~inside]
        # a block that is late in a fade shifts the rest of it
        return bool(np.allclose(self.frames[~inside], fades, rtol=1e-6, atol=0))


def taken(make):
    """A take that can be judged, of several: this machine is shared, and the capturing
    client may be late too.
    """
    for _ in range(5):
        take = make()
        if take.accounted():
            return take
    unjudged("the capturing client was late in each of 5 takes")


def real_time(seconds, server, stall_at=None, **options):
    """With ten changes of a parameter."""
    log = Seen()
    with Capture(server.name, 2, round((seconds + 15) * FS)) as capture:
        told = {"motion": HAND, "connect": capture.names, "log": log, "params": {"A": 2.0}}
        with begun(sink(server, squeeze(), 50.0, **told, **options), seconds) as s:
            for k in range(10):
                until(lambda k=k: s.pump.index > 0.09 * (k + 1) * FS * seconds)
                if stall_at == k:
                    s.pump.write("STALL", 300_000)
                s.set("k", 500.0 + 100 * k, ramp=0.03)
            s.wait(seconds + 30)
            end = s.pump.read("ORIGIN") + s.report().produced + 160
            until(lambda: capture.times[-1] > end)
        return Take(s, log, capture)


def test_real_time_is_accounted_with_changes_and_a_stall(server):
    take = taken(lambda: real_time(2.0, server, stall_at=3))
    report = take.report
    assert report.produced == 2 * FS and 0 < report.block_time["p50"] < 0.008
    assert report.lost > 0.25 * FS and report.underruns >= 1 and report.block_time["max"] >= 0.3
    assert sum(kind == "set" and e["name"] == "k" for _, kind, e in take.log.events) == 10


def test_another_jack_client_is_refused_with_a_reason(server, monkeypatch):
    import jack

    class Refusing:
        """An ffi that does not know the callbacks' types."""

        def __getattr__(self, name, ffi=jack._ffi):
            return getattr(ffi, name)

        def cast(self, what, value, ffi=jack._ffi):
            if "Callback" in what:
                raise TypeError("no such type")
            return ffi.cast(what, value)

    monkeypatch.setattr(jack, "_ffi", Refusing())
    with sink(server, connect=None) as s:
        refused(SinkError, "no compiled callback .no such type.: pip install", s.open, FS)


# Faults -------------------------------------------------------------------------------
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_a_server_that_ends_is_a_typed_error(how):
    """Meanwhile its latency is asked, which in libjack, where a client that is gone
    ended the whole process.
    """
    log, over, asked = Seen(), threading.Event(), []
    with Jackd(FS, 64) as server:
        s = begun(sink(server, log=log))
        until(lambda: s.pump.index > 0)

        def ask():
            while not over.is_set():
                asked.append(s._latency())

        threads = [threading.Thread(target=ask) for _ in range(3)]
        for t in threads:
            t.start()
        server.process.send_signal(how)
        server.process.wait(10)
        refused(SinkError, "the server has ended", s.wait, 60)
        refused(SinkError, "the server has ended", s.set, "level", 0.5)
        s.close()
        over.set()
        for t in threads:
            t.join()
    report = s.report()
    assert asked and s._latency() == 0.0
    assert report.delivered + report.lost == report.produced > 0
    assert sum(map(len, log.frames)) == report.delivered and log.end["produced"] == report.produced


def test_what_does_not_fit_the_server(server):
    for options, told, error, says in (
        ({}, {"rate": 48000}, SinkError, r"runs at 8000 Hz.*open\(rate=8000\)"),
        ({}, {"block": 32}, SinkError, "64 frames, not 32: leave"),
        ({}, {"channels": 25}, SinkError, "24 physical outputs, fewer"),
        ({"connect": ["nobody:in_1"]}, {}, SinkError, "no input port 'nobody:in_1'"),
        ({"server": "stimlib_none"}, {}, SinkError, "'stimlib_none' is running: start one"),
        ({"connect": ["a", "b"]}, {}, BadValue, "2 ports for 1 channel"),
    ):
        refused(error, says, sink(server, **options).open, **{"rate": FS} | told)
    with sink(server) as first:
        first.open(FS)
        refused(SinkError, "has a client 'stimlib' already", sink(server).open, FS)
        with sink(server, name="another") as second:
            second.open(FS)
    with sink(server) as again:
        again.open(FS)


def test_ports_are_named_like_the_outputs(server):
    import jack

    scene = Scene({"a": stimlib.constant(1.0), "b": stimlib.constant(1.0)})
    with sink(server, scene, connect="system") as s:
        s.open(FS, channels=["b", None, "a", "b"])
        client = jack.Client("looker", no_start_server=True, servername=server.name)
        names = [p.name for p in client.get_ports("stimlib:.*")]
        assert names == ["stimlib:b", "stimlib:silent_2", "stimlib:a", "stimlib:b_4"]
        assert [p.name for p in client.get_all_connections("stimlib:a")] == ["system:playback_3"]
        # the server counts latencies anew some time after a connection was made
        until(lambda: s.report().latency > 0)
        client.close()


def test_real_time_set_up_warns_where_the_server_has_none(server):
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        played(sink(server, realtime=True), 0.2)
    assert len(seen) == 1 and "jackd runs without -R" in str(seen[0].message)


def test_libjack_is_given_one_function_for_what_it_says(server):
    """A thread of libjack may be about to call one that is exchanged, and freed."""
    played(sink(server), 0.05)
    import jack

    before = jack._keepalive.copy()
    played(sink(server), 0.05)
    assert available.devices(server.name) and jack._keepalive == before
    assert jack._lib.jack_set_error_function in before
