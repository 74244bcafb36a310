"""Several processes: as one, and none of them is left when the work is stopped, however
that is.
"""

import os
import pickle
import signal
import subprocess
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import pytest
from laws import STRESS, mostly
from refusals import refused
from waiting import until

from stimlib.system import cache_folder, pool as module
from stimlib.system.pool import JobFailed, Pool, TimedOut, WorkerDied, spread

WORK = """
import os, time
from pathlib import Path

def work(folder, n):
    Path(folder, f"pid{os.getpid()}").touch()
    part = Path(folder, f"{n}.part")
    try:  # before the file is there, after which a signal may come at once
        part.touch()
        time.sleep(60 if n else 0)
        part.rename(Path(folder, f"{n}"))
    finally:
        part.unlink(missing_ok=True)
"""
RUN = """
import signal, sys
from stimlib.system.pool import spread
from work import work

try:  # no `if __name__ == "__main__"` is needed
    with spread(work, [(sys.argv[1], n) for n in range(5)], workers=2) as results:
        list(results)
except KeyboardInterrupt as e:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as stimlib.__main__
    print(e)
    sys.exit(130)
"""


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as f:
            return f.read().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # which comes where it ends meanwhile
        return False


IN_PROC = pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks at /proc")
STOPS = [
    ("parent", [signal.SIGINT], 130),
    ("parent", [signal.SIGINT] * 2, 130),
    ("all", [signal.SIGINT] * 2, 130),
    ("parent", [signal.SIGTERM], 143),
    ("all", [signal.SIGTERM], 143),
    ("parent", [signal.SIGKILL], -9),
]


@IN_PROC
@pytest.mark.parametrize(("to", "signals", "code"), STOPS if STRESS else STOPS[2:4] + STOPS[5:])
def test_what_stops_the_parent_stops_its_workers(tmp_path, to, signals, code):
    (tmp_path / "work.py").write_text(WORK)
    (tmp_path / "run.py").write_text(RUN)
    (folder := tmp_path / "out").mkdir()
    words = [sys.executable, str(tmp_path / "run.py"), str(folder)]
    with subprocess.Popen(words, stdout=-1, stderr=-1, text=True, start_new_session=True) as job:
        until(lambda: {"0", "1.part", "2.part"} <= set(os.listdir(folder)) or job.poll())
        workers = [int(name[3:]) for name in os.listdir(folder) if name.startswith("pid")]
        assert len(workers) == 2 and all(map(alive, workers)), job.stderr.read()
        for s in signals:
            (os.kill if to == "parent" else os.killpg)(job.pid, s)
            time.sleep(0.05)
        out, err = job.communicate()
    assert job.returncode == code and "Traceback" not in err, err
    assert code != 130 or "1 of 5 were made" in out
    until(lambda: not any(map(alive, workers)))
    assert {name for name in os.listdir(folder) if "pid" not in name} == {"0"}


@pytest.fixture(scope="module")
def workers():
    with Pool() as pool:
        yield pool


def outcome(pool, function, *args, **limits):
    """What a job gives, or its error."""
    try:
        return pool.run(function, *args, **limits)
    except Exception as e:
        return e


