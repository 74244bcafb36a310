"""Equalising a mode of the plate: constant displacement between the knots, and what the
limits do.
"""

import numpy as np
import pytest
from laws import assert_same, played

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib.blocks.surfaces import equalize
from stimlib.errors import BadValue, UnitError

FS = 8000.0
KNOTS = np.linspace(0.0, 0.1, 5)
X = Input("x", "m")


def mode(x, span=0.2):
    """First bending mode of a beam clamped 0.2 m apart, 1 in its middle at x = 0.05 m;
    0.543 at 0 and 0.1 m.
    """

    def shape(z):
        b = 4.730040744862704
        c = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
        return np.cosh(b * z) - np.cos(b * z) - c * (np.sinh(b * z) - np.sin(b * z))

    return shape(0.5 + (np.asarray(x) - 0.05) / span) / shape(0.5)


PROFILE = KNOTS, 120e-6 * mode(KNOTS)
SWEEP = np.linspace(0.0, 0.1, 2001)
MIDDLE = np.r_[SWEEP[0], (SWEEP[1:] + SWEEP[:-1]) / 2]


def run(block, x=SWEEP, **rows):
    return played(block, {"x": x, **rows}, fs=FS)


@pytest.mark.parametrize(
    ("kind", "error"),
    [
        (None, 0.0005),
        ("polynomial", 0.0005),
        ("cubic", 0.0045),
        ("pchip", 0.019),
        ("linear", 0.034),
    ],
)
def test_displacement_is_constant_between_the_knots(kind, error):
    felt = run(equalize(X, PROFILE, kind=kind)) * mode(MIDDLE)
    assert np.abs(felt - 1).max() <= error
    assert (
        np.abs(
            run(equalize(X, PROFILE, kind=kind), np.repeat(KNOTS, 2))[1::2] * mode(KNOTS) - 1
        ).max()
        <= 1e-12
    )


def test_inverting_the_displacement_beats_interpolating_gains():
    gains = run(stimlib.blocks.lut(X, KNOTS, 1 / mode(KNOTS), kind="polynomial"))
    ours = run(equalize(X, PROFILE)) * mode(MIDDLE)
    assert np.abs(gains * mode(SWEEP) - 1).max() > 10 * np.abs(ours - 1).max()


@pytest.mark.parametrize(("n", "meant"), [(6, "polynomial"), (7, "cubic")])
def test_up_to_six_knots_get_a_polynomial_and_more_a_spline(n, meant):
    knots = np.linspace(0.0, 0.1, n)
    assert_same(
        run(equalize(X, (knots, mode(knots)))), run(equalize(X, (knots, mode(knots)), kind=meant))
    )


def test_the_gain_is_that_of_the_middle_of_the_step():
    y = run(equalize(X, PROFILE), np.array([0.0, 0.0, 0.1, 0.04]))
    np.testing.assert_allclose(y, 1 / mode([0.0, 0.0, 0.05, 0.07]), rtol=1e-3)


def test_outside_the_table():
    x = np.repeat([-0.02, 0.0, 0.05, 0.1, 0.13], 2)
    edge = 1 / mode(0.0)
    np.testing.assert_allclose(run(equalize(X, PROFILE), x)[1::2], [edge, edge, 1, edge, edge])
    np.testing.assert_allclose(
        run(equalize(X, PROFILE, outside="zero"), x)[1::2], [0, edge, 1, edge, 0]
    )
    proc = stimlib.compile(Scene({"y": equalize(X, PROFILE, outside="error")}), FS)
    proc.process(np.array([[0.0, 0.1, 0.1, 0.11, 0.05]]))
    assert proc.fault == ("y", 3)


def test_clip_holds_each_sample_at_the_limit():
    v = 375 * np.sin(2 * np.pi * 158 * np.arange(SWEEP.size) / FS)
    block = equalize(X, PROFILE, 400.0, signal=Input("v", "V"))
    assert str(block.dim) == "V"
    free, y = run(equalize(X, PROFILE, signal=Input("v", "V")), v=v), run(block, v=v)
    np.testing.assert_array_equal(y, np.clip(free, -400, 400))
    assert 0 < np.sum(np.abs(y) >= 400) < y.size  # how to count them


