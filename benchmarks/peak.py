"""The peak throughput of a core: independent fused multiply-adds (FMA) in float64.

The time that this loop takes for the number of operations of a chain is the lower limit
for the chain; additional time is due to loads, stores, latency and loops.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

from timing import fastest

# vectors that are added to at once: enough to hide the latency of two units, and they
# fit into 16 registers
SUMS = 12
LANES = (2, 4, 8)  # float64 in a vector of 128, 256 and 512 bits


def peak(count: float) -> Callable[[], float]:
    """Return a job of a given number of independent FMAs in float64 on one core.

    It uses the vector width that is fastest on this machine.

    Parameters
    ----------
    count : float
        Number of FMAs (a multiply and an add each), rounded up to whole vectors of all
        sums.

    Returns
    -------
    callable
        A function without arguments; its result only keeps the compiler from skipping
        work.
    """
    return _job(_width(), count)


@cache
def _width() -> int:
    """Return the vector width, in lanes, with the highest throughput."""
    return int(fastest({str(lanes): _job(lanes, 2e7) for lanes in LANES}))


def _job(lanes: int, count: float) -> Callable[[], float]:
    run, turns = _loop(lanes), int(-(-count // (lanes * SUMS)))
    return lambda: run(turns)


@cache
def _loop(lanes: int) -> Callable[[int], float]:
    """Return a compiled loop of FMAs over SUMS independent vectors."""
    from llvmlite import ir

    from stimlib.targets.llvm import machine, walk
    from stimlib.targets.llvm.instructions import I32, I64, function
    from stimlib.targets.llvm.values import Known, Value

    vector = ir.VectorType(ir.DoubleType(), lanes)

    def sums(w: Any, n: Value) -> Value:
        b = w.b
        # towards 1: never slow, never lost
        factor, term = (ir.Constant(vector, [x] * lanes) for x in (0.999, 0.001))
        fma = function(b, f"llvm.fma.v{lanes}f64", vector, [vector] * 3)
        before, loop, done = b.block, b.append_basic_block("turn"), b.append_basic_block("done")
        b.branch(loop)
        b.position_at_end(loop)
        i, old = b.phi(I64), [b.phi(vector) for _ in range(SUMS)]
        new = [b.call(fma, [x, factor, term]) for x in old]
        after = b.add(i, I64(1))
        i.add_incoming(I64(0), before)
        i.add_incoming(after, loop)
        for k, x in enumerate(old):
            # each its own, or they would be one
            x.add_incoming(ir.Constant(vector, [k + 2.0] * lanes), before)
            x.add_incoming(new[k], loop)
        b.cbranch(b.icmp_signed("<", after, n.v), loop, done)
        b.position_at_end(done)
        total = new[0]
        for x in new[1:]:
            total = b.fadd(total, x)
        return Value(b.extract_element(total, I32(0)), "f8")

    source, of = "def run(n):\n    return sums(n)\n", {"run": ("f8", "i8")}
    text = walk.of_source(source, {"sums": Known(sums)}, of, {}).llvm
    code, _ = machine.machine_code(text, ours=False)
    address = machine.addresses(code, ["run"])["run"]
    return ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_int64)(address)
