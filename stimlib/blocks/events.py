"""Events and functions of time: clocks, integrals, envelopes."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..core import units as un
from ..core.graph import (
    NONE,
    ONE,
    Abs,
    Block,
    Compare,
    Const,
    Div,
    Mul,
    Neg,
    as_block,
    same_unit,
    unitless,
)
from ..core.maths import TINY, as_float, floor, flush, fma, search, where
from ..core.parameter import Param
from ..core.program import lead
from ..core.units import unit
from ..design import responses
from ..errors import Above0, BadValue, From0, one_of, public
from ..system.limits import limits
from .filters import begun
from .impedance import Gate, Lag, LagParams, LagState, sampled, with_unit
from .movement import sinpi

# Events -----------------------------------------------------------------------------
# Events: signals that are 0 except at the sample where something happens; the height is
# its strength.
U = np.uint64


class Event(Block, abstract=True):
    """Base class of events: signals that are nonzero only when something happens."""


def is_event(b: Block) -> bool:
    """Return whether a signal is known to be an event.

    Events come from blocks that make them, or from scaling an event.
    """
    todo, seen = [b], {id(b)}
    while todo:
        b = todo.pop()
        if isinstance(b, Event):
            return True
        if isinstance(b, (Mul, Neg, Abs, Div)):
            some = b.children[:1] if isinstance(b, Div) else b.children
            todo += [c for c in some if id(c) not in seen]
            seen |= {id(c) for c in some}
    return False


def as_event(name: str, v) -> Block:
    """Return a signal to use as an event; raise BadValue if it is a lasting signal."""
    b = as_block(v)
    if isinstance(b, (Const, Param, Compare, Gate, Count, SampleAndHold)):
        raise BadValue(
            f"{name}: {b!r} is a lasting signal, not an event; use rising(..) of it, or every(..),"
            " at(..) or"
            " crossing(..)"
        )
    return b


def as_signal(name: str, v, remedy: str) -> Block:
    """Return an ordinary signal; raise BadValue with a remedy if it is an event."""
    b = as_block(v)
    if is_event(b):
        raise BadValue(f"{name}: {b!r} is an event, which lasts one sample; {remedy}")
    return b


def in_unit_of(x: Block, v) -> Block:
    """Return v as a signal; a plain number gets the unit of x."""
    return as_block(v) if x.dim == un.ONE else with_unit(v, str(x.dim))


def happens(event):
    """Return the number of samples at which an event occurs.

    If there are none, a tile may leave its state unchanged.
    """
    n = NONE
    for i in range(event.size):
        n = n + where(event[i] == 0.0, NONE, ONE)
    return n


# Where they come from -----------------------------------------------------------------
# Parameters of `Edge` at a sample rate.
#   sign  1: rising, -1: falling
EdgeParams = namedtuple("EdgeParams", "sign")

# State of `Edge` between samples.
EdgeState = namedtuple("EdgeState", "above cold")


def edge(p, s, x, threshold):
    """Return the event at one sample, and the new state."""
    d = x - threshold
    above = where(d == d, where(d > 0.0, 1.0, 0.0), s.above)
    passed = where(s.cold > 0.0, 0.0, p.sign * (above - s.above))
    return where(passed > 0.0, 1.0, 0.0), EdgeState(above, where(d == d, 0.0, s.cold))


@dataclass(frozen=True, eq=False)
class Edge(Event):
    """An event of height 1 where x crosses a threshold in one direction."""

    x: Block
    threshold: Block
    up: bool

    def units(self, *u):
        same_unit("compare", self.x, self.threshold, *u)
        return un.ONE

    def design(self, fs):
        return EdgeParams(1.0 if self.up else -1.0), EdgeState(0.0, 1.0)

    @staticmethod
    def step(p, s, x, threshold):
        return edge(p, s, x, threshold)

    @staticmethod
    def tile(p, s, x, threshold, y):
        stays = NONE
        for i in range(y.size):
            stays = stays + where(where(x[i] - threshold[i] > 0.0, 1.0, 0.0) == s.above, ONE, NONE)
        if stays == U(y.size) and s.cold == 0.0:
            y[:] = 0.0
            return s
        for i in range(y.size):
            y[i], s = edge(p, s, x[i], threshold[i])
        return s


@public
def rising(x: Block | float, threshold: Block | float = 0.0) -> Block:
    """Make an event where a signal rises above a threshold.

    Parameters
    ----------
    x : Block
        A gate, a comparison or any signal; noise near the threshold makes many events:
        see ``hysteresis`` and ``once_within``.
    threshold : float or Block
        In the unit of x.

    Returns
    -------
    Block
        1 at each sample where x is above and was not, else 0; not at the first sample.

    Raises
    ------
    BadValue
        An event in place of a signal.
    UnitError
        A threshold in another unit.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import falling, rising
    >>> x = stimlib.Input("x")
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"up": rising(x, 0.5), "down": falling(x, 0.5)}), fs=1000
    ... )
    >>> proc.process(np.array([[0.0, 1.0, 1.0, 0.5, 0.7]]))
    array([[0., 1., 0., 0., 1.],
           [0., 0., 0., 1., 0.]])
    """
    x = as_signal("rising", x, "use it as it is")
    return Edge(x, in_unit_of(x, threshold), True)


@public
def falling(x: Block | float, threshold: Block | float = 0.0) -> Block:
    """Make an event where a signal falls to a threshold or below; see ``rising``.

    Parameters
    ----------
    x : Block
    threshold : float or Block
        In the unit of x.

    Returns
    -------
    Block
        1 at each sample where x is not above and was, else 0.

    Examples
    --------
    >>> from stimlib import Input
    >>> from stimlib.blocks import falling
    >>> falling(Input("contact"), 0.5)
    Edge(Input('contact'), Const(0.5), up=False)
    """
    x = as_signal("falling", x, "use it as it is")
    return Edge(x, in_unit_of(x, threshold), False)


# Parameters of `Crossing` at a sample rate.
#   half  half the hysteresis, in spacings
CrossingParams = namedtuple("CrossingParams", "spacing half split")

# State of `Crossing` between samples.
#   last  x/spacing
CrossingState = namedtuple("CrossingState", "cell last carry cold")


NEAR_LINE = 1e-12
"""Positions closer to a line, in parts of the largest number there, are divided by the
spacing to see whether they cross.
"""


def crossed(p, s, x):
    """Return the number of lines crossed in one sample, and the new state."""
    u = x / p.spacing
    good = where(u - u == 0.0, 1.0, 0.0)
    low, high = floor(u - p.half), floor(u + p.half)
    held = where(s.cell < low, low, where(s.cell > high, high, s.cell))
    cell = where(good > 0.0, where(s.cold > 0.0, floor(u), held), s.cell)
    n = where(s.cold > 0.0, 0.0, cell - s.cell)
    # the lines passed lie, in the mean, at the middle of both cells; which part of the
    # sample was gone there
    line = 0.5 * (s.cell + cell + 1.0) + where(n > 0.0, p.half, -p.half)
    part = (line - s.last) / where(u == s.last, 1.0, u - s.last)
    later = p.split * n * where(part > 0.0, where(part < 1.0, part, 1.0), 0.0)
    after = CrossingState(cell, where(good > 0.0, u, s.last), later, where(good > 0.0, 0.0, s.cold))
    return s.carry + (n - later), after


@dataclass(frozen=True, eq=False)
class Crossing(Event):
    """An event at each crossing of equally spaced lines, with hysteresis.

    The cell between two lines is limited to floor(u - h/2) .. floor(u + h/2), where u =
    x/spacing. This is a play (backlash) between position and cell.

    The height of the event is the number of cells moved.
    """

    x: Block
    spacing: Above0
    hysteresis: From0
    split: bool
    live = "crossing(x/spacing, 1.0) has a spacing that moves"

    units = unitless

    def design(self, fs):
        p = CrossingParams(self.spacing, 0.5 * self.hysteresis / self.spacing, float(self.split))
        return p, CrossingState(0.0, 0.0, 0.0, 1.0)

    def delay(self, p):
        return p.split

    @staticmethod
    def step(p, s, x):
        return crossed(p, s, x)

    @staticmethod
    def tile(p, s, x, y):
        # without a division: so far from both lines that its rounding cannot matter
        far = NEAR_LINE * (abs(s.cell) + p.half + 2.0)
        low, high = p.spacing * (s.cell - p.half + far), p.spacing * (s.cell + 1.0 + p.half - far)
        stays = NONE
        for i in range(y.size):
            stays = stays + where(x[i] > low, where(x[i] < high, ONE, NONE), NONE)
        if stays < U(y.size):  # a position that rests is divided once
            same = NONE
            for i in range(y.size):
                same = same + where(x[i] == x[0], ONE, NONE)
            stays = where(same == U(y.size), U(y.size) - ONE, NONE)
            for i in range(np.int64(stays), y.size):
                u = x[i] / p.spacing
                stays = stays + where(
                    floor(u - p.half) <= s.cell, where(floor(u + p.half) >= s.cell, ONE, NONE), NONE
                )
        if stays == U(y.size) and s.carry == 0.0 and s.cold == 0.0:
            y[:] = 0.0
            return CrossingState(s.cell, x[y.size - 1] / p.spacing, 0.0, 0.0)
        for i in range(y.size):
            y[i], s = crossed(p, s, x[i])
        return s


@public
def crossing(
    x: Block | float, spacing: float, hysteresis: float = 0.0, split: bool = False
) -> Block:
    """Make an event whenever a position crosses one of a set of equally spaced lines.

    The lines are at the multiples of a spacing.

    Parameters
    ----------
    x : Block
    spacing : float
        Distance of the lines, in the unit of x.
    hysteresis : float
        How far x must come back over a line to pass it again, in the unit of x: twice
        the step of an encoder, and a position that toggles between two codes passes a
        line once.
    split : bool
        Share each event between two samples, so that their mean is the time of the
        passage, one sample later.  A texture of rings then has 26 dB less noise between
        its lines; what counts, holds or restarts wants whole events.

    Returns
    -------
    Block
        The number of lines passed in this sample, negative on the way back; 0 at the
        first.

    Raises
    ------
    BadValue
        A spacing not above 0; a hysteresis below 0; an event in place of a signal.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import crossing
    >>> proc = stimlib.compile(
    ...     stimlib.Scene(
    ...         {"y": crossing(stimlib.Input("x", "m"), 0.005, hysteresis=1e-4)}
    ...     ),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[0.0, 0.004, 0.0051, 0.00499, 0.0121, 0.0049]])) + 0.0
    array([[ 0.,  0.,  1.,  0.,  1., -2.]])
    """
    return Crossing(as_signal("crossing", x, "give a position"), spacing, hysteresis, split)


# What is done with them ---------------------------------------------------------------
# State of blocks that keep their last output.
Total = namedtuple("Total", "y")


@dataclass(frozen=True, eq=False)
class Count(Block):
    """The running sum of all event heights."""

    event: Block

    def design(self, fs):
        return (), Total(0.0)

    @staticmethod
    def step(p, s, event):
        y = s.y + event
        return y, Total(y)


@public
def count(event: Block | float) -> Block:
    """Return the running sum of the heights of all events.

    Parameters
    ----------
    event : Block

    Returns
    -------
    Block
        In the unit of event, this sample's included.

    Raises
    ------
    BadValue
        What is known to be no event.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import count, rising
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": count(rising(stimlib.Input("x")))}), fs=1000
    ... )
    >>> proc.process(np.array([[0.0, 1.0, 0.0, 1.0, 1.0]]))
    array([[0., 1., 1., 2., 2.]])
    """
    return Count(as_event("count", event))


@dataclass(frozen=True, eq=False)
class SampleAndHold(Block):
    """The value of x at the last event; 0 before the first event."""

    x: Block
    event: Block

    def design(self, fs):
        return (), Total(0.0)

    @staticmethod
    def step(p, s, x, event):
        y = where(event == 0.0, s.y, x)
        return y, Total(y)


@public
def sample_and_hold(x: Block | float, event: Block | float) -> Block:
    """Hold the value that a signal had at the last event.

    Parameters
    ----------
    x : Block
    event : Block
        Of any height but 0.

    Returns
    -------
    Block
        In the unit of x; 0 before the first event.

    Raises
    ------
    BadValue
        What is known to be no event.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import rising, sample_and_hold
    >>> x, button = stimlib.Input("x"), stimlib.Input("button")
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": sample_and_hold(x, rising(button))}), fs=1000
    ... )
    >>> proc.process(np.array([[1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 0.0, 1.0]]))
    array([[0., 2., 2., 4.]])
    """
    return SampleAndHold(as_block(x), as_event("sample_and_hold", event))


# The number of samples that must pass between two events.
Wait = namedtuple("Wait", "samples")

# The number of samples until the next event may pass.
#   left  samples in which nothing passes
Left = namedtuple("Left", "left")


def passed(p, s, event):
    """Return the event if it may pass at this sample, else 0, and the new state."""
    goes = where(event == 0.0, 0.0, where(s.left == NONE, 1.0, 0.0))
    left = where(goes > 0.0, U(p.samples), s.left)
    return where(goes > 0.0, event, 0.0), Left(where(left > NONE, left - ONE, NONE))


@dataclass(frozen=True, eq=False)
class OnceWithin(Event):
    """Events with a refractory period: after one passes, n - 1 samples are blocked.

    Blocked events are lost, and do not prolong the period.
    """

    event: Block
    refractory: Above0

    def design(self, fs):
        return Wait(float(max(1, round(min(self.refractory * fs, 2.0**62))))), Left(NONE)

    @staticmethod
    def step(p, s, event):
        return passed(p, s, event)

    @staticmethod
    def tile(p, s, event, y):
        n = U(y.size)
        if happens(event) == NONE:
            y[:] = 0.0
            return Left(where(s.left > n, s.left - n, NONE))
        for i in range(y.size):
            y[i], s = passed(p, s, event[i])
        return s


@public
def once_within(event: Block | float, refractory: float) -> Block:
    """Pass an event, then block further events for a refractory period.

    Parameters
    ----------
    event : Block
    refractory : float
        In s.

    Returns
    -------
    Block
        In the unit of event.

    Raises
    ------
    BadValue
        A time not above 0; what is known to be no event.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import once_within
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": once_within(stimlib.Input("event"), 0.003)}), fs=1000
    ... )
    >>> proc.process(np.array([[1.0, 2.0, 0.0, 3.0, 4.0]]))
    array([[1., 0., 0., 3., 0.]])
    """
    return OnceWithin(as_event("once_within", event), refractory)


# Integrals --------------------------------------------------------------------------
# Running sums, means and levels.
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

    def laws(self, fs):
        return (responses.running_sum() if self.held else responses.integral(self.leak),)


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


# The clock --------------------------------------------------------------------------
# What depends on the time alone: nothing adds up, so it is as exact after a day as at
# first.
LONG = 2.0**60
"""A sample that no run reaches."""


# Parameters of `Time` at a sample rate.
TimeParams = namedtuple("TimeParams", "fs")

# State of `Time` between samples.
TimeState = namedtuple("TimeState", "n")


@dataclass(frozen=True, eq=False)
class Time(Block):
    """Time n/fs at sample n of the block's clock, rounded once."""

    def units(self, *u):
        return unit("s")

    def design(self, fs):
        return TimeParams(fs), TimeState(-float(lead(fs)))  # so long before sample 0 it begins

    @staticmethod
    def step(p, s):
        return s.n / p.fs, TimeState(s.n + 1.0)


