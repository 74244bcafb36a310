"""Layout of a table in a text file: encoding, separator, names, and the first row."""

import codecs
import csv
import gzip
import io
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, islice, pairwise, zip_longest

from ..errors import RecordingError, counted
from ..system.limits import limits
from .rows import Known, table_error

EMPTY = "give a file with a line of column names and at least two rows"
PIECE = 1 << 18  # bytes of text that are read at once: more would leave the cache
HEAD = 200  # lines in which the names are looked for
ROWS = 20  # rows below the names by which a separator is judged
SIGNS = "#%"  # a line that begins with one of these is a comment
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "|", " ": "spaces"}
MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
CELL = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d+)?|(.*[T ])?\d+:\d\d:\d\d.*", re.I)
# it may be a thousand, or a number with three decimals
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}([.,])\d{3}(\1\d{3})*")
_NAME = (
    "[numkMcdµμ]?(m|s|N|V|A|g|Hz|Pa|W|J|K|B|T|rad|sec|bar)|°C?|deg(rees?)?|%|min|h|counts?"
    "|bits?|px|pixels?|a\\.?u\\.?|mmHg"
)
UNIT = re.compile(rf"({_NAME})([\s*/·.^-]*({_NAME}|-?\d|[⁻¹²³])){{0,6}}")


@dataclass(frozen=True)
class Layout:
    """Where a table's names and rows are, and how its cells are separated.

    Attributes
    ----------
    names : tuple of str
    separator : str
        A space stands for runs of spaces and tabs.
    row : int
        Line of the names.
    end : int
        Number of lines above the first row.
    signs : str
        What a comment between the rows begins with.
    surplus : bool
        Whether each row ends with a separator that the names do not have.
    numbers_above : int
        First line above the names that may be a row, or 0.
    notes : tuple of str
        What was skipped or assumed.
    rank : tuple
        How well the lines fit; the layout of the best separator is used.
    """

    names: tuple[str, ...]
    separator: str
    row: int
    end: int
    signs: str
    surplus: bool
    numbers_above: int
    notes: tuple[str, ...]
    rank: tuple[float, ...]


# -- text


def text_of(file: str, data: bytes) -> tuple[bytes, list[str]]:
    """Return a file's text in UTF-8, and what was assumed about its form."""
    notes = []
    if data.startswith(b"\x1f\x8b"):
        data, notes = unpacked(file, data), ["unpacked with gzip"]
    mark = next((m for m in MARKS if data.startswith(m)), b"")
    encoding = MARKS.get(mark, "utf-8")
    if encoding == "utf-8":
        data = data.removeprefix(mark)
        if b"\0" in data:
            raise table_error(file, "not a text file", "save it as CSV text in UTF-8, or as .npz")
        if data.isascii():
            return data, notes
    try:
        if encoding == "utf-8":
            return _checked(data), notes
        return data[2:].decode(encoding).encode(), [*notes, "text in UTF-16"]
    except UnicodeDecodeError:
        notes.append("text in Windows-1252, because it is not UTF-8")
    try:
        if encoding == "utf-8" and not mark:
            return data.decode("cp1252").encode(), notes
        problem, row = f"not {encoding.upper()} text, as its first bytes say", None
    except UnicodeDecodeError as error:
        problem = f"neither UTF-8 nor Windows-1252 text, byte 0x{data[error.start]:02x}"
        row = data.count(b"\n", 0, error.start) + 1
    raise table_error(file, problem, "save it as CSV text in UTF-8", row) from None


