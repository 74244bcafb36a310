"""Compiled forms of the functions of ``stimlib.core.maths``.

There are also the few memory operations that segments need.

The long sums are compiled once, in the runtime, and called by name: see ``kernels``.
"""

from types import FunctionType

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from stimlib.core import maths
from stimlib.targets.numba import kernels  # before njit: it says for which features to build

F8, I8, U8 = (
    types.CPointer(types.float64),
    types.CPointer(types.int64),
    types.CPointer(types.uint64),
)
SEGMENT = types.void(F8, F8, F8, I8, types.int64)  # P, S, W, A, n
f8, u8, i8 = types.float64, types.uint64, types.int64
plain = njit(error_model="numpy", inline="always")

I64, DOUBLE = ir.IntType(64), ir.DoubleType()

TINY, SILENT = maths.TINY, maths.SILENT
C_ORDER, ALIGNED, WRITEABLE = 0x1, 0x100, 0x400  # flags of an array
# bits of word 3 of a type of numbers: kind, letter, order of bytes, not the next,
# number
NUMBERS = -1 ^ (0xFF << 24)


# one value ----------------------------------------------------------------------------
@intrinsic
def fma(ctx, a, b, c):
    """Return a b + c with one rounding."""
    return f8(f8, f8, f8), lambda c, b, s, v: b.fma(*v)


@intrinsic
def where(ctx, c, a, b):
    """Return a if c else b."""
    t = u8 if a == u8 and b == u8 else f8

    def code(c, b, s, v):
        one = (
            v[0] if v[0].type.width == 1 else b.icmp_unsigned("!=", v[0], ir.Constant(v[0].type, 0))
        )
        return b.select(one, v[1], v[2])

    return t(types.boolean, t, t), code


@intrinsic
def bits(ctx, x):
    """Return the bits of a float64."""
    return u8(f8), lambda c, b, s, v: b.bitcast(v[0], I64)


@intrinsic
def unbits(ctx, u):
    """Return the float64 with these bits."""
    return f8(u8), lambda c, b, s, v: b.bitcast(v[0], DOUBLE)


@intrinsic
def as_float(ctx, u):
    """Convert a whole number to float64."""
    return f8(u8), lambda c, b, s, v: b.uitofp(v[0], DOUBLE)


sqrt, floor = np.sqrt, np.floor


@intrinsic
def flush(ctx, x):
    """Return x, or 0 where it is too small to matter."""
    return f8(f8), lambda c, b, s, v: kernels.flush(b, v[0])


@intrinsic
def settle(ctx, x):
    """Return x, or 0 where it is too small to matter, with a branch.

    A comparison and a selection would lengthen the recursion.
    """

    def code(c, b, s, v):
        size = b.call(b.module.declare_intrinsic("llvm.fabs", [DOUBLE]), [v[0]])
        start, rare, done = (
            b.basic_block,
            b.append_basic_block("silent"),
            b.append_basic_block("settled"),
        )
        b.cbranch(b.fcmp_ordered("<=", size, ir.Constant(DOUBLE, SILENT)), rare, done).set_weights(
            [1, 1000000]
        )
        b.position_at_end(rare)
        b.branch(done)
        b.position_at_end(done)
        y = b.phi(DOUBLE)
        y.add_incoming(v[0], start)
        y.add_incoming(ir.Constant(DOUBLE, 0.0), rare)
        return y

    return f8(f8), code


# straight-line functions of these, compiled from the text of ``maths``
globals().update(maths.CONSTANTS)
for _name, _f in maths.ELEMENTARY.items():
    globals()[_name] = plain(FunctionType(_f.__code__, globals(), _name))


# memory -------------------------------------------------------------------------------
@intrinsic
def at(ctx, p, o):
    """Return a pointer advanced by o words."""
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


as_u8, as_i8 = _cast(U8), _cast(I8)
f8_at, i8_at = _pointer(F8), _pointer(I8)


@intrinsic
def data(ctx, a):
    """Return a pointer to an array's first word."""
    return types.CPointer(a.dtype)(a), lambda c, b, s, v: c.make_array(s.args[0])(c, b, v[0]).data


@intrinsic
def array(ctx, p, n):
    """Return n words at a pointer as an array; ``carray`` compiles slower."""
    t = types.Array(p.dtype, 1, "C")

    def code(c, b, s, v):
        from numba.np.arrayobj import populate_array  # takes long to import

        a = c.make_array(t)(c, b)
        populate_array(a, v[0], [v[1]], [I64(8)], I64(8), None)
        return a._getvalue()

    return t(p, i8), code


