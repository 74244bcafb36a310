"""Discrimination between two springpots: the methods of both of Çaldıran's experiments.

Ozan Çaldıran, "Haptic Perception of Viscoelastic Materials", Koç University; see
docs/reference/papers.rst. A condition is named ``"<reference> and <comparison>"``; the
reference is an order alpha.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import inf, isfinite, nan
from statistics import fmean, stdev
from typing import Any

import numpy as np

from ...analysis.physical_cues import Cues, cues
from ...blocks import envelope
from ...core.graph import Block, Input, constant
from ...core.scene import Scene
from ...errors import BadValue, public
from ...motion.generators import sinusoid
from ...run.rendering import render
from ...scenes import viscoelastic
from .. import (
    Answer,
    ConstantStimuli,
    Saved,
    Sequential,
    Stimulus,
    Timing,
    Trial,
    detection,
    distances,
    grouped,
    recorded,
    stream,
    turn_of,
)
from ..tables import Columns
from ..tasks import Task
from ..trial import Observer

ORDERS = {"A": (1, 2, 3), "B": (2, 3, 1), "C": (3, 1, 2), "D": (3, 2, 1), "E": (2, 1, 3)}
"""Orders of the three comparisons, table 3.1; E is of section 4.1."""
# of a simulated hand that follows the reference; its amplitude is ours
HAND = {"y": sinusoid(0.01, 1.0)}
TOUCHING = {"y": sinusoid(0.01, 1.0, 0.01)}  # the same, between the plate and 20 mm below


@public
def touched(seconds: float = 0.5) -> Block:
    """Return the condition that the hand has been in contact for a time.

    It is for ``starts`` of both experiments: in the thesis, section 3.5, a trial begins
    after 0.5 s of contact.  The hand touches where ``y`` is above 0.

    Parameters
    ----------
    seconds : float
        Above 0.

    Examples
    --------
    >>> from stimlib.experiments.papers.firmness import firmness
    >>> from stimlib.experiments.papers.springpots import touched
    >>> firmness(starts=touched()).timing.self_paced
    True
    """
    contact = Input("y", "m") > constant(0.0, "m")
    return envelope(contact, attack=seconds, release=0.0) >= 1.0


def printed(alpha: float, as_printed: bool) -> Scene:
    """Return the scene of a material, or the one that the thesis computed (3.4)."""
    return viscoelastic(alpha, scheme="gl-downsampled" if as_printed else "gl")


def begun(starts: Block | None, as_printed: bool) -> dict[str, Any]:
    """Return times and simulated hand of trials, as printed after 0.5 s of contact."""
    starts = touched() if as_printed and starts is None else starts
    if starts is None:
        return {"timing": Timing(interval=3.0), "motion": HAND}
    return {"timing": Timing(interval=3.0, starts=starts, wait=10.0), "motion": TOUCHING}


def place_of(square: Sequence[str], participant: str, session: int) -> tuple[str, int]:
    """Return the Greek letter of a session's reference, and which comparison it has.

    A row of the square holds three sessions, a column is a participant.

    Raises
    ------
    BadValue
        A session that the square does not have, or a participant code without a number.
    """
    people = len(square[0].split())
    if not 1 <= session <= 3 * len(square):
        raise BadValue(
            f"session {session}: there are {3 * len(square)}, one for each reference and comparison"
        )
    reference, order = tuple(square[(session - 1) // 3].split()[turn_of(participant, people)])
    return reference, ORDERS[order][(session - 1) % 3]


def halves(task: Task) -> Sequential:
    """Return the design of a session: two halves with a break between them.

    Each half has ten trials for training and 50 that count; of both, half present the
    reference.
    """
    both = (task, "red"), (task, "green")
    half = Sequential(
        {"training": ConstantStimuli(both, 5, training=True), "test": ConstantStimuli(both, 25)}
    )
    return Sequential({"first half": half, "second half": half}, pause=60.0)


def reference_of(condition: str) -> float:
    """Return the order alpha of a condition's reference."""
    return float(condition.split()[0])


def sensitivities(
    conditions: Sequence[str], answers: Columns
) -> dict[tuple[str, float], tuple[float, ...]]:
    """Return, by participant and reference, d' of each comparison.

    Raises
    ------
    BadValue
        A session is missing: all need one of each condition.
    """
    sessions = grouped(answers, ("participant", "condition"))
    found: dict[tuple[str, float], tuple[float, ...]] = {}
    for who in dict.fromkeys(who for who, _ in sessions):
        for condition in conditions:
            if (who, condition) not in sessions:
                raise BadValue(
                    f"{who} has no session of {condition}: all {len(conditions)} are needed"
                )
            key = who, reference_of(condition)
            found[key] = (*found.get(key, ()), sensitivity(sessions[who, condition]))
    return found


