"""Recursive filters against the modes of ``checks.linear``, whose poles are in closed
form, and what they refuse.
"""

import mpmath as mp
import numpy as np
import pytest
from laws import lawful, played
from scipy import signal
from scipy.optimize import brentq

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnitError
from stimlib import blocks as b
from stimlib.blocks.filters import Cascade, Filter
from stimlib.checks import linear
from stimlib.checks.verification import verify
from stimlib.design import responses
from stimlib.design.filters import GAINS, KINDS, ORDERS, designed

X = Input("x")


def filtered(band, edges, kind, order, fs=1.0):
    """A compiled filter with edges in cycles per sample."""
    block = Filter(X, band, edges[0], edges[1] if len(edges) == 2 else None, order, kind, 1.0, 60.0)
    return stimlib.compile(Scene({"y": block}), fs)


def error(band, edges, kind, order):
    """Largest error of the impulse and step responses, relative to their peaks."""
    n = 20_000 if edges[0] > 1e-4 else 1_000_000
    h = exact(band, edges, kind, order, n)
    proc, worst = filtered(band, edges, kind, order), 0.0
    for x, wanted in ((np.eye(1, n), h), (np.ones((1, n)), np.cumsum(h))):
        proc.reset()
        y = proc.process(x)[0]
        worst = max(worst, float(np.abs(y - wanted).max() / np.abs(y).max()))
    return worst


def exact(band, edges, kind, order, n):
    """The impulse response from its modes."""
    h = linear.digital(*linear.analogue(band, edges, kind, order, 1.0, 60.0)).response(n)
    return np.pad(h, (0, n - h.size))


