"""Values of C: their kinds, and how numbers, names and tuples are written."""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

import numpy as np

from ..errors import SceneError

DOUBLE, WORD, WHOLE, TRUTH = "double", "uint64_t", "int64_t", "int"
NUMBERS = (DOUBLE, WORD, WHOLE, TRUTH)
FLOATS, WORDS = "st_floats", "st_words"  # arrays: a pointer and a number of elements
ELEMENTS = {FLOATS: DOUBLE, WORDS: WORD}
KINDS = {"f": DOUBLE, "u": WORD, "F": FLOATS, "U": WORDS}
NOTHING = "void"
RESERVED = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if"
    " inline int long register restrict return short signed sizeof static struct switch typedef"
    " union unsigned void volatile while and or not xor new delete this class template operator"
    " bool true false asm typeof namespace using try catch throw private public friend linux unix"
    " int64_t uint64_t NAN INFINITY"
    " y0 y1 yn j0 j1 jn gamma index fma sqrt floor fabs memcpy memset".split()
)


class Record(NamedTuple):
    """A C struct that stands for a tuple: its name, its fields and their kinds."""

    name: str
    fields: tuple[tuple[str, Any], ...]


Kind = Any
"""The kind of a value: a C type by name, a `Record`, or None for an empty tuple."""


class Value(NamedTuple):
    """A C expression and its kind; ``number`` if it is a plain number of Python."""

    text: str
    kind: Kind
    number: Any = None


def kind_name(kind: Kind) -> str:
    """Return the C type of a kind."""
    return kind.name if isinstance(kind, Record) else kind


def literal(v: Any) -> Value:
    """Return a number as C writes it, with all its digits."""
    if isinstance(v, np.uint64):
        return Value(f"UINT64_C({int(v)})", WORD)
    if isinstance(v, bool):
        return Value(str(int(v)), TRUTH)
    if isinstance(v, (int, np.integer)):
        v = int(v)
        if v >= 2**63:
            return Value(f"UINT64_C({v})", WORD)
        text = f"INT64_C({v})" if abs(v) >= 2**31 else f"{v}"
        return Value(text if v >= 0 else f"({text})", WHOLE, v)
    v = float(v)
    if math.isnan(v):
        return Value("NAN", DOUBLE)
    if math.isinf(v):
        return Value("INFINITY" if v > 0 else "(-INFINITY)", DOUBLE)
    return Value(repr(v) if v >= 0 and math.copysign(1, v) > 0 else f"({v!r})", DOUBLE)


def local(name: str) -> str:
    """Return a Python name as C takes it; no two names become the same.

    name.1 is the first variable that replaces one of this name.
    """
    if "." in name:
        return f"st_{name.replace('.', '_v')}"
    taken = name.rstrip("_") in RESERVED or name.startswith(("st_", "ST_", "stim_"))
    return f"{name}_" if taken else name


def element(array: Value, index: str) -> str:
    """Return an element of an array."""
    return f"st_word({array.text}, {index})" if array.kind == WORDS else f"{array.text}.p[{index}]"


def part(of: Value, k: int) -> Value:
    """Return the C expression for a part of a tuple; an empty part has no field."""
    fields = dict(of.kind.fields) if of.kind is not None else {}
    plain = of.kind is None or re.fullmatch(r"stim_tuple(_\d+)?", of.kind.name)
    name = f"a{k}" if plain and k >= 0 else list(fields)[k]
    return Value(f"{of.text}.{name}", fields[name]) if name in fields else Value("", None)


def in_single(text: str) -> str:
    """Return C code with ``float`` in place of ``double``, except in its comments."""
    parts = re.split(r"(/\*.*?\*/)", text, flags=re.DOTALL)
    for k in range(0, len(parts), 2):
        part = re.sub(r"\bdouble\b", "float", parts[k])
        part = re.sub(r"\b(fma|sqrt|floor|fabs|fmod|copysign)\(", r"\1f(", part)
        parts[k] = re.sub(r"(?<![\w.])\d+(\.\d*(e[-+]?\d+)?|e[-+]?\d+)", number_in_single, part)
    return "".join(parts)


def number_in_single(match: re.Match[str]) -> str:
    """Return a number in C code as a number of type float."""
    v = float(match[0])
    if v >= 2.0**128 - 2.0**103:
        raise SceneError(f"{match[0]} is beyond float32, so it cannot be exported in float32")
    return f"{np.float32(v)}f"


def rest(kind: Kind) -> str:
    """Return the initial value of a local variable, without which C++ warns."""
    return " = 0" if kind in NUMBERS else ""


def as_double(v: Value) -> str:
    """Return a value as a double."""
    if v.number is not None:
        return literal(float(v.number)).text
    return v.text if v.kind == DOUBLE else f"((double){v.text})"


def widened(v: Value) -> Value:
    """Return a plain number or truth value as a float, as tuples hold them."""
    return Value(as_double(v), DOUBLE) if v.kind == TRUTH or v.number is not None else v