@pytest.mark.parametrize("A", [7.5, 3.0])
def test_scale_reduces_everything_alike(A):
    v = 50 * A * np.sin(2 * np.pi * 158 * np.arange(SWEEP.size) / FS)
    free = run(equalize(X, PROFILE, signal=Input("v", "V")), v=v)
    y = run(
        equalize(
            X,
            PROFILE,
            400.0,
            "scale",
            signal=Input("v", "V"),
            peak=constant(50.0) * Param("A", A, "V"),
        ),
        v=v,
    )
    factor = min(1.0, 400 / (50 * A / mode(0.0)))
    np.testing.assert_allclose(y, factor * free, rtol=1e-9, atol=1e-9)
    assert np.abs(y).max() <= 400


def test_scale_follows_a_live_amplitude_and_may_be_silent():
    A = Param("A", 0.0, "V")
    proc = stimlib.compile(
        Scene({"y": equalize(X, PROFILE, 400.0, "scale", signal=50 * A, peak=50 * A)}), FS
    )
    edge = np.zeros((1, 3))
    assert not proc.process(edge).any()
    for A, wanted in ((1.0, 50 / mode(0.0)), (100.0, 400.0)):
        proc.set("A", A, ramp=0)
        np.testing.assert_allclose(proc.process(edge), wanted, rtol=1e-9)


def test_a_number_is_its_own_peak():
    y = run(equalize(X, PROFILE, 400.0, "scale", signal=constant(-375.0, "V")))
    assert y.min() == pytest.approx(-400.0) and np.abs(y).max() <= 400


def test_profiles_from_a_file(tmp_path):
    path = tmp_path / "profile.csv"
    rows = "".join(f"{float(k)!r},{float(d)!r}\n" for k, d in zip(*PROFILE, strict=True))
    wanted = run(equalize(X, PROFILE))
    for text in (rows, "# measured by LDV\nposition_m,displacement_m\n\n" + rows):
        path.write_text(text)
        assert_same(run(equalize(X, path)), wanted)
        assert_same(run(equalize(X, str(path))), wanted)
    for text, match in (
        ("x,y\na,b\n1,2\n", "line 2"),
        ("0,1\n0.1\n", "line 2"),
        ("", "at least 2"),
        ("0,1,2\n1,1,1\n", "line 2"),
    ):
        path.write_text(text)
        with pytest.raises(BadValue, match=match):
            equalize(X, path)
    with pytest.raises(BadValue, match="cannot read"):
        equalize(X, tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("profile", "match"),
    [
        (([0, 1, 2], [1, 0, 1]), "displacement 1 = 0 must be above 0"),
        (([0, 1, 2], [1, 1, -1]), "displacement 2 = -1 must be above 0"),
        (([0, 1, 2], [1, np.nan, 1]), "displacement 1 is not finite"),
        (([0, np.inf, 2], [1, 1, 1]), "knot 1 is not finite"),
        (([0, 2, 1], [1, 1, 1]), "knot 2 does not"),
        (([0, 1, 1], [1, 1, 1]), "knot 2 does not"),
        (([0, 1], [1, 1, 1]), "as many displacements as knots"),
        (([0], [1]), "at least 2"),
        ([1, 2, 3], r"\(knots, displacement\)"),
        (7.0, r"\(knots, displacement\)"),
        ((["a"], ["b"]), "rows of numbers"),
        (
            ([0, 1, 2, 3], [10, 0.1, 0.1, 10]),
            "between its knots the polynomial displacement falls to",
        ),
    ],
)
def test_bad_profiles(profile, match):
    with pytest.raises(BadValue, match=match):
        equalize(X, profile)


@pytest.mark.parametrize(
    ("profile", "words", "error", "match"),
    [
        (PROFILE, {"limit": 0.0}, BadValue, "limit"),
        (PROFILE, {"limit": -1.0}, BadValue, "limit"),
        (PROFILE, {"limit": 1.0, "headroom": "compress"}, BadValue, "clip, scale"),
        (PROFILE, {"outside": "extrapolate"}, BadValue, "hold, zero, error"),
        (PROFILE, {"kind": "spline"}, BadValue, "kind"),
        (PROFILE, {"headroom": "scale"}, BadValue, "needs a limit"),
        (PROFILE, {"limit": 1.0, "headroom": "scale", "signal": Input("v")}, BadValue, "peak="),
        (PROFILE, {"limit": constant(400.0, "V"), "signal": Input("i", "A")}, UnitError, "V"),
        (
            (np.arange(9.0), 2 + np.cos(np.arange(9.0))),
            {"kind": "polynomial"},
            BadValue,
            "at most 8",
        ),
    ],
)
def test_bad_limits_and_policies(profile, words, error, match):
    with pytest.raises(error, match=match):
        equalize(X, profile, **words)
