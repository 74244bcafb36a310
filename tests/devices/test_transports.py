"""Markers out and motion in, over loopback: real sockets, a pseudo terminal, LSL."""

import json
import math
import os
import pty
import socket
import struct
import threading
import time
import tty
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from commands import ran
from devices.servers import Seen, begun, played
from pythonosc import osc_message_builder, osc_packet
from typer.testing import CliRunner

import stimlib
from stimlib import BadValue, Input, MotionError, Scene, SinkError, UnknownName, constant
from stimlib.blocks import burst, every
from stimlib.cli.app import app
from stimlib.devices import (
    NullSink,
    Stream,
    lsl_markers,
    lsl_motion,
    lsl_streams,
    osc_markers,
    osc_motion,
    receiver,
    sender,
    serial_markers,
    serial_motion,
    udp_markers,
    udp_motion,
)
from stimlib.devices.markers import Clock, Marker, Markers
from stimlib.files import read_log, replay

FS = 8000
EVENTS = every(0.05)
SCENE = Scene({"force": constant(2.0, "N") * burst(EVENTS, 0.02), "onset": burst(EVENTS, 0.005)})
SPRING = Scene({"force": constant(100.0, "N/m") * Input("x", "m")})


@pytest.fixture
def using():
    """Enter a transport until the test is over."""
    with ExitStack() as stack:
        yield stack.enter_context


def marked(send, seconds=0.3, *, clocked=False, scene=SCENE, channels=("force",), **options):
    """Play with the output ``onset`` as markers, which is on no channel."""
    scales = {"force": 2.0, "onset": 1.0}
    sink = NullSink(
        scene, scales, clocked=clocked, realtime=False, markers=["onset"], send=send, **options
    )
    return played(sink, seconds, channels=channels)


def datagrams(there):
    there.settimeout(1.0)
    found = []
    try:
        while True:
            found.append(there.recv(65536))
            there.settimeout(0.2)
    except TimeoutError:
        return found


@pytest.fixture
def there():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        yield s


@pytest.fixture
def line():
    """Both ends of a serial line: a descriptor, and the name of a port."""
    pty, tty = pytest.importorskip("pty"), pytest.importorskip("tty")
    here, port = pty.openpty()
    tty.setraw(port)
    yield here, os.ttyname(port)
    os.close(here)
    os.close(port)


def test_a_marker_is_the_sample_at_which_its_output_rises(tmp_path):
    got = []
    sink = marked(got.append, log=tmp_path / "a.stimlog")
    assert [(m.name, m.sample, m.lost) for m in got] == [
        ("onset", 400 * k, False) for k in range(6)
    ]
    first = stimlib.render(SCENE, fs=FS, seconds=0.3)["onset"]
    assert [m.value for m in got] == [first[m.sample] for m in got]
    assert (sink.report().markers, sink.report().lost_markers) == (6, 0)
    assert "6 markers, 0 lost" in str(sink.report())
    log = read_log(tmp_path / "a.stimlog")
    assert [e.at for e in log.events if e.kind == "mark"] == [m.sample for m in got]
    assert "0 lost" in str(replay(log))


def test_the_rise_is_at_half_and_once():
    level = Input("x")
    x = np.array([0.49, 0.5, 0.6, 0.4, 0.49, 0.9, 0.0, 0.5, *np.zeros(100)])
    got = []
    scene = Scene({"onset": 1 * level, "force": constant(1.0, "N") * level})
    marked(got.append, None, scene=scene, motion={"x": x}, channels=["force"])
    assert [(m.sample, m.value) for m in got] == [(1, 0.5), (5, 0.9), (7, 0.5)]


