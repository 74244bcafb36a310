"""What a scene was asked for: its laws see wrong numbers in a factory, and hold in combinations, in trials and of one's own."""

import dataclasses
import itertools
import json
import sys

import numpy as np
import pytest
from laws import STRESS

import stimlib
from stimlib import BadValue, Input, Param, Scene, SceneError, SceneFileError, UnknownName, blocks, constant
from stimlib.checks.session import verify_log
from stimlib.core.parts import OWN
from stimlib.devices.null import NullSink
from stimlib.experiments.experiment import Experiment, Timing
from stimlib.experiments.present import present, program
from stimlib.experiments.questions import choice
from stimlib.experiments.trial import Stimulus, Trial
from stimlib.files.replay import replay
from stimlib.files.session import read_log
from stimlib.motion.generators import sinusoid
from stimlib.run.safety import Safety
from stimlib.scenes import SHIPPED

FS = 4000
HANDS = {
    "click": {"x": sinusoid(1.3e-3, 3.0, 1e-3)},
    "detents": {"angle": sinusoid(1.0, 2.0)},
    "impact": {"x": sinusoid(5e-3, 3.0)},
    "wall": {"x": sinusoid(2e-3, 5.0)},
    "texture": {"x": sinusoid(0.01, 2.0), "force": lambda t: 1.0 + 0 * t},
}
SCENES = {name: make() for name, make in SHIPPED.items()}


def hands(name):
    if name in HANDS:
        return HANDS[name]
    moves = {n: sinusoid(0.01, 2.0 + 0.3 * k, 0.02) for k, n in enumerate(SCENES[name].inputs)}
    return moves | ({"press": lambda t: 0.5 + 0.5 * np.sin(3 * t)} if "press" in moves else {})


def verified(scene, motion, seconds=0.3, fs=FS, **words):
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs, seconds, **words))


def again(scene):
    return Scene.from_dict(json.loads(json.dumps(scene.to_dict(), allow_nan=False)))


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_keeps_what_it_was_asked_for(name):
    kept = again(SCENES[name])
    assert kept.hash == SCENES[name].hash and [p.law for p in kept.parts] == [name] and kept.parts[0].given
    assert verified(kept, hands(name)).passed


# Combinations ------------------------------------------------------------------------------------------------------------
MANY = [*itertools.combinations(SCENES, 2), *itertools.combinations(SCENES, 3)]


def combined(names):
    scene = again(Scene.combine(**{name: SCENES[name] for name in names}))
    return scene, {f"{name}_{n}": m for name in names for n, m in hands(name).items()}


@pytest.mark.parametrize("names", MANY if STRESS else MANY[5:66:10] + MANY[80:270:60], ids="-".join)
def test_shipped_scenes_combine_and_keep_their_laws(names):
    scene, motion = combined(names)
    report = verified(scene, motion)
    assert report.passed, str(report)
    told = "; ".join(c.name for c in report.checks if c.group == "d")
    assert all(f"{name}_" in told for name in names) and len(report.evidence.numbers) >= len(names)
    for name in names:  # each part has the samples that it has alone
        y = stimlib.render(scene, motion, FS, 0.1)
        alone = stimlib.render(SCENES[name], hands(name), FS, 0.1)
        for output in SCENES[name].outputs:
            np.testing.assert_array_equal(y[f"{name}_{output}"], alone[output])


def test_a_wrong_part_is_refused_and_named():
    both = Scene.combine(edge=SCENES["wall"], knob=SCENES["detents"])
    motion = {"edge_x": hands("wall")["x"], "knob_angle": hands("detents")["angle"]}
    bad = Scene(both.outputs | {"knob_torque": 1.001 * both.outputs["knob_torque"]}, both.parts)
    assert [c.name for c in verified(bad, motion).checks if not c.passed] == ["knob_torque: detents and friction, written again"]


def test_inputs_are_joined_only_where_that_is_said():
    both = Scene.combine(edge=SCENES["wall"], screen=SCENES["bumps"], share={"x": ("edge_x", "screen_x")})
    assert list(both.inputs) == ["x"]
    assert verified(both, {"x": sinusoid(2e-3, 5.0)}).passed
    nested = Scene.combine(a=both, b=SCENES["wall"])
    assert list(nested.inputs) == ["a_x", "b_x"] and [p.name for p in nested.parts] == ["a_edge", "a_screen", "b"]
    assert verified(nested, {"a_x": sinusoid(2e-3, 5.0), "b_x": sinusoid(1e-3, 5.0)}).passed


