"""Bumps against their integrals in closed form, the carrier against exact
arithmetic.
"""

from fractions import Fraction

import numpy as np
import pytest
from laws import bits, lawful, mostly

import stimlib
from stimlib import Input, Param, Scene
from stimlib.blocks.oscillators import carrier
from stimlib.blocks.surfaces import WAVEFORMS, bump
from stimlib.errors import BadValue, UnitError

FS = 8000.0
U, TOUCH = Input("u"), Input("touch")
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


# Envelopes ----------------------------------------------------------------------------
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
def test_off_contact_it_is_silent_and_contact_begins_where_it_is(waveform):
    y = bumps(waveform, 0.5, contact=TOUCH).process(
        np.array([[1.0, 0.0, 1.0], [0.1, np.nan, 7.2]])[[1, 0]]
    )[0]
    np.testing.assert_allclose(
        y, [*e(waveform, np.array([0.1]), 0.5), 0.0, *e(waveform, np.array([0.2]), 0.5)], atol=1e-14
    )


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


def test_the_half_wave_keeps_its_line_and_has_fewer_aliases():
    n = 1 << 16
    k = round(158 / FS * n) | 1
    y = carried(k * FS / n, "half").process(np.empty((0, n)))[0]
    assert 2 * np.abs(np.fft.rfft(y)[k]) / n == pytest.approx(0.5, rel=1e-6)
    assert y.mean() == pytest.approx(1 / pi * (1 + (pi * 158 / FS) ** 2 / 6), rel=1e-5)
    point = np.maximum(0, np.sin(2 * pi * k * np.arange(n) / n))
    for top, better in ((0.5, 6), (1000 / FS, 20)):
        assert alias(y, k, top) < alias(point, k, top) - better


@pytest.mark.parametrize(
    ("rectify", "wave"),
    [(None, lambda s: s), ("half", lambda s: np.maximum(s, 0.0)), ("full", np.abs)],
)
@pytest.mark.parametrize("phase", [0.0, -2.5, 100.0])
def test_in_contact_it_is_the_sine_from_its_phase(rectify, wave, phase):
    """Away from the zero crossings, over which a rectified one is a mean."""
    touch, sine = (
        np.repeat([1.0, 0.0, np.nan, -1.0, 1.0], 40),
        np.sin(2 * pi * 158 * np.arange(200) / FS + phase),
    )
    away = np.abs(sine) > np.sin(pi * 158 / FS)
    y = carried(158.0, rectify, phase, contact=TOUCH).process(touch[None])[0]
    np.testing.assert_allclose(
        y[away], np.where(touch > 0, wave(sine), 0.0)[away], rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("rectify", [None, "half", "full"])
@pytest.mark.parametrize("phase", [0.0, -2.5, 100.0])
def test_it_is_its_law_at_any_frequency_and_phase(rectify, phase):
    """Fixed ones; live ones below 0 and above fs/2 are held there."""
    for f in (1.0, 158.0, 1000.3, 3700.0):
        lawful(carrier(f, rectify, phase, contact=TOUCH), FS, touch=np.ones(3000))
    live = carrier(Input("f", "Hz"), rectify, phase, contact=TOUCH)
    lawful(live, FS, f=np.repeat([9000.0, -5.0, 0.0, 158.0], 70), touch=np.ones(280))


def test_zeros_have_no_sign():
    u = np.r_[np.linspace(0.9, 0.6, 100), np.linspace(0.6, 2.0, 100)]
    for waveform in (*WAVEFORMS, TABLE):
        y = bumps(waveform, 0.5).process(u[None])
        assert not (bits(y) == bits(np.array(-0.0))).any()


@pytest.mark.parametrize(
    ("make", "error", "match"),
    [
        (lambda: bump(U, duty=0.0), BadValue, "duty"),
        (lambda: bump(U, duty=-0.1), BadValue, "duty"),
        (lambda: bump(U, duty=1.0001), BadValue, "duty"),
        (lambda: bump(U, duty=Param("d", 0.0)), BadValue, "duty"),
        (lambda: bump(U, duty=Param("d", 1.5)), BadValue, "duty"),
        (lambda: bump(U, duty=float("nan")), BadValue, "not finite"),
        (lambda: bump(U, "triangle"), BadValue, "square, sine, sawtooth, half_sine"),
        (lambda: bump(U, sampling="blep"), BadValue, "area, point"),
        (lambda: bump(U, [1.0]), BadValue, "at least 2 values"),
        (lambda: bump(U, []), BadValue, "at least 2 values"),
        (lambda: bump(U, [[0, 1], [1, 0]]), BadValue, "at least 2 values"),
        (lambda: bump(U, [0, 1.1]), BadValue, "must lie in 0 .. 1"),
        (lambda: bump(U, [-0.1, 1]), BadValue, "must lie in 0 .. 1"),
        (lambda: bump(U, [0, np.nan]), BadValue, "is not finite"),
        (lambda: bump(Input("x", "m")), UnitError, "divide the position by the wavelength"),
        (lambda: bump(U, duty=Param("d", 0.5, "m")), UnitError, "duty"),
        (lambda: carrier(158.0, "positive"), BadValue, "half"),
        (lambda: carrier(-1.0), BadValue, "^carrier: freq = -1.0 Hz must be 0 or above"),
        (lambda: carrier(-5.0, "half"), BadValue, "^carrier: freq = -5.0 Hz must be 0 or above"),
        (lambda: carrier(Param("f", -2.0, "Hz")), BadValue, "0 or above"),
        (lambda: carrier(float("inf")), BadValue, "not finite"),
        (
            lambda: carried(4000.0),
            BadValue,
            "^oscillator or carrier: freq = 4000 Hz does not fit below fs/2 = 4000 Hz",
        ),
        (
            lambda: carried(900.0, "half", fs=1000.0),
            BadValue,
            "^carrier: freq = 900 Hz does not fit below fs/2 = 500 Hz",
        ),
        (lambda: carried(Param("f", 4000.0, "Hz")), BadValue, "below fs/2 = 4000 Hz"),
        (lambda: carrier(Param("f", 158.0)), UnitError, "in Hz"),
        (lambda: carrier(Input("f", "m"), "half"), UnitError, "^carrier: freq .* must be in Hz"),
    ],
)
def test_what_makes_no_sense_is_refused(make, error, match):
    with pytest.raises(error, match=match):
        make()
