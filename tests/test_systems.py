"""What a user does, in emulations of Windows and macOS: systems/sitecustomize.py.

No machine with these systems is at hand. The emulation takes away what they lack, so it
sees a name that is not there and an open file that is moved; it does not see what their
C libraries do otherwise.
"""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from laws import STRESS
from systems import flow

HERE = Path(__file__).parent / "systems"
pytestmark = [
    pytest.mark.systems,
    pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="looks at open files in /proc"),
]
STEPS = {"windows": [step.__name__ for step in flow.STEPS]}
# Windows lacks all that macOS lacks; what is left: a POSIX system without priorities
if STRESS:
    STEPS["macos"] = STEPS["windows"]
else:  # sweeps are those of the command line, and one whose driver is killed
    STEPS["windows"].remove("sweep")
    STEPS["macos"] = ["compose", "compile_and_render", "log_and_replay"]


def environment(system):
    paths = [str(HERE), str(HERE.parent), str(HERE.parents[1]), os.environ.get("PYTHONPATH", "")]
    return os.environ | {"STIMLIB_AS": system, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """Gives the errors of the steps of a user on a system, and all that was said."""

    @cache
    def walk(system):
        words = [sys.executable, HERE / "flow.py", tmp_path_factory.mktemp(system), *STEPS[system]]
        how = {"capture_output": True, "text": True, "timeout": 600}
        done = subprocess.run(words, env=environment(system), **how)
        return dict(line.split(" ", 1) for line in done.stdout.splitlines()), done.stderr

    return walk


@pytest.mark.parametrize(("system", "step"), [(s, step) for s in STEPS for step in STEPS[s]])
def test_a_user_gets_through(walked, system, step):
    errors, said = walked(system)
    assert errors.get(step, "it was not reached") == "", said


LACKING = """
import ctypes, os, signal, subprocess
for name in "ab":
    open(name, "x").close()
held = open("a", encoding="utf-8")
for line in (
    "os.pread(0, 1, 0)",
    "import fcntl",
    "import termios",
    "ctypes.CDLL(None)",
    "signal.SIGKILL",
    "os.replace('a', 'c')",
    "os.unlink('a')",
    "os.rename('b', 'a')",
    "os.open('.', os.O_RDONLY)",
    "os.fork()",
    "subprocess.Popen(['true'], pass_fds=[0])",
):
    try:
        exec(line)
    except Exception:
        continue
    print(line)
"""


def test_the_emulation_refuses_what_windows_has_not(tmp_path):
    how = {"env": environment("windows"), "cwd": tmp_path, "capture_output": True, "text": True}
    done = subprocess.run([sys.executable, "-c", LACKING], **how)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