@public
def elapsed() -> Block:
    """Return the time since sample 0.

    Inside ``enabled`` it is the time for which the block has run.

    Returns
    -------
    Block
        In s: the sample's index over fs, rounded once.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import elapsed
    >>> stimlib.compile(stimlib.Scene({"t": elapsed()}), fs=8).process(np.empty((0, 4)))
    array([[0.   , 0.125, 0.25 , 0.375]])
    """
    return Time()


# Parameters of `Every` at a sample rate.
#   period  samples
EveryParams = namedtuple("EveryParams", "fs period")


@dataclass(frozen=True, eq=False)
class Every(Event):
    """A periodic event: 1 at the samples floor(k P + 1/2), k = 0, 1, .."""

    t: Block
    period: Above0
    live = "pulse_train(rate) has a rate that moves"

    units = unitless

    def design(self, fs):
        if self.period * fs < 1:
            raise BadValue(
                f"every: period = {self.period:g} s is less than a sample at fs = {fs:g} Hz"
            )
        return EveryParams(fs, self.period * fs), ()

    @staticmethod
    def step(p, s, t):
        n = floor(t * p.fs + 0.5)
        k = floor(n / p.period + 0.5)
        return where(floor(k * p.period + 0.5) == n, where(n >= 0.0, 1.0, 0.0), 0.0), s


