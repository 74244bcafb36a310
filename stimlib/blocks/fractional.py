"""The springpot by its method's name, and closed forms of springpots and dashpots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import units as un
from ..core.graph import Block, Const, Map, as_block
from ..core.maths import where
from ..design import fractional as soe
from ..errors import Above0, BadValue, From0, Range, UnitError, one_of, public
from .springpots import (
    METHODS,
    NAN,
    Accuracy,
    Downsampled,
    PathLength,
    ShortMemory,
    Springpot,
    SpringpotLive,
)


@dataclass(frozen=True, eq=False)
class NotBelowZero(Map):
    """The signal x, or NaN where x < 0, so that the output's guard stops it."""

    x: Block

    @staticmethod
    def step(p, s, x):
        return where(x >= 0.0, x, NAN), s


@public
def springpot(
    y: Block | float,
    chi: Block | float,
    alpha: Block | float,
    scheme: str = "l1",
    tol: float = 1e-10,
    horizon: float = 86400.0,
    onset: str = "steady",
    contact: Block | float | None = None,
    certificate: bool = False,
    memory: float = 0.1,
):
    """Compute the force of a springpot, f = chi D^alpha y.

    It depends on the whole history of y.

    Parameters
    ----------
    y : Block
        Displacement in m (a number without unit gives a force without unit).
    chi : float or Block
        Coefficient in N s^alpha/m, as a plain number; live when it is a signal.  Not
        below 0: a live value below 0 is a fault.
    alpha : float or Block
        Order from 0 (spring, bit for bit chi (y - y[0])) to 1 (dashpot, bit for bit chi
        (y[n] - y[n-1]) fs); live when it is a signal.  A live value outside is a fault.
        A change acts as if it had been so from the start; a jump of alpha is a jump of
        force, so ramp it.
    scheme : {"l1", "gl", "gl-downsampled", "gl-short-memory"}
        ``l1``: exact for straight lines between samples, order 2 - alpha in 1/fs.
        ``gl``: Gruenwald-Letnikov, the thesis' operator, first order: late by alpha/2
        samples.  The other two are the thesis' ways to compute "gl", for comparison;
        there alpha is a plain number.
    tol : float
        |error[n]| <= tol chi fs^alpha sum_j v_j |d[n-j]| against the full sum of the
        scheme; from 1e-14 to 0.1.
    horizon : float
        Seconds of contact up to which tol is kept.  Beyond, the error grows slowly.
        With ``gl-downsampled``, the longest contact: beyond it there is a fault.
    onset : {"steady", "step"}
        Whether the first sample is where y has always been, or a step from 0.
    contact : Block, optional
        Where it is not above 0 the force is 0; at re-contact the history starts anew,
        at rest.
    certificate : bool
        Also return the bound on the error, as a second signal.
    memory : float
        Seconds that ``gl-short-memory`` sums; the thesis' 100 samples at 1 kHz are 0.1
        s.

    Returns
    -------
    Block, or (Block, Block) with ``certificate=True``
        Force in N, and the bound on its error in N.

    Raises
    ------
    BadValue
        alpha outside 0 .. 1, chi below 0, tol outside 1e-14 .. 0.1 (the message names
        the nearest possible one), horizon or memory not above 0, an unknown scheme or
        onset; a live alpha or a certificate with the thesis' methods; at compile time,
        a horizon too long for ``gl-downsampled``.
    UnitError
        y in another unit than m, chi or alpha with a unit.

    Notes
    -----
    tol speaks of the sum over the history, against the scheme's own full sum.  How near
    that is to the continuous derivative is a matter of the sample rate.

    References
    ----------
    Çaldıran's thesis, section 2.2, and eq. (3.1).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import springpot
    >>> y = stimlib.Input("y", "m")
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"f": springpot(y, chi=100.0, alpha=0.5)}),
    ...     fs=1000,
    ... )
    >>> t = np.arange(1000) / 1000
    >>> f = proc.process(0.1 * t[None])[0]  # 0.1 m/s
    >>> bool(np.allclose(f, 100 * 0.1 * 2 * np.sqrt(t / np.pi), rtol=1e-9))
    True
    >>> proc.units["f"]
    'N'
    """
    y, alpha = as_block(y), as_block(alpha)
    touch = as_block(1.0 if contact is None else contact)
    fixed = alpha.value if isinstance(alpha, Const) and alpha.dim == un.ONE else None
    one_of("springpot: scheme", scheme, METHODS)
    gain = coefficient(chi)
    if scheme in soe.SCHEMES:

        def part(signal):
            if fixed is not None:
                return Springpot(signal, touch, fixed, scheme, tol, horizon, onset)
            return SpringpotLive(signal, alpha, touch, scheme, tol, horizon, onset)

        force = gain * part(y)
        if not certificate:
            return force
        return force, gain * (Accuracy(alpha, tol, horizon) * part(PathLength(y, touch, onset)))
    if certificate:
        raise BadValue(
            f"springpot: there is no bound on the error of {scheme}; certificate=True needs gl"
            " or l1"
        )
    if fixed is None:
        raise BadValue(
            f"springpot: {scheme} needs a plain number as alpha, got {alpha!r}; gl and l1 accept a"
            " signal"
        )
    if scheme == "gl-downsampled":
        return gain * Downsampled(y, touch, fixed, horizon, onset)
    return gain * ShortMemory(y, touch, fixed, memory, onset)


