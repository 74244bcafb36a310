"""The loop that runs a program's table, and the long sums of segments.

Its text is compiled from the cache, named by content, like a segment's.
"""

from functools import partial

from stimlib.targets.llvm import kernels, vectors
from stimlib.targets.llvm.known import (
    FIR,
    MODES,
    as_i8,
    at,
    call,
    f8_at,
    i8_at,
    move,
    of,
    run,
)
from stimlib.targets.llvm.rows import (
    ALIGNED,
    C_ORDER,
    CLOSE,
    NUMBERS,
    OPEN,
    OPERATION,
    SEGMENT,
    WRITEABLE,
)
from stimlib.targets.llvm.values import Outer, exported

# ctx: 0 rows before those of outputs, 1 &table, 2 &P, 3 &S, 4 &W, 5 &A, 6 inputs, 7
# outputs, 8 place in A of the numbers of the outputs' rows, 9 &N, 10 &index,
# 11 clocks, 12 number of warm clocks or -1, 13 &pending, 14 params, 15 samples seen, 16
# &entry, 17 whether still rows have been run,
#      18 numpy's array, 19 what tells float64, 20 &warm clocks
# pending, 8 words: whether it waits (1, or 2: y is set too), place, target, left, y;
# a ramp set after a jump at the same sample begins where the jump ends
move_tile, _sound_tile = of(kernels.move_tile), of(kernels.sound_tile)
_operation = of(vectors.operation)
_fir = of(kernels.fir)
_poles, _last_poles = (of(partial(kernels.poles, last=last)) for last in (False, True))


@exported("void", *FIR)
def fir(taps, size, w, y, n):
    """Compute an FIR filter."""
    _fir(taps, size, w, y, n)


@exported("void", *MODES)
def modes(p, r, q, size, d, x, w, y, n):
    """Compute a bank of modes."""
    for k in range(0, size - 32, 32):
        _poles(at(p, k), at(r, k), at(q, k), d, x, w, y, n, 4, k == 0)
    k = ((size - 1) >> 5) << 5
    _last_poles(at(p, k), at(r, k), at(q, k), d, x, w, y, n, (size - k) >> 3, k == 0)


def open_clock(W, w, every, up, down, N, k):  # w = (slot of by, child)
    """Gather the samples at which a gate is open.

    down gets their places in the parent's tile, and behind these in the root's.
    """
    by = at(W, w[0])
    n = 0
    for i in range(k):
        n += by[i] > 0.0
    N[w[1]] = n
    if n == k:
        move(down, every, k)
        move(at(down, 64), up, k)
    elif n > 0:
        n = 0
        for i in range(k):
            if by[i] > 0.0:
                down[n], down[64 + n] = i, up[i]
                n += 1


def standing(S, pending, params):
    """Return whether no parameter is being ramped."""
    for j in range(params):
        if at(S, at(pending, 8 * j)[1])[2] > 0.0:  # see parameter.ParamState
            return False
    return True


def guard(q, P, S, W, A, to, n):
    """Write an output, which a guard checks while it is copied.

    The guard's segment runs where a sample is not finite, where the output fades, and
    where there is less than a tile.
    """
    w, s = at(A, q[3]), at(S, q[2])
    # see guard.GuardState
    if n == 64 and q[7] == 0 and s[1] < 0.0 and _sound_tile(to, at(W, w[0])):
        s[0], as_i8(s)[2] = at(W, w[0])[63], as_i8(s)[2] + 64
    else:
        if q[7] == 0:
            call(q[0], at(P, q[1]), s, W, w, n)
        move_tile(to, at(W, w[1]), n)