@public
def every(period: float) -> Block:
    """Make a periodic event that starts at sample 0.

    Each event occurs at the sample nearest to its exact time.

    Parameters
    ----------
    period : float
        In s.  ``pulse_train`` has a rate that moves.

    Returns
    -------
    Block
        1 at each, else 0.

    Raises
    ------
    BadValue
        A period not above 0; at compile time, one of less than a sample.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import every
    >>> stimlib.compile(stimlib.Scene({"y": every(0.0025)}), fs=1000).process(
    ...     np.empty((0, 9))
    ... )
    array([[1., 0., 0., 1., 0., 1., 0., 0., 1.]])
    """
    return Every(Time(), period)


# Parameters of `At` at a sample rate.
#   samples  rising, ended by one that is never reached
AtParams = namedtuple("AtParams", "fs samples heights")


@dataclass(frozen=True, eq=False)
class At(Event):
    """Events at given times, each at the nearest sample; coinciding events add up."""

    t: Block
    times: np.ndarray

    def check(self):
        if self.times.ndim != 1 or not self.times.size or not (self.times >= 0).all():
            raise BadValue(
                f"at: times must be one row of numbers, each 0 or above, got {self.times!r:.200}"
            )
        limits.check("table_knots", self.times.size, "at: times")

    units = unitless

    def design(self, fs):
        samples, heights = np.unique(np.floor(self.times * fs + 0.5), return_counts=True)
        return AtParams(fs, np.append(samples, LONG), np.append(heights.astype(float), 0.0)), ()

    @staticmethod
    def step(p, s, t):
        n = floor(t * p.fs + 0.5)
        i = search(p.samples, n, 0.0)
        return where(p.samples[i] == n, p.heights[i], 0.0), s


