"""Listening copies: the vibration alone, loud enough, without clicks, and never taken
for the stimulus.
"""

import numpy as np
import pytest
from refusals import refused

import stimlib
from stimlib.analysis.listening import CUTOFF, listen, vibration
from stimlib.errors import BadValue, UnknownName
from stimlib.files import audio
from stimlib.motion.generators import minimum_jerk

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
    # -6 dBFS
    assert np.abs(y).max() / sidecar["channels"][0]["full_scale"] == pytest.approx(0.5, rel=1e-6)
    ramp = np.minimum(np.arange(1, T.size + 1) / (0.01 * FS), 1.0)  # or it would click
    whole = vibration(rendering["force"], FS)
    np.testing.assert_allclose(y[0], ramp * ramp[::-1] * whole, rtol=0, atol=1e-6 * np.abs(y).max())


def test_a_copy_is_not_verified_as_the_stimulus(rendering, tmp_path):
    listen(rendering, "force", tmp_path / "a.wav")
    refused(
        BadValue, "another scene", stimlib.verify, SCENE, {"x": 0.02 * T + TONE}, tmp_path / "a.wav"
    )


@pytest.mark.parametrize(
    ("error", "says", "name", "cutoff"),
    [
        (BadValue, "still has nothing above", "still", CUTOFF),
        (UnknownName, "there is force, still", "x", CUTOFF),
        (BadValue, "cutoff = .*below fs/2", "force", 0),
        (BadValue, "cutoff = .*below fs/2", "force", FS / 2),
        (BadValue, "cutoff = .*not finite", "force", float("nan")),
    ],
)
def test_what_cannot_be_heard_is_refused_and_nothing_is_written(
    rendering, tmp_path, error, says, name, cutoff
):
    refused(error, says, listen, rendering, name, tmp_path / "a.wav", cutoff)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("start", [0.0, 0.1, 0.15])  # also where the signal ends on the way
def test_a_squeeze_without_vibration_leaves_less_than_a_hundredth_of_it(start):
    scene = stimlib.scenes.squeeze(fingers=1)
    motion = {"x1": lambda t: minimum_jerk()(t + start)}
    force, still = (
        stimlib.render(scene, motion, 8000, 1.0, params={"A": A}).y[0] for A in (3.4, 0.0)
    )
    true, left = np.abs(force - still).max(), np.abs(vibration(still, 8000)).max()
    assert true > 0.1 and left < 0.01 * true


@pytest.mark.parametrize(
    ("y", "left"), [([1.0, 2.0, 3.0], [0, 0, 0]), ([0.0, 1.0, 0.0], [-1 / 3, 2 / 3, -1 / 3])]
)
def test_a_signal_of_a_few_samples_loses_its_straight_line(y, left):
    np.testing.assert_allclose(vibration(y, 8000), left, atol=1e-12)


@pytest.mark.parametrize("n", [100, 2000, 48000])
def test_what_lies_beyond_the_ends_does_not_matter(n):
    t = np.arange(n) / n
    assert np.abs(vibration(3 + 40 * t - 7 * t**2 + t**3, n)).max() < 1e-10
    if n > 1000:
        tone, edge = np.cos(2 * np.pi * 4 * CUTOFF * t), round(n / CUTOFF / 4)
        wrong = np.abs(vibration(40 * t + tone, n) - tone)
        assert wrong.max() < 0.65 and wrong[edge:-edge].max() < 0.1


def test_a_signal_that_starts_with_vibration_has_no_transient():
    pulses = np.maximum(np.sin(2 * np.pi * 158 * np.arange(8000) / 8000), 0)  # as of bumps
    v = np.abs(vibration(pulses, 8000))
    assert v[:400].max() < 1.1 * v[2000:6000].max()


def test_the_amplitude_is_halved_at_the_cutoff():
    t = np.arange(8000) / 8000
    for f, gain in ((20, 0.004), (40, 0.5), (80, 0.996)):
        assert np.abs(vibration(np.sin(2 * np.pi * f * t), 8000))[2000:6000].max() == pytest.approx(
            gain, abs=0.005
        )
