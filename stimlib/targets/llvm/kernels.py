"""The long sums as vector code: FIR taps and banks of modes.

They are compiled once, in the runtime; segments call them by name.

Every partial sum is kept apart as ``maths`` defines it: the bits do not depend on the
width of the processor's vectors.
"""

from __future__ import annotations

from llvmlite import ir

from stimlib.core.maths import TINY
from stimlib.targets.llvm.instructions import (
    DOUBLE,
    I64,
    V8,
    across,
    cases,
    copied,
    flush,
    known,
    load,
    loop,
    room,
    shuffle,
    splat,
    store,
    tree,
    variable,
    zeros,
)
from stimlib.targets.llvm.machine import FEATURES

# Groups of eight modes of each kind in one pass.  There is a loop for each number of
# groups, 35 of them: the runtime pays for that once per machine, segments do not.
MOST = 5


# Eight numbers ------------------------------------------------------------------------
def fold(b, vectors):
    """Emit ``across`` for eight vectors at once.

    Lane k of the result is that of vector k.
    """
    for apart in (4, 2, 1):
        # of a pair of vectors, one half of the lanes stays in place: x + apart, y
        stay = [lane if lane & apart == 0 else 8 + lane for lane in range(8)]
        cross = [lane + apart if lane & apart == 0 else 8 + lane - apart for lane in range(8)]
        both = [(vectors[lane], vectors[lane + apart]) for lane in range(apart)]
        vectors = [
            b.fadd(shuffle(b, one, other, stay), shuffle(b, one, other, cross))
            for one, other in both
        ]
    return vectors[0]


def move_tile(b, to, source, count):
    """Copy up to 64 numbers."""
    with b.if_else(b.icmp_signed("==", count, I64(64))) as (whole, part):
        with whole:
            for first in range(0, 64, 8):
                store(b, load(b, source, first), to, first)
        with part:
            copied(b, to, source, count)


def copy(b, to, source, count):
    """Emit a copy of n numbers; for some hundred, this is faster than memcpy."""
    last = b.sub(count, I64(8))
    with b.if_else(b.icmp_signed("<", count, I64(8))) as (few, many):
        with few, loop(b, I64(0), count, 1) as sample:
            b.store(b.load(b.gep(source, [sample])), b.gep(to, [sample]))
        with many:  # the last eight may overlap those before
            with loop(b, I64(0), last, 8) as sample:
                store(b, load(b, source, sample), to, sample)
            store(b, load(b, source, last), to, last)


def sound_tile(b, to, source):
    """Copy 64 numbers, and return whether all are finite."""
    # x - x is 0, or NaN where x is infinite or NaN; the eight truths are tested as one
    # byte
    sound = None
    for first in range(0, 64, 8):
        eight = load(b, source, first)
        store(b, eight, to, first)
        finite = b.fcmp_ordered("==", b.fsub(eight, eight), zeros(V8))
        sound = finite if sound is None else b.and_(sound, finite)
    return b.icmp_signed("==", b.bitcast(sound, ir.IntType(8)), ir.IntType(8)(-1))


# Taps ---------------------------------------------------------------------------------
VECTORS = (8, 4, 2, 1) if "+avx512f" in FEATURES else (4, 2, 1) if "+avx" in FEATURES else (2, 1)
"""Of outputs, that stay in registers: the most that leave room for the samples under
the taps.
"""


def _fir_at(b, wide, taps, size, signal, output, sums):
    """Compute 8 * wide outputs of an FIR filter.

    Taps j, j + 8, .. make partial sum j, and output r under tap m needs the samples r +
    m. So for each j the samples slide through the registers, and one load serves as
    many products.
    """
    pairs = b.and_(size, I64(-16))
    with loop(b, I64(0), I64(8), 1) as part:
        base, tap_0, out = (
            b.gep(signal, [part]),
            b.gep(taps, [part]),
            b.gep(sums, [b.mul(part, I64(8 * wide))]),
        )
        window = [variable(b, load(b, base, 8 * vector_at)) for vector_at in range(wide - 1)]
        totals = [variable(b, zeros(V8)) for _ in range(wide)]
        # two taps a turn: between tests, the units have work for twice as long
        for turn, start, stop in ((16, I64(0), pairs), (8, pairs, size)):
            with loop(b, start, stop, turn) as tap_at:
                loaded, partial = list(map(b.load, window)), list(map(b.load, totals))
                for ahead in range(0, turn, 8):
                    tap = splat(b, b.load(b.gep(tap_0, [b.add(tap_at, I64(ahead))])))
                    loaded.append(load(b, base, b.add(tap_at, I64(ahead + 8 * (wide - 1)))))
                    partial = [
                        known(b, "fma", tap, vector, old)
                        for vector, old in zip(loaded[-wide:], partial, strict=True)
                    ]
                for cell, vector in zip(
                    window + totals, loaded[-wide + 1 :] * (wide > 1) + partial, strict=True
                ):
                    b.store(vector, cell)
        for vector_at in range(wide):
            store(b, b.load(totals[vector_at]), out, 8 * vector_at)
    for vector_at in range(wide):
        store(
            b,
            tree(b, [load(b, sums, 8 * (wide * part + vector_at)) for part in range(8)]),
            output,
            8 * vector_at,
        )


