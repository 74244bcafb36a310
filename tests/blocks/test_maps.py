"""Functions of the present sample against numpy."""

import numpy as np
import pytest

import stimlib
from stimlib import BadValue, Input, Param, Scene, blocks, constant

x, y, z = Input("x"), Input("y"), Input("z")
NEAR = 1e-15


@pytest.mark.parametrize(
    ("block", "f"),
    [
        (x + y, np.add), (x - y, np.subtract), (x * y, np.multiply), (x / (2.0 + abs(y)), lambda a, b: a / (2 + abs(b))),
        (blocks.maximum(x, y), np.maximum), (blocks.minimum(x, y), np.minimum), (x > y, lambda a, b: 1.0 * (a > b)),
        (x >= y, lambda a, b: 1.0 * (a >= b)), (x < y, lambda a, b: 1.0 * (a < b)), (x <= y, lambda a, b: 1.0 * (a <= b)),
        (blocks.where(x, y, -y), lambda a, b: np.where(a > 0, b, -b)),
        (blocks.clip(x, -1.0, y), lambda a, b: np.minimum(np.maximum(a, -1), b)),
        (-x + 0 * y, lambda a, b: -a), (abs(x) + 0 * y, lambda a, b: abs(a)),
        (blocks.nonzero(x) + 0 * y, lambda a, b: 1.0 * (a != 0)),
        (blocks.sqrt(abs(x)) + 0 * y, lambda a, b: np.sqrt(abs(a))),
    ],
)  # fmt: skip
def test_exact(block, f):
    u = np.random.default_rng(0).choice([-2.5, -1.0, -0.0, 0.0, 0.3, 1.0, 7.0], (2, 500))
    proc = stimlib.compile(Scene({"out": block}), 1000)
    rows = {"x": u[0], "y": u[1]}
    np.testing.assert_array_equal(proc.process(np.array([rows[n] for n in proc.inputs]))[0], f(*u))


@pytest.mark.parametrize(
    ("make", "f"), [(blocks.exp, np.exp), (blocks.sin, np.sin), (blocks.cos, np.cos), (blocks.tanh, np.tanh)]
)
def test_transcendental(make, f):
    u = 3 * np.random.default_rng(0).standard_normal((1, 1000))
    np.testing.assert_allclose(stimlib.compile(Scene({"out": make(x)}), 1000).process(u), f(u), rtol=4e-16, atol=1e-16)


def test_log():
    u = np.abs(np.random.default_rng(0).standard_normal((1, 1000)))
    np.testing.assert_allclose(stimlib.compile(Scene({"out": blocks.log(x)}), 1000).process(u), np.log(u), rtol=4e-16, atol=1e-16)


def test_nan_in_comparisons():
    """nan > x is false; the larger of nan and x is nan if the first is."""
    outputs = {"g": x > y, "w": blocks.where(x, 1.0, 2.0), "n": blocks.nonzero(x), "m": blocks.nonzero(blocks.maximum(y, x))}
    proc = stimlib.compile(Scene(outputs), 1000)
    u = {"x": [np.nan], "y": [1.0]}
    np.testing.assert_array_equal(proc.process(np.array([u[n] for n in proc.inputs]))[:, 0], [0, 2, 1, 1])


def test_limits_that_are_swapped_are_refused():
    x = Input("F", "N")
    with pytest.raises(BadValue, match="clip: low = 5 must not be above high = -5; give the lower limit first"):
        blocks.clip(x, constant(5.0, "N"), constant(-5.0, "N"))
    blocks.clip(x, constant(-5.0, "N"), Param("top", -6.0, "N"))  # a live limit may pass the other: the upper one holds
