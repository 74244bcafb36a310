"""Filter design: minimax fits, the differentiator, sections, resampling."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import BadValue
from ..system.limits import limits
from ..system.linear_algebra import one_thread

# Best approximations in the sense of Chebyshev --------------------------------------
# Best approximations in the sense of Chebyshev: what the designs of ``pink`` and
# ``differentiator`` have in common.
#
# The error reaches its bound, with alternating sign, at one frequency more than there
# are free coefficients. Both designs are found the same way (Remez): level the error on
# a *reference* of that many frequencies, move the reference to the peaks of the error,
# repeat. What makes it short is a first reference that is nearly right: Zolotarev's for
# the low-pass, the equilibrium density of the bands for the differentiator.
FloatArray = npt.NDArray[np.float64]


@contextmanager
def asked_by(name: str) -> Iterator[None]:
    """Rename errors raised in this context to start with the public function's name.

    Otherwise they would name a function of this module.
    """
    try:
        yield
    except BadValue as e:
        raise BadValue(f"{name}: {str(e).partition(': ')[2]}") from None


def between(points: FloatArray, low: float, high: float, parts: int) -> FloatArray:
    """Return a grid on [low, high] that divides each gap between points equally.

    The points must be ascending.
    """
    margin = 1e-12 * (high - low)
    knots = np.concatenate(
        [[low], points[(points > low + margin) & (points < high - margin)], [high]]
    )
    steps = np.diff(knots)[:, None] * (np.arange(parts) / parts)
    return np.append((knots[:-1, None] + steps).ravel(), high)


def peaks_of(x: FloatArray, error: FloatArray) -> FloatArray:
    """Return the positions of the error's extremes, one in each run of one sign.

    A parabola is fitted through the largest |error| and its neighbours.
    """
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


def alternating(error: FloatArray, count: int) -> list[int]:
    """Return the indices of the `count` largest errors of alternating sign.

    There may be fewer of them.
    """
    kept: list[int] = []
    for i in range(len(error)):
        if not kept or (error[i] < 0) != (error[kept[-1]] < 0):
            kept.append(i)
        elif abs(error[i]) > abs(error[kept[-1]]):
            kept[-1] = i
    while len(kept) > count:
        del kept[0 if abs(error[kept[0]]) < abs(error[kept[-1]]) else -1]
    return kept


# The band-limited differentiator ----------------------------------------------------
# The band-limited FIR differentiator, minimax in its pass band and stop band.
MAX_ORDER = 8192
"""Highest order of a differentiator."""

MIN_RELATIVE_ERROR = 1e-13
"""Smallest error a differentiator is designed for: with more taps, rounding decides
what happens outside the bands.
"""


class DifferentiatorDesign(NamedTuple):
    """A linear-phase FIR differentiator.

    Attributes
    ----------
    taps : ndarray, shape (order + 1,)
        Impulse response in 1/s, antisymmetric, delay order/2 samples.  Read-only.
    error : float
        Largest error in the pass band, relative to i 2 pi f.
    stop_db : float
        Largest gain in the stop band over the gain at the pass edge, dB; -inf without a
        stop band.
    """

    taps: FloatArray
    error: float
    stop_db: float


@lru_cache(maxsize=64)
@one_thread()
def differentiator_taps(
    fs: float, passband: float, stopband: float | None, order: int
) -> DifferentiatorDesign:
    """Design a band-limited differentiator, for d/dt in 1/s.

    It is an equal-ripple FIR filter of type III with a delay of order/2 samples.

    The response is ``i w fs exp(-i w order/2)`` on [0, passband] and zero on [stopband,
    fs/2]. One bound, the smallest possible, holds for the error in both bands: relative
    to the desired gain in the pass band, and relative to the gain at the pass edge in
    the stop band.

    Parameters
    ----------
    fs : float
        Sample rate, Hz.
    passband, stopband : float, float or None
        Edges, Hz, 0 < passband < stopband <= fs/2.  None (or fs/2): no stop band.
    order : int
        Number of taps less one; even, 2 to 8192.

    Raises
    ------
    BadValue
        If an argument is out of range.

    Notes
    -----
    Where the order would give an error below 1e-13, fewer taps are used, with zeros on
    either side.

    References
    ----------
    The UGrip paper, section 1.1, "FIR of order 128".
    Parks, T. W. & McClellan, J. H. (1972), IEEE Trans. Circuit Theory 19, 189-194.

    Examples
    --------
    >>> from stimlib.design.filters import differentiator_taps
    >>> d = differentiator_taps(fs=8000, passband=1000, stopband=1500, order=128)
    >>> len(d.taps), d.error < 1e-6, d.stop_db < -110
    (129, True, True)
    """
    w_pass, w_stop = _band_edges("differentiator_taps", fs, passband, stopband)
    if not (2 <= order <= MAX_ORDER and order % 2 == 0):
        raise BadValue(
            f"differentiator_taps: order = {order}: choose an even number from 2 to {MAX_ORDER}"
        )
    half = int(order) // 2
    if _first_error(half, w_pass, w_stop) < MIN_RELATIVE_ERROR:
        half = min(half, _half_order_estimate(w_pass, w_stop, MIN_RELATIVE_ERROR))
    sines, error, stop_error = _minimax_sines(half, w_pass, w_stop)
    taps = np.zeros(int(order) + 1)
    middle = int(order) // 2
    taps[middle - half : middle] = fs * sines[::-1]
    taps[middle + 1 : middle + 1 + half] = -fs * sines
    taps.setflags(write=False)
    return DifferentiatorDesign(
        taps, error, 20 * math.log10(stop_error) if stop_error > 0 else -math.inf
    )


@lru_cache(maxsize=64)
def differentiator_order(fs: float, passband: float, stopband: float | None, tol: float) -> int:
    """Return the smallest even order for which `differentiator_taps` meets a tolerance.

    Parameters
    ----------
    fs, passband, stopband
        As for `differentiator_taps`.
    tol : float
        Largest relative error in the pass band, 1e-10 to below 1.  The stop band is
        then at most at 20 log10(tol) dB.

    Raises
    ------
    BadValue
        If an argument is out of range, or if the order would be above 8192.

    Notes
    -----
    Takes a few designs; each is quadratic in the order (0.3 s at order 3000).

    Examples
    --------
    >>> from stimlib.design.filters import differentiator_order
    >>> differentiator_order(fs=8000, passband=1000, stopband=1500, tol=1e-6)
    122
    """
    w_pass, w_stop = _band_edges("differentiator_order", fs, passband, stopband)
    if not 1e-10 <= tol < 1:
        raise BadValue(
            f"differentiator_order: tol = {tol}: choose a relative error from 1e-10 to below 1"
        )
    most = MAX_ORDER // 2
    half = _half_order_estimate(w_pass, w_stop, tol)
    too_low, enough = 0 if _first_error(half, w_pass, w_stop) <= tol else most, most + 1
    rate, work = -math.log(tol) / half, 0.0  # the error falls like exp(-rate half)
    while enough - too_low > 1:
        work += 400.0 * half * half
        what = (
            f"differentiator_order: the order is near {2 * half} (lower fs, or raise tol);"
            " operations to find it"
        )
        limits.check("design_work", work, what)
        error = _exchange(half, w_pass, w_stop).error
        too_low, enough = (too_low, half) if error <= tol else (half, enough)
        step = math.ceil(math.log(max(error, 1e-300) / tol) / rate)
        half = min(max(half + step, too_low + 1), enough - 1)
    if enough > most:
        raise BadValue(
            f"differentiator_order: an error of {tol:g} up to {passband:g} Hz takes an order above"
            f" {MAX_ORDER} at fs = {fs:g} Hz; lower fs, end the pass band further below"
            f" {fs / 2 if stopband is None else stopband:g} Hz (where that is 1.5 passband: raise"
            " passband), or raise tol"
        )
    return 2 * enough


def _band_edges(
    where: str, fs: float, passband: float, stopband: float | None
) -> tuple[float, float | None]:
    """Return the band edges in rad/sample; raise BadValue if they do not fit.

    There is no stop band at fs/2, where a differentiator of type III is zero anyway.
    """
    if not (math.isfinite(fs) and fs > 0):
        raise BadValue(f"{where}: fs = {fs} Hz: the sample rate must be a finite number above 0")
    if not 0 < passband < fs / 2:
        raise BadValue(
            f"{where}: passband = {passband} Hz: choose an edge above 0 and below fs/2 ="
            f" {fs / 2:g} Hz"
        )
    if stopband is not None and not passband < stopband <= fs / 2:
        raise BadValue(
            f"{where}: stopband = {stopband} Hz: choose an edge above the passband, {passband:g}"
            f" Hz, and up to fs/2 = {fs / 2:g} Hz, or None"
        )
    if stopband is None or stopband == fs / 2:
        return 2 * math.pi * passband / fs, None
    return 2 * math.pi * passband / fs, 2 * math.pi * stopband / fs


def _wanted(w: FloatArray, w_pass: float, w_stop: float | None) -> tuple[FloatArray, FloatArray]:
    """Return the desired values and the weight of the even factor of the response.

    The response is A(w) = sin w P(cos w), and weight (P - desired) is its error.
    """
    passing = w < (w_pass + (w_stop or math.pi)) / 2
    inside = np.where(passing, w, 0.0)
    wanted = np.where(passing, 1 / np.sinc(inside / np.pi), 0.0)
    return wanted, np.where(passing, np.sinc(inside / np.pi), np.sin(w) / w_pass)


class _Interpolant(NamedTuple):
    """A polynomial in y = sin^2(w/2), in barycentric form on a reference."""

    y: FloatArray
    weights: FloatArray
    values: FloatArray

    def at(self, w: FloatArray) -> FloatArray:
        """Return the values at w, computed in blocks that fit in the cache."""
        values, block = np.empty(len(w)), 1 + 65536 // len(self.y)
        for i in range(0, len(w), block):
            gaps = np.sin(w[i : i + block, None] / 2) ** 2 - self.y
            gaps[gaps == 0] = 1e-200  # on a reference point: its term outweighs all others
            np.reciprocal(gaps, out=gaps)
            values[i : i + block] = (gaps @ (self.weights * self.values)) / (gaps @ self.weights)
        return values


def _barycentric_weights(y: FloatArray) -> FloatArray:
    """Return the barycentric weights 1/prod_j (y_i - y_j) of ascending nodes y.

    They have a common factor, and are computed with logarithms of products of eight
    gaps that are far apart.
    """
    size, block = np.empty(len(y)), 1 + 65536 // len(y)
    for i in range(0, len(y), block):
        gaps = np.abs(y[i : i + block, None] - y)
        gaps[gaps == 0] = 1.0
        gaps = np.pad(gaps, ((0, 0), (0, -len(y) % 8)), constant_values=1.0)
        size[i : i + block] = -np.sum(
            np.log(np.prod(gaps.reshape(len(gaps), 8, -1), axis=1)), axis=1
        )
    return np.exp(size - np.max(size)) * np.resize([1.0, -1.0], len(y))


def _levelled(w: FloatArray, w_pass: float, w_stop: float | None) -> tuple[_Interpolant, float]:
    """Return the polynomial whose error alternates on the reference, and its level.

    The error is +E, -E, +E, ... at the frequencies w, and the degree is len(w) - 2.
    """
    y = np.sin(w / 2) ** 2
    weights = _barycentric_weights(y)
    wanted, weight = _wanted(w, w_pass, w_stop)
    sign = np.resize([1.0, -1.0], len(w))
    level = np.sum(weights * wanted) / np.sum(weights * sign / weight)
    return _Interpolant(y, weights, wanted - sign * level / weight), float(abs(level))


def _first_reference(half: int, w_pass: float, w_stop: float | None) -> FloatArray:
    """Return a starting reference of half + 1 frequencies in both bands.

    They are spread like charges at equilibrium: peaks of best polynomial approximations
    on a set of bands settle at this density. In y = sin^2(w/2) it is |y - y0|/sqrt|(y -
    y_pass)(y - y_stop)| dw/pi, with y0 in the gap such that no net force acts across
    the gap.
    """
    if w_stop is None:
        return 2 * np.arcsin(math.sin(w_pass / 2) * np.sin(np.linspace(0, np.pi / 2, half + 1)))
    phi = np.linspace(0, np.pi / 2, 8 * half + 401)
    y_pass, y_stop = math.sin(w_pass / 2) ** 2, math.sin(w_stop / 2) ** 2
    gap = y_pass + (y_stop - y_pass) * np.sin(phi[:-1] / 2 + phi[1:] / 2) ** 2
    y0 = np.average(gap, weights=1 / np.sqrt(gap * (1 - gap)))

    def charge(edge: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Return frequencies from 0 or pi to the band edge, with their charges."""
        w, middle = (end + (edge - end) * np.sin(p) for p in (phi, phi[:-1] / 2 + phi[1:] / 2))
        # y - y_b
        to_pass, to_stop = (
            np.sin((middle + b) / 2) * np.sin((middle - b) / 2) for b in (w_pass, w_stop)
        )
        density = np.abs(to_pass + y_pass - y0) / np.sqrt(np.abs(to_pass * to_stop)) / np.pi
        return w, np.concatenate([[0.0], np.cumsum(density * np.abs(np.diff(w)))])

    (passing, in_pass), (stopping, in_stop) = charge(w_pass, 0.0), charge(w_stop, math.pi)
    share = in_pass[-1] / (in_pass[-1] + in_stop[-1])
    # both band edges are peaks, and so is w = 0
    count = min(max(1, round(share * (half + 0.5) + 0.5)), half)
    up = np.arange(count) if count > 1 else np.ones(1)
    down = np.arange(half - count, -1, -1) + 0.5  # sin w makes w = pi a zero
    low = np.interp(up / up[-1] * in_pass[-1], in_pass, passing)
    return np.concatenate([low, np.interp(down / down[0] * in_stop[-1], in_stop, stopping)])


