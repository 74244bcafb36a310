"""Sound files, sidecars and logs in a place where others write too: nothing of theirs
is overwritten, waited for or believed.
"""

import errno
import hashlib
import json
import os
import re
import shutil
import time
from functools import cache, partial
from itertools import product

import numpy as np
import pytest
from commands import ran
from laws import mostly
from logged import play
from refusals import refused, warned

import stimlib
from stimlib import Input, Param, Scene, SinkError, StimlibError, constant, draw
from stimlib.analysis.overview import picture
from stimlib.blocks import white_noise
from stimlib.checks.session import verify_log
from stimlib.files import LogWriter, audio as file, header, read_log, replay
from stimlib.files.batch import render_set
from stimlib.files.formats import FORMATS, stored
from stimlib.motion.generators import sinusoid
from stimlib.run.safety import GAIN, Safety
from stimlib.system import fields, safe_files

KINDS = [(f, s) for f, subtypes in FORMATS.items() for s in subtypes]
HAND = {"x": sinusoid(0.02, 3.0)}
SCENE = Scene(
    {
        "force": (
            Param("k", 1000.0, "N/m") * Input("x", "m") + constant(2.0, "N") * white_noise(seed=3)
        )
    }
)
NOISE = Scene({"noise": constant(3.0, "N") * white_noise(seed=1)})
SAFETY = Safety(full_scale=64.0)


def spring():
    return stimlib.compile(SCENE, 8000.0)


def write(path, motion=HAND, seconds=0.5, **how):
    return file.write(path, spring(), motion, seconds, full_scale=64.0, **{"block": 400} | how)


def listing(folder):
    return {
        p.name: os.readlink(p) if p.is_symlink() else p.is_file() and p.read_bytes()
        for p in folder.iterdir()
    }


def meddle(at, call):
    """A hand that does something else once, at a time."""
    did = []

    def x(t):
        if t[0] >= at and not did:
            did.append(call())
        return HAND["x"](t)

    return {"x": x}


def written(path, frames):
    """Wait until other threads have written so many frames of a file, of FLAC a part of
    them, and return its part.
    """
    (part,) = path.parent.glob(f"{path.name}.*.part")
    while os.path.getsize(part) < (10_000 if path.suffix == ".flac" else 2 * frames):
        time.sleep(0.001)
    return part


def patched(part, at, change):
    """Change bytes of a file that another writes."""
    with open(part, "r+b") as f:
        f.seek(at, os.SEEK_END if at < 0 else os.SEEK_SET)
        f.write(change)


def forge(path, change, data=None):
    """Make a file and its sidecar fit again, after something was changed in them."""
    if data is not None:
        path.write_bytes(data)
    sidecar = path.with_name(path.name + ".json")
    now = {"file_sha256": hashlib.sha256(path.read_bytes()).hexdigest()} | change
    sidecar.write_text(json.dumps(json.loads(sidecar.read_text()) | now))


# -- another program writes to the file that is being written


def linked(part):
    part.unlink()
    part.symlink_to(part.with_name("victim"))


