"""Straight-line functions on several numbers at once.

A function is run on stand-ins, each operation of which writes its vector instruction.

So a loop over a helper is vectors by construction.  numba leaves that to LLVM, which
takes shorter vectors or none.
"""

from __future__ import annotations

import types as python
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from ...core import maths, pointwise
from ...core.graph import (
    Abs,
    Add,
    AtLeast,
    Block,
    Div,
    Equal,
    Greater,
    Mul,
    Neg,
    NotEqual,
    Sub,
    signals,
)
from ...core.steps import used
from ...errors import SceneError
from . import intrinsics, kernels
from .intrinsics import I8
from .kernels import DOUBLE, F8, I32, I64, cases, f8, known, load, loop, shuffle, splat, store

WIDTHS = 16, 2
"""Sixteen hide the latency of the operations; two are quickest where a sink asks for a
sample or two.
"""


class Lanes:
    """Float64, uint64 or truth values, side by side in a vector."""

    __array_ufunc__ = None  # a numpy scalar on the left leaves the operation to us

    def __init__(self, b: ir.IRBuilder, v: ir.Value):
        self.b, self.v = b, v

    @property
    def kind(self) -> ir.Type:
        """The type of a lane."""
        return self.v.type.element

    def __bool__(self):
        # as a < b < c asks for
        raise TypeError("each lane has a truth value of its own: use where(c, a, b)")

    def like(self, x: Any) -> ir.Value:
        """Return a value in every lane; raise TypeError if it is of another kind.

        Unlike numpy, this converts no kind into another.
        """
        if isinstance(x, Lanes):
            return x.are(self.kind)
        if self.kind == DOUBLE:
            return splat(self.b, ir.Constant(DOUBLE, float(x)), self.v.type.count)
        if self.kind != I64 or not isinstance(x, (int, np.uint64)) or x < 0:
            raise TypeError(f"{x!r} is of another kind")
        return splat(self.b, ir.Constant(I64, int(x)), self.v.type.count)

    def are(self, kind: ir.Type) -> ir.Value:
        """Return the vector; raise TypeError if it is of another kind."""
        if self.kind != kind:
            raise TypeError(f"lanes of {self.kind}, not {kind}")
        return self.v

    def of(self, kind: ir.Type) -> ir.VectorType:
        """Return the vector type for another kind of number, with as many lanes."""
        return ir.VectorType(kind, self.v.type.count)

    def __neg__(self):
        return Lanes(self.b, self.b.fneg(self.are(DOUBLE)))

    def __abs__(self):
        return Lanes(self.b, known(self.b, "fabs", self.are(DOUBLE)))


TRUTH = ir.IntType(1)


def _operator(of_floats: str, of_words: str, swapped: bool) -> Callable:
    def f(self, other):
        x, y = self.v, self.like(other)
        name = of_floats if self.kind == DOUBLE else of_words
        if not name or (self.kind == TRUTH and name not in ("and_", "or_", "xor")):
            raise TypeError("a truth value is no number: write where(c, 1.0, 0.0)")
        return Lanes(self.b, getattr(self.b, name)(*((y, x) if swapped else (x, y))))

    return f


def _comparison(sign: str) -> Callable:
    def f(self, other):
        x, y = self.v, self.like(other)
        if self.kind == DOUBLE:
            return Lanes(
                self.b, (self.b.fcmp_unordered if sign == "!=" else self.b.fcmp_ordered)(sign, x, y)
            )
        return Lanes(self.b, self.b.icmp_unsigned(sign, x, y))

    return f


for _name, _floats, _words in (
    ("add", "fadd", "add"), ("sub", "fsub", "sub"), ("mul", "fmul", "mul"),
    ("truediv", "fdiv", ""), ("and", "", "and_"), ("or", "", "or_"), ("xor", "", "xor"),
    ("lshift", "", "shl"), ("rshift", "", "lshr"),
):  # fmt: skip
    setattr(Lanes, f"__{_name}__", _operator(_floats, _words, swapped=False))
    setattr(Lanes, f"__r{_name}__", _operator(_floats, _words, swapped=True))
