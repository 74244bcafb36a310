"""Calibration: the output of a device, in m/s^2, m or N, over frequency.

A calibration gives the output for a sinusoid of amplitude 1.0. It is measured with a
sensor at the actuator (``record_sweep``), kept in a file, and converts amplitudes in
physical units into samples for the device.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import interp1d
from scipy.linalg import solve_toeplitz
from scipy.ndimage import uniform_filter1d

from ..core.guard import Guard
from ..core.scene import Scene
from ..core.units import ONE, pretty, unit as unit_of
from ..errors import BadValue, From0, RecordingError, SinkError, UnitError, public, said_as
from ..plate.identify import Sweep
from ..run.safety import STEPS, Inverse, Safety, inverted
from ..system import fields, safe_files
from .resonance import record_sweep

Array = NDArray[np.float64]
LEAST, MOST = 1e-9, 1e12  # of a gain: below and beyond, it is an error of the file
TAPS = tuple(2 * round(64 * 2 ** (k / 2)) + 1 for k in range(13))
RINGS = tuple(round(256 * 2 ** (k / 2)) for k in range(13))  # samples of the response
ERROR, SPILL = 0.01, 0.25  # of inverse and device, within the band and where nothing was measured
BENT = 0.03  # largest bias of the resolution
GRID = 1 << 17  # samples of the grid of frequencies
CALM = 1e-4  # weight of the modelled response where nothing was measured
_NUMBERS = fields.list_of(fields.number)
FIELDS = {
    "freq": _NUMBERS,
    "gain_real": _NUMBERS,
    "gain_imag": _NUMBERS,
    "uncertainty": fields.list_of(fields.not_negative),
    "unit": fields.text,
    "date": fields.text,
    "parts": fields.table_of(fields.text),
    "band": _NUMBERS,
}


@public
@dataclass(frozen=True, eq=False)
class Calibration:
    """The frequency response of a device with its amplifier and actuator.

    Parameters
    ----------
    freq : ndarray, shape (k,)
        Hz, rising.
    gain : ndarray of complex, shape (k,)
        In ``unit``, for a sinusoid of amplitude 1.0 at the device.
    uncertainty : ndarray, shape (k,)
        Relative, of the gain's magnitude: it holds in 95 % of calibrations.
    unit : str
        Such as ``"m/s^2"``.
    date : str
        Date of the measurement, such as ``"2026-11-25"``.
    parts : dict of str to str
        What was measured, with serial numbers: ``{"actuator": "BM3C 0042"}``.
    band : (float, float), optional
        In Hz, within ``freq``: the band that ``inverse`` equalises; by default all.
        What was measured beyond it makes the limits at the skin more exact and the
        filter shorter.

    Raises
    ------
    BadValue
        Lengths that differ, frequencies that do not rise, numbers that are not finite,
        a band that was not measured.
    UnitError
        No unit.
    """

    freq: Array
    gain: NDArray[np.complex128]
    uncertainty: Array
    unit: str
    date: str = ""
    parts: Mapping[str, str] = field(default_factory=dict)
    band: tuple[float, ...] = ()

    def __post_init__(self):
        rows = {
            "freq": np.asarray(self.freq, float),
            "gain": np.asarray(self.gain, complex),
            "uncertainty": np.asarray(self.uncertainty, float),
        }
        for name, row in rows.items():
            if row.ndim != 1 or row.size != rows["freq"].size or row.size < 2:
                raise BadValue(f"Calibration: {name} must be a row as long as freq, 2 or more")
            if not np.isfinite(row).all():
                raise BadValue(f"Calibration: {name} has a number that is not finite")
            object.__setattr__(self, name, row)
        if not (self.freq[0] > 0 and (np.diff(self.freq) > 0).all()):
            raise BadValue("Calibration: freq must rise, from above 0")
        size = np.abs(self.gain)
        least = int(size.argmin())
        if not (LEAST < size[least] and size[least] > LEAST * size.max() and size.max() < MOST):
            raise BadValue(
                f"Calibration: the gain at {self.freq[least]:g} Hz is {size[least]:g}, and the"
                f" largest {size.max():g}: that is no actuator; calibrate a band in which it moves"
            )
        unit_of(self.unit)
        ends = tuple(map(float, self.band or self.freq[[0, -1]]))
        if not (len(ends) == 2 and self.freq[0] <= ends[0] < ends[1] <= self.freq[-1]):
            raise BadValue(
                f"Calibration: band = {self.band} must be two frequencies, rising, within"
                f" {self.freq[0]:g} to {self.freq[-1]:g} Hz"
            )
        object.__setattr__(self, "band", ends)
        if not self._inside.any():
            raise BadValue(
                f"Calibration: none of freq is within band = {ends}: give a band that was measured"
            )

    def __repr__(self):
        low, high = self.band
        unit, date = pretty(self.unit), self.date or "no date"
        return f"Calibration({unit} from {low:g} to {high:g} Hz, {date})"

    @property
    def _inside(self) -> Any:
        return (self.freq >= self.band[0]) & (self.freq <= self.band[1])

    def full_scale(self, freq: float) -> float:
        """Return the output amplitude, in ``unit``, for a sample amplitude of 1.0.

        Use it as the full scale of a sink that plays vibrations of this frequency.

        Parameters
        ----------
        freq : float
            In Hz, within the measured range.

        Raises
        ------
        BadValue
            A frequency outside of it.
        """
        return float(self._at(freq, np.abs(self.gain)))  # whatever the phase, as of a delay

    def error(self, freq: float) -> float:
        """Return the relative uncertainty (95 %) of ``full_scale`` at a frequency.

        Raises
        ------
        BadValue
            A frequency outside the measured range.
        """
        return float(self._at(freq, self.uncertainty))

    def _at(self, freq: float, row: Any) -> Any:
        if isinstance(freq, bool) or not isinstance(freq, int | float | np.number):
            raise BadValue(f"Calibration: freq = {freq!r:.40} must be a number of Hz")
        low, high = self.freq[[0, -1]]
        if not low <= freq <= high:
            raise BadValue(
                f"Calibration: {freq:g} Hz is outside of {low:g} to {high:g} Hz, where the device"
                " was measured; choose a frequency there, or calibrate again with a wider sweep"
            )
        return np.interp(freq, self.freq, row)

    def inverse(self, fs: float, taps: int | None = None) -> Array:
        """Return the taps of a filter that equalises the response within the band.

        Filter and device together have gain 1 in the band and at most 1 at all other
        frequencies. The gain falls to 0 over what was measured next to the band, but at
        least over 0.3 of the band's lower end and 0.1 of its upper end, and at most
        over half of each. A response that was not measured is extrapolated there with
        its last gain; beyond, the device is assumed to have at most its largest
        measured gain, and the filter keeps the product below 0.25. The filter delays by
        (taps - 1)/2 samples.

        Parameters
        ----------
        fs : float
            Hz, at which it will play.
        taps : int, optional
            Odd; more follow sharper resonances and narrower slopes beside the band.  By
            default the fewest of 129, 183, 257, .. 8193 that invert with an error
            of at most 1 %, before they are scaled for a gain of at most 1.

        Returns
        -------
        ndarray, shape (taps,)

        Raises
        ------
        BadValue
            An even number of taps; a sample rate too low for the band; a response that
            the taps invert with an error above 5 %, or with an overall gain above 1
            outside of the band.
        """
        return self._inverse(fs, taps)[0]

    def _inverse(self, fs: float, taps: int | None = None) -> tuple[Array, float, Array, float]:
        """Return the taps of the inverse filter, its largest error, and ``_response``.

        The error is relative. The taps minimise the squared error of filter and device
        over all frequencies.
        """
        if (taps is not None and (taps < 3 or taps % 2 == 0)) or self.band[1] >= 0.48 * fs:
            raise BadValue(
                f"Calibration.inverse: taps = {taps} must be odd, and fs = {fs:g} Hz above"
                f" {self.band[1] / 0.48:.0f} Hz"
            )
        f, measured, known, wanted, held = self._over(fs)
        response, apart = self._response(fs)
        fit = np.fft.rfft(response, GRID) / held
        ends = np.clip(np.arange(f.size), *np.flatnonzero(measured)[[0, -1]])
        device = np.where(known, held * fit[ends], np.abs(self.gain).max())
        found, overall, error, spill = np.empty(0), np.zeros(f.size), math.inf, math.inf
        for n in TAPS if taps is None else (taps,):
            delay = np.exp(-2j * np.pi * (n // 2) / fs * f)
            found = _fitted(known + 0.05 * ~known, device, wanted * delay, n)
            overall = np.fft.rfft(found, GRID) * device / delay
            error = float(np.abs(overall - 1.0)[wanted == 1.0].max())
            spill = float(np.abs(overall[~known]).max(initial=0.0))
            if error <= ERROR and spill <= SPILL:
                break
        if not (error <= 0.05 and spill <= 1.0):
            raise BadValue(
                f"Calibration.inverse: {found.size} taps invert the response with an error of"
                f" {error:.1%}, and a gain of up to {spill:.2g} where nothing was measured: give"
                " more taps, sweep more beyond the band, or leave out the deepest gap"
            )
        most = max(1.0, np.abs(overall[wanted < 1.0]).max(initial=0.0))
        error = float(np.abs(overall / most - 1.0)[wanted == 1.0].max())
        return found / most, error, response, apart

    def _over(self, fs: float) -> tuple[Any, Any, Any, Any, Any]:
        """Return frequencies up to fs/2, and what holds there.

        That is whether the response was measured, whether it counts as known, the
        wanted overall gain, and the response, held beyond the measured range.
        """
        (low, high), (first, last) = self.band, self.freq[[0, -1]]
        below = np.clip(low - first, 0.3 * low, 0.5 * low)
        above = np.clip(last - high, 0.1 * high, 0.5 * high)
        f = np.arange(GRID // 2 + 1) * (fs / GRID)
        known = (f >= min(first, low - below)) & (f <= max(last, high + above))
        falls = np.clip((low - f) / below, 0.0, 1.0) + np.clip((f - high) / above, 0.0, 1.0)
        wanted, unsure = (
            0.5 + 0.5 * np.cos(np.pi * falls),
            np.interp(f, self.freq, self.uncertainty),
        )
        wanted = wanted / (1.0 + 4.0 * unsure * (1.0 - wanted))  # less where a gain is uncertain
        measured, turned = (f >= first) & (f <= last), np.unwrap(np.angle(self.gain))
        turned = interp1d(self.freq, turned, bounds_error=False, fill_value="extrapolate")(f)
        held = np.interp(f, self.freq, np.abs(self.gain)) * np.exp(1j * turned)
        return f, measured, known, wanted, held

    def _response(self, fs: float) -> tuple[Array, float]:
        """Return the device's response to one sample of 1.0, and its relative error.

        It is the shortest causal response that agrees with the measured gains, so that
        it does not follow their noise, with little where nothing was measured. In the
        band, 90 % agree within their uncertainty and all within twice that, besides the
        error. Beside it the error counts as a part of the wanted overall gain, and
        beyond that as a part of the largest gain.
        """
        f, measured, _, wanted, device = self._over(fs)
        inside, most = wanted == 1.0, np.abs(self.gain).max()
        size = np.minimum(np.abs(device) / np.maximum(wanted, 1e-9), most)
        smooth = uniform_filter1d(self.uncertainty, 9)
        noise = np.interp(f, self.freq, smooth) * np.abs(device) / size
        found, error = np.empty(0), math.inf
        for n in RINGS:
            found = _fitted(
                np.where(measured, most / size, CALM), np.ones(f.size), measured * device, n
            )
            apart = np.abs(np.fft.rfft(found, GRID) - device) / size - noise
            error = max(0.0, np.quantile(apart[inside], 0.9), (apart - noise)[measured].max())
            if error <= ERROR / 2:
                break
        return found, float(error)

    def _fits(self, scene: Scene) -> None:
        """Raise UnitError for outputs in a unit other than the calibration's."""
        dims = {name: block.dim for name, block in scene.outputs.items()}
        wrong = [name for name, dim in dims.items() if dim not in (ONE, unit_of(self.unit))]
        if wrong or all(dim == ONE for dim in dims.values()):
            name = (wrong or list(dims))[0]
            raise UnitError(
                f"Calibration: {name} is in {dims[name]}, but the device is calibrated in"
                f" {(unit := pretty(self.unit))}; give the scene this unit, for instance"
                f" tone(unit={unit!r})"
            )

    def limits(self, scene: Scene) -> Safety:
        """Return the default limits of a sink with this calibration.

        The limit of outputs in ``unit`` is the largest amplitude that the device
        reaches in the band; outputs without a unit have the limit 1.0.

        Raises
        ------
        UnitError
            An output in another unit.
        """
        self._fits(scene)
        most = float(np.abs(self.gain[self._inside]).max())
        return Safety({n: 1.0 if b.dim == ONE else most for n, b in scene.outputs.items()})

    def safety(self, scene: Scene, safety: Safety, fs: float) -> Safety:
        """Return the safety limits of a scene, with the inverse filter after them.

        Sinks and experiments call it for ``calibration=``.

        Parameters
        ----------
        scene : Scene
            A scene with outputs in ``unit`` or without a unit.
        safety : Safety
            With limits in the outputs' units.
        fs : float
            Hz, at which it will play.

        Raises
        ------
        UnitError
            An output in another unit.
        BadValue
            As ``inverse``; a sample rate so low for the band, or gains so far apart,
            that no causal response fits them within 25 %.
        """
        self._fits(scene)
        return replace(safety, inverse=_inverse_of(self, fs))

    def drive(self, scene: Scene, fs: float, taps: int | None = None) -> Scene:
        """Return a scene that drives the device so that it produces a scene's outputs.

        Each output passes through the filter ``inverse``, which delays it by (taps -
        1)/2 samples; it must not contain frequencies outside the band.  Use it for
        renderings and files; a sink accepts the calibration directly.

        Parameters
        ----------
        scene : Scene
            A scene with outputs in ``unit``.
        fs : float
            Hz, at which it will be rendered.
        taps : int, optional
            As ``inverse``.

        Returns
        -------
        Scene
            A scene whose outputs have no unit: give the file a full scale of 1.0.

        Raises
        ------
        UnitError
            An output in another unit.
        BadValue
            As ``inverse``.
        """
        self._fits(scene)
        weights, unit = self.inverse(fs, taps), f"1/({self.unit})"
        # behind a guard, noise need not run before sample 0 for so long a filter
        made = {name: Guard(y, STEPS) for name, y in scene.outputs.items()}
        return Scene({name: inverted(y, weights, unit) for name, y in made.items()})

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the calibration to a JSON file, atomically.

        Raises
        ------
        SinkError
            The place cannot be written.
        """
        data = {
            "freq": self.freq.tolist(),
            "gain_real": self.gain.real.tolist(),
            "gain_imag": self.gain.imag.tolist(),
            "uncertainty": self.uncertainty.tolist(),
            "unit": self.unit,
            "date": self.date,
            "parts": dict(self.parts),
            "band": list(self.band),
        }
        safe_files.publish(path, json.dumps(data, indent=1) + "\n")


def _fitted(weights: Array, device: Any, wanted: Any, n: int) -> Array:
    """Return the n taps whose response times the device's is nearest to ``wanted``."""
    row = np.fft.irfft(weights * np.abs(device) ** 2)[:n]
    row[0] *= 1 + 1e-9
    return solve_toeplitz(row, np.fft.irfft(weights * np.conj(device) * wanted)[:n])


