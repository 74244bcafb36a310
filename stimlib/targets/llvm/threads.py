"""The loop over copies of a program that each of several threads runs.

Its text is compiled from the cache, as ``runtime``.
"""

from stimlib.targets.llvm.instructions import I64
from stimlib.targets.llvm.known import at, i8_at, known, run
from stimlib.targets.llvm.values import Value, exported


@known
def take(w, p):
    """Return the number at p and add one to it, atomically."""
    return Value(w.b.atomic_rmw("add", p.v, I64(1), "monotonic"), "i8", True)


@exported("void", "i8*", "i8", "i8*", "f8*", "i8", "i8", "f8*", "i8", "i8")
def process(contexts, copies, turn, x, motions, of_x, y, of_y, n):
    """Run copies until none is left, for n samples.

    There are so many motions of of_x numbers each, and of_y numbers of each copy's
    outputs.
    """
    k = take(turn)
    while k < copies:
        ctx = i8_at(contexts[k])
        run(ctx[16], ctx, at(x, k % motions * of_x), at(y, k * of_y), n)
        k = take(turn)
