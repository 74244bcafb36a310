"""Minimax designs: the 3 dB/oct low-pass as parallel modes, and the band-limited FIR differentiator.

Both are best approximations in the sense of Chebyshev: the error reaches its bound, with alternating sign, at one
frequency more than there are free coefficients.  Both are therefore found the same way (Remez): level the error on a
*reference* of that many frequencies, move the reference to the peaks of the error, repeat.  What makes it short is a
first reference that is nearly right: Zolotarev's for the low-pass, the equilibrium density of the bands for the
differentiator.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import BadValue

FloatArray = npt.NDArray[np.float64]

PASS_EDGE = 0.45
"""Upper end of the 3 dB/oct pass band, in units of fs."""

MAX_SECTIONS = 24
"""Most first-order sections of a 3 dB/oct low-pass."""

MAX_SPAN = 1e9
"""Largest fs/f_low of a 3 dB/oct low-pass."""

MIN_TOL_DB = 1e-8
"""Smallest tolerance of a 3 dB/oct low-pass: below it the equal ripple drowns in rounding."""

MAX_ORDER = 8192
"""Highest order of a differentiator."""

MIN_RELATIVE_ERROR = 1e-13
"""Smallest error a differentiator is designed for: with more taps, rounding decides what happens outside the bands."""

_DB = 10 / math.log(10)  # dB per unit of log |H|^2


@contextmanager
def asked_by(name: str) -> Iterator[None]:
    """Errors in here begin with a name that the user knows, instead of that of a function of this file."""
    try:
        yield
    except BadValue as e:
        raise BadValue(f"{name}: {str(e).partition(': ')[2]}") from None


# --- the exchange ---------------------------------------------------------------------------------------------------


def _between(points: FloatArray, low: float, high: float, parts: int) -> FloatArray:
    """Grid on [low, high] that cuts each gap between neighbouring `points` (ascending) into equal parts."""
    margin = 1e-12 * (high - low)
    knots = np.concatenate([[low], points[(points > low + margin) & (points < high - margin)], [high]])
    steps = np.diff(knots)[:, None] * (np.arange(parts) / parts)
    return np.append((knots[:-1, None] + steps).ravel(), high)


def _peaks(x: FloatArray, error: FloatArray) -> FloatArray:
    """Abscissa of the largest |error| in each run of one sign, from a parabola through it and its neighbours."""
    edges = np.flatnonzero((error[1:] < 0) != (error[:-1] < 0)) + 1
    runs = zip([0, *edges], [*edges, len(x)], strict=True)
    top = np.array([first + np.argmax(np.abs(error[first:last])) for first, last in runs])
    inner = (top > 0) & (top < len(x) - 1)
    i = top[inner]
    left = (error[i] - error[i - 1]) / (x[i] - x[i - 1])
    right = (error[i + 1] - error[i]) / (x[i + 1] - x[i])
    bend = (right - left) / (x[i + 1] - x[i - 1])
    bend[bend == 0] = np.inf
    peaks = x[top]
    peaks[inner] = np.clip((x[i - 1] + x[i]) / 2 - left / (2 * bend), x[i - 1], x[i + 1])
    return peaks


def _alternating(error: FloatArray, count: int) -> list[int]:
    """Indices of `count` errors of alternating sign, the largest; fewer if there are no more."""
    kept: list[int] = []
    for i in range(len(error)):
        if not kept or (error[i] < 0) != (error[kept[-1]] < 0):
            kept.append(i)
        elif abs(error[i]) > abs(error[kept[-1]]):
            kept[-1] = i
    while len(kept) > count:
        del kept[0 if abs(error[kept[0]]) < abs(error[kept[-1]]) else -1]
    return kept


# --- 3 dB/oct low-pass ----------------------------------------------------------------------------------------------


class PinkDesign(NamedTuple):
    """A filter as parallel leaky modes, ``q += x - e*q`` and then ``y = d*x + sum(r*q)``.

    Attributes
    ----------
    e : ndarray, shape (n,)
        Leaks, 1 - pole, ascending: the slowest mode first.  Read-only.
    r : ndarray, shape (n,)
        Residues, the weights of the updated states.  Read-only.
    d : float
        Direct gain.
    error_db : float
        Largest deviation of the gain from 3 dB/oct in the pass band, dB.
    """

    e: FloatArray
    r: FloatArray
    d: float
    error_db: float


@lru_cache(maxsize=256)
def pink_modes(fs: float, f_low: float, tol_db: float) -> PinkDesign:
    """3 dB/oct low-pass, |H|^2 = 1/w with w = 2 pi f/fs, with the fewest first-order sections that meet a tolerance.

    Equal-ripple in log magnitude on f_low <= f <= 0.45 fs.  In v = tan^2(w/2) a section with real pole and real zero
    has the gain (v + a)/(v + b), so the bilinear warp is part of the target, 1/(2 atan sqrt v), and the top octave is
    right as well.  Below f_low the gain levels off.

    Parameters
    ----------
    fs : float
        Sample rate, Hz.
    f_low : float
        Lower edge of the pass band, Hz; fs/1e9 to 0.225 fs (an octave below the upper edge).
    tol_db : float
        Largest deviation allowed in the pass band, dB; at least 1e-8.

    Returns
    -------
    PinkDesign
        The filter as parallel modes, ``H(z) = d + sum_k r_k/(1 - (1 - e_k)/z)``.

    Raises
    ------
    BadValue
        If an argument is out of range, or if 24 sections do not meet `tol_db`; the message says what they reach.

    Notes
    -----
    The error of n sections is about ``11 exp(-pi^2 (2n + 1)/(2 log(4/l)))`` dB with l the ratio of tan(w/2) at the
    two edges.  White noise of variance pi S1 through this filter has the one-sided density S1/f.

    References
    ----------
    Paper 000, section 1.1, "3 dB/octave low-pass filter H(s)".
    Zolotarev, E. I. (1877), Mem. Acad. Sci. St. Petersburg 30(5): best rational approximation of the square root.

    Examples
    --------
    >>> from stimlib.design.minimax import pink_modes
    >>> modes = pink_modes(fs=8000, f_low=1, tol_db=0.01)
    >>> len(modes.e), modes.error_db < 0.01
    (8, True)
    """
    if not (math.isfinite(fs) and fs > 0):
        raise BadValue(f"pink_modes: fs = {fs} Hz: the sample rate must be a finite number above 0")
    if not fs / MAX_SPAN <= f_low <= PASS_EDGE / 2 * fs:
        raise BadValue(
            f"pink_modes: f_low = {f_low} Hz: the pass band ends at 0.45 fs and is 3 dB/oct over one octave or more; "
            f"at fs = {fs:g} Hz choose f_low from {fs / MAX_SPAN:g} to {PASS_EDGE / 2 * fs:g} Hz"
        )
    if not MIN_TOL_DB <= tol_db < math.inf:
        raise BadValue(f"pink_modes: tol_db = {tol_db} dB: choose a finite tolerance of at least {MIN_TOL_DB:g} dB")
    w_low = 2 * math.pi * f_low / fs
    n = min(_sections_estimate(w_low, tol_db), MAX_SECTIONS)
    modes = _minimax_modes(w_low, n)
    while modes.error_db > tol_db and n < MAX_SECTIONS:
        n += 1
        modes = _minimax_modes(w_low, n)
    if modes.error_db > tol_db:
        raise BadValue(
            f"pink_modes: tol_db = {tol_db:g} dB from {f_low:g} Hz to 0.45 fs at fs = {fs:g} Hz takes more than "
            f"{MAX_SECTIONS} sections, which reach {modes.error_db:.3g} dB: raise tol_db to that, or raise f_low"
        )
    while n > 1 and (fewer := _minimax_modes(w_low, n - 1)).error_db <= tol_db:
        n, modes = n - 1, fewer
    return modes


def _log_edges(w_low: float) -> tuple[float, float]:
    """log tan(w/2) at both ends of the pass band."""
    return math.log(math.tan(w_low / 2)), math.log(math.tan(math.pi * PASS_EDGE))


def _sections_estimate(w_low: float, tol_db: float) -> int:
    """Sections for a tolerance, from the asymptotic error 11 exp(-pi^2 (2n + 1)/(2 log(4/l))) dB."""
    low, high = _log_edges(w_low)
    n = math.log(max(11 / tol_db, 1.0)) * (math.log(4) + high - low) / math.pi**2 - 0.5
    return max(1, math.ceil(n))


def _agm(a: float, b: float) -> float:
    """Arithmetic-geometric mean."""
    while abs(a - b) > 1e-15 * a:
        a, b = (a + b) / 2, math.sqrt(a * b)
    return a


def _log_elliptic(x: FloatArray, k1: float, sign: int) -> FloatArray:
    """Logarithm of sc(x K) for sign -1 (0 < x < 1) or of nd(x K) for sign +1 (0 <= x <= 1), complementary modulus k1.

    Products over the nome exp(-s), s = pi K/K', of the complementary modulus; they converge fast where the modulus
    itself is close to one, and no close numbers are subtracted::

        log f(x K) = -log(k1)/2 - s (1 - 2x)/4 + sum_j (-1)^j log (1 + sign e^(-s(j + x)))/(1 + sign e^(-s(j + 1 - x)))
    """
    s = math.pi * _agm(1.0, math.sqrt((1 - k1) * (1 + k1))) / _agm(1.0, k1)
    j = np.arange(math.ceil(40 / s) + 1)[:, None]
    above, below = -s * (j + x), -s * (j + 1 - x)
    if sign < 0:
        factors = np.log(-np.expm1(above)) - np.log(-np.expm1(below))
    else:
        factors = np.log1p(np.exp(above)) - np.log1p(np.exp(below))
    return -math.log(k1) / 2 - s * (1 - 2 * x) / 4 + np.sum((1 - 2 * (j % 2)) * factors, axis=0)


def _zolotarev(n: int, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Zolotarev's best approximation of v^(-1/2): log b_1, log a_1, log b_2, ... (2n,), and its reference (2n + 2,)."""
    k1, inside, peaks = math.exp(low - high), np.arange(1, 2 * n + 1), np.arange(2 * n + 2)
    roots = 2 * low + 2 * _log_elliptic(inside / (2 * n + 1), k1, -1)
    return roots, low + _log_elliptic(peaks / (2 * n + 1), k1, +1)


