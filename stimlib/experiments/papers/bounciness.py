"""Discrimination of bounciness: the first experiment of Çaldıran's thesis, chapter 3.

Ozan Çaldıran, "Haptic Perception of Viscoelastic Materials", Koç University; see
docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import isfinite, nan, pi
from statistics import fmean, stdev

import numpy as np

from ...analysis.physical_cues import Cues, cues
from ...core.scene import Scene
from ...errors import BadValue, public
from ...motion.generators import sinusoid
from ...run.rendering import render
from ...run.safety import Safety
from ...scenes import viscoelastic
from ..cue_distances import distances, recorded
from ..designs import ConstantStimuli, Sequential, turn_of
from ..experiment import Cursor, Experiment, Timing
from ..questions import choice
from ..reader import Saved, columns
from ..scaling import Line, jnd_from_dprime, line
from ..signal_detection import detection
from ..tables import Columns, grouped
from ..tasks import OneInterval
from ..trial import Answer, Observer, Stimulus, Trial

REFERENCES = {"β": 0.0, "γ": 0.25, "ζ": 0.5, "θ": 0.75}
ORDERS = {"A": (1, 2, 3), "B": (2, 3, 1), "C": (3, 1, 2), "D": (3, 2, 1)}
SQUARE = "βA γD ζB θC", "γB βC θA ζD", "ζC θB βD γA", "θD ζA γC βB"
"""Table 3.1: a row for each position in the order, a column for each participant."""
STEP = 0.05  # of alpha; ours: the thesis shows the increments in figure 3.1 and prints no number
PAIRS = {
    f"{a:g} and {a + n * STEP:g}": (a, a + n * STEP) for a in REFERENCES.values() for n in (1, 2, 3)
}
"""Orders alpha of the reference and of the comparison, by condition."""
# of a simulated hand that follows the reference; its amplitude is ours
HAND = {"y": sinusoid(0.01, 1.0)}


@public
def bounciness() -> Experiment:
    """Make the experiment: identify a stimulus as one of two materials.

    There are twelve sessions of 120 trials, one for each pair of reference and
    comparison, in the order of a Graeco-Latin square.  The first ten trials of each
    half are for training.

    Returns
    -------
    Experiment
        Its ``observer`` judges the phase of the rendered force, see `person`; its
        ``analysis`` contains `jnds` and, if trials were displayed, `explained`.

    References
    ----------
    Çaldıran's thesis, sections 3.1 to 3.7.  Our own choices: increments of alpha,
    amplitude of the movement, length of the break.

    Examples
    --------
    >>> from stimlib.experiments.papers.bounciness import bounciness
    >>> experiment = bounciness()
    >>> for n in (1, 2, 3, 4):
    ...     design = experiment.designed("P02", n)
    ...     print(design.next(design.init(seed=1)).condition)
    0.25 and 0.4
    0.25 and 0.35
    0.25 and 0.3
    0 and 0.15
    """
    return Experiment(
        name="bounciness",
        version="1",
        scenes={f"{alpha:g}": viscoelastic(alpha) for pair in PAIRS.values() for alpha in pair},
        design=session,
        questions=(
            choice(
                "bouncier",
                "Was it the bouncier one (red) or the other (green)?",
                "red",
                "green",
                keys="rg",
            ),
        ),
        fs=1000.0,
        safety=Safety(full_scale=20.0),
        motion=HAND,
        timing=Timing(interval=3.0),
        familiarisation=known,
        sessions=12,
        cursor=Cursor("y", 0.01, 1.0),
        instructions="Follow the cursor. Then say which of the two materials it was.",
        observer=person(),
        analysis=analysis,
    )


@public
def pair_of(participant: str, session: int) -> str:
    """Return the pair of reference and comparison for a session.

    Table 3.1 gives the reference, and its Latin letter the order of the comparisons.

    Raises
    ------
    BadValue
        A session outside 1 to 12, or a participant code without a number.

    Examples
    --------
    >>> from stimlib.experiments.papers.bounciness import pair_of
    >>> [pair_of("P01", n) for n in (1, 2, 3, 4)]
    ['0 and 0.05', '0 and 0.1', '0 and 0.15', '0.25 and 0.35']
    """
    if not 1 <= session <= 12:
        raise BadValue(
            f"bounciness: session {session}: there are 12, one for each reference and comparison"
        )
    letters = SQUARE[(session - 1) // 3].split()[turn_of(participant, 4)]
    alpha = REFERENCES[letters[0]]
    return f"{alpha:g} and {alpha + ORDERS[letters[1]][(session - 1) % 3] * STEP:g}"


def known(participant: str, session: int) -> Mapping[str, Stimulus]:
    """Return the two known stimuli of a session, under their colours."""
    reference, comparison = PAIRS[pair_of(participant, session)]
    return {"green": Stimulus(f"{comparison:g}"), "red": Stimulus(f"{reference:g}")}


def session(participant: str, session: int) -> Sequential:
    """Return the design of a session: two halves with a break between them.

    Each half has ten trials for training and 50 that count; of both, half present the
    reference.
    """
    task = OneInterval(pair_of(participant, session), "bouncier", known(participant, session))
    both = (task, "red"), (task, "green")
    half = Sequential(
        {"training": ConstantStimuli(both, 5, training=True), "test": ConstantStimuli(both, 25)}
    )
    return Sequential({"first half": half, "second half": half}, pause=60.0)


# Who answers --------------------------------------------------------------------------
JNDS = {
    0.0: 0.03,
    0.25: 0.0351,
    0.5: 0.0714,
    0.75: 0.1077,
}  # 0.1452 alpha - 0.0012, section 3.9; of a spring: ours, from fig. 3.6


@public
@cache
def phase(alpha: float) -> float:
    """Return the phase, in rad, by which the force leads the displacement.

    It is alpha pi/2 once the initial transient has decayed.

    Examples
    --------
    >>> from stimlib.experiments.papers.bounciness import phase
    >>> round(phase(0.25), 3)
    0.393
    """
    scene: Scene = viscoelastic(alpha)
    force = render(scene, HAND, 1000.0, 3.0)["force"]
    return cues(HAND["y"](np.arange(3000) / 1000.0), force, 1000.0).phi


@public
def person(felt: Callable[[float], float] = phase) -> Observer:
    """Return a simulated participant who knows both materials and judges the phase.

    Its error is the JND reported in the thesis.

    Parameters
    ----------
    felt : callable
        Function that returns the phase in rad for a material of order alpha.

    Returns
    -------
    callable
        An observer, which answers green if the phase is nearer to the comparison's.

    Examples
    --------
    See :doc:`/reference/experiments_bounciness`.
    """

    def answers(trial: Trial, rng: np.random.Generator) -> Answer:
        reference, comparison = PAIRS[trial.condition]
        error = JNDS[reference] * pi / 2 * rng.normal()
        middle = (felt(reference) + felt(comparison)) / 2
        return Answer(
            {"bouncier": "green" if felt(float(trial.stimuli[0].scene)) + error > middle else "red"}
        )

    return answers


# What they answered -------------------------------------------------------------------
@dataclass(frozen=True)
class Jnds:
    """The main result of the thesis, figure 3.6.

    Attributes
    ----------
    d : dict of (participant, reference) to tuple of float
        d' of the three comparisons.
    jnd : dict of float to float
        For each reference, one over the mean of all slopes d'/(difference of alpha).
    line : Line
        Line through the JNDs over the references above 0.
    """

    d: Mapping[tuple[str, float], tuple[float, ...]]
    jnd: Mapping[float, float]
    line: Line


@public
def jnds(answers: Columns) -> Jnds:
    """Return d' of each pair, the JND of each reference, and a line through the JNDs.

    Parameters
    ----------
    answers : dict of str to sequence
        As `stimlib.experiments.reader.columns` or
        `stimlib.experiments.observers.simulate` gives them: without training.

    Returns
    -------
    Jnds

    Raises
    ------
    BadValue
        A session is missing: all need all twelve.

    References
    ----------
    Çaldıran's thesis, section 3.7.

    Examples
    --------
    See :doc:`/reference/experiments_bounciness`.
    """
    sessions = grouped(answers, ("participant", "condition"))
    d = {(who, condition): _sensitivity(rows) for (who, condition), rows in sessions.items()}
    people = list(dict.fromkeys(who for who, _ in d))
    if missing := [(who, c) for who in people for c in PAIRS if (who, c) not in d]:
        raise BadValue(
            f"bounciness: {missing[0][0]} has no session of {missing[0][1]}: all {len(PAIRS)} are"
            " needed"
        )
    steps = [n * STEP for n in (1, 2, 3)]
    each = {
        (who, a): tuple(d[who, c] for c, (first, _) in PAIRS.items() if first == a)
        for who in people
        for a in REFERENCES.values()
    }
    jnd = {a: jnd_from_dprime([each[who, a] for who in people], steps) for a in REFERENCES.values()}
    above = [a for a in jnd if a > 0]
    return Jnds(each, jnd, line(above, [jnd[a] for a in above]))


def _sensitivity(rows: Columns) -> float:
    """Return d' for one session."""
    counts = {1.0: [0, 0], 0.0: [0, 0]}  # green, of so many; where it was green, and where red
    for level, outcome in zip(rows["level"], rows["outcome"], strict=True):
        counts[level][0] += int(outcome)
        counts[level][1] += 1
    (hits, signals), (alarms, noises) = counts[1.0], counts[0.0]
    return detection(hits, signals, alarms, noises).d


