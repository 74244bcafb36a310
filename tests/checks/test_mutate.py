"""`mutate` says which wrong numbers the laws of a scene refuse, and what they miss."""

import json
import math

import numpy as np
import pytest
from checks.test_parts import SCENES, hands
from commands import ran
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, blocks
from stimlib.checks.mutation import CHANGES, Mutant, Mutations, _applied, _numbers, _outcome, mutate
from stimlib.core.graph import reach, signals
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
    wanted = {f"argument {n}" for n in ("k", "A", "freq", "decay", "cutoff", "b")}
    blocks = zip(reach(scene.outputs.values()), scene.to_dict()["blocks"], strict=True)
    for i, (block, entry) in enumerate(blocks):
        name, fields = entry["class"], entry["fields"]
        numbers = {f for f, v in fields.items() if type(v) in (int, float)} - {
            *signals(type(block))
        }
        where = f"parameter {fields.get('name')}" if name == "Param" else f"{name} {i}: "
        wanted |= {where if name == "Param" else where + f for f in numbers}
    assert wanted <= {m.where for m in found.mutants} and len(wanted) >= 18
    assert {m.change for m in found.mutants if m.where == "argument freq"} == set(CHANGES)


def two(x, p, fs):
    """Outputs, each to its own tolerance; nothing of w."""
    return {"y": (x["x"], 0.1), "z": (2 * x["x"], 0.4), "wide": x["x"]}


def test_each_outcome_of_a_mutant():
    """Of scenes in the place of the right one, which is rendered with the same
    numbers.
    """
    x, k, noise = Input("x"), Param("k", 2.0), blocks.white_noise(1)
    motion, params = {"x": sinusoid(1.0, 20.0, 2.0)}, {"k": 3.0}

    def scene(**changed):
        outputs = {"y": 1.0 * x, "z": 2.0 * x, "w": k * noise, "wide": 1.0 * x}
        return Scene(outputs | changed, law=two)

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


def test_the_changes_of_a_number_and_of_many():
    assert [f(4.0) for f in CHANGES.values()] == [4.04, 5.0, -4.0, 0.0, 1.0]
    assert [_applied(4, f) for f in CHANGES.values()] == [5, 5, -4, 0, 1] and _applied(
        1, CHANGES["1"]
    ) == 2
    assert _applied([4.0, [2.0, -1.0]], CHANGES["other sign"]) == [-4.0, [-2.0, 1.0]]
    assert _numbers([1, [2.0]]) and not any(map(_numbers, (True, [], "1", None, [1.0, True])))


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["wall", "--motion", "sinusoid(0.002, 10)", "--json"], 0, '"passed": true'),
        (["wall", "--json"], 0, '"passed": true'),
        (["mine.py:scene", "--motion", "sinusoid(1, 10)"], 1, "no law"),
    ],
)
def test_the_command_prints_a_table_and_tells_by_its_status(
    tmp_path, monkeypatch, words, status, said
):
    own = "from stimlib import Input, Scene\nscene = Scene({'y': 2.0 * Input('x')})\n"
    (tmp_path / "mine.py").write_text(own)
    monkeypatch.chdir(tmp_path)
    printed = ran(["mutate", *words, "--seconds", "0.1"], status).stdout
    assert said in printed
    assert status or json.loads(printed)["count"]["refused"] > 10


def twice(x, p, fs):
    return {"y": 2.0 * p["k"] * x["x"]}


def of_a_logarithm(x, p, fs):
    return {"y": math.exp(math.log(p["k"][0])) * x["x"]}


@pytest.mark.parametrize(
    ("y", "x", "says"),
    [
        (Param("k", 3.0) * Input("x"), sinusoid(0.02, 3.0), r"as it is: \(d\) y: .*twice"),
        (Param("k", 3.0) / Input("x"), np.zeros(200), "has a fault in this motion"),
    ],
)
def test_a_scene_that_its_law_refuses_unchanged_is_an_error(y, x, says):
    """Otherwise every change would count as refused."""
    refused(BadValue, says, mutate, Scene({"y": y}, law=twice), {"x": x}, 1000, 0.2)


def test_a_law_that_raises_for_a_wrong_number_refuses_it():
    scene = Scene({"y": Param("k", 3.0) * Input("x")}, law=of_a_logarithm)
    found = mutate(scene, {"x": sinusoid(0.02, 3.0)}, 1000, 0.2).mutants
    (sign,) = [m for m in found if m.change == "other sign" and m.where == "parameter k"]
    assert sign.outcome == "refused" and "of_a_logarithm raises ValueError" in sign.text
