"""Law 4: the JAX target equals the reference given the same gates, and its gradients
match central differences.
"""

import re
from dataclasses import dataclass
from typing import NamedTuple

import contract
import jax
import numpy as np
import pytest
from hands import RECORDINGS, hand
from hypothesis import Phase, assume, given, settings, strategies as st
from laws import STRESS, mostly
from refusals import refused, warned
from test_graphs import LENGTH, motion, scenes as generated

import stimlib
from stimlib import (
    BadValue,
    Block,
    Input,
    Param,
    Scene,
    SceneError,
    UnknownName,
    blocks as b,
    scenes,
)
from stimlib.checks.agreement import Agreement, agreement
from stimlib.core import maths
from stimlib.core.graph import Map, registry
from stimlib.core.maths import where
from stimlib.targets.jax import blockforms, function as jax_target, recurrence, traced

TABLE = {e.name: e for e in contract.TABLE}
FIRST = {e.name for e in contract.EACH.values()}
# the others are steps
OWN = {
    name for name, cls in registry.items() if any(c in blockforms.LOWERINGS for c in cls.__mro__)
}
FORMS = {
    e.name
    for e in contract.TABLE
    if e.cls in OWN and re.search("live|contact|nested|param|many|l1|slew", e.name)
}
DEAR = {
    "avatar_frames",
    "bump_square",
    "crossing",
    "cursor_frames",
    "friction_coulomb",
    "friction_dahl",
    "friction_stribeck",
    # to compile; they go the way of every step
    *("lut2_cubic", "springpot_bound", "springpot_path", "track"),
    # what stands behind has a row
    *("cursor_contact", "spatial_noise_contact"),
}
# steps of what other steps are of, and what graphs and scenes below are made of
PLAIN = set(
    """
    add at bump_table burst const count dent detents div equal every grating input interval loop
    loop_start minimum mul neg nonzero not_equal param playback_at springpot_chi static_limit
    stick_slip sub track_velocity triangle vibration wall
    """.split()
)
N = 3000


def agrees(a, tol):
    """A comparison in which no decision differs and no sample by so much."""
    assert a.worst < tol and a.differences == 0, a


# Every block --------------------------------------------------------------------------
@pytest.mark.filterwarnings("ignore:.*longer than horizon")  # springpot_short
@pytest.mark.parametrize("name", mostly((FIRST | FORMS) - DEAR - PLAIN, TABLE))
def test_every_block_equals_the_reference(name):
    e = TABLE[name]
    fs, x = e.rates[0], dict(zip(e.inputs, e.x(N, e.rates[0]), strict=True))
    agrees(agreement(e.scene(), x, fs, n=N, params={"live": -0.7}), 1e-12)


def test_a_reset_heals_what_came_in_contact():
    x, contact = Input("x", "m"), Input("contact")
    outputs = {
        "velocity": b.velocity(x, 100, contact=contact) > 0,
        "track": b.track(x, contact=contact, max_jump=None) > 0,
    }
    a, w = (stimlib.compile(Scene(outputs), 8000, target) for target in ("jax", "python"))
    for bad in (np.nan, np.inf):
        d = {"x": np.sin(np.arange(300) / 20), "contact": np.ones(300)}
        d["x"][50], d["contact"][100:120] = bad, 0.0
        w.reset()
        got, want = a(motion=d), w.process(np.array([d[name] for name in w.inputs]))
        for y, name in zip(want, w.outputs, strict=True):
            assert (got[name] == y)[100:].all(), (name, bad)


def test_what_is_nan_off_contact_enters_no_derivative():
    bumps = b.bump(Input("x"), "sawtooth", Param("k", 0.3), contact=Input("contact"))
    f = stimlib.compile(Scene({"y": bumps}), 8000, "jax")
    x, contact = np.linspace(0.05, 3, 100), np.ones(100)
    contact[40:60] = 0.0
    with jax.enable_x64(True):
        slope = jax.jit(jax.grad(lambda k, x: f({"k": k}, {"x": x, "contact": contact})["y"].sum()))
        assert slope(0.3, np.where(contact > 0, x, np.nan)) == slope(0.3, x) != 0


def smooth(e):
    return e.inputs and not e.edges and "enabled" not in e.name


