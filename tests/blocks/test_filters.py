"""Filters against the modes of ``checks.linear``, whose poles are in closed form; a
steady start, delays, differentiators and the tracker.
"""

import math
import re

import closed_forms
import mpmath as mp
import numpy as np
import pytest
from laws import assert_same, compiled, lawful, played, refuses, run
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, SceneError, UnitError, blocks as b, constant
from stimlib.blocks import track, track_velocity
from stimlib.blocks.filters import Filter
from stimlib.checks import linear
from stimlib.design.filters import KINDS, ORDERS

X, M, FREQ = Input("x"), Input("x", "m"), Input("f", "Hz")
FS = 8000.0


def filtered(band, edges, kind, order, fs=1.0):
    """A compiled filter with edges in cycles per sample."""
    block = Filter(X, band, edges[0], edges[1] if len(edges) == 2 else None, order, kind, 1.0, 60.0)
    return stimlib.compile(Scene({"y": block}), fs)


def error(band, edges, kind, order, answers):
    """Largest error of the impulse and step responses, relative to their peaks."""
    n = 20_000 if edges[0] > 1e-4 else 1_000_000
    at, *wanted = answers(*linear.analogue(band, edges, kind, order, 1.0, 60.0), n)
    proc, worst = filtered(band, edges, kind, order), 0.0
    for x, exact in zip((np.eye(1, n), np.ones((1, n))), wanted, strict=True):
        proc.reset()
        y = proc.process(x)[0]
        worst = max(worst, float(np.abs(y[at] - exact).max() / np.abs(y).max()))
    return worst


def everywhere(zeros, poles, gain, n):
    """Both responses at all samples, from their modes."""
    h = linear.digital(zeros, poles, gain).response(n)
    h = np.pad(h, (0, n - h.size))
    return slice(None), h, np.cumsum(h)


def in_60_digits(zeros, poles, gain, n):
    """Both responses at some samples: in the first periods of a narrow band its modes
    cancel by up to 26 digits, and extended precision has 19.
    """
    at = np.unique(np.r_[:4, np.geomspace(5, n - 1, 20).astype(int)])
    with mp.workdps(60):
        s, t = ([mp.mpc(str(v.real), str(v.imag)) for v in row] for row in (poles, zeros))
        direct = mp.mpf(str(gain.real)) * mp.fprod(1 - v for v in t) / mp.fprod(1 - v for v in s)
        z, over = [(1 + v) / (1 - v) for v in s], len(s) - len(t)
        roots = [(1 + v) / (1 - v) for v in t] + [-1] * over
        r = [
            direct * mp.fprod(p - v for v in roots) / mp.fprod(p - q for q in z if q is not p)
            for p in z
        ]
        h, sums = (
            [mp.fsum(a * f(p, int(k)) for a, p in zip(r, z, strict=True)).real for k in at]
            for f in (lambda p, k: p ** (k - 1) * (k > 0), lambda p, k: (p**k - 1) / (p - 1))
        )
    h[0] = direct.real
    return at, np.array(h, float), np.array([v + direct.real for v in sums], float)


FEW = [
    ("lowpass", (1e-6,), "elliptic", 12),
    ("lowpass", (1e-6,), "butterworth", 2),  # 1.5e-16; without second words of its state, 4e-15
    ("lowpass", (0.25,), "butterworth", 7),
    ("lowpass", (0.45,), "bessel", 12),
    ("highpass", (1e-6,), "chebyshev1", 5),
    ("highpass", (0.01,), "elliptic", 7),
    ("bandpass", (0.01, 0.03), "butterworth", 1),
    ("bandpass", (0.001, 0.4), "elliptic", 5),
    ("bandstop", (0.01, 0.03), "bessel", 12),
]
EDGES = {
    "lowpass": [(e,) for e in (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.25, 0.45)],
    "bandpass": (
        [(e, w * e) for e in (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1) for w in (1.01, 1.5, 4)]
        + [(0.25, 0.45), (0.001, 0.4)]
    ),
}
EDGES |= {"highpass": EDGES["lowpass"], "bandstop": EDGES["bandpass"]}


