"""A straight-line function on several numbers at once: it is run on stand-ins, each operation of which writes its vector
instruction.

So a loop over a helper is vectors by construction.  numba leaves that to LLVM, which takes shorter vectors or none.
"""

from __future__ import annotations

import types as python
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from ...blocks import maps
from ...core import maths
from ...core.graph import Abs, Add, AtLeast, Block, Div, Equal, Greater, Mul, Neg, NotEqual, Sub, signals
from ...core.steps import used
from ...errors import SceneError
from . import kernels, native
from .kernels import DOUBLE, F8, I64, cases, known, load, loop, shuffle, splat, store
from .native import I8

I1 = ir.IntType(1)
WIDTHS = 16, 2
"""Sixteen hide the latency of the operations; two are quickest where a sink asks for a sample or two."""


class Lanes:
    """Float64, uint64 or truth values, side by side."""

    __array_ufunc__ = None  # a numpy scalar on the left leaves the operation to us

    def __init__(self, b: ir.IRBuilder, v: ir.Value):
        self.b, self.v = b, v

    def like(self, x: Any) -> ir.Value:
        """A number of the same kind, in every lane."""
        kind = self.v.type.element
        if isinstance(x, Lanes):
            if x.v.type != self.v.type:
                raise TypeError("numbers, words and truth values are mixed")
            return x.v
        if not isinstance(x, np.uint64 if kind == I64 else (int, float)):  # np.float64 is a float
            raise TypeError(f"{x!r} is of another kind")
        return splat(self.b, ir.Constant(kind, float(x) if kind == DOUBLE else int(x)), self.v.type.count)

    def of(self, kind: ir.Type) -> ir.VectorType:
        """As many of another kind."""
        return ir.VectorType(kind, self.v.type.count)

    def __bool__(self):
        raise TypeError("each lane has a truth value of its own: use where(c, a, b)")

    def __neg__(self):
        return Lanes(self.b, self.b.fneg(self.v))

    def __abs__(self):
        return Lanes(self.b, known(self.b, "fabs", self.v))


def _operator(of_floats: str, of_words: str, swapped: bool) -> Callable:
    def f(self, other):
        x, y = self.v, self.like(other)
        name = of_floats if x.type.element == DOUBLE else of_words
        if not name or (x.type.element == I1 and name not in ("and_", "or_", "xor")):
            raise TypeError("a truth value is no number: write where(c, 1.0, 0.0)")
        return Lanes(self.b, getattr(self.b, name)(*((y, x) if swapped else (x, y))))

    return f


def _comparison(sign: str) -> Callable:
    def f(self, other):
        x, y = self.v, self.like(other)
        if x.type.element == DOUBLE:
            return Lanes(self.b, (self.b.fcmp_unordered if sign == "!=" else self.b.fcmp_ordered)(sign, x, y))
        return Lanes(self.b, self.b.icmp_unsigned(sign, x, y))

    return f


for _name, _floats, _words in (
    ("add", "fadd", "add"), ("sub", "fsub", "sub"), ("mul", "fmul", "mul"), ("truediv", "fdiv", ""), ("and", "", "and_"),
    ("or", "", "or_"), ("xor", "", "xor"), ("lshift", "", "shl"), ("rshift", "", "lshr"),
):  # fmt: skip
    setattr(Lanes, f"__{_name}__", _operator(_floats, _words, swapped=False))
    setattr(Lanes, f"__r{_name}__", _operator(_floats, _words, swapped=True))
