"""QUEST+ as a design: each trial has the level of least expected entropy.

Sources: Watson 2017, Journal of Vision 17(3):10; for nuisance parameters Prins 2013,
Journal of Vision 13(7):3.
"""

from __future__ import annotations

import copy
import dataclasses as dc
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BadValue, counted, need, public
from ..system.fields import positive, whole
from .likelihood import FLOOR, Estimate
from .tasks import Task
from .trial import Answer, State, Trial, due, outcome

Array = NDArray[np.float64]
ROWS = ("levels", "means", "deviations", "slopes", "lapses", "guesses")


@public
@dc.dataclass(frozen=True)
class Quest:
    """QUEST+ for a cumulative normal or a Weibull curve, with guesses and lapses.

    Each trial has the level of least expected entropy.

    Parameters
    ----------
    task : Task
        Of outcomes 0 and 1.  Its ``chance`` is the curve's chance level, as
        `stimlib.experiments.tasks.TwoInterval` has it.
    levels : sequence of float
        Those that may be shown, bounds included.
    means : sequence of float
        Where the curve may be, in the unit of the levels: the mean of the normal, or
        the Weibull's threshold. Before the first answer all values of a parameter are
        as likely.
    deviations : sequence of float
        Standard deviations of the normal, in the unit of the levels.
    lapses : sequence of float
        Probabilities of a lapse, below 0.5.
    trials : int
        Its length, or the most of it with ``precision``.
    slopes : sequence of float
        Instead of deviations, the exponents of a Weibull curve; the levels must be 0 or
        above, and the means above 0.
    guesses : sequence of float
        Chance levels, below 1, where they are not known: the false alarms of a yes-no
        task. By default the task's, or, of a comparison, the lapse rate.
    nuisance : sequence of str
        Parameters that are estimated but not of interest, such as ``("lapse",)``, by
        the names that `estimate` returns. They are marginalised out of the posterior
        before its entropy is computed, so that a trial is spent on them only where it
        helps the others (the psi-marginal method). By default the entropy is that of
        all parameters.
    precision : dict of str to float
        It ends before ``trials`` when the posterior's standard deviation of each of
        these parameters, by the names that `estimate` returns, is at most so large, in
        the unit of the parameter.  A 95 % interval is about four times as wide.  One
        below a third of the distance between a parameter's values is hardly reached.
    min_trials : int
        Trials before which it does not end for ``precision``.

    Raises
    ------
    BadValue
        No levels or parameters, rows of something else, or trials below 1; rates of
        guesses and lapses that add up to 1 or more; a trial whose chance level is
        another than the task's; all parameters as nuisance; a precision that is not
        above 0.
    UnknownName
        A parameter of ``nuisance`` or ``precision`` that the curve does not have.

    Notes
    -----
    p(1) = g + (1 - g - lapse) F(level), with the guess rate g and F = Phi((level -
    mean) / deviation), or F = 1 - exp(-(level / mean)^slope).

    With lapse rates from 0 to 0.2, 35 of 120 trials of a simulated detection were at
    the two highest of 18 levels, and 10 with the lapse rate as nuisance (means of 12
    runs).

    Examples
    --------
    >>> from stimlib.experiments import Quest, Stimulus, TwoInterval
    >>> task = TwoInterval(
    ...     "silent",
    ...     "softer",
    ...     Stimulus("squeeze", {"k": 2.0}),
    ...     Stimulus("squeeze"),
    ...     "k",
    ...     asks_less=True,
    ... )
    >>> design = Quest(
    ...     task,
    ...     (1.0, 1.5, 2.0, 2.5, 3.0),
    ...     means=(1.5, 2.0, 2.5),
    ...     deviations=(0.2, 0.5),
    ...     trials=3,
    ... )
    >>> design.next(design.init(seed=1)).level
    2.0

    The lapse rate is not known, and not of interest:

    >>> from dataclasses import replace
    >>> marginal = replace(design, lapses=(0.0, 0.05, 0.1), nuisance=("lapse",))
    >>> marginal.next(marginal.init(seed=1)).level
    2.0

    As many trials as it takes to know the mean to 0.1, but 200 at most:

    >>> from stimlib.experiments import PsychometricObserver, observed, stream
    >>> levels = tuple(1 + k / 8 for k in range(17))
    >>> precise = replace(
    ...     design, levels=levels, means=levels, trials=200, precision={"mean": 0.1}
    ... )
    >>> person, rng = PsychometricObserver(1.8, 0.5), stream(1, "observer")
    >>> len(list(observed(precise, 1, person, rng)))
    55
    """

    task: Task
    levels: tuple[float, ...]
    means: tuple[float, ...]
    deviations: tuple[float, ...] = ()
    lapses: tuple[float, ...] = (0.02,)
    trials: int = 40
    slopes: tuple[float, ...] = ()
    guesses: tuple[float, ...] = ()
    nuisance: tuple[str, ...] = ()
    precision: Mapping[str, float] = dc.field(default_factory=dict, hash=False)
    min_trials: int = 20

    def __post_init__(self):
        for name in ROWS:
            row = np.asarray(given := getattr(self, name))
            numbers = row.ndim == 1 and (not row.size or row.dtype.kind in "iuf")
            if not numbers or not np.isfinite(row).all():
                raise BadValue(f"Quest: {name} = {given!r:.80} must be a row of finite numbers")
            object.__setattr__(
                self, name, given if isinstance(given, tuple) else tuple(row.tolist())
            )
        if not (self.levels and self.means and self.lapses) or self.trials < 1:
            raise BadValue(
                "Quest: give levels, means and lapses, one of each at least, and trials of at"
                " least 1"
            )
        if bool(self.deviations) == bool(self.slopes):
            raise BadValue("Quest: give deviations for a normal curve, or slopes for a Weibull")
        if min(self.deviations or self.slopes) <= 0 or not all(0 <= p < 0.5 for p in self.lapses):
            raise BadValue(
                "Quest: deviations and slopes must be above 0, lapses from 0 to below 0.5"
            )
        if not all(0 <= g < 1 for g in self.guesses):
            raise BadValue(f"Quest: guesses = {self.guesses} must be from 0 to below 1")
        if self.slopes and (min(self.means) <= 0 or min(self.levels) < 0):
            raise BadValue("Quest: a Weibull curve needs means above 0 and levels of 0 or above")
        object.__setattr__(self, "nuisance", tuple(dict.fromkeys(self.nuisance)))
        names = _parameters(self, getattr(self.task, "chance", None))
        if (most := max(names.get("guess", [0.0])) + max(self.lapses)) >= 1:
            raise BadValue(
                f"Quest: the largest guess and lapse rates add up to {most:.3g}, where no curve"
                " rises; give rates whose sum is below 1"
            )
        need("Quest: nuisance", self.nuisance, names, "parameter")
        if names.keys() <= set(self.nuisance):
            raise BadValue(
                f"Quest: nuisance = {self.nuisance} names all parameters; leave out those that the"
                " trials are to determine"
            )
        need("Quest: precision", self.precision, names, "parameter")
        if not all(map(positive, self.precision.values())) or not whole(10**6)(self.min_trials):
            raise BadValue(
                f"Quest: precision = {self.precision!r} must be standard deviations above 0, and"
                f" min_trials = {self.min_trials!r} a whole number from 0 on"
            )

    @property
    def reach(self) -> list[tuple[Task, float]]:
        """The levels that a trial may have, with the task."""
        return [(self.task, level) for level in self.levels]

    def init(self, seed: int) -> State:
        """Return an empty history."""
        return {"seed": seed, "levels": [], "outcomes": []}

    def next(self, state: State) -> Trial | None:
        """Return the trial at the level of least expected entropy."""
        n = len(state["levels"])
        if n >= self.trials or (self.precision and n >= self.min_trials and self._precise(state)):
            return None
        trial = self.task.trial(_level(*_facts(self, state)), state["seed"], n)
        chance = getattr(self.task, "chance", None)
        if trial.chance != chance:
            raise BadValue(
                f"Quest: the task has the chance level {_short(chance)}, its trial"
                f" {_short(trial.chance)}; give the task's class the attribute chance, with the"
                " same value"
            )
        return trial

    def update(self, state: State, answer: Answer) -> State:
        """Add one level and its outcome."""
        trial = due(self, state, len(state["levels"]))
        more = int(outcome(trial, answer) > 0.5)
        return {
            **state,
            "levels": [*state["levels"], trial.level],
            "outcomes": [*state["outcomes"], more],
        }

    def _precise(self, state: State) -> bool:
        """Return whether all parameters are known as precisely as they are to be."""
        found = self.estimate(state)
        return all(found[name].error <= most for name, most in self.precision.items())

    def estimate(self, state: State) -> dict[str, Estimate]:
        """Return the posterior means: mean, deviation or slope, lapse and guess.

        The mean of a Weibull curve is its scale alpha, where F is 63 %.  The threshold
        of `stimlib.experiments.fits.psychometric` is where F is 50 %, and lower by the
        factor log(2) ** (1 / slope), with the natural logarithm.

        Parameters
        ----------
        state : State
            After the answers, as ``init`` and ``update`` of this design return it.

        Returns
        -------
        dict of str to Estimate
            Posterior mean, standard deviation, and the interval that holds 95 % of the
            posterior, where each value of a parameter stands for its neighbourhood,
            half of the way to the next, and no rate or width is below 0.  ``problem``
            is "edge" if most of the posterior is at an end of the parameter's values
            (95 %, if there are two): the true value may be beyond.  The end 0 of a
            rate, single values and nuisance parameters have no
            such problem.  It is "beyond" if the mean is outside of ``levels``.

        Raises
        ------
        BadValue, UnknownName
            A state that is not one of this design.

        Examples
        --------
        >>> import math
        >>> from stimlib.experiments import (
        ...     PsychometricObserver,
        ...     Quest,
        ...     Stimulus,
        ...     TwoInterval,
        ... )
        >>> from stimlib.experiments import observed, stream
        >>> tone = Stimulus("tone", {"A": 0.0})
        >>> task = TwoInterval("felt", "which", tone, Stimulus("tone"), "A")
        >>> levels = tuple(0.01 * 2 ** (k / 2) for k in range(11))
        >>> design = Quest(task, levels, means=levels[1:-1], slopes=(1.0, 2.0, 3.0))
        >>> person = PsychometricObserver(0.06, 0.2, link="weibull")
        >>> state = design.init(seed=1)
        >>> for _, answer in observed(design, 1, person, stream(1, "observer")):
        ...     state = design.update(state, answer)
        >>> found = design.estimate(state)
        >>> print(found["mean"])
        0.07597 +- 0.021 [0.03414, 0.1366]
        >>> threshold = found["mean"].value * math.log(2) ** (1 / found["slope"].value)
        >>> print(f"threshold {threshold:.3f}")
        threshold 0.064
        """
        need("Quest.estimate", ("levels", "outcomes"), state)
        design, chance, *history = _facts(self, state)
        wrong = [v for v in history[0] if v not in self.levels] + [
            more for more in history[1] if more not in (0, 1)
        ]
        if wrong or len(history[0]) != len(history[1]):
            raise BadValue(
                f"Quest.estimate: {counted(len(history[0]), 'level')} and"
                f" {counted(len(history[1]), 'outcome')}"
                + (f", with {wrong[0]!r:.80}," if wrong else "")
                + " are no state of this design; give one that its update returned"
            )
        _, known = _posterior(design, chance, *history)
        return {
            name: _estimate(
                design, name, row, known.sum(tuple(k for k in range(known.ndim) if k != axis))
            )
            for axis, (name, row) in enumerate(_parameters(design, chance).items())
        }


