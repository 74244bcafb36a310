"""Soft objects on a screen: maps of stiffness, and indentation."""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, Literal, NamedTuple

import numpy as np

from ..core import pointwise
from ..core.graph import Block, Map, as_block, constant, design_value
from ..core.maths import sqrt as root, where
from ..core.pointwise import clip, exp, maximum, minimum
from ..core.units import unit
from ..errors import Above0, BadValue, UnitError, public
from ..system.limits import limits
from .impedance import with_unit
from .tables import CubicGrid, GridParams, bicubic, lut2

# Stiffness over a place -------------------------------------------------------------
# How hard a soft object is at each place: levels over a rectangle.
METRE = unit("m")


class Levels(NamedTuple):
    """Stiffness levels over a rectangle, from 0 (the soft object) to 1 (hardest).

    Functions of ``stimlib.soft`` make them.
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
    """Return the distances between columns and between rows in m."""
    rows, columns = S.levels.shape
    return S.width / (columns - 1), S.height / (rows - 1)


def grid(S: Levels) -> GridParams:
    """Return the spline coefficients that ``stiffness_map`` reads."""
    return CubicGrid(
        constant(0.0), constant(0.0), S.levels.T, np.array(spacing(S)), np.zeros(2), ""
    ).design(1.0)[0]


def level(p, x, y):
    """Return the stiffness level S with dS/dx and dS/dy (in 1/m) at a position.

    Where S is clipped at 0 or 1, its slope is 0.
    """
    S, sx, sy = bicubic(p, x, y)
    free = where(S > 0.0, where(S < 1.0, 1.0, 0.0), 0.0)
    return where(S < 0.0, 0.0, where(S > 1.0, 1.0, S)), free * sx, free * sy


def table_of(name: str, levels: Any, width: float, height: float) -> Levels:
    """Return stiffness levels as float64; raise BadValue if they are invalid."""
    table = design_value(f"{name}: levels", "np.ndarray", levels)
    for what, v in (("width", width), ("height", height)):
        design_value(f"{name}: {what}", "Above0", v)
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
    """Return a checked stiffness map; raise BadValue if it is not one."""
    if not isinstance(S, tuple) or len(S) != 3:
        raise BadValue(
            f"{name}: a map is (levels, width, height), not {type(S).__name__}; stimlib.soft.array"
            " makes one from levels"
        )
    return table_of(name, *S)


def levels_of(b: Any) -> Levels:
    """Return the checked stiffness map of a block; raise BadValue if it is invalid."""
    return table_of(type(b).__name__, b.levels, b.width, b.height)


def check_places(name: str, *u: Any) -> None:
    """Raise UnitError unless positions are in m."""
    if any(v != METRE for v in u):
        raise UnitError(f"{name} takes places in m, not {', '.join(f'[{v}]' for v in u)}")


@public
def stiffness_map(x: Block | float, y: Block | float, S: Levels) -> Block:
    """Read the stiffness level of a soft object at a position.

    It is a cubic spline through a table, constant beyond the edges and clipped to 0 ..
    1.

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
    return clip(
        lut2(x, y, S.levels.T, spacing(S), kind="cubic").value,  # type: ignore[attr-defined]
        0.0,
        1.0,
    )


# Indentation ------------------------------------------------------------------------
# A finger or pen on a soft surface: how hard it presses, how deep it goes, and how far
# the surface goes down around it.
@public
def press(level: Block | float, contact: Block | None = None) -> Block:
    """Return the normal force of a pen from the force level of the tablet.

    f = 0.1008 exp(4.2081 level) N.

    Parameters
    ----------
    level : Block
        0 to 1, above which it counts as 1: the exponential would make 30 kN of a tablet
        that is scaled wrongly by three.
    contact : Block, optional
        Where it is not above 0 the force is 0; by default that is where the level is
        not.  The formula is never 0; ours.

    Returns
    -------
    Block
        In N.  One of 1024 levels is 0.41 % of it.

    Raises
    ------
    UnitError
        A level with a unit.

    References
    ----------
    Li et al. (2016), eq. (2).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import press
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"f": press(stimlib.Input("level"))}), fs=1000
    ... )
    >>> proc.process(np.array([[0.0, 0.25, 0.5, 1.0, 3.0]])).round(4)
    array([[0.    , 0.2886, 0.8265, 6.7767, 6.7767]])
    """
    level = as_block(level)
    return pointwise.where(
        level if contact is None else contact,
        constant(0.1008, "N") * exp(4.2081 * minimum(level, 1.0)),
        0.0,
    )


