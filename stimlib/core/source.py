"""The source text of a class or a function."""

from __future__ import annotations

import linecache
import sys
from collections.abc import Callable
from typing import Any


def source_of(what: type | Callable) -> str:
    """Return the current source text that defines a class or a function.

    It is the text of its file or notebook cell, or "" where Python has kept none.
    """
    functions: list[Any] = [
        getattr(v, "__func__", v) for v in (what, *getattr(what, "__dict__", {}).values())
    ]
    codes = [
        f.__code__
        for f in functions
        if getattr(f, "__module__", None) == what.__module__ and hasattr(f, "__code__")
    ]
    for file in [
        *(c.co_filename for c in codes),
        getattr(sys.modules.get(what.__module__), "__file__", None) or "",
    ]:
        linecache.checkcache(file)
        if lines := linecache.getlines(file):
            return "".join(lines)
    return ""
