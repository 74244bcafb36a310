"""Bumps against their integrals in closed form, the carrier against exact arithmetic;
what contact and parameters do.
"""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from laws import assert_same, bits, cut_at, mostly, random_cuts, run

import stimlib
from stimlib import Input, Param, Scene
from stimlib.blocks import enabled
from stimlib.blocks.oscillators import carrier
from stimlib.blocks.surfaces import WAVEFORMS, bump
from stimlib.errors import BadValue, UnitError

FS = 8000.0
pi = np.pi
TABLE = [0.2, 1.0, 0.0, 0.7]


def bumps(waveform="square", duty=0.5, target="numba", **kw):
    return stimlib.compile(Scene({"e": bump(Input("u"), waveform, duty, **kw)}), FS, target)


def e(waveform, u, d):
    """The envelope, as the paper's figure 4.1 has it."""
    w = u - np.floor(u)
    if not isinstance(waveform, str):
        return np.where(w < d, np.interp(w / d, np.linspace(0, 1, len(waveform)), waveform), 0.0)
    top = {
        "square": np.ones_like(w),
        "sawtooth": w / d,
        "half_sine": np.sin(pi * w / d),
        "sine": np.maximum(
            0, (np.cos(2 * pi * (w - d / 2)) - np.cos(pi * d)) / (1 - np.cos(pi * d))
        ),
    }[waveform]
    return np.where(w < d, top, 0.0)


def integral(waveform, u, d):
    """Of e from 0 to u."""
    k = np.floor(u)
    m = np.minimum(u - k, d)
    if not isinstance(waveform, str):
        knots = d * np.linspace(0, 1, len(waveform))
        v = np.array(waveform)
        sums = np.r_[0, np.cumsum(np.diff(knots) * (v[1:] + v[:-1]) / 2)]
        i = np.minimum(np.searchsorted(knots, m, "right") - 1, len(v) - 2)
        a = m - knots[i]
        return (
            k * sums[-1]
            + sums[i]
            + v[i] * a
            + a * a * (v[i + 1] - v[i]) / (knots[i + 1] - knots[i]) / 2
        )
    if waveform == "square":
        return k * d + m
    if waveform == "sawtooth":
        return k * d / 2 + m * m / (2 * d)
    if waveform == "half_sine":
        return (k * 2 + 1 - np.cos(pi * m / d)) * d / pi

    def sine(m):
        return (
            np.sin(2 * pi * m - pi * d) / (2 * pi) + np.sin(pi * d) / (2 * pi) - m * np.cos(pi * d)
        ) / (1 - np.cos(pi * d))

    return k * sine(d) + sine(m)


shapes = pytest.mark.parametrize("waveform", [*WAVEFORMS, TABLE], ids=[*WAVEFORMS, "table"])
few_shapes = pytest.mark.parametrize(
    "waveform", mostly(["square", "sawtooth"], [*WAVEFORMS, TABLE]), ids=[*WAVEFORMS, "table"]
)


# Envelopes ----------------------------------------------------------------------------
@few_shapes
@given(
    st.floats(0.02, 1.0),
    st.lists(
        st.tuples(st.floats(-3, 0.301), st.sampled_from([-1, 0, 1, 1]), st.integers(1, 400)),
        min_size=1,
        max_size=12,
    ),
    st.sampled_from([2, 6, 18]),
    st.floats(-0.1, 0.1),
)
def test_over_any_movement_the_bumps_add_up_to_their_integral(waveform, duty, parts, nb, start):
    """Speeds from 1 mm/s to 2 m/s, reversals, stops."""
    v = np.concatenate([np.full(n, sign * 10.0**exponent) for exponent, sign, n in parts])
    u = np.r_[start, start + np.cumsum(v) / FS] * nb / 0.1
    y = bumps(waveform, duty).process(u[None])[0]
    assert y.min() >= 0 and y.max() <= 1
    assert (
        abs(
            np.sum(y[1:] * np.diff(u))
            - (integral(waveform, u[-1], duty) - integral(waveform, u[0], duty))
        )
        <= 1e-12
    )