@public
def at(times) -> Block:
    """Make events at given times.

    Parameters
    ----------
    times : float or array_like, shape (n,)
        In s since sample 0; each is at the nearest sample.

    Returns
    -------
    Block
        1 at each, 2 where two meet, else 0.

    Raises
    ------
    BadValue
        No times, or one below 0.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import at
    >>> stimlib.compile(stimlib.Scene({"y": at([0.0, 0.003])}), fs=1000).process(
    ...     np.empty((0, 5))
    ... )
    array([[1., 0., 0., 1., 0.]])
    """
    return At(Time(), np.atleast_1d(times))


TIMELINES = ("step", "linear", "cosine")


# Parameters of `Timeline` at a sample rate.
#   kind  place in TIMELINES
TimelineParams = namedtuple("TimelineParams", "times values kind")


@dataclass(frozen=True, eq=False)
class Timeline(Block):
    """A signal given by values at times, with curves between them.

    Between the values a and b it is a + (b - a) w(z), with z from 0 to 1.
    """

    t: Block
    times: np.ndarray
    values: np.ndarray
    kind: str
    unit: str

    def check(self):
        one_of("timeline: kind", self.kind, TIMELINES)
        for a, b in pairwise(self.times.tolist()):
            if b < a:
                raise BadValue(f"timeline: the times must rise; {b:g} s comes after {a:g} s")
        limits.check("table_knots", self.times.size, "timeline: points")

    def units(self, *u):
        return unit(self.unit)

    def design(self, fs):
        # held at both ends
        times, values = (np.concatenate([v[:1], v, v[-1:]]) for v in (self.times, self.values))
        return TimelineParams(times, values, float(TIMELINES.index(self.kind))), ()

    @staticmethod
    def step(p, s, t):
        i = search(p.times, t, 0.0)
        width = p.times[i + 1] - p.times[i]
        z = (t - p.times[i]) / where(width > 0.0, width, 1.0)
        z = where(z > 0.0, where(z < 1.0, z, 1.0), 0.0)
        c = sinpi(0.5 * z)
        w = where(p.kind == 0.0, 0.0, where(p.kind == 1.0, z, c * c))
        return fma(w, p.values[i + 1], fma(-w, p.values[i], p.values[i])), s


