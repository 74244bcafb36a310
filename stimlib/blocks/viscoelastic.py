"""Viscoelastic materials: Maxwell and Kelvin-Voigt chains, creep, and series."""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from ..core import units as un
from ..core.graph import Block, Const, as_block, constant, design_value, in_unit, scratch
from ..core.maths import copy, fir, fma, memory, where
from ..core.pointwise import Where
from ..core.response import backward
from ..core.units import unit
from ..design import fractional as soe, responses
from ..design.padding import padded
from ..errors import Above0, BadValue, From0, UnitError, one_of, public
from .fractional import Alpha, coefficient
from .impedance import sampled, spring, with_unit
from .integrals import Integrate
from .onset import ONSETS, begun, check_onset
from .springpots import (
    DIFFERENCES,
    WORK,
    Springpot,
    begin,
    check_fields,
    force_unit,
    origin,
    transfer,
)

# Relaxation: displacement in, force out ---------------------------------------------
# Springs and dampers in series: Maxwell arms (relaxation) and, force in and
# displacement out, Kelvin-Voigt chains (creep).
#
# All of them are exact for inputs that are straight between samples.  With T = 1/fs
# and a = T/tau,
#
#     e = 1 - exp(-a) = -expm1(-a)
#     g = e/a
#     h = 1 - g = a/2 - a^2/6 + a^3/24 - ..    (summed where it is small)
#
# are all that one time constant needs:
#
#     Maxwell arm     f' + f/tau = k y'    q[n] = q[n-1] - e q[n-1] + (y[n] - y[n-1])
#                                          f[n] = k g q[n]
#     Kelvin-Voigt    tau y' + y = f/k     q[n] = q[n-1] - e q[n-1] + f[n-1]
#                                          y[n] = (h f[n] + e g q[n])/k
#
# No difference of large numbers is left, whatever tau is: for tau -> 0 the arm becomes
# e = 1, g = a (a damper b = k tau), for tau -> infinity e = a, g = 1 (a spring).  The
# leak e is stored, not the pole 1 - e, and q has two words (``maths.memory``), as a
# leak of 1e-17 a sample would be lost in one.
SCRATCH = 512  # words that ``memory`` needs; differences stand behind them


def check_lists(b: Any, values: np.ndarray, name: str) -> None:
    """Raise BadValue unless two lists have equal lengths and only values above 0."""
    if values.ndim != 1 or b.tau.shape != values.shape:
        raise BadValue(
            f"{name} and tau must be two lists of one length, got {values.shape} and {b.tau.shape}"
        )
    for what, a in ((name, values), ("tau", b.tau)):
        if not np.all(a > 0):
            raise BadValue(
                f"{what}[{int(np.argmin(a > 0))}] = {a[np.argmin(a > 0)]:g} must be above 0"
            )


def number(v) -> float | None:
    """Return the value of a plain number, or None for any other signal.

    A constant without unit, or in N/m, counts as a plain number.
    """
    b = as_block(v)
    return b.value if isinstance(b, Const) and b.dim in (un.ONE, unit("N/m")) else None


def plain(name: str, field: str, v) -> float:
    """Return a number above 0; raise BadValue for anything else."""
    value = number(v)
    if value is None or not value > 0:
        raise BadValue(
            f"{name}: {field} = {v!r} must be a plain number above 0; multiply the result by a gain"
            " that changes"
        )
    return value


def time_constant(name: str, k, b, tau) -> float:
    """Return the time constant tau, given either directly or by b and k."""
    if (b is None) == (tau is None):
        raise BadValue(
            f"{name}: give either b (N s/m) or tau (s); the other follows from tau = b/k"
        )
    if number(k) is None and tau is None:
        raise BadValue(
            f"{name}: the stiffness {k!r} is a signal, so give tau in s: a time constant cannot"
            " change"
        )
    stiffness = 1.0 if number(k) is None else plain(name, "k", k)
    return plain(name, "tau", plain(name, "b", b) / stiffness if tau is None else tau)


