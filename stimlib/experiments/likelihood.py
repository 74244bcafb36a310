"""Maximum likelihood of psychometric functions, many sets of answers at once.

    p(x) = low + (1 - low - high) F(a + b (x - c))

F is the link's function, ``high`` the rate of lapses, ``low`` the rate of guesses.  A
set is a row of levels, so a bootstrap or 2000 simulated people are one call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.graph import unmasked
from ..errors import BadValue, one_of, said_as

Array = np.ndarray
LINKS = ("probit", "logit", "gumbel", "weibull")
FREE = "free"  # a rate of guesses or lapses that is fitted
# the largest rates of lapses and guesses that are looked for
LAPSES, GUESSES = 0.1, 0.8
STEPS, FEW = 60, 10
# of the search: steps with the rates held, places kept, and how near two are the same
HELD, KEPT, SAME = 8, 14, 1e-7
# lattice of starts, where there may be several peaks: middles, slopes of each sign, the
# flattest in spreads of the levels, and how many sigmas two levels of a step are apart
MIDDLES, SLOPES, FLATTEST, STEP = 17, 12, 0.25, 80.0
FAR = 2.0  # sigmas that a step may move a curve, or half of its slope
MANY = 2000  # levels of a set among which a search for the highest peak looks
# of the search for an end of an interval: steps, those by straight lines, and how near
# 0 it ends
DOUBLINGS, SECANTS, STRAIGHT, NEAR = 14, 30, 8, 1e-7
FLOOR = 1e-15  # of a probability
EDGE = 1e-12  # of the range of a rate
LITTLE = 1e-18  # gain of a step, relative, at which a climb ends
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
    with said_as(BadValue, f"{what} must be rows of numbers", TypeError, ValueError):
        return unmasked(values)


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

    one_of("link", link, LINKS)
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
    search: bool = True,
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
    search : bool
        Whether to look for a higher peak elsewhere, where there may be several; else
        the one that is reached from the start is returned.

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
    z = z / size[..., None]
    rows = _Rows(*(np.ascontiguousarray(v.reshape(-1, v.shape[-1]).T) for v in (z, yes, n - yes)))
    at = np.zeros((4, size.size))
    rates = (0.0, 0.0) if start is None else (start.lapse, start.guess)
    for row, value in zip(at, (a, b * size, *rates), strict=True):
        row[:] = np.broadcast_to(np.asarray(value), shape).ravel()
    fitted = (*free, model.lapse == FREE, model.guess == FREE)
    # where a steep curve is held far from the answers, there is no slope to climb
    far = free[0] and not free[1] and start is None and bool(at[1].any())
    if search and (model.guess or model.lapse or far):  # or there may be several peaks
        at = _search(rows, model, at, fitted, start is not None)
    at, loglik = _climb(rows, model, at, fitted, STEPS)
    a, b, lapse, guess = at
    each = a, b / size.ravel(), lapse, lapse if model.guess is None else guess, loglik
    return Found(*(v.reshape(shape) for v in each))


class _Rows(NamedTuple):
    """Answers of many sets, each (levels, sets), so that sums over levels are in order.

    The levels are from c on, in spreads.
    """

    z: Array
    yes: Array
    no: Array


def _search(rows: _Rows, model: Model, at: Array, free: tuple[bool, ...], warm: bool) -> Array:
    """Return a place for each set from which to climb to the highest peak.

    The likelihood is taken on a lattice of curves and rates.  The best of each slope,
    of each middle and of each pair of rates climb a few steps, and ``at`` too if warm.
    Of more than MANY levels, neighbours are taken as one: the place is only a start.
    """
    sets, rows = at.shape[1], _merged(rows)
    slopes, places = _lattice(rows, free)
    b = slopes if free[1] else at[1:2]
    # a curve that is nearly flat is moved by as much as a steep one
    a = -places[:, None] * np.where(free[1] | (np.abs(b) > 1), b, 1.0) if free[0] else at[:1, None]
    a, b = np.broadcast_arrays(a + 0 * b, b + 0 * a)
    each = [
        np.linspace(0, most, k) if v == FREE else [v or 0.0]
        for v, most, k in ((model.lapse, LAPSES, 3), (model.guess, GUESSES, 5))
    ]
    rates = np.array(list(product(*each)))
    heights = np.stack(_heights(rows, model, a, b, rates))
    which, i, j = np.indices(heights.shape[:3]).reshape(3, -1)
    best = []
    for axis, some in enumerate((len(rates) > 1, free[0], free[1])):
        if some:
            order = np.moveaxis(np.arange(which.size).reshape(heights.shape[:3]), axis, 0)
            groups = order.reshape(len(order), -1)
            tops = np.argmax(heights.reshape(-1, sets)[groups], axis=1)
            best.append(np.take_along_axis(groups, tops, 1))
    picks = np.concatenate(best) if best else np.zeros((1, sets), int)
    column, held = np.arange(sets), (*free[:2], False, False)
    starts = np.stack(
        [v[i[picks], j[picks], column] for v in (a, b)] + [rates[which[picks], k] for k in (0, 1)]
    )
    if warm:
        starts = np.concatenate([starts, at[:, None]], axis=1)
    for fitted, steps, left in ((held, HELD, KEPT), (free, FEW, 1)):
        many = starts.shape[1]
        wide = _Rows(*(np.tile(v, many) for v in rows))
        starts, height = _climb(wide, model, starts.reshape(4, -1), fitted, steps)
        starts, height = starts.reshape(4, many, sets), height.reshape(many, sets)
        order = np.argsort(-height, axis=0, kind="stable")
        ranked = np.take_along_axis(height, order, 0)
        again = np.zeros(order.shape, bool)
        again[1:] = ranked[1:] > ranked[:-1] - SAME * np.abs(ranked[:-1])
        order = np.take_along_axis(order, np.argsort(again, axis=0, kind="stable")[:left], 0)
        starts = np.take_along_axis(starts, order[None], 1)
    return starts[:, 0]


def _merged(rows: _Rows) -> _Rows:
    """Return answers to at most MANY levels, in order, each the mean of neighbours."""
    if len(rows.z) <= MANY:
        return rows
    order = np.argsort(rows.z, axis=0)
    z, yes, no = (np.take_along_axis(v, order, 0) for v in rows)
    first = np.arange(MANY) * len(z) // MANY
    moment, yes, no = (np.add.reduceat(v, first) for v in ((yes + no) * z, yes, no))
    n = yes + no
    return _Rows(np.where(n > 0, moment / np.maximum(n, 1), z[first]), yes, no)


def _heights(rows: _Rows, model: Model, a: Array, b: Array, rates: Array) -> list[Array]:
    """Return the log-likelihoods of curves with each pair of rates."""
    of = curve(model.link)
    heights = [np.zeros(a.shape) for _ in rates]
    for z, yes, no in zip(*rows, strict=True):
        eta = a + b * z
        F, upper = of.F(eta), of.upper(eta)
        for height, (lapse, guess) in zip(heights, rates, strict=True):
            low = lapse if model.guess is None else guess
            rest = 1 - low - lapse
            height += yes * np.log(np.maximum(low + rest * F, FLOOR))
            height += no * np.log(np.maximum(lapse + rest * upper, FLOOR))
    return heights


def _lattice(rows: _Rows, free: tuple[bool, ...]) -> tuple[Array, Array]:
    """Return slopes, from nearly flat to a step between two levels, and middles.

    The middles are levels and half-way between them; some, where there are many.
    """
    asked = rows.yes + rows.no > 0
    levels = np.sort(np.where(asked, rows.z, np.inf), axis=0)
    rank = np.rint(np.linspace(0, 2, MIDDLES)[:, None] * (asked.sum(axis=0) - 1)).astype(int)
    below, above = (np.take_along_axis(levels, k // 2, 0) for k in (rank, rank + 1))
    if free[0]:
        with np.errstate(invalid="ignore"):
            gaps = np.diff(levels, axis=0, prepend=-np.inf)
    else:  # from where the curve is held
        gaps = np.abs(levels)
    nearest = np.maximum(np.where(gaps > 0, gaps, np.inf).min(axis=0), 1e-3)
    steepest = np.maximum(STEP / nearest, STEP / 10)
    up = FLATTEST * (steepest / FLATTEST) ** np.linspace(0, 1, SLOPES)[:, None]
    middles = (below + above) / 2
    return np.concatenate([-up[::-1], up]), np.concatenate(
        [middles[:1] - FAR, middles, middles[-1:] + FAR]
    )


def _climb(
    rows: _Rows, model: Model, start: Array, free: tuple[bool, ...], steps: int
) -> tuple[Array, Array]:
    """Climb from a place of each row; return the places reached, and log-likelihoods.

    A row is left alone when its steps have become small.  The places are intercept,
    slope, and the rates of lapses and guesses.
    """
    reached, heights = start.copy(), np.empty(start.shape[1])
    highest = np.maximum([[LAPSES], [GUESSES]], start[2:])
    at, active, moves = start, np.arange(heights.size), np.ones(heights.size, bool)
    loglik, step, _ = _score(at, rows, model, free)
    for _ in range(steps):
        if model.guess or model.lapse:
            step = _within(step, at, highest)
        trial = at + step
        if any(free[2:]):
            trial[2:][trial[2:] < EDGE] = 0.0
            trial[2:] = np.where(trial[2:] > highest - EDGE, highest, trial[2:])
        new, newer, gain = _score(trial, rows, model, free)
        # a row that is left alone keeps its bits, whatever rows are beside it
        better = moves & (new >= loglik - 1e-12 * np.abs(loglik))
        at, loglik = np.where(better, trial, at), np.where(better, new, loglik)
        step = np.where(better, newer, step / 2)
        moves &= (np.abs(step) > 1e-11 * (1 + np.abs(at))).any(axis=0)
        moves &= ~better | (gain > LITTLE * (1 + np.abs(loglik)))
        if 2 * np.count_nonzero(moves) < moves.size:
            reached[:, active], heights[active] = at, loglik
            if not moves.any():
                break
            active, at, step, loglik, highest = (
                v[..., moves] for v in (active, at, step, loglik, highest)
            )
            rows, moves = _Rows(*(v[:, moves] for v in rows)), moves[moves]
    reached[:, active], heights[active] = at, loglik
    return reached, heights


def _within(step: Array, at: Array, highest: Array) -> Array:
    """Return steps cut at FAR, and where a rate comes to the end of its range."""
    part = (FAR + np.abs(at[1]) / 2) / np.maximum(np.abs(step[:2]).max(axis=0), FLOOR)
    room = np.where(step[2:] > 0, highest - at[2:], at[2:])
    # a step so small that it has all the room there is, or none
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        parts = np.where(room > 0, room / np.abs(step[2:]), 1.0)
    return step * np.minimum(np.minimum(part, 1.0), parts.min(axis=0))


def _score(
    at: Array, rows: _Rows, model: Model, free: tuple[bool, ...]
) -> tuple[Array, Array, Array]:
    """Return the log-likelihood of each row, its step, and twice what that should gain.

    The step is Newton's; where the log-likelihood is not concave, the inverse of the
    expected information times the gradient.
    """
    z, yes, no = rows
    a, b, lapse, guess = at
    of, eta, symmetric = curve(model.link), a + b * z, model.guess is None
    if symmetric:
        guess = lapse
    F, upper, density, rest = of.F(eta), of.upper(eta), of.density(eta), 1 - guess - lapse
    p, q = np.maximum(guess + rest * F, FLOOR), np.maximum(lapse + rest * upper, FLOOR)
    slope, u, v = rest * density, yes / p, no / q
    r, observed, expected = u - v, u / p + v / q, (yes + no) / (p * q)
    bent = slope * r * of.bend(eta)
    if not model.guess and not model.lapse:  # concave, but where FLOOR is the probability
        square = slope * slope
        bent = np.where(square * observed > bent, bent, square * (observed - expected))
    # derivatives of p, and the second ones times r; p is a straight line over a rate
    first = [slope, slope * z, 1 - 2 * F if symmetric else -F, upper]
    second = {(0, 0): bent, (0, 1): bent * z, (1, 1): bent * z * z}
    fitted = [k for k in range(4) if free[k]]
    if any(free[2:]):
        side = (-2 if symmetric else -1) * density * r
        second |= {(i, k): side * z if i else side for i in (0, 1) for k in (2, 3)}
    pairs = list(combinations_with_replacement(fitted, 2))
    products = [first[i] * first[j] for i, j in pairs]
    terms = [yes * np.log(p) + no * np.log(q), *(first[k] * r for k in fitted)]
    terms += [v * observed - second.get(pair, 0.0) for pair, v in zip(pairs, products, strict=True)]
    # over the first axis, of which numpy adds one row after the other
    loglik, *sums = np.add.reduce(np.stack([*terms, z], axis=1), axis=0)[:-1]
    k, step, gain = len(fitted), np.zeros_like(at), np.zeros(a.shape)
    if not k:
        return loglik, step, gain
    gradient = np.stack(sums[:k])
    # a rate at an end of its range is held there while gradient or step point outwards
    ranges = [(0.0, (LAPSES, GUESSES)[i - 2]) if i > 1 else (-np.inf, np.inf) for i in fitted]
    low, high = (np.array([[v] for v in each]) for each in zip(*ranges, strict=True))
    held = _outwards(at[fitted], gradient, low, high)
    found = _ascent(sums[k:], gradient, held, products, expected, z)
    for _ in range(sum(free[2:])):
        more = _outwards(at[fitted], found, low, high) & ~held
        some = more.any(axis=0)
        if not some.any():
            break
        held |= more
        found[:, some] = _ascent(
            [v[some] for v in sums[k:]],
            gradient[:, some],
            held[:, some],
            [v[:, some] for v in products],
            expected[:, some],
            z[:, some],
        )
    gradient = np.where(held, 0.0, gradient)
    step[fitted] = found
    return loglik, step, np.sum(found * gradient, axis=0)


def _outwards(at: Array, way: Array, low: Array, high: Array) -> Array:
    """Return which parameters are at an end of their range and led beyond it."""
    return np.where(way > 0, at >= high, at <= low)


def _ascent(
    upper: list[Array],
    gradient: Array,
    held: Array,
    products: list[Array],
    expected: Array,
    z: Array,
) -> Array:
    """Return the step of each row, in which what is held stays."""
    gradient = np.where(held, 0.0, gradient)
    found, sure = _solved(upper, gradient, held)
    if not sure.all():
        some = ~sure
        least = [v[:, some] * expected[:, some] for v in products]
        least = np.add.reduce(np.stack([*least, z[:, some]], axis=1), axis=0)[:-1]
        found[:, some] = _solved(list(least), gradient[:, some], held[:, some])[0]
    return found


def _solved(upper: list[Array], gradient: Array, held: Array) -> tuple[Array, Array]:
    """Return an information's inverse times the gradient, and where it is positive.

    By Gauss and Jordan, each a row of many; ``upper`` is the upper triangle.
    """
    k = len(gradient)
    m = np.empty((k, k + 1, gradient.shape[1]))
    for (i, j), v in zip(combinations_with_replacement(range(k), 2), upper, strict=True):
        m[i, j] = m[j, i] = np.where(held[i] | held[j], 0.0, v)
    m[:, k] = gradient
    little = FLOOR + 1e-12 * sum(np.abs(m[i, i]) for i in range(k))
    sure = np.ones(little.shape, bool)
    for i in range(k):
        m[i, i] += little  # what is held has none
    for i in range(k):
        positive = m[i, i] > 0
        sure &= positive
        m[i] /= np.where(positive, m[i, i], 1.0)
        for j in range(k):
            if j != i:
                m[j] -= m[j, i] * m[i]
    return m[:, k], sure


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


def ends(excess: Callable[[Array, Array], Array], start: ArrayLike, step: ArrayLike) -> Array:
    """Return where functions that start below 0 first cross 0.

    The way is along step; inf (of the step's sign) if nowhere.

    The step is doubled until 0 is passed, 14 times at most; then false position, by the
    Illinois rule, and after 8 steps of that halves.

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
    middle, rows, moved = far.copy(), np.flatnonzero(~never), np.zeros(far.size, int)
    for turn in range(SECANTS):
        if not rows.size:
            break
        a, at_a, b, at_b = near[rows], below[rows], far[rows], above[rows]
        # what is not found by then has a jump, which halves find
        part = -at_a / (at_b - at_a) if turn < STRAIGHT else 0.5
        x = middle[rows] = a + part * (b - a)
        value = excess(x, rows)
        out = value > 0
        # an end that stays for a second time counts half, or it might stay for ever
        less = np.where(moved[rows] == np.where(out, 1, -1), 0.5, 1.0)
        moved[rows] = np.where(out, 1, -1)
        below[rows] = np.where(out, less * at_a, value)
        above[rows] = np.where(out, value, less * at_b)
        near[rows], far[rows] = np.where(out, a, x), np.where(out, x, b)
        rows = rows[~(np.abs(value) <= NEAR)]
    return np.where(never, np.copysign(np.inf, step), middle)


def middle_of(sets: Sets, model: Model) -> Array:
    """Return where intercepts are taken: the known middle, or that of the levels."""
    mean = total(sets.x * sets.n) / total(sets.n)
    return mean if model.pse is None else np.full_like(mean, model.pse)


def subset(sets: Sets, rows: Sequence[int] | Array) -> Sets:
    """Return some of the sets, by number."""
    return Sets(*(v[rows] for v in sets))
