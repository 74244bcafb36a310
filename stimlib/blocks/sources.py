"""Sources: chirps, recordings, band noise, and transients that events start."""

from __future__ import annotations

import math
import os
from collections import namedtuple
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..core.graph import NONE, ONE, Block, Const, below_half, in_unit, stated, unitless
from ..core.maths import SILENT, TINY, as_float, exp, floor, flush, fma, where
from ..core.response import backward
from ..core.units import unit
from ..design import responses
from ..design.filters import HALF, resampled
from ..errors import Above0, BadValue, one_of, public, shortened
from ..system.limits import limits
from .clock import Time
from .events import as_event, as_signal, happens
from .filters import Cascade, Filter
from .impedance import with_unit
from .movement import regular, sinpi
from .noise import white_noise
from .oscillators import two_words

# Sources that run by themselves -----------------------------------------------------
# What runs by itself: sweeps, recordings, and noise of a band.
U, INT = np.uint64, np.int64


# Parameters of `Chirp` at a sample rate.
#   n  samples
#   a  turns a sample at first, in two words
#   b  half of what it grows by each sample, in two words
#   k  of an exponential one: turns = k (exp(c n) - 1)
ChirpParams = namedtuple("ChirpParams", "fs n a a_low b b_low k c")


@dataclass(frozen=True, eq=False)
class Chirp(Block):
    """A chirp: a sine whose frequency changes linearly or exponentially with time.

    sin of 2 pi (a n + b n^2), or of 2 pi k (exp(c n) - 1), while it lasts.
    """

    t: Block
    f0: Above0
    f1: Above0
    seconds: Above0
    kind: str
    live = "oscillator(freq) has a frequency that moves"

    def check(self):
        one_of("chirp: kind", self.kind, ("linear", "exponential"))

    units = unitless

    def design(self, fs):
        below_half("chirp", fs, f0=self.f0, f1=self.f1)
        f0, f1, rate = Fraction(self.f0), Fraction(self.f1), Fraction(fs)
        a, b = two_words(f0 / rate), two_words((f1 - f0) / (2 * Fraction(self.seconds) * rate**2))
        k = c = 0.0
        if self.kind == "exponential" and self.f0 != self.f1:
            c = math.log(self.f1 / self.f0) / (self.seconds * fs)
            k = self.f0 / (fs * c)
        return ChirpParams(fs, self.seconds * fs, *a, *b, k, c), ()

    @staticmethod
    def step(p, s, t):
        n = floor(t * p.fs + 0.5)
        rise = p.b * n
        rate = p.a + rise
        grown = rate - p.a
        took = (p.a - (rate - grown)) + (rise - grown)  # what rounding took from the sum
        small = took + (fma(p.b, n, -rise) + (p.a_low + p.b_low * n))
        turns = rate * n
        linear = (turns - floor(turns)) + (fma(rate, n, -turns) + small * n)
        x = where(p.k == 0.0, linear, p.k * (exp(p.c * n) - 1.0)) + 0.25
        z = x - floor(x)
        y = sinpi(where(z < 0.5, 2.0 * z - 0.5, 1.5 - 2.0 * z))
        return where(n >= 0.0, where(n < p.n, y, 0.0), 0.0), s


@public
def chirp(f0: float, f1: float, seconds: float, kind: str = "linear") -> Block:
    """Make a sine whose frequency sweeps from sample 0 on; 0 after its end.

    Parameters
    ----------
    f0, f1 : float
        Frequency at the start and the end in Hz.
    seconds : float
        How long it lasts.
    kind : {"linear", "exponential"}
        The frequency, or its logarithm, changes evenly.

    Returns
    -------
    Block
        Without unit, between -1 and 1.

    Raises
    ------
    BadValue
        A number not above 0, an unknown kind; at compile time, a frequency not below
        fs/2.

    Notes
    -----
    Its phase is computed from the sample's index, nothing adds up: a linear sweep is
    exact to 1e-15 turns for days (with JAX, and an exponential one anywhere, to 1e-15
    of its turns, divided by abs(log(f1/f0)) where that is below 1).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import chirp
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": chirp(10, 50, seconds=1.0)}), fs=1000
    ... )
    >>> y = proc.process(np.empty((0, 1001)))[0]
    >>> np.sum(np.diff(np.sign(y[1:-1])) != 0), y[-1]  # half periods: 2 x 30 Hz
    (np.int64(60), np.float64(0.0))
    """
    return Chirp(Time(), f0, f1, seconds, kind)


