"""The loop over copies of a program that each of several threads runs.

Its text is compiled from the cache, as ``runtime``.
"""

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from stimlib.targets.numba.intrinsics import at, data, i8_at, run


@intrinsic
def take(ctx, p):
    """Return the number at p and add one to it, atomically."""
    return types.int64(p), lambda c, b, s, v: b.atomic_rmw(
        "add", v[0], ir.Constant(ir.IntType(64), 1), "monotonic"
    )


WRITE = types.Array(types.float64, 3, "C")
ARRAYS = WRITE, types.Array(types.float64, 3, "C", readonly=True)
I8S = types.int64[::1]


@njit([types.void(I8S, I8S, a, WRITE) for a in ARRAYS], cache=True, error_model="numpy", nogil=True)
def process(contexts, turn, x, y):
    """Run copies until none is left."""
    k = take(data(turn))
    while k < contexts.size:
        ctx = i8_at(contexts[k])
        rows = at(data(x), k % x.shape[0] * x.shape[1] * x.shape[2])
        run(ctx[16], ctx, rows, at(data(y), k * y.shape[1] * y.shape[2]), y.shape[2])
        k = take(data(turn))