# Parameters of `MaxwellArms` at a sample rate.
#   e  leaks; padded with ones
#   r  k g; padded with zeros
ArmsParams = namedtuple("ArmsParams", "e r")

# State of `MaxwellArms` between samples.
#   low  second words of q
ArmsState = namedtuple("ArmsState", "q low last cold")


@dataclass(frozen=True, eq=False)
class MaxwellArms(Block):
    """Maxwell arms in parallel, q_i += (y[n] - y[n-1]) - e_i q_i.

    f = sum_i k_i g_i q_i, with k as factors of y.
    """

    y: Block
    contact: Block
    k: np.ndarray
    tau: np.ndarray
    onset: str
    resettable = True

    def check(self):
        check_lists(self, self.k, "k")
        check_onset("maxwell", self.onset)

    def design(self, fs):
        s = [sampled(1 / tau / fs) for tau in self.tau.tolist()]
        e = padded([v.e for v in s], 1.0)
        r = padded([k * v.g for k, v in zip(self.k.tolist(), s, strict=True)])
        return ArmsParams(e, r), ArmsState(
            np.zeros(e.size), np.zeros(e.size), 0.0, ONSETS[self.onset]
        )

    work = scratch(SCRATCH + 64)

    @staticmethod
    def tile(p, s, x, y, w):
        d, last = w[SCRATCH : SCRATCH + x.size], origin(s.cold, s.last, x[0])
        for j in range(x.size):
            d[j] = x[j] - last
            last = x[j]
        memory(p.e, p.r, s.q, s.low, d, y, w)
        return ArmsState(s.q, s.low, last, 0.0)

    @staticmethod
    def transfer(p, z):
        z = z[..., None]
        d = backward(z)
        below = d + p.e / z
        spring = abs(below) < 1e-290  # at 0 Hz, with a leak of nothing
        return np.sum(p.r * np.where(spring, 1.0, d / np.where(spring, 1.0, below)), axis=-1)

    def delay(self, p):
        """Return the low-frequency delay relative to the continuous arms.

        It is 0 for slow arms (springs) and half a sample for fast ones (dampers).
        """
        live = p.r[: self.k.size] > 0
        k, a = self.k[live], p.e[: live.size][live] * self.k[live] / p.r[: live.size][live]
        if not np.all(a > 0) or not a.size:
            return 0.0
        late = np.array(
            [
                v / 12 if v < 1e-2 else 0.5 + 1 / math.expm1(v) - 1 / v if v < 700 else 0.5 - 1 / v
                for v in a
            ]
        )
        damping = k * (a.min() / a)  # b = k tau, up to a factor
        return float(np.sum(damping * late) / np.sum(damping))


@public
def maxwell(
    y: Block,
    k: Block | float,
    b: float | None = None,
    *,
    tau: float | None = None,
    onset: str = "steady",
    contact: Block | float | None = None,
) -> Block:
    """Compute a Maxwell arm, a spring and a damper in series: f'/k + f/b = y'.

    The force at a held position decays with tau = b/k.

    It is exact for positions that are linear between samples, for any tau: an arm much
    faster than a sample is a damper, one much slower than the recording a spring.

    Parameters
    ----------
    y : Block
        Position in m.
    k : float or Block
        Stiffness in N/m; live when it is a ``Param``, which needs ``tau``.
    b : float
        Damping in N s/m.
    tau : float
        Time constant b/k in s, in place of b.
    onset : {"steady", "step"}
        Whether the first position is where y has always been, or is reached from 0 in
        one sample.
    contact : Block, optional
        Where it is not above 0 the force is 0; at re-contact the arm starts anew, at
        rest.

    Returns
    -------
    Block
        Force in N.

    Raises
    ------
    BadValue
        k, b or tau not above 0; both or neither of b and tau; a live k without tau; an
        unknown onset.
    UnitError
        If the result is not a force.

    References
    ----------
    Çaldıran's thesis, section 2.1, eqs. (2.1) and (2.5): k_C = i w tau k/(1 + i w tau).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.viscoelastic import maxwell
    >>> scene = stimlib.Scene(
    ...     {"f": maxwell(stimlib.Input("y", "m"), k=200.0, b=20.0)}
    ... )  # tau = 0.1 s
    >>> t = np.arange(1000) / 1000
    >>> f = stimlib.compile(scene, fs=1000).process(0.05 * t[None])[0]  # 0.05 m/s
    >>> bool(np.allclose(f, 20.0 * 0.05 * -np.expm1(-t / 0.1), rtol=1e-13))
    True
    """
    return generalized_maxwell(
        y, 0.0, [(k, time_constant("maxwell", k, b, tau))], onset=onset, contact=contact
    )


