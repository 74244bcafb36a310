"""Thresholds of vibration on the hand: of detection, and of a difference.

The sources give few figures with certainty, so the thresholds are laws with one anchor
in place of a digitised curve.  Each channel has a range of frequency, outside of which
nothing is said.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.graph import unmasked
from ..core.scene import Scene
from ..core.units import unit as unit_of
from ..errors import Above0, BadValue, UnitError, computed, public
from ..run.rendering import Rendering
from ..scenes import ROWS
from .listening import vibration
from .recursion import all_pole


class Channel(NamedTuple):
    """The threshold of a channel, as a peak displacement of the skin over frequency."""

    low: float  # Hz; the law holds from here
    best: float  # Hz; the threshold falls as 1/f^2, 12 dB per octave, up to here
    threshold: float  # m, from there on, under a contactor of AREA
    summation: float  # power of AREA/area by which it grows


# the Pacinian and the non-Pacinian channel
CHANNELS = {
    # Verrillo 1963, contactors of 2.9 cm^2 on the thenar eminence, 1 s: 12 dB per
    # octave below 250 Hz, 3 dB less for each doubling of the area; the anchor of -20 dB
    # re 1 um is assumed, docs/reference/felt.rst
    "P": Channel(40.0, 250.0, 1e-7, 0.5),
    # the same source: flat up to 40 Hz, where both channels meet; no summation
    "NP": Channel(25.0, 25.0, 1e-7 * (250 / 40) ** 2, 0.0),
}
HIGH = 320.0  # Hz, the highest frequency at which the effect of the area is known
# m^2: area of contact of the thresholds, and the range of the law of area
AREA, AREAS = 2.9e-4, (0.02e-4, 2.9e-4)
TAU = 0.2  # s, of summation over time in the Pacinian channel: assumed, as above
FADE = 0.04  # s, at both ends of a record
MASKER = 44.0  # dB SL, the strongest masker with which channels were independent
SPREAD = 5.0  # dB, a standard deviation between persons: assumed, docs/reference/felt.rst
# Weber fractions of amplitude and of frequency: "at least 20-30 % for robust
# discrimination", the touch-screen thesis, section 4.2, after Choi and Kuchenbecker
DIFFERENCES = 0.2, 0.3
ORDERS = {"m": 0, "m/s": 1, "m/s**2": 2, "N": 2}


class Felt(NamedTuple):
    """The sensation level of a vibration in each channel.

    ``str`` of it gives both levels, and what they mean for most persons.

    Attributes
    ----------
    pacinian : float
        Level in dB SL of what is between 40 and 320 Hz.
    non_pacinian : float
        Level in dB SL of what is between 25 and 320 Hz.  Where one level is above 44 dB
        SL, the lower one is not known, and nan.
    outside : float
        Share of the vibration's power, in the unit of the signal, at other frequencies.
    """

    pacinian: float
    non_pacinian: float
    outside: float

    @property
    def level(self) -> float:
        """The higher of the two levels, in dB SL."""
        return max((n for n in self[:2] if n == n), default=float("nan"))

    def __str__(self):
        level, sure = self.level, 2 * SPREAD
        word = (
            "felt"
            if level >= sure
            else "not felt"
            if level <= -sure
            else f"near the threshold, which differs by {SPREAD:g} dB between persons"
        )
        p, n = (f"{v:.1f} dB SL" if v == v else "unknown" for v in self[:2])
        return f"Pacinian {p}, non-Pacinian {n}: {word}"


class Apart(NamedTuple):
    """How many difference thresholds lie between two vibrations.

    ``str`` of it gives both numbers, and what they mean.

    Attributes
    ----------
    least, most : float
        Counted in steps of 30 %, and of 20 %.
    """

    least: float
    most: float

    def __str__(self):
        word = "told apart" if self.least >= 1 else "not told apart" if self.most < 1 else "unsure"
        return f"{self.least:.1f} to {self.most:.1f} difference thresholds: {word}"


@public
@computed
def difference_steps(first: Above0, second: Above0) -> Apart:
    """Return how many difference thresholds lie between two vibrations.

    Parameters
    ----------
    first, second : float
        Amplitudes in any unit, or frequencies.  Of two sensation levels in dB, give
        10^(level/20).

    Returns
    -------
    Apart

    Raises
    ------
    BadValue
        A number not above 0.

    Notes
    -----
    The number is abs(ln(second/first))/ln(1 + w) with the Weber fractions w = 0.3 and
    0.2: so many steps of w lead from one to the other.  Nearer than about 10 dB to the
    threshold of detection the fractions are larger.

    References
    ----------
    The touch-screen thesis, section 4.2: at least 20 to 30 % of frequency and amplitude
    for robust discrimination, after S. Choi and K. J. Kuchenbecker, "Vibrotactile
    display: perception, technology, and applications", Proc. IEEE 101 (2013).  N. G.
    Forta, M. J. Griffin and M. Morioka, "Vibrotactile difference thresholds: effects of
    vibration frequency, vibration magnitude, contact area, and body location",
    Somatosens. Mot. Res. 29 (2012), found medians from 0.20 (125 Hz) to 0.58 (10 Hz).

    Examples
    --------
    The amplitudes of the thesis, and two that hardly differ:

    >>> from stimlib.analysis import difference_steps
    >>> print(difference_steps(0.5, 4.0))
    7.9 to 11.4 difference thresholds: told apart
    >>> print(difference_steps(158.0, 185.0))
    0.6 to 0.9 difference thresholds: not told apart
    """
    few, many = (
        abs(float(np.log(np.divide(second, first)))) / float(np.log1p(w)) for w in DIFFERENCES[::-1]
    )
    return Apart(few, many)


@public
def detection_threshold(
    freq: ArrayLike, area: float = AREA, channel: Literal["P", "NP"] | None = None
) -> np.ndarray:
    """Return the smallest vibration of the skin of the hand that is detected.

    Parameters
    ----------
    freq : array_like
        Frequencies in Hz, from 25 ("P": 40) to 320.
    area : float
        Area of the vibrating contact in m^2, from 0.02e-4 to 2.9e-4.
    channel : {"P", "NP"}, optional
        Of the Pacinian or the non-Pacinian channel alone; by default of the more
        sensitive one.

    Returns
    -------
    ndarray
        Peak displacement in m.

    Raises
    ------
    BadValue
        A frequency or an area at which no threshold is known here; another channel.

    Notes
    -----
    P: 0.1 um (250 Hz/f)^2 (2.9 cm^2/area)^(1/2), with f up to 250 Hz.  NP: 3.9 um at
    any frequency and area.

    References
    ----------
    R. T. Verrillo, "Effect of contactor area on the vibrotactile threshold", J. Acoust.
    Soc. Am. 35 (1963).  S. J. Bolanowski, G. A. Gescheider, R. T. Verrillo and C. M.
    Checkosky, "Four channels mediate the mechanical aspects of touch", J. Acoust. Soc.
    Am. 84 (1988).

    Examples
    --------
    >>> from stimlib.analysis import detection_threshold
    >>> (1e6 * detection_threshold([30, 125, 250])).round(2)  # um
    array([3.91, 0.4 , 0.1 ])
    >>> (1e6 * detection_threshold([30, 125, 250], area=1e-4)).round(2)
    array([3.91, 0.68, 0.17])
    """
    used = [c for name, c in CHANNELS.items() if channel in (None, name)]
    f, low = np.asarray(freq, float), min(c.low for c in used)
    if not ((f >= low) & (f <= HIGH)).all():
        raise BadValue(
            f"detection_threshold: freq = {f[~((f >= low) & (f <= HIGH))].flat[0]:g} Hz is outside"
            f" of {low:g} to {HIGH:g} Hz, where thresholds are known here; measure one there"
        )
    if not AREAS[0] <= area <= AREAS[1]:
        raise BadValue(
            f"detection_threshold: area = {area:g} m^2 is outside of {AREAS[0]:g} to"
            f" {AREAS[1]:g} m^2, where its effect was measured; give the nearest"
        )
    return np.min([_law(c, f, area) for c in used], axis=0)


def _law(c: Channel, f: np.ndarray, area: float) -> np.ndarray:
    """Return the threshold of a channel; infinite outside of its range."""
    rise = np.maximum(c.best / np.maximum(f, c.low), 1.0) ** 2
    return np.where(f < c.low, np.inf, c.threshold * rise * (AREA / area) ** c.summation)


@public
def sensation_level(
    y: ArrayLike,
    fs: float,
    unit: str,
    area: float = AREA,
    mass: float | None = None,
    gain: float = 1.0,
) -> Felt:
    """Return how far a vibration is above the threshold of detection, in dB SL.

    Parameters
    ----------
    y : array_like, shape (n,)
        A signal, in which slow parts do not matter.
    fs : float
        Sample rate in Hz, above 640 for vibrations up to 320 Hz.
    unit : str
        Of ``gain`` times y: ``"m"``, ``"m/s"`` or ``"m/s^2"``, a motion of the skin, or
        ``"N"``, a force on a mass that is free to vibrate.
    area : float
        Area of contact in m^2, see `detection_threshold`.
    mass : float, optional
        In kg, of what the force moves; for ``"N"`` alone.
    gain : float
        Factor on y: of an output in V, the displacement in m per V.

    Returns
    -------
    Felt
        Levels in both channels, and the share of the power at other frequencies.

    Raises
    ------
    UnitError
        Another unit.
    BadValue
        A force without a mass above 0, or a mass without a force; a signal that is no
        row of finite numbers; a sample rate that is not above 25 Hz; an area as for
        `detection_threshold`.

    Notes
    -----
    What is slower than 12.5 Hz is removed, and the first and last 40 ms are faded: give
    a short signal as much silence at both ends.  The spectrum of the displacement is
    divided by the threshold.  In the Pacinian channel energies sum, over frequency and,
    with a time constant of 0.2 s, over time; the level is that of the largest sum.  The
    non-Pacinian channel does not summate: its level is that of the largest amplitude.
    Masking is not modelled: two channels were shown not to mask each other up to 44 dB
    SL, and above, the weaker of the two levels is nan.

    References
    ----------
    As `detection_threshold`.  J. Zwislocki, "Theory of temporal auditory summation", J.
    Acoust. Soc. Am. 32 (1960); it predicts the thresholds of short signals in the
    Pacinian channel (G. A. Gescheider et al., J. Acoust. Soc. Am. 95, 1994).  J. C.
    Makous, R. M. Friedman and C. J. Vierck, "A critical band filter in touch", J.
    Neurosci. 15 (1995).  G. A. Gescheider, M. J. O'Malley and R. T. Verrillo,
    "Vibrotactile forward masking: evidence for channel independence", J. Acoust. Soc.
    Am. 74 (1983).

    Examples
    --------
    A tone of 250 Hz and 1 um, on 2.9 cm^2 and under a finger tip of 1 cm^2:

    >>> import numpy as np
    >>> from stimlib.analysis import sensation_level
    >>> t = np.arange(16000) / 8000
    >>> tone = 1e-6 * np.sin(2 * np.pi * 250 * t)
    >>> print(sensation_level(tone, 8000, "m"))
    Pacinian 20.0 dB SL, non-Pacinian -11.8 dB SL: felt
    >>> print(sensation_level(tone, 8000, "m", area=1e-4))
    Pacinian 15.4 dB SL, non-Pacinian -11.8 dB SL: felt
    """
    name = str(unit_of(unit))
    if name not in ORDERS:
        raise UnitError(
            f"sensation_level: a signal in {unit or '1'} is no motion; give one in m, m/s, m/s^2,"
            " or N on a mass, or unit= and gain= of the motion that it makes"
        )
    if name == "N" and not (mass is not None and mass > 0):
        raise BadValue(
            f"sensation_level: a force in N with mass = {mass}; give mass=, in kg and above 0, of"
            " what the force moves"
        )
    if name != "N" and mass is not None:
        raise BadValue(
            f"sensation_level: mass = {mass} kg for a motion in {name}; leave mass out, it is for a"
            " force in N"
        )
    detection_threshold(HIGH, area)  # which knows the areas
    if not np.isfinite(rows := unmasked(y)).all():
        raise BadValue("sensation_level: y has a number that is not finite; give finite samples")
    power_of_2 = int(np.frexp(np.abs(rows).max(initial=0.0))[1])  # so that squares exist
    with np.errstate(all="ignore"):  # of silence, and of numbers beyond any skin
        fast = vibration(np.ldexp(rows, -power_of_2), fs, CHANNELS["NP"].low / 2)
        # the ends of a record are no clicks
        ends = np.minimum(np.arange(fast.size), np.arange(fast.size)[::-1]) / (FADE * fs)
        fast *= np.sin(np.pi / 2 * np.minimum(ends, 1.0)) ** 2
        f, lines = np.fft.rfftfreq(fast.size, 1 / fs), np.fft.rfft(fast)
        power = np.abs(lines) ** 2
        known = (f >= CHANNELS["NP"].low) & (f <= HIGH)
        lines[~known] = 0.0
        lines[known] /= (2 * np.pi * f[known]) ** ORDERS[name]
        leak = -np.expm1(-1 / (TAU * fs))
        # envelopes, 1.0 at the threshold
        p, n = (
            np.abs(np.fft.ifft(2 * lines / _law(c, f, area), fast.size)) for c in CHANNELS.values()
        )
        summed, _ = all_pole(leak, [leak - 1], p**2)
        levels = 10 * np.log10([summed.max(), (n**2).max()])
        levels += 20 * (power_of_2 * np.log10(2.0) + np.log10(abs(gain)) - np.log10(mass or 1.0))
        if levels.max() > MASKER:
            levels[levels.argmin()] = np.nan
        outside = float(np.nan_to_num(power[~known].sum() / power.sum()))
    return Felt(float(levels[0]), float(levels[1]), outside)


def device_of(scene: Scene, output: str) -> dict[str, Any]:
    """Return the arguments of `sensation_level` for an output: its unit, and a device.

    The device is the one that the row of a shipped scene states for outputs in this
    unit.
    """
    unit = str(scene.outputs[output].dim)
    laws = [p.law for p in scene.parts if output in p.outputs.values() or not p.outputs]
    row = next((ROWS[law] for law in laws if law in ROWS), None)
    return {"unit": unit} | dict(row.device.get(unit, {}) if row else {})


@public
def felt(rendering: Rendering, output: str | None = None, **device: Any) -> Felt:
    """Return how far the vibration in an output is above the threshold of detection.

    ``Rendering.felt`` is this function.

    Parameters
    ----------
    rendering : Rendering
    output : str, optional
        By default the first.
    **device
        ``unit``, ``area``, ``mass`` and ``gain`` of `sensation_level`, in place of
        those that a shipped scene states for its output.  With another unit the mass
        and gain that it states do not count.

    Returns
    -------
    Felt

    Raises
    ------
    UnknownName
        No such output.
    UnitError, BadValue
        As `sensation_level`.

    Examples
    --------
    See ``Rendering.felt``.
    """
    name = rendering.outputs[0] if output is None else output
    y = rendering[name]  # which knows the names
    stated = device_of(rendering.scene, name)
    if device.get("unit", stated["unit"]) != stated["unit"]:  # mass and gain are of another one
        stated = {word: v for word, v in stated.items() if word == "area"}
    return sensation_level(y, rendering.fs, **stated | device)