# of each class with a state one, a few without, and what lives on parameters or contact
STATELESS = {name for name, cls in registry.items() if issubclass(cls, Map)} - {
    "Tanh",
    "Where",
    "Maximum",
    "Mul",
}
ONES = {
    e.cls: e.name for e in reversed(contract.TABLE) if smooth(e) and e.cls in OWN - STATELESS
}.values()
# JAX transposes what is linear, and its samples are those of the reference
LINEAR = {e.name for e in contract.TABLE if e.lti} - {"sos", "springpot_downsampled", "velocity"}
ONES = {*ONES, "springpot_live", "springpot_contact", "track_contact", "maxwell_contact"}
STEPS = {"bump_sine", "equalize", "friction_live", "loop_nested", "mode", "tanh", "velocity"}
"""Those that go the way of every block with a step; the others of them are stress."""
# some ten seconds each; stress too
COSTLY = {"springpot_live", "cursor", "texture", "spatial_noise", "track_contact"}


@pytest.mark.filterwarnings("ignore:.*longer than horizon")
@pytest.mark.parametrize(
    "name", mostly((ONES | STEPS) - COSTLY - LINEAR, [e.name for e in contract.TABLE if smooth(e)])
)
def test_derivatives_along_the_inputs(name):
    """Backwards, which is forwards transposed, and as a difference of the processor,
    which agrees with JAX to 1e-12.

    In a direction that leaves contact alone; off the kinks, where inputs tie.
    """
    e, n, h = TABLE[name], 500, 1e-7
    f, proc = (
        stimlib.compile(Scene({"y": e.block()}), e.rates[0], target) for target in ("jax", "llvm")
    )
    assert f.inputs == proc.inputs
    x = e.x(n, e.rates[0])[[e.inputs.index(i) for i in f.inputs]]
    rng = np.random.default_rng(5)
    size = np.array([0.0 if len(np.unique(row)) < 4 else np.abs(row).max() for row in x])[:, None]
    x = x + 1e-2 * size * rng.standard_normal(x.shape)
    v, w = size * rng.standard_normal(x.shape), rng.standard_normal(n)
    with jax.enable_x64(True):

        def total(x):
            return f(None, x)["y"] @ w

        slope = float(np.sum(np.asarray(jax.jit(jax.grad(total))(x)) * v))
        forward = (
            float(jax.jit(lambda x: jax.jvp(total, (x,), (v,))[1])(x))
            if STRESS and name in {*ONES, *STEPS}
            else slope
        )

    def rendered(x):
        proc.reset()
        return proc.process(x)[0]

    y = {k: rendered(x + k * h * v).astype(np.longdouble) @ w for k in (-2, -1, 1, 2)}
    central = float(y[-2] - 8 * y[-1] + 8 * y[1] - y[2]) / (12 * h)
    scale = max(abs(slope), 1e-3 * float(np.abs(w).sum() * np.abs(rendered(x)).max()))
    assert abs(slope - forward) < 1e-9 * scale
    assert abs(slope - central) < 1e-5 * scale


@pytest.mark.filterwarnings("ignore:.*longer than horizon")
@settings(max_examples=30 if STRESS else 3, phases=[Phase.generate])
@given(generated(tiles=False), st.integers(0, 5))
def test_generated_graphs(scene, seed):
    """Gates within gates, faults and parameters as the other laws have them."""
    proc = stimlib.compile(scene, 1000.0, seed=seed)
    both = dict(zip(("x1", "x2"), motion(np.random.default_rng(seed), LENGTH), strict=True))
    x = {name: both[name] for name in proc.inputs}
    rows = np.array([*x.values()]).reshape(len(x), LENGTH)
    whole = proc.process(rows)
    proc.reset(seed)
    for name, value in scene.params.items():
        proc.set(name, value.value * (1 + 1e-13), ramp=0.0)
    moved = np.abs(proc.process(rows * (1 + 1e-13)) - whole).max(axis=1)
    # where rounding decides, as in a ratio of two errors, nothing can be compared
    assume(np.all((moved <= 1e-9 * np.abs(whole).max(axis=1)) | ~np.isfinite(moved)))
    agrees(agreement(scene, x, 1000.0, n=LENGTH, seed=seed), 1e-9)


