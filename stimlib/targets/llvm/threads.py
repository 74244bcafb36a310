"""The loop over copies of a program that each of several threads runs.

Its text is compiled once and kept, as that of ``runtime``.
"""

from stimlib.targets.llvm import rows
from stimlib.targets.llvm.instructions import I64
from stimlib.targets.llvm.known import at, i8_at, known, run
from stimlib.targets.llvm.values import Value, exported


@known
def take(walk, address):
    """Return the number at an address and add one to it, atomically."""
    return Value(walk.b.atomic_rmw("add", address.v, I64(1), "monotonic"), "i8", True)


@exported("void", "i8*", "i8", "i8*", "f8*", "i8", "i8", "f8*", "i8", "i8")
def process(contexts, copies, turn, motion, motions, per_motion, output, per_copy, count):
    """Run copies until none is left, for count samples.

    There are so many motions of per_motion numbers each, and per_copy numbers of each
    copy's outputs.
    """
    # who is ready takes the next: parallel loops divide the copies in advance, so that
    # one with an open gate delays all others of its share
    copy = take(turn)
    while copy < copies:
        ctx = i8_at(contexts[copy])
        run(
            ctx[rows.ENTRY],
            ctx,
            at(motion, copy % motions * per_motion),
            at(output, copy * per_copy),
            count,
        )
        copy = take(turn)
