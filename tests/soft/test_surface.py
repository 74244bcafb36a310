"""Surfaces under one and three indenters, their pictures and films."""

import numpy as np
import pytest
from matplotlib.image import imread

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
    h = down((30, 30, 7.5))
    assert h.shape == (25, 25) and h.argmax() == 12 * 25 + 12
    near = down((31, 29.4, 7.5))
    # the nearest node goes down by the whole depth
    assert near[12, 12] == pytest.approx(7.5, abs=1e-12)
    assert near[12, 13] == pytest.approx(7.5 - 5 + (25 - 1.5**2 - 0.6**2) ** 0.5, abs=1e-9)
    assert (
        not down((30, -60, 3.0)).any()
        and not down((0, 0, 0.0)).any()
        and not surface([], 0.06, 0.06).any()
    )


def test_where_neighbourhoods_overlap():
    at = [8, 10, 11, 12, 13, 16]
    two = (20, 30, 15), (40, 30, 15)
    np.testing.assert_allclose(down(*two)[12, at], [15, 10, 5, 5, 5, 15], rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        down(*two, join="deepest")[12, at], [15, 10, 7.5, 5, 7.5, 15], rtol=0, atol=1e-9
    )


def test_a_picture_is_of_its_time():
    figure = picture(RESULT, at=0.2, width=0.06, height=0.06)
    assert figure.axes[0].get_title() == "0.20 s" and figure.axes[0].elev == 45
    assert picture(RESULT, width=0.06, height=0.06).axes[0].get_title() == "0.39 s"  # deepest


def test_films(tmp_path):
    from PIL import Image

    assert film(RESULT, tmp_path / "a.gif", fps=10, start=0.1, stop=0.31, **SMALL) == 3
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 3
    assert film(RESULT, tmp_path / "frames", fps=5, **SMALL) == 2
    first, last = (imread(tmp_path / "frames" / f"frame_000{i}.png") for i in range(2))
    assert np.abs(first - last).max() > 0.1 and len(list((tmp_path / "frames").iterdir())) == 2
    assert {p.name for p in tmp_path.iterdir()} == {"a.gif", "frames"}


def test_a_film_takes_as_long_as_the_movement(tmp_path):
    from PIL import Image

    assert film(RESULT, tmp_path / "a.gif", fps=30, stop=0.1, **SMALL) == 4
    with Image.open(tmp_path / "a.gif") as gif:
        shown = [(gif.seek(i), gif.info["duration"])[1] for i in range(gif.n_frames)]
    assert shown == [30, 40, 30, 30]  # a GIF counts in 10 ms; the sum is 4/30 s to one of them
    brief = stimlib.render(RESULT.scene, {name: x[:2] for name, x in HAND.items()}, fs=100)
    # the next would be sample 1.67, which there is not
    assert film(brief, tmp_path / "frames", fps=60, **SMALL) == 1


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
    with pytest.raises(BadValue, match=says):
        make()


def test_a_place_where_nothing_can_be_written(tmp_path):
    with pytest.raises(SinkError):
        film(RESULT, tmp_path / "missing" / "a.gif", fps=2, **SMALL)
    assert not list(tmp_path.iterdir())
