"""What a design costs is bounded, whatever its numbers and the sample rate are
(``tests/extremes.py`` has the cases).
"""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from laws import STRESS, refuses

import stimlib
from stimlib import blocks as b

HERE = os.path.dirname(__file__)


def test_every_design_ends_in_time_with_a_processor_or_a_reason():
    """All blocks, each number at its ends, from 1e-3 to 1e9 Hz: a sample of them here,
    a larger one in make stress.
    """
    run = subprocess.run(
        [sys.executable, os.path.join(HERE, "extremes.py"), "13" if STRESS else "1201", "0"],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    lines = run.stdout.splitlines()
    wrong = [
        f"{case} {what}" for case, what in zip(lines, lines[1:], strict=False) if "-> WRONG" in what
    ]
    assert not wrong, "\n".join(wrong[:20])
    assert lines[-1] == "done", f"ended by {run.returncode} in {lines[-1]}\n{run.stderr[-2000:]}"
    assert len(lines) > 50


@pytest.mark.parametrize(
    ("make", "fs", "words"),
    [
        (
            lambda: b.playback([1.0], 9e3, True, at=stimlib.Input("x", "s")),
            1.0,
            "playback: .*rate = 9000 Hz, .*raise fs",
        ),
        (lambda: b.playback(np.ones(1000), rate=0.1), 9e3, "playback: operations"),
        (lambda: b.grain(b.every(1.0), np.ones(1000), rate=1.0), 5e4, "grain: operations"),
        (lambda: b.oscillator(100.0), 1e9, "before sample 0 at fs = 1e[+]09 Hz; lower fs"),
        (
            lambda: b.differentiator(stimlib.Input("x"), 1e5, 1.01e5, order=8, tol=1e-9),
            3e5,
            "the order is near [0-9]+",
        ),
    ],
)
def test_work_is_refused_before_it_begins(make, fs, words, monkeypatch):
    monkeypatch.setattr(stimlib.limits, "design_work", 1e8)
    refuses(make(), f"{words}.*limits.design_work", fs=fs)


@pytest.mark.parametrize(
    ("make", "fs", "target"),
    [
        ("b.playback(np.ones(5_000_000), rate=44100.1)", 48e3, "python"),
        # 29 million samples before sample 0: ten seconds
        pytest.param(
            "b.fir(b.white_noise(2), np.ones(8000))", 9e8, "llvm", marks=pytest.mark.stress
        ),
    ],
)
def test_a_long_design_can_be_interrupted(make, fs, target):
    code = (
        "import numpy as np, stimlib; from stimlib import blocks as b\n"
        f"scene = stimlib.Scene({{'y': {make}}})\n"
        f"if {target!r} == 'llvm': stimlib.compile(scene, 1e6)\n"
        "try:\n"
        "    print('now', flush=True)\n"
        f"    stimlib.compile(scene, {fs}, {target!r})\n"
        "except KeyboardInterrupt: print('interrupted')\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "now\n"
    time.sleep(0.1)  # it is in the design, or before: either ends
    child.send_signal(signal.SIGINT)
    assert child.communicate()[0] == "interrupted\n"
