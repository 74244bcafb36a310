"""Run time against error: every method of a problem with its own knob, each a point for
the error it has and the time it takes.

A problem (``benchmarks/problems``) has a reference from another route: a formula,
mpmath, long double.  Errors and times are measured in separate runs; times by jobs that
take turns.  What fails is a row that says so.
"""

from __future__ import annotations

import csv
import io
import math
import os
import textwrap
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from problems import ALL
from problems.problem import Method, Problem
from timing import interleaved, machine, medians

from stimlib.analysis.overview import check_place, save
from stimlib.errors import UnknownName
from stimlib.system import safe_files
from stimlib.system.progress import progress

if TYPE_CHECKING:
    from rich.table import Table

FLOOR = 1e-17
"""Where an error of exactly 0 is drawn."""


class Point(NamedTuple):
    """A row of the table."""

    problem: str
    family: str
    knob: str
    error: float
    """nan where it failed."""
    ns: float
    """Of the processor's time, for each sample; the median."""
    failed: str = ""


def measure(problem: Problem, rounds: int = 7, timed: bool = True) -> list[Point]:
    """Errors of all methods of a problem, and then their times.

    Parameters
    ----------
    problem : Problem
    rounds : int
        How often each is timed.
    timed : bool
        False: errors alone, for tests; times are nan.

    Returns
    -------
    list of Point

    Examples
    --------
    >>> from precision import Method, Problem, measure
    >>> half = Method("half", "1", lambda: None, lambda: 0.5)
    >>> measure(Problem("p", "a problem", "error", 10, lambda: [half]), timed=False)[
    ...     0
    ... ].error
    0.5
    """
    methods = problem.methods()
    found = [_error(m) for m in methods]
    sound = {k: m.job for k, m in enumerate(methods) if not found[k][1]}
    took = (
        medians(
            interleaved(
                {str(k): job for k, job in sound.items()}, rounds, 1, time.process_time, ahead=1e-3
            )
        )
        if timed
        else {}
    )
    return [
        Point(
            problem.name,
            m.family,
            m.knob,
            error,
            took.get(str(k), math.nan) / problem.samples * 1e9,
            failed,
        )
        for k, (m, (error, failed)) in enumerate(zip(methods, found, strict=True))
    ]


def _error(m: Method) -> tuple[float, str]:
    try:
        with np.errstate(all="ignore"):
            error = float(m.error())
    except Exception as e:  # of a package that is measured: a row, not the end of the table
        return math.nan, f"{type(e).__name__}: {e}"
    return (error, "") if math.isfinite(error) else (math.nan, "not finite")


# What becomes of it -------------------------------------------------------------------
def problems(only: Iterable[str] = ()) -> list[Problem]:
    """All problems, or those named.

    Raises
    ------
    UnknownName
        No problem of that name.

    Examples
    --------
    >>> from precision import problems
    >>> [p.name for p in problems(["bumps"])]
    ['bumps']
    """
    known = {p.name: p for p in ALL}
    if unknown := [name for name in only if name not in known]:
        raise UnknownName(f"no problem {', '.join(unknown)}; there are {', '.join(known)}")
    return [known[name] for name in only] or list(ALL)


def beaten(points: Iterable[Point]) -> list[tuple[Point, Point]]:
    """Each of our points that another beats, in error and in time by a tenth or more,
    and the fastest that does.

    Points of one value of the knob where that is part of what is asked; JAX is left
    out, as in ``best``.

    Examples
    --------
    >>> from precision import Point, beaten
    >>> ours = Point("p", "stimlib x", "1", 1e-6, 2.0)
    >>> slow, fast = (
    ...     Point("p", "numpy", "1", 1e-9, 1.9),
    ...     Point("p", "scipy", "1", 1e-6, 1.0),
    ... )
    >>> [(a.knob, b.family) for a, b in beaten([ours, slow, fast])]
    [('1', 'scipy')]
    """
    found, asked = [], {p.name for p in problems() if p.asked}
    points = [p for p in points if "JAX" not in p.family and not p.failed]
    for ours in (p for p in points if p.family.startswith("stimlib")):
        above = [
            q
            for q in points
            if q.problem == ours.problem
            and not q.family.startswith("stimlib")
            and (q.knob == ours.knob or ours.problem not in asked)
            and q.error <= 1.01 * ours.error
            and q.ns <= 0.9 * ours.ns
        ]
        if above:
            found.append((ours, min(above, key=lambda q: q.ns)))
    return found


