"""Tables against numpy and scipy."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import lut

KNOTS = np.array([-2.0, -1.1, 0.0, 0.3, 0.35, 4.0])
VALUES = np.array([1.0, -1.0, 0.5, 2.0, 2.0, -3.0])
INSIDE = np.concatenate([np.linspace(-2, 4, 997), KNOTS, np.nextafter(KNOTS[1:], -9), np.nextafter(KNOTS[:-1], 9)])


def through(u, **how):
    return stimlib.compile(Scene({"y": lut(Input("x"), KNOTS, VALUES, **how)}), 1000).process(np.asarray(u, float)[None])[0]


@pytest.mark.parametrize(
    ("kind", "f"),
    [
        ("linear", lambda u: np.interp(u, KNOTS, VALUES)),
        ("pchip", PchipInterpolator(KNOTS, VALUES)),
        ("cubic", CubicSpline(KNOTS, VALUES)),
    ],
)
@pytest.mark.parametrize("outside", ["hold", "zero", "error"])
def test_inside(kind, f, outside):
    np.testing.assert_allclose(through(INSIDE, kind=kind, outside=outside), f(INSIDE), rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", ["linear", "pchip", "cubic"])
def test_knots_are_hit(kind):
    np.testing.assert_allclose(through(KNOTS, kind=kind), VALUES, rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", ["linear", "pchip", "cubic"])
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
        proc = stimlib.compile(Scene({"y": lut(Input("x"), KNOTS, VALUES, outside=outside)}), 1000)
        proc.process(np.array([[0.0, np.nan]]))
        assert proc.fault == ("y", 1), outside


def test_a_function_is_sampled_at_the_knots():
    y = stimlib.compile(Scene({"y": lut(Input("x"), np.linspace(0, 1, 11), np.square)}), 1000).process(np.array([[0.5, 0.55]]))
    np.testing.assert_allclose(y, [[0.25, 0.305]], atol=1e-15)
