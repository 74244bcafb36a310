"""What events make: decaying sinusoids, recorded transients, bursts and envelopes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import units as un
from ..core.bounds import limits
from ..core.graph import NONE, ONE, Block, Const, as_block, positive
from ..core.maths import TINY, as_float, exp, flush, fma, where
from ..core.response import backward
from ..core.units import unit
from ..design import responses
from ..design.resample import resampled
from ..errors import BadValue, UnitError
from .bump import sinpi
from .clock import at
from .events import as_event, as_signal
from .filters import below_half
from .impedance import with_unit

U, INT = np.uint64, np.int64


class RingParams(NamedTuple):
    per: float  # 1/fs
    sine: float


class RingState(NamedTuple):
    re: float
    im: float


@dataclass(frozen=True, eq=False)
class Ring(Block):
    """q[n] = p q[n-1] + event, p = exp(-1/(decay fs)) exp(2 pi i freq/fs); y is the imaginary part of q, or the real one.

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
        for name, v, wanted in (("freq", u[1], "Hz"), ("decay", u[2], "s")):
            if v != unit(wanted):
                raise UnitError(f"ring: {name} {getattr(self, name)!r} [{v}] must be in {wanted}")
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
        turned = [np.expm1(-1 / (value[2] * fs) + s * 2j * np.pi * value[1] / fs) for s in (1, -1)]  # p - 1, and its conjugate
        one, other = (1 / (backward(z) - q / z) for q in turned)
        return H[0] * ((one - other) / 2j if self.onset == "sine" else (one + other) / 2)

    @staticmethod
    def step(p, s, event, freq, decay):
        r = freq * p.per
        r = where(r > 0.0, where(r < 0.5, r, 0.5), 0.0)
        rho = exp(-p.per / where(decay > p.per, decay, p.per))
        si, co = sinpi(r), sinpi(0.5 - r)
        e, w = fma(2.0 * rho * si, si, 1.0 - rho), 2.0 * rho * si * co  # 1 - real part of p, imaginary part
        re = s.re + (event + fma(-e, s.re, fma(-w, s.im, TINY)))
        im = s.im + fma(-e, s.im, fma(w, s.re, TINY))
        wrong = (freq + decay) - (freq + decay)
        return where(wrong == 0.0, flush(where(p.sine > 0.0, im, re)), wrong), RingState(re, im)


