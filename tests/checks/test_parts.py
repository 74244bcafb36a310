"""What a scene was asked for: its laws see wrong numbers in a factory, and hold in
combinations, in trials and of one's own.
"""

import dataclasses
import itertools
import json
import sys
from functools import reduce

import numpy as np
import pytest
from commands import ran
from devices.servers import played
from laws import mostly
from refusals import refused
from trials import pair

import stimlib
from stimlib import (
    BadValue,
    Input,
    Param,
    Scene,
    SceneError,
    SceneFileError,
    UnknownName,
    blocks,
    constant,
)
from stimlib.checks import scenes, verify_log
from stimlib.checks.evidence import asked, gather
from stimlib.checks.scenes import scene_law
from stimlib.core.parts import OWN, Part, Span, parts_of, plain
from stimlib.devices import NullSink
from stimlib.files import read_log, replay
from stimlib.motion import parse_motion, sinusoid
from stimlib.scenes import ROWS, SHIPPED

FS = 4000
SCENES = {name: make() for name, make in SHIPPED.items()}


def hands(name):
    return {n: parse_motion(m) for n, m in ROWS[name].drive.items()}


def verified(scene, motion, seconds=0.3, fs=FS, **words):
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs, seconds, **words))


def again(scene):
    return Scene.from_dict(json.loads(json.dumps(scene.to_dict(), allow_nan=False)))


LIFTS = {"contact": lambda t: 1.0 * (np.sin(90 * t) > -0.3)}
PUSHED = {"x1": lambda t: 0.06 * np.minimum(10 * t, 1.0) ** 2}
SQUEEZED = {"fingers": 1, "motor_constant": 10.0}
# arguments, motion, output, how much larger it is than it should be, and which check
# says so
LIMITS = [
    ("squeeze", {"fingers": 1}, PUSHED, "force1", 2e-14, "mean part is k x"),
    ("squeeze", {"fingers": 1}, PUSHED, "force1", 1e-11, "vibration law"),
    ("squeeze", SQUEEZED, PUSHED, "current1", 2e-8, "I = F/(n B Gamma)"),
    ("squeeze", {"fingers": 1, "limits": True}, PUSHED, "force1", 1e-11, "vibration law"),
    ("viscoelastic", {}, {"y": lambda t: 0.02 * t}, "force", 2e-14, "springpot of these numbers"),
    ("viscoelastic", {}, {"y": lambda t: 0.02 * t}, "force", 3e-9, "full sum over the history"),
    ("bumps", {}, None, "voltage", 2e-6, "envelope times carrier"),
    ("bump_grid", {}, None, "voltage", 2e-6, "two envelopes times carrier"),
    ("texture", {}, None, "acceleration", 2e-7, "the models' recursion"),
    ("grating", {}, None, "force", 1e-10, "gratings and roughness of the place"),
    *(
        (name, {}, None, output, 2e-6, "written again")
        for name, output in (
            ("click", "force"),
            ("detents", "torque"),
            ("friction", "force"),
            ("wall", "force"),
            ("impact", "force"),
            ("ultrasonic_friction", "force"),
        )
    ),
    ("wall", {"k": 1e-6, "b": 0.0}, None, "force", 2e-6, "written again"),  # of 2e-9 N
    ("soft_surface", {}, None, "force", 2e-12, "eq. (2)"),
    ("soft_surface", {}, None, "depth1", 2e-10, "f/k"),
    ("soft_surface", {"mode": "multipoint"}, None, "depth3", 2e-10, "f/k"),
    ("soft_surface", {"mode": "multipoint"}, None, "y2", 2e-12, "of a triangle"),
    ("soft_surface", {"mode": "multipoint"}, None, "x3", 2e-12, "of a triangle"),
    ("soft_surface", {}, None, "y1", 2e-9, "the hand of some time ago"),
    (
        "soft_surface",
        {"mode": "cursor", "device": "mouse"},
        None,
        "x1",
        1e-10,
        "steps of the reversible cursor",
    ),
]


