"""A virtual object between thumb and index finger: the UGrip paper, 1.1 and 2.1.

"A Device and Method for Multimodal Haptic Rendering of Volumetric Stiffness"; see
docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import Any

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
from ..blocks.actuator import PLACEHOLDER_GAMMA
from ..core.graph import Block, Input
from ..core.parameter import Param
from ..core.scene import Scene
from ..core.units import unit
from ..errors import BadValue, UnitError
from ..system.limits import limits as bounds
from .shipped import above_zero, shipped


@shipped(
    felt=("An elastic object vibrates while it is squeezed, and is still when held or released."),
    do="squeeze: to the right presses deeper, back to the left lets go",
    words=(
        "F = k x + A level (k tau v)(tau dp/dt) while the object is being loaded, else F = k x; x"
        " is the position, v its velocity, p pink noise, tau = 1/8000 s; other impedances Z_c and"
        " Z_n take the places of k x and k tau v (the UGrip paper, sections 1.1 and 2.1, eq. (2))"
    ),
    full={"N": 100.0},
    drive={"x1": "minimum_jerk()", "x2": "minimum_jerk(depth=0.015, rise=0.25)"},
    ranges={"x1": (0.0, 0.02), "x2": (0.0, 0.02), "x3": (0.0, 0.02)},
    device={"N": {"mass": 0.1, "area": 2.9e-4}},  # of a plate, assumed
)
def squeeze(
    k: float = 2000.0,
    A: float = 3.4,
    level: float = 9.0,
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
    geometry: Any = None,
    Z_c: Callable[..., Any] | None = None,
    Z_n: Callable[..., Any] | None = None,
    travel: float | None = 0.04,
    as_printed: bool = False,
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
        The paper prints none; with 9, our choice, A0 is felt, see Notes.
    fingers : int
        Number of fingers that squeeze. Inputs ``x1``, ``x2``, .. in m, compression
        positive; outputs ``force1``, ``force2``, .. in N.
    seed : int
        Seed of the noise; finger i has stream i.
    passband : float
        Passband of the differentiator, in Hz; the stop band begins 500 Hz above, which
        order 128 at 8 kHz reaches.  At low sample rates that is above fs/2, and there
        is none.
    f_low : float
        Lower edge of the pink noise in Hz.
    tol_db : float
        Accuracy of the pink noise in dB.
    cutoff : float
        Cut-off frequency of the velocity estimate, in Hz.
    resolution : float
        Encoder step in m, for the loading gate.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not): off contact the force is 0,
        and re-contact starts anew.
    limits : bool
        Hold the force to what the paper's motors bear: 100 N peak, 37 N static.  Off: a
        grip of 90 N is normal input.
    motor_constant : float, optional
        n B in N/A; with it come outputs ``current1``, ``current2``, .. in A.
    geometry : (positions, values), optional
        Geometry factor of the motors, see ``motor_current``; ``calibrate_motor``
        measures both.  By default a placeholder.
    Z_c : function, optional
        Another constitutive impedance: the force of a position, ``Z_c(x)``, in N, in
        place of k x.
    Z_n : function, optional
        Another impedance of the noise: r tau of a velocity, ``Z_n(v)``, in N, in place
        of k tau v.
    travel : float, optional
        How far a plate can move, in m; a motion beyond it is a warning, and a line in
        the report of ``verify``.  By default the paper's 4 cm; None: any.
    as_printed : bool
        Take Z_n = k/s to the letter: r = Z_n v = k x, so that the amplitude grows with
        the position, against figure 4 and the formula after it.  It is k x/(k tau v)
        times as strong, 800 times at 10 mm and 0.1 m/s: give a ``level`` for that.

    Raises
    ------
    BadValue
        travel not above 0; an impedance that returns no block; ``Z_n`` and
        ``as_printed`` together.
    UnitError
        An impedance that gives no force.

    Notes
    -----
    On plates of 0.1 kg (assumed; the paper gives no mass), touched by 2.9 cm^2 of skin,
    the vibration of the default is felt, as it was by the paper's participants: a press
    of 20 mm in 0.3 s is 10 dB above the threshold of detection, and ``level`` = 9 is
    the smallest whole number for which it is.  With level 1 it is 9 dB below; see
    ``stimlib.analysis.sensation_level``.

    References
    ----------
    The UGrip paper, section 1.1, eq. (2), section 2.1, fig. 4.

    Examples
    --------
    >>> from stimlib.scenes import squeeze
    >>> squeeze(fingers=1)
    Scene(x1 [m], k [N/m], A [1], level [1] -> force1 [N])

    A springpot between the fingers, whose vibration has a memory of 50 ms:

    >>> from stimlib.blocks import constant, first_order, springpot
    >>> squeeze(
    ...     fingers=1,
    ...     Z_c=lambda x: springpot(x, 300.0, 0.5),
    ...     Z_n=lambda v: constant(0.25, "N*s/m") * first_order(v, 0.05),
    ... )
    Scene(x1 [m], A [1], level [1] -> force1 [N])
    """
    bounds.check("scene_blocks", 30 * fingers, f"squeeze: blocks of {fingers} fingers")
    if travel is not None:
        above_zero("squeeze", travel=travel)
    k_, A_, level_ = Param("k", k, "N/m"), Param("A", A), Param("level", level)
    if as_printed and Z_n is not None:
        raise BadValue("squeeze: as_printed has a Z_n of its own; leave Z_n out")
    tau = constant(1 / 8000, "s")  # the paper's sample period
    touching = Input("contact") if contact else 1.0
    outputs = {}
    for i in range(1, fingers + 1):
        x = Input(f"x{i}", "m")
        v = velocity(x, cutoff, touching)
        p = pink_noise(1 / pi, seed, stream=i, f_low=f_low, tol_db=tol_db)
        dp = differentiator(p, passband=passband, stopband=passband + 500.0)
        noise = enabled(dp, by=loading(v, resolution=resolution) * nonzero(A_ * level_))
        mean = spring(x, k_) if Z_c is None else _impedance("Z_c", Z_c, x)
        mean = mean * (touching > 0.0) if isinstance(touching, Input) else mean
        rate = k_ * x if as_printed else k_ * tau * v if Z_n is None else _impedance("Z_n", Z_n, v)
        force = mean + (A_ * level_) * rate * (tau * noise)
        force = static_limit(force_limit(force)) if limits else force
        outputs[f"force{i}"] = force
        if motor_constant is not None:
            factor = PLACEHOLDER_GAMMA if geometry is None else geometry
            outputs[f"current{i}"] = motor_current(force, x, motor_constant, factor)
    given = {
        name: Scene({"force": _impedance(name, Z, signal)}).to_dict()
        for name, Z, signal in (("Z_c", Z_c, Input("x", "m")), ("Z_n", Z_n, Input("v", "m/s")))
        if Z is not None
    }
    return Scene(outputs, law="squeeze", given=given)


def _impedance(name: str, Z: Callable[..., Any], signal: Block) -> Block:
    """Return the force that an impedance makes of a signal."""
    force = Z(signal)
    if not isinstance(force, Block):
        raise BadValue(f"squeeze: {name} gave {force!r:.40}, which is no block; return one in N")
    if force.dim != unit("N"):
        raise UnitError(f"squeeze: {name} gave a block in [{force.dim}]; return one in N")
    return force
