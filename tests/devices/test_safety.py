"""The safety stage: what it does to samples, that it counts, and that it does nothing
where nothing is wrong.
"""

import dataclasses as dc
import json

import numpy as np
import pytest
from devices.servers import played
from laws import lawful
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, SceneError, UnitError, UnknownName, constant
from stimlib.blocks import active, delay, spring, wall, white_noise
from stimlib.blocks.actuator import Passive, ResponseLimit, Tally
from stimlib.checks.session import verify_log
from stimlib.core.graph import reach
from stimlib.core.guard import Guard
from stimlib.devices import NullSink
from stimlib.files import read_log
from stimlib.motion import minimum_jerk
from stimlib.run.safety import (
    GAIN,
    Inverse,
    Passivity,
    Safety,
    Watch,
    guarded,
    protect,
    said_of_energy,
    to_device,
)
from stimlib.scenes import squeeze

FS = 8000
INVERSE = Inverse([0.1, 0.9, -0.2], [1.0])


def compiled(scene, safety, fs=FS, gain=1.0, target="llvm"):
    proc = stimlib.compile(protect(scene, safety), fs, target)
    proc.set(GAIN, gain, ramp=0.0)
    return proc


def processed(scene, safety, *inputs, **how):
    """The processor of a safe scene, and what it makes of these rows."""
    proc = compiled(scene, safety, **how)
    return proc, proc.process(np.stack(inputs))


def finger(n, fs=FS):
    return 0.01 * (1 - np.cos(2 * np.pi * 2 * np.arange(n) / fs))


def test_what_is_not_limited_passes_bit_for_bit():
    x = np.stack([finger(FS), 0.5 * finger(FS)])
    plain = stimlib.compile(squeeze(), FS).process(x)
    proc = compiled(squeeze(), Safety(200.0, slew=1e9, peak=150.0, static=100.0))
    assert np.abs(plain).max() > 10
    assert np.array_equal(proc.process(x), plain)
    assert Watch(proc).counts() == {} and Watch(proc).faults() == {}


@pytest.mark.parametrize("target", ["llvm", "python"])
def test_every_stage_limits_and_counts(target):
    scene = Scene({"force": 1.0 * Input("f", "N"), "x": 2 * Input("x", "m")})
    x = np.zeros((2, 300))
    x[0, 100:] = 100.0
    x[1, 250:] = -3.0
    safety = Safety({"force": 50.0, "x": 5.0}, slew={"force": 40.0 * FS}, peak=80.0, static=60.0)
    proc, y = processed(scene, safety, *x, target=target)
    assert y[0, 99:103].tolist() == [0.0, 40.0, 50.0, 50.0], "slew, then full scale"
    assert y[1, 250:].tolist() == [-5.0] * 50, "no slew, no force rule: only the clip"
    counts = Watch(proc).counts()
    assert counts == {"peak": {"force": 200}, "slew": {"force": 1}, "clip": {"force": 200, "x": 50}}


def test_what_is_held_for_long_is_brought_below_the_static_limit():
    scene = Scene({"force": 1.0 * Input("f", "N")})
    safety = Safety(70.0, peak=80.0, static=60.0)
    proc, (y,) = processed(scene, safety, np.full(20_000, 79.0), fs=1000)
    assert Watch(proc).counts()["static"]["force"] > 5_000
    assert y[-1] < 69.0 and y.max() == 70.0


@pytest.mark.parametrize(
    ("fs", "samples"), [(100, 50), (1000, 128), (4000, 128), (8000, 160), (48000, 960)]
)
def test_a_fault_fades_in_small_steps_at_every_rate(fs, samples):
    """A guard in a rendering takes 20 ms whatever the rate; at 1 kHz that would be
    steps of 5 % on a device.
    """
    x = np.r_[np.ones(10), np.full(1000, np.nan)]
    proc, (y,) = processed(Scene({"y": 1 * Input("x")}), Safety(1.0), x, fs=fs)
    assert Watch(proc).fade == samples and np.allclose(
        y[10 : 11 + samples], 1 - np.arange(samples + 1) / samples
    )
    assert not y[10 + samples :].any()