HOW = {
    "cut": lambda part: os.truncate(part, part.stat().st_size // 2),
    "emptied": lambda part: os.truncate(part, 0),
    "flipped": lambda part: patched(part, -80, bytes([part.read_bytes()[-80] ^ 0x11])),
    "replaced": lambda part: os.replace(shutil.copy(part, f"{part}.mine"), part),
    "linked": linked,
    "header": lambda part: patched(part, 0, b"junk"),
}
CHANGED = [*product(KINDS, HOW)]


@pytest.mark.parametrize("change", mostly(CHANGED[::7] + CHANGED[3::7], CHANGED))
def test_a_file_that_another_program_changed_gets_no_name(tmp_path, change):
    """But one of which only the header was changed, and is written again."""
    (format, subtype), how = change
    path = tmp_path / f"a.{format.lower()}"
    (tmp_path / "victim").write_text("precious")
    write(path, seconds=0.1, subtype=subtype)
    before = listing(tmp_path)
    seconds, at = (2.0, 1.5) if format == "FLAC" else (0.5, 0.2)  # libFLAC keeps up to 4096 frames
    motion = meddle(at, lambda: HOW[how](written(path, round(8000 * at))))
    try:
        write(path, motion, seconds, subtype=subtype)
    except SinkError as e:
        assert re.search("another program changed|cannot be read|truncated", str(e))
        assert listing(tmp_path) == before
    else:
        y = spring().process(HAND["x"](np.arange(seconds * 8000) / 8000)[None])
        info = {"subtype": subtype, "channels": [{"name": "force", "full_scale": 64.0}]}
        assert how == "header" and np.array_equal(file.read(path)[0], stored(y, info))
    file.read(path)


@pytest.mark.parametrize("name", ["a.wav", "a.wav.json"])
@pytest.mark.parametrize("links", [True, False])
def test_without_overwrite_a_file_that_comes_during_the_run_stays(
    tmp_path, monkeypatch, name, links
):
    def none(*_, **__):
        raise OSError(errno.EPERM, "no links on this file system")

    if not links:
        monkeypatch.setattr(os, "link", none)
    path = tmp_path / "a.wav"
    motion = meddle(0.2, lambda: (tmp_path / name).write_bytes(b"mine"))
    refused(SinkError, f"{name} is there already", write, path, motion, overwrite=False)
    assert listing(tmp_path) == {name: b"mine"}
    (tmp_path / name).unlink()
    write(path, overwrite=False)
    assert set(listing(tmp_path)) == {"a.wav", "a.wav.json"}
    assert file.read(path)[0].shape == (1, 4000)


# -- links and pipes


@cache
def short():
    return stimlib.render(SCENE, HAND, fs=8000, seconds=0.02)


@cache
def verified():
    return stimlib.verify(SCENE, HAND, short())


WRITERS = {  # what writes a file, and the file that is planted before it
    "a.wav": write,
    "a.wav.json": lambda path: write(path.with_suffix("")),
    "a.html": lambda path: verified().to_html(path),
    "a.png": lambda path: picture(short(), path),
    "a.svg": lambda path: draw(SCENE, path),
    "index.json": lambda path: render_set(
        path.parent, {"s": SCENE}, HAND, 0.01, workers=1, progress=False
    ),
}


@pytest.mark.parametrize("name", WRITERS)
def test_reports_pictures_and_tables_follow_no_link(tmp_path, name, monkeypatch):
    monkeypatch.setattr("stimlib.checks.page.figures", lambda e: [])  # of the report
    victim, path = tmp_path / "victim", tmp_path / name
    victim.write_text("precious")
    path.symlink_to(victim)
    WRITERS[name](path)
    assert not path.is_symlink() and path.stat().st_size > 100
    assert victim.read_text() == "precious"


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "x" * 300, "y/" * 3000])
def test_names_that_no_file_can_have(tmp_path, name):
    path, set_of = tmp_path / (name + ".wav"), {"workers": 1, "progress": False}
    for call in [
        (write, path),
        (file.read, path),
        (read_log, path),
        (LogWriter, path, header(SCENE, SAFETY, 8000.0)),
        (partial(render_set, **set_of), path, {"s": SCENE}, HAND, 0.01),
        (partial(render_set, **set_of), tmp_path, {name: SCENE}, HAND, 0.01),
        (draw, SCENE, path.with_suffix(".svg")),
    ]:
        error = refused(StimlibError, None, *call)
        assert len(str(error)) < 30_000 and "\0" not in str(error) and "\ud800" not in str(error)


def test_runs_that_publish_at_once_and_one_that_is_interrupted(tmp_path, monkeypatch):
    path = tmp_path / "a.html"

    def settle(folder):
        monkeypatch.undo()
        safe_files.publish(path, "of another run")
        raise KeyboardInterrupt

    monkeypatch.setattr(safe_files, "settle", settle)
    refused(KeyboardInterrupt, None, safe_files.publish, path, "whole")
    assert path.read_text() == "of another run" and os.listdir(tmp_path) == ["a.html"]


# -- files that say too much


MUCH = [{"name": "f", "unit": "N", "full_scale": 1e308, "clips": 0, "peak": 1.0}]


def counted(data, frames):
    """A FLAC file: the lower 36 bits of its bytes 18 to 25 are the number of frames."""
    number = int.from_bytes(data[18:26], "big") >> 36 << 36 | frames
    return data[:18] + number.to_bytes(8, "big") + data[26:]


