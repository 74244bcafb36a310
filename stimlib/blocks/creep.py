"""Creep of a springpot: force in, displacement out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ..core.graph import Block, as_block, constant
from ..core.response import backward
from ..core.units import unit
from ..design import responses
from ..errors import UnitError
from .fractional import Springpot
from .springpot import coefficient


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
