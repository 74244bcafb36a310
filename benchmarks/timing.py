"""Timing of jobs that take turns in one process.

A drift in the machine's speed therefore affects all jobs alike.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path

Jobs = Mapping[str, Callable[[], object]]
Times = Mapping[str, list[float]]


def interleaved(
    jobs: Jobs,
    rounds: int = 15,
    warm_up: int = 2,
    clock: Callable[[], float] = time.perf_counter,
    ahead: float = 0.0,
) -> dict[str, list[float]]:
    """Return the seconds of every job in every round, in the order A B C A B C ..

    Parameters
    ----------
    jobs : dict of str to callable
    rounds : int
        Number of times that each job is timed.
    warm_up : int
        Initial rounds that are not counted, to fill caches and compile code.

    clock : callable
        The clock; ``time.process_time`` counts only the computing time of this process,
        whatever else the machine does.
    ahead : float
        Seconds in which a job runs, once or more, right before it is timed, so that it
        finds caches and branches as it leaves them, and not as another job does.

    Returns
    -------
    dict of str to list of float
        In s, shape (rounds,) for each job.
    """
    for _ in range(warm_up):
        for job in jobs.values():
            job()
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            end = clock() + ahead
            while clock() < end:
                job()
            start = clock()
            job()
            times[name].append(clock() - start)
    return times


def medians(times: Times) -> dict[str, float]:
    """Return the median time of each job in s."""
    return {name: statistics.median(t) for name, t in times.items()}


def ratio(times: Times, slow: str, fast: str) -> float:
    """Return the ratio of the times that two jobs took.

    It is the median of the ratios within a round.
    """
    return statistics.median(a / b for a, b in zip(times[slow], times[fast], strict=True))


def fastest(jobs: Jobs, rounds: int = 3) -> str:
    """Return the name of the job with the shortest time.

    Use it to choose the variant of a peer to compare with.
    """
    times = interleaved(jobs, rounds, 1)
    return min(times, key=lambda name: min(times[name]))


def machine() -> str:
    """Return one line that describes processor, Python and relevant versions."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    packages = ", ".join(f"{p} {version(p)}" for p in ("stimlib", "numpy", "scipy", "llvmlite"))
    return f"{model}; Python {platform.python_version()}; {packages}"