@lru_cache(8)
def _inverse_of(made: Calibration, fs: float) -> Inverse:
    """Return the inverse filter and the modelled response at a sample rate."""
    taps, error, response, apart = made._inverse(fs)
    if not apart <= SPILL:
        raise BadValue(
            f"Calibration.safety: at fs = {fs:g} Hz no response fits the gains better than"
            f" {apart:.0%}, so no limit at the skin would hold: give a higher sample rate, or"
            f" calibrate with a finer resolution; {5 * made.band[1]:g} Hz is mostly enough"
        )
    stated = error + apart + float(made.uncertainty[made._inside].max())
    return Inverse(taps.tolist(), response.tolist(), max(1, int(fs / 30 / made.band[1])), stated)


@public
def load_calibration(path: str | os.PathLike[str]) -> Calibration:
    """Read a calibration that ``Calibration.save`` wrote.

    Raises
    ------
    SinkError
        The file is missing or is no calibration.

    Examples
    --------
    >>> import tempfile
    >>> from stimlib.devices import Calibration, load_calibration
    >>> made = Calibration([50, 500], [2.0, 1.0], [0.01, 0.02], "m/s^2", "2026-11-25")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made.save(f"{folder}/actuator.json")
    ...     load_calibration(f"{folder}/actuator.json")
    Calibration(m/s² from 50 to 500 Hz, 2026-11-25)
    """
    with said_as(SinkError, f"{path} is not a calibration", ValueError, TypeError):
        data = fields.parse(safe_files.read(path, "sidecar_bytes"))
        fields.require(data, FIELDS)
        if len(data["gain_real"]) != len(data["gain_imag"]):
            raise ValueError("gain_real and gain_imag must have one length")
        gain = np.array(data.pop("gain_real")) + 1j * np.array(data.pop("gain_imag"))
        return Calibration(gain=gain, **{k: data[k] for k in FIELDS if k in data})


