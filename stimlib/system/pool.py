"""Worker processes, which end with the process that started them, however it ends."""

from __future__ import annotations

import _thread
import math
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from importlib import import_module
from typing import IO, Any, TypeVar

from ..errors import StimlibError
from . import watchdog

T = TypeVar("T")
# Processes share the cores already.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
IDLE = 60.0  # s without a job, after which a worker ends
NOTHING = 0, bytes(16)  # is noted


class JobFailed(StimlibError, RuntimeError):
    """An error of a job that is known only by its text.

    The error itself could not be pickled, or would end this program too, as SystemExit
    does.
    """


class WorkerDied(JobFailed):
    """The end of a worker process in the middle of a job."""

    at = 0
    """What the job noted last: which part of it was under way, and 16 bytes about
    that.
    """
    data = bytes(16)


class TimedOut(WorkerDied):
    """A job that exceeded its time limit, so that its process was ended."""


class Pool(AbstractContextManager["Pool"]):
    """Worker processes of one thread each, for the jobs of any threads.

    They are new interpreters that run nothing of the program that started them: a
    script needs no ``if __name__ == "__main__"``. Functions and arguments travel as
    pickles. Ctrl-C interrupts only this process. A worker starts where no other is
    idle, so there are as many as threads that run jobs at once.

    The workers end when the ``with`` block ends. They also end within three seconds of
    this process, in whatever way it ends and whatever they are doing. A watchdog
    process for each sends it SIGTERM, on which it removes half-written files, and kills
    it two seconds later. Processes that a job has started end with its worker, except
    those that have moved into a session of their own. A worker can survive only if its
    watchdog is killed too.

    Parameters
    ----------
    memory : int, optional
        Bytes of data that each process may have (RLIMIT_DATA).  What is allocated
        counts, used or not, that of imported modules included.  Code, mapped files,
        shared memory and reserved address space do not count.  An allocation beyond the
        limit raises MemoryError in the job.  Each process that a job starts has the
        same limit again.  Linux enforces it (from 4.7 on); macOS hardly counts
        anything.

    Examples
    --------
    >>> from stimlib.system.pool import Pool
    >>> with Pool(memory=2_000_000_000) as pool:
    ...     pool.run(pow, 2, 5, seconds=60)
    32
    """

    def __init__(self, memory: int | None = None):
        self.memory, self.closed = memory, False
        self._idle: list[Worker] = []
        self._lock = threading.Lock()

    def __exit__(self, *_: object) -> None:
        self.closed = True  # workers that are busy end by that
        with self._lock:
            idle, self._idle = self._idle, []
        for worker in idle:
            worker.hang_up()
        for worker in idle:
            worker.end()

    @contextmanager
    def worker(self, start: bool = True) -> Iterator[Worker | None]:
        """Yield a worker for the jobs of this thread.

        Parameters
        ----------
        start : bool
            Start one if none is idle, instead of yielding None.
        """
        with self._lock:
            if self.closed:
                raise JobFailed("the pool is closed")
            idle = [w for w in self._idle if w.alive()]
            worker = idle.pop() if idle else Worker(self) if start else None
            self._idle = idle
        try:
            yield worker
        finally:
            with self._lock:
                if worker and not self.closed:
                    self._idle.append(worker)
            if worker and self.closed:
                worker.end()

    def run(self, function: Callable[..., T], *args: Any, seconds: float = math.inf) -> T:
        """Run a job in a worker, as `Worker.ask` does."""
        with self.worker() as worker:
            assert worker
            return worker.ask(function, *args, seconds=seconds)


