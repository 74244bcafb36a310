"""Tasks: how a level becomes a trial, and what its answers count for.

A task is a value with ``trial(level, seed, n)``; ``n`` counts the trials of its design.
What is drawn has a stream of its own for each purpose, condition and trial.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from ..errors import BadValue, UnknownName, public
from .random_streams import seed_of, stream
from .trial import Stimulus, Trial


@runtime_checkable
class Task(Protocol):
    """A maker of trials of one condition."""

    @property
    def condition(self) -> str:
        """Name of the condition."""

    def trial(self, level: Any, seed: int, n: int) -> Trial:
        """Return the trial for a level."""


@public
@dc.dataclass(frozen=True)
class TwoInterval:
    """Sequential two-alternative forced choice (2IFC): standard and comparison.

    Their order is random (the UGrip paper, section 2.2).

    Parameters
    ----------
    condition : str
    question : str
        Name of a question with two choices, the first and the second interval.
    standard, comparison : Stimulus
    varies : str
        Parameter of the comparison that is the level.
    choices : (str, str)
        Of the question: what says the first, what the second interval.
    asks_less : bool
        Whether the question asks which has less of what the level raises, such as
        "softer" of a stiffness.
    detection : bool, optional
        Whether the standard is no stimulus at all, so that chance level is 0.5.  By
        default it is where ``standard`` sets ``varies`` to 0; say True where the
        standard is a scene of its own.

    Raises
    ------
    BadValue
        A standard or comparison that is no Stimulus.

    Notes
    -----
    The score of an answer is 1 where it says that the comparison has more.  Each trial
    says its chance level, and `stimlib.experiments.fits.psychometric` and
    `stimlib.experiments.quest.Quest` take it from there.

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

    def __post_init__(self):
        for name in ("standard", "comparison"):
            if not isinstance(v := getattr(self, name), Stimulus):
                raise BadValue(
                    f"TwoInterval {self.condition!r}: {name} = {v!r:.80} must be a Stimulus, such"
                    " as Stimulus('spring')"
                )

    @property
    def chance(self) -> float | None:
        """Chance level of a detection, 0.5; None of a comparison."""
        silent = self.standard.params.get(self.varies) == 0
        return 0.5 if (silent if self.detection is None else self.detection) else None

    def trial(self, level: float, seed: int, n: int) -> Trial:
        """Return both stimuli, and the score of each choice.

        Each has noise of its own.
        """
        comparison = dc.replace(
            self.comparison,
            params={**self.comparison.params, self.varies: level},
            name="comparison",
        )
        pair = [
            dc.replace(
                self.standard, name="standard", seed=seed_of(seed, "noise", self.condition, n)
            )
        ]
        pair.append(
            dc.replace(comparison, seed=seed_of(seed, "noise of the comparison", self.condition, n))
        )
        # whether the comparison comes second
        second = bool(stream(seed, "order", self.condition, n).integers(2))
        says_comparison = self.choices[second]
        scores = {c: float((c == says_comparison) != self.asks_less) for c in self.choices}
        return Trial(
            self.condition,
            tuple(pair if second else pair[::-1]),
            (self.question,),
            level,
            scores=scores,
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
        Two, by the choice that is right; the first is the signal, whose choice counts
        1.

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
        """Return the stimulus of this name; its level is 1 for the signal, else 0."""
        if level not in self.stimuli:
            raise UnknownName(
                f"OneInterval {self.condition!r}: no stimulus {level!r}; there are"
                f" {', '.join(self.stimuli)}"
            )
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
    """A stimulus and questions about it.

    Examples are ratings (the touch-screen thesis), nodules to find and to rank (Li et
    al. 2016).

    Parameters
    ----------
    condition : str
    questions : tuple of str
    stimulus : Stimulus
    correct : dict of str to JSON data
        The right answers by question, where there are any.

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
        """Return the stimulus with its own noise."""
        shown = dc.replace(self.stimulus, seed=seed_of(seed, "noise", self.condition, n))
        return Trial(self.condition, (shown,), self.questions, correct=self.correct)