def _estimate(design: Quest, name: str, row: Array, mass: Array) -> Estimate:
    """Return the estimate of a parameter from its values and their probabilities."""
    row, mass = np.array(sorted(zip(row, mass, strict=True))).T
    value = float(mass @ row)
    # a value stands for all that are nearer to it than to others
    cell = np.gradient(row) if row.size > 1 else 0.0 * row
    wide = np.pad(row, 1, "reflect", reflect_type="odd")
    least = -np.inf if name == "mean" and not design.slopes else 0.0
    edges = np.clip((wide[1:] + wide[:-1]) / 2, least, {"lapse": 0.5, "guess": 1.0}.get(name))
    low, high = np.searchsorted(np.cumsum(mass), [0.025, 0.975])
    # most of the posterior is at an end, of two values nearly all of it; 0 ends a rate
    ends = mass[[0, -1]][int(row[0] == 0 and name in ("lapse", "guess")) :]
    piled = row.size > 1 and ends.max() > (0.5 if row.size > 2 else 0.95)
    inside = name != "mean" or min(design.levels) <= value <= max(design.levels)
    problem = "edge" if piled and name not in design.nuisance else "" if inside else "beyond"
    return Estimate(
        value,
        float(np.sqrt(mass @ ((row - value) ** 2 + cell**2 / 12))),
        float(edges[low]),
        float(edges[high + 1]),
        problem,
    )