@pytest.mark.parametrize(
    ("make", "error", "says"),
    [
        (lambda: Scene.combine(), SceneError, "combine needs scenes by name"),
        (lambda: Scene.combine(a=1), SceneError, "combine needs scenes by name"),
        (
            lambda: Scene.combine(soft=SCENES["soft_surface"], knob=SCENES["detents"], share={"x": ("soft_x", "knob_angle")}),
            SceneError,
            "'x' would be x of soft.*and angle of knob.*not the same",
        ),
        (
            lambda: Scene.combine(a=SCENES["wall"], b=stimlib.scenes.wall(k=1.0), share={"k": ("a_k", "b_k")}),
            SceneError,
            "k of a.*1000.*k of b.*1.0.*not the same",
        ),
        (
            lambda: Scene.combine(a=SCENES["wall"], share={"x": ("a_y",)}),
            UnknownName,
            "no part has 'a_y'; there are a_x, a_k, a_b",
        ),
        (
            lambda: Scene.combine(a=Scene({"b_y": 2 * Input("b_x")}), a_b=Scene({"y": 3 * Input("x")})),
            SceneError,
            "'a_b_x' would be b_x of a.*and x of a_b",
        ),
        (
            lambda: Scene.combine(a=stimlib.scenes.squeeze(), b=stimlib.scenes.squeeze()),
            SceneError,
            "two noise sources have the key",
        ),
        (
            lambda: Scene.combine(a=SCENES["wall"], b=SCENES["wall"], share={"x": ("a_x",), "z": ("a_x", "b_x")}),
            SceneError,
            "share: 'a_x' would be 'x' and 'z'; name it once",
        ),
        (
            lambda: Scene.combine(a=SCENES["wall"], b=SCENES["wall"], share={"x": "a_x"}),
            SceneError,
            "share: 'x' is 'a_x', and not names; ",
        ),
        (lambda: Scene.combine(a=SCENES["wall"], share=["a_x"]), SceneError, r"share = \['a_x'\] must map new names to names"),
        (lambda: SCENES["wall"].renamed(inputs={"y": "z"}), UnknownName, "no input 'y'; this scene has x"),
        (lambda: SCENES["soft_surface"].renamed(outputs={"x1": "y1"}), SceneError, "two outputs would be called 'y1'"),
    ],
)
def test_two_meanings_of_a_name_are_an_error_with_both_parts(make, error, says):
    with pytest.raises(error, match=says):
        make()


# Of one's own ------------------------------------------------------------------------------------------------------------
def slope(x, p, fs, *, at):
    """A spring beyond a place."""
    return {"force": p["k"] * np.maximum(x["x"] - at, 0.0)}


def lone(factor=1.0, given=0.01):
    x, k = Input("x", "m"), Param("k", 200.0, "N/m")
    return Scene({"force": factor * k * blocks.maximum(x - constant(0.01, "m"), 0)}, law=slope, given={"at": given})


def test_a_law_of_ones_own_is_held_and_kept(tmp_path):
    motion = {"x": sinusoid(0.02, 3.0)}
    assert verified(lone(), motion, params={"k": 150.0}).passed
    assert not verified(lone(1.0001), motion).passed and not verified(lone(given=0.0101), motion).passed
    rendering = stimlib.render(again(lone()), motion, FS, 0.1)
    assert rendering.save(tmp_path / "a.wav", full_scale=10.0)
    report = stimlib.verify(tmp_path / "a.wav")
    assert report.passed and f"force: {__name__}.slope" in {c.name for c in report.checks}
    text = json.loads((tmp_path / "a.wav.json").read_text())["definitions"][__name__]["text"]
    assert "A spring beyond a place." in text
    both = Scene.combine(a=lone(), b=lone().renamed({"k": "stiffness"}))
    assert verified(both, {"a_x": motion["x"], "b_x": motion["x"]}).passed
    report.to_html(tmp_path / "a.html")
    assert f"The scene: the law {__name__}.slope" in (tmp_path / "a.html").read_text()


def forget(patch):
    """As in a process that has not imported this module."""
    patch.delitem(OWN, f"{__name__}.slope", raising=False)
    patch.delitem(sys.modules, __name__)


