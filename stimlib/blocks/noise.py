"""Noise: white noise from a counter, and pink noise from a bank of modes."""

from __future__ import annotations

import math
import operator
from collections import namedtuple
from dataclasses import dataclass
from types import FunctionType

import numpy as np

from ..core.graph import NONE, ONE, Block, scratch
from ..core.maths import as_float, bits, copy, fma, modes, pairs, sqrt, unbits, where
from ..core.program import lead
from ..core.response import backward
from ..design import responses
from ..design.filters import asked_by
from ..design.noise import noise_modes, stationary_covariance, stationary_factor
from ..design.padding import padded
from ..errors import Above0, BadValue, public

# White noise ------------------------------------------------------------------------
# White noise as a function of (key, sample index): Philox4x32-10 and Box-Muller.
#
# Source: Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC
# 2011 (counter-based generators and known-answer vectors); Box and Muller 1958.
U = np.uint64
KEY_STEP_0, KEY_STEP_1 = U(0x9E3779B9), U(0xBB67AE85)
FACTOR_0, FACTOR_1 = U(0xD2511F53), U(0xCD9E8D57)
LOW, HALF_WORD = U(0xFFFFFFFF), U(32)
TWO = U(2)


def rounds(number, c0, c1, c2, c3, k0, k1):
    """Return counter and key after some rounds of Philox4x32.

    All words have 32 bits and are held in uint64.
    """
    for _ in range(number):
        a, b = FACTOR_0 * c0, FACTOR_1 * c2
        c0, c1, c2, c3 = (b >> HALF_WORD) ^ c1 ^ k0, b & LOW, (a >> HALF_WORD) ^ c3 ^ k1, a & LOW
        k0, k1 = (k0 + KEY_STEP_0) & LOW, (k1 + KEY_STEP_1) & LOW
    return c0, c1, c2, c3, k0, k1


def philox(c0, c1, c2, c3, k0, k1):
    """Return the Philox4x32-10 output for a 128-bit counter and a 64-bit key."""
    c0, c1, c2, c3, k0, k1 = rounds(10, c0, c1, c2, c3, k0, k1)
    return c0, c1, c2, c3


def swapped(w):
    """Return a 64-bit word with its halves swapped."""
    return (w << HALF_WORD) | (w >> HALF_WORD)


def pair_of_words(key, m):
    """Return the two 64-bit random words of pair m of a stream.

    They are c0 + 2^32 c1 and c2 + 2^32 c3 of ``philox``: its last round is written with
    whole products, whose halves change places at once.
    """
    c0, c1, c2, c3, k0, k1 = rounds(
        9, m & LOW, m >> HALF_WORD, NONE, NONE, key & LOW, key >> HALF_WORD
    )
    return swapped(FACTOR_1 * c2) ^ c1 ^ k0, swapped(FACTOR_0 * c0) ^ c3 ^ k1


# log((1+t)/(1-t))/t in t^2 for |t| < 0.1716;  cos(2 pi v), sin(2 pi v)/v in v^2 for |v|
# < 1/8: errors below 5e-17
L0, L1, L2, L3, L4 = (
    2.0,
    0.6666666666666666,
    0.40000000000007496,
    0.28571428568817636,
    0.22222222677146836,
)
L5, L6, L7, L8 = 0.18181773720945538, 0.15387161664597038, 0.13248746535494305, 0.1326225363958399
C1, C2, C3, C4 = -19.739208802178716, 64.93939402266795, -85.45681720652271, 60.244641328867296
C5, C6, C7 = -26.426250908622137, 7.903091687751697, -1.6968494702918826
S0, S1, S2, S3 = 6.283185307179586, -41.34170224039976, 81.60524927607493, -76.70585975299812
S4, S5, S6, S7 = 42.05869392898878, -15.094640403891546, 3.8197881201632113, -0.7116358090781666
LN_2, SQRT_2 = 0.6931471805599453, 1.4142135623730951
EXPONENT, MANTISSA, UNIT_FLOAT = U(52), U(0xFFFFFFFFFFFFF), U(0x3FF0000000000000)
SHIFT_11, SHIFT_62, BITS_51 = U(11), U(62), U(0x7FFFFFFFFFFFF)


