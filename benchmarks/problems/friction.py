"""Friction that sticks and slides: against its equation in continuous time, solved by
DOP853 from turn to turn.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from scipy import integrate

from stimlib.blocks import friction

from . import compiled
from .problem import Method, Problem, Signal, apart, on, own

# LuGre with Stribeck's curve (Canudas de Wit et al. 1995, eqs. 1 to 4): N/m, N s/m, N
# s/m, N, -, m/s
STIFFNESS, DAMPING, VISCOSITY, NORMAL, SLIDING, STATIC, SPEED = 2e4, 1.0, 0.4, 1.0, 0.6, 0.8, 0.02
DEPTH, TURNS, SECONDS = 2e-3, 5.0, 0.4  # m, Hz, s
FINEST = 64000.0


def place(t: np.ndarray) -> np.ndarray:
    return DEPTH * (1 - np.cos(2 * np.pi * TURNS * t))


def law(t: float, z: float) -> tuple[float, float]:
    """dz/dt and the force."""
    v = 2 * np.pi * TURNS * DEPTH * np.sin(2 * np.pi * TURNS * t)
    limit = NORMAL * (SLIDING + (STATIC - SLIDING) * np.exp(-((v / SPEED) ** 2)))
    rate = v - abs(v) * STIFFNESS / limit * z
    return rate, STIFFNESS * z + DAMPING * rate + VISCOSITY * v


@cache
def solved() -> np.ndarray:
    """The force's integral over time at FINEST; between two turns the equation has no
    corner.
    """
    t = np.arange(int(SECONDS * FINEST) + 1) / FINEST
    turns = np.arange(2 * TURNS * SECONDS + 1) / (2 * TURNS)
    found, y = np.zeros(t.size), [0.0, 0.0]
    for a, b in zip(turns[:-1], turns[1:], strict=True):
        run = integrate.solve_ivp(
            lambda t, y: law(t, y[0]),
            (a, b),
            y,
            "DOP853",
            rtol=1e-11,
            atol=1e-15,
            dense_output=True,
        )
        at = (t >= a) & (t <= b)
        found[at], y = run.sol(t[at])[1], run.y[:, -1]
    return found


def means(fs: float) -> np.ndarray:
    """Mean force of each sample but the first."""
    return np.diff(solved()[:: int(FINEST / fs)]) * fs


def euler(steps: int, fs: float) -> Signal:
    """As most papers do: dz by the velocity of two samples, the force as the mean of
    both ends of a step; so many of them in a sample.
    """
    loop = _euler()
    return lambda x: loop(x, fs, steps)


@cache
def _euler() -> Callable[[np.ndarray, float, int], np.ndarray]:
    from numba import njit

    @njit(error_model="numpy")
    def run(x, fs, steps):
        out, z, before = np.zeros(x.size), 0.0, 0.0
        for n in range(1, x.size):
            v = (x[n] - x[n - 1]) * fs
            limit = NORMAL * (SLIDING + (STATIC - SLIDING) * np.exp(-((v / SPEED) ** 2)))
            total = 0.0
            for _ in range(steps):
                rate = v - abs(v) * STIFFNESS / limit * z
                z += rate / (fs * steps)
                force = STIFFNESS * z + DAMPING * rate + VISCOSITY * v
                total += 0.5 * (force + before)
                before = force
            out[n] = total / steps
        return out

    return run


def exactly(fs: float) -> Signal:
    """Of straight paths, as the block does it."""
    law = STIFFNESS, DAMPING, VISCOSITY, NORMAL * SLIDING, NORMAL * STATIC, SPEED
    return lambda x: compiled.lugre(x, fs, law)


def by_lsoda(tol: float) -> Signal:
    """The reference's own way with less care, for the whole motion at once."""

    def run(x: np.ndarray) -> np.ndarray:
        fs = (x.size - 1) / SECONDS
        t = np.arange(x.size) / fs
        found = integrate.solve_ivp(
            lambda t, y: law(t, y[0]),
            (0.0, SECONDS),
            [0.0, 0.0],
            "LSODA",
            t,
            rtol=tol,
            atol=1e-6 * tol,
            max_step=0.01,
        )
        return np.r_[0.0, np.diff(found.y[1]) * fs]

    return run


def at_rate(fs: float) -> list[Method]:
    x, wanted = place(np.arange(int(SECONDS * fs) + 1) / fs), means(fs)

    def ours(x, _):
        damping: Any = {
            "static": STATIC,
            "speed": SPEED,
            "damping": DAMPING,
            "viscosity": VISCOSITY,
        }
        return friction(x, NORMAL, SLIDING, STIFFNESS, "lugre", **damping)

    ladders = {
        "stimlib friction (LuGre), fs": ([fs], own(ours, fs, "m")),
        "Euler, compiled, fs": ([fs], partial(euler, 1)),
        "Euler, compiled, 16 steps in a sample, fs": ([fs], partial(euler, 16)),
        "exact on straight paths, compiled, fs": ([fs], exactly),
    }
    if fs == 8000.0:
        ladders["scipy LSODA at 8 kHz, whole file, rtol"] = [1e-3, 1e-6, 1e-9], by_lsoda
    return on(x, lambda f: apart(f(x)[1:], wanted), ladders)


def sliding() -> list[Method]:
    return [
        m for fs in (1000.0, 2000.0, 4000.0, 8000.0, 16000.0, 32000.0, 64000.0) for m in at_rate(fs)
    ]


PROBLEMS = (
    Problem(
        "friction",
        "LuGre friction, 4 mm to and fro 5 times a second",
        "largest error to the mean force of a sample, of its maximum",
        int(SECONDS * 1000),
        sliding,
        "a millisecond",
    ),
)
