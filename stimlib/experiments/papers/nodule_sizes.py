"""Size discrimination of three nodules, felt with a pen.

Source: Li et al. (2016).

"Evaluation of Pseudo-Haptic Interactions with Soft Objects in Virtual Environments";
see docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from math import pi

import numpy as np

from ...errors import need, public
from ...run.safety import Safety
from ...scenes import soft_surface
from ...soft import block, buried
from .. import (
    Answer,
    ConstantStimuli,
    Drawing,
    Experiment,
    Rate,
    Stimulus,
    Timing,
    Trial,
    columns,
    ranking,
    turn_of,
    wilson,
)
from ..signal_detection import Proportion
from ..tables import Columns
from .nodules import HAND

NODULES = ("A", "B", "C")
"""Nodules, the hardest first."""
MARKS = ("1", "2", "3")
"""Blue dots on the surface, over the nodules: 1 straight ahead, then counter-clockwise.
"""
UNDER = {
    f"A under {MARKS[k]}": dict(zip(MARKS, NODULES[-k:] + NODULES[:-k], strict=True))
    for k in range(3)
}
"""The nodule under each mark, by condition: the block is rotated by thirds of a turn.
"""
PRINTED = {("A", "B"): 85.0, ("A", "C"): 90.0, ("B", "C"): 70.0}
"""Percentage of 20 people who put the first nodule before the second."""
PRINTED_RANK = {"A": 1.25, "B": 2.15, "C": 2.6}
ORDERS = {"ABC": 11, "ACB": 5, "BAC": 2, "BCA": 1, "CAB": 1}
"""One of six sets of orders of 20 people that give the printed rates."""


def held(t):
    """Return half the force level that a pen can report, 0.83 N (our own choice)."""
    return 0.5 + 0.0 * t


PEN = HAND | {"press": held}  # of a simulated pen; ours


@public
def nodule_sizes(mode: str = "combined", as_printed: bool = False) -> Experiment:
    """Make the experiment: sort three marked places, the hardest first.

    There is one trial for each participant.

    Parameters
    ----------
    mode : str
        What tells of the stiffness, of a pen with one avatar: see
        `stimlib.scenes.soft_surface`.  "combined" is the paper's; whether "vibration"
        tells of size is its future work.
    as_printed : bool
        Eqs. (1) and (3) to the letter, once for each frame of 30 ms
        (``soft_surface(frames=True)``); by default the laws that mean the same at every
        rate, see :doc:`/reference/blocks/soft`.

    Returns
    -------
    Experiment
        Its ``observer`` draws each order as often as the paper's participants may have
        given it, see `person`; its ``analysis`` is `sorted_rightly`.

    References
    ----------
    Li et al. (2016), "Single-point interaction study", second part.  Our own choices:
    the map (`stimlib.soft.block`), which the paper measured, the mark of each nodule,
    and a longest time of 180 s, whereas the paper sets no limit.  The block is there
    until the answer, because the paper records the elapsed time.

    Examples
    --------
    >>> from stimlib.experiments.papers.nodule_sizes import nodule_sizes
    >>> experiment = nodule_sizes()
    >>> for code in ("P01", "P02"):
    ...     design = experiment.designed(code)
    ...     print(design.next(design.init(seed=1)).correct)
    {'order': ['1', '2', '3']}
    {'order': ['2', '3', '1']}
    """
    sizes = {"x1": 0.14, "y1": 0.14, "depth1": 0.02, "force": 10.0, "vibration": 1.0}
    scenes = {
        name: soft_surface(mode, S=block(k * 2 * pi / 3), frames=as_printed)
        for k, name in enumerate(UNDER)
    }
    shown = next(iter(scenes.values())).outputs
    return Experiment(
        name="nodule_sizes",
        version="1",
        scenes=scenes,
        design=surface_of,
        questions=(ranking("order", "Which place is the hardest? The hardest first", *MARKS),),
        fs=1000.0,
        safety=Safety(full_scale={name: sizes[name] for name in shown}),
        motion=PEN,
        timing=Timing(interval=180.0, until="answer"),
        drawing=Drawing(marks=dict(zip(MARKS, buried().values(), strict=True))),
        instructions=(
            "Three places are marked, 1 straight ahead, then against the clock. Press on them, then"
            " sort them."
        ),
        observer=person,
        analysis=lambda sessions: text(sorted_rightly(columns(sessions))),
    )


def surface_of(participant: str, session: int) -> ConstantStimuli:
    """Return a design with one surface, chosen by the participant's number."""
    name = tuple(UNDER)[turn_of(participant, 3)]
    mark_of = {nodule: mark for mark, nodule in UNDER[name].items()}
    return ConstantStimuli(
        ((Rate(name, ("order",), Stimulus(name), {"order": [mark_of[n] for n in NODULES]}), None),)
    )


