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
from laws import STRESS, assert_same, bits, mostly
from refusals import refused
from walked import compiled

import stimlib
from stimlib import Scene, SceneError
from stimlib.blocks import noise, white_noise
from stimlib.blocks.tables import EVEN, evenness
from stimlib.core import maths
from stimlib.targets.llvm import known, walk
from stimlib.targets.llvm.engine import SLOW_MODES, _part, runtime

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


def numbers(n=1000, seed=0):
    """Special values, then random ones over all exponents and random bit patterns."""
    rng = np.random.default_rng(seed)
    wide = rng.standard_normal(n) * 10.0 ** rng.uniform(-320, 308, n)
    near = rng.standard_normal(n) * 10.0 ** rng.uniform(-3, 3, n)
    return np.concatenate(
        [SPECIAL, wide, near, rng.integers(0, 2**64, n, np.uint64).view(np.float64)]
    )


def integers(n=1000, seed=0):
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


def over_rows(f, a, out):
    for i in range(a.size):
        out[i] = f(a[i])


loop = compiled(over_rows)


def compiled_each(f, a, dtype=np.float64):
    """A function of one number, of each number of an array."""
    out = np.empty(a.size, dtype)
    loop(f, a, out)
    return out


@compiled
def compiled_fma(a, b, c, y):
    for i in range(a.size):
        y[i] = maths.fma(a[i], b[i], c[i])


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
        "quotient",
        "tree",
        "fir",
        "modes",
        "memory",
        "chebyshev",
        "moderate_exp",
    }
    assert {
        n for n, v in vars(maths).items() if callable(v) and not n.startswith("_") and n != "F"
    } == tested
    assert {getattr(maths, n) for n in tested - {"tree"}} <= {*known.TWINS}, "compiled ones"


# the others are in test_elementary.py
@pytest.mark.parametrize("name", ["sqrt", "floor", "flush", "settle"])
def test_functions_of_one_number(name):
    x = numbers()
    f = getattr(maths, name)
    assert_number(compiled_each(f, x), each(f, x), name)


def test_functions_of_bits():
    x, u = numbers(), integers()
    assert_same(bits(x), each(maths.bits, x))
    for f, given, dtype in (
        (maths.bits, x, np.uint64),
        (maths.unbits, u, float),
        (maths.as_float, u, float),
    ):
        assert_same(compiled_each(f, given, dtype), each(f, given))
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
    near = -a * b * (1 + rng.choice([0, 2e-16, -2e-16, 1e-9], 2000))
    c = np.where(rng.random(2000) < 0.7, near, rng.standard_normal(2000))
    exact = [float(Fraction(x) * Fraction(y) + Fraction(z)) for x, y, z in np.array([a, b, c]).T]
    np.testing.assert_array_equal(each(maths.fma, a, b, c), exact)
    assert np.any(a * b + c != exact), "the examples do not tell"


@compiled
def compiled_where(c, a, b, y):
    for i in range(a.size):
        y[i] = maths.where(c[i], a[i], b[i])


@pytest.mark.parametrize("make", [numbers, integers])
def test_where(make):
    a, b = make(), make(seed=9)
    c, y = np.arange(a.size) % 3 == 0, np.empty(a.size, a.dtype)
    compiled_where(c, a, b, y)
    assert_same(y, each(maths.where, c, a, b))
    assert_same(y, np.where(c, a, b))


@compiled
def compiled_search(knots, x, per, y):
    for i in range(x.size):
        y[i] = maths.search(knots, x[i], per)


@pytest.mark.parametrize("size", [2, 3, 8, 9, 64, 65, 257])
@pytest.mark.parametrize("jitter", [0, 0.45, 0.8, 2])
def test_search(size, jitter):
    rng = np.random.default_rng(size)
    knots = np.cumsum(np.append(0, np.full(size - 1, 0.3))) - 1
    knots[1:-1] = np.sort(knots[1:-1] + 0.3 * jitter * rng.uniform(-1, 1, size - 2))
    beside = np.nextafter(knots, [[-9], [99]]).ravel()
    x = np.concatenate([knots, beside, SPECIAL, np.linspace(-2, knots[-1] + 1, 200)])
    y, per = np.empty(x.size), evenness(knots)
    assert (per > 0) == (size > EVEN and jitter < 0.5)
    compiled_search(knots, x, per, y)
    np.testing.assert_array_equal(y, [maths.search(knots, v, per) for v in x])
    inside = (x >= knots[0]) & (x < knots[-1])
    np.testing.assert_array_equal(y[inside], np.searchsorted(knots, x[inside], "right") - 1)


