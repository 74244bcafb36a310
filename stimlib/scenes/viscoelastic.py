"""Viscoelastic materials from spring to dashpot: Çaldıran's thesis, chapters 3, 4.

Ozan Çaldıran, "Haptic Perception of Viscoelastic Materials", Koç University; see
docs/reference/papers.rst.
"""

from __future__ import annotations

from math import log, pi

from ..blocks import equal_force, exp, spring, springpot, track
from ..core.graph import Block, Input
from ..core.parameter import Param
from ..core.scene import Scene
from ..errors import Above0
from .shipped import shipped

REFERENCES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Derivative orders of the thesis' reference stimuli (section 4.1)."""


@shipped(
    felt=("A material yields slowly while it is pressed, and recovers slowly."),
    do="press to the right, hold, and let go",
    words=(
        "F = firmness chi D^alpha y, chi = chi_0/w^alpha, D^alpha being the fractional derivative"
        " of the position y as the full sum over its history (Çaldıran's thesis, eqs. (3.1), (3.2)"
        " and (4.1))"
    ),
    full={"N": 10.0},
    drive={"y": "sinusoid(0.01, 1.0)"},
    ranges={"y": (0.0, 0.02)},
    # figure 3.2: a plate on a helix; twice as long as the deepest press, which is ours
    view=lambda now: {"kind": "plate", "length": 0.04, "values": ["y"]},
)
def viscoelastic(
    alpha: float = 0.5,
    chi_0: float = 300.0,
    firmness: float = 1.0,
    w: float = 2 * pi,
    scheme: str = "gl",
    tol: float = 1e-10,
    contact: bool = False,
    live: bool = False,
    smoothing: float | None = None,
    guide: Above0 | None = None,
) -> Scene:
    """Compose the force of a springpot with a given stiffness at one frequency.

    At the angular frequency w it is as strong as a spring of stiffness chi_0.

    f = chi D^alpha y with chi = firmness chi_0 / w^alpha, eq. (4.1). ``alpha`` sets
    what the thesis calls bounciness (the phase alpha pi/2), ``firmness`` the strength.

    Parameters
    ----------
    alpha : float
        Order, 0 (spring) to 1 (dashpot). The thesis' references are ``REFERENCES``.
    chi_0 : float
        Stiffness in N/m of the spring with equal force; 0.3 N/mm in the thesis.
    firmness : float
        Factor on chi, live as ``firmness``; 1 is a reference stimulus.
    w : float
        Angular frequency of equal force in rad/s.
    scheme, tol
        How the springpot is computed, see ``springpot``. The thesis' operator is "gl",
        its own ways to compute it are "gl-downsampled" and "gl-short-memory"; "l1", the
        block's default, is nearer to D^alpha: within 0.1 % of the largest force at
        1 kHz, 5 Hz and alpha = 0.5, where "gl" is within 0.61 %.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not): off contact the force is 0,
        and re-contact starts anew at rest.
    live : bool
        Make the order a parameter, ``alpha``; chi follows it, so that the force at w
        stays as strong. Ramp it: a jump of alpha is a jump of the force.
    smoothing : float, optional
        Bandwidth in Hz of ``track`` before the springpot. Use it for positions in steps
        or with noise: an order near 1 makes a force of every step.
    guide : float, optional
        Stiffness in N/m of the light force that brings a hand back to the line x = z =
        0 along y (section 3.5, "snap line"): inputs ``x`` and ``z`` in m, outputs
        ``guide_x`` = guide x and ``guide_z`` = guide z in N.  The thesis prints no
        number; 50 N/m, which is 0.25 N at 5 mm, is light.  It acts off contact, too.

    Returns
    -------
    Scene
        Input ``y`` in m, output ``force`` in N.

    References
    ----------
    Çaldıran's thesis, eqs. (3.1), (3.2), (4.1), sections 3.4, 3.5 and 4.1; 1 kHz in the
    thesis.

    Examples
    --------
    >>> from stimlib.scenes import viscoelastic
    >>> viscoelastic(alpha=0.25)
    Scene(y [m], firmness [1] -> force [N])
    >>> viscoelastic(alpha=0.25, guide=50.0)
    Scene(y [m], x [m], z [m], firmness [1] -> force [N], guide_x [N], guide_z [N])
    """
    y: Block = Input("y", "m")
    touching = Input("contact") if contact else None
    if smoothing is not None:
        y = track(y, smoothing, contact=1.0 if touching is None else touching)
    chi = equal_force(chi_0, 0.0, alpha, w)
    order = Param("alpha", alpha) if live else alpha
    strength = chi_0 * exp(-log(w) * order) if live else chi
    # the downsampled method keeps all of it
    horizon = 60.0 if scheme == "gl-downsampled" else 86400.0
    unit = springpot(y, strength, order, scheme, tol, horizon, contact=touching)
    outputs = {"force": Param("firmness", firmness) * unit}
    if guide is not None:
        outputs |= {f"guide_{name}": spring(Input(name, "m"), guide) for name in ("x", "z")}
    return Scene(outputs)
