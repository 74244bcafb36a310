"""Processes killed outright, at random moments: what they leave reads and is right up
to its end, seconds before the kill.
"""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from laws import STRESS

import stimlib
from stimlib import Input, Scene, constant
from stimlib.blocks import white_noise
from stimlib.checks.session import verify_log
from stimlib.devices.null import NullSink
from stimlib.errors import SinkError
from stimlib.files import audio as file
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import delivered, replay
from stimlib.files.log_writer import LogWriter, header
from stimlib.motion.generators import sinusoid
from stimlib.run.safety import GAIN, Safety, protect, to_device

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
HAND = sinusoid(0.02, 3.0)
RNG = random.Random(7)
KILLS = 20 if STRESS else 1


def scene():
    force = constant(1000.0, "N/m") * Input("x", "m")
    return Scene({"force": force, "noisy": force + constant(5.0, "N") * white_noise(seed=7)})


def child(call, *args):
    """A function of this file in a process of its own, which says when it begins and
    how far it is.
    """
    me = Path(__file__)
    code = (
        f"import sys; sys.path[:0] = {[str(p) for p in me.parents[:2]]}; import {me.stem} as t;"
        f" t.{call.__name__}(*{args!r})"
    )
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)


def killed_after(seconds, call, *args):
    """Run it, kill it so many seconds after it began, and give the last number it
    said.
    """
    with child(call, *args) as job:
        try:
            assert job.stdout.readline() == "go\n"
            time.sleep(seconds)
            assert job.poll() is None, "it ended before it was killed"
        finally:
            job.kill()
        said = job.stdout.read().splitlines(keepends=True)
        assert job.wait() == -signal.SIGKILL
    whole = [int(line) for line in said if line.endswith("\n")]
    return whole[-1] if whole else 0


# -- the file sink


def write_fast(path, subtype):
    proc = stimlib.compile(scene(), 8000.0, seed=3)
    print("go", flush=True)
    for _ in range(1000):
        proc.reset()
        file.write(path, proc, {"x": HAND}, 20.0, subtype=subtype, full_scale=64.0)


@pytest.mark.parametrize(("format", "subtype"), [("WAV", "FLOAT"), ("FLAC", "PCM_24")])
@pytest.mark.longer
def test_whenever_it_is_killed_the_file_is_whole_or_refused(tmp_path, format, subtype):
    def written(path):
        proc = stimlib.compile(scene(), 8000.0, seed=3)
        file.write(path, proc, {"x": HAND}, 20.0, subtype=subtype, full_scale=64.0)
        return file.read(path)[0]

    wanted = written(tmp_path / f"wanted.{format.lower()}")
    for trial in range(KILLS):
        path = tmp_path / f"{trial}.{format.lower()}"
        killed_after(RNG.uniform(0.0, 0.3), write_fast, str(path), subtype)
        try:
            assert np.array_equal(file.read(path)[0], wanted)
        except SinkError as e:
            assert "there is no file" in str(e) or "sidecar" in str(e)
        assert np.array_equal(written(path), wanted)  # what is left is in nobody's way


# -- the log


def session(folder, inputs):
    """A session at the pace of the clock, in odd blocks, with changes and losses; says
    the samples delivered.
    """
    made = (
        stimlib.scenes.squeeze(fingers=2)
        if inputs
        else Scene({"noise": constant(3.0, "N") * white_noise(seed=1)})
    )
    safety, rng = Safety(full_scale=50.0), np.random.default_rng(3)
    proc = stimlib.compile(protect(made, safety), 8000.0, seed=4)
    channels = list(range(len(proc.outputs)))
    proc.process(np.zeros((len(proc.inputs), 0)))
    with LogWriter(folder, header(made, safety, 8000.0, seed=4)) as log:
        proc.set(GAIN, 1.0, 160 / 8000)
        log.event(0, "set", name=GAIN, value=1.0, ramp=160)
        print("go", flush=True)
        began, at = time.monotonic(), 0
        while True:
            n = int(rng.integers(1, 200))
            time.sleep(max(0.0, began + (at + n) / 8000 - time.monotonic()))
            if inputs and rng.random() < 0.1:
                value, ramp = float(rng.uniform(500, 2000)), int(rng.integers(1, 400))
                proc.set("k", value, ramp / 8000)
                log.event(at, "set", name="k", value=value, ramp=ramp)
            x = (
                np.stack([HAND(np.arange(at, at + n) / 8000) + 0.03] * len(proc.inputs))
                if inputs
                else np.empty((0, n))
            )
            log.motion(x)
            frames = to_device(proc.process(x), safety.scales(proc.outputs), channels)
            if rng.random() < 0.05:
                log.event(at, "lost", frames=n)
            else:
                log.delivered(frames)
            at += n
            print(at, flush=True)


def play(folder):
    """A real sink at the pace of the clock."""
    hand = {"x1": HAND, "x2": HAND}
    with NullSink(
        stimlib.scenes.squeeze(), 50.0, realtime=False, motion=hand, log=folder, seed=4
    ) as sink:
        sink.open(8000, block=64)
        print("go", flush=True)
        sink.start()
        while True:
            sink.set("k", float(RNG.uniform(500, 2000)), ramp=RNG.uniform(0, 0.1))
            time.sleep(RNG.uniform(0, 0.1))
            print(sink.report().produced, flush=True)


@pytest.mark.longer
def test_a_killed_sink_leaves_a_log_that_is_verified(tmp_path):
    for trial in range(KILLS):
        folder = tmp_path / f"{trial}.stimlog"
        played = killed_after(RNG.uniform(0.3, 0.6), play, str(folder))
        log = read_log(folder)
        found = replay(log)
        assert found.matches and found.missing == 0, str(found)
        assert played - found.frames <= 8000, (played, found.frames)
        if found.frames:
            report = verify_log(log, stimlib.scenes.squeeze())
            assert report.passed, str(report)


@pytest.mark.parametrize("inputs", [True, False])
@pytest.mark.longer
def test_a_killed_session_replays_up_to_its_last_second(tmp_path, inputs):
    for trial in range(KILLS):
        folder = tmp_path / f"{trial}.stimlog"
        played = killed_after(RNG.uniform(0.3, 1.5), session, str(folder), inputs)
        log = read_log(folder)
        found = replay(log)
        assert found.matches and found.spans == len(log.spans), str(found)
        assert 0 <= played - found.frames <= 8000 * 0.26 + 400 or found.frames > played
        assert log.report is None and "no report: the session was killed" in " ".join(log.notes)
        if inputs:
            assert any(c.name == "k" for c in log.changes) or found.frames < 4000
            assert np.array_equal(log.motion[:, 0], HAND(np.arange(len(log.motion)) / 8000) + 0.03)
            assert len(log.motion) >= played
        assert sum(len(f) for _, f, given in delivered(log) if given) == found.frames - found.lost
