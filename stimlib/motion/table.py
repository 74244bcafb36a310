"""Reader of external tables, in files or in memory, one batch of rows at a time.

Only the requested parts of a file are kept in memory.

In a table of millions of rows, most rows are plain: as many fields as names, and no
quotes. numpy's reader handles these. From the first piece that is not plain, Python's
csv reader continues row by row, so that errors can be located exactly.
"""

import csv
import hashlib
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from ctypes import CFUNCTYPE, c_int64, c_void_p
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import BadValue, RecordingError, counted
from ..system import fields, safe_files
from ..system.limits import limits
from .binary import read_c3d, read_mat, read_xdf
from .layout import (
    EMPTY,
    PIECE,
    THOUSANDS,
    decimal_sign,
    is_blank,
    is_comment,
    is_row,
    layout_of,
    lines_of,
    records,
    text_of,
)
from .npz import ArrayBatch, read_npz
from .rows import Array, Batch, Known, Rows, table_error

BATCH = 10_000  # rows of the exact reader
# characters of a line of the fast reader; the exact one takes longer lines, but no
# longer fields
LONGEST = 1 << 17
LARGE = 1 << 23  # bytes, from which on a compiled loop takes the cells: to load it takes 0.1 s
POWERS = np.array([float(10**k) for k in range(16)])


@dataclass(frozen=True)
class TableFile:
    """A table file with its column names and its rows in batches.

    Attributes
    ----------
    file, sha256 : str
    names : tuple of str
    most : int
        Upper bound on the number of rows.
    batches : function
        Returns the rows from the first on; it can be called repeatedly.
    decimal : str
        Decimal sign of numbers; "" where 1.234 may be a thousand.
    read : tuple of str
        What was skipped or assumed to find names and rows.
    skipped : dict of str to (int, int)
        What was skipped between the rows when they were read: how often, and the first
        row.
    """

    file: str
    sha256: str
    names: tuple[str, ...]
    most: int
    batches: Callable[[], Iterator[Batch]]
    decimal: str = "."
    read: tuple[str, ...] = ()
    skipped: dict[str, tuple[int, int]] = field(default_factory=dict)

    def notes(self) -> list[str]:
        """Return what was skipped or assumed, in words."""
        return [
            *self.read,
            *(
                f"{n} {what} skipped, the first in row {at}"
                for what, (n, at) in self.skipped.items()
            ),
        ]

    def error(
        self, problem: str, remedy: str, row: Any = None, column: str | None = None
    ) -> RecordingError:
        """Return an error about this table."""
        return table_error(self.file, problem, remedy, row, column)

    def closed(self) -> "TableFile":
        """Return the table without its rows, to free the memory."""
        return replace(self, batches=lambda: iter(()))

    def number(self, text: str) -> float | None:
        """Return a cell as a number, or None if it is not one."""
        return number(text, self.decimal)


def number(text: str, decimal: str = ".") -> float | None:
    """Return a cell as a number, or None if it is not one.

    Unlike float(), it rejects underscores and digits of other scripts. Unless points
    are known to be decimal, 1.234 may be a thousand, and is rejected.
    """
    if not text.isascii() or "_" in text:
        return None
    if decimal != "." and "." in text and THOUSANDS.fullmatch(text.strip()):
        return None
    if decimal == ",":
        text = text.replace(",", ".")
    try:
        return float(text)
    except ValueError:
        return None


class Columns(Protocol):
    """A table in memory, with an array under each column name.

    Examples are a pandas DataFrame and a dict.
    """

    def keys(self) -> Iterable[Any]:
        """Return the names of the columns."""

    def __getitem__(self, name: Any, /) -> Any: ...


