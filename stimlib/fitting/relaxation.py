"""Fits of material models to recorded relaxation, sampled at any times.

Module ``closed_form`` computes the responses of the models.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..core.graph import Block
from ..errors import BadValue, Count, SinkError, counted, outside, public, said_as
from ..system.packages import package
from .closed_form import (
    PAIRS,
    Onset,
    Pairs,
    Sampled,
    arm_forces,
    even_step,
    maxwell_force,
    signals_at,
    springpot_force,
)

CONFIDENCE = 0.95
ALPHAS = (0.0, 0.05, 0.15, 0.35, 0.65, 0.9, 1.0)  # between which a springpot's search looks
Scheme = Literal["exact", "l1", "gl"]
# of the squares that the exact law leaves; a sampled one that leaves fewer is named,
# unless both leave rounding only
FEWER, ROUNDING = 0.25, 1e-16
Place = tuple[float, float, np.ndarray, np.ndarray]  # chi, alpha, slopes, weighted misses
# of the search in a valley: its steps, the longest between two places whose slopes tell
# the curvature, and what is left at its end, in standard errors and in alpha
STEPS, SHORT, LEFT, LEAST = 40, 0.01, 1e-7, 1e-15
ROUGHLY = 1e-3  # left where only the squares are asked
LARGEST = 1e50  # size of what is fitted, in its unit
# parts of the force: an error that needs a word where the estimate is at the end of its
# range (by so many standard errors), and one that needs it anywhere
SOME, BEYOND, LITTLE = 0.05, 4.0, 0.5
NEAR = 0.5  # of a recorded force: the least to which an error is relative


@dataclass(frozen=True, eq=False, repr=False)
class MaterialFit:
    """A fitted material model with its numbers and errors.

    Attributes
    ----------
    values : dict of str to float
        Numbers of the model.
    intervals : dict of str to (float, float)
        95 % confidence intervals, from the curvature at the minimum, assuming
        independent errors.  They are too narrow if the model has the wrong shape,
        because neighbouring errors are then correlated.
    t, y, f : ndarray, shape (n,)
        The given data.
    fitted : ndarray, shape (n,)
        The model's force.
    used : ndarray of bool, shape (n,)
        Samples that the fit used.
    """

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    t: np.ndarray
    y: np.ndarray
    f: np.ndarray
    fitted: np.ndarray
    used: np.ndarray
    onset: Onset = field(default="steady")

    @property
    def residual(self) -> np.ndarray:
        """Residual fitted - f at all samples."""
        return self.fitted - self.f

    @property
    def relative(self) -> np.ndarray:
        """Relative error (fitted - f)/f at the used samples where f is not 0."""
        some = self.used & (self.f != 0)
        return self.residual[some] / self.f[some]

    @property
    def relative_error(self) -> float:
        """Root mean square of the relative errors ``relative``."""
        return float(np.sqrt(np.mean(self.relative**2)))

    @property
    def largest_relative_error(self) -> float:
        """Largest absolute value of the relative errors ``relative``."""
        return float(np.max(np.abs(self.relative)))

    @property
    def rms_error(self) -> float:
        """RMS residual of the used samples over the RMS of their force."""
        size = np.linalg.norm(self.f[self.used])
        return float(np.linalg.norm(self.residual[self.used]) / size)

    def __repr__(self):
        parts = [
            f"{n}={v:.4g} [{self.intervals[n][0]:.4g}, {self.intervals[n][1]:.4g}]"
            for n, v in self.values.items()
        ]
        one_sign = np.ptp(np.sign(self.f[self.used])) == 0
        error, of = (self.relative_error, "") if one_sign else (self.rms_error, " force")
        return (
            f"{type(self).__name__}({', '.join(parts)}; {100 * error:.2g} % rms{of} of"
            f" {counted(int(self.used.sum()), 'sample')})"
        )

    def plot(self, path: str | os.PathLike) -> None:
        """Draw measured and fitted force over time, with the relative error.

        Time 0 is the beginning of the motion.

        Parameters
        ----------
        path : str or Path
            PNG, SVG or PDF, by its suffix.

        Raises
        ------
        SinkError
            The file cannot be written.
        """
        fig = package("matplotlib.figure", "a picture").Figure(figsize=(7, 5), layout="constrained")
        self.draw(*fig.subplots(2, 1, sharex=True, height_ratios=(3, 1)))
        with said_as(SinkError, f"cannot write the picture {path}", OSError, ValueError):
            fig.savefig(path, dpi=110)

    def draw(self, ax: Any, below: Any, label: str = "recorded", color: str = "C0") -> None:
        """Draw the forces into one axes and the relative errors (percent) into another.

        Parameters
        ----------
        ax, below : matplotlib.axes.Axes
        label, color : str
        """
        since = self.t - self.t[max(_first_motion(self.y, self.onset) - 1, 0)]
        shown = since > 0
        others = shown & ~self.used
        ax.plot(since[others], self.f[others], ".", ms=3, color=color, alpha=0.35)
        ax.plot(since[self.used], self.f[self.used], ".", ms=4, color=color, label=label)
        ax.plot(since[shown], self.fitted[shown], "-", lw=1, color="k", alpha=0.8)
        some = self.used & (self.f != 0)
        below.plot(since[some], 100 * self.relative, "-", lw=0.8, color=color)
        if since[shown][-1] > 100 * since[shown][0]:
            ax.set_xscale("log")
        if np.all(self.f[self.used] > 0) and self.f[self.used].max() > 2 * self.f[self.used].min():
            ax.set_yscale("log")
        ax.set(ylabel="force")
        below.set(xlabel="time since the motion began / s", ylabel="error / %")
        for a in (ax, below):
            a.grid(alpha=0.3, which="both")
        ax.legend(loc="best")


@dataclass(frozen=True, eq=False, repr=False)
class SpringpotFit(MaterialFit):
    """A springpot f = chi D^alpha y fitted to a recording; see ``MaterialFit``.

    ``scheme`` is that of the law that was fitted.
    """

    scheme: Scheme = "exact"

    @property
    def chi(self) -> float:
        """Coefficient chi, in the unit of f times s^alpha over the unit of y."""
        return self.values["chi"]

    @property
    def alpha(self) -> float:
        """Order alpha, from 0 (spring) to 1 (dashpot)."""
        return self.values["alpha"]

    def block(self, y: Block, **options) -> Block:
        """Return the fitted springpot as a block; y must be in m and f in N.

        Its scheme and onset are those of the fit, "l1" for the exact law: at even times
        that is the same force, except after ``onset="step"``.

        Parameters
        ----------
        y : Block
            Position in m.
        **options
            Other options of ``stimlib.blocks.springpot``.

        Returns
        -------
        Block
            Force in N.
        """
        from ..blocks.fractional import springpot

        law = {"scheme": "l1" if self.scheme == "exact" else self.scheme, "onset": self.onset}
        return springpot(y, self.chi, self.alpha, **law | options)


@dataclass(frozen=True, eq=False, repr=False)
class MaxwellFit(MaterialFit):
    """A spring with Maxwell arms fitted to a recording; see ``MaterialFit``.

    ``values`` contains k0, k1, tau1, k2, .. with rising time constants.
    """

    @property
    def k0(self) -> float:
        """Stiffness of the spring; 0 if the model has none."""
        return self.values.get("k0", 0.0)

    @property
    def arms(self) -> list[tuple[float, float]]:
        """Pairs (stiffness, time constant in s), one for each arm."""
        n = sum(name.startswith("tau") for name in self.values)
        return [(self.values[f"k{i}"], self.values[f"tau{i}"]) for i in range(1, n + 1)]

    def block(self, y: Block, **options) -> Block:
        """Return the fitted model as a block; y must be in m and f in N.

        Parameters
        ----------
        y : Block
            Position in m.
        **options
            Options of ``stimlib.blocks.viscoelastic.generalized_maxwell``.

        Returns
        -------
        Block
            Force in N.
        """
        from ..blocks.viscoelastic import generalized_maxwell

        return generalized_maxwell(y, self.k0, self.arms, **{"onset": self.onset} | options)


@public
def fit_springpot(
    t: ArrayLike,
    y: ArrayLike,
    f: ArrayLike,
    *,
    where=None,
    sigma=None,
    onset: Onset = "steady",
    scheme: Scheme = "exact",
) -> SpringpotFit:
    """Fit the order and coefficient of a springpot to a recorded motion and force.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times in s, rising, with any spacing, beginning before the motion.
    y : array_like, shape (n,)
        Displacement, in m if the result is to become a stimulus.
    f : array_like, shape (n,)
        Force, in N if the result is to become a stimulus.
    where : array_like of bool, shape (n,), optional
        Samples to fit, such as those of the hold only; earlier motion still has its
        effect. By default, all samples after the motion has begun.
    sigma : float, (float, float), array_like of shape (n,), or a word
        Noise of the force, by its standard deviation: a number in the unit of f; such a
        number and a part of the force, such as (0.01, 0.02) for 10 mN and 2 %; or one
        for each sample.  Only ratios between samples matter, as the size is taken from
        the residuals, so "absolute" stands for the same noise in all samples, and
        "relative" for one in proportion to the force.  By default "relative" if the
        force keeps its sign in the samples to fit, otherwise "absolute".
    onset : {"steady", "step"}
        Whether y was at its first value before t[0], or jumps there from 0 at t[0].
    scheme : {"exact", "l1", "gl"}
        Law that is fitted: the exact one, for measured forces; or at even times that of
        a block ``springpot`` with this scheme, for forces that it computed.  "l1"
        differs from "exact" only after ``onset="step"``; "gl" is late by alpha/2
        samples.

    Returns
    -------
    SpringpotFit
        With ``chi``, ``alpha``, confidence intervals, residuals, ``plot`` and
        ``block``.

    Raises
    ------
    BadValue
        Times that do not rise, NaN or infinity, different lengths, fewer than 3 samples
        to fit, a force of 0 with relative errors, a position that never moves, times
        that are not even with "l1" or "gl", or too many at uneven times (``thin``
        them).

    Warns
    -----
    RuntimeWarning
        Relative errors of a force that changes its sign; an exact law where "gl" leaves
        less than half of the error, as the force of such a block does; a model that
        leaves half of the force, or 5 % of it with alpha at the end of its range.

    Notes
    -----
    At even times each order that is tried costs a convolution by FFT, and 11 to 16 are
    tried; for the exact law as many again, to compare it with ``scheme="gl"``.  100 000
    samples take about 0.7 s of one core, a million 11 s and 1.2 GB: ``thin`` them if
    that is too long.

    References
    ----------
    Çaldıran's thesis, eq. (2.8) and section 1.1.1.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.fitting import fit_springpot, springpot_force
    >>> t = np.r_[0.0, np.geomspace(1e-3, 100, 80)]
    >>> y = np.minimum(0.05 * t, 0.01)  # 1 cm in 0.2 s, then held
    >>> noise = 1 + 0.01 * np.random.default_rng(1).standard_normal(t.size)
    >>> fit = fit_springpot(
    ...     t, y, springpot_force(t, y, 300.0, 0.2) * noise, where=t > 0.2
    ... )
    >>> fit
    SpringpotFit(chi=299.5 [298.4, 300.6], alpha=0.1998 [0.1986, 0.2009];
    0.72 % rms of 43 samples)
    """
    t, y, f = signals_at(t, y, f)
    used, noise = _use("fit_springpot", t, y, f, where, sigma, onset, 3)
    step, some = even_step(t), np.flatnonzero(used)
    if scheme != "exact" and not step:
        raise BadValue(
            f"fit_springpot: scheme={scheme!r} is of even times, and the steps of t are from"
            f" {np.diff(t).min():g} to {np.diff(t).max():g} s; give t of one step, or"
            " scheme='exact'"
        )
    sampled = step and (scheme != "exact" or onset == "steady")
    if not sampled and some.size * t.size > PAIRS:
        raise BadValue(
            f"fit_springpot: {some.size} samples to fit and {t.size - 1} straight pieces are"
            " too many pairs; average them first: t, y, f = thin(t, y, f, start=...)"
        )

    def law(some: np.ndarray, scheme: str) -> Callable[[float], tuple[np.ndarray, np.ndarray]]:
        if sampled:
            return Sampled(step, y, some, "gl" if scheme == "gl" else "l1", onset)
        return Pairs(t, y, some, onset)

    first = _springpot(law(some, scheme), f[used], noise)
    if first is None:
        raise BadValue(
            "fit_springpot: the force is not along the motion (chi would be below 0); is one of the"
            " signs reversed?"
        )
    chi, alpha, slopes, miss = first
    if scheme == "exact" and sampled and miss @ miss > ROUNDING:
        other = _springpot(law(some, "gl"), f[used], noise, ROUGHLY)
        if other is not None and other[-1] @ other[-1] < FEWER * (miss @ miss):
            warnings.warn(
                "fit_springpot: this is the force of a sampled springpot: scheme='gl' leaves an"
                f" error of {np.linalg.norm(other[-1]):.2g} of it, and the exact law"
                f" {np.linalg.norm(miss):.2g}; give scheme='gl'",
                RuntimeWarning,
                stacklevel=outside(),
            )
    _doubt("fit_springpot", miss, _end(alpha, slopes, miss))
    low, high = _intervals(np.array([math.log(chi), alpha]), slopes, miss)
    whole = (
        chi * law(np.arange(t.size), scheme)(alpha)[0]
        if sampled
        else springpot_force(t, y, chi, alpha, onset=onset)
    )
    return SpringpotFit(
        {"chi": chi, "alpha": alpha},
        {
            "chi": (_exp(low[0]), _exp(high[0])),
            "alpha": (max(float(low[1]), 0.0), min(float(high[1]), 1.0)),
        },
        t,
        y,
        f,
        whole,
        used,
        onset,
        scheme,
    )


def _springpot(
    model: Callable[[float], tuple[np.ndarray, np.ndarray]],
    f: np.ndarray,
    noise: Callable[[np.ndarray], np.ndarray],
    left: float = LEFT,
) -> Place | None:
    """Return chi, alpha, the slopes by log(chi) and alpha, and the weighted misses.

    For each alpha the best chi is known, so what is searched is one number: where the
    slope of the squares along alpha changes its sign.
    """
    known = cache(model)
    weight, places = noise(f), ALPHAS
    for _ in range(2):  # by the noise of the recorded forces, and then by that of the fitted ones
        target = f * weight

        def best(alpha, weight=weight, target=target):
            value, by = known(alpha)
            unit = value * weight
            chi = max(float(unit @ target / (unit @ unit)), 0.0) if unit.any() else 0.0
            slopes = chi * np.stack([unit, by * weight])
            return chi, alpha, slopes.T, chi * unit - target

        ends = [best(alpha) for alpha in places]
        slope = [float(one[2][:, 1] @ one[-1]) for one in ends]
        valleys = [
            _bottom(best, low, high, left)
            for low, high, down, up in zip(ends, ends[1:], slope, slope[1:], strict=False)
            if down <= 0 <= up
        ]
        along = [one for one in (*valleys, *ends) if one[0] > 0]
        if not along:
            return None
        found = min(along, key=lambda one: float(one[-1] @ one[-1]))
        before, weight = weight, noise(found[0] * known(found[1])[0])
        if np.array_equal(before, weight):
            break
        places = tuple(sorted({*ALPHAS, found[1]}))
    return found


def _bottom(best: Callable[[float], Place], low: Place, high: Place, left: float) -> Place:
    """Return where the slope of the squares along alpha is 0, between two places.

    Gauss-Newton steps with the best chi of each alpha lead near it, and secants from
    there; a step out of the bracket is replaced by its middle.
    """
    one = first = min(low, high, key=lambda one: float(one[-1] @ one[-1]))
    a, b, before = low[1], high[1], (math.inf, 0.0)
    for _ in range(STEPS if first[0] else 0):
        chi, alpha, slopes, miss = one
        unit, by = slopes.T
        slope, bend, error = float(by @ miss), 0.0, 0.0
        if chi:
            bend = float(by @ by) - float(unit @ by) ** 2 / float(unit @ unit)
            error = left * math.sqrt(float(miss @ miss) / miss.size / bend) if bend > 0 else 0.0
        else:  # the motion of such an order would be against the force: back
            slope = alpha - first[1]
        if abs(alpha - before[0]) < SHORT and chi and (slope - before[1]) * (alpha - before[0]) > 0:
            bend = (slope - before[1]) / (alpha - before[0])
        a, b = (alpha, b) if slope <= 0 else (a, alpha)
        step = -slope / bend if bend > 0 else math.inf
        if not slope or min(abs(step), b - a) <= max(error, LEAST):
            break
        before = (alpha, slope) if chi else (math.inf, 0.0)
        one = best(alpha + step if a < alpha + step < b else (a + b) / 2)
    return one


def _end(alpha: float, slopes: np.ndarray, miss: np.ndarray) -> str:
    """Return what to say of an order at 0 or 1, unless noise may hold it there."""
    unit, by = slopes.T
    bend = float(by @ by) - float(unit @ by) ** 2 / float(unit @ unit)
    beyond = (1 - 2 * alpha) * float(by @ miss)  # the slope out of the range
    held = beyond > BEYOND * math.sqrt(max(bend, 0.0) * float(miss @ miss) / (miss.size - 2))
    return f"alpha = {alpha:g} is the end of its range, and " if held and alpha in (0, 1) else ""


def _doubt(name: str, miss: np.ndarray, end: str) -> None:
    """Warn where a model explains little, with the likely cause."""
    error = float(np.linalg.norm(miss))
    if error > LITTLE or (end and error > SOME):
        warnings.warn(
            f"{name}: {end}the model leaves {100 * error:.2g} % of the force (weighted rms): are"
            " y and f exchanged (y is the position), do they start at other times, or is noise as"
            " large? Else it is another material: look at plot(), and fit another model",
            RuntimeWarning,
            stacklevel=outside(),
        )


@public
def fit_generalized_maxwell(
    t: ArrayLike,
    y: ArrayLike,
    f: ArrayLike,
    *,
    arms: Count,
    spring: bool = True,
    where=None,
    sigma=None,
    onset: Onset = "steady",
) -> MaxwellFit:
    """Fit a generalized Maxwell model to a recorded motion and force.

    The fitted numbers are stiffnesses and time constants.

    Parameters
    ----------
    t, y, f, where, sigma, onset
        See ``fit_springpot``; y is 0 where the spring exerts no force.
    arms : int
        Number of Maxwell arms.  A recording determines about one arm per decade of
        time.
    spring : bool
        Whether there is a spring parallel to the arms, so that part of the force never
        relaxes.

    Returns
    -------
    MaxwellFit
        With ``k0``, ``arms``, confidence intervals, residuals, ``plot`` and ``block``.

    Raises
    ------
    BadValue
        As ``fit_springpot``; arms below 1; fewer samples to fit than there are numbers
        in the model.

    Warns
    -----
    RuntimeWarning
        A model that leaves half of the force, or 5 % of it and no arm has a part.

    Notes
    -----
    All numbers are fitted as logarithms.  An interval that reaches infinity means that
    the recording does not determine that number.

    References
    ----------
    Çaldıran's thesis, section 2.1 and fig. 2.1.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.fitting import fit_generalized_maxwell, maxwell_force
    >>> t = np.r_[0.0, np.geomspace(1e-3, 100, 80)]
    >>> y = np.minimum(0.05 * t, 0.01)
    >>> fit = fit_generalized_maxwell(
    ...     t, y, maxwell_force(t, y, 100.0, [(50.0, 0.1), (30.0, 5.0)]), arms=2
    ... )
    >>> round(fit.k0, 6), [(round(k, 6), round(tau, 6)) for k, tau in fit.arms]
    (100.0, [(50.0, 0.1), (30.0, 5.0)])
    """
    t, y, f = signals_at(t, y, f)
    n = int(spring)
    used, noise = _use("fit_generalized_maxwell", t, y, f, where, sigma, onset, 2 * arms + n + 1)
    elastic = y[used][:, None][:, :n]
    since = t[used] - t[max(_first_motion(y, onset) - 1, 0)]
    shortest = max(float(since.min()), float(np.diff(t).min()))
    longest = float(since.max())
    # further out an arm is a spring or a dashpot to 1e-6, and its time cannot be told
    wide = math.log(longest / shortest) / 2 + math.log(1e6)
    middle = math.log(longest * shortest) / 2

    @lru_cache(maxsize=2)
    def unit(*logs):
        value, by = arm_forces(t, y, np.exp(logs), onset)
        return np.concatenate([elastic, value[used]], axis=1), by[used]

    def searched(x, weight):
        top = math.log(float(np.exp(x[: n + arms]).sum()))
        edges = (
            [top - 25.0] * (n + arms) + [middle - wide] * arms,
            [top + 25.0] * (n + arms) + [middle + wide] * arms,
        )

        def miss(x):
            return (unit(*x[n + arms :])[0] @ np.exp(x[: n + arms]) - f[used]) * weight

        def slope(x):
            value, by = unit(*x[n + arms :])
            k = np.exp(x[: n + arms])
            return np.concatenate([value * k, by * k[n:]], axis=1) * weight[:, None]

        return scipy.optimize.least_squares(
            miss,
            np.clip(x, *edges),
            slope,
            edges,
            x_scale="jac",
            ftol=1e-13,
            xtol=1e-13,
            gtol=1e-13,
            max_nfev=400,
        )

    best, weight = None, noise(f[used])
    for margin, floor in ((0.5, 1e-3), (0.5, 0.1), (0.2, 1e-2), (0.02, 0.1), (1.5, 1e-2)):
        first, last = (
            shortest * (longest / shortest) ** (margin / arms / 2),
            longest * (shortest / longest) ** (margin / arms / 2),
        )
        logs = (
            np.linspace(math.log(first), math.log(last), arms)
            if arms > 1
            else np.array([(math.log(first * last)) / 2])
        )
        k = scipy.optimize.nnls(unit(*logs)[0] * weight[:, None], f[used] * weight)[0]
        if not k.any():
            continue
        found = searched(
            np.concatenate([np.log(np.maximum(k, floor * float(k.sum()))), logs]), weight
        )
        if best is None or found.cost < best.cost * (1 - 1e-9):
            best = found
    if best is None:
        raise BadValue(
            "fit_generalized_maxwell: the force is not along the motion; is one of the signs"
            " reversed?"
        )
    fitted = unit(*best.x[n + arms :])[0] @ np.exp(best.x[: n + arms])
    best = searched(best.x, noise(fitted))
    k = np.exp(best.x[: n + arms])
    end = "no arm has a part of the force, and " if k[n:].sum() < 1e-9 * k.sum() else ""
    _doubt("fit_generalized_maxwell", best.fun, end)
    low, high = _intervals(best.x, best.jac, best.fun)
    order = np.argsort(best.x[n + arms :], kind="stable")
    places = {"k0": 0} if spring else {}
    for i, at in enumerate(order.tolist(), 1):
        places |= {f"k{i}": n + at, f"tau{i}": n + arms + at}
    values = {name: math.exp(best.x[at]) for name, at in places.items()}
    intervals = {name: (_exp(low[at]), _exp(high[at])) for name, at in places.items()}
    found_arms = [(values[f"k{i}"], values[f"tau{i}"]) for i in range(1, arms + 1)]
    fitted = maxwell_force(t, y, values.get("k0", 0.0), found_arms, onset=onset)
    return MaxwellFit(values, intervals, t, y, f, fitted, used, onset)


def _first_motion(y: np.ndarray, onset: str) -> int:
    """Return the index of the first sample at which the model can respond."""
    moved = np.flatnonzero(np.diff(y))
    if onset == "step" and y[0] != 0:
        return 1
    return int(moved[0]) + 1 if moved.size else y.size


def _use(
    name: str, t, y, f, where, sigma, onset: str, least: int
) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Return the samples to fit, and the weights of errors as a function of force."""
    first = _first_motion(y, onset)
    if first == y.size:
        raise BadValue("the position y never moves: there is nothing that a force could answer")
    for what, sizes in (("y", y), ("f", f), ("steps of t", np.diff(t)), ("t", t - t[0])):
        size = float(np.abs(sizes).max())
        if size and not 1 / LARGEST <= size <= LARGEST:
            raise BadValue(
                f"{what} of up to {size:g}: give it in another unit, so that sums of squares exist"
            )
    if where is None:
        used = np.arange(t.size) >= first
    else:
        used = np.array(where)
        if used.dtype != bool or used.shape != t.shape:
            raise BadValue(f"where must be {t.size} values True or False, such as t > 2.1")
        if onset == "step" and y[0] != 0 and used[0]:
            raise BadValue(
                "where: at the moment of the step, t[0], the force is not finite; leave that"
                " sample out"
            )
        if not np.any(used & (np.arange(t.size) >= first)):
            raise BadValue("where: none of these samples is after the motion has begun")
    if used.sum() < least:
        raise BadValue(
            f"{counted(int(used.sum()), 'sample')} to fit: not enough for this model; give at"
            f" least {least}"
        )
    if not f[used].any():
        raise BadValue("the force f is 0 at all samples to fit")
    return used, _noise(name, t, f, used, sigma)


