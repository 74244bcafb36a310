"""What a file says of itself: every key edited, with all hashes that an editor can make
again; storage too coarse.
"""

import json

import numpy as np
import pytest
import soundfile as sf
from faults import EDITS, FILE_MOTION, honest_file, verified

import stimlib
from stimlib import Input, Param, Scene, StimlibError, constant
from stimlib.checks import sidecar as checked
from stimlib.files import audio as file
from stimlib.motion.generators import minimum_jerk


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    return honest_file(tmp_path_factory.mktemp("honest"))


def refused(*args):
    try:
        return not verified(*args).passed
    except StimlibError:
        return True


TOLD = {
    "stimlib": lambda d: d.update(stimlib="9.9\x1b[31m"),
    "versions": lambda d: d["versions"].update(numpy="0.1"),
    "motion, its words": lambda d: d["motion"].update(x1="minimum_jerk(depth=1 km)"),
}  # fmt: skip


@pytest.mark.parametrize("edit", [*EDITS, *TOLD])
def test_every_key_is_held_or_stated_as_told(honest, tmp_path, edit):
    audio, told = honest
    told = json.loads(json.dumps(told))
    (EDITS | TOLD)[edit](told)
    if edit in EDITS:
        assert refused(tmp_path, audio, told)
    else:
        report = verified(tmp_path, audio, told)
        assert report.passed, str(report)
        assert edit == "versions" or any("9.9" in t or "1 km" in t for t in report.evidence.skipped)
        assert "\x1b" not in "".join(report.evidence.skipped)


def test_there_is_no_key_that_is_neither(honest):
    assert set(honest[1]) == checked.HELD | checked.TOLD


def test_a_file_cut_short_with_its_numbers_adjusted_is_refused_by_the_hash_of_the_signal(
    honest, tmp_path
):
    audio, told = honest
    (tmp_path / "whole.wav").write_bytes(audio)
    y, fs = sf.read(tmp_path / "whole.wav", dtype="float32")
    with sf.SoundFile(tmp_path / "cut.wav", "w", fs, y.ndim, "FLOAT") as cut:
        cut.comment = sf.SoundFile(tmp_path / "whole.wav").comment
        cut.write(y[:4000])
    peaks = [
        float(np.abs(s).max())
        for s in stimlib.render(
            stimlib.scenes.squeeze(), FILE_MOTION, 8000, 0.5, {"k": 1800.0}, 3
        ).y
    ]
    cut = told | {
        "frames": 4000,
        "channels": [c | {"peak": p} for c, p in zip(told["channels"], peaks, strict=True)],
    }
    report = verified(tmp_path, (tmp_path / "cut.wav").read_bytes(), cut)
    assert [c.name for c in report.checks if not c.passed] == ["sidecar: hash of the signal"]


def test_what_no_hash_can_hold_is_said():
    """A file of half a recording is a correct file; the report says that the motion
    went on.
    """
    import tempfile
    from pathlib import Path

    scene, x = Scene({"y": 2 * Input("x")}), np.linspace(0, 1, 8000)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.wav"
        file.write(path, stimlib.compile(scene, 8000), {"x": x}, 0.5, progress=False)
        report = stimlib.verify(scene, {"x": x}, path)
    assert report.passed and any(
        "the file ends 0.5 s before it" in t for t in report.evidence.skipped
    )


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
        ("a.flac", 64.0, True),
        ("a.flac", 30.0, True),  # clipped at three quarters, and so told
        ("a.flac", 1e-6, False),  # a square wave
        ("a.wav", 1.0, True),
        ("a.wav", 1e30, True),
        ("a.wav", 1e60, False),
    ],
)
def test_what_the_storage_cannot_carry_fails(tmp_path, scene, name, full_scale, good):
    stimulus, motion = SCENES[scene]
    file.write(
        tmp_path / name,
        stimlib.compile(stimulus, 8000),
        motion,
        0.5,
        progress=False,
        full_scale=full_scale,
    )
    report = stimlib.verify(stimulus, motion, tmp_path / name)
    assert report.passed == (
        good or scene == "silence" or (scene == "without a law" and full_scale == 1e5)
    ), str(report)


def test_names_in_files_are_escaped_in_table_and_page(honest, tmp_path):
    audio, told = honest
    told = json.loads(json.dumps(told))
    told["motion"]["x1"] = "<script>\x1b[2J"
    report = verified(tmp_path, audio, told)
    report.to_html(tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text()
    assert "\x1b" not in page + str(report) and "<script" not in page and "&lt;script&gt;" in page
    beside = (
        f"<code>{report.evidence.path.name}</code>, and its sidecar"
        f" <code>{report.evidence.path.name}.json</code>"
    )
    assert beside in page  # a reviewer who gets the one without the other can prove nothing
