"""The processor: messages, `out`, parameters, latency, response, plan."""

import copy
import ctypes
import operator
import pickle
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from laws import assert_same
from refusals import refused

import stimlib
from stimlib import (
    BadValue,
    Block,
    Input,
    Param,
    Scene,
    SceneError,
    StimlibError,
    UnknownName,
    blocks,
    constant,
)
from stimlib.core.program import lead
from stimlib.targets.llvm import entry_points
from stimlib.targets.python import Engine as Interpreter

x, z = Input("x"), Input("z")
both = pytest.mark.parametrize("target", ["llvm", "python"])


def make(outputs=None, fs=1000, target="python", **kw):
    return stimlib.compile(Scene(outputs or {"y": x + z}), fs, target, **kw)


# process ------------------------------------------------------------------------------
FIXED = np.zeros((1, 5))
FIXED.flags.writeable = False


@both
@pytest.mark.parametrize(
    ("bad", "out", "words"),
    [
        (np.zeros(5), None, ["x ", "(2, n)", "x, z", "(5,)"]),
        (np.zeros((3, 5)), None, ["x ", "(2, n)", "(3, 5)"]),
        (np.zeros((2, 5), np.float32), None, ["x ", "float64", "float32", "astype"]),
        (np.zeros((2, 10))[:, ::2], None, ["x ", "C-contiguous", "ascontiguousarray"]),
        ([[1.0], [2.0]], None, ["x ", "array", "list"]),
        (3.0, None, ["x ", "float"]),
        (np.zeros((2, 3), ">f8"), None, ["x ", ">f8"]),
        (np.ma.masked_less(np.zeros((2, 3)), 1.0), None, ["x ", "MaskedArray"]),
        (np.zeros((2, 5)), np.zeros((2, 5)), ["out ", "(1, 5)", "(2, 5)"]),
        (np.zeros((2, 5)), np.zeros((1, 5), np.float32), ["out ", "float32"]),
        (np.zeros((2, 5)), np.zeros((1, 10))[:, ::2], ["out ", "C-contiguous"]),
        (np.zeros((2, 5)), [0.0], ["out ", "list"]),
        (np.zeros((2, 5)), FIXED, ["out ", "read-only"]),
    ],
)
def test_a_wrong_block_or_out_says_what_is_wanted(target, bad, out, words):
    proc = make(target=target)
    error = refused(BadValue, None, proc.process, bad, out)
    assert str(error).startswith(f"process: {words[0]}"), error
    assert all(w in str(error) for w in words), error
    assert proc.index == 0, "nothing has run"


@both
def test_out_is_what_comes_back(target):
    proc, u = make(target=target), np.random.default_rng(0).standard_normal((2, 100))
    out = np.full((1, 100), np.nan)
    assert proc.process(u, out) is out
    assert_same(out[0], u[0] + u[1])
    u.flags.writeable = False
    assert_same(proc.process(u), out)
    state = proc.state
    assert proc.process(np.zeros((2, 0))).shape == (1, 0)
    assert_same(proc.state, state)
    proc.state = np.repeat(state, 2)[::2]
    assert_same(proc.state, state)
    assert proc.index == 200


@both
@pytest.mark.parametrize("shift", [1, 64, 101, -1, -130])
def test_out_shifted_against_x_is_refused(target, shift):
    """Samples would be written before they are read."""
    memory = np.zeros(700)
    u = memory[200:400].reshape(2, 100)
    out = memory[200 + shift :][:200].reshape(2, 100)
    proc = make({"a": x + z, "b": x * z}, target=target)
    refused(BadValue, "out and x share memory", proc.process, u, out)
    assert proc.index == 0 and not memory.any()


@both
@pytest.mark.parametrize("rows", [-1, 0, 2])
def test_out_may_be_rows_of_the_same_table(target, rows):
    memory = np.random.default_rng(3).standard_normal((6, 150))
    proc = make({"a": blocks.delay(x, 3) + z, "b": x * z}, target=target)
    u = memory[2:4]
    wanted = proc.process(u)
    proc.reset()
    assert_same(proc.process(u, memory[2 + rows : 4 + rows]), wanted)


