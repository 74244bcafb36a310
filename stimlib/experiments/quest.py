"""QUEST+ as a design, by the package questplus.

Source: Watson 2017, Journal of Vision 17(3):10.
"""

from __future__ import annotations

import copy
import dataclasses as dc
from functools import lru_cache
from typing import Any

import numpy as np

from ..errors import BadValue, public
from ..system.packages import package
from .tasks import Task
from .trial import Answer, State, Trial, outcome

_NAMES = ("1", "0")  # of outcomes; the first is the one whose probability rises


@public
@dc.dataclass(frozen=True)
class Quest:
    """QUEST+ for a cumulative normal with mean, deviation and lapses.

    Each trial has the level of least expected entropy.

    Parameters
    ----------
    task : Task
        Of outcomes 0 and 1.  Its ``chance`` is the curve's chance level, as
        `stimlib.experiments.tasks.TwoInterval` has it.
    levels : sequence of float
        Those that may be shown, bounds included.
    means, deviations : sequence of float
        What the parameters may be, in the unit of the levels; each is as likely before
        the first answer.
    lapses : sequence of float
        Probabilities of a lapse to either side, below 0.5.
    trials : int
        Its length.

    Raises
    ------
    BadValue
        No levels or parameters, rows of something else, or trials below 1; a trial
        whose chance level is another than the task's.
    MissingPackage
        questplus is not installed: ``pip install 'stimlib[experiments]'``.

    Notes
    -----
    p(1) = g + (1 - g - lapse) Phi((level - mean) / deviation), with g the task's chance
    level, 0.5 of a detection in two intervals (``norm_cdf`` of questplus); of a
    comparison, g = lapse (``norm_cdf_2``).

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
    >>> design.init(seed=1)  # its first `next` loads questplus, which takes seconds
    {'seed': 1, 'levels': [], 'outcomes': []}
    """

    task: Task
    levels: tuple[float, ...]
    means: tuple[float, ...]
    deviations: tuple[float, ...]
    lapses: tuple[float, ...] = (0.02,)
    trials: int = 40

    def __post_init__(self):
        for name in ("levels", "means", "deviations", "lapses"):
            row = np.asarray(given := getattr(self, name))
            if row.ndim != 1 or row.dtype.kind not in "iuf":
                raise BadValue(f"Quest: {name} = {given!r:.80} must be a row of numbers")
            object.__setattr__(
                self, name, given if isinstance(given, tuple) else tuple(row.tolist())
            )
        if not (self.levels and self.means and self.deviations and self.lapses) or self.trials < 1:
            raise BadValue(
                "Quest: give levels, means, deviations and lapses, one of each at least, and trials"
                " of at least 1"
            )
        if min(self.deviations) <= 0 or not all(0 <= p < 0.5 for p in self.lapses):
            raise BadValue("Quest: deviations must be above 0, lapses from 0 to below 0.5")

    def init(self, seed: int) -> State:
        """Return an empty history."""
        return {"seed": seed, "levels": [], "outcomes": []}

    def next(self, state: State) -> Trial | None:
        """Return the level of least expected entropy."""
        n = len(state["levels"])
        if n >= self.trials:
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
        trial = self.next(state)
        if trial is None:
            raise BadValue(f"all {self.trials} trials are done: there are no more answers to take")
        more = int(outcome(trial, answer) > 0.5)
        return {
            **state,
            "levels": [*state["levels"], trial.level],
            "outcomes": [*state["outcomes"], more],
        }

    def estimate(self, state: State) -> dict[str, float]:
        """Return the posterior means of the parameters: mean, sd, lapse_rate."""
        return {k: float(v) for k, v in _posterior(*_facts(self, state)).param_estimate.items()}


def _short(chance: float | None) -> str:
    return "None" if chance is None else f"{chance:.3g}"


def _facts(
    design: Quest, state: State
) -> tuple[Quest, float | None, tuple[float, ...], tuple[int, ...]]:
    alone = copy.copy(design)
    object.__setattr__(alone, "task", None)  # which may be no key of a cache
    return (
        alone,
        getattr(design.task, "chance", None),
        tuple(state["levels"]),
        tuple(state["outcomes"]),
    )


@lru_cache(maxsize=32)
def _level(
    design: Quest, chance: float | None, levels: tuple[float, ...], outcomes: tuple[int, ...]
) -> float:
    return float(_posterior(design, chance, levels, outcomes).next_stim["intensity"])


@lru_cache(maxsize=32)
def _posterior(
    design: Quest, chance: float | None, levels: tuple[float, ...], outcomes: tuple[int, ...]
) -> Any:
    """Return the posterior after these answers.

    The last ones are kept, so that a session takes one step a trial.
    """
    if not levels:
        of = {"mean": design.means, "sd": design.deviations, "lapse_rate": design.lapses}
        if chance is not None:
            of["lower_asymptote"] = (chance,)
        return package("questplus", "Quest", "'stimlib[experiments]'").QuestPlus(
            stim_domain={"intensity": list(design.levels)},
            param_domain={k: list(v) for k, v in of.items()},
            outcome_domain={"response": list(_NAMES)},
            func="norm_cdf_2" if chance is None else "norm_cdf",
            stim_scale="linear",
        )
    known = copy.copy(_posterior(design, chance, levels[:-1], outcomes[:-1]))
    known.stim_history, known.resp_history = list(known.stim_history), list(known.resp_history)
    known.update(stim={"intensity": levels[-1]}, outcome={"response": _NAMES[1 - outcomes[-1]]})
    return known