@pytest.mark.parametrize("last", [1e3, -1e308])
@pytest.mark.parametrize("more", [{}, {"peak": 0.5}, {"static": 0.9}, {"slew": 1e4}])
def test_a_scene_that_runs_away_fades_from_what_the_device_was_given(last, more):
    """A filter that is not stable grows beyond all limits before it is no number: its
    last one is no place to fade from.
    """
    x = np.r_[np.linspace(0, 0.9, 200), np.full(100, last), np.full(400, np.nan)]
    proc, (y,) = processed(Scene({"F": 1 * Input("F", "N")}), Safety(1.0, **more), x)
    assert np.abs(y).max() <= 1.0
    assert 0.3 < abs(y[299]) and np.abs(np.diff(y[299:])).max() <= 1 / 128, "it fades in 20 ms"
    assert not y[299 + 162 :].any()
    counts = Watch(proc).counts()
    assert counts["clip" if not more.get("peak") else "peak"]["F"] < 360, (
        "what is not finite is not counted"
    )


def test_a_slew_limit_comes_back_from_full_scale_at_once():
    """It follows what was clipped, not what was asked for."""
    x = np.r_[np.full(100, 1e6), np.zeros(400)]
    y = compiled(Scene({"y": 1 * Input("x")}), Safety(1.0, slew=FS / 10)).process(x[None])[0]
    assert np.allclose(y[:100], np.minimum(0.1 * np.arange(1, 101), 1.0))
    assert np.abs(y[110:]).max() < 1e-12


