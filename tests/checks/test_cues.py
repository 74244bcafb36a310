"""Cues of movements whose cues are known in closed form."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from stimlib.analysis.physical_cues import cues
from stimlib.errors import BadValue

A = 0.01  # m


def movement(w, n, fs, phase=0.0, offset=0.0):
    t = np.arange(n) / fs
    return offset + A * np.sin(w * t + phase), A * w * np.cos(w * t + phase)


def springpot(w, n, fs, chi, alpha, phase=0.0):
    """Steady answer of chi D^alpha to A sin(w t + phase)."""
    return chi * w**alpha * A * np.sin(w * np.arange(n) / fs + phase + alpha * np.pi / 2)


# Frequency domain ---------------------------------------------------------------------
@given(
    alpha=st.floats(0.0, 1.0),
    periods=st.floats(2.0, 40.0),
    phase=st.floats(-math.pi, math.pi),
    n=st.integers(300, 3000),
    offset=st.floats(-0.1, 0.1),
    push=st.floats(-20, 20),
)
def test_springpot_of_any_length(alpha, periods, phase, n, offset, push):
    fs, chi = 1000.0, 120.0
    w = 2 * np.pi * periods * fs / n
    y, _ = movement(w, n, fs, phase, offset)
    c = cues(y, springpot(w, n, fs, chi, alpha, phase) + push, fs)
    size, angle = chi * w**alpha, alpha * np.pi / 2
    assert c.frequency == pytest.approx(w / (2 * np.pi), rel=1e-9)
    wanted = [np.cos(angle), np.sin(angle), np.sin(angle), angle]
    assert [c.k_S / size, c.k_L / size, c.b_L * w / size, c.phi] == pytest.approx(wanted, abs=1e-7)


@pytest.mark.parametrize(
    ("alpha", "k_S", "k_L", "phi", "W", "hann"),
    [
        (0.25, 272.85, 110.88, 0.38599, 146.474e-3, (277.29, 114.87)),
        (0.5, 206.94, 206.08, 0.78333, 207.566e-3, (212.44, 212.12)),
        (0.75, 111.81, 272.17, 1.18102, 258.267e-3, (115.41, 277.08)),
    ],
)
def test_a_springpot_that_is_moved_from_rest(alpha, k_S, k_L, phi, W, hann):
    """10 mm, 1 Hz, 3 s: a DFT over the three periods, by hand, and what it leaves of
    the beginning: 1 to 2 % of the stiffness.
    """
    n, fs, w = 3000, 1000.0, 2 * np.pi
    y, v = movement(w, n, fs)
    # Gruenwald and Letnikov: (-1)^j (alpha over j)
    memory = np.cumprod(np.r_[1.0, 1 - (1 + alpha) / np.arange(1, n)])
    f = 300 * (fs / w) ** alpha * np.convolve(memory, y)[:n]
    bins = np.fft.rfft(f)[3] / np.fft.rfft(y)[3]
    c, ours = cues(y, f, fs, v, window="none"), cues(y, f, fs, v)
    assert [c.k_S, c.k_L, c.phi] == pytest.approx([bins.real, bins.imag, np.angle(bins)], rel=1e-9)
    assert [c.k_S, c.k_L, c.phi] == pytest.approx([k_S, k_L, phi], rel=3e-5)
    work = np.maximum(f * v, 0) / fs
    # the table's sum of rectangles; ours is of trapezoids
    assert np.sum(work) == pytest.approx(W, rel=1e-5)
    assert c.W == ours.W == pytest.approx(W - work[-1] / 2, rel=1e-5)
    assert [ours.k_S, ours.k_L] == pytest.approx(hann, rel=3e-5)
    material = 300 * np.exp(1j * alpha * (np.pi - w / fs) / 2)  # GL is half a sample late
    assert abs(complex(*hann) - material) < 0.002 * 300 < 0.015 * 300 < abs(bins - material)


def test_both_ratios():
    n, fs = 5000, 1000.0
    w = 2 * np.pi * 1.3
    y, _ = movement(w, n, fs)
    c = cues(y, springpot(w, n, fs, 100.0, 0.25), fs)
    loss = np.tan(np.pi / 8)
    assert (c.loss_factor, c.eta_as_printed) == pytest.approx((loss, 1 / loss), rel=1e-9)


def test_kelvin_voigt():
    n, fs, k, b = 4321, 1000.0, 250.0, 3.0
    w = 2 * np.pi * 0.9
    y, v = movement(w, n, fs, 0.7, 0.02)
    c = cues(y, k * y + b * v, fs)
    assert (c.k_S, c.k_L, c.b_L) == pytest.approx((k, w * b, b), rel=1e-9)
    for n in range(4000, 4020):  # a spring has none, not that of rounding
        y, _ = movement(w, n, fs, 0.7, 0.02)
        assert cues(y, k * y, fs).b_L == 0.0


def test_records_of_any_size_have_the_cues_of_their_size():
    """Exactly, as sizes are powers of 2: no square overflows or vanishes."""
    t = np.arange(4321) / 1000
    y, f = 0.01 + 0.01 * np.sin(2 * np.pi * t), 3.0 * np.cos(2 * np.pi * t + 0.4)
    usual = cues(y, f, 1000)
    powers = {"W": (1, 1), "frequency": (0, 0), "loss_factor": (0, 0), "eta_as_printed": (0, 0)}
    powers |= {"phi": (0, 0), **dict.fromkeys(("f_max", "f_mean"), (0, 1))}
    powers |= dict.fromkeys(("y_max", "y_mean", "v_max", "v_mean"), (1, 0))
    for up, hard in ((990, 990), (-990, -990), (-500, 400), (600, 0)):
        for name, v in cues(np.ldexp(y, up), np.ldexp(f, hard), 1000)._asdict().items():
            i, j = powers.get(name, (-1, 1))
            with np.errstate(all="ignore"):
                assert v == np.ldexp(getattr(usual, name), i * up + j * hard), name


def test_no_force_is_no_error():
    y, _ = movement(2 * np.pi, 4000, 1000.0)
    c = cues(y, np.zeros(4000), 1000.0)
    assert c.k_S == c.k_L == c.b_L == c.W == c.k_fit == c.b_fit == 0.0
    assert np.isnan([c.loss_factor, c.f_max, c.f_mean, c.k_I]).all()


# Time domain --------------------------------------------------------------------------
@pytest.mark.parametrize("alpha", [0.0, 0.25, 1.0])
def test_work_over_whole_periods(alpha):
    """W = A^2 |k| ((pi/2 + phi) sin phi + cos phi) per period: the area of the positive
    part of f v.
    """
    fs, w, phi, size = 8000.0, 2 * np.pi, alpha * np.pi / 2, 80.0 * (2 * np.pi) ** alpha
    wanted = 3 * A**2 * size * ((np.pi / 2 + phi) * np.sin(phi) + np.cos(phi))
    for n, rel in ((24_000, 1e-3), (24_001, 1e-6)):  # one sample short of three periods, and whole
        y, v = movement(w, n, fs, 0.3)
        f = springpot(w, n, fs, 80.0, alpha, 0.3)
        assert cues(y, f, fs, v=v).W == pytest.approx(wanted, rel=rel)
        assert cues(y, f, fs).W == pytest.approx(wanted, rel=1e-3)


def test_slopes_over_whole_periods_are_storage_and_loss():
    fs, n = 1000.0, 5000
    w = 2 * np.pi
    y, v = movement(w, n, fs)
    f = springpot(w, n, fs, 100.0, 0.5)
    c = cues(y, f, fs, v=v)
    assert (c.k_fit, c.b_fit) == pytest.approx((c.k_S, c.b_L), rel=1e-9)
    assert cues(y, f, fs).b_fit == pytest.approx(c.b_L, rel=1e-4)


def test_peaks():
    """Three presses of different depth on a spring; the small bump in between is no
    peak.
    """
    fs = 1000.0
    t = np.arange(3000) / fs
    y = np.choose(np.minimum(t.astype(int), 2), [0.01, 0.02, 0.03]) * np.sin(np.pi * t) ** 2
    y[2990:2994] += 1e-5
    c = cues(y, 500 * y, fs)
    largest, mean = (c.y_max, c.f_max), (c.y_mean, c.f_mean)
    assert [*largest, *mean] == pytest.approx([0.03, 15.0, 0.02, 10.0], rel=1e-5)
    assert (c.v_max, c.v_mean) == pytest.approx((0.03 * np.pi, 0.02 * np.pi), rel=1e-4)
    assert c.k_I == pytest.approx(500) and c.k_fit == pytest.approx(500)
    assert c.W == pytest.approx(0.5 * 500 * (0.01**2 + 0.02**2 + 0.03**2), rel=1e-3)
    assert cues(y, 500 * y, fs, prominence=0.5).y_mean == pytest.approx(0.025, rel=1e-5)


def test_the_initial_stiffness_is_that_of_the_first_force_peak():
    fs, n = 1000.0, 4000
    y, v = movement(2 * np.pi, n, fs, -np.pi / 2, A)
    f = (100 * y + 10 * v) * np.linspace(1.0, 0.5, n)  # it softens
    first = int(np.argmax(f[:1000]))
    assert cues(y, f, fs).k_I == pytest.approx(f[first] / y[first])


def test_a_single_press():
    """Half a period: no cue of a frequency, all others; a dashpot's force ends at 0."""
    t = np.arange(500) / 1000
    y, v = 0.01 * np.sin(2 * np.pi * t), 0.02 * np.pi * np.cos(2 * np.pi * t)
    c = cues(y, 300 * y, 1000.0, v=v, single=True)
    assert c.k_peak == pytest.approx(300, rel=1e-12) and c.k_fit == pytest.approx(300, rel=1e-12)
    assert c.f_max == pytest.approx(3.0) and c.y_max == pytest.approx(0.01)
    assert c.W == pytest.approx(0.5 * 300 * 0.01**2, rel=1e-4)
    nans = {name for name, value in c._asdict().items() if math.isnan(value)}
    none = {"v_max", "v_mean"}  # a velocity that only falls has no peak
    assert nans == {"frequency", "k_S", "k_L", "loss_factor", "eta_as_printed", "b_L", "phi"} | none
    c = cues(y, 5 * v, 1000.0, v=v, single=True)
    assert c.k_peak == pytest.approx(5 * 2 * np.pi, rel=1e-3)
    c = cues(y - 0.008, 300 * y, 1000.0, v=v, single=True)  # largest, not farthest from 0
    assert c.k_peak == pytest.approx(3.0 / 0.002, rel=1e-9)
    whole = movement(2 * np.pi, 3000, 1000.0)[0]
    assert cues(whole, whole, 1000.0)[7:] == cues(whole, whole, 1000.0, single=True)[7:]