def _first_error(half: int, w_pass: float, w_stop: float | None) -> float:
    """Return the levelled error on the first reference.

    It is a lower bound of the best error, and close to it.
    """
    return _levelled(_first_reference(half, w_pass, w_stop), w_pass, w_stop)[1]


def _half_order_estimate(w_pass: float, w_stop: float | None, tol: float) -> int:
    """Return the smallest half order whose first levelled error meets a tolerance.

    It is found by bisection.
    """
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
    """Return the weighted error of the even factor P at w."""
    wanted, weight = _wanted(w, w_pass, w_stop)
    return weight * (even.at(w) - wanted)


class _Exchanged(NamedTuple):
    """Result of the Remez exchange: levelled reference, peaks and largest error."""

    reference: FloatArray
    peaks: FloatArray
    error: float


@lru_cache(maxsize=16)
def _exchange(half: int, w_pass: float, w_stop: float | None) -> _Exchanged:
    """Run the Remez exchange for a polynomial of degree half - 1 on both bands.

    The polynomial P is the interpolant on the reference.
    """
    bands = [(0.0, w_pass)] if w_stop is None else [(0.0, w_pass), (w_stop, math.pi)]
    following = _first_reference(half, w_pass, w_stop)
    for _ in range(20):
        reference = following
        even, level = _levelled(reference, w_pass, w_stop)
        grids = [between(reference, low, high, max(8, 400 // half)) for low, high in bands]
        grids = [grid[grid < math.pi] for grid in grids]  # A(pi) is zero, whatever the taps
        peaks = np.concatenate(
            [peaks_of(grid, _error(even, grid, w_pass, w_stop)) for grid in grids]
        )
        heights = _error(even, peaks, w_pass, w_stop)
        kept = alternating(heights, half + 1)
        largest = float(np.max(np.abs(heights)))
        if largest < 1.001 * level or level < MIN_RELATIVE_ERROR or len(kept) < half + 1:
            break
        following = peaks[kept]
    return _Exchanged(reference, peaks, largest)


def _minimax_sines(
    half: int, w_pass: float, w_stop: float | None
) -> tuple[FloatArray, float, float]:
    """Return the sine coefficients of the best response, and its errors in both bands.

    A(w) = 2 sum_k c_k sin(k w), k = 1 .. half.

    Between the bands an interpolant loses the digits that the approximation gains
    inside. So the coefficients come from the linear system of the last reference; what
    that leaves undetermined does no harm.
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


# Second-order sections in trapezoidal form ------------------------------------------
# Recursive filters as second-order sections in trapezoidal form, from analogue poles
# and zeros.
#
# s stands for (z - 1)/(z + 1) = i tan(pi f/fs) throughout (the bilinear transform).
# Nothing is ever written as a polynomial in z: near z = 1 its coefficients have lost
# the digits that a low cutoff is made of. Doubles are exact fractions, so each number
# of a section is computed exactly and rounded once.
KINDS = {
    "butterworth": "butter",
    "bessel": "bessel_mag",
    "chebyshev1": "cheby1",
    "elliptic": "ellip",
}
"""Families, and what scipy calls them."""

BANDS = {"lowpass": 1, "highpass": 1, "bandpass": 2, "bandstop": 2}
"""Kinds of pass band, and how many edges each has."""

ORDERS = range(1, 13)
# what numbers at the ends of float64's range end in
ARITHMETIC = (ZeroDivisionError, OverflowError)


class Sections(NamedTuple):
    """The coefficients of all sections, in running order.

    s1 += a h - c s1;  s2 += d h + b s1.

    The section is (n2 s^2 + n1 s + n0)/(s^2 + d1 s + d0) with D = 1 + d1 + d0, g^2 = d0
    and a = b = 2g/D, c = 2(d0 + d1)/D, d = 2 d0/D, h0 = (n2 + n1 + n0)/D, e1 = (n1 + n0
    - n2 (d1 + d0))/(g D), e0 = n0/d0. These coefficients are what is added to the
    states rather than what remains of them, so a low cutoff loses no digits to 1 -
    small.
    """

    a: np.ndarray
    c: np.ndarray
    b: np.ndarray
    d: np.ndarray
    h0: np.ndarray
    e1: np.ndarray
    e0: np.ndarray


Quadratic = Sequence[Fraction]  # factors of s^2, s and 1


def sections(rows: Sequence[tuple[Quadratic, Quadratic]]) -> Sections:
    """Return the coefficients of sections given as (numerator, denominator) in s.

    Both are polynomials in s. All coefficients of a denominator must be above 0.

    Raises
    ------
    BadValue
        Numbers beyond the range of a float.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from stimlib.design.filters import sections
    >>> one, none = Fraction(1), Fraction(0)
    >>> sections([((none, none, one), (one, one, one))]).e0  # the gain at 0 Hz
    array([1.])
    """
    try:
        return Sections(*np.array([_section(*row) for row in rows], np.float64).T.copy())
    except ARITHMETIC:
        raise BadValue(
            "a filter's numbers are beyond what a float can hold; take a higher frequency, or"
            " smaller factors"
        ) from None


def _section(n: Quadratic, d: Quadratic) -> tuple[Fraction, ...]:
    n2, n1, n0, d1, d0 = (v / d[0] for v in (*n, *d[1:]))
    g, D = Fraction(math.sqrt(d0)), 1 + d1 + d0  # any g near the root will do: it scales s1
    bottom = 2 * g / D, 2 * (d0 + d1) / D, 2 * d0 / (g * D), 2 * d0 / D
    return *bottom, (n2 + n1 + n0) / D, (n1 + n0 - n2 * (d1 + d0)) / (g * D), n0 / d0


def designed(
    band: str, edges: Sequence[float], order: int, kind: str, ripple: float, attenuation: float
) -> list[tuple[Quadratic, Quadratic]]:
    """Return the sections of a filter, lowest Q first, from its edges.

    Edges are in cycles per sample. The analogue filter is designed by scipy, except
    that the poles of a Butterworth filter are their formula: ``scipy.signal`` takes a
    second to load.

    Raises
    ------
    BadValue
        An order that these edges, ripple and attenuation do not allow.
    """
    w = np.tan(np.pi * np.array(edges, float))
    edge, shape = (w[0], band) if w.size == 1 else (1.0, "lowpass")
    try:
        with np.errstate(all="ignore"):
            if kind == "butterworth":
                z, p, k = _butterworth(order, edge, shape)
            else:
                from scipy.signal import iirfilter

                given = order, edge, ripple, attenuation, shape, True, KINDS[kind], "zpk"
                z, p, k = iirfilter(*given)
            if w.size == 2:
                z, p, k = _between(z, p, k, w[0], w[1], band == "bandstop")
        if np.isfinite([*z, *p, k]).all() and (p.real < 0).all() and k != 0:
            return paired(z, p, float(k))
    except (*ARITHMETIC, ValueError):  # as scipy tells it of an elliptic filter
        pass
    what = f"{band}: no {kind} filter of order {order} has these edges, ripple and attenuation"
    raise BadValue(f"{what}; lower the order or move the edges apart")


def _butterworth(order: int, edge: float, shape: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return zeros, poles and gain of an analogue low-pass or high-pass filter.

    The poles lie evenly on the left half of a circle (Butterworth 1930). The order of
    operations is scipy's, so the bits are.
    """
    p = -np.exp(1j * np.pi * np.arange(1 - order, order, 2) / (2 * order))
    if shape == "lowpass":
        return np.empty(0), p * edge, edge**order
    return np.zeros(order), edge / p, np.real(1 / np.prod(-p))


def _between(
    z: np.ndarray, p: np.ndarray, k: float, low: float, high: float, stop: bool
) -> tuple[np.ndarray, np.ndarray, float]:
    """Transform a low-pass into a band-pass or a band-stop filter.

    s becomes (s^2 + low high)/(s (high - low)), or its inverse.

    Of each pair of roots the smaller is found from their product: as a difference it
    would lose digits where the edges are far apart.
    """
    half, middle, more = (high - low) / 2, low * high, len(p) - len(z)

    def both(r: np.ndarray) -> np.ndarray:
        """Return the roots of s^2 - 2 r s + middle."""
        d = np.sqrt(r * r - middle + 0j)
        large = np.where(np.abs(r + d) >= np.abs(r - d), r + d, r - d)
        return np.concatenate((large, middle / large))

    if not stop:
        return (
            np.concatenate((both(half * z), np.zeros(more))),
            both(half * p),
            k * (2 * half) ** more,
        )
    far = 1j * np.sqrt(middle) * np.repeat([1.0, -1.0], more)
    return (
        np.concatenate((both(half / z), far)),
        both(half / p),
        k * float(np.real(np.prod(-z) / np.prod(-p))),
    )


def paired(z: np.ndarray, p: np.ndarray, k: float) -> list[tuple[Quadratic, Quadratic]]:
    """Return the sections of a filter whose zeros lie on the imaginary axis.

    The section with the highest Q takes the nearest zeros, and runs last.

    Each section has its peak near 1; the remaining gain is in the first.
    """
    turning = np.abs(p.imag) > 1e-14 * np.abs(p)
    poles = [
        (-2 * Fraction(q.real), Fraction(q.real) ** 2 + Fraction(q.imag) ** 2)
        for q in p[turning & (p.imag > 0)].tolist()
    ]
    real = sorted(Fraction(-q) for q in p[~turning].real.tolist())
    alone = real.pop() if len(real) % 2 else None
    poles += [(a + b, a * b) for a, b in zip(real[::2], real[1::2], strict=True)]
    poles.sort(key=lambda q: math.sqrt(q[1]) / q[0])
    # beside a pole and a zero at z = 0, which cancel exactly: a section like all others
    if alone is not None:
        poles.insert(0, (1 + alone, alone))
    squares = [Fraction(q.imag) ** 2 for q in z.tolist() if q.imag > 0]  # each s^2 + w^2
    rows: dict[int, Quadratic] = {}
    free, gain = list(range(len(poles))), Fraction(k)
    while squares:
        i = free.pop()
        nearest = min(squares, key=lambda q: abs(math.log(q / poles[i][1])))
        squares.remove(nearest)
        rows[i] = (Fraction(1), Fraction(0), nearest)
    zeros = int(np.sum(z == 0))  # each section left gets one, and then another
    for j, i in enumerate(reversed(free)):
        count = len(range(j, zeros, len(free)))
        g = Fraction(math.sqrt(poles[i][1]))
        if i == 0 and alone is not None:
            rows[i] = (
                (Fraction(1), Fraction(1), Fraction(0)) if count else (Fraction(0), alone, alone)
            )
            gain /= 1 if count else alone
        else:
            rows[i] = tuple(g ** (2 - count) if m == 2 - count else Fraction(0) for m in range(3))
            gain /= g ** (2 - count)
    rows[0] = tuple(gain * v for v in rows[0])
    return [(rows[i], (Fraction(1), *poles[i])) for i in range(len(poles))]


def from_polynomials(b: Sequence[float], a: Sequence[float]) -> tuple[Quadratic, Quadratic]:
    """Convert a discrete second-order section to polynomials in s, exactly.

    The section is (b0 + b1/z + b2/z^2)/(a0 + a1/z + a2/z^2). Its poles are inside the
    unit circle if all coefficients of the new denominator have the same sign.

    Examples
    --------
    >>> from stimlib.design.filters import from_polynomials
    >>> [int(v) for v in from_polynomials([1, 1, 0], [4, 0, 0])[1]]  # 4 (s + 1)^2
    [4, 8, 4]
    """
    made = [
        (p0 - p1 + p2, 2 * (p0 - p2), p0 + p1 + p2)
        for p0, p1, p2 in (map(Fraction, map(float, p)) for p in (b, a))
    ]
    return made[0], made[1]


# Another sample rate ----------------------------------------------------------------
# A recording at another sample rate, and between its samples.
# zero crossings on each side; of Kaiser's window: aliases and images below -110 dB
HALF, BETA = 32, 12.0
PIECE = 2**18  # products at once: they stay in the cache, and an interrupt acts between two pieces


def resampled(
    x: np.ndarray, rate: float, fs: float, below: float = math.inf, name: str = "resampled"
) -> np.ndarray:
    """Resample a recording with a sinc in a Kaiser window.

    It passes frequencies up to 0.45 of the lower rate within 1e-5. Outside the
    recording x counts as 0. At an unchanged rate the samples stay as they are.

    Parameters
    ----------
    x : ndarray, shape (n,)
    rate, fs : float
        Sample rates of x and of the result, in Hz.
    below : float
        Another rate in Hz, half of which limits the band too.
    name : str
        Of the function that needs it, for an error.

    Returns
    -------
    ndarray, shape (ceil(n fs/rate),)

    Raises
    ------
    BadValue
        More than ``stimlib.limits.design_work``.

    Notes
    -----
    At a time t between two samples the factors depend on t - floor(t) alone.  Rates in
    the ratio of small whole numbers have few such phases, so the factors of each are
    made once.

    References
    ----------
    Crochiere and Rabiner, "Multirate Digital Signal Processing" (1983), section 2.4:
    polyphase structures.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.design.filters import resampled
    >>> wave = np.sin(2 * np.pi * 0.1 * np.arange(400))
    >>> y = resampled(wave, 1000, 2500)
    >>> bool(
    ...     np.abs(y - np.sin(2 * np.pi * 0.04 * np.arange(1000)))[200:800].max() < 1e-5
    ... )
    True
    """
    ratio = Fraction(fs) / Fraction(rate)
    if ratio == 1 and below >= rate:
        return x.copy()
    lowest = min(Fraction(1), ratio, Fraction(min(below, rate)) / Fraction(rate))
    low, reach = float(lowest), min(math.ceil(HALF / lowest), x.size)  # beyond x there is nothing
    size, (phases, step) = math.ceil(x.size * ratio), ratio.as_integer_ratio()
    few, k = 16 * phases <= size, np.arange(-reach + 1, reach + 1)
    limits.check(
        "design_work",
        k.size * (2.0 * size + 50.0 * (phases if few else size)),
        f"{name}: operations to bring {x.size} samples from {rate:g} Hz to {fs:g} Hz (resample them"
        " before, or change fs)",
    )

    def factors(d: np.ndarray) -> np.ndarray:
        return (
            low
            * np.sinc(low * d)
            * np.i0(BETA * np.sqrt(np.maximum(1 - (d * low / HALF) ** 2, 0)))
            / np.i0(BETA)
        )

    padded = np.concatenate([np.zeros(reach - 1), x, np.zeros(reach + 1)])
    # those that the factors of a sample meet
    around = np.lib.stride_tricks.sliding_window_view(padded, k.size)
    y, rows = np.empty(size), max(1, PIECE // k.size)
    for phase in range(phases if few else 0):
        out, near = y[phase::phases], around[phase * step // phases :: step]
        fixed = factors(phase * step % phases / phases - k)
        for i in range(0, out.size, rows):
            out[i : i + rows] = np.einsum("ij,j->i", near[i : min(i + rows, out.size)], fixed)
    for i in range(0, 0 if few else size, rows):
        t = np.arange(i, min(i + rows, size)) / float(ratio)
        first = np.floor(t).astype(int)
        y[i : i + t.size] = np.einsum("ij,ij->i", around[first], factors((t - first)[:, None] - k))
    return y