@public
def generalized_maxwell(
    y: Block,
    k0: Block | float,
    arms: Sequence[tuple[Block | float, Block | float]],
    *,
    onset: str = "steady",
    contact: Block | float | None = None,
) -> Block:
    """Compute a spring and any number of Maxwell arms in parallel.

    All arms given by plain numbers run as one bank.

    Parameters
    ----------
    y : Block
        Position in m.
    k0 : float or Block
        Stiffness in N/m of the spring, what remains when all arms have relaxed.
    arms : sequence of (k, tau)
        Stiffness in N/m (a number, or a Block such as a ``Param``) and time constant in
        s of each arm.
    onset : {"steady", "step"}
        Whether the first position is where y has always been, so that the arms have
        relaxed there, or is reached from 0 in one sample.
    contact : Block, optional
        Where it is not above 0 the force is 0; at re-contact the arms start anew, at
        rest.

    Returns
    -------
    Block
        Force in N.

    Raises
    ------
    BadValue
        No arm; k or tau not above 0, k0 below 0; an unknown onset.
    UnitError
        If the result is not a force.

    References
    ----------
    Çaldıran's thesis, section 2.1 and fig. 2.1.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.viscoelastic import generalized_maxwell
    >>> y = stimlib.Input("y", "m")
    >>> soft = generalized_maxwell(y, 100.0, [(50.0, 0.01), (30.0, 1.0)])
    >>> f = stimlib.compile(stimlib.Scene({"f": soft}), fs=1000).process(
    ...     np.array([[0.0] + [0.01] * 9999])
    ... )[0]
    >>> f[[1, 100, -1]].round(3)
    array([1.776, 1.272, 1.   ])
    """
    y, arms = as_block(y), [(k, tau) for k, tau in arms]
    touch = as_block(1.0 if contact is None else contact)
    if not arms:
        raise BadValue(
            "generalized_maxwell: arms must be at least one pair (stiffness in N/m, time constant"
            " in s)"
        )
    fixed = [(number(k), tau) for k, tau in arms if number(k) is not None]
    live = [(k, tau) for k, tau in arms if number(k) is None]
    parts: list[tuple[Any, Any, Any]] = (
        [(constant(1.0, "N/m"), [k for k, _ in fixed], [t for _, t in fixed])] if fixed else []
    )
    parts += [(as_block(k), [1.0], [tau]) for k, tau in live]
    force = reduce(add, (gain * MaxwellArms(y, touch, k, tau, onset) for gain, k, tau in parts))
    if force.dim != unit("N"):
        raise UnitError(
            f"maxwell: a stiffness times {y!r} [{y.dim}] is [{force.dim}], not a force; give y in m"
            " and k in N/m"
        )
    if isinstance(k0, (int, float)) and k0 < 0:
        raise BadValue(f"generalized_maxwell: k0 = {k0:g} must not be below 0")
    if number(k0) == 0:
        return force
    rest = spring(y, k0)
    return (rest if contact is None else Where(touch, rest, as_block(0.0))) + force