def radius(a):
    """Return the Box-Muller radius sqrt(-2 log u) of a 64-bit word.

    u = (a + 1/2) 2^-64, so the radius is at most 9.49.
    """
    z = bits((as_float(a) + 0.5) * 5.421010862427522e-20)
    mantissa = unbits((z & MANTISSA) | UNIT_FLOAT)
    above = mantissa > SQRT_2
    m = where(above, mantissa * 0.5, mantissa)
    e = as_float(z >> EXPONENT) - where(above, 1022.0, 1023.0)
    t = (m - 1.0) / (m + 1.0)
    w = t * t
    q = fma(
        fma(fma(fma(fma(fma(fma(fma(L8, w, L7), w, L6), w, L5), w, L4), w, L3), w, L2), w, L1),
        w,
        L0,
    )
    return sqrt(-2.0 * fma(e, LN_2, q * t))


def turn(b):
    """Return the cosine and sine of b 2^-64 turns, up to a constant angle.

    Two bits choose the quarter turn, and 51 bits the angle within it.
    """
    quarter = b >> SHIFT_62
    v = (as_float((b >> SHIFT_11) & BITS_51) - 1125899906842624.0) * 1.1102230246251565e-16
    x = v * v
    c = fma(fma(fma(fma(fma(fma(fma(C7, x, C6), x, C5), x, C4), x, C3), x, C2), x, C1), x, 1.0)
    s = v * fma(fma(fma(fma(fma(fma(fma(S7, x, S6), x, S5), x, S4), x, S3), x, S2), x, S1), x, S0)
    odd = (quarter & ONE) != NONE
    x0, x1 = where(odd, s, c), where(odd, c, s)
    return where(((quarter + ONE) & TWO) != NONE, -x0, x0), where(quarter > ONE, -x1, x1)


def deviates(key, m):
    """Return the normal deviates 2m and 2m + 1 of a stream."""
    a, b = pair_of_words(key, m)
    r = radius(a)
    c, s = turn(b)
    return r * c, r * s


# the same on whole numbers of Python, whose arithmetic is five times as fast as numpy's
_rounds = FunctionType(
    rounds.__code__, {name: int(v) for name, v in globals().items() if isinstance(v, np.uint64)}
)


def noise_key(run_seed: int, seed: int, stream: int, use: int) -> np.uint64:
    """Return the 64-bit key of one use of a noise source in one run.

    It is the Philox output for (seed, stream, use), keyed by the seed of the run.
    """
    low = 0xFFFFFFFF
    c0, c1, *_ = _rounds(10, seed & low, seed >> 32, stream, use, run_seed & low, run_seed >> 32)
    return U(c0 | c1 << 32)


def normals(key: np.uint64, n: int) -> np.ndarray:
    """Return the first n normal deviates of a stream (for stationary starts)."""
    y = np.empty(n)
    with np.errstate(over="ignore"):
        pairs(deviates, key, U(0), y)
    return y


# State of `White` between samples.
#   n  index of the next sample; before sample 0 it counts up to 2^64
WhiteState = namedtuple("WhiteState", "key n")


class Deviates(Block, abstract=True):
    """Gaussian white noise: independent samples y[n] ~ N(0, 1).

    Deviates 2m and 2m+1 are the two Box-Muller deviates of Philox block m.
    """

    seed: int
    stream: int
    shared: bool

    def check(self):
        for name, top in (("seed", 2**64), ("stream", 2**32)):
            v = getattr(self, name)
            if not isinstance(v, int) or isinstance(v, bool) or not 0 <= v < top:
                raise BadValue(
                    f"white_noise: {name} = {v!r} must be a whole number from 0 to {top - 1}"
                )

    @property
    def noise_key(self) -> tuple[int, int]:
        """The pair (seed, stream), which must differ between a scene's sources."""
        return self.seed, self.stream

    def design(self, fs):
        return (), WhiteState(U(0), U(2**64 - lead(fs) if self.autonomous else 0))

    def start(self, p, s, seed):
        return WhiteState(noise_key(seed, self.seed, self.stream, 0), s.n)

    work = scratch(68)


