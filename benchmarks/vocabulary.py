"""What a loop costs: against the same recursion written as one block, and what it takes
to compile.

    python benchmarks/vocabulary.py             print
    python benchmarks/vocabulary.py --record    and keep the figures

They are kept in results/vocabulary.csv.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from bench import TIMES, Row, main, row, under
from timing import interleaved, medians, ratio

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import delay, exp, loop
from stimlib.core import maths
from stimlib.core.graph import Block
from stimlib.core.maths import flush, settle

FS, N, BLOCK = 8000, 1 << 16, 1024


class Value(NamedTuple):
    y: float


class Two(NamedTuple):
    y: float
    before: float


class Moved(NamedTuple):
    v: float
    z: float


def bristles(v, z):
    """The deflection of bristles at velocity v, one sample after z (LuGre)."""
    s = v * 100.0
    return (z + 1e-3 * v) / (1.0 + abs(v) / (1.0 + 0.5 * maths.exp(-(s * s))))


@dataclass(frozen=True, eq=False)
class OnePole(Block):
    """y += 0.1 (x - y)."""

    x: Block

    def design(self, fs):
        return (), Value(0.0)

    @staticmethod
    def step(p, s, x):
        y = settle(s.y + 0.1 * (x - s.y))
        return y, Value(y)


@dataclass(frozen=True, eq=False)
class TwoPole(Block):
    """y = x + 1.6 y[n-1] - 0.8 y[n-2]."""

    x: Block

    def design(self, fs):
        return (), Two(0.0, 0.0)

    @staticmethod
    def step(p, s, x):
        y = settle(x + 1.6 * s.y - 0.8 * s.before)
        return y, Two(y, s.y)


@dataclass(frozen=True, eq=False)
class Bristles(Block):
    """LuGre's bristles at a given velocity."""

    v: Block

    def design(self, fs):
        return (), Value(0.0)

    @staticmethod
    def step(p, s, v):
        z = flush(bristles(v, s.y))
        return z, Value(z)


@dataclass(frozen=True, eq=False)
class Mass(Block):
    """A mass on LuGre's bristles."""

    x: Block

    def design(self, fs):
        return (), Moved(0.0, 0.0)

    @staticmethod
    def step(p, s, x):
        z = flush(bristles(s.v, s.z))
        v = flush(s.v + 0.01 * (0.5 * x - 1e3 * z - 0.4 * s.v))
        return v, Moved(v, z)


def bristled(v):
    """Bristles, as a loop."""
    s = v * 100.0
    return loop(lambda z: (z + 1e-3 * v) / (1.0 + abs(v) / (1.0 + 0.5 * exp(-(s * s)))))


X = Input("x")
PAIRS = {
    "one pole": (OnePole(X), loop(lambda y: y + 0.1 * (X - y))),
    "two poles": (TwoPole(X), loop(lambda y: X + 1.6 * y - 0.8 * delay(y, samples=1))),
    "LuGre of a given velocity": (Bristles(X), bristled(X)),
    "LuGre and a mass": (
        Mass(X),
        loop(lambda v: v + 0.01 * (0.5 * X - 1e3 * bristled(v) - 0.4 * v)),
    ),
}


def measure() -> list[Row]:
    """All rows."""
    rows: list[Row] = []
    x = np.random.default_rng(1).standard_normal((N // BLOCK, 1, BLOCK))
    for name, blocks in PAIRS.items():
        jobs, first = {}, {}
        for how, y in (("nothing", X), ("a block", blocks[0]), ("a loop", blocks[1])):
            began = time.process_time()
            proc = stimlib.compile(Scene({"y": y}), FS)
            first[how] = time.process_time() - began
            jobs[how] = lambda proc=proc: [proc.process(part) for part in x]
        a, b = (np.concatenate([part[0] for part in jobs[how]()]) for how in ("a block", "a loop"))
        assert np.abs(a - b).max() <= 1e-12 * np.abs(a).max(), name
        times = interleaved(jobs)
        nothing = medians(times)["nothing"]
        found = [
            row(how, (medians(times)[how] - nothing) / N * 1e9) for how in ("a block", "a loop")
        ]
        found.append(
            row("ratio: a loop / a block, scene and all", ratio(times, "a loop", "a block"), TIMES)
        )
        found.append(row("compile the loop, or load it", first["a loop"], "s"))
        rows += under(name, found)
    return rows


if __name__ == "__main__":
    main("vocabulary", __doc__, measure)
