"""The programs of the page on PsychoPy, with PsychoPy, on a display of their own.

STIMLIB_PSYCHOPY is a Python that has PsychoPy and what stimlib needs; Xvfb and xdotool
stand for a screen, a mouse and keys.
"""

from __future__ import annotations

import csv
import os
import re
import shutil
import subprocess
import threading
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON = os.environ.get("STIMLIB_PSYCHOPY", "")
pytestmark = [
    pytest.mark.stress,
    pytest.mark.skipif(not PYTHON, reason="STIMLIB_PSYCHOPY: no Python with PsychoPy is given"),
    pytest.mark.skipif(
        not (shutil.which("Xvfb") and shutil.which("xdotool")), reason="no Xvfb or xdotool"
    ),
]


@pytest.fixture
def screen(tmp_path):
    """Run a program of the repository on a new display, with keys pressed meanwhile."""
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "800x600x24"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    display = f":{os.read(read, 20).decode().strip()}"
    env = os.environ | {
        "DISPLAY": display,
        "PYTHONPATH": str(ROOT),
        "LIBGL_ALWAYS_SOFTWARE": "1",
        "OMP_NUM_THREADS": "1",
    }
    over = threading.Event()

    def press(keys):
        height = 0
        while not over.wait(0.1):
            height = (height + 37) % 400
            words = ["xdotool", "mousemove", "400", str(100 + height), "key", *keys]
            subprocess.run(words, env=env, stderr=subprocess.DEVNULL, check=False)

    def run(program, *keys):
        hands = threading.Thread(target=press, args=(keys,)) if keys else None
        if hands:
            hands.start()
        try:
            words = [PYTHON, str(ROOT / program)]
            return subprocess.run(
                words, env=env, cwd=tmp_path, capture_output=True, text=True, timeout=300
            )
        finally:
            over.set()
            if hands:
                hands.join()

    yield run
    server.terminate()
    server.wait()
    os.close(read), os.close(write)


def test_a_trial_under_the_mouse(screen):
    done = screen("examples/psychopy_trial.py", "2")
    assert done.returncode == 0, done.stderr
    lines = re.findall(r"interval (\d): (\d+) N/m, ([\d.]+) mm, ([\d.]+) N", done.stdout)
    assert [line[0] for line in lines] == ["1", "2"] and "answer: 2" in done.stdout
    for _, k, depth, force in lines:
        assert 5.0 < float(depth) <= 20.0
        assert float(force) == pytest.approx(float(k) * float(depth) * 1e-3, rel=0.02)


def test_a_session_on_a_window(screen):
    done = screen("examples/psychopy_session.py", "space", "1")
    assert done.returncode == 0, done.stderr
    assert len(re.findall(r"in \d of 4 trials", done.stdout)) == 3


def test_what_is_seen_and_felt_begins_together(screen):
    done = screen("benchmarks/together.py")
    assert done.returncode == 0, done.stderr
    table = [line for line in done.stdout.splitlines() if line.startswith(("sink,", "null,"))]
    (row,) = csv.DictReader(table)  # PsychoPy warns on stdout
    assert (row["trials"], row["lost"]) == ("200", "0")
    assert abs(float(row["offset_median_ms"])) < 5.0
