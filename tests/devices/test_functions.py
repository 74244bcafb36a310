"""Functions of the user's that a sink calls: whatever they do, the session ends, faded,
with an error that names them.
"""

import sys
import threading
import time
import warnings

import numpy as np
import pytest
from devices import servers
from devices.servers import begun
from laws import mostly
from refusals import refused

from stimlib import Input, Scene, SinkError, constant
from stimlib.devices import NullSink, Sink
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import delivered, replay
from stimlib.live.sink import PageSink

FS, BLOCK = 1000, 20
# from this sample on a function misbehaves; a motion is asked for 0.5 s before
AT = {"feed": 160, "take": 160, "motion": 600}
SCENE = Scene({"y": 1.0 * Input("x")})


class Own(BaseException):
    """No Exception: what a test framework or an event loop raises."""


class Mute(Exception):
    def __str__(self):
        raise SystemExit("no text")


class Hidden(Exception):
    @property
    def __traceback__(self):
        raise RuntimeError("no place")


def throw(error):
    def way(x, sink):
        raise error

    return way


def deep(x, sink):
    return deep(x, sink)


RAISES = {
    "Exception": throw(ZeroDivisionError("mine")),
    "SystemExit": throw(SystemExit(3)),
    "KeyboardInterrupt": throw(KeyboardInterrupt()),
    "Own": throw(Own("mine")),
    "Mute": throw(Mute()),
    "Hidden": throw(Hidden("mine")),
    "GeneratorExit": throw(GeneratorExit()),
    "StopIteration": throw(StopIteration()),
    "RecursionError": deep,
    "MemoryError": throw(MemoryError()),
    "sys.exit": lambda x, sink: sys.exit("mine"),
    "close": lambda x, sink: sink.close(),
    "wait": lambda x, sink: sink.wait(),
}
WRONG = {
    "None": lambda x, sink: None,
    "float": lambda x, sink: 0.5,
    "wrong shape": lambda x, sink: x[None],
    "wrong length": lambda x, sink: x[..., 1:],
    "objects": lambda x, sink: x.astype(object),
    "complex": lambda x, sink: x + 0j,
    "nan": lambda x, sink: x * np.nan,
    "inf": lambda x, sink: x / 0.0,
    "ragged": lambda x, sink: [[1.0], [1.0, 2.0]],
    "string": lambda x, sink: "0.5" * x.size,
    "bytes": lambda x, sink: bytes(x),
    "generator": lambda x, sink: (v for v in x),
    "masked": lambda x, sink: np.ma.masked_greater(x, 0.1),
    "masked integers": lambda x, sink: np.ma.masked_greater(np.ones(x.shape, int), 0),
    "dict": lambda x, sink: {"x": x},
}
TAKEN = {  # converted, bit for bit
    "float32": lambda x, sink: x.astype(np.float32),
    "integers": lambda x, sink: np.ones(x.shape, np.int16),
    "list": lambda x, sink: x.tolist(),
    "strided": lambda x, sink: np.repeat(x, 2, axis=-1)[..., ::2],
    "read-only": lambda x, sink: np.broadcast_to(0.5, x.shape),
    "big-endian": lambda x, sink: x.astype(">f8"),
    "nothing masked": lambda x, sink: np.ma.array(x),
}
WAYS = RAISES | WRONG | TAKEN
OTHERS = {"stop": lambda x, sink: sink.stop() or x}  # no error


class Log:
    """A log of which one method misbehaves."""

    def __init__(self, bad, way):
        self.bad, self.way, self.sink = bad, way, None

    def called(self, name):
        if name == self.bad:
            self.way(np.ones(1), self.sink)

    def motion(self, x):
        self.called("motion of a log")

    def delivered(self, frames):
        self.called("delivered")

    def event(self, at, kind, **more):
        self.called("event")

    def close(self, report):
        self.called("close")


def fails(where, name):
    """Whether a function that misbehaves so ends the session with an error."""
    return name in RAISES or (name in WRONG and where in ("feed", "motion"))


