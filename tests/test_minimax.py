"""The minimax designs: every figure they claim, by other routes (mpmath, extended
precision, linear programming).
"""

import math
import re
import time

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


def modes_error_db(modes, w):
    """Largest deviation of |H|^2 w from one, dB, of the modes as they are, in extended
    precision.
    """
    w = np.asarray(w, np.longdouble)[:, None]
    e, r = modes.e.astype(np.longdouble), modes.r.astype(np.longdouble)
    real, imag = 1 - (1 - e) * np.cos(w), (1 - e) * np.sin(w)
    size = real**2 + imag**2
    power = (modes.d + (r * real / size).sum(1)) ** 2 + (r * imag / size).sum(1) ** 2
    return float(np.max(np.abs(10 * np.log10(power * w[:, 0]))))


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


@pytest.mark.parametrize("k1", [0.9, 0.1, 1e-3, 1e-6, 1e-9])
def test_elliptic_functions(k1):
    with mp.workdps(40):
        m = 1 - mp.mpf(k1) ** 2
        x = np.array([0.02, 0.2, 0.5, 0.77, 0.98])
        sc, dn = (
            [mp.ellipfun(kind, xi * mp.ellipk(m), m=m) for xi in map(mp.mpf, x)]
            for kind in ("sc", "dn")
        )
        log_sc, log_nd = [float(mp.log(v)) for v in sc], [float(-mp.log(v)) for v in dn]
        np.testing.assert_allclose(noise._log_elliptic(x, k1, -1), log_sc, rtol=0, atol=5e-15)
        np.testing.assert_allclose(noise._log_elliptic(x, k1, +1), log_nd, rtol=0, atol=5e-15)


@pytest.mark.parametrize("ratio", SECTIONS)
def test_number_of_sections(ratio):
    assert tuple(len(noise_modes(ratio, 1, tol).e) for tol in TOLERANCES) == SECTIONS[ratio]


@pytest.mark.parametrize(("fs", "f_low"), RATES)
def test_tolerance_is_met_with_the_fewest_sections(fs, f_low):
    w = band(fs, f_low)
    for tol in TOLERANCES:
        modes = noise_modes(fs, f_low, tol)
        assert np.all(np.diff(modes.e) > 0) and modes.e[0] > 0 and modes.e[-1] < 2
        assert modes_error_db(modes, w) <= min(tol, modes.error_db * 1.001)
        assert modes_error_db(modes, w) >= 0.995 * modes.error_db
        if len(modes.e) > 1:
            assert noise._minimax_modes(2 * math.pi * f_low / fs, len(modes.e) - 1).error_db > tol


@pytest.mark.parametrize(
    ("fs", "f_low", "tol"), [(192e3, 0.1, 1e-4), (8e3, 1, 0.01), (1e3, 10, 1e-8)]
)
def test_gain_in_forty_digits(fs, f_low, tol):
    modes = noise_modes(fs, f_low, tol)
    worst = 0.0
    with mp.workdps(40):
        for w in np.geomspace(2 * np.pi * f_low / fs, 0.9 * np.pi, 200).clip(None, 0.9 * np.pi):
            delay = mp.expj(-mp.mpf(w))
            h = modes.d + mp.fsum(
                r / (1 - (1 - mp.mpf(e)) * delay) for e, r in zip(modes.e, modes.r, strict=True)
            )
            worst = max(worst, abs(20 * mp.log10(abs(h) * mp.sqrt(w))))
    assert 0.9 * modes.error_db < worst <= tol


@pytest.mark.parametrize("n", [1, 2, 5, 8, 13, 17, 24])
def test_error_is_equal_ripple(n):
    w_low = 2 * math.pi / 48000
    design, reference = noise._minimax_design(w_low, n)
    ripple = noise._log_ripple(design, reference)
    assert len(reference) == 2 * n + 2  # one more than two roots for each section and the gain
    assert np.all(ripple[1:] * ripple[:-1] < 0)
    assert np.max(np.abs(ripple)) < 1.001 * np.min(np.abs(ripple))


