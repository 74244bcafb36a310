"""The PortAudio sink on real back ends: a JACK server, PulseAudio, and ALSA's file
without a clock.
"""

import os
import shutil
import signal
import subprocess
import sys

import pytest
from devices.servers import (
    Capture,
    Jackd,
    Pulse,
    Seen,
    begun,
    captured_fades,
    needs_jack,
    played,
    until,
    until_judged,
)
from devices.stands import (
    HAND,
    alsa,
    from_file,
    is_exact,
    needs_portaudio,
    portaudio,
    textured_sink,
)
from refusals import refused

import stimlib
from stimlib import BadValue, Scene, SinkError
from stimlib.devices import first_ready
from stimlib.devices.sources import Signal, Signals

STEADY = Scene({"y": stimlib.Param("level", 1.0) * 1})

pytestmark = needs_portaudio()


def sink(scene=STEADY, safety=1.0, **options):
    from stimlib.devices.portaudio import PortAudioSink

    return PortAudioSink(scene, safety, realtime=False, **options)


# ALSA ---------------------------------------------------------------------------------
def to_a_file(folder, fs, channels, block, seconds=1.0):
    with portaudio(alsa(folder)):
        s, log = textured_sink(sink, channels, name="stimfile", clocked=False)
        report = played(s, seconds, fs=fs, channels=channels, block=block).report()
    assert report.produced == report.delivered == seconds * fs
    is_exact(from_file(folder, channels), s, log, seconds)


@pytest.mark.parametrize(
    ("fs", "block", "channels"), [(8000, 64, 1), (48000, 32, 2), (8000, None, 2)]
)
def test_alsa_file_is_exact(tmp_path, fs, block, channels):
    to_a_file(tmp_path, fs, channels, block)


def test_the_first_device_is_that_on_which_it_plays_by_default(tmp_path):
    """Whatever else the system lists before it: ``stimlib play`` names it, and has its
    sample rate.
    """
    environment = alsa(tmp_path)
    with open(tmp_path / ".asoundrc", "a") as f:
        f.write("pcm.!default { type null hint { show on description default } }\n")
    with portaudio(environment) as sd:
        names = [d["name"] for d in sd.query_devices() if d["max_output_channels"]]
        assert names[0] != "default" == sd.query_devices(kind="output")["name"]
        first = first_ready("none_of_this_name")
        assert (first.sink, first.what[:9]) == ("portaudio", "'default'")
        assert sink(name=None)._called(sd) == "device 'default' (ALSA)"


def test_another_sounddevice_is_refused_with_a_reason(tmp_path, monkeypatch):
    import sounddevice

    monkeypatch.delattr(sounddevice, "_StreamBase")
    says = "takes no compiled callback .*_StreamBase.*: pip install"
    refused(SinkError, says, to_a_file, tmp_path, 8000, 1, 64, 0.5)


def test_a_device_that_another_program_holds_is_a_typed_error(tmp_path, monkeypatch):
    """As ALSA says when it is asked for the rate, and when it is to be opened."""
    import sounddevice

    def busy(*given, **named):
        raise sounddevice.PortAudioError("Error: Device unavailable", -9985)

    monkeypatch.setattr(sounddevice, "check_output_settings", busy)
    monkeypatch.setattr(sounddevice._StreamBase, "__init__", busy)
    says = "'stimfile' .* cannot be opened: .*Device unavailable"
    refused(SinkError, says, to_a_file, tmp_path, 8000, 1, 64, 0.5)


# JACK ---------------------------------------------------------------------------------
def on_jack(server):
    return {"JACK_DEFAULT_SERVER": server.name}


def connected(capture, channels):
    """PortAudio's ports go to the capture too."""
    names = [p.name for p in capture.client.get_ports("PortAudio:out_.*")]
    ports = sorted(names, key=lambda name: int(name.split("_")[-1]))
    assert len(ports) == channels
    for port, to in zip(ports, capture.names, strict=True):
        capture.client.connect(port, to)


@needs_jack
def test_what_does_not_fit_the_device():
    with Jackd(8000, 64) as server, portaudio(on_jack(server)):
        for name, fs, channels, says in (
            ("system", 48000, 1, r"'system' \(JACK.*48000 Hz: open\(rate=8000\)"),
            ("system", 8000, 25, "24 channels, fewer than 25"),
            ("nobody", 8000, 1, "no device 'nobody' .*there are 0 'system'"),
            (77, 8000, 1, "no device 77"),
        ):
            refused(SinkError, says, sink(name=name).open, fs, channels)
    refused(BadValue, "no port 'a:b' to connect", sink,
            Scene({"y": 1 * stimlib.Input("x")}), motion=Signals({"x": Signal(1.0, connect="a:b")}),
            )  # fmt: skip


