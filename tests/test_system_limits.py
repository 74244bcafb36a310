"""Limits that a user can raise, texts that can be shown, and files that are regular."""

import os
from contextlib import ExitStack

import pytest
from refusals import refused

import stimlib
from stimlib.errors import BadValue, SceneFileError, SinkError, UnknownName, shown
from stimlib.system import fields, limits as module, safe_files
from stimlib.system.limits import Limits


def test_a_limit_says_its_name_and_what_is_enough():
    mine, what = Limits(scene_bytes=100), "a.json: bytes"
    mine.check("scene_bytes", 100, what)
    says = r"a.json: bytes: 101 is more than limits.scene_bytes = 100.*scene_bytes=1.1e\+02"
    refused(SceneFileError, says, mine.check, "scene_bytes", 101, what, SceneFileError)
    refused(BadValue, "scene_bytes=inf", mine.check, "scene_bytes", float("inf"), what)
    mine.scene_bytes = float("1.1e+02")
    mine.check("scene_bytes", 101, what)
    for value in (0, -1, float("nan"), "many", None, True):
        refused(BadValue, "scene_bytes", setattr, mine, "scene_bytes", value)
    refused(BadValue, "there is no 'scene_byte'", setattr, mine, "scene_byte", 1)


@pytest.mark.parametrize(
    "text, expected",
    [
        ("scene_blocks=7 scene_bytes=1e3", 7.0),
        ("scene_blocks=7,scene_bytes=1e3", 7.0),
        ("scene_blocks", "not NAME=NUMBER"),
        ("a=1", "no 'a'"),
    ],
)
def test_limits_from_the_environment(text, expected, monkeypatch):
    monkeypatch.setattr(module, "_wrong", [])
    monkeypatch.setenv("STIMLIB_LIMITS", text)
    mine = module._from_environment()
    if isinstance(expected, str):
        refused(BadValue, expected, mine.check, "scene_bytes", 1, "a")
    else:
        mine.check("scene_bytes", 1, "a")
        assert (mine.scene_blocks, mine.scene_bytes) == (expected, 1000.0)


def test_texts_of_others_cannot_speak_to_a_terminal():
    nasty = "a\x1b[2J\r\x00\x9b\u202e\ud800é\u2028 \u03b1"
    assert shown(nasty) == "a\\x1b[2J\\r\\x00\\x9b\\u202e\\ud800é\\u2028 \u03b1"
    for error in (SinkError, UnknownName, BadValue):
        assert str(error(nasty)) == shown(nasty)
    assert str(BadValue("two\nlines")) == "two\nlines"


def test_only_regular_files_within_the_limit_are_read(tmp_path, monkeypatch):
    path, odd = (
        tmp_path / "a",
        ("/dev/zero", tmp_path, tmp_path / "b", "a\0b", "\ud800", "x" * 5000),
    )
    os.mkfifo(tmp_path / "pipe")
    for other in (tmp_path / "pipe", *odd):
        refused(SinkError, "cannot read", safe_files.read, other, "scene_bytes")
    if os.path.exists("/proc/self/stat"):  # a file without a size
        refused(SinkError, "grows", safe_files.read, "/proc/self/stat", "scene_bytes")
    monkeypatch.setattr(stimlib.limits, "scene_bytes", 10)
    path.write_bytes(b"x" * 10)
    assert safe_files.read(path, "scene_bytes") == b"x" * 10
    path.write_bytes(b"x" * 11)
    refused(SinkError, "limits.scene_bytes", safe_files.read, path, "scene_bytes")
    assert [fields.number(v) for v in (2**53, -(2**53), 2**53 + 1)] == [True, True, False]


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
    os.mkfifo(tmp_path / "d.json")
    # as root, a device would be gone
    refused(
        SinkError, "not a regular file; remove it", safe_files.publish, tmp_path / "d.json", "new"
    )
    (tmp_path / "c.json").symlink_to(victim)
    safe_files.publish(tmp_path / "c.json", "new")
    assert victim.read_text() == "precious" and not (tmp_path / "c.json").is_symlink()


@pytest.mark.parametrize("windows", [True, False])
def test_a_lock_file_goes_with_its_lock(tmp_path, monkeypatch, windows):
    files, unlink = [], os.unlink

    def removed(path):
        if windows and not files[0].closed:
            raise PermissionError
        unlink(path)

    monkeypatch.setattr(os, "unlink", removed)
    monkeypatch.setattr(safe_files, "NOFOLLOW", 0 if windows else safe_files.NOFOLLOW)
    with ExitStack() as stack:
        files.append(safe_files.taken(stack, tmp_path / "a"))
    assert not (tmp_path / "a").exists()


def test_publishing_leaves_what_was_there_where_it_fails(tmp_path):
    (tmp_path / "a").write_text("old")
    refused(AttributeError, None, safe_files.publish, tmp_path / "a", 3)
    assert (tmp_path / "a").read_text() == "old" and len(os.listdir(tmp_path)) == 1
    safe_files.publish(tmp_path / "a", "new")
    assert (tmp_path / "a").read_text() == "new" and os.listdir(tmp_path) == ["a"]


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