@pytest.mark.parametrize(("ratio", "n"), [(20, 2), (8000, 8), (8000, 13), (192000, 17), (1e9, 24)])
def test_modes_are_the_product_of_sections(ratio, n):
    design, _ = noise._minimax_design(2 * math.pi / ratio, n)
    e, z, gain = noise._leaks_and_gain(design)
    modes = noise._minimax_modes(2 * math.pi / ratio, n)
    with mp.workdps(40):
        for w in np.geomspace(1 / ratio, 3.1, 60):
            back = mp.expj(mp.mpf(w))
            product = gain * mp.fprod(
                (back - 1 + zk) / (back - 1 + ek) for ek, zk in zip(e, z, strict=True)
            )
            terms = zip(modes.e, modes.r, strict=True)
            parallel = modes.d + mp.fsum(rk * back / (back - 1 + ek) for ek, rk in terms)
            assert abs(parallel / product - 1) < 1e-13


@pytest.mark.parametrize("slope", [-3.0, -1.0, 0.5, 1.6])
@pytest.mark.parametrize(("fs", "tol"), [(20, 1e-4), (8000, 0.05)])
def test_any_slope_is_met_with_the_fewest_sections(fs, tol, slope):
    modes = noise_modes(fs, 1, tol, slope)
    w = band(fs, 1)
    z = np.exp(1j * w)[:, None]
    h = modes.d + np.sum(modes.r / (1 - (1 - modes.e) / z), axis=1)
    assert np.abs(10 * np.log10(np.abs(h) ** 2 * w**slope)).max() <= tol * 1.001
    assert np.all(np.diff(modes.e) > 0) and modes.e[0] > 0 and modes.e[-1] < 2
    n = len(modes.e)
    assert n == 1 or noise._minimax_modes(2 * math.pi / fs, n - 1, slope).error_db > tol


@pytest.mark.parametrize("slope", [0.3, 1.3])
def test_error_of_any_slope_is_equal_ripple(slope):
    design, reference = noise._minimax_design(2 * math.pi / 8000, 6, slope)
    ripple = noise._log_ripple(design, reference, slope)
    assert len(reference) == 14 and np.all(ripple[1:] * ripple[:-1] < 0)
    assert np.max(np.abs(ripple)) < 1.001 * np.min(np.abs(ripple))


def test_pole_at_zero_is_moved_aside():
    design = np.array([-6.0, -4.0, 0.0, 1.0, 0.0])  # log b = 0 is a pole at zero
    e, z, gain = noise._leaks_and_gain(design)
    assert np.min(np.abs(1 - e)) == pytest.approx(1e-8)
    r, d = noise._partial_fractions(e, z, gain)
    w = np.linspace(0.01, 3, 50)
    power = np.abs(noise._response(e, r, d, w)) ** 2 * w
    np.testing.assert_allclose(
        power, np.exp(noise._log_ripple(design, np.log(np.tan(w / 2)))), rtol=1e-6
    )


