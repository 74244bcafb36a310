"""Answers as sets of levels, numbers of yes and numbers of trials."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue, need
from .likelihood import Sets, numbers

SAME = 1e-12  # levels that differ by less, relative to their size, differ by rounding
SINGLE = 1e-7  # the same of a known middle, of numbers in single precision too


# trials at a level, beyond which likelihoods are too coarse for intervals; size of a
# level
MOST, LARGEST = 1e9, 1e100


def answers_of(where: str, given: Any) -> tuple[Sequence[ArrayLike], float | None]:
    """Return what was given as rows, and the chance level of a table of answers."""
    if not hasattr(given, "keys"):  # a DataFrame has some, too
        return given, None
    need(where, ("level", "outcome"), given)
    chances = {chance_of(where, c) for c in (given["chance"] if "chance" in given else [None])}
    if len(chances) > 1:
        raise BadValue(
            f"{where}: the answers are of tasks with chance levels {chances}: fit each task by"
            " itself"
        )
    return (given["level"], given["outcome"]), chances.pop() if chances else None


def missing(value: Any) -> bool:
    """Return whether a cell of a table is empty: None, nan, or pandas' NA."""
    if value is None or type(value).__name__ == "NAType":
        return True
    differs = value != value
    return isinstance(differs, bool | np.bool_) and bool(differs)  # an array is not missing


def chance_of(where: str, given: Any) -> float | None:
    """Return a chance level of a table as a float, or None where it is missing."""
    if missing(given):
        return None
    if not isinstance(given, Real) or not 0 <= float(given) < 1:
        raise BadValue(
            f"{where}: chance = {given!r:.80} must be a number from 0 to below 1, or None where the"
            " task has no chance level"
        )
    return float(given)


def set_of(where: str, given: Sequence[ArrayLike], log: bool, middle: float | None = None) -> Sets:
    """Return one set, each level once.

    Levels that differ by rounding are one, the lowest of them; those that so differ
    from a known middle, on the axis of the fit, are that middle.
    """
    if not 2 <= len(given) <= 3:
        raise BadValue(
            f"{where}: give (levels, yes) or (levels, yes, trials), not {len(given)} things"
        )
    x, k = (
        numbers(f"{where}: {name}", v) for name, v in zip(("levels", "yes"), given, strict=False)
    )
    n = numbers(f"{where}: trials", given[2]) if len(given) == 3 else np.ones_like(k)
    if not x.ndim == 1 == k.ndim == n.ndim or not x.size == k.size == n.size > 0:
        raise BadValue(
            f"{where}: levels {x.shape}, yes {k.shape} and trials {n.shape} must be rows of one"
            " length, with a number in each"
        )
    for name, bad in (
        ("levels", ~np.isfinite(x) | (log & (x <= 0))),
        ("trials", ~((n >= 0) & (n <= MOST) & (n == np.floor(n)))),
        ("yes", ~((k >= 0) & (k <= n) & (k == np.floor(k)))),
    ):
        if bad.any():
            at = int(np.argmax(bad))
            what = (
                "must be finite" + (", and above 0 for log" if log else "")
                if name == "levels"
                else f"must be a whole number from 0 to {MOST:g}"
                if name == "trials"
                else f"must be a whole number from 0 to trials[{at}] = {n[at]:g}"
            )
            raise BadValue(
                f"{where}: {name}[{at}] = {dict(levels=x, yes=k, trials=n)[name][at]:g} {what}"
            )
    unique, at_level = np.unique(x[n > 0], return_inverse=True)
    if not unique.size:
        raise BadValue(f"{where}: there are no trials")
    new = np.append(True, np.diff(unique) > SAME * np.abs(unique[1:]))
    unique, at_level = unique[new], (np.cumsum(new) - 1)[at_level]
    if log:
        unique = np.log10(unique)
    if np.abs(unique).max() > LARGEST or 0 < np.ptp(unique) < 1 / LARGEST:
        raise BadValue(
            f"{where}: levels of {unique[0]:g} to {unique[-1]:g}: give them in another unit, so"
            " that sums of squares exist"
        )
    if middle is not None:
        near = SINGLE * max(float(log), abs(middle), np.abs(unique).max())
        unique, merged = np.unique(
            np.where(np.abs(unique - middle) <= near, middle, unique), return_inverse=True
        )
        at_level = merged[at_level]
    return Sets(unique, np.bincount(at_level, k[n > 0]), np.bincount(at_level, n[n > 0]))


def mirrored(one: Sets, pse: float | None) -> Sets:
    """Return a set with its mirror image about a middle that is known.

    A curve through that middle is as likely of both, and answers that are all right
    about it are separated there.
    """
    if pse is None:
        return one
    x, yes, n = (v[one.x != pse] for v in one)  # at the middle they say nothing
    return Sets(np.append(x, 2 * pse - x), np.append(yes, n - yes), np.append(n, n))


def stacked(part: Sequence[Sets]) -> Sets:
    """Return sets as rows of one length.

    They are filled up with the last level, without trials.
    """
    longest = max(one.x.size for one in part)
    x = [np.pad(one.x, (0, longest - one.x.size), "edge") for one in part]
    yes, n = ([np.pad(one[i], (0, longest - one[i].size)) for one in part] for i in (1, 2))
    return Sets(np.stack(x), np.stack(yes), np.stack(n))
