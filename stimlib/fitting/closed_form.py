"""Closed-form responses of a springpot and of Maxwell arms to a sampled motion.

The displacement is assumed linear between samples, for which the response of each model
is known in closed form.  A fit therefore needs no integration step, and neither gaps
nor log-spaced time stamps need resampling.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..blocks.fractional import Alpha
from ..core.graph import unmasked
from ..errors import Above0, BadValue, Below1, Count, From0, Upto1, computed, counted, public

Onset = Literal["steady", "step"]
PAIRS = 10_000_000  # of samples and straight pieces that a fit of a springpot holds in memory
EVEN = 1e-6  # of a step: times that lie so near to even ones count as even
TINY = 1e-20  # imaginary step of an order, whose effect is a derivative without cancellation


# The exact answers --------------------------------------------------------------------
@public
@computed
def springpot_force(
    t: ArrayLike, y: ArrayLike, chi: From0, alpha: Alpha, *, onset: Onset = "steady"
) -> np.ndarray:
    """Return the force chi D^alpha y of a springpot at the times t.

    The force is exact for a displacement that is linear between the times: f(t) =
    chi/Gamma(2 - alpha) sum_i slope_i ((t - t_i)^(1 - alpha) - (t - t_i+1)^(1 -
    alpha)), computed without cancellation.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times in s, rising, with any spacing.
    y : array_like, shape (n,)
        Displacement in m.
    chi : float
        N s^alpha/m, not below 0.
    alpha : float
        From 0 (spring) to 1 (dashpot).
    onset : {"steady", "step"}
        Whether y was at its first value before t[0], or jumps there from 0 (the force
        at that time is then infinite unless alpha is 0).

    Returns
    -------
    ndarray, shape (n,)
        Force in N.

    Raises
    ------
    BadValue
        t not rising, not finite or of another length than y; chi, alpha or onset
        outside their range.

    References
    ----------
    Çaldıran's thesis, eq. (2.8); the sum over linear pieces is the L1 formula on an
    uneven grid.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.fitting import springpot_force
    >>> t = np.array([0.0, 0.5, 0.7, 4.0])
    >>> springpot_force(t, 0.1 * t, 100.0, 0.5).round(6)  # 100 * 0.1 * 2 sqrt(t/pi)
    array([ 0.      ,  7.978846,  9.440697, 22.567583])
    """
    t, y = signals_at(t, y)
    out = np.empty(t.size)
    for some in np.array_split(np.arange(t.size), max(1, t.size * t.size // 2_000_000)):
        out[some] = Pairs(t, y, some, onset)(alpha)[0]
    return chi * out


@public
@computed
def maxwell_force(
    t: ArrayLike,
    y: ArrayLike,
    k0: float,
    arms: Sequence[tuple[float, Above0]],
    *,
    onset: Onset = "steady",
) -> np.ndarray:
    """Return the force of a spring with parallel Maxwell arms at the times t.

    The force is exact if y is linear between the times.

    Parameters
    ----------
    t, y, onset
        As for ``springpot_force``; y is 0 where the spring exerts no force.
    k0 : float
        Stiffness of the spring in N/m.
    arms : sequence of (k, tau)
        Stiffness in N/m and time constant in s of each arm.

    Returns
    -------
    ndarray, shape (n,)
        Force in N.

    Raises
    ------
    BadValue
        t not rising, not finite or of another length than y; a time constant not above
        0; an unknown onset.

    References
    ----------
    Çaldıran's thesis, eq. (2.1) and fig. 2.1.

    Examples
    --------
    >>> from stimlib.fitting import maxwell_force
    >>> maxwell_force(
    ...     [0.0, 1e-6, 0.1, 10.0], [0.0, 0.01, 0.01, 0.01], 100.0, [(50.0, 0.1)]
    ... ).round(4)
    array([0.    , 1.5   , 1.1839, 1.    ])
    """
    t, y = signals_at(t, y)
    k, tau = np.array([*arms], float).reshape(-1, 2).T
    if not np.isfinite(k).all():
        raise BadValue(f"maxwell_force: arms {arms} must have finite stiffnesses")
    return k0 * y + arm_forces(t, y, tau, onset)[0] @ k


@public
def mittag_leffler(x: ArrayLike, alpha: Upto1, beta: Above0 = 1.0) -> np.ndarray:
    """Return the Mittag-Leffler function E_alpha,beta(-x) for x not below 0.

    E_alpha(-(k/chi) t^alpha) is the relaxation of a spring k in series with a springpot
    (chi, alpha); E_1,1(-x) = exp(-x).

    Parameters
    ----------
    x : array_like
        Numbers not below 0; the argument is -x.
    alpha : float
        Above 0, at most 1.
    beta : float
        Above 0.

    Returns
    -------
    ndarray
        In the shape of x.  The error is below 1e-11/(1 + x).

    Raises
    ------
    BadValue
        A number outside its range.

    Notes
    -----
    The inverse Laplace transform of s^(alpha - beta)/(s^alpha + x) at time 1, by the
    trapezoidal rule on a parabola around the negative axis, which has no pole outside.

    References
    ----------
    Weideman and Trefethen, "Parabolic and hyperbolic contours for computing the
    Bromwich integral", Math. Comp. 76 (2007); Podlubny, "Fractional Differential
    Equations" (1999), eq. (1.80), for the transform.

    Examples
    --------
    >>> from stimlib.fitting import mittag_leffler
    >>> mittag_leffler([0.0, 1.0, 4.0], alpha=0.5).round(6)  # exp(x^2) erfc(x)
    array([1.      , 0.427584, 0.136999])
    """
    x = np.asarray(x, float)
    if not (np.isfinite(x).all() and (x >= 0).all()):
        raise BadValue("mittag_leffler: x must be finite and not below 0: the argument is -x")
    n = 28
    way = 1 + 3j * (np.arange(n) + 0.5) / n  # upper half of the parabola
    s = math.pi * n / 12 * way**2
    parts = np.exp(s) * s ** (alpha - beta) * way / (s**alpha + x[..., None])
    return parts.sum(axis=-1).real / 2


@public
@computed
def springpot_series_force(
    t: ArrayLike,
    y: ArrayLike,
    chi: Above0,
    alpha: Below1,
    *,
    k: Above0 | None = None,
    b: Above0 | None = None,
) -> np.ndarray:
    """Return the force of a springpot in series with a spring or a dashpot at times t.

    The force is exact for a displacement that is linear between the times, and that was
    at its first value before them.

    Parameters
    ----------
    t, y
        As for ``springpot_force``.
    chi : float
        N s^alpha/m, above 0.
    alpha : float
        Above 0, below 1.
    k, b : float
        Either the spring's stiffness in N/m, or the dashpot's damping in N s/m.

    Returns
    -------
    ndarray, shape (n,)
        Force in N.

    Raises
    ------
    BadValue
        t not rising, not finite or of another length than y; both or none of k and b; a
        number outside its range.

    References
    ----------
    Çaldıran's thesis, section 2.2. The response to a ramp of slope 1 is k t
    E_alpha,2(-(k/chi) t^alpha) with a spring, and chi t^a E_a,1+a(-(chi/b) t^a), a = 1
    - alpha, with a dashpot.

    Examples
    --------
    >>> from stimlib.fitting import springpot_series_force
    >>> springpot_series_force(
    ...     [0.0, 1e-6, 0.1, 10.0], [0.0, 0.01, 0.01, 0.01], 100.0, 0.5, k=1000.0
    ... ).round(4)
    array([0.    , 9.9253, 1.7058, 0.1783])
    """
    t, y = signals_at(t, y)
    other = b if k is None else k
    if other is None or (k is not None and b is not None):
        raise BadValue("springpot_series_force: give either k (a spring) or b (a dashpot)")
    order, beta, scale, ratio = (
        (1 - alpha, 2 - alpha, chi, chi / other) if k is None else (alpha, 2.0, other, other / chi)
    )

    def ramp(since: np.ndarray) -> np.ndarray:
        since = np.maximum(since, 0.0)
        return scale * since ** (beta - 1) * mittag_leffler(ratio * since**order, order, beta)

    slope, out = np.diff(y) / np.diff(t), np.empty(t.size)
    for i in range(t.size):
        forces = ramp(t[i] - t[: i + 1])
        out[i] = (forces[:-1] - forces[1:]) @ slope[:i]
    return out


class Pairs:
    """The response of a unit springpot at given times, and its sensitivity to alpha."""

    def __init__(self, t: np.ndarray, y: np.ndarray, some: np.ndarray, onset: str):
        slope = np.diff(y) / np.diff(t)
        moving = np.flatnonzero(slope)  # held pieces add nothing
        slope, piece, ends = slope[moving], np.diff(t)[moving], t[1:][moving]
        rows, columns = np.nonzero(t[some][:, None] > ends)
        past = t[some][rows] - ends[columns]
        self.rows, self.slope = rows, slope[columns]
        self.end = np.log(past)  # t - t_i+1
        self.more = np.log1p(piece[columns] / past)  # log of (t - t_i)/(t - t_i+1)
        now = ends.searchsorted(t[some])  # the piece that ends there, if it moves
        self.now = np.append(ends, math.inf)[now] == t[some]
        self.last, self.piece = slope[now[self.now]], np.log(piece[now[self.now]])
        self.since = t[some] - t[0]
        self.jump = y[0] if onset == "step" else 0.0

    def __call__(self, alpha: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the response and its derivative for an order alpha."""
        b, size, n = 1 - alpha, math.gamma(2 - alpha), self.since.size
        end, more = np.exp(b * self.end), np.expm1(b * self.more)
        end *= self.slope
        # of no pieces at all, numpy's sums are whole numbers
        value = np.asarray(np.bincount(self.rows, end * more, n), float)
        # by b: x^b log x
        steep = end * (more * (self.end + self.more) + self.more)
        steep = np.asarray(np.bincount(self.rows, steep, n), float)
        last = self.last * np.exp(b * self.piece)
        value[self.now] += last
        steep[self.now] += last * self.piece
        digamma = scipy.special.digamma
        value, slope = value / size, digamma(2 - alpha) * value / size - steep / size
        if self.jump:
            with np.errstate(divide="ignore", invalid="ignore"):
                log = np.log(self.since)
                if alpha == 1:
                    extra = np.where(self.since > 0, 0.0, math.inf)
                    # 1/Gamma(1 - alpha) falls with the slope 1
                    by = np.where(self.since > 0, -1 / self.since, math.inf)
                else:
                    extra = self.since**-alpha / math.gamma(1 - alpha)
                    by = extra * (digamma(1 - alpha) - log)
            value, slope = value + self.jump * extra, slope + self.jump * by
        return value, slope


