"""Soft objects on a screen: maps of stiffness, indentation, pseudo-haptic cursors."""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ..core import pointwise
from ..core.graph import NONE, ONE, Block, Map, as_block, constant, design_value, in_unit
from ..core.maths import as_float, floor, sqrt as root, where
from ..core.pointwise import clip, exp, maximum, minimum
from ..core.units import unit
from ..errors import Above0, BadValue, From0, UnitError, public
from ..system.limits import limits
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
    return minimum(as_block(force) / k, constant(deepest, "m"))


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
    dents = [Dent(as_block(rho), as_block(d), radius) for rho, d in pairs]
    total: Block = dents[0]
    if join == "deepest":
        for d in dents[1:]:
            total = maximum(total, d)
        return total
    reached = dents[0] > 0.0
    for d in dents[1:]:
        total, reached = total + d, reached + (d > 0.0)
    return total if len(dents) == 1 else total / maximum(reached, 1.0)


# A cursor that slows down -----------------------------------------------------------
# A cursor that slows down over hard places: lateral resistance for the eye.
FRAME = 0.03
"""Of the program of Li et al. (2016), in s: "the frame interval for this program is 30
ms".
"""


EQUAL = 1e-9
"""Largest difference of levels that counts as none: a spline through equal levels has
them to rounding.
"""


# State of `Cursor` between samples.
CursorState = namedtuple("CursorState", "x y px py cold")


def ratio(S):
    """Return cursor over device displacement at a level, (1.1 - S)/(1.1 (1 + S))."""
    return (1.1 - S) / (1.1 * (1.0 + S))


def midpoint_ratio(p, x, y, dx, dy):
    """Return the cursor's displacement ratio at the midpoint of its step.

    It solves c = ratio(S(x + c dx/2, y + c dy/2)) by Newton's method, starting with the
    ratio at the position itself; c lies between ratio(1) and 1.
    """
    c = ratio(level(p, x, y)[0])
    for _ in range(5):
        S, sx, sy = level(p, x + 0.5 * c * dx, y + 0.5 * c * dy)
        slope = -2.1 / (1.1 * (1.0 + S) * (1.0 + S)) * (0.5 * (sx * dx + sy * dy))
        c = c - (ratio(S) - c) / (slope - 1.0)
        c = where(c < 1.0 / 22.0, 1.0 / 22.0, where(c > 1.0, 1.0, c))
    return c


@dataclass(frozen=True, eq=False)
class Cursor(Block):
    """A reversible cursor: dx = c dp, with c = ratio(S) half-way along its step.

    Because the rule is symmetric in time, a movement back retraces the path.
    """

    px: Block
    py: Block
    contact: Block
    levels: np.ndarray
    width: float
    height: float
    outputs = ("x", "y")

    def check(self):
        levels_of(self)

    def units(self, *u):
        check_places("cursor", *u[:2])
        return u[0], u[1]

    def design(self, fs):
        return grid(levels_of(self)), CursorState(0.0, 0.0, 0.0, 0.0, 1.0)

    @staticmethod
    def step(p, s, px, py, contact):
        dx, dy = px - s.px, py - s.py
        c = midpoint_ratio(p, s.x, s.y, dx, dy)
        x = where(contact > 0.0, where(s.cold > 0.0, px, s.x + c * dx), s.x)
        y = where(contact > 0.0, where(s.cold > 0.0, py, s.y + c * dy), s.y)
        return (x, y), CursorState(x, y, px, py, where(contact > 0.0, 0.0, 1.0))


# Parameters of `CursorFrames` at a sample rate.
#   c      the first eight are the map's, see GridParams
#   frame  samples
FramesParams = namedtuple("FramesParams", "c width x0 y0 px py nx ny frame slowest fastest")

# State of `CursorFrames` between samples.
#   px    of the device, at the last frame
#   left  samples until the next frame
FramesState = namedtuple("FramesState", "x y px py S speed left cold")


def next_speed(speed, last, S):
    """Return the cursor's next speed by eq. (1) of the paper, taken literally.

    Levels that differ only by rounding count as equal.
    """
    Ds = abs(S - last)
    changed = where(S > last, speed * (1.1 - S) / (1.0 + Ds), speed / (1.1 - Ds))
    return where(Ds > EQUAL, changed, speed)


