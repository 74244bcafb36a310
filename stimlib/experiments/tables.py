"""Answers as columns, grouped and fitted, and results as tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ..errors import BadValue, need, public
from ..system.packages import package
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
    groups = grouped(columns, by)
    return psychometrics(groups, **how)


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
    own = {f.name: getattr(row, f.name) for f in dataclasses.fields(row)}
    if isinstance(row, Fit):
        del own["data"], own["method"]
    return (
        own | {"jnd": row.jnd, "slope": row.slope, "intercept": row.intercept}
        if isinstance(row, Fit)
        else own
    )


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
