"""Scene files: what comes back is what was saved, and a file can do nothing but
describe a scene.
"""

import json
import os
import pickle
import sys
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
import pytest
from contract import EACH, TABLE
from laws import STRESS, assert_same, mostly, rows
from refusals import refused

import stimlib
from stimlib import (
    Input,
    Param,
    Scene,
    SceneError,
    SceneFileError,
    StimlibError,
    blocks,
    constant,
    load,
)
from stimlib.core import program
from stimlib.core.graph import Block, reach, registry

x = Input("x")


@pytest.mark.parametrize("entry", mostly(EACH.values(), TABLE), ids=lambda e: e.name)
def test_a_file_gives_back_the_scene(entry, tmp_path):
    scene = entry.scene()
    scene.save(tmp_path / "scene.json")
    again = load(tmp_path / "scene.json")
    assert (again.hash, repr(again)) == (scene.hash, repr(scene))
    assert again.to_dict() == scene.to_dict()
    fs = entry.rates[0]
    procs = [stimlib.compile(s, fs, "python") for s in (scene, again)]
    u = rows(procs[0], entry.x(30, fs), entry.inputs)
    assert procs[0].inputs == procs[1].inputs
    assert_same(*(p.process(u) for p in procs))
    assert_same(*(p.state for p in procs))
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "scene.json").read_bytes()


def test_numbers_and_shared_parts_come_back(tmp_path):
    taps = np.random.default_rng(0).standard_normal(50) * 10.0 ** np.arange(-25, 25)
    noise = blocks.white_noise(2**64 - 1)
    table = blocks.lut(x, [0.0, 1.0, 2.0], lambda k: k**2)  # sampled when built
    filtered = blocks.fir(x, [*taps, 5e-324, -0.0, 1.7976931348623157e308])
    Scene({"f": filtered, "y": noise + x, "z": noise * x, "t": table}).save(tmp_path / "s.json")
    again = load(tmp_path / "s.json").outputs
    assert_same(again["f"].taps, filtered.taps)
    assert again["y"].a is again["z"].a and again["y"].a.seed == 2**64 - 1
    assert again["t"].values.tolist() == [0, 1, 4]
    stimlib.scenes.squeeze(fingers=1).save(tmp_path / "s.json")
    assert [p.law for p in load(tmp_path / "s.json").parts] == ["squeeze"]


def test_hash_tells_scenes_apart():
    scenes = [x, 2 * x, x * 2, -x, blocks.delay(x, 1), blocks.delay(x, 2), Param("x", 1.0)]
    hashes = {Scene({"y": b}).hash for b in [*scenes, Input("z")]}
    assert len(hashes | {Scene({"y": x, "z": b}).hash for b in (x, -x)}) == 10
    assert Scene({"y": x}).hash == Scene({"y": Input("x")}).hash in hashes
    assert Scene({"y": x, "z": 2 * x}).hash != Scene({"y": x, "w": 2 * x}).hash


def test_scenes_are_equal_where_their_hashes_are(tmp_path):
    """A scene that was made again, loaded, copied or pickled."""
    scene = Scene({"y": 2 * x})
    scene.save(tmp_path / "s.json")
    copies = [scene, Scene({"y": 2 * Input("x")}), load(tmp_path / "s.json"), deepcopy(scene)]
    copies.append(pickle.loads(pickle.dumps(scene)))
    assert all(one == scene for one in copies) and len(set(copies)) == 1
    assert Scene({"y": 3 * x}) not in {scene: 1} and scene != scene.hash


# Files that are not scenes ------------------------------------------------------------
GIVEN = Scene({"y": blocks.velocity(x, 30.0) * blocks.fir(x, [1.0, 2.0])})


@pytest.fixture
def edited(tmp_path):
    """Load the file of a scene after a change to its data: of a block's entry, of
    fields of a block of a class, or of the whole.
    """

    def change(whole=None, name="", entry=None, /, **fields):
        data = GIVEN.to_dict()
        for block in data["blocks"]:
            if block["class"] == name:
                block["fields"] |= fields
                block |= entry or {}
        path = tmp_path / "edited.json"
        path.write_text(json.dumps(data | whole if isinstance(whole, dict) else whole or data))
        return load(path)

    return change


def with_block(entry):
    return {"blocks": [*GIVEN.to_dict()["blocks"], entry]}