def read_table(
    source: str | os.PathLike[str] | Columns,
    sha256: str | None = None,
    known: Known = lambda names: 0,
) -> TableFile:
    r"""Open a table in a text or npz file, or in memory.

    Parameters
    ----------
    source : path or Columns
        A file whose name ends in .npz, .mat, .c3d, .xdf or .xdfz is read as such, any
        other as text, packed by gzip or not; or arrays of equal length by name.
    sha256 : str, optional
        First 8 to 64 hex digits of the SHA-256 of the file, or of the table's names and
        values, which must match.
    known : function, optional
        Counts, among some names, the columns that will be used. It helps to find the
        line of the names.

    Raises
    ------
    RecordingError
        The file is not such a table, or is larger than ``stimlib.limits`` allow; rows
        are checked as they are read.
    BadValue
        The path or the digest is invalid.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp(), "press.csv")
    >>> _ = path.write_text("t_s,force_N\n0,1\n0.01,2\n")
    >>> table = read_table(path)
    >>> [batch.numbers(["force_N"]).tolist() for batch in table.batches()]
    [[[1.0, 2.0]]]
    """
    if not isinstance(source, str | os.PathLike):
        if hasattr(source, "keys"):
            return _in_memory(source, sha256)
        raise BadValue(
            f"give the name of a file, a DataFrame or a dict of arrays, got {type(source).__name__}"
            f" {source!r:.80}"
        )
    file = os.fsdecode(source)
    try:
        data = safe_files.read(file, "recording_bytes", RecordingError)
    except RecordingError as error:
        reason = error.args[0].removeprefix(f"cannot read {file}: ")
        if reason == error.args[0]:
            raise
        raise table_error(
            file, f"cannot be read ({reason})", "give the name of a CSV or npz file"
        ) from None
    digest = hashlib.sha256(data).hexdigest()
    if sha256 is not None:
        _check_digest(file, digest, sha256)
    if file.lower().endswith(".npz"):
        names, most, batches = read_npz(file, data)
        return TableFile(file, digest, names, most, batches)
    if found := re.search(r"\.(mat|c3d|xdf|xdfz|xdf\.gz)\Z", file.lower()):
        read = {"mat": read_mat, "c3d": read_c3d}.get(found[1], read_xdf)
        names, most, batches, notes = read(file, data, known)
        return TableFile(file, digest, names, most, batches, read=notes)
    stem = re.sub(r"\.tsv(\.gz)?\Z", "", file)
    if re.search("_(stim|physio|motion)\\Z", stem) and os.path.exists(f"{stem}.json"):
        return _read_bids(file, digest, data, stem)
    return _read_text(file, digest, data, known)


def _in_memory(source: Columns, sha256: str | None) -> TableFile:
    file, digest = f"{type(source).__name__} in memory", hashlib.sha256()
    columns: dict[str, np.ndarray] = {}
    for key in source.keys():
        # of a DataFrame whose columns have several levels, as of groups in a text
        name = ".".join(filter(None, map(str, key))) if isinstance(key, tuple) else str(key)
        if name in columns:
            raise table_error(file, "two columns have this name", "rename one", None, name)
        values = columns[name] = _column(file, name, source[key])
        first = next(iter(columns))
        if len(values) != len(columns[first]):
            problem = f"{counted(len(values), 'value')}, but {first} has {len(columns[first])}"
            raise table_error(file, problem, "give columns of equal length", None, name)
        texts = values.dtype.kind == "U"
        data = (
            "\0".join(values.tolist()).encode("utf-8", "surrogatepass")
            if texts
            else values.astype("<f8").tobytes()
        )
        digest.update(repr((name, texts, len(values))).encode() + data)
    if not columns:
        raise table_error(
            file, "there are no columns", "give a column of times, and one for each input"
        )
    if sha256 is not None:
        _check_digest(file, digest.hexdigest(), sha256)
    most = len(values)
    batch = ArrayBatch(columns.__getitem__, slice(None), np.arange(most, dtype=np.int64))
    return TableFile(file, digest.hexdigest(), tuple(columns), most, lambda: iter([batch]))


def _column(file: str, name: str, given: Any) -> np.ndarray:
    """Return a column as numbers, or as texts if any cell is not a number."""
    try:
        values = np.asarray(given)
    except ValueError:  # rows of several lengths
        values = np.empty((0, 0))
    if values.ndim != 1:
        raise table_error(file, f"shape {values.shape}", "give one-dimensional columns", None, name)
    if values.dtype.kind not in "biuf" or np.ma.is_masked(given):
        return np.array([str(v) for v in given], dtype=str)
    return values.astype(np.int8) if values.dtype.kind == "b" else values


