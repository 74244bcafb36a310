"""Functions of two places against scipy."""

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib.blocks import lut2
from stimlib.core.units import unit
from stimlib.errors import BadValue, UnitError

RNG = np.random.default_rng(3)
TABLE = RNG.standard_normal((7, 5))
ORIGIN, SPACING = (-0.3, 2.0), (0.25, 1.5)
XS, YS = (o + d * np.arange(n) for o, d, n in zip(ORIGIN, SPACING, TABLE.shape, strict=True))
X, Y = Input("x", "m"), Input("y", "s")
PLACES = np.stack([RNG.uniform(XS[0], XS[-1], 400), RNG.uniform(YS[0], YS[-1], 400)])


def through(places, kind, table=TABLE, spacing=SPACING, origin=ORIGIN):
    z = lut2(X, Y, table, spacing, origin, kind)
    scene = Scene({"value": z.value, "slope_x": z.slope_x, "slope_y": z.slope_y})
    return stimlib.compile(scene, 1000).process(np.asarray(places, float))


def test_linear_is_that_of_scipy():
    f = RegularGridInterpolator((XS, YS), TABLE)
    value, slope_x, slope_y = through(PLACES, "linear")
    np.testing.assert_allclose(value, f(PLACES.T), rtol=0, atol=1e-13)
    for slope, way in ((slope_x, [1e-6, 0.0]), (slope_y, [0.0, 1e-6])):  # straight within a piece
        inside = np.all(
            np.floor((PLACES.T + way - ORIGIN) / SPACING)
            == np.floor((PLACES.T - way - ORIGIN) / SPACING),
            axis=1,
        )
        rise = (
            f(np.clip(PLACES.T + way, [XS[0], YS[0]], [XS[-1], YS[-1]])) - f(PLACES.T - way)
        ) / 2e-6
        np.testing.assert_allclose(slope[inside], rise[inside], rtol=0, atol=1e-8)


@pytest.mark.parametrize("shape", [(7, 5), (4, 7)])
def test_cubic_is_that_of_scipy(shape):
    """A tensor product of cubic splines whose third derivative goes on beside the edges
    (not-a-knot).
    """
    table = np.random.default_rng(4).standard_normal(shape)
    i, j = (o + d * np.arange(n) for o, d, n in zip(ORIGIN, SPACING, shape, strict=True))
    x, y = np.clip(PLACES[0], i[0], i[-1]), np.clip(PLACES[1], j[0], j[-1])
    f = RectBivariateSpline(i, j, table, s=0)
    want = [f(x, y, dx, dy, grid=False) for dx, dy in ((0, 0), (1, 0), (0, 1))]
    np.testing.assert_allclose(through([x, y], "cubic", table)[0], want[0], rtol=0, atol=1e-12)
    inner = (x < i[-1]) & (y < j[-1])
    np.testing.assert_allclose(
        through([x, y], "cubic", table)[1:, inner], np.array(want[1:])[:, inner], rtol=0, atol=1e-11
    )


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_points_are_hit_and_edges_held(kind):
    i, j = np.meshgrid(XS, YS, indexing="ij")
    np.testing.assert_allclose(
        through([i.ravel(), j.ravel()], kind)[0], TABLE.ravel(), rtol=0, atol=1e-13
    )
    edge = through([[XS[0], XS[-1], XS[2], XS[2]], [YS[1], YS[1], YS[0], YS[-1]]], kind)
    for far in (1e-3, 1e300, np.inf):
        value, slope_x, slope_y = through(
            [[XS[0] - far, XS[-1] + far, XS[2], XS[2]], [YS[1], YS[1], YS[0] - far, YS[-1] + far]],
            kind,
        )
        np.testing.assert_allclose(value, edge[0], rtol=0, atol=1e-13)
        np.testing.assert_array_equal(slope_x[:2], 0.0)
        np.testing.assert_array_equal(slope_y[2:], 0.0)
        np.testing.assert_allclose(slope_y[:2], edge[2, :2], rtol=0, atol=1e-12)
    for place in ([np.nan, 3.0], [0.0, np.nan]):
        z = lut2(X, Y, TABLE, SPACING, ORIGIN, kind)
        for out in (z.value, z.slope_x, z.slope_y):
            proc = stimlib.compile(Scene({"z": out}), 1000, "python")
            proc.process(np.array([[0.0, place[0]], [3.0, place[1]]]))
            assert proc.fault == ("z", 1)


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_two_points_each_way_are_a_plane_with_a_twist(kind):
    value, slope_x, slope_y = through(
        [[0.25], [1.5]], kind, [[0.0, 2.0], [4.0, 10.0]], (1.0, 3.0), 0.0
    )
    np.testing.assert_allclose(
        [value[0], slope_x[0], slope_y[0]], [0.25 * 4 + 0.5 * 2 + 0.125 * 4, 6.0, 1.0], atol=1e-13
    )


def test_units():
    z = lut2(X, Y, TABLE, (constant(1.0, "m"), constant(2.0, "s")), unit="N/m")
    assert [str(v.dim) for v in (z.value, z.slope_x, z.slope_y)] == [
        "N/m",
        str(unit("N/m") / unit("m")),
        str(unit("N/m") / unit("s")),
    ]
    with pytest.raises(UnitError, match="spacing = .* must be in the unit of"):
        lut2(X, Y, TABLE, constant(1.0, "m"))
    with pytest.raises(UnitError, match="origin"):
        lut2(X, X, TABLE, 1.0, (0.0, constant(1.0, "s")))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (dict(table=[1.0, 2.0]), "at least 2 of each; got shape"),
        (dict(table=[[1.0, 2.0]]), "at least 2 of each; got shape"),
        (dict(table=[[1.0, 2.0], [np.nan, 1.0]]), "not finite"),
        (dict(table=[[1.0, 2.0], [1.0]]), "must be numbers"),
        (dict(table=np.ones((1001, 1000))), "limits.map_points"),
        (dict(spacing=0.0), "spacing = 0 must be above 0"),
        (dict(spacing=(1.0, -1.0)), "spacing = -1"),
        (dict(spacing=(1.0, 1.0, 1.0)), "spacing must be a number, or two"),
        (dict(spacing=Param("d", 1.0)), "number"),
        (dict(origin=np.inf), "not finite"),
        (dict(kind="quintic"), "choose one of linear, cubic"),
    ],
)
def test_bad_input_is_refused(given, said):
    with pytest.raises(BadValue, match=said):
        lut2(X, Y, **(dict(table=TABLE, spacing=1.0) | given))


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_numbers_that_overflow_are_refused(kind):
    with pytest.raises(BadValue, match="check the units"):
        stimlib.compile(Scene({"z": lut2(X, Y, TABLE * 1e307, 1e-10, kind=kind).value}), 1000)