@public
def calibrate(
    sweep: Sweep,
    unit: str,
    band: tuple[float, float],
    *,
    resolution: float = 2.0,
    sensor: From0 = 0.0,
    on: str | None = None,
    parts: Mapping[str, str] | None = None,
) -> Calibration:
    """Estimate the response of a device from repeated takes of one sweep.

    For each take, the gain in each band of ``resolution`` Hz is a least-squares
    straight line over frequency, corrected by its second difference: a line through a
    parabola misses it by 1/24 of that. The calibration is the mean gain of all takes.
    Its uncertainty comes from their spread (Student's t, n - 1 degrees of freedom), and
    the size of the correction is added.

    The calibration keeps all that was measured well from half of the band's lower end
    to three times its upper end, where the sweep reaches so far. Its inverse falls to 0
    over what was measured beside the band, and its limits at the skin count on that.

    Parameters
    ----------
    sweep : Sweep
        Result of ``record_sweep(.., full_scale=1.0, points=range(n))``: drive as
        fractions of full scale, response in ``unit``, three takes or more.
    unit : str
        Unit of the response.
    band : (float, float)
        In Hz, within the range of the sweep, which is best from half of the lower end
        or less to 1.5 times the upper end or more.
    resolution : float
        Hz; less than a third of the width of the sharpest resonance.
    sensor : float
        Relative uncertainty of the sensor's own calibration, 95 %, which is added.
    on : str, optional
        Date; today's by default.
    parts : dict of str to str, optional
        What was measured, with serial numbers.

    Returns
    -------
    Calibration

    Raises
    ------
    BadValue
        Fewer than three takes; a band that is not in them, or narrower than two
        resolutions; a resolution so coarse that its bias is above 3 %.

    Examples
    --------
    An actuator that makes 2 m/s^2 at full scale, with noise in the sensor:

    >>> import numpy as np
    >>> from stimlib.devices import calibrate
    >>> from stimlib.plate import Sweep
    >>> t = np.arange(4000) / 2000
    >>> u = np.tile(np.sin(2 * np.pi * (50 * t + 100 * t**2)), (4, 1))  # 50 to 450 Hz
    >>> noise = 0.05 * np.random.default_rng(1).normal(size=u.shape)
    >>> found = calibrate(Sweep(u, 2 * u + noise, 2000.0), "m/s^2", (80, 400))
    >>> print(f"{found.full_scale(250):.2f} m/s^2, +-{100 * found.error(250):.1f} %")
    2.01 m/s^2, +-1.0 %
    """
    from scipy.stats import t as student

    u, y = (np.atleast_2d(np.asarray(rows, float)) for rows in (sweep.drive, sweep.response))
    takes, n = y.shape
    if takes < 3:
        raise BadValue(f"calibrate: {takes} takes: three or more show how far they are apart")
    low, high = band
    inside = 0 < low and low + 2 * resolution <= high <= sweep.fs / 2
    if not (inside and resolution * n >= 3 * sweep.fs):
        raise BadValue(
            f"calibrate: band = {band} Hz and resolution = {resolution:g} Hz: the band must lie"
            f" between 0 and {sweep.fs / 2:g} Hz, hold two resolutions, and each of them three"
            f" steps of {sweep.fs / n:.3g} Hz"
        )
    f = np.arange(n // 2 + 1) * (sweep.fs / n)
    drive, response = np.fft.rfft(np.broadcast_to(u, y.shape)), np.fft.rfft(y)
    step = resolution / 2
    freq: Any = low + step * np.arange(
        -int(low / resolution), int(min(3 * high, (sweep.fs + step) / 2 - low) / step)
    )
    swept = (freq > low - step / 2) & (freq < high + step / 2)
    with np.errstate(all="ignore"):  # beyond the sweep
        found = [_gain(f, drive, response, at, resolution) for at in freq]
    power, gains = (np.array(rows) for rows in zip(*found, strict=True))  # (k,), (k, takes)
    for at in freq[swept & (power < 1e-3 * power[swept].max())]:
        raise BadValue(
            f"calibrate: the sweep drives nothing at {at:g} Hz: give a band within what was swept"
        )
    poor = freq[~swept & (power < 0.05 * power[swept].max())]
    good = (freq > poor[poor < low].max(initial=0.0)) & (
        freq < poor[poor > high].min(initial=np.inf)
    )
    freq, gains = freq[good], gains[good]
    # a line misses a parabola by 1/24 of the second difference of its neighbours
    bend = np.pad((gains[4:] - 2 * gains[2:-2] + gains[:-4]) / 24, ((2, 2), (0, 0)), "edge")
    gains = gains - bend
    gain = gains.mean(axis=1)
    spread = (gains * (gain.conj() / np.abs(gain))[:, None]).real.std(axis=1, ddof=1)
    random = student.ppf(0.975, takes - 1) * spread / np.sqrt(takes) / np.abs(gain)
    bias = np.abs(bend.mean(axis=1) / gain)
    worst = int(np.argmax((bias - random) * (freq >= low) * (freq <= high)))
    if bias[worst] - random[worst] > BENT:
        raise BadValue(
            f"calibrate: resolution = {resolution:g} Hz is too coarse at {freq[worst]:g} Hz, where"
            f" the gain bends by {bias[worst]:.0%} within it; give a finer one, of longer takes"
        )
    told, ends = date.today().isoformat() if on is None else on, (low, min(high, float(freq[-1])))
    error = np.hypot(random, sensor) + bias
    return Calibration(freq, gain, error, unit, told, dict(parts or {}), ends)


def _gain(f: Any, drive: Any, response: Any, at: float, width: float) -> tuple[Any, Any]:
    """Return the power at a frequency, and each take's gain by a line around it."""
    near = slice(*np.searchsorted(f, [at - width / 2, at + width / 2 * (1 + 1e-9)]))
    u, y, x = drive[:, near], response[:, near], (f[near] - at) / width
    a, b, c = (np.sum(np.abs(u) ** 2 * x**k, axis=1) for k in range(3))
    p, q = (np.sum(u.conj() * y * x**k, axis=1) for k in range(2))
    return a[0], (c * p - b * q) / (a * c - b * b)


@public
def check_level(
    calibration: Calibration,
    sink: Callable[..., Any],
    response: Any,
    rate: float,
    freq: float,
    level: float,
    *,
    tolerance: float | None = None,
    seconds: float = 1.0,
    **options: Any,
) -> float:
    """Play a tone on a calibrated device and check its level with a sensor.

    Call it before a session. A changed amplifier setting, a loose cable or another way
    of holding the actuator shows in the level.

    The level is the amplitude of a least-squares sinusoid in the second half of the
    tone, so that the actuator has settled, and a constant offset does not count.

    Parameters
    ----------
    calibration : Calibration
        Calibration of the device.
    sink, response, rate
        As for ``record_sweep``; the scale of ``response`` is in the calibration's unit.
    freq : float
        Frequency of the tone in Hz, within the measured range.
    level : float
        Peak amplitude of the tone, in the calibration's unit.
    tolerance : float, optional
        Largest difference that passes, in dB.  By default the uncertainty of the
        calibration at this frequency plus that of this measurement (95 %), which
        counts for 5 % at most.
    seconds : float
        Length of the tone.
    **options
        Other options of ``record_sweep`` and of the sink, such as ``channels``.

    Returns
    -------
    float
        Difference between the measured and the expected level in dB, if it passes.

    Raises
    ------
    BadValue
        A frequency outside the measured range; a level that the device does not reach;
        more seconds than ``record_sweep`` records.
    RecordingError
        A level that differs by more than the tolerance; a recording that is clipped,
        silent or has lost frames.
    SinkError
        As ``Sink.open``.

    Examples
    --------
    A rehearsal without a device; the sensor's signal is 1 dB below what it should be:

    >>> import numpy as np
    >>> from stimlib.devices import Calibration, NullSink, check_level
    >>> actuator = Calibration(
    ...     [50, 500], [4.0, 4.0], [0.02, 0.02], "m/s^2", "2026-11-25"
    ... )
    >>> sensor = 3.0 * np.sin(2 * np.pi * 180 * np.arange(4400) / 4000)
    >>> device = dict(sink=NullSink, rate=4000, freq=180.0, level=3.0, clocked=False)
    >>> print(f"{check_level(actuator, response=sensor, **device):.2f} dB")
    0.00 dB
    >>> check_level(actuator, response=0.891 * sensor, **device)
    Traceback (most recent call last):
    ...
    stimlib.errors.RecordingError: check_level: 2.67 m/s² at 180 Hz instead of 3 m/s²
    is a difference of -1.00 dB, more than 0.17 dB; check the sensor, the amplifier's
    setting and how the actuator is held, or calibrate again
    """
    y = record_sweep(
        sink,
        calibration.full_scale(freq),
        response,
        rate,
        (freq, freq),
        seconds,
        rest=0.1,
        amplitude=level,
        **options,
    ).response[0, round(seconds * rate / 2) : round(seconds * rate)]
    wave = np.exp(2j * np.pi * freq / rate * np.arange(y.size))
    fit, rest, *_ = np.linalg.lstsq(np.stack([wave.real, wave.imag, np.ones(y.size)], axis=1), y)
    measured, noise = math.hypot(*fit[:2]), 1.96 * math.sqrt(2 * rest.sum()) / y.size / level
    stated = 20 * math.log10(1 + calibration.error(freq) + min(noise, 0.05))
    allowed = stated if tolerance is None else tolerance
    change, unit = 20 * math.log10(measured / level), pretty(calibration.unit)
    if not abs(change) <= allowed:
        raise RecordingError(
            f"check_level: {measured:.3g} {unit} at {freq:g} Hz instead of {level:g} {unit} is a"
            f" difference of {change:.2f} dB, more than {allowed:.2f} dB; check the sensor, the"
            " amplifier's setting and how the actuator is held, or calibrate again"
        )
    return change


def difference(one: Calibration, other: Calibration, freq: ArrayLike) -> Array:
    """Return the relative difference in gain between two calibrations.

    Examples
    --------
    >>> from stimlib.devices import Calibration
    >>> from stimlib.devices.calibration import difference
    >>> monday = Calibration([50, 500], [2.0, 2.0], [0.01, 0.01], "N")
    >>> friday = Calibration([50, 500], [2.0, 1.8], [0.01, 0.01], "N")
    >>> difference(monday, friday, [50, 500])
    array([ 0. , -0.1])
    """
    at = np.atleast_1d(np.asarray(freq, float))
    return np.array([other.full_scale(f) / one.full_scale(f) - 1 for f in at])
