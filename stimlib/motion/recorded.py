"""Recorded motion: time-stamped files and tables as functions of time.

Reports of touchpads, pens, load cells and encoders come at 10-1000 Hz with jitter,
gaps, repeats and lifts. If the last report is held, its differences at 8 kHz have
spikes a hundred times the true velocity. Each stretch in contact is therefore
interpolated by a piecewise cubic (PCHIP) that neither overshoots the reports nor
reverses between them. Like a generator, a recording is a pure function of time: its
bits do not depend on how the time axis is divided.

Terms: a *report* is one row; a *stretch* is a run of reports in contact, without a lift
or a jump.
"""

import ast
import inspect
import os
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Any, Literal

import numpy as np

from ..errors import BadValue, UnknownName, public, shown
from .cells import Missing
from .gaps import filled
from .generators import Motion
from .pchip import cubics
from .reports import (
    FASTEST,
    Clock,
    Mask,
    Reports,
    check_gaps,
    check_period,
    hold_silences,
    joined,
    known_in,
    lifts,
    series,
)
from .rows import LOST, Array
from .source import HAND
from .table import Columns, TableFile, read_table
from .text import MAX_SPEC, parse_motion, served_by

LIFTED = {"m": "hold", "1": "hold", "N": "zero", "Pa": "zero"}
"""What an input is off contact, by its unit: a position or an angle stays where it
was, and a force or a pressure is 0.
"""


MANY = 1000  # times: fewer are found one by one, which begins sooner
PIECE = 8192  # times at once: more would leave the cache between two operations


def pieces(knots: Array, t: Array) -> tuple[Callable[[Any], Any], Array]:
    """Return a function that takes, of a row with a value a knot, those at times t.

    Many times that rise, as those of a rendering do, take a search for each knot
    between them, not one for each time, and values are repeated: half of the time. The
    times are returned too, none of them before the first knot or after the last.
    """
    rising = t.size >= MANY and bool((t[1:] >= t[:-1]).all())
    if not (rising and knots[0] <= t[0] and t[-1] <= knots[-1]):
        t = np.clip(t, knots[0], knots[-1])
    if not rising:
        k = np.searchsorted(knots, t, side="right") - 1
        return lambda c: c[k], t
    first, last = knots.searchsorted(t[[0, -1]], side="right")
    times = t.size - t.searchsorted(knots[first - 1 : last])  # from each knot on
    times[:-1] -= times[1:]
    return lambda c: c[first - 1 : last].repeat(times), t


class _Recorded(Motion):
    """A recorded motion between knots, whose repr recreates it."""

    info: Mapping[str, Any]

    def __init__(self, knots: Array, values: Array | Mask, spec: str):
        self._knots, self._values, self._spec = knots, values, spec

    def __repr__(self) -> str:
        return self._spec


class RecordedInput(_Recorded):
    """A recorded position over time, cubic between knots and constant outside."""

    def _position(self, t: Array) -> Array:
        if t.size > PIECE:
            x = np.empty(t.size)
            for k in range(0, t.size, PIECE):
                x[k : k + PIECE] = self._position(t[k : k + PIECE])
            return x
        at, t = pieces(self._knots, t)
        u, y = t - at(self._knots), at(self._values[0])
        for c in self._values[1:]:
            y *= u
            y += at(c)
        return y


class Contact(_Recorded):
    """Contact over time, 1 in contact and 0 off contact."""

    def _position(self, t: Array) -> Array:
        return pieces(self._knots, t)[0](self._values).astype(np.float64)