@exported("void", "i8*", "f8*", "f8*", "i8")
def entry(ctx, x, y, n):
    """Run a program's table for n samples."""
    rows, table, P, S, W, A = (
        ctx[0],
        i8_at(ctx[1]),
        f8_at(ctx[2]),
        f8_at(ctx[3]),
        f8_at(ctx[4]),
        i8_at(ctx[5]),
    )
    n_in, n_out, outs, N, index, clocks, warm = (
        ctx[6],
        ctx[7],
        at(A, ctx[8]),
        i8_at(ctx[9]),
        i8_at(ctx[10]),
        ctx[11],
        ctx[12],
    )
    every, pending = at(index, 128 + 64), i8_at(ctx[13])  # places of the root's samples
    for j in range(ctx[14]):  # parameters: read once per call
        q = at(pending, 8 * j)
        if q[0] != 0:
            s = as_i8(at(S, q[1]))
            s[1], s[2] = q[2], q[3]
            if q[0] == 2:
                s[0] = q[4]
            q[0] = 0
            ctx[17] = 0
    for start in range(0, n, 64):
        m = 64 if n - start > 64 else n - start
        for c in range(clocks):
            N[c] = 0
        N[0] = m
        if warm < 0:
            N[1] = m
            for j in range(n_in):
                move_tile(at(W, 64 * j), at(x, j * n + start), m)
        else:
            for j in range(warm):
                c = i8_at(ctx[20])[j]
                N[c] = m
                move(at(index, c * 128 + 64), every, m)
        # 0: still rows, for good
        for turn in range(1 if ctx[17] != 0 or not standing(S, pending, ctx[14]) else 0, 2):
            for r in range(rows):
                q = at(table, 8 * r)
                c = q[4]
                k = N[c] if turn == 1 else 64
                if turn == 0:
                    if q[6] == 0:
                        continue
                elif k == 0 or (warm >= 0 and q[5] == 0) or (q[6] != 0 and ctx[17] != 0):
                    continue
                w = at(A, q[3])
                if q[0] >= SEGMENT:
                    call(q[0], at(P, q[1]), at(S, q[2]), W, w, k)
                elif q[0] >= OPERATION:
                    _operation(q[0] - OPERATION, W, w, k)
                elif q[0] == OPEN:
                    open_clock(W, w, every, at(index, c * 128 + 64), at(index, w[1] * 128), N, k)
                elif q[0] == CLOSE:  # w = (inner, out, child)
                    inner, out, place = at(W, w[0]), at(W, w[1]), at(index, w[2] * 128)
                    if N[w[2]] == k:
                        move_tile(out, inner, k)
                    else:
                        for i in range(k):
                            out[i] = 0.0
                        for i in range(N[w[2]]):
                            out[place[i]] = inner[i]
                else:  # GATHER a parameter onto a child clock: w = (from, to)
                    source, to, place = at(W, w[0]), at(W, w[1]), at(index, c * 128 + 64)
                    for i in range(k):
                        to[i] = source[place[i]]
            if turn == 0:
                ctx[17] = 1
        if warm < 0:
            for j in range(n_out):
                guard(at(table, 8 * outs[j]), P, S, W, A, at(y, j * n + start), m)
    if warm < 0:
        ctx[15] += n


# of Python; an array has the words 1 type, 2 &data, 3 axes (an int), 4 &shape, 7 &type
# of numbers, 8 flags (an int): see calls
READ, WRITE = (
    C_ORDER | ALIGNED,
    C_ORDER | ALIGNED | WRITEABLE,
)
number = Outer("PyLong_FromLongLong", "i8", ("i8",))
value = Outer("PyLong_AsLongLong", "i8", ("i8",))


def fits(a, flags, ctx):
    """Return whether an object is an array of float64 with two axes and these flags."""
    return (
        a[1] == ctx[18]
        and a[3] & 0xFFFFFFFF == 2
        and a[8] & flags == flags
        and i8_at(a[7])[3] & NUMBERS == ctx[19]
    )


@exported("i8", "i8", "i8*", "i8")
def process(me, args, count):
    """Run a program, as a METH_FASTCALL function of (x, out).

    The address of the program's context is the number ``me``.
    """
    ctx = i8_at(value(me))
    if count != 2:
        return number(1)
    x, y = i8_at(args[0]), i8_at(args[1])
    if not fits(x, READ, ctx) or not fits(y, WRITE, ctx):
        return number(1)
    n_x, n_y, n = i8_at(x[4])[0], i8_at(y[4])[0], i8_at(y[4])[1]
    if n_x != ctx[6] or n_y != ctx[7] or i8_at(x[4])[1] != n:
        return number(1)
    if n_x > 0 and -8 * n_y * n < y[2] - x[2] < 8 * n_x * n and (y[2] - x[2]) % (8 * n) != 0:
        # a sample would be written before it is read; whole rows are read first, and no
        # rows may lie anywhere
        return number(1)
    run(ctx[16], ctx, f8_at(x[2]), f8_at(y[2]), n)  # Python's lock is faster kept than given away
    return number(0)
