"""Localisation of nodules with a pen, with one avatar, three avatars or vibration.

Source: Li et al. (2016).

"Evaluation of Pseudo-Haptic Interactions with Soft Objects in Virtual Environments";
see docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import dist, radians

import numpy as np

from ...errors import need, public
from ...run.safety import Safety
from ...scenes import soft_surface
from ...soft import block, buried
from .. import (
    Answer,
    ConstantStimuli,
    Experiment,
    Rate,
    Sequential,
    Stimulus,
    Timing,
    Trial,
    columns,
    dunn,
    elapsed_times,
    grouped,
    kruskal,
    places,
    times_text,
    turn_of,
    wilson,
)
from ..compare import Pair, Statistic
from ..signal_detection import Proportion
from ..tables import Columns
from .nodule_sizes import PEN
from .nodules import seconds

FEEDBACK = {"single-point": "combined", "multi-point": "multipoint", "vibration": "vibration"}
"""Mode of ``soft_surface`` by the paper's name."""
TURNS = (30, 60, 90)
"""Rotations of the block in degrees (our own choice): no two have a nodule at the same
place, and none shares one with the experiment on sizes.
"""
SURFACES = {f"{name}, {turn} degrees": (name, turn) for name in FEEDBACK for turn in TURNS}
FOUND = {"single-point": 55, "multi-point": 53, "vibration": 57}
"""Nodules found of 60, three for each of 20 people: 91.7, 88.3 and 95 %."""
PRINTED = {
    "single-point": (91.7, 82.0, 96.4),
    "multi-point": (88.3, 77.8, 94.2),
    "vibration": (95.0, 91.5, 97.1),
}
"""Figure 8 and text: sensitivity and its interval, in per cent."""
# mean and standard deviation of the elapsed times in s, figure 9; tests, table 3
SPENT = {
    "single-point": (61.75, 25.1),
    "multi-point": (41.65, 19.1),
    "vibration": (33.95, 18.97),
}
TIMES = {how: f"{mean} s, SD {sd}" for how, (mean, sd) in SPENT.items()} | {
    "single-point and multi-point": "z = 2.451, p = .0214",
    "single-point and vibration": "z = 3.705, p = .0003",
    "multi-point and vibration": "z = 1.255, p = .3144",
}
NEAR = 0.01
"""Largest distance, in m, between a mark and the centre of a found nodule (our own
choice): nodules are 52 mm apart.
"""


@public
def nodule_places(as_printed: bool = False) -> Experiment:
    """Make the experiment: mark three nodules, with each of three kinds of feedback.

    Parameters
    ----------
    as_printed : bool
        Eqs. (1) and (3) to the letter, once for each frame of 30 ms
        (``soft_surface(frames=True)``); by default the laws that mean the same at every
        rate, see :doc:`/reference/blocks/soft`.

    Returns
    -------
    Experiment
        Its ``observer`` finds as many nodules as the paper's participants did, see
        `person`; its ``analysis`` is `located`, with `spent`.

    References
    ----------
    Li et al. (2016), "Single-point interaction vs. three-point interaction and
    vibration", figs. 4 and 8.  Our own choices: the map, its rotations, how near a mark
    must be (`NEAR`), and a longest time of 300 s, whereas the paper sets no limit.  The
    block is there until the answer, because the paper measures this time.

    Examples
    --------
    >>> from stimlib.experiments.papers.nodule_places import nodule_places, person
    >>> from stimlib.experiments import observed, stream
    >>> design = nodule_places().designed("P02")
    >>> [
    ...     trial.condition
    ...     for trial, _ in observed(design, 1, person, stream(1, "observer"))
    ... ]
    ['multi-point, 30 degrees', 'vibration, 60 degrees', 'single-point, 90 degrees']
    """
    sizes = {"x": 0.14, "y": 0.14, "depth": 0.02}
    return Experiment(
        name="nodule_places",
        version="1",
        scenes={
            name: soft_surface(FEEDBACK[how], S=block(radians(turn)), frames=as_printed)
            for name, (how, turn) in SURFACES.items()
        },
        design=one_after_another,
        questions=(
            places("nodules", "Where are the nodules, in m from the lower left corner?", most=3),
        ),
        fs=1000.0,
        safety=Safety(
            full_scale={f"{k}{i}": v for i in (1, 2, 3) for k, v in sizes.items()}
            | {"force": 10.0, "vibration": 1.0}
        ),
        motion=PEN,
        timing=Timing(interval=300.0, until="answer"),
        instructions=(
            "Press on the surface with the pen and go over it. Then mark where the three hard"
            " nodules are."
        ),
        observer=person,
        analysis=lambda sessions: "\n".join(
            [
                text(located(columns(sessions))),
                times_text(spent(columns(sessions)), TIMES, "one-sided"),
            ]
        ),
    )


