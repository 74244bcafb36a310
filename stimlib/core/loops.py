"""Feedback loops: expressions that use their own value of one sample ago."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..errors import BadValue, UnitError, public
from .graph import Block, Const, as_block, stated


# a node of the graph that names no source: the loop around it does, so that the graph
# itself stays without a circle
@dataclass(frozen=True, eq=False)
class Last(Block):
    """The value of a loop one sample ago; at the first sample, the value ``first``.

    It belongs to one ``Loop``.
    """

    first: float
    unit: str = ""
    sign = "last"
    # a counter driven by noise would not begin at 1, if it ran before sample 0
    begins_early = False

    units = stated


# body and last are both inputs of it: whoever walks the graph meets both
@dataclass(frozen=True, eq=False)
class Loop(Block):
    """The signal that a function computes from its own last value; see ``loop``."""

    body: Block
    last: Block

    def check(self):
        if not isinstance(self.last, Last):
            raise BadValue(f"a loop needs its Last, not {self.last!r}")

    def units(self, *inputs):
        # a literal 0 has any unit, as in sums
        if inputs[0] != inputs[1] and not (isinstance(self.body, Const) and self.body.value == 0):
            raise UnitError(
                f"loop: from a last value in [{inputs[1]}] it computes {self.body!r} in"
                f' [{inputs[0]}]; give unit="{inputs[0]}"'
            )
        return inputs[1]


# without the loop as its input, a signal from inside would be computed without it
@dataclass(frozen=True, eq=False)
class Tap(Block):
    """Another signal taken from inside a loop."""

    loop: Block
    inner: Block

    def check(self):
        if not isinstance(self.loop, Loop):
            raise BadValue(f"a tap needs its Loop, not {self.loop!r}")

    def units(self, *inputs):
        return inputs[1]


@public
def loop(f: Callable[[Block], Any], start: float = 0.0, unit: str = "") -> Any:
    """Make a feedback loop, y[n] = f(y[n-1], other signals).

    Parameters
    ----------
    f : callable
        Called once, with the signal's last value.  Returns the signal, or a tuple: the
        signal, and other signals from inside.
    start : float
        y[-1], in the unit.  A loop begins at sample 0, whatever is in it.
    unit : str
        Of the signal, coherent SI.

    Returns
    -------
    Block, or tuple of Block
        What f returned.

    Raises
    ------
    UnitError
        If f makes another unit of the last value: y[n] and y[n-1] are one signal.
    BadValue
        If f returns no block, or nothing; if start is not a finite number.
    SceneError
        In ``Scene``: an ``enabled`` that depends on the last value; the last value
        where its loop is not.

    Notes
    -----
    What is on the way from the last value to the signal runs sample by sample, as one
    block: a sum of a hundred taps is slower there than outside.  All else stays
    outside.  A value fed back that has decayed to 1e-250 is 0 from then on.

    Examples
    --------
    A low-pass of one pole:

    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import loop
    >>> x = stimlib.Input("x")
    >>> y = loop(lambda last: last + 0.5 * (x - last))
    >>> stimlib.compile(stimlib.Scene({"y": y}), fs=1000).process(np.ones((1, 4)))
    array([[0.5   , 0.75  , 0.875 , 0.9375]])
    """
    # called once, now, with a placeholder: what the function does is recorded as a
    # graph, as all arithmetic on blocks is
    last = Last(start, unit)
    returned = f(last)
    # one signal comes back as a block, several as a tuple, as the function returned
    # them
    if not isinstance(returned, tuple):
        return Loop(as_block(returned), last)
    if not returned:
        raise BadValue("loop: the function must return a signal")
    looped = Loop(as_block(returned[0]), last)
    return looped, *(Tap(looped, as_block(signal)) for signal in returned[1:])
