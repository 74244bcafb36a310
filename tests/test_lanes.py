"""A map is traced into vectors where these mean the same, and is else a loop: all
targets have the same bits, whatever an author writes."""

import hashlib
import importlib
import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from laws import STRESS, assert_same, cut_at, pair, run, twins
from refusals import refused

import stimlib
from stimlib import Input, Param, Scene, SceneError
from stimlib.blocks import enabled, loop, lowpass, white_noise
from stimlib.core import steps
from stimlib.core.graph import Block, Const, Map, signals
from stimlib.core.maths import as_float, flush, fma, settle, where
from stimlib.core.pointwise import Where
from stimlib.targets.llvm import lanes
from stimlib.targets.llvm.rows import OPERATIONS, SEGMENT

GAIN = 2.0
TRIPLED, IN_PLACE = "return x * p.k * 3.0", "(y,), y"
HEAD = """
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
from stimlib.core.graph import Block, Map, signals
from stimlib.core.maths import as_float, bits, chebyshev, copy, each, floor, flush, fma
from stimlib.core.maths import series, settle, sqrt, unbits, where, words

ONE, TWO, THREE, SIGN = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64((1 << 63) + 5)
ALL, SIX = np.uint64(64), np.uint64(57)
HALF, GAIN, WHOLE = np.float64(0.5), 2.0, 3

class Numbers(NamedTuple):
    k: float
    u: np.uint64

class State(NamedTuple):
    y: float

def by_default(x, k=2.0):
    return k * x

def positive(x):
    return x > 0.0

def turned(u, k):
    return (u << k) | (u >> (ALL - k))

def often(a, b):
    for i in range(600):
        a = a * b + 0.5
    return a

def summed(a, b):
    for i in range(3):
        a = fma(a, b, i)
    return a

"""
MAP = """
@dataclass(frozen=True, eq=False)
class Some(Map):
    a: Block
    b: Block

    def design(self, fs):
        return Numbers(1.5, np.uint64(7)), ()

    @staticmethod
    def step(p, s, a, b):
        return {}, s
"""
TILE = """
def helper(p, x):
    {}

@dataclass(frozen=True, eq=False)
class Some(Block):
    a: Block

    def design(self, fs):
        return Numbers(1.5, np.uint64(7)), State(0.0)

    @staticmethod
    def tile(p, s, a, y):
        copy(a, y)
        each(helper, p, {})
        return s
"""


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Imports a text from a file of its own, as an author has it."""
    monkeypatch.syspath_prepend(tmp_path)

    def module(text):
        name = f"written_{hashlib.sha256(text.encode()).hexdigest()[:12]}"
        (tmp_path / f"{name}.py").write_text(HEAD + text)
        return importlib.import_module(name)

    return module


def by_default(x, k=2.0):
    return k * x


def motion(n=500):
    x = np.random.default_rng(3).standard_normal((2, n))
    odd = [0.0, -0.0, 5e-324, -1e-310, 1e-195, 1e308, -1e308, 1.0, 0.5]
    x[0, : len(odd)], x[1, : len(odd)] = odd, odd[::-1]
    x[1, 20:40] = x[0, 20:40]
    return x


def sampled(block, target, size):
    proc = stimlib.compile(Scene({"y": block}), 1000, target)
    return run(proc, motion()[: len(proc.inputs)], cut_at(500, size))


LOOPS = [
    "often(a, b)",
    "where(a < b < 0.5, 1.0, 0.0)",
    "a > b",
    "(a > b) + 1.0",
    "(a > b) * 0.5",
    "a * (a > b)",
    "where((a > b) < 0.5, a, b)",
    "where(a > b, a > 0.0, 0.0)",
    "where(a, b, 3.0)",
    "where(GAIN > 1.0, b, 3.0)",
    "a % 1.0",
    "a / sqrt(2.0) + floor(2.5) + flush(1e-195)",
    "a + as_float(bits(1.0))",
    "p.u",
    "bits(a) >> THREE",
    "sqrt(bits(a)) + abs(a > b)",
    "as_float(-bits(a))",
    "WHOLE * a + b",
]
VECTORS = [
    "by_default(a) - by_default(b, 3)",
    "where(positive(a), 1.0, 2.0) * a / (2 + b * p.k)",
    "unbits(where(a > b, SIGN, TWO)) * 1e300",
    "as_float(bits(a) + where(a > b, ONE, TWO)) * as_float(p.u)",
    "where((a > b) & (a != 0.0), 2 * a, -abs(HALF * b))",
    "summed(a, b)",
    "as_float(turned(bits(a), ONE - ONE)) - as_float(turned(bits(b), ALL))",
    "as_float(turned(bits(a), bits(b) & SIGN)) + as_float(THREE << (bits(a) >> SIX))",
    "-0.0",
    "2",
]


@pytest.mark.parametrize("text", [*LOOPS, *VECTORS])
def test_whatever_a_map_says_has_the_same_bits(written, text):
    of = written(MAP.format(text))
    assert lanes.in_vectors(of.Some.step, of.Numbers, "fu", 2) == (text in VECTORS)
    block = of.Some(Input("a"), Input("b"))
    assert_same(sampled(block, "llvm", 13), sampled(block, "python", 500))


@pytest.mark.parametrize("helper", [TRIPLED, "return as_float(bits(x) * (SIGN * THREE))"])
def test_each_in_place(written, helper):
    """The last vector overlaps the one before: no sample is computed twice."""
    block = written(TILE.format(helper, IN_PLACE)).Some(1.0 * Input("a"))
    for size in (1, 7, 8, 13, 64):
        assert_same(sampled(block, "llvm", size), sampled(block, "python", 500))


# Cells that are run again -------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Helped(Map):
    a: Block

    @staticmethod
    def step(p, s, a):
        return by_default(a) * GAIN, s


def again(x):
    return x % GAIN


def test_a_constant_and_a_helper_that_change_are_compiled_again(monkeypatch):
    block = Helped(Input("a"))
    looped = Scene({"y": loop(lambda last: Helped(Where(last, Input("a"), Input("a"))))})
    for name, v in (("GAIN", 5.0), ("GAIN", -0.0), ("GAIN", 7), ("by_default", again)):
        monkeypatch.setitem(globals(), name, v)
        wanted = sampled(block, "python", 500)
        assert_same(sampled(block, "llvm", 64), wanted, f"{name} = {v}")
        for target in ("llvm", "python"):
            y = stimlib.compile(looped, 1000, target).process(motion()[:1])
            assert_same(y, wanted, f"{name} = {v} in a loop, {target}")
        one = stimlib.compile(Scene({"y": block}), 1000, "python").process(np.ones((1, 1)))
        for outputs in ({"y": block}, looped.outputs):
            f = stimlib.compile(Scene(outputs), 1000, "jax")
            assert f({}, {"a": np.ones(1)})["y"] == one[0]


def of_a_name(x, k=GAIN):
    return x * k


def test_a_default_is_a_number():
    refused(SceneError, "of_a_name: .* 'GAIN' as a number", steps.check, of_a_name)


# each ---------------------------------------------------------------------------------


VECTORS_LACK = (
    r"written_\w+.py:\d+: Some.tile: .*cannot run in vectors: %s.*write a loop over the samples"
)


STAGES = """
class Rows(NamedTuple):
    y: np.ndarray

