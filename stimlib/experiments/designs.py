"""Designs: which trial comes next.

Each is a value with ``init``, ``next`` and ``update``, pure functions over JSON data.

Whatever is put in a random order is sorted by a draw of its own: one more condition,
track or part changes no other draw and no other order.
"""

from __future__ import annotations

import dataclasses as dc
import re
from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any

from ..errors import BadValue, public
from ..system.fields import number
from .random_streams import seed_of, stream
from .tasks import Task
from .trial import Answer, Design, State, Trial, outcome


@public
def shuffled(seed: int, purpose: str, names: Sequence[str]) -> list[str]:
    """Return names in random order.

    One more name leaves the others in the order that they had.

    Parameters
    ----------
    seed : int
    purpose : str
        What the order is for.
    names : sequence of str
        Each once.

    Examples
    --------
    >>> from stimlib.experiments import shuffled
    >>> shuffled(1, "parts", ["a", "b", "c", "d"])
    ['b', 'a', 'c', 'd']
    >>> shuffled(1, "parts", ["a", "b", "c", "d", "e"])
    ['e', 'b', 'a', 'c', 'd']
    """
    return sorted(names, key=lambda name: stream(seed, purpose, name).random())


@public
def turn_of(participant: str, turns: int) -> int:
    """Return which of n orders a participant gets, from 0 on.

    It is the number at the end of the code, less 1, modulo turns.

    Raises
    ------
    BadValue
        A code without a number.

    Examples
    --------
    >>> from stimlib.experiments import turn_of
    >>> [turn_of(code, 4) for code in ("P01", "P04", "P05")]
    [0, 3, 0]
    """
    digits = re.search(r"\d+$", participant)
    if digits is None:
        raise BadValue(
            f"participant {participant!r}: the order of the square goes by the number at the end of"
            " the code, such as P07"
        )
    return (int(digits.group()) - 1) % turns


def _counts(v: Any) -> bool:
    """Return whether a value is a whole number from 1 on."""
    return isinstance(v, Integral) and not isinstance(v, bool) and int(v) >= 1


def _check_designs(what: str, designs: Any) -> None:
    """Raise unless these are designs by name."""
    if not isinstance(designs, Mapping):
        raise BadValue(
            f"{what} = {designs!r:.80} must be a dict of designs by name, such as {{'high': ..,"
            " 'low': ..}"
        )
    for name, d in designs.items():
        if not isinstance(d, Design):
            raise BadValue(
                f"{what.partition(':')[0]}: {name!r} is {d!r:.80}, no design; put a task into one,"
                " such as Staircase or ConstantStimuli"
            )


