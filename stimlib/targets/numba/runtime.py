"""The one fixed loop that walks a program's table.  Its text is compiled from the cache, named by content, like a segment's."""

from numba import cfunc, njit, types

from stimlib.targets.numba.native import F8, I8, address, as_i8, at, call, data, f8_at, i8_at, move, run

# ctx: 0 rows, 1 &table, 2 &P, 3 &S, 4 &W, 5 &A, 6 inputs, 7 outputs, 8 place of the outputs' slots in A, 9 &N, 10 &index,
#      11 clocks, 12 warm clock or -1, 13 &pending, 14 params, 15 samples seen
# row: address or opcode, P, S, A, clock, autonomous
OPEN, CLOSE, GATHER, RESETTABLE = 1, 2, 3, 4


@njit(error_model="numpy", inline="always")
def open_clock(W, w, up, root, down, N, k):  # w = (slot of by, child)
    by = at(W, w[0])
    n = 0
    for i in range(k):
        n += by[i] > 0.0
    N[w[1]] = n
    if n > 0:
        n = 0
        for i in range(k):
            if by[i] > 0.0:
                down[n] = i  # place in the parent's tile
                down[64 + n] = i if root else up[i]  # place in the root's tile
                n += 1


@njit(error_model="numpy", inline="always")
def stretches(P, S, W, w, k):  # w = (contact, output, state at rest in P, its words, segment, the segment's own ..)
    by, y, cold = at(W, w[0]), at(W, w[1]), at(S, w[3] - 1)
    start, n = 0, 0
    for i in range(k):
        n += by[i] > 0.0
    for i in range(k - 1 if n == 0 or n == k else 0, k):
        on = by[i] > 0.0
        if i + 1 == k or on != (by[i + 1] > 0.0):
            if on:
                call(w[4], P, S, at(W, start), at(w, 5), i + 1 - start)
            else:
                for j in range(start, i + 1):
                    y[j] = 0.0
                if cold[0] == 0.0:
                    move(S, at(P, w[2]), w[3])
            start = i + 1


@cfunc(types.void(I8, F8, F8, types.int64), cache=True, error_model="numpy")
def entry(ctx, x, y, n):
    rows, table, P, S, W, A = ctx[0], i8_at(ctx[1]), f8_at(ctx[2]), f8_at(ctx[3]), f8_at(ctx[4]), i8_at(ctx[5])
    n_in, n_out, outs, N, index, clocks, warm = ctx[6], ctx[7], at(A, ctx[8]), i8_at(ctx[9]), i8_at(ctx[10]), ctx[11], ctx[12]
    pending = i8_at(ctx[13])
    for j in range(ctx[14]):  # parameters: read once per call
        q = at(pending, 4 * j)
        if q[0] != 0:
            s = as_i8(at(S, q[1]))
            s[1], s[2] = q[2], q[3]
            q[0] = 0
    for start in range(0, n, 64):
        m = min(64, n - start)
        for c in range(clocks):
            N[c] = 0
        N[0] = m
        if warm < 0:
            N[1] = m
            for j in range(n_in):
                move(at(W, 64 * j), at(x, j * n + start), m)
        else:
            N[warm] = m
            for i in range(m):
                index[warm * 128 + 64 + i] = i
        for r in range(rows):
            q = at(table, 6 * r)
            c = q[4]
            k = N[c]
            if k == 0 or (warm >= 0 and q[5] == 0):
                continue
            w = at(A, q[3])
            if q[0] > 16:
                call(q[0], at(P, q[1]), at(S, q[2]), W, w, k)
            elif q[0] == RESETTABLE:
                stretches(at(P, q[1]), at(S, q[2]), W, w, k)
            elif q[0] == OPEN:
                open_clock(W, w, at(index, c * 128 + 64), c == 1, at(index, w[1] * 128), N, k)
            elif q[0] == CLOSE:  # w = (inner, out, child)
                inner, out, place = at(W, w[0]), at(W, w[1]), at(index, w[2] * 128)
                if N[w[2]] == k:
                    move(out, inner, k)
                else:
                    for i in range(k):
                        out[i] = 0.0
                    for i in range(N[w[2]]):
                        out[place[i]] = inner[i]
            else:  # GATHER a parameter onto a child clock: w = (from, to)
                source, to, place = at(W, w[0]), at(W, w[1]), at(index, c * 128 + 64)
                for i in range(k):
                    to[i] = source[place[i]]
        if warm < 0:
            for j in range(n_out):
                move(at(y, j * n + start), at(W, outs[j]), m)
    if warm < 0:
        ctx[15] += n


ARRAYS = types.Array(types.float64, 2, "C"), types.Array(types.float64, 2, "C", readonly=True)


@njit([types.int64(types.int64[::1], a, ARRAYS[0]) for a in ARRAYS], cache=True, nogil=True, error_model="numpy")
def process(ctx, x, y):
    if x.shape[0] != ctx[6] or y.shape[0] != ctx[7] or x.shape[1] != y.shape[1]:
        return 1
    apart = address(data(y)) - address(data(x))
    if -8 * y.size < apart < 8 * x.size and apart % (8 * x.shape[1]) != 0:
        return 1  # a sample would be written before it is read; whole rows are read first
    run(ctx[16], data(ctx), data(x), data(y), y.shape[1])
    return 0
