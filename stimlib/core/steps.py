"""The Python that a step may use, checked on its source before any target runs it.

Straight-line code only: + - * /, comparisons, ``where(c, a, b)``, ``abs``, the
functions of ``stimlib.core.maths``, helper functions of the same kind, module-level
numbers, NamedTuples, and ``for i in range(..)``.  So one text means the same to the
interpreter, the compiler and automatic differentiation.  A tile may also use ``if``,
``and``, ``or``: it is never differentiated.

What the source does not tell, the kinds of values, is seen by running one sample:
``rehearse``.
"""

from __future__ import annotations
import __future__

import ast
import dis
import inspect
import re
import textwrap
import traceback
import types
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import chain, product
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import BadValue, SceneError, StimlibError, counted, line_of
from . import maths
from .graph import Block, Const, kind, pack, signals, unpack
from .parameter import Param

_HERE = str(Path(__file__).parents[1])  # the library: a line in it is no author's

_WORDS = {
    ast.FloorDiv: "// differs between targets: use maths.floor(a / b)",
    ast.Pow: "** differs between targets: multiply, or use maths.sqrt / exp / log",
    ast.If: "`if` chooses at run time: use where(c, a, b)",
    ast.IfExp: "`a if c else b` chooses at run time: use where(c, a, b)",
    ast.BoolOp: "`and`/`or` choose at run time: use where(c, a, b)",
    ast.While: "`while` has no fixed length: use for i in range(n)",
    ast.Not: "`not` on a number differs between targets: use where(c, 0.0, 1.0)",
}
_MIXED = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Mod: "mod"}
_MIXED_SAYS = (
    "arithmetic with a np.uint64 and a whole number differs between targets: beside a np.uint64"
    " write np.uint64(1), not 1, or make both np.int64(..)"
)
_ALLOWED = frozenset(
    "Module FunctionDef arguments arg Return Assign AugAssign Expr For Tuple Name Load Store"
    " Constant Attribute Subscript Slice Call Compare Eq NotEq Lt LtE Gt GtE Is IsNot In NotIn"
    " BinOp Add Sub Mult Div Mod RShift LShift BitAnd BitOr BitXor UnaryOp USub Starred"
    " keyword".split()
)
_BUILTIN = {"abs": abs, "range": range}
_INSTEAD = {  # of what authors try
    "min": "where(a < b, a, b)",
    "max": "where(a > b, a, b)",
    "round": "maths.floor(x + 0.5)",
    "int": "np.int64(x)",
    "len": "the array's .size",
    "float": "the number itself, or maths.as_float of a uint64",
    "pow": "products, or maths.exp",
}
_REMEDIES = {  # by what Python says when a step runs
    "interpreted as an integer": (
        "numbers in p, in s and of signals are floats, and range counts whole ones:"
        " range(np.int64(n))"
    ),
    "invalid index to scalar": "only arrays have an index",
    "local variable": "give it a value above this line",
    "read-only": "a step may write only into arrays of its own state, and a tile into its outputs",
}


def source(f: Callable) -> str:
    """Return the source text of a function, dedented and without decorators.

    SceneError is raised where Python has kept none.
    """
    return _source(f, f.__code__)[0]


@cache
def _source(f: Callable, code: types.CodeType) -> tuple[str, int]:
    """Return the source text of a function, and the number of file lines before it."""
    try:
        lines, begin = inspect.findsource(f)
    except (OSError, TypeError) as e:
        raise SceneError(
            f"{f.__qualname__}: its source text is not available ({e}); define the block in a file"
            " or a notebook cell, not in a string given to exec or python -c"
        ) from None
    # there are lines of ends where there are columns: unless Python was told otherwise
    ends = [end or 0 for _, end, column, _ in code.co_positions() if column is not None]
    # to read tokens until the function ends takes longer than all else here
    block = lines[begin : max(ends)] if ends else inspect.getblock(lines[begin:])
    whole = "".join(block)
    lines = textwrap.dedent(whole).splitlines()
    # after the decorators
    first = next((k for k, line in enumerate(lines) if line.startswith("def ")), None)
    if first is None and code.co_name == "<lambda>":
        raise SceneError(f"{f.__qualname__}: write it with def, its text starts with {lines[0]!r}")
    text = "\n".join(lines[first:]) + "\n"
    # closures are refused elsewhere
    same = code.co_freevars or _was_compiled(whole, begin, f) or _is_text_of(text, code)
    if first is None or not same:
        raise SceneError(
            f"{f.__qualname__}: the text in {code.co_filename} is no longer what was imported, so a"
            " compiler would run another step than the interpreter; start Python again, or reload"
            " the module"
        )
    return text, code.co_firstlineno - 1 + first