# Errors -------------------------------------------------------------------------------
Y, V = movement(2 * np.pi, 3000, 1000.0)


@pytest.mark.parametrize(
    ("y", "f", "kw", "match"),
    [
        (Y[:5], Y[:5], {}, "at least 8"),
        ([], [], {}, "at least 8"),
        (Y, Y[:-1], {}, "3000 samples and f has 2999"),
        (Y, Y, {"v": V[1:]}, "v has 2999"),
        (Y[None], Y, {}, "one row"),
        (np.where(np.arange(3000) == 7, np.nan, Y), Y, {}, r"y\[7\] is not finite"),
        (Y, np.where(np.arange(3000) == 9, np.inf, Y), {}, r"f\[9\] is not finite"),
        (np.full(3000, 0.02), Y, {}, "does not move"),
        (np.zeros(3000), Y, {}, "does not move"),
        (Y[:1700], Y[:1700], {}, "1.70 periods"),
        (np.linspace(0, 0.01, 3000), Y, {}, "periods"),
        (Y, Y, {"fs": 0.0}, "fs"),
        (Y, Y, {"fs": np.inf}, "fs"),
        (Y, Y, {"prominence": 0.0}, "prominence"),
        (Y, Y, {"prominence": 2}, "prominence"),
        (Y, Y, {"window": "boxcar"}, "hann, none"),
    ],
)
def test_errors(y, f, kw, match):
    with pytest.raises(BadValue, match=match) as told:
        cues(y, f, **{"fs": 1000.0, **kw})
    assert str(told.value).startswith("cues: ")  # and not of cues_of


def test_exactly_two_periods_are_enough():
    assert cues(Y[:2000], 2 * Y[:2000], 1000.0).k_S == pytest.approx(2.0, rel=1e-9)
