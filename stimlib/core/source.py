"""The text that a class was defined by."""

from __future__ import annotations

import linecache
import sys


def source_of(cls: type) -> str:
    """Of the file, or the notebook cell, that a class is defined in, as it is now; "" where Python has kept none."""
    functions = (getattr(v, "__func__", v) for v in vars(cls).values())
    codes = [f.__code__ for f in functions if getattr(f, "__module__", None) == cls.__module__ and hasattr(f, "__code__")]
    for file in [*(c.co_filename for c in codes), getattr(sys.modules.get(cls.__module__), "__file__", None) or ""]:
        linecache.checkcache(file)
        if lines := linecache.getlines(file):
            return "".join(lines)
    return ""
