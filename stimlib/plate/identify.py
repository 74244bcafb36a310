"""Resonances from recorded sweeps: frequency, quality and shape, with uncertainties."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import BadValue, RecordingError, computed, counted, public
from ..motion.cells import columns_of
from ..motion.reports import column_of
from ..motion.table import read_table

QUANTITIES = {"displacement": 0, "velocity": 1, "acceleration": 2}
CONFIDENCE = 0.95
BACKGROUND = 4  # factors of the smooth rest: the other modes, the conjugate pole, a delay
WIDTHS = 4.0  # half bandwidths on each side that are fitted
BINS = 5  # lines within the half bandwidth, at least
DRIVEN = 0.02  # of the strongest line of the drive: below, a line counts as not driven
EVEN = 0.3  # of it: below, no peak is looked for
RINGS = 0.03  # of the largest response, at the end of a recording
PROMPT = 0.02  # 1/(half width): a delay that the smooth rest takes
SURE = 5.0  # standard deviations from which on a delay is seen
IN_PHASE = 0.3  # of the largest point: above, a part across its phase is no mode's
SLOWEST = 0.01  # s between samples: in ms taken for s, 1 kHz has 1
HELD = 3  # samples in a row at the largest value: a recorder at its end


class Sweep(NamedTuple):
    """A drive and the recorded response, at the same samples."""

    drive: np.ndarray  # (n,) or (points, n)
    response: np.ndarray  # (points, n)
    fs: float


@public
def read_sweep(
    source, drive: str | Sequence[str], response: str | Sequence[str], time: str = "t"
) -> Sweep:
    """Read a sweep from columns of a CSV or npz file, a DataFrame or a dict.

    Arrays need no reading: ``identify`` takes them directly, with a sample rate.

    Parameters
    ----------
    source : path or table
    drive : str or sequence of str
        Column of the voltage, or one for each point.
    response : str or sequence of str
        Columns of what was measured, one for each point.  Each may be scaled:
        ``"y_um*1e-6"``.
    time : str
        Column of the time in s, in equal steps, such as ``"t_ms*1e-3"``.

    Raises
    ------
    RecordingError
        A file that cannot be read, a column that is not there, a number that is none,
        times that are not in equal steps or so far apart that they are not in s.
    BadValue
        A text that is no column and scale.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.plate import read_sweep
    >>> sweep = read_sweep(
    ...     {"t": np.arange(3) / 1000, "u": np.ones(3), "centre": np.zeros(3)},
    ...     "u",
    ...     ["centre"],
    ... )
    >>> round(sweep.fs), sweep.response.shape
    (1000, (1, 3))
    """
    table = read_table(source)
    many = not isinstance(drive, str)
    drives, responses = ([v] if isinstance(v, str) else list(v) for v in (drive, response))
    named = [("time", time), *(("drive", d) for d in drives), *(("response", r) for r in responses)]
    linear = [column_of(table, f"read_sweep: {what}", text) for what, text in named]
    names = [c.column for c in linear if c.column is not None]
    rows = columns_of(table, names)
    rows = np.array([[c.scale] for c in linear]) * rows + np.array([[c.offset] for c in linear])
    step = np.diff(rows[0])
    if step.size < 2 or not step.min() > 0 or np.ptp(step) > 0.01 * step.mean():
        remedy = (
            "record at one sample rate, without gaps; where they are only rounded, give identify"
            " the arrays and the rate"
        )
        raise table.error("the times are not in equal steps", remedy, column=time)
    if step.mean() > SLOWEST:
        remedy = f'are they in ms? then write time="{time}*1e-3"'
        raise table.error(
            f"{step.mean():g} s from sample to sample, which is slow for a vibration",
            remedy,
            column=time,
        )
    last = 1 + len(drives)
    return Sweep(rows[1:last] if many else rows[1], rows[last:], float(1 / step.mean()))


@dataclass(frozen=True)
class Resonance:
    """A measured mode.

    Attributes
    ----------
    freq, q : float
        Natural frequency in Hz, and quality.
    freq_sd, q_sd : float
        Standard deviations of both, from the noise that the fit leaves.
    gain : ndarray, shape (points,)
        Response of the mode per drive far below its resonance, as a displacement; its
        size at the resonance is q times that.
    shape : ndarray, shape (points,)
        The same, 1 where it is largest.
    shape_sd : ndarray, shape (points,)
        Standard deviations of ``shape``; 0 at the largest, which the others are
        compared with.
    dof : int
        Degrees of freedom of the noise's estimate.
    delay : float
        Of the response behind the drive in s; 0 where none is seen.  Where there is one
        it is known within about 0.02 q/freq, and so is what the mode decays in that
        time: ``gain`` within about 10 %.  From a quality of about 10 on that may be
        half a period, which turns all signs of ``gain`` together; ``shape`` is the
        same.
    """

    freq: float
    q: float
    freq_sd: float
    q_sd: float
    gain: np.ndarray
    shape: np.ndarray
    shape_sd: np.ndarray
    dof: int
    delay: float = 0.0

    def _interval(self, value: float, sd: float) -> tuple[float, float]:
        half = float(scipy.stats.t.ppf(0.5 + CONFIDENCE / 2, self.dof)) * sd
        return value - half, value + half

    @property
    def freq_interval(self) -> tuple[float, float]:
        """95 % confidence interval of the frequency, in Hz."""
        return self._interval(self.freq, self.freq_sd)

    @property
    def q_interval(self) -> tuple[float, float]:
        """95 % confidence interval of the quality."""
        return self._interval(self.q, self.q_sd)

    def __repr__(self):
        return (
            f"Resonance({self.freq:.6g} +- {self.freq_sd:.1g} Hz, q = {self.q:.4g} +-"
            f" {self.q_sd:.1g}, {counted(self.shape.size, 'point')})"
        )


@public
@computed
def identify(
    drive: ArrayLike,
    response: ArrayLike,
    fs: float,
    band: tuple[float, float] | None = None,
    quantity: Literal["displacement", "velocity", "acceleration"] = "displacement",
) -> Resonance:
    """Identify a resonance from a recorded sweep, at one point or at many.

    Near a mode, each spectrum is Y = U (R/(i w - p) + a smooth rest), with one pole p
    for all points. R and the rest are found by linear least squares for each p, and p
    by the Gauss-Newton method. Noise that is white near the resonance makes this the
    maximum-likelihood estimate, and its curvature gives the uncertainties. A delay
    between the two recordings, the same at all points, is fitted together with the pole
    if it can be seen: it leaves the smoothest rest. A constant in either recording is
    removed, so a drive may have a bias.

    Other modes are part of the rest if they are at least four bandwidths, 4 freq/q,
    away. One as large at two and a half bandwidths makes the frequency 0.3 % and the
    quality 2 % wrong, which the intervals do not include.

    Parameters
    ----------
    drive : array_like, shape (n,) or (points, n)
        Recorded voltage: a chirp through the resonance, at rest before and after it.
    response : array_like, shape (n,) or (points, n)
    fs : float
        Sample rate of both, in Hz.
    band : (float, float), optional
        Where the resonance is looked for, in Hz; by default wherever the sweep drives.
    quantity : {"displacement", "velocity", "acceleration"}
        What the response is.

    Returns
    -------
    Resonance

    Raises
    ------
    BadValue
        Arrays that do not fit, numbers that are not finite, an unknown quantity.
    RecordingError
        A response that is clipped, a sweep that misses the resonance, or one that is
        too short for it; says what to record again.

    References
    ----------
    The touch-screen thesis, section 2.2: frequency sweeps of 1 .. 625 Hz, velocities at
    25 points.  Ewins, "Modal Testing" (2000); Golub and Pereyra, Inverse Problems 19
    (2003) R1, for separable least squares.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import chirp, mode
    >>> from stimlib.plate import identify
    >>> u = chirp(20.0, 400.0, 2.0)
    >>> r = stimlib.render(
    ...     stimlib.Scene({"u": u, "y": 2e-6 * mode(u, 158.0, q=10)}),
    ...     {},
    ...     fs=4000,
    ...     seconds=2.5,
    ... )
    >>> noise = 2e-8 * np.random.default_rng(1).standard_normal(r.y.shape[1])
    >>> found = identify(r["u"], r["y"] + noise, fs=4000)
    >>> (
    ...     abs(found.freq - 158) < 0.1,
    ...     abs(found.q - 10) < 0.1,
    ...     abs(found.gain[0] / 2e-6 - 1) < 0.01,
    ... )
    (True, True, np.True_)
    """
    u, y = _signals(drive, response)
    try:
        low, high = (0.0, fs / 2) if band is None else band
        sensible = 0 < fs < math.inf and 0 <= low < high
    except (TypeError, ValueError):
        sensible = False
    if not sensible:
        raise BadValue(
            f"identify: fs = {fs!r} must be above 0 Hz, and band = {band!r} two frequencies in Hz,"
            " the lower one first"
        )
    check_taken(u, y)
    # a bias of the drive, an offset of the sensor
    u, y = (v - v.mean(axis=1, keepdims=True) for v in (u, y))
    f = np.fft.rfftfreq(y.shape[1], 1 / fs)
    U, Y = np.fft.rfft(u), np.fft.rfft(y)
    power = np.abs(U).max(axis=0) if len(U) > 1 else np.abs(U[0])
    strong = power > DRIVEN * power.max()
    inside = strong & (f >= low) & (f <= high)
    even = inside & (power > EVEN * power.max())
    freq, half = _peak(f, U, Y, even)
    late = _late(U, Y, even, y.shape[1]) / fs
    early = Y * np.exp(2j * math.pi * f * late)
    for _ in range(3):
        near = np.abs(f - freq) <= WIDTHS * half
        if not strong[near].all() or freq - half < low or freq + half > high:
            wide = 2 * WIDTHS * half
            raise RecordingError(
                f"identify: the sweep misses the resonance near {freq:.4g} Hz: of the band it"
                f" drives {f[inside][0]:.4g} .. {f[inside][-1]:.4g} Hz; record"
                f" {max(0.0, freq - wide):.3g} .. {freq + wide:.3g} Hz, evenly"
            )
        if half < BINS * f[1]:
            raise RecordingError(
                f"identify: {y.shape[1] / fs:.3g} s are too short for a resonance of {2 * half:.3g}"
                f" Hz width near {freq:.4g} Hz; record at least {math.ceil(2 * BINS / half)} s, and"
                " until it no longer rings"
            )
        fit = moved = _fit(f[near], U[:, near], early[:, near], freq, half, free=True)
        still = _fit(f[near], U[:, near], Y[:, near], freq, half, free=False)
        if abs(late + moved.delay) < PROMPT / half or still.cost < moved.cost * (
            1 + SURE**2 / moved.dof
        ):
            fit = still
        freq, half = abs(fit.pole) / (2 * math.pi), -fit.pole.real / (2 * math.pi)
        if not (half > 0 and low <= freq <= high):
            raise RecordingError(
                "identify: no resonance in the band; sweep through it, or give band=(low, high)"
                " around it"
            )
    _check_quiet(y, fs, freq, half)
    pole, residues = fit.pole, fit.residues
    w, b = abs(pole), -pole.real / abs(pole)
    # of w and b by the pole's parts
    slopes = np.array([[pole.real, pole.imag], [b * b - 1, -b * pole.imag / w]]) / w
    sd = np.sqrt(np.diag(slopes @ fit.cov @ slopes.T))
    gain = residues * 2j * pole.imag / w**2 / pole ** QUANTITIES[quantity]
    top = np.abs(gain).argmax()
    ratio = gain / gain[top]
    noise = fit.noise * abs(2 * pole.imag / w**2 / pole ** QUANTITIES[quantity] / gain[top])
    _check_in_phase(ratio.imag, IN_PHASE + 5 * noise)
    shape_sd = noise * np.hypot(1.0, ratio.real)  # of a ratio of two that have it
    shape_sd[top] = 0.0
    return Resonance(
        freq=w / (2 * math.pi),
        q=0.5 / b,
        freq_sd=float(sd[0]) / (2 * math.pi),
        q_sd=float(sd[1]) * 0.5 / b**2,
        gain=ratio.real * abs(gain[top]) * (np.sign(gain[top].real) or 1.0),
        shape=ratio.real,
        shape_sd=shape_sd,
        dof=fit.dof,
        delay=0.0 if fit is still else late + fit.delay,
    )


def _signals(drive, response) -> tuple[np.ndarray, np.ndarray]:
    try:
        u, y = (np.atleast_2d(np.asarray(v)) for v in (drive, response))
        u, y = (v.astype(float, casting="same_kind") for v in (u, y))
    except (TypeError, ValueError):
        raise BadValue("identify: drive and response must be rows of numbers") from None
    if (
        not u.size
        or u.ndim != 2
        or y.ndim != 2
        or u.shape[1] != y.shape[1]
        or len(u) not in (1, len(y))
    ):
        raise BadValue(
            f"identify: drive {u.shape} and response {y.shape} must have the same samples, and one"
            " drive or one for each"
        )
    if len(y) > y.shape[1]:
        raise BadValue(
            f"identify: {len(y)} points of {counted(y.shape[1], 'sample')}; a row is a point, so"
            " transpose them, drive.T, response.T"
        )
    return u, y


def check_taken(u: np.ndarray, y: np.ndarray) -> None:
    """Raise an error unless a recorded sweep can be used.

    RecordingError if a row is silent or a response clipped; BadValue if a sample is not
    finite.
    """
    for name, v in (("drive", u), ("response", y)):
        if not np.isfinite(v).all():
            raise BadValue(f"identify: {name} has a sample that is not finite")
        if not np.ptp(v, axis=1).all():
            raise RecordingError(
                f"identify: a row of the {name} never changes: check the cable, and record again"
            )
    for k, row in enumerate(y):
        for end in (row.max(), row.min()):
            at = np.flatnonzero(row == end)
            held = (
                np.convolve(np.diff(at) == 1, np.ones(HELD - 1), "valid")
                if at.size >= HELD
                else np.zeros(1)
            )
            if end != 0 and held.max(initial=0.0) >= HELD - 1:
                raise RecordingError(
                    f"identify: the response of point {k} is clipped at {end:g}: {at.size} samples"
                    " have this value; lower the drive or the recorder's gain, and record again"
                )


def _check_in_phase(across: np.ndarray, most: float) -> None:
    k = int(np.abs(across).argmax())
    if abs(across[k]) > most:
        raise RecordingError(
            f"identify: point {k} answers out of phase with the others, by"
            f" {100 * abs(across[k]):.0f} % of the largest: a mode moves all points together, so"
            " the recordings are not equally late; record the drive together with each response"
        )


def _check_quiet(y: np.ndarray, fs: float, freq: float, half: float) -> None:
    """Raise RecordingError if the resonance still rings at the end of a recording.

    The last part, two time constants long, is compared with the largest sample.
    """
    # a sensor's drift does not ring
    last = scipy.signal.detrend(y[:, -max(8, int(fs / (math.pi * half))) :])
    turning = np.exp(-2j * math.pi * freq / fs * np.arange(last.shape[1]))
    rest = float(
        np.linalg.norm(2 * np.mean(last * turning, axis=1)) / np.linalg.norm(np.abs(y).max(axis=1))
    )
    if rest > RINGS:
        raise RecordingError(
            "identify: the resonance still rings at the end of the recording, with"
            f" {100 * rest:.0f} % of the"
            " largest sample: too short; record"
            f" {math.ceil(100 * 8 / (2 * math.pi * half)) / 100:g} s more after the sweep, without"
            " hum at that frequency"
        )


def _peak(f: np.ndarray, U: np.ndarray, Y: np.ndarray, inside: np.ndarray) -> tuple[float, float]:
    """Return the frequency of the largest response, and its half-width."""
    if inside.sum() < 4 * BINS:
        raise RecordingError(
            "identify: the sweep misses the band: hardly any of its spectrum lies there; sweep"
            " through it"
        )
    at = np.flatnonzero(inside)
    size = np.sum(np.abs(Y[:, at] / U[:, at]) ** 2, axis=0)
    k = int(np.convolve(size, np.ones(3), "same").argmax())
    above = size < size[k] / 2
    left = int(np.flatnonzero(above[:k])[-1]) if above[:k].any() else 0
    right = k + int(np.flatnonzero(above[k:])[0]) if above[k:].any() else at.size - 1
    if k <= 2 or k >= at.size - 3:
        raise RecordingError(
            f"identify: the response still rises at {f[at[k]]:.4g} Hz, where the sweep or the band"
            " ends, so it misses the resonance; sweep further"
        )
    return float(f[at[k]]), float(max(f[at[right]] - f[at[left]], f[1]) / 2)


def _late(U: np.ndarray, Y: np.ndarray, even: np.ndarray, n: int) -> int:
    """Return by about how many samples the responses are delayed.

    The delay is where their answer to a band-limited impulse is largest.
    """
    spectrum = np.zeros((len(Y), n), complex)
    spectrum[:, np.flatnonzero(even)] = Y[:, even] / U[:, even]
    late = int(np.sum(np.abs(np.fft.ifft(spectrum)) ** 2, axis=0).argmax())
    return late if late < n // 2 else late - n


class _Fit(NamedTuple):
    pole: complex  # rad/s
    cov: np.ndarray  # of its parts
    residues: np.ndarray
    noise: float  # standard deviation of a residue
    dof: int
    delay: float
    cost: float


def _fit(f, U, Y, freq: float, half: float, free: bool) -> _Fit:
    """Fit one pole for all points, and residues and a smooth rest for each.

    ``free`` adds a delay common to all points.

    The variables are the logarithm of the width, the position of the pole in
    half-widths, and the delay in 1/(2 pi half-width).
    """
    w, scale = 2j * math.pi * f, 2 * math.pi * half
    t = (f - freq) / half
    smooth = np.stack([t**k for k in range(BACKGROUND)])

    def pole(v: np.ndarray) -> complex:
        return complex(-math.exp(v[0]) * scale, 2 * math.pi * freq + v[1] * scale)

    def solved(v: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        rest, residues, spread = [], [], 0.0
        model = np.vstack([scale / (w - pole(v)), smooth]) * np.exp(
            -w / scale * (v[2] if free else 0.0)
        )
        for k, y in enumerate(Y):
            A = (model * U[min(k, len(U) - 1)]).T
            Q, R = np.linalg.qr(A)
            c = Q.conj().T @ y
            rest.append(y - Q @ c)
            inverse = np.linalg.inv(R)
            residues.append(scale * (inverse[0] @ c))
            spread = max(spread, scale * float(np.linalg.norm(inverse[0])))
        return np.concatenate(rest), np.array(residues), spread

    size = float(np.linalg.norm(Y))

    def rest(v: np.ndarray) -> np.ndarray:
        r = solved(v)[0] / size
        return np.r_[r.real, r.imag]

    ends = np.array([3.0, 3.0, 2.0])[: 2 + free]
    found = scipy.optimize.least_squares(
        rest, 0 * ends, jac="3-point", bounds=(-ends, ends), xtol=1e-12, ftol=1e-12
    )
    p = pole(found.x)
    dof = 2 * Y.size - ends.size - 2 * (1 + BACKGROUND) * len(Y)
    variance = 2 * found.cost / dof
    by = np.diag([p.real, scale])  # of the pole's parts by what is varied
    cov = by @ np.linalg.inv(found.jac.T @ found.jac)[:2, :2] @ by * variance
    _, residues, spread = solved(found.x)
    delay = float(found.x[2]) / scale if free else 0.0
    return _Fit(
        p, cov, residues, spread * math.sqrt(variance) * size, dof, delay, float(found.cost)
    )


class Drift(NamedTuple):
    """A resonance frequency as a function of temperature, freq + slope (T - at)."""

    at: float  # mean temperature, in degrees
    freq: float  # there, in Hz
    slope: float  # Hz per degree
    freq_sd: float
    slope_sd: float

    def __call__(self, temperature: float) -> float:
        """Return the frequency in Hz at a temperature."""
        return self.freq + self.slope * (temperature - self.at)


@public
@computed
def drift(found: Sequence[Resonance], temperature: ArrayLike) -> Drift:
    """Fit the change of a resonance with temperature.

    A straight line is fitted to the sweeps, weighted by their uncertainties.  Where the
    sweeps scatter about it by more than these, the standard deviations of the line are
    larger by as much (the Birge ratio).  An interval is then that of Student's t, with
    two degrees of freedom less than there are sweeps: of three sweeps, 95 % is 12.7
    standard deviations, not 2.

    Parameters
    ----------
    found : sequence of Resonance
        Of ``identify``, at least three.
    temperature : array_like
        Of each, in any unit of one degree.

    Raises
    ------
    BadValue
        Fewer than three sweeps, or all at one temperature.

    Examples
    --------
    A plate that warms more than its frame is pressed by it, and its resonance falls; so
    let the carrier follow:

    >>> import numpy as np
    >>> from stimlib.plate import Resonance, drift
    >>> one = np.ones(1)
    >>> line = drift(
    ...     [
    ...         Resonance(f, 10.0, 0.01, 0.1, one, one, 0 * one, 99)
    ...         for f in (160.0, 158.0, 156.0)
    ...     ],
    ...     [20.0, 21.0, 22.0],
    ... )
    >>> round(line.slope, 6), round(line(20.5), 6)
    (-2.0, 159.0)
    """
    try:
        T, f = np.asarray(temperature, float), np.array([r.freq for r in found])
    except (TypeError, ValueError, AttributeError):
        raise BadValue(
            f"drift: temperatures {temperature!r:.60} must be numbers, and found a list of what"
            " identify gave"
        ) from None
    w = 1 / np.maximum([r.freq_sd for r in found], 1e-9 * f) ** 2
    if T.shape != f.shape or f.size < 3 or not np.ptp(T) > 0:
        raise BadValue(
            f"drift: {f.size} sweeps at temperatures {T.tolist()!r:.60}; measure at least three, at"
            " two temperatures"
        )
    at = float(w @ T / w.sum())
    spread = float(w @ (T - at) ** 2)
    slope = float(w @ ((T - at) * f)) / spread
    freq = float(w @ f / w.sum())
    wider = max(1.0, float(w @ (f - freq - slope * (T - at)) ** 2) / (f.size - 2)) ** 0.5
    return Drift(at, freq, slope, wider * float(w.sum() ** -0.5), wider * spread**-0.5)
