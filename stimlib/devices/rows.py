"""Rows of numbers from other programs: the grammar of lines of text, and OSC messages.

docs/howto/rows.rst states the grammar and the reasons of rejected rows.
"""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from ..errors import shortened

# rows, each a list, or a dict if its numbers have labels; the sender's time of each in
# s, or nan if it sends none; and of each rejected row the reason and its beginning
Rows = tuple[list[Any], list[float], list[tuple[str, str]]]
MOST = 256  # rows that are taken at once, where more may wait
AT_ONCE = 0.01  # s; rows that took longer came while they were awaited
REMEDIES = {
    "no numbers": "send numbers only, such as 0.0127, or labels as in x:0.0127",
    "comma between digits": "say what a comma is: comma='separator' or comma='decimal'",
    "decimal point": "leave out comma='decimal', or send decimal commas only",
    "empty field": "send nan where a number is missing",
    "no JSON": 'send one object a line, such as {"x": 0.0127}',
    "label twice": "give each number of a row its own label",
    "no such label": "name a label that the rows have in columns, such as {'x': 'x'}; those of"
    " inner objects cannot be used",
    "no labels": "give the index of the number in columns, such as {'x': 0}",
    "too short": "count the numbers of a row from 0; a time is not counted",
    "no time": "send the time first, or leave out timed=True",
    "no OSC": "send Open Sound Control 1.0",
    "another address": "listen to the address that the sender uses",
    "not finite": "let the sender repeat the last number, or accept the silence",
    "outside its limits": "is scale missing? Compare scale and limits with the unit that is sent",
    "out of order": "use a cable or a transport that keeps the order",
    "repeated": "nothing: the sender repeated a row with its time",
    "partial line": "nothing: its beginning was missing",
}
NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?|nan", re.ASCII | re.IGNORECASE)
LABEL = re.compile(r"([^\W\d][\w./-]*)[:=](.*)")
SEPARATOR = re.compile(" ?[;,] ?| ")
CUT = b"\xe2\x80\xa6"  # an ellipsis, put before a line whose beginning is missing
# the struct format of an OSC argument by its type tag, with padding if it is no
# number; a text has {0} bytes and {1} NULs, a blob {2} bytes after its length
FORMATS = {"i": ">i", "f": ">f", "d": ">d", "h": ">q", "t": "8x", "b": "4x{2}x"}
FORMATS |= dict.fromkeys("crm", "4x") | dict.fromkeys("TFNI", "") | dict.fromkeys("sS", "{0}s{1}x")


def row_of(
    line: bytes, timed: bool = False, comma: str | None = None
) -> tuple[Any, float, str | None]:
    """Return the numbers of a line, the sender's time, and why it is rejected.

    Examples
    --------
    >>> from stimlib.devices.rows import row_of
    >>> row_of(b"12.5, 0.01 0.02", timed=True)
    ([0.01, 0.02], 12.5, None)
    >>> row_of(b"x:0.01")[0], row_of(b'{"x": 0.01}')[0]
    ({'x': 0.01}, {'x': 0.01})
    >>> row_of(b"0,0127")[2], row_of(b"0,0127", comma="decimal")[0]
    ('comma between digits', [0.0127])
    >>> row_of(b"hello")[2]
    'no numbers'
    """
    text = re.sub(r"[ \t\v\f]+", " ", line.decode("utf-8", "replace")).strip("\ufeff ")
    names: Sequence[Any] = ()
    fields = values = names
    if text.startswith("{"):
        with suppress(ValueError, RecursionError):
            names, values = zip(
                *json.loads(text, object_pairs_hook=list, parse_int=float), strict=True
            )
    else:
        bare = re.sub(r"^\[(.*)\]$|^\((.*)\)$", r"\1\2", text).strip(" ").rstrip(",; ")
        meant = re.sub(r"(?<=\d),(?=\d)", ".", bare) if comma == "decimal" else bare
        fields = SEPARATOR.split(re.sub(" ?([:=]) ?", r"\1", meant))
        if all(labelled := [LABEL.fullmatch(field) for field in fields]):
            names, fields = zip(*(m.groups() for m in labelled if m), strict=True)
        values = [float(field) if NUMBER.fullmatch(field) else field for field in fields]
    lone = re.search(r"\d,\d", text) and not all(re.search("[.eE]", field) for field in fields)
    at = values[0] if timed and values else math.nan
    wrong = {
        "partial line": line.startswith(CUT),
        "no JSON": not values,
        "comma between digits": comma is None and lone,
        "decimal point": comma == "decimal" and fields and "." in text,
        "empty field": "" in fields,
        "no numbers": not names and not all(isinstance(v, float) for v in values),
        "label twice": len({*names}) < len(names),
        "no time": timed and not (isinstance(at, float) and math.isfinite(at)),
    }
    row = dict(zip(names, values, strict=True)) if names else values[timed:]
    return row, at, next(filter(wrong.get, wrong), None)


def rows_of(lines: Sequence[bytes], timed: bool, comma: str | None) -> Rows:
    """Return the rows of lines; blank lines are nothing."""
    found = [(line, *row_of(line, timed, comma)) for line in lines if line.strip()]
    return (
        [row for _, row, _, why in found if not why],
        [at for *_, at, why in found if not why],
        [(why, shown_of(line)) for line, *_, why in found if why],
    )


def shown_of(data: bytes) -> str:
    """Return the beginning of what came, in at most 40 characters."""
    return shortened(data[:80].decode("utf-8", "replace"), 40)


def osc_messages(data: bytes) -> list[tuple[bytes, list[Any]]]:
    r"""Return the address and the arguments of each OSC message of a datagram.

    Texts are bytes, and other arguments that are no numbers None.  The brackets of
    arrays are passed over.

    Raises
    ------
    ValueError, KeyError, struct.error, RecursionError
        The datagram is not OSC 1.0, or is truncated.

    Examples
    --------
    >>> from stimlib.devices.rows import osc_messages
    >>> osc_messages(b"/hand\0\0\0,i\0\0\0\0\0\5")
    [(b'/hand', [5])]
    """
    if data.startswith(b"#bundle\0"):
        at, found = 16, []
        while at != len(data):
            (size,) = struct.unpack_from(">I", data, at)
            found += osc_messages(*struct.unpack_from(f"{size}s", data, at + 4))
            at += 4 + size
        return found
    values: list[Any] = []
    tags, at, n = ["s", "s"], 0, 0
    for tag in tags:  # of the address, of the type tags, and those
        if tag in "sS":
            n = data.index(b"\0", at) - at
        elif tag == "b":
            n = struct.unpack_from(">I", data, at)[0] + 3
        form = FORMATS[tag].format(n, 4 - n % 4, n // 4 * 4)
        values.append((*struct.unpack_from(form, data, at), None)[0])
        at += struct.calcsize(form)
        if len(values) == 2:
            tags += values[1].decode()[1:].translate(dict.fromkeys(b"[]"))
    if values[0][:1] + values[1][:1] != b"/,":
        raise ValueError("no address, or no type tags")
    return [(values[0], values[2:])]


def osc_text(text: str) -> bytes:
    r"""Return a text as OSC has it: with one to four NULs, to a multiple of four bytes.

    Examples
    --------
    >>> from stimlib.devices.rows import osc_text
    >>> osc_text("/hand")
    b'/hand\x00\x00\x00'
    """
    return (data := text.encode()) + b"\0" * (4 - len(data) % 4)
