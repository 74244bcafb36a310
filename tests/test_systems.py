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
from systems import flow

HERE = Path(__file__).parent / "systems"
STEPS = [step.__name__ for step in flow.STEPS]


def environment(system):
    paths = [str(HERE), str(HERE.parent), str(HERE.parents[1]), os.environ.get("PYTHONPATH", "")]
    return os.environ | {"STIMLIB_AS": system, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


@cache
def results(system, folder):
    done = subprocess.run(
        [sys.executable, HERE / "flow.py", folder],
        env=environment(system),
        capture_output=True,
        text=True,
        timeout=600,
    )
    return dict(line.split(" ", 2)[1:] for line in done.stdout.splitlines() if "FAIL" in line) | {
        "steps": [line.split(" ")[1] for line in done.stdout.splitlines()],
        "said": done.stderr,
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("systems")
    for system in ("windows", "macos"):
        (folder / system).mkdir()
    return folder


@pytest.mark.systems
@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="looks at open files in /proc")
@pytest.mark.parametrize("system", ["windows", "macos"])
@pytest.mark.parametrize("step", STEPS)
def test_a_user_gets_through(folder, system, step):
    found = results(system, folder / system)
    assert found.get(step, "") == "", found["said"]
    assert step in found["steps"], found["said"]


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


@pytest.mark.systems
@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="looks at open files in /proc")
def test_the_emulation_refuses_what_windows_has_not(tmp_path):
    how = {"env": environment("windows"), "cwd": tmp_path, "capture_output": True, "text": True}
    done = subprocess.run([sys.executable, "-c", LACKING], **how)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
