"""Motion generators: the same bits at every cut, the right physics, and specs that read
back.
"""

import dataclasses
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from refusals import refused

from stimlib.errors import BadValue
from stimlib.motion import generators as m, parse_motion
from stimlib.motion.source import positions, sources_of

FS = 8000.0

MOTIONS = [
    m.minimum_jerk(),
    m.minimum_jerk(depth=-0.01, start=0.02, rise=0.01, hold=0, fall=0.003, rest=0, repeats=50),
    m.sinusoid(0.01, 1.0),
    m.sinusoid(0.003, 47.3, mean=0.02, phase=1.0),
    m.ramp_and_hold(0.01, 0.5),
    m.ramp_and_hold(0.01, 0.1, start_time=0.05, hold=0.2, fall=0.03),
    m.constant_speed(0.1, 0.013),
    m.constant_speed(0.1, 0.05, start=0.01, back_and_forth=False),
    m.staircase_hold(1e-3, 7, 0.07),
    m.quantised(m.minimum_jerk(), 1e-6),
    m.jittered(m.ramp_and_hold(0.01, 0.1), 1e-6, 800.0, 3),
    m.quantised(m.jittered(m.minimum_jerk(), 1e-6, 997.0, 2**64 - 1), 1e-6),
]


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda x: repr(x)[:40])
def test_same_bits_hours_later_and_in_any_layout_of_memory(motion):
    for first in (0, 12345 * 8000):  # the start, and hours later
        t = np.arange(first, first + 5003) / FS
        whole = motion(t)
        assert whole.dtype == np.float64 and np.isfinite(whole).all()
        shifted = np.empty(len(t) + 1)[1:]  # another alignment in memory
        shifted[:] = t
        for other in (shifted, np.repeat(t, 3)[::3], t[:4998].reshape(2, 3, 833)):
            assert np.array_equal(motion(other), whole[: other.size].reshape(other.shape))
        assert np.array_equal(motion(t[::-1]), whole[::-1])
        assert np.array_equal(t, np.arange(first, first + 5003) / FS)
        assert not np.shares_memory(whole, t)
    assert motion(0.1).shape == () and motion(np.empty(0)).shape == (0,)


def test_fields_become_plain_numbers():
    motion = m.minimum_jerk(depth=np.float32(0.5), rise=np.int64(2), repeats=np.int32(3))
    assert repr(motion) == (
        "minimum_jerk(depth=0.5, start=0.0, rise=2.0, hold=0.2, fall=0.3, rest=0.4, repeats=3)"
    )
    assert type(motion.rise) is float and type(motion.repeats) is int
    with pytest.raises(dataclasses.FrozenInstanceError):
        motion.depth = 1.0


def test_sinusoid_is_right_to_the_last_bits_after_hours():
    x = m.sinusoid(1.0, 1.0)
    t = np.concatenate([np.linspace(0, 3, 997), 1e5 + np.linspace(0, 3, 499)])
    exact = [float(mpmath.sinpi(2 * mpmath.mpf(v))) for v in t]
    assert np.abs(x(t) - exact).max() < 3e-16
    assert np.array_equal(x([0.0, 0.25, 0.5, 0.75, 1e6 + 0.25]), [0.0, 1.0, 0.0, -1.0, 1.0])
    shifted = m.sinusoid(1.0, 3.0, mean=2.0, phase=0.7)(t)
    error = np.abs(shifted - 2 - np.sin(2 * np.pi * 3 * t + 0.7))
    assert error.max() < 3e-9 and error[:997].max() < 3e-14


@pytest.mark.parametrize("period", [1.2, 0.1, 1.999999999999999, 2.0**-30, 1e-310, 1.7e308])
def test_the_time_within_a_period_is_exact(period):
    """Before, at and after whole periods, compared with fractions."""
    with np.errstate(over="ignore"):
        whole = np.floor(2.0 ** np.linspace(0.0, 30.0, 700)) * period
        x = np.concatenate([np.nextafter(whole, 0.0), whole, np.nextafter(whole, np.inf)])
    x = np.append(x[np.isfinite(x)], np.linspace(0.0, 1.0, 1024) * period)
    for some in (x[x < 2.0**24 * period], x):  # few periods, and too many for the fast way
        exact = [float(Fraction(v) % Fraction(period)) for v in some.tolist()]
        assert some.size >= 1024 and m._fmod(some, period).tolist() == exact
    gap = m._fmod(np.append(x, np.nan), period)  # too many, and a time that is none
    assert gap[:-1].tolist() == exact and np.isnan(gap[-1])


