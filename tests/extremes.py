"""Designs at the ends of every number and sample rate, in a process of its own:
``tests/test_designs.py`` watches it.

``python tests/extremes.py EVERY FIRST`` prints a line before each case and one after:
what came of it.  A case that takes more than SECONDS of processor time ends the process
by SIGPROF, which needs no help from the interpreter.
"""

from __future__ import annotations

import dataclasses as dc
import math
import resource
import signal
import sys
import warnings
from collections.abc import Iterator

import contract
import numpy as np

import stimlib
from stimlib.core import steps
from stimlib.core.graph import Block, reach, signals
from stimlib.errors import StimlibError

SECONDS, BYTES, WORK = 300, 8 << 30, 1e9
RATES = 1e-3, 0.3, 50.0, 8000.0, 1234567.8, 1e9
FLOATS = (
    *(
        0.0,
        -1.0,
        5e-324,
        1e-300,
        1e-12,
        1e-6,
        1e-3,
        0.1,
        1.0,
        10.0,
        1e3,
        1e6,
        1e12,
        1e300,
        sys.float_info.max,
    ),
    *(math.inf, math.nan),
)
WHOLE = 0, -1, 1, 2, 12, 1000, 8192, 10**6, 2**31, 2**63, 2**64 - 1, 2**70
FACTORS = 0.0, -1.0, 1e-300, 1e-6, 0.5, 2.0, 1e6, 1e300


def values(kind: str, v: object) -> Iterator[object]:
    """What a design number is set to."""
    if isinstance(v, np.ndarray):
        with np.errstate(all="ignore"):
            yield from (v * f for f in FACTORS)
        if v.ndim == 1:
            yield from (np.resize(v, 100_000), v[:1])
    elif isinstance(v, float) or "float" in kind:
        yield from FLOATS
    elif not isinstance(v, bool | str) and "int" in kind:
        yield from WHOLE


def cases() -> Iterator[tuple[str, Block, dict[str, object], float]]:
    """Entry, block, what is changed of it, sample rate; equal blocks of two entries
    once.
    """
    seen = set()
    for entry in contract.TABLE:
        for block in reach([entry.block()]):
            numbers = [f for f in dc.fields(block) if f.name not in signals(type(block))]
            changed = [
                {},
                *(
                    {f.name: v}
                    for f in numbers
                    for v in values(str(f.type), getattr(block, f.name))
                ),
            ]
            for change in changed:
                now = {f.name: getattr(block, f.name) for f in numbers} | change
                key = (
                    type(block),
                    repr(
                        {k: v.tobytes() if isinstance(v, np.ndarray) else v for k, v in now.items()}
                    ),
                )
                if key not in seen:
                    seen.add(key)
                    yield from ((entry.name, block, change, fs) for fs in RATES)


def tried(block: Block, change: dict[str, object], fs: float) -> str:
    try:
        made = dc.replace(block, **change)
        p, s = steps.designed(made, fs)
        made.start(p, s, 0)
    except StimlibError as e:
        return "refused" if len(str(e)) < 1500 else f"WRONG: a message of {len(str(e))} letters"
    except Exception as e:
        return f"WRONG: {type(e).__name__}: {e}"
    return "designed"


def compiled(entry: contract.Entry, fs: float, target: str) -> str:
    try:
        stimlib.compile(entry.scene(), fs, target)
    except StimlibError:
        return "refused"
    except Exception as e:
        return f"WRONG: {type(e).__name__}: {e}"
    return "compiled"


if __name__ == "__main__":
    every, first = int(sys.argv[1]), int(sys.argv[2])
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    stimlib.limits.design_work = WORK
    warnings.simplefilter("error", RuntimeWarning)
    todo = [
        (tried, (b, change, fs), (name, type(b).__name__, change, fs))
        for name, b, change, fs in cases()
    ]
    ends = [(e, fs) for e in contract.TABLE for fs in RATES]
    todo += [
        (compiled, (e, fs, "llvm" if every < 100 else "python"), (e.name, fs)) for e, fs in ends
    ]
    for work, given, shown in todo[first::every]:
        print(shown, flush=True)
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        print("->", work(*given), flush=True)
    signal.setitimer(signal.ITIMER_PROF, 0)
    print("done")
