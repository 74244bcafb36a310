"""Noise design: octaves over position, and the 3 dB/oct low-pass."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import BadValue
from ..system.linear_algebra import one_thread
from .filters import FloatArray, alternating, between, peaks_of

# A power law over place as a sum of octaves -----------------------------------------
# A power law over place as a sum of octaves, each with the spectrum of a random spline.
FINEST = 0.2
"""Cell of the finest octave, in shortest wavelengths."""

COARSEST = 0.5
"""Least cell of the coarsest octave, in longest wavelengths."""

POINTS = 600


class Octaves(NamedTuple):
    """Octaves of random splines whose spectra add up to a power law.

    Attributes
    ----------
    cells : ndarray, shape (n,)
        Length of a cell of each, doubled from one to the next.
    power : ndarray, shape (n,)
        a^2 of each: variance of its lattice values.
    error_db : float
        Largest deviation from the law between its ends, dB.
    """

    cells: FloatArray
    power: FloatArray
    error_db: float


def band_power(slope: float, low: float, high: float) -> float:
    """Return the integral of f^-slope from low to high.

    Examples
    --------
    >>> from stimlib.design.noise import band_power
    >>> band_power(2.0, 1.0, 4.0)
    0.75
    """
    ratio, rest = math.log(high / low), 1 - slope
    return low**rest * (math.expm1(rest * ratio) / rest if rest else ratio)


@lru_cache(maxsize=64)
def octaves(slope: float, low: float, high: float) -> Octaves:
    """Return octaves whose spectra add up to C f^-slope from low to high.

    The one-sided spectra are 2 a^2 D sinc^6(f D), and C makes the power between low and
    high 1.

    D is the length of a cell, and sinc(x) = sin(pi x)/(pi x): this is the spectrum of
    independent lattice values of variance a^2 under quadratic B-splines. The a^2 are
    the non-negative least-squares fit of the relative error.

    Parameters
    ----------
    slope : float
    low, high : float
        Ends of the law in cycles per unit of length.

    Returns
    -------
    Octaves

    References
    ----------
    Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal
    Processing Magazine 1999 (B-splines and their transforms); Lawson and Hanson,
    "Solving Least Squares Problems", 1974, chapter 23 (non-negative least squares).

    Examples
    --------
    >>> from stimlib.design.noise import octaves
    >>> found = octaves(1.0, 5.0, 5e4)
    >>> found.cells.size, round(found.error_db, 2)
    (16, 0.03)
    """
    from scipy.optimize import nnls

    n = math.ceil(math.log2(COARSEST / low * high / FINEST)) + 1
    cells = np.ldexp(FINEST / high, np.arange(n))
    f = np.geomspace(low, high, POINTS)
    # of a^2 D = 1, relative to the law of C = 1
    spectra = 2 * np.sinc(f[:, None] * cells) ** 6 * f[:, None] ** slope
    # no last bits of a solver
    found = np.array([float(f"{v:.9g}") for v in nnls(spectra, np.ones(POINTS))[0]])
    power = found / cells / band_power(slope, low, high)
    cells.flags.writeable = power.flags.writeable = False
    return Octaves(cells, power, float(np.abs(10 * np.log10(spectra @ found)).max()))


# Filters of constant slope as parallel modes ----------------------------------------
# Filters with a spectrum w^-slope, of which the 3 dB/oct low-pass is one, as parallel
# modes, minimax in dB, and the steady state of such modes under white noise.
PASS_EDGE = 0.45
"""Upper end of the band of constant slope, in units of fs."""

MAX_SECTIONS = 24
"""Most first-order sections of a filter of constant slope."""

MAX_SPAN = 1e9
"""Largest fs/f_low of a filter of constant slope."""

MIN_TOL_DB = 1e-8
"""Smallest tolerance of a 3 dB/oct low-pass: below it the equal ripple drowns in
rounding.
"""

MAX_SLOPE = 3.0
"""Steepest slope of the power spectrum, as an exponent of 1/f."""

_DB = 10 / math.log(10)  # dB per unit of log |H|^2


class NoiseDesign(NamedTuple):
    """A filter as parallel leaky modes, ``q += x - e*q``; ``y = d*x + sum(r*q)``.

    Attributes
    ----------
    e : ndarray, shape (n,)
        Leaks, 1 - pole, ascending: the slowest mode first.  Read-only.
    r : ndarray, shape (n,)
        Residues, the weights of the updated states.  Read-only.
    d : float
        Direct gain.
    error_db : float
        Largest deviation of the gain from the slope in the pass band, dB.
    """

    e: FloatArray
    r: FloatArray
    d: float
    error_db: float


@lru_cache(maxsize=256)
@one_thread()
def noise_modes(fs: float, f_low: float, tol_db: float, slope: float = 1.0) -> NoiseDesign:
    """Design a filter of constant slope with the fewest sections that meet a tolerance.

    |H|^2 = w^-slope with w = 2 pi f/fs; the sections are of first order.

    The error is equal-ripple in log magnitude on f_low <= f <= 0.45 fs. In v =
    tan^2(w/2) a section with real pole and real zero has the gain (v + a)/(v + b), so
    the bilinear warp is part of the target, (2 atan sqrt v)^-slope, and the top octave
    is accurate as well. Below f_low the gain levels off.

    Parameters
    ----------
    fs : float
        Sample rate, Hz.
    f_low : float
        Lower edge of the pass band, Hz; fs/1e9 to 0.225 fs (an octave below the upper
        edge).
    tol_db : float
        Largest deviation allowed in the pass band, dB; at least 1e-8.
    slope : float
        Exponent of 1/f in the power spectrum, -3 to 3 and not 0: 1 for 3 dB/oct. From
        1.5 on, two filters of about half the slope are cascaded.

    Returns
    -------
    NoiseDesign
        The filter as parallel modes, ``H(z) = d + sum_k r_k/(1 - (1 - e_k)/z)``.

    Raises
    ------
    BadValue
        If an argument is out of range, or if 24 sections do not meet `tol_db`; the
        message has what they reach.

    Notes
    -----
    The error of n sections at slope 1 is about ``11 exp(-pi^2 (2n + 1)/(2 log(4/l)))``
    dB with l the ratio of tan(w/2) at the two edges.  White noise of variance pi S1
    through this filter has the one-sided density S1/f.

    References
    ----------
    The UGrip paper, section 1.1, "3 dB/octave low-pass filter H(s)".
    Zolotarev, E. I. (1877), Mem. Acad. Sci. St. Petersburg 30(5): best rational
    approximation of the square root.

    Examples
    --------
    >>> from stimlib.design.noise import noise_modes
    >>> modes = noise_modes(fs=8000, f_low=1, tol_db=0.01)
    >>> len(modes.e), modes.error_db < 0.01
    (8, True)
    """
    if not (math.isfinite(fs) and fs > 0):
        raise BadValue(
            f"noise_modes: fs = {fs} Hz: the sample rate must be a finite number above 0"
        )
    if not fs / MAX_SPAN <= f_low <= PASS_EDGE / 2 * fs:
        raise BadValue(
            f"noise_modes: f_low = {f_low} Hz: the pass band ends at 0.45 fs and has a constant"
            f" slope over one octave or more; at fs = {fs:g} Hz choose f_low from"
            f" {fs / MAX_SPAN:g} to {PASS_EDGE / 2 * fs:g} Hz"
        )
    if not MIN_TOL_DB <= tol_db < math.inf:
        raise BadValue(
            f"noise_modes: tol_db = {tol_db} dB: choose a finite tolerance of at least"
            f" {MIN_TOL_DB:g} dB"
        )
    if not (abs(slope) <= MAX_SLOPE and slope):
        raise BadValue(
            f"noise_modes: slope = {slope}: choose an exponent of 1/f from {-MAX_SLOPE:g} to"
            f" {MAX_SLOPE:g}; for 0, take white noise"
        )
    w_low = 2 * math.pi * f_low / fs
    n = min(_sections_estimate(w_low, tol_db), MAX_SECTIONS) if slope == 1 else 1
    modes = _minimax_modes(w_low, n, slope)
    while modes.error_db > tol_db and n < MAX_SECTIONS:
        n += 1
        modes = min(modes, _minimax_modes(w_low, n, slope), key=lambda m: m.error_db)
    if modes.error_db > tol_db:
        raise BadValue(
            f"noise_modes: tol_db = {tol_db:g} dB from {f_low:g} Hz to 0.45 fs at fs = {fs:g} Hz"
            f" takes more than {MAX_SECTIONS} sections, which reach {1.01 * modes.error_db:.3g} dB:"
            " raise tol_db to that, or raise f_low"
        )
    while n > 1 and (fewer := _minimax_modes(w_low, n - 1, slope)).error_db <= tol_db:
        n, modes = n - 1, fewer
    return modes


def _log_edges(w_low: float) -> tuple[float, float]:
    """Return log tan(w/2) at both ends of the pass band."""
    return math.log(math.tan(w_low / 2)), math.log(math.tan(math.pi * PASS_EDGE))


def _sections_estimate(w_low: float, tol_db: float) -> int:
    """Return an estimate of the number of sections for a tolerance.

    It follows from the asymptotic error 11 exp(-pi^2 (2n + 1)/(2 log(4/l))) dB.
    """
    low, high = _log_edges(w_low)
    n = math.log(max(11 / tol_db, 1.0)) * (math.log(4) + high - low) / math.pi**2 - 0.5
    return max(1, math.ceil(n))


def _agm(a: float, b: float) -> float:
    """Return the arithmetic-geometric mean."""
    while abs(a - b) > 1e-15 * a:
        a, b = (a + b) / 2, math.sqrt(a * b)
    return a


def _log_elliptic(x: FloatArray, k1: float, sign: int) -> FloatArray:
    """Return the logarithm of an elliptic function, sc(x K) or nd(x K).

    The complementary modulus is k1. Sign -1 gives sc (0 < x < 1), +1 nd (0 <= x <= 1).

    Products over the nome exp(-s), s = pi K/K', of the complementary modulus; they
    converge fast where the modulus itself is close to one, and no close numbers are
    subtracted::

        log f(x K) = -log(k1)/2 - s (1 - 2x)/4
            + sum_j (-1)^j log (1 + sign e^(-s(j + x)))/(1 + sign e^(-s(j + 1 - x)))
    """
    s = math.pi * _agm(1.0, math.sqrt((1 - k1) * (1 + k1))) / _agm(1.0, k1)
    j = np.arange(math.ceil(40 / s) + 1)[:, None]
    above, below = -s * (j + x), -s * (j + 1 - x)
    factors = (
        np.log(-np.expm1(above)) - np.log(-np.expm1(below))
        if sign < 0
        else np.log1p(np.exp(above)) - np.log1p(np.exp(below))
    )
    return -math.log(k1) / 2 - s * (1 - 2 * x) / 4 + np.sum((1 - 2 * (j % 2)) * factors, axis=0)


def _zolotarev(n: int, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Return Zolotarev's best approximation of v^(-1/2), and its reference.

    The approximation is log b_1, log a_1, log b_2, ... (2n,), the reference (2n + 2,).
    """
    k1, inside, peaks = math.exp(low - high), np.arange(1, 2 * n + 1), np.arange(2 * n + 2)
    roots = 2 * low + 2 * _log_elliptic(inside / (2 * n + 1), k1, -1)
    return roots, low + _log_elliptic(peaks / (2 * n + 1), k1, +1)


