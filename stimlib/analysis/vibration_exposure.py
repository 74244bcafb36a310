"""Frequency weightings of the standards on vibration of the hand and of the body."""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.graph import unmasked
from ..errors import Above0, BadValue, UnknownName, computed, public


class Weighting(NamedTuple):
    """Corner frequencies in Hz and quality factors of a weighting's analog filter."""

    band: tuple[float, float]
    transition: tuple[float, float] | None  # acceleration to velocity: frequency, Q
    step: tuple[float, float, float] | None  # upwards: from, to, Q of both


WEIGHTINGS = {
    # ISO 5349-1:2001, annex A: vibration transmitted to the hand
    "Wh": Weighting((10**0.8, 10**3.1), (100 / (2 * pi), 0.64), None),
    # ISO 2631-1:1997, annex A: whole body; head of a lying person, backrest, rotation
    "Wk": Weighting((0.4, 100.0), (12.5, 0.63), (2.37, 3.35, 0.91)),
    "Wd": Weighting((0.4, 100.0), (2.0, 0.63), None),
    "Wj": Weighting((0.4, 100.0), None, (3.75, 5.32, 0.91)),
    "Wc": Weighting((0.4, 100.0), (8.0, 0.63), None),
    "We": Weighting((0.4, 100.0), (1.0, 0.63), None),
}


@public
@computed
def weighting(freq: ArrayLike, name: str = "Wh") -> np.ndarray:
    """Return the factor by which a standard weights acceleration at a frequency.

    Parameters
    ----------
    freq : array_like
        Frequencies in Hz, 0 or above.
    name : str
        ``"Wh"``: the hand, in all three directions (ISO 5349-1).  ``"Wk"``: a seat
        along the spine; ``"Wd"``: across it; ``"Wc"``: a backrest; ``"We"``: rotation;
        ``"Wj"``: under the head of a lying person (all ISO 2631-1).

    Returns
    -------
    ndarray
        Magnitude of the standard's analog filter, band limits included.

    Raises
    ------
    UnknownName, BadValue
        A weighting that is not there; a frequency below 0.

    References
    ----------
    ISO 5349-1:2001, annex A; ISO 2631-1:1997, annex A.

    Examples
    --------
    >>> from stimlib.analysis import weighting
    >>> weighting([8, 16, 125]).round(3)
    array([0.877, 0.892, 0.128])
    """
    if name not in WEIGHTINGS:
        raise UnknownName(f"weighting {name!r}: choose one of {', '.join(WEIGHTINGS)}")
    f = np.asarray(freq, float)
    if not (f >= 0).all():
        raise BadValue(f"weighting: freq {f.min():g} Hz must be 0 or above")
    w = WEIGHTINGS[name]
    low, high = w.band
    factor = f**2 / np.abs(_quadratic(f, low, 1 / sqrt(2))) / low**2
    factor /= np.abs(_quadratic(f, high, 1 / sqrt(2)))
    if w.transition:
        corner, q = w.transition
        factor *= np.abs(1 + 1j * f / corner) / np.abs(_quadratic(f, corner, q))
    if w.step:
        begin, end, q = w.step
        rise = np.abs(_quadratic(f, begin, q)) / np.abs(_quadratic(f, end, q))
        factor *= rise * (begin / end) ** 2
    return factor


def _quadratic(f: np.ndarray, corner: float, q: float) -> np.ndarray:
    """Return 1 + s/(q w) + (s/w)^2 for s = 2 pi i f and w = 2 pi corner."""
    x = f / corner
    return 1 - x**2 + 1j * x / q


@public
@computed
def weighted_rms(acceleration: ArrayLike, fs: Above0, name: str = "Wh") -> float | np.ndarray:
    """Return the frequency-weighted RMS of an acceleration.

    Parameters
    ----------
    acceleration : array_like, shape (.., n)
        In m/s^2, at least one sample.
    fs : float
        Sample rate in Hz.
    name : str
        See `weighting`.

    Returns
    -------
    float or ndarray, shape (..)
        In m/s^2.  The total value of three axes is the root of their sum of squares.

    Raises
    ------
    UnknownName, BadValue
        A weighting that is not there; no samples, or some that are not finite; a sample
        rate that is not above 0.

    Notes
    -----
    The record is weighted in the frequency domain, as if it were repeated.

    References
    ----------
    ISO 5349-1:2001, 4.2; ISO 2631-1:1997, 6.1.

    Examples
    --------
    A vibration of 125 Hz with a peak of 10 m/s^2, and what counts of it for the hand:

    >>> import numpy as np
    >>> from stimlib.analysis import weighted_rms
    >>> a = 10 * np.sin(2 * np.pi * 125 * np.arange(8000) / 8000)
    >>> round(weighted_rms(a, 8000), 3), round(weighted_rms(a, 8000, "Wk"), 3)
    (0.904, 0.382)
    """
    y = unmasked(acceleration)
    if not y.ndim or not y.size or not np.isfinite(y).all():
        raise BadValue("weighted_rms: acceleration must be finite samples, at least one")
    n = y.shape[-1]
    power = np.abs(np.fft.rfft(y) / n * weighting(np.fft.rfftfreq(n, 1 / fs), name)) ** 2
    power[..., 1 : (n + 1) // 2] *= 2  # of two bins each; 0 Hz and half the rate are alone
    found = np.sqrt(power.sum(-1))
    return found if y.ndim > 1 else float(found)
