"""The damping that a device needs: against closed forms, against the poles of a device,
and what is told of a scene.
"""

import json

import numpy as np
import pytest
from commands import ran
from refusals import refused
from scipy.linalg import expm

import stimlib
from stimlib import BadValue, Input, Scene
from stimlib.analysis import damping_of, needed_damping, passivity
from stimlib.blocks import (
    active,
    button,
    constant,
    delay,
    detents,
    first_order,
    force_limit,
    friction,
    kelvin_voigt,
    spring,
    stick_slip,
    wall,
    white_noise,
)
from stimlib.checks import evidence
from stimlib.run import Passivity, Safety, protect

X = Input("x", "m")


def needed(block, fs=8000, **more):
    return damping_of(stimlib.compile(Scene({"F": block}), fs, "python"), **more).get(("F", "x"))


@pytest.mark.parametrize("B", [2.0, -2.0])
@pytest.mark.parametrize(("fs", "delay"), [(1000, 0.0), (8000, 0.0), (1000, 0.002)])
def test_a_spring_and_a_difference_are_the_closed_form(B, fs, delay):
    """K T/2 + |B|, and of a spring that is late K (T/2 + delay)."""
    K = 1000.0
    spring_alone = needed_damping(lambda f: np.full(f.shape, K + 0j), fs, delay)
    assert spring_alone == pytest.approx(K * (0.5 / fs + delay), rel=1e-6)
    if not delay:
        damped = needed_damping(lambda f: K + B * fs * (1 - np.exp(-2j * np.pi * f / fs)), fs)
        assert damped == pytest.approx(K / (2 * fs) + abs(B), rel=1e-6)


@pytest.mark.parametrize("late", [0, 3])
def test_below_it_a_heavy_device_on_a_spring_is_unstable(late):
    """Mass and damper solved exactly between samples, closed by the spring: the sign of
    log |pole| changes at the bound.
    """
    K, T, m = 1000.0, 1e-3, 2e4
    for part, stable in ((0.99, False), (1.01, True)):
        b = part * needed_damping(lambda f: np.full(f.shape, K + 0j), 1 / T, late * T)
        moved = expm(T * np.array([[0, 1, 0], [0, -b / m, -1 / m], [0, 0, 0]]))
        # place, speed, the samples of force on their way
        A = np.zeros((2 + late + 1, 2 + late + 1))
        A[:2, :2], A[:2, 2] = moved[:2, :2], moved[:2, 2]
        A[2:-1, 3:] = np.eye(late)
        A[-1, :2] = K * moved[0, :2]
        A[-1, 2] = K * moved[0, 2]
        assert (np.abs(np.linalg.eigvals(A)).max() < 1) == stable


K, T = 1000.0, 1 / 8000


