"""Bumps along x, along y and in both directions."""

import numpy as np
import pytest
from refusals import refused

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
    for n, one, size in (
        ("x", bump_grid(waveform, 5, 0, 0.3), {}),
        ("y", bump_grid(waveform, 0, 5, duty_y=0.3, width=0.03), {"length": 0.03}),
    ):
        other = stimlib.render(bumps(waveform, 5, 0.3, **size), {"x": HANDS[n]}, 8000, 0.5)
        np.testing.assert_allclose(rendered(one, 0.5), other["voltage"], rtol=0, atol=1e-11)


def test_a_bump_is_where_two_ridges_meet():
    """Square ridges and the place of the finger: on where both are, off elsewhere."""
    v = rendered(bump_grid("square", 4, 2, 0.4, 0.7, freq=200.0, rectify=None))
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


@pytest.mark.parametrize(("factor", "passed"), [(1.0, True), (1.00001, False)])
def test_the_law_sees_another_voltage(factor, passed):
    scene = bump_grid("sine")
    changed = Scene({"voltage": factor * scene.outputs["voltage"]}, scene.parts)
    r = stimlib.render(changed, HANDS, 8000, 0.3, {"A": 3.0, "duty_y": 0.7})
    report = stimlib.verify(changed, HANDS, r)
    assert report.passed is passed
    want, tol = report.evidence.wanted["voltage"]()  # what the report draws
    assert (np.abs(want - r["voltage"]).max() <= tol) == passed


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