@public
def standard_linear_solid(
    y: Block,
    k0: Block | float,
    k1: Block | float,
    tau: float,
    *,
    onset: str = "steady",
    contact: Block | float | None = None,
) -> Block:
    """Compute a spring in parallel with one Maxwell arm.

    The stiffness is k0 + k1 at first, and k0 in the end.

    Parameters
    ----------
    y : Block
        Position in m.
    k0, k1 : float or Block
        Stiffness in N/m of the spring and of the arm.
    tau : float
        Time constant of the arm in s.
    onset, contact
        See ``generalized_maxwell``.

    Returns
    -------
    Block
        Force in N.

    Raises
    ------
    BadValue
        k1 or tau not above 0, k0 below 0; an unknown onset.
    UnitError
        If the result is not a force.

    References
    ----------
    Çaldıran's thesis, section 2.1 and fig. 2.1, with one arm.

    Examples
    --------
    >>> from stimlib import Input, Param
    >>> from stimlib.blocks.viscoelastic import standard_linear_solid
    >>> str(
    ...     standard_linear_solid(
    ...         Input("y", "m"), Param("k0", 100.0, "N/m"), 300.0, tau=0.2
    ...     ).dim
    ... )
    'N'
    """
    return generalized_maxwell(y, k0, [(k1, tau)], onset=onset, contact=contact)


# Creep: force in, displacement out --------------------------------------------------
# Creep: force in, displacement out, of springs and dampers in series (``relaxation``
# has the equations) and of the springpot.
#
# All share one convention of time: a sample of the output is the displacement at that
# sample, under a force that is straight between samples. Before the first sample there
# is no force, so the first value is reached from 0 within one sample. The chains, and
# the springpot with ``scheme="l1"``, are exact for that force; ``scheme="gl"`` comes
# near it as 1/fs.
# Springs and dampers ------------------------------------------------------------------
# Parameters of `KelvinChain` at a sample rate.
#   e  leaks; padded with ones
#   r  e g/k; padded with zeros
#   d  direct
ChainParams = namedtuple("ChainParams", "e r d")

# State of `KelvinChain` between samples.
ChainState = namedtuple("ChainState", "q low last")


@dataclass(frozen=True, eq=False)
class KelvinChain(Block):
    """Kelvin-Voigt elements, a spring and a damper in series, driven by a force.

    y = j0 f + sum j_i (f lagging by tau_i) + fluidity * integral of f dt.

    q_i += f[n-1] - e_i q_i;  y = (j0 + sum_i j_i h_i) f[n] + sum_i j_i e_i g_i q_i; the
    integral is an element with e = 0.
    """

    f: Block
    j0: From0
    j: np.ndarray
    tau: np.ndarray
    fluidity: From0

    def check(self):
        check_lists(self, self.j, "j")

    def design(self, fs):
        s = [sampled(1 / tau / fs) for tau in self.tau.tolist()]
        j = self.j.tolist()
        flow = [self.fluidity / fs] if self.fluidity > 0 else []
        e = padded([v.e for v in s] + [0.0 for _ in flow], 1.0)
        r = padded([c * v.e * v.g for c, v in zip(j, s, strict=True)] + flow)
        d = math.fsum(
            [self.j0, *(c * v.h for c, v in zip(j, s, strict=True)), *(v / 2 for v in flow)]
        )
        return ChainParams(e, r, d), ChainState(np.zeros(e.size), np.zeros(e.size), 0.0)

    work = scratch(SCRATCH + 64)

    @staticmethod
    def tile(p, s, x, y, w):
        n = x.size
        before = w[SCRATCH : SCRATCH + n]
        before[0] = s.last
        copy(x[: n - 1], before[1:])
        memory(p.e, p.r, s.q, s.low, before, y, w)
        for i in range(n):
            y[i] = fma(p.d, x[i], y[i])
        return ChainState(s.q, s.low, x[n - 1])

    @staticmethod
    def transfer(p, z):
        z = z[..., None]
        below = backward(z) + p.e / z
        # the integral at 0 Hz: beyond all numbers of physics
        below = np.where(abs(below) < 1e-280, 1e-280, below)
        return p.d + np.sum(p.r / z / below, axis=-1)


