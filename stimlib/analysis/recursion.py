"""Recursions and systems of equations of laws and thresholds.

scipy has them too; importing its smallest part takes a tenth of a second of processor
time, more than all else that a law computes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def all_pole(
    gain: float, a: Sequence[float], x: np.ndarray, last: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return y(n) = gain x(n) - a_1 y(n-1) - a_2 y(n-2) .., and its last values.

    With the polynomial A of the recursion, 1/A(z) = A(-z) / (A(z) A(-z)), where the
    divisor has even powers alone: the step of the recursion doubles, until no sample
    has one so far back.

    Parameters
    ----------
    gain : float
    a : sequence of float, length k
        Coefficients of the recursion, without the leading 1.
    x : ndarray, shape (n,)
    last : ndarray, shape (k,), optional
        The k values of y before the first, the latest one last; by default 0.

    Returns
    -------
    y : ndarray, shape (n,)
    last : ndarray, shape (k,)
        For the samples that follow.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis.recursion import all_pole
    >>> y, last = all_pole(1.0, [-0.5], np.array([1.0, 0.0, 0.0]))
    >>> y.tolist()
    [1.0, 0.5, 0.25]
    >>> all_pole(1.0, [-0.5], np.zeros(2), last)[0].tolist()
    [0.125, 0.0625]
    """
    back, y, step = np.r_[1.0, a], gain * x, 1
    last = np.zeros(len(a)) if last is None else last
    for i in range(min(len(a), y.size)):
        y[i] -= back[i + 1 :] @ last[i:][::-1]
    while step < y.size:
        turned = back * (-1.0) ** np.arange(back.size)
        made = y.copy()
        for k in range(1, min(back.size, -(-y.size // step))):
            made[k * step :] += turned[k] * y[: -k * step]
        y, back, step = made, np.convolve(back, turned)[::2], 2 * step
    return y, np.r_[last, y][-len(a) :]


def solve_banded(bands: np.ndarray, want: np.ndarray, size: int = 32) -> np.ndarray:
    """Solve a symmetric positive definite system whose matrix is banded.

    It is eliminated block by block, of ``size`` unknowns each.

    Parameters
    ----------
    bands : ndarray, shape (k, n)
        ``bands[d, i]`` is the element in row i + d and column i; k is at most
        ``size``.
    want : ndarray, shape (n,)
    size : int

    Returns
    -------
    ndarray, shape (n,)

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis.recursion import solve_banded
    >>> solve_banded(np.array([[2.0, 2.0], [1.0, 0.0]]), np.array([4.0, 5.0])).tolist()
    [1.0, 2.0]
    """
    count, at = -(-want.size // size), np.arange(size)
    more = count * size - want.size
    columns = np.zeros((count, 2 * size, size))
    for d, band in enumerate(bands):
        columns[:, at + d, at] = np.pad(band, (0, more), constant_values=not d).reshape(-1, size)
    own, below = columns[:, :size], columns[:, size:]
    own = own + np.tril(own, -1).swapaxes(1, 2)
    y, through = np.pad(want, (0, more)).reshape(-1, size), below.swapaxes(1, 2).copy()
    for k in range(1, count):
        through[k - 1] = np.linalg.solve(own[k - 1], through[k - 1])
        own[k] -= below[k - 1] @ through[k - 1]
        y[k] -= y[k - 1] @ through[k - 1]
    for k in reversed(range(count)):
        y[k] = np.linalg.solve(own[k], y[k])
        if k < count - 1:
            y[k] -= through[k] @ y[k + 1]
    return y.ravel()[: want.size]
