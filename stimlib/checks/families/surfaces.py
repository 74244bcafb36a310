"""Laws of surfaces: gratings in extended precision, and noise by Gauss quadrature.

The rule is applied in each of its cells.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...design.noise import octaves
from ...errors import counted
from .. import laws
from ..evidence import Asked, Check, law_of
from ..laws import LOW, philox, ways
from ..rows import Row, before, law, near

MOST = 20_000  # samples at which the scene's law is computed, evenly over the run
LAW_DB = 0.5
PI = np.longdouble("3.14159265358979323846264338327950288")


def gratings(before: np.ndarray, x: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Return the mean of a grating over each movement, in extended precision.

    The grating is sum depth sin(2 pi x/wavelength + phase).
    """
    a, b, total = (
        before.astype(np.longdouble),
        x.astype(np.longdouble),
        np.zeros(x.size, np.longdouble),
    )
    for wavelength, depth, phase in parts.astype(np.longdouble):
        half = PI * (b - a) / wavelength
        size = np.where(half == 0, 1, np.sin(half) / np.where(half == 0, 1, half))
        total += depth * size * np.sin(PI * (a + b) / wavelength + phase)
    return total.astype(float)


class Roughness(NamedTuple):
    """The arguments of noise over position, as ``spatial_noise`` takes them."""

    slope: float
    longest: float  # m
    shortest: float  # m
    seed: int


def roughness(before: np.ndarray, x: np.ndarray, b: Any) -> np.ndarray:
    """Return the mean of noise over position for each movement.

    Two-point Gauss quadrature is exact in each cell of its splines.
    """
    found = octaves(b.slope, 1 / b.longest, 1 / b.shortest)
    total, lost = np.zeros(x.size), 0.0
    for j, (cell, own) in enumerate(zip(found.cells, found.power, strict=True)):
        low, high = np.sort([before, x], axis=0) / cell + _word(b.seed, 2 * j + 1) * 2.0**-64
        gain = np.sqrt(_faded(high - low) * (own + (1 - _faded(2 * (high - low))) * lost / cell))
        lost += own * cell
        on = gain > 0
        if on.any():
            total[on] += gain[on] * _spline(_word(b.seed, 2 * j), low[on], high[on])
    return total