for _name, _sign in (
    ("lt", "<"),
    ("le", "<="),
    ("gt", ">"),
    ("ge", ">="),
    ("eq", "=="),
    ("ne", "!="),
):
    setattr(Lanes, f"__{_name}__", _comparison(_sign))


def _one_of(*v: Any) -> Lanes:
    for x in v:
        if isinstance(x, Lanes):
            return x
    raise TypeError("nothing but numbers")


def _where(c: Any, x: Any, y: Any) -> Lanes:
    truth = _one_of(c).are(TRUTH)
    words = all(isinstance(v, np.uint64) for v in (x, y))
    some = _one_of(x, y, Lanes(c.b, ir.Constant(c.of(I64 if words else DOUBLE), ir.Undefined)))
    if some.kind == TRUTH:
        raise TypeError("a truth value is no number")
    return Lanes(c.b, c.b.select(truth, some.like(x), some.like(y)))


def _known(name: str) -> Callable:
    def f(*v):
        some = _one_of(*v)
        some.are(DOUBLE)
        return Lanes(some.b, known(some.b, name, *map(some.like, v)))

    return f


def _of(kind: ir.Type, code: Callable) -> Callable:
    """Return a function on lanes that emits code for one value of a given kind."""
    return lambda x: Lanes(_one_of(x).b, code(x.b, x.are(kind), x))


TWINS: dict[str, Callable] = {name: _known(name) for name in ("fma", "sqrt", "floor")}
TWINS["where"] = _where
TWINS["flush"] = _of(DOUBLE, lambda b, v, x: kernels.flush(b, v))
TWINS["as_float"] = _of(I64, lambda b, v, x: b.uitofp(v, x.of(DOUBLE)))
TWINS["bits"] = _of(DOUBLE, lambda b, v, x: b.bitcast(v, x.of(I64)))
TWINS["unbits"] = _of(I64, lambda b, v, x: b.bitcast(v, x.of(DOUBLE)))
_scope = {"__builtins__": {"abs": abs}, **maths.CONSTANTS, **TWINS}
for _name, _f in maths.ELEMENTARY.items():
    TWINS[_name] = _scope[_name] = python.FunctionType(_f.__code__, _scope, _name)
"""What names of ``maths`` do to stand-ins."""


NAMESPACE = python.SimpleNamespace(**TWINS, SILENT=maths.SILENT, TINY=maths.TINY)


def twin(v: Any) -> Any:
    """Return the object that replaces a global of a helper, or None.

    The global is that of the helper itself, or of its compiled source.
    """
    if (
        isinstance(v, (float, np.uint64))
        or v is abs
        or v is range
        or (isinstance(v, type) and hasattr(v, "_fields"))
    ):
        return v
    if v is maths or v is intrinsics:
        return NAMESPACE
    for name in TWINS:
        if v is getattr(maths, name) or v is getattr(intrinsics, name):
            return TWINS[name]
    f = getattr(v, "py_func", v)
    return (
        bind(f)
        if isinstance(f, python.FunctionType)
        and f.__module__ not in (maths.__name__, intrinsics.__name__)
        else None
    )


def bind(f: python.FunctionType) -> Callable | None:
    """Return a step or helper as a function on lanes.

    None if it uses something that has no replacement.
    """
    scope = {
        name: twin(f.__globals__[name]) for name, _ in used(f.__code__) if name in f.__globals__
    }
    of_maths = (
        [name for name in f.__code__.co_names if hasattr(maths, name)]
        if NAMESPACE in scope.values()
        else []
    )
    if not all(hasattr(NAMESPACE, name) for name in of_maths):
        return None
    if None in scope.values() or f.__closure__:
        return None
    return python.FunctionType(
        f.__code__, {"__builtins__": {"abs": abs, "range": range}, **scope}, None, f.__defaults__
    )


def number(b: ir.IRBuilder, v: Any, width: int = 8) -> ir.Value:
    """Return a helper's result, lanes or a single number, as a vector of a width."""
    if isinstance(v, Lanes) and v.v.type.element != DOUBLE:
        raise TypeError("it must return a number; write where(c, 1.0, 0.0)")
    return v.v if isinstance(v, Lanes) else splat(b, ir.Constant(DOUBLE, float(v)), width)