def _checked(data: bytes) -> bytes:
    """Return UTF-8 text, which is decoded in pieces to save memory."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    for at in range(0, len(data), PIECE):
        decoder.decode(data[at : at + PIECE])
    decoder.decode(b"", True)
    return data


def unpacked(file: str, data: bytes) -> bytes:
    """Return what gzip packed, one member after another, up to the limit of a file."""
    parts, size = [], 0
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as packed:
            while part := packed.read(PIECE):
                size += len(part)
                limits.check("recording_bytes", size, f"{file}: unpacked bytes", RecordingError)
                parts.append(part)
    except (OSError, EOFError, zlib.error) as error:
        problem = f"cannot be unpacked with gzip ({error})"
        raise table_error(file, problem, "copy it again, or unpack it") from None
    return b"".join(parts)


# -- records


def lines_of(file: str, data: bytes, at: int, row: int) -> Iterator[str]:
    """Yield the lines from a byte offset on, which is the start of a line."""
    most = int(min(limits.recording_columns, 2**30)) * 1024  # a line without an end is no table
    with io.BytesIO(data) as raw:
        raw.seek(at)
        text = io.TextIOWrapper(raw, encoding="utf-8", newline="")
        while line := text.readline(most):
            yield line
            if len(line) == most:
                problem = f"not CSV (a line of {most} characters or more)"
                raise table_error(file, problem, "correct the row", row)
            row += 1


def records(
    lines: Iterator[str], row: int, separator: str, skip: Callable[[str, int], bool]
) -> Iterator[tuple[list[str], int, int]]:
    """Yield the fields of every record, and the numbers of its first and last line.

    Lines at the start of a record of which ``skip`` is true are left out. csv.Error is
    raised with the number of the line as second argument.
    """
    first, last = 0, row - 1

    def kept() -> Iterator[str]:
        nonlocal first, last
        for line in lines:
            last += 1
            if not first:
                if skip(line, last):
                    continue
                first = last
            yield " ".join(line.split()) if separator == " " else line

    try:
        for fields in csv.reader(kept(), delimiter=separator, strict=True, skipinitialspace=True):
            yield fields, first, last
            first = 0
    except csv.Error as error:
        error.args = (str(error), last)
        raise


def is_blank(fields: Sequence[str]) -> bool:
    """Return whether a record is a blank line."""
    return len(fields) <= 1 and not any(f.strip() for f in fields)


def is_comment(line: str, signs: str = SIGNS) -> bool:
    """Return whether a line is a comment."""
    return line.lstrip(" ")[:1] in tuple(signs)


# -- layout


def layout_of(file: str, data: bytes, known: Known) -> Layout:
    """Return the layout of a table.

    Parameters
    ----------
    known : function
        Returns how many of the columns that will be used are among some names. The
        line with the most of them has the names; if none has any, it is the first line
        with as many fields as most lines have.
    """
    lines = list(islice(lines_of(file, data, 0, 1), HEAD))
    hint = re.fullmatch('(?i:"?sep=([,;|\t])"?)[\r\n]*', lines[0])
    found = [
        layout
        for mark in (hint[1] if hint else SEPARATORS)
        if (layout := _layout(lines, mark, bool(hint), known))
    ]
    if not found:
        long = f"its first {HEAD} lines are comments or blank"
        raise table_error(file, long if len(lines) == HEAD else "the file is empty", EMPTY)
    best = max(found, key=lambda layout: layout.rank)
    limits.check("recording_columns", len(best.names), f"{file}: columns", RecordingError)
    if best.numbers_above:
        problem = f"this line has numbers, and the names of the columns are in row {best.row}"
        remedy = "remove it if it is no row; otherwise put the names above it"
        raise table_error(file, problem, remedy, best.numbers_above)
    return best


def _layout(lines: list[str], separator: str, hint: bool, known: Known) -> Layout | None:
    comments: list[tuple[list[str], int, int]] = []

    def skip(line: str, row: int) -> bool:
        if is_comment(line):
            comments.append((_of_comment(line, separator), row, row))
        return is_comment(line) or (hint and row == 1)

    found: list[tuple[list[str], int, int]] = []
    try:
        found.extend(r for r in records(iter(lines), 1, separator, skip) if not is_blank(r[0]))
    except csv.Error:
        if not found:  # to be raised again, with its place, where the rows are read
            found.append(([lines[0].strip()], 1, 1))
    chosen = _named(found, comments, known)
    if not chosen:
        return None
    fields, row, end = chosen
    names = [f.strip() for f in fields]
    below = [r for r in found if r[1] > end]
    notes = []
    if above := [r for r in found if r[1] < row]:
        notes.append(f"{counted(len(above), 'line')} above the names skipped")
    numbers_above = [r[1] for r in above if len(r[0]) == len(names) and are_numbers(r[0])]
    if chosen not in [*found, *comments]:
        notes.append(f"names in row {row} completed from the row above")
        numbers_above = []
    if chosen in comments:
        notes.append(f"names taken from the comment in row {row}")
    if others := [c for c in comments if c[1] <= end and c is not chosen]:
        notes.append(f"{counted(len(others), 'comment')} above the rows skipped")
    if below and len(below[0][0]) == len(names) and _are_units(below[0][0]):
        end = below[0][2]
        units = ", ".join(f.strip() for f in below.pop(0)[0])
        notes.append(f"units in row {end} not applied: {units[:100]}")
    rows = [r[0] for r in below[:ROWS]]
    count = Counter(map(len, rows)).most_common(1)[0][0] if rows else len(names)
    while len(names) > max(count, 1) and not names[-1]:
        names.pop()
    surplus = len(names) + 1 == count and not any(r[-1].strip() for r in rows if len(r) == count)
    if surplus:
        names.append("")
        notes.append("each row ends with a separator")
    fit = [r for r in rows if len(r) == len(names)]
    cells = [_is_cell(cell) and not (separator == "," and "," in cell) for r in fit for cell in r]
    numbers = sum(cells) / max(len(cells), 1)
    consistent = len(fit) / len(rows) if rows else 1.0
    first = next((line for line in lines[end:] if line.strip()), "")
    own = is_comment(first) and is_row(first, separator, len(names))
    signs = SIGNS.replace(first.lstrip(" ")[:1], "") if own else SIGNS
    if separator not in ",;":
        notes.insert(0, f"separated by {SEPARATORS[separator]}")
    rank = (known(names), len(names) > 1, consistent, numbers, -list(SEPARATORS).index(separator))
    first_above = next(iter(numbers_above), 0)
    return Layout(
        tuple(names), separator, row, end, signs, surplus, first_above, tuple(notes), rank
    )


def _named(
    found: list[tuple[list[str], int, int]],
    comments: list[tuple[list[str], int, int]],
    known: Known,
) -> tuple[list[str], int, int] | None:
    """Return the record that has the names."""
    if not found:
        return None
    # a comment within the rows is not one of the names
    rows = {count: row for fields, row, _ in reversed(found) if (count := len(fields)) > 1}
    comments = [r for r in comments if r[1] < rows.get(len(r[0]), 0)]
    # names may be in two lines: time in the upper, and coordinates in the lower
    pairs = [
        ([low.strip() or high for high, low in zip_longest(upper, lower, fillvalue="")], row, end)
        for (upper, _, _), (lower, row, end) in pairwise(found)
    ]
    # or X, Y and Z in the lower, and a marker above the first of them
    groups = [
        (_grouped(upper, lower), row, end) for (upper, _, _), (lower, row, end) in pairwise(found)
    ]
    best = max([*found, *comments, *pairs, *groups], key=lambda r: known([f.strip() for f in r[0]]))
    if len(best[0]) > 1 and known([f.strip() for f in best[0]]):
        return best
    count = Counter(len(r[0]) for r in found).most_common(1)[0][0]
    first = next(r for r in found if len(r[0]) == count)
    above = [r for r in comments if r[1] < first[1] and len(r[0]) == count > 1]
    if above and _is_cell(first[0][0]):
        return above[-1]
    return first


def _grouped(upper: Sequence[str], lower: Sequence[str]) -> list[str]:
    """Return names such as Tip.X of a line X, Y, Z and the groups above it.

    A group has the columns from its own one up to the next group.
    """
    high = [field.strip() for field in upper] + [""] * (len(lower) - len(upper))
    groups: Iterator[str] = accumulate(high, lambda left, name: name or left)
    names = zip(high, map(str.strip, lower), groups, strict=False)
    return [f"{group}.{low}" if group and low else low or above for above, low, group in names]


def _of_comment(line: str, separator: str) -> list[str]:
    """Return the fields of a comment; its sign is left out if a first name follows."""
    text = line.strip()
    bare = text.lstrip(SIGNS).strip(" ")
    fields = _split(bare, separator)
    return [fields[0] or text[:1], *fields[1:]]


def _split(text: str, separator: str) -> list[str]:
    parts = text.split(None if separator == " " else separator)
    return [part.strip().strip('"') for part in parts] or [""]


def is_row(comment: str, separator: str, count: int) -> bool:
    """Return whether a line that begins with a sign may be a row of the table."""
    fields = _split(comment.strip().lstrip(SIGNS), separator)
    return len(fields) == count and any(map(_is_cell, fields))


def _is_cell(text: str) -> bool:
    """Return whether a text looks like a number or a time."""
    return bool(CELL.fullmatch(text.strip()))


def are_numbers(fields: Sequence[str]) -> bool:
    """Return whether most fields of a line are numbers or times."""
    return sum(map(_is_cell, fields)) > len(fields) / 2


def _are_units(fields: Sequence[str]) -> bool:
    cells = [f.strip().strip("[]()").strip() for f in fields]
    units = [c for c in cells if c not in ("", "-")]
    return bool(units) and all(UNIT.fullmatch(c) for c in units)


def decimal_sign(data: bytes, start: int, separator: str) -> str:
    """Return the decimal sign of a table: a comma if a cell shows that it is one.

    A cell such as 1,234 shows it only between semicolons, and if no cell has a point.
    Where all cells with a point are such as 1.234 between semicolons, nothing shows
    whether it is a sign of thousands, and the decimal sign is "".
    """
    if separator == ",":
        return "."
    mark = re.escape(separator)
    cell = rf'(?:^|\r|{mark})[ "]*([+-]?\d*,\d+(?:e[+-]?\d+)?)[ "]*(?=[\r\n]|$|{mark})'

    def cells(sign: str) -> Iterator[str]:
        form = re.compile(cell.replace(",", re.escape(sign)).encode(), re.M | re.I)
        found = form.finditer(data, start) if sign.encode() in data else ()  # far sooner
        return (c[1].decode() for c in found)

    for sign in ",." if separator == ";" else ",":
        if not all(map(THOUSANDS.fullmatch, cells(sign))):
            return sign
    if separator == ";" and any(cells(".")):
        return ""
    return "," if separator == ";" and any(cells(",")) else "."