for _name, _sign in (("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "=="), ("ne", "!=")):
    setattr(Lanes, f"__{_name}__", _comparison(_sign))


def _lanes(*v: Any) -> tuple[ir.IRBuilder, list[ir.Value]]:
    first = next(x for x in v if isinstance(x, Lanes))
    return first.b, [first.like(x) for x in v]


def _where(c: Lanes, x: Any, y: Any) -> Lanes:
    if c.v.type.element != I1:
        raise TypeError("where takes a comparison")
    some = next((v for v in (x, y) if isinstance(v, Lanes)), Lanes(c.b, kernels.zeros(c.of(DOUBLE))))
    return Lanes(c.b, c.b.select(c.v, some.like(x), some.like(y)))


def _known(name: str) -> Callable:
    def f(*v):
        b, values = _lanes(*v)
        return Lanes(b, known(b, name, *values))

    return f


TWINS: dict[str, Callable] = {
    "fma": _known("fma"), "sqrt": _known("sqrt"), "floor": _known("floor"), "where": _where,
    "flush": lambda x: Lanes(x.b, kernels.flush(x.b, x.v)), "as_float": lambda x: Lanes(x.b, x.b.uitofp(x.v, x.of(DOUBLE))),
    "bits": lambda x: Lanes(x.b, x.b.bitcast(x.v, x.of(I64))), "unbits": lambda x: Lanes(x.b, x.b.bitcast(x.v, x.of(DOUBLE))),
}  # fmt: skip
"""What names of ``maths`` do to stand-ins."""


NAMESPACE = python.SimpleNamespace(**TWINS, SILENT=maths.SILENT, TINY=maths.TINY)


def twin(v: Any) -> Any:
    """What a global of a helper becomes, a helper's own or that of its compiled text; None where there is nothing."""
    if isinstance(v, (float, np.uint64)) or v is abs or v is range:
        return v
    if v is maths or v is native:
        return NAMESPACE
    for name in TWINS:
        if v is getattr(maths, name) or v is getattr(native, name):
            return TWINS[name]
    f = getattr(v, "py_func", v)
    return bind(f) if isinstance(f, python.FunctionType) and f.__module__ not in (maths.__name__, native.__name__) else None


@cache
def bind(f: python.FunctionType) -> Callable | None:
    """A step or helper as a function of stand-ins; None where it uses what has no twin."""
    scope = {name: twin(f.__globals__[name]) for name, _ in used(f.__code__) if name in f.__globals__}
    of_maths = [name for name in f.__code__.co_names if hasattr(maths, name)] if NAMESPACE in scope.values() else []
    if not all(hasattr(NAMESPACE, name) for name in of_maths):
        return None
    if None in scope.values() or f.__closure__:
        return None
    return python.FunctionType(f.__code__, {"__builtins__": {"abs": abs, "range": range}, **scope})


def number(b: ir.IRBuilder, v: Any) -> ir.Value:
    """What a helper has returned, numbers side by side or one number."""
    if isinstance(v, Lanes) and v.v.type.element != DOUBLE:
        raise TypeError("it returns no number: write where(c, 1.0, 0.0)")
    return v.v if isinstance(v, Lanes) else Lanes(b, kernels.zeros(kernels.V8)).like(v)


def fault(helper: Callable | None, p_type: Any, kinds: list[ir.Type]) -> str:
    """Why a helper(p, *x) of numbers or words cannot run in vectors, or nothing.  It is tried."""
    if helper is None:
        return "it uses what they do not have"
    b = ir.IRBuilder(ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), []), "trial").append_basic_block())
    p = p_type(*(Lanes(b, kernels.zeros(kernels.V8)) for _ in p_type._fields)) if hasattr(p_type, "_fields") else ()
    try:
        y = helper(p, *(Lanes(b, ir.Constant(ir.VectorType(kind, 8), ir.Undefined)) for kind in kinds))
        for v in y if isinstance(y, tuple) else (y,):
            number(b, v)
    except Exception as e:  # of an author's code
        return str(e)
    return ""


def in_vectors(step: Any, p_type: Any, inputs: int) -> bool:
    """Whether a step without state can run in vectors."""
    run = twin(step)
    return not fault(run and (lambda p, *x: run(p, (), *x)[0]), p_type, [DOUBLE] * inputs)


def _steps(b, step, p, x, y, n):
    """y[i] = step(p, (), x[0][i], x[1][i], ..)[0] for n samples, and for those that fill the last vector up."""

    def at(i):
        samples = [Lanes(b, load(b, q, i)) for q in x]
        store(b, number(b, step(p, (), *samples)[0]), y, i)

    with b.if_else(b.icmp_signed("==", n, I64(64))) as (whole, part):
        with whole:  # no loop, which would take as long as the work
            for i in range(0, 64, 8):
                at(i)
        with part, loop(b, I64(0), n, 8) as (i, _):
            at(i)


def _numbers(b, t, p):
    """A NamedTuple of numbers, or ()."""
    return t.instance_class(*(Lanes(b, splat(b, b.extract_value(p, k))) for k in range(len(t)))) if len(t) else ()


@intrinsic
def steps(ctx, f, p, x, y, n):
    """A step without state along slots: p a NamedTuple of numbers or (), x a tuple of pointers."""

    def code(c, b, sig, v):
        _, p, x, y, n = v
        numbers = _numbers(b, sig.args[1], p)
        _steps(b, twin(f.dispatcher), numbers, [b.extract_value(x, k) for k in range(len(sig.args[2]))], y, n)
        return c.get_dummy_value()

    return types.void(f, p, x, y, types.int64), code