def text(found: Jnds) -> str:
    """Return the result as lines of text, next to the values that the thesis prints.

    Examples
    --------
    See :doc:`/reference/experiments_bounciness`.
    """
    lines = [f"alpha = {a:<4g}  JND {jnd:.4f}" for a, jnd in found.jnd.items()]
    fit = found.line
    lines.append(
        f"JND = {fit.slope:.4f} alpha {fit.intercept:+.4f}, R2 = {fit.r2:.3f}  thesis: 0.1452 alpha"
        " -0.0012, R2 = 0.998"
    )
    return "\n".join(lines)


# What they went by --------------------------------------------------------------------
CUES = tuple(name for name in Cues._fields if name not in ("frequency", "eta_as_printed"))
"""The fifteen cues of section 3.8, with the usual definition of the loss factor."""


@dataclass(frozen=True)
class Explained:
    """Normalised distances of physical cues compared with d', figure 3.7 of the thesis.

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
        reference = PAIRS[condition][0]
        d.setdefault(reference, []).append(_sensitivity(rows))
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
def analysis(sessions: Sequence[Saved]) -> str:
    """Analyse the just-noticeable differences, and the physical cues.

    The analysis of cues requires a log of every trial.
    """
    told = text(jnds(columns(sessions)))
    if not all(r.displayed and "log" in r.displayed[-1] for s in sessions for r in s.data):
        return (
            f"{told}\ncues: some trials have no log of what was displayed (simulate with --rendered"
            " keeps them)"
        )
    title = "normalised distance over d', mean over sessions ± standard error (sessions)"
    return f"{told}\n\n{title}\n{cues_text(explained(recorded(sessions, 'y', 'force')))}"
