"""Clocks of recordings: wraps, steps back, drift and jitter."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import BadValue
from .cells import DAY
from .expression import Expression, Linear
from .rows import LOST, Array, Rows
from .table import TableFile

COUNTS = 2.0**16, 2.0**24, 2.0**32  # at which counters begin again
UNITS = 1e-6, 1e-3  # s, of such counts
NEAR = 50  # median periods between the last report before a wrap and the first after it
MOST_DRIFT = 0.01  # two clocks differ by less, or the unit of one is wrong
LEVEL = 15  # rows before and after a step back whose medians show whether it lasts


def unwrapped(
    table: TableFile, t: Array, rows: Rows, clock: Expression, wrap: float | None
) -> tuple[Array, int]:
    """Return times of a clock that begins again at a count, and how often it did."""
    if wrap is None:
        return t, 0
    if not isinstance(clock, Linear):
        raise BadValue("wrap: give a single column as the time or clock")
    size = wrap * clock.scale
    if np.ptp(t) > size * (1 + 1e-12):
        problem = f"the counts span {np.ptp(t) / clock.scale:.12g}, more than wrap = {wrap:.12g}"
        raise table.error(problem, "correct wrap", rows[np.argmax(t)], clock.column)
    steps = np.diff(t)
    period = float(np.median(np.abs(steps))) if len(steps) else 0.0
    for i in np.flatnonzero(steps >= size - min(NEAR * period, size / 8)):
        problem = (
            f"the clock goes on by {steps[i]:.9g} s, almost the {size:.9g} s of a wrap, as for a"
            " row from before the wrap that comes too late"
        )
        raise table.error(problem, "put the rows into the order of time", rows[i + 1], clock.column)
    again = steps < -size / 2
    return t + size * np.append(0, np.cumsum(again)), int(again.sum())


def step_back(t: Array, i: int, clock: Expression) -> tuple[str, str]:
    """Return what a step back after row i is, and the remedy."""
    steps = np.diff(t)
    period = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    scale = clock.scale if isinstance(clock, Linear) else 1.0
    sizes = {n * unit for n in COUNTS for unit in (scale, *UNITS)} | {DAY}
    for size in sorted(sizes):
        if np.ptp(t) <= size and 0 < steps[i] + size <= min(NEAR * period, size / 2):
            problem = f", as a clock does that begins again after {size:.10g} s"
            return problem, f"say wrap={size / scale:.12g}"
    # rows of a clock that was set back lie twice as close there if they are sorted
    inside = np.count_nonzero((t >= t[i + 1]) & (t <= t[i]))
    late = np.count_nonzero(t < np.maximum.accumulate(t))
    if -steps[i] <= NEAR * period and inside < 1.5 * (-steps[i] / period + 1):
        problem = f"; {late} of {len(t)} rows come too late"
        return problem, "put the rows into the order of time"
    remedy = (
        "if the clock was set back, say rate= if the rows come at an even rate, or clock= if there"
        " is a second column of times; if it begins again at a count, say wrap=; if another"
        " recording begins here, read them one by one"
    )
    return "", remedy


def fitted(
    table: TableFile, t: Array, second: Array, rows: Rows
) -> tuple[Array, Mapping[str, Any]]:
    """Return times by a second clock, drift and offset taken from the first.

    The second clock is free of jitter, and the first is right in the long run.
    """
    c = second - second.mean()
    if not c.any():
        raise table.error("clock has one time in all rows", "use another column", rows[0])
    slope = float(c @ (t - t.mean()) / (c @ c))
    if abs(slope - 1) > MOST_DRIFT:
        problem = f"1 s of clock is {slope:.6g} s of time"
        raise table.error(problem, "check the units of both, such as clock='t_us*1e-6'", rows[0])
    even = t.mean() + slope * c
    return even, _facts(slope - 1, t - even)


def evened(
    table: TableFile, t: Array, rate: float, rows: Rows, at: Rows
) -> tuple[Array, Mapping[str, Any]]:
    """Return times at an even rate, which is fitted to the time stamps.

    ``at`` has the place of each row among those that came, with a time or without;
    one of no numbers at all is none.
    Rows are counted anew after a silence. Where a clock was set back, it is taken to
    have gone on by one period. A step back of jitter, which the next rows make good, is
    left to the fit.
    """
    # of rows without a time each takes a period
    steps, shift = np.diff(t) - (np.diff(at) - 1) / rate, np.zeros(len(t))
    silence = max(LOST[0] / rate, LOST[1])
    if 2 * np.count_nonzero(steps < 0) > len(steps):
        raise table.error("time goes back in most rows", "reverse them, or use another column")
    while len(back := _set_back(steps, 1 / rate, silence)):
        shift[back + 1] = 1 / rate - steps[back]
        steps[back] = 1 / rate
    set_back = [(int(rows[i]), float(1 / rate - shift[i])) for i in np.flatnonzero(shift)]
    t = t + np.cumsum(shift)
    first = np.append(0, 1 + np.flatnonzero(steps > silence))
    each = np.diff(np.append(first, len(t)))
    mean = np.repeat(np.add.reduceat(t, first) / each, each)
    k = at - np.repeat(np.add.reduceat(at, first) / each, each)
    period = float(k @ (t - mean)) / max(float(k @ k), 1.0)
    if not abs(period * rate - 1) <= MOST_DRIFT:
        found = f"{1 / period:.6g} Hz" if period > 0 else "no rate at all"
        remedy = "correct rate; a file that lacks rows cannot be read by its rate"
        raise table.error(f"the rows come at {found}, not {rate:g} Hz", remedy)
    even = mean + period * k
    return even, _facts(1 / (period * rate) - 1, t - even) | {
        "rate": 1 / period,
        "set_back": set_back,
    }


def _set_back(steps: Array, period: float, silence: float) -> Rows:
    """Return the rows after which a clock was set back, one in 15 rows at most.

    There the times fall behind by half of the step back or more, from the median of 15
    rows to that of the next, and by more than six standard deviations of jitter.
    """
    if not len(back := np.flatnonzero(steps < 0)):
        return back
    late = np.append(0.0, np.cumsum(np.where(steps > silence, 0.0, steps - period)))
    ends = np.full(LEVEL, np.nan)
    near = np.lib.stride_tricks.sliding_window_view(np.concatenate([ends, late, ends]), LEVEL)
    parts = np.array_split(back + 1, 1 + len(back) // (1 << 16))  # to save memory
    falls = [np.nanmedian(near[i], 1) - np.nanmedian(near[i + LEVEL], 1) for i in parts]
    jitter = 3 * np.median(np.abs(steps - np.median(steps)))
    back = back[np.concatenate(falls) > np.maximum((period - steps[back]) / 2, jitter)]
    groups = np.split(back, np.flatnonzero(np.diff(back) > LEVEL) + 1)
    return np.array([g[np.argmin(steps[g])] for g in groups if len(g)], dtype=np.int64)


def _facts(drift: float, apart: Array) -> dict[str, Any]:
    return {
        "drift": drift,
        "residual_rms": float(np.sqrt(np.mean(apart**2))),
        "residual_max": float(np.abs(apart).max()),
    }
