"""End programs that have workers in many ways, and count the workers that are left
after 3 s.

PYTHONPATH=tests python tests/stress/ends.py [ENDS]

Each of ENDS programs (50) starts four workers, each of which does one of the things of
tests/test_pool.py that make a process hard to end.  The program then ends itself in one
of eleven ways, or a signal comes from outside at a random moment, also while the
workers are still starting.  Needs /proc.  Prints a line for each end, and exits with
status 1 where a worker was left.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from test_pool import DRIVER, ENDS, STUCK

NAMES = (
    STUCK.partition("NAMES = [f.__name__ for f in (")[2]
    .partition(")]")[0]
    .replace("\n", " ")
    .split(",")
)
SECONDS = 3.0  # that the workers have
OUTSIDE = signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP
MARK = "STIMLIB_END_OF"  # an environment variable, which all processes below a program inherit


def left(mark):
    """Return what still runs of a program's workers and their watchdog: process ID and
    command.
    """
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            zombie = (folder / "stat").read_text().rpartition(")")[2].split()[0] == "Z"
            command = (
                (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            )
            if (
                f"{MARK}={mark}\0".encode() in (folder / "environ").read_bytes()
                and not zombie
                and "driver.py" not in command
            ):
                found[int(folder.name)] = command
        except OSError:  # it has ended meanwhile, or is somebody else's
            pass
    return found


def ended(at, chance):
    """Let a program end; return how it ended, what its workers did, and what is left of
    them after how many seconds.
    """
    names = [name.strip() for name in chance.sample(NAMES, 4)]
    outside = chance.random() < 0.5
    way = chance.choice(OUTSIDE) if outside else chance.choice(list(ENDS))
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / "stuck.py").write_text(f"{STUCK}\nNAMES = {names!r}\n")
        (folder / "driver.py").write_text(DRIVER)
        (folder / "out").mkdir()
        command = [
            sys.executable,
            folder / "driver.py",
            folder / "out",
            "time.sleep(60)" if outside else ENDS[way],
        ]
        env = os.environ | {MARK: str(at), "PYTHONPATH": os.pathsep.join(sys.path)}
        with subprocess.Popen(
            command, env=env, stderr=subprocess.DEVNULL, start_new_session=True
        ) as driver:
            if outside:
                time.sleep(chance.uniform(0.3, 4.0))
                driver.send_signal(way)
            driver.wait()
            began = time.monotonic()
        while (still := left(at)) and time.monotonic() < began + SECONDS:
            time.sleep(0.05)
        seconds = time.monotonic() - began
        for pid in still:
            os.kill(pid, signal.SIGKILL)
    return f"{way.name} from outside" if outside else way, names, still, seconds


def main(ends=50, seed=1):
    """Run all; print what was left."""
    chance, orphans, longest = random.Random(seed), 0, 0.0
    for at in range(ends):
        how, names, still, seconds = ended(f"{os.getpid()}.{at}", chance)
        orphans, longest = orphans + bool(still), max(longest, seconds)
        became = f"LEFT: {still}" if still else f"gone after {seconds:.2f} s"
        print(f"{at + 1:3d} {how}; workers: {', '.join(names)}; {became}", flush=True)
    print(
        f"{orphans} of {ends} ends left a worker after {SECONDS:g} s; the longest took"
        f" {longest:.2f} s"
    )
    return orphans > 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
