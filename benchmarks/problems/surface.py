"""Bumps under a moving finger, and a table of displacements: against closed forms in
long double.
"""

from __future__ import annotations

from functools import partial
from math import factorial

import numpy as np
from scipy import interpolate

from stimlib.blocks import bump, lut

from . import compiled
from .problem import Method, Problem, Signal, apart, on, own

FS, SAMPLES, DUTY = 8000.0, 1 << 16, 0.6
LD = np.longdouble


def stroke(t: np.ndarray) -> np.ndarray:
    """Where the finger is, in bumps: to and fro over 18 of them, up to 0.14 a
    sample.
    """
    return 9.0 - 9.0 * np.cos(2 * np.pi * 20.0 * t)


T = np.arange(SAMPLES) / FS
U = stroke(T)


CHUNK = 256  # samples of numpy's that stay in the cache


# Bumps --------------------------------------------------------------------------------
def mean_of_sine(u: np.ndarray) -> np.ndarray:
    """Mean of the sine bump over each movement, by its integral in long double; where
    the finger stands, the bump itself.
    """
    d = LD(DUTY)
    pi = LD(4) * np.arctan(LD(1))
    top = np.cos(pi * d)

    def integral(u: np.ndarray) -> np.ndarray:
        whole = np.floor(u)
        z = np.minimum(u - whole, d) / d  # along the ridge
        part = (
            d * (np.sin(2 * pi * d * (z - LD(0.5))) + np.sin(pi * d)) / (2 * pi * d) - top * d * z
        )
        ridge = d * (2 * np.sin(pi * d) / (2 * pi * d) - top)
        return (whole * ridge + part) / (1 - top)

    x = u.astype(LD)
    step = np.diff(x)
    return np.where(
        np.abs(step) > 1e-9, np.diff(integral(x)) / np.where(step == 0, LD(1), step), np.nan
    ).astype(float)


def envelope(u: np.ndarray) -> np.ndarray:
    """The bump at a place."""
    w = u - np.floor(u)
    top = np.cos(np.pi * DUTY)
    return np.where(w < DUTY, (np.cos(2 * np.pi * (w - DUTY / 2)) - top) / (1 - top), 0.0)


def averaged(f: Signal, n: int) -> Signal:
    """The mean of n points along a straight line from sample to sample."""
    part = (np.arange(n) + 0.5) / n

    def run(u: np.ndarray) -> np.ndarray:
        last = np.r_[u[0], u[:-1]]
        parts = [slice(k, k + CHUNK) for k in range(0, u.size, CHUNK)]
        return np.concatenate(
            [f(last[k, None] + (u[k] - last[k])[:, None] * part).mean(axis=1) for k in parts]
        )

    return run


def by_integral(u: np.ndarray) -> np.ndarray:
    """Differences of the bump's integral in float64; where the finger hardly moves, the
    bump in the middle.
    """
    d, top, whole = DUTY, np.cos(np.pi * DUTY), np.floor(u)
    z = np.minimum(u - whole, d)
    area = (np.sin(2 * np.pi * (z - d / 2)) + np.sin(np.pi * d)) / (2 * np.pi) - top * z
    area = (whole * (np.sin(np.pi * d) / np.pi - top * d) + area) / (1 - top)
    step, last = np.diff(u, prepend=u[0]), np.r_[u[0], u[:-1]]
    still = np.abs(step) < 1e-7
    mean = np.diff(area, prepend=area[0]) / np.where(still, 1.0, step)
    return np.where(still, envelope((u + last) / 2), mean)


