"""Mathematics for steps: the definition of each function, with a single rounding.

A step may use no other.

``targets/llvm/known.py`` holds what compiled code does instead;
``tests/test_maths.py`` checks that both give the same bits.  numpy scalars go in and
come out, so that 1/0 is inf and never an exception.

Long sums (a filter's taps, a bank of modes) are **eight partial sums**, index mod 8,
added as ((s0+s4)+(s2+s6)) + ((s1+s5)+(s3+s7)): a definition that single samples, tiles
and vector units can all follow exactly.
"""

from __future__ import annotations

import ctypes
import fractions
import functools
import math
import struct
import sys
import types

import numpy as np

TINY = 1e-260
"""Added to what drives a recursion: far below any signal, it keeps a decaying state off
the denormals, at no cost in latency; the output is then flushed, so that silence is 0.
"""

SILENT = 1e-250
"""What an output of a recursion counts as 0.  Both are as low as the second words of
states, down to 2^-106 of them, allow without denormals.
"""

F = np.float64


def _exact_fma(a, b, c):
    """Return a*b + c with one rounding, computed with exact fractions."""
    if not (math.isfinite(a) and math.isfinite(b)):
        return a * b + c
    if not math.isfinite(c):
        return c
    exact = fractions.Fraction(a) * fractions.Fraction(b) + fractions.Fraction(c)
    if exact == 0:  # of which sign, only the floats know
        return a * b + c if a == 0 or b == 0 or c == 0 else 0.0
    try:
        return float(exact)
    except OverflowError:
        return math.inf if exact > 0 else -math.inf


if sys.version_info >= (3, 13):

    def _fma(a, b, c):
        try:
            return math.fma(a, b, c)
        except (OverflowError, ValueError):  # where the C library returns inf or nan
            return _exact_fma(a, b, c)

else:

    def _c_fma():
        try:
            f = ctypes.PyDLL(None).fma  # which keeps Python's lock: a tenth faster
        except TypeError:  # Windows
            return _exact_fma
        f.argtypes, f.restype = [ctypes.c_double] * 3, ctypes.c_double
        return f

    _fma = _c_fma()


def fma(a, b, c):
    """Return a*b + c with one rounding."""
    return F(_fma(float(a), float(b), float(c)))


def sqrt(x):
    """Return the square root; NaN below zero."""
    return np.sqrt(F(x))


def floor(x):
    """Return the largest whole number not above x, as a float."""
    return np.floor(F(x))


def where(c, a, b):
    """Return a if c else b; both are evaluated."""
    v = a if c else b
    return v if isinstance(v, np.uint64) else F(v)


def flush(x):
    """Return x, or 0 where |x| <= 1e-250.

    So what TINY leaves behind counts as 0.
    """
    return F(0.0) if abs(x) <= SILENT else F(x)


def settle(x):
    """Flush the state of a loop to 0 where it is too small to matter.

    It is compiled as a branch that is hardly ever taken, so that a recursion does not
    wait for it.
    """
    return flush(x)


def as_float(u):
    """Convert a uint64 to the nearest float64."""
    if isinstance(u, float):
        raise TypeError("as_float converts a np.uint64, not a float")
    return F(np.uint64(u))


def bits(x):
    """Return the 64 bits of a float64 as uint64."""
    return F(x).view(np.uint64)


def unbits(u):
    """Return the float64 with these 64 bits."""
    if isinstance(u, float):
        raise TypeError("unbits takes the bits of a float as np.uint64, not a float")
    return np.uint64(u).view(F)


def words(a):
    """Return a float64 array's memory as uint64."""
    return a.view(np.uint64)


def each(f, p, x, y):
    """Compute y[i] = f(p, x[0][i], x[1][i], ..) for a straight-line helper f.

    p is a NamedTuple of floats or (). Compiled code computes several elements at once.
    An x may be y itself, but must not overlap it partly.
    """
    for i in range(y.size):
        y[i] = f(p, *(v[i] for v in x))


def pairs(f, key, first, z):
    """Compute pairs of outputs z[2 i], z[2 i + 1] = f(key, first + i).

    Compiled code writes up to the next multiple of 4.
    """
    for i in range(0, z.size, 2):
        z[i : i + 2] = f(key, np.uint64(first) + np.uint64(i >> 1))[: z.size - i]


