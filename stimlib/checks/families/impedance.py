"""Laws of the blocks of the family ``impedance``."""

from __future__ import annotations

import math

import numpy as np

from .. import laws
from ..linear import LONG, Modes, response, straight
from ..rows import FADED, law, near


@law("Hysteresis", "Loading", since=1)
def _gate(b, fs, x, y):
    on, off = b.on, b.off
    if on is None or off is None:
        on, off = laws.gate_thresholds(b.resolution, b.v.cutoff, fs)
    n, begins = np.arange(y.size), 0 if x.rest else y[0]
    opened = np.maximum.accumulate(np.where((x[0] > on) | (begins > 0) & (n == 0), n, -1))
    return opened > np.maximum.accumulate(np.where(x[0] > off, -1, n)), 0.0


@law("Velocity", since=lambda b, fs, x: 1.3 * FADED * fs / (2 * math.pi * b.cutoff) + 1)
def _velocity(b, fs, x, y):
    # of digits, by two poles so near to 1
    lost = 2.0**-50 / math.expm1(-2 * math.pi * b.cutoff / fs) ** 2
    return near(
        laws.squeeze_finger(x[0], 0 * x[0], x[1], fs, 0.0, 0.0, b.cutoff, 1.0, 0.0).v, 1e-11 + lost
    )


@response("FirstOrder")
def _first_order(b, fs):
    a = 1 / (LONG(b.tau) * LONG(fs))
    return Modes(*straight([-a], a))
