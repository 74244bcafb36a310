"""Loops: the same recursion by hand, every target and cut, files, response, latency,
and what is refused.
"""

import json
import linecache
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from laws import STRESS, assert_same, impulse_response, mostly, rows, twins
from refusals import refused
from test_outputs import Halves

import stimlib
from stimlib import (
    BadValue,
    Input,
    Param,
    Scene,
    SceneError,
    StimlibError,
    UnitError,
    blocks as b,
    constant,
)
from stimlib.blocks import loop
from stimlib.blocks.impedance import FirstOrder
from stimlib.core.graph import Block, reach
from stimlib.core.loop_code import Cycle
from stimlib.core.loops import Last, Loop, Tap
from stimlib.core.maths import sqrt

x, c, k = Input("x"), Input("c"), Param("k", 0.1)
FS, N = 1000.0, 200
GAIN = 0.75  # a helper's, and of another value in a module of the library's own


def bent(x):
    return GAIN * sqrt(1.0 + x * x)


class Turned(NamedTuple):
    a: float


@dataclass(frozen=True, eq=False)
class Turn(Block):
    """A block of a user's own with two outputs, a state and a helper."""

    outputs = ("near", "far")
    x: Block

    def units(self, *u):
        return u[0], u[0]

    def design(self, fs):
        return Turned(0.1), Turned(0.0)

    @staticmethod
    def step(p, s, x):
        a = s.a + p.a * x
        return (bent(a), 1.0 / (1.0 + a * a)), Turned(0.9 * a)


def far_outside(last):
    turn = Turn(x + last)
    return 0.5 * turn.near, turn.far


class Sum(NamedTuple):
    a: float
    cold: float


@dataclass(frozen=True, eq=False)
class Kept(Block):
    """The sum of x while there is contact."""

    x: Block
    contact: Block
    resettable = True

    def units(self, *u):
        return u[0]

    def design(self, fs):
        return (), Sum(0.0, 1.0)

    @staticmethod
    def step(p, s, x):
        return s.a + x, Sum(s.a + x, 0.0)


class More(NamedTuple):
    a: float
    more: float


@dataclass(frozen=True, eq=False)
class Fickle(Block):
    """A design of other fields at other rates."""

    x: Block

    def design(self, fs):
        return (Turned(1.0) if fs < 5000 else More(1.0, 2.0)), ()

    @staticmethod
    def step(p, s, x):
        return p.a * x, s


def pendulum():
    """Two values that feed back, the inner one handed out."""

    def move(v):
        a = loop(lambda a: a + 0.01 * v, start=0.5)
        return v - 0.01 * b.sin(a) + 0.001 * x, a

    v, a = loop(move)
    return {"v": v, "a": a}


def taps(a):
    z, dz = loop(lambda z: (0.9 * z + a, z - a))
    return 0.5 * a + 0.1 * (x - dz), 2.0 * z, 3.0 * a


