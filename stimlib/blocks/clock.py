"""What depends on the time alone: the time, and events at given times."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..core.graph import Block, stated, unitless
from ..core.maths import as_float, floor, fma, quotient, search, where
from ..core.program import lead
from ..core.units import unit
from ..errors import Above0, BadValue, one_of, public
from ..system.limits import limits
from .events import Event
from .movement import sinpi

U = np.uint64
LONG = 2.0**60
"""A sample that no run reaches."""


# Parameters of `Time` at a sample rate.
#   inverse  see ``maths.quotient``
TimeParams = namedtuple("TimeParams", "fs inverse")

# State of `Time` between samples.
TimeState = namedtuple("TimeState", "n")


@dataclass(frozen=True, eq=False)
class Time(Block):
    """Time n/fs at sample n of the block's clock, rounded once."""

    def units(self, *u):
        return unit("s")

    def design(self, fs):
        p = TimeParams(fs, (fs % 1 == 0 and 1 <= fs <= 2**32) / fs)
        return p, TimeState(-float(lead(fs)))  # so long before sample 0 it begins

    @staticmethod
    def step(p, s):
        return s.n / p.fs, TimeState(s.n + 1.0)

    @staticmethod
    def tile(p, s, y):  # each sample by itself: a sum along them waits for the one before
        for i in range(y.size):
            y[i] = quotient(s.n, i, p.fs, p.inverse)
        return TimeState(s.n + as_float(U(y.size)))


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
#   rises    whether t is the time itself
AtParams = namedtuple("AtParams", "fs samples heights rises")


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
        samples, heights = np.append(samples, LONG), np.append(heights.astype(float), 0.0)
        return AtParams(fs, samples, heights, float(isinstance(self.t, Time))), ()

    @staticmethod
    def step(p, s, t):
        n = floor(t * p.fs + 0.5)
        i = search(p.samples, n, 0.0)
        return where(p.samples[i] == n, p.heights[i], 0.0), s

    @staticmethod
    def tile(p, s, t, y):
        first = floor(t[0] * p.fs + 0.5)
        i = search(p.samples, first, 0.0)
        early = first < p.samples[0]
        low = where(early, -LONG, p.samples[i])
        high = where(early, p.samples[0], p.samples[i + 1])
        last = floor(t[y.size - 1] * p.fs + 0.5)
        if where(first > low, where(last < high, p.rises, 0.0), 0.0) > 0.0:  # as nearly always
            y[:] = 0.0
            return s
        for k in range(y.size):
            n = floor(t[k] * p.fs + 0.5)
            i = search(p.samples, n, 0.0)
            y[k] = where(p.samples[i] == n, p.heights[i], 0.0)
        return s


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

    units = stated

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