@pytest.mark.parametrize(
    ("whole", "words"),
    [
        ({"stimlib_scene": 99}, ["99", "update"]),
        ({"stimlib_scene": "1"}, ["version"]),
        ({"stimlib_scene": True}, ["version"]),
        ({"law": 3}, ["law must be a name"]),
        (with_block(3), ["class and fields"]),
        (with_block({"class": "Neg"}), ["class and fields"]),
        (with_block({"class": "Block", "fields": {}}), ["Block"]),
        (with_block({"class": "Map", "fields": {}}), ["Map"]),
        (with_block({"class": "Neg", "fields": {}}), ["Neg", "x"]),
        ({"outputs": {"y": 99}}, ["'y'", "99"]),
        ({"outputs": [1]}, ["outputs"]),
        ({"blocks": {}}, ["blocks"]),
        ({"outputs": {}}, ["output"]),
        ([1, 2], ["not a stimlib scene"]),
        (3, ["not a stimlib scene"]),
    ],
)
def test_a_changed_file_is_an_error_that_says_where(edited, whole, words):
    error = refused(SceneError, None, edited, whole)
    assert all(w in str(error) for w in words), error


@pytest.mark.parametrize(
    ("name", "fields", "words"),
    [
        *[("Velocity", {"x": v}, ["earlier block"]) for v in (99, 3, -1, True, "x", None)],
        ("Velocity", {"mass": 3}, ["Velocity", "mass"]),
        ("Velocity", {"cutoff": -1.0}, ["cutoff"]),
        *[("Velocity", {"cutoff": v}, ["cutoff", "Velocity"]) for v in ("fast", {"a": 1}, None)],
        *[("Taps", {"taps": v}, ["Taps"]) for v in (["a"], 5.0, [[1], [2, 3]])],
        ("Taps", {"gain_unit": "mm"}, ["Taps", "mm"]),
        ("Taps", {"gain_unit": 3}, ["Taps"]),
        ("Input", {"name": 7}, ["Input"]),
        ("Input", {"name": "__import__('os')"}, ["Input"]),
    ],
)
def test_a_changed_field_is_an_error_that_says_where(edited, name, fields, words):
    error = refused(SceneError, None, edited, None, name, **fields)
    assert all(w in str(error) for w in words), error


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        *[f'{{"stimlib_scene": 1, "blocks": [{n}]}}' for n in ("NaN", "-Infinity", "1e999")],
        "\x00\x01",
        "[" * 100_000,
        "\ufeff{}",
        b"\xff\xfe\x00{",
    ],
)
def test_a_file_that_is_not_json(tmp_path, text):
    path = tmp_path / "bad.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    refused(SceneFileError, "bad.json", load, path)


def test_missing_and_unwritable(tmp_path):
    path, save = tmp_path / "s.json", Scene({"y": x}).save
    refused(SceneFileError, "No such file", load, path)
    refused(SceneFileError, "No such file", save, tmp_path / "no" / "where.json")
    (tmp_path / "folder").mkdir()
    refused(SceneFileError, "cannot write", save, tmp_path / "folder")
    path.write_text("old" * 100_000)
    save(path)
    assert load(path).hash == Scene({"y": x}).hash
    assert {p.name for p in tmp_path.iterdir()} == {"folder", "s.json"}, "no half file is left"


# Blocks of users, and nothing that runs -----------------------------------------------
@dataclass(frozen=True, eq=False)
class Doubled(Block):
    x: Block

    @staticmethod
    def step(p, s, x):
        return x + x, s


def test_a_user_block_loads_where_it_is_imported(tmp_path, monkeypatch):
    path, name = tmp_path / "s.json", f"{__name__}.Doubled"
    Scene({"y": Doubled(x)}).save(path)
    assert isinstance(load(path).outputs["y"], Doubled)
    monkeypatch.delitem(registry, name)
    for module, says in {
        __name__: f"import {__name__} first.*--import",
        "__main__": "a script or a notebook defined",
        "lab": "--import lab.py$",
        "lab.a": "a file .* imports lab.a$",
    }.items():
        text = path.read_text().replace(f'"{name}"', f'"{module}.Doubled"')
        (tmp_path / "t.json").write_text(text)
        refused(SceneFileError, says, load, tmp_path / "t.json")