# Every scene --------------------------------------------------------------------------
def strokes(n, fs, rate=0.7, depth=0.02):
    return np.round(1e6 * depth * (1 - np.cos(2 * np.pi * rate * np.arange(n) / fs))) * 1e-6


@dataclass
class Case:
    scene: Scene
    fs: float

    def motion(self, seconds=1.0):
        n = int(seconds * self.fs)
        touch = np.where(np.sin(2 * np.pi * 1.3 * np.arange(n) / self.fs) > -0.4, 1.0, 0.0)
        return {
            name: touch if name == "contact" else strokes(n, self.fs, 0.7 + 0.2 * i)
            for i, name in enumerate(stimlib.compile(self.scene, self.fs, "python").inputs)
        }


CHI, ALPHA = Param("chi", 120.0), Param("alpha", 0.4)
LIVE = Scene({"f": b.springpot(Input("y", "m"), CHI, ALPHA)})
IN_CONTACT = Scene({"f": b.springpot(Input("y", "m"), CHI, ALPHA, contact=Input("contact"))})


CASES = {
    "squeeze": Case(scenes.squeeze(), 8000.0),
    "squeeze_48k": Case(scenes.squeeze(fingers=1), 48000.0),
    "squeeze_contact": Case(scenes.squeeze(contact=True, limits=True, motor_constant=10.0), 8000.0),
    "viscoelastic": Case(scenes.viscoelastic(), 1000.0),
    "viscoelastic_contact": Case(scenes.viscoelastic(0.25, contact=True), 1000.0),
    "bumps": Case(scenes.bumps(), 8000.0),
    "bumps_sine": Case(scenes.bumps("sine", bumps=18, duty=0.8), 8000.0),
    "bumps_sawtooth_contact": Case(scenes.bumps("sawtooth", contact=True), 8000.0),
    "grating_contact": Case(scenes.grating(contact=True, shortest=1e-3), 8000.0),
    "springpot": Case(LIVE, 1000.0),
    "springpot_contact": Case(IN_CONTACT, 1000.0),
}


TOLERANCE = {"float64": 1e-12, "float32": 1e-5}
# each has a twin with more in it
MOST = set(CASES) - {"squeeze", "squeeze_48k", "bumps", "viscoelastic", "springpot"}


@pytest.mark.parametrize(
    "dtype_name",
    mostly(
        {("float64", name) for name in MOST} | {("float32", "bumps_sine")},
        [(dtype, name) for dtype in TOLERANCE for name in CASES],
    ),
    ids="-".join,
)
def test_every_scene_equals_the_reference(dtype_name):
    dtype, name = dtype_name
    c = CASES[name]
    agrees(agreement(c.scene, c.motion(), c.fs, dtype=dtype, seed=3), TOLERANCE[dtype])


def test_products_of_float32_keep_its_digits_where_others_are_shorter_by_default():
    """As on accelerators, which multiply float32 with 7 or 10 bits unless asked."""
    scene = Scene({"y": b.pink_noise(1.0, seed=7, f_low=10.0)})
    with jax.default_matmul_precision("BF16_BF16_F32"):
        agrees(agreement(scene, {}, 8000.0, n=N, dtype="float32"), TOLERANCE["float32"])


def test_every_deviate_of_float32_is_the_reference_rounded():
    a = agreement(Scene({"y": b.white_noise(3)}), {}, 8000.0, n=64, dtype="float32")
    assert a.worst < 1e-6, a
    assert np.isnan(Agreement({"y": 0.0, "z": np.nan}, {}, 0, 0).worst)


def test_a_cursor_in_its_map_has_a_derivative_along_both_inputs():
    f = stimlib.compile(TABLE["cursor"].scene(), 1000.0, "jax")
    x = np.array([0.02, 0.015])[:, None] + np.array([0.2, 0.1])[:, None] * np.arange(40) / 1000
    with jax.enable_x64(True):

        def total(x):
            got = f(None, x)
            return got["y"].sum() + 2 * got["z"].sum()

        both = jax.jit(jax.value_and_grad(total))
        slope = np.asarray(both(x)[1])
        for row, column in ((0, 30), (1, 7)):
            d = np.zeros_like(x)
            d[row, column] = 1e-7
            central = float(both(x + d)[0] - both(x - d)[0]) / 2e-7
            assert abs(slope[row, column] - central) < 1e-6 * abs(central)