@pytest.mark.parametrize(("fs", "value"), [(1000, 1.0), (8000, 1000.0), (48000, 1000.0)])
def test_a_fade_has_steps_below_one_percent_even_of_what_is_clipped_or_fails(fs, value):
    """The gain stands behind the guard: stopping while the guard fades multiplies
    both. Until it is set, nothing comes.
    """
    safety = Safety(1.0)
    scene, n = Scene({"y": value * Input("x")}), safety.samples(fs)
    silent = stimlib.compile(protect(scene, safety), fs).process(np.ones((1, 100)))
    assert not silent.any() and n / fs >= 0.02
    for fails in (n + 5, n // 2 if fs > 1000 else n + 5):
        proc = compiled(scene, safety, fs)
        y = [proc.process(np.ones((1, 10)))]
        proc.set(GAIN, 0.0, ramp=n / fs)
        y.append(proc.process(np.where(np.arange(n + 5) < fails, 1.0, np.nan)[None]))
        y = np.concatenate(y, axis=1)[0]
        assert np.abs(np.diff(y)).max() <= 0.01 and not y[n + 10 :].any()


def test_frames_for_a_device():
    y = np.array([[1.0, -70.0, np.nan], [0.1, np.inf, 0.25]])
    frames = to_device(y, np.array([50.0, 1.0]), [1, -1, 0])
    assert frames.dtype == np.float32
    expected = np.array([[0.1, 0, 0.02], [0, 0, -1], [0.25, 0, 0]], np.float32)
    assert np.array_equal(frames, expected)


def test_plain_data_of_numbers():
    safety = Safety({"force": 50}, slew={"force": 1e4}, peak=40, fade=0.05)
    assert Safety(**json.loads(json.dumps(safety.to_dict()))) == safety
    assert safety.scales(("force",)).tolist() == [50.0]
    told = Safety("3", slew={"y": "2"}, peak=np.float32(4)).to_dict()
    assert (told["full_scale"], told["slew"], told["peak"]) == (3.0, {"y": 2.0}, 4.0)
    assert {type(v) for v in (told["full_scale"], told["slew"]["y"], told["peak"])} == {float}


NO_PASSIVITY = "is no Passivity: .*"


@pytest.mark.parametrize(
    ("kind", "wrong", "says"),
    [
        (Safety, {"full_scale": 0}, "Safety"),
        (Safety, {"full_scale": float("nan")}, "Safety"),
        (Safety, {"full_scale": "much"}, "Safety"),
        (Safety, {"full_scale": True}, "Safety"),
        (Safety, {"full_scale": 1, "slew": -1}, "Safety"),
        (Safety, {"full_scale": 1, "fade": 0.01}, "Safety"),
        (Safety, {"full_scale": 1, "fade": 1.0}, "Safety"),
        (Safety, {"full_scale": {"a": 0.0}}, "Safety"),
        (Safety, {"inverse": INVERSE, "passivity": Passivity(1.0)}, "give only one"),
        (
            Safety,
            {"passivity": {"bound": 1.0, "k": 2.0}},
            NO_PASSIVITY + "no 'k' .*; it has bound, ",
        ),
        (Safety, {"passivity": {"k": 2.0}}, NO_PASSIVITY + "no 'k' is known and bound is missing"),
        (Safety, {"passivity": {"bound": -1.0}}, NO_PASSIVITY + "bound = -1.0 .* above 0"),
        (Passivity, {"bound": 0.0}, "bound = 0.0 must be a number above 0"),
        (Passivity, {"bound": 1.0, "lost": 1.5}, "lost = 1.5 must be a whole number from 0"),
        (Passivity, {"bound": 1.0, "lost": 1001}, "lost = 1001 must be a whole number from 0"),
    ],
)
def test_bad_numbers(kind, wrong, says):
    refused(BadValue, says, kind, **({"full_scale": 1.0} if kind is Safety else {}) | wrong)


@pytest.mark.parametrize(
    ("safety", "error", "says"),
    [
        (Safety({"force": 1.0}), UnknownName, "x"),
        (Safety({"force": 1.0, "x": 1.0}, slew={"c": 1.0}), UnknownName, "c"),
        (Safety(50.0), UnitError, r"full_scale = 50 .*force \[N\], x \[m\].*give {'force'"),
        (Safety({"force": 50.0, "x": 0.1}, slew=3.0), UnitError, "slew = 3 cannot apply"),
    ],
)
def test_names_and_units_that_do_not_fit(safety, error, says):
    """One number is not for outputs of different units."""
    scene = Scene({"force": 1.0 * Input("f", "N"), "x": 1.0 * Input("x", "m")})
    refused(error, says, protect, scene, safety)
    protect(scene, Safety({"force": 50.0, "x": 0.1}, slew={"force": 3.0}, peak=20.0))
    refused(SceneError, "reserved", protect, Scene({"a": Param(GAIN, 1.0) * 2}), Safety(1.0))
    for limit in ({"peak": 1.0}, {"static": 1.0}):
        one = Scene({"a": constant(1.0)})
        refused(BadValue, r"outputs in N, .*none: a \[1\]", protect, one, Safety(1.0, **limit))


def test_equal_outputs_are_counted_apart_and_fail_where_they_are():
    """Each fades in 20 ms from where it is."""
    scene = Scene({"a": 2 * Input("u"), "b": 2 * Input("u"), "c": 1 * Input("v")})
    proc = compiled(scene, Safety({"a": 1.0, "b": 3.0, "c": 1.0}, slew=1e9))
    x = np.full((2, 600), 0.6)
    x[0, 200], x[1, 300:] = np.nan, -np.inf
    proc.process(x[:, :100].copy())
    assert Watch(proc).counts() == {"clip": {"a": 100}}
    proc.reset()
    proc.set(GAIN, 1.0, ramp=0.0)
    y = proc.process(x)
    assert Watch(proc).faults() == {"a": 200, "b": 200, "c": 300}
    assert np.isfinite(y).all() and np.abs(np.diff(y[:, 1:])).max() <= 1.2 / 160 * 1.001
    assert not y[:2, 361:].any() and not y[2, 461:].any()


@pytest.mark.parametrize("limits", [{}, {"peak": 0.8, "static": 0.7, "slew": 1e4}])
def test_a_fault_before_an_inverse_filter_is_reported(limits):
    """The guard behind the filter receives only the fade of the one before it."""
    scene = Scene({"force": 1 * Input("f", "N"), "mark": 1 * Input("m")})
    limits = limits | {"slew": {"force": limits["slew"]}} if limits else {}
    proc = compiled(scene, Safety({"force": 1.0, "mark": 1.0}, inverse=INVERSE, **limits))
    x = np.full((2, 600), 0.5)
    proc.process(x[:, :50].copy())
    assert Watch(proc).faults() == {}
    x[0, 100], x[1, 200:] = np.nan, np.inf
    y = proc.process(x[:, 50:].copy())
    assert np.isfinite(y).all() and not y[0, 300:].any()
    assert Watch(proc).faults() == {"force": 100, "mark": 200}


@pytest.mark.parametrize(
    ("limit", "part"),
    [
        ({}, lambda felt: felt / 2.0),
        ({"peak": 1.0}, lambda felt: felt),
        ({"slew": 100.0}, lambda felt: np.diff(felt) / 0.1),
    ],
    ids=["full scale", "peak", "slew"],
)
def test_each_limit_holds_behind_a_device_that_adds_up_two_samples(limit, part):
    """The limits of the request, before the inverse filter, do not see that."""
    scene = Scene({"force": constant(1.0, "N") * Input("x")})
    safety = Safety(2.0, **limit, inverse=Inverse([0.5], [2.0, 2.0]))
    proc, (drive,) = processed(scene, safety, np.repeat([0.0, 2.0, -2.0], 60), fs=1000)
    felt = np.convolve(drive, [1.0, 1.0])[: drive.size]
    assert np.abs(part(felt)).max() == pytest.approx(1.0, abs=1e-9)
    assert Watch(proc).counts()["skin"]["force"] > 10


def test_infinity_passes_the_limit_ahead_so_that_the_guard_ends_the_output():
    proc = stimlib.compile(Scene({"y": ResponseLimit(Input("x"), np.ones(2), 1.0, None, 1)}), FS)
    y = proc.process(np.array([[0.75, np.inf, 0.75, 0.75]]))[0]
    assert y[0] == y[1] == 0.75 and (np.diff(y[1:]) < 0.0).all() and (y > 0.7).all()


def test_content_outside_is_counted_as_a_part_of_the_largest_so_far():
    x = Input("x")
    proc = stimlib.compile(Scene({"y": Tally(x, x, x + Input("more"), "outside", "y", 0.1)}), FS)
    proc.process(np.array([[10.0, 1.0, 1.0, 1.0], [0.9, 0.9, 1.1, -1.2]]))
    assert Watch(proc).outside() == {"y": {"samples": 2, "level": pytest.approx(1.2)}}


def test_nothing_has_been_before_sample_0_behind_a_guard():
    """So a long filter there need not run over noise from before."""
    plain, guarded = (
        stimlib.render(Scene({"y": delay(wrap(white_noise(3)), samples=3)}), fs=FS, seconds=0.01)[
            "y"
        ]
        for wrap in (lambda y: y, Guard)
    )
    assert plain[:3].all() and not guarded[:3].any()
    assert np.array_equal(plain[3:], guarded[3:])


# The passivity controller -------------------------------------------------------------
X = Input("x", "m")
GIVES = Passivity(2e-3, damping=1.0, delay=0.003, encoder=1e-5)
ALONG = Scene({"F": 1.0 * Input("f", "N"), "x": 1.0 * X})  # a force given beside its place
PUSHED = Scene({"force": 1.0 * Input("f", "N") + constant(30.0, "N/m") * X})


def motion_of_noise(rng, n=4000):
    """Positions at up to 0.5 m/s, 1000 a second, and noise that is as smooth."""
    smooth = np.convolve(rng.normal(size=n), np.ones(20) / 20, "same")
    return np.cumsum(np.clip(2.0 * smooth, -1, 1) * 0.5 / 1000), smooth


def given(force, x, late):
    """The most energy that held forces give along a motion, after a whole delay."""
    acting = np.r_[np.zeros(late), force][: force.size - 1]
    return -np.cumsum(acting * np.diff(x)).min(initial=0.0)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_no_motion_takes_more_than_the_bound(seed, damping):
    """A force pushes along a motion of noise, as fast as stated and read in steps."""
    rng, fs, step, late = np.random.default_rng(seed), 1000, 1e-5, seed % 4
    p = Passivity(5e-3, damping, speed=0.5, delay=late / fs, encoder=step)
    x, smooth = motion_of_noise(rng)
    wanted = rng.choice([-1.0, -20.0]) * np.roll(smooth, 3) + 0.3 * rng.normal(size=4000)
    read = np.floor(x / step + 0.5) * step
    proc, (y,) = processed(PUSHED, Safety(8.0, passivity=p), wanted, read, fs=fs)
    asked = np.clip(wanted + 30.0 * read, -8.0, 8.0)
    assert np.abs(y).max() <= 8.0 and given(asked, x, late) > p.bound >= given(y, x, late)
    told = Watch(proc).energy()["force"]
    assert given(y, x, late) <= told["given"] <= p.bound * (1 + 1e-9) and told["leaps"] == 0
    assert Watch(proc).counts()["passivity"]["force"] == np.count_nonzero(y != asked)
    assert told["most"] == np.abs(y - asked).max() > 0
    # what it observes: the work, and the least that the true position may make of it
    for bound in (p.bound, 1.0):  # which is all given, and which is not
        safety = Safety(8.0, passivity=dc.replace(p, bound=bound))
        proc, (y,) = processed(PUSHED, safety, wanted, read, fs=fs)
        acting = np.r_[np.zeros(late + 1), y][: y.size]
        work = np.cumsum(acting * np.diff(read, prepend=read[0]))
        work -= step / 2 * np.cumsum(np.abs(np.diff(acting, prepend=0.0)))
        told = Watch(proc).energy()["force"]
        assert told["work"] == pytest.approx(work[-1])
        assert told["given"] == pytest.approx(-(work - step / 2 * np.abs(acting)).min())


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["still", "lost", "sure"])
def test_no_fault_that_was_stated_takes_more_than_the_bound(kind, seed):
    """Readings stay, the device holds older forces, or its amplifier is weak, as often
    as stated, while forces push along the true motion.
    """
    rng, fs, n, step, late = np.random.default_rng(seed), 1000, 4000, 1e-5, seed % 3
    x, smooth = motion_of_noise(rng, n)
    read, act = np.floor(x / step + 0.5) * step, np.arange(n)
    for k in range(1, n):
        fails = rng.random() < (0.6 if seed % 2 else 0.05)
        if kind == "still" and fails and k - act[k - 1] <= 30:
            read[k], act[k] = read[k - 1], act[k - 1]
        if kind == "lost" and fails and k - act[k - 1] <= 4:
            act[k] = act[k - 1]
    p = {"still": {"still": 0.03}, "lost": {"lost": 4}, "sure": {"sure": 0.7}}[kind]
    wanted = -5.0 * np.roll(smooth, 3 * (seed % 2))
    wanted += 0.3 * rng.normal(size=n)

    def taken(**stated):
        passive = Passivity(5e-3, speed=0.5, delay=late / fs, encoder=step, **stated)
        proc, (y,) = processed(PUSHED, Safety(8.0, passivity=passive), wanted, read, fs=fs)
        makes = np.clip(y, -0.7, 0.7) if kind == "sure" else y[act] if kind == "lost" else y
        return given(makes, x, late), Watch(proc).energy()["force"]["given"]

    most, told = taken(**p)
    assert most <= told <= 5e-3 * (1 + 1e-9)
    assert told > 4e-3, "something was asked for"


