"""Pieces of Python text: what composed steps and compiled segments are written with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def each(form: str, *names: Iterable[object]) -> list[str]:
    """A form with %s, filled in once for each of the names, or rows of them."""
    return [form % row for row in zip(*names, strict=True)]


def call(f: str, *values: str) -> str:
    return f"{f}({', '.join(values)})"


def record(t: str, values: Sequence[str]) -> str:
    """A NamedTuple, or () where it would be empty."""
    return call(t, *values) if values else "()"


def several(values: Sequence[str], many: bool) -> str:
    """A tuple of many values, or the one."""
    return call("", *values) if many else values[0]


def warm(t: str, fields: Sequence[str], s: str, cold: str = "0.0") -> str:
    """A resettable block's new state after a sample in contact."""
    return call(t, *each(f"{s}.%s", fields[:-1]), cold)


def indented(lines: Iterable[str]) -> list[str]:
    return each("    %s", lines)


def define(name: str, arguments: Sequence[str], body: Sequence[str]) -> str:
    """A function's text."""
    return "\n".join([f"def {call(name, *arguments)}:", *indented(body)]) + "\n"