def _noise(name: str, t, f, used, sigma) -> Callable[[np.ndarray], np.ndarray]:
    """Return the weights of errors as a function of the force, by the stated noise."""
    forces = f[used]
    mixed = np.ptp(np.sign(forces)) > 0
    if sigma is None:
        sigma = "absolute" if mixed else "relative"
    parts = {"relative": (0.0, 1.0), "absolute": (1.0, 0.0)}
    if isinstance(sigma, str):
        if sigma not in parts:
            raise BadValue(
                f"sigma = {sigma!r}; choose 'relative', 'absolute' or give standard deviations"
            )
        sigma = parts[sigma]
    elif np.ndim(sigma) == 0:
        sigma = (sigma, 0.0)
    pair = isinstance(sigma, tuple) and len(sigma) == 2
    given = _deviations(sigma, 2 if pair else t.size)
    if pair:
        same, part = given.tolist()
        if min(same, part) < 0 or same + part == 0:
            raise BadValue(f"sigma = {sigma} must not be below 0, nor both numbers 0")
        same, part = _scaled(given, given).tolist()
        sizes = np.hypot(same, part * f)
        if mixed and not same and sizes[used].all():
            turns = int(np.count_nonzero(np.diff(np.sign(forces))))
            warnings.warn(
                f"{name}: the force changes its sign {counted(turns, 'time')}, where relative"
                " errors have no"
                " bound; state the noise, such as sigma=0.01 for 0.01 N, or sigma=(0.01, 0.02) for"
                " 0.01 N and 2 %",
                RuntimeWarning,
                stacklevel=outside(),
            )
    else:
        same, part, sizes = 0.0, 0.0, _scaled(given, given[used])
    least = float(sizes[used].max()) / LARGEST
    if not np.all(sizes[used] > least):
        i = int(np.flatnonzero(used & ~(sizes > least))[0])
        what = (
            f"f[{i}] = {f[i]:g}: its relative error has no meaning"
            if part
            else f"sigma[{i}] = {given[i]:g} is not above 0, nor above 1e-50 of the largest"
        )
        raise BadValue(f"{what}; leave that sample out with where, or use sigma='absolute'")

    def weights(force: np.ndarray) -> np.ndarray:
        size = np.maximum(np.abs(force), NEAR * np.abs(forces))
        scale = np.hypot(same, part * size) if same or part else sizes[used]
        return 1 / (scale * np.linalg.norm(forces / scale))

    return weights


