"""The closed forms against numerical integrals, and rendered scenes against the closed
forms.
"""

import numpy as np
import pytest
from refusals import refused

import stimlib
from stimlib.analysis.am import (
    carrier_series,
    envelope_mean_square,
    envelope_series,
    line_spectrum,
    rms,
    sampled_rms,
)
from stimlib.errors import BadValue
from stimlib.scenes.bumps import bumps

FS = 8000.0
WAVES, ONE = ("square", "sine", "sawtooth", "half_sine"), np.arange(3)


def ridge(waveform, duty, nodes=200):
    """Places on the ridge, weights of Gauss and Legendre, and the envelope there."""
    z, weight = np.polynomial.legendre.leggauss(nodes)
    w = duty * (z + 1) / 2
    e = {
        "square": np.ones_like(w),
        "sawtooth": w / duty,
        "half_sine": np.sin(np.pi * w / duty),
        "sine": np.sin(np.pi * w) * np.sin(np.pi * (duty - w)) / np.sin(np.pi * duty / 2) ** 2,
    }[waveform]
    return w, weight * duty / 2, e


@pytest.mark.parametrize("waveform", WAVES)
@pytest.mark.parametrize("duty", [1e-4, 0.2, 2 / 3, 1.0])
def test_envelopes(waveform, duty):
    w, weight, e = ridge(waveform, duty)
    n = np.arange(-60, 61)
    E = np.exp(-2j * np.pi * n[:, None] * w) @ (weight * e)
    tol = 1e-13 + 1e-16 / duty**2
    np.testing.assert_allclose(envelope_series(waveform, duty, n), E, rtol=0, atol=tol * duty)
    assert envelope_mean_square(waveform, duty) == pytest.approx(np.sum(weight * e * e), rel=1e-12)


@pytest.mark.parametrize(
    ("rectify", "f"),
    [
        (None, np.sin),
        ("half", lambda x: np.maximum(np.sin(x), 0)),
        ("full", lambda x: abs(np.sin(x))),
    ],
)
def test_carriers(rectify, f):
    m = np.arange(-30, 31)
    z, weight = np.polynomial.legendre.leggauss(100)
    x = np.concatenate([np.pi * (z + 1) / 2, np.pi * (z + 3) / 2])
    C = np.exp(-1j * m[:, None] * x) @ (np.tile(weight / 4, 2) * f(x))
    np.testing.assert_allclose(carrier_series(rectify, m), C, atol=1e-14)
    many = carrier_series(rectify, np.arange(-20000, 20001))
    assert rms("square", 1.0, 3.0, rectify) == pytest.approx(
        3 * np.sqrt(np.sum(abs(many) ** 2)), rel=1e-9
    )


@pytest.mark.parametrize("waveform", WAVES)
@pytest.mark.parametrize("duty", [0.2, 0.8])
def test_rms_is_the_sum_of_all_lines(waveform, duty):
    lines = line_spectrum(waveform, duty, 2.0, rate=7.7, freq=158.0, top=30_000.0)
    power = abs(lines.amplitude) ** 2 / np.where(lines.f > 0, 2, 1)
    assert np.sqrt(power.sum()) == pytest.approx(rms(waveform, duty, 2.0), rel=3e-4)


def test_sampled_is_plain_at_high_rates_and_square_edges_cost_a_sixth_of_a_sample():
    for waveform in WAVES:
        assert sampled_rms(waveform, 0.3, 2.0, 5.0, 158.0, 1e5) == pytest.approx(
            rms(waveform, 0.3, 2.0), rel=1e-4
        )
    step = 18.0 / FS
    carrier = sampled_rms("square", 1.0, 1.0, 18.0, 158.0, FS) ** 2
    assert sampled_rms("square", 0.2, 1.0, 18.0, 158.0, FS) ** 2 == pytest.approx(
        (0.2 - step / 3) * carrier, rel=1e-8
    )


@pytest.mark.parametrize(
    ("waveform", "rectify"),
    [("square", "half"), ("sine", "full"), ("sawtooth", None), ("half_sine", "half")],
)
def test_lines_of_a_rendered_scene(waveform, rectify):
    """Constant speed; every line up to 1 kHz, size and phase."""
    n, speed = 80_000, 0.1  # 10 s: lines on multiples of 0.1 Hz
    # one more before, so that the first sample is a mean too
    x = 0.003 + speed * np.arange(-1, n) / FS
    scene = bumps(
        waveform,
        18.3,
        0.4,
        1.0,
        gain=1.0,
        freq=157.7,
        phase=0.6 - 2 * np.pi * 157.7 / FS,
        rectify=rectify,
    )
    y = stimlib.compile(scene, FS).process(x[None])[0, 1:]
    seen = 2 * np.fft.rfft(y) / n
    seen[0] /= 2
    said = line_spectrum(waveform, 0.4, 1.0, 18.3, 157.7, 1000.0, rectify, FS, 0.003 * 183, 0.6)
    at = np.rint(said.f * n / FS).astype(int)
    np.testing.assert_allclose(said.f * n / FS, at, atol=1e-6)
    assert np.abs(seen[at] - said.amplitude).max() <= 1e-3 * np.abs(said.amplitude).max()
    others = np.ones(10_000, bool)
    others[at[at < 10_000]] = False
    # aliases
    assert np.sum(abs(seen[:10_000][others]) ** 2) <= 3e-6 * np.sum(abs(seen[:10_000]) ** 2)


@pytest.mark.parametrize(
    ("says", "call"),
    [
        *(
            ("duty", call)
            for duty in (0.0, -1.0, 1.1)
            for call in (
                lambda d=duty: envelope_series("sine", d, ONE),
                lambda d=duty: envelope_mean_square("sine", d),
                lambda d=duty: rms("square", d),
            )
        ),
        ("choose one of", lambda: envelope_series("triangle", 0.5, ONE)),
        ("choose one of", lambda: envelope_mean_square("triangle", 0.5)),
        ("half", lambda: carrier_series("both", ONE)),
        ("half", lambda: rms("sine", 0.5, 1.0, "both")),
        ("rate", lambda: line_spectrum("sine", 0.5, 1.0, 0.0, 100.0, 500.0)),
        ("freq", lambda: line_spectrum("sine", 0.5, 1.0, 1.0, 0.0, 500.0)),
        ("top", lambda: line_spectrum("sine", 0.5, 1.0, 1.0, 100.0, 0.0)),
        ("rate", lambda: sampled_rms("sine", 0.5, 1.0, 0.0, 158.0, 8000.0)),
    ],
)
def test_errors(says, call):
    refused(BadValue, says, call)
