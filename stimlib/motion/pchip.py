"""Monotone cubic interpolation (PCHIP) of reports, without overshoot.

All stretches of a recording are interpolated at once.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCK = 1 << 15  # intervals that are worked on at once


def cubics(t: Array, x: Array, whole: NDArray[np.bool_]) -> Array:
    """Return the coefficients of PCHIP cubics in t - t[i], highest power first.

    Parameters
    ----------
    t : ndarray, shape (n,), s
        Rising times.
    x : ndarray, shape (n,)
        Values at these times.
    whole : ndarray of bool, shape (n - 1,)
        Intervals to interpolate; a run of them is one stretch.  In other intervals the
        value is held.

    Returns
    -------
    ndarray, shape (4, n)
        The last column applies after the last time and is constant, too.  Coefficients
        are not finite where a step is too large for its interval.

    References
    ----------
    F. N. Fritsch and J. Butland (1984), with the ends of C. Moler, "Numerical Computing
    with Matlab" (2004), as in scipy.interpolate.PchipInterpolator, which gives the same
    bits.

    Examples
    --------
    >>> cubics(
    ...     np.array([0.0, 1.0, 3.0]),
    ...     np.array([0.0, 1.0, 1.0]),
    ...     np.array([True, False]),
    ... ).tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]
    """
    c = np.zeros((4, len(t)))
    c[3] = x
    with np.errstate(all="ignore"):
        for a in range(0, len(t) - 1, BLOCK):
            b = min(a + BLOCK, len(t) - 1)
            low, high = max(a - 2, 0), min(b + 2, len(t) - 1)  # an end looks two intervals back
            h = np.diff(t[low : high + 1])
            m = np.diff(x[low : high + 1]) / h
            d0, d1 = _slopes(h, m, whole[low:high])
            part = slice(a - low, b - low)
            h, m, d0, d1 = h[part], m[part], d0[part], d1[part]
            bend = (d0 + d1 - 2 * m) / h
            on = whole[a:b]
            c[0, a:b] = np.where(on, bend / h, 0.0)
            c[1, a:b] = np.where(on, (m - d0) / h - bend, 0.0)
            c[2, a:b] = np.where(on, d0, 0.0)
    return c


def _slopes(h: Array, m: Array, whole: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the slopes at both ends of each interval, from lengths and secants.

    The slopes of different stretches are independent.
    """
    start, end = m.copy(), m.copy()  # a stretch of one interval is a line
    h0, h1, m0, m1 = h[:-1], h[1:], m[:-1], m[1:]
    meet = whole[:-1] & whole[1:]
    w0, w1 = 2 * h1 + h0, h1 + 2 * h0
    turns = (np.sign(m0) != np.sign(m1)) | (m0 == 0) | (m1 == 0)
    inner = np.where(turns, 0.0, 1.0 / ((w0 / m0 + w1 / m1) / (w0 + w1)))
    end[:-1] = np.where(meet, inner, end[:-1])
    start[1:] = np.where(meet, inner, start[1:])
    i = np.flatnonzero(meet & ~np.append(False, whole[:-2]))
    start[i] = _edge(h[i], h[i + 1], m[i], m[i + 1])
    i = np.flatnonzero(meet & ~np.append(whole[2:], False))
    end[i + 1] = _edge(h[i + 1], h[i], m[i + 1], m[i])
    return start, end


def _edge(h0: Array, h1: Array, m0: Array, m1: Array) -> Array:
    """Return the slope at the end of a stretch."""
    d = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1)
    steep = (np.sign(m0) != np.sign(m1)) & (np.abs(d) > 3.0 * np.abs(m0))
    return np.where(np.sign(d) != np.sign(m0), 0.0, np.where(steep, 3.0 * m0, d))
