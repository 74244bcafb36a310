"""Tables against numpy and scipy, and functions of the present sample."""

import numpy as np
import pytest
from laws import lawful, played, refuses

import stimlib
from stimlib import Input, Param, Scene, UnitError, blocks, constant
from stimlib.blocks import lut, lut2
from stimlib.core.units import unit

U, W, X, Y = Input("u"), Input("w"), Input("x", "m"), Input("y", "s")
KINDS = ["linear", "pchip", "cubic", "polynomial"]
KNOTS = np.array([-2.0, -1.1, 0.0, 0.3, 0.35, 4.0])
VALUES = np.array([1.0, -1.0, 0.5, 2.0, 2.0, -3.0])
INSIDE = np.concatenate(
    [np.linspace(-2, 4, 997), KNOTS, np.nextafter(KNOTS[1:], -9), np.nextafter(KNOTS[:-1], 9)]
)
BEYOND = np.r_[-2.0001, -1e300, 4.0001, 1e300, -np.inf, np.inf]
ORIGIN, SPACING = (-0.3, 2.0), (0.25, 1.5)
RNG = np.random.default_rng(3)
TABLES = [RNG.standard_normal(shape) for shape in ((7, 5), (4, 7))]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("outside", ["hold", "zero", "error"])
def test_a_table_is_its_curve(kind, outside):
    """On its knots, beside them, between them and beyond."""
    x = INSIDE if outside == "error" else np.r_[INSIDE, BEYOND]
    lawful(lut(U, KNOTS, VALUES, kind, outside), 1000, u=x)


@pytest.mark.parametrize("kind", ["linear", "cubic"])
@pytest.mark.parametrize("table", TABLES, ids=np.shape)
def test_a_grid_is_its_surface_with_its_slopes(table, kind):
    """A tensor product of cubic splines whose third derivative goes on beside the edges
    (not-a-knot); held beyond, where it is level.
    """
    grid = lut2(X, Y, table, SPACING, ORIGIN, kind)
    last = ORIGIN + np.array(SPACING) * (np.array(table.shape) - 1)
    way = np.array([(-1e300, *ORIGIN), (1e300, *last), (0.0, -1e-3, 3.0), (0.1, 2.5, 1e300)])
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-1, 2, 400), rng.uniform(1, 12, 400)
    rows = {"x": np.r_[x, way[:, 0], way[:, 1]], "y": np.r_[y, way[:, 1], way[:, 2]]}
    for one in (grid.value, grid.slope_x, grid.slope_y):
        lawful(one, 1000, **rows)
    corner = played(grid.value, {"x": [ORIGIN[0], last[0]], "y": [ORIGIN[1], last[1]]})
    np.testing.assert_allclose(corner, table[[0, -1], [0, -1]], rtol=0, atol=1e-13)


def test_the_gains_of_an_array_are_those_of_tactile_brush():
    """sqrt(1 - b) and sqrt(b) at the part b of the way; one energy at every place."""
    places = np.array([-0.01, 0.0, 0.03, 0.031])
    inside = np.r_[places, np.nextafter(places, -1), np.nextafter(places, 1)]
    x = np.r_[inside, -1e300, 1e300, np.random.default_rng(0).uniform(-0.02, 0.04, 5000)]
    scene = Scene({f"tactor{k}": gain for k, gain in enumerate(blocks.panning(X, places))})
    made = stimlib.render(scene, {"x": x}, 1000)
    held = np.clip(x, places[0], places[-1])
    left = np.clip(np.searchsorted(places, held, "right") - 1, 0, 2)
    b = (held - places[left]) / np.diff(places)[left]
    wanted = np.zeros((4, x.size))
    wanted[left, np.arange(x.size)], wanted[left + 1, np.arange(x.size)] = 1 - b, b
    assert np.abs(made.y**2 - wanted).max() < 1e-13
    assert np.abs((made.y**2).sum(0) - 1).max() < 1e-15 * 4
    assert stimlib.verify(scene, {"x": x}, made).passed


FAULTS = [
    *(("error", "linear", u) for u in (-2.1, 4.1, np.nan)),
    *((outside, kind, np.nan) for outside in ("hold", "zero") for kind in ("linear", "polynomial")),
]


