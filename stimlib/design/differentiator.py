"""The band-limited FIR differentiator, minimax in its pass band and stop band."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..errors import BadValue
from ..system.limits import limits
from .minimax import FloatArray, alternating, between, peaks_of

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
def differentiator_taps(
    fs: float, passband: float, stopband: float | None, order: int
) -> DifferentiatorDesign:
    """Band-limited differentiator: equal-ripple FIR of type III, for d/dt in 1/s with a
    delay of order/2 samples.

    The response is ``i w fs exp(-i w order/2)`` on [0, passband] and zero on [stopband,
    fs/2].  The error relative to the wanted gain in the pass band, and relative to the
    gain at the pass edge in the stop band, has one and the same bound, the smallest
    possible.

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
    >>> from stimlib.design.differentiator import differentiator_taps
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
    """Smallest even order for which `differentiator_taps` meets a tolerance.

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
    >>> from stimlib.design.differentiator import differentiator_order
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
            f" {MAX_ORDER} at fs = {fs:g} Hz: end the pass band further below"
            f" {fs / 2 if stopband is None else stopband:g} Hz, lower fs, or raise tol"
        )
    return 2 * enough


def _band_edges(
    where: str, fs: float, passband: float, stopband: float | None
) -> tuple[float, float | None]:
    """Edges in rad/sample; no stop band at fs/2, where a differentiator of type III is
    zero anyway.
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
    """Wanted values and weight of the even factor P in A(w) = sin w P(cos w): weight (P
    - wanted) is the error.
    """
    passing = w < (w_pass + (w_stop or math.pi)) / 2
    inside = np.where(passing, w, 0.0)
    wanted = np.where(passing, 1 / np.sinc(inside / np.pi), 0.0)
    return wanted, np.where(passing, np.sinc(inside / np.pi), np.sin(w) / w_pass)


class _Interpolant(NamedTuple):
    """A polynomial in y = sin^2(w/2), by its values on a reference (barycentric
    form).
    """

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
    """1/prod_j (y_i - y_j) up to a common factor, y ascending; as logarithms of
    products of eight far apart.
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
    """The polynomial of degree len(w) - 2 whose error is +E, -E, +E, ... on the
    reference w, and E.
    """
    y = np.sin(w / 2) ** 2
    weights = _barycentric_weights(y)
    wanted, weight = _wanted(w, w_pass, w_stop)
    sign = np.resize([1.0, -1.0], len(w))
    level = np.sum(weights * wanted) / np.sum(weights * sign / weight)
    return _Interpolant(y, weights, wanted - sign * level / weight), float(abs(level))


def _first_reference(half: int, w_pass: float, w_stop: float | None) -> FloatArray:
    """half + 1 frequencies spread like equal charges at rest on the pass band and the
    stop band.

    Peaks of best polynomial approximations on a set of bands settle at this density.
    In y = sin^2(w/2) it is |y - y0|/sqrt|(y - y_pass)(y - y_stop)| dw/pi, with y0 in
    the gap such that no force is left across the gap.
    """
    if w_stop is None:
        return 2 * np.arcsin(math.sin(w_pass / 2) * np.sin(np.linspace(0, np.pi / 2, half + 1)))
    phi = np.linspace(0, np.pi / 2, 8 * half + 401)
    y_pass, y_stop = math.sin(w_pass / 2) ** 2, math.sin(w_stop / 2) ** 2
    gap = y_pass + (y_stop - y_pass) * np.sin(phi[:-1] / 2 + phi[1:] / 2) ** 2
    y0 = np.average(gap, weights=1 / np.sqrt(gap * (1 - gap)))

    def charge(edge: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Frequencies from the end of the axis to the band edge, and the charge up to
        each.
        """
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
    """Levelled error on the first reference, a bound from below for the best error and
    close to it.
    """
    return _levelled(_first_reference(half, w_pass, w_stop), w_pass, w_stop)[1]


def _half_order_estimate(w_pass: float, w_stop: float | None, tol: float) -> int:
    """Smallest half order whose levelled error on the first reference is at most tol
    (by bisection).
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
    """Weighted error of P at w."""
    wanted, weight = _wanted(w, w_pass, w_stop)
    return weight * (even.at(w) - wanted)


class _Exchanged(NamedTuple):
    """Where the exchange ended: the levelled reference, the peaks of the error, and the
    largest of them.
    """

    reference: FloatArray
    peaks: FloatArray
    error: float


@lru_cache(maxsize=16)
def _exchange(half: int, w_pass: float, w_stop: float | None) -> _Exchanged:
    """Remez exchange for P of degree half - 1 on both bands, with P as its interpolant
    on the reference.
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
    """Coefficients c_k of the best A(w) = 2 sum_k c_k sin(k w), k = 1 ... half, and its
    errors in both bands.

    Between the bands an interpolant loses the digits that the approximation gains
    inside.  So the coefficients come from the linear system of the last reference: what
    it leaves undetermined does no harm.
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