@pytest.mark.parametrize("waveform", mostly({"sawtooth"}, ["sine", "sawtooth"]))
def test_one_sample_of_another_duty(waveform):
    """In a tile of one duty, wherever it is."""
    procs = [bumps(waveform, Input("d"), target) for target in ("numba", "python")]
    for at in (0, 1, 40, 63):
        given = {"u": np.arange(64) * 0.011, "d": np.where(np.arange(64) == at, 0.6, 0.3)}
        one, other = (p.process(np.array([given[name] for name in p.inputs])) for p in procs)
        assert_same(one, other)


def test_no_rounding_leaves_0_to_1():
    u = np.cumsum(np.random.default_rng(0).standard_normal(20_000) * 3)
    for waveform, duty in (
        ("square", 1.0),
        ("square", 0.7),
        ([1.0, 1.0], 1.0),
        ("sine", 0.1),
        ([0.0, 0.0], 0.3),
    ):
        y = bumps(waveform, duty).process(u[None])
        assert y.min() >= 0.0 and y.max() <= 1.0


@pytest.mark.parametrize("target", ["numba", "python"])
@pytest.mark.parametrize("sampling", ["area", "point"])
def test_standing_at_an_edge(sampling, target):
    """A ridge begins with its first place and ends before its last."""
    for waveform, first in (
        ("square", 1.0),
        ("sawtooth", 0.0),
        ("sine", 0.0),
        ("half_sine", 0.0),
        ([0.75, 1.0], 0.75),
    ):
        proc = bumps(waveform, 0.25, target, sampling=sampling)
        for u, e in ((0.25, 0.0), (-0.75, 0.0), (3.0, first), (-1e-17, first)):
            proc.reset()
            np.testing.assert_allclose(proc.process(np.full((1, 9), u)), e, atol=1e-15)


@shapes
@pytest.mark.parametrize("duty", [0.05, 0.5, 0.8, 1.0])
def test_each_sample_is_the_mean_over_its_movement(waveform, duty):
    rng = np.random.default_rng(1)
    # up to 20 bumps a sample
    u = np.cumsum(rng.choice([-1, 1], 4000) * 10 ** rng.uniform(-2, 1.3, 4000))
    y = bumps(waveform, duty).process(u[None])[0, 1:]
    wanted = np.diff(integral(waveform, u, duty)) / np.diff(u)
    np.testing.assert_allclose(y, wanted, rtol=0, atol=1e-11)


@shapes
def test_slow_movements_lose_no_digits(waveform):
    """Where a difference of integrals would have none left: 1e-12 of a bump per
    sample.
    """
    duty = 0.7
    u = 3 + 0.3 + 1e-12 * np.arange(50)
    y = bumps(waveform, duty).process(u[None])[0]
    np.testing.assert_allclose(y, e(waveform, u, duty), rtol=1e-10)


@shapes
@pytest.mark.parametrize("sampling", ["area", "point"])
def test_a_finger_at_rest_feels_the_envelope_where_it_is(waveform, sampling):
    proc = bumps(waveform, 0.4, sampling=sampling)
    for u in (-2.3, -1.9, -0.7, -1e-18, 0.0, 0.123, 0.39, 0.41, 0.99, 1.0, 3.3, 1e6 + 0.25):
        proc.reset()
        y = proc.process(np.full((1, 5), u))[0]
        # a place just below 0 is 0
        wanted = e(waveform, np.array(u if abs(u) > 1e-9 else 0.0), 0.4)
        np.testing.assert_allclose(y, wanted, rtol=0, atol=1e-14)


@shapes
def test_point_sampling_is_the_envelope_itself(waveform):
    u = np.cumsum(np.random.default_rng(2).standard_normal(3000))
    y = bumps(waveform, 0.3, sampling="point").process(u[None])[0]
    np.testing.assert_allclose(y, e(waveform, u, 0.3), rtol=0, atol=1e-14)


