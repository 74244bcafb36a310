"""Psychometric functions from answers: PSE or threshold, JND, and their intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..core.units import pretty
from ..errors import BadValue, need, public, shortened
from ..system.packages import package
from .goodness import (
    allowed,
    best_possible,
    dispersion,
    goodness,
    highest_of_any,
    parameters,
)
from .likelihood import (
    FREE,
    GUESSES,
    LAPSES,
    NEAR,
    PROBIT,
    PROBLEMS as ESTIMATES,
    Array,
    Found,
    Model,
    Sets,
    curve,
    ends,
    maximum,
    numbers,
    probability,
    total,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
SAME = 1e-12  # levels that differ by less, relative to their size, differ by rounding
ROUNDED = 1e-11  # the same between fits, whose levels may have gone through a logarithm
BEYOND = 4.0  # sigmas from the PSE, where nobody errs but by a lapse
RESAMPLES = 2000  # fits of a bootstrap
SAME_FIT = 1e-2  # twice a difference in log-likelihood that the search may leave
SHARED = "shared"  # a rate that is fitted to all sets together
LATTICE = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0)  # shared rates to begin from, of the highest
# trials at a level, beyond which likelihoods are too coarse for intervals; size of a
# level
MOST, LARGEST = 1e9, 1e100
TOGETHER = 256  # sets in one call, so that memory stays small
Interval = tuple[float, float]
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class Fit:
    """A psychometric function fitted to answers.

    Attributes
    ----------
    pse : float
        Where the curve is half-way up, in the unit of the levels: the point of
        subjective equality of a comparison, the threshold of a detection.
    sigma : float
        Spread of the curve on the axis of the fit (of log10 of the levels with
        ``log``): of a cumulative normal its standard deviation, of a logistic function
        and of Gumbel's its scale.  Weibull's exponent is 1/(sigma ln 10).
    lapse, guess : float
        How far the curve stays from 1 above, and from 0 below.
    pse_interval, sigma_interval : (float, float)
        Ends may be infinite, sigma's lower one 0: the data then allow it.
    problems : tuple of str
        Names in `PROBLEMS`; empty for a fit that can be used.  With any but "lapses",
        "guess", "overdispersed", "beyond" and "edge", PSE, sigma and intervals are nan.
        "edge" is of a rate of guesses or lapses that was fitted, at its largest.
    loglik, deviance : float
        Log-likelihood of the fit without the binomial coefficients, and deviance from a
        curve through every level's proportion.
    p : float
        Goodness of fit: how often answers drawn from the curve have a deviance at least
        as large, of 1000 draws.
    dispersion : float
        Variance of the answers about the curve as a part of the binomial one, by
        Pearson's statistic; nan where there are as few levels as parameters.
    parameters : int
        How many were fitted to this set alone.
    shared : int
        How many rates were fitted to all sets together.
    trials, levels : int
        How many answers, and different levels, there were.
    gap : (float, float)
        The highest level with a no and the lowest with a yes, the lower one first; with
        ``guess``, the highest level with answers below half-way and the lowest with
        answers above, infinite if there is none.
    comparison : bool
        Whether the curve is symmetric, so that ``pse`` is a point of subjective
        equality; with a chance level it is a threshold.
    unit : str
        Of the levels, as it was given.
    data : tuple of (float, int, int)
        Each level, how many said yes, how many were asked.
    method : tuple
        How it was fitted, for `level_interval`.
    """

    pse: float
    sigma: float
    lapse: float
    guess: float
    pse_interval: Interval
    sigma_interval: Interval
    problems: tuple[str, ...]
    loglik: float
    deviance: float
    trials: int
    levels: int
    gap: Interval
    p: float
    dispersion: float
    parameters: int
    shared: int = 0
    link: str = "probit"
    log: bool = False
    confidence: float = 0.95
    comparison: bool = True
    unit: str = ""
    data: tuple[tuple[float, int, int], ...] = ()
    method: tuple[Model, float, _How] | None = field(default=None, repr=False, compare=False)

    @property
    def name(self) -> str:
        """The name of ``pse``: "PSE" for a comparison, "threshold" for a detection."""
        return "PSE" if self.comparison else "threshold"

    def __str__(self) -> str:
        low, high = self.pse_interval
        unit = f" {pretty(self.unit)}" if self.unit else ""
        jnd = f"{self.jnd:.0%} of it" if self.log else f"{self.jnd:.4g}{unit}"
        text = f"{self.name} {self.pse:.4g}{unit} [{low:.4g}, {high:.4g}], JND {jnd}"
        if math.isfinite(self.p):
            text += f", fit p = {self.p:.2g}"
        return f"{text}; problems: {', '.join(self.problems)}" if self.problems else text

    @property
    def aic(self) -> float:
        """Akaike's information criterion; the model with the lower value is better.

        Compare only models that were fitted to the same answers.  The criterion of a
        model of n sets is the sum over its fits, less 2 (n - 1) for each shared rate,
        which every fit counts.
        """
        return 2 * (self.parameters + self.shared - self.loglik)

    @property
    def slope(self) -> float:
        """Slope of the link on the axis of the fit, 1/sigma, as in regressions."""
        return 1 / self.sigma

    @property
    def intercept(self) -> float:
        """Value of the link at 0 on the axis of the fit."""
        return -self._axis(self.pse) / self.sigma

    @property
    def jnd(self) -> float:
        """Just-noticeable difference, from 50 to 75 % of the curve.

        It is in the unit of the levels; with ``log`` it is a part of the PSE.
        """
        return self._difference(self.sigma)

    @property
    def jnd_interval(self) -> Interval:
        """Interval of ``jnd``, from that of sigma."""
        low, high = self.sigma_interval
        return self._difference(low), self._difference(high)

    def __call__(self, level: ArrayLike) -> Array:
        """Return the probability of yes at a level.

        Parameters
        ----------
        level : array_like
            In the unit of the levels; 0 is allowed with ``log``, too.

        Returns
        -------
        ndarray, of the same shape

        Raises
        ------
        BadValue
            A level below 0 with ``log``, or no numbers.
        """
        axis = numbers("fit: level", level)
        if self.log:
            if (axis < 0).any():
                raise BadValue(
                    f"fit: level = {axis.min():g} must be 0 or above, because the curve is over"
                    " the logarithm of the level"
                )
            with np.errstate(divide="ignore"):
                axis = np.log10(axis)
        eta = (axis - self._axis(self.pse)) / self.sigma
        return probability(eta, self.link, self.guess, self.lapse)[0]

    def level(self, p: ArrayLike) -> Array:
        """Return the level where the probability of yes is p.

        Parameters
        ----------
        p : array_like
            Between the rate of guesses and 1 less the rate of lapses; elsewhere the
            level is nan.

        Returns
        -------
        ndarray, of the same shape
            In the unit of the levels.

        Examples
        --------
        >>> from stimlib.experiments import psychometric
        >>> right, asked = [11, 14, 19, 20], [20] * 4
        >>> fit = psychometric([1.0, 2.0, 3.0, 4.0], right, asked, guess=0.5)
        >>> round(float(fit.level(0.75)), 3) == round(fit.pse, 3)
        True
        """
        axis = self._axis(self.pse) + self.sigma * curve(self.link).inverse(self._part(p))
        return _power(axis) if self.log else axis

    def level_interval(self, p: float) -> Interval:
        """Return the interval of the level where the probability of yes is p.

        It is found as those of the PSE and sigma were, by profile or bootstrap; rates
        that were fitted are taken as known where p is turned into a part of the curve.
        At the middle of the curve it is ``pse_interval``.

        Parameters
        ----------
        p : float
            As for `level`; where that is nan, so are the ends.

        Returns
        -------
        (float, float)
            In the unit of the levels; ends may be infinite.

        Examples
        --------
        >>> from stimlib.experiments import psychometric
        >>> yes, asked = [1, 4, 9, 17, 19], [20] * 5
        >>> fit = psychometric([1.0, 1.5, 2.0, 2.5, 3.0], yes, asked)
        >>> low, high = fit.level_interval(0.75)
        >>> print(f"{fit.level(0.75):.2f} [{low:.2f}, {high:.2f}]")
        2.39 [2.19, 2.65]
        """
        part = float(self._part(p))
        if self.method is None or not math.isfinite(self.pse + part):
            return math.nan, math.nan
        model, fall, how = self.method
        at, yes, asked = np.array(self.data).T[:, None]
        sets = Sets(np.log10(at) if self.log else at, yes, asked)
        best = maximum(sets, _middle(sets, model), model)
        low, high = _around(sets, model, np.array([fall]), how, best, part)[0, :, 0].tolist()
        return (float(_power(low)), float(_power(high))) if self.log else (low, high)

    def _part(self, p: ArrayLike) -> Array:
        """Return the part of the way from the guess rate up at which the curve is p."""
        part = (numbers("fit: p", p) - self.guess) / (1 - self.guess - self.lapse)
        return np.where((part > 0) & (part < 1), part, np.nan)

    def advice(self) -> list[str]:
        """Return the problems of the fit, and what to do about them."""
        low, high = self.gap
        against = f"contradict a chance level of {self.guess:.3g}"
        if self.comparison:
            against = "fit a chance level of 0.5 about as well as a symmetric curve"
        falls = allowed([self.dispersion, math.nan], self.levels - self.parameters, self.confidence)
        wider = math.sqrt(falls[0] / falls[1])
        between = f"near {low:.6g}" if low == high else f"between {low:.6g} and {high:.6g}"
        facts = dict(name=self.name, between=between, against=against, p=self.p, wider=wider)
        return [PROBLEMS[name].format(**facts) for name in self.problems]

    def plot(self) -> Figure:
        """Draw the proportion of yes at each level, the curve, and its interval.

        Returns
        -------
        matplotlib.figure.Figure
            Yours to change and to save.  The area of a point is how many were asked.

        Examples
        --------
        >>> from stimlib.experiments import psychometric
        >>> fit = psychometric(
        ...     [1.0, 1.5, 2.0, 2.5, 3.0], [1, 4, 9, 17, 19], [20] * 5, unit="N/mm"
        ... )
        >>> fit.plot().axes[0].get_xlabel()
        'level / N/mm'
        """
        figure = package("matplotlib.figure", "a picture").Figure(
            figsize=(5, 3.5), layout="constrained"
        )
        ax = figure.subplots()
        self.draw(ax)
        ax.set(
            xlabel=f"level / {pretty(self.unit)}" if self.unit else "level",
            ylabel=f"proportion {'of yes' if self.comparison or not self.guess else 'correct'}",
        )
        return figure

    def draw(self, ax: Any) -> None:
        """Draw the picture of ``plot`` into existing matplotlib axes.

        Parameters
        ----------
        ax : matplotlib.axes.Axes
        """
        at, yes, asked = np.array(self.data).T
        ax.scatter(at, yes / asked, s=8 * asked, alpha=0.5, linewidths=0)
        if np.isfinite(self.pse):
            x = np.geomspace(at[0], at[-1], 200) if self.log else np.linspace(at[0], at[-1], 200)
            ax.plot(x, self(x), color="C1")
            ax.plot(
                np.clip(self.pse_interval, at[0], at[-1]), [self(self.pse)] * 2, color="C1", lw=3
            )
        if self.log:
            logarithmic(ax.xaxis, ax.set_xscale)
        ax.set(ylim=(-0.05, 1.05))
        ax.grid(alpha=0.3)

    def _axis(self, level: float) -> float:
        return math.log10(level) if self.log else level

    def _difference(self, sigma: float) -> float:
        wide = float(curve(self.link).inverse(0.75)) * sigma
        if not self.log:
            return wide
        return float(_power(wide)) - 1


def _power(exponent: ArrayLike) -> Array:
    """Return 10 to a power: infinity where a float cannot hold it, and nan of nan."""
    with np.errstate(over="ignore"):
        return np.power(10.0, exponent)


def logarithmic(axis: Any, scale: Callable[[str], Any]) -> None:
    """Make an axis of matplotlib logarithmic, with plain ticks at 1, 2 and 5.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
    scale : callable
        ``set_xscale`` or ``set_yscale`` of its axes.
    """
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    scale("log")
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


@public
def psychometric(
    levels: ArrayLike | Mapping[str, Sequence[Any]],
    yes: ArrayLike | None = None,
    trials: ArrayLike | None = None,
    *,
    link: str = "probit",
    log: bool = False,
    guess: float | str | None = None,
    lapse: float | str = 0.0,
    dispersion: float | None = None,
    interval: str = "profile",
    confidence: float = 0.95,
    seed: int = 0,
    unit: str = "",
    pse: float | None = None,
) -> Fit:
    """Fit a psychometric function by maximum likelihood.

    p(x) = g + (1 - g - l) F((x - PSE)/sigma), with g the rate of guesses and l that of
    lapses.

    Parameters
    ----------
    levels : array_like, shape (n,), or table of answers
        Of each trial, or of each group of trials.  Or, alone, a table with the columns
        ``level``, ``outcome`` and ``chance``, such as
        `stimlib.experiments.observers.simulate` gives: then the chance level is that of
        the task.
    yes : array_like, shape (n,), optional
        1 where the answer was yes ("the comparison is stiffer"), else 0; with
        ``trials``: how many were.
    trials : array_like, shape (n,), optional
        How many were asked at each level.
    link : {"probit", "logit", "gumbel", "weibull"}
        Cumulative normal; logistic; Gumbel's, 1 - 2^-exp(z); Weibull's, which is
        Gumbel's with ``log``.
    log : bool
        Fit over log10 of the levels, which are then above 0.
    guess : float or "free", optional
        Chance level, the rate of yes where nothing can be felt: 1/m for the right one
        of m intervals, 0 for yes or no.  By default that of the task, if a table has
        it.  Else it is the rate of lapses, as for a comparison, where who did not
        attend says yes half the time: then twice ``lapse`` of the trials were not
        attended to.  "free" fits it, from 0 to 0.8.
    lapse : float or "free"
        Rate of lapses, below 0.5; "free" fits it, from 0 to 0.1.
    dispersion : float, optional
        Variance of the answers as a part of the binomial one, for the intervals.  By
        default it is estimated, and widens them where it is large: the log-likelihood
        falls by half of the larger of the quantile of chi squared and ``dispersion``
        times the quantile of F.  1 takes answers as binomial.
    interval : {"profile", "bootstrap", "none"}
        Where the log-likelihood has fallen by half the quantile of chi squared, all
        else fitted anew; or quantiles of 2000 fits to answers drawn from this one
        (parametric, percentile); or none, which is quicker.
    confidence : float
        Of each interval.
    seed : int
        Of the bootstrap.
    unit : str
        Of the levels, for texts and pictures.
    pse : float, optional
        Where the middle of the curve is known, such as the standard of two intervals
        that differ in the level alone: where the difference is 0, half of all answers
        are "more", and only sigma is fitted.  Of a level that is itself a difference it
        is 0, and the curve starts at a chance level of 1/2 there.  By default it is
        fitted.

    Returns
    -------
    Fit
        Data that determine no curve give no error and no wild number: ``problems``
        names what is wrong.

    Raises
    ------
    BadValue
        Shapes that differ, numbers that are not finite, answers that are no counts,
        parameters outside their range; a table of tasks with different chance levels;
        ``pse`` with a chance level other than 1/2.
    UnknownName
        A table without ``level`` or ``outcome``.

    Notes
    -----
    Who tires, learns or drifts between blocks has no one probability at a level, and
    binomial intervals are too narrow: of beta-binomial answers with nu = 15, 20 at each
    of 7 levels, those of 95 % hold the PSE of 81 %.  Widened they hold that of 93 to
    94 %, and of steady participants that of 97 %.  "overdispersed" is named where
    ``Fit.p`` is below 0.01.

    A wrong chance level shifts the middle: the threshold of a detection in two
    intervals comes out too low by half without ``guess=0.5``.  ``problems`` has "guess"
    in two cases.  A chance level that was given is held against 0, 1/4, 1/3 and 1/2: it
    is flagged where twice the gain in log-likelihood is above 6.63, which chance
    exceeds in 1 of 100 (chi squared, one degree of freedom).  Of a symmetric curve it
    is flagged where chance level 1/2 fits about as well, twice the difference above -2.

    References
    ----------
    Finney (1971), Probit Analysis; Wichmann and Hill (2001), Perception and
    Psychophysics 63:1293 and 63:1314; Albert and Anderson (1984), Biometrika 71:1
    (separation); McCullagh and Nelder (1989), Generalized Linear Models, section 4.5
    (dispersion).

    Examples
    --------
    >>> from stimlib.experiments import psychometric
    >>> fit = psychometric([1.0, 1.5, 2.0, 2.5, 3.0], [1, 4, 9, 17, 19], [20] * 5)
    >>> (
    ...     round(fit.pse, 3),
    ...     round(fit.jnd, 3),
    ...     [round(v, 3) for v in fit.pse_interval],
    ...     fit.problems,
    ... )
    (1.998, 0.391, [1.813, 2.182], ())
    >>> psychometric([1.0, 2.0, 3.0, 4.0], [0, 0, 20, 20], [20] * 4).advice()
    ['no level has both answers but the one between: the slope is not determined, ...']
    >>> found = psychometric(
    ...     [1.0, 2.0, 3.0, 4.0], [11, 14, 19, 20], [20] * 4, guess=0.5, unit="mm"
    ... )
    >>> print(found)
    threshold 2.144 mm [1.465, 3], JND 0.4454 mm, fit p = 0.87
    """
    given: Any = (
        levels if yes is None else (levels, yes) if trials is None else (levels, yes, trials)
    )
    return psychometrics(
        {"": given},
        link=link,
        log=log,
        guess=guess,
        lapse=lapse,
        dispersion=dispersion,
        interval=interval,
        confidence=confidence,
        seed=seed,
        unit=unit,
        pse=pse,
    )[""]


@public
def psychometrics(
    data: Mapping[Key, Sequence[Any] | Mapping[str, Sequence[Any]]],
    *,
    link: str = "probit",
    log: bool = False,
    guess: float | str | None = None,
    lapse: float | str = 0.0,
    dispersion: float | None = None,
    interval: str = "profile",
    confidence: float = 0.95,
    seed: int = 0,
    unit: str = "",
    pse: float | None = None,
) -> dict[Key, Fit]:
    """Fit many psychometric functions at once, in a fraction of the time.

    Each has the bits that it has alone.

    Parameters
    ----------
    data : dict of key to (levels, yes), (levels, yes, trials) or a table of answers
        Of each participant and condition, say; each as `psychometric` takes it.
    link, log, dispersion, interval, confidence, seed, unit, pse
        As `psychometric`.
    guess, lapse : float or {"free", "shared"}
        As `psychometric`; "shared" fits one rate to all sets of this call, which their
        intervals take as known.  For a rate of each participant, call it for each.

    Returns
    -------
    dict of key to Fit

    Raises
    ------
    BadValue, UnknownName
        As `psychometric`; it names the key.

    Examples
    --------
    >>> from stimlib.experiments import psychometrics
    >>> levels, asked = [1.0, 1.5, 2.0, 2.5, 3.0], [20] * 5
    >>> fits = psychometrics(
    ...     {
    ...         "P01": (levels, [1, 4, 9, 17, 19], asked),
    ...         "P02": (levels, [0, 2, 5, 11, 18], asked),
    ...     }
    ... )
    >>> {who: round(fit.pse, 2) for who, fit in fits.items()}
    {'P01': 2.0, 'P02': 2.36}
    """
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise BadValue(f"psychometric: seed = {seed!r} must be a whole number from 0 on")
    guess = float(guess) if isinstance(guess, Real) else guess
    lapse = float(lapse) if isinstance(lapse, Real) else lapse
    dispersion, confidence = dispersion and float(dispersion), float(confidence)
    log = log or link == "weibull"
    how = _How(log, dispersion, interval, confidence, int(seed), unit)
    _model(link, guess, lapse, how)
    middle = _known(pse, guess, log)
    sets: dict[Any, Any] = {}
    chances: dict[Any, Any] = {}
    fits: dict[Any, Fit] = {}
    for key, given in data.items():
        where = f"psychometrics of {shortened(key)}" if key != "" else "psychometrics"
        answers, chance = _answers(where, given)
        sets[key] = _set(where, answers, log)
        if middle is not None and chance not in (None, 0.5):
            raise BadValue(f"{where}: pse is of a curve that is 1/2 there, not of chance {chance}")
        chances[key] = None if middle is not None else chance if guess is None else guess
    parts: list[tuple[list[Any], Model]] = []
    for chance in dict.fromkeys(chances.values()):
        _model(link, chance, lapse, how)
        keys = [key for key in data if chances[key] == chance]
        model = Model(link, chance, lapse, middle)
        parts += [(keys[at : at + TOGETHER], model) for at in range(0, len(keys), TOGETHER)]
    rates = _shared([([sets[key] for key in keys], model) for keys, model in parts])
    for keys, model in parts:
        found = _fitted([sets[key] for key in keys], model, rates, how)
        fits |= zip(keys, found, strict=True)
    return {key: fits[key] for key in data}


class _How(NamedTuple):
    """How to fit, beside the model."""

    log: bool
    dispersion: float | None
    interval: str
    confidence: float
    seed: int
    unit: str


def _shared(parts: Sequence[tuple[Sequence[Sets], Model]]) -> dict[str, float]:
    """Return the rates that all sets share, whatever else their models are."""
    names = [name for name in ("guess", "lapse") if parts and getattr(parts[0][1], name) == SHARED]
    if not names:
        return {}
    padded = [(_padded(part), model) for part, model in parts]

    def loss(rates: Array) -> float:
        one = dict(zip(names, rates.tolist(), strict=True))
        return -sum(
            float(maximum(s, _middle(s, model), _with(model, one)).loglik.sum())
            for s, model in padded
        )

    # such likelihoods have several peaks: search from the best point of a lattice
    highest = np.array([GUESSES if name == "guess" else LAPSES for name in names])
    start = min((np.array(v) * highest for v in product(LATTICE, repeat=len(names))), key=loss)
    step = np.diag(np.where(start < highest / 2, 1, -1) * LATTICE[1] * highest)
    found = scipy.optimize.minimize(
        loss,
        start,
        method="Nelder-Mead",
        bounds=[(0.0, v) for v in highest],
        options={"xatol": 1e-6, "fatol": 1e-9, "initial_simplex": [start, *(start + step)]},
    )
    return dict(zip(names, found.x.tolist(), strict=True))


def _with(model: Model, rates: Mapping[str, float]) -> Model:
    guess, lapse = rates.get("guess", model.guess), rates.get("lapse", model.lapse)
    return model._replace(guess=guess, lapse=lapse)


def _middle(sets: Sets, model: Model) -> Array:
    """Return where intercepts are taken: the known middle, or that of the levels."""
    mean = total(sets.x * sets.n) / total(sets.n)
    return mean if model.pse is None else np.full_like(mean, model.pse)


def _fitted(part: Sequence[Sets], model: Model, rates: Mapping[str, float], how: _How) -> list[Fit]:
    """Return the fits of some sets, in one call of each step."""
    most = {
        n: v
        for n, v in (("lapse", LAPSES), ("guess", GUESSES))
        if getattr(model, n) in (FREE, SHARED)
    }
    sets, model = _padded(part), _with(model, rates)
    middle = _middle(sets, model)
    best = maximum(sets, middle, model)
    problems = [undetermined(_mirrored(one, model.pse)) for one in part]
    if at := [i for i, wrong in enumerate(problems) if not wrong]:
        flaws = _flaws(_some(sets, at), middle[at], model, Found(*(v[at] for v in best)))
        for i, name in zip(at, flaws, strict=True):
            problems[i] = (name,) if name else ()
    usable = [i for i, wrong in enumerate(problems) if set(wrong) <= {"lapses", "guess"}]
    fitted, least = parameters(model), float(allowed(math.nan, 0, how.confidence))
    with np.errstate(divide="ignore", invalid="ignore"):
        scatter = dispersion(sets, middle, model, best)
    freedom = np.array([one.x.size for one in part]) - fitted
    falls = allowed(scatter, freedom, how.confidence)
    if how.dispersion is not None:
        falls = np.full(len(part), how.dispersion * least)
    p = np.full(len(part), math.nan)
    for i in usable:
        p[i] = goodness(part[i], middle[i], model, Found(*(v[i] for v in best)), how.seed)
        if p[i] < SURE and not problems[i]:
            problems[i] = ("overdispersed",)
    curves = np.full((2, len(part)), math.nan)
    curves[:, usable] = middle[usable] - best.a[usable] / best.b[usable], 1 / best.b[usable]
    for i in usable:
        outside = model.pse is None and not part[i].x[0] <= curves[0, i] <= part[i].x[-1]
        # the search for a rate ends within 1e-6 of the largest
        largest = any(getattr(best, n)[i] > v - 1e-4 for n, v in most.items())
        problems[i] += ("beyond",) * outside + ("edge",) * largest
    around = np.full((2, 2, len(part)), math.nan)
    if usable:
        some = Found(*(v[usable] for v in best))
        around[..., usable] = _around(_some(sets, usable), model, falls[usable], how, some)
    return [
        _fit(
            one,
            curves[:, i],
            around[..., i],
            model,
            how,
            problems=problems[i],
            lapse=float(best.lapse[i]),
            guess=float(best.guess[i]),
            loglik=float(best.loglik[i]),
            p=float(p[i]),
            dispersion=float(scatter[i]),
            parameters=fitted,
            shared=len(rates),
            method=(model, float(falls[i]), how),
        )
        for i, one in enumerate(part)
    ]


def _around(
    sets: Sets, model: Model, falls: Array, how: _How, best: Found, part: float = 0.5
) -> Array:
    """Return the ends of the level of a part of the curve, and of sigma, on the axis.

    Of each set, as `profile`; nan without intervals.
    """
    if how.interval == "profile":
        return _profile(sets, model, falls, part, best)
    around = np.full((2, 2, falls.size), math.nan)
    if how.interval == "none":
        return around
    middle = _middle(sets, model)
    at, spread = middle + (curve(model.link).inverse(part) - best.a) / best.b, 1 / best.b
    wider = np.sqrt(falls / allowed(math.nan, 0, how.confidence))
    for i, asked in enumerate(sets.n > 0):  # a set without what fills it up
        one = Sets(*(v[i][asked] for v in sets))
        level, sigma = bootstrap(one, model, how.confidence, how.seed, part=part)
        around[0, :, i] = at[i] + wider[i] * (level - at[i])
        around[1, :, i] = spread[i] * (sigma / spread[i]) ** wider[i]
    return around


def _mirrored(one: Sets, pse: float | None) -> Sets:
    """Return a set with its mirror image about a middle that is known.

    A curve through that middle is as likely of both, and answers that are all right
    about it are separated there.
    """
    if pse is None:
        return one
    x, yes, n = (v[one.x != pse] for v in one)  # at the middle they say nothing
    return Sets(np.append(x, 2 * pse - x), np.append(yes, n - yes), np.append(n, n))


def _fit(one: Sets, found: Array, around: Array, model: Model, how: _How, **each: Any) -> Fit:
    """Return the report of a set.

    PSE and sigma, and their intervals, are on the axis of the fit.
    """
    log = how.log
    axis = np.array([found[0], *around[0]])
    pse, low, high = (_power(axis) if log else axis).tolist()
    levels = 10**one.x if log else one.x
    rows = levels, one.yes.astype(int), one.n.astype(int)
    return Fit(
        pse=pse,
        sigma=float(found[1]),
        pse_interval=(low, high),
        sigma_interval=(float(around[1, 0]), float(around[1, 1])),
        deviance=float(2 * (best_possible(one) - each["loglik"])),
        trials=int(one.n.sum()),
        levels=one.x.size,
        gap=_gap(one, log, model.guess),
        link=model.link,
        log=log,
        confidence=how.confidence,
        comparison=model.guess is None,
        unit=how.unit,
        data=tuple(zip(*(v.tolist() for v in rows), strict=True)),
        **each,
    )


def _some(sets: Sets, rows: Sequence[int] | Array) -> Sets:
    return Sets(*(v[rows] for v in sets))


def _padded(part: Sequence[Sets]) -> Sets:
    """Return sets as rows of one length.

    They are filled up with the last level, without trials.
    """
    longest = max(one.x.size for one in part)
    x = [np.pad(one.x, (0, longest - one.x.size), "edge") for one in part]
    yes, n = ([np.pad(one[i], (0, longest - one[i].size)) for one in part] for i in (1, 2))
    return Sets(np.stack(x), np.stack(yes), np.stack(n))


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
    counts = [
        sum(fit.parameters for fit in fits) + max((fit.shared for fit in fits), default=0)
        for fits in (one, other)
    ]
    df = counts[1] - counts[0]
    if df < 1:
        raise BadValue(
            f"likelihood_ratio: {counts[1]} parameters of the fuller model must be more than the"
            f" {counts[0]} of the simpler one"
        )
    gain = 2 * (sum(fit.loglik for fit in other) - sum(fit.loglik for fit in one))
    if gain < -SAME_FIT:
        raise BadValue(
            f"likelihood_ratio: the log-likelihood of the fuller model is {-gain / 2:.2g} below"
            " that of the simpler one, so it does not contain it; fit shared rates to the same"
            " sets in both"
        )
    gain = max(gain, 0.0)
    free = [(fit.levels - fit.parameters, fit.dispersion) for fit in other]
    free = [(k, v) for k, v in free if math.isfinite(v)]
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
    best = maximum(sets, _middle(sets, model), model)
    fall = np.broadcast_to(fall, shape).ravel()
    return _profile(sets, model, fall, part, best).reshape(2, 2, *shape)


def _profile(sets: Sets, model: Model, fall: Array, part: float, best: Found) -> Array:
    """Return profile-likelihood intervals, (2, 2, sets), about known maxima."""
    middle, up, z = _middle(sets, model), _quantile(model, part), np.sqrt(fall)
    both = np.repeat([-1.0, 1.0], middle.size)  # the lower ends of all sets, then the upper ones
    peaks, z, middles = Found(*(np.tile(v, 2) for v in best)), np.tile(z, 2), np.tile(middle, 2)
    twice = _some(sets, np.tile(np.arange(middle.size), 2))
    width = np.sqrt(total(sets.n * (sets.x - middle[:, None]) ** 2) / total(sets.n)) / 8

    # from there on a curve is a step, and its slope is rounding
    with np.errstate(divide="ignore"):
        steepest = np.tile(np.minimum(60.0, np.log(1e9 / width)), 2)

    def found(start: Array, step: Array, hold: Callable[[Array, Array], dict[str, Array]]) -> Array:
        """Return the ends along one way to hold a parameter."""
        last = Found(*(v.copy() for v in peaks))

        def fallen(x: Array, k: Array, search: bool) -> Array:
            """Return how far the profile has fallen, which is nearly straight."""
            now = Found(*(v[k] for v in last))
            at = dict(c=middles[k]) | hold(x, k)
            least = maximum(_some(twice, k), model=model, start=now, search=search, **at)
            for v, new in zip(last, least, strict=True):
                v[k] = new
            return np.sqrt(2 * np.maximum(peaks.loglik[k] - least.loglik, 0.0)) - z[k]

        at = ends(lambda x, k: fallen(x, k, False), start, step)
        # where another peak is higher there, the end is further away
        k = np.flatnonzero(np.isfinite(at) & bool(model.guess or model.lapse))
        k = k[fallen(at[k], k, True) < -NEAR] if k.size else k
        if k.size:
            for v, peak in zip(last, peaks, strict=True):
                v[k] = peak[k]
            at[k] = ends(lambda x, rows: fallen(x, k[rows], True), start[k], step[k])
        return at

    def at_level(m: Array, k: Array) -> dict[str, Array]:
        return dict(c=m, a=np.full(m.shape, up))

    def at_slope(logs: Array, k: Array) -> dict[str, Array]:
        return dict(b=np.exp(np.clip(logs, -60, steepest[k])))

    sigmas = np.exp(-found(np.log(np.abs(peaks.b)), -0.2 * both, at_slope))
    if model.pse is not None:  # then the level goes with sigma
        away = up * sigmas if up else np.zeros(sigmas.shape)
        levels = np.sort(model.pse + away.reshape(2, -1), axis=0).ravel()
    else:
        start = np.tile(middle + (up - best.a) / best.b, 2)
        levels = found(start, both * np.tile(width, 2), at_level)
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
    middle, up = float(np.average(sets.x, weights=sets.n)), _quantile(model, part)
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


def _quantile(model: Model, part: float) -> float:
    """Return the link at a part of the way up, or raise BadValue."""
    if not isinstance(part, (int, float)) or not 0 < part < 1:
        raise BadValue(f"part = {part!r:.80} must be a number above 0 and below 1, such as 0.75")
    return float(curve(model.link).inverse(part))


# What is given ------------------------------------------------------------------------
def _known(pse: Any, guess: Any, log: bool) -> float | None:
    """Return the middle that is given on the axis of the fit, or raise BadValue."""
    if pse is None:
        return None
    if (
        guess is not None
        or not isinstance(pse, Real)
        or not (math.isfinite(pse) and (float(pse) > 0 or not log))
    ):
        raise BadValue(
            f"psychometric: pse = {pse!r:.80} must be a finite number, above 0 for a fit over log10"
            " of the level, and without guess, because the curve is at 1/2 there"
        )
    return math.log10(pse) if log else float(pse)


def _model(link: str, guess: Any, lapse: Any, how: _How) -> None:
    """Raise BadValue unless the model and how to fit it are meant."""
    curve(link)
    if how.interval not in ("profile", "bootstrap", "none"):
        raise BadValue(
            f"psychometric: interval = {how.interval!r} must be profile, bootstrap or none"
        )
    if not 0 < how.confidence < 1:
        raise BadValue(f"psychometric: confidence = {how.confidence!r} must be above 0 and below 1")
    if how.dispersion is not None and not 0 < how.dispersion < math.inf:
        raise BadValue(
            f"psychometric: dispersion = {how.dispersion!r} must be above 0 and finite, or None to"
            " estimate it"
        )
    words = FREE, SHARED
    if guess in words and isinstance(lapse, float) and lapse >= 1 - GUESSES:
        raise BadValue(
            f"psychometric: lapse = {lapse!r} must be below {1 - GUESSES:.3g} with guess ="
            f" {guess!r}, which looks for rates up to {GUESSES}; give lapse = {FREE!r}, or a guess"
        )
    if lapse not in words and not (isinstance(lapse, (int, float)) and 0 <= lapse < 0.5):
        raise BadValue(
            f"psychometric: lapse = {lapse!r} must be at least 0 and below 0.5, or {FREE!r} to fit"
            f" it, or {SHARED!r} to fit one to all sets"
        )
    most = 1 - (LAPSES if lapse in words else lapse)
    if (
        guess is not None
        and guess not in words
        and not (isinstance(guess, (int, float)) and 0 <= guess < most)
    ):
        raise BadValue(
            f"psychometric: guess = {guess!r} must be at least 0 and below 1 - lapse, or {FREE!r}"
            f" or {SHARED!r} to fit it; 0.5 for the right one of two"
        )


def _answers(where: str, given: Any) -> tuple[Sequence[ArrayLike], float | None]:
    """Return what was given as rows, and the chance level of a table of answers."""
    if not hasattr(given, "keys"):  # a DataFrame has some, too
        return given, None
    need(where, ("level", "outcome"), given)
    chances = {_chance(where, c) for c in (given["chance"] if "chance" in given else [None])}
    if len(chances) > 1:
        raise BadValue(
            f"{where}: the answers are of tasks with chance levels {chances}: fit each task by"
            " itself"
        )
    return (given["level"], given["outcome"]), chances.pop() if chances else None


def _chance(where: str, given: Any) -> float | None:
    """Return a chance level of a table as a float, or None where it is missing."""
    if given is None or type(given).__name__ == "NAType":  # pandas' missing value
        return None
    if not isinstance(given, Real) or not (given != given or 0 <= float(given) < 1):
        raise BadValue(
            f"{where}: chance = {given!r:.80} must be a number from 0 to below 1, or None where the"
            " task has no chance level"
        )
    return None if given != given else float(given)


def _set(where: str, given: Sequence[ArrayLike], log: bool) -> Sets:
    """Return one set, each level once.

    Levels that differ by rounding are one, the lowest of them.
    """
    if not 2 <= len(given) <= 3:
        raise BadValue(
            f"{where}: give (levels, yes) or (levels, yes, trials), not {len(given)} things"
        )
    x, k = (
        numbers(f"{where}: {name}", v) for name, v in zip(("levels", "yes"), given, strict=False)
    )
    n = numbers(f"{where}: trials", given[2]) if len(given) == 3 else np.ones_like(k)
    if not x.ndim == 1 == k.ndim == n.ndim or not x.size == k.size == n.size > 0:
        raise BadValue(
            f"{where}: levels {x.shape}, yes {k.shape} and trials {n.shape} must be rows of one"
            " length, with a number in each"
        )
    for name, bad in (
        ("levels", ~np.isfinite(x) | (log & (x <= 0))),
        ("trials", ~((n >= 0) & (n <= MOST) & (n == np.floor(n)))),
        ("yes", ~((k >= 0) & (k <= n) & (k == np.floor(k)))),
    ):
        if bad.any():
            at = int(np.argmax(bad))
            what = (
                "must be finite" + (", and above 0 for log" if log else "")
                if name == "levels"
                else f"must be a whole number from 0 to {MOST:g}"
                if name == "trials"
                else f"must be a whole number from 0 to trials[{at}] = {n[at]:g}"
            )
            raise BadValue(
                f"{where}: {name}[{at}] = {dict(levels=x, yes=k, trials=n)[name][at]:g} {what}"
            )
    unique, at_level = np.unique(x[n > 0], return_inverse=True)
    if not unique.size:
        raise BadValue(f"{where}: there are no trials")
    new = np.append(True, np.diff(unique) > SAME * np.abs(unique[1:]))
    unique, at_level = unique[new], (np.cumsum(new) - 1)[at_level]
    if log:
        unique = np.log10(unique)
    if np.abs(unique).max() > LARGEST or 0 < np.ptp(unique) < 1 / LARGEST:
        raise BadValue(
            f"{where}: levels of {unique[0]:g} to {unique[-1]:g}: give them in another unit, so"
            " that sums of squares exist"
        )
    return Sets(unique, np.bincount(at_level, k[n > 0]), np.bincount(at_level, n[n > 0]))


# What is wrong with it ----------------------------------------------------------------
def _gap(sets: Sets, log: bool, guess: float | str | None) -> Interval:
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
        best = maximum(_some(sets, at), middle[at], model).loglik
        gain[at] = 2 * (best - found.loglik[at])
    return gain


def _flaws(sets: Sets, middle: Array, model: Model, found: Found) -> list[str]:
    """Return what is wrong with answers that have a best curve; "" if nothing is."""
    eta = found.a[:, None] + found.b[:, None] * (sets.x - middle[:, None])
    # but for lapses, they are separated
    near = np.sum((np.abs(eta) < BEYOND) & (sets.n > 0), axis=1)
    flat = 2 * (found.loglik - maximum(sets, middle, model, b=0.0).loglik) < scipy.stats.chi2.ppf(
        0.95, 1
    )
    # at the edge of its range: half of chi squared
    least = scipy.stats.chi2.isf(2 * SURE, 1)
    gain = np.full(flat.shape, -np.inf)
    if model.lapse != FREE:
        gain = _gain(sets, middle, model._replace(lapse=FREE), found, least)
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