class Released(_Recorded):
    """A recorded force over time, 0 off contact."""

    def __init__(self, force: RecordedInput, contact: Contact, spec: str):
        self._force, self._contact, self._spec, self.info = force, contact, spec, force.info

    def _position(self, t: Array) -> Array:
        return self._force._position(t) * self._contact._position(t)


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """A recorded motion, made by `recording`.

    Its repr is the call that recreates it, with the file's SHA-256; its str summarises
    the recording.

    Attributes
    ----------
    motion : dict of str to Motion
        For each mapped input, its value in the input's unit as a function of the time
        in s.
    contact : Motion
        1 in contact, 0 off contact and during jumps, as a function of the time in s.
    duration : float, s
        Time of the last report; the first is at 0.
    has_lifts : bool
        Whether a report is off contact.
    info : dict
        file, sha256, columns (input to expression), time (expression), contact (column
        or None), reports (number used), repeats (number with the same time as the one
        before), start (s, the first report's own time stamp), period (s, median), rate
        (Hz, 1/period), silences (number held, with reports="on_change"), gaps (list of
        row and s: those silences that are longer than max_gap), lifts (list of row and
        time in s), jumps (list of row and speed, largest of the inputs, in the input's
        unit per second), lifted (input to what it is off contact, as it was stated),
        read (texts: what was skipped or assumed in the file), clock (with wrap, clock
        or rate: wraps, drift, residual_rms and residual_max in s, rate in Hz, set_back
        as a list of row and s).
    text : callable
        Returns the call that recreates the recording, with another ``lifted``.

    Examples
    --------
    See `recording`.
    """

    motion: dict[str, Motion]
    contact: Contact
    duration: float
    has_lifts: bool
    info: dict[str, Any]
    spec: str
    text: Callable[..., str]  # the call for other meanings of a lift

    def __repr__(self) -> str:
        return self.spec

    def __str__(self) -> str:
        i = self.info
        counts = {
            "equal times": i["repeats"],
            "silences held": i["silences"],
            "lifts": len(i["lifts"]),
            "jumps": len(i["jumps"]),
        }
        extra = "".join(f", {what}: {count}" for what, count in counts.items() if count)
        read = f" ({shown('; '.join(i['read']))})" if i["read"] else ""
        return (
            f"{shown(i['file'])}: {i['reports']} reports, {self.duration:.6g} s, median"
            f" {i['rate']:.4g} Hz{extra}{read}"
        )

    def motion_for(self, inputs: Iterable[str], contact: str = "") -> dict[str, Motion]:
        r"""Return the motion of a scene's inputs from this recording.

        Parameters
        ----------
        inputs : mapping of str to Input, or iterable of str
            The scene's inputs, ``scene.inputs``: off contact an input in N or Pa is 0,
            and one in m or rad is held, unless ``recording(lifted=)`` says otherwise. A
            name alone has no unit and is held. An input named ``contact`` gets
            `contact`. The column for ``x`` also drives ``x1``, ``x2``, ... if the scene
            has no ``x`` and the recording has no columns for them.
        contact : str
            A hint for the error message on how the scene gets an input ``contact``,
            such as ``"use bumps(contact=True)"``.

        Returns
        -------
        dict of str to Motion
            For `render`, `stream` and `file.write`.

        Raises
        ------
        UnknownName
            An input without a column, or a mapped input that the scene lacks.
        BadValue
            The recording has lifts or jumps, and the scene has no input for them; an
            input in another unit, of which ``lifted`` says nothing.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "press.csv")
        ...     _ = path.write_text("t_s,force_N\n0,1\n0.01,2\n0.02,4\n")
        ...     press = recording(path, {"x": "force_N*5e-4"})
        >>> list(press.motion_for(["x1", "x2"]))
        ['x1', 'x2']
        """
        names = list(inputs)
        sources: dict[str, Any] = {**self.motion, "contact": self.contact}
        served = {name: served_by(name, sources, names) for name in names}
        missing = [name for name, by in served.items() if by is None]
        surplus = [name for name in self.motion if name not in served.values()]
        if missing or surplus:
            wrong = [f"nothing is recorded for {name}" for name in missing] + [
                f"the scene has no input {n}" for n in surplus
            ]
            raise UnknownName(
                f"{self.info['file']}: {', '.join(wrong)}; the inputs are:"
                f" {', '.join(names) or 'none'}"
                + (f"; leave {', '.join(surplus)} out of the columns" if surplus else "")
            )
        if "contact" not in served.values():
            self._check_unbroken(contact)
        lifted, blocks = dict(self.info["lifted"]), inputs if isinstance(inputs, Mapping) else {}
        for name, by in served.items() if self.has_lifts or self.info["jumps"] else ():
            unit = str(getattr(blocks.get(name), "dim", "m"))
            if by in self.motion and lifted.setdefault(by, LIFTED.get(unit)) is None:
                raise BadValue(
                    f"{self.info['file']}: {name} is in {unit}, and what it is while the finger is"
                    f" lifted is not known; say lifted={{{by!r}: 'zero'}} or 'hold'"
                )
        lifted = {name: how for name, how in lifted.items() if how == "zero"}
        for name in lifted.keys() - self.info["lifted"].keys():
            spec = f"{self.text(lifted=self.info['lifted'] | lifted)}.motion[{name!r}]"
            sources[name] = Released(sources[name], self.contact, spec)
        return {name: sources[by] for name, by in served.items() if by is not None}

    def _check_unbroken(self, remedy: str) -> None:
        lifts, jumps = self.info["lifts"], self.info["jumps"]
        if not lifts and not jumps:
            return
        what = [
            f"{name} at row {found[0][0]} ({len(found)} in all)"
            for name, found in (("a lift", lifts), ("a jump", jumps))
            if found
        ]
        remedy = remedy or (
            "make it with contact=True (squeeze, bumps, viscoelastic), or give it an"
            ' Input("contact")'
        )
        remedy += ", or follow the point in the air with contact=False" if lifts else ""
        raise BadValue(
            f"{self.info['file']}: {' and '.join(what)}, and the scene has no input contact;"
            f" {remedy}"
        )