@pytest.mark.parametrize(
    ("name", "words", "motion", "output", "part", "says"),
    LIMITS,
    ids=lambda v: v if type(v) is str else "",
)
def test_an_output_that_is_off_by_little_more_than_its_tolerance_is_refused(
    name, words, motion, output, part, says
):
    scene = SHIPPED[name](**words)
    motion = {n: (motion or hands(name))[n] for n in scene.inputs}
    a = asked(gather(scene, motion, stimlib.render(scene, motion, FS, 0.3)), scene.parts[0])
    assert all(c.passed for c in scenes.SCENES[name](a))
    larger = dataclasses.replace(a, y=a.y | {output: (1 + part) * a.y[output]})
    bad = [c.name for c in scenes.SCENES[name](larger) if not c.passed]
    assert any(n.startswith(output) and says in n for n in bad), bad


@pytest.mark.parametrize("name", ["viscoelastic", "bumps", "grating"])
def test_the_least_output_off_contact_is_refused(name):
    scene, motion = SHIPPED[name](contact=True), hands(name) | LIFTS
    e = gather(scene, motion, stimlib.render(scene, motion, FS, 0.3))
    ((output, row),) = asked(e, scene.parts[0]).y.items()
    for least, bad in ((0.0, []), (1e-300, [f"{output}: none off contact"])):
        a = asked(e, scene.parts[0])
        off = dataclasses.replace(a, y={output: np.where(a.contact == 0, least, row)})
        assert [c.name for c in scenes.SCENES[name](off) if not c.passed] == bad


# Combinations -------------------------------------------------------------------------
MANY = [*itertools.combinations(SCENES, 2), *itertools.combinations(SCENES, 3)]


def combined(names):
    scene = again(Scene.combine(**{name: SCENES[name] for name in names}))
    return scene, {f"{name}_{n}": m for name in names for n, m in hands(name).items()}


@pytest.mark.parametrize("names", mostly(MANY[5:260:80], MANY), ids="-".join)
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


SUMS = {  # what is made of two signals of one unit, and the same with a wrong number
    "a+b": (lambda a, b: a + b, lambda a, b: a + 1.001 * b),
    "a-b/2": (lambda a, b: a - b / 2.0, lambda a, b: a + b / 2.0),
    "-(3a-b)+a": (lambda a, b: -(3.0 * a - b) + a, lambda a, b: -(3.0 * a - b)),
}
FORCES = ["wall", "squeeze", "viscoelastic", "impact", "grating"]


@pytest.mark.parametrize(
    "case",
    mostly(
        [*zip(SUMS, itertools.pairwise(FORCES), strict=False)],
        itertools.product(SUMS, itertools.pairwise(FORCES)),
    ),
    ids=str,
)
def test_a_sum_keeps_the_laws_of_its_terms(case):
    """Their sum is the law of the output; renamed, kept and combined again it stays."""
    kind, names = case
    both, motion = combined(names)
    rest = dict(both.outputs)
    signals = [rest.pop(next(n for n in rest if n.startswith(f"{name}_force"))) for name in names]
    right, wrong = (make(*signals) for make in SUMS[kind])
    scene = Scene({"sum": right} | rest, law=both)
    report = verified(scene, motion)
    names_of = {c.name: c for c in report.checks}
    assert report.passed and names_of["sum: sum"].measured <= names_of["sum: sum"].limit
    assert all(f"sum of {name}" in str(names_of) for name in names)
    bad = verified(Scene({"sum": wrong} | rest, scene.parts), motion)
    assert not next(c for c in bad.checks if c.name == "sum: sum").passed
    if kind == "a+b":
        one = Scene.combine(p=again(scene).renamed(outputs={"sum": "f"}))
        outputs = {"out": 2.0 * one.outputs["p_f"]} | {
            f"p_{n}": one.outputs[f"p_{n}"] for n in rest
        }
        found = verified(Scene(outputs, one), {f"p_{n}": m for n, m in motion.items()})
        assert found.passed and any(c.name == "out: sum" for c in found.checks)


def exact(x, p, fs):
    return {"y": (x["x"], 0.0)}


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_sum_may_be_off_by_the_rounding_of_its_terms_and_no_more(size):
    alone = Scene({"y": Input("x") + 0.0}, law=exact)
    both = Scene.combine(a=alone, b=alone)
    scene = Scene({"y": 0.1 * both.outputs["a_y"] + 0.3 * both.outputs["b_y"]}, law=both)
    motion = {n: size * np.sin(np.arange(100.0) + k) for k, n in enumerate(scene.inputs)}
    for off in (0.0, 1e-14):
        e = gather(scene, motion, stimlib.render(scene, motion, FS))
        e.y[0, 50] += off * size
        (held,) = (c for c in scene_law(e) if c.name == "y: sum")
        assert held.passed == (off == 0)