# What a worker may be in the middle of while its driver ends.  Each writes a file "NAME
# PID" first.
STUCK = """
import ctypes, functools, itertools, os, resource, signal, subprocess, sys, threading, time
from pathlib import Path

def stuck(folder, name):
    globals()[name](functools.partial(here, folder, name))

def here(folder, name, pid=None):
    Path(folder, f"{name} {pid or os.getpid()}").touch()

def busy():
    sum(itertools.repeat(0))  # in C, without a look at signals, and no other thread runs

def sleep(here):
    here()
    time.sleep(600)

def holds_the_gil(here):
    here()
    busy()

def sleeps_in_c_with_the_gil(here):
    here()
    ctypes.PyDLL(None).sleep(600)

def recursion_in_c(here, depth=200):
    if depth == 0:
        here()
        busy()
    sorted([0], key=lambda _: recursion_in_c(here, depth - 1))

def recursion(here):
    resource.setrlimit(resource.RLIMIT_DATA, (400_000_000,) * 2)  # or it fills the memory
    sys.setrecursionlimit(10**9)
    here()
    while True:
        try:
            deeper()
        except MemoryError:
            pass

def deeper():
    deeper()

def stopped(here):
    here()
    os.kill(os.getpid(), signal.SIGSTOP)

def ignores_signals(here):
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)
    sleep(here)

def catches_everything(here):
    while True:
        try:
            sleep(here)
        except BaseException:
            pass

def forks(here):
    if not os.fork():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if not os.fork():
            sleep(here)
    sleep(here)

def starts_a_program(here):
    program = subprocess.Popen(["sleep", "600"])
    here(program.pid)
    here()
    program.wait()

def reads_a_pipe(here):
    here()
    os.read(os.pipe()[0], 1)

def allocates(here):
    here()
    while True:
        bytearray(50_000_000)

def has_a_thread_that_never_ends(here):
    threading.Thread(target=time.sleep, args=(600,)).start()
    here()

def wants_a_session_of_its_own(here):
    try:
        os.setsid()
    except PermissionError:
        pass
    ignores_signals(here)

def closes_its_files(here):
    here()
    os.closerange(0, 1000)
    time.sleep(600)

NAMES = [f.__name__ for f in (
    sleep, holds_the_gil, sleeps_in_c_with_the_gil, recursion_in_c, recursion, stopped,
    ignores_signals, catches_everything, forks, starts_a_program, reads_a_pipe, allocates,
    has_a_thread_that_never_ends, wants_a_session_of_its_own, closes_its_files)]
"""
DRIVER = """
import ctypes, os, signal, sys, time
from concurrent.futures import ThreadPoolExecutor
from stimlib.system.pool import Pool
from stuck import NAMES, stuck

folder, end = sys.argv[1:]
end_of_hang = time.monotonic() + 120
with ThreadPoolExecutor(len(NAMES)) as threads, Pool() as pool:
    for name in NAMES:
        threads.submit(pool.run, stuck, folder, name)
    while left := set(NAMES) - {name.split()[0] for name in os.listdir(folder)}:
        assert time.monotonic() < end_of_hang, left
        time.sleep(0.02)
    time.sleep(0.2)
    exec(end)
"""
ENDS = {
    "killed": "os.kill(os.getpid(), signal.SIGKILL)",
    "killed while a child of it lives": (
        "os.fork() and os.kill(os.getpid(), signal.SIGKILL); time.sleep(10); os._exit(0)"
    ),
    "terminated": "os.kill(os.getpid(), signal.SIGTERM)",
    "interrupted": "os.kill(os.getpid(), signal.SIGINT)",
    "hung up": "os.kill(os.getpid(), signal.SIGHUP)",
    "exits": "sys.exit(3)",
    "exits at once": "os._exit(3)",
    "raises": "1 / 0",
    "crashes": "ctypes.string_at(0)",
    "becomes another program": "os.execlp('true', 'true')",
    "comes to the end of the block": "pass",
}


@IN_PROC
@pytest.mark.parametrize("end", mostly(["killed while a child of it lives"], ENDS))
def test_no_worker_outlives_its_driver_whatever_it_does(tmp_path, end):
    (tmp_path / "stuck.py").write_text(STUCK)
    (tmp_path / "driver.py").write_text(DRIVER)
    (folder := tmp_path / "out").mkdir()
    words = [sys.executable, tmp_path / "driver.py", folder, ENDS[end]]
    with open(tmp_path / "said", "w") as said:  # not a pipe, which a child of it would hold
        subprocess.run(words, stderr=said)
    assert "AssertionError" not in (tmp_path / "said").read_text()
    workers = {int(name.split()[1]): name for name in os.listdir(folder)}
    try:
        until(lambda: not any(map(alive, workers)), workers)
    finally:
        for pid in filter(alive, workers):
            os.kill(pid, signal.SIGKILL)


def test_results_come_in_order_and_an_error_is_that_of_the_job():
    jobs = [(2, n) for n in range(5)]
    for workers in (1, 2, None):
        with spread(pow, jobs, workers) as results:
            assert list(results) == [1, 2, 4, 8, 16]
    with pytest.raises(ZeroDivisionError), spread(divmod, [(1, 1), (1, 0)], 2) as results:
        list(results)
    with spread(pow, []) as results:
        assert list(results) == []


