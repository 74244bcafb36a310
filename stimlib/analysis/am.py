"""Spectrum and RMS of amplitude-modulated bumps at constant speed.

The closed forms are written independently of the blocks.

A stimulus is y(t) = A e(u) c(t): e is a unipolar envelope of period 1 in u = u0 + rate
t, with bumps met at ``rate`` (speed over wavelength); c is a carrier, rectified or not.
Both are Fourier series, so y has lines at all n rate + m freq. Averaged over the
carrier's phase, the mean square of y is A^2 times those of e and c.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from ..errors import Above0, BadValue, From0, Upto1, computed, public
from ..system.limits import limits

Waveform = Literal["square", "sine", "sawtooth", "half_sine"]
Rectified = Literal["half", "full"] | None


@public
def envelope_series(waveform: Waveform, duty: Upto1, n: np.ndarray) -> np.ndarray:
    """Return the Fourier coefficients E_n of an envelope.

    e(u) = sum of E_n exp(2 pi i n u).

    Parameters
    ----------
    waveform : {"square", "sine", "sawtooth", "half_sine"}
    duty : float
        In (0, 1].
    n : ndarray of whole numbers, any shape

    Returns
    -------
    ndarray of complex, the shape of n

    Raises
    ------
    BadValue
        Unknown waveform, duty outside (0, 1].

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis.am import envelope_series
    >>> abs(envelope_series("square", 0.5, np.arange(4))).round(4)
    array([0.5   , 0.3183, 0.    , 0.1061])
    """
    n = np.asarray(n, float)
    # of waves that are even about the middle of the ridge
    middle = duty * np.exp(-1j * np.pi * n * duty)
    if waveform == "square":
        return middle * np.sinc(n * duty)
    if waveform == "half_sine":
        return middle * (np.sinc(n * duty - 0.5) + np.sinc(n * duty + 0.5)) / 2
    if waveform == "sine":
        c = math.cos(math.pi * duty)
        top = (np.sinc((n - 1) * duty) + np.sinc((n + 1) * duty)) / 2 - c * np.sinc(n * duty)
        return middle * top / (1 - c)
    a = 2j * np.pi * np.where(n == 0, 1.0, n) * duty  # sawtooth
    return np.where(n == 0, duty / 2, duty * (1 - (1 + a) * np.exp(-a)) / a**2)


@public
def carrier_series(rectify: Rectified, m: np.ndarray, sampled: float = 0.0) -> np.ndarray:
    """Return the Fourier coefficients C_m of a carrier.

    c(phase) = sum of C_m exp(i m phase).

    Parameters
    ----------
    rectify : {None, "half", "full"}
        Rectification of sin(phase).
    m : ndarray of whole numbers, any shape
    sampled : float
        freq/fs of the area-sampled carrier: line m is higher by sinc(m
        freq/fs)/sinc(freq/fs), up to 1/2; 0 for the ideal one.

    Returns
    -------
    ndarray of complex, the shape of m

    Raises
    ------
    BadValue
        Unknown rectification, or a sampled carrier above half the sample rate.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis.am import carrier_series
    >>> carrier_series("half", np.array([0, 1, 2])).round(4)
    array([ 0.3183+0.j  ,  0.    -0.25j, -0.1061+0.j  ])
    """
    if not 0 <= sampled <= 0.5:
        raise BadValue(f"freq/fs = {sampled:g} must be from 0 to 1/2; lower freq, or raise fs")
    m = np.asarray(m, float)
    even = np.where(m % 2 == 0, 1 / (np.pi * np.where(abs(m) == 1, 1.0, 1 - m * m)), 0.0)
    own = np.where(abs(m) == 1, -0.25j * m, 0)
    series = {None: 2 * own, "half": even + own, "full": 2 * even + 0j}
    return series[rectify] * (np.sinc(m * sampled) / np.sinc(sampled) if rectify else 1.0)


@public
def envelope_mean_square(waveform: Waveform, duty: Upto1) -> float:
    """Return the mean of the squared envelope e^2 over one period.

    Parameters
    ----------
    waveform : {"square", "sine", "sawtooth", "half_sine"}
    duty : float
        In (0, 1].

    Raises
    ------
    BadValue
        Unknown waveform, duty outside (0, 1].

    Examples
    --------
    >>> from stimlib.analysis.am import envelope_mean_square
    >>> [round(envelope_mean_square(w, 0.5), 6) for w in ("square", "sine", "sawtooth")]
    [0.5, 0.25, 0.166667]
    """
    if waveform != "sine":
        return duty / {"square": 1, "sawtooth": 3, "half_sine": 2}[waveform]
    a = 2 * math.pi * duty  # the mean square is (a (2 + cos a) - 3 sin a) / (4 pi (1 - cos(a/2))^2)
    if a > 2:
        top = a * (2 + math.cos(a)) - 3 * math.sin(a)
    else:
        top = sum(
            (-1) ** k * a ** (2 * k + 1) * (2 * k - 2) / math.factorial(2 * k + 1)
            for k in range(2, 14)
        )
    return top / (16 * math.pi * math.sin(a / 4) ** 4)


@public
def rms(
    waveform: Waveform,
    duty: Upto1,
    amplitude: float = 1.0,
    rectify: Rectified = "half",
) -> float:
    """Return the RMS of a stimulus over one bump, averaged over the carrier's phase.

    It is |A| sqrt(<e^2> <c^2>).

    Parameters
    ----------
    waveform, duty
        See ``envelope_mean_square``.
    amplitude : float
    rectify : {"half", "full", None}

    Returns
    -------
    float
        In the unit of the amplitude.

    References
    ----------
    The touch-screen thesis, eq. (18) and table 6.1.

    Examples
    --------
    >>> from stimlib.analysis.am import rms
    >>> rms("square", 0.5, 4.0), rms("sine", 0.5, 4.0)  # table 6.1: 1.41 V, 1 V
    (1.4142135623730951, 1.0)
    """
    return abs(amplitude) * math.sqrt(
        envelope_mean_square(waveform, duty) * (0.25 if rectify == "half" else 0.5)
    )


@public
@computed
def sampled_rms(
    waveform: Waveform,
    duty: Upto1,
    amplitude: float,
    rate: Above0,
    freq: From0,
    fs: Above0,
    rectify: Rectified = "half",
) -> float:
    """Return the RMS over one bump of a stimulus rendered at a sample rate.

    Envelope and carrier are each averaged over one sample period.

    Parameters
    ----------
    waveform, duty, amplitude, rectify
        See ``rms``.
    rate : float
        Bumps per second, above 0.
    freq, fs : float
        Carrier frequency, 0 to fs/2, and sample rate in Hz.

    Returns
    -------
    float
        Exact as long as rate, freq and fs have no common period (a line then meets an
        alias of another).

    Examples
    --------
    >>> from stimlib.analysis.am import rms, sampled_rms
    >>> round(
    ...     sampled_rms("square", 0.2, 1.0, 18.0, 158.0, 8000.0) / rms("square", 0.2), 5
    ... )
    0.99813
    """
    limits.check("render_bytes", 60e3 * fs / rate, f"sampled_rms: bytes at rate = {rate:g}")
    n = np.arange(1, math.ceil(60 * fs / rate) + 200)
    e = abs(envelope_series(waveform, duty, n)) ** 2 * np.sinc(n * rate / fs) ** 2
    square = envelope_series(waveform, duty, np.zeros(1)).real[0] ** 2 + 2 * e.sum()
    m = np.arange(1, 4000)
    c = abs(carrier_series(rectify, m, freq / fs)) ** 2
    return abs(amplitude) * math.sqrt(
        square * (abs(carrier_series(rectify, np.zeros(1), freq / fs)[0]) ** 2 + 2 * c.sum())
    )


def meeting(
    waveform: Waveform, duty: Upto1, rate: float, freq: float, fs: float, seconds: float
) -> float:
    """Return the largest relative error of ``rms`` over a whole number of bumps.

    The error comes from spectral lines of the envelope and the carrier that lie close
    together.

    The mean of e^2 c^2 over T is the product of the two means, plus all pairs of lines
    n rate + m freq weighted by sinc((n rate + m freq) T). For sampled signals, the
    nearest alias of that frequency counts.

    Parameters
    ----------
    waveform, duty
        See ``envelope_mean_square``; the carrier is a half wave.
    rate, freq : float
        Bumps per second and carrier frequency in Hz.
    fs, seconds : float
        Sample rate in Hz and T in s.

    Examples
    --------
    >>> from stimlib.analysis.am import meeting
    >>> (
    ...     meeting("square", 0.5, 10.0, 158.0, 8000.0, 1.0) < 1e-3,
    ...     meeting("square", 0.5, 10.0, 5.0, 8000.0, 1.0) > 0.1,
    ... )
    (True, True)
    """
    n, m = np.arange(-400, 401), np.arange(-24, 25)
    e, c = envelope_series(waveform, duty, n), carrier_series("half", m)
    e, c = np.abs(np.convolve(e, e, "same")), np.abs(np.convolve(c, c, "same"))
    f = n[:, None] * rate + m * freq
    pairs = e[:, None] * c * np.abs(np.sinc((f - fs * np.rint(f / fs)) * seconds))
    return float(0.5 * (pairs.sum() / pairs[400, 24] - 1))


class Lines(NamedTuple):
    """Spectral lines in order of rising frequency."""

    f: np.ndarray  # Hz
    # complex: line k is Re(amplitude exp(2 pi i f t)); its size is the peak value
    amplitude: np.ndarray


@public
@computed
def line_spectrum(
    waveform: Waveform,
    duty: Upto1,
    amplitude: float,
    rate: Above0,
    freq: Above0,
    top: Above0,
    rectify: Rectified = "half",
    fs: Above0 | None = None,
    u0: float = 0.0,
    phase: float = 0.0,
) -> Lines:
    """Return the spectral lines, up to ``top`` Hz, of a stimulus at constant speed.

    Parameters
    ----------
    waveform, duty, amplitude, rectify
        See ``rms``.
    rate : float
        Bumps per second, speed/wavelength, above 0.
    freq : float
        Frequency of the carrier in Hz, above 0.
    top : float
        Highest frequency in Hz.
    fs : float, optional
        Sample rate in Hz; the lines are then those of a rendering, with envelope and
        carrier averaged over a sample period (aliases are not included).
    u0, phase : float
        Spatial phase and carrier phase (rad) at t = 0.

    Returns
    -------
    Lines
        Lines closer than 1e-9 of ``top`` are one.  Terms of either series that reach
        back from more than 40 carrier harmonics away are left out.

    Raises
    ------
    BadValue
        A rate, frequency, sample rate or top not above 0; a frequency above fs/2.

    Examples
    --------
    >>> from stimlib.analysis.am import line_spectrum
    >>> lines = line_spectrum("sine", 0.5, 4.0, rate=10.0, freq=158.0, top=200.0)
    >>> lines.f[abs(lines.amplitude) > 0.1]
    array([  0.,  10.,  20., 138., 148., 158., 168., 178.])
    """
    reach = top + 40 * freq
    limits.check("render_bytes", 81e3 * reach / rate, f"line_spectrum: bytes at rate = {rate:g}")
    m = np.arange(-40, 41)
    n = np.arange(-math.floor(reach / rate), math.floor(reach / rate) + 1)
    E = envelope_series(waveform, duty, n) * np.exp(2j * np.pi * n * u0)
    if fs is not None:
        E = E * np.sinc(n * rate / fs) * np.exp(-1j * np.pi * n * rate / fs)
    C = carrier_series(rectify, m, 0.0 if fs is None else freq / fs) * np.exp(1j * m * phase)
    f = (n[:, None] * rate + m[None] * freq).ravel()
    a = (amplitude * E[:, None] * C[None]).ravel()
    near = 1e-9 * top
    keep = (f > -near) & (f <= top + near) & (abs(a) > 0)
    order = np.argsort(f[keep], kind="stable")
    f, a = f[keep][order], a[keep][order]
    starts = np.flatnonzero(np.diff(f, prepend=-np.inf) > near)
    one_sided = np.where(f[starts] > near, 2.0, 1.0)
    return Lines(np.maximum(f[starts], 0.0), one_sided * np.add.reduceat(a, starts))
