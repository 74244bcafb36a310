"""Rendering: wrong numbers are never silent."""

import gc
import math
import warnings
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from refusals import refused, warned

import stimlib
from stimlib import BadValue, FaultError, Input, Scene, StimlibError, UnknownName, blocks, render
from stimlib.blocks.clock import Every, EveryParams
from stimlib.core.graph import Block, Map
from stimlib.files import audio
from stimlib.motion import parse_motion, recording
from stimlib.run import rendering

x = Input("x", "m")
SCENE = Scene({"force": 1.0 / (x - stimlib.constant(3.0, "m")), "good": x})
RAMP = np.arange(6.0)


# Faults -------------------------------------------------------------------------------
@pytest.mark.parametrize("target", ["llvm", "python"])
def test_a_fault_is_told_once_with_output_and_sample(target):
    with pytest.warns(RuntimeWarning) as told:
        r = render(SCENE, {"x": RAMP}, 1000, target=target)
    assert len(told) == 1 and told[0].filename == __file__
    assert "output force was not finite at sample 3 (0.003 s)" in str(told[0].message)
    assert r.fault == ("force", 3)
    assert repr(r) == "Rendering(force, good: 0.006 s at 1000 Hz, FAULT: force from sample 3 on)"
    np.testing.assert_array_equal(r["good"], RAMP)


def test_a_fault_raises_or_is_ignored_on_demand():
    told = (SCENE, {"x": RAMP}, 1000)
    says = "force was not finite at sample 3"
    refused(FaultError, says, render, *told, on_fault="raise")
    refused(FaultError, says, list, stimlib.stream(*told, on_fault="raise"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert render(*told, on_fault="ignore").fault == ("force", 3)
        r = render(SCENE, {"x": RAMP[:3]}, 1000, on_fault="raise")
    assert r.fault is None and "FAULT" not in repr(r)
    for call in (render, stimlib.stream):
        refused(BadValue, "on_fault = 'shout' .*warn, raise, ignore", call, *told, on_fault="shout")


# What is given ------------------------------------------------------------------------
class Frame:
    """As much of a DataFrame as is looked at."""

    columns = ("t_s", "x_mm")


RECORDED = recording({"t_s": [0.0, 0.01], "x_mm": [0, 1]}, {"x": "x_mm*1e-3"})
TIMES = np.arange(6) / 500


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        (RAMP * 1j, "complex128"),
        (RAMP > 0, "bool"),
        (RAMP.astype(object), "object"),
        (["1", "2"], "<U1"),
        ([[1], [2, 3]], "real"),
        (x, "real numbers"),
        (None, "object"),
        ("ramp", "<U4"),
        (RAMP.reshape(2, 3), "one dimension"),
        (5.0, "np.full_like"),
        (np.array([1.0, np.nan]), "not finite at sample 1"),
        (np.array([np.inf]), "not finite at sample 0"),
        (lambda t: t * 1j, "complex128"),
        (lambda t: t > 0, "bool"),
        (lambda t: [1.0], "one number per time"),
        (lambda t: "a", "<U1"),
        (lambda t: t * np.nan, "not finite"),
        (lambda t: 0.01 * math.sin(t), "TypeError: .*np.sin for math.sin"),
        (lambda t: t if t < 1 else 1, "ValueError: .*np.where for if"),
        (RECORDED, "is a Recording: give rec.motion_for"),
        (Frame(), r"is a Frame: first rec = .*recording\(table, .* then rec"),
        (np.stack([TIMES, RAMP]), r"\(2, 6\); .*'t_s': a\[0\], 'x': a\[1\].*motion_for"),
        (np.stack([TIMES, RAMP], 1), r"\(6, 2\); .*recording\({'t_s': "),
        (RAMP[:, None], r"\(6, 1\); give positions alone, .*a.ravel\(\)"),
    ],
)
def test_a_motion_that_is_no_row_of_real_numbers(motion, says):
    seconds = 0.01 if callable(motion) or isinstance(motion, Frame | type(RECORDED)) else None
    error = refused(BadValue, f"motion of x.*{says}", render, SCENE, {"x": motion}, 1000, seconds)
    assert ("Error: " not in says) or "test_rendering.py:" in str(error) and error.__cause__


