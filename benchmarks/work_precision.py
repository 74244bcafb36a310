"""Run time against error of every operator, beside others; with --record the tables and pictures in benchmarks/work_precision.

The same as ``stimlib bench --work-precision FOLDER``; what it measures stands in ``stimlib/speed/problems``.  ``--only NAME``
measures some of them.  With --record, docs/explanation/work_precision.csv is then written anew from all tables that are recorded.
"""

import csv
import tempfile
from pathlib import Path

from bench import options
from rich.console import Console

from stimlib.speed.precision import Point, best, problems, recorded, regenerate, table

KEPT = Path(__file__).parent / "work_precision"
SUMMARY = Path(__file__).parents[1] / "docs" / "explanation" / "work_precision.csv"


def told(p: Point | None) -> tuple[str, str, str]:
    return ("", "", "") if p is None else (f"{p.family} {p.knob}".strip(), f"{p.error:.1e}", f"{p.ns:.3g}")


def summary(points: list[Point]) -> list[tuple[str, ...]]:
    """A line of each operator: what it is, what ns are for, our most exact point, and that of others."""
    known = {p.name: p for p in problems()}
    return [(known[b.problem].title, known[b.problem].per, *told(b.ours), *told(b.other)) for b in best(points)]


if __name__ == "__main__":
    parser = options(__doc__)
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        choices=[p.name for p in problems()],
        metavar="NAME",
        help="name of a problem, such as pink; again for another",
    )
    given = parser.parse_args()
    Console(width=160).print(table(regenerate(KEPT if given.record else Path(tempfile.mkdtemp()), given.only)))
    if given.record:
        with SUMMARY.open("w", newline="") as f:
            csv.writer(f, lineterminator="\n").writerows(summary(recorded(KEPT)))
