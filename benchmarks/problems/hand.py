"""A hand's motion from its reports, and its velocity: against the motion that was
reported.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy import interpolate, signal

from stimlib.blocks import track_velocity, velocity
from stimlib.motion.recorded import recording

from . import compiled
from .problem import Method, Problem, Signal, apart, on, own, searched

FS, SECONDS = 8000.0, 8.0
T = np.arange(int(FS * SECONDS)) / FS
# m, Hz, rad: strokes, and the tremor on them
PARTS = [(0.02, 0.7, 0.3), (0.006, 2.3, 1.1), (0.001, 6.0, 2.0)]


def truth(t: np.ndarray) -> np.ndarray:
    """In m."""
    return sum((a * np.sin(2 * np.pi * f * t + p) for a, f, p in PARTS), np.zeros_like(t))


def speed(t: np.ndarray) -> np.ndarray:
    """In m/s."""
    return sum(
        (2 * np.pi * f * a * np.cos(2 * np.pi * f * t + p) for a, f, p in PARTS), np.zeros_like(t)
    )


def reports(rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Times with a jitter of a tenth of a period, and where the hand was."""
    n = int(rate * SECONDS) + 2
    t = (np.arange(n) + 0.1 * np.random.default_rng(3).uniform(-1, 1, n)) / rate
    return t - t[0], truth(t - t[0])


def interpolation() -> list[Method]:
    rates = [30.0, 60.0, 125.0, 250.0, 500.0, 1000.0]

    def error(f: Signal) -> float:
        return apart(f(T), truth(T))

    def held(rate: float) -> Signal:
        t, x = reports(rate)
        return lambda now: x[np.searchsorted(t, now, side="right") - 1]

    def lines(rate: float) -> Signal:
        t, x = reports(rate)
        return lambda now: np.interp(now, t, x)

    def walked(order: int):
        """A spline at times that rise."""

        def make(rate: float) -> Signal:
            f = interpolate.PPoly.from_spline(interpolate.make_interp_spline(*reports(rate), order))
            some = np.diff(f.x) > 0
            ends, c = np.r_[f.x[:-1][some], f.x[-1]], np.ascontiguousarray(f.c[:, some].T)
            return lambda now: compiled.walked(now, ends, c)

        return make

    def recorded(rate: float) -> Signal:
        return recording(
            dict(zip(("t_s", "x"), reports(rate), strict=True)), {"x": "x"}
        ).motion_for(("x",))["x"]

    return on(T, error, {
        "stimlib recording (PCHIP), Hz": (rates, recorded),
        "the last report, held, Hz": (rates, held),
        "numpy interp, Hz": (rates, lines),
        "scipy CubicSpline, Hz": (rates, lambda rate: interpolate.CubicSpline(*reports(rate))),
        "scipy make_interp_spline of order 5, Hz": (
            rates, lambda rate: interpolate.make_interp_spline(*reports(rate), 5)),
        "scipy spline of order 3, compiled, Hz": (rates, walked(3)),
        "scipy spline of order 5, compiled, Hz": (rates, walked(5)),
    })  # fmt: skip


def velocities() -> list[Method]:
    """At once, as a loop needs it, and from whole files; the encoder counts
    micrometres.
    """
    x = np.round(truth(T) / 1e-6) * 1e-6
    late = T > 0.5

    def error(f: Signal) -> float:
        return apart(f(x)[late], speed(T)[late])

    cutoffs = [10.0, 30.0, 100.0, 300.0, 1000.0]

    def butter(cutoff: float, order: int) -> Signal:
        sos = signal.butter(order, cutoff, fs=FS, output="sos")
        return lambda x: signal.sosfilt(sos, np.diff(x, prepend=x[0]) * FS)

    def one_pole(cutoff: float) -> Signal:
        pole = float(np.exp(-2 * np.pi * cutoff / FS))
        return lambda x: compiled.lagged(x, pole, FS)

    def backward(points: int, apart: int) -> Signal:
        """The slope at the last of some samples, of the polynomial through them."""
        c = [[1, -1], [3 / 2, -2, 1 / 2], [11 / 6, -3, 3 / 2, -1 / 3]][points - 2]
        first = (points - 1) * apart

        def run(x: np.ndarray) -> np.ndarray:
            y, n = np.zeros(x.size), x.size
            for k, weight in enumerate(c):
                y[first:] += weight * FS / apart * x[first - k * apart : n - k * apart]
            return y

        return run

    def local(n: int, order: int) -> Signal:
        return lambda x: signal.savgol_filter(x, n, order, deriv=1, delta=1 / FS)

    return on(
        x,
        error,
        {
            "stimlib velocity, cutoff Hz": (cutoffs, own(velocity, FS, "m")),
            "stimlib track_velocity, bandwidth Hz": (cutoffs[:-1], own(track_velocity, FS, "m")),
            "difference in scipy butter, cutoff Hz": (
                cutoffs,
                lambda cutoff: searched(error, product([cutoff], [1, 2, 3, 4]), butter),
            ),
            "difference and one pole, compiled, cutoff Hz": (cutoffs, one_pole),
            "numpy, samples n apart, samples": (
                [2, 3, 4],
                lambda points: searched(error, product([points], range(1, 65)), backward),
            ),
            "difference of two samples": ([2], lambda _: lambda x: np.diff(x, prepend=x[0]) * FS),
            "Savitzky-Golay, whole file, window": (
                [21, 81, 321, 801],
                lambda n: searched(error, product([n], range(1, 8)), local),
            ),
        },
    )


PROBLEMS = (
    Problem(
        "motion",
        "a hand's position at 8 kHz from its reports",
        "largest error to the motion, of its maximum",
        T.size,
        interpolation,
        asked=True,
    ),  # fmt: skip
    Problem(
        "velocity",
        "a hand's velocity at 8 kHz, counts of 1 um",
        "largest error to the velocity, of its maximum",
        T.size,
        velocities,
    ),  # fmt: skip
)
