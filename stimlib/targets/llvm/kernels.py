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

MOST = 5  # groups of eight modes of each kind in one pass


# Eight numbers ------------------------------------------------------------------------
def fold(b, v):
    """Emit ``across`` for eight vectors at once.

    Lane k of the result is that of vector k.
    """
    for apart in (4, 2, 1):
        # of a pair of vectors, one half of the lanes stays in place: x + apart, y
        stay = [k if k & apart == 0 else 8 + k for k in range(8)]
        cross = [k + apart if k & apart == 0 else 8 + k - apart for k in range(8)]
        both = [(v[k], v[k + apart]) for k in range(apart)]
        v = [b.fadd(shuffle(b, x, y, stay), shuffle(b, x, y, cross)) for x, y in both]
    return v[0]


def move_tile(b, to, source, n):
    """Copy up to 64 numbers."""
    with b.if_else(b.icmp_signed("==", n, I64(64))) as (whole, part):
        with whole:
            for k in range(0, 64, 8):
                store(b, load(b, source, k), to, k)
        with part:
            copied(b, to, source, n)


def copy(b, to, source, n):
    """Emit a copy of n numbers; for some hundred, this is faster than memcpy."""
    last = b.sub(n, I64(8))
    with b.if_else(b.icmp_signed("<", n, I64(8))) as (few, many):
        with few, loop(b, I64(0), n, 1) as i:
            b.store(b.load(b.gep(source, [i])), b.gep(to, [i]))
        with many:  # the last eight may overlap those before
            with loop(b, I64(0), last, 8) as i:
                store(b, load(b, source, i), to, i)
            store(b, load(b, source, last), to, last)


def sound_tile(b, to, source):
    """Copy 64 numbers, and return whether all are finite."""
    sound = None
    for k in range(0, 64, 8):
        x = load(b, source, k)
        store(b, x, to, k)
        finite = b.fcmp_ordered("==", b.fsub(x, x), zeros(V8))
        sound = finite if sound is None else b.and_(sound, finite)
    return b.icmp_signed("==", b.bitcast(sound, ir.IntType(8)), ir.IntType(8)(-1))


# Taps ---------------------------------------------------------------------------------
VECTORS = (8, 4, 2, 1) if "+avx512f" in FEATURES else (4, 2, 1) if "+avx" in FEATURES else (2, 1)
"""Of outputs, that stay in registers: the most that leave room for the samples under
the taps.
"""


def _fir_at(b, R, taps, size, w, y, sums):
    """Compute 8 R outputs of an FIR filter.

    Taps j, j + 8, .. make partial sum j, and output r under tap m needs the samples r +
    m. So for each j the samples slide through the registers, and one load serves R
    products.
    """
    pairs = b.and_(size, I64(-16))
    with loop(b, I64(0), I64(8), 1) as j:
        base, tap_0, out = b.gep(w, [j]), b.gep(taps, [j]), b.gep(sums, [b.mul(j, I64(8 * R))])
        window = [variable(b, load(b, base, 8 * r)) for r in range(R - 1)]
        acc = [variable(b, zeros(V8)) for _ in range(R)]
        # two taps a turn: between tests, the units have work for twice as long
        for turn, start, stop in ((16, I64(0), pairs), (8, pairs, size)):
            with loop(b, start, stop, turn) as m:
                x, s = list(map(b.load, window)), list(map(b.load, acc))
                for k in range(0, turn, 8):
                    tap = splat(b, b.load(b.gep(tap_0, [b.add(m, I64(k))])))
                    x.append(load(b, base, b.add(m, I64(k + 8 * (R - 1)))))
                    s = [known(b, "fma", tap, v, old) for v, old in zip(x[-R:], s, strict=True)]
                for p, v in zip(window + acc, x[-R + 1 :] * (R > 1) + s, strict=True):
                    b.store(v, p)
        for r in range(R):
            store(b, b.load(acc[r]), out, 8 * r)
    for r in range(R):
        store(b, tree(b, [load(b, sums, 8 * (R * j + r)) for j in range(8)]), y, 8 * r)


