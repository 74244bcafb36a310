"""Cells of a table as numbers: numbers, times of day, and those that are missing."""

import datetime
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Literal

import numpy as np

from .layout import THOUSANDS
from .rows import Array, Batch, Rows
from .table import TableFile, number

Missing = Literal["refuse", "gap", "hold", "interpolate"]
# as pandas has them, in small letters
WORDS = frozenset(
    ("", "na", "n/a", "nan", "-nan", "nat", "null", "none", "<na>", "#na", "#n/a", "--")
)
STAMP = re.compile(
    r"(?:(\d{4}-\d\d-\d\d)[T ])?(\d{1,3}):([0-5]\d):([0-5]\d(?:[.,]\d*)?) ?(Z|[+-]\d\d:?\d\d)?"
)
DAY = 86400.0  # s


def in_both(numbers: Sequence[float]) -> Array:
    """Return numbers, and what they are where they were stored in single precision."""
    with np.errstate(over="ignore"):
        singles = np.array(numbers, np.float32).astype(float)
    return np.append(numbers, singles[np.isclose(singles, numbers, 1e-6, 0.0)])


def columns_of(table: TableFile, names: Sequence[str]) -> Array:
    """Return columns of all rows as finite numbers, shape (columns, rows)."""
    cells = Cells(table)
    parts = [cells.numbers(b, names, np.arange(len(b.rows))) for b in table.batches()]
    return np.concatenate([np.empty((len(names), 0)), *parts], axis=1)


class Cells:
    """The cells of a table as numbers.

    Parameters
    ----------
    table : TableFile
    clock : str
        Column that may have times such as 12:30:00.5 or 2026-05-01T12:30:00Z.
    missing : str
        With "refuse", a missing number is an error; otherwise it is NaN.
    sentinels : collection of float or str
        Numbers and texts that stand for a missing number. Numbers are also found where
        they were stored in single precision.
    never : mapping of column to numbers, optional
        Numbers that are no sentinels: 0 in a time, 0 and 1 in contact.
    """

    def __init__(
        self,
        table: TableFile,
        clock: str = "",
        missing: Missing = "refuse",
        sentinels: Collection[float | str] = (),
        never: Mapping[str | None, tuple[int, ...]] | None = None,
    ):
        self._table, self._clock, self._missing = table, clock, missing
        self._texts = {s.strip() for s in sentinels if isinstance(s, str)}
        reads = (number, table.number)
        found = [read(s) if isinstance(s, str) else float(s) for s in sentinels for read in reads]
        self._numbers = in_both([value for value in found if value is not None])
        self._never = never or {}
        self._day: int | None = None
        self._timed: bool | None = None  # whether the clock has times of day, as its first cell
        self._form: tuple[bool, ...] = ()  # of the times: with a date, with a zone

    def note(self) -> list[str]:
        """Return how times were read, in words."""
        if not self._form:
            return []
        dated, zoned = self._form
        return [
            f"{self._clock}: times of day in s since {'the first ' if dated else ''}midnight"
            + (", UTC" if zoned else "")
        ]

    def numbers(self, batch: Batch, columns: Sequence[str], which: Rows) -> Array:
        """Return the selected cells of a batch as numbers, (columns, selected)."""
        try:
            if self._timed:
                raise ValueError
            values = batch.numbers(columns)
            values = values if len(which) == values.shape[1] else values[:, which]
            self._timed = False
        except ValueError:
            values = np.array([self._column(batch, name, which) for name in columns])
        for name, row in zip(columns, values, strict=True):
            lost = np.isin(row, self._numbers) & ~np.isin(row, self._never.get(name, ()))
            for i in np.flatnonzero(lost) if self._missing == "refuse" else ():
                raise self._error(f"{row[i]:g} stands for a missing number", batch, which[i], name)
            row[np.flatnonzero(lost)] = np.nan
            for i in np.flatnonzero(~np.isfinite(row)):
                if self._missing == "refuse" or not np.isnan(row[i]):
                    raise self._error(f"{row[i]} is not finite", batch, which[i], name)
        return values

    def _error(self, problem: str, batch: Batch, i: int, column: str) -> Exception:
        remedy = 'correct or remove the row, or say missing="gap", "hold" or "interpolate"'
        return self._table.error(problem, remedy, batch.rows[i], column)

    def _column(self, batch: Batch, column: str, which: Rows) -> Array:
        texts = batch.texts(column)
        values = np.empty(len(which))
        if column == self._clock and self._timed is None:
            there = (
                t
                for t in (texts[i].strip() for i in which)
                if t.lower() not in WORDS and t not in self._texts
            )
            self._timed = next((bool(STAMP.fullmatch(t)) for t in there), None)
        timed_here = bool(self._timed) and column == self._clock
        for k, i in enumerate(which):
            text = texts[i].strip()
            value = self._seconds(text) if timed_here else self._table.number(text)
            lost = text in self._texts and value not in self._never.get(column, ())
            if lost or (value is None and text.lower() in WORDS):
                if self._missing == "refuse":
                    problem = f"{text!r} stands for no number" if text else "there is no number"
                    raise self._error(problem, batch, i, column)
                value = np.nan
            if value is None:
                shown = repr(text if len(text) <= 40 else text[:37] + "...")
                kind = "a time as in the rows above" if timed_here else "a number"
                remedy = "correct or remove the row"
                if STAMP.fullmatch(text) and not timed_here:
                    remedy = "give times of day as the time, without a factor, in all rows"
                elif THOUSANDS.fullmatch(text):
                    remedy = (
                        "it may be a thousand or have three decimals: remove the sign of thousands,"
                        " or separate the columns with commas and write decimals with a point"
                    )
                elif not re.search(r"\d", text):
                    remedy += (
                        f", or say sentinels=({shown},) and missing= if it is a missing number"
                    )
                raise self._table.error(f"{shown} is not {kind}", remedy, batch.rows[i], column)
            values[k] = value
        return values

    def _seconds(self, text: str) -> float | None:
        """Return a time in s since the first day began, or None if it is none."""
        found = STAMP.fullmatch(text)
        if not found:
            return None
        date, hours, minutes, seconds, zone = found.groups()
        form = bool(date), bool(zone)
        self._form = self._form or form
        if form != self._form or (date and int(hours) > 23):
            return None
        value = 3600.0 * int(hours) + 60 * int(minutes) + float(seconds.replace(",", "."))
        if date:
            try:
                day = datetime.date.fromisoformat(date).toordinal()
            except ValueError:
                return None
            self._day = day if self._day is None else self._day
            value += DAY * (day - self._day)
        if zone and zone != "Z":
            sign = -1 if zone[0] == "-" else 1
            value -= sign * (3600.0 * int(zone[1:3]) + 60 * int(zone[-2:]))
        return value
