"""Velocity, springs and dampers, and the gate of the loading phase."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from ..core import units as un
from ..core.graph import NONE, ONE, Block, Const, as_block, constant, in_unit, unitless
from ..core.maths import TINY, flush, fma, where
from ..core.response import backward
from ..core.units import unit
from ..design import responses
from ..errors import Above0, BadValue, public
from .fir_filters import RATE, fir
from .onset import begun
from .springpots import Springpot


# Velocity and impedances ------------------------------------------------------------
# Velocity, and the impedances that turn motion into force.
def pole_gain(cutoff: float, fs: float) -> float:
    """Return the gain g = 1 - exp(-2 pi cutoff/fs) of the low-pass y += g (x - y)."""
    return -math.expm1(-2 * math.pi * cutoff / fs)


# Parameters of `Velocity` at a sample rate.
VelocityParams = namedtuple("VelocityParams", "g fs")

# State of `Velocity` between samples.
VelocityState = namedtuple("VelocityState", "last a b cold")


@dataclass(frozen=True, eq=False)
class Velocity(Block):
    """Velocity estimated by a difference and a low-pass with two equal poles.

    d = (x[n] - x[n-1]) fs; a += g (d - a); b += g (a - b); g = 1 - exp(-2 pi cutoff /
    fs).
    """

    x: Block
    cutoff: Above0
    contact: Block
    begins_early = False
    resettable = True

    def units(self, *u):
        return u[0] * RATE

    def design(self, fs):
        if self.cutoff >= fs / 2:
            raise BadValue(
                f"velocity: cutoff = {self.cutoff:g} Hz does not fit below fs/2 = {fs / 2:g} Hz"
            )
        return VelocityParams(pole_gain(self.cutoff, fs), fs), VelocityState(0.0, 0.0, 0.0, 1.0)

    def laws(self, fs):
        return responses.slow_velocity(self.cutoff, fs), responses.velocity(self.cutoff)

    @staticmethod
    def step(p, s, x):
        # TINY here also keeps a denormal step from the product
        d = where(s.cold > 0.0, 0.0, ((x - s.last) + TINY) * p.fs)
        a = fma(p.g, d - s.a, s.a)
        b = fma(p.g, a - s.b, s.b)
        return flush(b), VelocityState(x, a, b, 0.0)

    @staticmethod
    def transfer(p, z):
        d = backward(z)
        return p.fs * d * (p.g / (d + p.g / z)) ** 2

    def delay(self, p):
        """Return the group delay at 0 Hz: half a sample, plus that of two poles."""
        return 0.5 + 2 * (1 - p.g) / p.g


@public
def velocity(x: Block, cutoff: float = 100.0, contact: Block | float = 1.0) -> Block:
    """Estimate the rate of change of a signal with a two-pole low-pass.

    The estimate always starts steady: it is 0 at the first sample, as if x had always
    had its first value.

    Parameters
    ----------
    x : Block
    cutoff : float
        Of each pole, in Hz.  Latency 1/(pi cutoff) seconds: 3.2 ms at 100 Hz.
        Positions that are held between reports need a cutoff far below their rate, see
        Notes.
    contact : Block
        Where it is not above 0 the velocity is 0; at re-contact it starts anew, so a
        jump of position makes none.

    Returns
    -------
    Block
        In the unit of x per second.

    Raises
    ------
    BadValue
        cutoff not above 0; at compile time, not below fs/2.

    See Also
    --------
    stimlib.blocks.track_velocity : for reports, with a guard against jumps.

    Notes
    -----
    A position that is held between reports moves in steps, and the estimate ripples at
    the rate of the reports. At a constant speed, with reports at 125 Hz, its largest
    error is 8 % of the speed for 20 Hz, 18 % for 30 Hz and 93 % for 100 Hz; with
    reports that come up to half an interval late, 22, 39 and 130 %. For a given error
    the cutoff is proportional to the rate: 250 Hz and 60 Hz are as 125 Hz and 30 Hz.
    ``track_velocity`` with the same bandwidth has the same error.

    References
    ----------
    The UGrip paper, section 1.1: the compression rate v of eq. (2).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import velocity
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"v": velocity(stimlib.Input("x", "m"))}), fs=8000
    ... )
    >>> proc.process(0.1 * np.arange(8000)[None] / 8000)[0, -1].round(6)
    np.float64(0.1)
    """
    return Velocity(x, cutoff, as_block(contact))


# The coefficients of a first-order system at a sample rate, exact to rounding.
#   e  1 - exp(-a)
#   g  e/a
#   h  1 - e/a
Sampled = namedtuple("Sampled", "e g h")


def sampled(a: float) -> Sampled:
    """Return the coefficients of a first-order system, without cancellation.

    e = 1 - exp(-a), g = e/a and h = 1 - g, for a = 1/(tau fs) >= 0.

    Parameters
    ----------
    a : float
        Sample period over time constant, not below 0.

    Examples
    --------
    >>> from stimlib.blocks.impedance import sampled
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