def _short(chance: float | None) -> str:
    return "None" if chance is None else f"{chance:.3g}"


def _facts(design: Quest, state: State) -> tuple[Quest, float | None, Any, Any]:
    alone = copy.copy(design)
    object.__setattr__(alone, "task", None)  # which may be no key of a cache
    chance = getattr(design.task, "chance", None)
    return alone, chance, tuple(state["levels"]), tuple(state["outcomes"])


def _parameters(design: Quest, chance: float | None) -> dict[str, Array]:
    """Return the values of each parameter, in the order of the posterior's axes."""
    rows: dict[str, Any] = {"mean": design.means}
    rows |= {"slope": design.slopes} if design.slopes else {"deviation": design.deviations}
    rows["lapse"] = design.lapses
    if guesses := design.guesses or (() if chance is None else (chance,)):
        rows["guess"] = guesses
    return {name: np.array(row, float) for name, row in rows.items()}


def _likelihood(design: Quest, chance: float | None) -> Array:
    """Return the probabilities of outcomes 1 and 0: (parameters, 2, levels)."""
    from scipy.special import ndtr

    rows = _parameters(design, chance)
    mean, wide, lapse, *guess = np.ix_(*rows.values(), np.array(design.levels, float))[:-1]
    level = np.array(design.levels, float)
    with np.errstate(over="ignore"):  # infinity is right
        if "slope" in rows:
            curve = 1 - np.exp(-((level / mean) ** wide))
        else:
            curve = ndtr((level - mean) / wide)
    low = guess[0] if guess else lapse
    more = low + (1 - low - lapse) * curve
    # no answer is impossible, or one slip would leave no curve
    return np.maximum(np.stack([more, 1 - more], axis=-2), FLOOR)