def test_a_recording_and_a_table_are_told_how_to_be_a_motion():
    refused(BadValue, "motion_for", render, SCENE, RECORDED, 1000, 0.01)
    refused(BadValue, r"recording\(table", render, SCENE, Frame(), 1000, 0.01)
    assert render(SCENE, RECORDED.motion_for(["x"]), 1000, 0.01).y.shape == (2, 10)


def test_whole_and_short_numbers_are_taken_as_they_are():
    for motion in (RAMP.astype(np.int16), RAMP.astype(np.float32), list(range(6)), tuple(RAMP)):
        np.testing.assert_array_equal(render(Scene({"y": x}), {"x": motion}, 1000)["y"], RAMP)


def test_a_motion_may_write_to_its_times():
    motion = {"x": lambda t: np.multiply(t, 2.0, out=t), "z": lambda t: t}
    y = render(Scene({"x": x, "z": 1.0 * Input("z", "m")}), motion, 8, 1.0).y
    np.testing.assert_array_equal(y[:, :3], [[0.0, 0.25, 0.5], [0.0, 0.125, 0.25]])


@pytest.mark.parametrize(
    "seconds", ["3", [1], 1j, np.ones(2), 0, -1, 1e-9, np.nan, np.inf, 10**400, x]
)
def test_a_length_that_is_none(seconds):
    says = "render: .*seconds .*(must be|finite|beyond)"
    refused(BadValue, says, render, SCENE, {"x": np.sin}, 1000, seconds)


def test_more_than_memory_is_refused_with_the_name_of_the_limit(monkeypatch, tmp_path):
    """Samples of all outputs count; a stream or a given array has no such limit."""
    says = "s: .* is more than limits.render_bytes.*STIMLIB_LIMITS="
    for seconds in (1e9, 1e6 * 3600):
        refused(BadValue, says, render, SCENE, {"x": np.sin}, 8000, seconds)
    parts = stimlib.stream(SCENE, {"x": lambda t: 0 * t}, 8000, 1e9, target="python", block=3)
    assert next(parts).shape == (2, 3)
    monkeypatch.setattr(stimlib.limits, "render_bytes", 2 * 8 * 6)
    scene = Scene({"a": x, "b": 2 * x})
    render(scene, {"x": RAMP}, 1000)
    monkeypatch.setattr(stimlib.limits, "render_bytes", 2 * 8 * 6 - 1)
    refused(BadValue, "limits.render_bytes", render, scene, {"x": RAMP}, 1000)
    kept = np.lib.format.open_memmap(tmp_path / "y.npy", "w+", float, (2, 6))
    made = render(scene, {"x": RAMP}, 1000, out=kept)
    assert made.y is kept and (np.load(tmp_path / "y.npy") == [RAMP, 2 * RAMP]).all()
    table = np.zeros((3, 6))
    table[0] = RAMP
    render(scene, {"x": table[0]}, 1000, out=table[1:])
    for out, says in (
        (np.empty((2, 7)), r"out must be .*\(2, 6\)"),
        ([], "must be an array"),
        (table[:2], "out shares memory with the motion of x"),
    ):
        refused(BadValue, says, lambda out=out: render(scene, {"x": table[0]}, 1000, out=out))
    assert (table == [RAMP, RAMP, 2 * RAMP]).all()


@pytest.mark.parametrize("scene", [{"force": x}, x, None, [], "squeeze", SCENE.outputs])
def test_what_is_no_scene(scene):
    refused(BadValue, r"must be a Scene, such as Scene\(", render, scene, {"x": RAMP}, 1000)
    refused(StimlibError, "must be a Scene", stimlib.compile, scene, 1000, "jax")


def test_where_of_a_comparison_is_no_longer_a_constant():
    scene = Scene({"y": blocks.where(x == 0, 10.0, 20.0)})
    y = render(scene, {"x": np.array([0.0, 1.0, 0.0])}, 1000)["y"]
    np.testing.assert_array_equal(y, [10, 20, 10])


# Motion -------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("motion", "speed"),
    [
        ("minimum_jerk(depth=20)", "124.6"),
        ("quantised(constant_speed(2, 10), 1e-6)", "2"),
        ("minimum_jerk(depth=0.15)", None),
        # a step within a sample is not the speed of a hand
        ("staircase_hold(0.005, 10, 0.1)", None),
        ("jittered(minimum_jerk(), 1e-4, rate=900.0, seed=1)", None),
    ],
)
def test_a_generator_that_is_faster_than_a_hand_is_told_once(motion, speed, tmp_path):
    scene = Scene({"force": 2.0 * x, "other": 1.0 * Input("z", "m")})
    both = dict.fromkeys("xz", parse_motion(motion))
    proc = stimlib.compile(scene, 8000)
    for make in (
        lambda: render(scene, both, 8000, 0.5),
        lambda: audio.write(tmp_path / "a.wav", proc, both, 0.5, progress=False),
    ):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            make()
        fast = [str(w.message) for w in told if "faster than a hand" in str(w.message)]
        says = [f"x moves at {speed} m/s, faster than a hand (1 m/s)"] if speed else []
        assert [text[: text.index(":")] for text in fast] == says