CASES = {
    "low-pass": lambda: {"y": loop(lambda y: y + k * (x - y))},
    "start": lambda: {"y": loop(lambda y: 0.9 * y + 0.0 * x, start=5.0)},
    "comb": lambda: {"y": loop(lambda y: x + 0.5 * b.delay(y, 10))},
    "two poles": lambda: {"y": loop(lambda y: x + 1.6 * y - 0.8 * b.delay(y, 1))},
    "nested": lambda: {"y": loop(lambda y: x + 0.5 * loop(lambda z: z + 0.1 * (y - z)))},
    "two": lambda: {
        "y": loop(lambda y: 0.9 * y + x) + loop(lambda y: 0.8 * y + loop(lambda z: 0.9 * z + x))
    },
    "no feedback": lambda: {
        "y": loop(lambda y: 2.0 * x),
        "z": loop(lambda y: (x, y))[1],
        "w": x + loop(lambda y: y, start=2.0),
    },
    "gate": lambda: {"y": loop(lambda y: y + 0.1 * (x - b.loading(y, 0.3, 0.1)))},
    "fir": lambda: {"y": loop(lambda y: x - 0.5 * b.fir(y, [0.3, 0.2, 0.1]))},
    "tiles in a nest": lambda: {
        "y": loop(
            lambda y: (
                x + 0.5 * b.loading(loop(lambda z: z + 0.1 * (y - b.fir(z, [1, 1]))), 0.3, 0.1)
            )
        )
    },
    "velocity": lambda: {
        "y": loop(lambda y: y + 0.1 * (x - y) - 1e-5 * b.velocity(y, 50.0) * constant(1.0, "s"))
    },
    "contact": lambda: {
        "y": loop(
            lambda y: 0.9 * y + x - 1e-4 * b.velocity(y, 50.0, contact=c > 0.0) * constant(1.0, "s")
        )
    },
    "contact beside a tile": lambda: {
        "y": loop(
            lambda y: (
                x
                + 0.1 * b.fir(y, [0.3, 0.2])
                - 1e-4 * b.velocity(y, 50.0, contact=c > 0.0) * constant(1.0, "s")
            )
        )
    },
    "table": lambda: {
        "y": loop(lambda y: 0.5 * y + b.lut(y + x, [-1.0, 0.0, 2.0], [0.3, 0.0, 1.0]))
    },
    "carrier": lambda: {
        "y": loop(lambda y: x + 0.5 * b.carrier(constant(20.0, "Hz") * (5.0 + b.tanh(y))))
    },
    "noise": lambda: {"y": loop(lambda y: 0.9 * y + b.white_noise(1)) + 0.0 * x},
    "enabled": lambda: {"y": b.enabled(loop(lambda y: 0.9 * y + b.white_noise(1)), by=x)},
    "enabled by noise": lambda: {
        "y": x + b.enabled(loop(lambda y: 0.9 * y + b.white_noise(1)), by=b.white_noise(2))
    },
    "taps": lambda: dict(zip("yzw", loop(taps), strict=True)),
    "pendulum": pendulum,
    "outputs": lambda: {"y": loop(lambda y: 0.5 * Turn(x + y).near + 0.1 * Turn(x + y).far)},
    "outputs of a tile": lambda: {
        "y": loop(lambda y: x - 0.3 * Halves(y).low - 0.1 * Halves(y).high)
    },
    "an output heard outside alone": lambda: dict(zip("yz", loop(far_outside), strict=True)),
    "an output of a loop": lambda: {"y": Turn(loop(lambda y: 0.5 * y + x)).far},
}
LIKE_OTHERS = {"low-pass", "start", "two poles", "carrier", "table", "noise", "fir", "velocity"}
# the table and generated graphs have others
JAX = {
    *("comb", "contact", "enabled", "enabled by noise", "pendulum", "outputs"),
    "an output heard outside alone",
}
TILES = {"gate", "fir", "tiles in a nest", "outputs of a tile", "contact beside a tile"}


def scene_of(outputs):
    scene = Scene.from_dict(json.loads(json.dumps(Scene(outputs).to_dict())))
    assert scene.hash == Scene(outputs).hash
    return scene


@pytest.mark.parametrize("name", mostly(set(CASES) - LIKE_OTHERS, CASES))
def test_every_target_every_cut(name):
    outputs = CASES[name]()
    scene = scene_of(outputs)
    fast, u, y = twins(scene, FS, N, 1, 7, 64)
    assert np.any(y)
    for out, wanted in zip(outputs, y, strict=True) if len(y) > 1 else ():
        alone = stimlib.compile(Scene({out: outputs[out]}), FS)
        assert_same(alone.process(rows(alone, u, list(fast.inputs)))[0], wanted, f"{out} alone")
    if name in TILES:
        says = r"\(.*\) is inside a loop, where JAX runs steps"
        refused(SceneError, says, stimlib.compile, scene, FS, target="jax")
    elif name in JAX or STRESS:
        z = stimlib.compile(scene, FS, target="jax")({}, u)
        for row, out in zip(y, fast.outputs, strict=True):
            np.testing.assert_allclose(z[out], row, rtol=1e-9, atol=1e-9)


def test_the_same_samples_as_by_hand():
    u = np.random.default_rng(2).standard_normal((1, N))
    outputs = {
        "low": loop(lambda y: y + 0.1 * (x - y), start=0.5),
        "comb": loop(lambda y: x - 0.25 * b.delay(y, 2)),
        **pendulum(),
    }
    low, comb, *swing = stimlib.compile(Scene(outputs), FS).process(u)
    last, line, v, a = np.float64(0.5), [0.0] * 3, 0.0, 0.5
    for n, w in enumerate(u[0]):
        last = last + 0.1 * (w - last)
        line = [w - 0.25 * line[2], *line[:2]]  # the last value, two samples later
        assert (low[n], comb[n]) == (last, line[0])
        a = a + 0.01 * v
        v = v - 0.01 * np.sin(a) + 0.001 * w
        np.testing.assert_allclose([swing[0][n], swing[1][n]], [v, a], rtol=1e-12)


HZ = constant(100.0, "Hz")
NOT_EARLY = {
    "a tap beside the loop": lambda: loop(lambda last: (last + 1.0, HZ))[1],
    "a loop without its last value": lambda: loop(lambda last: HZ, unit="Hz"),
    "a gate that never opens": lambda: HZ + b.enabled(loop(lambda last: last + HZ, unit="Hz"), 0.0),
    "a segment with nothing in it": lambda: HZ + b.segment(constant(0.0, "Hz"), 0.0),
}


