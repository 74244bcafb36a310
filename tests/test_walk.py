"""What the walk writes means what Python means, form by form; and what it refuses."""

import linecache
import shutil
import textwrap

import numpy as np
import pytest
from laws import STRESS
from refusals import refused
from walked import compiled, in_c

from stimlib.core import steps
from stimlib.core.maths import settle, where  # noqa: F401
from stimlib.targets.llvm import walk

needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
ODD = [0.0, -0.0, 1.0, -1.0, 0.5, np.inf, -np.inf, np.nan, 5e-324, -3.0, 1e308]
ONE, COUNTS, HERE, gain = np.uint64(1), (3, 1, 2), globals(), 5.0
NAN, TOP = np.nan, 2**63 - 1
FLOATS = """x + y;x - y;x * y;x / y;x % y;-x;x % 1.0;i * x;x - 3;2 / y;-7.0 % y;x % -2.5;y % i
;1e3 % -2.5;2.0**3;(x > y) * 0.5;abs(x);min(x, y);max(x, y);max(x, 1.0, y);min(i, y);abs(x < y)
;of_name(x);of_name(x, gain=y)"""
WHOLE = """i + j;i - j;i * j;i / n;i // n;i % n;-i;i & j;i | j;i ^ j;i >> 3;i << 5;i % -7;i // -7
;-7 // n;-7 % n;7 // -2;(i > n) + 1;n >> (i & 63);1 << (n & 31);abs(i);min(i, j);max(i, j, 3)
;round(i * 0.5);round(i * -0.3);float(i) / 4;np.int64(i * 0.3);max(-i, -5, 7 - j);u < v;u >= v
;u == v;u != v;np.float64(u);np.int64(u >> ONE) >> 12;u / v;np.int64(i) % np.int64(j & 1)
;np.int64(i) * 6364136223846793005 + 1442695040888963407;np.int64(i) * i << 40
;np.int64(i) * 3000000000;np.int64(i) // np.int64(j & 1);np.int64(i) >> np.int64(j & 127)
;np.int64(i) << np.int64(j & 127);np.int64(i) >> 64;(np.int64(i) << 70) + j"""
WORDS = """u + v;u - v;u * v;u << ONE;u >> 7;u & v;u | v;u ^ v;-u;u + 1;u // (v | ONE)
;u % (v | ONE);u << (v & np.uint64(63));where(u > v, u, ONE);np.uint64(i * i)
;u << np.uint64(64);(u >> np.uint64(70)) | v
;u << (v & np.uint64(127));u >> (v & np.uint64(127));u % (v & ONE);u // (v & ONE)"""
TRUTHS = """x < y;x <= y;x > y;x >= y;x == y;x != y;i < j;i <= j;i > j;i >= j;i == j;i != j;i < x
;x < y <= 1.0;-1.0 < x != y > i;1.0 if x < y and i > j or not i else -1.0
;2 if not (x == y or x != x) else y;1 if i and j else 0;0 if x or y else i if i > 3 else x
;i in (j, 3);i not in COUNTS;a[i] if i >= 0 and i < a.size and (x < 1.0 or y) else j"""


def of(text, *lines):
    """A function of a text, with a source as if it were in a file."""
    source = "def f(x, y, i, j, u, v, a, o, w):\n    n = j if j != 0 else 3\n"
    source += textwrap.indent("\n".join([text, *lines]), "    ") + "\n"
    linecache.cache[text] = len(source), None, source.splitlines(True), text
    exec(compile(source, text, "exec"), HERE)
    steps.source(HERE["f"])  # read now: anybody may empty linecache
    return HERE["f"]


def each_of(name, texts):
    texts = texts.replace("\n", "").split(";")
    return of(*(f"{name}[{k}] = {text}" for k, text in enumerate(texts)))


