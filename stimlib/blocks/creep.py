"""Creep: force in, displacement out, of springs and dampers in series (``relaxation`` has the equations) and of the springpot.

The chains are exact for forces that are straight between samples; before the first sample there is no force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.graph import Block, as_block, constant
from ..core.maths import copy, fma, memory
from ..core.response import backward
from ..core.units import unit
from ..design import responses
from ..design.eights import padded
from ..errors import BadValue, UnitError
from .fractional import Springpot
from .impedance import with_unit
from .relaxation import SCRATCH, check_lists, number, sampled, time_constant
from .springpot import coefficient


# Springs and dampers -------------------------------------------------------------------------------------------------
class ChainParams(NamedTuple):
    e: np.ndarray  # leaks; padded with ones
    r: np.ndarray  # e g/k; padded with zeros
    d: float  # direct


class ChainState(NamedTuple):
    q: np.ndarray
    low: np.ndarray
    last: float


@dataclass(frozen=True, eq=False)
class KelvinChain(Block):
    """Elements in series: y = j0 f + sum_i j_i (f lagging by tau_i) + fluidity Int f dt.

    q_i += f[n-1] - e_i q_i;  y = (j0 + sum_i j_i h_i) f[n] + sum_i j_i e_i g_i q_i; the integral is an element with e = 0.
    """

    f: Block
    j0: float
    j: np.ndarray
    tau: np.ndarray
    fluidity: float

    def check(self):
        check_lists(self, self.j, "j")
        if self.j0 < 0 or self.fluidity < 0:
            raise BadValue(f"KelvinChain: j0 = {self.j0:g} and fluidity = {self.fluidity:g} must not be below 0")

    def design(self, fs):
        s = [sampled(1 / tau / fs) for tau in self.tau.tolist()]
        j = self.j.tolist()
        flow = [self.fluidity / fs] if self.fluidity > 0 else []
        e = padded([v.e for v in s] + [0.0 for _ in flow], 1.0)
        r = padded([c * v.e * v.g for c, v in zip(j, s, strict=True)] + flow)
        d = math.fsum([self.j0, *(c * v.h for c, v in zip(j, s, strict=True)), *(v / 2 for v in flow)])
        return ChainParams(e, r, d), ChainState(np.zeros(e.size), np.zeros(e.size), 0.0)

    def laws(self, fs):
        return (responses.chain(self.j0, self.j, self.tau, self.fluidity),)

    @staticmethod
    def work(p):
        return SCRATCH + 64

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
        below = np.where(abs(below) < 1e-280, 1e-280, below)  # the integral at 0 Hz: beyond all numbers of physics
        return p.d + np.sum(p.r / z / below, axis=-1)


def compliance_maxwell(f: Block, k, b: float | None = None, *, tau: float | None = None) -> Block:
    """Displacement of a Maxwell arm under a force: y = f/k + (1/b) Int f dt.  It flows for as long as the force acts.

    Parameters
    ----------
    f : Block
        Force in N.
    k : float or Block
        Stiffness in N/m; live when it is a ``Param``, which needs ``tau`` and scales b with it.
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
    >>> from stimlib.blocks.creep import compliance_maxwell
    >>> scene = stimlib.Scene({"y": compliance_maxwell(stimlib.Input("f", "N"), k=100.0, b=50.0)})
    >>> y = stimlib.compile(scene, fs=1000).process(np.r_[0.0, np.ones(1000)][None])[0]  # 1 N for 1 s
    >>> float(y[-1].round(6))  # 1/100 + 0.9995/50
    0.02999
    """
    tau, gain = time_constant("compliance_maxwell", k, b, tau), number(k)
    if gain is None:
        return _over(KelvinChain(as_block(f), 1.0, [], [], 1 / tau), k, f)  # type: ignore[arg-type]
    return compliance_generalized_kelvin_voigt(f, [], k0=gain, b=gain * tau if b is None else b)


def compliance_kelvin_voigt(f: Block, k, b: float | None = None, *, tau: float | None = None) -> Block:
    """Displacement of a spring and a damper side by side under a force: k y + b y' = f.  It creeps towards f/k.

    Parameters
    ----------
    f, k, b, tau
        As for ``compliance_maxwell``.

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
    Çaldıran's thesis, section 1.1.2 and fig. 1.1b: the dual of relaxation; Kelvin-Voigt element, k_C = k + i w b.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.creep import compliance_kelvin_voigt
    >>> scene = stimlib.Scene({"y": compliance_kelvin_voigt(stimlib.Input("f", "N"), k=100.0, b=10.0)})
    >>> t = np.arange(1001) / 1000
    >>> y = stimlib.compile(scene, fs=1000).process(np.minimum(t, 0.5)[None])[0]  # 1 N/s for half a second
    >>> exact = (t - 0.1 * -np.expm1(-t / 0.1)) / 100
    >>> bool(np.allclose(y[:501], exact[:501], rtol=1e-13))
    True
    """
    tau, gain = time_constant("compliance_kelvin_voigt", k, b, tau), number(k)
    if gain is None:
        return _over(KelvinChain(as_block(f), 0.0, [1.0], [tau], 0.0), k, f)  # type: ignore[arg-type]
    return compliance_generalized_kelvin_voigt(f, [(gain, tau)])


def compliance_generalized_kelvin_voigt(f: Block, elements, *, k0: float | None = None, b: float | None = None) -> Block:
    """Displacement of a chain under a force: Kelvin-Voigt elements in series, and a spring and a damper if given.

    The dual of ``generalized_maxwell``; all elements run as one bank.

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

    Returns
    -------
    Block
        Displacement in m.

    Raises
    ------
    BadValue
        Nothing in the chain; a number not above 0.
    UnitError
        If the result is not a length.

    References
    ----------
    Çaldıran's thesis, section 1.1.2 and fig. 1.1b.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.creep import compliance_generalized_kelvin_voigt
    >>> chain = compliance_generalized_kelvin_voigt(stimlib.Input("f", "N"), [(100.0, 0.1), (200.0, 1.0)], k0=1000.0)
    >>> y = stimlib.compile(stimlib.Scene({"y": chain}), fs=1000).process(np.ones((1, 20000)))[0]
    >>> float(y[-1].round(9))  # 1/100 + 1/200 + 1/1000
    0.016
    """
    elements = [tuple(e) for e in elements]
    if any(len(e) != 2 for e in elements):
        raise BadValue("compliance_generalized_kelvin_voigt: elements must be pairs (stiffness in N/m, time constant in s)")
    if not elements and k0 is None and b is None:
        raise BadValue("compliance_generalized_kelvin_voigt: nothing in the chain; give elements, k0 or b")
    k = [_plain("compliance_generalized_kelvin_voigt", "k", e[0]) for e in elements]
    direct = 0.0 if k0 is None else 1 / _plain("compliance_generalized_kelvin_voigt", "k0", k0)
    flow = 0.0 if b is None else 1 / _plain("compliance_generalized_kelvin_voigt", "b", b)
    chain = KelvinChain(as_block(f), direct, [1 / v for v in k], [e[1] for e in elements], flow)  # type: ignore[arg-type]
    return _over(chain, constant(1.0, "N/m"), f)


def _over(y: Block, k, f) -> Block:
    """y over a stiffness, which must be a length."""
    out = y / with_unit(k, "N/m")
    if out.dim != unit("m"):
        raise UnitError(
            f"compliance: {as_block(f)!r} [{y.dim}] over a stiffness is [{out.dim}], not a length; give f in N, k in N/m"
        )
    return out


def _plain(name: str, field: str, v) -> float:
    value = number(v)
    if value is None:
        raise BadValue(f"{name}: {field} = {v!r} must be a plain number; a live gain is multiplied")
    if not value > 0:
        raise BadValue(f"{name}: {field} = {value:g} must be above 0")
    return value


# The springpot -------------------------------------------------------------------------------------------------------
class IntegralParams(NamedTuple):
    h: float


class IntegralState(NamedTuple):
    z: float
    low: float  # what z has lost to rounding


@dataclass(frozen=True, eq=False)
class Integral(Block):
    """z[n] = z[n-1] + x[n]/fs, the sum kept in two words; starts at 0."""

    x: Block

    def units(self, *u):
        return u[0] * unit("s")

    def design(self, fs):
        return IntegralParams(1 / fs), IntegralState(0.0, 0.0)

    def laws(self, fs):
        return (responses.running_sum(),)

    @staticmethod
    def step(p, s, x):
        add = x * p.h + s.low
        z = s.z + add
        back = z - s.z
        return z, IntegralState(z, (s.z - (z - back)) + (add - back))

    @staticmethod
    def transfer(p, z):
        return p.h / backward(z)


def compliance(f: Block, chi, alpha: float, scheme: str = "gl", tol: float = 1e-10, horizon: float = 86400.0) -> Block:
    """Displacement of a springpot under a force, y = I^alpha f / chi: the dual of ``springpot``; free of load before.

    The fractional integral of order alpha is the derivative of order 1 - alpha of the running integral of f, whose
    Gruenwald-Letnikov weights it has exactly.

    Parameters
    ----------
    f : Block
        Force in N.
    chi : float or Block
        Coefficient in N s^alpha/m, as a plain number above 0; live when it is a signal (at 0 the output's guard closes).
    alpha : float
        Order from 0 (spring, y = f/chi) to 1 (dashpot, y = integral of f/chi).
    scheme : {"gl", "l1"}
        "l1" is exact for forces that are held between samples.
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
    The running integral grows without end under a lasting force; its rounding adds an error of about
    2^-53 (t fs)^(1 - alpha) of y: 2e-13 after an hour at 1 kHz for alpha = 0.5, 2e-10 for alpha = 0.05.

    References
    ----------
    Çaldıran's thesis, figure 1.1b (creep).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from math import gamma
    >>> from stimlib.blocks import compliance
    >>> f = stimlib.Input("f", "N")
    >>> proc = stimlib.compile(stimlib.Scene({"y": compliance(f, chi=100.0, alpha=0.5, scheme="l1")}), fs=1000)
    >>> y = proc.process(np.ones((1, 1000)))[0]  # 1 N from the first sample on
    >>> bool(np.allclose(y, (np.arange(1, 1001) / 1000) ** 0.5 / (100 * gamma(1.5)), rtol=1e-9))
    True
    """
    f = as_block(f)
    if f.dim != unit("N"):
        raise UnitError(f"compliance: the force {f!r} is in [{f.dim}], not in N")
    number = f / constant(1.0, "N")
    metre = constant(1.0, "m")
    if alpha == 0:
        return metre * number / coefficient(chi)
    z = Integral(number) / constant(1.0, "s")
    if alpha == 1:
        return metre * z / coefficient(chi)
    return metre * Springpot(z, as_block(1.0), 1.0 - alpha, scheme, tol, horizon, "step") / coefficient(chi)