FEW = [
    ("lowpass", (1e-6,), "elliptic", 12),
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


def promised(band, edges):
    if len(edges) == 1:
        return 1e-13
    low, high = edges
    return 2e-13 + 4e-15 * high / (high - low) + (4e-14 * high / low if band == "bandstop" else 0.0)


@pytest.mark.parametrize(("band", "edges", "kind", "order"), FEW)
def test_samples_are_those_of_the_modes(band, edges, kind, order):
    assert error(band, edges, kind, order) <= promised(band, edges)


@pytest.mark.stress
@pytest.mark.parametrize("band", EDGES)
@pytest.mark.parametrize("kind", KINDS)
def test_samples_are_those_of_the_modes_everywhere(band, kind):
    for edges in EDGES[band]:
        for order in ORDERS:
            assert error(band, edges, kind, order) <= promised(band, edges), (edges, order)


def test_what_a_low_cutoff_adds_is_not_rounded_away():
    """1.5e-16 was seen; without the second word of either state it is 4e-15 and
    more.
    """
    assert error("lowpass", (1e-6,), "butterworth", 2) <= 1e-15


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
    np.testing.assert_allclose(GAINS[kind](x, order, 1.0, 60.0), wanted, rtol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("band", EDGES)
def test_the_response_keeps_its_digits_at_low_cutoffs(kind, band):
    edges = (1e-5,) if band in ("lowpass", "highpass") else (1e-5, 3e-5)
    proc = filtered(band, edges, kind, 12)
    law = responses.family(band, edges, 12, kind, 1.0, 60.0)
    assert law.error(lambda f: proc.response("y", "x", f), 1.0) <= 1e-9


def test_sections_given_by_scipy_do_what_they_do_there():
    rows = signal.butter(5, [0.1, 0.3], "bandpass", output="sos")
    x = np.random.default_rng(1).standard_normal(2000)
    y = played(b.sos(X, rows), x, fs=8000.0)
    assert np.abs(y - signal.sosfilt(rows, x)).max() <= 1e-13 * np.abs(y).max()


def test_latency_is_the_group_delay_in_the_middle_of_what_passes():
    outputs = {
        "low": b.lowpass(X, 50, 4),
        "band": b.bandpass(X, 100, 300, 3),
        "rings": b.resonator(X, 158, 9.0),
    }
    outputs["leaks"] = b.integrate(X, 3000.0)
    middle = (
        np.arctan(np.sqrt(np.tan(np.pi * 100 / 8000) * np.tan(np.pi * 300 / 8000))) * 8000 / np.pi
    )
    proc = stimlib.compile(Scene(outputs), 8000, "python")
    for name, f in (("low", 0.0), ("band", middle), ("rings", 158.0), ("leaks", 0.0)):
        step = 1e-3
        turn = np.angle(np.divide(*proc.response(name, "x", np.array([f - step, f + step])))) / (
            2 * np.pi * 2 * step
        )
        assert abs(proc.latency[name, "x"][0] / 8000 - turn) < 1e-6 * turn


def test_poles_that_nearly_meet_are_two_and_the_sharpest_run_last():
    t = np.tan(np.pi * 0.01)
    # 1e-8 more, and both are real
    edges = 0.01, np.arctan(far := t * (3 + 8**0.5) * (1 - 1e-8)) / np.pi
    ((_, (_, _, product)),) = designed("bandpass", edges, 1, "butterworth", 1.0, 60.0)
    assert float(product) == pytest.approx(t * far, rel=1e-12)
    quality = [
        float(d0) ** 0.5 / float(d1)
        for _, (_, d1, d0) in designed("bandpass", (0.01, 0.03), 5, "elliptic", 1.0, 60.0)
    ]
    assert quality == sorted(quality)


def test_filtered_noise_is_proven():
    """verify holds a filter against the closed form of its gain."""
    scene = Scene(
        {
            "y": b.bandpass(b.white_noise(1), 100, 300, 2, "elliptic"),
            "z": b.lowpass(b.white_noise(2), 500, 3),
        }
    )
    result = stimlib.render(scene, {}, fs=8000, seconds=4)
    proof = verify(scene, {}, result)
    laws = [c for c in proof.checks if c.name == "Filter: physical law"]
    assert proof.passed and [c.text for c in laws] == [
        "elliptic bandpass of order 2",
        "butterworth lowpass of order 3",
    ]
    assert max(c.measured for c in laws) < 1e-13


SETTINGS = [(part / 2, q) for part in np.linspace(0.01, 0.95, 20) for q in (1.0, 5.0, 60.0)]


@pytest.mark.parametrize("make", [b.resonator, b.notch])
@pytest.mark.parametrize("fs", [1.0, 8000.0])
def test_a_resonance_has_the_width_and_the_ring_of_its_docstring(make, fs):
    """At 60 settings: the -3 dB edges are freq/q apart, and the poles shrink by the
    stated time constant.
    """
    for part, q in SETTINGS:
        block = make(X, part * fs, q)
        p, s = block.design(fs)

        def above_half(r, p=p):
            return abs(complex(Cascade.transfer(p, np.exp(2j * np.pi * r)))) ** 2 - 0.5

        edges = [
            brentq(above_half, *span, xtol=1e-15, rtol=1e-14)
            for span in ((part, 0.5 - 1e-13), (1e-6 * part, part))
        ]
        assert edges[0] - edges[1] == pytest.approx(part / q, rel=1e-9)
        if (turn := np.pi * part / q) < np.pi / 4:
            shrink = np.exp(-np.arctanh(np.tan(turn)))
            h = []
            for x in (1.0, 0.0, 0.0, 0.0, 0.0):
                y, s = Cascade.step(p, s, x)
                h.append(y)
            # h[n+2] = a h[n+1] - (shrink of a sample)^2 h[n], of two equations
            product = (h[3] ** 2 - h[2] * h[4]) / (h[2] ** 2 - h[1] * h[3])
            assert product == pytest.approx(shrink**2, rel=1e-9)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: b.lowpass(X, 100, kind="butter"),
            "kind = 'butter'; choose one of butterworth, bessel",
        ),
        (lambda: b.lowpass(X, 100, order=13), "order = 13 must be from 1 to 12"),
        (lambda: b.lowpass(X, 100, order=0), "order = 0 must be from 1 to 12"),
        (lambda: b.highpass(X, -1), "highpass: cutoff = -1 Hz must be above 0"),
        (lambda: b.bandpass(X, 300, 100), "low = 300 Hz must be below high = 100 Hz"),
        (
            lambda: b.bandstop(X, 1, 2, ripple=70),
            "ripple = 70 dB must be above 0, and below attenuation = 60 dB",
        ),
        (lambda: b.lowpass(X, Param("f", 10.0, "Hz")), "design number"),
        (lambda: b.sos(X, [1.0, 2.0]), r"got shape \(2,\)"),
        (lambda: b.sos(X, np.empty((0, 6))), r"got shape \(0, 6\)"),
        (lambda: b.sos(X, [[1, 0, 0, 1, 0, 0]] * 13), r"got shape \(13, 6\)"),
        (lambda: b.sos(X, [[1, 0, 0, 1, -2.1, 1.2]]), "section 0 is not stable"),
        (lambda: b.sos(X, [[1, 0, 0, 1, 0, 0], [1, 0, 0, 1, -1, 0]]), "section 1 is not stable"),
        (lambda: b.sos(X, [[1, 0, 0, -1, 1, 0]]), "section 0 is not stable"),
        (lambda: b.resonator(X, 0, 2), "resonator: freq = 0.0 must be above 0"),
        (lambda: b.svf(X, 100, mode="low"), "mode = 'low'; choose one of lowpass"),
        (lambda: b.svf(X, Param("f", -3.0, "Hz")), "cutoff = -3.0 must be above 0"),
        (lambda: b.integrate(X, -1), "leak = -1 1/s must be 0 or above"),
        (lambda: b.envelope_follower(X, attack=-0.01), "attack = -0.01 s must be 0 or above"),
        (lambda: b.envelope_follower(X, release=-0.01), "release = -0.01 s must be 0 or above"),
        (
            lambda: b.lowpass(X, 500),
            "lowpass: cutoff = 500 Hz does not fit below fs/2 = 500 Hz; lower it, or raise fs",
        ),
        (lambda: b.bandpass(X, 400, 600), "bandpass: high = 600 Hz does not fit below fs/2"),
        (lambda: b.notch(X, 700, 1.0), "notch: freq = 700 Hz does not fit"),
        (lambda: b.notch(X, 400, 0.7), "notch: width = 571.429 Hz does not fit below fs/2"),
        (lambda: b.svf(X, 700), "svf: cutoff = 700 Hz does not fit"),
        (lambda: b.moving_average(X, 1e-4), "moving_average: 0.0001 s is less than half a sample"),
        (
            lambda: b.lowpass(X, 100, 12, "elliptic", attenuation=1e5),
            "no elliptic filter of order 12 has these edges, ripple and attenuation",
        ),
        (lambda: b.resonator(X, 1e-300, 1e300), "numbers are beyond what a float can hold"),
        (
            lambda: b.sos(X, [[1e300, 0, 0, 1e-300, 0, 0]]),
            "numbers are beyond what a float can hold",
        ),
        (lambda: b.svf(X, Input("f", "m")), "must be in Hz"),
        (lambda: b.svf(X, 100, Input("q", "m")), "q .* must have no unit"),
    ],
)
def test_what_makes_no_sense_or_does_not_fit_the_sample_rate_is_told(make, text):
    with pytest.raises((BadValue, UnitError), match=text):
        stimlib.compile(Scene({"y": make()}), 1000)


