"""The whole path: an hour of the two-finger squeeze from the command line into a file,
and what of that the processor takes.

    python benchmarks/path.py             print
    python benchmarks/path.py --record    and keep the figures in results/path.csv

``stimlib render`` runs in a process of its own, all cores free; the processor and the
motion alone in this one, in turns with it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from functools import partial

import numpy as np
from bench import TIMES, Row, main, row
from noise_chain import BLOCK, FS, puller
from timing import interleaved, medians, ratio

from stimlib.motion.generators import minimum_jerk
from stimlib.scenes import squeeze

SECONDS, HAND = 3600, minimum_jerk(0.02)
RENDER = (
    f"-m stimlib render squeeze --motion minimum_jerk(depth=0.02) --seconds {SECONDS} --full-scale"
    " 50 --quiet --out".split()
)


def motion() -> None:
    """The hand's positions, in blocks."""
    for start in range(0, int(SECONDS * FS), BLOCK):
        HAND(np.arange(start, start + BLOCK) / FS)


def measure(rounds: int = 5) -> list[Row]:
    """All rows."""
    with tempfile.TemporaryDirectory() as folder:
        out = f"{folder}/hour.wav"
        jobs = {
            "stimlib render": partial(subprocess.run, [sys.executable, *RENDER, out], check=True),
            "the processor alone": puller(squeeze(), HAND(np.arange(SECONDS * FS) / FS)),
            "the motion alone": motion,
        }
        times = interleaved(jobs, rounds, 1)
        size = os.path.getsize(out)
    rows = [
        row(f"hour of squeeze, 2 fingers, 8 kHz: {what}", seconds, "s")
        for what, seconds in medians(times).items()
    ]
    rows.append(row("hour of squeeze: the file", size / 1e6, "MB"))
    return rows + [
        row(f"ratio: {what} / stimlib render", ratio(times, what, "stimlib render"), TIMES)
        for what in list(jobs)[1:]
    ]


if __name__ == "__main__":
    main("path", __doc__, measure, cores=None)
