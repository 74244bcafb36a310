"""Linear filters in one loop, compiled by numba: taps, and modes in parallel."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from .problem import Signal


def _tree(terms: list[str]) -> str:
    """A sum in which no term waits for all before it."""
    while len(terms) > 1:
        terms = ["(" + " + ".join(terms[k : k + 2]) + ")" for k in range(0, len(terms), 2)]
    return terms[0]


@cache
def _loop(taps: int, real: int, pairs: int, exact: bool) -> Callable[..., None]:
    """A loop over samples, written out for so many taps and modes; x begins taps - 1
    samples before y.

    Pairs are turned by 1 - e, so that poles next to 1 keep their digits; exact, their
    states keep in a second word what each sum lost.
    """
    from numba import njit

    states = [f"s{k}" for k in range(real)] + [f"{c}{k}" for k in range(pairs) for c in "uv"]
    step = {f"u{k}": f"(v - a{k} * u{k}) + b{k} * v{k}" for k in range(pairs)}
    step |= {f"v{k}": f"-b{k} * u{k} - a{k} * v{k}" for k in range(pairs)}
    terms = [f"h{k} * x[n + {taps - 1 - k}]" for k in range(taps)]
    terms += [f"r{k} * s{k}" for k in range(real)]
    terms += [f"(f{k} * u{k} - g{k} * v{k})" for k in range(pairs)]
    lines = [f"h{k} = h[{k}]" for k in range(taps)]
    lines += [f"p{k} = 1 - e[{k}]; r{k} = r[{k}]" for k in range(real)]
    lines += [f"a{k} = e[{k}].real; b{k} = e[{k}].imag" for k in range(pairs)]
    lines += [f"f{k} = r[{k}].real; g{k} = r[{k}].imag" for k in range(pairs)]
    lines += [f"{s} = l{s} = 0.0" for s in states]
    lines += ["for n in range(y.size):", f" v = x[n + {taps - 1}]"]
    lines += [f" s{k} = p{k} * s{k} + v" for k in range(real)]
    for part in (
        ["d{0} = l{0} + ({1})", "n{0} = {0} + d{0}; l{0} = d{0} - (n{0} - {0})"]
        if exact
        else ["n{0} = {0} + ({1})"]
    ):
        lines += [f" {part.format(s, q)}" for s, q in step.items()]
    lines += [f" {s} = n{s}" for s in step]
    lines += [f" y[n] = {_tree(terms)}"]
    scope: dict[str, Callable[..., None]] = {}
    exec("\n ".join(["def run(x, y, h, e, r):", *lines]), scope)
    return njit(error_model="numpy", fastmath={"contract"} if pairs else True)(scope["run"])


def modes(e: np.ndarray, r: np.ndarray, h: np.ndarray, exact: bool = False) -> Signal:
    """Make a method of h[n] + Re sum_k r_k (1 - e_k)^n, of modes that are all real or
    all complex, with memory that is used again.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.filter_loops import modes
    >>> modes(np.array([0.5]), np.ones(1), np.array([0.0, 1.0]))(
    ...     np.r_[1.0, np.zeros(3)]
    ... )
    array([1.   , 1.5  , 0.25 , 0.125])
    >>> modes(np.array([1 - 0.5j]), np.ones(1), np.zeros(1))(np.r_[1.0, np.zeros(3)])
    array([ 1.  ,  0.  , -0.25,  0.  ])
    """
    pairs = np.iscomplexobj(e)
    run = _loop(h.size, *((0, e.size) if pairs else (e.size, 0)), exact)
    name = complex if pairs else float
    given = (
        tuple(h.astype(float).tolist()),
        tuple(e.astype(name).tolist()),
        tuple(r.astype(name).tolist()),
    )
    memory: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def filtered(x: np.ndarray) -> np.ndarray:
        if x.size not in memory:
            memory[x.size] = np.zeros(h.size - 1 + x.size), np.empty(x.size)
        z, y = memory[x.size]
        if h.size > 1:
            z[h.size - 1 :] = x
        run(z if h.size > 1 else x, y, *given)
        return y

    return filtered


def taps(h: np.ndarray) -> Signal:
    """Make a method of taps, which read the signal where it lies.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.filter_loops import taps
    >>> taps(np.array([1.0, -1.0, 0.5]))(np.arange(5.0))
    array([0. , 1. , 1. , 1.5, 2. ])
    """
    run, given, late = _loop(h.size, 0, 0, False), tuple(h.astype(float).tolist()), h.size - 1
    memory: dict[int, np.ndarray] = {}

    def filtered(x: np.ndarray) -> np.ndarray:
        y = memory.setdefault(x.size, np.empty(x.size))
        y[:late] = np.convolve(x[:late], h)[:late]
        run(x, y[late:], given, (), ())
        return y

    return filtered


@cache
def _pairs(size: int) -> Callable[..., None]:
    """Twelve pairs of taps at a time, for 1024 samples that stay in the cache."""
    from numba import njit

    lines = ["for s in range(0, yy.size, 1024):", " y = yy[s : s + 1024]"]
    lines += [f" x = xx[s : s + {1024 + size - 1}]"]
    for first in range(0, size // 2, 12):
        some = range(first, min(first + 12, size // 2))
        terms = [f"h{k} * (x[n + {size - 1 - k}] - x[n + {k}])" for k in some]
        lines += [f" h{k} = h[{k}]" for k in some]
        lines += [" for n in range(y.size):"]
        lines += [f"  y[n] = {'y[n] + ' if first else ''}{_tree(terms)}"]
    scope: dict[str, Callable[..., None]] = {}
    exec("\n ".join(["def run(xx, yy, h):", *lines]), scope)
    return njit(error_model="numpy", fastmath=True)(scope["run"])


def antisymmetric(h: np.ndarray, kind: type = np.float32) -> Signal:
    """Make a method of taps h[k] = -h[-1 - k]: a product for each pair.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.filter_loops import antisymmetric
    >>> antisymmetric(np.array([1.0, 0.0, -1.0]))(np.arange(5.0) ** 2)
    array([ 0.,  1.,  4.,  8., 12.], dtype=float32)
    """
    run, given, late = _pairs(h.size), tuple(h[: h.size // 2].astype(kind)), h.size - 1
    memory: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def filtered(x: np.ndarray) -> np.ndarray:
        if x.size not in memory:  # half a page apart, or loads wait for stores
            both = np.empty(2 * (x.size + 4096), kind)
            apart = -(-x.size * both.itemsize // 4096) * 4096 + 2048
            memory[x.size] = both[: x.size], both[apart // both.itemsize :][: x.size]
        z, y = memory[x.size]
        z[:] = x
        y[:late] = np.convolve(z[:late], h)[:late]
        run(z, y[late:], given)
        return y

    return filtered
