"""Oscillators: the carrier, waveforms and pulse trains."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from ..core import units as un
from ..core.graph import NONE, ONE, Block, Const, as_block, in_unit, scratch, unitless
from ..core.maths import as_float, floor, fma, where, words
from ..core.parameter import Param
from ..core.program import lead
from ..core.subsystems import segment
from ..errors import BadValue, From0, one_of, public
from .events import Event
from .impedance import with_unit
from .movement import sinpi

# The carrier ------------------------------------------------------------------------
# The carrier that envelopes modulate, sampled by area: a sample is the mean over one
# sample period.
#
# Only sums and products are used, no mathematical library, so that the bits are the
# same on every machine.
U, INT = np.uint64, np.int64

RECTIFY = (None, "half", "full")
QUARTER, SHIFT_11 = U(1 << 62), U(11)
WORD, HALF_TURN = 2.0**-64, 2.0**-53


# Parameters of `Carrier` at a sample rate.
#   high  2^64/fs to 106 bits
#   top   fs/2
#   mode  0, 1, 2: not rectified, half, full
#   inc   of the phase, if freq is a number (fixed > 0)
CarrierParams = namedtuple("CarrierParams", "high low top mode fixed inc")

# State of `Carrier` and `Oscillator` between samples.
#   phase  in 2^-64 turns, of the next sample
#   wait   samples before sample 0, which do not count
CarrierState = namedtuple("CarrierState", "phase wait")


def two_words(v: Fraction) -> tuple[float, float]:
    """Return a number as a sum of two floats, accurate to 106 bits."""
    high = float(v)
    return high, float(v - Fraction(high))


def phase_word(phase: float) -> np.uint64:
    """Convert a phase in rad to units of 2^-64 turns."""
    return U(round(Fraction(phase) / Fraction(2 * math.pi) * 2**64) % 2**64)


def increment(p, f):
    """Return the rounded phase increment per sample in units of 2^-64 turns.

    The frequency is clipped to 0 .. fs/2; NaN counts as 0.
    """
    g = where(f > 0.0, where(f < p.top, f, p.top), 0.0)
    main = g * p.high
    whole = floor(main)
    rest = floor((main - whole) + fma(g, p.low, fma(g, p.high, -main)) + 0.5)
    return U(whole) + U(INT(rest))


def fold(phase):
    """Return the height t (-1/2 .. 1/2) of a phase, where sin(phase) = sin(pi t)."""
    x = as_float((phase + QUARTER) >> SHIFT_11) * HALF_TURN
    return where(x < 0.5, 2.0 * x - 0.5, 1.5 - 2.0 * x)


def lobe(t, q, r):
    """Return the positive half of a sine, and 0 elsewhere.

    A sample that straddles a zero crossing, of half width q, gets the fraction of the
    area that is above 0; r = 1/sin(pi q).
    """
    s = sinpi(where(t >= q, t, 0.5 * (t + q)))
    return where(t >= q, s, where(t > -q, s * s * r, 0.0))


def rectified(mode, t, q, r):
    """Return the carrier, rectified or not, from its height t."""
    other = where(mode > 1.0, lobe(-t, q, r), 0.0)
    return where(mode > 0.0, lobe(t, q, r) + other, sinpi(t))


@dataclass(frozen=True, eq=False)
class Carrier(Block):
    """A sinusoid whose phase is counted in 2^-64 turns, optionally rectified by area.

    It is 0 off contact, while the phase goes on.
    """

    freq: Block
    contact: Block
    rectify: str | None
    phase: float

    @property
    def rated(self) -> str:
        return f"{'carrier' if self.rectify else 'oscillator or carrier'}: freq"

    def check(self):
        one_of("carrier: rectify", self.rectify, RECTIFY)
        check_freq(self.rated, self.freq)

    units = unitless

    def resting(self, contact):
        # a frequency that is NaN must be heard, as it is of a product with 0
        steady = isinstance(self.freq, Const | Param)
        always = isinstance(self.contact, Const) and self.contact.value > 0.0
        return replace(self, contact=contact) if steady and always else None

    def design(self, fs):
        wait = lead(fs) if self.autonomous else 0
        p = CarrierParams(
            *two_words(Fraction(2**64) / Fraction(fs)),
            fs / 2,
            float(RECTIFY.index(self.rectify)),
            0.0,
            NONE,
        )
        if isinstance(self.freq, Const):
            with np.errstate(over="ignore"):
                p = p._replace(fixed=1.0, inc=increment(p, self.freq.value))
        return p, CarrierState(phase_word(self.phase), U(wait))

    @staticmethod
    def step(p, s, f, contact):
        inc = increment(p, f)
        q = as_float(inc) * WORD
        y = where(f - f == 0.0, rectified(p.mode, fold(s.phase), q, 1.0 / sinpi(q)), f - f)
        early = s.wait > NONE
        after = CarrierState(where(early, s.phase, s.phase + inc), where(early, s.wait - ONE, NONE))
        return where(contact > 0.0, y, 0.0), after

    work = scratch(128)

    @staticmethod
    def tile(p, s, f, contact, y, w):
        phases, steps, phase, wait = words(w[:64]), words(w[64:]), s.phase, s.wait
        equal, touching, inc = U(y.size), NONE, p.inc
        for i in range(y.size):
            touching = touching + where(contact[i] > 0.0, ONE, NONE)
        if p.fixed == 0.0:
            equal, inc = NONE, increment(p, f[0])
            for i in range(y.size):
                equal = equal + where(f[i] == f[0], ONE, NONE)
        if equal == U(y.size) and wait == NONE:  # as nearly always
            if touching == NONE:
                y[:] = 0.0
                return CarrierState(phase + U(y.size) * inc, wait)
            q = as_float(inc) * WORD
            r, bad = 1.0 / sinpi(q), f[0] - f[0]
            if p.mode == 0.0:
                for i in range(y.size):
                    y[i] = where(contact[i] > 0.0, sinpi(fold(phase + U(i) * inc)), 0.0)
            elif p.mode == 1.0:
                for i in range(y.size):
                    y[i] = where(contact[i] > 0.0, lobe(fold(phase + U(i) * inc), q, r), 0.0)
            else:
                for i in range(y.size):
                    y[i] = where(
                        contact[i] > 0.0, rectified(p.mode, fold(phase + U(i) * inc), q, r), 0.0
                    )
            if bad != 0.0:
                for i in range(y.size):
                    y[i] = where(contact[i] > 0.0, bad, 0.0)
            return CarrierState(phase + U(y.size) * inc, wait)
        for i in range(y.size):
            steps[i] = increment(p, f[i])
        for i in range(y.size):
            phases[i] = phase
            early = wait > NONE
            phase, wait = where(early, phase, phase + steps[i]), where(early, wait - ONE, NONE)
        for i in range(y.size):
            q = as_float(steps[i]) * WORD
            z = where(
                f[i] - f[i] == 0.0,
                rectified(p.mode, fold(phases[i]), q, 1.0 / sinpi(q)),
                f[i] - f[i],
            )
            y[i] = where(contact[i] > 0.0, z, 0.0)
        return CarrierState(phase, wait)


@public
def carrier(
    freq: Block | float,
    rectify: str | None = None,
    phase: float = 0.0,
    contact: Block | float = 1.0,
) -> Block:
    """Make a sinusoid of unit amplitude whose phase is exact for days.

    The phase is counted in 2^-64 turns; its error grows by at most 2^-65 turns per
    sample, 1.2e-10 rad in 24 h at 8 kHz. Sample n is taken at the phase accumulated
    from the frequencies of samples 0 .. n-1, so a frequency that changes makes no jump.

    If it is rectified, each sample is the mean of the rectified sinusoid over the
    sample period around it, divided by sin(x)/x, x = pi freq/fs, the factor by which
    such a mean reduces a sinusoid of this frequency. So every sample but the two at the
    zero crossings lies on the sinusoid, the component at ``freq`` has its amplitude,
    1/2, and aliases are far lower than those of max(0, sin). The mean is higher than
    1/pi by a factor of 1 + x^2/6: 0.06 % for 158 Hz at 8 kHz.

    Parameters
    ----------
    freq : float or Block
        In Hz.  A signal is held in 0 .. fs/2, and ``verify`` counts where it is fs/2 or
        above; a parameter outside of 0 .. fs/2 is refused.
    rectify : {None, "half", "full"}
        The whole wave; its positive part; its absolute value.
    phase : float
        At sample 0, in rad.
    contact : Block
        Where it is not above 0 the output is 0 and nothing is computed; the phase goes
        on.

    Returns
    -------
    Block
        Without unit.

    Raises
    ------
    BadValue
        A frequency below 0; at compile time, or set later, also one not below fs/2.
    UnitError
        A signal that is not in Hz.

    Notes
    -----
    ``contact`` skips the work and keeps the phase tied to time.  Inside ``enabled``, on
    the other hand, the phase stands still while the block is off, like all state there.

    References
    ----------
    The touch-screen thesis, chapter 3: vibration at the plate's first resonance, 158
    Hz, of which "we only consider the positive parts".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import carrier
    >>> scene = stimlib.Scene(
    ...     {"c": carrier(1000.0), "half": carrier(1000.0, rectify="half")}
    ... )
    >>> stimlib.compile(scene, fs=8000).process(np.empty((0, 6))).round(4) + 0.0
    array([[ 0.    ,  0.7071,  1.    ,  0.7071,  0.    , -0.7071],
           [ 0.0995,  0.7071,  1.    ,  0.7071,  0.0995,  0.    ]])
    """
    return Carrier(with_unit(freq, "Hz"), as_block(contact), rectify, phase)


# Waveforms and pulse trains ---------------------------------------------------------
# Oscillators and pulse trains whose frequency may move: a phase is counted in 2^-64
# turns, so it keeps its digits for days.
TURN = 2.0**64
MOST = TURN - 2.0**11
UNREAD = U(2**64 - 1)  # above any mark
WAVEFORMS = ("triangle", "sawtooth", "square", "pulse")


def word(turns):
    """Convert a fraction of a turn, limited to 0 .. below 1, to 64-bit phase units."""
    x = turns * TURN
    return U(where(x > 0.0, where(x < MOST, x, MOST), 0.0))


# Parameters of `Oscillator` at a sample rate.
#   high      2^64/fs to 106 bits
#   top       fs/2
#   waveform  place in WAVEFORMS
OscillatorParams = namedtuple("OscillatorParams", "high low top waveform")


def check_freq(name: str, f: Block) -> None:
    """Raise BadValue if a frequency is below 0, and UnitError if it is not in Hz."""
    if isinstance(f, (Const, Param)) and not f.value >= 0:
        raise BadValue(f"{name} = {f.value!r} Hz must be 0 or above")
    in_unit(name, f, f.dim, "Hz")


def part(start, inc, d):
    """Return the fraction of the phase step start .. start + inc that lies below d."""
    end, rest = start + inc, d - start
    first = where(start < d, where(rest < inc, rest, inc), NONE)
    again = where(end < start, where(end < d, end, d), NONE)
    return where(
        inc > NONE,
        as_float(first + again) / as_float(where(inc > NONE, inc, ONE)),
        where(start < d, 1.0, 0.0),
    )


@dataclass(frozen=True, eq=False)
class Oscillator(Block):
    """A periodic wave: its mean over the sample period around each sample.

    Its phase is counted in 2^-64 turns.
    """

    freq: Block
    duty: Block
    waveform: str
    phase: float
    rated = "oscillator: freq"

    def check(self):
        if self.waveform not in WAVEFORMS:
            raise BadValue(
                f"oscillator: waveform = {self.waveform!r}; choose one of sine,"
                f" {', '.join(WAVEFORMS)}"
            )
        check_freq(self.rated, self.freq)
        if isinstance(self.duty, (Const, Param)) and not 0 < self.duty.value < 1:
            raise BadValue(f"oscillator: duty = {self.duty.value:g} must be above 0 and below 1")

    def units(self, *u):
        in_unit("oscillator: duty", self.duty, u[1], "")
        return un.ONE

    def design(self, fs):
        wait = lead(fs) if self.autonomous else 0
        p = OscillatorParams(
            *two_words(Fraction(2**64) / Fraction(fs)),
            fs / 2,
            float(WAVEFORMS.index(self.waveform)),
        )
        return p, CarrierState(phase_word(self.phase), U(wait))

    @staticmethod
    def step(p, s, f, duty):
        inc = increment(p, f)
        q = as_float(inc) * WORD
        begin = s.phase - (inc >> ONE)
        t = fold(s.phase)  # 0 where a sine is, 1/2 at its top
        over = 0.5 * q - 0.5 * (0.5 - abs(t))  # how far the period reaches beyond a corner
        cut = where(over > 0.0, 4.0 * over * over / where(q > 0.0, q, 1.0), 0.0)
        triangle = 2.0 * t - where(t < 0.0, -cut, cut)
        end = begin + inc
        # part after the jump
        beyond = where(end < begin, as_float(end) / as_float(where(inc > NONE, inc, ONE)), 0.0)
        sawtooth = fma(2.0 * WORD, as_float(begin), q - 1.0) - 2.0 * beyond
        pulse = part(begin, inc, word(duty))
        y = where(
            p.waveform == 0.0,
            triangle,
            where(p.waveform == 1.0, sawtooth, where(p.waveform == 2.0, 2.0 * pulse - 1.0, pulse)),
        )
        wrong = (f + duty) - (f + duty)
        early = s.wait > NONE
        after = CarrierState(where(early, s.phase, s.phase + inc), where(early, s.wait - ONE, NONE))
        return where(wrong == 0.0, y, wrong), after


@public
def oscillator(
    freq: Block | float,
    waveform: str = "sine",
    duty: Block | float = 0.5,
    phase: float = 0.0,
    onset: From0 = 0.0,
) -> Block:
    """Make a periodic wave between -1 and 1 whose phase is exact for days.

    All waveforms but the sine are sampled by area: a sample is the mean over the sample
    period around it. For a sawtooth of 200 Hz at 8 kHz this lowers the strongest alias
    by 4 dB, and the strongest below 1 kHz by 17 dB. A sine has no aliases.

    Parameters
    ----------
    freq : float or Block
        In Hz; a signal is held in 0 .. fs/2.
    waveform : {"sine", "triangle", "square", "sawtooth", "pulse"}
        "square" is 1 for the part ``duty`` of each period and then -1, "pulse" 1 and
        then 0; "sawtooth" rises from -1 to 1.
    duty : float or Block
        Of square and pulse.
    phase : float
        At the onset in rad; sine and triangle rise through 0 at phase 0.
    onset : float
        In s, at the nearest sample; before it the wave is 0.  So actuators that start
        one after another begin with the same phase.

    Returns
    -------
    Block
        Without unit.

    Raises
    ------
    BadValue
        An unknown waveform, a frequency below 0, a duty not between 0 and 1, an onset
        below 0; at compile time, a frequency not below fs/2.
    UnitError
        A frequency that is not in Hz, or a duty with a unit.

    Notes
    -----
    The error of the phase grows by at most 2^-65 turns a sample: 1.2e-10 rad in 24 h at
    8 kHz.  For a sine's rectified forms see ``carrier``, for envelopes tied to a place
    ``bump``.

    With an onset the wave runs in a ``segment``, as do the blocks of its frequency and
    duty: their times count from the onset, too.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import oscillator
    >>> scene = stimlib.Scene(
    ...     {w: oscillator(200, w) for w in ("triangle", "sawtooth", "square")}
    ... )
    >>> stimlib.compile(scene, fs=1000).process(np.empty((0, 5))).round(3) + 0.0
    array([[ 0.  ,  0.75,  0.4 , -0.4 , -0.75],
           [ 0.  , -0.6 , -0.2 ,  0.2 ,  0.6 ],
           [ 0.  ,  1.  ,  1.  , -1.  , -1.  ]])
    """
    freq = with_unit(freq, "Hz")
    wave = (
        carrier(freq, phase=phase)
        if waveform == "sine"
        else Oscillator(freq, as_block(duty), waveform, phase)
    )
    return segment(wave, onset) if onset else wave


# Parameters of `PulseTrain` at a sample rate.
TrainParams = namedtuple("TrainParams", "high low top")

# State of `PulseTrain` between samples.
#   phase  from the middle between two pulses
#   mark   where the pulse of this period lies; UNREAD before sample 0
TrainState = namedtuple("TrainState", "phase mark wait")


def passed(s, inc, later):
    """Return how many events one sample has, and the new state.

    inc is the step of the phase, later the mark of a period that begins now.
    """
    after = s.phase + where(s.wait > NONE, NONE, inc)
    wraps = after < s.phase
    own = where(s.mark == UNREAD, later, s.mark)
    mark = where(wraps, later, where(s.wait > NONE, s.mark, own))
    first = where(own >= s.phase, where(wraps, 1.0, where(own < after, 1.0, 0.0)), 0.0)
    second = where(wraps, where(mark < after, 1.0, 0.0), 0.0)
    return first + second, TrainState(after, mark, where(s.wait > NONE, s.wait - ONE, NONE))


@dataclass(frozen=True, eq=False)
class PulseTrain(Event):
    """A train of events, one per period, at the phase 1/2 + jitter.

    The jitter is read at the start of each period, so the order of events is kept and
    none is lost.
    """

    rate: Block
    jitter: Block
    rated = "pulse_train: rate"

    def check(self):
        check_freq(self.rated, self.rate)

    def units(self, *u):
        in_unit("pulse_train: jitter", self.jitter, u[1], "")  # a part of a period
        return un.ONE

    def design(self, fs):
        return TrainParams(*two_words(Fraction(2**64) / Fraction(fs)), fs / 2), TrainState(
            NONE, UNREAD, U(lead(fs) if self.autonomous else 0)
        )

    @staticmethod
    def step(p, s, rate, jitter):
        return passed(s, increment(p, rate), word(0.5 + jitter))

    work = scratch(128)

    @staticmethod
    def tile(p, s, rate, jitter, y, w):
        steps, marks = words(w[:64]), words(w[64:])
        for i in range(y.size):
            steps[i] = increment(p, rate[i])
        for i in range(y.size):
            marks[i] = word(0.5 + jitter[i])
        for i in range(y.size):
            y[i], s = passed(s, steps[i], marks[i])
        return s


@public
def pulse_train(rate: Block | float, jitter: Block | float = 0.0) -> Block:
    """Make events at a rate that may change, each optionally early or late.

    Parameters
    ----------
    rate : float or Block
        In Hz; a signal is held in 0 .. fs/2.  Without jitter the first event is half a
        period after sample 0.
    jitter : float or Block
        Which part of a period an event is late, from -1/2 to 1/2 (held there); read
        once for each, where its period begins. ``0.1 * white_noise(seed=1)`` makes it
        irregular without a drift.

    Returns
    -------
    Block
        1 at each event, else 0; 2 where jitter brings two together.

    Raises
    ------
    BadValue
        A rate below 0; at compile time, one not below fs/2.
    UnitError
        A rate that is not in Hz, a jitter with a unit.

    Notes
    -----
    An event may fall on a sample to the last digit: of 90 Hz at 8000 Hz every ninth one
    does.  Whether it is of that sample or of the one before, processor and interpreter
    decide by whole numbers; on JAX, whose compiler rounds as it likes, it may be
    either.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import pulse_train
    >>> proc = stimlib.compile(stimlib.Scene({"y": pulse_train(250)}), fs=1000)
    >>> proc.process(np.empty((0, 8)))
    array([[0., 0., 1., 0., 0., 0., 1., 0.]])
    """
    return PulseTrain(with_unit(rate, "Hz"), as_block(jitter))
