"""Rewriting: what is removed or merged, that it changes no sample, and that the plan
says so.
"""

import sys
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from contract import TABLE
from laws import mostly, twins
from refusals import refused

import stimlib
from stimlib import Input, Param, Scene, SceneError, blocks, constant, limits
from stimlib.core.graph import Block, Const, Map, reach
from stimlib.core.guard import Guard
from stimlib.core.program import lower

x = Input("x")
NOISE, WHITE, THREE = blocks.pink_noise(1.0, 1), blocks.white_noise(1), constant(1.0) + 2.0


def kinds(block, **more):
    return [
        type(q.block).__name__ for q in lower({"y": block, **more}).instances if q.kind != "open"
    ]


@pytest.mark.parametrize(
    ("block", "left"),
    [
        (x, ["Input", "Guard"]),
        (1.0 * x, ["Input", "Guard"]),
        (x * 1, ["Input", "Guard"]),
        (x + 0.0, ["Input", "Guard"]),
        (x + 0.0 * NOISE, ["Input", "Guard"]),
        (x + NOISE * 0.0, ["Input", "Guard"]),
        (x + 0 * (NOISE * Param("a", 1.0)), ["Input", "Guard"]),
        (x + blocks.enabled(0.0 * NOISE, by=x), ["Input", "Guard"]),
        (x + blocks.enabled(NOISE, by=-1.0), ["Input", "Guard"]),
        (x + blocks.enabled(NOISE, by=constant(1.0) > 2.0), ["Input", "Guard"]),
        (x + blocks.enabled(WHITE, by=1.0), ["Input", "Const", "White", "Enabled", "Add", "Guard"]),
        # an input may be inf or nan: 0 x is not 0
        (0.0 * x, ["Input", "Const", "Mul", "Guard"]),
        (blocks.where(1.0, x, NOISE), ["Input", "Guard"]),
        (blocks.where(0.0, 0.5, x * 1.0), ["Input", "Guard"]),
        (blocks.where(1.0, x, Input("z")), ["Input", "Guard"]),
        (
            blocks.where(-1.0, x, WHITE * 2.0),
            ["Const", "Input", "White", "Const", "Mul", "Where", "Guard"],
        ),
        (x * (THREE / blocks.where(THREE > 2.0, 2.0, THREE)), ["Input", "Const", "Mul", "Guard"]),
    ],
)
def test_what_is_left_of_a_graph(block, left):
    assert sorted(kinds(block)) == sorted(left)


def test_numbers_are_folded_with_their_units():
    block = x * (blocks.sqrt(THREE * THREE) / 2.0)
    block = block * (constant(2.0, "N/m") * constant(3.0, "m/s") * constant(1.0, "s"))
    proc = stimlib.compile(Scene({"y": block}), 1000, "python")
    assert proc.process(np.array([[1.0, 3.0]])).tolist() == [[9.0, 27.0]]
    assert proc.units == {"x": "1", "y": "N"} and "folded into numbers" in str(proc.plan)


def test_a_number_that_folds_to_nothing_finite():
    for bad in (constant(1.0) / 0.0, blocks.sqrt(constant(-1.0)), blocks.exp(constant(1e4))):
        refused(SceneError, "with the plain numbers", Scene, {"y": x * bad})


def test_equal_parts_run_once():
    def part():
        return blocks.tanh(blocks.first_order(2.0 * Input("x"), 0.1))

    assert kinds(part() * part()).count("FirstOrder") == 1
    assert kinds(blocks.first_order(x, 0.1) * blocks.first_order(x, 0.2)).count("FirstOrder") == 2
    taps = [blocks.fir(x, taps) for taps in ([1, 2], [1, 2], [2, 1])]
    assert kinds(taps[0] * taps[1] * taps[2]).count("Taps") == 2
    proc = stimlib.compile(Scene({"y": part(), "z": 1.0 * part()}), 1000, "python")
    y, z = proc.process(np.ones((1, 5)))
    assert "equal to others" in str(proc.plan) and y.tolist() == z.tolist()
    hashes = [lower({"y": blocks.enabled(WHITE, by=x > k) * x}).hash for k in (2.0, 2.0)]
    assert hashes[0] == hashes[1] != lower({"y": blocks.enabled(WHITE, by=x) * x}).hash


