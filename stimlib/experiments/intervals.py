"""Intervals of fitted psychometric functions: profile likelihood and bootstrap."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue, public
from .goodness import allowed
from .likelihood import (
    NEAR,
    PROBIT,
    Array,
    Found,
    Model,
    Sets,
    curve,
    ends,
    maximum,
    middle_of,
    numbers,
    probability,
    subset,
    total,
)

RESAMPLES = 2000  # fits of a bootstrap


class Options(NamedTuple):
    """How to fit, beside the model."""

    log: bool
    dispersion: float | None
    interval: str
    confidence: float
    seed: int
    unit: str


def intervals_of(
    sets: Sets, model: Model, falls: Array, how: Options, best: Found, part: float = 0.5
) -> Array:
    """Return the ends of the level of a part of the curve, and of sigma, on the axis.

    Of each set, as `profile`; nan without intervals.
    """
    if how.interval == "profile":
        return profiled(sets, model, falls, part, best)
    around = np.full((2, 2, falls.size), math.nan)
    if how.interval == "none":
        return around
    middle = middle_of(sets, model)
    at, spread = middle + (curve(model.link).inverse(part) - best.a) / best.b, 1 / best.b
    wider = np.sqrt(falls / allowed(math.nan, 0, how.confidence))
    for i, asked in enumerate(sets.n > 0):  # a set without what fills it up
        one = Sets(*(v[i][asked] for v in sets))
        level, sigma = bootstrap(one, model, how.confidence, how.seed, part=part)
        around[0, :, i] = at[i] + wider[i] * (level - at[i])
        around[1, :, i] = spread[i] * (sigma / spread[i]) ** wider[i]
    return around


@public
def profile(
    sets: Sets,
    model: Model = PROBIT,
    confidence: float = 0.95,
    fall: ArrayLike | None = None,
    part: float = 0.5,
) -> Array:
    """Return profile-likelihood intervals of many sets at once.

    Parameters
    ----------
    sets : Sets
        Of shape (.., levels); no set separated.
    model : Model
    confidence : float
    fall : array_like, shape (..), optional
        How far twice the log-likelihood falls to the end of an interval; by default the
        quantile of chi squared.
    part : float
        The part of the way up, between guesses and lapses, of the level whose ends are
        looked for: 1/2 is the PSE.

    Returns
    -------
    ndarray, shape (2, 2, ..)
        Lower and upper end of the PSE, or of that level, and of sigma (positive slopes
        only).

    References
    ----------
    Venzon and Moolgavkar (1988), Applied Statistics 37:87.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments import profile
    >>> from stimlib.experiments.likelihood import Sets
    >>> profile(
    ...     Sets(np.arange(5.0), np.array([1, 4, 9, 17, 19]), np.full(5, 20))
    ... ).round(3)
    array([[1.627, 2.365],
           [0.867, 1.647]])
    """
    each = np.broadcast_arrays(*sets)
    shape, sets = each[0].shape[:-1], Sets(*(v.reshape(-1, v.shape[-1]) for v in each))
    fall = allowed(math.nan, 0, confidence) if fall is None else numbers("profile: fall", fall)
    if fall.ndim and fall.shape != shape or not (fall > 0).all():
        raise BadValue(
            f"profile: fall, of shape {fall.shape}, must be above 0, and one number or one for each"
            f" set: {shape}"
        )
    best = maximum(sets, middle_of(sets, model), model)
    fall = np.broadcast_to(fall, shape).ravel()
    return profiled(sets, model, fall, part, best).reshape(2, 2, *shape)


def profiled(sets: Sets, model: Model, fall: Array, part: float, best: Found) -> Array:
    """Return profile-likelihood intervals, (2, 2, sets), about known maxima."""
    middle, up, z = middle_of(sets, model), quantile(model, part), np.sqrt(fall)
    several = bool(model.guess or model.lapse)
    both = np.repeat([-1.0, 1.0], middle.size)  # the lower ends of all sets, then the upper ones
    peaks, z, middles = Found(*(np.tile(v, 2) for v in best)), np.tile(z, 2), np.tile(middle, 2)
    twice = subset(sets, np.tile(np.arange(middle.size), 2))
    width = np.sqrt(total(sets.n * (sets.x - middle[:, None]) ** 2) / total(sets.n)) / 8

    # from there on a curve is a step, and its slope is rounding
    with np.errstate(divide="ignore"):
        steepest = np.tile(np.minimum(60.0, np.log(1e9 / width)), 2)

    def found(start: Array, step: Array, hold: Callable[[Array, Array], dict[str, Array]]) -> Array:
        """Return the ends along one way to hold a parameter."""
        last = Found(*(v.copy() for v in peaks))

        def fell(k: Array) -> Array:
            """Return how far the profile has fallen, which is nearly straight."""
            return np.sqrt(2 * np.maximum(peaks.loglik[k] - last.loglik[k], 0.0)) - z[k]

        def fallen(x: Array, k: Array, search: bool) -> Array:
            """Return `fell` at a place of each row."""
            now = None if search and not several else Found(*(v[k] for v in last))
            at = dict(c=middles[k]) | hold(x, k)
            least = maximum(subset(twice, k), model=model, start=now, search=search, **at)
            for v, new in zip(last, least, strict=True):
                v[k] = new
            return fell(k)

        at = ends(lambda x, k: fallen(x, k, False), start, step)
        # where another peak is higher there, the end is further away; of one peak,
        # one at a jump is none: a climb from where no answer is in doubt goes nowhere
        k = np.flatnonzero(np.isfinite(at))
        k = k[several | (np.abs(fell(k)) > NEAR)]
        k = k[fallen(at[k], k, True) < -NEAR] if k.size else k
        if k.size:
            for v, peak in zip(last, peaks, strict=True):
                v[k] = peak[k]
            at[k] = ends(lambda x, rows: fallen(x, k[rows], True), start[k], step[k])
        return at

    # over the logarithm of the slope, and over the level
    logs = found(
        np.log(np.abs(peaks.b)),
        -0.2 * both,
        lambda logs, k: dict(b=np.exp(np.clip(logs, -60, steepest[k]))),
    )
    sigmas = np.exp(-logs)
    if model.pse is not None:  # then the level goes with sigma
        away = up * sigmas if up else np.zeros(sigmas.shape)
        levels = np.sort(model.pse + away.reshape(2, -1), axis=0).ravel()
    else:
        start = np.tile(middle + (up - best.a) / best.b, 2)
        levels = found(
            start, both * np.tile(width, 2), lambda m, k: dict(c=m, a=np.full(m.shape, up))
        )
    return np.stack([levels, sigmas]).reshape(2, 2, -1)


@public
def bootstrap(
    sets: Sets,
    model: Model = PROBIT,
    confidence: float = 0.95,
    seed: int = 0,
    n: int = RESAMPLES,
    part: float = 0.5,
) -> Array:
    """Return parametric-bootstrap percentiles of the fit to one set of answers.

    Each simulated set has the same levels.

    Parameters
    ----------
    sets : Sets
        Of shape (levels,).
    model, confidence
        As `profile`.
    seed : int
    n : int
        How many.
    part : float
        As `profile`.

    Returns
    -------
    ndarray, shape (2, 2)
        As `profile`.  A resample that is separated counts with the sigma of nearly 0
        that it has.

    References
    ----------
    Efron and Tibshirani (1993), An Introduction to the Bootstrap, section 13.3;
    Wichmann and Hill (2001), Perception and Psychophysics 63:1314.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments import bootstrap
    >>> from stimlib.experiments.likelihood import Sets
    >>> bootstrap(
    ...     Sets(np.arange(5.0), np.array([1, 4, 9, 17, 19]), np.full(5, 20)), n=200
    ... ).round(1)
    array([[1.6, 2.4],
           [0.8, 1.5]])
    """
    if not 0 < confidence < 1 or seed < 0 or n < 1:
        raise BadValue(
            f"bootstrap: confidence = {confidence}, seed = {seed}, n = {n} must be within 0 .. 1, 0"
            " or above, above 0"
        )
    middle, up = float(np.average(sets.x, weights=sets.n)), quantile(model, part)
    middle = middle if model.pse is None else model.pse
    found = maximum(sets, middle, model)
    eta = found.a + found.b * (sets.x - middle)
    p = probability(eta, model.link, found.guess, found.lapse)[0]
    drawn = np.random.default_rng(seed).binomial(sets.n.astype(int), p, (n, p.size)).astype(float)
    fits = maximum(sets._replace(yes=drawn), middle, model)
    with np.errstate(divide="ignore", invalid="ignore"):
        # of a flat resample at one half any PSE is as likely
        away = np.where(fits.a == up, 0.0, (up - fits.a) / fits.b)
        each = np.stack([middle + away, 1 / np.abs(fits.b)])
    tail = (1 - confidence) / 2
    # infinities have no straight line between them
    low = np.quantile(each, tail, axis=1, method="lower")
    high = np.quantile(each, 1 - tail, axis=1, method="higher")
    with np.errstate(invalid="ignore"):
        found = np.quantile(each, [tail, 1 - tail], axis=1, method="median_unbiased").T
    return np.where(np.isnan(found), np.stack([low, high], axis=1), found)


def quantile(model: Model, part: float) -> float:
    """Return the link at a part of the way up, or raise BadValue."""
    if not isinstance(part, (int, float)) or not 0 < part < 1:
        raise BadValue(f"part = {part!r:.80} must be a number above 0 and below 1, such as 0.75")
    return float(curve(model.link).inverse(part))
