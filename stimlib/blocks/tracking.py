"""Following motion that arrives slowly: reports of 60 to 250 Hz, held in between."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass

from ..core.graph import Block, as_block
from ..core.maths import TINY, flush, fma, where
from ..core.response import backward
from ..design import responses
from ..errors import Above0, BadValue, public
from .fir_filters import RATE

# Parameters of `Track` at a sample rate.
#   q  w/fs
#   g  1 - exp(-q)
TrackParams = namedtuple("TrackParams", "q g fs max_jump")

# State of `Track` between samples.
#   y     position
#   v     movement of y in the last sample
#   e     x - y
#   h     velocity of the filter, per sample
#   last  x
#   cold  1: starts at the next x in contact
TrackState = namedtuple("TrackState", "y v e h last cold")


def follow(p, s, x, contact):
    """Return the state of the tracker after x has been held for one sample."""
    d = x - s.last
    fresh = where(s.cold > 0.0, 1.0, where(abs(d) > p.max_jump, 1.0, 0.0))
    e = where(fresh > 0.0, 0.0, s.e + (d + TINY))
    h = where(fresh > 0.0, 0.0, s.h)
    u = fma(p.q, e, -h)
    a, b = e + u, fma(p.q, u, h)
    after, move = fma(-p.g, a, a), fma(p.g, a, -u)
    on = contact > 0.0
    y, v = where(on, flush(x - after), s.y), where(on, flush(move), 0.0)
    e, h = where(on, after, 0.0), where(on, fma(-p.g, b, b), 0.0)
    return TrackState(y, v, e, h, where(on, x, s.last), where(on, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Tracker(Block, abstract=True):
    """A critically damped tracker, w^2/(s + w)^2, of an input held between samples.

    Its state is e = x - y and h = v/fs.

    With q = w/fs, g = 1 - exp(-q), and e already increased by the change of x in this
    sample:

    u = q e - h;  e -> (1 - g)(e + u);  h -> (1 - g)(h + q u);  y = x - e.

    These are the exact solutions of y'' = w^2 (x - y) - 2 w y' at the end of the
    sample.  Only differences of x enter e and h, so a held position leaves nothing in
    them, however small q is.
    """

    x: Block
    contact: Block
    bandwidth: Above0
    max_jump: Above0 | None
    begins_early = False

    def design(self, fs):
        if self.bandwidth >= fs / 2:
            raise BadValue(
                f"track: bandwidth = {self.bandwidth:g} Hz does not fit below fs/2 = {fs / 2:g} Hz"
            )
        q = 2 * math.pi * self.bandwidth / fs
        jump = math.inf if self.max_jump is None else float(self.max_jump)
        return TrackParams(q, -math.expm1(-q), fs, jump), TrackState(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def response(p, z):
    """Return the tracker's frequency response from input to position.

    (1 - (1-g)(1+q) + (1-g)(q-g)/z) / (1 - (1-g)/z)^2.
    """
    c = p.q - p.g
    return (p.q * p.g - c + (1 - p.g) * c / z) / (backward(z) + p.g / z) ** 2


def lag(p):
    """Return the group delay of the tracked position at 0 Hz in samples.

    It is 2/q - 1/2, up to terms of the order of q.
    """
    return (1 - p.g) * (2 + (p.q - p.g) / p.g) / p.g


@dataclass(frozen=True, eq=False)
class Track(Tracker):
    """Position of the tracker."""

    def laws(self, fs):
        return (responses.tracker(self.bandwidth),)

    @staticmethod
    def step(p, s, x, contact):
        after = follow(p, s, x, contact)
        return after.y, after

    @staticmethod
    def transfer(p, z):
        return response(p, z)

    def delay(self, p):
        return lag(p)


@dataclass(frozen=True, eq=False)
class TrackVelocity(Tracker):
    """Velocity of the tracker: the change of its position per sample, times fs."""

    def units(self, *u):
        return u[0] * RATE

    def laws(self, fs):
        return (responses.tracker(self.bandwidth, rate=True),)

    @staticmethod
    def step(p, s, x, contact):
        after = follow(p, s, x, contact)
        return after.v * p.fs, after

    @staticmethod
    def transfer(p, z):
        return p.fs * backward(z) * response(p, z)

    def delay(self, p):
        return lag(p) + 0.5  # of the difference


@public
def track(
    x: Block, bandwidth: float = 20.0, contact: Block | float = 1.0, max_jump: float | None = 0.05
) -> Block:
    """Smooth slow, jittered position reports causally.

    The tracker is a critically damped second-order system, H(s) = w^2/(s + w)^2 with w
    = 2 pi bandwidth, discretised exactly for an input that is held between samples:
    y[n] is the value that the continuous filter reaches after x[n] has been held for
    one sample. The gain at 0 Hz is exactly 1, and a step does not overshoot.

    Parameters
    ----------
    x : Block
        Position, usually in m, held between reports.
    bandwidth : float
        Frequency of both poles in Hz; the gain there is 1/2.  Latency 2/w = 1/(pi
        bandwidth) seconds (less half a sample): 16 ms at 20 Hz.  Regular reports at r
        Hz leave a ripple of at most 3.3 (bandwidth/r)^2 of the velocity: 7 % for 70 Hz
        and 10 Hz, 8 % for 125 Hz and 20 Hz.
    contact : Block
        Where it is not above 0 the output holds its value (0 before the first contact)
        and x is not looked at.  At re-contact the tracker starts at the new position
        with velocity 0, so the way between invents no movement.
    max_jump : float, optional
        In the unit of x.  A change of x from one sample to the next that is larger
        restarts the tracker there with velocity 0: a fault of the device invents no
        movement either.  As reports are held, a whole report's movement arrives in one
        sample: choose the highest speed times the longest normal gap.  The default 0.05
        is 1 m/s for 50 ms.  None: never.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        bandwidth or max_jump not above 0; at compile time, bandwidth not below fs/2.

    See Also
    --------
    track_velocity : the rate of the same tracker.

    Notes
    -----
    It always begins steady, at the first value of x with velocity 0.

    It is linear and time-invariant as long as contact lasts and no jump occurs;
    ``Processor.response`` describes that case.

    References
    ----------
    The touch-screen thesis, chapter 3, eq. (17): bumps are tied to the finger's
    position, which an infrared frame acquires. The filter is our own choice, the papers
    give none.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import track
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": track(stimlib.Input("x", "m"), bandwidth=20.0)}),
    ...     fs=8000,
    ... )
    >>> t = np.arange(8000) / 8000
    >>> reports = 0.1 * np.floor(t * 100) / 100  # 0.1 m/s, a report every 10 ms
    >>> y = proc.process(reports[None])[0]
    >>> bool(
    ...     np.abs(np.diff(y)).max() * 8000 < 0.12
    ... )  # the reports themselves jump by 8 m/s
    True
    >>> round(proc.latency["y", "x"][0] / 8000, 4)
    0.0159
    """
    return Track(x, as_block(contact), bandwidth, max_jump)


@public
def track_velocity(
    x: Block, bandwidth: float = 20.0, contact: Block | float = 1.0, max_jump: float | None = 0.05
) -> Block:
    """Return the rate of change of ``track`` with the same arguments.

    v[n] = (y[n] - y[n-1]) fs, computed without that difference. The sum of v/fs is
    exactly the tracked position, so position and rate from one tracker describe the
    same movement.

    Parameters
    ----------
    x, bandwidth, contact, max_jump
        As for ``track``.  The velocity is 0 off contact, and at the sample of a jump.

    Returns
    -------
    Block
        In the unit of x per second.

    Raises
    ------
    BadValue
        bandwidth or max_jump not above 0; at compile time, bandwidth not below fs/2.

    See Also
    --------
    track : position.
    stimlib.blocks.velocity : for positions sampled at the full rate.

    Notes
    -----
    Reports that are held leave a ripple. At a constant speed and the default bandwidth,
    its largest error is 30 % of the speed for reports at 60 Hz, 8 % at 125 Hz and 3 %
    at 250 Hz; with reports that come up to half an interval late, 58, 22 and 8 %. Half
    the bandwidth has about a third of the error, and twice the latency.

    References
    ----------
    The UGrip paper, section 1.1: the compression rate v.  The filter is our own choice.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import track_velocity
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"v": track_velocity(stimlib.Input("x", "m"))}), fs=8000
    ... )
    >>> proc.process(0.1 * np.arange(8000)[None] / 8000)[0, -1].round(9)
    np.float64(0.1)
    """
    return TrackVelocity(x, as_block(contact), bandwidth, max_jump)
