"""Streaming through JACK: how much faster than real time it can be, and what a busy
interpreter costs the compiled callback.

    PYTHONPATH=tests python benchmarks/streaming.py             print
    PYTHONPATH=tests python benchmarks/streaming.py --record    and keep the figures

They are kept in results/streaming.csv.

It starts a JACK server without hardware.
"""

from __future__ import annotations

import statistics
import threading
import time
from typing import Any

from bench import TIMES, Row, main, row
from devices.servers import Jackd, no_jack

from stimlib.devices.jack import JackSink
from stimlib.motion.generators import minimum_jerk
from stimlib.scenes import squeeze

FS, BLOCK = 8000, 64
HAND = {"x1": minimum_jerk(0.02), "x2": minimum_jerk(0.01)}


def hog(over: threading.Event) -> None:
    """A thread that keeps the interpreter to itself for some 20 ms at a time, as long
    calls into C do.
    """
    while not over.is_set():
        sum(range(1_000_000))


def busy(server: Jackd, seconds: float = 3.0) -> Any:
    """Report of a session in real time while another thread holds the interpreter."""
    over = threading.Event()
    thread = threading.Thread(target=hog, args=(over,))
    with JackSink(squeeze(), 50.0, motion=HAND, server=server.name, realtime=False) as sink:
        sink.open(server.rate)
        thread.start()
        try:
            sink.start(seconds)
            sink.wait(seconds + 20)
        finally:
            over.set()
            thread.join()
    return sink.report()


def freewheel(server: Jackd, seconds: float = 120.0) -> float:
    """Times real time of the two-finger squeeze."""
    with JackSink(squeeze(), 50.0, motion=HAND, server=server.name, realtime=False) as sink:
        sink.open(FS)
        sink.freewheel(True)
        start = time.perf_counter()
        sink.start(seconds)
        sink.wait()
        took = time.perf_counter() - start
        sink.freewheel(False)
    assert sink.report().produced == seconds * FS and sink.report().lost == 0
    return seconds / took


def measure() -> list[Row]:
    """All rows."""
    if missing := no_jack():
        return [row(f"JACK is not installed: {missing}")]
    with Jackd(FS, BLOCK) as server:
        speed = statistics.median(freewheel(server) for _ in range(5))
        counts = [busy(server).underruns for _ in range(5)]
    return [
        row(f"freewheel, squeeze, {FS} Hz, blocks of {BLOCK}: real time", speed, TIMES),
        row("interpreter held for 3 s, compiled callback", statistics.median(counts), "underruns"),
    ]


if __name__ == "__main__":
    main("streaming", __doc__, measure, cores=None)
