"""Laws of the blocks of the family ``pointwise``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..rows import ULP, Law, law


def _maps(exact: dict[str, Callable], rounded: dict[str, Callable]) -> None:
    def of(f: Callable, ulps: float) -> Law:
        return lambda b, fs, x, y: (w := np.asarray(f(*x), float), ulps * (ULP * np.abs(w) + 5e-17))

    for fs, ulps in ((exact, 0.0), (rounded, 1.8)):
        for name, f in fs.items():
            law(name, since=0)(of(f, ulps))


_maps(
    {
        "Add": np.add,
        "Sub": np.subtract,
        "Mul": np.multiply,
        "Div": np.divide,
        "Neg": np.negative,
        "Abs": np.abs,
        "Greater": np.greater,
        "AtLeast": np.greater_equal,
        "Equal": np.equal,
        "NotEqual": np.not_equal,
        "Maximum": np.maximum,
        "Minimum": np.minimum,
        "Sqrt": np.sqrt,
        "Nonzero": lambda x: x != 0,
        "Where": lambda c, a, b: np.where(c > 0, a, b),
        "NotBelowZero": lambda x: np.where(x < 0, np.nan, x),
        "ForceLimit": lambda x, peak: np.where(
            np.isfinite(x), np.clip(x, -np.maximum(peak, 0), np.maximum(peak, 0)), x
        ),
        "Tally": lambda x, before, after: x,
        "Active": lambda x: x,
    },
    {"Exp": np.exp, "Log": np.log, "Sin": np.sin, "Cos": np.cos, "Tanh": np.tanh},
)
