"""What a step may say, checked on its source before any target runs it.

Straight-line code only: + - * /, comparisons, ``where(c, a, b)``, ``abs``, the functions of ``stimlib.maths``, helper
functions of the same kind, module-level numbers, NamedTuples, and ``for i in range(..)``.  So one text means the same
to the interpreter, the compiler and automatic differentiation.  A tile may also use ``if``, ``and``, ``or``: it is never
differentiated.
"""

from __future__ import annotations

import ast
import dis
import inspect
import textwrap
import types
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

from . import maths
from .errors import SceneError

_WORDS = {
    ast.Pow: "** differs between targets: multiply, or use maths.sqrt / exp / log",
    ast.If: "`if` chooses at run time: use where(c, a, b)",
    ast.IfExp: "`a if c else b` chooses at run time: use where(c, a, b)",
    ast.BoolOp: "`and`/`or` choose at run time: use where(c, a, b)",
    ast.While: "`while` has no fixed length: use for i in range(n)",
    ast.Not: "`not` on a number differs between targets: use where(c, 0.0, 1.0)",
}
_ALLOWED = (
    ast.FunctionDef, ast.arguments, ast.arg, ast.Return, ast.Assign, ast.AugAssign, ast.Expr, ast.For, ast.Tuple, ast.Name,
    ast.Load, ast.Store, ast.Constant, ast.Attribute, ast.Subscript, ast.Slice, ast.Call, ast.Compare, ast.cmpop, ast.BinOp,
    ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Mod, ast.RShift, ast.LShift, ast.BitAnd, ast.BitOr, ast.BitXor, ast.UnaryOp,
    ast.USub, ast.Starred,
)  # fmt: skip
_BUILTIN = {"abs": abs, "range": range}


def source(f: Callable) -> str:
    """Text of a function, dedented and without decorators; SceneError where Python has kept none."""
    try:
        text = textwrap.dedent(inspect.getsource(f))
    except (OSError, TypeError) as e:
        raise SceneError(
            f"{f.__qualname__}: its source text is not available ({e}); define the block in a file or a notebook cell, "
            "not in a string given to exec or python -c"
        ) from None
    lines = text.splitlines()
    first = _first_line(lines)
    if first is None:
        raise SceneError(f"{f.__qualname__}: write it with def, its text starts with {lines[0]!r}")
    return "\n".join(lines[first:]) + "\n"


def _first_line(lines: list[str]) -> int | None:
    """Index of the line with def, after the decorators."""
    return next((k for k, line in enumerate(lines) if line.startswith("def ")), None)


def used(code: types.CodeType) -> Iterator[str]:
    """Global names that compiled Python loads (co_names would also list attributes)."""
    yield from (i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL")
    for c in code.co_consts:
        if isinstance(c, types.CodeType):
            yield from used(c)


def names(f: Callable) -> dict[str, Any]:
    """Global names a function uses and what they stand for; SceneError for closures and unknown names."""
    if f.__closure__:
        raise SceneError(
            f"{f.__qualname__} closes over {', '.join(f.__code__.co_freevars)}: make it a field of the block that design(fs) "
            "puts into p, or a module-level number"
        )
    found = {}
    for n in dict.fromkeys(used(f.__code__)):
        if n in f.__globals__:
            found[n] = f.__globals__[n]
        elif n in _BUILTIN:
            found[n] = _BUILTIN[n]
        else:
            raise SceneError(f"{f.__qualname__} uses {n!r}, which is not defined; a step may call stimlib.maths, abs and range")
    return found


def check(f: Callable, tile: bool = False) -> None:
    """Raise SceneError, with file and line, where a step or tile says what not every target means alike.

    Examples
    --------
    >>> from stimlib.graph import Mul
    >>> from stimlib.steps import check
    >>> check(Mul.step)
    """
    _check(f, f.__code__, tile)


@cache
def _check(f: Callable, code: types.CodeType, tile: bool) -> None:  # the code too: a notebook may change a function in place
    _check_all(f, code, tile, ())


def _check_all(f: Callable, code: types.CodeType, tile: bool, above: tuple[Callable, ...]) -> None:
    text = source(f)
    lines = textwrap.dedent(inspect.getsource(f)).splitlines()
    offset = code.co_firstlineno - 1 + (_first_line(lines) or 0)

    def refuse(node, why):
        raise SceneError(f"{code.co_filename}:{getattr(node, 'lineno', 1) + offset}: {f.__qualname__}: {why}")

    known = names(f)
    for node in ast.walk(ast.parse(text)):
        if tile and isinstance(node, (ast.If, ast.BoolOp, ast.And, ast.Or)):
            continue
        for word in (node, getattr(node, "op", None)):  # an operator has no line of its own
            if type(word) in _WORDS:
                refuse(node, _WORDS[type(word)])
        if isinstance(node, ast.For):
            call = node.iter
            if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
                refuse(node, "loop with for i in range(..)")
        if isinstance(node, ast.Call):
            g = node.func
            if isinstance(g, ast.Attribute) and isinstance(g.value, ast.Name) and g.value.id in known:
                target = getattr(known[g.value.id], g.attr, None)
            elif isinstance(g, ast.Name):
                target = known.get(g.id)
            else:
                target = None
            if not _callable_in_step(target):
                refuse(node, f"call of {ast.unparse(g)}: a step may call stimlib.maths, abs, range and helpers like itself")
            if isinstance(target, types.FunctionType) and target.__module__ != maths.__name__:
                if target in (f, *above):
                    refuse(node, f"{target.__qualname__} calls itself: a step has no recursion")
                _check_all(target, target.__code__, False, (f, *above))
        if not isinstance(node, (ast.Module, *_ALLOWED)):
            refuse(node, f"{type(node).__name__} is not straight-line code")


def _callable_in_step(v: Any) -> bool:
    if v in (abs, range, np.uint64, np.int64):
        return True
    if isinstance(v, type):
        return hasattr(v, "_fields")
    return isinstance(v, types.FunctionType)
