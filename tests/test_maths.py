"""Each name of stimlib.core.maths, the definition, against what compiled code does; and
the numbers against exact arithmetic.
"""

import itertools
import math
from fractions import Fraction
from typing import NamedTuple

import mpmath
import numpy as np
import pytest
from laws import STRESS, assert_same, bits
from numba import njit
from scipy import stats

import stimlib
from stimlib import Scene
from stimlib.blocks import noise, white_noise
from stimlib.core import maths
from stimlib.errors import SceneError
from stimlib.targets.numba import intrinsics, vectors
from stimlib.targets.numba.engine import SLOW_MODES, _part, runtime

runtime()  # it has the long sums
_part(SLOW_MODES, "memory", "moving_memory", "chebyshev")

SPECIAL = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    np.nan,
    -np.nan,
    np.inf,
    -np.inf,
    5e-324,
    -5e-324,
    2.2e-308,
    -1e-310,
    1e-200,
    -1e-200,
    1.0000001e-200,
    9.9e-201,
    1e-190,
    1.7976931348623157e308,
    -1.7976931348623157e308,
    1e-17,
    math.pi,
    -math.pi / 2,
    1e6,
    1e15,
    1e22,
    709.7,
    709.8,
    -745.2,
    -708.5,
]


def numbers(n=3000, seed=0):
    """Special values, then random ones over all exponents and random bit patterns."""
    rng = np.random.default_rng(seed)
    wide = rng.standard_normal(n) * 10.0 ** rng.uniform(-320, 308, n)
    near = rng.standard_normal(n) * 10.0 ** rng.uniform(-3, 3, n)
    return np.concatenate(
        [SPECIAL, wide, near, rng.integers(0, 2**64, n, np.uint64).view(np.float64)]
    )


def integers(n=3000, seed=0):
    rng = np.random.default_rng(seed)
    edge = [
        0,
        1,
        2,
        3,
        2**11,
        2**52,
        2**53 - 1,
        2**53,
        2**53 + 1,
        2**62 - 1,
        2**62,
        2**63 - 1,
        2**63,
        2**63 + 1024,
        2**64 - 1025,
        2**64 - 1,
    ]
    return np.concatenate([np.array(edge, np.uint64), rng.integers(0, 2**64, n, np.uint64)])


def assert_number(a, b, what=""):
    """Equal bits, any nan being like any other (which one a sum of two gives is the
    processor's business).
    """
    a, b = np.asarray(a), np.asarray(b)
    if a.dtype == np.float64:
        both = np.isnan(a) & np.isnan(b)
        a, b = np.where(both, 0.0, a), np.where(both, 0.0, b)
    assert_same(a, b, what)


def each(f, *columns):
    with np.errstate(all="ignore"):
        return np.array([f(*row) for row in zip(*columns, strict=True)])


def compiled_each(name, dtype=np.float64):
    """One of intrinsics' functions of one number, over rows: they cannot be passed
    about.
    """
    f = getattr(intrinsics, name)

    @njit(error_model="numpy")
    def loop(a, out):
        for i in range(a.size):
            out[i] = f(a[i])

    def run(a):
        out = np.empty(a.size, dtype)
        loop(a, out)
        return out

    return run


@njit(error_model="numpy")
def compiled_fma(a, b, c, y):
    for i in range(a.size):
        y[i] = intrinsics.fma(a[i], b[i], c[i])


UNARY = ["sqrt", "floor", "exp", "log", "sin", "cos", "tanh", "flush", "settle"]


def test_every_name_of_maths_is_tested_here():
    tested = {
        *UNARY,
        "pairs",
        "each",
        "series",
        "fma",
        "where",
        "as_float",
        "bits",
        "unbits",
        "words",
        "copy",
        "search",
        "tree",
        "fir",
        "modes",
        "memory",
        "chebyshev",
        "moderate_exp",
    }
    written = {
        n for n, v in vars(maths).items() if callable(v) and not n.startswith("_") and n != "F"
    }
    assert written == tested
    assert all(
        hasattr(vectors if n in ("pairs", "each", "series") else intrinsics, n)
        for n in tested - {"tree"}
    ), "each has a compiled counterpart"


@pytest.mark.parametrize("name", UNARY)
def test_functions_of_one_number(name):
    x = numbers()
    assert_number(compiled_each(name)(x), each(getattr(maths, name), x), name)


