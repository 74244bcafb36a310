"""What a scene was asked for: its laws see wrong numbers in a factory, and hold in combinations, in trials and of one's own."""

import dataclasses
import inspect
import itertools
import json
from contextlib import suppress

import numpy as np
import pytest
from laws import STRESS

import stimlib
from stimlib import BadValue, Input, Param, Scene, SceneError, SceneFileError, UnknownName, blocks, constant
from stimlib.checks.evidence import Evidence, at_first
from stimlib.checks.scenes import scene_law
from stimlib.checks.session import verify_log
from stimlib.core.parts import OWN
from stimlib.experiments.bounciness import bounciness
from stimlib.experiments.experiment import Experiment, Timing
from stimlib.experiments.nodule_sizes import nodule_sizes
from stimlib.experiments.present import present, program
from stimlib.experiments.questions import choice
from stimlib.experiments.roughness import roughness
from stimlib.experiments.run import Simulated, run
from stimlib.experiments.session import Session
from stimlib.experiments.trial import Stimulus, Trial
from stimlib.experiments.ugrip import ugrip
from stimlib.files.session import read_log
from stimlib.motion.generators import sinusoid
from stimlib.run.processor import Change
from stimlib.run.safety import Safety
from stimlib.run.walk import samples
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


def test_a_law_that_is_not_imported_is_said(monkeypatch):
    kept = again(lone())
    monkeypatch.delitem(OWN, f"{__name__}.slope")
    report = verified(kept, {"x": sinusoid(0.02, 3.0)})
    assert f"the law '{__name__}.slope' is not known here: import what defines it first" in report.evidence.skipped


def wrong_shape(x, p, fs):
    return {"y": x["x"][1:]}


def no_output(x, p, fs):
    return {"z": x["x"]}


def raises(x, p, fs):
    return {"y": p["k"]}


@pytest.mark.parametrize(
    ("law", "says"),
    [(wrong_shape, r"y has the shape \(1199,\)"), (no_output, "the outputs z; return"), (raises, "KeyError: 'k'")],
)
def test_a_law_that_fails_says_where(law, says):
    with pytest.raises(BadValue, match=says):
        verified(Scene({"y": 1 * Input("x")}, law=law), {"x": sinusoid(0.02, 3.0)})


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"law": lambda x, p, fs: {}}, "write it with def"),
        ({"law": 3}, "law = 3 must be"),
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
def NEXT(participant, session):  # nothing here asks what comes next
    raise NotImplementedError


ASKED = choice("more", "?", "first", "second")


def trial_of(scene, ramp=0.02, **words):
    e = Experiment("pair", "1", {"s": scene}, NEXT, (ASKED,), fs=FS, safety=Safety(1000.0), timing=Timing(0.2, 0.05, 0.0, ramp))
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


@pytest.mark.parametrize("mode", ["vibration", "multipoint", "mouse", "frames"])
def test_the_law_of_a_soft_surface_holds_in_a_long_trial_with_steep_ramps(mode):
    """The window's time is rounded, which a steep ramp makes larger."""
    words = {"mouse": {"device": "mouse"}, "frames": {"frames": True}}.get(mode, {"mode": mode})
    e = Experiment(
        "pair", "1", {"s": stimlib.scenes.soft_surface(**words)}, NEXT, (ASKED,), fs=500, safety=Safety(1000.0),
        timing=Timing(12.0, 0.1, 0.0, 0.002),
    )  # fmt: skip
    scene, params = program(e, Trial("a", (Stimulus("s"), Stimulus("s")), ("more",)))
    moves = {n: m for n, m in hands("soft_surface").items() if n in scene.inputs}
    report = verified(scene, moves, 24.2, 500, params=params)
    assert report.passed, str(report)


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
    of = inspect.unwrap(stimlib.scenes.bumps).__globals__
    honest = of["carrier"]
    monkeypatch.setitem(of, "carrier", lambda f, *a: honest(1.003 * f, *a))
    bad = [c.name for c in session(tmp_path / "wrong").checks if not c.passed]
    assert bad and all("voltage from" in n for n in bad), bad


