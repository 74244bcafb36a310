"""How hard a soft object is at each place: levels over a rectangle."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..core.graph import Block, as_block, constant, design_value
from ..core.maths import where
from ..core.pointwise import clip
from ..core.units import unit
from ..errors import BadValue, UnitError, public
from ..system.limits import limits
from .grid import CubicGrid, GridParams, bicubic, lut2

METRE = unit("m")


class Levels(NamedTuple):
    """Stiffness levels of a rectangle: 0 as soft as the object, 1 the hardest;
    ``stimlib.soft`` makes them.
    """

    levels: np.ndarray
    """Shape (rows, columns), 0 to 1; the first row is at y = 0, the first column at x
    = 0.
    """
    width: float
    """In m, from the first column to the last."""
    height: float
    """In m, from the first row to the last."""


def spacing(S: Levels) -> tuple[float, float]:
    """From column to column and from row to row, in m."""
    rows, columns = S.levels.shape
    return S.width / (columns - 1), S.height / (rows - 1)


def grid(S: Levels) -> GridParams:
    """The numbers of the spline that ``stiffness_map`` reads."""
    return CubicGrid(
        constant(0.0), constant(0.0), S.levels.T, np.array(spacing(S)), np.zeros(2), ""
    ).design(1.0)[0]


def level(p, x, y):
    """S, dS/dx, dS/dy at a place, in 1 and 1/m; where S is held at 0 or 1 it has no
    slope.
    """
    S, sx, sy = bicubic(p, x, y)
    free = where(S > 0.0, where(S < 1.0, 1.0, 0.0), 0.0)
    return where(S < 0.0, 0.0, where(S > 1.0, 1.0, S)), free * sx, free * sy


def table_of(name: str, levels: Any, width: float, height: float) -> Levels:
    """Levels that make sense, as float64; BadValue if they do not."""
    table = design_value(f"{name}: levels", "np.ndarray", levels)
    for what, v in (("width", width), ("height", height)):
        if not design_value(f"{name}: {what}", "float", v) > 0:
            raise BadValue(f"{name}: {what} = {v!r} m must be above 0")
    if table.ndim != 2 or min(table.shape) < 2:
        raise BadValue(
            f"{name}: levels must have two rows and columns at least; got the shape {table.shape}"
        )
    limits.check("map_points", table.size, f"{name}: levels of a stiffness map")
    if not (table.min() >= 0 and table.max() <= 1):
        raise BadValue(
            f"{name}: levels must be 0 to 1, as S in eq. (1); got {table.min():g} to"
            f" {table.max():g}"
        )
    return Levels(table, float(width), float(height))


def as_levels(name: str, S: Any) -> Levels:
    """A map that somebody gives; BadValue if it is none."""
    if not isinstance(S, tuple) or len(S) != 3:
        raise BadValue(
            f"{name}: a map is (levels, width, height), not {type(S).__name__}; stimlib.soft.array"
            " makes one of levels"
        )
    return table_of(name, *S)


def levels_of(b: Any) -> Levels:
    """The map of a block that has one; BadValue if it makes no sense."""
    return table_of(type(b).__name__, b.levels, b.width, b.height)


def check_places(name: str, *u: Any) -> None:
    """Raise UnitError unless places are in m."""
    if any(v != METRE for v in u):
        raise UnitError(f"{name} takes places in m, not {', '.join(f'[{v}]' for v in u)}")


@public
def stiffness_map(x: Block | float, y: Block | float, S: Levels) -> Block:
    """Stiffness level of a soft object at a place: a cubic spline through a table, held
    at its edges and between 0 and 1.

    Parameters
    ----------
    x, y : Block
        Place in m, from the object's corner.
    S : Levels
        ``(levels, width, height)``: shape (rows, columns), 0 to 1, and the size in m;
        ``stimlib.soft`` makes them of nodules, pictures and arrays.

    Returns
    -------
    Block
        0 (the object itself) to 1 (the hardest), without unit.

    Raises
    ------
    BadValue
        Levels outside 0 to 1 or not finite, fewer than two rows or columns, a size not
        above 0; more levels than ``limits.map_points``.
    UnitError
        Places that are not in m.

    Notes
    -----
    It is ``lut2`` with ``kind="cubic"``, and ``clip``: between levels that jump the
    spline swings, and is cut at 0 and 1.

    References
    ----------
    Li et al. (2016), "Single-point pseudo-haptic interaction": "a predefined 2D
    stiffness distribution". Theirs was measured and is not published; how the levels
    between are found, they do not say.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import stiffness_map
    >>> S = stiffness_map(
    ...     stimlib.Input("x", "m"),
    ...     stimlib.Input("y", "m"),
    ...     ([[0, 0.5, 1], [0, 0.5, 1]], 0.02, 0.01),
    ... )
    >>> stimlib.compile(stimlib.Scene({"S": S}), fs=1000).process(
    ...     np.array([[0.0, 0.005, 0.02, 0.03], [0, 0, 0, 0]])
    ... )
    array([[0.  , 0.25, 1.  , 1.  ]])
    """
    S = as_levels("stiffness_map", S)
    x, y = as_block(x), as_block(y)
    check_places("stiffness_map", x.dim, y.dim)
    return clip(lut2(x, y, S.levels.T, spacing(S), kind="cubic").value, 0.0, 1.0)  # type: ignore[attr-defined]