def _check_digest(file: str, digest: str, sha256: str) -> None:
    if not isinstance(sha256, str) or not re.fullmatch("[0-9a-fA-F]{8,64}", sha256):
        raise BadValue(
            f"sha256 must be the first 8 to 64 hex digits of the file's SHA-256, got {sha256!r}"
        )
    if not digest.startswith(sha256.lower()):
        remedy = "find the file that was meant, or leave out sha256"
        raise table_error(file, f"SHA-256 is {digest[:16]}..., not {sha256}", remedy)


# -- text


@dataclass(frozen=True)
class _Form:
    """The format of the rows of a text file."""

    file: str
    names: tuple[str, ...]
    separator: str
    decimal: str
    signs: str  # that begin a comment
    surplus: bool  # the last field of a row is empty, and no column
    large: bool = False


def _read_text(file: str, digest: str, data: bytes, known: Known) -> TableFile:
    data, notes = text_of(file, data)
    if not data or data.isspace():
        raise table_error(file, "the file is empty", EMPTY)
    if not data.endswith((b"\n", b"\r")):
        notes.append("the last line has no end: it may be cut off")
    most = 1 + sum(_ends(data[at : at + PIECE]) for at in range(0, len(data), PIECE))
    limits.check("recording_rows", most, f"{file}: rows", RecordingError)
    found = layout_of(file, data, known)
    lines = islice(lines_of(file, data, 0, 1), found.end)
    start, row = sum(len(line.encode()) for line in lines), found.end + 1
    if found.separator == " ":
        data, start = _squeezed(data[start:]), 0
    decimal = decimal_sign(data, start, found.separator)
    if decimal == ",":
        notes.append("decimal commas")
    form = _Form(
        file,
        found.names,
        found.separator,
        decimal,
        found.signs,
        found.surplus,
        len(data) >= LARGE,
    )
    skipped: dict[str, tuple[int, int]] = {}

    def batches() -> Iterator[Batch]:
        at, line = start, row
        while at < len(data):
            end = data.rfind(b"\n", at, at + PIECE) + 1
            batch = _plain(data[at:end], line, form) if end else None
            if batch is None:
                break
            yield batch
            at, line = end, line + len(batch.rows)
        yield from _exact(data, at, line, form, skipped)

    return TableFile(
        file, digest, found.names, most, batches, decimal, (*notes, *found.notes), skipped
    )


def _read_bids(file: str, digest: str, data: bytes, stem: str) -> TableFile:
    """Open a table of BIDS without names, whose JSON file has its rate.

    The times are the column t_s.
    """
    beside = f"{stem}.json"
    try:
        facts = fields.parse(safe_files.read(beside, "sidecar_bytes", RecordingError))
        fields.require(facts, {"SamplingFrequency": fields.positive})
        start = facts.get("StartTime", 0.0)
        names = facts.get("Columns")
        if names is None:
            beside = f"{stem.removesuffix('_motion')}_channels.tsv"
            names = [n for b in read_table(beside).batches() for n in b.texts("name")]
        if not fields.list_of(fields.text)(names) or not names or not fields.number(start):
            raise ValueError("Columns must be names, and StartTime a number")
    except ValueError as error:
        if isinstance(error, RecordingError):
            raise
        remedy = "correct it, or remove it to read the table by itself"
        raise table_error(beside, f"does not describe {file} ({error})", remedy) from None
    rate = facts["SamplingFrequency"]
    data, notes = text_of(file, data)
    most = 1 + _ends(data)
    limits.check("recording_rows", most, f"{file}: rows", RecordingError)
    form = _Form(file, tuple(names), "\t", ".", "", False)
    timed = replace(form, names=("t_s", *names))
    read = (*notes, f"names and rate, {rate:g} Hz, from {os.path.basename(beside)}")
    skipped: dict[str, tuple[int, int]] = {}

    def batches() -> Iterator[Batch]:
        at = 0  # number of the first row; blank lines take no time
        for batch in _exact(data, 0, 1, form, skipped):
            times = (start + np.arange(at, at + len(batch.rows)) / rate).tolist()
            cells = [[str(t), *row] for t, row in zip(times, batch.cells, strict=True)]
            yield _Exact(cells, batch.rows, timed)
            at += len(times)

    return TableFile(file, digest, ("t_s", *names), most, batches, read=read, skipped=skipped)