def played(where, name, folder):
    """The error of a session in which a function misbehaves so."""
    way, late_calls, at_last = (WAYS | OTHERS)[name], [], AT.get(where)

    def misbehave(x, late):
        late_calls.extend([late] * bool(late))
        with np.errstate(all="ignore"):
            return way(x, sink) if late else x

    def feed(at, n):
        return misbehave(np.full((1, n), 0.5), where == "feed" and at > at_last)

    def take(at, x, y):
        misbehave(y, where == "take" and at > at_last)

    def motion(t):
        return misbehave(np.full_like(t, 0.5), where == "motion" and t[-1] > at_last / FS)

    if where in ("feed", "take"):
        sink = PageSink(SCENE, 1.0, feed=feed, take=take, log=folder)
    else:
        log = folder if where == "motion" else Log(where, way)
        sink = NullSink(SCENE, 1.0, motion={"x": motion}, clocked=False, log=log)
    if where not in AT:
        log.sink = sink
    ends = 1.2 * at_last / FS if at_last else 0.3
    if fails(where, name) or (name in OTHERS and at_last):
        ends = 30.0
    try:
        with begun(sink, ends, fs=FS, block=BLOCK):
            sink.wait(60)
            assert sink.finished, "it hangs"
    except SinkError as e:
        if where in ("motion of a log", "delivered", "event"):
            assert sink.pump.read("FADING") == 1 and sink.report().produced < ends * FS
        return e
    assert late_calls or where not in AT


def check(where, name, folder):
    """A session in which a function misbehaves so ends as is promised."""
    error = played(where, name, folder)
    assert (error is not None) == fails(where, name)
    if error is not None:
        names = {"feed": "feed failed", "take": "take failed", "motion": "the motion failed"}
        what = names.get(where, "the log cannot be written")
        if name in ("close", "wait"):
            assert f"{name}: a function that the sink calls cannot" in str(error)
        else:
            assert f": {what}: " in str(error) and "; correct it, and play again" in str(error)
            place = "its place cannot be found" if name == "Hidden" else __file__
            assert place in str(error) or (where == "motion" and name in WRONG)
    if where not in AT:
        return
    log = read_log(folder)
    assert log.report is not None and replay(log).matches
    y = np.concatenate([frames for _, frames, _ in delivered(log)])[:, 0]
    reasons = [e.data["reason"] for e in log.events if e.kind == "stop"]
    assert reasons == (["error"] if error else ["stop"] if name in OTHERS else [])
    assert y.max() == (1.0 if where != "take" and name == "integers" else 0.5)
    if reasons and not any(e.kind == "lost" for e in log.events):
        assert np.abs(np.diff(y)).max() < 0.01 and abs(y[-1]) < 0.01


def cases():
    """Feed and take in all ways; the motion and the log, which share what calls them,
    in some, and the others as stress.
    """
    chosen = [("feed", name) for name in [*WAYS, "stop"]]
    chosen += [("take", name) for name in ("Exception", "Own", "Mute", "close", "stop", "None")]
    chosen += [("motion", name) for name in ("Exception", "Own", "Mute", "close", "stop")]
    chosen += [("motion", name) for name in WRONG | TAKEN]
    chosen += [("delivered", name) for name in ("Exception", "SystemExit", "Mute", "wait")]
    chosen += [(where, "SystemExit") for where in ("motion of a log", "event", "close")]
    rest = [(where, name) for where in ("take", "motion") for name in WAYS] + [
        (where, n) for where in ("delivered", "event") for n in RAISES if n != "close"
    ]
    return mostly(chosen, list(dict.fromkeys(chosen + rest)))


@pytest.mark.parametrize("case", cases(), ids=" ".join)
def test_whatever_a_function_does_the_session_ends_and_says_why(case, tmp_path):
    check(*case, tmp_path / "log")


