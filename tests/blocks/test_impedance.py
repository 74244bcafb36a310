"""Velocity and impedances against calculus."""

import numpy as np
import pytest
from laws import lawful, played

import stimlib
from stimlib import Input, Param, Scene
from stimlib.blocks import first_order, hysteresis, kelvin_voigt, spring, velocity
from stimlib.errors import UnitError

x = Input("x", "m")


@pytest.mark.parametrize("fs", [1000.0, 8000.0, 48000.0])
@pytest.mark.parametrize("cutoff", [5.0, 100.0, 400.0])
def test_a_steady_movement_has_its_velocity(fs, cutoff):
    n = int(fs * (0.02 + 6 / cutoff))
    y = stimlib.compile(Scene({"v": velocity(x, cutoff)}), fs).process(
        0.03 + 0.2 * np.arange(n)[None] / fs
    )[0]
    assert y[-1] == pytest.approx(0.2, rel=1e-8)
    assert np.all(np.diff(y) >= -1e-12) and y.max() < 0.2 * (1 + 1e-9), "no overshoot"


def test_the_first_position_is_no_jump():
    y = stimlib.compile(Scene({"v": velocity(x)}), 8000).process(np.full((1, 1000), 0.04))
    assert not y.any()


def test_off_contact_the_velocity_is_0_and_re_contact_is_no_jump():
    u = np.r_[0.1 * np.arange(800) / 8000, np.full(100, np.nan), np.full(300, 5.0)]
    on = np.r_[np.ones(800), np.zeros(100), np.ones(300)]
    y = played(
        velocity(x, 100.0, Input("touch")), {"x": np.nan_to_num(u, nan=2.0), "touch": on}, fs=8000.0
    )
    assert y[799] == pytest.approx(0.1, rel=1e-6)
    assert not y[800:].any()


@pytest.mark.parametrize("contact", [0.0, -1.0])
def test_without_any_contact_the_velocity_is_0(contact):
    for target in ("numba", "python"):
        proc = stimlib.compile(Scene({"v": velocity(x, 100.0, contact=contact)}), 1000, target)
        assert not proc.process(np.arange(9.0)[None]).any()


@pytest.mark.parametrize("tau", [1e-6, 1e-3, 0.05, 3.0, 1e6])
@pytest.mark.parametrize("fs", [100.0, 8000.0])
def test_first_order_is_exact_for_straight_lines_between_samples(tau, fs):
    lawful(
        first_order(Input("u"), tau), fs, u=np.r_[0.0, np.random.default_rng(0).standard_normal(60)]
    )


def test_a_slow_first_order_has_gain_1_at_0_hz():
    """Its leak of 1.25e-10 a sample has all digits; a pole next to 1 in one word was
    1e-7 off.
    """
    proc = stimlib.compile(Scene({"y": first_order(Input("u"), 1e6)}), 8000.0, "python")
    assert abs(proc.response("y", "u", np.array([0.0]))[0] - 1) < 1e-15


@pytest.mark.parametrize("fs", [1000.0, 8000.0])
def test_a_kelvin_voigt_element_is_k_plus_i_w_b_within_its_stated_error(fs):
    """From 0.1 Hz to a tenth of the rate, for parts of equal size and 100 times one
    another.
    """
    for f in np.geomspace(0.1, fs / 10, 13):
        w = 2 * np.pi * f
        for k, damping in ((1.0, 1 / w), (100.0, 1 / w), (1.0, 100 / w)):
            proc = stimlib.compile(Scene({"f": kelvin_voigt(x, k, damping)}), fs, "python")
            # half a sample later
            got = proc.response("f", "x", np.array([f]))[0] * np.exp(0.5j * w / fs)
            assert -((w / fs) ** 2) / 8 - 1e-12 <= got.real / k - 1 <= 1e-12
            assert -((w / fs) ** 2) / 24 - 1e-12 <= got.imag / (w * damping) - 1 <= 1e-12


def test_a_kelvin_voigt_element_gives_the_mean_force_of_straight_motion():
    """Against the integral of k x + b v over each sample; a hand that was always at 20
    mm begins with k x alone.
    """
    fs, k, damping = 1000.0, 300.0, 12.0
    u = 0.02 + np.r_[0.0, np.random.default_rng(0).standard_normal(200).cumsum() * 1e-5]
    force = stimlib.compile(
        Scene({"f": kelvin_voigt(x, Param("k", k, "N/m"), Param("b", damping, "N*s/m"))}), fs
    ).process(u[None])[0]
    assert force[0] == k * u[0]
    np.testing.assert_allclose(
        force[1:], k * (u[1:] + u[:-1]) / 2 + damping * np.diff(u) * fs, rtol=1e-14
    )


def test_spring_and_damper():
    fs, k, d = 8000.0, 300.0, 12.0
    scene = Scene(
        {
            "f": kelvin_voigt(x, k, Param("b", d, "N*s/m"), cutoff=200.0),
            "s": spring(x, Param("k", k, "N/m")),
        }
    )
    proc = stimlib.compile(scene, fs)
    t = np.arange(8000) / fs
    u = 0.01 + 0.05 * t
    f, s = proc.process(u[None])
    np.testing.assert_array_equal(s, k * u)
    np.testing.assert_allclose(f[-100:], k * u[-100:] + d * 0.05, rtol=1e-9)
    w = 2 * np.pi * np.array([0.5, 2.0])
    late = np.exp(-1j * w * proc.latency["f", "x"][1] / fs)  # of the velocity; else k_C = k + i w b
    np.testing.assert_allclose(
        proc.response("f", "x", w / 2 / np.pi), k + 1j * w * d * late, rtol=1e-4
    )
    assert proc.units == {"x": "m", "b": "N*s/m", "k": "N/m", "f": "N", "s": "N"}


def test_a_spring_of_a_number_is_an_error_of_units():
    with pytest.raises(
        UnitError, match=r"^spring: k \[m\] times Const\(2000.0\) \[1\] is \[m\], not a force"
    ):
        spring(2000.0, Input("x", "m"))


@pytest.mark.parametrize("target", ["python", "numba"])
def test_a_hysteresis_is_open_above_its_thresholds_and_not_at_them(target):
    x = np.repeat([1.0, 2.0, 2.1, 1.5, 1.0, 1.5, 2.0], 64)  # a tile each
    proc = stimlib.compile(Scene({"y": hysteresis(Input("x"), on=2.0, off=1.0)}), 1000, target)
    want = np.repeat([0.0, 0, 1, 1, 0, 0, 0], 64)
    np.testing.assert_array_equal(proc.process(x[None])[0], want)
