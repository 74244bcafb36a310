"""A map is traced into vectors where these mean the same, and is else a loop: all
targets have the same bits, whatever an author writes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from laws import assert_same

import stimlib
from stimlib import Input, Scene
from stimlib.core import steps
from stimlib.core.graph import Block, Map
from stimlib.core.maths import (
    as_float,
    bits,
    copy,
    each,
    exp,
    floor,
    flush,
    fma,
    sqrt,
    unbits,
    where,
    words,
)
from stimlib.errors import SceneError
from stimlib.targets.numba import lanes

ONE, TWO, THREE, SIGN = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64((1 << 63) + 5)
HALF, GAIN, WHOLE = np.float64(0.5), 2.0, 3


class Numbers(NamedTuple):
    k: float
    u: np.uint64


def by_default(x, k=2.0):
    return k * x


def positive(x):
    return x > 0.0


def summed(a, b):
    for i in range(3):
        a = fma(a, b, i)
    return a


def chained(p, s, a, b):
    return where(a < b < 0.5, 1.0, 0.0), s


def bare(p, s, a, b):
    return a > b, s


def and_one(p, s, a, b):
    return (a > b) + 1.0, s


def halved(p, s, a, b):
    return (a > b) * 0.5, s


def gated(p, s, a, b):
    return a * (a > b), s


def compared(p, s, a, b):
    return where((a > b) < 0.5, a, b), s


def chosen(p, s, a, b):
    return where(a > b, a > 0.0, 0.0), s


def by_a_number(p, s, a, b):
    return where(a, b, 3.0), s


def by_constants(p, s, a, b):
    return where(GAIN > 1.0, b, 3.0), s


def modulo(p, s, a, b):
    return a % 1.0, s


def of_constants(p, s, a, b):
    return a / sqrt(2.0) + floor(2.5) + flush(1e-195), s


def bits_of_one(p, s, a, b):
    return a + as_float(bits(1.0)), s


def word(p, s, a, b):
    return p.u, s


def shifted(p, s, a, b):
    return bits(a) >> THREE, s


def root_of_a_word(p, s, a, b):
    return sqrt(bits(a)) + abs(a > b), s


def minus_a_word(p, s, a, b):
    return as_float(-bits(a)), s


def whole(p, s, a, b):
    return WHOLE * a + b, s


def defaults(p, s, a, b):
    return by_default(a) - by_default(b, 3), s


def helped(p, s, a, b):
    return where(positive(a), 1.0, 2.0) * a / (2 + b * p.k), s


def words_of_constants(p, s, a, b):
    return unbits(where(a > b, SIGN, TWO)) * 1e300, s


def words_added(p, s, a, b):
    return as_float(bits(a) + where(a > b, ONE, TWO)) * as_float(p.u), s


def and_differs(p, s, a, b):
    return where((a > b) & (a != 0.0), 2 * a, -abs(HALF * b)), s


def looped(p, s, a, b):
    return summed(a, b), s


def minus_zero(p, s, a, b):
    return -0.0, s


def two(p, s, a, b):
    return 2, s


LOOPS = (
    chained,
    bare,
    and_one,
    halved,
    gated,
    compared,
    chosen,
    by_a_number,
    by_constants,
    modulo,
    of_constants,
    bits_of_one,
    word,
    shifted,
    root_of_a_word,
    minus_a_word,
    whole,
)
VECTORS = defaults, helped, words_of_constants, words_added, and_differs, looped, minus_zero, two


class MapOfTwo(Map, abstract=True):
    a: Block
    b: Block

    def design(self, fs):
        return Numbers(1.5, np.uint64(7)), ()


def motion(n=500):
    x = np.random.default_rng(3).standard_normal((2, n))
    odd = [0.0, -0.0, 5e-324, -1e-310, 1e-195, 1e308, -1e308, 1.0, 0.5]
    x[0, : len(odd)], x[1, : len(odd)] = odd, odd[::-1]
    x[1, 20:40] = x[0, 20:40]
    return x


def run(block, target, size):
    proc = stimlib.compile(Scene({"y": block}), 1000, target)
    x = motion()[: len(proc.inputs)]
    return np.concatenate(
        [proc.process(x[:, k : k + size].copy()) for k in range(0, x.shape[1], size)], axis=1
    )


@pytest.mark.parametrize("f", [*LOOPS, *VECTORS], ids=lambda f: f.__name__)
def test_whatever_a_map_says_has_the_same_bits(f):
    @dataclass(frozen=True, eq=False)
    class Some(MapOfTwo):
        a: Block
        b: Block
        step = staticmethod(f)

    assert lanes.in_vectors(f, Numbers, "fu", 2) == (f in VECTORS)
    block = Some(Input("a"), Input("b"))
    assert_same(run(block, "numba", 13), run(block, "python", 500))


# Cells that are run again -------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Helped(Map):
    a: Block

    @staticmethod
    def step(p, s, a):
        return by_default(a) * GAIN, s


def test_a_constant_and_a_helper_that_change_are_compiled_again(monkeypatch):
    def again(x):
        return x % GAIN

    for name, v in (
        ("GAIN", 2.0),
        ("GAIN", 5.0),
        ("GAIN", -0.0),
        ("GAIN", 0.0),
        ("GAIN", 7),
        ("by_default", again),
    ):
        monkeypatch.setitem(globals(), name, v)
        assert_same(
            run(Helped(Input("a")), "numba", 64),
            run(Helped(Input("a")), "python", 500),
            f"{name} = {v}",
        )


def of_a_name(x, k=GAIN):
    return x * k


def test_a_default_is_a_number():
    with pytest.raises(SceneError, match="of_a_name: write the default 'GAIN' as a number"):
        steps.check(of_a_name)


# each ---------------------------------------------------------------------------------
def tripled(p, x):
    return x * p.k * 3.0


def exponential(p, x):
    return exp(x)


def sign(p, x):
    return x > 0.0


def between(p, x):
    return where(0.0 < x < p.k, x, 0.0)


def chosen(p, x):
    if x > p.k:
        return x
    return 0.0 * x


def in_place(p, s, a, y):
    copy(a, y)
    each(tripled, p, (y,), y)
    return s


def with_exp(p, s, a, y):
    each(exponential, p, (a,), y)
    return s


def with_truth(p, s, a, y):
    each(sign, p, (a,), y)
    return s


def with_chain(p, s, a, y):
    each(between, p, (a,), y)
    return s


def with_if(p, s, a, y):
    each(chosen, p, (a,), y)
    return s


def with_words(p, s, a, y):
    each(tripled, p, (words(a),), y)
    return s


def with_gaps(p, s, a, y):
    each(tripled, p, (a[::2],), y[::2])
    return s


class State(NamedTuple):
    y: float


def tiled(f):
    @dataclass(frozen=True, eq=False)
    class Some(Block):
        a: Block
        tile = staticmethod(f)

        def design(self, fs):
            return Numbers(1.5, np.uint64(7)), State(0.0)

    return Some(1.0 * Input("a"))


@pytest.mark.parametrize("size", [1, 7, 8, 13, 64])
def test_each_in_place(size):
    """The last vector overlaps the one before: no sample is computed twice."""
    assert_same(run(tiled(in_place), "numba", size), run(tiled(in_place), "python", 500))


@pytest.mark.parametrize(
    ("f", "why"),
    [
        (with_exp, "cannot run in vectors: it uses what they do not have"),
        (with_truth, "cannot run in vectors: it returns no number"),
        (with_chain, "cannot run in vectors: each lane has a truth value of its own"),
        (with_words, "without gaps"),
        (with_gaps, "without gaps"),
    ],
    ids=lambda v: getattr(v, "__name__", ""),
)
def test_each_says_what_it_takes(f, why):
    with pytest.raises(
        SceneError, match=rf"test_lanes.py:\d+: Some.tile: .*({why}).*write a loop over the samples"
    ):
        run(tiled(f), "numba", 64)


def test_a_helper_of_each_is_straight_line():
    with pytest.raises(SceneError, match="chosen: `if` chooses at run time"):
        run(tiled(with_if), "numba", 64)


# Two blocks of one class --------------------------------------------------------------
class Memory(NamedTuple):
    y: float
    last: float
    cold: float


class Gains(NamedTuple):
    k: float
    u: np.uint64


def straight(p, s, a):
    y = where(s.cold > 0.0, a, fma(p.k, a - s.y, s.y) + as_float(p.u) * s.last)
    return flush(y - s.last), Memory(y, a, 0.0)


def decaying(p, s, a):
    y = where(s.cold > 0.0, a, fma(p.k, a - s.y, s.y) * exp(-p.k))
    return y - s.last, Memory(y, a, 0.0)


@pytest.mark.parametrize("f", [straight, decaying], ids=lambda f: f.__name__)
def test_two_blocks_abreast_have_the_same_bits(f):
    """One in each lane, with numbers, inputs and states of its own; or in one loop,
    where vectors lack what it needs.
    """

    @dataclass(frozen=True, eq=False)
    class Some(Block):
        a: Block
        k: float
        step = staticmethod(f)

        def design(self, fs):
            return Gains(self.k, np.uint64(8 * self.k)), Memory(0.0, self.k, 1.0)

    assert lanes.go_abreast(f, Gains, "fu", Memory, "fff", 1) == (f is straight)
    scene = Scene({"y": Some(Input("a"), 0.5), "z": Some(Input("b"), 0.125)})
    ours, wanted = (stimlib.compile(scene, 1000, target) for target in ("numba", "python"))
    x = motion(100)
    y = np.concatenate([ours.process(x[:, k : k + 13].copy()) for k in range(0, 100, 13)], axis=1)
    assert_same(y, wanted.process(x))
    assert_same(ours.state, wanted.state)
    assert len(set(filter(None, ours._engine.segments))) == 2  # with the guard
