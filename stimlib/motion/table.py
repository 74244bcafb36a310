"""Reader of external tables (CSV, npz or in memory), one batch of rows at a time.

Only the requested parts of a file are kept in memory.

In a table of millions of rows, most rows are plain: as many fields as names, and no
quotes. numpy's reader handles these. From the first piece that is not plain, Python's
csv reader continues row by row, so that errors can be located exactly.
"""

import csv
import hashlib
import io
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ..errors import BadValue, RecordingError
from ..system import safe_files
from ..system.limits import limits
from .npz import ArrayBatch, read_npz
from .rows import Array, Batch, Rows, table_error

EMPTY = "give a file with a line of column names and at least two rows"
PIECE = 1 << 20  # bytes of text that are read at once
BATCH = 10_000  # rows of the exact reader
# characters of a line of the fast reader; the exact one takes longer lines, but no
# longer fields
LONGEST = 1 << 17


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
        Decimal sign of numbers.
    """

    file: str
    sha256: str
    names: tuple[str, ...]
    most: int
    batches: Callable[[], Iterator[Batch]]
    decimal: str = "."

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
        return number(text.replace(self.decimal, "."))


def number(text: str) -> float | None:
    """Return a cell as a number, or None if it is not one.

    Unlike float(), it rejects underscores and digits of other scripts.
    """
    if not text.isascii() or "_" in text:
        return None
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


def read_table(source: str | os.PathLike[str] | Columns, sha256: str | None = None) -> TableFile:
    r"""Open a table in a CSV or npz file, or in memory.

    Parameters
    ----------
    source : path or Columns
        A file whose name ends in .npz is read as npz, any other as CSV; or arrays of
        equal length under their names.
    sha256 : str, optional
        First 8 to 64 hex digits of the SHA-256 of the file, or of the table's names and
        values, which must match.

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
    if not data[:PIECE].strip() and not data.strip():
        raise table_error(file, "the file is empty", EMPTY)
    if file.lower().endswith(".npz"):
        names, most, batches = read_npz(file, data)
        return TableFile(file, digest, names, most, batches)
    return _read_csv(file, digest, data)


def _in_memory(source: Columns, sha256: str | None) -> TableFile:
    file, digest = f"{type(source).__name__} in memory", hashlib.sha256()
    columns: dict[str, np.ndarray] = {}
    for key in source.keys():
        name = str(key)
        if name in columns:
            raise table_error(file, "two columns have this name", "rename one", None, name)
        values = columns[name] = _column(file, name, source[key])
        first = next(iter(columns))
        if len(values) != len(columns[first]):
            problem = f"{len(values)} values, but {first} has {len(columns[first])}"
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


# -- CSV


@dataclass(frozen=True)
class _Form:
    """The format of a CSV file: separator, decimal sign and header."""

    file: str
    names: tuple[str, ...]
    separator: str
    decimal: str
    row: int  # line of the names


def _read_csv(file: str, digest: str, data: bytes) -> TableFile:
    _check_text(file, data)
    start = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    most = 1 + sum(_ends(data[at : at + PIECE]) for at in range(0, len(data), PIECE))
    limits.check("recording_rows", most, f"{file}: rows", RecordingError)
    start, first, separator = _leading(file, data, start)
    decimal = "," if separator == ";" else "."
    names, last = _header(file, data, start, first, separator)
    form = _Form(file, names, separator, decimal, first)
    after = data.find(b"\n", start) + 1
    plain = last == first and after and b"\r" not in data[start:after].rstrip(b"\r\n")

    def batches() -> Iterator[Batch]:
        at, row = (after, first + 1) if plain else (start, first)
        if plain:
            while at < len(data):
                end = data.rfind(b"\n", at, at + PIECE) + 1
                batch = _plain(data[at:end], row, form) if end else None
                if batch is None:
                    break
                yield batch
                at, row = end, row + len(batch.rows)
        yield from _exact(data, at, row, form)

    return TableFile(file, digest, names, most, batches, decimal)


def _ends(piece: bytes) -> int:
    """Return an upper bound on the number of line ends."""
    text = np.frombuffer(piece, np.uint8)
    return int(np.count_nonzero(text == 10)) + (piece.count(b"\r") if b"\r" in piece else 0)


def _check_text(file: str, data: bytes) -> None:
    remedy = "save it as CSV text in UTF-8"
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise table_error(file, "UTF-16 text", remedy)
    if b"\0" in data:
        raise table_error(file, "not a text file", f"{remedy}, or as .npz")
    if data.isascii():
        return
    at = 0
    while at < len(data):
        end = data.rfind(b"\n", at, at + PIECE) + 1 or len(data)
        try:
            data[at:end].decode()
        except UnicodeDecodeError as error:
            row = data.count(b"\n", 0, at + error.start) + 1
            raise table_error(
                file, f"not UTF-8 text, byte 0x{data[at + error.start]:02x}", remedy, row
            ) from None
        at = end


def _records(
    file: str, data: bytes, at: int, row: int, separator: str
) -> Iterator[tuple[list[str], int]]:
    """Yield the fields and the line number of every record, from a byte offset on.

    The offset must be the start of a line.
    """
    with io.BytesIO(data) as raw:
        raw.seek(at)
        lines = csv.reader(
            _lines(file, raw, row), delimiter=separator, strict=True, skipinitialspace=True
        )
        try:
            for fields in lines:
                yield fields, lines.line_num + row - 1
        except csv.Error as error:
            raise table_error(
                file, f"not CSV ({error})", "correct the row", lines.line_num + row - 1
            ) from None


