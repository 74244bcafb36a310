"""What a scene was asked for: its laws see wrong numbers in a factory, and hold in combinations, in trials and of one's own."""

import dataclasses
import itertools
import json

import numpy as np
import pytest
from laws import STRESS

import stimlib
from stimlib import BadValue, Input, Param, Scene, SceneError, SceneFileError, UnknownName, blocks, constant
from stimlib.checks import scenes
from stimlib.checks.evidence import Check, asked, at_first, gather, ramped
from stimlib.checks.session import verify_log
from stimlib.core.parts import OWN, Part, Span, parts_of, plain
from stimlib.experiments.experiment import Experiment, Timing
from stimlib.experiments.present import present, program
from stimlib.experiments.questions import choice
from stimlib.experiments.trial import Stimulus, Trial
from stimlib.files.session import read_log
from stimlib.motion.generators import sinusoid
from stimlib.run.processor import Change
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


LIFTS = {"contact": lambda t: 1.0 * (np.sin(90 * t) > -0.3)}
PUSHED = {"x1": lambda t: 0.06 * np.minimum(10 * t, 1.0) ** 2}
SQUEEZED = {"fingers": 1, "motor_constant": 10.0}
LIMITS = [  # arguments, motion, output, how much larger it is than it should be, and which check says so
    ("squeeze", {"fingers": 1}, PUSHED, "force1", 2e-14, "mean part is k x"),
    ("squeeze", {"fingers": 1}, PUSHED, "force1", 1e-11, "vibration law"),
    ("squeeze", SQUEEZED, PUSHED, "current1", 2e-8, "I = F/(n B Gamma)"),
    ("viscoelastic", {}, {"y": lambda t: 0.02 * t}, "force", 2e-14, "springpot of these numbers"),
    ("viscoelastic", {}, {"y": lambda t: 0.02 * t}, "force", 3e-9, "full sum over the history"),
    ("bumps", {}, None, "voltage", 2e-6, "envelope times carrier"),
    ("texture", {}, None, "acceleration", 2e-7, "the models' recursion"),
    ("grating", {}, None, "force", 1e-10, "gratings and roughness of the place"),
    *((name, {}, None, output, 2e-6, "written again") for name, output in (
        ("click", "force"), ("detents", "torque"), ("friction", "force"), ("wall", "force"), ("impact", "force"),
    )),
    ("wall", {"k": 1e-6, "b": 0.0}, None, "force", 2e-6, "written again"),  # of 2e-9 N
    ("soft_surface", {}, None, "force", 2e-12, "eq. (2)"),
    ("soft_surface", {}, None, "depth1", 2e-10, "f/k"),
    ("soft_surface", {"mode": "multipoint"}, None, "depth3", 2e-10, "f/k"),
    ("soft_surface", {"mode": "multipoint"}, None, "y2", 2e-12, "of a triangle"),
    ("soft_surface", {"mode": "multipoint"}, None, "x3", 2e-12, "of a triangle"),
    ("soft_surface", {}, None, "y1", 2e-9, "the hand of some time ago"),
    ("soft_surface", {"mode": "cursor", "device": "mouse"}, None, "x1", 1e-10, "steps of the reversible cursor"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "words", "motion", "output", "part", "says"), LIMITS, ids=lambda v: v if type(v) is str else "")
def test_an_output_that_is_off_by_little_more_than_its_tolerance_is_refused(name, words, motion, output, part, says):
    scene = SHIPPED[name](**words)
    motion = {n: (motion or hands(name))[n] for n in scene.inputs}
    e = gather(scene, motion, stimlib.render(scene, motion, FS, 0.3))
    a = asked(e, scene.parts[0])
    assert all(c.passed for c in scenes.SCENES[name](a))
    larger = dataclasses.replace(a, y=a.y | {output: (1 + part) * a.y[output]})
    bad = [c.name for c in scenes.SCENES[name](larger) if not c.passed]
    assert any(n.startswith(output) and says in n for n in bad), bad


@pytest.mark.parametrize("name", ["viscoelastic", "bumps"])
def test_the_least_output_off_contact_is_refused(name):
    scene, motion = SHIPPED[name](contact=True), hands(name) | LIFTS
    e = gather(scene, motion, stimlib.render(scene, motion, FS, 0.3))
    a = asked(e, scene.parts[0])
    ((output, row),) = a.y.items()
    row = np.where(a.contact == 0, 1e-300, row)
    bad = [c.name for c in scenes.SCENES[name](dataclasses.replace(a, y={output: row})) if not c.passed]
    assert bad == [f"{output}: none off contact"]


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