def _was_compiled(text: str, line: int, f: Callable) -> bool:
    """Return whether a text at its place in a file compiles to the very code.

    `_is_text_of` also finds the same instructions elsewhere, and takes longer.
    """
    code, names = f.__code__, f.__globals__
    # Python compiles a call differently if it sees the import of the called name
    modules = [n for n in code.co_names if isinstance(names.get(n), types.ModuleType)]
    above = f"import {','.join(modules)}" * bool(modules) + "\n" * (line - 1)
    above += "if 1:\n" if text[:1].isspace() else "\n"
    flags = code.co_flags & __future__.annotations.compiler_flag
    try:
        made = compile(above + text, code.co_filename, "exec", flags, dont_inherit=True)
    except (SyntaxError, ValueError):
        return False
    return code in made.co_consts


def _is_text_of(text: str, code: types.CodeType) -> bool:
    """Return whether a source text compiles to the code that a function runs.

    Its file may have been edited since it was imported.
    """
    try:
        made = compile(text, code.co_filename, "exec", dont_inherit=True).co_consts
    except (SyntaxError, ValueError):
        return False
    return any(
        _instructions(c) == _instructions(code) for c in made if isinstance(c, types.CodeType)
    )


def _instructions(code: types.CodeType) -> list[tuple]:
    """Return compiled instructions in a form that allows comparison.

    Python compiles a call differently if it sees the import of the called name; that
    difference is removed.
    """
    found: list[tuple] = [code.co_varnames]
    for i in dis.get_instructions(code):
        if i.opname not in ("PUSH_NULL", "NOP", "EXTENDED_ARG"):
            what = None if i.opcode in dis.hasjrel else i.argval  # a jump's target depends on those
            inner = _instructions(what) if isinstance(what, types.CodeType) else repr(what)
            found.append(("LOAD_ATTR" if i.opname == "LOAD_METHOD" else i.opname, inner))
    return found


def used(code: types.CodeType) -> Iterator[tuple[str, int]]:
    """Return the global names that compiled Python loads, with their lines.

    co_names would also list attributes.
    """
    for i in dis.get_instructions(code):
        if i.opname == "LOAD_GLOBAL":
            yield i.argval, (i.positions and i.positions.lineno) or code.co_firstlineno
    for c in code.co_consts:
        if isinstance(c, types.CodeType):
            yield from used(c)


def names(f: Callable) -> dict[str, Any]:
    """Return the global names of a function and their values.

    SceneError is raised for closures and unknown names.
    """
    if f.__closure__:
        raise SceneError(
            f"{f.__qualname__} closes over {', '.join(f.__code__.co_freevars)}: make it a field of"
            " the block that design(fs) puts into p, or a module-level number"
        )
    found = {}
    for n, line in used(f.__code__):
        if n in f.__globals__:
            found[n] = f.__globals__[n]
        elif n in _BUILTIN:
            found[n] = _BUILTIN[n]
        else:
            raise SceneError(
                f"{f.__code__.co_filename}:{line}: {f.__qualname__}: "
                + (f"write {_INSTEAD[n]} for {n!r}" if n in _INSTEAD else f"{n!r} is not defined")
                + "; a step may call stimlib.core.maths, abs and range"
            )
    return found


@cache
def _used(code: types.CodeType) -> tuple[str, ...]:
    return tuple(dict.fromkeys(n for n, _ in used(code)))


