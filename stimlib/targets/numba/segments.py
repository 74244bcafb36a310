"""The text of a segment: what a block class computes for a stretch of samples, as a
compiled function of a table's row.

A segment's text holds the text of the step and of every helper and constant that it
uses: an edit in any of them makes another segment.
"""

from __future__ import annotations

import ast
import inspect
import re
import types
from typing import Any

import numba
import numpy as np

from ...core import maths, steps
from ...core.graph import kind, memo
from ...errors import SceneError, place
from . import lanes, native
from .cache import load

_HEAD = """from collections import namedtuple as _sl_namedtuple
import numpy as _sl_np
from numba import carray as _sl_carray, cfunc as _sl_cfunc, njit as _sl_njit
from stimlib.targets.numba import lanes as _sl_lanes, native as _sl
"""  # every name of ours begins with _sl: users choose theirs freely


def _embed(f: types.FunctionType, name: str, done: dict[str, Any], out: list[str]) -> None:
    """Text of a function under a name, after that of every helper, constant and
    NamedTuple it uses.
    """
    renamed: dict[str, str] = {}
    for n, v in steps.names(f).items():
        if n in done and not _same(done[n], v):  # another helper's: this one gets a name of its own
            renamed[n] = n = f"_sl_{n}_{len(done)}"
        if n in done:
            continue
        twin = next((m for m, u in done.items() if u is v), None) if hasattr(v, "_fields") else None
        done[n] = v
        if v is abs or v is range:
            continue
        if twin:  # one type to numba too
            out.append(f"{n} = {twin}")
        elif v is np:
            out.append(f"import numpy as {n}")
        elif v is maths:
            out.append(f"{n} = _sl")
        elif (
            getattr(v, "__module__", "") == maths.__name__
            and callable(v)
            or getattr(maths, n, None) is v
        ):
            ours = getattr(v, "__name__", n)
            out.append(f"{n} = {'_sl' if hasattr(native, ours) else '_sl_lanes'}.{ours}")
        elif isinstance(v, type) and hasattr(v, "_fields"):
            out.append(_tuple_text(n, v))
        elif v is np.uint64 or v is np.int64 or v is np.float64:
            out.append(f"{n} = _sl_np.{v.__name__}")
        elif isinstance(v, types.FunctionType):
            _embed(v, n, done, out)
        elif isinstance(v, np.uint64):
            out.append(f"{n} = _sl_np.uint64({int(v)})")
        elif isinstance(v, (bool, int, float)):
            out.append(
                f"{n} = float({str(float(v))!r})" if isinstance(v, float) else f"{n} = {v!r}"
            )
        else:
            raise SceneError(
                f"{f.__qualname__} uses {n!r}, a {type(v).__name__}: a step may use module-level"
                " numbers, NamedTuples and helper functions; put arrays into the parameters that"
                " design(fs) returns"
            )
    text = re.sub(r"^def \w+", f"def {name}", _with_names(steps.source(f), renamed))
    out.append(f'@_sl_njit(error_model="numpy", inline="always")\n{text}')


def _same(a: Any, b: Any) -> bool:
    return a is b or (isinstance(b, (int, float)) and type(a) is type(b) and repr(a) == repr(b))


def _with_names(text: str, names: dict[str, str]) -> str:
    """A function's text with other names for some globals."""
    if not names:
        return text
    tree = ast.parse(text)
    for v in ast.walk(tree):
        if isinstance(v, ast.Name):
            v.id = names.get(v.id, v.id)
    return ast.unparse(tree) + "\n"


def _tuple_text(name: str, t: type) -> str:
    return f"{name} = _sl_namedtuple({t.__name__!r}, {t._fields!r})"  # type: ignore[attr-defined]


