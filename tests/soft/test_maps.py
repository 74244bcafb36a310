"""Stiffness maps against numbers worked out by hand; pictures and arrays that are
none.
"""

import struct
import zlib

import numpy as np
import pytest
from matplotlib.image import imsave
from refusals import refused

from stimlib import BadValue
from stimlib.soft import SIDES, THIRTEEN, array, block, image, nodules, sides

R = np.array([0, 6.25, 12.5, 25]) * 1e-3
FALL = np.array([1, 0.512, 0.125, 0.008])


def along(S, x, y):
    """The level at nodes of the table."""
    top, right = np.array(S.levels.shape) - 1
    rows, columns = np.rint(np.asarray(y) / S.height * top), np.rint(x / S.width * right)
    return S.levels[rows.astype(int), columns.astype(int)]


@pytest.mark.parametrize(("b", "top"), [(0.006, 1), (0.005, 125 / 216), (0.004, 8 / 27)])
def test_a_nodule(b, top):
    S = nodules([(0.05, 0.05, b)], 0.1, 0.1, spacing=0.00125)
    for x, y in ((0.05 + R, 0.05), (0.05, 0.05 - R)):
        np.testing.assert_allclose(along(S, x, y), top * FALL, rtol=0, atol=1e-12)


HALF = 12.5e-3 * (2 ** (1 / 3) - 1) ** 0.5
MADE = {  # balls, what else; rows and columns of the table, and its levels there
    "two, which add up": (
        [(0.02, 0.01, 0.006), (0.045, 0.01, 0.004)],
        dict(width=0.1, height=0.02, spacing=0.0025),
        (4, 13),
        17 / 108,  # 1 - (7/8)(26/27)
    ),
    "a deep one": (
        [(0.05, 0.01, 0.006, 0.025)],
        dict(width=0.1, height=0.02, spacing=0.01),
        (1, 5),
        1 / 16,
    ),
    "a deep one at the edge": (
        [(0.05, 0.0, 0.006, 0.025)],
        dict(width=0.1, height=0.025, spacing=0.025),
        (0, [2, 3]),
        [1 / 16, 1 / 128],
    ),
    # nearer than A's is no harder than hard
    "one near the surface": (
        [(0.05, 0.01, 0.006, 0.006)],
        dict(width=0.1, height=0.02, spacing=0.01),
        (1, 5),
        1.0,
    ),
    "the other shape": (
        [(0.0, 0.01, 0.006)],
        dict(width=4 * HALF, height=0.02, spacing=HALF, shape="gaussian"),
        (2, [0, 1, 2]),
        [1, 0.5, 1 / 16],
    ),
}


@pytest.mark.parametrize("name", MADE)
def test_nodules_two_deep_ones_and_the_other_shape(name):
    balls, words, at, wanted = MADE[name]
    levels = nodules(balls, **words).levels
    at = (levels.shape[0] // 2, at[1]) if "shape" in words else at
    np.testing.assert_allclose(levels[at], wanted, rtol=0, atol=1e-12)
    assert levels.max() <= 1


def test_the_experiment_has_thirteen_pairs():
    assert len(THIRTEEN) == len(set(THIRTEEN)) == 13
    assert {pair[::-1] for pair in THIRTEEN} == set(THIRTEEN)
    assert [side for pair in THIRTEEN for side in pair].count("none") == 8
    # and a tail of the other
    two = along(sides("B1", "A1"), np.array([0.03, 0.09]), 0.06)
    np.testing.assert_allclose(two, [125 / 216, 1], rtol=0, atol=2e-3)
    assert sides("none", "none").levels.max() == 0 and list(SIDES) == ["A1", "B1", "C1", "none"]


def test_the_block_can_be_turned():
    turn = np.pi / 2 + np.arange(3) * 2 * np.pi / 3
    got = along(block(spacing=0.00125), 0.06 + 0.03 * np.cos(turn), 0.06 + 0.03 * np.sin(turn))
    np.testing.assert_allclose(got, [1, 125 / 216, 8 / 27], rtol=0, atol=0.02)
    np.testing.assert_allclose(block(np.pi).levels[::-1, ::-1], block().levels, rtol=0, atol=1e-12)


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def header(columns, rows, bits=16):
    return chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, bits, 0, 0, 0, 0))


