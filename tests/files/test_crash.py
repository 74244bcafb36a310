"""Processes killed outright, at random moments: what they leave reads and is right up
to its end, seconds before the kill.
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
from stimlib.checks.session import verify_log
from stimlib.devices.null import NullSink
from stimlib.errors import SinkError
from stimlib.files import audio as file
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import delivered, replay
from stimlib.motion.generators import sinusoid

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
HAND = sinusoid(0.02, 3.0)
RNG = random.Random(7)
KILLS = 20 if STRESS else 1


FORCE = constant(1000.0, "N/m") * Input("x", "m")
NOISE = constant(5.0, "N") * white_noise(seed=7)
SCENE = Scene({"force": FORCE, "noisy": FORCE + NOISE})


def killed_after(seconds, call, *args):
    """Run a function of this file in a process of its own, kill it so many seconds
    after it began, and give the last number it said.
    """
    me = Path(__file__)
    code = f"import sys; sys.path[:0] = {[str(p) for p in me.parents[:2]]}; import {me.stem} as t;"
    code += f" t.{call.__name__}(*{args!r})"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as job:
        try:
            assert job.stdout.readline() == "go\n"
            time.sleep(seconds)
            assert job.poll() is None, "it ended before it was killed"
        finally:
            job.kill()
        said = job.stdout.read().splitlines(keepends=True)
        assert job.wait() == -signal.SIGKILL
    return max([0, *(int(line) for line in said if line.endswith("\n"))])


# -- the file sink


def write_fast(path, subtype):
    proc = stimlib.compile(SCENE, 8000.0, seed=3)
    print("go", flush=True)
    for _ in range(1000):
        proc.reset()
        file.write(path, proc, {"x": HAND}, 20.0, subtype=subtype, full_scale=64.0)


@pytest.mark.parametrize("kind", mostly(["FLAC PCM_24"], ["FLAC PCM_24", "WAV FLOAT"]))
@pytest.mark.longer
def test_whenever_it_is_killed_the_file_is_whole_or_refused(tmp_path, kind):
    format, subtype = kind.split()

    def written(path):
        proc = stimlib.compile(SCENE, 8000.0, seed=3)
        file.write(path, proc, {"x": HAND}, 20.0, subtype=subtype, full_scale=64.0)
        return file.read(path)[0]

    wanted = written(tmp_path / f"wanted.{format.lower()}")
    for trial in range(KILLS):
        path = tmp_path / f"{trial}.{format.lower()}"
        killed_after(RNG.uniform(0.0, 0.3), write_fast, str(path), subtype)
        left = {p.name for p in tmp_path.glob(f"{trial}.*")} - {path.name, f"{path.name}.json"}
        assert all(re.search(r"\.\d+-[0-9a-f]{8}\.(json\.)?part$", name) for name in left)
        try:
            assert np.array_equal(file.read(path)[0], wanted)
        except SinkError as e:
            assert "there is no file" in str(e) or "sidecar" in str(e)
        assert np.array_equal(written(path), wanted)  # what is left is in nobody's way


# -- the log


MADE = {"hands": stimlib.scenes.squeeze(), "noise": Scene({"noise": NOISE})}


def play(folder, name):
    """A real sink at the pace of the clock, which says the samples produced."""
    how = {"motion": {"x1": HAND, "x2": HAND}} if name == "hands" else {}
    with NullSink(MADE[name], 50.0, realtime=False, log=folder, seed=4, **how) as sink:
        sink.open(8000, block=64)
        print("go", flush=True)
        sink.start()
        while True:
            if name == "hands":
                sink.set("k", float(RNG.uniform(500, 2000)), ramp=RNG.uniform(0, 0.1))
            time.sleep(RNG.uniform(0, 0.1))
            print(sink.report().produced, flush=True)


@pytest.mark.parametrize("name", MADE)
@pytest.mark.longer
def test_a_killed_sink_leaves_a_log_that_is_verified(tmp_path, name):
    for trial in range(KILLS):
        folder = tmp_path / f"{trial}.stimlog"
        played = killed_after(RNG.uniform(0.3, 0.6), play, str(folder), name)
        log = read_log(folder)
        found = replay(log)
        assert found.matches and found.missing == 0 and found.spans == len(log.spans), str(found)
        assert played - found.frames <= 8000, (played, found.frames)
        assert log.report is None and "no report" in " ".join(log.notes)
        assert sum(len(f) for _, f, given in delivered(log) if given) == found.frames - found.lost
        if found.frames:
            report = verify_log(log, MADE[name])
            assert report.passed, str(report)
