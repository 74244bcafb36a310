"""Finite impulse responses against their laws; what the differentiator promises beside
its response.
"""

import re

import numpy as np
import pytest
from laws import assert_same, lawful, played

import stimlib
from stimlib import BadValue, Input, Scene, blocks
from stimlib.blocks import differentiator, fir

x = Input("x")


@pytest.mark.parametrize("size", [1, 2, 7, 8, 9, 16, 17, 64, 65, 129, 500])
def test_it_is_a_convolution(size):
    rng = np.random.default_rng(size)
    taps, u = rng.standard_normal(size), rng.standard_normal(1000)
    lawful(fir(x, taps), 1000, x=u)


@pytest.mark.parametrize(
    ("taps", "latency"),
    [
        ([1, 2, 1], 1),
        ([1, 0, -1], 1),
        ([1, 2, 2, 1], 1.5),
        ([3.0], 0),
        ([0, 0, 5.0], 2),
        ([1, 1, 0, 0], 0.5),
    ],
)
def test_latency(taps, latency):
    assert stimlib.compile(Scene({"y": fir(x, taps)}), 1000).latency["y", "x"] == (latency, latency)


def test_the_papers_filter_has_order_128_at_8_khz():
    proc = stimlib.compile(Scene({"v": differentiator(x, passband=1000.0)}), 8000)
    h = proc.process(np.eye(1, 300))[0]
    assert np.flatnonzero(h)[-1] - np.flatnonzero(h)[0] <= 128
    # odd: linear phase, nothing at 0 Hz
    np.testing.assert_allclose(h[:129], -h[128::-1], atol=1e-18)
    assert proc.latency["v", "x"] == (64, 64)


@pytest.mark.parametrize("fs", [400, 500, 1000, 1500, 2000])
def test_a_recommended_pass_band_is_one_that_works(fs):
    with pytest.raises(BadValue, match="such as") as e:
        stimlib.compile(stimlib.scenes.squeeze(), fs, "python")
    passband = float(re.search(r"such as ([\d.]+)", str(e.value))[1])
    stimlib.compile(stimlib.scenes.squeeze(passband=passband), fs, "python")


def test_a_stop_band_above_half_the_rate_is_none():
    u = np.random.default_rng(5).standard_normal(300)
    assert_same(
        played(differentiator(x, 100.0, 600.0), u), played(differentiator(x, 100.0, 501.0), u)
    )
    f, proc = (
        np.linspace(1.0, 100.0, 50),
        stimlib.compile(Scene({"v": differentiator(x, 100.0, 600.0)}), 1000, "python"),
    )
    np.testing.assert_allclose(np.abs(proc.response("v", "x", f)), 2 * np.pi * f, rtol=1e-6)


@pytest.mark.parametrize(
    ("block", "name"),
    [
        (lambda: differentiator(x, 100.0, order=3), "differentiator"),
        (lambda: differentiator(x, 100.0, tol=1e-12), "differentiator"),
        (lambda: differentiator(x, 100.0, 50.0), "differentiator"),
        (lambda: blocks.pink_noise(1.0, 1, f_low=900.0), "pink_noise"),
        (lambda: blocks.pinking(x, 1.0, 1e-9), "pinking"),
    ],
)
def test_messages_name_what_was_called(block, name):
    with pytest.raises(BadValue, match=f"^{name}: ") as e:
        stimlib.compile(Scene({"y": block()}), 1000, "python")
    assert "_taps" not in str(e.value) and "_modes" not in str(e.value)