def test_a_term_without_a_law_is_said_and_one_in_no_sum_is_refused():
    wall, x = SCENES["wall"], Input("x", "m")
    force = wall.outputs["force"]
    own = Scene({"y": force + constant(1.0, "N/m") * x}, wall)
    report = verified(own, hands("wall"))
    assert report.passed and any("1 of its 2 terms" in text for text in report.evidence.skipped)
    for outputs in ({"y": abs(force)}, {"y": force / 0.0}, {"y": force, "z": -force}):
        refused(BadValue, "force of .* must be a term of one output", Scene, outputs, wall)
    wrong = own.parts[0].to_dict() | {"terms": {"force": ["a"]}}
    refused(SceneFileError, None, Part.from_dict, wrong, "here")


def envelope(x, p, fs, seed, *, size):
    """Half a row may be off by 1e-3, the other by nothing."""
    return {"y": (x["x"] + seed, np.where(np.arange(x["x"].size) < 50, size, 0.0))}


@pytest.mark.parametrize(("at", "passes"), [(49, True), (50, False)])
def test_a_law_gives_a_tolerance_for_each_sample_and_has_the_seed(at, passes):
    scene = Scene({"y": Input("x") + 0.0}, law=envelope, given={"size": 1e-3})
    e = gather(scene, {"x": np.ones(100)}, stimlib.render(scene, {"x": np.ones(100)}, FS))
    e.y[0, [10, at]] += 9e-4, 5e-4  # the larger one is allowed
    (found,) = scene_law(e)
    assert found.passed is passes
    assert passes or (found.measured, found.limit) == (pytest.approx(5e-4), 0.0)
    seeded = stimlib.render(scene, {"x": np.ones(100)}, FS, seed=1)
    assert not stimlib.verify(scene, {"x": np.ones(100)}, seeded).passed


def test_a_part_that_begins_with_another_value_is_refused_and_named():
    data = Scene.combine(edge=SCENES["wall"], knob=SCENES["detents"]).to_dict()
    (k,) = (block for block in data["blocks"] if block["fields"].get("name") == "edge_k")
    k["fields"]["value"] *= 1.25
    motion = {"edge_x": hands("wall")["x"], "knob_angle": hands("detents")["angle"]}
    (bad,) = [c for c in verified(Scene.from_dict(data), motion).checks if not c.passed]
    assert (
        bad.name == "parameters of edge: as they were asked for" and bad.text == "k = 1250 for 1000"
    )


def test_inputs_are_joined_only_where_that_is_said():
    both = Scene.combine(
        edge=SCENES["wall"], screen=SCENES["bumps"], share={"x": ("edge_x", "screen_x")}
    )
    assert list(both.inputs) == ["x"]
    assert verified(both, {"x": sinusoid(2e-3, 5.0)}).passed
    nested = Scene.combine(a=both, b=SCENES["wall"])
    assert list(nested.inputs) == ["a_x", "b_x"] and [p.name for p in nested.parts] == [
        "a_edge",
        "a_screen",
        "b",
    ]
    assert verified(nested, {"a_x": sinusoid(2e-3, 5.0), "b_x": sinusoid(1e-3, 5.0)}).passed


