"""Half an hour in real time on a JACK server without hardware: ``make soak``, or
``soak.py MINUTES``.

What it says goes to results/soak.log too.  It ends with an error where memory
grows by more than 4 MiB after the first tenth, where a sample is not accounted for, or
where the log does not replay.  What another client captures is compared sample by
sample in tests/devices/test_jack.py.
"""

from __future__ import annotations

import platform
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

from devices.servers import Jackd

import stimlib
from stimlib.devices.jack import JackSink
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import replay
from stimlib.motion.generators import minimum_jerk
from stimlib.scenes import squeeze

FS, BLOCK = 8000, 64
HAND = {"x1": minimum_jerk(0.02), "x2": minimum_jerk(0.01)}


def resident() -> float:
    """MiB of this process in memory."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024


def main(minutes: float) -> None:
    seconds = 60 * minutes
    out = (Path(__file__).parent / "results" / "soak.log").open("w")

    def say(text: str) -> None:
        print(text, flush=True)
        print(text, file=out, flush=True)

    say(
        f"{datetime.now(UTC):%F %H:%M} UTC, stimlib {stimlib.__version__}, Python"
        f" {platform.python_version()}, {minutes:g} min"
    )
    with tempfile.TemporaryDirectory() as place, Jackd(FS, BLOCK) as server:
        log = Path(place) / "soak.stimlog"
        words = {"motion": HAND, "server": server.name, "log": log, "realtime": False}
        with JackSink(squeeze(), 50.0, **words) as sink:
            sink.open(FS)
            sink.start(seconds)
            began, memory = time.monotonic(), []
            while not sink.finished:
                sink.wait(1.0)
                if not sink.finished:
                    sink.set("k", 1500.0 + 500.0 * (len(memory) % 3), ramp=0.2)
                memory.append(resident())
                if len(memory) % 60 == 0:
                    now = time.monotonic() - began
                    say(f"{now:6.0f} s  {memory[-1]:8.2f} MiB  {sink.report()}")
                    sink.check()
        report, again = sink.report(), replay(read_log(log))
    growth = max(memory[len(memory) // 10 :]) - memory[len(memory) // 10]
    say(f"end       {report}\nmemory grew by {growth:.2f} MiB after the first tenth")
    say(f"replay    {again}")
    assert report.produced == round(seconds * FS) == report.delivered + report.lost
    assert again.matches and report.unlogged == 0
    assert growth <= 4.0
    say("passed")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 30.0)