def sentences(points: list[Point]) -> dict[str, str]:
    """What the recording of each problem says, in words: our most accurate point and
    the peer beside it, the most accurate peer, and where ours are beaten.

    Examples
    --------
    >>> from precision import Point, sentences
    >>> rows = [
    ...     Point("arm", "stimlib x, fs", "1", 1e-6, 2.0),
    ...     Point("arm", "scipy", "", 2e-6, 3.0),
    ... ]
    >>> print(sentences(rows)["arm"])
    stimlib's most accurate point, x, fs 1, has an error of 1e-06. No peer is as
    accurate: the nearest, scipy (2e-06), takes 1.5 times the time. No peer is as
    accurate as a point of stimlib and faster.
    """
    found, asked = {}, {p.name for p in problems() if p.asked}
    for b in best(points):
        here = [p for p in points if p.problem == b.problem and not p.failed]
        ours = [p for p in here if p.family.startswith("stimlib") and "JAX" not in p.family]
        mine = _method(b.ours).removeprefix("stimlib").strip(", ")
        text = f"stimlib's most accurate point, {mine}, has an error of {b.ours.error:.2g}."
        if b.other:
            text += (
                " The fastest peer that is as accurate"
                if b.reached
                else " No peer is as accurate: the nearest"
            ) + _takes(b.other, b.ours)
        peers = [p for p in here if "JAX" not in p.family and p not in ours]
        peers = [p for p in peers if p.knob == b.ours.knob or b.problem not in asked]
        least = min((p.error for p in peers), default=b.ours.error)
        exact = min([p for p in peers if p.error <= 1.01 * least] or [b.ours], key=lambda p: p.ns)
        if exact is not b.other and exact.error < 0.7 * b.ours.error:
            text += " The most accurate peer" + _takes(exact, b.ours)
        lost: dict[tuple[str, str], list[str]] = {}
        for own, better in beaten(here):
            lost.setdefault((own.family, better.family), []).append(own.knob)
        count = sum(map(len, lost.values()))
        text += (
            f" Peers are as accurate as {count} of stimlib's {len(ours)} points, and faster: "
            + "; ".join(
                f"{c} for {a.removeprefix('stimlib').strip(', ')} {', '.join(k)}".strip()
                for (a, c), k in lost.items()
            )
            + "."
            if lost
            else " No peer is as accurate as a point of stimlib and faster."
        )
        found[b.problem] = "\n".join(textwrap.wrap(text, 86, break_on_hyphens=False))
    return found


def _takes(p: Point, ours: Point) -> str:
    ratio = p.ns / ours.ns
    times = f"{ratio:.2g}" if ratio < 100 else f"{ratio:.0f}"
    return f", {_method(p)} ({p.error:.2g}), takes {times} times the time."


def _method(p: Point) -> str:
    return f"{p.family} {p.knob}".strip()


class Best(NamedTuple):
    """A problem in one line: our most exact point, and the fastest of others that come
    as near, or the nearest of them.
    """

    problem: str
    ours: Point
    other: Point | None
    reached: bool
    """Whether the other's error is no larger than ours, but for a hundredth."""

    @property
    def times(self) -> float:
        """How many times as long the other takes."""
        return math.nan if self.other is None else self.other.ns / self.ours.ns


