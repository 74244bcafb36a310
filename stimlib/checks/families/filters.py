"""Laws of the blocks of the family ``filters``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy

from ..linear import LONG, PI, analogue, digital, response, summed, taps
from ..rows import law, near


@law("First", since=1)
def _first(b, fs, x, y):
    return np.full(y.size, x[0][0] if x.rest else y[0]), 0.0


@response("Taps")
def _taps(b, fs):
    return taps(b.taps)


@response("MovingAverage")
def _moving_average(b, fs):
    n = round(b.seconds * fs)
    return taps(np.full(n, 1 / n))


@response("Differentiator", exact=False)
def _differentiator(b, fs):  # its taps are a best fit, which (a2) holds
    p = b.design(fs)[0]
    return taps(p.taps[::-1][: int(p.order) + 1])


@response("Filter")
def _filter(b, fs):
    edges = tuple(f / LONG(fs) for f in (b.low, b.high) if f is not None)
    return digital(*analogue(b.band, edges, b.kind, b.order, b.ripple, b.attenuation))


@response("Sos", exact=False)
def _sos(b, fs):
    return lambda n: scipy.signal.sosfilt(
        (b.rows / b.rows[:, 3:4]).astype(LONG), np.r_[LONG(1), np.zeros(n - 1, LONG)]
    )


def late(b: Any, fs: float) -> int:
    """Return the delay of a block in samples."""
    return round(b.seconds * fs) if b.samples is None else b.samples


@law("Delay", since=lambda b, fs, x: late(b, fs))
def _delay(b, fs, x, y):
    return np.r_[np.zeros(late(b, fs)), x[0]][: y.size], 0.0


@law("Track", "TrackVelocity", since=lambda b, fs, x: 65 * fs / (2 * math.pi * b.bandwidth))
def _track(b, fs, x, y):
    """Return the tracked position or rate as a sum of step responses.

    The step response to a held input is 1 - (1 + w t) exp(-w t). The sum starts at the
    last jump or contact.
    """
    place, touching = x[0], x[1] > 0
    most = math.inf if b.max_jump is None else b.max_jump
    q = 2 * PI * b.bandwidth / LONG(fs)
    t = np.arange(1, y.size + 1) * q
    if type(b).__name__ == "Track":
        h = -np.expm1(-t) - t * np.exp(-t)
    else:
        h = fs * np.exp(-t + q) * ((1 + t - q) * -np.expm1(-q) - q * np.exp(-q))
    rate = type(b).__name__ != "Track"
    h, want = h.astype(float), np.full(y.size, 0.0 if x.rest or rate else y[0])
    jump = np.abs(np.diff(place, prepend=place[:1])) > most
    starts = np.flatnonzero(touching & (np.r_[True, ~touching[:-1]] | jump))
    ends = np.flatnonzero(~touching & np.r_[False, touching[:-1]])
    edges = np.r_[starts, y.size]
    for k, a in enumerate(starts):
        after = np.searchsorted(ends, a)
        e = min(edges[k + 1], ends[after] if after < ends.size else y.size)
        way = place[a:e] - place[a]
        want[a:e] = summed(h, np.diff(way, prepend=0.0)) + (0.0 if rate else place[a])
        if not rate:
            want[e : edges[k + 1]] = want[e - 1] if x.rest or a else y[e - 1]
    return want, 1e-12 * (fs if rate else 1.0) * max(
        float(np.abs(place[touching]).max(initial=0.0)), 1e-300
    )


def _part(n: float) -> float:
    """Return how much of the way a follower with a time of n samples goes in one."""
    return 1.0 if n <= 1e-3 else -math.expm1(-1 / n)


@law("Follower", since=1)
def _follower(b, fs, x, y):
    last = np.r_[0.0, y[:-1]]
    up, down = _part(b.attack * fs), _part(b.release * fs)
    return near(last + np.where(np.abs(x[0]) > last, up, down) * (np.abs(x[0]) - last), 1e-14)