@pytest.mark.parametrize(
    ("stated", "moves", "forces"),
    [({"lost": 1}, [0, 1, -1], [0, 5, 5]), ({"sure": 0.5}, [1] + 10 * [-1], [5] + 10 * [0.5])],
)
def test_the_smallest_fault_takes_more_unless_it_is_stated(stated, moves, forces):
    """A hand moves in and out by 0.9 mm under 5 N, the first of which is lost; or in
    under 5 N, of which an amplifier makes 0.5 N, and ten times as far out under these.
    """
    x = np.cumsum(np.r_[0, np.tile(9e-4 * np.array(moves), 100)])
    wanted = np.r_[np.tile(forces, 100), 0.0]
    lost = np.arange(x.size) % 3 == 1

    def taken(**stated):
        p = Passivity(0.02, speed=1.0, axes={"F": "x"}, **stated)
        _, (y, _) = processed(ALONG, Safety({"F": 5.0, "x": 1e3}, passivity=p), wanted, x, fs=1000)
        late = np.where(lost, np.roll(y, 1), y)
        return given(np.clip(y, -0.5, 0.5) if "sure" in stated else late, x, 0)

    assert 0 < taken(**stated) <= 0.02 * (1 + 1e-9)
    assert taken() > 0.1


@pytest.mark.parametrize("late", [0.0, 1.0, 2.3])
@pytest.mark.parametrize("damping", [0.0, 4.0])
@pytest.mark.parametrize(
    "faulty", [(0.0,), (40 / 1024, 0), (0.0, 3), (0.0, 0, 1.5), (0.01, 2, 1.0)]
)
def test_the_controller_is_its_law(late, damping, faulty):
    """Along exact steps, some as fast as stated, some faster, some none; a force acts
    from between two samples on, and its limit fades.
    """
    rng, fs, step, n = np.random.default_rng(7), 1024.0, 2.0**-14, 3000
    smooth = np.convolve(rng.normal(size=n), np.ones(20) / 20, "same")
    steps = np.clip(np.round(30 * smooth), -9, 9)
    steps[1000:1100], steps[[1500, 2000]] = 0, 10
    fade = np.clip(np.minimum(np.arange(n) / 200, np.arange(n)[::-1] / 900), 0, 1)
    numbers = 2.0, 0.06, 1e-3, damping, 0.5, late / fs, step, *faulty
    block = Passive(Input("f", "N"), X, Input("gain"), *numbers)
    x = {"x": np.cumsum(steps) * step, "gain": fade}
    x["f"] = -5.0 * np.roll(smooth, 3) + 0.3 * rng.normal(size=n)
    lawful(block, fs, **x)


