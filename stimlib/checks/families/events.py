"""Laws of the blocks of the family ``events``."""

from __future__ import annotations

import math

import numpy as np

from ..linear import LONG, Modes, response, straight
from ..rows import Row, law, near, sample_of


@law("Time", since=0)
def _time(b, fs, x, y):
    return np.arange(x.at, x.at + y.size) / fs, 0.0


@law("Every", since=0)
def _every(b, fs, x, y):
    n = sample_of(x[0], fs)
    k = np.arange(int(n.max(initial=0) / (b.period * fs)) + 2)
    return np.isin(n, np.floor(k * (b.period * fs) + 0.5)), 0.0


@law("At", since=0)
def _at(b, fs, x, y):
    at, n = np.sort(np.floor(b.times * fs + 0.5)), sample_of(x[0], fs)
    return np.searchsorted(at, n, "right") - np.searchsorted(at, n), 0.0


@law("Timeline", since=0)
def _timeline(b, fs, x, y):
    t, want, size = x[0], np.full(y.size, b.values[0]), np.full(y.size, abs(b.values[0]))
    for t0, t1, v0, v1 in zip(b.times, b.times[1:], b.values, b.values[1:], strict=False):
        z = (t - t0) / (t1 - t0) if t1 > t0 else np.zeros(t.size)
        w = {"step": 0 * z, "linear": z, "cosine": np.sin(np.pi / 2 * z) ** 2}[b.kind]
        want = np.where(t >= t0, v0 + (v1 - v0) * w, want)
        size = np.where(t >= t0, abs(v0) + abs(v1), size)
    return np.where(t >= b.times[-1], b.values[-1], want), 2e-15 * size


@law("Edge", since=1)
def _edge(b, fs, x, y):
    above = x[0] > x[1]
    return np.diff(above, prepend=above[0]) & (above == b.up), 0.0


@law("Crossing", since=2)
def _crossing(b, fs, x, y):
    u, half = x[0] / b.spacing, b.hysteresis / b.spacing / 2

    def passed(cell: int) -> Row:
        want, carry = np.zeros(u.size), 0.0
        for n in range(1, u.size):
            to = min(max(cell, math.floor(u[n] - half)), math.floor(u[n] + half))
            moved, want[n] = to - cell, carry
            # the middle of the lines that it has passed
            line = (cell + to + 1) / 2 + math.copysign(half, moved)
            part = (line - u[n - 1]) / (u[n] - u[n - 1]) if moved and u[n] != u[n - 1] else 0.0
            carry = moved * min(max(part, 0.0), 1.0) * b.split
            want[n] += moved - carry
            cell = to
        return want

    want = passed(math.floor(u[0] - half * (not x.rest)))
    tol = 1e-9 * max(1.0, float(np.abs(want).max())) if b.split else 0.0
    return want, tol if x.rest else np.where(want == passed(math.floor(u[0] + half)), tol, np.inf)


@law("Count", since=1)
def _count(b, fs, x, y):
    return near(np.cumsum(x[0]) + (0.0 if x.rest else y[0] - x[0][0]), 1e-15 * x[0].size)


@law("SampleAndHold", since=1)
def _sample_and_hold(b, fs, x, y):
    last = np.maximum.accumulate(np.where(x[1] != 0, np.arange(y.size), -1))
    return np.where(last >= 0, x[0][last], 0 if x.rest else y[0]), 0.0


@law("OnceWithin", since=1)
def _once_within(b, fs, x, y):
    want, wait = np.zeros(y.size), max(1, round(min(b.refractory * fs, 2.0**62)))
    # the first that was let through is known to be
    free = 0 if x.rest else int(np.argmax(np.r_[y != 0, True]))
    for n in np.flatnonzero(x[0]):
        if n >= free:
            want[n], free = x[0][n], n + wait
    return want, 0.0


@law("Burst", since=lambda b, fs, x: round(b.duration * fs))
def _burst(b, fs, x, y):
    n, want = round(b.duration * fs), np.zeros(y.size)
    t, ramp = np.arange(n) + 0.5, min(max(0.5, b.ramp * fs), n / 2)
    shape = np.sin(np.pi / 2 * np.minimum(np.minimum(t, n - t) / ramp, 1)) ** 2
    for at in np.flatnonzero(x[0]):
        part = want[at : at + n]
        part[:] = x[0][at] * shape[: part.size]
        want[at + n :] = 0
    return near(want, 1e-13)


@law("Envelope", since=1)
def _envelope(b, fs, x, y):
    want, last, stage = np.zeros(y.size), 0.0 if x.rest else y[0], "release"
    # in which stage it is, it says where it is released
    tol = np.where(x.rest | (np.cumsum(x[0] <= 0) > 0), 1e-9, np.inf)
    level = {"attack": 1 / (1 - math.exp(-1.5)), "decay": b.sustain, "release": 0.0}
    times = {"attack": b.attack / 1.5, "decay": b.decay, "release": b.release}
    keep = {name: math.exp(-1 / (t * fs)) if t * fs > 1e-3 else 0.0 for name, t in times.items()}
    for n, gate in enumerate(x[0] > 0):
        if not x.rest:
            last = y[max(n - 1, 0)]
        if not gate:
            stage = "release"
        elif stage == "release":
            stage = "attack"
        before, last = last, level[stage] + keep[stage] * (last - level[stage])
        if stage == "attack" and last >= 1 - 1e-9:
            last, stage = max(1.0, before), "decay"
        want[n] = last
    return want, tol


@response("Integrate")
def _integrate(b, fs):
    if b.held:
        return Modes(1 / fs, np.array([1 / LONG(fs)]), np.zeros(1, LONG))
    return Modes(*straight([-b.leak / LONG(fs)], 1 / LONG(fs)))
