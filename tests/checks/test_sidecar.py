"""What a file and a log say of themselves: every key edited, with all hashes that an
editor can make again; storage too coarse.
"""

import hashlib
import json

import numpy as np
import pytest
import soundfile as sf
from logged import play

import stimlib
from stimlib import Input, Param, Scene, StimlibError, constant
from stimlib.checks import sidecar as checked, verify_log
from stimlib.files import audio as file
from stimlib.files.log_reader import FIELDS, read_log
from stimlib.motion import minimum_jerk
from stimlib.run.safety import GAIN, Safety
from stimlib.scenes import squeeze


def channel(k, **what):
    return lambda d: d["channels"][k].update(what)


def swap_names(d):
    a, b = d["channels"]
    a["name"], b["name"] = b["name"], a["name"]


def other_k(d):
    next(b for b in d["scene"]["blocks"] if b["fields"].get("name") == "k")["fields"]["value"] = (
        1000.0
    )


EDITS = {
    "a key of a channel more": lambda d: d["channels"][0].update(gain=2.0),
    "clips not counted": lambda d: d["channels"][0].update(clips=None),
    "format": lambda d: d.update(format="RF64"),
    "subtype": lambda d: d.update(subtype="DOUBLE"),
    "fs": lambda d: d.update(fs=8001.0),
    "frames": lambda d: d.update(frames=1999),
    "channel names": swap_names,
    "unit": channel(0, unit="mN"),
    "full scale": channel(1, full_scale=2.0),
    "clips": channel(1, clips=1),
    "clips moved": lambda d: (d["channels"][0].update(clips=1), d["channels"][1].update(clips=-1)),
    "peak": lambda d: d["channels"][0].update(peak=10 * d["channels"][0]["peak"]),
    "peak by a bit": (
        lambda d: d["channels"][1].update(peak=float(np.nextafter(d["channels"][1]["peak"], 0)))
    ),
    "seed": lambda d: d.update(seed=4),
    "params": lambda d: d["params"].update(k=1700.0),
    "params, one more": lambda d: d["params"].update(b=1.0),
    "index": lambda d: d.update(index=1),
    "log, value": lambda d: d["log"][0].update(value=1801.0),
    "log, ramp": lambda d: d["log"][0].update(ramp=0.1),
    "log, at": lambda d: d["log"][0].update(at=100),
    "log, lost": lambda d: d.update(log=[]),
    "log, one more, late": (
        lambda d: d["log"].append({"at": 5, "name": "k", "value": 1800.0, "ramp": 0.0})
    ),
    "motion, an input less": lambda d: d["motion"].pop("x2"),
    "scene, k": other_k,
    "scene, law": lambda d: d["scene"].update(law=None),
    "scene_hash": lambda d: d.update(scene_hash="0" * 64),
    "definitions, of no block": lambda d: d.update(
        definitions={"click_block": {"sha256": "0" * 64, "text": ""}}
    ),
    "sha256": lambda d: d.update(sha256="0" * 64),
    "sha256, none": lambda d: d.update(sha256=None),
    "a key more": lambda d: d.update(calibrated=True),
}
MOTION = {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.01)}


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    """Bytes and sidecar of a correct file."""
    path = tmp_path_factory.mktemp("honest") / "honest.wav"
    proc = stimlib.compile(squeeze(), 8000, seed=3)
    proc.set("k", 1800.0, ramp=0.0)
    file.write(path, proc, MOTION, 0.25, progress=False)
    return path.read_bytes(), json.loads(path.with_name("honest.wav.json").read_text())


def verified(folder, audio, told):
    """The report of a file with this sidecar, whose hash of the file is made again."""
    (folder / "a.wav").write_bytes(audio)
    told = told | {"file_sha256": hashlib.sha256(audio).hexdigest()}
    (folder / "a.wav.json").write_text(json.dumps(told))
    return stimlib.verify(squeeze(), MOTION, folder / "a.wav")


