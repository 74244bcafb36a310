"""What is at a place under a moving finger: ribs, roughness, maps, measured textures.

Against closed forms in long double, and against the same surfaces written again for the
verifier.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from scipy import interpolate, ndimage, signal

from stimlib.blocks import grating, lut2, spatial_noise, texture
from stimlib.checks import laws
from stimlib.checks.families.surfaces import _lattice, _word, gratings, roughness
from stimlib.core.graph import Input
from stimlib.design.noise import octaves
from stimlib.design.texture import made_up

from . import compiled
from .problem import Method, Problem, Signal, apart, on, own
from .surface import LD, averaged, coefficients

FS, SAMPLES = 8000.0, 1 << 14
T = np.arange(SAMPLES) / FS
X = 0.005 - 0.005 * np.cos(2 * np.pi * 1.7 * T + 0.1)  # m, up to 7 um a sample
BEFORE = np.r_[X[:1], X[:-1]]

# Ribs ---------------------------------------------------------------------------------
# m, depth, rad: coarse, and up to 0.33 of fine ones in a sample
RIBS = np.array([(1e-3, 1.0, 0.0), (2e-5, 0.5, 1.0)])


def ribs(x: np.ndarray) -> np.ndarray:
    return sum(depth * np.sin(2 * np.pi / wave * x + phase) for wave, depth, phase in RIBS)


def gauss(n: int) -> Signal:
    """The mean over a movement by Gauss' rule."""
    at, weight = np.polynomial.legendre.leggauss(n)

    def run(x: np.ndarray) -> np.ndarray:
        last = np.r_[x[0], x[:-1]]
        return sum(
            w / 2 * ribs(last + (x - last) * (1 + t) / 2) for t, w in zip(at, weight, strict=True)
        )

    return run


def in_closed_form(x: np.ndarray) -> np.ndarray:
    """The mean over a movement, by the sines of its middle and its half."""
    last = np.r_[x[0], x[:-1]]
    middle, half = np.pi * (x + last), np.pi * (x - last)
    half[half == 0] = 1e-30
    return sum(
        depth / (half / wave) * np.sin(half / wave) * np.sin(middle / wave + phase)
        for wave, depth, phase in RIBS
    )


def with_terms(n: int) -> Signal:
    """The same with so many terms of a sine up to a quarter of a turn."""
    sine = compiled.SINC[:n]
    return lambda x: compiled.ribs(x, RIBS, sine, sine)


def over_ribs() -> list[Method]:
    wanted = gratings(BEFORE, X, RIBS)

    def ours(dtype: str = ""):
        return own(lambda x, _: grating(x, RIBS), FS, "m", dtype)

    return on(X, lambda f: apart(f(X)[1:], wanted[1:]), {
        "stimlib grating": ([""], ours()),
        "stimlib on JAX, float64": ([""], ours("float64")),
        "points in numpy": ([""], lambda _: ribs),
        "numpy, mean of so many points": ([2, 4, 16, 64], lambda n: averaged(ribs, n)),
        "numpy, mean of so many Gauss points": ([1, 2, 4, 8], gauss),
        "numpy, closed form": ([""], lambda _: in_closed_form),
        "closed form, compiled, terms of a sine": ([3, 4, 6, 8, 11], with_terms),
    })  # fmt: skip


# Roughness ----------------------------------------------------------------------------
SHORTEST = 2e-5  # m


def rough(x, _=None):
    return spatial_noise(x, 1.0, seed=4, shortest=SHORTEST)