# Parameters of `Lag` at a sample rate.
#   leak  1 - exp(-T/tau)
LagParams = namedtuple("LagParams", "leak now before")

# State of `Lag` between samples.
#   low  what rounding took from y
LagState = namedtuple("LagState", "y low last")


class Lag(Block, abstract=True):
    """A first-order recursion, y[n] = (1 - leak) y[n-1] + now x[n] + before x[n-1]."""

    @staticmethod
    def step(p, s, x):
        t = fma(-p.leak, s.y, fma(p.now, x, fma(p.before, s.last, TINY))) + s.low
        y = s.y + t
        return flush(y), LagState(y, t - (y - s.y), x)

    @staticmethod
    def transfer(p, z):
        return (p.now + p.before / z) / (backward(z) + p.leak / z)

    def delay(self, p):
        """Return the group delay at 0 Hz; 0 without a leak."""
        return p.before / (p.now + p.before) + (1 - p.leak) / p.leak if p.leak else 0.0


@dataclass(frozen=True, eq=False)
class FirstOrder(Lag):
    """A first-order lag, tau y' + y = x, exact for piecewise linear inputs.

    See ``sampled`` for e and h.

    y[n] = (1 - e) y[n-1] + h x[n] + (e - h) x[n-1].
    """

    x: Block
    tau: Above0

    def design(self, fs):
        e, _, h = sampled(1 / (self.tau * fs))
        return LagParams(e, h, e - h), LagState(0.0, 0.0, 0.0)

    def laws(self, fs):
        return (responses.lag(self.tau),)


@public
def first_order(x: Block, tau: float, onset: str = "step") -> Block:
    """Filter a signal with a first-order lag, 1/(1 + s tau).

    Applied to a velocity and multiplied by b, it is the first-order impedance Z(s) =
    b/(1 + s tau): ``b * first_order(v, tau)``.

    Parameters
    ----------
    x : Block
    tau : float
        Time constant in s.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        tau not above 0; an unknown onset.

    References
    ----------
    The UGrip paper, section 1.1: the impedances Z_c(s), Z_n(s) may be any linear
    dynamics of v.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import first_order
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": first_order(stimlib.Input("x"), tau=0.1)}), fs=1000
    ... )
    >>> y = proc.process(np.arange(2000.0)[None] / 1000)  # a ramp lags by tau
    >>> (1.999 - y[0, -1]).round(9)
    np.float64(0.1)
    """
    return begun("first_order", x, onset, lambda u: FirstOrder(u, tau), lambda y: 1.0)


def with_unit(v, text: str) -> Block:
    """Return a quantity as a signal, giving a plain number the unit.

    A signal must have the unit already; the error here is clearer than a later one
    would be.
    """
    b = as_block(v)
    return constant(b.value, text) if isinstance(b, Const) and b.dim == un.ONE else b


def signal_in(who: str, name: str, v: Block | float, text: str) -> Block:
    """Return a quantity as a signal; raise UnitError if it has another unit."""
    b = as_block(v)
    in_unit(f"{who}: {name}", b, b.dim, text)
    return b


