"""Best approximations in the sense of Chebyshev: what the designs of ``pink`` and
``differentiator`` have in common.

The error reaches its bound, with alternating sign, at one frequency more than there are
free coefficients.  Both designs are found the same way (Remez): level the error on a
*reference* of that many frequencies, move the reference to the peaks of the error,
repeat.  What makes it short is a first reference that is nearly right: Zolotarev's for
the low-pass, the equilibrium density of the bands for the differentiator.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

from ..errors import BadValue

FloatArray = npt.NDArray[np.float64]


@contextmanager
def asked_by(name: str) -> Iterator[None]:
    """Errors in here begin with a name that the user knows, instead of that of a
    function of this file.
    """
    try:
        yield
    except BadValue as e:
        raise BadValue(f"{name}: {str(e).partition(': ')[2]}") from None


def between(points: FloatArray, low: float, high: float, parts: int) -> FloatArray:
    """Grid on [low, high] that cuts each gap between neighbouring `points` (ascending)
    into equal parts.
    """
    margin = 1e-12 * (high - low)
    knots = np.concatenate(
        [[low], points[(points > low + margin) & (points < high - margin)], [high]]
    )
    steps = np.diff(knots)[:, None] * (np.arange(parts) / parts)
    return np.append((knots[:-1, None] + steps).ravel(), high)


def peaks_of(x: FloatArray, error: FloatArray) -> FloatArray:
    """Abscissa of the largest |error| in each run of one sign, from a parabola through
    it and its neighbours.
    """
    edges = np.flatnonzero((error[1:] < 0) != (error[:-1] < 0)) + 1
    runs = zip([0, *edges], [*edges, len(x)], strict=True)
    top = np.array([first + np.argmax(np.abs(error[first:last])) for first, last in runs])
    inner = (top > 0) & (top < len(x) - 1)
    i = top[inner]
    left = (error[i] - error[i - 1]) / (x[i] - x[i - 1])
    right = (error[i + 1] - error[i]) / (x[i + 1] - x[i])
    bend = (right - left) / (x[i + 1] - x[i - 1])
    bend[bend == 0] = np.inf
    peaks = x[top]
    peaks[inner] = np.clip((x[i - 1] + x[i]) / 2 - left / (2 * bend), x[i - 1], x[i + 1])
    return peaks


def alternating(error: FloatArray, count: int) -> list[int]:
    """Indices of `count` errors of alternating sign, the largest; fewer if there are no
    more.
    """
    kept: list[int] = []
    for i in range(len(error)):
        if not kept or (error[i] < 0) != (error[kept[-1]] < 0):
            kept.append(i)
        elif abs(error[i]) > abs(error[kept[-1]]):
            kept[-1] = i
    while len(kept) > count:
        del kept[0 if abs(error[kept[0]]) < abs(error[kept[-1]]) else -1]
    return kept