@dataclass(frozen=True, eq=False)
class White(Deviates):
    """White noise that runs at every sample."""

    seed: int
    stream: int = 0
    shared: bool = False

    def resting(self, contact):
        return RestingWhite(contact, self.seed, self.stream, self.shared)

    @staticmethod
    def tile(p, s, y, w):
        odd = np.int64(s.n & ONE)
        if odd == 0 and y.size & 3 == 0:
            pairs(deviates, s.key, s.n >> ONE, y)
        else:
            pairs(deviates, s.key, s.n >> ONE, w[: y.size + odd])
            copy(w[odd : odd + y.size], y)
        return WhiteState(s.key, s.n + U(y.size))


@dataclass(frozen=True, eq=False)
class RestingWhite(Deviates, in_files=False):
    """White noise that is 0 where a signal is not above 0."""

    contact: Block
    seed: int
    stream: int
    shared: bool

    @staticmethod
    def tile(p, s, contact, y, w):
        sounds = NONE
        for i in range(y.size):
            sounds = sounds + where(contact[i] > 0.0, ONE, NONE)
        if sounds == NONE:
            y[:] = 0.0
            return WhiteState(s.key, s.n + U(y.size))
        # as `White`, again: a helper must not choose at run time, as a tile may
        odd = np.int64(s.n & ONE)
        if odd == 0 and y.size & 3 == 0:
            pairs(deviates, s.key, s.n >> ONE, y)
        else:
            pairs(deviates, s.key, s.n >> ONE, w[: y.size + odd])
            copy(w[odd : odd + y.size], y)
        if sounds < U(y.size):
            for i in range(y.size):
                y[i] = where(contact[i] > 0.0, y[i], 0.0)
        return WhiteState(s.key, s.n + U(y.size))


@public
def white_noise(seed: int, stream: int = 0, shared: bool = False) -> Block:
    """Make Gaussian white noise of unit variance, N(0, 1) per sample, at any rate.

    Its one-sided PSD is 2/fs, so what a filter lets through is weaker at a higher rate;
    ``band_noise`` has the same level at any rate.  Sample n depends only on (run seed,
    seed, stream, n).

    Parameters
    ----------
    seed, stream : int
        Together the source's key.  Two sources of one scene must not have the same.
    shared : bool
        Allow the same key twice, or one source on two clocks.

    Returns
    -------
    Block
        Without unit.

    Raises
    ------
    BadValue
        Keys out of range.

    References
    ----------
    The UGrip paper, section 1.1: "gaussian white noise n(s)".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import white_noise
    >>> proc = stimlib.compile(stimlib.Scene({"n": white_noise(seed=1)}), fs=8000)
    >>> proc.process(np.empty((0, 8000))).std().round(1)
    np.float64(1.0)
    """
    return White(seed, stream, shared)


# Pink noise -------------------------------------------------------------------------
# Banks of first-order modes: recursive LTI filters in parallel form, and pink noise
# made with one.
#
# The parallel form is exact to 1e-13 where multiplied-out sections lose 3-4 digits, and
# every mode is independent of the others. A pole near 1 keeps its leak 1 - p to
# 2^-53/(1 - p): far better than a spectrum needs.
# Parameters of `Modes` at a sample rate.
#   p  poles; padded with zeros to a multiple of 8
#   r  residues; padded with zeros
#   d  direct
ModesParams = namedtuple("ModesParams", "p r d")

# State of `Modes` between samples.
ModesState = namedtuple("ModesState", "q")


