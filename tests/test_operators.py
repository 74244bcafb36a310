"""Python's operators and numpy's functions on blocks: the right block, or an error that
names the remedy.
"""

import math

import numpy as np
import pytest
from laws import assert_same, played
from refusals import refused

from stimlib import BadValue, Input, Param, SceneError, StimlibError, UnitError, blocks, constant
from stimlib.core import maths
from stimlib.core.graph import Block, Equal, NotEqual
from stimlib.core.units import ONE, unit

x, n, m = Input("x", "m"), Input("n"), Input("m")
U = np.array([[0.0, -0.0, 1.0, -2.5, 0.1 + 0.2, 0.3, 5e-324, np.inf, np.nan, 7.0]])


def samples(block, u=U, target="python"):
    with np.errstate(all="ignore"):
        return played(block, *u, target=target)


# == and != ----------------------------------------------------------------------------
@pytest.mark.parametrize("target", ["python", "llvm"])
def test_equal_is_a_block_of_1_and_0(target):
    outputs = {
        "zero": n == 0,
        "other": 0.3 == n,
        "not": n != np.float64(0.0),
        "where": blocks.where(n == 0, 5.0, 6.0),
        "itself": n == n,
        "no_number": n != n,
    }
    wanted = [
        [1, 1, 0, 0, 0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 1, 0, 0, 0, 0],
        [0, 0, 1, 1, 1, 1, 1, 1, 1, 1],
        [5, 5, 6, 6, 6, 6, 6, 6, 6, 6],
        [1, 1, 1, 1, 1, 1, 1, 1, 0, 1],
        [0, 0, 0, 0, 0, 0, 0, 0, 1, 0],
    ]
    assert samples(outputs, target=target).tolist() == wanted


def test_equal_compares_units_and_what_is_no_number():
    assert (x == 0).dim == (0 != x).dim == ONE
    assert isinstance(x == 0, Equal) and isinstance(x != 0, NotEqual)
    refused(UnitError, r"constant\(1, 'm'\)", lambda: x == 1.0)
    for other in (None, "x", [1.0], np.ones(3), object()):
        refused(BadValue, "a block or a number", lambda: x == other)  # noqa: B023
        refused(BadValue, "a block or a number", lambda: x != other)  # noqa: B023
    twin = Input("x", "m")
    assert len({x, twin, n, x}) == 3 and {x: 1, twin: 2}[twin] == 2 and [x, n].index(x) == 0
    refused(StimlibError, "no truth value", lambda: x in [twin])


