"""Scene files: what comes back is what was saved, and a file can do nothing but
describe a scene.
"""

import json
import os
import time
from dataclasses import dataclass

import numpy as np
import pytest
from contract import TABLE
from laws import assert_same, rows
from refusals import refused

import stimlib
from stimlib import Input, Param, Scene, blocks, load
from stimlib.core.graph import Block, reach, registry
from stimlib.errors import BadValue, SceneError, SceneFileError, StimlibError
from stimlib.system.fields import strict

x = Input("x")


@pytest.mark.parametrize("entry", TABLE, ids=lambda e: e.name)
def test_a_file_gives_back_the_scene(entry, tmp_path):
    scene = entry.scene()
    scene.save(tmp_path / "scene.json")
    again = load(tmp_path / "scene.json")
    assert again.hash == scene.hash
    assert repr(again) == repr(scene)
    assert again.to_dict() == scene.to_dict()
    fs = entry.rates[0]
    procs = [stimlib.compile(s, fs) for s in (scene, again)]
    u = rows(procs[0], entry.x(100, fs), entry.inputs)
    assert procs[0].inputs == procs[1].inputs
    assert_same(*(p.process(u) for p in procs))
    assert_same(*(p.state for p in procs))
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "scene.json").read_bytes()


def test_numbers_come_back_to_the_last_bit(tmp_path):
    taps = np.random.default_rng(0).standard_normal(50) * 10.0 ** np.arange(-25, 25)
    scene = Scene({"y": blocks.fir(x, [*taps, 5e-324, -0.0, 1.7976931348623157e308])})
    scene.save(tmp_path / "s.json")
    (block,) = load(tmp_path / "s.json").outputs.values()
    assert_same(block.taps, scene.outputs["y"].taps)


def test_seeds_of_64_bits_come_back(tmp_path):
    Scene({"y": blocks.white_noise(2**64 - 1)}).save(tmp_path / "s.json")
    assert load(tmp_path / "s.json").outputs["y"].seed == 2**64 - 1


def test_shared_parts_stay_shared(tmp_path):
    noise = blocks.white_noise(1)
    Scene({"y": noise + x, "z": noise * x}).save(tmp_path / "s.json")
    again = load(tmp_path / "s.json")
    assert again.outputs["y"].a is again.outputs["z"].a


def test_a_callable_is_sampled_when_built(tmp_path):
    Scene({"y": blocks.lut(x, [0.0, 1.0, 2.0], lambda k: k**2)}).save(tmp_path / "s.json")
    np.testing.assert_array_equal(load(tmp_path / "s.json").outputs["y"].values, [0, 1, 4])


def test_hash_tells_scenes_apart():
    hashes = {
        Scene({"y": b}).hash
        for b in (
            x,
            2 * x,
            x * 2,
            -x,
            blocks.delay(x, 1),
            blocks.delay(x, 2),
            Param("x", 1.0),
            Input("z"),
        )
    }
    assert len(hashes) == 8
    assert Scene({"y": x}).hash == Scene({"y": Input("x")}).hash
    assert Scene({"y": x, "z": 2 * x}).hash != Scene({"y": x, "w": 2 * x}).hash


# Files that are not scenes ------------------------------------------------------------
@pytest.fixture
def edited(tmp_path):
    """Load a scene file after a change to its data."""

    def change(f, scene=None):
        data = (
            scene or Scene({"y": blocks.velocity(x, 30.0) * blocks.fir(x, [1.0, 2.0])})
        ).to_dict()
        path = tmp_path / "edited.json"
        path.write_text(json.dumps(f(data) or data))
        return load(path)

    return change


