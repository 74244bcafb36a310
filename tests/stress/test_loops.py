"""All 1000 random force scenes in closed loops: ``make stress``."""

import pytest
from looped import BOUND, MOST, judged

pytestmark = pytest.mark.stress


@pytest.mark.parametrize("hundred", range(10))
def test_no_scene_gives_more_than_the_bound_to_a_hand(hundred):
    rows = [judged(seed) for seed in range(100 * hundred, 100 * hundred + 100)]
    assert max(row["on"] for row in rows) <= BOUND * (1 + 1e-9)
    assert max(row["most"] for row in rows) <= MOST
    assert sum(row["off"] > BOUND for row in rows) > 20, "without it many are active"