def promised(band, edges, order=0):
    if len(edges) == 1:
        return 1e-15 if order == 2 and edges == (1e-6,) else 1e-13
    low, high = edges
    return 2e-13 + 4e-15 * high / (high - low) + (4e-14 * high / low if band == "bandstop" else 0.0)


@pytest.mark.parametrize(("band", "edges", "kind", "order"), FEW)
def test_samples_are_those_of_the_modes(band, edges, kind, order):
    assert error(band, edges, kind, order, everywhere) <= promised(band, edges, order)


@pytest.mark.stress
@pytest.mark.parametrize("band", EDGES)
@pytest.mark.parametrize("kind", KINDS)
def test_samples_are_those_of_the_modes_everywhere(band, kind):
    for edges in EDGES[band]:
        for order in ORDERS:
            off = error(band, edges, kind, order, in_60_digits)
            assert off <= promised(band, edges), (edges, order)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("order", [1, 4, 12])
def test_gains_of_the_prototypes_are_those_of_their_poles(kind, order):
    """Two routes that meet nowhere: closed forms of the gain, poles in extended
    precision.
    """
    x = np.array([0.1, 0.7, 1.0, 1.3, 4.0])
    zeros, poles, gain = linear.prototype(kind, order, 1.0, 60.0)
    wanted = np.abs(
        gain * np.prod(1j * x[:, None] - zeros, axis=1) / np.prod(1j * x[:, None] - poles, axis=1)
    ).astype(float)
    np.testing.assert_allclose(closed_forms.GAINS[kind](x, order, 1.0, 60.0), wanted, rtol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("band", EDGES)
def test_the_response_keeps_its_digits_at_low_cutoffs(kind, band):
    edges = (1e-5,) if band in ("lowpass", "highpass") else (1e-5, 3e-5)
    proc = filtered(band, edges, kind, 12)
    law = closed_forms.family(band, edges, 12, kind, 1.0, 60.0)
    assert law.error(lambda f: proc.response("y", "x", f), 1.0) <= 1e-9


def test_latency_is_the_group_delay_in_the_middle_of_what_passes():
    outputs = {
        "low": b.lowpass(X, 50, 4),
        "band": b.bandpass(X, 100, 300, 3),
        "rings": b.resonator(X, 158, 9.0),
        "leaks": b.integrate(X, 3000.0),
    }
    middle = np.arctan(np.sqrt(np.tan(np.pi * np.array([100, 300]) / FS).prod())) * FS / np.pi
    proc, step = stimlib.compile(Scene(outputs), FS, "python"), 1e-3
    for name, f in (("low", 0.0), ("band", middle), ("rings", 158.0), ("leaks", 0.0)):
        two = proc.response(name, "x", np.array([f - step, f + step]))
        turn = np.angle(two[0] / two[1]) / (4 * np.pi * step)
        assert abs(proc.latency[name, "x"][0] / FS - turn) < 1e-6 * turn


@pytest.mark.parametrize("target", ["python", "llvm"])
def test_a_filter_ends_in_silence(target):
    """What keeps its states from denormal numbers is not heard."""
    y = played(b.lowpass(X, 100.0), np.eye(1, 3000)[0], target=target)
    assert y[:3].all() and not y[-100:].any()


# Delays and finite responses ---------------------------------------------------------


@pytest.mark.parametrize("target", ["llvm", "python"])
@pytest.mark.parametrize("samples", [1, 5, 63, 64, 65, 200, 999])
def test_it_is_a_shift(samples, target):
    x = np.random.default_rng(5).standard_normal((1, 1000))
    proc = stimlib.compile(Scene({"y": b.delay(X, samples)}), 1000, target)
    for cuts in ((), (1, 2, 9, 70, 71, 199), range(37, 1000, 37)):
        proc.reset()
        np.testing.assert_array_equal(run(proc, x, cuts)[0, samples:], x[0, :-samples])
        assert proc.fault is None
    assert proc.latency["y", "x"] == (samples, samples)


TAPS = {
    n: b.fir(X, np.random.default_rng(n).standard_normal(n)) for n in (1, 2, 7, 8, 9, 64, 65, 500)
}


MOVING = np.random.default_rng(0).standard_normal(1000)
STEPS = np.repeat([0.07, 0.03, 0.08 - 1e-9, 0.13, 1e6], [50, 50, 200, 50, 50])
JUMPS = np.concatenate([np.linspace(0.0, 0.01, 100), STEPS])  # of 0.05 m, and 1 nm less
LAWFUL = [
    *((block, MOVING) for block in TAPS.values()),
    *(
        (make(M, max_jump=most), sign * JUMPS)
        for make in (track, track_velocity)
        for most in (0.05, None)
        for sign in (1, -1)
    ),
    *((track(M, bandwidth=w, max_jump=None), JUMPS) for w in (0.01, 300.0)),
]


def test_taps_and_trackers_are_their_laws():
    """Of any number of taps; a jump invents no movement."""
    for block, x in LAWFUL:
        lawful(block, FS, x=x)


AVERAGED = [
    *(b.moving_average(X, seconds) for seconds in (0.0024, 0.0026, 0.07)),
    b.envelope_follower(X, 0.0, 0.01),
]


def test_averages_and_levels_are_their_laws():
    for block in AVERAGED:
        lawful(block, 1000, x=MOVING[:200])


def test_the_samples_of_an_average_are_limited(monkeypatch):
    monkeypatch.setattr(stimlib.limits, "state_bytes", 100)
    refuses(lambda: b.moving_average(X, 0.02).design(1000), "moving_average.* limits.state_bytes")


@pytest.mark.parametrize("n", [5, 63, 64, 100])
@pytest.mark.parametrize("target", ["python", "llvm"])
def test_a_sample_that_is_not_finite_leaves_an_average_after_its_length(n, target):
    """Rounded up to eight samples where taps are filled up with zeros: 0 times inf."""
    x, taps = np.ones((1, 300)), np.full(n, 1 / n)
    x[0, 10] = np.nan
    for made, first in ((b.moving_average(X, n / 1000), 64), (b.fir(X, taps), math.inf)):
        length = n if n >= first else 8 * math.ceil(n / 8)
        proc = stimlib.compile(Scene({"y": made > -1.0}), 1000, target)  # NaN is not above
        y = run(proc, x, (37,))[0]
        assert np.flatnonzero(y == 0.0).tolist() == list(range(10, 10 + length))


RISE, FALL = np.arange(1, 51) / 10, np.arange(1, 101) / 100
LEVELS = {  # block, rows of its input, samples worked out by hand
    "rises and falls": (
        b.envelope_follower(X, 0.01, 0.1),
        np.repeat([-2.0, 0.0], [50, 100]),
        np.r_[-2 * np.expm1(-RISE), -2 * np.expm1(-5) * np.exp(-FALL)],
    ),
    "half a sample": (b.envelope_follower(X, 0.0005), [2.0], [-2 * np.expm1(-2)]),
}


@pytest.mark.parametrize("name", LEVELS)
def test_a_level_is_that_worked_out_by_hand(name):
    block, x, wanted = LEVELS[name]
    for target in ("llvm", "python"):
        np.testing.assert_allclose(played(block, x, target=target), wanted, rtol=1e-12, atol=1e-14)


LATE = [  # samples
    (lambda: b.fir(X, [1, 2, 1]), 1000, 1),
    (lambda: b.fir(X, [1, 0, -1]), 1000, 1),
    (lambda: b.fir(X, [1, 2, 2, 1]), 1000, 1.5),
    (lambda: b.fir(X, [3.0]), 1000, 0),
    (lambda: b.fir(X, [0, 0, 5.0]), 1000, 2),
    (lambda: b.fir(X, [1, 1, 0, 0]), 1000, 0.5),
    (lambda: b.delay(X, seconds=0.01), 8000, 80),
    (lambda: b.delay(X, seconds=0.01), 44100, 441),
    (lambda: b.delay(X, seconds=0.0016), 1000, 2),
    (lambda: b.delay(X, seconds=0.0005001), 1000, 1),
    (lambda: b.differentiator(X, passband=1000.0), 8000, 64),
]


@pytest.mark.parametrize(("make", "fs", "samples"), LATE)
def test_latency(make, fs, samples):
    assert compiled(make, fs).latency["y", "x"] == (samples, samples)


def test_the_papers_filter_has_order_128_at_8_khz():
    h = played(b.differentiator(X, passband=1000.0), np.eye(1, 300)[0], fs=FS)
    assert np.ptp(np.flatnonzero(h)) <= 128
    # odd: linear phase, nothing at 0 Hz
    np.testing.assert_allclose(h[:129], -h[128::-1], atol=1e-18)


@pytest.mark.parametrize(("fs", "passband", "tol"), [(50.0, 5.0, 0.64), (1e6, 2e4, 1e-6)])
def test_a_default_order_at_either_end_is_that_of_its_law(fs, passband, tol):
    proc = compiled(lambda: b.differentiator(X, passband, tol=tol), fs)
    (law,) = proc.scene.outputs["y"].laws(fs)
    assert law.error(lambda f: proc.response("y", "x", f), fs) <= tol


@pytest.mark.parametrize("fs", [400, 1000, 2000])
def test_a_recommended_pass_band_is_one_that_works(fs):
    e = refused(BadValue, "such as", stimlib.compile, stimlib.scenes.squeeze(), fs, "python")
    passband = float(re.search(r"such as ([\d.]+)", str(e))[1])
    stimlib.compile(stimlib.scenes.squeeze(passband=passband), fs, "python")


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: b.differentiator(X, 100.0, order=3), "differentiator"),
        (lambda: b.differentiator(X, 100.0, tol=1e-12), "differentiator"),
        (lambda: b.differentiator(X, 100.0, 50.0), "differentiator"),
        (lambda: b.pink_noise(1.0, 1, f_low=900.0), "pink_noise"),
        (lambda: b.pinking(X, 1.0, 1e-9), "pinking"),
    ],
)
def test_messages_name_what_was_called(make, name):
    said = str(refused(BadValue, f"^{name}: ", compiled, make))
    assert "_taps" not in said and "_modes" not in said