def test_marks_from_outside_are_told_in_the_order_of_samples():
    got = []
    with begun(
        NullSink(SCENE, {"force": 2.0, "onset": 1.0}, clocked=False, send=[got.append])
    ) as s:
        s.mark("late", 3.0, sample=1500)
        s.mark("early", sample=100)
        with pytest.raises(BadValue, match="sample = -1 must be 0"):
            s.mark("x", sample=-1)
        with pytest.raises(BadValue, match="must be finite"):
            s.mark("x", float("nan"))
        for name in ("a\0b", "a\n", "\ud800", "x" * 257, 5):
            with pytest.raises(BadValue, match="mark: name = .* at most 256 characters"):
                s.mark(name)
        time.sleep(0.1)
        s.mark("now")
    assert [(m.name, m.value, m.sample) for m in got[:2]] == [("early", 1, 100), ("late", 3, 1500)]
    assert got[2].name == "now" and got[2].sample > 1500
    with pytest.raises(SinkError, match="start the sink first"):
        NullSink(SCENE, {"force": 2.0, "onset": 1.0}).mark("x")


LIMITS = {"force": 2.0, "onset": 1.0}


@pytest.mark.parametrize(
    ("call", "error", "says"),
    [
        (lambda: NullSink(SCENE, LIMITS, markers="onset"), BadValue, "a list of outputs"),
        (lambda: NullSink(SCENE, LIMITS, markers=3), BadValue, "markers = 3 must be a list"),
        (lambda: NullSink(SCENE, LIMITS, send="lsl"), BadValue, "send = 'lsl' must be a function"),
        (lambda: NullSink(SCENE, LIMITS, send=[1]), BadValue, "must be a function of a Marker"),
        (lambda: osc_markers("127.0.0.1", 9, "/a\0b"), BadValue, "osc_markers: address = "),
        (lambda: udp_motion(0, comma=";"), BadValue, "comma = ';' must be one of separator"),
        (lambda: receiver("udp:0:comma=point"), BadValue, "must be one of separator, decimal"),
        (lambda: udp_markers("127.0.0.1", 99999), SinkError, "a port is a number from 0"),
        (lambda: osc_markers("no.such.host.invalid", 9000), SinkError, "cannot be sent to"),
        (lambda: udp_motion(99999), SinkError, "a port is a number from 0"),
        (lambda: sender("udp:9000"), BadValue, "write lsl:NAME, osc:HOST:PORT"),
        (lambda: sender("tcp:127.0.0.1:9000"), BadValue, "send = 'tcp:"),
        (lambda: sender("serial:/dev/ttyUSB0:on"), BadValue, "serial:PORT:onset=1"),
        (lambda: sender("serial:/no/such/port:on=1"), SinkError, "cannot be opened"),
        (lambda: receiver("osc:9000"), BadValue, "osc:PORT/ADDRESS"),
        (lambda: receiver("hand"), BadValue, "stream = 'hand'"),
        (lambda: receiver("serial:/no/such/port"), SinkError, "cannot be opened"),
    ],
)
def test_wrong_arguments_are_refused_before_it_plays(call, error, says):
    with pytest.raises(error, match=says):
        call()


def test_texts_name_senders_and_receivers():
    """A marker by each text comes to a receiver of the same kind."""
    marker = Marker("onset", 1.0, 5, 0.1, 1e-3)
    with receiver("udp:0") as receive, socket.socket(type=socket.SOCK_DGRAM) as there:
        assert receive(0.0) == ([], [], [])
        there.bind(("127.0.0.1", 0))
        there.settimeout(5)
        with sender(f"udp:127.0.0.1:{there.getsockname()[1]}") as send:
            send(marker)
            assert json.loads(there.recv(1000))["sample"] == 5
        with sender(f"osc:127.0.0.1:{there.getsockname()[1]}") as send:
            send(replace(marker, value=0.1))
            data = there.recv(1000)
            assert data.startswith(b"/stimlib/marker") and struct.pack(">d", 0.1) in data
    fd, port = pty.openpty()
    tty.setraw(port)
    with sender(f"serial:{os.ttyname(port)}:trial=1, onset=7") as send:
        send(marker)
        assert os.read(fd, 10) == b"\x07"
    with receiver(f"serial:{os.ttyname(port)}") as receive:
        os.write(
            fd,
            b"the line in which it was opened\n1.5 2.5\n0.123456789 0.987654321 -12345.678901234\n",
        )
        rows = receive(5.0)[0]
        assert rows == [[1.5, 2.5], [0.123456789, 0.987654321, -12345.678901234]]
    os.close(fd), os.close(port)