def bumps() -> list[Method]:
    wanted = mean_of_sine(U)
    sure = np.isfinite(wanted)

    def error(f: Signal) -> float:
        return apart(f(U)[1:][sure], wanted[sure])

    def one_ridge(terms: int) -> Signal:
        sinc, cosine = compiled.SINC[:terms], compiled.COS[:terms]
        return lambda u: compiled.bumps(u, DUTY, sinc, cosine)

    def ours(sampling: str = "area", dtype: str = ""):
        return own(lambda u, duty: bump(u, "sine", duty, sampling=sampling), FS, dtype=dtype)

    return on(U, error, {
        "stimlib bump, area": ([DUTY], ours()),
        "stimlib bump, point": ([DUTY], ours("point")),
        "stimlib on JAX, float64": ([DUTY], ours(dtype="float64")),
        "stimlib on JAX, float32": ([DUTY], ours(dtype="float32")),
        "numpy, mean of so many points": ([1, 4, 16, 64], partial(averaged, envelope)),
        "numpy, differences of the integral": ([DUTY], lambda _: by_integral),
        "mean over one ridge, compiled, terms of a cosine": ([4, 6, 8, 12], one_ridge),
    })  # fmt: skip


# A table ------------------------------------------------------------------------------
def profile(x: np.ndarray) -> np.ndarray:
    """Displacement of a plate's mode along it, over its mean, as an equalisation table
    holds it.
    """
    return 1.0 + 0.6 * np.sin(np.pi * x / 0.1) ** 2 + 0.1 * np.sin(5 * np.pi * x / 0.1)


PLACES = 0.05 - 0.05 * np.cos(2 * np.pi * 0.7 * T)


def coefficients(y: np.ndarray, order: int) -> np.ndarray:
    """Of scipy's spline in each cell of equal knots, the highest power first, of the
    place within the cell: shape (order + 1, cells, ..).
    """
    at = np.arange(len(y), dtype=float)
    f = interpolate.make_interp_spline(at, y, order)
    return np.stack([f(at[:-1], k) / factorial(k) for k in range(order, -1, -1)])


def table() -> list[Method]:
    wanted = profile(PLACES)
    knobs = [5, 9, 17, 33, 65, 129]

    def error(f: Signal) -> float:
        return apart(f(PLACES), wanted)

    def knots(n: int) -> np.ndarray:
        return np.linspace(0.0, 0.1, n)

    def cells(order: int):
        def make(n: int) -> Signal:
            c = np.ascontiguousarray(coefficients(profile(knots(n)), order).T)
            return lambda x: compiled.pieces(x, c, (n - 1) / 0.1)

        return make

    def ours(kind: str):
        return own(lambda x, n: lut(x, knots(n), profile(knots(n)), kind), FS)

    return on(
        PLACES,
        error,
        {
            "stimlib lut linear, knots": (knobs, ours("linear")),
            "stimlib lut pchip, knots": (knobs, ours("pchip")),
            "stimlib lut cubic, knots": (knobs, ours("cubic")),
            "numpy interp, knots": (
                knobs,
                lambda n: lambda x: np.interp(x, knots(n), profile(knots(n))),
            ),
            "scipy PchipInterpolator, knots": (
                knobs,
                lambda n: interpolate.PchipInterpolator(knots(n), profile(knots(n))),
            ),
            "scipy make_interp_spline of order 5, knots": (
                knobs[1:],
                lambda n: interpolate.make_interp_spline(knots(n), profile(knots(n)), 5),
            ),
            "scipy CubicSpline, knots": (
                knobs,
                lambda n: interpolate.CubicSpline(knots(n), profile(knots(n))),
            ),
            "lines, compiled, knots": (knobs, cells(1)),
            "scipy spline of order 3, compiled, knots": (knobs, cells(3)),
            "scipy spline of order 7, compiled, knots": (knobs[1:], cells(7)),
        },
    )


PROBLEMS = (
    Problem(
        "bumps",
        "sine bumps under a finger, up to 0.14 bumps a sample",
        "largest error to the mean over the movement",
        SAMPLES,
        bumps,
    ),  # fmt: skip
    Problem(
        "table",
        "a table of displacements over 10 cm",
        "largest error to the smooth profile, of its maximum",
        SAMPLES,
        table,
    ),
)