@pytest.mark.stress
@pytest.mark.parametrize("make", [ugrip, bounciness, roughness, nodule_sizes])
def test_sessions_of_the_papers_are_verified_trial_by_trial(make, tmp_path):
    e, answers = make(), itertools.count()

    def some(trial, rng):
        if next(answers) == 4:
            raise KeyboardInterrupt
        return e.observer(trial, rng)

    with suppress(KeyboardInterrupt), Session(e, tmp_path, "P01", 1, pilot=True) as session:
        run(session, Simulated(session, some), "offline")
    logs = sorted(tmp_path.rglob("*.stimlog"))
    assert logs
    for log in logs:
        report = verify_log(read_log(log))
        assert report.passed and any(c.group == "d" and " from " in c.name for c in report.checks), str(report)


# Correct renderings that a law refused -----------------------------------------------------------------------------------
def test_a_finger_that_rests_on_an_edge_of_a_bump_passes():
    """-0.1 x 6/0.1 is -6, and (-0.1 x 6)/0.1 is not: the law has the scene's rounding."""
    x = np.full(400, -0.1)
    for scene in (stimlib.scenes.bumps(), stimlib.scenes.touch_screen("square", rectify="half")):
        assert verified(scene, {"x": x}, 0.1).passed


@pytest.mark.parametrize("waveform", ["sine", "square"])
@pytest.mark.parametrize("make", [stimlib.scenes.bumps, stimlib.scenes.touch_screen])
def test_a_finger_that_trembles_by_a_rounding_over_an_edge_passes(make, waveform):
    x = 1e-12 * np.cumsum(np.random.default_rng(1).standard_normal(2000))
    report = verified(make(waveform, bumps=0.06, length=0.1, duty=0.06), {"x": x}, 0.5)
    assert report.passed, str(report)


@pytest.mark.parametrize("make", [stimlib.scenes.bumps, stimlib.scenes.touch_screen])
@pytest.mark.parametrize("params", [{"duty": 2.0}, {"freq": -100.0}, {"freq": 1e6}])
def test_a_live_number_out_of_its_range_is_held_by_scene_and_law(make, params):
    report = verified(make("half_sine"), {"x": sinusoid(0.05, 3.0, 0.05)}, 0.1, params=params)
    assert report.passed, str(report)


def test_a_plate_beyond_its_edge_and_a_texture_at_rest_pass():
    assert verified(stimlib.scenes.touch_screen(), {"x": sinusoid(0.01, 3.0, 0.8)}).passed
    for motion in ({"x": np.zeros(2000), "force": np.zeros(2000)}, {"x": np.full(2000, 0.1), "force": np.ones(2000)}):
        for seed in range(3):
            found = verified(stimlib.scenes.texture(), motion, 0.5, seed=seed).checks
            assert [c.passed for c in found if "recursion, written again" in c.name] == [True]


def test_a_vibration_that_decays_within_a_sample_passes():
    scene = stimlib.scenes.impact(decay=5e-4, freq=190.0, cutoff=50.0)
    assert verified(scene, {"x": sinusoid(5e-3, 10.0)}, 0.5, fs=500).passed


def test_a_mouse_that_jumps_over_pieces_of_the_map_passes_and_is_said():
    x, y = 0.06 + 0.3 * np.random.default_rng(1).standard_normal((2, 2000))
    report = verified(stimlib.scenes.soft_surface(device="mouse"), {"x": x, "y": y}, 0.5)
    assert report.passed and "too long" in "; ".join(report.evidence.skipped), str(report)


@pytest.mark.parametrize("name", ["squeeze", "viscoelastic"])
def test_a_parameter_that_moves_slowly_passes(name):
    scene, fs = stimlib.scenes.squeeze(A=0.0) if name == "squeeze" else SCENES[name], 48000
    live = "k" if name == "squeeze" else "firmness"
    rows = np.array([1e-3 * np.sin(np.arange(20000) / 5000)] * len(scene.inputs))
    e = evidence_of(scene, rows, fs, [Change(0, live, 0.3 * scene.params[live].value, 0.4)])
    bad = [(c.name, c.measured, c.limit) for c in scene_law(e) if not c.passed]
    assert not bad, bad