def test_a_job_that_ends_its_process_is_told_and_the_others_go_on(workers):
    assert "exit status 3" in str(outcome(workers, os._exit, 3))
    assert type(outcome(workers, os.kill, 0, "9")) is TypeError
    for n in (1, 2):  # a job that forks is answered once
        assert outcome(workers, eval, "__import__('os').fork() and 2 * n", {"n": n}) == 2 * n
    assert outcome(workers, os.getenv, "OMP_NUM_THREADS") == "1"


def test_a_warning_about_a_worker_is_not_the_error_of_its_job(monkeypatch, tmp_path, capfd):
    """One of the job is, where warnings are errors."""
    monkeypatch.setenv("PYTHONWARNINGS", "error")
    with Pool() as pool:
        assert outcome(pool, cache_folder.temporary, tmp_path, OSError("full")) is None
        assert isinstance(outcome(pool, warnings.warn, "log of 0", RuntimeWarning), RuntimeWarning)
    assert "RuntimeWarning: the cache folder" in capfd.readouterr().err


class Odd(Exception):
    def __init__(self, a, b):
        super().__init__(f"{a} and {b}")  # its pickle calls it with one argument


class Mute(Exception):
    def __str__(self):
        raise SystemExit(7)

    __repr__ = __reduce_ex__ = __str__


class Unreadable(Exception):
    """Only the process that gets it cannot read it."""

    def __reduce__(self):
        return _only_in, (os.getpid(),)


def _only_in(pid):
    if os.getpid() != pid:
        raise OSError("no")
    return Unreadable()


def throw(error, *args):
    raise error(*args)


@pytest.mark.parametrize(
    ("error", "args", "kind", "text"),
    [
        (Odd, (1, 2), JobFailed, "Odd: 1 and 2"),
        (Mute, (), JobFailed, "Mute, which gives no text"),
        (SystemExit, (3,), JobFailed, "SystemExit: 3"),
        (KeyboardInterrupt, ("stop",), JobFailed, "KeyboardInterrupt: stop"),
        (GeneratorExit, (5,), JobFailed, "GeneratorExit: 5"),
        (Unreadable, (), OSError, "no"),
        (EOFError, ("end",), EOFError, "end"),
        (ValueError, ("v",), ValueError, "v"),
    ],
)
def test_whatever_a_job_raises_is_its_error_and_its_process_goes_on(
    workers, error, args, kind, text
):
    pid = outcome(workers, os.getpid)
    raised = outcome(workers, throw, error, *args)
    assert (type(raised), str(raised)) == (kind, text)
    assert outcome(workers, os.getpid) == pid


def test_a_result_that_cannot_travel_is_an_error_of_its_job(workers):
    assert isinstance(outcome(workers, eval, "lambda: 0"), (AttributeError, pickle.PicklingError))
    assert str(outcome(workers, Unreadable)) == "no"
    assert outcome(workers, pow, 2, 3) == 8


TIDY = """
import time
import warnings
try:
    path.touch()
    time.sleep(600)
finally:
    time.sleep(0.7)
    path.unlink()
"""


def test_a_job_has_its_seconds_and_the_others_go_on(workers, tmp_path):
    half = tmp_path / "half"  # which the third job takes back
    for job in (
        (time.sleep, 600),
        (exec, "import itertools; sum(itertools.repeat(0))"),  # holds the GIL
        (exec, TIDY, {"path": half}),
    ):
        error = outcome(workers, *job, seconds=0.3)
        assert type(error) is TimedOut and "longer than its 0.3 s" in str(error)
        assert outcome(workers, pow, 2, 3, seconds=60) == 8
    assert not half.exists()


def test_the_seconds_of_a_job_begin_anew_with_each_note(workers):
    text = (
        "import time\nfrom stimlib.system.pool import note\nfor k in range(3):\n    note(k,"
        " bytes(16))\n    time.sleep(2.0)"
    )
    assert outcome(workers, exec, text, seconds=5.0) is None


def test_neither_the_start_of_a_worker_nor_its_wait_takes_seconds_of_a_job():
    with Pool() as pool:
        for _ in range(2):
            assert outcome(pool, pow, 2, 3, seconds=0.1) == 8
            time.sleep(0.2)


