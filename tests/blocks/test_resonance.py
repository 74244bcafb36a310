"""Resonators, and filters whose cutoff and quality move."""

import numpy as np
import pytest
from laws import lawful, played
from scipy.optimize import brentq

import stimlib
from stimlib import Input, Scene, blocks as b
from stimlib.blocks.filters import Cascade
from stimlib.blocks.resonance import Svf, SvfState

X, FREQ, Q = Input("x"), Input("f", "Hz"), Input("q")
SETTINGS = [(part / 2, q) for part in (0.01, 0.3, 0.6, 0.95) for q in (1.0, 5.0, 60.0)]


@pytest.mark.parametrize("make", [b.resonator, b.notch])
@pytest.mark.parametrize(("part", "q"), SETTINGS)
def test_a_resonance_has_the_width_and_the_ring_of_its_docstring(make, part, q):
    """The -3 dB edges are freq/q apart, and the poles shrink by the stated time
    constant.
    """
    p, s = make(X, part * 8000.0, q).design(8000.0)

    def above_half(r):
        return abs(complex(Cascade.transfer(p, np.exp(2j * np.pi * r)))) ** 2 - 0.5

    above = brentq(above_half, part, 0.5 - 1e-13, xtol=1e-15, rtol=1e-14)
    below = brentq(above_half, 1e-6 * part, part, xtol=1e-15, rtol=1e-14)
    assert above - below == pytest.approx(part / q, rel=1e-9)
    if (turn := np.pi * part / q) < np.pi / 4:
        h = []
        for x in (1.0, 0.0, 0.0, 0.0, 0.0):
            y, s = Cascade.step(p, s, x)
            h.append(y)
        # h[n+2] = a h[n+1] - (shrink of a sample)^2 h[n], of two equations
        product = (h[3] ** 2 - h[2] * h[4]) / (h[2] ** 2 - h[1] * h[3])
        assert product == pytest.approx(np.exp(-2 * np.arctanh(np.tan(turn))), rel=1e-9)


def test_no_movement_of_the_cutoff_makes_energy():
    """s1^2 + s2^2 never grows without input, whatever cutoff and q do; hardly any
    damping.
    """
    p, _ = b.svf(X, FREQ, Q).design(1.0)
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
    n = np.arange(100_000)
    x = np.random.default_rng(3).standard_normal(n.size) * (n < 90_000)
    y = played(b.svf(X, FREQ, q=10.0), {"x": x, "f": wave(n)}, fs=1.0)
    assert 1 < np.abs(y).max() < 50 and np.abs(y[-1000:]).max() < 1e-9


@pytest.mark.parametrize("cutoff", [100.0, FREQ])
@pytest.mark.parametrize("mode", ["lowpass", "bandpass", "highpass", "notch"])
def test_a_live_filter_is_held_within_its_limits(cutoff, mode):
    """At 0 and fs/2, and at q = 0.001; where q moves alone, too."""
    x = np.random.default_rng(4).standard_normal(160)
    f = np.tile([-20.0, 0.0, 300.0, 1e-3, 500.0, 700.0, 250.0, 10.0], 20)
    q = np.repeat([1.0, 5.0, -1.0, 0.001, 10.0], 32)
    lawful(b.svf(X, cutoff, Q, mode), 1000, x=x, f=f, q=q)


def test_the_response_of_an_svf_has_what_comes_before_it():
    one, two = (
        stimlib.compile(Scene({"y": b.svf(k * X, 50.0, 2.0)}), 1000, "python").response(
            "y", "x", 30.0
        )
        for k in (1.0, 2.0)
    )
    assert two == pytest.approx(2 * one, rel=1e-12) and one != 0