# A steady start -----------------------------------------------------------------------
ROWS = [[0.2, 0.3, 0.2, 1.0, -0.5, 0.3], [1.0, -0.2, 0.0, 2.0, -1.8, 0.0]]
FILTERS = {
    "fir": lambda x, **o: b.fir(x, [0.3, -1.2, 2.5, 0.1], "1/s", **o),
    "fir of a gain below 0": lambda x, **o: b.fir(x, [-1.0, 0.2], "1", **o),
    "differentiator": lambda x, **o: b.differentiator(x, 100.0, order=64, tol=0.01, **o),
    "delay": lambda x, **o: b.delay(x, samples=9, **o),
    "moving_average": lambda x, **o: b.moving_average(x, 0.02, **o),
    "first_order": lambda x, **o: b.first_order(x, 0.02, **o),
    "integrate": lambda x, **o: b.integrate(x, 30.0, **o),
    "lowpass": lambda x, **o: b.lowpass(x, 20.0, 4, **o),
    "lowpass ripple": lambda x, **o: b.lowpass(x, 20.0, 4, "elliptic", **o),
    "lowpass odd": lambda x, **o: b.lowpass(x, 20.0, 3, "chebyshev1", **o),
    "highpass": lambda x, **o: b.highpass(x, 20.0, **o),
    "highpass ripple": lambda x, **o: b.highpass(x, 20.0, 2, "elliptic", **o),
    "bandpass": lambda x, **o: b.bandpass(x, 20.0, 50.0, **o),
    "bandpass ripple": lambda x, **o: b.bandpass(x, 20.0, 50.0, 2, "elliptic", **o),
    "bandpass odd": lambda x, **o: b.bandpass(x, 20.0, 50.0, 3, "elliptic", **o),
    "bandstop": lambda x, **o: b.bandstop(x, 20.0, 50.0, 2, "chebyshev1", **o),
    "sos": lambda x, **o: b.sos(x, ROWS, **o),
    "resonator": lambda x, **o: b.resonator(x, 50.0, 2.0, **o),
    "notch": lambda x, **o: b.notch(x, 50.0, 2.0, **o),
    "mode": lambda x, **o: b.mode(x, 50.0, 2.0, **o),
} | {
    f"svf {m}": lambda x, m=m, **o: b.svf(x, 50.0, 2.0, m, **o)
    for m in ("lowpass", "bandpass", "highpass", "notch")
}
CREEP = {
    "element": lambda f, **o: b.compliance_kelvin_voigt(f, 200.0, tau=0.02, **o),
    "chain": lambda f, **o: b.compliance_generalized_kelvin_voigt(
        f, [(50.0, 0.01), (20.0, 0.03)], k0=70.0, **o
    ),
}