def test_a_press_may_rise_and_fall_at_its_own_speeds():
    """Minimum jerk from 0 to 1 in T: 10 u^3 - 15 u^4 + 6 u^5 with u = t/T."""
    t = np.arange(1200) / 1000
    rise, fall = ((np.arange(1000 * T) / (1000 * T)) for T in (0.2, 0.6))
    up, down = (10 * u**3 - 15 * u**4 + 6 * u**5 for u in (rise, fall))
    want = np.concatenate([up, np.ones(100), 1 - down, np.zeros(300)])
    x = m.minimum_jerk(2.0, start=0.5, rise=0.2, hold=0.1, fall=0.6, rest=0.3, repeats=2)
    for late, height in ((0.0, 1.0), (1.2, 1.0), (2.4, 0.0), (-1.2, 0.0), (1e9, 0.0)):
        np.testing.assert_allclose(x(t + late), 0.5 + 2.0 * height * want, rtol=0, atol=1e-12)
    for_ever = m.minimum_jerk(rise=0.2, hold=0.1, fall=0.6, rest=0.3)
    np.testing.assert_allclose(for_ever(t + 1.2 * 1000), for_ever(t), rtol=0, atol=1e-13)


def test_ramp_and_triangle_have_their_speed():
    t = np.arange(4000) / FS
    assert np.diff(m.ramp_and_hold(0.01, 1.0)(t)) * FS == pytest.approx(0.01)
    x = m.constant_speed(0.1, 0.02, start=0.5)(t)
    assert x.min() == 0.5 and x.max() == pytest.approx(0.52, abs=1e-15)
    assert np.median(np.abs(np.diff(x)) * FS) == pytest.approx(0.1)
    assert (m.constant_speed(0.1, 0.02)([-1.0]) == 0.0).all()
    assert (m.ramp_and_hold(0.01, 1.0, hold=1.0, fall=1.0)([-1.0, 3.0, 4.0]) == 0.0).all()


