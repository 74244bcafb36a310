"""Markers out and motion in, over loopback: real sockets, a pseudo terminal, LSL."""

import importlib
import json
import math
import os
import socket
import threading
import time
from contextlib import contextmanager, nullcontext
from functools import partial
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from commands import ran, refuses
from devices.servers import Seen, begun, played, until
from pythonosc import osc_packet
from refusals import refused

from stimlib import BadValue, Input, MotionError, Scene, SinkError, UnknownName, constant
from stimlib.blocks import burst, every
from stimlib.cli.motions import streamed
from stimlib.devices import (
    NullSink,
    Stream,
    byte_markers,
    lsl_markers,
    osc_markers,
    parallel_markers,
    receiver,
    sender,
    serial_markers,
    transports,
    udp_markers,
    udp_motion,
)
from stimlib.devices.markers import Clock, Marker, Markers
from stimlib.files import read_log, replay

FS = 8000
SCENE = Scene(
    {"force": constant(2.0, "N") * burst(every(0.05), 0.02), "onset": burst(every(0.05), 0.005)}
)
LIMITS = {"force": 2.0, "onset": 1.0}
SPRING = Scene({"force": constant(100.0, "N/m") * Input("x", "m")})
ONSETS = [400 * k for k in range(6)]


def marking(send, *, scene=SCENE, clocked=False, **options):
    """A sink with the output ``onset`` as markers."""
    told = {"clocked": clocked, "realtime": False, "markers": ["onset"], "send": send}
    return NullSink(scene, LIMITS, **told | options)


def marked(send, seconds=0.3, **options):
    """Play so, with the markers on no channel."""
    return played(marking(send, **options), seconds, channels=["force"])


