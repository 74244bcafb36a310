"""What AHAP, .haptic and .hjif lose: each file of tests/patterns, written in all three
formats and read back.

python benchmarks/patterns.py             print
python benchmarks/patterns.py --record    and keep the table in docs/howto/patterns.csv
"""

from __future__ import annotations

import csv
import io
import sys
import tempfile
from pathlib import Path

from stimlib.errors import BadValue
from stimlib.files import read_pattern, write_pattern

ROOT = Path(__file__).parents[1]
FILES, TABLE = ROOT / "tests" / "patterns", ROOT / "docs" / "howto" / "patterns.csv"
FORMATS = ".ahap", ".haptic", ".hjif"
LEAST = -99  # dB: less is rounding of the computation


def lost(path: Path, suffix: str) -> str:
    """Return what a format loses of a file, in dB: of the samples / of the envelope."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            report = write_pattern(Path(folder) / f"a{suffix}", read_pattern(path))
        except BadValue:
            return "refused"
    worst = (max(found[k] for found in report.lost.values()) for k in (0, 1))
    return " / ".join(str(max(LEAST, round(level))) for level in worst)


def rows() -> list[list[str]]:
    """Return the table, with its header."""
    header = ["file", "s", "vibrations", "transients", *(f"as {suffix}" for suffix in FORMATS)]
    made = [header]
    for suffix in FORMATS:
        for path in sorted(FILES.glob(f"*{suffix}")):
            found = read_pattern(path)
            kinds = zip(*((p.voices, p.taps) for p in found.patterns), strict=True)
            counts = [str(sum(len(x) for x in kind)) for kind in kinds]
            losses = [lost(path, other) for other in FORMATS]
            made.append([path.name, f"{found.seconds:.3g}", *counts, *losses])
    return made


if __name__ == "__main__":
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows())
    print(text.getvalue(), end="")
    if "--record" in sys.argv:
        TABLE.write_text(text.getvalue(), encoding="utf-8", newline="\n")
