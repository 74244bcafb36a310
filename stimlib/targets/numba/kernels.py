"""The long sums as vector code: FIR taps and banks of modes.

They are compiled once, in the runtime; segments call them by name.

Vectors of eight are spelled out, so the speed does not hang on the optimiser's mood;
where a processor has shorter ones, LLVM takes several.  Every partial sum is kept apart
as ``maths`` defines it: the bits do not depend on the width.
"""

from __future__ import annotations

import os
from typing import Any

import llvmlite.binding
import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from stimlib.core.maths import SILENT, TINY
from stimlib.errors import BadValue

I64, I32, DOUBLE = ir.IntType(64), ir.IntType(32), ir.DoubleType()
V8 = ir.VectorType(DOUBLE, 8)
F8, i8, f8 = types.CPointer(types.float64), types.int64, types.float64
MOST = 5  # groups of eight modes of each kind in one pass


WIDER = {512: (), 256: ("avx512",), 128: ("avx", "fma", "f16c", "vaes", "vpclmulqdq")}
"""Features, by the beginning of their names, that programs of at most so many bits a
vector do without.
"""


def features() -> str:
    """Return the CPU features for which programs are built.

    They are those of the processor, except what STIMLIB_VECTOR_BITS = 256 or 128
    excludes.
    """
    config: Any = numba.config
    if config.DISABLE_JIT:
        raise BadValue(
            'NUMBA_DISABLE_JIT is set, but target="numba" is compiled; unset it, or use'
            ' target="python"'
        )
    have = config.CPU_FEATURES or llvmlite.binding.get_host_cpu_features().flatten()
    bits = os.environ.get("STIMLIB_VECTOR_BITS") or "512"
    if bits not in map(str, WIDER):
        raise BadValue(
            f"STIMLIB_VECTOR_BITS = {bits:.20}: choose one of {', '.join(map(str, WIDER))}"
        )
    return ",".join(
        "-" + f[1:] if f[1:].startswith(WIDER[int(bits)]) else f for f in have.split(",")
    )


FEATURES = features().split(",")
if os.environ.get("STIMLIB_VECTOR_BITS"):
    numba.config.CPU_FEATURES = ",".join(FEATURES)  # type: ignore[attr-defined]  # before numba builds anything


CHOICES = {
    "disable-select-optimize": ("false", "true"),
    "mispredict-default-rate": (20, 25),
    "unswitch-threshold": (400, 50),
}
"""LLVM's options while we compile, and its own.

A condition that a recursion waits for becomes a branch: processors predict it, because
it mostly holds as it did a sample before.  A condition on parameters alone is decided
before the loop, even if the loop is long.
"""


# Eight numbers ------------------------------------------------------------------------
def zeros(t):
    """Return a vector of zeros."""
    return ir.Constant(t, [0.0] * t.count)


def load(b, p, k=0):
    """Emit a load of eight float64 numbers, starting at index k."""
    place = b.gep(p, [k if isinstance(k, ir.Value) else I64(k)])
    v = b.load(b.bitcast(place, V8.as_pointer()))
    v.align = 8
    return v


def store(b, v, p, k=0):
    """Emit a store of a vector at an index."""
    place = b.gep(p, [k if isinstance(k, ir.Value) else I64(k)])
    b.store(v, b.bitcast(place, v.type.as_pointer())).align = 8


def splat(b, x, count=8):
    """Return a vector with one number in all lanes."""
    none = ir.Constant(ir.VectorType(x.type, count), ir.Undefined)
    return b.shuffle_vector(
        b.insert_element(none, x, I32(0)), none, ir.Constant(ir.VectorType(I32, count), [0] * count)
    )


def shuffle(b, x, y, lanes):
    """Return selected lanes of two vectors."""
    return b.shuffle_vector(x, y, ir.Constant(ir.VectorType(I32, len(lanes)), lanes))


def known(b, name, *v):
    """Emit a call of an LLVM intrinsic on numbers or vectors."""
    t = v[0].type
    kind = "f64" if t == DOUBLE else f"v{t.count}f64"
    return b.call(
        cgutils.get_or_insert_function(
            b.module, ir.FunctionType(t, [t] * len(v)), f"llvm.{name}.{kind}"
        ),
        v,
    )


def flush(b, s):
    """Emit maths.flush."""
    limit, zero = (
        ir.Constant(s.type, v if s.type == DOUBLE else [v] * s.type.count) for v in (SILENT, 0.0)
    )
    return b.select(b.fcmp_ordered("<=", known(b, "fabs", s), limit), zero, s)


