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

from stimlib.experiments.reader import read
from stimlib.experiments.runner import Simulated, run
from stimlib.experiments.session import Session


def play(data, told=None):
    resume = (Path(data) / "pair" / "P01-s1" / "session.json").exists()
    with Session(experiment(), data, "P01", resume=resume) as session:
        if told is not None:
            os.write(told, b"o")
            put = session.put

            def kept(*args):
                record = put(*args)
                os.write(told, b".")
                return record

            session.put = kept
        run(session, Simulated(session, observer), lambda trial, folder: {"lost": 0})


def child(data, told):
    pid = os.fork()
    if pid == 0:  # it has loaded everything already
        try:
            play(data, told)
        except BaseException as e:
            print(type(e).__name__, e, flush=True)
            os._exit(1)
        os._exit(0)
    return pid


def plain(folder):
    return [(r.number, r.trial, r.answer.values) for r in read(folder).records]


def main(folder, kills, rng):
    began = time.monotonic()
    play(folder / "whole")
    length = time.monotonic() - began
    whole = plain(folder / "whole/pair/P01-s1")
    killed, runs = 0, 0
    while killed < kills:
        data, kept, at = folder / f"run{runs}", 0, folder / f"run{runs}/pair/P01-s1"
        runs += 1
        while True:
            listen, told = os.pipe()
            pid = child(data, told)
            os.close(told)
            # else it may be killed while it reads
            said = os.read(listen, 1) if rng.random() < 0.7 else b""
            time.sleep(rng.random() * length * 0.3)
            os.kill(pid, signal.SIGKILL)
            _, status = os.waitpid(pid, 0)
            kept += (said + os.read(listen, 1 << 16)).count(b".")
            os.close(listen)
            if os.WIFEXITED(status):
                assert os.WEXITSTATUS(status) == 0
                break
            killed += 1
            if (at / "session.json").exists():
                saved = plain(at)
                assert kept <= len(saved) and saved == whole[: len(saved)], (kept, len(saved))
                kept = len(saved)
        assert plain(at) == whole
    print(f"{killed} kills in {runs} sessions of {len(whole)} trials")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), random.Random(int(sys.argv[3])))