def _log_ripple(design: FloatArray, t: FloatArray) -> FloatArray:
    """log(|H|^2 w) at t = log tan(w/2), of the design (log b_1, log a_1, ..., log b_n, log a_n, log gain)."""
    v, c = np.exp(2 * t)[:, None], np.exp(design[:-1])
    return design[-1] + np.log(np.prod((v + c[1::2]) / (v + c[::2]), axis=1)) + np.log(2 * np.arctan(np.exp(t)))


def _equal_ripple(design: FloatArray, reference: FloatArray) -> FloatArray:
    """The design whose ripple is +E, -E, +E, ... on the reference, by Newton's method for the design and E."""
    v = np.exp(2 * reference)[:, None]
    charge = np.resize([-1.0, 1.0], len(design) - 1)  # of poles and zeros
    sign = np.resize([1.0, -1.0], (len(reference), 1))
    for _ in range(40):
        c = np.exp(design[:-1])
        jacobian = np.hstack([charge * c / (v + c), np.ones_like(sign), sign])
        step = np.linalg.solve(jacobian, -_log_ripple(design, reference))[:-1]
        largest = np.max(np.abs(step[:-1]))
        design = design + step * min(1.0, 0.7 / largest)
        if largest < 1e-6:
            break
    return design


def _minimax_design(w_low: float, n: int) -> tuple[FloatArray, FloatArray]:
    """Equal-ripple design of n sections and its reference (2n + 2,), both as in `_log_ripple`."""
    low, high = _log_edges(w_low)
    roots, reference = _zolotarev(n, low, high)
    design = np.append(roots, -np.mean(_log_ripple(np.append(roots, 0.0), reference)))
    for _ in range(20):
        design = _equal_ripple(design, reference)
        grid = _between(reference, low, high, 8)
        peaks = _peaks(grid, _log_ripple(design, grid))
        ripple = _log_ripple(design, peaks)
        kept = _alternating(ripple, 2 * n + 2)
        if len(kept) < 2 * n + 2:
            break  # nothing but rounding is left
        reference, ripple = peaks[kept], np.abs(ripple[kept])
        if np.max(ripple) - np.min(ripple) < 1e-4 * np.max(ripple) + 1e-14:
            break
    return design, reference


