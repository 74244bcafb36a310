"""Validation of JSON files from elsewhere: strict JSON, and a test for every field.

A test is a function that returns whether a value is good; those here are combined to
the description of a whole file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any


@dataclass(frozen=True)
class Test:
    """A test of a value: in words for a message, as a function, and as a JSON Schema.

    The schema may be weaker than the function.
    """

    wanted: str
    good: Callable[[Any], bool]
    schema: Mapping[str, Any] = field(default_factory=dict)

    __test__ = False  # pytest: this is none of yours

    def __call__(self, value: Any) -> bool:
        """Return whether a value passes."""
        return self.good(value)


def strict(data: bytes | str) -> Any:
    """Parse JSON; refuse numbers that are not finite and keys that are repeated.

    Raises
    ------
    ValueError
        Not JSON, a number that is not finite, or a key that is there twice.

    Examples
    --------
    >>> from stimlib.system import fields
    >>> fields.strict('{"fs": 8000, "fs": 44100}')
    Traceback (most recent call last):
    ValueError: 'fs' is there twice in one object; keep one of the two
    """
    try:
        return json.loads(
            data, parse_constant=_finite, parse_float=_finite, object_pairs_hook=_object
        )
    except RecursionError:
        raise ValueError("nested too deeply") from None


def parse(data: bytes) -> dict[str, Any]:
    """Parse a JSON object.

    Raises
    ------
    ValueError
        As `strict`, and what is not an object.

    Examples
    --------
    >>> from stimlib.system import fields
    >>> fields.parse(b'{"fs": 1e400}')
    Traceback (most recent call last):
    ValueError: 1e400 is not a finite number
    """
    found = strict(data)
    if not isinstance(found, dict):
        raise ValueError("not a JSON object")
    return found


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]} is not a finite number")
    return value


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(a for a, b in pairwise(sorted(key for key, _ in pairs)) if a == b)
        raise ValueError(f"{twice[:40]!r} is there twice in one object; keep one of the two")
    return found


def require(data: Mapping[str, Any], tests: Mapping[str, Test]) -> None:
    """Raise ValueError naming the first field that is missing or wrong.

    Examples
    --------
    >>> from stimlib.system import fields
    >>> fields.require({"fs": "fast"}, {"fs": fields.number})
    Traceback (most recent call last):
    ValueError: fs must be a finite number
    """
    for name, test in tests.items():
        if name not in data:
            raise ValueError(f"{name} is missing; it must be {test.wanted}")
        if not test(data[name]):
            raise ValueError(f"{name} must be {test.wanted}")


def schema(tests: Mapping[str, Test], title: str) -> dict[str, Any]:
    """Return the requirements of ``require`` as a JSON Schema (draft 2020-12).

    Examples
    --------
    >>> from stimlib.system import fields
    >>> fields.schema({"fs": fields.positive}, "a rate")["properties"]
    {'fs': {'description': 'a number above 0', 'type': 'number', 'exclusiveMinimum': 0}}
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        **record(tests).schema,
    }


def between(low: float, high: float) -> Test:
    """Return a test for a number in a range."""
    return Test(
        f"a number from {low:g} to {high:g}",
        lambda v: number(v) and low <= v <= high,
        {"type": "number", "minimum": low, "maximum": high},
    )


def whole(most: int) -> Test:
    """Return a test for a whole number from 0 to ``most``."""
    return Test(
        f"a whole number from 0 to {most}",
        lambda v: isinstance(v, int) and not isinstance(v, bool) and 0 <= v <= most,
        {"type": "integer", "minimum": 0, "maximum": most},
    )


def one_of(*values: str) -> Test:
    """Return a test for one of these texts."""
    return Test(
        f"one of {', '.join(values)}",
        lambda v: isinstance(v, str) and v in values,
        {"enum": list(values)},
    )


def table_of(test: Test) -> Test:
    """Return a test for a dict whose values all pass another test."""
    return Test(
        f"a table, each value {test.wanted}",
        lambda v: isinstance(v, dict) and all(map(test, v.values())),
        {"type": "object", "additionalProperties": test.schema},
    )


def list_of(test: Test) -> Test:
    """Return a test for a list whose items all pass another test."""
    return Test(
        f"a list, each value {test.wanted}",
        lambda v: isinstance(v, list) and all(map(test, v)),
        {"type": "array", "items": test.schema},
    )


def record(tests: Mapping[str, Test]) -> Test:
    """Return a test for a dict that has these keys, each with a valid value."""
    wanted = ", ".join(f"{name} ({test.wanted})" for name, test in tests.items())
    return Test(
        f"a table of {wanted}",
        lambda v: isinstance(v, dict) and all(n in v and t(v[n]) for n, t in tests.items()),
        {
            "type": "object",
            "required": list(tests),
            "properties": {n: {"description": t.wanted, **t.schema} for n, t in tests.items()},
        },
    )


def maybe(test: Test) -> Test:
    """Return a test for null, or for a value that passes another test."""
    return Test(
        f"{test.wanted} or null",
        lambda v: v is None or test(v),
        {"anyOf": [test.schema, {"type": "null"}]},
    )


def _number(v: Any) -> bool:
    if isinstance(v, float):
        return math.isfinite(v)
    # beyond, it is no longer the same as a float
    return isinstance(v, int) and not isinstance(v, bool) and abs(v) <= 2**53


text = Test("a text", lambda v: isinstance(v, str), {"type": "string"})
number = Test("a finite number", _number, {"type": "number"})
positive = Test(
    "a number above 0", lambda v: number(v) and v > 0, {"type": "number", "exclusiveMinimum": 0}
)
not_negative = Test(
    "a number, 0 or above", lambda v: number(v) and v >= 0, {"type": "number", "minimum": 0}
)
table = Test("a table", lambda v: isinstance(v, dict), {"type": "object"})
truth = Test("true or false", lambda v: isinstance(v, bool), {"type": "boolean"})
