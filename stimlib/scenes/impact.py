"""A hard surface to tap: each impact rings, louder the faster it is."""

from __future__ import annotations

from .. import blocks
from ..blocks import maximum, ring, rising, velocity
from ..core.graph import Input
from ..core.parameter import Param
from ..core.scene import Scene
from .shipped import shipped


@shipped(
    felt=("A hard surface rings when it is tapped, the more the faster the tap."),
    do="tap the wall, which begins in the middle: strike to the right",
    words=(
        "F = max(0, k x + b v) + A u exp(-t/decay) sin(2 pi freq t) from each impact on, u its"
        " velocity (after Okamura, Dennerlein and Howe 1998)"
    ),
    full={"N": 20.0},
    drive={"x": "sinusoid(5e-3, 3.0)"},
    ranges={"x": (-0.01, 0.01)},
)
def impact(
    k: float = 1000.0, b: float = 0.0, A: float = 20.0,
    freq: float = 150.0, decay: float = 0.01, cutoff: float = 500.0, contact: bool = False,
) -> Scene:  # fmt: skip
    """Compose the force of a wall at x = 0 that rings at each impact.

    Each impact starts a decaying vibration A v exp(-t/decay) sin(2 pi freq t).

    v is the velocity of the impact, after two poles; there is no vibration if it is not
    above 0.

    Parameters
    ----------
    k : float
        Stiffness of the wall in N/m, live as ``k``.
    b : float
        Damping of the wall in N s/m.
    A : float
        Amplitude of the vibration for a velocity, in N s/m, live as ``A``.
    freq, decay : float
        Frequency in Hz and decay in s of the vibration: low and short for rubber, high
        and long for metal.
    cutoff : float
        Cut-off frequency of the velocity, in Hz; below fs/2.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not).

    Returns
    -------
    Scene
        Input ``x`` in m, output ``force`` in N.

    Raises
    ------
    BadValue
        As of the blocks ``wall``, ``ring`` and ``velocity``.

    References
    ----------
    Okamura, Dennerlein and Howe, "Vibration feedback models for virtual environments",
    IEEE Int. Conf. Robotics and Automation (1998): Q(t) = A v exp(-B t) sin(w t). The
    numbers here are no measurement.

    Examples
    --------
    >>> from stimlib.scenes import impact
    >>> impact(freq=300.0)
    Scene(x [m], k [N/m], A [N·s/m] -> force [N])
    """
    x, touching = Input("x", "m"), Input("contact") if contact else 1.0
    wall = blocks.wall(x, Param("k", k, "N/m"), b, contact=touching)
    struck = rising(x) * maximum(velocity(x, cutoff, touching), 0)
    return Scene(
        {"force": wall + Param("A", A, "N*s/m") * ring(struck, freq, decay)},
    )