def _spline(key: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the mean of a random quadratic spline between two positions.

    They are less than four cells apart.
    """
    first = np.floor(low)
    cells, place = np.unique(first.astype(np.int64), return_inverse=True)
    z = _lattice(key, cells[:, None] + np.arange(7))[place].T
    way, mean = high - low, np.zeros(low.size)
    for k in range(int(np.max(np.floor(high) - first)) + 1):
        a, b = (np.clip(v, first + k, first + k + 1) for v in (low, high))
        part = np.where(way > 0, (b - a) / np.where(way > 0, way, 1), k == 0)
        for point in (-1, 1):
            t = (a + b) / 2 - first - k + point * (b - a) / math.sqrt(12)
            mean += (
                part
                / 2
                * (z[k] * (1 - t) ** 2 / 2 + z[k + 1] * (0.5 + t - t**2) + z[k + 2] * t**2 / 2)
            )
    return mean


def _faded(r: np.ndarray) -> np.ndarray:
    """Return the fraction of an octave's power kept when a movement passes r cells.

    It is 1 up to r = 2, 0 from r = 4 on, and a cubic in between.
    """
    t = np.clip((r - 2) / 2, 0, 1)
    return 1 - 3 * t**2 + 2 * t**3


def _word(seed: int, stream: int) -> int:
    """Return the 64-bit word of a stream of a surface."""
    w = philox((seed & LOW, seed >> 32, stream, 3), (0, 0))
    return w[0] | w[1] << 32


def _lattice(key: int, m: np.ndarray) -> np.ndarray:
    """Return the random values at lattice points.

    Each half of a Philox block is a sum of four uniform numbers of 16 bits.
    """
    pair = (m >> 1).astype(np.uint64)
    w = philox((pair & LOW, pair >> 32, 0, 0), (key & LOW, key >> 32))
    a, b = (np.where(m % 2, w[i + 2], w[i]) for i in (0, 1))
    total = (a & 0xFFFF) + (a >> 16) + (b & 0xFFFF) + (b >> 16)
    return (total.astype(float) - 2 * 65535) / math.sqrt((65536.0**2 - 1) / 3)


@law_of("grating")
def grating(a: Asked) -> list[Check]:
    """Check the scene ``grating``.

    Its output is a sum of parameters times gratings and noise over position, each
    computed again from the movement alone.
    """
    g, x, n = a.given, a.x["x"], a.n
    before, on = ways(x, a.contact)
    ribs = [
        (a.live(depth), g[wavelength])
        for depth, wavelength in (("depth", "coarse"), ("fine_depth", "fine"))
    ]
    rough = Roughness(g["slope"], g["longest"], g["shortest"], g["seed"])
    a.say("gratings: " + ", ".join(f"{1000 * wavelength:.4g} mm" for _, wavelength in ribs))
    a.say(
        f"roughness: 1/f^{rough.slope:g} over {rough.shortest:g} to {rough.longest:g} m, seed"
        f" {rough.seed}"
    )
    bound = np.full(n, 1e-300)
    # a place is rounded, and so its phase
    for depth, wavelength in [*ribs, (a.live("roughness"), rough.shortest)]:
        bound += np.abs(depth) * (1e-12 + 2.0**-44 * np.abs(x) / wavelength) + a.slack * np.abs(
            depth
        ).max(initial=0.0)

    def force(at: Any) -> np.ndarray:
        total = a.live("roughness")[at] * roughness(before[at], x[at], rough)
        for depth, wavelength in ribs:
            total += depth[at] * gratings(before[at], x[at], np.array([[wavelength, 1.0, 0.0]]))
        return np.where(on[at], total, 0.0)

    at = np.unique(np.linspace(0, n - 1, min(n, MOST)).astype(int))
    error = np.zeros(n)
    error[at] = (a.y["force"][at] - force(at)) / bound[at]
    a.expect("force", lambda: force(np.arange(n)), float(bound.max(initial=0.0)))
    text = (
        f"error over its bound, {counted(at.size, 'sample')}: what is at a place, averaged"
        " over each movement,"
        " written again"
    )
    name = a.title("force")
    return [
        Check(
            "d",
            f"{name}: octaves of the roughness",
            _from_law(rough),
            LAW_DB,
            f"dB from 1/f^{rough.slope:g}",
        ),
        Check("d", f"{name}: gratings and roughness of the place", a.far(error), 1.0, text),
        a.silent("force", ~on),
    ]


def _from_law(b: Any) -> float:
    """Return the largest deviation of the octaves' spectrum from C f^-slope, in dB.

    The spectrum has the power 1.
    """
    found, f = (
        octaves(b.slope, 1 / b.longest, 1 / b.shortest),
        np.geomspace(1 / b.longest, 1 / b.shortest, 2001),
    )
    power = np.trapezoid(f ** (1 - b.slope), np.log(f))
    made = sum(
        2 * a * d * np.sinc(f * d) ** 6 for a, d in zip(found.power, found.cells, strict=True)
    )
    return float(np.abs(10 * np.log10(made * power * f**b.slope)).max())


@law("LinearBump", "SineBump", since=1)
def _bump(b, fs, x, y):
    last = before(x[0], x[2]) if b.sampling == "area" else x[0]
    want, lost = laws.bump_envelope(last, x[0], b.waveform, np.clip(x[1], 1e-6, 1))
    return np.where(x[2] > 0, want, 0), 1e-13 + lost


@law("TableBump", since=1)
def _table_bump(b, fs, x, y):
    u, d, contact = x[0].astype(np.longdouble), np.clip(x[1], 1e-6, 1), x[2]
    v = np.array(b.values)
    knots, sums = (
        np.linspace(0, 1, v.size),
        np.r_[0.0, np.cumsum((v[1:] + v[:-1]) / 2)] / (v.size - 1),
    )

    def integral(u: Row) -> Row:
        z = np.minimum((u - np.floor(u)) / d, 1)
        k = np.minimum((z * (v.size - 1)).astype(int), v.size - 2)
        r = z - knots[k]
        return d * (
            np.floor(u) * sums[-1] + sums[k] + r * (v[k] + r * (v[k + 1] - v[k]) * (v.size - 1) / 2)
        )

    last = before(u, contact) if b.sampling == "area" else u
    way = u - last
    z = (u - np.floor(u)) / d
    point = np.where(z < 1, np.interp(z.astype(float), knots, v), 0)
    still = np.abs(way) < 1e-9
    edge = still & (np.minimum(np.abs(z - 1), np.abs(u - np.rint(u))) < 1e-8)
    want = np.where(still, point, (integral(u) - integral(last)) / np.where(still, 1, way)).astype(
        float
    )
    size = max(float(np.abs(v).max()), 1e-300)
    return np.where(contact > 0, want, 0), np.where(edge, np.inf, 1e-7 * size / np.minimum(d, 1))


@law("Grating", since=1)
def _grating(b, fs, x, y):
    u, contact = x
    wavelength, depth, _ = b.parts.T
    tol = np.abs(depth) @ (1e-12 + 2.0**-44 * np.abs(u) / wavelength[:, None])
    return np.where(contact > 0, gratings(before(u, contact), u, b.parts), 0), tol


@law("SpatialNoise", since=1)
def _spatial_noise(b, fs, x, y):
    u, contact = x
    return (
        np.where(contact > 0, roughness(before(u, contact), u, b), 0),
        3e-11 + 2.0**-40 * np.abs(u) / b.shortest,
    )


@law("Midpoint", since=1)
def _midpoint(b, fs, x, y):
    return near(np.where(x[1] > 0, (before(x[0], x[1]) + x[0]) / 2, 0), 1e-15)