@both
def test_no_rows_may_lie_anywhere(target):
    """A stretch of no rows has an address, of which nothing is read: it may be within
    out.
    """
    proc = stimlib.compile(Scene({"n": blocks.white_noise(1)}), 1000, target)
    memory = np.zeros(100)
    u = np.ndarray((0, 100), buffer=memory, offset=400)
    assert proc.process(u, memory.reshape(1, 100)).all()


def test_the_address_gives_the_same_bits():
    proc = make(
        {"a": blocks.first_order(x, 0.1), "n": blocks.white_noise(1), "k": Param("k", 1.0)},
        target="llvm",
    )
    u = np.random.default_rng(2).standard_normal((1, 300))
    wanted = proc.process(u)
    proc.reset()
    entry, context = proc.address
    out = np.empty((3, 300))
    ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)(entry)(
        context, u.ctypes.data, out.ctypes.data, 300
    )
    assert_same(out, wanted)
    assert proc.index == 300
    refused(SceneError, "llvm", getattr, make(target="python"), "address")


# compile ------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("words", "says"),
    [
        *[({"fs": fs}, "fs") for fs in (0, np.nan, np.inf, "8000", None, 10**400, 1j, [8000, 1])],
        ({"fs": 1e13, "outputs": {"y": x + blocks.white_noise(1)}}, "state_bytes"),  # the lead
        *[({"seed": seed}, "seed") for seed in (-1, 2**64, 1.5, "a", np.nan)],
        ({"target": "fpga"}, "llvm, python"),
    ],
)
def test_what_compile_refuses(words, says):
    refused(BadValue, says, make, **words)
    if "seed" in words:
        refused(BadValue, says, make().reset, words["seed"])


@pytest.mark.parametrize("target", ["llvm", "python", "jax"])
def test_outputs_alone_have_the_same_samples(target):
    noise = blocks.white_noise(1)
    scene = Scene({"a": x * noise, "b": blocks.lowpass(noise, 50.0, 2), "c": z + noise})
    motion = np.linspace(0.0, 1.0, 70)[None] * [[1.0], [2.0]]
    whole, part = (
        stimlib.compile(scene, 1000, target, seed=3, outputs=names)
        for names in (None, iter(["c", "b"]))
    )
    assert part.inputs == ("z",) and part.outputs == ("b", "c")
    if target == "jax":
        ours = part({}, {"z": motion[1]})
        wanted = whole({}, dict(zip("xz", motion, strict=True)))
        assert all(np.array_equal(ours[name], wanted[name]) for name in "bc")
    else:
        assert_same(part.process(motion[1:].copy()), whole.process(motion)[1:])
    for wrong, error, says in [
        (["d"], UnknownName, "there is no output 'd'"),
        ([], BadValue, "leaves none; name some of a, b, c"),
    ]:
        refused(error, says, stimlib.compile, scene, 1000, outputs=wrong)


@both
@pytest.mark.parametrize(
    "block",
    [
        blocks.delay(x, samples=10**12),
        blocks.delay(x, seconds=1e308),
        blocks.delay(blocks.delay(x, samples=3 * 10**8), samples=3 * 10**8 + 1),
    ],
)
def test_more_memory_than_is_allowed_is_an_error_before_it_is_taken(target, block):
    refused(BadValue, "limits.state_bytes.*STIMLIB_LIMITS", make, {"y": block}, target=target)


@both
def test_seeds_are_keys_of_all_noise(target):
    scene = {"a": blocks.white_noise(1), "b": blocks.pink_noise(1.0, 2, f_low=20.0), "c": x}
    u = np.zeros((1, 64))
    wanted, other = make(scene, target=target, seed=9).process(u), make(scene, target=target)
    assert not np.any(other.process(u)[:2] == wanted[:2])
    for seed in (9, None, *range(12), 9):  # more than are remembered
        other.reset(seed)
        if seed in (9, None):
            assert other.seed == 9
            assert_same(other.process(u), wanted)