@needs_jack
def test_a_stop_fades_and_a_stall_is_told():
    """Largest step of a steady full scale that comes and goes, at the other end;
    PortAudio tells that frames were lost, not which.
    """
    with Jackd(8000, 64) as server, portaudio(on_jack(server)):

        def take(stall=0):
            with Capture(server.name, 1, 60 * 8000) as capture, sink(name="system") as s:
                s.open(8000)
                connected(capture, 1)
                s.start()
                until(lambda: s.pump.index > 2000)
                s.pump.write("STALL", stall)
                until(lambda: s.pump.index > 8000)
                s.stop()
                until(lambda: capture.frames.any() and not capture.frames[-1].any())
                frames, report = capture.frames.copy(), s.report()
                index = capture.times[: len(frames)] - capture.times[0]
            assert report.produced == report.delivered + report.lost
            if stall:
                assert report.lost > 0.25 * 8000 and report.block_time["max"] >= 0.3
            return (
                stall or not report.underruns and captured_fades(frames, index, [], capture.xruns)
            )

        until_judged(take)
        take(300_000)


@needs_jack
def test_a_position_comes_in_as_a_signal():
    """A JACK sink plays a position to the port that PortAudio reads."""
    from stimlib.devices.jack import JackSink

    position = Scene({"x": 1.0 * stimlib.Input("p", "m")})
    felt = Scene({"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")})
    log, told = Seen(), {"motion": Signals({"x": Signal(0.05)}), "name": "system"}
    with Jackd(8000, 64) as server, portaudio(on_jack(server)):
        out = {"server": server.name, "connect": None, "name": "hand", "realtime": False}
        hand = JackSink(position, 0.05, motion={"p": HAND["x1"]}, **out)
        with begun(sink(felt, 100.0, log=log, **told), channels=2) as s, hand:
            hand.open(8000)
            (port,) = (p.name for p in hand._client.get_ports("PortAudio:in_.*"))
            hand._client.connect("hand:x", port)
            hand.start(1.0)
            hand.wait(60)
    x, force = (max(float(a.max()) for a in rows) for rows in (log.x, log.frames))
    assert x == pytest.approx(0.02, rel=1e-3) and force == pytest.approx(0.4, rel=1e-3)
    assert s.report().delivered + s.report().lost == s.report().produced


# What goes or hangs -------------------------------------------------------------------
PULSE = shutil.which("pulseaudio") and shutil.which("parec")
needs_pulse = pytest.mark.skipif(not PULSE, reason="needs PulseAudio (tests/devices/install.sh)")

ENDS = """
import sys
import stimlib
from stimlib.devices import jack, portaudio

scene = stimlib.Scene({"y": stimlib.constant(1.0)})
if sys.argv[1] == "jack":
    sink = jack.JackSink(scene, 1.0, realtime=False, server=sys.argv[2])
else:
    sink = portaudio.PortAudioSink(scene, 1.0, realtime=False, name=sys.argv[2])
sink.open(8000)
sink.start()
print("playing", flush=True)
sys.stdin.readline()
try:
    sink.wait()
except stimlib.SinkError as e:
    print(e, flush=True)
sink.close()
report = sink.report()
assert report.delivered + report.lost == report.produced
print("closed", flush=True)
"""


def ended(environment, kind, name, end, says):
    """A device that goes or hangs is a typed error, ``close`` comes back, and the
    program ends as it wanted to.
    """
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    words, env = [sys.executable, "-c", ENDS, kind, name], os.environ | environment
    child = subprocess.Popen(words, env=env, text=True, **pipes)
    try:
        assert child.stdout.readline() == "playing\n", child.stderr.read()
        end()
        out, err = child.communicate("go\n")
    finally:
        child.kill()
        child.communicate()
    assert child.returncode == 0, (child.returncode, out, err)
    assert says in out and out.endswith("closed\n") and "Error" not in err, out + err


@needs_pulse
@pytest.mark.parametrize("what", ["hangs", "loses its sink", "ends"])
def test_a_pulseaudio_that_goes_or_hangs_is_a_typed_error(tmp_path, what):
    with Pulse(tmp_path) as server:
        try:
            hang = lambda: server._server.send_signal(signal.SIGSTOP)  # noqa: E731
            ends = {
                "hangs": hang,
                "loses its sink": server.remove_the_sink,
                "ends": server.__exit__,
            }
            says = "has taken no samples for" if what == "hangs" else "still there"
            ended(server.environment, "portaudio", "pulse", ends[what], says)
        finally:
            server._server.send_signal(signal.SIGCONT)


@needs_jack
@pytest.mark.parametrize(
    ("kind", "how", "says"),
    [
        ("jack", signal.SIGSTOP, "taken no samples for"),
        ("portaudio", signal.SIGKILL, "still there"),
    ],
)
def test_a_jack_server_that_goes_or_hangs_does_not_kill_the_program(kind, how, says):
    with Jackd(8000, 64) as server:
        try:
            name = server.name if kind == "jack" else "system"
            ended(on_jack(server), kind, name, lambda: server.process.send_signal(how), says)
        finally:
            server.process.send_signal(signal.SIGCONT)
