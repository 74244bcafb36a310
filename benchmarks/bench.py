"""What every benchmark here shares: one core, rows of a table, and a file of them when
it is told to record.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from timing import interleaved, machine, medians, ratio

RESULTS = Path(__file__).parent / "results"
Job = Callable[[], object]
Row = dict[str, Any]
NS, TIMES = "ns/sample", "times"


def row(what: str, value: float | str = "", unit: str = NS) -> Row:
    """A line of a table; without a value where something is not installed."""
    return {"what": what, "value": value, "unit": unit if value != "" else ""}


def compared(
    jobs: Mapping[str, Job], samples: float, ours: str, rounds: int = 15, warm_up: int = 2
) -> list[Row]:
    """Jobs that take turns: nanoseconds a sample of each, and how many times as long as
    ours each other takes.
    """
    times = interleaved(jobs, rounds, warm_up)
    rows = [row(name, seconds / samples * 1e9) for name, seconds in medians(times).items()]
    return rows + [
        row(f"ratio: {name} / {ours}", ratio(times, name, ours), TIMES)
        for name in jobs
        if name != ours
    ]


def under(title: str, rows: list[Row]) -> list[Row]:
    """The same rows, each beginning with a title."""
    return [r | {"what": f"{title}: {r['what']}"} for r in rows]


def options(doc: str | None, cores: int | None = 1) -> argparse.ArgumentParser:
    """The options of a script; then it runs on one core, or on so many as there are
    with None.

    Libraries count their threads when they are loaded, so the script begins once more
    where it was not started so.
    """
    wanted = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    if hasattr(os, "sched_setaffinity") and cores is not None:
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    if wanted.items() - os.environ.items():
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | wanted)
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--record",
        action="store_true",
        help="keep the figures in benchmarks/results; else they are only printed",
    )
    return parser


def save(name: str, rows: list[Row], record: bool) -> None:
    """Print the rows; keep them as results/NAME.csv when they are to be recorded."""
    for r in rows:
        print(
            "  ".join(
                f"{v:<60}" if isinstance(v, str) else f"{v:<10.4g}" for v in r.values()
            ).rstrip()
        )
    if record:
        RESULTS.mkdir(exist_ok=True)
        with (RESULTS / f"{name}.csv").open("w", newline="") as f:
            out = csv.DictWriter(
                f, list(dict.fromkeys(k for r in rows for k in r)), lineterminator="\n"
            )
            out.writeheader()
            out.writerows(rows)


def main(
    name: str, doc: str | None, measure: Callable[[], list[Row]], cores: int | None = 1
) -> None:
    """A script whose figures are one table: the machine, then what ``measure``
    gives.
    """
    given = options(doc, cores).parse_args()
    save(name, [row(machine()), *measure()], given.record)
