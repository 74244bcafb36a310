"""Gates with two thresholds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import units as un
from ..core.graph import NONE, ONE, Block, as_block, positive
from ..core.maths import where
from ..errors import BadValue, public
from .impedance import Velocity, step_peak


class GateParams(NamedTuple):
    on: float
    off: float


class GateState(NamedTuple):
    g: float


class Gate(Block, abstract=True):
    """1 from where x rises above ``on`` until it falls to ``off`` or below, else 0."""

    def units(self, *u):
        return un.ONE

    @staticmethod
    def tile(p, s, x, y):
        # a state may come from anywhere
        g, above_on, above_off = where(s.g > 0.0, 1.0, 0.0), NONE, NONE
        for i in range(y.size):
            above_on = above_on + where(x[i] > p.on, ONE, NONE)
            above_off = above_off + where(x[i] > p.off, ONE, NONE)
        # nothing changes
        if (g > 0.0 and above_off == np.uint64(y.size)) or (g == 0.0 and above_on == NONE):
            for i in range(y.size):
                y[i] = g
            return GateState(g)
        for i in range(y.size):
            g = where(x[i] > where(g > 0.0, p.off, p.on), 1.0, 0.0)
            y[i] = g
        return GateState(g)


@dataclass(frozen=True, eq=False)
class Hysteresis(Gate):
    """A gate with two given thresholds."""

    x: Block
    on: float
    off: float

    def check(self):
        if not self.off <= self.on:
            raise BadValue(f"hysteresis: off = {self.off:g} must not be above on = {self.on:g}")

    def design(self, fs):
        return GateParams(self.on, self.off), GateState(0.0)


@public
def hysteresis(x: Block | float, on: float, off: float) -> Block:
    """A gate that noise does not make chatter (a Schmitt trigger): it opens above one
    threshold and closes at another.

    Parameters
    ----------
    x : Block
    on, off : float
        In the unit of x: open from where x rises above ``on`` until it falls to ``off``
        or below.

    Returns
    -------
    Block
        0 or 1, without unit; closed at first.

    Raises
    ------
    BadValue
        off above on.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import hysteresis
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"g": hysteresis(stimlib.Input("x"), on=1.0, off=-1.0)}),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[0.0, 2.0, 0.5, -0.5, -1.0, 0.5]]))
    array([[0., 1., 1., 1., 0., 0.]])
    """
    return Hysteresis(as_block(x), on, off)


@dataclass(frozen=True, eq=False)
class Loading(Gate):
    """The gate of a loading velocity."""

    v: Block
    on: float | None
    off: float | None
    resolution: float

    def check(self):
        positive(self, "resolution")
        if (self.on is None) != (self.off is None):
            raise BadValue("loading: give both thresholds, on and off, or none")
        if self.on is not None and self.off is not None and not 0 < self.off < self.on:
            raise BadValue(
                f"loading: thresholds must be 0 < off < on, got off = {self.off}, on = {self.on}"
            )
        if self.on is None and not isinstance(self.v, Velocity):
            raise BadValue(
                f"loading: thresholds follow from the filter of velocity(x, cutoff); for {self.v!r}"
                " give on and off"
            )

    def design(self, fs):
        on, off = self.on, self.off
        if on is None or off is None:
            assert isinstance(self.v, Velocity)
            off = 2 * self.resolution * step_peak(self.v.cutoff, fs)
            on = 2 * off
        return GateParams(on, off), GateState(0.0)


@public
def loading(
    v: Block, on: float | None = None, off: float | None = None, resolution: float = 1e-6
) -> Block:
    """1 during loading (compression increasing), else 0, with two thresholds on the
    velocity.

    Parameters
    ----------
    v : Block
        Velocity, positive in the direction of compression.
    on, off : float, optional
        The gate opens above ``on`` and closes at ``off``, in the unit of v.  Default:
        from the encoder's resolution q and the impulse response h of ``velocity``: off
        = 2 q max|h|, on = 2 off, so that a held position that toggles between
        neighbouring codes stays silent.
    resolution : float
        Encoder step q in the unit of position; used only for the default.

    Returns
    -------
    Block
        0 or 1, without unit.

    Raises
    ------
    BadValue
        Not 0 < off < on; default thresholds for something that is not ``velocity(..)``.

    References
    ----------
    The UGrip paper, eq. (2): "nonzero only during loading"; section 2.1: encoder
    resolution 1 um.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import loading
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"g": loading(stimlib.Input("v", "m/s"), on=0.2, off=0.1)}),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[0.15, 0.25, 0.15, 0.05]]))
    array([[0., 1., 1., 0.]])
    """
    return Loading(v, on, off, resolution)
