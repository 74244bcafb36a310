"""Registration of the laws of blocks on their input rows, and shared helpers.

``families`` has the laws, in plain numpy: nothing of a block's design or step is used.
``LAWS`` has a function for each class; ``linear`` enters those of linear blocks.  It
takes the block, the sample rate in Hz, the rows of its input signals and the row that
was seen, from where the block began (``Rows.rest``) or from any later sample on.  It
returns the row that this should be, and how far from it a correct one may be; or None
where the law does not cover the block's numbers.  A block of several outputs has
several rows.  Most laws use what was seen only where a rounding decides, or for the
sample before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from . import laws

Row = np.ndarray


class Rows(list[Row]):
    """The rows of a block's input signals."""

    at = 0  # the sample that they begin with, below 0 where the block begins before sample 0
    rest = True  # whether the block began there
    seed = 0  # of the run
    past: int = 0  # what ``SUMS`` makes of all samples before, from sample 0 on


Law = Callable[[Any, float, Rows, Row], tuple[Row, Any] | None]
LAWS: dict[str, Law] = {}
SINCE: dict[str, Callable[[Any, float, Rows], float] | float] = {}
"""By the name of a class."""
FADED = 48.0  # time constants, after which 1e-21 of a state is left
ULP = 2.0**-52
TIE = 1e-9  # of a place: so near to an edge either side is right


def law(
    *names: str, since: Callable[[Any, float, Rows], float] | float = math.inf
) -> Callable[[Law], Law]:
    """Register a law for the classes with these names.

    ``since`` is the number of samples that the law must have seen of a block that
    started before them.
    """

    def enter(f: Law) -> Law:
        LAWS.update(dict.fromkeys(names, f))
        SINCE.update(dict.fromkeys(names, since))
        return f

    return enter


def since(b: Any, fs: float, x: Rows) -> int:
    """Return the first sample that a law covers, for a block that started earlier.

    Never is 2^62.
    """
    first = SINCE.get(type(b).__name__, math.inf)
    with np.errstate(all="ignore"):
        n = first(b, fs, x) if callable(first) else first
    return math.ceil(n) if n < 2.0**62 else 1 << 62


def near(want: Row, tol: float = 1e-12) -> tuple[Row, float]:
    """Return a row, and a tolerance relative to its largest value."""
    return want, tol * float(np.abs(want[np.isfinite(want)]).max(initial=1e-300))


def touched(contact: Row) -> Iterator[slice]:
    """Yield each stretch of contact."""
    on = np.r_[False, contact > 0, False]
    for a, b in zip(
        np.flatnonzero(on[1:] & ~on[:-1]), np.flatnonzero(on[:-1] & ~on[1:]), strict=True
    ):
        yield slice(a, b)


def begun(x: Rows, tol: Any) -> Any:
    """Return a tolerance that is infinite where a contact began before the stretch."""
    known = x.rest | (np.cumsum(np.diff(x[-1] > 0, prepend=x[-1][:1] > 0) & (x[-1] > 0)) > 0)
    return np.where(known, tol, np.inf)


def before(x: Row, contact: Row) -> Row:
    """Return the position before each sample.

    At the first sample of a contact it is the position of that sample.
    """
    return laws.ways(x, contact)[0]


def sample_of(t: Row, fs: float) -> Row:
    """Return the number of the sample at each time."""
    return np.rint(t * fs).astype(np.int64)


def turning(freq: Row, fs: float) -> Row:
    """Return the phase increment of each sample in units of 2^-64 turns.

    The remainders of two divisions are exact.
    """
    f, turns = np.clip(np.nan_to_num(freq), 0, fs / 2), np.zeros(freq.size, np.uint64)
    for _ in range(2):
        rest = np.fmod(2.0**32 * f, fs)
        turns = (turns << 32) + np.rint((2.0**32 * f - rest) / fs).astype(np.uint64)
        f = rest
    return turns + (2 * f >= fs)


SUMS = {"Carrier": turning, "Oscillator": turning, "PulseTrain": turning}
"""What is added up of a block's first row before a stretch that begins later."""