@both
@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_copy_goes_on_by_itself(target, copied):
    """A scene that was compiled, with the classes of its loop, is pickled with it."""
    walk = blocks.loop(lambda last: last + Param("a", 1.0) * blocks.white_noise(1))
    proc = make({"y": walk}, target=target, seed=9)
    proc.set("a", 2.0, 0.3)
    proc.process(np.empty((0, 70)))
    other = copied(proc)
    other = pickle.loads(other) if isinstance(other, bytes) else other
    assert (other.seed, other.index, other.params) == (9, 70, {"a": 2.0})
    assert_same(other.process(np.empty((0, 70))), proc.process(np.empty((0, 70))))
    other.reset(1)
    assert (proc.seed, proc.index) == (9, 140)


@both
def test_an_interrupted_reset_changes_nothing(monkeypatch, target):
    scene, nothing = {"y": blocks.white_noise(1) * Param("a", 1.0)}, np.empty((0, 70))
    proc, other = (make(scene, target=target) for _ in range(2))
    for one in (proc, other):
        one.process(nothing)
        one.set("a", 2.0)

    def interrupted(*given, **named):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(entry_points, "ENTRY", lambda address: interrupted)
        patched.setattr(Interpreter, "sample", interrupted)
        refused(KeyboardInterrupt, None, proc.reset, 9)
    assert (proc.seed, proc.index, proc.params, proc.log) == (0, 70, {"a": 2.0}, other.log)
    assert_same(proc.process(nothing), other.process(nothing))


# set ----------------------------------------------------------------------------------
@both
@pytest.mark.parametrize(("ramp", "n"), [(0.0, 1), (0.0004, 1), (0.002, 2), (0.333, 333)])
def test_a_ramp_is_straight_and_ends_exactly(target, ramp, n):
    proc = make({"y": Param("a", 0.1), "z": Param("b", 2.0) * Param("c", 3.0)}, target=target)
    nothing = np.empty((0, 7))
    np.testing.assert_array_equal(proc.process(nothing), [[0.1] * 7, [6.0] * 7])
    proc.set("a", 0.7, ramp)
    assert proc.params == {"a": 0.7, "b": 2.0, "c": 3.0}
    y, still = proc.process(np.empty((0, 400)))
    np.testing.assert_array_equal(y[n - 1 :], 0.7)
    np.testing.assert_allclose(y[:n], 0.1 + 0.6 * np.arange(1, n + 1) / n, rtol=1e-13)
    assert proc.log == [(7, "a", 0.7, ramp)] and (still == 6.0).all()
    proc.set("c", 5.0, 0.0)
    assert (proc.process(nothing)[1] == 10.0).all()


@both
def test_a_ramp_may_turn_on_the_way(target):
    proc = make({"y": Param("a", 0.0)}, target=target)
    proc.set("a", 1.0, 0.01)
    y = proc.process(np.empty((0, 5)))[0]
    middle = proc.state
    proc.set("a", 3.0, 1.0)  # never heard: the next call replaces it
    proc.set("a", -1.0, 0.003)
    y = np.r_[y, proc.process(np.empty((0, 5)))[0]]
    np.testing.assert_allclose(
        y, [0.1, 0.2, 0.3, 0.4, 0.5, 0.0, -0.5, -1.0, -1.0, -1.0], atol=1e-15
    )
    assert [c.at for c in proc.log] == [0, 5, 5]
    proc.set("a", 3.0, 0.01)
    proc.set("a", 2.0, 0.0)  # is there: the next one begins at it
    proc.set("a", 4.0, 0.002)
    assert proc.process(np.empty((0, 4)))[0].tolist() == [3.0, 4.0, 4.0, 4.0]
    proc.state = middle  # a parameter is where its ramp leads
    assert proc.log == [] and proc.params == {"a": 1.0}
    proc.set("a", 0.5, 0.0)
    assert proc.log == [(5, "a", 0.5, 0.0)]
    proc.reset()
    assert proc.log == [] and proc.params == {"a": 0.0}
    assert not proc.process(np.empty((0, 5))).any()


