"""The touch screen's bumps against the paper's tables and the closed forms; along x, y
and both.
"""

import numpy as np
import pytest
from laws import assert_same, mostly
from refusals import refused

import stimlib
from stimlib import BadValue
from stimlib.analysis.am import (
    carrier_series,
    envelope_mean_square,
    envelope_series,
    line_spectrum,
    rms,
    sampled_rms,
)
from stimlib.motion.generators import constant_speed, sinusoid
from stimlib.scenes import bump_grid, bumps
from stimlib.scenes.bumps import Stimulus, bumps_set

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
    ridge, groove = (widths[a::2] for a in ((0, 1) if (y[edges[0] + 1] > 0.5) else (1, 0)))
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


def test_amplitude_zero_is_silent_and_comes_back_in_phase():
    x = 0.05 * np.arange(6000)[None] / FS
    proc, other = (stimlib.compile(bumps("sawtooth", amplitude=a), FS) for a in (0.0, 4.0))
    assert not proc.process(np.ascontiguousarray(x[:, :3000])).any()
    proc.set("A", 4.0, ramp=0)
    y = proc.process(np.ascontiguousarray(x[:, 3000:]))[0]
    assert_same(y[1:], other.process(x)[0, 3001:])  # its first sample starts a movement


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
        ({"headroom": "squash"}, "choose one of clip, scale"),
        ({"headroom": "scale"}, "needs a limit"),
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


# In two directions ------------------------------------------------------------------
HANDS = {"x": sinusoid(0.05, 1.0, 0.05), "y": sinusoid(0.02, 1.7, 0.02)}


def voltage_of(scene, seconds=1.0, **words):
    return stimlib.render(scene, {n: HANDS[n] for n in scene.inputs}, 8000, seconds, words)[
        "voltage"
    ]


@pytest.mark.parametrize("waveform", ["sine", "sawtooth"])
def test_one_direction_alone_is_the_scene_of_bumps(waveform):
    for n, one, size in (
        ("x", bump_grid(waveform, 5, 0, 0.3), {}),
        ("y", bump_grid(waveform, 0, 5, duty_y=0.3, width=0.03), {"length": 0.03}),
    ):
        other = stimlib.render(bumps(waveform, 5, 0.3, **size), {"x": HANDS[n]}, 8000, 0.5)
        np.testing.assert_allclose(voltage_of(one, 0.5), other["voltage"], rtol=0, atol=1e-11)


def test_a_bump_is_where_two_ridges_meet():
    """Square ridges and the place of the finger: on where both are, off elsewhere."""
    v = voltage_of(bump_grid("square", 4, 2, 0.4, 0.7, freq=200.0, rectify=None))
    t = np.arange(8000) / 8000
    u, w = HANDS["x"](t) / 0.025 % 1, HANDS["y"](t) / 0.02 % 1
    edges = (u, 0), (u, 0.4), (u, 1), (w, 0), (w, 0.7), (w, 1)
    far, on = np.min([np.abs(p - e) for p, e in edges], axis=0) >= 0.03, (u < 0.4) & (w < 0.7)
    np.testing.assert_allclose(v[far & on], 200 * np.sin(400 * np.pi * t)[far & on], atol=1e-9)
    assert (v[far & ~on] == 0).all() and far.mean() > 0.6 and 0.2 < on.mean() < 0.4


def test_the_rms_over_the_field_is_the_formulas():
    """A sqrt(duty duty_y)/2, of a finger that scans all of it."""
    scene = bump_grid("square", 6, 3, 0.5, 0.2, amplitude=4.0, gain=1.0)
    hands = {"x": constant_speed(0.7, 0.1), "y": constant_speed(0.0113, 0.04)}
    v = stimlib.render(scene, hands, 8000, 8.0)["voltage"]
    assert np.sqrt(np.mean(v**2)) == pytest.approx(4 * np.sqrt(0.5 * 0.2) / 2, rel=0.03)


def test_after_silence_the_envelope_begins_at_the_place_of_the_finger():
    """Not with the mean over a movement during which the amplitude was still 0."""
    proc = stimlib.compile(bump_grid("square", 1, 0, 0.5, rectify=None, length=1.0), 8000, "python")
    for amplitude, place in ((0.0, 0.2), (4.0, 0.8)):  # on the ridge in silence, and beside it
        proc.set("A", amplitude, ramp=0.0)
        assert (proc.process(np.full((1, 7), place)) == 0).all()


@pytest.mark.parametrize(
    ("scene", "x", "says"),
    [
        (bump_grid("square"), lambda t: 3e5 + HANDS["x"](t), ""),
        (bump_grid(across=0), HANDS["x"], ""),
        (bump_grid(np.array([0.0, 1.0, 0.5, 0.0]), across=0), HANDS["x"], "not tables"),
    ],
)
def test_the_law_takes_far_places_and_leaves_tables_out(scene, x, says):
    motion = {n: HANDS[n] for n in scene.inputs} | {"x": x}
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, 0.3))
    assert report.passed and says in "; ".join(report.evidence.skipped)


@pytest.mark.parametrize(
    "words", [{"along": -1}, {"along": 0, "across": 0}, {"width": 0.0}, {"gain": 0.0}]
)
def test_what_makes_no_sense_is_refused(words):
    refused(BadValue, "bump_grid: ", bump_grid, **words)


# Closed forms against integrals, and rendered scenes against closed forms ------------
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
    lines = line_spectrum(waveform, duty, -2.0, rate=7.7, freq=158.0, top=30_000.0)
    power = abs(lines.amplitude) ** 2 / np.where(lines.f > 0, 2, 1)
    assert np.sqrt(power.sum()) == pytest.approx(rms(waveform, duty, -2.0), rel=3e-4)


def test_sampled_is_plain_at_high_rates_and_square_edges_cost_a_sixth_of_a_sample():
    for waveform in WAVES:
        assert sampled_rms(waveform, 0.3, -2.0, 5.0, 158.0, 1e5) == pytest.approx(
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
    seen = 2 * np.fft.rfft(stimlib.compile(scene, FS).process(x[None])[0, 1:]) / n
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
        ("must be one of", lambda: envelope_series("triangle", 0.5, ONE)),
        ("must be one of", lambda: envelope_mean_square("triangle", 0.5)),
        ("half", lambda: carrier_series("both", ONE)),
        ("half", lambda: rms("sine", 0.5, 1.0, "both")),
        ("rate", lambda: line_spectrum("sine", 0.5, 1.0, 0.0, 100.0, 500.0)),
        ("freq", lambda: line_spectrum("sine", 0.5, 1.0, 1.0, 0.0, 500.0)),
        ("top", lambda: line_spectrum("sine", 0.5, 1.0, 1.0, 100.0, 0.0)),
        ("rate", lambda: sampled_rms("sine", 0.5, 1.0, 0.0, 158.0, 8000.0)),
        ("freq/fs = 1 must", lambda: sampled_rms("sine", 0.5, 1.0, 9.0, 8000.0, 8000.0)),
        ("fs", lambda: sampled_rms("sine", 0.5, 1.0, 9.0, 158.0, -8000.0)),
        ("fs", lambda: line_spectrum("sine", 0.5, 1.0, 9.0, 158.0, 500.0, fs=-8000.0)),
    ],
)
def test_closed_forms_of_nonsense_are_refused(says, call):
    refused(BadValue, says, call)
