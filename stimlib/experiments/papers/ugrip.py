"""Perceived softness under vibration: the UGrip paper's experiment, section 2.

"A Device and Method for Multimodal Haptic Rendering of Volumetric Stiffness"; see
docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import public
from ...motion.generators import minimum_jerk
from ...run.rendering import Rendering
from ...run.safety import Safety
from ...scenes import squeeze
from ...sweep import measure
from ...sweep.measures import Measure
from .. import (
    Answer,
    Experiment,
    Fit,
    Interleaved,
    Listener,
    Sequential,
    Staircase,
    Stimulus,
    Timing,
    Trial,
    TwoInterval,
    anova,
    choice,
    columns,
    fitted,
    integrated,
    paired,
)
from ..tables import Columns
from ..trial import Observer

K0 = 2000.0  # N/m, of the standard, which does not vibrate
A0 = 3.4  # gain of the vibration
BOUNDS = K0 / 8, 8 * K0  # ours: they protect the hand, and no observer who attends comes near
FINGERS = {"one finger": 1, "two fingers": 2}
VIBRATION = {"silent": 0.0, "vibrating": A0}
# ours, of a simulated hand
SQUEEZES = {f"x{n}": minimum_jerk(depth=0.005) for n in FINGERS.values()}
# ours: with it 300 trials and six minutes of rest take the paper's 45 minutes
TIMING = Timing(interval=3.0, gap=0.5)


@public
def ugrip(reversals: int = 20, self_paced: bool = False) -> Experiment:
    """Make the experiment: say which of two objects is softer.

    There are four pairs of interleaved staircases, for one or two fingers, with and
    without vibration of the comparison. For 8 participants this gives 64 staircases and
    32 fits.

    Parameters
    ----------
    reversals : int
        Number of reversals of each staircase.
    self_paced : bool
        Whether the participant ends each squeeze with a key, after 20 s at most.  The
        paper does not say what ended one; by default it is the time.

    Returns
    -------
    Experiment
        Its ``observer`` judges the rendered forces, see `feels`; its ``analysis`` is
        `comparisons`.

    Raises
    ------
    BadValue
        No reversals.

    References
    ----------
    The UGrip paper, sections 2.1 to 2.3.  Our own choices: bounds, length of an
    interval, gap, and the movement of a simulated hand.

    Examples
    --------
    >>> from stimlib.experiments.papers.ugrip import ugrip
    >>> design = ugrip().designed("P01")
    >>> trial = design.next(design.init(seed=1))
    >>> (
    ...     trial.condition,
    ...     trial.track,
    ...     [{k: round(v) for k, v in s.params.items()} for s in trial.stimuli],
    ... )
    ('one finger, silent', 'one finger, silent low',
     [{'A': 0, 'k': 924}, {'k': 2000, 'A': 0}])
    """
    return Experiment(
        name="ugrip",
        version="1",
        scenes={scene: squeeze(fingers=n) for scene, n in FINGERS.items()},
        design=Sequential(
            {
                f"{fingers}, {name}": _pair(fingers, name, reversals)
                for fingers in FINGERS
                for name in VIBRATION
            },
            pause=120.0,
            shuffle=True,
        ),
        questions=(
            choice("softer", "Which one was softer, the first or the second?", "first", "second"),
        ),
        fs=8000.0,
        safety=Safety(full_scale=100.0, peak=100.0, static=37.0),
        bounds={"k": BOUNDS},
        motion=SQUEEZES,
        timing=Timing(20.0, gap=0.5, until="done") if self_paced else TIMING,
        instructions="Squeeze both objects. Then say which one was softer, or less stiff.",
        observer=person(),
        analysis=lambda sessions: text(comparisons(columns(sessions))),
    )


def _pair(scene: str, name: str, reversals: int) -> Interleaved:
    """Return the two staircases of a condition, one from above and one from below."""
    standard, comparison = (
        Stimulus(scene, {"k": K0, "A": 0.0}),
        Stimulus(scene, {"A": VIBRATION[name]}),
    )
    task = TwoInterval(
        f"{scene}, {name}", "softer", standard, comparison, varies="k", asks_less=True
    )
    starts = {"high": (2 * K0, 2.5 * K0), "low": (K0 / 2.5, K0 / 2)}
    return Interleaved(
        {
            track: Staircase(task, start, BOUNDS, reversals=reversals)
            for track, start in starts.items()
        }
    )


# Who answers --------------------------------------------------------------------------
# of log10 k: the slopes without vibration, section 2.3
SPREAD = {"one finger": 1 / 7.9, "two fingers": 1 / 17.5}
# a point of subjective equality of 2.34 N/mm for one finger
SOFTER = {"one finger": 35.1, "two fingers": 0.0}


@public
def feels(softer: float) -> Measure:
    """Return a measure of felt stiffness, for a participant misled by vibration.

    The participant takes vibration for displacement, as the paper's discussion
    suggests.

    The felt stiffness is k = sum(F x)/sum(x x), divided by 1 + softer rms(F - k
    x)/rms(k x).

    Parameters
    ----------
    softer : float
        0 for a participant who is not deceived by vibration.

    Returns
    -------
    Measure
        Measure ``stiffness`` in N/m, for renderings of `stimlib.scenes.squeeze`.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.experiments.papers.ugrip import SQUEEZES, feels
    >>> from stimlib.sweep import measured
    >>> object = stimlib.render(
    ...     stimlib.scenes.squeeze(A=0.0),
    ...     SQUEEZES,
    ...     fs=8000,
    ...     seconds=1.0,
    ...     params={"k": 1500.0},
    ... )
    >>> {name: round(v, 6) for name, v in measured(object, feels(35.1)).items()}
    {'stiffness': 1500.0}
    """

    @measure("N/m", prepare=lambda x, fs: np.stack(list(x.values())))
    def stiffness(rendering: Rendering, x: np.ndarray) -> float:
        k = np.sum(rendering.y * x) / np.sum(x * x)
        vibration = np.sqrt(np.mean((rendering.y - k * x) ** 2) / np.mean((k * x) ** 2))
        return float(k / (1 + softer * vibration))

    return stiffness


@public
def person(rng: np.random.Generator | None = None) -> Observer:
    """Return a simulated participant who compares felt stiffness.

    The participant compares log10 of the stiffness, with a random error in each
    interval.

    Parameters
    ----------
    rng : Generator, optional
        Draws how strongly vibration deceives, with a standard deviation of 0.8 of the
        mean: one in ten feels the opposite (two of the paper's eight did).  None is the
        mean participant.

    Returns
    -------
    callable
        An observer for `stimlib.experiments.observers.simulate`.

    Examples
    --------
    See :doc:`/reference/experiments_ugrip`.
    """
    much = 1.0 if rng is None else 1 + 0.8 * rng.normal()
    each = {}
    for name, n in FINGERS.items():
        scenes, error = {name: squeeze(fingers=n)}, SPREAD[name] / 2**0.5
        each[name] = Listener(
            scenes, SQUEEZES, 8000.0, TIMING.interval, feels(much * SOFTER[name]), error, log=True
        )

    def answers(trial: Trial, rng: np.random.Generator) -> Answer:
        return each[trial.stimuli[0].scene](trial, rng)

    return answers


@public
def integrates(error: float, shift: float) -> Observer:
    """Return a simulated participant who combines force and vibration by reliability.

    The paper's discussion predicts that vibration alters the estimate of displacement,
    and that people rely on the size between two fingers, which is accurate.  Here log10
    of the stiffness has two cues, the mechanical one, with the paper's spread for one
    or two fingers, and that of the vibration, and `stimlib.experiments.integrated` puts
    them together: two fingers give the vibration less weight.

    Parameters
    ----------
    error : float
        Standard deviation of the vibration's cue, in log10 of the stiffness.
    shift : float
        How much softer a vibrating object is by that cue alone, in log10.

    Returns
    -------
    callable
        An observer.  Its PSE is shifted by the weight of the vibration times ``shift``,
        and its slope is steeper with vibration, against the paper's six of eight.

    Examples
    --------
    See :doc:`/reference/experiments_ugrip`.
    """

    def answers(trial: Trial, rng: np.random.Generator) -> Answer:
        felt = []
        for stimulus in trial.stimuli:
            k = np.log10(stimulus.params["k"])
            errors = [SPREAD[stimulus.scene] / 2**0.5, error / 2**0.5]
            cues = 1 + (stimulus.params["A"] > 0)
            said = (np.array([k, k - shift]) + rng.normal(0.0, errors))[:cues]
            felt.append(integrated(said, errors[:cues]).value)
        return Answer({"softer": "first" if felt[0] < felt[1] else "second"})

    return answers


# What they answered -------------------------------------------------------------------
QUESTIONS = (
    ("pse", "one finger, silent", "one finger, vibrating", "2.02, 2.34: F > 5.6, p < .03"),
    ("slope", "one finger, silent", "one finger, vibrating", "F = 2.0, p > .17"),
    ("intercept", "one finger, silent", "one finger, vibrating", "F = 1.57, p > .23"),
    ("pse", "two fingers, silent", "two fingers, vibrating", "F = 2.0, p > .15"),
    ("slope", "two fingers, silent", "two fingers, vibrating", "F < .1, p > .5"),
    ("intercept", "two fingers, silent", "two fingers, vibrating", "F = .05, p > .8"),
    ("pse", "one finger, silent", "two fingers, silent", "F > 2.3, p > .15"),
    ("slope", "one finger, silent", "two fingers, silent", "7.9, 17.5: F = 4.7, p < .05"),
)
"""The comparisons of section 2.3, in its order: quantity, conditions and printed
values.
"""


@dataclass(frozen=True)
class Comparison:
    """A comparison of two conditions.

    Attributes
    ----------
    what, a, b : str
        "pse" (N/mm), "slope" or "intercept" of the probit over log10(k / (N/mm)), and
        the conditions.
    mean_a, mean_b : float
    people : int
        Number of participants with a fit in both conditions.
    F, p : float
        Within participants, F(1, n - 1).
    F_as_printed, p_as_printed : float
        The same values treated as different people, F(1, 2n - 2), which matches the
        paper's pairs of F and p.
    printed : str
        Values printed in the paper.
    """

    what: str
    a: str
    b: str
    mean_a: float
    mean_b: float
    people: int
    F: float
    p: float
    F_as_printed: float
    p_as_printed: float
    printed: str


@public
def fits(answers: Columns, interval: str = "profile") -> dict[tuple[Any, ...], Fit]:
    """Fit the 32 psychometric functions, by participant and condition.

    They are probit functions over log10 of the comparison's stiffness in N/mm.

    Parameters
    ----------
    answers : dict of str to sequence
        As `stimlib.experiments.reader.columns` or
        `stimlib.experiments.observers.simulate` gives them.
    interval : {"profile", "bootstrap", "none"}

    Examples
    --------
    See :doc:`/reference/experiments_ugrip`.
    """
    return fitted(
        {**answers, "level": [level / 1000 for level in answers["level"]]},
        log=True,
        interval=interval,
    )


@public
def comparisons(answers: Columns) -> tuple[Comparison, ...]:
    """Return the comparisons of section 2.3, in the paper's order.

    Parameters
    ----------
    answers : dict of str to sequence
        As `fits`; at least two participants with fits in both conditions of each
        comparison.

    Raises
    ------
    BadValue, UnknownName
        As `stimlib.experiments.compare.paired` and `fits`.

    Examples
    --------
    See :doc:`/reference/experiments_ugrip`.
    """
    found = fits(answers, interval="none")
    people = list(dict.fromkeys(answers["participant"]))

    def test(what: str, a: str, b: str, printed: str) -> Comparison:
        there = [who for who in people if (who, a) in found and (who, b) in found]
        pairs = [[getattr(found[who, c], what) for c in (a, b)] for who in there]
        x, y = np.array([v for v in pairs if np.isfinite(v).all()]).reshape(-1, 2).T
        within, between = paired(x, y), anova({a: x, b: y})
        return Comparison(
            what,
            a,
            b,
            x.mean(),
            y.mean(),
            x.size,
            within.value**2,
            within.p,
            between.value,
            between.p,
            printed,
        )

    return tuple(test(*asked) for asked in QUESTIONS)


@public
def text(rows: Iterable[Comparison]) -> str:
    """Return the comparisons as lines of text.

    Examples
    --------
    >>> from stimlib.experiments.papers.ugrip import Comparison, text
    >>> one = Comparison(
    ...     "pse",
    ...     "one finger, silent",
    ...     "one finger, vibrating",
    ...     2.0,
    ...     2.3,
    ...     8,
    ...     9.0,
    ...     0.02,
    ...     6.0,
    ...     0.03,
    ...     "F > 5.6",
    ... )
    >>> print(text([one]))
    pse        one finger, silent     2.00  one finger, vibrating  2.30
    F(1, 7) =  9.00, p = .020  paper: F > 5.6
    """
    return "\n".join(
        f"{r.what:<9}  {r.a:<21} {r.mean_a:5.2f}  {r.b:<21} {r.mean_b:5.2f}  F(1, {r.people - 1}) ="
        f" {r.F:5.2f}, p = {f'{r.p:.3f}'.lstrip('0')}  paper: {r.printed}"
        for r in rows
    )
