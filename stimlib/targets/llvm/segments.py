"""Segments: a block class along a stretch of samples, as a compiled function.

The function is called from a table's row.

A segment's text holds the text of the step and of every helper and constant that it
uses: an edit in any of them makes another segment.
"""

from __future__ import annotations

import ast
import types
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...blocks.noise import deviates
from ...core import codegen, maths, steps
from ...core.graph import kind, memo
from ...core.source import source_of
from ...core.steps import fields
from ...errors import SceneError, line_of
from . import known, lanes, walk
from .cache import Code, load


def _uses(function: types.FunctionType, found: dict[Any, None], lines: list[str]) -> None:
    """Add the source of a function and of what it uses: all that decides its code."""
    for name, value in steps.names(function).items():
        line = f"{name} = {_meaning(function, name, value)}"
        if (
            isinstance(value, types.FunctionType)
            and value.__module__ != maths.__name__
            and value not in found
        ):
            found[value] = None
            _uses(value, found, lines)
        lines.append(line)
    # defaults too: a call that leaves an argument out has their numbers in its code
    lines.append(f"{function.__defaults__!r} {function.__kwdefaults__!r}\n{steps.source(function)}")


def _meaning(function: types.FunctionType, name: str, value: Any) -> str:
    """Return a text that tells the value of a name that a function uses."""
    if any(value is one for one in (np, maths, abs, range, np.uint64, np.int64, np.float64)):
        return value.__name__
    if getattr(maths, getattr(value, "__name__", name), None) is value:
        return f"maths.{getattr(value, '__name__', name)}"
    if isinstance(value, types.FunctionType):
        return f"{value.__module__}.{value.__qualname__}"
    if isinstance(value, type) and hasattr(value, "_fields"):
        more = {other for other in dir(value) if other[0] != "_"} - {
            *value._fields,
            "count",
            "index",
        }
        parts = (
            value._fields,
            getattr(value, "_field_defaults", {}),
            source_of(value) if more else "",
        )
        return f"{value.__name__}{parts!r}"
    if isinstance(value, np.uint64 | float | int):
        return f"{type(value).__name__}({value!r})"
    remedy = (
        "define its NamedTuples outside of the class"
        if isinstance(value, type)
        else "put arrays into the parameters that design(fs) returns"
    )
    raise SceneError(
        f"{function.__qualname__} uses {name!r}, a {type(value).__name__}: a step may use"
        f" module-level numbers, NamedTuples and helper functions; {remedy}"
    )


class Form(NamedTuple):
    """The form of a segment: a block class and the kinds of its fields.

    It may also stand for blocks side by side: 2, 4 or 8 of one class, or white noise
    with a bank of modes behind it.
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
    """Return all that a form's segment is made of, and the class that has it."""
    cls = form.cls
    code = cls.tile or cls.step
    steps.source(code)  # an error here names the step, not the first of its helpers
    # no numbers of a design, no operands: scenes that differ in these share a segment
    lines: list[str] = []
    for part in form.parts if noise_behind(form) else form.parts[:1]:
        _uses(part.cls.tile or part.cls.step, {}, lines)
        lines += [str(fields(kind)) for kind in (part.p_type, part.s_type)]
    # in lanes, what makes a resettable block warm is not in the body
    lines += [body(form), str(cls.resettable)]
    # all classes on top of the one that wrote the step share one segment
    owner = next(c for c in cls.__mro__ if "tile" in c.__dict__ or "step" in c.__dict__)
    return "\n".join(lines), owner.__name__


@memo
def body(form: Form) -> str:
    """Return the function that runs a block along a stretch of samples, as a source."""
    taken: list[str] = []
    kept: list[str] = []
    for number in range(len(form.parts)):
        _take(form, number, taken, kept)
    lines = [*taken, *_run(form), *kept]
    return codegen.define("_sl_segment", ["P", "S", "W", "A", "n"], lines)


def made(form: Form) -> walk.Intermediate:
    """Return a form's segment as LLVM's text."""
    cls = form.cls
    of = {"block": cls.tile or cls.step, "one": _one(form), "deviates": deviates}
    for number, part in enumerate(form.parts):
        of |= {f"P{number or ''}": part.p_type, f"S{number or ''}": part.s_type}
    if noise_behind(form):
        of["other"] = form.beside[0].cls.tile
    space = {"_sl": known, "_sl_np": np} | {f"_sl_{name}": v for name, v in of.items()}
    made = walk.of_source(body(form), space, {"_sl_segment": ("void", *known.SEGMENT)}, known.TWINS)
    # Nothing writes parameters while a segment runs, so LLVM may read tables in
    # vectors: with AVX-512, bump_table and lut2 take 0.4 to 0.5 of the time. The others
    # are not marked: an output may be written where an input lies.
    return made._replace(llvm=made.llvm.replace("(double* ", "(double* noalias ", 1))


