"""The laws of the other papers' scenes: what a verifier holds their outputs against,
and what it then catches.
"""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import stimlib
from stimlib.blocks import track
from stimlib.blocks.fractional import Springpot
from stimlib.blocks.surfaces import Grating, LinearBump, SpatialNoise
from stimlib.checks import laws, scenes
from stimlib.checks.evidence import asked
from stimlib.checks.families import impedance, surfaces
from stimlib.motion.generators import constant_speed, minimum_jerk, ramp_and_hold, sinusoid
from stimlib.motion.recorded import recording
from stimlib.run.driver import samples
from stimlib.run.processor import Change
from stimlib.scenes import bumps, grating, viscoelastic

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "touch-evemu"


def report(scene, motion, seconds=3.0, fs=8000, **words):
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs, seconds, **words))


@pytest.mark.parametrize("scheme", ["gl", "l1"])
@pytest.mark.parametrize("alpha", [0.0, 0.05, 0.5, 0.95, 1.0])
@pytest.mark.parametrize("fs", [1000, 8000])
def test_viscoelastic_is_proved(alpha, scheme, fs):
    for motion in (sinusoid(0.01, 1.0), ramp_and_hold(0.02, 0.2)):
        r = report(
            viscoelastic(alpha, scheme=scheme), {"y": motion}, fs=fs, params={"firmness": 1.3}
        )
        assert r.passed, str(r)
        assert any("full sum" in c.name for c in r.checks)


@pytest.mark.parametrize("words", [{}, {"smoothing": 80.0}, {"contact": True, "smoothing": 50.0}])
@pytest.mark.parametrize("live", [True, False])
def test_viscoelastic_with_options_is_proved(live, words):
    """Positions that are tracked, contact, and a live order, also while it ramps."""
    scene = viscoelastic(0.3, live=live, **words)
    motion = {"y": sinusoid(0.01, 1.0), "contact": lambda t: 1.0 * (np.sin(9 * t) > -0.5)}
    motion = {name: motion[name] for name in scene.inputs}
    r = report(scene, motion, 1.0, 1000)
    assert r.passed and any("full sum" in c.name for c in r.checks), str(r)
    want, tol = r.evidence.wanted["force"]()  # the report draws the full sum
    assert np.abs(want - r.evidence.y[0]).max() <= tol
    assert 1e-12 < tol / np.abs(want).max() < 1e-5
    if live:
        e = r.evidence
        e.changes = [Change(200, "alpha", 0.9, 0.3)]
        again = stimlib.compile(scene, 1000, seed=e.seed)
        e.y = samples(again, e.x, e.x.shape[1], e.changes)
        checks = scenes.scene_law(dataclasses.replace(e, skipped=[], wanted={}, taps=[]))
        assert checks and all(c.passed for c in checks), checks


@pytest.mark.parametrize("words", [{"live": True}, {"live": False, "smoothing": 50.0}])
def test_viscoelastic_is_what_its_options_say(words):
    """All orders are as strong at w, and a live one is the fixed one of that order."""
    t = np.arange(3000) / 1000
    y = 0.01 * np.sin(2 * np.pi * t)
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


def test_the_thesis_own_methods_have_no_law():
    r = report(viscoelastic(0.5, scheme="gl-short-memory"), {"y": sinusoid(0.01, 1.0)}, fs=1000)
    assert r.passed and any("schemes" in t for t in r.evidence.skipped)


@pytest.mark.parametrize("waveform", ["square", "sine", "sawtooth", "half_sine"])
@pytest.mark.parametrize("duty", [0.2, 0.5, 1.0])
def test_bumps_are_proved(waveform, duty):
    for motion in (
        constant_speed(0.03, 0.1),
        minimum_jerk(depth=0.1, rise=0.5),
        sinusoid(0.05, 3.0),
    ):
        r = report(bumps(waveform, 18, duty, 7.5), {"x": motion})
        assert r.passed, str(r)
        assert ("rms of the line spectrum" in str(r)) == (
            motion.__class__.__name__ == "constant_speed"
        )


