"""The laws of the everyday scenes: they hold of what is rendered, and catch what is
slightly off.
"""

from functools import partial

import numpy as np
import pytest
from checks.test_false_alarms import sliding_on
from correct import hand
from laws import mostly

import stimlib
from stimlib.blocks import contact
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


def report(name, contact=False, fs=4000, seconds=0.3, **words):
    make, motion, params = CASES[name]
    scene, motion = make(contact=contact, **words), motion | (LIFTS if contact else {})
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs, seconds, params))


@pytest.mark.parametrize("name", CASES)
def test_a_scene_is_proved_over_lifts(name):
    r = report(name, contact=True)
    assert r.passed, str(r)
    assert any("written again" in c.name for c in r.checks) and np.ptp(r.evidence.y) > 0.01


@pytest.mark.parametrize(
    "wrong", [lambda z, before, k: z, lambda z, before, k: contact.where(before < k, z * 0.999, z)]
)
def test_a_deflection_that_keeps_no_force_as_the_stiffness_grows_is_refused(monkeypatch, wrong):
    scene, motion = sliding_on("grows and falls")
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


@pytest.mark.parametrize("seed", mostly([0], range(40)))
@pytest.mark.parametrize("name", CASES)
def test_no_correct_rendering_is_doubted(name, seed):
    """Hands that move, hold, wobble by a code or come in codes, off and on contact, at
    any rate and with other numbers.
    """
    rng = np.random.default_rng([seed, len(name)])
    make, motion, params = CASES[name]
    fs, contact = float(rng.choice([2000, 8000, 48000])), bool(rng.integers(2))
    ((x, moved),) = motion.items()
    size = 2 * float(np.ptp(moved(np.arange(1000) / 1000)))
    sources = {x: hand(rng, size)} | (LIFTS if contact else {})
    given = {p: v * rng.uniform(0.3, 1.0) for p, v in params.items()}
    scene, seconds = make(contact=contact), min(0.5, 10_000 / fs)
    r = stimlib.verify(scene, sources, stimlib.render(scene, sources, fs, seconds, given))
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
        said = "; ".join(report(name, seconds=0.6).evidence.numbers)
        assert text in said, said