def test_recursion_has_the_response():
    """The loop in the docstring of Modes, on an impulse."""
    modes, n = noise_modes(100, 5, 0.01), 4096
    q, h = np.zeros_like(modes.e), np.zeros(n)
    for i in range(n):
        q += (i == 0) - modes.e * q
        h[i] = modes.d * (i == 0) + np.sum(modes.r * q)
    w = 2 * np.pi * np.arange(n // 2 + 1) / n
    inside = (w >= 0.1 * np.pi) & (w <= 0.9 * np.pi)
    deviation = 20 * np.log10(
        np.abs(np.fft.rfft(h)) * np.sqrt(w), where=inside, out=np.zeros_like(w)
    )
    assert np.max(np.abs(deviation)) <= modes.error_db * 1.001
    p = stationary_covariance(modes.e)
    variance = modes.d**2 + 2 * modes.d * modes.r.sum() + modes.r @ p @ modes.r
    assert np.sum(h**2) == pytest.approx(variance, rel=1e-12)


@pytest.mark.parametrize("tol", [1e-8, 1e-6, 0.5, 3, 100])
def test_range_of_tolerances(tol):
    modes = noise_modes(1000, 1, tol)
    assert modes_error_db(modes, band(1000, 1)) <= min(tol, modes.error_db * 1.001)


def test_widest_and_narrowest_pass_band():
    assert len(noise_modes(1e9, 1, 0.1).e) == 11
    assert len(noise_modes(1, 0.225, 0.1).e) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0, 1, 0.1), "sample rate"),
        ((-8000, 1, 0.1), "sample rate"),
        ((math.inf, 1, 0.1), "sample rate"),
        ((math.nan, 1, 0.1), "sample rate"),
        ((8000, 0, 0.1), "f_low"),
        ((8000, -1, 0.1), "f_low"),
        ((8000, math.nan, 0.1), "f_low"),
        ((8000, 1801, 0.1), "1800 Hz"),
        ((8000, 1e-6, 0.1), "8e-06"),
        ((8000, 1, 0), "tol_db"),
        ((8000, 1, 1e-9), "1e-08 dB"),
        ((8000, 1, math.inf), "tol_db"),
        ((8000, 1, math.nan), "tol_db"),
        ((8000, 1, 0.1, 0.0), "white noise"),
        ((8000, 1, 0.1, 3.1), "from -3 to 3"),
        ((8000, 1, 0.1, -3.1), "from -3 to 3"),
        ((8000, 1, 0.1, math.nan), "from -3 to 3"),
    ],
)
def test_bad_low_pass(arguments, words):
    refused(ValueError, f"^noise_modes: .*{re.escape(words)}", noise_modes, *arguments)


def test_tolerance_out_of_reach_names_the_one_in_reach():
    error = refused(ValueError, "24 sections, which reach", noise_modes, 192000, 0.1, 1e-6)
    reach = float(re.search(r"reach (\S+) dB", str(error)).group(1))
    assert len(noise_modes(192000, 0.1, 1.01 * reach).e) == 24


def test_modes_are_cached_and_read_only():
    modes = noise_modes(8000, 1, 0.01)
    assert noise_modes(8000, 1, 0.01) is modes
    for array in (modes.e, modes.r):
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


# --- stationary state -----------------------------------------------------------------


@pytest.mark.parametrize(("fs", "f_low"), RATES)
def test_cholesky_of_stationary_covariance(fs, f_low):
    """Against the closed form L_ik = sqrt(1 - p_k^2)/(1 - p_k p_i) prod_(j<k) (p_j -
    p_i)/(1 - p_j p_i).
    """
    for tol in TOLERANCES:
        e = noise_modes(fs, f_low, tol).e
        p = stationary_covariance(e)
        lower = cholesky(p)
        scale = np.sqrt(np.diag(p))
        np.testing.assert_allclose(
            lower @ lower.T / np.outer(scale, scale), p / np.outer(scale, scale), atol=1e-15
        )
        ratios = np.array(
            [[(ei - ej) * p[i, j] for j, ej in enumerate(e)] for i, ei in enumerate(e)]
        )
        products = np.cumprod(np.hstack([np.ones((len(e), 1)), ratios[:, :-1]]), axis=1)
        exact = np.tril(p / scale * products)
        np.testing.assert_allclose(lower / scale[:, None], exact / scale[:, None], atol=2e-13)
        assert np.all(np.diag(lower) > 0.1 * scale)


def test_stationary_covariance_is_stationary():
    e = noise_modes(8000, 1, 1e-4).e
    p = stationary_covariance(e)
    np.testing.assert_allclose((1 - e)[:, None] * p * (1 - e) + 1, p, rtol=1e-14)
    with mp.workdps(40):
        assert float(1 / (1 - (1 - mp.mpf(e[0])) ** 2)) == pytest.approx(p[0, 0], rel=1e-15)


def test_cholesky():
    # the upper triangle is not read
    a = np.array([[4.0, 99.0, 99.0], [2.0, 5.0, 99.0], [6.0, 7.0, 30.0]])
    full = np.tril(a) + np.tril(a, -1).T
    np.testing.assert_allclose(cholesky(a), np.linalg.cholesky(full), rtol=1e-14)
    refused(
        ValueError,
        "leading 2 x 2 block is not positive definite",
        cholesky,
        [[1.0, 0.0], [2.0, 1.0]],
    )
    refused(ValueError, "leading 1 x 1", cholesky, [[math.nan]])


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
            size = 2 * mp.pi * min(f, 1000)
            assert abs(response - ideal) / size <= 1.001 * design.error


