"""Limits that hold for any force, and the two formulas of the UGrip paper around the
motor.
"""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from laws import assert_same, played

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib.blocks import differentiator, pink_noise
from stimlib.blocks.contact import (
    PLACEHOLDER_GAMMA,
    force_limit,
    motor_current,
    skin_drive,
    static_limit,
)
from stimlib.errors import BadValue, UnitError

F, X = Input("force", "N"), Input("x", "m")
L = 37.0


def limited(fs=1000.0, target="numba", **kw):
    return stimlib.compile(Scene({"F": static_limit(F, **kw)}), fs, target)


def mean_square(y, fs, tau=10.0):
    """One-pole mean of y^2, from 0; the definition, in plain Python."""
    a, m, out = -np.expm1(-1 / (tau * fs)), 0.0, np.empty(y.size)
    for n, v in enumerate(y):
        m += a * (v * v - m)
        out[n] = m
    return out


def forces(kind, n, fs, size, rng):
    t = np.arange(n) / fs
    return size * {
        "grip": np.ones(n),
        "square": np.sign(np.sin(2 * np.pi * 3 * t) + 1e-9),
        "fast square": 1 - 2.0 * (np.arange(n) % 2),
        "noise": rng.standard_normal(n),
        "bursts": np.repeat(rng.choice([0.0, 0.0, 1.0, -3.0], n // 500 + 1), 500)[:n],
        "spikes": np.where(rng.uniform(size=n) < 0.01, rng.standard_cauchy(n), 0.0),
        "ramp": t / t[-1],
    }[kind]  # fmt: skip


KINDS = ["grip", "square", "fast square", "noise", "bursts", "spikes", "ramp"]


# The static limit ---------------------------------------------------------------------
@given(
    st.sampled_from(KINDS),
    st.floats(-1, 7).map(lambda e: 10.0**e),
    st.sampled_from([10.0, 1000.0, 8000.0]),
    st.sampled_from([0.05, 1.0, 10.0]),
    st.integers(0, 2**32),
)
def test_the_mean_square_never_exceeds_that_of_the_limit(kind, size, fs, tau, seed):
    x = forces(kind, 4000, fs, size, np.random.default_rng(seed))
    y = limited(fs, tau=tau).process(x[None])[0]
    assert mean_square(y, fs, tau).max() <= L**2 * (1 + 1e-12)
    assert np.all(np.abs(y) <= np.abs(x)) and np.all(y * x >= 0), (
        "only ever weaker, never turned around"
    )


@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=60),
    st.sampled_from([0.5, 20.0, 8000.0]),
)
def test_the_bound_holds_for_any_finite_numbers(values, fs):
    x = np.repeat(np.array(values), 5)
    y = limited(fs).process(x[None])[0]
    assert np.isfinite(y).all() and mean_square(y, fs).max() <= L**2 * (1 + 1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [90.0, 100.0])
def test_five_minutes(kind, size):
    fs = 1000.0
    scene = Scene({"F": static_limit(force_limit(F))})
    x = forces(kind, 300_000, fs, size, np.random.default_rng(1))
    y = stimlib.compile(scene, fs).process(x[None])[0]
    assert mean_square(y, fs).max() <= L**2
    assert np.abs(y).max() <= 100.0
    before = np.clip(x, -100, 100)
    gain = np.where(before == 0, np.nan, y / np.where(before == 0, 1, before))
    slew = np.nanmax(np.abs(np.diff(gain))) * fs
    assert slew <= 100.0**2 / (10.0 * 0.19 * L**2) * (1 + 1e-6), "no click"


