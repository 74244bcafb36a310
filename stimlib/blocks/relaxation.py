"""Springs and dampers in series: Maxwell arms (relaxation) and, force in and displacement out, Kelvin-Voigt chains (creep).

All of them are exact for inputs that are straight between samples.  With T = 1/fs and a = T/tau,

    e = 1 - exp(-a) = -expm1(-a),    g = e/a,    h = 1 - g = a/2 - a^2/6 + a^3/24 - ..    (summed where it is small)

are all that one time constant needs:

    Maxwell arm     f' + f/tau = k y'      q[n] = q[n-1] - e q[n-1] + (y[n] - y[n-1]),    f[n] = k g q[n]
    Kelvin-Voigt    tau y' + y = f/k       q[n] = q[n-1] - e q[n-1] + f[n-1],             y[n] = (h f[n] + e g q[n])/k

No difference of large numbers is left, whatever tau is: for tau -> 0 the arm becomes e = 1, g = a (a damper b = k tau), for
tau -> infinity e = a, g = 1 (a spring).  The leak e is stored, not the pole 1 - e, and q has two words (``maths.memory``), as a
leak of 1e-17 a sample would be lost in one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..core import units as un
from ..core.graph import Block, Const, as_block, constant
from ..core.maths import copy, fma, memory
from ..core.response import backward
from ..core.units import unit
from ..design import responses
from ..errors import BadValue, UnitError
from .continuous import Stiffness
from .fractional import ONSETS, origin
from .impedance import spring, with_unit
from .maps import Where

SCRATCH = 512  # words that ``memory`` needs; differences stand behind them


class Sampled(NamedTuple):
    """What one time constant becomes at a sample rate, all to rounding."""

    e: float  # 1 - exp(-a)
    g: float  # e/a
    h: float  # 1 - e/a


def sampled(a: float) -> Sampled:
    """e = 1 - exp(-a), g = e/a and h = 1 - g, for a = 1/(tau fs) from 0 on, without cancellation.

    Parameters
    ----------
    a : float
        Sample period over time constant, not below 0.

    Returns
    -------
    Sampled

    Examples
    --------
    >>> from stimlib.blocks.relaxation import sampled
    >>> sampled(1e-20)
    Sampled(e=1e-20, g=1.0, h=5e-21)
    >>> sampled(1e20)
    Sampled(e=1.0, g=1e-20, h=1.0)
    """
    e = -math.expm1(-a)
    if a < 1.0:  # h = sum_{n>0} (-1)^(n+1) a^n/(n+1)!; above 1 at most one bit of 1 - g cancels
        term = a / 2
        terms = [term]
        for n in range(3, 22):
            term *= -a / n
            terms.append(term)
        return Sampled(e, e / a if a > 0 else 1.0, math.fsum(terms))
    return Sampled(e, e / a, 1 - e / a)


def _eights(a: Sequence[float], fill: float) -> np.ndarray:
    return np.array([*a, *[fill] * (-len(a) % 8)])


def _check_lists(b: Any, values: np.ndarray, name: str) -> None:
    if values.ndim != 1 or b.tau.shape != values.shape:
        raise BadValue(
            f"{type(b).__name__}: {name} and tau must be two lists of one length, got {values.shape} and {b.tau.shape}"
        )
    for what, a in ((name, values), ("tau", b.tau)):
        if not np.all(a > 0):
            raise BadValue(f"{type(b).__name__}.{what}[{int(np.argmin(a > 0))}] = {a[np.argmin(a > 0)]:g} must be above 0")


# Displacement in, force out ------------------------------------------------------------------------------------------
class ArmsParams(NamedTuple):
    e: np.ndarray  # leaks; padded with ones
    r: np.ndarray  # k g; padded with zeros


class ArmsState(NamedTuple):
    q: np.ndarray
    low: np.ndarray  # second words of q
    last: float
    cold: float


@dataclass(frozen=True, eq=False)
class MaxwellArms(Block):
    """Maxwell arms side by side: q_i += (y[n] - y[n-1]) - e_i q_i;  f = sum_i k_i g_i q_i.  k as factors of y."""

    y: Block
    contact: Block
    k: np.ndarray
    tau: np.ndarray
    onset: str
    resettable = True

    def check(self):
        _check_lists(self, self.k, "k")
        if self.onset not in ONSETS:
            raise BadValue(f"maxwell: onset = {self.onset!r}; choose one of {', '.join(ONSETS)}")

    def design(self, fs):
        s = [sampled(1 / tau / fs) for tau in self.tau.tolist()]
        e = _eights([v.e for v in s], 1.0)
        r = _eights([k * v.g for k, v in zip(self.k.tolist(), s, strict=True)], 0.0)
        return ArmsParams(e, r), ArmsState(np.zeros(e.size), np.zeros(e.size), 0.0, ONSETS[self.onset])

    def laws(self, fs):
        return (responses.arms(self.k, self.tau),)

    @staticmethod
    def work(p):
        return SCRATCH + 64

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
        """Behind the continuous arms at low frequencies: 0 for slow ones (springs), half a sample for fast ones (dampers)."""
        live = p.r[: self.k.size] > 0
        k, a = self.k[live], p.e[: live.size][live] * self.k[live] / p.r[: live.size][live]
        if not np.all(a > 0) or not a.size:
            return 0.0
        late = np.array([v / 12 if v < 1e-2 else 0.5 + 1 / math.expm1(v) - 1 / v if v < 700 else 0.5 - 1 / v for v in a])
        damping = k * (a.min() / a)  # b = k tau, up to a factor
        return float(np.sum(damping * late) / np.sum(damping))


def maxwell(y: Block, k, b: float | None = None, *, tau: float | None = None, onset: str = "rest", contact=None) -> Block:
    """Maxwell arm, a spring and a damper in series: f'/k + f/b = y'.  The force of a held position decays with tau = b/k.

    Exact for positions that are straight between samples, for any tau: much faster than a sample it is a damper, much slower
    than the recording it is a spring.

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
    onset : {"rest", "step"}
        Whether the first position is where y has always been, or is reached from 0 in one sample.
    contact : Block, optional
        Where it is not above 0 the force is 0; at re-contact the arm starts anew, at rest.

    Returns
    -------
    Block
        Force in N.

    Raises
    ------
    BadValue
        k, b or tau not above 0; both or neither of b and tau; a live k without tau; an unknown onset.
    UnitError
        If the result is not a force.

    References
    ----------
    Paper 001, section 2.1, eqs. (2.1) and (2.5): k_C = i w tau k/(1 + i w tau).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.relaxation import maxwell
    >>> scene = stimlib.Scene({"f": maxwell(stimlib.Input("y", "m"), k=200.0, b=20.0)})  # tau = 0.1 s
    >>> t = np.arange(1000) / 1000
    >>> f = stimlib.compile(scene, fs=1000).process(0.05 * t[None])[0]  # 0.05 m/s
    >>> bool(np.allclose(f, 20.0 * 0.05 * -np.expm1(-t / 0.1), rtol=1e-13))
    True
    """
    return generalized_maxwell(y, 0.0, [(k, _time_constant("maxwell", k, b, tau))], onset=onset, contact=contact)


def generalized_maxwell(y: Block, k0, arms, *, onset: str = "rest", contact=None) -> Block:
    """A spring and any number of Maxwell arms side by side.  All arms with plain numbers run as one bank.

    Parameters
    ----------
    y : Block
        Position in m.
    k0 : float or Block
        Stiffness in N/m of the spring, what remains when all arms have relaxed.
    arms : sequence of (k, tau)
        Stiffness in N/m (a number, or a Block such as a ``Param``) and time constant in s of each arm.
    onset : {"rest", "step"}
        Whether the first position is where y has always been, so that the arms have relaxed there, or is reached from 0 in
        one sample.
    contact : Block, optional
        Where it is not above 0 the force is 0; at re-contact the arms start anew, at rest.

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
    Paper 001, section 2.1 and fig. 2.1.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.relaxation import generalized_maxwell
    >>> y = stimlib.Input("y", "m")
    >>> soft = generalized_maxwell(y, 100.0, [(50.0, 0.01), (30.0, 1.0)])
    >>> f = stimlib.compile(stimlib.Scene({"f": soft}), fs=1000).process(np.array([[0.0] + [0.01] * 9999]))[0]
    >>> f[[1, 100, -1]].round(3)
    array([1.776, 1.272, 1.   ])
    """
    y, arms = as_block(y), [tuple(arm) for arm in arms]
    touch = as_block(1.0 if contact is None else contact)
    if not arms or any(len(arm) != 2 for arm in arms):
        raise BadValue("generalized_maxwell: arms must be at least one pair (stiffness in N/m, time constant in s)")
    plain = [(_number(k), tau) for k, tau in arms if _number(k) is not None]
    live = [(k, tau) for k, tau in arms if _number(k) is None]
    parts: list[tuple[Any, Any, Any]] = [(constant(1.0, "N/m"), [k for k, _ in plain], [t for _, t in plain])] if plain else []
    parts += [(as_block(k), [1.0], [tau]) for k, tau in live]
    force = None
    for gain, k, tau in parts:
        one = gain * MaxwellArms(y, touch, k, tau, onset)
        force = one if force is None else force + one
    assert force is not None
    if force.dim != unit("N"):
        raise UnitError(f"maxwell: a stiffness times {y!r} [{y.dim}] is [{force.dim}], not a force; give y in m and k in N/m")
    if isinstance(k0, (int, float)) and k0 < 0:
        raise BadValue(f"generalized_maxwell: k0 = {k0:g} must not be below 0")
    if _number(k0) == 0:
        return force
    rest = spring(y, k0)
    return (rest if contact is None else Where(touch, rest, as_block(0.0))) + force


def standard_linear_solid(y: Block, k0, k1, tau: float, *, onset: str = "rest", contact=None) -> Block:
    """A spring beside one Maxwell arm: stiffness k0 + k1 at first, k0 in the end.

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
    Paper 001, section 2.1 and fig. 2.1, with one arm.

    Examples
    --------
    >>> from stimlib import Input, Param
    >>> from stimlib.blocks.relaxation import standard_linear_solid
    >>> str(standard_linear_solid(Input("y", "m"), Param("k0", 100.0, "N/m"), 300.0, tau=0.2).dim)
    'N'
    """
    return generalized_maxwell(y, k0, [(k1, tau)], onset=onset, contact=contact)


# Force in, displacement out ------------------------------------------------------------------------------------------
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
        _check_lists(self, self.j, "j")
        if self.j0 < 0 or self.fluidity < 0:
            raise BadValue(f"KelvinChain: j0 = {self.j0:g} and fluidity = {self.fluidity:g} must not be below 0")

    def design(self, fs):
        s = [sampled(1 / tau / fs) for tau in self.tau.tolist()]
        j = self.j.tolist()
        flow = [self.fluidity / fs] if self.fluidity > 0 else []
        e = _eights([v.e for v in s] + [0.0 for _ in flow], 1.0)
        r = _eights([c * v.e * v.g for c, v in zip(j, s, strict=True)] + flow, 0.0)
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

    Exact for forces that are straight between samples; before the first sample there is no force.

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
    Paper 001, eq. (2.1), with force and displacement exchanged; section 1.1.2.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.relaxation import compliance_maxwell
    >>> scene = stimlib.Scene({"y": compliance_maxwell(stimlib.Input("f", "N"), k=100.0, b=50.0)})
    >>> y = stimlib.compile(scene, fs=1000).process(np.r_[0.0, np.ones(1000)][None])[0]  # 1 N for 1 s
    >>> float(y[-1].round(6))  # 1/100 + 0.9995/50
    0.02999
    """
    tau, gain = _time_constant("compliance_maxwell", k, b, tau), _number(k)
    if gain is None:
        return _over(KelvinChain(as_block(f), 1.0, [], [], 1 / tau), k, f)  # type: ignore[arg-type]
    return compliance_generalized_kelvin_voigt(f, [], k0=gain, b=gain * tau if b is None else b)


