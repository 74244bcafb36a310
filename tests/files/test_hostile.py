"""Sound files, sidecars and logs in a place where others write too: nothing of theirs
is overwritten, waited for or believed.
"""

import errno
import hashlib
import json
import os
import random
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import numpy as np
import pytest
from commands import ran
from refusals import refused, warned

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib.analysis.draw import draw
from stimlib.analysis.overview import picture
from stimlib.blocks import white_noise
from stimlib.checks.session import verify_log
from stimlib.errors import SinkError, StimlibError
from stimlib.files import audio as file
from stimlib.files.batch import render_set
from stimlib.files.formats import FORMATS, stored
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import replay
from stimlib.files.log_writer import LogWriter, header
from stimlib.files.sidecar import DONE
from stimlib.motion.generators import sinusoid
from stimlib.motion.text import parse_motion
from stimlib.run.safety import GAIN, Safety, protect, to_device
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


def forge(path, change, data=None):
    """Make a file and its sidecar fit again, after something was changed in them."""
    if data is not None:
        path.write_bytes(data)
    sidecar = path.with_name(path.name + ".json")
    info = (
        json.loads(sidecar.read_text())
        | {"file_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
        | change
    )
    sidecar.write_text(json.dumps(info))


# -- another program writes to the file that is being written


def cut(part):
    os.truncate(part, part.stat().st_size // 2)


def empty(part):
    os.truncate(part, 0)


def flip(part):
    with open(part, "r+b") as f:
        f.seek(-80, os.SEEK_END)
        byte = f.read(1)
        f.seek(-80, os.SEEK_END)
        f.write(bytes([byte[0] ^ 0x11]))


def head(part):
    with open(part, "r+b") as f:
        f.write(b"junk")


def other(part):
    shutil.copy(part, f"{part}.mine")
    os.replace(f"{part}.mine", part)


@pytest.mark.parametrize("how", [cut, empty, flip, head, other], ids=lambda f: f.__name__)
@pytest.mark.parametrize(("format", "subtype"), KINDS)
def test_a_file_that_another_program_changed_gets_no_name(tmp_path, format, subtype, how):
    path = tmp_path / f"a.{format.lower()}"
    write(path, seconds=0.1, subtype=subtype)
    before = listing(tmp_path)
    seconds, at = (2.0, 1.5) if format == "FLAC" else (0.5, 0.2)  # libFLAC keeps up to 4096 frames
    motion = meddle(at, lambda: how(written(path, round(8000 * at))))
    if how is head:  # a header that is written again does not matter: what was written is read back
        try:
            write(path, motion, seconds, subtype=subtype)
        except SinkError:
            assert listing(tmp_path) == before
        else:
            assert np.array_equal(file.read(path)[0], expected(subtype, seconds))
        return
    refused(
        SinkError,
        rf"another program changed {path.name}\.[0-9a-f-]+\.part while it was written"
        "|cannot be read|truncated",
        write,
        path,
        motion,
        seconds,
        subtype=subtype,
    )
    assert listing(tmp_path) == before
    file.read(path)


def expected(subtype, seconds):
    y = spring().process(HAND["x"](np.arange(seconds * 8000) / 8000)[None])
    return stored(y, {"subtype": subtype, "channels": [{"name": "force", "full_scale": 64.0}]})


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
    refused(
        SinkError,
        f"{name} is there already, and overwrite=False",
        write,
        path,
        meddle(0.2, lambda: (tmp_path / name).write_bytes(b"mine")),
        overwrite=False,
    )
    assert listing(tmp_path) == {name: b"mine"}
    (tmp_path / name).unlink()
    write(path, overwrite=False)
    assert set(listing(tmp_path)) == {"a.wav", "a.wav.json"} and file.read(path)[0].shape == (
        1,
        4000,
    )


# -- links and pipes


def test_a_link_that_comes_during_the_run_is_not_followed(tmp_path):
    victim, path = tmp_path / "victim", tmp_path / "a.flac"
    victim.write_text("precious")

    def plant():
        part = written(path, 0)
        part.unlink()
        part.symlink_to(victim)

    refused(
        SinkError, "another program changed a.flac.*.part", write, path, meddle(1.5, plant), 2.0
    )
    assert victim.read_text() == "precious" and not path.exists()


def test_a_link_with_the_name_of_the_file_is_replaced(tmp_path):
    for name in ("a.wav", "a.wav.json"):
        (tmp_path / f"{name}.victim").write_text("precious")
        (tmp_path / name).symlink_to(tmp_path / f"{name}.victim")
    write(tmp_path / "a.wav")
    assert not any(p.is_symlink() for p in tmp_path.iterdir())
    assert [(tmp_path / f"{n}.victim").read_text() for n in ("a.wav", "a.wav.json")] == [
        "precious"
    ] * 2


def test_reports_pictures_and_tables_follow_no_link(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("precious")
    hand = {"x": sinusoid(0.02, 3.0)}
    rendering = stimlib.render(SCENE, hand, fs=8000, seconds=0.1)
    calls = {
        "a.html": lambda p: stimlib.verify(SCENE, hand, rendering).to_html(p),
        "a.png": lambda p: picture(rendering, p),
        "a.svg": lambda p: draw(SCENE, p),
        "index.json": lambda p: render_set(
            p.parent, {"s": SCENE}, hand, 0.01, workers=1, progress=False
        ),
    }
    for name, call in calls.items():
        for planted in (name + ".part", name):
            (tmp_path / planted).symlink_to(victim)
            if planted == name:
                call(tmp_path / name)
                assert not (tmp_path / name).is_symlink() and (tmp_path / name).stat().st_size > 100
            else:
                refused(SinkError, "is a link", call, tmp_path / name)
                (tmp_path / planted).unlink()
    assert victim.read_text() == "precious"


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "x" * 300, "y/" * 3000])
def test_names_that_no_file_can_have(tmp_path, name):
    path = tmp_path / (name + ".wav")
    calls = [
        lambda: write(path),
        lambda: file.read(path),
        lambda: read_log(path),
        lambda: LogWriter(path, header(SCENE, SAFETY, 8000.0)),
        lambda: render_set(path, {"s": SCENE}, HAND, 0.01, workers=1, progress=False),
        lambda: render_set(tmp_path, {name: SCENE}, HAND, 0.01, workers=1, progress=False),
        lambda: draw(SCENE, path.with_suffix(".svg")),
    ]
    for call in calls:
        error = refused(StimlibError, None, call)
        assert len(str(error)) < 30_000 and "\0" not in str(error) and "\ud800" not in str(error)


def test_a_small_file_that_another_run_is_writing_is_left_to_it(tmp_path):
    path, part = tmp_path / "a.html", tmp_path / "a.html.part"
    with ExitStack() as stack:
        safe_files.alone(stack, part, path).write(b"half")
        refused(SinkError, "is being written by another run", safe_files.publish, path, "whole")
        assert not path.exists() and part.read_bytes() == b"half"
    assert part.exists()  # as when it was killed
    safe_files.publish(path, "all")
    assert path.read_text() == "all" and not part.exists()


def test_what_a_killed_run_left_gives_a_small_file_neither_mode_nor_bytes(tmp_path):
    path, part = tmp_path / "a.html", tmp_path / "a.html.part"
    safe_files.publish(tmp_path / "usual", "x")
    part.write_bytes(b"secret" * 100)
    part.chmod(0o777)
    safe_files.publish(path, "all")
    assert path.read_text() == "all" and path.stat().st_mode == (tmp_path / "usual").stat().st_mode
    assert not part.exists()


def test_an_interrupt_behind_the_move_leaves_the_part_of_another_run(tmp_path, monkeypatch):
    path, part = tmp_path / "a.html", tmp_path / "a.html.part"

    def settle(folder):
        part.write_text("another run's")
        raise KeyboardInterrupt

    monkeypatch.setattr(safe_files, "settle", settle)
    refused(KeyboardInterrupt, None, safe_files.publish, path, "whole")
    assert path.read_text() == "whole" and part.read_text() == "another run's"


def test_of_two_that_write_one_small_file_a_reader_sees_whole_ones(tmp_path):
    """Also where each finds the other at it: then it says so, and not that there is no
    folder.
    """
    path, size, said, half = tmp_path / "a.html", 3_000_000, [], 0

    def write_it(letter):
        for _ in range(20):
            try:
                safe_files.publish(path, letter * size)
            except SinkError as e:
                said.append(str(e))

    with ThreadPoolExecutor(2) as pool:
        jobs = [pool.submit(write_it, letter) for letter in "ab"]
        while not all(job.done() for job in jobs):
            data = path.read_bytes() if path.exists() else b"a" * size
            half += len(data) != size or len(set(data)) != 1
        for job in jobs:
            job.result()
    assert half == 0 and all("another run" in text for text in said)


# -- files that say too much


def test_a_header_that_declares_years_is_not_believed(tmp_path):
    path = tmp_path / "a.flac"
    write(path)
    data = bytearray(path.read_bytes())
    data[21] |= 0x0F  # the lower 36 bits of bytes 18 to 25 are the number of frames
    data[22:26] = b"\xff" * 4
    forge(path, {"frames": 2**36 - 1}, data)
    refused(
        SinkError,
        r"bytes of samples in memory: 5.49756e\+11 is more than limits.audio_bytes",
        file.read,
        path,
    )
    data[21] &= 0xF0
    data[22:26] = (10**6).to_bytes(4, "big")
    forge(path, {"frames": 10**6}, data)
    refused(SinkError, "truncated|cannot be read", file.read, path)


def test_a_sparse_file_is_not_read_for_hours(tmp_path):
    path = tmp_path / "a.caf"
    write(path)
    data, frames = bytearray(path.read_bytes()), 2**38
    at = data.index(b"data")
    data[at + 4 : at + 12] = (4 + 4 * frames).to_bytes(8, "big")
    sidecar = json.loads((tmp_path / "a.caf.json").read_text())
    path.write_bytes(data)
    os.truncate(path, len(data) + 4 * frames)
    (tmp_path / "a.caf.json").write_text(json.dumps(sidecar | {"frames": frames}))
    for call in (
        lambda: file.read(path),
        lambda: stimlib.verify(SCENE, HAND, path),
    ):
        refused(SinkError, r"limits.audio_bytes", call)


def test_limits_of_sound_files_can_be_raised(tmp_path, monkeypatch):
    write(tmp_path / "a.wav")
    monkeypatch.setattr(stimlib.limits, "audio_bytes", 8 * 4000 - 1)
    refused(SinkError, "STIMLIB_LIMITS=audio_bytes=", file.read, tmp_path / "a.wav")
    monkeypatch.setattr(stimlib.limits, "audio_bytes", 8 * 4000)
    assert file.read(tmp_path / "a.wav")[0].shape == (1, 4000)


def test_samples_that_are_not_finite_are_not_read(tmp_path):
    path = tmp_path / "a.wav"
    write(path)
    data = bytearray(path.read_bytes())
    data[-400:-396] = np.float32(np.nan).tobytes()
    forge(path, {}, data)
    refused(SinkError, "not finite", file.read, path)
    forge(
        path,
        {"channels": [{"name": "f", "unit": "N", "full_scale": 1e308, "clips": 0, "peak": 1.0}]},
    )
    refused(SinkError, "not finite", file.read, path)


@pytest.mark.parametrize(("format", "subtype"), KINDS)
def test_fuzzed_sound_files_are_read_or_refused(tmp_path, format, subtype):
    path, rng = tmp_path / f"a.{format.lower()}", random.Random(f"{format} {subtype}")
    write(path, seconds=0.05, subtype=subtype)
    good, sidecar = path.read_bytes(), path.with_name(path.name + ".json").read_bytes()
    read = 0
    for _ in range(60):
        data = bytearray(good)
        for _ in range(rng.choice([1, 1, 2, 8])):  # mostly in the headers
            data[rng.randrange(min(len(data), rng.choice([60, 200, len(data)])))] = rng.choice(
                [0, 1, 0x7F, 0x80, 0xFF]
            )
        data = data[: rng.choice([len(data), len(data), rng.randrange(len(data))])]
        forge(path, {}, data)
        try:
            read += file.read(path)[0].shape == (1, 400)
        except SinkError as e:
            assert str(path) in str(e)
        path.with_name(path.name + ".json").write_bytes(sidecar)
    assert read  # some only changed a sample


# -- sidecars


JUNK = [
    None,
    True,
    -1,
    3,
    2**70,
    10**400,
    1e308,
    -0.5,
    "x",
    "",
    [],
    [[]],
    [None],
    {},
    {"a": None},
    {"x": 3},
    [{"at": 0}],
]


SAID: dict = {}


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    path = tmp_path_factory.mktemp("pair") / "a.wav"
    proc = spring()
    proc.set("k", 900.0)
    file.write(path, proc, HAND, 0.05, full_scale=64.0)
    SAID.update(json.loads((path.parent / "a.wav.json").read_text()))
    return path, SAID


def verify_or_refuse(path, info):
    """A sidecar is read and its file verified, or refused by a typed error."""
    (path.parent / "a.wav.json").write_text(json.dumps(info))
    try:
        _, got = file.read(path)
        fields.require(got, DONE)
        # verify does not look at these
        if all(got[name] == SAID[name] for name in ("stimlib", "versions", "sha256", "scene")):
            return stimlib.verify(
                SCENE, {name: parse_motion(text) for name, text in got["motion"].items()}, path
            )
    except StimlibError as e:
        assert "\n" not in str(e)
    return None


@pytest.mark.parametrize("name", DONE)
def test_every_field_of_a_sidecar_may_be_wrong(pair, name):
    path, good = pair
    verify_or_refuse(path, {k: v for k, v in good.items() if k != name})
    refused(SinkError, f"a sidecar that stimlib wrote: {name} is missing", file.read, path)
    for junk in JUNK:
        verify_or_refuse(path, good | {name: junk})
        for inner in good[name] if isinstance(good[name], dict) and name != "scene" else ():
            verify_or_refuse(path, good | {name: good[name] | {inner: junk}})
        if isinstance(good[name], list):
            for inner in good[name][0]:
                verify_or_refuse(path, good | {name: [good[name][0] | {inner: junk}]})
    assert verify_or_refuse(path, good).passed


# -- logs


def session(folder, scene=SCENE, n=2400, fs=8000.0):
    proc, inputs = stimlib.compile(protect(scene, SAFETY), fs), len(scene.inputs)
    with LogWriter(folder, header(scene, SAFETY, fs)) as log:
        proc.set(GAIN, 1.0, 160 / fs)
        log.event(0, "set", name=GAIN, value=1.0, ramp=160)
        x = np.full((inputs, n), 0.01)
        log.motion(x)
        log.delivered(to_device(proc.process(x), SAFETY.scales(proc.outputs), [0]))
        log.close({"produced": n})
    return folder


@pytest.mark.parametrize("fs", [1e7, 8000.0])
def test_a_line_that_declares_a_day_as_lost_is_refused(tmp_path, fs):
    folder = session(tmp_path / "a", NOISE, fs=fs)
    with open(folder / "events.jsonl", "a") as f:
        f.write(json.dumps({"at": 2400, "kind": "lost", "frames": int(86400 * fs)}) + "\n")
    refused(
        SinkError, "samples that are lost: .* is more than limits.lost_samples", read_log, folder
    )


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
    refused(SinkError, "samples: 2400 is more than limits.log_samples", read_log, folder)
    monkeypatch.setattr(stimlib.limits, "log_samples", 2400)
    # verify holds a stretch of it, however long it is
    monkeypatch.setattr(stimlib.limits, "render_bytes", 8)
    assert verify_log(read_log(folder)).passed
    monkeypatch.setattr(stimlib.limits, "events_bytes", 100)
    refused(SinkError, "limits.events_bytes", read_log, folder)


def test_motion_that_is_cut_while_it_is_replayed(tmp_path):
    folder = session(tmp_path / "a")
    log = read_log(folder)
    assert np.array_equal(np.asarray(log.motion), np.full((2400, 1), 0.01)) and log.motion[
        3:5, 0
    ].tolist() == [0.01, 0.01]
    os.truncate(folder / "motion.f64", 8000)
    for call in (replay, verify_log):
        refused(SinkError, r"motion.f64 was cut since the log was read", call, log)
    (folder / "motion.f64").unlink()
    os.mkfifo(folder / "motion.f64")
    refused(SinkError, "not a regular file", replay, log)


@pytest.mark.parametrize("what", ["session.json", "events.jsonl", "motion.f64"])
def test_pipes_and_folders_in_a_log_are_told(tmp_path, what):
    folder = session(tmp_path / "a")
    for plant in (os.mkfifo, os.mkdir, lambda p: os.symlink("/dev/zero", p)):
        (folder / what).rmdir() if (folder / what).is_dir() else (folder / what).unlink()
        plant(folder / what)
        for command in (["replay", str(folder)], ["verify", "--log", str(folder)]):
            done = ran(command, 2, what)
            assert "regular file" in done.stderr


NASTY = "\x1b[2J\x1b]0;owned\x07[bold]\x9b31m\u202e"


def test_texts_of_others_do_not_reach_the_terminal(tmp_path, pair):
    folder = session(tmp_path / f"a{NASTY[:4]}")
    head = json.loads((folder / "session.json").read_text())
    (folder / "session.json").write_text(json.dumps(head | {"stimlib": NASTY, "device": NASTY}))
    log = read_log(folder)
    result = verify_log(log)
    result.to_html(tmp_path / "a.html")
    path, good = pair
    channel = good["channels"][0] | {"name": NASTY, "unit": NASTY}
    with open(folder / "events.jsonl", "ab") as f:
        f.write(json.dumps({"at": 0, "kind": NASTY, "text": NASTY}).encode() + b"\n")
    outputs = [
        str(replay(log)),
        str(result),
        repr(result),
        (tmp_path / "a.html").read_text(),
        *log.notes,
    ]
    for command in (["replay", str(folder)], ["verify", "--log", str(folder)]):
        done = ran(command)
        assert "\\x1b" in done.output
        outputs.append(done.output)
    (path.parent / "a.wav.json").write_text(
        json.dumps(good | {"scene_hash": NASTY, "motion": {"x": NASTY}, "channels": [channel]})
    )
    failed = ran(["verify", "squeeze", "--wav", path], 2)
    for text in [*outputs, failed.output]:
        assert not set(text) & set("\x1b\x07\x9b\u202e"), ascii(text)


def test_fields_say_what_they_must_be():
    tests = {
        "n": fields.whole(3),
        "t": fields.list_of(fields.record({"a": fields.maybe(fields.text)})),
    }
    fields.require({"n": 3, "t": [{"a": None}, {"a": "b", "more": 1}]}, tests)
    for data, says in [
        ({}, "n is missing; it must be a whole number from 0 to 3"),
        ({"n": True}, "n must be a whole number from 0 to 3"),
        ({"n": 1, "t": [{}]}, r"t must be a list, each value a table of a \(a text or null\)"),
    ]:
        refused(ValueError, says, fields.require, data, tests)
    for text in (
        b"[",
        b"[]",
        b"[" * 100_000,
        b"\xff",
        b'{"a": NaN}',
        b'{"a": -1e999}',
        b'{"a": ' + b"1" * 5000 + b"}",
    ):
        refused(ValueError, None, fields.parse, text)


def test_a_large_limit_is_no_large_buffer(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(b"x")
    monkeypatch.setattr(stimlib.limits, "scene_bytes", float("inf"))
    assert safe_files.read(tmp_path / "a", "scene_bytes") == b"x"


def test_render_tells_of_samples_that_players_clip(tmp_path):
    words = [
        "render",
        "bumps",
        "--motion",
        "constant_speed(0.02, 0.1)",
        "--seconds",
        "0.2",
        "--out",
        str(tmp_path / "a.wav"),
    ]
    done = ran(words)
    said = " ".join(done.stderr.split())
    assert (
        "(voltage reaches 200 V of 1)" in said and "give a full scale (--full-scale) of 202" in said
    )
    ran([*words, "--full-scale", "150", "--quiet"], 0, "(voltage reaches 200 V of 150)")
    done = ran([*words, "--full-scale", "200"])
    assert done.stderr == ""


def test_a_file_tells_what_passes_full_scale_by_name_and_how_it_ends(tmp_path):
    x = stimlib.Input("x", "m")
    proc = stimlib.compile(
        stimlib.Scene({"force": stimlib.constant(100.0, "N/m") * x, "place": 1 * x}),
        1000,
        target="python",
    )
    motion = {"x": np.full(10, 0.5)}
    warned(
        RuntimeWarning,
        r"\(force reaches 50 N of 10\).*players clip.*of force: 50.5, place: 0.505",
        file.write,
        tmp_path / "a.wav",
        proc,
        motion,
        0.01,
        full_scale={"force": 10.0, "place": 1.0},
    )
    warned(
        RuntimeWarning,
        "the file is clipped there",
        file.write,
        tmp_path / "a.flac",
        proc,
        motion,
        0.01,
        full_scale={"force": 10.0, "place": 1.0},
    )