def best(points: Iterable[Point]) -> list[Best]:
    """One line for each problem, of the processor's points: what runs on JAX is neither
    ours nor another's.

    Where the knob is part of what is asked, both have the same.  Where all of ours
    failed, one of them stands there, with nan.

    Examples
    --------
    >>> from precision import Point, best
    >>> rows = [
    ...     Point("p", "stimlib x", "1", 1e-9, 2.0),
    ...     Point("p", "scipy", "1", 1e-3, 5.0),
    ...     Point("p", "numpy", "1", 1e-9, 8.0),
    ... ]
    >>> [(b.other.family, b.reached, b.times) for b in best(rows)]
    [('numpy', True, 4.0)]
    """
    found, asked = [], {p.name for p in problems() if p.asked}
    points = [
        p
        for p in points
        if "JAX" not in p.family and (not p.failed or p.family.startswith("stimlib"))
    ]
    for name in dict.fromkeys(p.problem for p in points):
        own = [p for p in points if p.problem == name and p.family.startswith("stimlib")]
        others = [p for p in points if p.problem == name and not p.family.startswith("stimlib")]
        if not own:
            continue
        ours = min([p for p in own if not p.failed] or own[:1], key=lambda p: p.error)
        if name in asked:
            others = [p for p in others if p.knob == ours.knob]
        near = [p for p in others if p.error <= 1.01 * ours.error]
        nearest = (
            min(near, key=lambda p: p.ns)
            if near
            else min(others, key=lambda p: p.error, default=None)
        )
        found.append(Best(name, ours, nearest, bool(near)))
    return found


def table(points: Iterable[Point]) -> Table:
    """``summary`` for a terminal, without titles.

    Examples
    --------
    >>> from precision import Point, table
    >>> table([Point("pink", "stimlib x", "1", 1e-9, 2.0)]).row_count
    1
    """
    from rich.table import Table

    head = "stimlib", "error", "beside it", "error", "times as long", "beaten"
    out = Table("operator", "what the error is", *head)
    for name, _, *row in summary(list(points)):
        out.add_row(name, *row)
    return out


def summary(points: list[Point]) -> list[tuple[str, ...]]:
    """``best`` as text: name, operator, what the error is; method and error of ours,
    and of the other; how many times as long the other takes; how many of our points
    are beaten.

    Examples
    --------
    >>> from precision import Point, summary
    >>> summary(
    ...     [
    ...         Point("pink", "stimlib x, tol", "1", 1e-9, 2.0),
    ...         Point("pink", "scipy", "", 1e-3, 5.0),
    ...     ]
    ... )[0][2:]
    ('largest deviation from 3 dB/oct, dB', 'stimlib x, tol 1', '1.0e-09', 'scipy',
     '1.0e-03', '2.5', '0 of 1')
    """
    known = {p.name: p for p in problems()}
    lines = []
    for b in best(points):
        here = [p for p in points if p.problem == b.problem]
        ours = [p for p in here if p.family.startswith("stimlib") and "JAX" not in p.family]
        other = (
            (_method(b.other), f"{b.other.error:.1e}", f"{b.times:.2g}") if b.other else ("",) * 3
        )
        mine = _method(b.ours), f"{b.ours.error:.1e}"
        lost = f"{len(beaten(here))} of {len(ours)}"
        lines.append((b.problem, *known[b.problem][1:3], *mine, *other, lost))
    return lines


def spoken(points: list[Point]) -> str:
    """``sentences`` as substitutions for the page."""
    return "".join(
        f".. |{name}| replace:: {text.replace(chr(10), chr(10) + '   ')}\n"
        for name, text in sentences(points).items()
    ).replace("*", "\\*")


def record(points: list[Point], path: str | os.PathLike) -> None:
    """Write a table as CSV, below a line with machine and versions, whole or not at
    all.

    Raises
    ------
    SinkError
        It cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from precision import Point, record
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "p.csv"
    >>> record([Point("p", "ours", "1e-3", 1e-4, 2.0)], path)
    >>> path.read_text().splitlines()[1:]
    ['problem,family,knob,error,ns,failed', 'p,ours,1e-3,0.0001,2.0,']
    """
    text = io.StringIO()
    busy = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    loaded = ", beside other work: only ratios count" if busy > 0.75 * (os.cpu_count() or 1) else ""
    text.write(f"# {machine()}{loaded}\n")
    out = csv.writer(text, lineterminator="\n")
    out.writerow(Point._fields)
    out.writerows(points)
    safe_files.publish(path, text.getvalue())