def test_differentiator_differentiates():
    fs, order = 8000, 128
    taps = differentiator_taps(fs, 1000, 1500, order).taps
    t = np.arange(400) / fs
    slope = np.convolve(3 * t + 2, taps, "valid")
    np.testing.assert_allclose(slope, 3, rtol=1e-6)
    omega = 2 * np.pi * 200
    derivative = np.convolve(np.sin(omega * t), taps, "valid")
    np.testing.assert_allclose(
        derivative, omega * np.cos(omega * (t[order:] - order / 2 / fs)), atol=1e-6 * omega
    )


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
    k = np.arange(1, half + 1)
    sines = np.vstack(
        [
            2 * np.sin(passing[:, None] * k) / passing[:, None],
            2 * np.sin(stopping[:, None] * k) / w_pass,
        ]
    )
    wanted = np.repeat([1.0, 0.0], [len(passing), len(stopping)])
    ones = np.ones((len(wanted), 1))
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
    design = differentiator_taps(8000, 1000, 2500, 1024)
    assert np.count_nonzero(design.taps) < 120
    w = np.linspace(0, np.pi, 1000)
    gain = np.abs(np.exp(-1j * w[:, None] * np.arange(1025)) @ design.taps)
    assert np.max(gain) < 2 * 2 * np.pi * 1000


def test_stop_band_from_half_the_rate_is_none():
    with_edge, without = (
        differentiator_taps(8000, 3600, 4000, 64),
        differentiator_taps(8000, 3600, None, 64),
    )
    assert np.array_equal(with_edge.taps, without.taps) and with_edge.stop_db == -math.inf


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0, 1000, 1500, 128), "sample rate"),
        ((math.nan, 1000, 1500, 128), "sample rate"),
        ((8000, 0, 1500, 128), "passband"),
        ((8000, 4000, None, 128), "fs/2 = 4000 Hz"),
        ((8000, math.nan, None, 128), "passband"),
        ((8000, 1000, 1000, 128), "stopband"),
        ((8000, 1000, 900, 128), "stopband"),
        ((8000, 1000, 4001, 128), "stopband"),
        ((8000, 1000, math.nan, 128), "stopband"),
        ((8000, 1000, 1500, 127), "even number"),
        ((8000, 1000, 1500, 0), "even number"),
        ((8000, 1000, 1500, 12.5), "even number"),
        ((8000, 1000, 1500, 8194), "8192"),
    ],
)
def test_bad_differentiator(arguments, words):
    refused(
        ValueError, f"^differentiator_taps: .*{re.escape(words)}", differentiator_taps, *arguments
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((8000, 1000, 1500, 0), "tol"),
        ((8000, 1000, 1500, 1), "tol"),
        ((8000, 1000, 1500, 1e-11), "from 1e-10"),
        ((8000, 1000, 1000, 1e-3), "stopband"),
        ((8000, 1000, 1001, 1e-6), "above 8192"),
        ((8000, 3999.9, None, 1e-3), "above 8192"),
    ],
)
def test_bad_differentiator_order(arguments, words):
    refused(
        ValueError, f"^differentiator_order: .*{re.escape(words)}", differentiator_order, *arguments
    )


# --- time -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "design",
    [
        lambda: noise_modes(48000, 1, 0.001),
        lambda: noise_modes(192000, 0.1, 1e-4),
        lambda: differentiator_taps(8000, 1000, 1500, 128),
        lambda: differentiator_taps(8000, 3600, None, 128),
    ],
)
def test_design_is_quick(design):
    """A few milliseconds; the bound leaves room for a busy machine."""
    spent = []
    for _ in range(5):
        for cache in (
            noise_modes,
            noise._minimax_modes,
            differentiator_taps,
            filters._exchange,
        ):
            cache.cache_clear()
        start = time.perf_counter()
        design()
        spent.append(time.perf_counter() - start)
    assert min(spent) < 0.1