def _ends(piece: bytes) -> int:
    """Return an upper bound on the number of line ends."""
    text = np.frombuffer(piece, np.uint8)
    return int(np.count_nonzero(text == 10)) + (piece.count(b"\r") if b"\r" in piece else 0)


def _squeezed(text: bytes) -> bytes:
    """Return lines with single spaces, and none at their beginning and end."""
    text = re.sub(rb"[ \t]+", b" ", text).removeprefix(b" ").removesuffix(b" ")
    for end in (b"\n", b"\r"):
        text = text.replace(b" " + end, end).replace(end + b" ", end)
    return text


def _plain(piece: bytes, row: int, form: _Form) -> "_Plain | None":
    """Return complete lines if all have the right number of fields and no quotes."""
    returns = piece.count(b"\r") if b"\r" in piece else 0
    if (
        b'"' in piece
        or len(form.names) < 2
        or (form.decimal != "." and b"." in piece)
        or (returns and returns != piece.count(b"\r\n"))
    ):
        return None
    text = np.frombuffer(piece, np.uint8)
    ends = text == 10
    marks = np.flatnonzero(ends | (text == ord(form.separator)))
    if len(marks) % len(form.names):
        return None
    last = ends[marks].reshape(-1, len(form.names))
    lines = marks[len(form.names) - 1 :: len(form.names)]
    if last[:, :-1].any() or not last[:, -1].all() or np.diff(lines, prepend=-1).max() > LONGEST:
        return None
    if form.surplus and np.any(
        np.diff(marks)[len(form.names) - 2 :: len(form.names)] > 1 + bool(returns)
    ):
        return None
    starts = np.append(0, lines[:-1] + 1)
    signs = [before + sign.encode() for sign in form.signs for before in (b"", b" ")]
    # a search for each sign takes longer than all else
    if np.bincount(text[starts], minlength=256)[[sign[0] for sign in signs]].any() and any(
        piece.startswith(sign, start) for start in starts.tolist() for sign in signs
    ):
        return None
    cells = np.column_stack([starts, marks.reshape(last.shape)])
    return _Plain(piece, np.arange(row, row + len(lines), dtype=np.int64), form, cells)


@cache
def _reader() -> Callable[..., int]:
    """Return the compiled loop over the cells of a column."""
    from ..targets.llvm.cache import load  # takes 0.1 s

    text = (
        Path(__file__)
        .parents[1]
        .joinpath("targets", "llvm", "tables.py")
        .read_text(encoding="utf-8")
    )
    kinds = [c_void_p, c_void_p, c_int64, c_int64, c_int64, c_void_p, c_void_p]
    return CFUNCTYPE(c_int64, *kinds)(load(text, "tables").addresses["decimals"])