def fault(helper: Callable | None, p_type: Any, p_kinds: str, kinds: str) -> str:
    """Return why a helper(p, *x) cannot run in vectors, or "".

    f: a float, u: np.uint64. The answer comes from trying it.
    """
    if helper is None:
        return "it uses something that they do not support"
    vectors = [ir.VectorType(I64 if k == "u" else DOUBLE, 8) for k in p_kinds + kinds]
    trial = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), vectors), "trial")
    b = ir.IRBuilder(trial.append_basic_block())
    v = [Lanes(b, x) for x in trial.args]
    try:
        y = helper(p_type(*v[: len(p_kinds)]) if p_kinds else (), *v[len(p_kinds) :])
        for part in y if isinstance(y, tuple) else (y,):
            for one in part if isinstance(part, tuple) else (part,):
                number(b, one)
    except Exception as e:  # of an author's code
        return str(e)
    return ""


def in_vectors(step: Any, p_type: Any, p_kinds: str, inputs: int) -> bool:
    """Return whether a step without state can run in vectors."""
    run = twin(step)
    return not fault(run and (lambda p, *x: run(p, (), *x)[0]), p_type, p_kinds, "f" * inputs)


def go_abreast(
    step: Any, p_type: Any, p_kinds: str, s_type: Any, s_kinds: str, inputs: int
) -> bool:
    """Return whether two blocks can run side by side, one in each lane.

    Their state must consist of floats.
    """
    run, k = twin(step), len(s_kinds)
    call = run and (lambda p, *v: run(p, s_type(*v[:k]), *v[k:]))
    return set(s_kinds) == {"f"} and not fault(call, p_type, p_kinds, "f" * (k + inputs))


def _steps(b, step, p, x, y, n):
    """Emit y[i] = step(p, (), x[0][i], x[1][i], ..)[0] for n samples.

    Samples that fill up the last vector are computed as well.
    """

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
    """Return a NamedTuple of numbers as lanes, or ()."""
    return (
        t.instance_class(*(Lanes(b, splat(b, b.extract_value(p, k))) for k in range(len(t))))
        if len(t)
        else ()
    )


@intrinsic
def steps(ctx, f, p, x, y, n):
    """Run a step without state along slots.

    p is a NamedTuple of numbers or (), x a tuple of pointers.
    """

    def code(c, b, sig, v):
        _, p, x, y, n = v
        numbers = _numbers(b, sig.args[1], p)
        _steps(
            b,
            twin(f.dispatcher),
            numbers,
            [b.extract_value(x, k) for k in range(len(sig.args[2]))],
            y,
            n,
        )
        return c.get_dummy_value()

    return types.void(f, p, x, y, types.int64), code


@intrinsic
def abreast(ctx, f, p, s, x, y, n):
    """Run a step along the slots of two blocks, one in each lane.

    p, s, x and y hold what belongs to the one and to the other. The states after n
    samples are returned.
    """

    def code(c, b, sig, v):
        p, s, x, y, n = v[1:]

        def both(one, other):
            none = ir.Constant(ir.VectorType(one.type, 2), ir.Undefined)
            return b.insert_element(b.insert_element(none, one, I32(0)), other, I32(1))

        def pairs_of(pair, t):
            one, other = (b.extract_value(pair, k) for k in range(2))
            return [(b.extract_value(one, k), b.extract_value(other, k)) for k in range(len(t[0]))]

        step, S = twin(f.dispatcher), sig.args[2][0]
        lanes = [Lanes(b, both(*pair)) for pair in pairs_of(p, sig.args[1])]
        numbers = sig.args[1][0].instance_class(*lanes) if lanes else ()
        cells = [cgutils.alloca_once_value(b, both(*pair)) for pair in pairs_of(s, sig.args[2])]
        with loop(b, I64(0), n, 1) as (i, _):
            samples = [
                Lanes(b, both(*(b.load(b.gep(q, [i])) for q in pair)))
                for pair in pairs_of(x, sig.args[3])
            ]
            old = S.instance_class(*(Lanes(b, b.load(cell)) for cell in cells))
            out, new = step(numbers, old, *samples)
            for k in range(2):
                b.store(
                    b.extract_element(old[0].like(out), I32(k)), b.gep(b.extract_value(y, k), [i])
                )
            for cell, value in zip(cells, new, strict=True):
                b.store(old[0].like(value), cell)
        last = [b.load(cell) for cell in cells]
        states = []
        for k in range(2):
            one = [b.extract_element(value, I32(k)) for value in last]
            states.append(c.make_tuple(b, S, one))
        return c.make_tuple(b, sig.return_type, states)

    return types.UniTuple(s[0], 2)(f, p, s, x, y, types.int64), code


