"""Laws of the blocks of the family ``tables``."""

import numpy as np
import scipy

from ..rows import TIE, law


@law("Lut", "Polynomial", since=0)
def _table(b, fs, x, y):
    kind = getattr(b, "kind", "polynomial")
    low, high = b.knots.min(), b.knots.max()
    at = np.clip(x[0], low, high)
    if kind == "linear":
        want = np.interp(at, b.knots, b.values)
    elif kind == "polynomial":  # Lagrange's formula
        k, u = b.knots.astype(np.longdouble), at.astype(np.longdouble)
        parts = []
        for i in range(k.size):
            others = np.delete(k, i)
            parts.append(np.prod([(u - v) / (k[i] - v) for v in others], axis=0))
        want = (b.values @ np.array(parts)).astype(float)
    elif kind == "pchip":
        want = scipy.interpolate.PchipInterpolator(b.knots, b.values)(at)
    else:
        want = scipy.interpolate.CubicSpline(b.knots, b.values)(at)
    beyond = 0.0 if b.outside == "zero" else np.nan
    want = np.where((at == x[0]) | (b.outside == "hold"), want, beyond)
    return want, 1e-13 * (np.abs(b.values).max() / 3 + np.abs(want)) + 1e-300


@law("LinearGrid", "CubicGrid", since=0)
def _grid(b, fs, x, y):
    (n, m), (dx, dy), (x0, y0) = b.table.shape, b.spacing, b.origin
    i, j = x0 + dx * np.arange(n), y0 + dy * np.arange(m)
    degree = 1 if type(b).__name__ == "LinearGrid" else 3
    f = scipy.interpolate.RectBivariateSpline(
        i, j, b.table, kx=min(degree, n - 1), ky=min(degree, m - 1), s=0
    )
    px, py = np.clip(x[0], i[0], i[-1]), np.clip(x[1], j[0], j[-1])
    if degree == 3:
        slopes = [f.ev(px, py, 1, 0), f.ev(px, py, 0, 1)]
    else:  # straight within a piece
        u, v = (
            np.minimum(np.floor((p - s[0]) / d), s.size - 2)
            for p, s, d in ((px, i, dx), (py, j, dy))
        )
        slopes = [
            (f.ev(i[0] + (u + 1) * dx, py) - f.ev(i[0] + u * dx, py)) / dx,
            (f.ev(px, j[0] + (v + 1) * dy) - f.ev(px, j[0] + v * dy)) / dy,
        ]
    want = np.array([f.ev(px, py), *slopes])
    want[1, (x[0] < i[0]) | (x[0] > i[-1])] = 0
    want[2, (x[1] < j[0]) | (x[1] > j[-1])] = 0
    size = max(float(np.abs(b.table).max()), 1e-300)
    u, v = (x[0] - x0) / dx, (x[1] - y0) / dy
    # slopes of the two sides differ
    joint = np.minimum(np.abs(u - np.rint(u)), np.abs(v - np.rint(v))) < TIE
    tol = np.full((3, y.shape[1]), 1e-9 * size)
    tol[1:] /= np.array([[dx], [dy]])
    tol[1:, joint] = np.inf
    return want, tol