@both
@pytest.mark.parametrize(
    ("args", "error", "words"),
    [
        (("b", 1.0), UnknownName, ["'b'", "a, k"]),
        (("a", np.nan), BadValue, ["finite"]),
        (("a", 1.0, -0.1), BadValue, ["ramp", "at least 0"]),
        (("a", 1.0, np.nan), BadValue, ["ramp"]),
        (("a", "1.0"), BadValue, ["a"]),
        (("a", 10**400), BadValue, ["too large"]),
        (("a", 1.0, 1e308), BadValue, ["ramp"]),
        (("a", None), BadValue, ["a"]),
    ],
)
def test_settings_that_make_no_sense(target, args, error, words):
    proc = make({"y": Param("a", 0.0) * Param("k", 1.0)}, target=target)
    e = refused(error, None, proc.set, *args)
    assert all(w in str(e) for w in words) and isinstance(e, StimlibError)
    refused(KeyError, "there are none", make().set, *args)
    refused(TypeError, "not support item assignment", operator.setitem, proc.params, "a", 5.0)
    assert proc.log == [] and proc.params == {"a": 0.0, "k": 1.0}


# latency, response --------------------------------------------------------------------
def test_latency_adds_along_paths():
    noise = blocks.white_noise(1)
    assert make(
        {
            "y": blocks.delay(x, 3) + blocks.delay(blocks.delay(x, 4), 5),
            "w": blocks.fir(noise, [1, 2, 1]),
            "k": z * 2.0,
        }
    ).latency == {("y", "x"): (3, 9), ("w", "white(1, 0)"): (1, 1), ("k", "z"): (0, 0)}


@pytest.mark.parametrize("fs", [8000.0, 48000.0])
def test_latency_is_what_a_slow_signal_sees(fs):
    """The stated latency is the group delay at 0 Hz."""
    outputs = {
        "v": blocks.velocity(x),
        "d": blocks.differentiator(x, 1000.0),
        "l": blocks.first_order(x, 0.01),
    }
    proc = make(outputs, fs, "llvm")
    t = np.arange(int(fs)) / fs
    v, d, _ = proc.process(t[None] ** 2)[:, -1]
    late = {name: proc.latency[name, "x"][0] / fs for name in outputs}
    np.testing.assert_allclose(v, 2 * (t[-1] - late["v"]), rtol=1e-9)
    np.testing.assert_allclose(d, 2 * (t[-1] - late["d"]), rtol=1e-5)
    proc.reset()
    np.testing.assert_allclose(proc.process(t[None])[2, -1], t[-1] - late["l"], rtol=1e-9)


def test_response_through_arithmetic():
    proc = make({"y": (2.0 * x - x / 4.0 + z) * (Param("a", 3.0) + 1.0) - (-x)})
    f = np.array([[0.0, 10.0], [100.0, 500.0]])
    for a, name, gain in ((3.0, "x", 8.0), (3.0, "z", 4.0), (0.0, "x", 2.75)):
        proc.set("a", a)
        np.testing.assert_allclose(proc.response("y", name, f), gain)
    assert proc.response("y", "x", 10.0).shape == ()


@pytest.mark.parametrize(
    ("outputs", "name", "gain"),
    [({"y": x, "w": z}, "z", 0.0), ({"y": 2.0 * x, "other": abs(x)}, "x", 2.0)],
)
def test_response_of_what_is_not_reached_is_zero_and_asks_only_what_is_on_the_way(
    outputs, name, gain
):
    np.testing.assert_array_equal(make(outputs).response("y", name, np.array([1.0])), gain)