@memo
def segment(
    cls: Any, code: Any, p_type: type, p_kinds: str, s_type: type, s_kinds: str,
    inputs: int, copies: int = 1, read: tuple[bool, ...] = (True,),
):  # fmt: skip
    """The segment of a block class whose parameters and states have these kinds of
    fields, or that of two blocks side by side.

    read: of each output, whether anybody listens; a step's others are neither stored
    nor, for that, computed.
    """
    f = cls.tile or cls.step
    steps.source(f)  # an error here names the step, not the first of its helpers
    out: list[str] = [_HEAD]
    done: dict[str, Any] = {}
    _embed(f, "_sl_block", done, out)
    if any(isinstance(g, types.FunctionType) and g.__annotations__ for g in (f, *done.values())):
        # types that an author notes may have any names
        out.insert(0, "from __future__ import annotations\n")
    for ours, t in (("_sl_P", p_type), ("_sl_S", s_type)):
        # the step's own, or the types would differ
        theirs = next((name for name, v in done.items() if v is t), None)
        if hasattr(t, "_fields"):
            out.append(f"{ours} = {theirs}" if theirs else _tuple_text(ours, t))
    lines: list[str] = []
    after: list[str] = []
    y = [f"y_{name}" for name in cls.outputs] or ["y"]
    blocks = [
        _one_of(c, p_kinds, s_kinds, s_type, inputs, y, bool(cls.tile and cls.work), lines, after)
        for c in range(copies)
    ]
    warm = (
        [f"s = _sl_S({', '.join([*(f's.{k}' for k in s_type._fields[:-1]), '0.0'])})"]  # type: ignore[attr-defined]
        if cls.resettable
        else []
    )
    if cls.tile:
        scratch = ["w"] if cls.work else []
        given = ["p", "s", *(f"x{j}" for j in range(inputs)), *y, *scratch]
        lines += [f"s = _sl_block({', '.join(given)})", *warm]
    elif (
        inputs
        and y == ["y"]
        and not s_kinds
        and not set(p_kinds) & {"F", "U"}
        and lanes.in_vectors(f, p_type, p_kinds, inputs)
    ):
        x = "".join(f"_sl.at(W, A[{j}]), " for j in range(inputs))
        lines.append(f"_sl_lanes.steps(_sl_block, p, ({x}), _sl.at(W, A[{inputs}]), n)")
    elif copies == 2 and lanes.go_abreast(f, p_type, p_kinds, s_type, s_kinds, inputs):
        out.append(
            '@_sl_njit(error_model="numpy")\ndef _sl_one(p, s, *x):\n    y, s = _sl_block(p, s,'
            " *x)\n" + "".join(f"    {text}\n" for text in warm) + "    return y, s\n"
        )
        slots = [f"_sl.at(W, A[{k}])" for k in range(2 * inputs + 2)]
        one, other = (
            f"({', '.join(v)},)" if (v := slots[k : k + inputs]) else "()" for k in (0, inputs + 1)
        )
        ys = f"({slots[inputs]}, {slots[-1]})"
        lines.append(
            f"s, s1 = _sl_lanes.abreast(_sl_one, (p, p1), (s, s1), ({one}, {other}), {ys}, n)"
        )
    else:
        lines.append("for i in range(n):")
        for c in blocks:
            x = "".join(f", x{j}{c}[i]" for j in range(inputs))
            samples = [
                f"{name}{c}[i]" if listened else "_sl_unread"
                for name, listened in zip(y, read, strict=True)
            ]
            made = f"({', '.join(samples)})" if cls.outputs else samples[0]
            sample = [
                f"{made}, s{c} = _sl_block(p{c}, s{c}{x})",
                *(re.sub(r"\bs\b", f"s{c}", text) for text in warm),
            ]
            lines += ["    " + text for text in sample]
    body = "\n".join("    " + text for text in [*lines, *after])
    out.append(
        '@_sl_cfunc(_sl.SEGMENT, cache=True, error_model="numpy")\ndef _sl_segment(P, S, W, A,'
        f" n):\n{body}\n"
    )
    text = "\n".join(out)
    try:
        return load(text, _owner(cls).__name__)
    except SceneError as e:  # of lanes
        raise SceneError(f"{place(f)}{cls.__name__}.tile: {e}") from None
    except (numba.core.errors.NumbaError, TypeError) as e:
        name = "tile" if f is cls.tile else "step"
        raise SceneError(
            f"{_line(e, text, f)}{cls.__name__}.{name}: it does not compile: {_said(e)}"
        ) from e


