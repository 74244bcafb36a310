"""Surfaces under one and three indenters, their pictures and films."""

import numpy as np
import pytest
from matplotlib.image import imread
from mpl_toolkits.mplot3d import Axes3D
from PIL import Image, ImageSequence
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Scene
from stimlib.errors import SinkError
from stimlib.soft import film, picture, surface

HAND = {
    "x1": np.linspace(0.02, 0.04, 40),
    "y1": np.full(40, 0.03),
    "depth1": np.linspace(0.0, 0.01, 40),
}
RESULT = stimlib.render(Scene({name: Input(name, "m") * 1.0 for name in HAND}), HAND, fs=100)
SMALL = {"width": 0.06, "height": 0.06, "progress_bar": False}


def down(*indenters, **words):
    return -1000 * surface(1e-3 * np.array(indenters), 0.06, 0.06, **words)


def test_nodes_that_move():
    counts = [np.count_nonzero(down((30, 30, d)) > 1e-6) for d in (0.5, 1, 2.5, 5, 7.5, 10, 15)]
    assert counts == [1, 5, 9, 9, 45, 45, 109]
    h, near = down((30, 30, 7.5)), down((31, 29.4, 7.5))
    assert h.shape == (25, 25) and h.argmax() == 12 * 25 + 12
    # the nearest node goes down by the whole depth
    beside = 7.5 - 5 + (25 - 1.5**2 - 0.6**2) ** 0.5
    assert near[12, 12:14] == pytest.approx([7.5, beside], abs=1e-9)
    for none in (down((30, -60, 3.0)), down((0, 0, 0.0)), surface([], 0.06, 0.06)):
        assert not none.any()


@pytest.mark.parametrize(
    ("join", "heights"), [("mean", [15, 10, 5, 5, 5, 15]), ("deepest", [15, 10, 7.5, 5, 7.5, 15])]
)
def test_where_neighbourhoods_overlap(join, heights):
    got = down((20, 30, 15), (40, 30, 15), join=join)[12, [8, 10, 11, 12, 13, 16]]
    np.testing.assert_allclose(got, heights, rtol=0, atol=1e-9)


def test_a_picture_is_of_its_time(monkeypatch):
    """In mm, in proportion, from 45 degrees above."""
    drawn = []
    monkeypatch.setattr(Axes3D, "plot_surface", lambda self, *xyz, **words: drawn.append(xyz))
    (axes,) = picture(RESULT, at=0.2, width=0.06, height=0.03).axes
    assert axes.get_title() == "0.20 s" and axes.elev == 45
    x, y, z = drawn[0]
    assert (x.max(), y.max()) == (60, 30) and z.min() == pytest.approx(-1000 * RESULT["depth1"][20])
    assert axes._box_aspect[0] / axes._box_aspect[1] == pytest.approx(2)
    (late,) = picture(RESULT, width=0.06, height=0.06).axes
    assert late.get_title() == "0.39 s"  # deepest


def test_films(tmp_path):
    assert film(RESULT, tmp_path / "frames", fps=5, **SMALL) == 2
    first, last = (imread(tmp_path / "frames" / f"frame_000{i}.png") for i in range(2))
    assert np.abs(first - last).max() > 0.1 and len(list((tmp_path / "frames").iterdir())) == 2
    brief = stimlib.render(RESULT.scene, {name: x[:2] for name, x in HAND.items()}, fs=100)
    # the next would be sample 1.67, which there is not
    assert film(brief, tmp_path / "brief", fps=60, **SMALL) == 1
    refused(SinkError, None, film, RESULT, tmp_path / "missing" / "a.gif", fps=2, **SMALL)
    # its second picture would follow the one of another film
    refused(BadValue, "frame_0001.png is of a longer", film, brief, tmp_path / "frames", fps=60)
    assert {p.name for p in tmp_path.iterdir()} == {"frames", "brief"}


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        ({"fps": 30, "stop": 0.1}, [30, 40, 30, 30]),  # a GIF counts in 10 ms; 4/30 s in all
        ({"fps": 10, "start": 0.1, "stop": 0.31}, [100, 100, 100]),
    ],
)
def test_a_film_takes_as_long_as_the_movement(words, shown, tmp_path):
    assert film(RESULT, tmp_path / "a.gif", **words, **SMALL) == len(shown)
    with Image.open(tmp_path / "a.gif") as gif:
        took = [frame.info["duration"] for frame in ImageSequence.Iterator(gif)]
    assert took == shown and [p.name for p in tmp_path.iterdir()] == ["a.gif"]


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: surface([("a", 0, 0)]), "indenters = .* must be a list"),
        (lambda: surface([(0, 0, 1)], width=np.inf), "surface: width"),
        (lambda: surface([(0, 0, 1)], spacing=1e-320), "limits.map_points"),
        (lambda: surface([(0, 0, 1)], radius=0.0), "radius = 0.0"),
        (lambda: film(RESULT, "a.gif", fps=60), "50 pictures a second"),
        (lambda: film(RESULT, "a", fps=1e300), "limits.render_bytes"),
        (lambda: film(RESULT, "a", start=0.2, stop=0.1), "before start"),
        (lambda: surface([(0, 0)]), "indenters = .* must be a list"),
        (lambda: surface([(0, 0, np.nan)]), "three finite numbers"),
        (lambda: surface([(0, 0, 1)], spacing=1e-5), "limits.map_points"),
        (lambda: surface([(0, 0, 1)], width=-1.0), "width"),
        (lambda: picture(RESULT, at=0.5), "0 to 0.39 s"),
        (lambda: picture(RESULT, at=-0.1), "0 to 0.39 s"),
        (
            lambda: picture(stimlib.render(Scene({"y": Input("y")}), {"y": np.ones(3)}, fs=100)),
            "outputs x1 and y1",
        ),
        (lambda: film(RESULT, "a.mp4"), ".gif"),
        (lambda: film(RESULT, "a.gif", fps=0.0), "fps"),
    ],
)
def test_what_cannot_be_drawn(make, says):
    refused(BadValue, says, make)