@pytest.mark.parametrize(
    ("where", "error", "warns"),
    [
        ("feed", "feed or take has not", "it was left behind, silent"),
        ("take", "feed or take has not", "it was left behind, silent"),
        ("motion", "a function of the motion has not returned", ""),
        ("delivered", "None", "the log is not written yet"),
    ],
)
def test_a_function_that_does_not_return_is_told_where_it_can_be(
    where, error, warns, tmp_path, monkeypatch, request
):
    """Nobody can interrupt it: a page is left behind without a fade, a motion stands
    still, a log lacks what came after 4 s.
    """
    monkeypatch.setattr(PageSink, "silent_for", 0.3)
    monkeypatch.setattr("stimlib.devices.sink.WAITS", 0.3)
    go_on = threading.Event()
    request.addfinalizer(go_on.set)
    monkeypatch.setitem(OTHERS, "hangs", lambda x, sink: (go_on.wait(60), x)[1])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        told = played(where, "hangs", tmp_path / "log")
    go_on.set()
    assert error in str(told)
    assert [warns in str(w.message) for w in said] == [True] * bool(warns)
    if where in AT:
        log = read_log(tmp_path / "log")
        assert log.report is not None and replay(log).matches
        y = np.concatenate([frames for _, frames, _ in delivered(log)])[:, 0]
        assert where != "motion" or (np.abs(np.diff(y)).max() < 0.01 and abs(y[-1]) < 0.01)


def test_a_function_as_slow_as_the_device_is_no_function_that_does_not_return(monkeypatch):
    """The device takes each of its rows at once, so that it never has to wait."""
    monkeypatch.setattr("stimlib.devices.sink.WAITS", 1.0)

    def slow(t):
        time.sleep(0.005)
        return 0.01 * np.sin(t)

    sink = NullSink(SCENE, 1.0, motion={"x": slow}, clocked=False)
    servers.played(sink, 300 * 1024 / 8000)
    assert sink.report().delivered >= 300 * 1024


def test_a_page_may_be_stopped_from_its_own_functions_while_it_is_closed(tmp_path):
    """Both at once: neither waits for the other."""
    closing = threading.Event()

    def feed(at, n):
        if closing.is_set():
            sink.stop()
        return np.full((1, n), 0.5)

    with begun(
        PageSink(SCENE, 1.0, feed=feed, take=lambda at, x, y: None, log=tmp_path / "log"),
        fs=FS,
        block=BLOCK,
    ) as sink:
        sink.wait(0.2)
        closing.set()
    log = read_log(tmp_path / "log")
    assert replay(log).matches and [e.kind for e in log.events if e.kind == "stop"] == ["stop"]


def test_what_take_writes_into_its_samples_is_not_held_when_feed_fails():
    """A page that shows millimetres multiplies them in place; the output fades from
    where it was.
    """
    seen = []

    def feed(at, n):
        if at > 160:
            raise ValueError("the tracker is away")
        return np.full((1, n), 0.25)

    def take(at, x, y):
        seen.append(y.copy())
        x *= 1000.0

    sink = PageSink(SCENE, 1.0, feed=feed, take=take)
    refused(SinkError, "feed failed", servers.played, sink, fs=FS, block=BLOCK)
    y = np.concatenate(seen, axis=1)[0]
    assert y.max() == 0.25 and np.abs(np.diff(y[200:])).max() < 0.01


class Slips(Sink):
    """A device as in docs/howto/write_a_sink.rst, with what its author forgot."""

    device = "mine"
    asks, made, size = BLOCK, True, BLOCK

    def _open(self):
        self.block = self.size
        if self.made:
            self.frames = self.make_frames()
        self.start_loop(self.run)

    def run(self):
        while not self.closing:
            time.sleep(BLOCK / self.rate)
            self.pump.block(self.asks)


@pytest.mark.parametrize(
    ("slip", "says"),
    [
        ({"size": None}, "^mine: _open must set self.block before make_frames"),
        ({"made": False}, "frames is more than the 0 of make_frames"),
        ({"asks": BLOCK + 1}, f"a block of {BLOCK + 1} frames is more than the {BLOCK} of"),
        ({"run": lambda self: 1 / 0}, r"^mine: .* failed: ZeroDivisionError: .*test_functions.py:"),
    ],
    ids=lambda v: next(iter(v)) if isinstance(v, dict) else "",
)
def test_a_slip_in_a_sink_of_ones_own_is_named(slip, says):
    """And writes no sample beyond its buffers."""
    sink = type("Mine", (Slips,), slip)(Scene({"y": constant(0.5)}), 1.0, realtime=False)
    refused(SinkError, says, servers.played, sink, 1.0, patience=60, fs=FS)