@pytest.mark.parametrize(("outside", "kind", "u"), FAULTS)
def test_outside_is_a_fault_where_it_should_be(outside, kind, u):
    """And what is no number, whatever is outside."""
    proc = stimlib.compile(Scene({"y": lut(U, KNOTS, VALUES, kind, outside)}), 1000)
    proc.process(np.array([[-2.0, 4.0, u, 0.0]]))
    assert proc.fault == ("y", 2)


EIGHT = np.arange(8.0)
CLOSE = 10 + 1e-3 * EIGHT
HAND = {
    "a function sampled at the knots": (
        {"y": lut(U, np.linspace(0, 1, 11), np.square)},
        {"u": [0.5, 0.55]},
        [[0.25, 0.305]],
    ),
    "knots that are close": (
        {"y": lut(U, CLOSE, np.cos(EIGHT), "polynomial")},
        {"u": CLOSE},
        [np.cos(EIGHT)],
    ),
    "nan is not above, and the larger if it comes first": (
        {
            "g": U > W,
            "m": blocks.nonzero(blocks.maximum(W, U)),
            "n": blocks.nonzero(U),
            "o": blocks.where(U, 1.0, 2.0),
        },
        {"u": [np.nan], "w": [1.0]},
        [[0.0], [1.0], [1.0], [2.0]],
    ),
    "a live limit may pass the other": (
        {"y": blocks.clip(U, -5.0, Param("top", -6.0))},
        {"u": [-9.0, 0.0]},
        [[-6.0, -6.0]],
    ),
}


@pytest.mark.parametrize("name", HAND)
def test_samples_are_those_worked_out_by_hand(name):
    outputs, rows, wanted = HAND[name]
    np.testing.assert_allclose(played(outputs, rows), wanted, rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_two_points_each_way_are_a_plane_with_a_twist(kind):
    z = lut2(X, Y, [[0.0, 2.0], [4.0, 10.0]], (1.0, 3.0), 0.0, kind)
    y = played({"v": z.value, "x1": z.slope_x, "y1": z.slope_y}, [0.25], [1.5])[:, 0]
    np.testing.assert_allclose(y, [0.25 * 4 + 0.5 * 2 + 0.125 * 4, 6.0, 1.0], atol=1e-13)


def test_units():
    z = lut2(X, Y, TABLES[0], (constant(1.0, "m"), constant(2.0, "s")), unit="N/m")
    want = ["N/m", *(str(unit("N/m") / unit(name)) for name in "ms")]
    assert [str(v.dim) for v in (z.value, z.slope_x, z.slope_y)] == want


NEWTONS = Input("F", "N")
REFUSED = [
    (lambda: lut(U, np.arange(9.0), np.arange(9.0), "polynomial"), "9 knots .*at most 8"),
    (lambda: lut(U, [0, 1, 1], [1, 2, 3], "polynomial"), "must rise"),
    (lambda: lut(U, [0, 1], [1, 2, 3], "polynomial"), "one length"),
    (lambda: lut(U, [0, 1], [1, 2], 201 * "l"), "201 letters"),
    (lambda: blocks.panning(U, [0.0]), "^panning: "),
    (lambda: blocks.panning(U, [0.0, 0.02, 0.01]), "^panning: .*must rise"),
    *((lut(U, [0, 1e-200, 2e-200], [0, 1e200, 3], kind), "too unequal") for kind in KINDS),
    (lambda: lut(U, [0, 1], [1, 2], "polynomial", outside="extend"), "hold, zero, error"),
    (
        lambda: blocks.clip(NEWTONS, constant(5.0, "N"), constant(-5.0, "N")),
        "clip: low = 5 .*lower limit first",
    ),
    (lut2(X, Y, TABLES[0] * 1e307, 1e-10, kind="linear").value, "check the units"),
    (lut2(X, Y, TABLES[0] * 1e307, 1e-10, kind="cubic").value, "check the units"),
    (lambda: lut2(X, Y, TABLES[0], constant(1.0, "m")), "spacing .*unit of", UnitError),
    (lambda: lut2(X, X, TABLES[0], 1.0, (0.0, constant(1.0, "s"))), "origin", UnitError),
    *(
        (lambda given=given: lut2(X, Y, **(dict(table=TABLES[0], spacing=1.0) | given)), says)
        for given, says in [
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
            (dict(kind="quintic"), "must be one of linear, cubic"),
        ]
    ),
]


@pytest.mark.parametrize("given", REFUSED, ids=lambda given: given[1])
def test_what_makes_no_sense_is_refused(given):
    refuses(*given)