class Worker:
    """A worker process, which runs one job after another.

    Messages travel through its stdin and stdout. A thread reads its answers, because
    Windows cannot wait for a pipe with a limit of time.
    """

    def __init__(self, pool: Pool):
        self._pool = pool
        self._said: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._noted, self._since = NOTHING, math.inf
        self.known: set[str] = set()
        """What the user of the worker has told it."""
        serve = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; "
        watched = [sys.executable, "-I", "-S", watchdog.__file__, str(os.getpid())]
        self._process = subprocess.Popen(
            [
                *(watched if watchdog.POSSIBLE else []),
                *(sys.executable, "-c", serve + f"serve({pool.memory}, {IDLE})"),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD,
            start_new_session=True,
            # Ctrl-C interrupts this process alone, on Windows too
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        gone = EOFError, OSError, ValueError, pickle.UnpicklingError
        with suppress(*gone), self._process as process:
            assert process.stdout
            while True:
                said = pickle.load(process.stdout)
                if isinstance(said, tuple):  # it has begun, or begins another part
                    self._noted, self._since = said, time.monotonic()
                else:
                    self._said.put(said)
        self._said.put(None)

    def alive(self) -> bool:
        """Return whether the process has not ended."""
        return self._process.poll() is None

    def hang_up(self) -> None:
        """Let the process end, at the latest after two seconds."""
        with suppress(OSError, ValueError):
            self._process.stdin.close()  # type: ignore[union-attr]
        if watchdog.POSSIBLE:
            self._process.terminate()

    def end(self) -> int:
        """End the process, and return its exit status."""
        self.hang_up()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(watchdog.PATIENCE + 1)
        self._process.kill()
        return self._process.wait()

    def ask(self, function: Callable[..., T], *args: Any, seconds: float = math.inf) -> T:
        """Run a job, and return its result.

        Parameters
        ----------
        function : callable and its arguments
        seconds : float, optional
            A job that takes longer is ended, together with its process and the
            processes that it has started.  The time begins when the process has begun;
            what the job imports or compiles counts.  It begins anew whenever the job
            calls `note`.

        Raises
        ------
        Exception
            What the job raised: ``MemoryError`` beyond the limit of memory,
            ``JobFailed`` with the text of an error that cannot be pickled.
        TimedOut, WorkerDied
            The job took longer than its seconds, or ended its process.
        JobFailed
            The process ended before it had begun: no other would do better.
        """
        self._noted, asked, late = NOTHING, time.monotonic(), False
        job = pickle.dumps((function, args))
        with suppress(OSError, ValueError):  # one that is gone is noticed below
            _send(self._process.stdin, job)
        while not late:
            with suppress(queue.Empty):
                if (answer := self._said.get(timeout=watchdog.TICK)) is None:
                    break
                return self._result(answer)
            # it has ended, and a child of it keeps its stdout open
            if not self.alive() and self._said.empty():
                break
            late = self._pool.closed or time.monotonic() > max(self._since, asked) + seconds
        raise self._died(self.end(), late, seconds)

    def _result(self, answer: bytes) -> Any:
        result, error = pickle.loads(answer)
        if isinstance(error, MemoryError) and (memory := self._pool.memory):
            said = str(error) or "a job asked for too much memory"
            error = MemoryError(f"{said}; the limit is memory = {memory} bytes, raise it")
        if error is not None:
            raise error
        return result

    def _died(self, status: int, late: bool, seconds: float) -> JobFailed:
        if 128 < status < 193:  # what the watchdog tells of a signal
            status = 128 - status
        said = f"by signal {-status}" if status < 0 else f"with exit status {status}"
        if self._since == math.inf:
            return JobFailed(
                f"a worker process ended {said} as it began; what it wrote on stderr says why"
            )
        if status < 0 and self._pool.memory:
            said += f"; the limit is memory = {self._pool.memory} bytes"
        died = WorkerDied(f"it ended its process {said}")
        if late:
            died = TimedOut(f"it took longer than its {seconds:g} s; allow more")
        died.at, died.data = self._noted
        return died


def _send(stream: IO[bytes] | None, message: Any) -> None:
    assert stream
    stream.write(pickle.dumps(message))
    stream.flush()


@contextmanager
def spread(
    function: Callable[..., T], jobs: Sequence[tuple], workers: int | None = None
) -> Iterator[Iterator[T]]:
    """Call a function with the arguments of each job, in several processes.

    Whatever ends the ``with`` block early also ends the workers, which undo their
    unfinished work: an exception, Ctrl-C, or SIGTERM (which ends the program like an
    exception, unless the program has its own handler). If this process is killed, they
    end too.

    Parameters
    ----------
    function : callable
        Of a module; its arguments and results travel between processes.
    jobs : sequence of tuple
    workers : int, optional
        Processes; by default one for each core, at most one for each job.  One is this
        process itself.

    Yields
    ------
    iterator
        The results, in the order of the jobs, each as soon as it is there; what a job
        raises is raised here.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C; it says how many jobs were done.

    Examples
    --------
    >>> from stimlib.system.pool import spread
    >>> with spread(pow, [(2, 3), (2, 4)], workers=1) as results:
    ...     list(results)
    [8, 16]
    """
    workers = min(workers or os.cpu_count() or 1, len(jobs))
    done: list[tuple] = []

    def one(job: tuple, run: Callable[..., T] = function) -> T:
        result = run(*job)
        done.append(job)
        return result

    try:
        with terminable():
            if workers <= 1:
                yield map(one, jobs)
            else:
                with ThreadPoolExecutor(workers) as threads, Pool() as pool:
                    yield threads.map(lambda job: one((function, *job), pool.run), jobs)
    except KeyboardInterrupt:
        what = (
            f"{len(done)} of {len(jobs)} were made, every file there is whole; run it again for the"
            " rest"
        )
        raise KeyboardInterrupt(what) from None


@contextmanager
def terminable() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end the program like an exception.

    SIGHUP arrives when a terminal is closed. Handlers set by others stay in place.
    """
    main = threading.current_thread() is threading.main_thread()
    ends = {signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)}
    free = [s for s in ends if main and signal.getsignal(s) is signal.SIG_DFL]
    for s in free:
        signal.signal(s, _end)
    try:
        yield
    finally:
        for s in free:
            signal.signal(s, signal.SIG_DFL)


class _Ended(SystemExit):
    """The SystemExit that SIGTERM raises."""


def _end(number: int, frame: Any) -> None:
    signal.signal(number, signal.SIG_IGN)  # once is enough
    raise _Ended(128 + number)


# In a worker --------------------------------------------------------------------------
_driver: tuple[IO[bytes] | None, int] = None, 0
"""Where the worker's messages go, and its process; none where this is no worker."""


def note(at: int, data: bytes) -> None:
    """Record which part of the job is under way, in case the process ends.

    This also restarts the time limit of the job.
    """
    stream, process = _driver
    if process == os.getpid():  # and not a job's fork
        _send(stream, (at, data))


def ended(e: BaseException) -> bool:
    """Return whether an exception is a requested end of the process, or a Ctrl-C."""
    return isinstance(e, _Ended) or (isinstance(e, KeyboardInterrupt) and _driver[1] != os.getpid())


def serve(memory: int | None, idle: float) -> None:
    """Run the jobs that arrive on stdin until it is closed, or none comes for a while.

    What a job prints goes to stderr, as stdout carries the answers.
    """
    global _driver
    stdin, answers = open(os.dup(0), "rb"), open(os.dup(1), "wb")
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    _driver = answers, os.getpid()
    signal.signal(signal.SIGTERM, _end)
    # that about this process is not the job's error; others are, where the user says so
    warnings.filterwarnings("default", "the cache folder ", RuntimeWarning)
    # Windows does not have it, or what is permitted is less already
    with suppress(ImportError, ValueError):
        resource: Any = import_module("resource")
        if memory:
            resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    own, jobs = os.getpid(), queue.SimpleQueue[bytes | None]()
    threading.Thread(target=_read, args=(stdin, jobs), daemon=True).start()
    with suppress(OSError, queue.Empty):
        _send(answers, NOTHING)
        while (job := jobs.get(timeout=idle)) is not None:
            answer = _answer(job)
            if os.getpid() != own:
                os._exit(0)  # the job has forked, and this is the other one: it was not asked
            _send(answers, answer)
    # the watchdog's SIGTERM may come while Python ends, which shows exceptions
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _read(stdin: IO[bytes], jobs: queue.SimpleQueue[bytes | None]) -> None:
    """Read jobs, and end this process when the driver has ended or hung up.

    The job is interrupted with SIGTERM, and the process ends after a while. A watchdog
    does the same where there is one, but also with a process that runs no thread.
    """
    with suppress(EOFError, OSError, ValueError, pickle.UnpicklingError):
        while True:
            jobs.put(pickle.load(stdin))
    jobs.put(None)
    _thread.interrupt_main(signal.SIGTERM)
    time.sleep(watchdog.PATIENCE)
    os._exit(1)


def _answer(data: bytes) -> bytes:
    try:
        function, args = pickle.loads(data)
        return pickle.dumps((function(*args), None))
    except _Ended:
        raise
    except BaseException as e:
        return _failure(e.with_traceback(None))  # which may hold what fills the memory


def _failure(e: BaseException) -> bytes:
    """Return the answer for a job that raised an error.

    It contains the error itself; its text if the error cannot be pickled and restored,
    or would end the driver too, as SystemExit does; its name if it has no text.
    """
    name = type(e).__name__
    told = (
        lambda: e,
        lambda: JobFailed(f"{name}: {e}"),
        lambda: JobFailed(f"{name}, which gives no text"),
    )
    for make in told[not isinstance(e, Exception) :]:
        with suppress(BaseException):
            pickle.loads(answer := pickle.dumps((None, make())))
            return answer
    raise e
