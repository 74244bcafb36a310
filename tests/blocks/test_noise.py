"""White noise: the same at every rate and for all time (its arithmetic is in
test_maths.py).  Pink noise: the filter as plain recursions, and a start without
a transient.
"""

import numpy as np
import pytest
from laws import assert_same, lawful, played, refuses, run

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import coloured_noise, pink_noise, pinking, white_noise
from stimlib.blocks.noise import PinkNoise, pair_of_words
from stimlib.checks import laws

X, LOW = Input("x"), 2**32 - 1
FIRST = [-0.2586643421641892, 0.47280889618782834, 0.6266124952097749, -0.2058550569242391]
LATER = [0.4276765344287945, -0.05785564487978792]


@pytest.mark.parametrize("fs", [1000, 8000, 48000])
def test_what_it_is_for_all_time(fs):
    """A change of these numbers changes every stimulus ever recorded; the rate does not
    matter.
    """
    assert_same(played(white_noise(0), 4, fs=fs), np.array(FIRST))
    late = stimlib.compile(Scene({"n": white_noise(7, 1)}), fs, seed=42)
    assert_same(late.process(100_002)[0, -2:], np.array(LATER))


@pytest.mark.parametrize(
    ("key", "m"), [(0, 0), (2**64 - 1, 2**63), (3 << 40 | 5, 2**33 + 7), (9, 2**32)]
)
def test_words_of_every_pair_and_key_are_those_of_the_reference(key, m):
    """Up to pair 2^63, beyond every run that a test can make."""
    a, b, c, d = laws.philox((m & LOW, m >> 32, 0, 0), (key & LOW, key >> 32))
    assert pair_of_words(np.uint64(key), np.uint64(m)) == (a | b << 32, c | d << 32)


# Pink ---------------------------------------------------------------------------------
FILTERED = [
    *(pinking(X, 5.0, tol_db) for tol_db in (1.0, 0.01, 1e-5)),
    X + PinkNoise(white_noise(5, 2), 0.7, 20.0, 0.01),
]


@pytest.mark.parametrize("block", FILTERED)
def test_pink_noise_is_its_own_white_noise_filtered(block):
    """By a bank of one-pole filters, from a state that is stationary."""
    lawful(block, 8000, x=np.random.default_rng(0).standard_normal(2500))


@pytest.mark.parametrize(
    "noise",
    [
        pink_noise(1.0, seed=1, f_low=1.0, tol_db=0.1),
        pink_noise(1.0, seed=1, f_low=30.0, tol_db=0.1),
        coloured_noise(2.0, seed=1, f_low=1.0, rms=0.3),
        coloured_noise(-1.0, seed=1, f_low=1.0, rms=0.3),
    ],
    ids=repr,
)
def test_it_is_stationary_from_the_first_sample(noise):
    """The variance over many runs, at the first samples and later, is that of the
    response.
    """
    fs, runs, lag = 1000.0, 1000, 30
    proc = stimlib.compile(Scene({"p": noise}), fs)
    y = np.empty((runs, lag + 1))
    for seed in range(runs):
        proc.reset(seed)
        y[seed] = proc.process(lag + 1)[0]
    f = np.geomspace(1e-4, fs / 2, 20_000)
    density = np.abs(proc.response("p", next(iter(proc.program.noises)), f)) ** 2 * 2 / fs
    variance = np.trapezoid(density, f)
    assert np.all(np.abs(np.var(y, axis=0) / variance - 1) < 5 * np.sqrt(2 / runs))
    later = np.trapezoid(density * np.cos(2 * np.pi * f * lag / fs), f)
    assert abs(np.mean(y[:, 0] * y[:, lag]) - later) < 5 * variance * np.sqrt(2 / runs)
    assert "rms" not in repr(noise) or variance == pytest.approx(0.3**2, rel=0.02)


def test_streams_and_seeds_differ():
    outputs = {f"p{s}{k}": pink_noise(1.0, s, k, f_low=20.0) for s in (1, 2) for k in (0, 1)}
    assert np.abs(np.corrcoef(played(outputs, 60_000)) - np.eye(4)).max() < 0.15


# Drawn ahead --------------------------------------------------------------------------
def drawn(seed, tol_db=0.01, target="llvm"):
    """White noise, and pink noise made with it."""
    white = white_noise(seed=3)
    scene = Scene({"white": white, "pink": pinking(white, tol_db=tol_db)})
    return stimlib.compile(scene, 8000, target, seed)


@pytest.mark.parametrize("tol_db", [0.01, 0.0001])
@pytest.mark.parametrize("cuts", [[], range(0, 640, 64), [1], [64, 128, 158, 192, 256]])
def test_noise_drawn_ahead_is_that_of_the_interpreter(cuts, tol_db):
    """From the second whole tile on, the deviates of the next are drawn beside the
    filter; whatever cut follows, they are those of their samples.
    """
    proc = drawn(5, tol_db)
    white = [s for s in proc._engine.segments if s.startswith("White")]
    assert len(white) == 2 and len(set(white)) == 1, "both blocks run in one segment"
    assert_same(run(proc, np.empty((0, 640)), cuts), drawn(5, tol_db, "python").process(640))


@pytest.mark.parametrize("n", [192, 256])
def test_noise_drawn_ahead_is_not_taken_for_that_of_another_seed_or_sample(n):
    """A state set in the middle of a run, where deviates of the old one are at hand:
    the same sample of another seed, then another sample.
    """
    proc, other = drawn(5), drawn(6)
    other.process(n)
    proc.process(192)
    proc.state = other.state
    assert_same(proc.process(64), other.process(64))


@pytest.mark.parametrize("words", [{"rms": 0.0}, {"rms": np.nan}, {"f_low": 0.0}, {"tol_db": -1.0}])
def test_coloured_noise_that_makes_no_sense_is_refused(words):
    refuses(lambda: coloured_noise(1.0, seed=1, **words), next(iter(words)))
    refuses(coloured_noise(4.0, seed=1), "coloured_noise: .*slope")