# Who answers --------------------------------------------------------------------------
@public
def person(trial: Trial, rng: np.random.Generator) -> Answer:
    """Answer a trial as a simulated participant who sorts as in the paper.

    See `ORDERS`; the rendering is not used.
    """
    order = rng.choice(list(ORDERS), p=np.array(list(ORDERS.values())) / sum(ORDERS.values()))
    mark_of = {nodule: mark for mark, nodule in UNDER[trial.condition].items()}
    return Answer({"order": [mark_of[n] for n in order]})


# What they answered -------------------------------------------------------------------
@dataclass(frozen=True)
class Sorted:
    """The result of the paper's section "Nodule size discrimination".

    Attributes
    ----------
    pairs : dict of (str, str) to Proportion
        Proportion of participants who put the harder nodule of a pair first, with
        Wilson's interval.
    every : Proportion
        The same for all pairs together; the three pairs of one order are not
        independent, so the interval is too narrow.
    rank : dict of str to float
        Mean rank of each nodule, 1 for the first.
    """

    pairs: Mapping[tuple[str, str], Proportion]
    every: Proportion
    rank: Mapping[str, float]


@public
def sorted_rightly(answers: Columns) -> Sorted:
    """Return how often each pair of nodules was sorted correctly.

    The result also contains the mean rank of each nodule.

    Parameters
    ----------
    answers : dict of str to sequence
        With ``condition`` and ``order``, as `stimlib.experiments.reader.columns` and
        `stimlib.experiments.observers.simulate` give them.

    Returns
    -------
    Sorted

    Raises
    ------
    UnknownName
        A column is missing.
    BadValue
        No answers.

    References
    ----------
    Li et al. (2016), "Nodule size discrimination", which scores one point per pair.

    Examples
    --------
    >>> from stimlib.experiments.papers.nodule_sizes import sorted_rightly
    >>> found = sorted_rightly(
    ...     {
    ...         "condition": ["A under 1", "A under 2"],
    ...         "order": [["1", "2", "3"], ["2", "1", "3"]],
    ...     }
    ... )
    >>> found.every.k, found.every.n, found.rank
    (5, 6, {'A': 1.0, 'B': 2.5, 'C': 2.5})
    """
    need("nodule_sizes", ("condition", "order"), answers)
    asked = zip(answers["condition"], answers["order"], strict=True)
    orders = [[UNDER[name][mark] for mark in order] for name, order in asked]
    right = {
        (a, b): sum(o.index(a) < o.index(b) for o in orders) for a, b in combinations(NODULES, 2)
    }
    pairs = {pair: wilson(k, len(orders)) for pair, k in right.items()}
    rank = {n: sum(o.index(n) + 1 for o in orders) / len(orders) for n in NODULES}
    return Sorted(pairs, wilson(sum(right.values()), 3 * len(orders)), rank)


def text(found: Sorted) -> str:
    """Return the rates and ranks as lines of text.

    The paper's values are printed next to them.
    """
    named = [(f"{a} before {b}", p, PRINTED[a, b]) for (a, b), p in found.pairs.items()] + [
        ("all pairs", found.every, 81.7)
    ]
    lines = [
        f"{name:<10}  {100 * p.value:.1f} % [{100 * p.low:.1f}, {100 * p.high:.1f}] of {p.n}"
        f" ({printed})"
        for name, p, printed in named
    ]
    return "\n".join(
        [
            *lines,
            "mean place  "
            + ", ".join(f"{n} {v:.2f} ({PRINTED_RANK[n]})" for n, v in found.rank.items()),
        ]
    )