def _helper(f: Any, p_type: Any, p_kinds: str, kinds: str, s_type: Any = None) -> Callable:
    """Return a helper of each, pairs or series; raise SceneError for its author."""
    helper = twin(f.dispatcher)
    call = helper if "f" in kinds else helper and (lambda p, *x: helper(*x))
    if s_type:
        call = helper and (lambda p, *v: helper(p, s_type(*v[:-1]), v[-1]))
    if why := fault(call, p_type, p_kinds, kinds):
        raise SceneError(
            f"{f.dispatcher.py_func.__name__} cannot run in vectors: {why}. Vectors support"
            " arithmetic, comparisons, abs,"
            f" {', '.join(n for n in TWINS if n[0] != '_')} and helpers of these; else write a"
            " loop over the samples"
        )
    return helper


@intrinsic
def each(ctx, f, p, x, y):
    """Compute maths.each."""
    tuples = isinstance(p, types.BaseTuple) and isinstance(x, types.BaseTuple)
    known_kinds: dict[Any, str] = {types.float64: "f", types.uint64: "u"}
    kinds = "".join(known_kinds.get(t, "?") for t in getattr(p, "types", "?"))
    if not tuples or "?" in kinds or not all(map(_is_floats, (*x, y))):
        raise SceneError(
            "each(f, p, x, y): p must be a NamedTuple of numbers or (), x a tuple of arrays, such"
            " as (x,), and all arrays of floats without gaps; else write a loop over the samples"
        )
    helper = _helper(f, getattr(p, "instance_class", ()), kinds, "f" * len(x))

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
        ends = cgutils.alloca_once(b, DOUBLE, 8)
        # the last eight, which may hold some of those before, first: x may be y
        with loop(b, I64(0), n, 8) as (i, _):
            first = b.icmp_signed("==", i, I64(0))
            i = b.select(first, last, b.sub(i, I64(8)))
            samples = [Lanes(b, load(b, q, i)) for q in x]
            store(b, number(b, helper(numbers, *samples)), b.select(first, ends, b.gep(out, [i])))
        with b.if_then(b.icmp_signed(">", n, I64(0))):
            store(b, load(b, ends), out, last)
        with b.if_then(few):
            cgutils.raw_memcpy(b, y.data, out, n, 8)
        return c.get_dummy_value()

    return types.void(f, p, x, y), code


def _masked(b, q, there, v=None):
    """Load the elements whose mask is set, and 0 for others; with v, store them."""
    t = ir.VectorType(DOUBLE, there.type.count)
    place = b.bitcast(q, t.as_pointer())
    given = [v, place, I32(8), there] if v else [place, I32(8), there, kernels.zeros(t)]
    kind = ir.FunctionType(ir.VoidType() if v else t, [a.type for a in given])
    name = f"llvm.masked.{'store' if v else 'load'}.v{t.count}f64.p0v{t.count}f64"
    return b.call(cgutils.get_or_insert_function(b.module, kind, name), given)