# Live ---------------------------------------------------------------------------------
def test_a_live_filter_has_the_samples_of_60_digits():
    """cutoff/fs from 0 to 1/2 at one sample each; of the trapezoidal rule, solved for
    the integrals' inputs.
    """
    r, k = (
        np.array([0.01, 0.4, 0.1, 0.5, 0.0, 0.25, 1e-6, 0.25]),
        np.array([1.0, 0.1, 2.0, 0.5, 1.0, 1.0, 1e-3, 1.0]),
    )
    x = np.array([1.0, 0, 0, 0, 1, 0, 0, 0])
    wanted: dict[str, list] = {m: [] for m in ("lowpass", "bandpass", "highpass", "notch")}
    with mp.workdps(40):
        s1 = s2 = mp.mpf(0)
        for ri, q, xi in zip(r.tolist(), (1 / k).tolist(), x.tolist(), strict=True):
            si, co, ki = mp.sinpi(ri), mp.cospi(ri), 1 / mp.mpf(q)
            # of v1 = s1 + g (x - k v1 - v2), v2 = s2 + g v1
            v1 = (co * co * s1 + si * co * (xi - s2)) / (1 + ki * si * co)
            v2 = s2 + (si / co * v1 if co else xi - s2)
            s1, s2 = 2 * v1 - s1, 2 * v2 - s2
            for mode, v in (
                ("lowpass", v2),
                ("bandpass", ki * v1),
                ("highpass", xi - ki * v1 - v2),
                ("notch", xi - ki * v1),
            ):
                wanted[mode].append(float(v))
    blocks = {m: b.svf(X, Input("f", "Hz"), Input("q"), m) for m in wanted}
    y = played(blocks, {"x": x, "f": r, "q": 1 / k}, fs=1.0)
    np.testing.assert_allclose(y, list(wanted.values()), rtol=0, atol=5e-15)


def test_no_movement_of_the_cutoff_makes_energy():
    """s1^2 + s2^2 never grows without input, whatever cutoff and q do; hardly any
    damping.
    """
    from stimlib.blocks.resonance import Svf, SvfState

    p, _ = b.svf(X, Input("f", "Hz"), Input("q")).design(1.0)
    rng, s, energy = np.random.default_rng(2), SvfState(1.0, 0.0), [1.0]
    for _ in range(3000):
        _, s = Svf.step(p, s, 0.0, rng.uniform(0, 0.6), 10 ** rng.uniform(0, 9))
        energy.append(s.s1**2 + s.s2**2)
    assert np.max(np.diff(energy)) < 1e-15 and energy[-1] < 1.0


