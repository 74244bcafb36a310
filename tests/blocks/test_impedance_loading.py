"""The gate with two thresholds, and its default thresholds."""

import numpy as np
import pytest
from laws import lawful

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import loading, velocity
from stimlib.blocks.impedance import step_peak

x = Input("x")


@pytest.mark.parametrize(("on", "off"), [(0.5, 0.25), (1.0, 0.01), (0.3, 0.29), (2.0, 1.0)])
@pytest.mark.parametrize("slow", [1, 9, 200])
def test_it_opens_above_on_and_closes_at_off(on, off, slow):
    rng = np.random.default_rng(slow)
    v = np.repeat(rng.choice([-1.0, 0.0, off, on, 0.26, 0.4, 1.1, 2.5], 4000 // slow + 1), slow)[
        :4000
    ]
    lawful(loading(x, on, off), 1000, x=v)


def test_nan_closes_it():
    proc = stimlib.compile(Scene({"g": loading(x, 0.5, 0.1)}), 1000)
    np.testing.assert_array_equal(
        proc.process(np.array([[1.0, 0.2, np.nan, 0.2, 1.0, np.inf, -np.inf]])),
        [[1, 1, 0, 0, 1, 1, 0]],
    )


@pytest.mark.parametrize(
    ("fs", "cutoff"), [(8000.0, 100.0), (8000.0, 20.0), (48000.0, 100.0), (1000.0, 300.0)]
)
def test_the_default_is_twice_the_answer_to_one_encoder_step(fs, cutoff):
    """off = 2 q max|h| with h the answer of velocity to one step; on = 2 off."""
    q = 2e-5
    proc = stimlib.compile(Scene({"v": velocity(x, cutoff)}), fs)
    h = proc.process(np.r_[0.0, np.ones(int(fs / cutoff) * 4)][None])[0]
    peak = q * np.abs(h).max()
    gated = stimlib.compile(Scene({"g": loading(velocity(x, cutoff), resolution=q)}), fs)
    (p,) = [
        p
        for (p, _), i in zip(gated.design, gated.program.instances, strict=True)
        if type(i.block).__name__ == "Loading"
    ]
    assert p.off == pytest.approx(2 * peak, rel=1e-3) and p.on == 2 * p.off


def test_the_default_of_any_cutoff():
    """Far below the sample rate the answer is fs g (t g) exp(-t g), which has its top
    at t g = 1.
    """
    for g in 10.0 ** np.arange(-14.0, -4.0):
        cutoff = 1000.0 * g / (2 * np.pi)
        assert step_peak(cutoff, 1000.0) == pytest.approx(1000.0 * g / np.e, rel=1e-4)