@dataclass(frozen=True, eq=False)
class CursorFrames(Block):
    """A cursor by eq. (1) of the paper, computed once per frame.

    The level at the cursor gives the speed; then the cursor moves by speed times the
    displacement of the device.
    """

    px: Block
    py: Block
    contact: Block
    levels: np.ndarray
    width: float
    height: float
    frame: Above0
    slowest: Above0
    fastest: float
    outputs = ("x", "y")

    def check(self):
        levels_of(self)
        if not self.slowest <= 1 <= self.fastest:
            raise BadValue(
                f"cursor: the speed begins at 1, which is not within bounds = ({self.slowest:g},"
                f" {self.fastest:g})"
            )

    def units(self, *u):
        check_places("cursor", *u[:2])
        return u[0], u[1]

    def design(self, fs):
        p = FramesParams(*grid(levels_of(self)), self.frame * fs, self.slowest, self.fastest)
        return p, FramesState(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0)

    @staticmethod
    def step(p, s, px, py, contact):
        fresh = where(contact > 0.0, s.cold, 0.0)
        begins = where(contact > 0.0, where(s.left < 0.5, 1.0, 0.0), 0.0)
        S = level(p, where(fresh > 0.0, px, s.x), where(fresh > 0.0, py, s.y))[0]
        v = next_speed(s.speed, s.S, S)
        v = where(v < p.slowest, p.slowest, where(v > p.fastest, p.fastest, v))
        moves = where(fresh > 0.0, 0.0, begins) > 0.0
        x = where(fresh > 0.0, px, where(moves, s.x + v * (px - s.px), s.x))
        y = where(fresh > 0.0, py, where(moves, s.y + v * (py - s.py), s.y))
        kept = where(moves, 1.0, fresh) > 0.0
        left = where(s.left > -0.5, s.left, -0.5) + where(begins > 0.0, p.frame, 0.0) - 1.0
        S, speed = where(kept, S, s.S), where(fresh > 0.0, 1.0, where(moves, v, s.speed))
        left, cold = where(contact > 0.0, left, 0.0), where(contact > 0.0, 0.0, 1.0)
        px, py = where(kept, px, s.px), where(kept, py, s.py)
        return (x, y), FramesState(x, y, px, py, S, speed, left, cold)


@public
def cursor(
    x: Block | float,
    y: Block | float,
    S: Levels,
    law: Literal["reversible", "frames"] = "reversible",
    contact: Block | float = 1.0,
    frame: float = FRAME,
    bounds: tuple[float, float] = (0.05, 2.0),
) -> Any:
    """Move a cursor less than the device (a mouse) where the object is harder.

    ``reversible`` is our law: dx = g(S) dp with g(S) = (1.1 - S)/(1.1 (1 + S)), which
    is the step of eq. (1) from 0 to S without its jump of 1.1, and S half-way between
    the old position of the cursor and the new one. ``frames`` is eq. (1) taken
    literally, once per frame.

    Parameters
    ----------
    x, y : Block
        Place of the device in m, of which only differences count; it is also where the
        cursor starts.
    S : Levels
        See ``stiffness_map``.
    law : {"reversible", "frames"}
    contact : Block
        Where it is not above 0 the cursor stands still (at 0 before the first contact).
        At re-contact it starts at the device's place, ``frames`` with speed 1 again.
    frame : float
        Of ``frames``, in s.
    bounds : (float, float)
        Of its speed, which eq. (1) alone lets vanish and explode; ours.

    Returns
    -------
    Block
        With the outputs ``x`` and ``y``, in m.

    Raises
    ------
    BadValue
        An unknown law; bounds that leave out 1 or 0; what ``stiffness_map`` refuses.
    UnitError
        Places that are not in m.

    Notes
    -----
    Movement h of the device per sample errs, at the place X, by h^2 g(X) times the
    integral of (g'^2/12 - g g''/24)/g over the path, at most by that of the absolute
    value: 34 um for h = 1 mm over a bump exp(-x^2/2 s^2) of s = 5 mm.  A path that is
    retraced leads back, to rounding, at any sample rate, as long as h times the
    steepest slope of g is below 1: h = 5 mm over the largest nodule.  A closed loop
    does not, so this is for relative devices; a pen uses ``delay_avatar``.

    References
    ----------
    Li et al. (2016), eq. (1).  Unit, start and bounds of CursorSpeed are open there; it
    is read as a ratio that starts at 1.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import cursor
    >>> ramp = [[0, 1], [0, 1]], 0.01, 0.01  # S = x / 10 mm
    >>> place = cursor(stimlib.Input("x", "m"), stimlib.constant(0.0, "m"), ramp)
    >>> proc = stimlib.compile(stimlib.Scene({"x": place.x}), fs=1000)
    >>> (
    ...     1000 * proc.process(np.array([[0.0, 0.001, 0.002, 0.004, 0.002, 0.001]]))[0]
    ... ).round(4)
    array([0.    , 0.9164, 1.6958, 2.9732, 1.6958, 0.9164])
    """
    signals = as_block(x), as_block(y), as_block(contact)
    if law == "reversible":
        return Cursor(*signals, *as_levels("cursor", S))
    return CursorFrames(*signals, *as_levels("cursor", S), frame, *bounds)