@compiled
def compiled_quotient(n, by, inverse, y):
    for i in range(n.size):
        y[i] = maths.quotient(n[i] - i, i, by, inverse)


@pytest.mark.parametrize("by", [1, 3, 8000, 44_100, 2**31 - 1, 2**32 - 1, 2**32, 1000.5, 1e300])
def test_quotient(by):
    rng = np.random.default_rng(3)
    inverse = (by % 1 == 0 and by <= 2**32) / by
    n = np.floor(2.0 ** rng.uniform(0, 51, 20_000))
    # multiples, and what lies next to the middle of two quotients
    middle = np.floor(by * (np.floor(2.0 ** rng.uniform(0, 20, 2000)) + 0.5))
    n = np.concatenate([n, np.floor(n / by) * by, middle, middle + 1, [0.0, 2.0**51]])
    n = np.concatenate([n, 0.0 - n])[np.abs(np.concatenate([n, n])) <= 2**51]
    y = np.empty(n.size)
    compiled_quotient(n, float(by), inverse, y)
    assert_same(y, n / by, f"n / {by}")
    assert maths.quotient(n[7], 5, by, inverse) == (n[7] + 5) / by


def test_a_product_finds_pieces_in_the_float32_of_an_export_too():
    assert evenness(0.3 * np.arange(65)) > 0.0
    assert evenness(1e7 + 0.3 * np.arange(65)) == 0.0  # several knots are one float32


def copied(a, b):
    maths.copy(a, b)
    return maths.words(a)[0]


compiled_copy = compiled(copied, "u8")


@pytest.mark.parametrize("n", [1, 7, 8, 9, 15, 16, 17, 50, 63, 64, 65, 500])
def test_copy_and_words(n):
    a, room, other = numbers(n)[:n], np.zeros(n + 10), np.zeros(n + 10)
    first = compiled_copy(a, room[3 : n + 3])
    maths.copy(a, other[3 : n + 3])
    assert_same(room, other)
    assert_same(room, np.pad(a, (3, 7)))
    assert first == maths.words(a)[0]


ODD, HALF = np.uint64(0x9E3779B97F4A7C15), np.uint64(2**63 - 1)


def a_pair(key, m):
    word = key ^ (m * ODD)
    a = maths.as_float(word)
    return maths.sqrt(a), maths.where(word > HALF, maths.fma(a, 0.1, 3.0), -maths.floor(a))


@compiled
def compiled_pairs(key, first, z):
    maths.pairs(a_pair, key, first, z)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 16, 20, 31, 32, 33, 34, 48, 63, 64, 66])
