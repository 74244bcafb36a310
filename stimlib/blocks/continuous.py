"""What the models are before anything is sampled: stiffness at a frequency, relaxation,
creep.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue, public


class Stiffness(NamedTuple):
    """Complex stiffness k_C = f/y at a frequency."""

    complex: np.ndarray  # N/m
    storage: np.ndarray  # real part, N/m
    loss: np.ndarray  # imaginary part, N/m
    magnitude: np.ndarray  # N/m
    phase: np.ndarray  # rad


@public
def springpot_stiffness(chi: float, alpha: float, w: ArrayLike) -> Stiffness:
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
    >>> (
    ...     float(k.magnitude),
    ...     float(k.phase).__round__(6),
    ...     bool(abs(k.storage - k.loss) < 1e-9),
    ... )
    (600.0, 0.785398, True)
    """
    _orders("springpot_stiffness", alpha=alpha)
    _positive("springpot_stiffness", True, chi=chi)
    w = _axis("springpot_stiffness", w=w)
    size = chi * w**alpha
    across, along = math.sin(alpha * math.pi / 2), math.sin((1 - alpha) * math.pi / 2)
    storage, loss = size * along, size * across
    return Stiffness(
        storage + 1j * loss, storage, loss, size, np.full(w.shape, alpha * math.pi / 2)
    )