def _one(form: Form) -> Any:
    """Return a step on lanes, with the new state of a resettable block."""
    step: Any = lanes.twin(form.cls.step) if form.beside and not noise_behind(form) else None
    if not form.cls.resettable:
        return step

    def one(numbers, state, *signals):
        output, state = step(numbers, state, *signals)
        return output, state._replace(cold=0.0)

    return one


@memo
def segment(form: Form) -> Code:
    """Return the compiled segment of a form, from the cache if it is there."""
    text, owner = written(form)
    f = form.cls.tile or form.cls.step
    what = f"{form.cls.__name__}.{'tile' if form.cls.tile else 'step'}"
    try:
        return load(text, owner, lambda: made(form))
    except SceneError as e:  # of lanes
        raise SceneError(f"{line_of(f)}{what}: {e}") from None
    except walk.Unknown as e:
        why = f"{what}: it does not compile: {e}"
        if form.beside and form.cls.tile:
            why += "; of a class with abreast(p), a tile may do nothing but call series and each"
        raise SceneError(f"{e.where or line_of(f)}{why}") from e


def plan(
    inputs: int, operations: list[tuple[int, list[int]]], outputs: list[int]
) -> tuple[str, str]:
    """Return the text of a row of operations, and the stem of its entry.

    An operation has its number among ``rows.OPERATIONS``, and the numbers of its
    signals: inputs first, then the operations before it.
    """
    return repr((inputs, operations, outputs)), "Operations"


def chained(text: str, _stem: str) -> walk.Intermediate:
    """Return the segment of a row of operations as LLVM's text."""
    inputs, operations, outputs = ast.literal_eval(text)
    body = codegen.define(
        "_sl_segment", ["P", "S", "W", "A", "n"], ["_sl.chain(*_sl_plan, W, A, n)"]
    )
    space = {"_sl": known, "_sl_plan": (inputs, operations, outputs)}
    return walk.of_source(body, space, {"_sl_segment": ("void", *known.SEGMENT)}, known.TWINS)


_MEMORY = {"f": "PS", "F": "PS", "u": "CZ", "U": "CZ"}
"""Where a kind of field lies, of parameters and of state: P and S are words as floats,
C and Z the same as uint64.  A small letter is a number, a capital an array.
"""


def noise_behind(form: Form) -> bool:
    """Return whether a segment makes white noise and runs modes behind it."""
    return bool(form.beside) and form.beside[0].cls is not form.cls


def _take(form: Form, number: int, lines: list[str], after: list[str]) -> None:
    """Add source lines that read a block's numbers, and write its state back.

    The numbers and the state of a second block are at offsets given in A; its names end
    with 1.
    """
    suffix, part = str(number or ""), form.parts[number]
    kind = suffix if noise_behind(form) else ""
    operand, at = sum(len(one.signals) for one in form.parts[:number]), 0
    if number:
        behind = sum(len(one.signals) for one in form.parts) + 2 * (number - 1)
        lines += [f"{v}{suffix} = _sl.at({v}, A[{behind + k}])" for k, v in enumerate("PS")]
    lines += [f"C{suffix} = _sl.as_u8(P{suffix})", f"Z{suffix} = _sl.as_u8(S{suffix})"]
    # Where a number lies is known as soon as the form is; where a state lies is a sum,
    # because sizes of arrays are among the numbers: a delay of any length has one
    # segment.
    numbers, state, at_s = [], [], "0"
    for letter in part.p_kinds:
        memory = _MEMORY[letter][0] + suffix
        if letter.isupper():  # two numbers: where it begins, its size
            start, size = codegen.each(f"_sl_np.int64(C{suffix}[%d])", (at, at + 1))
            numbers.append(f"_sl.array(_sl.at({memory}, {start}), {size})")
            at += 1
        else:
            numbers.append(f"{memory}[{at}]")
        at += 1
    for letter, name in zip(part.s_kinds, fields(part.s_type), strict=True):
        memory = _MEMORY[letter][1] + suffix
        if letter.isupper():
            size = f"z{suffix}_{name}"
            lines.append(f"{size} = _sl_np.int64(C{suffix}[{at}])")
            state.append(f"_sl.array(_sl.at({memory}, {at_s}), {size})")
            at_s += f" + {size}"
            at += 1
        else:
            state.append(f"{memory}[{at_s}]")
            after.append(f"{memory}[{at_s}] = s{suffix}.{name}")
            at_s += " + 1"
    lines.append(f"p{suffix} = {codegen.record(f'_sl_P{kind}', numbers)}")
    lines.append(f"s{suffix} = {codegen.record(f'_sl_S{kind}', state)}")
    operands = range(operand, operand + len(part.signals))
    lines += codegen.each(f"%s{suffix} = _sl.array(_sl.at(W, A[%d]), n)", part.signals, operands)
    if part.cls.tile and part.cls.work:
        size = f"_sl_np.int64(C{suffix}[{at}])"
        lines.append(f"w{suffix} = _sl.array(_sl.at(W, A[{_scratch(form)}]), {size})")