def test_a_law_that_is_not_imported_is_said(monkeypatch):
    kept = again(lone())
    forget(monkeypatch)
    report = verified(kept, {"x": sinusoid(0.02, 3.0)})
    assert any(f"the law '{__name__}.slope' is not known here: import its module first" in s for s in report.evidence.skipped)


def test_a_law_is_known_once_its_module_is_imported(monkeypatch):
    kept, wrong, motion = again(lone()), again(lone(1.0001)), {"x": sinusoid(0.02, 3.0)}
    monkeypatch.delitem(OWN, f"{__name__}.slope")  # imported, and no scene made
    assert f"force: {__name__}.slope" in {c.name for c in verified(kept, motion).checks}
    assert not verified(wrong, motion).passed


@pytest.mark.parametrize("law", ["os.path.join", f"{__name__}.hands", f"{__name__}.sinusoid", f"{__name__}.FS"])
def test_a_file_cannot_name_another_function_as_its_law(law):
    report = verified(Scene({"y": 1 * Input("x")}, law, {}), {"x": sinusoid(0.02, 3.0)})
    assert any("is not known here" in s for s in report.evidence.skipped)


@pytest.mark.parametrize("written", [True, False])
def test_files_and_logs_are_proven_with_and_without_the_module_of_the_law(tmp_path, written):
    """Written where the law is known and verified where it is not, and the other way round."""
    motion, kept = {"x": sinusoid(0.02, 3.0)}, again(lone())

    def write():
        stimlib.render(kept, motion, FS, 0.1).save(tmp_path / "a.wav", full_scale=10.0)
        sink = NullSink(kept, 10.0, clocked=False, motion=motion, log=tmp_path / "log")
        with sink:
            sink.open(FS)
            sink.start(seconds=0.1)
            sink.wait()

    def check():
        log = read_log(tmp_path / "log")
        return stimlib.verify(tmp_path / "a.wav").passed, replay(log).matches, verify_log(log).passed

    with pytest.MonkeyPatch.context() as patch:
        if not written:
            forget(patch)
        write()
    with pytest.MonkeyPatch.context() as patch:
        if written:
            forget(patch)
        assert check() == (True, True, True)


def wrong_shape(x, p, fs):
    return {"y": x["x"][1:]}


def no_output(x, p, fs):
    return {"z": x["x"]}


def raises(x, p, fs):
    return {"y": p["k"]}


def divides(x, p, fs):
    return {"y": x["x"] / (1 // 0)}


def misspelt(x, p, fs):
    return {"y": rows}  # noqa: F821


def unwise(x, p, fs):
    x["x"] *= 2.0
    return {"y": x["x"]}


def loose(x, p, fs):
    return {"y": (x["x"], np.inf)}


def negative(x, p, fs):
    return {"y": (x["x"], -1e-9)}


def by_sample(x, p, fs):
    return {"y": (x["x"], np.full(x["x"].size, 1e-9))}


def three(x, p, fs):
    return {"y": (x["x"], 1e-9, 0.0)}


def turned(x, p, fs):
    return {"y": x["x"] + 0j}


@pytest.mark.parametrize(
    ("law", "says"),
    [
        (wrong_shape, r"y has the shape \(1199,\)"),
        (no_output, "the outputs z; return"),
        (raises, "KeyError: 'k'"),
        (divides, "the law .*divides raises ZeroDivisionError"),
        (misspelt, "the law .*misspelt raises NameError"),
        (unwise, "the law .*unwise raises ValueError: .*read-only"),
        (loose, "y has the tolerance inf; return one finite number"),
        (negative, "y has the tolerance -1e-09; return one finite number"),
        (by_sample, "y has the tolerance .*; return one finite number"),
        (three, "y is a tuple of 3; return a row, or a row and its tolerance"),
        (turned, "y has complex values; return real ones"),
    ],
)
def test_a_law_that_fails_says_where(law, says):
    with pytest.raises(BadValue, match=says):
        verified(Scene({"y": 1 * Input("x")}, law=law), {"x": sinusoid(0.02, 3.0)})


def bound(factor):
    """A law that no file could keep: two of these would have one name."""

    def law(x, p, fs):
        return {"y": factor * x["x"]}

    return law


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"law": lambda x, p, fs: {}}, "write it with def"),
        ({"law": bound(2.0)}, "bound.<locals>.law.* uses values of the function around it.*given="),
        ({"law": {}.get}, "of an object"),
        ({"law": slope, "given": [0.01]}, "given .*must map names to values"),
        ({"given": {"at": 0.01}}, "given without a law"),
        ({"law": 3}, "law = 3 must be a name, or a function"),
        ({"law": slope, "given": {"at": object()}}, "cannot be kept in a scene file"),
        ({"law": slope, "given": {"at": float("nan")}}, "cannot be kept in a scene file"),
    ],
)
def test_a_law_that_no_file_could_keep_is_refused(words, says):
    with pytest.raises(BadValue, match=says):
        Scene({"y": 1 * Input("x")}, **words)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda p: p.update(law=3), "law"),
        (lambda p: p.update(given=3), "given"),
        (lambda p: p.update(inputs={"x": 3}), "inputs"),
        (lambda p: p.update(span=[0, 1, 2]), "span"),
        (lambda p: p.update(span=[0, -1, 0, None]), "span"),
        (lambda p: p.update(span=[0, 1, 0, -1]), "span"),
        (lambda p: p.update(more=1), "no field 'more'"),
        (lambda p: p.pop("name"), "name"),
    ],
)
def test_a_scene_file_with_a_wrong_law_is_refused(change, says):
    data = SCENES["wall"].to_dict()
    change(data["law"][0])
    with pytest.raises(SceneFileError, match=says):
        Scene.from_dict(data)