def starts(path, end):
    path.write_text(str(subprocess.Popen(["sleep", "600"]).pid))
    end()


@IN_PROC
@pytest.mark.parametrize(("end", "kind"), [(signal.pause, TimedOut), (os.abort, WorkerDied)])
def test_what_a_job_has_started_ends_with_it(workers, tmp_path, end, kind):
    seconds = 6.0 if end == signal.pause else 60.0
    assert type(outcome(workers, starts, tmp_path / "pid", end, seconds=seconds)) is kind
    pid = int((tmp_path / "pid").read_text())
    until(lambda: not alive(pid))


def leaves_a_child(path):
    reads, writes = os.pipe()
    if not (pid := os.fork()):
        os.setsid()
        os.write(writes, b".")
        time.sleep(60)
        os._exit(0)
    path.write_text(str(pid))
    os.read(reads, 1)
    os._exit(4)


@IN_PROC
def test_a_worker_that_ends_is_seen_while_a_child_of_it_has_its_connection(workers, tmp_path):
    error = outcome(workers, leaves_a_child, tmp_path / "pid")
    assert alive(pid := int((tmp_path / "pid").read_text()))
    os.kill(pid, signal.SIGKILL)
    assert "exit status 4" in str(error)


def test_a_job_has_its_memory():
    with Pool(memory=400_000_000) as pool:
        pid = outcome(pool, os.getpid)
        for job in (bytearray, 2_000_000_000), (exec, "[bytes(10**6) for _ in range(10**6)]"):
            error = outcome(pool, *job)
            assert isinstance(error, MemoryError) and "memory = 400000000 bytes" in str(error)
        assert outcome(pool, len, bytes(10**8)) == 10**8 and outcome(pool, os.getpid) == pid


def test_sigterm_is_given_back_and_taken_from_nobody():
    # a sink that another thread closed in an earlier test cannot give it back
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        for own in (signal.SIG_DFL, lambda *_: None):
            signal.signal(signal.SIGTERM, own)
            with spread(pow, [(2, 3)], 1):
                assert (signal.getsignal(signal.SIGTERM) is own) == (own != signal.SIG_DFL)
            assert signal.getsignal(signal.SIGTERM) is own
    finally:
        signal.signal(signal.SIGTERM, before)


def test_what_failed_was_not_made():
    with (
        pytest.raises(KeyboardInterrupt, match="1 of 2 were made"),
        spread(divmod, [(1, 1), (1, 0)], 2) as results,
    ):
        assert next(results) == (1, 0)
        refused(ZeroDivisionError, None, next, results)
        raise KeyboardInterrupt


def test_what_cannot_begin_says_so(capfd, monkeypatch):
    monkeypatch.setattr(sys, "path", [])
    with Pool() as pool:
        refused(JobFailed, "exit status 1 as it began", pool.run, pow, 2, 3)


def test_a_worker_is_started_where_no_other_is_idle_and_ends_where_it_stays_so(monkeypatch):
    with Pool() as pool, ThreadPoolExecutor() as threads:
        first = outcome(pool, os.getpid)
        with pool.worker() as worker:
            assert worker.ask(os.getpid) == first
            second = threads.submit(pool.run, os.getpid).result()
        assert second != first == outcome(pool, os.getpid), "the one that was used last"
        monkeypatch.setattr(module, "IDLE", 0.1)
        with pool.worker(), pool.worker(), pool.worker() as short:
            assert short.ask(pow, 2, 3) == 8
            until(lambda: not short.alive())
        assert outcome(pool, os.getpid) in (first, second)
        with pool.worker() as worker:
            pool.__exit__()
        until(lambda: not worker.alive())
        refused(JobFailed, "the pool is closed", pool.run, pow, 2, 3)


@IN_PROC
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_worker_ends_without_its_watchdog_too(number):
    with Pool() as pool:
        pid = outcome(pool, os.getpid)
        with pool.worker() as worker:
            os.kill(worker._process.pid, number)
            refused(WorkerDied, None, worker.ask, time.sleep, 600, seconds=0.3)
        until(lambda: not alive(pid))
        assert outcome(pool, pow, 2, 3) == 8
