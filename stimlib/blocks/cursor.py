"""A cursor that slows down over hard places: lateral resistance for the eye."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..core.graph import Block, as_block, positive
from ..core.maths import where
from ..errors import BadValue, public
from .stiffness import Levels, as_levels, check_places, grid, level, levels_of

FRAME = 0.03
"""Of the program of Li et al. (2016), in s: "the frame interval for this program is 30
ms".
"""


EQUAL = 1e-9
"""Largest difference of levels that counts as none: a spline through equal levels has
them to rounding.
"""


class CursorState(NamedTuple):
    x: float
    y: float
    px: float
    py: float
    cold: float


def ratio(S):
    """Way of the cursor over way of the device where the level is S: (1.1 - S)/(1.1 (1
    + S)).
    """
    return (1.1 - S) / (1.1 * (1.0 + S))


def midpoint_ratio(p, x, y, dx, dy):
    """c = ratio(S(x + c dx/2, y + c dy/2)), by Newton's method from the place itself; c
    is between ratio(1) and 1.
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
    """dx = c dp with c = ratio(S) half-way between the old place and the new one: what
    is symmetric in time retraces its path.
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


class FramesParams(NamedTuple):
    c: np.ndarray  # the first eight are the map's, see GridParams
    width: float
    x0: float
    y0: float
    px: float
    py: float
    nx: float
    ny: float
    frame: float  # samples
    slowest: float
    fastest: float


class FramesState(NamedTuple):
    x: float
    y: float
    px: float  # of the device, at the last frame
    py: float
    S: float
    speed: float
    left: float  # samples until the next frame
    cold: float


def next_speed(speed, last, S):
    """Eq. (1) to the letter; levels that differ by their rounding are equal."""
    Ds = abs(S - last)
    changed = where(S > last, speed * (1.1 - S) / (1.0 + Ds), speed / (1.1 - Ds))
    return where(Ds > EQUAL, changed, speed)


@dataclass(frozen=True, eq=False)
class CursorFrames(Block):
    """Eq. (1) once per frame: the level at the cursor, the speed, then a step of speed
    times the device's way.
    """

    px: Block
    py: Block
    contact: Block
    levels: np.ndarray
    width: float
    height: float
    frame: float
    slowest: float
    fastest: float
    outputs = ("x", "y")

    def check(self):
        levels_of(self)
        positive(self, "frame", "slowest")
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
        return (x, y), FramesState(
            x,
            y,
            where(kept, px, s.px),
            where(kept, py, s.py),
            where(kept, S, s.S),
            where(fresh > 0.0, 1.0, where(moves, v, s.speed)),
            where(contact > 0.0, left, 0.0),
            where(contact > 0.0, 0.0, 1.0),
        )


@public
def cursor(
    x: Block | float,
    y: Block | float,
    S: Levels,
    law: str = "reversible",
    contact: Block | float = 1.0,
    frame: float = FRAME,
    bounds: tuple[float, float] = (0.05, 2.0),
) -> Any:
    """A cursor that moves less than the device (a mouse) where the object is harder.

    ``reversible``, ours: dx = g(S) dp with g(S) = (1.1 - S)/(1.1 (1 + S)), eq. (1)'s
    step from 0 to S without its jump of 1.1, S half-way between the old place of the
    cursor and the new one.  ``frames``: eq. (1) to the letter, once per frame.

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
    if law == "frames":
        if not isinstance(bounds, tuple) or len(bounds) != 2:
            raise BadValue(
                f"cursor: bounds = {bounds!r:.100} must be the slowest and the fastest, such as"
                " (0.05, 2.0)"
            )
        return CursorFrames(*signals, *as_levels("cursor", S), frame, *bounds)
    raise BadValue(f"cursor: law = {law!r}; choose one of reversible, frames")
