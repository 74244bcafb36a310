"""Python's operators and numpy's functions on blocks: the right block, or an error that
names the remedy.
"""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from laws import assert_same, played

import stimlib
from stimlib import Input, Param, Scene, blocks, constant
from stimlib.core import maths
from stimlib.core.graph import Block, Equal, NotEqual, reach
from stimlib.core.units import ONE, unit
from stimlib.errors import BadValue, SceneError, StimlibError, UnitError

x, n, m = Input("x", "m"), Input("n"), Input("m")
U = np.array([[0.0, -0.0, 1.0, -2.5, 0.1 + 0.2, 0.3, 5e-324, np.inf, np.nan, 7.0]])


def samples(block, u=U, target="python"):
    with np.errstate(all="ignore"):
        return played(block, *u, target=target)


# == and != ----------------------------------------------------------------------------
@pytest.mark.parametrize("target", ["python", "numba"])
def test_equal_is_a_block_of_1_and_0(target):
    u = U[:, [0, 1, 2, 3, 4, 5, 6, 9]]
    np.testing.assert_array_equal(samples(n == 0, u, target), [1, 1, 0, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(samples(0.3 == n, u, target), [0, 0, 0, 0, 0, 1, 0, 0])
    np.testing.assert_array_equal(
        samples(n != np.float64(0.0), u, target), [0, 0, 1, 1, 1, 1, 1, 1]
    )
    np.testing.assert_array_equal(
        samples(blocks.where(n == 0, 5.0, 6.0), u, target), [5, 5, 6, 6, 6, 6, 6, 6]
    )


def test_nan_and_infinities_are_compared_as_floats():
    np.testing.assert_array_equal(samples(n == n), [1, 1, 1, 1, 1, 1, 1, 1, 0, 1])
    np.testing.assert_array_equal(samples(n != n), [0, 0, 0, 0, 0, 0, 0, 0, 1, 0])


@given(st.floats(), st.floats())
def test_any_two_floats(a, b):
    """A map of one sample, which is all that a comparison is."""
    for block, wanted in ((n == m, a == b), (n != m, a != b)):
        assert type(block).step((), (), np.float64(a), np.float64(b))[0] == float(wanted)


def test_equal_compares_units_and_what_is_no_number():
    assert (
        (x == 0).dim == (0 != x).dim == ONE
        and isinstance(x == 0, Equal)
        and isinstance(x != 0, NotEqual)
    )
    with pytest.raises(UnitError, match=r"constant\(1, 'm'\)"):
        _ = x == 1.0
    for other in (None, "x", [1.0], np.ones(3), object()):
        for f in (lambda o=other: x == o, lambda o=other: x != o):
            with pytest.raises(BadValue, match="expected a block or a number"):
                f()


def test_blocks_are_keys_by_identity():
    twin = Input("x", "m")
    assert (
        len({x, twin, n, x}) == 3
        and {x: 1, twin: 2}[twin] == 2
        and [x, n].index(x) == 0
        and x in [x]
    )
    assert hash(x) == object.__hash__(x)
    with pytest.raises(StimlibError, match="no truth value"):
        _ = x in [twin]


# Powers -------------------------------------------------------------------------------
@pytest.mark.parametrize("k", [1, 2, 3, 5, 6, 17, 64, -1, -3, np.int64(4), 2.0])
def test_whole_powers_are_products(k):
    u = np.array([[0.5, -1.1, 2.0, 1.0]])

    def power(v, k):
        if k == 1:
            return v
        half = power(v, k // 2)
        return half * half * v if k % 2 else half * half

    wanted = power(u[0], int(abs(k))) if k > 0 else 1.0 / power(u[0], int(-k))
    for target in ("python", "numba"):
        assert_same(samples(n**k, u, target), wanted)
    np.testing.assert_allclose(wanted, u[0] ** float(k), rtol=1e-14)
    assert (x**k).dim == unit("m") ** float(k)


def test_other_powers():
    assert (x**0.5).dim == unit("m") ** 0.5
    assert_same(samples(n**0.5, np.array([[2.0, 9.0]])), np.sqrt([2.0, 9.0]))
    assert_same(samples(n**0 + 0.0 * n, np.array([[2.0, 0.0]])), np.ones(2))
    assert (x**0).dim == ONE
    for f in (
        lambda: n**1.7,
        lambda: n**65,
        lambda: n**np.nan,
        lambda: n**np.inf,
        lambda: n**10**400,
    ):
        with pytest.raises(BadValue, match=r"whole number from -64 to 64.*exp\(n \* log\(x\)\)"):
            f()
    for f in (lambda: n**m, lambda: n ** "2", lambda: 2**n, lambda: np.float64(2) ** n):
        with pytest.raises(BadValue, match="the exponent must be a number; a"):
            f()


def test_the_mathematics_of_steps_takes_numbers_alone():
    for f in (maths.sin, maths.exp, maths.tanh, maths.log, maths.cos):
        with pytest.raises(SceneError, match="stimlib.blocks"):
            f(x)


# numpy, math and the rest -------------------------------------------------------------
@pytest.mark.parametrize(
    "f",
    [
        np.sin,
        np.cos,
        np.tanh,
        np.exp,
        np.log,
        np.sqrt,
        np.abs,
        np.negative,
        np.square,
        lambda v: np.power(v, 3),
        lambda v: np.maximum(v, 1.5),
        lambda v: np.minimum(1.5, v),
        lambda v: np.add(v, 2.0),
        lambda v: np.divide(1.0, v),
        np.reciprocal,
        lambda v: np.float64(2.0) * v,
        lambda v: np.float32(2.0) - v,
        lambda v: np.array(3.0) * v,
    ],
)
def test_numpy_functions_are_blocks(f):
    u = np.array([[0.25, 1.0, 3.5]])
    assert isinstance(f(n), Block)
    np.testing.assert_allclose(samples(f(n), u), f(u[0]), rtol=4e-16)
    same = [type(b).__name__ for b in reach([np.sin(n)])]
    assert same == ["Input", "Sin"]


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
    with pytest.raises(StimlibError) as e:
        f()
    assert remedy in str(e.value), e.value


@pytest.mark.parametrize(
    "f",
    [
        lambda: 10**400 * x,
        lambda: Param("a", 10**400),
        lambda: constant(-(10**400)),
        lambda: x > 10**400,
    ],
)
def test_numbers_beyond_floats(f):
    with pytest.raises(BadValue, match="beyond what a float can hold"):
        f()


def test_a_comparison_in_a_picture(tmp_path):
    stimlib.draw(Scene({"y": (n == 0) + (m != 0)}), tmp_path / "s.svg")
    text = (tmp_path / "s.svg").read_text()
    assert "≠" in text or "&#8800;" in text