@dataclass(frozen=True)
class _Plain:
    piece: bytes
    rows: Rows
    form: _Form
    cells: Rows
    """Where each row begins, and the separators and the line end behind its cells."""

    def numbers(self, columns: Sequence[str]) -> Array:
        text = self.piece.replace(b",", b".") if self.form.decimal == "," else self.piece
        wanted = [self.form.names.index(name) for name in columns]
        if self.form.large:
            codes = np.frombuffer(text + bytes(8), np.uint8)  # whole words are read
            found = [self.decimals(codes, k) for k in wanted]
            if all(values is not None for values in found):
                return np.array(found)
        lines = text.decode("latin-1").split("\n")[:-1]
        values = np.loadtxt(
            lines, delimiter=self.form.separator, usecols=wanted, comments=None, ndmin=2
        )
        if len(values) != len(self.rows):
            raise ValueError
        return values.T

    def decimals(self, codes: NDArray[np.uint8], column: int) -> Array | None:
        """Return a column, or None unless each cell is a number such as -12.345.

        A float holds 15 digits and their power of ten exactly, so that their quotient
        is the nearest float, as that of float().
        """
        values = np.empty(len(self.rows))
        shape = len(values), len(self.form.names), column
        given = [a.ctypes.data for a in (codes, self.cells, POWERS, values)]
        return values if _reader()(*given[:2], *shape, *given[2:]) == len(values) else None

    def texts(self, column: str) -> Sequence[str]:
        at = self.form.names.index(column)
        return [
            line.split(self.form.separator)[at] for line in self.piece.decode().split("\n")[:-1]
        ]


def _exact(
    data: bytes, at: int, row: int, form: _Form, skipped: dict[str, tuple[int, int]]
) -> Iterator["_Exact"]:
    """Yield the rows from a byte offset on, each one checked."""
    cells: list[list[str]] = []
    rows: list[int] = []
    comments: list[int] = []
    blank: list[int] = []  # at the end of the file they do no harm
    ended = 0

    def skip(line: str, number: int) -> bool:
        if not is_comment(line, form.signs):
            return False
        if is_row(line, form.separator, len(form.names)):
            problem = f"begins with {line.lstrip()[:1]} and has the fields of a row"
            remedy = "remove it if it is a comment; otherwise remove the sign"
            raise table_error(form.file, problem, remedy, number)
        comments.append(number)
        return True

    lines = lines_of(form.file, data, at, row)
    try:
        for fields, first, last in records(lines, row, form.separator, skip):
            if is_blank(fields):
                blank.append(first)
                continue
            ended = len(blank)
            _check_fields(form, fields, last)
            if last > first and any(
                is_row(line, form.separator, len(form.names))
                for cell in fields
                for line in cell.splitlines()[1:]
            ):
                problem = f"a quote that is opened in row {first} has rows of the table in it"
                raise table_error(form.file, problem, "close or remove the quote", last)
            cells.append(fields)
            rows.append(last)
            if len(rows) == BATCH:
                yield _Exact(cells, np.array(rows, dtype=np.int64), form)
                cells, rows = [], []
    except csv.Error as error:
        problem, where = error.args
        raise table_error(form.file, f"not CSV ({problem})", "correct the row", where) from None
    if rows:
        yield _Exact(cells, np.array(rows, dtype=np.int64), form)
    for what, found in (("blank lines", blank[:ended]), ("comments", comments)):
        if found:
            skipped[what] = len(found), found[0]


def _check_fields(form: _Form, fields: list[str], row: int) -> None:
    names = form.names
    if len(fields) != len(names):
        what = "missing" if len(fields) < len(names) else "surplus"
        where = names[len(fields)] if len(fields) < len(names) else None
        problem = (
            f"{counted(len(fields), 'field')} for {counted(len(names), 'column')}, {what} field"
        )
        remedy = (
            "correct the row (decimals with a point, not a comma, unless columns are separated by"
            " semicolons)"
        )
        raise table_error(form.file, problem, remedy, row, where)
    if form.surplus and fields[-1].strip():
        problem = f"{fields[-1]!r:.40} stands after the last separator, which has no column"
        raise table_error(form.file, problem, "correct the row, or name the column", row)


@dataclass(frozen=True)
class _Exact:
    cells: list[list[str]]
    rows: Rows
    form: _Form

    def numbers(self, columns: Sequence[str]) -> Array:
        values = np.empty((len(columns), len(self.rows)))
        for i, name in enumerate(columns):
            found = [number(text, self.form.decimal) for text in self.texts(name)]
            if None in found:
                raise ValueError
            values[i] = found
        return values

    def texts(self, column: str) -> Sequence[str]:
        at = self.form.names.index(column)
        return [fields[at] for fields in self.cells]
