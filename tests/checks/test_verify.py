"""The verifier on renderings, on files and on recorded hands."""

import dataclasses as dc
import hashlib
import html
import json
import re

import numpy as np
import pytest
import soundfile as sf
from commands import ran
from hands import RECORDINGS, hand
from laws import mostly
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, SinkError, blocks
from stimlib.checks import verification, verify_log
from stimlib.devices import NullSink
from stimlib.files import audio as file, read_log
from stimlib.motion import minimum_jerk, ramp_and_hold, sinusoid
from stimlib.run import Safety

MOTION = {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.01)}


def write(path, scene, motion, seconds=1.0, seed=0, params=None, **words):
    proc = stimlib.compile(scene, 8000, seed=seed)
    for name, value in (params or {}).items():
        proc.set(name, value, ramp=0.0)
    file.write(path, proc, motion, seconds, progress=False, **words)
    return path


@pytest.mark.parametrize("name", mostly(["grip trial", "puck"], RECORDINGS))
def test_recorded_hands_are_rendered_and_proved(name, tmp_path):
    recorded = hand(name)
    scene = stimlib.scenes.squeeze(contact="grip" not in name)
    motion = recorded.motion_for(tuple(scene.inputs))
    report = stimlib.verify(
        scene, motion, write(tmp_path / "hand.wav", scene, motion, recorded.duration, seed=3)
    )
    assert report.passed, str(report)
    assert any("reports at" in text for text in report.evidence.skipped)
    assert {"a1", "a2", "b", "c", "d", "e", "f"} == {c.group for c in report.checks}


def test_one_changed_sample_is_seen(tmp_path):
    """By the hash of the file; and by the samples, where that was made again."""
    scene = stimlib.scenes.squeeze()
    path = write(tmp_path / "a.w64", scene, MOTION, subtype="DOUBLE")
    y, fs = sf.read(path, always_2d=True)
    y[4321, 1] = np.nextafter(y[4321, 1], 1.0)
    sf.write(path, y, fs, subtype="DOUBLE", format="W64")
    refused(SinkError, "changed", stimlib.verify, scene, MOTION, path)
    sidecar = json.loads((tmp_path / "a.w64.json").read_text())
    sidecar["file_sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    (tmp_path / "a.w64.json").write_text(json.dumps(sidecar))
    bad = [c for c in stimlib.verify(scene, MOTION, path).checks if not c.passed]
    assert [(c.group, c.measured) for c in bad] == [("b", 1.0)]


def test_a_rendering_of_something_else_is_refused(tmp_path):
    scene, other = stimlib.scenes.squeeze(), stimlib.scenes.squeeze(k=2001.0)
    path = write(tmp_path / "a.wav", scene, MOTION, 0.1)
    r = stimlib.render(scene, MOTION, 8000, 0.1)
    none = stimlib.render(scene, {n: np.zeros(1) for n in MOTION}, 8000)
    for says, *given in (
        ("another scene", other, MOTION, path),
        ("another scene", other, MOTION, r),
        ("the scene's outputs", scene, MOTION, dc.replace(r, outputs=r.outputs[::-1])),
        ("the scene's outputs", scene, MOTION, dc.replace(r, y=r.y[:1])),
        ("the scene's outputs", scene, MOTION, dc.replace(r, y=r.y.astype(np.float32))),
        ("no sample", scene, MOTION, dc.replace(none, y=none.y[:, :0])),
    ):
        refused(BadValue, says, stimlib.verify, *given)
    assert not stimlib.verify(scene, MOTION | {"x1": minimum_jerk(depth=0.019)}, path).passed


def test_a_file_alone_tells_its_scene_and_motion(tmp_path):
    scene = stimlib.scenes.squeeze()
    made = stimlib.render(scene, MOTION, 8000, 0.2)
    made.save(path := tmp_path / "a.wav", full_scale=50.0)
    for given in ((path,), (str(path),), (None, MOTION, path), (scene, None, path)):
        report = stimlib.verify(*given)
        skipped = "; ".join(report.evidence.skipped)
        assert report.passed and "for the reader only" not in skipped  # written by this version
        assert ("scene in the sidecar only" in skipped) == (given[0] is not scene)
    sidecar = path.with_name("a.wav.json")
    sidecar.write_text(
        sidecar.read_text().replace(f'"stimlib": "{stimlib.__version__}"', '"stimlib": "0.0.9"')
    )
    assert "written by stimlib 0.0.9" in "; ".join(stimlib.verify(path).evidence.skipped)
    for wrong in (
        (scene,),
        (made,),
        (scene, MOTION),
        (scene, None, made),
        (None, MOTION, made),
        ("squeeze", MOTION, path),
    ):
        refused(BadValue, "path of a file alone", stimlib.verify, *wrong)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("log of P01.stimlog", "verify the log instead"),
        ("array of 800 samples", "cannot be made again .*give the motion"),
    ],
)
def test_motion_that_no_text_makes_again_is_asked_for(tmp_path, text, says):
    path = write(tmp_path / "a.wav", stimlib.scenes.wall(), {"x": sinusoid(0.002, 5.0)}, 0.1)
    told = json.loads((tmp_path / "a.wav.json").read_text()) | {"motion": {"x": text}}
    (tmp_path / "a.wav.json").write_text(json.dumps(told))
    refused(BadValue, says, stimlib.verify, path)


