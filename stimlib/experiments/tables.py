"""Answers as columns, grouped and fitted, and results as tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import BadValue, need, public
from ..system.fields import positive
from ..system.packages import package
from .answer_sets import chance_of
from .fits import Fit, psychometrics

Columns = Mapping[str, Sequence[Any]]
"""Columns with a row for each trial, as `stimlib.experiments.observers.simulate`
returns them; a DataFrame is accepted, too.
"""


@public
def grouped(columns: Columns, by: Sequence[str]) -> dict[tuple[Any, ...], dict[str, list[Any]]]:
    """Return the rows of each group, in the order of first appearance.

    Parameters
    ----------
    columns : dict of str to sequence
        All of the same length.
    by : sequence of str
        Columns whose values make a group.

    Raises
    ------
    UnknownName
        No such column.
    BadValue
        The columns have different lengths, or ``by`` is a single text.

    Examples
    --------
    >>> from stimlib.experiments import grouped
    >>> grouped({"who": ["a", "b", "a"], "level": [1, 2, 3]}, ["who"])
    {('a',): {'who': ['a', 'a'], 'level': [1, 3]}, ('b',): {'who': ['b'], 'level': [2]}}
    """
    need("grouped", by, columns)
    rows = {str(name): list(columns[name]) for name in columns}
    if len({len(column) for column in rows.values()}) > 1:
        raise BadValue(
            f"columns differ in length: {', '.join(f'{k} {len(v)}' for k, v in rows.items())}"
        )
    found: dict[tuple[Any, ...], dict[str, list[Any]]] = {}
    for row in zip(*rows.values(), strict=True):
        named = dict(zip(rows, row, strict=True))
        group = found.setdefault(tuple(named[name] for name in by), {name: [] for name in rows})
        for name, value in named.items():
            group[name].append(value)
    return found


@public
def fitted(
    columns: Columns, by: Sequence[str] = ("participant", "condition"), **how: Any
) -> dict[tuple[Any, ...], Fit]:
    """Fit a psychometric function for each group.

    Parameters
    ----------
    columns : dict of str to sequence
        With ``level``, ``outcome`` (1 for more), ``chance`` (of the task, if there is
        one), and those of ``by``.
    by : sequence of str
    **how
        As `stimlib.experiments.fits.psychometrics`: with ``lapse="shared"`` all groups
        have one lapse rate, those of different participants too.

    Raises
    ------
    UnknownName, BadValue
        As `grouped` and ``psychometric``.

    Examples
    --------
    >>> from stimlib.experiments import fitted
    >>> answers = {
    ...     "who": ["a"] * 6,
    ...     "level": [1, 2, 3, 1, 2, 3],
    ...     "outcome": [0, 1, 0, 0, 0, 1],
    ... }
    >>> fitted(answers, ["who"])[("a",)].trials
    6
    """
    need("fitted", ("level", "outcome"), columns)
    return psychometrics(grouped(columns, by), **how)


@dataclasses.dataclass(frozen=True)
class DifferenceThreshold:
    """A just-noticeable difference, and Weber's fraction.

    Attributes
    ----------
    standard : float
    jnd, jnd_low, jnd_high : float
        The difference that is noticed in 75 % of the pairs, and its interval, in the
        unit of the levels.
    weber, weber_low, weber_high : float
        The same as parts of the standard.
    pse : float
        Where the curve is half-way up.
    trials : int
    problems : tuple of str
        Of the fit, see `stimlib.experiments.fit_problems.PROBLEMS`; nothing can be used
        as it is where there are some.
    """

    standard: float
    jnd: float
    jnd_low: float
    jnd_high: float
    weber: float
    weber_low: float
    weber_high: float
    pse: float
    trials: int
    problems: tuple[str, ...]


@public
def difference_thresholds(
    columns: Columns,
    standard: float | Mapping[Any, float],
    by: Sequence[str] = ("participant", "condition"),
    *,
    pse: float | str | None = "standard",
    **how: Any,
) -> dict[tuple[Any, ...], DifferenceThreshold]:
    """Return the just-noticeable difference and Weber fraction of each group.

    Parameters
    ----------
    columns : dict of str to sequence
        As for `fitted`: answers to two intervals, of which one is the standard.
    standard : float or dict of str to float
        Value of the standard, above 0: one for all, or one for each condition.
    by : sequence of str
        Columns whose values make a group.
    pse : "standard" or float or None
        Where the two intervals are equal, see `stimlib.experiments.fits.psychometric`:
        at the standard; at another level, such as 0 if levels are differences; or None,
        which fits it, as where they also differ in something else.  Answers of a task
        with a chance level are to differences, and take 0 for "standard".
    **how
        As `stimlib.experiments.fits.psychometrics`.

    Returns
    -------
    dict of key to DifferenceThreshold

    Raises
    ------
    UnknownName, BadValue
        As `fitted`; a standard that is not above 0, or not given for a condition.

    Examples
    --------
    >>> from stimlib.experiments import difference_thresholds
    >>> answers = {
    ...     "participant": ["P01"] * 60 + ["P02"] * 60,
    ...     "level": [180.0, 220.0, 240.0] * 40,
    ...     "outcome": [0, 1, 1] * 16 + [1, 0, 1] * 4 + [0, 1, 1] * 18 + [1, 0, 1] * 2,
    ... }
    >>> found = difference_thresholds(answers, 200.0, ["participant"])
    >>> {who: f"{one.weber:.1%}" for (who,), one in found.items()}
    {'P01': '6.9%', 'P02': '5.1%'}
    """
    need("difference_thresholds", ("level", "outcome"), columns)
    groups = grouped(columns, by)
    equal: dict[Any, Any] = {}
    at: dict[Any, Any] = {}
    for key, rows in groups.items():
        names = rows.get("condition", ["without a column condition"])
        each = standard if isinstance(standard, Mapping) else dict.fromkeys(names, standard)
        need("difference_thresholds", names, each, "condition")
        value, *others = {each[name] for name in names}
        at[key] = value.item() if isinstance(value, np.generic) else value
        if others or not positive(at[key]):
            raise BadValue(
                f"difference_thresholds: standard = {at[key]!r:.80} must be a number above 0, and"
                " one for each group; give more columns as by, such as the condition"
            )
        chances = [chance_of("difference_thresholds", v) for v in rows.get("chance", ())]
        equal[key] = pse if pse != "standard" else 0.0 if any(chances) else at[key]
    found: dict[tuple[Any, ...], Fit] = {}
    for middle in dict.fromkeys(equal.values()):
        some = {key: rows for key, rows in groups.items() if equal[key] == middle}
        found |= psychometrics(some, pse=middle, **how)
    return {key: _difference(found[key], at[key]) for key in groups}


def _difference(fit: Fit, standard: float) -> DifferenceThreshold:
    """Return the report of a fit; with ``log`` its JND is a part of the PSE."""
    unit = fit.pse if fit.log else 1.0
    jnd, low, high = unit * fit.jnd, *(unit * v for v in fit.jnd_interval)
    parts = jnd / standard, low / standard, high / standard
    return DifferenceThreshold(standard, jnd, low, high, *parts, fit.pse, fit.trials, fit.problems)


@public
def plain(
    rows: Iterable[Any] | Mapping[Any, Any], names: Sequence[str] = ()
) -> list[dict[str, Any]]:
    """Return results as rows of names and values.

    Parameters
    ----------
    rows : iterable of dataclass, or dict of key to dataclass
        Keys become separate columns.
    names : sequence of str
        Names of those columns.

    Examples
    --------
    >>> from stimlib.experiments import plain, wilson
    >>> plain({"speed": wilson(1, 2)}, ["technique"])[0]["technique"]
    'speed'
    """
    if not isinstance(rows, Mapping):
        return [_fields(row) for row in rows]
    keys = [key if isinstance(key, tuple) else (key,) for key in rows]
    if wrong := [key for key in keys if len(key) != len(names)]:
        raise BadValue(
            f"results by {wrong[0]!r}, and names {tuple(names)!r}: give a name for each part of"
            " a key"
        )
    return [
        dict(zip(names, key, strict=True)) | _fields(row)
        for key, row in zip(keys, rows.values(), strict=True)
    ]


def _fields(row: Any) -> dict[str, Any]:
    if not dataclasses.is_dataclass(row):
        raise BadValue(f"plain: {row!r:.80} is no result; give results of fits, or statistics")
    names = [f.name for f in dataclasses.fields(row)]
    if isinstance(row, Fit):
        names = [*(n for n in names if n not in ("data", "method")), "jnd", "slope", "intercept"]
    return {name: getattr(row, name) for name in names}


@public
def to_pandas(rows: Iterable[Any] | Mapping[Any, Any], names: Sequence[str] = ()) -> Any:
    """Return results as a pandas table.

    Parameters
    ----------
    rows, names
        As `plain`.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    MissingPackage
        pandas is not installed: ``pip install 'stimlib[experiments]'``; `plain` does
        not need it.

    Examples
    --------
    >>> from stimlib.experiments import dunn, to_pandas
    >>> to_pandas(dunn({"a": [1, 3, 5], "b": [2, 4, 6], "c": [7, 8, 9]}))[
    ...     ["a", "b", "p"]
    ... ].round(4)
       a  b       p
    0  a  b  1.0000
    1  a  c  0.0760
    2  b  c  0.2209
    """
    return package("pandas", "a table of results").DataFrame(plain(rows, names))