@public
@dc.dataclass(frozen=True)
class Staircase:
    """A transformed up-down staircase in dB.

    Source: Levitt 1971, J. Acoust. Soc. Am. 49, 467-477.

    An outcome of 1 ("more") lowers the level once there were ``down`` of them, 0 raises
    it after ``up``.  Until the first reversal one answer is enough.  Steps multiply by
    10^(dB/20), as those of PsychoPy's ``StairHandler`` do with ``stepType="db"``: the
    levels are the same.

    Parameters
    ----------
    task : Task
        Of outcomes 0 and 1.
    start : float or (float, float)
        The first level, or between which two it is drawn.
    bounds : (float, float)
        Levels that are never passed; a step that would pass them ends on them.
    steps : tuple of float
        dB; the one after k reversals is ``steps[k]``, or the last.  By default 12 dB
        until five reversals, then 3 dB, as in the UGrip paper, section 2.2.
    reversals : int
        It ends with this reversal.
    up, down : int
        With ``up=1`` it settles where outcome 1 has the probability 0.5 ** (1 / down):
        0.5, 0.707, 0.794 for 1, 2, 3.
    max_trials : int
        Trials after which it ends anyhow.
    stuck : int
        Answers in a row that ask for a level beyond the bound on which it stands, after
        which it ends: an observer whose answers are always the same would stay there.

    Raises
    ------
    BadValue
        The start violates the bounds; a level that is not above 0; steps or numbers
        that are none; a rule that settles at the task's chance level.

    Examples
    --------
    The staircase of the UGrip paper, of somebody who feels every difference, in units
    of k0:

    >>> from stimlib.experiments import Answer, Staircase, Stimulus, TwoInterval
    >>> task = TwoInterval(
    ...     "silent",
    ...     "softer",
    ...     Stimulus("squeeze", {"k": 1.0}),
    ...     Stimulus("squeeze"),
    ...     "k",
    ...     asks_less=True,
    ... )
    >>> stairs = Staircase(task, start=(2.0, 2.5), bounds=(0.1, 10.0))
    >>> state, levels = stairs.init(seed=1), []
    >>> while (trial := stairs.next(state)) is not None:
    ...     levels.append(round(trial.level, 2))
    ...     stiffer = next(
    ...         c for c, score in trial.scores.items() if score == (trial.level > 1.0)
    ...     )
    ...     state = stairs.update(state, Answer({"softer": stiffer}))
    >>> levels[:8], len(levels)
    ([2.05, 0.51, 2.05, 0.51, 2.05, 0.51, 0.73, 1.03], 22)
    """

    task: Task
    start: float | tuple[float, float]
    bounds: tuple[float, float]
    steps: tuple[float, ...] = (12.0, 12.0, 12.0, 12.0, 12.0, 3.0)
    reversals: int = 20
    up: int = 1
    down: int = 1
    max_trials: int = 1000
    stuck: int = 20

    def __post_init__(self):
        if not all(
            isinstance(v, tuple) and len(v) == 2 and all(map(number, v))
            for v in (self.bounds, self._start)
        ):
            raise BadValue(
                f"Staircase: bounds = {self.bounds!r} and start = {self.start!r} must be numbers,"
                " or (low, high)"
            )
        low, high = self.bounds
        least, largest = self._start
        if not (0 < low < high):
            raise BadValue(
                f"Staircase: bounds = {self.bounds} must rise from a level above 0: steps are in dB"
            )
        if not low <= least <= largest <= high:
            raise BadValue(
                f"Staircase: start = {self.start} violates the bounds, {low:g} to {high:g}"
            )
        if (
            not isinstance(self.steps, (tuple, list))
            or not self.steps
            or not all(number(s) and 0 < s < 200 for s in self.steps)
        ):
            raise BadValue(
                f"Staircase: steps = {self.steps!r} must be dB above 0, such as (12.0, 3.0)"
            )
        for name in ("reversals", "up", "down", "max_trials", "stuck"):
            if not _counts(v := getattr(self, name)):
                raise BadValue(f"Staircase: {name} = {v!r} must be a whole number from 1 on")
        if not hasattr(self.task, "trial"):
            raise BadValue(
                f"Staircase: task = {self.task!r:.80} makes no trials; give a task such as"
                " TwoInterval"
            )
        if (getattr(self.task, "chance", None) or 0.0) >= 0.5 and self.down <= self.up:
            raise BadValue(
                f"Staircase: with up = {self.up} and down = {self.down} it settles where half of"
                " the answers are right, the chance level of this task; give down=3, which settles"
                " at 79.4 %"
            )

    @property
    def _start(self) -> tuple[float, float]:
        return self.start if isinstance(self.start, tuple) else (self.start, self.start)

    def init(self, seed: int) -> State:
        """Draw the first level from the stream "start"."""
        low, high = self._start
        level = low + (high - low) * float(stream(seed, "start").random())
        return {
            "seed": seed,
            "n": 0,
            "level": level,
            "wanted": level,
            "way": 0,
            "run": 0,
            "reversals": 0,
            "still": 0,
        }

    def next(self, state: State) -> Trial | None:
        """Return the comparison at the present level."""
        if (
            state["reversals"] >= self.reversals
            or state["n"] >= self.max_trials
            or state["still"] >= self.stuck
        ):
            return None
        return dc.replace(
            self.task.trial(state["level"], state["seed"], state["n"]), wanted=state["wanted"]
        )

    def update(self, state: State, answer: Answer) -> State:
        """Count the answer, and step when enough answers agree."""
        trial = self.next(state)
        if trial is None:
            raise BadValue(
                f"the staircase has ended after {state['n']} trials: it takes no more answers"
            )
        more = outcome(trial, answer) > 0.5
        run = max(state["run"], 0) + 1 if more else min(state["run"], 0) - 1
        # one answer is enough until the first reversal, and for that one
        first = state["reversals"] == 0
        way = (
            -1
            if run >= (1 if first else self.down)
            else 1
            if -run >= (1 if first else self.up)
            else 0
        )
        turned = way != 0 and state["way"] == -way
        reversals = state["reversals"] + turned
        wanted = state["level"]
        if way:
            wanted *= 10.0 ** (way * self.steps[min(reversals, len(self.steps) - 1)] / 20.0)
        low, high = self.bounds
        level = min(max(wanted, low), high)
        return {
            **state,
            "n": state["n"] + 1,
            "level": level,
            "wanted": wanted,
            "way": way or state["way"],
            "run": 0 if way else run,
            "reversals": reversals,
            "still": (
                state["still"] + 1 if level == state["level"] == (low if more else high) else 0
            ),
        }