FINE = 2**17
"""Samples of the turns of a loop that is no whole number of samples: 1 MB."""


# Parameters of `Playback` at a sample rate.
#   samples  of a loop, those of several turns where one is no whole number of them
PlaybackParams = namedtuple("PlaybackParams", "fs samples loop")


@dataclass(frozen=True, eq=False)
class Playback(Block):
    """The samples of a recording, one after another."""

    t: Block
    samples: np.ndarray
    rate: Above0
    loop: bool
    unit: str
    rests = True

    def check(self):
        if self.samples.ndim != 1 or not self.samples.size:
            raise BadValue(
                f"playback: samples must be one row of numbers, got shape {self.samples.shape}"
            )

    units = stated

    def design(self, fs):
        limits.check(
            "state_bytes",
            8 * self.samples.size * fs / self.rate,
            f"playback: bytes of its samples at fs = {fs:g} Hz",
        )
        if not self.loop or fs == self.rate:
            table = resampled(self.samples, self.rate, fs, name="playback")
            return PlaybackParams(fs, table, float(self.loop)), ()
        p, _ = Scanned(self.t, self.samples, self.rate, True, self.unit).design(fs)
        length = self.samples.size * Fraction(fs) / Fraction(self.rate)
        most = max(1, int(FINE / length))
        # samples over turns, nearest to the length of a turn
        size, turns = max(length.limit_denominator(most), Fraction(1, most)).as_integer_ratio()
        at = np.arange(size) * (int(p.size) * turns)
        y = between(p.samples, at // size % int(p.size), at % size / size)
        return PlaybackParams(fs, y, 1.0), ()

    @staticmethod
    def step(p, s, t):
        size = as_float(U(p.samples.size))
        n = floor(t * p.fs + 0.5)
        k = where(p.loop > 0.0, n - size * floor(n / size), n)
        inside = where(n >= 0.0, where(k < size, 1.0, 0.0), 0.0)
        return where(inside > 0.0, p.samples[INT(where(inside > 0.0, k, 0.0))], 0.0), s


OVER = 8
"""Samples of a table between two of a recording: six of them in a row carry a
polynomial that is exact to 1e-5.
"""
# the samples of the table that are read before its beginning, and from its end on
BEFORE, AFTER = 2, 4


# Parameters of `Scanned` at a sample rate.
#   rate  of the table, Hz
#   size  without those before and after
ScannedParams = namedtuple("ScannedParams", "rate samples size loop")


def between(x, k, d):
    """Return Lagrange's polynomial through x[k] .. x[k + 5], evaluated at k + 2 + d."""
    a, b, e, f, g = d + 2.0, d + 1.0, d - 1.0, d - 2.0, d - 3.0
    ends = b * f * (a * x[k + 5] - g * x[k]) / 120.0
    outer = d * e * (ends + a * g * (f * x[k + 1] - b * x[k + 4]) / 24.0)
    return outer + a * b * f * g * (d * x[k + 3] - e * x[k + 2]) / 12.0


@dataclass(frozen=True, eq=False)
class Scanned(Block):
    """A recording, interpolated at the times that a signal gives.

    It interpolates between the samples of a table at 8 times the recording's rate.
    """

    t: Block
    samples: np.ndarray
    rate: Above0
    loop: bool
    unit: str

    check = Playback.check

    def units(self, *u):
        in_unit("playback: at", self.t, u[0], "s")
        return unit(self.unit)

    def design(self, fs):
        limits.check("state_bytes", 8 * OVER * self.samples.size, "playback: bytes of its table")
        n, more = self.samples.size, 1
        if self.loop:  # so far does the window reach
            wide = HALF * max(1.0, self.rate / fs)
            what = (
                f"playback: operations for {n} samples in a loop at rate = {self.rate:g} Hz, for fs"
                f" = {fs:g} Hz"
            )
            limits.check(
                "design_work",
                16 * wide * (n + 2 * wide),
                f"{what} (resample them before, or raise fs)",
            )
            more = math.ceil(wide) + 1
        x = np.pad(self.samples, more, "wrap" if self.loop else "constant")
        table = resampled(x, self.rate, OVER * self.rate, fs, "playback")[
            OVER * more - BEFORE : OVER * (more + n) + AFTER
        ]
        return ScannedParams(OVER * self.rate, table, float(OVER * n), float(self.loop)), ()

    @staticmethod
    def step(p, s, t):
        u = t * p.rate
        whole = floor(u)
        k = where(p.loop > 0.0, whole - p.size * floor(whole / p.size), whole)
        inside = where(k >= 0.0, where(k < p.size, 1.0, 0.0), 0.0)
        y = between(
            p.samples, INT(where(inside > 0.0, k, 0.0)), where(inside > 0.0, u - whole, 0.0)
        )
        return where(t - t == 0.0, where(inside > 0.0, y, 0.0), t - t), s


def rate_of(name: str, samples, rate: float | None) -> float:
    """Return the rate of a recording, after checking that there is one, and no file.

    A scene keeps samples, not the name of a file, which may change.
    """
    if isinstance(samples, str | os.PathLike):
        raise BadValue(
            f"{name}: samples = {shortened(str(samples))} is the name of a file; read it first: _,"
            " channels, fs = stimlib.files.as_scene(path), then give channels['channel1'] and fs"
        )
    if rate is None:
        raise BadValue(f"{name}: rate is missing; give the sample rate of the samples in Hz")
    return rate


@public
def playback(
    samples,
    rate: float | None = None,
    loop: bool = False,
    unit: str = "",
    at: Block | float | None = None,
) -> Block:
    """Play a recording from sample 0 on, or at the times that a signal gives.

    A recording with another sample rate is resampled with a band limit.

    Frequencies below 0.45 times the lower of both rates are kept to 1e-5, and those
    above 0.55 times that rate are removed. ``grain`` plays a recording at each event.

    Parameters
    ----------
    samples : array_like, shape (n,)
        Numbers; of a sound file, a channel of what ``stimlib.files.as_scene`` or a
        column of what ``soundfile.read`` gives.  Whole numbers of PCM, as of
        ``scipy.io.wavfile``, are taken as they are: divide 16 bits by 32768.
    rate : float
        Their sample rate in Hz.
    loop : bool
        Again and again, without a seam.  A loop need not be a whole number of samples
        of fs: its frequencies are off by less than 8e-6 of themselves, and exact where
        turns of it are a whole number of samples up to 131 072, such as 500 samples at
        44.1 kHz, whose 147 turns are 80 000 at 48 kHz.
    unit : str
        Of the samples.
    at : Block, optional
        Which time of the recording is heard, in s, from 0 to n/rate; by default the
        time since sample 0.  ``integrate(speed)`` plays at a speed that moves, 1 for
        that of the recording and below 0 for backwards; ``x / constant(0.1, "m/s")``
        plays a texture along a place x that was recorded at 0.1 m/s.

    Returns
    -------
    Block
        0 before the beginning and after the end.

    Raises
    ------
    BadValue
        No samples, or none that are finite; the name of a file; no rate, or one not
        above 0; an event for ``at``.
    UnitError
        ``at`` in another unit than s.

    Notes
    -----
    With ``at`` the recording lies in a table at 8 times its rate, between whose samples
    a polynomial of degree 5 runs: that adds 1e-5 to the error.  It holds at every speed
    up to 1.  At a speed v above 1 what lies beyond fs/(2 v) comes back as an alias:
    take it out of the samples first.  A loop is n/rate seconds long, not rounded.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import playback
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": playback([1.0, 2.0, 3.0], rate=1000, loop=True)}),
    ...     fs=1000,
    ... )
    >>> proc.process(np.empty((0, 5)))
    array([[1., 2., 3., 1., 2.]])

    A texture that was recorded at 0.1 m/s, along a finger's way:

    >>> from stimlib import Input, constant
    >>> finger = playback(
    ...     [1.0, 2.0, 3.0],
    ...     rate=1000,
    ...     loop=True,
    ...     at=Input("x", "m") / constant(0.1, "m/s"),
    ... )
    >>> stimlib.compile(stimlib.Scene({"y": finger}), fs=1000).process(
    ...     np.array([[0.0, 1e-4, 2e-4, 4e-4, 0.0]])
    ... ).round(4)
    array([[1., 2., 3., 2., 1.]])
    """
    rate = rate_of("playback", samples, rate)
    if at is None:
        return Playback(Time(), samples, rate, loop, unit)
    return Scanned(
        as_signal("playback: at", at, "give a time, such as integrate(speed)"),
        samples,
        rate,
        loop,
        unit,
    )


@dataclass(frozen=True, eq=False)
class BandNoise(Cascade):
    """White noise through a Butterworth band-pass, scaled by sqrt(psd fs/2).

    The one-sided PSD of the white noise is 2/fs.
    """

    white: Block
    low: float
    high: float
    psd: Above0
    order: int

    def check(self):
        self._filter()

    def _filter(self) -> Filter:
        return Filter(
            self.white, "bandpass", self.low, self.high, self.order, "butterworth", 1.0, 60.0
        )

    def design(self, fs):
        p, s = self._filter().design(fs)
        gain = math.sqrt(self.psd * fs / 2)
        first = np.r_[gain, np.ones(p.a.size - 1)]  # in the first section
        with np.errstate(invalid="raise"):  # a gain beyond a float, times a 0
            return p._replace(h0=first * p.h0, e1=first * p.e1, e0=first * p.e0), s


@public
def band_noise(
    low: float,
    high: float,
    psd: float,
    seed: int,
    stream: int = 0,
    order: int = 4,
    shared: bool = False,
) -> Block:
    """Make noise between two frequencies, with a level independent of the sample rate.

    Parameters
    ----------
    low, high : float
        Edges in Hz, where the PSD is half.
    psd : float
        One-sided power spectral density between them, in units^2/Hz: its mean square is
        nearly psd (high - low).
    seed, stream : int
        Key of its white noise.
    order : int
        Of each flank, as of ``bandpass``.
    shared : bool
        See ``white_noise``.

    Returns
    -------
    Block
        Without unit.  It begins at rest 32 ms before sample 0, and has its level after
        some 1/(high - low) seconds.

    Raises
    ------
    BadValue
        As of ``bandpass``; psd not above 0.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import band_noise
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": band_noise(100, 300, psd=1e-2, seed=1)}), fs=8000
    ... )
    >>> y = proc.process(np.empty((0, 80000)))[0]
    >>> bool(abs(np.mean(y**2) / (1e-2 * 200) - 1) < 0.1)
    True
    """
    return BandNoise(white_noise(seed, stream, shared), low, high, psd, order)


# Transients that events start -------------------------------------------------------
# What events make: decaying sinusoids and recorded transients.


# Parameters of `Ring` at a sample rate.
#   per  1/fs
RingParams = namedtuple("RingParams", "per sine")

# State of `Ring` between samples.
RingState = namedtuple("RingState", "re im")

# Coefficients of the rotation p for a frequency and a decay.
#   e      1 - real part
#   w      imaginary part
#   wrong  0, or nan
Turn = namedtuple("Turn", "e w wrong")


def turn(p, freq, decay):
    """Return the coefficients at one sample."""
    r = freq * p.per
    r = where(r > 0.0, where(r < 0.5, r, 0.5), 0.0)
    rho = exp(-p.per / where(decay > p.per, decay, p.per))
    si, co = sinpi(r), sinpi(0.5 - r)
    return Turn(
        fma(2.0 * rho * si, si, 1.0 - rho), 2.0 * rho * si * co, (freq + decay) - (freq + decay)
    )


def turned(p, t, s, event):
    """Return the output at one sample, and the new state."""
    re = s.re + (event + fma(-t.e, s.re, fma(-t.w, s.im, TINY)))
    im = s.im + fma(-t.e, s.im, fma(t.w, s.re, TINY))
    return where(t.wrong == 0.0, flush(where(p.sine > 0.0, im, re)), t.wrong), RingState(re, im)


def rests(s, event):
    """Return 1 where the ring is silent and no event occurs, else 0.

    In that case the state is kept and the output is 0.
    """
    return where(
        event == 0.0, where(abs(s.re) <= SILENT, where(abs(s.im) <= SILENT, 1.0, 0.0), 0.0), 0.0
    )


@dataclass(frozen=True, eq=False)
class Ring(Block):
    """Decaying sinusoids: the real or imaginary part of q[n] = p q[n-1] + event.

    p = exp(-1/(decay fs)) exp(2 pi i freq/fs).

    Multiplying by p never makes q larger, so frequency and decay may change at every
    sample.
    """

    event: Block
    freq: Block
    decay: Block
    onset: str
    rated = "ring: freq"

    def check(self):
        one_of("ring: onset", self.onset, ("sine", "cosine"))
        for name, v in (("freq", self.freq), ("decay", self.decay)):
            if isinstance(v, Const) and not v.value > 0:
                raise BadValue(f"ring: {name} = {v.value:g} must be above 0")

    def units(self, *u):
        in_unit("ring: freq", self.freq, u[1], "Hz")
        in_unit("ring: decay", self.decay, u[2], "s")
        return u[0]

    def design(self, fs):
        return RingParams(1 / fs, float(self.onset == "sine")), RingState(0.0, 0.0)

    def laws(self, fs):
        f, decay = self.freq, self.decay
        if isinstance(f, Const) and isinstance(decay, Const) and decay.value * fs >= 1:
            return (responses.ring(f.value, decay.value, self.onset),)
        return ()

    def through(self, p, fs, z, H, value):
        if value[1] is None or value[2] is None or H[0] is None:
            return None
        leak = 1 / max(value[2] * fs, 1.0)
        # p - 1, and its conjugate
        turned = [np.expm1(s * 2j * np.pi * value[1] / fs - leak) for s in (1, -1)]
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
    """Make a decaying sinusoid at each event; these may overlap.

    Use it for a click, a tap, or a struck mode.

    Parameters
    ----------
    event : Block
        Its height is the amplitude.
    freq : float or Block
        In Hz; a signal is held in 0 .. fs/2.
    decay : float or Block
        Time constant in s: after it 1/e is left.  It is held at one sample and above.
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


# Parameters of `Grain` at a sample rate.
GrainParams = namedtuple("GrainParams", "shape")

# State of `Grain` between samples.
#   ahead  what is to come, in a ring
#   left   samples until all of it is 0
GrainState = namedtuple("GrainState", "ahead at left")


def add(height, shape, line):
    """Add a scaled transient to a line, up to the end of the line."""
    for j in range(line.size):
        line[j] = fma(height, shape[j], line[j])


@dataclass(frozen=True, eq=False)
class Grain(Block):
    """A transient added at each event, y[n] = sum of event[k] shape[n - k].

    The sum is in the order of the events. During silence nothing is computed.
    """

    event: Block
    samples: np.ndarray
    rate: Above0
    unit: str

    def check(self):
        if self.samples.ndim != 1 or not self.samples.size:
            raise BadValue(
                f"grain: samples must be one row of numbers, got shape {self.samples.shape}"
            )

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
def grain(event: Block | float, samples, rate: float | None = None, unit: str = "") -> Block:
    """Play a recorded transient at each event; these may overlap.

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
        No samples, or none that are finite; the name of a file; no rate, or one not
        above 0; what is known to be no event.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import every, grain
    >>> scene = stimlib.Scene({"y": grain(every(0.002), [1.0, 0.5, 0.25], rate=1000)})
    >>> stimlib.compile(scene, fs=1000).process(np.empty((0, 5)))
    array([[1.  , 0.5 , 1.25, 0.5 , 1.25]])
    """
    return Grain(as_event("grain", event), samples, rate_of("grain", samples, rate), unit)
