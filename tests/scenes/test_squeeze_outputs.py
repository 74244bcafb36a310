"""The squeeze scene's other outputs: forces the motors can bear, and the current they
take.
"""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

import stimlib
from stimlib.blocks.contact import PLACEHOLDER_GAMMA
from stimlib.motion.generators import minimum_jerk, ramp_and_hold
from stimlib.scenes import squeeze

FS = 8000


def test_current_is_force_over_motor_constant_and_geometry():
    hand = minimum_jerk(depth=0.03)
    y = stimlib.render(squeeze(fingers=1, motor_constant=9.0), {"x1": hand}, FS, 1.0)
    gamma = PchipInterpolator(*PLACEHOLDER_GAMMA)(hand(y.t))
    np.testing.assert_allclose(y["current1"], y["force1"] / (9.0 * gamma), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("words", "n"), [({"motor_constant": 9.0}, 8000), ({"limits": True}, 4000)]
)
def test_outputs_added_change_no_bit_of_the_force(words, n):
    plain, other = (
        stimlib.render(squeeze(fingers=1, **more), {"x1": minimum_jerk()}, FS, n / FS)["force1"]
        for more in ({}, words)
    )
    np.testing.assert_array_equal(plain, other)


def test_limits_hold_peak_and_static_force():
    hard = ramp_and_hold(0.06, 0.3)  # 120 N held
    free = stimlib.render(squeeze(fingers=1), {"x1": hard}, FS, 30.0)["force1"]
    held = stimlib.render(squeeze(fingers=1, limits=True), {"x1": hard}, FS, 30.0)["force1"]
    assert free.max() == pytest.approx(120.0, abs=0.5)
    assert np.abs(held).max() <= 100.0
    assert held[-1] < 37.0 and np.abs(np.diff(held[FS:])).max() < 0.05  # falls without a click
