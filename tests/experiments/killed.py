"""Kill sessions at random moments and resume them: ``python killed.py FOLDER KILLS
SEED``.  Run by test_session.py.

A child runs the session and says when it has begun and after each answer that is kept;
it is killed, and another goes on, until one comes to the end. The log must have every
answer that was kept, and be that of a session that nobody killed.
"""

import os
import random
import signal
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from some import experiment, observer

from stimlib.experiments import Session, Simulated, read, run


def play(data, told):
    resume = (data / "pair/P01-s1/session.json").exists()
    with Session(experiment(), data, "P01", resume=resume) as session:
        os.write(told, b"o")
        put = session.put

        def kept(*args):
            record = put(*args)
            os.write(told, b".")
            return record

        session.put = kept
        run(session, Simulated(session, observer), lambda trial, folder: {"lost": 0})


def plain(data):
    return [(r.number, r.trial, r.answer.values) for r in read(data / "pair/P01-s1").records]


def child(data, after, begun):
    """Play in a child that is killed some time after it was made, or has begun.

    Returns whether it was killed, and how many answers it kept.
    """
    listen, told = os.pipe()
    if (pid := os.fork()) == 0:  # it has loaded everything already
        try:
            play(data, told)
            os._exit(0)
        finally:
            os._exit(1)
    os.close(told)
    said = os.read(listen, 1) if begun else b""  # else it may be killed while it reads
    time.sleep(after)
    os.kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    said += os.read(listen, 1 << 16)
    os.close(listen)
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0
    return os.WIFSIGNALED(status), said.count(b".")


def main(folder, kills, rng):
    began, killed, runs = time.monotonic(), 0, 0
    play(folder / "whole", os.open(os.devnull, os.O_WRONLY))
    length, whole = time.monotonic() - began, plain(folder / "whole")
    while killed < kills:
        data, kept, left = folder / f"run{runs}", 0, True
        while left:
            left, more = child(data, rng.random() * length * 0.3, rng.random() < 0.7)
            saved = plain(data) if (data / "pair/P01-s1/session.json").exists() else []
            assert kept + more <= len(saved) and saved == whole[: len(saved)], (kept, len(saved))
            kept, killed = len(saved), killed + left
        assert kept == len(whole)
        runs += 1
    print(f"{killed} kills in {runs} sessions of {len(whole)} trials")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), random.Random(int(sys.argv[3])))
