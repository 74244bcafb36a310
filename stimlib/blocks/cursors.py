"""A cursor that slows down over hard places: lateral resistance for the eye."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..core.graph import Block, as_block
from ..core.maths import where
from ..errors import Above0, BadValue, public
from .soft import Levels, as_levels, check_places, grid, level, levels_of

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
class OverMap(Block, abstract=True):
    """Base class of cursors that move over a map of levels."""

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


@dataclass(frozen=True, eq=False)
class Cursor(OverMap):
    """A reversible cursor: dx = c dp, with c = ratio(S) half-way along its step.

    Because the rule is symmetric in time, a movement back retraces the path.
    """

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
class CursorFrames(OverMap):
    """A cursor by eq. (1) of the paper, computed once per frame.

    The level at the cursor gives the speed; then the cursor moves by speed times the
    displacement of the device.
    """

    frame: Above0
    slowest: Above0
    fastest: float

    def check(self):
        super().check()
        if not self.slowest <= 1 <= self.fastest:
            raise BadValue(
                f"cursor: the speed begins at 1, which is not within bounds = ({self.slowest:g},"
                f" {self.fastest:g})"
            )

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
