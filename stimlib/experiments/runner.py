"""The session loop, which presents trials, asks questions and records answers.

A front end communicates with the participant. It is the only part that deals with a
keyboard, a page or a simulated observer.
"""

from __future__ import annotations

import dataclasses as dc
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from typing import Any, Protocol

import numpy as np

from ..errors import MotionError, public
from .designs import trials_of
from .presentation import prepare, present
from .questions import Question
from .random_streams import seed_of, stream
from .session import Session
from .trial import Answer, Observer, Record, Stimulus, Trial, answered, correct

Display = Callable[..., dict[str, Any]]
"""Function that displays a trial, ``display(trial, folder)``, with a folder for the
log, and returns its record. If the record says ``missed``, the participant or the
motion was not there throughout, and the trial is displayed again; both records are
kept. After ``REPEATS`` records in a row that say that the motion was ``silent``, the
session ends.

Self-paced intervals are displayed one by one, as trials of one stimulus, with the
keywords ``interval``, ``meanwhile``, ``lasts`` and ``started`` of
`stimlib.experiments.presentation.present`.
"""

# presentations of a stimulus in a row without motion, after which a session ends
REPEATS = 3


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
    BadValue, UnknownName
        As `stimlib.experiments.presentation.prepare` and `Session.check_kind`, before
        the participant reads anything.
    MotionError
        The motion stayed away in ``REPEATS`` presentations in a row; the session can be
        resumed.

    Examples
    --------
    See ``docs/howto/experiments.rst``.
    """
    e, say = session.experiment, session.experiment.texts
    total = trials_of(session.design) if e.show_total else None

    def show(trial: Trial, name: str, **asking: Any) -> list[dict[str, Any]]:
        shown: list[dict[str, Any]] = []
        for n, (part, how) in enumerate(_parts(session, front_end, trial, **asking)):
            while sum(not d.get("missed") for d in shown) <= n:
                folder = next(
                    f
                    for k in count(1)
                    if not (f := session.folder / f"{name}-{k}.stimlog").exists()
                )
                shown.append(
                    present(e, part, sink, folder, **how, **options)
                    if isinstance(sink, str)
                    else sink(part, folder, **how)
                )
                if shown[-1].get("missed"):
                    silent = [d.get("silent") for d in shown[-REPEATS:]]
                    if all(silent) and len(silent) == REPEATS:
                        raise MotionError(f"{REPEATS} presentations in a row: {silent[-1]}")
                    front_end.tell(say("unmoved" if silent[-1] else "missed"))
                    front_end.ready(say("again"))
        return shown

    session.check_kind(getattr(front_end, "simulated", False))
    if (trial := session.due()) is None:
        front_end.tell(say("all_done"))
        return
    if isinstance(sink, str):
        prepare(session, sink, **options)
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
        if trial.stimuli:
            front_end.ready(say("training", trial=title) if trial.training else title)
        record = _one(session, trial, front_end, show)
        if e.feedback and (good := correct(trial, record.answer)) is not None:
            front_end.tell(say("right" if good else "wrong"))
    front_end.tell(say("finished"))


def _parts(
    session: Session,
    front_end: FrontEnd,
    trial: Trial,
    ask: Callable[[], None] | None = None,
    lasts: float | None = None,
) -> Iterator[tuple[Trial, dict[str, Any]]]:
    """Yield what is presented at a time, and how: a trial, or a self-paced interval."""
    t, say = session.experiment.timing, session.experiment.texts
    if not t.self_paced and trial.stimuli:
        yield trial, {}
    done, now = partial(front_end.ready, say("done")), partial(front_end.tell, say("now"))
    for i, stimulus in enumerate(trial.stimuli if t.self_paced else (), 1):
        ends = {"done": done, "answer": ask if ask and i == len(trial.stimuli) else done}
        how = {"interval": i, "meanwhile": ends.get(t.until), "lasts": lasts, "started": now}
        yield dc.replace(trial, stimuli=(stimulus,)), how


def _familiarise(
    session: Session,
    due: Trial,
    front_end: FrontEnd,
    show: Callable[..., list[dict[str, Any]]],
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
    show: Callable[..., list[dict[str, Any]]],
) -> Record:
    """Run one trial: display it, ask the questions and write the record.

    The trial is displayed again if the participant requests an allowed replay.
    """
    e, replays, asked = session.experiment, 0, -1
    lasts = (
        front_end.answer(trial).seconds or e.timing.interval
        if isinstance(front_end, Simulated) and e.timing.until != "time" and trial.stimuli
        else None
    )
    shown, values, times = list[dict[str, Any]](), dict[str, Any](), dict[str, float]()

    def ask(again: bool = False) -> None:
        nonlocal replays
        if again:  # while a stimulus is there, which may have been there before
            values.clear()
        for name in trial.questions:
            while name not in values:
                since = time.monotonic()
                value = front_end.ask(trial, e.question(name), e.replays - replays)
                if value is not None:
                    values[name], times[name] = value, round(time.monotonic() - since, 3)
                elif replays < e.replays:
                    replays += 1
                    return

    while asked < replays:
        asked = replays
        shown += show(trial, f"trial-{session.number:04}", ask=partial(ask, True), lasts=lasts)
        if asked == replays:
            ask()
    seconds = lasts if lasts and e.timing.until == "answer" else round(sum(times.values()), 3)
    simulated = getattr(front_end, "simulated", False)
    return session.put(Answer(values, seconds, replays, times, simulated), shown)


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

    Notes
    -----
    Each answer is stored as simulated (``Answer.simulated``), and a session has either
    such answers or those of a participant.  A front end of your own that simulates has
    an attribute ``simulated = True``, as this one has.
    """

    simulated = True

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
        value = self.answer(trial).values.get(question.name)
        question.check(value)  # None would ask for a replay, and again
        return value

    def answer(self, trial: Trial) -> Answer:
        """Return the observer's answer to a trial; a guess after the last trial."""
        rng: np.random.Generator = stream(self._session.seed, "observer", self._session.number)
        who = self._observer if trial.stimuli else self._session.experiment.guess
        return answered(who, trial, rng)
