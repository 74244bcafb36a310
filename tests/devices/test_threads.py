"""Sinks on a machine that gives no more threads."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FEW = """
import resource, threading, time
import stimlib
from devices.servers import Seen, until
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

def session(n, log, later=False):
    sink = NullSink(scene, 1.0, motion={"x": lambda t: 0.5 + 0 * t}, log=log, realtime=False)
    threads(n)
    try:
        sink.open(8000)
        if later:
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
for n, later in [*((n, False) for n in range(6)), (5, True)]:
    log = Seen()
    ends.add(session(n, log, later))
    until(lambda: threading.active_count() == 1)
    assert not stimlib.devices.process.open_sinks and not stimlib.devices.process.playing
    if log.end:
        assert log.end["delivered"] == sum(map(len, log.frames))
print(*sorted(ends), sep=", ")
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_without_threads_a_sink_neither_opens_nor_starts_and_holds_nothing():
    """Whichever of a session's four threads is the one too many: a real limit of
    memory, of which a thread takes half a GiB.
    """
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    words, heard = [sys.executable, "-c", FEW], {"capture_output": True, "text": True}
    done = subprocess.run(words, env=env, timeout=180, **heard)
    assert done.returncode == 0, done.stdout + done.stderr
    ends = done.stdout.strip().split(", ")
    assert {"stimlib close", "stimlib motion", "played"} <= set(ends), ends