@pytest.mark.parametrize(
    ("force", "words", "want"),
    [
        (wall(X, K), {}, K * T),  # the mean over a way is half a sample late: K (T/2 + T/2)
        (wall(X, K), {"delay": 1e-3}, K * (T + 1e-3)),
        (force_limit(2.0 * wall(X, K)), {}, 2 * K * T),
        (wall(X, K, 3.0), {}, 3.0),
        (detents(X, 1e-3, 0.5), {}, 2 * np.pi * 0.5 / 1e-3 * T),
        (button(X, 2.0, at=1e-3).force, {}, 2000.0 * T),
        (friction(X, 1.0, stiffness=K), {}, K * T),
        (stick_slip(X, 1.0, stiffness=K) + friction(X, 1.0, stiffness=K), {}, 2 * K * T),
        *(  # the steepest falls of 0.2 exp(-(v/0.02)^exponent), found on a grid
            (friction(X, 1.0, 0.5, K, static=0.7, speed=0.02, exponent=d), {}, fall + K * T)
            for d, fall in ((1.0, 10.0), (1.3, 7.3580476), (2.0, 8.5776388), (3.0, 11.7543180))
        ),
        (
            friction(X, 1.0, 0.5, K, "lugre", static=0.7, damping=0.1, viscosity=20.0),
            {},
            20.1 - 0.2 * np.sqrt(2 / np.e) / 0.02,
        ),
        (kelvin_voigt(X, 1000.0, 2.0), {"fs": 1000}, 2.0),
        (kelvin_voigt(X, 5000.0, 2.0), {"fs": 1000}, 3.0),
        *(  # what is late by many samples needs the most where w T is below 1e-4
            (late, {"fs": 48000} | words, pytest.approx(K * (d + 0.5 / 48000), rel=1e-4))
            for late, words, d in (
                (delay(constant(K, "N/m") * X, samples=4800), {}, 0.1),
                (constant(K, "N/m") * X, {"delay": 0.2}, 0.2),
                (constant(K, "N/m") * first_order(X, 0.05), {}, 0.05),
            )
        ),
        *(  # with a smooth velocity
            (
                kelvin_voigt(X, 1000.0, 2.0, cutoff=100.0),
                {"fs": fs, "delay": delay},
                pytest.approx(want, rel=0.03),
            )
            for fs, delay, want in ((8000, 0, 0.31), (1000, 0, 0.83), (8000, 3e-3, 3.3))
        ),
        *(
            (force, {}, None)
            for force in (
                wall(X, 0.0),
                wall(X, hunt_crossley=1.0),
                constant(1.0, "V/m") * X,
                wall(X, Input("k", "N/m")),
                X * X * constant(1.0, "N/m^2"),
                constant(1.0, "N") * X / X,
            )
        ),
    ],
)
def test_what_is_told_of_a_scene(force, words, want):
    if isinstance(want, float):
        want = pytest.approx(want, rel=1e-6)
    assert needed(force, **words) == want


def show(scene, folder, *words):
    scene.save(folder / "a.json")
    return ran(["show", folder / "a.json", *words]).output


def test_show_warns_and_tells_it_as_data(tmp_path):
    force = wall(X, 1000.0)
    said = show(Scene({"F": force + constant(0.1, "N") * white_noise(1)}), tmp_path)
    assert "warning: F over x is passive only" in " ".join(said.split()) and "0.125 N·s/m" in said
    assert "warning" not in show(Scene({"F": X + constant(0.1, "m") * white_noise(1)}), tmp_path)
    (told,) = json.loads(show(Scene({"F": force}), tmp_path, "--json"))["passivity"]
    assert told == {"output": "F", "input": "x", "needed_damping": pytest.approx(0.125, rel=1e-6)}


@pytest.mark.parametrize(
    "words", [{"fs": 0.0}, {"fs": np.inf}, {"fs": 1e3, "delay": -1.0}, {"fs": 1e3, "delay": np.inf}]
)
def test_numbers_that_make_no_sense_are_refused(words):
    refused(BadValue, "needed_damping: ", needed_damping, lambda f: f + 0j, **words)
    if "delay" in words:
        refused(BadValue, "damping_of: delay", needed, wall(X, K), **words)


def test_a_response_that_is_not_finite_is_refused():
    def response(f):
        return np.where(f < 499.99, f, np.nan)

    refused(BadValue, "not finite at 500 Hz", needed_damping, response, 1000.0)
    assert needed_damping(lambda f: np.full(f.shape, -K + 0j), 8000) == 0.0


