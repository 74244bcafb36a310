"""The tracker against the continuous filter it claims to be, and what contact and jumps
do to it.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from laws import assert_same, bits, cut_at, float_words, random_cuts, run

import stimlib
from stimlib import Input, Param, Scene
from stimlib.blocks.filters import TrackState, track, track_velocity
from stimlib.core.graph import pack, unpack
from stimlib.errors import BadValue, SceneError

FS = 8000.0


def both(fs=FS, target="numba", contact=False, **kw):
    """Position and velocity of one tracker."""
    x = Input("x", "m")
    if contact:
        kw["contact"] = Input("contact")
    return stimlib.compile(Scene({"y": track(x, **kw), "v": track_velocity(x, **kw)}), fs, target)


def states(proc):
    """The trackers' states."""
    words, at, found = proc.state[2:], 0, []
    for q, (_, s) in zip(proc.program.instances, proc.design, strict=True):
        if q.kind == "block":
            if isinstance(s, TrackState):
                found.append(unpack(s, words[at:]))
            at += pack(s).size
    return found


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


def test_no_overshoot_and_no_way_back():
    y, v = both(max_jump=None).process(np.concatenate([np.zeros(3), np.full(4000, 0.03)])[None])
    assert y.max() <= 0.03 and np.diff(y).min() >= -1e-17 and v.min() >= 0


def test_the_velocity_is_that_of_the_position():
    x = reports(125.0, FS, 2.0, 0.05, jitter=0.3) + 0.01
    y, v = both().process(x[None])
    np.testing.assert_allclose(np.diff(y) * FS, v[1:], rtol=0, atol=1e-16 * FS)
    np.testing.assert_allclose(y[0] + np.cumsum(v) / FS, y, rtol=0, atol=1e-14)


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


def held_law(f, fs, bandwidth):
    """w^2/(s+w)^2 of a staircase, seen at the end of each step: all aliases, each
    behind the spectrum of a rectangle.
    """
    g = f[:, None] + fs * np.arange(-20000, 20001)
    H = 1 / (1 + 1j * g / bandwidth) ** 2
    return np.exp(1j * np.pi * f / fs) * np.sum(
        H * np.sinc(g / fs) * np.exp(-1j * np.pi * (g - f[:, None]) / fs), axis=1
    )


@pytest.mark.parametrize(("bandwidth", "fs"), [(20.0, 8000.0), (300.0, 1000.0), (10.0, 1000.0)])
def test_the_response_is_that_of_the_held_filter(bandwidth, fs):
    proc = both(fs, "python", bandwidth=bandwidth)
    f = np.linspace(0.1, 0.5 * fs, 40)
    wanted = held_law(f, fs, bandwidth)
    np.testing.assert_allclose(proc.response("y", "x", f), wanted, rtol=1e-7)
    slope = fs * (1 - np.exp(-2j * np.pi * f / fs))
    np.testing.assert_allclose(proc.response("v", "x", f), slope * wanted, rtol=1e-7)
    assert proc.response("y", "x", np.array([0.0]))[0] == pytest.approx(1.0, rel=1e-15)


def test_the_response_is_that_of_the_continuous_filter_far_below_the_rate():
    f = np.geomspace(0.1, 40.0, 30)
    late = np.exp(1j * np.pi * f / 48000)  # half a sample less
    got = both(48000.0, "python", bandwidth=20.0).response("y", "x", f)
    np.testing.assert_allclose(got, late / (1 + 1j * f / 20.0) ** 2, rtol=1e-5)


