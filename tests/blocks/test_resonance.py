"""Resonators, and filters whose cutoff and quality move."""

import mpmath as mp
import numpy as np
import pytest
from laws import lawful, played
from scipy.optimize import brentq

import stimlib
from stimlib import Input, Scene, blocks as b
from stimlib.blocks.filters import Cascade

X = Input("x")
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


def test_the_response_of_an_svf_has_what_comes_before_it():
    one, two = (
        stimlib.compile(Scene({"y": b.svf(k * X, 50.0, 2.0)}), 1000, "python").response(
            "y", "x", 30.0
        )
        for k in (1.0, 2.0)
    )
    assert two == pytest.approx(2 * one, rel=1e-12) and one != 0
