"""A finger or pen on a soft surface: how hard it presses, how deep it goes, and how far
the surface goes down around it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..core.graph import Block, Map, as_block, constant, design_value, positive
from ..core.maths import sqrt as root
from ..core.maths import where as choose
from ..core.pointwise import exp, maximum, minimum, where
from ..errors import BadValue, public
from .stiffness import check_places


@public
def press(level: Block | float, contact: Block | None = None) -> Block:
    """Normal force of a pen from the force level that the tablet reports: f = 0.1008
    exp(4.2081 level) N.

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
    return where(
        level if contact is None else contact,
        constant(0.1008, "N") * exp(4.2081 * minimum(level, 1.0)),
        0.0,
    )


@public
def indentation(
    force: Block | float, S, softest: float = 400.0, hardest: float = 1200.0, deepest: float = 0.015
) -> Block:
    """Depth of an indenter under a force, d = f/k with k from ``softest`` at S = 0 to
    ``hardest`` at S = 1, at most ``deepest``.

    The law and its numbers are ours; the source says that depth follows from pressure
    and stiffness.

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
        if not design_value(f"indentation: {name}", "float", v) > 0:
            raise BadValue(f"indentation: {name} = {v!r} must be above 0")
    k = constant(softest, "N/m") + constant(hardest - softest, "N/m") * as_block(S)
    return minimum(as_block(force) / k, constant(deepest, "m"))


@public
def triangle(
    x: Block | float, y: Block | float, side: float = 0.02, turn: float = 0.0
) -> list[tuple[Block, Block]]:
    """Places of three indenters on a rigid triangle whose barycentre follows the hand.
    Each takes a third of the force.

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
    if not design_value("triangle: side", "float", side) > 0:
        raise BadValue(f"triangle: side = {side!r} must be above 0")
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


class DentParams(NamedTuple):
    r: float


@dataclass(frozen=True, eq=False)
class Dent(Map):
    """How far a surface is down at a distance from a ball of radius r that is depth
    deep.
    """

    distance: Block
    depth: Block
    radius: float

    def check(self):
        positive(self, "radius")

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
        reach = choose(d > 2.0 * r, d, 2.0 * r)
        skirt = choose(d > r, (d - r) * (reach - rho) / (reach - r), 0.0)
        around = above_zero(choose(rho <= r, cap, skirt))
        alone = choose(d <= 0.5 * (2.0 - root(3.0)) * r, 0.0, around)
        return choose(d > 0.0, choose(rho == 0.0, d, alone), 0.0 * d), s


def above_zero(x):
    """x where it is above 0, else 0; nan stays."""
    return choose(x <= 0.0, 0.0, x)


@public
def deformation(distance: Any, depth: Any, radius: float = 0.005, join: str = "mean") -> Block:
    """How far a surface is down at some distance from one or more indenters: four
    ranges of depth with their own neighbourhoods.

    Up to (2 - sqrt 3) r/2 only the centre moves; up to r the cap of the ball; up to 2 r
    also a skirt from the ball's rim to 2 r; deeper, the skirt reaches as far as the
    indenter is deep, so that it never is steeper than 45 degrees.

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
        raise BadValue("deformation: give as many depths as distances, one indenter at least")
    if join not in ("mean", "deepest"):
        raise BadValue(f"deformation: join = {join!r}; choose one of mean, deepest")
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