def test_functions_of_bits():
    x, u = numbers(), integers()
    assert_same(compiled_each("bits", np.uint64)(x), each(maths.bits, x))
    assert_same(compiled_each("bits", np.uint64)(x), bits(x))
    assert_same(compiled_each("unbits")(u), each(maths.unbits, u))
    assert_same(compiled_each("as_float")(u), each(maths.as_float, u))
    assert_same(each(maths.as_float, u), np.array([float(int(v)) for v in u]))


def test_fma_in_compiled_code():
    a, b, c = (numbers(seed=s) for s in (1, 2, 3))
    with np.errstate(all="ignore"):
        product = a * b
    for columns in ((a, b, c), (a, b, -product), (np.roll(a, 7), np.roll(b, 3), np.roll(c, 1))):
        y = np.empty(a.size)
        compiled_fma(*columns, y)
        assert_number(y, each(maths.fma, *columns))


def test_fma_has_one_rounding():
    """Against exact rational arithmetic."""
    rng = np.random.default_rng(4)
    a, b = rng.standard_normal((2, 2000)) * 10.0 ** rng.integers(-20, 20, (2, 2000))
    c = np.where(
        rng.random(2000) < 0.7,
        -a * b * (1 + rng.choice([0, 2e-16, -2e-16, 1e-9], 2000)),
        rng.standard_normal(2000),
    )
    exact = [
        float(Fraction(x) * Fraction(y) + Fraction(z)) for x, y, z in zip(a, b, c, strict=True)
    ]
    np.testing.assert_array_equal(each(maths.fma, a, b, c), exact)
    assert np.any(a * b + c != exact), "the examples do not tell"


def test_fma_of_special_numbers():
    inf, nan = np.inf, np.nan
    for a, b, c, y in [
        (inf, 0.0, 1.0, nan),
        (inf, 1.0, -inf, nan),
        (1e308, 10.0, -inf, -inf),
        (1e308, 10.0, 0.0, inf),
        (nan, 1.0, 1.0, nan),
    ]:
        np.testing.assert_equal(float(maths.fma(a, b, c)), y)


def test_where():
    a, b = numbers(), numbers(seed=9)
    c = np.arange(a.size) % 3 == 0

    @njit(error_model="numpy")
    def loop(c, a, b, y):
        for i in range(a.size):
            y[i] = intrinsics.where(c[i], a[i], b[i])

    for one, other in ((a, b), (integers(), integers(seed=8))):
        n = min(one.size, other.size)
        y = np.empty(n, one.dtype)
        loop(c[:n], one[:n], other[:n], y)
        assert_same(y, each(maths.where, c[:n], one[:n], other[:n]))
        assert_same(y, np.where(c[:n], one[:n], other[:n]))


@pytest.mark.parametrize("size", [2, 3, 4, 7, 64, 65])
def test_search(size):
    knots = np.cumsum(np.random.default_rng(size).uniform(0.1, 1, size))
    x = np.concatenate(
        [
            knots,
            np.nextafter(knots, -9),
            np.nextafter(knots, 99),
            SPECIAL,
            np.linspace(-1, knots[-1] + 1, 200),
        ]
    )

    @njit(error_model="numpy")
    def loop(knots, x, y):
        for i in range(x.size):
            y[i] = intrinsics.search(knots, x[i])

    y = np.empty(x.size)
    loop(knots, x, y)
    np.testing.assert_array_equal(y, [maths.search(knots, v) for v in x])
    inside = (x >= knots[0]) & (x < knots[-1])
    np.testing.assert_array_equal(y[inside], np.searchsorted(knots, x[inside], "right") - 1)


def test_copy_and_words():
    @njit
    def both(a, b):
        intrinsics.copy(a, b[3:])
        return intrinsics.words(a)[0]

    a, b = numbers()[:50], np.zeros(60)
    first = both(a, b)
    other = np.zeros(60)
    maths.copy(a, other[3:])
    assert_same(b, other)
    assert first == maths.words(a)[0]
    for n in [0, 1, 7, 8, 9, 15, 16, 17, 63, 64, 65, 500]:
        a, b = np.arange(1.0, n + 2.0)[:n], np.zeros(n + 10)
        both(a, b[: n + 3])
        assert_same(b, np.pad(a, (3, 7)), f"{n}")


ODD, HALF = np.uint64(0x9E3779B97F4A7C15), np.uint64(2**63 - 1)