def recorded(folder: str | os.PathLike) -> list[Point]:
    """Read what ``regenerate`` left of all problems in a folder.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from precision import Point, record, recorded
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> record([Point("pink", "ours", "1e-3", 1e-4, 2.0)], folder / "pink.csv")
    >>> recorded(folder)
    [Point(problem='pink', family='ours', knob='1e-3', error=0.0001, ns=2.0, failed='')]
    """
    rows: list[dict[str, str]] = []
    for p in problems():
        path = Path(folder) / f"{p.name}.csv"
        if path.exists():
            rows += csv.DictReader(path.read_text().splitlines()[1:])
    return [
        Point(r["problem"], r["family"], r["knob"], float(r["error"]), float(r["ns"]), r["failed"])
        for r in rows
    ]


def picture(problem: Problem, points: list[Point], path: str | os.PathLike) -> None:
    """Draw a problem: error on x, time for a sample on y, both logarithmic; a family is
    a line, what failed is at the right.

    Raises
    ------
    SinkError
        The file cannot be written, or has another suffix than .png, .svg or .pdf.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from precision import Point, Problem, picture
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "p.png"
    >>> picture(
    ...     Problem("p", "a problem", "error", 10, list),
    ...     [Point("p", "ours", "1e-3", 1e-4, 2.0)],
    ...     path,
    ... )
    >>> path.stat().st_size > 5000
    True
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    fig: Any = Figure(figsize=(8, 4.4), layout="constrained")
    ax = fig.subplots()
    families = list(dict.fromkeys(p.family for p in points))
    for k, name in enumerate(families):
        good = [p for p in points if p.family == name and not p.failed]
        style = {"color": f"C{k % 10}", "marker": "osD^vPX*<>"[k % 10], "ms": 5}
        own = name.startswith("stimlib")
        if good:
            errors = [max(p.error, FLOOR) for p in good]
            ax.plot(
                errors,
                [p.ns for p in good],
                label=name,
                lw=2 if own else 1,
                zorder=3 if own else 2,
                **style,
            )
            for p in (good[0], good[-1])[: len(good)]:
                where = (max(p.error, FLOOR), p.ns)
                ax.annotate(
                    p.knob,
                    where,
                    xytext=(4, 4),
                    textcoords="offset points",
                    fontsize=6,
                    color="0.35",
                )
        for p in points:
            if p.family == name and p.failed:
                ax.plot(
                    [0.98], [0.05 + 0.07 * k], "x", color=style["color"], transform=ax.transAxes
                )
    ax.set(xscale="log", yscale="log", xlabel=problem.error, ylabel=f"ns {problem.per}")
    ax.set_title(problem.title, loc="left", fontsize=10)
    ax.grid(alpha=0.3)
    fig.legend(loc="outside right upper", fontsize=7, frameon=False)
    fig.supxlabel(machine(), fontsize=5, color="0.4")
    with rc_context({"svg.fonttype": "none"}):
        save(fig, path)


def regenerate(
    folder: str | os.PathLike, only: Iterable[str] = (), rounds: int = 7, shown: bool | str = True
) -> list[Point]:
    """Measure problems and leave NAME.csv and work_NAME.svg of each in a folder; a
    progress bar where that is a terminal.

    Raises
    ------
    UnknownName
        No problem of that name.
    SinkError
        A file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from precision import regenerate
    >>> regenerate(tempfile.mkdtemp(), ["table"], rounds=1)[0].family
    'stimlib lut linear, knots'
    """
    wanted, place, found = problems(only), Path(folder), []
    for p in wanted:
        check_place(place / f"work_{p.name}.svg")
    with progress("measuring", len(wanted), shown) as advance:
        for p in wanted:
            advance(0, p.title)
            points = measure(p, rounds)
            record(points, place / f"{p.name}.csv")
            picture(p, points, place / f"work_{p.name}.svg")
            found += points
            advance(1)
    return found
