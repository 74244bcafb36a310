"""Stiffness maps from nodules in a silicone block, from a picture, or from an array."""

from __future__ import annotations

import io
import math
import os
import struct
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..blocks.soft import Levels as Levels, table_of
from ..core.graph import design_value
from ..errors import BadValue, one_of, public
from ..system import safe_files
from ..system.limits import limits
from ..system.packages import package

BLOCK = 0.12
"""Side of the silicone block of Li et al. (2016), in m: 120 x 120 x 25 mm."""
DEPTH = 0.0125
"""Of the nodules' centres in m: half-way down; ours."""
RADII = {"A": 0.006, "B": 0.005, "C": 0.004}
"""Of the nodules in m; the source says that A > B > C, the numbers are ours."""
SMALLEST = 1e-9
"""Radius of a ball in m."""
SIDES: dict[str, float | None] = {
    "A1": RADII["A"],
    "B1": RADII["B"],
    "C1": RADII["C"],
    "none": None,
}
"""What may be under one side of the surface: the radius of a nodule in m, or None."""
THIRTEEN = tuple((a, b) for a in SIDES for b in SIDES if a != b or a == "none")
"""The combinations (left, right) of the experiment with a mouse: all 16 but two equal
nodules.

The source says that there were thirteen, and its rates are of 18 nodules and 8 empty
sides.  84 choices fit; this is the only one that stays what it is when sides or nodules
are exchanged.
"""


@public
def array(levels: ArrayLike, width: float = BLOCK, height: float = BLOCK) -> Levels:
    """Make a stiffness map from an array.

    Parameters
    ----------
    levels : array_like, shape (rows, columns)
        0 to 1; the first row is at y = 0, the first column at x = 0.
    width, height : float
        In m, from the first to the last column and row.

    Raises
    ------
    BadValue
        Levels outside 0 to 1 or not finite, fewer than two rows or columns, more than
        ``limits.map_points``; a size not above 0.

    Examples
    --------
    >>> from stimlib.soft import array
    >>> array([[0, 0.5], [0, 1]], width=0.01, height=0.02).levels.shape
    (2, 2)
    """
    return table_of("array", levels, width, height)


@public
def image(
    path: str | os.PathLike[str], width: float = BLOCK, height: float | None = None
) -> Levels:
    """Make a stiffness map from a PNG picture.

    White is hard (1), black as soft as the object (0); the lowest row is at y = 0.

    Parameters
    ----------
    path : path
        Of a PNG file, 1 to 16 bits; of colours the mean, whatever is transparent.
    width : float
        In m, between the middles of the outer columns.
    height : float, optional
        In m; by default pixels are square.

    Raises
    ------
    BadValue
        No PNG file, or a damaged one; fewer than two rows or columns, or more pixels
        than ``limits.map_points``; a size not above 0.

    Examples
    --------
    >>> import tempfile, numpy as np
    >>> from matplotlib.image import imsave
    >>> from stimlib.soft import image
    >>> path = tempfile.mkdtemp() + "/map.png"
    >>> imsave(path, np.array([[0.0, 0.0], [0.0, 0.2], [1.0, 0.0]]), cmap="gray")
    >>> image(path, width=0.01)
    Levels(levels=array([[1. , 0. ],
           [0. , 0.2],
           [0. , 0. ]]), width=0.01, height=0.02)
    """
    package("matplotlib", "a map from a picture")  # which brings Pillow
    from PIL import Image

    data = safe_files.read(path, "sidecar_bytes", BadValue)
    if data[:8] != b"\x89PNG\r\n\x1a\n" or len(data) < 24:
        raise BadValue(f"{path} is not a PNG file; save the picture as PNG")
    columns, rows = struct.unpack(">II", data[16:24])
    limits.check("map_points", rows * columns, f"{path}: pixels; make the picture smaller")
    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as png:  # which decodes nothing yet
            if png.size != (columns, rows):
                raise ValueError("its first header is not the one that counts")
            wide = png.mode[0] == "I"  # 16 bits; of less than 8, Pillow makes 8
            made = png if wide else png.convert("L" if png.mode in ("1", "L") else "RGBA")
            pixels = np.asarray(
                np.divide(np.asarray(made), 65535 if wide else 255, dtype=np.float32), float
            )
    except Exception as e:  # whatever a decoder finds in a damaged file
        raise BadValue(f"{path} is a damaged PNG file ({type(e).__name__}: {e})") from None
    grey = pixels if pixels.ndim == 2 else pixels[..., :3].mean(axis=2)
    if min(grey.shape) < 2:
        raise BadValue(
            f"{path}: a map needs at least two rows and two columns of pixels; this picture has"
            f" {rows} and {columns}"
        )
    if height is None:
        height = width * (rows - 1) / (columns - 1)
    return table_of(str(path), grey[::-1], width, height)