@public
def recording(
    source: str | os.PathLike[str] | Columns,
    columns: Mapping[str, str],
    *,
    where: Mapping[str, Any] | None = None,
    time: str = "t_s",
    contact: str | bool | None = None,
    reports: Literal["always", "on_change"] = "always",
    repeats: Literal["last", "mean", "spread"] | None = None,
    max_speed: float | Mapping[str, float | None] | None = HAND,
    max_gap: float | None = None,
    missing: Missing = "refuse",
    sentinels: Collection[float | str] = (),
    wrap: float | None = None,
    clock: str | None = None,
    rate: float | None = None,
    lifted: Mapping[str, Literal["hold", "zero"]] | None = None,
    sha256: str | None = None,
) -> Recording:
    r"""Read a recorded motion from a file or a table in memory.

    Between two reports in contact the position is a PCHIP cubic; before the first and
    after the last it is held. Off contact the position is held where contact was lost;
    before the first contact it is held where contact will be made. A force or a
    pressure is 0 there: ``motion_for(scene.inputs)`` knows it by its unit, and
    ``lifted`` says it.

    A step faster than ``max_speed`` is treated as a fault of the device, not as motion:
    the stretch ends there and contact is 0 until the next report, so that velocity
    estimates start anew. Many such jumps (3 or more, and more than 1 % of the reports,
    or nothing but jumps) mean that the unit is wrong, and raise an error.

    Parameters
    ----------
    source : path, DataFrame or mapping of str to array
        A ``.npz`` file holds one-dimensional arrays of equal length, by name; row
        numbers are their indices. A ``.mat`` file (version 5 to 7) has the vectors and
        matrices of MATLAB, an ``.xdf`` file (needs pyxdf) the channels of a stream, and
        a ``.c3d`` file (needs c3d) points and analog channels, both with their times
        ``t_s``. Any other file is read as text, packed by gzip or not:
        columns are separated by commas, semicolons, tabs, ``|`` or spaces, and a line
        above the rows has their names; row numbers are line numbers. Comments, lines
        above the names and a row of units are skipped, see ``info["read"]``. A table in
        memory (pandas, or any mapping of names to one-dimensional arrays) is treated
        like an npz file.
    columns : mapping of str to str
        For each input of the scene, a column in the input's unit, or a conversion:
        ``"force_N*5e-4"``, ``"(x_raw - 1472)*2e-5"``, ``"hypot(vx, vy)*1e-3"``. It has
        ``+ - * / **``, hypot, sqrt, abs, sin, cos, atan2, radians, min and max. Inputs
        may share a column. Quote names that are not words: ``"'Force (N)'*5e-4"``.
    where : mapping of column to value, optional
        Rows to use; numbers are compared as numbers, anything else as text.
    time : str
        Column of the time stamps, in s, or a conversion such as ``"t_ms*1e-3"`` or
        ``"sec + nsec*1e-9"``, or a column of times such as 12:30:00.5 or
        2026-05-01T12:30:00Z. The first report used is moved to time 0.
    contact : str or bool, optional
        Column that is 1 in contact and 0 in the air; by default "contact", if it
        exists. With False, the motion follows the position in the air as well.
    reports : {"always", "on_change"}
        The meaning of a silence. "always": the device reports all the time, so a
        silence in contact longer than max_gap is an error. "on_change": the device
        reports changes only, so after more than 2.5 median periods without a report the
        position is held, in contact, until one median period before the next report.
    repeats : {"last", "mean", "spread"}, optional
        What several reports with one time stamp are: corrections, of which the last
        counts; one report, their mean, in contact if all of them are; or reports of a
        clock that is too coarse, spread evenly up to the next stamp, or over the median
        time between stamps, if that is shorter. By default they must be equal.
    max_speed : float, None or mapping of input to float or None, m/s
        Largest speed of movement, in each input's unit per second; None for no limit. A
        mapping limits only its inputs, each in its own unit per second.
    max_gap : float, s, optional
        Longest silence that is interpolated if reports="always"; by default 10 median
        periods, at least 0.1 s. By default, a median period above 0.5 s is rejected
        because the time unit is probably wrong; a max_gap of at least the median period
        confirms the unit. It is also the longest time without a number, see
        ``missing``.
    missing : {"refuse", "gap", "hold", "interpolate"}
        The meaning of NaN, an empty cell, n/a, NA, null and ``sentinels`` in a column
        in use. "refuse": an error. "gap": no contact. "hold" and "interpolate": the
        input is held or interpolated within a touch, up to ``max_gap``. A row without a
        time is left out, one without contact is as the row before ("gap": no contact).
    sentinels : collection of float or str
        Numbers and texts that stand for a missing number, such as ``(-9999, ".")``.
    wrap : float, optional
        Count at which the time, or ``clock``, begins again at 0, in the column's unit:
        ``2**32``.
    clock : str, optional
        Column of a second clock in s, or a conversion such as ``"device_us*1e-6"``,
        without jitter. The times are then those of this clock, with the offset and the
        rate of ``time`` by least squares.
    rate : float, Hz, optional
        Nominal rate of rows that come evenly, although their time stamps have jitter or
        go back. The times are then even, and their rate is fitted to the stamps.
    lifted : mapping of input to {"hold", "zero"}, optional
        What an input is off contact and during jumps: held, or 0. By default
        ``motion_for(scene.inputs)`` decides by the input's unit.
    sha256 : str, optional
        First 8 to 64 hex digits of the file's SHA-256, which must match; for a table in
        memory, of the SHA-256 of its names and values.

    Raises
    ------
    RecordingError
        The table cannot be used, or is larger than ``stimlib.limits`` allow; the
        message names file, row, column and remedy.
    BadValue
        An argument is out of range or cannot be understood.

    References
    ----------
    F. N. Fritsch and J. Butland, "A method for constructing local monotone piecewise
    cubic interpolants", SIAM J. Sci. Stat. Comput. 5 (1984). Inside a stretch the speed
    is at most 1.5 times that between two reports, in its first and last interval at
    most 3 times.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "press.csv")
    ...     _ = path.write_text(
    ...         "t_s,force_N,contact\n0,1,1\n0.01,2,1\n0.03,4,1\n0.04,0,0\n"
    ...     )
    ...     press = recording(path, {"x": "force_N*5e-4"})
    >>> press.motion["x"]([0.0, 0.005, 0.02, 0.03, 0.1]).round(6).tolist()
    [0.0005, 0.00075, 0.0015, 0.002, 0.002]
    >>> press.contact([0.0, 0.02, 0.03, 0.1]).tolist()
    [1.0, 1.0, 0.0, 0.0]
    >>> press.info["lifts"]
    [(5, 0.04)]
    >>> print(
    ...     recording({"t_s": [0.0, 0.01, 0.02], "x_mm": [0, 1, 3]}, {"x": "x_mm*1e-3"})
    ... )
    dict in memory: 3 reports, 0.02 s, median 100 Hz
    """
    _check_options(columns, where, max_speed, max_gap, lifted)
    _check_clock(wrap, clock, rate)
    texts = [*columns.values(), time, *(t for t in (clock, contact) if isinstance(t, str))]
    table = read_table(source, sha256, known_in([*texts, *map(str, where or ())]))
    text = partial(
        _spec,
        table.file,
        table.sha256,
        columns,
        where=where or None,
        time=time,
        contact=contact,
        reports=reports,
        repeats=repeats,
        max_speed=max_speed,
        max_gap=max_gap,
        missing=missing,
        sentinels=tuple(sentinels),
        wrap=wrap,
        clock=clock,
        rate=rate,
    )
    spec = text(lifted=lifted or None)
    times = Clock(time, wrap, clock, rate)
    found = series(table, columns, where or {}, times, contact, repeats, missing, sentinels)
    table, read = table.closed(), [*found.notes]
    period = float(np.median(np.diff(found.t)))
    gap = max(LOST[0] * period, LOST[1]) if max_gap is None else float(max_gap)
    # a step between two stamps is rounded by as much
    gap += gap * 1e-9 + 2 * float(np.spacing(abs(found.start) + found.t[-1]))
    if max_gap is None or gap < period or period < FASTEST:
        check_period(table, found, period, time)
    if missing != "refuse":
        found, notes = filled(table, found, missing, gap)
        read += notes
    held, gaps = (
        check_gaps(table, found, gap) if reports == "always" else hold_silences(found, period, gap)
    )
    whole, jumps = joined(table, held, max_speed)
    step = Contact(held.t, np.append(whole, held.contact[-1]), f"{spec}.contact")
    duration, has_lifts = float(found.t[-1]), not bool(found.contact.all())
    info: dict[str, Any] = {
        "file": table.file,
        "sha256": table.sha256,
        "columns": dict(columns),
        "time": time,
        "contact": found.contact_column,
        "reports": len(found.t),
        "repeats": found.repeats,
        "start": found.start,
        "period": period,
        "rate": 1 / period,
        "silences": len(held.t) - len(found.t),
        "gaps": gaps,
        "lifts": lifts(found),
        "jumps": jumps,
        "duration": duration,
        "lifted": dict(lifted or {}),
        "read": read,
        "clock": dict(found.clock),
    }
    del found
    motion = _tracks(table, held, whole, spec)
    functions: list[Any] = [step, *motion.values()]
    for function in functions:
        function.info = info  # for a report: what was bridged on the way
    for name in (name for name, how in info["lifted"].items() if how == "zero"):
        motion[name] = Released(motion[name], step, repr(motion[name]))
    return Recording(motion, step, duration, has_lifts, info, spec, text)


