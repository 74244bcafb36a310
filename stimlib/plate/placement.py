"""Placement of the patches on a plate."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import BadValue, From0, Several, public
from .model import Plate
from .patch import Patch


class Placement(NamedTuple):
    """Four patches, mirrored about both centre lines of the plate, and their effect."""

    x: float  # centre of the one next to the corner, m
    y: float
    turned: bool
    # static displacement at the aim by the mode, m/V; at its resonance 1/damping times
    # that
    gain: float
    patches: tuple[Patch, ...]


@public
def best_patches(
    model: Plate, patch: Patch | None = None, mode: int = 0, points: Several = 9, gap: From0 = 3e-3
) -> list[Placement]:
    """Return all positions of four patches on a grid, best first.

    They are ordered by how far they move the middle of the plate in one mode.

    Patches are mirrored, driven in phase, and taken as light and soft, so the modes are
    those of the bare plate.

    Parameters
    ----------
    model : Plate
        Its own patches do not count.
    patch : Patch, optional
        One of them, its place does not count; default ``Patch.duraact``.
    mode : int
        0 is the lowest.
    points : int
        Of the grid, along each of x and y, from the corner to the middle.
    gap : float
        Between the outermost patches and the edges, and between the innermost ones and
        the centre lines, in m.

    Returns
    -------
    list of Placement

    Raises
    ------
    BadValue
        A grid of less than two points; patches that do not fit.

    References
    ----------
    The touch-screen thesis, section 2.1: "patches must be placed close to the fixed
    edges".  That holds for edges that can hardly turn: here from kappa =
    clamp_stiffness length/D of about 12 on.  With softer ones the middle is better.

    Examples
    --------
    >>> from stimlib.plate import Plate, best_patches
    >>> best = best_patches(Plate.paper())[0]
    >>> round(1e3 * best.x, 1)  # mm from the clamped edge, 3 of them the gap
    9.5
    """
    patch = Patch.duraact(0.0, 0.0) if patch is None else patch
    bare = replace(model, patches=())
    c = bare.solved(mode + 1)[1][mode]
    middle = (
        float(bare.shape(mode, bare.length / 2, bare.width / 2)) / bare.solved(mode + 1)[0][mode]
    )
    X, Y = bare.axes
    found = []
    for turned in (False, True):
        one = replace(patch, length=patch.width, width=patch.length) if turned else patch
        dx, dy = one.length / 2 + gap, one.width / 2 + gap
        if 2 * dx > bare.length / 2 or 2 * dy > bare.width / 2:
            raise BadValue(
                f"best_patches: four patches of {one.length:g} x {one.width:g} m with gaps of"
                f" {gap:g} m do not fit"
            )
        moment = one.moment(bare)
        for x in np.linspace(dx, bare.length / 2 - dx, points):
            for y in np.linspace(dy, bare.width / 2 - dy, points):
                places = [(u, v) for u in (x, bare.length - x) for v in (y, bare.width - y)]
                four = tuple(replace(one, x=float(u), y=float(v)) for u, v in places)
                force = 0.0
                for p in four:
                    x0, x1, y0, y1 = p.rectangle(p.margin)
                    force += X.integral(x0, x1, 2) @ c @ Y.integral(y0, y1) + X.integral(
                        x0, x1
                    ) @ c @ Y.integral(y0, y1, 2)
                found.append(
                    Placement(float(x), float(y), turned, float(moment * force * middle), four)
                )
    return sorted(found, key=lambda p: -abs(p.gain))
