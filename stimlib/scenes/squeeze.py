"""A virtual object between thumb and index finger: the UGrip paper, 1.1 and 2.1.

"A Device and Method for Multimodal Haptic Rendering of Volumetric Stiffness"; see
docs/reference/papers.rst.
"""

from __future__ import annotations

from math import pi

from ..blocks import (
    constant,
    differentiator,
    enabled,
    force_limit,
    loading,
    motor_current,
    nonzero,
    pink_noise,
    spring,
    static_limit,
    velocity,
)
from ..core.graph import Input, Param
from ..core.scene import Scene
from ..system.limits import limits as bounds
from .shipped import shipped


@shipped(
    words=(
        "F = k x + A level (k tau v)(tau dp/dt) while the object is being loaded, else F = k x; x"
        " is the position, v its velocity, p pink noise, tau = 1/8000 s (the UGrip paper, eq. (2)"
        " and section 2.1)"
    ),
    drive={"x1": "minimum_jerk()", "x2": "minimum_jerk(depth=0.015, rise=0.25)"},
    ranges={"x1": (0.0, 0.02), "x2": (0.0, 0.02), "x3": (0.0, 0.02)},
)
def squeeze(
    k: float = 2000.0,
    A: float = 3.4,
    level: float = 1.0,
    fingers: int = 2,
    seed: int = 0,
    passband: float = 1000.0,
    f_low: float = 10.0,
    tol_db: float = 0.01,
    cutoff: float = 100.0,
    resolution: float = 1e-6,
    contact: bool = False,
    limits: bool = False,
    motor_constant: float | None = None,
) -> Scene:
    """Compose the forces of a squeezed object: a spring, and vibration while loading.

    For each finger, with its own noise, F = k x + dF and, eq. (2), dF = A r dp/dt with
    r = Z_n v. In the experiment Z_n = k/s acts on the increment dx per sample of the
    paper's 8 kHz controller, so that the vibration's amplitude is constant at constant
    loading rate (fig. 4): dF = A (k tau v)(tau dp/dt), with tau = 1/8000 s at every
    sample rate.

    Parameters
    ----------
    k : float
        Stiffness in N/m, live as ``k``.  Reference k0 = 2000 N/m.
    A : float
        Vibration gain, live as ``A``; 0 skips the noise altogether.  A0 = 3.4.
    level : float
        Noise level, live as ``level``; 1 is pink noise with one-sided PSD 1/(pi f).
    fingers : int
        Inputs ``x1``, ``x2``, .. in m, compression positive; outputs ``force1``,
        ``force2``, .. in N.
    seed : int
        Of the noise; finger i has stream i.
    passband : float
        Of the differentiator, in Hz; the stop band begins 500 Hz above, which order 128
        at 8 kHz reaches.  At low sample rates that is above fs/2, and there is none.
    f_low, tol_db : float
        Lower edge (Hz) and accuracy of the pink noise.
    cutoff : float
        Of the velocity estimate, in Hz.
    resolution : float
        Encoder step in m, for the loading gate.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not): a lift is silent, and
        re-contact starts anew.
    limits : bool
        Hold the force to what the paper's motors bear: 100 N peak, 37 N static.  Off: a
        grip of 90 N is normal input.
    motor_constant : float, optional
        n B in N/A; with it come outputs ``current1``, ``current2``, .. in A (the
        geometry factor is a placeholder).

    References
    ----------
    The UGrip paper, eq. (2), section 2.1, fig. 4.

    Examples
    --------
    >>> from stimlib.scenes import squeeze
    >>> squeeze(fingers=1)
    Scene(x1 [m], k [N/m], A [1], level [1] -> force1 [N])
    """
    bounds.check("scene_blocks", 30 * fingers, f"squeeze: blocks of {fingers} fingers")
    k_, A_, level_ = Param("k", k, "N/m"), Param("A", A), Param("level", level)
    tau = constant(1 / 8000, "s")  # the paper's sample period
    touching = Input("contact") if contact else 1.0
    outputs = {}
    for i in range(1, fingers + 1):
        x = Input(f"x{i}", "m")
        v = velocity(x, cutoff, touching)
        p = pink_noise(1 / pi, seed, stream=i, f_low=f_low, tol_db=tol_db)
        dp = differentiator(p, passband=passband, stopband=passband + 500.0)
        noise = enabled(dp, by=loading(v, resolution=resolution) * nonzero(A_ * level_))
        force = spring(x, k_) + (A_ * level_) * (k_ * tau * v) * (tau * noise)
        force = static_limit(force_limit(force)) if limits else force
        outputs[f"force{i}"] = force
        if motor_constant is not None:
            outputs[f"current{i}"] = motor_current(force, x, motor_constant)
    return Scene(outputs)