def compliance_kelvin_voigt(f: Block, k, b: float | None = None, *, tau: float | None = None) -> Block:
    """Displacement of a spring and a damper side by side under a force: k y + b y' = f.  It creeps towards f/k.

    Exact for forces that are straight between samples; before the first sample there is no force.

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
    Paper 001, section 1.1.2 and fig. 1.1b: the dual of relaxation; Kelvin-Voigt element, k_C = k + i w b.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.relaxation import compliance_kelvin_voigt
    >>> scene = stimlib.Scene({"y": compliance_kelvin_voigt(stimlib.Input("f", "N"), k=100.0, b=10.0)})
    >>> t = np.arange(1001) / 1000
    >>> y = stimlib.compile(scene, fs=1000).process(np.minimum(t, 0.5)[None])[0]  # 1 N/s for half a second
    >>> exact = (t - 0.1 * -np.expm1(-t / 0.1)) / 100
    >>> bool(np.allclose(y[:501], exact[:501], rtol=1e-13))
    True
    """
    tau, gain = _time_constant("compliance_kelvin_voigt", k, b, tau), _number(k)
    if gain is None:
        return _over(KelvinChain(as_block(f), 0.0, [1.0], [tau], 0.0), k, f)  # type: ignore[arg-type]
    return compliance_generalized_kelvin_voigt(f, [(gain, tau)])