class Modes(Block, abstract=True):
    """A bank of first-order modes, q_k = p_k q_k + x; y = d x + sum_k r_k q_k."""

    work = scratch(512)

    @staticmethod
    def tile(p, s, x, y, w):
        modes(p.p, p.r, s.q, p.d, x, y, w)
        return s

    @staticmethod
    def transfer(p, z):
        z = z[..., None]
        return p.d + np.sum(p.r / (backward(z) + (1 - p.p) / z), axis=-1)


def bank(e: np.ndarray, r: np.ndarray, d: float) -> tuple[ModesParams, ModesState]:
    """Return the parameters and rest state of a bank of modes.

    They are padded to a multiple of eight modes.
    """
    p = padded(1.0 - e)
    return ModesParams(p, padded(r), float(d)), ModesState(np.zeros(p.size))


@dataclass(frozen=True, eq=False)
class Pinking(Modes):
    """A 3 dB/oct low-pass, |H(f)|^2 = fs/(2 pi f) from f_low to 0.45 fs.

    The response is within tol_db of this.
    """

    x: Block
    f_low: Above0
    tol_db: Above0

    def design(self, fs):
        with asked_by("pinking"):
            m = noise_modes(fs, self.f_low, self.tol_db)
        return bank(m.e, m.r, m.d)

    def laws(self, fs):
        return (responses.pinking(self.f_low, self.tol_db),)


@public
def pinking(x: Block, f_low: float = 1.0, tol_db: float = 0.01) -> Block:
    """Filter with a 3 dB/oct low-pass, |H|^2 = 1/w with w = 2 pi f/fs.

    The signal is taken as 0 before the first sample.

    Parameters
    ----------
    x : Block
    f_low : float
        Lower edge of the band in Hz; the upper edge is 0.45 fs.
    tol_db : float
        Largest deviation inside the band, in dB; it sets the number of sections.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        f_low or tol_db not above 0; at compile time, a band or a tolerance that cannot
        be met.

    References
    ----------
    The UGrip paper, section 1.1: "a 3 dB/octave lowpass filter H(s)".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import pinking
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"p": pinking(stimlib.Input("n"))}), fs=8000
    ... )
    >>> h = abs(proc.response("p", "n", np.array([10.0, 20.0])))
    >>> (20 * np.log10(h[0] / h[1])).round(1)
    np.float64(3.0)
    """
    return Pinking(x, f_low, tol_db)


@dataclass(frozen=True, eq=False)
class FilteredNoise(Modes, abstract=True):
    """White noise through a bank of modes, stationary from the first sample on."""

    white: Block

    def start(self, p, s, seed, normals=normals):
        """Draw a stationary initial state q ~ N(0, P) with a key of its own.

        P_ij = 1/(e_i + e_j - e_i e_j).
        """
        if not isinstance(self.white, White):
            return s
        L = stationary_factor((1.0 - p.p[p.r != 0]).tobytes())
        g = normals(noise_key(seed, *self.white.noise_key, 1), len(L)).tolist()
        q = np.zeros(s.q.size)
        q[: len(L)] = [math.fsum(map(operator.mul, row, g)) for row in L]
        return ModesState(q)


@dataclass(frozen=True, eq=False)
class PinkNoise(FilteredNoise):
    """Stationary pink noise, S(f) = psd_1hz/f: filtered white noise."""

    psd_1hz: Above0
    f_low: Above0
    tol_db: Above0

    def design(self, fs):
        with asked_by("pink_noise"):
            m = noise_modes(fs, self.f_low, self.tol_db)
        gain = math.sqrt(math.pi * self.psd_1hz)  # white of sigma = sqrt(pi S1), at any fs
        return bank(m.e, gain * m.r, gain * m.d)

    def laws(self, fs):
        return (responses.pink_noise(self.psd_1hz, self.f_low, self.tol_db),)


