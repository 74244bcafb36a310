"""Laws of the blocks of the family ``fractional``."""

from __future__ import annotations

import math

import numpy as np

from .. import laws
from ..linear import LONG, response, taps
from ..rows import law, near, touched


@law("PathLength", since=1)
def _path_length(b, fs, x, y):
    want = np.zeros(y.size)
    for k, s in enumerate(touched(x[1])):
        first = 0.0 if b.onset == "step" and k == 0 and x.rest else x[0][s.start]
        want[s] = np.cumsum(np.abs(np.diff(x[0][s], prepend=first))) + (
            0.0 if x.rest or s.start else y[0]
        )
    return near(want, 1e-15 * y.size)


@law("Accuracy", since=0)
def _accuracy(b, fs, x, y):
    # what they are worth, tests/blocks/test_fractional.py says
    from ...blocks.fractional import bounds_of_orders

    knots, bounds = bounds_of_orders(b.tol, b.horizon * fs)
    return near(np.interp(x[0], knots, (1.02 + 2 * b.tol) * bounds))


POINTS = 64  # at which a sum over the whole history is made


@law("Springpot", since=1)
def _springpot(b, fs, x, y):
    want, tol = np.zeros(y.size), np.zeros(y.size)
    for k, s in enumerate(touched(x[1])):
        step = b.onset == "step" and k == 0 and x.rest
        way = np.r_[0.0, x[0][s]] if step else x[0][s]
        force, size = laws.springpot_convolution(way, fs, b.scheme, b.order)
        want[s], tol[s] = force[int(step) :], (b.tol + 1e-12) * size.max() + 1e-300
        # of a contact that began before nothing is said
        tol[s] = np.inf if not x.rest and s.start == 0 else tol[s]
        tol[s.start + int(b.horizon * fs) : s.stop] = np.inf  # beyond it nothing is said
    return want, tol


@law("SpringpotLive", since=1)
def _springpot_live(b, fs, x, y):
    want, tol = np.where(x[2] > 0, y, 0), np.full(y.size, 1e-300)
    for k, s in enumerate(touched(x[2])):
        if not x.rest and s.start == 0:
            want[s] = y[s]
            continue
        step = int(b.onset == "step" and k == 0 and x.rest)
        way, order = np.r_[np.zeros(step), x[0][s]], np.r_[np.zeros(step), x[1][s]]
        at = np.unique(np.linspace(step, way.size - 1, POINTS).astype(int))
        at = at[(order[at] >= 0) & (order[at] <= 1)]
        force, size = laws.springpot_sum(way, fs, b.scheme, order, at)
        want[s.start + at - step], tol[s.start + at - step] = (
            force,
            (b.tol + 1e-12) * np.maximum(size, 1e-300),
        )
    return want, tol


@law("Downsampled", since=1)
def _downsampled(b, fs, x, y):
    want, tol = np.where(x[1] > 0, y, 0), np.full(y.size, 1e-300)
    for c, s in enumerate(touched(x[1])):
        if not x.rest and s.start == 0:
            want[s] = y[s]
            continue
        way = x[0][s] - (0.0 if b.onset == "step" and c == 0 and x.rest else x[0][s.start])
        for k in np.unique(np.linspace(0, way.size - 1, POINTS).astype(int)):
            m = max(1, math.ceil(k / 100))
            past = way[k::-m].astype(np.longdouble)
            j = np.arange(1, past.size, dtype=np.longdouble)
            weights = np.cumprod(np.r_[np.longdouble(1), (j - 1 - b.order) / j])
            scale = (np.longdouble(fs) / m) ** np.longdouble(b.order)
            if k < math.ceil(b.horizon * fs):
                want[s.start + k] = weights @ past * scale
                tol[s.start + k] = 1e-12 * np.abs(weights) @ np.abs(past) * scale + 1e-300
    return want, tol


@response("ShortMemory")
def _short_memory(b, fs):
    j = np.arange(1, max(1, round(b.seconds * fs)), dtype=LONG)
    return taps(LONG(fs) ** b.order * np.cumprod(np.r_[LONG(1), (j - 1 - b.order) / j]))
