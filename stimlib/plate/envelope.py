"""The envelope that remains behind a resonance, and the voltage to restore it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue, Upto1, computed, public

POINTS = 2048  # of a period


class Answer(NamedTuple):
    """The steady-state envelope of a mode's response to bumps at a given rate.

    All values but the curves are fractions of the requested amplitude.
    """

    depth: float  # of modulation, highest less lowest
    highest: float
    lowest: float
    drive: float  # largest voltage that it takes, of the carrier's without a pole swap
    wanted: np.ndarray  # envelope over one period
    got: np.ndarray
    voltage: np.ndarray  # the drive's


@public
@computed
def half_sine(u: ArrayLike, duty: Upto1 = 0.5) -> np.ndarray:
    """Return the envelope of ``bump(u, "half_sine", duty)`` for 0 <= u < 1.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.plate import half_sine
    >>> half_sine(np.array([0.0, 0.25, 0.75]))
    array([0., 1., 0.])
    """
    u = np.asarray(u, np.float64)
    return np.where(u < duty, np.sin(np.pi * np.where(u < duty, u, 0.0) / duty), 0.0)


@public
@computed
def envelope_behind(
    freq: float, q: float, rate: float, gain: float = 1.0, envelope: Callable = half_sine
) -> Answer:
    """Return the envelope of the vibration at a resonance, for bumps at a rate.

    The voltage may first pass a ``pole_swap``.

    The envelope's spectral lines lie next to the carrier, at freq + k rate; each is
    multiplied by the response of mode and pole swap at its frequency.

    Parameters
    ----------
    freq, q : float
        Of the mode, in Hz; the carrier is at freq.
    rate : float
        Bumps per second.
    gain : float
        Of the pole swap, from 1 (none) to below 2 q.
    envelope : function
        Of the place within a period, 0 <= u < 1, an array: ``lambda u: u < 0.5`` is the
        square.

    Returns
    -------
    Answer

    Raises
    ------
    BadValue
        Numbers not above 0; a gain outside its range; an envelope that is no function
        of an array, or constant.

    Examples
    --------
    >>> from stimlib.plate import envelope_behind
    >>> for gain in (1, 4):
    ...     answer = envelope_behind(158.0, 10.0, rate=20.0, gain=gain)
    ...     print(gain, round(answer.depth, 2), round(answer.drive, 1))
    1 0.4 1.0
    4 0.87 2.0
    """
    if not (0 < freq < math.inf and 0.5 < q < math.inf and 0 < rate < math.inf):
        raise BadValue(
            f"envelope_behind: freq = {freq!r}, rate = {rate!r} must be above 0, and q = {q!r}"
            " above 0.5"
        )
    if not 1 <= gain < 2 * q:
        raise BadValue(f"envelope_behind: gain = {gain!r} must be from 1 to below 2 q = {2 * q:g}")
    try:
        wanted = np.array(np.broadcast_to(envelope(np.arange(POINTS) / POINTS), POINTS), float)
    except (TypeError, ValueError) as e:
        raise BadValue(
            f"envelope_behind: envelope = {envelope!r:.60} must be a function of an array of"
            " places, such as lambda u: u < 0.5"
        ) from e
    if not np.ptp(wanted) > 0:
        raise BadValue(
            f"envelope_behind: envelope = {envelope!r:.60} is constant or no number, so it has no"
            " depth; let it vary from 0 to 1"
        )
    lines = np.fft.fftfreq(POINTS, 1 / POINTS)
    g = 1 + lines * rate / freq

    def mode(q):
        return 1j / q / (1 - g * g + 1j * g / q)  # 1 at the resonance

    got = np.abs(np.fft.ifft(np.fft.fft(wanted) * mode(q / gain)))
    voltage = np.abs(np.fft.ifft(np.fft.fft(wanted) * mode(q / gain) / mode(q)))
    size = float(np.ptp(wanted))
    top = float(np.abs(wanted).max())
    return Answer(
        float(np.ptp(got)) / size,
        float(got.max()) / top,
        float(got.min()) / top,
        float(voltage.max()) / top,
        wanted,
        got,
        voltage,
    )


@public
@computed
def best_gain(
    freq: float, q: float, rate: float, drive: float, envelope: Callable = half_sine
) -> float:
    """Return the largest gain of a pole swap whose voltage stays within ``drive``.

    The voltage is relative to that without a pole swap.

    Raises
    ------
    BadValue
        As of ``envelope_behind``; a drive below 1.

    Examples
    --------
    >>> from stimlib.plate import best_gain
    >>> round(best_gain(158.0, 10.0, rate=20.0, drive=2.0), 1)
    3.8
    """
    from scipy.optimize import bisect

    def over(gain: float) -> float:
        return envelope_behind(freq, q, rate, gain, envelope).drive - drive

    if not drive >= 1:
        raise BadValue(f"best_gain: drive = {drive!r} must be 1 or above")
    most = math.nextafter(2 * q, 0)
    if over(most) <= 0:
        return most
    return 1.0 if over(1.0) >= 0 else float(bisect(over, 1.0, most, maxiter=2000))