def test_a_scene_of_an_older_file_is_read_and_its_law_is_said_to_lack_what_was_asked_for():
    data = SCENES["wall"].to_dict() | {"stimlib_scene": 1, "law": "wall"}
    scene = Scene.from_dict(data)
    assert scene.to_dict() == data
    report = verified(scene, hands("wall"))
    assert report.passed and "the law 'wall' needs what the scene was asked for" in "; ".join(report.evidence.skipped)


# Trials ------------------------------------------------------------------------------------------------------------------
ASKED = choice("more", "?", "first", "second")


def trial_of(scene, ramp=0.02, **words):
    e = Experiment("pair", "1", {"s": scene}, None, (ASKED,), fs=FS, safety=Safety(1000.0), timing=Timing(0.2, 0.05, 0.0, ramp))
    names = list(scene.params)
    pair = Stimulus("s", {n: 0.9 * scene.params[n].value for n in names[:1]}, 3), Stimulus("s", {}, 5)
    return e, Trial("a", pair, ("more",)), *program(e, Trial("a", pair, ("more",)))


@pytest.mark.parametrize("name", SCENES)
def test_the_law_of_a_scene_holds_in_each_interval_of_a_trial(name):
    _, _, scene, params = trial_of(SCENES[name])
    report = verified(scene, hands(name), 0.55, params=params, seed=3)
    assert report.passed, str(report)
    held = [c.name for c in report.checks if c.group == "d"]
    assert any("from 0.032" in n for n in held) and any("from 0.282" in n for n in held)


@pytest.mark.parametrize("ramp", [0.0, 0.05])
def test_a_wrong_interval_is_refused(ramp):
    _, _, scene, params = trial_of(SCENES["squeeze"], ramp)
    assert verified(scene, hands("squeeze"), 0.55, params=params, seed=3).passed
    (first, second), motion = (p for p in scene.parts), hands("squeeze")
    for part in (
        dataclasses.replace(second, span=second.span._replace(seed=6)),
        dataclasses.replace(second, span=second.span._replace(ramp=ramp + 1e-3)),
        dataclasses.replace(second, given={**second.given, "cutoff": 100.01}),
    ):
        report = verified(Scene(scene.outputs, [first, part]), motion, 0.55, params=params, seed=3)
        bad = [c.name for c in report.checks if not c.passed]
        assert bad and all("from 0.282" in n for n in bad), bad


def test_a_session_with_a_wrong_carrier_is_refused(tmp_path, monkeypatch):
    def session(folder):
        e, trial, *_ = trial_of(stimlib.scenes.bumps())
        e = dataclasses.replace(e, motion=hands("bumps"))
        present(e, trial, "offline", folder)
        return verify_log(read_log(folder))

    assert session(tmp_path / "right").passed
    honest = stimlib.scenes.bumps.__globals__["carrier"]
    monkeypatch.setitem(stimlib.scenes.bumps.__globals__, "carrier", lambda f, *a: honest(1.003 * f, *a))
    bad = [c.name for c in session(tmp_path / "wrong").checks if not c.passed]
    assert bad and all("voltage from" in n for n in bad), bad
