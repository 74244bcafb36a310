"""The PortAudio sink on real back ends: a JACK server, and ALSA's file without a clock.

PortAudio takes the JACK server of the moment in which sounddevice is first imported, so
each session is a process of its own.
"""

import builtins
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from devices.servers import (
    SLACK,
    Capture,
    Jackd,
    Pulse,
    aligned,
    captured_fades,
    needs_jack,
    offline,
    textured,
    unjudged,
    until_judged,
    without,
)

import stimlib
from stimlib import BadValue, SinkError
from stimlib.devices.sink import CLOSE_WITHIN
from stimlib.devices.sources import Signal, Signals
from stimlib.motion.generators import minimum_jerk
from stimlib.run.safety import Safety

HAND = {"x1": minimum_jerk(0.02), "x2": minimum_jerk(0.01)}


def needs_portaudio():
    try:
        import sounddevice  # noqa: F401

        missing = None
    except (ImportError, OSError) as e:
        missing = str(e)
    return pytest.mark.skipif(
        missing is not None, reason=f"needs PortAudio: {missing} (tests/devices/install.sh)"
    )


pytestmark = needs_portaudio()

# Plays what stdin says, one JSON object; prints a line when the device is open, waits
# for one, and prints what it has seen.
PLAYER = """
import json, sys
from devices.servers import Seen, textured
import stimlib
from stimlib.motion.generators import minimum_jerk
from stimlib.devices.portaudio import PortAudioSink

told = json.loads(sys.stdin.readline())
if told["steady"]:
    scene, motion = stimlib.Scene({"y": stimlib.Param("level", 1.0) * 1}), None
else:
    scene = textured(told["outputs"])
    motion = {name: minimum_jerk(depth) for name, depth in zip(scene.inputs, (0.02, 0.01))}
log = Seen()
full_scale = 1.0 if told["steady"] else 50.0
options = told["options"] | {"motion": motion, "seed": 7, "log": log, "realtime": False}
sink = PortAudioSink(scene, full_scale, **options)
error = None
try:
    with sink:
        sink.open(told["fs"], told["channels"], told["block"])
        print("open", flush=True)
        sys.stdin.readline()
        sink.start(told["seconds"])
        print("playing", flush=True)
        sink.wait(told["wait"])
        if told["stall"]:
            sink.pump.write("STALL", told["stall"])
            sink.wait()
        if told["hold"]:
            print("played", flush=True)
            sys.stdin.readline()
except stimlib.SinkError as e:
    error = str(e)
finally:
    report = sink.report().to_dict() if sink._opened else None
    print(json.dumps({"report": report, "events": log.events, "error": error}), flush=True)
"""


class Player:
    """A session in a process of its own."""

    def __init__(
        self, environment, fs, channels, block, seconds, *, outputs=1, code=PLAYER,
        wait=60, steady=False, stall=0, hold=False, **options,
    ):  # fmt: skip
        env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])} | environment
        self.child = subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(code)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=env,
        )
        told = dict(
            fs=fs,
            channels=channels,
            block=block,
            seconds=seconds,
            outputs=outputs,
            wait=wait,
            options=options,
        )
        self.say(json.dumps(told | {"steady": steady, "stall": stall, "hold": hold}))

    def say(self, line):
        self.child.stdin.write(line + "\n")
        self.child.stdin.flush()

    def until(self, line):
        said = self.child.stdout.readline()
        assert said == f"{line}\n", said + self.child.stderr.read()

    def end(self):
        """(report, events, error)"""
        out, err = self.child.communicate(timeout=60)
        assert out, err
        told = json.loads(out.splitlines()[-1])
        assert "Error" not in err, err
        return told["report"], told["events"], told["error"]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.child.kill()
        self.child.communicate()