@pytest.mark.parametrize(
    ("held", "wanted"), [(90.0, 35.6), (100.0, 35.7), (36.0, 33.6), (33.0, 33.0)]
)
def test_a_grip_settles_where_it_is_said_to(held, wanted):
    y = limited().process(np.full((1, 200_000), held))[0]
    G = y[-1] / held
    assert y[-1] == pytest.approx(wanted, abs=0.05)
    if held > 0.9 * L:
        assert (G * held) ** 2 + 0.19 * L**2 * G == pytest.approx(L**2, rel=1e-9)
        first = np.argmax(y < held)
        assert first / 1000 == pytest.approx(-10 * np.log(1 - 0.81 * L**2 / held**2), abs=2e-3)
    assert np.diff(y).max() <= 0


@given(
    st.sampled_from(KINDS),
    st.floats(-3, 4).map(lambda e: 10.0**e),
    st.sampled_from([0.02, 1.0, 1000.0]),
    st.integers(0, 2**32),
)
def test_what_stays_below_the_knee_passes_bit_for_bit(kind, size, fs, seed):
    x = forces(kind, 3000, fs, size, np.random.default_rng(seed))
    a = -np.expm1(-0.1 / fs)
    cap = L * np.sqrt(0.81 + 0.19 / a) * (1 - 1e-12)
    x = np.clip(x, -cap, cap)
    above = mean_square(x, fs) > 0.81 * L**2 * (1 - 1e-12)
    n = int(np.argmax(above)) if above.any() else x.size
    y = limited(fs).process(x[None])[0]
    assert_same(y[:n], x[:n])


# The peak limit -----------------------------------------------------------------------
def test_the_peak_limit():
    proc = stimlib.compile(Scene({"F": force_limit(F, 100.0)}), 1000)
    x = np.array([[0.0, -0.0, 99.9, 100.0, 100.1, -1e300, 1e300, -100.0, 5e-324]])
    assert_same(proc.process(x), np.clip(x, -100.0, 100.0))
    assert proc.units["F"] == "N"


# Skin and motor -----------------------------------------------------------------------
def test_skin_drive_is_equation_1():
    dp = Input("dp", "N/s")
    scene = Scene(
        {
            "number": skin_drive(dp, 0.2, 1.6),
            "live": skin_drive(dp, Param("m", 0.2, "kg"), Param("B", 1.6, "N*s/m")),
        }
    )
    proc = stimlib.compile(scene, 1000)
    y = proc.process(np.array([[-3.0, 0.0, 8.0]]))
    np.testing.assert_allclose(y, np.array([[3.0, 0.0, -8.0]] * 2) * 0.2 / 1.6, rtol=1e-15)
    assert proc.units["number"] == proc.units["live"] == "N"
    proc.set("m", 0.4, ramp=0.0)
    np.testing.assert_allclose(proc.process(np.array([[8.0]]))[:, 0], [-1.0, -2.0], rtol=1e-15)


def test_skin_drive_lets_the_skin_feel_the_pink_force():
    """Through inertia and damper, F/(m s^2) and -B s, the force p comes back."""
    p = constant(1.0, "N") * pink_noise(1.0, seed=1, f_low=10.0)
    proc = stimlib.compile(
        Scene({"p": p, "F": skin_drive(differentiator(p, 1000.0), 0.3, 1.5)}), 8000, "python"
    )
    f = np.linspace(20, 900, 50)
    source = next(iter(proc.program.noises))
    s = 2j * np.pi * f
    skin = -1.5 * s * proc.response("F", source, f) / (0.3 * s**2)
    late = np.exp(-s * 64 / 8000)
    np.testing.assert_allclose(skin, proc.response("p", source, f) * late, rtol=1e-5)


@pytest.mark.parametrize("kind", ["linear", "pchip"])
def test_the_current_makes_the_force(kind):
    knots, gamma = [0.0, 0.01, 0.025, 0.04], [0.5, 0.9, 1.0, 0.2]
    proc = stimlib.compile(Scene({"I": motor_current(F, X, 12.5, (knots, gamma), kind)}), 8000)
    assert proc.units["I"] == "A"
    x = np.array([-1.0, *knots, 1.0])
    force = np.array([10.0, -20.0, 30.0, 40.0, 0.0, 60.0])
    current = proc.process(np.stack([force if name == "force" else x for name in proc.inputs]))[0]
    np.testing.assert_allclose(12.5 * current * np.array([0.5, *gamma, 0.2]), force, rtol=1e-14)


