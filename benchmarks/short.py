"""What ``stimlib bench`` measures and draws.

    python benchmarks/short.py             print
    python benchmarks/short.py --record    and keep both

The figures are kept in results/short.csv, the picture in docs/pictures/speed.svg.
"""

from __future__ import annotations

from pathlib import Path

from bench import TIMES, Row, options, row, save

from stimlib.speed.bench import Speed, measure, picture
from stimlib.speed.timing import machine

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "speed.svg"


def rows_of(s: Speed) -> list[Row]:
    """A figure, and what stands beside it."""
    rows = [row(s.what, s.ns)]
    if s.peer_ns is not None and s.times is not None:
        rows += [
            row(f"{s.what}: {s.peer}", s.peer_ns),
            row(f"{s.what}: ratio: {s.peer} / stimlib", s.times, TIMES),
        ]
    return (
        rows if s.share is None else [*rows, row(f"{s.what}: share of the limit", s.share, TIMES)]
    )


def main() -> None:
    given = options(__doc__).parse_args()
    speeds = measure()
    save("short", [row(machine()), *(r for s in speeds for r in rows_of(s))], given.record)
    if given.record:
        picture(speeds, PICTURE)


if __name__ == "__main__":
    main()
