"""Rewriting: what is removed or merged, that it changes no sample, and that the plan
says so.
"""

import sys
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from contract import TABLE
from laws import assert_same, pair

import stimlib
from stimlib import Input, Param, Scene, blocks, constant
from stimlib.core.graph import Add, Block, Const, Guard, Map, Mul, reach
from stimlib.core.program import lead, lower
from stimlib.errors import SceneError
from stimlib.system.limits import limits

x = Input("x")


def kinds(block, **more):
    return [
        type(q.block).__name__ for q in lower({"y": block, **more}).instances if q.kind != "open"
    ]


def test_numbers_are_folded():
    three = constant(1.0) + 2.0
    block = x * (blocks.sqrt(three * three) / blocks.where(three > 2.0, 2.0, three))
    assert kinds(block) == ["Input", "Const", "Mul", "Guard"]
    proc = stimlib.compile(Scene({"y": block}), 1000)
    np.testing.assert_array_equal(proc.process(np.array([[1.0, 3.0]])), [[1.5, 4.5]])
    assert "folded into numbers" in str(proc.plan)


def test_a_fold_keeps_the_unit():
    block = constant(2.0, "N/m") * constant(3.0, "m/s") * Input("t", "s")
    proc = stimlib.compile(Scene({"y": block}), 1000)
    assert proc.units == {"t": "s", "y": "N"}
    scene = Scene(
        {"y": constant(1.0, "m") + constant(2.0, "N") / constant(1.0, "N/m") + Input("z", "m")}
    )
    assert stimlib.compile(scene, 1000).process(np.zeros((1, 1))) == 3.0


def test_a_number_that_folds_to_nothing_finite():
    for bad in (
        constant(1.0) / 0.0,
        blocks.sqrt(constant(-1.0)),
        blocks.log(constant(0.0)),
        blocks.exp(constant(1e4)),
    ):
        with pytest.raises(SceneError, match="with the plain numbers"):
            Scene({"y": x * bad})


def test_a_literal_zero_removes_what_no_input_reaches():
    noise = blocks.pink_noise(1.0, 1)
    for block in (
        x + 0.0 * noise,
        x + noise * 0.0,
        x + 0 * (noise * Param("a", 1.0)),
        x + blocks.enabled(0.0 * noise, by=x),
    ):
        proc = stimlib.compile(Scene({"y": block}), 1000)
        assert kinds(block) == ["Input", "Guard"]
        assert "literal 0" in str(proc.plan) or "nothing in it" in str(proc.plan)
        np.testing.assert_array_equal(proc.process(np.ones((1, 3))), 1.0)
    assert "Input" in kinds(0.0 * x), "an input may be inf or nan: 0 x is not 0"
    proc = stimlib.compile(Scene({"y": 0.0 * x}), 1000)
    proc.process(np.array([[np.nan]]))
    assert proc.fault == ("y", 0)


def test_a_gate_that_never_opens_is_removed():
    noise = blocks.white_noise(1)
    for by in (0.0, -1.0, constant(1.0) > 2.0):
        assert kinds(x + blocks.enabled(noise, by=by)) == ["Input", "Guard"]
    assert "Enabled" in kinds(x + blocks.enabled(noise, by=1.0))


def test_a_literal_one_is_removed():
    assert kinds(1.0 * x) == kinds(x * 1) == kinds(x + 0.0) == ["Input", "Guard"]


def test_equal_parts_run_once():
    def part():
        return blocks.tanh(blocks.first_order(2.0 * Input("x"), 0.1))

    assert kinds(part() * part()).count("FirstOrder") == 1
    assert kinds(blocks.first_order(x, 0.1) * blocks.first_order(x, 0.2)).count("FirstOrder") == 2
    assert (
        kinds(blocks.fir(x, [1, 2]) * blocks.fir(x, [1, 2]) * blocks.fir(x, [2, 1])).count("Taps")
        == 2
    )
    proc = stimlib.compile(Scene({"y": part(), "z": 1.0 * part()}), 1000)
    assert "equal to others" in str(proc.plan)
    y = proc.process(np.ones((1, 5)))
    np.testing.assert_array_equal(y[0], y[1])


def test_what_is_equal_but_gated_differently_runs_twice():
    noise = blocks.white_noise(1, shared=True)
    block = blocks.enabled(noise, by=x) + blocks.enabled(noise, by=-x)
    assert kinds(block).count("White") == 2
    assert len(lower({"y": block}).parents) == 4


