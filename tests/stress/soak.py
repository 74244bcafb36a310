"""Half an hour in real time on a JACK server without hardware: ``make soak``, or
``soak.py MINUTES``.

What it says goes to soak.log beside this file too.  It ends with an error where memory
grows by more than 4 MiB after the first tenth, where a sample is not accounted for, or
where the log does not replay.
"""

from __future__ import annotations

import argparse
import platform
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from devices.servers import Capture, Jackd

import stimlib
from stimlib.devices.jack import JackSink
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import delivered, replay
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
    out = Path(__file__).with_name("soak.log").open("w")

    def say(text: str) -> None:
        print(text, flush=True)
        print(text, file=out, flush=True)

    say(
        f"{datetime.now(UTC):%F %H:%M} UTC, stimlib {stimlib.__version__}, Python"
        f" {platform.python_version()}, {minutes:g} min"
    )
    with tempfile.TemporaryDirectory() as place, Jackd(FS, BLOCK) as server:
        with Capture(server.name, 2, round((seconds + 30) * FS)) as capture:
            folder = Path(place) / "soak.stimlog"
            with JackSink(
                squeeze(),
                50.0,
                motion=HAND,
                server=server.name,
                connect=capture.names,
                log=folder,
                realtime=False,
            ) as sink:
                sink.open(FS)
                sink.start(seconds)
                began, memory, n = time.monotonic(), [], 0
                while not sink.finished:
                    sink.wait(1.0)
                    n += 1
                    if not sink.finished:
                        sink.set("k", 1500.0 + 500.0 * (n % 3), ramp=0.2)
                    memory.append(resident())
                    if n % 60 == 0:
                        say(
                            f"{time.monotonic() - began:6.0f} s  {memory[-1]:8.2f} MiB "
                            f" {sink.report()}"
                        )
                        sink.check()
            time.sleep(0.1)
            frames = capture.frames
            index = capture.times[: len(frames)] - sink.pump.read("ORIGIN")
        report = sink.report()
        say(f"end       {report}")
        growth = max(memory[len(memory) // 10 :]) - memory[len(memory) // 10]
        say(f"memory grew by {growth:.2f} MiB after the first tenth")
        log = read_log(folder)
        again = replay(log)
        say(f"replay    {again}")
        inside = (index >= 0) & (index < report.produced)
        captured = np.zeros(report.produced, bool)
        captured[index[inside]] = True
        start = int(np.flatnonzero(inside)[0])
        wrong, late = 0, 0
        by_index = np.full(report.produced, -1, np.int64)
        by_index[index[inside]] = start + np.flatnonzero(inside[start:])
        for at, part, given in delivered(log):
            places = by_index[at : at + len(part)]
            if given:
                there = places >= 0
                late += int((~there).sum())
                wrong += int((frames[places[there]] != part[there]).any(axis=1).sum())
            else:
                wrong += int((places >= 0).sum())
        say(
            f"captured  {int(captured.sum())}, lost {report.lost}, missed by the capturing client"
            f" itself {late}, wrong {wrong}"
        )
        assert report.produced == round(seconds * FS) == report.delivered + report.lost
        assert captured.sum() + report.lost + late == report.produced
        assert again.matches and report.unlogged == 0
        assert wrong == 0
        assert growth <= 4.0
        say("passed")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("minutes", type=float, nargs="?", default=30.0)
    main(parser.parse_args().minutes)
