"""What a short call costs: one and 64 samples of the two-finger squeeze, its gate
closed and open.

    python benchmarks/latency.py             print
    python benchmarks/latency.py --record    and keep the figures in results/latency.csv

The bare entry, at ``Processor.address``, is called by compiled code, as a sink's
callback does it; ``process`` by Python.
"""

from __future__ import annotations

import ctypes
import tracemalloc
from collections.abc import Callable

import numpy as np
from bench import TIMES, Row, main, row
from noise_chain import FS, caller, movements
from numba import njit
from timing import interleaved, medians, ratio

import stimlib
from stimlib.run.processor import Processor
from stimlib.scenes import squeeze

# of a job, by the samples of a call: a jump back to its beginning disturbs few of them
SAMPLES = {1: 10_000, 64: 64_000}


def bare(proc: Processor, x: np.ndarray, n: int) -> Callable[[], None]:
    """All of x through the bare entry, n samples a call, in one compiled loop."""
    code, context = proc.address
    entry = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 4)(code)
    parts = np.array([x[:, a : a + n] for a in range(0, x.shape[1] - n + 1, n)])
    out = np.empty((len(proc.outputs), n))
    first, step, calls, y = parts.ctypes.data, parts[0].nbytes, len(parts), out.ctypes.data

    @njit
    def loop():
        for k in range(calls):
            entry(context, first + k * step, y, n)

    def job(keep=(proc, parts, out)) -> None:
        loop()

    return job


def allocated(proc: Processor, x: np.ndarray, n: int) -> tuple[int, int]:
    """Bytes that 1000 calls of ``process(x, out)`` leave allocated, and most that were
    at once.
    """
    job = caller(proc, x[:, : 1000 * n], n)
    job()
    tracemalloc.start()
    try:
        job()
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        job()
        after, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return after - before, most - before


def measure() -> list[Row]:
    """All rows."""
    moves, rows = movements(max(SAMPLES.values())), []
    for n, samples in SAMPLES.items():
        calls = samples // n
        for gate in ("gate closed", "gate open"):
            x = np.tile(moves[gate][:samples], (2, 1))
            jobs = {
                f"{how}, {n} samples, {gate}": f(stimlib.compile(squeeze(), FS), x, n)
                for how, f in WAYS.items()
            }
            times = interleaved(jobs)
            rows += [
                row(what, seconds / calls * 1e6, "us") for what, seconds in medians(times).items()
            ]
            rows.append(
                row(f"ratio: process / bare entry, {n} samples, {gate}", ratio(times, *jobs), TIMES)
            )
        left, most = allocated(stimlib.compile(squeeze(), FS), x, n)
        rows.append(row(f"process, {n} samples: left by 1000 calls", left, "bytes"))
        rows.append(row(f"process, {n} samples: most at once", most, "bytes"))
    return rows


WAYS = {"process": caller, "bare entry": bare}

if __name__ == "__main__":
    main("latency", __doc__, measure)
