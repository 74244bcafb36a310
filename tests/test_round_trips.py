"""Block, data, fit, block: every fit finds what made its data, with noise.

In make stress all cases: 200 draws each, and 20 of those that JAX compiles, which take
4 to 8 s a draw; else 20 draws of those that it does not.
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
DRAWS = [(name, 20) for name in CASES if name not in COMPILED]
DRAWS += [
    pytest.param(name, 20 if name in COMPILED else 200, marks=pytest.mark.stress) for name in CASES
]
SURE = {20: 1e-4, 200: 1e-3}  # that a right interval holds the truth as seldom as is refused
LATE = 1e-8  # of what is played, of the peak
BIAS = 0.25  # of the spread: an interval around such a middle still holds 94 %


@pytest.mark.parametrize(("name", "draws"), DRAWS)
def test_a_fit_finds_what_made_its_data(name, draws):
    """And its intervals hold the truth as often as they say."""
    for row in fits.measured(CASES[name], draws):
        if row["in interval %"] != "":
            held = round(row["in interval %"] * draws / 100)
            assert SURE[draws] < binom.cdf(held, draws, 0.95), row
        assert abs(row["bias %"]) < 4.5 * row["its error %"] + BIAS * row["spread %"], row
        assert not row["played"] > LATE, row