@pytest.mark.parametrize("fs", [1000, 8000, 44100, 48000])
@pytest.mark.parametrize("samples", [1, 3, 70, 441])
def test_edges_fall_on_their_sample(fs, samples):
    n = np.concatenate([np.arange(3000), 86_400 * fs + np.arange(3000)])
    level = m.staircase_hold(1.0, 2**53, samples / fs)(n / fs)
    assert np.array_equal(level, n // samples)
    held = m.ramp_and_hold(1.0, 1e-9, start_time=0.0)
    jitter = m.jittered(held, 1.0, fs / samples, 5)((n + 1) / fs)
    inside = np.diff(jitter)[(n[:-1] + 2) % samples != 0]
    assert np.count_nonzero(inside) <= 1  # one for the gap in n


def test_quantised_is_whole_codes_of_any_function():
    t, true = np.arange(8000) / FS, m.minimum_jerk()
    x = m.quantised(true, 1e-6)(t)
    assert np.array_equal(x, np.rint(x / 1e-6) * 1e-6)
    assert np.abs(x - true(t)).max() <= 0.5e-6 * (1 + 1e-9)
    assert m.quantised(lambda t: 0.3 * t, 0.1)([0.0, 1.0]).tolist() == [0.0, 0.30000000000000004]


@pytest.mark.parametrize("position", [0.0, 0.01, 0.0123456])
def test_jitter_toggles_between_two_adjacent_codes(position):
    q, rate, t = 1e-6, 800.0, 1 + np.arange(80_000) / FS
    held = m.ramp_and_hold(position, 1e-3)
    x, other = (m.quantised(m.jittered(held, q, rate, seed=seed), q)(t) for seed in (7, 8))
    codes = np.rint(x / q)
    assert np.unique(codes).tolist() == [np.rint(position / q), np.rint(position / q) + 1]
    assert (codes.reshape(-1, 10) == codes[::10, None]).all()  # one value per interval
    bits = codes[::10] - codes.min()
    limit = 4 / np.sqrt(bits.size)
    assert abs(bits.mean() - 0.5) < limit / 2 and abs((other == x).mean() - 0.5) < limit / 2
    assert abs(np.corrcoef(bits[1:], bits[:-1])[0, 1]) < limit


@pytest.mark.parametrize("codes", [0, 3])
def test_jitter_before_time_zero_and_amplitude(codes):
    x = m.jittered(m.sinusoid(0.0, 1.0), 1e-3, 100.0, seed=1, amplitude_codes=codes)
    assert {*x(np.arange(-500, 500) / 100)} == {0.0, codes * 1e-3}


def test_splitmix64_known_answer():
    # first outputs of the reference program for state 1234567
    got = m._splitmix64(np.array([1234567], np.uint64), np.arange(3, dtype=np.uint64))
    assert got.tolist() == [6457827717110365317, 3203168211198807973, 9817491932198370423]
    # jitter has the top bits of the generator whose state is the first of these
    state, n = np.array([6457827717110365317], np.uint64), np.arange(64)
    jitter = m.jittered(np.zeros_like, 1.0, 1.0, 1234567)(n + 0.5)
    assert jitter.tolist() == (m._splitmix64(state, n.astype(np.uint64)) >> np.uint64(63)).tolist()


BAD = [
    ("minimum_jerk(depth=1e999)", "minimum_jerk: depth .*inf"),
    ("minimum_jerk(rise=0)", "rise .*above 0"),
    ("minimum_jerk(rise=-1)", "rise .*got -1"),
    ("minimum_jerk(hold=-1)", "hold .*0 or above"),
    ("minimum_jerk(repeats=0)", "repeats .*whole"),
    ("minimum_jerk(repeats=2.0)", "repeats .*whole"),
    ("minimum_jerk(depth=True)", "depth .*finite"),
    ("minimum_jerk(None)", "depth .*got None"),
    ("minimum_jerk(depth=1" + "0" * 400 + ")", "depth .*finite"),
    ("sinusoid(0.01, 0.0)", "freq .*above 0"),
    ("sinusoid(1e999, 1.0)", "amplitude .*finite"),
    ("sinusoid(sinusoid(1, 1), 1)", "amplitude .*finite"),
    ("ramp_and_hold(0.01, 1.0, hold=1.0)", "both hold and fall"),
    ("ramp_and_hold(0.01, 1.0, start_time=-1.0)", "start_time .*0 or above"),
    ("ramp_and_hold(0.01, 1.0, hold=1.0, fall=0.0)", "fall .*above 0"),
    ("constant_speed(-0.1, 0.05)", "speed .*above 0"),
    ("constant_speed(0.1, 0.05, back_and_forth=1)", "back_and_forth .*True or False"),
    ("staircase_hold(0.01, -1, 1.0)", "n_steps .*whole"),
    ("quantised(0.01, 1e-6)", "motion must be a motion"),
    ("quantised(minimum_jerk(), 0.0)", "resolution .*above 0"),
    ("jittered(minimum_jerk(), 1e-6, 0.0)", "rate .*above 0"),
    ("jittered(minimum_jerk(), 1e-6, 1.0, seed=-1)", "seed .*whole"),
    (f"jittered(minimum_jerk(), 1e-6, 1.0, seed={2**64})", "seed .*whole"),
    # in the call itself
    ("sinusoid(1)", "mean=0.0, phase=0.0.*missing .*'freq'"),
    ("sinusoid(1, 2, frequency=3)", "no argument 'frequency'"),
    ("minimum_jerk(**1)", "no argument"),
]


@pytest.mark.parametrize(("text", "says"), BAD, ids=lambda v: v[:40])
def test_bad_values_are_named(text, says):
    refused(BadValue, says, parse_motion, text)


@pytest.mark.parametrize("value", ["0.02", float("nan"), 10**400, [1.0]])
def test_numbers_that_no_text_gives_are_refused_too(value):
    refused(BadValue, "minimum_jerk: depth .*finite", m.minimum_jerk, depth=value)


@pytest.mark.parametrize(
    ("text", "motion"),
    [
        ("minimum_jerk()", m.minimum_jerk()),
        (" minimum_jerk(depth=0.01, hold=1)\n", m.minimum_jerk(depth=0.01, hold=1.0)),
        ("sinusoid(0.01, 1)", m.sinusoid(0.01, 1.0)),
        ("sinusoid(-0.01, +1, phase=-1e-3)", m.sinusoid(-0.01, 1.0, phase=-1e-3)),
        ("minimum_jerk(repeats=None)", m.minimum_jerk()),
        (
            "constant_speed(0.1, 0.05, back_and_forth=False)",
            m.constant_speed(0.1, 0.05, back_and_forth=False),
        ),
        ("quantised(minimum_jerk(), 1e-6)", m.quantised(m.minimum_jerk(), 1e-6)),
        (
            "quantised(motion=sinusoid(1, 2), resolution=1e-6)",
            m.quantised(m.sinusoid(1.0, 2.0), 1e-6),
        ),
    ],
)
def test_parse(text, motion):
    assert parse_motion(text) == motion


@pytest.mark.parametrize(
    "text",
    ["", "   ", "minimum_jerk", "0.01", "None", "minimum_jerk(", "minimum_jerk() minimum_jerk()"]
    + ["nosuch()", "__import__('os').system('true')", "minimum_jerk(depth=__import__('os'))"]
    + ["minimum_jerk(depth=1+1)", "minimum_jerk(depth='0.01')", "minimum_jerk(depth=0.01j)"]
    + ["minimum_jerk(depth=-True)", "Motion()", "m.minimum_jerk()", "(lambda: 1)()"]
    + ["[minimum_jerk()]", "minimum_jerk(*[1])", "minimum_jerk(**{'a': 1})", "minimum_jerk(x := 1)"]
    + ["sinusoid(1, **1 + 1)", "sinusoid.__init__(1)", "parse_motion('minimum_jerk()')"]
    + ["sinusoid(nan, 1)", "minimum_jerk()\nsinusoid(1, 1)", "a = minimum_jerk()", "\0"]
    + ["-" * 9000 + "1", "(" * 5000, "9" * 9000, "x" * 100_000]
    + ["quantised(" * 900 + "minimum_jerk()" + ", 1)" * 900],
    ids=lambda x: repr(x)[:30],
)
def test_parse_refuses_and_lists_the_generators(text):
    error = refused(BadValue, None, parse_motion, text)
    assert all(name in str(error) for name in m.GENERATORS) and len(str(error)) < 600


NUMBER = st.floats(-1, 1)
POSITIVE = st.floats(1e-3, 10)
LEAVES = st.one_of(
    st.builds(
        m.minimum_jerk,
        NUMBER,
        NUMBER,
        POSITIVE,
        POSITIVE,
        POSITIVE,
        POSITIVE,
        st.none() | st.integers(1, 9),
    ),
    st.builds(m.sinusoid, NUMBER, POSITIVE, NUMBER, NUMBER),
    st.builds(m.ramp_and_hold, NUMBER, POSITIVE, POSITIVE),
    st.builds(m.constant_speed, POSITIVE, POSITIVE, NUMBER, st.booleans()),
    st.builds(m.staircase_hold, NUMBER, st.integers(0, 99), POSITIVE, NUMBER),
)
ANY = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.builds(m.quantised, inner, POSITIVE),
        st.builds(m.jittered, inner, POSITIVE, POSITIVE, st.integers(0, 2**64 - 1), POSITIVE),
    ),
    max_leaves=4,
)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(ANY, st.lists(st.integers(0, 700), max_size=5))
def test_any_motion_reads_back_and_can_be_cut_anywhere(motion, cuts):
    assert parse_motion(repr(motion)) == motion
    assert "\n" not in repr(motion) and "np." not in repr(motion)
    t = np.arange(700) / 613.0
    whole = motion(t)
    assert np.array_equal(np.concatenate([motion(p) for p in np.split(t, sorted(cuts))]), whole)


