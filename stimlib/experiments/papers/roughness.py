"""Roughness and bumpiness of bumps on a touch screen: the thesis, chapters 4 to 6.

"Haptic Perception of Virtual Bumps Displayed Through a Piezo-Actuated Touch Screen";
see docs/reference/papers.rst.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import combinations, product
from math import log10
from typing import Any

import numpy as np

from ...core.scene import Scene
from ...errors import BadValue, need, one_of, public
from ...motion.generators import constant_speed
from ...run.rendering import render
from ...run.safety import Safety
from ...scenes import bumps, bumps_set
from .. import (
    Answer,
    ConstantStimuli,
    Effect,
    Experiment,
    Law,
    Masking,
    Rate,
    Saved,
    Sequential,
    Stimulus,
    Timing,
    Trial,
    columns,
    fechner,
    grouped,
    paired,
    rating,
    repeated,
    shuffled,
)
from ..compare import Statistic
from ..tables import Columns
from ..trial import Design, Observer

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
# bumps a second above which they are hardly counted; ours: the thesis says that its 18
# bumps felt like a continuous vibration
COUNTED = 10.0
SAID = {
    "roughness": {
        "amplitude": "rises with the amplitude",
        "bumps": "rises with the number of bumps, but hardly at 0.5 V",
        "duty": "rises with the duty cycle",
        "waveform": "square is the roughest, sawtooth the smoothest",
    },
    "bumpiness": {
        "amplitude": "rises with the amplitude",
        "bumps": "does not rise steadily with the number of bumps",
        "duty": "is a parabola over the duty cycle",
        "waveform": "sine is the bumpiest, and clearly bumpier than sawtooth alone",
    },
}
"""What the thesis says of figure 5.1 and in chapter 7; it prints no number of it."""


@public
def roughness(order: str = "own") -> Experiment:
    """Make the experiment: rate 81 stimuli four times each, on two scales.

    The scales are from smooth to rough and from flat to bumpy.

    There are two days with two sets each, and 48 training trials before the first set.
    Each trial can be replayed once, and white noise masks the sound.

    Parameters
    ----------
    order : {"own", "same"}
        Whether each participant has a different random order, or all have the same one,
        as in the thesis, whose drift then looks like an effect.

    Returns
    -------
    Experiment
        Its ``observer`` judges the RMS and the swing of the rendered voltage, see
        `person`; its ``analysis`` contains `ratings` of both questions.

    References
    ----------
    The touch-screen thesis, sections 4.1 to 4.3, appendix C.  Our own choices: the 48
    training trials, and by default **a different order for each participant**: the
    thesis used a single order for all, which confounds stimuli with drift.

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
    one_of("roughness: order", order, ("own", "same"))
    return Experiment(
        name="roughness",
        version="1",
        scenes={f"{waveform} {n}": bumps(waveform, n) for waveform in WAVEFORMS for n in BUMPS},
        design=day if order == "own" else partial(day, same=True),
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
            "Move your finger back and forth. Then say how rough and how bumpy it was, from 1 to 7."
            " Smooth is an even surface, free from irregularities; rough an uneven one, with"
            " irregularities, changes in the amplitude. Flat is a surface with no bumps; bumpy one"
            " with countable bumps. There is no right answer: say what fits best."
        ),
        observer=person(),
        analysis=analysis,
    )


