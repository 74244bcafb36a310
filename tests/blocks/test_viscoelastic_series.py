"""A springpot in series with a spring or a dashpot, against Mittag-Leffler functions
and against sums of displacements.
"""

import mpmath as mp
import numpy as np
import pytest

import stimlib
from stimlib import BadValue, Input, Scene
from stimlib.blocks import compliance, springpot_series

CHI, K, SPEED = 100.0, 1000.0, 0.1
y = Input("y", "m")


def mittag_leffler(a, b, x):
    """E_{a,b}(x) by its series, in as many digits as the alternating terms eat."""
    with mp.workdps(80):
        total, k = mp.mpf(0), 0
        while True:
            term = mp.mpf(x) ** k / mp.gamma(mp.mpf(a) * k + b)
            total += term
            k += 1
            if k > 60 and abs(term) < mp.mpf(10) ** -30:
                return float(total)


def errors(alpha, scheme, fs):
    """Largest error, of the largest force, of a ramp from rest: k v t
    E_{alpha,2}(-(k/chi) t^alpha).
    """
    proc = stimlib.compile(Scene({"f": springpot_series(y, CHI, alpha, k=K, scheme=scheme)}), fs)
    f = proc.process(SPEED * np.arange(fs // 4 + 1)[None] / fs)[0]
    at = [fs // 50, fs // 20, fs // 10, fs // 4]
    law = [K * SPEED * n / fs * mittag_leffler(alpha, 2, -K / CHI * (n / fs) ** alpha) for n in at]
    return float(np.max(np.abs(f[at] - law)) / max(law))


@pytest.mark.parametrize("alpha", [0.5, 0.75, 0.9])
def test_the_fractional_maxwell_arm_converges_to_its_stated_order(alpha):
    coarse, fine = errors(alpha, "l1", 1000), errors(alpha, "l1", 8000)
    assert coarse < 2e-3
    assert np.log2(coarse / fine) / 3 == pytest.approx(2 - alpha, abs=0.15)
    assert np.log2(errors(alpha, "gl", 1000) / errors(alpha, "gl", 8000)) / 3 == pytest.approx(
        1.0, abs=0.15
    )


@pytest.mark.parametrize("words", [{"k": 1000.0}, {"b": 20.0}])
def test_displacements_in_series_add_up(words):
    """Moved along f/k + I^alpha f/chi (or with the integral of f/b), the arm gives f
    back: the same sums.
    """
    f = Input("f", "N")
    own = f / stimlib.constant(K, "N/m") if "k" in words else compliance(f, words["b"], 1.0)
    moved = own + compliance(f, CHI, 0.4)
    proc = stimlib.compile(
        Scene({"f": springpot_series(moved, CHI, 0.4, scheme="gl", **words)}), 1000
    )
    force = np.r_[0.0, np.random.default_rng(0).standard_normal(5000).cumsum()][None]
    np.testing.assert_allclose(proc.process(force), force, rtol=0, atol=1e-8 * np.abs(force).max())


def test_limits():
    move = 0.01 * np.sin(np.arange(2000) / 100)[None]
    stiff = stimlib.compile(Scene({"f": springpot_series(y, CHI, 0.5, k=1e14)}), 1000).process(move)
    alone = stimlib.compile(
        Scene({"f": stimlib.blocks.springpot(y, CHI, 0.5, "l1")}), 1000
    ).process(move)
    np.testing.assert_allclose(stiff, alone, rtol=0, atol=1e-9 * np.abs(alone).max())
    soft = stimlib.compile(Scene({"f": springpot_series(y, 1e14, 0.5, k=K)}), 1000).process(move)
    np.testing.assert_allclose(soft, K * (move - move[0, 0]), rtol=0, atol=1e-6)


def test_response_is_two_elements_in_series():
    f = np.array([0.5, 5.0, 50.0])
    proc = stimlib.compile(Scene({"f": springpot_series(y, CHI, 0.5, k=K)}), 8000)
    pot = CHI * (2j * np.pi * f) ** 0.5
    np.testing.assert_allclose(proc.response("f", "y", f), pot * K / (pot + K), rtol=1e-3)


def test_mistakes():
    for words in ({}, {"k": 1.0, "b": 1.0}, {"k": -1.0}, {"b": 0.0}):
        with pytest.raises(BadValue):
            springpot_series(y, CHI, 0.5, **words)
    for alpha in (0.0, 1.0, 1.2):
        with pytest.raises(BadValue):
            springpot_series(y, CHI, alpha, k=1.0)


def test_a_run_beyond_the_horizon_is_a_warning(tmp_path):
    from stimlib.files import audio as file

    scene = Scene({"f": springpot_series(y, CHI, 0.5, k=K, tol=1e-6, horizon=0.5)})
    motion = {"y": np.zeros(1000)}
    assert stimlib.render(scene, motion, 1000, 0.5).fault is None
    with pytest.warns(RuntimeWarning, match=r"1 s is longer than horizon = 0.5 s"):
        stimlib.render(scene, motion, 1000)
    with pytest.warns(RuntimeWarning, match="longer horizon"):
        file.write(tmp_path / "a.wav", stimlib.compile(scene, 1000), motion, 1.0, progress=False)