@public
def spring(x: Block, k: Block | float) -> Block:
    """Compute the force of a linear spring, F = k x.

    It is the constitutive impedance Z_c(s) = k/s of the UGrip paper.

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
    x = as_block(x)
    force = with_unit(k, "N/m") * x
    if force.dim != unit("N"):
        raise un.UnitError(
            f"spring: k [{as_block(k).dim}] times {x!r} [{x.dim}] is [{force.dim}], not a force"
        )
    return force


@public
def kelvin_voigt(
    x: Block, k: Block | float, b: Block | float, cutoff: float | None = None
) -> Block:
    """Return the force of a spring and a damper in parallel, F = k x + b v.

    Each sample is the mean force over the last sample period, exact for motion that is
    linear between samples: the response is k + i w b, half a sample late, with k
    reduced by the fraction (w/fs)^2/8 and b by (w/fs)^2/24. At 20 Hz and 1 kHz that is
    0.2 % and 0.07 %. It starts steady, as if x had always been at its first position.

    Parameters
    ----------
    x : Block
        Position in m.
    k : float or Block
        Stiffness in N/m.
    b : float or Block
        Damping in N s/m.
    cutoff : float, optional
        Filter the damper's velocity by two poles of so many Hz, see ``velocity``, and
        take the spring's force at the sample. Its price is a damper that lags: see the
        notes.

    Returns
    -------
    Block
        Force in N.

    Raises
    ------
    UnitError
        If the terms are not forces.
    BadValue
        A cutoff not above 0; at compile time, not below fs/2.

    Notes
    -----
    A position in steps q, as encoders give it, becomes a force in steps b q fs for one
    sample: with b = 2 N s/m and 1 um that is 2 mN at 1 kHz, 16 mN at 8 kHz, and 20 mN
    for 10 um at 1 kHz.  Where it is felt or heard, give a cutoff: one of c Hz leaves
    steps of about b q 2.3 c, 0.5 mN of the 2 mN for 100 Hz at 1 kHz.  Such a damper
    lags by 1/(pi c) seconds, and so adds b w^2/(pi c) to the stiffness: with 100 Hz at
    8 kHz, of an element whose two parts are equal, 10 % at 5 Hz and 36 % at 20 Hz.  For
    reports that come slower than samples, use ``track`` before.

    A device that gets this force needs a damping of its own of b, or k/fs - b where
    that is more, to stay passive: see ``stimlib.analysis.passivity.needed_damping``.  A
    cutoff lowers it.

    References
    ----------
    Çaldıran's thesis: Kelvin-Voigt element, k_C = k + i w b.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import kelvin_voigt
    >>> scene = stimlib.Scene({"F": kelvin_voigt(stimlib.Input("x", "m"), 500.0, 2.0)})
    >>> stimlib.compile(scene, fs=1000).process(
    ...     np.array([[0.01, 0.01, 0.0101, 0.0102]])
    ... ).round(3)
    array([[5.   , 5.   , 5.225, 5.275]])
    """
    x, b = as_block(x), with_unit(b, "N*s/m")
    if cutoff is not None:
        return spring(x, k) + b * velocity(x, cutoff)
    # of order 1: a dashpot of 1 N s/m
    damper = Springpot(x, as_block(1.0), 1.0, "l1", 1e-10, 86400.0, "steady")
    return spring(fir(x, [0.5, 0.5], onset="steady"), k) + b / constant(1.0, "N*s/m") * damper


def step_peak(cutoff: float, fs: float) -> float:
    """Return the peak of the velocity estimate for a unit step in position, in 1/s.

    It is the maximum over n of fs g^2 (n+1) (1-g)^n.
    """
    g = pole_gain(cutoff, fs)
    if g < 1e-9:
        return fs * g / math.e
    n = np.arange(4096) + max(0, int(1 / g) - 2048)  # it is at (n+1) g = 1, nearly
    return float(fs * g * g * np.max((n + 1) * (1 - g) ** n))


# Gates with two thresholds ----------------------------------------------------------
# Gates with two thresholds.
# Parameters of `Gate` at a sample rate.
GateParams = namedtuple("GateParams", "on off")

# State of `Gate` between samples.
GateState = namedtuple("GateState", "g")


class Gate(Block, abstract=True):
    """A gate: 1 from where x rises above ``on`` until it falls to ``off``, else 0."""

    rests = True
    units = unitless

    @staticmethod
    def tile(p, s, x, y):
        # a state may come from anywhere
        g, above = where(s.g > 0.0, 1.0, 0.0), NONE
        edge = where(g > 0.0, p.off, p.on)
        for i in range(y.size):
            above = above + where(x[i] > edge, ONE, NONE)
        if above == where(g > 0.0, np.uint64(y.size), NONE):  # nothing changes
            y[:] = g
            return GateState(g)
        for i in range(y.size):
            g = where(x[i] > where(g > 0.0, p.off, p.on), 1.0, 0.0)
            y[i] = g
        return GateState(g)


@dataclass(frozen=True, eq=False)
class Hysteresis(Gate):
    """A gate with two given thresholds."""

    x: Block
    on: float
    off: float

    def check(self):
        if not self.off <= self.on:
            raise BadValue(f"hysteresis: off = {self.off:g} must not be above on = {self.on:g}")

    def design(self, fs):
        return GateParams(self.on, self.off), GateState(0.0)


@public
def hysteresis(x: Block | float, on: float, off: float) -> Block:
    """Open a gate above one threshold and close it at another (a Schmitt trigger).

    With two thresholds, noise does not make it chatter.

    Parameters
    ----------
    x : Block
    on, off : float
        In the unit of x: open from where x rises above ``on`` until it falls to ``off``
        or below.

    Returns
    -------
    Block
        0 or 1, without unit; closed at first.

    Raises
    ------
    BadValue
        off above on.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import hysteresis
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"g": hysteresis(stimlib.Input("x"), on=1.0, off=-1.0)}),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[0.0, 2.0, 0.5, -0.5, -1.0, 0.5]]))
    array([[0., 1., 1., 1., 0., 0.]])
    """
    return Hysteresis(as_block(x), on, off)


@dataclass(frozen=True, eq=False)
class Loading(Gate):
    """A gate that is open during loading, judged by velocity."""

    v: Block
    on: float | None
    off: float | None
    resolution: Above0

    def check(self):
        if (self.on is None) != (self.off is None):
            raise BadValue("loading: give both thresholds, on and off, or none")
        if self.on is not None and self.off is not None and not 0 < self.off < self.on:
            raise BadValue(
                f"loading: thresholds must be 0 < off < on, got off = {self.off}, on = {self.on}"
            )
        if self.on is None and not isinstance(self.v, Velocity):
            raise BadValue(
                f"loading: thresholds follow from the filter of velocity(x, cutoff); for {self.v!r}"
                " give on and off"
            )

    def design(self, fs):
        on, off = self.on, self.off
        if on is None or off is None:
            assert isinstance(self.v, Velocity)
            off = 2 * self.resolution * step_peak(self.v.cutoff, fs)
            on = 2 * off
        return GateParams(on, off), GateState(0.0)


@public
def loading(
    v: Block, on: float | None = None, off: float | None = None, resolution: float = 1e-6
) -> Block:
    """Return 1 during loading (compression increasing), else 0.

    The velocity is compared with two thresholds.

    Parameters
    ----------
    v : Block
        Velocity, positive in the direction of compression.
    on, off : float, optional
        The gate opens above ``on`` and closes at ``off``, in the unit of v.  Default:
        from the encoder's resolution q and the impulse response h of ``velocity``: off
        = 2 q max|h|, on = 2 off, so that a held position that toggles between
        neighbouring codes stays silent.
    resolution : float
        Encoder step q in the unit of position; used only for the default.

    Returns
    -------
    Block
        0 or 1, without unit.

    Raises
    ------
    BadValue
        Not 0 < off < on; default thresholds for something that is not ``velocity(..)``.

    References
    ----------
    The UGrip paper, eq. (2): "nonzero only during loading"; section 2.1: encoder
    resolution 1 um.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import loading
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"g": loading(stimlib.Input("v", "m/s"), on=0.2, off=0.1)}),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[0.15, 0.25, 0.15, 0.05]]))
    array([[0., 1., 1., 0.]])
    """
    return Loading(v, on, off, resolution)