@pytest.mark.parametrize(
    ("make", "error", "says"),
    [
        (lambda: Scene.combine(), SceneError, "combine needs scenes by name"),
        (
            lambda: Scene.combine(SCENES["wall"], SCENES["bumps"]),
            SceneError,
            "combine needs scenes by name",
        ),
        (
            lambda: Scene.combine(SCENES["wall"], screen=SCENES["bumps"]),
            SceneError,
            "combine needs scenes by name",
        ),
        (lambda: Scene.combine(a=1), SceneError, "combine needs scenes by name"),
        (
            lambda: Scene.combine(
                soft=SCENES["soft_surface"],
                knob=SCENES["detents"],
                share={"x": ("soft_x", "knob_angle")},
            ),
            SceneError,
            "'x' would be x of soft.*and angle of knob.*not the same",
        ),
        (
            lambda: Scene.combine(
                a=SCENES["wall"], b=stimlib.scenes.wall(k=1.0), share={"k": ("a_k", "b_k")}
            ),
            SceneError,
            "k of a.*1000.*k of b.*1.0.*not the same",
        ),
        (
            lambda: Scene.combine(a=SCENES["wall"], share={"x": ("a_y",)}),
            UnknownName,
            "no part has 'a_y'; there are a_x, a_k, a_b",
        ),
        (
            lambda: Scene.combine(
                a=Scene({"b_y": 2 * Input("b_x")}), a_b=Scene({"y": 3 * Input("x")})
            ),
            SceneError,
            "'a_b_x' would be b_x of a.*and x of a_b",
        ),
        (
            lambda: Scene.combine(
                a=Scene({"b_y": 2 * Input("u")}), a_b=Scene({"y": 3 * Input("v")})
            ),
            SceneError,
            "two parts would have the output 'a_b_y'; give a_b another name",
        ),
        (
            lambda: Scene.combine(a=stimlib.scenes.squeeze(), b=stimlib.scenes.squeeze()),
            SceneError,
            "two noise sources have the key",
        ),
        (
            lambda: Scene.combine(
                a=SCENES["wall"], b=SCENES["wall"], share={"x": ("a_x",), "z": ("a_x", "b_x")}
            ),
            SceneError,
            "share: 'a_x' would be 'x' and 'z'; give it one name",
        ),
        (
            lambda: Scene.combine(a=SCENES["wall"], b=SCENES["wall"], share={"x": "a_x"}),
            SceneError,
            "share: 'x' is 'a_x', not a tuple of names; ",
        ),
        (
            lambda: Scene.combine(a=SCENES["wall"], share=["a_x"]),
            SceneError,
            r"share = \['a_x'\] must map new names to names",
        ),
        (
            lambda: SCENES["wall"].renamed(inputs={"y": "z"}),
            UnknownName,
            "there is no input 'y'; there are x",
        ),
        (
            lambda: SCENES["soft_surface"].renamed(outputs={"x1": "y1"}),
            SceneError,
            "two outputs would be called 'y1'",
        ),
    ],
)
def test_two_meanings_of_a_name_are_an_error_with_both_parts(make, error, says):
    refused(error, says, make)


# Of one's own -------------------------------------------------------------------------
def slope(x, p, fs, *, at):
    """A spring beyond a place."""
    return {"force": p["k"] * np.maximum(x["x"] - at, 0.0)}


def lone(factor=1.0, given=0.01):
    x, k = Input("x", "m"), Param("k", 200.0, "N/m")
    return Scene(
        {"force": factor * k * blocks.maximum(x - constant(0.01, "m"), 0)},
        law=slope,
        given={"at": given},
    )


def test_a_law_of_ones_own_is_held_and_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("stimlib.checks.page.figures", lambda e: [])
    motion = {"x": sinusoid(0.02, 3.0)}
    assert verified(lone(), motion, params={"k": 150.0}).passed
    assert verified(lone(1 + 1e-13), motion).passed and not verified(lone(1 + 1e-8), motion).passed
    assert (
        not verified(lone(1.0001), motion).passed
        and not verified(lone(given=0.0101), motion).passed
    )
    assert stimlib.render(again(lone()), motion, FS, 0.1).save(tmp_path / "a.wav", full_scale=10.0)
    report = stimlib.verify(tmp_path / "a.wav")
    assert report.passed and f"force: {__name__}.slope" in {c.name for c in report.checks}
    text = json.loads((tmp_path / "a.wav.json").read_text())["definitions"][__name__]["text"]
    assert "A spring beyond a place." in text
    both = Scene.combine(a=lone(), b=lone().renamed({"k": "stiffness"}))
    assert verified(both, {"a_x": motion["x"], "b_x": motion["x"]}).passed
    report.to_html(tmp_path / "a.html")
    assert f"The scene: the law {__name__}.slope" in (tmp_path / "a.html").read_text("utf-8")


def doubled(x, p, fs):
    """Of one output alone."""
    return {"y": 2 * x["x"]}


