"""Generation of the Python source of composed steps and segments."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def each(form: str, *names: Iterable[object]) -> list[str]:
    """Format a template with %s once for each name, or for each row of names."""
    return [form % row for row in zip(*names, strict=True)]


def call(f: str, *values: str) -> str:
    """Return the source of a call."""
    return f"{f}({', '.join(values)})"


def record(t: str, values: Sequence[str]) -> str:
    """Return the source of a NamedTuple, or of () if it would be empty."""
    return call(t, *values) if values else "()"


def several(values: Sequence[str], many: bool) -> str:
    """Return the source of a tuple of values, or of a single value."""
    return call("", *values) if many else values[0]


def warm(t: str, fields: Sequence[str], s: str, cold: str = "0.0") -> str:
    """Return the source of a resettable block's new state after a sample in contact."""
    return call(t, *each(f"{s}.%s", fields[:-1]), cold)


def indented(lines: Iterable[str]) -> list[str]:
    """Indent lines by one level."""
    return each("    %s", lines)


def define(name: str, arguments: Sequence[str], body: Sequence[str]) -> str:
    """Return the source of a function."""
    return "\n".join([f"def {call(name, *arguments)}:", *indented(body)]) + "\n"