def ring(event, freq, decay, onset: str = "sine") -> Block:
    """A decaying sinusoid at each event, any number at once: a click, a tap, a struck mode.

    Parameters
    ----------
    event : Block
        Its height is the amplitude.
    freq : float or Block
        In Hz; a signal is held in 0 .. fs/2.
    decay : float or Block
        Time constant in s: after it 1/e is left.  A signal is held at one sample and above.
    onset : {"sine", "cosine"}
        From 0, or with the event's full height at once, which at low sample rates has 18 dB more aliases.

    Returns
    -------
    Block
        In the unit of event.

    Raises
    ------
    BadValue
        A number not above 0, an unknown onset, what is known to be no event; at compile time, a frequency not below fs/2.
    UnitError
        A frequency that is not in Hz, or a decay that is not in s.

    References
    ----------
    Okamura, Cutkosky and Dennerlein, "Reality-based models for vibration feedback in virtual environments" (2001), eq. (1).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import at, ring
    >>> proc = stimlib.compile(stimlib.Scene({"y": ring(at(0.0), freq=250, decay=0.002)}), fs=1000)
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
    """y[n] = sum of event[k] shape[n - k], in the order of the events; in silence nothing is computed."""

    event: Block
    samples: np.ndarray
    rate: float
    unit: str

    def check(self):
        if self.samples.ndim != 1 or not self.samples.size:
            raise BadValue(f"grain: samples must be one row of numbers, got shape {self.samples.shape}")
        positive(self, "rate")

    def units(self, *u):
        return u[0] * unit(self.unit)

    def design(self, fs):
        limits.check("state_bytes", 16 * self.samples.size * fs / self.rate, f"grain: bytes of its samples at fs = {fs:g} Hz")
        shape = resampled(self.samples, fs / self.rate)
        return GrainParams(shape), GrainState(np.zeros(shape.size), NONE, NONE)

    def laws(self, fs):
        return (responses.sum_of(self.samples),) if self.rate == fs else ()

    def memory(self, p):
        return p.shape.size

    @staticmethod
    def tile(p, s, event, y):
        size = U(s.ahead.size)
        at, left, some = s.at % size, s.left, NONE  # a state may come from anywhere
        for i in range(y.size):
            some = some + where(event[i] == 0.0, NONE, ONE)
        if left == NONE and some == NONE:
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


def grain(event, samples, rate: float, unit: str = "") -> Block:
    """A recorded transient at each event, any number at once.

    Parameters
    ----------
    event : Block
        Its height is a factor.
    samples : array_like, shape (n,)
    rate : float
        Sample rate of the samples in Hz; at another one they are interpolated with a band limit, to 1e-5.
    unit : str
        Of the samples.

    Returns
    -------
    Block
        In the unit of event times that of the samples.

    Raises
    ------
    BadValue
        No samples, or none that are finite; a rate not above 0; what is known to be no event.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import every, grain
    >>> scene = stimlib.Scene({"y": grain(every(0.002), [1.0, 0.5, 0.25], rate=1000)})
    >>> stimlib.compile(scene, fs=1000).process(np.empty((0, 5)))
    array([[1.  , 0.5 , 1.25, 0.5 , 1.25]])
    """
    return Grain(as_event("grain", event), samples, rate, unit)


class BurstParams(NamedTuple):
    n: float  # samples
    ramp: float  # samples of each flank


class BurstState(NamedTuple):
    k: np.uint64  # sample of the burst
    height: float


@dataclass(frozen=True, eq=False)
class Burst(Block):
    """height sin^2(pi/2 min(t, n - t, ramp)/ramp) with t = k + 1/2 for its sample k: as long before the middle as after."""

    event: Block
    duration: float
    ramp: float

    def check(self):
        positive(self, "duration")
        if not 0 <= self.ramp <= self.duration / 2:
            raise BadValue(
                f"burst: ramp = {self.ramp:g} s must be from 0 to half of duration = {self.duration:g} s: one ramp at each end"
            )

    def design(self, fs):
        n = round(self.duration * fs)
        if n < 1:
            raise BadValue(f"burst: duration = {self.duration:g} s is less than half a sample at fs = {fs:g} Hz")
        return BurstParams(float(n), min(max(0.5, self.ramp * fs), n / 2)), BurstState(U(n), 0.0)

    @staticmethod
    def step(p, s, event):
        k = where(event == 0.0, s.k, NONE)
        height = where(event == 0.0, s.height, event)
        t = as_float(k) + 0.5
        edge = where(t < p.n - t, t, p.n - t) / p.ramp
        v = sinpi(0.5 * where(edge > 0.0, where(edge < 1.0, edge, 1.0), 0.0))
        runs = where(as_float(k) < p.n, 1.0, 0.0)
        return where(runs > 0.0, height * (v * v), 0.0), BurstState(where(runs > 0.0, k + ONE, k), height)


def burst(start, duration: float, ramp: float = 0.0) -> Block:
    """An envelope that is open for a while after each event, with ramps of a raised cosine: times a signal, a burst of it.

    Parameters
    ----------
    start : Block or float
        An event, whose height is that of the envelope; or a time in s, for one burst.  An event within a burst restarts it.
    duration : float
        From the start of the first ramp to the end of the last, in s, rounded to whole samples.
    ramp : float
        Length of each ramp in s, at most half the duration.

    Returns
    -------
    Block
        In the unit of start.  Its sum is that of a rectangle as long as duration - ramp.

    Raises
    ------
    BadValue
        A duration not above 0, a ramp that does not fit into it, what is known to be no event; at compile time, a duration of
        less than half a sample.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import burst
    >>> proc = stimlib.compile(stimlib.Scene({"y": burst(0.001, duration=0.005, ramp=0.002)}), fs=1000)
    >>> proc.process(np.empty((0, 7))).round(3)
    array([[0.   , 0.146, 0.854, 1.   , 0.854, 0.146, 0.   ]])
    """
    return Burst(as_event("burst", start if isinstance(start, Block) else at(start)), duration, ramp)


CURVE = 1.5
"""Time constants in an attack: what it rises towards is above 1 by 1/(exp(1.5) - 1)."""
FULL = 1 - 1e-9
"""An attack ends here: by rounding it could come a sample late."""


class EnvelopeParams(NamedTuple):
    rise: float
    top: float
    fall: float
    sustain: float
    release: float


class EnvelopeState(NamedTuple):
    y: float
    stage: float  # 0 released, 1 attack, 2 decay and sustain
    gate: float


@dataclass(frozen=True, eq=False)
class Envelope(Block):
    """y += g (target - y) with the g and target of its stage; a gate that opens starts the attack from where y is."""

    gate: Block
    attack: float
    decay: float
    sustain: float
    release: float

    def check(self):
        for name in ("attack", "decay", "sustain", "release"):
            if not getattr(self, name) >= 0:
                raise BadValue(f"envelope: {name} = {getattr(self, name):g} must be 0 or above")

    def units(self, *u):
        return un.ONE

    def design(self, fs):
        rise, fall, release = (
            -math.expm1(-1 / (t * fs)) if t * fs > 1e-3 else 1.0 for t in (self.attack / CURVE, self.decay, self.release)
        )
        return EnvelopeParams(rise, -1 / math.expm1(-CURVE), fall, self.sustain, release), EnvelopeState(0.0, 0.0, 0.0)

    @staticmethod
    def step(p, s, gate):
        on = where(gate > 0.0, 1.0, 0.0)
        stage = where(on > 0.0, where(s.gate > 0.0, s.stage, 1.0), 0.0)
        target = where(stage == 1.0, p.top, where(stage == 2.0, p.sustain, 0.0))
        g = where(stage == 1.0, p.rise, where(stage == 2.0, p.fall, p.release))
        y = s.y + fma(g, target - s.y, TINY)
        full = where(stage == 1.0, where(y >= FULL, 1.0, 0.0), 0.0)
        y = where(full > 0.0, 1.0, y)
        return flush(y), EnvelopeState(y, where(full > 0.0, 2.0, stage), on)


def envelope(gate, attack: float = 0.005, decay: float = 0.05, sustain: float = 1.0, release: float = 0.05) -> Block:
    """Attack, decay, sustain, release: how strong something is while a gate is open, and after.

    Parameters
    ----------
    gate : Block
        Open where it is above 0.  One that opens again starts a new attack from where the envelope is.
    attack : float
        Time to 1 in s, along an exponential.
    decay, release : float
        Time constants in s of the way to the sustain level, and to 0 after the gate closes.
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
    >>> shape = envelope(stimlib.Input("gate"), attack=0.002, decay=0.001, sustain=0.5, release=0.001)
    >>> proc = stimlib.compile(stimlib.Scene({"y": shape}), fs=1000)
    >>> proc.process(np.array([[1.0, 1.0, 1.0, 1.0, 0.0, 0.0]])).round(3)
    array([[0.679, 1.   , 0.684, 0.568, 0.209, 0.077]])
    """
    gate = as_signal("envelope", gate, "hold it open with burst(event, duration)")
    return Envelope(as_block(gate), attack, decay, sustain, release)