POSITIONS = {  # differences of positions, which float32 does not hold
    "taps": Scene({"y": b.fir(Input("x"), [1.0, -1.0])}),
    "differentiator": Scene({"y": b.differentiator(Input("x"), 1000.0, 1500.0)}),
    "short memory": scenes.viscoelastic(1.0, scheme="gl-short-memory"),
    "short memory, an order between": scenes.viscoelastic(0.8, scheme="gl-short-memory"),
}


@pytest.mark.parametrize("name", POSITIONS)
def test_positions_keep_their_digits_in_float32(name):
    scene = POSITIONS[name]
    a = agreement(scene, {i: strokes(6000, 8000.0) for i in scene.inputs}, 8000.0, dtype="float32")
    assert a.worst < 1e-6, a


@pytest.mark.parametrize("name", mostly({"touchpad scrub"}, RECORDINGS))
def test_recorded_hands_meet_no_other_decision(name):
    recorded = hand(name)
    scene = scenes.squeeze(fingers=1, contact="grip" not in name)
    t = np.arange(int(recorded.duration * 8000)) / 8000
    motion = {
        i: np.asarray(source(t)) for i, source in recorded.motion_for(tuple(scene.inputs)).items()
    }
    a = agreement(scene, motion, 8000.0, seed=1)
    assert a.decisions >= 2 * t.size, a
    agrees(a, 1e-12)


@pytest.mark.parametrize("name", mostly(MOST - {"squeeze_contact"}, CASES))
def test_gradient_with_respect_to_every_live_number(name):
    c = CASES[name]
    f = stimlib.compile(c.scene, c.fs, "jax")
    motion = c.motion(0.25)
    rng = np.random.default_rng(1)
    weights = {name: rng.standard_normal(len(next(iter(motion.values())))) for name in f.outputs}

    def total(params):
        y = f(params, motion)
        return sum((y[name] * w).sum() for name, w in weights.items())

    with jax.enable_x64(True):
        both = jax.jit(jax.value_and_grad(total))
        got = both(f.params)[1]
        for p, value in f.params.items():
            h = 1e-7 * abs(value)  # short: a carrier has kinks where it is rectified
            d = [float(both(f.params | {p: value + k * h})[0]) for k in (-2, -1, 1, 2)]
            central = (d[0] - 8 * d[1] + 8 * d[2] - d[3]) / (12 * h)
            assert central != 0
            assert abs(float(got[p]) - central) < 1e-5 * abs(central), p


def test_the_order_has_a_derivative_at_both_ends():
    y = np.cumsum(np.random.default_rng(0).standard_normal(400)) * 1e-3
    f = stimlib.compile(LIVE, 1000.0, "jax")
    with jax.enable_x64(True):
        grad = jax.jit(jax.grad(lambda a: (f({"alpha": a}, {"y": y})["f"] ** 2).sum()))
        inner = [float(grad(a)) for a in (1e-4, 1 - 1e-4)]
        ends = [float(grad(a)) for a in (0.0, 1.0)]
    assert np.allclose(ends, inner, rtol=0.02) and np.all(np.isfinite(ends))


# Noise, gates, clocks -----------------------------------------------------------------
PRESS, LEVEL = Input("x1", "m"), Param("A", 3.4, "N")
HISS = b.enabled(b.white_noise(1), by=b.loading(b.velocity(PRESS, 100.0), on=0.02, off=0.01))
GATED = Scene({"force1": Param("k", 2000.0, "N/m") * PRESS + LEVEL * HISS})
"""What tests of gates and batches need of a squeeze: less code to compile."""


def test_seeds_of_noise_are_the_same():
    f, proc = (
        stimlib.compile(Scene({"y": b.white_noise(seed=5)}), 1000, target)
        for target in ("jax", "python")
    )
    for seed in (0, 2**64 - 1):
        proc.reset(seed)
        wanted = proc.process(50)[0]
        for words in ({"n": 50}, {"motion": np.empty((0, 50))}):
            assert np.allclose(f(key=seed, **words)["y"], wanted, rtol=1e-13)