def test_a_leap_of_the_position_is_not_trusted():
    """No energy is credited for it, and the worst is taken away."""
    x = np.r_[np.zeros(9), np.full(291, 0.05), np.full(209, np.nan)]
    safety = Safety(5.0, passivity=GIVES)
    proc, (y,) = processed(Scene({"F": wall(X, 500.0)}), safety, x, fs=1000)
    told = Watch(proc).energy()["F"]
    assert np.isfinite(y).all() and told["leaps"] == 1 + 209
    assert told["given"] == pytest.approx(GIVES.bound, rel=1e-9)
    assert 0 < np.abs(y).max() <= GIVES.bound / (1e-3 + 1e-5)
    assert Watch(proc).faults() == {"F": 300}
    # after a gap it goes on
    x = 0.01 * np.sin(np.maximum(np.arange(500) - 250, 0) / 100)
    x[300] = np.nan
    safety = Safety({"F": 5.0, "x": 1.0}, passivity=dc.replace(GIVES, axes={"F": "x"}, still=0.05))
    proc, _ = processed(ALONG, safety, np.ones(500), x, fs=1000)
    assert Watch(proc).energy()["F"]["leaps"] == 2, "at the gap"


@pytest.mark.parametrize("unseen", [np.nan, np.inf, "stuck"])
def test_a_motion_that_was_not_seen_earns_no_energy(unseen):
    """The hand moves under no force, is seen under one, and moves back with it."""
    x, wanted = np.zeros((2, 100, 40))
    x[:, 30:33], wanted[:, 30], wanted[:, 31:33] = 9e-4, 20.0, 5.0
    read = x.copy()
    read[:, 30] = 0.0 if unseen == "stuck" else unseen
    p = Passivity(0.01, speed=1.0, still=0.005 if unseen == "stuck" else 0.0, axes={"F": "x"})
    scene = Scene({"F": Input("f", "N") + 0.0 * spring(Input("z", "m"), 1.0), "G": spring(X, 0.0)})
    y = compiled(scene, Safety(20.0, passivity=p), 1000).process(
        np.stack([wanted.ravel(), np.zeros(4000), read.ravel()])
    )[0]
    assert 0.0 < np.abs(y).max() <= 20.0 and given(y, x.ravel(), 0) <= p.bound


