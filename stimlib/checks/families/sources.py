"""Laws of the blocks of the family ``sources``."""

import math
from fractions import Fraction

import numpy as np

from ..linear import LONG, analogue, digital, response, taps
from ..rows import FADED, law, near, sample_of


@law("Chirp", since=0)
def _chirp(b, fs, x, y):
    n = sample_of(x[0], fs)
    t, f0, f1 = n / np.longdouble(fs), np.longdouble(b.f0), np.longdouble(b.f1)
    linear = b.kind == "linear" or b.f0 == b.f1
    c = 0 if linear else np.log(f1 / f0) / np.longdouble(b.seconds)
    turns = (
        f0 * t + (f1 - f0) / (2 * np.longdouble(b.seconds)) * t * t
        if linear
        else f0 * np.expm1(c * t) / c
    )
    want = np.sin(2 * np.longdouble(np.pi) * (turns - np.floor(turns))).astype(float)
    return np.where((n >= 0) & (n < b.seconds * fs), want, 0), (
        1e-14 + 4e-19 * np.abs(turns.astype(float)) if linear else 1e-8
    )


@law("Scanned", since=0)
def _scanned(b, fs, x, y):
    return near(_in_table(b, fs, x[0]), 1e-9)


def _in_table(b, fs, at):
    from ...design.filters import HALF, resampled  # as of ``Playback``

    # samples beside the table that are resampled with it
    more = 1 + b.loop * math.ceil(HALF * max(1.0, b.rate / fs))
    table = resampled(
        np.pad(b.samples, more, "wrap" if b.loop else "constant"),
        b.rate,
        8 * b.rate,
        fs,
        "playback",
    )
    table, n = table[8 * more - 2 :], 8 * b.samples.size  # two samples before its first
    u = at * (8 * b.rate)
    k = np.floor(u)
    inside = b.loop | ((k >= 0) & (k < n))
    j = np.arange(6.0)
    # Lagrange's
    weights = [np.prod([(u - k + 2 - m) / (i - m) for m in j if m != i], axis=0) for i in j]
    first = np.where(inside, k % n, 0).astype(int)
    want = np.sum([w * table[first + i] for i, w in enumerate(weights)], axis=0)
    return np.where(inside, want, 0)


@law("Playback", since=0)
def _playback(b, fs, x, y):
    from ...design.filters import resampled  # how it keeps waves, tests/blocks/test_events.py says

    n = sample_of(x[0], fs)
    if b.loop and fs != b.rate:  # so many turns are so many samples, up to 2^17
        one = b.samples.size * Fraction(fs) / Fraction(b.rate)
        whole = one.limit_denominator(max(1, 2**17 // one)) or Fraction(1, 2**17 // one)
        at = [float(v * b.samples.size / whole) for v in (n % whole.numerator).astype(int)]
        return near(np.where(n >= 0, _in_table(b, fs, np.array(at) / b.rate), 0), 1e-13)
    table = resampled(b.samples, b.rate, fs)
    inside = (n >= 0) & (b.loop | (n < table.size))
    return near(np.where(inside, table[n % table.size], 0), 1e-13)


@law("Ring", since=lambda b, fs, x: FADED * max(1.0, fs * float(x[2].max())))
def _ring(b, fs, x, y):
    pole = np.exp(-1 / (fs * np.maximum(x[2], 1 / fs)) + 2j * np.pi * np.clip(x[1] / fs, 0, 0.5))
    q, want = 0j, np.zeros(y.size, complex)
    for n, (p, event) in enumerate(zip(pole.tolist(), x[0].tolist(), strict=True)):
        want[n] = q = p * q + event
    # of the circle, as a sine of fs/2 is a rounding
    return want.imag if b.onset == "sine" else want.real, near(want, 1e-10)[1]


@response("Grain")
def _grain(b, fs):
    from ...design.filters import resampled  # as of ``Playback``

    return taps(resampled(b.samples, b.rate, fs))


@response("BandNoise")
def _band_noise(b, fs):
    zeros, poles, gain = analogue(
        "bandpass", (b.low / LONG(fs), b.high / LONG(fs)), "butterworth", b.order, 1.0, 60.0
    )
    return digital(zeros, poles, gain * np.sqrt(b.psd * LONG(fs) / 2))