def test_a_part_that_begins_with_another_value_is_refused_and_named():
    data = Scene.combine(edge=SCENES["wall"], knob=SCENES["detents"]).to_dict()
    (k,) = (block for block in data["blocks"] if block["fields"].get("name") == "edge_k")
    k["fields"]["value"] *= 1.25
    motion = {"edge_x": hands("wall")["x"], "knob_angle": hands("detents")["angle"]}
    (bad,) = [c for c in verified(Scene.from_dict(data), motion).checks if not c.passed]
    assert bad.name == "parameters of edge: as they were asked for" and bad.text == "k = 1250 for 1000"


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
            lambda: Scene.combine(a=Scene({"b_y": 2 * Input("u")}), a_b=Scene({"y": 3 * Input("v")})),
            SceneError,
            "two parts would have the output 'a_b_y'; give a_b another name",
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
    assert verified(lone(1 + 1e-13), motion).passed and not verified(lone(1 + 1e-8), motion).passed
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


def within(x, p, fs, *, tol):
    """The input, to a stated tolerance."""
    return {"y": (x["x"], tol)}


def test_a_law_of_ones_own_holds_to_the_tolerance_that_it_states():
    for tol, passes in ((0.01, True), (0.0075, False)):
        scene = Scene({"y": Input("x") + 0.009}, law=within, given={"tol": tol})
        assert verified(scene, {"x": sinusoid(1.0, 3.0)}).passed is passes


def test_what_was_given_by_the_name_of_a_parameter_is_where_it_begins():
    motion = {"x": sinusoid(0.02, 3.0)}
    for k, bad in ((200.0, []), (200.5, ["parameters: as they were asked for"])):
        scene = Scene(lone().outputs, law=slope, given={"at": 0.01, "k": k})
        assert [c.name for c in verified(scene, motion, params={"k": 150.0}).checks if not c.passed] == bad


def test_a_law_that_is_written_again_is_the_new_one():
    made = []
    for factor in (1.0, 2.0):

        def law(x, p, fs, factor=factor):
            return {"y": factor * x["x"]}

        made.append(verified(Scene({"y": 2.0 * Input("x")}, law=law), {"x": sinusoid(0.02, 3.0)}).passed)
    assert made == [False, True]


def test_a_law_that_is_not_imported_is_said(monkeypatch):
    kept = again(lone())
    monkeypatch.delitem(OWN, f"{__name__}.slope")
    report = verified(kept, {"x": sinusoid(0.02, 3.0)})
    assert f"the law '{__name__}.slope' is not known here: import what defines it first" in report.evidence.skipped


def test_a_law_sees_a_parameter_as_it_was_ramped():
    """Ramps from sample 0, broken off, of no length, up to the last sample; a change behind it is none."""
    scene, rows, n = Scene({"y": Param("p", 1.0) * 1.0}), [], 100
    proc = stimlib.compile(scene, FS, "python")
    for at, value, long in ((0, 3.0, 20), (10, -1.0, 30), (60, 2.0, 0), (61, 5.0, 7), (99, 0.0, 4), (n, 9.0, 0)):
        rows.append(proc.process(at - proc.index)[0])
        proc.set("p", value, ramp=long / FS)
    y = np.concatenate(rows)
    np.testing.assert_allclose(ramped(1.0, proc.log, FS, n), y, rtol=0, atol=1e-14)
    assert len(set(y)) > 40
    for long, first in ((0, 3.0), (1, 3.0), (2, 1.0)):
        assert at_first(stimlib.compile(scene, FS, "python"), [Change(0, "p", 3.0, long / FS)]) == {"p": first}
    assert at_first(stimlib.compile(scene, FS, "python"), [Change(1, "p", 3.0, 0.0)]) == {"p": 1.0}


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
        ({"law": 3}, "law = 3 must be a name, or a function"),
        ({"law": slope, "given": {"at": object()}}, "cannot be kept in a scene file"),
        ({"law": slope, "given": {"at": Span}}, "cannot be kept in a scene file"),
        ({"law": slope, "given": {"at": Part}}, "cannot be kept in a scene file"),
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
        (lambda p: p.update(span=[0, 1, -1, None]), "span"),
        (lambda p: p.update(span=[0, 1, 0, -1]), "span"),
        (lambda p: p.update(span=[0, 1, 0, 2**64]), "span"),
        (lambda p: p.update(more=1), "no field 'more'"),
        (lambda p: p.pop("name"), "name"),
    ],
)
def test_a_scene_file_with_a_wrong_law_is_refused(change, says):
    data = SCENES["wall"].to_dict()
    change(data["law"][0])
    with pytest.raises(SceneFileError, match=says):
        Scene.from_dict(data)