def test_decisions_can_be_given():
    f = stimlib.compile(GATED, 8000, "jax")
    x = {"x1": strokes(4000, 8000)}
    assert len(f.gates) == 2  # the loading gate, and whether the noise is enabled
    assert set(f.decisions(None, x)) == {"force1", *f.gates}
    closed = f(None, x, gates={f.gates[1]: np.zeros(4000)})["force1"]
    assert np.allclose(closed, 2000 * x["x1"], rtol=1e-15)
    assert np.asarray(f.decisions(None, x)[f.gates[0]]).mean() > 0.3


def test_a_live_number_may_be_a_row():
    """One value per sample, as a ramp of Processor.set makes them; inside a gate it is
    gathered onto the gate's clock.  A fault fades on the way.
    """
    A, x = Param("A", 1.0), np.random.default_rng(0).standard_normal(600)
    noise = b.enabled(A * b.white_noise(1), by=Input("x"))
    gated = b.enabled(b.enabled(A, by=b.white_noise(2)) - A, by=Input("x") > -0.5)
    alone = b.enabled(A, by=Input("x"))
    outputs = {"y": A * Input("x"), "z": noise, "gated": gated, "alone": alone}
    scene = Scene(outputs | {"late": b.segment(alone, 0.01)})
    proc = stimlib.compile(scene, 8000)
    x[300] = np.nan
    proc.set("A", 2.0, ramp=0.05)
    ramp = np.minimum(1 + np.arange(1, 601) / 400, 2.0)
    got = stimlib.compile(scene, 8000, "jax")({"A": ramp}, {"x": x})
    for name, wanted in zip(proc.outputs, proc.process(x[None]), strict=True):
        assert np.allclose(got[name], wanted, rtol=1e-12, atol=1e-13)


def test_a_run_beyond_the_horizon_is_told():
    """As by render: beyond, the downsampled history has no numbers, and the force
    fades.
    """
    f = stimlib.compile(scenes.viscoelastic(scheme="gl-downsampled"), 10.0, "jax")
    f(None, {"y": np.ones(600)})
    y = warned(RuntimeWarning, "than horizon = 60 s", f, None, {"y": np.ones(700)})
    assert y["force"][-1] == 0


def test_a_gate_may_borrow_the_derivative_of_a_smooth_one():
    v, w = Input("v", "m/s"), Param("w", 0.15, "m/s")
    gates = {"g": b.loading(v - w, on=0.02, off=0.01), "c": v > w}
    gates |= {f"h{i}": b.hysteresis(v - w, on, on - 0.01) for i, on in enumerate((0.0, -0.02))}
    scene = Scene(gates)
    x = np.linspace(0, 0.3, 300)
    x[[10, 290]] = np.nan, np.inf  # which have no slope, and spoil no other's
    hard, soft = (
        stimlib.compile(scene, 1000, "jax"),
        stimlib.compile(scene, 1000, "jax", surrogate=0.5),
    )
    for name in gates:
        assert np.array_equal(hard(None, {"v": x})[name], soft(None, {"v": x})[name])

        def slope(f, x=x, name=name):
            with jax.enable_x64(True):
                return float(jax.grad(lambda p: f(p, {"v": x})[name].sum())(f.params)["w"])

        assert slope(hard) == 0.0
        assert slope(soft) < -50  # it opens later: fewer samples
    assert slope(soft, np.full(300, 0.15), "c") == 0.0  # no distance tells how wide an edge is


# Batches ------------------------------------------------------------------------------
def test_batches_of_parameters_keys_and_motions():
    f = stimlib.compile(GATED, 8000, "jax")
    x = np.stack([strokes(800, 8000, r) for r in (1.0, 2.0, 3.0)])
    params = {"k": np.array([100.0, 200.0, 300.0]), "A": np.array([0.0, 1.0, 2.0])}
    keys = np.arange(3, dtype=np.uint64)
    with jax.enable_x64(True):
        got = jax.vmap(lambda p, x, key: f(p, {"x1": x}, key))(params, x, keys)["force1"]
    for i in range(3):
        alone = f({k: v[i] for k, v in params.items()}, {"x1": x[i]}, int(keys[i]))["force1"]
        assert np.allclose(got[i], alone, rtol=0, atol=1e-13 * np.abs(alone).max())


