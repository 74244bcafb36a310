"""Changes of a good file that keep its form: of cells, of values in JSON, of arrays in
an npz, and of bytes.
"""

import io
import json
import re
import warnings
import zipfile
from random import Random

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
VALUES = [
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
NAMES = ["t_s.npy", "x_m", "", "../a.npy", "\x1b[31m.npy", "a" * 3000, "contact.npy"]
INTS = [0, 1, 2, 4, 8, 16, 127, 128, 255]
WHOLE = [0, 1, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**64 - 1]
STORED, DEFLATED = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
PACKINGS = [STORED, DEFLATED, DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]


def mutated(data: bytes, kind: str, chance: Random) -> bytes:
    """The bytes after one to four changes that fit the kind of file."""
    for _ in range(chance.randint(1, 4)):
        of_its_kind = CHANGES.get(kind, _bytes)
        data = chance.choice([_bytes, of_its_kind, of_its_kind, of_its_kind])(data, chance)
    return data


def _bytes(data: bytes, chance: Random) -> bytes:
    out = bytearray(data)
    at, end = sorted(chance.choices(range(len(out) + 1), k=2))
    match chance.randrange(6):
        case 0 if out:
            out[at - 1] ^= 1 << chance.randrange(8)
        case 1 if out:
            out[at - 1] = chance.choice(INTS)
        case 2:
            del out[at:end]
        case 3:
            out[at:at] = out[at : min(end, at + 2000)]
        case 4:
            size = chance.choice([2, 4, 8])
            out[at : at + size] = chance.choice(WHOLE).to_bytes(8, "little")[:size]
        case 5:
            del out[at:]
    return bytes(out)


def _cells(data: bytes, chance: Random) -> bytes:
    """Of a table: a cell, a row or a separator is another."""
    text = data.decode(errors="replace")
    separator = ";" if ";" in text else ","
    rows = [line.split(separator) for line in text.split("\n")]
    row = chance.choice(rows)
    at = chance.randrange(len(row))
    match chance.randrange(9):
        case 0 | 1 | 2:
            row[at] = chance.choice(NUMBERS)
        case 3:
            row[at] = chance.choice(TEXTS)
        case 4:
            rows.insert(chance.randrange(len(rows) + 1), list(row))
        case 5:
            rows.remove(row)
        case 6:
            del row[at]
        case 7:
            row.insert(at, chance.choice(NUMBERS))
        case 8:
            for other in rows[1:]:
                if at < len(other):
                    other[at] = chance.choice(NUMBERS)
    return "\n".join(separator.join(row) for row in rows).encode("utf-8", "replace")


def _json(data: bytes, chance: Random) -> bytes:
    """Of one value somewhere in JSON: another, a copy of another place's, none, or
    itself at another place.
    """
    lines = data.split(b"\n") if data.count(b"\n{") else [data]
    at = chance.randrange(len(lines))
    try:
        tree = json.loads(lines[at])
        places = [*_places(tree)]
        holder, key = chance.choice(places)
    except (ValueError, IndexError, RecursionError):
        return _bytes(data, chance)
    match chance.randrange(4):
        case 0:
            del holder[key]
        case 1:
            other, name = chance.choice(places)
            holder[key] = json.loads(json.dumps(other[name]))
        case _:
            holder[key] = chance.choice(VALUES)
    lines[at] = json.dumps(tree).encode()
    return b"\n".join(lines)


def _places(tree):
    """Each holder and key of a tree."""
    if isinstance(tree, dict | list):
        for key in [*tree] if isinstance(tree, dict) else range(len(tree)):
            yield tree, key
            yield from _places(tree[key])


def _archive(data: bytes, chance: Random) -> bytes:
    """Of an npz: what an array says of itself, its values, its name or its packing; the
    archive stays whole.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as z:
            members = [(info.filename, z.read(info)) for info in z.infolist()][:20]
        at = chance.randrange(len(members))
    except Exception:  # what is no archive any more is changed as bytes
        return _bytes(data, chance)
    name, array = members[at]
    match chance.randrange(6):
        case 0:
            members[at] = chance.choice(NAMES), array
        case 1:
            old, new = chance.choice(HEADERS)
            members[at] = name, array.replace(old.encode(), new.encode(), 1)
        case 2:
            members[at] = name, _bytes(array, chance)
        case 3:
            members.append(members[at])
        case 4:
            members[at] = name, array[:128] + _bytes(array[128:], chance)
        case 5:
            del members[at]
    raw, packing = io.BytesIO(), chance.choice(PACKINGS)
    with warnings.catch_warnings(), zipfile.ZipFile(raw, "w", packing) as z:
        warnings.simplefilter("ignore")  # of names that are there twice
        for name, array in members:
            z.writestr(zipfile.ZipInfo(name), array, packing)
    return raw.getvalue()


def _elements(data: bytes, chance: Random) -> bytes:
    """Of XML: a text is another, or a tag goes."""
    text = data.decode(errors="replace")
    found, new = (
        (r"(?<=>)[^<>]+(?=<)", chance.choice([*NUMBERS, *TEXTS]))
        if chance.randrange(3)
        else (r"<[^<>]*>", "")
    )
    at = chance.choice([*re.finditer(found, text)] or [re.search("$", text)])
    return (text[: at.start()] + new + text[at.end() :]).encode(errors="replace")


CHANGES = {
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
