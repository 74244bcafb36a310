"""Fits of textures to recordings of an accelerometer on a stroking tool.

Speed and force may vary freely during the recording.

Sources: Culbertson, Unwin and Kuchenbecker, "Modeling and rendering realistic textures
from unconstrained tool-surface interactions", IEEE Trans. Haptics 7 (2014); de Waele
and Broersen, "The Burg algorithm for segments", IEEE Trans. Signal Processing 48
(2000).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from ..core.graph import unmasked
from ..design.texture import ORDER, TextureModel, frequencies
from ..errors import BadValue, Count, public

LARGEST = 1e9  # number in a recording, whatever its unit
SHORTEST = 4  # samples for each coefficient in a stretch that is used


class Bin(NamedTuple):
    """A range of speeds and forces, with the data found in it."""

    speed: tuple[float, float]  # m/s, from and to
    force: tuple[float, float]  # N
    seconds: float  # in stretches that are long enough
    left_out: str  # why, or nothing where it has a model


class Point(NamedTuple):
    """A model, with the speed and force that it belongs to."""

    speed: float
    force: float
    lsf: np.ndarray
    variance: float


@dataclass(frozen=True, eq=False, repr=False)
class TextureFit:
    """A fitted texture, with the recording that it was fitted to.

    Attributes
    ----------
    model : TextureModel
        For ``stimlib.blocks.texture`` and ``save_texture``.
    bins : list of Bin
        All bins, including those that are left out.
    """

    model: TextureModel
    bins: list[Bin]

    @property
    def left_out(self) -> list[Bin]:
        """Bins without a model because they had too little data.

        The models of neighbouring bins are used instead.
        """
        return [b for b in self.bins if b.left_out]

    def __repr__(self):
        used = [b for b in self.bins if not b.left_out]
        said = "".join(
            f"; left out {b.speed[0]:.3g} to {b.speed[1]:.3g} m/s, {b.force[0]:.3g} to"
            f" {b.force[1]:.3g} N: {b.left_out}"
            for b in self.left_out
        )
        order = self.model.lsf.shape[1]
        return (
            f"TextureFit({len(used)} of {len(self.bins)} bins, order {order},"
            f" {sum(b.seconds for b in used):.3g} s{said})"
        )


@public
def burg(stretches: Sequence[np.ndarray], order: Count) -> tuple[np.ndarray, float]:
    """Fit an autoregressive model to several segments by Burg's method.

    All segments are realisations of one process.

    Each reflection coefficient k minimises the summed forward and backward errors of
    all segments, so abs(k) < 1 and the model is stable for any data. Unlike an
    autocorrelation, the method does not assume that a segment is 0 beyond its ends.

    Parameters
    ----------
    stretches : sequence of ndarray
        Segments, each longer than the order.
    order : int

    Returns
    -------
    a : ndarray, shape (order + 1,)
        1 + sum a_k z^-k.
    power : float
        Mean square of the driving noise.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from stimlib.fitting.texture import burg
    >>> x = lfilter(
    ...     [0.5], [1.0, -1.2, 0.8], np.random.default_rng(0).standard_normal(40000)
    ... )
    >>> a, power = burg(np.split(x, 400), 2)
    >>> a.round(1), round(power, 2)
    (array([ 1. , -1.2,  0.8]), 0.25)
    """
    stretches = [np.asarray(x, float) for x in stretches]
    if any(x.ndim != 1 or x.size <= order or not np.isfinite(x).all() for x in stretches):
        raise BadValue(
            f"burg: stretches must be rows of more than order = {order} finite numbers; leave out"
            " the shorter ones"
        )
    forward, backward = [x[1:] for x in stretches], [x[:-1] for x in stretches]
    power = sum(float(x @ x) for x in stretches) / sum(x.size for x in stretches)
    a = np.ones(1)
    for _ in range(order):
        both = sum(float(f @ f + b @ b) for f, b in zip(forward, backward, strict=True))
        k = (
            -2 * sum(float(f @ b) for f, b in zip(forward, backward, strict=True)) / both
            if both > 0
            else 0.0
        )
        pairs = [(f + k * b, b + k * f) for f, b in zip(forward, backward, strict=True)]
        forward, backward = [f[1:] for f, _ in pairs], [b[:-1] for _, b in pairs]
        a = np.r_[a, 0.0] + k * np.r_[0.0, a[::-1]]
        power *= 1 - k * k
    return a, power


@public
def fit_texture(
    acceleration,
    speed,
    force,
    fs: float,
    *,
    order: int = 14,
    speeds=5,
    forces=4,
    seconds: float = 1.0,
    name: str = "",
) -> TextureFit:
    """Fit a texture model to a recording.

    There is one autoregressive model for each range of speeds and forces that has
    enough data.

    Each model is placed at the mean speed and force of its bin.  At speed 0 and at
    force 0 there is no vibration; at the largest speed and force, the border of the
    rectangle has the models of the nearest bins.  Interpolation uses the Delaunay
    triangulation in speed and force, each divided by its largest value.

    Parameters
    ----------
    acceleration : array_like, shape (n,)
        In m/s^2, from one axis, or three axes combined (see ``Notes``).
    speed, force : array_like, shape (n,)
        Speed along the surface in m/s, whose sign is ignored, and normal force in N.
    fs : float
        Sample rate of all three in Hz; the model runs at this rate.  Resample a faster
        recording to 1000 Hz first (``scipy.signal.resample_poly``).
    order : int
        Order of the models.
    speeds, forces : int or array_like
        Number of ranges, each with about the same number of samples; or the edges of
        the ranges in m/s and N.
    seconds : float
        A bin with less data than this, in segments of at least 4 samples per
        coefficient, is left out.
    name : str

    Returns
    -------
    TextureFit
        The ``model``, and its ``bins``, some of which may be left out.

    Raises
    ------
    BadValue
        Signals that contain NaN or infinity or differ in length; edges that do not
        rise; order, rate or seconds out of range; or no bin with enough data.

    Notes
    -----
    The skin hardly perceives the direction of a vibration, so the toolkit's authors
    combined three axes into one signal: the sum of the axes' spectra, with the phase of
    the sum (DFT321: Landin, Romano, McMahan, Kuchenbecker, EuroHaptics 2010).

    References
    ----------
    See the head of the module. The published models segment the signal by its
    stationarity; these segment it by speed and force alone.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import texture
    >>> from stimlib.design.texture import made_up
    >>> from stimlib.fitting import fit_texture
    >>> t = np.arange(60_000) / 1000  # here yours would stand
    >>> v, f = 0.08 + 0.07 * np.sin(2 * t), 1.2 + np.sin(0.3 * t)
    >>> scene = stimlib.Scene(
    ...     {
    ...         "a": texture(
    ...             stimlib.Input("v", "m/s"),
    ...             stimlib.Input("f", "N"),
    ...             made_up(),
    ...             seed=1,
    ...         )
    ...     }
    ... )
    >>> a = stimlib.compile(scene, 1000).process(np.array([v, f]))[0]
    >>> fit_texture(a, v, f, 1000, speeds=3, forces=3)
    TextureFit(9 of 9 bins, order 14, ... s)
    """
    a, v, f = _signals(acceleration=acceleration, speed=speed, force=force)
    v = np.abs(v)
    for what, value, least, most in (
        ("order", order, 1, ORDER),
        ("fs", fs, 10, 1e6),
        ("seconds", seconds, 0, np.inf),
    ):
        if not least <= value <= most:
            raise BadValue(f"fit_texture: {what} = {value!r} must be from {least} to {most:g}")
    some = (v > 0) & (f > 0)
    edges = [_edges(n, e, x[some]) for n, e, x in (("speeds", speeds, v), ("forces", forces, f))]
    row, column = (
        np.searchsorted(e[1:-1], x, side="right") for e, x in zip(edges, (v, f), strict=True)
    )
    inside = (
        some & (v >= edges[0][0]) & (v <= edges[0][-1]) & (f >= edges[1][0]) & (f <= edges[1][-1])
    )
    bins: list[Bin] = []
    found: dict[tuple[int, int], Point] = {}
    for i, j in product(range(edges[0].size - 1), range(edges[1].size - 1)):
        runs = [
            r
            for r in _runs(inside & (row == i) & (column == j))
            if r.stop - r.start >= SHORTEST * order
        ]
        duration = sum(r.stop - r.start for r in runs) / fs
        why = "" if runs and duration >= seconds else f"{duration:.3g} s of {seconds:g} s"
        if not why:
            try:
                found[i, j] = _point(a, v, f, runs, order)
            except BadValue as e:
                why = str(e)
        (v0, v1), (f0, f1) = (map(float, e[k : k + 2]) for e, k in zip(edges, (i, j), strict=True))
        bins.append(Bin((v0, v1), (f0, f1), duration, why))
    if not found:
        longest = max(bins, key=lambda b: b.seconds)
        raise BadValue(
            f"fit_texture: no bin has {seconds:g} s in stretches of {SHORTEST * order} samples; the"
            f" fullest: {longest.left_out}; record longer, with slower changes; or take a lower"
            " order, fewer speeds and forces, or fewer seconds"
        )
    try:
        return TextureFit(_joined(found, fs, name), bins)
    except BadValue as e:
        raise BadValue(
            f"fit_texture: {e}; give the acceleration in m/s^2, the speed in m/s and the force in N"
        ) from None


def _point(a: np.ndarray, v: np.ndarray, f: np.ndarray, runs: list[slice], order: int) -> Point:
    """Return the model of some segments; raise BadValue if they contain no noise."""
    speed, force, mean = (float(np.concatenate([x[r] for r in runs]).mean()) for x in (v, f, a))
    stretches = [a[r] - mean for r in runs]
    if not any(x.any() for x in stretches):
        raise BadValue("no vibration")
    polynomial, power = burg(stretches, order)
    return Point(speed, force, frequencies(polynomial), power)


def _joined(found: dict[tuple[int, int], Point], fs: float, name: str) -> TextureModel:
    """Return the models at their points, and those on the border of the rectangle.

    The rectangle begins at speed and force 0.
    """
    from scipy.spatial import Delaunay

    own = list(found.values())
    top_v, top_f = max(m.speed for m in own), max(m.force for m in own)
    fastest = [
        max((m for (_, k), m in found.items() if k == j), key=lambda m: m.speed)
        for j in {j for _, j in found}
    ]
    hardest = [
        max((m for (k, _), m in found.items() if k == i), key=lambda m: m.force)
        for i in {i for i, _ in found}
    ]

    def copy(v: float, f: float, loud: bool) -> Point:
        near = min(own, key=lambda m: ((m.speed - v) / top_v) ** 2 + ((m.force - f) / top_f) ** 2)
        return Point(v, f, near.lsf, near.variance if loud else 0.0)

    border = (
        [m._replace(speed=top_v) for m in fastest]
        + [m._replace(force=top_f) for m in hardest]
        + [copy(top_v, top_f, True)]
    )
    silent = [
        (0.0, 0.0),
        (top_v, 0.0),
        (0.0, top_f),
        *((0.0, m.force) for m in fastest),
        *((m.speed, 0.0) for m in hardest),
    ]
    points = {
        (m.speed, m.force): m
        for m in reversed([*own, *border, *(copy(*place, False) for place in silent)])
    }  # own ones stay
    speed, force, lsf, variance = (np.array(v) for v in zip(*points.values(), strict=True))
    triangles = Delaunay(np.stack([speed / top_v, force / top_f], axis=1)).simplices
    n = len(points)
    return TextureModel(
        speed, force, triangles, lsf, np.empty((n, 0)), variance, np.ones(n), fs, name
    )


def _signals(**signals) -> list[np.ndarray]:
    out: list[np.ndarray] = []
    for name, given in signals.items():
        try:
            x = np.array(given)
        except (TypeError, ValueError):  # rows of several lengths
            x = np.array("")
        if x.dtype.kind not in "iuf":
            raise BadValue(f"fit_texture: {name} must be an array of real numbers, got {x.dtype}")
        x = np.array(unmasked(given))
        if x.ndim != 1 or not x.size or (out and x.size != out[0].size):
            raise BadValue(
                f"fit_texture: {name} has shape {x.shape}; all three signals must be rows of one"
                " length"
            )
        if not (fits := np.abs(x) <= LARGEST).all():
            k = int(np.argmin(fits))
            raise BadValue(
                f"fit_texture: {name}[{k}] = {x[k]:g} is not finite, or above {LARGEST:g}; cut the"
                " recording there"
            )
        out.append(x)
    return out


def _edges(what: str, given, x: np.ndarray) -> np.ndarray:
    """Return the edges of the ranges.

    They are as given, or chosen so that all ranges have equally many samples.
    """
    if not x.size:
        raise BadValue(
            "fit_texture: speed and force are never above 0 at the same time: nothing was stroked"
        )
    if isinstance(given, (int, np.integer)) and not isinstance(given, bool):
        if not 1 <= given <= 50:
            raise BadValue(f"fit_texture: {what} = {given} must be from 1 to 50")
        return (
            np.unique(np.quantile(x, np.linspace(0, 1, given + 1)))
            if np.ptp(x)
            else np.array([x[0] / 2, 2 * x[0]])
        )
    try:
        edges = np.array(given, float)
    except (TypeError, ValueError):
        edges = np.array(np.nan)
    if (
        edges.ndim != 1
        or edges.size < 2
        or not (np.diff(edges) > 0).all()
        or not edges[0] >= 0
        or not np.isfinite(edges).all()
    ):
        raise BadValue(
            f"fit_texture: {what} must be a whole number, or edges that rise from 0 or above, got"
            f" {given!r:.200}"
        )
    return edges


def _runs(where: np.ndarray) -> list[slice]:
    """Return slices for the runs of neighbouring selected samples."""
    change = np.flatnonzero(np.diff(np.r_[0, where.astype(np.int8), 0]))
    return [slice(a, b) for a, b in zip(change[::2], change[1::2], strict=True)]