def test_loading_executes_nothing(edited, tmp_path):
    """Names of functions, modules and methods in the place of classes and fields stay
    text.
    """
    mark = tmp_path / "mark"
    code = f"__import__('pathlib').Path({str(mark)!r}).touch()"
    names = "os.system", "eval", "subprocess.Popen", "stimlib.core.graph.Mul", "__main__.x", code
    for name in (*names, "antigravity.Block", "Teleport", "lab.blocks.Mine"):
        error = refused(SceneFileError, None, edited, None, "Velocity", {"class": name})
        assert name[:40] in str(error) and "import" in str(error) or "update" in str(error)
        refused(SceneFileError, None, edited, None, "Taps", gain_unit=name)
    assert not mark.exists() and "antigravity" not in sys.modules


# Files of others ----------------------------------------------------------------------
def chain(length):
    """A scene file's data: so many negations in a row."""
    negs = [{"class": "Neg", "fields": {"x": i}} for i in range(length - 1)]
    return {
        "blocks": [{"class": "Input", "fields": {"name": "x", "unit": ""}}, *negs],
        "outputs": {"y": length - 1},
    }


def write(path, data):
    path.write_text(json.dumps({"stimlib_scene": 1, "law": None, **data}))
    return path


def test_gates_in_gates_are_refused_quickly(tmp_path, monkeypatch):
    """Eighteen levels, 1.5 kB: they took half a minute and 862 MiB.  Copies are counted
    before any is made.
    """
    data = {
        "blocks": [{"class": "Param", "fields": {"name": "p", "value": 1.0, "unit": ""}}],
        "outputs": {"y": 19},
    }
    data["blocks"].append({"class": "Neg", "fields": {"x": 0}})
    data["blocks"] += [{"class": "Enabled", "fields": {"block": i, "by": i}} for i in range(1, 19)]
    monkeypatch.setattr(program, "Instance", None)
    says = "copies: 786431 is more than limits.scene_blocks = 100000"
    refused(SceneError, says, load, write(tmp_path / "s.json", data))
    y = blocks.oscillator(10.0)
    for k in range(8):
        y = y + blocks.enabled(y, by=blocks.oscillator(1.0 + k) > 0.0)
    monkeypatch.setattr(stimlib.limits, "scene_blocks", 100)
    refused(SceneError, "own copies: 120 is more than limits.scene_blocks", Scene, {"y": y})


@pytest.mark.parametrize("hidden", [False, True])
def test_a_million_blocks_are_refused_before_they_are_read(tmp_path, monkeypatch, hidden):
    word, blocks = "class", 1_000_000
    if hidden:  # the same word in other letters, which are counted once they are read
        word, blocks = "cl\\u0061ss", 1001
        monkeypatch.setattr(stimlib.limits, "scene_blocks", 1000)
    path = tmp_path / "s.json"
    many = f'{{"{word}":"Neg","fields":{{"x":0}}}},' * blocks
    path.write_text(
        f'{{"stimlib_scene": 1, "law": null, "blocks": [{many[:-1]}], "outputs": {{"y": 0}}}}'
    )
    refused(SceneFileError, "s.json: blocks: .* more than limits.scene_blocks", load, path)


def test_limits_can_be_raised_and_lowered(tmp_path, monkeypatch):
    path = write(tmp_path / "s.json", chain(30))
    assert len(reach(load(path).outputs.values())) == 30
    monkeypatch.setattr(stimlib.limits, "scene_blocks", 29)
    refused(SceneFileError, "blocks: 30 is more than limits.scene_blocks = 29", load, path)
    monkeypatch.setattr(stimlib.limits, "scene_blocks", 1e6)
    monkeypatch.setattr(stimlib.limits, "scene_bytes", 100)
    refused(SceneFileError, "bytes: .* more than limits.scene_bytes = 100", load, path)


