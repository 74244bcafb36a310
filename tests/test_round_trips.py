"""Block, data, fit, block: every fit finds what made its data, with noise.

A tenth of the draws of ``tests/stress/test_fits.py``, and of the cases those that take
less than a second a draw; those that JAX compiles take 4 to 8.
"""

import importlib
import sys
from pathlib import Path

import pytest
from scipy.stats import binom

BENCHMARKS = str(Path(__file__).parents[1] / "benchmarks")
sys.path.insert(0, BENCHMARKS)
fits = importlib.import_module("fits")
sys.path.remove(BENCHMARKS)  # it has modules with the names of folders of tests
CASES = fits.cases()
COMPILED = {name for name in CASES if name.startswith("scene")} | {"frame"}  # by JAX, each draw
SURE = 1e-4  # that a right fit fails one of these tests
LATE = 1e-8  # of what is played, of the peak
BIAS = 0.25  # of the spread: an interval around such a middle still holds 94 %


def check(name, draws):
    rows = fits.measured(CASES[name], draws)
    for row in rows:
        if row["in interval %"] != "":
            assert SURE < binom.cdf(round(row["in interval %"] * draws / 100), draws, 0.95), row
        assert abs(row["bias %"]) < 4.5 * row["its error %"] + BIAS * row["spread %"], row
        assert not row["played"] > LATE, row
    return rows


@pytest.mark.parametrize("name", [name for name in CASES if name not in COMPILED])
def test_a_fit_finds_what_made_its_data(name):
    check(name, 20)