def test_an_output_of_which_a_law_of_ones_own_says_nothing_is_listed():
    x = Input("x")
    report = verified(Scene({"y": 2 * x, "extra": 5 * x}, law=doubled), {"x": sinusoid(1.0, 3.0)})
    assert report.passed
    assert f"extra: {__name__}.doubled returns nothing for it" in report.evidence.skipped


def initials(x, p, fs):
    return {"f": 2 * x["x"], "force": 3 * x["x"]}


@pytest.mark.parametrize("size", [1.0, 1e10])  # with a tolerance below 1, and above
def test_an_output_may_be_called_as_another_begins(size):
    scene = Scene({"f": 2 * Input("x"), "force": 3 * Input("x")}, law=initials)
    report = verified(scene, {"x": sinusoid(size, 3.0)})
    assert report.passed and [*report.spectra()] == ["f", "force"]
    assert report.evidence.skipped == []


def test_a_law_that_is_written_again_is_the_new_one():
    made = []
    for factor in (1.0, 2.0):

        def law(x, p, fs, factor=factor):
            return {"y": factor * x["x"]}

        made.append(
            verified(Scene({"y": 2.0 * Input("x")}, law=law), {"x": sinusoid(0.02, 3.0)}).passed
        )
    assert made == [False, True]


def forget(patch):
    """As in a process that has not imported this module."""
    patch.delitem(OWN, f"{__name__}.slope", raising=False)
    patch.delitem(sys.modules, __name__)


def test_a_law_is_known_once_its_module_is_imported(monkeypatch):
    kept, wrong, motion = again(lone()), again(lone(1.0001)), {"x": sinusoid(0.02, 3.0)}
    monkeypatch.delitem(OWN, f"{__name__}.slope")  # imported, and no scene made
    assert f"force: {__name__}.slope" in {c.name for c in verified(kept, motion).checks}
    assert not verified(wrong, motion).passed
    forget(monkeypatch)
    (said,) = (s for s in verified(kept, motion).evidence.skipped if "is not known here" in s)
    assert f"the law '{__name__}.slope'" in said and "import its module" in said


