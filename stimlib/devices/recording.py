"""Recorded motion: CSV and npz files with their own time stamps, as positions at any time.

Reports of touchpads, pens, load cells and encoders come at 10-1000 Hz with jitter, gaps, repeats and lifts. Holding them
and taking differences at 8 kHz gives spikes a hundred times the true velocity, so each stretch in contact is joined by a
piecewise cubic (PCHIP) that neither overshoots the reports nor reverses between them. Like a generator, a recording is a
pure function of time: the same bits in any cut of the time axis.

Terms: a *report* is one row; a *stretch* is a run of reports in contact, without a lift or a jump.
"""

import ast
import csv
import hashlib
import io
import os
import re
import unicodedata
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, isfinite
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..errors import BadValue, RecordingError, UnknownName
from .motion import Motion

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Mask = NDArray[np.bool_]
Cells = Sequence[str] | NDArray[Any]

SILENCE = 2.5  # median periods without a report; up to 2 also come from the device's clock, in the middle of a motion
GAP_PERIODS, GAP_SECONDS = 10, 0.1  # default of max_gap: so many median periods, at least so long
JUMPS, JUMP_SHARE = 3, 0.01  # so many jumps, and more than this share of the reports, are not faults of the device
EMPTY = "give a file with a line of column names and at least two rows"
MAX_EXPRESSION = 1000  # characters


class Track(Motion):
    """A recorded position as a function of time: a cubic from knot to knot, constant outside."""

    info: Mapping[str, Any]

    def __init__(self, knots: Array, coefficients: Array, spec: str):
        self._knots, self._coefficients, self._spec = knots, coefficients, spec

    def __repr__(self) -> str:
        return self._spec

    def _position(self, t: Array) -> Array:
        t = np.clip(t, self._knots[0], self._knots[-1])
        k = np.searchsorted(self._knots, t, side="right") - 1
        u = t - self._knots[k]
        c3, c2, c1, c0 = (c[k] for c in self._coefficients)
        return ((c3 * u + c2) * u + c1) * u + c0


class Contact(Motion):
    """1 in contact and 0 off contact, as a function of time."""

    info: Mapping[str, Any]

    def __init__(self, knots: Array, values: Array, spec: str):
        self._knots, self._values, self._spec = knots, values, spec

    def __repr__(self) -> str:
        return self._spec

    def _position(self, t: Array) -> Array:
        k = np.searchsorted(self._knots, t, side="right") - 1
        return self._values[np.maximum(k, 0)]


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """What `recording` gives. Its repr is the call that makes it again, with the file's SHA-256; its str says what was found.

    Attributes
    ----------
    motion : dict of str to Motion
        Per mapped input, its value in the input's unit as a function of the time in s.
    contact : Motion
        1 in contact, 0 off contact and during jumps, as a function of the time in s.
    duration : float, s
        Time of the last report; the first is at 0.
    has_lifts : bool
        Whether a report is off contact.
    info : dict
        file, sha256, columns (input to expression), time (expression), contact (column or None), reports (how many are
        used), repeats (how many were dropped), start (s, the first report's own time stamp), period (s, median), rate
        (Hz, 1/period), silences (how many were held, with reports="on_change"), gaps (list of row and s: those silences
        that are longer than max_gap), lifts (list of row and time in s), jumps (list of row and speed, largest of the
        inputs, in the input's unit per second).

    Examples
    --------
    See `recording`.
    """

    motion: dict[str, Motion]
    contact: Motion
    duration: float
    has_lifts: bool
    info: dict[str, Any]
    spec: str

    def __repr__(self) -> str:
        return self.spec

    def __str__(self) -> str:
        i = self.info
        counts = {"repeats dropped": i["repeats"], "silences held": i["silences"]}
        counts |= {"lifts": len(i["lifts"]), "jumps": len(i["jumps"])}
        extra = "".join(f", {what}: {count}" for what, count in counts.items() if count)
        return f"{i['file']}: {i['reports']} reports, {self.duration:.6g} s, median {i['rate']:.4g} Hz{extra}"

    def for_inputs(self, inputs: Iterable[str]) -> dict[str, Motion]:
        """The motion of a scene.

        Parameters
        ----------
        inputs : iterable of str
            Names of the scene's inputs. One named ``contact`` gets `contact`. What is recorded for ``x`` serves ``x1``,
            ``x2``, ... where the scene has no ``x`` and the recording has nothing of their own.

        Returns
        -------
        dict of str to Motion
            For `render`, `stream` and `file.write`.

        Raises
        ------
        UnknownName
            An input without a column, or a mapped input that the scene does not have.
        BadValue
            The recording has lifts or jumps, and the scene has no input that could tell it.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "press.csv")
        ...     _ = path.write_text("t_s,force_N\\n0,1\\n0.01,2\\n0.02,4\\n")
        ...     press = recording(path, {"x": "force_N*5e-4"})
        >>> list(press.for_inputs(["x1", "x2"]))
        ['x1', 'x2']
        """
        names = list(inputs)
        sources = {**self.motion, "contact": self.contact}
        served = {name: _served_by(name, sources, names) for name in names}
        missing = [name for name, by in served.items() if by is None]
        surplus = [name for name in self.motion if name not in served.values()]
        if missing or surplus:
            wrong = [f"nothing is recorded for {name}" for name in missing] + [f"the scene has no input {n}" for n in surplus]
            raise UnknownName(f"{self.info['file']}: {', '.join(wrong)}; the inputs are: {', '.join(names) or 'none'}")
        if "contact" not in served.values():
            self._check_unbroken()
        return {name: sources[by] for name, by in served.items() if by is not None}

    def _check_unbroken(self) -> None:
        lifts, jumps = self.info["lifts"], self.info["jumps"]
        if not lifts and not jumps:
            return
        what = [f"a lift at row {lifts[0][0]} ({len(lifts)} in all)"] if lifts else []
        what += [f"a jump at row {jumps[0][0]} ({len(jumps)} in all)"] if jumps else []
        remedy = 'use squeeze(contact=True), or give the scene an Input("contact")'
        remedy += ", or follow the point in the air with contact=False" if lifts else ""
        raise BadValue(f"{self.info['file']}: {' and '.join(what)}, and the scene has no input contact; {remedy}")


