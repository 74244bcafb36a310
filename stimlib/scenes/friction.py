"""A surface on which a finger sticks and slips."""

from __future__ import annotations

from .. import blocks
from ..core.graph import Input
from ..core.parameter import Param
from ..core.scene import Scene
from .shipped import shipped


@shipped(
    felt=("A dragged finger sticks and slips: the faster the stroke, the higher the pitch."),
    do="drag to and fro, slowly and fast",
    words=(
        "F is that of a spring that a finger drags: it slips at static normal and sticks again at"
        " kinetic normal, a mean over the movement of a sample (our own)"
    ),
    full={"N": 2.0},
    drive={"x": "sinusoid(0.02, 2.0)"},
)
def friction(
    normal: float = 1.0,
    static: float = 0.8,
    kinetic: float = 0.5,
    stiffness: float = 1000.0,
    contact: bool = False,
) -> Scene:
    """Compose the force on a finger that sticks like a spring, and slips.

    It slips at static * normal, and sticks again at kinetic * normal.

    Parameters
    ----------
    normal : float
        Normal force in N, live as ``normal``.
    static, kinetic : float
        Coefficients of friction at which it slips, and which a slip leaves.
    stiffness : float
        Stiffness of the finger's pad, in N/m.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not).

    Returns
    -------
    Scene
        Input ``x`` in m, output ``force`` in N.

    Raises
    ------
    BadValue
        As of the block ``stick_slip``.

    References
    ----------
    Our own, see the block ``stick_slip``; the sawtooth of Hayward and Armstrong, "A new
    computational model of friction applied to haptic rendering" (2000). The numbers are
    no measurement.

    Examples
    --------
    >>> from stimlib.scenes import friction
    >>> friction(static=0.6)
    Scene(x [m], normal [N] -> force [N])
    """
    touching = Input("contact") if contact else 1.0
    N = Param("normal", normal, "N")
    return Scene(
        {"force": blocks.stick_slip(Input("x", "m"), N, static, kinetic, stiffness, touching)},
    )
