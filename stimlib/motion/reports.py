"""Conversion of table rows to reports in order of time.

The steps are selection, conversion, repeats, silence and jumps.
"""

import unicodedata
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..errors import BadValue, counted
from .cells import Cells, Missing, in_both
from .clocks import evened, fitted, step_back, unwrapped
from .expression import Expression, Linear, expression, names_in
from .layout import are_numbers
from .rows import Array, Known, Rows
from .table import TableFile

Mask = NDArray[np.bool_]
Touch = NDArray[np.int8]  # contact, or -1 where it is not known

FASTEST = 1e-7  # s from report to report
# median periods without a report; up to 2 also come from the device's clock, in the
# middle of a motion
SILENCE = 2.5
# so many jumps, and more than this share of the reports, are not faults of the device
JUMPS, JUMP_SHARE = 3, 0.01
# s between reports: a device that a hand moves has 0.004 to 0.08, and at 1 kHz a
# millisecond taken for 1 s has 1
SLOWEST = 0.5
LATEST = 1e12  # s; beyond, a time stamp has no part of a millisecond left
VALUES = 1000  # so many different values of a column are listed or counted


@dataclass(frozen=True)
class Reports:
    """Reports in order of time, with one row of ``x`` per input."""

    inputs: tuple[str, ...]
    t: Array
    x: Array
    contact: Mask
    rows: Rows
    contact_column: str | None = None
    repeats: int = 0
    start: float = 0.0
    notes: tuple[str, ...] = ()
    clock: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Clock:
    """How times are made of one or two columns; see `recording`."""

    time: str
    wrap: float | None = None
    clock: str | None = None
    rate: float | None = None


def series(
    table: TableFile,
    columns: Mapping[str, str],
    where: Mapping[str, Any],
    how: Clock,
    contact: str | bool | None,
    repeats: str | None,
    missing: Missing,
    sentinels: Collection[float | str],
) -> Reports:
    """Validate the arguments of `recording` and return its reports.

    Numbers that are missing are NaN.
    """
    time = expression_of(table, "time", how.time)
    if isinstance(time, Linear) and time.scale < 0:
        raise BadValue(f"time: {how.time!r} runs backwards")
    wanted = {name: expression_of(table, name, text) for name, text in columns.items()}
    second = [expression_of(table, "clock", how.clock)] if how.clock is not None else []
    flag = _contact_column(table, contact)
    chosen = _selected(table, where) if where else None
    alone = isinstance(time, Linear) and (time.scale, time.offset) == (1.0, 0.0)
    never = {name: (0,) for e in (time, *second) for name in e.columns} | {flag: (0, 1)}
    cells = Cells(table, time.columns[0] if alone else "", missing, sentinels, never)
    t, x, touch, rows = _converted(table, [time, *second, *wanted.values()], flag, chosen, cells)
    if not len(t):
        raise table.error(
            "there are names of columns and no rows", "give a file with at least two rows"
        )
    known = ~np.isnan(t) if not second else ~np.isnan(t + x[0])
    if not known.any():
        raise table.error("no row has a time", "use another column")
    notes = [*table.notes(), *cells.note()]
    # the place of each among those that came; a row without any number did not
    at = np.cumsum(known | ~np.isnan(x).all(axis=0))[known]
    if not known.all():
        notes.append(f"{counted(int(np.sum(~known)), 'row')} without a time left out")
        t, x, touch, rows = t[known], x[:, known], touch[known], rows[known]
    used = {flag, *(name for e in (time, *second, *wanted.values()) for name in e.columns)}
    t, x, facts = _times(table, t, x, rows, at, how, [*second, time], chosen, used)
    if "drift" in facts:
        notes.append(
            f"times fitted: drift {1e6 * facts['drift']:+.4g} ppm, residual"
            f" {facts['residual_rms']:.3g} s rms, {facts['residual_max']:.3g} s at most"
        )
    notes += [f"{counted(facts['wraps'], 'wrap')} of the clock"] if facts.get("wraps") else []
    notes += (
        [f"clock set back in {counted(len(facts['set_back']), 'row')}"]
        if facts.get("set_back")
        else []
    )
    if missing != "refuse":
        touch = _touch_known(touch, missing)
        if repeats in (None, "last"):  # otherwise each row counts by itself
            shared(t, x)
    start = float(t[0])
    t -= start
    found = Reports(tuple(wanted), t, x, touch == 1, rows, flag, 0, start, tuple(notes), facts)
    found = _repeats(table, found, repeats)
    if len(found.t) < 2:
        raise table.error(
            "one report is not a motion", "give at least two rows with rising time", rows[0]
        )
    if not found.contact.any():
        raise table.error(
            "never in contact", "use contact=False to follow the point in the air", None, flag
        )
    return found


