"""Every fit over 200 noisy draws, as docs/explanation/fits.rst has them."""

import pytest
from scipy.stats import binom
from test_round_trips import CASES, COMPILED, check

pytestmark = pytest.mark.stress
FEWEST = binom.ppf(1e-3, 200, 0.95) / 2  # percent


@pytest.mark.parametrize("name", CASES)
def test_intervals_hold_the_truth_as_often_as_they_say(name):
    rows = check(name, 200)
    for row in rows:
        assert row["in interval %"] == "" or row["in interval %"] >= FEWEST, row
        assert name in COMPILED or row["seconds"] < 1, row