def test_pipes_devices_and_odd_paths(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    for path in (tmp_path / "pipe.json", "/dev/zero", tmp_path):
        refused(SceneFileError, "not a regular file|Is a directory", load, path)
    for path in ("a\0b.json", "\ud800.json", "x" * 5000 + ".json", str(tmp_path / ("y" * 300))):
        assert str(refused(SceneFileError, "cannot read", load, path)).isprintable()
        refused(SceneFileError, "cannot write", Scene({"y": x}).save, path)


@pytest.mark.parametrize("depth", [1000, 1_000_000])
def test_json_as_deep_as_it_goes(tmp_path, depth):
    path = tmp_path / "s.json"
    taps = {"class": "Taps", "fields": {"x": 0, "taps": None, "gain_unit": ""}}
    write(path, {"blocks": [*chain(1)["blocks"], taps], "outputs": {"y": 1}})
    path.write_text(
        path.read_text().replace('"taps": null', '"taps": ' + "[" * depth + "]" * depth)
    )
    refused(SceneFileError, "taps must be numbers|not JSON", load, path)


@pytest.mark.parametrize("key", ["b", "k" * 100])
def test_a_key_that_is_there_twice_is_refused(tmp_path, key):
    """JSON says nothing of it, and Python would take the last without a word."""
    (tmp_path / "s.json").write_text(json.dumps({key: 1, "c": 2, "a": 3})[:-1] + f', "{key}": 4}}')
    refused(SceneFileError, f"s.json.*'{key[:40]}.*there twice", load, tmp_path / "s.json")


ODD = [
    None,
    True,
    -1,
    0,
    3,
    0.5,
    -0.0,
    1e308,
    5e-324,
    10**400,
    -(10**400),
    2**64,
    "",
    "a",
    "mm",
    "m/0",
    "\0",
    "\ud800",
    "a" * 1000,
    [],
    {},
    {"a": 1},
    [[]],
    [1, 2],
    [2, 1],
    ["1"],
    ["a", 1],
    [None],
    [True],
    [10**400],
    [[1, 2], [3]],
    [[1, 2], [3, 4]],
    [[[1]]],
    [1e308, -1e308],
    [0, 0],
    list(range(99)),
    [[0, 1], [1, 2]],
]


@pytest.mark.filterwarnings("ignore:overflow")
@pytest.mark.parametrize("name", sorted(EACH))
def test_any_json_in_any_field_is_a_scene_or_an_error_of_ours(name):
    """Floats for whole numbers, text for numbers, rows of several lengths, numbers
    beyond floats.
    """
    data = EACH[name].scene().to_dict()
    entry = (
        next(b for b in data["blocks"] if b["class"] == name)
        if name != "Guard"
        else data["blocks"][-1]
    )
    for place, (field, kept) in enumerate(entry["fields"].items()):
        for value in ODD if STRESS else ODD[(place + len(name)) % 4 :: 4]:
            entry["fields"][field] = value
            try:
                assert Scene.from_dict(json.loads(json.dumps(data))).hash
            except StimlibError as e:
                assert len(str(e)) < 1000
        entry["fields"][field] = kept


@pytest.mark.parametrize("name", ["a" * 101, "\ud800", "a\0", "a b", "", "\x1b[31m", "a\n"])
def test_names_that_are_none(name):
    for make in (lambda: Input(name), lambda: Param(name, 1.0), lambda: Scene({name: x})):
        error = refused(StimlibError, "name", make)
        assert str(error).isprintable() and len(str(error)) < 200
    assert Scene({"é" * 100: Input("größe")})


def test_a_scene_is_lowered_once_and_again_when_its_outputs_change():
    scene = stimlib.Scene({"y": 2 * stimlib.Input("x")})
    assert (
        stimlib.compile(scene, 1000).program
        is scene.program
        is stimlib.compile(scene, 8000, "python").program
    )
    for k in range(2, 9):  # one may lie where the one before was
        scene.outputs["z"] = k * x
        proc = stimlib.compile(scene, 1000, "python")
        assert proc.process(np.ones((1, 1))).tolist() == [[2.0], [k]]
        del scene.outputs["z"]


def test_names_without_any_effect_are_renamed_and_kept_apart():
    """A literal 0 leaves no parameter, and a gate with nothing in it no input."""

    def made(value, unit):
        gone = blocks.enabled(constant(0.0), by=Input("h", unit)) * Param("p", value, unit)
        return Scene({"y": x, "z": gone + 0 * Param("q", value, unit)})

    scene = made(2.0, "m")
    proc = stimlib.compile(scene, 1000, "python")
    assert (proc.inputs, list(proc.params)) == (("x",), [])
    other = scene.renamed({"p": "p_2", "q": "q_2"}, {"h": "h_2"}, {"y": "u", "z": "v"})
    assert list(Scene(made(3.0, "N").outputs | other.outputs).outputs) == ["y", "z", "u", "v"]
    assert list(Scene.combine(a=scene, b=made(3.0, "N")).inputs) == ["a_x", "a_h", "b_x", "b_h"]