@pytest.mark.parametrize("name", FILTERS | CREEP)
def test_a_steady_start_is_the_end_of_a_long_hold(name):
    """The samples that come after 4 s at the first value, without the 4 s."""
    make, x = (FILTERS | CREEP)[name], M if name in FILTERS else Input("f", "N")
    moved = 0.02 + 1e-3 * np.random.default_rng(1).standard_normal(300).cumsum()
    moved[:100] = 0.02
    long = played(make(x), np.r_[np.full(4000, moved[0]), moved])[4000:]
    steady = played(make(x, onset="steady"), moved, target="python")
    np.testing.assert_allclose(steady, long, rtol=0, atol=3e-13 * np.abs(long).max())
    np.testing.assert_array_equal(steady[:100], steady[0])
    np.testing.assert_array_equal(played(make(x, onset="steady"), moved), steady)


@pytest.mark.parametrize(("onset", "least", "most"), [("step", 40, 60), ("steady", 0, 1e-12)])
def test_what_a_hand_at_20_mm_does_in_its_first_sample(onset, least, most):
    """The default is a step from 0: 48.5 m/s of a differentiator at 8 kHz, and none
    with a steady start; others are steady by themselves.
    """
    made = {
        "d": b.differentiator(M, passband=1000, onset=onset),
        "y": b.highpass(M, 1.0, onset=onset),
        "v": b.velocity(M),
        "t": b.track(M),
        "s": b.springpot(M, 3.0, 0.5),
        "m": b.maxwell(M, 3.0, tau=1.0),
    }
    y = np.abs(played(made, np.full(200, 0.02), fs=FS, target="python"))
    assert least <= y[0].max() <= most
    np.testing.assert_allclose(y[1].max(), 0.02 if least else 0.0, rtol=1e-3)
    np.testing.assert_allclose(y[2:].max(axis=1), [0.0, 0.02, 0.0, 0.0], atol=1e-17)


