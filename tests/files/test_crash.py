"""A process that writes a file is killed outright, at a random moment.  What a session
leaves then: test_log.py.
"""

import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from laws import STRESS, mostly

import stimlib
from stimlib import Input, Scene, constant
from stimlib.blocks import white_noise
from stimlib.errors import SinkError
from stimlib.files import audio as file
from stimlib.motion.generators import sinusoid

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
FORCE = constant(1000.0, "N/m") * Input("x", "m")
SCENE = Scene({"force": FORCE, "noisy": FORCE + constant(5.0, "N") * white_noise(seed=7)})
KILLS = 20 if STRESS else 1
WRITES = f"""if True:
    import sys
    sys.path[:0] = {[str(folder) for folder in Path(__file__).parents[:2]]}
    from test_crash import SCENE, stimlib, write
    proc = stimlib.compile(SCENE, 8000.0, seed=3)
    print("go", flush=True)
    while True:
        write(sys.argv[1], proc)
"""


def write(path, proc):
    proc.reset()
    file.write(path, proc, {"x": sinusoid(0.02, 3.0)}, 20.0, full_scale=64.0)


@pytest.mark.parametrize("suffix", mostly([".flac"], [".flac", ".wav"]))
@pytest.mark.longer
def test_whenever_it_is_killed_the_file_is_whole_or_refused(tmp_path, suffix):
    proc, chance = stimlib.compile(SCENE, 8000.0, seed=3), random.Random(7)
    write(tmp_path / f"wanted{suffix}", proc)
    wanted, _ = file.read(tmp_path / f"wanted{suffix}")
    for trial in range(KILLS):
        path = tmp_path / f"{trial}{suffix}"
        words = [sys.executable, "-c", WRITES, str(path)]
        with subprocess.Popen(words, stdout=subprocess.PIPE) as job:
            assert job.stdout.readline() == b"go\n"
            time.sleep(chance.uniform(0.0, 0.3))
            job.kill()
        assert job.returncode == -signal.SIGKILL, "it ended before it was killed"
        left = {p.name for p in tmp_path.glob(f"{trial}.*")} - {path.name, f"{path.name}.json"}
        assert all(re.search(r"\.\d+-[0-9a-f]{8}\.(json\.)?part$", name) for name in left)
        try:
            assert np.array_equal(file.read(path)[0], wanted)
        except SinkError as e:
            assert "there is no file" in str(e) or "sidecar" in str(e)
        write(path, proc)  # what is left is in nobody's way
        assert np.array_equal(file.read(path)[0], wanted)
