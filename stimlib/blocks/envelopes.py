"""What opens and closes: bursts with ramps, and envelopes of a gate."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from ..core.graph import NONE, ONE, Block, as_block, unitless
from ..core.maths import TINY, as_float, flush, fma, where
from ..errors import Above0, BadValue, From0, public
from .clock import at
from .events import as_event, as_signal, happens
from .movement import sinpi

U = np.uint64

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
    rests = True

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

    step = staticmethod(opened)

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
    y = where(full > 0.0, where(s.y > 1.0, s.y, 1.0), y)
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
    rests = True
    begins_early = False  # an attack that has passed before sample 0 would be a jump

    units = unitless

    def design(self, fs):
        rise, fall, release = (
            -math.expm1(-1 / (t * fs)) if t * fs > 1e-3 else 1.0
            for t in (self.attack / CURVE, self.decay, self.release)
        )
        return EnvelopeParams(
            rise, -1 / math.expm1(-CURVE), fall, self.sustain, release
        ), EnvelopeState(0.0, 0.0)

    step = staticmethod(followed)

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
        Open where it is above 0.  One that is open at sample 0 starts its attack there,
        and one that opens again from where the envelope is.
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
