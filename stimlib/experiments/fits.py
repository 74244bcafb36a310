"""Psychometric functions from answers: PSE or threshold, JND, and their intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..core.units import pretty
from ..errors import BadValue, one_of, public, shortened
from ..system.packages import package
from .answer_sets import LARGEST, answers_of, mirrored, set_of, stacked
from .fit_problems import PROBLEMS, SURE, Interval, flaws_of, gap_of, undetermined
from .goodness import allowed, best_possible, dispersion, goodness, parameters
from .intervals import Options, intervals_of
from .likelihood import (
    FREE,
    GUESSES,
    LAPSES,
    Array,
    Found,
    Model,
    Sets,
    curve,
    maximum,
    middle_of,
    numbers,
    probability,
    subset,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHARED = "shared"  # a rate that is fitted to all sets together
LATTICE = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0)  # shared rates to begin from, of the highest
TOGETHER = 256  # sets in one call, so that memory stays small
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
        How it was fitted, for `level_interval`, and a name of the call that fitted it,
        for `likelihood_ratio`: two people may have the same answers.
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
    method: tuple[Model, float, Options, str] | None = field(
        default=None, repr=False, compare=False
    )

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
        return self._difference(self.sigma_interval[0]), self._difference(self.sigma_interval[1])

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
        model, fall, how, _ = self.method
        at, yes, asked = np.array(self.data).T[:, None]
        sets = Sets(np.log10(at) if self.log else at, yes, asked)
        best = maximum(sets, middle_of(sets, model), model)
        low, high = intervals_of(sets, model, np.array([fall]), how, best, part)[0, :, 0].tolist()
        return (float(_power(low)), float(_power(high))) if self.log else (low, high)

    def _part(self, p: ArrayLike) -> Array:
        """Return the part of the way from the guess rate up at which the curve is p."""
        part = (numbers("fit: p", p) - self.guess) / (1 - self.guess - self.lapse)
        return np.where((part > 0) & (part < 1), part, np.nan)

    def advice(self) -> list[str]:
        """Return the problems of the fit, and what to do about them."""
        low, high = self.gap
        against = (
            "fit a chance level of 0.5 about as well as a symmetric curve"
            if self.comparison
            else f"contradict a chance level of {self.guess:.3g}"
        )
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
        return float(_power(wide)) - 1 if self.log else wide


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
        (levels, yes, trials) if trials is not None else levels if yes is None else (levels, yes)
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
    how = Options(log, dispersion, interval, confidence, int(seed), unit)
    _model(link, guess, lapse, how)
    middle = _known(pse, guess, log)
    sets: dict[Any, Any] = {}
    chances: dict[Any, Any] = {}
    fits: dict[Any, Fit] = {}
    for key, given in data.items():
        where = f"psychometrics of {shortened(key)}" if key != "" else "psychometrics"
        answers, chance = answers_of(where, given)
        sets[key] = set_of(where, answers, log, middle)
        if middle is not None and chance not in (None, 0.5):
            raise BadValue(f"{where}: pse is of a curve that is 1/2 there, not of chance {chance}")
        chances[key] = None if middle is not None else chance if guess is None else guess
    parts: list[tuple[list[Any], Model]] = []
    for chance in dict.fromkeys(chances.values()):
        _model(link, chance, lapse, how)
        keys = [key for key in data if chances[key] == chance]
        model = Model(link, chance, lapse, middle)
        parts += [(keys[at : at + TOGETHER], model) for at in range(0, len(keys), TOGETHER)]
    rates, call = (
        _shared([([sets[key] for key in keys], model) for keys, model in parts]),
        uuid4().hex,
    )
    for keys, model in parts:
        found = _fitted([sets[key] for key in keys], model, rates, call, how)
        fits |= zip(keys, found, strict=True)
    return {key: fits[key] for key in data}


def _shared(parts: Sequence[tuple[Sequence[Sets], Model]]) -> dict[str, float]:
    """Return the rates that all sets share, whatever else their models are."""
    names = [name for name in ("guess", "lapse") if parts and getattr(parts[0][1], name) == SHARED]
    if not names:
        return {}
    padded = [(stacked(part), model) for part, model in parts]

    def loss(rates: Array) -> float:
        one = dict(zip(names, rates.tolist(), strict=True))
        return -sum(
            float(maximum(s, middle_of(s, model), _with(model, one)).loglik.sum())
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


def _fitted(
    part: Sequence[Sets], model: Model, rates: Mapping[str, float], call: str, how: Options
) -> list[Fit]:
    """Return the fits of some sets, in one call of each step."""
    most = {
        n: v
        for n, v in (("lapse", LAPSES), ("guess", GUESSES))
        if getattr(model, n) in (FREE, SHARED)
    }
    sets, model = stacked(part), _with(model, rates)
    middle = middle_of(sets, model)
    best = maximum(sets, middle, model)
    problems = [undetermined(mirrored(one, model.pse)) for one in part]
    if at := [i for i, wrong in enumerate(problems) if not wrong]:
        flaws = flaws_of(subset(sets, at), middle[at], model, Found(*(v[at] for v in best)))
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
        around[..., usable] = intervals_of(subset(sets, usable), model, falls[usable], how, some)
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
            method=(model, float(falls[i]), how, call),
        )
        for i, one in enumerate(part)
    ]


def _fit(one: Sets, found: Array, around: Array, model: Model, how: Options, **each: Any) -> Fit:
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
        gap=gap_of(one, log, model.guess),
        link=model.link,
        log=log,
        confidence=how.confidence,
        comparison=model.guess is None,
        unit=how.unit,
        data=tuple(zip(*(v.tolist() for v in rows), strict=True)),
        **each,
    )


# What is given ------------------------------------------------------------------------
def _known(pse: Any, guess: Any, log: bool) -> float | None:
    """Return the middle that is given on the axis of the fit, or raise BadValue."""
    if pse is None:
        return None
    if (
        guess is not None
        or not isinstance(pse, Real)
        or not (abs(float(pse)) <= LARGEST and (float(pse) > 0 or not log))
    ):
        raise BadValue(
            f"psychometric: pse = {pse!r:.80} must be a number up to {LARGEST:g}, above 0 for a fit"
            " over log10 of the level, and without guess, because the curve is at 1/2 there"
        )
    return math.log10(pse) if log else float(pse)


def _model(link: str, guess: Any, lapse: Any, how: Options) -> None:
    """Raise BadValue unless the model and how to fit it are meant."""
    curve(link)
    one_of("psychometric: interval", how.interval, ("profile", "bootstrap", "none"))
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