def test_a_file_that_began_in_the_middle_is_refused(tmp_path):
    scene = stimlib.scenes.squeeze()
    proc = stimlib.compile(scene, 8000)
    proc.process(np.zeros((2, 10)))
    file.write(tmp_path / "a.wav", proc, MOTION, 0.1, progress=False)
    refused(BadValue, "begin at sample 0", stimlib.verify, scene, MOTION, tmp_path / "a.wav")


def changed(folder, params, seed):
    """A rendering, a file and the log of one scene, with parameters that move."""
    scene, motion = stimlib.Scene({"y": stimlib.Param("g", 2.0) * stimlib.Input("x")}), np.ones(800)
    rendering = stimlib.render(scene, {"x": motion}, 8000, params=params, seed=seed)
    rendering.save(folder / "a.wav", subtype="DOUBLE", full_scale=50.0)
    words = {"clocked": False, "seed": seed, "log": folder / "a.stimlog"}
    with NullSink(scene, Safety(50.0), motion={"x": sinusoid(1.0, 3.0)}, **words) as sink:
        sink.open(8000)
        for name, value in params.items():
            sink.set(name, value, ramp=0.0)
        sink.start(0.1)
        sink.wait()
    log = read_log(folder / "a.stimlog")
    yield lambda **words: stimlib.verify(scene, {"x": motion}, rendering, **words)
    yield lambda **words: stimlib.verify(scene, {"x": motion}, folder / "a.wav", **words)
    yield lambda **words: verify_log(log, scene, **words)


@pytest.mark.parametrize(
    ("params", "seed", "stated", "wrong"),
    [
        ({"g": 3.0}, 7, {"params": {"g": 3.0}, "seed": 7}, ""),
        ({"g": 3.0}, 7, {"params": {}}, "g = 3 for 2"),
        ({"g": 3.0}, 7, {"params": {"g": 3.0001}, "seed": 8}, "seed = 7 for 8; g = 3 for 3.0001"),
        ({}, 0, {"params": {"g": 2.0}, "seed": 0}, ""),
        ({}, 0, {}, ""),
    ],
)
def test_parameters_that_are_not_the_scenes_are_named_first(params, seed, stated, wrong, tmp_path):
    """And refused where others were stated, in the table, the page and the JSON."""
    for verify in changed(tmp_path, params, seed):
        report = verify(**stated)
        first, told = report.checks[0], report.to_dict()
        assert report.passed is (not wrong)
        assert told["differences"] == ["g = 3 (in the scene 2)"] * bool(params)
        for text in (str(report).partition("┏")[0], report.what()):
            assert ("g = 3" in text) is bool(params) and f"seed {seed}" in text
        if stated:
            assert first.name == "parameters and seed: as they were stated"
            assert first.text == (wrong or "that differ")