@public
def compliance_maxwell(
    f: Block, k: Block | float, b: float | None = None, *, tau: float | None = None
) -> Block:
    """Return the displacement of a Maxwell arm under a force.

    y = f/k + (1/b) * integral of f dt.

    It flows as long as the force acts, so there is no steady start: the force is taken
    as 0 before the first sample.

    Parameters
    ----------
    f : Block
        Force in N.
    k : float or Block
        Stiffness in N/m; live when it is a ``Param``, which needs ``tau`` and scales b
        with it.
    b : float
        Damping in N s/m.
    tau : float
        b/k in s, in place of b.

    Returns
    -------
    Block
        Displacement in m.

    Raises
    ------
    BadValue
        k, b or tau not above 0; both or neither of b and tau; a live k without tau.
    UnitError
        If the result is not a length.

    References
    ----------
    Çaldıran's thesis, eq. (2.1), with force and displacement exchanged; section 1.1.2.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.viscoelastic import compliance_maxwell
    >>> scene = stimlib.Scene(
    ...     {"y": compliance_maxwell(stimlib.Input("f", "N"), k=100.0, b=50.0)}
    ... )
    >>> y = stimlib.compile(scene, fs=1000).process(np.r_[0.0, np.ones(1000)][None])[
    ...     0
    ... ]  # 1 N for 1 s
    >>> float(y[-1].round(6))  # 1/100 + 0.9995/50
    0.02999
    """
    tau = time_constant("compliance_maxwell", k, b, tau)
    return _over(KelvinChain(as_block(f), 1.0, [], [], 1 / tau), k, f)  # type: ignore[arg-type]


@public
def compliance_kelvin_voigt(
    f: Block,
    k: Block | float,
    b: float | None = None,
    *,
    tau: float | None = None,
    onset: str = "step",
) -> Block:
    """Return the displacement of a spring and a parallel damper under a force.

    k y + b y' = f.

    The displacement creeps towards f/k.

    Parameters
    ----------
    f, k, b, tau
        As for ``compliance_maxwell``.
    onset : {"step", "steady"}
        Whether there was no force before the first sample, or it has always been as it
        is there, and y at f/k.

    Returns
    -------
    Block
        Displacement in m.

    Raises
    ------
    BadValue, UnitError
        As ``compliance_maxwell``.

    References
    ----------
    Çaldıran's thesis, section 1.1.2 and fig. 1.1b: the dual of relaxation; Kelvin-Voigt
    element, k_C = k + i w b.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.viscoelastic import compliance_kelvin_voigt
    >>> scene = stimlib.Scene(
    ...     {"y": compliance_kelvin_voigt(stimlib.Input("f", "N"), k=100.0, b=10.0)}
    ... )
    >>> t = np.arange(1001) / 1000
    >>> y = stimlib.compile(scene, fs=1000).process(np.minimum(t, 0.5)[None])[
    ...     0
    ... ]  # 1 N/s for half a second
    >>> exact = (t - 0.1 * -np.expm1(-t / 0.1)) / 100
    >>> bool(np.allclose(y[:501], exact[:501], rtol=1e-13))
    True
    """
    tau = time_constant("compliance_kelvin_voigt", k, b, tau)
    y = begun(
        "compliance_kelvin_voigt",
        f,
        onset,
        lambda g: KelvinChain(g, 0.0, [1.0], [tau], 0.0),  # type: ignore[arg-type]
        lambda y: 1.0,
    )
    return _over(y, k, f)


