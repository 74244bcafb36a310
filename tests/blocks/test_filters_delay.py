"""Delays."""

import numpy as np
import pytest
from laws import lawful

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import delay
from stimlib.blocks.filters import Delay, DelayState

x = Input("x")


@pytest.mark.parametrize("samples", [1, 2, 63, 64, 65, 1000])
def test_it_is_a_shift(samples):
    u = np.random.default_rng(0).standard_normal(3000)
    lawful(delay(x, samples), 1000, x=u)
    assert stimlib.compile(Scene({"y": delay(x, samples)}), 1000).latency["y", "x"] == (
        samples,
        samples,
    )


@pytest.mark.parametrize(
    ("seconds", "fs", "samples"),
    [(0.01, 8000.0, 80), (0.01, 44100.0, 441), (0.0016, 1000.0, 2), (0.0005001, 1000.0, 1)],
)
def test_seconds_are_rounded_to_samples(seconds, fs, samples):
    assert stimlib.compile(Scene({"y": delay(x, seconds=seconds)}), fs).latency["y", "x"] == (
        samples,
        samples,
    )


def test_delays_add_up():
    u = np.random.default_rng(0).standard_normal((1, 300))
    one = stimlib.compile(Scene({"y": delay(delay(x, 5), 70)}), 1000).process(u)
    np.testing.assert_array_equal(one, stimlib.compile(Scene({"y": delay(x, 75)}), 1000).process(u))


@pytest.mark.parametrize("at", [3, 4, 2**64 - 1])
def test_a_place_beyond_the_line_is_its_first(at):
    line = np.array([5.0, 6.0, 7.0])
    y, s = Delay.step(None, DelayState(line, np.uint64(at)), 1.0)
    assert (y, line.tolist(), s.at) == (5.0, [1.0, 6.0, 7.0], 1)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8])
@pytest.mark.parametrize("at", [0, 1, 2, 3, 4, 2**64 - 1])
def test_a_tile_is_a_shift_from_wherever_its_state_is(at, n):
    line, u, y = np.array([5.0, 6.0, 7.0]), np.arange(10.0, 10.0 + n), np.empty(n)
    wanted = np.concatenate([np.roll(line, -at) if at < 3 else line.copy(), u])
    s = Delay.tile(None, DelayState(line, np.uint64(at)), u, y)
    assert y.tolist() == wanted[:n].tolist()
    assert np.roll(line, -int(s.at)).tolist() == wanted[n:].tolist() and s.at < 3
