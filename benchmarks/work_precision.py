"""Run time against error of every operator, beside others; with --record the tables and pictures in benchmarks/work_precision.

The same as ``stimlib bench --work-precision FOLDER``; what it measures stands in ``stimlib/speed/problems``.
"""

import tempfile
from pathlib import Path

from bench import options
from rich.console import Console

from stimlib.speed.precision import regenerate, table

if __name__ == "__main__":
    keep = options(__doc__).parse_args().record
    folder = Path(__file__).parent / "work_precision" if keep else Path(tempfile.mkdtemp())
    Console(width=160).print(table(regenerate(folder)))
