"""Functions that write instructions: what the compiled sources call, and ``maths``.

A source imports them from here; for a step, ``TWINS`` has them instead of the
functions of ``stimlib.core.maths``.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from stimlib.core import maths
from stimlib.core.maths import SILENT
from stimlib.errors import SceneError
from stimlib.targets.llvm import instructions, kernels, lanes, vectors
from stimlib.targets.llvm.instructions import DOUBLE, I64, TRUTH
from stimlib.targets.llvm.values import (
    KINDS,
    Array,
    Known,
    Members,
    Outer,
    Pointer,
    Unknown,
    Value,
    cast,
    llvm_type,
    number,
    plain,
)


# Numbers ------------------------------------------------------------------------------
def _where(w: Any, condition: Any, one: Any, other: Any) -> Any:
    one, other = number(one), number(other)
    if (one.kind == "u8") != (other.kind == "u8"):
        raise Unknown("where of a uint64 and another number: make both np.uint64, or floats")
    kind = one.kind if one.kind == "u8" else "f8"
    return Value(w.b.chosen(w.truth(condition), cast(w.b, one, kind), cast(w.b, other, kind)), kind)


def _rounded(name: str) -> Known:
    def f(w: Any, *x: Any) -> Value:
        return Value(instructions.known(w.b, name, *(cast(w.b, v, "f8").v for v in x)), "f8")

    return Known(f)


def _bits(w: Any, given: Any) -> Value:
    return Value(w.b.bitcast(cast(w.b, given, "f8").v, I64), "u8")


def _unbits(w: Any, given: Any) -> Value:
    given = number(given)
    if given.kind not in ("u8", "i8"):
        raise Unknown("unbits converts a np.uint64")
    return Value(w.b.bitcast(given.v, DOUBLE), "f8")


def _as_float(w: Any, given: Any) -> Value:
    given = number(given)
    if given.kind[0] == "f":
        raise Unknown("as_float converts a np.uint64, not a float")
    return Value(w.b.uitofp(given.v, DOUBLE), "f8")


def _flush(w: Any, given: Any) -> Value:
    return Value(instructions.flush(w.b, cast(w.b, given, "f8").v), "f8")


def _settle(w: Any, given: Any) -> Value:
    """With a branch: a selection would lengthen the recursion, by 2.3 ns in a loop."""
    b, value = w.b, cast(w.b, given, "f8").v
    size = instructions.known(b, "fabs", value)
    start, rare, done = b.block, b.append_basic_block("silent"), b.append_basic_block("settled")
    silent = b.fcmp_ordered("<=", size, ir.Constant(DOUBLE, SILENT))
    b.cbranch(silent, rare, done).set_weights([1, 1000000])
    b.position_at_end(rare)
    b.branch(done)
    b.position_at_end(done)
    settled = b.phi(DOUBLE)
    settled.add_incoming(value, start)
    settled.add_incoming(ir.Constant(DOUBLE, 0.0), rare)
    return Value(settled, "f8")


# Memory -------------------------------------------------------------------------------
def known(f: Any) -> Known:
    """Let a source call a function that writes instructions."""
    return Known(f)


def _as(kind: str) -> Known:
    return Known(lambda w, p: Pointer(w.b.bitcast(p.v, KINDS[kind].as_pointer()), kind))


def _at_address(kind: str) -> Known:
    return Known(lambda w, n: Pointer(w.b.inttoptr(number(n).v, KINDS[kind].as_pointer()), kind))


as_u8, as_i8 = _as("u8"), _as("i8")
f8_at, i8_at, f4_at = _at_address("f8"), _at_address("i8"), _at_address("f4")
whole, as_word, single = (
    Known(lambda w, x, kind=kind: cast(w.b, x, kind)) for kind in ("i8", "u8", "f4")
)


@known
def at(w, p, o):
    """Return a pointer advanced by o words."""
    return w.address(p, o)


@known
def array(w, p, n):
    """Return n words at a pointer as an array."""
    return Array(p, Value(cast(w.b, n, "i8").v, "i8", True))


@known
def move(w, to, source, n):
    """Copy n words."""
    instructions.copied(w.b, to.v, source.v, cast(w.b, n, "i8").v)


def through(result: str, *kinds: str) -> Known:
    """Return a call of the function at an address, the first of its arguments."""

    def f(w: Any, address: Any, *given: Any) -> Any:
        of = ir.FunctionType(llvm_type(result), [llvm_type(k) for k in kinds])
        there = w.b.inttoptr(number(address).v, of.as_pointer())
        return w.called(there, Outer("", result, kinds), given)

    return Known(f)


SEGMENT = "f8*", "f8*", "f8*", "i8*", "i8"  # P, S, W, A, n
call = through("void", *SEGMENT)
run = through("void", "i8*", "f8*", "f8*", "i8")


@known
def words(w, a):
    """Return a float64 array's memory as words."""
    return a._replace(p=as_u8.f(w, a.p))


