"""Parameters: signals that a program changes while it runs."""

from __future__ import annotations

import dataclasses as dc
from collections import namedtuple

from .graph import Named, stated
from .maths import where

# State of `Param`: its value, its target, and the samples left of a ramp.
#   left  samples of ramp still to go
ParamState = namedtuple("ParamState", "y target left")


@dc.dataclass(frozen=True, eq=False)
class Param(Named):
    """A parameter: a signal that ``Processor.set`` changes, at once or along a ramp.

    Parameters
    ----------
    name : str
    value : float
        Value after reset, in the unit.
    unit : str
        Coherent SI.

    Examples
    --------
    >>> from stimlib import Param
    >>> Param("k", 2000.0, "N/m")
    Param('k', 2000.0, 'N/m')
    """

    value: float
    unit: str = ""
    rests = True

    units = stated

    def design(self, fs):
        return (), ParamState(float(self.value), float(self.value), 0.0)

    @staticmethod
    def tile(p, s, y):
        if s.left > 0.0:
            v, left = s.y, s.left
            for i in range(y.size):
                v = where(left > 1.0, v + (s.target - v) / left, where(left > 0.0, s.target, v))
                left = where(left > 0.0, left - 1.0, 0.0)
                y[i] = v
            return ParamState(v, s.target, left)
        for i in range(y.size):
            y[i] = s.y
        return ParamState(s.y, s.target, 0.0)
