"""Several processes: as one, and none of them is left when the work is stopped, however that is."""

import os
import signal
import subprocess
import sys
import time

import pytest

from stimlib.core.pool import Pool, WorkerDied, spread

WORK = """
import os, time
from pathlib import Path

def work(folder, n):
    Path(folder, f"pid{os.getpid()}").touch()
    part = Path(folder, f"{n}.part")
    part.touch()
    try:
        time.sleep(60 if n else 0)
        part.rename(Path(folder, f"{n}"))
    finally:
        part.unlink(missing_ok=True)
"""
RUN = """
import signal, sys
from stimlib.core.pool import spread
from work import work

try:  # no `if __name__ == "__main__"` is needed
    with spread(work, [(sys.argv[1], n) for n in range(5)], workers=2) as results:
        list(results)
except KeyboardInterrupt as e:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as stimlib.__main__
    print(e)
    sys.exit(130)
"""


def test_a_job_that_forks_is_answered_once():
    with Pool(1) as pool:
        for n in (1, 2):
            pool.submit(n, eval, "__import__('os').fork() and 2 * n", {"n": n})
            assert pool.take() == (n, 2 * n, None)


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as f:
            return f.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks at processes in /proc")
@pytest.mark.parametrize(
    ("to", "signals", "code"),
    [("parent", [signal.SIGINT], 130), ("parent", [signal.SIGINT] * 2, 130), ("all", [signal.SIGINT] * 2, 130),
     ("parent", [signal.SIGTERM], 143), ("all", [signal.SIGTERM], 143), ("parent", [signal.SIGKILL], -9)],
)  # fmt: skip
def test_what_stops_the_parent_stops_its_workers(tmp_path, to, signals, code):
    (tmp_path / "work.py").write_text(WORK)
    (tmp_path / "run.py").write_text(RUN)
    folder = tmp_path / "out"
    folder.mkdir()
    words = [sys.executable, str(tmp_path / "run.py"), str(folder)]
    with subprocess.Popen(words, stdout=-1, stderr=-1, text=True, start_new_session=True) as job:
        while not {"0", "1.part", "2.part"} <= set(os.listdir(folder)):
            assert job.poll() is None, job.stderr.read()
            time.sleep(0.02)
        workers = [int(name[3:]) for name in os.listdir(folder) if name.startswith("pid")]
        assert len(workers) == 2 and all(map(alive, workers))
        began = time.monotonic()
        for s in signals:
            (os.kill if to == "parent" else os.killpg)(job.pid, s)
            time.sleep(0.05)
        out, err = job.communicate(timeout=20)
        assert job.returncode == code and "Traceback" not in err, err
        assert code != 130 or "1 of 5 were made" in out
        while any(map(alive, workers)):
            assert time.monotonic() < began + 10
            time.sleep(0.02)
    assert {name for name in os.listdir(folder) if "pid" not in name} == {"0"}


def test_results_come_in_order_and_an_error_is_that_of_the_job():
    jobs = [(2, n) for n in range(5)]
    for workers in (1, 2, None):
        with spread(pow, jobs, workers) as results:
            assert list(results) == [1, 2, 4, 8, 16]
    with pytest.raises(ZeroDivisionError), spread(divmod, [(1, 1), (1, 0)], 2) as results:
        list(results)
    with spread(pow, []) as results:
        assert list(results) == []


def test_a_job_that_ends_its_process_is_told_and_the_others_go_on():
    with Pool(1) as pool:
        for what, function, *args in ((1, os._exit, 3), (2, pow, 2, 3), (3, os.kill, 0, "9")):
            pool.submit(what, function, *args)
            at, result, error = pool.take()
            assert at == what
            assert (result, type(error)) == {1: (None, WorkerDied), 2: (8, type(None)), 3: (None, TypeError)}[at]
        pool.submit(4, os.getenv, "OMP_NUM_THREADS")
        assert pool.take() == (4, "1", None)


class Odd(Exception):
    def __init__(self, a, b):
        super().__init__(f"{a} and {b}")  # its pickle calls it with one argument


def odd():
    raise Odd(1, 2)


def test_an_error_that_cannot_be_made_again_is_told_by_its_text():
    with Pool(1) as pool:
        pool.submit("job", odd)
        _, _, error = pool.take()
    assert (type(error), str(error)) == (RuntimeError, "Odd: 1 and 2")


def test_sigterm_is_given_back_and_taken_from_nobody():
    with spread(pow, [(2, 3)], 1):
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    try:
        signal.signal(signal.SIGTERM, own := lambda *_: None)
        with spread(pow, [(2, 3)], 1):
            assert signal.getsignal(signal.SIGTERM) is own
        assert signal.getsignal(signal.SIGTERM) is own
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def test_what_failed_was_not_made(monkeypatch):
    class Row:  # a pool of one, here
        room = 1

        def __init__(self, workers):
            pass

        __enter__, __exit__ = lambda self: self, lambda self, *_: None

        def submit(self, what, function, n):
            self.room, self.what, self.n = 0, what, n

        def take(self):
            self.room = 1
            return (self.what, self.n, None) if self.n != 1 else (self.what, None, ValueError())

    monkeypatch.setattr("stimlib.core.pool.Pool", Row)
    with pytest.raises(KeyboardInterrupt, match="1 of 3 were made"), spread(abs, [(0,), (1,), (2,)], 2) as results:
        assert next(results) == 0
        with pytest.raises(ValueError):
            next(results)
        raise KeyboardInterrupt


def test_what_cannot_begin_says_so(capfd):
    with Pool(1, divmod, 1, 0) as pool:
        pool.submit("job", pow, 2, 3)
        assert isinstance(pool.take()[2], ZeroDivisionError)
    with Pool(1, os._exit, 4) as pool, pytest.raises(WorkerDied, match="exit status 4 as it began"):
        pool.submit("job", pow, 2, 3)
        pool.take()