def day(participant: str, session: int, same: bool = False) -> Sequential:
    """Return the design of one day: two sets of stimuli, with training on day one.

    With ``same`` the order is that of all participants.
    """
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
    trained = tuple(items[k * 81 // 48] for k in range(48))
    training = ConstantStimuli(trained, training=True)
    sets: dict[str, Design] = {"sets": ConstantStimuli(items, repeats=2, shuffle="each")}
    if same:
        training = ConstantStimuli(_mixed(trained, "training"), training=True, shuffle="none")
        sets = {
            f"set {n}": ConstantStimuli(_mixed(items, f"{session}, set {n}"), shuffle="none")
            for n in (1, 2)
        }
    return Sequential({"training": training, **sets} if session == 1 else sets)


def _mixed(items: tuple[Any, ...], purpose: str) -> tuple[Any, ...]:
    """Return items in a random order that is the same for everybody."""
    return tuple(items[int(k)] for k in shuffled(0, purpose, [str(k) for k in range(len(items))]))


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
    return float(np.sqrt(np.mean(_voltage("rms", name) ** 2)))


@public
@cache
def swing(name: str) -> float:
    """Return how much the envelope of a stimulus rises and falls, in V.

    It is the standard deviation of the envelope of the voltage that is rendered for the
    moving finger, before the amplifier. Each of its frequencies f counts 1/(1 + (f/10
    Hz)^2): bumps that pass faster are hardly counted. For square bumps that pass slowly
    it is A sqrt(d (1 - d)), a parabola over the duty cycle d under the root.

    Parameters
    ----------
    name : str
        A name in ``STIMULI``.

    Examples
    --------
    >>> from stimlib.experiments.papers.roughness import swing
    >>> [round(swing(f"square, 2 bumps, duty {d}, 4 V"), 2) for d in (0.2, 0.5, 0.8)]
    [1.41, 1.85, 1.41]
    """
    voltage = _voltage("swing", name)
    size = np.pi * np.abs(np.fft.rfft(voltage)) / voltage.size  # of half waves 1/pi is the mean
    size /= 1 + (np.fft.rfftfreq(voltage.size, 1 / FS) / COUNTED) ** 2
    return float(np.sqrt(2 * np.sum(size[1:] ** 2)))


def _voltage(who: str, name: str) -> np.ndarray:
    """Return the rendered voltage of a stimulus before the amplifier."""
    need(who, [name], STIMULI, "stimulus")
    s = STIMULI[name]
    scene: Scene = bumps(s.waveform, s.bumps)
    return render(scene, HAND, FS, SECONDS, {"duty": s.duty, "A": s.amplitude})["voltage"] / GAIN


@public
def person(rng: np.random.Generator | None = None) -> Observer:
    """Return a simulated participant who judges the rendered voltage.

    Roughness is 3.92 + 2.25 log10(RMS/V), bumpiness 5 + 2 log10(swing/V), both with
    random errors; see `rms` and `swing`.

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
        6.2.  Bumpiness is a parabola over the duty cycle and falls where bumps pass too
        fast to be counted, as the thesis reports; that the swing is what people judge,
        and the sizes of all effects and errors, are our own choices.  Of equal peaks,
        square bumps swing most, so this observer does not find the sine bumpiest.
    """
    own = 0.0 if rng is None else 0.5 * rng.normal()

    def answers(trial: Trial, rng: np.random.Generator) -> Answer:
        s = STIMULI[trial.condition]
        more = 0.6 * log10(s.bumps / 6) if s.amplitude >= 4 else 0.0
        rough = 3.92 + 2.25 * log10(rms(trial.condition)) + more + own + 0.8 * rng.normal()
        bumpy = 5.0 + 2.0 * log10(swing(trial.condition)) + own + 0.8 * rng.normal()
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
        p of paired t tests of people's means, multiplied by 3 (Bonferroni), at most 1;
        nan if the difference is the same of all people, which happens with two.
    middles : dict of factor to Statistic
        For "bumps" and "duty", the paired t test of people's means at the middle level
        against the mean of the outer two: above 0 where the ratings are a parabola with
        a top.
    boxes : dict of (factor, level) to tuple of float
        Figure 5.1: least, lower quartile, median, upper quartile and largest of
        people's mean ratings of the 27 stimuli with this level.
    by_bumps : dict of (waveform, amplitude, bumps) to float
        Figure 6.2: mean over people and duty cycles.
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
    middles: Mapping[str, Statistic]
    boxes: Mapping[tuple[str, str], tuple[float, ...]]
    by_bumps: Mapping[tuple[str, float, int], float]
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
        Column of the question: ``"outcome"`` is the first question, roughness;
        ``"bumpiness"`` is the second.

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
    pairs, middles, boxes = {}, {}, {}
    for axis, (factor, levels) in enumerate(FACTORS.items(), 1):
        by = y.mean(axis=tuple({1, 2, 3, 4} - {axis}))
        for i, j in combinations(range(3), 2):
            p = float(np.minimum(1.0, 3 * compared(by[:, i], by[:, j]).p))
            pairs[factor, str(levels[i]), str(levels[j])] = p
        if factor in ("bumps", "duty"):
            middles[factor] = compared(by[:, 1], (by[:, 0] + by[:, 2]) / 2)
        for i, level in enumerate(levels):
            quartiles = np.quantile(y.take(i, axis), (0, 0.25, 0.5, 0.75, 1))
            boxes[factor, str(level)] = tuple(quartiles.tolist())
    means = y.mean(axis=(0, 3))
    by_bumps = {
        (w, a, n): float(means[i, j, k])
        for i, w in enumerate(WAVEFORMS)
        for j, n in enumerate(BUMPS)
        for k, a in enumerate(AMPLITUDES)
    }
    middle = y.mean(axis=(0, 2)), y.std(axis=(0, 2), ddof=1)
    at = [(WAVEFORMS.index(w), DUTIES.index(d), AMPLITUDES.index(a)) for a, d, w in CELLS]
    mean, sd = ({c: float(v[k]) for c, k in zip(CELLS, at, strict=True)} for v in middle)
    power = {(a, d, w): rms(f"{w}, 6 bumps, duty {d:g}, {a:g} V") for a, d, w in CELLS}
    x, r = np.array(list(power.values())), np.array(list(mean.values()))
    pearson, law = float(np.corrcoef(x, r)[0, 1]), fechner(x, r)
    return Ratings(power, mean, sd, effects, pairs, middles, boxes, by_bumps, pearson, law)


def compared(a: np.ndarray, b: np.ndarray) -> Statistic:
    """Return the paired t test; its numbers are nan if all people differ equally."""
    if np.ptp(a - b) > 1e-12:
        return paired(a, b)
    return Statistic("paired t", np.nan, (a.size - 1.0,), np.nan)


def _means(answers: Columns, question: str) -> np.ndarray:
    """Return mean ratings, shape (participants, waveform, bumps, duty, amplitude)."""
    need("roughness", [question], answers)
    found = grouped(answers, ("participant", "condition"))
    people = list(dict.fromkeys(who for who, _ in found))
    if missing := [(who, name) for who in people for name in STIMULI if (who, name) not in found]:
        raise BadValue(
            f"roughness: {missing[0][0]} has not rated {missing[0][1]}: all 81 stimuli are needed"
        )
    return np.array(
        [[np.mean(found[who, name][question]) for name in STIMULI] for who in people]
    ).reshape(-1, 3, 3, 3, 3)


def text(found: Ratings, scale: str = "roughness") -> str:
    """Return the tables and tests of a scale as lines of text.

    The thesis' values are printed next to them: numbers for roughness, sentences for
    both scales.
    """
    rough = scale == "roughness"
    lines = [f"A, V  duty  waveform  RMS, V (printed)  {scale}{' (printed)' * rough}"]
    for a, d, w in CELLS:
        printed, cell = PRINTED[d, a, w], (a, d, w)
        lines.append(
            f"{a:<4g}  {d:<4g}  {w:<8}  {found.rms[cell]:.2f} ({printed[0]:.2f})      "
            f"{found.mean[cell]:.2f} +- {found.sd[cell]:.2f}{f' ({printed[1]:.2f})' * rough}"
        )
    lines.append(f"A, V  waveform  {scale} at {', '.join(map(str, BUMPS))} bumps")
    for a, w in product(AMPLITUDES, WAVEFORMS):
        row = "  ".join(f"{found.by_bumps[w, a, n]:.2f}" for n in BUMPS)
        lines.append(f"{a:<4g}  {w:<8}  {row}")
    lines.append("factor level: least, quartiles and largest of people's means")
    lines += [
        f"{factor} {level}: {'  '.join(f'{v:.2f}' for v in box)}"
        for (factor, level), box in found.boxes.items()
    ]
    lines += [f"thesis, {scale} and {factor}: {said}" for factor, said in SAID[scale].items()]
    lines += [
        f"{e.name}: F({e.df[0]:g}, {e.df[1]:g}) = {e.F:.1f}, p = {e.p_corrected:.2g}"
        " (Greenhouse-Geisser)"
        for e in found.effects[:4]
    ]
    lines += [
        f"{factor} {a} and {b}: p = {p:.2g} (paired t, Bonferroni)"
        for (factor, a, b), p in found.pairs.items()
    ]
    lines += [
        f"{factor}, the middle over the mean of the ends: t({t.df[0]:g}) = {t.value:.2f},"
        f" p = {t.p:.2g}"
        for factor, t in found.middles.items()
    ]
    fit = found.law
    law = f"{fit.line.intercept:.2f} + {fit.line.slope:.2f} log10(RMS/V), R2 = {fit.r2:.3f}"
    return "\n".join([*lines, f"{scale} = {law}; Pearson {found.pearson:.3f}"])


@public
def analysis(sessions: Sequence[Saved]) -> str:
    """Analyse both scales, roughness and bumpiness."""
    answers = columns(sessions)
    found = {"roughness": ratings(answers), "bumpiness": ratings(answers, "bumpiness")}
    return "\n\n".join(text(r, scale) for scale, r in found.items())