def whiles(x, y, i, j, u, v, a, o, w):
    n, s, k, grown = i % 50, 0, 0, j > 3
    while True:
        k += 1
        if k % 3 == 0:
            continue
        if k > n:
            break
        s += k * x  # a whole number until here
        grown = grown + k  # a truth value
    while n > 3 and s != s + 1.0:
        n -= 2
        while n > 9:
            n //= 3
            if n == 5:
                break
        s = 1 - s
    o[0], o[1], o[2], o[3] = s, k, grown, n


def ranges(x, y, i, j, u, v, a, o, w):
    s, last = 0, -1
    for k in range(i % 9 - 4, j % 9 - 4):
        s = 3 * s + k
        if k == 2:
            continue
        s += 1
    for k in range(j % 9, i % 7 - 3, -2):
        s = 2 * s - k
    for last in range(4, 4 + i % 3):
        s += last
    for m in range(-1, 10, 3):
        for k in COUNTS:
            s += k * m
        if m > j % 10:
            break
    for k in range(a.size):
        s = s + a[k] * k
    o[0], o[1], o[2], o[3] = s, last, m, k


def found(x, y, i, most=50):
    if x > y:
        return 1, i  # a float below
    if i > 0:
        for k in range(i % most + 1):
            if k * k > i:
                return y, k
    else:
        return x, 0
    return 0.5, -1


def returns(x, y, i, j, u, v, a, o, w):
    o[0], o[1] = found(*(x, y), i)
    o[2], o[3] = found(y, *(x, j, 7))
    pair, part = (x, i), a
    for k in range(i % 3):
        pair, part = (pair[1], pair[0]), part[k:]
        if x > 1.0 and k > 0:
            return
    (o[4], o[5]), o[6] = pair, part[0]


def slices(x, y, i, j, u, v, a, o, w):
    i, j, s = i % 25 - 12, j % 25 - 12, 0.0
    part = a[i:j]
    o[0], o[1], o[2], o[3] = part.size, a[i:].size, a[:j].size, a[2:][i:-1].size
    for k in range(part.size):
        s += (k + 1) * part[k]
    o[4] = s
    a[1:5] = a[3:7]
    a[2:] = a[:-2]
    part[1:] = part[:-1]
    a[:i] = x
    a[j:][:2] = 3
    i, j = i % 16 - 8, j % 8
    a[-1] += x
    a[i] *= y
    a[j] -= 1
    a[-1 - j] = a[i] / 3
    a[i], a[j] = a[j], a[i]
    w[0] ^= v
    w[-2] += ONE


def edges(x, y, i, j, u, v, a, o, w):
    s, k = 0, j % 5
    for m in range(TOP - 9, TOP, 7):
        s = 3 * s + (m & 255)
    for m in range(TOP - 13 + k, TOP - 4 + k, 7):
        s = 3 * s + (m & 255)
    for m in range(-TOP + 13 - k, -TOP + 3 - k, -7):
        s = 3 * s + (m & 255)
    for m in range(-TOP - 1, TOP, TOP):
        s = 3 * s + (m & 255)
    o[0], o[1], o[2] = s, np.int64(2**62) * 4 + 6 >> 1, x * (2**62 * 8 >> 3)
    o[3], o[4] = i ^ -(2**63), i ^ np.int64(2**62) << 1
    o[5] = 1.0 if NAN in (NAN,) and i in (i, 5) and x not in (1.0, NAN) else 0.0


FORMS = {f.__name__: f for f in (whiles, ranges, returns, slices, edges)} | {
    t.replace("\n", "")[:9]: each_of("w" if t is WORDS else "o", t)
    for t in (FLOATS, WHOLE, WORDS, TRUTHS)
}


IN_C = "f8", "f8", "i8", "i8", "u8", "u8", "f8*", "f8*", "u8*"
on_targets = pytest.mark.parametrize("target", ["llvm", pytest.param("c", marks=needs_gcc)])


def made_for(target, f, folder):
    return compiled(f) if target == "llvm" else in_c(f, IN_C, folder)


