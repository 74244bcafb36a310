"""Segments: a block class along a stretch of samples, as a compiled function.

The function is called from a table's row.

A segment's text holds the text of the step and of every helper and constant that it
uses: an edit in any of them makes another segment.
"""

from __future__ import annotations

import ast
import inspect
import re
import types
from typing import Any, NamedTuple

import numba
import numpy as np

from ...core import codegen, maths, steps
from ...core.graph import kind, memo
from ...core.steps import fields
from ...errors import SceneError, place
from . import vectors
from .cache import load

_HEAD = """from collections import namedtuple as _sl_namedtuple
import numpy as _sl_np
from numba import cfunc as _sl_cfunc, njit as _sl_njit
from stimlib.targets.numba import vectors as _sl_vectors, intrinsics as _sl
"""  # every name of ours begins with _sl: users choose theirs freely


def _embed(f: types.FunctionType, name: str, done: dict[str, Any], out: list[str]) -> None:
    """Add the source of a function under a name, after everything that it uses.

    That includes helpers, constants and NamedTuples.
    """
    renamed: dict[str, str] = {}
    for n, v in steps.names(f).items():
        if n in done and not _same(done[n], v):  # another helper's: this one gets a name of its own
            renamed[n] = n = f"_sl_{n}_{len(done)}"
        if n in done:
            continue
        twins = [m for m, u in done.items() if u is v and hasattr(v, "_fields")]
        done[n] = v
        if twins:  # one type to numba too
            out.append(f"{n} = {twins[0]}")
        elif isinstance(v, types.FunctionType) and v.__module__ != maths.__name__:
            _embed(v, n, done, out)
        elif v is not abs and v is not range:
            out.append(_meaning(f, n, v))
    text = re.sub(r"^def \w+", f"def {name}", _with_names(steps.source(f), renamed))
    out.append(f'@_sl_njit(error_model="numpy", inline="always")\n{text}')


def _meaning(f: types.FunctionType, n: str, v: Any) -> str:
    """Return the source line that defines a name which a function uses."""
    if v is np:
        return f"import numpy as {n}"
    if v is maths:
        return f"{n} = _sl"
    if getattr(maths, getattr(v, "__name__", n), None) is v:
        return f"{n} = _sl.{getattr(v, '__name__', n)}"
    if isinstance(v, type) and hasattr(v, "_fields"):
        return _tuple_text(n, v)
    if isinstance(v, type) and v in (np.uint64, np.int64, np.float64):
        return f"{n} = _sl_np.{v.__name__}"
    if isinstance(v, np.uint64):
        return f"{n} = _sl_np.uint64({int(v)})"
    if isinstance(v, float):
        return f"{n} = float({str(float(v))!r})"
    if isinstance(v, int):
        return f"{n} = {v!r}"
    remedy = (
        "define its NamedTuples outside of the class"
        if isinstance(v, type)
        else "put arrays into the parameters that design(fs) returns"
    )
    raise SceneError(
        f"{f.__qualname__} uses {n!r}, a {type(v).__name__}: a step may use module-level"
        f" numbers, NamedTuples and helper functions; {remedy}"
    )


def _same(a: Any, b: Any) -> bool:
    return a is b or (isinstance(b, (int, float)) and type(a) is type(b) and repr(a) == repr(b))


def _with_names(text: str, names: dict[str, str]) -> str:
    """Return a function's source with other names for some globals."""
    if not names:
        return text
    tree = ast.parse(text)
    for v in ast.walk(tree):
        if isinstance(v, ast.Name):
            v.id = names.get(v.id, v.id)
    return ast.unparse(tree) + "\n"


def _tuple_text(name: str, t: Any) -> str:
    return f"{name} = _sl_namedtuple({t.__name__!r}, {t._fields!r})"


