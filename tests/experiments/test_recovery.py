"""Recovery of simulated people: the truth that fits are compared with, and the tables
that benchmarks/recovery.py records.
"""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


BENCH = "recovery"  # see tests/conftest.py


def test_the_truth_is_the_curve_averaged_over_the_session(bench):
    """A normal shift of a normal curve adds its variance; lapses change nothing."""
    assert bench.truth(bench.COMPARISON, bench.Kind(wander=0.5)) == pytest.approx(
        (0.0, math.sqrt(1.25)), abs=1e-3
    )
    for of in bench.DESIGNS:
        assert bench.truth(of, bench.Kind(lapse=0.05)) == pytest.approx((0.0, 1.0), abs=1e-9)
    middle, wide = bench.truth(bench.DETECTION, bench.Kind(wander=0.5))
    drawn = middle + wide * np.log(2)  # where the average curve is at 75 %
    F = 1 - 2.0 ** -np.exp(drawn - 0.5 * np.random.default_rng(1).normal(size=200_000))
    assert F.mean() == pytest.approx(0.75, abs=2e-3)


@pytest.mark.stress
def test_the_table_of_coverage_is_that_of_the_fits(bench):
    """Within what a draw or two at the edge of an interval may change."""
    with (ROOT / "benchmarks" / "results" / "coverage.csv").open(newline="", encoding="utf-8") as f:
        recorded = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(f)]
    for row, before in zip(bench.coverage(), recorded, strict=True):
        assert row == pytest.approx(before, abs=2e-3)


@pytest.mark.parametrize(("name", "short"), [("coverage", "brief_coverage"), ("recovery", "brief")])
def test_the_docs_show_what_is_recorded(bench, name, short):
    def number(v):
        try:
            return float(v)
        except ValueError:
            return v

    with (ROOT / "benchmarks" / "results" / f"{name}.csv").open(newline="", encoding="utf-8") as f:
        recorded = [{k: number(v) for k, v in row.items()} for row in csv.DictReader(f)]
    with (ROOT / "docs" / "explanation" / f"{name}.csv").open(newline="", encoding="utf-8") as f:
        assert list(csv.reader(f)) == getattr(bench, short)(recorded)
