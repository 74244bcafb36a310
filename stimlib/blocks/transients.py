"""What events make: decaying sinusoids and recorded transients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.graph import NONE, ONE, Block, Const, in_unit, positive
from ..core.maths import SILENT, TINY, exp, flush, fma, where
from ..core.response import backward
from ..core.units import unit
from ..design import responses
from ..design.resample import resampled
from ..errors import BadValue, public
from ..system.limits import limits
from .bump import regular, sinpi
from .events import as_event, happens
from .filters import below_half
from .impedance import with_unit

U, INT = np.uint64, np.int64


class RingParams(NamedTuple):
    per: float  # 1/fs
    sine: float


class RingState(NamedTuple):
    re: float
    im: float


class Turn(NamedTuple):
    """p of a frequency and a decay."""

    e: float  # 1 - real part
    w: float  # imaginary part
    wrong: float  # 0, or nan


def turn(p, freq, decay):
    """Numbers of one sample."""
    r = freq * p.per
    r = where(r > 0.0, where(r < 0.5, r, 0.5), 0.0)
    rho = exp(-p.per / where(decay > p.per, decay, p.per))
    si, co = sinpi(r), sinpi(0.5 - r)
    return Turn(
        fma(2.0 * rho * si, si, 1.0 - rho), 2.0 * rho * si * co, (freq + decay) - (freq + decay)
    )


def turned(p, t, s, event):
    """The output and the new state."""
    re = s.re + (event + fma(-t.e, s.re, fma(-t.w, s.im, TINY)))
    im = s.im + fma(-t.e, s.im, fma(t.w, s.re, TINY))
    return where(t.wrong == 0.0, flush(where(p.sine > 0.0, im, re)), t.wrong), RingState(re, im)


def rests(s, event):
    """1 where nothing sounds and nothing happens: then the state stays as it is, and
    the output is 0.
    """
    return where(
        event == 0.0, where(abs(s.re) <= SILENT, where(abs(s.im) <= SILENT, 1.0, 0.0), 0.0), 0.0
    )


@dataclass(frozen=True, eq=False)
class Ring(Block):
    """q[n] = p q[n-1] + event, p = exp(-1/(decay fs)) exp(2 pi i freq/fs); y is the
    imaginary part of q, or the real one.

    A turn by p makes no q longer, so frequency and decay may move at every sample.
    """

    event: Block
    freq: Block
    decay: Block
    onset: str

    def check(self):
        if self.onset not in ("sine", "cosine"):
            raise BadValue(f"ring: onset = {self.onset!r}; choose sine or cosine")
        for name, v in (("freq", self.freq), ("decay", self.decay)):
            if isinstance(v, Const) and not v.value > 0:
                raise BadValue(f"ring: {name} = {v.value:g} must be above 0")

    def units(self, *u):
        in_unit("ring: freq", self.freq, u[1], "Hz")
        in_unit("ring: decay", self.decay, u[2], "s")
        return u[0]

    def design(self, fs):
        if isinstance(self.freq, Const):
            below_half("ring", fs, freq=self.freq.value)
        return RingParams(1 / fs, float(self.onset == "sine")), RingState(0.0, 0.0)

    def laws(self, fs):
        if isinstance(self.freq, Const) and isinstance(self.decay, Const):
            return (responses.ring(self.freq.value, self.decay.value, self.onset),)
        return ()

    def through(self, p, fs, z, H, value):
        if value[1] is None or value[2] is None or H[0] is None:
            return None
        # p - 1, and its conjugate
        turned = [np.expm1(-1 / (value[2] * fs) + s * 2j * np.pi * value[1] / fs) for s in (1, -1)]
        one, other = (1 / (backward(z) - q / z) for q in turned)
        return H[0] * ((one - other) / 2j if self.onset == "sine" else (one + other) / 2)

    @staticmethod
    def step(p, s, event, freq, decay):
        y, after = turned(p, turn(p, freq, decay), s, event)
        rest = rests(s, event)
        return where(rest > 0.0, 0.0, y), RingState(
            where(rest > 0.0, s.re, after.re), where(rest > 0.0, s.im, after.im)
        )

    @staticmethod
    def tile(p, s, event, freq, decay, y):
        if happens(event) == NONE and rests(s, 0.0) > 0.0:
            y[:] = 0.0
            return s
        t = turn(p, freq[0], decay[0])
        moves = regular(freq) < U(y.size) or regular(decay) < U(y.size)
        for i in range(y.size):
            if moves:
                t = turn(p, freq[i], decay[i])
            y[i] = 0.0
            if rests(s, event[i]) == 0.0:
                y[i], s = turned(p, t, s, event[i])
        return s


@public
def ring(
    event: Block | float, freq: Block | float, decay: Block | float, onset: str = "sine"
) -> Block:
    """A decaying sinusoid at each event, any number at once: a click, a tap, a struck
    mode.

    Parameters
    ----------
    event : Block
        Its height is the amplitude.
    freq : float or Block
        In Hz; a signal is held in 0 .. fs/2.
    decay : float or Block
        Time constant in s: after it 1/e is left.  A signal is held at one sample and
        above.
    onset : {"sine", "cosine"}
        From 0, or with the event's full height at once, which at low sample rates has
        18 dB more aliases.

    Returns
    -------
    Block
        In the unit of event.

    Raises
    ------
    BadValue
        A number not above 0, an unknown onset, what is known to be no event; at compile
        time, a frequency not below fs/2.
    UnitError
        A frequency that is not in Hz, or a decay that is not in s.

    References
    ----------
    Okamura, Cutkosky and Dennerlein, "Reality-based models for vibration feedback in
    virtual environments" (2001), eq. (1).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import at, ring
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": ring(at(0.0), freq=250, decay=0.002)}), fs=1000
    ... )
    >>> proc.process(np.empty((0, 5))).round(3) + 0.0
    array([[ 0.   ,  0.607,  0.   , -0.223,  0.   ]])
    """
    return Ring(as_event("ring", event), with_unit(freq, "Hz"), with_unit(decay, "s"), onset)


class GrainParams(NamedTuple):
    shape: np.ndarray


class GrainState(NamedTuple):
    ahead: np.ndarray  # what is to come, in a ring
    at: np.uint64
    left: np.uint64  # samples until all of it is 0


def add(height, shape, line):
    """line += height shape, as far as line goes."""
    for j in range(line.size):
        line[j] = fma(height, shape[j], line[j])


@dataclass(frozen=True, eq=False)
class Grain(Block):
    """y[n] = sum of event[k] shape[n - k], in the order of the events; in silence
    nothing is computed.
    """

    event: Block
    samples: np.ndarray
    rate: float
    unit: str

    def check(self):
        if self.samples.ndim != 1 or not self.samples.size:
            raise BadValue(
                f"grain: samples must be one row of numbers, got shape {self.samples.shape}"
            )
        positive(self, "rate")

    def units(self, *u):
        return u[0] * unit(self.unit)

    def design(self, fs):
        limits.check(
            "state_bytes",
            16 * self.samples.size * fs / self.rate,
            f"grain: bytes of its samples at fs = {fs:g} Hz",
        )
        shape = resampled(self.samples, self.rate, fs, name="grain")
        return GrainParams(shape), GrainState(np.zeros(shape.size), NONE, NONE)

    def laws(self, fs):
        return (responses.sum_of(self.samples),) if self.rate == fs else ()

    def memory(self, p):
        return p.shape.size

    @staticmethod
    def tile(p, s, event, y):
        size = U(s.ahead.size)
        at, left = s.at % size, s.left  # a state may come from anywhere
        if left == NONE and happens(event) == NONE:
            y[:] = 0.0
            return s
        for i in range(y.size):
            here = INT(at)
            if event[i] != 0.0:
                first = s.ahead.size - here
                add(event[i], p.shape, s.ahead[here:])
                add(event[i], p.shape[first:], s.ahead[:here])
                left = size
            y[i] = 0.0
            if left > NONE:
                y[i] = s.ahead[here]
                s.ahead[here] = 0.0
                at, left = (at + ONE) % size, left - ONE
        return GrainState(s.ahead, at, left)

    @staticmethod
    def transfer(p, z):
        return np.polyval(p.shape[::-1], 1 / z)


@public
def grain(event: Block | float, samples, rate: float, unit: str = "") -> Block:
    """A recorded transient at each event, any number at once.

    Parameters
    ----------
    event : Block
        Its height is a factor.
    samples : array_like, shape (n,)
    rate : float
        Sample rate of the samples in Hz; at another one they are interpolated with a
        band limit, to 1e-5.
    unit : str
        Of the samples.

    Returns
    -------
    Block
        In the unit of event times that of the samples.

    Raises
    ------
    BadValue
        No samples, or none that are finite; a rate not above 0; what is known to be no
        event.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import every, grain
    >>> scene = stimlib.Scene({"y": grain(every(0.002), [1.0, 0.5, 0.25], rate=1000)})
    >>> stimlib.compile(scene, fs=1000).process(np.empty((0, 5)))
    array([[1.  , 0.5 , 1.25, 0.5 , 1.25]])
    """
    return Grain(as_event("grain", event), samples, rate, unit)