@on_targets
@pytest.mark.parametrize("name", FORMS)
def test_a_form_is_what_python_makes_of_it(name, target, tmp_path):
    if (name, target) == ("returns", "c"):
        pytest.skip("in C, a tuple keeps the kinds of its parts")
    f, rng = FORMS[name], np.random.default_rng(0)
    walked = made_for(target, f, tmp_path)
    for _ in range(3000 if STRESS else 400):
        x, y = np.where(rng.random(2) < 0.5, rng.choice(ODD, 2), rng.standard_normal(2) * 9.0)
        i, j = (rng.standard_normal(2) * 10.0 ** rng.integers(0, 7)).astype(int).tolist()
        u, v = rng.integers(0, 2**64, 2, np.uint64) >> rng.integers(0, 64, 2, np.uint64)
        made = []
        for run in (f, walked):
            made.append((np.arange(8.0), np.zeros(50), np.zeros(24, np.uint64)))
            with np.errstate(all="ignore"):
                run(x, y, i, j, u, v, *made[-1])
        for one, other in zip(*made, strict=True):
            differ = (one != other) | (np.signbit(one) != np.signbit(other))
            differ &= (one == one) | (other == other)
            assert not differ.any(), (x, y, i, j, u, v, np.flatnonzero(differ), one, other)


def given():
    return 3.0, 2.0, 3, 4, ONE, ONE, np.arange(8.0), np.zeros(8), np.zeros(8, np.uint64)


@pytest.mark.parametrize(
    ("text", "says"),
    {
        "w[0] = u + i": "uint64 .* make both",
        "o[0] = u < j": "uint64 .* make both",
        "o[0] = a[x]": "index .* float",
        "o[0] = x[0]": "number",
        "o[:] = a[::2]": "slice .* step",
        "if x > 0.0: n = 1.0, 2.0": "n changes what",
        "for k in range(2): n = np.uint64(k)": "n is i8 and becomes u8",
        "for k in range(2): later = where if k > 0 else abs": "no number",
        "o[0] = later; later = 1.0": "later has no value",
        "o[0] = x // y": "FloorDiv of floats",
        "o[0] = x ** y": "Pow of floats",
        "for k in range(x): pass": "range are whole",
        "for k in range(0, 9, n): pass": "step of a range",
        "for k in range(0, i, 0): pass": "step of a range .* not 0",
        "o[0] = 1.0 if x in (2.0, x) else 0.0": "`in` with numbers .* ==",
        "o[0] = i + 2**64": "more than 64 bits",
        "for k in a: o[0] = k": "loop with for",
        "o[:8] = w[:8]": "another kind",
        "o[0] = a": "whole array.* loop",
        "x, y = i": "no parts",
        "o[0] = int(x)": "int has no value",
        "o[x > y] = x": "index .* comparison",
        "o[0] = found(*a)": "only a tuple",
        "later = x > y; o[0] = later + later": "comparisons.*where",
        "o[0] = where(x > y, u, 1.0)": "where of a uint64",
        "o[0] = a.mean": "only fields",
        "o[0] = " + " + ".join(["x"] * 900): "too deep: split",
    }.items(),
)
def test_what_has_no_form_is_refused(text, says):
    refused(walk.Unknown, says, compiled(of(text)), *given())


def of_name(x, *, gain=2.0):
    return x * gain


