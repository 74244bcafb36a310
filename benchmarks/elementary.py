"""exp, log, sin, cos and tanh: how far from the exact value, and what a sample costs.

    PYTHONPATH=tests python benchmarks/elementary.py             print
    PYTHONPATH=tests python benchmarks/elementary.py --record    and keep the figures

A million arguments of each range are compared with numpy's long double, and the worst
thousand of them with mpmath. They are kept in results/elementary.csv.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from bench import Row, compared, main, row, under
from ulps import NAMES, compiled, ulps

import stimlib
from stimlib import Input, Scene, blocks
from stimlib.core import maths

N = 1_000_000
RANGES = {
    "exp": [(-745.0, 709.7), (-1.0, 1.0)],
    "log": [(0.0, 2.0), (0.0, 1e300)],
    "sin": [(-7.0, 7.0), (-(2.0**30), 2.0**30)],
    "cos": [(-7.0, 7.0), (-(2.0**30), 2.0**30)],
    "tanh": [(-1.0, 1.0), (-20.0, 20.0)],
}


def worst(name: str, x: np.ndarray) -> float:
    """Return the largest error in units of the last place."""
    y = np.empty_like(x)
    compiled(getattr(maths, name), x, y)
    long = getattr(np, name)(x.astype(np.longdouble))
    far = np.abs(y - long) / np.spacing(np.abs(long).astype(float))
    return max(ulps(y[i], x[i], name) for i in np.argsort(far)[-1000:])


def measure() -> list[Row]:
    """All rows."""
    rng, found = np.random.default_rng(3), []
    for name in NAMES:
        for low, high in RANGES[name]:
            error = worst(name, rng.uniform(low, high, N))
            found.append(row(f"{name}, {low:.4g} .. {high:.4g}", error, "ulp"))
        x = rng.uniform(0.1, 3.0, (1, 64_000))
        out = np.empty_like(x)
        run = stimlib.compile(Scene({"y": getattr(blocks, name)(Input("x"))}), 8000).process
        jobs = {
            "block": partial(run, x, out),
            "numpy": partial(getattr(np, name), x, out),
        }
        found += under(name, compared(jobs, x.size, "block", 30))
    return found


if __name__ == "__main__":
    main("elementary", __doc__, measure)
