"""Fits of unknown properties of a plate's frame to measured frequencies.

Gradients go through the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import BadValue, computed, public
from ..system.packages import package
from .model import Plate

NUMBERS = ("E", "rho", "clamp_stiffness", "in_plane_load")


@dataclass(frozen=True)
class FrameFit:
    """A plate with fitted numbers, and the errors of its modes.

    ``freq`` of the measured modes is in Hz; ``residual`` is the relative error of each.
    """

    plate: Plate
    freq: np.ndarray
    residual: np.ndarray


@public
@computed
def fit_frame(
    model: Plate,
    measured: Mapping[int, float],
    vary: Sequence[str] = ("clamp_stiffness", "in_plane_load"),
) -> FrameFit:
    """Fit numbers of a plate so that its modes match measured frequencies.

    The fit minimises the squares of the relative errors.

    Parameters
    ----------
    model : Plate
        Where the search starts.  To fit the clamps' stiffness it needs one, such as 20
        D/length.
    measured : mapping of int to float
        Frequencies in Hz by mode, 0 the lowest.  Which is which says its shape.
    vary : sequence of {"E", "rho", "clamp_stiffness", "in_plane_load"}
        At most as many as measured.

    Returns
    -------
    FrameFit

    Raises
    ------
    BadValue
        More numbers than measurements, unknown numbers, frequencies not above 0 or not
        by mode, or such that no plate has.

    Examples
    --------
    The thesis' measured three; its third is the mode (1, 3), whose middle moves:

    >>> from dataclasses import replace
    >>> from stimlib.plate import Plate, fit_frame
    >>> found = fit_frame(
    ...     replace(Plate.paper(), terms=8),
    ...     {0: 158.0, 1: 246.0, 3: 548.0},
    ...     vary=("E", "in_plane_load"),
    ... )
    >>> (100 * found.residual).round(1)
    array([ 0.8, -2.1,  1.3])
    """
    jax = package("jax", "fit_frame")
    from scipy.optimize import least_squares

    if not isinstance(measured, Mapping) or not all(
        isinstance(k, (int, np.integer)) for k in measured
    ):
        raise BadValue(
            f"fit_frame: measured = {measured!r:.80} must be frequencies by mode, such as {{0:"
            " 158.0, 1: 246.0}"
        )
    if not {*vary} <= {*NUMBERS} or not 0 < len({*vary}) == len(vary) <= len(measured):
        raise BadValue(
            f"fit_frame: vary = {tuple(vary)} for {len(measured)} frequencies; choose at most as"
            f" many of {', '.join(NUMBERS)}"
        )
    if "clamp_stiffness" in vary and not model.clamp_stiffness:
        raise BadValue(
            f"fit_frame: clamp_stiffness = {model.clamp_stiffness} of this plate is no start for a"
            " search; give it one above 0, such as 20 D/length"
        )
    order = sorted(measured)
    want = np.array([measured[k] for k in order], float)
    if not (want > 0).all() or order[0] < 0:
        raise BadValue(
            "fit_frame: frequencies must be above 0, by the number of their mode, 0 the lowest"
        )
    at = np.array(order)
    model.solved(order[-1] + 1)  # tells of a mode that is not there
    modes = model.frequencies(order[-1] + 1)

    def numbers(v):
        """Return a plate's numbers from fit variables.

        A load is in kN/m, all others are logarithms.
        """
        start = {n: (getattr(model, n), x) for n, x in zip(vary, v, strict=True)}
        return {
            n: a + 1e3 * x if n == "in_plane_load" else a * jax.numpy.exp(x)
            for n, (a, x) in start.items()
        }

    def residual(v):
        return modes(numbers(v))[at] / want - 1

    with jax.enable_x64(True):
        steep = jax.jit(jax.jacfwd(residual))
        value = jax.jit(residual)
        found = least_squares(
            lambda v: np.asarray(value(v)),
            np.zeros(len(vary)),
            lambda v: np.asarray(steep(v)),
            xtol=1e-12,
        )
        made: dict[str, Any] = {n: float(v) for n, v in numbers(found.x).items()}
    try:
        plate = replace(model, **made)
        freq = plate.modes(order[-1] + 1)[at]
    except BadValue as e:
        raise BadValue(
            f"fit_frame: no such plate has modes {order} there ({e}); count them from 0, or start"
            " nearer"
        ) from None
    return FrameFit(plate, freq, freq / want - 1)
