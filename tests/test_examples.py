"""The examples are complete programs: they run from any folder and print what the user guide says."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"

PRINTED = {
    "first_stimulus.py": (
        "Rendering(force1, force2: 2 s at 8000 Hz)\n"
        "force1: largest 40.00 N, vibration 14.13 mN rms\n"
        "force2: largest 40.00 N, vibration 14.29 mN rms\n"
    ),
    "own_block.py": (
        "force after 50 ms: 20.0000 N\ncompiled and reference samples are equal, bit for bit\ngain at 50 Hz: -3.01 dB\n"
    ),
}


def run(name: str, folder: Path, *options: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-W", "error", str(EXAMPLES / name), *options]
    path = os.pathsep.join(p for p in (str(EXAMPLES.parent), os.environ.get("PYTHONPATH")) if p)
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=120, env={**os.environ, "PYTHONPATH": path}
    )


def test_every_example_is_tested():
    assert set(PRINTED) == {p.name for p in EXAMPLES.glob("*.py")}


@pytest.mark.parametrize("name", PRINTED)
def test_example_prints_its_result(name, tmp_path):
    done = run(name, tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, PRINTED[name], "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", PRINTED)
def test_example_plots_only_when_asked(name, tmp_path):
    done = run(name, tmp_path, "--plot", "picture.png")
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