def passes(verify, *given):
    try:
        return verify(*given).passed
    except StimlibError:
        return False


TOLD = {
    "stimlib": lambda d: d.update(stimlib="9.9\x1b[31m"),
    "versions": lambda d: d["versions"].update(numpy="0.1"),
    "motion, its words": lambda d: d["motion"].update(x1="minimum_jerk(depth=1 km)"),
    "motion_read": lambda d: d.update(motion_read={"x1": ["1 km skipped"]}),
}  # fmt: skip


@pytest.mark.parametrize("edit", [*EDITS, *TOLD])
def test_every_key_is_held_or_stated_as_told(honest, tmp_path, edit):
    audio, told = honest
    told = json.loads(json.dumps(told))
    (EDITS | TOLD)[edit](told)
    if edit in EDITS:
        assert not passes(verified, tmp_path, audio, told)
    else:
        report = verified(tmp_path, audio, told)
        assert report.passed, str(report)
        assert edit == "versions" or any("9.9" in t or "1 km" in t for t in report.evidence.skipped)
        assert "\x1b" not in "".join(report.evidence.skipped)


def test_a_ramp_from_where_a_jump_at_its_sample_ends_is_verified(tmp_path):
    """A file and a log say each setting; the last jump and the last ramp count."""
    steps = [("k", 900.0, 1), ("k", 700.0, 80), ("k", 1500.0, 1), ("k", 1000.0, 80)]
    proc = stimlib.compile(squeeze(), 8000)
    for name, value, frames in [*steps, ("k", 1800.0, 160)]:
        proc.set(name, value, frames / 8000)
    file.write(tmp_path / "a.wav", proc, MOTION, 0.25, progress=False)
    assert stimlib.verify(squeeze(), MOTION, tmp_path / "a.wav").passed
    x = np.array([f(np.arange(2000) / 8000) for f in MOTION.values()])
    sets = [(at, *step) for at in (0, 1000) for step in steps]
    play(tmp_path / "a", squeeze(), Safety(50.0), x, sets=[(0, GAIN, 1.0, 160), *sets])
    assert verify_log(read_log(tmp_path / "a")).passed


def test_there_is_no_key_that_is_neither(honest):
    assert {*honest[1], "motion_read"} == checked.HELD | checked.TOLD


def test_a_file_cut_short_with_its_numbers_adjusted_is_refused_by_the_hash_of_the_signal(
    honest, tmp_path
):
    audio, told = honest
    (tmp_path / "whole.wav").write_bytes(audio)
    y, fs = sf.read(tmp_path / "whole.wav", dtype="float32")
    with sf.SoundFile(tmp_path / "cut.wav", "w", fs, y.ndim, "FLOAT") as cut:
        cut.comment = sf.SoundFile(tmp_path / "whole.wav").comment
        cut.write(y[:1000])
    half = stimlib.render(squeeze(), MOTION, 8000, 0.125, {"k": 1800.0}, 3)
    peaks = [{"peak": float(np.abs(row).max())} for row in half.y]
    channels = [c | peak for c, peak in zip(told["channels"], peaks, strict=True)]
    adjusted = told | {"frames": 1000, "channels": channels}
    report = verified(tmp_path, (tmp_path / "cut.wav").read_bytes(), adjusted)
    assert [c.name for c in report.checks if not c.passed] == ["sidecar: hash of the signal"]


def test_what_no_hash_can_hold_is_said(tmp_path):
    """A file of half a recording is a correct file; the report says that the motion
    went on.
    """
    scene, x, path = Scene({"y": 2 * Input("x")}), np.linspace(0, 1, 8000), tmp_path / "a.wav"
    file.write(path, stimlib.compile(scene, 8000), {"x": x}, 0.5, progress=False)
    report = stimlib.verify(scene, {"x": x}, path)
    assert report.passed and "the file ends 0.5 s before" in "; ".join(report.evidence.skipped)


