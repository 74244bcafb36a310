"""The soft surface of Li et al. (2016): what each mode shows, that verify proves it and
would notice, and a recorded pen.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from faults import scaled, times
from laws import played
from refusals import refused

import stimlib
from stimlib import BadValue
from stimlib.blocks.avatars import DelayAvatar, FrameAvatar, Vibration
from stimlib.blocks.cursors import Cursor, CursorFrames
from stimlib.checks.families import soft as law
from stimlib.scenes import soft_surface
from stimlib.soft import nodules

FS, T = 1000, np.arange(1200) / 1000
MOTION = {
    "x": 0.06 + 0.035 * np.sin(5 * T),
    "y": 0.06 + 0.03 * np.cos(6.2 * T),
    "press": np.where(T % 0.7 > 0.1, 0.5 + 0.4 * np.sin(8 * T), 0.0),
    "contact": np.where(T % 0.5 > 0.05, 1.0, 0.0),
}
HARD = nodules([(0.09, 0.05, 0.006), (0.03, 0.075, 0.006)])  # on the way
MODES = {
    "a pen's cursor": ({"mode": "cursor"}, {"x1", "y1", "force"}),
    "a mouse's cursor": (
        {"mode": "cursor", "device": "mouse", "contact": True},
        {"x1", "y1", "force"},
    ),
    "combined": ({"contact": True}, {"x1", "y1", "depth1", "force"}),
    "in frames": ({"frames": True}, {"x1", "y1", "depth1", "force"}),
    "a mouse in frames": (
        {"device": "mouse", "frames": True, "contact": True},
        {"x1", "y1", "depth1", "force"},
    ),
    "deformation": ({"mode": "deformation", "device": "mouse"}, {"x1", "y1", "depth1", "force"}),
    "vibration": ({"mode": "vibration"}, {"x1", "y1", "force", "vibration"}),
    "multipoint": (
        {"mode": "multipoint"},
        {f"{n}{i}" for n in ("x", "y", "depth") for i in (1, 2, 3)} | {"force"},
    ),
}


def proved(scene, motion=MOTION, fs=FS, seconds=None):
    motion = {name: motion[name] for name in scene.inputs}
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs=fs, seconds=seconds))


@pytest.mark.parametrize("name", MODES)
def test_each_mode_is_proved(name):
    words, outputs = MODES[name]
    scene = soft_surface(**words, S=HARD)
    assert set(scene.outputs) == outputs
    r = proved(scene)
    assert r.passed, str(r)
    assert {c.group for c in r.checks} >= {"d"} and not any("law" in s for s in r.evidence.skipped)
    if "depth1" in outputs and "mouse" not in name and name != "multipoint":
        assert 0 < r.evidence.y[list(scene.outputs).index("depth1")].max() <= 0.015


FAULTS = {
    "table 1e-6 off": (Cursor, "c", 1 + 1e-6, "a mouse's cursor", "steps of the reversible cursor"),
    "delays 1e-6 off": (DelayAvatar, "per_newton", 1 + 1e-6, "combined", "waits of the avatar"),
    "noticed 10 % later": (DelayAvatar, "notice", 1.1, "combined", "waits of the avatar"),
    "catching up 1 % off": (
        DelayAvatar,
        "catch_up",
        1.01,
        "combined",
        "x1: the hand of some time ago",
    ),
    "vibration 10 % off": (Vibration, "factor", 1.1, "vibration", "vibration: as long"),
    "frames 5 % off": (FrameAvatar, "frame", 1.05, "in frames", "x1: the hand of some time ago"),
    "mouse's frames 5 % off": (
        CursorFrames,
        "frame",
        1.05,
        "a mouse in frames",
        "x1: eq. (1), frame by frame",
    ),
    "mouse never below .2": (
        CursorFrames,
        "slowest",
        4.0,
        "a mouse in frames",
        "x1: eq. (1), frame by frame",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_is_off_is_caught(name, monkeypatch):
    owner, field, factor, mode, says = FAULTS[name]
    monkeypatch.setattr(owner, "design", scaled(owner.design, times(field, factor)))
    report = proved(soft_surface(**MODES[mode][0], S=HARD))
    bad = [c.name for c in report.checks if not c.passed and c.group in "de"]
    assert any(says in text for text in bad), bad


def test_the_laws_of_avatars_see_starts_stands_speeds_and_short_frames():
    n, on = np.arange(6.0), np.array([1, 1, 0, 0, 1, 1]) > 0
    # over a soft place, in mm: it follows, stands, and starts at the hand
    x = np.array([0, 1, 1, 1, 4, 5.0])

    def error(x):
        return law.reversible(lambda x, y: 0.0 * x, 1e-3 * x, 0 * x, 1e-3 * n, 0 * x, on)[0]

    assert error(x) < 1e-12
    off = [error(x + 0.1 * (n > 3)), error(x + 0.1 * (n == 3)), error(x - 0.1 * (n == 5))]
    assert off == pytest.approx([0.1] * 3)
    seen, hand = (np.array([np.repeat([6, 2, last], 4), np.zeros(12)]) * 1e-3 for last in (3.2, 3))
    got = law.by_frames(lambda x, y: x / 0.01, seen, hand, np.ones(12, bool), 4, (0.3, 1.2))
    np.testing.assert_allclose(got, seen, rtol=0, atol=1e-12)
    # frames of half a sample
    k, b = np.arange(40.0), SimpleNamespace(frame=0.0005, notice=0.01, per_newton=0.5)
    rows = k, 0 * k, np.where(k < 20, 0.0, 0.02)
    out, due, _ = law.delayed_by_frames(rows, 0.01 * (k == 20), k >= 0, 1000.0, b)
    np.testing.assert_allclose(out[0], np.where((k > 20) & (k < 30), 20, k))
    np.testing.assert_allclose(due, 0.01 * (k == 20), atol=1e-15)


def shown(scene, x, y, press):
    """The outputs of places and pressures, by name."""
    rows = played(scene.outputs, {"x": x, "y": y, "press": press}, fs=FS)
    return dict(zip(scene.outputs, rows, strict=True))


def test_depth_and_force_are_the_papers_and_the_springs():
    over, beside, S = np.array([0.06, 0.02]), np.array([0.06, 0.06]), nodules([(0.06, 0.06, 0.006)])
    y = shown(soft_surface("deformation", S=S), over, beside, np.array([0.75, 0.75]))
    np.testing.assert_allclose(y["force"], 2.366609, atol=5e-7)
    soft = 400 + 800 * (1 + (40 / 12.5) ** 2) ** -3
    np.testing.assert_allclose(y["depth1"], [2.366609 / 1200, 2.366609 / soft], rtol=1e-6)
    got = shown(soft_surface("multipoint", S=S), *(np.array([v]) for v in (0.06, 0.03, 0.75)))
    np.testing.assert_allclose([got["y1"][0], got["x2"][0]], [0.041547005, 0.05], atol=1e-9)
    assert got["depth1"] < got["depth2"] == pytest.approx(got["depth3"])
    shallow = shown(soft_surface("deformation", S=S), over, beside, np.array([1.0, 0.0]))
    assert shallow["force"][1] == shallow["depth1"][1] == 0  # a pen that does not touch


def test_a_pen_pressed_beyond_its_range_pushes_as_at_its_end():
    r = proved(soft_surface("deformation", S=HARD), MOTION | {"press": 1.0 + 0.3 * np.sin(8 * T)})
    assert r.passed and r.evidence.y[-1].max() == pytest.approx(0.1008 * np.exp(4.2081)), str(r)


def test_a_mouse_pushes_as_it_is_told():
    proc = stimlib.compile(soft_surface("deformation", "mouse", push=2.0), FS)
    proc.set("push", 1.0, ramp=0.0)
    y = dict(zip(proc.outputs, proc.process(np.zeros((2, 3))), strict=True))
    np.testing.assert_allclose(y["force"], 1.0)
    np.testing.assert_allclose(y["depth1"], 0.0025, rtol=0.01)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"mode": "speed"}, "cursor, deformation"),
        ({"device": "touch"}, "pen, mouse"),
        ({"mode": "vibration", "device": "mouse"}, "no vibration"),
        ({"tangent": 0.0}, "tangent"),
        ({"push": -1.0}, "push"),
        ({"side": 0.0}, "side"),
        ({"mode": "multipoint", "side": 0.0}, "side"),
        ({"S": ([[0, 2], [0, 0]], 0.1, 0.1)}, "0 to 1"),
    ],
)
def test_words_that_make_no_sense(words, says):
    refused(BadValue, says, soft_surface, **words)
