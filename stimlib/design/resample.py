"""A recording at another sample rate, and between its samples."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from ..system.limits import limits

# zero crossings on each side; of Kaiser's window: aliases and images below -110 dB
HALF, BETA = 32, 12.0
PIECE = 2**18  # products at once: they stay in the cache, and an interrupt acts between two pieces


def resampled(
    x: np.ndarray, rate: float, fs: float, below: float = math.inf, name: str = "resampled"
) -> np.ndarray:
    """Return x, recorded at a rate, at another one, by a sinc in Kaiser's window.

    It passes 0.45 of the lowest rate within 1e-5.  Outside, x counts as 0.  Where the
    rate stays, so do the samples.

    Parameters
    ----------
    x : ndarray, shape (n,)
    rate, fs : float
        Sample rates of x and of the result, in Hz.
    below : float
        Another rate in Hz, half of which limits the band too.
    name : str
        Of the function that needs it, for an error.

    Returns
    -------
    ndarray, shape (ceil(n fs/rate),)

    Raises
    ------
    BadValue
        More than ``stimlib.limits.design_work``.

    Notes
    -----
    At a time t between two samples the factors depend on t - floor(t) alone.  Rates in
    the ratio of small whole numbers have few such phases, so the factors of each are
    made once.

    References
    ----------
    Crochiere and Rabiner, "Multirate Digital Signal Processing" (1983), section 2.4:
    polyphase structures.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.design.resample import resampled
    >>> wave = np.sin(2 * np.pi * 0.1 * np.arange(400))
    >>> y = resampled(wave, 1000, 2500)
    >>> bool(
    ...     np.abs(y - np.sin(2 * np.pi * 0.04 * np.arange(1000)))[200:800].max() < 1e-5
    ... )
    True
    """
    ratio = Fraction(fs) / Fraction(rate)
    if ratio == 1 and below >= rate:
        return x.copy()
    lowest = min(Fraction(1), ratio, Fraction(min(below, rate)) / Fraction(rate))
    low, reach = float(lowest), min(math.ceil(HALF / lowest), x.size)  # beyond x there is nothing
    size, (phases, step) = math.ceil(x.size * ratio), ratio.as_integer_ratio()
    few, k = 16 * phases <= size, np.arange(-reach + 1, reach + 1)
    limits.check(
        "design_work",
        k.size * (2.0 * size + 50.0 * (phases if few else size)),
        f"{name}: operations to bring {x.size} samples from {rate:g} Hz to {fs:g} Hz (resample them"
        " before, or change fs)",
    )

    def factors(d: np.ndarray) -> np.ndarray:
        return (
            low
            * np.sinc(low * d)
            * np.i0(BETA * np.sqrt(np.maximum(1 - (d * low / HALF) ** 2, 0)))
            / np.i0(BETA)
        )

    padded = np.concatenate([np.zeros(reach - 1), x, np.zeros(reach + 1)])
    # those that the factors of a sample meet
    around = np.lib.stride_tricks.sliding_window_view(padded, k.size)
    y, rows = np.empty(size), max(1, PIECE // k.size)
    for phase in range(phases if few else 0):
        out, near = y[phase::phases], around[phase * step // phases :: step]
        fixed = factors(phase * step % phases / phases - k)
        for i in range(0, out.size, rows):
            out[i : i + rows] = np.einsum("ij,j->i", near[i : min(i + rows, out.size)], fixed)
    for i in range(0, 0 if few else size, rows):
        t = np.arange(i, min(i + rows, size)) / float(ratio)
        first = np.floor(t).astype(int)
        y[i : i + t.size] = np.einsum("ij,ij->i", around[first], factors((t - first)[:, None] - k))
    return y
