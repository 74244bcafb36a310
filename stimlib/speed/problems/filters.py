"""A low-pass far below the sample rate: against its poles in closed form, in long double."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy import signal

from ...blocks import lowpass
from ..precision import Method, Problem, Signal, on, own, response

FS, SAMPLES, ORDER = 8000.0, 1 << 16, 4
LONG = 1 << 18  # of an impulse response, of a cutoff of 1e-4 fs
X = np.random.default_rng(0).standard_normal(SAMPLES)
LD = np.longdouble


def butterworth(cutoff: float) -> np.ndarray:
    """H at the bins of an impulse response: ORDER poles on a circle, i tan(pi f/fs) for s."""
    pi = 4 * np.arctan(LD(1))
    k = np.arange(ORDER, dtype=LD)
    angle = pi * (2 * k + ORDER + 1) / (2 * ORDER)
    poles = np.cos(angle) + 1j * np.sin(angle)
    f = np.arange(LONG // 2, dtype=LD) / LONG  # but fs/2, where s has no end
    s = 1j * np.tan(pi * f) / np.tan(pi * LD(cutoff) / LD(FS))
    return np.prod([-p / (s - p) for p in poles], axis=0).astype(complex)


def response_error(cutoff: float, f: Signal) -> float:
    return float(np.abs(response(f, LONG)[:-1] - butterworth(cutoff)).max())


def transfer_function(cutoff: float) -> Signal:
    b, a = signal.butter(ORDER, cutoff, fs=FS)
    return lambda x: signal.lfilter(b, a, x)


def biquads(cutoff: float) -> Signal:
    sos = signal.butter(ORDER, cutoff, fs=FS, output="sos")
    return lambda x: signal.sosfilt(sos, x)


def low_passes() -> list[Method]:
    found = []
    for part in (1e-1, 1e-2, 1e-3, 1e-4):
        cutoff = part * FS
        ladders = {
            "stimlib lowpass, cutoff Hz": ([cutoff], own(lambda x, cutoff: lowpass(x, cutoff, ORDER), FS)),
            "scipy butter in sosfilt, cutoff Hz": ([cutoff], biquads),
            "scipy butter in lfilter, cutoff Hz": ([cutoff], transfer_function),
        }
        found += on(X, partial(response_error, cutoff), ladders)
    return found


PROBLEMS = (
    Problem(
        "lowpass", "Butterworth low-pass of order 4, 0.8 to 800 Hz at 8 kHz", "largest error of the response", SAMPLES, low_passes
    ),
)
