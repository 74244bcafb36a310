"""The segment of resettable blocks, which runs another segment while there is contact.

Its text is compiled from the cache, as ``runtime``, when a scene has such a block.
"""

from stimlib.targets.llvm.known import SEGMENT, at, call, move
from stimlib.targets.llvm.values import exported


@exported("void", *SEGMENT)
def stretches(
    P,
    S,
    W,
    w,
    k,
    # w = (contact, first output, outputs, state at rest in P, its words, segment, the
    # segment's own ..)
):
    """Run the segment of a resettable block, one stretch of contact after another."""
    by, y, cold = at(W, w[0]), at(W, w[1]), at(S, w[4] - 1)
    start, n = 0, 0
    for i in range(k):
        n += by[i] > 0.0
    for i in range(k - 1 if n == 0 or n == k else 0, k):
        on = by[i] > 0.0
        if i + 1 == k or on != (by[i + 1] > 0.0):
            if on:
                call(w[5], P, S, at(W, start), at(w, 6), i + 1 - start)
            else:
                for o in range(w[2]):
                    for j in range(64 * o + start, 64 * o + i + 1):
                        y[j] = 0.0
                if cold[0] == 0.0:
                    move(S, at(P, w[3]), w[4])
            start = i + 1