@pytest.mark.parametrize("still", [0, 5, 20])
def test_what_a_reading_that_stays_may_hide_is_told(still):
    """Under 1 N it stays for 9 samples, in each of which the hand may get 1 mJ; then it
    leaps, which may hide one more, and stays again.
    """
    p = Passivity(1.0, speed=1.0, still=still / 1000, axes={"F": "x"})
    proc = compiled(ALONG, Safety({"F": 5.0, "x": 1.0}, passivity=p), 1000)
    hidden, told = np.minimum(np.r_[:10, :10], still), []
    for x in np.repeat([0.0, -0.01], 10):
        proc.process(np.array([[1.0], [x]]))
        told.append(Watch(proc).energy()["F"])
    work = np.repeat([0, -1 - hidden[9]], 10)
    assert [q["work"] for q in told] == pytest.approx(1e-3 * work)
    assert [q["given"] for q in told] == pytest.approx(1e-3 * np.maximum.accumulate(hidden - work))


def test_a_force_that_gives_nothing_passes_bit_for_bit():
    scene = Scene({"F": spring(X, 100.0), "tone": 0.1 * white_noise(1)})
    x = finger(4000)
    want = stimlib.compile(scene, FS).process(x[None])
    safety = Safety({"F": 50.0, "tone": 1.0}, passivity=Passivity(0.1, 5.0))
    proc, y = processed(scene, safety, x)
    assert np.array_equal(y, want) and Watch(proc).counts() == {}
    assert [*Watch(proc).energy()] == ["F"], "what is no force over a position is not observed"
    off = protect(scene, Safety({"F": 50.0, "tone": 1.0}))
    assert not any(isinstance(b, Passive) for b in reach(off.outputs.values())), "no work"


