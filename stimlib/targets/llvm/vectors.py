"""Loops of vector code, over samples and over steps side by side.

They are ``maths.each``, ``pairs`` and ``series``, and the operations of the runtime.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir

from stimlib.core.graph import signals
from stimlib.errors import SceneError
from stimlib.targets.llvm.instructions import (
    DOUBLE,
    I32,
    I64,
    V8,
    cases,
    copied,
    function,
    load,
    loop,
    room,
    shuffle,
    splat,
    store,
    variable,
    zeros,
)
from stimlib.targets.llvm.kernels import eight_modes
from stimlib.targets.llvm.lanes import TRUTH, TWINS, Lanes, bind, fault, number, twin
from stimlib.targets.llvm.machine import FEATURES
from stimlib.targets.llvm.rows import OPERATIONS

WIDTHS = 16, 2
"""Sixteen hide the latency of the operations; two are quickest where a sink asks for a
sample or two.
"""


def steps(b, step, numbers, inputs, output, count):
    """Emit output[i] = step(numbers, (), inputs[0][i], ..)[0] for count samples.

    The slots are given by their addresses; samples that fill up the last vector are
    computed as well.
    """
    numbers = lanes_of(b, numbers)

    def write(sample):
        samples = [Lanes(b, load(b, address, sample)) for address in inputs]
        store(b, number(b, step(numbers, (), *samples)[0]), output, sample)

    with b.if_else(b.icmp_signed("==", count, I64(64))) as (whole, part):
        with whole:  # no loop, which would take as long as the work
            for sample in range(0, 64, 8):
                write(sample)
        with part, loop(b, I64(0), count, 8) as sample:
            write(sample)


def lanes_of(b, t):
    """Return a NamedTuple of numbers as lanes, or ()."""
    return type(t)(*(Lanes(b, splat(b, v)) for v in t)) if t else ()


def gathered(b, values):
    """Return values as the lanes of one vector."""
    vector = ir.Constant(ir.VectorType(values[0].type, len(values)), ir.Undefined)
    for lane, value in enumerate(values):
        vector = b.insert_element(vector, value, I32(lane))
    return vector


def spread(b, vector, addresses, place):
    """Emit addresses[lane][place] = vector[lane]."""
    for lane, address in enumerate(addresses):
        b.store(b.extract_element(vector, I32(lane)), b.gep(address, [place]))


def abreast(b, step, parameters, states, inputs, outputs, count):
    """Run a step along the slots of several blocks, one in each lane.

    Each argument holds what belongs to each of them. The states after all samples are
    returned.
    """
    # in vectors, not as scalars: two velocities were 39 instructions a sample, more
    # than fit into the 8 cycles that each of them waits for itself
    lanes = [Lanes(b, gathered(b, fields)) for fields in zip(*parameters, strict=True)]
    numbers = type(parameters[0])(*lanes) if lanes else ()
    cells = [variable(b, gathered(b, fields)) for fields in zip(*states, strict=True)]
    # turning squares of eight samples in registers was no faster for eight blocks, and
    # slower for two and four
    with loop(b, I64(0), count, 1) as sample:
        samples = [
            Lanes(b, gathered(b, [b.load(b.gep(address, [sample])) for address in addresses]))
            for addresses in zip(*inputs, strict=True)
        ]
        old = type(states[0])(*(Lanes(b, b.load(cell)) for cell in cells))
        out, new = step(numbers, old, *samples)
        spread(b, old[0].like(out), outputs, sample)
        for cell, value in zip(cells, new, strict=True):
            b.store(old[0].like(value), cell)
    last = [b.load(cell) for cell in cells]
    return tuple(
        type(states[0])(*(b.extract_element(vector, I32(lane)) for vector in last))
        for lane in range(len(states))
    )


def helper_of(f: Any, p_type: Any, p_kinds: str, kinds: str, s_type: Any = None) -> Callable:
    """Return a helper of each, pairs or series; raise SceneError for its author."""
    helper = twin(f)
    call = helper if "f" in kinds else helper and (lambda p, *x: helper(*x))
    if s_type:
        call = helper and (lambda p, *v: helper(p, s_type(*v[:-1]), v[-1]))
    if why := fault(call, p_type, p_kinds, kinds):
        raise SceneError(
            f"{f.__name__} cannot run in vectors: {why}. Vectors support arithmetic, comparisons,"
            f" abs, {', '.join(name for name in TWINS if name[0] != '_')} and helpers of these;"
            " else write a loop over the samples"
        )
    return helper


def each(b, helper, given, inputs, output, count):
    """Compute maths.each, from the addresses of inputs to that of the output."""
    numbers = lanes_of(b, given)
    few = b.icmp_signed("<", count, I64(8))
    rooms = [room(b, DOUBLE, 8) for _ in (*inputs, output)]
    with b.if_then(few):  # what is beyond the end belongs to others
        for to, address in zip(rooms, inputs, strict=False):
            store(b, zeros(V8), to)
            copied(b, to, address, count)
    *inputs, out = (
        b.select(few, to, address) for to, address in zip(rooms, (*inputs, output), strict=True)
    )
    last = b.select(few, I64(0), b.sub(count, I64(8)))
    ends = room(b, DOUBLE, 8)
    # the last eight, which may hold some of those before, first: the output may be an
    # input
    with loop(b, I64(0), count, 8) as sample:
        first = b.icmp_signed("==", sample, I64(0))
        sample = b.select(first, last, b.sub(sample, I64(8)))
        samples = [Lanes(b, load(b, address, sample)) for address in inputs]
        store(b, number(b, helper(numbers, *samples)), b.select(first, ends, b.gep(out, [sample])))
    with b.if_then(b.icmp_signed(">", count, I64(0))):
        store(b, load(b, ends), out, last)
    with b.if_then(few):
        copied(b, output, out, count)


def _masked(b, address, there, vector=None):
    """Load the elements whose mask is set, and 0 for others; store a given vector."""
    kind = ir.VectorType(DOUBLE, there.type.count)
    start = b.bitcast(address, kind.as_pointer())
    given = [vector, start, I32(8), there] if vector else [start, I32(8), there, zeros(kind)]
    name = f"llvm.masked.{'store' if vector else 'load'}.v{kind.count}f64.p0v{kind.count}f64"
    return b.call(
        function(b, name, ir.VoidType() if vector else kind, [argument.type for argument in given]),
        given,
    )


def _stages(b, width, helper, types, fields, count, signal, output, samples):
    """Emit maths.series of ``count`` stages, up to width, one in each lane.

    Each is one sample behind the one before, which hands its output on by a lane.
    """
    lanes, behind = ir.Constant(ir.VectorType(I64, width), list(range(width))), b.sub(count, I64(1))
    there, zero = b.icmp_unsigned("<", lanes, splat(b, count, width)), I64(0)
    parameters = [
        splat(b, vector, width) if vector.type == DOUBLE else _masked(b, vector, there)
        for vector in fields[0]
    ]
    cells = [  # outputs of the turn before, and states
        variable(b, vector)
        for vector in (
            zeros(ir.VectorType(DOUBLE, width)),
            *(_masked(b, address, there) for address in fields[1]),
        )
    ]

    def turn(number_of_turn, part):
        at, late = (
            number_of_turn,
            b.sub(number_of_turn, behind),
        )  # samples of the first and of the last stage
        if part:  # some stages have no sample yet, or no more
            at = b.select(
                b.icmp_signed("<", number_of_turn, samples), number_of_turn, b.sub(samples, I64(1))
            )
            late = b.select(b.icmp_signed(">", late, zero), late, zero)
        vector, *old = map(b.load, cells)
        vector = shuffle(
            b, vector, splat(b, b.load(b.gep(signal, [at])), width), [width, *range(width - 1)]
        )
        own = (
            record(*(Lanes(b, value) for value in one))
            for record, one in zip(types, (parameters, old), strict=True)
        )
        out, new = helper(*own, Lanes(b, vector))
        out, *new = [number(b, value, width) for value in (out, *new)]
        if part:
            runs = b.icmp_unsigned(
                "<", b.sub(splat(b, number_of_turn, width), lanes), splat(b, samples, width)
            )
            new = [b.select(runs, value, kept) for value, kept in zip(new, old, strict=True)]
        for cell, value in zip(cells, (out, *new), strict=True):
            b.store(value, cell)
        b.store(b.extract_element(out, behind), b.gep(output, [late]))

    most = b.select(b.icmp_signed(">", samples, behind), samples, behind)
    for start, stop, part in (
        (zero, behind, True),
        (behind, most, False),
        (most, b.add(samples, behind), True),
    ):
        with loop(b, start, stop, 1) as number_of_turn:
            turn(number_of_turn, part)
    for address, cell in zip(fields[1], cells[1:], strict=True):
        _masked(b, address, there, b.load(cell))


# Of numbers of stages for which there is a loop, 1, 2, 4 .. : more than 16 take several
# passes, or fewer where more lanes would not fit into the registers.
STAGES = 5 if "+avx512f" in FEATURES else 4 if "+avx" in FEATURES else 3


def series(b, helper, types, fields, size, x, y, n):
    """Compute maths.series: ``size`` stages of the fields of parameters and state.

    A field is a number, or the address of one for each stage; each is a list with one
    element, as in series_abreast.
    """
    fields, (x,), (y,) = [[field for (field,) in one] for one in fields], x, y
    most = 1 << (STAGES - 1)
    stop = b.select(b.icmp_signed(">", n, I64(0)), size, I64(0))
    with loop(b, I64(0), stop, most) as first:
        left = b.sub(size, first)
        count = b.select(b.icmp_signed("<", left, I64(most)), left, I64(most))
        source = b.select(b.icmp_signed("==", first, I64(0)), x, y)
        at = [[v if v.type == DOUBLE else b.gep(v, [first]) for v in one] for one in fields]
        cases(
            b,
            b.sub(I64(64), b.ctlz(b.sub(count, I64(1)), TRUTH(0))),
            {k: 1 << k for k in range(STAGES)},
            lambda W: _stages(b, W, helper, types, at, count, source, y, n),
        )


def series_abreast(b, helper, types, fields, size, x, y, n):
    """Compute maths.series of several blocks, one in each lane, stage after stage.

    Fields are as in series, each a list with one element for each block.
    """
    width = len(x)
    signal = room(b, ir.VectorType(DOUBLE, width), 64)  # of the longest tile
    with loop(b, I64(0), n, 1) as sample:
        samples = [b.load(b.gep(address, [sample])) for address in x]
        b.store(gathered(b, samples), b.gep(signal, [sample]))

    def own(values, stage):
        loaded = (v if v.type == DOUBLE else b.load(b.gep(v, [stage])) for v in values)
        return gathered(b, list(loaded))

    with loop(b, I64(0), size, 1) as stage:
        numbers = types[0](*(Lanes(b, own(values, stage)) for values in fields[0]))
        cells = [variable(b, own(values, stage)) for values in fields[1]]
        with loop(b, I64(0), n, 1) as sample:
            at = b.gep(signal, [sample])
            old = types[1](*(Lanes(b, b.load(cell)) for cell in cells))
            out, new = helper(numbers, old, Lanes(b, b.load(at)))
            for cell, value in zip((at, *cells), (out, *new), strict=True):
                b.store(number(b, value, width), cell)
        for cell, values in zip(cells, fields[1], strict=True):
            spread(b, b.load(cell), values, stage)
    with loop(b, I64(0), n, 1) as sample:
        spread(b, b.load(b.gep(signal, [sample])), y, sample)


def operation(b, number, buffers, operands, count):
    """Run the row of an operation.

    A holds the slots of its inputs and that of its output.
    """

    def body(cls):
        *inputs, output = (
            b.gep(buffers, [b.load(b.gep(operands, [I64(argument)]))])
            for argument in range(len(signals(cls)) + 1)
        )
        steps(b, bind(cls.step), (), inputs, output, count)

    cases(b, number, dict(enumerate(OPERATIONS)), body)


def chain(b, inputs, operations, outputs, buffers, operands, count):
    """Run operations in a row, with what goes from one to the next in registers.

    Samples that fill up the last vector are computed as well.
    """
    addresses = [
        b.gep(buffers, [b.load(b.gep(operands, [I64(signal)]))])
        for signal in range(inputs + len(outputs))
    ]
    with loop(b, I64(0), count, 8) as place:
        signals = [Lanes(b, load(b, address, place)) for address in addresses[:inputs]]
        for number_of, given in operations:
            step: Any = bind(OPERATIONS[number_of].step)
            made = step((), (), *(signals[signal] for signal in given))[0]
            signals.append(Lanes(b, number(b, made)))
        for signal, address in zip(outputs, addresses[inputs:], strict=True):
            store(b, signals[signal].v, address, place)


def _draw(b, helper, key, first, deviates, width):
    """Emit deviates[2 k : 2 k + 2] = helper(key, first + k) for width pairs."""
    steps = ir.Constant(ir.VectorType(I64, width), list(range(width)))
    indices = b.add(splat(b, first, width), steps)
    one, other = helper(Lanes(b, splat(b, key, width)), Lanes(b, indices))
    for start in range(0, width, min(4, width)):
        both = [
            lane for pair in range(start, min(start + 4, width)) for lane in (pair, width + pair)
        ]
        store(b, shuffle(b, one.v, other.v, both), deviates, 2 * start)


def pairs(b, helper, key, first, deviates, count):
    """Compute maths.pairs."""
    name = f"pairs.{helper.__name__}"
    if name not in b.module.globals:  # one function, however often it is called
        of = ir.FunctionType(ir.VoidType(), [I64, I64, DOUBLE.as_pointer(), I64])
        once = ir.Function(b.module, of, name)
        once.linkage = "internal"
        once.attributes.add("noinline")
        once.append_basic_block()
        _pairs(ir.IRBuilder(once.blocks[0]), helper, *once.args)
    b.call(b.module.globals[name], [key, first, deviates, count])


def _pairs(b, helper, key, first, deviates, count):
    with b.if_else(b.icmp_signed("==", count, I64(64))) as (tile, part):
        with tile:  # no loop, for two turns of which keys and constants would be prepared
            _draw(b, helper, key, first, deviates, 32)
        with part:
            whole = b.and_(count, I64(-2 * WIDTHS[0]))
            for width, start, stop in zip(WIDTHS, (I64(0), whole), (whole, count), strict=True):
                with loop(b, start, stop, 2 * width) as deviate:
                    index = b.add(first, b.lshr(deviate, I64(1)))
                    _draw(b, helper, key, index, b.gep(deviates, [deviate]), width)
    b.ret_void()


def pairs_beside_modes(
    b, helper, key, first, deviates, poles, weights, states, gain, signal, output
):
    """Compute maths.pairs, and maths.modes of 8, for a tile each.

    Each sample of the modes waits for the one before; the pairs are drawn meanwhile.
    """
    done = b.block.instructions
    before = len(done)
    eight_modes(b, poles, weights, states, gain, signal, output)
    between = len(done)
    _draw(b, helper, key, first, deviates, 32)
    done[before:] = _merged(done[before:between], done[between:])


def _merged(one: list, other: list) -> list:
    """Return two lists of independent instructions as one, evenly mixed."""
    ranked = [
        ((position + 0.5) / len(instructions), instructions is other, position)
        for instructions in (one, other)
        for position in range(len(instructions))
    ]
    return [(other if second else one)[position] for _, second, position in sorted(ranked)]