def test_a_report_says_first_that_a_law_is_not_known_here(tmp_path, monkeypatch):
    monkeypatch.setattr("stimlib.checks.page.figures", lambda e: [])
    scene = Scene.from_dict(
        Scene(
            {"y": 1 * Input("x")}, [Part("wal", {}), Part("my.slope", {}), Part("wal", {})]
        ).to_dict()
    )
    report = verified(scene, {"x": sinusoid(0.02, 3.0)})
    words = "assed, but its law 'wal', 'my.slope' is not known here and was not checked"
    assert (
        report.passed
        and report.unknown == report.to_dict()["unknown"] == ["wal", "my.slope"]
        and words in repr(report)
    )
    report.to_html(tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text("utf-8")
    assert (
        words.replace("'", "&#x27;") in page.partition("</h1>")[0]
        and '<span class="ok">Passed' not in page
    )
    assert (
        words in " ".join(str(report).split())
        and verified(lone(), {"x": sinusoid(0.02, 3.0)}).unknown == []
    )


@pytest.mark.parametrize(("law", "status"), [("wal", 1), ("wall", 0)])
def test_the_command_does_not_succeed_where_a_law_is_not_known(tmp_path, law, status):
    right = SCENES["wall"]
    scene = Scene(right.outputs, [dataclasses.replace(right.parts[0], law=law)])
    made = stimlib.render(scene, {"x": sinusoid(0.02, 3.0)}, FS, 0.1)
    made.save(tmp_path / "a.wav", full_scale=100.0)
    ran(["verify", tmp_path / "a.wav"], status)


@pytest.mark.parametrize(
    "law", ["os.path.join", f"{__name__}.hands", f"{__name__}.sinusoid", f"{__name__}.FS"]
)
def test_a_file_cannot_name_another_function_as_its_law(law):
    report = verified(Scene({"y": 1 * Input("x")}, [Part(law, {})]), {"x": sinusoid(0.02, 3.0)})
    assert any("is not known here" in s for s in report.evidence.skipped)


@pytest.mark.parametrize("written", [True, False])
def test_files_and_logs_are_proven_with_and_without_the_module_of_the_law(tmp_path, written):
    """Written where the law is known and verified where it is not, and the other way
    round.
    """
    motion, kept, path = {"x": sinusoid(0.02, 3.0)}, again(lone()), tmp_path / "a.wav"
    with pytest.MonkeyPatch.context() as patch:
        if not written:
            forget(patch)
        stimlib.render(kept, motion, FS, 0.1).save(path, full_scale=10.0)
        how = {"clocked": False, "motion": motion, "log": tmp_path / "log"}
        played(NullSink(kept, 10.0, **how), 0.1, fs=FS)
    with pytest.MonkeyPatch.context() as patch:
        if written:
            forget(patch)
        log = read_log(tmp_path / "log")
        assert stimlib.verify(path).passed and replay(log).matches and verify_log(log).passed


MISTAKES = {  # what a law returns of x, and what is said of it
    "shape": (lambda x, p: x[1:], r"y has the shape \(1199,\)"),
    "parameter": (lambda x, p: p["k"], "failing raises KeyError: 'k'"),
    "arithmetic": (lambda x, p: x / (1 // 0), "failing raises ZeroDivisionError"),
    "spelling": (lambda x, p: rows, "failing raises NameError"),  # noqa: F821
    "written into": (lambda x, p: x.fill(2.0), "failing raises ValueError: .*read-only"),
    "infinite": (lambda x, p: np.full(x.size, np.inf), "not finite"),
    "tolerance without end": (lambda x, p: (x, np.inf), "the tolerance inf"),
    "tolerance below 0": (lambda x, p: (x, -1e-9), "the tolerance -1e-09"),
    "tolerances for other samples": (lambda x, p: (x, np.full(7, 1e-9)), "the tolerance"),
    "tolerances here and there": (
        lambda x, p: (x, np.where(x > 0, 1e-9, np.nan)),
        "the tolerance",
    ),
    "tolerance that is no number": (lambda x, p: (x, True), "the tolerance True"),
    "three things": (lambda x, p: (x, 1e-9, 0.0), "a tuple of 3"),
    "complex": (lambda x, p: x + 0j, "complex values"),
}


def failing(x, p, fs, *, mistake):
    return {"y": MISTAKES[mistake][0](x["x"], p)}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_law_that_fails_says_where(mistake):
    scene = Scene({"y": 1 * Input("x")}, law=failing, given={"mistake": mistake})
    refused(BadValue, MISTAKES[mistake][1], verified, scene, {"x": sinusoid(0.02, 3.0)})
    other = Scene({"z": 1 * Input("x")}, law=doubled)
    refused(BadValue, "the outputs y", verified, other, {"x": sinusoid(0.02, 3.0)})


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
        ({"law": slope, "given": [0.01]}, "must be a dict"),
        ({"law": slope, "given": 3}, "must be a dict"),
        ({"given": {"at": 0.01}}, "without a law"),
        *(
            ({"law": law, "given": {}}, "is not known; give one of .*wall")
            for law in ("wal", "Wall", "os.path.join", "my.slope", "")
        ),
        (
            {"law": slope, "given": {"at": reduce(lambda inner, _: [inner], range(3000), [])}},
            "deep",
        ),
        ({"law": 3}, "law = 3 must be"),
        ({"law": slope, "given": {"at": object()}}, "cannot be kept in a scene file"),
        ({"law": slope, "given": {"at": Span}}, "cannot be kept in a scene file"),
        ({"law": slope, "given": {"at": Part}}, "cannot be kept in a scene file"),
        ({"law": slope, "given": {"at": float("nan")}}, "cannot be kept in a scene file"),
    ],
)
def test_a_law_that_no_file_could_keep_is_refused(words, says):
    refused(BadValue, says, Scene, {"y": 1 * Input("x")}, **words)


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
        (lambda p: p.update(span=[0, 1e308, 0, None]), "span"),
        (
            lambda p: p.update(given={"at": reduce(lambda inner, _: [inner], range(3000), [])}),
            "nested too deeply",
        ),
        (lambda p: p.update(more=1), "no field 'more'"),
        (lambda p: p.pop("name"), "name"),
        *(
            (lambda p, value=value: p.update(given={**p["given"], "at": value}), "cannot be kept")
            for value in (float("nan"), float("inf"), 10**400, [[float("-inf")]])
        ),
    ],
)
def test_a_scene_file_with_a_wrong_law_is_refused(change, says):
    data = SCENES["wall"].to_dict()
    change(data["law"][0])
    refused(SceneFileError, says, Scene.from_dict, data)


