"""The core: blocks, their arithmetic, units, steps, loops, scenes and programs."""

from . import pointwise as pointwise  # numpy's functions on blocks
