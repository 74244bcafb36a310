"""Tests of a noise signal against its model, on the whitened periodogram.

The signal must be stationary.

One Hann taper, every third bin: W_k = I_k / E[I_k] are independent Exp(1) if the model
holds.  Sums over third octaves are then Gamma distributed, exactly; weighted sums, with
at most four Legendre polynomials in log f as weights, see level, slope and curvature.
Their tails are not those of a normal distribution, by a factor of hundreds at 1e-6, so
they are computed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from ..errors import BadValue, computed

# the taper's kernel: points per bin, points to each side (less than the lowest bin
# used)
OVERSAMPLE, REACH = 4, 15
FEWEST_BINS = 8
LEAST = 1e-15  # coefficient that matters, of the root of the sum of their squares
CERTAIN = 1600.0  # deviations, beyond which a tail is below the smallest float


class Band(NamedTuple):
    """The test result of one third-octave band."""

    f_low: float
    f_high: float
    bins: int
    ratio: float  # measured power over the model's
    p: float  # two-sided, of this band alone


class Spectrum(NamedTuple):
    """The results of the spectral tests of one signal."""

    bands: list[Band]
    trend_p: float  # of the smallest weighted sum
    level_db: float  # measured level over the model's
    p: float  # of everything, corrected for the number of tests


def bins(n: int, fs: float, f_low: float, f_high: float) -> np.ndarray:
    """Return every third DFT bin between two frequencies, starting at bin 4 or above.

    The periodogram values at these bins are independent.

    Examples
    --------
    >>> from stimlib.analysis.spectra import bins
    >>> bins(1000, 1000.0, 10.0, 20.0)
    array([10, 13, 16, 19])
    """
    # a bin nearer to half the rate depends on its mirror image
    first, top = max(4, int(np.ceil(f_low * n / fs))), min((n - 3) // 2, int(f_high * n / fs))
    return np.arange(first, top + 1, 3)


def whitened(
    x: np.ndarray, fs: float, model: Callable[[np.ndarray], np.ndarray], f_low: float, f_high: float
):
    """Return frequencies in Hz and the periodogram divided by its expected value, W.

    Every third bin from f_low to f_high is taken.

    Parameters
    ----------
    x : ndarray, shape (n,)
    fs : float
        Hz.
    model : callable
        One-sided PSD in units^2/Hz at frequencies in Hz.
    f_low, f_high : float
        Band in Hz; below 4 bins nothing is used.

    Returns
    -------
    f, W : ndarray
        And complex X / sqrt(E |X|^2) as third.
    """
    n = x.size
    taper = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(n) + 0.5) / n)
    X = np.fft.rfft(x * taper)
    k = bins(n, fs, f_low, f_high)
    # E|X_k|^2 = (fs/2) sum of the PSD over the taper's kernel, which is known at
    # fractions of a bin
    m = np.arange(-REACH, REACH + 1) / OVERSAMPLE
    kernel = (np.sinc(m) / (1 - np.where(np.abs(m) == 1, 0.0, m) ** 2)) ** 2
    kernel[np.abs(m) == 1] = 0.25
    kernel /= kernel.sum()
    rows = max(1, 2**18 // max(1, k.size))  # in one call of the model: few, in little memory
    expected = np.zeros(k.size)
    for i in range(0, m.size, rows):
        f = (k + m[i : i + rows, None]) * fs / n
        psd = np.broadcast_to(model(f.ravel()), f.size).reshape(f.shape)
        expected += (kernel[i : i + rows, None] * psd).sum(0)
    z = X[k] / np.sqrt(expected * fs / 2 * np.sum(taper**2))
    return k * fs / n, np.abs(z) ** 2, z


def test_spectrum(
    x: np.ndarray, fs: float, model: Callable, f_low: float, f_high: float
) -> Spectrum | None:
    """Run both spectral tests of one signal against a one-sided PSD.

    Return None when the signal is too short for one band of eight bins.

    Parameters
    ----------
    x : ndarray, shape (n,)
    fs, f_low, f_high : float
        Hz.
    model : callable
    """
    f, W, _ = whitened(x, fs, model, f_low, f_high)
    return judged(f, W) if f.size >= FEWEST_BINS else None


def looks(f: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the bins of each third octave, and weights that test the spectral shape.

    The weights, shape (terms, n) and of unit norm, are sensitive to level, slope,
    curvature and so on.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis.spectra import looks
    >>> bands, weights = looks(np.arange(10.0, 1000.0))
    >>> len(bands), weights.shape
    (17, (4, 990))
    """
    third = np.floor(3 * np.log2(f / f[0])).astype(int)
    bands = _at_least(np.split(np.arange(f.size), np.flatnonzero(np.diff(third)) + 1), FEWEST_BINS)
    u = 2 * np.log(f / f[0]) / np.log(f[-1] / f[0]) - 1
    terms = min(4, max(1, f.size // 16))
    weights, _ = np.linalg.qr(np.polynomial.legendre.legvander(u, terms - 1))
    return bands, weights.T


@computed
def judged(f: np.ndarray, W: np.ndarray) -> Spectrum:
    """Run both spectral tests on a whitened periodogram.

    Parameters
    ----------
    f, W : ndarray, shape (n,)
        As returned by `whitened`, or simulated; at least eight bins.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis import judged
    >>> f, W = np.arange(10.0, 1000.0), np.random.default_rng(1).exponential(size=990)
    >>> [judged(f, level * W).p < 1e-6 for level in (1.0, 1.3)]
    [False, True]
    """
    f, W = np.asarray(f, float), np.asarray(W, float)
    if (
        f.ndim != 1
        or f.shape != W.shape
        or f.size < FEWEST_BINS
        or not (f[0] > 0 and (np.diff(f) > 0).all() and (W >= 0).all())
    ):
        raise BadValue(
            f"judged: f and W, of shapes {f.shape} and {W.shape}, must be rows of one length, of"
            f" {FEWEST_BINS} numbers or more; f rises from above 0, and W is 0 or above"
        )
    parts, weights = looks(f)
    bands = []
    for part in parts:
        total, m = W[part].sum(), part.size
        p = min(1.0, 2 * min(scipy.special.gammaincc(m, total), scipy.special.gammainc(m, total)))
        bands.append(Band(f[part[0]], f[part[-1]], m, total / m, p))
    trend = min(weighted_p(a, W) for a in weights)
    p = min(1.0, (len(bands) + len(weights)) * min([trend, *(b.p for b in bands)]))
    with np.errstate(divide="ignore"):  # of nothing but 0 the level is -inf
        return Spectrum(bands, trend, float(10 * np.log10(W.mean())), float(p))


def weighted_p(a: np.ndarray, W: np.ndarray) -> float:
    """Return the two-sided p-value of sum a (W - 1) for independent W ~ Exp(1).

    The formula is the saddlepoint formula of Lugannani and Rice.

    Parameters
    ----------
    a, W : ndarray, shape (n,)

    Examples
    --------
    >>> import numpy as np
    >>> import scipy
    >>> from stimlib.analysis.spectra import weighted_p
    >>> p = weighted_p(np.ones(8), np.full(8, 3.0))  # their sum is Gamma distributed
    >>> bool(abs(p / (2 * scipy.stats.gamma.sf(24, 8)) - 1) < 0.02)
    True
    """
    a = a / np.sqrt(a @ a)
    a = a * np.sign(a @ (W - 1))
    s = float(a @ (W - 1))
    # below there is no doubt about it
    return float(min(1.0, 2 * (scipy.special.ndtr(-s) if s < 2 else tail(a, s))))


@computed
def tail(c: np.ndarray, s: float) -> float:
    """Return P(sum c (E - 1) > s) for independent E ~ Exp(1).

    The formula is the saddlepoint formula of Lugannani and Rice (1980).

    Parameters
    ----------
    c : ndarray, shape (n,)
        Coefficients of either sign.
    s : float

    Examples
    --------
    >>> import numpy as np
    >>> import scipy
    >>> from stimlib.analysis import tail
    >>> c = np.ones(100)  # their sum is Gamma distributed
    >>> [
    ...     bool(abs(tail(c, s) / scipy.stats.gamma.sf(100 + s, 100) - 1) < 1e-3)
    ...     for s in (60.0, 5.0, -16.0)
    ... ]
    [True, True, True]
    """
    c = np.ravel(c)
    size = np.linalg.norm(c / np.abs(c).max()) * np.abs(c).max()  # whose squares may be too large
    c, s = c / size, s / size
    c[np.abs(c) < LEAST] = 0.0  # a rounding of the others
    if abs(s) > CERTAIN:
        return float(s < 0)
    if s < 0:
        return 1 - tail(-c, -s)
    if s < 1e-3:  # the formula has 0/0 at the mean
        return float(scipy.special.ndtr(-s))
    top = float(c.max())
    if top <= 0 and s >= -c.sum():
        return 0.0  # larger than such a sum can be

    def slope(t):
        return float(np.sum(c * c * t / (1 - c * t))) - s

    low, high = 0.0, 0.5 / top if top > 0 else s
    while slope(high) < 0:
        low, high = high, (high + 1 / top) / 2 if top > 0 else 2 * high
    t = scipy.optimize.brentq(slope, low, high)
    r = np.sqrt(2 * (t * s + float(np.sum(np.log1p(-c * t) + c * t))))
    u = t * np.sqrt(float(np.sum((c / (1 - c * t)) ** 2)))
    density = np.exp(-r * r / 2) / np.sqrt(2 * np.pi)
    return float(np.clip(scipy.special.ndtr(-r) + density * (1 / u - 1 / r), 0.0, 1.0))


test_spectrum.__test__ = False  # type: ignore[attr-defined]  # a function of ours, not pytest's


def _at_least(parts: list[np.ndarray], size: int) -> list[np.ndarray]:
    """Join neighbouring groups of bins until each has a minimum size.

    Examples
    --------
    >>> [part.size for part in _at_least([np.zeros(n) for n in (1, 2, 4, 1)], 3)]
    [3, 5]
    """
    joined: list[np.ndarray] = []
    for part in parts:
        if joined and joined[-1].size < size:
            joined[-1] = np.concatenate([joined[-1], part])
        else:
            joined.append(part)
    if len(joined) > 1 and joined[-1].size < size:
        joined[-2:] = [np.concatenate(joined[-2:])]
    return joined


def correlated_p(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Return the correlation and its p-value of complex normal vectors of variance 1.

    Below 8 elements there is none.
    """
    if a.size < 8:
        return 0.0, 1.0
    c = float(np.mean((a * b.conj()).real))
    # normal for any given b
    return c, float(2 * scipy.special.ndtr(-abs(c) * a.size / np.sqrt(np.sum(np.abs(b) ** 2) / 2)))