def test_what_was_asked_for_is_kept_as_it_is():
    """In whatever order it is given; with any seed of an interval; and where an older
    file has none.
    """
    assert parts_of("wall", None)[0].given is None and parts_of("wall", {})[0].given == {}
    assert plain({"seed": 2**64 - 1, 1: (np.float32(0.5), True)}) == {
        "seed": 2**64 - 1,
        "1": [0.5, True],
    }
    outputs, given = SCENES["wall"].outputs, {"at": 0.0, "k": 1.0}
    other = dict(reversed(given.items()))
    assert Scene(outputs, "wall", given).hash == Scene(outputs, "wall", other).hash
    for seed in (None, 0, 2**64 - 1):
        shown = dataclasses.replace(SCENES["wall"].parts[0], span=Span(0.5, 1.0, 0.1, seed))
        assert again(Scene(outputs, [shown])).parts == (shown,)
    both = again(Scene.combine(a=Scene(outputs, "wall"), b=SCENES["wall"]))
    assert [(p.name, p.law, p.given is None) for p in both.parts] == [
        ("a", "wall", True),
        ("b", "wall", False),
    ]


def test_a_scene_of_an_older_file_is_read_and_its_law_is_said_to_lack_what_was_asked_for():
    data = SCENES["wall"].to_dict() | {"stimlib_scene": 1, "law": "wall"}
    scene = Scene.from_dict(data)
    assert scene.to_dict() == data
    report = verified(scene, hands("wall"))
    assert report.passed and "the law 'wall' needs what the scene was asked for" in "; ".join(
        report.evidence.skipped
    )


# Trials -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*SCENES, "of one's own"])
def test_the_law_of_a_scene_holds_in_each_interval_of_a_trial(name):
    shown = SCENES.get(name) or lone()
    weaker = {n: 0.9 * shown.params[n].value for n in list(shown.params)[:1]}
    scene, params = pair(shown, weaker)
    motion = hands(name) if name in SCENES else {"x": sinusoid(0.02, 3.0)}
    made = stimlib.render(scene, motion, FS, 0.55, params=params, seed=3)
    checks = scene_law(gather(scene, motion, made))
    assert all(c.passed for c in checks), checks
    assert all(any(f"from {start}" in c.name for c in checks) for start in (0.032, 0.282))


@pytest.mark.parametrize("ramp", mostly([0.05], [0.0, 0.05]))
def test_a_wrong_interval_is_refused(ramp):
    scene, params = pair(SCENES["squeeze"], {"k": 1800.0}, ramp)
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
    scene, _ = pair(Scene.combine(edge=SCENES["wall"], knob=SCENES["detents"]), {})
    assert [(p.law, p.name, p.span.start, p.span.seed) for p in scene.parts] == [
        (law, f"interval_{i}", start, seed)
        for i, start, seed in ((1, 0.032, None), (2, 0.282, 5))
        for law in ("wall", "detents")
    ]
    assert pair(scene, {})[0].parts == ()  # of a trial within a trial no law knows the time


# Hostile ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("viscoelastic", {"w": 0}),
        ("touch_screen", {"swap": 0}),
        ("touch_screen", {"model": []}),
        ("click", {"at": 0}),
    ],
)
def test_a_law_that_cannot_take_what_a_file_says_fails(name, change):
    data = SCENES[name].to_dict()
    data["law"][0]["given"] |= change
    scene = Scene.from_dict(data)
    checks = scene_law(gather(scene, hands(name), stimlib.render(scene, hands(name), FS, 0.1)))
    assert "shape of the scene" in [c.name for c in checks if not c.passed]


# Laws that misbehave ------------------------------------------------------------------
def writes(x, p, fs, *, values):
    """Write into what was given."""
    values.append(1.0)
    return {"y": 2.0 * x["x"]}


def test_a_law_that_writes_into_what_it_gets_changes_nothing():
    scene = Scene({"y": 2.0 * Input("x")}, law=writes, given={"values": [1.0]})
    was, report = scene.hash, verified(scene, {"x": sinusoid(0.02, 3.0)})
    assert report.passed and scene.hash == was
