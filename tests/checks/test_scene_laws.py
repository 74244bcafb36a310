"""The laws of the other papers' scenes and of the everyday ones: what a verifier holds
their outputs against, and what it then catches.
"""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from laws import mostly

import stimlib
from stimlib import blocks
from stimlib.blocks import track
from stimlib.checks import laws, scenes
from stimlib.checks.evidence import asked, gather
from stimlib.checks.families import contact as touch, surfaces
from stimlib.motion.generators import constant_speed, minimum_jerk, ramp_and_hold, sinusoid
from stimlib.run.driver import samples
from stimlib.run.processor import Change
from stimlib.scenes import bumps, click, detents, friction, grating, impact, viscoelastic, wall


def report(scene, motion, seconds=3.0, fs=8000, **words):
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs, seconds, **words))


def asked_of(r):
    return asked(r.evidence, r.evidence.scene.parts[0])


@pytest.mark.parametrize(
    "case",
    mostly(
        [(0.0, "gl", 1000), (0.05, "l1", 8000), (0.5, "l1", 1000), (0.95, "gl", 8000)],
        itertools.product((0.0, 0.05, 0.5, 0.95, 1.0), ("gl", "l1"), (1000, 8000)),
    ),
)
def test_viscoelastic_is_proved(case):
    alpha, scheme, fs = case
    scene = viscoelastic(alpha, scheme=scheme)
    for motion in (sinusoid(0.01, 1.0), ramp_and_hold(0.02, 0.2)):
        r = report(scene, {"y": motion}, 1.0, fs, params={"firmness": 1.3})
        assert r.passed, str(r)
        assert any("full sum" in c.name for c in r.checks)


@pytest.mark.parametrize(
    ("live", "words"),
    [
        (True, {}),
        (True, {"contact": True, "smoothing": 50.0}),
        (False, {"smoothing": 80.0}),
        (False, {"guide": 50.0}),
    ],
)
def test_viscoelastic_with_options_is_proved(live, words):
    """Positions that are tracked, contact, and a live order, also while it ramps."""
    scene = viscoelastic(0.3, live=live, **words)
    motion = {"y": sinusoid(0.01, 1.0), "contact": lambda t: 1.0 * (np.sin(9 * t) > -0.5)}
    motion |= {"x": sinusoid(0.004, 2.0), "z": lambda t: 0.002 - 0.001 * t}
    motion = {name: motion[name] for name in scene.inputs}
    r = report(scene, motion, 1.0, 1000)
    assert r.passed and any("full sum" in c.name for c in r.checks), str(r)
    want, tol = r.evidence.wanted["force"]()  # the report draws the full sum
    assert np.abs(want - r.evidence.y[0]).max() <= tol
    assert 1e-12 < tol / np.abs(want).max() < 1e-5
    if "guide" in words:  # to the line from each side, and the law sees a stiffer one
        t, sides = np.arange(1000) / 1000, r.evidence.y[1:]
        across = [0.2 * np.sin(4 * np.pi * t), 50 * (0.002 - t / 1000)]
        np.testing.assert_allclose(sides, across, rtol=0, atol=1e-12)
        stiff = stimlib.Scene(viscoelastic(0.3, guide=50.1).outputs, scene.parts)
        (bad, other) = [c for c in report(stiff, motion, 1.0, 1000).checks if not c.passed]
        assert "guide_x" in bad.name and "guide_z" in other.name
    if live:
        e = r.evidence
        e.changes = [Change(200, "alpha", 0.9, 0.3)]
        e.y = samples(stimlib.compile(scene, 1000, seed=e.seed), e.x, e.x.shape[1], e.changes)
        checks = scenes.scene_law(dataclasses.replace(e, skipped=[], wanted={}, taps=[]))
        assert checks and all(c.passed for c in checks), checks


@pytest.mark.parametrize("words", [{"live": True}, {"live": False, "smoothing": 50.0}])
def test_viscoelastic_is_what_its_options_say(words):
    """All orders are as strong at w, and a live one is the fixed one of that order."""
    y = 0.01 * np.sin(2 * np.pi * (np.arange(3000) / 1000))
    live = stimlib.render(
        viscoelastic(0.0, **words), {"y": y}, 1000, params={"alpha": 0.7} if words["live"] else {}
    )
    way = y
    if "smoothing" in words:
        tracked = stimlib.compile(stimlib.Scene({"y": track(stimlib.Input("y", "m"), 50.0)}), 1000)
        way = tracked.process(y[None])[0]
    fixed = stimlib.render(viscoelastic(0.7 if words["live"] else 0.0), {"y": way}, 1000)
    np.testing.assert_allclose(live["force"], fixed["force"], rtol=0, atol=3e-8)