@public
def timeline(points, kind: str = "linear", unit: str = "") -> Block:
    """Make a signal from times and values, such as the course of a trial.

    Parameters
    ----------
    points : sequence of (float, float)
        Time in s and value, times rising; two points at one time are a jump.  Before
        the first and after the last the value is held.
    kind : {"linear", "step", "cosine"}
        Between two points: a straight line, the earlier value, or half a period of a
        cosine.
    unit : str
        Of the values.

    Returns
    -------
    Block

    Raises
    ------
    BadValue
        No pairs of numbers, times that fall, an unknown kind.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import timeline
    >>> line = timeline([(0, 0.0), (0.002, 1.0), (0.004, 1.0), (0.004, 0.5)])
    >>> stimlib.compile(stimlib.Scene({"y": line}), fs=1000).process(np.empty((0, 6)))
    array([[0. , 0.5, 1. , 1. , 0.5, 0.5]])
    """
    try:
        times, values = zip(*points, strict=True)
    except (TypeError, ValueError):
        raise BadValue(
            "timeline: points must be pairs (time, value), such as zip(times, values), got"
            f" {points!r:.180}"
        ) from None
    return Timeline(Time(), np.array(times), np.array(values), kind, unit)


# Envelopes --------------------------------------------------------------------------
# What opens and closes: bursts with ramps, and envelopes of a gate.


