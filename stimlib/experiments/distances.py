"""What did people go by?  Each recorded cue is asked how far it parts the answers, beside the d' of the same trials."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue
from .fits import undetermined
from .likelihood import Sets, maximum, numbers


@dataclass(frozen=True)
class Distance:
    """How far a physical cue parts the answers.

    Attributes
    ----------
    cue : str
    value : float
        Normalised distance: mean z of the trials taken for signals, less that of the others; nan where it is not determined.
    ratio : float
        Over d', if that was given.
    slope : float
        Of the probit over one unit of the cue; above 0 where more of the cue means more answers "signal".
    problem : str
        ``""``, ``"separated"`` (the cue parts the answers wholly, so z is not determined), ``"few"`` (one answer or one value
        only), or ``"one side"`` (no trial, or all of them, would be taken for a signal).
    """

    cue: str
    value: float
    ratio: float
    slope: float
    problem: str


def distances(cues: Mapping[str, ArrayLike], answers: ArrayLike, d: float = math.nan) -> tuple[Distance, ...]:
    """Normalised distances of physical cues, the largest first.

    For each cue a probit z = a + b cue is fitted to the answers; a trial with z > 0 is taken for a signal, and the distance is
    mean(z of signals) - mean(z of the others).  A cue that people went by has a distance near d', one that they did not has a
    small one.

    Parameters
    ----------
    cues : dict of str to array_like, shape (trials,)
        Such as the columns of `stimlib.analysis.cues.cues` of every trial.
    answers : array_like, shape (trials,)
        1 where the answer was "signal", else 0.
    d : float, optional
        d' of the same trials, `stimlib.experiments.detection.detection`.

    Returns
    -------
    tuple of Distance
        Those without a value at the end.

    Raises
    ------
    BadValue
        Rows of different lengths, answers other than 0 and 1, cues that are not finite, no cue.

    References
    ----------
    Çaldıran's thesis, section 3.8.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments.distances import distances
    >>> rng = np.random.default_rng(1)
    >>> phase = np.repeat([0.4, 0.5], 100) + 0.02 * rng.normal(size=200)
    >>> force = 3 + 0.2 * rng.normal(size=200)  # which says nothing
    >>> answers = phase + 0.05 * rng.normal(size=200) > 0.45
    >>> [found.cue for found in distances({"force": force, "phase": phase}, answers, d=2.0)]
    ['phase', 'force']
    """
    said = numbers("distances: answers", answers)
    if said.ndim != 1 or not said.size or not np.isin(said, (0.0, 1.0)).all():
        raise BadValue("distances: answers must be a row of 0 and 1, one for each trial")
    if not cues:
        raise BadValue("distances: give at least one cue, by name")
    found = [_distance(name, numbers(f"distances: {name}", values), said, d) for name, values in cues.items()]
    return tuple(sorted(found, key=lambda v: -v.value if math.isfinite(v.value) else math.inf))


def _distance(name: str, cue: np.ndarray, said: np.ndarray, d: float) -> Distance:
    if cue.shape != said.shape:
        raise BadValue(f"distances: {name} has shape {cue.shape}, the answers {said.shape}")
    if not np.isfinite(cue).all():
        raise BadValue(f"distances: {name}[{int(np.argmin(np.isfinite(cue)))}] is not finite")
    sets = Sets(cue, said, np.ones_like(said))
    if wrong := ("few",) if np.ptp(cue) == 0 else undetermined(sets):
        return Distance(name, math.nan, math.nan, math.nan, "few" if wrong == ("few",) else "separated")
    fit = maximum(sets, cue.mean())
    z = fit.a + fit.b * (cue - cue.mean())
    if not 0 < np.sum(z > 0) < z.size:
        return Distance(name, math.nan, math.nan, float(fit.b), "one side")
    value = float(z[z > 0].mean() - z[z <= 0].mean())
    return Distance(name, value, value / d if d else math.nan, float(fit.b), "")
