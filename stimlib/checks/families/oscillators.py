"""Laws of the blocks of the family ``oscillators``."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...core.graph import Const
from .. import laws
from ..rows import Row, Rows, law, turning


@law("PulseTrain", since=0)
def _pulse_train(b, fs, x, y):
    phase, step = phases(x, fs)
    n, after = np.arange(y.size), phase + step
    wraps = after < phase
    jitter = np.clip((0.5 + np.nan_to_num(x[1])) * 2.0**64, 0.0, 2.0**64 - 2.0**11).astype(
        np.uint64
    )
    # where this period began; at first that of the period before
    last = np.maximum.accumulate(np.where(wraps, n, -1))
    first, known = (
        (jitter[0], isinstance(b.jitter, Const)) if x.past >> 64 else (np.uint64(1 << 63), True)
    )
    now = np.where(last < 0, first, jitter[last])
    mark = np.r_[first, now[:-1]]
    want = ((phase <= mark) & (wraps | (mark < after))) + 1.0 * (wraps & (now < after))
    return want, np.where(np.r_[known, (last[:-1] >= 0) | known], 0.0, np.inf)


def phases(x: Rows, fs: float) -> tuple[Row, Row]:
    """Return the phase at each sample, and what that sample adds to it.

    It counts from sample 0 on.
    """
    step = np.where(np.arange(x.at, x.at + x[0].size) < 0, np.uint64(0), turning(x[0], fs))
    return np.cumsum(step) - step + np.uint64(x.past % 2**64), step


def turns_of(x: Rows, fs: float, phase: float) -> tuple[Row, Row]:
    """Return turns at each sample from a phase in rad on, and those per sample."""
    t = phases(x, fs)[0].astype(np.longdouble) / 2.0**64 + phase / (2 * np.longdouble(math.pi))
    return t - np.floor(t), turning(x[0], fs).astype(np.longdouble) / 2.0**64


@law("Carrier", since=0)
def _carrier(b, fs, x, y):
    t, step = turns_of(x, fs, b.phase)
    want = laws.carried(t, step, b.rectify)
    return np.where(x[1] > 0, want, 0), 1e-11


WAVES: dict[str, tuple[Callable, Callable]] = {  # of turns 0 .. 1: the wave, its integral
    "triangle": (
        lambda u, d: 1 - 4 * np.abs((u + 0.25) % 1 - 0.5),
        lambda u, d: np.where((v := (u + 0.25) % 1) < 0.5, 2 * v * v - v, 3 * v - 2 * v * v - 1),
    ),
    "sawtooth": (lambda u, d: 2 * (u % 1) - 1, lambda u, d: (u % 1) ** 2 - u % 1),
    "square": (
        lambda u, d: np.where(u % 1 < d, 1, -1),
        lambda u, d: 2 * (np.floor(u) * d + np.minimum(u % 1, d)) - u,
    ),
    "pulse": (lambda u, d: u % 1 < d, lambda u, d: np.floor(u) * d + np.minimum(u % 1, d)),
}


@law("Oscillator", since=0)
def _oscillator(b, fs, x, y):
    t, step = turns_of(x, fs, b.phase)
    wave, integral = WAVES[b.waveform]
    d = np.clip(x[1], 0, 1).astype(np.longdouble)
    still = step == 0
    mean = (integral(t + step / 2, d) - integral(t - step / 2, d)) / np.where(still, 1, step)
    return np.where(still, wave(t, d), mean).astype(float), (
        1e-11 + 1e-18 / np.where(still, 1, step)
    ).astype(float)