def first(data, name):
    return next(b for b in data["blocks"] if b["class"] == name)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(stimlib_scene=99), ["99", "update"]),
        (lambda d: d.update(stimlib_scene="1"), ["version"]),
        (lambda d: d.update(stimlib_scene=True), ["version"]),
        (lambda d: d.update(law=3), ["law must be a name"]),
        (
            lambda d: first(d, "Velocity").update({"class": "Teleport"}),
            ["Teleport", "not known", "update"],
        ),
        (
            lambda d: first(d, "Velocity").update({"class": "lab.blocks.Mine"}),
            ["lab.blocks.Mine", "import lab.blocks"],
        ),
        (lambda d: first(d, "Velocity")["fields"].pop("cutoff"), ["Velocity", "cutoff"]),
        (lambda d: first(d, "Velocity")["fields"].update(mass=3), ["Velocity", "mass"]),
        (lambda d: first(d, "Velocity")["fields"].update(x=99), ["99", "earlier block"]),
        (
            lambda d: first(d, "Velocity")["fields"].update(x=len(d["blocks"]) - 1),
            ["earlier block"],
        ),
        (lambda d: first(d, "Velocity")["fields"].update(x=-1), ["earlier block"]),
        (lambda d: first(d, "Velocity")["fields"].update(x=True), ["earlier block"]),
        (lambda d: first(d, "Velocity")["fields"].update(x="x"), ["earlier block"]),
        (lambda d: first(d, "Velocity")["fields"].update(x=None), ["earlier block"]),
        (lambda d: first(d, "Velocity")["fields"].update(cutoff=-1.0), ["cutoff"]),
        (lambda d: first(d, "Velocity")["fields"].update(cutoff="fast"), ["cutoff", "Velocity"]),
        (lambda d: first(d, "Velocity")["fields"].update(cutoff={"a": 1}), ["cutoff", "Velocity"]),
        (lambda d: first(d, "Velocity")["fields"].update(cutoff=None), ["Velocity"]),
        (lambda d: first(d, "Velocity")["fields"].update(cutoff=[1.0]), ["Velocity"]),
        (lambda d: first(d, "Taps")["fields"].update(taps=["a"]), ["Taps"]),
        (lambda d: first(d, "Taps")["fields"].update(taps=5.0), ["taps"]),
        (lambda d: first(d, "Taps")["fields"].update(taps=[[1], [2, 3]]), ["Taps"]),
        (lambda d: first(d, "Taps")["fields"].update(gain_unit="mm"), ["Taps", "mm"]),
        (lambda d: first(d, "Taps")["fields"].update(gain_unit=3), ["Taps"]),
        (lambda d: first(d, "Input")["fields"].update(name=7), ["Input"]),
        (lambda d: first(d, "Input")["fields"].update(name="__import__('os')"), ["Input"]),
        (lambda d: d["blocks"].append(3), ["class and fields"]),
        (lambda d: d["blocks"].append({"class": "Neg"}), ["class and fields"]),
        (lambda d: d["blocks"].append({"class": "Block", "fields": {}}), ["Block"]),
        (lambda d: d["blocks"].append({"class": "Map", "fields": {}}), ["Map"]),
        (lambda d: d.update(outputs={"y": 99}), ["'y'", "99"]),
        (lambda d: d.update(outputs=[1]), ["outputs"]),
        (lambda d: d.update(blocks={}), ["blocks"]),
        (lambda d: d.update(outputs={}), ["output"]),
        (lambda d: [1, 2], ["not a stimlib scene"]),
        (lambda d: {"a": 1}, ["not a stimlib scene"]),
        (lambda d: 3, ["not a stimlib scene"]),
    ],
)
def test_a_changed_file_is_an_error_that_says_where(edited, change, words):
    def f(data):
        new = change(data)
        return new if isinstance(new, (list, dict, int)) and new in ([1, 2], {"a": 1}, 3) else None

    error = refused(SceneError, None, edited, f)
    assert all(w in str(error) for w in words), error


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "nonsense",
        '{"stimlib_scene": 1, "blocks": [NaN]}',
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


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_in_a_file_are_finite(tmp_path, number):
    path = tmp_path / "s.json"
    Scene({"y": 123456.0 * x}).save(path)
    path.write_text(path.read_text().replace("123456.0", number))
    refused(SceneFileError, "finite", load, path)