def test_what_is_equal_but_gated_differently_runs_twice():
    noise = blocks.white_noise(1, shared=True)
    block = blocks.enabled(noise, by=x) + blocks.enabled(noise, by=-x)
    assert kinds(block).count("White") == 2
    assert len(lower({"y": block}).parents) == 4


def unfolded(block):
    """The value of a block at one sample by its steps alone, without any rewriting."""
    if isinstance(block, Input):
        return {"x": np.float64(0.7), "y": np.float64(-1.9)}[block.name]
    if isinstance(block, Const):
        return np.float64(block.value)
    return np.float64(type(block).step((), (), *(unfolded(c) for c in block.children))[0])


MADE = [
    lambda a, b, c: a + b,
    lambda a, b, c: a - b,
    lambda a, b, c: a * b,
    lambda a, b, c: blocks.maximum(a, b),
    lambda a, b, c: blocks.where(a, b, c),
    lambda a, b, c: abs(a),
    lambda a, b, c: -a,
    lambda a, b, c: blocks.tanh(a),
    lambda a, b, c: a / (1.5 + abs(b)),
    lambda a, b, c: a > b,
]


@pytest.mark.parametrize("seed", mostly(range(8), range(40)))
def test_rewriting_changes_no_value(seed):
    """Random expressions over inputs, zeros, ones and other numbers."""
    rng = np.random.default_rng(seed)
    pool = [x, Input("y"), constant(0.0), constant(1.0), constant(-2.5), constant(0.3)]
    for _ in range(25):
        args = [pool[k] for k in rng.integers(0, len(pool), 3)]
        pool.append(MADE[rng.integers(0, len(MADE))](*args))
    outputs = {f"y{k}": block for k, block in enumerate(pool[-8:])}
    with np.errstate(all="ignore"):
        wanted = np.array([unfolded(block) for block in outputs.values()])
    for target in ("llvm", "python"):
        proc = stimlib.compile(Scene(outputs), 1000, target)
        point = np.array([{"x": 0.7, "y": -1.9}[n] for n in proc.inputs]).reshape(-1, 1)
        # 0.0 + -0.0 may have lost its sign: equal
        np.testing.assert_array_equal(proc.process(point)[:, 0], wanted)


def low(y, tau=0.01):
    return blocks.first_order(y, tau)


def after(y, count):
    for _ in range(count):
        y = 0.5 * y - 0.25
    return y


Z = Input("z")
PAIRS = {
    "one after the other": low(low(x), 0.02),
    "a few blocks before the second": low(x) + low(after(blocks.delay(Z, 3), 3), 0.02),
    "many blocks before the second": low(x) + low(after(Z, 30), 0.02),
    "noise, which runs before sample 0": (
        low(x) + low(blocks.pink_noise(1.0, 3, f_low=20.0) + 2.0, 0.02)
    ),
    "one of them in a gate": low(x) + blocks.enabled(low(blocks.white_noise(1), 0.02), by=Z),
    "in and out of a gate": (
        low(blocks.white_noise(1)) + blocks.enabled(low(blocks.white_noise(2), 0.02), by=Z)
    ),
    "behind a gate": low(x) + low(blocks.enabled(low(2.0 * blocks.white_noise(1)), by=Z) * x, 0.02),
    "three": low(x) + low(Z, 0.02) + low(Z, 0.03),
    "in contact": blocks.velocity(x, 50.0, contact=Z) + blocks.velocity(Z, 60.0, contact=x),
}


@pytest.mark.parametrize("block", PAIRS.values(), ids=PAIRS)
def test_two_recursions_side_by_side_are_what_each_is_alone(block):
    """What may run in one loop, and what seems so."""
    twins(Scene({"y": block}), 1000, 90)