def recording(
    path: str | os.PathLike[str],
    columns: Mapping[str, str],
    *,
    where: Mapping[str, Any] | None = None,
    time: str = "t_s",
    contact: str | bool | None = None,
    reports: Literal["always", "on_change"] = "always",
    max_speed: float | Mapping[str, float | None] | None = 1.0,
    max_gap: float | None = None,
    sha256: str | None = None,
) -> Recording:
    """Read a recorded motion.

    Between two reports in contact the position is a PCHIP cubic; before the first and after the last it is held. Off
    contact it is held where contact was lost, and before the first contact where contact will be made.

    A step that is faster than ``max_speed`` is a fault of the device, not a motion: the stretch ends there and contact
    is 0 until the next report, so that velocity estimates start anew. When there are many (3 or more, and more than 1 %
    of the reports, or nothing but jumps), the unit is wrong, which is an error.

    Two equal rows with one time stamp count once.

    Parameters
    ----------
    path : path
        A ``.npz`` file holds one-dimensional arrays of equal length, by name; row numbers are their indices. Anything
        else is read as CSV: UTF-8 text, commas, names in the first line; row numbers are line numbers.
    columns : mapping of str to str
        Per input of the scene, a column in the input's unit, or a linear conversion of one: ``"force_N*5e-4"``,
        ``"(x_raw - 1472)*2e-5"``. Inputs may share a column. Quote names that are not words: ``"'Force (N)'*5e-4"``.
    where : mapping of column to value, optional
        Rows to use; numbers are compared as numbers, anything else as text.
    time : str
        Column of the time stamps, in s, or a linear conversion such as ``"t_ms*1e-3"``. The first report used is moved to
        time 0.
    contact : str or bool, optional
        Column that is 1 in contact and 0 in the air; by default "contact", if there is one. False follows the position
        in the air.
    reports : {"always", "on_change"}
        What silence means. "always": the device reports all the time, so silence in contact beyond max_gap is an error.
        "on_change": nothing changed, so after more than 2.5 median periods without a report the point is held, in
        contact, until one median period before the next report.
    max_speed : float, None or mapping of input to float or None, m/s
        Largest speed of a hand, in the unit of every input per second; None for no limit. A mapping limits the inputs
        in it, each in its own unit per second.
    max_gap : float, s, optional
        Longest silence that is joined when reports="always"; by default 10 median periods, at least 0.1 s.
    sha256 : str, optional
        First 8 to 64 hex digits of the file's SHA-256, which must fit.

    Returns
    -------
    Recording

    Raises
    ------
    RecordingError
        When the file cannot be used; the message names file, row, column and remedy.
    BadValue
        When an argument is out of its range or cannot be understood.

    References
    ----------
    F. N. Fritsch and J. Butland, "A method for constructing local monotone piecewise cubic interpolants", SIAM J. Sci.
    Stat. Comput. 5 (1984). Inside a stretch the speed is at most 1.5 times that between two reports, in its first and
    last interval at most 3 times.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "press.csv")
    ...     _ = path.write_text("t_s,force_N,contact\\n0,1,1\\n0.01,2,1\\n0.03,4,1\\n0.04,0,0\\n")
    ...     press = recording(path, {"x": "force_N*5e-4"})
    >>> press.motion["x"]([0.0, 0.005, 0.02, 0.03, 0.1]).round(6).tolist()
    [0.0005, 0.00075, 0.0015, 0.002, 0.002]
    >>> press.contact([0.0, 0.02, 0.03, 0.1]).tolist()
    [1.0, 1.0, 0.0, 0.0]
    >>> press.info["lifts"]
    [(5, 0.04)]
    """
    _check_options(columns, where, contact, reports, max_speed, max_gap)
    table = _read(path, sha256)
    spec = _spec(table, columns, where, time, contact, reports, max_speed, max_gap)
    series = _series(table, columns, where or {}, time, contact)
    period = float(np.median(np.diff(series.t)))
    gap = max(GAP_PERIODS * period, GAP_SECONDS) if max_gap is None else float(max_gap)
    held, gaps = _check_gaps(table, series, gap) if reports == "always" else _hold_silences(series, period, gap)
    joined, jumps = _joined(table, held, _limits(held.inputs, max_speed))
    step = Contact(held.t, np.append(joined, held.contact[-1]).astype(np.float64), f"{spec}.contact")
    motion = _tracks(table, held, joined, spec)
    info: dict[str, Any] = {"file": table.file, "sha256": table.sha256, "columns": dict(columns), "time": time}
    info |= {"contact": series.contact_column, "reports": len(series.t), "repeats": series.repeats, "start": series.start}
    info |= {"period": period, "rate": 1 / period, "silences": len(held.t) - len(series.t)}
    info |= {"gaps": gaps, "lifts": _lifts(series), "jumps": jumps}
    functions: list[Any] = [step, *motion.values()]
    for function in functions:
        function.info = info  # for a report: what was bridged on the way
    return Recording(motion, step, float(series.t[-1]), not bool(series.contact.all()), info, spec)