# -- columns


def column_of(table: TableFile, what: str, text: str) -> Linear:
    """Return the column and its linear conversion for a text such as ``t_ms*1e-3``."""
    found = expression_of(table, what, text)
    if not isinstance(found, Linear):
        raise BadValue(f"{what}: {text!r:.80} is not linear in one column; write such as f*5e-4")
    return found


def expression_of(table: TableFile, what: str, text: str) -> Expression:
    """Return a conversion of the table's columns."""
    return expression(what, text, table.names).renamed(lambda name: _find(table, name, what))


def known_in(texts: Iterable[str]) -> Known:
    """Return a function that counts the conversions with their columns among names."""
    wanted = [({text.strip()}, names_in(text)) for text in texts]

    def known(names: Sequence[str]) -> int:
        there = {unicodedata.normalize("NFKC", name) for name in names}.union(names)
        return sum(any(n and n <= there for n in either) for either in wanted)

    return known


def _find(table: TableFile, column: str, what: str) -> str:
    """Return the table's column with a given name.

    Where no name is the same, they are compared in NFKC form, as in Python, where the
    two Unicode micro signs are equal, and so are x² and x2.
    The sign before the first name in a comment is left out.
    """
    names = table.names
    alike = [name for name in names if unicodedata.normalize("NFKC", name) == column]
    same = [name for name in names if name == column] or alike
    if len(same) > 1:
        problem = f"{len(same)} columns have this name, and {what} needs one"
        raise table.error(problem, "rename all but one", None, column)
    if same or column.lstrip("#% ") in names:
        return [*same, column.lstrip("#% ")][0]
    one = next(filter(None, names), "")[:80]
    remedy = (
        f'use one of those, with its factor to s, such as time="{_written(one)}*1e-3" for ms'
        if what == "time" and one
        else "use one of those"
    )
    if are_numbers(names):
        remedy = "the first line must name the columns"
    raise table.error(
        f"{what} needs column {column}, and there is none; the columns are: {_list(names)}", remedy
    )


def _written(column: str) -> str:
    """Return a column as a conversion has it, in quotes if its name is not a word."""
    return column if column.isidentifier() else f"'{column}'"


def _contact_column(table: TableFile, contact: str | bool | None) -> str | None:
    if contact is False or (contact is None and "contact" not in table.names):
        return None
    return _find(table, contact if isinstance(contact, str) else "contact", "contact")


def _list(words: Sequence[str], most: int = 12) -> str:
    count = f"{len(words)}" if len(words) < VALUES else f"{VALUES} or more"
    return ", ".join(f"{word:.80}" for word in words[:most]) + (
        f", ... ({count} in all)" if len(words) > most else ""
    )


# -- rows


def _selected(table: TableFile, where: Mapping[str, Any]) -> Mask:
    """Return a mask of the rows that have all the selected values."""
    keep = np.zeros(0, dtype=bool)
    for i, (column, value) in enumerate(where.items()):
        equal = _equal(table, _find(table, str(column), "where"), value)
        keep = keep & equal if i else equal
    if not keep.any():
        wanted = " and ".join(f"{column}={value}" for column, value in where.items())
        names = [_find(table, str(column), "where") for column in where]
        has = "; ".join(f"{name} has {_list(_values(table, name))}" for name in names)
        raise table.error(f"no row has {wanted}", f"choose from these: {has}")
    return keep


def _equal(table: TableFile, column: str, value: Any) -> Mask:
    """Return a mask of the cells that equal a value, as numbers or as text."""
    text = str(value).strip()
    plain = isinstance(value, int | float | np.number | np.bool_)
    number = float(value) if plain else table.number(text)
    wanted = in_both([] if number is None else [number]).tolist()
    try:
        parts = [np.isin(b.numbers([column])[0], wanted) for b in table.batches()]
    except ValueError:
        texts = (b.texts(column) for b in table.batches())
        parts = [
            np.array(
                [t.strip() == text or bool(wanted) and table.number(t) in wanted for t in batch]
            )
            for batch in texts
        ]
    return np.concatenate([np.zeros(0, dtype=bool), *parts])


