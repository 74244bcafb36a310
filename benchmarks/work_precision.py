"""Run time against error of every operator, beside others.

    python benchmarks/work_precision.py figures                of all operators
    python benchmarks/work_precision.py figures --only pink    of one
    python benchmarks/work_precision.py --record               and keep them

Tables and pictures go into the folder ``figures``, which is there.  What it measures is
in ``benchmarks/problems``.  With --record, they are kept in benchmarks/work_precision;
docs/explanation/work_precision.csv and the sentences in work_precision.inc are then
written anew from all tables that are recorded.
"""

import csv
import tempfile
from pathlib import Path

from bench import options
from precision import problems, recorded, regenerate, spoken, summary, table
from rich.console import Console

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
    parser.add_argument(
        "folder",
        nargs="?",
        type=Path,
        help="where tables and pictures go, if they are not recorded",
    )
    given = parser.parse_args()
    folder = KEPT if given.record else given.folder or Path(tempfile.mkdtemp())
    Console(width=160).print(table(regenerate(folder, given.only)))
    print(
        f"of each operator: {folder / 'NAME.csv'}, all its points, and {folder / 'work_NAME.svg'}"
    )
    if given.record:
        with SUMMARY.open("w", newline="") as f:
            csv.writer(f, lineterminator="\n").writerows(summary(recorded(KEPT)))
        SUMMARY.with_suffix(".inc").write_text(spoken(recorded(KEPT)))