def compliance_generalized_kelvin_voigt(f: Block, elements, *, k0: float | None = None, b: float | None = None) -> Block:
    """Displacement of a chain under a force: Kelvin-Voigt elements in series, and a spring and a damper if given.

    The dual of ``generalized_maxwell``; all elements run as one bank.  Exact for forces that are straight between samples;
    before the first sample there is no force.

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
    Paper 001, section 1.1.2 and fig. 1.1b.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.relaxation import compliance_generalized_kelvin_voigt
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


def _number(v) -> float | None:
    """The value of a plain number (or a constant without unit, or in N/m); None for any other signal."""
    b = as_block(v)
    return b.value if isinstance(b, Const) and b.dim in (un.ONE, unit("N/m")) else None


def _plain(name: str, field: str, v) -> float:
    value = _number(v)
    if value is None:
        raise BadValue(f"{name}: {field} = {v!r} must be a plain number; a live gain is multiplied")
    if not value > 0:
        raise BadValue(f"{name}: {field} = {value:g} must be above 0")
    return value


def _time_constant(name: str, k, b, tau) -> float:
    """tau, or b/k, from arguments of which one must be there."""
    if (b is None) == (tau is None):
        raise BadValue(f"{name}: give one of b (N s/m) and tau (s), the other follows from tau = b/k")
    value = _number(k)
    if value is not None and not (math.isfinite(value) and value > 0):
        raise BadValue(f"{name}: k = {value:g} must be above 0")
    if tau is None:
        if value is None:
            raise BadValue(f"{name}: with the signal {k!r} as stiffness give tau in s: a time constant cannot be live")
        if isinstance(b, Block) or not (math.isfinite(b) and b > 0):
            raise BadValue(f"{name}: b = {b} must be a plain number above 0")
        tau = b / value
    if isinstance(tau, Block) or not (math.isfinite(tau) and tau > 0):
        raise BadValue(f"{name}: tau = {tau} must be a plain number above 0")
    return float(tau)


# The continuous laws -------------------------------------------------------------------------------------------------
def maxwell_stiffness(k: float, tau: float, w) -> Stiffness:
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
        Named arrays of the shape of w: complex, storage, loss and magnitude in N/m, phase in rad.

    Raises
    ------
    BadValue
        A number outside its range.

    References
    ----------
    Paper 001, eqs. (2.5) to (2.7).

    Examples
    --------
    >>> from stimlib.blocks.relaxation import maxwell_stiffness
    >>> arm = maxwell_stiffness(200.0, 0.1, 10.0)
    >>> float(arm.storage), float(arm.loss), round(float(arm.phase), 6)
    (100.0, 100.0, 0.785398)
    """
    _positive("maxwell_stiffness", k=k, tau=tau)
    w = np.asarray(w, float)
    if not np.all(w >= 0):
        raise BadValue("maxwell_stiffness: w must not be below 0")
    x = w * tau
    small = np.minimum(x, 1 / np.maximum(x, 1e-300))  # x or 1/x, so that no square is too large
    loss = k * small / (1 + small * small)
    storage = np.where(x < 1, loss * small, k / (1 + small * small))
    size = k * np.where(x < 1, small, 1.0) / np.sqrt(1 + small * small)
    return Stiffness(storage + 1j * loss, storage, loss, size, np.arctan2(1.0, x))