@public
def indentation(
    force: Block | float, S, softest: float = 400.0, hardest: float = 1200.0, deepest: float = 0.015
) -> Block:
    """Compute the depth of an indenter under a force, d = f/k.

    k rises from ``softest`` at S = 0 to ``hardest`` at S = 1; d is at most ``deepest``.

    The law and its numbers are our choice; the source says only that depth follows from
    pressure and stiffness.

    Parameters
    ----------
    force : Block
        Normal force in N.
    S : Block
        Stiffness level, 0 to 1.
    softest, hardest : float
        In N/m.
    deepest : float
        In m; 0.6 of the block of 25 mm, and where eq. (2) ends over the softest place.

    Returns
    -------
    Block
        In m.

    Raises
    ------
    BadValue
        Numbers not above 0.
    UnitError
        A force not in N, a level with a unit.

    References
    ----------
    Li et al. (2016), "Single-point pseudo-haptic interaction".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import indentation
    >>> d = indentation(stimlib.constant(1.0, "N"), stimlib.Input("S"))
    >>> 1000 * stimlib.compile(stimlib.Scene({"d": d}), fs=1000).process(
    ...     np.array([[0.0, 0.5, 1.0]])
    ... ).round(7)
    array([[2.5   , 1.25  , 0.8333]])
    """
    for name, v in (("softest", softest), ("hardest", hardest), ("deepest", deepest)):
        design_value(f"indentation: {name}", "Above0", v)
    k = constant(softest, "N/m") + constant(hardest - softest, "N/m") * as_block(S)
    return minimum(with_unit(force, "N") / k, constant(deepest, "m"))


@public
def triangle(
    x: Block | float, y: Block | float, side: float = 0.02, turn: float = 0.0
) -> list[tuple[Block, Block]]:
    """Compute the positions of three indenters on a rigid triangle moved by the hand.

    The hand moves the triangle's barycentre; each indenter takes a third of the force.

    Parameters
    ----------
    x, y : Block
        Place of the barycentre in m.
    side : float
        In m; equilateral, ours.
    turn : float
        In rad; at 0 the first is straight ahead (towards larger y).

    Returns
    -------
    list of (Block, Block)
        x and y of each, in m.

    Raises
    ------
    BadValue
        A side not above 0.
    UnitError
        Places that are not in m.

    References
    ----------
    Li et al. (2016), "Multi-point pseudo-haptic interaction", fig. 4.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import triangle
    >>> (x1, y1), (x2, y2), _ = triangle(
    ...     stimlib.Input("x", "m"), stimlib.Input("y", "m")
    ... )
    >>> proc = stimlib.compile(stimlib.Scene({"y1": y1, "x2": x2, "y2": y2}), fs=1000)
    >>> (1000 * proc.process(np.array([[0.03], [0.03]]))[:, 0]).round(4)
    array([41.547 , 20.    , 24.2265])
    """
    design_value("triangle: side", "Above0", side)
    x, y = as_block(x), as_block(y)
    check_places("triangle", x.dim, y.dim)
    angles = [
        design_value("triangle: turn", "float", turn) + math.pi / 2 + i * 2 * math.pi / 3
        for i in range(3)
    ]
    arm = side / math.sqrt(3)
    return [
        (x + constant(arm * math.cos(a), "m"), y + constant(arm * math.sin(a), "m")) for a in angles
    ]


