"""Copies for ears: the vibration alone, loud enough, without clicks, and never taken for the stimulus."""

import numpy as np
import pytest

import stimlib
from stimlib.analysis.listen import listen, vibration
from stimlib.errors import BadValue, UnknownName
from stimlib.files import audio

FS = 2000
X = stimlib.Input("x", "m")
SCENE = stimlib.Scene({"force": stimlib.constant(1000.0, "N/m") * X, "still": 0 * X})
T = np.arange(2 * FS) / FS
TONE = 1e-5 * np.sin(2 * np.pi * 150 * T)


@pytest.fixture
def rendering():
    return stimlib.render(SCENE, {"x": 0.02 * T + TONE}, FS, target="python")


def test_a_tone_on_a_ramp_becomes_the_tone_alone_at_half_scale(rendering, tmp_path):
    report = listen(rendering, "force", tmp_path / "force-listen.wav")
    y, sidecar = audio.read(report.path)
    middle = slice(200, -200)
    assert np.abs(y[0] - 1000 * TONE)[middle].max() < 1e-4  # of 0.01 N on 40 N
    assert np.abs(y).max() / sidecar["channels"][0]["full_scale"] == pytest.approx(0.5, rel=1e-6)  # -6 dBFS
    ramp = np.minimum(np.arange(1, T.size + 1) / (0.01 * FS), 1.0)  # or it would click
    whole = vibration(rendering["force"], FS)
    np.testing.assert_allclose(y[0], ramp * ramp[::-1] * whole, rtol=0, atol=1e-6 * np.abs(y).max())


def test_a_copy_is_not_verified_as_the_stimulus(rendering, tmp_path):
    listen(rendering, "force", tmp_path / "a.wav")
    with pytest.raises(BadValue, match="another scene"):
        stimlib.verify(SCENE, {"x": 0.02 * T + TONE}, tmp_path / "a.wav")


def test_what_cannot_be_heard_is_refused_and_nothing_is_written(rendering, tmp_path):
    with pytest.raises(BadValue, match="still has nothing above 20 Hz"):
        listen(rendering, "still", tmp_path / "a.wav")
    with pytest.raises(UnknownName, match="there is force, still"):
        listen(rendering, "x", tmp_path / "a.wav")
    for cutoff in (0, FS / 2, float("nan")):
        with pytest.raises(BadValue, match="below fs/2 = 1000 Hz"):
            listen(rendering, "force", tmp_path / "a.wav", cutoff)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("f", "least", "most"), [(10, 0.0, 0.005), (20, 0.49, 0.51), (40, 0.99, 1.01)])
def test_the_cutoff_halves_and_an_octave_below_takes_48_dB(f, least, most):
    y = vibration(np.sin(2 * np.pi * f * T), FS, cutoff=20.0)
    assert least <= np.abs(y[T.size // 4 : -T.size // 4]).max() <= most


def test_a_signal_of_a_few_samples_has_a_vibration_too():
    assert vibration(np.ones(3), 8000).shape == (3,)