def test_missing_and_unwritable(tmp_path):
    refused(SceneFileError, "No such file", load, tmp_path / "missing.json")
    refused(SceneFileError, "cannot read", load, tmp_path)
    refused(SceneFileError, "No such file", Scene({"y": x}).save, tmp_path / "no" / "where.json")
    (tmp_path / "folder").mkdir()
    refused(SceneFileError, "cannot write", Scene({"y": x}).save, tmp_path / "folder")
    assert [p.name for p in tmp_path.iterdir()] == ["folder"], "no half file is left"


def test_a_save_replaces_the_whole_file(tmp_path):
    path = tmp_path / "s.json"
    path.write_text("old" * 100_000)
    Scene({"y": x}).save(path)
    assert load(path).hash == Scene({"y": x}).hash
    assert [p.name for p in tmp_path.iterdir()] == ["s.json"]


# Blocks of users, and nothing that runs -----------------------------------------------
@dataclass(frozen=True, eq=False)
class Doubled(Block):
    x: Block

    @staticmethod
    def step(p, s, x):
        return x + x, s


def test_a_user_block_loads_where_it_is_imported(tmp_path):
    scene = Scene({"y": Doubled(x)})
    scene.save(tmp_path / "s.json")
    again = load(tmp_path / "s.json")
    assert isinstance(again.outputs["y"], Doubled)
    name = f"{__name__}.Doubled"
    kept = registry.pop(name)
    try:
        refused(
            SceneFileError,
            f"import {__name__} first; on the command line, add --import ",
            load,
            tmp_path / "s.json",
        )
        remedies = {
            "__main__": "a script or a notebook defined",
            "lab": "--import lab.py$",
            "lab.a": "a file .* imports lab.a$",
        }
        for module, says in remedies.items():
            text = (tmp_path / "s.json").read_text().replace(f'"{name}"', f'"{module}.Doubled"')
            (tmp_path / "t.json").write_text(text)
            refused(SceneFileError, says, load, tmp_path / "t.json")
    finally:
        registry[name] = kept


def test_loading_executes_nothing(edited, tmp_path):
    """Names of functions, modules and methods in the place of classes and fields stay
    text.
    """
    mark = tmp_path / "mark"
    code = f"__import__('pathlib').Path({str(mark)!r}).touch()"
    for name in (
        "os.system",
        "builtins.eval",
        "eval",
        "subprocess.Popen",
        "stimlib.core.graph.Mul",
        "__main__.x",
        code,
    ):
        refused(
            SceneFileError,
            None,
            edited,
            lambda d, name=name: first(d, "Velocity").update({"class": name}),
        )
        refused(
            SceneFileError,
            None,
            edited,
            lambda d, name=name: first(d, "Taps")["fields"].update(gain_unit=name),
        )
    assert not mark.exists()
    assert "antigravity" not in __import__("sys").modules
    refused(
        SceneFileError,
        None,
        edited,
        lambda d: first(d, "Velocity").update({"class": "antigravity.Block"}),
    )
    assert "antigravity" not in __import__("sys").modules


def test_a_law_travels_with_the_scene(tmp_path):
    stimlib.scenes.squeeze(fingers=1).save(tmp_path / "s.json")
    assert [p.law for p in load(tmp_path / "s.json").parts] == ["squeeze"]


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


def test_gates_in_gates_are_refused_quickly(tmp_path):
    """Eighteen levels, 1.5 kB: they took half a minute and 862 MiB."""
    data = {
        "blocks": [{"class": "Param", "fields": {"name": "p", "value": 1.0, "unit": ""}}],
        "outputs": {"y": 19},
    }
    data["blocks"].append({"class": "Neg", "fields": {"x": 0}})
    data["blocks"] += [{"class": "Enabled", "fields": {"block": i, "by": i}} for i in range(1, 19)]
    before = time.process_time()
    refused(
        SceneError,
        "copies: 786431 is more than limits.scene_blocks = 100000",
        load,
        write(tmp_path / "s.json", data),
    )
    took = time.process_time() - before
    stimlib.scenes.squeeze()
    before = time.process_time()
    for _ in range(50):
        stimlib.scenes.squeeze()
    assert took < 10 * (time.process_time() - before), "work of the order of a few scenes"