def fir(b, taps, size, signal, output, count):
    """Compute maths.fir."""
    sums = room(b, DOUBLE, 64 * VECTORS[0])
    sums.align = 64  # else each vector lies across two lines of the cache
    done = variable(b, I64(0))
    with b.if_then(b.icmp_signed("==", size, I64(8))):  # one product in each partial sum
        each = [splat(b, b.load(b.gep(taps, [I64(tap)]))) for tap in range(8)]
        b.store(b.and_(count, I64(-8)), done)
        with loop(b, I64(0), b.load(done), 8) as sample:
            loaded = [load(b, signal, b.add(sample, I64(tap))) for tap in range(8)]
            partial = [known(b, "fma", *pair, zeros(V8)) for pair in zip(each, loaded, strict=True)]
            store(b, tree(b, partial), output, sample)
    # as many outputs at once as are left: the widest loop first, then narrower ones, at
    # last one output at a time, with its partial sums side by side
    for wide in VECTORS:
        start = b.load(done)
        stop = b.add(start, b.and_(b.sub(count, start), I64(-8 * wide)))
        with loop(b, start, stop, 8 * wide) as sample:
            _fir_at(b, wide, taps, size, b.gep(signal, [sample]), b.gep(output, [sample]), sums)
        b.store(stop, done)
    with loop(b, b.load(done), count, 1) as sample:  # the eight partial sums side by side
        partial = variable(b, zeros(V8))
        with loop(b, I64(0), size, 8) as first:
            b.store(
                known(
                    b,
                    "fma",
                    load(b, taps, first),
                    load(b, signal, b.add(sample, first)),
                    b.load(partial),
                ),
                partial,
            )
        b.store(across(b, b.load(partial)), b.gep(output, [sample]))


# Modes --------------------------------------------------------------------------------
def _pass(
    b, signal, sums_at, count, first, update, groups, weights_at, states, last=None, stride=None
):
    """Run groups of eight modes for count samples; their weighted sums in lanes.

    Their states stay in registers; the groups are independent, so that each runs during
    the latency of the others. The sums begin with 0 in the first pass, else with those
    at sums_at. They go there, or eight at a time to ``last``. With a stride, each
    sample has weights of its own, so many numbers further on.
    """
    held = [
        [variable(b, load(b, address, 8 * group)) for address in states(group)]
        for group in range(groups)
    ]
    weights = [load(b, weights_at, 8 * group) for group in range(groups)] if stride is None else []
    # the first pass reads eight zeros again and again: one loop serves both kinds of
    # passes
    nothing = variable(b, zeros(V8))
    source = b.select(first, b.bitcast(nothing, sums_at.type), sums_at)
    apart = b.select(first, I64(0), I64(8))
    drives = room(b, DOUBLE, 64)  # in memory, from where a splat costs nothing
    with loop(b, I64(0), count, 8) as i:
        store(b, b.fadd(load(b, signal, i), splat(b, ir.Constant(DOUBLE, TINY))), drives, i)

    def sample(index):
        drive = splat(b, b.load(b.gep(drives, [index])))
        totals = load(b, source, b.mul(index, apart))
        for group in range(groups):
            new = update(group, drive, *map(b.load, held[group]))
            for address, vector in zip(held[group], new, strict=True):
                b.store(vector, address)
            weight = (
                weights[group]
                if weights
                else load(b, weights_at, b.add(b.mul(index, stride), I64(8 * group)))
            )
            totals = known(b, "fma", weight, new[0], totals)
        if last is None:
            store(b, totals, sums_at, b.mul(index, I64(8)))
        return totals

    # eight samples a turn where the sums are added up: fold takes 7 additions for eight
    # samples, across 3 for each
    turn = 1 if last is None else 8
    whole = b.and_(count, I64(-turn))
    with loop(b, I64(0), whole, turn) as i:
        sums = [sample(b.add(i, I64(ahead))) for ahead in range(turn)]
        if last is not None:
            last(sums, i)
    if last is not None:
        with loop(b, whole, count, 1) as i:
            last([sample(i)], i)
    for group in range(groups):
        for address, vector in zip(states(group), held[group], strict=True):
            store(b, b.load(vector), address, 8 * group)


def _finish(b, sums, index, output, direct=None):
    """Emit flush(tree(sums)) as an output, for one sample or eight.

    direct: gain and signal of what goes straight from the input to the output.
    """
    one = len(sums) == 1
    value = across(b, sums[0]) if one else fold(b, sums)
    if direct:
        gain, signal = direct
        value = known(
            b,
            "fma",
            *(
                (gain, b.load(b.gep(signal, [index])))
                if one
                else (splat(b, gain), load(b, signal, index))
            ),
            value,
        )
    b.store(flush(b, value), b.gep(output, [index])) if one else store(
        b, flush(b, value), output, index
    )


