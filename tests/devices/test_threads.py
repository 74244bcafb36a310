"""Sinks in several threads at once, and on a machine that gives no more threads."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from devices.servers import Jackd, needs_jack

import stimlib
from stimlib import SinkError
from stimlib.devices.null import NullSink

FEW = """
import resource, sys, threading, time
import stimlib
from devices.servers import Seen
from stimlib.devices.null import NullSink

MIB, NO_LIMIT = 1 << 20, (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
scene = stimlib.Scene({"y": stimlib.constant(1.0, "1/m") * stimlib.Input("x", "m")})

def threads(n):
    \"\"\"Memory for so many more of half a GiB; None: as many as you like.\"\"\"
    resource.setrlimit(resource.RLIMIT_AS, NO_LIMIT)
    threading.stack_size(0 if n is None else 512 * MIB)
    if n is not None:
        status = open("/proc/self/status").readlines()
        kib = next(int(line.split()[1]) for line in status if line.startswith("VmSize"))
        most = (kib >> 10) * MIB + (512 * n + 256) * MIB
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))

def session(n, log):
    sink = NullSink(scene, 1.0, motion={"x": lambda t: 0.5 + 0 * t}, log=log, realtime=False)
    threads(n)
    try:
        sink.open(8000)
        if "later" in sys.argv:
            threads(0)
        sink.start(0.1)
        sink.wait()
        return "played"
    except stimlib.SinkError as e:
        assert "can't start new thread" in str(e) and "ulimit" in str(e), e
        return str(e).split(":")[0]
    finally:
        sink.close()
        sink.close()
        threads(None)

session(None, Seen())
ends = set()
for n in (0, 1, 2, 3, 4, 5):
    log = Seen()
    ends.add(session(n, log))
    end = time.monotonic() + 30
    while threading.active_count() > 1 and time.monotonic() < end:
        time.sleep(0.01)
    assert threading.active_count() == 1, threading.enumerate()
    assert not stimlib.devices.process.open_sinks and not stimlib.devices.process.playing
    if log.end:
        assert log.end["delivered"] == sum(map(len, log.frames))
print(*sorted(ends), sep=", ")
"""


def ran(code, *words, **env):
    """What a program of its own has printed."""
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])} | env
    done = subprocess.run(
        [sys.executable, "-c", code, *words], env=env, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_without_threads_a_sink_does_not_open_and_holds_nothing():
    """Whichever of a session's four threads is the one too many: a real limit of
    memory, of which a thread takes half a GiB.
    """
    ends = ran(FEW).strip().split(", ")
    assert {"stimlib close", "played"} < set(ends) and len(ends) >= 3, ends


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_without_threads_a_sink_does_not_start_and_holds_nothing():
    assert "stimlib motion" in ran(FEW, "later")


def test_what_cannot_be_waited_for():
    with pytest.raises(SinkError, match="wait: start the sink first"):
        NullSink(stimlib.Scene({"y": stimlib.constant(1.0)}), 1.0).wait()


MANY = """
import sys, threading
sys.setswitchinterval(1e-5)
import stimlib

scene = stimlib.Scene({"y": stimlib.constant(1.0)})

def make(k):
    if sys.argv[1] == "null":
        from stimlib.devices.null import NullSink
        return NullSink(scene, 1.0, clocked=False, realtime=bool(k % 2))
    if sys.argv[1] == "jack":
        from stimlib.devices.jack import JackSink
        return JackSink(scene, 1.0, server=sys.argv[2], name=f"{sys.argv[2]}_{k}", realtime=False)
    from stimlib.devices.portaudio import PortAudioSink
    return PortAudioSink(scene, 1.0, name="stimnull", clocked=False, realtime=False)

def play(k):
    with make(k) as sink:
        sink.open(8000)
        together.wait()
        sink.start(0.05)
        sink.wait()
        assert sink.report().produced == 400, sink.report()

def round(n):
    threads = [threading.Thread(target=guarded, args=(k,)) for k in range(n)]
    for t in threads: t.start()
    for t in threads: t.join()

wrong = []
def guarded(k):
    try:
        play(k)
    except BaseException as e:
        wrong.append(repr(e))
        together.abort()

for n in (1, 6, 6):
    together = threading.Barrier(n)
    round(n)
assert not wrong, wrong
"""


def test_null_sinks_in_several_threads():
    # what is not permitted here
    ran("import warnings; warnings.simplefilter('ignore', RuntimeWarning)\n" + MANY, "null")


@needs_jack
def test_jack_sinks_in_several_threads():
    with Jackd(8000, 64) as server:
        ran(MANY, "jack", server.name)


def test_portaudio_sinks_in_several_threads(tmp_path):
    pytest.importorskip(
        "sounddevice",
        reason="needs PortAudio (tests/devices/install.sh)",
        exc_type=(ImportError, OSError),
    )
    if not Path("/usr/share/alsa/alsa.conf").exists():
        pytest.skip("needs ALSA's configuration (apt-get install libasound2-data)")
    config = tmp_path / "asound.conf"
    config.write_text('pcm.stimnull { type null hint { show on description "stimnull" } }\n')
    ran(
        MANY,
        "portaudio",
        ALSA_CONFIG_PATH=f"/usr/share/alsa/alsa.conf:{config}",
        JACK_DEFAULT_SERVER="stimlib_none",
    )