def _one_of(
    c: int,
    p_kinds: str,
    s_kinds: str,
    s_type: type,
    inputs: int,
    ys: list[str],
    scratch: bool,
    before: list[str],
    end: list[str],
) -> str:
    """Text that takes a block's numbers from the tables and keeps its state; what its
    names end with comes back.

    A second block's words and state lie some words further on, as A tells.
    """
    name, place = str(c or ""), c * (inputs + len(ys))
    if c:
        before += [f"P{c} = _sl.at(P, A[{2 * place}])", f"S{c} = _sl.at(S, A[{2 * place + 1}])"]
    before += [f"C{name} = _sl.as_u8(P{name})", f"Z{name} = _sl.as_u8(S{name})"]
    at, p_args = 0, []
    for k in p_kinds:
        if k in "FU":
            memory = f"{'C' if k == 'U' else 'P'}{name}"
            p_args.append(
                f"_sl_carray(_sl.at({memory}, _sl_np.int64(C{name}[{at}])),"
                f" _sl_np.int64(C{name}[{at + 1}]))"
            )
        else:
            p_args.append(f"{'C' if k == 'u' else 'P'}{name}[{at}]")
        at += 2 if k in "FU" else 1
    s_args, at_s = [], "0"
    for k, field in zip(s_kinds, getattr(s_type, "_fields", ()), strict=True):
        memory = f"{'Z' if k in 'uU' else 'S'}{name}"
        if k in "FU":
            before.append(f"z{name}_{field} = _sl_np.int64(C{name}[{at}])")
            s_args.append(f"_sl_carray(_sl.at({memory}, {at_s}), z{name}_{field})")
            at_s += f" + z{name}_{field}"
            at += 1
        else:
            s_args.append(f"{memory}[{at_s}]")
            end.append(f"{memory}[{at_s}] = s{name}.{field}")
            at_s += " + 1"
    before.append(f"p{name} = _sl_P({', '.join(p_args)})" if p_kinds else f"p{name} = ()")
    before.append(f"s{name} = _sl_S({', '.join(s_args)})" if s_kinds else f"s{name} = ()")
    before += [f"x{j}{name} = _sl_carray(_sl.at(W, A[{place + j}]), n)" for j in range(inputs)]
    before += [
        f"{out}{name} = _sl_carray(_sl.at(W, A[{place + inputs + j}]), n)"
        for j, out in enumerate(ys)
    ]
    if scratch:
        before.append(f"w = _sl_carray(_sl.at(W, A[{inputs + len(ys)}]), _sl_np.int64(C[{at}]))")
    return name


def _said(e: Exception) -> str:
    """What the compiler says, in one line and without the passes that it was in."""
    passes = "Failed in", "During:", "File ", "def "
    said = [
        line for line in map(str.strip, str(e).splitlines()) if line and not line.startswith(passes)
    ] or [type(e).__name__]
    what = " ".join(said[:2] if said[0].endswith("signature:") else said[:1]).partition(
        ", defined at"
    )[0]
    return what + ("; beside a np.uint64 write np.uint64(1), not 1" if "uint64" in what else "")


def _line(e: Exception, text: str, f: types.FunctionType) -> str:
    """File and line as an error begins: those that the compiler blames, where they are
    in f itself, or those of f.
    """
    blamed = getattr(getattr(e, "loc", None), "line", 0)
    written = text.partition("\ndef _sl_segment")[0].splitlines()
    lines, first = inspect.getsourcelines(f)
    at = [
        k
        for k, line in enumerate(lines)
        if 0 < blamed <= len(written) and line.strip() == written[blamed - 1].strip()
    ]
    return f"{f.__code__.co_filename}:{first + at[0]}: " if at else place(f)


def _owner(cls: type) -> type:
    """The class that wrote the step: all classes on top of it share one segment."""
    return next(c for c in cls.__mro__ if "tile" in c.__dict__ or "step" in c.__dict__)


def kinds(t: Any) -> str:
    return "".join(kind(v) for v in t)
