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
    "equal_rms_bumps.py": (
        "sine     duty 0.5, A = 4.000 V: 1.000 V rms, rendered 1.000 V\n"
        "sawtooth duty 0.8, A = 3.873 V: 1.000 V rms, rendered 1.000 V\n"
    ),
    "fit_tissue.py": (
        "SpringpotFit(chi=300.6 [299.5, 301.7], alpha=0.1498 [0.1484, 0.1513]; 0.99 % rms of 53 samples)\n"
        "MaxwellFit(k0=151.8 [148.1, 155.6], k1=145.8 [135.3, 157.2], tau1=0.5498 [0.464, 0.6514], k2=99.37 [92.78, 106.4], "
        "tau2=11.45 [9.677, 13.54]; 2.3 % rms of 53 samples)\n"
        "springpot: 0.897 N, after two seconds 0.489 N\narms: 0.768 N, after two seconds 0.480 N\n"
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