# Copies of what is gated --------------------------------------------------------------
def nested(levels):
    """Each gate runs, and is opened by, all that is inside it: every level doubles the
    copies.
    """
    block = Param("p", 1.0) + 2.0
    for _ in range(levels):
        block = blocks.enabled(block, by=block)
    return block


@pytest.mark.parametrize("levels", [18, 5000])
def test_copies_behind_gates_are_counted_before_they_are_made(levels):
    """Levels of gates over one block: 2**levels copies, each with a state of its own,
    so only their number can be held.
    """
    before = sys.getrecursionlimit()
    refused(SceneError, "own copies: .* limits.scene_blocks", Scene, {"y": nested(levels)})
    assert sys.getrecursionlimit() == before
    assert len(lower({"y": nested(6)}).instances) == 3 * 2**6 + 1


def test_counting_ends_where_there_are_too_many(monkeypatch):
    """A thousand gates within each other, each with a condition of a thousand blocks: a
    million to walk over.
    """
    y, by = WHITE, blocks.white_noise(2, shared=True)
    for _ in range(1000):
        by = -by
    for _ in range(1000):
        y = blocks.enabled(-y, by=by)
    monkeypatch.setattr(limits, "scene_blocks", 10_000)
    refused(SceneError, r"own copies: 1\d{4} is more than", lower, {"y": y})


def test_the_count_of_copies_is_exact(monkeypatch):
    """A scene passes a limit of as many blocks as it has, parameters and constants
    apart, and not one fewer.
    """
    for entry in TABLE:
        monkeypatch.undo()
        outputs = entry.scene().outputs
        program = lower(outputs)
        copies = sum(not isinstance(q.block, (Param, Const)) for q in program.instances)
        least = max(copies, len(reach([Guard(b) for b in outputs.values()])))
        monkeypatch.setattr(limits, "scene_blocks", least)
        assert lower(outputs).hash == program.hash, entry.name
        monkeypatch.setattr(limits, "scene_blocks", copies - 0.5)
        with pytest.raises(SceneError, match="more than limits.scene_blocks"):
            lower(outputs)
            pytest.fail(entry.name)


# Maps that need the sample rate -------------------------------------------------------
class RateParams(NamedTuple):
    fs: float


@dataclass(frozen=True, eq=False)
class PerSample(Map):
    """x / fs: a map, and no number before the sample rate is known."""

    x: Block

    def design(self, fs):
        return RateParams(fs), ()

    @staticmethod
    def step(p, s, x):
        return x / p.fs, s


@dataclass(frozen=True, eq=False)
class Tiled(Map):
    """x + 1, as a tile."""

    x: Block

    @staticmethod
    def tile(p, s, x, y):
        for i in range(x.size):
            y[i] = x[i] + 1.0
        return s


@pytest.mark.parametrize("fs", [1000.0, 4000.0])
def test_a_map_with_a_design_takes_constants(fs):
    k = Param("k", 3.0)
    outputs = {
        "n": PerSample(constant(2.0)),
        "p": PerSample(k),
        "x": PerSample(constant(2.0)) * x,
        "y": PerSample(k) * x,
    }
    u = np.array([[1.0, -4.0]])
    wanted = np.array([[2, 2], [3, 3], [2, -8], [3, -12]]) / fs
    for target in ("llvm", "python"):
        proc = stimlib.compile(Scene(outputs), fs, target)
        np.testing.assert_array_equal(proc.process(u), wanted)
        assert proc.response("x", "x", 10.0) == 2 / fs and proc.response("y", "x", 10.0) == 3 / fs
        proc = stimlib.compile(Scene({"y": Tiled(constant(2.0)) * x}), fs, target)
        assert (proc.process(u) == 3.0 * u).all()
    signals = stimlib.compile(Scene(outputs), fs, "jax")(motion={"x": u[0]})
    np.testing.assert_allclose([signals[name] for name in outputs], wanted, rtol=1e-15)
