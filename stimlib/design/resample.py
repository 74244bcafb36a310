"""A recording at another sample rate, and between its samples."""

from __future__ import annotations

import numpy as np

HALF, BETA = 32, 12.0  # zero crossings on each side; of Kaiser's window: aliases and images below -110 dB


def resampled(x: np.ndarray, ratio: float) -> np.ndarray:
    """x at ratio times its sample rate: a sinc in Kaiser's window, which passes 0.45 of the lower rate within 1e-5.

    Outside, x counts as 0.  Where the rate stays, so do the samples.

    Parameters
    ----------
    x : ndarray, shape (n,)
    ratio : float

    Returns
    -------
    ndarray, shape (ceil(n ratio),)

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.design.resample import resampled
    >>> n = np.arange(400)
    >>> wave = np.sin(2 * np.pi * 0.1 * n)
    >>> bool(np.abs(resampled(wave, 2.5) - np.sin(2 * np.pi * 0.04 * np.arange(1000)))[200:800].max() < 1e-5)
    True
    """
    if ratio == 1:
        return x.copy()
    low = min(1.0, ratio)  # the lower rate, of both
    reach = min(int(np.ceil(HALF / low)), x.size)  # beyond x there is nothing
    y = np.empty(int(np.ceil(x.size * ratio)))
    padded = np.concatenate([np.zeros(reach), x, np.zeros(reach + 1)])
    k = np.arange(-reach + 1, reach + 1)
    rows = max(1, 2**18 // k.size)  # so many at once stay in the cache
    for start in range(0, y.size, rows):
        t = np.arange(start, min(start + rows, y.size)) / ratio
        first = np.floor(t).astype(int)
        d = (t - first)[:, None] - k
        window = np.i0(BETA * np.sqrt(np.maximum(1 - (d * low / HALF) ** 2, 0))) / np.i0(BETA)
        y[start : start + t.size] = np.sum(padded[first[:, None] + k + reach] * (low * np.sinc(low * d) * window), axis=1)
    return y


def oversampled(x: np.ndarray, times: int, band: float = 1.0) -> np.ndarray:
    """x at so many times its sample rate, limited to band times half of what it had; the window is that of ``resampled``.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Outside, it counts as 0.
    times : int
    band : float
        At most 1.

    Returns
    -------
    ndarray, shape (n times,)

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.design.resample import oversampled
    >>> wave = np.sin(2 * np.pi * 0.1 * np.arange(400))
    >>> bool(np.abs(oversampled(wave, 8) - np.sin(2 * np.pi * 0.0125 * np.arange(3200)))[400:2800].max() < 1e-5)
    True
    """
    from scipy.signal import upfirdn

    reach = int(np.ceil(times * HALF / band))
    taps = band * np.sinc(band * np.arange(-reach, reach + 1) / times) * np.kaiser(2 * reach + 1, BETA)
    return upfirdn(taps, x, times)[reach : reach + x.size * times]
