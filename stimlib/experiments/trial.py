"""Trials as plain data: stimuli in their order, what is asked, what was answered.

A *design* decides what comes next.  It is a value with three pure functions over plain
JSON data, so that the answers in a log, put through ``update`` one after the other,
give the state in which a session was left:

``init(seed) -> State``
    the state before the first trial; everything that is drawn is drawn from
    `stimlib.experiments.random_streams.stream`
``next(state) -> Trial or None``
    the trial that is due, None at the end
``update(state, answer) -> State``
    the state after that trial was answered; the state that was given stays as it is
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

from ..errors import BadValue, public
from .user_code import called

State = dict[str, Any]
"""Of a design: JSON data."""


@public
@dc.dataclass(frozen=True)
class Stimulus:
    """A scene with parameter values and a noise seed.

    Parameters
    ----------
    scene : str
        Name in ``Experiment.scenes``.
    params : dict of str to float
        Parameters that differ from the scene's.
    seed : int
        Key of its noise in its interval: stimuli of one seed have the same noise, those
        of different seeds independent ones.
    name : str
        What it is called in the analysis, such as "standard"; nobody sees it during the
        session.
    """

    scene: str
    params: Mapping[str, float] = dc.field(default_factory=dict)
    seed: int = 0
    name: str = ""


@public
@dc.dataclass(frozen=True)
class Answer:
    """The answer to a trial.

    Parameters
    ----------
    values : dict of str to JSON data
        By the name of the question: one of its choices, a rating, a ranking (list of
        names), places (list of [x, y]).
    seconds : float, optional
        From the first question on, which is asked some tenths of a second after the end
        of the last stimulus.
    replays : int
        How often the stimuli were asked for again.
    """

    values: Mapping[str, Any]
    seconds: float | None = None
    replays: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON data; ``Answer(**data)`` makes it again."""
        return dc.asdict(self)


@public
@dc.dataclass(frozen=True)
class Trial:
    """The stimuli and questions of one trial.

    Parameters
    ----------
    condition : str
        Trials of one condition are analysed together; blinded during the session.
    stimuli : tuple of Stimulus
        In the order in which they are displayed, one interval each.
    questions : tuple of str
        Names in ``Experiment.questions``.
    level : float, optional
        What was varied, after the bounds.
    wanted : float, optional
        The level that the design asked for, before the bounds.
    track : str
        The staircase that this trial belongs to, if there are several.
    scores : dict of str to float
        What each choice of the first question counts for: 1 for "the comparison is
        more", or for "yes, it was the signal".
    correct : dict of str to JSON data
        The right answers by question, where there are any: for feedback.
    training : bool
        To be discarded by the analysis.
    pause : float
        Seconds of rest that are due before this trial; they cannot be cut short.
    chance : float, optional
        Chance level: how often the outcome is 1 where the stimulus cannot be felt, 1/m
        where the right one of m intervals is to be found, 0 for yes or no.  None: a
        comparison, whose curve is symmetric.  Fits take it from here.

    Examples
    --------
    >>> from stimlib.experiments import Answer, Stimulus, Trial, outcome
    >>> pair = Stimulus("squeeze", {"k": 5000.0}), Stimulus("squeeze", {"k": 2000.0})
    >>> trial = Trial(
    ...     "silent",
    ...     pair,
    ...     ("softer",),
    ...     level=5000.0,
    ...     scores={"first": 0.0, "second": 1.0},
    ... )
    >>> outcome(
    ...     trial, Answer({"softer": "second"})
    ... )  # the comparison, which was first, felt stiffer
    1.0
    >>> Trial.from_dict(trial.to_dict()) == trial
    True
    """

    condition: str
    stimuli: tuple[Stimulus, ...]
    questions: tuple[str, ...]
    level: float | None = None
    wanted: float | None = None
    track: str = ""
    scores: Mapping[str, float] = dc.field(default_factory=dict)
    correct: Mapping[str, Any] = dc.field(default_factory=dict)
    training: bool = False
    pause: float = 0.0
    chance: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON data."""
        return dc.asdict(self) | {
            "stimuli": [dc.asdict(s) for s in self.stimuli],
            "questions": list(self.questions),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make a trial from ``to_dict`` data, or raise TypeError or KeyError."""
        stimuli = tuple(Stimulus(**s) for s in data["stimuli"])
        return cls(**{**data, "stimuli": stimuli, "questions": tuple(data["questions"])})


