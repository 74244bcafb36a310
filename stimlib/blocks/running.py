"""Running sums, means and levels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.graph import Block, as_block
from ..core.maths import TINY, flush, fma, where
from ..core.units import unit
from ..design import responses
from ..errors import BadValue, public
from ..system.limits import limits
from .events import as_signal
from .fir import Fir, line
from .impedance import Lag, LagParams, LagState, sampled
from .onset import begun


@dataclass(frozen=True, eq=False)
class Integrate(Lag):
    """y' = x - leak y, exact for inputs that are straight between samples: a lag over
    its leak (see ``FirstOrder``).

    Without a leak it is the trapezoidal rule; held until the next sample, y[n] = y[n-1]
    + x[n]/fs.
    """

    x: Block
    leak: float
    held: bool = False
    begins_early = False

    def check(self):
        if not self.leak >= 0 or (self.leak and self.held):
            raise BadValue(
                f"integrate: leak = {self.leak:g} 1/s must be 0 or above, and 0 for a sum of"
                " samples"
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

    def laws(self, fs):
        return (responses.running_sum() if self.held else responses.integral(self.leak),)


@public
def integrate(x: Block | float, leak: float = 0.0, onset: str = "step") -> Block:
    """Integrate over time, exactly for a signal that is straight between its samples,
    from sample 0 on.

    The sum has a second word, so after hours it is as exact as at first.

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
class MovingAverage(Fir):
    """Equal taps."""

    x: Block
    seconds: float

    def design(self, fs):
        limits.check(
            "state_bytes",
            64 * self.seconds * fs,
            f"moving_average: bytes of its samples at fs = {fs:g} Hz",
        )
        n = round(self.seconds * fs)
        if n < 1:
            raise BadValue(
                f"moving_average: {self.seconds:g} s is less than half a sample at fs = {fs:g} Hz"
            )
        return line(np.full(n, 1 / n))

    def laws(self, fs):
        return (responses.mean_of(round(self.seconds * fs)),)


@public
def moving_average(x: Block | float, seconds: float, onset: str = "step") -> Block:
    """Average over the last seconds, rounded to whole samples.

    It is a FIR filter with equal taps: nothing adds up over time, and its cost grows
    with the number of samples (30 ns for 800). ``integrate`` with a leak or ``lowpass``
    cost the same for any time.

    Parameters
    ----------
    x : Block
    seconds : float
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Returns
    -------
    Block
        In the unit of x, half the time later.

    Raises
    ------
    BadValue
        An unknown onset; at compile time, less than half a sample.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import moving_average
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": moving_average(stimlib.Input("x"), 0.004)}), fs=1000
    ... )
    >>> proc.process(np.array([[4.0, 4.0, 4.0, 4.0, 4.0, 0.0]]))
    array([[1., 2., 3., 4., 4., 3.]])
    """
    return begun("moving_average", x, onset, lambda u: MovingAverage(u, seconds), lambda y: 1.0)


class FollowerParams(NamedTuple):
    up: float
    down: float


class FollowerState(NamedTuple):
    y: float


@dataclass(frozen=True, eq=False)
class Follower(Block):
    """y += g (|x| - y), g = 1 - exp(-1/(T fs)) with T the attack where |x| is above y,
    else the release.
    """

    x: Block
    attack: float
    release: float

    def check(self):
        for name in ("attack", "release"):
            if not getattr(self, name) >= 0:
                raise BadValue(
                    f"envelope_follower: {name} = {getattr(self, name):g} s must be 0 or above"
                )

    def design(self, fs):
        up, down = (
            -math.expm1(-1 / (t * fs)) if t * fs > 1e-3 else 1.0
            for t in (self.attack, self.release)
        )
        return FollowerParams(up, down), FollowerState(0.0)

    @staticmethod
    def step(p, s, x):
        d = abs(x) - s.y
        y = s.y + fma(where(d > 0.0, p.up, p.down), d, TINY)
        return flush(y), FollowerState(y)


@public
def envelope_follower(x: Block | float, attack: float = 0.001, release: float = 0.05) -> Block:
    """Level of a vibration: it rises to \\|x\\| with one time constant and falls with
    another.

    Parameters
    ----------
    x : Block
    attack, release : float
        Time constants in s; 0 is at once.

    Returns
    -------
    Block
        In the unit of x, 0 or above; starts at 0.

    Raises
    ------
    BadValue
        A time below 0.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import envelope_follower
    >>> proc = stimlib.compile(
    ...     stimlib.Scene(
    ...         {"y": envelope_follower(stimlib.Input("x"), attack=0, release=0.01)}
    ...     ),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[0.0, -2.0, 0.0, 1.0]])).round(3)
    array([[0.   , 2.   , 1.81 , 1.733]])
    """
    return Follower(as_block(x), attack, release)