@pytest.mark.parametrize("freq", NOT_EARLY.values(), ids=NOT_EARLY)
@pytest.mark.parametrize("target", ["llvm", "python"])
def test_a_phase_begins_at_sample_0_where_what_began_there_is_taken_out(target, freq):
    def samples(f, name=""):
        both = {"s": b.oscillator(f), "w": b.oscillator(f, "sawtooth"), "p": b.pulse_train(f)}
        return {name + n: y for n, y in both.items()}

    alone, plain, both = (
        stimlib.compile(Scene(outputs), 8000, target).process(200)
        for outputs in (samples(freq()), samples(HZ), samples(HZ, "a") | samples(freq(), "b"))
    )
    assert_same(alone, plain)
    assert_same(both, np.concatenate([plain, plain]))


def test_a_loop_begins_at_sample_0_whatever_is_in_it():
    count = loop(lambda n: n + 1.0)
    proc = stimlib.compile(Scene({"n": count, "noisy": count + 0.0 * b.white_noise(1)}), FS)
    np.testing.assert_array_equal(proc.process(np.empty((0, 3))), [[1, 2, 3]] * 2)
    for gate in (x, b.white_noise(2)):
        proc = stimlib.compile(Scene({"n": b.enabled(count, by=gate), "g": gate + 0.0 * x}), FS)
        n, g = proc.process(np.random.default_rng(3).standard_normal((1, N)))
        np.testing.assert_array_equal(n[g > 0], np.arange(1, (g > 0).sum() + 1))


def test_what_does_not_depend_on_a_loop_stays_outside(monkeypatch):
    y = loop(lambda y: y + 0.123456 * (b.fir(x, [1.0, 2.0]) - y))
    scene = Scene({"y": b.tanh(y)})
    kinds = [type(q.block).__name__ for q in scene.program.instances]
    assert kinds == ["Input", "Taps", "Cycle", "Tanh", "Guard"]
    (cycle,) = (q.block for q in scene.program.instances if isinstance(q.block, Cycle))
    assert sorted(type(m).__name__ for m in cycle.members) == ["Add", "Mul", "Sub"]
    stimlib.compile(scene, FS, "python")
    text = "".join(linecache.getlines(cycle.definition.step.__code__.co_filename))
    assert text.startswith("def step(p, s, x0):") and "0.123456" not in text
    monkeypatch.setattr(linecache, "cache", {})  # whoever empties it takes no text away
    assert "Cycle(" in str(stimlib.compile(scene, FS).plan)


def test_equal_loops_run_once_and_other_numbers_share_a_segment():
    def make(gain=0.1, start=0.0):
        return loop(lambda y: y + gain * (x - y), start=start)

    scene = Scene({"y": make() * make(), "z": make(0.3), "w": make(start=1.0)})
    cycles = [r for r in stimlib.compile(scene, FS).plan.rows if "Cycle" in r.block]
    assert len(cycles) == 3 and len({r.segment.rpartition("_")[0] for r in cycles}) == 1


@pytest.mark.parametrize("name", ["two poles", "nested", "fir", "taps", "velocity"])
def test_response(name):
    proc = stimlib.compile(Scene(CASES[name]()), FS)
    n = 1 << 12
    for out in proc.outputs:
        proc.reset()
        got = np.fft.rfft(impulse_response(proc, out, "x", n))
        H = proc.response(out, "x", np.fft.rfftfreq(n, 1 / FS))
        np.testing.assert_allclose(H, got, atol=1e-11 * np.abs(got).max())
        f = np.array([[1.0, 10.0], [100.0, 200.0]])
        each = [[proc.response(out, "x", one) for one in row] for row in f]
        np.testing.assert_allclose(proc.response(out, "x", f), each, rtol=1e-12)


def test_latency():
    outputs = {
        "y": loop(lambda y: b.delay(x, 3) - 0.5 * b.delay(y, 7)),
        "in": loop(lambda y: b.delay(y + x, 4) + x),
        **pendulum(),
        "tap": loop(taps)[2],
    }
    found = stimlib.compile(Scene(outputs), FS, "python").latency
    wanted = {"y": (3, 3), "in": (0, 4), "v": (0, 0), "a": (1, 1), "tap": (1, 1)}
    assert {name: found[name, "x"] for name in wanted} == wanted


def test_a_tap_has_its_own_unit_and_a_loop_of_nothing_any():
    y, far = loop(lambda y: (0.5 * y + x, (y + x) * constant(1.0, "m")))
    assert [str(block.dim) for block in (y, far, loop(lambda y: 0.0, unit="m"))] == ["1", "m", "m"]


def test_a_contact_that_is_never_there_is_not_one_that_always_is():
    for on, wanted in ((0.0, [1.0, 1.0, 1.0]), (1.0, [1.0, 1.1, 1.21])):
        block = loop(lambda y, on=on: x + 0.0 * y + 0.1 * Kept(y, constant(on)))
        np.testing.assert_allclose(of_python(block).process(np.ones((1, 3)))[0], wanted)