def _tracks(table: TableFile, s: Reports, whole: Mask, spec: str) -> dict[str, Any]:
    """Return, for each input, the cubics between reports in contact."""
    t, x, rows = s.t, s.x, s.rows
    if not s.contact.all():
        at = np.flatnonzero(s.contact)
        # the interval after a report in contact is joined only if the next report is in
        # contact too
        t, x, rows, whole = t[at], x[:, at], rows[at], whole[at[:-1]]
    tracks: dict[str, Any] = {}
    for name, values in zip(s.inputs, x, strict=True):
        c = cubics(t, values, whole)
        for i in np.flatnonzero(~np.isfinite(c).all(axis=0)):
            remedy = "check time and units, or set max_speed"
            raise table.error(
                "the step to this report is too large for its time",
                remedy,
                rows[int(i) + 1],
            )
        tracks[name] = RecordedInput(t, c, f"{spec}.motion[{name!r}]")
    return tracks


@public
def parse_source(text: str, pinned: bool = False) -> Motion | Recording:
    """Parse a motion or a recording as written in a sidecar.

    Nothing is executed.

    Parameters
    ----------
    text : str
        A call of a generator, see `parse_motion`, or of `recording` with literal
        arguments, optionally followed by ``.motion['x']`` or ``.contact``.
    pinned : bool
        Whether a recording must state the SHA-256 of its file, as it should if the text
        comes from someone else.

    Returns
    -------
    Motion or Recording

    Raises
    ------
    BadValue
        The text is anything else.
    RecordingError
        As `recording`; or the file is missing or has another SHA-256.

    Examples
    --------
    >>> parse_source("sinusoid(0.01, 1)")
    sinusoid(amplitude=0.01, freq=1.0, mean=0.0, phase=0.0)
    >>> parse_source("recording('press.csv', {'x': 'force_N*5e-4'}).motion['x']")
    Traceback (most recent call last):
    stimlib.errors.RecordingError: press.csv: cannot be read (No such file or ...
    """
    part: Any = None
    try:
        short = isinstance(text, str) and len(text) <= MAX_SPEC
        match ast.parse(text.strip(), mode="eval").body if short else None:
            case ast.Attribute(ast.Call(ast.Name("recording")) as call, "contact"):
                part = "contact"
            case ast.Subscript(
                ast.Attribute(ast.Call(ast.Name("recording")) as call, "motion"),
                ast.Constant(str() as part),
            ):
                pass
            case ast.Call(ast.Name("recording")) as call:
                pass
            case _:
                return parse_motion(text)
        words = inspect.signature(recording).bind(
            *map(ast.literal_eval, call.args),
            **{str(k.arg): ast.literal_eval(k.value) for k in call.keywords},
        )
    except (SyntaxError, RecursionError, MemoryError):
        return parse_motion(text)  # whose error names what is wrong
    except (TypeError, ValueError) as e:
        if isinstance(e, BadValue):
            raise
        form = "recording('press.csv', {'x': 'force_N*5e-4'})"
        raise BadValue(
            f"{text[:80]!r} cannot be read as a recording ({e}): write literal arguments, such as"
            f" {form}"
        ) from None
    if pinned and words.arguments.get("sha256") is None:
        raise BadValue(f"{text[:80]!r} does not have the SHA-256 of its file")
    made = recording(*words.args, **words.kwargs)
    known: dict[Any, Any] = {None: made, "contact": made.contact, **made.motion}
    if part not in known:
        raise BadValue(f"{text[:80]!r}: nothing is recorded for {part!r}")
    return known[part]