def meaning(f: Any) -> tuple[Any, ...]:
    """Return the current values of the names in a function and its helpers.

    In a notebook, the cells of the helpers may be run again without the function's own
    cell.
    """
    found: list[Any] = []
    todo, seen = [f], {f}
    while todo:
        g = todo.pop()
        for n in _used(g.__code__):
            v = g.__globals__.get(n)
            if isinstance(v, types.FunctionType) and v.__module__ != maths.__name__:
                found.append((n, v, v.__code__, v.__defaults__))
                todo += [v] if v not in seen else []
                seen.add(v)
            elif isinstance(v, (int, float, np.generic)):
                found.append((n, type(v), repr(v)))  # -0.0 is not 0.0
            else:
                found.append((n, v if isinstance(v, (type, types.ModuleType)) else id(v)))
    return tuple(found)


def check(f: Callable, tile: bool = False) -> None:
    """Raise SceneError, with file and line, where a step is not portable.

    A step or tile may only use what every target supports in the same way.

    Examples
    --------
    >>> from stimlib.core.graph import Mul
    >>> from stimlib.core.steps import check
    >>> check(Mul.step)
    """
    _check(f, f.__code__, tile)


@cache
# the code too: a notebook may change a function in place
def _check(f: Callable, code: types.CodeType, tile: bool) -> None:
    _check_all(f, code, tile, ())


def _check_all(f: Callable, code: types.CodeType, tile: bool, above: tuple[Callable, ...]) -> None:
    """Check a function and every helper that it calls.

    above: the functions that call it.
    """
    text, offset = _source(f, code)
    known = names(f)
    tree = ast.parse(text)
    body = tree.body[0].body  # type: ignore[attr-defined]
    if isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
        del body[0]  # the docstring
    for node in ast.walk(tree):  # types that an author notes are nothing that runs
        if isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.FunctionDef):
            node.returns = None
    for node in ast.walk(tree):
        if tile and isinstance(node, ast.If | ast.BoolOp | ast.boolop):
            continue
        helper = _helper(node, known)
        faults = _faults(node, known)
        if helper in (f, *above):
            recursion = f"{helper.__qualname__} calls itself: a step has no recursion"
            faults = chain(faults, [(node, recursion)])
        for at, why in faults:
            line = getattr(at, "lineno", 1) + offset
            raise SceneError(f"{code.co_filename}:{line}: {f.__qualname__}: {why}")
        if helper:
            _check_all(helper, helper.__code__, False, (f, *above))


def _helper(node: ast.AST, known: dict[str, Any]) -> Any:
    """Return the author's helper that a node calls, directly or by ``maths.each``."""
    if not isinstance(node, ast.Call):
        return None
    target = _target(node.func, known)
    if (
        target in (maths.each, maths.pairs, maths.series)
        and node.args
        and isinstance(node.args[0], ast.Name)
    ):
        target = known.get(node.args[0].id)
    ours = isinstance(target, types.FunctionType) and target.__module__ != maths.__name__
    return target if ours else None


Faults = Iterator[tuple[ast.AST, str]]
"""Where something is wrong, and what."""


def _faults(node: ast.AST, known: dict[str, Any]) -> Faults:
    """Yield the faults of a node: what not every target supports in the same way.

    known: what names stand for.
    """
    for word in (node, getattr(node, "op", None)):  # an operator has no line of its own
        if type(word) in _WORDS:
            yield node, _WORDS[type(word)]
    if type(node) in _RULES:
        yield from _RULES[type(node)](node, known)
    name = type(node).__name__
    if name not in _ALLOWED:
        yield node, f"{ast.unparse(node)[:60]!r} ({name}) is not straight-line code"


def _of_defaults(node: Any, known: dict[str, Any]) -> Faults:
    for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
        if any(isinstance(n, ast.Name) for n in ast.walk(default)):
            yield (
                default,
                f"write the default {ast.unparse(default)!r} as a number, or use it as a name"
                " inside",
            )


