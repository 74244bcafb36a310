"""What compiled code does for each name of ``stimlib.core.maths``, and the few memory operations segments need.

Kernels spell out their vectors, so their speed does not hang on the optimiser's mood, and every partial sum is kept
apart as ``maths`` defines it: the bits do not depend on the width of the machine's vectors.
"""

import math

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import carray, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from stimlib.core import maths

F8, I8, U8 = types.CPointer(types.float64), types.CPointer(types.int64), types.CPointer(types.uint64)
SEGMENT = types.void(F8, F8, F8, I8, types.int64)  # P, S, W, A, n
f8, u8, i8 = types.float64, types.uint64, types.int64
plain = njit(error_model="numpy", inline="always")

I64, I32, DOUBLE = ir.IntType(64), ir.IntType(32), ir.DoubleType()
V8 = ir.VectorType(DOUBLE, 8)
WIDE = bool(llvmlite.binding.get_host_cpu_features().get("avx512f"))
OUTS = 2 if WIDE else 1  # vectors of outputs a FIR keeps in registers, next to eight partial sums each
LANES = ir.VectorType(DOUBLE, 8 if WIDE else 4)

TINY, SILENT = maths.TINY, maths.SILENT


# one value -----------------------------------------------------------------------------------------------------------
@intrinsic
def fma(ctx, a, b, c):
    return f8(f8, f8, f8), lambda c, b, s, v: b.fma(*v)


@intrinsic
def where(ctx, c, a, b):
    t = u8 if a == u8 and b == u8 else f8

    def code(c, b, s, v):
        one = v[0] if v[0].type.width == 1 else b.icmp_unsigned("!=", v[0], ir.Constant(v[0].type, 0))
        return b.select(one, v[1], v[2])

    return t(types.boolean, t, t), code


@intrinsic
def bits(ctx, x):
    return u8(f8), lambda c, b, s, v: b.bitcast(v[0], I64)


@intrinsic
def unbits(ctx, u):
    return f8(u8), lambda c, b, s, v: b.bitcast(v[0], DOUBLE)


@intrinsic
def as_float(ctx, u):
    return f8(u8), lambda c, b, s, v: b.uitofp(v[0], DOUBLE)


exp, log, sin, cos, tanh = math.exp, math.log, math.sin, math.cos, math.tanh
sqrt, floor = np.sqrt, np.floor


@plain
def flush(x):
    return where(abs(x) <= SILENT, 0.0, x)


# memory --------------------------------------------------------------------------------------------------------------
@intrinsic
def at(ctx, p, o):
    """Pointer o words on."""
    return p(p, i8), lambda c, b, s, v: b.gep(v[0], [v[1]])


def _cast(to):
    @intrinsic
    def cast(ctx, p):
        return to(p), lambda c, b, s, v: b.bitcast(v[0], c.get_value_type(to))

    return cast


def _pointer(to):
    @intrinsic
    def pointer(ctx, n):
        return to(i8), lambda c, b, s, v: b.inttoptr(v[0], c.get_value_type(to))

    return pointer


as_u8, as_f8, as_i8 = _cast(U8), _cast(F8), _cast(I8)
f8_at, i8_at = _pointer(F8), _pointer(I8)


@intrinsic
def data(ctx, a):
    """Pointer to an array's first word."""
    return types.CPointer(a.dtype)(a), lambda c, b, s, v: c.make_array(s.args[0])(c, b, v[0]).data


@intrinsic
def address(ctx, p):
    return i8(p), lambda c, b, s, v: b.ptrtoint(v[0], I64)


@intrinsic
def move(ctx, to, source, n):
    """Copy n words."""

    def code(c, b, s, v):
        cgutils.raw_memcpy(b, v[0], v[1], v[2], 8)
        return c.get_dummy_value()

    return types.void(to, source, n), code


