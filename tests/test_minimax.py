"""The minimax designs: every figure they claim, by other routes (mpmath, extended
precision, linear programming).
"""

import itertools
import math
import re

import mpmath as mp
import numpy as np
import pytest
from refusals import refused
from scipy.optimize import linprog

from stimlib.design import filters, noise
from stimlib.design.filters import differentiator_order, differentiator_taps
from stimlib.design.noise import cholesky, noise_modes, stationary_covariance

TOLERANCES = (0.1, 0.01, 0.001, 1e-4)
SECTIONS = {  # fs/f_low: first-order sections for the tolerances above
    100: (3, 5, 6, 8),
    800: (4, 6, 8, 10),
    1000: (4, 6, 8, 10),
    4800: (5, 7, 10, 12),
    8000: (5, 8, 10, 13),
    19200: (6, 9, 11, 14),
    48000: (6, 9, 12, 15),
    192000: (7, 10, 14, 17),
}
RATES = [(fs, f_low) for fs in (1e3, 8e3, 48e3, 192e3) for f_low in (0.1, 1.0, 10.0)] + [
    (20.0, 1.0)
]


def modes_error_db(modes, w, slope=1.0):
    """Largest deviation of |H|^2 w^slope from one, dB, of the modes as they are, in
    extended precision.
    """
    w = np.asarray(w, np.longdouble)[:, None]
    e, r = modes.e.astype(np.longdouble), modes.r.astype(np.longdouble)
    real, imag = 1 - (1 - e) * np.cos(w), (1 - e) * np.sin(w)
    size = real**2 + imag**2
    power = (modes.d + (r * real / size).sum(1)) ** 2 + (r * imag / size).sum(1) ** 2
    return float(np.max(np.abs(10 * np.log10(power * w[:, 0] ** slope))))


def band(fs, f_low, points=3001):
    """Log-spaced pass band of the low-pass with dense ends, rad/sample."""
    low, high = 2 * np.pi * f_low / fs, 2 * np.pi * 0.45
    return np.concatenate(
        [np.geomspace(low, high, points), np.linspace(high / 2, high, 1000)]
    ).clip(low, high)


def relative_errors(design, fs, passband, stopband, points=800):
    """(pass band, stop band) errors of the taps in extended precision, on points dense
    at both ends of each band.
    """
    taps, middle = design.taps.astype(np.longdouble), len(design.taps) // 2
    k = np.arange(len(taps)) - middle

    def gain(f):
        w = 2 * np.pi * f.astype(np.longdouble) / fs
        # imaginary part of D e^(iwM)
        blocks = [np.sin(-block[:, None] * k) @ taps for block in np.array_split(w, 10)]
        return np.concatenate(blocks)

    ends = (1 - np.cos(np.linspace(0, np.pi, points))) / 2
    f = passband * ends[1:]
    in_band = np.max(np.abs(gain(f) / (2 * np.pi * f) - 1))
    if stopband is None:
        return float(in_band), 0.0
    stop = np.max(np.abs(gain(stopband + (fs / 2 - stopband) * ends))) / (2 * np.pi * passband)
    return float(in_band), float(stop)


# --- 3 dB/oct low-pass ----------------------------------------------------------------


WIDEST = [(1e9, 1, 0.1, 11), (1, 0.225, 0.1, 1)]
MANY = [(fs, 1, tol, n) for fs in SECTIONS for tol, n in zip(TOLERANCES, SECTIONS[fs], strict=True)]


@pytest.mark.parametrize(("fs", "f_low", "tol", "n"), MANY + WIDEST)
def test_number_of_sections(fs, f_low, tol, n):
    assert len(noise_modes(fs, f_low, tol).e) == n


SLOPES = [-3.0, -1.0, 0.5, 1.6]
BANDS = [
    *itertools.product(RATES, TOLERANCES, [1.0]),
    *itertools.product([(1000.0, 1.0)], [1e-8, 1e-6, 0.5, 3, 100], [1.0]),
    *itertools.product([(20.0, 1.0)], [1e-4], SLOPES),
    *itertools.product([(8000.0, 1.0)], [0.05], SLOPES),
]