def relaxation_modulus(t, k0: float = 0.0, arms=(), springpot: tuple[float, float] | None = None) -> np.ndarray:
    """Force over displacement after a step: k0 + sum k_i exp(-t/tau_i) + chi t^-alpha/Gamma(1 - alpha).

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
    Paper 001, section 1.1.1 and fig. 1.1a; eqs. (2.1) and (2.8).

    Examples
    --------
    >>> from stimlib.blocks.relaxation import relaxation_modulus
    >>> relaxation_modulus([0.0, 0.1, 1e3], 100.0, [(50.0, 0.1)]).round(3)
    array([150.   , 118.394, 100.   ])
    """
    t = _times("relaxation_modulus", t)
    out = np.full(t.shape, float(k0))
    for k, tau in arms:
        _positive("relaxation_modulus", k=k, tau=tau)
        out = out + k * np.exp(-t / tau)
    if springpot is not None:
        chi, alpha = _springpot("relaxation_modulus", springpot)
        if alpha == 1:
            out = out + np.where(t > 0, 0.0, math.inf)
        else:
            with np.errstate(divide="ignore"):
                out = out + chi * t**-alpha / math.gamma(1 - alpha)
    return out


def creep_compliance(
    t, k0: float | None = None, elements=(), b: float | None = None, springpot: tuple[float, float] | None = None
) -> np.ndarray:
    """Displacement over force after a step: 1/k0 + t/b + sum (1 - exp(-t/tau_i))/k_i + t^alpha/(chi Gamma(1 + alpha)).

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
    Paper 001, section 1.1.2 and fig. 1.1b.

    Examples
    --------
    >>> from stimlib.blocks.relaxation import creep_compliance
    >>> creep_compliance([0.0, 0.1, 1e3], elements=[(100.0, 0.1)]).round(6)
    array([0.      , 0.006321, 0.01    ])
    """
    t = _times("creep_compliance", t)
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
        chi, alpha = _springpot("creep_compliance", springpot)
        out = out + t**alpha / (chi * math.gamma(1 + alpha))
    return out


def _times(name: str, t) -> np.ndarray:
    t = np.asarray(t, float)
    if not np.all(t >= 0):
        raise BadValue(f"{name}: t must not be below 0")
    return t


def _positive(name: str, **numbers: float) -> None:
    for what, v in numbers.items():
        if not (math.isfinite(v) and v > 0):
            raise BadValue(f"{name}: {what} = {v} must be above 0")


def _springpot(name: str, v: tuple[float, float]) -> tuple[float, float]:
    chi, alpha = v
    _positive(name, chi=chi)
    if not 0 <= alpha <= 1:
        raise BadValue(f"{name}: alpha = {alpha} must be from 0 (spring) to 1 (dashpot)")
    return float(chi), float(alpha)
