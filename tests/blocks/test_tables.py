"""Tables against numpy and scipy."""

import numpy as np
import pytest
from laws import lawful

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import lut
from stimlib.errors import BadValue

KNOTS = np.array([-2.0, -1.1, 0.0, 0.3, 0.35, 4.0])
VALUES = np.array([1.0, -1.0, 0.5, 2.0, 2.0, -3.0])
INSIDE = np.concatenate(
    [np.linspace(-2, 4, 997), KNOTS, np.nextafter(KNOTS[1:], -9), np.nextafter(KNOTS[:-1], 9)]
)


def through(u, **how):
    return stimlib.compile(Scene({"y": lut(Input("x"), KNOTS, VALUES, **how)}), 1000).process(
        np.asarray(u, float)[None]
    )[0]


@pytest.mark.parametrize("kind", ["linear", "pchip", "cubic", "polynomial"])
@pytest.mark.parametrize("outside", ["hold", "zero", "error"])
def test_inside(kind, outside):
    lawful(lut(Input("x"), KNOTS, VALUES, kind, outside), 1000, x=INSIDE)


@pytest.mark.parametrize("kind", ["linear", "pchip", "cubic", "polynomial"])
def test_knots_are_hit(kind):
    np.testing.assert_allclose(through(KNOTS, kind=kind), VALUES, rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", ["linear", "pchip", "cubic", "polynomial"])
def test_outside(kind):
    u = [-2.0001, -1e300, 4.0001, 1e300, -np.inf, np.inf]
    np.testing.assert_allclose(through(u, kind=kind), [1, 1, -3, -3, 1, -3], atol=1e-13)
    assert not through(u, kind=kind, outside="zero").any()


def test_outside_is_a_fault_where_it_should_be():
    proc = stimlib.compile(Scene({"y": lut(Input("x"), KNOTS, VALUES, outside="error")}), 1000)
    proc.process(np.array([[0.0, 4.0, 4.1, 0.0]]))
    assert proc.fault == ("y", 2)


def test_nan_is_a_fault_whatever_is_outside():
    for outside in ("hold", "zero", "error"):
        for kind in ("linear", "polynomial"):
            proc = stimlib.compile(
                Scene({"y": lut(Input("x"), KNOTS, VALUES, kind, outside)}), 1000
            )
            proc.process(np.array([[0.0, np.nan]]))
            assert proc.fault == ("y", 1), (kind, outside)


def test_a_function_is_sampled_at_the_knots():
    y = stimlib.compile(
        Scene({"y": lut(Input("x"), np.linspace(0, 1, 11), np.square)}), 1000
    ).process(np.array([[0.5, 0.55]]))
    np.testing.assert_allclose(y, [[0.25, 0.305]], atol=1e-15)


def test_a_polynomial_has_at_most_8_knots():
    knots = np.arange(8.0)
    proc = stimlib.compile(
        Scene({"y": lut(Input("x"), 10 + 1e-3 * knots, np.cos(knots), "polynomial")}), 1000
    )
    np.testing.assert_allclose(
        proc.process(10 + 1e-3 * knots[None])[0], np.cos(knots), rtol=0, atol=1e-13
    )
    with pytest.raises(BadValue, match="9 knots swings between them; at most 8"):
        lut(Input("x"), np.arange(9.0), np.arange(9.0), "polynomial")
    for knots, match in (([0, 1, 1], "must rise"), ([0, 1], "one length")):
        with pytest.raises(BadValue, match=match):
            lut(Input("x"), knots, [1, 2, 3], "polynomial")
    with pytest.raises(BadValue, match="has 201 letters; at most 200"):
        lut(Input("x"), [0, 1], [1, 2], 201 * "l")
    steep = Scene({"y": lut(Input("x"), [0, 1e-200, 2e-200], [0, 1e200, 3], "polynomial")})
    with pytest.raises(BadValue, match="knots are too unequal"):
        stimlib.compile(steep, 1000)
    with pytest.raises(BadValue, match="hold, zero, error"):
        lut(Input("x"), [0, 1], [1, 2], "polynomial", outside="extend")
