"""Stiffness maps against numbers worked out by hand; pictures and arrays that are
none.
"""

import struct
import zlib

import numpy as np
import pytest
from matplotlib.image import imsave

from stimlib import BadValue
from stimlib.soft import SIDES, THIRTEEN, array, block, image, nodules, sides

R = np.array([0, 6.25, 12.5, 25]) * 1e-3
FALL = np.array([1, 0.512, 0.125, 0.008])


def along(S, x, y):
    """The level at nodes of the table."""
    rows, columns = S.levels.shape
    return S.levels[
        np.rint(np.asarray(y) / S.height * (rows - 1)).astype(int),
        np.rint(x / S.width * (columns - 1)).astype(int),
    ]


@pytest.mark.parametrize(("b", "top"), [(0.006, 1), (0.005, 125 / 216), (0.004, 8 / 27)])
def test_a_nodule(b, top):
    S = nodules([(0.05, 0.05, b)], 0.1, 0.1, spacing=0.00125)
    np.testing.assert_allclose(along(S, 0.05 + R, 0.05), top * FALL, rtol=0, atol=1e-12)
    np.testing.assert_allclose(along(S, 0.05, 0.05 - R), top * FALL, rtol=0, atol=1e-12)


def test_two_nodules_a_deep_one_and_the_other_shape():
    S = nodules([(0.02, 0.01, 0.006), (0.045, 0.01, 0.004)], 0.1, 0.02, spacing=0.0025)
    # 1 - (7/8)(26/27)
    assert along(S, np.array(0.0325), 0.01) == pytest.approx(17 / 108, abs=1e-12)
    assert nodules([(0.05, 0.01, 0.006, 0.025)], 0.1, 0.02, 0.01).levels[1, 5] == pytest.approx(
        1 / 16, abs=1e-12
    )
    np.testing.assert_allclose(
        nodules([(0.05, 0.0, 0.006, 0.025)], 0.1, 0.025, 0.025).levels[0, 2:4],
        [1 / 16, 1 / 128],
        atol=1e-12,
    )
    # nearer than A's is no harder than hard
    assert nodules([(0.05, 0.01, 0.006, 0.006)], 0.1, 0.02, 0.01).levels.max() == 1
    half = 12.5e-3 * (2 ** (1 / 3) - 1) ** 0.5
    bell = nodules([(0.0, 0.01, 0.006)], 4 * half, 0.02, spacing=half, shape="gaussian")
    np.testing.assert_allclose(
        bell.levels[bell.levels.shape[0] // 2, :3], [1, 0.5, 1 / 16], rtol=0, atol=1e-12
    )


def test_the_experiment_has_thirteen_pairs():
    assert len(THIRTEEN) == len(set(THIRTEEN)) == 13
    assert sum(side == "none" for pair in THIRTEEN for side in pair) == 8 and all(
        pair[::-1] in THIRTEEN for pair in THIRTEEN
    )
    S = sides("B1", "A1")
    np.testing.assert_allclose(
        along(S, np.array([0.03, 0.09]), 0.06), [125 / 216, 1], rtol=0, atol=2e-3
    )  # and a tail of the other
    assert sides("none", "none").levels.max() == 0 and list(SIDES) == ["A1", "B1", "C1", "none"]


def test_the_block_can_be_turned():
    x, y = (
        0.06 + 0.03 * np.cos(a := np.pi / 2 + np.arange(3) * 2 * np.pi / 3),
        0.06 + 0.03 * np.sin(a),
    )
    got = along(block(spacing=0.00125), x, y)
    np.testing.assert_allclose(got, [1, 125 / 216, 8 / 27], rtol=0, atol=0.02)
    np.testing.assert_allclose(block(np.pi).levels[::-1, ::-1], block().levels, rtol=0, atol=1e-12)


def test_pictures(tmp_path):
    grey = np.array([[0, 51], [102, 255], [0, 0]], np.uint8)
    imsave(tmp_path / "rgb.png", np.repeat(grey[..., None], 3, 2))
    S = image(tmp_path / "rgb.png", width=0.03)
    np.testing.assert_allclose(S.levels, grey[::-1] / 255, atol=1e-7)
    assert (S.width, S.height) == (0.03, 0.06) and image(
        tmp_path / "rgb.png", 0.03, 0.01
    ).height == 0.01
    # 16 bits, grey
    deep = b"".join(b"\0" + np.array(row, ">u2").tobytes() for row in ([0, 65535], [13107, 1]))

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    png = (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 2, 16, 0, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(deep))
    )
    (tmp_path / "deep.png").write_bytes(png + chunk(b"IEND", b""))
    np.testing.assert_allclose(
        image(tmp_path / "deep.png").levels, [[0.2, 1 / 65535], [0, 1]], atol=1e-7
    )
    (tmp_path / "cut.png").write_bytes(png[:48])
    (tmp_path / "head.png").write_bytes(png[:16])
    (tmp_path / "huge.png").write_bytes(png[:16] + struct.pack(">II", 10**5, 10**5) + png[24:])
    (tmp_path / "text.png").write_text("S")
    (tmp_path / "twice.png").write_bytes(
        png[:33] + chunk(b"IHDR", struct.pack(">IIBBBBB", 3, 2, 16, 0, 0, 0, 0)) + png[33:]
    )
    imsave(tmp_path / "one.png", np.zeros((1, 1)))
    for name, says in {
        "cut": "damaged",
        "twice": "first header",
        "one": "two rows and two columns",
        "huge": "limits.map_points",
        "text": "not a PNG file",
        "head": "not a PNG file",
        "none": "none.png",
    }.items():
        with pytest.raises(BadValue, match=says):
            image(tmp_path / f"{name}.png")


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: array([[0, 2]], 1, 1), "two rows"),
        (lambda: array([[0, 2], [0, 1]]), "0 to 1"),
        (lambda: array(np.zeros((1001, 1001))), "limits.map_points"),
        (lambda: array([[0, np.inf], [0, 1]]), "not finite"),
        (lambda: array([[0, 1], [0]]), "must be a list of numbers"),
        (lambda: array([[0, 1], [0, 1]], width=0.0), "width = 0.0 m"),
        (lambda: nodules([(0.1, 0.1)]), "x, y, radius"),
        (lambda: nodules([(0.1, 0.1, "b")]), "balls = .* must be a list"),
        (lambda: nodules([(0.1, 0.1, 0.01, 0.009)]), "at least that deep"),
        (lambda: nodules([(np.nan, 0.1, 0.004)]), "nodules: a ball"),
        (lambda: nodules([(0.1, 0.1, 1e-200, 1e-200)]), "1 nm"),
        (lambda: nodules([(0.1, 0.1, 0.1, 1e300)]), "1 nm"),
        (lambda: nodules([], spacing=0.0), "spacing"),
        (lambda: nodules([], width=np.inf), "nodules: width"),
        (lambda: nodules([], spacing="2 mm"), "nodules: spacing"),
        (lambda: block(np.inf), "block: turn"),
        (lambda: nodules([], spacing=1e-4), "larger spacing"),
        (lambda: nodules([], shape="cube"), "ball, gaussian"),
        (lambda: sides("A1", "D1"), "A1, B1, C1, none"),
    ],
)
def test_maps_that_make_no_sense(make, says):
    with pytest.raises(BadValue, match=says):
        make()