class Form(NamedTuple):
    """The form of a segment: a block class and the kinds of its fields.

    It may also stand for two blocks side by side: two of one class, or white noise with
    a bank of modes behind it.
    """

    cls: Any
    code: Any  # a notebook may change a step in place
    p_type: type
    p_kinds: str
    s_type: type
    s_kinds: str
    inputs: int
    beside: tuple[Form, ...] = ()
    read: tuple[bool, ...] = (True,)
    """Of each output, whether anybody listens; a step's others are neither stored nor,
    for that, computed.
    """
    fixed: tuple[bool, ...] = ()
    """Of each input of a step, whether it is a constant; what depends on constants only
    is computed once a tile.
    """

    @property
    def parts(self) -> tuple[Form, ...]:
        """The forms of the blocks, each by itself."""
        return self, *self.beside

    @property
    def signals(self) -> list[str]:
        """Names of the arrays over samples, outputs last."""
        outputs = codegen.each("y_%s", self.cls.outputs) or ["y"]
        return codegen.each("x%d", range(self.inputs)) + outputs

    def warm(self, s: str) -> list[str]:
        """Return the source lines that follow a step or tile of a resettable block.

        s is the name of its state.
        """
        reset = f"{s} = {codegen.warm('_sl_S', fields(self.s_type), s)}"
        return [reset] if self.cls.resettable else []


@memo
def written(form: Form) -> tuple[str, str]:
    """Return the source of a form's segment, and the name of the class that has it."""
    cls = form.cls
    f = cls.tile or cls.step
    steps.source(f)  # an error here names the step, not the first of its helpers
    out: list[str] = [_HEAD]
    done: dict[str, Any] = {}
    _embed(f, "_sl_block", done, out)
    if any(isinstance(g, types.FunctionType) and g.__annotations__ for g in (f, *done.values())):
        # types that an author notes may have any names
        out.insert(0, "from __future__ import annotations\n")
    if noise_behind(form):
        _embed(form.beside[0].cls.tile, "_sl_other", done, out)
    different = form.parts if noise_behind(form) else form.parts[:1]
    for b, part in zip(["", "1"], different, strict=False):
        for ours, t in ((f"_sl_P{b}", part.p_type), (f"_sl_S{b}", part.s_type)):
            # the step's own, or the types would differ
            theirs = [name for name, v in done.items() if v is t]
            if fields(t):
                out.append(f"{ours} = {theirs[0]}" if theirs else _tuple_text(ours, t))
    taken: list[str] = []
    kept: list[str] = []
    for c in range(len(form.parts)):
        _take(form, c, taken, kept)
    body = [*taken, *_run(form, f, out), *kept]
    decorator = '@_sl_cfunc(_sl.SEGMENT, cache=True, error_model="numpy")'
    out.append(f"{decorator}\n{codegen.define('_sl_segment', ['P', 'S', 'W', 'A', 'n'], body)}")
    # all classes on top of the one that wrote the step share one segment
    owner = next(c for c in cls.__mro__ if "tile" in c.__dict__ or "step" in c.__dict__)
    return "\n".join(out), owner.__name__


@memo
def segment(form: Form) -> types.ModuleType:
    """Return the compiled segment of a form, from the cache if it is there."""
    text, owner = written(form)
    try:
        return load(text, owner)
    except SceneError as e:  # of lanes
        raise SceneError(
            f"{place(form.cls.tile or form.cls.step)}{form.cls.__name__}.tile: {e}"
        ) from None
    except (numba.core.errors.NumbaError, TypeError) as e:
        f = form.cls.tile or form.cls.step
        name = "tile" if form.cls.tile else "step"
        raise SceneError(
            f"{_line(e, text, f)}{form.cls.__name__}.{name}: it does not compile: {_said(e)}"
        ) from e


_MEMORY = {"f": "PS", "F": "PS", "u": "CZ", "U": "CZ"}
"""Where a kind of field lies, of parameters and of state: P and S are words as floats,
C and Z the same as uint64.  A small letter is a number, a capital an array.
"""


