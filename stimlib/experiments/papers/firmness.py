"""Discrimination of firmness: the second experiment of Çaldıran's thesis, chapter 4.

Ozan Çaldıran, "Haptic Perception of Viscoelastic Materials", Koç University; see
docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.stats import t

from ...core.graph import Block
from ...errors import one_of, public
from ...run.safety import Safety
from .. import (
    Answer,
    Effect,
    Experiment,
    OneInterval,
    Saved,
    Sequential,
    Stimulus,
    Trial,
    choice,
    columns,
    graeco_latin,
    jnd_from_dprime,
    repeated,
)
from ..tables import Columns
from ..trial import Observer
from .roughness import compared
from .springpots import (
    begun,
    cues_of_stimulus,
    cues_report,
    halves,
    place_of,
    printed,
    sensitivities,
)

REFERENCES = {"α": 0.0, "β": 0.25, "γ": 0.5, "δ": 0.75, "ε": 1.0}
"""Orders alpha of the references, section 4.1, by the letter of the square."""
SQUARE = tuple(
    " ".join("αβγδε"[greek] + "ABCDE"[latin] for greek, latin in row) for row in graeco_latin(5)
)
"""A row for each position in the order, a column for each participant; ours: the thesis
says that its square is 5 by 5 and does not print it.
"""
# increments of chi as a part of the reference's; ours: figure 4.1 shows no numbers
STEPS = 0.1, 0.2, 0.3
PAIRS = {f"{a:g} and +{100 * step:g} %": (a, step) for a in REFERENCES.values() for step in STEPS}
"""Order alpha and increment of firmness, by condition."""
WEBER = 0.12  # of the simulated participant; ours: figure 4.2 shows no numbers


@public
def firmness(starts: Block | None = None, as_printed: bool = False) -> Experiment:
    """Make the experiment: identify a stimulus as the firmer of two materials.

    There are fifteen sessions of 120 trials, one for each pair of reference and
    comparison, in the order of a Graeco-Latin square.  Both materials of a pair have
    the same order alpha.  The first ten trials of each half are for training.  The hand
    moves as it likes: unlike for bounciness, there is no cursor to follow.

    Parameters
    ----------
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
        Its ``observer`` judges the magnitude of the complex stiffness of the rendered
        force, see `person`; its ``analysis`` contains `weber_fractions` and, if trials
        were displayed, `stimlib.experiments.papers.springpots.explained`.

    References
    ----------
    Çaldıran's thesis, sections 4.1 and 4.2.  Our own choices: increments of chi, the
    square of the order of sessions, length of an exploration and of the break.

    Examples
    --------
    >>> from stimlib.experiments.papers.firmness import firmness
    >>> experiment = firmness()
    >>> for n in (1, 2, 3, 4):
    ...     design = experiment.designed("P02", n)
    ...     print(design.next(design.init(seed=1)).condition)
    0.25 and +20 %
    0.25 and +30 %
    0.25 and +10 %
    0.5 and +30 %
    """
    return Experiment(
        name="firmness",
        version="1",
        scenes={f"{alpha:g}": printed(alpha, as_printed) for alpha in REFERENCES.values()},
        design=session,
        questions=(
            choice(
                "firmer",
                "Was it the firmer one (green) or the other (red)?",
                "red",
                "green",
                keys="rg",
            ),
        ),
        fs=1000.0,
        safety=Safety(full_scale=20.0),
        **begun(starts, as_printed),
        familiarisation=known,
        sessions=15,
        instructions="Explore the material. Then say which of the two materials it was.",
        observer=person(),
        analysis=analysis,
    )


@public
def pair_of(participant: str, session: int) -> str:
    """Return the pair of reference and comparison for a session.

    The square gives the reference, and its Latin letter the order of the comparisons.

    Raises
    ------
    BadValue
        A session outside 1 to 15, or a participant code without a number.

    Examples
    --------
    >>> from stimlib.experiments.papers.firmness import pair_of
    >>> [pair_of("P01", n) for n in (1, 2, 3, 4)]
    ['0 and +10 %', '0 and +20 %', '0 and +30 %', '0.25 and +30 %']
    """
    letter, n = place_of(SQUARE, participant, session)
    return f"{REFERENCES[letter]:g} and +{100 * STEPS[n - 1]:g} %"


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
    >>> from stimlib.experiments.papers.firmness import pair_stimuli
    >>> [stimulus.params["firmness"] for stimulus in pair_stimuli("0.5 and +20 %")]
    [1.0, 1.2]
    """
    one_of("pair_stimuli: pair", pair, PAIRS)
    alpha, step = PAIRS[pair]
    return (
        Stimulus(f"{alpha:g}", {"firmness": 1.0}),
        Stimulus(f"{alpha:g}", {"firmness": 1 + step}),
    )


def session(participant: str, session: int) -> Sequential:
    """Return the design of a session."""
    pair = pair_of(participant, session)
    return halves(OneInterval(pair, "firmer", known(participant, session)))


# Who answers --------------------------------------------------------------------------
@public
def strength(alpha: float, firmness: float) -> float:
    """Return the magnitude of the complex stiffness, in N/m, of a rendered material.

    It is firmness chi_0 once the initial transient has decayed, for each alpha: the
    hand moves at the frequency at which all references are equally strong, eq. (4.1).

    Examples
    --------
    >>> from stimlib.experiments.papers.firmness import strength
    >>> round(strength(0.0, 1.2), 3)
    360.0
    """
    found = cues_of_stimulus(alpha, firmness)
    return float(np.hypot(found.k_S, found.k_L))


