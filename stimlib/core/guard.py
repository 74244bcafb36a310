"""The guard on every output: it fades out at the first sample that is not finite."""

from __future__ import annotations

import dataclasses as dc
import math
from collections import namedtuple

import numpy as np

from .graph import NONE, ONE, Block
from .maths import where

# Parameters of `Guard`: the length of its fade in samples.
GuardParams = namedtuple("GuardParams", "m")


# State of `Guard`: the last finite value, the fade's progress, and the fault.
#   left  -1 while healthy, then samples of ramp to go
#   at    samples seen while healthy: where the fault is
GuardState = namedtuple("GuardState", "last left at")


@dc.dataclass(frozen=True, eq=False)
class Guard(Block):
    """The stage on every output that fades it out at the first non-finite sample.

    The last finite value fades out in 20 ms.

    The fade to a device has at least ``steps`` samples if these take at most half a
    second.
    """

    x: Block
    steps: float | None = None
    begins_early = False  # it counts the samples of the run

    def through(self, p, fs, z, H, value):
        return H[0]

    def samples(self, fs):
        """Return the length of the fade in samples."""
        return max(round(0.02 * fs), min(int(self.steps or 1), math.ceil(0.5 * fs)))

    def design(self, fs):
        return GuardParams(float(self.samples(fs))), GuardState(0.0, -1.0, np.uint64(0))

    @staticmethod
    def tile(p, s, x, y):
        last, left, at, bad = s.last, s.left, s.at, NONE
        for i in range(y.size):
            y[i] = x[i]
            bad = bad + where(x[i] - x[i] == 0.0, NONE, ONE)
        if left < 0.0 and bad == NONE:  # as nearly always
            return GuardState(x[x.size - 1], left, at + np.uint64(x.size))
        for i in range(y.size):
            healthy = where(left < 0.0, where(x[i] - x[i] == 0.0, 1.0, 0.0), 0.0) > 0.0
            left = where(healthy, -1.0, where(left < 0.0, p.m, where(left > 0.0, left - 1.0, 0.0)))
            last = where(healthy, x[i], last)
            at = where(healthy, at + ONE, at)
            y[i] = where(healthy, x[i], last * (left / p.m))
        return GuardState(last, left, at)