def _scratch(form: Form) -> int:
    """Return which operand is the slot of the scratch, the last of a segment's own."""
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
    _sl.pairs_beside_modes(
        _sl_deviates, s.key, later >> _sl_np.uint64(1), ahead, p1.p, p1.r, s1.q, p1.d, y, y1
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
the segment of white noise alone, whose address and operands are in A.
"""


def _row(texts: Sequence[str]) -> str:
    """Return the text of a tuple."""
    return f"({', '.join(texts)},)" if texts else "()"


def _run(form: Form) -> list[str]:
    """Return source lines that run a step or tile in the fastest possible way."""
    code: Any = form.cls.tile or form.cls.step
    inputs, numbers = form.inputs, (form.p_type, form.p_kinds)
    signals = codegen.each("_sl.at(W, A[%d])", range(len(form.parts) * len(form.signals)))
    # From the fastest way to the one that always works. A tile is what its author wrote
    # for this; then vectors along the samples, two blocks in two lanes, and last a loop
    # over a step.
    if noise_behind(form):
        return NOISE_BEHIND.format(*range(_scratch(form) - 4, _scratch(form))).strip().splitlines()
    members = ["", *map(str, range(1, len(form.parts)))]
    if form.cls.tile and form.beside:
        own = (codegen.each(f"{one}%s", members) for one in ["p", "s", *form.signals])
        all_of = [codegen.call("_sl.members", *one) for one in own]
        return [f"s = {codegen.call('_sl_block', *all_of)}"]
    if form.cls.tile:
        given = ["p", "s", *form.signals, *(["w"] if form.cls.work else [])]
        return [f"s = {codegen.call('_sl_block', *given)}", *form.warm("s")]
    # nothing from one sample to the next
    flat = inputs and not form.cls.outputs and not form.s_kinds
    if flat and lanes.in_vectors(code, *numbers, inputs):
        x = "".join(codegen.each("%s, ", signals[:inputs]))
        return [f"_sl.steps(_sl_block, p, ({x}), {signals[inputs]}, n)"]
    if form.beside and lanes.go_abreast(code, *numbers, form.s_type, form.s_kinds, inputs):
        starts = range(0, len(signals), inputs + 1)
        read = _row([_row(signals[start : start + inputs]) for start in starts])
        p, s = (_row(codegen.each(f"{letter}%s", members)) for letter in "ps")
        outputs = _row(signals[inputs :: inputs + 1])
        return [f"{s} = _sl.abreast(_sl_one, {p}, {s}, {read}, {outputs}, n)"]
    # Two blocks that cannot go in lanes share the loop as they are: each still runs
    # while the other waits for its last sample.
    before, lines = [], []
    for suffix, part in zip(["", "1"], form.parts, strict=False):
        samples = codegen.each(f"%s{suffix}[i]", form.signals)
        for signal, constant in enumerate(part.fixed):
            if constant:
                before.append(f"c{signal}{suffix} = x{signal}{suffix}[0]")
                samples[signal] = f"c{signal}{suffix}"
        for signal, listened in enumerate(form.read, inputs):
            if not listened:
                samples[signal] = "_sl_unread"  # a variable: what nobody reads, LLVM leaves out
        made = codegen.several(samples[inputs:], bool(form.cls.outputs))
        run = codegen.call("_sl_block", f"p{suffix}", f"s{suffix}", *samples[:inputs])
        lines += [f"{made}, s{suffix} = {run}", *form.warm(f"s{suffix}")]
    return [*before, "for i in range(n):", *codegen.indented(lines)]


def kinds(numbers: Any) -> str:
    """Return the kinds of fields as letters."""
    return "".join(kind(field) for field in numbers)