def test_a_parameter_that_moves_is_not_the_one_that_was_stated(tmp_path):
    scene = stimlib.Scene({"y": stimlib.Param("g", 2.0) * stimlib.Input("x")})
    proc = stimlib.compile(scene, 8000)
    proc.set("g", 3.0, ramp=0.01)
    file.write(tmp_path / "a.wav", proc, {"x": sinusoid(1.0, 3.0)}, 0.1, progress=False)
    for params in ({"g": 2.0}, {"g": 3.0}):
        report = stimlib.verify(scene, {"x": sinusoid(1.0, 3.0)}, tmp_path / "a.wav", params=params)
        assert not report.passed and "g to 3 at 0 s within 0.01 s" in report.what()
        assert report.evidence.params == {"g": 2.0}, "from where the ramp begins"


def test_the_command_line_states_parameters_and_seed(tmp_path):
    write(
        tmp_path / "a.wav", stimlib.scenes.wall(), {"x": sinusoid(0.002, 5.0)}, 0.1, 4, {"k": 9.0}
    )
    for words, code in (("", 0), ("--set k=9 --seed 4", 0), ("--set k=8", 1), ("--seed 0", 1)):
        done = ran(["verify", tmp_path / "a.wav", *words.split()], code)
        assert "k = 9 (in the scene" in done.output


def test_the_page_is_whole_and_the_same_each_time(tmp_path, monkeypatch, capsys):
    scene, motion = stimlib.scenes.squeeze(fingers=1), {"x1": MOTION["x1"]}
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, 0.4))
    for name in ("a.html", "b.html"):
        report.to_html(tmp_path / name, command="stimlib verify squeeze --wav <a>.wav")
    page = (tmp_path / "a.html").read_text("utf-8")
    assert page == (tmp_path / "b.html").read_text("utf-8")
    # nothing from elsewhere; no code
    assert not re.search(r'(src|href)="(?!#)', page) and "<script" not in page
    # for a telephone too; pictures first, and each with a name
    assert '<meta name="viewport" content="width=device-width,initial-scale=1">' in page
    assert page.count("<svg") == page.count('<svg role="img" aria-label="') > 0
    assert page.index("<svg") < page.index("What was compared")
    for word in (
        "passed",
        "over position, x1",
        "noise in force1 before gate",
        "&lt;a&gt;.wav",
        scene.hash,
        "minimum_jerk(depth=0.02",
        "<td>force1: spectrum</td><td>level</td>",
        "F = k x + A level (k tau v)(tau dp/dt)",
        f"numpy {np.__version__}",
        "<code>proof\\Scripts\\activate</code>",
    ):
        assert word in page
    install, program, text = (
        html.unescape(part) for part in re.findall("<pre>(.*?)</pre>", page, re.DOTALL)
    )
    assert install.startswith("python -m venv proof\n")
    assert f" stimlib=={stimlib.__version__} numpy=={np.__version__} " in install
    assert "sidecar" not in page  # what is in memory has none
    (tmp_path / "scene.json").write_text(text)
    monkeypatch.chdir(tmp_path)
    exec(program, {})
    # the hash of the signal, made again
    assert capsys.readouterr().out.strip() == program.split("# ")[-1].strip()
    assert not list(tmp_path.glob("*.part"))


def test_a_disk_that_is_full_costs_the_page_alone(tmp_path, mounted):
    plain = stimlib.render(Scene({"y": 2 * Input("x")}), {"x": ramp_and_hold(1, 1)}, 8000, 0.1)
    plain.save(tmp_path / "a.wav", full_scale=1.0)
    page = mounted("size=4k") / "a.html"
    done = ran(["verify", tmp_path / "a.wav", "--report", page], 2, "cannot write")
    assert "No space" in done.stderr
    assert ": passed" in done.stdout and not list(page.parent.iterdir())


