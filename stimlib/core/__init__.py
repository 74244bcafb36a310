"""The language: blocks and their arithmetic, units, steps, loops, scenes and the program
that a scene is lowered to.
"""

from . import pointwise as pointwise  # numpy's functions on blocks