def test_only_what_an_output_reaches_is_there():
    Input("unused")
    scene = Scene({"y": x})
    assert list(scene.inputs) == ["x"]
    assert kinds(x) == ["Input", "Guard"]


def unfolded(block):
    """The value of a block at one sample by its steps alone, without any rewriting."""
    if isinstance(block, Input):
        return {"x": np.float64(0.7), "y": np.float64(-1.9)}[block.name]
    if isinstance(block, Const):
        return np.float64(block.value)
    return np.float64(type(block).step((), (), *(unfolded(c) for c in block.children))[0])


@pytest.mark.parametrize("seed", range(40))
def test_rewriting_changes_no_value(seed):
    """Random expressions over inputs, zeros, ones and other numbers."""
    rng = np.random.default_rng(seed)
    pool = [x, Input("y"), constant(0.0), constant(1.0), constant(-2.5), constant(0.3)]
    for _ in range(25):
        a, b, c = (pool[k] for k in rng.integers(0, len(pool), 3))
        make = [
            lambda a=a, b=b: a + b,
            lambda a=a, b=b: a - b,
            lambda a=a, b=b: a * b,
            lambda a=a, b=b: blocks.maximum(a, b),
            lambda a=a, b=b, c=c: blocks.where(a, b, c),
            lambda a=a: abs(a),
            lambda a=a: -a,
            lambda a=a: blocks.tanh(a),
            lambda a=a, b=b: a / (1.5 + abs(b)),
            lambda a=a, b=b: a > b,
        ]
        pool.append(make[rng.integers(0, len(make))]())
    outputs = {f"y{k}": block for k, block in enumerate(pool[-8:])}
    with np.errstate(all="ignore"):
        wanted = np.array([unfolded(block) for block in outputs.values()])
    for target in ("numba", "python"):
        proc = stimlib.compile(Scene(outputs), 1000, target)
        point = np.array([[{"x": 0.7, "y": -1.9}[n]] for n in proc.inputs]).reshape(
            len(proc.inputs), 1
        )
        # 0.0 + -0.0 may have lost its sign: equal
        np.testing.assert_array_equal(proc.process(point)[:, 0], wanted)


def test_order_of_running_is_children_first():
    noise = blocks.enabled(
        blocks.fir(blocks.white_noise(1), [1, 1]), by=blocks.first_order(x, 0.1) > 0.0
    )
    program = lower({"y": noise * x, "z": noise})
    for i, q in enumerate(program.instances):
        assert all(a < i for a in q.args)
    opened = [q.child for q in program.instances if q.kind == "open"]
    assert opened == [2] and program.parents == [-1, -1, 1]


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
    fast, slow = pair(Scene({"y": block}), 1000)
    u = np.random.default_rng(7).standard_normal((len(fast.inputs), 90))
    assert_same(fast.state, slow.state)
    assert_same(fast.process(u), slow.process(u))
    assert_same(fast.state, slow.state)


class Ahead(NamedTuple):
    gain: float
    more: float


class Behind(NamedTuple):
    more: float
    gain: float


class Sum(NamedTuple):
    y: float


@dataclass(frozen=True, eq=False)
class Leaky(Block):
    """Of one class, with parameters of two kinds."""

    x: Block
    ahead: bool

    def design(self, fs):
        return Ahead(0.5, 2.0) if self.ahead else Behind(2.0, 0.5), Sum(0.0)

    @staticmethod
    def step(p, s, x):
        y = p.gain * s.y + p.more * x
        return y, Sum(y)


def test_recursions_of_one_class_and_two_kinds():
    u = np.random.default_rng(7).standard_normal((1, 20))
    fast, slow = pair(Scene({"y": Leaky(x, True) - Leaky(2.0 * x, False)}), 1000)
    assert_same(fast.process(u), slow.process(u))


def test_live_numbers_stay_on_their_own_clock():
    a = Param("a", 1.0)
    program = lower({"y": blocks.enabled(a * blocks.white_noise(1), by=x) + a})
    assert [q.clock for q in program.instances if isinstance(q.block, Param)] == [0]
    assert {
        type(q.block): q.clock for q in program.instances if isinstance(q.block, (Mul, Add))
    } == {Mul: 2, Add: 1}


