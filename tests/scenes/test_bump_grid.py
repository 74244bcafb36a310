"""Bumps along x, along y and in both directions."""

import numpy as np
import pytest

import stimlib
from stimlib import BadValue, Scene
from stimlib.motion.generators import constant_speed, sinusoid
from stimlib.scenes import bump_grid, bumps

HANDS = {"x": sinusoid(0.05, 1.0, 0.05), "y": sinusoid(0.02, 1.7, 0.02)}


def rendered(scene, seconds=1.0, **words):
    return stimlib.render(scene, {n: HANDS[n] for n in scene.inputs}, 8000, seconds, words)[
        "voltage"
    ]


@pytest.mark.parametrize("waveform", ["sine", "sawtooth"])
def test_one_direction_alone_is_the_scene_of_bumps(waveform):
    one = stimlib.render(bumps(waveform, 5, 0.3), {"x": HANDS["x"]}, 8000, 0.5)["voltage"]
    np.testing.assert_array_equal(rendered(bump_grid(waveform, 5, 0, 0.3), 0.5), one)
    other = stimlib.render(bumps(waveform, 5, 0.3, length=0.03), {"x": HANDS["y"]}, 8000, 0.5)
    got = rendered(bump_grid(waveform, 0, 5, duty_y=0.3, width=0.03), 0.5)
    np.testing.assert_allclose(got, other["voltage"], atol=1e-11)


def test_a_bump_is_where_two_ridges_meet():
    """Square ridges and the place of the finger: on where both are, off elsewhere."""
    v = rendered(
        bump_grid("square", 4, 2, 0.4, 0.7, amplitude=1.0, gain=1.0, rectify=None, freq=0.0)
    )
    assert (v == 0).all()  # a carrier of 0 Hz that begins at 0
    v = rendered(bump_grid("square", 4, 2, 0.4, 0.7, freq=200.0, rectify=None), 1.0)
    t = np.arange(8000) / 8000
    u, w = HANDS["x"](t) / 0.025 % 1, HANDS["y"](t) / 0.02 % 1
    near = [
        np.min([np.abs(p - e) for e in (0, d, 1)], axis=0) < 0.03 for p, d in ((u, 0.4), (w, 0.7))
    ]
    far = ~(near[0] | near[1])
    on = (u < 0.4) & (w < 0.7)
    wave = 200 * np.sin(2 * np.pi * 200 * t)
    np.testing.assert_allclose(v[far & on], wave[far & on], atol=1e-9)
    assert (v[far & ~on] == 0).all() and far.mean() > 0.6 and 0.2 < on.mean() < 0.4


def test_the_rms_over_the_field_is_the_formulas():
    """A sqrt(duty duty_y)/2, of a finger that scans all of it."""
    scene = bump_grid("square", 6, 3, 0.5, 0.2, amplitude=4.0, gain=1.0)
    hands = {"x": constant_speed(0.7, 0.1), "y": constant_speed(0.0113, 0.04)}
    v = stimlib.render(scene, hands, 8000, 8.0)["voltage"]
    assert np.sqrt(np.mean(v**2)) == pytest.approx(4 * np.sqrt(0.5 * 0.2) / 2, rel=0.03)


def test_the_law_sees_another_voltage():
    scene = bump_grid("sine")
    for factor, passed in ((1.0, True), (1.00001, False)):
        changed = Scene({"voltage": factor * scene.outputs["voltage"]}, scene.parts)
        r = stimlib.render(changed, HANDS, 8000, 0.3, {"A": 3.0, "duty_y": 0.7})
        report = stimlib.verify(changed, HANDS, r)
        assert report.passed is passed
        want, tol = report.evidence.wanted["voltage"]()  # what the report draws
        assert (np.abs(want - r["voltage"]).max() <= tol) == passed
    one = bump_grid(across=0)
    r = stimlib.render(one, {"x": HANDS["x"]}, 8000, 0.3)
    assert stimlib.verify(one, {"x": HANDS["x"]}, r).passed


def test_nothing_is_computed_at_amplitude_zero():
    assert (rendered(bump_grid(), 0.2, A=0.0) == 0).all()


def test_after_silence_the_envelope_begins_at_the_place_of_the_finger():
    """Not with the mean over a movement during which the amplitude was still 0."""
    scene = bump_grid("square", 1, 0, 0.5, rectify=None, length=1.0)
    proc = stimlib.compile(scene, 8000, "python")
    proc.set("A", 0.0, ramp=0.0)
    assert (proc.process(np.full((1, 7), 0.2)) == 0).all()
    proc.set("A", 4.0, ramp=0.0)
    assert (proc.process(np.full((1, 3), 0.8)) == 0).all()  # beside the ridge


def test_the_law_takes_far_places_and_leaves_tables_out():
    hands = {"x": lambda t: 3e5 + HANDS["x"](t), "y": HANDS["y"]}
    scene = bump_grid("square")
    assert stimlib.verify(scene, hands, stimlib.render(scene, hands, 8000, 0.3)).passed
    scene = bump_grid(np.array([0.0, 1.0, 0.5, 0.0]), across=0)
    hand = {"x": HANDS["x"]}
    report = stimlib.verify(scene, hand, stimlib.render(scene, hand, 8000, 0.3))
    assert report.passed and any("not tables" in s for s in report.evidence.skipped)


def test_what_makes_no_sense_is_refused():
    for words in ({"along": -1}, {"along": 0, "across": 0}, {"width": 0.0}, {"gain": 0.0}):
        with pytest.raises(BadValue, match="bump_grid: "):
            bump_grid(**words)