def test_an_array_that_was_recorded_at_another_rate_is_told(tmp_path):
    """500 Hz taken as 8000 Hz is 16 times too fast; taken as 500 Hz it is a hand."""
    slow = 0.02 * np.sin(2 * np.pi * 3 * np.arange(1000) / 500)  # at most 0.38 m/s
    scene = Scene({"y": 2.0 * x})
    proc = stimlib.compile(scene, 8000, target="python")
    for make in (
        lambda: render(scene, {"x": slow}, 8000, target="python"),
        lambda: list(stimlib.stream(scene, {"x": slow}, 8000, target="python")),
        lambda: audio.write(tmp_path / "a.wav", proc, {"x": slow}, 0.1, progress=False),
    ):
        warned(
            RuntimeWarning,
            r"x moves at .* m/s, .* fs = 8000 Hz; .*recording\({'t_s': t, 'x': x}",
            make,
        )
    t_s = np.arange(1000) / 500
    motion = recording({"t_s": t_s, "x": slow}, {"x": "x"}).motion_for(scene.inputs)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        render(scene, {"x": slow}, 500, target="python")
        # a step is not the speed
        render(scene, {"x": np.where(np.arange(800) < 400, 0.0, 0.005)}, 8000, target="python")
        y = render(scene, motion, 8000, 1.0, target="python")["y"]
    assert np.abs(y / 2 - np.interp(np.arange(8000) / 8000, t_s, slow)).max() < 1e-4


# A scene without inputs, and streams --------------------------------------------------
NOISE = Scene({"y": stimlib.Param("level", 1.0) * blocks.white_noise(seed=3)})


def test_a_scene_without_inputs_needs_no_motion():
    made = render(NOISE, fs=1000, seconds=0.2)
    y = made.y
    assert np.array_equal(y, render(NOISE, {}, 1000, 0.2).y)
    for target in ("llvm", "python"):
        proc = stimlib.compile(NOISE, 1000, target)
        assert np.array_equal(np.hstack([proc.process(64), proc.process(np.int32(136))]), y)
    runs = stimlib.compile(NOISE, 1000).many(seeds=[0, 1])
    assert np.array_equal(runs.process(200)[0], y)
    assert stimlib.verify(NOISE, None, made).passed
    for wrong in (-1, 1.5, True, "64", None, 2**70):
        refused(BadValue, "process: ", proc.process, wrong)
        refused(BadValue, "process: ", runs.process, wrong)
    refused(BadValue, "x must be an array", stimlib.compile(SCENE, 1000).process, 64)
    for error, says, scene, given in (
        (BadValue, "no end; give the number of seconds", NOISE, {"fs": 1000}),
        (BadValue, "fs is missing", NOISE, {"seconds": 1.0}),
        (UnknownName, "x is missing", SCENE, {"fs": 1000, "seconds": 1.0}),
    ):
        refused(error, says, render, scene, **given)


def test_a_stream_takes_what_render_takes_and_its_arrays_stay():
    options = {"params": {"level": 0.5}, "seed": 4, "target": "python"}
    y = render(NOISE, None, 1000, 0.2, **options).y
    parts = list(stimlib.stream(NOISE, None, 1000, 0.2, **options, block=30))
    assert [part.shape[1] for part in parts] == [30] * 6 + [20]
    assert np.array_equal(np.hstack(parts), y)
    proc = stimlib.compile(NOISE, 1000, seed=4)
    proc.set("level", 0.5, ramp=0.0)
    halves = [*stimlib.stream(proc, seconds=0.1), *stimlib.stream(proc, seconds=0.1)]
    assert np.array_equal(np.hstack(halves), y)
    for given in ({"fs": 1000}, {"params": {"level": 1.0}}, {"seed": 1}):
        says = "a Processor has its own fs, params and seed"
        refused(BadValue, says, stimlib.stream, proc, seconds=0.1, **given)