def _values(
    table: TableFile, column: str, chosen: Mask | None = None, most: int = VALUES
) -> list[str]:
    """Return the first distinct values of a column, in order of appearance."""
    found: dict[str, None] = {}
    read = 0
    for batch in table.batches():
        texts = np.array(batch.texts(column), object)
        part = slice(None) if chosen is None else chosen[read : read + len(texts)]
        found.update(dict.fromkeys(text.strip() for text in texts[part]))
        read += len(texts)
        if len(found) >= most:
            break
    return list(found)[:most]


def _converted(
    table: TableFile,
    wanted: Sequence[Expression],
    flag: str | None,
    chosen: Mask | None,
    read: Cells,
) -> tuple[Array, Array, Touch, Rows]:
    """Return times, positions, contact and row numbers of the chosen rows."""
    most = table.most if chosen is None else int(chosen.sum())
    values, touch = np.empty((len(wanted), most)), np.ones(most, dtype=np.int8)
    rows = np.empty(most, dtype=np.int64)
    used = list(dict.fromkeys(name for e in wanted for name in e.columns))
    if flag and flag not in used:
        used.append(flag)
    at = passed = 0
    for batch in table.batches():
        which = np.arange(len(batch.rows))
        if chosen is not None:
            which = np.flatnonzero(chosen[passed : passed + len(batch.rows)])
        passed += len(batch.rows)
        if not len(which):
            continue
        found = dict(zip(used, read.numbers(batch, used, which), strict=True))
        end = at + len(which)
        rows[at:end] = batch.rows[which]
        for row, e in zip(values, wanted, strict=True):
            with np.errstate(all="ignore"):
                row[at:end] = e.of(found)
            if np.isfinite(row[at:end]).all():
                continue
            lost = np.isnan([found[name] for name in e.columns]).any(axis=0)
            row[at:end][lost] = np.nan
            for i in np.flatnonzero(~np.isfinite(row[at:end]) & ~lost):
                cells = " and ".join(f"{name} = {found[name][i]:g}" for name in e.columns)
                problem = f"the result is {row[at + i]:g} for {cells}"
                remedy = "check the unit and the expression"
                raise table.error(problem, remedy, rows[at + i], ", ".join(e.columns))
        for i in np.flatnonzero(np.abs(values[0, at:end]) > LATEST):
            column = ", ".join(wanted[0].columns)
            raise table.error(
                f"time {values[0, at + i]:g} s", "check the unit", rows[at + i], column
            )
        if flag is not None:
            touch[at:end] = _touch(table, flag, found[flag], rows[at:end])
        at = end
    return values[0, :at], values[1:, :at], touch[:at], rows[:at]


def _touch(table: TableFile, column: str, values: Array, rows: Rows) -> Touch:
    """Return contact as 0 and 1, -1 where it is missing."""
    lost = np.isnan(values)
    for i in np.flatnonzero(~lost & (values != 0) & (values != 1)):
        raise table.error(
            f"contact is {values[i]:g}",
            "use a column of 0 and 1, or contact=False",
            rows[i],
            column,
        )
    return np.where(lost, -1, values).astype(np.int8)


def _touch_known(touch: Touch, missing: Missing) -> Touch:
    """Return contact where it was missing: none, or that of the row before."""
    if missing == "gap":
        return np.maximum(touch, 0)
    at = np.maximum.accumulate(np.where(touch < 0, 0, np.arange(len(touch))))
    return np.maximum(touch[at], 0)


# -- time


def _times(
    table: TableFile,
    t: Array,
    x: Array,
    rows: Rows,
    at: Rows,
    how: Clock,
    clocks: Sequence[Expression],
    chosen: Mask | None,
    used: set[str | None],
) -> tuple[Array, Array, Mapping[str, Any]]:
    """Return times that rise, the positions, and facts about the clock.

    The first row of ``x`` is the second clock, if there are two clocks; the first of
    these is the one that wraps and must rise.
    """
    many = len(clocks) > 1
    first, wraps = unwrapped(table, x[0] if many else t, rows, clocks[0], how.wrap)
    facts: dict[str, Any] = {"wraps": wraps} if how.wrap is not None else {}
    if how.rate is not None:
        t, found = evened(table, first, how.rate, rows, at)
        return t, x, facts | {**found}
    back = np.flatnonzero(first[1:] < first[:-1])
    if len(back):
        i = back[0]
        values = {n: _values(table, n, chosen, 21) for n in table.names if n not in used}
        # of few values: they may separate recordings
        several = [f"{n} ({_list(found)})" for n, found in values.items() if 1 < len(found) <= 20]
        problem, remedy = step_back(first, i, clocks[0])
        if several:
            remedy = (
                "if there are several recordings in the file, select one with where:"
                f" {', '.join(several)}; else {remedy}"
            )
        raise table.error(
            f"time goes back from {first[i]:.9g} to {first[i + 1]:.9g} s{problem}",
            remedy,
            rows[i + 1],
        )
    if many:
        t, found = fitted(table, t, first, rows)
        return t, x[1:], facts | {**found}
    return first, x, facts


