"""Bumps against their integrals in closed form."""

import numpy as np
import pytest
from laws import alias, bits

import stimlib
from stimlib import Input, Param, Scene
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
    ],
)
def test_what_makes_no_sense_is_refused(make, error, match):
    with pytest.raises(error, match=match):
        make()