def coefficient(chi, name: str = "springpot") -> Block:
    """Return chi as a signal without unit that is NaN where chi is below 0.

    Errors name the function ``name``.
    """
    b = as_block(chi)
    if b.dim != un.ONE:
        raise UnitError(
            f"{name}: chi {b!r} is in {b.dim}; give a plain number in N s^alpha/m, as alpha may"
            " change"
        )
    if isinstance(b, Const):
        if b.value < 0:
            raise BadValue(f"{name}: chi = {b.value:g} must not be below 0")
        return b
    return NotBelowZero(b)


# Closed forms: before anything is sampled -------------------------------------------
# What the models are before anything is sampled: stiffness at a frequency, relaxation,
# creep.
Alpha = Annotated[float, Range("a number from 0 (spring) to 1 (dashpot)", lambda v: 0 <= v <= 1)]


class Stiffness(NamedTuple):
    """Complex stiffness k_C = f/y at a frequency."""

    complex: np.ndarray  # N/m
    storage: np.ndarray  # real part, N/m
    loss: np.ndarray  # imaginary part, N/m
    magnitude: np.ndarray  # N/m
    phase: np.ndarray  # rad


@public
def springpot_stiffness(chi: From0, alpha: Alpha, w: ArrayLike) -> Stiffness:
    """Return the complex stiffness of a springpot, k_C = chi (i w)^alpha.

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
    w = _axis("springpot_stiffness", w=w)
    size = chi * w**alpha
    across, along = math.sin(alpha * math.pi / 2), math.sin((1 - alpha) * math.pi / 2)
    storage, loss = size * along, size * across
    return Stiffness(
        storage + 1j * loss, storage, loss, size, np.full(w.shape, alpha * math.pi / 2)
    )


@public
def equal_force(chi1: From0, alpha1: Alpha, alpha2: Alpha, w: Above0 = 2 * math.pi) -> float:
    """Return the coefficient chi_2 that makes two springpots equally strong at w.

    The springpot (chi_2, alpha2) then has the force amplitude of (chi1, alpha1) at the
    frequency w.

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
    return chi1 * w ** (alpha1 - alpha2)


@public
def maxwell_stiffness(k: Above0, tau: Above0, w: ArrayLike) -> Stiffness:
    """Return the complex stiffness of a Maxwell arm, i w tau k/(1 + i w tau).

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
    >>> from stimlib.blocks.fractional import maxwell_stiffness
    >>> arm = maxwell_stiffness(200.0, 0.1, 10.0)
    >>> float(arm.storage), float(arm.loss), round(float(arm.phase), 6)
    (100.0, 100.0, 0.785398)
    """
    w = _axis("maxwell_stiffness", w=w)
    x = w * tau
    small = np.minimum(x, 1 / np.maximum(x, 1e-300))  # x or 1/x, so that no square is too large
    loss = k * small / (1 + small * small)
    storage = np.where(x < 1, loss * small, k / (1 + small * small))
    size = k * np.where(x < 1, small, 1.0) / np.sqrt(1 + small * small)
    return Stiffness(storage + 1j * loss, storage, loss, size, np.arctan2(1.0, x))


