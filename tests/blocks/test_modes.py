"""Pink noise: the filter as plain recursions, and a start of its own from a state that
is drawn.
"""

import numpy as np
import pytest
from laws import lawful

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import pink_noise, pinking, white_noise
from stimlib.blocks.noise import PinkNoise, White, noise_key


@pytest.mark.parametrize("tol_db", [1.0, 0.01, 1e-5])
def test_it_is_a_bank_of_one_pole_filters(tol_db):
    lawful(pinking(Input("x"), 5.0, tol_db), 8000, x=np.random.default_rng(0).standard_normal(3000))


def test_pink_noise_is_its_own_white_noise_filtered():
    """And it is stationary: the filter goes on from a state, not from zero."""
    lawful(Input("x") + PinkNoise(white_noise(5, 2), 0.7, 20.0, 0.01), 2000, x=np.zeros(2000))


def test_its_start_is_drawn_apart_from_its_white_noise():
    block = PinkNoise(White(5, 2), 0.7, 20.0, 0.01)
    p, s = block.design(2000)
    keys = []
    start = block.start(p, s, 9, lambda key, n: keys.append(key) or np.ones(n))
    assert keys == [noise_key(9, 5, 2, 1)] and block.white.start(
        (), block.white.design(2000)[1], 9
    ).key == noise_key(9, 5, 2, 0)
    assert not start.q[p.r == 0].any() and start.q[p.r != 0].all()
    assert block.work(p) == 8 * 64


def test_streams_and_seeds_differ():
    outputs = {f"p{s}{k}": pink_noise(1.0, s, k, f_low=20.0) for s in (1, 2) for k in (0, 1)}
    y = stimlib.compile(Scene(outputs), 1000).process(np.empty((0, 60_000)))
    assert np.abs(np.corrcoef(y) - np.eye(4)).max() < 0.15
