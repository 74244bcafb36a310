"""Linear filters as matrix products of whole blocks of samples: numpy's fastest way to
run them, with memory that is used again.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import signal

from .problem import Signal


def _memory(block: int, kind: type) -> Callable[[np.ndarray], list[np.ndarray]]:
    """Make a function that puts a signal into rows of a block, and has two more such
    arrays.
    """
    kept: dict[int, list[np.ndarray]] = {}

    def rows(x: np.ndarray) -> list[np.ndarray]:
        if x.size not in kept:
            kept[x.size] = [np.zeros((-(-x.size // block), block), kind) for _ in range(3)]
        kept[x.size][0].reshape(-1)[: x.size] = x
        return kept[x.size]

    return rows


def taps(h: np.ndarray, block: int, kind: type) -> Signal:
    """Make a method of taps: a block is the sum of products of itself and of those
    before it.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.products import taps
    >>> taps(np.array([1.0, -1.0, 0.5]), 2, np.float32)(np.arange(5.0))
    array([0. , 1. , 1. , 1.5, 2. ], dtype=float32)
    """
    before = -(-(h.size - 1) // block)
    d = np.arange(block) - np.arange(-before * block, block)[:, None]
    full = np.where((d >= 0) & (d < h.size), h[np.clip(d, 0, h.size - 1)], 0.0).astype(kind)
    own, *past = np.split(full, before + 1)[::-1]
    rows = _memory(block, kind)

    def run(x: np.ndarray) -> np.ndarray:
        z, y, more = rows(x)
        np.matmul(z, own, out=y)
        for k, part in enumerate(past, 1):
            y[k:] += np.matmul(z[:-k], part, out=more[k:])
        return y.reshape(-1)[: x.size]

    return run


def modes(
    e: np.ndarray, r: np.ndarray, direct: float, block: int, carried: type = np.clongdouble
) -> Signal:
    """Make a method of direct delta[n] + Re sum_k r_k (1 - e_k)^n: inside a block its
    answer, and from block to block the modes, as filters of scipy in the type
    ``carried``.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.products import modes
    >>> modes(np.array([1 - 0.5j]), np.ones(1), 0.0, 2)(np.r_[1.0, np.zeros(3)])
    array([ 1.  ,  0.  , -0.25,  0.  ])
    """
    powers = (1 - e[:, None].astype(carried)) ** np.arange(block + 1)
    h = (r @ powers[:, :-1]).real
    h[0] += direct
    d = np.arange(block) - np.arange(block)[:, None]
    own = np.where(d >= 0, h[np.abs(d)], 0.0).astype(float)
    into, out = powers[:, -2::-1].T, r[:, None] * powers[:, 1:]
    into = np.hstack([into.real, into.imag]).astype(float)
    out = np.vstack([out.real, -out.imag]).astype(float)
    rows, one = _memory(block, float), np.ones(1, carried)
    states: dict[int, np.ndarray] = {}

    def run(x: np.ndarray) -> np.ndarray:
        z, y, more = rows(x)
        s = states.setdefault(x.size, np.zeros((len(z), 2 * e.size)))
        new = z[:-1] @ into
        for k, q in enumerate(powers[:, -1]):
            wave = (new[:, k] + 1j * new[:, e.size + k]).astype(carried)
            kept = signal.lfilter(one, np.array([1, -q]), wave)
            s[1:, k], s[1:, e.size + k] = kept.real, kept.imag
        np.matmul(z, own, out=y)
        y += np.matmul(s, out, out=more)
        return y.reshape(-1)[: x.size]

    return run
