"""Pink noise: the filter as plain recursions, and a start without a transient."""

import numpy as np
import pytest
from laws import lawful

import stimlib
from stimlib import BadValue, Input, Scene
from stimlib.blocks import coloured_noise, pink_noise, pinking, white_noise
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


@pytest.mark.parametrize("f_low", [1.0, 30.0])
def test_it_is_stationary_from_the_first_sample(f_low):
    """The variance over many runs, at the first samples and later, is that of the
    response.
    """
    fs, runs = 1000.0, 3000
    proc = stimlib.compile(Scene({"p": pink_noise(1.0, seed=1, f_low=f_low, tol_db=0.1)}), fs)
    y = np.empty((runs, 40))
    for seed in range(runs):
        proc.reset(seed)
        y[seed] = proc.process(np.empty((0, 40)))[0]
    f = np.r_[np.geomspace(1e-4, fs / 2, 20_000)]
    density = np.abs(proc.response("p", "white(1, 0)", f)) ** 2 * 2 / fs
    variance = np.trapezoid(density, f)
    assert np.all(np.abs(np.var(y, axis=0) / variance - 1) < 5 * np.sqrt(2 / runs))
    lag = np.trapezoid(density * np.cos(2 * np.pi * f * 30 / fs), f)
    assert abs(np.mean(y[:, 0] * y[:, 30]) - lag) < 5 * variance * np.sqrt(2 / runs)


@pytest.mark.parametrize("slope", [-2.0, 0.5, 2.0])
def test_coloured_noise_has_its_rms_and_slope(slope):
    """Of 2^18 samples; the spectrum over octaves, which average many bins."""
    fs, n = 8000.0, 1 << 18
    noise = coloured_noise(slope, seed=4, rms=0.3, f_low=100.0)
    y = stimlib.compile(Scene({"n": noise}), fs).process(np.empty((0, n)))[0]
    assert y.std() == pytest.approx(0.3, rel=0.03)
    power = np.abs(np.fft.rfft(y)) ** 2
    f = np.fft.rfftfreq(n, 1 / fs)
    octaves = [power[(f >= a) & (f < 2 * a)].mean() for a in (100.0, 200.0, 400.0, 800.0, 1600.0)]
    # the mean over an octave of f^-slope falls by the same factor
    fall = np.diff(10 * np.log10(octaves))
    assert np.abs(fall + 10 * slope * np.log10(2)).max() < 0.4


def test_coloured_noise_is_stationary_from_the_first_sample_on():
    fs, runs = 1000.0, 2000
    proc = stimlib.compile(Scene({"n": coloured_noise(2.0, seed=1, f_low=1.0)}), fs)
    y = np.empty((runs, 4))
    for seed in range(runs):
        proc.reset(seed)
        y[seed] = proc.process(np.empty((0, 4)))[0]
    assert np.all(np.abs(np.var(y, axis=0) - 1) < 5 * np.sqrt(2 / runs))


@pytest.mark.parametrize("words", [{"rms": 0.0}, {"rms": np.nan}, {"f_low": 0.0}, {"tol_db": -1.0}])
def test_coloured_noise_that_makes_no_sense_is_refused(words):
    with pytest.raises(BadValue, match=next(iter(words))):
        coloured_noise(1.0, seed=1, **words)
    with pytest.raises(BadValue, match="coloured_noise: .*slope"):
        stimlib.compile(Scene({"n": coloured_noise(4.0, seed=1)}), 1000)


def test_streams_and_seeds_differ():
    outputs = {f"p{s}{k}": pink_noise(1.0, s, k, f_low=20.0) for s in (1, 2) for k in (0, 1)}
    y = stimlib.compile(Scene(outputs), 1000).process(np.empty((0, 60_000)))
    assert np.abs(np.corrcoef(y) - np.eye(4)).max() < 0.15


def one_row(cuts, seed, tol_db=0.01):
    """White noise and pink noise made with it, in pieces, and the state after it."""
    white = white_noise(seed=3)
    proc = stimlib.compile(Scene({"white": white, "pink": pinking(white, tol_db=tol_db)}), 8000)
    segments = proc._engine.segments
    assert len({s for s in segments if s.startswith("White")}) == 1
    assert sum(s.startswith("White") for s in segments) == 2, "both blocks run in one segment"
    proc.reset(seed)
    y = np.concatenate([proc.process(np.empty((0, n))) for n in cuts], axis=1)
    return y, proc.state


@pytest.mark.parametrize("tol_db", [0.01, 0.0001])
@pytest.mark.parametrize(
    "cuts", [[640], [64] * 10, [1, 639], [64, 64, 30, 34, 64, 384], [128, 1, 63, 448]]
)
def test_noise_drawn_ahead_is_that_of_the_interpreter(cuts, tol_db):
    """From the second whole tile on, the deviates of the next are drawn beside the
    filter; whatever cut follows, they are those of their samples.
    """
    y, _ = one_row(cuts, 5, tol_db)
    white = white_noise(seed=3)
    scene = Scene({"white": white, "pink": pinking(white, tol_db=tol_db)})
    assert np.array_equal(
        y, stimlib.compile(scene, 8000, "python", seed=5).process(np.empty((0, 640)))
    )


def test_noise_drawn_ahead_is_not_taken_for_that_of_another_seed_or_sample():
    """A state set in the middle of a run, where deviates of the old one are at hand."""
    y, _ = one_row([1024], 6)
    states = {n: one_row([n], 6)[1] for n in (192, 256)}
    white = white_noise(seed=3)
    proc = stimlib.compile(Scene({"white": white, "pink": pinking(white)}), 8000, seed=5)
    for n, state in states.items():  # the same sample of another seed, then another sample
        proc.process(np.empty((0, n if n == 192 else 64)))
        proc.state = state
        assert np.array_equal(proc.process(np.empty((0, 64))), y[:, n : n + 64])
