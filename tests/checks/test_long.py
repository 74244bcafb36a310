"""Recordings that do not fit into one stretch of memory: the same verdicts, every
sample seen, and flat memory.
"""

import dataclasses as dc
import hashlib
import json
import re

import numpy as np
import pytest
from logged import play
from memory import most_memory
from refusals import warned
from trials import pair

import stimlib
from stimlib import Input, Scene, blocks
from stimlib.analysis.thresholds import MASKER
from stimlib.checks import evidence, local, scenes, verify_log
from stimlib.files import read_log
from stimlib.motion import sinusoid
from stimlib.run.safety import GAIN, Safety
from stimlib.scenes import SHIPPED

FS, STRETCH, SECONDS = 4000, 5000, 3.0  # 12 000 samples in three stretches
LATE = 2.7  # s, in the last one
HANDS = {
    "click": {"x": sinusoid(1.3e-3, 3.0, 1e-3)},
    "detents": {"angle": sinusoid(1.0, 2.0)},
    "impact": {"x": sinusoid(5e-3, 3.0)},
    "wall": {"x": sinusoid(2e-3, 5.0)},
    "texture": {"x": sinusoid(0.01, 2.0), "force": lambda t: 1.0 + 0 * t},
    "soft_surface": {"press": lambda t: 0.5 + 0.5 * np.sin(3 * t)},
}


@pytest.fixture
def short(monkeypatch):
    """Stretches that tests can wait for."""
    monkeypatch.setattr(evidence, "AT_ONCE", STRETCH)


def moved(name, scene):
    known = HANDS.get(name, {})
    return {
        n: known.get(n) or sinusoid(0.01, 2.0 + 0.3 * k, 0.02) for k, n in enumerate(scene.inputs)
    }


def failed(report):
    return [c.name for c in report.checks if not c.passed]


@pytest.mark.parametrize("name", SHIPPED)
def test_every_scene_passes_the_checks_that_it_passes_at_once(name, monkeypatch):
    scene = SHIPPED[name]()
    motion = moved(name, scene)
    made = stimlib.render(scene, motion, FS, SECONDS, seed=5)
    whole = stimlib.verify(scene, motion, made)
    monkeypatch.setattr(evidence, "AT_ONCE", STRETCH)
    parts = stimlib.verify(scene, motion, made)
    assert whole.passed and parts.passed, str(parts)
    assert [s.at for s in parts.evidence.stretches()] == [0, 5000, 10000]
    assert parts.evidence.frames == 12000
    assert [(c.group, c.name) for c in whole.checks] == [(c.group, c.name) for c in parts.checks]
    first = any("held against the first 1.25 s only" in text for text in parts.evidence.skipped)
    assert first == (name not in scenes.ONWARD)


@pytest.mark.parametrize("at", [None, 0.1, 2.0, LATE])
def test_a_sum_is_held_in_every_stretch(short, at):
    both = Scene.combine(wall=SHIPPED["wall"](), knob=SHIPPED["grating"]())
    force = next(y for n, y in both.outputs.items() if n.startswith("knob_force"))
    wall, p = both.outputs["wall_force"], Input("p")
    parts = Scene({"y": wall - force}, law=both).parts
    scene = Scene({"y": wall - force * (1.0 + p)}, law=parts)
    motion = {n: sinusoid(2e-3, 5.0) for n in scene.inputs} | {"p": np.zeros(12000)}
    if at:
        motion["p"][round(FS * at) :][:100] = 1e-2
    bad = failed(stimlib.verify(scene, motion, stimlib.render(scene, motion, FS, SECONDS)))
    assert "y: sum" in bad if at else not bad


