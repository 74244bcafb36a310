"""Discrimination of bounciness: the first experiment of Çaldıran's thesis, chapter 3.

Ozan Çaldıran, "Haptic Perception of Viscoelastic Materials", Koç University; see
docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite, pi

import numpy as np

from ...core.graph import Block
from ...errors import one_of, public
from ...run.safety import Safety
from .. import (
    Answer,
    Cursor,
    Experiment,
    OneInterval,
    Roved,
    Saved,
    Sequential,
    Stimulus,
    Trial,
    choice,
    columns,
    jnd_from_dprime,
    line,
)
from ..scaling import Line
from ..tables import Columns
from ..tasks import Task
from ..trial import Observer
from .springpots import (
    begun,
    cues_of_stimulus,
    cues_report,
    halves,
    place_of,
    printed,
    sensitivities,
)

REFERENCES = {"β": 0.0, "γ": 0.25, "ζ": 0.5, "θ": 0.75}
SQUARE = "βA γD ζB θC", "γB βC θA ζD", "ζC θB βD γA", "θD ζA γC βB"
"""Table 3.1: a row for each position in the order, a column for each participant."""
STEP = 0.05  # of alpha; ours: the thesis shows the increments in figure 3.1 and prints no number
PAIRS = {
    f"{a:g} and {a + n * STEP:g}": (a, a + n * STEP) for a in REFERENCES.values() for n in (1, 2, 3)
}
"""Orders alpha of the reference and of the comparison, by condition."""


@public
def bounciness(
    rove: float = 0.0, starts: Block | None = None, as_printed: bool = False
) -> Experiment:
    """Make the experiment: identify a stimulus as one of two materials.

    There are twelve sessions of 120 trials, one for each pair of reference and
    comparison, in the order of a Graeco-Latin square.  The first ten trials of each
    half are for training.

    Parameters
    ----------
    rove : float
        Firmness roves: in each trial it is multiplied by a factor between 1/(1 + rove)
        and 1 + rove, so that the strength of the force does not reveal the material.
        0, the thesis' way, keeps it.
    starts : Block, optional
        Condition on ``y`` that begins the exploration, see
        `stimlib.experiments.Timing`, within 10 s; `springpots.touched` is the thesis'
        half a second of contact.  None: it begins at once.
    as_printed : bool
        The thesis' procedure where its text differs from the law: the derivative from
        100 points of the history (section 3.4, ``scheme="gl-downsampled"``), and an
        exploration that begins after half a second of contact (section 3.5).  A
        movement that does not begin at y = 0 has no jump of force: y counts as held at
        its first value before, and the force begins at 0, as without it; where that
        value is above 0, the half second of contact begins there.

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
        scenes={
            f"{alpha:g}": printed(alpha, as_printed) for pair in PAIRS.values() for alpha in pair
        },
        design=partial(session, rove=rove) if rove else session,
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
        **begun(starts, as_printed),
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
    letter, n = place_of(SQUARE, participant, session)
    alpha = REFERENCES[letter]
    return f"{alpha:g} and {alpha + n * STEP:g}"


def known(participant: str, session: int) -> Mapping[str, Stimulus]:
    """Return the two known stimuli of a session, under their colours."""
    red, green = pair_stimuli(pair_of(participant, session))
    return {"green": green, "red": red}


@public
def pair_stimuli(pair: str) -> tuple[Stimulus, Stimulus]:
    """Return reference and comparison of a condition, for `by_cues`.

    Raises
    ------
    BadValue
        No such condition.

    Examples
    --------
    >>> from stimlib.experiments.papers.bounciness import pair_stimuli
    >>> [stimulus.scene for stimulus in pair_stimuli("0.25 and 0.3")]
    ['0.25', '0.3']
    """
    one_of("pair_stimuli: pair", pair, PAIRS)
    reference, comparison = PAIRS[pair]
    return (
        Stimulus(f"{reference:g}", {"firmness": 1.0}),
        Stimulus(f"{comparison:g}", {"firmness": 1.0}),
    )


def session(participant: str, session: int, rove: float = 0.0) -> Sequential:
    """Return the design of a session."""
    pair = pair_of(participant, session)
    task: Task = OneInterval(pair, "bouncier", known(participant, session))
    return halves(Roved(task, "firmness", 1 + rove) if rove else task)


# Who answers --------------------------------------------------------------------------
JNDS = {
    0.0: 0.03,
    0.25: 0.0351,
    0.5: 0.0714,
    0.75: 0.1077,
}  # 0.1452 alpha - 0.0012, section 3.9; of a spring: ours, from fig. 3.6


@public
def phase(alpha: float) -> float:
    """Return the phase, in rad, by which the force leads the displacement.

    It is alpha pi/2 once the initial transient has decayed.

    Examples
    --------
    >>> from stimlib.experiments.papers.bounciness import phase
    >>> round(phase(0.25), 3)
    0.393
    """
    return cues_of_stimulus(alpha, 1.0).phi


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
    line : Line or None
        Line through the JNDs over the references above 0; None where one of them is
        nan, because d' does not rise.
    """

    d: Mapping[tuple[str, float], tuple[float, ...]]
    jnd: Mapping[float, float]
    line: Line | None


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
    each = sensitivities(list(PAIRS), answers)
    people = list(dict.fromkeys(who for who, _ in each))
    steps = [n * STEP for n in (1, 2, 3)]
    jnd = {a: jnd_from_dprime([each[who, a] for who in people], steps) for a in REFERENCES.values()}
    above = {a: v for a, v in jnd.items() if a > 0}
    known = all(map(isfinite, above.values()))
    return Jnds(each, jnd, line([*above], [*above.values()]) if known else None)


def text(found: Jnds) -> str:
    """Return the result as lines of text, next to the values that the thesis prints.

    Examples
    --------
    See :doc:`/reference/experiments_bounciness`.
    """
    lines = [f"alpha = {a:<4g}  JND {jnd:.4f}" for a, jnd in found.jnd.items()]
    if fit := found.line:
        lines.append(
            f"JND = {fit.slope:.4f} alpha {fit.intercept:+.4f}, R2 = {fit.r2:.3f}  thesis: 0.1452"
            " alpha -0.0012, R2 = 0.998"
        )
    return "\n".join(lines)


@public
def analysis(sessions: Sequence[Saved]) -> str:
    """Analyse the just-noticeable differences, and the physical cues.

    The analysis of cues requires a log of every trial.
    """
    return f"{text(jnds(columns(sessions)))}\n{cues_report(sessions)}"
