"""The laws of the everyday scenes: they hold of what is rendered, and catch what is
slightly off.
"""

import warnings
from functools import partial

import numpy as np
import pytest
from correct import hand

import stimlib
from stimlib.blocks import contact
from stimlib.blocks.sources import Ring
from stimlib.checks import local
from stimlib.checks.evidence import asked
from stimlib.checks.families import contact as touch
from stimlib.motion.generators import sinusoid
from stimlib.scenes import click, detents, friction, impact, wall

LIFTS = {"contact": lambda t: 1.0 * (np.sin(37 * t) > -0.6)}
CASES = {
    "click": (click, {"x": sinusoid(1.3e-3, 3.0, 1e-3)}, {"peak": 1.5}),
    "detents": (detents, {"angle": sinusoid(1.0, 2.0)}, {"depth": 0.03}),
    "friction": (friction, {"x": sinusoid(0.02, 2.0)}, {"normal": 0.7}),
    "wall": (wall, {"x": sinusoid(2e-3, 5.0)}, {"b": 3.0}),
    "impact": (impact, {"x": sinusoid(5e-3, 3.0)}, {"A": 7.0}),
}


def report(name, contact=False, fs=4000, seconds=0.6, **words):
    make, motion, params = CASES[name]
    scene, motion = make(contact=contact, **words), motion | (LIFTS if contact else {})
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs, seconds, params))


@pytest.mark.parametrize("contact", [False, True])
@pytest.mark.parametrize("name", CASES)
def test_a_scene_is_proved(name, contact):
    r = report(name, contact)
    assert r.passed, str(r)
    assert any("written again" in c.name for c in r.checks) and np.ptp(r.evidence.y) > 0.01


