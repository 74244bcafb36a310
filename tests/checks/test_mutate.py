"""`mutate` says which wrong numbers the laws of a scene refuse, and what they miss."""

import json
import math

import numpy as np
import pytest
from checks.test_parts import SCENES, hands
from refusals import refused
from typer.testing import CliRunner

import stimlib
from stimlib import BadValue, Input, Param, Scene, blocks, constant
from stimlib.checks.mutation import CHANGES, Mutant, Mutations, _applied, _numbers, _outcome, mutate
from stimlib.cli.app import app
from stimlib.core.graph import signals
from stimlib.motion.generators import sinusoid

CHEAP = ["wall", "bumps", "viscoelastic", "detents"]


@pytest.mark.parametrize(
    "name", [*CHEAP, *(pytest.param(n, marks=pytest.mark.stress) for n in SCENES if n not in CHEAP)]
)
@pytest.mark.filterwarnings("ignore:touch_screen.* are held")
def test_the_law_of_a_shipped_scene_refuses_every_wrong_number(name):
    found = mutate(SCENES[name], hands(name), 4000, 0.2)
    missed = [m for m in found.mutants if m.outcome in ("within tolerance", "no law")]
    # along the plate's middle its shapes hardly depend on it: 2e-8
    flat = "width" if name == "touch_screen" else None
    assert not [m for m in missed if flat is None or flat not in m.where], missed
    assert found.count()["refused"] > len(found.mutants) / 3


def test_every_number_of_every_block_is_changed():
    scene = SCENES["impact"]
    found = mutate(scene, hands("impact"), 2000, 0.05)
    numbers = {m.where for m in found.mutants}
    data = scene.to_dict()["blocks"]
    for i, (block, entry) in enumerate(zip(_order(scene), data, strict=True)):
        for field, v in entry["fields"].items():
            if (
                isinstance(v, (int, float))
                and not isinstance(v, bool)
                and field not in signals(type(block))
            ):
                name = (
                    f"parameter {entry['fields']['name']}"
                    if entry["class"] == "Param"
                    else f"{entry['class']} {i}: {field}"
                )
                assert name in numbers
    assert {f"argument {n}" for n in ("k", "A", "freq", "decay", "cutoff", "b")} <= numbers
    assert {m.change for m in found.mutants if m.where == "argument freq"} == set(CHANGES)


def _order(scene):
    from stimlib.core.graph import reach

    return reach(scene.outputs.values())


def half(x, p, fs):
    """Says nothing of the output z, and looks at y no closer than 20 %."""
    y = p["k"] * x["x"]
    return {"y": (y, 0.2 * float(np.abs(y).max()))}


def lax():
    x = Input("x")
    return Scene(
        {
            "y": Param("k", 2.0) * x * 3.0 / 3.0,
            "z": x * constant(5.0) + blocks.where(x > 9.0, constant(7.0), 0.0),
        },
        law=half,
    )


def test_what_a_law_misses_is_said_with_the_reason():
    found = mutate(lax(), {"x": np.sin(np.arange(100.0))}, 1000, 0.1)
    assert not found.passed
    of = {(m.where, m.change): (m.outcome, m.text) for m in found.mutants}
    outcomes = {}
    for (where, change), (outcome, text) in of.items():
        outcomes.setdefault(outcome, set()).add((where.split(" ")[0], change, text))
    assert {"refused", "equal samples", "within tolerance", "no law"} <= set(outcomes)
    assert any(
        change == "1.01 times" and "of its limit" in text
        for _, change, text in outcomes["within tolerance"]
    )
    assert any("z" in text for *_, text in outcomes["no law"])
    assert (
        of["parameter k", "1.25 times"][0] == "within tolerance"
        or of["parameter k", "1.25 times"][0] == "refused"
    )


def two(x, p, fs):
    """Two outputs, each to its own tolerance; nothing of a third."""
    return {"y": (x["x"], 0.1), "z": (2 * x["x"], 0.4)}


def test_each_outcome_of_a_mutant():
    """Of scenes in the place of the right one, which is rendered with the same
    numbers.
    """
    x, k, noise = Input("x"), Param("k", 2.0), blocks.white_noise(1)
    motion, params = {"x": sinusoid(1.0, 20.0, 2.0)}, {"k": 3.0}

    def scene(**changed):
        return Scene({"y": 1.0 * x, "z": 2.0 * x, "w": k * noise} | changed, law=two)

    right = stimlib.render(scene(), motion, 1000, 0.1, params, 5)
    for changed, outcome, text in (
        ({}, "equal samples", ""),
        (
            {"y": x + 0.05, "z": 2.0 * x + 0.36},
            "within tolerance",
            f"(d) z: {__name__}.two: 0.9 of its limit",
        ),
        (
            {"y": x + 0.09, "z": 2.0 * x + 0.04},
            "within tolerance",
            f"(d) y: {__name__}.two: 0.9 of its limit",
        ),
        ({"z": 2.0 * x + 0.41}, "refused", f"(d) z: {__name__}.two"),
        ({"w": k * noise * 1.5}, "no law", "of w"),
        ({"w": x / (k - 3.0)}, "refused", "(e) no fault"),
        ({"v": 1.0 * x}, "refused", "its outputs are others"),
        ({"y": 1.0 * Input("u")}, "refused", "its inputs are others"),
    ):
        assert _outcome(lambda changed=changed: scene(**changed), motion, right, params, 5) == (
            outcome,
            text,
        )
    outcome, text = _outcome(lambda: scene(y=1.0 * Input("a b")), motion, right, params, 5)
    assert outcome == "cannot be made" and "name" in text
    for what in ("refused", "equal samples", "within tolerance", "no law", "cannot be made"):
        assert Mutations([Mutant("", "", "", "refused"), Mutant("", "", "", what)]).passed is (
            what[0] not in "wn"
        )