@intrinsic
def move(ctx, to, source, n):
    """Copy n words."""

    def code(c, b, s, v):
        cgutils.raw_memcpy(b, v[0], v[1], v[2], 8)
        return c.get_dummy_value()

    return types.void(to, source, n), code


def _jump(c, b, s, v):
    """Emit a call of the function whose address precedes its arguments."""
    f = ir.FunctionType(ir.VoidType(), [x.type for x in v[1:]])
    b.call(b.inttoptr(v[0], ir.PointerType(f)), v[1:])
    return c.get_dummy_value()


@intrinsic
def call(ctx, address, P, S, W, A, n):
    """Call the segment at an address."""
    return types.void(address, P, S, W, A, n), _jump


@intrinsic
def run(ctx, address, c, x, y, n):
    """Call a program's entry at an address."""
    return types.void(address, c, x, y, n), _jump


@plain
def words(a):
    """Return a float64 array's memory as words."""
    return array(as_u8(data(a)), a.size)


def parts(c, b, t, v):
    """Return an array's first word as a pointer, and its size; anything else alone."""
    if not isinstance(t, types.Array):
        return (v,)
    a = c.make_array(t)(c, b, v)
    return a.data, b.extract_value(a.shape, 0)


@intrinsic
def copy(ctx, a, b):
    """Copy a into the start of b."""

    def code(c, b, s, v):
        (source, n), (to, _) = (parts(c, b, *one) for one in zip(s.args, v, strict=True))
        kernels.copy(b, to, source, n)
        return c.get_dummy_value()

    return types.void(a, b), code


@plain
def search(knots, x):
    """Return the index of the piece that contains a position."""
    low, high = 0, knots.size - 2
    while low < high:
        k = (low + high + 1) >> 1
        if x >= knots[k]:
            low = k
        else:
            high = k - 1
    return low


# long sums: kernels of the runtime ----------------------------------------------------
FIR = types.void(F8, i8, F8, F8, i8)  # taps, size, w, y, n
MODES = types.void(F8, F8, F8, i8, f8, F8, F8, F8, i8)  # p, r, q, size, d, x, w, y, n
# e, r, q, low, size, size of low, x, w, y, n
MEMORY = types.void(F8, F8, F8, F8, i8, i8, F8, F8, F8, i8)
CHEBYSHEV = types.void(F8, i8, F8, F8, i8, i8)  # c, terms, t, y, series, size of t


def _kernel(name, order):
    """Return code that calls a kernel with arguments, or their sizes, in an order."""

    def code(c, b, s, v):
        pairs = [parts(c, b, *one) for one in zip(s.args, v, strict=True)]
        given = [pairs[int(k[-1])][k.startswith("size")] for k in order.split()]
        t = ir.FunctionType(ir.VoidType(), [x.type for x in given])
        b.call(cgutils.get_or_insert_function(b.module, t, f"stimlib_{name}"), given)
        return c.get_dummy_value()

    return code


@intrinsic
def fir(ctx, taps, w, y):
    """Compute an FIR filter with the runtime's kernel."""
    return types.void(taps, w, y), _kernel("fir", "0 size0 1 2 size2")


@intrinsic
def modes(ctx, p, r, q, d, x, y, w):
    """Compute a bank of modes with the runtime's kernel."""
    return types.void(p, r, q, f8, x, y, w), _kernel("modes", "0 1 2 size0 3 4 6 5 size5")


BANK = "0 1 2 3 size0 size3 4 6 5 size5"


@intrinsic
def _steady(ctx, e, r, q, low, x, y, w):
    return types.void(e, r, q, low, x, y, w), _kernel("memory", BANK)


@intrinsic
def _moving(ctx, e, r, q, low, x, y, w):
    return types.void(e, r, q, low, x, y, w), _kernel("moving_memory", BANK)


@plain
def memory(e, r, q, low, x, y, w):
    """Compute a bank of slow modes, whose states have second words."""
    if r.size == e.size:
        _steady(e, r, q, low, x, y, w)
    else:
        _moving(e, r, q, low, x, y, w)


@intrinsic
def _series_at(ctx, c, terms, t, y, m):
    return types.void(c, i8, t, y, i8), _kernel("chebyshev", "0 1 2 3 4 size2")


@plain
def chebyshev(c, t, y):
    """Compute Chebyshev series with the runtime's kernel."""
    m = y.size // t.size
    _series_at(c, c.size // m, t, y, m)
