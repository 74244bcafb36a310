"""Detection of nodules with a mouse, from the paper's "Single-point interaction study".

Source: Li et al. (2016).

"Evaluation of Pseudo-Haptic Interactions with Soft Objects in Virtual Environments";
see docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.scene import Scene
from ...errors import need, public
from ...motion.generators import constant_speed
from ...run.safety import Safety
from ...scenes import soft_surface
from ...soft import THIRTEEN, sides
from .. import (
    Answer,
    ConstantStimuli,
    Experiment,
    Rate,
    Saved,
    Sequential,
    Stimulus,
    Timing,
    Trial,
    choice,
    columns,
    diagnosis,
    dunn,
    elapsed_times,
    grouped,
    kruskal,
    times_text,
    turn_of,
)
from ..compare import Pair, Statistic
from ..signal_detection import Diagnosis
from ..tables import Columns

MODES = ("deformation", "cursor", "combined")
PRINTED = {
    "deformation": (72.6, 99.1, 80.8),
    "cursor": (93.7, 95.5, 94.2),
    "combined": (94.8, 100.0, 96.4),
}
"""Figure 6 and text: sensitivity, specificity and accuracy in per cent."""
COUNTS = {"deformation": (183, 111), "cursor": (236, 107), "combined": (239, 112)}
"""Counts that give these rates: nodules found of 252 (18 for each of 14 people), and
empty sides recognised as empty of 112 (8 for each).
"""
# table 2, t tests of the elapsed times; figure 7 has no numbers
TIMES = {
    "deformation and cursor": "p = 5.22e-4",
    "deformation and combined": "p = 2.85e-8",
    "cursor and combined": "p = .0481",
}
# of a simulated participant, mean and standard deviation in s; ours: they differ by
# 0.38, 0.60 and 0.23 standard deviations, which give the p of table 2
SPENT = {"deformation": (20.0, 8.0), "cursor": (17.0, 8.0), "combined": (15.2, 8.0)}
# of 14 participants; two found combined and deformation the same and better than the
# cursor, and one said only that the cursor was the quickest
PREFERRED = {"combined": 10, "deformation": 1, "cursor": 0}
SIDES = ("left", "right")
SURFACES = {
    f"{mode}, {left} and {right}": (mode, left, right) for mode in MODES for left, right in THIRTEEN
}
"""Technique, and the nodules under the left and the right side, by condition."""
# of a simulated mouse, line by line; ours
HAND = {"x": constant_speed(0.1, 0.12), "y": constant_speed(0.007, 0.12)}


@public
def nodules(self_paced: bool = True, as_printed: bool = False) -> Experiment:
    """Make the experiment: report whether a nodule is under each of two sides.

    There are thirteen surfaces with each of three techniques: depth of the cursor,
    speed of the cursor, or both.  Participants begin with different techniques.  After
    the last surface they say which technique they preferred.

    Parameters
    ----------
    self_paced : bool
        Whether a surface is there until both sides are answered, as in the paper, which
        measures this time, for 120 s at most; otherwise for 30 s.
    as_printed : bool
        Eqs. (1) and (3) to the letter, once for each frame of 30 ms
        (``soft_surface(frames=True)``); by default the laws that mean the same at every
        rate, see :doc:`/reference/blocks/soft`.

    Returns
    -------
    Experiment
        Its ``observer`` answers correctly as often as the paper's participants did, see
        `person`; its ``analysis`` is `found`, with `spent` and the preferences.

    References
    ----------
    Li et al. (2016), "Single-point interaction study", fig. 5.  Our own choices: the
    thirteen surfaces (`stimlib.soft.THIRTEEN`), the radii of the nodules, and the
    longest time, for which the paper sets no limit.

    Examples
    --------
    >>> from stimlib.experiments.papers.nodules import nodules
    >>> experiment = nodules()
    >>> for code in ("P01", "P02", "P03"):
    ...     design = experiment.designed(code)
    ...     print(design.next(design.init(seed=1)).condition)
    deformation, A1 and C1
    cursor, none and A1
    combined, none and A1
    """
    return Experiment(
        name="nodules",
        version="1",
        scenes={name: _scene(*surface, as_printed) for name, surface in SURFACES.items()},
        design=techniques,
        questions=tuple(
            choice(side, f"Is there a nodule under the {side} side?", "nodule", "none", keys="yn")
            for side in SIDES
        ),
        fs=1000.0,
        safety=Safety(full_scale={"x": 0.12, "y": 0.12, "depth": 0.05}),
        motion=HAND,
        timing=Timing(interval=120.0, until="answer") if self_paced else Timing(interval=30.0),
        instructions=(
            "Move over the surface with mouse or finger. Then say on which sides there is a nodule."
        ),
        observer=person,
        analysis=lambda sessions: "\n".join(
            [
                text(found(columns(sessions))),
                times_text(spent(columns(sessions)), TIMES, "one-sided"),
                preferences(sessions),
            ]
        ),
        after=(choice("preferred", "Which feedback did you prefer?", *MODES),),
    )


def _scene(mode: str, left: str, right: str, frames: bool) -> Scene:
    """Return the scene of the screen, with a depth of 0 if the technique shows none."""
    shown = soft_surface(mode, device="mouse", S=sides(left, right), frames=frames).outputs
    depth = shown["depth1"] if "depth1" in shown else 0.0 * shown["x1"]
    return Scene({"x": shown["x1"], "y": shown["y1"], "depth": depth})


def techniques(participant: str, session: int) -> Sequential:
    """Return a design that presents the techniques one after another.

    The order of techniques depends on the participant's number; surfaces are in random
    order.
    """
    first = turn_of(participant, 3)
    return Sequential({mode: _surfaces(mode) for mode in MODES[first:] + MODES[:first]})


def _surfaces(mode: str) -> ConstantStimuli:
    names = [name for name, (of, *_) in SURFACES.items() if of == mode]
    return ConstantStimuli(
        tuple((Rate(name, SIDES, Stimulus(name), right_answers(name)), None) for name in names)
    )


def right_answers(condition: str) -> dict[str, str]:
    """Return the right answer for each side of a surface.

    Examples
    --------
    >>> from stimlib.experiments.papers.nodules import right_answers
    >>> right_answers("cursor, A1 and none")
    {'left': 'nodule', 'right': 'none'}
    """
    return {
        side: "none" if under == "none" else "nodule"
        for side, under in zip(SIDES, SURFACES[condition][1:], strict=True)
    }


# Who answers --------------------------------------------------------------------------
@public
def person(trial: Trial, rng: np.random.Generator) -> Answer:
    """Answer a trial as a simulated participant with the paper's detection rates.

    The rates are those of nodules found, and of empty sides recognised as empty. The
    time is log-normal, see `SPENT`.
    """
    hits, rejections = COUNTS[SURFACES[trial.condition][0]]
    values = {}
    for side, under in trial.correct.items():
        says_nodule = rng.random() < (hits / 252 if under == "nodule" else 1 - rejections / 112)
        values[side] = "nodule" if says_nodule else "none"
    return Answer(values, seconds(rng, *SPENT[SURFACES[trial.condition][0]]))


def seconds(rng: np.random.Generator, mean: float, sd: float) -> float:
    """Return a log-normal time in s, from a stream beside that of the answers."""
    spread = np.log1p((sd / mean) ** 2)
    return round(float(mean * np.exp(spread**0.5 * rng.spawn(1)[0].normal() - spread / 2)), 3)


# What they answered -------------------------------------------------------------------
@dataclass(frozen=True)
class Found:
    """The result of the paper's detection experiment, figure 6 and table 1.

    Attributes
    ----------
    rates : dict of str to Diagnosis
        For each technique, sensitivity, specificity and accuracy, with Wilson intervals
        for the number of sides.
    tests : dict of str to (Statistic, tuple of Pair)
        For "Se", "Sp" and "ACC", the Kruskal-Wallis test of the participants' rates,
        and Dunn's test of each pair, one-sided and multiplied by 3, as in the paper.
        There is no test if all rates are equal; a participant who has not yet felt both
        a side with a nodule and one without is in none.
    """

    rates: Mapping[str, Diagnosis]
    tests: Mapping[str, tuple[Statistic, tuple[Pair, ...]]]


@public
def found(answers: Columns) -> Found:
    """Return the detection rates and tests of each technique.

    Parameters
    ----------
    answers : dict of str to sequence
        With ``participant``, ``condition``, ``left`` and ``right``, as
        `stimlib.experiments.reader.columns` and
        `stimlib.experiments.observers.simulate` give them.

    Returns
    -------
    Found

    Raises
    ------
    UnknownName
        A column is missing.
    BadValue
        A technique of which nobody has felt a side with a nodule, or one without.

    References
    ----------
    Li et al. (2016), "Data processing methods".
    """
    need("nodules", SIDES, answers)
    people: dict[str, list[Counts]] = {mode: [] for mode in MODES}
    technique = [SURFACES[name][0] for name in answers["condition"]]
    for (_, mode), rows in grouped(
        {**answers, "technique": technique}, ("participant", "technique")
    ).items():
        people[mode].append(_counts(rows))
    totals = {mode: np.sum(counts, axis=0).tolist() for mode, counts in people.items() if counts}
    tests = {}
    for name, rate in RATES.items():
        each = {mode: [rate(*c) for c in people[mode] if c[1] and c[3]] for mode in totals}
        groups = {mode: rates for mode, rates in each.items() if rates}
        if len(groups) > 1 and len({v for rates in groups.values() for v in rates}) > 1:
            tests[name] = kruskal(groups), dunn(groups, "one-sided")
    return Found({mode: diagnosis(*counts) for mode, counts in totals.items()}, tests)


@public
def spent(answers: Columns) -> dict[str, np.ndarray]:
    """Return the times of each technique, from the surface to the last answer.

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
    Li et al. (2016), figure 7 and table 2, whose p are one-sided and multiplied by 3.
    """
    need("nodules", ("condition", "seconds"), answers)
    return elapsed_times(
        {**answers, "condition": [SURFACES[name][0] for name in answers["condition"]]}
    )


@public
def preferences(sessions: Sequence[Saved]) -> str:
    """Return how many participants preferred each technique, as a line of text.

    Parameters
    ----------
    sessions : sequence of Saved

    Examples
    --------
    >>> from stimlib.experiments.papers.nodules import preferences
    >>> preferences([])
    'preferred: combined 0 (10 of 14), deformation 0 (1 of 14), cursor 0 (0 of 14)'
    """
    said = [s.after.get("preferred") for s in sessions]
    return "preferred: " + ", ".join(
        f"{mode} {said.count(mode)} ({n} of 14)" for mode, n in PREFERRED.items()
    )


Counts = tuple[int, int, int, int]
"""Nodules found, all nodules, empty sides recognised as empty, all empty sides."""
RATES = {
    "Se": lambda hits, nodules, rejections, empty: hits / nodules,
    "Sp": lambda hits, nodules, rejections, empty: rejections / empty,
    "ACC": lambda hits, nodules, rejections, empty: (hits + rejections) / (nodules + empty),
}


def _counts(rows: Columns) -> Counts:
    said = [
        (right_answers(name)[side], rows[side][k])
        for k, name in enumerate(rows["condition"])
        for side in SIDES
    ]
    hits, rejections = said.count(("nodule", "nodule")), said.count(("none", "none"))
    nodules = sum(right == "nodule" for right, _ in said)
    return hits, nodules, rejections, len(said) - nodules


def text(result: Found) -> str:
    """Return the rates and tests as lines of text.

    The paper's values are printed next to them.
    """
    lines = []
    for mode, rates in result.rates.items():
        three = (rates.sensitivity, rates.specificity, rates.accuracy)
        told = "  ".join(
            f"{name} {100 * p.value:.1f} % [{100 * p.low:.1f}, {100 * p.high:.1f}] ({printed})"
            for name, p, printed in zip(RATES, three, PRINTED[mode], strict=True)
        )
        lines.append(f"{mode:<11}  {told}")
    for name, (test, pairs) in result.tests.items():
        lines.append(f"{name}: H({test.df[0]:g}) = {test.value:.3f}, p = {test.p:.2g}")
        lines += [
            f"  {p.a} and {p.b}: z = {p.statistic:.3f}, p = {p.p:.2g} ({p.sides}, times 3)"
            for p in pairs
        ]
    return "\n".join(lines)
