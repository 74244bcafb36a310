"""``play --watch`` and ``live``: what is saved plays, and errors name their line."""

import os
import re
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from commands import ran
from waiting import until

import stimlib
from stimlib import Input, Param, Scene, StimlibError, constant
from stimlib.blocks import elapsed, sqrt
from stimlib.cli import watching
from stimlib.cli.watching import Watched
from stimlib.devices import Sink
from stimlib.devices.process import open_sinks
from stimlib.files import read_log, replay

SCENE = """from stimlib import Input, Param, Scene
K = 100.0
def scene():
    return Scene({"force": Param("k", K, "N/m") * Input("x", "m")})
"""


@pytest.fixture
def watched(tmp_path, monkeypatch):
    """What a scene's file, as it is saved, lets play, and what is told of it."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "watch_spring.py"
    file.write_text(SCENE)
    (tmp_path / "watch_more.py").write_text("")
    played, told = [], []
    with Watched("watch_spring.py:scene", ["watch_more.py"]).reloaded(played.append, told.append):
        yield file, played, told


def test_each_save_plays_and_errors_name_the_line(watched, capfd):
    file, played, told = watched
    for k in (101.0, 102.0, 103.0):
        file.write_text(SCENE.replace("100.0", f"{k}"))
        assert until(played.copy).pop().params["k"].value == k
        played.clear()
    for text, why in (
        ("from stimlib import\n", r"watch_spring\.py:1: SyntaxError"),
        (SCENE.replace("* Input", "** Input"), r"watch_spring\.py:4: .*exponent"),
        (SCENE.replace("return", "raise SystemExit(3) or"), "SystemExit: 3"),
        (SCENE.replace("scene():", "other():"), r"write watch_spring\.py:NAME.* other"),
    ):
        file.write_text(text)
        assert re.search(why, until(told.copy).pop()) and not played
        told.clear()
    file.unlink()
    assert "watch_spring.py" in until(told.copy).pop()
    file.write_text(SCENE)
    said = []  # after it plays

    def told_of_four():
        said.append(capfd.readouterr().err)
        return len(re.findall(r"scene: plays, \d\.\d\d s after it was saved", "".join(said))) == 4

    until(told_of_four)
    assert "".join(said).count("; the version before plays on") == 5


def test_only_another_content_counts_and_a_file_may_be_replaced(watched, tmp_path):
    file, played, told = watched
    os.utime(file, (1.0, 1.0))
    file.write_text(SCENE)
    other = tmp_path / "written_beside"
    other.write_text(SCENE.replace("100.0", "300.0"))
    other.replace(file)
    until(lambda: played)
    assert [s.params["k"].value for s in played] == [300.0] and not told
    (tmp_path / "watch_more.py").write_text("1 / 0\n")
    assert "watch_more.py:1: ZeroDivisionError" in until(told.copy).pop()
    (tmp_path / "watch_more.py").write_text("")
    until(lambda: len(played) > 1)
    file.unlink()
    file.mkdir()
    until(lambda: "it is a directory" in told[-1])
    file.rmdir()
    played.clear()
    file.write_text(SCENE)
    until(lambda: played)


def test_a_file_that_takes_long_is_told_once(watched, tmp_path, monkeypatch):
    file, played, _ = watched
    said = []
    monkeypatch.setattr(watching, "say", said.append)
    monkeypatch.setattr(watching, "SLOW", 0.0)
    wait = "import os, time\nwhile not os.path.exists('go'):\n    time.sleep(0.01)\n"
    file.write_text(wait + SCENE)
    assert "has not returned" in until(said.copy)[0]
    monkeypatch.setattr(watching, "SLOW", 1e6)
    (tmp_path / "go").touch()
    until(lambda: played)
    file.write_text(SCENE)
    until(lambda: len(played) > 1)
    until(lambda: not any(isinstance(t, threading.Timer) for t in threading.enumerate()))


def test_what_a_file_imports_from_its_folder_is_watched_too(watched, tmp_path, monkeypatch):
    """Also where it could not be imported, and with files of --import that it uses."""
    file, played, told = watched
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    (tmp_path / "watch_beside.py").write_text("K = 1.0")
    os.utime(tmp_path / "watch_beside.py", (1.0, 1.0))
    (tmp_path / "watch_more.py").write_text("GAIN = 1.0")
    text = "import watch_beside, watch_more\n" + SCENE
    file.write_text(text.replace("K, ", "watch_beside.K * watch_more.GAIN, "))
    until(lambda: [s.params["k"].value for s in played][-1:] == [1.0])
    for name, text, k in (
        ("watch_beside.py", "K = 2.0", 2.0),
        ("watch_more.py", "GAIN = 3.0", 6.0),
        ("watch_beside.py", "K =", None),
        ("watch_beside.py", "K = 5.0", 15.0),
    ):
        told.clear()
        (tmp_path / "new").write_text(text)
        os.utime(tmp_path / "new", (1.5, 1.0 + (k or 0.0) / 32))  # within a second
        (tmp_path / "new").replace(tmp_path / name)
        if k is None:
            until(lambda: "SyntaxError: invalid syntax (watch_beside.py, line 1)" in "".join(told))
        else:
            until(lambda k=k: [s.params["k"].value for s in played][-1:] == [k])


OWN = """
from dataclasses import dataclass
from typing import NamedTuple
from stimlib import Block
class Numbers(NamedTuple):
    gain: float