def test_many_generators_give_the_bits_of_each_alone():
    rng, n = np.random.default_rng(5), 8
    a, b, c = rng.uniform(0.01, 1.0, (3, n)).tolist()
    kinds = [
        lambda k: m.minimum_jerk(a[k], b[k], c[k], 0.1, b[k], repeats=[None, 2][k % 2]),
        lambda k: m.sinusoid(a[k], b[k], c[k], c[k]),
        lambda k: m.ramp_and_hold(a[k], b[k]),
        lambda k: m.constant_speed(a[k], b[k], back_and_forth=k < 4),
        lambda k: m.staircase_hold(a[k], 2, c[k]),
        lambda k: m.quantised(m.sinusoid(a[k], b[k]), 1e-3),
        lambda k: np.full(4000, a[k]),
    ]
    shared = m.sinusoid(0.1, 2.0)
    motion = {f"x{k}{j}": make(k) for k in range(n) for j, make in enumerate(kinds)}
    motion |= {f"shared{k}": shared for k in range(n)}
    sources = sources_of(motion, tuple(motion), 4000)
    assert sorted(len(places) for places, _ in sources.groups) == [4, 4, 4, 4, 8, 8, 9]
    for start, stop in ((0, 512), (512, 513), (3000, 3300)):
        x = positions(sources, start, stop, 1000.0)
        alone = [positions({name: one}, start, stop, 1000.0)[0] for name, one in motion.items()]
        assert x.tobytes() == np.array(alone).tobytes()
    motion["x31"] = motion["x41"] = m.sinusoid(1e308, 1.0, mean=1e308)
    sources = sources_of(motion, tuple(motion), 4000)
    with np.errstate(over="ignore"):
        refused(BadValue, "x31 .* sample 147", positions, sources, 0, 500, 1000.0)


def test_a_function_that_several_encoders_report_sees_times_in_one_row():
    def hand(t):
        assert t.ndim == 1
        return 0.1 * t

    motion = {f"x{k}": m.quantised(hand, 1e-3 * (k + 1)) for k in range(4)}
    x = positions(sources_of(motion, tuple(motion), 100), 0, 100, 1000.0)
    t = np.arange(100) / 1000
    assert x.tobytes() == np.array([one(t) for one in motion.values()]).tobytes()