def noise_behind(form: Form) -> bool:
    """Return whether a segment makes white noise and runs modes behind it."""
    return bool(form.beside) and form.beside[0].cls is not form.cls


def _take(form: Form, c: int, lines: list[str], after: list[str]) -> None:
    """Add source lines that read a block's numbers, and write its state back.

    The words and the state of a second block are at offsets given in A; its names end
    with 1.
    """
    b, part = str(c or ""), form.parts[c]
    kind = b if noise_behind(form) else ""
    slot, at = sum(len(one.signals) for one in form.parts[:c]), 0
    if c:
        behind = sum(len(one.signals) for one in form.parts)
        lines.append(f"P{b} = _sl.at(P, A[{behind}])")
        lines.append(f"S{b} = _sl.at(S, A[{behind + 1}])")
    lines += [f"C{b} = _sl.as_u8(P{b})", f"Z{b} = _sl.as_u8(S{b})"]
    numbers, state, at_s = [], [], "0"
    for k in part.p_kinds:
        memory = _MEMORY[k][0] + b
        if k.isupper():  # words: place, size
            start, size = codegen.each(f"_sl_np.int64(C{b}[%d])", (at, at + 1))
            numbers.append(f"_sl.array(_sl.at({memory}, {start}), {size})")
            at += 1
        else:
            numbers.append(f"{memory}[{at}]")
        at += 1
    for k, name in zip(part.s_kinds, fields(part.s_type), strict=True):
        memory = _MEMORY[k][1] + b
        if k.isupper():
            size = f"z{b}_{name}"
            lines.append(f"{size} = _sl_np.int64(C{b}[{at}])")
            state.append(f"_sl.array(_sl.at({memory}, {at_s}), {size})")
            at_s += f" + {size}"
            at += 1
        else:
            state.append(f"{memory}[{at_s}]")
            after.append(f"{memory}[{at_s}] = s{b}.{name}")
            at_s += " + 1"
    lines.append(f"p{b} = {codegen.record(f'_sl_P{kind}', numbers)}")
    lines.append(f"s{b} = {codegen.record(f'_sl_S{kind}', state)}")
    slots = range(slot, slot + len(part.signals))
    lines += codegen.each(f"%s{b} = _sl.array(_sl.at(W, A[%d]), n)", part.signals, slots)
    if part.cls.tile and part.cls.work:
        size = f"_sl_np.int64(C{b}[{at}])"
        lines.append(f"w{b} = _sl.array(_sl.at(W, A[{_scratch(form)}]), {size})")


def _scratch(form: Form) -> int:
    """Return the place of the scratch's slot in A, the last of a segment's words."""
    signals = sum(len(one.signals) for one in form.parts)
    return signals + (6 if noise_behind(form) else 2 * len(form.beside))


NOISE_BEHIND = """
ahead, mark = _sl.array(_sl.at(W, A[{0}]), 64), _sl.as_u8(_sl.at(W, A[{1}]))
later = s.n + _sl_np.uint64(64)
if n == 64 and p1.p.size == 8 and mark[0] == s.n and mark[1] == s.key and mark[2] > 0:
    if mark[2] == 1:
        _sl.call(A[{2}], P, S, W, _sl.at(A, {3}), n)
    else:
        _sl.copy(ahead, y)
    _sl_vectors.pairs_beside_modes(
        deviates, s.key, later >> _sl_np.uint64(1), ahead, p1.p, p1.r, s1.q, p1.d, y, y1
    )
    s = _sl_S(s.key, later)
    mark[2] = 2
else:
    mark[2] = n == 64 and s.n & _sl_np.uint64(1) == 0
    _sl.call(A[{2}], P, S, W, _sl.at(A, {3}), n)
    s = _sl_S(s.key, s.n + _sl_np.uint64(n))
    s1 = _sl_other(p1, s1, y, y1, w1)
mark[0], mark[1] = s.n, s.key
"""
"""White noise and modes: while each sample of the modes waits for the one before, the
deviates of the next tile are drawn.

They are pure functions of the key and the index of a sample, which are noted with them:
``mark`` has that index, the key, and a number: 2 if the deviates are there, 1 if the
tile before was whole, after which drawing ahead pays.  Other tiles of noise come from
the segment of white noise alone, whose address and words are in A.
"""


