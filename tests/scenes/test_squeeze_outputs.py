"""The squeeze scene's other outputs: forces the motors can bear, and the current they
take.
"""

import numpy as np
import pytest

import stimlib
from stimlib.blocks.contact import PLACEHOLDER_GAMMA
from stimlib.motion.generators import minimum_jerk, ramp_and_hold
from stimlib.scenes import squeeze

FS = 8000


def test_current_is_force_over_motor_constant_and_geometry():
    from scipy.interpolate import PchipInterpolator

    y = stimlib.render(
        squeeze(fingers=1, motor_constant=9.0), {"x1": minimum_jerk(depth=0.03)}, FS, 1.0
    )
    gamma = PchipInterpolator(*PLACEHOLDER_GAMMA)(minimum_jerk(depth=0.03)(y.t))
    np.testing.assert_allclose(y["current1"], y["force1"] / (9.0 * gamma), rtol=1e-12, atol=1e-15)


def test_outputs_added_change_no_bit_of_the_force():
    motion = {"x1": minimum_jerk()}
    plain = stimlib.render(squeeze(fingers=1), motion, FS, 1.0)["force1"]
    assert np.array_equal(
        plain, stimlib.render(squeeze(fingers=1, motor_constant=9.0), motion, FS, 1.0)["force1"]
    )
    assert np.array_equal(
        plain,
        stimlib.render(squeeze(fingers=1, limits=True), motion, FS, 0.5)["force1"].tolist()
        + plain[4000:].tolist(),
    )


def test_limits_hold_peak_and_static_force():
    hard = ramp_and_hold(0.06, 0.3)  # 120 N held
    free = stimlib.render(squeeze(fingers=1), {"x1": hard}, FS, 30.0)["force1"]
    held = stimlib.render(squeeze(fingers=1, limits=True), {"x1": hard}, FS, 30.0)["force1"]
    assert free.max() == pytest.approx(120.0, abs=0.5)
    assert np.abs(held).max() <= 100.0
    assert held[-1] < 37.0 and np.abs(np.diff(held[FS:])).max() < 0.05  # falls without a click


def test_a_scene_with_limits_keeps_its_law():
    """Held in tests/checks/test_scene_laws.py."""
    assert [p.law for s in (squeeze(), squeeze(limits=True)) for p in s.parts] == [
        "squeeze",
        "squeeze",
    ]
