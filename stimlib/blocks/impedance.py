"""Velocity, and the impedances that turn motion into force."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import units as un
from ..core.graph import Block, Const, as_block, constant, positive
from ..core.maths import TINY, flush, fma, where
from ..core.response import backward
from ..core.units import unit
from ..design import responses
from ..errors import BadValue
from .fir import RATE


def pole_gain(cutoff: float, fs: float) -> float:
    """g = 1 - exp(-2 pi cutoff / fs) of the one-pole low-pass y += g (x - y)."""
    return -math.expm1(-2 * math.pi * cutoff / fs)


class VelocityParams(NamedTuple):
    g: float
    fs: float


class VelocityState(NamedTuple):
    last: float
    a: float
    b: float
    cold: float


@dataclass(frozen=True, eq=False)
class Velocity(Block):
    """d = (x[n] - x[n-1]) fs;  a += g (d - a);  b += g (a - b);  g = 1 - exp(-2 pi cutoff / fs)."""

    x: Block
    cutoff: float
    contact: Block
    resettable = True

    def check(self):
        positive(self, "cutoff")

    def units(self, *u):
        return u[0] * RATE

    def design(self, fs):
        if self.cutoff >= fs / 2:
            raise BadValue(f"velocity: cutoff = {self.cutoff:g} Hz does not fit below fs/2 = {fs / 2:g} Hz")
        return VelocityParams(pole_gain(self.cutoff, fs), fs), VelocityState(0.0, 0.0, 0.0, 1.0)

    def laws(self, fs):
        return responses.slow_velocity(self.cutoff, fs), responses.velocity(self.cutoff)

    @staticmethod
    def step(p, s, x):
        d = where(s.cold > 0.0, 0.0, ((x - s.last) + TINY) * p.fs)  # TINY here also keeps a denormal step from the product
        a = fma(p.g, d - s.a, s.a)
        b = fma(p.g, a - s.b, s.b)
        return flush(b), VelocityState(x, a, b, 0.0)

    @staticmethod
    def transfer(p, z):
        d = backward(z)
        return p.fs * d * (p.g / (d + p.g / z)) ** 2

    def delay(self, p):
        """Group delay at 0 Hz: half a sample of the difference, and two poles."""
        return 0.5 + 2 * (1 - p.g) / p.g


def velocity(x: Block, cutoff: float = 100.0, contact: Block | float = 1.0) -> Block:
    """Rate of change through two poles; at rest on the first sample, whatever its value.

    Parameters
    ----------
    x : Block
    cutoff : float
        Of each pole, in Hz.  Latency 1/(pi cutoff) seconds: 3.2 ms at 100 Hz.
    contact : Block
        Where it is not above 0 the velocity is 0; at re-contact it starts anew, so a jump of position makes none.

    Returns
    -------
    Block
        In the unit of x per second.

    Raises
    ------
    BadValue
        cutoff not above 0; at compile time, not below fs/2.

    References
    ----------
    The UGrip paper, section 1.1: the compression rate v of eq. (2).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import velocity
    >>> proc = stimlib.compile(stimlib.Scene({"v": velocity(stimlib.Input("x", "m"))}), fs=8000)
    >>> proc.process(0.1 * np.arange(8000)[None] / 8000)[0, -1].round(6)
    np.float64(0.1)
    """
    return Velocity(x, cutoff, as_block(contact))


class FirstOrderParams(NamedTuple):
    e: float
    now: float
    before: float


class FirstOrderState(NamedTuple):
    y: float
    last: float


@dataclass(frozen=True, eq=False)
class FirstOrder(Block):
    """tau y' + y = x, exact for inputs that are straight between samples, T = 1/fs:

    y[n] = e y[n-1] + (1 - m) x[n] + (m - e) x[n-1],  e = exp(-T/tau),  m = (1 - e) tau/T.
    """

    x: Block
    tau: float

    def check(self):
        positive(self, "tau")

    def design(self, fs):
        a = 1 / (self.tau * fs)
        e = math.exp(-a)
        # 1 - m and m - e by series where they would cancel
        now = a / 2 - a * a / 6 + a**3 / 24 - a**4 / 120 + a**5 / 720 if a < 1e-2 else 1 + math.expm1(-a) / a
        return FirstOrderParams(e, now, -math.expm1(-a) - now), FirstOrderState(0.0, 0.0)

    def laws(self, fs):
        return responses.lag(self.tau), responses.ramp_invariant(self.tau)

    @staticmethod
    def step(p, s, x):
        y = fma(p.e, s.y, fma(p.now, x, p.before * s.last) + TINY)
        return flush(y), FirstOrderState(y, x)

    @staticmethod
    def transfer(p, z):
        return (p.now + p.before / z) / ((1 - p.e) + p.e * backward(z))

    def delay(self, p):
        """Group delay at 0 Hz."""
        return (p.e + p.before) / (1 - p.e)


def first_order(x: Block, tau: float) -> Block:
    """First-order lag 1/(1 + s tau); starts at rest at 0.

    With a gain it is the first-order impedance Z(s) = b/(1 + s tau) of a velocity: ``b * first_order(v, tau)``.

    Parameters
    ----------
    x : Block
    tau : float
        Time constant in s.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        tau not above 0.

    References
    ----------
    The UGrip paper, section 1.1: the impedances Z_c(s), Z_n(s) may be any linear dynamics of v.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import first_order
    >>> proc = stimlib.compile(stimlib.Scene({"y": first_order(stimlib.Input("x"), tau=0.1)}), fs=1000)
    >>> y = proc.process(np.arange(2000.0)[None] / 1000)  # a ramp lags by tau
    >>> (1.999 - y[0, -1]).round(9)
    np.float64(0.1)
    """
    return FirstOrder(x, tau)


def with_unit(v, text: str) -> Block:
    """A number gets the unit; a signal must have it (in the sum it would fail with a less helpful word)."""
    b = as_block(v)
    return constant(b.value, text) if isinstance(b, Const) and b.dim == un.ONE else b


def spring(x: Block, k) -> Block:
    """Linear spring, F = k x: the constitutive impedance Z_c(s) = k/s of the UGrip paper.

    Parameters
    ----------
    x : Block
        Position in m.
    k : float or Block
        Stiffness in N/m; live when it is a ``Param``.

    Returns
    -------
    Block
        Force in N.

    Raises
    ------
    UnitError
        If k x is not a force.

    References
    ----------
    The UGrip paper, section 2.1.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import spring
    >>> str(spring(Input("x", "m"), 2000.0).dim)
    'N'
    """
    force = with_unit(k, "N/m") * x
    if force.dim != unit("N"):
        raise un.UnitError(f"spring: k [{as_block(k).dim}] times {x!r} [{x.dim}] is [{force.dim}], not a force")
    return force


def kelvin_voigt(x: Block, k, b, cutoff: float = 100.0) -> Block:
    """Spring and damper side by side, F = k x + b v, v the filtered velocity.

    Parameters
    ----------
    x : Block
        Position in m.
    k : float or Block
        Stiffness in N/m.
    b : float or Block
        Damping in N s/m.
    cutoff : float
        Of the velocity, in Hz.

    Returns
    -------
    Block
        Force in N.

    Raises
    ------
    UnitError
        If the terms are not forces.

    References
    ----------
    Çaldıran's thesis: Kelvin-Voigt element, k_C = k + i w b.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import kelvin_voigt
    >>> str(kelvin_voigt(Input("x", "m"), 500.0, 2.0).dim)
    'N'
    """
    return spring(x, k) + with_unit(b, "N*s/m") * velocity(x, cutoff)


def step_peak(cutoff: float, fs: float) -> float:
    """Largest velocity that a step of 1 in position makes: max of fs g^2 (n+1) (1-g)^n, in 1/s."""
    g = pole_gain(cutoff, fs)
    if g < 1e-9:
        return fs * g / math.e
    n = np.arange(4096) + max(0, int(1 / g) - 2048)  # it is at (n+1) g = 1, nearly
    return float(fs * g * g * np.max((n + 1) * (1 - g) ** n))