def tree(b, s):
    """Emit maths.tree for eight values, numbers or vectors."""
    a = b.fadd
    return a(a(a(s[0], s[4]), a(s[2], s[6])), a(a(s[1], s[5]), a(s[3], s[7])))


def across(b, v):
    """Emit maths.tree across the eight lanes of one vector."""
    while v.type.count > 1:
        n = v.type.count // 2
        v = b.fadd(shuffle(b, v, v, list(range(n))), shuffle(b, v, v, list(range(n, 2 * n))))
    return b.extract_element(v, I32(0))


def fold(b, v):
    """Emit ``across`` for eight vectors at once.

    Lane k of the result is that of vector k.
    """
    for apart, lanes in (
        (4, [0, 1, 2, 3, 8, 9, 10, 11]),
        (2, [0, 1, 8, 9, 4, 5, 12, 13]),
        (1, [0, 8, 2, 10, 4, 12, 6, 14]),
    ):
        both = [(v[k], v[k + apart]) for k in range(apart)]
        v = [
            b.fadd(shuffle(b, x, y, lanes), shuffle(b, x, y, [k + apart for k in lanes]))
            for x, y in both
        ]
    return v[0]


def variable(b, v):
    """Return a variable that a loop can change; LLVM keeps it in a register."""
    return cgutils.alloca_once_value(b, v)


def loop(b, start, stop, step):
    """Return a context manager that emits a loop over whole numbers."""
    return cgutils.for_range_slice(b, start, stop, I64(step), I64)


def cases(b, number, cases):
    """Emit a switch that runs one of the bodies, {number: body}."""
    done = b.append_basic_block("done")
    choice = b.switch(number, done)
    for k, body in cases.items():
        block = b.append_basic_block(f"case{k}")
        choice.add_case(I64(k), block)
        b.position_at_end(block)
        body()
        b.branch(done)
    b.position_at_end(done)


@intrinsic
def move_tile(ctx, to, source, n):
    """Copy up to 64 numbers."""

    def code(c, b, sig, v):
        to, source, n = v
        with b.if_else(b.icmp_signed("==", n, I64(64))) as (whole, part):
            with whole:
                for k in range(0, 64, 8):
                    store(b, load(b, source, k), to, k)
            with part:
                cgutils.raw_memcpy(b, to, source, n, 8)
        return c.get_dummy_value()

    return types.void(F8, F8, i8), code


def copy(b, to, source, n):
    """Emit a copy of n numbers; for some hundred, this is faster than memcpy."""
    last = b.sub(n, I64(8))
    with b.if_else(b.icmp_signed("<", n, I64(8))) as (few, many):
        with few, loop(b, I64(0), n, 1) as (i, _):
            b.store(b.load(b.gep(source, [i])), b.gep(to, [i]))
        with many:  # the last eight may overlap those before
            with loop(b, I64(0), last, 8) as (i, _):
                store(b, load(b, source, i), to, i)
            store(b, load(b, source, last), to, last)


@intrinsic
def sound_tile(ctx, to, source):
    """Copy 64 numbers, and return whether all are finite."""

    def code(c, b, sig, v):
        sound = None
        for k in range(0, 64, 8):
            x = load(b, v[1], k)
            store(b, x, v[0], k)
            finite = b.fcmp_ordered("==", b.fsub(x, x), zeros(V8))
            sound = finite if sound is None else b.and_(sound, finite)
        return b.icmp_signed("==", b.bitcast(sound, ir.IntType(8)), ir.IntType(8)(-1))

    return types.boolean(F8, F8), code


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
    with loop(b, I64(0), I64(8), 1) as (j, _):
        base, tap_0, out = b.gep(w, [j]), b.gep(taps, [j]), b.gep(sums, [b.mul(j, I64(8 * R))])
        window = [variable(b, load(b, base, 8 * r)) for r in range(R - 1)]
        acc = [variable(b, zeros(V8)) for _ in range(R)]
        # two taps a turn: between tests, the units have work for twice as long
        for turn, start, stop in ((16, I64(0), pairs), (8, pairs, size)):
            with loop(b, start, stop, turn) as (m, _):
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