def _log_ripple(design: FloatArray, t: FloatArray, slope: float = 1.0) -> FloatArray:
    """Return the ripple log(|H|^2 w^slope) of a design at t = log tan(w/2).

    The design is (log b_1, log a_1, ..., log b_n, log a_n, log gain).
    """
    v, c = np.exp(2 * t)[:, None], np.exp(design[:-1])
    return (
        design[-1]
        + np.log(np.prod((v + c[1::2]) / (v + c[::2]), axis=1))
        + slope * np.log(2 * np.arctan(np.exp(t)))
    )


def _equal_ripple(design: FloatArray, reference: FloatArray, slope: float) -> FloatArray:
    """Return the design whose ripple is +E, -E, +E, ... on the reference, by Newton."""
    v = np.exp(2 * reference)[:, None]
    charge = np.resize([-1.0, 1.0], len(design) - 1)  # of poles and zeros
    sign = np.resize([1.0, -1.0], (len(reference), 1))
    for _ in range(40):
        c = np.exp(design[:-1])
        jacobian = np.hstack([charge * c / (v + c), np.ones_like(sign), sign])
        try:
            step = np.linalg.solve(jacobian, -_log_ripple(design, reference, slope))[:-1]
        except np.linalg.LinAlgError:  # two sections are the same: nothing but rounding is left
            break
        largest = np.max(np.abs(step[:-1]))
        design = design + step * min(1.0, 0.7 / largest)
        if largest < 1e-6:
            break
    return design


