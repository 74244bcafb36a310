"""Elementary functions in compiled code, and their errors in ulps."""

import math

import mpmath
from walked import compiled as walked

NAMES = ("exp", "log", "sin", "cos", "tanh")


@walked
def compiled(f, x, y):
    for i in range(x.size):
        y[i] = f(x[i])


def ulps(y, x, name):
    """Return how far a value is from the exact one, in ulps of that."""
    with mpmath.workprec(160):
        exact = getattr(mpmath, name)(mpmath.mpf(float(x))) if x or name != "log" else -mpmath.inf
        if mpmath.isinf(exact) or abs(exact) > 1.7976931348623157e308:
            return 0.0 if math.isinf(y) and (y > 0) == (exact > 0) else math.inf
        return float(abs(mpmath.mpf(float(y)) - exact) / math.ulp(float(exact)))