def series(f, p, s, x, y):
    """Run stages in series: y[i] is x[i] after it went through all of them in turn.

    A straight-line helper f(p, s, x) returns a stage's output and its new state. p and
    s are NamedTuples; each array of them has one element per stage, and f gets that
    of its stage. All fields of s are arrays, of at least one element. Compiled
    code runs the stages side by side, each one sample behind the one before. x may be y
    itself, but must not overlap it partly.
    """
    if not s[0].size:
        raise ValueError("series needs at least one stage: the arrays of the state are empty")
    for i in range(y.size):
        y[i] = x[i]
        for k in range(s[0].size):
            own = type(p)(*(u[k] if isinstance(u, np.ndarray) else u for u in p))
            made = f(own, type(s)(*(u[k] for u in s)), y[i])
            if not (type(made) is tuple and len(made) == 2 and type(made[1]) is type(s)):
                raise TypeError(
                    f"a stage of series must return its output and the new state"
                    f" {type(s).__name__}(..), and returned {made!r:.80}"
                )
            y[i] = made[0]
            for u, w in zip(s, made[1], strict=True):
                u[k] = w


def copy(a, b):
    """Copy a into the start of b: b[: a.size] = a, without overlap."""
    b[: a.size] = a


def search(knots, x, per):
    """Return the index i with knots[i] <= x < knots[i+1].

    It is limited to 0 .. size-2 (0 for NaN).  ``per``, pieces in a unit of x, is above
    0 if a product finds the piece (``tables.evenness``): it changes the time alone.
    """
    i = 0
    for k in range(1, knots.size - 1):
        i = k if x >= knots[k] else i
    return i


def quotient(n, i, by, inverse):
    """Return (n + i) / by of a whole number n below 2^52 in magnitude, and an index i.

    inverse, 1 / by, is above 0 if by is a whole number up to 2^32, so that products can
    take the place of the division: it changes the time alone.
    """
    return (n + float(i)) / by


def tree(s):
    """Return the sum of eight partial sums, in the order that every target uses."""
    return ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))


def _eights(a, least=0):
    """Return the numbers of an array; ValueError where vectors pass its ends."""
    if a.size % 8 or a.size < least:
        raise ValueError(f"give a multiple of 8, not {a.size}: fill up with zeros")
    return a.tolist()


def fir(taps, w, y):
    """Compute an FIR filter, y[i] = sum_j taps[j] w[i + j], in eight partial sums.

    taps.size must be a multiple of 8; w has y.size + taps.size - 1 elements.
    """
    taps, w = _eights(taps), w.tolist()  # Python's floats: the same bits, in half the time
    for i in range(y.size):
        s = [0.0] * 8
        for j, tap in enumerate(taps):
            s[j % 8] = _fma(tap, w[i + j], s[j % 8])
        y[i] = tree(s)


def modes(p, r, q, d, x, y, w):
    """Compute a bank of modes, q = p q + (x + TINY) and y = d x + sum r q.

    The sum is in eight partial sums and flushed. p.size must be a multiple of 8, not 0;
    w has 8 y.size elements.
    """
    p, r, state = _eights(p, 8), r.tolist(), q.tolist()
    for i in range(y.size):
        s = [0.0] * 8
        v = float(x[i]) + TINY
        for k, pole in enumerate(p):
            state[k] = _fma(pole, state[k], v)
            s[k % 8] = _fma(r[k], state[k], s[k % 8])
        y[i] = flush(fma(d, x[i], tree(s)))
    q[:] = state


def memory(e, r, q, low, x, y, w):
    """Compute a bank of very slow modes, without the direct term of ``modes``.

    The leak e = 1 - p is given directly, q += (x + TINY) - e q, and the first low.size
    states have a second word, so nothing that they accumulate is rounded away. e.size
    and low.size must be multiples of 8; w has 8 y.size elements. r has e.size weights,
    or so many for each sample.
    """
    leak, weights, state, second = _eights(e), r.tolist(), q.tolist(), _eights(low)
    for i in range(y.size):
        s, r = [0.0] * 8, weights[i * e.size :] if len(weights) > e.size else weights
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


