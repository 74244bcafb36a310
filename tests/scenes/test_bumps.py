"""The touch screen's bumps against the paper's tables and the closed forms."""

import numpy as np
import pytest
from laws import assert_same, mostly, played
from refusals import refused

import stimlib
from stimlib.analysis.am import rms, sampled_rms
from stimlib.errors import BadValue, UnknownName
from stimlib.scenes.bumps import Stimulus, bumps, bumps_set

FS = 8000.0

TABLE_4_1 = {  # (number of bumps, duty): ridge and groove width in mm
    (2, 0.2): (10, 40), (2, 0.5): (25, 25), (2, 0.8): (40, 10),
    (6, 0.2): (3.33, 13.33), (6, 0.5): (8.33, 8.33), (6, 0.8): (13.33, 3.33),
    (18, 0.2): (1.11, 4.44), (18, 0.5): (2.78, 2.78), (18, 0.8): (4.44, 1.11),
}  # fmt: skip
TABLE_6_1 = {  # (waveform, amplitude in V): RMS in V at duty 0.2, 0.5, 0.8
    ("sine", 0.5): (0.08, 0.13, 0.15),
    ("square", 0.5): (0.11, 0.18, 0.22),
    ("sawtooth", 0.5): (0.06, 0.10, 0.12),
    ("sine", 4.0): (0.65, 1.0, 1.18),
    ("square", 4.0): (0.89, 1.41, 1.79),
    ("sawtooth", 4.0): (0.44, 0.80, 0.99),
    ("sine", 7.5): (1.23, 1.88, 2.21),
    ("square", 7.5): (1.66, 2.64, 3.35),
    ("sawtooth", 7.5): (0.83, 1.51, 1.85),
}


def test_the_set_is_the_experiment():
    stimuli = bumps_set()
    assert len(set(stimuli)) == 81
    for s in stimuli:
        assert (round(1e3 * s.ridge, 2), round(1e3 * s.groove, 2)) == TABLE_4_1[s.bumps, s.duty]
    assert {round(1e6 * s.displacement, 9) for s in stimuli} == {15, 120, 225}
    assert {(s.waveform, s.amplitude) for s in stimuli} == set(TABLE_6_1)


@pytest.mark.parametrize(("nb", "duty"), TABLE_4_1)
def test_ridges_and_grooves_of_the_rendered_signal(nb, duty):
    """Table 4.1 from samples: on a slow stroke, how far the voltage is on and off."""
    speed = 0.02
    x = 0.01 + speed * np.arange(int(0.1 / speed * FS) + 1) / FS
    y = stimlib.compile(
        bumps("square", nb, duty, gain=1.0, amplitude=1.0, rectify=None, freq=0.0, phase=np.pi / 2),
        FS,
    ).process(x[None])[0]
    edges = np.flatnonzero(np.diff((y > 0.5).astype(int)))
    widths = 1e3 * np.diff(x[edges])
    first_is_ridge = y[edges[0] + 1] > 0.5
    ridge, groove = (widths[a::2] for a in ((0, 1) if first_is_ridge else (1, 0)))
    for seen, printed in ((ridge, TABLE_4_1[nb, duty][0]), (groove, TABLE_4_1[nb, duty][1])):
        assert (
            np.abs(seen - printed).max() <= 0.005 + 2 * 1e3 * speed / FS if seen.size else nb == 2
        )
    assert y[1:].mean() == pytest.approx(duty, abs=1e-12)  # whole bumps


@pytest.mark.parametrize(("waveform", "amplitude"), TABLE_6_1)
def test_table_6_1(waveform, amplitude):
    ours = [rms(waveform, d, amplitude) for d in (0.2, 0.5, 0.8)]
    printed = TABLE_6_1[waveform, amplitude]
    # a ramp has more: the paper's figures are up to 15 % below it, and ours are not
    # fitted to them
    if waveform == "sawtooth":
        ratio = np.array(printed) / ours
        assert (ratio < 1.05).all() and (ratio > 0.82).all()
        assert amplitude == 0.5 or (ratio < 1).all()
    elif amplitude > 1:
        np.testing.assert_allclose(ours, printed, rtol=0.011)
    else:
        np.testing.assert_allclose(ours, printed, atol=0.01)


def stroke(s, speed, phases=8):
    """RMS in V before the amplifier of one stroke over 0.1 m, mean of squares over
    carrier phases.
    """
    x = speed * np.arange(round(0.1 / speed * FS) + 1) / FS
    turned = (bumps(*s, phase=2 * np.pi * k / phases) for k in range(phases))
    y = np.array([stimlib.compile(scene, FS).process(x[None])[0, 1:] for scene in turned])
    return np.sqrt(np.mean(y * y)) / 50


ALL = bumps_set()


@pytest.mark.parametrize("s", mostly(ALL[::9], ALL), ids=lambda s: "-".join(map(str, s)))
def test_rms_of_all_81(s):
    assert stroke(s, 0.02) == pytest.approx(rms(s.waveform, s.duty, s.amplitude), rel=1e-3)
    fast = sampled_rms(s.waveform, s.duty, s.amplitude, 0.1 * s.bumps / 0.1, 158.0, FS)
    assert stroke(s, 0.1) == pytest.approx(fast, rel=1e-3)


