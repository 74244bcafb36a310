"""The words of a program's table and context, and those of an array of numpy."""

from __future__ import annotations

from stimlib.core import pointwise, silence
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

# a row of the table: the address of a segment or one of the codes below; where its
# numbers, its state and its operands begin in the memory of all rows; its clock;
# whether it runs before sample 0; whether it is one number as long as no parameter
# moves; whether a row or two outputs read it
CODE, NUMBERS_AT, STATE_AT, OPERANDS_AT, CLOCK, AUTONOMOUS, STILL, READ = range(8)
ROW_WORDS = 8
# the codes: those of clocks, then OPERATION + the index of an operation; no address is
# as low as SEGMENT, so that one word tells all kinds apart
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
    silence.Sounding,
    silence.Otherwise,
    silence.RestingMul,
)
"""Blocks that are one operation: the runtime does these itself, without a call."""


# the context: what compiled code knows of one run, an int64 array of these words. First
# the sizes and addresses of tables and memory,
(
    ROWS,  # before those of the outputs, which run when a tile is done
    TABLE,
    NUMBERS,
    STATES,
    BUFFERS,
    OPERANDS,
    INPUTS,
    OUTPUTS,
    OUTPUT_ROWS,  # which operand is the first of the rows that write outputs
    COUNTS,
    TICKS,
    CLOCKS,
) = range(12)
# then what a caller sets: how many clocks run ahead, or -1 for a usual run; parameters
# that wait; what has been done; and what an array of float64 looks like
(
    WARM,
    PENDING,
    PARAMS,
    SEEN,  # samples
    ENTRY,
    STILL_DONE,  # rows that are one number have been run, and no parameter has moved since
    ARRAY_TYPE,
    FLOAT64,
    WARM_CLOCKS,
) = range(12, 21)
CONTEXT_WORDS = 21
# a setting that waits: whether it does (1, or 2: y is set too), where its state
# begins, and what that becomes; a ramp set after a jump at the same sample begins where
# the jump ends
WAITS, PARAM_STATE, TARGET, LEFT, Y = range(5)
SETTING_WORDS = 8


C_ORDER, ALIGNED, WRITEABLE = 0x1, 0x100, 0x400  # flags of an array
# bits of word 3 of a type of numbers: kind, letter, order of bytes, not the next,
# number
DTYPE_BITS = -1 ^ (0xFF << 24)