def parse_map(items: Iterable[str]) -> dict[str, str]:
    """Column mappings written as INPUT=EXPRESSION, such as those typed on a command line.

    Parameters
    ----------
    items : iterable of str

    Returns
    -------
    dict of str to str
        ``columns`` of `recording`, which checks the expressions.

    Raises
    ------
    BadValue
        When an item has another form, or an input comes twice.

    Examples
    --------
    >>> parse_map(["x=force_N*5e-4", "y = (y_raw - 10)*2e-5"])
    {'x': 'force_N*5e-4', 'y': '(y_raw - 10)*2e-5'}
    """
    return _pairs(items, "map", "INPUT=COLUMN or INPUT=COLUMN*NUMBER, such as x=force_N*5e-4")


def parse_where(text: str) -> dict[str, str]:
    """A selection of rows written as COLUMN=VALUE,COLUMN=VALUE, such as one typed on a command line.

    Parameters
    ----------
    text : str

    Returns
    -------
    dict of str to str
        ``where`` of `recording`, which compares numbers as numbers.

    Raises
    ------
    BadValue
        When the text has another form, or a column comes twice.

    Examples
    --------
    >>> parse_where("grasp=pinch,level=easy,trial=1")
    {'grasp': 'pinch', 'level': 'easy', 'trial': '1'}
    """
    return _pairs(text.split(","), "where", "COLUMN=VALUE,COLUMN=VALUE, such as grasp=pinch,trial=1")


def _pairs(items: Iterable[str], what: str, form: str) -> dict[str, str]:
    if isinstance(items, str):
        raise BadValue(f"{what}: give a list of texts, not one text")
    found: dict[str, str] = {}
    for item in items:
        name, _, value = (part.strip() for part in item.partition("="))
        if not name or not value:
            raise BadValue(f"{what} {item!r}: write {form}")
        if name in found:
            raise BadValue(f"{what}: {name} is given twice, {found[name]!r} and {value!r}")
        found[name] = value
    return found


def _served_by(name: str, sources: Mapping[str, Any], names: list[str]) -> str | None:
    """The recorded name that an input gets: its own, or without its number."""
    stem = re.sub(r"[0-9]+\Z", "", name)
    if name in sources:
        return name
    return stem if stem in sources and stem not in names else None


# -- arguments