def _deviations(sigma, n: int) -> np.ndarray:
    """Return n standard deviations, or raise BadValue."""
    try:
        given = np.array(sigma, float)
    except (TypeError, ValueError):
        raise BadValue("sigma must be numbers, or a word") from None
    if given.shape != (n,):
        raise BadValue(
            f"sigma has shape {given.shape}, and there are {n} samples; give one for each, of one"
            " length, or one or two numbers"
        )
    if not np.isfinite(given).all():
        raise BadValue(f"sigma[{int(np.argmin(np.isfinite(given)))}] is not finite")
    return given


def _scaled(sizes: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Return sizes, of which only ratios matter, with the largest of some near 1."""
    return np.ldexp(sizes, -np.frexp(some.max())[1])


def _intervals(
    x: np.ndarray, jacobian: np.ndarray, miss: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the 95 % confidence intervals x -+ t s.

    s^2 is the diagonal of (J' J)^-1 times the variance of the errors.
    """
    free = miss.size - x.size
    scale = np.hypot.reduce(jacobian)  # of tiny ones, whose squares vanish, too
    scale[scale == 0] = 1.0
    _, s, v = np.linalg.svd(jacobian / scale, full_matrices=False)
    # the other directions make no difference to the fit, and whatever has a part in
    # them is unknown
    known = s > 1e-12 * s[0]
    deviation = (
        np.sqrt(np.sum((v[known] / s[known, None]) ** 2, axis=0) * (miss @ miss) / free) / scale
    )
    wide = scipy.stats.t.ppf((1 + CONFIDENCE) / 2, free) * deviation
    wide[np.any(np.abs(v[~known]) > 1e-6, axis=0)] = math.inf
    return x - wide, x + wide


def _exp(x: float) -> float:
    return math.exp(x) if x < 700 else math.inf