def _stages(b, W, helper, types, fields, count, x, y, n):
    """Emit maths.series of ``count`` stages, up to W, one in each lane.

    Each is one sample behind the one before, which hands its output on by a lane.
    """
    lanes, behind = ir.Constant(ir.VectorType(I64, W), list(range(W))), b.sub(count, I64(1))
    there, zero = b.icmp_unsigned("<", lanes, splat(b, count, W)), I64(0)
    p = [splat(b, v, W) if v.type == DOUBLE else _masked(b, v, there) for v in fields[0]]
    cells = [  # outputs of the turn before, and states
        kernels.variable(b, v)
        for v in (
            kernels.zeros(ir.VectorType(DOUBLE, W)),
            *(_masked(b, q, there) for q in fields[1]),
        )
    ]

    def turn(i, part):
        at, late = i, b.sub(i, behind)  # samples of the first and of the last stage
        if part:  # some stages have no sample yet, or no more
            at = b.select(b.icmp_signed("<", i, n), i, b.sub(n, I64(1)))
            late = b.select(b.icmp_signed(">", late, zero), late, zero)
        v, *old = map(b.load, cells)
        v = shuffle(b, v, splat(b, b.load(b.gep(x, [at])), W), [W, *range(W - 1)])
        own = (t(*(Lanes(b, u) for u in one)) for t, one in zip(types, (p, old), strict=True))
        out, new = helper(*own, Lanes(b, v))
        out, *new = [number(b, u, W) for u in (out, *new)]
        if part:
            runs = b.icmp_unsigned("<", b.sub(splat(b, i, W), lanes), splat(b, n, W))
            new = [b.select(runs, u, o) for u, o in zip(new, old, strict=True)]
        for cell, u in zip(cells, (out, *new), strict=True):
            b.store(u, cell)
        b.store(b.extract_element(out, behind), b.gep(y, [late]))

    most = b.select(b.icmp_signed(">", n, behind), n, behind)
    for start, stop, part in (
        (zero, behind, True),
        (behind, most, False),
        (most, b.add(n, behind), True),
    ):
        with loop(b, start, stop, 1) as (i, _):
            turn(i, part)
    for q, cell in zip(fields[1], cells[1:], strict=True):
        _masked(b, q, there, b.load(cell))


# Of numbers of stages for which there is a loop, 1, 2, 4 .. : more than 16 take several
# passes, or fewer where more lanes would not fit into the registers.
STAGES = 5 if "+avx512f" in kernels.FEATURES else 4 if "+avx" in kernels.FEATURES else 3


def _is_floats(t: Any) -> bool:
    """Return whether a type is that of an array of floats without gaps."""
    return isinstance(t, types.Array) and (t.dtype, t.ndim, t.layout) == (types.float64, 1, "C")


@intrinsic
def series(ctx, f, p, s, x, y):
    """Compute maths.series."""
    tuples = all(isinstance(t, types.BaseNamedTuple) for t in (p, s))
    if not (tuples and all(_is_floats(t) or t == types.float64 for t in p)) or not all(
        map(_is_floats, (*s, x, y))
    ):
        raise SceneError(
            "series(f, p, s, x, y): p must be a NamedTuple of numbers and arrays, s one of arrays,"
            " x and y arrays, all of floats without gaps; else write a loop over the samples"
        )
    both = p.instance_class, s.instance_class
    helper = _helper(f, both[0], "f" * len(p), "f" * (len(s) + 1), both[1])

    def code(c, b, sig, v):
        (x, _), (y, n) = (intrinsics.parts(c, b, sig.args[k], v[k]) for k in (3, 4))
        fields = [
            [intrinsics.parts(c, b, t, b.extract_value(v[k], j)) for j, t in enumerate(sig.args[k])]
            for k in (1, 2)
        ]
        size, most = fields[1][0][1], 1 << (STAGES - 1)
        stop = b.select(b.icmp_signed(">", n, I64(0)), size, I64(0))
        with loop(b, I64(0), stop, most) as (first, _):
            left = b.sub(size, first)
            count = b.select(b.icmp_signed("<", left, I64(most)), left, I64(most))
            source = b.select(b.icmp_signed("==", first, I64(0)), x, y)
            at = [[b.gep(a, [first]) if rest else a for a, *rest in one] for one in fields]
            cases(
                b,
                b.sub(I64(64), b.ctlz(b.sub(count, I64(1)), TRUTH(0))),
                {
                    k: lambda k=k: _stages(b, 1 << k, helper, both, at, count, source, y, n)
                    for k in range(STAGES)
                },
            )
        return c.get_dummy_value()

    return types.void(f, p, s, x, y), code


OPERATIONS: tuple[type[Block], ...] = (
    Add,
    Sub,
    Mul,
    Div,
    Neg,
    Abs,
    Greater,
    AtLeast,
    Equal,
    NotEqual,
    pointwise.Where,
    pointwise.Maximum,
    pointwise.Minimum,
    pointwise.Sqrt,
    pointwise.Nonzero,
)
"""Blocks that are one operation: the runtime does these itself, without a call."""