@pytest.mark.parametrize(("rates", "tol", "slope"), BANDS)
def test_tolerance_is_met_with_the_fewest_sections(rates, tol, slope):
    modes, w = noise_modes(*rates, tol, slope), band(*rates)
    assert np.all(np.diff(modes.e) > 0) and modes.e[0] > 0 and modes.e[-1] < 2
    error = modes_error_db(modes, w, slope)
    assert 0.995 * modes.error_db <= error <= min(tol, modes.error_db * 1.001) * (1 + 1e-3)
    low, n = 2 * math.pi * rates[1] / rates[0], len(modes.e)
    assert n == 1 or noise._minimax_modes(low, n - 1, slope).error_db > tol


@pytest.mark.parametrize(
    ("fs", "f_low", "tol"), [(192e3, 0.1, 1e-4), (8e3, 1, 0.01), (1e3, 10, 1e-8)]
)
def test_gain_in_forty_digits(fs, f_low, tol):
    modes, worst = noise_modes(fs, f_low, tol), 0.0
    with mp.workdps(40):
        for w in np.geomspace(2 * np.pi * f_low / fs, 0.9 * np.pi, 200).clip(None, 0.9 * np.pi):
            delay, pairs = mp.expj(-mp.mpf(w)), zip(modes.e, modes.r, strict=True)
            h = modes.d + mp.fsum(r / (1 - (1 - mp.mpf(e)) * delay) for e, r in pairs)
            worst = max(worst, abs(20 * mp.log10(abs(h) * mp.sqrt(w))))
    assert 0.9 * modes.error_db < worst <= tol


def test_tolerance_out_of_reach_names_the_one_in_reach():
    error = refused(ValueError, "24 sections, which reach", noise_modes, 192000, 0.1, 1e-6)
    reach = float(re.search(r"reach (\S+) dB", str(error))[1])
    assert len(noise_modes(192000, 0.1, 1.01 * reach).e) == 24


def test_modes_are_cached_and_read_only():
    modes = noise_modes(8000, 1, 0.01)
    assert noise_modes(8000, 1, 0.01) is modes
    for array in (modes.e, modes.r):
        assert array.dtype == np.float64 and not array.flags.writeable


# --- stationary state -----------------------------------------------------------------


@pytest.mark.parametrize(("fs", "f_low"), RATES)
@pytest.mark.parametrize("tol", TOLERANCES)
def test_cholesky_of_stationary_covariance(fs, f_low, tol):
    """Against the closed form L_ik = sqrt(1 - p_k^2)/(1 - p_k p_i) prod_(j<k) (p_j -
    p_i)/(1 - p_j p_i).
    """
    e = noise_modes(fs, f_low, tol).e
    p = stationary_covariance(e)
    lower, scale = cholesky(p), np.sqrt(np.diag(p))
    size = np.outer(scale, scale)
    np.testing.assert_allclose(lower @ lower.T / size, p / size, atol=1e-15)
    products = np.cumprod(np.hstack([np.ones((len(e), 1)), ((e[:, None] - e) * p)[:, :-1]]), axis=1)
    exact = np.tril(p / scale * products)
    np.testing.assert_allclose(lower / scale[:, None], exact / scale[:, None], atol=2e-13)
    assert np.all(np.diag(lower) > 0.1 * scale)