def test_what_was_asked_for_is_kept_as_it_is():
    assert parts_of("wall", None)[0].given is None and parts_of("wall", {})[0].given == {}
    assert plain({"seed": 2**64 - 1, 1: (np.float32(0.5), True)}) == {"seed": 2**64 - 1, "1": [0.5, True]}


def test_a_scene_is_the_same_in_whatever_order_it_was_asked_for():
    outputs = {"y": 1.0 * Input("x")}
    assert Scene(outputs, "wall", {"at": 0.0, "k": 1.0}).hash == Scene(outputs, "wall", {"k": 1.0, "at": 0.0}).hash


def test_a_scene_of_an_older_file_keeps_the_laws_that_it_is_combined_with():
    old = Scene(SCENES["wall"].outputs, "wall")
    both = again(Scene.combine(a=old, b=SCENES["wall"]))
    assert [(p.name, p.law, p.given is None) for p in both.parts] == [("a", "wall", True), ("b", "wall", False)]


def test_an_interval_with_any_seed_comes_back_from_a_file():
    (part,) = SCENES["wall"].parts
    for seed in (None, 0, 2**64 - 1):
        shown = dataclasses.replace(part, span=Span(0.5, 1.0, 0.1, seed))
        assert again(Scene(SCENES["wall"].outputs, [shown])).parts == (shown,)


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


def test_each_interval_has_all_laws_of_its_scene_and_its_own_seed():
    _, _, scene, _ = trial_of(Scene.combine(edge=SCENES["wall"], knob=SCENES["detents"]))
    told = [(p.law, p.name, p.span.start, p.span.seed) for p in scene.parts]
    assert told == [
        (law, f"interval_{i}", start, seed) for i, start, seed in ((1, 0.032, None), (2, 0.282, 5)) for law in ("wall", "detents")
    ]
    assert trial_of(scene)[2].parts == ()  # of a trial within a trial no law knows the time


def test_a_law_sees_its_own_interval_alone():
    """Its samples and parameters, differences as they were displayed; nothing where the window is 0."""
    _, _, scene, params = trial_of(SCENES["wall"])
    e, fs = verified(scene, hands("wall"), 0.55, params=params).evidence, float(FS)
    e.changes.append(Change(1200, "k_2", 500.0, 0.01))
    first, second = (asked(e, part) for part in scene.parts)
    assert (first.at, second.at) == (slice(128, 928), slice(1128, 1928))
    row = ramped(1000.0, [Change(1200, "k_2", 500.0, 0.01)], fs, 2200)
    np.testing.assert_array_equal(second.live("k"), row[1128:1928])
    assert not np.ptp(first.live("k")) and second.live("k")[71] > second.live("k")[72] > second.live("k")[-1] == 500.0
    np.testing.assert_array_equal(second.x["x"], e.x[0, 1128:1928])
    t = np.minimum(np.arange(800), 800 - np.arange(800)) / fs
    window = np.where(t < 0.02, (1 - np.cos(np.pi * t / 0.02)) / 2, 1.0)
    np.testing.assert_allclose(second.window, window, rtol=0, atol=1e-15)
    one = np.zeros(800)
    for n in (1, 40, 400, 799):
        one[:] = 0.0
        one[n] = -2.0
        assert second.far(one) == pytest.approx(2 * window[n])
    one[0], one[799] = np.nan, 0.0
    assert second.far(one) == 0.0
    one[1] = np.nan
    assert np.isnan(second.far(one)) and not Check("d", "", second.far(one), 1.0, "").passed


def test_an_output_is_held_to_its_tolerance_of_the_largest_value():
    e = verified(SCENES["wall"], hands("wall")).evidence
    a, want = asked(e, SCENES["wall"].parts[0]), np.sin(np.arange(1200.0)) * 4
    for off, least, passes in ((0.9e-6, 1e-300, True), (1.1e-6, 1e-300, False), (1.1e-6, 5.0, True), (-1.1e-6, 1e-300, False)):
        row = want.copy()
        row[7] += off * np.abs(want).max()
        seen = dataclasses.replace(a, y={"force": row})
        assert seen.near("force", want, 1e-6, "", least).passed is passes
    off = np.arange(1200) > 600
    for n, passes in ((600, True), (601, False)):
        row = np.zeros(1200)
        row[n] = 1e-300
        assert dataclasses.replace(a, y={"force": row}).silent("force", off).passed is passes
    assert a.begins({"k": 1000.0}).passed and not a.begins({"k": np.nextafter(1000.0, 0)}).passed


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