def test_an_output_off_contact_alone_refuses_a_mutant():
    right, motion = (
        stimlib.scenes.bumps(contact=True),
        {
            "x": sinusoid(0.02, 20.0),
            "contact": lambda t: 1.0 * (t > 0.05),
        },
    )
    wrong = Scene(
        {
            "voltage": blocks.where(
                Input("contact"), right.outputs["voltage"], constant(1e-300, "V")
            )
        },
        right.parts,
    )
    rendering = stimlib.render(right, motion, 4000, 0.1)
    assert _outcome(lambda: wrong, motion, rendering, None, 0) == (
        "refused",
        "(e) voltage: none off contact",
    )


def test_the_changes_of_a_number_and_of_many():
    assert [f(4.0) for f in CHANGES.values()] == [4.04, 5.0, -4.0, 0.0, 1.0]
    assert [_applied(4, f) for f in CHANGES.values()] == [5, 5, -4, 0, 1] and _applied(
        1, CHANGES["1"]
    ) == 2
    assert _applied([4.0, [2.0, -1.0]], CHANGES["other sign"]) == [-4.0, [-2.0, 1.0]]
    assert _numbers([1, [2.0]]) and not any(map(_numbers, (True, [], "1", None, [1.0, True])))


def test_the_command_prints_a_table_and_tells_by_its_status(tmp_path, monkeypatch):
    run = CliRunner().invoke(
        app, ["mutate", "wall", "--seconds", "0.1", "--motion", "sinusoid(0.002, 10)", "--json"]
    )
    data = json.loads(run.stdout)
    assert run.exit_code == 0 and data["passed"] and data["count"]["refused"] > 10
    (tmp_path / "mine.py").write_text(
        "from stimlib import Input, Scene\nscene = Scene({'y': 2.0 * Input('x')})\n"
    )
    run = CliRunner().invoke(
        app,
        ["mutate", f"{tmp_path}/mine.py:scene", "--seconds", "0.1", "--motion", "sinusoid(1, 10)"],
    )
    assert run.exit_code == 1 and "no law" in run.stdout
    assert stimlib.checks.mutation.mutate is mutate


def rooted(x, p, fs):
    """A law that has no number where k is below 0."""
    with np.errstate(invalid="ignore"):
        return {"y": (1 + np.sqrt(p["k"]) ** 2) * x["x"]}


def test_a_law_that_raises_refuses_a_wrong_number_but_of_the_scene_itself_is_an_error():
    motion = {"x": np.sin(np.arange(100.0))}
    right = Scene({"y": abs(1.0 + Param("k", 2.0)) * Input("x")}, law=rooted)
    found = mutate(right, motion, 1000, 0.1)
    assert ("parameter k", "other sign", "refused") in {
        (m.where, m.change, m.outcome) for m in found.mutants
    }
    wrong = Scene({"y": 2.0 * abs(1.0 + Param("k", 2.0)) * Input("x")}, law=rooted)
    refused(
        stimlib.BadValue, "the law refuses the scene as it is", mutate, wrong, motion, 1000, 0.1
    )


def twice(x, p, fs):
    return {"y": 2.0 * p["k"] * x["x"]}


def of_a_logarithm(x, p, fs):
    return {"y": math.exp(math.log(p["k"][0])) * x["x"]}


def test_a_scene_that_its_law_refuses_unchanged_is_an_error():
    """Otherwise every change would count as refused."""
    scene, motion = (
        Scene({"y": Param("k", 3.0) * Input("x")}, law=twice),
        {"x": sinusoid(0.02, 3.0)},
    )
    refused(
        BadValue,
        r"the law refuses the scene as it is: \(d\) y: .*twice; correct",
        mutate,
        scene,
        motion,
        1000,
        0.2,
    )
    refused(
        BadValue,
        "the scene has a fault in this motion",
        mutate,
        Scene({"y": Param("k", 3.0) / Input("x")}, law=twice),
        {"x": np.zeros(200)},
        1000,
        0.2,
    )


def test_a_law_that_raises_for_a_wrong_number_refuses_it():
    scene, motion = (
        Scene({"y": Param("k", 3.0) * Input("x")}, law=of_a_logarithm),
        {"x": sinusoid(0.02, 3.0)},
    )
    found = {m.change: m for m in mutate(scene, motion, 1000, 0.2).mutants}
    assert (
        found["other sign"].outcome == "refused"
        and "of_a_logarithm raises ValueError" in found["other sign"].text
    )


def test_the_command_needs_no_motion():
    run = CliRunner().invoke(app, ["mutate", "wall", "--seconds", "0.1", "--json"])
    assert run.exit_code == 0 and json.loads(run.stdout)["count"]["refused"] > 10