def _check_options(columns: Any, where: Any, contact: Any, reports: Any, max_speed: Any, max_gap: Any) -> None:
    example = 'such as {"x": "force_N*5e-4"}'
    if not isinstance(columns, Mapping) or not columns:
        raise BadValue(f"columns must map each input of the scene to a column, {example}, got {columns!r}")
    for name, text in columns.items():
        if not isinstance(name, str) or not isinstance(text, str):
            raise BadValue(f"columns must map names to texts, {example}, got {name!r}: {text!r}")
    if "contact" in columns:
        raise BadValue(f"contact is not interpolated, so it cannot be in columns: use contact={columns['contact']!r}")
    plain = isinstance(where, Mapping) and all(isinstance(v, str | int | float | np.generic) for v in where.values())
    if where is not None and not plain:
        raise BadValue(f'where must map columns to numbers or texts, such as {{"trial": 1}}, got {where!r}')
    if not (contact is None or isinstance(contact, str | bool)):
        raise BadValue(f"contact must be the name of a column, False to ignore it, or None, got {contact!r}")
    if reports not in ("always", "on_change"):
        raise BadValue(f'reports must be "always" or "on_change", got {reports!r}')
    if isinstance(max_speed, Mapping) and (surplus := [name for name in max_speed if name not in columns]):
        raise BadValue(f"max_speed: columns has no input {surplus[0]!r}; it has {', '.join(columns)}")
    for value in max_speed.values() if isinstance(max_speed, Mapping) else [max_speed]:
        if value is not None and not _is_positive(value):
            raise BadValue(f"max_speed must be finite and above 0, in m/s, or None for no limit, got {value!r}")
    if max_gap is not None and not _is_positive(max_gap):
        raise BadValue(f"max_gap must be finite and above 0, in s, got {max_gap!r}")