def stage(p, s, x):
    {}

@dataclass(frozen=True, eq=False)
class Some(Block):
    a: Block

    def design(self, fs):
        return Rows(np.full({}, 0.5)), Rows(np.zeros({}))

    @staticmethod
    def step(p, s, a):
        return a, s

    @staticmethod
    def tile(p, s, a, y):
        series(stage, p, s, a, y)
        return s
"""


@pytest.mark.parametrize(
    ("stage", "gains", "states", "why"),
    [
        # compiled, it would read beyond the array
        ("return p.y * x, Rows(x)", 2, 3, "IndexError"),
        ("return p.y * x, Rows(x)", 0, 0, "series needs at least one stage"),
        ("return p.y * x", 3, 3, r"must return its output and the new state Rows\(..\)"),
        ("return x, State(x)", 3, 3, r"must return its output and the new state Rows\(..\)"),
    ],
)
def test_a_tile_beside_a_step_is_tried(written, stage, gains, states, why):
    block = written(STAGES.format(stage, gains, states)).Some(1.0 * Input("a"))
    for target in ("python", "llvm"):
        refused(SceneError, rf"written_\w+.py:\d+: Some.tile: .*{why}", sampled, block, target, 64)


def test_stages_have_the_same_bits_whatever_they_return(written):
    """Constants of a stage are as wide as its lanes, for each number of stages."""
    values = "x + p.y * s.y", "-0.0", "where(x > 0.0, 1, 2.5)"
    step = "    @staticmethod\n    def step(p, s, a):\n        return a, s\n"
    both = itertools.product(values, values)
    for k, (out, new) in enumerate(both if STRESS else zip(values, values[::-1], strict=True)):
        text = STAGES.replace(step, "").format(f"return {out}, Rows({new})", *[k % 11 + 1] * 2)
        some = written(text).Some(1.0 * Input("a"))
        of = [sampled(some, target, 64) for target in ("llvm", "python")]
        assert_same(*of, f"return {out}, Rows({new})")


@pytest.mark.parametrize(
    ("helper", "given", "why"),
    [
        ("return settle(x)", IN_PLACE, VECTORS_LACK % "it uses something that they do not support"),
        ("return x > 0.0", IN_PLACE, VECTORS_LACK % "it must return a number"),
        (
            "return where(0.0 < x < p.k, x, 0.0)",
            IN_PLACE,
            VECTORS_LACK % "each lane has a truth value of its own",
        ),
        (
            TRIPLED,
            "(words(a),), y",
            r"written_\w+.py:\d+: Some.tile: .*without gaps.*write a loop over the samples",
        ),
        (
            TRIPLED,
            "(a[::2],), y[::2]",
            r"written_\w+.py:\d+: Some.tile: it does not compile: a slice .*with a step",
        ),
        (
            "for i in range(2000):\n        x = x * p.k + i\n    return x",
            IN_PLACE,
            "helper cannot run in vectors: it has more than 1024 operations",
        ),
        (
            "if x > p.k:\n        return x\n    return 0.0 * x",
            IN_PLACE,
            "helper: `if` chooses at run time",
        ),
    ],
)
def test_each_says_what_it_takes(written, helper, given, why):
    block = written(TILE.format(helper, given)).Some(1.0 * Input("a"))
    refused(SceneError, why, sampled, block, "llvm", 64)


# Two blocks of one class --------------------------------------------------------------
class Memory(NamedTuple):
    y: float
    last: float
    cold: float


class Gains(NamedTuple):
    k: float
    u: np.uint64
    unused: float | np.ndarray


def straight(p, s, a):
    y = where(s.cold > 0.0, a, fma(p.k, a - s.y, s.y) + as_float(p.u) * s.last)
    return flush(y - s.last), Memory(y, a, 0.0)


def held(p, s, a):
    y = where(s.cold > 0.0, a, 0.5 * s.y + a)
    return y, Memory(y, a, s.cold)


def decaying(p, s, a):
    y = where(s.cold > 0.0, a, settle(fma(p.k, a - s.y, s.y)))
    return y - s.last, Memory(y, a, 0.0)


@pytest.mark.parametrize("count, forms", [(2, 1), (3, 2), (4, 1), (8, 1), (23, 4)])
@pytest.mark.parametrize(
    ("f", "kind", "unused"),
    [(straight, "f", 0.0), (straight, "F", np.ones(2)), (decaying, "f", 0.0)],
)
def test_blocks_abreast_have_the_same_bits(f, kind, unused, count, forms):
    """One in each lane, with numbers, inputs and states of its own; or two in one loop,
    where vectors lack what it needs.
    """

    @dataclass(frozen=True, eq=False)
    class Some(Block):
        a: Block
        k: float
        step = staticmethod(f)

        def design(self, fs):
            return Gains(self.k, np.uint64(8 * self.k), unused), Memory(0.0, self.k, 1.0)

    abreast = lanes.go_abreast(f, Gains, f"fu{kind}", Memory, "fff", 1)
    assert abreast == (f is straight and kind == "f")
    some = (Some(Input("ab"[i % 2]), 0.5 - i / 64) for i in range(count))
    ours, *_ = twins(Scene({f"y{i}": one for i, one in enumerate(some)}), 1000, motion(100), 13)
    if not abreast:
        forms = 1 + count % 2
    assert len(set(filter(None, ours._engine.segments))) == forms + 1  # with the guard


def test_blocks_of_one_step_of_which_some_are_reset_are_apart():
    @dataclass(frozen=True, eq=False)
    class Held(Block, abstract=True):
        step = staticmethod(held)

        def design(self, fs):
            return (), Memory(0.5, 0.0, 1.0)

    @dataclass(frozen=True, eq=False)
    class Cold(Held):
        a: Block

    @dataclass(frozen=True, eq=False)
    class Reset(Held):
        a: Block
        contact: Block
        resettable = True

    of = {f"cold_{name}": Cold(Input(name)) for name in "ab"}
    of |= {f"reset_{name}": Reset(Input(name), Const(1.0)) for name in "ab"}
    twins(Scene(of), 1000, motion(100), 13)


def test_blocks_of_which_one_hears_another_are_not_abreast():
    """Directly, through others, and beside some that do not; nor two of which one
    begins before sample 0.
    """

    @dataclass(frozen=True, eq=False)
    class Some(Block):
        a: Block
        step = staticmethod(straight)

        def design(self, fs):
            return Gains(0.5, np.uint64(2), 0.0), Memory(0.0, 0.25, 1.0)

    fed = [Some(white_noise(1)), Some(Input("a")), Some(Input("b"))]
    for i in range(8):
        fed.append(Some(fed[-1 - i % 3] if i % 2 else 0.5 * fed[-2] - fed[-1]))
    twins(Scene({f"y{i}": one for i, one in enumerate(fed)}), 1000, motion(100), 13)


@pytest.mark.parametrize("seed", range(10))
def test_operations_in_a_row_have_the_same_bits(seed):
    """With signals that others read, in a gate and outside."""
    rng = np.random.default_rng(seed)
    fed = [Input("a"), Input("b"), Param("k", -0.5)]
    for _ in range(int(rng.integers(4, 40))):
        make = OPERATIONS[rng.integers(len(OPERATIONS))]
        some = [fed[-1], *(fed[i] for i in rng.integers(len(fed), size=2))]
        fed.append(make(*some[: len(signals(make))]))
    held = Param("h", 2.0) * 3.0 + Param("k", -0.5) - 1.0
    gated = enabled(held + held * white_noise(1) - abs(held), by=fed[-2] > 0.25)
    ours, wanted = pair(Scene({"y": fed[-1], "z": fed[len(fed) // 2], "gated": gated}), 1000)
    x = np.vstack([motion(150)] * 2)[:2] * [[1.0], [-0.5]]
    x[:, 100:104] = [[0.0, -0.0, 5e-324, 1e308], [-0.0, 0.0, 1.0, 1e308]]
    for p in (ours, wanted):
        p.set("k", 1.25, ramp=0.02)
    x = x[: len(ours.inputs)]
    assert_same(run(ours, x, cut_at(150, 13)), wanted.process(x))


@pytest.mark.parametrize("count, own", [(3, 0), (4, 1), (512, 1), (513, 0)])
def test_a_row_of_operations_shares_a_segment_unless_it_is_very_long(count, own):
    y = Input("x")
    for i in range(count):
        y = y * (1.0 + 1.0 / (i + 2))
    segments = stimlib.compile(Scene({"y": y}), 1000)._engine.table[:, 0]
    assert np.sum(segments >= SEGMENT) == own + 1  # with the guard


@pytest.mark.parametrize("order, count, forms", [(2, 11, 3), (4, 7, 2), (8, 8, 1), (8, 7, 1)])
def test_filters_abreast_have_the_same_bits(order, count, forms):
    """Sections of one filter are in lanes, or those of many: with fewer sections."""
    scene = Scene({f"y{i}": lowpass(Input("ab"[i % 2]), 50.0 + i, order) for i in range(count)})
    ours, *_ = twins(scene, 1000, motion(300), 13, 64)
    assert len(set(filter(None, ours._engine.segments))) == forms + 1  # with the guard


ABREAST = """
class Gain(NamedTuple):
    k: float

