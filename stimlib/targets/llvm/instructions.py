"""Numbers side by side: the instructions of LLVM that vector code is written with.

Vectors of eight are spelled out, so the speed does not hang on the optimiser's mood;
where a processor has shorter ones, LLVM takes several.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from ...core.maths import SILENT

I64, I32, DOUBLE = ir.IntType(64), ir.IntType(32), ir.DoubleType()
V8, TRUTH, BYTES = ir.VectorType(DOUBLE, 8), ir.IntType(1), ir.IntType(8).as_pointer()


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
    return b.call(function(b, f"llvm.{name}.{kind}", t, [t] * len(v)), v)


def function(b, name, result, arguments):
    """Return the function of this name in the module, declared where it is not."""
    found = b.module.globals.get(name)
    return found or ir.Function(b.module, ir.FunctionType(result, arguments), name)


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


# Memory and branches ------------------------------------------------------------------
def room(b, t, size=1):
    """Return memory for some values, which the function has from its start."""
    with b.goto_entry_block():
        return b.alloca(t, I64(size))


def variable(b, v):
    """Return a variable that a loop can change; LLVM keeps it in a register."""
    p = room(b, v.type)
    b.store(v, p)
    return p


def copied(b, to, source, n):
    """Emit a copy of n words."""
    memcpy = b.module.declare_intrinsic("llvm.memcpy", [BYTES, BYTES, I64])
    bytes_of = [b.bitcast(p, BYTES) for p in (to, source)]
    b.call(memcpy, [*bytes_of, b.mul(n, I64(8)), TRUTH(0)])


@contextmanager
def loop(b, start: Any, stop: Any, step: int) -> Iterator[Any]:
    """Emit a loop over whole numbers; the block gets the number of a turn."""
    head, body, end = (b.append_basic_block(name) for name in ("head", "body", "end"))
    before = b.block
    b.branch(head)
    b.position_at_end(head)
    i = b.phi(I64)
    b.cbranch(b.icmp_signed("<" if step > 0 else ">", i, stop), body, end)
    b.position_at_end(body)
    yield i
    i.add_incoming(start, before)
    i.add_incoming(b.add(i, I64(step)), b.block)
    b.branch(head)
    b.position_at_end(end)


def cases(b, number: Any, cases: Mapping[int, Any], body: Callable[[Any], Any]) -> None:
    """Emit a switch that runs body(x) for one of the cases, {number: x}."""
    done = b.append_basic_block("done")
    choice = b.switch(number, done)
    for k, x in cases.items():
        block = b.append_basic_block(f"case{k}")
        choice.add_case(I64(k), block)
        b.position_at_end(block)
        body(x)
        b.branch(done)
    b.position_at_end(done)