def test_commands_send_markers(tmp_path):
    with socket.socket(type=socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", 0))
        there.settimeout(5)
        to = f"udp:127.0.0.1:{there.getsockname()[1]}"
        words = ["play", "pulse", "--fast", "--seconds", "0.6", "--marker", "signal", "--send", to]
        ran([*words, "--full-scale", "1"])
        told = [json.loads(there.recv(1000)) for _ in range(2)]
        assert [(m["name"], m["sample"]) for m in told] == [("signal", 0), ("signal", 4000)]
    ran([*words[:-1], "lsl"], 2, "write lsl:NAME")


def test_an_unknown_output_is_refused():
    with pytest.raises(UnknownName, match="markers: no output 'x'; the outputs are force, onset"):
        NullSink(SCENE, {"force": 2.0, "onset": 1.0}, markers=["x"])


def test_a_marker_in_what_the_device_skipped_is_lost(tmp_path):
    got = []
    sink = NullSink(
        SCENE, {"force": 2.0, "onset": 1.0}, realtime=False, markers=["onset"], send=got.append
    )
    with begun(sink, 0.6, channels=["force"], block=64):
        time.sleep(0.15)
        sink.pump.write("STALL", 150_000)  # us: it misses 1200 samples, and three onsets
        sink.wait()
    report = sink.report()
    assert report.lost > 800 and [m.sample for m in got] == [400 * k for k in range(12)]
    assert report.lost_markers == sum(m.lost for m in got) >= 2


def test_the_time_of_a_marker_is_that_of_its_sample():
    got = []
    marked(got.append, 1.0, clocked=True)
    times = np.array([m.time - m.sample / FS for m in got[8:]])
    assert np.ptp(times) < 1e-3 and all(0 <= m.uncertainty < 0.02 for m in got)
    assert abs(times[0] + 1.0 - time.monotonic()) < 1.0


def test_the_time_of_a_sample_to_come_is_that_of_its_marker():
    got = []
    sink = NullSink(
        SCENE, {"force": 2.0, "onset": 1.0}, realtime=False, markers=["onset"], send=got.append
    )
    with pytest.raises(SinkError, match="time_of: start the sink first"):
        sink.time_of(0)
    with begun(sink, 1.0, channels=["force"], block=64):
        time.sleep(0.3)
        told = {400 * k: sink.time_of(400 * k) for k in range(20)}
        assert told[7600][0] > time.monotonic() > told[400][0]
        sink.wait()
    assert len(got) == 20
    for m in got:
        at, uncertainty = told[m.sample]
        assert abs(m.time - at) < uncertainty + m.uncertainty + 2e-3
    assert abs(sink.time_of(400)[0] - told[400][0]) < 5e-3  # closed


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
    assert few.time(8000) == (1.0, 2e-3)


def test_who_takes_markers_and_fails_ends_the_session():
    def broken(marker):
        raise OSError("unplugged")

    sink = NullSink(SCENE, {"force": 2.0, "onset": 1.0}, markers=["onset"], send=broken)
    with pytest.raises(SinkError, match="a marker could not be sent: .*unplugged"):
        played(sink, 5.0)
    assert sink.report().produced < 4 * FS


def test_markers_over_udp(there, using):
    marked(using(udp_markers(*there.getsockname())))
    got = [json.loads(d) for d in datagrams(there)]
    assert [m["sample"] for m in got] == [400 * k for k in range(6)]
    assert got[0].keys() == {"name", "value", "sample", "time", "uncertainty", "lost"}


def test_markers_over_udp_that_nobody_hears_are_no_error(using):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        nobody = s.getsockname()
    assert marked(using(udp_markers(*nobody))).report().markers == 6
    with pytest.raises(SinkError, match="udp_markers: no.such.host.invalid:1"):
        udp_markers("no.such.host.invalid", 1)


def test_markers_over_osc(there, using):
    send = using(osc_markers(*there.getsockname(), address="/lab/onset"))
    for name in ("", "a", "abc", "abcd", "\xe9" * 256):
        send(Marker(name, -0.1, 2**40, 0.1, 1e-3, True))
        (message,) = osc_packet.OscPacket(there.recv(1000)).messages
        assert message.message.params == [name, -0.1, 2**40, 0.1, 1e-3, True]
    marked(send)
    got = [osc_packet.OscPacket(d).messages[0].message for d in datagrams(there)]
    assert {m.address for m in got} == {"/lab/onset"}
    assert [m.params[:3] for m in got] == [
        ["onset", pytest.approx(0.0062, abs=1), 400 * k] for k in range(6)
    ]
    assert [len(m.params) for m in got] == [6] * 6 and got[0].params[5] is False


def test_markers_as_bytes_on_a_serial_line(line, using):
    here, port = line
    marked(using(serial_markers(port, {"onset": 7, "other": 9})))
    assert os.read(here, 100) == bytes([7] * 6)
    with pytest.raises(BadValue, match="must be from 0 to 255"):
        serial_markers(port, {"onset": 256})
    with pytest.raises(SinkError, match="serial_markers: /dev/nothing cannot be opened"):
        serial_markers("/dev/nothing", {})


@pytest.mark.parametrize("numeric", [False, True])
def test_markers_over_lsl(numeric, using):
    pylsl = pytest.importorskip("pylsl")
    name = f"stimlib test {os.getpid()} {numeric}"
    send = using(lsl_markers(name, numeric))
    (found,) = pylsl.resolve_byprop("name", name, timeout=20.0)
    inlet = pylsl.StreamInlet(found)
    inlet.open_stream(timeout=20.0)
    ahead = pylsl.local_clock() - time.monotonic()
    got = []
    marked([send, got.append])
    seen = []
    while len(seen) < 6 and (row := inlet.pull_sample(timeout=5.0))[0] is not None:
        seen.append(row)
    assert [row[0] for row, _ in seen] == [m.value if numeric else "onset" for m in got]
    assert [at - ahead for _, at in seen] == pytest.approx([m.time for m in got], abs=1e-3)


# motion -------------------------------------------------------------------------------
def played_from(stream, send, seconds=0.5, fs=1000, until=None):
    """Play a spring along a stream while ``send(k)`` sends the row of position k mm."""
    log = Seen()
    sink = NullSink(SPRING, 50.0, motion=stream, log=log, realtime=False)
    with begun(sink, seconds, fs=fs):
        k = 0
        while not sink.finished and k != until:
            send(k := k + 1)
            time.sleep(0.002)
        sink.wait()
    x = np.concatenate(log.x, axis=1)[0]
    return sink.report(), x


def heard(x, scale=1e-3):
    """The rows were taken in their order, and each that was is a position sent."""
    k = x / scale
    assert np.allclose(k, np.rint(k)) and (np.diff(k) >= 0).all() and k[-1] > 20
    assert np.gcd.reduce(np.rint(k).astype(int)) == 1, "the scale is another"


def test_motion_over_udp(there, using):
    receive = using(udp_motion(0, timed=True, comma="separator"))
    began = time.monotonic()

    def send(k):
        row = f"{time.monotonic() - began},{k},{-k}\n" + ("garbage\n\xff" if k % 5 == 0 else "")
        there.sendto(row.encode("latin-1"), ("127.0.0.1", receive.port))

    report, x = played_from(Stream(receive=receive, columns={"x": 0}, scale={"x": 1e-3}), send)
    heard(x)
    assert report.rows > 50 and 0 < report.jitter < 0.5
    assert report.rejected == {"no numbers": 2 * (report.rejected["no numbers"] // 2)}
    assert f"{report.rejected['no numbers']} rows rejected: " in str(report)
    assert receive.close is not None


def test_motion_over_osc(there, using):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    receive = using(osc_motion(port, "/hand"))

    def send(k):
        for address, values in (("/hand", [0.0, float(k)]), ("/other", [1.0, 1e9])):
            message = osc_message_builder.OscMessageBuilder(address=address)
            for v in values:
                message.add_arg(v)
            there.sendto(message.build().dgram, ("127.0.0.1", port))
        for data in (b"no osc at all", b"/hand\0\0\0,f\xff\0\0\0\0\0"):  # in no UTF-8
            there.sendto(data, ("127.0.0.1", port))

    report, x = played_from(Stream(receive=receive, columns={"x": 1}, scale={"x": 1e-3}), send)
    heard(x)
    assert report.rows > 50 and report.jitter == 0.0
    assert set(report.rejected) == {"another address", "no OSC"}
    assert abs(report.rows - report.rejected["another address"]) <= 1


def test_motion_over_a_serial_line(line, using):
    here, port = line
    receive = using(serial_motion(port))

    def send(k):
        os.write(here, f"{k}\n".encode() if k % 2 else f"{k}".encode()[:1] + b"x\n")

    report, x = played_from(Stream(receive=receive, columns={"x": 0}, scale={"x": 1e-3}), send)
    heard(x)
    assert report.rows > 25


def test_motion_over_lsl(using):
    pylsl = pytest.importorskip("pylsl")
    name = f"stimlib hand {os.getpid()}"
    info = pylsl.StreamInfo(name, "MoCap", 2, 500.0, "double64", name)
    outlet = pylsl.StreamOutlet(info)
    assert (name, "MoCap", 2, 500.0) in [
        (s["name"], s["type"], s["channels"], s["fs"]) for s in lsl_streams()
    ]
    done = CliRunner().invoke(app, ["devices", "--streams"])
    assert f"{name} (MoCap) of " in done.stdout and "2 channels, 500 Hz" in done.stdout
    receive = using(lsl_motion(name))
    report, x = played_from(
        Stream(receive=receive, columns={"x": 1}, scale={"x": 1e-3}),
        lambda k: outlet.push_sample([0.0, float(k)]),
    )
    heard(x)
    assert report.rows > 50 and 0 < report.jitter < 0.5
    with pytest.raises(SinkError, match="no stream 'nobody of this name' appeared"):
        lsl_motion("nobody of this name", wait=0.1)


@pytest.mark.parametrize("silence", ["fade", "hold", "stop"])
def test_silence_fades_holds_or_stops(silence, there, using):
    receive = using(udp_motion(0))
    stream = Stream(receive=receive, columns={"x": 0}, scale={"x": 1e-3}, silence=silence)

    def send(k):
        there.sendto(f"{k}".encode(), ("127.0.0.1", receive.port))

    if silence == "stop":
        with pytest.raises(SinkError, match="no motion has come for 50 ms"):
            played_from(stream, send, until=50)
    else:
        report, _ = played_from(stream, send, until=50)
        assert (report.stale > 0) == (silence == "fade")


def test_rows_that_are_no_numbers_are_rejected():
    rows = iter([([[0.001], [float("nan")], [], [], [0.002]], [float("nan")] * 5)])
    stream = Stream(
        receive=lambda timeout: next(rows, None) or (time.sleep(timeout), ([], []))[1],
        columns={"x": 0},
        silence="hold",
    )
    report, x = played_from(stream, lambda k: None, seconds=0.2)
    assert (report.rows, report.rejected, x[-1]) == (2, {"not finite": 1, "too short": 2}, 0.002)
    assert "3 rows rejected: 2 too short, 1 not finite (count the numbers" in str(report)


def test_a_receiver_that_raises_or_hangs_ends_the_session():
    def broken(timeout):
        raise OSError("unplugged")

    with pytest.raises(SinkError, match="the stream failed: .*unplugged"):
        played_from(Stream(receive=broken, columns={"x": 0}), lambda k: None, seconds=5.0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"receive": None}, "receive must be a function"),
        ({"silence": "shout"}, "choose one of fade, hold, stop"),
        ({"columns": {"x": -1}}, "must be a whole number"),
        ({"columns": {"x": True}}, "a whole number or a text"),
        ({"columns": {"x": 0.5}}, "a whole number or a text"),
        ({"scale": {"y": 1.0}}, "there is no column y"),
        ({"columns": {"y": 0}}, "motion: x is missing"),
    ],
)
def test_bad_streams(change, says):
    with pytest.raises((BadValue, UnknownName), match=says):
        stream = Stream(**{"receive": lambda timeout: ([], []), "columns": {"x": 0}} | change)
        NullSink(SPRING, 50.0, motion=stream)


