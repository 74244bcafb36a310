"""The device damping that is needed to render a stiffness passively.

It follows from the passivity bound for sampled-data systems.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..core.graph import Input, named
from ..core.program import Program
from ..core.response import backward, response
from ..core.scene import Scene
from ..core.units import unit
from ..errors import Above0, BadValue, From0, SceneError, public
from ..run.processor import Processor

ANGLES = np.r_[np.geomspace(1e-6, 1e-2, 800), np.linspace(1e-2, np.pi, 4000)]  # w T


@public
def needed_damping(
    response: Callable[[np.ndarray], np.ndarray], fs: Above0, delay: From0 = 0.0
) -> float:
    r"""Return the device damping needed to render a stiffness passively.

    The force is held constant between samples.

    b > T/2 max_w Re{(1 - exp(-j w T)) H(w) exp(-j w delay)}/(1 - cos w T), 0 < w T <=
    pi, T = 1/fs.

    A spring and a difference as damper, K + B (1 - 1/z)/T, need K T/2 + \|B\|; a
    spring whose force is late by d, K (T/2 + d).

    Parameters
    ----------
    response : callable
        Complex force per position, in N/m, at an array of frequencies in Hz, such as
        ``lambda f: proc.response("force", "x", f)``. It includes all block latencies,
        and the half sample of a spatial mean.
    fs : float
        Sample rate in Hz.
    delay : float
        Delay from sensor to actuator in s, in addition to the sample hold: device
        buffers and transmission.

    Returns
    -------
    float
        In N s/m; 0 where no damping is needed.

    Raises
    ------
    BadValue
        fs not above 0, a delay below 0, a response that is not finite at some
        frequency.

    Notes
    -----
    The result is the largest value at 4800 angles w T from 1e-6 to pi. It is necessary
    and sufficient for one degree of freedom, a device that is an inertia with a damper,
    and any hand; it is also sufficient for a wall that the hand touches and leaves.

    References
    ----------
    Colgate and Schenkel, "Passivity of a class of sampled-data systems: application to
    haptic interfaces", J. Robotic Systems 14 (1997): b > K T/2 + \|B\|, and its
    general form.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.analysis import needed_damping
    >>> from stimlib.blocks import spring
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"force": spring(stimlib.Input("x", "m"), 1000.0)}),
    ...     fs=1000,
    ...     target="python",
    ... )
    >>> def force_per_position(f):
    ...     return proc.response("force", "x", f)
    >>> for delay in (0.0, 0.003):
    ...     print(f"{needed_damping(force_per_position, 1000, delay):.4f} N s/m")
    0.5000 N s/m
    3.5000 N s/m
    """
    f = ANGLES * fs / (2 * np.pi)
    H = np.asarray(response(f), complex) * np.exp(-1j * ANGLES * fs * delay)
    if not np.isfinite(H).all():
        raise BadValue(
            f"needed_damping: the response is not finite at {f[np.argmin(np.isfinite(H))]:g} Hz"
        )
    real = (backward(np.exp(1j * ANGLES)) * H).real
    return max(0.0, float(np.max(real / (2 * np.sin(ANGLES / 2) ** 2)) / (2 * fs)))


@public
def damping_of(proc: Processor, delay: From0 = 0.0) -> dict[tuple[str, str], float]:
    """Return `needed_damping` for each pair of output and input of a scene.

    Only forces that depend on a position with a known stiffness are considered.

    Linear blocks count exactly. Walls, detents, buttons and friction count at their
    largest stiffness, and parameters at the values of ``params``.

    Parameters
    ----------
    proc : Processor
    delay : float
        In s, as of `needed_damping`.

    Returns
    -------
    dict of (output, input) to float
        In N s/m, or N m s for a torque over an angle. Pairs that need no damping, or
        whose need cannot be determined, are left out.

    Raises
    ------
    BadValue
        A delay below 0.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.analysis import damping_of
    >>> from stimlib.blocks import wall
    >>> scene = stimlib.Scene({"force": wall(stimlib.Input("x", "m"), k=1000.0, b=2.0)})
    >>> damping_of(stimlib.compile(scene, fs=1000, target="python"))
    {('force', 'x'): 2.0}
    """
    return damping_in(proc.scene, proc.program, proc.design, proc.fs, proc.params, delay)


def damping_in(
    scene: Scene,
    program: Program,
    design: list[tuple[Any, Any]],
    fs: float,
    params: Mapping[str, float],
    delay: float = 0.0,
) -> dict[tuple[str, str], float]:
    """Return `damping_of` for a scene and its design, without a processor."""
    found = {}
    for output, y in scene.outputs.items():
        for name, x in named([y], Input).items():
            if y.dim * x.dim != unit("J"):
                continue

            def of(f: np.ndarray, output: str = output, name: str = name) -> np.ndarray:
                return response(program, design, fs, params, output, name, f, steepest=True)

            try:
                found[output, name] = needed_damping(of, fs, delay)
            except (SceneError, BadValue):
                continue  # not linear, or without end at some frequency
    return {pair: b for pair, b in found.items() if b > 0}