@public
@dc.dataclass(frozen=True)
class ConstantStimuli:
    """The method of constant stimuli: a list of trials, repeated in random order.

    It serves for constant stimuli, one-interval 2AFC, ratings and ranking.

    Parameters
    ----------
    items : tuple of (Task, level)
        The level is what the task takes: a number, the name of a stimulus, None.
    repeats : int
    shuffle : {"all", "each", "none"}
        All together; each repeat by itself, so that none comes before all others had
        their turn; as they are listed.
    training : bool
        Discarded by the analysis.

    Raises
    ------
    BadValue
        No items, repeats below 1, an unknown shuffle.

    Examples
    --------
    >>> from stimlib.experiments import Answer, ConstantStimuli, OneInterval, Stimulus
    >>> task = OneInterval(
    ...     "0.25", "bouncier", {"red": Stimulus("S1"), "green": Stimulus("S2")}
    ... )
    >>> design = ConstantStimuli(((task, "red"), (task, "green")), repeats=3)
    >>> state, shown = design.init(seed=4), []
    >>> while (trial := design.next(state)) is not None:
    ...     shown.append(trial.correct["bouncier"])
    ...     state = design.update(state, Answer({"bouncier": "red"}))
    >>> sorted(shown) == 3 * ["green"] + 3 * ["red"]
    True
    """

    items: tuple[tuple[Task, Any], ...]
    repeats: int = 1
    shuffle: str = "all"
    training: bool = False

    def __post_init__(self):
        if not isinstance(self.items, (tuple, list)) or not all(
            isinstance(i, (tuple, list)) and len(i) == 2 and hasattr(i[0], "trial")
            for i in self.items
        ):
            raise BadValue(
                f"ConstantStimuli: items = {self.items!r:.80} must be pairs (task, level), such as"
                " ((task, 1.0), (task, 2.0)); of one alone write ((task, 1.0),)"
            )
        if (
            not self.items
            or not _counts(self.repeats)
            or self.shuffle not in ("all", "each", "none")
        ):
            raise BadValue(
                f"ConstantStimuli: repeats = {self.repeats!r}, shuffle = {self.shuffle!r}: give"
                " items (task, level), whole repeats of at least 1, shuffle one of all, each, none"
            )
        if len(set(self._names)) != len(self.items):
            raise BadValue(
                f"ConstantStimuli: an item is there twice, of {self._names}; say repeats instead"
            )

    @property
    def _names(self) -> list[str]:
        return [f"{task.condition} {level!r}" for task, level in self.items]

    def init(self, seed: int) -> State:
        """Draw the whole order from the stream "shuffle"."""
        number = {
            f"{r} {name}": i for r in range(self.repeats) for i, name in enumerate(self._names)
        }
        keys = list(number)
        if self.shuffle != "none":
            keys = shuffled(seed, "shuffle", keys)
        if self.shuffle == "each":
            keys.sort(key=lambda key: int(key.partition(" ")[0]))
        return {"seed": seed, "n": 0, "order": [number[key] for key in keys]}

    def next(self, state: State) -> Trial | None:
        """Return the next trial of the order."""
        n = state["n"]
        if n >= len(state["order"]):
            return None
        task, level = self.items[state["order"][n]]
        return dc.replace(task.trial(level, state["seed"], n), training=self.training)

    def update(self, state: State, answer: Answer) -> State:
        """Return the state after this trial."""
        trial = self.next(state)
        if trial is None:
            raise BadValue(f"all {state['n']} trials are done: there are no more answers to take")
        outcome(trial, answer)
        return {**state, "n": state["n"] + 1}