@pytest.mark.parametrize("fs", [1000.0, 8000.0])
def test_the_impulse_response_is_the_response(fs):
    n = 1 << 15
    x = np.zeros((1, n + 8))
    x[0, 8] = 1.0
    proc = both(fs, max_jump=None)
    h = proc.process(x)[:, 8:]
    f = np.fft.rfftfreq(n, 1 / fs)
    for name, row in zip("yv", h, strict=True):
        said = proc.response(name, "x", f)
        assert np.abs(np.fft.rfft(row) - said).max() <= 1e-12 * np.abs(said).max()


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
@pytest.mark.parametrize("target", ["numba", "python"])
def test_contact(target):
    proc = both(target=target, contact=True, max_jump=None)
    x = np.concatenate(
        [
            np.full(10, 0.5),
            np.linspace(0.01, 0.02, 40),
            np.full(20, np.nan),
            np.full(20, 9.0),
            np.full(60, -0.3),
        ]
    )
    contact = np.concatenate(
        [np.zeros(10), np.ones(40), np.zeros(20), np.full(20, np.nan), np.full(60, 0.5)]
    )
    y, v = proc.process(np.stack([x, contact]))
    assert not y[:10].any() and not v[:11].any(), "before the first contact"
    assert y[10] == 0.01, "starts where it is touched"
    assert (v[12:50] > 0).all()
    assert (y[50:90] == y[49]).all() and not v[50:90].any(), (
        "held off contact, whatever x and contact do"
    )
    assert (y[90:] == -0.3).all() and not v[90:].any(), "restarts at the new position"


@pytest.mark.parametrize("target", ["numba", "python"])
def test_off_contact_the_state_is_at_rest_and_finite(target):
    proc = both(target=target, contact=True)
    x = np.linspace(0.0, 0.01, 60)
    proc.process(np.stack([x, np.ones(60)]))
    assert all(s.h > 0 and s.e > 0 for s in states(proc))
    for bad in (0.5, np.nan, np.inf):
        proc.process(np.array([[bad], [0.0]]))
        for s in states(proc):
            assert (
                s.v == s.e == s.h == 0.0
                and s.cold == 1.0
                and np.isfinite(s.last)
                and np.isfinite(s.y)
            )


@pytest.mark.parametrize("target", ["numba", "python"])
def test_a_jump_invents_no_movement(target):
    proc = both(target=target)
    x = np.concatenate(
        [
            np.linspace(0.0, 0.01, 100),
            np.full(50, 0.0700001),
            np.full(50, 0.03),
            np.full(200, 0.08 - 1e-9),
        ]
    )
    y, v = proc.process(-x[None])
    assert (y[100:150] == -0.0700001).all() and not v[100:150].any(), "backwards too"
    proc.reset()
    y, v = proc.process(x[None])
    assert v[99] > 0
    assert (y[100:150] == 0.0700001).all() and not v[100:150].any(), "0.06 m is a jump"
    assert 0.03 < y[151] < 0.0700001 and v[151] < 0, "0.04 m is a movement"
    assert 0.03 < y[-1] < 0.08, "just below 0.05 m too"


def test_the_limit_of_a_jump_can_be_taken_away():
    y = both(max_jump=None).process(np.concatenate([np.zeros(5), np.full(5, 1e6)])[None])[0]
    assert 0 < y[5] < y[-1] < 1e6


def test_the_first_sample_is_where_it_starts():
    y, v = both().process(np.full((1, 50), 12.5))
    assert (y == 12.5).all() and not v.any()