def _run(form: Form, f: Any, out: list[str]) -> list[str]:
    """Return source lines that run a step or tile in the fastest possible way.

    out: the source that precedes the segment.
    """
    inputs, numbers = form.inputs, (form.p_type, form.p_kinds)
    slots = codegen.each("_sl.at(W, A[%d])", range(len(form.parts) * len(form.signals)))
    if noise_behind(form):
        return NOISE_BEHIND.format(*range(_scratch(form) - 4, _scratch(form))).strip().splitlines()
    if form.cls.tile:
        given = ["p", "s", *form.signals, *(["w"] if form.cls.work else [])]
        return [f"s = {codegen.call('_sl_block', *given)}", *form.warm("s")]
    # nothing from one sample to the next, and no table that each looks up
    flat = (
        inputs
        and not form.cls.outputs
        and not form.s_kinds
        and form.p_kinds == form.p_kinds.lower()
    )
    if flat and vectors.in_vectors(f, *numbers, inputs):
        x = "".join(codegen.each("%s, ", slots[:inputs]))
        return [f"_sl_vectors.steps(_sl_block, p, ({x}), {slots[inputs]}, n)"]
    if form.beside and vectors.go_abreast(f, *numbers, form.s_type, form.s_kinds, inputs):
        body = ["y, s = _sl_block(p, s, *x)", *form.warm("s"), "return y, s"]
        one = codegen.define("_sl_one", ["p", "s", "*x"], body)
        out.append(f'@_sl_njit(error_model="numpy")\n{one}')
        x, x1 = (f"({', '.join(slots[k : k + inputs])},)" for k in (0, inputs + 1))
        pairs = f"(p, p1), (s, s1), ({x}, {x1}), ({slots[inputs]}, {slots[-1]})"
        return [f"s, s1 = _sl_vectors.abreast(_sl_one, {pairs.replace('(,)', '()')}, n)"]
    before, lines = [], []
    for b, part in zip(["", "1"], form.parts, strict=False):
        samples = codegen.each(f"%s{b}[i]", form.signals)
        for j, constant in enumerate(part.fixed):
            if constant:
                before.append(f"c{j}{b} = x{j}{b}[0]")
                samples[j] = f"c{j}{b}"
        for j, listened in enumerate(form.read, inputs):
            if not listened:
                samples[j] = "_sl_unread"
        made = codegen.several(samples[inputs:], bool(form.cls.outputs))
        run = codegen.call("_sl_block", f"p{b}", f"s{b}", *samples[:inputs])
        lines += [f"{made}, s{b} = {run}", *form.warm(f"s{b}")]
    return [*before, "for i in range(n):", *codegen.indented(lines)]


def _said(e: Exception) -> str:
    """Return the compiler's message in one line, without the names of its passes."""
    passes = "Failed in", "During:", "File ", "def "
    said = [
        line for line in map(str.strip, str(e).splitlines()) if line and not line.startswith(passes)
    ] or [type(e).__name__]
    what = " ".join(said[:2] if said[0].endswith("signature:") else said[:1]).partition(
        ", defined at"
    )[0]
    return what + ("; beside a np.uint64 write np.uint64(1), not 1" if "uint64" in what else "")


def _line(e: Exception, text: str, f: types.FunctionType) -> str:
    """Return file and line, as an error message begins.

    They are those that the compiler blames if they are in f itself, else those of f.
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


def kinds(t: Any) -> str:
    """Return the kinds of fields as letters."""
    return "".join(kind(v) for v in t)