@pytest.mark.parametrize(
    "block",
    [
        1.0 / x,
        abs(x),
        blocks.where(1.0 * z, x, 0.0),
        blocks.lut(x, [0, 1], [1, 2]),
        x * z,
        x * blocks.enabled(blocks.white_noise(1), by=z),
        x + blocks.enabled(blocks.white_noise(1), by=x),
    ],
)
def test_no_response_where_it_is_not_linear(block):
    response = make({"y": block}).response
    refused(SceneError, "not linear and time-invariant|own clock", response, "y", "x", [1.0])


def test_response_of_what_has_none():
    gated = make({"y": blocks.enabled(blocks.white_noise(1), by=x)}).response
    refused(SceneError, "own clock", gated, "y", "white(1, 0)", [1.0])
    for names in (("q", "x"), ("y", "q"), ("x", "y")):
        refused(UnknownName, "there is", make().response, *names, [1.0])


# plan, fault --------------------------------------------------------------------------
def test_the_plan_tells_what_runs_and_what_does_not():
    noise = blocks.enabled(blocks.pink_noise(1.0, 1, f_low=20.0), by=x > 0.0)
    empty = blocks.enabled(0.0 * blocks.white_noise(3), by=x)
    proc = make({"y": x * noise + 0.0 * blocks.white_noise(2) + empty}, target="llvm")
    removed = "removed: White(2, 0, False): multiplied by a literal 0"
    for part in ("at 1000 Hz", "enabled 1", "PinkNoise", removed, "nothing in it"):
        assert part in str(proc.plan)
    assert repr(proc) == "Processor(x -> y, fs=1000, llvm)"
    assert "no input" in repr(make({"y": constant(1.0)}))
    assert [r.number for r in proc.plan.rows] == list(range(len(proc.program.instances)))
    # white noise and the filter behind it are one segment
    assert sum(r.segment.startswith("White_") for r in proc.plan.rows) == 2


@both
@pytest.mark.parametrize("at", [11, 64, 128])
def test_a_fault_names_output_and_sample_and_fades_from_the_one_before(target, at):
    proc = make({"good": z, "bad": 1.0 / x, "worse": 1.0 / (x - 1.0)}, target=target)
    u = np.full((2, 160), 5.0)
    row = proc.inputs.index("x")
    u[row, 150], u[row, at] = 0.0, 1.0
    y = proc.process(u)
    assert proc.fault == ("worse", at)
    assert np.isfinite(y).all()
    assert_same(y[0], u[1 - row])
    np.testing.assert_allclose(y[2, at : at + 21], 0.25 * np.arange(20, -1, -1) / 20, rtol=1e-15)
    proc.reset()
    assert proc.fault is None


# state --------------------------------------------------------------------------------
def line(*samples):
    y = x
    for n in samples:
        y = blocks.delay(y, n)
    return y


@both
@pytest.mark.parametrize(
    ("one", "other"),
    [
        (line(60000, 3), line(3, 60000)),  # the same classes, wiring and number of words
        (blocks.first_order(x, 1.0), blocks.first_order(x, 2.0)),
        (blocks.white_noise(1), blocks.white_noise(2)),
        (blocks.lut(x, [0, 1, 2], [0, 1, 0]), blocks.lut(x, [0, 1, 2], [0, 1, 1])),
        (blocks.fir(x, [1, 2, 3]), blocks.fir(x, [1, 2, 4])),
    ],
    ids=["sizes", "number", "key", "table", "taps"],
)
def test_a_state_of_a_scene_with_other_numbers_is_refused(target, one, other):
    proc = make({"y": one}, target=target)
    before = proc.state
    for block, fs in ((other, 1000), (one, np.nextafter(1000, 2000))):
        state = make({"y": block}, fs, target).state
        refused(BadValue, "another scene or sample rate", setattr, proc, "state", state)
    assert_same(proc.state, before)
    proc.state = make({"y": one}, target="python").state