@public
def pink_noise(
    psd_1hz: float,
    seed: int,
    stream: int = 0,
    f_low: float = 1.0,
    tol_db: float = 0.01,
    shared: bool = False,
) -> Block:
    """Make pink noise with one-sided PSD S(f) = psd_1hz / f units^2/Hz.

    It is stationary from the first sample on.

    Parameters
    ----------
    psd_1hz : float
        S at 1 Hz, in units^2/Hz.
    seed, stream : int
        Key of its white noise.
    f_low : float
        Lower edge in Hz.  Below, the spectrum levels off within a decade, 4 dB above
        its value at the edge.  The upper edge is 0.45 fs.
    tol_db : float
        Largest deviation inside the band in dB.
    shared : bool
        See ``white_noise``.

    Returns
    -------
    Block
        Without unit.

    Raises
    ------
    BadValue
        psd_1hz, f_low or tol_db not above 0; at compile time, a band or a tolerance
        that cannot be met.

    References
    ----------
    The UGrip paper, section 1.1: p(s) = H(s) n(s), S(f) ~ 1/f.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import pink_noise
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"p": pink_noise(psd_1hz=1.0, seed=3)}), fs=8000
    ... )
    >>> proc.process(np.empty((0, 4))).shape
    (1, 4)
    """
    return PinkNoise(White(seed, stream, shared), psd_1hz, f_low, tol_db)


@dataclass(frozen=True, eq=False)
class ColouredNoise(FilteredNoise):
    """Stationary noise of a slope, S(f) ~ f^-slope, and a root mean square value."""

    slope: float
    rms: Above0
    f_low: Above0
    tol_db: Above0

    def design(self, fs):
        with asked_by("coloured_noise"):
            m = noise_modes(fs, self.f_low, self.tol_db, self.slope)
        # of white noise of unit variance: each mode's covariance with it is 1
        terms = np.outer(m.r, m.r) * stationary_covariance(m.e)
        gain = self.rms / math.sqrt(math.fsum([m.d**2, *(2 * m.d * m.r), *terms.ravel()]))
        return bank(m.e, gain * m.r, gain * m.d)

    def laws(self, fs):
        return responses.coloured_noise(self.slope, self.rms, self.f_low, self.tol_db)


@public
def coloured_noise(
    slope: float,
    seed: int,
    stream: int = 0,
    rms: float = 1.0,
    f_low: float = 1.0,
    tol_db: float = 0.01,
    shared: bool = False,
) -> Block:
    """Make noise with a power spectrum f^-slope and a given root mean square value.

    It is stationary from the first sample on.

    Parameters
    ----------
    slope : float
        Exponent of 1/f in the power spectrum, from -3 to 3 and not 0: 1 pink, 2 brown
        (the position of a random walk), -1 blue, -2 violet (its velocity). The spectrum
        falls by 3.01 slope dB per octave.
    seed, stream : int
        Key of its white noise.
    rms : float
        Root mean square value of the whole signal, from 0 Hz to fs/2; so the density at
        one frequency depends on fs and f_low. ``pink_noise`` takes the density.
    f_low : float
        Lower edge in Hz.  Below, the spectrum levels off within a decade: 4 dB per unit
        of slope above its value at the edge.  The upper edge is 0.45 fs.
    tol_db : float
        Largest deviation from the slope inside the band in dB.
    shared : bool
        See ``white_noise``.

    Returns
    -------
    Block
        Without unit.

    Raises
    ------
    BadValue
        rms, f_low or tol_db not above 0; at compile time, a slope, a band or a
        tolerance that cannot be met.

    Notes
    -----
    It is white noise through the filter of ``stimlib.design.noise.noise_modes``; the
    rms follows from the covariance of the filter's states, without an estimate.

    References
    ----------
    Kasdin, "Discrete simulation of colored noise and stochastic processes and 1/f^a
    power law noise generation", Proc. IEEE 83 (1995), for the names of slopes; the
    filter is our own.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import coloured_noise
    >>> blue = coloured_noise(-1.0, seed=1, rms=0.5)
    >>> proc = stimlib.compile(stimlib.Scene({"n": blue}), fs=8000)
    >>> proc.process(np.empty((0, 80000))).std().round(2)
    np.float64(0.5)
    """
    return ColouredNoise(White(seed, stream, shared), slope, rms, f_low, tol_db)
