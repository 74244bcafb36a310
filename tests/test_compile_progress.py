"""The progress bar over what is compiled: in a terminal, and only the first time."""

import os
import pty
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import pytest

import stimlib
from stimlib.cli.app import friendly
from stimlib.core.graph import Block
from stimlib.devices.engine import PUMP, native
from stimlib.system import cache_folder
from stimlib.system.progress import compiling, counted, progress
from stimlib.targets.llvm import cache, engine, segments

ROOT = Path(__file__).parent.parent
OWN = """
import stimlib
def level():
    return stimlib.Scene({"y": stimlib.constant(0.5)})
"""


@pytest.fixture
def caches(tmp_path):
    """Two that only have the runtime and the pump."""
    folders = [tmp_path / name for name in ("looked", "quiet")]
    engine.runtime()
    native()
    for piece in (engine.RUNTIME, PUMP):
        name = cache._name(*piece)
        for folder in folders:
            folder.mkdir(mode=0o700, exist_ok=True)
            shutil.copy(cache.folder() / name, folder)
    (tmp_path / "own.py").write_text(OWN)
    return folders


def in_terminal(folder, *more):
    """Return what a command that compiles into a cache shows in a terminal."""
    own = f"{folder.parent}/own.py:level", *"--sink null --fast --seconds 0.1".split()
    env = {"STIMLIB_CACHE": str(folder), "PYTHONPATH": str(ROOT), "TERM": "xterm", "COLUMNS": "100"}
    words = [sys.executable, "-m", "stimlib", "play", *own, *more]
    here, there = pty.openpty()
    with subprocess.Popen(words, env=os.environ | env, stdout=there, stderr=there) as run:
        os.close(there)
        shown = b""
        with suppress(OSError):  # the end of a terminal
            while part := os.read(here, 65536):
                shown += part
        os.close(here)
    assert run.returncode == 0, shown
    return shown.decode()


def test_play_shows_a_bar_over_what_it_compiles_the_first_time(caches):
    looked, quiet = caches
    shown = in_terminal(looked)
    before, _, rest = shown.partition("playing;")
    percent = [int(p) for p in re.findall(r"compiling .*?(\d+)%", before)]
    assert percent == sorted(percent) and percent[0] < 50 and percent[-1] == 100, shown
    assert "compiling" not in rest and "100 delivered" not in before
    shown = in_terminal(quiet, "--quiet")
    assert not re.search("compiling|playing;", shown), "nobody wants it"


@pytest.mark.parametrize(
    ("looked_at", "wanted", "lines", "bar"),
    [
        (True, True, 5, True),
        (True, True, 0, False),
        (True, False, 5, False),
        (False, True, 5, False),
    ],
)
def test_a_bar_is_there_where_something_is_compiled_and_somebody_looks(
    monkeypatch, capsys, looked_at, wanted, lines, bar
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: looked_at)
    with compiling(wanted):
        for told in ((lines, 0), (0, lines)):
            for tell in counted:
                tell(*told)
    assert ("compiling" in capsys.readouterr().err) == bar and not counted


@dataclass(frozen=True, eq=False)
class Cubed(Block):
    """The cube of an input, which no other test compiles."""

    x: Block

    @staticmethod
    def step(p, s, x):
        return x * x * x + 0.0, s


def test_the_lines_that_are_expected_are_those_that_are_compiled(tmp_path, monkeypatch):
    stimlib.compile(stimlib.Scene({"y": stimlib.Input("x")}), 1000)  # what every scene has
    monkeypatch.setenv("STIMLIB_CACHE", str(tmp_path / "new"))
    monkeypatch.setattr(cache_folder, "_folder", None)
    seen = []
    monkeypatch.setattr(cache, "counted", [lambda *lines: seen.append(lines)])
    scene = stimlib.Scene({"y": Cubed(stimlib.Input("x"))})
    with mock.patch.object(segments, "load", wraps=cache.load) as load:
        stimlib.compile(scene, 1000)
    lines = {c.args[1]: c.args[0] for c in load.call_args_list}["Cubed"].count("\n")
    assert lines > 5 and seen == [(lines, 0), (0, lines)]
    stimlib.compile(scene, 1000)
    assert seen[2:] == [(0, 0)], "nothing is compiled again"


def test_what_an_empty_cache_compiles_is_said_once_before(tmp_path, monkeypatch, capsys):
    """The words come before the text runs, which is what takes long; of a block class
    there are none.
    """
    monkeypatch.setenv("STIMLIB_CACHE", str(tmp_path / "empty"))
    monkeypatch.setattr(cache_folder, "_folder", None)
    seen = "import sys; print('running', file=sys.stderr)"
    with friendly():
        cache.load("x = 1", "Add")
        assert capsys.readouterr().err == ""
        cache.load(seen, "runtime")
        cache.load(seen, "pump")
    said = capsys.readouterr().err.splitlines()
    assert said == ["compiling for this machine, once: about two seconds", "running", "running"]
    cache.load(f"{seen} # again", "pump")
    assert capsys.readouterr().err == "running\n", "nobody is told outside of a command"


@pytest.mark.parametrize("known", [None, 3])
def test_steps_that_are_found_on_the_way_count(known, capsys):
    with progress("rows", known, "always") as advance:
        advance(1, more=2)
    assert ("50%" if known is None else "20%") in capsys.readouterr().err