@intrinsic
def operation(ctx, number, W, A, n):
    """Run the row of an operation.

    A holds the slots of its inputs and that of its output.
    """

    def code(c, b, sig, v):
        number, W, A, n = v

        def body(cls):
            *x, y = (b.gep(W, [b.load(b.gep(A, [I64(k)]))]) for k in range(len(signals(cls)) + 1))
            _steps(b, bind(cls.step), (), x, y, n)

        cases(b, number, {k: lambda cls=cls: body(cls) for k, cls in enumerate(OPERATIONS)})
        return c.get_dummy_value()

    return types.void(types.int64, F8, I8, types.int64), code


def _draw(b, helper, key, first, z, W):
    """Emit z[2 k : 2 k + 2] = helper(key, first + k) for W pairs."""
    steps = ir.Constant(ir.VectorType(I64, W), list(range(W)))
    m = b.add(splat(b, first, W), steps)
    one, other = helper(Lanes(b, splat(b, key, W)), Lanes(b, m))
    for k in range(0, W, min(4, W)):
        both = [lane for j in range(k, min(k + 4, W)) for lane in (j, W + j)]
        store(b, shuffle(b, one.v, other.v, both), z, 2 * k)


@intrinsic
def pairs(ctx, f, key, first, z):
    """Compute maths.pairs."""
    helper = _helper(f, (), "", "uu")

    def body(b, key, first, z, n):
        with b.if_else(b.icmp_signed("==", n, I64(64))) as (tile, part):
            with tile:  # no loop, for two turns of which keys and constants would be prepared
                _draw(b, helper, key, first, z, 32)
            with part:
                whole = b.and_(n, I64(-2 * WIDTHS[0]))
                for W, start, stop in zip(WIDTHS, (I64(0), whole), (whole, n), strict=True):
                    with loop(b, start, stop, 2 * W) as (i, _):
                        m = b.add(first, b.lshr(i, I64(1)))
                        _draw(b, helper, key, m, b.gep(z, [i]), W)
        b.ret_void()

    def code(c, b, sig, v):
        name = f"pairs.{f.dispatcher.py_func.__name__}"
        if name not in b.module.globals:  # one function, however often it is called
            of = ir.FunctionType(ir.VoidType(), [I64, I64, DOUBLE.as_pointer(), I64])
            once = ir.Function(b.module, of, name)
            once.linkage = "internal"
            once.attributes.add("noinline")
            body(ir.IRBuilder(once.append_basic_block()), *once.args)
        b.call(b.module.globals[name], [*v[1:3], *intrinsics.parts(c, b, sig.args[3], v[3])])
        return c.get_dummy_value()

    return types.void(f, types.uint64, types.uint64, z), code


@intrinsic
def pairs_beside_modes(ctx, f, key, first, z, p, r, q, d, x, y):
    """Compute maths.pairs into z, and maths.modes of 8 from x to y, for a tile each.

    Each sample of the modes waits for the one before; the pairs are drawn meanwhile.
    """
    helper = _helper(f, (), "", "uu")

    def code(c, b, sig, v):
        given = zip(sig.args[1:], v[1:], strict=True)
        key, first, z, p, r, q, d, x, y = (intrinsics.parts(c, b, *one)[0] for one in given)
        done = b.block.instructions
        before = len(done)
        kernels.eight_modes(b, p, r, q, d, x, y)
        between = len(done)
        _draw(b, helper, key, first, z, 32)
        done[before:] = _merged(done[before:between], done[between:])
        return c.get_dummy_value()

    return types.void(f, types.uint64, types.uint64, z, p, r, q, f8, x, y), code


def _merged(one: list, other: list) -> list:
    """Return two lists of independent instructions as one, evenly mixed."""
    places = [((k + 0.5) / len(v), v is other, k) for v in (one, other) for k in range(len(v))]
    return [(other if second else one)[k] for _, second, k in sorted(places)]


# a tile may say maths.each
intrinsics.each, intrinsics.pairs, intrinsics.series = each, pairs, series  # type: ignore[attr-defined]