OFF = {  # a number of a design one per mille off
    "click": (contact.Button, "drop"),
    "detents": (contact.Detents, "per"),
    "friction": (contact.StickSlip, "left"),
    "wall": (contact.Wall, "fs"),
    "impact": (Ring, "per"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_number_one_per_mille_off_is_caught(monkeypatch, name):
    owner, field = OFF[name]
    honest = owner.design

    def design(self, fs):
        p, s = honest(self, fs)
        return p._replace(**{field: getattr(p, field) * 1.001}), s

    monkeypatch.setattr(owner, "design", design)
    assert "d" in {c.group for c in report(name).checks if not c.passed}


def test_places_that_are_slips_to_rounding_are_proved():
    """A hand read in steps of 0.1 mm over teeth of 0.3 mm, which stands still there."""
    scene, motion = friction(), {"x": lambda t: 1e-4 * np.round(100 * np.sin(5 * t))}
    r = stimlib.verify(scene, motion, stimlib.render(scene, motion, 1000, 2.0))
    assert r.passed, str(r)


@pytest.mark.parametrize("way", [0.0, 1e-17, 3e-16, 6.76e-15, 1e-13, 1e-9])
@pytest.mark.parametrize("start", [-0.012, -0.0119, 0.3])
def test_slips_that_a_rounding_places_are_proved(way, start):
    """A slip falls into a way so short that its place is a rounding; and the limit
    shrinks under a finger that stands on it.
    """
    place = start - 0.008
    x = np.r_[
        start,
        place + 2e-4,
        place + 9e-10,
        place + way,
        place,
        place,
        place,
        place - 1e-3,
        place - 1e-3 - way,
        place - 5e-3,
    ]
    force = stimlib.blocks.stick_slip(
        stimlib.Input("x", "m"), stimlib.Input("n", "N"), 0.8, 0.5, 100.0
    )
    for normal in (np.ones(x.size), np.r_[np.ones(5), 0.99, 0.7, 0.65, 0.6, 0.6]):
        scene, motion = stimlib.Scene({"force": force}), {"x": x, "n": normal}
        r = stimlib.verify(scene, motion, stimlib.render(scene, motion, 1000))
        assert r.passed, str(r)


STIFFNESS = {  # in N/m, over 2000 samples
    "grows and falls": lambda n: 300 + 250 * np.sin(n / 90),
    "jumps": lambda n: np.where(n // 130 % 2, 900.0, 40.0),
    "is gone for a while": lambda n: 200 * np.sin(n / 70),
    "follows a noise": lambda n: 500 * np.exp(np.random.default_rng(3).standard_normal(n.size)),
}


def sliding_on(k, off=()):
    """A finger that moves to and fro over a surface of this stiffness, in contact
    except at some samples.
    """
    n, contact = np.arange(2000), np.ones(2000)
    contact[list(off)] = 0
    force = stimlib.blocks.stick_slip(
        stimlib.Input("x", "m"),
        stimlib.Input("n", "N"),
        0.8,
        0.3,
        stimlib.Input("k", "N/m"),
        stimlib.Input("contact"),
    )
    motion = {
        "x": 0.03 * np.sin(n / 200),
        "n": 1 + 0.5 * np.sin(n / 333),
        "k": STIFFNESS[k](n),
        "contact": contact,
    }
    scene = stimlib.Scene({"force": force})
    return scene, motion, stimlib.render(scene, motion, 1000)


@pytest.mark.parametrize("off", [(), range(500, 700)])
@pytest.mark.parametrize("k", STIFFNESS)
def test_slips_over_a_stiffness_that_moves_are_proved(k, off):
    """There was no law where the stiffness moves."""
    report = stimlib.verify(*sliding_on(k, off))
    assert report.passed and "StickSlip" in {c.name for c in report.checks}, str(report)
    assert not [
        text for text in report.evidence.skipped if "stick_slip" in text or "StickSlip" in text
    ]


@pytest.mark.parametrize(
    "wrong", [lambda z, before, k: z, lambda z, before, k: contact.where(before < k, z * 0.999, z)]
)
def test_a_deflection_that_keeps_no_force_as_the_stiffness_grows_is_refused(monkeypatch, wrong):
    scene, motion, _ = sliding_on("grows and falls")
    run = local.Run(scene, 1000.0, 0, motion, 2000, {}, [], [(0, 2000)])
    # which has the step as it is now
    monkeypatch.setattr(local, "compile", partial(local.compile, target="python"))
    assert max(h.error for h in local.held(run)) <= 1
    monkeypatch.setattr(contact, "softened", wrong)
    assert {type(h.block).__name__ for h in local.held(run) if h.error > 1} == {"StickSlip"}


def test_a_law_says_of_another_wall_that_it_does_not_know_it():
    x = stimlib.Input("x", "m")
    scene = stimlib.Scene(
        {"force": stimlib.blocks.wall(x, hunt_crossley=1.0)}, law="wall", given={"at": 0.0}
    )
    r = stimlib.verify(scene, CASES["wall"][1], stimlib.render(scene, CASES["wall"][1], 4000, 0.2))
    (bad,) = [c for c in r.checks if not c.passed]
    assert bad.name == "shape of the scene" and "'k'" in bad.text


def test_the_laws_are_the_blocks_formulas_by_another_route():
    x = np.array([0.0, 0.5, 1.5, 1.5, 0.9, 0.7]) * 1e-3
    force, pressed = touch.button(x, np.ones(6), 2.0, 0.5, 1e-3, 0.8e-3)
    np.testing.assert_allclose(force, [0, 0.5, 1.5, 2.0, 1.4, 1.1], atol=1e-12)
    assert pressed.tolist() == [False, False, True, True, True, False]
    x, contact = (
        np.array([0.0, 1.0, 0.8, 0.79, 1.0, 0.9, 0.9, 0.9]) * 1e-3,
        np.array([1, 1, 1, 1, 1, 1, 0, 1.0]),
    )
    _, pressed = touch.button(x, contact, 2.0, 0.5, 1e-3, 0.8e-3)
    assert pressed.tolist() == [False, True, True, False, True, True, False, False]


@pytest.mark.parametrize("way", [1e-13, 1e-12, 9e-12, 1.01e-11, 2e-11, 1e-10, 1e-7])
def test_detents_over_a_way_in_which_nothing_changes_are_proved(way):
    """Two integrals that nearly cancel lost 1.05 tolerances: one of 330 random scenes
    was refused.
    """
    x = 3.0 + way * np.arange(3000.0)
    scene = detents(count=5, friction=1e-3)
    r = stimlib.verify(scene, {"angle": x}, stimlib.render(scene, {"angle": x}, 4000))
    (check,) = [c for c in r.checks if c.name == "Detents"]
    assert r.passed and check.measured < 0.01, str(r)


def test_springs_that_drag_follow_their_limits():
    """A limit that falls takes the force along; a held spring keeps it, and one that
    was never moved has none.
    """
    x, on = np.array([0.0, 3.0, 3.0, 3.0, 2.5]), np.ones(5)
    np.testing.assert_allclose(
        touch.dragged(x, 1.0, on, np.array([2, 2, 2, 1, 0.5]), touch.coulomb),
        [0, 4 / 3, 2, 1, 0.25],
    )
    np.testing.assert_array_equal(
        touch.stick_slip(0 * x, on, 1.0, np.full(5, 0.5), 0.5, np.full(5, 0.5))[0], 0 * x
    )


def test_an_impact_while_the_velocity_still_falls_is_silent():
    x = np.r_[np.full(50, 5e-3), -1e-6, np.full(100, 1e-6)]
    r = stimlib.verify(impact(), {"x": x}, stimlib.render(impact(), {"x": x}, 2000))
    assert r.passed and "1 impacts of up to 0 m/s" in "; ".join(r.evidence.numbers), str(r)


SIZES = {"click": 3e-3, "detents": 3.0, "friction": 0.03, "wall": 5e-3, "impact": 5e-3}  # of a hand


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.stress) for seed in range(2, 40))]
)
@pytest.mark.parametrize("name", CASES)
def test_no_correct_rendering_is_doubted(name, seed):
    """Hands that move, hold, wobble by a code or come in codes, off and on contact, at
    any rate and with other numbers.
    """
    rng = np.random.default_rng([seed, len(name)])
    make, motion, params = CASES[name]
    fs, contact = float(rng.choice([2000, 8000, 48000])), bool(rng.integers(2))
    (x,) = motion
    sources = {x: hand(rng, SIZES[name])} | (LIFTS if contact else {})
    scene = make(contact=contact)
    given = {p: v * rng.uniform(0.3, 1.0) for p, v in params.items()}
    rendering = stimlib.render(scene, sources, fs, min(1.0, 10_000 / fs), given)
    r = stimlib.verify(scene, sources, rendering)
    assert r.passed, str(r)


