"""Friction that ultrasound reduces: the envelope of the resonance, the force on
slippery and other parts, and what its law sees.
"""

import numpy as np
import pytest
import scipy
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Scene
from stimlib.blocks import first_order
from stimlib.motion.generators import constant_speed
from stimlib.scenes import ultrasonic_friction


def sliding(seconds=1.0, **words):
    scene = ultrasonic_friction(**words)
    return scene, stimlib.render(scene, {"x": constant_speed(0.1, 0.1)}, 8000, seconds)


def test_the_amplitude_is_the_envelope_of_the_resonance():
    """A mass on a spring at its resonance, sample by sample of the vibration."""
    freq, q = 30e3, 100.0
    w, t = 2 * np.pi * freq, np.arange(200 * 64) / (64 * freq)
    on = 1.0 * (t < 100 / freq)
    system = [[-w / q, -w * w], [1, 0]], [[w * w], [0]], [[0, 1]], 0
    _, _, state = scipy.signal.lsim(system, np.cos(w * t) * on, t)
    envelope = np.hypot(state[:, 1], state[:, 0] / w) / q  # of 1 at rest
    scene = Scene({"a": first_order(Input("v"), q / (np.pi * freq))})
    got = stimlib.compile(scene, 64 * freq, "python").process(on[None])[0]
    assert np.abs(got - envelope).max() < 1.5 / q


def test_the_force_is_that_of_the_load_that_is_left():
    """By hand: e = 0.15, 2.837 % of 101325 Pa on 1 cm^2 carry 0.28746 N of 0.5 N."""
    _, r = sliding()
    u = 6 * r.t  # place in bumps, at 0.1 m/s
    inside = (u % 1 > 0.2) & (u % 1 < 0.45), (u % 1 > 0.7) & (u > 0.5)
    slippery, other = (np.unique(r["force"][k].round(9)) for k in inside)
    assert slippery == pytest.approx([0.8 * 0.21254], abs=1e-5)
    assert other == pytest.approx([0.8 * 0.5], abs=1e-12)


@pytest.mark.parametrize("q", [100.0, 1000.0])
def test_a_plate_of_high_quality_answers_late(q):
    _, r = sliding(q=q)
    at = np.argmax(6 * r.t >= 1.0)  # where the second slippery part begins
    late = np.argmax(r["force"][at - 1 : at + 800] < 0.8 * 0.35) / 8000
    # the load falls to 0.35 N where e^2 is 0.0118, 72 % of the way
    assert late == pytest.approx(1.28 * q / (np.pi * 30e3), abs=4e-4)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ({"gap": 0.0}, "gap = 0.0"),
        ({"freq": 100.0}, "squeeze number .* below 10"),
        ({"gap": 40e-6}, "squeeze number 8.22"),
        ({"gap": 36.27e-6}, "squeeze number 9.99"),
        ({"mu": 0.0}, "mu = 0.0"),
        ({"amplitude": 101.0}, "as far as gap"),
        ({"amplitude": -101.0}, "as far as gap"),
        ({"gap": 2.0**-17, "per_volt": 2.0**-20, "amplitude": 8.0}, "as far as gap"),
        ({"duty": 1.5}, "duty"),
    ],
)
def test_a_scene_that_makes_no_sense_is_refused(words, text):
    refused(BadValue, f"ultrasonic_friction: .*{text}", ultrasonic_friction, **words)
    ultrasonic_friction(gap=36.25e-6)
