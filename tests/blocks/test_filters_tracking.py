"""The tracker against the continuous filter it claims to be, its latency, and what
jumps do to it.
"""

import numpy as np
import pytest
from laws import assert_same, bits, float_words, lawful

import stimlib
from stimlib import Input, Param, Scene
from stimlib.blocks.filters import track, track_velocity
from stimlib.errors import BadValue, SceneError

FS, X = 8000.0, Input("x", "m")


def both(fs=FS, target="numba", contact=False, **kw):
    """Position and velocity of one tracker."""
    if contact:
        kw["contact"] = Input("contact")
    return stimlib.compile(Scene({"y": track(X, **kw), "v": track_velocity(X, **kw)}), fs, target)


def step_response(q, n):
    """1 - (1 + w t) exp(-w t) at the end of sample n."""
    a = q * (np.arange(n) + 1)
    return -np.expm1(-a) - a * np.exp(-a)


def reports(rate, fs, seconds, speed, jitter=0.0, seed=0):
    """A straight movement at this speed, reported at a rate with jitter, and held
    between reports.
    """
    n = int(fs * seconds)
    at = np.arange(int(rate * seconds) + 2) / rate
    at[1:] += jitter / rate * np.random.default_rng(seed).uniform(-0.5, 0.5, at.size - 1)
    seen = np.maximum(np.searchsorted(at, np.arange(n) / fs, side="right") - 1, 0)
    return speed * at[seen]


# What it is ---------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("bandwidth", "fs"),
    [(20.0, 8000.0), (10.0, 48000.0), (300.0, 1000.0), (0.01, 48000.0), (1e-4, 8000.0)],
)
def test_a_held_step_gives_the_continuous_answer(bandwidth, fs):
    n = 200_000
    proc = both(fs, bandwidth=bandwidth, max_jump=None)
    x = np.full((1, n), 0.01)
    x[0, :5] = 0.0
    y, v = proc.process(x)
    q = 2 * np.pi * bandwidth / fs
    wanted = 0.01 * step_response(q, n - 5)
    np.testing.assert_allclose(y[5:], wanted, rtol=0, atol=1e-14)
    assert not y[:5].any() and not v[:5].any()
    # the rate keeps its relative accuracy however small q is: E((1+a) - (1+a+q) e^-q),
    # a = q n, in terms without cancellation
    a = q * np.arange(100)
    moved = np.exp(-a) * (-np.expm1(-q) * (1 + a) - q * np.exp(-q))
    if q > 1e-3:
        np.testing.assert_allclose(v[5:105], 0.01 * fs * moved, rtol=1e-11)
    else:  # w^2 t e^(-w t), in the middle of the sample
        t = np.arange(100) + 0.5
        np.testing.assert_allclose(v[5:105], 0.01 * fs * q * q * t * np.exp(-q * t), rtol=1e-4)


@pytest.mark.parametrize("bandwidth", [0.5, 20.0, 3000.0])
def test_a_position_held_is_reached_exactly(bandwidth):
    proc = both(bandwidth=bandwidth)
    rng = np.random.default_rng(1)
    proc.process(0.02 + 0.004 * rng.standard_normal((1, 3000)))
    for _ in range(8):
        y, v = proc.process(np.full((1, int(40 * FS / bandwidth)), 1 / 30))
    assert y[-1] == 1 / 30 and v[-1] == 0.0


@pytest.mark.parametrize(("bandwidth", "fs"), [(5.0, 1000.0), (20.0, 8000.0), (200.0, 1000.0)])
def test_a_ramp_is_followed_at_its_speed_behind_the_stated_latency(bandwidth, fs):
    proc = both(fs, bandwidth=bandwidth)
    n = int(9 * fs / bandwidth)
    y, v = proc.process(0.1 * np.arange(n)[None] / fs)
    assert v[-1] == pytest.approx(0.1, rel=1e-12)
    late = proc.latency["y", "x"][0] / fs
    assert 0.1 * (n - 1) / fs - y[-1] == pytest.approx(0.1 * late, rel=1e-9)
    q = 2 * np.pi * bandwidth / fs
    assert late * fs == pytest.approx(2 / q - 0.5, abs=q / 50 + 1e-9)
    assert proc.latency["v", "x"][0] == pytest.approx(late * fs + 0.5)