def escaped(kept):
    loop(lambda y: (kept.append(y), 0.5 * y + x)[1])
    return Scene({"y": kept[0] * 1.5})


def twice():
    first = loop(lambda y: 0.5 * y + x)
    return Scene({"y": first, "z": Loop(0.25 * first.last, first.last)})


def of_python(block):
    return stimlib.compile(Scene({"y": block}), FS, "python")


def fickle():
    scene = Scene({"y": loop(lambda y: x + 0.1 * Fickle(y))})
    for fs in (1000.0, 8000.0):
        stimlib.compile(scene, fs, "python")


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (
            lambda: of_python(loop(lambda y: x + y * y)).response("y", "x", [0.0]),
            SceneError,
            "Cycle.*not linear",
        ),
        (
            lambda: of_python(loop(lambda y: y + x)).response("y", "x", [0.0]),
            SceneError,
            "Cycle.*grows without limit",
        ),
        (
            fickle,
            SceneError,
            "at fs = 8000 Hz .* other fields",
        ),
        (lambda: escaped([]), SceneError, r"Last\(0.0.*its loop is not"),
        (twice, SceneError, "share one last value"),
        (
            lambda: Scene({"y": loop(lambda y: 0.5 * y + b.enabled(b.white_noise(1), by=y))}),
            SceneError,
            r"Enabled\(.*inside a loop",
        ),
        (
            lambda: Scene({"y": loop(lambda y: 0.5 * y + b.enabled(2.0 * y, by=x))}),
            SceneError,
            r"Enabled\(.*inside a loop",
        ),
        (
            lambda: Scene({"y": loop(lambda y: (y + x, b.enabled(2.0 * y, by=x)))[1]}),
            SceneError,
            "the last value of one",
        ),
        (lambda: b.enabled(loop(lambda y: y + x), by=c), SceneError, "would need the input 'x'"),
        (lambda: loop(lambda y: y * constant(0.5, "m")), UnitError, 'unit="m"'),
        (lambda: loop(lambda y: y + constant(0.5, "m")), UnitError, "cannot add"),
        (lambda: loop(lambda y: None), BadValue, "NoneType"),
        (lambda: loop(lambda y: ()), BadValue, "the function must return a signal"),
        (lambda: loop(Input("x")), BadValue, r"loop: f = Input\('x'\) must be a function"),
        (lambda: loop(lambda y: y, start=np.nan), BadValue, "loop: start = nan .*finite"),
        (
            lambda: loop(lambda y: y, start=x),
            BadValue,
            r"loop: start = Input\('x'\) must be a number",
        ),
        (lambda: Loop(x, x), BadValue, "needs its Last"),
        (lambda: Tap(x, x), BadValue, "needs its Loop"),
        (
            lambda: of_python(loop(lambda y: b.springpot(y, 0.1, 0.5, contact=c) + x)),
            SceneError,
            r"Springpot\(.*contact must be a number",
        ),
    ],
)
def test_what_is_refused(make, error, words):
    refused(error, words, make)


@pytest.mark.parametrize(("other", "says"), [(None, "one last value"), (0, None)])
def test_a_file_cannot_mix_up_loops(other, says):
    data = Scene({"y": loop(lambda y: 0.5 * y + x) + loop(lambda y: 0.25 * y + x)}).to_dict()
    first, *_ = (i for i, e in enumerate(data["blocks"]) if e["class"] == "Last")
    for e in data["blocks"]:
        if e["class"] == "Loop":
            e["fields"]["last"] = first if other is None else other
    refused(StimlibError, says, Scene.from_dict, data)


def test_deep_and_many_loops():
    """No recursion: 300 loops inside each other, and 300 in a row, by the
    interpreter.
    """
    y: Block = x
    for _ in range(300):
        y = loop(lambda last, y=y: 0.5 * last + 0.5 * y)
    deep: list[Block] = []

    def inner(last):
        deep.append(last)
        return 0.001 * (deep[0] + last) + (loop(inner) if len(deep) < 300 else x)

    program = Scene({"row": y, "deep": loop(inner)}).program
    cycles = [q.block for q in program.instances if isinstance(q.block, Cycle)]
    assert sorted(len(q.ends) for q in cycles) == [1] * 300 + [300]
    assert sum(isinstance(b, Last) for b in reach([y])) == 300


def test_a_class_may_move_without_making_another_program(monkeypatch):
    def known():
        """The number by which a state knows its program."""
        y = b.loop(lambda last: Input("x") - b.first_order(last, 0.01))
        return Scene({"y": y}).program.hash

    before = known()
    monkeypatch.setattr(FirstOrder, "__module__", "stimlib.blocks.elsewhere")
    assert known() == before