def test_what_is_counted_is_counted_over_all_stretches(short, tmp_path, monkeypatch):
    monkeypatch.setattr("stimlib.checks.page.figures", lambda e: [])
    scene = stimlib.scenes.squeeze(fingers=2, limits=True)
    motion = {"x1": sinusoid(0.02, 1.0), "x2": sinusoid(0.06, 1.0)}
    made = stimlib.render(scene, motion, FS, SECONDS)
    warned(RuntimeWarning, "full scale", made.save, tmp_path / "a.flac", full_scale=90.0)
    report = stimlib.verify(tmp_path / "a.flac")
    assert report.passed, str(report)
    e, told = report.evidence, json.loads((tmp_path / "a.flac.json").read_text())
    np.testing.assert_array_equal(np.hstack([s.y for s in e.stretches()]), made.y)
    np.testing.assert_array_equal(np.hstack([s.x for s in e.stretches()]), e.motion_at(0, 12000))
    assert sum(c["clips"] for c in told["channels"]) > 0
    report.to_html(tmp_path / "a.html")
    signal = hashlib.sha256(np.ascontiguousarray(made.y.T, "<f8").data).hexdigest()
    assert (
        f"{signal} (float64" in (tmp_path / "a.html").read_text("utf-8")
        and "of the first 1.25 s of 3 s" in e.skipped[0]
    )
    texts = {c.name: c.text for c in report.checks}
    assert [
        text.endswith(" 12000 samples") for name, text in texts.items() if "generator" in name
    ] == [True, True]
    ran = sum(int(s.taps[0].gate.sum()) for s in e.stretches())
    assert texts["force1: noise as displayed"].endswith(f" {ran} samples") and e.taps[
        0
    ].stream.size == min(ran, STRETCH)


def test_what_is_felt_and_limited_late_is_said(monkeypatch):
    scene = SHIPPED["bumps"](limit=150.0)
    x = 0.012 + np.r_[np.zeros(8000), 0.05 * np.sin(np.arange(4000) / 500)]
    made, said = stimlib.render(scene, {"x": x}, FS), []
    for size in (evidence.AT_ONCE, STRETCH):
        monkeypatch.setattr(evidence, "AT_ONCE", size)
        numbers = stimlib.verify(scene, {"x": x}, made).evidence.numbers
        said.append([text for text in numbers if "SL" in text or "held there" in text])
    held, felt = int(np.sum(np.abs(made.y) >= 150)), made.felt()
    assert (
        said[0]
        == said[1]
        == [
            f"limited to 150 V, {held} samples held there",
            f"voltage: {felt} (gain 1.2e-06, area 0.0001)",
        ]
    )
    assert felt.level > MASKER and np.isnan(felt.non_pacinian)


# What sees every sample ---------------------------------------------------------------
def late(name, part=1e-3, **words):
    """A shipped scene, by its name and arguments, whose outputs are a little larger
    from the last stretch on.
    """
    scene = SHIPPED[name](**words)
    more = blocks.timeline([(0.0, 1.0), (LATE, 1.0 + part)], "step")
    return Scene({n: b * more for n, b in scene.outputs.items()}, scene.parts)


@pytest.mark.parametrize("name", ["squeeze", "bumps", "grating", "pulse", "tone", "wall"])
def test_a_graph_that_leaves_its_law_late_is_refused(short, name):
    words = {"pulse": {"duration": 0.3}, "tone": {"period": 0.6}}.get(name, {})  # not silent then
    scene = late(name, **words)
    motion = moved(name, scene)
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, FS, SECONDS))
    assert {c.group for c in report.checks if not c.passed} == {"d"}, str(report)
    right = late(name, 0.0, **words)
    assert stimlib.verify(right, motion, stimlib.render(right, motion, FS, SECONDS)).passed


@pytest.fixture(scope="module")
def squeezed():
    scene, motion = stimlib.scenes.squeeze(fingers=1, limits=True), {"x1": sinusoid(0.02, 1.0)}
    return scene, motion, stimlib.render(scene, motion, FS, SECONDS)


@pytest.mark.parametrize(
    ("at", "value"), [(1, None), (4999, None), (5000, None), (11999, None), (11999, np.nan)]
)
def test_one_bit_is_seen_wherever_it_is(short, squeezed, at, value):
    scene, motion, made = squeezed
    y = made.y.copy()
    y[0, at] = value or np.nextafter(y[0, at], 1e9)
    bad = failed(stimlib.verify(scene, motion, dc.replace(made, y=y)))
    assert "finite" in bad if value else bad == ["delivered = re-render"]