def test_pairs():
    """Deviates side by side: any number, from any place, and nothing written beyond the
    next four.
    """

    @njit(error_model="numpy", inline="always")
    def helper(key, m):
        word = key ^ (m * ODD)
        a = intrinsics.as_float(word)
        return intrinsics.sqrt(a), intrinsics.where(
            word > HALF, intrinsics.fma(a, 0.1, 3.0), -intrinsics.floor(a)
        )

    @njit(error_model="numpy")
    def compiled(key, first, z):
        vectors.pairs(helper, key, first, z)

    def same(key, m):
        with np.errstate(over="ignore"):
            word = key ^ (m * ODD)
        a = maths.as_float(word)
        return maths.sqrt(a), maths.where(word > HALF, maths.fma(a, 0.1, 3.0), -maths.floor(a))

    for n in [1, 2, 3, 4, 5, 16, 20, 31, 32, 33, 34, 48, 63, 64, 66]:
        key, first, room, z = np.uint64(n), np.uint64(2**63 + 5 * n), np.full(80, 7.0), np.empty(n)
        compiled(key, first, room[:n])
        maths.pairs(same, key, first, z)
        assert_same(room[:n], z, f"{n}")
        assert (room[-(-n // 4) * 4 :] == 7.0).all()


def test_each_says_what_it_takes():
    @njit(error_model="numpy", inline="always")
    def decay(q, x):
        return intrinsics.settle(x)

    @njit(error_model="numpy")
    def compiled(x, y):
        vectors.each(decay, (), (x,), y)

    with pytest.raises(
        SceneError, match=r"^decay cannot run in vectors: .* write a loop over the samples"
    ):
        compiled(np.ones(3), np.ones(3))


class Line(NamedTuple):
    a: float
    b: float


@njit(error_model="numpy", inline="always")
def compiled_line(q, x, z):
    return intrinsics.where(x > 0.0, intrinsics.fma(q.a, x, q.b) / z, intrinsics.floor(x) - z)


def line(q, x, z):
    return maths.where(x > 0.0, maths.fma(q.a, x, q.b) / z, maths.floor(x) - z)


@njit(error_model="numpy")
def compiled_lines(q, x, z, y):
    vectors.each(compiled_line, q, (x, z[1:]), y)


def test_each():
    """Any number of samples, and nothing written around them."""
    rng = np.random.default_rng(0)
    for n in [1, 2, 6, 7, 8, 9, 15, 16, 17, 63, 64]:
        x, z, q = (
            rng.standard_normal(n) * 1e3,
            rng.standard_normal(n + 1),
            Line(*rng.standard_normal(2)),
        )
        x[n // 2], room, y = np.nan, np.full(80, 7.0), np.empty(n)
        compiled_lines(q, x, z, room[8 : 8 + n])
        maths.each(line, q, (x, z[1:]), y)
        assert_same(room[8 : 8 + n], y, f"{n}")
        assert (room[:8] == 7.0).all() and (room[8 + n :] == 7.0).all()


SEVEN, THREE = np.uint64(7), np.uint64(3)


def compared(q, x, z):
    m = maths
    up = m.where(x < z, 1.0 - x, 2.0 - m.flush(z))
    return m.where(x != z, up, m.where(x >= z, m.where(x > 3.0, -x, 5.0 / -x), 4.0))


def of_words(q, x, z):
    m, u, v = maths, maths.bits(x), maths.bits(z)
    same = m.where(u == v, m.unbits(v ^ SEVEN), m.as_float((u & v) + (SEVEN | v)))
    return m.where(u > v, m.as_float(SEVEN - (u >> THREE)), same)


@pytest.mark.parametrize("f", [compared, of_words])
def test_what_is_done_side_by_side_is_what_each_does(f):
    """nan, signs of zero, the largest words; numbers on the left."""
    g = njit(
        type(f)(f.__code__, f.__globals__ | {"maths": intrinsics}, f.__name__),
        error_model="numpy",
        inline="always",
    )

    @njit(error_model="numpy")
    def compiled(q, x, z, y):
        vectors.each(g, q, (x, z), y)

    edge = np.array([np.nan, 0.0, -0.0, 1.0, -2.5, 7.0, np.inf, -np.inf, maths.SILENT, 5e-324])
    x, z = (np.ascontiguousarray(a.ravel()) for a in np.meshgrid(edge, edge))
    y, wanted = np.empty(x.size), np.empty(x.size)
    compiled(Line(0.0, 0.0), x, z, y)
    with np.errstate(all="ignore"):
        maths.each(f, (), (x, z), wanted)
    assert_number(y, wanted)


class Gains(NamedTuple):
    a: np.ndarray
    c: float


class Held(NamedTuple):
    u: np.ndarray
    w: np.ndarray


def stage(q, s, x):
    h = x - s.w
    u = maths.fma(q.a, h, s.u)
    return u + q.c * h, Held(u, maths.where(u > s.w, s.u, s.w + 0.5 * u))


compiled_stage = njit(
    type(stage)(stage.__code__, globals() | {"maths": intrinsics}, "stage"),
    error_model="numpy",
    inline="always",
)


@njit(error_model="numpy")
def compiled_series(q, s, x, y):
    vectors.series(compiled_stage, q, s, x, y)


def rows(size, rng):
    """Parameters of stages, and two equal states."""
    state = rng.standard_normal((2, size))
    q = Gains(rng.uniform(-0.3, 0.3, size), rng.uniform(0.5, 1.0))
    return q, Held(*state.copy()), Held(*state.copy())


@pytest.mark.parametrize("size", [*range(1, 10), 12, 16, 17, 33])
def test_series(size):
    """Any number of stages and samples in stretches that go on."""
    rng = np.random.default_rng(size)
    q, _, other = rows(size, rng)
    room = np.full((2, size + 40), 7.0)
    room[:, 20 : 20 + size] = other
    s = Held(*room[:, 20 : 20 + size])
    for n in [1, 2, 3, 5, 7, 8, 9, 15, 16, 17, 31, 64, 0, 70]:
        x = rng.standard_normal(n)
        y, wanted = np.full(n + 16, 7.0), np.empty(n)
        compiled_series(q, s, x, y[8 : 8 + n])
        maths.series(stage, q, other, x, wanted)
        assert_same(y[8 : 8 + n], wanted, f"{size} stages, {n} samples")
        assert_same(np.array(s), np.array(other), f"{size} stages, {n} samples: state")
        assert (y[:8] == 7.0).all() and (y[8 + n :] == 7.0).all()
        assert (room[:, :20] == 7.0).all() and (room[:, 20 + size :] == 7.0).all()


def test_series_in_place_and_of_what_is_not_finite():
    """What one stage makes of nan or inf reaches no stage before it."""
    rng = np.random.default_rng(5)
    for size in (1, 3, 8, 20):
        for bad in (np.nan, np.inf, -np.inf):
            q, s, other = rows(size, rng)
            x = rng.standard_normal(40)
            x[17] = bad
            y, wanted = x.copy(), np.empty(40)
            compiled_series(q, s, y, y)
            with np.errstate(all="ignore"):
                maths.series(stage, q, other, x, wanted)
            assert_number(y, wanted, f"{size} stages")
            assert_number(np.array(s), np.array(other), f"{size} stages: state")


def test_series_says_what_it_takes():
    @njit(error_model="numpy", inline="always")
    def settled(q, s, x):
        return intrinsics.settle(x), s

    @njit(error_model="numpy")
    def compiled(q, s, x, y):
        vectors.series(settled, q, s, x, y)

    q, s, _ = rows(3, np.random.default_rng(0))
    x = np.ones(6)
    with pytest.raises(
        SceneError, match=r"^settled cannot run in vectors: .*unbits, exp, .* write a loop"
    ):
        compiled(q, s, x, x)
    for wrong in ((q, s, x[::2], x[:3]), ((), s, x, x), (q, Gains(s.u, 1.0), x, x)):
        with pytest.raises(SceneError, match=r"series\(f, p, s, x, y\).* write a loop"):
            compiled_series(*wrong)


def test_tree_is_the_written_order():
    s = np.random.default_rng(1).standard_normal(8) * 10.0 ** np.arange(8)
    assert maths.tree(s) == ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))


@njit(error_model="numpy")
def compiled_fir(taps, w, y):
    intrinsics.fir(taps, w, y)


@njit(error_model="numpy")
def compiled_modes(p, r, q, d, x, y, w):
    intrinsics.modes(p, r, q, d, x, y, w)


@pytest.mark.parametrize("size", range(8, 137, 8))
def test_fir(size):
    rng = np.random.default_rng(size)
    for n in [*range(1, 20), 23, 31, 32, 33, 48, 63, 64]:
        taps, w = (
            rng.standard_normal(size) * 10.0 ** rng.uniform(-8, 8, size),
            rng.standard_normal(n + size - 1),
        )
        if n == 23:
            w[rng.integers(0, w.size, 3)] = [np.nan, np.inf, 5e-324]
        y, z = np.empty(n), np.empty(n)
        compiled_fir(taps, w, y)
        with np.errstate(all="ignore"):
            maths.fir(taps, w, z)
        assert_number(y, z, f"{size} taps, {n} samples")
        if n != 23:
            exact = [math.fsum(taps * w[i : i + size]) for i in range(n)]
            assert np.abs(z - exact).max() <= 2e-15 * np.abs(taps).sum() * np.abs(w).max()


@pytest.mark.parametrize("size", range(8, 137, 8))
def test_modes(size):
    rng = np.random.default_rng(size)
    for n in [1, 2, 3, 5, 7, 8, 9, 16, 31, 63, 64]:
        poles, r, q = (
            rng.uniform(-0.5, 1.0, size),
            rng.standard_normal(size),
            rng.standard_normal(size),
        )
        x, d = rng.standard_normal(n), rng.standard_normal()
        if n == 31:
            x[10:] = 0.0
            q *= 1e-199
        if n == 16:
            x[11] = np.nan
        p, y, z = q.copy(), np.empty(n), np.empty(n)
        compiled_modes(poles, r, q, d, x, y, np.full(512, np.nan))
        with np.errstate(all="ignore"):
            maths.modes(poles, r, p, d, x, z, np.empty(512))
        assert_number(y, z, f"{size} modes, {n} samples")
        assert_number(q, p, "state")


def test_silence_of_modes():
    """What TINY leaves of nothing, and what is flushed: the limit itself, and nothing
    above.
    """
    limit = [
        maths.SILENT,
        -maths.SILENT,
        np.nextafter(maths.SILENT, 1),
        0.9 * maths.SILENT,
        -1e-189,
        5e-324,
        -0.0,
        1e-190,
    ]
    poles, r, rest = np.linspace(0.1, 0.9, 8), np.ones(8), np.zeros(8)
    for x, weights, d in ((np.zeros(9), 1e10 * r, 0.0), (np.array(limit + limit[:3]), rest, 1.0)):
        q, p, y, z = np.zeros(8), np.zeros(8), np.empty(x.size), np.empty(x.size)
        compiled_modes(poles, weights, q, d, x, y, np.full(512, np.nan))
        maths.modes(poles, weights, p, d, x, z, np.empty(512))
        assert_same(y, z)
        assert_same(q, p, "state")


def test_eight_modes_beside_pairs():
    """What TINY leaves of nothing is the same there; white noise is never as small."""

    @njit(error_model="numpy", inline="always")
    def helper(key, m):
        return intrinsics.as_float(key ^ m), intrinsics.as_float(m)

    @njit(error_model="numpy")
    def compiled(key, z, p, r, q, d, x, y):
        vectors.pairs_beside_modes(helper, key, np.uint64(3), z, p, r, q, d, x, y)

    poles, weights = np.linspace(0.1, 0.9, 8), np.full(8, 1e10)
    for d, x in ((0.0, np.zeros(64)), (0.5, np.repeat([1e-200, -1e-200, -1e-190, 1.0], 16))):
        q, exact, y, z = np.zeros(8), np.zeros(8), np.empty(64), np.empty(64)
        compiled(np.uint64(5), z, poles, weights, q, d, x, y)
        wanted = np.empty(64)
        for i in range(64):  # q = p q + (x + TINY), a rounding each
            drive = Fraction(float(x[i]) + 1e-200)
            exact = [
                float(Fraction(p) * Fraction(v) + drive) for p, v in zip(poles, exact, strict=True)
            ]
            sums = [
                float(Fraction(float(w)) * Fraction(v)) for w, v in zip(weights, exact, strict=True)
            ]
            a, b, c, e = (sums[k] + sums[k + 4] for k in range(4))
            total = float(Fraction(d) * Fraction(float(x[i])) + Fraction((a + c) + (b + e)))
            wanted[i] = total if abs(total) > 1e-190 else 0.0
        assert_same(y, wanted)
        assert_same(q, np.array(exact), "state")
        assert z.tolist() == [float(v) for m in range(3, 35) for v in (5 ^ m, m)]


@njit(error_model="numpy")
def compiled_memory(e, r, q, low, x, y, w):
    intrinsics.memory(e, r, q, low, x, y, w)


@pytest.mark.parametrize(
    ("size", "slow", "counts"),
    [
        (size, slow, [1, 2, 3, 5, 8, 9, 31, 63, 64])
        for size, slow in ((8, 0), (8, 8), (16, 8), (24, 24), (40, 16), (136, 64))
    ]
    + [(8 * (fine + coarse), 8 * fine, [2]) for fine in range(15) for coarse in range(9)],
)
def test_memory(size, slow, counts):
    """Modes so slow that the first ones carry a second word; each number of groups has
    a loop of its own.
    """
    rng = np.random.default_rng(size)
    for n in counts:
        e, r = np.sort(10.0 ** rng.uniform(-14, 0, size)), rng.standard_normal(size)
        q, low, x = (
            rng.standard_normal(size),
            1e-17 * rng.standard_normal(slow),
            rng.standard_normal(n),
        )
        p, other, y, z = q.copy(), low.copy(), np.empty(n), np.empty(n)
        compiled_memory(e, r, q, low, x, y, np.full(512, np.nan))
        maths.memory(e, r, p, other, x, z, np.empty(512))
        assert_number(y, z, f"{size} modes, {n} samples")
        assert_number(q, p, "state")
        assert_number(low, other, "second words")


@pytest.mark.parametrize(("size", "slow"), [(8, 0), (64, 32), (136, 64), (56, 56)])
def test_memory_with_weights_for_each_sample(size, slow):
    """As calls of one sample each, with its weights."""
    rng = np.random.default_rng(size)
    e, r = np.sort(10.0 ** rng.uniform(-14, 0, size)), rng.standard_normal(16 * size)
    q, low, x = (
        rng.standard_normal(size),
        1e-17 * rng.standard_normal(slow),
        rng.standard_normal(16),
    )
    for f in (compiled_memory, maths.memory):
        (a, b), (c, d) = ((q.copy(), low.copy()) for _ in range(2))
        y, z = np.empty((2, 16))
        f(e, r, a, b, x, y, np.full(512, np.nan))
        for i in range(16):
            f(e, r[size * i : size * (i + 1)], c, d, x[i : i + 1], z[i : i + 1], np.zeros(8))
        assert_number(y, z)
        assert_number(a, c, "state")
        assert_number(b, d, "second words")


@njit(error_model="numpy")
def compiled_chebyshev(c, t, y):
    intrinsics.chebyshev(c, t, y)


@pytest.mark.parametrize("n", [1, 3, 4, 6, 16])
def test_chebyshev(n):
    rng = np.random.default_rng(n)
    for terms, m in ((1, 8), (2, 16), (25, 24)):
        c, t = rng.standard_normal((terms, m)), rng.uniform(-1, 1, n)
        y, z = np.empty((2, n * m))
        compiled_chebyshev(c.ravel(), t, y)
        maths.chebyshev(c.ravel(), t, z)
        assert_same(y, z)
        wanted = np.polynomial.chebyshev.chebval(t, c).T
        np.testing.assert_allclose(y.reshape(n, m), wanted, atol=1e-13)


def test_a_moderate_exp_is_exp():
    x = np.concatenate([np.random.default_rng(1).uniform(-700, 700, 3000), [0.0, 700.0, -700.0]])
    y = compiled_each("exp")(x)
    assert_same(compiled_each("moderate_exp")(x), y)
    assert_same(each(maths.moderate_exp, x), y)


def test_long_sums_write_nothing_around_their_samples():
    rng = np.random.default_rng(0)
    taps, w, q = rng.standard_normal(8), rng.standard_normal(80), np.zeros(8)
    for n in [1, 4, 7, 12, 20, 36, 44, 60]:
        room = np.full((3, 200), 7.0)
        y = room[:, 64 : 64 + n]
        compiled_fir(taps, w[: n + 7], y[0])
        compiled_modes(taps, taps, q, 1.0, w[:n], y[1], np.zeros(512))
        compiled_memory(taps, taps, q, np.zeros(0), w[:n], y[2], np.zeros(512))
        assert (room[:, :64] == 7.0).all() and (room[:, 64 + n :] == 7.0).all(), f"{n} samples"


def test_memory_of_what_is_not_finite():
    """There is no product with a d of 0: inf stays inf."""
    for n in (3, 9):
        x, got = np.zeros(n), []
        x[-1] = np.inf
        for f in (compiled_memory, maths.memory):
            y, q, low = np.empty(n), np.zeros(8), np.zeros(8)
            with np.errstate(all="ignore"):
                f(np.full(8, 0.5), np.ones(8), q, low, x, y, np.zeros(512))
            got.append(y)
        assert_same(*got)
        assert got[0][-1] == np.inf


# Noise --------------------------------------------------------------------------------
KNOWN = [  # counter, key, result: Random123, kat_vectors, philox4x32 10
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]
U = np.uint64


@pytest.mark.parametrize(("counter", "key", "result"), KNOWN)
def test_philox_known_answers(counter, key, result):
    words = [U(v) for v in (*counter, *key)]
    with np.errstate(over="ignore"):
        assert tuple(map(int, noise.philox(*words))) == result
    of_noise = noise.__dict__ | {"rounds": njit(noise.rounds)}
    assert njit(type(noise.philox)(noise.philox.__code__, of_noise))(*words) == result


@njit(error_model="numpy")
def _radius(a, y):
    for i in range(a.size):
        y[i] = RADIUS(a[i])


@njit(error_model="numpy")
def _turn(a, x, y):
    for i in range(a.size):
        x[i], y[i] = TURN(a[i])


def transplant(f):
    """A function of blocks/noise.py with intrinsics in the place of maths, as a segment
    has it.
    """
    names = dict(f.__globals__) | {
        n: getattr(intrinsics, n) for n in ("fma", "sqrt", "where", "bits", "unbits", "as_float")
    }
    return njit(type(f)(f.__code__, names, f.__name__), error_model="numpy")


RADIUS, TURN = transplant(noise.radius), transplant(noise.turn)


def ulps(got, exact):
    """Largest error in units of the last place of the exact value."""
    return max(
        float(
            abs(mpmath.mpf(float(g)) - e) / mpmath.mpf(float(np.spacing(abs(float(e)) or 5e-324)))
        )
        for g, e in zip(got, exact, strict=True)
    )


@pytest.mark.longer
def test_radius_is_right_to_a_few_ulps():
    mpmath.mp.prec = 200
    top = U(2**64 - 1)
    near_1 = np.arange(0, 4096, 1 if STRESS else 5, dtype=U)
    a = [
        integers(6000 if STRESS else 1000, 5),
        top - integers(500, 6) // U(2**40),
        top - near_1,
        integers(500, 7) // U(2**50),
    ]
    a = np.concatenate(a)
    exact = [
        mpmath.sqrt(-2 * mpmath.log((mpmath.mpf(int(v)) + mpmath.mpf("0.5")) / 2**64)) for v in a
    ]
    got = each(noise.radius, a)
    y = np.empty(a.size)
    _radius(a, y)
    assert_same(y, got)
    usual = a < U(2**64 - 2**60)  # beyond, u is rounded next to 1 and the radius is small
    assert ulps(got[usual], [e for e, k in zip(exact, usual, strict=True) if k]) < 4
    assert max(abs(float(g - e)) for g, e in zip(got, exact, strict=True)) <= 2**-26.5
    assert np.all(got >= 0) and np.isfinite(got).all()


@pytest.mark.longer
def test_turn_is_right_to_a_few_ulps():
    mpmath.mp.prec = 200
    a = integers(8000 if STRESS else 2000, 8)
    got = np.array([noise.turn(v) for v in a]).T
    x = np.empty((2, a.size))
    _turn(a, x[0], x[1])
    assert_same(x, got)
    # quarter turns from the upper two bits; the rest, of 51 bits, from -1/8 to 1/8 turn
    angle = [
        (mpmath.mpf(int(v) >> 62) / 4) + mpmath.mpf(((int(v) >> 11) & (2**51 - 1)) - 2**50) / 2**53
        for v in a
    ]
    exact = [[f(2 * mpmath.pi * t) for t in angle] for f in (mpmath.cos, mpmath.sin)]
    worst = max(
        abs(float(mpmath.mpf(float(g)) - e))
        for row, want in zip(got, exact, strict=True)
        for g, e in zip(row, want, strict=True)
    )
    assert worst < 1.7e-16
    assert np.abs(np.hypot(*got) - 1).max() < 4e-16


def test_the_tails_reach_nine_and_a_half_sigma():
    assert float(noise.radius(U(0))) == pytest.approx(math.sqrt(2 * 65 * math.log(2)), rel=1e-15)
    assert 9.49 < noise.radius(U(0)) < 9.5
    assert 0 <= noise.radius(U(2**64 - 1)) < 1e-8
    for v in (0, 2**64 - 1):
        c, s = noise.turn(U(v))
        assert abs(c * c + s * s - 1) < 4e-16


def stream(seed, start, n, run=0):
    """White noise from a sample index on, as the processor makes it."""
    proc = stimlib.compile(Scene({"n": white_noise(seed)}), 1000, seed=run)
    state = proc.state
    state[3] = U(start)  # header of two words, key, index
    proc.state = state
    return proc.process(np.empty((0, n)))[0]


def test_sample_n_is_a_function_of_n():
    proc = stimlib.compile(Scene({"n": white_noise(3)}), 1000)
    assert proc.state[3] == 0, "the index of the stream at sample 0"
    y = proc.process(np.empty((0, 700)))[0]
    for start in (0, 1, 2, 3, 62, 63, 64, 65, 127, 128, 129, 400, 699):
        assert_same(stream(3, start, 1), y[start : start + 1])
        assert_same(stream(3, start, 700 - start), y[start:])


@pytest.mark.parametrize("middle", [2**32, 2**33, 2**53, 2**63])
def test_no_seam_where_counters_carry(middle):
    whole = stream(3, middle - 9, 30)
    for cut in range(30):
        assert_same(stream(3, middle - 9 + cut, 30 - cut), whole[cut:])
    key = stimlib.compile(Scene({"n": white_noise(3)}), 1000).state[2]
    with np.errstate(over="ignore"):
        pairs = [noise.pair_of_words(key, U((middle >> 1) + m)) for m in range(3)]
    direct = [noise.radius(a) * v for a, b in pairs for v in noise.turn(b)]
    assert_same(whole[9:15], np.array(direct))
    assert np.unique(whole).size == 30


def test_keys_tell_runs_seeds_streams_and_uses_apart():
    keys = {int(noise.noise_key(*k)) for k in np.ndindex(4, 4, 4, 2)}
    assert len(keys) == 4 * 4 * 4 * 2
    assert noise.noise_key(2**64 - 1, 2**64 - 1, 2**32 - 1, 1) != noise.noise_key(0, 0, 0, 1)


def test_moments_and_distribution():
    y = stimlib.compile(Scene({"n": white_noise(11)}), 1000).process(np.empty((0, 400_000)))[0]
    n = y.size
    for moment, expected, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert abs(np.mean(y**moment) - expected) < 4.5 * math.sqrt(variance / n)
    assert stats.kstest(y, "norm").pvalue > 1e-3
    for lag in (1, 2, 3, 64, 128):
        assert abs(np.mean(y[lag:] * y[:-lag])) < 4.5 / math.sqrt(n)
    assert 4.2 < np.abs(y).max() < 6
    other = stimlib.compile(Scene({"n": white_noise(12)}), 1000).process(np.empty((0, n)))[0]
    assert abs(np.mean(y * other)) < 4.5 / math.sqrt(n)


def test_fma_without_a_c_library_has_the_same_bits():
    """On Windows below Python 3.13: `math.fma` and the C library are missing there."""
    rng = np.random.default_rng(1)
    a, b, c = rng.integers(0, 2**64, (3, 20_000), dtype=np.uint64).view(np.float64)
    near = rng.standard_normal((2, 20_000))
    hard = [0.0, -0.0, 5e-324, -5e-324, 1e308, -1e308, 1 + 2**-52, 1 - 2**-53, np.inf, np.nan]
    triples = [
        *zip(a, b, c, strict=True),  # of all sizes, nan and infinite among them
        *((x, y, -(x * y)) for x, y in near.T),  # where one rounding is all that is left
        *itertools.product(hard, repeat=3),
    ]
    for x, y, z in triples:
        want, got = maths.fma(x, y, z), maths._exact_fma(float(x), float(y), float(z))
        if not (np.isnan(want) and np.isnan(got)):
            assert_same(np.array([want]), np.array([got]))
