"""Which scheme should a springpot have by default, "l1" or "gl"?

    python benchmarks/schemes.py             print
    python benchmarks/schemes.py --record    and keep in results/schemes.csv

Errors are relative to the exact derivative of 1 - cos(2 pi f t) from rest (mpmath), of
the peak.  ``noise``: RMS of the force to white noise of the position, over chi
fs^alpha.
``largest chi``: of a hand and device of 0.1 kg and 0.5 N s/m that are held by the
springpot at 1 kHz, the largest that is stable.  Times are of six seconds at 1 kHz.
"""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
from bench import NS, Row, main, row
from timing import interleaved, medians

import stimlib
from stimlib import Input, Param, Scene
from stimlib.blocks import springpot
from stimlib.design.fractional import kernel

Y, FS = Input("y", "m"), 1000.0
SCHEMES, ORDERS = ("gl", "l1"), (0.1, 0.25, 0.5, 0.75)


def derivative(alpha: float, w: float, t: np.ndarray) -> np.ndarray:
    """D^alpha (1 - cos w t) from rest, by its power series."""
    out = []
    for x in t:
        with mp.workdps(40 + int(w * x)):
            z, total, k = (mp.mpf(w) * mp.mpf(x)) ** 2, mp.mpf(0), 0
            term = z / mp.gamma(3 - mp.mpf(alpha))
            while k * k < z or abs(term) > mp.mpf(10) ** -25:
                total += term
                term *= -z / ((2 * k + 3 - mp.mpf(alpha)) * (2 * k + 4 - mp.mpf(alpha)))
                k += 1
            out.append(float(total * mp.mpf(x) ** -alpha))
    return np.array(out)


def errors(fs: float, f: float, alpha: float) -> dict[str, float]:
    t = np.arange(int(min(2.0, 8 / f) * fs)) / fs
    y, at = 1 - np.cos(2 * math.pi * f * t), np.unique(np.linspace(1, t.size - 1, 60).astype(int))
    wanted = derivative(alpha, 2 * math.pi * f, t[at])
    found = {}
    for scheme in SCHEMES:
        scene = Scene({"f": springpot(Y, 1.0, alpha, scheme, tol=1e-13)})
        force = stimlib.compile(scene, fs).process(y[None])[0, at]
        found[scheme] = float(np.abs(force - wanted).max() / np.abs(wanted).max())
    return found


def stable(weights: np.ndarray, mass: float, damping: float) -> bool:
    """Whether a mass that is let go 1 mm from rest comes to rest."""
    n, keep = weights.size, math.exp(-damping / mass / FS)
    x, v, way = 1e-3, 0.0, np.zeros(n)
    for i in range(n):
        way[i] = x
        end = -(weights[: i + 1] @ way[i::-1]) / damping  # the speed that the force would reach
        x += end / FS + (v - end) * mass / damping * (1 - keep)
        v = end + (v - end) * keep
        if abs(x) > 1:
            return False
    return bool(np.abs(way[-500:]).max() < np.abs(way[:500]).max())


def largest(scheme: str, alpha: float, mass: float = 0.1, damping: float = 0.5) -> float:
    unit = np.diff(kernel(scheme, alpha, np.arange(3000)), prepend=0.0) * FS**alpha
    low, high = 100.0, 1e5
    while high / low > 1.005:
        chi = math.sqrt(low * high)
        low, high = (chi, high) if stable(chi * unit, mass, damping) else (low, chi)
    return low


def times() -> list[Row]:
    n = 6000
    y, alpha = 1 - np.cos(np.arange(n) / 200), 0.5 + 0.3 * np.sin(np.arange(n) / 500)
    jobs = {}
    for scheme in SCHEMES:
        for name, a in (("plain", 0.5), ("Param", Param("a", 0.5)), ("moving", Input("a"))):
            proc = stimlib.compile(Scene({"f": springpot(Y, 1.0, a, scheme)}), FS)
            x = np.array([{"y": y, "a": alpha}[one] for one in proc.inputs])
            jobs[f"{scheme}, {name} alpha"] = lambda proc=proc, x=x: proc.process(x)
    return [row(k, s / n * 1e9, NS) for k, s in medians(interleaved(jobs, 15)).items()]


def measure() -> list[Row]:
    rows = []
    for fs, f in ((1000.0, 1.0), (1000.0, 5.0), (1000.0, 20.0), (1000.0, 100.0), (8000.0, 5.0)):
        for alpha in ORDERS:
            for scheme, error in errors(fs, f, alpha).items():
                rows.append(
                    row(f"error, {fs:g} Hz, {f:g} Hz, alpha {alpha:g}, {scheme}", error, "of peak")
                )
    for alpha in ORDERS:
        for scheme in SCHEMES:
            v = kernel(scheme, alpha, np.arange(1 << 16))
            noise = float(np.linalg.norm(np.diff(v, prepend=0.0)))
            rows.append(row(f"noise, alpha {alpha:g}, {scheme}", noise, "chi fs^alpha"))
            rows.append(
                row(
                    f"largest chi, alpha {alpha:g}, {scheme}", largest(scheme, alpha), "N s^alpha/m"
                )
            )
    return rows + times()


if __name__ == "__main__":
    main("schemes", __doc__, measure)