def test_a_stream_is_pushed_by_nobody_else():
    stream = Stream(receive=lambda timeout: (time.sleep(timeout), ([], []))[1], columns={"x": 0})
    with pytest.raises(MotionError, match="no row came"):  # as it is silent
        with begun(NullSink(SPRING, 50.0, motion=stream, realtime=False), 0.1) as sink:
            with pytest.raises(SinkError, match="make the sink with motion=Live"):
                sink.push(np.zeros((1, 1)))
            sink.wait()


def test_gaps_are_remembered_by_samples():
    markers = Markers(1000.0, [], lambda *a, **k: None)
    markers.gap(100, 50)
    for sample in (99, 100, 149, 150):
        markers.add(sample, "m", 1.0)
    assert [m.lost for m in markers.due(200, lambda: 0.0)] == [False, True, True, False]
    assert markers.due(10**9, lambda: 0.0) == []


def test_markers_that_a_slow_sender_has_not_taken_are_an_error(tmp_path):
    """It holds up nothing; they are counted, and all of them are in the log."""
    sent, enough = [], threading.Event()

    def slow(marker):
        sent.append(marker)
        enough.wait(3.0)

    sink = NullSink(SCENE, LIMITS, clocked=False, markers=["onset"], send=slow, log=tmp_path / "l")
    with pytest.raises(SinkError, match="20 of 20 markers were not sent"), sink:
        sink.open(FS, channels=["force"])
        sink.start(1.0)
        sink.wait()
    report = sink.report()
    assert (len(sent), report.markers, report.unsent_markers) == (1, 20, 20)
    assert "20 markers, 0 lost, 20 not sent" in str(report)
    log = read_log(tmp_path / "l")
    assert log.report["unsent_markers"] == 20
    assert sum(e.kind == "mark" for e in log.events) == 20
    enough.set()