def _of_loop(node: Any, known: dict[str, Any]) -> Faults:
    func = getattr(node.iter, "func", None)
    if not (isinstance(func, ast.Name) and func.id == "range"):
        yield node, "loop with for i in range(..)"


def _of_sum(node: Any, known: dict[str, Any]) -> Faults:
    compared = isinstance(node.left, ast.Compare) and isinstance(node.right, ast.Compare)
    if compared and isinstance(node.op, ast.Add | ast.Sub):
        yield node, "a sum of two comparisons differs between targets: use where(c, 1.0, 0.0)"
    left, right = (_number(n, known) for n in (node.left, node.right))
    if isinstance(node.op, ast.LShift | ast.RShift):
        if isinstance(right, int | np.integer) and not 0 <= right < 64:
            yield node, f"a shift by {right} differs between targets: write 0 to 63"
    elif type(node.op) in _MIXED and {type(left), type(right)} >= {int, np.uint64}:
        yield node, _MIXED_SAYS


def _number(node: ast.expr, known: dict[str, Any]) -> Any:
    """Return the number that an expression stands for, such as 3, N, np.uint64(3).

    Of an unknown number, np.uint64 and np.int64 give 0; what is no number gives None.
    """
    if isinstance(node, ast.Constant):
        return node.value
    if isinstance(node, ast.Call) and len(node.args) == 1:
        n = _number(node.args[0], known)
        kinds = {np.uint64: np.uint64, maths.bits: np.uint64, np.int64: int}
        made = kinds.get(_target(node.func, known))
        return made and made(n if isinstance(n, int) and 0 <= n < 2**64 else 0)
    found = _target(node, known)
    return int(found) if isinstance(found, np.signedinteger) else found


def _of_call(node: Any, known: dict[str, Any]) -> Faults:
    target, said = _target(node.func, known), ast.unparse(node.func)
    if not _callable_in_step(target):
        if said.startswith("stimlib."):
            yield (
                node,
                f"{said}: write `from stimlib.core import maths` above the class, and"
                f" maths.{said.rpartition('.')[2]} here",
            )
        yield (
            node,
            f"call of {said}: a step may call stimlib.core.maths, abs, range and helpers like"
            " itself",
        )
    if not any(isinstance(a, ast.Starred) for a in node.args):
        yield from _of_arguments(target, node)


def _of_arguments(target: Any, call: ast.Call) -> Faults:
    """Yield calls with arguments that the function or NamedTuple does not take."""
    try:
        takes = inspect.signature(target)
    except ValueError:  # range, whose arguments are checked when it runs
        return
    named = [k.arg for k in call.keywords]
    if named and not (isinstance(target, type) and None not in named):
        yield (
            call,
            f"{ast.unparse(call)}: give the arguments by place; only those of a NamedTuple may have"
            " names",
        )
    try:
        takes.bind(*call.args, **dict.fromkeys(map(str, named)))
    except TypeError as e:
        form = f"{target.__name__}({', '.join(takes.parameters)})"
        yield call, f"{ast.unparse(call)}: it is {form}: {e}"


def _of_constant(node: Any, known: dict[str, Any]) -> Faults:
    if not isinstance(node.value, (int, float)):
        yield node, f"{node.value!r} is not a number, and a step has nothing else"


_RULES: dict[type, Callable[[Any, dict[str, Any]], Faults]] = {
    ast.FunctionDef: _of_defaults,
    ast.For: _of_loop,
    ast.BinOp: _of_sum,
    ast.Call: _of_call,
    ast.Constant: _of_constant,
}