def test_bumps_stay_at_their_places():
    """Two movements, one surface: what is felt over a ridge does not depend on how the
    finger came there.
    """
    scene = bumps("sine", 6, rectify=None, freq=0.0, phase=np.pi / 2, gain=1.0, amplitude=1.0)
    there = 0.05 * (1 - np.cos(2 * np.pi * np.arange(8000) / FS))
    slow, fast = (
        stimlib.compile(scene, FS).process(np.ascontiguousarray(there[None, ::step]))[0]
        for step in (1, 7)
    )
    middle = (there[1:] + there[:-1]) / 2
    order = np.argsort(middle)
    felt = np.interp((there[7::7] + there[:-7:7]) / 2, middle[order], slow[1:][order])
    np.testing.assert_allclose(fast[1:], felt, atol=0.015)


def test_contact():
    """Silent off contact; re-contact somewhere else plays no bumps in between; the
    carrier goes on.
    """
    n = 4000
    x = np.r_[0.03 * np.arange(n) / FS, np.full(n, np.nan), 0.08 + 0.02 * np.arange(n) / FS]
    touch = np.repeat([1.0, 0.0, 1.0], n)
    proc = stimlib.compile(bumps("sine", contact=True), FS)
    assert proc.inputs == ("x", "contact")
    y = proc.process(np.stack([x, touch]))[0]
    assert not y[n : 2 * n].any() and y[:n].any() and proc.fault is None
    whole = stimlib.compile(bumps("sine"), FS)
    whole.process(np.full((1, 2 * n), 0.08))
    assert_same(whole.process(np.ascontiguousarray(x[None, 2 * n :]))[0], y[2 * n :])


def test_a_missing_contact_column_is_an_error():
    motion = {"x": np.zeros(100)}
    refused(UnknownName, "contact is missing", stimlib.render, bumps(contact=True), motion, FS)


def test_amplitude_zero_is_silent_and_comes_back_in_phase():
    x = 0.05 * np.arange(6000)[None] / FS
    proc, other = (stimlib.compile(bumps("sawtooth", amplitude=a), FS) for a in (0.0, 4.0))
    assert not proc.process(np.ascontiguousarray(x[:, :3000])).any()
    proc.set("A", 4.0, ramp=0)
    y = proc.process(np.ascontiguousarray(x[:, 3000:]))[0]
    assert_same(y[1:], other.process(x)[0, 3001:])  # its first sample starts a movement


def test_equalised():
    """Constant displacement up to the limit: 1 % between the knots, whatever the
    policy.
    """
    knots = np.linspace(0, 0.1, 5)

    def mode(x):
        return np.cos(0.78 * np.pi * (np.asarray(x) - 0.05) / 0.1 * 0.8)

    x = 0.02 * np.arange(40_001) / FS
    middle = np.r_[x[0], (x[1:] + x[:-1]) / 2]
    kw = {
        "displacement": (knots, 225e-6 * mode(knots)),
        "amplitude": 7.5,
        "rectify": None,
        "freq": 0.0,
        "phase": np.pi / 2,
        "duty": 1.0,
    }
    free = stimlib.compile(bumps(**kw), FS).process(x[None])[0]
    assert np.abs(free * mode(middle) / 375 - 1).max() < 0.01
    clipped = stimlib.compile(bumps(**kw, limit=400.0), FS).process(x[None])[0]
    np.testing.assert_array_equal(clipped, np.minimum(free, 400.0))
    scaled = stimlib.compile(bumps(**kw, limit=400.0, headroom="scale"), FS).process(x[None])[0]
    assert scaled.max() == pytest.approx(400.0, rel=1e-3) and scaled.max() <= 400.0
    assert np.abs(scaled * mode(middle) / (scaled * mode(middle)).mean() - 1).max() < 0.01


@pytest.mark.parametrize("headroom", ["clip", "scale"])
def test_limits_without_a_profile(headroom):
    x = 0.02 * np.arange(8000) / FS
    free = played(bumps(amplitude=7.5).outputs, x, fs=FS)[0]
    y = played(bumps(amplitude=7.5, limit=300.0, headroom=headroom).outputs, x, fs=FS)[0]
    wanted = np.minimum(free, 300.0) if headroom == "clip" else free * 300 / 375
    np.testing.assert_allclose(y, wanted, rtol=1e-12)


@pytest.mark.parametrize(
    ("kw", "match"),
    [
        ({"bumps": 0}, "bumps = 0"),
        ({"bumps": -2}, "bumps"),
        ({"length": 0.0}, "length"),
        ({"gain": -50.0}, "gain"),
        ({"duty": 0.0}, "duty"),
        ({"duty": 1.2}, "duty"),
        ({"waveform": "triangle"}, "triangle"),
        ({"rectify": "positive"}, "rectify"),
        ({"freq": -158.0}, "freq"),
        ({"limit": 0.0}, "limit"),
        ({"limit": 100.0, "headroom": "squash"}, "headroom"),
        ({"amplitude": float("nan")}, "finite"),
        ({"displacement": ([0, 0.1], [1, 0])}, "above 0"),
        ({"freq": 4100.0}, "below fs/2"),
    ],
)
def test_bad_input(kw, match):
    refused(BadValue, match, lambda: stimlib.compile(bumps(**kw), FS))


def test_a_stimulus_is_a_scene():
    units = stimlib.compile(bumps(), FS).units
    assert (units["x"], units["voltage"], units["A"], units["freq"]) == ("m", "V", "V", "1/s")
    assert (
        bumps(*Stimulus("sine", 6, 0.5, 4.0)).hash
        == bumps("sine", bumps=6, duty=0.5, amplitude=4.0).hash
    )