def _is_positive(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(0 < value < float("inf"))


def _spec(
    table: "_Table",
    columns: Mapping[str, str],
    where: Mapping[str, Any] | None,
    time: str,
    contact: str | bool | None,
    reports: str,
    max_speed: float | Mapping[str, float | None] | None,
    max_gap: float | None,
) -> str:
    """The call that makes this recording again, on one line."""
    words = [repr(table.file), repr(dict(columns))]
    if where:
        words.append(f"where={_plain(where)!r}")
    if time != "t_s":
        words.append(f"time={time!r}")
    if contact is not None:
        words.append(f"contact={contact!r}")
    if reports != "always":
        words.append(f"reports={reports!r}")
    if max_speed != 1.0:
        words.append(f"max_speed={_plain(max_speed)!r}")
    if max_gap is not None:
        words.append(f"max_gap={_plain(max_gap)!r}")
    words.append(f"sha256={table.sha256[:16]!r}")
    return f"recording({', '.join(words)})"


def _plain(value: Any) -> Any:
    """The same with numbers of Python, whose repr any program can read."""
    if isinstance(value, Mapping):
        return {name: _plain(v) for name, v in value.items()}
    return value.item() if isinstance(value, np.generic) else value


# -- expressions


@dataclass(frozen=True)
class _Linear:
    """scale * column + offset; a number where column is None."""

    column: str | None
    scale: float
    offset: float


def _expression(what: str, text: str, table: "_Table") -> _Linear:
    """The linear conversion that a text means; its column is one that the table has."""
    if text.strip() in table.cells:
        return _Linear(text.strip(), 1.0, 0.0)
    try:
        if len(text) > MAX_EXPRESSION:
            raise ValueError
        linear = _linear(ast.parse(text.strip(), mode="eval").body)
        if linear.column is None or linear.scale == 0 or not isfinite(linear.scale) or not isfinite(linear.offset):
            raise ValueError
    except (SyntaxError, ValueError, ArithmeticError, RecursionError, MemoryError):
        shown = repr(text) if len(text) <= 80 else f"a text of {len(text)} characters"
        raise BadValue(
            f"{what}: cannot read {shown}: write one column, times and plus finite numbers, such as force_N*5e-4 or "
            f"(x_raw - 1472)*2e-5, with quotes around a name that is not a word, such as 'Force (N)'*5e-4"
        ) from None
    return _Linear(_find(table, linear.column, what), linear.scale, linear.offset)


def _linear(node: ast.expr) -> _Linear:
    """Value of one node of the syntax tree; ValueError if it is not linear in one column."""
    if isinstance(node, ast.Name):
        return _Linear(node.id, 1.0, 0.0)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return _Linear(node.value, 1.0, 0.0)
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return _Linear(None, 0.0, float(node.value))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        return _times(_linear(node.operand), -1.0 if isinstance(node.op, ast.USub) else 1.0)
    if isinstance(node, ast.BinOp):
        return _binary(node.op, _linear(node.left), _linear(node.right))
    raise ValueError


def _binary(op: ast.operator, a: _Linear, b: _Linear) -> _Linear:
    if isinstance(op, ast.Sub):
        op, b = ast.Add(), _times(b, -1.0)
    if isinstance(op, ast.Add) and (a.column is None or b.column is None):
        return _Linear(a.column or b.column, a.scale + b.scale, a.offset + b.offset)
    if isinstance(op, ast.Mult) and a.column is None:
        return _times(b, a.offset)
    if isinstance(op, ast.Mult) and b.column is None:
        return _times(a, b.offset)
    if isinstance(op, ast.Div) and b.column is None:
        return _Linear(a.column, a.scale / b.offset, a.offset / b.offset)
    raise ValueError


def _times(a: _Linear, factor: float) -> _Linear:
    return _Linear(a.column, a.scale * factor, a.offset * factor)


def _find(table: "_Table", column: str, what: str) -> str:
    """The table's column of that name. Python reads a name in its NFKC form, in which the two signs for micro are one."""
    for name in table.cells:
        if column in (name, unicodedata.normalize("NFKC", name)):
            return name
    names = list(table.cells)
    remedy = "use one of those"
    if all(_number(name) is not None for name in names):
        remedy = "the first line must name the columns"
    elif len(names) == 1 and (mark := re.search(r"[;\t|]", names[0])):
        remedy = f"separate columns by commas, not by {mark.group()!r}"
    raise table.error(f"{what} needs column {column}, and there is none; the columns are: {_list(names)}", remedy)


# -- files


@dataclass(frozen=True)
class _Table:
    """A file as it is: cells by column name, and the number of each row."""

    file: str
    sha256: str
    cells: dict[str, Cells]
    rows: Rows

    def error(self, problem: str, remedy: str, row: Any = None, column: str | None = None) -> RecordingError:
        return _error(self.file, problem, remedy, row, column)


def _error(file: str, problem: str, remedy: str, row: Any = None, column: str | None = None) -> RecordingError:
    place = file + ("" if row is None else f", row {row}") + ("" if column is None else f", column {column}")
    return RecordingError(f"{place}: {problem}; {remedy}")


def _read(path: str | os.PathLike[str], sha256: str | None) -> _Table:
    if not isinstance(path, str | os.PathLike):
        raise BadValue(f"path must be the name of a file, got {path!r}")
    file = os.fsdecode(path)
    try:
        with open(file, "rb") as f:
            data = f.read()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise _error(file, f"cannot be read ({reason})", "give the name of a CSV or npz file") from None
    digest = hashlib.sha256(data).hexdigest()
    if sha256 is not None:
        _check_digest(file, digest, sha256)
    if not data.strip():
        raise _error(file, "the file is empty", EMPTY)
    cells, rows = _read_npz(file, data) if file.lower().endswith(".npz") else _read_csv(file, data)
    if not len(rows):
        raise _error(file, "there are names of columns and no rows", "give a file with at least two rows")
    return _Table(file, digest, cells, rows)


def _check_digest(file: str, digest: str, sha256: str) -> None:
    if not isinstance(sha256, str) or not re.fullmatch("[0-9a-fA-F]{8,64}", sha256):
        raise BadValue(f"sha256 must be the first 8 to 64 hex digits of the file's SHA-256, got {sha256!r}")
    if not digest.startswith(sha256.lower()):
        raise _error(file, f"SHA-256 is {digest[:16]}..., not {sha256}", "find the file that was meant, or leave out sha256")


def _read_csv(file: str, data: bytes) -> tuple[dict[str, Cells], Rows]:
    lines = csv.reader(io.StringIO(_text(file, data), newline=""), strict=True, skipinitialspace=True)
    names: list[str] = []
    body: list[list[str]] = []
    rows: list[int] = []
    blank = 0  # the first blank line since the last row; at the end they do no harm
    try:
        for fields in lines:
            if not any(f.strip() for f in fields) and len(fields) <= 1:
                blank = blank or lines.line_num
            elif not names:
                names = _check_header(file, [f.strip() for f in fields], blank)
            else:
                _check_fields(file, fields, names, lines.line_num, blank)
                body.append(fields)
                rows.append(lines.line_num)
    except csv.Error as error:
        raise _error(file, f"not CSV ({error})", "correct the row", lines.line_num) from None
    if not names:
        raise _error(file, "the file is empty", EMPTY)
    columns: list[Cells] = [list(c) for c in zip(*body, strict=True)] if body else [[] for _ in names]
    return dict(zip(names, columns, strict=True)), np.array(rows, dtype=np.int64)


def _text(file: str, data: bytes) -> str:
    remedy = "save it as CSV text in UTF-8"
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise _error(file, "UTF-16 text", remedy)
    if b"\0" in data:
        raise _error(file, "not a text file", f"{remedy}, or as .npz")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = data.count(b"\n", 0, error.start) + 1
        raise _error(file, f"not UTF-8 text, byte 0x{data[error.start]:02x}", remedy, row) from None


def _check_header(file: str, names: list[str], blank: int) -> list[str]:
    if blank:
        raise _error(file, "the line is blank", "put the names of the columns into the first line", blank)
    if twice := [name for i, name in enumerate(names) if name in names[:i]]:
        raise _error(file, f"{names.count(twice[0])} columns have this name", "rename all but one", 1, twice[0] or "''")
    return names


def _check_fields(file: str, fields: list[str], names: list[str], row: int, blank: int) -> None:
    if blank:
        raise _error(file, "the line is blank", "remove it", blank)
    if len(fields) != len(names):
        what = "missing" if len(fields) < len(names) else "surplus"
        where = names[len(fields)] if len(fields) < len(names) else None
        problem = f"{len(fields)} fields for {len(names)} columns, {what} field"
        remedy = "correct the row (decimals with a point, not a comma)"
        raise _error(file, problem, remedy, row, where)


def _read_npz(file: str, data: bytes) -> tuple[dict[str, Cells], Rows]:
    cells: dict[str, Cells] = {}
    name: str | None = None
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            for name in arrays.files:
                if name in cells:
                    raise _error(file, "two arrays have this name", "rename one", None, name)
                cells[name] = _check_array(file, name, arrays[name], cells)
    except (OSError, ValueError, EOFError, KeyError, AttributeError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        if isinstance(error, RecordingError):
            raise
        raise _error(file, f"cannot be read as npz ({error})", "save arrays of numbers with numpy.savez", None, name) from None
    if not cells:
        raise _error(file, "there are no arrays", "save arrays of numbers with numpy.savez")
    return cells, np.arange(len(next(iter(cells.values()))), dtype=np.int64)


def _check_array(file: str, name: str, array: Any, before: Mapping[str, Cells]) -> Cells:
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biufU":
        raise _error(file, "not an array of numbers or texts", "save arrays of numbers", None, name)
    if array.ndim != 1:
        raise _error(file, f"shape {array.shape}", "save one-dimensional arrays of equal length", None, name)
    for other, cells in before.items():
        if len(cells) != len(array):
            problem = f"{len(array)} values, but {other} has {len(cells)}"
            raise _error(file, problem, "save one-dimensional arrays of equal length", None, name)
    return array


# -- from cells to numbers


@dataclass(frozen=True)
class _Series:
    """Reports in order of time. x has one row per input."""

    inputs: tuple[str, ...]
    t: Array
    x: Array
    contact: Mask
    rows: Rows
    contact_column: str | None = None
    repeats: int = 0
    start: float = 0.0


def _series(
    table: _Table, columns: Mapping[str, str], where: Mapping[str, Any], time: str, contact: str | bool | None
) -> _Series:
    """The reports that the arguments mean, checked; equal rows with one time stamp once."""
    clock = _expression("time", time, table)
    if clock.scale < 0:
        raise BadValue(f"time: {time!r} runs backwards")
    linear = {name: _expression(name, text, table) for name, text in columns.items()}
    flag = _contact_column(table, contact)
    chosen = _selected(table, where)
    rows = table.rows[chosen]
    t = _converted(table, clock, chosen)
    x = np.array([_converted(table, a, chosen) for a in linear.values()])
    touch = np.ones(len(chosen), dtype=bool) if flag is None else _touch(table, flag, chosen)
    used = {clock.column, flag, *(a.column for a in linear.values())}
    _check_rising(table, t, chosen, used)
    start, t = float(t[0]), t - t[0]
    again = _repeats(table, t, np.vstack([x, touch]), rows)
    keep = ~again
    if keep.sum() < 2:
        raise table.error("one report is not a motion", "give at least two rows with rising time", rows[0])
    if not touch.any():
        raise table.error("never in contact", "use contact=False to follow the point in the air", None, flag)
    return _Series(tuple(linear), t[keep], x[:, keep], touch[keep], rows[keep], flag, int(again.sum()), start)


def _contact_column(table: _Table, contact: str | bool | None) -> str | None:
    if contact is False or (contact is None and "contact" not in table.cells):
        return None
    return _find(table, contact if isinstance(contact, str) else "contact", "contact")


def _selected(table: _Table, where: Mapping[str, Any]) -> Rows:
    """Indices of the rows that have all the values."""
    keep = np.ones(len(table.rows), dtype=bool)
    values = {}
    for column, value in where.items():
        name = _find(table, str(column), "where")
        values[name] = _values(table.cells[name])
        keep &= _equal(table.cells[name], value)
    if not keep.any():
        wanted = " and ".join(f"{column}={value}" for column, value in where.items())
        has = "; ".join(f"{name} has {_list(v)}" for name, v in values.items())
        raise table.error(f"no row has {wanted}", f"choose from these: {has}")
    return np.flatnonzero(keep)


def _equal(cells: Cells, value: Any) -> Mask:
    numbers = [_number(c) for c in cells]
    if all(n is not None for n in numbers):
        wanted = _number(value)
        return np.array([n == wanted for n in numbers], dtype=bool)
    return np.array([str(c).strip() == str(value).strip() for c in cells], dtype=bool)


def _number(cell: Any) -> float | None:
    """A cell as a number, None if it is not one. float() alone takes underscores and the digits of other scripts too."""
    if isinstance(cell, str) and (not cell.isascii() or "_" in cell):
        return None
    try:
        return float(cell)
    except (TypeError, ValueError, OverflowError):
        return None


def _values(cells: Iterable[Any]) -> list[str]:
    """The different values, in order of appearance."""
    return list(dict.fromkeys(str(c).strip() for c in cells))


def _list(words: Sequence[str], most: int = 12) -> str:
    return ", ".join(words[:most]) + (f", ... ({len(words)} in all)" if len(words) > most else "")


def _converted(table: _Table, linear: _Linear, chosen: Rows) -> Array:
    assert linear.column is not None
    with np.errstate(over="ignore"):
        values = _numbers(table, linear.column, chosen) * linear.scale + linear.offset
    for i in np.flatnonzero(~np.isfinite(values)):
        problem = f"{table.cells[linear.column][chosen[i]]!s} * {linear.scale:g} + {linear.offset:g} overflows"
        raise table.error(problem, "check the unit", table.rows[chosen[i]], linear.column)
    return values


def _numbers(table: _Table, column: str, chosen: Rows) -> Array:
    """The chosen cells of a column as finite numbers."""
    cells = table.cells[column]
    if isinstance(cells, np.ndarray) and cells.dtype.kind != "U":
        values = cells[chosen].astype(np.float64)
    else:
        values = np.array([_cell(table, column, i) for i in chosen], dtype=np.float64)
    for i in np.flatnonzero(~np.isfinite(values)):
        raise table.error(f"{values[i]} is not finite", "correct or remove the row", table.rows[chosen[i]], column)
    return values


def _cell(table: _Table, column: str, i: int) -> float:
    text = str(table.cells[column][i])
    if (number := _number(text)) is not None:
        return number
    shown = repr(text if len(text) <= 40 else text[:37] + "...")
    problem = f"{shown} is not a number" if text.strip() else "there is no number"
    raise table.error(problem, "correct or remove the row", table.rows[i], column)


def _touch(table: _Table, column: str, chosen: Rows) -> Mask:
    values = _numbers(table, column, chosen)
    for i in np.flatnonzero((values != 0) & (values != 1)):
        remedy = "use a column of 0 and 1, or contact=False"
        raise table.error(f"contact is {values[i]:g}", remedy, table.rows[chosen[i]], column)
    return values == 1


def _check_rising(table: _Table, t: Array, chosen: Rows, used: set[str | None]) -> None:
    for i in np.flatnonzero(np.diff(t) < 0):
        several = [
            f"{name} ({_list(values)})"
            for name in table.cells
            if name not in used and 1 < len(values := _values(table.cells[name][k] for k in chosen)) <= 20
        ]
        remedy = "put the rows into the order of time"
        if several:
            remedy = f"if there are several recordings in the file, select one with where: {', '.join(several)}; else {remedy}"
        rows = table.rows[chosen]
        raise table.error(f"time goes back from {t[i]:.9g} to {t[i + 1]:.9g} s", remedy, rows[i + 1])


def _repeats(table: _Table, t: Array, values: Array, rows: Rows) -> Mask:
    """Which reports are the one before once more."""
    same_time = np.diff(t, prepend=-np.inf) == 0
    differs = np.zeros(len(t), dtype=bool)
    differs[1:] = (np.diff(values, axis=1) != 0).any(axis=0)
    for i in np.flatnonzero(same_time & differs):
        problem = f"the same time as row {rows[i - 1]} and other values"
        raise table.error(problem, "remove one of the two rows, or correct the time", rows[i])
    return same_time


# -- from reports to a motion


def _check_gaps(table: _Table, s: _Series, max_gap: float) -> tuple[_Series, list[tuple[int, float]]]:
    """The same reports, if no silence in contact is longer than max_gap; off contact there is nothing to miss."""
    dt = np.where(s.contact[:-1] & s.contact[1:], np.diff(s.t), 0.0)
    for i in np.flatnonzero(dt > max_gap):
        problem = f"a gap of {dt[i]:.6g} s before this report, in contact, longer than {max_gap:.6g} s"
        enough = ceil(100 * float(dt.max()) - 1e-6) / 100 + 0.01
        remedy = f'use reports="on_change" if silence means that the point stood still, or max_gap={enough:g} to join it'
        raise table.error(problem, remedy, s.rows[i + 1])
    return s, []


def _hold_silences(s: _Series, period: float, max_gap: float) -> tuple[_Series, list[tuple[int, float]]]:
    """With each silence ended by a copy of the report before it, one median period before the next; the long ones."""
    dt = np.diff(s.t)
    i = np.flatnonzero(dt > SILENCE * period)
    t = np.insert(s.t, i + 1, s.t[i + 1] - period)
    x = np.insert(s.x, i + 1, s.x[:, i], axis=1)
    held = _Series(s.inputs, t, x, np.insert(s.contact, i + 1, s.contact[i]), np.insert(s.rows, i + 1, s.rows[i]))
    return held, [(int(s.rows[k + 1]), float(dt[k])) for k in i if dt[k] > max_gap]


def _limits(inputs: Sequence[str], max_speed: float | Mapping[str, float | None] | None) -> Array:
    """Largest speed of each input, in its unit per second."""
    given = max_speed if isinstance(max_speed, Mapping) else dict.fromkeys(inputs, max_speed)
    speeds = [given.get(name) for name in inputs]
    return np.array([np.inf if speed is None else speed for speed in speeds], dtype=np.float64)


def _joined(table: _Table, s: _Series, limits: Array) -> tuple[Mask, list[tuple[int, float]]]:
    """Which intervals are a motion in contact; the jumps, as row and speed."""
    touching = s.contact[:-1] & s.contact[1:]
    with np.errstate(over="ignore"):
        speeds = np.abs(np.diff(s.x, axis=1)) / np.diff(s.t)
    over = touching & (speeds > limits[:, np.newaxis])
    speed, jump = np.where(over, speeds, 0.0).max(axis=0), over.any(axis=0)
    count = int(jump.sum())
    if count == touching.sum() > 0 or (count >= JUMPS and count > JUMP_SHARE * len(s.t)):
        i = int(np.argmax(jump))
        _refuse_jumps(table, s, i, int(np.argmax(over[:, i])), speeds, limits, count)
    return touching & ~jump, [(int(s.rows[i + 1]), float(speed[i])) for i in np.flatnonzero(jump)]


def _refuse_jumps(table: _Table, s: _Series, i: int, k: int, speeds: Array, limits: Array, count: int) -> NoReturn:
    name = s.inputs[k]
    problem = f"{name} moves at {speeds[k, i]:.4g} m/s, faster than a hand (max_speed is {limits[k]:g} m/s)"
    problem += f", in this report and {count - 1} others"
    remedy = f"check the unit in the mapping of {name}; set max_speed if it is right, or is not metres"
    raise table.error(problem, remedy, s.rows[i + 1])


def _tracks(table: _Table, s: _Series, joined: Mask, spec: str) -> dict[str, Motion]:
    """Per input, cubics between its reports in contact."""
    at = np.flatnonzero(s.contact)
    t, x = s.t[at], s.x[:, at]
    # the interval after a report in contact is joined only if the next report is in contact too
    ends = np.append(np.flatnonzero(~joined[at[:-1]]), len(at) - 1)
    starts = np.append(0, ends[:-1] + 1)
    c = np.zeros((4, *x.shape))
    c[3] = x
    for first, last in zip(starts, ends, strict=True):
        if last > first:
            c[:, :, first:last] = _cubics(table, t[first : last + 1], x[:, first : last + 1], s.rows[at[first : last + 1]])
    return {name: Track(t, c[:, i], f"{spec}.motion[{name!r}]") for i, name in enumerate(s.inputs)}


def _cubics(table: _Table, t: Array, x: Array, rows: Rows) -> Array:
    """Coefficients of one stretch, shape (4, inputs, intervals)."""
    from scipy.interpolate import PchipInterpolator

    with np.errstate(all="ignore"):
        try:
            c = np.moveaxis(PchipInterpolator(t, x.T).c, 1, 2)
            finite = bool(np.isfinite(c).all())
        except ValueError:  # a derivative is not finite
            finite = False
        if not finite:
            worst = int(np.argmax((np.abs(np.diff(x, axis=1)) / np.diff(t)).max(axis=0)))
            remedy = "check time and units, or set max_speed"
            raise table.error("the step to this report is too large for its time", remedy, rows[worst + 1])
    return c


def _lifts(s: _Series) -> list[tuple[int, float]]:
    """Where contact is lost, or missing from the start: row and time."""
    off = ~s.contact & np.append(True, s.contact[:-1])
    return [(int(s.rows[i]), float(s.t[i])) for i in np.flatnonzero(off)]