def test_the_lead_is_of_the_rate_alone():
    assert [lead(fs) for fs in (100.0, 8000.0, 8001.0, 44100.0, 48000.0)] == [
        256,
        256,
        257,
        1412,
        1536,
    ]


def test_structure_has_one_hash():
    def scene(k=2.0):
        return {"y": blocks.enabled(blocks.white_noise(1), by=x > k) * x}

    assert lower(scene()).hash == lower(scene()).hash
    assert lower(scene()).hash != lower({"y": blocks.enabled(blocks.white_noise(1), by=x) * x}).hash


def test_what_runs_before_sample_0_is_what_no_input_reaches():
    """A filter of noise has settled at sample 0; one of an input is at rest."""
    proc = stimlib.compile(
        Scene(
            {"n": blocks.fir(blocks.white_noise(1), np.ones(100)), "x": blocks.fir(x, np.ones(100))}
        ),
        1000,
    )
    y = proc.process(np.ones((1, 200)))
    white = stimlib.compile(Scene({"n": blocks.white_noise(1)}), 1000)
    late = white.process(np.empty((0, 200)))[0]
    np.testing.assert_allclose(y[0, 150], late[51:151].sum(), rtol=1e-12)
    assert y[0, 0] != late[0]
    np.testing.assert_array_equal(y[1, :100], np.arange(1, 101))


# Copies of what is gated --------------------------------------------------------------
def nested(levels):
    """Each gate runs, and is opened by, all that is inside it: every level doubles the
    copies.
    """
    block = Param("p", 1.0) + 2.0
    for _ in range(levels):
        block = blocks.enabled(block, by=block)
    return block


@pytest.mark.parametrize("levels", [16, 18, 64, 5000])
def test_copies_behind_gates_are_counted_before_they_are_made(levels):
    """Levels of gates over one block: 2**levels copies, each with a state of its own,
    so only their number can be held.
    """
    block = nested(levels)
    before = sys.getrecursionlimit()
    with pytest.raises(
        SceneError,
        match=(
            "after each enabled or segment has got its own copies: .* more than limits.scene_blocks"
        ),
    ):
        Scene({"y": block})
    assert sys.getrecursionlimit() == before
    assert len(lower({"y": nested(6)}).instances) == 3 * 2**6 + 1


def test_counting_ends_where_there_are_too_many(monkeypatch):
    """A thousand gates within each other, each with a condition of a thousand blocks: a
    million to walk over.
    """
    y, by = blocks.white_noise(1), blocks.white_noise(2, shared=True)
    for _ in range(1000):
        by = -by
    for _ in range(1000):
        y = blocks.enabled(-y, by=by)
    monkeypatch.setattr(limits, "scene_blocks", 10_000)
    with pytest.raises(SceneError, match=r"own copies: 1\d{4} is more than"):
        lower({"y": y})


@pytest.mark.parametrize("entry", TABLE, ids=lambda e: e.name)
def test_the_count_of_copies_is_exact(entry, monkeypatch):
    """A scene passes a limit of as many blocks as it has, parameters and constants
    apart, and not one fewer.
    """
    outputs = entry.scene().outputs
    program = lower(outputs)
    copies = sum(not isinstance(q.block, (Param, Const)) for q in program.instances)
    monkeypatch.setattr(
        limits, "scene_blocks", max(copies, len(reach([Guard(b) for b in outputs.values()])))
    )
    assert lower(outputs).hash == program.hash
    monkeypatch.setattr(limits, "scene_blocks", copies - 0.5)
    with pytest.raises(SceneError, match="more than limits.scene_blocks"):
        lower(outputs)


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
    for target in ("numba", "python"):
        proc = stimlib.compile(Scene(outputs), fs, target)
        np.testing.assert_array_equal(proc.process(u), wanted)
        np.testing.assert_array_equal(proc.response("x", "x", np.array([10.0])), 2 / fs)
        np.testing.assert_array_equal(proc.response("y", "x", np.array([10.0])), 3 / fs)
    signals = stimlib.compile(Scene(outputs), fs, "jax")(motion={"x": u[0]})
    np.testing.assert_allclose([signals[name] for name in outputs], wanted, rtol=1e-15)


def test_a_map_with_a_tile_takes_constants():
    for target in ("numba", "python"):
        proc = stimlib.compile(Scene({"y": Tiled(constant(2.0)) * x}), 1000, target)
        np.testing.assert_array_equal(proc.process(np.ones((1, 3))), 3.0)