def test_weights_are_those_of_the_paper():
    v = laws.springpot_weights("gl", 0.5, 5)
    np.testing.assert_allclose(
        np.cumsum(np.r_[1.0, -0.5, -0.125, -0.0625, -0.0390625])[:5], v.astype(float), rtol=1e-15
    )
    v = laws.springpot_weights("l1", 0.5, 300).astype(float)
    assert (
        v[0] == pytest.approx(2 / np.sqrt(np.pi))
        and abs(np.sum(v) - np.sqrt(300) * 2 / np.sqrt(np.pi)) < 1e-12
    )


@pytest.mark.parametrize(
    "case",
    mostly(
        [("square", 1.0), ("sine", 0.2), ("sawtooth", 0.5), ("half_sine", 0.5)],
        itertools.product(("square", "sine", "sawtooth", "half_sine"), (0.2, 0.5, 1.0)),
    ),
)
def test_bumps_are_proved(case):
    waveform, duty = case
    for motion, steady in (
        (constant_speed(0.03, 0.1), True),
        (minimum_jerk(depth=0.1, rise=0.5), False),
        (sinusoid(0.05, 3.0), False),
    ):
        r = report(bumps(waveform, 18, duty, 7.5), {"x": motion}, 1.0)
        assert r.passed, str(r)
        assert ("rms of the line spectrum" in str(r)) == steady


@pytest.mark.parametrize(("factor", "refused"), [(1.0, False), (1.02, True)])
def test_bumps_that_are_larger_by_a_fiftieth_have_another_rms(factor, refused):
    a = asked_of(report(bumps(), {"x": constant_speed(0.03, 0.1)}))
    checks = scenes.SCENES["bumps"](dataclasses.replace(a, y={"voltage": factor * a.y["voltage"]}))
    assert any("rms of the line spectrum" in c.name for c in checks if not c.passed) is refused


@pytest.mark.parametrize("make", [bumps, stimlib.scenes.touch_screen])
@pytest.mark.parametrize(
    ("name", "text"),
    [("waveform", "sinus"), ("waveform", "square "), ("rectify", "Half"), ("rectify", "")],
)
def test_words_that_no_law_knows_are_refused(make, name, text):
    """That of the touch screen took an unknown waveform for a sine, and passed."""
    scene, motion = make("sine", amplitude=0.1, rectify=None), {"x": np.zeros(9)}
    part = dataclasses.replace(scene.parts[0], given=scene.parts[0].given | {name: text})
    other = stimlib.Scene(scene.outputs, [part])
    e = gather(other, motion, stimlib.render(other, motion, 8000))
    (bad,) = [c for c in scenes.scene_law(e) if not c.passed]
    assert bad.name == "shape of the scene" and f"{text!r} is not known; choose" in bad.text


PROFILE = [0.0, 0.03, 0.05, 0.07, 0.1], [1.0, 1.6, 1.84, 1.6, 1.0]
MANY = np.linspace(0, 0.1, 9), 1 + 0.8 * np.sin(np.pi * np.linspace(0, 1, 9))
HELD = {
    "limit": ({"limit": 150.0}, "limited to 150 V, "),
    "scale": ({"limit": 150.0, "headroom": "scale"}, "0 samples held"),
    "profile": (
        {"displacement": PROFILE},
        "equalised by 5 measured places (polynomial), at most 1.84 times",
    ),
    "cubic, limit": ({"displacement": MANY, "limit": 180.0}, "(cubic)"),
    "profile, scale, lifts": (
        {"displacement": PROFILE, "limit": 180.0, "headroom": "scale", "contact": True},
        "0 samples held",
    ),
}


@pytest.mark.parametrize(
    ("name", "wrong"),
    [*((name, None) for name in HELD), ("scale", "law"), ("profile", "law"), ("profile", "limit")],
)
def test_bumps_with_limits_and_profiles_are_proved(monkeypatch, name, wrong):
    words, says = HELD[name]
    motion = {"x": constant_speed(0.05, 0.12)} | (
        {"contact": lambda t: 1.0 * (np.sin(9 * t) > -0.5)} if "contact" in words else {}
    )
    if wrong == "law":  # a law one per mille off is not what was rendered
        honest = laws.bump_envelope
        monkeypatch.setattr(laws, "bump_envelope", lambda *a: honest(*a) * [[1.001], [1.0]])
    if wrong == "limit":
        honest_gain = laws.profile_gain
        monkeypatch.setattr(
            laws, "profile_gain", lambda *a: (honest_gain(*a)[0] * 1.001, honest_gain(*a)[1])
        )
    r = report(bumps("sine", 18, 0.5, **words), motion, 1.0)
    assert r.passed == (wrong is None), str(r)
    numbers = "; ".join(r.evidence.numbers)
    assert "amplifier 50, wavelength 5.556 mm" in numbers and (wrong or says in numbers)