# Parameters of `Burst` at a sample rate.
#   n     samples
#   ramp  samples of each flank
BurstParams = namedtuple("BurstParams", "n ramp")

# State of `Burst` between samples.
#   k  sample of the burst
BurstState = namedtuple("BurstState", "k height")


def opened(p, s, event):
    """Return the envelope at one sample, and the new state."""
    k = where(event == 0.0, s.k, NONE)
    height = where(event == 0.0, s.height, event)
    t = as_float(k) + 0.5
    edge = where(t < p.n - t, t, p.n - t) / p.ramp
    v = sinpi(0.5 * where(edge > 0.0, where(edge < 1.0, edge, 1.0), 0.0))
    runs = where(as_float(k) < p.n, 1.0, 0.0)
    return where(runs > 0.0, height * (v * v), 0.0), BurstState(
        where(runs > 0.0, k + ONE, k), height
    )


@dataclass(frozen=True, eq=False)
class Burst(Block):
    """An envelope with raised-cosine ramps after each event.

    Sample k is height sin^2(pi/2 min(t, n - t, ramp)/ramp), with t = k + 1/2, so the
    envelope is symmetric in time.
    """

    event: Block
    duration: Above0
    ramp: float

    def check(self):
        if not 0 <= self.ramp <= self.duration / 2:
            raise BadValue(
                f"burst: ramp = {self.ramp:g} s must be from 0 to half of duration ="
                f" {self.duration:g} s: one ramp at each end"
            )

    def design(self, fs):
        n = round(self.duration * fs)
        if n < 1:
            raise BadValue(
                f"burst: duration = {self.duration:g} s is less than half a sample at fs ="
                f" {fs:g} Hz"
            )
        return BurstParams(float(n), min(max(0.5, self.ramp * fs), n / 2)), BurstState(U(n), 0.0)

    @staticmethod
    def step(p, s, event):
        return opened(p, s, event)

    @staticmethod
    def tile(p, s, event, y):
        if happens(event) == NONE and as_float(s.k) >= p.n:
            y[:] = 0.0
            return s
        for i in range(y.size):
            y[i], s = opened(p, s, event[i])
        return s


@public
def burst(start: Block | float, duration: float, ramp: float = 0.0) -> Block:
    """Make an envelope that opens for a given duration after each event.

    Its ramps are raised cosines. Multiply a signal by it to get a burst of that signal.

    Parameters
    ----------
    start : Block or float
        An event, whose height is that of the envelope; or a time in s, for one burst.
        An event within a burst restarts it.
    duration : float
        From the start of the first ramp to the end of the last, in s, rounded to whole
        samples.
    ramp : float
        Length of each ramp in s, at most half the duration.

    Returns
    -------
    Block
        In the unit of start.  Its sum is that of a rectangle as long as duration -
        ramp.

    Raises
    ------
    BadValue
        A duration not above 0, a ramp that does not fit into it, what is known to be no
        event; at compile time, a duration of less than half a sample.

    Notes
    -----
    The ramps are read in the middle of each sample: k samples after the start, at fs =
    1/h, the first ramp is (1 - cos(pi (k + 1/2) h/ramp))/2, so no sample of the burst
    is 0.

    What a burst multiplies does not begin with it: the phase of ``oscillator(180)``
    counts from sample 0.  For one that rises through 0 where a burst at t0 begins, give
    ``oscillator(180, phase=-2 * pi * 180 * t0)``.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import burst
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": burst(0.001, duration=0.005, ramp=0.002)}), fs=1000
    ... )
    >>> proc.process(np.empty((0, 7))).round(3)
    array([[0.   , 0.146, 0.854, 1.   , 0.854, 0.146, 0.   ]])
    """
    return Burst(
        as_event("burst", start if isinstance(start, Block) else at(start)), duration, ramp
    )