def shared(t: Array, x: Array) -> None:
    """Give rows of one time each other's values where they have none, in place."""
    for row, times in ((x, t), (x[:, ::-1], t[::-1])):
        for values in row:
            at = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(t))))
            same = times[at] == times
            values[same] = values[at[same]]


def _repeats(table: TableFile, s: Reports, how: str | None) -> Reports:
    """Return the reports with one report for each time.

    Identical reports are merged; others are handled as ``repeats`` says.
    """
    again = np.append(False, s.t[1:] == s.t[:-1])
    count = int(again.sum())
    if not count:
        return s
    if how is None:
        _check_equal(table, s, again)
    if how == "spread":
        return replace(s, t=_spread(table, s, again), repeats=count)
    first = np.flatnonzero(~again)
    last = np.append(first[1:], len(s.t)) - 1
    if how == "mean":
        x = np.array([_means(row, first) for row in s.x])
        touch = np.logical_and.reduceat(s.contact, first)
        return replace(s, t=s.t[first], x=x, contact=touch, rows=s.rows[first], repeats=count)
    return replace(
        s, t=s.t[last], x=s.x[:, last], contact=s.contact[last], rows=s.rows[first], repeats=count
    )


def _means(row: Array, first: Rows) -> Array:
    """Return the mean of the numbers from each place to the next; NaN where none is."""
    lost = np.isnan(row)
    count = np.add.reduceat(~lost, first, dtype=int)
    each = np.repeat(count, np.diff(np.append(first, len(row))))
    return np.where(count, np.add.reduceat(np.where(lost, 0.0, row / each), first), np.nan)


def _check_equal(table: TableFile, s: Reports, again: Mask) -> None:
    differs = s.contact[1:] != s.contact[:-1]
    for row in s.x:
        differs |= (row[1:] != row[:-1]) & ~(np.isnan(row[1:]) & np.isnan(row[:-1]))
    differs &= again[1:]
    for i in np.flatnonzero(differs):
        problem = f"the same time as row {s.rows[i]} and other values"
        remedy = (
            "remove one of the two rows, or correct the time; where the clock is coarse (such rows:"
            f' {differs.sum()}) choose repeats="spread", "last" or "mean"'
        )
        raise table.error(problem, remedy, s.rows[i + 1])


def _spread(table: TableFile, s: Reports, again: Mask) -> Array:
    """Spread the times of reports with the same time stamp evenly up to the next stamp.

    After the last stamp, and before a silence, the median period is used.
    """
    first = np.flatnonzero(~again)
    each = np.diff(np.append(first, len(s.t)))
    if len(first) < 2:
        raise table.error(
            "all rows have one time", "give at least two rows with rising time", s.rows[0]
        )
    step = np.diff(s.t[first])
    step = np.minimum(np.append(step, np.inf), np.median(step))
    t = s.t + (np.arange(len(s.t)) - np.repeat(first, each)) * np.repeat(step / each, each)
    for i in np.flatnonzero(t[1:] <= t[:-1]):
        raise table.error(
            "too many rows with one time to be spread", "correct the time", s.rows[i + 1]
        )
    return t


def check_period(table: TableFile, s: Reports, period: float, time: str) -> None:
    """Raise an error unless the median time between reports is plausible.

    An implausible period means that times are probably not in seconds.
    """
    if FASTEST <= period <= SLOWEST:
        return
    if period < FASTEST:
        raise table.error(
            f"{period:.6g} s from report to report, which no clock gives",
            "write the column of times in s",
        )
    unit, factor = next(
        ((u, f) for u, f in (("ms", "1e-3"), ("us", "1e-6")) if period * float(f) <= SLOWEST),
        ("ns", "1e-9"),
    )
    text = _written(time) if time in table.names else f"({time})"
    problem = f"{period:.6g} s from report to report, which is slow for a hand"
    remedy = (
        f'time in {unit}? write time="{text}*{factor}"; if it is in s, give'
        f" max_gap={_enough(np.diff(s.t))} or more"
    )
    raise table.error(problem, remedy)