@shapes
def test_to_and_fro_feel_the_same(waveform):
    u = np.cumsum(np.random.default_rng(3).uniform(0, 0.3, 500))
    there, back = (
        bumps(waveform, 0.6).process(np.ascontiguousarray(v[None]))[0, 1:] for v in (u, u[::-1])
    )
    np.testing.assert_allclose(there, back[::-1], rtol=0, atol=1e-14)


@shapes
@pytest.mark.parametrize("target", ["numba", "python"])
def test_contact(waveform, target):
    """Silent off contact; at re-contact no bump of the way between is played."""
    proc = bumps(waveform, 0.5, target, contact=Input("touch"))
    u = np.r_[np.linspace(0.1, 0.3, 20), np.full(10, np.nan), np.linspace(7.2, 7.4, 20)]
    touch = np.r_[np.ones(20), np.zeros(10), np.ones(20)]
    y = proc.process(np.stack([u, touch]))[0]
    assert not y[20:30].any() and proc.fault is None
    np.testing.assert_allclose(y[[0, 30]], e(waveform, u[[0, 30]], 0.5), atol=1e-14)
    fresh = bumps(waveform, 0.5, target).process(np.ascontiguousarray(u[None, 30:]))
    assert_same(y[30:], fresh[0])


@shapes
def test_duty_may_be_live(waveform):
    proc = bumps(waveform, Param("duty", 0.3))
    u = 0.037 * np.arange(400)
    y = [proc.process(u[None, :150].copy())]
    proc.set("duty", 0.8, ramp=0)
    y = np.concatenate([*y, proc.process(u[None, 150:].copy())], axis=1)[0]
    for part, d in ((slice(1, 150), 0.3), (slice(150, 400), 0.8)):
        wanted = np.diff(integral(waveform, u, d), prepend=0)[part] / 0.037
        np.testing.assert_allclose(y[part], wanted, rtol=0, atol=1e-12)
    for outside, held in ((2.0, 1.0), (-1.0, 1e-6)):
        proc.set("duty", outside, ramp=0)
        v = np.array([[0.2, 0.9, 1.6, 5.0]])
        wanted = np.diff(integral(waveform, v[0], held)) / np.diff(v[0])
        np.testing.assert_allclose(proc.process(v)[0, 1:], wanted, rtol=0, atol=1e-10)


def test_a_table_of_straight_lines_is_the_waveform_itself():
    u = np.cumsum(np.random.default_rng(4).standard_normal(2000) * 0.2)
    for table, waveform in (
        ([0, 1], "sawtooth"),
        ([1, 1, 1, 1], "square"),
        (np.linspace(0, 1, 9), "sawtooth"),
    ):
        one, other = (bumps(w, 0.45).process(u[None]) for w in (table, waveform))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13)


def test_the_ends_of_the_sine_family():
    """Duty 1 is a raised cosine; a short ridge is a parabola; half_sine has the duty
    only as its width.
    """
    z = np.linspace(0.001, 0.999, 400)
    np.testing.assert_allclose(
        bumps("sine", 1.0, sampling="point").process(z[None])[0], np.sin(pi * z) ** 2, atol=1e-15
    )
    short = bumps("sine", 1e-4, sampling="point").process(1e-4 * z[None])[0]
    np.testing.assert_allclose(short, 4 * z * (1 - z), atol=1e-7)
    for d in (0.01, 1.0):
        np.testing.assert_allclose(
            bumps("half_sine", d, sampling="point").process(d * z[None])[0],
            np.sin(pi * z),
            atol=3e-15,
        )


def alias(y, k, top):
    """Power below top (a part of fs) that is not on multiples of line k, in dB of the
    power on them.
    """
    P = np.abs(np.fft.rfft(y)) ** 2
    n = np.arange(P.size)
    low = (n > 0) & (n < top * y.size)
    return 10 * np.log10(P[low & (n % k != 0)].sum() / P[low & (n % k == 0)].sum())