def test_a_tracker_with_live_contact_has_no_response():
    with pytest.raises(SceneError, match="not linear"):
        both(contact=True).response("y", "contact", np.array([1.0]))


@pytest.mark.parametrize(("rate", "bandwidth"), [(70.0, 20.0), (70.0, 10.0), (125.0, 20.0)])
def test_the_ripple_of_reports_is_as_documented(rate, bandwidth):
    v = both(bandwidth=bandwidth).process(reports(rate, FS, 3.0, 0.1)[None])[1, int(2 * FS) :]
    assert 0.7 < np.abs(v / 0.1 - 1).max() / (3.3 * (bandwidth / rate) ** 2) < 1


def test_jittered_reports_make_no_spikes():
    x = reports(70.0, FS, 3.0, 0.1, jitter=0.5)
    assert np.diff(x).max() * FS > 80 * 0.1  # what holding and differencing feels
    assert np.abs(both(bandwidth=10.0).process(x[None])[1, int(FS) :] - 0.1).max() < 0.03


# Contact and jumps --------------------------------------------------------------------
def test_contact():
    """Off contact the position is held, from 0 at first, and the state is at rest; each
    contact begins where it is.
    """
    proc = both(contact=True, max_jump=None)
    y, v = proc.process(
        np.array([[0.01, 0.02, 0.5, 0.01, 0.02, 0.3], [0.0, 1.0, 0.0, 1.0, 1.0, 0.0]])
    )
    assert y[:4].tolist() == [0.0, 0.02, 0.02, 0.01] and not v[:4].any() and y[4] == y[5]
    words = set(proc.state[float_words(proc)].view(np.float64))
    assert words == {0.0, 1.0, 0.02, y[5], -1.0}, "v, e and h; cold; last; y; of a guard"


@pytest.mark.parametrize("make", [track, track_velocity])
@pytest.mark.parametrize("max_jump", [0.05, None])
def test_a_jump_invents_no_movement(make, max_jump):
    """From 0.05 m on a step is a jump, if a limit is set; 1 nm less is a movement."""
    steps = np.repeat([0.07, 0.03, 0.08 - 1e-9, 0.13, 1e6], [50, 50, 200, 50, 50])
    x = np.concatenate([np.linspace(0.0, 0.01, 100), steps])
    for way in (x, -x):
        lawful(make(X, max_jump=max_jump), FS, x=way)


# Building -----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "name", "unit"), [(track, "Track", "m"), (track_velocity, "TrackVelocity", "m/s")]
)
def test_units_and_what_is_not_given(make, name, unit):
    assert str(make(X).dim) == unit
    assert repr(make(X)) == f"{name}(Input('x'), Const(1.0), bandwidth=20.0, max_jump=0.05)"


@pytest.mark.parametrize("make", [track, track_velocity])
def test_errors(make):
    for kw in (
        {"bandwidth": 0.0},
        {"bandwidth": -1.0},
        {"max_jump": 0.0},
        {"max_jump": -0.1},
        {"bandwidth": float("nan")},
    ):
        with pytest.raises(BadValue, match=next(iter(kw))):
            make(X, **kw)
    with pytest.raises(BadValue, match="cannot be the signal"):
        make(X, bandwidth=Param("b", 20.0))
    with pytest.raises(BadValue, match="does not fit below fs/2"):
        stimlib.compile(Scene({"y": make(X, bandwidth=500.0)}), 1000)


def test_zeros_keep_no_sign_of_their_own():
    assert_same(bits(both().process(np.full((1, 30), -0.0))), bits(np.zeros((2, 30))))
