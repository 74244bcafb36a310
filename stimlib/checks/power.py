"""The power of a verification's checks: the smallest errors that they would detect.

It is computed for the given recording.

A check of chance sees an error with a probability, here 95 %.  All others see what
passes their limit, always.
"""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy

from ..analysis import spectra
from .evidence import FEWEST, Check, Evidence, Tap
from .scenes import scene_law

CHANCE = 0.95
EQUAL = 1 - 1e-9  # the correlation of equal noises
OF_IT = "of it"  # the unit of a part of a parameter


class Shows(NamedTuple):
    """The smallest detectable error of one kind, and the probability of its detection.

    A size of NaN means that no error is detected, however large.

    For a parameter in the law of a scene, NaN means that no reduction down to 0 is
    detected; larger values are not tried.
    """

    check: str
    kind: str
    size: float
    unit: str
    chance: float


def certainty(checks: list[Check], e: Evidence) -> list[Shows]:
    """Return the smallest errors that the checks would detect in this recording.

    These are the statistical checks, and the law of the scene.

    Parameters
    ----------
    checks : list of Check
        Of the verification.
    e : Evidence
        What they looked at.

    Returns
    -------
    list of Shows

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.checks import certainty
    >>> from stimlib.motion import minimum_jerk
    >>> scene, motion = stimlib.scenes.squeeze(fingers=1), {"x1": minimum_jerk()}
    >>> report = stimlib.verify(
    ...     scene, motion, stimlib.render(scene, motion, fs=8000, seconds=2.0)
    ... )
    >>> for s in certainty(report.checks, report.evidence)[:2]:
    ...     print(f"{s.check}: {s.kind} {s.size:.2g} {s.unit}, {s.chance:.0%}")
    force1: spectrum: level 2.2 dB, 95%
    force1: spectrum: slope 1 dB/oct, 95%
    """
    found = []
    for t in e.taps:
        if t.spectrum is not None:
            f = spectra.bins(t.stream.size, e.fs, t.f_low, t.f_high) * e.fs / t.stream.size
            found += [
                Shows(f"{t.title}: spectrum", *row, CHANCE)
                for row in _of_bins(f.tobytes(), e.share)
            ]
    for a, b, _, _, bins in pairs(e):
        if tells(bins, e.share):
            size, title = smallest_share(bins, e.share), f"{a.title} and {b.title}: independence"
            found.append(Shows(title, "noise in common", size, "correlation", CHANCE))
    for c in checks:
        if c.deviation:
            found.append(Shows(c.name, "stiffness", smallest_shift(c), "N/m", CHANCE))
    if all(c.passed for c in checks if c.group == "d") and np.isfinite(e.x).all():
        found += of_parameters(e)
    return found


def pairs(e: Evidence) -> list[tuple[Tap, Tap, float, float, int]]:
    """Return all pairs of noises, their common band in Hz, and its number of bins.

    It is 0 if they have the same keys, in two segments.
    """
    enough, found = [t for t in e.taps if t.model is not None and t.stream.size > FEWEST], []
    for k, a in enumerate(enough):
        for b in enough[k + 1 :]:
            n, low, high = (
                min(a.stream.size, b.stream.size),
                max(a.f_low, b.f_low),
                min(a.f_high, b.f_high),
            )
            again = a.run != b.run and a.seed == b.seed
            found.append((a, b, low, high, 0 if again else spectra.bins(n, e.fs, low, high).size))
    return found


# Checks of chance ---------------------------------------------------------------------
KINDS: dict[str, tuple[str, Callable[[np.ndarray, float], np.ndarray]]] = {
    "level": ("dB", lambda f, e: np.full(f.shape, 10 ** (e / 10))),
    "slope": ("dB/oct", lambda f, e: 10 ** (e * np.log2(f / np.sqrt(f[0] * f[-1])) / 10)),
    "low-pass pole": ("s", lambda f, e: 1 / (1 + (2 * np.pi * f * e) ** 2)),
    "high-pass pole": ("Hz", lambda f, e: 1 / (1 + (e / f) ** 2)),
}
"""Unit of an error of the spectrum, and the factor that it is on the power at f
(Hz).
"""


def of_spectrum(f: np.ndarray, alarm: float) -> list[tuple[str, float, str]]:
    """Return the smallest spectral errors detected with 95 % probability.

    Each has kind, size and unit.

    Of all statistics that ``spectra.judged`` uses, the one most sensitive to an error
    is used; the others can only add to the power.

    Parameters
    ----------
    f : ndarray, shape (n,)
        Frequencies of the bins in Hz.
    alarm : float
        False alarm probability of the test.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.checks import of_spectrum
    >>> [
    ...     (kind, round(size, 2))
    ...     for kind, size, _ in of_spectrum(np.arange(10.0, 1000.0), 1e-6)
    ... ][:2]
    [('level', 0.96), ('slope', 0.48)]
    """
    bands, weights = spectra.looks(f)
    p = alarm / 2 / (len(bands) + len(weights))
    tests: list[tuple[Any, np.ndarray, float]] = [
        (slice(None), a, critical(a, p)) for w in weights for a in (w, -w)
    ]
    for part in bands:  # their sums are Gamma distributed
        m, one = part.size, np.ones(part.size)
        tests += [
            (part, one, scipy.special.gammainccinv(m, p) - m),
            (part, -one, m - scipy.special.gammaincinv(m, p)),
        ]

    def power(ratio: np.ndarray) -> float:
        seen = [(a * ratio[part], s - a @ (ratio[part] - 1)) for part, a, s in tests]
        best = max(seen, key=lambda row: -row[1] / np.linalg.norm(row[0]))
        return spectra.tail(*best)

    return [
        (kind, smallest(lambda e, r=r: power(r(f, e))), unit)  # type: ignore[misc]
        for kind, (unit, r) in KINDS.items()
    ]


