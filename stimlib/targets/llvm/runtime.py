"""The loop that runs a program's table, and the long sums of segments.

Its text is compiled once and kept in the cache, named by content, like a segment's.
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
def fir(taps, size, signal, output, count):
    """Compute an FIR filter."""
    _fir(taps, size, signal, output, count)


@exported("void", *MODES)
def modes(poles, weights, states, size, direct, signal, sums, output, count):
    """Compute a bank of modes."""
    # in passes of four groups of eight, which hide each other's latency; the last of
    # one to four
    for first in range(0, size - 32, 32):
        _poles(
            at(poles, first),
            at(weights, first),
            at(states, first),
            direct,
            signal,
            sums,
            output,
            count,
            4,
            first == 0,
        )
    first = ((size - 1) >> 5) << 5
    _last_poles(
        at(poles, first),
        at(weights, first),
        at(states, first),
        direct,
        signal,
        sums,
        output,
        count,
        (size - first) >> 3,
        first == 0,
    )


def open_clock(buffers, words, every, up, down, counts, size):  # words: (slot of by, child)
    """Gather the samples at which a gate is open.

    down gets their places in the parent's tile, and behind these in the root's.
    """
    gate = at(buffers, words[0])
    # counted first: a gate is mostly open or shut for a whole tile, which takes no
    # gathering
    found = 0
    for sample in range(size):
        found += gate[sample] > 0.0
    counts[words[1]] = found
    if found == size:
        move(down, every, size)
        move(at(down, 64), up, size)
    elif found > 0:
        found = 0
        for sample in range(size):
            if gate[sample] > 0.0:
                down[found], down[64 + found] = sample, up[sample]
                found += 1


def standing(states, pending, params):
    """Return whether no parameter is being ramped."""
    for number in range(params):
        if at(states, at(pending, 8 * number)[1])[2] > 0.0:  # see parameter.ParamState
            return False
    return True


def guard(row, numbers, states, buffers, slots, to, count):
    """Write an output; its guard runs here, unless a row reads what it makes (row[7]).

    A whole tile of finite samples of an output that does not fade is only copied;
    otherwise the guard's segment runs.
    """
    words, state = at(slots, row[3]), at(states, row[2])
    # With its segment for each tile, a scene that copies its input took 0.41 ns a
    # sample instead of 0.29. The state is that of guard.GuardState.
    if count == 64 and row[7] == 0 and state[1] < 0.0 and _sound_tile(to, at(buffers, words[0])):
        state[0], as_i8(state)[2] = at(buffers, words[0])[63], as_i8(state)[2] + 64
    else:
        if row[7] == 0:
            call(row[0], at(numbers, row[1]), state, buffers, words, count)
        move_tile(to, at(buffers, words[1]), count)


@exported("void", "i8*", "f8*", "f8*", "i8")
def entry(ctx, motion, output, samples):
    """Run a program's table for n samples."""
    rows, table, numbers, states, buffers, slots = (
        ctx[0],
        i8_at(ctx[1]),
        f8_at(ctx[2]),
        f8_at(ctx[3]),
        f8_at(ctx[4]),
        i8_at(ctx[5]),
    )
    n_in, n_out, output_rows, counts, index, clocks, warm = (
        ctx[6],
        ctx[7],
        at(slots, ctx[8]),
        i8_at(ctx[9]),
        i8_at(ctx[10]),
        ctx[11],
        ctx[12],
    )
    every, pending = at(index, 128 + 64), i8_at(ctx[13])  # places of the root's samples
    # settings that wait: what another thread sets now acts from the next call on
    for number in range(ctx[14]):
        row = at(pending, 8 * number)
        if row[0] != 0:
            state = as_i8(at(states, row[1]))
            state[1], state[2] = row[2], row[3]
            if row[0] == 2:
                state[0] = row[4]
            row[0] = 0
            ctx[17] = 0
    # tile by tile, and within a tile row by row: one call of a segment serves 64
    # samples, and what a row has written is still in the cache when the next reads it
    for start in range(0, samples, 64):
        size = 64 if samples - start > 64 else samples - start
        for clock in range(clocks):
            counts[clock] = 0
        counts[0] = size
        if warm < 0:
            counts[1] = size
            for number in range(n_in):
                move_tile(at(buffers, 64 * number), at(motion, number * samples + start), size)
        else:
            for number in range(warm):
                clock = i8_at(ctx[20])[number]
                counts[clock] = size
                move(at(index, clock * 128 + 64), every, size)
        # turn 0 runs rows that are one number as long as no parameter moves, once and
        # for whole tiles; after that only a setting makes them run again. While a
        # parameter is on its way they run like others, in turn 1.
        for turn in range(1 if ctx[17] != 0 or not standing(states, pending, ctx[14]) else 0, 2):
            for place in range(rows):
                row = at(table, 8 * place)  # its words: see rows.py
                clock = row[4]
                count = counts[clock] if turn == 1 else 64
                if turn == 0:
                    if row[6] == 0:
                        continue
                elif count == 0 or (warm >= 0 and row[5] == 0) or (row[6] != 0 and ctx[17] != 0):
                    continue
                words = at(slots, row[3])
                # one word tells all kinds apart: addresses are above all codes
                if row[0] >= SEGMENT:
                    call(row[0], at(numbers, row[1]), at(states, row[2]), buffers, words, count)
                elif row[0] >= OPERATION:
                    _operation(row[0] - OPERATION, buffers, words, count)
                elif row[0] == OPEN:
                    open_clock(
                        buffers,
                        words,
                        every,
                        at(index, clock * 128 + 64),
                        at(index, words[1] * 128),
                        counts,
                        count,
                    )
                elif row[0] == CLOSE:  # words: (inner, out, child)
                    inner, out, places = (
                        at(buffers, words[0]),
                        at(buffers, words[1]),
                        at(index, words[2] * 128),
                    )
                    if counts[words[2]] == count:
                        move_tile(out, inner, count)
                    else:
                        for sample in range(count):
                            out[sample] = 0.0
                        for sample in range(counts[words[2]]):
                            out[places[sample]] = inner[sample]
                else:  # GATHER a parameter onto a child clock: w = (from, to)
                    source, to, places = (
                        at(buffers, words[0]),
                        at(buffers, words[1]),
                        at(index, clock * 128 + 64),
                    )
                    for sample in range(count):
                        to[sample] = source[places[sample]]
            if turn == 0:
                ctx[17] = 1
        if warm < 0:
            for number in range(n_out):
                guard(
                    at(table, 8 * output_rows[number]),
                    numbers,
                    states,
                    buffers,
                    slots,
                    at(output, number * samples + start),
                    size,
                )
    if warm < 0:
        ctx[15] += samples


