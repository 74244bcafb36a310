"""The blocks that the core defines: arithmetic, loops, and clocks of their own."""

from ..core.graph import constant as constant
from ..core.loops import loop as loop
from ..core.pointwise import (
    clip as clip,
    cos as cos,
    exp as exp,
    log as log,
    maximum as maximum,
    minimum as minimum,
    nonzero as nonzero,
    sin as sin,
    sqrt as sqrt,
    tanh as tanh,
    where as where,
)
from ..core.subsystems import enabled as enabled, segment as segment