# Blocks of others ---------------------------------------------------------------------
class Curved(NamedTuple):
    a: float  # the last input
    b: float  # b + 0.1 (x - b)
    c: float  # the largest b


def test_a_step_is_taken_apart():
    """Delay, linear recursion, curved recursion: each found from the step alone."""

    def step(p, s, x):
        after = s.b + 0.1 * (x - s.b)
        top = where(after > s.c, after, s.c)
        return top + s.a, Curved(x, after, top)

    x, s, wanted = np.random.default_rng(0).standard_normal(500), Curved(0.0, 0.0, 0.0), []
    for v in x:
        y, s = step((), s, v)
        wanted.append(y)
    with jax.enable_x64(True):
        got = recurrence.run_step(step, (), Curved(0.0, 0.0, 0.0), [jax.numpy.asarray(x)], 500)
    assert np.allclose(got, wanted, rtol=1e-13)
    delay = b.delay(Input("x"), 3)
    p, s = delay.design(1000.0)
    refused(SceneError, "array as state", recurrence.run_step, delay.step, p, s, [x], 5)


class Turns(NamedTuple):
    turns: float


class Count(NamedTuple):
    n: float
    none: float


HASH = np.uint64(11)


def truncated(p, s, x):  # no function that is linear in the state
    turns = s.turns + 1.7 * x
    return turns - np.int64(turns), Turns(turns - np.int64(turns))


def repeated(p, s, x):
    for k in range(np.int64(p.n)):
        x = x * 0.5 + k
    return where(1.0 / p.none > p.n, x, 0.0), s


def hashed(p, s, x):
    return maths.as_float(maths.bits(x) * np.uint64(0x9E3779B97F4A7C15) >> HASH), s


def counted(p, s, x):
    return maths.as_float(maths.bits(where(x > 0.0, 1, 0)) >> HASH), s


def flushed(p, s, x):
    y = maths.flush(1.0 / x)
    return where(y > 2.0, 2.0, y), s


def far(p, s, x):
    return maths.sin(x * 2147483648.0) + maths.cos(x * 2147483648.0), s


def beyond(p, s, x):
    far = np.int64(x * 1e19) % np.int64(1000) + maths.as_float(np.uint64(x * 3e19)) * 1e-19
    return far + maths.as_float(x > 0.0), s


def constants(p, s, x):
    return x * np.pi + where(x < maths.INF, np.e, 0.0) + maths.LOG2E, s


@pytest.mark.parametrize(
    "step", [truncated, repeated, hashed, counted, flushed, far, beyond, constants]
)
def test_steps_of_authors_mean_what_they_mean_to_the_interpreter(step):
    numbers = Count(3.0, 0.0), Turns(0.0) if step is truncated else ()
    members = {"__annotations__": {"x": Block}, "__module__": __name__}
    members |= {"step": staticmethod(step), "design": lambda self, fs: numbers}
    block = dataclass(frozen=True, eq=False)(type("Author", (Block,), members))(Input("x"))
    x = np.random.default_rng(2).standard_normal(300)
    x[[3, 70]] = 0.0
    scene = Scene({"y": block})
    with np.errstate(over="raise", divide="raise"):
        got = stimlib.compile(scene, 1000, "jax")(motion={"x": x})["y"]
    wanted = stimlib.compile(scene, 1000, "python").process(x[None])[0]
    np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-12)
    assert np.ptp(wanted) > 0.5


def test_every_name_of_maths_has_a_twin():
    of_arrays = {"fir", "modes", "memory", "chebyshev", "copy", "words", "each", "pairs", "series"}
    own = {n: v for n, v in vars(maths).items() if callable(v) and n[0] != "_"}
    names = {n for n, v in own.items() if getattr(v, "__module__", "") == maths.__name__}
    assert names - of_arrays == set(traced.TWINS)