# of Python; an array has the words 1 type, 2 &data, 3 axes (an int), 4 &shape, 7 &type
# of numbers, 8 flags (an int): see entry_points
READ, WRITE = (
    C_ORDER | ALIGNED,
    C_ORDER | ALIGNED | WRITEABLE,
)
number = Outer("PyLong_FromLongLong", "i8", ("i8",))
value = Outer("PyLong_AsLongLong", "i8", ("i8",))


def fits(array, flags, ctx):
    """Return whether an object is an array of float64 with two axes and these flags."""
    # nothing is remembered about an array: it may have changed since its last call
    return (
        array[1] == ctx[18]
        and array[3] & 0xFFFFFFFF == 2
        and array[8] & flags == flags
        and i8_at(array[7])[3] & NUMBERS == ctx[19]
    )


@exported("i8", "i8", "i8*", "i8")
def process(me, args, count):
    """Run a program, as a METH_FASTCALL function of (x, out).

    The address of the program's context is the number ``me``.
    """
    ctx = i8_at(value(me))
    if count != 2:
        return number(1)
    motion, output = i8_at(args[0]), i8_at(args[1])
    if not fits(motion, READ, ctx) or not fits(output, WRITE, ctx):
        return number(1)
    inputs, outputs, samples = i8_at(motion[4])[0], i8_at(output[4])[0], i8_at(output[4])[1]
    if inputs != ctx[6] or outputs != ctx[7] or i8_at(motion[4])[1] != samples:
        return number(1)
    if (
        inputs > 0
        and -8 * outputs * samples < output[2] - motion[2] < 8 * inputs * samples
        and (output[2] - motion[2]) % (8 * samples) != 0
    ):
        # a sample would be written before it is read. Within a tile all inputs are read
        # before an output is written, so an output may lie on a row of the inputs.
        return number(1)
    run(
        ctx[16], ctx, f8_at(motion[2]), f8_at(output[2]), samples
    )  # Python's lock is faster kept than given away
    return number(0)