@pytest.mark.parametrize("duty", [0.2, 0.5, 0.8])
def test_area_sampling_has_20_dB_less_alias_below_1_kHz(duty):
    n = 1 << 16
    k = round(90 / FS * n) | 1  # 90 bumps/s, no common period with fs
    u = np.arange(-1, n) * k / n + 1.234567e-4
    area, point = (
        alias(bumps("square", duty, sampling=s).process(u[None])[0, 1:], k, 1000 / FS)
        for s in ("area", "point")
    )
    assert area <= point - 20


@shapes
@given(st.integers(0, 2**32))
def test_cuts_and_targets_change_nothing(waveform, seed):
    rng = np.random.default_rng(seed)
    n = 300
    u = np.cumsum(
        rng.standard_normal(n) * np.repeat(rng.choice([0.0, 1e-9, 1e-3, 0.1, 5.0], n // 20), 20)
    )
    u[rng.integers(0, n, 5)] = rng.choice([0.0, -0.0, 1.0, -1e-17, 1e-300, 3.5], 5)
    x = np.stack([u, np.repeat(rng.choice([1.0, 1.0, 1.0, 0.0, np.nan], n // 30), 30)])
    duty = float(rng.choice([0.2, 0.5, 1.0]))
    procs = [
        bumps(waveform, duty, target, contact=Input("c")) for target in ("numba", "numba", "python")
    ]
    y = [
        run(p, x, cuts)
        for p, cuts in zip(procs, ([], random_cuts(n, rng), cut_at(n, 50)), strict=True)
    ]
    assert_same(y[0], y[1])
    assert_same(y[0], y[2])
    assert_same(procs[0].state, procs[2].state)


def test_bump_errors():
    u = Input("u")
    for duty in (0.0, -0.1, 1.0001, 7, Param("d", 0.0), Param("d", 1.5)):
        with pytest.raises(BadValue, match="duty"):
            bump(u, duty=duty)
    with pytest.raises(BadValue, match="not finite"):
        bump(u, duty=float("nan"))
    with pytest.raises(BadValue, match="square, sine, sawtooth, half_sine"):
        bump(u, "triangle")
    with pytest.raises(BadValue, match="area, point"):
        bump(u, sampling="blep")
    for table in ([1.0], [], [[0, 1], [1, 0]], [0, 1.1], [-0.1, 1], [0, np.nan]):
        with pytest.raises(BadValue):
            bump(u, table)
    with pytest.raises(UnitError, match="divide the position by the wavelength"):
        bump(Input("x", "m"))
    with pytest.raises(UnitError, match="duty"):
        bump(u, duty=Param("d", 0.5, "m"))


@shapes
def test_files(waveform, tmp_path):
    scene = Scene(
        {"e": bump(Input("u"), waveform, Param("duty", 0.5)), "c": carrier(100.0, "half")}
    )
    scene.save(tmp_path / "s.json")
    assert stimlib.load(tmp_path / "s.json").hash == scene.hash


# Carrier ------------------------------------------------------------------------------


def carried(f=158.0, rectify=None, phase=0.0, fs=FS, target="numba", **kw):
    return stimlib.compile(Scene({"c": carrier(f, rectify, phase, **kw)}), fs, target)


def turns(f, fs, n):
    """Exact turns after n samples."""
    return float(Fraction(f) * n / Fraction(fs) % 1)


@pytest.mark.parametrize("f", [158.0, 157.9, 1 / 3, 3999.999])
@pytest.mark.parametrize("fs", mostly({44100.0}, [8000.0, 44100.0, 8000 / 1.001]))
def test_the_phase_is_exact_after_a_day(f, fs):
    """The state is moved on by 24 h, by the increment that the block itself makes."""
    f = min(f, fs / 2 - 0.001)
    proc = carried(f, fs=fs)
    before = proc.state
    proc.process(np.empty((0, 1)))
    word = 2  # header, index, phase, ..
    inc = int(proc.state[word]) - int(before[word])
    n = int(24 * 3600 * fs)
    before[word] = np.uint64((int(before[word]) + n * inc) % 2**64)
    proc.state = before
    y = proc.process(np.empty((0, 400)))[0]
    wanted = np.sin(2 * pi * np.array([turns(f, fs, n + k) for k in range(400)]))
    assert np.abs(y - wanted).max() <= 1e-9
    error = (int(before[word]) / 2**64 - turns(f, fs, n) + 0.5) % 1 - 0.5
    assert abs(2 * pi * error) <= 2 * pi * n * 2.0**-65 + 1e-15 <= 1e-9


@pytest.mark.parametrize("target", ["numba", "python"])
def test_it_starts_at_its_phase(target):
    for phase in (0.0, 1.0, -2.5, 100.0):
        y = carried(158.0, None, phase, target=target).process(np.empty((0, 100)))[0]
        np.testing.assert_allclose(
            y, np.sin(2 * pi * 158 * np.arange(100) / FS + phase), rtol=0, atol=1e-13
        )
        scene = Scene({"c": carrier(Input("f", "Hz"), None, phase)})  # nothing runs before sample 0
        z = stimlib.compile(scene, FS, target).process(np.full((1, 100), 158.0))[0]
        assert_same(y, z)


@pytest.mark.parametrize("rectify", [None, "half", "full"])
def test_a_live_frequency_makes_no_jump(rectify):
    proc = carried(Param("f", 158.0, "Hz"), rectify)
    y = [proc.process(np.empty((0, 333)))]
    proc.set("f", 431.7, ramp=0.05)
    y.append(proc.process(np.empty((0, 900))))
    proc.set("f", 20.0, ramp=0)
    y.append(proc.process(np.empty((0, 500))))
    y = np.concatenate(y, axis=1)[0]
    f = np.r_[
        np.full(333, 158.0),
        158 + (431.7 - 158) * np.minimum(np.arange(1, 901) / 400, 1),
        np.full(500, 20.0),
    ]
    phase = np.r_[0, 2 * pi * np.cumsum(f)[:-1] / FS]
    plain = np.sin(phase)
    wanted = {None: plain, "half": np.maximum(plain, 0), "full": np.abs(plain)}[rectify]
    # from the zero crossings
    away = np.abs(np.sin(phase)) > (1.001 * np.sin(pi * f / FS) if rectify else -1)
    np.testing.assert_allclose(y[away], wanted[away], rtol=0, atol=1e-11)
    assert np.abs(np.diff(y)).max() <= 2 * pi * 432 / FS


@pytest.mark.parametrize("rectify", ["half", "full"])
@pytest.mark.parametrize("f", [1.0, 158.0, 1000.3, 3700.0])
def test_rectified_is_the_mean_around_each_sample(rectify, f):
    """Against the integral of the rectified sine, undone by sin(x)/x so that the line
    at f keeps its amplitude.
    """
    y = carried(f, rectify, 0.3).process(np.empty((0, 3000)))[0]
    t = f * np.arange(3000) / FS + 0.3 / (2 * pi)

    def area(t):
        k, w = np.floor(t), t - np.floor(t)
        half = k * 2 + np.where(w < 0.5, 1 - np.cos(2 * pi * w), 2.0)
        rest = k * 2 + np.where(w < 0.5, 0.0, 1 + np.cos(2 * pi * w))
        return (half if rectify == "half" else half + rest) / (2 * pi)

    q = f / FS
    mean = (area(t + q / 2) - area(t - q / 2)) / q / np.sinc(q)
    np.testing.assert_allclose(y, mean, rtol=0, atol=1e-11 / min(1, q * 1e3))
    assert y.min() >= 0


def test_the_half_wave_keeps_its_line_and_has_fewer_aliases():
    n = 1 << 16
    k = round(158 / FS * n) | 1
    y = carried(k * FS / n, "half").process(np.empty((0, n)))[0]
    assert 2 * np.abs(np.fft.rfft(y)[k]) / n == pytest.approx(0.5, rel=1e-6)
    assert y.mean() == pytest.approx(1 / pi * (1 + (pi * 158 / FS) ** 2 / 6), rel=1e-5)
    point = np.maximum(0, np.sin(2 * pi * k * np.arange(n) / n))
    for top, better in ((0.5, 6), (1000 / FS, 20)):
        assert alias(y, k, top) < alias(point, k, top) - better


@pytest.mark.parametrize("rectify", [None, "half", "full"])
@pytest.mark.parametrize("target", ["numba", "python"])
def test_off_contact_the_phase_goes_on(rectify, target):
    c = np.repeat([1.0, 0.0, np.nan, 1.0, -1.0, 1.0], 70)
    free = carried(157.9, rectify, target=target).process(np.empty((0, c.size)))[0]
    y = carried(157.9, rectify, target=target, contact=Input("c")).process(c[None])[0]
    np.testing.assert_array_equal(y, np.where(c > 0, free, 0.0))


def test_in_enabled_the_phase_stands_still():
    on = np.repeat([1.0, 0.0, 1.0], [50, 100, 80])
    y = stimlib.compile(Scene({"c": enabled(carrier(157.9), by=Input("on"))}), FS).process(
        on[None]
    )[0]
    np.testing.assert_array_equal(y[on > 0], carried(157.9).process(np.empty((0, 130)))[0])


@pytest.mark.parametrize("rectify", [None, "half", "full"])
def test_live_frequencies_are_held_and_the_rest_is_a_fault(rectify):
    scene = Scene({"c": carrier(Input("f", "Hz"), rectify, 0.7)})
    for given_, held in ((9000.0, FS / 2), (np.inf, None), (-5.0, 0.0), (0.0, 0.0), (np.nan, None)):
        y = []
        for target in ("numba", "python"):
            proc = stimlib.compile(scene, FS, target)
            y.append(proc.process(np.full((1, 70), given_))[0])
            assert proc.fault == (("c", 0) if held is None else None)
        assert_same(*y)
        if held is not None:
            assert_same(y[0], stimlib.compile(scene, FS).process(np.full((1, 70), held))[0])
        if held == 0.0:
            np.testing.assert_allclose(y[0], np.sin(0.7), atol=1e-15)


def test_carrier_errors():
    with pytest.raises(BadValue, match="half"):
        carrier(158.0, "positive")
    for f in (-1.0, Param("f", -2.0, "Hz")):
        with pytest.raises(BadValue, match="0 or above"):
            carrier(f)
    with pytest.raises(BadValue, match="not finite"):
        carrier(float("inf"))
    for f in (4000.0, 1e5, Param("f", 4000.0, "Hz")):
        with pytest.raises(BadValue, match="below fs/2 = 4000 Hz"):
            carried(f)
    for f in (Param("f", 158.0), Input("f", "m")):
        with pytest.raises(UnitError, match="in Hz"):
            carrier(f)


def test_zeros_have_no_sign():
    u = np.r_[np.linspace(0.9, 0.6, 100), np.linspace(0.6, 2.0, 100)]
    for waveform in (*WAVEFORMS, TABLE):
        y = bumps(waveform, 0.5).process(u[None])
        assert not (bits(y) == bits(np.array(-0.0))).any()


@pytest.mark.parametrize(
    ("rectify", "name"), [(None, "oscillator or carrier"), ("half", "carrier")]
)
def test_an_error_of_a_sine_names_both_functions_that_make_it(rectify, name):
    with pytest.raises(BadValue, match="^carrier: freq = -5.0 Hz must be 0 or above"):
        carrier(-5.0, rectify)
    with pytest.raises(UnitError, match="^carrier: freq .* must be in Hz"):
        carrier(Input("f"), rectify)
    with pytest.raises(BadValue, match=f"^{name}: freq = 900 Hz does not fit below fs/2 = 500 Hz"):
        stimlib.compile(Scene({"y": carrier(900.0, rectify)}), fs=1000)