@intrinsic
def call(ctx, address, P, S, W, A, n):
    """Call the segment at an address."""

    def code(c, b, s, v):
        f = ir.FunctionType(ir.VoidType(), [x.type for x in v[1:]])
        b.call(b.inttoptr(v[0], ir.PointerType(f)), v[1:])
        return c.get_dummy_value()

    return types.void(address, P, S, W, A, n), code


@plain
def words(a):
    return carray(as_u8(data(a)), a.size)


@plain
def copy(a, b):
    move(data(b), data(a), a.size)


@plain
def search(knots, x):
    low, high = 0, knots.size - 2
    while low < high:
        k = (low + high + 1) >> 1
        if x >= knots[k]:
            low = k
        else:
            high = k - 1
    return low


# sums ----------------------------------------------------------------------------------------------------------------
def _load(b, p, t):
    v = b.load(b.bitcast(p, t.as_pointer()))
    v.align = 8
    return v


def _store(b, v, p):
    b.store(v, b.bitcast(p, v.type.as_pointer())).align = 8


def _splat(b, x, t):
    zero = ir.Constant(t, ir.Undefined)
    return b.shuffle_vector(b.insert_element(zero, x, I32(0)), zero, ir.Constant(ir.VectorType(I32, t.count), [0] * t.count))


def _fma(b, t, *v):
    f = cgutils.get_or_insert_function(b.module, ir.FunctionType(t, [t] * 3), f"llvm.fma.v{t.count}f64")
    return b.call(f, v)


def _tree(b, s):
    """maths.tree of eight values (numbers or vectors)."""
    a = b.fadd
    return a(a(a(s[0], s[4]), a(s[2], s[6])), a(a(s[1], s[5]), a(s[3], s[7])))


def _across(b, v):
    """maths.tree across the eight lanes of one vector."""
    while v.type.count > 1:
        n = v.type.count // 2
        half = [ir.Constant(ir.VectorType(I32, n), list(range(k, k + n))) for k in (0, n)]
        none = ir.Constant(v.type, ir.Undefined)
        v = b.fadd(b.shuffle_vector(v, none, half[0]), b.shuffle_vector(v, none, half[1]))
    return b.extract_element(v, I32(0))


def _for(b, start, stop, step):
    return cgutils.for_range_slice(b, start, stop, I64(step), I64)


def _sum_loop(b, taps, size, types_, body):
    """Run body(g, sums) -> sums over g = 0, 8, .. size with the sums held in registers."""
    before = b.basic_block
    loop, done = b.append_basic_block("sum"), b.append_basic_block("summed")
    b.branch(loop)
    b.position_at_end(loop)
    g = b.phi(I64)
    g.add_incoming(I64(0), before)
    sums = [b.phi(t) for t in types_]
    for s, t in zip(sums, types_, strict=True):
        s.add_incoming(ir.Constant(t, [0.0] * t.count), before)
    new = body(g, sums)
    after = b.add(g, I64(8))
    g.add_incoming(after, b.basic_block)
    for s, v in zip(sums, new, strict=True):
        s.add_incoming(v, b.basic_block)
    b.cbranch(b.icmp_signed("<", after, size), loop, done)
    b.position_at_end(done)
    return new


@intrinsic
def _fir_many(ctx, taps, w, y, n):
    """y[0:n] for n a multiple of OUTS vectors: outputs side by side, one tap after the other."""

    def code(c, b, sig, v):
        taps, w, y = (c.make_array(sig.args[k])(c, b, v[k]) for k in range(3))
        size, L = b.extract_value(taps.shape, 0), LANES.count
        with _for(b, I64(0), v[3], OUTS * L) as (i, _):
            base = b.gep(w.data, [i])

            def body(g, sums):
                out = list(sums)
                for j in range(8):
                    k = b.add(g, I64(j))
                    tap = _splat(b, b.load(b.gep(taps.data, [k])), LANES)
                    for o in range(OUTS):
                        x = _load(b, b.gep(base, [b.add(k, I64(o * L))]), LANES)
                        out[8 * o + j] = _fma(b, LANES, tap, x, out[8 * o + j])
                return out

            sums = _sum_loop(b, taps, size, [LANES] * (8 * OUTS), body)
            for o in range(OUTS):
                _store(b, _tree(b, sums[8 * o : 8 * o + 8]), b.gep(y.data, [b.add(i, I64(o * L))]))
        return c.get_dummy_value()

    return types.void(taps, w, y, i8), code


