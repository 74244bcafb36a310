"""What ``enabled`` and ``segment`` skip: the samples at which a clock ticks.

Each clock has a number of samples in each tile, and their numbers (``ticks``). The row
of a gate, OPEN, counts and gathers them before any row of its clock. Those rows run for
so many samples, side by side as if there were no others, and not at all if there are
none: their states stay, and no time is spent. A row CLOSE then puts the samples back
between zeros, and GATHER takes those of a parameter or an input, which have all.
``runtime.entry`` has these two among its rows.
"""

from stimlib.targets.llvm.known import at, move


def open_clock(buffers, operands, every, up, down, counts, size):  # operands: (slot of by, child)
    """Gather the samples at which a gate is open.

    down gets their numbers in the parent's tile, and behind these in the root's.
    """
    gate = at(buffers, operands[0])
    # counted first: a gate is mostly open or shut for a whole tile, which takes no
    # gathering
    found = 0
    for sample in range(size):
        found += gate[sample] > 0.0
    counts[operands[1]] = found
    if found == size:
        move(down, every, size)
        move(at(down, 64), up, size)
    elif found > 0:
        found = 0
        for sample in range(size):
            if gate[sample] > 0.0:
                down[found], down[64 + found] = sample, up[sample]
                found += 1
