"""What a user does from composing to an experiment, step by step.

``python flow.py FOLDER [NAME..]`` prints a line for each of these steps, or for all:
its name, and its error.
"""

import contextlib
import io
import os
import subprocess
import sys
import time
import traceback
from pathlib import Path

SCENE = """\
import stimlib


def spring():
    return stimlib.Scene({"force": stimlib.Param("k", 500.0, "N/m") * stimlib.Input("x", "m")})
"""
EXPERIMENT = """\
from spring import spring
from stimlib.experiments import (
    ConstantStimuli, Experiment, PsychometricObserver, Stimulus, Timing, TwoInterval, choice,
)
from stimlib.motion import minimum_jerk

task = TwoInterval(
    "springs", "harder", Stimulus("spring", {"k": 300.0}), Stimulus("spring"), varies="k"
)
harder = Experiment(
    "harder",
    "1",
    {"spring": spring()},
    ConstantStimuli(((task, 200.0), (task, 400.0))),
    (choice("harder", "Which one felt harder?", "first", "second"),),
    fs=1000.0,
    safety=20.0,
    bounds={"k": (100.0, 500.0)},
    motion={"x": minimum_jerk(depth=0.02)},
    timing=Timing(before=0.1, interval=0.2, gap=0.1, ramp=0.02),
    observer=PsychometricObserver(pse=300.0, sigma=30.0),
)
"""


def compose():
    global scene, motion
    import stimlib

    sys.path.insert(0, os.getcwd())
    Path("spring.py").write_text(SCENE, encoding="utf-8")
    from spring import spring

    scene, motion = spring(), {"x": stimlib.motion.minimum_jerk(depth=0.02)}
    scene.save("scene.json")
    assert stimlib.load("scene.json").hash == scene.hash


def compile_and_render():
    global rendering
    import numpy as np

    import stimlib

    rendering = stimlib.render(scene, motion, fs=1000, seconds=0.5)
    slow = stimlib.compile(scene, fs=1000, target="python")
    assert np.array_equal(slow.process(np.full((1, 8), 0.01)), np.full((1, 8), 5.0))
    assert abs(rendering["force"].max() - 10.0) < 1e-3


def save_and_read():
    import pytest

    from stimlib.errors import SinkError
    from stimlib.files import read

    names = "a.wav", "a.flac", "a.caf"
    for name in (*names, *names):  # the second replaces the first
        rendering.save(name, full_scale=50.0, overwrite=True)
        assert abs(read(name)[0][0] - rendering["force"]).max() < 1e-5
    rendering.save("new.wav", full_scale=50.0, overwrite=False)
    with pytest.raises(SinkError, match="overwrite=False"):
        rendering.save("new.wav", full_scale=50.0, overwrite=False)
    there = sorted([*names, *(f"{name}.json" for name in names)])
    assert sorted(p.name for p in Path().glob("a.*")) == there
    if os.environ["STIMLIB_AS"] == "windows":
        with pytest.raises(SinkError):
            rendering.save("nul.wav", full_scale=50.0)


def verify():
    import stimlib

    assert stimlib.verify("a.wav").passed
    stimlib.verify(scene, motion, rendering).to_html("report.html")
    assert Path("report.html").stat().st_size > 10_000


def log_and_replay():
    from stimlib.checks import verify_log
    from stimlib.devices import NullSink
    from stimlib.files import read_log, replay

    for clocked in (False, True):
        folder = Path(f"clocked-{clocked}.stimlog")
        with NullSink(scene, 50.0, motion=motion, clocked=clocked, log=folder) as sink:
            sink.open(1000, block=250)
            sink.start(seconds=0.5)
            sink.wait()
        log = read_log(folder)
        assert replay(log, folder.with_suffix(".wav")).matches
        assert verify_log(log).passed
        assert sink.report().produced == 500


def sweep():
    from stimlib.sweep import sweep

    how = {"measures": ["peak"], "motion": motion, "fs": 1000, "seconds": 0.5, "out": "swept"}
    for _ in range(2):  # the second finds all rows
        table = sweep(scene, {"k": [100.0, 200.0]}, workers=2, **how)
    assert [round(v, 6) for v in table["peak_force"].to_pylist()] == [2.0, 4.0]


SLOW = """\
import os
import time

import stimlib
from stimlib.sweep import measure, sweep


@measure("s")
def slow(result):
    with open(f"worker-{os.getpid()}", "w"):
        time.sleep(300)
    return 0.0


scene = stimlib.Scene({"y": stimlib.Param("k", 1.0) * stimlib.blocks.elapsed()})
if __name__ == "__main__":
    sweep(scene, {"k": [1.0, 2.0]}, measures=slow, motion={}, fs=1000, seconds=0.1, workers=2)
"""


def sweep_whose_driver_is_killed():
    Path("slow.py").write_text(SLOW, encoding="utf-8")
    driver = subprocess.Popen([sys.executable, "slow.py"])
    while not (workers := [p.name[7:] for p in Path().glob("worker-*")]):
        assert driver.poll() is None
        time.sleep(0.1)
    driver.kill()
    driver.wait()
    while any(os.path.exists(f"/proc/{pid}") for pid in workers):  # test_systems.py ends a hang
        time.sleep(0.1)


def session():
    Path("harder.py").write_text(EXPERIMENT, encoding="utf-8")
    from harder import harder

    from stimlib.experiments import Session, Simulated, run

    with Session(harder, "data", "P1") as s:
        run(s, Simulated(s, harder.observer), "null")
        assert len(s.records) == 2


def session_in_a_terminal():
    from harder import harder

    from stimlib.cli import terminal
    from stimlib.experiments import Session, run

    if os.environ["STIMLIB_AS"] != "windows":
        return
    # a key to begin each trial, and its answer
    sys.modules["msvcrt"].getwch = iter(" 1 2").__next__
    sys.modules["msvcrt"].kbhit = lambda: False
    with Session(harder, "people", "P2") as s:  # apart from the simulated one
        run(s, terminal.Terminal(0), "offline")
        assert [list(r.answer.values.values()) for r in s.records] == [["first"], ["second"]]


def command_line():
    from commands import ran

    for name in ("spring", "harder"):  # as at its start, which knows no file of a user
        del sys.modules[name]
    ran("render spring.py:spring --motion minimum_jerk(depth=0.02) --seconds 1 --out b.wav")
    ran("verify b.wav --report b.html")
    ran("play b.wav --full-scale 50 --fast --log b.stimlog")
    ran("replay b.stimlog --out c.wav")
    ran("experiment status harder.py:harder --data data")
    ran("sweep spring.py:spring --axis k=1:2:2 --motion minimum_jerk() --seconds 0.1 --workers 1")
    start = [sys.executable, "-m", "stimlib", "devices"]
    done = subprocess.run(start, capture_output=True)
    assert done.returncode == 0, (done.stdout[-400:], done.stderr[-1500:])


STEPS = (
    compose, compile_and_render, save_and_read, verify, log_and_replay, sweep,
    sweep_whose_driver_is_killed, session, session_in_a_terminal, command_line,
)  # fmt: skip

if __name__ == "__main__":
    os.chdir(sys.argv[1])
    failed, names = 0, sys.argv[2:] or [step.__name__ for step in STEPS]
    for step in [step for step in STEPS if step.__name__ in names]:
        error = ""
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                step()
        except BaseException:
            error = traceback.format_exc()[-1200:].replace("\n", " | ")
            failed = 1
        print(step.__name__, error, flush=True)
    sys.exit(failed)