@contextmanager
def bound():
    """A socket, and its port."""
    with socket.socket(type=socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", 0))
        there.settimeout(30)
        yield there, there.getsockname()[1]


@contextmanager
def line():
    """Both ends of a serial line: a descriptor, and the name of a port."""
    pty, tty = pytest.importorskip("pty"), pytest.importorskip("tty")
    here, port = pty.openpty()
    tty.setraw(port)
    yield here, os.ttyname(port)
    os.close(here)
    os.close(port)


# Markers ------------------------------------------------------------------------------
def test_a_marker_is_the_sample_at_which_its_output_rises(tmp_path):
    """To half or more, and once."""
    x = np.array([0.49, 0.5, 0.6, 0.4, 0.49, 0.9, 0.0, 0.5, *np.zeros(100)])
    got, level = [], Input("x")
    scene = Scene({"onset": 1 * level, "force": constant(1.0, "N") * level})
    motion, place = {"x": x}, tmp_path / "a.stimlog"
    report = marked(got.append, None, scene=scene, motion=motion, log=place).report()
    assert [(m.name, m.sample, m.value) for m in got] == [("onset", at, x[at]) for at in (1, 5, 7)]
    assert (report.markers, report.lost_markers) == (3, 0) and not any(m.lost for m in got)
    assert "3 markers, 0 lost" in str(report)
    log = read_log(place)
    assert [e.at for e in log.events if e.kind == "mark"] == [1, 5, 7]
    assert "0 lost" in str(replay(log))


def test_marks_from_outside_are_told_in_the_order_of_samples():
    got = []
    with begun(NullSink(SCENE, LIMITS, clocked=False, send=[got.append])) as s:
        s.mark("late", 3.0, sample=1500)
        s.mark("early", sample=np.int64(100))
        for says, *given in (
            *(("sample = .* a whole", "x", 1.0, at) for at in (-1, 1.5, float("nan"), True, "1")),
            ("must be finite", "x", float("nan")),
            *(("name = .* at most 256", name) for name in ("a\0b", "a\n", "\ud800", "x" * 257, 5)),
        ):
            refused(BadValue, says, s.mark, *given)
        until(lambda: s.pump.index > 1600)
        s.mark("now")
    assert [(m.name, m.value, m.sample) for m in got[:2]] == [("early", 1, 100), ("late", 3, 1500)]
    assert got[2].name == "now" and got[2].sample > 1500 and type(got[0].sample) is int


def test_a_marker_that_the_session_does_not_reach_is_not_sent():
    """Such as the second stimulus of a trial that was stopped in the first."""
    got = []
    with begun(NullSink(SCENE, LIMITS, realtime=False, send=got.append), block=64) as s:
        s.mark("first", sample=100)
        s.mark("second", sample=10**6)
        until(lambda: s.pump.index > 200)
        s.stop()
        s.mark("end")
    ours = [(m.name, m.sample) for m in got if m.name != "onset"]
    assert ours == [("first", 100), ("end", s.pump.index)]
    assert s.report().markers == len(got)


def test_a_marker_in_what_the_device_skipped_is_lost():
    got = []
    with begun(marking(got.append, clocked=True), 0.6, channels=["force"], block=64) as sink:
        until(lambda: sink.pump.index > 400)
        sink.pump.write("STALL", 150_000)  # us: it misses 1200 samples, and three onsets
        sink.wait()
    report = sink.report()
    assert report.lost > 800 and [m.sample for m in got] == [400 * k for k in range(12)]
    assert report.lost_markers == sum(m.lost for m in got) >= 2
    markers = Markers(1000.0, [], lambda *a, **k: None)
    markers.clock.add(0, 0)
    markers.gap(100, 50)
    for sample in (99, 100, 149, 150):
        markers.add(sample, "m", 1.0)
    assert [m.lost for m in markers.due(200, lambda: 0.0)] == [False, True, True, False]
    assert markers.due(10**9, lambda: 0.0) == []


def test_the_time_of_a_sample_is_told_before_and_after_with_its_marker():
    got = []
    sink = marking(got.append, clocked=True)
    refused(SinkError, "time_of: start the sink first", sink.time_of, 0)
    with begun(sink, 1.0, channels=["force"], block=64):
        until(lambda: sink.pump.index > 2400)
        told = {400 * k: sink.time_of(400 * k) for k in range(20)}
        assert told[7600][0] > time.monotonic() > told[400][0] or sink.report().lost
        sink.wait()
    assert len(got) == 20 and all(0 <= m.uncertainty < 0.02 for m in got)
    for m in got:
        at, uncertainty = told[m.sample]
        assert abs(m.time - at) < uncertainty + m.uncertainty + 2e-3
    assert abs(sink.time_of(400)[0] - told[400][0]) < 5e-3  # closed
    assert np.ptp([m.time - m.sample / FS for m in got[8:]]) < 1e-3


@pytest.mark.parametrize("drift", [0.0, 50e-6])
def test_the_clock_is_fitted_below_late_calls(drift):
    """Blocks of 64 of a device that runs fast, called 20 us to 2 ms late."""
    rng, clock = np.random.default_rng(1), Clock(8000.0)
    for k in range(3000):
        true = 1e18 + 1e9 * 64 * k / 8000 * (1 - drift)
        clock.add(64 * k, int(true + 2e4 + rng.exponential(2e5)))
    for sample in (0, 96_000, 191_936):
        at, uncertainty = clock.time(sample)
        assert abs(at - 1e9 - sample / 8000 * (1 - drift)) < 1e-4 < uncertainty < 2e-3
    assert np.isnan(Clock(8000.0).time(0)).all()
    late = Clock(1000.0)  # the first call is 30 ms late, the others are not
    for k in range(200):
        late.add(5000 + 10 * k, 10**9 + 10**7 * k + (30_000_000 if k == 0 else 0))
    at, uncertainty = late.time(6000)
    assert at == pytest.approx(2.0, abs=1e-9) and uncertainty < 1e-9
    few = Clock(8000.0)
    few.add(0, 0)
    few.add(0, -(10**6))  # of the same block
    assert few.time(8000) == (1.0, 2e-3)


def test_who_takes_markers_and_fails_or_is_slow_ends_the_session(tmp_path):
    """A slow one holds up nothing; they are counted, and all of them are in the log."""

    def broken(marker):
        raise OSError("unplugged")

    sink = marking(broken, clocked=True)
    refused(SinkError, "marker could not be sent: .*unplugged", played, sink, 60.0)
    assert sink.report().produced < 30 * FS
    sent, enough = [], threading.Event()
    slow = marking(lambda m: (sent.append(m), enough.wait(60)), log=tmp_path / "l")
    refused(SinkError, "20 of 20 markers not sent", played, slow, 1.0)
    report = slow.report()
    assert (len(sent), report.markers, report.unsent_markers) == (1, 20, 20)
    assert "20 markers, 0 lost, 20 not sent" in str(report)
    log = read_log(tmp_path / "l")
    assert log.report["unsent_markers"] == 20 == sum(e.kind == "mark" for e in log.events)
    enough.set()


# Each transport: a sender by its text, and what comes of six onsets -------------------
@contextmanager
def udp():
    with bound() as (there, port), sender(f"udp:127.0.0.1:{port}") as send:

        def heard():
            got = [json.loads(there.recv(1000)) for _ in range(6)]
            assert got[0].keys() == {"name", "value", "sample", "time", "uncertainty", "lost"}
            return [(m["name"], m["value"], m["sample"]) for m in got]

        yield send, heard


@contextmanager
def osc():
    def received(there):
        (told,) = osc_packet.OscPacket(there.recv(1000)).messages
        return told.message

    with bound() as (there, port), sender(f"osc:127.0.0.1:{port}") as send:
        with osc_markers("127.0.0.1", port, address="/lab/onset") as other:
            for name in ("", "a", "abc", "abcd", "\xe9" * 256):
                other(Marker(name, -0.1, 2**40, 0.1, 1e-3, True))
                message = received(there)
                assert message.params == [name, -0.1, 2**40, 0.1, 1e-3, True]
            assert message.address == "/lab/onset"

        def heard():
            got = [received(there) for _ in range(6)]
            assert {m.address for m in got} == {"/stimlib/marker"} and got[0].params[5] is False
            return [tuple(m.params[:3]) for m in got]

        yield send, heard


@contextmanager
def serial(width="", ends=()):
    """A byte for each, which returns to 0 where it has a width."""
    with line() as (here, port), sender(f"serial:{port}:other=9, onset=7{width}") as send:

        def heard():
            assert taken(here, 6 * len([7, *ends])) == bytes([7, *ends] * 6)

        yield send, heard
        refused(BadValue, "from 0 to 255", serial_markers, port, {"onset": 256})


class Port:
    """A parallel port whose lines another process could read at the end of a pty."""

    def __init__(self, monkeypatch, port):
        self.port, self.asked, self.lines = port, [], []
        monkeypatch.setattr(transports, "control", self.control)

    def control(self, port, request, data=b""):
        if request == transports.DATA:
            self.lines.append((time.monotonic(), data[0]))
            assert os.write(port, data) == 1
        else:
            self.asked.append((request, data))


def taken(end, count):
    """So many bytes, however many at once."""
    found = b""
    while len(found) < count:
        found += os.read(end, count - len(found))
    return found


def test_a_byte_returns_to_zero_on_a_parallel_port(monkeypatch):
    """Each pulse and each 0 lasts as stated or longer, however near the markers."""
    with line() as (here, port):
        known = Port(monkeypatch, port)
        with sender(f"parallel:{port}:onset=7, other=8:width=0.01") as send:
            for k in range(20):
                send(Marker(("onset", "none", "other")[k % 3], 1.0, k, 0.0, 0.0))
        assert taken(here, 28) == bytes([0] + [7, 0, 8, 0] * 6 + [7, 0, 0])
    assert known.asked == [(0x708B, b""), (0x40047090, bytes(4)), (0x708C, b"")]
    at, _ = np.array(known.lines[1:-1]).T
    assert 0.01 <= np.diff(at).min() < 0.02  # the shortest of fifty, whatever the load
    with line() as (here, port):
        usual = Port(monkeypatch, port)
        with sender(f"parallel:{port}:onset=7") as send:  # for 5 ms
            for k in range(9):
                send(Marker("onset", 1.0, k, 0.0, 0.0))
    assert 0.005 <= np.diff([at for at, _ in usual.lines[1:-1]]).min() < 0.01
    assert transports.DATA == 0x40017086  # as <linux/ppdev.h> has it


def test_a_port_that_is_refused_is_closed_again(monkeypatch):
    held = []

    def busy(port, request, data=b""):
        held.append(port)
        raise OSError("it is claimed")

    monkeypatch.setattr(transports, "control", busy)
    says = f"{os.devnull} cannot be opened: it is claimed"
    refused(SinkError, says, parallel_markers, os.devnull, {"onset": 1})
    refused(OSError, "Bad file descriptor", os.fstat, held[0])


def test_a_byte_waits_for_the_time_of_its_sample():
    lines, at = [], time.monotonic() + 0.1
    for due in (at, at + 9.0):  # of a rehearsal without a clock: at once
        byte_markers(lambda b: lines.append((b, time.monotonic())), {"a": 1}, 0.002)(
            Marker("a", 1.0, 0, due, 0.0)
        )
    assert [byte for byte, _ in lines] == [1, 0, 1, 0]
    assert lines[0][1] >= at and lines[2][1] < at + 5.0


@contextmanager
def lsl(numeric=False):
    pylsl = pytest.importorskip("pylsl")
    name = f"stimlib test {os.getpid()} {numeric}"
    with lsl_markers(name, numeric) if numeric else sender(f"lsl:{name}") as send:
        (found,) = pylsl.resolve_byprop("name", name, timeout=60.0)
        inlet = pylsl.StreamInlet(found)
        inlet.open_stream(timeout=60.0)
        ahead = pylsl.local_clock() - time.monotonic()

        def heard(got):
            rows = [inlet.pull_sample(timeout=60.0) for _ in range(6)]
            assert [row[0] for row, _ in rows] == [m.value if numeric else "onset" for m in got]
            assert [at - ahead for _, at in rows] == pytest.approx([m.time for m in got], abs=1e-3)

        yield send, heard


@pytest.mark.parametrize(
    "wire", [udp, osc, serial, lambda: serial(":width=0.005", [0]), lsl, lambda: lsl(True)]
)
def test_markers_come_out_at_the_other_end(wire):
    """Each of them, though a byte takes 5 ms and they come all at once."""
    got = []
    with wire() as (send, heard):
        assert marked([send, got.append]).report().unsent_markers == 0
        came = heard(got) if heard.__code__.co_argcount else heard()
        assert came is None or came == [("onset", m.value, m.sample) for m in got]
    assert [m.sample for m in got] == ONSETS


def test_markers_that_nobody_hears_are_no_error():
    with bound() as (_, nobody):
        pass
    with udp_markers("127.0.0.1", nobody) as send:
        assert marked(send).report().markers == 6


def test_play_follows_the_rows_of_a_tracker_within_limits_and_replays(tmp_path):
    over, log = threading.Event(), tmp_path / "a.stimlog"
    with bound() as (_, port):
        pass

    def tracker():
        """Send 10 and 20 mm, and outliers of 9 m, as (other, x) in mm."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for k in count():
                out.sendto(f"3 {(10, 9000, 20)[k % 3]}".encode(), ("127.0.0.1", port))
                if over.wait(0.002):
                    return

    sends = threading.Thread(target=tracker)
    sends.start()
    words = f"play wall --full-scale 100 --seconds 0.4 --log {log} --stream udp:{port} --sink null"
    said = ran([*words.split(), "--map", "x=1*1e-3", "--limit", "x=-0.1:0.1"]).stdout
    over.set()
    sends.join()
    assert "outside its limits" in said
    assert {0.01, 0.02} <= set(np.fromfile(log / "motion.f64")) <= {0.0, 0.01, 0.02}
    assert read_log(log).seed == 0
    ran(["replay", log])


def test_a_range_may_be_of_all_inputs_that_have_one_number():
    """As --map may be; it was refused."""
    given = SimpleNamespace(keywords={"map_": ["x=0*1e-3"]})
    scene, one = SimpleNamespace(inputs=("x1", "x2")), {"x": (-0.1, 0.1)}
    for limits, wanted in ((one, [0.1, 0.1]), (one | {"x2": (-3, 3)}, [0.1, 3])):
        made = streamed(lambda timeout: ([], []), scene, given, limits, "fade")
        assert [made.limits[name][1] for name in ("x1", "x2")] == wanted
    words = lambda timeout: ([], []), scene, given, {"y": (0, 1)}, "fade"
    refused(UnknownName, None, streamed, *words)


@pytest.mark.parametrize("code", [0, 1.5, "7", None, float("nan")])
def test_a_code_that_is_no_byte_is_refused_before_the_session(code):
    refused(BadValue, "must be from 1 to 255", byte_markers, print, {"a": code}, width=0.01)
    refused(SinkError, "cannot be opened", parallel_markers, "/dev/\0", {"a": 1})


@pytest.mark.parametrize(
    ("text", "column", "scale"),
    [
        ("1", 1, {}),
        ("tip_x*1e-3", "tip_x", {"x": 1e-3}),
        ("'Tip (mm)' * -2", "Tip (mm)", {"x": -2}),
    ],
)
def test_a_number_of_a_row_is_one_by_its_place_or_label(text, column, scale):
    options = partial(int, map_=[f"x={text}"])
    made = streamed(udp_motion, SPRING, options, {"x": (-0.1, 0.1)}, "stop")
    assert (made.columns, made.scale, made.silence) == ({"x": column}, scale, "stop")
    assert made.limits == {"x": (-0.1, 0.1)}


def test_play_does_in_silence_what_is_said(monkeypatch):
    module, given = importlib.import_module("stimlib.cli.play"), []
    monkeypatch.setattr(module, "streamed", lambda *a: given.append(a) or {"x": np.zeros(800)})
    words = "play wall --full-scale 9 --fast --seconds 0.1 --stream udp:0 --map x=0"
    ran(f"{words} --silence hold --limit x=-1:1")
    assert given[0][3:] == ({"x": (-1.0, 1.0)}, "hold")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("wall --stream udp:0", "which number of a row is x? Say --map x=0"),
        ("wall --stream udp:0 --map x=(x-2)*3", "'(x-2)*3'? Say --map x=0"),
        ("wall --stream udp:0 --map x=0 --map z=1", "no input z"),
        ("wall --stream udp:0 --map x=0 --limit x=3", "--limit x=3: write NAME=LOW:HIGH"),
        ("wall --stream udp:0 --motion sinusoid(1,1)", "leave out --motion"),
        ("wall --stream udp:0 --map x=0 --where trial=1", "leave out --motion and --where"),
        ("tone --stream udp:0", "no input: leave it out"),
        ("a.wav --stream udp:0", "leave out --stream"),
        ("wall --silence hold", "are for --stream"),
    ],
)
def test_what_play_cannot_follow_is_said(words, says):
    refuses(f"play {words} --full-scale 9 --fast", says)


def test_commands_send_markers():
    with bound() as (there, port):
        words = ["play", "pulse", "--fast", "--seconds", "0.6", "--marker", "signal", "--send"]
        ran([*words, f"udp:127.0.0.1:{port}", "--full-scale", "1"])
        told = [json.loads(there.recv(1000)) for _ in range(2)]
    assert [(m["name"], m["sample"]) for m in told] == [("signal", 0), ("signal", 4000)]
    ran([*words, "lsl"], 2, "write lsl:NAME")


@pytest.mark.parametrize(
    ("call", "error", "says"),
    [
        (lambda: NullSink(SCENE, LIMITS, markers="onset"), BadValue, "list of outputs"),
        (lambda: NullSink(SCENE, LIMITS, markers=3), BadValue, "markers = 3"),
        (lambda: NullSink(SCENE, LIMITS, markers=["x"]), UnknownName, "there are force, onset"),
        (lambda: NullSink(SCENE, LIMITS, send="lsl"), BadValue, "send = 'lsl'"),
        (lambda: NullSink(SCENE, LIMITS, send=[1]), BadValue, "function of a Marker"),
        (lambda: osc_markers("127.0.0.1", 9, "/a\0b"), BadValue, "osc_markers: address = "),
        (lambda: udp_motion(0, comma=";"), BadValue, "one of separator"),
        (lambda: receiver("udp:0:comma=point"), BadValue, "one of separator, decimal"),
        (lambda: udp_markers("127.0.0.1", 99999), SinkError, "port is a number from 0"),
        (lambda: osc_markers("lab\0pc", 1), SinkError, r"lab.x00pc:1 .* a host is a name"),
        (lambda: udp_markers("no.such.host.invalid", 1), SinkError, "no.such.host.invalid:1"),
        (lambda: osc_markers("no.such.host.invalid", 9000), SinkError, "cannot be sent to"),
        (lambda: udp_motion(99999), SinkError, "port is a number from 0"),
        (lambda: sender("udp:9000"), BadValue, "lsl:NAME, osc:HOST:PORT"),
        (lambda: sender("tcp:127.0.0.1:9000"), BadValue, "send = 'tcp:"),
        (lambda: sender("serial:/dev/ttyUSB0:on"), BadValue, "serial:PORT:onset=1"),
        (lambda: sender("serial:/no/such/port:on=1"), SinkError, "serial_markers: .*opened"),
        (lambda: sender("serial:/dev/x:on=1:width=no"), BadValue, ":width=0.005 for a byte"),
        (lambda: sender("serial:/dev/x:on=1:width=0"), BadValue, "width = 0.0 s must be above"),
        (lambda: sender("serial:/dev/x:on=1:width=2"), BadValue, "width = 2.0 s must be above"),
        (lambda: sender("parallel:/dev/x:on=0"), BadValue, "= 0 must be from 1 to 255"),
        (lambda: sender("parallel:/no/such/port:on=1"), SinkError, "opened: .*modprobe ppdev"),
        (lambda: sender("parallel:/dev/null:on=1"), SinkError, "Inappropriate ioctl.*ppdev"),
        (lambda: receiver("osc:9000"), BadValue, "osc:PORT/ADDRESS"),
        (lambda: receiver("hand"), BadValue, "stream = 'hand'"),
        (lambda: receiver("serial:/no/such/port"), SinkError, "cannot be opened"),
    ],
)
def test_wrong_arguments_are_refused_before_it_plays(call, error, says):
    refused(error, says, call)


# Motion -------------------------------------------------------------------------------
def stream(receive, **how):
    return Stream(receive=receive, columns={"x": 0}, **{"scale": {"x": 1e-3}} | how)


def played_from(made, send=lambda k: None, seconds=0.5, stop=None):
    """Play a spring along a stream while ``send(k)`` sends the row of position k mm;
    the report and the motion.
    """
    log = Seen()
    with begun(NullSink(SPRING, 50.0, motion=made, log=log, realtime=False), seconds, fs=1000) as s:
        k = 0
        while not s.finished and k != stop:
            send(k := k + 1)
            time.sleep(0.002)
        s.wait()
    return s.report(), np.concatenate(log.x, axis=1)[0]


@pytest.mark.parametrize("silence", ["fade", "hold", "stop"])
def test_rows_come_in_their_order_and_silence_fades_holds_or_stops(silence):
    began = time.monotonic()
    with bound() as (there, _), udp_motion(0, timed=True, comma="separator") as receive:

        def send(k):
            row = f"{time.monotonic() - began},{k},{-k}\n" + "garbage\n" * (k % 5 == 0)
            there.sendto(row.encode(), ("127.0.0.1", receive.port))

        assert receive(0.0) == ([], [], [])
        ends = silence == "stop"
        with pytest.raises(SinkError, match="no motion .* 50 ms") if ends else nullcontext():
            report, x = played_from(stream(receive, silence=silence), send, stop=50)
            assert (report.stale > 0) == (silence == "fade")
            k = np.rint(x / 1e-3).astype(int)
            assert np.allclose(x, 1e-3 * k) and (np.diff(k) >= 0).all() and k[-1] > 20
            assert np.gcd.reduce(k) == 1, "the scale is another"
            assert report.rejected.keys() == {"no numbers"} and 0 < report.jitter < 0.5


def from_rows(rows, times, **how):
    """What gives these rows, then none."""
    sent = iter([(rows, times)])

    def receive(timeout):
        return next(sent, None) or (time.sleep(timeout), ([], []))[1]

    return stream(receive, scale={}, **how)


class Settles(NullSink):
    """A device that takes a while until it begins, as PulseAudio does."""

    def _start(self):
        self._let_go.wait(0.3)


@pytest.mark.parametrize("made, ahead", [(NullSink, None), (Settles, None), (NullSink, 0.6)])
def test_a_session_begins_with_the_newest_of_the_rows_that_waited(made, ahead):
    """At a port since it was opened, while the device began or until its time came;
    as one column each, seconds of them moved the hand within milliseconds.
    """
    batches, k, log = iter([range(256), range(256, 356)]), count(356), Seen()

    def receive(timeout):
        rows = next(batches, None)
        if rows is None:
            time.sleep(0.005)
            rows = [next(k)]
        return [[float(row)] for row in rows], [math.nan] * len(rows)

    with made(SPRING, 1e9, motion=stream(receive), log=log, realtime=False) as sink:
        sink.open(1000)
        sink.start(0.3, at=ahead and time.monotonic() + ahead)
        sink.wait()
    x = np.concatenate(log.x, axis=1)[0]
    moves = np.flatnonzero(np.diff(x, prepend=0.0))
    assert x.max() > 0.36 and np.count_nonzero(moves < moves[0] + 30) < 20, x[moves[:30]]


def test_rows_that_are_no_numbers_or_beyond_the_limits_are_rejected():
    """A wild row moves nothing; the sender's clock jumps back by an hour."""
    nan, now = float("nan"), time.monotonic()
    rows = [[0.001], [nan], [], [], [0.002]]
    report, x = played_from(from_rows(rows, [nan] * 5, silence="hold"), seconds=0.2)
    assert (report.rows, report.rejected, x[-1]) == (2, {"not finite": 1, "too short": 2}, 0.002)
    assert "3 rows rejected: 2 too short, 1 not finite (count the numbers" in str(report)
    rows, times = [[0.01], [1e200], [0.02], [-0.5], [0.05]], [now, now, now + 1e-3, now + 2e-3]
    made = from_rows(rows, [*times, now - 3600.0], limits={"x": (0.0, 0.05)}, silence="hold")
    report, x = played_from(made, seconds=0.2)
    assert (report.rows, report.rejected, x[-1]) == (3, {"outside its limits": 2}, 0.05)
    assert report.jitter < 0.1


def test_a_receiver_that_raises_or_brings_nothing_ends_the_session():
    def broken(timeout):
        raise OSError("unplugged")

    refused(SinkError, "stream failed: .*unplugged", played_from, stream(broken), seconds=5.0)
    refused(MotionError, "no row came", played_from, from_rows([], []), seconds=0.1)
    with NullSink(SPRING, 50.0, motion=from_rows([], [])) as sink:
        sink.open(FS)
        refused(SinkError, "motion=Live", sink.push, np.zeros((1, 1)))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"receive": None}, "receive must be a function"),
        ({"silence": "shout"}, "one of fade, hold, stop"),
        ({"columns": {"x": -1}}, "whole number"),
        ({"columns": {"x": True}}, "whole number or a text"),
        ({"columns": {"x": 0.5}}, "whole number or a text"),
        ({"columns": {"y": 0}}, "x is missing"),
        ({"scale": {"y": 1.0}}, "no column y"),
        *(({"scale": {"x": v}}, "finite number, not 0") for v in (0.0, math.nan, -math.inf, "1")),
        ({"limits": {"y": (0, 1)}}, "y"),
        ({"limits": {"x": (1.0, 1.0)}}, "limits"),
    ],
)
def test_bad_streams(change, says):
    with pytest.raises((BadValue, UnknownName), match=says):
        made = Stream(**{"receive": lambda timeout: ([], []), "columns": {"x": 0}} | change)
        NullSink(SPRING, 50.0, motion=made)