@public
def person(felt: Callable[[float, float], float] = strength, weber: float = WEBER) -> Observer:
    """Return a simulated participant who knows both materials and judges the strength.

    Parameters
    ----------
    felt : callable
        Function of the order alpha and the firmness of a material that returns its
        strength, in any unit.
    weber : float
        Standard deviation of the judgement, as a part of the reference's strength: the
        increment of firmness at which d' is 1.

    Returns
    -------
    callable
        An observer, which answers green if the strength is nearer to the comparison's.

    Examples
    --------
    See :doc:`/reference/experiments_firmness`.
    """

    def answers(trial: Trial, rng: np.random.Generator) -> Answer:
        alpha, step = PAIRS[trial.condition]
        reference, comparison = felt(alpha, 1.0), felt(alpha, 1 + step)
        judged = felt(alpha, trial.stimuli[0].params["firmness"])
        judged += weber * reference * rng.normal()
        return Answer({"firmer": "green" if judged > (reference + comparison) / 2 else "red"})

    return answers


# What they answered -------------------------------------------------------------------
@dataclass(frozen=True)
class WeberFractions:
    """The main result of chapter 4, figure 4.2.

    Attributes
    ----------
    d : dict of (participant, reference) to tuple of float
        d' of the three comparisons.
    people : dict of (participant, reference) to float
        Weber fraction of each participant; nan where d' does not rise with firmness.
    group : dict of float to (float, float, float)
        By reference: one over the mean of all slopes d'/increment, and the 95 %
        interval of t over the participants' slopes; nan for one participant, and
        infinite where slopes down to 0 are within it.
    effect : Effect or None
        Repeated-measures analysis of variance of the participants' fractions over the
        references; None for one participant, where somebody has no fraction, and where
        all people differ alike.
    pairs : dict of (float, float) to float
        By two references: p of the paired t test of the participants' fractions,
        multiplied by 10 (Bonferroni), at most 1; nan where all people differ alike, as
        those who make no error; empty where there is one, or somebody has no fraction.
    """

    d: Mapping[tuple[str, float], tuple[float, ...]]
    people: Mapping[tuple[str, float], float]
    group: Mapping[float, tuple[float, float, float]]
    effect: Effect | None
    pairs: Mapping[tuple[float, float], float]


@public
def weber_fractions(answers: Columns) -> WeberFractions:
    """Return d' of each pair, and the Weber fractions with their analysis of variance.

    Parameters
    ----------
    answers : dict of str to sequence
        As `stimlib.experiments.reader.columns` or
        `stimlib.experiments.observers.simulate` gives them: without training.

    Returns
    -------
    WeberFractions

    Raises
    ------
    BadValue
        A session is missing: all need all fifteen.

    References
    ----------
    Çaldıran's thesis, sections 3.7 and 4.2.

    Examples
    --------
    See :doc:`/reference/experiments_firmness`.
    """
    d = sensitivities(list(PAIRS), answers)
    names = list(dict.fromkeys(who for who, _ in d))
    fractions = {key: jnd_from_dprime(d[key], STEPS) for key in d}
    group = {}
    for a in REFERENCES.values():
        slopes = [float(np.mean(np.divide(d[who, a], STEPS))) for who in names]
        mean, half = float(np.mean(slopes)), float("nan")
        if len(names) > 1:
            error = float(np.std(slopes, ddof=1)) / len(names) ** 0.5
            half = float(t.ppf(0.975, len(names) - 1)) * error
        low, high = (float("inf") if v <= 0 else 1 / v for v in (mean + half, mean - half))
        group[a] = jnd_from_dprime([d[who, a] for who in names], STEPS), low, high
    table = [[fractions[who, a] for a in REFERENCES.values()] for who in names]
    measured = len(names) > 1 and np.isfinite(table).all()
    differ = measured and np.ptp(np.subtract(table, table[0]), axis=1).max() > 1e-12
    effect = repeated(table, ["alpha"])[0] if differ else None
    columns = zip(REFERENCES.values(), np.transpose(table), strict=True)
    pairs = {
        (a, b): float(np.minimum(1.0, 10 * compared(one, other).p))
        for (a, one), (b, other) in combinations(columns, 2)
        if measured
    }
    return WeberFractions(d, fractions, group, effect, pairs)


def text(found: WeberFractions) -> str:
    """Return the result as lines of text, next to what the thesis prints.

    Examples
    --------
    See :doc:`/reference/experiments_firmness`.
    """
    lines = []
    for a, (mean, low, high) in found.group.items():
        interval = f", 95 % {100 * low:.1f} to {100 * high:.1f} %" if low == low else ""
        lines.append(f"alpha = {a:<4g}  Weber fraction {100 * mean:.1f} %{interval}")
    if found.effect:
        one, other = found.effect.df
        lines.append(
            f"F({one:g}, {other:g}) = {found.effect.F:.3f}, p = {found.effect.p:.4f}  thesis: F(4,"
            " 16), p = 0.3981"
        )
    pairs = (
        f"{a:g} and {b:g}: p = {p:.3f} (paired t, Bonferroni)  thesis: p > .5"
        for (a, b), p in found.pairs.items()
    )
    return "\n".join([*lines, *pairs])


@public
def analysis(sessions: Sequence[Saved]) -> str:
    """Analyse the Weber fractions, and the physical cues.

    The analysis of cues requires a log of every trial.
    """
    return f"{text(weber_fractions(columns(sessions)))}\n{cues_report(sessions)}"
