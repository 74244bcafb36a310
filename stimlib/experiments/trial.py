"""Trials as plain data: stimuli in their order, questions and answers.

A *design* decides which trial comes next.  It has three pure functions over plain JSON
data, so that passing the answers in a log through ``update``, one after the other,
restores the state in which a session was left:

``init(seed) -> State``
    the state before the first trial; all random numbers are drawn from
    `stimlib.experiments.random_streams.stream`
``next(state) -> Trial or None``
    the trial that is due, None at the end
``update(state, answer) -> State``
    the state after that trial was answered; the given state is not changed
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

from ..errors import BadValue, public
from .user_code import called

State = dict[str, Any]
"""State of a design, as JSON data."""

FAST = ("offline", "file")
"""Sinks without a clock: "offline" runs as fast as possible, and "file" also keeps
delivered.caf in the log.
"""


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
        Seed of its noise: stimuli with the same seed have the same noise, and different
        seeds give independent noise.
    name : str
        Its name in the analysis, such as "standard"; it is not shown during the
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
        names), places (list of [x, y]), a text.
    seconds : float, optional
        Sum of the response times. The first question is asked some tenths of a second
        after the last stimulus ends, or when it begins if it ends with the answer. Of a
        simulated observer, how long it explores each stimulus that it ends itself.
    replays : int
        Number of replays.
    times : dict of str to float
        Response time in s of each question: from when it was asked to its answer.
    simulated : bool
        Whether an observer gave it, and no participant.  `observed` and the front end
        `Simulated` set it.
    """

    values: Mapping[str, Any]
    seconds: float | None = None
    replays: int = 0
    times: Mapping[str, float] = dc.field(default_factory=dict)
    simulated: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as plain JSON data; ``Answer(**data)`` restores it."""
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
        The varied value, after limiting to the bounds.
    wanted : float, optional
        The level that the design requested, before limiting to the bounds.
    track : str
        The staircase that this trial belongs to, if there are several.
    scores : dict of str to float
        Score of each choice of the first question: 1 for "the comparison is more", or
        for "yes, it was the signal".
    correct : dict of str to JSON data
        The right answer to each question, if there is one, for feedback.
    training : bool
        Whether the analysis ignores the trial.
    pause : float
        Seconds of rest before this trial, which cannot be shortened.
    chance : float, optional
        Chance level: the probability of outcome 1 if the stimulus cannot be felt; 1/m
        if the right one of m intervals must be found, 0 for yes or no.  None for a
        comparison, whose curve is symmetric.  Fits use this value.

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

    @property
    def right(self) -> dict[str, Any]:
        """The right answers: ``correct``, or the choice of score 1 by chance level.

        Places have none, because a mark is near or far.
        """
        best = [c for c, score in self.scores.items() if score == 1 and self.chance]
        known = self.correct or dict(zip(self.questions, best, strict=False))
        return {
            name: known[name]
            for name in self.questions
            if name in known and np.ndim(known[name]) < 2
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the trial as plain JSON data."""
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
    """An answered trial, which is one line of a session's log.

    Analyses are based on these records.

    Attributes
    ----------
    number : int
        From 1 on.
    trial : Trial
        The trial as requested.
    answer : Answer
    displayed : list of dict
        What was delivered at each presentation; see
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
        """Time axis of the intervals in the last presentation.

        "own" means that each interval is an independent rendering of its stimulus.
        "shared" (older sessions) means that all intervals are windows on one run, whose
        time, states and noise begin with the trial. An empty text means that the trial
        was not displayed by `present`.
        """
        shown = self.displayed[-1] if self.displayed else {}
        return shown.get("time", "shared" if "intervals" in shown else "")

    def intervals(self, since: str) -> list[tuple[str, float | None, float | None]]:
        """Return stimulus, begin and end of each interval of the last presentation.

        Times are in s after a date and time, ISO 8601, and None if they are not known:
        a sink without a clock gives none, because it does not run in real time.
        """
        at = {
            k: [
                round(  # to the resolution of the clock
                    (
                        datetime.fromisoformat(d["started"]) - datetime.fromisoformat(since)
                    ).total_seconds()
                    + n / d["fs"],
                    6,
                )
                for n in ab
            ]
            for d in self.displayed
            if "started" in d and in_real_time(d)
            for k, ab in enumerate(d["intervals"], d.get("interval", 1) - 1)
        }
        return [
            (s.name or s.scene, *at.get(k, (None, None))) for k, s in enumerate(self.trial.stimuli)
        ]

    @property
    def outcome(self) -> Any:
        """Score of the answer to the first question; see `outcome`."""
        return outcome(self.trial, self.answer)


def in_real_time(shown: Mapping[str, Any]) -> bool:
    """Return whether a presentation ran by a clock; of old ones the sink says it."""
    return shown.get("clock", shown.get("sink") not in FAST)


@runtime_checkable
class Design(Protocol):
    """The rule that decides which trial comes next, as a function of the answers."""

    def init(self, seed: int) -> State:
        """Return the initial state for a seed."""

    def next(self, state: State) -> Trial | None:
        """Return the next trial, or None at the end."""

    def update(self, state: State, answer: Answer) -> State:
        """Return the state that follows an answer."""


Observer = Callable[[Trial, np.random.Generator], Answer]
"""Function that answers trials; a simulated observer uses no other randomness than the
generator.
"""


def correct(trial: Trial, answer: Answer) -> bool | None:
    """Return whether all right answers were given; None if a trial has none."""
    said, right = answer.values, trial.right.items()
    # an order is a tuple, or the list that it becomes in a log
    return all(k in said and np.array_equal(said[k], v) for k, v in right) if right else None


@public
def outcome(trial: Trial, answer: Answer) -> Any:
    """Return the score of the answer to the first question.

    If the trial has no scores, it is the answer itself.

    Raises
    ------
    BadValue
        The first question was not answered, or the answer is not one of the choices.
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


def due(design: Design, state: State, n: int) -> Trial:
    """Return the trial that takes an answer; BadValue where none of n is left."""
    trial = design.next(state)
    if trial is None:
        raise BadValue(f"no trial of {n} is left: there are no more answers to take")
    return trial


def answered(observer: Observer, trial: Trial, rng: np.random.Generator) -> Answer:
    """Return an observer's answer to a trial, marked as simulated.

    Raises
    ------
    BadValue
        The observer raises an error, whose line is named, or returns something other
        than an `Answer`.
    """
    answer = called("the observer", observer, trial, rng)
    if not isinstance(answer, Answer):
        raise BadValue(
            f"the observer gives {answer!r:.80} where it must give an Answer, such as"
            " Answer({'softer': 'first'})"
        )
    return dc.replace(answer, simulated=True)


@public
def observed(
    design: Design, seed: int, observer: Observer, rng: np.random.Generator
) -> Iterator[tuple[Trial, Answer]]:
    """Run a whole session of a simulated observer, without rendering samples.

    Parameters
    ----------
    design : Design
    seed : int
        Seed of the session.
    observer : callable
        ``observer(trial, rng) -> Answer``.
    rng : numpy.random.Generator
        Random generator of the observer.

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
