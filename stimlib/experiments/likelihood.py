"""Maximum likelihood of psychometric functions, many sets of answers at once.

    p(x) = low + (1 - low - high) F(a + b (x - c))

F is the cumulative normal (probit) or logistic (logit) function, ``high`` the rate of
lapses, ``low`` the rate of guesses.  A set is a row of levels, so a bootstrap or 2000
simulated people are one call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue

Array = np.ndarray
LINKS = ("probit", "logit")
LAPSES = 0.1  # the largest rate that is looked for
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


class Sets(NamedTuple):
    """Answers: levels, counts of yes, counts of trials, each (.., levels)."""

    x: Array
    yes: Array
    n: Array


def total(each: ArrayLike) -> Array:
    """Return the sum over levels, one after another.

    Levels without trials, which pad a set, change no bit of it.

    Examples
    --------
    >>> from stimlib.experiments.likelihood import total
    >>> total([[1.0, 2.0], [3.0, 0.0]])
    array([3., 3.])
    """
    return np.cumsum(each, axis=-1)[..., -1]


class Model(NamedTuple):
    """The model to fit: the link, the rates of guesses and of lapses.

    guesses None: as many as lapses; lapses None: fitted.
    """

    link: str = "probit"
    guess: float | None = None
    lapse: float | None = 0.0


PROBIT = Model()


class Found(NamedTuple):
    """The maximum of each set, each field of shape (..).

    These are the intercept at c, the slope, the rate of lapses and the log-likelihood.
    """

    a: Array
    b: Array
    lapse: Array
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


def curve(link: str) -> tuple[Callable[[Any], Any], Callable[[Any], Any], Callable[[Any], Any]]:
    """Return F, its density and its inverse.

    Examples
    --------
    >>> from stimlib.experiments.likelihood import curve
    >>> F, density, inverse = curve("probit")
    >>> round(float(F(inverse(0.75))), 12), round(float(inverse(0.75)), 6)
    (0.75, 0.67449)
    """
    from scipy.special import expit, logit, ndtr, ndtri

    if link not in LINKS:
        raise BadValue(f"link = {link!r} must be one of {', '.join(LINKS)}")
    if link == "logit":
        return expit, lambda eta: expit(eta) * expit(-eta), logit
    return ndtr, lambda eta: np.exp(-0.5 * eta * eta) / np.sqrt(2 * np.pi), ndtri


def probability(eta: ArrayLike, model: Model, lapse: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Return the probabilities of yes and no where the link is at eta.

    Each is exact to rounding where it is small.

    Examples
    --------
    >>> from stimlib.experiments.likelihood import Model, probability
    >>> [round(float(p), 3) for p in probability(0.0, Model(guess=0.5), 0.02)]
    [0.74, 0.26]
    """
    F = curve(model.link)[0]
    low = lapse if model.guess is None else model.guess
    rest = 1 - np.asarray(low) - lapse
    eta = np.asarray(eta)
    return np.maximum(low + rest * F(eta), FLOOR), np.maximum(lapse + rest * F(-eta), FLOOR)


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
        Where the intercept is taken.
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
    free = a is None, b is None
    begin = (start.a, start.b) if start is not None else (0.0, 0.0)
    a, b = (
        np.asarray(v if given is None else given) for given, v in zip((a, b), begin, strict=True)
    )
    c = np.asarray(c)
    shape = np.broadcast_shapes(*(v.shape[:-1] for v in sets), c.shape, a.shape, b.shape)
    z = np.broadcast_to(sets.x - c[..., None], shape + sets.x.shape[-1:])
    yes, n = (np.broadcast_to(v, z.shape) for v in sets[1:])
    size = np.sqrt(total(n * z * z) / total(n))
    size = np.where(size > 0, size, 1.0)
    sets, b = Sets(z / size[..., None], yes, n), b * size
    if model.lapse is not None and not model.guess and not model.lapse:  # there is one peak
        found = _climb(
            sets, model, Found(*(np.broadcast_to(v, shape) for v in (a, b, 0.0, 0.0))), free, STEPS
        )
    else:
        found = _climb(
            sets, model, _search(sets, model, a, b, free), (*free, model.lapse is None), STEPS
        )
    return found._replace(b=found.b / size)