# A whole block ------------------------------------------------------------------------
def check_design(cls: Any, made: Any) -> None:
    """Raise SceneError unless every target supports the result of ``design``.

    Parameters and state must fit into flat memory.
    """

    def refuse(why: str) -> None:
        raise SceneError(f"{line_of(cls.design)}{cls.__name__}.design: {why}")

    pair = type(made) is tuple and len(made) == 2
    if not pair or not all(isinstance(t, tuple) and (not t or fields(t)) for t in made):
        refuse(
            "it must return parameters and state, two NamedTuples (or () where there is nothing to"
            f" keep), and returned {made!r:.200}"
        )
    for what, t in zip(("parameters", "state"), made, strict=True):
        for name, v in zip(fields(t), t, strict=True):
            if isinstance(v, np.ndarray):
                kept, shape = v.ndim == 1 and v.dtype.kind in "iuf", f" {v.shape} of {v.dtype}"
            else:
                kept, shape = isinstance(v, (float, np.integer, np.floating)), ""
                kept |= isinstance(v, int) and abs(v) < 2.0**1023
            if not kept:
                refuse(
                    f"{what} {name!r} is a {type(v).__name__}{shape}; floats, np.uint64 and arrays"
                    " of them with one dimension are possible"
                )
    cold = getattr(made[1], "cold", 1.0) if cls.resettable else 1.0
    if isinstance(cold, (np.ndarray, np.uint64)) or not 0 < cold < np.inf:
        refuse(
            f"cold = {cold!r} in the state of a resettable block must be a float above 0: write 1.0"
        )


def designed(block: Block, fs: float) -> tuple[Any, Any]:
    """Return the result of a block's ``design``.

    SceneError, with file and line, if its code is faulty.

    Examples
    --------
    >>> from stimlib.core.graph import Input
    >>> from stimlib.core.steps import designed
    >>> designed(Input("x") * 2.0, 1000.0)
    ((), ())
    """
    cls, f = type(block), block.frequency
    try:
        if isinstance(f, Const | Param):
            block.check_rate(f.value, fs)
        pair = block.design(fs)
    except Exception as e:
        if (
            ours(cls)
            and isinstance(e, ArithmeticError | MemoryError | ValueError)
            and not isinstance(e, StimlibError)
        ):
            # the function that made it
            name = re.sub("(?<=[a-z])(?=[A-Z])", "_", cls.__name__).lower()
            raise BadValue(
                f"{name}: {type(e).__name__} in the design of {block!r} at fs = {fs:g} Hz: its"
                " numbers are beyond a float, or the memory is too small; check the unit of each"
                " number, or choose another fs"
            ) from e
        if isinstance(e, StimlibError) and e.args:
            e.args = (block.made_at + str(e.args[0]), *e.args[1:])
        if isinstance(e, StimlibError) or ours(cls):
            raise
        raise SceneError(
            f"{line_of(cls.design)}{cls.__name__}.design: {type(e).__name__}: {e}"
        ) from e
    check_design(cls, pair)
    # of the library's own, tests check it: it takes a third of a program's start
    if block.definition is cls and not ours(cls):
        check_block(cls, getattr(cls.tile or cls.step, "__code__", None), *map(type, pair))
        pair = tuple(unpack(t, pack(t)) for t in pair)  # floats of an author's whole numbers
    return pair


def ours(cls: Any) -> bool:
    """Return whether a class or a function belongs to the library."""
    return str(cls.__module__).partition(".")[0] == "stimlib"


@cache
def check_block(cls: Any, code: types.CodeType | None, p_type: type, s_type: type) -> None:
    """Check that a block's step fits its class, and what ``design`` returns.

    SceneError with file and line if it does not.

    code is that of the step: a notebook may change it in place.
    """
    name = "tile" if cls.tile is not None else "step"
    f = getattr(cls, name)
    if f is None:
        raise SceneError(
            f"{cls.__name__} has neither a step nor a tile: write step(p, s,"
            f" {', '.join(signals(cls))})"
        )

    def refuse(line: int, why: str) -> None:
        raise SceneError(f"{f.__code__.co_filename}:{line}: {cls.__name__}.{name}: {why}")

    for why in _faults_of_form(cls, name, f, s_type):
        refuse(f.__code__.co_firstlineno, why)
    try:
        text, offset = _source(f, f.__code__)
    except SceneError:  # the interpreter needs no text; a compiler raises the same
        return
    body = ast.parse(text).body[0]
    check(f, tile=name == "tile")
    p, s, *x = inspect.signature(f).parameters
    read = {p, *x[: len(signals(cls)) - cls.resettable]}
    tuples = {p: ("parameters", fields(p_type)), s: ("state", fields(s_type))}
    new = f"the new state {s_type.__name__}(..)" if fields(s_type) else s
    for at, why in chain(
        _faults_of_fields(body, tuples, read, names(f)), _faults_of_ends(body, cls, f, s_type, new)
    ):
        refuse(getattr(at, "lineno", 1) + offset, why)


