"""Laws of sensation, the JND from d', and scales from pairs and rankings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import BadValue, Below1, computed, counted, need, public
from .compare import LARGEST, Coefficient
from .likelihood import numbers


@dataclass(frozen=True)
class Line:
    """A straight line by least squares, y = intercept + slope x.

    Attributes
    ----------
    slope, intercept : float
    slope_error, intercept_error : float
        Standard errors.
    slope_p, intercept_p : float
        Two-sided, of t with ``df`` degrees of freedom against 0.
    r2 : float
        Part of the variance that is explained.
    df : int
        Points - 2.
    """

    slope: float
    intercept: float
    slope_error: float
    intercept_error: float
    slope_p: float
    intercept_p: float
    r2: float
    df: int


@public
@computed
def line(x: ArrayLike, y: ArrayLike) -> Line:
    """Fit a straight line, such as Weber's law with an intercept to JNDs.

    Parameters
    ----------
    x, y : array_like, shape (n,)
        At least three points.

    Returns
    -------
    Line

    Raises
    ------
    BadValue
        Shapes that differ, fewer than three points, numbers that are not finite, all x
        the same.

    Examples
    --------
    >>> from stimlib.experiments import line
    >>> jnds = line(
    ...     [0.25, 0.5, 0.75], [0.03615, 0.0693, 0.10875]
    ... )  # Çaldıran's thesis, fig. 3.6
    >>> (
    ...     round(jnds.slope, 4),
    ...     round(jnds.intercept, 4),
    ...     round(jnds.slope_p, 4),
    ...     round(jnds.r2, 3),
    ... )
    (0.1452, -0.0012, 0.0319, 0.997)
    """
    x, y = _points("line", x, y)
    found = scipy.stats.linregress(x, y)
    df = x.size - 2
    errors = (found.stderr, found.intercept_stderr) if np.ptp(y) else (0.0, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = 2 * scipy.stats.t.sf(abs(np.float64(found.intercept) / errors[1]), df)
    return Line(
        float(found.slope),
        float(found.intercept),
        float(errors[0]),
        float(errors[1]),
        float(found.pvalue),
        float(p),
        float(found.rvalue**2),
        df,
    )


@dataclass(frozen=True)
class Law:
    """A law of sensation, fitted to ratings.

    Attributes
    ----------
    name : str
        ``"fechner"``: R = offset + gain log10(I).  ``"stevens"``: R = factor
        I^exponent, fitted as a line in logarithms.
    line : Line
        In log10 of the stimulus, and of the rating for Stevens.
    r2 : float
        Part of the variance of the ratings themselves that the law explains, so that
        the two can be compared.
    aic : float
        n log(RSS/n) + 4, of the ratings: the smaller, the better.
    """

    name: str
    line: Line
    r2: float
    aic: float

    def __call__(self, intensity: ArrayLike) -> np.ndarray:
        """Return the rating of a stimulus."""
        value = self.line.intercept + self.line.slope * np.log10(intensity)
        return 10**value if self.name == "stevens" else value


@public
@computed
def fechner(intensity: ArrayLike, rating: ArrayLike) -> Law:
    """Fit Fechner's law, R = a + b log10(I).

    Parameters
    ----------
    intensity : array_like, shape (n,)
        Above 0.
    rating : array_like, shape (n,)

    Returns
    -------
    Law

    Raises
    ------
    BadValue
        As `line`; an intensity that is not above 0; ratings that are all the same.

    References
    ----------
    Gescheider (1997), Psychophysics: The Fundamentals, chapter 1.

    Examples
    --------
    >>> from stimlib.experiments import fechner
    >>> law = fechner([0.1, 1.0, 10.0], [2.0, 4.0, 6.0])
    >>> round(law.line.intercept, 6), round(law.line.slope, 6), law(100.0).round(6)
    (4.0, 2.0, np.float64(8.0))
    """
    x, y = _points("fechner", intensity, rating)
    _above("fechner", "intensity", x)
    return _law("fechner", x, y, line(np.log10(x), y))


@public
@computed
def stevens(intensity: ArrayLike, rating: ArrayLike) -> Law:
    """Fit Stevens' law, R = c I^n, as a line in logarithms.

    Parameters
    ----------
    intensity, rating : array_like, shape (n,)
        Above 0.

    Returns
    -------
    Law
        The exponent is ``line.slope``, the factor 10**line.intercept.

    Raises
    ------
    BadValue
        As `line`; an intensity or a rating that is not above 0; ratings that are all
        the same.

    References
    ----------
    Stevens (1957), Psychological Review 64:153.

    Examples
    --------
    >>> from stimlib.experiments import stevens
    >>> law = stevens([1.0, 4.0, 16.0], [3.0, 6.0, 12.0])
    >>> round(law.line.slope, 6), round(float(law(64.0)), 6)
    (0.5, 24.0)
    """
    x, y = _points("stevens", intensity, rating)
    _above("stevens", "intensity", x)
    _above("stevens", "rating", y)
    return _law("stevens", x, y, line(np.log10(x), np.log10(y)))


def _law(name: str, x: np.ndarray, y: np.ndarray, fitted: Line) -> Law:
    if np.ptp(y) == 0:
        raise BadValue(f"{name}: all ratings are {y[0]:g}: there is nothing for a law to explain")
    rest = float(np.sum((y - Law(name, fitted, 0.0, 0.0)(x)) ** 2))
    with np.errstate(divide="ignore"):
        aic = float(x.size * np.log(rest / x.size) + 4)
    return Law(name, fitted, 1 - rest / float(np.sum((y - y.mean()) ** 2)), aic)


@public
@computed
def jnd_from_dprime(d: ArrayLike, increment: ArrayLike) -> float:
    """Return the increment at which d' is 1.

    It is 1 over the mean of the slopes d'/increment.

    Parameters
    ----------
    d : array_like, shape (.., n)
        d' of each increment; further axes (participants) are averaged over, slope by
        slope, as the thesis does.
    increment : array_like, shape (n,)
        Above 0, in the unit of the stimulus.

    Returns
    -------
    float
        In the unit of the increments; nan where the mean slope is not above 0.

    Raises
    ------
    BadValue
        No d', an increment not above 0, or shapes that do not fit.

    References
    ----------
    Çaldıran's thesis, section 3.7; Tan et al. (1995), Perception and Psychophysics
    57:495.

    Examples
    --------
    >>> from stimlib.experiments import jnd_from_dprime
    >>> jnd_from_dprime([1.0, 2.0, 3.0], [0.05, 0.1, 0.15])
    0.05
    """
    d, step = numbers("jnd_from_dprime: d", d), numbers("jnd_from_dprime: increment", increment)
    if not d.size or not step.size or np.isnan(d).any():
        raise BadValue("jnd_from_dprime: there is no d', or one is masked and not finite")
    if d.shape[-1:] != step.shape:
        raise BadValue(
            f"jnd_from_dprime: d has shape {d.shape}, so increments must be {d.shape[-1:]}, not"
            f" {step.shape}"
        )
    _above("jnd_from_dprime", "increment", np.atleast_1d(step))
    slope = float(np.mean(d / step))
    return 1 / slope if slope > 0 else float("nan")


@public
def bradley_terry(
    rankings: Sequence[Sequence[str | int]],
    participants: Sequence[str | int] | None = None,
    reference: str | int | None = None,
    confidence: Below1 = 0.95,
) -> tuple[Coefficient, ...]:
    """Estimate a scale from pairs (Bradley-Terry) or rankings (Plackett-Luce).

    Item i is preferred to j with probability exp(a_i)/(exp(a_i) + exp(a_j)).  A ranking
    is a row of choices: its first out of all, its second out of the rest, and so on; a
    pair is a ranking of two.  The abilities a are those of the largest likelihood, by
    Newton's method.

    Parameters
    ----------
    rankings : sequence of sequences
        Of names, the most (preferred, rough, ..) first: pairs (winner, loser), or
        answers of `ranking`.  They may have different lengths and leave items out.
    participants : sequence, optional
        Whose ranking each is.  Errors then allow for people who differ from each other
        (sandwich estimate, t with one degree of freedom less than people); without, all
        rankings count as independent, and errors are too small if people differ and
        answer several times.
    reference : optional
        The name whose ability is 0; by default the mean of all is.
    confidence : float

    Returns
    -------
    tuple of Coefficient
        The ability of each item, in the order of first appearance, with its standard
        error, z, two-sided p against 0, and interval.

    Raises
    ------
    BadValue
        Rankings of fewer than two names, or with a name twice; participants that are
        not one for each ranking, or fewer than two of them; items that were always or
        never preferred to the others, or not compared with them, so that their ability
        is infinite or unknown.
    UnknownName
        The reference is in no ranking.

    References
    ----------
    Bradley and Terry (1952), Biometrika 39:324; Plackett (1975), Applied Statistics
    24:193; Hunter (2004), Annals of Statistics 32:384, of when there is a maximum.

    Examples
    --------
    >>> from stimlib.experiments import bradley_terry
    >>> pairs = [("silk", "felt")] * 8 + [("felt", "silk")] * 2
    >>> pairs += [("felt", "cork")] * 7 + [("cork", "felt")] * 3
    >>> for a in bradley_terry(pairs, reference="cork"):
    ...     print(f"{a.name} {a.value:.2f} +- {a.error:.2f}")
    silk 2.23 +- 1.05
    felt 0.85 +- 0.69
    cork 0.00 +- 0.00
    """
    for k, row in enumerate(list(rankings) or [()]):
        if not 1 < len(row) == len(set(row)):
            raise BadValue(
                f"bradley_terry: ranking {k}, {row!r:.80}, must be a list of at least two names,"
                " each once, the most first"
            )
    items = list(dict.fromkeys(item for row in rankings for item in row))
    stages = [(k, row[i:]) for k, row in enumerate(rankings) for i in range(len(row) - 1)]
    there = np.array([[item in left for item in items] for _, left in stages])
    won = np.array([[item == left[0] for item in items] for _, left in stages])
    _check_connected(items, won.T.astype(float) @ there > 0)
    theta, chance, inverse = _abilities(there, won)
    people = [] if participants is None else list(dict.fromkeys(participants))
    df = len(people) - 1 if people else np.inf
    if participants is not None:
        if len(participants) != len(rankings) or len(people) < 2:
            raise BadValue(
                f"bradley_terry: {counted(len(participants), 'participant')}, {len(people)}"
                " different, of"
                f" {counted(len(rankings), 'ranking')}; give whose each ranking is, of at least"
                " two people"
            )
        whose = np.array([[participants[k] == one for k, _ in stages] for one in people], float)
        inverse = np.cov((whose @ (won - chance) @ inverse).T) * len(people)
    need("bradley_terry", [reference] * (reference is not None), items, "item")
    at = np.array([reference in (None, item) for item in items], float)
    contrast = np.eye(len(items)) - at / at.sum()
    values, errors = contrast @ theta, np.sqrt(np.diag(contrast @ inverse @ contrast.T))
    z = values / np.where(errors > 0, errors, np.nan)
    p, width = 2 * scipy.stats.t.sf(np.abs(z), df), scipy.stats.t.ppf((1 + confidence) / 2, df)
    rows = np.stack([values, errors, z, p, values - width * errors, values + width * errors])
    return tuple(Coefficient(str(i), *row) for i, row in zip(items, rows.T.tolist(), strict=True))


def _check_connected(items: Sequence[str | int], preferred: np.ndarray) -> None:
    """Raise BadValue unless each item was preferred, by some chain, to every other."""
    count, group = scipy.sparse.csgraph.connected_components(preferred, connection="strong")
    if count == 1:
        return
    names: dict[int, list[str]] = {}
    for item, k in zip(items, group.tolist(), strict=True):
        names.setdefault(k, []).append(str(item))
    raise BadValue(
        f"bradley_terry: the groups {' | '.join(map(', '.join, names.values()))} have no finite"
        " distance, because no item of one was ever preferred to any of another, or they were not"
        " compared; ask for more pairs across the groups, or leave a group out"
    )


def _abilities(there: np.ndarray, won: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the abilities of largest likelihood, the chances, and their covariance."""
    theta = np.zeros(there.shape[1])
    for _ in range(100):
        chance = scipy.special.softmax(np.where(there, theta, -np.inf), axis=1)
        # ones: the mean of all is free, and taken away by the contrast
        inverse = np.linalg.inv(np.diag(chance.sum(axis=0)) - chance.T @ chance + 1)
        step = inverse @ (won - chance).sum(axis=0)
        most = 2 * np.abs(step).max()
        if most < 1e-10:
            break
        theta = theta + step * np.log1p(most) / most  # so far the likelihood rises for sure
    return theta, chance, inverse


def _points(what: str, x: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    x, y = numbers(f"{what}: the first", x), numbers(f"{what}: the second", y)
    if x.ndim != 1 or x.shape != y.shape or x.size < 3:
        raise BadValue(
            f"{what}: give two rows of one length, of at least three points; got shapes {x.shape}"
            f" and {y.shape}"
        )
    # not >: a masked value is nan
    if not max(np.abs([x, y]).max(), *(1 / np.ptp(v) for v in (x, y) if np.ptp(v))) <= LARGEST:
        raise BadValue(
            f"{what}: numbers that are masked or not finite, above {LARGEST:g}, or that differ by"
            f" less than {1 / LARGEST:g}, have no sums of squares; leave out gaps, and give the"
            " others in another unit"
        )
    if np.ptp(x) == 0:
        raise BadValue(f"{what}: all points have the same x, {x[0]:g}: a line needs two places")
    return x, y


def _above(what: str, name: str, row: np.ndarray) -> None:
    if not (row > 0).all():
        at = int(np.argmin(row > 0))
        raise BadValue(f"{what}: {name}[{at}] = {row[at]:g} must be above 0")