def fir(b, taps, size, w, y, n):
    """Compute maths.fir."""
    sums = room(b, DOUBLE, 64 * VECTORS[0])
    sums.align = 64  # else each vector lies across two lines of the cache
    done = variable(b, I64(0))
    with b.if_then(b.icmp_signed("==", size, I64(8))):  # one product in each partial sum
        each = [splat(b, b.load(b.gep(taps, [I64(j)]))) for j in range(8)]
        b.store(b.and_(n, I64(-8)), done)
        with loop(b, I64(0), b.load(done), 8) as i:
            x = [load(b, w, b.add(i, I64(j))) for j in range(8)]
            s = [known(b, "fma", *pair, zeros(V8)) for pair in zip(each, x, strict=True)]
            store(b, tree(b, s), y, i)
    for R in VECTORS:
        start = b.load(done)
        stop = b.add(start, b.and_(b.sub(n, start), I64(-8 * R)))
        with loop(b, start, stop, 8 * R) as i:
            _fir_at(b, R, taps, size, b.gep(w, [i]), b.gep(y, [i]), sums)
        b.store(stop, done)
    with loop(b, b.load(done), n, 1) as i:  # the eight partial sums side by side
        s = variable(b, zeros(V8))
        with loop(b, I64(0), size, 8) as k:
            b.store(known(b, "fma", load(b, taps, k), load(b, w, b.add(i, k)), b.load(s)), s)
        b.store(across(b, b.load(s)), b.gep(y, [i]))


# Modes --------------------------------------------------------------------------------
def _pass(b, x, w, n, first, update, groups, r, states, last=None, stride=None):
    """Run groups of eight modes for n samples: s += sum r q, in eight lanes.

    Their states stay in registers; the groups are independent, so that each runs during
    the latency of the others. The sums begin with 0 in the first pass, else with w.
    They go to w, or eight of them at a time to ``last``. With a stride, each sample has
    weights of its own, so many numbers further on.
    """
    held = [[variable(b, load(b, p, 8 * g)) for p in states(g)] for g in range(groups)]
    weights = [load(b, r, 8 * g) for g in range(groups)] if stride is None else []
    nothing = variable(b, zeros(V8))
    source = b.select(first, b.bitcast(nothing, w.type), w)
    turn_w = b.select(first, I64(0), I64(8))
    drives = room(b, DOUBLE, 64)  # in memory, from where a splat costs nothing
    with loop(b, I64(0), n, 8) as i:
        store(b, b.fadd(load(b, x, i), splat(b, ir.Constant(DOUBLE, TINY))), drives, i)

    def sample(i):
        drive = splat(b, b.load(b.gep(drives, [i])))
        sums = load(b, source, b.mul(i, turn_w))
        for g in range(groups):
            new = update(g, drive, *map(b.load, held[g]))
            for p, v in zip(held[g], new, strict=True):
                b.store(v, p)
            at = weights[g] if weights else load(b, r, b.add(b.mul(i, stride), I64(8 * g)))
            sums = known(b, "fma", at, new[0], sums)
        if last is None:
            store(b, sums, w, b.mul(i, I64(8)))
        return sums

    turn = 1 if last is None else 8
    whole = b.and_(n, I64(-turn))
    with loop(b, I64(0), whole, turn) as i:
        sums = [sample(b.add(i, I64(k))) for k in range(turn)]
        if last is not None:
            last(sums, i)
    if last is not None:
        with loop(b, whole, n, 1) as i:
            last([sample(i)], i)
    for g in range(groups):
        for p, v in zip(states(g), held[g], strict=True):
            store(b, b.load(v), p, 8 * g)


def _finish(b, sums, i, y, direct=None):
    """Emit y[i] = flush(tree(sums)), for one sample or eight; direct is (d, x)."""
    one = len(sums) == 1
    s = across(b, sums[0]) if one else fold(b, sums)
    if direct:
        d, x = direct
        s = known(
            b, "fma", *((d, b.load(b.gep(x, [i]))) if one else (splat(b, d), load(b, x, i))), s
        )
    b.store(flush(b, s), b.gep(y, [i])) if one else store(b, flush(b, s), y, i)


