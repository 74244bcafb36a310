"""The definition of an experiment, as a plain value that sessions use."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
import math
import os
import re
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from itertools import islice
from typing import Any, Literal

import numpy as np

from ..core.graph import Block, constant
from ..core.scene import Scene
from ..core.units import Unit, pretty
from ..errors import BadValue, UnitError, UnknownName, need, public
from ..run.safety import Safety
from ..system import fields
from .designs import reach_of
from .questions import Question
from .random_streams import seed_of, stream
from .tasks import DIFFERENCES, TwoInterval, extremes
from .texts import Texts, texts_of
from .trial import Answer, Design, Observer, Stimulus, Trial, observed
from .user_code import called

# output of a trial's scene, on no channel: the condition that begins an interval
STARTS = "starts"
# names of columns of the answers, which no question can have
COLUMNS = frozenset(
    "participant session number condition track level chance outcome correct seconds replays"
    " simulated training".split()
)
INTERVAL = re.compile(r"interval_\d+(_started|_stopped)?")


@public
@dc.dataclass(frozen=True)
class Timing:
    """The durations in a trial, in s, and what begins and ends its intervals.

    Parameters
    ----------
    interval : float
        Duration of each stimulus, in which the participant explores it; the longest, if
        the participant ends it.
    gap : float
        Silence between two stimuli of a trial.
    before : float
        Silence before the first.
    ramp : float
        Duration of the fade-in and fade-out of each stimulus, within its interval.
    pause : float
        Minimum time from an answer to the next trial.
    until : {"time", "done", "answer"}
        What ends a stimulus: its time; a key that the participant presses when done; or
        the answer. With "answer" the questions are asked during the last stimulus of a
        trial, which ends with the last of their answers; those before end as with
        "done".
    starts : Block, optional
        Condition on the inputs, such as a contact that lasts for 0.5 s: the interval
        begins at the first sample at which it is 0.5 or more. The stimulus is there
        before, so that it can be touched.
    wait : float
        Time that a stimulus lasts longer, in which ``starts`` may come to hold.

    Raises
    ------
    BadValue
        A time below 0 or above 3600 s, an interval that is not longer than its ramps,
        or an unknown ``until``.

    Notes
    -----
    With ``until`` or ``starts`` the intervals are *self-paced*, and each is a run of
    the sink with a log of its own. A stimulus that is ended fades out within the fade
    of `stimlib.run.safety.Safety`. The next one begins after ``gap`` and the time that
    the device needs to be opened again.

    Examples
    --------
    >>> from stimlib import Input, constant
    >>> from stimlib.blocks import envelope, velocity
    >>> from stimlib.experiments import Timing
    >>> squeeze = Timing(interval=20.0, until="done")
    >>> x = Input("x", "m")
    >>> contact = envelope(x > constant(0.0, "m"), attack=0.5, release=0.0) >= 1.0
    >>> after_contact = Timing(interval=3.0, starts=contact, wait=10.0)
    >>> fast = abs(velocity(x)) > constant(0.05, "m/s")
    >>> moving = Timing(interval=3.0, starts=fast, wait=10.0)
    """

    interval: float = 3.0
    gap: float = 0.5
    before: float = 0.1
    ramp: float = 0.02
    pause: float = 0.0
    until: Literal["time", "done", "answer"] = "time"
    starts: Block | None = None
    wait: float = 0.0

    def __post_init__(self):
        for name in ("interval", "gap", "before", "ramp", "pause", "wait"):
            v = getattr(self, name)
            if not isinstance(v, (int, float)) or not 0 <= v < 3600:
                raise BadValue(f"Timing: {name} = {v!r} must be a time in seconds from 0 to 3600")
        if self.interval <= 2 * self.ramp:
            raise BadValue(
                f"Timing: interval = {self.interval:g} s must be longer than its two ramps of"
                f" {self.ramp:g} s"
            )

    @property
    def self_paced(self) -> bool:
        """Whether something else than time begins or ends an interval."""
        return self.until != "time" or self.starts is not None


@public
@dc.dataclass(frozen=True)
class Cursor:
    """A moving reference to follow on screen, amplitude * sin(2 pi frequency t).

    The reference is for one input (Çaldıran's thesis, section 3.5).
    """

    input: str
    amplitude: float
    frequency: float = 1.0

    def __post_init__(self):
        if not (fields.positive(self.amplitude) and fields.positive(self.frequency)):
            raise BadValue(
                f"Cursor: amplitude = {self.amplitude!r} and frequency = {self.frequency!r} must be"
                " above 0"
            )


@public
@dc.dataclass(frozen=True)
class Masking:
    """White masking noise on a separate channel during stimuli.

    Its ``rms`` is relative to the device's full scale.
    """

    output: str = "masking"
    rms: float = 0.05


@public
@dc.dataclass(frozen=True)
class Drawing:
    """What the page of an experiment draws while a stimulus is presented.

    The object and the hand are drawn if the scene says how they look: soft surfaces
    with their shades, plate and helix of ``viscoelastic``, the pad of ``bumps``. See
    `stimlib.live.describe.view_of`.

    Parameters
    ----------
    surface : bool
        Whether the object is drawn.
    cursor : bool
        Whether the avatars, or the place of the finger, are drawn.
    hidden : bool
        Whether the page also shows what should only be felt: where nodules or bumps
        are.
    beside : (float, float)
        Place of the avatar beside the pen, in m to the right and up, so that the hand
        does not cover it, such as ``(-0.015, 0.0)``: 15 mm to the left. A browser's
        millimetres are nominal, 96 pixels in 25.4 mm: measure them on your screen.
    marks : dict of str to (float, float)
        Places on a soft surface, x and y in m from its corner, each marked with a dot
        and its name.

    Raises
    ------
    BadValue
        More than 0.1 m beside the pen, or a mark at no place.

    Examples
    --------
    >>> from stimlib.experiments import Drawing
    >>> Drawing(beside=(-0.015, 0.0))
    Drawing(surface=True, cursor=True, hidden=False, beside=(-0.015, 0.0), marks={})
    """

    surface: bool = True
    cursor: bool = True
    hidden: bool = False
    beside: tuple[float, float] = (0.0, 0.0)
    marks: Mapping[str, tuple[float, float]] = dc.field(default_factory=dict)

    def __post_init__(self):
        if not (len(self.beside) == 2 and all(map(fields.between(-0.1, 0.1), self.beside))):
            raise BadValue(
                f"Drawing: beside = {self.beside!r:.60} must be two distances in m, to the right"
                " and up, of at most 0.1"
            )
        for name, place in self.marks.items():
            if len(place) != 2 or not all(map(fields.number, place)):
                raise BadValue(f"Drawing: mark {name!r} at {place!r:.60}; give x and y in m")


@public
@dc.dataclass(frozen=True)
class Experiment:
    """The definition of an experiment, without its participants or device.

    Parameters
    ----------
    name, version : str
        A log belongs to exactly one name, version and definition.
    scenes : dict of str to Scene
        The scenes that stimuli refer to by name.
    design : Design, or callable
        ``design(participant, session) -> Design`` if the order depends on the
        participant (a code such as "P07") and the session number; see
        `stimlib.experiments.designs`.
    questions : tuple of Question
    fs : float
        Hz.
    safety : Safety or float
        As for every sink.  A number is the largest value of all outputs, which then
        have one unit.
    bounds : dict of str to (float, float)
        Smallest and largest value of parameters, which no trial may exceed. They
        protect the participant's hand.
    motion : any
        The motion of the inputs, as for a sink: functions of time for a simulated hand,
        from sample 0 of a trial and not of each interval, ``Live()`` or ``Signals`` for
        a real one.
    hand : callable, optional
        For ``Live()``: ``hand(sink)`` pushes positions (``Sink.push``) until
        ``sink.finished``.
    timing : Timing
    familiarisation : dict of str to Stimulus, or callable
        Stimuli that the participant may explore freely before the first trial; use
        ``familiarisation(participant, session)`` if they depend on these.
    sessions : int
        Number of sessions per participant; a simulation runs all of them.
    replays : int
        Number of replays that the participant may request in a trial.
    feedback : bool
        Whether to tell the participant if the answer was right, after each trial that
        has a right answer (``Experiment.right``); places have none.
    cursor : Cursor, optional
    masking : Masking, optional
    drawing : Drawing, optional
        What the page of the experiment draws; None: nothing.
    seed : int
        Seed of the whole experiment; each participant and session has its own random
        streams.
    instructions : str
        The text that the participant reads first.
    observer : callable, optional
        The simulated participant: ``observer(trial, rng) -> Answer``.
    analysis : callable, optional
        ``analysis(sessions) -> any``, called with a list of
        `stimlib.experiments.reader.Saved`; the result is printed.
    after : tuple of Question
        Questions that are asked once, after the last trial of a session, such as which
        condition the participant preferred.
    language : str or path
        Language of all other texts that the participant reads: "en", "de", or a file of
        your own; see `stimlib.experiments.texts_of`.
    show_total : bool
        Whether the participant reads "Trial 3 of 40" and not "Trial 3", if the number
        does not depend on the answers.

    Raises
    ------
    BadValue, UnknownName
        Something is missing or of a wrong kind, two questions have the same name, no
        scene has a parameter with bounds, the design may reach a level that violates
        them, or feedback is wanted where no trial has a right answer.

    Notes
    -----
    A log belongs to all of this but ``observer``, ``analysis``, ``language`` and
    ``show_total``; it states the texts.

    Examples
    --------
    See `stimlib.experiments.designs`.
    """

    name: str
    version: str
    scenes: Mapping[str, Scene]
    design: Design | Callable[[str, int], Design]
    questions: tuple[Question, ...]
    fs: float
    safety: Safety | float
    bounds: Mapping[str, tuple[float, float]] = dc.field(default_factory=dict)
    motion: Any = None
    hand: Callable[[Any], None] | None = None
    timing: Timing = Timing()
    familiarisation: Mapping[str, Stimulus] | Callable[[str, int], Mapping[str, Stimulus]] = (
        dc.field(default_factory=dict)
    )
    sessions: int = 1
    replays: int = 0
    feedback: bool = False
    cursor: Cursor | None = None
    masking: Masking | None = None
    drawing: Drawing | None = Drawing()
    seed: int = 0
    instructions: str = ""
    observer: Observer | None = None
    analysis: Callable[[list[Any]], Any] | None = None
    after: tuple[Question, ...] = ()
    language: str | os.PathLike[str] = "en"
    show_total: bool = True

    def __post_init__(self):
        self._check_fields()
        self._check_names()
        _ = self.texts  # or a language that is none is found in the first session
        if isinstance(self.design, Design):
            self._check_design(self.design)
        for known in () if callable(self.familiarisation) else self.familiarisation.values():
            self.check(Trial("familiarisation", (known,), (self.questions[0].name,)))

    def _check_fields(self) -> None:
        names = [q.name for q in (*self.questions, *self.after)]
        if not self.scenes:
            raise BadValue(
                f"experiment {self.name!r}: scenes must be a table of names to Scene, one at least"
            )
        if not self.questions or len(set(names)) != len(names):
            raise BadValue(
                f"experiment {self.name!r}: it needs questions, each with a name of its own; got"
                f" {names}"
            )
        taken = {*COLUMNS, *(f"{name}_rt" for name in names)}
        if lost := [n for n in names if n in taken or INTERVAL.fullmatch(n)]:
            raise BadValue(
                f"experiment {self.name!r}: a question is called {', '.join(lost)}, as a column of"
                " the answers is; give it another name"
            )
        if not fields.positive(self.fs) or round(self.timing.interval * self.fs) < 1:
            raise BadValue(
                f"experiment {self.name!r}: fs = {self.fs!r} must be in Hz, with a sample in each"
                " interval at least"
            )
        if not fields.whole(10**6)(self.replays):
            raise BadValue(
                f"experiment {self.name!r}: replays = {self.replays!r} must be a whole number from"
                " 0 on"
            )

    def _check_names(self) -> None:
        if self.masking and self.masking.output in self.outputs:
            raise BadValue(
                f"Masking: {self.masking.output!r} is an output of a scene: name a channel of"
                " its own"
            )
        shown = [self.cursor.input] if self.cursor else []
        need("Cursor", shown, self.inputs, "input")
        needs = set(
            Scene(
                {STARTS: constant(0.0) if self.timing.starts is None else self.timing.starts}
            ).inputs
        )
        if needs - set(self.inputs) or STARTS in self.outputs:
            raise UnknownName(
                f"Timing: starts takes {', '.join(sorted(needs))}, and the scenes have the inputs"
                f" {', '.join(self.inputs) or 'none'}; it can take no other, and no output of"
                f" theirs can be called {STARTS!r}"
            )
        known = {p for s in self.scenes.values() for p in s.params}
        need("bounds", self.bounds, sorted(known), "parameter")
        for name, pair in self.bounds.items():
            if not (all(map(fields.number, pair)) and pair[0] < pair[1]):
                raise BadValue(f"bounds: {name} = {pair!r} must be two finite numbers that rise")

    @property
    def outputs(self) -> dict[str, Unit]:
        """Outputs of all scenes in their order, which are the channels of every trial.

        Each output thus has the same channel in all trials.
        """
        return {name: block.dim for s in self.scenes.values() for name, block in s.outputs.items()}

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs of all scenes, in the order of first use."""
        return tuple({name: None for s in self.scenes.values() for name in s.inputs})

    @cached_property
    def texts(self) -> Texts:
        """The other texts that the participant reads."""
        return texts_of(self.language)

    def question(self, name: str) -> Question:
        """Return the question with a name; raise UnknownName if there is none."""
        for q in (*self.questions, *self.after):
            if q.name == name:
                return q
        raise UnknownName(
            f"no question {name!r}; there are {', '.join(q.name for q in self.questions)}"
        )

    def designed(self, participant: str, session: int = 1) -> Design:
        """Return the design for one session of a participant."""
        if isinstance(self.design, Design):
            return self.design
        made = called(
            f"experiment {self.name!r}: design({participant!r}, {session})",
            self.design,
            participant,
            session,
        )
        if not isinstance(made, Design):
            raise BadValue(
                f"experiment {self.name!r}: design({participant!r}, {session}) gives {made!r:.80},"
                " no design"
            )
        self._check_design(made)
        return made

    def guess(self, trial: Trial, rng: np.random.Generator) -> Answer:
        """Return the answer of somebody who ignores the stimuli; an `Observer`."""
        return Answer({name: self.question(name).guess(rng) for name in trial.questions})

    def _check_design(self, design: Design) -> None:
        """Raise an error unless all levels that a design may reach can be presented.

        If feedback is wanted, a trial must have a right answer.
        """
        for task, level in reach_of(design):
            for trial in extremes(task, level):
                self.check(trial)
            self._check_detection(getattr(task, "task", task))
        guessed = observed(design, 0, self.guess, stream(0, "feedback"))
        if self.feedback and not any(trial.right for trial, _ in islice(guessed, 1000)):
            raise BadValue(
                f"experiment {self.name!r}: feedback=True, but no trial of the design has a right"
                " answer; give correct= in Rate or in Trial, give the standard of a TwoInterval a"
                " value of what varies, or leave feedback out"
            )

    def _check_detection(self, task: Any) -> None:
        """Raise an error where a standard of 0 Hz or 0 s is taken as no stimulus."""
        if isinstance(task, TwoInterval) and task.chance and task.detection is None:
            varied = self.scenes[task.comparison.scene].params[task.varies]
            if str(varied.dim) in ("1/s", "s"):
                raise BadValue(
                    f"condition {task.condition!r}: the standard has {task.varies} = 0"
                    f" {varied.unit}, which is taken as no stimulus, with a chance level of 0.5;"
                    f" {DIFFERENCES}"
                )

    def familiar(self, participant: str, session: int = 1) -> Mapping[str, Stimulus]:
        """Return the stimuli that a participant may explore before a session."""
        return (
            self.familiarisation(participant, session)
            if callable(self.familiarisation)
            else self.familiarisation
        )

    def seeded(self, participant: str, session: int = 1) -> int:
        """Return the seed for one session of a participant."""
        return seed_of(self.seed, "session", participant, session)

    def check_safety(self) -> None:
        """Raise an error if one full scale is given for outputs in different units."""
        scale = getattr(self.safety, "full_scale", self.safety)
        units = {n: str(b.dim) for s in self.scenes.values() for n, b in s.outputs.items()}
        if not isinstance(scale, Mapping) and len(set(units.values())) > 1:
            each = ", ".join(f"{n} [{pretty(u)}]" for n, u in units.items())
            raise UnitError(
                f"experiment {self.name!r}: safety is one full scale for outputs in different units"
                f" ({each}); give Safety(full_scale={{{', '.join(f'{n!r}: ..' for n in units)}}})"
            )

    def check(self, trial: Trial) -> None:
        """Raise an error unless a trial can be presented.

        Its scenes, parameters and questions must be known, and all parameters must lie
        within their bounds.
        """
        if not trial.questions:
            raise BadValue(f"condition {trial.condition!r}: a trial asks one question at least")
        if trial.stimuli and (late := {q.name for q in self.after} & set(trial.questions)):
            raise BadValue(
                f"condition {trial.condition!r}: {', '.join(sorted(late))} is asked after the"
                " session, and not by a trial; put it among questions to ask it there"
            )
        if not trial.stimuli and trial.questions != tuple(q.name for q in self.after):
            raise BadValue(
                f"condition {trial.condition!r}: a trial has one stimulus at least; put questions"
                " without one into after ="
            )
        first = [self.question(name) for name in trial.questions][0]
        if trial.scores and set(trial.scores) != {*first.choices}:
            raise BadValue(
                f"condition {trial.condition!r}: {first.name} has the choices"
                f" {', '.join(first.choices) or 'none'}, the task counts {', '.join(trial.scores)}:"
                " they must be the same; give the task the words of the question, in TwoInterval"
                " as choices=(.., ..)"
            )
        try:
            json.dumps(trial.to_dict(), allow_nan=False)
        except (TypeError, ValueError) as e:
            raise BadValue(
                f"condition {trial.condition!r}: it cannot be kept in a log: {e}; give levels,"
                " parameters and right answers as finite numbers of Python, as float(..) or"
                " .tolist() make them"
            ) from e
        for s in trial.stimuli:
            where = f"condition {trial.condition!r}"
            need(where, [s.scene], self.scenes, "scene")
            need(f"{where}: {s.scene}", s.params, self.scenes[s.scene].params, "parameter")
            values = {
                name: s.params.get(name, p.value) for name, p in self.scenes[s.scene].params.items()
            }
            for name, value in values.items():
                low, high = self.bounds.get(name, (-math.inf, math.inf))
                if not fields.number(value):
                    raise BadValue(
                        f"condition {trial.condition!r}: {name} = {value!r:.80} is no number"
                    )
                if not low <= value <= high:
                    raise BadValue(
                        f"condition {trial.condition!r}: {name} = {value:g} is beyond its bounds,"
                        f" {low:g} to {high:g}; keep all levels that the design may reach, and the"
                        " standard, within the bounds of the experiment"
                    )

    def facts(self) -> dict[str, Any]:
        """Return the description of the experiment for a log, as JSON data.

        ``key`` is the SHA-256 of the rest.

        Functions (a motion, or a design that depends on the participant) are described
        by their name only.
        """
        told = {
            f.name: _plain(getattr(self, f.name))
            for f in dc.fields(self)
            if f.name not in ("observer", "analysis", "language", "show_total")
        }
        try:
            text = json.dumps(told, sort_keys=True, allow_nan=False, separators=(",", ":"))
        except ValueError as e:
            raise BadValue(
                f"experiment {self.name!r}: a number in its definition is not finite, which no log"
                " can have"
            ) from e
        return told | {"key": hashlib.sha256(text.encode()).hexdigest()}


def _plain(v: Any) -> Any:
    """Return the description of a value as JSON data."""
    if isinstance(v, (Scene, Block)):
        return (v if isinstance(v, Scene) else Scene({STARTS: v})).hash
    if dc.is_dataclass(v) and not isinstance(v, type):
        return {"class": type(v).__name__} | {
            f.name: _plain(getattr(v, f.name)) for f in dc.fields(v)
        }
    if isinstance(v, Mapping):
        return {str(k): _plain(w) for k, w in v.items()}
    if isinstance(v, (list, tuple)):
        return [_plain(w) for w in v]
    if isinstance(v, partial):
        return _plain({"class": "partial", "of": v.func, "args": v.args, "keywords": v.keywords})
    if callable(v):
        return f"{getattr(v, '__module__', '')}.{getattr(v, '__qualname__', type(v).__name__)}"
    if hasattr(v, "tolist"):
        return v.tolist()
    return v if isinstance(v, (str, int, float, bool, type(None))) else type(v).__name__
