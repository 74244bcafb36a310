"""Resonators, and filters whose cutoff and quality move."""

import numpy as np
import pytest
from laws import impulse_response, lawful

import stimlib
from stimlib import Input, Scene, blocks as b
from stimlib.blocks.resonance import Svf, SvfState

X, FREQ, Q = Input("x"), Input("f", "Hz"), Input("q")


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


@pytest.mark.parametrize("block", [b.ring(X, 100.0, 1e-4), b.svf(X, 300.0, 1e-5)])
def test_a_number_that_is_held_has_the_response_of_that(block):
    proc = stimlib.compile(Scene({"y": block}), 1000)
    h = np.fft.rfft(impulse_response(proc, "y", "x", 1 << 16))
    said = proc.response("y", "x", np.fft.rfftfreq(1 << 16, 1e-3))
    np.testing.assert_allclose(h, said, rtol=0, atol=1e-11)
