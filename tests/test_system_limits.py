"""Limits that a user can raise, texts that can be shown, and files that are regular."""

import os
import subprocess
import sys

import pytest
from refusals import refused

import stimlib
from stimlib.errors import BadValue, SceneFileError, SinkError, UnknownName, shown
from stimlib.system import fields, safe_files
from stimlib.system.limits import Limits


def test_a_limit_says_its_name_and_what_is_enough():
    mine = Limits(scene_bytes=100)
    mine.check("scene_bytes", 100, "a.json: bytes")
    refused(
        SceneFileError,
        r"a.json: bytes: 101 is more than limits.scene_bytes = 100.*scene_bytes=1.1e\+02",
        mine.check,
        "scene_bytes",
        101,
        "a.json: bytes",
        SceneFileError,
    )
    refused(
        BadValue,
        "set STIMLIB_LIMITS=scene_bytes=inf",
        mine.check,
        "scene_bytes",
        float("inf"),
        "a.json: bytes",
    )
    mine.scene_bytes = float("1.1e+02")
    mine.check("scene_bytes", 101, "a.json: bytes")


@pytest.mark.parametrize("value", [0, -1, float("nan"), "many", None, True])
def test_limits_are_numbers_above_0(value):
    with pytest.raises(BadValue, match="scene_bytes"):
        Limits().scene_bytes = value


def test_unknown_limits_are_told():
    with pytest.raises(BadValue, match="there is no 'scene_byte'"):
        Limits().scene_byte = 1


@pytest.mark.parametrize(
    "text, expected",
    [
        ("scene_blocks=7 scene_bytes=1e3", "7.0 1000.0"),
        ("scene_blocks=7,scene_bytes=1e3", "7.0 1000.0"),
        ("scene_blocks", "not NAME=NUMBER"),
        ("a=1", "no 'a'"),
    ],
)
def test_limits_from_the_environment(text, expected):
    code = (
        "from stimlib import limits; limits.check('scene_bytes', 1, 'a');"
        " print(limits.scene_blocks, limits.scene_bytes)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"STIMLIB_LIMITS": text},
        capture_output=True,
        text=True,
    )
    assert expected in run.stdout + run.stderr


def test_texts_of_others_cannot_speak_to_a_terminal():
    nasty = "a\x1b[2J\r\x00\x9b\u202e\ud800é\u2028 \u03b1"
    assert shown(nasty) == "a\\x1b[2J\\r\\x00\\x9b\\u202e\\ud800é\\u2028 \u03b1"
    for error in (SinkError, UnknownName, BadValue):
        assert str(error(nasty)) == shown(nasty)
    assert str(BadValue("two\nlines")) == "two\nlines"


def test_only_regular_files_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (
        tmp_path / "pipe",
        "/dev/zero",
        tmp_path,
        tmp_path / "missing",
        "a\0b",
        "\ud800",
        "x" * 5000,
    ):
        refused(SinkError, "cannot read", safe_files.read, path, "scene_bytes")


def test_reading_stops_at_the_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(stimlib.limits, "scene_bytes", 10)
    (tmp_path / "a").write_bytes(b"x" * 10)
    assert safe_files.read(tmp_path / "a", "scene_bytes") == b"x" * 10
    (tmp_path / "a").write_bytes(b"x" * 11)
    refused(SinkError, "limits.scene_bytes", safe_files.read, tmp_path / "a", "scene_bytes")


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="a file without a size: Linux")
def test_a_file_longer_than_its_size_is_not_read():
    refused(
        SinkError, "it grows while it is read", safe_files.read, "/proc/self/stat", "scene_bytes"
    )


@pytest.mark.skipif(os.name == "nt", reason="Windows has no permissions of this kind")
@pytest.mark.parametrize("umask", [0, 0o027])
def test_new_files_have_the_permissions_that_the_user_asks_for(tmp_path, umask):
    before = os.umask(umask)
    try:
        made = [
            safe_files.create(tmp_path / "a"),
            safe_files.opened(tmp_path / "b", os.O_RDWR | os.O_CREAT),
        ]
    finally:
        os.umask(before)
    for fd in made:
        assert os.fstat(fd).st_mode & 0o777 == 0o666 & ~umask
        os.close(fd)


def test_publishing_follows_no_link_and_waits_for_no_pipe(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "a.json.part").symlink_to(victim)
    os.mkfifo(tmp_path / "b.json.part")
    for name in ("a.json", "b.json"):
        refused(SinkError, "remove it", safe_files.publish, tmp_path / name, "new")
        assert not (tmp_path / name).exists()
    assert victim.read_text() == "precious"
    os.mkfifo(tmp_path / "d.json")
    with pytest.raises(SinkError, match="not a regular file; remove it"):
        safe_files.publish(tmp_path / "d.json", "new")  # as root, a device would be gone
    (tmp_path / "c.json").symlink_to(victim)
    safe_files.publish(tmp_path / "c.json", "new")
    assert victim.read_text() == "precious" and not (tmp_path / "c.json").is_symlink()


def test_publishing_leaves_what_was_there_where_it_fails(tmp_path):
    (tmp_path / "a").write_text("old")
    (tmp_path / "a.part").write_text("of a run that was killed")
    refused(AttributeError, None, safe_files.publish, tmp_path / "a", 3)
    assert (tmp_path / "a").read_text() == "old" and not (tmp_path / "a.part").exists()
    safe_files.publish(tmp_path / "a", "new")
    assert (tmp_path / "a").read_text() == "new" and os.listdir(tmp_path) == ["a"]


def test_numbers_of_files_are_those_that_a_float_tells_apart():
    assert fields.number(2**53) and fields.number(-(2**53))
    assert not fields.number(2**53 + 1) and not fields.number(-(2**53) - 1)


def test_an_error_that_quotes_a_file_is_short_and_keeps_its_remedy():
    for error in (SinkError, UnknownName):
        text = str(error("what is wrong: " + "x" * 100_000 + "; do this"))
        assert len(text) <= 4000 and text.startswith("what is wrong") and text.endswith("; do this")
    assert str(BadValue("y" * 4000)) == "y" * 4000


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="counts open files in /proc")
def test_files_that_were_written_leave_no_descriptor(tmp_path):
    safe_files.publish(tmp_path / "a.json", "1")
    before = len(os.listdir("/proc/self/fd"))
    for k in range(20):
        safe_files.publish(tmp_path / f"{k}.json", "1")
    assert len(os.listdir("/proc/self/fd")) == before
