"""Running sums, means and levels."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..core.graph import Block, Map, reach
from ..core.loops import loop
from ..core.units import unit
from ..errors import Above0, BadValue, public
from .events import as_signal
from .filters import delay
from .impedance import Lag, LagParams, LagState, sampled
from .onset import First, begun


@dataclass(frozen=True, eq=False)
class Integrate(Lag):
    """Integral over time, y' = x - leak y, exact for piecewise linear inputs.

    With a leak it is a first-order lag divided by the leak (see ``FirstOrder``).

    Without one it is the trapezoidal rule; for inputs held between samples, y[n] =
    y[n-1] + x[n]/fs.
    """

    x: Block
    leak: float
    held: bool = False
    begins_early = False

    def check(self):
        if not self.leak >= 0 or (self.leak and self.held):
            raise BadValue(
                f"integrate: leak = {self.leak:g} 1/s must be 0 or above, and 0 when samples"
                " are summed"
            )

    def units(self, *u):
        return u[0] * unit("s")

    def design(self, fs):
        e, _, h = sampled(self.leak / fs)
        now, before = (
            (h / self.leak, (e - h) / self.leak)
            if self.leak
            else (1 / fs, 0.0)
            if self.held
            else (0.5 / fs, 0.5 / fs)
        )
        return LagParams(e, now, before), LagState(0.0, 0.0, 0.0)


@public
def integrate(x: Block | float, leak: float = 0.0, onset: str = "step") -> Block:
    """Integrate a signal over time from sample 0 on.

    The integral is exact for signals that are linear between samples.

    The sum is kept in two words, so it is as exact after hours as at the start.

    Parameters
    ----------
    x : Block
    leak : float
        In 1/s: the integral forgets as exp(-leak t), and a constant ends at x/leak.
    onset : {"step", "steady"}
        Whether x was 0 before sample 0, also where no input reaches it, or has always
        been as it is there. Without a leak there is no steady start: the integral of a
        constant never ends.

    Returns
    -------
    Block
        In the unit of x times seconds.

    Raises
    ------
    BadValue
        A leak below 0; a steady start without a leak; an event, which ``count`` adds
        up.

    References
    ----------
    Oppenheim and Schafer, "Discrete-Time Signal Processing" (2010), section 7.2; ramp
    invariance in place of impulse invariance.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import integrate
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"x": integrate(stimlib.Input("v", "m/s"))}), fs=4
    ... )
    >>> proc.process(np.array([[0.0, 1.0, 2.0, 3.0, 4.0]])), proc.units["x"]
    (array([[0.   , 0.125, 0.5  , 1.125, 2.   ]]), 'm')
    """
    x = as_signal("integrate", x, "add them up with count(..)")
    return begun(
        "integrate",
        x,
        onset,
        lambda u: Integrate(u, leak),
        lambda y: 1 / leak if leak else math.inf,
    )


@dataclass(frozen=True, eq=False)
class Active(Map):
    """The force x, which gives so much power on purpose."""

    x: Block
    power: Above0

    def through(self, p, fs, z, H, value):
        return H[0]

    @staticmethod
    def step(p, s, x):
        return x, s


@public
def active(force: Block, power: Above0) -> Block:
    """State that a force gives energy on purpose, as vibrations and motors do.

    ``verify``, ``stimlib.virtual`` and the passivity controller of a device then allow
    it power times the time since sample 0, in addition.

    Parameters
    ----------
    force : Block
        In N, or a torque.
    power : float
        The most that it gives on average, in W: a vibration of F N rms gives a hand
        with a damping of b N s/m no more than F^2/b.

    Returns
    -------
    Block
        The force itself, bit for bit.

    Raises
    ------
    BadValue
        A power not above 0.

    Examples
    --------
    A wall with a hum of 0.1 N, held by a finger of 1 N s/m at least:

    >>> import stimlib
    >>> from stimlib.blocks import active, constant, oscillator, wall
    >>> hum = active(constant(0.1, "N") * oscillator(150.0), power=0.005)
    >>> stimlib.Scene({"force": wall(stimlib.Input("x", "m"), 500.0) + hum})
    Scene(x [m] -> force [N])
    """
    return Active(as_signal("active", force, "turn them into a force first"), power)


def power_of(force: Block) -> float:
    """Return the power in W that parts of a force state to give on purpose."""
    return sum(b.power for b in reach([force]) if isinstance(b, Active))


@public
def energy(force: Block, x: Block) -> Block:
    """Sum the energy that a hand gives to a force along a motion since sample 0.

    W[n] = W[n-1] + F[n-1] (x[n] - x[n-1]), exact for a force that the device holds from
    one sample to the next.  Below 0 the scene has given more than it had got, which a
    passive scene never does; a force that comes late gives more than W says.

    Parameters
    ----------
    force : Block
        In N, as a scene gives it: that the hand exerts.
    x : Block
        In m; or a torque and its angle.

    Returns
    -------
    Block
        In J.

    References
    ----------
    Hannaford and Ryu, "Time-domain passivity control of haptic interfaces", IEEE Trans.
    Robotics and Automation 18 (2002): the passivity observer.

    Examples
    --------
    A spring of 100 N/m that is pressed by 20 mm and released: half a sample late, it
    gives 20 mJ.

    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import energy, spring
    >>> x = stimlib.Input("x", "m")
    >>> scene = stimlib.Scene({"work": energy(spring(x, 100.0), x)})
    >>> proc = stimlib.compile(scene, fs=1000)
    >>> (
    ...     proc.process(np.array([[0.0, 0.01, 0.02, 0.01, 0.0]])).round(6),
    ...     proc.units["work"],
    ... )
    (array([[ 0.  ,  0.  ,  0.01, -0.01, -0.02]]), 'N*m')
    """
    moved = x - First(x)
    step = moved - delay(moved, samples=1)
    power = delay(force, samples=1) * step
    return loop(lambda last: last + power, unit=str(power.dim))