@dataclass(frozen=True, eq=False)
class Twice(Block):
    x: Block
    def units(self, x):
        return x
    def design(self, fs):
        return Numbers(2.0), ()
    @staticmethod
    def step(p, s, x):
        return p.gain * x + 1.0, s
"""


def test_a_class_of_ones_own_may_change(watched):
    """Its step is compiled anew, and the version before goes on with its own."""
    file, played, told = watched
    text = SCENE.replace("def scene", OWN + "def scene").replace(
        'Input("x", "m")', 'Twice(Input("x", "m"))'
    )
    x, last = {"x": np.full(800, 0.5)}, []
    for one in ("1.0", "3.0"):
        file.write_text(text.replace("1.0,", f"{one},"))
        scene = until(lambda: played or told)[-1]
        last.append(stimlib.render(scene, x, fs=8000, seconds=0.1)["force"][-1])
        played.clear()
    assert last == [200.0, 400.0] and not told


def test_what_a_version_cannot_do_is_told_and_the_next_one_plays(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "watch_refused.py"
    file.write_text(SCENE)
    played, told = [], []

    def play(scene):
        played.append(scene)
        if len(played) == 1:
            raise StimlibError("it has other outputs")

    with Watched("watch_refused.py:scene", []).reloaded(play, told.append):
        file.write_text(SCENE.replace("100.0", "200.0"))
        until(lambda: told)
        file.write_text(SCENE.replace("100.0", "300.0"))
        until(lambda: len(played) == 2)
    assert told == ["it has other outputs"]
    until(lambda: not any(t.name == "stimlib watch" for t in threading.enumerate()))


def test_play_watches_a_file_and_each_version_has_its_log(tmp_path):
    file = tmp_path / "watch_played.py"
    file.write_text(SCENE)
    words = "play watch_played.py:scene --sink null --full-scale 5 --watch --log a.stimlog"
    process = subprocess.Popen(
        [sys.executable, "-m", "stimlib", *words.split(), "--motion", "sinusoid(0.01, 1)"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        until(lambda: (tmp_path / "a.stimlog").exists() or process.poll() is not None)
        file.write_text(SCENE.replace("100.0", "1000.0"))
        said = ""
        while "limited (clip)" not in said and process.poll() is None:
            said += process.stderr.readline()
        high = '__import__("stimlib.blocks").blocks.lowpass(Input("x", "m"), 9e3)'
        file.write_text(SCENE.replace('Input("x", "m")', high))
        while "plays on" not in said and process.poll() is None:
            said += process.stderr.readline()
    finally:
        process.send_signal(signal.SIGINT)
        out, more = process.communicate()
    assert process.returncode == 130, said + more
    assert re.search(r"plays, \d\.\d\d s after it was saved", said)
    assert re.findall("version .: |log: .*", out) == [
        "version 1: ", "log: a.stimlog", "version 2: ", "log: a-2.stimlog"
    ]  # fmt: skip
    assert re.search(r"watch_played\.py:4: lowpass: .*fs/2.* the version before plays on", said)
    assert "note: force is limited (clip) from here on" in said
    logs = [read_log(tmp_path / name) for name in ("a.stimlog", "a-2.stimlog")]
    assert all(replay(log).matches for log in logs)
    (after,) = [e for e in logs[0].events if e.kind == "stop"]
    assert after.data["reason"] == "next" and logs[1].scene.params["k"].value == 1000.0
    seconds = (after.at + logs[1].frames) / 8000  # the fade, in which both play, is there once
    assert f"played {seconds:.4g} s, nothing lost" in out


def test_each_version_plays_as_the_command_says(tmp_path, monkeypatch):
    """Its seed, markers and --set, for the time left; one that fails ends alone."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "watch_given.py").write_text(SCENE)
    x = Param("more", 100.0, "N/m") * Input("x", "m")
    failures, left, turns, plays = [], [], [], []

    def wait(sink, seconds, wait=Sink.wait):
        if not turns:  # while the first is waited for
            plays[0](Scene({"force": x * sqrt(1 - constant(1e3, "1/s") * elapsed())}))
            threading.Thread(target=corrected, args=plays).start()
        turns.append(sink.newest.finished)
        wait(sink, seconds)

    monkeypatch.setattr(Sink, "wait", wait)
    monkeypatch.setattr("stimlib.cli.play.failed", failures.append)

    def corrected(played):
        until(lambda: any(turns))  # what has failed has faded out, and it goes on
        played(Scene({"force": x}))
        newest = max(open_sinks, key=lambda s: s.since)
        left.append(newest.pump.read("END"))
        until(lambda: newest.pump.index > 400)
        newest.stop()

    @contextmanager
    def saved(watched, played):
        plays.append(played)
        yield

    monkeypatch.setattr(Watched, "reloaded", saved)
    words = "play watch_given.py:scene --watch --sink null --full-scale 5 --seconds 600"
    words += " --log a.stimlog --seed 7 --marker force --set k=80 --motion sinusoid(0.01,1,0.02)"
    ran(words, 1, "--set k=80: this version has no such parameter")
    assert re.search("not finite .*; save the file again to go on", failures[0])
    assert len(failures) == 2 and left[0] < 600 * 8000  # told at the end, too
    logs = [read_log(tmp_path / f"a{more}.stimlog") for more in ("", "-2", "-3")]
    assert {log.seed for log in logs} == {7}
    assert all("mark" in {e.kind for e in log.events} for log in logs[::2])


def test_time_goes_on_after_a_version_that_failed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    x = 'Input("x", "m")'
    text = SCENE.replace(x, f'{x} * sqrt({x} / constant(-1.0, "m"))')
    head = "from stimlib import constant\nfrom stimlib.blocks import sqrt\n"
    (tmp_path / "watch_failed.py").write_text(head + text)
    clock = SimpleNamespace(monotonic=count(step=100.0).__next__, sleep=lambda seconds: None)
    monkeypatch.setattr("stimlib.cli.play.time", clock)

    def start(sink, seconds, start=Sink.start):  # a busy machine asks when it has faded out
        start(sink, seconds)
        until(lambda: sink.finished)

    monkeypatch.setattr(Sink, "start", start)
    words = "play watch_failed.py:scene --watch --sink null --full-scale 5 --seconds 600"
    ran(f"{words} --motion sinusoid(0.01,1,0.02)", 1, "save the file again")


@pytest.mark.parametrize(
    "words, why",
    [
        ("play tone --watch --sink null", "--watch: a scene of your own"),
        ("play a.py:scene --watch --fast", "without --fast"),
    ],
)
def test_what_cannot_be_watched_is_told(words, why):
    ran(words, 2, why)
