"""Roughness of bumps on a touch screen: the touch-screen thesis, chapters 4 to 6.

"Haptic Perception of Virtual Bumps Displayed Through a Piezo-Actuated Touch Screen";
see docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import combinations, product
from math import log10

import numpy as np

from ...core.scene import Scene
from ...errors import BadValue, UnknownName, public
from ...motion.generators import constant_speed
from ...run.rendering import render
from ...run.safety import Safety
from ...scenes import bumps, bumps_set
from ..compare import Effect, paired, repeated
from ..designs import ConstantStimuli, Sequential
from ..experiment import Experiment, Masking, Timing
from ..questions import rating
from ..reader import columns
from ..scaling import Law, fechner
from ..tables import Columns, grouped
from ..tasks import Rate
from ..trial import Answer, Observer, Stimulus, Trial

WAVEFORMS, BUMPS, DUTIES, AMPLITUDES = (
    ("sine", "square", "sawtooth"),
    (2, 6, 18),
    (0.2, 0.5, 0.8),
    (0.5, 4.0, 7.5),
)
FACTORS = {"waveform": WAVEFORMS, "bumps": BUMPS, "duty": DUTIES, "amplitude": AMPLITUDES}
STIMULI = {
    f"{s.waveform}, {s.bumps} bumps, duty {s.duty:g}, {s.amplitude:g} V": s for s in bumps_set()
}
Cell = tuple[float, float, str]
"""Amplitude, duty and waveform; the RMS does not depend on the number of bumps."""
CELLS = tuple(product(AMPLITUDES, DUTIES, WAVEFORMS))
PRINTED = dict(
    zip(
        product(DUTIES, AMPLITUDES, WAVEFORMS),
        zip(
            [
                0.08,
                0.11,
                0.06,
                0.65,
                0.89,
                0.44,
                1.23,
                1.66,
                0.83,
                0.13,
                0.18,
                0.10,
                1,
                1.41,
                0.80,
                1.88,
                2.64,
                1.51,
            ]
            + [0.15, 0.22, 0.12, 1.18, 1.79, 0.99, 2.21, 3.35, 1.85],
            [
                2.04,
                1.93,
                1.42,
                3.77,
                3.46,
                3.04,
                3.92,
                3.95,
                3.68,
                1.84,
                1.89,
                1.63,
                3.96,
                4.30,
                3.73,
                4.34,
                4.91,
                4.27,
            ]
            + [1.82, 1.95, 1.80, 4.40, 4.82, 3.98, 5.03, 5.15, 4.68],
            strict=True,
        ),
        strict=True,
    )
)
"""Tables 6.1 and 6.2: RMS in V and mean roughness by duty, amplitude and waveform,
printed row by row.
"""
# of a simulated finger, back and forth over the 10 cm; its speed is ours
HAND = {"x": constant_speed(0.1, 0.1)}
FS, SECONDS, GAIN = 8000.0, 15.0, 50.0


@public
def roughness() -> Experiment:
    """Make the experiment: rate 81 stimuli four times each, on two scales.

    The scales are from smooth to rough and from flat to bumpy.

    There are two days with two sets each, and 48 training trials before the first set.
    Each trial can be replayed once, and white noise masks the sound.

    Returns
    -------
    Experiment
        Its ``observer`` judges the RMS of the rendered voltage, see `person`; its
        ``analysis`` is `ratings`.

    References
    ----------
    The touch-screen thesis, sections 4.1 to 4.3, appendix C.  Our own choices: the 48
    training trials, and **a different order for each participant**: the thesis used a
    single order for all, which confounds stimuli with drift.

    Examples
    --------
    >>> from stimlib.experiments.papers.roughness import roughness
    >>> experiment = roughness()
    >>> for code in ("P01", "P02"):
    ...     design = experiment.designed(code, session=2)
    ...     print(design.next(design.init(experiment.seeded(code, 2))).condition)
    sine, 18 bumps, duty 0.5, 4 V
    sine, 2 bumps, duty 0.5, 4 V
    """
    return Experiment(
        name="roughness",
        version="1",
        scenes={f"{waveform} {n}": bumps(waveform, n) for waveform in WAVEFORMS for n in BUMPS},
        design=day,
        questions=(
            rating("roughness", "How rough was it?", "smooth", "rough"),
            rating("bumpiness", "How bumpy was it?", "flat", "bumpy"),
        ),
        fs=FS,
        safety=Safety(full_scale=400.0),
        motion=HAND,
        timing=Timing(interval=SECONDS),
        sessions=2,
        replays=1,
        masking=Masking(),
        instructions=(
            "Move your finger back and forth. There is no right answer: say what fits best."
        ),
        observer=person(),
        analysis=lambda sessions: text(ratings(columns(sessions))),
    )


def day(participant: str, session: int) -> Sequential:
    """Return the design of one day: two sets of stimuli, with training on day one."""
    items = tuple(
        (
            Rate(
                name,
                ("roughness", "bumpiness"),
                Stimulus(f"{s.waveform} {s.bumps}", {"duty": s.duty, "A": s.amplitude}),
            ),
            None,
        )
        for name, s in STIMULI.items()
    )
    training = ConstantStimuli(tuple(items[k * 81 // 48] for k in range(48)), training=True)
    sets = ConstantStimuli(items, repeats=2, shuffle="each")
    return Sequential({"training": training, "sets": sets} if session == 1 else {"sets": sets})


# Who answers --------------------------------------------------------------------------
@public
@cache
def rms(name: str) -> float:
    """Return the RMS of a stimulus in V before the amplifier, eq. (18).

    The voltage is the one rendered for the moving finger.

    Parameters
    ----------
    name : str
        A name in ``STIMULI``.

    Examples
    --------
    >>> from stimlib.experiments.papers.roughness import rms
    >>> round(rms("square, 6 bumps, duty 0.5, 4 V"), 2)  # A sqrt(d)/2
    1.41
    """
    if name not in STIMULI:
        raise UnknownName(f"rms: no stimulus {name!r}; there are {', '.join(STIMULI)}")
    s = STIMULI[name]
    scene: Scene = bumps(s.waveform, s.bumps)
    voltage = render(scene, HAND, FS, SECONDS, {"duty": s.duty, "A": s.amplitude})["voltage"]
    return float(np.sqrt(np.mean(voltage**2))) / GAIN


@public
def person(rng: np.random.Generator | None = None) -> Observer:
    """Return a simulated participant who judges by the RMS.

    Roughness is 3.92 + 2.25 log10(RMS/V), bumpiness depends on the amplitude alone,
    both with random errors.

    Parameters
    ----------
    rng : Generator, optional
        Draws an individual rating level for each participant; None is the mean
        participant.

    Returns
    -------
    callable
        An observer.  Roughness follows Fechner's law as fitted to the thesis' own
        tables; more bumps are rougher if the amplitude is 4 V or more, as in figure
        6.2.  The sizes of this effect, of the errors and of bumpiness are our own
        choices.
    """
    own = 0.0 if rng is None else 0.5 * rng.normal()

    def answers(trial: Trial, rng: np.random.Generator) -> Answer:
        s = STIMULI[trial.condition]
        more = 0.6 * log10(s.bumps / 6) if s.amplitude >= 4 else 0.0
        rough = 3.92 + 2.25 * log10(rms(trial.condition)) + more + own + 0.8 * rng.normal()
        bumpy = 3.9 + 2.0 * log10(s.amplitude / 4) + own + 0.8 * rng.normal()
        return Answer(
            {
                name: int(np.clip(round(v), 1, 7))
                for name, v in (("roughness", rough), ("bumpiness", bumpy))
            }
        )

    return answers


# What they answered -------------------------------------------------------------------
@dataclass(frozen=True)
class Ratings:
    """The result of the thesis: tables, effects and Fechner's law.

    Attributes
    ----------
    rms, mean, sd : dict of Cell to float
        Table 6.1 as rendered (V), and table 6.2: mean and standard deviation over
        people and bump counts.
    effects : tuple of Effect
        Four-way analysis of variance within people; main effects come first.
    pairs : dict of (factor, level, level) to float
        p of paired t tests of people's means, multiplied by 3 (Bonferroni), at most 1.
    pearson : float
        Correlation of mean and RMS over the 27 cells.
    law : Law
        Fechner's law, fitted to the same cells.
    """

    rms: Mapping[Cell, float]
    mean: Mapping[Cell, float]
    sd: Mapping[Cell, float]
    effects: tuple[Effect, ...]
    pairs: Mapping[tuple[str, str, str], float]
    pearson: float
    law: Law


@public
def ratings(answers: Columns, question: str = "outcome") -> Ratings:
    """Return the thesis' tables and tests for one question.

    Parameters
    ----------
    answers : dict of str to sequence
        As `stimlib.experiments.reader.columns` gives them, or
        `stimlib.experiments.observers.simulate`: without training.
    question : str
        Column of the question: ``"outcome"`` is the first question, roughness.

    Returns
    -------
    Ratings

    Raises
    ------
    BadValue
        A participant has not rated all 81 stimuli; one participant only.
    UnknownName
        No such column.

    References
    ----------
    The touch-screen thesis, chapters 5 and 6, eq. (18).
    """
    y = _means(answers, question)
    effects = repeated(y, list(FACTORS))
    pairs = {}
    for axis, (factor, levels) in enumerate(FACTORS.items(), 1):
        by = y.mean(axis=tuple({1, 2, 3, 4} - {axis}))
        for i, j in combinations(range(3), 2):
            pairs[factor, str(levels[i]), str(levels[j])] = min(
                1.0, 3 * paired(by[:, i], by[:, j]).p
            )
    middle = y.mean(axis=(0, 2)), y.std(axis=(0, 2), ddof=1)
    at = [(WAVEFORMS.index(w), DUTIES.index(d), AMPLITUDES.index(a)) for a, d, w in CELLS]
    mean, sd = ({c: float(v[k]) for c, k in zip(CELLS, at, strict=True)} for v in middle)
    power = {(a, d, w): rms(f"{w}, 6 bumps, duty {d:g}, {a:g} V") for a, d, w in CELLS}
    x, r = np.array(list(power.values())), np.array(list(mean.values()))
    return Ratings(power, mean, sd, effects, pairs, float(np.corrcoef(x, r)[0, 1]), fechner(x, r))


def _means(answers: Columns, question: str) -> np.ndarray:
    """Return mean ratings, shape (participants, waveform, bumps, duty, amplitude)."""
    found = grouped(answers, ("participant", "condition", question))
    sums: dict[tuple[str, str], list[float]] = {}
    for (who, name, value), same in found.items():
        sums.setdefault((who, name), []).extend([value] * len(same["condition"]))
    people = list(dict.fromkeys(who for who, _ in sums))
    if missing := [(who, name) for who in people for name in STIMULI if (who, name) not in sums]:
        raise BadValue(
            f"roughness: {missing[0][0]} has not rated {missing[0][1]}: all 81 stimuli are needed"
        )
    return np.array([[np.mean(sums[who, name]) for name in STIMULI] for who in people]).reshape(
        -1, 3, 3, 3, 3
    )


def text(found: Ratings) -> str:
    """Return the tables and tests as lines of text.

    The thesis' values are printed next to them.
    """
    lines = ["A, V  duty  waveform  RMS, V (printed)  roughness (printed)"]
    for a, d, w in CELLS:
        printed, cell = PRINTED[d, a, w], (a, d, w)
        lines.append(
            f"{a:<4g}  {d:<4g}  {w:<8}  {found.rms[cell]:.2f} ({printed[0]:.2f})      "
            f"{found.mean[cell]:.2f} +- {found.sd[cell]:.2f} ({printed[1]:.2f})"
        )
    for e in found.effects[:4]:
        lines.append(
            f"{e.name}: F({e.df[0]:g}, {e.df[1]:g}) = {e.F:.1f}, p = {e.p_corrected:.2g}"
            " (Greenhouse-Geisser)"
        )
    lines += [
        f"{factor} {a} and {b}: p = {p:.2g} (paired t, Bonferroni)"
        for (factor, a, b), p in found.pairs.items()
    ]
    fit = found.law
    law = f"{fit.line.intercept:.2f} + {fit.line.slope:.2f} log10(RMS/V), R2 = {fit.r2:.3f}"
    return "\n".join([*lines, f"roughness = {law}; Pearson {found.pearson:.3f}"])