def one_after_another(participant: str, session: int) -> Sequential:
    """Return a design that presents the kinds of feedback one after another.

    Each block of trials has a differently rotated map, and each of nine people has a
    different order.
    """
    n, names = turn_of(participant, 9), tuple(FEEDBACK)
    tests = [(names[(n + k) % 3], TURNS[(n // 3 + k) % 3]) for k in range(3)]
    return Sequential({how: _surface(f"{how}, {turn} degrees") for how, turn in tests})


def _surface(name: str) -> ConstantStimuli:
    right = [list(at) for at in _buried(name).values()]
    return ConstantStimuli(((Rate(name, ("nodules",), Stimulus(name), {"nodules": right}), None),))


def _buried(condition: str) -> dict[str, tuple[float, float]]:
    need("nodule_places", [condition], SURFACES, "surface")
    return buried(radians(SURFACES[condition][1]))


# Who answers --------------------------------------------------------------------------
@public
def person(trial: Trial, rng: np.random.Generator) -> Answer:
    """Answer a trial as a simulated participant who finds nodules at the paper's rate.

    Marks are within 2 mm of a nodule, and times are log-normal, see `SPENT`; the
    rendering is not used.
    """
    chance = FOUND[SURFACES[trial.condition][0]] / 60
    return Answer(
        {
            "nodules": [
                (at + 0.002 * rng.normal(size=2)).tolist()
                for at in trial.correct["nodules"]
                if rng.random() < chance
            ]
        },
        seconds(rng, *SPENT[SURFACES[trial.condition][0]]),
    )


# What they answered -------------------------------------------------------------------
@dataclass(frozen=True)
class Located:
    """The result of the paper's localisation experiment, figure 8.

    Attributes
    ----------
    rates : dict of str to Proportion
        For each kind of feedback, the proportion of nodules found, with Wilson's
        interval.
    nodules : dict of (str, str) to Proportion
        By feedback and nodule.
    test : Statistic or None
        Kruskal-Wallis test of how many nodules each participant found; None if all
        found equally many.
    pairs : tuple of Pair
        Dunn's test, one-sided and multiplied by 3, as in the paper.
    """

    rates: Mapping[str, Proportion]
    nodules: Mapping[tuple[str, str], Proportion]
    test: Statistic | None
    pairs: tuple[Pair, ...]


@public
def located(answers: Columns) -> Located:
    """Return how many nodules were found with each kind of feedback.

    Parameters
    ----------
    answers : dict of str to sequence
        With ``participant``, ``condition`` and ``nodules``, as
        `stimlib.experiments.reader.columns` and
        `stimlib.experiments.observers.simulate` give them.

    Returns
    -------
    Located

    Raises
    ------
    UnknownName
        A column is missing.

    References
    ----------
    Li et al. (2016), "Nodule localization", which scores one point per nodule.

    Examples
    --------
    See :doc:`/reference/experiments_nodules`.
    """
    need("nodule_places", ("participant", "condition", "nodules"), answers)
    feedback = [SURFACES[name][0] for name in answers["condition"]]
    rates: dict[str, Proportion] = {}
    each: dict[tuple[str, str], Proportion] = {}
    people: dict[str, list[int]] = {}
    groups = grouped({**answers, "feedback": feedback}, ("feedback",))
    for (how,), rows in groups.items():
        hits = [
            hit(name, marks) for name, marks in zip(rows["condition"], rows["nodules"], strict=True)
        ]
        each |= {(how, n): wilson(sum(h[n] for h in hits), len(hits)) for n in hits[0]}
        people[how] = [sum(h.values()) for h in hits]
        rates[how] = wilson(sum(people[how]), 3 * len(hits))
    spread = len(people) > 1 and len({n for counts in people.values() for n in counts}) > 1
    return Located(
        rates,
        each,
        kruskal(people) if spread else None,
        dunn(people, "one-sided") if spread else (),
    )


@public
def spent(answers: Columns) -> dict[str, np.ndarray]:
    """Return the times of each kind of feedback, from the block to the answer.

    Parameters
    ----------
    answers : dict of str to sequence
        With ``condition`` and ``seconds``.

    Raises
    ------
    UnknownName, BadValue
        As `stimlib.experiments.elapsed_times`.

    References
    ----------
    Li et al. (2016), figure 9 and table 3, whose p are one-sided and multiplied by 3.
    """
    need("nodule_places", ("condition", "seconds"), answers)
    return elapsed_times(
        {**answers, "condition": [SURFACES[name][0] for name in answers["condition"]]}
    )


@public
def hit(condition: str, marks: Sequence[tuple[float, float]]) -> dict[str, bool]:
    """Return which nodules of a surface have a mark within a distance of `NEAR`.

    Examples
    --------
    >>> from stimlib.experiments.papers.nodule_places import hit
    >>> hit("vibration, 90 degrees", [[0.03, 0.069], [0.06, 0.06]])
    {'A': True, 'B': False, 'C': False}
    """
    return {
        name: any(dist(at, mark) <= NEAR for mark in marks)
        for name, at in _buried(condition).items()
    }


def text(found: Located) -> str:
    """Return the rates and tests as lines of text.

    The paper's values are printed next to them.
    """
    lines = []
    for how, p in found.rates.items():
        value, low, high = PRINTED[how]
        each = ", ".join(
            f"{n} {100 * q.value:.0f} %" for (of, n), q in found.nodules.items() if of == how
        )
        lines.append(
            f"{how:<12}  {100 * p.value:.1f} % [{100 * p.low:.1f}, {100 * p.high:.1f}] ({value}"
            f" [{low}, {high}])  {each}"
        )
    if found.test:
        lines.append(f"H({found.test.df[0]:g}) = {found.test.value:.3f}, p = {found.test.p:.2g}")
    return "\n".join(
        [
            *lines,
            *(
                f"  {p.a} and {p.b}: z = {p.statistic:.3f}, p = {p.p:.2g} ({p.sides}, times 3)"
                for p in found.pairs
            ),
        ]
    )
