"""Functions of the present sample; ``checks.families`` compares them with numpy."""

import numpy as np
import pytest
from laws import played

from stimlib import BadValue, Input, Param, blocks, constant

x, y = Input("x"), Input("y")


def test_nan_in_comparisons():
    """nan > x is false; the larger of nan and x is nan if the first is."""
    outputs = {
        "g": x > y,
        "w": blocks.where(x, 1.0, 2.0),
        "n": blocks.nonzero(x),
        "m": blocks.nonzero(blocks.maximum(y, x)),
    }
    np.testing.assert_array_equal(played(outputs, {"x": [np.nan], "y": [1.0]})[:, 0], [0, 2, 1, 1])


def test_limits_that_are_swapped_are_refused():
    x = Input("F", "N")
    with pytest.raises(
        BadValue, match="clip: low = 5 must not be above high = -5; give the lower limit first"
    ):
        blocks.clip(x, constant(5.0, "N"), constant(-5.0, "N"))
    # a live limit may pass the other: the upper one holds
    blocks.clip(x, constant(-5.0, "N"), Param("top", -6.0, "N"))
