"""Relaxation: displacement in, force out, of springs and dampers in series."""

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
from ..core.graph import Block, Const, as_block, constant, scratch
from ..core.maths import memory
from ..core.pointwise import Where
from ..core.response import backward
from ..core.units import unit
from ..design.padding import padded
from ..errors import BadValue, UnitError, public
from .friction import amount
from .impedance import sampled, spring
from .onset import ONSETS, check_onset
from .springpots import (
    origin,
)

# Maxwell arms and, in ``creep``, Kelvin-Voigt chains are exact for inputs that are
# straight between samples.  With T = 1/fs and a = T/tau,
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
    begins_early = False
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
    parts += [
        (amount("generalized_maxwell", "k", k, "N/m", zero=False), [1.0], [tau]) for k, tau in live
    ]
    force = reduce(add, (gain * MaxwellArms(y, touch, k, tau, onset) for gain, k, tau in parts))
    if force.dim != unit("N"):
        raise UnitError(
            f"maxwell: a stiffness times {y!r} [{y.dim}] is [{force.dim}], not a force; give y in m"
            " and k in N/m"
        )
    if number(k0) == 0:
        return force
    rest = spring(y, amount("generalized_maxwell", "k0", k0, "N/m"))
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