SCENES = {
    "without a law": (
        Scene({"f": constant(2000.0, "N/m") * Input("x", "m")}),
        {"x": lambda t: 0.01 * np.sin(60 * t)},
    ),
    "with a law": (stimlib.scenes.squeeze(fingers=1), {"x1": minimum_jerk()}),
    "silence": (Scene({"f": Param("a", 0.0) * Input("x")}), {"x": lambda t: t}),
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(
    ("name", "full_scale", "good"),
    [
        ("a.flac", 1e9, False),  # zeros only
        ("a.flac", 1e5, False),  # steps of a hundredth of a newton, as large as the vibration
        ("a.flac", 1e3, True),
        ("a.flac", 30.0, True),  # clipped at three quarters, and so told
        ("a.flac", 1e-6, False),  # a square wave
        ("a.wav", 1.0, True),
        ("a.wav", 1e30, True),
        ("a.wav", 1e60, False),
    ],
)
def test_what_the_storage_cannot_carry_fails(tmp_path, scene, name, full_scale, good):
    stimulus, motion = SCENES[scene]
    proc = stimlib.compile(stimulus, 8000)
    file.write(tmp_path / name, proc, motion, 0.5, progress=False, full_scale=full_scale)
    report = stimlib.verify(stimulus, motion, tmp_path / name)
    passes = scene == "silence" or (scene, full_scale) == ("without a law", 1e5)
    assert report.passed == (good or passes), str(report)
    assert not any(" 1 1;" in check.text for check in report.checks)  # 1 is no unit


# session.json of a log --------------------------------------------------------------
@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    x = np.stack([hand(np.arange(1000) / 8000) for hand in MOTION.values()])
    play(folder / "a", squeeze(), Safety(60.0), x, sets=[(0, GAIN, 1.0, 160)], params={"k": 1500.0})
    return folder / "a"


def other_scene(d):
    d |= {"scene": squeeze(k=2001.0, A=3.5).to_dict(), "scene_hash": squeeze(k=2001.0, A=3.5).hash}


HELD_OF_A_LOG = {
    "scene": other_scene,
    "definitions": lambda d: d.update(
        definitions={"click_block": {"sha256": "0" * 64, "text": ""}}
    ),
    "scene_hash": lambda d: d.update(scene_hash="0" * 64),
    "fs": lambda d: d.update(fs=8001.0),
    "seed": lambda d: d.update(seed=1),
    "params": lambda d: d.update(params={"k": 1500.5}),
    "safety": lambda d: d["safety"].update(full_scale=61.0),
    "inputs": lambda d: d.update(inputs=d["inputs"][::-1]),
    "outputs": lambda d: d.update(outputs=d["outputs"][::-1]),
    "units": lambda d: d["units"].update(force1="mN"),
    "channels": lambda d: d.update(channels=d["channels"][::-1]),
}
TOLD_OF_A_LOG = {
    "stimlib": lambda d: d.update(stimlib="9.9"),
    "versions": lambda d: d["versions"].update(numpy="0.1"),
    "device": lambda d: d.update(device="another"),
    "block": lambda d: d.update(block=1),
    "started": lambda d: d.update(started="yesterday"),
}  # fmt: skip


def test_every_key_is_held_or_told():
    assert HELD_OF_A_LOG.keys() | TOLD_OF_A_LOG.keys() == FIELDS.keys()


@pytest.mark.parametrize("key", [None, *HELD_OF_A_LOG, *TOLD_OF_A_LOG])
def test_an_edited_key_is_refused_or_for_the_reader_only(session, tmp_path, key):
    for path in session.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    told = json.loads((tmp_path / "session.json").read_text())
    if key:
        (HELD_OF_A_LOG | TOLD_OF_A_LOG)[key](told)
    (tmp_path / "session.json").write_text(json.dumps(told))
    assert passes(lambda: verify_log(read_log(tmp_path))) == (key not in HELD_OF_A_LOG)