def sparse(data, frames=2**38):
    """A CAF file of so many frames."""
    at = data.index(b"data")
    return data[: at + 4] + (4 + 4 * frames).to_bytes(8, "big") + data[at + 12 :]


@pytest.mark.parametrize(
    ("name", "change", "facts", "says"),
    [
        ("a.flac", lambda d: counted(d, 2**36 - 1), {"frames": 2**36 - 1}, "limits.audio_bytes"),
        ("a.flac", lambda d: counted(d, 10**6), {"frames": 10**6}, "truncated|cannot be read"),
        ("a.caf", sparse, {"frames": 2**38}, "limits.audio_bytes"),
        ("a.wav", lambda d: d[:-400] + np.float32(np.nan).tobytes() + d[-396:], {}, "not finite"),
        ("a.wav", None, {"channels": MUCH}, "not finite"),
    ],
)
def test_a_header_that_declares_years_is_not_believed(tmp_path, name, change, facts, says):
    """Nor are samples read that are not finite."""
    file.write(tmp_path / name, spring(), HAND, 0.5, full_scale=1.0)
    forge(tmp_path / name, facts, change and change((tmp_path / name).read_bytes()))
    if change is sparse:
        os.truncate(tmp_path / name, (tmp_path / name).stat().st_size + 4 * 2**38)
    refused(SinkError, says, file.read, tmp_path / name)


def test_limits_of_sound_files_can_be_raised(tmp_path, monkeypatch):
    write(tmp_path / "a.wav")
    monkeypatch.setattr(stimlib.limits, "audio_bytes", 8 * 4000 - 1)
    for call in (file.read, partial(stimlib.verify, SCENE, HAND)):
        refused(SinkError, "STIMLIB_LIMITS=audio_bytes=", call, tmp_path / "a.wav")
    monkeypatch.setattr(stimlib.limits, "audio_bytes", 8 * 4000)
    assert file.read(tmp_path / "a.wav")[0].shape == (1, 4000)


# -- logs


def session(folder, scene=SCENE, fs=8000.0):
    sets = [(0, GAIN, 1.0, 160)]
    play(folder, scene, SAFETY, np.full((len(scene.inputs), 2400), 0.01), sets=sets, fs=fs)
    return folder


@pytest.mark.parametrize("fs", [1e7, 8000.0])
def test_a_line_that_declares_a_day_as_lost_is_refused(tmp_path, fs):
    folder = session(tmp_path / "a", NOISE, fs=fs)
    with open(folder / "events.jsonl", "a") as f:
        f.write(json.dumps({"at": 2400, "kind": "lost", "frames": int(86400 * fs)}) + "\n")
    refused(SinkError, "limits.lost_samples", read_log, folder)


def test_a_log_at_a_high_rate_costs_the_interpreter_no_start(tmp_path, monkeypatch):
    """At 8 MHz 256 000 samples run before sample 0, which took the interpreter 10 s."""
    from stimlib.targets.python import Engine

    ran, sample = [], Engine.sample
    monkeypatch.setattr(
        Engine, "sample", lambda *given, **how: ran.append(1) or sample(*given, **how)
    )
    assert verify_log(read_log(session(tmp_path / "a", fs=8e6))).passed
    assert 100 < len(ran) < 2000


def test_a_log_of_many_samples_is_refused(tmp_path, monkeypatch):
    folder = session(tmp_path / "a", NOISE)
    monkeypatch.setattr(stimlib.limits, "log_samples", 2399)
    refused(SinkError, "2400 is more than limits.log_samples", read_log, folder)
    monkeypatch.setattr(stimlib.limits, "log_samples", 2400)
    # verify holds a stretch of it, however long it is
    monkeypatch.setattr(stimlib.limits, "render_bytes", 8)
    assert verify_log(read_log(folder)).passed
    monkeypatch.setattr(stimlib.limits, "events_bytes", 100)
    refused(SinkError, "limits.events_bytes", read_log, folder)