@known
def copy(w, a, b):
    """Copy a into the start of b."""
    kernels.copy(w.b, b.p.v, a.p.v, a.n.v)


members = Known(lambda w, *given: Members(given))
counted = Known(lambda w, i: i._replace(low=True))


def search(knots, x, per):
    """Return the index of the piece that contains a position."""
    low, high = 0, knots.size - 2
    if per > 0.0:
        # half a piece back, so that the piece is this one or the next
        low = whole(max(0.0, min((x - knots[0]) * per - 0.5, float(high))))
        low = min(low + whole(x >= knots[counted(low + 1)]), high)
    else:
        while low < high:
            middle = (low + high + 1) >> 1
            if x >= knots[counted(middle)]:
                low = middle
            else:
                high = middle - 1
    return counted(low)


def quotient(n, i, by, inverse):
    """Return (n + i) / by, by products where that is quicker.

    The guess is within two units in the last place, so what it leaves of n is exact: a
    whole multiple of such a unit, of 34 bits at most.  What is added to the guess is
    then wrong by 2^-52 units at most, and no quotient is as near to the middle of two
    floats, where the last rounding decides: all are 1/(2 by) units or more away.
    """
    # without AVX-512, a word becomes a float in many instructions; 2^52 + i in one
    n = n + (maths.unbits(maths.bits(2.0**52) + as_word(i)) - 2.0**52)
    if inverse > 0.0:
        guess = n * inverse
        return maths.fma(maths.fma(-guess, by, n), inverse, guess)
    return n / by


# Long sums: kernels of the runtime ----------------------------------------------------
FIR = "f8*", "i8", "f8*", "f8*", "i8"  # taps, size, w, y, n
MODES = "f8*", "f8*", "f8*", "i8", "f8", "f8*", "f8*", "f8*", "i8"  # p, r, q, size, d, x, w, y, n
# e, r, q, low, size, size of low, x, w, y, n
MEMORY = "f8*", "f8*", "f8*", "f8*", "i8", "i8", "f8*", "f8*", "f8*", "i8"
CHEBYSHEV = "f8*", "i8", "f8*", "f8*", "i8", "i8"  # c, terms, t, y, series, size of t


def kernel(name: str, kinds: tuple[str, ...], *given: Any) -> Any:
    """Call a kernel by its name: of an array, the address."""
    w, *rest = given
    rest = [v.p if isinstance(v, Array) else v for v in rest]
    return w.outside(Outer(f"stimlib_{name}", "void", kinds), rest)


@known
def fir(w, taps, signal, output):
    """Compute an FIR filter with the runtime's kernel."""
    kernel("fir", FIR, w, taps, taps.size, signal, output, output.size)


@known
def modes(w, poles, weights, states, gain, signal, output, sums):
    """Compute a bank of modes with the runtime's kernel."""
    kernel(
        "modes",
        MODES,
        w,
        poles,
        weights,
        states,
        poles.size,
        gain,
        signal,
        sums,
        output,
        output.size,
    )


@known
def steady(w, leaks, weights, states, low, signal, output, sums):
    """Compute a bank of slow modes with the runtime's kernel."""
    kernel(
        "memory",
        MEMORY,
        w,
        leaks,
        weights,
        states,
        low,
        leaks.size,
        low.size,
        signal,
        sums,
        output,
        output.size,
    )


@known
def moving(w, leaks, weights, states, low, signal, output, sums):
    """Compute a bank of slow modes, with weights for each sample."""
    kernel(
        "moving_memory",
        MEMORY,
        w,
        leaks,
        weights,
        states,
        low,
        leaks.size,
        low.size,
        signal,
        sums,
        output,
        output.size,
    )


# names of arguments as in maths: a step may give them by name, because this is walked
def memory(e, r, q, low, x, y, w):
    """Compute a bank of slow modes, whose states have second words."""
    if r.size == e.size:
        steady(e, r, q, low, x, y, w)
    else:
        moving(e, r, q, low, x, y, w)


@known
def series_at(w, coefficients, terms, numbers, values, series_count):
    """Compute Chebyshev series with the runtime's kernel."""
    kernel(
        "chebyshev", CHEBYSHEV, w, coefficients, terms, numbers, values, series_count, numbers.size
    )


