"""The progress bar over what is compiled: in a terminal, and only the first time."""

import os
import pty
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

import stimlib
from stimlib.core.graph import Block
from stimlib.devices.engine import PUMP, _native
from stimlib.system import cache_folder
from stimlib.targets.numba import cache, engine

ROOT = Path(__file__).parent.parent
OWN = """
import stimlib
def level():
    return stimlib.Scene({"y": stimlib.constant(0.5)})
"""


@pytest.fixture
def words(tmp_path):
    """A command, and a cache that only has the runtime and the pump."""
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    engine.runtime()
    _native()
    for piece in (engine.RUNTIME, PUMP):
        name = cache._name(*piece)
        shutil.copytree(cache.folder() / name, folder / name)
    (tmp_path / "own.py").write_text(OWN)
    play = f"-m stimlib play {tmp_path}/own.py:level --sink null --fast --seconds 0.1"
    return [sys.executable, *play.split()]


def environment(tmp_path):
    return os.environ | {
        "STIMLIB_CACHE": str(tmp_path / "cache"),
        "PYTHONPATH": str(ROOT),
        "TERM": "xterm",
        "COLUMNS": "100",
    }


def in_terminal(words, tmp_path):
    """Return what a command shows in a terminal."""
    here, there = pty.openpty()
    with subprocess.Popen(words, stdout=there, stderr=there, env=environment(tmp_path)) as run:
        os.close(there)
        shown = b""
        try:
            while part := os.read(here, 65536):
                shown += part
        except OSError:  # the end of a terminal
            pass
        os.close(here)
    assert run.returncode == 0, shown
    return shown.decode()


def test_play_shows_a_bar_over_what_it_compiles_the_first_time(words, tmp_path):
    shown = in_terminal(words, tmp_path)
    compiling, _, playing = shown.partition("playing;")
    percent = [int(p) for p in re.findall(r"compiling .*?(\d+)%", compiling)]
    assert percent and percent == sorted(percent) and percent[0] < 50, shown
    assert percent[-1] == 100, shown
    assert "compiling" not in playing and "100 delivered" not in compiling
    again = in_terminal(words, tmp_path)
    assert "compiling" not in again and "playing;" in again, "all is in the cache"


def test_it_is_silent_where_nobody_looks_or_wants_it(words, tmp_path):
    fresh = tmp_path / "cache", tmp_path / "fresh"
    shutil.copytree(*fresh)
    done = subprocess.run(words, capture_output=True, env=environment(tmp_path), check=True)
    assert done.stderr == b""
    assert len(list(fresh[0].iterdir())) > len(list(fresh[1].iterdir())), "nothing was compiled"
    shutil.rmtree(fresh[0])
    fresh[1].rename(fresh[0])
    assert "compiling" not in in_terminal([*words, "--quiet"], tmp_path)


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
    stimlib.compile(scene, 1000)
    (text,) = (tmp_path / "new").glob("Cubed_*/*.py")
    lines = text.read_text().count("\n")
    assert lines > 5 and seen == [(lines, 0), (0, lines)]
    stimlib.compile(scene, 1000)
    assert seen[2:] == [(0, 0)], "nothing is compiled again"
