"""Likelihood-ratio tests between fits of psychometric functions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..errors import BadValue, counted, public
from .fits import Fit

ROUNDED = 1e-11  # the same between fits, whose levels may have gone through a logarithm
SAME_FIT = 1e-2  # twice a difference in log-likelihood that the search may leave


@dataclass(frozen=True)
class LikelihoodRatio:
    """A comparison of two models of the same answers.

    Attributes
    ----------
    statistic : float
        Twice the gain in log-likelihood.
    df : int
        How many more parameters the fuller model has.
    p : float
        How often chance gains as much where the simpler model is true.
    """

    statistic: float
    df: int
    p: float


@public
def likelihood_ratio(simple: Iterable[Fit], full: Iterable[Fit]) -> LikelihoodRatio:
    """Compare a model with a fuller one that contains it, over the same answers.

    For instance one curve for two conditions with one for each, or no lapses with
    lapses that are fitted.  One curve for both means one threshold and one slope: the
    test does not say which of them differs, for which `Fit.pse_interval` and
    `Fit.sigma_interval` are a guide.

    Parameters
    ----------
    simple, full : iterable of Fit
        All fits of each model.

    Returns
    -------
    LikelihoodRatio
        p is by chi squared; where the fuller model is overdispersed, by F, of the
        statistic divided by ``df`` and by the dispersion of its fits.

    Raises
    ------
    BadValue
        The answers differ, or the fuller model has no more parameters or a lower
        log-likelihood, as where its shared rate was fitted to other sets as well.

    References
    ----------
    McCullagh and Nelder (1989), Generalized Linear Models, sections 4.4.3 and 4.5.

    Examples
    --------
    >>> from stimlib.experiments import likelihood_ratio, psychometric
    >>> levels, asked = [1.0, 1.5, 2.0, 2.5, 3.0], [20] * 5
    >>> soft, hard = [1, 4, 9, 17, 19], [0, 1, 3, 10, 17]
    >>> each = [psychometric(levels, yes, asked) for yes in (soft, hard)]
    >>> both = psychometric(2 * levels, soft + hard, 2 * asked)
    >>> likelihood_ratio([both], each).p < 0.001
    True
    """
    one, other = list(simple), list(full)
    if wrong := [fit for fit in (*one, *other) if not isinstance(fit, Fit)]:
        raise BadValue(f"likelihood_ratio: {wrong[0]!r:.80} is no Fit; give lists of fits")
    before, after = _pooled(one), _pooled(other)
    if len(before) != len(after) or not np.allclose(before, after, rtol=ROUNDED, atol=0.0):
        raise BadValue("likelihood_ratio: both models must be fitted to the same answers")
    # a shared rate counts once for each call that fitted it
    counts = [
        sum(fit.parameters for fit in fits)
        + sum({fit.method and fit.method[-1]: fit.shared for fit in fits}.values())
        for fits in (one, other)
    ]
    df = counts[1] - counts[0]
    if df < 1:
        raise BadValue(
            f"likelihood_ratio: {counted(counts[1], 'parameter')} of the fuller model must be more"
            f" than the {counts[0]} of the simpler one"
        )
    gain = 2 * (sum(fit.loglik for fit in other) - sum(fit.loglik for fit in one))
    if gain < -SAME_FIT:
        raise BadValue(
            f"likelihood_ratio: the log-likelihood of the fuller model is {-gain / 2:.2g} below"
            " that of the simpler one, so it does not contain it; fit shared rates to the same"
            " sets in both"
        )
    gain = max(gain, 0.0)
    free = [(v.levels - v.parameters, v.dispersion) for v in other if math.isfinite(v.dispersion)]
    left = sum(k for k, _ in free)
    scatter = sum(k * v for k, v in free) / left if left else 1.0
    p = (
        scipy.stats.f.sf(gain / df / scatter, df, left)
        if scatter > 1
        else scipy.stats.chi2.sf(gain, df)
    )
    return LikelihoodRatio(gain, df, float(p))


def _pooled(fits: Sequence[Fit]) -> list[list[float]]:
    """Return each level of all fits, how many said yes there, and were asked.

    Levels that differ by rounding, as those of two staircases in dB, are one.
    """
    found: list[list[float]] = []
    before = -math.inf
    for level, yes, asked in sorted(row for fit in fits for row in fit.data):
        if level - before > ROUNDED * abs(level):
            found.append([level, 0, 0])
        found[-1][1] += yes
        found[-1][2] += asked
        before = level
    return found