@pytest.mark.parametrize("hidden", [False, True])
def test_a_million_blocks_are_refused_before_they_are_read(tmp_path, hidden):
    # the same word in other letters
    word, blocks = ("cl\\u0061ss", 100_001) if hidden else ("class", 1_000_000)
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
        error = refused(SceneFileError, "cannot read", load, path)
        assert str(error).isprintable()
        refused(SceneFileError, "cannot write", Scene({"y": x}).save, path)


def test_a_planted_link_is_not_followed(tmp_path):
    target = tmp_path / "precious"
    target.write_text("kept")
    (tmp_path / "s.json.part").symlink_to(target)
    refused(
        SceneFileError,
        "s.json.part: it is there already and is a link",
        Scene({"y": x}).save,
        tmp_path / "s.json",
    )
    assert target.read_text() == "kept" and not (tmp_path / "s.json").exists()


@pytest.mark.parametrize("depth", [1000, 100_000, 1_000_000])
def test_json_as_deep_as_it_goes(tmp_path, depth):
    path = tmp_path / "s.json"
    taps = {"class": "Taps", "fields": {"x": 0, "taps": None, "gain_unit": ""}}
    write(path, {"blocks": [*chain(1)["blocks"], taps], "outputs": {"y": 1}})
    path.write_text(
        path.read_text().replace('"taps": null', '"taps": ' + "[" * depth + "]" * depth)
    )
    refused(SceneFileError, "taps must be numbers|not JSON", load, path)


def test_a_key_that_is_there_twice_is_refused(tmp_path):
    """JSON says nothing of it, and Python would take the last without a word."""
    path = tmp_path / "s.json"
    Scene({"y": 2 * Input("x")}).save(path)
    assert load(path).outputs
    path.write_text(path.read_text().replace('"class":', '"class": "Taps", "class":', 1))
    refused(SceneFileError, "s.json.*'class' is there twice in one object; keep one", load, path)


@pytest.mark.parametrize("key", ["b", "k" * 100])
def test_of_many_keys_the_one_that_is_there_twice_is_named(key):
    text = json.dumps({key: 1, "c": 2, "a": 3})[:-1] + f', "{key}": 4}}'
    refused(ValueError, f"'{key[:40]}' is there twice", strict, text)


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
@pytest.mark.parametrize("name", sorted({e.cls for e in TABLE}))
def test_any_json_in_any_field_is_a_scene_or_an_error_of_ours(name):
    """Floats for whole numbers, text for numbers, rows of several lengths, numbers
    beyond floats.
    """
    data = next(e for e in TABLE if e.cls == name).scene().to_dict()
    entry = (
        next(b for b in data["blocks"] if b["class"] == name)
        if name != "Guard"
        else data["blocks"][-1]
    )
    for field, kept in entry["fields"].items():
        for value in ODD:
            entry["fields"][field] = value
            try:
                assert Scene.from_dict(json.loads(json.dumps(data))).hash
            except StimlibError as e:
                assert len(str(e)) < 1000
        entry["fields"][field] = kept


@pytest.mark.parametrize(
    "value", [["1.5"], [True], [None], [10**400], [[1, 2], [3]], 10**400, [1j], np.array([1 + 1j])]
)
def test_an_array_has_real_numbers(value):
    refused(BadValue, "taps", blocks.fir, x, value)


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
    scene.outputs["z"] = 3 * stimlib.Input("x")
    assert stimlib.compile(scene, 1000).outputs == ("y", "z")


def test_nested_gates_are_refused_before_their_copies_are_counted(monkeypatch):
    y = blocks.oscillator(10.0)
    for k in range(8):
        y = y + blocks.enabled(y, by=blocks.oscillator(1.0 + k) > 0.0)
    monkeypatch.setattr(stimlib.limits, "scene_blocks", 100)
    refused(SceneError, "own copies: 120 is more than limits.scene_blocks", Scene, {"y": y})