# Parameters of `Dent` at a sample rate.
DentParams = namedtuple("DentParams", "r")


@dataclass(frozen=True, eq=False)
class Dent(Map):
    """Depth of a surface at a distance from a ball of radius r pressed into it."""

    distance: Block
    depth: Block
    radius: Above0

    def units(self, *u):
        check_places("deformation", *u)
        return u[1]

    def design(self, fs):
        return DentParams(self.radius), ()

    @staticmethod
    def step(p, s, distance, depth):
        rho, d, r = abs(distance), depth, p.r
        under = r * r - rho * rho
        cap = d - r + root(above_zero(under))
        reach = where(d > 2.0 * r, d, 2.0 * r)
        skirt = where(d > r, (d - r) * (reach - rho) / (reach - r), 0.0)
        around = above_zero(where(rho <= r, cap, skirt))
        alone = where(d <= 0.5 * (2.0 - root(3.0)) * r, 0.0, around)
        return where(d > 0.0, where(rho == 0.0, d, alone), 0.0 * d), s


def above_zero(x):
    """Return x where it is above 0, else 0; NaN stays NaN."""
    return where(x <= 0.0, 0.0, x)


@public
def deformation(
    distance: Any, depth: Any, radius: float = 0.005, join: Literal["mean", "deepest"] = "mean"
) -> Block:
    """Compute the depth of a deformed surface at some distance from indenters.

    Four ranges of depth deform different regions.

    Up to (2 - sqrt 3) r/2 only the centre moves; up to r the cap of the ball; up to 2 r
    also a skirt from the ball's rim to 2 r. Deeper, the skirt reaches as far as the
    indenter is deep, so it is never steeper than 45 degrees.

    Parameters
    ----------
    distance : Block, or sequence of them
        Lateral distance from the indenter in m; of several, one each.
    depth : Block, or sequence of them
        Of each indenter in m.
    radius : float
        r in m.
    join : {"mean", "deepest"}
        Where neighbourhoods overlap: the mean of those that reach there (the source),
        or the deepest, which does not tear.

    Returns
    -------
    Block
        In m, down is positive.

    Raises
    ------
    BadValue
        A radius not above 0, an unknown join, not as many distances as depths.
    UnitError
        Distances or depths that are not in m.

    Notes
    -----
    On a grid of r/2 the heights are continuous where the ranges meet, for (2 - sqrt 3)
    r/2 is how deep a ball reaches nodes r/2 away.  The borders and the mean are the
    source's, the heights are ours.  Where three indenters of 15 mm overlap, the mean
    has steps of 7.6 mm between nodes 1 mm apart, the deepest 3.0 mm.

    References
    ----------
    Li et al. (2016), "Multi-point pseudo-haptic interaction".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import deformation
    >>> down = deformation(stimlib.Input("rho", "m"), stimlib.constant(0.0075, "m"))
    >>> rho = np.array([[0, 0.0025, 0.005, 0.0075, 0.01]])
    >>> 1000 * stimlib.compile(stimlib.Scene({"down": down}), fs=1000).process(
    ...     rho
    ... ).round(6)
    array([[7.5 , 6.83, 2.5 , 1.25, 0.  ]])
    """
    several = isinstance(distance, Sequence), isinstance(depth, Sequence)
    if several[0] != several[1] or (several[0] and not 1 <= len(distance) == len(depth)):
        raise BadValue("deformation: give as many depths as distances, for at least one indenter")
    pairs = zip(distance, depth, strict=True) if several[0] else [(distance, depth)]
    dents: list[Block] = [Dent(as_block(rho), as_block(d), radius) for rho, d in pairs]
    if join == "deepest":
        return reduce(maximum, dents)
    total = dents[0]
    reached = dents[0] > 0.0
    for d in dents[1:]:
        total, reached = total + d, reached + (d > 0.0)
    return total if len(dents) == 1 else total / maximum(reached, 1.0)
