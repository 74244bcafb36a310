"""What was before the first sample: 0, or a signal that has always been as there."""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..core.graph import Block, as_block, constant
from ..core.maths import where
from ..errors import BadValue, one_of

# A linear block begins steady by one mechanism, whatever its state is: it is given what
# x moves away from its first value, and its answer to that value, which is its gain at
# 0 Hz, is added.
ONSETS = {"steady": 1.0, "step": 2.0}  # what ``cold`` is before the first sample


# State of `First` between samples.
FirstState = namedtuple("FirstState", "x cold")


@dataclass(frozen=True, eq=False)
class First(Block):
    """The first sample of a signal, held for ever."""

    x: Block
    begins_early = False

    def design(self, fs):
        return (), FirstState(0.0, 1.0)

    def through(self, p, fs, z, H, value):
        return 0.0 * H[0]  # what x does later does not reach it

    @staticmethod
    def step(p, s, x):
        y = where(s.cold > 0.0, x, s.x)
        return y, FirstState(y, 0.0)

    def delay(self, p):
        return math.inf


def check_onset(name: str, onset: str) -> None:
    """Raise BadValue if the onset is unknown."""
    one_of(f"{name}: onset", onset, ONSETS)


def begun(
    name: str,
    x: Any,
    onset: str,
    make: Callable[[Block], Block],
    gain: Callable[[Any], float] = lambda y: 0.0,
) -> Block:
    """Return a linear block of x with the initial state that an onset asks for.

    Parameters
    ----------
    name : str
        Of the public function, for errors.
    x : Block
    onset : {"step", "steady"}
    make : callable
        From a signal to the block.
    gain : callable
        From the block to its gain at 0 Hz; infinite where it answers a constant without
        end.

    Raises
    ------
    BadValue
        An unknown onset; a steady start where there is none.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks.filters import Delay
    >>> from stimlib.blocks.onset import begun
    >>> y = begun(
    ...     "delay",
    ...     stimlib.Input("x"),
    ...     "steady",
    ...     lambda x: Delay(x, 1, None),
    ...     lambda y: 1.0,
    ... )
    >>> stimlib.compile(stimlib.Scene({"y": y}), fs=1000).process(
    ...     np.array([[3.0, 4.0, 5.0]])
    ... )
    array([[3., 3., 4.]])
    """
    check_onset(name, onset)
    x = as_block(x)
    if onset == "step":
        return make(x)
    first = First(x)
    y = make(x - first)
    g = gain(y)
    if not math.isfinite(g):
        raise BadValue(
            f"{name}: the response to a constant grows without end, so there is no steady start;"
            " use"
            " onset='step'"
        )
    return y + first * constant(g, str(y.dim / x.dim)) if g else y