def evidence_of(scene, rows, fs, changes):
    """What a verifier has of samples whose parameters changed."""
    proc = stimlib.compile(scene, fs)
    y = samples(stimlib.compile(scene, fs), rows, rows.shape[1], changes).copy()
    e = Evidence(scene, proc, fs, 0, at_first(proc, changes), rows, y, y, "memory", None, {})
    e.changes = changes
    return e


# Hostile -----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 10**400, [[float("-inf")]]])
def test_a_scene_file_whose_law_was_given_no_number_is_refused(value):
    data = SCENES["wall"].to_dict()
    data["law"][0]["given"]["at"] = value
    with pytest.raises(SceneFileError, match="cannot be kept"):
        Scene.from_dict(data)


def test_a_scene_file_that_is_nested_deeply_or_has_an_endless_span_is_refused():
    deep = []
    for _ in range(900):
        deep = [deep]
    for change, says in (({"given": {"at": deep}}, "nested too deeply"), ({"span": [0, 1e308, 0, None]}, "span")):
        data = SCENES["wall"].to_dict()
        data["law"][0] |= change
        with pytest.raises(SceneFileError, match=says):
            Scene.from_dict(data)


@pytest.mark.parametrize(
    ("name", "change"),
    [("viscoelastic", {"w": 0}), ("touch_screen", {"swap": 0}), ("touch_screen", {"model": []}), ("click", {"at": 0})],
)
def test_a_law_that_cannot_take_what_a_file_says_fails(name, change):
    data = SCENES[name].to_dict()
    data["law"][0]["given"] |= change
    report = verified(Scene.from_dict(data), hands(name), 0.1)
    assert "shape of the scene" in [c.name for c in report.checks if not c.passed]


# Laws that misbehave -----------------------------------------------------------------------------------------------------
def writes(x, p, fs, *, values):
    """Write into all that it is given."""
    values.append(1.0)
    y = p["k"] * x["x"]
    x["x"][:] = 0.0
    return {"y": y}


def divides(x, p, fs):
    return {"y": 1 / 0}


def endless(x, p, fs):
    return {"y": np.full(x["x"].size, np.inf)}


def loose(x, p, fs):
    return {"y": (0 * x["x"], np.inf)}


def plain_scene(law, **given):
    return Scene({"y": Param("k", 2.0) * Input("x")}, law=law, given=given)


def test_a_law_that_writes_into_what_it_gets_changes_nothing():
    scene = plain_scene(writes, values=[1.0])
    was, motion = scene.hash, {"x": sinusoid(0.02, 3.0)}
    report = verified(scene, motion)
    assert report.passed and np.abs(report.evidence.x).max() > 0.01 and scene.hash == was


@pytest.mark.parametrize(
    ("law", "says"), [(divides, "ZeroDivisionError"), (endless, "hold nothing"), (loose, "a tolerance of inf")]
)
def test_a_law_that_fails_or_holds_nothing_is_an_error(law, says):
    with pytest.raises(BadValue, match=says):
        verified(plain_scene(law), {"x": sinusoid(0.02, 3.0)})


def test_a_law_whose_values_no_file_keeps_is_refused():
    k = 3.0

    def around(x, p, fs):
        return {"y": k * x["x"]}

    class Law:
        def held(self, x, p, fs):
            return {"y": x["x"]}

    for law in (around, Law().held):
        with pytest.raises(BadValue, match="no file keeps"):
            plain_scene(law)


@pytest.mark.parametrize(
    ("law", "given", "says"), [(slope, [1], "no table"), (slope, 3, "no table"), (None, {"a": 1}, "needs the law")]
)
def test_what_is_given_is_a_table_for_a_law(law, given, says):
    with pytest.raises(BadValue, match=says):
        Scene({"y": 1 * Input("x")}, law=law, given=given)


def test_what_is_given_may_not_hold_itself():
    values = []
    values.append(values)
    with pytest.raises(BadValue, match="nested too deeply"):
        plain_scene(slope, at=values)