def chebyshev(c, t, y):
    """Compute m Chebyshev series, y[m i + j] = sum_k c[m k + j] T_k(t[i]).

    Clenshaw's method is used. m is y.size/t.size and must be a multiple of 8.
    """
    m, t = y.size // t.size, t.tolist()
    _eights(y[:m], 8)
    for k in range(y.size):
        x, a, b = t[k // m], 0.0, 0.0
        for v in c[m + k % m :: m][::-1].tolist():
            a, b = _fma(2.0 * x, a, v - b), a
        y[k] = _fma(x, a, c[k % m] - b)


# exp, log, sin, cos and tanh, the same bits everywhere --------------------------------
# Straight-line, at most 1 ulp from the exact value (tests/test_elementary.py). A number
# in two words is (h, low), of which low is what rounding took from h.
U52, LOW52 = np.uint64(52), np.uint64(2**52 - 1)
SIGN = np.uint64(2**63)
INF, NAN = math.inf, math.nan
LOG2E, MOST_EXP = 1.4426950408889634, 709.782712893384
# log 2 in two words, the first of 42 bits, so that whole multiples of it are exact
LN2, LN2_LOW = float.fromhex("0x1.62e42fefa38p-1"), float.fromhex("0x1.ef35793c7673p-45")
EXP = tuple(1.0 / math.factorial(n) for n in range(14, 1, -1))
LOG = tuple(2.0 / n for n in range(27, 1, -2))
SIN = tuple((-1.0) ** (n // 2) / math.factorial(n) for n in range(19, 1, -2))
COS = tuple((-1.0) ** (n // 2) / math.factorial(n) for n in range(20, 2, -2))
HALF_ROOT = np.uint64(0x3FE6A09E667F3BCD)  # bits of sqrt(1/2)
TO_HALF_ROOT = np.uint64(0x3FF0000000000000 - 0x3FE6A09E667F3BCD)
MOST_SIN = 2.0**30  # rad: beyond, sin and cos are nan
TWO_OVER_PI = 0.6366197723675814
# pi/2 in three words
HALF_PI = float.fromhex("0x1.921fb54442d18p+0")
HALF_PI_2, HALF_PI_3 = (
    float.fromhex("0x1.1a62633145c07p-54"),
    float.fromhex("-0x1.f1976b7ed8fbcp-110"),
)
WHOLE = 1.5 * 2.0**52 + 1023.0


def _polynomial(coefficients, x):
    """Return the value of a polynomial of degree 4 n, highest coefficient first.

    It is computed as four polynomials in x^4, which do not wait for each other.
    """
    a, d, c, b = coefficients[0], coefficients[1], coefficients[2], coefficients[3]
    z = x * x
    w = z * z
    for v in coefficients[4::4]:
        a = fma(a, w, v)
    for v in coefficients[5::4]:
        d = fma(d, w, v)
    for v in coefficients[6::4]:
        c = fma(c, w, v)
    for v in coefficients[7::4]:
        b = fma(b, w, v)
    return fma(fma(d, x, c), z, fma(b, x, a))


def _power_of_two(k):
    """Return 2^k for a whole k from -1022 to 1023."""
    return unbits(bits(k + WHOLE) << U52)


def _less_log_two(x):
    """Return k and (h, low) of x = k log 2 + h + low, with |h| up to 0.35."""
    k = floor(fma(x, LOG2E, 0.5))
    a, b = fma(-k, LN2, x), k * LN2_LOW
    r = a - b
    return k, r, (a - r) - b


def _exp_less_one(r, low):
    """Return exp(r + low) - 1 in two words, for |r| up to 0.35."""
    y = fma(r * r, _polynomial(EXP, r), fma(low, r, low))
    h = r + y
    return h, (r - h) + y


def exp(x):
    """Return e^x."""
    k, r, low = _less_log_two(where(x > MOST_EXP, MOST_EXP, where(x < -746.0, -746.0, x)))
    h, _ = _exp_less_one(r, low)
    half = floor(0.5 * k)
    y = (1.0 + h) * _power_of_two(half) * _power_of_two(k - half)
    return where(x > MOST_EXP, INF, y)


def moderate_exp(x):
    """Return e^x for x from -700 to 700, like ``exp`` but without its checks."""
    k, r, low = _less_log_two(x)
    h, _ = _exp_less_one(r, low)
    return (1.0 + h) * _power_of_two(k)


def log(x):
    """Return the natural logarithm; -inf at 0, NaN below."""
    a = abs(x)
    small = a < 2.0**-1022
    u = bits(a * where(small, 2.0**54, 1.0)) + TO_HALF_ROOT
    e = as_float(u >> U52) - where(small, 1077.0, 1023.0)
    f = unbits((u & LOW52) + HALF_ROOT) - 1.0  # the number is (1 + f) 2^e
    s, h = f / (2.0 + f), 0.5 * f * f
    rest = s * s * _polynomial(LOG, s * s)
    y = e * LN2 - ((h - (s * (h + rest) + e * LN2_LOW)) - f)
    return where(x > 0.0, where(x < INF, y, x), where(x == 0.0, -INF, NAN))


def _less_half_pi(x):
    """Return k and (h, low) of x = k pi/2 + h + low, with |h| up to 0.79."""
    k = floor(fma(x, TWO_OVER_PI, 0.5))
    a, b = k * HALF_PI, k * HALF_PI_2
    c = x - a
    d = -fma(k, HALF_PI, -a)
    e = c + d
    lost = (c - (e - (e - c))) + (d - (e - c))
    g = e - b
    lost = lost + ((e - (g + (e - g))) + ((e - g) - b)) - fma(k, HALF_PI_2, -b)
    lost = fma(-k, HALF_PI_3, lost)
    r = g + lost
    return k, r, (g - r) + lost


def _wave(k, r, low):
    """Return sin(k pi/2 + r + low)."""
    z = r * r
    s = r + fma(r * z, _polynomial(SIN, z), low * fma(-0.5, z, 1.0))
    h = 0.5 * z
    one = 1.0 - h
    c = one + (((1.0 - one) - h) + fma(z * z, _polynomial(COS, z), -(r * low)))
    turn = k - 4.0 * floor(0.25 * k)
    y = where(abs(turn - 2.0) == 1.0, c, s)
    return where(turn >= 2.0, -y, y)


def sin(x):
    """Return the sine of an angle in rad; NaN beyond 2^30 rad."""
    k, r, low = _less_half_pi(where(abs(x) <= MOST_SIN, x, 0.0))
    y = _wave(k, r, low)
    return where(abs(x) <= MOST_SIN, where(abs(x) < 2.0**-27, x, y), NAN)


def cos(x):
    """Return the cosine of an angle in rad; NaN beyond 2^30 rad."""
    k, r, low = _less_half_pi(where(abs(x) <= MOST_SIN, x, 0.0))
    y = _wave(k + 1.0, r, low)
    return where(abs(x) <= MOST_SIN, y, NAN)


def tanh(x):
    """Return tanh(x), computed as (e^2x - 1)/(e^2x + 1), both in two words."""
    a = abs(x)
    k, r, low = _less_log_two(2.0 * where(a < 22.0, a, 22.0))
    h, rest = _exp_less_one(r, low)
    s = _power_of_two(k)
    p, n, d = s * h, s - 1.0, s + 1.0
    above, below = n + p, d + p
    above_low = ((n - above) + p) + (((s - n) - 1.0) + s * rest)
    below_low = ((d - below) + p) + (((s - d) + 1.0) + s * rest)
    y = above / below
    y = y + (fma(-y, below, above) + (above_low - y * below_low)) / below
    y = unbits(bits(y) | (bits(x) & SIGN))
    return where(x == x, y, x)


def _interpreted(f):
    """Return f of a number, computed faster with Python floats, to the same bits."""

    @functools.wraps(f)
    def of_number(x):
        return F(straight(float(x)))

    straight = types.FunctionType(f.__code__, _FLOATS)
    return of_number


ELEMENTARY = {
    f.__name__: f
    for f in (
        *(_polynomial, _power_of_two, _less_log_two, _exp_less_one, _less_half_pi, _wave),
        *(exp, moderate_exp, log, sin, cos, tanh),
    )
}
"""Functions of fma, floor, where and bits alone, from which a target makes its own."""
CONSTANTS = {name: v for name, v in globals().items() if isinstance(v, (float, np.uint64, tuple))}
_FLOATS: dict = {}
_FLOATS |= {n: int(v) if isinstance(v, np.uint64) else v for n, v in CONSTANTS.items()}
_FLOATS |= {
    "fma": _fma,
    "where": lambda c, a, b: a if c else b,
    "bits": lambda x: struct.unpack("<Q", struct.pack("<d", x))[0],
    "unbits": lambda u: struct.unpack("<d", struct.pack("<Q", u & 2**64 - 1))[0],
    "as_float": float,
    "floor": lambda x: float(math.floor(x)) or math.copysign(0.0, x) if x == x else x,
}
_FLOATS |= {name: types.FunctionType(f.__code__, _FLOATS) for name, f in ELEMENTARY.items()}
exp, moderate_exp, log, sin, cos, tanh = map(_interpreted, (exp, moderate_exp, log, sin, cos, tanh))