# What is refused ----------------------------------------------------------------------
def test_32_bit_mode_is_never_silent():
    f = stimlib.compile(Scene({"y": Param("k", 1.0) * Input("x")}), 1000, "jax")
    x = np.array([0.1, 0.2, 0.3])
    # also where nothing that it is given is traced
    for run in (
        lambda: jax.grad(lambda k: f({"k": k}, {"x": x})["y"].sum())(1.0),
        jax.jit(lambda: f(None, {"x": x})["y"]),
    ):
        with jax.enable_x64(False):
            refused(BadValue, "enable_x64", run)
    with jax.enable_x64(True):
        row, k = jax.numpy.asarray(x), jax.numpy.asarray(0.7)
    for rows in ({"x": row}, row[None], {"x": x}):  # it sees to that itself
        assert np.array_equal(f({"k": k}, rows)["y"], 0.7 * x)
    assert not jax.config.read("jax_enable_x64")


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_runs_of_no_sample(dtype):
    scene = Scene({"y": Param("k", 1.0) * Input("x"), "g": b.loading(Input("x"), 0.5, 0.1)})
    f = stimlib.compile(scene, 1000, "jax", dtype=dtype)
    for wide in (False, True):
        with jax.enable_x64(wide):
            y = f.decisions(None, {"x": np.ones(0)})
        assert set(y) == {*f.outputs, *f.gates} and {v.shape for v in y.values()} == {(0,)}
        assert y["y"].dtype == dtype


NUMBERS = [
    [0.0, 1.0, 2.0],
    np.arange(3),
    np.array([False, True, True]),
    np.arange(3.0).astype(">f8"),
    np.arange(3, dtype=np.longdouble),
    np.arange(6.0)[::2],
    np.arange(3, dtype=np.float32),
]


def test_numbers_of_any_kind():
    """As motion, parameter and gate: what numpy makes of them; and one number as motion
    holds throughout.
    """
    outputs = {"y": Param("k", 1.0) * Input("x"), "z": b.where(Input("x") > 0.5, 1.0, 0.0)}
    f = stimlib.compile(Scene(outputs), 1000, "jax")
    for row in NUMBERS:
        wanted = np.asarray(row, float)
        assert np.array_equal(f(None, {"x": row})["y"], wanted), row
        assert np.array_equal(f({"k": row}, {"x": 1.0})["y"], wanted), row
        assert np.array_equal(f({"k": row}, [row])["y"], wanted**2), row
        gated = f(None, {"x": np.zeros(3)}, gates={f.gates[0]: row})["z"]
        assert np.array_equal(gated, wanted > 0), row