def test_a_steady_start_of_a_noise_is_at_sample_0():
    """And not where the noise began, some samples before."""
    noise = b.white_noise(1)
    late, now = played({"y": b.delay(noise, samples=2, onset="steady"), "z": noise}, 4)
    assert late.tolist() == [now[0], now[0], now[0], now[1]]


def tracked(x, fs=FS, **words):
    """Position and velocity of one tracker."""
    return played({"y": track(M, **words), "z": track_velocity(M, **words)}, x, fs=fs)


# The tracker --------------------------------------------------------------------------


def reports(rate, fs, seconds, speed, jitter=0.0, seed=0):
    """A straight movement at this speed, reported at a rate with jitter, and held
    between reports.
    """
    n = int(fs * seconds)
    at = np.arange(int(rate * seconds) + 2) / rate
    at[1:] += jitter / rate * np.random.default_rng(seed).uniform(-0.5, 0.5, at.size - 1)
    return speed * at[np.maximum(np.searchsorted(at, np.arange(n) / fs, side="right") - 1, 0)]


@pytest.mark.parametrize("place", [1 / 30, -0.0])
@pytest.mark.parametrize("bandwidth", [5.0, 20.0, 3000.0])
def test_a_position_held_is_reached_exactly(bandwidth, place):
    """And a zero keeps no sign of its own."""
    moved = 0.02 + 0.004 * np.random.default_rng(1).standard_normal(3000)
    y, v = tracked(np.r_[moved, np.full(int(320 * FS / bandwidth), place)], bandwidth=bandwidth)
    assert y.any() and v.any()
    assert_same(np.array([y[-1], v[-1]]), np.array([place + 0.0, 0.0]))


