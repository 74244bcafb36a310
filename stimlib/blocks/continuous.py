"""What a springpot is at a frequency, before anything is sampled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..errors import BadValue


class Stiffness(NamedTuple):
    """Complex stiffness k_C = f/y of a springpot at a frequency."""

    complex: np.ndarray  # N/m
    storage: np.ndarray  # real part, N/m
    loss: np.ndarray  # imaginary part, N/m
    magnitude: np.ndarray  # chi w^alpha, N/m
    phase: np.ndarray  # alpha pi/2, rad


def springpot_stiffness(chi: float, alpha: float, w) -> Stiffness:
    """k_C = chi (i w)^alpha: storage and loss, magnitude and phase.

    Parameters
    ----------
    chi : float
        N s^alpha/m, not below 0.
    alpha : float
        From 0 to 1.
    w : array_like
        Angular frequency in rad/s, not below 0.

    Returns
    -------
    Stiffness
        Named arrays of the shape of w.

    Raises
    ------
    BadValue
        A number outside its range.

    References
    ----------
    Çaldıran's thesis, section 2.2: |k_C| = chi w^alpha, phase alpha pi/2.

    Examples
    --------
    >>> from stimlib.blocks import springpot_stiffness
    >>> k = springpot_stiffness(300.0, 0.5, 4.0)
    >>> float(k.magnitude), float(k.phase).__round__(6), bool(abs(k.storage - k.loss) < 1e-9)
    (600.0, 0.785398, True)
    """
    _order(alpha, "alpha")
    _not_negative(chi, "chi")
    w = np.asarray(w, float)
    if not np.all(w >= 0):
        raise BadValue("springpot_stiffness: w must not be below 0")
    size = chi * w**alpha
    across, along = math.sin(alpha * math.pi / 2), math.sin((1 - alpha) * math.pi / 2)
    storage, loss = size * along, size * across
    return Stiffness(storage + 1j * loss, storage, loss, size, np.full(w.shape, alpha * math.pi / 2))


def equal_force(chi1: float, alpha1: float, alpha2: float, w: float = 2 * math.pi) -> float:
    """chi_2 of a springpot of order alpha2 that answers as strongly as (chi1, alpha1) at the frequency w.

    Parameters
    ----------
    chi1 : float
        N s^alpha1/m, not below 0.
    alpha1, alpha2 : float
        From 0 to 1.  With alpha1 = 0, chi1 is the stiffness chi_0 of eq. (4.1).
    w : float
        Angular frequency in rad/s, above 0; the thesis uses 2 pi.

    Returns
    -------
    float
        In N s^alpha2/m.

    Raises
    ------
    BadValue
        A number outside its range.

    References
    ----------
    Çaldıran's thesis, eqs. (3.2) and (4.1): chi_2 = chi_1 w^(alpha1 - alpha2).

    Examples
    --------
    >>> from stimlib.blocks import equal_force
    >>> round(equal_force(300.0, 0.0, 0.5), 2)
    119.68
    """
    _order(alpha1, "alpha1")
    _order(alpha2, "alpha2")
    _not_negative(chi1, "chi1")
    if not (math.isfinite(w) and w > 0):
        raise BadValue(f"equal_force: w = {w} rad/s must be above 0")
    return chi1 * w ** (alpha1 - alpha2)


def _order(alpha: float, name: str) -> None:
    if not 0 <= alpha <= 1:
        raise BadValue(f"springpot: {name} = {alpha} must be from 0 (spring) to 1 (dashpot)")


def _not_negative(chi: float, name: str) -> None:
    if not (math.isfinite(chi) and chi >= 0):
        raise BadValue(f"springpot: {name} = {chi} must not be below 0")