@lru_cache(maxsize=32)
def _level(
    design: Quest, chance: float | None, levels: tuple[float, ...], outcomes: tuple[int, ...]
) -> float:
    """Return the level whose answer leaves the least expected entropy."""
    likelihood, known = _posterior(design, chance, levels, outcomes)
    names = list(_parameters(design, chance))
    then = known[..., None, None] * likelihood
    p = then.sum(tuple(range(known.ndim)))
    then = then.sum(tuple(map(names.index, design.nuisance)), keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        then /= p
        entropy = -np.nansum(then * np.log(then), axis=tuple(range(known.ndim)))
    expected = (p * entropy).sum(0)
    # the first of those that differ by rounding, so that no machine takes another
    return float(design.levels[int(np.argmax(expected <= expected.min() + 1e-12))])


@lru_cache(maxsize=32)
def _posterior(
    design: Quest, chance: float | None, levels: tuple[float, ...], outcomes: tuple[int, ...]
) -> tuple[Array, Array]:
    """Return the likelihoods, and the posterior after these answers.

    Its size, and not the number of answers, is what it costs.
    """
    likelihood, counts = _likelihood(design, chance), np.zeros((2, len(design.levels)))
    for level, more in zip(levels, outcomes, strict=True):
        counts[1 - more, design.levels.index(level)] += 1
    score = (counts * np.log(likelihood)).sum((-2, -1))
    known = np.exp(score - score.max())
    return likelihood, known / known.sum()
