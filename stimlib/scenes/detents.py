"""A knob with detents, and the friction of its bearing."""

from __future__ import annotations

from math import pi

from .. import blocks
from ..core.graph import Input, constant
from ..core.parameter import Param
from ..core.scene import Scene
from .shipped import above_zero, shipped


@shipped(
    felt=("A knob snaps from one detent to the next, with some dry friction."),
    do="turn the knob: from left to right is one turn",
    words=(
        "T = depth sin(count angle) + Coulomb's friction of a spring, each a mean over the movement"
        " of a sample (our own)"
    ),
    full={"N·m": 0.05},
    drive={"angle": "sinusoid(1.0, 2.0)"},
    ranges={"angle": (0.0, 2 * pi)},
)
def detents(
    count: int = 24,
    depth: float = 0.02,
    friction: float = 0.004,
    presliding: float = 0.01,
    contact: bool = False,
) -> Scene:
    """Compose the torque of a knob with regular detents and dry friction.

    It is depth sin(count angle) plus Coulomb friction with a spring.

    Parameters
    ----------
    count : int
        Detents in a turn.
    depth : float
        Largest torque of the detents in N m, live as ``depth``.
    friction : float
        Torque of the friction in N m, live as ``friction``.
    presliding : float
        Angle in rad that the friction gives way before it slips, at the ``friction``
        given here.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not).

    Returns
    -------
    Scene
        Input ``angle`` in rad, output ``torque`` in N m.

    Raises
    ------
    BadValue
        count, friction or presliding not above 0, a depth below 0.

    References
    ----------
    Our own, of the blocks ``detents`` and ``friction``; the numbers are no measurement.

    Examples
    --------
    >>> from stimlib.scenes import detents
    >>> detents(count=12)
    Scene(angle [1], depth [N·m], friction [N·m] -> torque [N·m])
    """
    above_zero("detents", count=count, friction=friction, presliding=presliding)
    angle, touching = Input("angle", "rad"), Input("contact") if contact else 1.0
    drawn = blocks.detents(angle, 2 * pi / count, Param("depth", depth, "N*m"), touching)
    stiffness, torque = constant(friction / presliding, "N*m"), Param("friction", friction, "N*m")
    rubbed = blocks.friction(angle, torque, 1.0, stiffness, "coulomb", contact=touching)
    return Scene({"torque": drawn + rubbed})
