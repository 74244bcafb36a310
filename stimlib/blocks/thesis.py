"""The thesis' own methods for a springpot: a history that is thinned out, and one that
is cut off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.graph import Block
from ..core.maths import copy, exp, fir, floor, fma, log, where
from ..design import responses
from ..design.eights import padded
from ..errors import BadValue
from ..system.limits import limits
from .fractional import check_fields, force_unit, origin
from .onset import ONSETS

NAN = math.nan
POINTS = 100  # of history that gl-downsampled sums
LONGEST = 1 << 24  # samples of history that gl-downsampled keeps at most


def binomials(alpha: float, n: int) -> np.ndarray:
    """w_j = (-1)^j binom(alpha, j), j < n."""
    return np.cumprod([1.0, *((j - 1 - alpha) / j for j in range(1, n))])


@dataclass(frozen=True, eq=False)
class Method(Block, abstract=True):
    """D^alpha y, of the order alpha, as the thesis computes it."""

    y: Block
    contact: Block
    order: float

    def check(self):
        check_fields(self)

    def units(self, *u):
        return force_unit("springpot", u[0])


class DownsampledParams(NamedTuple):
    weights: np.ndarray
    scale: float
    alpha: float


class DownsampledState(NamedTuple):
    past: np.ndarray  # all positions since contact
    first: float
    k: float  # samples since contact
    cold: float


@dataclass(frozen=True, eq=False)
class Downsampled(Method):
    """D^alpha y from every m-th sample of the whole history, m = ceil(k/100) at step k,
    with the step m/fs.
    """

    horizon: float
    onset: str

    def design(self, fs):
        n = self.horizon * fs
        if n > LONGEST:
            raise BadValue(
                f"springpot: gl-downsampled keeps the whole history, {n:.9g} samples for horizon ="
                f" {self.horizon:g} s at {fs:g} Hz; give the longest contact as horizon, at most"
                f" {LONGEST / fs:.6g}"
            )
        p = DownsampledParams(
            binomials(self.order, POINTS + 1), math.pow(fs, self.order), self.order
        )
        return p, DownsampledState(np.zeros(max(math.ceil(n), 1)), 0.0, 0.0, ONSETS[self.onset])

    @staticmethod
    def tile(p, s, x, contact, y):
        most = s.past.size * 1.0
        k = where(s.k > 0.0, where(s.k < most, s.k, most), 0.0)  # a state may come from anywhere
        first, cold = s.first, s.cold
        for i in range(x.size):
            if contact[i] > 0.0:
                first, k, cold = origin(cold, first, x[i]), where(cold > 0.0, 0.0, k), 0.0
                if k < most:
                    now = np.int64(k)
                    s.past[now] = x[i] - first
                    m = where(k > 0.0, floor((k + (POINTS - 1)) / POINTS), 1.0)
                    total = 0.0
                    for j in range(np.int64(floor(k / m)) + 1):
                        total = fma(p.weights[j], s.past[now - j * np.int64(m)], total)
                    y[i] = p.scale * where(m > 1.0, exp(-p.alpha * log(m)), 1.0) * total
                    k = k + 1.0
                else:
                    y[i] = NAN
            else:
                y[i], first, k, cold = 0.0, 0.0, 0.0, where(cold > 0.0, cold, 1.0)
        return DownsampledState(s.past, first, k, cold)


class ShortMemoryParams(NamedTuple):
    taps: np.ndarray  # oldest first, zeros in front


class ShortMemoryState(NamedTuple):
    line: np.ndarray
    first: float
    cold: float


@dataclass(frozen=True, eq=False)
class ShortMemory(Method):
    """D^alpha y from the last seconds alone."""

    seconds: float
    onset: str
    resettable = True

    def design(self, fs):
        limits.check(
            "state_bytes",
            8 * self.seconds * fs,
            f"gl-short-memory: bytes of its samples at fs = {fs:g} Hz",
        )
        taps = padded(
            math.pow(fs, self.order) * binomials(self.order, max(1, round(self.seconds * fs)))
        )[::-1].copy()
        return ShortMemoryParams(taps), ShortMemoryState(
            np.zeros(taps.size - 1), 0.0, ONSETS[self.onset]
        )

    def laws(self, fs):
        return (responses.short_memory(self.order, self.seconds, fs),)

    @staticmethod
    def work(p):
        return p.taps.size + 63

    @staticmethod
    def tile(p, s, x, y, w):
        first, n, h = origin(s.cold, s.first, x[0]), x.size, s.line.size
        copy(s.line, w)
        for k in range(n):
            w[h + k] = x[k] - first
        fir(p.taps, w[: h + n], y)
        copy(w[n : n + h], s.line)
        return ShortMemoryState(s.line, first, 0.0)

    @staticmethod
    def transfer(p, z):
        return np.polyval(p.taps, 1 / z)
