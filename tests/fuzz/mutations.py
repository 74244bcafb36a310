"""Changes of a good file that keep its form: of cells, of values in JSON, of arrays in
an npz, and of bytes.

Who chooses is a function, ``below(n)``, a whole number from 0 to n - 1.
"""

import io
import json
import re
import warnings
import zipfile
from collections.abc import Callable
from typing import Any

Below = Callable[[int], int]

NUMBERS = (
    "0 -0.0 1 -1 0.5 1e-308 5e-324 1e308 -1e308 1e309 nan inf -inf 1e-30 1e11 1e400 0x10 1_0 1,5"
    " \u0661 1e15".split()
)
TEXTS = [
    "",
    " ",
    '"',
    '"a',
    'a"b',
    "\x1b[31m",
    "\0",
    "\u202e",
    "\ud7ff",
    "'",
    ";",
    "a" * 300,
    "\r",
    "\n",
    "t_s",
    "x_m",
    "\ufeff",
]
VALUES: list[Any] = [
    None,
    True,
    False,
    0,
    -1,
    1,
    2**53,
    2**64,
    10**400,
    -(10**400),
    0.0,
    1e-308,
    1e308,
    1e17,
    0.5,
    "",
    "m",
    "m/0",
    "\x1b[31m",
    "\0",
    "\ud800",
    "a" * 5000,
    [],
    {},
    [0],
    [[]],
    {"": 0},
    [1e308] * 3,
]
HEADERS = [
    ("<f8", "<f4"),
    ("<f8", "|O"),
    ("<f8", "<c16"),
    ("<f8", "<U2"),
    ("<f8", ">f8"),
    ("<f8", "<U0"),
    ("(6,)", "(-1,)"),
    ("(6,)", "(8589934592,)"),
    ("(6,)", "(3, 2)"),
    ("(6,)", "()"),
    ("False", "True"),
    ("'<f8'", "[('a', '<f8')]"),
    ("}", "(" * 200),
    ("(6,)", "(6.0,)"),
    ("<f8", "<f7"),
    ("descr", "d"),
]
INTS = [0, 1, 2, 4, 8, 16, 127, 128, 255]


def pick(below: Below, items):
    return items[below(len(items))]


def mutated(data: bytes, kind: str, below: Below) -> bytes:
    """The bytes after one to four changes that fit the kind of file."""
    for _ in range(1 + below(4)):
        if below(4) == 0:
            data = _bytes(data, below)
        else:
            data = CHANGES.get(kind, _bytes)(data, below)
    return data


def _bytes(data: bytes, below: Below) -> bytes:
    out, how = bytearray(data), below(6)
    at, end = sorted((below(len(out) + 1), below(len(out) + 1)))
    if how == 0 and out:
        out[min(at, len(out) - 1)] ^= 1 << below(8)
    elif how == 1 and out:
        out[min(at, len(out) - 1)] = pick(below, INTS)
    elif how == 2:
        del out[at:end]
    elif how == 3:
        out[at:at] = out[at : min(end, at + 2000)]
    elif how == 4:
        size = pick(below, [2, 4, 8])
        whole = pick(below, [0, 1, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**64 - 1])
        out[at : at + size] = whole.to_bytes(8, "little")[:size]
    else:
        del out[at:]
    return bytes(out)


def _cells(data: bytes, below: Below) -> bytes:
    """Of a table: a cell, a row or a separator is another."""
    text = data.decode(errors="replace")
    separator = ";" if ";" in text else ","
    rows = [line.split(separator) for line in text.split("\n")]
    i = below(len(rows))
    row, how = rows[i], below(8)
    j = below(len(row))
    if how < 3:
        row[j] = pick(below, NUMBERS)
    elif how == 3:
        row[j] = pick(below, TEXTS)
    elif how == 4:
        rows.insert(below(len(rows) + 1), list(row))
    elif how == 5:
        if below(2):
            del rows[i]
        else:
            del row[j]
    elif how == 6:
        row.insert(j, pick(below, NUMBERS))
    else:
        for other in rows[1:]:
            if j < len(other):
                other[j] = pick(below, NUMBERS)
    return "\n".join(separator.join(row) for row in rows).encode("utf-8", "replace")


