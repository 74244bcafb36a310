"""Physical cues of an interaction, from recorded displacement and force.

A participant may have used any of these cues to answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.graph import unmasked
from ..errors import Above0, BadValue, Upto1, counted, public

SHORTEST = 8  # samples
PERIODS = 2  # of the dominant component
ROUNDING = 1e-14  # of the magnitude of k, of either of its parts


class Cues(NamedTuple):
    """The physical cues of an interaction, in the order of the paper; see ``cues``."""

    frequency: float  # Hz, of the dominant component of y
    k_S: float  # N/m
    k_L: float  # N/m
    loss_factor: float  # k_L/k_S
    eta_as_printed: float  # k_S/k_L
    b_L: float  # N s/m
    phi: float  # rad
    W: float  # J
    f_max: float  # N
    f_mean: float  # N
    y_max: float  # m
    y_mean: float  # m
    v_max: float  # m/s
    v_mean: float  # m/s
    k_I: float  # N/m
    k_fit: float  # N/m
    b_fit: float  # N s/m
    k_peak: float  # N/m


@public
def cues(
    y: ArrayLike,
    f: ArrayLike,
    fs: Above0,
    v: ArrayLike | None = None,
    prominence: Upto1 = 0.1,
    window: Literal["hann", "none"] = "hann",
    single: bool = False,
) -> Cues:
    """Return the physical cues of an interaction from a recording.

    Parameters
    ----------
    y : array_like, shape (n,)
        Displacement in m, compression positive, 0 at the surface of the object.
    f : array_like, shape (n,)
        Force in N, signed so that the force of a spring is positive where y is.
    fs : float
        Sample rate in Hz.
    v : array_like, shape (n,), optional
        Velocity in m/s.  Default: central differences of y; a displacement with steps
        or noise should be smoothed before, or its velocity given here.
    prominence : float
        A maximum counts as a peak when it rises above its surroundings by this part of
        its signal's range.
    window : {"hann", "none"}
        Weights of the samples in the amplitudes of the component.  "none" is the method
        of the paper: for a whole number of periods it gives the bin of a DFT.
    single : bool
        A movement without a period, such as one press: the cues of a frequency are nan,
        and the others as always.

    Returns
    -------
    Cues
        For the component of y and f at the frequency of the dominant component of y,
        with phase relative to y:

        - ``frequency``: of that component, in Hz
        - ``k_S``, ``k_L``: real (storage) and imaginary (loss) part of the complex
          stiffness f/y, N/m
        - ``loss_factor``: k_L/k_S, the usual definition; ``eta_as_printed``: k_S/k_L,
          as the paper prints it
        - ``b_L``: imaginary part of the force over the magnitude of the velocity,
          k_L/w, N s/m.  The paper calls it the imaginary part of the mechanical
          impedance; that has displacement as the reference of phase.  In the usual
          convention f/v it is the real part
        - ``phi``: phase by which force leads displacement, rad

        For the whole record:

        - ``W``: positive part of the work done by the participant, the integral of
          max(f v, 0), J
        - ``f_max``, ``f_mean``: largest and mean of the force peaks, N; ``y_max``,
          ``y_mean``, m, and ``v_max``, ``v_mean``, m/s, in the same way.  Peaks are
          maxima; nan if there are none
        - ``k_I``: first force peak over the displacement at that sample, N/m
        - ``k_fit``, ``b_fit``: slope of the line through 0 fitted to force over
          displacement (N/m), over velocity (N s/m)
        - ``k_peak``: largest force over largest displacement of the record, N/m. It is
          not among the cues of section 3.8; chapter 1 of the thesis names it as the
          likely reason why a delay changes the perceived stiffness

    Raises
    ------
    BadValue
        Records of unequal length, not one-dimensional, not finite, of fewer than 8
        samples; no movement; fewer than two periods of the dominant component, unless
        ``single``; fs not above 0; prominence not in 0 .. 1; an unknown window.

    Notes
    -----
    A record rarely holds a whole number of periods, and the bins of a DFT would then
    leak.  The largest bin only starts the search: the frequency is that of the sinusoid
    plus constant which fits y best, and the amplitudes of y and f are those of the best
    fit at that frequency, both by least squares under the window.  This is exact, to
    rounding, for a sinusoid plus constant of any length from two periods on.  The
    windows differ when the record contains other components. The Hann window suppresses
    these, and gives little weight to the ends, where the force of a springpot still
    carries the transient of the movement's start; "none" weights all samples equally,
    as the DFT of the paper does.

    Squares and products are taken of records that are scaled by powers of 2, so a cue
    is infinite, or 0, only where float64 cannot hold the cue itself.

    References
    ----------
    Çaldıran's thesis, section 3.8.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis import cues
    >>> t = np.arange(5432) / 1000
    >>> y = 0.01 + 0.01 * np.sin(2 * np.pi * t)
    >>> f = 300 * y + 5 * 0.01 * 2 * np.pi * np.cos(
    ...     2 * np.pi * t
    ... )  # a spring and a damper
    >>> c = cues(y, f, fs=1000)
    >>> round(c.k_S, 6), round(c.b_L, 6), round(c.loss_factor, 6)
    (300.0, 5.0, 0.10472)
    """
    return _prepared(y, fs, v, prominence, window, single)(f)


@public
def cues_of(
    y: ArrayLike,
    fs: Above0,
    v: ArrayLike | None = None,
    prominence: Upto1 = 0.1,
    window: Literal["hann", "none"] = "hann",
    single: bool = False,
) -> Callable[[ArrayLike], Cues]:
    """Prepare the computation of ``cues`` for one displacement and many forces.

    Everything that depends on the displacement alone is computed only once.

    Parameters
    ----------
    y, fs, v, prominence, window, single
        As ``cues``.

    Returns
    -------
    callable
        A function that returns the ``Cues`` of a force in N, shape (n,).  It takes a
        twentieth of the time of ``cues``, and its results are bit-identical.

    Raises
    ------
    BadValue
        As ``cues``, which checks the displacement before the force.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis import cues_of
    >>> y = 0.01 + 0.01 * np.sin(2 * np.pi * np.arange(4000) / 1000)
    >>> of = cues_of(y, fs=1000)
    >>> [round(of(k * y).k_S, 6) for k in (300, 600)]
    [300.0, 600.0]
    """
    return _prepared(y, fs, v, prominence, window, single)


def _prepared(
    y: ArrayLike, fs: float, v: ArrayLike | None, prominence: float, window: str, single: bool
) -> Callable[[ArrayLike], Cues]:
    """Return a function that computes the cues of forces, with what is known of y."""
    pos, up = _scaled(_record("y", y))
    rate, fast = _scaled(_record("v", v) if v is not None else np.gradient(pos, 1 / fs))
    fast += up if v is None else 0
    if rate.size != pos.size:
        raise BadValue(f"cues: y has {counted(pos.size, 'sample')} and v has {rate.size}")
    if np.ptp(pos) <= 1e-12 * np.abs(pos).max():
        raise BadValue("cues: y does not move")
    w, stiffness = (
        (math.nan, lambda force: complex(math.nan, math.nan))
        if single
        else _component(pos, fs, window)
    )
    y_peaks, v_peaks = (
        _times(_mean_of(pos, prominence), up),
        _times(_mean_of(rate, prominence), fast),
    )
    y_power, v_power = float(np.sum(pos * pos)), float(np.sum(rate * rate))

    def of(f: ArrayLike) -> Cues:
        force, hard = _scaled(_record("f", f))
        if force.size != pos.size:
            raise BadValue(f"cues: y has {counted(pos.size, 'sample')} and f has {force.size}")
        k = stiffness(force)
        # a spring has no damping, not that of rounding, which differs between releases
        k = complex(*(0.0 if abs(v) <= ROUNDING * abs(k) else v for v in (k.real, k.imag)))
        k_S, k_L = _times([k.real, k.imag], hard - up)
        first = _peaks(force, prominence)[:1]
        (f_max, f_mean), (y_max, y_mean), (v_max, v_mean) = (
            _times(_mean_of(force, prominence), hard),
            y_peaks,
            v_peaks,
        )
        return Cues(
            frequency=w / (2 * math.pi),
            k_S=k_S,
            k_L=k_L,
            loss_factor=_over(k.imag, k.real),
            eta_as_printed=_over(k.real, k.imag),
            b_L=k_L / w,
            phi=math.atan2(k.imag, k.real),
            W=_times(np.trapezoid(np.maximum(force * rate, 0.0)) / fs, hard + fast),
            f_max=f_max,
            f_mean=f_mean,
            y_max=y_max,
            y_mean=y_mean,
            v_max=v_max,
            v_mean=v_mean,
            k_I=_times(_over(force[first[0]], pos[first[0]]), hard - up)
            if first.size
            else math.nan,
            k_fit=_times(_over(np.sum(force * pos), y_power), hard - up),
            b_fit=_times(_over(np.sum(force * rate), v_power), hard - fast),
            k_peak=_times(_over(force.max(), pos.max()), hard - up),
        )

    return of


def _component(
    pos: np.ndarray, fs: float, window: str
) -> tuple[float, Callable[[np.ndarray], complex]]:
    """Return the dominant frequency of y in rad/s, and the complex stiffness there.

    The stiffness is a function of the force.
    """
    # a Hann window none of whose samples is 0
    hann = np.sin(np.pi * (np.arange(pos.size) + 0.5) / pos.size) ** 2
    weights = hann if window == "hann" else np.ones(pos.size)
    w = _frequency(pos, fs, weights)
    periods = w * pos.size / (2 * math.pi * fs)
    if periods < PERIODS * (1 - 1e-6):
        raise BadValue(
            f"cues: the record holds {periods:.2f} periods of its dominant component,"
            f" {w / (2 * math.pi):.3g} Hz; at least {PERIODS} are needed, or single=True for a"
            " movement without a period"
        )
    fit = _fit(w / fs, weights)
    moved = _amplitude(fit, pos)
    return w, lambda force: _amplitude(fit, force) / moved


def _record(name: str, a: ArrayLike) -> np.ndarray:
    a = unmasked(a)
    if a.ndim != 1:
        raise BadValue(f"cues: {name} must be one row of samples, got shape {a.shape}")
    if a.size < SHORTEST:
        raise BadValue(
            f"cues: {name} has {counted(a.size, 'sample')}, at least {SHORTEST} are needed"
        )
    if not np.isfinite(a).all():
        raise BadValue(f"cues: {name}[{int(np.argmin(np.isfinite(a)))}] is not finite")
    return a


def _scaled(a: np.ndarray) -> tuple[np.ndarray, int]:
    """Return a record over a power of 2, at most 1, and the power."""
    power = int(np.frexp(np.abs(a).max())[1])
    return np.ldexp(a, -power), power


def _times(v: Any, power: int) -> Any:
    """Return numbers times a power of 2."""
    with np.errstate(all="ignore"):
        return np.ldexp(v, power).tolist()


def _over(a: float, b: float) -> float:
    """Return the quotient a/b; where b is 0, return inf or nan."""
    with np.errstate(all="ignore"):
        return float(np.float64(a) / np.float64(b))


def _waves(angle: float, window: np.ndarray) -> np.ndarray:
    """Return cosine, sine and constant at a frequency in rad per sample, windowed.

    Angles are measured from the middle of the record; each wave is multiplied by the
    square root of the window.
    """
    n = window.size
    phase = angle * (np.arange(n) - (n - 1) / 2)
    return np.stack([np.cos(phase), np.sin(phase), np.ones(n)], axis=1) * np.sqrt(window)[:, None]


def _fit(angle: float, window: np.ndarray) -> np.ndarray:
    """Return the two weight vectors that give the best-fit cosine and sine amplitudes.

    The sums of their products with a record, shape (2, n), are the amplitudes of cosine
    and sine at a frequency in rad per sample.

    Sums are taken by numpy, not by a linear algebra library, so the bits do not depend
    on the number of threads.
    """
    return np.linalg.pinv(_waves(angle, window))[:2] * np.sqrt(window)


def _amplitude(fit: np.ndarray, record: np.ndarray) -> complex:
    """Return the complex amplitude A of the best fit Re(A exp(i phase)) + constant."""
    c = np.sum(fit * record, axis=1)
    return complex(c[0], -c[1])


def _frequency(y: np.ndarray, fs: float, window: np.ndarray) -> float:
    """Return the frequency w in rad/s of the best-fitting sinusoid plus constant.

    The Gauss-Newton method starts at the largest bin of a DFT.
    """
    n = y.size
    z = (y - np.sum(window * y) / np.sum(window)) / np.ptp(y)
    size = 8 << (n - 1).bit_length()
    heights = np.abs(np.fft.rfft(window * z, size))
    lowest = -(-size // n)  # one period
    start = 2 * np.pi * (lowest + int(np.argmax(heights[lowest:]))) / size
    bin_, angle = 2 * np.pi / n, start
    target = z * np.sqrt(window)
    sample = np.arange(n) - (n - 1) / 2
    for _ in range(50):
        waves = _waves(angle, window)
        a, b, _ = np.linalg.lstsq(waves, target, rcond=None)[0]
        slope = (b * waves[:, 0] - a * waves[:, 1]) * sample * bin_
        step = np.linalg.lstsq(np.column_stack([waves, slope]), target, rcond=None)[0][3]
        before, angle = (
            angle,
            float(np.clip(angle + step * bin_, start - 0.5 * bin_, start + 0.5 * bin_)),
        )
        if abs(angle - before) <= 1e-13 * bin_:
            break
    return angle * fs


def _mean_of(a: np.ndarray, prominence: float) -> tuple[float, float]:
    """Return the largest and the mean of the peaks; nan if there are none."""
    at = _peaks(a, prominence)
    return (float(a[at].max()), float(a[at].mean())) if at.size else (math.nan, math.nan)


def _peaks(a: np.ndarray, prominence: float) -> np.ndarray:
    """Return the indices of maxima that are prominent enough to count as peaks."""
    from scipy.signal import find_peaks

    span = np.ptp(a)
    return find_peaks(a, prominence=prominence * span)[0] if span > 0 else np.zeros(0, int)