@public
def maxwell_arm(magnitude: Above0, phase: float, w: Above0) -> tuple[float, float]:
    """Return the Maxwell arm with a given complex stiffness at one frequency.

    It is the inverse of `maxwell_stiffness`: tau = 1/(w tan phi), k = magnitude/cos
    phi.

    Parameters
    ----------
    magnitude : float
        N/m, above 0.
    phase : float
        rad, between 0, a spring, and pi/2, a damper.
    w : float
        Angular frequency in rad/s, above 0.

    Returns
    -------
    (float, float)
        k in N/m, and the time constant tau in s.

    Raises
    ------
    BadValue
        A number outside its range.

    References
    ----------
    Çaldıran's thesis, eq. (2.7), and section 1.2 on going back to the parameters.

    Examples
    --------
    >>> from stimlib.blocks.fractional import maxwell_arm
    >>> k, tau = maxwell_arm(141.4213562, 0.7853981634, 10.0)
    >>> round(k, 4), round(tau, 6)
    (200.0, 0.1)
    """
    if not 0 < phase < np.pi / 2:
        raise BadValue(f"maxwell_arm: phase = {phase!r} must be between 0 and pi/2, in rad")
    return float(magnitude / np.cos(phase)), float(1 / (w * np.tan(phase)))


@public
def relaxation_modulus(
    t: ArrayLike,
    k0: float = 0.0,
    arms: Sequence[tuple[Above0, Above0]] = (),
    springpot: tuple[Above0, Alpha] | None = None,
) -> np.ndarray:
    """Return the relaxation modulus: force over displacement after a step.

    k0 + sum k_i exp(-t/tau_i) + chi t^-alpha/Gamma(1 - alpha).

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
    >>> from stimlib.blocks.fractional import relaxation_modulus
    >>> relaxation_modulus([0.0, 0.1, 1e3], 100.0, [(50.0, 0.1)]).round(3)
    array([150.   , 118.394, 100.   ])
    """
    t = _axis("relaxation_modulus", t=t)
    out = np.full(t.shape, float(k0))
    for k, tau in arms:
        out = out + k * np.exp(-t / tau)
    if springpot is not None:
        chi, alpha = springpot
        if alpha == 1:
            out = out + np.where(t > 0, 0.0, math.inf)
        else:
            with np.errstate(divide="ignore"):
                out = out + chi * t**-alpha / math.gamma(1 - alpha)
    return out


@public
def creep_compliance(
    t: ArrayLike,
    k0: Above0 | None = None,
    elements: Sequence[tuple[Above0, Above0]] = (),
    b: Above0 | None = None,
    springpot: tuple[Above0, Alpha] | None = None,
) -> np.ndarray:
    """Return the creep compliance: displacement over force after a step of force.

    1/k0 + t/b + sum (1 - exp(-t/tau_i))/k_i + t^alpha/(chi Gamma(1 + alpha)).

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
    >>> from stimlib.blocks.fractional import creep_compliance
    >>> creep_compliance([0.0, 0.1, 1e3], elements=[(100.0, 0.1)]).round(6)
    array([0.      , 0.006321, 0.01    ])
    """
    t = _axis("creep_compliance", t=t)
    out = np.zeros(t.shape)
    if k0 is not None:
        out = out + 1 / k0
    if b is not None:
        out = out + t / b
    for k, tau in elements:
        out = out - np.expm1(-t / tau) / k
    if springpot is not None:
        chi, alpha = springpot
        out = out + t**alpha / (chi * math.gamma(1 + alpha))
    return out


def _axis(name: str, **axis) -> np.ndarray:
    """Return times or frequencies as an array."""
    ((what, values),) = axis.items()
    a = np.asarray(values, float)
    if not np.all(a >= 0):
        raise BadValue(f"{name}: {what} must not be below 0")
    return a