def is_exact(frames, events, fs, channels, outputs, seconds, may_lose=False):
    """Captured frames are the offline render, from their first sound on; False where a
    server that may lose frames did.
    """
    n, scene = round(seconds * fs), textured(outputs)
    hand = {name: HAND[name] for name in scene.inputs}
    places = list(range(outputs)) + [-1] * (channels - outputs)
    expected = offline(scene, Safety(50.0), hand, fs, n, events, places, seed=7)
    got = aligned(frames, expected)
    if may_lose and not np.array_equal(got, expected):
        return False
    assert np.array_equal(got, expected)
    head = Safety(50.0).samples(fs)
    plain = (stimlib.render(scene, hand, fs, seconds, seed=7).y / 50.0).astype(np.float32).T
    assert np.array_equal(got[head:-head, :outputs], plain[head:-head]), (
        "float32(render / full scale) between the fades"
    )
    assert np.abs(plain).max() > 0.3
    return True


# ALSA ---------------------------------------------------------------------------------
def alsa(folder):
    """Environment in which ALSA has a device "stimfile" that writes what it gets into a
    file.
    """
    config = folder / "asound.conf"
    config.write_text(
        f'pcm.stimfile {{ type file file "{folder / "out.raw"}" format "raw" slave.pcm "null" '
        'hint { show on description "stimfile" } }\n'
    )
    return {
        "ALSA_CONFIG_PATH": f"/usr/share/alsa/alsa.conf:{config}",
        "JACK_DEFAULT_SERVER": "stimlib_none",
    }