def test_the_fault_that_a_rendering_tells_is_held():
    scene, whole, broken = (
        Scene({"y": 1 / Input("x")}),
        {"x": np.ones(900)},
        {"x": np.r_[np.ones(800), np.zeros(100)]},
    )
    told = [None, ("y", 800), ("y", 801), ("z", 800), "y\x1b[2J"]
    for motion, fault, said in (
        (whole, None, "guards that closed; the rendering tells "),
        (broken, ("y", 800), "y at sample 800; the rendering tells "),
    ):
        made = stimlib.render(scene, motion, 8000, on_fault="ignore")
        assert made.fault == fault
        for t in told:
            report = stimlib.verify(scene, motion, dc.replace(made, fault=t))
            (check,) = [c for c in report.checks if c.name == "no fault"]
            assert check.text.startswith(said) == (t != fault) and "\x1b" not in check.text
            assert check.passed == report.passed == (fault is t is None)


def test_an_interpreter_that_says_otherwise_in_one_bit_is_seen(monkeypatch):
    def other(proc, *words):
        y = samples(proc, *words)
        if proc.target == "python":
            y[0, -1] = np.nextafter(y[0, -1], 9.0)
        return y

    samples = verification.samples
    scene, motion = stimlib.scenes.bumps(), {"x": minimum_jerk()}
    rendering = stimlib.render(scene, motion, 8000, 0.1)
    monkeypatch.setattr(verification, "samples", other)
    failed = [c for c in stimlib.verify(scene, motion, rendering).checks if not c.passed]
    assert [(c.measured, c.name.split(",")[0]) for c in failed] == [(1, "interpreter")]


@pytest.mark.parametrize("seed", range(3))
def test_of_many_channels_the_interpreter_makes_some_again_and_each_kind_of_block(seed):
    """From a state of their own, with the parameters and inputs that they have."""
    x, y, k = Input("x"), Input("y"), Param("k", 1.0)
    scene = Scene({f"a{n}": blocks.delay(float(n) * x, 3) for n in range(20)} | {"b": abs(k * y)})
    made = stimlib.render(scene, {"x": np.sin, "y": np.cos}, 8000, 0.1, {"k": 2.0}, seed)
    report = stimlib.verify(scene, {"x": np.sin, "y": np.cos}, made)
    drawn = verification._drawn(report.evidence)
    assert "b" in drawn and len(drawn) == 9 and report.passed
    assert [c for c in report.checks if c.name.endswith("from 0 of 9 of 21 outputs")]
    made.y[0, 5] += 1e-300  # of whichever output
    assert not stimlib.verify(scene, {"x": np.sin, "y": np.cos}, made).passed


@pytest.mark.parametrize("size", [800, 100])
@pytest.mark.parametrize("seed", range(3))
def test_the_interpreter_begins_before_a_gate_of_what_was_drawn_opens(seed, size, monkeypatch):
    """In the first of the stretches that a recording is verified in, or a later one."""
    monkeypatch.setattr("stimlib.checks.evidence.at_once", lambda scene: size)
    monkeypatch.setattr("stimlib.checks.evidence.LATER", size)
    x = Input("x")
    gated = [blocks.enabled(blocks.white_noise(k), by=x > float(k)) for k in range(20)]
    scene, motion = Scene({f"a{k}": y for k, y in enumerate(gated)}), {"x": lambda t: 200.0 * t}
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, 0.1, seed=seed))
    drawn = [int(name[1:]) for name in verification._drawn(report.evidence)]
    (name,) = (c.name for c in report.checks if c.name.startswith("interpreter"))
    opens = int(np.argmax(np.arange(800) / 40 > drawn[0]))
    start = max(opens - opens % size, opens - 16)
    assert drawn == sorted(drawn) and report.passed and report.evidence.at == 0
    assert name.endswith(f" from {start} of 8 of 20 outputs")
