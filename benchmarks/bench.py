"""What every benchmark here shares: interleaved runs in one process, medians, the machine and the versions."""

from __future__ import annotations

import csv
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


def interleaved(jobs: Mapping[str, Callable[[], object]], rounds: int = 15, warm_up: int = 2) -> dict[str, list[float]]:
    """Seconds of every job in every round, A B C A B C ..: drift of the machine meets all alike."""
    for _ in range(warm_up):
        for job in jobs.values():
            job()
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            times[name].append(time.perf_counter() - start)
    return times


def medians(times: Mapping[str, list[float]]) -> dict[str, float]:
    """Median seconds of each job."""
    return {name: statistics.median(t) for name, t in times.items()}


def ratio(times: Mapping[str, list[float]], slow: str, fast: str) -> float:
    """Median over the rounds of slow/fast, pair by pair."""
    return statistics.median(a / b for a, b in zip(times[slow], times[fast], strict=True))


def machine() -> str:
    """One line: processor, Python and the versions that matter."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    packages = ", ".join(f"{p} {version(p)}" for p in ("stimlib", "numpy", "scipy", "numba", "llvmlite"))
    return f"{model}; Python {platform.python_version()}; {packages}"


def save(name: str, rows: list[dict[str, object]]) -> None:
    """Print the rows and keep them as results/NAME.csv."""
    RESULTS.mkdir(exist_ok=True)
    fields = list(dict.fromkeys(k for row in rows for k in row))
    with (RESULTS / f"{name}.csv").open("w", newline="") as f:
        out = csv.DictWriter(f, fields, lineterminator="\n")
        out.writeheader()
        out.writerows(rows)
    print(machine())
    for row in rows:
        print("  ".join(f"{v:<44}" if isinstance(v, str) else f"{v:10.4g}" for v in row.values()))