def test_inputs_of_other_units_may_be_fast():
    fast = parse_motion("minimum_jerk(depth=20)")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        render(Scene({"y": 2.0 * Input("u", "V")}), {"u": fast}, 1000, 1.0, target="python")
    assert told == []


@dataclass(frozen=True, eq=False)
class Own(Map):
    x: Block

    @staticmethod
    def step(p, s, x):
        return x, s


def test_what_a_scene_left_for_its_next_render_is_not_heard():
    """In threads, after a fault, after another output; and it ends with the scene."""
    x, level = Input("x"), stimlib.Param("level", 1.0)
    slow = blocks.first_order(blocks.sqrt(x), 0.01)  # which another rate has otherwise
    scene = Scene({"y": level * slow + NOISE.outputs["y"]})
    told = [
        (fs, seed, {"level": v}, target)
        for fs in (1000, 1500)
        for seed, v in ((0, 1.0), (1, 2.0), (2, -1.0))
        for target in ("llvm", "python")
    ]

    def samples(how):
        fs, seed, params, target = how
        return render(scene, {"x": np.arange(50.0)}, fs, None, params, seed, target).y

    def fresh(fs, seed, params, target):
        proc = stimlib.compile(scene, fs, target, seed)
        proc.set("level", params["level"], ramp=0.0)
        return proc.process(np.arange(50.0)[None])

    wanted = [fresh(*how) for how in told]
    refused(FaultError, "y", render, scene, {"x": -RAMP}, 1000, on_fault="raise")
    with ThreadPoolExecutor(4) as threads:
        for got, y in zip(threads.map(samples, 5 * told), 5 * wanted, strict=True):
            np.testing.assert_array_equal(got, y)
    scene.outputs["y"] = 2 * x
    np.testing.assert_array_equal(render(scene, {"x": RAMP}, 1000)["y"], 2 * RAMP)
    other = Scene({"y": 3 * x})
    render(other, {"x": RAMP}, 1000)
    large = Scene({"y": blocks.delay(x, 2**16)})
    render(large, {"x": RAMP}, 1000)
    own = Scene({"y": Own(x)})
    render(own, {"x": RAMP}, 1000, target="python")
    left = {key[0] for key in rendering._LEFT}
    assert id(other) in left and not {id(large), id(own)} & left
    gone, number = weakref.ref(other), id(other)
    del other
    gc.collect()
    assert gone() is None and number not in {key[0] for key in rendering._LEFT}
    many = [Scene({"y": float(k) * x}) for k in range(2, 2 + 2 * rendering.MOST_LEFT)]
    for one in many:
        render(one, {"x": RAMP}, 1000, target="python")
    kept = many[-rendering.MOST_LEFT :]
    assert [key[0] for key in rendering._LEFT] == [id(one) for one in kept]


def every_third(self, fs):
    return EveryParams(fs, 3.0), ()


@pytest.mark.parametrize(
    ("of", "name", "other"),
    [
        (Every, "design", every_third),
        (Every, "step", staticmethod(lambda p, s, t: (float(t % 3.0 == 0.0), s))),
        (Every.design, "__code__", every_third.__code__),
    ],
)
def test_a_block_that_was_exchanged_is_made_anew(monkeypatch, of, name, other):
    """As an editor exchanges a method when it reloads a module, or its code."""
    made = partial(render, Scene({"y": blocks.every(2.0)}), None, 1.0, 4.0, target="python")
    assert made()["y"].tolist() == [1, 0, 1, 0]
    monkeypatch.setattr(of, name, other)
    assert made()["y"].tolist() == [1, 0, 0, 1]


def test_first_guesses_of_a_call_are_told_what_to_write():
    call = partial(stimlib.render, stimlib.Scene({"y": 2.0 * stimlib.Input("x")}), fs=8, seconds=1)
    refused(BadValue, r"stands still give lambda t: np.full_like\(t, 0.25\)", call, {"x": 0.25})
    refused(TypeError, r"'a'; a parameter of the scene .* params=\{'a': ..\}", call, a=2.0)
    y = call({"x": lambda t: t})
    assert np.array_equal(np.asarray(y), y.y) and np.asarray(y, np.float32).dtype == np.float32
    np.array(y)[:] = 0.0
    assert y.y.any()
    refused(BadValue, "give full_scale, the largest value", y.save, "a.wav", subtype="PCM_24")
