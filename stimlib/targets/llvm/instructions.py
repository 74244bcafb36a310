"""Numbers side by side: the instructions of LLVM that vector code is written with.

Vectors of eight are spelled out, so the speed does not hang on the optimiser's mood;
where a processor has shorter ones, LLVM takes several.  ``b`` is the builder, which
writes where it stands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

from llvmlite import ir

from ...core.maths import SILENT

I64, I32, DOUBLE = ir.IntType(64), ir.IntType(32), ir.DoubleType()
V8, TRUTH, BYTES = ir.VectorType(DOUBLE, 8), ir.IntType(1), ir.IntType(8).as_pointer()


def zeros(kind):
    """Return a vector of zeros."""
    return ir.Constant(kind, [0.0] * kind.count)


def load(b, address, first=0):
    """Emit a load of eight float64 numbers, starting at index k."""
    start = b.gep(address, [first if isinstance(first, ir.Value) else I64(first)])
    vector = b.load(b.bitcast(start, V8.as_pointer()))
    vector.align = 8  # that of a number: arrays of callers begin anywhere
    return vector


def store(b, vector, address, first=0):
    """Emit a store of a vector at an index."""
    start = b.gep(address, [first if isinstance(first, ir.Value) else I64(first)])
    b.store(vector, b.bitcast(start, vector.type.as_pointer())).align = 8


def splat(b, number, count=8):
    """Return a vector with one number in all lanes."""
    none = undefined(number.type, count)
    return shuffle(b, b.insert_element(none, number, I32(0)), none, (0,) * count)


def shuffle(b, one, other, lanes):
    """Return selected lanes of two vectors."""
    return b.shuffle_vector(one, other, _numbers(*lanes))


@cache
def undefined(kind, count):
    """Return a vector constant without values, made once so that it is written once."""
    return ir.Constant(ir.VectorType(kind, count), ir.Undefined)


@cache
def _numbers(*lanes):
    return ir.Constant(ir.VectorType(I32, len(lanes)), lanes)


def known(b, name, *given):
    """Emit a call of an LLVM intrinsic on numbers or vectors."""
    own = given[0].type
    kind = "f64" if own == DOUBLE else f"v{own.count}f64"
    return b.call(function(b, f"llvm.{name}.{kind}", own, [own] * len(given)), given)


def function(b, name, result, arguments):
    """Return the function of this name in the module, declared where it is not."""
    found = b.module.globals.get(name)
    return found or ir.Function(b.module, ir.FunctionType(result, arguments), name)


def flush(b, value):
    """Emit maths.flush."""
    limit, zero = (
        ir.Constant(value.type, number if value.type == DOUBLE else [number] * value.type.count)
        for number in (SILENT, 0.0)
    )
    return b.select(b.fcmp_ordered("<=", known(b, "fabs", value), limit), zero, value)


def tree(b, sums):
    """Emit maths.tree for eight values, numbers or vectors."""
    add = b.fadd
    return add(
        add(add(sums[0], sums[4]), add(sums[2], sums[6])),
        add(add(sums[1], sums[5]), add(sums[3], sums[7])),
    )


def across(b, vector):
    """Emit maths.tree across the eight lanes of one vector."""
    while vector.type.count > 1:
        half = vector.type.count // 2
        vector = b.fadd(
            shuffle(b, vector, vector, list(range(half))),
            shuffle(b, vector, vector, list(range(half, 2 * half))),
        )
    return b.extract_element(vector, I32(0))


# Memory and branches ------------------------------------------------------------------
def room(b, kind, size=1):
    """Return memory for some values, which the function has from its start."""
    # in a loop, each turn would take more of the stack
    with b.goto_entry_block():
        return b.alloca(kind, I64(size))


def variable(b, value):
    """Return a variable that a loop can change; LLVM keeps it in a register."""
    memory = room(b, value.type)
    b.store(value, memory)
    return memory


def copied(b, to, source, count):
    """Emit a copy of n words."""
    memcpy = b.module.declare_intrinsic("llvm.memcpy", [BYTES, BYTES, I64])
    bytes_of = [b.bitcast(address, BYTES) for address in (to, source)]
    b.call(memcpy, [*bytes_of, b.mul(count, I64(8)), TRUTH(0)])


@contextmanager
def loop(b, start: Any, stop: Any, step: int) -> Iterator[Any]:
    """Emit a loop over whole numbers; the block gets the number of a turn."""
    # the test stands in front, because stop may be 0
    head, body, end = (b.append_basic_block(name) for name in ("head", "body", "end"))
    before = b.block
    b.branch(head)
    b.position_at_end(head)
    turn = b.phi(I64)
    b.cbranch(b.icmp_signed("<" if step > 0 else ">", turn, stop), body, end)
    b.position_at_end(body)
    yield turn
    turn.add_incoming(start, before)
    turn.add_incoming(b.add(turn, I64(step)), b.block)
    b.branch(head)
    b.position_at_end(end)


def cases(b, number: Any, cases: Mapping[int, Any], body: Callable[[Any], Any]) -> None:
    """Emit a switch that runs body(given) for one of the cases, {number: given}."""
    done = b.append_basic_block("done")
    choice = b.switch(number, done)
    for case, given in cases.items():
        block = b.append_basic_block(f"case{case}")
        choice.add_case(I64(case), block)
        b.position_at_end(block)
        body(given)
        b.branch(done)
    b.position_at_end(done)
