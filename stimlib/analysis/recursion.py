"""Recursions of laws and thresholds, without the import of scipy.signal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy


def all_pole(
    gain: float, a: Sequence[float], x: np.ndarray, last: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return y(n) = gain x(n) - a_1 y(n-1) - a_2 y(n-2) .., and its last values.

    `scipy.signal.lfilter` computes the same, but importing it takes most of a second of
    processor time.  The equations for all n are a banded triangular system, which the
    BLAS solves from the first row on.

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
    back, y = np.asarray(a, float), gain * x
    last = np.zeros(back.size) if last is None else last
    for i in range(min(back.size, y.size)):
        y[i] -= back[i:] @ last[i:][::-1]
    if y.size:
        bands = np.repeat(np.r_[1.0, back][:, None], y.size, axis=1)
        y = scipy.linalg.blas.dtbsv(back.size, np.asfortranarray(bands), y, lower=1, diag=1)
    return y, np.r_[last, y][-back.size :]