class Rows(NamedTuple):
    y: np.ndarray

def stage(p, s, x):
    y = p.k * x + s.y
    return y, Rows(0.5 * y)

def louder(p, x, z):
    return p.k * x + z

@dataclass(frozen=True, eq=False)
class Some(Block):
    a: Block
    size: int

    def design(self, fs):
        return Gain(0.5 + self.size), Rows(np.full(self.size, 0.25))

    @staticmethod
    def abreast(p):
        return 2

    @staticmethod
    def tile(p, s, a, y):
        {}
        return s
"""


@pytest.mark.parametrize("p", ["p", "Gain(3.0)"])
def test_tiles_of_an_author_abreast_have_the_same_bits(written, p):
    """Only those with as many stages, which their states alone may say."""
    tile = f"series(stage, p, s, a, y)\n        each(louder, {p}, (y, a), y)"
    some = written(ABREAST.format(tile)).Some
    scene = Scene({f"y{i}": some(Input("ab"[i % 2]), i % 3 + 1) for i in range(6)})
    twins(scene, 1000, motion(100), 13)


def test_a_tile_of_an_author_has_each_long_sum(written):
    tile = "chebyshev(s.y, a, w[: 8 * a.size])\n        for i in range(y.size): y[i] = w[8 * i]"
    text = ABREAST.format(tile).replace("s, a, y):", "s, a, y, w):")
    some = written(text.replace("abreast", "work").replace("return 2", "return 512")).Some
    twins(Scene({"y": some(Input("a"), 24)}), 1000, motion(100)[:1], 64)


def test_a_tile_that_cannot_go_abreast_is_named(written):
    some = written(ABREAST.format("series(stage, Gain(p.k), s, a, y)")).Some
    scene = Scene({name: some(Input(name), 3) for name in "ab"})
    why = r"written_\w+.py:\d+: Some.tile: .*p.k.*nothing but call series and each"
    refused(SceneError, why, stimlib.compile, scene, 1000)


@pytest.mark.parametrize("returned", ["None", "'2'", "p"])
@pytest.mark.parametrize(
    ("what", "of", "y"), [("abreast", "blocks", "y"), ("work", "words", "y, w")]
)
def test_what_is_no_number_of_blocks_or_words_is_named(written, what, of, y, returned):
    text = ABREAST.format("series(stage, p, s, a, y)").replace("return 2", f"return {returned}")
    some = written(text.replace("abreast", what).replace("s, a, y):", f"s, a, {y}):")).Some
    scene = Scene({name: some(Input(name), 3) for name in "ab"})
    why = rf"written_\w+.py:\d+: Some.{what}: it must return a number of {of}, such as 4, and ret"
    refused(SceneError, why, stimlib.compile, scene, 1000)