def test_bumps_that_are_larger_by_a_fiftieth_have_another_rms():
    r = report(bumps(), {"x": constant_speed(0.03, 0.1)})
    a = asked(r.evidence, r.evidence.scene.parts[0])
    for factor, refused in ((1.0, False), (1.02, True)):
        checks = scenes.SCENES["bumps"](
            dataclasses.replace(a, y={"voltage": factor * a.y["voltage"]})
        )
        assert any("rms of the line spectrum" in c.name for c in checks if not c.passed) is refused


@pytest.mark.parametrize("make", [bumps, stimlib.scenes.touch_screen])
@pytest.mark.parametrize(
    ("name", "text"),
    [("waveform", "sinus"), ("waveform", "square "), ("rectify", "Half"), ("rectify", "")],
)
def test_words_that_no_law_knows_are_refused(make, name, text):
    """That of the touch screen took an unknown waveform for a sine, and passed."""
    scene = make("sine", amplitude=0.1, rectify=None)
    part = dataclasses.replace(scene.parts[0], given=scene.parts[0].given | {name: text})
    r = report(stimlib.Scene(scene.outputs, [part]), {"x": constant_speed(0.03, 0.1)}, 0.1)
    (bad,) = [c for c in r.checks if not c.passed]
    assert bad.name == "shape of the scene" and f"{text!r} is not known; choose" in bad.text


def test_nothing_is_shown_at_amplitude_zero_and_the_report_says_so():
    r = report(bumps(amplitude=0.0), {"x": constant_speed(0.02, 0.1)}, seconds=1.0)
    assert r.passed and np.abs(r.evidence.y).max() == 0


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


@pytest.mark.parametrize("name", HELD)
@pytest.mark.parametrize("wrong", [None, "law", "limit"])
def test_bumps_with_limits_and_profiles_are_proved(monkeypatch, name, wrong):
    words, says = HELD[name]
    motion = {"x": constant_speed(0.05, 0.12)} | (
        {"contact": lambda t: 1.0 * (np.sin(9 * t) > -0.5)} if "contact" in words else {}
    )
    if wrong == "law":  # a law one per mille off is not what was rendered
        honest = laws.bump_envelope
        monkeypatch.setattr(laws, "bump_envelope", lambda *a: honest(*a) * [[1.001], [1.0]])
    if wrong == "limit":
        if "profile" not in name and "cubic" not in name:
            return
        honest_gain = laws.profile_gain
        monkeypatch.setattr(
            laws, "profile_gain", lambda *a: (honest_gain(*a)[0] * 1.001, honest_gain(*a)[1])
        )
    r = report(bumps("sine", 18, 0.5, **words), motion, 2.0)
    assert r.passed == (wrong is None), str(r)
    numbers = "; ".join(r.evidence.numbers)
    assert "amplifier 50, wavelength 5.556 mm" in numbers and (wrong or says in numbers)


@pytest.mark.parametrize(
    ("motion", "acts"), [(minimum_jerk(), False), (ramp_and_hold(0.06, 0.3), True)]
)
def test_a_limited_squeeze_is_proved(monkeypatch, motion, acts):
    r = report(stimlib.scenes.squeeze(fingers=1, limits=True), {"x1": motion}, 5.0)
    assert r.passed, str(r)
    assert ("it was limited" in "".join(r.evidence.skipped)) == acts
    assert "held to 100 N peak and 37 N static" in r.evidence.numbers[0]
    honest = laws.vibrating
    monkeypatch.setattr(
        laws, "vibrating", lambda *a: (f := honest(*a))._replace(force=f.force + 1e-9 * f.mean)
    )
    bad = report(stimlib.scenes.squeeze(fingers=1, limits=True), {"x1": motion}, 5.0)
    assert "force1: vibration law" in [c.name for c in bad.checks if not c.passed]


def test_numbers_that_were_asked_for_are_printed_in_table_and_page(tmp_path):
    r = report(bumps(gain=50.0), {"x": sinusoid(0.05, 1.0)}, seconds=0.5)
    r.to_html(tmp_path / "a.html")
    for text in (str(r), (tmp_path / "a.html").read_text()):
        assert "amplifier 50, wavelength 16.67 mm" in text
    assert "as strong at 1 Hz as 300 N/m" in str(
        report(viscoelastic(0.25), {"y": sinusoid(0.01, 1.0)}, seconds=0.5)
    )