@public
def compliance_generalized_kelvin_voigt(
    f: Block,
    elements: Sequence[tuple[Block | float, Block | float]],
    *,
    k0: float | None = None,
    b: float | None = None,
    onset: str = "step",
) -> Block:
    """Return the displacement of a Kelvin-Voigt chain under a force.

    The chain consists of Kelvin-Voigt elements in series, and a spring and a damper if
    given.

    It is the dual of ``generalized_maxwell``; all elements run as one bank.

    Parameters
    ----------
    f : Block
        Force in N.
    elements : sequence of (k, tau)
        Stiffness in N/m and time constant in s of each Kelvin-Voigt element.
    k0 : float, optional
        Stiffness in N/m of a spring in the chain, which answers at once.
    b : float, optional
        Damping in N s/m of a damper in the chain, which flows for ever.
    onset : {"step", "steady"}
        Whether there was no force before the first sample, or it has always been as it
        is there.  With a damper there is no steady start: under a constant force it has
        flowed without end.

    Returns
    -------
    Block
        Displacement in m.

    Raises
    ------
    BadValue
        Nothing in the chain; a number not above 0; a steady start with a damper.
    UnitError
        If the result is not a length.

    References
    ----------
    Çaldıran's thesis, section 1.1.2 and fig. 1.1b.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.viscoelastic import compliance_generalized_kelvin_voigt
    >>> chain = compliance_generalized_kelvin_voigt(
    ...     stimlib.Input("f", "N"), [(100.0, 0.1), (200.0, 1.0)], k0=1000.0
    ... )
    >>> y = stimlib.compile(stimlib.Scene({"y": chain}), fs=1000).process(
    ...     np.ones((1, 20000))
    ... )[0]
    >>> float(y[-1].round(9))  # 1/100 + 1/200 + 1/1000
    0.016
    """
    if not elements and k0 is None and b is None:
        raise BadValue(
            "compliance_generalized_kelvin_voigt: the chain is empty; give elements, k0 or b"
        )
    k = [plain("compliance_generalized_kelvin_voigt", "k", e[0]) for e in elements]
    direct = 0.0 if k0 is None else 1 / plain("compliance_generalized_kelvin_voigt", "k0", k0)
    flow = 0.0 if b is None else 1 / plain("compliance_generalized_kelvin_voigt", "b", b)
    j, tau = [1 / v for v in k], [e[1] for e in elements]
    chain = begun(
        "compliance_generalized_kelvin_voigt",
        f,
        onset,
        lambda g: KelvinChain(g, direct, j, tau, flow),  # type: ignore[arg-type]
        lambda y: math.inf if flow else direct + math.fsum(j),
    )
    return _over(chain, constant(1.0, "N/m"), f)


def _over(y: Block, k, f) -> Block:
    """Return y divided by a stiffness; raise UnitError unless that is a length."""
    out = y / with_unit(k, "N/m")
    if out.dim != unit("m"):
        raise UnitError(
            f"compliance: {as_block(f)!r} [{y.dim}] over a stiffness is [{out.dim}], not a length;"
            " give f in N, k in N/m"
        )
    return out