def test_other_numbers_compile_nothing_anew(monkeypatch):
    traced_blocks = []
    run = jax_target._run_block
    monkeypatch.setattr(
        jax_target, "_run_block", lambda b, *args: traced_blocks.append(b) or run(b, *args)
    )
    f = stimlib.compile(Scene({"y": Param("k", 1.0) * Input("x") * b.white_noise(1)}), 1000, "jax")
    x = np.ones(5)
    f(None, {"x": x})
    once = len(traced_blocks)
    for k, key in (
        (2, 3),
        (np.float32(2), np.int8(3)),
        (np.array(2), np.array(3)),
        (True, 2**64 - 1),
    ):
        f({"k": k}, {"x": x.astype(int)}, key)
    with jax.enable_x64(True):
        f({"k": jax.numpy.asarray(2.0)}, {"x": jax.numpy.asarray(x)}, jax.numpy.asarray(3))
    assert len(traced_blocks) == once > 0


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (dict(params={"b": 1.0}), UnknownName, "no parameter 'b'; there are k"),
        (dict(motion={"x": np.ones(3), "z": np.ones(3)}), UnknownName, "no input 'z'"),
        (dict(motion={}), UnknownName, "lacks the input 'x'"),
        (dict(motion=np.ones((2, 3))), BadValue, r"array \(1, n\)"),
        (dict(params={"k": np.ones(4)}), BadValue, "one length"),
        (dict(params={"k": np.ones(1)}), BadValue, "got x: 3, k: 1"),
        (dict(params={"k": np.ones((2, 3))}), BadValue, r"parameter 'k'.*shape \(2, 3\).*jax.vmap"),
        (dict(params={"k": np.nan}), BadValue, "parameter 'k' is not finite"),
        (dict(params={"k": [1.0, np.inf, 1.0]}), BadValue, "'k' is not finite at sample 1"),
        (dict(params={"k": jax.numpy.array([1, np.nan, 1])}), BadValue, "not finite at sample 1"),
        (dict(params={"k": "2"}), BadValue, "parameter 'k' must be"),
        (dict(params={"k": 2j}), BadValue, "parameter 'k' must be"),
        (dict(params=2.0), BadValue, "params must be a dict"),
        (dict(motion={"x": np.ones((3, 1))}), BadValue, r"input 'x'.*shape \(3, 1\).*jax.vmap"),
        (dict(motion={"x": np.ones((3, 1)) * 1j}), BadValue, "input 'x' must be real"),
        (dict(motion={"x": jax.numpy.ones(3) * 1j}), BadValue, "input 'x' must be real"),
        (dict(motion={"x": np.sin}), BadValue, "input 'x' must be real numbers.*sample it"),
        (dict(motion={"x": [[1.0], [1.0, 2.0]]}), BadValue, "input 'x' must be"),
        (dict(motion={"x": 1.0}), BadValue, "give n"),
        (dict(motion={"x": 1.0}, n=-1), BadValue, "n = -1"),
        (dict(motion={"x": 1.0}, n=True), BadValue, "n = True"),
        (dict(motion={"x": 1.0}, n=2**62), BadValue, "limits.render_bytes"),
        (dict(n=5), BadValue, "got x: 3, n: 5"),
        (dict(gates={"g": np.ones(3)}), UnknownName, "no gate 'g'"),
        (dict(gates=[1]), BadValue, "gates must be a dict"),
        (dict(gates={"gate 5": np.ones(4)}), BadValue, "gate 5: 4"),
        (dict(key=-1), BadValue, "key = -1"),
        (dict(key=2**64), BadValue, "key = 18446744073709551616"),
        (dict(key="1"), BadValue, "key = '1'"),
        (dict(key=np.array(-3)), BadValue, "key = -3"),
        (dict(key=np.arange(2)), BadValue, "jax.vmap"),
        (dict(key=jax.random.key), BadValue, "whole number"),
    ],
)
def test_bad_calls(call, error, text):
    f = stimlib.compile(
        Scene({"y": Param("k", 1.0) * Input("x"), "g": Input("x") > 0.5}), 1000, "jax"
    )
    if call.get("key") is jax.random.key:  # which compiles
        call = {"key": jax.random.key(0)}
    refused(error, text, f, **{"motion": {"x": np.ones(3)}, **call})


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"dtype": "float16"}, "float64, float32"),
        *[({"surrogate": s}, "surrogate") for s in (0.0, -1, np.nan, "a")],
        *[({"seed": s}, "seed = ") for s in (-1, 1.5, "a", 2**64)],
        ({"what": 1}, "options dtype, surrogate"),
        ({"target": "llvm", "dtype": "float32"}, "only target='jax'"),
        ({"fs": -1}, "fs = -1"),
    ],
)
def test_bad_options(words, says):
    given = {"scene": Scene({"y": 2 * Input("x")}), "fs": 1000, "target": "jax", **words}
    refused(BadValue, says, stimlib.compile, **given)
    if words == {"fs": -1}:
        refused(BadValue, "stimlib.compile", stimlib.Processor, **given | {"fs": 1000})


@pytest.mark.parametrize(
    ("motion", "n", "error", "text"),
    [
        ({}, 5, UnknownName, "x1 is missing"),
        ({"x1": np.ones(3)}, 5, BadValue, "at least 5 samples"),
        ({"x1": np.ones((3, 2))}, 3, BadValue, "one dimension"),
        ({"x1": np.array([0.0, np.nan])}, None, BadValue, "not finite at sample 1"),
        ({"x1": np.ones(0)}, None, BadValue, "give n"),
        ({"x1": np.sin}, None, BadValue, "give n"),
    ],
)
def test_what_cannot_be_compared(motion, n, error, text):
    refused(error, text, agreement, scenes.squeeze(fingers=1), motion, 8000.0, n=n)


# A GPU, where there is one ------------------------------------------------------------


@pytest.mark.parametrize("name", ["squeeze", "viscoelastic", "bumps_sine"])
@pytest.mark.parametrize(("dtype", "tol"), TOLERANCE.items())
def test_on_a_gpu(name, dtype, tol):
    try:
        device = jax.devices("gpu")[0]
    except RuntimeError:
        pytest.skip("JAX sees no GPU here")
    with jax.default_device(device):
        a = agreement(CASES[name].scene, CASES[name].motion(), CASES[name].fs, dtype=dtype)
    assert a.worst < tol, a