def to_a_file(folder, fs, channels, block, seconds=2.0, **options):
    if not Path("/usr/share/alsa/alsa.conf").exists():
        pytest.skip("needs ALSA's configuration (apt-get install libasound2-data)")
    outputs = min(channels, 2)
    told = dict(outputs=outputs, name="stimfile", clocked=False)
    with Player(alsa(folder), fs, channels, block, seconds, **(told | options)) as player:
        player.until("open")
        player.say("go")
        player.until("playing")
        report, events, error = player.end()
    assert error is None and (report["produced"], report["delivered"], report["lost"]) == (
        seconds * fs,
        seconds * fs,
        0,
    )
    frames = np.fromfile(folder / "out.raw", np.float32)
    frames = frames[: len(frames) // channels * channels].reshape(-1, channels)
    is_exact(frames, events, fs, channels, outputs, seconds)


@pytest.mark.parametrize("fs, block, channels", [(8000, 64, 1), (48000, 32, 2), (8000, None, 2)])
def test_alsa_file_is_exact(tmp_path, fs, block, channels):
    to_a_file(tmp_path, fs, channels, block)


def test_a_callback_in_python_plays_the_same(tmp_path):
    to_a_file(tmp_path, 8000, 2, 64, 1.0, compiled=False)


# JACK ---------------------------------------------------------------------------------
def connected(capture, channels):
    """PortAudio's ports go to the capture too."""
    ports = sorted(
        (p.name for p in capture.client.get_ports("PortAudio:out_.*")),
        key=lambda name: int(name.split("_")[-1]),
    )
    assert len(ports) == channels
    for port, to in zip(ports, capture.names, strict=True):
        capture.client.connect(port, to)


def on_jack(server):
    return {"JACK_DEFAULT_SERVER": server.name}


def over_jack(server, channels, seconds=2.0, **options):
    """A session in freewheel mode, captured by a second client.

    The server goes at its pace again before the session's client ends: libjack 1.9.21
    may recurse without end (and take the capturing process with it) when a client
    leaves a graph that runs without a clock.
    """
    fs, outputs = server.rate, min(channels, 2)
    n = round(seconds * fs)
    # without a clock a 1000 Hz server runs some million frames a second until it is
    # told "go"
    room = max(n + 60 * fs, 4_000_000)
    with Capture(server.name, channels, room) as capture:
        told = dict(outputs=outputs, name="system", clocked=False, hold=True)
        with Player(
            on_jack(server), fs, channels, server.block, seconds, **(told | options)
        ) as player:
            player.until("open")
            connected(capture, channels)
            capture.client.set_freewheel(True)
            player.say("go")
            player.until("playing")
            player.until("played")
            capture.client.set_freewheel(False)
            player.say("end")
            report, events, error = player.end()
        frames = capture.frames.copy()
    assert error is None and (report["produced"], report["lost"]) == (n, 0)
    is_exact(frames, events, fs, channels, outputs, seconds)


@needs_jack
@pytest.mark.parametrize("fs, block, channels", [(8000, 64, 1), (48000, 32, 2)])
def test_over_jack_is_exact(fs, block, channels):
    with Jackd(fs, block) as server:
        over_jack(server, channels)


@needs_jack
def test_what_does_not_fit_the_device():
    cases = [
        (
            {"name": "system"},
            48000,
            1,
            r"device 'system' \(JACK.*\) does not run at 48000 Hz: open\(rate=8000\)",
        ),
        ({"name": "system"}, 8000, 25, "has 24 channels, fewer than 25"),
        ({"name": "nobody"}, 8000, 1, "no device 'nobody' .*there are 0 'system'"),
        ({"name": 77}, 8000, 1, "no device 77"),
    ]
    with Jackd(8000, 64) as server:
        for options, fs, channels, text in cases:
            with Player(on_jack(server), fs, channels, 64, 1.0, **options) as player:
                report, _, error = player.end()
            assert report is None
            assert re.search(text, error), error


@needs_jack
@pytest.mark.parametrize("way", ["stop", signal.SIGTERM, signal.SIGINT])
def test_ways_out_fade(way):
    """Largest step of a steady full scale that comes and goes; PortAudio tells that
    frames were lost, not which.
    """
    with Jackd(8000, 64) as server:

        def take():
            with Capture(server.name, 1, 60 * 8000) as capture:
                with Player(
                    on_jack(server),
                    8000,
                    1,
                    64,
                    None,
                    steady=True,
                    name="system",
                    wait=0.5 if way == "stop" else 60,
                ) as p:
                    p.until("open")
                    connected(capture, 1)
                    p.say("go")
                    p.until("playing")
                    if way != "stop":
                        time.sleep(0.4)
                        p.child.send_signal(way)
                    told = json.loads(p.child.communicate(timeout=30)[0])
                    assert (
                        p.child.returncode
                        == {"stop": 0, signal.SIGTERM: 143, signal.SIGINT: -2}[way]
                    )
                frames = capture.frames.copy()
                if told["report"]["underruns"]:
                    return False
                return captured_fades(
                    frames, capture.times[: len(frames)] - capture.times[0], [], capture.xruns
                )

        until_judged(take)


@needs_jack
def test_a_stall_is_told_and_the_report_adds_up():
    with Jackd(8000, 64) as server:
        with Player(
            on_jack(server), 8000, 1, 64, 2.0, name="system", wait=0.5, stall=300_000
        ) as player:
            player.until("open")
            player.say("go")
            player.until("playing")
            report, events, error = player.end()
    assert error is None
    assert report["produced"] == 16000 == report["delivered"] + report["lost"]
    assert (
        report["lost"] > 0.25 * 8000
        and report["underruns"] >= 1
        and report["block_time"]["max"] >= 0.3
    )
    assert sum(e["frames"] for _, kind, e in events if kind == "lost") == report["lost"]


def taken_away(environment, name, take_away):
    """A device that goes while it plays is a typed error, soon."""
    with Player(environment, 8000, 1, None, None, steady=True, name=name) as player:
        player.until("open")
        player.say("go")
        player.until("playing")
        time.sleep(0.3)
        take_away()
        began = time.monotonic()
        report, _, error = player.end()
        took = time.monotonic() - began
    assert "the device has" in error and "still there" in error
    assert report["delivered"] + report["lost"] == report["produced"]
    assert took < 1.0 + CLOSE_WITHIN + 1.0 + SLACK, (
        "a second for the error, two for close, and the end of the interpreter"
    )
    if not report["produced"]:
        unjudged("the device took nothing in 0.3 s")


@needs_jack
@pytest.mark.longer
def test_a_server_that_is_killed_is_a_typed_error_within_a_second():
    with Jackd(8000, 64) as server:

        def take_away():
            server.process.kill()
            server.process.wait(10)

        taken_away(on_jack(server), "system", take_away)


FELT = """
import json, sys, time
from devices.servers import Seen
import stimlib
from stimlib.devices.portaudio import PortAudioSink
from stimlib.devices.sources import Signal, Signals

told = json.loads(sys.stdin.readline())
scene = stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")})
log = Seen()
motion = Signals({"x": Signal(0.05)})
with PortAudioSink(scene, 100.0, motion=motion, log=log, realtime=False, name="system") as sink:
    sink.open(told["fs"], 2)
    print("open", flush=True)
    sys.stdin.readline()
    sink.start()
    print("playing", flush=True)
    sys.stdin.readline()
events = [max(float(a.max()) for a in rows) for rows in (log.x, log.frames)]
print(json.dumps({"report": sink.report().to_dict(), "events": events, "error": None}))
"""


@needs_jack
def test_a_position_comes_in_as_a_signal():
    """A JACK sink plays a position to the port that PortAudio reads."""
    from stimlib.devices.jack import JackSink

    position = stimlib.Scene({"x": 1.0 * stimlib.Input("p", "m")})
    with Jackd(8000, 64) as server:
        hand = JackSink(
            position,
            0.05,
            motion={"p": HAND["x1"]},
            server=server.name,
            connect=None,
            name="hand",
            realtime=False,
        )
        with Player(on_jack(server), 8000, 2, 64, None, code=FELT) as player, hand:
            player.until("open")
            hand.open(8000)
            looker = hand._client
            player.say("go")
            player.until("playing")
            (port,) = [p.name for p in looker.get_ports("PortAudio:in_.*")]
            looker.connect("hand:x", port)
            hand.start(1.5)
            hand.wait(30)
            player.say("end")
            report, (x, force), _ = player.end()
    assert x == pytest.approx(0.02, rel=1e-3) and force == pytest.approx(0.4, rel=1e-3)
    assert report["delivered"] + report["lost"] == report["produced"]


# Without a device ---------------------------------------------------------------------
def sink(**options):
    from stimlib.devices.portaudio import PortAudioSink

    scene = stimlib.Scene({"y": stimlib.Param("level", 1.0) * 1})
    return PortAudioSink(scene, 1.0, realtime=False, **options)


@pytest.mark.parametrize(
    "missing, text",
    [
        (ImportError("No module named 'sounddevice'"), "package sounddevice"),
        (OSError("not found"), "PortAudio library"),
    ],
)
def test_what_is_missing_is_named_with_its_command(monkeypatch, missing, text):
    without(monkeypatch, "sounddevice", missing)
    with pytest.raises(
        SinkError,
        match=rf"{text}.*pip install 'stimlib\[portaudio\]'.*apt-get install libportaudio2",
    ):
        sink().open(8000)


def test_a_portaudio_that_does_not_start_is_told(monkeypatch):
    """sounddevice starts it with the import; its error is then of a class that cannot
    be imported.
    """
    from stimlib.devices.available import devices

    real = builtins.__import__

    def broken(name, *rest, **more):
        if name == "sounddevice":
            raise RuntimeError("Error initializing PortAudio")
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", broken)
    with pytest.raises(SinkError, match="PortAudio does not start .*initializing"):
        sink().open(8000)
    (row,) = (d for d in devices("stimlib_none") if d.sink == "portaudio")
    assert (row.ready, row.how) == (False, "see whether other programs play")


def test_signals_of_portaudio_have_no_ports():
    from stimlib.devices.portaudio import PortAudioSink

    scene = stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")})
    with pytest.raises(BadValue, match="no port 'system:capture_1' to connect"):
        PortAudioSink(scene, 1.0, motion=Signals({"x": Signal(0.05, connect="system:capture_1")}))


OTHER = """
import warnings
import sounddevice

warnings.simplefilter("always")
make = sounddevice._StreamBase.__init__

def no_pointers(self, *rest, wrap_callback=None, **more):
    if wrap_callback is None:
        raise TypeError("no pointers here")
    make(self, *rest, wrap_callback=wrap_callback, **more)

sounddevice._StreamBase.__init__ = no_pointers
"""


def test_another_sounddevice_falls_back_to_python_with_a_warning(tmp_path):
    with Player(
        alsa(tmp_path), 8000, 1, 64, 0.5, name="stimfile", clocked=False, code=OTHER + PLAYER
    ) as player:
        player.until("open")
        player.say("go")
        out, err = player.child.communicate(timeout=60)
    assert "takes no compiled callback" in err
    assert json.loads(out.splitlines()[-1])["report"]["delivered"] == 4000


# PulseAudio ---------------------------------------------------------------------------
PULSE = shutil.which("pulseaudio") and shutil.which("parec")


needs_pulse = pytest.mark.skipif(not PULSE, reason="needs PulseAudio (tests/devices/install.sh)")


@needs_pulse
@pytest.mark.stress
@pytest.mark.parametrize("fs, channels", [(8000, 1), (48000, 2), (48000, 8), (8000, 24)])
def test_over_pulseaudio_is_exact(tmp_path, fs, channels):
    """A null sink with a clock of its own, recorded at its monitor: on a busy machine
    it loses frames that no sink can help.
    """
    seconds = 1.5
    outputs = min(channels, 2)
    for take in range(5):
        (tmp_path / str(take)).mkdir()
        with Pulse(tmp_path / str(take), fs, channels) as server:
            with Player(
                server.environment, fs, channels, None, seconds, outputs=outputs, name="pulse"
            ) as player:
                player.until("open")
                server.record()
                player.say("go")
                player.until("playing")
                report, events, error = player.end()
            time.sleep(0.3)  # until the recorder has what the server still holds
            frames = server.frames()
        assert error is None
        assert report["produced"] == round(seconds * fs)
        if report["lost"] == 0 and is_exact(
            frames, events, fs, channels, outputs, seconds, may_lose=True
        ):
            return
    unjudged("PulseAudio lost frames, or the sink's are wrong, in each of 5 takes")


@needs_pulse
@pytest.mark.parametrize("what", ["sink", "server"])
@pytest.mark.longer
def test_what_pulseaudio_takes_away_is_a_typed_error(tmp_path, what):
    with Pulse(tmp_path) as server:
        taken_away(
            server.environment,
            "pulse",
            server.remove_the_sink if what == "sink" else server.__exit__,
        )


HANGS = """
import sys, time
import stimlib
from stimlib.devices import jack, portaudio

scene = stimlib.Scene({"y": stimlib.constant(1.0)})
if sys.argv[1] == "pulse":
    sink = portaudio.PortAudioSink(scene, 1.0, realtime=False, name="pulse")
else:
    sink = jack.JackSink(scene, 1.0, realtime=False, server=sys.argv[1])
sink.open(8000)
sink.start()
print("playing", flush=True)
sys.stdin.readline()
try:
    sink.wait()
except stimlib.SinkError as e:
    print(e, flush=True)
sink.close()
print("closed", flush=True)
"""


def hung(environment, device, server):
    """A server that is stopped, as one that hangs: its own error, ``close`` comes back,
    and the program ends as it wanted to.
    """
    told = dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    child = subprocess.Popen(
        [sys.executable, "-c", HANGS, device], env=os.environ | environment, **told
    )
    try:
        assert child.stdout.readline() == "playing\n", child.stderr.read()
        server.send_signal(signal.SIGSTOP)
        out, err = child.communicate("go\n", timeout=60)
    finally:
        server.send_signal(signal.SIGCONT)
        child.kill()
        child.communicate()
    assert child.returncode == 0, (child.returncode, out, err)
    assert (
        "the device has taken no samples for" in out
        and out.endswith("closed\n")
        and "Error" not in err
    ), out + err


@needs_pulse
def test_a_pulseaudio_that_hangs_does_not_kill_the_program(tmp_path):
    with Pulse(tmp_path) as server:
        hung(server.environment, "pulse", server._server)


@needs_jack
def test_a_jack_server_that_hangs_does_not_kill_the_program():
    with Jackd(8000, 64) as server:
        hung({}, server.name, server.process)


# Everything ---------------------------------------------------------------------------
@pytest.mark.stress
@pytest.mark.parametrize("fs, block", list(itertools.product((1000, 8000, 48000), (16, 32, 64))))
def test_alsa_file_is_exact_everywhere(tmp_path, fs, block):
    for channels in (1, 2, 8, 24):
        to_a_file(tmp_path, fs, channels, block, 10.0)


@pytest.mark.stress
@needs_jack
@pytest.mark.parametrize("fs, block", list(itertools.product((1000, 8000, 48000), (16, 32, 64))))
def test_over_jack_is_exact_everywhere(fs, block):
    with Jackd(fs, block) as server:
        for channels in (1, 2, 8, 24):
            over_jack(server, channels, 3.0)