def _json(data: bytes, below: Below) -> bytes:
    """Of one value somewhere in JSON: another, a copy of another place's, none, or
    itself at another place.
    """
    lines = data.split(b"\n") if data.count(b"\n{") else [data]
    i = below(len(lines))
    try:
        tree = json.loads(lines[i])
    except (ValueError, RecursionError):
        return _bytes(data, below)
    places: list[tuple[Any, Any]] = []
    _places(tree, places)
    if places:
        holder, key = pick(below, places)
        how = below(4)
        if how == 0:
            del holder[key]
        elif how == 1:
            other, name = pick(below, places)
            holder[key] = json.loads(json.dumps(other[name]))
        else:
            holder[key] = pick(below, VALUES)
    lines[i] = json.dumps(tree).encode()
    return b"\n".join(lines)


def _places(tree: Any, found: list[tuple[Any, Any]]) -> None:
    for key, value in list(
        tree.items()
        if isinstance(tree, dict)
        else enumerate(tree)
        if isinstance(tree, list)
        else ()
    ):
        found.append((tree, key))
        _places(value, found)


def _archive(data: bytes, below: Below) -> bytes:
    """Of an npz: what an array says of itself, its values, its name or its packing; the
    archive stays whole.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as z:
            members = [(info.filename, z.read(info)) for info in z.infolist()][:20]
    except Exception:  # what is no archive any more is changed as bytes
        return _bytes(data, below)
    if not members:
        return _bytes(data, below)
    i = below(len(members))
    name, array = members[i]
    how = below(6)
    if how == 0:
        name = pick(
            below, ["t_s.npy", "x_m", "", "../a.npy", "\x1b[31m.npy", "a" * 3000, "contact.npy"]
        )
    elif how == 1:
        old, new = pick(below, HEADERS)
        array = array.replace(old.encode(), new.encode(), 1)
    elif how == 2:
        array = _bytes(array, below)
    elif how == 3:
        members.append(members[i])
    elif how == 4:
        array = array[:128] + _bytes(array[128:], below)
    members[i] = name, array
    if how == 5:
        del members[i]
    raw = io.BytesIO()
    packing = pick(
        below,
        [
            zipfile.ZIP_STORED,
            zipfile.ZIP_DEFLATED,
            zipfile.ZIP_DEFLATED,
            zipfile.ZIP_BZIP2,
            zipfile.ZIP_LZMA,
        ],
    )
    with warnings.catch_warnings(), zipfile.ZipFile(raw, "w", packing) as z:
        warnings.simplefilter("ignore")  # of names that are there twice
        for name, array in members:
            z.writestr(zipfile.ZipInfo(name), array, packing)
    return raw.getvalue()


def _elements(data: bytes, below: Below) -> bytes:
    """Of XML: a text is another, or a tag goes."""
    text = data.decode(errors="replace")
    texts, tags = (
        list(re.finditer(r"(?<=>)[^<>]+(?=<)", text)),
        list(re.finditer(r"<[^<>]*>", text)),
    )
    at = pick(below, tags if below(3) == 0 and tags else texts or [re.search("$", text)])
    new = (
        ""
        if text[at.start() : at.end()].startswith("<")
        else pick(below, NUMBERS if below(3) else TEXTS)
    )
    return (text[: at.start()] + new + text[at.end() :]).encode(errors="replace")


CHANGES: dict[str, Callable[[bytes, Below], bytes]] = {
    "csv": _cells,
    "table": _cells,
    "npz": _archive,
    "scene": _json,
    "sidecar": _json,
    "ahap": _json,
    "haptic": _json,
    "hjif": _json,
    "session": _json,
    "report": _json,
    "events": _json,
    "texture": _elements,
}
