"""Work in several processes, which end with the one that gave it, however that ends."""

from __future__ import annotations

import math
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from itertools import islice
from multiprocessing.connection import Connection, wait
from typing import IO, Any, TypeVar

from ..errors import StimlibError
from . import watchdog

T = TypeVar("T")
# Processes share the cores already.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class JobFailed(StimlibError, RuntimeError):
    """A job's error of which only the text is known.

    The error could not be pickled, or would end this program too, as SystemExit does.
    """


class WorkerDied(JobFailed):
    """A process ended in the middle of a job, or before it could begin with any."""

    at = 0
    """What the job noted last: which part of it was under way, and 16 bytes about
    that.
    """
    data = bytes(16)


class TimedOut(WorkerDied):
    """A job took longer than it was given, so its process was ended."""


class _Worker:
    """One process, the connection to it, and what it is at."""

    def __init__(self, process: subprocess.Popen, connection: Connection, notes: IO[bytes]):
        self.process, self.connection, self.notes = process, connection, notes
        self.noted = b""
        self.begun = self.late = False
        self.job: Any = None  # what it is, and its seconds
        self.until = math.inf


class Pool(AbstractContextManager["Pool"]):
    """Processes of one thread each, which do one job after another.

    They are new interpreters that run nothing of the program that made them: a script
    needs no ``if __name__ == "__main__"``.  Functions and arguments travel as pickles.
    Ctrl-C interrupts this process alone.

    The workers end when the ``with`` block ends.  They also end within three seconds of
    this process, in whatever way it ends and whatever they are doing.  A watchdog
    process sends them SIGTERM, on which they remove what they have half written, and
    kills those that are left two seconds later.  Processes that a job has started end
    with its worker, except those that have moved into a session of their own.  A worker
    may be left only if the watchdog is killed too.

    Parameters
    ----------
    workers : int
        Processes, at least 1.
    begin : callable and its arguments, optional
        Called once in each process, before its first job.
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
    >>> with Pool(1, memory=2_000_000_000) as pool:
    ...     pool.submit("a power", pow, 2, 5, seconds=60)
    ...     pool.take()
    ('a power', 32, None)
    """

    def __init__(self, workers: int, *begin: Any, memory: int | None = None):
        self._begin, self._memory = pickle.dumps((_begin, begin)), memory
        self._watchdog = subprocess.Popen(
            [sys.executable, "-I", "-S", watchdog.__file__, str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._workers: list[_Worker] = []
        self.widen(workers)

    def __exit__(self, *_: object) -> None:
        # the watchdog ends the workers, as it does where this process is killed
        self._watchdog.stdin.close()  # type: ignore[union-attr]
        until = time.monotonic() + watchdog.PATIENCE
        for worker in self._workers:
            _end_of(worker, until)
        self._watchdog.kill()  # nothing is left for it to do
        self._watchdog.wait()

    def widen(self, workers: int) -> None:
        """Start processes until there are so many."""
        while len(self._workers) < workers:
            self._workers.append(self._start())
            self._send(self._workers[-1], self._begin)

    @property
    def workers(self) -> int:
        """Return how many processes there are."""
        return len(self._workers)

    @property
    def room(self) -> int:
        """How many processes have nothing to do."""
        return sum(worker.job is None for worker in self._workers)

    def submit(
        self, what: Any, function: Callable[..., Any], *args: Any, seconds: float = math.inf
    ) -> None:
        """Give a job to a process that has none.

        Parameters
        ----------
        what : object
            Comes back with the result.
        function : callable and its arguments
        seconds : float, optional
            A job that takes longer is ended, together with its process and the
            processes that it has started.  The time begins when the process takes the
            job: ``begin`` does not count, but what the job imports or compiles does.
            It begins anew whenever the job calls `note`.  Only ``take`` checks the
            time, every 0.2 s.
        """
        job = pickle.dumps((function, args))
        worker = next(w for w in self._workers if w.job is None)
        worker.job, worker.noted = (what, seconds), b""
        worker.notes.truncate(0)
        if worker.begun:
            worker.until = time.monotonic() + seconds
        self._send(worker, job)

    def take(self) -> tuple[Any, Any, BaseException | None]:
        """Wait for a job.

        Returns
        -------
        (what, result, error)
            The error is None, or what the job raised: ``MemoryError`` beyond the limit
            of memory, ``JobFailed`` with the text of an error that cannot be pickled.
            ``TimedOut`` after the limit of time, and ``WorkerDied`` where the job ended
            its process: another process has then taken the place of that one.

        Raises
        ------
        WorkerDied
            A process ended before it had begun: no other would do better.
        """
        while True:
            busy = {w.connection: w for w in self._workers if w.job is not None}
            ready = wait(list(busy), watchdog.TICK)
            for worker in busy.values():
                if worker.connection not in ready:
                    now = time.monotonic()
                    # it has ended, and a child of it keeps the connection open
                    if worker.process.poll() is not None and not worker.connection.poll():
                        return self._replaced(worker)
                    if (noted := os.pread(worker.notes.fileno(), 24, 0)) != worker.noted:
                        worker.noted, worker.until = noted, now + worker.job[1]
                    if now > worker.until:
                        ends = [signal.SIGKILL] if worker.late else [signal.SIGTERM, signal.SIGCONT]
                        watchdog.tell([worker.process.pid], *ends)
                        worker.late, worker.until = True, now + watchdog.PATIENCE
            for connection in ready:
                worker = busy[connection]  # type: ignore[index]
                try:
                    answer = worker.connection.recv_bytes()
                except (EOFError, OSError):
                    return self._replaced(worker)
                if not worker.begun:
                    worker.begun, worker.until = True, time.monotonic() + worker.job[1]
                elif not worker.late:  # else it is about to end
                    return self._taken(worker, answer)

    def _taken(self, worker: _Worker, answer: bytes) -> tuple[Any, Any, BaseException | None]:
        (what, _), worker.job, worker.until = worker.job, None, math.inf
        try:
            result, error = pickle.loads(answer)
        except Exception as e:
            result, error = None, e
        if isinstance(error, MemoryError) and self._memory:
            said = str(error) or "a job asked for too much memory"
            error = MemoryError(f"{said}; the limit is memory = {self._memory} bytes, raise it")
        return what, result, error

    def _replaced(self, worker: _Worker) -> tuple[Any, None, WorkerDied]:
        noted = os.pread(worker.notes.fileno(), 24, 0)
        status = _end_of(worker, time.monotonic() + watchdog.PATIENCE)
        self._report(worker.process)
        self._workers.remove(worker)
        said = f"by signal {-status}" if status < 0 else f"with exit status {status}"
        if not worker.begun:
            raise WorkerDied(
                f"a worker process ended {said} as it began; what it wrote on stderr says why"
            )
        self.widen(len(self._workers) + 1)
        what, seconds = worker.job
        limit = (
            f"; the limit is memory = {self._memory} bytes" if self._memory and status < 0 else ""
        )
        died = WorkerDied(f"it ended its process {said}{limit}")
        if worker.late:
            died = TimedOut(f"it took longer than its {seconds:g} s; allow more")
        if noted:
            died.at, died.data = int.from_bytes(noted[:8]), noted[8:]
        return what, None, died

    def _start(self) -> _Worker:
        ours, theirs = multiprocessing.Pipe()
        notes = tempfile.TemporaryFile()
        serve = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; "
        serve += f"serve({theirs.fileno()}, {notes.fileno()}, {self._memory})"
        process = subprocess.Popen(
            [sys.executable, "-c", serve],
            stdin=subprocess.DEVNULL,
            pass_fds=[theirs.fileno(), notes.fileno()],
            env=os.environ | ONE_THREAD,
            start_new_session=True,
        )
        self._report(process)
        theirs.close()
        return _Worker(process, ours, notes)

    def _report(self, process: subprocess.Popen) -> None:
        """Tell the watchdog that a worker has started, or is gone."""
        with suppress(BrokenPipeError):
            os.write(self._watchdog.stdin.fileno(), process.pid.to_bytes(8))  # type: ignore[union-attr]

    @staticmethod
    def _send(worker: _Worker, data: bytes) -> None:
        with suppress(BrokenPipeError, ConnectionResetError):  # `take` will find that it is gone
            worker.connection.send_bytes(data)


def _end_of(worker: _Worker, until: float) -> int:
    """Wait for a process until a time, kill it, and return the exit status."""
    with suppress(subprocess.TimeoutExpired):
        worker.process.wait(max(0.0, until - time.monotonic()))
    watchdog.tell([worker.process.pid], signal.SIGKILL)
    worker.connection.close()
    worker.notes.close()
    return worker.process.wait()


@contextmanager
def spread(
    function: Callable[..., T], jobs: Sequence[tuple], workers: int | None = None
) -> Iterator[Iterator[T]]:
    """Call a function with the arguments of each job, in several processes.

    Whatever ends the ``with`` block early also ends the workers, with what they were at
    taken back: an exception, Ctrl-C, SIGTERM (which ends the program like an exception
    does, where nobody else takes it).  Where this process is killed, they end too.

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
    done: list[int] = []
    try:
        with terminable():
            if workers <= 1:
                yield _here(function, jobs, done)
            else:
                with Pool(workers) as pool:
                    yield _in_order(pool, function, jobs, done)
    except KeyboardInterrupt:
        what = (
            f"{len(done)} of {len(jobs)} were made, every file there is whole; run it again for the"
            " rest"
        )
        raise KeyboardInterrupt(what) from None


def _here(function: Callable[..., T], jobs: Sequence[tuple], done: list[int]) -> Iterator[T]:
    for k, job in enumerate(jobs):
        result = function(*job)
        done.append(k)
        yield result


def _in_order(
    pool: Pool, function: Callable[..., T], jobs: Sequence[tuple], done: list[int]
) -> Iterator[T]:
    results: dict[int, tuple[T, BaseException | None]] = {}
    todo = iter(enumerate(jobs))
    for k in range(len(jobs)):
        while k not in results:
            for at, job in islice(todo, pool.room):
                pool.submit(at, function, *job)
            at, result, error = pool.take()
            results[at] = result, error
            if error is None:
                done.append(at)
        result, error = results.pop(k)
        if error is not None:
            raise error
        yield result


@contextmanager
def terminable() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end the program like an exception.

    SIGHUP comes when a terminal is closed. Handlers of others are left in place.
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
_notes = -1, 0  # file descriptor and process; none in a process that is no worker


def note(at: int, data: bytes) -> None:
    """Record which part of the job is under way, in case the process ends.

    The seconds that the job has begin anew.
    """
    file, process = _notes
    if process == os.getpid():  # and not a job's fork
        os.pwrite(file, at.to_bytes(8) + data, 0)


def ended(e: BaseException) -> bool:
    """Return whether an exception is the end that was asked for, or a Ctrl-C."""
    return isinstance(e, _Ended) or (isinstance(e, KeyboardInterrupt) and _notes[1] != os.getpid())


def serve(connection: int, notes: int, memory: int | None) -> None:
    """Do the jobs that come over a file descriptor until it is closed."""
    global _notes
    _notes = notes, os.getpid()
    signal.signal(signal.SIGTERM, _end)
    if memory:
        import resource

        with suppress(ValueError):  # what is permitted is less already
            resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    client, own = Connection(connection), os.getpid()
    with suppress(EOFError, OSError):
        begun = _answer(client.recv_bytes())
        failed = pickle.loads(begun)[1] is not None
        client.send_bytes(b"")
        while True:
            job = client.recv_bytes()
            answer = begun if failed else _answer(job)
            if os.getpid() != own:
                os._exit(0)  # the job has forked, and this is the other one: it was not asked
            client.send_bytes(answer)


def _answer(data: bytes) -> bytes:
    try:
        function, args = pickle.loads(data)
        return pickle.dumps((function(*args), None))
    except _Ended:
        raise
    except BaseException as e:
        return _failure(e.with_traceback(None))  # which may hold what fills the memory


def _failure(e: BaseException) -> bytes:
    """Return the answer of a job that raised an error.

    It holds the error itself; its text where the error cannot be pickled and made
    again, or would end the driver too, as SystemExit does; its name where it gives no
    text.
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


def _begin(function: Callable[..., Any] = int, *args: Any) -> None:
    function(*args)
