"""Creep: force in, displacement out, of springs and dampers, and of the springpot.

``viscoelastic`` has the equations of one time constant. All blocks share one convention
of time: a sample of the output is the displacement at that sample, under a force that
is straight between samples. Before the first sample there is no force, so the first
value is reached from 0 within one sample. The chains, and the springpot with
``scheme="l1"``, are exact for that force; ``scheme="gl"`` comes near it as 1/fs.
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.graph import Block, as_block, constant, design_value, in_unit, scratch
from ..core.maths import copy, fma, memory
from ..core.response import backward
from ..core.units import unit
from ..design import fractional as soe
from ..design.padding import padded
from ..errors import BadValue, From0, UnitError, one_of, public
from .fractional import Alpha, coefficient
from .friction import amount
from .impedance import sampled, with_unit
from .integrals import Integrate
from .onset import begun
from .springpots import (
    Springpot,
)
from .viscoelastic import SCRATCH, check_lists, plain, time_constant

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
    begins_early = False

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
    >>> from stimlib.blocks.creep import compliance_maxwell
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
    >>> from stimlib.blocks.creep import compliance_kelvin_voigt
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
    >>> from stimlib.blocks.creep import compliance_generalized_kelvin_voigt
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
    gain = coefficient(amount("compliance", "chi", chi, "", zero=False), "compliance")
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