def test_pairs(n):
    """Deviates side by side: any number, from any place, and nothing written beyond the
    next four.
    """
    given, room, z = (np.uint64(n), np.uint64(2**63 + 5 * n)), np.full(80, 7.0), np.empty(n)
    compiled_pairs(*given, room[:n])
    with np.errstate(over="ignore"):
        maths.pairs(a_pair, *given, z)
    assert_same(room[:n], z)
    assert (room[-(-n // 4) * 4 :] == 7.0).all()


class Line(NamedTuple):
    a: float
    b: float


def line(q, x, z):
    return maths.where(x > 0.0, maths.fma(q.a, x, q.b) / z, maths.floor(x) - z)


@compiled
def compiled_lines(q, x, z, y):
    maths.each(line, q, (x, z[1:]), y)


@pytest.mark.parametrize("n", [1, 2, 6, 7, 8, 9, 15, 16, 17, 63, 64])
def test_each(n):
    """Any number of samples, and nothing written around them."""
    rng = np.random.default_rng(n)
    x, z, q = rng.standard_normal(n) * 1e3, rng.standard_normal(n), Line(*rng.standard_normal(2))
    x[n // 2], room, y = np.nan, np.full(80, 7.0), np.empty(n)
    compiled_lines(q, x, np.r_[0.0, z], room[8 : 8 + n])
    maths.each(line, q, (x, z), y)
    assert_same(room[8 : 8 + n], y)
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
    edge = np.array([np.nan, 0.0, -0.0, 1.0, -2.5, 7.0, np.inf, -np.inf, maths.SILENT, 5e-324])
    x, z = (np.ascontiguousarray(a.ravel()) for a in np.meshgrid(edge, edge))
    y, wanted = np.empty(x.size), np.empty(x.size)
    compiled(maths.each)(f, Line(0.0, 0.0), (x, z), y)
    with np.errstate(all="ignore"):
        maths.each(f, (), (x, z), wanted)
    assert_number(y, wanted)


def stages(size, rng):
    """Parameters of stages, and two equal states."""
    state = rng.standard_normal((2, size))
    q = Gains(rng.uniform(-0.3, 0.3, size), rng.uniform(0.5, 1.0))
    return q, Held(*state.copy()), Held(*state.copy())


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


@compiled
def compiled_series(q, s, x, y):
    maths.series(stage, q, s, x, y)


@pytest.mark.parametrize("size", [*range(1, 10), 12, 16, 17, 33])
def test_series(size):
    """Any number of stages and samples in stretches that go on."""
    rng = np.random.default_rng(size)
    q, _, other = stages(size, rng)
    room = np.full((2, size + 40), 7.0)
    room[:, 20 : 20 + size] = other
    s = Held(*room[:, 20 : 20 + size])
    for n in [1, 2, 3, 5, 7, 8, 9, 15, 16, 17, 31, 64, 0, 70]:
        x, y, wanted = rng.standard_normal(n), np.full(n + 16, 7.0), np.empty(n)
        compiled_series(q, s, x, y[8 : 8 + n])
        maths.series(stage, q, other, x, wanted)
        assert_same(y[8 : 8 + n], wanted, f"{size} stages, {n} samples")
        assert_same(np.array(s), np.array(other), f"{size} stages, {n} samples: state")
        around = y[:8], y[8 + n :], room[:, :20], room[:, 20 + size :]
        assert all((part == 7.0).all() for part in around)


@pytest.mark.parametrize("size", [1, 3, 8, 20])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_series_in_place_and_of_what_is_not_finite(size, bad):
    """What one stage makes of nan or inf reaches no stage before it."""
    rng = np.random.default_rng(5)
    (q, s, other), x, wanted = stages(size, rng), rng.standard_normal(40), np.empty(40)
    x[17] = bad
    y = x.copy()
    compiled_series(q, s, y, y)
    with np.errstate(all="ignore"):
        maths.series(stage, q, other, x, wanted)
    assert_number(y, wanted)
    assert_number(np.array(s), np.array(other), "state")


def settled(q, s, x):
    return maths.settle(x), s


@compiled
def series_settled(q, s, x, y):
    maths.series(settled, q, s, x, y)


@compiled
def series_of_words(q, s, x, y):
    maths.series(stage, q, s, maths.words(x), y)


@compiled
def series_of_gaps(q, s, x, y):
    maths.series(stage, q, s, x[::2], y)


def test_vectors_say_what_they_take():
    q, s, _ = stages(3, np.random.default_rng(0))
    x = np.ones(6)
    refused(SceneError, "^settled cannot .*unbits, .* write a loop", series_settled, q, s, x, x)
    for wrong in (
        (compiled_series, (), s, x, x),
        (compiled_series, q, Gains(s.u, 1.0), x, x),
        (series_of_words, q, s, x, x),
    ):
        refused(SceneError, r"series\(f, .* write a loop", *wrong)
    refused(walk.Unknown, "slice .* step", series_of_gaps, q, s, x, x[:3])


def test_tree_is_the_written_order():
    s = np.random.default_rng(1).standard_normal(8) * 10.0 ** np.arange(8)
    assert maths.tree(s) == ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))


LONG = {name: compiled(getattr(maths, name)) for name in ("fir", "modes", "memory", "chebyshev")}


def alike(name, *given):
    """What given arrays become by the compiled function, which is what they become by
    its definition; room to work in is given where it is taken.
    """
    one, other = ([np.copy(v) if np.ndim(v) else v for v in given] for _ in range(2))
    work = name in ("modes", "memory")
    LONG[name](*one, *[np.full(512, np.nan)] * work)
    with np.errstate(all="ignore"):
        getattr(maths, name)(*other, *[np.empty(512)] * work)
    for k, (a, b) in enumerate(zip(one, other, strict=True)):
        assert_number(a, b, f"argument {k} of {name}, {np.shape(given[-1])}")
    return one


@pytest.mark.parametrize("size", range(8, 137, 8))
def test_fir(size):
    rng = np.random.default_rng(size)
    for n in [*range(1, 10), 16, 17, 31, 32, 33, 64]:
        taps = rng.standard_normal(size) * 10.0 ** rng.uniform(-8, 8, size)
        w = rng.standard_normal(n + size - 1)
        y = alike("fir", taps, w, np.empty(n))[-1]
        exact = [math.fsum(taps * w[i : i + size]) for i in range(n)]
        assert np.abs(y - exact).max() <= 2e-15 * np.abs(taps).sum() * np.abs(w).max()
        w[rng.integers(0, w.size, 3)] = [np.nan, np.inf, 5e-324]
        alike("fir", taps, w, np.empty(n))


def test_long_sums_take_no_other_numbers_than_multiples_of_8():
    a, b = np.zeros(12), np.zeros(200)
    for size, *given in (
        (12, maths.fir, a, b, b),
        (12, maths.modes, a, a, a, 0.0, b, b, b),
        (0, maths.modes, a[:0], a, a, 0.0, b, b, b),
        (4, maths.memory, b, b, b, a[:4], b, b, b),
        (1, maths.chebyshev, a, b, b),
    ):
        refused(ValueError, f"multiple of 8, not {size}", *given)


@pytest.mark.parametrize("size", range(8, 137, 8))
def test_modes(size):
    rng = np.random.default_rng(size)
    for n in [1, 2, 3, 5, 7, 8, 9, 16, 31, 63, 64]:
        poles, x = rng.uniform(-0.5, 1.0, size), rng.standard_normal(n)
        r, q = rng.standard_normal((2, size))
        x[10:] *= n != 31
        x[11:12] += np.nan if n == 16 else 0.0
        alike("modes", poles, r, q * (1e-199 if n == 31 else 1.0), 0.3, x, np.empty(n))


SMALL = [
    *maths.SILENT * np.array([1.0, -1.0, 0.9]),
    np.nextafter(maths.SILENT, 1),
    -1e-189,
    5e-324,
    -0.0,
    1e-190,
]


@pytest.mark.parametrize(
    ("x", "weight", "d"), [(np.zeros(9), 1e10, 0.0), (np.array(SMALL + SMALL[:3]), 0.0, 1.0)]
)
def test_silence_of_modes(x, weight, d):
    """What TINY leaves of nothing, and what is flushed: the limit itself, and nothing
    above.
    """
    alike(
        "modes", np.linspace(0.1, 0.9, 8), np.full(8, weight), np.zeros(8), d, x, np.empty(x.size)
    )


GROUPS = [
    *(
        (size, slow, [1, 2, 3, 5, 8, 9, 31, 63, 64])
        for size, slow in ((8, 0), (8, 8), (16, 8), (24, 24), (40, 16), (136, 64))
    ),
    *((8 * (fine + coarse), 8 * fine, [2]) for fine in range(15) for coarse in range(9)),
]


@pytest.mark.parametrize("given", mostly(GROUPS[:6] + GROUPS[6::6], GROUPS), ids=str)
def test_memory(given):
    """Modes so slow that the first ones carry a second word; each number of groups has
    a loop of its own.
    """
    size, slow, counts = given
    rng = np.random.default_rng(size)
    for n in counts:
        e, low = np.sort(10.0 ** rng.uniform(-14, 0, size)), 1e-17 * rng.standard_normal(slow)
        r, q = rng.standard_normal((2, size))
        alike("memory", e, r, q, low, rng.standard_normal(n), np.empty(n))


@pytest.mark.parametrize("n", [1, 3, 4, 6, 16])
@pytest.mark.parametrize(("terms", "m"), [(1, 8), (2, 16), (25, 24)])
def test_chebyshev(n, terms, m):
    rng = np.random.default_rng(n)
    c, t = rng.standard_normal((terms, m)), rng.uniform(-1, 1, n)
    y = alike("chebyshev", c.ravel(), t, np.empty(n * m))[-1]
    np.testing.assert_allclose(y.reshape(n, m), np.polynomial.chebyshev.chebval(t, c).T, atol=1e-13)


def test_a_moderate_exp_is_exp():
    x = np.concatenate([np.random.default_rng(1).uniform(-700, 700, 800), [0.0, 700.0, -700.0]])
    y = compiled_each(maths.exp, x)
    assert_same(compiled_each(maths.moderate_exp, x), y)
    assert_same(each(maths.moderate_exp, x), y)


@pytest.mark.parametrize("n", [1, 4, 7, 12, 20, 36, 44, 60])
def test_long_sums_write_nothing_around_their_samples(n):
    rng = np.random.default_rng(0)
    taps, w, room = rng.standard_normal(8), rng.standard_normal(80), np.full((3, 200), 7.0)
    y = room[:, 64 : 64 + n]
    LONG["fir"](taps, w[: n + 7], y[0])
    LONG["modes"](taps, taps, np.zeros(8), 1.0, w[:n], y[1], np.zeros(512))
    LONG["memory"](taps, taps, np.zeros(8), np.zeros(0), w[:n], y[2], np.zeros(512))
    assert (room[:, :64] == 7.0).all() and (room[:, 64 + n :] == 7.0).all()


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


@compiled
def compiled_philox(a, b, c, d, k, m, out):
    out[0], out[1], out[2], out[3] = noise.philox(a, b, c, d, k, m)


@pytest.mark.parametrize(("counter", "key", "result"), KNOWN)
def test_philox_known_answers(counter, key, result):
    words = [U(v) for v in (*counter, *key)]
    out = np.zeros(4, U)
    compiled_philox(*words, out)
    with np.errstate(over="ignore"):
        assert tuple(map(int, noise.philox(*words))) == tuple(out.tolist()) == result


def test_radius_is_right_to_a_few_ulps():
    top, near_1 = U(2**64 - 1), np.arange(0, 4096, 1 if STRESS else 5, dtype=U)
    all_sizes, near_0 = integers(6000 if STRESS else 600, 5), integers(300, 7) // U(2**50)
    a = np.r_[all_sizes, top - integers(300, 6) // U(2**40), top - near_1, near_0]
    with mpmath.workprec(200):
        u = [(mpmath.mpf(int(v)) + 0.5) / 2**64 for v in a]
        exact = [mpmath.sqrt(-2 * mpmath.log(v)) for v in u]
        got = each(noise.radius, a)
        apart = np.array([float(abs(g - e)) for g, e in zip(got.tolist(), exact, strict=True)])
    assert_same(compiled_each(noise.radius, a), got)
    usual = a < U(2**64 - 2**60)  # beyond, u is rounded next to 1 and the radius is small
    assert (apart / np.spacing(np.array(exact, float)))[usual].max() < 4
    assert apart.max() <= 2**-26.5 and np.all(got >= 0) and np.isfinite(got).all()


def test_the_tails_reach_nine_and_a_half_sigma():
    assert float(noise.radius(U(0))) == pytest.approx(math.sqrt(2 * 65 * math.log(2)), rel=1e-15)
    assert 9.49 < noise.radius(U(0)) < 9.5 and 0 <= noise.radius(U(2**64 - 1)) < 1e-8
    assert np.hypot(*noise.turn(U(0))) == pytest.approx(1, abs=2e-16)


def stream(seed, start, n, run=0):
    """White noise from a sample index on, as the processor makes it."""
    proc = stimlib.compile(Scene({"n": white_noise(seed)}), 1000, seed=run)
    state = proc.state
    state[3] = U(start)  # header of two words, key, index
    proc.state = state
    return proc.process(np.empty((0, n)))[0]


@pytest.mark.parametrize("middle", [2**32, 2**33, 2**53, 2**63])
def test_no_seam_where_counters_carry(middle):
    whole = stream(3, middle - 9, 30)
    for cut in range(30):
        assert_same(stream(3, middle - 9 + cut, 30 - cut), whole[cut:])
    key = noise.noise_key(0, 3, 0, 0)
    with np.errstate(over="ignore"):
        pairs = [noise.pair_of_words(key, U((middle >> 1) + m)) for m in range(3)]
    direct = [noise.radius(a) * v for a, b in pairs for v in noise.turn(b)]
    assert_same(whole[9:15], np.array(direct))
    assert np.unique(whole).size == 30


def test_keys_tell_runs_seeds_streams_and_uses_apart():
    assert len({int(noise.noise_key(*k)) for k in np.ndindex(4, 4, 4, 2)}) == 4 * 4 * 4 * 2
    assert noise.noise_key(2**64 - 1, 2**64 - 1, 2**32 - 1, 1) != noise.noise_key(0, 0, 0, 1)


HARD = [0.0, -0.0, 5e-324, -5e-324, 1e308, -1e308, 1 + 2**-52, 1 - 2**-53, np.inf, np.nan]


def test_fma_without_a_c_library_has_the_same_bits():
    """On Windows below Python 3.13: `math.fma` and the C library are missing there."""
    rng = np.random.default_rng(1)
    words, near = rng.integers(0, 2**64, (8_000, 3), dtype=U), rng.standard_normal((8_000, 2))
    triples = [
        *words.view(np.float64),  # of all sizes, nan and infinite among them
        *((x, y, -(x * y)) for x, y in near),  # where one rounding is all that is left
        *itertools.product(HARD, repeat=3),
    ]
    columns = np.array(triples).T
    want = each(maths.fma, *columns)
    assert_number(each(maths._exact_fma, *(map(float, column) for column in columns)), want)
