"""The mathematics of steps: the definition of each function, with one rounding.

A step may use no other.

``targets/numba/intrinsics.py`` holds, under the same names, what compiled code does;
``tests/test_maths.py`` checks that both give the same bits.  numpy scalars go in and
come out, so that 1/0 is inf and never an exception.

Long sums (a filter's taps, a bank of modes) are **eight partial sums**, index mod 8,
added as ((s0+s4)+(s2+s6)) + ((s1+s5)+(s3+s7)): a definition that single samples, tiles
and vector units can all follow exactly.
"""

from __future__ import annotations

import ctypes
import math
import sys

import numpy as np

TINY = 1e-200
"""Added to what drives a recursion: far below any signal, it keeps a decaying state off
the denormals, at no cost in latency; the output is then flushed, so that silence is 0.
"""

SILENT = 1e-190

F = np.float64

if sys.version_info >= (3, 13):

    def _fma(a, b, c):
        try:
            return math.fma(a, b, c)
        except (OverflowError, ValueError):  # where the C library returns inf or nan
            return a * b + c

else:
    _fma = ctypes.CDLL(None).fma
    _fma.argtypes, _fma.restype = [ctypes.c_double] * 3, ctypes.c_double


def fma(a, b, c):
    """Return a*b + c with one rounding."""
    return F(_fma(float(a), float(b), float(c)))


def sqrt(x):
    """Return the square root; nan below zero."""
    return np.sqrt(F(x))


def floor(x):
    """Return the largest whole number not above x, as a float."""
    return np.floor(F(x))


def _libm(f, pole):
    def g(x):
        x = float(x)
        try:
            return F(f(x))
        except OverflowError:
            return F(np.inf)
        except ValueError:
            return F(pole(x))

    g.__name__, g.__qualname__, g.__doc__ = (
        f.__name__,
        f.__name__,
        f"{f.__name__}(x) of the C library; never raises.",
    )
    return g


def _nan(x):
    return math.nan


exp = _libm(math.exp, _nan)
log = _libm(math.log, lambda x: -math.inf if x == 0 else math.nan)
sin = _libm(math.sin, _nan)
cos = _libm(math.cos, _nan)
tanh = _libm(math.tanh, _nan)


def where(c, a, b):
    """Return a if c else b; both are evaluated."""
    v = a if c else b
    return v if isinstance(v, np.uint64) else F(v)


def flush(x):
    """Return x, or 0 when |x| <= 1e-190: what TINY leaves behind."""
    return F(0.0) if abs(x) <= SILENT else F(x)


def settle(x):
    """Flush what a loop keeps.

    It is compiled as a branch that is hardly ever taken, so that a recursion does not
    wait for it.
    """
    return flush(x)


def as_float(u):
    """Return uint64 to the nearest float64."""
    return F(u)


def bits(x):
    """Return the 64 bits of a float64 as uint64."""
    return F(x).view(np.uint64)


def unbits(u):
    """Return the float64 with these 64 bits."""
    return np.uint64(u).view(F)


def words(a):
    """Return a float64 array's memory as uint64."""
    return a.view(np.uint64)


def each(f, p, x, y):
    """Compute y[i] = f(p, x[0][i], x[1][i], ..) for a straight-line helper f.

    p is a NamedTuple of floats or (). Compiled code computes several at once. An x may
    be y itself, but no part of it.
    """
    for i in range(y.size):
        y[i] = f(p, *(v[i] for v in x))


def pairs(f, key, first, z):
    """Compute z[2 i], z[2 i + 1] = f(key, first + i).

    Compiled code writes on to the next multiple of 4.
    """
    for i in range(0, z.size, 2):
        z[i : i + 2] = f(key, np.uint64(first) + np.uint64(i >> 1))[: z.size - i]


def copy(a, b):
    """Return b[: a.size] = a, for arrays that do not overlap."""
    b[: a.size] = a


def search(knots, x):
    """Return the index i with knots[i] <= x < knots[i+1].

    It is held inside 0 .. size-2 (0 for nan).
    """
    i = 0
    for k in range(1, knots.size - 1):
        i = k if x >= knots[k] else i
    return i


def tree(s):
    """Return the sum of eight partial sums in the one order everything here uses."""
    return ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))


def fir(taps, w, y):
    """Compute y[i] = sum_j taps[j] w[i + j] in eight partial sums.

    taps.size is a multiple of 8; w has y.size + taps.size - 1.
    """
    taps, w = taps.tolist(), w.tolist()  # Python's floats: the same bits, in half the time
    for i in range(y.size):
        s = [0.0] * 8
        for j, tap in enumerate(taps):
            s[j % 8] = _fma(tap, w[i + j], s[j % 8])
        y[i] = tree(s)


def modes(p, r, q, d, x, y, w):
    """Compute q = p q + (x + TINY); y = d x + sum r q, eight partial sums, flushed.

    p.size is a multiple of 8; w: 8 y.size.
    """
    p, r, state = p.tolist(), r.tolist(), q.tolist()
    for i in range(y.size):
        s = [0.0] * 8
        v = float(x[i]) + TINY
        for k, pole in enumerate(p):
            state[k] = _fma(pole, state[k], v)
            s[k % 8] = _fma(r[k], state[k], s[k % 8])
        y[i] = flush(fma(d, x[i], tree(s)))
    q[:] = state


def memory(e, r, q, low, x, y, w):
    """Compute ``modes`` without d, for very slow ones.

    With the leak e = 1 - p on its own, q += (x + TINY) - e q, and a second word of the
    first low.size states, nothing that they add up is rounded away. e.size and low.size
    are multiples of 8; w: 8 y.size.
    """
    leak, r, state, second = e.tolist(), r.tolist(), q.tolist(), low.tolist()
    for i in range(y.size):
        s = [0.0] * 8
        v = float(x[i]) + TINY
        for k in range(len(second)):
            t = _fma(-leak[k], state[k], v) + second[k]
            new = state[k] + t
            second[k] = t - (new - state[k])
            state[k] = new
            s[k % 8] = _fma(r[k], new, s[k % 8])
        for k in range(len(second), len(leak)):
            state[k] = state[k] + _fma(-leak[k], state[k], v)
            s[k % 8] = _fma(r[k], state[k], s[k % 8])
        y[i] = flush(tree(s))
    q[:], low[:] = state, second