def test_rows_beyond_the_limits_move_nothing_and_clocks_may_be_set():
    """A wild row is rejected; the sender's clock jumps back by an hour."""
    now, rows = time.monotonic(), [[0.01], [1e200], [0.02], [-0.5], [0.05]]
    sent = iter([(rows, [now, now, now + 0.001, now + 0.002, now - 3600.0])])
    hand = Stream(
        receive=lambda timeout: next(sent, ([], [])), columns={"x": 0}, limits={"x": (0.0, 0.05)}
    )
    spring = Scene({"force": constant(100.0, "N/m") * Input("x", "m")})
    sink = NullSink(spring, 10.0, motion=hand, realtime=False)
    with begun(sink, 0.3):
        sink.wait()
    report = sink.report()
    assert (report.rows, report.rejected) == (3, {"outside its limits": 2}) and report.jitter < 0.1
    for limits, error in (({"y": (0, 1)}, UnknownName), ({"x": (1.0, 1.0)}, BadValue)):
        with pytest.raises(error):
            Stream(receive=lambda t: ([], []), columns={"x": 0}, limits=limits)
    for factor in (0.0, math.nan, -math.inf, "1e-3"):
        with pytest.raises(BadValue, match="scale.* must be a finite number, not 0"):
            Stream(receive=lambda t: ([], []), columns={"x": 0}, scale={"x": factor})