@pytest.mark.parametrize("stretch", [1000, 250])
def test_a_report_has_the_energy_of_each_force_over_its_own_position(monkeypatch, stretch):
    """And the damping of a torque in its own unit; a force of no motion has none."""
    monkeypatch.setattr(evidence, "AT_ONCE", stretch)
    x, y, angle = Input("x", "m"), Input("y", "m"), Input("angle")
    scene = Scene(
        {
            "force": spring(x, 1000.0),
            "torque": stimlib.constant(2.0, "N*m") * angle,
            "level": 2.0 * y,
            "tone": stimlib.constant(1.0, "N") * stimlib.blocks.oscillator(50.0),
            "bent": constant(5e3, "N/m^2") * y * y,
        }
    )
    t, still = np.arange(1000) / 1000, np.full(1000, 0.1)
    motion = {"x": stimlib.motion.minimum_jerk(), "y": 0.1 * np.sin(20 * t), "angle": still}
    made = stimlib.render(scene, motion, fs=1000, seconds=1.0)

    def given(force, place, late):
        # of straight motion, at 10 times a sample
        fine = np.interp(np.arange(9991) / 10, np.arange(1000), place)
        acting = np.r_[np.zeros(1 + round(10 * late)), np.repeat(made[force], 10)][:9991]
        most = -1e3 * np.cumsum(acting * np.diff(fine, prepend=fine[0])).min()
        return f"gave at most {most:.3g} mJ more than it had got"

    told = stimlib.verify(scene, motion, made).evidence.numbers
    assert told == [
        f"force over x: {given('force', motion['x'](t), 0)};"
        " passive in a device with 0.5 N·s/m, undelayed",
        "torque over angle: gave at most 0 mJ more than it had got;"
        " passive in a device with 0.001 kg·m²·s⁻¹, undelayed",
        f"bent over y: {given('bent', motion['y'], 0)}",
    ]
    # in a device: the force acts late, and its damping is what there is
    for damping, margin, other in ((0.4, 0.125, 62.5), (3.0, 0.938, 469)):
        device = stimlib.virtual.Device(0.1, damping, delay=0.0027)
        told = stimlib.verify(scene, motion, made, device=device).evidence.numbers
        assert told == [
            f"force over x: {given('force', motion['x'](t), 2.7)}, 2.7 ms late;"
            f" it needs 3.2 N·s/m and the device has {damping:.3g}: not passive in every hand,"
            f" which {margin} times its stiffness would just be",
            "torque over angle: gave at most 0 mJ more than it had got, 2.7 ms late;"
            f" it needs 0.0064 kg·m²·s⁻¹ and the device has {damping:.3g}: passive in every hand,"
            f" which {other} times its stiffness would just be",
            f"bent over y: {given('bent', motion['y'], 2.7)}, 2.7 ms late;"
            " its law gives no damping that it needs: try it in a closed loop",
            f"smallest margin of passivity: {margin}, force over x",
        ]


@pytest.mark.parametrize("stretch", [1000, 250])
def test_a_scene_that_is_active_on_purpose_is_judged_by_its_own_bound(monkeypatch, stretch):
    """A motor pushes with 1 N along 0.1 m, and half of it back, and says so or not."""
    monkeypatch.setattr(evidence, "AT_ONCE", stretch)
    x, t = Input("x", "m"), np.arange(1000) / 1000
    place = np.interp(t, [0.0, 0.5, 1.0], [0.0, 0.1, 0.05])
    push = constant(-1.0, "N") + 0.0 * spring(x, 1.0)
    for power, beyond in ((None, 100), (0.04, 80), (0.3, 0)):
        scene = Scene({"F": push if power is None else active(push, power)})
        made = stimlib.render(scene, {"x": place}, fs=1000, seconds=1.0)
        (told,) = stimlib.verify(scene, {"x": place}, made).evidence.numbers
        assert told.startswith("F over x: gave at most 100 mJ more")
        if power:
            assert (
                f"states to give {1e3 * power:.3g} mW on purpose, and gave {beyond:.3g} mJ" in told
            )
        proc = stimlib.compile(protect(scene, Safety(5.0, passivity=Passivity(0.01))), 1000)
        proc.set("sink_gain", 1.0, ramp=0.0)
        y = proc.process(place[None])[0]
        assert -np.cumsum(y[:-1] * np.diff(place)).min() <= (0.01 + (power or 0.0)) * (1 + 1e-9)
        if beyond == 0:
            assert (y == -1.0).all()


def test_the_damping_of_many_outputs_asks_each_for_its_own_inputs(monkeypatch):
    """With 64 fingers all pairs of them took 6 s."""
    asked = []
    monkeypatch.setattr(
        passivity, "response", lambda *given, **_: asked.append(given[4:6]) or np.ones(1)
    )
    scene = Scene({f"f{k}": spring(Input(f"x{k}", "m"), 10.0) for k in range(5)})
    damping_of(stimlib.compile(scene, 1000.0, "python"))
    assert asked == [(f"f{k}", f"x{k}") for k in range(5)]