def _lines(file: str, raw: io.BytesIO, row: int) -> Iterator[str]:
    text = io.TextIOWrapper(raw, encoding="utf-8", newline="")
    most = int(min(limits.recording_columns, 2**30)) * 1024  # a line without an end is no table
    while line := text.readline(most):
        yield line
        if len(line) == most:
            raise table_error(
                file, f"not CSV (a line of {most} characters or more)", "correct the row", row
            )
        row += 1


def _leading(file: str, data: bytes, at: int) -> tuple[int, int, str]:
    """Return where the column names begin, and the separator of columns.

    The names come after comments and Excel's separator line; their line is returned as
    byte offset and line number.
    """
    hint, row, above = "", 1, ""
    with io.BytesIO(data) as raw:
        raw.seek(at)
        for line in _lines(file, raw, row):
            separator = hint or _separator(above)
            number_follows = (
                number(line.split(separator)[0].strip('"').replace(",", ".")) is not None
            )
            if above and number_follows and line.count(separator) == above.count(separator):
                # no comment: the first name begins with #
                return at - len(above.encode()), row - 1, separator
            if row == 1 and (declared := re.fullmatch('(?i:"?sep=([,;|\t])"?)[\r\n]*', line)):
                hint = declared[1]
            elif line.startswith("#"):
                above = line
            else:
                return at, row, hint or _separator(line)
            at, row = at + len(line.encode()), row + 1
    return at, row, ","


def _separator(line: str) -> str:
    return ";" if ";" in line and "," not in line else ","


def _header(
    file: str, data: bytes, start: int, first: int, separator: str
) -> tuple[tuple[str, ...], int]:
    """Return the column names and the number of their last line."""
    blank = 0
    for fields, row in _records(file, data, start, first, separator):
        if _is_blank(fields):
            blank = blank or row
            continue
        if blank:
            raise table_error(
                file, "the line is blank", "put the names of the columns there", blank
            )
        limits.check("recording_columns", len(fields), f"{file}: columns", RecordingError)
        names = [f.strip() for f in fields]
        if twice := [name for i, name in enumerate(names) if name in names[:i]]:
            problem = f"{names.count(twice[0])} columns have this name"
            raise table_error(file, problem, "rename all but one", first, twice[0] or "''")
        return tuple(names), row
    raise table_error(file, "the file is empty", EMPTY)


def _is_blank(fields: list[str]) -> bool:
    return len(fields) <= 1 and not any(f.strip() for f in fields)


def _plain(piece: bytes, row: int, form: _Form) -> "_Plain | None":
    """Return complete lines if all have the right number of fields and no quotes."""
    if (
        b'"' in piece
        or len(form.names) < 2
        or (b"\r" in piece and piece.count(b"\r") != piece.count(b"\r\n"))
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
    return _Plain(piece, np.arange(row, row + len(lines), dtype=np.int64), form)


@dataclass(frozen=True)
class _Plain:
    piece: bytes
    rows: Rows
    form: _Form

    def numbers(self, columns: Sequence[str]) -> Array:
        text = self.piece.replace(b",", b".") if self.form.decimal == "," else self.piece
        wanted = [self.form.names.index(name) for name in columns]
        lines = text.decode("latin-1").split("\n")[:-1]
        values = np.loadtxt(
            lines, delimiter=self.form.separator, usecols=wanted, comments=None, ndmin=2
        )
        if len(values) != len(self.rows):
            raise ValueError
        return values.T

    def texts(self, column: str) -> Sequence[str]:
        at = self.form.names.index(column)
        return [
            line.split(self.form.separator)[at] for line in self.piece.decode().split("\n")[:-1]
        ]


def _exact(data: bytes, at: int, row: int, form: _Form) -> Iterator["_Exact"]:
    """Yield the rows from a byte offset on, each one checked, without the header."""
    cells: list[list[str]] = []
    rows: list[int] = []
    blank = 0  # the first blank line since the last row; at the end they do no harm
    skip = row == form.row
    for fields, line in _records(form.file, data, at, row, form.separator):
        if _is_blank(fields):
            blank = blank or line
        elif skip:
            skip = False
        else:
            _check_fields(form, fields, line, blank)
            cells.append(fields)
            rows.append(line)
            if len(rows) == BATCH:
                yield _Exact(cells, np.array(rows, dtype=np.int64), form)
                cells, rows = [], []
    if rows:
        yield _Exact(cells, np.array(rows, dtype=np.int64), form)


def _check_fields(form: _Form, fields: list[str], row: int, blank: int) -> None:
    if blank:
        raise table_error(form.file, "the line is blank", "remove it", blank)
    names = form.names
    if len(fields) != len(names):
        what = "missing" if len(fields) < len(names) else "surplus"
        where = names[len(fields)] if len(fields) < len(names) else None
        problem = f"{len(fields)} fields for {len(names)} columns, {what} field"
        remedy = (
            "correct the row (decimals with a point, not a comma, unless columns are separated by"
            " semicolons)"
        )
        raise table_error(form.file, problem, remedy, row, where)


@dataclass(frozen=True)
class _Exact:
    cells: list[list[str]]
    rows: Rows
    form: _Form

    def numbers(self, columns: Sequence[str]) -> Array:
        values = np.empty((len(columns), len(self.rows)))
        for i, name in enumerate(columns):
            found = [number(text.replace(self.form.decimal, ".")) for text in self.texts(name)]
            if None in found:
                raise ValueError
            values[i] = found
        return values

    def texts(self, column: str) -> Sequence[str]:
        at = self.form.names.index(column)
        return [fields[at] for fields in self.cells]
