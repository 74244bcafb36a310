"""Cues that participants used: how far each recorded cue separates the answers.

The distance of each cue is compared with the d' of the same trials.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..analysis.physical_cues import Cues, cues
from ..errors import BadValue, need, public
from ..files.log_reader import read_log
from ..files.log_replay import delivered, without_inverse
from ..system.progress import progress as bar
from .fit_problems import undetermined
from .likelihood import Sets, maximum, numbers
from .reader import Saved, columns
from .trial import Record

FAR = 10.0
"""A distance too large to be determined: at z = 5 the other answer occurs once in three
million trials.
"""


@dataclass(frozen=True)
class Distance:
    """The distance by which a physical cue separates the two answers.

    Attributes
    ----------
    cue : str
    value : float
        Normalised distance: mean z of the trials classified as signals minus mean z of
        the others; nan if it cannot be determined.
    ratio : float
        The distance divided by d', if d' was given.
    slope : float
        Slope of the probit per unit of the cue; positive if more of the cue means more
        "signal" answers.
    problem : str
        ``""``, ``"separated"`` (the cue separates the answers completely, or except for
        trials in which it hardly differs, so that z is undetermined or above `FAR`),
        ``"few"`` (a single answer or value only), or ``"one side"`` (no trial, or every
        trial, would be classified as a signal).
    """

    cue: str
    value: float
    ratio: float
    slope: float
    problem: str


@public
def distances(
    cues: Mapping[str, ArrayLike], answers: ArrayLike, d: float = math.nan
) -> tuple[Distance, ...]:
    """Return the normalised distances of physical cues, the largest first.

    For each cue a probit z = a + b cue is fitted to the answers; a trial with z > 0 is
    classified as a signal, and the distance is mean(z of signals) - mean(z of the
    others). A cue that people used has a distance near d'; a cue that they did not use
    has a small distance.

    Parameters
    ----------
    cues : dict of str to array_like, shape (trials,)
        For instance the values of `stimlib.analysis.physical_cues.cues` for every
        trial.
    answers : array_like, shape (trials,)
        1 if the answer was "signal", otherwise 0.
    d : float, optional
        d' of the same trials, `stimlib.experiments.signal_detection.detection`.

    Returns
    -------
    tuple of Distance
        Cues without a value come last.

    Raises
    ------
    BadValue
        Rows of different lengths, answers other than 0 and 1, cues that are not finite,
        no cue.

    References
    ----------
    Çaldıran's thesis, section 3.8.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments import distances
    >>> rng = np.random.default_rng(1)
    >>> phase = np.repeat([0.4, 0.5], 100) + 0.02 * rng.normal(size=200)
    >>> force = 3 + 0.2 * rng.normal(size=200)  # which says nothing
    >>> answers = phase + 0.05 * rng.normal(size=200) > 0.45
    >>> [
    ...     found.cue
    ...     for found in distances({"force": force, "phase": phase}, answers, d=2.0)
    ... ]
    ['phase', 'force']
    """
    said = numbers("distances: answers", answers)
    if said.ndim != 1 or not said.size or not np.isin(said, (0.0, 1.0)).all():
        raise BadValue("distances: answers must be a row of 0 and 1, one for each trial")
    if not cues:
        raise BadValue("distances: give at least one cue, by name")
    found = [
        _distance(name, numbers(f"distances: {name}", values), said, d)
        for name, values in cues.items()
    ]
    return tuple(sorted(found, key=lambda v: -v.value if math.isfinite(v.value) else math.inf))


def _distance(name: str, cue: np.ndarray, said: np.ndarray, d: float) -> Distance:
    if cue.shape != said.shape:
        raise BadValue(f"distances: {name} has shape {cue.shape}, the answers {said.shape}")
    if not np.isfinite(cue).all():
        raise BadValue(f"distances: {name}[{int(np.argmin(np.isfinite(cue)))}] is not finite")
    sets = Sets(cue, said, np.ones_like(said))
    if wrong := ("few",) if np.ptp(cue) == 0 else undetermined(sets):
        return Distance(
            name, math.nan, math.nan, math.nan, "few" if wrong == ("few",) else "separated"
        )
    fit = maximum(sets, cue.mean())
    z = fit.a + fit.b * (cue - cue.mean())
    if not 0 < np.sum(z > 0) < z.size:
        return Distance(name, math.nan, math.nan, float(fit.b), "one side")
    value = float(z[z > 0].mean() - z[z <= 0].mean())
    if value > FAR:
        return Distance(name, math.nan, math.nan, float(fit.b), "separated")
    return Distance(name, value, value / d if d else math.nan, float(fit.b), "")


# What was displayed -------------------------------------------------------------------
@public
def displayed(folder: Path, record: Record) -> list[dict[str, NDArray[np.float64]]]:
    """Return the signals of each interval of a trial, from its log.

    They are the motion, and the outputs as delivered to the device, in their units.

    Parameters
    ----------
    folder : Path
        Folder of the session.
    record : Record
        Record of a trial with a log; the last presentation is used.

    Returns
    -------
    list of dict of str to ndarray, shape (n,)
        By the names of inputs and outputs, float64; 0 where samples were lost.

    Raises
    ------
    BadValue
        The trial has no log: it was not displayed, or displayed without a log.
    SinkError
        The log is missing or damaged.
    """
    shown = record.displayed[-1] if record.displayed else {}
    if "log" not in shown:
        raise BadValue(
            f"{folder}, trial {record.number}: no log of it was kept, so nobody knows what was"
            " displayed"
        )
    log = without_inverse(read_log(folder / shown["log"]))
    frames = (
        np.concatenate([f.astype(np.float64) * there for _, f, there in delivered(log)])
        * log.safety.scales(log.outputs)[list(log.channels)]
    )
    outputs = dict(zip(log.outputs, frames.T, strict=False))
    inputs = dict(zip(log.inputs, np.asarray(log.motion).T, strict=True))
    return [{name: x[a:b] for name, x in (inputs | outputs).items()} for a, b in shown["intervals"]]


@public
def recorded(
    sessions: Sequence[Saved], position: str, force: str, progress: bool = True, **how: Any
) -> dict[str, list[Any]]:
    """Return the physical cues of all non-training trials, from their logs.

    They are computed from the motion and from the displayed outputs.

    Parameters
    ----------
    sessions : sequence of Saved
        With trials of one interval, displayed with a log.
    position, force : str
        Input in m, and output in N.
    progress : bool
        A progress bar on stderr, if that is a terminal.
    **how
        As `stimlib.analysis.physical_cues.cues`, such as ``window``.

    Returns
    -------
    dict of str to list
        As `stimlib.experiments.reader.columns`, and one column for each of
        `stimlib.analysis.Cues`: all nan for a trial in which the hand did not move or
        moved for less than two periods.

    Raises
    ------
    UnknownName
        No such input or output.
    BadValue
        A trial without a log or with several intervals, or words of ``how`` that
        ``cues`` rejects.
    SinkError
        A log is missing or damaged.

    References
    ----------
    Çaldıran's thesis, section 3.8.

    Examples
    --------
    See :doc:`/reference/experiments_bounciness`.
    """
    cues(np.sin(np.arange(100.0)), np.ones(100), 1.0, **how)  # says what is wrong with these words
    rows: list[Cues] = []
    trials = [(s, r) for s in sessions for r in s.data]
    with bar("cues", len(trials), progress) as advance:
        for s, r in trials:
            signals = displayed(s.folder, r)
            if len(signals) != 1:
                raise BadValue(
                    f"{s.folder}, trial {r.number}: it has {len(signals)} intervals; cues are of"
                    " trials with one"
                )
            need(str(s.folder), (position, force), signals[0], "signal")
            try:
                rows.append(
                    cues(signals[0][position], signals[0][force], r.displayed[-1]["fs"], **how)
                )
            except BadValue:
                rows.append(Cues(*[math.nan] * len(Cues._fields)))
            advance(1)
    return columns(sessions) | {name: [getattr(row, name) for row in rows] for name in Cues._fields}