@public
def nodules(
    balls: Sequence[tuple[float, ...]],
    width: float = BLOCK,
    height: float = BLOCK,
    spacing: float = 0.002,
    shape: Literal["ball", "gaussian"] = "ball",
) -> Levels:
    """Make a stiffness map of hard balls in a soft block.

    S = 1 - product of (1 - s).

    ``ball``: s = min(1, (b/6 mm)^3 (12.5 mm/z)^4) / (1 + (rho/z)^2)^3 for the radius b,
    the depth z of the centre and the distance rho from it. The fall-off is that of a
    small rigid ball in the stiffness under a contact (Boussinesq's energy at the ball);
    the scale is chosen so that nodule A gives 1. ``gaussian`` has the same height and
    half width. All this is our choice.

    Parameters
    ----------
    balls : sequence of (x, y, radius) or (x, y, radius, depth)
        In m; depth 12.5 mm where it is not given.
    width, height : float
        Of the block in m.
    spacing : float
        Of the table in m; at 2 mm, and 12.5 mm deep, the spline through it errs by 6e-4
        at most.
    shape : {"ball", "gaussian"}

    Raises
    ------
    BadValue
        A ball without room below the surface (radius above depth), below 1 nm, or not
        of 3 or 4 numbers; sizes not above 0; an unknown shape; more levels than
        ``limits.map_points``.

    References
    ----------
    Li et al. (2016), "Experimental protocol": the block and its nodules; the measured
    map is not published.

    Examples
    --------
    >>> from stimlib.soft import nodules
    >>> S = nodules([(0.06, 0.06, 0.006)])
    >>> S.levels.shape, float(S.levels[30, 30])
    ((61, 61), 1.0)
    """
    rows, columns = nodes("nodules", width, height, spacing)
    x, y = np.meshgrid(np.linspace(0, width, columns), np.linspace(0, height, rows))
    clear = np.ones((rows, columns))
    for ball in balls:
        cx, cy, b, z = _ball(ball)
        q = ((x - cx) ** 2 + (y - cy) ** 2) / z**2
        top = min(1.0, (b / RADII["A"]) ** 3 * (DEPTH / z) ** 4)
        clear *= 1 - top * ((1 + q) ** -3 if shape == "ball" else 2.0 ** (-q / (2 ** (1 / 3) - 1)))
    return table_of("nodules", 1 - clear, width, height)


def nodes(name: str, width: float, height: float, spacing: float) -> tuple[int, int]:
    """Return the numbers of rows and columns of a grid over a rectangle.

    BadValue is raised unless its sizes make sense.
    """
    for what, v in (("width", width), ("height", height), ("spacing", spacing)):
        design_value(f"{name}: {what}", "Above0", v)
    # inf where there is no end
    rows, columns = (float(np.ceil(v / spacing - 1e-9)) + 1 for v in (height, width))
    limits.check("map_points", rows * columns, f"{name}: nodes of the grid; take a larger spacing")
    return int(rows), int(columns)


def _ball(ball: Any) -> tuple[float, float, float, float]:
    try:
        x, y, b, z = (float(v) for v in (*ball, *((DEPTH,) if len(ball) == 3 else ())))
    except (TypeError, ValueError):
        raise BadValue(
            f"nodules: {ball!r:.100} is not x, y, radius and, if wanted, depth, in m"
        ) from None
    # whose powers are numbers
    if not (b >= SMALLEST and all(abs(v) <= 1 / SMALLEST for v in (x, y, z))):
        raise BadValue(
            f"nodules: a ball at {x:g}, {y:g} of radius {b:g}, {z:g} m deep: give numbers in m, and"
            " a radius of at least 1 nm"
        )
    if b > z:
        raise BadValue(
            f"nodules: a ball of radius {b:g} m needs its centre at least that deep, not at {z:g} m"
        )
    return x, y, b, z


@public
def sides(left: str, right: str) -> Levels:
    """Make the stiffness map of the experiment with a mouse.

    Its arguments name the nodule under the middle of each half.

    Parameters
    ----------
    left, right : {"A1", "B1", "C1", "none"}
        ``THIRTEEN`` lists the pairs of the experiment.

    Raises
    ------
    BadValue
        Another name.

    References
    ----------
    Li et al. (2016), fig. 5.

    Examples
    --------
    >>> from stimlib.soft import THIRTEEN, sides
    >>> len(THIRTEEN), sides("A1", "none").levels[30, [15, 45]].round(3)
    (13, array([1., 0.]))
    """
    for name in (left, right):
        one_of("sides", name, tuple(SIDES))
    found = ((x, SIDES[name]) for x, name in ((0.03, left), (0.09, right)))
    return nodules([(x, 0.06, b) for x, b in found if b is not None])


@public
def block(turn: float = 0.0, spacing: float = 0.002) -> Levels:
    """Make the map of the silicone block with nodules A, B and C, rotated by an angle.

    Parameters
    ----------
    turn : float
        In rad, against the clock; "the orientation of the stiffness map was different
        from test to test".
    spacing : float
        See ``nodules``.

    Notes
    -----
    The places are ours: 30 mm from the middle, A straight ahead, then B and C against
    the clock.

    References
    ----------
    Li et al. (2016), "Experimental protocol".

    Examples
    --------
    >>> from stimlib.soft import block
    >>> S = block()
    >>> S.levels[45, 30].round(2), S.levels.max().round(2)  # A
    (np.float64(1.0), np.float64(1.0))
    """
    places = buried(turn)
    return nodules([(*places[name], b) for name, b in RADII.items()], spacing=spacing)


@public
def buried(turn: float = 0.0) -> dict[str, tuple[float, float]]:
    """Return the positions (x, y) in m of the nodules A, B and C.

    Parameters
    ----------
    turn : float
        As of `block`.

    Raises
    ------
    BadValue
        A turn that is no finite number.

    Examples
    --------
    >>> from stimlib.soft import buried
    >>> {name: (round(x, 3), round(y, 3)) for name, (x, y) in buried().items()}
    {'A': (0.06, 0.09), 'B': (0.034, 0.045), 'C': (0.086, 0.045)}
    """
    turn = design_value("block: turn", "float", turn)
    angles = (turn + math.pi / 2 + i * 2 * math.pi / 3 for i in range(3))
    return {
        name: (BLOCK / 2 + 0.03 * math.cos(a), BLOCK / 2 + 0.03 * math.sin(a))
        for name, a in zip(RADII, angles, strict=True)
    }