def chebyshev(c, t, y):
    """Compute m Chebyshev series, whose coefficients follow each other."""
    m = y.size // t.size
    series_at(c, c.size // m, t, y, m)


# Vectors ------------------------------------------------------------------------------
def _numbers(w: Any, record: Any) -> Any:
    """Return the numbers of a NamedTuple as LLVM's, or ()."""
    return type(record)(*(number(field).v for field in record)) if record else ()


def _kinds(record: Any) -> str:
    kinds = {"f8": "f", "u8": "u"}
    return "".join(
        kinds.get(number(field).kind, "?") if plain(field) or isinstance(field, Value) else "?"
        for field in record
    )


def _floats(*arrays: Any) -> bool:
    return all(isinstance(array, Array) and array.p.kind == "f8" for array in arrays)


@known
def steps(w, step, numbers, inputs, output, count):
    """Run a step without state along slots."""
    addresses = [address.v for address in inputs]
    vectors.steps(w.b, lanes.twin(step), _numbers(w, numbers), addresses, output.v, count.v)


@known
def chain(w, inputs, operations, outputs, buffers, operands, count):
    """Run operations in a row, as ``segments.plan`` lists them."""
    vectors.chain(w.b, inputs, operations, outputs, buffers.v, operands.v, count.v)


@known
def abreast(w, step, numbers, states, inputs, outputs, count):
    """Run a step on lanes along the slots of blocks, one in each lane."""
    kinds = [[value.kind for value in map(number, one)] for one in states]
    made = vectors.abreast(
        w.b,
        step,
        [_numbers(w, one) for one in numbers],
        [_numbers(w, one) for one in states],
        [[address.v for address in one] for one in inputs],
        [address.v for address in outputs],
        count.v,
    )
    return tuple(
        type(one)(*(Value(value, letter) for value, letter in zip(one, kind, strict=True)))
        for one, kind in zip(made, kinds, strict=True)
    )


@known
def each(w, f, p, x, y):
    """Compute maths.each."""
    if isinstance(y, Members):
        for lane, own in enumerate(y):
            numbers = p[lane] if isinstance(p, Members) else p
            each.f(w, f, numbers, tuple(signal[lane] for signal in x), own)
        return
    tuples = all(isinstance(t, tuple) and not isinstance(t, Array | Value) for t in (p, x))
    if not tuples or "?" in (kinds := _kinds(p)) or not _floats(*x, y):
        raise SceneError(
            "each(f, p, x, y): p must be a NamedTuple of numbers or (), x a tuple of arrays, such"
            " as (x,), and all arrays of floats without gaps; else write a loop over the samples"
        )
    helper = vectors.helper_of(f, type(p), kinds, "f" * len(x))
    vectors.each(w.b, helper, _numbers(w, p), [a.p.v for a in x], y.p.v, y.n.v)


@known
def series(w, f, p, s, x, y):
    """Compute maths.series; of Members, with one in each lane of a vector."""
    members = (p, s, x, y) if isinstance(y, Members) else ((p,), (s,), (x,), (y,))
    p, s, x, y = (one[0] for one in members)
    tuples = all(hasattr(t, "_fields") and not isinstance(t, Array | Value) for t in (p, s))
    numbers = tuples and all(_floats(v) or not isinstance(v, Array) for v in p)
    if not numbers or not _floats(*s, x, y):
        raise SceneError(
            "series(f, p, s, x, y): p must be a NamedTuple of numbers and arrays, s one of arrays,"
            " x and y arrays, all of floats without gaps; else write a loop over the samples"
        )
    types = type(p), type(s)
    helper = vectors.helper_of(f, types[0], "f" * len(p), "f" * (len(s) + 1), types[1])
    fields = [
        [
            [v.p.v if isinstance(v, Array) else cast(w.b, v, "f8").v for v in field]
            for field in zip(*one, strict=True)
        ]
        for one in members[:2]
    ]
    signals = [[signal.p.v for signal in one] for one in members[2:]]
    run: Any = vectors.series if len(members[0]) == 1 else vectors.series_abreast
    run(w.b, helper, types, fields, s[0].n.v, *signals, y.n.v)


@known
def pairs(w, given, key, first, deviates):
    """Compute maths.pairs."""
    helper = vectors.helper_of(given, (), "", "uu")
    vectors.pairs(w.b, helper, number(key).v, number(first).v, deviates.p.v, deviates.n.v)


@known
def pairs_beside_modes(w, f, key, first, z, p, r, q, d, x, y):
    """Compute maths.pairs and maths.modes of eight, for a tile each."""
    helper = vectors.helper_of(f, (), "", "uu")
    given = [
        v.p.v if isinstance(v, Array) else number(v).v for v in (key, first, z, p, r, q, d, x, y)
    ]
    vectors.pairs_beside_modes(w.b, helper, *given)


def of(f: Any) -> Known:
    """Let a source call a function of values: f(b, *values)."""

    def g(w: Any, *x: Any) -> Any:
        y = f(w.b, *(v.v if isinstance(v, Pointer) else number(v).v for v in x))
        return None if y is None else Value(y, "b1" if y.type == TRUTH else "f8")

    return Known(g)


TWINS: dict[Any, Any] = {
    maths.where: Known(_where),
    maths.fma: _rounded("fma"),
    maths.sqrt: _rounded("sqrt"),
    maths.floor: _rounded("floor"),
    maths.bits: Known(_bits),
    maths.unbits: Known(_unbits),
    maths.as_float: Known(_as_float),
    maths.flush: Known(_flush),
    maths.settle: Known(_settle),
}
TWINS |= {getattr(maths, name): f for name, f in maths.ELEMENTARY.items()} | {
    getattr(maths, name): globals()[name]
    for name in "words copy search quotient fir modes memory chebyshev each pairs series".split()
}
"""What stands for functions of ``maths``."""