def _minimax_design(w_low: float, n: int, slope: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return the equal-ripple design of n sections, and its reference (2n + 2,).

    The form of both is that of `_log_ripple`. From Zolotarev's solution of slope 1 the
    slope changes in steps; at each the distances of poles and zeros grow with it.
    """
    low, high = _log_edges(w_low)
    roots, reference = _zolotarev(n, low, high)
    design = np.append(roots, -np.mean(_log_ripple(np.append(roots, 0.0), reference)))
    last = 1.0
    for now in np.linspace(1.0, slope, 1 + math.ceil(abs(slope - 1) / 0.2)).tolist():
        wider = (now / last - 1) / 2 * (design[1:-1:2] - design[:-1:2])
        design[:-1:2] -= wider
        design[1:-1:2] += wider
        design, reference = _exchanged(design, reference, now, low, high)
        last = now
    return design, reference


def _exchanged(
    design: FloatArray, reference: FloatArray, slope: float, low: float, high: float
) -> tuple[FloatArray, FloatArray]:
    """Return the equal-ripple design and its reference, by Remez's exchange."""
    for _ in range(20):
        design = _equal_ripple(design, reference, slope)
        grid = between(reference, low, high, 8)
        peaks = peaks_of(grid, _log_ripple(design, grid, slope))
        ripple = _log_ripple(design, peaks, slope)
        kept = alternating(ripple, len(reference))
        if len(kept) < len(reference):
            break  # nothing but rounding is left
        reference, ripple = peaks[kept], np.abs(ripple[kept])
        if np.max(ripple) - np.min(ripple) < 1e-4 * np.max(ripple) + 1e-14:
            break
    return design, reference


STEEPEST = 1.5
"""Steepest slope of one design; a steeper noise filter is two designs in cascade."""


@lru_cache(maxsize=256)
def _minimax_modes(w_low: float, n: int, slope: float = 1.0) -> NoiseDesign:
    """Return the best filter of n sections, with the error of its modes.

    A rising slope is the inverse of a falling one: poles and zeros change places. Two
    filters in cascade have different slopes, so that no pole is double.
    """
    parts = [(1.0, n)] if abs(slope) <= STEEPEST else [(0.45, n // 2), (0.55, n - n // 2)]
    found = [_minimax_design(w_low, k, abs(slope) * part) for part, k in parts if k]
    each = [_leaks_and_gain(design) for design, _ in found]
    e, z = (np.concatenate([one[i] for one in each]) for i in (0, 1))
    gain = math.prod(one[2] for one in each)
    if slope < 0:
        e, z, gain = z, e, 1 / gain
    rising = np.argsort(e)
    e, z = e[rising], z[rising]
    r, d = _partial_fractions(e, z, gain)
    roots = np.array(sorted({x for _, r in found for x in r.tolist()}))
    t = between(roots, *_log_edges(w_low), 16)
    w = 2 * np.arctan(np.exp(t))
    level = np.log(w**slope * np.abs(_response(e, r, d, w)) ** 2)
    error_db = float(_DB * np.max(np.abs(level)))
    e.flags.writeable = r.flags.writeable = False
    return NoiseDesign(e, r, d, error_db)


def _leaks_and_gain(design: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return 1 - pole and 1 - zero of each section, and the gain g.

    H(z) = g prod (1 - zero/z)/(1 - pole/z).
    """
    root = np.exp(design[:-1] / 2)  # (1 - p)/(1 + p) = sqrt b
    leaks = 2 * root / (1 + root)
    e, z = leaks[::2], leaks[1::2]
    # a pole at zero is a delay, which no mode can be
    e = np.where(np.abs(1 - e) < 1e-8, 1 - 1e-8, e)
    return e, z, float(np.exp(design[-1] / 2) * np.prod((2 - e) / (2 - z)))


def _partial_fractions(e: FloatArray, z: FloatArray, gain: float) -> tuple[FloatArray, float]:
    """Return residues and direct gain, computed from differences of leaks.

    r_k = gain prod_i (p_k - q_i)/(p_k prod_j (p_k - p_j)).
    """
    poles, zeros = 1 - e, 1 - z
    over = e - e[:, None]  # [k, j] = p_k - p_j
    np.fill_diagonal(over, poles)
    r = gain * np.prod((z - e[:, None]) / over, axis=1)
    return r, float(gain * np.prod(zeros / poles))


def _response(e: FloatArray, r: FloatArray, d: float, w: FloatArray) -> npt.NDArray[np.complex128]:
    """Return the response H at w rad/sample.

    exp(iw) - 1 is computed so that it keeps its digits at low frequency.
    """
    z = np.exp(1j * w)[:, None]
    z_less_1 = (2j * np.sin(w / 2) * np.exp(0.5j * w))[:, None]
    return d + np.sum(r * z / (z_less_1 + e), axis=1)


def stationary_covariance(e: npt.ArrayLike) -> FloatArray:
    """Return the steady-state covariance of leaky modes driven by one white noise.

    The noise has unit variance.

    Parameters
    ----------
    e : array_like, shape (n,)
        Leaks, 0 < e < 2.

    Returns
    -------
    ndarray, shape (n, n)
        ``P[i, j] = 1/(e_i + e_j - e_i e_j)``, which is 1/(1 - p_i p_j) for the poles p
        = 1 - e.

    Examples
    --------
    >>> from stimlib.design.noise import stationary_covariance
    >>> stationary_covariance([0.5, 1.0])
    array([[1.33333333, 1.        ],
           [1.        , 1.        ]])
    """
    e = np.asarray(e, np.float64)
    return 1 / (e[:, None] + e - e[:, None] * e)


def cholesky(a: npt.ArrayLike) -> FloatArray:
    """Return the lower Cholesky factor, computed by plain loops.

    So it has the same bits on every machine, which LAPACK does not guarantee.

    Parameters
    ----------
    a : array_like, shape (n, n)
        Symmetric positive definite; only the lower triangle is read.

    Returns
    -------
    ndarray, shape (n, n)
        Lower triangular L with L L' = a.

    Raises
    ------
    BadValue
        If `a` is not positive definite to working precision.

    Examples
    --------
    >>> from stimlib.design.noise import cholesky
    >>> cholesky([[4.0, 2.0], [2.0, 2.0]])
    array([[2., 0.],
           [1., 1.]])
    """
    a = np.asarray(a, np.float64)
    lower = np.zeros_like(a)
    for i in range(len(a)):
        for j in range(i + 1):
            rest = math.fsum([a[i, j], *(-lower[i, :j] * lower[j, :j])])
            if i > j:
                lower[i, j] = rest / lower[j, j]
            elif rest > 0:
                lower[i, i] = math.sqrt(rest)
            else:
                raise BadValue(
                    f"cholesky: the leading {i + 1} x {i + 1} block is not positive definite"
                )
    return lower


@lru_cache(maxsize=256)
def stationary_factor(leaks: bytes) -> tuple[tuple[float, ...], ...]:
    """Return the rows of the lower Cholesky factor of ``stationary_covariance``.

    Each row ends at its diagonal element.

    Parameters
    ----------
    leaks : bytes
        Those of the leaks, float64.

    Returns
    -------
    tuple of tuple of float
        Row i has i + 1 numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.design.noise import stationary_factor
    >>> [
    ...     [round(v, 3) for v in row]
    ...     for row in stationary_factor(np.array([0.5, 1.0]).tobytes())
    ... ]
    [[1.155], [0.866, 0.5]]
    """
    lower = cholesky(stationary_covariance(np.frombuffer(leaks)))
    return tuple(tuple(row[: i + 1]) for i, row in enumerate(lower.tolist()))
