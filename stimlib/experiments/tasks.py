"""Tasks: how a level becomes a trial, and how its answers are scored.

A task is a value with ``trial(level, seed, n)``; ``n`` counts the trials of its design.
Each purpose, condition and trial has an independent random stream.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..errors import BadValue, need, public
from .random_streams import seed_of, stream
from .trial import Stimulus, Trial

DIFFERENCES = (
    "if 0 is no difference, let the level be the value itself and not its difference, or give"
    " detection=False and levels of both signs; if it is no stimulus, give detection=True"
)
"""What to do about a standard of 0 that may be no absence of a stimulus."""


@runtime_checkable
class Task(Protocol):
    """A maker of trials for one condition."""

    @property
    def condition(self) -> str:
        """Name of the condition."""

    def trial(self, level: Any, seed: int, n: int) -> Trial:
        """Return the trial for a level."""


def extremes(task: Task, level: Any) -> list[Trial]:
    """Return the trials between which all trials of a level are.

    A task that draws a parameter has a method ``extremes(level)``, as `Roved` has.
    """
    own = getattr(task, "extremes", None)
    return own(level) if own else [task.trial(level, 0, 0)]


@public
@dc.dataclass(frozen=True)
class TwoInterval:
    """Sequential two-alternative forced choice (2IFC) of standard and comparison.

    The order of the two is random (the UGrip paper, section 2.2).

    Parameters
    ----------
    condition : str
    question : str
        Name of a question with two choices, the first and the second interval.
    standard, comparison : Stimulus
    varies : str
        Parameter of the comparison that the level sets.
    choices : (str, str)
        Choices of the question for the first and for the second interval.
    asks_less : bool
        Whether the question asks for less of the quantity that the level raises, such
        as "softer" when the level is a stiffness.
    detection : bool, optional
        Whether the standard is the absence of a stimulus, so that the chance level is
        0.5.  By default this is so if ``standard`` sets ``varies`` to 0; pass True if
        the standard is a separate scene, and False if 0 is no difference, so that
        levels have both signs.

    Raises
    ------
    BadValue
        A standard or comparison that is no Stimulus; a level below 0, in a trial, where
        ``detection`` follows from a standard of 0.

    Notes
    -----
    The score of an answer is 1 if it says that the comparison has more.  A trial has a
    right answer (``Trial.correct``) in a detection, and in a comparison of one scene
    whose stimuli differ in ``varies`` alone; the standard must set it.  Each trial
    states its chance level, which `stimlib.experiments.fits.psychometric` and
    `stimlib.experiments.quest.Quest` use.

    Examples
    --------
    >>> from stimlib.experiments import Stimulus, TwoInterval
    >>> task = TwoInterval(
    ...     "silent",
    ...     "softer",
    ...     Stimulus("squeeze", {"k": 2000.0}),
    ...     Stimulus("squeeze"),
    ...     "k",
    ...     asks_less=True,
    ... )
    >>> trial = task.trial(5000.0, seed=1, n=0)
    >>> [s.params["k"] for s in trial.stimuli], trial.scores
    ([2000.0, 5000.0], {'first': 1.0, 'second': 0.0})
    >>> TwoInterval(
    ...     "felt", "buzz", Stimulus("tone", {"A": 0.0}), Stimulus("tone"), "A"
    ... ).chance
    0.5
    """

    condition: str
    question: str
    standard: Stimulus
    comparison: Stimulus
    varies: str
    choices: tuple[str, str] = ("first", "second")
    asks_less: bool = False
    detection: bool | None = None

    @property
    def chance(self) -> float | None:
        """Chance level: 0.5 for a detection, None for a comparison."""
        silent = self.standard.params.get(self.varies) == 0
        return 0.5 if (silent if self.detection is None else self.detection) else None

    def trial(self, level: float, seed: int, n: int) -> Trial:
        """Return the trial with both stimuli and the score of each choice.

        Each stimulus has its own noise.
        """
        if self.chance and self.detection is None and level < 0:
            raise BadValue(
                f"TwoInterval {self.condition!r}: {self.varies} = {level:g} is below the"
                f" standard's 0, which is taken as no stimulus; {DIFFERENCES}"
            )
        comparison = dc.replace(
            self.comparison,
            params={**self.comparison.params, self.varies: level},
            name="comparison",
        )
        noise = [seed_of(seed, w, self.condition, n) for w in ("noise", "noise of the comparison")]
        pair = [
            dc.replace(self.standard, name="standard", seed=noise[0]),
            dc.replace(comparison, seed=noise[1]),
        ]
        # whether the comparison comes second
        second = bool(stream(seed, "order", self.condition, n).integers(2))
        says_comparison = self.choices[second]
        scores = {c: float((c == says_comparison) != self.asks_less) for c in self.choices}
        a, b = ({**s.params, self.varies: None} for s in (self.standard, self.comparison))
        least = self.standard.params.get(self.varies, level)
        differ = a == b and self.standard.scene == self.comparison.scene and level != least
        more = 1.0 if self.chance else float(level > least)
        right = [c for c in self.choices if scores[c] == more and (self.chance or differ)]
        return Trial(
            self.condition,
            tuple(pair if second else pair[::-1]),
            (self.question,),
            level,
            scores=scores,
            correct={self.question: right[0]} if right else {},
            chance=self.chance,
        )


@public
@dc.dataclass(frozen=True)
class OneInterval:
    """One-interval two-alternative forced choice between two known stimuli.

    Source: Çaldıran's thesis, section 3.1.

    Parameters
    ----------
    condition : str
    question : str
        Name of a question whose choices are the names of the stimuli.
    stimuli : dict of str to Stimulus
        Two stimuli under the choice that is right for each; the first is the signal,
        whose choice scores 1.

    Raises
    ------
    BadValue
        Not two stimuli.

    Examples
    --------
    >>> from stimlib.experiments import OneInterval, Stimulus
    >>> task = OneInterval(
    ...     "0.25", "bouncier", {"red": Stimulus("S1"), "green": Stimulus("S2")}
    ... )
    >>> task.trial("green", seed=1, n=0).correct
    {'bouncier': 'green'}
    """

    condition: str
    question: str
    stimuli: Mapping[str, Stimulus]

    def __post_init__(self):
        if len(self.stimuli) != 2:
            raise BadValue(
                f"OneInterval {self.condition!r}: give two stimuli, by their choices; got"
                f" {list(self.stimuli)}"
            )

    def trial(self, level: str, seed: int, n: int) -> Trial:
        """Return the trial with a named stimulus; level 1 means signal, 0 not."""
        need(f"OneInterval {self.condition!r}", [level], self.stimuli, "stimulus")
        shown = dc.replace(
            self.stimuli[level], name=level, seed=seed_of(seed, "noise", self.condition, n)
        )
        scores = {c: 1.0 - i for i, c in enumerate(self.stimuli)}
        return Trial(
            self.condition,
            (shown,),
            (self.question,),
            scores[level],
            scores=scores,
            correct={self.question: level},
        )


@public
@dc.dataclass(frozen=True)
class Rate:
    """A task that presents one stimulus and asks questions about it.

    Examples are ratings (the touch-screen thesis), and finding and ranking nodules (Li
    et al. 2016).

    Parameters
    ----------
    condition : str
    questions : tuple of str
    stimulus : Stimulus
    correct : dict of str to JSON data
        The right answer to each question, if there is one.

    Examples
    --------
    >>> from stimlib.experiments import Rate, Stimulus
    >>> Rate(
    ...     "sine 2", ("roughness", "bumpiness"), Stimulus("bumps", {"amplitude": 4.0})
    ... ).trial(None, 1, 0).questions
    ('roughness', 'bumpiness')
    """

    condition: str
    questions: tuple[str, ...]
    stimulus: Stimulus
    correct: Mapping[str, Any] = dc.field(default_factory=dict)

    def trial(self, level: Any, seed: int, n: int) -> Trial:
        """Return the trial, whose stimulus has its own noise."""
        shown = dc.replace(self.stimulus, seed=seed_of(seed, "noise", self.condition, n))
        return Trial(self.condition, (shown,), self.questions, correct=self.correct)


@public
@dc.dataclass(frozen=True)
class Roved:
    """A task with a parameter that roves from stimulus to stimulus.

    What the parameter changes is then no cue to the right answer.

    Parameters
    ----------
    task : Task
    varies : str
        A parameter that each stimulus of the task sets.
    factor : float
        Above 1.  Each stimulus has its value multiplied by a factor drawn from
        1/factor to factor, uniformly in its logarithm.

    Raises
    ------
    BadValue
        A factor that is not above 1; a stimulus that does not set the parameter.

    Examples
    --------
    >>> from stimlib.experiments import OneInterval, Roved, Stimulus
    >>> pair = {
    ...     "red": Stimulus("S1", {"firmness": 1.0}),
    ...     "green": Stimulus("S2", {"firmness": 1.0}),
    ... }
    >>> task = Roved(OneInterval("0.25", "bouncier", pair), "firmness", 1.2)
    >>> trials = [task.trial("red", seed=1, n=n) for n in (0, 1)]
    >>> [round(trial.stimuli[0].params["firmness"], 3) for trial in trials]
    [1.092, 1.022]
    """

    task: Task
    varies: str
    factor: float

    def __post_init__(self):
        if self.factor <= 1:
            raise BadValue(f"Roved: factor {self.factor!r} must be above 1, such as 1.2")

    @property
    def condition(self) -> str:
        """Name of the task's condition."""
        return self.task.condition

    @property
    def chance(self) -> float | None:
        """Chance level of the task, None if it has none."""
        return getattr(self.task, "chance", None)

    def trial(self, level: Any, seed: int, n: int) -> Trial:
        """Return the task's trial, its stimuli with the parameter multiplied."""
        trial = self.task.trial(level, seed, n)
        powers = stream(seed, "roving", self.condition, n).uniform(-1, 1, len(trial.stimuli))
        return self._roved(trial, powers)

    def extremes(self, level: Any) -> list[Trial]:
        """Return the trials with the smallest and the largest factor."""
        return [
            self._roved(t, power * np.ones(len(t.stimuli)))
            for t in extremes(self.task, level)
            for power in (-1, 1)
        ]

    def _roved(self, trial: Trial, powers: np.ndarray) -> Trial:
        roved = []
        for stimulus, power in zip(trial.stimuli, powers, strict=True):
            if self.varies not in stimulus.params:
                raise BadValue(
                    f"Roved {self.condition!r}: {stimulus.scene} does not set {self.varies!r}; give"
                    f" it, such as Stimulus({stimulus.scene!r}, {{{self.varies!r}: 1.0}})"
                )
            value = stimulus.params[self.varies] * self.factor ** float(power)
            roved.append(dc.replace(stimulus, params={**stimulus.params, self.varies: value}))
        return dc.replace(trial, stimuli=tuple(roved))