@cache
def known(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Places and heights, so many in the shortest wavelength."""
    at = np.arange(int(0.01 / SHORTEST * points) + 2) * SHORTEST / points
    return at, roughness(at, at, rough(Input("x", "m")))


def parabolas() -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray, np.ndarray]:
    """The surface between the ends of all cells of all octaves, where it is a parabola:
    exact while no movement passes two of the smallest cells.

    A place in units of those cells, the ends, the coefficients.
    """
    b = rough(Input("x", "m"))
    found = octaves(b.slope, 1 / b.longest, 1 / b.shortest)
    size, n = found.cells[0], found.cells.size
    starts = np.array([_word(b.seed, 2 * j + 1) * 2.0**-64 for j in range(n)])
    long = 2.0 ** np.arange(n)
    shift, last = starts - starts[0] / long, 0.0101 / size + starts[0]
    ends = [(np.arange(np.ceil(s), last / v + s) - s) * v for s, v in zip(shift, long, strict=True)]
    at = np.unique(np.r_[0.0, last, np.concatenate(ends)])
    c = np.zeros((3, at.size - 1))
    for j, (s, v, power) in enumerate(zip(shift, long, found.power, strict=True)):
        m = np.floor((at[1:] + at[:-1]) / 2 / v + s)
        z = _lattice(_word(b.seed, 2 * j), m.astype(np.int64) + np.arange(3)[:, None])
        t, gain = at[:-1] / v + s - m, np.sqrt(power)
        c[0] += gain / v**2 * (z[0] / 2 - z[1] + z[2] / 2)
        c[1] += gain / v * (z[0] * (t - 1) + z[1] * (1 - 2 * t) + z[2] * t)
        c[2] += gain * (z[0] * (1 - t) ** 2 / 2 + z[1] * (0.5 + t - t * t) + z[2] * t * t / 2)
    return lambda x: x / size + starts[0], at, c


def over_roughness() -> list[Method]:
    wanted = roughness(BEFORE, X, rough(Input("x", "m")))

    def looked_up(points: int) -> Signal:
        return lambda x: np.interp(x, *known(points))

    def by_integral(points: int) -> Signal:
        """Differences of the table's integral over those of the places."""
        at, y = known(points)
        area = interpolate.CubicSpline(at, y).antiderivative()
        return lambda x: np.r_[0.0, np.diff(area(x)) / np.diff(x)]

    unit, ends, c = parabolas()

    def exact(_: str) -> Signal:
        first = np.searchsorted(ends, np.arange(int(ends[-1]) + 1), side="right") - 1
        rows = np.ascontiguousarray(c.T)
        return lambda x: compiled.means(unit(x), ends, rows, first)

    def by_exact_integral(_: str) -> Signal:
        area = interpolate.PPoly(c, ends).antiderivative()

        def run(x: np.ndarray) -> np.ndarray:
            u = unit(x)
            return np.r_[0.0, np.diff(area(u)) / np.diff(u)]

        return run

    knobs = [1, 2, 4, 8, 16, 64]
    return on(X, lambda f: apart(f(X)[1:], wanted[1:]), {
        "stimlib spatial_noise": ([""], own(rough, FS, "m")),
        "points of a table in numpy interp, points in 20 um": (knobs, looked_up),
        "integral of a scipy CubicSpline, points in 20 um": (knobs, by_integral),
        "integral of its parabolas in scipy PPoly": ([""], by_exact_integral),
        "its parabolas, compiled": ([""], exact),
    })  # fmt: skip


# A map --------------------------------------------------------------------------------
SIDE = 0.04  # m
PLACES = SIDE / 2 + 0.019 * np.array(
    [np.sin(2 * np.pi * 1.3 * T), np.sin(2 * np.pi * 1.7 * T + 1.0)]
)


def lumps(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Stiffness of a soft object with two nodules, in N/m."""
    far = [
        ((x - a) ** 2 + (y - b) ** 2) / (2 * r**2)
        for a, b, r in ((0.012, 0.015, 0.004), (0.027, 0.022, 0.006))
    ]
    return 300.0 + 500.0 * np.exp(-far[0]) + 200.0 * np.exp(-far[1])


def maps() -> list[Method]:
    wanted, sizes = lumps(*PLACES), [11, 21, 41, 81, 161]

    def table(n: int) -> tuple[np.ndarray, np.ndarray]:
        at = np.linspace(0.0, SIDE, n)
        return at, lumps(at[:, None], at[None])

    def ours(kind: str):
        return own(
            lambda x, y, n: lut2(x, y, table(n)[1], SIDE / (n - 1), kind=kind).value, FS, ("m", "m")
        )  # type: ignore[attr-defined]

    def spline(n: int, order: int = 3) -> Signal:
        at, z = table(n)
        f = interpolate.RectBivariateSpline(at, at, z, kx=order, ky=order)
        return lambda x: f.ev(x[0], x[1])

    def lines(n: int) -> Signal:
        at, z = table(n)
        f = interpolate.RegularGridInterpolator((at, at), z)
        return lambda x: f(x.T)

    def image(order: int):
        def make(n: int) -> Signal:
            z = table(n)[1]
            c = ndimage.spline_filter(z, order, mode="mirror") if order > 1 else z
            return lambda x: ndimage.map_coordinates(
                c, x * ((n - 1) / SIDE), order=order, mode="mirror", prefilter=False
            )

        return make

    def cells(order: int):
        def make(n: int) -> Signal:
            rows = coefficients(table(n)[1], order)  # along x, and of those along y
            c = coefficients(np.moveaxis(rows, 2, 0), order).transpose(3, 1, 2, 0)
            c = np.ascontiguousarray(c)
            return lambda x: compiled.patches(x, c, (n - 1) / SIDE)

        return make

    def planes(n: int) -> Signal:
        z = table(n)[1]
        return lambda x: compiled.planes(x, z, (n - 1) / SIDE)

    return on(PLACES, lambda f: apart(f(PLACES), wanted), {
        "stimlib lut2 linear, points": (sizes, ours("linear")),
        "stimlib lut2 cubic, points": (sizes, ours("cubic")),
        "scipy RegularGridInterpolator, points": (sizes, lines),
        "scipy RectBivariateSpline, points": (sizes, spline),
        "scipy RectBivariateSpline of order 5, points": (sizes, lambda n: spline(n, 5)),
        "scipy map_coordinates, order 1, points": (sizes, image(1)),
        "scipy map_coordinates, order 3, points": (sizes, image(3)),
        "scipy map_coordinates, order 5, points": (sizes, image(5)),
        "planes, compiled, points": (sizes, planes),
        "scipy spline of order 3, compiled, points": (sizes, cells(3)),
        "scipy spline of order 5, compiled, points": (sizes, cells(5)),
    })  # fmt: skip


# A measured texture -------------------------------------------------------------------
MODEL, SEED = made_up(), 1
STROKES = np.array(
    [
        0.08 + 0.06 * np.sin(2 * np.pi * 3.0 * np.arange(4000) / 1000),
        1.0 + 0.5 * np.sin(np.arange(4000) / 700),
    ]
)


def in_long_double(noise: np.ndarray) -> np.ndarray:
    """The law of STROKES; that of the verifier has an error of 1.4e-15 by rounding."""
    places = np.c_[MODEL.speed, MODEL.force]
    top = places.max(axis=0)
    at = laws.texture_weights(STROKES.T / top, places / top, MODEL.triangles.astype(int))[0]
    corners = np.concatenate([places[at].astype(LD), np.ones((*at.shape, 1), LD)], axis=2)
    x = np.c_[STROKES.T.astype(LD), np.ones(len(at), LD)]
    # a weight is the triangle of a place and two corners
    w = np.stack([_volume(x, *(corners[:, k - j] for j in (2, 1))) for k in range(3)], axis=1)
    w /= w.sum(axis=1, keepdims=True)
    lsf, ma, variance, gain = (
        np.einsum("nk,nk...->n...", w, v.astype(LD)[at])
        for v in (MODEL.lsf, MODEL.ma, MODEL.variance, MODEL.gain)
    )
    ar, ma = (_polynomial(v)[:, ::-1] for v in (lsf, ma))
    v = np.r_[np.zeros(ma.shape[1]), gain * np.sqrt(variance) * noise]
    y = np.zeros(ar.shape[1] + noise.size, LD)
    for n, (a, b) in enumerate(zip(ar, ma, strict=True)):
        p, q = n + ar.shape[1], n + ma.shape[1]
        y[p] = v[q] + (b * v[n:q]).sum() - (a * y[n:p]).sum()
    return y[ar.shape[1] :].astype(float)


def _volume(x: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (np.cross(a, b) * x).sum(axis=1)


def _polynomial(lsf: np.ndarray) -> np.ndarray:
    """Of line spectral frequencies, an even number, without the leading 1."""
    halves = []
    for first, end in ((0, 1), (1, -1)):
        half = np.ones((len(lsf), 1), LD)
        for k in range(first, lsf.shape[1], 2):
            half = _times(half, -2 * np.cos(lsf[:, k : k + 1]), 1)
        halves.append(_times(half, end, 0)[:, :-1])
    return (halves[0] + halves[1])[:, 1:-1] / 2


def _times(p: np.ndarray, first: Any, second: float) -> np.ndarray:
    """By 1 + first z + second z^2."""
    one, two = (np.pad(p, ((0, 0), (k, 2 - k))) for k in (1, 2))
    return np.pad(p, ((0, 0), (0, 2))) + first * one + second * two


@cache
def _direct() -> Callable[..., np.ndarray]:
    from numba import njit

    @njit(error_model="numpy")
    def run(ar, ma, size, noise, every):
        v, y = np.empty(noise.size), np.empty(noise.size)
        for n in range(noise.size):
            m = n // every
            v[n] = size[m] * noise[n]
            total = v[n]
            for j in range(1, min(n + 1, ma.shape[1])):
                total += ma[m, j] * v[n - j]
            for j in range(1, min(n + 1, ar.shape[1])):
                total -= ar[m, j] * y[n - j]
            y[n] = total
        return y

    return run


def textures() -> list[Method]:
    """At the model's own rate; speed and force never rest."""
    noise = laws.white(0, SEED, 0, 0, STROKES.shape[1])
    wanted = in_long_double(noise)
    top = np.array([MODEL.speed.max(), MODEL.force.max()])

    def models(every: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Models between the measured ones, of every so many samples."""
        corners, w = laws.texture_weights(
            x.T[::every] / top,
            np.stack([MODEL.speed, MODEL.force], axis=1) / top,
            MODEL.triangles.astype(int),
        )
        mean = [
            np.einsum("nk,nk...->n...", w, v[corners])
            for v in (MODEL.lsf, MODEL.ma, MODEL.variance, MODEL.gain)
        ]
        ar, ma = (np.insert(laws.from_line_spectrum(v), 0, 1.0, axis=1) for v in mean[:2])
        return ar, ma, mean[3] * np.sqrt(mean[2])

    def renewed(every: int) -> Signal:
        """Each is a filter of scipy until the next."""

        def run(x: np.ndarray) -> np.ndarray:
            ar, ma, size = models(every, x)
            zi, y = np.zeros(max(ar.shape[1], ma.shape[1]) - 1), np.empty(x.shape[1])
            for k in range(len(ar)):
                at = slice(k * every, (k + 1) * every)
                y[at], zi = signal.lfilter(ma[k], ar[k], size[k] * noise[at], zi=zi)
            return y

        return run

    def direct(every: int) -> Signal:
        """As the reference: the outputs and what drives them are kept apart."""
        loop = _direct()
        return lambda x: loop(*models(every, x), noise, every)

    def at_once(_: str) -> Signal:
        """All models in columns, then all filters."""
        t, at = MODEL.triangles.astype(int), np.c_[MODEL.speed, MODEL.force]
        edges = np.moveaxis(at[t[:, :2]] - at[t[:, 2:]], 1, 2)
        some = np.abs(np.linalg.det(edges)) > 1e-9
        where = at[t[some, 2]], np.linalg.inv(edges[some])
        columns = np.c_[MODEL.lsf, MODEL.ma, MODEL.variance, MODEL.gain][t[some]]
        return lambda x: compiled.textured(compiled.models(x, columns, *where), noise)

    return on(
        STROKES,
        lambda f: apart(f(STROKES), wanted),
        {
            "stimlib texture": (
                [""],
                own(lambda v, f, _: texture(v, f, MODEL, SEED), 1000.0, ("m/s", "N")),
            ),
            "scipy lfilter, renewed every n samples": ([1, 3, 10, 30, 100], renewed),
            "direct form 1, compiled, renewed every n samples": ([1, 3, 10, 30, 100], direct),
            "direct form 1 and its models, compiled": ([""], at_once),
        },
    )


MEAN = "largest error to the mean over the movement, of its maximum"
PROBLEMS = (
    Problem(
        "grating", "ribs under a finger, up to 0.33 fine ones in a sample", MEAN, SAMPLES, over_ribs
    ),
    Problem("roughness", "noise over place under a finger", MEAN, SAMPLES, over_roughness),
    Problem(
        "map",
        "a map of stiffness, 4 by 4 cm",
        "largest error to the smooth map, of its maximum",
        SAMPLES,
        maps,
    ),
    Problem(
        "texture",
        "a measured texture at 1 kHz, stroked",
        "largest error, of the maximum",
        STROKES.shape[1],
        textures,
    ),
)
