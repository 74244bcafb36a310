"""Pieces of Python text: what composed steps and compiled segments are written with."""

from __future__ import annotations

from collections.abc import Sequence


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
    return call(t, *(f"{s}.{name}" for name in fields[:-1]), cold)


def indented(lines: Sequence[str]) -> list[str]:
    return ["    " + line for line in lines]


def define(name: str, arguments: Sequence[str], body: Sequence[str]) -> str:
    """A function's text."""
    return "\n".join([f"def {call(name, *arguments)}:", *indented(body)]) + "\n"