@pytest.mark.parametrize(
    ("more", "bad"), [(0.0, []), (200.0, ["force1: static limit", "force1: peak limit"])]
)
def test_a_limit_that_is_passed_late_is_seen(short, squeezed, more, bad):
    e = evidence.gather(*squeezed)
    honest = e.later
    e.later = lambda: (dc.replace(s, y=s.y + more * (s.at == 10000)) for s in honest())
    assert [c.name for c in scenes.motor_limits(e) if not c.passed] == bad


@pytest.mark.parametrize(
    ("what", "wrong"), [("clips", 0), ("peak", 1.0), ("sha256", "0" * 64), (None, None)]
)
def test_what_a_sidecar_says_of_late_samples_is_seen(short, tmp_path, what, wrong):
    x = np.where(np.arange(12000) == 11900, 2.0, np.sin(np.arange(12000) / 7))
    scene, motion = Scene({"y": 1.0 * stimlib.Input("x")}), {"x": x}
    warned(
        RuntimeWarning,
        "full scale",
        stimlib.render(scene, motion, FS).save,
        tmp_path / "a.flac",
        full_scale=1.5,
    )
    path = tmp_path / "a.flac.json"
    told = json.loads(path.read_text())
    (channel,) = told["channels"]
    assert channel["clips"] == 1 and channel["peak"] == 2.0
    if what:
        (told if what == "sha256" else channel)[what] = wrong
    path.write_text(json.dumps(told))
    assert bool(failed(stimlib.verify(scene, motion, tmp_path / "a.flac"))) == bool(what)


# Blocks, subsystems, trials, sessions -------------------------------------------------
@pytest.mark.parametrize("kind", ["at random", "always", "never", "now and then"])
def test_a_gate_knows_the_samples_at_which_it_is_open(kind):
    rng, n = np.random.default_rng(3), np.arange(500)
    on = {"at random": rng.random(500) > 0.5, "always": n >= 0, "never": n < 0}.get(
        kind, n % 97 > 90
    )
    gate, row = local.Gated(), rng.standard_normal(500)
    for at in range(0, 500, 130):
        gate.add(at, on[at : at + 130], {})
    clock, places = local.Clock.of(gate.until(500), 500), np.flatnonzero(on)
    until = [clock.until(k) for k in range(501)]
    assert clock.total == places.size and until == np.r_[0, np.cumsum(on)].tolist()
    np.testing.assert_array_equal(clock.samples(0, places.size), places)
    for a, z in ((0, 500), (3, 4), (7, 7), (5, 200)):
        a, z = (min(v, places.size) for v in (a, z))
        np.testing.assert_array_equal(local.Inside(row, clock)[a:z], row[places[a:z]])
    some = local.Clock.of(gate.until(333), 333)
    np.testing.assert_array_equal(some.samples(0, some.total), np.flatnonzero(on[:333]))


@pytest.mark.parametrize(
    ("size", "edges"), [(1000, [928, 1928, 2200]), (600, [128, 728, 1128, 1728, 2200])]
)
def test_trials_are_held_in_the_stretches_in_which_they_begin(monkeypatch, size, edges):
    """A stretch ends between two intervals, if it can; else the report says what of an
    interval its law did not hold.
    """
    scene, params = pair(SHIPPED["wall"](), {"k": 900.0})
    motion = HANDS["wall"]
    made = stimlib.render(scene, motion, FS, 0.55, params=params, seed=3)
    whole = stimlib.verify(scene, motion, made)
    monkeypatch.setattr(evidence, "AT_ONCE", size)
    monkeypatch.setattr(evidence, "LATER", 100)  # not of trials
    parts = stimlib.verify(scene, motion, made)
    assert parts.passed and [(c.group, c.name) for c in parts.checks] == [
        (c.group, c.name) for c in whole.checks
    ]
    assert [s.end for s in parts.evidence.stretches()] == edges
    assert parts.evidence.numbers == whole.evidence.numbers
    assert sum("of its interval" in text for text in parts.evidence.skipped) == (
        2 if size == 600 else 0
    )


