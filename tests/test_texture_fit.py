"""Textures fitted to recordings: Burg's method against what was put in, and models of a
made-up hand on a made-up surface.
"""

import numpy as np
import pytest
from refusals import refused
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

import stimlib
from stimlib import BadValue, Input, Scene
from stimlib.blocks import load_texture, save_texture, texture
from stimlib.design.texture import made_up
from stimlib.fitting.texture import burg, fit_texture

A = [1.0, -1.6, 1.1, -0.3]
RNG = np.random.default_rng(0)
X = lfilter([0.5], A, RNG.standard_normal(60000))


def test_burg_finds_what_was_put_in_however_it_is_cut():
    for stretches in ([X], [X[k : k + 30] for k in range(0, 60000, 40)]):
        a, power = burg(stretches, 3)
        np.testing.assert_allclose(a, A, atol=0.02)
        assert abs(power / 0.25 - 1) < 0.03
    r = [X[: X.size - k] @ X[k:] for k in range(4)]
    np.testing.assert_allclose(
        burg([X], 3)[0][1:], solve_toeplitz(r[:3], [-v for v in r[1:]]), atol=1e-4
    )


def test_burg_is_stable_whatever_the_data():
    for stretches in (
        [RNG.standard_normal(9)],
        [np.sin(np.arange(40.0))],
        [np.ones(20), -np.ones(20)],
        [np.arange(30.0)],
    ):
        a, power = burg(stretches, 8)
        assert np.abs(np.roots(a)).max() < 1 + 1e-6 and power >= 0


@pytest.fixture(scope="module")
def stroked():
    """Two minutes of strokes on a made-up surface: acceleration, speed, force."""
    t = np.arange(120_000) / 1000
    v, f = 0.08 + 0.07 * np.sin(2 * t), 1.3 + 1.1 * np.sin(0.31 * t)
    surface = made_up(2, (0.0, 0.05, 0.15), (0.0, 1.0, 2.5))
    scene = Scene({"a": texture(Input("v", "m/s"), Input("f", "N"), surface, seed=1)})
    return surface, stimlib.compile(scene, 1000).process(np.array([v, f]))[0], v, f


def test_a_fit_has_the_spectrum_of_the_surface(stroked, tmp_path):
    surface, a, v, f = stroked
    fit = fit_texture(a, v, f, 1000, order=10, speeds=4, forces=4, name="again")
    assert not fit.left_out and len(fit.bins) == 16
    hz = np.arange(20, 480, 20)
    errors = [
        10 * np.log10(fit.model.psd(hz, s, N) / surface.psd(hz, s, N))
        for s in (0.04, 0.1)
        for N in (0.8, 1.5, 2.0)
    ]
    assert np.sqrt(np.mean(np.square(errors))) < 1.2
    assert fit.model.psd(hz, 0.0, 1.0).max() == fit.model.psd(hz, 0.1, 0.0).max() == 0.0
    border = [
        fit.model.psd(hz, 9.0, 1.3) / fit.model.psd(hz, 0.14, 1.3),
        fit.model.psd(hz, 0.05, 9.0) / surface.psd(hz, 0.05, 2.4),
    ]
    assert all(0.3 < (10 * np.log10(b)).std() + 1 < 4 and 0.4 < b.mean() < 2.5 for b in border)
    save_texture(fit.model, tmp_path / "a.xml")
    np.testing.assert_array_equal(load_texture(tmp_path / "a.xml").lsf, fit.model.lsf)
    again = fit_texture(a, -v, f, 1000, order=10, speeds=4, forces=4, name="again")
    np.testing.assert_array_equal(again.model.lsf, fit.model.lsf)


def test_what_has_too_little_is_left_out_and_said(stroked):
    _, a, v, f = stroked
    n = 30_000
    fit = fit_texture(
        a[:n],
        v[:n],
        f[:n],
        1000,
        order=6,
        speeds=[0.02, 0.08, 0.14, 0.5],
        forces=[0.2, 1.0, 2.6, 9.0],
        seconds=1.5,
    )
    said = repr(fit)
    assert [(b.speed[0], b.force[0]) for b in fit.left_out] == [
        (0.02, 2.6),
        (0.08, 2.6),
        (0.14, 0.2),
        (0.14, 2.6),
    ]
    assert (
        said.startswith("TextureFit(5 of 9 bins, order 6, ")
        and "left out 0.02 to 0.08 m/s, 2.6 to 9 N: 0 s of 1.5 s" in said
    )


def test_what_is_no_noise_is_left_out():
    t = np.arange(4000) / 1000
    fit = fit_texture(
        np.where(t < 2, 0.0, np.random.default_rng(1).standard_normal(4000)),
        np.where(t < 2, 0.05, 0.1),
        np.ones(4000),
        1000,
        order=4,
        speeds=[0.01, 0.07, 0.2],
        forces=1,
    )
    assert [b.left_out for b in fit.bins] == ["no vibration", ""] and fit.bins[0].speed == (
        0.01,
        0.07,
    )


GOOD = {"acceleration": X[:3000], "speed": np.full(3000, 0.1), "force": np.ones(3000), "fs": 1000.0}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"speed": np.ones(2999)}, r"speed has shape \(2999,\)"),
        ({"force": np.r_[np.ones(2999), np.nan]}, r"force\[2999\] = nan is not finite"),
        ({"force": -np.ones(3000)}, "nothing was stroked"),
        ({"acceleration": "fast"}, "must be an array of real numbers"),
        ({"acceleration": 1j * X[:3000]}, "array of real numbers, got complex128"),
        ({"acceleration": 1e10 * X[:3000]}, r"acceleration\[2\] = .* or above 1e\+09"),
        ({"acceleration": 1e5 * X[:3000]}, "variance = .*; give the acceleration in m/s"),
        ({"order": 2.5}, "fit_texture: order = 2.5 must be"),
        ({"speeds": "a"}, "edges that rise"),
        ({"order": 0}, "order = 0 must be from 1 to 64"),
        ({"order": 65}, "order = 65"),
        ({"fs": np.nan}, "fs = nan"),
        ({"seconds": -1.0}, "seconds = -1.0"),
        ({"seconds": 10.0}, "no bin has 10 s in stretches of 56 samples; the fullest: 3 s of 10 s"),
        ({"speeds": 0}, "speeds = 0 must be from 1 to 50"),
        ({"forces": [2.0, 1.0]}, "edges that rise"),
    ],
)
def test_what_a_fit_does_not_take(change, why):
    assert fit_texture(**GOOD, speeds=1, forces=1).model.rate == 1000
    refused(BadValue, why, fit_texture, **GOOD | change)
