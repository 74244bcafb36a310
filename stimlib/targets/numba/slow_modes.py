"""The long sum of slow modes, of springpots.

Its text is compiled from the cache, as ``runtime``, when a segment needs it.
"""

from numba import cfunc

from stimlib.targets.numba import kernels
from stimlib.targets.numba.intrinsics import MEMORY, at

MOST = kernels.MOST
_leaks, _total = kernels.leaks, kernels.total


@cfunc(MEMORY, cache=True, error_model="numpy")
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
        _leaks(at(e, k), at(r, k), at(q, k), at(low, k), x, w, n, fine, coarse, k == 0)
        k += 8 * (fine + coarse)
    _total(w, y, n)
