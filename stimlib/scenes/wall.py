"""A wall: a spring and a damper that push and never pull."""

from __future__ import annotations

from .. import blocks
from ..core.graph import Input
from ..core.parameter import Param
from ..core.scene import Scene
from .shipped import shipped


@shipped(
    felt=("A stiff, damped wall pushes back, and never pulls."),
    do="push to the right into the wall, which begins in the middle",
    words=(
        "F = max(0, k p + b v); the mean over the motion in a sample, p = x - at > 0 the depth, v"
        " its velocity (Colgate and Schenkel 1997)"
    ),
    full={"N": 50.0},
    drive={"x": "sinusoid(2e-3, 5.0)"},
    ranges={"x": (-0.01, 0.01)},
)
def wall(k: float = 1000.0, b: float = 2.0, at: float = 0.0, contact: bool = False) -> Scene:
    """Compose the force of a stiff wall with a damper beyond a position.

    F = max(0, k p + b v) where p = x - at > 0.

    Parameters
    ----------
    k : float
        Stiffness in N/m, live as ``k``.
    b : float
        Damping in N s/m, live as ``b``.
    at : float
        Place of the surface in m.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not).

    Returns
    -------
    Scene
        Input ``x`` in m, output ``force`` in N.

    Raises
    ------
    BadValue
        k or b below 0.

    References
    ----------
    Colgate and Schenkel, "Passivity of a class of sampled-data systems", J. Robotic
    Systems 14 (1997): the virtual wall.

    Examples
    --------
    >>> from stimlib.scenes import wall
    >>> wall(k=500.0)
    Scene(x [m], k [N/m], b [N·s/m] -> force [N])
    """
    touching = Input("contact") if contact else 1.0
    force = blocks.wall(
        Input("x", "m"), Param("k", k, "N/m"), Param("b", b, "N*s/m"), at, contact=touching
    )
    return Scene({"force": force})