@intrinsic
def fir(ctx, taps, size, w, y, n):
    """Compute maths.fir."""

    def code(c, b, sig, v):
        taps, size, w, y, n = v
        sums = cgutils.alloca_once(b, DOUBLE, 64 * VECTORS[0])
        sums.align = 64  # else each vector lies across two lines of the cache
        done = variable(b, I64(0))
        for R in VECTORS:
            start = b.load(done)
            stop = b.add(start, b.and_(b.sub(n, start), I64(-8 * R)))
            with loop(b, start, stop, 8 * R) as (i, _):
                _fir_at(b, R, taps, size, b.gep(w, [i]), b.gep(y, [i]), sums)
            b.store(stop, done)
        with loop(b, b.load(done), n, 1) as (i, _):  # the eight partial sums side by side
            s = variable(b, zeros(V8))
            with loop(b, I64(0), size, 8) as (k, _):
                b.store(known(b, "fma", load(b, taps, k), load(b, w, b.add(i, k)), b.load(s)), s)
            b.store(across(b, b.load(s)), b.gep(y, [i]))
        return c.get_dummy_value()

    return types.void(F8, i8, F8, F8, i8), code


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
    drives = cgutils.alloca_once(b, DOUBLE, 64)  # in memory, from where a splat costs nothing
    with loop(b, I64(0), n, 8) as (i, _):
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
    with loop(b, I64(0), whole, turn) as (i, _):
        sums = [sample(b.add(i, I64(k))) for k in range(turn)]
        if last is not None:
            last(sums, i)
    if last is not None:
        with loop(b, whole, n, 1) as (i, _):
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


def _poles(last):
    @intrinsic
    def poles(ctx, p, r, q, d, x, w, y, n, groups, first):
        """Run 1 to 4 groups of modes, q = fma(p, q, x + TINY)."""

        def code(c, b, sig, v):
            p, r, q, d, x, w, y, n, groups, first = v

            def body(count):
                at = [load(b, p, 8 * g) for g in range(count)]
                _pass(
                    b,
                    x,
                    w,
                    n,
                    first,
                    lambda g, drive, old: [known(b, "fma", at[g], old, drive)],
                    count,
                    r,
                    lambda g: [q],
                    (lambda sums, i: _finish(b, sums, i, y, (d, x))) if last else None,
                )

            cases(b, groups, {k: lambda k=k: body(k) for k in (range(1, 5) if last else [4])})
            return c.get_dummy_value()

        return types.void(F8, F8, F8, f8, F8, F8, F8, i8, i8, types.boolean), code

    return poles


poles, last_poles = _poles(last=False), _poles(last=True)


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


def _leaks(moving):
    every = [(f, k) for f in range(MOST + 1) for k in range(MOST + 1) if f + k]
    kinds = [(f, k) for f, k in every if not moving or f == 0 or k == 0]

    @intrinsic
    def leaks(ctx, e, r, q, low, x, w, n, fine, coarse, first, stride):
        """Run groups of slow modes, q += (x + TINY) - e q.

        Up to MOST groups have a second word, and up to MOST have none; with moving
        weights, all are of one kind.
        """

        def code(c, b, sig, v):
            e, r, q, low, x, w, n, fine, coarse, first, stride = v

            def body(with_low, groups):
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
            cases(
                b, number, {(MOST + 1) * f + k: lambda f=f, k=k: body(f, f + k) for f, k in kinds}
            )
            return c.get_dummy_value()

        return types.void(F8, F8, F8, F8, F8, F8, i8, i8, i8, types.boolean, i8), code

    return leaks


leaks, moving_leaks = _leaks(moving=False), _leaks(moving=True)


@intrinsic
def total(ctx, w, y, n):
    """Compute y = flush(tree(w))."""

    def code(c, b, sig, v):
        w, y, n = v
        whole = b.and_(n, I64(-8))
        for turn, start, stop in ((8, I64(0), whole), (1, whole, n)):
            with loop(b, start, stop, turn) as (i, _):
                base = b.gep(w, [b.mul(i, I64(8))])
                _finish(b, [load(b, base, 8 * k) for k in range(turn)], i, y)
        return c.get_dummy_value()

    return types.void(F8, F8, i8), code


@intrinsic
def chebyshev(ctx, c, terms, t, y, m, n):
    """Compute maths.chebyshev: m series for each of n numbers.

    Four numbers take turns while each waits for its last term.
    """

    def code(ctx, b, sig, v):
        c, terms, t, y, m, n = v
        whole = b.and_(n, I64(-4))

        def turns(count, start, stop):
            with loop(b, start, stop, count) as (i, _), loop(b, I64(0), m, 8) as (j, _):
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
        return ctx.get_dummy_value()

    return types.void(F8, i8, F8, F8, i8, i8), code
