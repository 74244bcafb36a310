"""Designs: which trial comes next.

Each is a value with ``init``, ``next`` and ``update``, pure functions over JSON data.

Whatever is put in a random order is sorted by a draw of its own: one more condition,
track or part changes no other draw and no other order.
"""

from __future__ import annotations

import dataclasses as dc
import math
import re
from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any, Literal

import numpy as np

from ..errors import BadValue, Count, counted, need, public, shortened
from ..system.fields import number
from .random_streams import seed_of, stream
from .tasks import Task
from .trial import Answer, Design, State, Trial, due, outcome


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

    Raises
    ------
    BadValue
        A name that is there twice.

    Examples
    --------
    >>> from stimlib.experiments import shuffled
    >>> shuffled(1, "parts", ["a", "b", "c", "d"])
    ['b', 'a', 'c', 'd']
    >>> shuffled(1, "parts", ["a", "b", "c", "d", "e"])
    ['e', 'b', 'a', 'c', 'd']
    """
    if len(set(names)) < len(names):  # those of one name would always be neighbours
        raise BadValue(f"shuffled: names = {shortened(names)}: each must be there once")
    return sorted(names, key=lambda name: stream(seed, purpose, name).random())


@public
def turn_of(participant: str, turns: Count) -> int:
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


def reach_of(*designs: Design) -> list[tuple[Task, Any]]:
    """Return the tasks of designs, each with the levels that bound those of its trials.

    A design of your own states them as ``reach``.
    """
    return [pair for d in designs for pair in getattr(d, "reach", ())]


def _counts(v: Any) -> bool:
    """Return whether a value is a whole number from 1 on."""
    return isinstance(v, Integral) and not isinstance(v, bool) and int(v) >= 1


def trials_of(*designs: Design) -> int | None:
    """Return the number of trials of designs, or None if it depends on the answers.

    A design of your own states it as ``trials``.
    """
    counts: list[Any] = [
        None if getattr(d, "precision", None) else getattr(d, "trials", None) for d in designs
    ]
    return sum(counts) if all(isinstance(n, int) for n in counts) else None


def _first_run(p: float, up: int, down: int) -> float:
    """Return how likely ``down`` outcomes of 1 in a row come before ``up`` of 0."""
    ones, zeros = p ** (down - 1), (1 - p) ** (up - 1)
    # both are 0 of runs of thousands alone
    return ones * (1 - (1 - p) * zeros) / ((ones + zeros - ones * zeros) or math.inf)


# by type of step: the unit, the largest, how many are a factor of 10, and good ones
_STEPS = {
    "db": ("dB", 200.0, 20.0, (12.0, 3.0)),
    "log": ("log10 units", 10.0, 1.0, (0.6, 0.15)),
    "lin": ("units of the level", math.inf, 0.0, ()),
}


@public
@dc.dataclass(frozen=True)
class Staircase:
    """A transformed or weighted up-down staircase.

    Sources: Levitt 1971, J. Acoust. Soc. Am. 49, 467-477; Kaernbach 1991, Perception &
    Psychophysics 49, 227-229.

    An outcome of 1 lowers the level once there were ``down`` of them in a row, 0 raises
    it after ``up``.  In a detection outcome 1 is a correct answer; in a comparison it
    is "the comparison has more", correct above the standard and wrong below it.
    Until the first reversal one answer is enough, unless ``initial_rule`` is False.
    Without a target the levels are those of PsychoPy's ``StairHandler`` with
    ``stepType`` as ``step_type``.

    Parameters
    ----------
    task : Task
        Of outcomes 0 and 1.
    start : float or (float, float)
        The first level, or between which two it is drawn.
    bounds : (float, float)
        Levels that are never passed; a step that would pass them ends on them.  Above 0
        unless steps are linear.
    steps : tuple of float
        The step after k reversals is ``steps[k]``, or the last.  By default 12 dB until
        five reversals, then 3 dB, as in the UGrip paper, section 2.2.
    reversals : int or None
        It ends with this reversal; None: after ``max_trials`` alone.
    up, down : int
        With ``up=1`` it settles where outcome 1 has the probability 0.5 ** (1 / down):
        0.5, 0.707, 0.794 for 1, 2, 3.
    max_trials : int
        Trials after which it ends in any case.
    stuck : int
        Answers in a row that ask for a level beyond the bound on which it stands, after
        which it ends: an observer whose answers are always the same would stay there.
    step_type : {"db", "log", "lin"}
        Steps multiply the level by 10^(step / 20) or by 10^step, or are added to it.
    target : float, optional
        The probability of outcome 1 at which it settles instead, such as 0.75.
        ``steps`` are then the steps down, and those up are q / (1 - q) times as large;
        q is the probability that ``down`` outcomes of 1 in a row come before ``up`` of
        0, which is the target itself for ``up=1, down=1`` (Kaernbach 1991).
    initial_rule : bool
        Whether one answer is enough until the first reversal, as in PsychoPy. It saves
        trials where the start is far above the threshold; where half of all guesses
        are right, lucky ones take the level too far down at first.

    Raises
    ------
    BadValue
        The start violates the bounds; a level that is not above 0 where steps multiply;
        steps or numbers that are none; a rule that settles at the task's chance level
        or below; a target whose steps up and down differ by more than a factor of 1000.

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

    Linear steps through 0, weighted so that the staircase settles where 75 % of the
    outcomes are 1; the simulated observer has that at 13.5:

    >>> from stimlib.experiments import PsychometricObserver, observed, outcome, stream
    >>> stairs = Staircase(
    ...     task,
    ...     start=60.0,
    ...     bounds=(-200.0, 200.0),
    ...     steps=(12.0, 6.0, 3.0),
    ...     reversals=40,
    ...     step_type="lin",
    ...     target=0.75,
    ... )
    >>> answers = {"level": [], "outcome": []}
    >>> observer = PsychometricObserver(0.0, 20.0)
    >>> for trial, answer in observed(stairs, 1, observer, stream(2, "observer")):
    ...     answers["level"].append(trial.level)
    ...     answers["outcome"].append(outcome(trial, answer))
    >>> min(answers["level"])
    -12.0
    >>> found = stairs.estimate(answers)
    >>> print(f"{found['level']:.1f} +- {found['error']:.1f}")
    12.6 +- 3.4
    """

    task: Task
    start: float | tuple[float, float]
    bounds: tuple[float, float]
    steps: tuple[float, ...] = (12.0, 12.0, 12.0, 12.0, 12.0, 3.0)
    reversals: int | None = 20
    up: int = 1
    down: int = 1
    max_trials: int = 1000
    stuck: int = 20
    step_type: Literal["db", "log", "lin"] = "db"
    target: float | None = None
    initial_rule: bool = True

    def __post_init__(self):
        if not all(
            isinstance(v, tuple) and len(v) == 2 and all(map(number, v))
            for v in (self.bounds, self._start)
        ):
            raise BadValue(
                f"Staircase: bounds = {self.bounds!r} and start = {self.start!r} must be numbers,"
                " or (low, high)"
            )
        (low, high), (least, largest) = self.bounds, self._start
        unit, most, _, such = _STEPS[self.step_type]
        linear = self.step_type == "lin"
        if not low < high or (low <= 0 and not linear):
            raise BadValue(
                f"Staircase: bounds = {self.bounds} must rise"
                + ("" if linear else f" from a level above 0: steps are in {unit}; steps that are")
                + ("" if linear else " added (step_type='lin') take levels of 0 and below")
            )
        if not low <= least <= largest <= high:
            raise BadValue(
                f"Staircase: start = {self.start} violates the bounds, {low:g} to {high:g};"
                " start within them, or widen them"
            )
        for name in ("reversals", "up", "down", "max_trials", "stuck"):
            if not _counts(v := getattr(self, name)) and (name, v) != ("reversals", None):
                raise BadValue(f"Staircase: {name} = {v!r} must be a whole number from 1 on")
        if self.target is not None and not (0 < self.target < 1 and 1e-3 <= self._ratio <= 1e3):
            raise BadValue(
                f"Staircase: target = {self.target!r} with up = {self.up} and down = {self.down}"
                " must be a probability between 0 and 1 for which steps up and down differ by at"
                " most a factor of 1000; give one such as 0.75, with up=1 and down=1"
            )
        most, such = (high - low, ((high - low) / 8, (high - low) / 32)) if linear else (most, such)
        if (
            not isinstance(self.steps, (tuple, list))
            or not self.steps
            or not all(number(s) and 0 < s * max(self._ratio, 1.0) <= most for s in self.steps)
            or (self.step_type != "db" and self.steps == Staircase.steps)
        ):
            raise BadValue(
                f"Staircase: steps = {self.steps!r} must be {unit} above 0, up and down at most"
                f" {most:g}, such as {such}"
            )
        if not hasattr(self.task, "trial"):
            raise BadValue(
                f"Staircase: task = {self.task!r:.80} makes no trials; give a task such as"
                " TwoInterval"
            )
        chance = getattr(self.task, "chance", None) or 0.0
        if _first_run(chance, self.up, self.down) >= self._ratio / (1 + self._ratio):
            raise BadValue(
                f"Staircase: up = {self.up}, down = {self.down} and target = {self.target} settle"
                f" at or below {chance:.3g}, the chance level of this task; give down=3, which"
                " settles at 79.4 %, or a target above chance"
            )

    @property
    def reach(self) -> list[tuple[Task, float]]:
        """The levels between which all trials are, with the task."""
        return [(self.task, level) for level in self.bounds]

    @property
    def _start(self) -> tuple[float, float]:
        return self.start if isinstance(self.start, tuple) else (self.start, self.start)

    @property
    def _ratio(self) -> float:
        """How many times as large as steps down those up are."""
        if self.target is None:
            return 1.0
        q = _first_run(self.target, self.up, self.down)
        return q / (1 - q) if q < 1 else math.inf

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
            "reversals": [],
            "still": 0,
        }

    def next(self, state: State) -> Trial | None:
        """Return the trial at the present level."""
        if (
            len(state["reversals"]) >= (self.reversals or math.inf)
            or state["n"] >= self.max_trials
            or state["still"] >= self.stuck
        ):
            return None
        return dc.replace(
            self.task.trial(state["level"], state["seed"], state["n"]), wanted=state["wanted"]
        )

    def update(self, state: State, answer: Answer) -> State:
        """Count the answer, and step when enough answers agree."""
        return self._after(state, outcome(due(self, state, state["n"]), answer) > 0.5)

    def _after(self, state: State, more: bool) -> State:
        """Return the state after an outcome, whatever the task is."""
        run = max(state["run"], 0) + 1 if more else min(state["run"], 0) - 1
        # one answer is enough until the first reversal, and for that one
        first = self.initial_rule and not state["reversals"]
        way = (
            -1
            if run >= (1 if first else self.down)
            else 1
            if -run >= (1 if first else self.up)
            else 0
        )
        turned = way != 0 and state["way"] == -way
        reversals = state["reversals"] + [state["level"]] * turned
        wanted = state["level"]
        if way:
            step = way * self.steps[min(len(reversals), len(self.steps) - 1)]
            step *= self._ratio if way > 0 else 1.0
            tenfold = _STEPS[self.step_type][2]
            wanted = wanted * 10.0 ** (step / tenfold) if tenfold else wanted + step
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

    def estimate(
        self, answers: Mapping[str, Sequence[float]], last: int | None = None
    ) -> dict[str, Any]:
        """Return the mean level of the staircase's last reversals.

        It assumes no curve. `stimlib.experiments.fits.psychometric` fits one to all
        answers.

        Parameters
        ----------
        answers : dict of str to sequence of float
            ``level`` and ``outcome`` of one track, in order, such as `grouped` returns.
        last : int, optional
            How many reversals, an even number; fewer where there are fewer. By default
            those that the last of the steps led to.

        Returns
        -------
        dict
            ``level``: the mean, geometric where steps multiply; ``error``: its standard
            error in the unit of the steps (dB, log10 units, or that of the levels);
            ``reversals``: how many were used. Without two reversals the level is nan,
            without four the error.  ``problem``: "" or a name in
            `stimlib.experiments.likelihood.PROBLEMS`: "edge" if the staircase ended on
            a bound, or more than a quarter of these reversals are on bounds, so that
            the true level may be beyond; "few" without a level.

        Raises
        ------
        BadValue
            Levels that are not those of this staircase; outcomes other than 0 and 1; an
            odd ``last``.
        UnknownName
            No level or outcome.

        Notes
        -----
        The mean is over pairs, a peak and the valley next to it (Wetherill & Levitt
        1965, British Journal of Mathematical and Statistical Psychology 18, 1-10).  Its
        error allows for the correlation rho of successive pairs: a variance larger by
        the factor (1 + rho) / (1 - rho).  In 600 simulated staircases of each rule (50,
        70.7, 79.4 and 75 %), with steps of a quarter and half of the observer's sigma,
        it was 0.97 to 1.04 times the true one with 40 reversals, 0.83 to 0.98 with 20,
        and 0.73 to 0.94 with 14; without rho 0.48 to 0.79.

        Where steps down and up differ, the mean lies beyond the target by an amount
        that grows with the steps: for 75 % and steps down of 0.25, 0.1 and 0.05 sigma
        of a cumulative normal, at 78.2, 76.3 and 75.6 %.  With equal steps of 0.25
        sigma it lies at 50.0, 70.8 and 79.5 %.
        """
        need("Staircase.estimate", ("level", "outcome"), answers)
        try:
            rows = np.array([answers["level"], answers["outcome"]], float)
        except (TypeError, ValueError):
            rows = np.array(math.nan)
        if rows.ndim != 2 or not np.isfinite(rows).all() or not np.isin(rows[1], (0, 1)).all():
            raise BadValue(
                "Staircase.estimate: level and outcome must be two rows of finite numbers, equally"
                " long, and outcomes 0 or 1; give the trials of one track"
            )
        if last is not None and (not _counts(last) or last % 2):
            raise BadValue(f"Staircase.estimate: last = {last!r} must be an even number from 2 on")
        # of a file of few digits; levels that are multiplied may be far below the range
        near = 1e-9 * (self.bounds[1] - self.bounds[0]) * (self.step_type == "lin")
        for bound in self.bounds:
            rows[0, np.isclose(rows[0], bound, rtol=1e-9, atol=near)] = bound
        state = self.init(0) | {"level": rows[0, 0] if rows.size else 0.0}
        for level, result in rows.T.tolist():
            if not math.isclose(level, state["level"], rel_tol=1e-9, abs_tol=near):
                raise BadValue(
                    f"Staircase.estimate: trial {state['n'] + 1} has the level {level:g}, where"
                    f" this staircase goes on with {state['level']:g}; give the trials of one track"
                    " in their order, to the staircase that asked for them"
                )
            state = self._after(state | {"level": level}, result > 0.5)
        turns = np.array(state["reversals"])
        use = min(last, len(turns)) if last else max(len(turns) - len(self.steps) + 1, 0)
        tenfold = _STEPS[self.step_type][2]
        used = turns[len(turns) - use // 2 * 2 :]
        pairs = (np.log10(used) if tenfold else used).reshape(-1, 2).mean(1)
        n, mean, error = len(pairs), float(pairs.mean()) if pairs.size else math.nan, math.nan
        if n > 1:
            off = pairs - mean
            rho = min(max(float(off[1:] @ off[:-1] / (off @ off or 1.0)), 0.0), 0.9)
            error = math.sqrt(off @ off / (n * (n - 1)) * (1 + rho) / (1 - rho))
        edge = state["still"] >= self.stuck or np.isin(used, self.bounds).sum() > len(used) / 4
        return {
            "level": 10.0**mean if tenfold else mean,
            "error": error * (tenfold or 1.0),
            "reversals": len(used),
            "problem": "edge" if edge else "" if n else "few",
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
    shuffle : {"all", "each", "apart", "none"}
        All together; each repeat by itself, so that none comes before all others had
        their turn (randomised blocks); blocks of which none begins with the item that
        ended the one before; as they are listed.
    training : bool
        Discarded by the analysis.

    Raises
    ------
    BadValue
        No items, repeats below 1, an unknown shuffle, "apart" of a single item.

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
        if (
            not self.items
            or not _counts(self.repeats)
            or self.shuffle not in ("all", "each", "apart", "none")
            or (self.shuffle == "apart" and len(self.items) == 1 < self.repeats)
        ):
            raise BadValue(
                f"ConstantStimuli: repeats = {self.repeats!r}, shuffle = {self.shuffle!r}: give"
                " items (task, level), whole repeats of at least 1, shuffle one of all, each, none,"
                " or, of two items or more, apart"
            )
        if len(set(self._names)) != len(self.items):
            raise BadValue(
                f"ConstantStimuli: an item is there twice, of {self._names}; say repeats instead"
            )

    @property
    def reach(self) -> Sequence[tuple[Task, Any]]:
        """The levels, with their tasks."""
        return self.items

    @property
    def trials(self) -> int:
        """Number of trials."""
        return len(self.items) * self.repeats

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
        if self.shuffle in ("each", "apart"):
            keys.sort(key=lambda key: int(key.partition(" ")[0]))
        order, names = [number[key] for key in keys], self._names
        for at in range(len(names), len(order), len(names)) if self.shuffle == "apart" else ():
            tries = 0
            while order[at] == order[at - 1]:
                block = shuffled(seed, f"shuffle {at} again {(tries := tries + 1)}", names)
                order[at : at + len(names)] = map(names.index, block)
        return {"seed": seed, "n": 0, "order": order}

    def next(self, state: State) -> Trial | None:
        """Return the next trial of the order."""
        n = state["n"]
        if n >= len(state["order"]):
            return None
        task, level = self.items[state["order"][n]]
        return dc.replace(task.trial(level, state["seed"], n), training=self.training)

    def update(self, state: State, answer: Answer) -> State:
        """Return the state after this trial."""
        outcome(due(self, state, state["n"]), answer)
        return {**state, "n": state["n"] + 1}


@dc.dataclass(frozen=True)
class _Several:
    """A design of several designs, by name in its first field."""

    def __post_init__(self):
        owner, kind = type(self).__name__, dc.fields(self)[0].name
        if not self._designs:
            raise BadValue(f"{owner}: give at least one design, by the name of its {kind[:-1]}")

    @property
    def _designs(self) -> Mapping[str, Design]:
        return getattr(self, dc.fields(self)[0].name)

    @property
    def trials(self) -> int | None:
        """Number of trials, or None if it depends on the answers."""
        return trials_of(*self._designs.values())

    @property
    def reach(self) -> list[tuple[Task, Any]]:
        """The levels that bound those of all its designs, with their tasks."""
        return reach_of(*self._designs.values())


@public
@dc.dataclass(frozen=True)
class Interleaved(_Several):
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
        """Pass the answer to the track whose trial it answers."""
        due = self._due(state)
        if due is None:
            raise BadValue(
                f"all tracks have ended after {counted(state['n'], 'trial')}: they take no more"
                " answers"
            )
        tracks = {
            **state["tracks"],
            due[0]: self.tracks[due[0]].update(state["tracks"][due[0]], answer),
        }
        return {**state, "n": state["n"] + 1, "tracks": tracks}


@public
@dc.dataclass(frozen=True)
class Sequential(_Several):
    """Designs one after another.

    Parameters
    ----------
    parts : dict of str to Design
    pause : float
        Seconds of rest before each part but the first (the UGrip paper: 120).
    shuffle : bool
        Whether to present the parts in random order, a different one for each
        participant; otherwise they follow the order of ``parts``.

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
        """Pass the answer to the part whose trial it answers."""
        for k in state["order"]:
            if self.parts[k].next(state["parts"][k]) is not None:
                after = self.parts[k].update(state["parts"][k], answer)
                ended = self.parts[k].next(after) is None
                return {**state, "fresh": ended, "parts": {**state["parts"], k: after}}
        raise BadValue("all parts have ended: they take no more answers")
