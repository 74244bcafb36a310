"""Laws of the blocks of the family ``graph``."""

import math

import numpy as np

from ..rows import law


@law("Interval", since=0)
def _interval(b, fs, x, y):
    n, first = np.arange(x.at, x.at + y.size), math.floor(b.begin * fs + 0.5)
    return (n >= first) & (b.duration is None or n < first + math.floor(b.duration * fs + 0.5)), 0.0


@law("Guard", since=0)
def _guard(b, fs, x, y):
    return x[0], 0.0  # rows end where one is not finite