def test_a_grating_is_proved_over_lifts_and_caught_off_its_octaves(monkeypatch):
    motion = {"x": sinusoid(0.05, 1.0), "contact": lambda t: 1.0 * (np.sin(90 * t) > -0.3)}
    r = report(grating(contact=True), motion, 0.2, params={"roughness": 0.1})
    assert r.passed, str(r)
    honest = surfaces.octaves
    for factor in (1.2, 0.8):
        monkeypatch.setattr(
            surfaces, "octaves", lambda *a, f=factor: (o := honest(*a))._replace(power=f * o.power)
        )
        bad = [c.name for c in surfaces.grating(asked_of(r)) if not c.passed]
        assert "force: octaves of the roughness" in bad


OTHERS = {
    law: stimlib.Scene({"voltage": 2 * stimlib.Input("x")}, law=law, given={})
    for law in ("squeeze", "viscoelastic", "bumps", "grating", "texture", "soft_surface")
} | {
    "wall": stimlib.Scene(
        {"force": blocks.wall(stimlib.Input("x", "m"), hunt_crossley=1.0)}, "wall", {"at": 0.0}
    )
}


@pytest.mark.parametrize("law", OTHERS)
def test_a_law_on_a_scene_of_another_shape_fails_and_says_so(law):
    (bad,) = [
        c for c in report(OTHERS[law], {"x": sinusoid(2e-3, 5.0)}, 0.1).checks if not c.passed
    ]
    assert bad.name == "shape of the scene" and (law != "wall" or "'k'" in bad.text)


def test_a_force_is_held_to_its_limits_to_the_last_bit():
    """100 N either way, and a mean square over 10 s of 37^2 N^2, which 100 N reaches
    after 1.4715 s.
    """
    scene = stimlib.scenes.squeeze(fingers=1, limits=True)
    force = np.full(11_800, 100.0)
    for y, bad in (
        (force[:11_771], []),
        (force, ["force1: static limit"]),
        (np.nextafter(force[:9], 101.0), ["force1: peak limit"]),
        (-np.nextafter(force[:9], 101.0), ["force1: peak limit"]),
    ):
        e = SimpleNamespace(scene=scene, fs=8000.0, y=[y])
        e.stretches = lambda e=e: [e]
        assert [c.name for c in scenes.motor_limits(e) if not c.passed] == bad


# The everyday scenes ----------------------------------------------------------------
CASES = {
    "click": (click, {"x": sinusoid(1.3e-3, 3.0, 1e-3)}, {"peak": 1.5}),
    "detents": (detents, {"angle": sinusoid(1.0, 2.0)}, {"depth": 0.03}),
    "friction": (friction, {"x": sinusoid(0.02, 2.0)}, {"normal": 0.7}),
    "wall": (wall, {"x": sinusoid(2e-3, 5.0)}, {"b": 3.0}),
    "impact": (impact, {"x": sinusoid(5e-3, 3.0)}, {"A": 7.0}),
}


def of_touch(name, seconds=0.3):
    make, motion, params = CASES[name]
    return report(make(), motion, seconds, 4000, params=params)


def test_springs_that_drag_follow_their_limits():
    """A limit that falls takes the force along; a held spring keeps it, and one that
    was never moved has none; a way without end has no number.
    """
    x, on = np.array([0.0, 3.0, 3.0, 3.0, 2.5]), np.ones(5)
    np.testing.assert_allclose(
        touch.dragged(x, 1.0, on, np.array([2, 2, 2, 1, 0.5]), touch.coulomb),
        [0, 4 / 3, 2, 1, 0.25],
    )
    half, far = np.full(5, 0.5), np.array([-1.7e308, 1.7e308, 0, 0, 0])
    np.testing.assert_array_equal(touch.stick_slip(0 * x, on, 1.0, half, 0.5, half)[0], 0 * x)
    with np.errstate(all="ignore"):
        assert not np.isfinite(touch.stick_slip(far, on, 1e3, half, 0.5, 0 * x)[0]).all()


def test_a_wall_that_pulls_a_little_is_caught_by_its_sign():
    e = of_touch("wall").evidence
    e.y = e.y - 1e-9
    assert [c.name for c in touch.wall_law(asked(e, e.scene.parts[0])) if not c.passed] == [
        "force: it never pulls"
    ]


def test_a_report_says_what_was_rendered():
    """Numbers of the graph alone, as the law has read them."""
    for name, text in (
        ("click", "back at 0.8 mm, 1 of them"),
        ("detents", "24 detents a turn"),
        ("friction", "it slips at 0.56 N, to 0.35 N, every 0.21 mm"),
        ("wall", "a wall of 1000 N/m and 3 N s/m at 0 m"),
    ):
        said = "; ".join(of_touch(name, seconds=0.6).evidence.numbers)
        assert text in said, said