def _search(sets: Sets, model: Model, a: Array, b: Array, free: tuple[bool, bool]) -> Found:
    """Return the best of many starts and rates of lapses, after a few steps each.

    x is in spreads of the levels.
    """
    shape, each = sets.x.shape[:-1], Sets(*(v[..., None, :] for v in sets))
    grid = np.linspace(0, 1, GRID if model.lapse is None else 1)
    # what is held makes many of them one
    starts = list(dict.fromkeys((free[0] * m, free[1] * s) for m, s in STARTS))
    middles, slopes = (np.tile(v, grid.size) for v in np.array(starts).T)
    low = np.full(shape, 0.0 if model.lapse is None else model.lapse)
    high = low + (LAPSES if model.lapse is None else 0.0)
    for _ in range(ZOOMS if model.lapse is None else 1):
        rates = np.repeat(low[..., None] + (high - low)[..., None] * grid, len(starts), axis=-1)
        steep = slopes if free[1] else b[..., None]
        start = -middles * steep if free[0] else a[..., None]
        found = _climb(
            each,
            model,
            Found(*(np.broadcast_to(v, rates.shape) for v in (start, steep, rates, 0.0))),
            free,
            FEW,
        )
        best = np.argmax(found.loglik, axis=-1)[..., None]
        found = Found(*(np.take_along_axis(v, best, -1)[..., 0] for v in found))
        step = (high - low) / (GRID - 1)
        low, high = np.maximum(found.lapse - step, 0.0), np.minimum(found.lapse + step, LAPSES)
    return found


def _climb(sets: Sets, model: Model, start: Found, free: tuple[bool, ...], steps: int) -> Found:
    """Climb from one row for each start.

    A row is left alone when its steps have become small. A third column in free is the
    rate of lapses.
    """
    shape = start.a.shape
    z, yes, n = (np.broadcast_to(v, shape + v.shape[-1:]).reshape(start.a.size, -1) for v in sets)
    at = np.stack([start.a.ravel(), start.b.ravel(), start.lapse.ravel()], axis=1)
    loglik, step = _score(at, z, yes, n, model, free)
    active = np.arange(len(at))
    for _ in range(steps):
        trial = at[active] + step[active]
        trial[:, 2] = np.clip(trial[:, 2], 0.0, np.maximum(LAPSES, at[active, 2]))
        new, newer = _score(trial, z[active], yes[active], n[active], model, free)
        better = new >= loglik[active] - 1e-12 * np.abs(loglik[active])
        at[active[better]], loglik[active[better]] = trial[better], new[better]
        step[active] = np.where(better[:, None], newer, step[active] / 2)
        active = active[(np.abs(step[active]) > 1e-11 * (1 + np.abs(at[active]))).any(axis=1)]
        if not active.size:
            break
    return Found(*(v.reshape(shape) for v in (*at.T, loglik)))


def _score(
    at: Array, z: Array, yes: Array, n: Array, model: Model, free: tuple[bool, ...]
) -> tuple[Array, Array]:
    """Return the log-likelihood of each row, and its step.

    The step is the expected information's inverse times the gradient.
    """
    eta, lapse = at[:, :1] + at[:, 1:2] * z, at[:, 2:]
    p, q = probability(eta, model, lapse)
    slope = (1 - (lapse if model.guess is None else model.guess) - lapse) * curve(model.link)[1](
        eta
    )
    loglik = total(yes * np.log(p) + (n - yes) * np.log(q))
    if free[2:] == (True,):
        return loglik, _joint_step(at, z, yes, n, model, free, eta, p, q, slope)
    g, w = slope * (yes / p - (n - yes) / q), n * slope * slope / (p * q)
    g0, g1, w0, w1, w2 = (total(v) for v in (g, g * z, w, w * z, w * z * z))
    if free[:2] == (True, True):
        det = w0 * w2 - w1 * w1 + FLOOR
        return (
            loglik,
            np.stack([w2 * g0 - w1 * g1, w0 * g1 - w1 * g0, 0 * g0], axis=1) / det[:, None],
        )
    return loglik, np.stack(
        [free[0] * g0 / (w0 + FLOOR), free[1] * g1 / (w2 + FLOOR), 0 * g0], axis=1
    )


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
    """Return Newton's step of all three.

    Where the log-likelihood is not concave, it is by the expected information.
    """
    F, density = (f(eta) for f in curve(model.link)[:2])
    bent = slope * (-eta if model.link == "probit" else 1 - 2 * F)
    both = -density * (2 if model.guess is None else 1)  # of the curve and the rate
    line, rate = (
        np.stack([free[0] + 0 * z, free[1] * z, 0 * z], axis=1),
        np.array([0.0, 0.0, 1.0])[:, None],
    )
    d = slope[:, None] * line + rate * (1 - 2 * F if model.guess is None else -F)[:, None]
    r = yes / p - (n - yes) / q
    gradient = total(d * r[:, None])
    held = np.where(gradient[:, 2] > 0, at[:, 2] >= LAPSES, at[:, 2] <= 0)
    d[held, 2], gradient[held, 2], both[held] = 0.0, 0.0, 0.0
    outer = d[:, :, None] * d[:, None]
    expected = total(outer * (n / (p * q))[:, None, None])
    crossed = line[:, :, None] * rate + rate[:, None] * line[:, None]
    second = line[:, :, None] * line[:, None] * bent[:, None, None] + crossed * both[:, None, None]
    observed = total(
        outer * (yes / p**2 + (n - yes) / q**2)[:, None, None] - second * r[:, None, None]
    )
    # what is held has none
    little = (1e-12 * np.trace(expected, axis1=1, axis2=2) + FLOOR)[:, None, None] * np.eye(3)
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