# --- FIR differentiator ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("fs", "passband", "stopband", "order", "in_band", "stop_db"),
    [
        (8000, 1000, 1500, 128, 5.1e-7, -125.8),
        (8000, 3600, None, 128, 4.2e-10, -math.inf),
        (48000, 1000, 1500, 768, 5.4e-7, -125),
        (192000, 1000, 1500, 3072, 5.4e-7, -125),
        (192000, 86400, None, 128, 4.2e-10, -math.inf),
        (3000, 375, 562.5, 48, 2.8e-3, -51),
        (3000, 1000, None, 48, 1.3e-12, -math.inf),
        (8000, 1000, 1200, 128, 1.5e-3, -56),
        (8000, 1000, 1500, 16, 0.106, -19.5),
        (8000, 1000, 1500, 2, 0.59, -4.6),
        (8000, 1000, 2500, 128, 1e-12, -240),  # more taps than float64 can use
        (8000, 3600, None, 512, 1e-12, -math.inf),
        (8000, 1, None, 128, 1e-14, -math.inf),
        (8000, 1000, 1001, 512, 0.6, -5),
    ],
)
def test_differentiator(fs, passband, stopband, order, in_band, stop_db):
    design = differentiator_taps(fs, passband, stopband, order)
    assert design.taps.shape == (order + 1,) and design.taps.dtype == np.float64
    assert np.array_equal(design.taps, -design.taps[::-1]) and design.taps[order // 2] == 0.0
    assert design.error <= in_band and design.stop_db <= stop_db
    error, stop = relative_errors(design, fs, passband, stopband, 800 if order < 3000 else 300)
    assert error <= 1.005 * design.error + 1e-13
    assert stop <= 1.005 * 10 ** (design.stop_db / 20) + 1e-13
    if 1e-12 < in_band < 0.5 and stopband != 1001:
        assert error >= 0.97 * design.error  # dense enough to see the peaks
    assert np.max(np.abs(design.taps)) <= 2 * np.pi * fs


def test_differentiator_in_forty_digits():
    design = differentiator_taps(8000, 1000, 1500, 128)
    with mp.workdps(40):
        for f in (0.001, 1.0, 123.4, 999.0, 1000.0, 1500.0, 3000.0, 3999.0):
            w = 2 * mp.pi * mp.mpf(f) / 8000
            response = mp.fsum(tap * mp.expj(-w * n) for n, tap in enumerate(design.taps))
            ideal = mp.mpc(0, 2 * mp.pi * f) * mp.expj(-64 * w) if f <= 1000 else 0
            assert abs(response - ideal) / (2 * mp.pi * min(f, 1000)) <= 1.001 * design.error


def test_differentiator_differentiates():
    fs, order, w = 8000, 128, 2 * np.pi * 200
    taps, t = differentiator_taps(fs, 1000, 1500, order).taps, np.arange(400) / fs
    np.testing.assert_allclose(np.convolve(3 * t + 2, taps, "valid"), 3, rtol=1e-6)
    slope = w * np.cos(w * (t[order:] - order / 2 / fs))
    np.testing.assert_allclose(np.convolve(np.sin(w * t), taps, "valid"), slope, atol=1e-6 * w)


@pytest.mark.parametrize(
    ("fs", "passband", "stopband", "order"),
    [(8000, 1000, 1500, 16), (8000, 2500, 3500, 24), (8000, 3000, None, 12)],
)
def test_differentiator_is_the_best(fs, passband, stopband, order):
    """The same problem as a linear program on a grid, whose optimum is just below the
    true one.
    """
    half = order // 2
    w_pass, w_stop = filters._band_edges("", fs, passband, stopband)
    passing = np.linspace(1e-4, w_pass, 40 * half)
    stopping = np.zeros(0) if w_stop is None else np.linspace(w_stop, np.pi, 40 * half)
    w, size = np.r_[passing, stopping], np.r_[passing, np.full(stopping.size, w_pass)]
    sines = 2 * np.sin(w[:, None] * np.arange(1, half + 1)) / size[:, None]
    wanted, ones = (w <= w_pass).astype(float), np.ones((w.size, 1))
    program = linprog(
        c=[0.0] * half + [1.0],
        A_ub=np.vstack([np.hstack([sines, -ones]), np.hstack([-sines, -ones])]),
        b_ub=np.concatenate([wanted, -wanted]),
        bounds=(None, None),
    )
    design = differentiator_taps(fs, passband, stopband, order)
    assert max(design.error, 10 ** (design.stop_db / 20)) == pytest.approx(program.fun, rel=5e-3)


@pytest.mark.parametrize(
    ("fs", "passband", "stopband", "tol", "order"),
    [
        (8000, 1000, 1500, 1e-6, 122),
        (8000, 1000, 1500, 5.1e-7, 128),
        (8000, 1000, 1500, 1e-10, 212),
        (8000, 3600, None, 1e-8, 110),
        (8000, 3600, None, 5e-10, 128),
        (8000, 3900, None, 1e-3, None),
        (48000, 1000, 1500, 1e-3, 338),
        (8000, 1000, 1500, 0.9, 2),
        (8000, 1e-6, None, 1e-6, 2),
    ],
)
def test_differentiator_order(fs, passband, stopband, tol, order):
    found = differentiator_order(fs, passband, stopband, tol)
    assert order is None or found == order
    assert differentiator_taps(fs, passband, stopband, found).error <= tol
    if found > 2:
        fewer = differentiator_taps(fs, passband, stopband, found - 2)
        assert max(fewer.error, 10 ** (fewer.stop_db / 20)) > tol


def test_unused_taps_are_zero():
    """Taps that float64 leaves undetermined would amplify noise between the bands
    without bound.
    """
    taps = differentiator_taps(8000, 1000, 2500, 1024).taps
    gain = np.abs(np.fft.rfft(taps, 1 << 14))
    assert np.count_nonzero(taps) < 120 and np.max(gain) < 2 * 2 * np.pi * 1000


def test_stop_band_from_half_the_rate_is_none():
    one, other = (differentiator_taps(8000, 3600, edge, 64) for edge in (4000, None))
    assert np.array_equal(one.taps, other.taps) and one.stop_db == -math.inf


@pytest.mark.parametrize(
    ("made", "arguments", "words"),
    [
        (noise_modes, (0, 1, 0.1), "sample rate"),
        (noise_modes, (-8000, 1, 0.1), "sample rate"),
        (noise_modes, (math.inf, 1, 0.1), "sample rate"),
        (noise_modes, (math.nan, 1, 0.1), "sample rate"),
        (noise_modes, (8000, 0, 0.1), "f_low"),
        (noise_modes, (8000, -1, 0.1), "f_low"),
        (noise_modes, (8000, math.nan, 0.1), "f_low"),
        (noise_modes, (8000, 1801, 0.1), "1800 Hz"),
        (noise_modes, (8000, 1e-6, 0.1), "8e-06"),
        (noise_modes, (8000, 1, 0), "tol_db"),
        (noise_modes, (8000, 1, 1e-9), "1e-08 dB"),
        (noise_modes, (8000, 1, math.inf), "tol_db"),
        (noise_modes, (8000, 1, math.nan), "tol_db"),
        (noise_modes, (8000, 1, 0.1, 0.0), "white noise"),
        (noise_modes, (8000, 1, 0.1, 3.1), "from -3 to 3"),
        (noise_modes, (8000, 1, 0.1, -3.1), "from -3 to 3"),
        (noise_modes, (8000, 1, 0.1, math.nan), "from -3 to 3"),
        (differentiator_taps, (0, 1000, 1500, 128), "sample rate"),
        (differentiator_taps, (math.nan, 1000, 1500, 128), "sample rate"),
        (differentiator_taps, (8000, 0, 1500, 128), "passband"),
        (differentiator_taps, (8000, 4000, None, 128), "fs/2 = 4000 Hz"),
        (differentiator_taps, (8000, math.nan, None, 128), "passband"),
        (differentiator_taps, (8000, 1000, 1000, 128), "stopband"),
        (differentiator_taps, (8000, 1000, 900, 128), "stopband"),
        (differentiator_taps, (8000, 1000, 4001, 128), "stopband"),
        (differentiator_taps, (8000, 1000, math.nan, 128), "stopband"),
        (differentiator_taps, (8000, 1000, 1500, 127), "even number"),
        (differentiator_taps, (8000, 1000, 1500, 0), "even number"),
        (differentiator_taps, (8000, 1000, 1500, 12.5), "even number"),
        (differentiator_taps, (8000, 1000, 1500, 8194), "8192"),
        (differentiator_order, (8000, 1000, 1500, 0), "tol"),
        (differentiator_order, (8000, 1000, 1500, 1), "tol"),
        (differentiator_order, (8000, 1000, 1500, 1e-11), "from 1e-10"),
        (differentiator_order, (8000, 1000, 1000, 1e-3), "stopband"),
        (differentiator_order, (8000, 1000, 1001, 1e-6), "above 8192"),
        (differentiator_order, (8000, 3999.9, None, 1e-3), "above 8192"),
        (cholesky, ([[1.0, 0.0], [2.0, 1.0]],), "leading 2 x 2 block is not positive definite"),
        (cholesky, ([[math.nan]],), "leading 1 x 1"),
    ],
)
def test_what_makes_no_sense_is_refused(made, arguments, words):
    refused(ValueError, f"^{made.__name__}: .*{re.escape(words)}", made, *arguments)
