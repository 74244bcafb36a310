"""The long sum of slow modes, of springpots.

Its text is compiled once and kept, as that of ``runtime``, when a segment needs it.
"""

from functools import partial

from stimlib.targets.llvm import kernels
from stimlib.targets.llvm.known import CHEBYSHEV, MEMORY, at, of
from stimlib.targets.llvm.values import exported

MOST = kernels.MOST
_leaks, _moving_leaks = (of(partial(kernels.leaks, moving=m)) for m in (False, True))
_total, _chebyshev = of(kernels.total), of(kernels.chebyshev)


@exported("void", *MEMORY)
def memory(leaks, weights, states, low, size, lows, signal, sums, output, count):
    """Compute a bank of slow modes, whose states have second words."""
    first = 0
    if size == 0:
        for i in range(8 * count):
            sums[i] = 0.0
    while first < size:
        # in passes of groups that run in each other's latency, those with a second word
        # first. More of these than a pass holds are halved: of six, five and one would
        # leave the one with nothing beside it.
        fine, coarse = (lows - first) >> 3, 0
        if fine > MOST:
            fine = min(MOST, (fine + 1) >> 1)
        else:
            fine = max(fine, 0)
            coarse = min(MOST, ((size - first) >> 3) - fine)
        _leaks(
            at(leaks, first),
            at(weights, first),
            at(states, first),
            at(low, first),
            signal,
            sums,
            count,
            fine,
            coarse,
            first == 0,
            size,
        )
        first += 8 * (fine + coarse)
    _total(sums, output, count)


@exported("void", *MEMORY)
def moving_memory(leaks, weights, states, low, size, lows, signal, sums, output, count):
    """Compute a bank of slow modes, with weights for each sample."""
    # no kinds mixed: a sample has weights of its own, which are read from memory, where
    # fixed ones stay in registers (one kernel for both made those 11 % slower)
    first = 0
    while first < size:
        fine = min(MOST, max(0, (lows - first) >> 3))
        coarse = 0 if fine > 0 else min(MOST, (size - first) >> 3)
        _moving_leaks(
            at(leaks, first),
            at(weights, first),
            at(states, first),
            at(low, first),
            signal,
            sums,
            count,
            fine,
            coarse,
            first == 0,
            size,
        )
        first += 8 * (fine + coarse)
    _total(sums, output, count)


@exported("void", *CHEBYSHEV)
def chebyshev(coefficients, terms, numbers, values, series, count):
    """Compute m Chebyshev series at n numbers."""
    _chebyshev(coefficients, terms, numbers, values, series, count)