# The springpot ------------------------------------------------------------------------
@public
def compliance(
    f: Block,
    chi: Block | float,
    alpha: float,
    scheme: str = "l1",
    tol: float = 1e-10,
    horizon: float = 86400.0,
) -> Block:
    """Return the displacement of a springpot under a force.

    y = I^alpha f / chi: the dual of ``springpot``.

    The force is taken as 0 before the first sample. There is no steady start, as a
    constant force has no steady displacement: it creeps for ever.

    Parameters
    ----------
    f : Block
        Force in N.
    chi : float or Block
        Coefficient in N s^alpha/m, as a plain number above 0; live when it is a signal
        (at 0 the output's guard closes).
    alpha : float
        Order from 0 (spring, y = f/chi) to 1 (dashpot, y = integral of f/chi).
    scheme : {"l1", "gl"}
        "l1" is exact for forces that are straight between samples, as the other blocks
        of creep are. "gl" is the inverse of the springpot's "gl": it has the weights of
        Gruenwald and Letnikov, and is early by alpha/2 samples.
    tol, horizon : float
        See ``springpot``; the bound is on the sum over |f|/fs.

    Returns
    -------
    Block
        Displacement in m.

    Raises
    ------
    BadValue
        As ``springpot``.
    UnitError
        f in another unit than N.

    Notes
    -----
    With "l1", y[n] = sum_j w_j f[n-j]/(chi fs^alpha), w_0 = 1/Gamma(2 + alpha) and,
    behind it, w_j = ((j + 1)^(1 + alpha) - 2 j^(1 + alpha) + (j - 1)^(1 +
    alpha))/Gamma(2 + alpha).  With "gl" it is the derivative of order 1 - alpha of the
    running integral of f.  So is "l1", with weights of its own.

    The running integral grows without end under a lasting force; its rounding adds an
    error of about 2^-53 (t fs)^(1 - alpha) of y: 2e-13 after an hour at 1 kHz for alpha
    = 0.5, 2e-10 for alpha = 0.05.

    References
    ----------
    Çaldıran's thesis, figure 1.1b (creep).  Diethelm, Ford and Freed (2004), Numerical
    Algorithms 36:31: the product trapezoidal rule, which "l1" is.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from math import gamma
    >>> from stimlib.blocks import compliance
    >>> f = stimlib.Input("f", "N")
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": compliance(f, chi=100.0, alpha=0.5)}),
    ...     fs=1000,
    ... )
    >>> t = np.arange(1000) / 1000
    >>> y = proc.process(t[None])[0]  # 1 N/s
    >>> bool(np.allclose(y, t**1.5 / (100 * gamma(2.5)), rtol=1e-9))
    True
    """
    f = as_block(f)
    in_unit("compliance: f", f, f.dim, "N")
    one_of("compliance: scheme", scheme, soe.SCHEMES)
    alpha = design_value("compliance: alpha", Alpha, alpha)
    chi = as_block(chi)
    if isinstance(chi, Const) and chi.value <= 0:
        raise BadValue(f"compliance: chi = {chi.value:g} must be above 0")
    gain = coefficient(chi, "compliance")
    number = f / constant(1.0, "N")
    metre = constant(1.0, "m")
    if alpha == 0:
        y = number
    elif alpha == 1 and scheme == "l1":
        y = KelvinChain(number, 0.0, [], [], 1.0)  # type: ignore[arg-type]
    else:
        total = Integrate(number, 0.0, held=True) / constant(1.0, "s")
        y = Springpot(
            total,
            as_block(1.0),
            1.0 - alpha,
            {"l1": soe.STRAIGHT}.get(scheme, scheme),
            tol,
            horizon,
            "step",
        )
    return metre * y / gain


# A springpot in series --------------------------------------------------------------
# A springpot in series with a spring or a dashpot: one force, two displacements that
# add up.
# Parameters of `Series` at a sample rate.
#   e        of the springpot, see fractional.SpringpotParams
#   pot      chi fs^alpha
#   newest   v_0
#   other    k, or b fs
#   dashpot  1: the other element is a dashpot
SeriesParams = namedtuple("SeriesParams", "e r taps constant pot newest other dashpot alpha fs")

# State of `Series` between samples.
#   line  the springpot's last nine displacements
#   last  y
SeriesState = namedtuple("SeriesState", "line q low first last cold")


