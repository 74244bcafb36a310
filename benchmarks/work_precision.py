"""Run time against error of every operator, beside others; with --record the tables and pictures in benchmarks/work_precision.

The same as ``stimlib bench --work-precision FOLDER``; what it measures stands in ``stimlib/speed/problems``.  ``--only NAME``
measures some of them.  With --record, docs/explanation/work_precision.csv is then written anew from all tables that are recorded.
"""

import csv
import tempfile
from pathlib import Path

from bench import options
from rich.console import Console

from stimlib.speed.precision import best, problems, recorded, regenerate, summary, table

KEPT = Path(__file__).parent / "work_precision"
SUMMARY = Path(__file__).parents[1] / "docs" / "explanation" / "work_precision.csv"


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
            csv.writer(f, lineterminator="\n").writerows(summary(best(recorded(KEPT))))