def _faults_of_form(cls: Any, name: str, f: Any, s_type: type) -> Iterator[str]:
    """Yield what is wrong with the way a step is declared."""
    wanted = ["p", "s", *signals(cls)]
    if cls.resettable:
        del wanted[-1]
    if name == "tile":
        wanted += [*(cls.outputs or "y"), *("w" if cls.work else "")]
    form = ", ".join(wanted)
    if not isinstance(inspect.getattr_static(cls, name), staticmethod):
        yield f"write @staticmethod above it: it has no self and is {name}({form})"
    if cls.resettable and not (signals(cls) and fields(s_type)[-1:] == ("cold",)):
        yield (
            "a resettable block has a signal that resets it, the last one, and a state that ends"
            " with cold"
        )
    given = inspect.signature(f).parameters
    if len(given) != len(wanted):
        yield f"it takes ({', '.join(given)}) and must take {name}({form})"


def _faults_of_fields(
    body: ast.AST,
    tuples: dict[str, tuple[str, tuple[str, ...]]],
    read: set[str],
    known: dict[str, Any],
) -> Faults:
    """Yield fields of parameters or state that are set, or do not exist.

    Also elements of what may only be read, which the rehearsal sees only if it gets
    there: by its name, another name, or in a helper.
    """
    nodes: list[Any] = list(ast.walk(body))
    stored = [n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
    read = read.difference(stored)
    named = [(getattr(n.targets[0], "id", ""), n.value) for n in nodes if isinstance(n, ast.Assign)]
    for _ in named:  # a name of a name, however they are nested
        read |= {name for name, v in named if _of(v) in read and stored.count(name) == 1}
    for node in nodes:
        if (
            isinstance(node, ast.Subscript)
            and isinstance(node.ctx, ast.Store)
            and _of(node.value) in read
        ):
            yield node, f"{ast.unparse(node)} cannot be set: {_REMEDIES['read-only']}"
        if (helper := _helper(node, known)) and helper is _target(node.func, known):
            takes = zip(node.args, inspect.signature(helper).parameters, strict=False)
            mine = {name for given, name in takes if _of(given) in read}
            faults = _faults_of_fields(ast.parse(source(helper)), {}, mine, names(helper))
            yield from ((node, f"{helper.__name__}: {why}") for _, why in faults)
        if not isinstance(node, ast.Attribute):
            continue
        if isinstance(node.ctx, ast.Store):
            yield (
                node,
                f"{ast.unparse(node)} cannot be set: parameters and state are tuples; return a new"
                " state",
            )
        who = node.value.id if isinstance(node.value, ast.Name) else ""
        if who in tuples and who not in stored and node.attr not in tuples[who][1]:
            what, fields = tuples[who]
            there = f"the {what} {', '.join(fields)}" if fields else f"no {what}"
            yield node, f"{who}.{node.attr} is not there: design gives {there}"


def _of(node: Any) -> str:
    """Return the name that a node is, or of which it is an attribute or a part."""
    return getattr(getattr(node, "value", node), "id", "")


def _faults_of_ends(body: ast.AST, cls: Any, f: Any, s_type: type, new: str) -> Faults:
    """Yield the return statements that do not return what they must.

    new: the new state.
    """
    ends: list[ast.AST] = [n for n in ast.walk(body) if isinstance(n, ast.Return)]
    for end in ends or [body]:
        v = getattr(end, "value", None)
        if isinstance(v, ast.Call):
            target = _target(v.func, f.__globals__)
            # those of maths give one number, as what is built in does
            one = getattr(target, "__module__", "") == maths.__name__
            if not one and not isinstance(target, type | types.BuiltinFunctionType):
                continue  # a helper that may give both
        outputs = ", ".join(cls.outputs)
        if cls.tile is not None:
            if v is None or _empty(v, s_type):
                yield end, f"it must fill {outputs or 'y'} and return {new}"
        elif not (isinstance(v, ast.Tuple) and len(v.elts) == 2) or _empty(v.elts[1], s_type):
            what = f"the samples ({outputs})" if outputs else "the sample"
            yield end, f"it must return two things, {what} and {new}"


def sample(
    block: Block,
    p: Any,
    s: Any,
    x: Sequence[Any],
    work: Sequence[np.ndarray] = (),
    tiled: bool = False,
) -> tuple[Any, Any]:
    """Compute one sample of a block in plain Python, and its new state.

    This defines the meaning of a scene. For several outputs the sample is a tuple.

    x has one number per signal (without that of a contact), work is the scratch of a
    tile; with tiled, a block that has a step and a tile runs its tile.

    SceneError, with file and line, if an author's code raises an error.

    Examples
    --------
    >>> from stimlib.core.graph import Input
    >>> from stimlib.core.steps import sample
    >>> y, state = sample(Input("x") * Input("y"), (), (), [2.0, 3.0])
    >>> float(y), state
    (6.0, ())
    """
    cls = block.definition
    name, f = ("tile", cls.tile) if tiled else _what(cls)
    try:
        if name == "step":
            y, s = cls.step(p, s, *x)
            return tuple(np.float64(v) for v in y) if cls.outputs else np.float64(y), s
        tile = np.empty((max(1, len(cls.outputs)), 1))
        s = cls.tile(p, s, *(np.frombuffer(np.float64(v)) for v in x), *tile, *work)
        return tuple(tile[:, 0]) if cls.outputs else tile[0, 0], s
    except Exception as e:
        if isinstance(e, StimlibError) or ours(cls):
            raise
        lines = [
            (t.filename, t.lineno)
            for t in traceback.extract_tb(e.__traceback__)
            if not t.filename.startswith(_HERE)
        ]
        filename, line = lines[-1] if lines else (f.__code__.co_filename, f.__code__.co_firstlineno)
        remedy = next((f"; {r}" for what, r in _REMEDIES.items() if what in str(e)), "")
        why = f"{type(e).__name__}: {str(e).rstrip('.')}{remedy}"
        raise SceneError(f"{filename}:{line}: {cls.__name__}.{name}: {why}") from e


def _what(cls: Any) -> tuple[str, Any]:
    """Return the function that defines a sample, step or tile, and its name."""
    return ("tile", cls.tile) if cls.step is None else ("step", cls.step)


class _Word(np.uint64):
    """A np.uint64 of a rehearsal, which takes no whole number in arithmetic."""


def _of_words(name: str, strict: bool) -> Callable[[Any, Any], Any]:
    plain = getattr(np.uint64, name)

    def op(a, b):
        if strict and isinstance(b, int | np.signedinteger):
            raise TypeError(_MIXED_SAYS)
        return _Word(y) if isinstance(y := plain(a, b), np.uint64) else y

    return op


for _side, _op in product(("", "r"), (*_MIXED.values(), "and", "or", "xor", "lshift", "rshift")):
    setattr(_Word, f"__{_side}{_op}__", _of_words(f"__{_side}{_op}__", _op in _MIXED.values()))


def _with_words(t: Any) -> Any:
    """Return parameters or state, each np.uint64 as a `_Word`."""
    return t and type(t)(*(_Word(v) if isinstance(v, np.uint64) else v for v in t))


def rehearse(block: Block, p: Any, s: Any) -> None:
    """Run one sample of a block on zeros, before anything is compiled.

    It uses copies of what its ``design`` returned.

    SceneError, with file and line, if the code raises an error, does not return a
    number, or returns a state of other types than that of design; also if ``work`` or
    ``abreast`` returns no number.

    Examples
    --------
    >>> from stimlib.blocks import delay
    >>> from stimlib.core.graph import Input
    >>> from stimlib.core.steps import rehearse
    >>> block = delay(Input("x"), 3)
    >>> rehearse(block, *block.design(1000.0))
    """
    cls = type(block)
    p, s = unpack(p, pack(p)), unpack(s, pack(s))
    for v in p:
        if isinstance(v, np.ndarray):
            v.flags.writeable = False  # compiled code would keep what a step writes there
    words = _with_words(p), _with_words(s)
    x = [np.float64(0.0)] * (len(signals(cls)) - cls.resettable)
    for what, of, numbers in (("work", "words", Integral), ("abreast", "blocks", Real)):
        count = (f := getattr(cls, what)) and f(p)
        if f and not isinstance(count, numbers):
            raise SceneError(
                f"{line_of(f)}{cls.__name__}.{what}: it must return a number of {of}, such as 4,"
                f" and returned {count!r:.80}"
            )
    work = (np.zeros(block.work(p)),) if block.work else ()
    with np.errstate(all="ignore"):
        if cls.step is not None and cls.tile is not None:  # compiled code reads beyond an array
            sample(block, p, unpack(s, pack(s)), x, work, tiled=True)
        y, new = sample(block, *words, x, work)
    name, f = _what(cls)

    def refuse(why: str) -> None:
        code = dis.get_instructions(f.__code__)
        ends = [i.positions.lineno for i in code if i.opname.startswith("RETURN") and i.positions]
        line = (ends and ends[-1]) or f.__code__.co_firstlineno
        raise SceneError(f"{f.__code__.co_filename}:{line}: {cls.__name__}.{name}: {why}")

    if not all(isinstance(v, np.float64) for v in (y if cls.outputs else (y,))):
        refuse(f"the sample must be one number, and is {y!r:.80}")
    if cls.outputs and len(y) != len(cls.outputs):
        refuse(
            f"it must return {counted(len(cls.outputs), 'sample')}, for {', '.join(cls.outputs)},"
            f" and returned {len(y)}"
        )
    if type(new) is not type(s):
        refuse(
            f"the new state must be {f'the {type(s).__name__}(..) of design' if s else '()'}, and"
            f" is {new!r:.80}"
        )
    for field, old, v in zip(fields(s), s, new, strict=True):
        if not isinstance(v, float if kind(old) == "f" else type(old)) or np.shape(v) != np.shape(
            old
        ):
            wanted = {"f": "a float", "u": "a np.uint64"}.get(
                kind(old), f"an array of {np.size(old)}"
            )
            hint = (
                "; write 1.0 for 1, and where(c, 1.0, 0.0) for a comparison"
                if isinstance(v, (int, np.bool_))
                else ""
            )
            refuse(f"the new state's {field} must be {wanted} as in design, and is {v!r:.80}{hint}")
        if isinstance(v, np.ndarray) and v is not old:
            refuse(
                f"the new state's {field} must be the array s.{field} itself: write into it,"
                f" s.{field}[i] = .., and return it"
            )


def _target(g: ast.expr, known: dict[str, Any]) -> Any:
    """Return the object that a name, or an attribute of one, stands for, or None."""
    if isinstance(g, ast.Attribute) and isinstance(g.value, ast.Name):
        return getattr(known.get(g.value.id), g.attr, None)
    return known.get(g.id) if isinstance(g, ast.Name) else None


def fields(t: Any) -> tuple[str, ...]:
    """Return the field names of a NamedTuple, or of its type."""
    return getattr(t, "_fields", ())


def _empty(v: ast.expr, s_type: type) -> bool:
    """Return whether an expression would lose a state that has fields."""
    return bool(fields(s_type)) and isinstance(v, ast.Tuple | ast.Constant)


def _callable_in_step(v: Any) -> bool:
    if v in (abs, range, np.uint64, np.int64):
        return True
    if isinstance(v, type):
        return hasattr(v, "_fields")
    return isinstance(v, types.FunctionType)
