"""Events: signals that are 0 except at the sample where something happens."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from ..core import pointwise, units as un
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
from ..core.loops import loop
from ..core.maths import floor, where
from ..core.parameter import Param
from ..errors import Above0, BadValue, From0, public
from .friction import quantity
from .impedance import Gate, with_unit

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

    step = staticmethod(edge)

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

    step = staticmethod(crossed)

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
    begins_early = False

    def design(self, fs):
        return (), Total(0.0)

    @staticmethod
    def step(p, s, event):
        y = s.y + event
        return y, Total(y)


@public
def count(event: Block | float) -> Block:
    """Return the running sum of the heights of all events from sample 0 on.

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
    begins_early = False

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
        In the unit of x; 0 before the first event from sample 0 on.

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


@public
def deadband(x: Block | float, weber: Block | float, floor: Block | float = 0.0) -> Block:
    """Hold a signal until it has changed by more than a just-noticeable difference.

    y = x where abs(x - y_last) > max(weber abs(y_last), floor), else y_last: what a
    person cannot tell from the value before is not sent.  So y is never further from x
    than that difference, and each change of y is a packet of a reduced transmission.

    Parameters
    ----------
    x : Block
    weber : Block or float
        Just-noticeable difference as a part of the value that is held (Weber fraction),
        0 or above; of forces and stiffnesses about 0.1, see
        :doc:`/reference/experiments_firmness`.
    floor : Block or float
        Least difference, in the unit of x: Weber's law ends near 0.

    Returns
    -------
    Block
        In the unit of x.  Before the first change it is 0.

    Raises
    ------
    BadValue
        A number or parameter below 0.
    UnitError
        A Weber fraction with a unit, or a floor in another unit than x.

    References
    ----------
    P. Hinterseer, S. Hirche, S. Chaudhuri, E. Steinbach and M. Buss, "Perception-based
    data reduction and transmission of haptic data in telepresence and teleaction
    systems", IEEE Trans. Signal Process. 56 (2008); Çaldıran's thesis, chapter 1, names
    such reduction by JNDs as a use of thresholds and gives no formula.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import deadband
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": deadband(stimlib.Input("x", "N"), 0.1)}), fs=1000
    ... )
    >>> proc.process(np.array([[1.0, 1.05, 1.09, 1.11, 1.2, 1.25]]))
    array([[1.  , 1.  , 1.  , 1.11, 1.11, 1.25]])
    """
    signal = as_block(x)
    part = quantity("deadband", "weber", weber, "")
    least = quantity("deadband", "floor", floor, str(signal.dim))

    def held(last: Block) -> Block:
        # in this order a sample that is no number passes, for the guard of the output
        within = abs(signal - last) <= pointwise.maximum(part * abs(last), least)
        return pointwise.where(within, last, signal)

    return loop(held, unit=str(signal.dim))


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

    step = staticmethod(passed)

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
