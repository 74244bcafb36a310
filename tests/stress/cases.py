"""What is done to blocks and scenes in ``make stress``: kinds of input, rates, sizes of
blocks, and how a hand moves.
"""

from __future__ import annotations

import numpy as np

# Inputs: of n samples at a rate -------------------------------------------------------
DENORMALS = [5e-324, -5e-324, 1e-310, -2.2e-308, 0.0, -0.0]
WRONG = [np.nan, np.inf, -np.inf]


def step(rng, n, fs):
    return np.where(np.arange(n) < n // 3, 0.0, 1.0)


def impulse(rng, n, fs):
    return np.where(np.arange(n) == n // 3, 1.0, 0.0)


def chirp(rng, n, fs):
    """From nothing to half the sample rate."""
    return np.sin(0.5 * np.pi * np.arange(n) ** 2 / n)


def wrong(rng, n, fs):
    """What is no number: first, last, around tiles, and one in fifty."""
    x = rng.standard_normal(n)
    at = np.r_[0, 63, 64, n - 1, np.flatnonzero(rng.random(n) < 0.02)]
    x[at] = rng.choice(WRONG, at.size)
    return x


FINITE = {
    "silence": lambda rng, n, fs: np.zeros(n),
    "direct current": lambda rng, n, fs: np.full(n, 0.7),
    "step": step,
    "impulse": impulse,
    "chirp": chirp,
    "1e30": lambda rng, n, fs: 1e30 * rng.standard_normal(n),
    "1e-30": lambda rng, n, fs: 1e-30 * rng.standard_normal(n),
    "denormals": lambda rng, n, fs: rng.choice(DENORMALS, n),
}
INPUTS = FINITE | {"nan and inf anywhere": wrong}

# Rates and blocks ---------------------------------------------------------------------
RATES = [1000.0, 2000.0, 4000.0, 8000.0, 11025.0, 22050.0, 44100.0, 48000.0, 96000.0, 192000.0]
PRIMES = [2, 3, 5, 7, 11, 13, 31, 61, 67, 127, 131, 257, 509, 1021, 2053, 4099, 8191]
SIZES = [1, *PRIMES, 63, 64, 65, 128, 129, 1024, 4096, 8192, 8193]

# Ends of a number that lies from 0 to 1 -----------------------------------------------
SMALL = [5e-324, 1e-300, 1e-30, 2.0**-53, 1e-9]
LARGE = [1 - 2.0**-53, 1 - 2.0**-52, 1 - 1e-9]


# Hands: position over time, in m, within 0.04 m ---------------------------------------
def stroke(t):
    return 0.02 * (1 - np.cos(2 * np.pi * 1.5 * t))


def reports(t, f, rate=125.0, jitter=0.0):
    """What a device says that looks every 1/rate seconds, too late by up to a part of
    that.
    """
    k = np.floor(t * rate)
    late = jitter * (np.modf(np.sin(12.9898 * k) * 43758.5453)[0] ** 2) / rate
    return f(np.where(t - k / rate >= late, k, k - 1) / rate)


def stalls(t):
    """A hand that stands for a tenth of a second, again and again."""
    whole, part = np.divmod(t, 0.25)
    return stroke(0.15 * whole + np.minimum(part, 0.15))


HANDS = {
    "smooth": stroke,
    "stalls": stalls,
    "reversals": lambda t: 0.02 + 0.0004 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * 40 * t)),
    "reports at 125 Hz": lambda t: reports(t, stroke),
    "reports with jitter": lambda t: reports(t, stroke, jitter=0.8),
    "teleports": lambda t: stroke(t) + 0.01 * (np.floor(3 * t) % 2),
    "steps of 0.1 mm": lambda t: np.round(stroke(t) / 1e-4) * 1e-4,
    "a last bit that toggles": lambda t: 0.01 + 1e-6 * (np.floor(700 * t) % 2),
    "standing": lambda t: np.full(np.shape(t), 0.01),
}