def _enough(dt: Array) -> str:
    """Return, as text, a ``max_gap`` that is long enough for all silences."""
    return f"{ceil(100 * float(dt.max()) - 1e-6) / 100 + 0.01:g}"


def check_gaps(
    table: TableFile, s: Reports, max_gap: float
) -> tuple[Reports, list[tuple[int, float]]]:
    """Return the reports unless a silence in contact is longer than ``max_gap``.

    Silences off contact are allowed.
    """
    dt = np.where(s.contact[:-1] & s.contact[1:], np.diff(s.t), 0.0)
    for i in np.flatnonzero(dt > max_gap):
        problem = (
            f"a gap of {dt[i]:.6g} s before this report, in contact, longer than {max_gap:.6g} s"
        )
        remedy = (
            'use reports="on_change" if silence means that the point stood still, or'
            f" max_gap={_enough(dt)} to join it"
        )
        raise table.error(problem, remedy, s.rows[i + 1])
    return s, []


def hold_silences(
    s: Reports, period: float, max_gap: float
) -> tuple[Reports, list[tuple[int, float]]]:
    """Insert, at the end of each silence, a copy of the report before it.

    The copy comes one median period before the next report. The long silences are
    returned, too.
    """
    dt = np.diff(s.t)
    i = np.flatnonzero(dt > SILENCE * period)
    t = np.insert(s.t, i + 1, s.t[i + 1] - period)
    x = np.insert(s.x, i + 1, s.x[:, i], axis=1)
    held = Reports(
        s.inputs,
        t,
        x,
        np.insert(s.contact, i + 1, s.contact[i]),
        np.insert(s.rows, i + 1, s.rows[i]),
    )
    return held, [(int(s.rows[k + 1]), float(dt[k])) for k in i if dt[k] > max_gap]


def joined(
    table: TableFile, s: Reports, max_speed: float | Mapping[str, float | None] | None
) -> tuple[Mask, list[tuple[int, float]]]:
    """Return a mask of intervals in contact without jumps, and the jumps."""
    touching = s.contact[:-1] & s.contact[1:]
    given = max_speed if isinstance(max_speed, Mapping) else dict.fromkeys(s.inputs, max_speed)
    # the difference of two reports is rounded
    most = [float(given.get(name) or np.inf) * (1 + 1e-9) for name in s.inputs]
    jump = np.zeros(len(touching), dtype=bool)
    for row, limit in zip(s.x, most, strict=True):
        if limit < np.inf:
            jump |= touching & (_speed(row, s.t) > limit)
    at = np.flatnonzero(jump)
    many = len(at) >= JUMPS and len(at) > JUMP_SHARE * len(s.t)
    if len(at) and (many or len(at) == touching.sum()):
        _refuse_jumps(table, s, int(at[0]), most, len(at))
    return touching & ~jump, [
        (
            int(s.rows[i + 1]),
            max(v for v, limit in zip(_speeds(s, i), most, strict=True) if v > limit),
        )
        for i in at.tolist()
    ]


def _speed(x: Array, t: Array) -> Array:
    with np.errstate(over="ignore"):
        v = np.diff(x)
        np.abs(v, out=v)
        v /= np.diff(t)
    return v


def _speeds(s: Reports, i: int) -> list[float]:
    """Return the speed of each input in one interval."""
    return [float(_speed(row[i : i + 2], s.t[i : i + 2])[0]) for row in s.x]


def _refuse_jumps(
    table: TableFile, s: Reports, i: int, most: Sequence[float], count: int
) -> NoReturn:
    k, speed = next((k, v) for k, v in enumerate(_speeds(s, i)) if v > most[k])
    name = s.inputs[k]
    problem = (
        f"{name} moves at {speed:.4g} m/s, faster than a hand (max_speed is {most[k]:g} m/s), in"
        f" this report and {counted(count - 1, 'other')}"
    )
    most_of_all = float(_speed(s.x[k], s.t)[s.contact[:-1] & s.contact[1:]].max())
    remedy = (
        f"check the unit in the mapping of {name}; set max_speed={most_of_all * 1.001:.4g} if it is"
        " right, or max_speed=None if it is not in metres"
    )
    raise table.error(problem, remedy, s.rows[i + 1])


def lifts(s: Reports) -> list[tuple[int, float]]:
    """Return row and time of each lift, including a missing contact at the start."""
    off = ~s.contact
    off[1:] &= s.contact[:-1]
    return [(int(s.rows[i]), float(s.t[i])) for i in np.flatnonzero(off)]
