"""A soft object with hard nodules on a screen, judged by sight: Li et al. (2016).

"Evaluation of Pseudo-Haptic Interactions with Soft Objects in Virtual Environments";
see docs/reference/papers.rst.
"""

from __future__ import annotations

from ..blocks import cursor, delay_avatar, indentation, press, stiffness_map, triangle, vibration
from ..blocks.soft import as_levels
from ..core.graph import Block, Input, as_block, constant
from ..core.parameter import Param
from ..core.scene import Scene
from ..errors import BadValue, one_of
from ..soft.maps import block
from .shipped import above_zero, shipped

MODES = ("cursor", "deformation", "combined", "vibration", "multipoint")
DEVICES = ("pen", "mouse")


@shipped(
    felt=("A soft object on a screen has hard nodules: there the avatar waits, and sinks in less."),
    do="move over the object and press on it",
    words=(
        "an avatar follows the pointer at the speed (1.1 - S)/(1.1 (1 + S)), or waits 0.5 s for"
        " each newton the tangential force rises; it goes f/(0.4 + 0.8 S) mm deep, f = 0.1008"
        " exp(4.2081 pressure) N; S is the level of the map there (the pseudo-haptics paper, eqs."
        " (1) to (3), and readings of our own)"
    ),
    full={"m": 0.5, "N": 20.0},
    drive={
        "x": "sinusoid(0.04, 0.7, 0.06)",
        "y": "sinusoid(0.03, 0.9, 0.05)",
        "press": "sinusoid(0.49, 0.5, 0.5)",
    },
)
def soft_surface(
    mode: str = "combined",
    device: str = "pen",
    S=None,
    push: float = 1.0,
    tangent: float = 0.4,
    side: float = 0.02,
    frames: bool = False,
    contact: bool = False,
) -> Scene:
    """Compose a soft surface over hard nodules, explored by an avatar.

    Where it is harder, the avatar is held back and sinks in less deeply.

    Parameters
    ----------
    mode : {"cursor", "deformation", "combined", "vibration", "multipoint"}
        What tells of stiffness: the speed of the avatar; its depth; both; a vibration
        for as long as the avatar would be held back; the depths of three avatars on a
        triangle, which share the force.
    device : {"pen", "mouse"}
        A pen gives pressure, and its avatar waits (``delay_avatar``).  A mouse pushes
        with a constant force, and its cursor slows down (``cursor``); it has no mode
        "vibration".
    S : Levels, optional
        The map, see ``stimlib.soft``; by default the block with the nodules A, B and C.
    push : float
        Force of a mouse in N, live as ``push``.
    tangent : float
        Tangential force in N at S = 1, of which delays are made; ours.
    side : float
        Side of the triangle in m.
    frames : bool
        The laws to the letter, once per frame of 30 ms; by default those that mean the
        same at every rate.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not).  Without it a pen touches
        where its pressure is above 0, a mouse always.  At contact the force of a pen
        jumps to 0.1008 N, its value in eq. (2) at the pressure 0; so does the depth.

    Returns
    -------
    Scene
        Inputs ``x``, ``y`` in m from the corner of the surface, and of a pen ``press``,
        the force level 0 to 1.  Outputs ``x1``, ``y1`` in m (to 3 in mode multipoint);
        ``depth1`` in m where the mode shows depths; ``force``, the normal force in N;
        in mode vibration ``vibration``, 0 or 1.

    Raises
    ------
    BadValue
        An unknown mode or device, a vibration of a mouse; numbers not above 0; what
        ``stiffness_map`` refuses.

    References
    ----------
    Li et al. (2016), eqs. (1) to (3), figs. 1 to 5; each block says what is ours.

    Examples
    --------
    >>> from stimlib.scenes import soft_surface
    >>> soft_surface()
    Scene(x [m], y [m], press [1] -> x1 [m], y1 [m], depth1 [m], force [N])
    >>> list(soft_surface("multipoint").outputs)
    ['x1', 'y1', 'depth1', 'x2', 'y2', 'depth2', 'x3', 'y3', 'depth3', 'force']
    >>> soft_surface("cursor", device="mouse")
    Scene(x [m], y [m], push [N] -> x1 [m], y1 [m], force [N])
    """
    for name, value, known in (("mode", mode, MODES), ("device", device, DEVICES)):
        one_of(f"soft_surface: {name}", value, known)
    if mode == "vibration" and device == "mouse":
        raise BadValue("soft_surface: a mouse has no vibration; use device='pen'")
    above_zero("soft_surface", push=push, tangent=tangent, side=side)
    S = block() if S is None else as_levels("soft_surface", S)
    x, y = Input("x", "m"), Input("y", "m")
    touching: Block = (
        Input("contact") if contact else Input("press") > 0.0 if device == "pen" else as_block(1.0)
    )
    force = (
        press(Input("press"), touching)
        if device == "pen"
        else Param("push", push, "N") * (touching > 0.0)
    )
    places: list[tuple[Block, Block]] = [(x, y)]
    outputs: dict[str, Block] = {}
    if device == "pen" and mode in ("cursor", "combined", "vibration"):
        f_t = constant(tangent, "N") * stiffness_map(x, y, S)
        avatar = delay_avatar(x, y, f_t, "frames" if frames else "streaming", touching)
        if mode == "vibration":
            outputs["vibration"] = vibration(avatar.wait)
        else:
            places = [(avatar.x, avatar.y)]
    elif mode in ("cursor", "combined"):
        avatar = cursor(x, y, S, "frames" if frames else "reversible", touching)
        places = [(avatar.x, avatar.y)]
    elif mode == "multipoint":
        places = triangle(x, y, side)
    shown: dict[str, Block] = {}
    for i, (xi, yi) in enumerate(places, 1):
        shown |= {f"x{i}": xi, f"y{i}": yi}
        if mode in ("deformation", "combined", "multipoint"):
            shown[f"depth{i}"] = indentation(force / float(len(places)), stiffness_map(xi, yi, S))
    outputs = shown | {"force": force} | outputs
    return Scene(outputs, law="soft_surface", given={"S": S})
