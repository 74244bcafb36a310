"""Velocity, impedances and gates against calculus."""

import numpy as np
import pytest
from laws import lawful, played, refuses

import stimlib
from stimlib import Input, Param, Scene, UnitError
from stimlib.blocks import first_order, hysteresis, kelvin_voigt, loading, spring, velocity
from stimlib.blocks.impedance import step_peak

X, U = Input("x", "m"), Input("u")
GATES = [(0.5, 0.25), (1.0, 0.01), (0.3, 0.29), (2.0, 1.0)]


@pytest.mark.parametrize("fs", [1000.0, 48000.0])
@pytest.mark.parametrize("cutoff", [5.0, 100.0, 400.0])
def test_a_steady_movement_has_its_velocity(fs, cutoff):
    n = int(fs * (0.02 + 6 / cutoff))
    y = played(velocity(X, cutoff), 0.03 + 0.2 * np.arange(n) / fs, fs=fs)
    assert y[-1] == pytest.approx(0.2, rel=1e-8)
    assert np.all(np.diff(y) >= -1e-12) and y.max() < 0.2 * (1 + 1e-9), "no overshoot"


@pytest.mark.parametrize("tau", [1e-6, 1e-3, 0.05, 3.0, 1e6])
def test_first_order_is_exact_for_straight_lines_between_samples(tau):
    for fs in (100.0, 8000.0):
        x = np.r_[0.0, np.random.default_rng(0).standard_normal(60)]
        lawful(first_order(U, tau), fs, u=x)
    proc = stimlib.compile(Scene({"y": first_order(U, tau)}), 8000.0, "python")
    assert abs(proc.response("y", "u", 0.0) - 1) < 1e-15, "a pole next to 1 keeps its digits"


@pytest.mark.parametrize("fs", [1000.0, 8000.0])
def test_a_kelvin_voigt_element_is_k_plus_i_w_b_within_its_stated_error(fs):
    """From 0.1 Hz to a tenth of the rate, for parts of equal size and 100 times one
    another.
    """
    for f in np.geomspace(0.1, fs / 10, 13):
        w = 2 * np.pi * f
        for k, damping in ((1.0, 1 / w), (100.0, 1 / w), (1.0, 100 / w)):
            proc = stimlib.compile(Scene({"f": kelvin_voigt(X, k, damping)}), fs, "python")
            # half a sample later
            got = proc.response("f", "x", f) * np.exp(0.5j * w / fs)
            assert -((w / fs) ** 2) / 8 - 1e-12 <= got.real / k - 1 <= 1e-12
            assert -((w / fs) ** 2) / 24 - 1e-12 <= got.imag / (w * damping) - 1 <= 1e-12


def test_a_kelvin_voigt_element_gives_the_mean_force_of_straight_motion():
    """Against the integral of k x + b v over each sample; a hand that was always at 20
    mm begins with k x alone.
    """
    x = 0.02 + np.r_[0.0, np.random.default_rng(0).standard_normal(200).cumsum() * 1e-5]
    force = played(kelvin_voigt(X, Param("k", 300.0, "N/m"), Param("b", 12.0, "N*s/m")), x)
    want = 300.0 * (x[1:] + x[:-1]) / 2 + 12.0 * np.diff(x) * 1000
    np.testing.assert_allclose(force, np.r_[300.0 * x[0], want], rtol=1e-14)


def test_spring_and_damper():
    fs, k, d = 8000.0, 300.0, 12.0
    smooth = kelvin_voigt(X, k, Param("b", d, "N*s/m"), cutoff=200.0)
    proc = stimlib.compile(Scene({"f": smooth, "s": spring(X, Param("k", k, "N/m"))}), fs)
    x = 0.01 + 0.05 * np.arange(8000) / fs
    f, s = proc.process(x[None])
    np.testing.assert_array_equal(s, k * x)
    np.testing.assert_allclose(f[-100:], k * x[-100:] + d * 0.05, rtol=1e-9)
    w = 2 * np.pi * np.array([0.5, 2.0])
    late = np.exp(-1j * w * proc.latency["f", "x"][1] / fs)  # of the velocity; else k_C = k + i w b
    got = proc.response("f", "x", w / 2 / np.pi)
    np.testing.assert_allclose(got, k + 1j * w * d * late, rtol=1e-4)
    assert proc.units == {"x": "m", "b": "N*s/m", "k": "N/m", "f": "N", "s": "N"}


def test_a_spring_of_a_number_is_an_error_of_units():
    refuses(lambda: spring(2000.0, X), r"^spring: k .*not a force", UnitError)


# Gates --------------------------------------------------------------------------------
@pytest.mark.parametrize("slow", [1, 9, 200])
@pytest.mark.parametrize("gate", [loading, hysteresis])
def test_it_opens_above_on_and_closes_at_off(gate, slow):
    """And at neither threshold itself."""
    for on, off in GATES if gate is loading else [(2.0, 1.0)]:
        steps = np.random.default_rng(slow).choice([-1.0, 0.0, off, on, 0.26, 0.4, 1.1, 2.5], 4000)
        lawful(gate(X, on, off), 1000, x=np.repeat(steps, slow)[:4000])


def test_nan_closes_it():
    y = played(loading(U, 0.5, 0.1), [1.0, 0.2, np.nan, 0.2, 1.0, np.inf, -np.inf])
    np.testing.assert_array_equal(y, [1, 1, 0, 0, 1, 1, 0])


@pytest.mark.parametrize(
    ("fs", "cutoff"), [(8000.0, 100.0), (8000.0, 20.0), (48000.0, 100.0), (1000.0, 300.0)]
)
def test_the_default_is_twice_the_answer_to_one_encoder_step(fs, cutoff):
    """off = 2 q max|h| with h the answer of velocity to one step; on = 2 off."""
    answer = played(velocity(X, cutoff), np.arange(int(fs / cutoff) * 4) > 0, fs=fs)
    p, _ = loading(velocity(X, cutoff), resolution=2e-5).design(fs)
    assert p.off == pytest.approx(4e-5 * np.abs(answer).max(), rel=1e-3) and p.on == 2 * p.off


@pytest.mark.parametrize("g", 10.0 ** np.arange(-14.0, -4.0, 3.0))
def test_the_default_of_any_cutoff(g):
    """Far below the sample rate the answer is fs g (t g) exp(-t g), which has its top
    at t g = 1.
    """
    assert step_peak(1000.0 * g / (2 * np.pi), 1000.0) == pytest.approx(1000.0 * g / np.e, rel=1e-4)