@pytest.mark.parametrize(("bandwidth", "fs"), [(5.0, 1000.0), (20.0, 8000.0), (200.0, 1000.0)])
def test_a_ramp_is_followed_at_its_speed_behind_the_stated_latency(bandwidth, fs):
    words, n = {"bandwidth": bandwidth}, int(9 * fs / bandwidth)
    proc = stimlib.compile(Scene({"y": track(M, **words), "v": track_velocity(M, **words)}), fs)
    y, v = proc.process(0.1 * np.arange(n)[None] / fs)
    late, q = proc.latency["y", "x"][0], 2 * np.pi * bandwidth / fs
    assert v[-1] == pytest.approx(0.1, rel=1e-12)
    assert (n - 1) - y[-1] * fs / 0.1 == pytest.approx(late, rel=1e-9)
    assert late == pytest.approx(2 / q - 0.5, abs=q / 50 + 1e-9)
    assert proc.latency["v", "x"][0] == pytest.approx(late + 0.5)
    assert (proc.units["y"], proc.units["v"]) == ("m", "m/s")


@pytest.mark.parametrize(("rate", "bandwidth"), [(70.0, 20.0), (70.0, 10.0), (125.0, 20.0)])
def test_the_ripple_of_reports_is_as_documented(rate, bandwidth):
    v = tracked(reports(rate, FS, 3.0, 0.1), bandwidth=bandwidth)[1, int(2 * FS) :]
    assert 0.7 < np.abs(v / 0.1 - 1).max() / (3.3 * (bandwidth / rate) ** 2) < 1


def test_jittered_reports_make_no_spikes():
    x = reports(70.0, FS, 3.0, 0.1, jitter=0.5)
    assert np.diff(x).max() * FS > 80 * 0.1  # what holding and differencing feels
    assert np.abs(tracked(x, bandwidth=10.0)[1, int(FS) :] - 0.1).max() < 0.03


