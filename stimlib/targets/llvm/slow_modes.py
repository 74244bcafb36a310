"""The long sum of slow modes, of springpots.

Its text is compiled from the cache, as ``runtime``, when a segment needs it.
"""

from functools import partial

from stimlib.targets.llvm import kernels
from stimlib.targets.llvm.known import CHEBYSHEV, MEMORY, at, of
from stimlib.targets.llvm.values import exported

MOST = kernels.MOST
_leaks, _moving_leaks = (of(partial(kernels.leaks, moving=m)) for m in (False, True))
_total, _chebyshev = of(kernels.total), of(kernels.chebyshev)


@exported("void", *MEMORY)
def memory(e, r, q, low, size, lows, x, w, y, n):
    """Compute a bank of slow modes, whose states have second words."""
    k = 0
    if size == 0:
        for i in range(8 * n):
            w[i] = 0.0
    while k < size:
        fine, coarse = (lows - k) >> 3, 0
        if fine > MOST:
            fine = min(MOST, (fine + 1) >> 1)
        else:
            fine = max(fine, 0)
            coarse = min(MOST, ((size - k) >> 3) - fine)
        _leaks(at(e, k), at(r, k), at(q, k), at(low, k), x, w, n, fine, coarse, k == 0, size)
        k += 8 * (fine + coarse)
    _total(w, y, n)


@exported("void", *MEMORY)
def moving_memory(e, r, q, low, size, lows, x, w, y, n):
    """Compute a bank of slow modes, with weights for each sample."""
    k = 0
    while k < size:
        fine = min(MOST, max(0, (lows - k) >> 3))
        coarse = 0 if fine > 0 else min(MOST, (size - k) >> 3)
        _moving_leaks(at(e, k), at(r, k), at(q, k), at(low, k), x, w, n, fine, coarse, k == 0, size)
        k += 8 * (fine + coarse)
    _total(w, y, n)


@exported("void", *CHEBYSHEV)
def chebyshev(c, terms, t, y, m, n):
    """Compute m Chebyshev series at n numbers."""
    _chebyshev(c, terms, t, y, m, n)