@pytest.mark.parametrize(
    "text",
    [
        "o[0] = x or 2.0",
        "o[0] = x and 2.0",
        "o[0] = a[abs(i) | -1]",
        "o[0] = a[abs(i) ^ -1]",
        "o[0] = u > -1",
        "o[0] = a[np.int64((u & ONE) + np.uint64(2**64 - 4))]",
        "a[np.int64((u & ONE) + np.uint64(2**64 - 4)) :] = x",
        "a[np.uint64(2**63) :] = x",
        "a[: np.uint64(2**63)] = x",
        "o[0], o[1] = found(y, x, 20, most=3)",
        "o[0], o[1] = found(*(y, x), 20, most=3)",
        "o[0] = of_name(x)",
        "o[:3] = a[1:2]",
        "for k in range(2): o[0] += 1.0\nelse: o[0] = 7.0",
        "while n > 9: n -= 1\nelse: o[0] = 7.0",
        "for gain in range(3):\n    for gain in range(2): o[0] += 1.0\n    o[1] += gain",
        "for k in range(3):\n    for i in COUNTS:\n        if i < 2: break\n        o[k] += 1.0",
        "for i in COUNTS:\n    if i < 2: continue\n    o[0] += 1.0",
        "o[0] = COUNTS[i % 3]",
        "o[0] = x.real",
        "o[0] = ONE is ONE",
    ],
)
def test_what_is_not_refused_is_what_python_makes_of_it(text):
    wanted, made = given(), given()
    of(text)(*wanted)
    try:
        compiled(of(text))(*made)
    except walk.Unknown:
        return
    np.testing.assert_array_equal(made[-2], wanted[-2])


@pytest.mark.parametrize("first", ["x", "a[-1]"])
@pytest.mark.parametrize(
    "turn", ["z += z", "z = settle(z + z)", "z = z * (1.0 - z) if z > 0.5 else z * z"]
)
def test_a_number_that_stays_the_same_in_a_loop_compiles_however_often_it_is_used(first, turn):
    wanted, made = given(), given()
    turns = "\n    ".join([f"z = {first}", *[turn] * 30, "o[k] = z * a[k]"])
    f = of(f"for k in range(o.size):\n    {turns}")
    with np.errstate(all="ignore"):
        f(*wanted)
    compiled(f)(*made)
    np.testing.assert_array_equal(made[-2], wanted[-2])


@on_targets
def test_whole_numbers_of_64_bits_wrap_as_those_of_numpy(target, tmp_path):
    texts = "i + j;i - j;i * j;3 * i;(i * j) * j + i >> 5;abs(i - j) & 9"
    texts += ";(i + j > i) + 2 * (i + 9 > i) + 4 * (i - 7 < 0)"
    f, rng = each_of("o", texts + ";-i + (i * 2 // 2 == i)"), np.random.default_rng(0)
    walked = made_for(target, f, tmp_path)
    edges = [1, -1, 3, 2**31, -(2**32), 2**62, TOP, -TOP, -TOP - 1]
    for _ in range(300):
        i, j = rng.choice(edges, 2) if rng.random() < 0.5 else rng.integers(-TOP, TOP, 2)
        wanted, made = given(), given()
        for run, to in ((f, wanted), (walked, made)):
            with np.errstate(all="ignore"):
                run(*to[:2], i, j, *to[4:])
        np.testing.assert_array_equal(made[-2], wanted[-2], f"{i}, {j}")


@on_targets
@pytest.mark.parametrize(
    "text", ["w[0] = np.uint64(x)", "o[0] = np.int64(x)", "o[0] = np.int64(x) == x"]
)
def test_a_float_beyond_64_bits_is_what_numpy_makes_of_it(text, target, tmp_path):
    f = of(text)
    walked, rng = made_for(target, f, tmp_path), np.random.default_rng(0)
    edges = [np.nextafter(s * 2.0**k, t) for s in (1, -1) for k in (62, 63, 64) for t in (0, 1e99)]
    scattered = rng.standard_normal(300) * 2.0 ** rng.integers(0, 80, 300)
    for x in [*ODD, *edges, *(s * 2.0**k for s in (1, -1) for k in (62, 63, 64, 65)), *scattered]:
        wanted, made = given(), given()
        for run, to in ((f, wanted), (walked, made)):
            with np.errstate(all="ignore"):
                run(np.float64(x), *to[1:])
        for one, other in zip(made[-2:], wanted[-2:], strict=True):
            np.testing.assert_array_equal(one, other, f"{x}")