GREY = np.array([[0, 51], [102, 255], [0, 0]], np.uint8)
DEEP = b"".join(b"\0" + np.array(row, ">u2").tobytes() for row in ([0, 65535], [13107, 1]))
START = b"\x89PNG\r\n\x1a\n"
PNG = START + header(2, 2) + chunk(b"IDAT", zlib.compress(DEEP))  # 16 bits, grey


def test_pictures(tmp_path):
    path = tmp_path / "a.png"
    imsave(path, np.repeat(GREY[..., None], 3, 2))
    S = image(path, width=0.03)
    np.testing.assert_allclose(S.levels, GREY[::-1] / 255, atol=1e-7)
    assert (S.width, S.height, image(path, 0.03, 0.01).height) == (0.03, 0.06, 0.01)
    path.write_bytes(PNG + chunk(b"IEND", b""))
    np.testing.assert_allclose(image(path).levels, [[0.2, 1 / 65535], [0, 1]], atol=1e-7)
    # grey of 2 and 4 bits, to which optimizers of PNG files change one of 8
    for bits, rows in ((2, b"\0\x10\0\xb0"), (4, b"\0\x05\0\xaf")):
        data = chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
        path.write_bytes(START + header(2, 2, bits) + data)
        np.testing.assert_allclose(image(path).levels, [[2 / 3, 1], [0, 1 / 3]], atol=1e-7)


ONE = START + header(1, 1) + chunk(b"IDAT", zlib.compress(b"\0\0\0")) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (PNG[:48], "damaged"),
        (PNG[:16], "not a PNG file"),
        (b"S", "not a PNG file"),
        (START + header(10**5, 10**5) + PNG[33:], "limits.map_points"),
        (PNG[:33] + header(3, 2) + PNG[33:], "first header"),
        (ONE, "two rows and two columns"),
        (None, "none.png"),
    ],
)
def test_a_picture_that_is_none(data, says, tmp_path):
    path = tmp_path / "none.png"
    if data is not None:
        path.write_bytes(data)
    refused(BadValue, says, image, path)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: array([[0, 2]], 1, 1), "two rows"),
        (lambda: array([[0, 2], [0, 1]]), "0 to 1"),
        (lambda: array(np.zeros((1001, 1001))), "limits.map_points"),
        (lambda: array([[0, np.inf], [0, 1]]), "not finite"),
        (lambda: array([[0, 1], [0]]), "a list of numbers"),
        (lambda: array([[0, 1], [0, 1]], width=0.0), "width = 0.0 m"),
        (lambda: nodules([(0.1, 0.1)]), "x, y, radius"),
        (lambda: nodules([(0.1, 0.1, "b")]), "balls = .* a list"),
        (lambda: nodules([(0.1, 0.1, 0.01, 0.009)]), "at least that deep"),
        (lambda: nodules([(np.nan, 0.1, 0.004)]), "nodules: a ball"),
        (lambda: nodules([(0.1, 0.1, 1e-200, 1e-200)]), "1 nm"),
        (lambda: nodules([(0.1, 0.1, 0.1, 1e300)]), "1 nm"),
        (lambda: nodules([(1e10, 0.1, 0.004)]), "1 nm"),
        (lambda: nodules([(0.1, -1e10, 0.004)]), "1 nm"),
        (lambda: nodules([], spacing=0.0), "spacing"),
        (lambda: nodules([], width=np.inf), "nodules: width"),
        (lambda: nodules([], height=-1.0), "height = -1.0 m"),
        (lambda: nodules([], spacing="2 mm"), "nodules: spacing"),
        (lambda: block(np.inf), "block: turn"),
        (lambda: nodules([], spacing=1e-4), "larger spacing"),
        (lambda: nodules([], shape="cube"), "ball, gaussian"),
        (lambda: sides("A1", "D1"), "A1, B1, C1, none"),
    ],
)
def test_maps_that_make_no_sense(make, says):
    refused(BadValue, says, make)
