"""What can be wrong with answers to which a psychometric function is fitted."""

from __future__ import annotations

import math

import numpy as np
import scipy

from .goodness import highest_of_any
from .likelihood import FREE, PROBLEMS as ESTIMATES, Array, Found, Model, Sets, maximum, subset

PROBLEMS = ESTIMATES | {
    "separated": (
        "no level has both answers but the one between: the slope is not determined, the {name} is"
        " {between}; add levels there, or trials"
    ),
    "falling": (
        "yes becomes rarer as the level rises: check whether the other answer should count as yes"
    ),
    "flat": (
        "the answers hardly depend on the level: the data allow a slope of 0, and any {name}; add"
        " levels further apart, or trials"
    ),
    "lapses": (
        "some answers far from the {name} fit no curve without lapses, and make this one too flat:"
        ' give lapse="free" to fit their rate, or a rate of your own'
    ),
    "guess": (
        "the answers {against}: give the chance level of the task as guess=, 0.5 where the right"
        " one of two intervals was to be found, or hand over the table of answers, which has it; in"
        " a comparison, add levels below the PSE"
    ),
    "overdispersed": (
        "the answers scatter about the curve more than answers of one probability for each level"
        " do (p = {p:.2g}): the participant may have changed between blocks, or the curve has"
        " another shape; intervals are wider by a factor of {wider:.2g} unless dispersion is given;"
        " look at the residuals over time, and try another link"
    ),
}
"""What can be wrong with a fit, and what to do; ``Fit.problems`` names them."""
SURE = 0.01  # how often chance alone names a problem
CHANCES = (0.0, 1 / 4, 1 / 3, 1 / 2)
"""Chance levels of common tasks, which a given one is tested against."""


# twice a difference of log-likelihoods, from which on chance level 1/2 fits about as
# well as a symmetric curve
AS_GOOD = -2.0
BEYOND = 4.0  # sigmas from the PSE, where nobody errs but by a lapse
Interval = tuple[float, float]


# What is wrong with it ----------------------------------------------------------------
def gap_of(sets: Sets, log: bool, guess: float | str | None) -> Interval:
    """Return the highest level with a no and the lowest with a yes, in order.

    With guesses, they are those below and above half-way.
    """
    some_no, some_yes = sets.x[sets.yes < sets.n], sets.x[sets.yes > 0]
    if not some_no.size or not some_yes.size:
        return math.nan, math.nan
    if isinstance(guess, float) and guess:
        above = sets.yes / sets.n >= (1 + guess) / 2
        some_no, some_yes = np.append(-np.inf, sets.x[~above]), np.append(np.inf, sets.x[above])
    low, high = sorted((float(some_no.max()), float(some_yes.min())))
    return (10**low, 10**high) if log else (low, high)


def undetermined(sets: Sets) -> tuple[str, ...]:
    """Return why answers determine no finite slope above 0; empty if they do.

    Only the order of the answers matters.
    """
    some_no, some_yes = sets.x[sets.yes < sets.n], sets.x[sets.yes > 0]
    if not some_no.size or not some_yes.size or sets.x.size < 2:
        return ("few",)
    if some_no.max() <= some_yes.min():
        return ("separated",)
    return ("falling",) if some_yes.max() <= some_no.min() else ()


def _gain(sets: Sets, middle: Array, model: Model, found: Found, least: float) -> Array:
    """Return twice the gain in log-likelihood of another model; -inf if below least.

    The model is fitted only where curves of any form can gain so much.
    """
    rates = [v if isinstance(v, float) else 0.0 for v in (model.guess, model.lapse)]
    low, high = rates if model.guess is not None else rates[1:] * 2
    gain = np.full(middle.shape, -np.inf)
    at = np.flatnonzero(2 * (highest_of_any(sets, low, high) - found.loglik) > least)
    if at.size:
        best = maximum(subset(sets, at), middle[at], model).loglik
        gain[at] = 2 * (best - found.loglik[at])
    return gain


def flaws_of(sets: Sets, middle: Array, model: Model, found: Found) -> list[str]:
    """Return what is wrong with answers that have a best curve; "" if nothing is."""
    eta = found.a[:, None] + found.b[:, None] * (sets.x - middle[:, None])
    # but for lapses, they are separated
    near = np.sum((np.abs(eta) < BEYOND) & (sets.n > 0), axis=1)
    flat = 2 * (found.loglik - maximum(sets, middle, model, b=0.0).loglik) < scipy.stats.chi2.ppf(
        0.95, 1
    )
    # at the edge of its range: half of chi squared
    least = scipy.stats.chi2.isf(2 * SURE, 1)
    gain = (
        np.full(flat.shape, -np.inf)
        if model.lapse == FREE
        else _gain(sets, middle, model._replace(lapse=FREE), found, least)
    )
    lapses = gain > least
    guess = np.zeros(flat.shape, bool)
    if model.guess != FREE and model.pse is None:
        others = [0.5] if model.guess is None else [g for g in CHANCES if g != model.guess]
        least = AS_GOOD if model.guess is None else scipy.stats.chi2.isf(SURE, 1)
        each = [_gain(sets, middle, model._replace(guess=g), found, least) for g in others]
        better = np.max(each, axis=0)
        guess = (better > least) & (~lapses | (better > gain))
    names = np.select(
        [flat, found.b <= 0, near < 1 + (model.pse is None), guess, lapses],
        ["flat", "falling", "separated", "guess", "lapses"],
        "",
    )
    return [str(name) for name in names]