class Sampled:
    """The response of a springpot block with chi = 1, and its sensitivity to alpha.

    ``scheme`` is "gl" or "l1", whose sums at even times are convolutions.
    """

    def __init__(self, step: float, y: np.ndarray, some: np.ndarray, scheme: str, onset: str):
        self.step, self.some, self.scheme = step, some, scheme
        moves = np.diff(y, prepend=0.0 if onset == "step" else y[0])
        self.size, self.length = moves.size, scipy.fft.next_fast_len(2 * moves.size - 1, True)
        self.moves = scipy.fft.rfft(moves, self.length)

    def __call__(self, alpha: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the response and its derivative for an order alpha."""
        order = complex(alpha, TINY)
        j = np.arange(1.0, self.size)
        if self.scheme == "gl":
            ratios = np.cumprod((j - order) / j)
        else:
            b = 1 - order
            ratios = j**b * np.expm1(b * np.log1p(1 / j))
        first = 1.0 if self.scheme == "gl" else 1 / scipy.special.gamma(2 - order)
        weights = np.r_[1.0, ratios] * first * self.step**-order
        value, by = (
            scipy.fft.irfft(scipy.fft.rfft(part, self.length) * self.moves, self.length)[self.some]
            for part in (weights.real, weights.imag / TINY)
        )
        return value, by


def even_step(t: np.ndarray) -> float:
    """Return the step of even times, or 0 if they are not even."""
    step = float(t[-1] - t[0]) / (t.size - 1)
    late = t - t[0] - step * np.arange(t.size)
    return step if np.abs(late).max() <= EVEN * step else 0.0


def arm_forces(
    t: np.ndarray, y: np.ndarray, tau: np.ndarray, onset: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return the forces of unit Maxwell arms, and their sensitivities to log(tau)."""
    a = np.diff(t)[:, None] / tau
    e = -np.expm1(-a)
    p, g, dy = 1 - e, np.where(a > 0, e / np.where(a > 0, a, 1.0), 1.0), np.diff(y)[:, None]
    drive, by_p, by_g = g * dy, p * a, (g - p) * dy
    f, d = np.zeros((t.size, tau.size)), np.zeros((t.size, tau.size))
    f[0] = y[0] if onset == "step" else 0.0
    if even_step(t):
        for i, keep in enumerate(p[0]):
            f[1:, i] = _decaying(drive[:, i], keep, f[0, i])
            d[1:, i] = _decaying(by_p[:, i] * f[:-1, i] + by_g[:, i], keep, 0.0)
        return f, d
    for n in range(t.size - 1):
        f[n + 1] = f[n] - e[n] * f[n] + drive[n]
        d[n + 1] = p[n] * d[n] + by_p[n] * f[n] + by_g[n]
    return f, d


def _decaying(x: np.ndarray, keep: float, first: float) -> np.ndarray:
    """Return s[n] = keep s[n-1] + x[n], with s[-1] = first."""
    return scipy.signal.lfilter([1.0], [1.0, -keep], x, zi=[keep * first])[0]


# Input --------------------------------------------------------------------------------
def signals_at(t, *signals) -> list[np.ndarray]:
    """Check signals over ascending times, and return them as float64 arrays."""
    out: list[np.ndarray] = []
    names = (
        ("t", "y", "f")
        if len(signals) < 3
        else ("t", *(f"signal {i}" for i in range(1, len(signals) + 1)))
    )
    for name, v in zip(names, (t, *signals), strict=False):
        try:
            a = np.array(unmasked(v))
        except (TypeError, ValueError):
            raise BadValue(f"{name} must be an array of numbers") from None
        if a.ndim != 1 or (out and a.size != out[0].size):
            raise BadValue(
                f"{name} has shape {a.shape}; time and signals must be one-dimensional and of one"
                " length"
            )
        if not np.isfinite(a).all():
            raise BadValue(f"{name}[{int(np.argmin(np.isfinite(a)))}] is not finite")
        out.append(a)
    if out[0].size < 2:
        raise BadValue(f"{counted(out[0].size, 'sample')} cannot be fitted; give at least 2")
    late = np.diff(out[0]) > 0
    if not late.all():
        i = int(np.argmin(late))
        raise BadValue(
            f"t must rise: t[{i}] = {out[0][i]:g} is followed by t[{i + 1}] = {out[0][i + 1]:g}"
        )
    return out


@public
def thin(
    t: ArrayLike, *signals: ArrayLike, start: float, per_decade: Count = 40, before: Count = 200
) -> list[np.ndarray]:
    """Average samples into time bins, which are logarithmic after a start time.

    Bins have equal length before ``start``, and equal ratio after it.

    An evenly sampled relaxation has nearly all of its samples in the late, almost
    constant part.  Averages over logarithmic bins give every decade of time equal
    weight and have less noise.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times in s, rising.
    *signals : array_like, shape (n,)
        Such as displacement and force.
    start : float
        Time in s at which the hold begins; later bins are evenly spaced in the
        logarithm of the time since then.
    per_decade : int
        Number of bins per factor of 10 in time.
    before : int
        Number of bins before ``start``, at most the number of samples.

    Returns
    -------
    list of ndarray
        Mean time and means of the signals; empty bins are left out.

    Raises
    ------
    BadValue
        t not rising, not finite or of another length than the signals; start not within
        t; no bins.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.fitting import thin
    >>> t = np.arange(100_000) / 5000
    >>> short, y = thin(t, np.minimum(t, 0.1), start=0.1)
    >>> short.size, float(y[-1].round(9))
    (367, 0.1)
    """
    rows = signals_at(t, *signals)
    t = rows[0]
    if not t[0] <= start < t[-1]:
        raise BadValue(f"thin: start = {start:g} s must be within t, {t[0]:g} to {t[-1]:g} s")
    early = int(np.sum(t <= start))
    bins = np.empty(t.size, np.int64)
    bins[:early] = np.arange(early) * min(before, early) // max(early, 1)
    since = t[early:] - start
    bins[early:] = before + np.floor(np.log10(since / since[0]) * per_decade + 1e-9).astype(
        np.int64
    )
    starts = np.flatnonzero(np.diff(bins, prepend=-1))
    counts = np.diff(np.r_[starts, t.size])
    return [np.add.reduceat(v, starts) / counts for v in rows]
