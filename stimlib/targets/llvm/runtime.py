"""The loop that runs a program's table, and the long sums of segments.

Its text is compiled once and kept in the cache, named by content, like a segment's.
"""

from functools import partial

from stimlib.targets.llvm import kernels, rows, vectors
from stimlib.targets.llvm.enabled import open_clock
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
from stimlib.targets.llvm.values import Outer, exported

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


def standing(states, pending, params):
    """Return whether no parameter is being ramped."""
    for number in range(params):
        # the state is that of parameter.ParamState
        if at(states, at(pending, rows.SETTING_WORDS * number)[rows.PARAM_STATE])[2] > 0.0:
            return False
    return True


def guard(row, numbers, states, buffers, operands, to, count):
    """Write an output; its guard runs here, unless a row reads what it makes.

    A whole tile of finite samples of an output that does not fade is only copied;
    otherwise the guard's segment runs.
    """
    own, state = at(operands, row[rows.OPERANDS_AT]), at(states, row[rows.STATE_AT])
    # With its segment for each tile, a scene that copies its input took 0.41 ns a
    # sample instead of 0.29. The state is that of guard.GuardState.
    if (
        count == 64
        and row[rows.READ] == 0
        and state[1] < 0.0
        and _sound_tile(to, at(buffers, own[0]))
    ):
        state[0], as_i8(state)[2] = at(buffers, own[0])[63], as_i8(state)[2] + 64
    else:
        if row[rows.READ] == 0:
            call(row[rows.CODE], at(numbers, row[rows.NUMBERS_AT]), state, buffers, own, count)
        move_tile(to, at(buffers, own[1]), count)


@exported("void", "i8*", "f8*", "f8*", "i8")
def entry(ctx, motion, output, samples):
    """Run a program's table for n samples."""
    row_count, table, numbers, states, buffers, operands = (
        ctx[rows.ROWS],
        i8_at(ctx[rows.TABLE]),
        f8_at(ctx[rows.NUMBERS]),
        f8_at(ctx[rows.STATES]),
        f8_at(ctx[rows.BUFFERS]),
        i8_at(ctx[rows.OPERANDS]),
    )
    n_in, n_out, output_rows, counts, ticks, clocks, warm = (
        ctx[rows.INPUTS],
        ctx[rows.OUTPUTS],
        at(operands, ctx[rows.OUTPUT_ROWS]),
        i8_at(ctx[rows.COUNTS]),
        i8_at(ctx[rows.TICKS]),
        ctx[rows.CLOCKS],
        ctx[rows.WARM],
    )
    # of each clock 64 ticks in its parent's tile and 64 in the root's; the root's own
    # are all samples
    every, pending = at(ticks, 128 + 64), i8_at(ctx[rows.PENDING])
    # settings that wait: what another thread sets now acts from the next call on
    for number in range(ctx[rows.PARAMS]):
        row = at(pending, rows.SETTING_WORDS * number)
        if row[rows.WAITS] != 0:
            state = as_i8(at(states, row[rows.PARAM_STATE]))
            state[1], state[2] = row[rows.TARGET], row[rows.LEFT]
            if row[rows.WAITS] == 2:
                state[0] = row[rows.Y]
            row[rows.WAITS] = 0
            ctx[rows.STILL_DONE] = 0
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
                clock = i8_at(ctx[rows.WARM_CLOCKS])[number]
                counts[clock] = size
                move(at(ticks, clock * 128 + 64), every, size)
        # turn 0 runs rows that are one number as long as no parameter moves, once and
        # for whole tiles; after that only a setting makes them run again. While a
        # parameter is on its way they run like others, in turn 1.
        for turn in range(
            1
            if ctx[rows.STILL_DONE] != 0 or not standing(states, pending, ctx[rows.PARAMS])
            else 0,
            2,
        ):
            for index in range(row_count):
                row = at(table, rows.ROW_WORDS * index)
                clock = row[rows.CLOCK]
                count = counts[clock] if turn == 1 else 64
                if turn == 0:
                    if row[rows.STILL] == 0:
                        continue
                # count 0: its clock has no sample in this tile. Nothing behind a gate
                # that is shut runs, and its states stay.
                elif (
                    count == 0
                    or (warm >= 0 and row[rows.AUTONOMOUS] == 0)
                    or (row[rows.STILL] != 0 and ctx[rows.STILL_DONE] != 0)
                ):
                    continue
                own = at(operands, row[rows.OPERANDS_AT])
                if row[rows.CODE] >= rows.SEGMENT:
                    call(
                        row[rows.CODE],
                        at(numbers, row[rows.NUMBERS_AT]),
                        at(states, row[rows.STATE_AT]),
                        buffers,
                        own,
                        count,
                    )
                elif row[rows.CODE] >= rows.OPERATION:
                    _operation(row[rows.CODE] - rows.OPERATION, buffers, own, count)
                elif row[rows.CODE] == rows.OPEN:
                    open_clock(
                        buffers,
                        own,
                        every,
                        at(ticks, clock * 128 + 64),
                        at(ticks, own[1] * 128),
                        counts,
                        count,
                    )
                elif row[rows.CODE] == rows.CLOSE:  # operands: (inner, out, child)
                    inner, out, ticked = (
                        at(buffers, own[0]),
                        at(buffers, own[1]),
                        at(ticks, own[2] * 128),
                    )
                    if counts[own[2]] == count:
                        move_tile(out, inner, count)
                    else:
                        for sample in range(count):
                            out[sample] = 0.0
                        for sample in range(counts[own[2]]):
                            out[ticked[sample]] = inner[sample]
                else:  # GATHER a parameter onto a child clock; operands: (from, to)
                    source, to, ticked = (
                        at(buffers, own[0]),
                        at(buffers, own[1]),
                        at(ticks, clock * 128 + 64),
                    )
                    for sample in range(count):
                        to[sample] = source[ticked[sample]]
            if turn == 0:
                ctx[rows.STILL_DONE] = 1
        if warm < 0:
            for number in range(n_out):
                guard(
                    at(table, rows.ROW_WORDS * output_rows[number]),
                    numbers,
                    states,
                    buffers,
                    operands,
                    at(output, number * samples + start),
                    size,
                )
    if warm < 0:
        ctx[rows.SEEN] += samples


# of Python; an array has the words 1 type, 2 &data, 3 axes (an int), 4 &shape, 7 &type
# of numbers, 8 flags (an int): see entry_points
READ, WRITE = (
    rows.C_ORDER | rows.ALIGNED,
    rows.C_ORDER | rows.ALIGNED | rows.WRITEABLE,
)
number = Outer("PyLong_FromLongLong", "i8", ("i8",))
value = Outer("PyLong_AsLongLong", "i8", ("i8",))


def fits(array, flags, ctx):
    """Return whether an object is an array of float64 with two axes and these flags."""
    # nothing is remembered about an array: it may have changed since its last call
    return (
        array[1] == ctx[rows.ARRAY_TYPE]
        and array[3] & 0xFFFFFFFF == 2
        and array[8] & flags == flags
        and i8_at(array[7])[3] & rows.DTYPE_BITS == ctx[rows.FLOAT64]
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
    if inputs != ctx[rows.INPUTS] or outputs != ctx[rows.OUTPUTS] or i8_at(motion[4])[1] != samples:
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
        ctx[rows.ENTRY], ctx, f8_at(motion[2]), f8_at(output[2]), samples
    )  # Python's lock is faster kept than given away
    return number(0)