CURVE = 1.5
"""Time constants in an attack: what it rises towards is above 1 by 1/(exp(1.5) - 1)."""
FULL = 1 - 1e-9
"""An attack ends here: by rounding it could come a sample late."""


# Parameters of `Envelope` at a sample rate.
EnvelopeParams = namedtuple("EnvelopeParams", "rise top fall sustain release")

# State of `Envelope` between samples.
#   stage  0 released, 1 attack, 2 decay and sustain
EnvelopeState = namedtuple("EnvelopeState", "y stage")


def followed(p, s, gate):
    """Return the envelope at one sample, and the new state."""
    on = where(gate > 0.0, 1.0, 0.0)
    stage = where(on > 0.0, where(s.stage > 0.0, s.stage, 1.0), 0.0)
    target = where(stage == 1.0, p.top, where(stage == 2.0, p.sustain, 0.0))
    g = where(stage == 1.0, p.rise, where(stage == 2.0, p.fall, p.release))
    y = s.y + fma(g, target - s.y, TINY)
    full = where(stage == 1.0, where(y >= FULL, 1.0, 0.0), 0.0)
    y = where(full > 0.0, 1.0, y)
    return flush(y), EnvelopeState(y, where(full > 0.0, 2.0, stage))


@dataclass(frozen=True, eq=False)
class Envelope(Block):
    """An attack-decay-sustain-release envelope: y += g (target - y) in each stage.

    When the gate opens, the attack starts from the present y.
    """

    gate: Block
    attack: From0
    decay: From0
    sustain: From0
    release: From0

    units = unitless

    def design(self, fs):
        rise, fall, release = (
            -math.expm1(-1 / (t * fs)) if t * fs > 1e-3 else 1.0
            for t in (self.attack / CURVE, self.decay, self.release)
        )
        return EnvelopeParams(
            rise, -1 / math.expm1(-CURVE), fall, self.sustain, release
        ), EnvelopeState(0.0, 0.0)

    @staticmethod
    def step(p, s, gate):
        return followed(p, s, gate)

    @staticmethod
    def tile(p, s, gate, y):
        level, after = followed(p, s, gate[0])
        if after.y == s.y and after.stage == s.stage:  # at rest, or at the sustain level
            stays, closed = NONE, where(s.stage > 0.0, NONE, ONE)
            for i in range(y.size):
                stays = stays + where(gate[i] > 0.0, ONE - closed, closed)
            if stays == U(y.size):
                y[:] = level
                return s
        for i in range(y.size):
            y[i], s = followed(p, s, gate[i])
        return s


@public
def envelope(
    gate: Block | float,
    attack: float = 0.005,
    decay: float = 0.05,
    sustain: float = 1.0,
    release: float = 0.05,
) -> Block:
    """Make an attack-decay-sustain-release (ADSR) envelope, controlled by a gate.

    Multiply a signal by it to set its strength while the gate is open and after it
    closes.

    Parameters
    ----------
    gate : Block
        Open where it is above 0.  One that opens again starts a new attack from where
        the envelope is.
    attack : float
        Time to 1 in s, along an exponential.
    decay, release : float
        Time constants in s of the way to the sustain level, and to 0 after the gate
        closes.
    sustain : float
        Level while the gate stays open.

    Returns
    -------
    Block
        Without unit.

    Raises
    ------
    BadValue
        A number below 0; an event in place of a gate.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import envelope
    >>> shape = envelope(
    ...     stimlib.Input("gate"), attack=0.002, decay=0.001, sustain=0.5, release=0.001
    ... )
    >>> proc = stimlib.compile(stimlib.Scene({"y": shape}), fs=1000)
    >>> proc.process(np.array([[1.0, 1.0, 1.0, 1.0, 0.0, 0.0]])).round(3)
    array([[0.679, 1.   , 0.684, 0.568, 0.209, 0.077]])
    """
    gate = as_signal("envelope", gate, "hold it open with burst(event, duration)")
    return Envelope(as_block(gate), attack, decay, sustain, release)