@dc.dataclass(frozen=True)
class Record:
    """A trial that was answered: one line of a session's log.

    Analyses are made from these.

    Attributes
    ----------
    number : int
        From 1 on.
    trial : Trial
        As it was asked for.
    answer : Answer
    displayed : list of dict
        What came out, each time that it was displayed: see
        `stimlib.experiments.presentation.present`.
    ended : str
        Date and time of the answer, ISO 8601, UTC.
    """

    number: int
    trial: Trial
    answer: Answer
    displayed: Sequence[Mapping[str, Any]] = ()
    ended: str = ""

    @property
    def time(self) -> str:
        """How the intervals of the last presentation were made.

        "own": each is a rendering of its stimulus alone. "shared", as older sessions
        have it: all are windows on one run, whose time, states and noise begin with the
        trial. "": it was not displayed by `present`.
        """
        shown = self.displayed[-1] if self.displayed else {}
        return shown.get("time", "shared" if "intervals" in shown else "")

    @property
    def outcome(self) -> Any:
        """What the answer to the first question counts for; see `outcome`."""
        return outcome(self.trial, self.answer)


@runtime_checkable
class Design(Protocol):
    """The rule that decides which trial comes next; see the top of this page."""

    def init(self, seed: int) -> State:
        """Return the first state for a seed."""

    def next(self, state: State) -> Trial | None:
        """Return the trial that is due, or None at the end."""

    def update(self, state: State, answer: Answer) -> State:
        """Return the state after an answer."""


Observer = Callable[[Trial, np.random.Generator], Answer]
"""Somebody who answers: a simulated one draws from the generator and from nothing
else.
"""


@public
def outcome(trial: Trial, answer: Answer) -> Any:
    """Return what an answer to the first question counts for.

    It is its score where the trial has scores, else the answer itself.

    Raises
    ------
    BadValue
        The first question was not answered, or the answer is none of the choices.
    """
    name = trial.questions[0]
    if name not in answer.values:
        raise BadValue(f"the question {name!r} is not answered: {dict(answer.values)!r:.80}")
    value = answer.values[name]
    if not trial.scores:
        return value
    if not isinstance(value, str) or value not in trial.scores:
        raise BadValue(f"{name}: {value!r:.80} is no choice; there are {', '.join(trial.scores)}")
    return trial.scores[value]


def answered(observer: Observer, trial: Trial, rng: np.random.Generator) -> Answer:
    """Return what an observer answers to a trial.

    Raises
    ------
    BadValue
        The observer raises, with its line; or it gives something else than an `Answer`.
    """
    answer = called("the observer", observer, trial, rng)
    if not isinstance(answer, Answer):
        raise BadValue(
            f"the observer gives {answer!r:.80} where it must give an Answer, such as"
            " Answer({'softer': 'first'})"
        )
    return answer


@public
def observed(
    design: Design, seed: int, observer: Observer, rng: np.random.Generator
) -> Iterator[tuple[Trial, Answer]]:
    """Run a whole session of a simulated observer, without rendering samples.

    Parameters
    ----------
    design : Design
    seed : int
        Of the session.
    observer : callable
        ``observer(trial, rng) -> Answer``.
    rng : numpy.random.Generator
        The observer's own.

    Yields
    ------
    (Trial, Answer)

    Raises
    ------
    BadValue
        As `answered`.
    """
    state = design.init(seed)
    while (trial := design.next(state)) is not None:
        answer = answered(observer, trial, rng)
        yield trial, answer
        state = design.update(state, answer)