# An avatar that lags behind ---------------------------------------------------------
# An avatar that lags behind a pen where a soft object becomes harder, and the vibration
# in its place.
SECOND, NEWTON = unit("s"), unit("N")
WIDER = 1e-9  # a rise that is the smallest but for its rounding counts


def avatar_units(u: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the units of x, y, lag and wait; raise UnitError for wrong inputs."""
    check_places("delay_avatar", *u[:2])
    if u[2] != NEWTON:
        raise UnitError(f"delay_avatar takes a tangential force in N, not [{u[2]}]")
    return u[0], u[1], SECOND, SECOND


# Parameters of `DelayAvatar` at a sample rate.
#   per_newton  samples
#   most        samples
#   size        of the history
StreamParams = namedtuple("StreamParams", "fs per_newton notice catch_up most size")

# State of `DelayAvatar` between samples.
#   at    place of the newest sample
#   lag   samples
#   owed  samples still to stand
StreamState = namedtuple("StreamState", "xs ys forces at lag owed low x y cold")


def earlier(line, a, b, w):
    """Return a position interpolated between samples a and b, with weight w for b."""
    return line[np.uint64(a)] + w * (line[np.uint64(b)] - line[np.uint64(a)])


def before(i, n, size):
    """Return the index n samples before i in a ring buffer."""
    return where(i < n, i - n + size, i - n)


@dataclass(frozen=True, eq=False)
class DelayAvatar(Block):
    """An avatar at the position that the device had at an earlier time u, a signal.

    A rise of the force stops u; then u advances faster than time until it has caught
    up.
    """

    px: Block
    py: Block
    force: Block
    contact: Block
    per_newton: Above0
    notice: From0
    catch_up: Above0
    most: Above0
    outputs = ("x", "y", "lag", "wait")

    def units(self, *u):
        return avatar_units(u)

    def design(self, fs):
        limits.check(
            "state_bytes",
            24 * self.most * fs,
            f"delay_avatar: bytes of its history at fs = {fs:g} Hz",
        )
        n = int(self.most * fs) + 2
        p = StreamParams(
            fs,
            self.per_newton * fs,
            self.notice * (1 - WIDER),
            self.catch_up,
            self.most * fs,
            float(n),
        )
        lines = np.zeros(n), np.zeros(n), np.zeros(n)
        return p, StreamState(*lines, np.uint64(0), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

    @staticmethod
    def step(p, s, px, py, force, contact):
        size = np.uint64(s.xs.size)
        at = where(s.at + ONE < size, s.at + ONE, NONE)
        s.xs[at], s.ys[at], s.forces[at] = px, py, force
        # as it did at the last sample
        runs = where(contact > 0.0, where(s.cold > 0.0, 0.0, 1.0), 0.0) > 0.0
        owed, lag = where(runs, s.owed, 0.0), where(runs, s.lag, 0.0)
        stop = where(owed < 1.0, owed, 1.0)
        behind = lag + stop
        made_up = p.catch_up * (1.0 - stop)
        lag = where(made_up < behind, behind - made_up, 0.0)
        # a state may come from anywhere
        lag = where(lag > 0.0, where(lag < p.most, lag, p.most), 0.0)
        whole = floor(lag)
        a, w = before(as_float(at), whole, p.size), lag - whole
        b = before(a, 1.0, p.size)
        x, y, f = earlier(s.xs, a, b, w), earlier(s.ys, a, b, w), earlier(s.forces, a, b, w)
        low = where(runs, s.low, f)
        rise = where(f - low >= p.notice, f - low, 0.0)
        room = p.most - lag - (owed - stop)
        wait = where(
            rise > 0.0,
            where(p.per_newton * rise < room, p.per_newton * rise, where(room > 0.0, room, 0.0)),
            0.0,
        )
        on = contact > 0.0
        x, y, lag, wait = (
            where(on, x, s.x),
            where(on, y, s.y),
            where(on, lag, 0.0),
            where(on, wait, 0.0),
        )
        low = where(rise > 0.0, f, where(f < low, f, low))
        after = StreamState(
            s.xs, s.ys, s.forces, at, lag, owed - stop + wait, low, x, y, where(on, 0.0, 1.0)
        )
        return (x, y, lag / p.fs, wait / p.fs), after


# Parameters of `FrameAvatar` at a sample rate.
#   per_newton  s/N
#   frame       s
FrameParams = namedtuple("FrameParams", "fs per_newton notice frame")

# State of `FrameAvatar` between samples.
#   left   samples until the next frame
#   since  samples since this one began
FrameState = namedtuple("FrameState", "x y force left since cold")


@dataclass(frozen=True, eq=False)
class FrameAvatar(Block):
    """An avatar at the device's position at the start of each frame, by eq. (3).

    A rise of the force lengthens the frame. Eq. (3) of the paper is taken literally.
    """

    px: Block
    py: Block
    force: Block
    contact: Block
    per_newton: Above0
    notice: From0
    frame: Above0
    outputs = ("x", "y", "lag", "wait")

    def units(self, *u):
        return avatar_units(u)

    def design(self, fs):
        p = FrameParams(fs, self.per_newton, self.notice * (1 - WIDER), self.frame)
        return p, FrameState(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

    @staticmethod
    def step(p, s, px, py, force, contact):
        on = contact > 0.0
        begins = where(on, where(s.left < 0.5, 1.0, 0.0), 0.0) > 0.0
        rise = force - where(s.cold > 0.0, force, s.force)
        wait = where(begins, where(rise >= p.notice, p.per_newton * rise, 0.0), 0.0)
        x, y, f = where(begins, px, s.x), where(begins, py, s.y), where(begins, force, s.force)
        since = where(begins, 0.0, where(on, s.since + 1.0, 0.0))
        left = (
            where(s.left > -0.5, s.left, -0.5) + where(begins, (p.frame + wait) * p.fs, 0.0) - 1.0
        )
        after = FrameState(x, y, f, where(on, left, 0.0), since, where(on, 0.0, 1.0))
        return (x, y, since / p.fs, wait), after


@public
def delay_avatar(
    x: Block | float,
    y: Block | float,
    force: Block | float,
    law: Literal["streaming", "frames"] = "streaming",
    contact: Block | float = 1.0,
    per_newton: float = 0.5,
    notice: float = 0.1,
    catch_up: float = 1.0,
    most: float = 0.3,
    frame: float = FRAME,
) -> Any:
    """Move an avatar that pauses when a pen moves on to a harder position.

    It pauses for t_d = m (rise of the tangential force), eq. (3).

    ``streaming`` is our law and gives the same result at every sample rate: rises add
    up since the last pause, or since the lowest force after it; once they reach
    ``notice`` the avatar pauses for m times their sum, then follows the path ``1 +
    catch_up`` times as fast as the device moved until it has caught up. So it never
    jumps. ``frames`` is eq. (3) once per frame; the delay lengthens the frame, then the
    avatar jumps to the contact point.

    Parameters
    ----------
    x, y : Block
        Place of the device in m.
    force : Block
        Tangential force at that place in N, such as 0.4 N times the stiffness level;
        the streaming law takes it at the time that the avatar shows, so it is that
        where the avatar is.
    law : {"streaming", "frames"}
    contact : Block
        Where it is not above 0 the avatar stands (at 0 before the first contact); at
        re-contact it starts at the device's place.
    per_newton : float
        m in s/N: 50 ms per 0.1 N.
    notice : float
        Smallest rise in N that makes a stop; 0 stops continuously (streaming).
    catch_up, most : float
        Of the streaming law: how much faster it follows, and the longest lag in s.
    frame : float
        Of the law of frames, in s.

    Returns
    -------
    Block
        With the outputs ``x`` and ``y`` in m, ``lag`` in s, and ``wait``: events, the
        length in s of each stop where it is found.

    Raises
    ------
    BadValue
        An unknown law; numbers not above 0, a notice below.
    UnitError
        Places not in m, a force not in N.

    See Also
    --------
    vibration : the same events for the skin.

    References
    ----------
    Li et al. (2016), eq. (3): m = 50/0.1 = 500 in ms/N; 0.1 N is read as the threshold
    below which there is no delay.  When a lag ends is open there.

    Examples
    --------
    A force that steps by 0.2 N at 20 mm stops the avatar for 0.1 s:

    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import delay_avatar, where
    >>> x = stimlib.Input("x", "m")
    >>> f = stimlib.constant(0.2, "N") * (x > stimlib.constant(0.0195, "m"))
    >>> a = delay_avatar(x, stimlib.constant(0.0, "m"), f)
    >>> proc = stimlib.compile(stimlib.Scene({"x": a.x, "wait": a.wait}), fs=100)
    >>> place, wait = proc.process(np.arange(0.0, 0.06, 0.001)[None])
    >>> wait[20].round(9), 1000 * place[[19, 20, 25, 30, 31, 32, 40, 41]].round(9)
    (np.float64(0.1), array([19., 20., 20., 20., 22., 24., 40., 41.]))
    """
    signals = as_block(x), as_block(y), as_block(force), as_block(contact)
    if law == "streaming":
        return DelayAvatar(*signals, per_newton, notice, catch_up, most)
    return FrameAvatar(*signals, per_newton, notice, frame)


# Parameters of `Vibration` at a sample rate.
VibrationParams = namedtuple("VibrationParams", "factor per_ms")

# State of `Vibration` between samples.
#   left  samples
VibrationState = namedtuple("VibrationState", "left")


@dataclass(frozen=True, eq=False)
class Vibration(Block):
    """The drive of a vibration motor: 1 for a whole number of ms after each event."""

    wait: Block
    factor: Above0

    def units(self, *u):
        in_unit("vibration: wait", self.wait, u[0], "s")  # of delay_avatar
        return u[0] / SECOND

    def design(self, fs):
        return VibrationParams(self.factor, fs / 1000), VibrationState(0.0)

    @staticmethod
    def step(p, s, wait):
        left = s.left + floor(1000.0 * (p.factor * wait) + 0.5) * p.per_ms
        return where(left >= 0.5, 1.0, 0.0), VibrationState(where(left >= 1.0, left - 1.0, 0.0))


@public
def vibration(wait: Block | float, factor: float = 1.0) -> Block:
    """Drive a vibration motor for ``factor`` times the length of each avatar pause.

    The drive is 1 for that time, rounded to whole ms, else 0.

    Parameters
    ----------
    wait : Block
        Events in s: the ``wait`` of ``delay_avatar``.
    factor : float
        Ours: "proportionally" is all that is said.

    Raises
    ------
    BadValue
        A factor not above 0.
    UnitError
        Events that are not in s.

    Notes
    -----
    What is asked for while the motor runs is added to what is left, as the stops of the
    avatar add up.

    References
    ----------
    Li et al. (2016), "Vibration feedback for haptic interaction".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import vibration
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"drive": vibration(stimlib.Input("wait", "s"))}), fs=1000
    ... )
    >>> proc.process(np.array([[0.0, 0.0029, 0.0, 0.0, 0.0]]))
    array([[0., 1., 1., 1., 0.]])
    """
    return Vibration(as_block(wait), factor)