@pytest.mark.parametrize("wobble", [0.0, 1e-18, 1e-12])
@pytest.mark.parametrize("name", CASES)
def test_a_held_hand_on_an_edge_is_proved(name, wobble):
    make = CASES[name][0]
    (x,) = CASES[name][1]
    for place in (0.0, 1e-3, 0.8e-3):
        sources = {x: place + wobble * np.sin(np.arange(400) / 5)}
        scene = make()
        r = stimlib.verify(scene, sources, stimlib.render(scene, sources, 2000))
        assert r.passed, str(r)


def test_a_wall_that_pulls_a_little_is_caught_by_its_sign():
    e = report("wall").evidence
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
        said = "; ".join(report(name).evidence.numbers)
        assert text in said, said


@pytest.mark.parametrize(
    ("scene", "params", "seconds"),
    [
        (wall(), {"k": -1.0}, 0.1),  # proved as a wall of 0
        (wall(), {"b": -1.0}, 0.1),
        (friction(), {"normal": 1e-320}, 0.05),  # slips without number
        (friction(), {"normal": 1e-200}, 0.05),
        (friction(), {"normal": 1e-9}, 0.05),
    ],
)
def test_walls_below_0_and_slips_without_number_are_proved(scene, params, seconds):
    motion = {"x": sinusoid(0.01, 1.0)}
    r = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, seconds, params))
    assert r.passed, str(r)


def test_a_wall_without_stiffness_and_a_way_without_end_are_judged_in_silence():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = {"x": sinusoid(0.001, 20.0)}
        assert stimlib.verify(
            wall(), motion, stimlib.render(wall(), motion, 8000, 0.1, {"k": 0.0, "b": 2.0})
        ).passed
    with np.errstate(all="ignore"):
        slipped, _ = touch.stick_slip(
            np.array([-1.7e308, 1.7e308, 0.0]),
            np.ones(3),
            1000.0,
            np.full(3, 0.5),
            0.5,
            np.zeros(3),
        )
    assert not np.isfinite(slipped).all()