@dataclass(frozen=True, eq=False)
class Series(Block):
    """A springpot in series with a spring or a dashpot.

    f = chi D^alpha z = k (y - z), or b d(y - z)/dt. The springpot's displacement z is
    solved for at every sample.

    With u = y[n] - z[n-1] (spring) or y[n] - y[n-1] (dashpot), g = k or b fs, S = chi
    fs^alpha, and R the springpot's sum without its newest step d = z[n] - z[n-1]:
    g (u - d) = S (v_0 d + R), so d = (g u - S R)/(g + S v_0).
    """

    y: Block
    contact: Block
    other: Above0
    dashpot: bool
    chi: Above0
    order: float
    scheme: str
    tol: float
    horizon: Above0
    resettable = True

    def check(self):
        check_fields(self)
        if self.order in (0.0, 1.0):
            raise BadValue(
                f"series: alpha = {self.order:g} is a spring or a dashpot; use maxwell(y, k, b),"
                " spring or kelvin_voigt"
            )

    def units(self, *u: un.Unit) -> un.Unit:
        return force_unit("series", u[0])

    def design(self, fs):
        p, s = Springpot(
            self.y, self.contact, self.order, self.scheme, self.tol, self.horizon, "steady"
        ).design(fs)
        other = self.other * (fs if self.dashpot else 1.0)
        numbers = (
            self.chi * math.pow(fs, self.order),
            p.taps[7],
            other,
            float(self.dashpot),
            self.order,
            fs,
        )
        return SeriesParams(p.e, p.r, p.taps, p.constant, *numbers), SeriesState(
            s.line, s.q, s.low, 0.0, 0.0, 1.0
        )

    def laws(self, fs):
        if self.horizon * fs < responses.SHORTEST:
            return ()
        return (
            responses.series(
                self.chi,
                self.order,
                self.other,
                self.dashpot,
                self.scheme,
                self.tol,
                self.horizon,
                fs,
            ),
        )

    work = scratch(WORK + 512)

    @staticmethod
    def tile(p, s, x, y, w):
        first, last = begin(s, x[0]), where(s.cold > 0.0, x[0], s.last)
        d, near, far = w[DIFFERENCES : DIFFERENCES + 9], w[0:1], w[1:2]
        for i in range(x.size):
            for j in range(8):
                d[j] = s.line[j + 1] - s.line[j]
            d[8] = 0.0
            memory(p.e, p.r, s.q, s.low, d[0:1], far, w[WORK:])
            fir(p.taps, d[1:9], near)
            rest = fma(p.constant, s.line[1] - first, near[0] + far[0])
            u = where(p.dashpot > 0.0, x[i] - last, x[i] - s.line[8])
            step = (p.other * u - p.pot * rest) / (p.other + p.pot * p.newest)
            z = s.line[8] + step
            for j in range(8):
                s.line[j] = s.line[j + 1]
            s.line[8] = z
            y[i] = p.pot * fma(p.newest, step, rest)
            last = x[i]
        return SeriesState(s.line, s.q, s.low, first, last, 0.0)

    @staticmethod
    def transfer(p, z):
        pot = transfer(p, p.alpha, p.pot, p.taps, p.constant, p.r, z)
        other = p.other * backward(z) if p.dashpot > 0 else p.other * np.ones_like(z)
        return pot * other / (pot + other)


@public
def springpot_series(
    y: Block,
    chi: float,
    alpha: float,
    k: float | None = None,
    b: float | None = None,
    scheme: str = "l1",
    tol: float = 1e-10,
    horizon: float = 86400.0,
    contact: Block | float = 1.0,
) -> Block:
    """Compute a springpot in series with a spring or a dashpot.

    With a spring it is the fractional Maxwell arm.

    Parameters
    ----------
    y : Block
        Displacement over both elements, in m; it always begins steady: relaxed at the
        first sample, wherever that is.
    chi : float
        Springpot, N s^alpha/m, above 0.
    alpha : float
        Its order, above 0 and below 1.
    k, b : float
        Either the spring's stiffness in N/m, or the dashpot's damping in N s/m.
    scheme, tol, horizon
        See ``springpot``.
    contact : Block
        Where it is not above 0 the force is 0; at re-contact the arm is relaxed.

    Returns
    -------
    Block
        Force in N.

    Raises
    ------
    BadValue
        Both or none of k and b; a number out of range.

    Notes
    -----
    The inner displacement is found implicitly at every sample, so every k, b and chi is
    stable.  Under a prescribed force no such block is needed: displacements in series
    add, ``f / k + compliance(f, chi, alpha)``.

    References
    ----------
    Çaldıran's thesis, section 2.2; the relaxation of spring and springpot is k
    E_alpha(-(k/chi) t^alpha).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import springpot_series
    >>> arm = springpot_series(stimlib.Input("y", "m"), chi=100.0, alpha=0.5, k=1000.0)
    >>> f = stimlib.compile(stimlib.Scene({"f": arm}), fs=8000).process(
    ...     np.r_[0.0, np.full(7999, 0.01)][None]
    ... )[0]
    >>> bool(9.0 < f[1] < 10.0) and bool(
    ...     f[-1] < 1.0
    ... )  # the spring gives way to the springpot
    True
    """
    if (k is None) == (b is None):
        raise BadValue("springpot_series: give either k (a spring) or b (a dashpot)")
    other = k if k is not None else b
    assert other is not None
    return Series(
        as_block(y), as_block(contact), other, b is not None, chi, alpha, scheme, tol, horizon
    )
