"""The words of a program's table, and of what numpy passes to compiled code."""

from __future__ import annotations

from stimlib.core import pointwise
from stimlib.core.graph import (
    Abs,
    Add,
    AtLeast,
    Block,
    Div,
    Equal,
    Greater,
    Mul,
    Neg,
    NotEqual,
    Sub,
)

# row: address or opcode, P, S, A, clock, autonomous, still (one number as long as no
# parameter moves), whether a row or two outputs read it
OPEN, CLOSE, GATHER, OPERATION, SEGMENT = 1, 2, 3, 16, 4096

OPERATIONS: tuple[type[Block], ...] = (
    Add,
    Sub,
    Mul,
    Div,
    Neg,
    Abs,
    Greater,
    AtLeast,
    Equal,
    NotEqual,
    pointwise.Where,
    pointwise.Maximum,
    pointwise.Minimum,
    pointwise.Sqrt,
    pointwise.Nonzero,
)
"""Blocks that are one operation: the runtime does these itself, without a call."""


C_ORDER, ALIGNED, WRITEABLE = 0x1, 0x100, 0x400  # flags of an array
# bits of word 3 of a type of numbers: kind, letter, order of bytes, not the next,
# number
NUMBERS = -1 ^ (0xFF << 24)