def test_a_state_of_a_class_that_was_changed_is_refused():
    """A notebook's cell was run again: same name and numbers, same number of words, and
    they mean something else.
    """

    class Sizes(NamedTuple):
        line: np.ndarray
        other: np.ndarray

    def made(first, second):
        @dataclass(frozen=True, eq=False)
        class Kept(Block):
            x: Block

            def design(self, fs):
                return (), Sizes(np.zeros(first), np.zeros(second))

            @staticmethod
            def step(p, s, x):
                return x, s

        return make({"y": Kept(x)})

    one, again, other = made(2, 3), made(2, 3), made(3, 2)
    assert one.program.hash == other.program.hash and one.state.size == other.state.size
    one.state = again.state
    refused(BadValue, "another scene or sample rate", setattr, one, "state", other.state)


@both
def test_a_state_beyond_every_run_is_refused(target):
    proc = make(target=target)
    state = proc.state
    for index in (2**64 - 1, 2**63, 2**62 + 1):
        state[1] = index
        refused(BadValue, "no run reaches", setattr, proc, "state", state)
    state[1] = 2**62
    proc.state = state
    proc.process(np.zeros((2, 3)))
    assert proc.index == proc.state[1] == 2**62 + 3


def test_state_reset_and_set_wait_for_each_other():
    """From several threads: no error, and every seed's start stays what it is."""
    proc = make({"y": blocks.white_noise(1) * Param("a", 1.0) + x}, target="llvm")
    starts = {}
    for seed in range(30):
        proc.reset(seed)
        starts[seed] = proc.state

    def work(action):
        for k in range(60):
            action(k)

    actions = [
        lambda k: proc.reset(k % 30),
        lambda k: setattr(proc, "state", starts[0]),
        lambda k: proc.set("a", 2.0),
        lambda k: proc.state,
        lambda k: proc.fault,
    ]
    with ThreadPoolExecutor(6) as threads:
        list(threads.map(work, [*actions, actions[0]]))
    for seed, start in starts.items():
        proc.reset(seed)
        assert_same(proc.state, start)

    def waits():  # a thread that would touch the engine
        free = []
        thread = threading.Thread(target=lambda: free.append(proc._lock.acquire(blocking=False)))
        thread.start()
        thread.join()
        return free == [False]

    class Waited:
        def __getattr__(self, name, own=proc._engine):
            assert waits(), name
            return getattr(own, name)

        def __setattr__(self, name, value, own=proc._engine):
            assert waits(), name
            setattr(own, name, value)

    proc._engine = Waited()
    for action in (lambda k: proc.reset(30), *actions[:-1]):
        action(0)


def test_a_seed_is_a_plain_number_and_samples_have_a_limit(monkeypatch):
    proc = stimlib.compile(Scene({"y": blocks.white_noise(1)}), 1000, "python", seed=np.int64(3))
    assert type(proc.seed) is int and proc.seed == 3
    monkeypatch.setattr(stimlib.limits, "render_bytes", 8 * 10)
    assert proc.process(10).shape == (1, 10)
    refused(BadValue, "bytes of 11 samples: 88 is more than limits.render_bytes", proc.process, 11)


@both
def test_gates_begin_in_one_walk_with_the_bits_of_one_walk_each(target):
    white = [blocks.white_noise(seed=1, stream=i, shared=True) for i in range(6)]
    lag, gated = blocks.first_order, blocks.enabled
    outer = gated(gated(lag(white[0], 0.01), white[1] > 0.0) + lag(white[2], 0.02), white[3] > 0.0)
    fed_back = gated(blocks.loop(lambda y: 0.5 * y + white[4]), white[5] > 0)
    gates = [gated(lag(white[4] * i, 0.01), x > float(i)) for i in (3, 4, 5)]
    outputs = [outer, gated(outer + 1, x > 0.0), fed_back, *gates]
    proc = make({f"y{i}": y for i, y in enumerate(outputs)}, target=target)
    assert len(proc._early) == 3 < len(sum(proc._early, []))
    engine = proc._engine
    engine.packed = proc._first(5)
    for clock in sorted(sum(proc._early, []), reverse=True):
        engine.warm([clock], lead(1000.0))
    expected = engine.packed
    proc.reset(5)
    assert_same(proc.state[2:], expected)