# -- arguments


def _check_options(columns: Any, where: Any, max_speed: Any, max_gap: Any, lifted: Any) -> None:
    """Check what the types of the arguments leave open."""
    example = 'such as {"x": "force_N*5e-4"}'
    if not columns:
        raise BadValue(
            f"columns must map each input of the scene to a column, {example}, got {columns!r}"
        )
    for name, text in columns.items():
        if not isinstance(name, str) or not isinstance(text, str):
            raise BadValue(f"columns must map names to texts, {example}, got {name!r}: {text!r}")
    if "contact" in columns:
        raise BadValue(
            "contact is not interpolated, so it cannot be in columns: use"
            f" contact={columns['contact']!r}"
        )
    plain = isinstance(where, Mapping) and all(
        isinstance(v, str | int | float | np.generic) for v in where.values()
    )
    if where is not None and not plain:
        raise BadValue(
            f'where must map columns to numbers or texts, such as {{"trial": 1}}, got {where!r}'
        )
    speeds = max_speed if isinstance(max_speed, Mapping) else {}
    for what, names in (("max_speed", speeds), ("lifted", lifted or {})):
        if wrong := [name for name in names if name not in columns]:
            raise BadValue(
                f"{what}: columns has no input {wrong[0]!r}; it has {', '.join(columns)}"
            )
    for value in speeds.values() if speeds is max_speed else [max_speed]:
        if value is not None and not 0 < value < float("inf"):
            raise BadValue(
                f"max_speed must be finite and above 0, in m/s, or None for no limit, got {value!r}"
            )
    if max_gap is not None and not 0 < max_gap < float("inf"):
        raise BadValue(f"max_gap must be finite and above 0, in s, got {max_gap!r}")


def _check_clock(wrap: Any, clock: Any, rate: Any) -> None:
    for name, value in (("wrap", wrap), ("rate", rate)):
        if value is not None and not 0 < value < float("inf"):
            raise BadValue(f"{name} must be finite and above 0, got {value!r}")
    if clock is not None and rate is not None:
        raise BadValue("give either clock or rate: both make the times even")


def _spec(file: str, sha256: str, columns: Mapping[str, str], **options: Any) -> str:
    """Return the call, on one line, that recreates this recording."""
    usual = inspect.signature(recording).parameters
    given = [f"{n}={_plain(v)!r}, " for n, v in options.items() if v != usual[n].default]
    return f"recording({file!r}, {dict(columns)!r}, {''.join(given)}sha256={sha256[:16]!r})"


def _plain(value: Any) -> Any:
    """Return a value with plain Python numbers, whose repr any program can read."""
    if isinstance(value, Mapping):
        return {name: _plain(v) for name, v in value.items()}
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    value = value.item() if isinstance(value, np.generic) else value
    return str(value) if value in (inf, -inf) or value != value else value