def test_motion_that_is_cut_while_it_is_replayed(tmp_path):
    folder = session(tmp_path / "a")
    log = read_log(folder)
    assert np.array_equal(np.asarray(log.motion), np.full((2400, 1), 0.01))
    assert log.motion[3:5, 0].tolist() == [0.01, 0.01]
    os.truncate(folder / "motion.f64", 8000)
    for call in (replay, verify_log):
        refused(SinkError, "was cut since", call, log)
    (folder / "motion.f64").unlink()
    os.mkfifo(folder / "motion.f64")
    refused(SinkError, "not a regular file", replay, log)


NASTY = "\x1b[2J\x1b]0;owned\x07[bold]\x9b31m\u202e"


def test_texts_of_others_do_not_reach_the_terminal(tmp_path):
    folder, path = session(tmp_path / f"a{NASTY[:4]}"), tmp_path / "a.wav"
    head = json.loads((folder / "session.json").read_text())
    (folder / "session.json").write_text(json.dumps(head | {"stimlib": NASTY, "device": NASTY}))
    log = read_log(folder)
    result = verify_log(log)
    result.to_html(tmp_path / "a.html")
    with open(folder / "events.jsonl", "ab") as f:
        f.write(json.dumps({"at": 0, "kind": NASTY, "text": NASTY}).encode() + b"\n")
    outputs = [str(replay(log)), str(result), repr(result), *log.notes]
    for command in (["replay", str(folder)], ["verify", "--log", str(folder)]):
        outputs.append(ran(command).output)
        assert "\\x1b" in outputs[-1]
    write(path)
    channel = [{"name": NASTY, "unit": NASTY, "full_scale": 64.0, "clips": 0, "peak": 1.0}]
    forge(path, {"scene_hash": NASTY, "motion": {"x": NASTY}, "channels": channel})
    outputs.append(ran(["verify", "squeeze", "--wav", path], 2).output)
    for text in [*outputs, (tmp_path / "a.html").read_text("utf-8")]:
        assert not set(text) & set("\x1b\x07\x9b\u202e"), ascii(text)


def test_fields_say_what_they_must_be():
    list_of = fields.list_of(fields.record({"a": fields.maybe(fields.text)}))
    tests = {"n": fields.whole(3), "t": list_of}
    fields.require({"n": 3, "t": [{"a": None}, {"a": "b", "more": 1}]}, tests)
    for data, says in [
        ({}, "n is missing; .* from 0 to 3"),
        ({"n": True}, "n must be .* from 0 to 3"),
        ({"n": 1, "t": [{}]}, r"t must be a list, .*\(a text or null\)"),
    ]:
        refused(ValueError, says, fields.require, data, tests)
    long = b'{"a": ' + b"1" * 5000 + b"}"
    for text in (b"[", b"[]", b"[" * 100_000, b"\xff", b'{"a": NaN}', b'{"a": -1e999}', long):
        refused(ValueError, None, fields.parse, text)


def test_render_tells_of_samples_that_players_clip(tmp_path):
    words = ["render", "bumps", "--motion", "constant_speed(0.02, 0.1)", "--seconds", "0.05"]
    words += ["--out", str(tmp_path / "a.wav")]
    said = " ".join(ran(words).stderr.split())
    assert "(voltage reaches 200 V of 1)" in said and "--full-scale) of 202" in said
    ran([*words, "--full-scale", "150", "--quiet"], 0, "(voltage reaches 200 V of 150)")
    assert ran([*words, "--full-scale", "200"]).stderr == ""


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (
            "a.wav",
            r"\(force reaches 50 N of 10, level reaches 1.5 of 1\).*players clip.*place: 0.505, ",
        ),
        ("a.flac", "the file is clipped there"),
    ],
)
def test_a_file_tells_what_passes_full_scale_by_name_and_how_it_ends(tmp_path, name, says):
    x = Input("x", "m")
    level = constant(3.0, "1/m") * x
    scene = Scene({"force": constant(100.0, "N/m") * x, "place": 1 * x, "level": level})
    words = stimlib.compile(scene, 1000, target="python"), {"x": np.full(10, 0.5)}, 0.01
    scales = {"force": 10.0, "place": 1.0, "level": 1.0}
    warned(RuntimeWarning, says, file.write, tmp_path / name, *words, full_scale=scales)