@pytest.mark.parametrize(
    "path",
    ["finger_touchpad_horizontal.csv", "finger_touchscreen_updown.csv", "stylus_drag_pressure.csv"],
)
def test_real_fingers_drive_the_bumps_and_lifts_are_silent(path):
    if not (DATA / path).is_file():
        pytest.skip("the recordings are not beside the project")
    column = {
        "finger_touchpad_horizontal.csv": "x_raw*1e-5",
        "finger_touchscreen_updown.csv": "y_raw*1e-4",
    }.get(path, "x_mm*1e-3")
    hand = recording(DATA / path, {"x": column}, reports="on_change")
    scene = bumps("sine", 18, 0.5, contact=True)
    motion = hand.motion_for(tuple(scene.inputs))
    r = report(scene, motion, hand.duration)
    assert r.passed, str(r)
    touching = hand.contact(np.arange(r.evidence.y.shape[1]) / 8000) > 0
    assert np.all(r.evidence.y[0, ~touching] == 0) and np.abs(r.evidence.y).max() > 1.0


def test_page(tmp_path):
    r = report(bumps(), {"x": sinusoid(0.05, 1.0)}, seconds=1.0)
    r.to_html(tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text()
    assert (
        "What the law is made of" in page
        and "spectrum of voltage, and of its law" in page
        and "envelope" in page
    )


def scaled(f, change):
    def design(self, fs):
        p, s = f(self, fs)
        return change(p), s

    return design


@pytest.mark.parametrize(
    ("owner", "field", "scene", "motion"),
    [
        (Springpot, "scale", viscoelastic(0.5), {"y": sinusoid(0.01, 1.0)}),
        (LinearBump, "slope", bumps("sawtooth"), {"x": sinusoid(0.05, 1.0)}),
    ],
)
def test_a_number_one_per_mille_off_is_caught(monkeypatch, owner, field, scene, motion):
    f = owner.design
    monkeypatch.setattr(
        owner, "design", scaled(f, lambda p: p._replace(**{field: getattr(p, field) * 1.001}))
    )
    bad = [c for c in report(scene, motion, 1.0).checks if not c.passed]
    assert "d" in {c.group for c in bad}


def test_an_order_slightly_off_is_caught(monkeypatch):
    f = Springpot.design
    monkeypatch.setattr(
        Springpot,
        "design",
        lambda self, fs: f(dataclasses.replace(self, order=self.order + 1e-6), fs),
    )
    bad = {
        c.group
        for c in report(viscoelastic(0.5), {"y": sinusoid(0.01, 1.0)}, 1.0).checks
        if not c.passed
    }
    assert {"a2", "d"} <= bad


@pytest.mark.parametrize("words", [{"bumps": 5}, {"gain": 1.0}, {"bumps": 0.1}])
def test_numbers_that_happen_to_be_equal_confuse_nothing(words):
    r = report(bumps(**words), {"x": sinusoid(0.05, 1.0)}, seconds=0.5)
    assert r.passed, str(r)


@pytest.mark.parametrize(
    "motion", [constant_speed(0.03, 0.1), minimum_jerk(depth=0.1, rise=0.5), sinusoid(0.05, 3.0)]
)
def test_a_grating_is_proved(motion):
    r = report(grating(), {"x": motion}, 1.0, params={"roughness": 0.1})
    assert r.passed, str(r)
    names = {
        "force: octaves of the roughness",
        "force: gratings and roughness of the place",
        "force: none off contact",
    }
    assert names <= {c.name for c in r.checks} and "gratings: 2 mm" in "".join(r.evidence.numbers)


@pytest.mark.parametrize(
    ("owner", "field"),
    [(Grating, "per"), (Grating, "start"), (SpatialNoise, "at"), (SpatialNoise, "own")],
)
def test_a_surface_that_is_slightly_another_is_caught(monkeypatch, owner, field):
    f = owner.design
    monkeypatch.setattr(
        owner,
        "design",
        scaled(f, lambda p: p._replace(**{field: getattr(p, field) * (1 + 1e-6) + 1e-9})),
    )
    bad = [
        c.name for c in report(grating(), {"x": sinusoid(0.05, 1.0)}, 0.5).checks if not c.passed
    ]
    assert bad == ["force: gratings and roughness of the place", owner.__name__]


def test_a_grating_is_proved_over_lifts_and_caught_off_its_octaves(monkeypatch):
    motion = {"x": sinusoid(0.05, 1.0), "contact": lambda t: 1.0 * (np.sin(90 * t) > -0.3)}
    scene = grating(contact=True)
    rendering = stimlib.render(scene, motion, 8000, 0.2, {"roughness": 0.1})
    r = stimlib.verify(scene, motion, rendering)
    assert r.passed, str(r)
    lifted = r.evidence.x[r.evidence.proc.inputs.index("contact")] == 0
    r.evidence.y[0, lifted] = 1e-13
    assert lifted.any() and [
        c.name for c in surfaces.grating(asked(r.evidence, scene.parts[0])) if not c.passed
    ] == ["force: none off contact"]
    honest = surfaces.octaves
    for factor in (1.2, 0.8):
        monkeypatch.setattr(
            surfaces, "octaves", lambda *a, f=factor: (o := honest(*a))._replace(power=f * o.power)
        )
        assert "force: octaves of the roughness" in {
            c.name for c in surfaces.grating(asked(r.evidence, scene.parts[0])) if not c.passed
        }


def test_one_sample_of_a_surface_with_a_seed_of_its_own_is_seen():
    scene = grating(seed=7)
    r = report(scene, {"x": sinusoid(0.05, 1.0)}, 0.1, params={"roughness": 0.1})
    assert r.passed
    a = asked(r.evidence, scene.parts[0])
    for n in (1, 317, 798):
        row = a.y["force"].copy()
        row[n] += 1e-8
        (bad,) = [
            c.name
            for c in surfaces.grating(dataclasses.replace(a, y={"force": row}))
            if not c.passed
        ]
        assert bad == "force: gratings and roughness of the place"


@pytest.mark.parametrize(
    "law", ["squeeze", "viscoelastic", "bumps", "grating", "texture", "soft_surface"]
)
def test_a_law_on_a_scene_of_another_shape_fails_and_says_so(law):
    scene = stimlib.Scene({"voltage": 2 * stimlib.Input("x")}, law=law, given={})
    r = report(scene, {"x": sinusoid(1.0, 1.0)}, seconds=0.1)
    assert [c.name for c in r.checks if not c.passed] == ["shape of the scene"], str(r)


def test_motor_limits_are_checked_from_the_samples():
    scene = stimlib.scenes.squeeze(fingers=1, limits=True)
    r = report(scene, {"x1": ramp_and_hold(0.06, 0.3)}, seconds=20.0)
    assert r.passed, str(r)
    measured = {c.name: c.measured for c in r.checks}
    assert (
        90.0 < measured["force1: peak limit"] <= 100.0
        and 1200.0 < measured["force1: static limit"] <= 37.0**2
    )


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


def test_the_static_limit_of_a_law_is_the_papers():
    """It lets all through up to 0.81 of the mean square that a motor bears, then less,
    and nothing above it.
    """
    fs, force = 8000.0, np.full(60_000, 90.0)
    kept, mean = np.empty(force.size), 0.0
    for n in range(force.size):
        kept[n] = min(1.0, (37.0**2 - mean) / (0.19 * 37.0**2)) * force[n]
        mean += (kept[n] ** 2 - mean) * -np.expm1(-1 / (10.0 * fs))
    assert kept[0] == 90.0 and kept[-1] < 40.0
    np.testing.assert_allclose(impedance._held(force, kept, fs), kept, rtol=1e-9)
    np.testing.assert_allclose(
        impedance._held(np.array([120.0, -120.0, 99.0]), np.array([100.0, -100.0, 99.0]), fs),
        [100, -100, 99],
    )
