"""Maximum likelihood of psychometric functions, many sets of answers at once.

    p(x) = low + (1 - low - high) F(a + b (x - c))

F is the link's function, ``high`` the rate of lapses, ``low`` the rate of guesses.  A
set is a row of levels, so a bootstrap or 2000 simulated people are one call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue

Array = np.ndarray
LINKS = ("probit", "logit", "gumbel", "weibull")
FREE = "free"  # a rate of guesses or lapses that is fitted
# the largest rates of lapses and guesses that are looked for
LAPSES, GUESSES = 0.1, 0.8
STEPS, FEW = 40, 10  # of Fisher scoring, or halvings of a step
STARTS = [(0.0, 0.0), (0.0, 2.0), *((k / 4, 8.0) for k in range(-6, 7, 2))]
"""Where scoring starts: middle and slope, in spreads of the levels; where there may be
several peaks.
"""
# rounds and points of the search for a rate of lapses, before it is scored with the
# rest
ZOOMS, GRID = 4, 6
# of the search for an end of an interval: steps, and how near 0 it ends
DOUBLINGS, SECANTS, NEAR = 14, 30, 1e-7
FLOOR = 1e-15  # of a probability
PROBLEMS = {
    "few": (
        "all answers are the same, or to one level, or too few: nothing can be estimated; choose"
        " levels around the threshold, add trials, and ask whether the question was understood"
    ),
    "edge": (
        "the {name} is at an end of the values that it can take here, and the true one may be"
        " beyond: it and its error cannot be used; give a wider grid, bounds or range"
    ),
    "beyond": (
        "the {name} is outside of the levels that were presented, where only the shape of the"
        " curve says where it is; add levels around it"
    ),
}
"""What can be wrong with any estimate, and what to do; ``problem`` names it."""


class Sets(NamedTuple):
    """Answers: levels, counts of yes, counts of trials, each (.., levels)."""

    x: Array
    yes: Array
    n: Array


@dataclass(frozen=True)
class Estimate:
    """An estimate with its standard error and interval.

    Attributes
    ----------
    value, error : float
    low, high : float
        Ends of the interval.
    problem : str
        A name in `PROBLEMS`, empty if there is none.
    """

    value: float
    error: float
    low: float
    high: float
    problem: str = ""

    def __str__(self) -> str:
        text = f"{self.value:.4g} +- {self.error:.2g} [{self.low:.4g}, {self.high:.4g}]"
        wrong = PROBLEMS.get(self.problem, "").format(name="estimate")
        return f"{text}; problem: {wrong}" if wrong else text


def total(each: ArrayLike) -> Array:
    """Return the sum over levels, added in their order.

    Levels without trials, which pad a set, change no bit of it.

    Examples
    --------
    >>> from stimlib.experiments.likelihood import total
    >>> total([[1.0, 2.0], [3.0, 0.0]])
    array([3., 3.])
    """
    return np.cumsum(each, axis=-1)[..., -1]


class Model(NamedTuple):
    """The model to fit: its link, guess rate and lapse rate, and its middle if known.

    A rate is a number or FREE; a guess rate of None equals the lapse rate.  ``pse`` is
    on the axis of the fit; None fits it.
    """

    link: str = "probit"
    guess: float | str | None = None
    lapse: float | str = 0.0
    pse: float | None = None


PROBIT = Model()


class Found(NamedTuple):
    """The maximum-likelihood fit of each set; every field has the shape (..).

    The fields are the intercept at c, the slope, the lapse and guess rates, and the
    log-likelihood.
    """

    a: Array
    b: Array
    lapse: Array
    guess: Array
    loglik: Array


def numbers(what: str, values: ArrayLike) -> Array:
    """Return an array of floats, or raise BadValue with the name.

    Raises
    ------
    BadValue

    Examples
    --------
    >>> from stimlib.experiments.likelihood import numbers
    >>> numbers("line: x", [1, "two"])
    Traceback (most recent call last):
    ...
    stimlib.errors.BadValue: line: x must be rows of numbers: could not convert ...
    """
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError) as e:
        raise BadValue(f"{what} must be rows of numbers: {e}") from None


class Curve(NamedTuple):
    """A link function F, its density, inverse, 1 - F, and relative density slope."""

    F: Callable[[Any], Any]
    density: Callable[[Any], Any]
    inverse: Callable[[Any], Any]
    upper: Callable[[Any], Any]
    bend: Callable[[Any], Any]


@cache
def curve(link: str) -> Curve:
    """Return the functions of a link, whose F is one half at 0.

    Of "gumbel" and "weibull" F(eta) = 1 - 2^-exp(eta), Gumbel's distribution of the
    smallest value; over a logarithmic axis that is Weibull's.

    Raises
    ------
    BadValue
        An unknown link.

    Examples
    --------
    >>> from stimlib.experiments.likelihood import curve
    >>> probit = curve("probit")
    >>> round(float(probit.F(probit.inverse(0.75))), 12)
    0.75
    >>> [round(float(curve(link).inverse(0.75)), 6) for link in ("logit", "gumbel")]
    [1.098612, 0.693147]
    """
    from scipy.special import expit, logit, ndtr, ndtri

    if link not in LINKS:
        raise BadValue(f"link = {link!r} must be one of {', '.join(LINKS)}")
    if link == "probit":
        return Curve(
            ndtr,
            lambda eta: np.exp(-0.5 * eta * eta) / np.sqrt(2 * np.pi),
            ndtri,
            lambda eta: ndtr(-eta),
            lambda eta: -eta,
        )
    if link == "logit":
        return Curve(
            expit,
            lambda eta: expit(eta) * expit(-eta),
            logit,
            lambda eta: expit(-eta),
            lambda eta: 1 - 2 * expit(eta),
        )

    def hazard(eta: Any) -> Any:
        return np.log(2) * np.exp(np.minimum(eta, 700.0))

    return Curve(
        lambda eta: -np.expm1(-hazard(eta)),
        lambda eta: np.exp(np.minimum(eta, 700.0) - hazard(eta)) * np.log(2),
        lambda p: np.log(np.log1p(-np.asarray(p)) / -np.log(2)),
        lambda eta: np.exp(-hazard(eta)),
        lambda eta: 1 - hazard(eta),
    )


def probability(
    eta: ArrayLike, link: str, guess: ArrayLike = 0.0, lapse: ArrayLike = 0.0
) -> tuple[Array, Array]:
    """Return the probabilities of yes and no where the link is at eta.

    Each is exact to rounding where it is small.

    Examples
    --------
    >>> from stimlib.experiments.likelihood import probability
    >>> [round(float(p), 3) for p in probability(0.0, "probit", 0.5, 0.02)]
    [0.74, 0.26]
    """
    of, eta = curve(link), np.asarray(eta)
    rest = 1 - np.asarray(guess) - lapse
    return np.maximum(guess + rest * of.F(eta), FLOOR), np.maximum(
        lapse + rest * of.upper(eta), FLOOR
    )


def maximum(
    sets: Sets,
    c: ArrayLike,
    model: Model = PROBIT,
    *,
    a: ArrayLike | None = None,
    b: ArrayLike | None = None,
    start: Found | None = None,
) -> Found:
    """Return the most likely a and b of each set, by Fisher scoring.

    Steps that make it worse are halved.

    Parameters
    ----------
    sets : Sets
        Shape (.., levels).
    c : array_like, shape (..)
        Where the intercept is taken; ``model.pse`` if that is known.
    model : Model
    a, b : array_like, shape (..), optional
        Held there and not fitted: with a = 0, c is the middle of the curve.
    start : Found, optional
        Where to begin, which saves steps where it is near.

    Returns
    -------
    Found
        Sets that no finite slope fits best come back with a very large one.

    References
    ----------
    McCullagh and Nelder (1989), Generalized Linear Models, section 4.4 (scoring);
    Wichmann and Hill (2001), Perception and Psychophysics 63, eq. (1) (guesses and
    lapses).

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments.likelihood import Model, Sets, maximum
    >>> found = maximum(
    ...     Sets(
    ...         np.array([1.0, 2.0, 3.0]), np.array([2, 5, 8]), np.array([10, 10, 10])
    ...     ),
    ...     2.0,
    ... )
    >>> abs(round(float(found.a), 6)), round(float(found.b), 6)
    (0.0, 0.841621)
    """
    if model.pse is not None and a is None:
        a = 0.0
    free = a is None, b is None
    near = (start.a, start.b) if start is not None else (0.0, 0.0)
    a, b = (
        np.asarray(v if given is None else given) for given, v in zip((a, b), near, strict=True)
    )
    c = np.asarray(c)
    shape = np.broadcast_shapes(*(v.shape[:-1] for v in sets), c.shape, a.shape, b.shape)
    z = np.broadcast_to(sets.x - c[..., None], shape + sets.x.shape[-1:])
    yes, n = (np.broadcast_to(v, z.shape) for v in sets[1:])
    size = np.sqrt(total(n * z * z) / total(n))
    size = np.where(size > 0, size, 1.0)
    sets, b = Sets(z / size[..., None], yes, n), b * size
    if not model.guess and not model.lapse:  # there is one peak
        begin = Found(*(np.broadcast_to(v, shape) for v in (a, b, 0.0, 0.0, 0.0)))
    else:
        begin = _search(sets, model, a, b, free, ZOOMS if start is None else 1)
    found = _climb(sets, model, begin, (*free, *_rates(model)), STEPS)
    guess = found.lapse if model.guess is None else found.guess
    return found._replace(b=found.b / size, guess=guess)


def _rates(model: Model) -> tuple[bool, bool]:
    """Return whether the rates of lapses and of guesses are fitted."""
    return model.lapse == FREE, model.guess == FREE


def _search(
    sets: Sets, model: Model, a: Array, b: Array, free: tuple[bool, bool], zooms: int
) -> Found:
    """Return the best of many starts and rates, after a few steps each.

    x is in spreads of the levels.
    """
    shape, each = sets.x.shape[:-1], Sets(*(v[..., None, :] for v in sets))
    looked = _rates(model)
    fixed = [0.0 if v in (None, FREE) else v for v in (model.lapse, model.guess)]
    lowest = np.broadcast_to(fixed, (*shape, 2))
    highest = np.where(looked, [LAPSES, GUESSES], lowest)
    grid = np.array(list(product(*(np.linspace(0, 1, GRID if v else 1) for v in looked))))
    # what is held makes many of them one
    starts = list(dict.fromkeys((free[0] * m, free[1] * s) for m, s in STARTS))
    middles, slopes = (np.tile(v, len(grid)) for v in np.array(starts).T)
    low, high = lowest, highest
    for _ in range(zooms if any(looked) else 1):
        rates = low[..., None, :] + (high - low)[..., None, :] * grid
        rates = np.repeat(rates, len(starts), axis=-2)
        steep = slopes if free[1] else b[..., None]
        start = -middles * steep if free[0] else a[..., None]
        begin = (start, steep, rates[..., 0], rates[..., 1], 0.0)
        found = _climb(
            each,
            model,
            Found(*(np.broadcast_to(v, rates.shape[:-1]) for v in begin)),
            (*free, False, False),
            FEW,
        )
        best = np.argmax(found.loglik, axis=-1)[..., None]
        found = Found(*(np.take_along_axis(v, best, -1)[..., 0] for v in found))
        at, step = np.stack([found.lapse, found.guess], axis=-1), (high - low) / (GRID - 1)
        low, high = np.maximum(at - step, lowest), np.minimum(at + step, highest)
    return found


def _climb(sets: Sets, model: Model, start: Found, free: tuple[bool, ...], steps: int) -> Found:
    """Climb from one row for each start.

    A row is left alone when its steps have become small.  The columns are intercept,
    slope, and the rates of lapses and guesses.
    """
    shape = start.a.shape
    z, yes, n = (np.broadcast_to(v, shape + v.shape[-1:]).reshape(start.a.size, -1) for v in sets)
    at = np.stack([v.ravel() for v in start[:4]], axis=1)
    highest = np.maximum([LAPSES, GUESSES], at[:, 2:])
    loglik, step = _score(at, z, yes, n, model, free)
    active = np.arange(len(at))
    for _ in range(steps):
        before, by = loglik[active], step[active]
        trial = at[active] + by
        if any(free[2:]):
            trial[:, 2:] = np.clip(trial[:, 2:], 0.0, highest[active])
        new, newer = _score(trial, z, yes, n, model, free)
        better = new >= before - 1e-12 * np.abs(before)
        at[active[better]], loglik[active[better]] = trial[better], new[better]
        step[active] = now = np.where(better[:, None], newer, by / 2)
        moves = (np.abs(now) > 1e-11 * (1 + np.abs(at[active]))).any(axis=1)
        if not moves.all():
            active, z, yes, n = (v[moves] for v in (active, z, yes, n))
            if not active.size:
                break
    return Found(*(v.reshape(shape) for v in (*at.T, loglik)))


def _score(
    at: Array, z: Array, yes: Array, n: Array, model: Model, free: tuple[bool, ...]
) -> tuple[Array, Array]:
    """Return the log-likelihood of each row, and its step.

    The step is the expected information's inverse times the gradient; where a rate is
    fitted too, it is Newton's.
    """
    of, eta, lapse = curve(model.link), at[:, :1] + at[:, 1:2] * z, at[:, 2:3]
    guess = lapse if model.guess is None else at[:, 3:]
    p, q = probability(eta, model.link, guess, lapse)
    slope, no = (1 - guess - lapse) * of.density(eta), n - yes
    fit = yes * np.log(p) + no * np.log(q)
    if any(free[2:]):
        return total(fit), _joint_step(at, z, yes, n, model, free, eta, p, q, slope)
    r = yes / p - no / q
    g = slope * r
    w = n * slope * slope / (p * q)
    if not model.guess and not model.lapse:  # concave, but where FLOOR is the probability
        newton = slope * slope * (yes / (p * p) + no / (q * q)) - g * of.bend(eta)
        w = np.where(newton > 0, newton, w)
    gz, wz = g * z, w * z
    loglik, g0, g1, w0, w1, w2 = total(np.stack([fit, g, gz, w, wz, wz * z]))
    step = np.zeros_like(at)
    if free[:2] == (True, True):
        det = w0 * w2 - w1 * w1 + FLOOR
        step[:, 0], step[:, 1] = (w2 * g0 - w1 * g1) / det, (w0 * g1 - w1 * g0) / det
    else:
        step[:, 0], step[:, 1] = free[0] * g0 / (w0 + FLOOR), free[1] * g1 / (w2 + FLOOR)
    return loglik, step


def directions(z: Array, eta: Array, slope: Array, model: Model, free: Sequence[bool]) -> Array:
    """Return the derivatives of p with respect to its parameters, shape (.., 4, n).

    Parameters
    ----------
    z, eta : ndarray, shape (.., n)
        The levels, from c on, and the link there.
    slope : ndarray, shape (.., n)
        dp/deta.
    model : Model
    free : sequence of bool
        Which of intercept, slope, lapse rate and guess rate are fitted; the
        derivatives for the others are 0.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments.likelihood import PROBIT, directions
    >>> zero, one = np.zeros(1), np.ones(1)
    >>> directions(zero, zero, one, PROBIT, (True, True, True, False))[:, 0]
    array([1., 0., 0., 0.])
    """
    F = curve(model.link).F(eta)
    each = slope, slope * z, 1 - 2 * F if model.guess is None else -F, 1 - F
    return np.stack([f * v for f, v in zip(free, each, strict=True)], axis=-2)


def _joint_step(
    at: Array,
    z: Array,
    yes: Array,
    n: Array,
    model: Model,
    free: tuple[bool, ...],
    eta: Array,
    p: Array,
    q: Array,
    slope: Array,
) -> Array:
    """Return Newton's step of all four.

    Where the log-likelihood is not concave, it is by the expected information.
    """
    of = curve(model.link)
    d = directions(z, eta, slope, model, free)
    r = yes / p - (n - yes) / q
    gradient = total(d * r[:, None])
    # a rate at an end of its range is held there while the gradient points outwards
    rates, uphill = at[:, 2:], gradient[:, 2:] > 0
    held = np.where(uphill, rates >= [LAPSES, GUESSES], rates <= 0)
    d[:, 2:][held] = 0.0
    gradient[:, 2:][held] = 0.0
    # how dp/deta changes with a rate
    both = -of.density(eta)[:, None] * [[2 if model.guess is None else 1], [1]]
    both = both * (np.array(free[2:]) & ~held)[..., None]
    line = np.stack([free[0] + 0 * z, free[1] * z, 0 * z, 0 * z], axis=1)
    cross = np.zeros((*d.shape[:2], *d.shape[1:]))
    cross[:, :, 2:] = line[:, :, None] * both[:, None]
    second = line[:, :, None] * line[:, None] * (slope * of.bend(eta))[:, None, None]
    second = second + cross + np.swapaxes(cross, 1, 2)
    outer = d[:, :, None] * d[:, None]
    expected = total(outer * (n / (p * q))[:, None, None])
    observed = total(
        outer * (yes / p**2 + (n - yes) / q**2)[:, None, None] - second * r[:, None, None]
    )
    # what is held has none
    little = (1e-12 * np.trace(expected, axis1=1, axis2=2) + FLOOR)[:, None, None] * np.eye(4)
    concave = np.linalg.eigvalsh(observed + little)[:, :1, None] > 0
    return np.linalg.solve(np.where(concave, observed, expected) + little, gradient[..., None])[
        ..., 0
    ]


def ends(excess: Callable[[Array, Array], Array], start: ArrayLike, step: ArrayLike) -> Array:
    """Return where functions that start below 0 first cross 0.

    The way is along step; inf (of the step's sign) if nowhere.

    The step is doubled until 0 is passed, 14 times at most; then false position, by the
    Illinois rule.

    Parameters
    ----------
    excess : callable
        ``excess(x, rows)``: the values of so many of the functions, by their numbers,
        at a place of each; quick where they are nearly straight.  Asked only of those
        that are still looked for.
    start, step : array_like, shape (n,)

    References
    ----------
    Dowell and Jarratt (1971), BIT 11:168 (Illinois rule).

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments.likelihood import ends
    >>> ends(lambda x, rows: x**2 - 2, np.zeros(2), np.array([0.1, -0.1])).round(6)
    array([ 1.414214, -1.414214])
    """
    near, step = (np.array(v, float) for v in np.broadcast_arrays(start, step))
    rows = np.arange(near.size)
    below = excess(near, rows)
    far = near + step
    above = excess(far, rows)
    for _ in range(DOUBLINGS):
        rows = np.flatnonzero(~(above > 0))
        if not rows.size:
            break
        near[rows], below[rows] = far[rows], above[rows]
        step[rows] *= 2
        far[rows] += step[rows]
        above[rows] = excess(far[rows], rows)
    never = ~(above > 0)
    middle, rows = far.copy(), np.flatnonzero(~never)
    for _ in range(SECANTS):
        if not rows.size:
            break
        a, at_a, b, at_b = near[rows], below[rows], far[rows], above[rows]
        x = middle[rows] = a - at_a * (b - a) / (at_b - at_a)
        value = excess(x, rows)
        out = value > 0
        below[rows], above[rows] = np.where(out, at_a / 2, value), np.where(out, value, at_b / 2)
        near[rows], far[rows] = np.where(out, a, x), np.where(out, x, b)
        rows = rows[~(np.abs(value) <= NEAR)]
    return np.where(never, np.copysign(np.inf, step), middle)
