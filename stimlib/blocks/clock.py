"""What depends on the time alone: nothing adds up, so it is as exact after a day as at
first.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..core import units as un
from ..core.graph import Block, positive
from ..core.maths import floor, fma, search, where
from ..core.program import lead
from ..core.units import unit
from ..errors import BadValue, public
from ..system.limits import limits
from .bump import sinpi
from .events import Event

LONG = 2.0**60
"""A sample that no run reaches."""


class TimeParams(NamedTuple):
    fs: float


class TimeState(NamedTuple):
    n: float


@dataclass(frozen=True, eq=False)
class Time(Block):
    """n/fs, rounded once, at sample n of its clock."""

    def units(self, *u):
        return unit("s")

    def design(self, fs):
        return TimeParams(fs), TimeState(-float(lead(fs)))  # so long before sample 0 it begins

    @staticmethod
    def step(p, s):
        return s.n / p.fs, TimeState(s.n + 1.0)


@public
def elapsed() -> Block:
    """The time since sample 0; inside ``enabled``, that in which the block has run.

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


class EveryParams(NamedTuple):
    fs: float
    period: float  # samples


@dataclass(frozen=True, eq=False)
class Every(Event):
    """1 at the samples floor(k P + 1/2), k = 0, 1, .."""

    t: Block
    period: float
    live = "pulse_train(rate) has a rate that moves"

    def check(self):
        positive(self, "period")

    def units(self, *u):
        return un.ONE

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
    """An event again and again, from sample 0 on, each at the sample nearest to its
    time.

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


class AtParams(NamedTuple):
    fs: float
    samples: np.ndarray  # rising, ended by one that is never reached
    heights: np.ndarray


@dataclass(frozen=True, eq=False)
class At(Event):
    """Events at given times, each at the nearest sample; those of one sample add up."""

    t: Block
    times: np.ndarray

    def check(self):
        if self.times.ndim != 1 or not self.times.size or not (self.times >= 0).all():
            raise BadValue(
                f"at: times must be one row of numbers, each 0 or above, got {self.times!r:.200}"
            )
        limits.check("table_knots", self.times.size, "at: times")

    def units(self, *u):
        return un.ONE

    def design(self, fs):
        samples, heights = np.unique(np.floor(self.times * fs + 0.5), return_counts=True)
        return AtParams(fs, np.append(samples, LONG), np.append(heights.astype(float), 0.0)), ()

    @staticmethod
    def step(p, s, t):
        n = floor(t * p.fs + 0.5)
        i = search(p.samples, n)
        return where(p.samples[i] == n, p.heights[i], 0.0), s


@public
def at(times) -> Block:
    """Events at given times.

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


class TimelineParams(NamedTuple):
    times: np.ndarray
    values: np.ndarray
    kind: float  # place in TIMELINES


@dataclass(frozen=True, eq=False)
class Timeline(Block):
    """Values at times, and what is between them: of a piece from a to b, with z from 0
    to 1, a + (b - a) w(z).
    """

    t: Block
    times: np.ndarray
    values: np.ndarray
    kind: str
    unit: str

    def check(self):
        if self.kind not in TIMELINES:
            raise BadValue(f"timeline: kind = {self.kind!r}; choose one of {', '.join(TIMELINES)}")
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
        i = search(p.times, t)
        width = p.times[i + 1] - p.times[i]
        z = (t - p.times[i]) / where(width > 0.0, width, 1.0)
        z = where(z > 0.0, where(z < 1.0, z, 1.0), 0.0)
        c = sinpi(0.5 * z)
        w = where(p.kind == 0.0, 0.0, where(p.kind == 1.0, z, c * c))
        return fma(w, p.values[i + 1], fma(-w, p.values[i], p.values[i])), s


@public
def timeline(points, kind: str = "linear", unit: str = "") -> Block:
    """A signal given by times and values, such as the course of a trial.

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