def sensitivity(rows: Columns) -> float:
    """Return d' for one session."""
    counts = {1.0: [0, 0], 0.0: [0, 0]}  # green, of so many; where it was green, and where red
    for level, outcome in zip(rows["level"], rows["outcome"], strict=True):
        counts[level][0] += int(outcome)
        counts[level][1] += 1
    (hits, signals), (alarms, noises) = counts[1.0], counts[0.0]
    return detection(hits, signals, alarms, noises).d


# Who answers ------------------------------------------------------------------------
@cache
def cues_of_stimulus(alpha: float, firmness: float) -> Cues:
    """Return the cues of a rendered material, moved by the simulated hand."""
    force = render(viscoelastic(alpha), HAND, 1000.0, 3.0, {"firmness": firmness})["force"]
    return cues(HAND["y"](np.arange(3000) / 1000.0), force, 1000.0)


@public
def by_cues(
    question: str,
    known: Callable[[str], tuple[Stimulus, Stimulus]],
    errors: Mapping[str, float],
) -> Observer:
    """Return a simulated participant who judges by several cues of the rendering.

    Each cue is judged with an independent normal error, and the cues are weighed as is
    best for the two known materials: the answer is green if the likelihood of the
    second is larger. So d'^2 is the sum of the squares of each cue's d'.

    Parameters
    ----------
    question : str
        Name of the experiment's question.
    known : callable
        Function of the condition that returns both known materials, red and green.
    errors : dict of str to float
        Standard deviation of each cue by which it judges, in the cue's unit; see
        `stimlib.analysis.Cues`.

    Returns
    -------
    callable
        An observer.

    Raises
    ------
    BadValue
        No such cue, or an error that is not above 0.

    Examples
    --------
    >>> from stimlib.experiments.papers.bounciness import bounciness, pair_stimuli
    >>> from stimlib.experiments.papers.springpots import by_cues
    >>> observer = by_cues("bouncier", pair_stimuli, {"phi": 0.1, "k_S": 40.0})
    """
    for name, error in errors.items():
        if name not in Cues._fields or not 0 < error < inf:
            raise BadValue(
                f"by_cues: {name} = {error}; give an error above 0 for one of"
                f" {', '.join(Cues._fields)}"
            )

    def answers(trial: Trial, rng: np.random.Generator) -> Answer:
        red, green, judged = (
            cues_of_stimulus(float(s.scene), s.params["firmness"])
            for s in (*known(trial.condition), trial.stimuli[0])
        )
        evidence = 0.0
        for name, error in errors.items():
            a, b, x = (getattr(of, name) for of in (red, green, judged))
            evidence += (x + error * rng.normal() - (a + b) / 2) * (b - a) / error**2
        return Answer({question: "green" if evidence > 0 else "red"})

    return answers


@public
def varying_hand(
    pairs: Sequence[str],
    known: Callable[[str], tuple[Stimulus, Stimulus]],
    felt: Callable[[Stimulus, Cues], float],
    error: float,
    vary: float = 0.2,
    trials: int = 50,
    seed: int = 0,
) -> dict[str, list[Any]]:
    """Simulate trials in which the hand moves each time at another size and rate.

    A hand that moves alike in all trials gives each cue one value for each material,
    and `explained` then finds a ratio of 1 whatever people go by.  Here amplitude and
    frequency of a sinusoid of 10 mm and 1 Hz are drawn for each trial, and the person
    answers green where log(felt) + error N(0, 1) is above the middle between the mean
    log(felt) of both materials.

    Parameters
    ----------
    pairs : sequence of str
        Conditions.
    known : callable
        Function of a condition that returns both materials, red and green.
    felt : callable
        Function of a stimulus and of the cues of its trial that returns what the person
        goes by, above 0: ``lambda stimulus, cues: cues.f_max``.
    error : float
        Standard deviation of the judgement, of the natural logarithm.
    vary : float
        Both lie within this part of their mean; up to 0.3, for two periods in 3 s.
    trials : int
        Of each material in each condition.
    seed : int

    Returns
    -------
    dict of str to list
        Columns for `explained`.

    Raises
    ------
    BadValue
        vary not from 0 to 0.3.

    Examples
    --------
    See :doc:`/reference/experiments_firmness`.
    """
    if not 0 <= vary <= 0.3:
        raise BadValue(f"varying_hand: vary = {vary!r} must be from 0 to 0.3")
    rows: list[tuple[Any, ...]] = []
    for condition in pairs:
        rng, shown = stream(seed, "hand", condition), []
        for stimulus in known(condition) * trials:
            size, rate = rng.uniform(1 - vary, 1 + vary, 2)
            y = sinusoid(0.01 * size, rate)(np.arange(3000) / 1000.0)
            scene = viscoelastic(float(stimulus.scene))
            force = render(scene, {"y": y}, 1000.0, params=stimulus.params)["force"]
            shown.append((stimulus, cues(y, force, 1000.0)))
        logs = np.log([felt(*trial) for trial in shown])
        said = logs + error * rng.normal(size=logs.size) > logs.mean()
        rows += [
            ("P01", condition, float(k % 2), float(said[k]), *found)
            for k, (_, found) in enumerate(shown)
        ]
    names = "participant", "condition", "level", "outcome", *Cues._fields
    return dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))