def poles(
    b, poles_at, weights_at, states_at, gain, signal, sums_at, output, samples, groups, first, last
):
    """Run 1 to 4 groups of modes, q = fma(p, q, x + TINY), and add up their sums.

    They begin with those at sums_at but for the first groups, and end there but for the
    last: of those, whose number is known only when it runs, the output gets the total.
    """

    def body(count):
        pole = [load(b, poles_at, 8 * group) for group in range(count)]

        def update(group, drive, old):
            return [known(b, "fma", pole[group], old, drive)]

        def total(sums, index):
            _finish(b, sums, index, output, (gain, signal))

        # passes before the last leave their sums in lanes, for the next to go on with
        _pass(
            b,
            signal,
            sums_at,
            samples,
            first,
            update,
            count,
            weights_at,
            lambda group: [states_at],
            total if last else None,
        )

    cases(b, groups, {number: number for number in (range(1, 5) if last else [4])}, body)


def eight_modes(b, poles_at, weights_at, states_at, gain, signal, output):
    """Emit maths.modes of eight modes for 64 samples, in straight-line code."""
    pole, weight, state = load(b, poles_at), load(b, weights_at), load(b, states_at)
    for first in range(0, 64, 8):
        sums = []
        for sample in range(first, first + 8):
            drive = b.fadd(b.load(b.gep(signal, [I64(sample)])), ir.Constant(DOUBLE, TINY))
            state = known(b, "fma", pole, state, splat(b, drive))
            sums.append(known(b, "fma", weight, state, zeros(V8)))
        _finish(b, sums, I64(first), output, (gain, signal))
    store(b, state, states_at)


def leaks(
    b,
    leaks_at,
    weights_at,
    states_at,
    low,
    signal,
    sums_at,
    count,
    fine,
    coarse,
    first,
    stride,
    moving,
):
    """Run groups of slow modes, q += (x + TINY) - e q.

    Up to MOST groups have a second word, and up to MOST have none; with moving weights,
    all are of one kind.
    """
    every = [
        (lows, others) for lows in range(MOST + 1) for others in range(MOST + 1) if lows + others
    ]
    kinds = [(lows, others) for lows, others in every if not moving or lows == 0 or others == 0]

    def body(both):
        with_low, groups = both
        minus = [b.fneg(load(b, leaks_at, 8 * group)) for group in range(groups)]

        def update(group, drive, old, rest=None):
            step = known(b, "fma", minus[group], old, drive)
            if rest is None:
                return [b.fadd(old, step)]
            # what the state cannot hold of the change goes into its second word
            change = b.fadd(step, rest)
            new = b.fadd(old, change)
            return [new, b.fsub(change, b.fsub(new, old))]

        def states(group):
            return [states_at, low] if group < with_low else [states_at]

        own = stride if moving else None
        _pass(b, signal, sums_at, count, first, update, groups, weights_at, states, stride=own)

    number = b.add(b.mul(fine, I64(MOST + 1)), coarse)
    cases(
        b,
        number,
        {(MOST + 1) * lows + others: (lows, lows + others) for lows, others in kinds},
        body,
    )


def total(b, sums_at, output, count):
    """Compute flush(tree(sums)) of each sample."""
    whole = b.and_(count, I64(-8))
    for turn, start, stop in ((8, I64(0), whole), (1, whole, count)):
        with loop(b, start, stop, turn) as index:
            base = b.gep(sums_at, [b.mul(index, I64(8))])
            _finish(b, [load(b, base, 8 * ahead) for ahead in range(turn)], index, output)


def chebyshev(b, coefficients, terms, numbers, values, series, size):
    """Compute maths.chebyshev: series of each of some numbers.

    Four numbers take turns while each waits for its last term.
    """
    whole = b.and_(size, I64(-4))

    def turns(count, start, stop):
        with loop(b, start, stop, count) as first, loop(b, I64(0), series, 8) as column:
            factors = [
                splat(b, b.load(b.gep(numbers, [b.add(first, I64(ahead))])))
                for ahead in range(count)
            ]
            twice = [b.fadd(factor, factor) for factor in factors]
            last, before = ([variable(b, zeros(V8)) for _ in factors] for _ in range(2))
            # from the last term to the first: the recurrence is Clenshaw's
            term_at = variable(b, b.add(column, b.mul(series, terms)))

            def term(factors):
                b.store(b.sub(b.load(term_at), series), term_at)
                row = load(b, coefficients, b.load(term_at))
                for factor, last_at, before_at in zip(factors, last, before, strict=True):
                    now = known(b, "fma", factor, b.load(last_at), b.fsub(row, b.load(before_at)))
                    b.store(b.load(last_at), before_at)
                    b.store(now, last_at)

            with loop(b, I64(1), terms, 1):
                term(twice)
            term(factors)
            for ahead, last_at in enumerate(last):
                store(
                    b,
                    b.load(last_at),
                    values,
                    b.add(column, b.mul(series, b.add(first, I64(ahead)))),
                )

    turns(4, I64(0), whole)
    turns(1, whole, size)