@public
def equal_force(chi1: float, alpha1: float, alpha2: float, w: float = 2 * math.pi) -> float:
    """chi_2 of a springpot of order alpha2 that answers as strongly as (chi1, alpha1)
    at the frequency w.

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
    _orders("equal_force", alpha1=alpha1, alpha2=alpha2)
    _positive("equal_force", True, chi1=chi1)
    _positive("equal_force", w=w)
    return chi1 * w ** (alpha1 - alpha2)


@public
def maxwell_stiffness(k: float, tau: float, w: ArrayLike) -> Stiffness:
    """Complex stiffness k_C = i w tau k/(1 + i w tau) of a Maxwell arm.

    Parameters
    ----------
    k : float
        N/m, above 0.
    tau : float
        Time constant in s, above 0.
    w : array_like
        Angular frequency in rad/s, not below 0.

    Returns
    -------
    Stiffness
        Named arrays of the shape of w: complex, storage, loss and magnitude in N/m,
        phase in rad.

    Raises
    ------
    BadValue
        A number outside its range.

    References
    ----------
    Çaldıran's thesis, eqs. (2.5) to (2.7).

    Examples
    --------
    >>> from stimlib.blocks.continuous import maxwell_stiffness
    >>> arm = maxwell_stiffness(200.0, 0.1, 10.0)
    >>> float(arm.storage), float(arm.loss), round(float(arm.phase), 6)
    (100.0, 100.0, 0.785398)
    """
    _positive("maxwell_stiffness", k=k, tau=tau)
    w = _axis("maxwell_stiffness", w=w)
    x = w * tau
    small = np.minimum(x, 1 / np.maximum(x, 1e-300))  # x or 1/x, so that no square is too large
    loss = k * small / (1 + small * small)
    storage = np.where(x < 1, loss * small, k / (1 + small * small))
    size = k * np.where(x < 1, small, 1.0) / np.sqrt(1 + small * small)
    return Stiffness(storage + 1j * loss, storage, loss, size, np.arctan2(1.0, x))


@public
def relaxation_modulus(
    t: ArrayLike,
    k0: float = 0.0,
    arms: Sequence[tuple[float, float]] = (),
    springpot: tuple[float, float] | None = None,
) -> np.ndarray:
    """Force over displacement after a step: k0 + sum k_i exp(-t/tau_i) + chi
    t^-alpha/Gamma(1 - alpha).

    Parameters
    ----------
    t : array_like
        Time since the step in s, not below 0.
    k0 : float
        Spring, N/m.
    arms : sequence of (k, tau)
        Maxwell arms, N/m and s.
    springpot : (chi, alpha), optional
        A springpot beside them, N s^alpha/m.

    Returns
    -------
    ndarray
        N/m, of the shape of t; infinite at 0 with a springpot.

    Raises
    ------
    BadValue
        A number outside its range.

    References
    ----------
    Çaldıran's thesis, section 1.1.1 and fig. 1.1a; eqs. (2.1) and (2.8).

    Examples
    --------
    >>> from stimlib.blocks.continuous import relaxation_modulus
    >>> relaxation_modulus([0.0, 0.1, 1e3], 100.0, [(50.0, 0.1)]).round(3)
    array([150.   , 118.394, 100.   ])
    """
    t = _axis("relaxation_modulus", t=t)
    out = np.full(t.shape, float(k0))
    for k, tau in arms:
        _positive("relaxation_modulus", k=k, tau=tau)
        out = out + k * np.exp(-t / tau)
    if springpot is not None:
        chi, alpha = springpot
        _positive("relaxation_modulus", chi=chi)
        _orders("relaxation_modulus", alpha=alpha)
        if alpha == 1:
            out = out + np.where(t > 0, 0.0, math.inf)
        else:
            with np.errstate(divide="ignore"):
                out = out + chi * t**-alpha / math.gamma(1 - alpha)
    return out


@public
def creep_compliance(
    t: ArrayLike,
    k0: float | None = None,
    elements: Sequence[tuple[float, float]] = (),
    b: float | None = None,
    springpot: tuple[float, float] | None = None,
) -> np.ndarray:
    """Displacement over force after a step: 1/k0 + t/b + sum (1 - exp(-t/tau_i))/k_i +
    t^alpha/(chi Gamma(1 + alpha)).

    Parameters
    ----------
    t : array_like
        Time since the step in s, not below 0.
    k0 : float, optional
        Spring in the chain, N/m.
    elements : sequence of (k, tau)
        Kelvin-Voigt elements, N/m and s.
    b : float, optional
        Damper in the chain, N s/m.
    springpot : (chi, alpha), optional
        A springpot in the chain, N s^alpha/m.

    Returns
    -------
    ndarray
        m/N, of the shape of t.

    Raises
    ------
    BadValue
        A number outside its range.

    References
    ----------
    Çaldıran's thesis, section 1.1.2 and fig. 1.1b.

    Examples
    --------
    >>> from stimlib.blocks.continuous import creep_compliance
    >>> creep_compliance([0.0, 0.1, 1e3], elements=[(100.0, 0.1)]).round(6)
    array([0.      , 0.006321, 0.01    ])
    """
    t = _axis("creep_compliance", t=t)
    out = np.zeros(t.shape)
    if k0 is not None:
        _positive("creep_compliance", k0=k0)
        out = out + 1 / k0
    if b is not None:
        _positive("creep_compliance", b=b)
        out = out + t / b
    for k, tau in elements:
        _positive("creep_compliance", k=k, tau=tau)
        out = out - np.expm1(-t / tau) / k
    if springpot is not None:
        chi, alpha = springpot
        _positive("creep_compliance", chi=chi)
        _orders("creep_compliance", alpha=alpha)
        out = out + t**alpha / (chi * math.gamma(1 + alpha))
    return out


def _orders(name: str, **orders: float) -> None:
    for what, alpha in orders.items():
        if not 0 <= alpha <= 1:
            raise BadValue(f"{name}: {what} = {alpha} must be from 0 (spring) to 1 (dashpot)")


def _positive(name: str, or_0: bool = False, **numbers: float) -> None:
    for what, v in numbers.items():
        if not (math.isfinite(v) and (v > 0 or (or_0 and v == 0))):
            raise BadValue(f"{name}: {what} = {v} must {'not be below' if or_0 else 'be above'} 0")


def _axis(name: str, **axis) -> np.ndarray:
    """Times or frequencies as an array."""
    ((what, values),) = axis.items()
    a = np.asarray(values, float)
    if not np.all(a >= 0):
        raise BadValue(f"{name}: {what} must not be below 0")
    return a
