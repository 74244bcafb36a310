"""Values of C: their kinds, and how numbers, names and tuples are written."""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

import numpy as np

from ..errors import SceneError

C_TYPES = {
    "f8": "double", "u8": "uint64_t", "i8": "int64_t", "b1": "int", "void": "void",
    "f8*": "st_floats", "u8*": "st_words",  # arrays: a pointer and a number of elements
}  # fmt: skip
KINDS = {"f": "f8", "u": "u8", "F": "f8*", "U": "u8*"}
"""Kinds of numbers and arrays, by those of parameters and state."""
RESERVED = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if"
    " inline int long register restrict return short signed sizeof static struct switch typedef"
    " union unsigned void volatile while and or not xor new delete this class template operator"
    " bool true false asm typeof namespace using try catch throw private public friend linux unix"
    " alignas alignof and_eq bitand bitor char8_t char16_t char32_t co_await co_return co_yield"
    " compl concept const_cast consteval constexpr constinit decltype dynamic_cast explicit export"
    " mutable noexcept not_eq nullptr or_eq reinterpret_cast requires static_assert static_cast"
    " thread_local typeid typename typeof_unqual virtual wchar_t xor_eq"
    " int64_t uint64_t NAN INFINITY M_PI DBL_MAX FLT_MAX INT64_MAX"
    " y0 y1 yn j0 j1 jn gamma index fma sqrt floor fabs rint memcpy memset".split()
)


Kind = Any
"""The kind of a value: one of ``C_TYPES``, or a tuple's type and the kinds in it."""


class Fixed(NamedTuple):
    """The kind of what is known now: C has no argument for it."""

    value: Any
    text: str  # 0.0 is equal to -0.0


def literal(v: Any, kind: str = "") -> str:
    """Return a number as C writes it, with all its digits."""
    if kind == "u8" or isinstance(v, np.uint64):
        return f"UINT64_C({int(v)})"
    if isinstance(v, int):
        text = "INT64_MIN" if v == -(2**63) else f"INT64_C({v})" if abs(v) >= 2**31 else f"{v}"
        return text if v >= 0 else f"({text})"
    v = float(v)
    if math.isnan(v):
        return "NAN"
    if math.isinf(v):
        return "INFINITY" if v > 0 else "(-INFINITY)"
    return repr(v) if v >= 0 and math.copysign(1, v) > 0 else f"({v!r})"


def local(name: str) -> str:
    """Return a Python name as C takes it; no two names become the same.

    name.1 is the first variable that replaces one of this name.
    """
    if "." in name:
        return f"st_{name.replace('.', '_v')}"
    taken = name.rstrip("_") in RESERVED or name.startswith(("st_", "ST_", "stim_"))
    return f"{name}_" if taken else name


def named(kind: Kind) -> list[tuple[str, Kind]]:
    """Return the parts of a tuple: their names in C, and their kinds."""
    t, *kinds = kind
    names = getattr(t, "_fields", [f"a{k}" for k in range(len(kinds))])
    return [(local(n), k) for n, k in zip(names, kinds, strict=True)]


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