@public
@dc.dataclass(frozen=True)
class Interleaved:
    """Several designs at once; each trial comes from one of them, drawn at random.

    It ends when all of them have ended.

    Parameters
    ----------
    tracks : dict of str to Design
        By the name of the track.

    Raises
    ------
    BadValue
        No track.

    Examples
    --------
    The UGrip paper: ``Interleaved({"high": Staircase(task, (2.0, 2.5), bounds), "low":
    Staircase(task, (0.4, 0.5), bounds)})``.
    """

    tracks: Mapping[str, Design]

    def __post_init__(self):
        if not self.tracks:
            raise BadValue("Interleaved: give at least one design, by the name of its track")
        _check_designs("Interleaved: tracks", self.tracks)

    def init(self, seed: int) -> State:
        """Give each track a seed of its own."""
        return {
            "seed": seed,
            "n": 0,
            "tracks": {k: d.init(seed_of(seed, "track", k)) for k, d in self.tracks.items()},
        }

    def _due(self, state: State) -> tuple[str, Trial] | None:
        waiting = {
            k: t for k, d in self.tracks.items() if (t := d.next(state["tracks"][k])) is not None
        }
        return next(
            (
                (k, waiting[k])
                for k in shuffled(state["seed"], f"interleave {state['n']}", list(waiting))
            ),
            None,
        )

    def next(self, state: State) -> Trial | None:
        """Return the trial of a track drawn from those that are not finished."""
        due = self._due(state)
        return due and dc.replace(due[1], track=f"{due[0]} {due[1].track}".rstrip())

    def update(self, state: State, answer: Answer) -> State:
        """Pass the answer to the track that asked."""
        due = self._due(state)
        if due is None:
            raise BadValue(
                f"all tracks have ended after {state['n']} trials: they take no more answers"
            )
        tracks = {
            **state["tracks"],
            due[0]: self.tracks[due[0]].update(state["tracks"][due[0]], answer),
        }
        return {**state, "n": state["n"] + 1, "tracks": tracks}


@public
@dc.dataclass(frozen=True)
class Sequential:
    """Designs one after another.

    Parameters
    ----------
    parts : dict of str to Design
    pause : float
        Seconds of rest before each part but the first (the UGrip paper: 120).
    shuffle : bool
        In random order, each participant in their own; else as they are given.

    Raises
    ------
    BadValue
        No part.

    Examples
    --------
    >>> from stimlib.experiments import ConstantStimuli, Rate, Sequential
    >>> from stimlib.experiments import Answer, Stimulus
    >>> day = lambda name: ConstantStimuli(
    ...     ((Rate(name, ("rough",), Stimulus("bumps")), None),), repeats=2
    ... )
    >>> design = Sequential({"A": day("a"), "B": day("b")}, pause=120.0, shuffle=True)
    >>> state, seen = design.init(seed=2), []
    >>> while (trial := design.next(state)) is not None:
    ...     seen.append((trial.condition, trial.pause))
    ...     state = design.update(state, Answer({"rough": 3}))
    >>> seen
    [('a', 0.0), ('a', 0.0), ('b', 120.0), ('b', 0.0)]
    """

    parts: Mapping[str, Design]
    pause: float = 0.0
    shuffle: bool = False

    def __post_init__(self):
        if not self.parts:
            raise BadValue("Sequential: give at least one design, by the name of its part")
        _check_designs("Sequential: parts", self.parts)

    def init(self, seed: int) -> State:
        """Give each part a seed of its own."""
        order = shuffled(seed, "parts", list(self.parts)) if self.shuffle else list(self.parts)
        return {
            "order": order,
            "fresh": False,
            "parts": {k: self.parts[k].init(seed_of(seed, "part", k)) for k in order},
        }

    def next(self, state: State) -> Trial | None:
        """Return the trial of the first part that is not finished."""
        for k in state["order"]:
            trial = self.parts[k].next(state["parts"][k])
            if trial is not None:
                rest = max(trial.pause, self.pause) if state["fresh"] else trial.pause
                return dc.replace(trial, track=f"{k} {trial.track}".rstrip(), pause=rest)
        return None

    def update(self, state: State, answer: Answer) -> State:
        """Pass the answer to that part."""
        for k in state["order"]:
            if self.parts[k].next(state["parts"][k]) is not None:
                after = self.parts[k].update(state["parts"][k], answer)
                ended = self.parts[k].next(after) is None
                return {**state, "fresh": ended, "parts": {**state["parts"], k: after}}
        raise BadValue("all parts have ended: they take no more answers")