# What is refused ----------------------------------------------------------------------
REFUSED = [
    (lambda: b.lowpass(X, 100, kind="butter"), "kind = 'butter'; choose .*butterworth, bessel"),
    (lambda: b.lowpass(X, 100, order=13), "order = 13 must .*to 12"),
    (lambda: b.lowpass(X, 100, order=0), "order = 0 must .*to 12"),
    (lambda: b.highpass(X, -1), "highpass: cutoff = -1 .*above 0"),
    (lambda: b.bandpass(X, 300, 100), "low = 300 Hz .*100 Hz"),
    (lambda: b.bandstop(X, 1, 2, ripple=70), "ripple = 70 dB .*60 dB"),
    (lambda: b.lowpass(X, Param("f", 10.0, "Hz")), "design number"),
    (lambda: b.sos(X, [1.0, 2.0]), r"got shape \(2,\)"),
    (lambda: b.sos(X, np.empty((0, 6))), r"got shape \(0, 6\)"),
    (lambda: b.sos(X, [[1, 0, 0, 1, 0, 0]] * 13), r"got shape \(13, 6\)"),
    (lambda: b.sos(X, [[1, 0, 0, 1, -2.1, 1.2]]), "section 0 is not stable"),
    (lambda: b.sos(X, [[1, 0, 0, 1, 0, 0], [1, 0, 0, 1, -1, 0]]), "section 1 is not stable"),
    (lambda: b.sos(X, [[1, 0, 0, -1, 1, 0]]), "section 0 is not stable"),
    (lambda: b.resonator(X, 0, 2), "resonator: freq = 0.0 .*above 0"),
    (lambda: b.svf(X, 100, mode="low"), "mode = 'low'; choose one of lowpass"),
    (lambda: b.svf(X, Param("f", -3.0, "Hz")), "cutoff = -3.0 must be above 0"),
    (lambda: b.integrate(X, -1), "leak = -1 1/s .*or above"),
    (lambda: b.envelope_follower(X, attack=-0.01), "attack = -0.01 must .*or above"),
    (lambda: b.envelope_follower(X, release=-0.01), "release = -0.01 must .*or above"),
    (lambda: b.lowpass(X, 500), "lowpass: cutoff = 500 .*raise fs"),
    (lambda: b.bandpass(X, 400, 600), "bandpass: high = 600 .*below fs/2"),
    (lambda: b.notch(X, 700, 1.0), "notch: freq = 700 .*not fit"),
    (lambda: b.notch(X, 400, 0.7), "notch: width = 571.429 .*below fs/2"),
    (lambda: b.svf(X, 700), "svf: cutoff = 700 .*not fit"),
    (lambda: b.moving_average(X, 1e-4), "moving_average: 0.0001 s is .*a sample"),
    (
        lambda: b.lowpass(X, 100, 12, "elliptic", attenuation=1e4),
        "no elliptic .*attenuation",
    ),
    (lambda: b.resonator(X, 1e-300, 1e300), "numbers are beyond what .*can hold"),
    (lambda: b.sos(X, [[1e300, 0, 0, 1e-300, 0, 0]]), "numbers are beyond what .*can hold"),
    (lambda: b.svf(X, Input("f", "m")), "must be in Hz", UnitError),
    (lambda: b.svf(X, 100, Input("q", "m")), "q .* must have no unit", UnitError),
    (lambda: b.lowpass(X, 20.0, onset="rest"), "lowpass: onset = 'rest'; .*steady, step"),
    (lambda: b.delay(X, 3, onset=""), "delay: onset = ''; choose one of"),
    (lambda: b.maxwell(M, 3.0, tau=1.0, onset="rest"), "maxwell: onset = 'rest'; choose one of"),
    (lambda: b.integrate(X, onset="steady"), "integrate: the response to .*steady start"),
    (
        lambda: b.compliance_generalized_kelvin_voigt(
            constant(1.0, "N/m") * X, [], k0=1.0, b=2.0, onset="steady"
        ),
        "the response to a .*without end",
    ),
    *(
        (lambda t=t, w=w: t(M, **w), next(iter(w)))
        for t in (track, track_velocity)
        for w in (
            {"bandwidth": 0.0},
            {"bandwidth": -1.0},
            {"bandwidth": float("nan")},
            {"max_jump": 0.0},
            {"max_jump": -0.1},
        )
    ),
    (lambda: track(M, bandwidth=Param("b", 20.0)), "cannot be the signal"),
    (lambda: track_velocity(M, bandwidth=Param("b", 20.0)), "cannot be the signal"),
    (lambda: track(M, bandwidth=500.0), "fit below fs/2"),
    (lambda: track_velocity(M, bandwidth=500.0), "fit below fs/2"),
    (
        lambda: compiled(track(M, contact=Input("c"))).response("y", "x", 1.0),
        "not linear",
        SceneError,
    ),
]


@pytest.mark.parametrize("given", REFUSED, ids=lambda given: given[1])
def test_what_makes_no_sense_is_refused(given):
    refuses(*given)