# What they went by --------------------------------------------------------------------
CUES = tuple(name for name in Cues._fields if name not in ("frequency", "eta_as_printed", "k_peak"))
"""The fifteen cues of section 3.8, with the usual definition of the loss factor."""


@dataclass(frozen=True)
class Explained:
    """Normalised distances of physical cues compared with d', figures 3.7 and 4.3.

    Attributes
    ----------
    d : dict of float to float
        By reference: mean d' of the sessions.
    ratio : dict of (float, str) to (float, float, int)
        By reference and cue: mean of the sessions' normalised distances over their d',
        its standard error, and the number of sessions; in other sessions the distance
        cannot be determined, see `stimlib.experiments.cue_distances.Distance`.
    left_out : int
        Trials without cues, because the hand hardly moved; they are in none of these
        numbers.
    """

    d: Mapping[float, float]
    ratio: Mapping[tuple[float, str], tuple[float, float, int]]
    left_out: int = 0


@public
def explained(trials: Columns) -> Explained:
    """Return how well each physical cue explains the answers.

    For each session and cue, a probit model is fitted, and its distance is divided by
    the session's d'.

    Parameters
    ----------
    trials : dict of str to sequence
        As `stimlib.experiments.recorded` gives them: with the cues of each trial.

    Returns
    -------
    Explained

    Raises
    ------
    BadValue, UnknownName
        As `stimlib.experiments.cue_distances.distances`; a column is missing.

    References
    ----------
    Çaldıran's thesis, sections 3.8 and 3.9: averaged across the increments and the
    participants.

    Examples
    --------
    See :doc:`/reference/experiments_bounciness`.
    """
    moved = [k for k, frequency in enumerate(trials["frequency"]) if isfinite(frequency)]
    there = {name: [column[k] for k in moved] for name, column in trials.items()}
    d: dict[float, list[float]] = {}
    ratios: dict[tuple[float, str], list[float]] = {}
    for (_, condition), rows in grouped(there, ("participant", "condition")).items():
        reference = reference_of(condition)
        d.setdefault(reference, []).append(sensitivity(rows))
        # a force may have had no peak
        whole = {name: rows[name] for name in CUES if np.isfinite(rows[name]).all()}
        ratio = {
            found.cue: found.ratio for found in distances(whole, rows["outcome"], d[reference][-1])
        }
        for name in CUES:
            ratios.setdefault((reference, name), []).append(ratio.get(name, nan))
    return Explained(
        {a: fmean(d[a]) for a in sorted(d)},
        {key: _mean(v) for key, v in ratios.items()},
        len(trials["frequency"]) - len(moved),
    )


def _mean(values: list[float]) -> tuple[float, float, int]:
    """Return the mean of the determined values, its standard error, and their number.

    Undetermined values are ignored.
    """
    v = [value for value in values if isfinite(value)]
    return fmean(v) if v else nan, stdev(v) / len(v) ** 0.5 if len(v) > 1 else nan, len(v)


@public
def cues_text(found: Explained) -> str:
    """Return a text table with a row for each cue and a column for each reference.

    Asterisks mark the three largest values of each column, as in the thesis.

    Examples
    --------
    See :doc:`/reference/experiments_bounciness`.
    """
    table = [
        ["alpha", *(f"{a:g}" for a in found.d)],
        ["mean d'", *(f"{d:.3f}" for d in found.d.values())],
    ]
    table += [[name, *(_cell(found, a, name) for a in found.d)] for name in CUES]
    lines = ["".join(f"{cell:<20}" for cell in row).rstrip() for row in table]
    if found.left_out:
        lines.append(
            f"trials left out, because the hand moved for less than two periods: {found.left_out}"
        )
    return "\n".join(lines)


def _cell(found: Explained, reference: float, name: str) -> str:
    mean, error, n = found.ratio[reference, name]
    if not n:
        return "-"
    larger = sum(found.ratio[reference, other][0] > mean for other in CUES)
    return f"{mean:.3f}{f' ±{error:.3f}' * (n > 1)} ({n}){'*' * (larger < 3)}"


@public
def cues_report(sessions: Sequence[Saved]) -> str:
    """Return `cues_text` of sessions, or a line that says which logs are missing."""
    if not all(r.displayed and "log" in r.displayed[-1] for s in sessions for r in s.data):
        return (
            "cues: some trials have no log of what was displayed (simulate with --rendered keeps"
            " them)"
        )
    title = "normalised distance over d', mean over sessions ± standard error (sessions)"
    return f"\n{title}\n{cues_text(explained(recorded(sessions, 'y', 'force')))}"
