"""Goodness of fit of psychometric functions, and wider intervals by dispersion."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from .likelihood import (
    FREE,
    GUESSES,
    LAPSES,
    Array,
    Found,
    Model,
    Sets,
    curve,
    directions,
    probability,
    total,
)

DRAWS = 1000  # deviances of a goodness of fit
AT_ONCE = 2_000_000  # draws at levels that are kept at a time


def allowed(dispersion: ArrayLike, freedom: ArrayLike, confidence: float = 0.95) -> Array:
    """Return the drop in twice the log-likelihood at the ends of an interval.

    Parameters
    ----------
    dispersion : array_like
        The estimated dispersion, or nan.
    freedom : array_like
        Its degrees of freedom.
    confidence : float

    Returns
    -------
    ndarray
        The larger of the quantile of chi squared with one degree of freedom and
        ``dispersion`` times that of F.

    References
    ----------
    McCullagh and Nelder (1989), Generalized Linear Models, section 4.5.2.

    Examples
    --------
    >>> from stimlib.experiments.goodness import allowed
    >>> allowed([0.5, 2.0], 5).round(2)
    array([ 3.84, 13.22])
    """
    least = scipy.special.chdtri(1, 1 - confidence)
    freedom = np.asarray(freedom, float)
    with np.errstate(invalid="ignore"):
        scaled = np.asarray(dispersion) * scipy.special.fdtri(1, np.maximum(freedom, 1), confidence)
        return np.where((freedom > 0) & (scaled > least), scaled, least)


def dispersion(sets: Sets, c: ArrayLike, model: Model, found: Found) -> Array:
    """Return the ratio of the answers' variance about their curve to the binomial one.

    Parameters
    ----------
    sets : Sets
        Shape (.., levels); levels without trials count for nothing.
    c : array_like, shape (..)
        Where the intercept of ``found`` is taken.
    model : Model
    found : Found
        Its maximum.

    Returns
    -------
    ndarray, shape (..)
        Pearson's statistic over its degrees of freedom with Fletcher's correction,
        which holds at few answers a level too; nan without a degree of freedom.

    References
    ----------
    Fletcher (2012), Biometrika 99:230, eq. (5).

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments.goodness import dispersion
    >>> from stimlib.experiments.likelihood import PROBIT, Sets, maximum
    >>> sets = Sets(np.arange(5.0), np.array([9, 0, 9, 17, 13]), np.full(5, 20))
    >>> dispersion(sets, 2.0, PROBIT, maximum(sets, 2.0)).round(1)
    np.float64(7.0)
    """
    p, q = _chances(sets, c, model, found)[1:]
    asked, left = np.sum(sets.n > 0, axis=-1), sets.yes - sets.n * p
    freedom = asked - parameters(model)
    variance = np.maximum(sets.n, 1) * p * q
    pearson, bend = total(left**2 / variance), total((1 - 2 * p) * left / variance) / asked
    return np.where(freedom > 0, pearson / np.maximum(freedom, 1) / (1 + bend), np.nan)


def _chances(sets: Sets, c: ArrayLike, model: Model, found: Found) -> tuple[Array, Array, Array]:
    """Return the link, and the probabilities of yes and no, at each level of a fit."""
    a, b, lapse, guess = (np.asarray(v)[..., None] for v in found[:4])
    eta = a + b * (sets.x - np.asarray(c)[..., None])
    return eta, *probability(eta, model.link, guess, lapse)


def parameters(model: Model) -> int:
    """Return how many parameters are fitted to a set.

    Examples
    --------
    >>> from stimlib.experiments.goodness import parameters
    >>> from stimlib.experiments.likelihood import Model
    >>> parameters(Model()), parameters(Model(lapse="free"))
    (2, 3)
    """
    return 1 + (model.pse is None) + (model.lapse == FREE) + (model.guess == FREE)


def goodness(sets: Sets, c: float, model: Model, found: Found, seed: int = 0) -> float:
    """Return the share of simulated sets that deviate at least as much as this set.

    Each draw is fitted anew by one step of Fisher scoring.

    Parameters
    ----------
    sets : Sets
        Shape (levels,).
    c, model, found
        As `dispersion`.
    seed : int
        Seed of the 1000 simulated sets.

    Returns
    -------
    float
        p of the deviance.

    References
    ----------
    Davison and Hinkley (1997), Bootstrap Methods and their Application, section 7.2.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments.goodness import goodness
    >>> from stimlib.experiments.likelihood import PROBIT, Sets, maximum
    >>> sets = Sets(np.arange(5.0), np.array([9, 0, 9, 17, 13]), np.full(5, 20))
    >>> goodness(sets, 2.0, PROBIT, maximum(sets, 2.0)) < 0.01
    True
    """
    eta, p, q = _chances(sets, c, model, found)
    slope = (1 - found.guess - found.lapse) * curve(model.link).density(eta)
    free = (
        model.pse is None,
        True,
        model.lapse == FREE and bool(0 < found.lapse < LAPSES),
        model.guess == FREE and bool(0 < found.guess < GUESSES),
    )
    d = directions(sets.x - c, eta, slope, model, free)[list(free)]
    inverse = np.linalg.pinv((d * (sets.n / (p * q))) @ d.T, rcond=1e-12)
    # a table of counts is shorter than the draws, but where there are very many answers
    most, part = int(sets.n.max()) + 1, max(1, AT_ONCE // p.size)
    of = [v[:, None] for v in (sets.n, p, q)]
    table = _deviances(np.arange(most), *of) if most <= DRAWS else None
    at = most * np.arange(p.size)[:, None]
    rng, larger, own = np.random.default_rng(seed), 0, total(_deviances(sets.yes, sets.n, p, q))
    for left in range(DRAWS, 0, -part):
        drawn = rng.binomial(sets.n.astype(int), p, (min(part, left), p.size)).T.copy()
        score = (d / (p * q)) @ (drawn - (sets.n * p)[:, None])
        gained = np.sum(score * (inverse @ score), axis=0)
        each = _deviances(drawn, *of) if table is None else table.take(drawn + at)
        larger += int(np.sum(np.add.reduce(each, axis=0) - gained >= own))
    return (1 + larger) / (1 + DRAWS)


def best_possible(sets: Sets) -> float:
    """Return the log-likelihood of every level's own proportion."""
    return float(
        np.sum(
            scipy.special.xlogy(sets.yes, sets.yes / sets.n)
            + scipy.special.xlogy(sets.n - sets.yes, 1 - sets.yes / sets.n)
        )
    )


