"""Signal detection: d' from counts, ROCs of ratings, proportions and intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import BadValue, Below1, Several, one_of, public
from .likelihood import Estimate, curve, numbers

CORRECTIONS = {
    "error": (
        "one answer of the other kind is added where all were the same: 0 becomes 1/(n + 1), and 1"
        " becomes n/(n + 1)"
    ),
    "half": "0 becomes 1/(2n), and 1 becomes 1 - 1/(2n)",
    "loglinear": "(k + 0.5)/(n + 1), always",
    "none": "none: all right, or all wrong, gives an infinite value",
}
"""What is done where a rate is 0 or 1, whose z is infinite: ``error`` is from
Çaldıran's thesis, section 3.7, ``half`` from Macmillan and Kaplan (1985), ``loglinear``
from Hautus (1995)."""

MOST = 1e15  # trials of a count, which a float holds exactly
PROBLEMS = {
    "ceiling": (
        "all answers are right: d' is infinite, and only the lower end of its interval is known;"
        " add trials with weaker stimuli"
    ),
    "chance": "the answers may be guesses, because d' = 0 is in the interval; add trials",
    "below chance": (
        "fewer answers are right than by guessing; check which answer is counted as right"
    ),
    "apart": (
        "the ratings of signal and noise do not overlap, or all ratings are the same: the area has"
        " no interval; add trials, with weaker stimuli if its value is 1"
    ),
    "slope": (
        "fewer than two criteria have different rates of hits and of false alarms between 0 and 1,"
        " or the likelihood has no maximum: slope and d_a are not determined; use more categories"
        " or trials, or `detection` at one criterion"
    ),
}
"""What can be wrong with an estimate, and what to do; ``problems`` names them."""


@dataclass(frozen=True)
class Detection:
    """The sensitivity and criterion of a detection task.

    Attributes
    ----------
    d : float
        Sensitivity d' = z(H) - z(F).
    criterion : float
        c = -(z(H) + z(F))/2; above 0: rather no.
    hit_rate, false_alarm_rate : float
        H and F, corrected.
    corrected : bool
        Whether the correction changed a rate.
    standard_error : float
        Of d', sqrt(H(1 - H)/(n phi(z(H))^2) + the same of F).
    """

    d: float
    criterion: float
    hit_rate: float
    false_alarm_rate: float
    corrected: bool
    standard_error: float


@public
def detection(
    hits: float, signals: float, false_alarms: float, noises: float, correction: str = "error"
) -> Detection:
    """Return d' of a one-interval or a yes-no task.

    Parameters
    ----------
    hits, signals : int
        Answers "signal", of so many trials with it.
    false_alarms, noises : int
        Answers "signal", of so many trials without it.
    correction : str
        One of `CORRECTIONS`.

    Returns
    -------
    Detection

    Raises
    ------
    BadValue
        Counts that are none, or above their trials; an unknown correction.

    References
    ----------
    Macmillan and Creelman (2005), Detection Theory, eqs. (1.5) and (2.1); standard
    error: Gourevitch and Galanter (1967), Psychometrika 32:25.

    Examples
    --------
    >>> from stimlib.experiments import detection
    >>> round(detection(41, 50, 9, 50).d, 6), round(detection(50, 50, 0, 50).d, 6)
    (1.83073, 4.123833)
    >>> round(detection(50, 50, 0, 50, correction="half").d, 6)
    4.652696
    """
    _, density, inverse, *_ = curve("probit")
    one_of("detection: correction", correction, CORRECTIONS)
    hits, signals = _counts("detection", hits, signals)
    false_alarms, noises = _counts("detection", false_alarms, noises)
    (H, n), (F, m) = _rate(hits, signals, correction), _rate(false_alarms, noises, correction)
    z_H, z_F = float(inverse(H)), float(inverse(F))
    variance = sum(
        p * (1 - p) / (k * density(z) ** 2) if 0 < p < 1 else float("inf")
        for p, k, z in ((H, n, z_H), (F, m, z_F))
    )
    changed = (H, F) != (hits / signals, false_alarms / noises)
    return Detection(z_H - z_F, -(z_H + z_F) / 2, H, F, changed, float(variance**0.5))


def _rate(k: float, n: float, correction: str) -> tuple[float, float]:
    """Return the corrected rate, and of how many."""
    extreme = k in (0, n)
    if correction == "loglinear":
        return (k + 0.5) / (n + 1), n + 1
    if correction == "half" and extreme:
        return (0.5 if k == 0 else n - 0.5) / n, n
    if correction == "error" and extreme:
        return (1 if k == 0 else n) / (n + 1), n + 1
    return k / n, n


@dataclass(frozen=True)
class Proportion:
    """A proportion k of n, with its interval."""

    value: float
    low: float
    high: float
    k: int
    n: int


@public
def wilson(k: float, n: float, confidence: Below1 = 0.95) -> Proportion:
    """Return a proportion with its Wilson score interval.

    Parameters
    ----------
    k, n : int
        So many of so many trials.
    confidence : float

    Returns
    -------
    Proportion

    Raises
    ------
    BadValue
        Counts that are none; k above n; confidence not between 0 and 1.

    References
    ----------
    Wilson (1927), Journal of the American Statistical Association 22:209.

    Examples
    --------
    >>> from stimlib.experiments import wilson
    >>> p = wilson(239, 252)
    >>> round(p.value, 4), round(p.low, 4), round(p.high, 4)
    (0.9484, 0.9138, 0.9696)
    """
    k, n = _counts("wilson", k, n)
    found = scipy.stats.binomtest(k, n).proportion_ci(confidence, method="wilson")
    return Proportion(k / n, float(found.low), float(found.high), k, n)


@dataclass(frozen=True)
class Diagnosis:
    """The sensitivity, specificity and accuracy of a detection task."""

    sensitivity: Proportion
    specificity: Proportion
    accuracy: Proportion


@public
def diagnosis(
    hits: float, signals: float, correct_rejections: float, noises: float, confidence: Below1 = 0.95
) -> Diagnosis:
    """Return sensitivity, specificity and accuracy.

    Wilson intervals are of the trials that there were.

    Parameters
    ----------
    hits, signals : int
        True positives, of so many.
    correct_rejections, noises : int
        True negatives, of so many.
    confidence : float

    Returns
    -------
    Diagnosis

    Raises
    ------
    BadValue
        As `wilson`.

    References
    ----------
    Altman and Bland (1994), BMJ 308:1552; Li et al. (2016), section "Data processing
    methods".

    Examples
    --------
    >>> from stimlib.experiments import diagnosis
    >>> found = diagnosis(239, 252, 112, 112)
    >>> [
    ...     round(p.low, 4)
    ...     for p in (found.sensitivity, found.specificity, found.accuracy)
    ... ]
    [0.9138, 0.9668, 0.9399]
    """
    a, b = wilson(hits, signals, confidence), wilson(correct_rejections, noises, confidence)
    return Diagnosis(a, b, wilson(a.k + b.k, a.n + b.n, confidence))


@dataclass(frozen=True)
class ForcedChoice:
    """The sensitivity in a forced choice between m alternatives.

    Attributes
    ----------
    d : float
        Sensitivity d'; inf where all answers are right, -inf where all are wrong.
    interval : (float, float)
        Of d'.
    proportion : Proportion
        Right answers, with the Clopper-Pearson interval.
    alternatives : int
        m.
    problems : tuple of str
        Names out of `PROBLEMS`, empty where there are none.
    """

    d: float
    interval: tuple[float, float]
    proportion: Proportion
    alternatives: Several
    problems: tuple[str, ...]


@public
def forced_choice(
    correct: float, trials: float, alternatives: Several = 2, confidence: Below1 = 0.95
) -> ForcedChoice:
    """Return d' of a forced choice between m alternatives, one of which has the signal.

    The proportion of right answers is P(d') = integral of phi(x - d') Phi(x)^(m - 1):
    the signal is chosen where it is felt stronger than all m - 1 others.  The ends of
    the interval of d' are those of the proportion's, because P rises with d'.  The
    model has no bias towards an interval or a place; of two alternatives, `detection`
    removes it: count "first" answers where the signal was first (hits) and second
    (false alarms), and divide d' by sqrt(2).

    Parameters
    ----------
    correct, trials : int
        Right answers, of so many.
    alternatives : int
        m, from 2 to 1000.
    confidence : float
        At least this part of intervals contains d' (Clopper and Pearson).

    Returns
    -------
    ForcedChoice

    Raises
    ------
    BadValue
        Counts as in `detection`; alternatives or a confidence out of range.

    References
    ----------
    Hacker and Ratcliff (1979), Perception and Psychophysics 26:168; Macmillan and
    Creelman (2005), Detection Theory, chapter 10 and table A5.7; Clopper and Pearson
    (1934), Biometrika 26:404.

    Examples
    --------
    >>> from stimlib.experiments import forced_choice
    >>> found = forced_choice(32, 40, alternatives=4)
    >>> round(found.d, 3), [round(end, 3) for end in found.interval], found.problems
    (1.893, [1.297, 2.523], ())
    >>> forced_choice(40, 40).problems
    ('ceiling',)
    """
    (k, n), tail = _counts("forced_choice", correct, trials), (1 - confidence) / 2
    low = float(scipy.special.betaincinv(k, n - k + 1, tail)) if k else 0.0
    high = float(scipy.special.betaincinv(k + 1, n - k, 1 - tail)) if k < n else 1.0
    d, *ends = (_sensitivity(p, alternatives) for p in (k / n, low, high))
    return ForcedChoice(
        d,
        (ends[0], ends[1]),
        Proportion(k / n, low, high, k, n),
        alternatives,
        ("ceiling",) * (k == n)
        + ("chance",) * (ends[0] <= 0 <= ends[1])
        + ("below chance",) * (ends[1] < 0),
    )


def _sensitivity(p: float, m: int) -> float:
    """Return the d' at which the signal wins against m - 1 others with probability p.

    The integral is a sum in steps of 0.05 standard deviations, whose error for these
    smooth functions is that of rounding.
    """
    F, density, _, *_ = curve("probit")
    x = np.linspace(-12.0, 12.0, 481)

    def too_many(d: float) -> float:
        return float(np.sum(density(x) * F(x + d) ** (m - 1)) * 0.05 - p)

    return (
        float(scipy.optimize.brentq(too_many, -40, 40, xtol=1e-13))
        if 0 < p < 1
        else math.inf * (p - 0.5)
    )


@dataclass(frozen=True)
class Roc:
    """A receiver operating characteristic from ratings.

    Attributes
    ----------
    hit_rates, false_alarm_rates : tuple of float
        At each criterion, the strictest first: rates of ratings above it.
    area : Estimate
        Area under the straight lines between these points, which is the probability
        that a signal gets a higher rating than noise (ties count half); without any
        assumption on distributions.
    slope : Estimate
        Of the ROC in z coordinates, z(H) = intercept + slope z(F): the standard
        deviation of noise divided by that of signal.
    d_a : Estimate
        Distance of the means divided by the root mean square of both standard
        deviations; d' where the slope is 1.
    area_z : float
        Area under the fitted curve, Phi(d_a/sqrt(2)).
    criteria : tuple of float
        Of the fitted model, the strictest first, in standard deviations of noise above
        its mean; of categories that were used.
    problems : tuple of str
        Names out of `PROBLEMS`, empty where there are none.
    """

    hit_rates: tuple[float, ...]
    false_alarm_rates: tuple[float, ...]
    area: Estimate
    slope: Estimate
    d_a: Estimate
    area_z: float
    criteria: tuple[float, ...]
    problems: tuple[str, ...]


@public
def roc(signal: ArrayLike, noise: ArrayLike, confidence: Below1 = 0.95) -> Roc:
    """Return the ROC of ratings: its points, area, z slope and d_a.

    The standard error of the area is that of DeLong et al., its interval is on the
    logit scale.  Slope and d_a are by maximum likelihood of a normal model with unequal
    variances (Dorfman and Alf); errors are those of the information matrix, the
    interval of the slope is on the log scale.

    Parameters
    ----------
    signal, noise : array_like of int, shape (categories,)
        How often each rating was given to signals and to noise, from the rating that is
        most sure of noise to the one that is most sure of a signal.
    confidence : float

    Returns
    -------
    Roc
        Where ``problems`` has "slope", slope, d_a, ``area_z`` and ``criteria`` are nan
        or empty.

    Raises
    ------
    BadValue
        Rows of different lengths, fewer than two categories or than two trials of
        either kind, counts that are none, a confidence that is not between 0 and 1.

    References
    ----------
    DeLong, DeLong and Clarke-Pearson (1988), Biometrics 44:837; Dorfman and Alf (1969),
    Journal of Mathematical Psychology 6:487; Simpson and Fitter (1973), Psychological
    Bulletin 80:481, of d_a; Macmillan and Creelman (2005), Detection Theory, chapter 3.

    Examples
    --------
    >>> from stimlib.experiments import roc
    >>> found = roc([3, 2, 2, 11, 33], [33, 6, 6, 11, 2])  # Hanley and McNeil (1982)
    >>> for name in ("area", "slope", "d_a"):
    ...     one = getattr(found, name)
    ...     print(f"{name} {one.value:.3f} [{one.low:.3f}, {one.high:.3f}]")
    area 0.893 [0.816, 0.940]
    slope 0.713 [0.394, 1.292]
    d_a 1.908 [1.397, 2.419]
    """
    rows = S, N = numbers("roc: signal", signal), numbers("roc: noise", noise)
    with np.errstate(over="ignore", invalid="ignore"):  # which is refused below
        m, n = S.sum(), N.sum()
    if S.ndim != 1 or S.shape != N.shape or S.size < 2 or min(m, n) == 1:
        raise BadValue(
            f"roc: signal and noise have shapes {S.shape} and {N.shape} and sums {m:g} and {n:g};"
            " give how often each of the same two or more ratings was given, in at least two trials"
            " of each kind"
        )
    for k, trials in zip(np.concatenate(rows), np.repeat([m, n], S.size), strict=True):
        _counts("roc", float(k), float(trials))
    z = float(scipy.special.ndtri((1 + confidence) / 2))
    # the part of noise that is below a signal of each rating, of signals above a noise
    below, above = (np.cumsum(N) - N / 2) / n, 1 - (np.cumsum(S) - S / 2) / m
    area = float(S @ below / m)
    variance = S @ (below - area) ** 2 / m / (m - 1) + N @ (above - area) ** 2 / n / (n - 1)
    width = z * math.sqrt(variance) / (area * (1 - area)) if variance > 0 else math.nan
    low, high = scipy.special.expit(scipy.special.logit(area) + np.array([-width, width]))
    rates = hits, false_alarms = [np.cumsum(row[:0:-1]) / row.sum() for row in rows]
    inner = np.array(rates)[:, np.all([(r > 0) & (r < 1) for r in rates], axis=0)]
    few = min(np.unique(row).size for row in inner) < 2
    theta, covariance = _binormal(S[S + N > 0], N[S + N > 0], 0 if few else 1000)
    a, b = map(float, theta[:2])
    by = math.sqrt(2 / (1 + b * b)) * np.array([1, -a * b / (1 + b * b)])  # of d_a, by a and b
    d, off_d, off_b = a * float(by[0]), float(by @ covariance @ by) ** 0.5, covariance[1, 1] ** 0.5
    factor = math.exp(min(z * off_b / b, 700.0))
    return Roc(
        tuple(map(float, hits)),
        tuple(map(float, false_alarms)),
        Estimate(area, math.sqrt(variance), float(low), float(high)),
        Estimate(b, float(off_b), b / factor, b * factor),
        Estimate(d, off_d, d - z * off_d, d + z * off_d),
        float(scipy.special.ndtr(d / 2**0.5)),
        tuple(map(float, theta[2:])),
        ("apart",) * bool(variance == 0) + ("slope",) * math.isnan(b),
    )


def _binormal(S: np.ndarray, N: np.ndarray, rounds: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (a, b, criteria..) and the covariance of a and b, nan without a maximum.

    A rating is above criterion c with probability Phi(-c) of noise and Phi(a - b c) of
    a signal.  Fisher scoring maximises the likelihood.
    """

    def cells(theta: np.ndarray) -> np.ndarray:
        c = theta[2:]
        return np.diff(
            scipy.special.ndtr([-c, theta[0] - theta[1] * c]), prepend=0, append=1
        ).ravel()

    def loglik(theta: np.ndarray) -> float:
        return float(scipy.special.xlogy(counts, cells(theta)).sum())

    counts, each = np.concatenate([N[::-1], S[::-1]]), np.repeat([N.sum(), S.sum()], N.size)
    theta = np.array([0.0, 1.0, *-scipy.special.ndtri(np.cumsum((S + N)[:0:-1]) / (S + N).sum())])
    for _ in range(rounds):
        p = np.maximum(cells(theta), 1e-17)  # what is smaller may be rounding
        # exact derivatives, by complex steps
        J = np.array([cells(theta + 1e-20j * one).imag for one in np.eye(theta.size)]) / 1e-20
        inverse = np.linalg.pinv(J * (each / p) @ J.T)
        step = inverse @ (J @ (counts / p))
        if np.abs(step).max() < 1e-9:
            return theta, inverse[:2, :2]
        # not >=: beyond its bounds it is nan
        while not loglik(theta + step) >= loglik(theta) - 1e-12:
            step /= 2
        theta = theta + step
    return np.full(2, np.nan), np.full((2, 2), np.nan)


def _counts(what: str, k: float, n: float) -> tuple[int, int]:
    """Return counts as whole numbers of any size, or raise BadValue."""
    whole = all(
        isinstance(v, (int, float, np.integer, np.floating)) and math.isfinite(v) and v == int(v)
        for v in (k, n)
    )
    if not (whole and 0 <= k <= n and 0 < n <= MOST):
        raise BadValue(
            f"{what}: {k!r:.80} of {n!r:.80}: give whole numbers, the first from 0 to the second,"
            f" the second above 0 and at most {MOST:g}"
        )
    return int(k), int(n)
