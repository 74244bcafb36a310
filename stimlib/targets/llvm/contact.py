"""The segment of resettable blocks, which runs another segment while there is contact.

Its text is compiled once and kept, as that of ``runtime``, where a scene has one.
"""

from stimlib.targets.llvm.known import SEGMENT, at, call, move
from stimlib.targets.llvm.values import exported


@exported("void", *SEGMENT)
def stretches(
    numbers,
    states,
    buffers,
    operands,
    size,
    # (contact, first output, outputs, state at rest in P, its words, segment, the
    # segment's own ..)
):
    """Run the segment of a resettable block, one stretch of contact after another."""
    contact, output, cold = (
        at(buffers, operands[0]),
        at(buffers, operands[1]),
        at(states, operands[4] - 1),
    )
    start, found = 0, 0
    for sample in range(size):
        found += contact[sample] > 0.0
    # a tile that is in contact throughout, or not at all, is one stretch: its last
    # sample ends it
    for sample in range(size - 1 if found == 0 or found == size else 0, size):
        touched = contact[sample] > 0.0
        if sample + 1 == size or touched != (contact[sample + 1] > 0.0):
            if touched:
                call(
                    operands[5],
                    numbers,
                    states,
                    at(buffers, start),
                    at(operands, 6),
                    sample + 1 - start,
                )
            else:
                for number in range(operands[2]):
                    for silent in range(64 * number + start, 64 * number + sample + 1):
                        output[silent] = 0.0
                # at rest once, not at each tile without contact
                if cold[0] == 0.0:
                    move(states, at(numbers, operands[3]), operands[4])
            start = sample + 1