@lru_cache(maxsize=512)
def _of_bins(f: bytes, alarm: float) -> list[tuple[str, float, str]]:
    """Return ``of_spectrum`` for frequencies as bytes, which many noises share."""
    return of_spectrum(np.frombuffer(f), alarm)


def critical(a: np.ndarray, p: float) -> float:
    """Return the value that a sum of a (E - 1) exceeds with probability p."""
    high = 4.0
    while spectra.tail(a, high) > p:
        high *= 2
    return float(
        scipy.optimize.brentq(
            lambda s: math.log(max(spectra.tail(a, s), 1e-300) / p), 1.0, high, xtol=1e-6
        )
    )


def smallest(power: Callable[[float], float]) -> float:
    """Return the error size at which a growing power reaches 95 %.

    It is NaN if that does not happen below a million.
    """
    low = 1e-3
    while power(low) > CHANCE:
        low /= 2
    while power(2 * low) < CHANCE:
        low *= 2
        if low > 1e6:
            return math.nan
    return float(scipy.optimize.brentq(lambda e: power(e) - CHANCE, low, 2 * low, rtol=1e-4))


@lru_cache(maxsize=512)
def _lacks(bins: int, alarm: float) -> Callable[[float], float]:
    """Return the chance by which the test of a correlation lacks ``CHANCE``.

    Given the other noise b, with G = sum |b|^2 Gamma distributed, the statistic is
    normal around rho sqrt(2 G).
    """
    z, size = (
        -scipy.special.ndtri(alarm / 2),
        np.sqrt(2 * scipy.special.gammainccinv(bins, (np.arange(400) + 0.5) / 400)),
    )
    return lambda rho: (
        CHANCE - float(np.mean(scipy.special.ndtr((rho * size - z) / math.sqrt(1 - rho * rho))))
    )


def tells(bins: int, alarm: float) -> bool:
    """Return whether the test of independence detects that two noises are equal."""
    return bool(bins) and _lacks(bins, alarm)(EQUAL) < 0


@lru_cache(maxsize=512)
def smallest_share(bins: int, alarm: float) -> float:
    """Return the smallest correlation of two noises that the test detects.

    It is NaN if even equal noises are not detected.

    Examples
    --------
    >>> from stimlib.checks import smallest_share
    >>> round(smallest_share(1000, 1e-6), 3), smallest_share(8, 1e-6)
    (0.146, nan)
    """
    lacks = _lacks(bins, alarm)
    return float(scipy.optimize.brentq(lacks, 0.0, EQUAL)) if tells(bins, alarm) else math.nan


def smallest_shift(c: Check) -> float:
    """Return the error at which a normal measurement exceeds its limit."""
    return float(c.limit - scipy.special.ndtri(1 - CHANCE) * c.deviation)


# The law of a scene -------------------------------------------------------------------
def of_parameters(e: Evidence) -> list[Shows]:
    """Return the smallest change of each parameter that the law detects.

    For these samples, the law of the scene is evaluated with the changed value.

    The change is found by evaluating the law repeatedly, so it holds for this
    recording. It does not exist for a parameter that is 0.
    """
    if not e.scene.parts:
        return []
    names = [name for name, value in e.params.items() if value]
    return [Shows("law of the scene", name, _departure(e, name), OF_IT, 1.0) for name in names]


def _departure(e: Evidence, name: str) -> float:
    """Return the smallest relative change found that the law refuses.

    What a law measures grows with the change, so a ratio leads to the limit.
    """
    change, best = 1e-3, math.nan
    for _ in range(8):
        over = _refused(e, name, change)
        if over > 1:
            best = float(np.fmin(change, best))
            if over < 1.05:
                break
        change *= 1.02 / max(over, 1e-3)
        if change >= 1:
            break
    return best


class _Unkept(dict[str, Any]):
    """A dictionary for rows that nobody reads, which would fill memory."""

    def __setitem__(self, name: str, row: Any) -> None:
        """Keep nothing."""


def _refused(e: Evidence, name: str, change: float) -> float:
    """Return what the law measures for a smaller parameter, relative to its limit.

    The parameter is reduced by the fraction ``change``.
    """
    factor = 1 - change
    changes = [c._replace(value=c.value * factor) if c.name == name else c for c in e.changes]
    told = dc.replace(
        e,
        params=e.params | {name: e.params[name] * factor},
        changes=changes,
        later=None,
        fingers=_Unkept(),
        curves=_Unkept(),
        wanted=_Unkept(),
        numbers=[],
        skipped=[],
    )
    with np.errstate(all="ignore"):
        checks = scene_law(told)
    return max((c.measured / c.limit for c in checks if c.limit and not c.deviation), default=0.0)