# Powers -------------------------------------------------------------------------------
@pytest.mark.parametrize("k", [1, 2, 6, 17, 64, -3, np.int64(4), 2.0])
def test_whole_powers_are_products(k):
    u = np.array([[0.5, -1.1, 2.0, 1.0]])

    def power(v, k):
        if k == 1:
            return v
        half = power(v, k // 2)
        return half * half * v if k % 2 else half * half

    wanted = power(u[0], int(abs(k))) if k > 0 else 1.0 / power(u[0], int(-k))
    for target in ("python", "llvm"):
        assert_same(samples(n**k, u, target), wanted)
    np.testing.assert_allclose(wanted, u[0] ** float(k), rtol=1e-14)
    assert (x**k).dim == unit("m") ** float(k)


def test_other_powers():
    assert (x**0.5).dim == unit("m") ** 0.5 and (x**0).dim == ONE
    assert_same(samples(n**0.5, np.array([[2.0, 9.0]])), np.sqrt([2.0, 9.0]))
    assert_same(samples(n**0 + 0.0 * n, np.array([[2.0, 0.0]])), np.ones(2))
    for k in (1.7, 65, np.nan, np.inf, 10**400):
        refused(BadValue, r"from -64 to 64.*exp\(n \* log\(x\)\)", pow, n, k)
    for a, b in ((n, m), (n, "2"), (2, n), (np.float64(2), n)):
        refused(BadValue, "the exponent must be a number", pow, a, b)
    for f in (maths.sin, maths.exp, maths.tanh, maths.log, maths.cos):
        refused(SceneError, "stimlib.blocks", f, x)


# numpy, math and the rest -------------------------------------------------------------
@pytest.mark.parametrize(
    "f",
    [
        *[np.sin, np.cos, np.tanh, np.exp, np.log, np.sqrt, np.abs, np.negative, np.square],
        np.reciprocal,
        lambda v: np.power(v, 3),
        lambda v: np.maximum(v, 1.5),
        lambda v: np.minimum(1.5, v),
        lambda v: np.add(v, 2.0),
        lambda v: np.divide(1.0, v),
        lambda v: np.float32(2.0) - v,
        lambda v: np.array(3.0) * v,
        lambda v: np.float64(2.0) / v,
        lambda v: 1.0 * (np.uint8(2) > v) + 2.0 * (v > np.float64(2.0)),
        lambda v: 1.0 * (np.float64(1.0) <= v) + 2.0 * (v >= np.float32(1.0)),
    ],
)
def test_numpy_functions_are_blocks(f):
    u = np.array([[0.25, 1.0, 3.5]])
    assert isinstance(f(n), Block)
    np.testing.assert_allclose(samples(f(n), u), f(u[0]), rtol=4e-16)


@pytest.mark.parametrize(
    ("f", "remedy"),
    [
        (lambda: n % 2, "bump"),
        (lambda: 7 % n, "bump"),
        (lambda: n // 2, "lut"),
        (lambda: divmod(n, 2), "bump"),
        (lambda: n << 1, "delay(x, samples=n)"),
        (lambda: 1 >> n, "delay"),
        (lambda: (n > 0) & (m > 0), "minimum(a, b)"),
        (lambda: (n > 0) | (m > 0), "maximum(a, b)"),
        (lambda: ~(n > 0), "1 - a"),
        (lambda: n ^ 2, "x ** n"),
        (lambda: n @ m, "fir"),
        (lambda: not n, "1 - a"),
        (lambda: max(n, 0), "where"),
        (lambda: 1 if n > 0 else 2, "where"),
        (lambda: n > 0 and m > 0, "minimum(a, b)"),
        (lambda: 0 < n < 1, "where"),
        (lambda: math.sin(n), "sin"),
        (lambda: math.sqrt(n), "stimlib.blocks"),
        (lambda: float(n), "render"),
        (lambda: int(n), "render"),
        (lambda: complex(n), "render"),
        (lambda: range(n), "render"),
        (lambda: round(n), "lut"),
        (lambda: math.floor(n), "lut"),
        (lambda: math.ceil(n), "lut"),
        (lambda: math.trunc(n), "lut"),
        (lambda: len(n), "delay(x, samples=1)"),
        (lambda: n[0], "delay"),
        (lambda: n[-1:], "delay"),
        (lambda: list(n), "delay"),
        (lambda: [v for v in n], "delay"),
        (lambda: 1.0 in n, "delay"),
        (lambda: np.arctan(n), "stimlib.blocks"),
        (lambda: np.floor(n), "lut"),
        (lambda: np.mod(n, 2.0), "bump"),
        (lambda: np.floor_divide(1.0, n), "bump"),
        (lambda: np.sign(n), "(x > 0) - (x < 0)"),
        (lambda: np.tan(n), "sin(x) / cos(x)"),
        (lambda: np.hypot(n, m), "sqrt(a**2 + b**2)"),
        (lambda: np.logical_and(n > 0, m > 0), "minimum(a, b)"),
        (lambda: np.log10(n), "math.log(b)"),
        (lambda: np.isnan(n), "x != x"),
        (lambda: np.mean(n), "stimlib.blocks"),
        (lambda: np.where(n == 0, 1.0, 2.0), "where of stimlib.blocks"),
        (lambda: np.array([n, m]), "stimlib.blocks"),
        (lambda: np.asarray(n, float), "stimlib.blocks"),
        (lambda: np.add.reduce(n), "stimlib.blocks"),
        (lambda: np.sin(n, out=np.ones(2)), "stimlib.blocks"),
        (lambda: np.ones(2) * n, "a block or a number"),
        (lambda: np.ones(2) == n, "a block or a number"),
    ],
)
def test_what_has_no_meaning_names_the_remedy(f, remedy):
    assert remedy in str(refused(StimlibError, None, f))


def test_numbers_beyond_floats():
    for f in (constant, lambda v: v * x, lambda v: Param("a", v), lambda v: x > v):
        refused(BadValue, "what a float can hold", f, -(10**400))