def test_the_fade_ends_what_the_controller_adds():
    for size, speed in ((10.0, 1.0), (0.3, 0.2)):  # of the second something is left to give
        passive = dc.replace(GIVES, speed=speed)
        proc = compiled(Scene({"F": -1.0 * spring(X, 100.0)}), Safety(9.0, passivity=passive), FS)
        x = size * finger(FS)[None]
        assert np.abs(proc.process(x)).max() > 0 and Watch(proc).counts()["passivity"]["F"] > FS / 4
        proc.process(x[:, :1500])
        proc.set(GAIN, 0.0, ramp=0.02)
        assert not proc.process(x[:, 1500:])[0, 200:].any()


def test_positions_of_forces():
    y = Input("y", "m")
    both = Scene({"F": spring(X, 1.0) + spring(y, 1.0), "G": spring(y, 1.0)})
    refused(
        BadValue,
        r"depends on x, y: say .*axes=\{'F': 'x'\}",
        protect,
        both,
        Safety(1.0, passivity=GIVES),
    )
    for axes, error in (({"H": "x"}, "no output 'H'"), ({"F": "z"}, "no input 'z'")):
        wrong = Safety(1.0, passivity=Passivity(1.0, axes=axes))
        refused(UnknownName, error, protect, both, wrong)
    told = Safety(1.0, passivity=Passivity(1.0, axes={"F": "y"}))
    pushing = Scene({n: active(force, 0.5) for n, force in both.outputs.items()})
    for scene, power in ((both, 0.0), (pushing, 0.5)):
        found = {n: (at.name, given) for n, (at, given) in guarded(scene, told).items()}
        assert found == {"F": ("y", power), "G": ("y", power)}
    none = Scene({"F": constant(1.0, "N") * Input("u")})
    refused(BadValue, "no output is a force over", protect, none, Safety(1.0, passivity=GIVES))
    assert Passivity(1.0, lost=1000).lost == 1000
    turned = Scene({"T": constant(1.0, "N*m") * Input("angle")})
    proc = compiled(turned, Safety(1.0, passivity=Passivity(1.0, lost=2.0, sure=0.0)))
    assert Watch(proc).energy()["T"]["unit"] == "rad/s"
    again = json.loads(json.dumps(Safety(1.0, passivity=told.passivity).to_dict()))
    assert Safety(**again) == told


def test_a_session_says_and_proves_what_the_controller_did(tmp_path):
    """In its report and its log, from which every sample is computed again."""
    scene = Scene({"F": -1.0 * spring(X, 300.0), "G": 1.0 * wall(X, 100.0)})
    motion = {"x": minimum_jerk(0.0, 0.03)}
    how = {"motion": motion, "clocked": False, "log": tmp_path / "a"}
    sink = NullSink(scene, Safety(9.0, passivity=GIVES), **how)
    report = played(sink, 2.0, fs=1000).report()
    told = report.energy["F"]
    assert report.clips["passivity"]["F"] > 100 and 1e-3 < told["given"] <= GIVES.bound
    said = f"F gave at most {1e3 * told['given']:.3g} mJ to motions of up to 1 m/s; its passivity"
    said = f"{said} controller changed it by up to {told['most']:.3g}"
    assert f"{said};" in str(report)
    for leaps, more in ((0, ""), (1, "1 position"), (2, "2 positions")):
        (line,) = said_of_energy({"F": {**told, "leaps": leaps}})
        assert line == said + f", and did not trust {more}" * (leaps > 0)
    assert "up to 1 rad/s;" in said_of_energy({"F": {**told, "unit": "rad/s"}})[0]
    log = read_log(tmp_path / "a")
    checked = verify_log(log)
    assert checked.passed, checked
    assert any(
        f"{sum(report.clips['passivity'].values())} limited (passivity)" in c.text
        for c in checked.checks
    )
    log.report["energy"]["F"]["given"] *= 1.1
    assert not verify_log(log).passed