@given(st.lists(st.floats(1e-6, 1.0), min_size=2, max_size=8), st.floats(-0.01, 0.05))
def test_gamma_never_reaches_zero(gamma, x):
    knots = np.linspace(0, 0.04, len(gamma))
    for kind in ("linear", "pchip"):
        proc = stimlib.compile(
            Scene({"I": motor_current(constant(1.0, "N"), X, 1.0, (knots, gamma), kind)}),
            1000,
            "python",
        )
        current = proc.process(np.array([[x]]))[0, 0]
        assert 1 / max(gamma) * (1 - 1e-9) <= current <= 1 / min(gamma) * (1 + 1e-9)


def test_the_placeholder_is_a_proportion_over_the_travel():
    assert PLACEHOLDER_GAMMA.x[0] == 0.0 and PLACEHOLDER_GAMMA.x[-1] == 0.04
    assert all(0 < g <= 1 for g in PLACEHOLDER_GAMMA.gamma)
    assert (
        played(motor_current(F, X, Param("nB", 10.0, "N/A")), {"force": [37.0], "x": [0.02]}) == 3.7
    )


# Errors -------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "error", "match"),
    [
        (lambda: skin_drive(F, 0.2, 1.5), UnitError, "dp"),
        (lambda: skin_drive(Input("dp", "N/s"), constant(0.2, "m"), 1.5), UnitError, "m Const"),
        (lambda: skin_drive(Input("dp", "N/s"), 0.2, Param("B", 1.5)), UnitError, "B Param"),
        (lambda: force_limit(X), UnitError, "force_limit: force"),
        (lambda: force_limit(F, Param("p", 1.0)), UnitError, "peak"),
        (lambda: static_limit(X), UnitError, "static_limit: force"),
        (lambda: motor_current(X, X, 10.0), UnitError, "motor_current: force"),
        (lambda: motor_current(F, F, 10.0), UnitError, "motor_current: x"),
        (lambda: motor_current(F, X, constant(10.0, "N")), UnitError, "motor_constant"),
        (lambda: skin_drive(Input("dp", "N/s"), 0.0, 1.5), BadValue, "m = 0"),
        (lambda: skin_drive(Input("dp", "N/s"), 0.2, -1.5), BadValue, "B = -1.5"),
        (lambda: force_limit(F, 0.0), BadValue, "peak = 0"),
        (lambda: static_limit(F, limit=0.0), BadValue, "limit"),
        (lambda: static_limit(F, tau=-1.0), BadValue, "tau"),
        (lambda: static_limit(F, limit=Param("L", 37.0, "N")), BadValue, "cannot be the signal"),
        (lambda: motor_current(F, X, -10.0), BadValue, "motor_constant = -10"),
        (lambda: motor_current(F, X, 10.0, ([0.0, 1.0], [0.5, -2.0])), BadValue, r"\[1\] = -2"),
        (
            lambda: motor_current(F, X, 10.0, ([0.0, 1.0], [0.5, np.nan])),
            BadValue,
            r"Gamma\[1\] = nan must be above 0",
        ),
        (lambda: motor_current(F, X, 10.0, ([0.0, 0.0], [0.5, 0.5])), BadValue, "rise"),
        (lambda: motor_current(F, X, 10.0, ([0.0, 1.0, 2.0], [0.5, 0.5])), BadValue, "one length"),
        (
            lambda: motor_current(F, X, 10.0, ([0.0, 1.0],)),
            BadValue,
            "geometry = .* must be a tuple",
        ),
        (lambda: motor_current(F, X, 10.0, kind="cubic"), BadValue, "pchip or linear"),
    ],
)
def test_what_makes_no_sense_is_refused(make, error, match):
    with pytest.raises(error, match=match):
        make()