@intrinsic
def _fir_few(ctx, taps, w, y, start):
    """y[start:]: the eight partial sums side by side."""

    def code(c, b, sig, v):
        taps, w, y = (c.make_array(sig.args[k])(c, b, v[k]) for k in range(3))
        size, n = b.extract_value(taps.shape, 0), b.extract_value(y.shape, 0)
        with _for(b, v[3], n, 1) as (i, _):
            base = b.gep(w.data, [i])

            def body(g, sums):
                return [_fma(b, V8, _load(b, b.gep(taps.data, [g]), V8), _load(b, b.gep(base, [g]), V8), sums[0])]

            b.store(_across(b, _sum_loop(b, taps, size, [V8], body)[0]), b.gep(y.data, [i]))
        return c.get_dummy_value()

    return types.void(taps, w, y, i8), code


@plain
def fir(taps, w, y):
    many = y.size // (OUTS * LANE_COUNT) * (OUTS * LANE_COUNT)
    if many > 0:
        _fir_many(taps, w, y, many)
    _fir_few(taps, w, y, many)


LANE_COUNT = LANES.count


def _modes(groups):
    @intrinsic
    def some(ctx, e, r, q, x, w, k):
        """8*groups modes from k on: their states stay in registers, their products are added to w[8 i]."""

        def code(c, b, sig, v):
            e, r, q, x, w = (c.make_array(sig.args[j])(c, b, v[j]).data for j in range(5))
            n = b.extract_value(c.make_array(sig.args[3])(c, b, v[3]).shape, 0)
            places = [b.add(v[5], I64(8 * g)) for g in range(groups)]
            es = [b.fneg(_load(b, b.gep(e, [p]), V8)) for p in places]
            rs = [_load(b, b.gep(r, [p]), V8) for p in places]
            state = [cgutils.alloca_once_value(b, _load(b, b.gep(q, [p]), V8)) for p in places]
            with _for(b, I64(0), n, 1) as (i, _):
                drive = _splat(b, b.fadd(b.load(b.gep(x, [i])), ir.Constant(DOUBLE, TINY)), V8)
                out = b.gep(w, [b.shl(i, I64(3))])
                sums = _load(b, out, V8)
                for g in range(groups):
                    old = b.load(state[g])
                    new = b.fadd(old, _fma(b, V8, es[g], old, drive))
                    b.store(new, state[g])
                    sums = _fma(b, V8, rs[g], new, sums)
                _store(b, sums, out)
            for g in range(groups):
                _store(b, b.load(state[g]), b.gep(q, [places[g]]))
            return c.get_dummy_value()

        return types.void(e, r, q, x, w, i8), code

    return some


_modes_1, _modes_2 = _modes(1), _modes(2)


@intrinsic
def _modes_sum(ctx, d, x, w, y):
    def code(c, b, sig, v):
        x, w, y = (c.make_array(sig.args[j])(c, b, v[j]) for j in range(1, 4))
        with _for(b, I64(0), b.extract_value(y.shape, 0), 1) as (i, _):
            s = _across(b, _load(b, b.gep(w.data, [b.shl(i, I64(3))]), V8))
            s = b.fma(v[0], b.load(b.gep(x.data, [i])), s)
            size = b.call(b.module.declare_intrinsic("llvm.fabs", [DOUBLE]), [s])
            zero = b.fcmp_ordered("<=", size, ir.Constant(DOUBLE, SILENT))
            b.store(b.select(zero, ir.Constant(DOUBLE, 0.0), s), b.gep(y.data, [i]))
        return c.get_dummy_value()

    return types.void(f8, x, w, y), code