@lru_cache(maxsize=256)
def _minimax_modes(w_low: float, n: int) -> PinkDesign:
    """The best low-pass of n sections, with the error of the modes themselves."""
    design, reference = _minimax_design(w_low, n)
    e, z, gain = _leaks_and_gain(design)
    r, d = _partial_fractions(e, z, gain)
    t = _between(reference, *_log_edges(w_low), 16)
    w = 2 * np.arctan(np.exp(t))
    error_db = float(_DB * np.max(np.abs(np.log(w * np.abs(_response(e, r, d, w)) ** 2))))
    for array in (e, r):
        array.setflags(write=False)
    return PinkDesign(e, r, d, error_db)


def _leaks_and_gain(design: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """1 - pole and 1 - zero of each section, and the gain g of H(z) = g prod (1 - zero/z)/(1 - pole/z)."""
    root = np.exp(design[:-1] / 2)  # (1 - p)/(1 + p) = sqrt b
    leaks = 2 * root / (1 + root)
    e, z = leaks[::2], leaks[1::2]
    e = np.where(np.abs(1 - e) < 1e-8, 1 - 1e-8, e)  # a pole at zero is a delay, which no mode can be
    return e, z, float(np.exp(design[-1] / 2) * np.prod((2 - e) / (2 - z)))


def _partial_fractions(e: FloatArray, z: FloatArray, gain: float) -> tuple[FloatArray, float]:
    """Residues and direct gain, r_k = gain prod_i (p_k - q_i)/(p_k prod_j (p_k - p_j)), from differences of leaks."""
    poles, zeros = 1 - e, 1 - z
    over = e - e[:, None]  # [k, j] = p_k - p_j
    np.fill_diagonal(over, poles)
    r = gain * np.prod((z - e[:, None]) / over, axis=1)
    return r, float(gain * np.prod(zeros / poles))


def _response(e: FloatArray, r: FloatArray, d: float, w: FloatArray) -> npt.NDArray[np.complex128]:
    """H at w rad/sample; exp(iw) - 1 is written so that it keeps its digits at low frequency."""
    z = np.exp(1j * w)[:, None]
    z_less_1 = (2j * np.sin(w / 2) * np.exp(0.5j * w))[:, None]
    return d + np.sum(r * z / (z_less_1 + e), axis=1)


def stationary_covariance(e: npt.ArrayLike) -> FloatArray:
    """Covariance of the states of leaky modes, all driven by one white noise of unit variance, in the steady state.

    Parameters
    ----------
    e : array_like, shape (n,)
        Leaks, 0 < e < 2.

    Returns
    -------
    ndarray, shape (n, n)
        ``P[i, j] = 1/(e_i + e_j - e_i e_j)``, which is 1/(1 - p_i p_j) for the poles p = 1 - e.

    Examples
    --------
    >>> from stimlib.design.minimax import stationary_covariance
    >>> stationary_covariance([0.5, 1.0])
    array([[1.33333333, 1.        ],
           [1.        , 1.        ]])
    """
    e = np.asarray(e, np.float64)
    return 1 / (e[:, None] + e - e[:, None] * e)


def cholesky(a: npt.ArrayLike) -> FloatArray:
    """Lower Cholesky factor, in plain loops: the same bits on every machine, which LAPACK does not promise.

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
    >>> from stimlib.design.minimax import cholesky
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
                raise BadValue(f"cholesky: the leading {i + 1} x {i + 1} block is not positive definite")
    return lower


# --- FIR differentiator ---------------------------------------------------------------------------------------------


class DifferentiatorDesign(NamedTuple):
    """A linear-phase FIR differentiator.

    Attributes
    ----------
    taps : ndarray, shape (order + 1,)
        Impulse response in 1/s, antisymmetric, delay order/2 samples.  Read-only.
    error : float
        Largest error in the pass band, relative to i 2 pi f.
    stop_db : float
        Largest gain in the stop band over the gain at the pass edge, dB; -inf without a stop band.
    """

    taps: FloatArray
    error: float
    stop_db: float


@lru_cache(maxsize=64)
def differentiator_taps(fs: float, passband: float, stopband: float | None, order: int) -> DifferentiatorDesign:
    """Band-limited differentiator: equal-ripple FIR of type III, for d/dt in 1/s with a delay of order/2 samples.

    The response is ``i w fs exp(-i w order/2)`` on [0, passband] and zero on [stopband, fs/2].  The error relative to
    the wanted gain in the pass band, and relative to the gain at the pass edge in the stop band, has one and the same
    bound, the smallest possible.

    Parameters
    ----------
    fs : float
        Sample rate, Hz.
    passband, stopband : float, float or None
        Edges, Hz, 0 < passband < stopband <= fs/2.  None (or fs/2): no stop band.
    order : int
        Number of taps less one; even, 2 to 8192.

    Returns
    -------
    DifferentiatorDesign

    Raises
    ------
    BadValue
        If an argument is out of range.

    Notes
    -----
    Where the order would give an error below 1e-13, fewer taps are used, with zeros on either side.

    References
    ----------
    Paper 000, section 1.1, "FIR of order 128".
    Parks, T. W. & McClellan, J. H. (1972), IEEE Trans. Circuit Theory 19, 189-194.

    Examples
    --------
    >>> from stimlib.design.minimax import differentiator_taps
    >>> d = differentiator_taps(fs=8000, passband=1000, stopband=1500, order=128)
    >>> len(d.taps), d.error < 1e-6, d.stop_db < -110
    (129, True, True)
    """
    w_pass, w_stop = _band_edges("differentiator_taps", fs, passband, stopband)
    if not (2 <= order <= MAX_ORDER and order % 2 == 0):
        raise BadValue(f"differentiator_taps: order = {order}: choose an even number from 2 to {MAX_ORDER}")
    half = int(order) // 2
    if _first_error(half, w_pass, w_stop) < MIN_RELATIVE_ERROR:
        half = min(half, _half_order_estimate(w_pass, w_stop, MIN_RELATIVE_ERROR))
    sines, error, stop_error = _minimax_sines(half, w_pass, w_stop)
    taps = np.zeros(int(order) + 1)
    middle = int(order) // 2
    taps[middle - half : middle] = fs * sines[::-1]
    taps[middle + 1 : middle + 1 + half] = -fs * sines
    taps.setflags(write=False)
    return DifferentiatorDesign(taps, error, 20 * math.log10(stop_error) if stop_error > 0 else -math.inf)


@lru_cache(maxsize=64)
def differentiator_order(fs: float, passband: float, stopband: float | None, tol: float) -> int:
    """Smallest even order for which `differentiator_taps` meets a tolerance.

    Parameters
    ----------
    fs, passband, stopband
        As for `differentiator_taps`.
    tol : float
        Largest relative error in the pass band, 1e-10 to below 1.  The stop band is then at most at 20 log10(tol) dB.

    Returns
    -------
    int

    Raises
    ------
    BadValue
        If an argument is out of range, or if the order would be above 8192.

    Notes
    -----
    Takes a few designs; each is quadratic in the order (0.3 s at order 3000).

    Examples
    --------
    >>> from stimlib.design.minimax import differentiator_order
    >>> differentiator_order(fs=8000, passband=1000, stopband=1500, tol=1e-6)
    122
    """
    w_pass, w_stop = _band_edges("differentiator_order", fs, passband, stopband)
    if not 1e-10 <= tol < 1:
        raise BadValue(f"differentiator_order: tol = {tol}: choose a relative error from 1e-10 to below 1")
    most = MAX_ORDER // 2
    half = _half_order_estimate(w_pass, w_stop, tol)
    too_low, enough = 0 if _first_error(half, w_pass, w_stop) <= tol else most, most + 1
    rate = -math.log(tol) / half  # the error falls like exp(-rate half)
    while enough - too_low > 1:
        error = _exchange(half, w_pass, w_stop).error
        too_low, enough = (too_low, half) if error <= tol else (half, enough)
        step = math.ceil(math.log(max(error, 1e-300) / tol) / rate)
        half = min(max(half + step, too_low + 1), enough - 1)
    if enough > most:
        raise BadValue(
            f"differentiator_order: an error of {tol:g} up to {passband:g} Hz takes an order above {MAX_ORDER} at "
            f"fs = {fs:g} Hz: end the pass band further below {fs / 2 if stopband is None else stopband:g} Hz, "
            "lower fs, or raise tol"
        )
    return 2 * enough


def _band_edges(where: str, fs: float, passband: float, stopband: float | None) -> tuple[float, float | None]:
    """Edges in rad/sample; no stop band at fs/2, where a differentiator of type III is zero anyway."""
    if not (math.isfinite(fs) and fs > 0):
        raise BadValue(f"{where}: fs = {fs} Hz: the sample rate must be a finite number above 0")
    if not 0 < passband < fs / 2:
        raise BadValue(f"{where}: passband = {passband} Hz: choose an edge above 0 and below fs/2 = {fs / 2:g} Hz")
    if stopband is not None and not passband < stopband <= fs / 2:
        raise BadValue(
            f"{where}: stopband = {stopband} Hz: choose an edge above the passband, {passband:g} Hz, and up to fs/2 = "
            f"{fs / 2:g} Hz, or None"
        )
    if stopband is None or stopband == fs / 2:
        return 2 * math.pi * passband / fs, None
    return 2 * math.pi * passband / fs, 2 * math.pi * stopband / fs


def _wanted(w: FloatArray, w_pass: float, w_stop: float | None) -> tuple[FloatArray, FloatArray]:
    """Wanted values and weight of the even factor P in A(w) = sin w P(cos w): weight (P - wanted) is the error."""
    passing = w < (w_pass + (w_stop or math.pi)) / 2
    inside = np.where(passing, w, 0.0)
    wanted = np.where(passing, 1 / np.sinc(inside / np.pi), 0.0)
    return wanted, np.where(passing, np.sinc(inside / np.pi), np.sin(w) / w_pass)


class _Interpolant(NamedTuple):
    """A polynomial in y = sin^2(w/2), by its values on a reference (barycentric form)."""

    y: FloatArray
    weights: FloatArray
    values: FloatArray

    def at(self, w: FloatArray) -> FloatArray:
        """Values at w, in blocks that stay in the cache."""
        values, block = np.empty(len(w)), 1 + 65536 // len(self.y)
        for i in range(0, len(w), block):
            gaps = np.sin(w[i : i + block, None] / 2) ** 2 - self.y
            gaps[gaps == 0] = 1e-200  # on a reference point: its term outweighs all others
            np.reciprocal(gaps, out=gaps)
            values[i : i + block] = (gaps @ (self.weights * self.values)) / (gaps @ self.weights)
        return values


def _barycentric_weights(y: FloatArray) -> FloatArray:
    """1/prod_j (y_i - y_j) up to a common factor, y ascending; as logarithms of products of eight far apart."""
    size, block = np.empty(len(y)), 1 + 65536 // len(y)
    for i in range(0, len(y), block):
        gaps = np.abs(y[i : i + block, None] - y)
        gaps[gaps == 0] = 1.0
        gaps = np.pad(gaps, ((0, 0), (0, -len(y) % 8)), constant_values=1.0)
        size[i : i + block] = -np.sum(np.log(np.prod(gaps.reshape(len(gaps), 8, -1), axis=1)), axis=1)
    return np.exp(size - np.max(size)) * np.resize([1.0, -1.0], len(y))


def _levelled(w: FloatArray, w_pass: float, w_stop: float | None) -> tuple[_Interpolant, float]:
    """The polynomial of degree len(w) - 2 whose error is +E, -E, +E, ... on the reference w, and E."""
    y = np.sin(w / 2) ** 2
    weights = _barycentric_weights(y)
    wanted, weight = _wanted(w, w_pass, w_stop)
    sign = np.resize([1.0, -1.0], len(w))
    level = np.sum(weights * wanted) / np.sum(weights * sign / weight)
    return _Interpolant(y, weights, wanted - sign * level / weight), float(abs(level))


def _first_reference(half: int, w_pass: float, w_stop: float | None) -> FloatArray:
    """half + 1 frequencies spread like equal charges at rest on the pass band and the stop band.

    Peaks of best polynomial approximations on a set of bands settle at this density.  In y = sin^2(w/2) it is
    |y - y0|/sqrt|(y - y_pass)(y - y_stop)| dw/pi, with y0 in the gap such that no force is left across the gap.
    """
    if w_stop is None:
        return 2 * np.arcsin(math.sin(w_pass / 2) * np.sin(np.linspace(0, np.pi / 2, half + 1)))
    phi = np.linspace(0, np.pi / 2, 8 * half + 401)
    y_pass, y_stop = math.sin(w_pass / 2) ** 2, math.sin(w_stop / 2) ** 2
    gap = y_pass + (y_stop - y_pass) * np.sin(phi[:-1] / 2 + phi[1:] / 2) ** 2
    y0 = np.average(gap, weights=1 / np.sqrt(gap * (1 - gap)))

    def charge(edge: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Frequencies from the end of the axis to the band edge, and the charge up to each."""
        w, middle = (end + (edge - end) * np.sin(p) for p in (phi, phi[:-1] / 2 + phi[1:] / 2))
        to_pass, to_stop = (np.sin((middle + b) / 2) * np.sin((middle - b) / 2) for b in (w_pass, w_stop))  # y - y_b
        density = np.abs(to_pass + y_pass - y0) / np.sqrt(np.abs(to_pass * to_stop)) / np.pi
        return w, np.concatenate([[0.0], np.cumsum(density * np.abs(np.diff(w)))])

    (passing, in_pass), (stopping, in_stop) = charge(w_pass, 0.0), charge(w_stop, math.pi)
    share = in_pass[-1] / (in_pass[-1] + in_stop[-1])
    count = min(max(1, round(share * (half + 0.5) + 0.5)), half)  # both band edges are peaks, and so is w = 0
    up = np.arange(count) if count > 1 else np.ones(1)
    down = np.arange(half - count, -1, -1) + 0.5  # sin w makes w = pi a zero
    low = np.interp(up / up[-1] * in_pass[-1], in_pass, passing)
    return np.concatenate([low, np.interp(down / down[0] * in_stop[-1], in_stop, stopping)])


def _first_error(half: int, w_pass: float, w_stop: float | None) -> float:
    """Levelled error on the first reference, a bound from below for the best error and close to it."""
    return _levelled(_first_reference(half, w_pass, w_stop), w_pass, w_stop)[1]


def _half_order_estimate(w_pass: float, w_stop: float | None, tol: float) -> int:
    """Smallest half order whose levelled error on the first reference is at most tol (by bisection)."""
    most = MAX_ORDER // 2
    high = 1
    while high < most and _first_error(high, w_pass, w_stop) > tol:
        high = min(2 * high, most)
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        if _first_error(middle, w_pass, w_stop) > tol:
            low = middle
        else:
            high = middle
    return high


def _error(even: _Interpolant, w: FloatArray, w_pass: float, w_stop: float | None) -> FloatArray:
    """Weighted error of P at w."""
    wanted, weight = _wanted(w, w_pass, w_stop)
    return weight * (even.at(w) - wanted)


class _Exchanged(NamedTuple):
    """Where the exchange ended: the levelled reference, the peaks of the error, and the largest of them."""

    reference: FloatArray
    peaks: FloatArray
    error: float


@lru_cache(maxsize=16)
def _exchange(half: int, w_pass: float, w_stop: float | None) -> _Exchanged:
    """Remez exchange for P of degree half - 1 on both bands, with P as its interpolant on the reference."""
    bands = [(0.0, w_pass)] if w_stop is None else [(0.0, w_pass), (w_stop, math.pi)]
    following = _first_reference(half, w_pass, w_stop)
    for _ in range(20):
        reference = following
        even, level = _levelled(reference, w_pass, w_stop)
        grids = [_between(reference, low, high, max(8, 400 // half)) for low, high in bands]
        grids = [grid[grid < math.pi] for grid in grids]  # A(pi) is zero, whatever the taps
        peaks = np.concatenate([_peaks(grid, _error(even, grid, w_pass, w_stop)) for grid in grids])
        heights = _error(even, peaks, w_pass, w_stop)
        kept = _alternating(heights, half + 1)
        largest = float(np.max(np.abs(heights)))
        if largest < 1.001 * level or level < MIN_RELATIVE_ERROR or len(kept) < half + 1:
            break
        following = peaks[kept]
    return _Exchanged(reference, peaks, largest)


def _minimax_sines(half: int, w_pass: float, w_stop: float | None) -> tuple[FloatArray, float, float]:
    """Coefficients c_k of the best A(w) = 2 sum_k c_k sin(k w), k = 1 ... half, and its errors in both bands.

    Between the bands an interpolant loses the digits that the approximation gains inside.  So the coefficients come
    from the linear system of the last reference: what it leaves undetermined does no harm.
    """
    reference, peaks, _ = _exchange(half, w_pass, w_stop)
    k = np.arange(half)
    wanted, weight = _wanted(reference, w_pass, w_stop)
    sign = np.resize([1.0, -1.0], (half + 1, 1))
    system = np.hstack([np.cos(reference[:, None] * k) * weight[:, None], sign])
    cosines = np.linalg.solve(system, weight * wanted)[:-1]  # the last unknown is the level
    wanted, weight = _wanted(peaks, w_pass, w_stop)
    error = np.abs(weight * (np.cos(peaks[:, None] * k) @ cosines - wanted))
    passing = peaks <= w_pass
    cosines[0] *= 2
    cosines = np.append(cosines, [0.0, 0.0])
    sines = (cosines[:-2] - cosines[2:]) / 4  # sin w cos kw = (sin (k + 1)w - sin (k - 1)w)/2
    return sines, float(np.max(error[passing])), float(np.max(error[~passing], initial=0.0))