@pytest.mark.parametrize(
    "wave",
    [lambda n: 0.245 + 0.2425 * np.sin(2 * np.pi * n / 8), lambda n: np.where(n % 2, 0.002, 0.45)],
)
def test_a_cutoff_that_sweeps_at_audio_rate_stays_bounded(wave):
    """Where the usual biquad overflows; and what is left when the input ends dies
    away.
    """
    proc = stimlib.compile(Scene({"y": b.svf(X, Input("f", "Hz"), q=10.0)}), 1.0)
    n = np.arange(100_000)
    x = np.random.default_rng(3).standard_normal(n.size) * (n < 90_000)
    y = proc.process(np.array([{"x": x, "f": wave(n)}[name] for name in proc.inputs]))[0]
    assert proc.fault is None and 1 < np.abs(y).max() < 50 and np.abs(y[-1000:]).max() < 1e-9


@pytest.mark.parametrize("cutoff", [100.0, Input("f", "Hz")])
def test_a_live_filter_is_held_within_its_limits(cutoff):
    """At 0 and fs/2, and at q = 0.001; where q moves alone, too."""
    x = np.random.default_rng(4).standard_normal(160)
    rows = np.tile([-20.0, 0.0, 300.0, 500.0, 700.0], 32), np.repeat([1.0, 5.0, -1.0, 0.001], 40)
    lawful(b.svf(X, cutoff, Input("q")), 1000, x=x, f=rows[0], q=rows[1])


@pytest.mark.parametrize("row", [0, 1, 2])
def test_what_is_not_a_number_is_a_fault_of_a_live_filter(row):
    proc = stimlib.compile(Scene({"y": b.svf(X, Input("f", "Hz"), Input("q"))}), 1000, "python")
    rows = np.ones((3, 4))
    rows[row, 2] = np.nan
    proc.process(rows)
    assert proc.fault == ("y", 2)


# Sums and levels ----------------------------------------------------------------------
def test_an_integral_is_exact_for_straight_lines_and_after_hours():
    assert stimlib.compile(Scene({"y": b.integrate(1.0)}), 4).process(np.empty((0, 2)))[
        0
    ].tolist() == [0.125, 0.375]
    proc = stimlib.compile(Scene({"y": b.integrate(X)}), 1000)
    y = proc.process(np.full((1, 1_000_000), 0.1))[0]
    proc.state = proc.state  # goes on where it was
    y = np.append(y, proc.process(np.full((1, 1_000_000), 0.1))[0])
    assert abs(y[-1] - (2e6 - 0.5) * 1e-4) < 1e-13 * y[-1]
    t, leak = np.arange(3000) / 1000, 5.0
    leaky = stimlib.compile(Scene({"y": b.integrate(X, leak)}), 1000).process(t[None])[0]
    wanted = t / leak - -np.expm1(-leak * t) / leak**2  # of y' = t - leak y
    np.testing.assert_allclose(leaky, wanted, rtol=1e-12, atol=1e-15)
    for fs in (2, 6):  # leak/fs above 1, and nearly 1
        t = np.arange(8) / fs
        coarse = stimlib.compile(Scene({"y": b.integrate(X, leak)}), fs).process(t[None])[0]
        np.testing.assert_allclose(coarse, t / leak - -np.expm1(-leak * t) / leak**2, rtol=1e-12)


def test_a_mean_is_of_the_nearest_number_of_samples():
    for seconds, n in ((0.0026, 3), (0.0024, 2)):
        y = stimlib.compile(Scene({"y": b.moving_average(X, seconds)}), 1000, "python").process(
            np.eye(1, 4)
        )[0]
        np.testing.assert_allclose(y, np.where(np.arange(4) < n, 1 / n, 0.0), rtol=1e-15)


def test_the_response_of_an_svf_has_what_comes_before_it():
    one, two = (
        stimlib.compile(Scene({"y": b.svf(k * X, 50.0, 2.0)}), 1000, "python").response(
            "y", "x", 30.0
        )
        for k in (1.0, 2.0)
    )
    assert two == pytest.approx(2 * one, rel=1e-12) and one != 0


def test_a_level_rises_and_falls_with_its_time_constants():
    proc = stimlib.compile(Scene({"y": b.envelope_follower(X, 0.01, 0.1)}), 1000)
    y = proc.process(np.repeat([-2.0, 0.0], [50, 100])[None])[0]
    np.testing.assert_allclose(
        y[[9, 49, 149]], [-2 * np.expm1(-1), -2 * np.expm1(-5), y[49] * np.exp(-1)], rtol=1e-12
    )
    short = stimlib.compile(Scene({"y": b.envelope_follower(X, 0.0005)}), 1000)  # of half a sample
    assert short.process(np.array([[2.0]]))[0, 0] == pytest.approx(-2 * np.expm1(-2), rel=1e-12)