@plain
def modes(e, r, q, d, x, y, w):
    w[: 8 * y.size] = 0.0
    k = 0
    while k + 16 <= e.size:
        _modes_2(e, r, q, x, w, k)
        k += 16
    if k < e.size:
        _modes_1(e, r, q, x, w, k)
    _modes_sum(d, x, w, y)


@intrinsic
def run(ctx, address, c, x, y, n):
    """Call a program's entry at an address."""

    def code(c, b, s, v):
        f = ir.FunctionType(ir.VoidType(), [q.type for q in v[1:]])
        b.call(b.inttoptr(v[0], ir.PointerType(f)), v[1:])
        return c.get_dummy_value()

    return types.void(address, c, x, y, n), code


def _memory(groups):
    @intrinsic
    def some(ctx, e, r, q, low, x, w, k):
        """As _modes, for states of two words."""

        def code(c, b, sig, v):
            e, r, q, low, x, w = (c.make_array(sig.args[j])(c, b, v[j]).data for j in range(6))
            n = b.extract_value(c.make_array(sig.args[4])(c, b, v[4]).shape, 0)
            places = [b.add(v[6], I64(8 * g)) for g in range(groups)]
            es = [b.fneg(_load(b, b.gep(e, [p]), V8)) for p in places]
            rs = [_load(b, b.gep(r, [p]), V8) for p in places]
            state, rest = ([cgutils.alloca_once_value(b, _load(b, b.gep(a, [p]), V8)) for p in places] for a in (q, low))
            with _for(b, I64(0), n, 1) as (i, _):
                drive = _splat(b, b.fadd(b.load(b.gep(x, [i])), ir.Constant(DOUBLE, TINY)), V8)
                out = b.gep(w, [b.shl(i, I64(3))])
                sums = _load(b, out, V8)
                for g in range(groups):
                    old = b.load(state[g])
                    t = b.fadd(_fma(b, V8, es[g], old, drive), b.load(rest[g]))
                    new = b.fadd(old, t)
                    b.store(b.fsub(t, b.fsub(new, old)), rest[g])
                    b.store(new, state[g])
                    sums = _fma(b, V8, rs[g], new, sums)
                _store(b, sums, out)
            for g in range(groups):
                _store(b, b.load(state[g]), b.gep(q, [places[g]]))
                _store(b, b.load(rest[g]), b.gep(low, [places[g]]))
            return c.get_dummy_value()

        return types.void(e, r, q, low, x, w, i8), code

    return some


_modes_4, _memory_1, _memory_2, _memory_4 = _modes(4), _memory(1), _memory(2), _memory(4)


@intrinsic
def _memory_sum(ctx, w, y):
    def code(c, b, sig, v):
        w, y = (c.make_array(sig.args[j])(c, b, v[j]) for j in range(2))
        with _for(b, I64(0), b.extract_value(y.shape, 0), 1) as (i, _):
            s = _across(b, _load(b, b.gep(w.data, [b.shl(i, I64(3))]), V8))
            size = b.call(b.module.declare_intrinsic("llvm.fabs", [DOUBLE]), [s])
            zero = b.fcmp_ordered("<=", size, ir.Constant(DOUBLE, SILENT))
            b.store(b.select(zero, ir.Constant(DOUBLE, 0.0), s), b.gep(y.data, [i]))
        return c.get_dummy_value()

    return types.void(w, y), code


@plain
def memory(e, r, q, low, x, y, w):
    w[: 8 * y.size] = 0.0
    k = 0
    while k + 32 <= low.size:
        _memory_4(e, r, q, low, x, w, k)
        k += 32
    while k + 16 <= low.size:
        _memory_2(e, r, q, low, x, w, k)
        k += 16
    if k < low.size:
        _memory_1(e, r, q, low, x, w, k)
        k += 8
    while k + 32 <= e.size:
        _modes_4(e, r, q, x, w, k)
        k += 32
    while k + 16 <= e.size:
        _modes_2(e, r, q, x, w, k)
        k += 16
    if k < e.size:
        _modes_1(e, r, q, x, w, k)
    _memory_sum(w, y)