@pytest.mark.parametrize("wrong", [None, "hash", "scene"])
def test_a_session_is_held_in_stretches(short, tmp_path, wrong):
    """Delivered blocks of odd sizes, frames that are lost over the end of a stretch,
    and a parameter that is set late.
    """
    scene, folder = stimlib.scenes.squeeze(fingers=1), tmp_path / "a"
    played = late("squeeze", fingers=1) if wrong == "scene" else scene
    x = sinusoid(0.02, 1.0)(np.arange(12000) / FS)[None, :]
    sets = [(0, GAIN, 1.0, 160), (11000, "k", 1500.0, 160)]
    play(folder, played, Safety(60.0), x, fs=FS, sets=sets, lost=[(4900, 300)])
    told = json.loads((folder / "session.json").read_text())
    told |= {"scene": scene.to_dict(), "scene_hash": scene.hash}
    (folder / "session.json").write_text(json.dumps(told))
    path = folder / "events.jsonl"
    if wrong == "hash":
        head, hashed, tail = path.read_text().rpartition('"hash"')
        path.write_text(head + hashed + re.sub('[0-9a-f]{8}"', '00000000"', tail, count=1))
    report = verify_log(read_log(folder))
    assert failed(report) == ([] if wrong is None else ["log: delivered = replay"]), str(report)
    assert [s.at for s in report.evidence.stretches()] == [0, 5000, 10000]


HALF, NEAR, NAN = (
    evidence.Check("d", "law", measured, limit, "")
    for measured, limit in ((0.5, 1.0), (0.09, 0.1), (np.nan, 1.0))
)


@pytest.mark.parametrize(("first", "later", "kept"), [(HALF, NEAR, NEAR), (NEAR, NAN, NAN)])
def test_of_all_stretches_the_result_nearest_to_its_limit_is_kept(first, later, kept):
    for found, new in (([first], [later]), ([later], [first])):
        scenes._worst(found, new)
        assert found == [kept]


def test_a_motion_that_ends_is_held_up_to_there(short, tmp_path):
    """What is not finite in the last stretch: the law is held before it, and nowhere
    after.
    """
    finger = stimlib.scenes.squeeze(fingers=1)
    scene = Scene({"half": 0.5 * finger.outputs["force1"]}, law=finger)
    x = sinusoid(0.02, 1.0)(np.arange(12000) / FS)[None, :]
    x[0, 11500] = np.nan
    play(tmp_path / "a", scene, Safety(60.0), x, fs=FS, sets=[(0, GAIN, 1.0, 160)])
    report = verify_log(read_log(tmp_path / "a"))
    assert failed(report) == ["no fault"], str(report)
    assert any(c.name == "half: sum" for c in report.checks)
    assert any("the samples before 11500 only" in text for text in report.evidence.skipped)


# Memory -------------------------------------------------------------------------------
def test_memory_is_that_of_a_stretch(tmp_path, monkeypatch):
    monkeypatch.setattr(evidence, "AT_ONCE", 10_000)
    monkeypatch.setattr(evidence, "LATER", 2_500)
    scene, motion, peaks = stimlib.scenes.squeeze(fingers=1), {"x1": sinusoid(0.02, 1.0)}, []
    for seconds in (5, 10, 20):  # the first compiles
        path = tmp_path / f"{seconds}.wav"
        proc = stimlib.compile(scene, FS)
        stimlib.files.audio.write(path, proc, motion, seconds, full_scale=60.0)
        report, most = most_memory(stimlib.verify, path)
        assert report.passed
        peaks.append(most)
    assert peaks[2] < 1.15 * peaks[1] + 8 * 10_000, peaks
    ends = [s.end for s in report.evidence.stretches()]
    assert ends[:2] == [10_000, 12_500] and ends[-1] == 80_000