def _helper(f: Any, p_type: Any, kinds: list[ir.Type]) -> Callable:
    """What each and pairs run; an error for the author where it cannot be."""
    helper = twin(f.dispatcher)
    call = helper if p_type is not None else helper and (lambda p, *x: helper(*x))
    if why := fault(call, p_type, kinds):
        raise SceneError(
            f"{f.dispatcher.py_func.__name__} cannot run in vectors: {why}. They have arithmetic, comparisons, abs, "
            f"{', '.join(TWINS)} and helpers of these; else write a loop over the samples in place of each(..)"
        )
    return helper


@intrinsic
def _each(ctx, f, p, x, y):
    floats = isinstance(p, types.BaseTuple) and all(t == types.float64 for t in getattr(p, "types", ()))
    if not (floats and isinstance(x, types.BaseTuple)):
        raise SceneError("each(f, p, x, y): p must be a NamedTuple of floats or (), and x a tuple of arrays, such as (x,)")
    helper = _helper(f, getattr(p, "instance_class", ()), [DOUBLE] * len(x))

    def code(c, b, sig, v):
        _, p, x, y = v
        numbers = _numbers(b, sig.args[1], p)
        x = [c.make_array(t)(c, b, b.extract_value(x, k)).data for k, t in enumerate(sig.args[2])]
        y = c.make_array(sig.args[3])(c, b, y)
        n = b.extract_value(y.shape, 0)
        few = b.icmp_signed("<", n, I64(8))
        room = [cgutils.alloca_once(b, DOUBLE, 8) for _ in (*x, y)]
        with b.if_then(few):  # what is beyond the end belongs to others
            for to, q in zip(room, x, strict=False):
                store(b, kernels.zeros(kernels.V8), to)
                cgutils.raw_memcpy(b, to, q, n, 8)
        *x, out = (b.select(few, to, q) for to, q in zip(room, (*x, y.data), strict=True))
        last = b.select(few, I64(0), b.sub(n, I64(8)))
        with loop(b, I64(0), n, 8) as (i, _):
            i = b.select(b.icmp_signed("<", i, last), i, last)  # the last eight may hold some that are there already
            store(b, number(b, helper(numbers, *(Lanes(b, load(b, q, i)) for q in x))), out, i)
        with b.if_then(few):
            cgutils.raw_memcpy(b, y.data, out, n, 8)
        return c.get_dummy_value()

    return types.void(f, p, x, y), code


@native.plain
def each(f, p, x, y):
    """maths.each."""
    _each(f, p, x, y)  # type: ignore[call-arg]


OPERATIONS: tuple[type[Block], ...] = (
    Add, Sub, Mul, Div, Neg, Abs, Greater, AtLeast, Equal, NotEqual, maps.Where, maps.Maximum, maps.Minimum, maps.Sqrt,
    maps.Nonzero,
)  # fmt: skip
"""Blocks that are one operation: the runtime does these itself, without a call."""


@intrinsic
def operation(ctx, number, W, A, n):
    """Row of an operation: A has the slots of its inputs and that of its output."""

    def code(c, b, sig, v):
        number, W, A, n = v

        def body(cls):
            *x, y = (b.gep(W, [b.load(b.gep(A, [I64(k)]))]) for k in range(len(signals(cls)) + 1))
            _steps(b, bind(cls.step), (), x, y, n)

        cases(b, number, {k: lambda cls=cls: body(cls) for k, cls in enumerate(OPERATIONS)})
        return c.get_dummy_value()

    return types.void(types.int64, F8, I8, types.int64), code


@intrinsic
def _pairs(ctx, f, key, first, z, n):
    helper = _helper(f, None, [I64, I64])

    def code(c, b, sig, v):
        key, first, z, n = v[1:]
        whole = b.and_(n, I64(-2 * WIDTHS[0]))
        for W, start, stop in zip(WIDTHS, (I64(0), whole), (whole, n), strict=True):
            steps = ir.Constant(ir.VectorType(I64, W), list(range(W)))
            with loop(b, start, stop, 2 * W) as (i, _):
                m = b.add(splat(b, b.add(first, b.lshr(i, I64(1))), W), steps)
                one, other = helper(Lanes(b, splat(b, key, W)), Lanes(b, m))
                for k in range(0, W, min(4, W)):
                    both = [lane for j in range(k, min(k + 4, W)) for lane in (j, W + j)]
                    store(b, shuffle(b, one.v, other.v, both), z, b.add(i, I64(2 * k)))
        return c.get_dummy_value()

    return types.void(f, types.uint64, types.uint64, F8, types.int64), code


@native.plain
def pairs(f, key, first, z):
    """maths.pairs."""
    _pairs(f, key, first, native.data(z), z.size)  # type: ignore[call-arg]