def poles(b, p, r, q, d, x, w, y, n, groups, first, last):
    """Run 1 to 4 groups of modes, q = fma(p, q, x + TINY), and add up their sums.

    They begin with those in w but for the first groups, and end there but for the last:
    of those, whose number is known only when it runs, y gets the total.
    """

    def body(count):
        at = [load(b, p, 8 * g) for g in range(count)]

        def update(g, drive, old):
            return [known(b, "fma", at[g], old, drive)]

        def total(sums, i):
            _finish(b, sums, i, y, (d, x))

        _pass(b, x, w, n, first, update, count, r, lambda g: [q], total if last else None)

    cases(b, groups, {k: k for k in (range(1, 5) if last else [4])}, body)


def eight_modes(b, p, r, q, d, x, y):
    """Emit maths.modes of eight modes for 64 samples, in straight-line code."""
    at, weight, state = load(b, p), load(b, r), load(b, q)
    for i in range(0, 64, 8):
        sums = []
        for k in range(i, i + 8):
            drive = b.fadd(b.load(b.gep(x, [I64(k)])), ir.Constant(DOUBLE, TINY))
            state = known(b, "fma", at, state, splat(b, drive))
            sums.append(known(b, "fma", weight, state, zeros(V8)))
        _finish(b, sums, I64(i), y, (d, x))
    store(b, state, q)


def leaks(b, e, r, q, low, x, w, n, fine, coarse, first, stride, moving):
    """Run groups of slow modes, q += (x + TINY) - e q.

    Up to MOST groups have a second word, and up to MOST have none; with moving weights,
    all are of one kind.
    """
    every = [(f, k) for f in range(MOST + 1) for k in range(MOST + 1) if f + k]
    kinds = [(f, k) for f, k in every if not moving or f == 0 or k == 0]

    def body(both):
        with_low, groups = both
        es = [b.fneg(load(b, e, 8 * g)) for g in range(groups)]

        def update(g, drive, old, rest=None):
            step = known(b, "fma", es[g], old, drive)
            if rest is None:
                return [b.fadd(old, step)]
            t = b.fadd(step, rest)
            new = b.fadd(old, t)
            return [new, b.fsub(t, b.fsub(new, old))]

        def states(g):
            return [q, low] if g < with_low else [q]

        own = stride if moving else None
        _pass(b, x, w, n, first, update, groups, r, states, stride=own)

    number = b.add(b.mul(fine, I64(MOST + 1)), coarse)
    cases(b, number, {(MOST + 1) * f + k: (f, f + k) for f, k in kinds}, body)


def total(b, w, y, n):
    """Compute y = flush(tree(w))."""
    whole = b.and_(n, I64(-8))
    for turn, start, stop in ((8, I64(0), whole), (1, whole, n)):
        with loop(b, start, stop, turn) as i:
            base = b.gep(w, [b.mul(i, I64(8))])
            _finish(b, [load(b, base, 8 * k) for k in range(turn)], i, y)


def chebyshev(b, c, terms, t, y, m, n):
    """Compute maths.chebyshev: m series for each of n numbers.

    Four numbers take turns while each waits for its last term.
    """
    whole = b.and_(n, I64(-4))

    def turns(count, start, stop):
        with loop(b, start, stop, count) as i, loop(b, I64(0), m, 8) as j:
            factors = [splat(b, b.load(b.gep(t, [b.add(i, I64(k))]))) for k in range(count)]
            twice = [b.fadd(f, f) for f in factors]
            last, before = ([variable(b, zeros(V8)) for _ in factors] for _ in range(2))
            place = variable(b, b.add(j, b.mul(m, terms)))

            def term(factors):
                b.store(b.sub(b.load(place), m), place)
                row = load(b, c, b.load(place))
                for f, s, r in zip(factors, last, before, strict=True):
                    now = known(b, "fma", f, b.load(s), b.fsub(row, b.load(r)))
                    b.store(b.load(s), r)
                    b.store(now, s)

            with loop(b, I64(1), terms, 1):
                term(twice)
            term(factors)
            for k, s in enumerate(last):
                store(b, b.load(s), y, b.add(j, b.mul(m, b.add(i, I64(k)))))

    turns(4, I64(0), whole)
    turns(1, whole, n)