def _deviances(yes: Array, n: Array, p: Array, q: Array) -> Array:
    """Return what counts add to the deviance, at each level."""
    no = np.maximum(n - yes, 0.0)
    return 2 * (scipy.special.xlogy(yes, yes / (n * p)) + scipy.special.xlogy(no, no / (n * q)))


def highest_of_any(sets: Sets, low: float, high: float) -> Array:
    """Return an upper bound of the log-likelihood of curves, whatever their form.

    It is that of the proportions nearest to the answers that rise with the level, or
    fall, between a rate of guesses and 1 less one of lapses.

    Parameters
    ----------
    sets : Sets
        Shape (sets, levels); levels in order.
    low, high : float
        The least rates of guesses and lapses.

    Returns
    -------
    ndarray, shape (sets,)

    References
    ----------
    Ayer et al. (1955), Annals of Mathematical Statistics 26:641 (adjacent violators).

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments.goodness import highest_of_any
    >>> from stimlib.experiments.likelihood import Sets
    >>> sets = Sets(*np.array([[[1.0, 2.0, 3.0]], [[0, 2, 1]], [[2, 2, 2]]]))
    >>> highest_of_any(sets, 0.0, 0.0).round(3)  # of 0, 3/4 and 3/4
    array([-2.249])
    >>> highest_of_any(sets, 0.5, 0.3).round(3)  # of 0.5, 0.7 and 0.7
    array([-3.66])
    """
    best, fitted = np.empty(len(sets.n)), scipy.optimize.isotonic_regression
    for at, (yes, n) in enumerate(zip(sets.yes, sets.n, strict=True)):
        y, m = yes[n > 0], n[n > 0]
        ways = [fitted(y / m, weights=m, increasing=way).x for way in (True, False)]
        each = [np.clip(p, low, 1 - high) for p in ways]
        best[at] = max(
            np.sum(scipy.special.xlogy(y, p) + scipy.special.xlogy(m - y, 1 - p)) for p in each
        )
    return best