# Bits ---------------------------------------------------------------------------------
def finger(n, seed):
    """Reports with contact lost now and then, jumps, zeros of both signs, and codes
    that toggle.
    """
    rng = np.random.default_rng(seed)
    x = np.repeat(0.02 * rng.standard_normal(n // 17 + 1).cumsum(), 17)[:n]
    x[rng.integers(0, n, n // 9)] += 1e-6
    x[n // 3 : n // 3 + 20] = -0.0
    contact = np.repeat(rng.choice([1.0, 1.0, 1.0, 0.0, -1.0], n // 40 + 1), 40)[:n]
    return np.stack([x, contact])


@pytest.mark.parametrize("fs", [1000.0, 8000.0, 44100.0])
@pytest.mark.parametrize("bandwidth", [0.3, 20.0, 400.0])
def test_compiled_is_the_reference_in_output_and_state(fs, bandwidth):
    x = finger(400, 3)
    pair = [both(fs, target, contact=True, bandwidth=bandwidth) for target in ("numba", "python")]
    cuts = random_cuts(400, np.random.default_rng(4))
    states = [[], []]
    y = [
        run(p, x, cuts, (), lambda p, kept=kept: kept.append(p.state))
        for p, kept in zip(pair, states, strict=True)
    ]
    assert_same(*y)
    for s, t in zip(*states, strict=True):
        assert_same(s, t)
    assert y[0].any()


@given(st.integers(0, 2**32), st.sampled_from([1, 7, 64, 1000]))
def test_cuts_change_nothing(seed, size):
    n = 700
    x = finger(n, seed)
    proc = both(contact=True)
    whole = run(proc, x)
    end = proc.state
    for cuts in (cut_at(n, size), random_cuts(n, np.random.default_rng(seed))):
        proc.reset()
        assert_same(run(proc, x, cuts), whole)
        assert_same(proc.state, end)


@pytest.mark.parametrize("bandwidth", [2.0, 20.0, 3000.0])
@pytest.mark.parametrize("hold", [0.0, 0.0123, "zero after off contact"])
def test_a_minute_of_hold_leaves_no_denormals(bandwidth, hold):
    proc = both(contact=True, bandwidth=bandwidth, max_jump=None)
    proc.process(finger(4000, 5) * [[1.0], [0.0]] + [[0.0], [1.0]])
    floats = float_words(proc)
    rest = np.zeros((2, int(10 * FS)))
    rest[1] = 1.0
    if hold == "zero after off contact":
        proc.process(np.zeros((2, 100)))
        assert not any((s.v, s.e, s.h) != (0, 0, 0) for s in states(proc))
    else:
        rest[0] = hold
    for _ in range(6):
        y = proc.process(rest)
        for a in (np.abs(proc.state[floats].view(np.float64)), np.abs(y)):
            assert np.all((a == 0) | (a >= 1e-300))
    assert (y[0] == rest[0]).all() and not y[1].any()


def test_gain_of_two_is_exact_and_time_does_not_matter():
    x = 1e-3 * np.random.default_rng(6).standard_normal((1, 500))
    x[0, 0] = 0.0
    y = both(max_jump=None).process(x)
    np.testing.assert_allclose(both(max_jump=None).process(-4 * x), -4 * y, rtol=0, atol=1e-180)
    late = both(max_jump=None).process(np.concatenate([np.zeros((1, 33)), x], axis=1))
    np.testing.assert_allclose(late[:, 33:], y, rtol=0, atol=1e-180)


def test_what_is_not_finite_is_a_fault_in_contact_only():
    x = np.full((2, 400), 0.01)
    x[1] = 1.0
    x[0, 100] = np.nan
    for target in ("numba", "python"):
        proc = both(target=target, contact=True)
        proc.process(x)
        assert proc.fault is not None and proc.fault[1] == 100
        proc.reset()
        proc.process(np.where(np.arange(400) == 100, np.array([[np.nan], [0.0]]), x))
        assert proc.fault is None


# Building -----------------------------------------------------------------------------
def test_units_and_files(tmp_path):
    x = Input("x", "m")
    scene = Scene(
        {"y": track(x, 12.0, contact=Input("touch"), max_jump=None), "v": track_velocity(x, 12.0)}
    )
    assert [str(b.dim) for b in scene.outputs.values()] == ["m", "m/s"]
    scene.save(tmp_path / "s.json")
    again = stimlib.load(tmp_path / "s.json")
    assert again.hash == scene.hash
    assert repr(track(x, 12.0)) == "Track(Input('x'), Const(1.0), bandwidth=12.0, max_jump=0.05)"


@pytest.mark.parametrize("make", [track, track_velocity])
def test_errors(make):
    x = Input("x", "m")
    for kw in (
        {"bandwidth": 0.0},
        {"bandwidth": -1.0},
        {"max_jump": 0.0},
        {"max_jump": -0.1},
        {"bandwidth": float("nan")},
    ):
        with pytest.raises(BadValue, match=next(iter(kw))):
            make(x, **kw)
    with pytest.raises(BadValue, match="cannot be the signal"):
        make(x, bandwidth=Param("b", 20.0))
    with pytest.raises(BadValue, match="does not fit below fs/2"):
        stimlib.compile(Scene({"y": make(x, bandwidth=500.0)}), 1000)


def test_zeros_keep_no_sign_of_their_own():
    assert_same(bits(both().process(np.full((1, 30), -0.0))), bits(np.zeros((2, 30))))
