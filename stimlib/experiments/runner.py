"""The session loop, which presents trials, asks questions and records answers.

A front end communicates with the participant. It is the only part that deals with a
keyboard, a page or a simulated observer.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..errors import public
from .designs import trials_of
from .presentation import prepare, present
from .questions import Question
from .random_streams import seed_of, stream
from .session import Session
from .trial import Answer, Observer, Record, Stimulus, Trial, answered

Display = Callable[[Trial, Path], dict[str, Any]]
"""Function that displays a trial, with a folder for the log, and returns its record. If
the record says ``missed``, the participant was not present throughout, and the trial is
displayed again; both records are kept.
"""


class FrontEnd(Protocol):
    """The part of a session that a participant sees and operates."""

    def tell(self, text: str) -> None:
        """Show a text to the participant."""

    def rest(self, seconds: float) -> None:
        """Wait for a rest of some seconds, which the participant cannot shorten."""

    def ready(self, text: str) -> None:
        """Wait until the participant wants to continue."""

    def pick(self, names: list[str]) -> str | None:
        """Return a stimulus to explore before the session, or None to begin."""

    def ask(self, trial: Trial, question: Question, replays: int) -> Any:
        """Return the answer to a question, or None to repeat the stimuli.

        The stimuli can be repeated as long as replays are left.
        """


@public
def run(
    session: Session, front_end: FrontEnd, sink: str | Display = "offline", **options: Any
) -> None:
    """Run all remaining trials of an open session.

    A session that was begun before goes on without instructions and familiarisation.

    Parameters
    ----------
    session : Session
        Opened by ``with``.
    front_end : FrontEnd
    sink : str or callable
        Name of a sink, see `stimlib.experiments.presentation.SINKS`, or a function that
        displays a trial itself: ``sink(trial, folder) -> dict``.
    **options
        More for the sink.

    Raises
    ------
    SinkError, FaultError
        The device has failed, or the disk is full; all answers so far are kept, and the
        session can be resumed.

    Examples
    --------
    See ``docs/howto/experiments.rst``.
    """
    e, say = session.experiment, session.experiment.texts
    total = trials_of(session.design) if e.show_total else None

    def show(trial: Trial, name: str) -> list[dict[str, Any]]:
        shown: list[dict[str, Any]] = []
        while not shown or shown[-1].get("missed"):
            folder = next(
                f for k in count(1) if not (f := session.folder / f"{name}-{k}.stimlog").exists()
            )
            shown.append(
                present(e, trial, sink, folder, **options)
                if isinstance(sink, str)
                else sink(trial, folder)
            )
        return shown

    if (trial := session.due()) is None:
        front_end.tell(say("all_done"))
        return
    if isinstance(sink, str):
        prepare(session, sink, options.get("calibration"))
    if session.records or any(session.folder.glob("trial-*.stimlog")):  # it was begun before
        front_end.tell(say("resumed"))
    else:
        if e.instructions:
            front_end.tell(e.instructions)
        _familiarise(session, trial, front_end, show)
    while (trial := session.due()) is not None:
        if (seconds := session.rest(trial)) > 0:
            front_end.rest(seconds)
        title = say("trial_of" if total else "trial", number=session.number, total=total)
        front_end.ready(say("training", trial=title) if trial.training else title)
        record = _one(session, trial, front_end, show)
        if e.feedback and (right := e.right(trial)):
            good = all(record.answer.values[k] == v for k, v in right.items())
            front_end.tell(say("right" if good else "wrong"))
    front_end.tell(say("finished"))


def _familiarise(
    session: Session,
    due: Trial,
    front_end: FrontEnd,
    show: Callable[[Trial, str], list[dict[str, Any]]],
) -> None:
    """Let the participant explore stimuli before the first trial.

    These presentations do not count as trials.
    """
    familiar = session.experiment.familiar(session.participant, session.session)
    for n in count():
        name = front_end.pick(list(familiar)) if familiar else None
        if name is None:
            return
        known = familiar[name]
        stimulus = Stimulus(
            known.scene, known.params, seed_of(session.seed, "familiarisation", n), name
        )
        show(Trial("familiarisation", (stimulus,), due.questions), "familiarisation")


def _one(
    session: Session,
    trial: Trial,
    front_end: FrontEnd,
    show: Callable[[Trial, str], list[dict[str, Any]]],
) -> Record:
    """Run one trial: display it, ask the questions and write the record.

    The trial is displayed again if the participant requests an allowed replay.
    """
    name_of_log = f"trial-{session.number:04}"
    shown, replays = show(trial, name_of_log), 0
    began = time.monotonic()
    values: dict[str, Any] = {}
    for name in trial.questions:
        question = session.experiment.question(name)
        while (
            value := front_end.ask(trial, question, session.experiment.replays - replays)
        ) is None:
            if replays < session.experiment.replays:
                shown, replays = [*shown, *show(trial, name_of_log)], replays + 1
                began = time.monotonic()
        values[name] = value
    return session.put(Answer(values, round(time.monotonic() - began, 3), replays), shown)


@public
class Simulated:
    """The front end of a simulated observer, which needs no rest.

    See `stimlib.experiments.trial.Observer`.

    Parameters
    ----------
    session : Session
    observer : callable
        ``observer(trial, rng) -> Answer``; its draws for a trial depend on the
        session's seed and the trial's number alone, so that a resumed session continues
        as it would have without the interruption.
    """

    def __init__(self, session: Session, observer: Observer):
        self._session, self._observer = session, observer

    def tell(self, text: str) -> None:
        """Ignore a text."""

    def rest(self, seconds: float) -> None:
        """Skip a rest."""

    def ready(self, text: str) -> None:
        """Continue at once."""

    def pick(self, names: list[str]) -> str | None:
        """Begin at once, because a simulated observer knows all stimuli."""
        return None

    def ask(self, trial: Trial, question: Question, replays: int) -> Any:
        """Return the observer's answer to a question."""
        rng: np.random.Generator = stream(self._session.seed, "observer", self._session.number)
        value = answered(self._observer, trial, rng).values.get(question.name)
        question.check(value)  # None would ask for a replay, and again
        return value
