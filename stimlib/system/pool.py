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
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from importlib import import_module
from itertools import islice
from typing import IO, Any, TypeVar

from ..errors import StimlibError
from . import watchdog

T = TypeVar("T")
# Processes share the cores already.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class JobFailed(StimlibError, RuntimeError):
    """An error of a job that is known only by its text.

    The error itself could not be pickled, or would end this program too, as SystemExit
    does.
    """


class WorkerDied(JobFailed):
    """The end of a worker process in the middle of a job, or before its first job."""

    at = 0
    """What the job noted last: which part of it was under way, and 16 bytes about
    that.
    """
    data = bytes(16)


class TimedOut(WorkerDied):
    """A job that exceeded its time limit, so that its process was ended."""


NOTE = 1 << 63  # set in the size of a message that is a note, and no answer


class _Worker:
    """A worker process, its messages, and its present job.

    Messages travel through its stdin and stdout. A thread reads its answers, because
    Windows cannot wait for several pipes at once.
    """

    def __init__(self, process: subprocess.Popen, said: queue.Queue[Any]):
        self.process, self.said = process, said
        self.noted = b""
        self.begun = self.late = False
        self.started = time.monotonic()
        self.job: Any = None  # what it is, and its seconds
        self.until = math.inf
        self.thread = threading.Thread(target=self._listen, daemon=True)
        self.thread.start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        with suppress(EOFError, OSError, ValueError), self.process.stdout as stdout:
            while True:
                size, data = _received(stdout)
                if size & NOTE:
                    self.note(data)
                else:
                    self.said.put((self, data))
        self.said.put((self, None))

    def note(self, data: bytes) -> None:
        """Store a note of the job, and restart the time limit of the job."""
        self.noted = data
        if self.job is not None and self.begun and not self.late:
            self.until = time.monotonic() + self.job[1]

    def send(self, data: bytes) -> None:
        """Send a message; a worker that is gone is noticed by `Pool.take`."""
        with suppress(OSError, ValueError):
            _sent(self.process.stdin, data)

    def signal(self, *numbers: int) -> None:
        """Send signals to the worker and the processes that it has started."""
        if watchdog.POSSIBLE:
            watchdog.tell([self.process.pid], *numbers)
        else:
            self.process.kill()


def _received(stream: IO[bytes] | None) -> tuple[int, bytes]:
    """Read the next message of a stream, with its size; EOFError at the end."""
    assert stream is not None
    size = int.from_bytes(stream.read(8).rjust(8, b"\xff"))
    data = stream.read(size & ~NOTE) if size < 2**64 - 1 else b""
    if len(data) < size & ~NOTE:
        raise EOFError
    return size, data


def _sent(stream: IO[bytes] | None, data: bytes, kind: int = 0) -> None:
    assert stream is not None
    stream.write((len(data) | kind).to_bytes(8) + data)
    stream.flush()


class Pool(AbstractContextManager["Pool"]):
    """Worker processes of one thread each, which run one job after another.

    They are new interpreters that run nothing of the program that started them: a
    script needs no ``if __name__ == "__main__"``. Functions and arguments travel as
    pickles. Ctrl-C interrupts only this process.

    The workers end when the ``with`` block ends. They also end within three seconds of
    this process, in whatever way it ends and whatever they are doing. A watchdog
    process sends them SIGTERM, on which they remove half-written files, and kills those
    that are left two seconds later. Processes that a job has started end with its
    worker, except those that have moved into a session of their own. A worker can
    survive only if the watchdog is killed too.

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
        self._watchdog = (
            subprocess.Popen(
                [sys.executable, "-I", "-S", watchdog.__file__, str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            if watchdog.POSSIBLE
            else None
        )
        self._workers: list[_Worker] = []
        self._said: queue.Queue[Any] = queue.Queue()
        self.start_seconds = 0.0
        """How long the last process took to begin."""
        self.widen(workers)

    def __exit__(self, *_: object) -> None:
        # the watchdog ends the workers, as it does where this process is killed;
        # without one, they end where their stdin does
        for process in [self._watchdog] if self._watchdog else [w.process for w in self._workers]:
            with suppress(OSError):
                process.stdin.close()  # type: ignore[union-attr]
        until = time.monotonic() + watchdog.PATIENCE
        for worker in self._workers:
            _end_of(worker, until)
        if self._watchdog:
            self._watchdog.kill()  # nothing is left for it to do
            self._watchdog.wait()

    def widen(self, workers: int) -> None:
        """Start processes until there are this many."""
        while len(self._workers) < workers:
            self._workers.append(self._start())
            self._workers[-1].send(self._begin)

    @property
    def workers(self) -> int:
        """The number of processes."""
        return len(self._workers)

    @property
    def room(self) -> int:
        """The number of idle processes.

        Those that still begin count if no other has begun.
        """
        return len(self._idle())

    def _idle(self) -> list[_Worker]:
        """Return idle processes, which run a job without a wait if they can."""
        begun = any(w.begun for w in self._workers)
        return [w for w in self._workers if w.job is None and w.begun >= begun]

    def submit(
        self, what: Any, function: Callable[..., Any], *args: Any, seconds: float = math.inf
    ) -> None:
        """Submit a job to an idle process.

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
        worker = self._idle()[0]
        worker.job, worker.noted = (what, seconds), b""
        if worker.begun:
            worker.until = time.monotonic() + seconds
        worker.send(job)

    def take(self) -> tuple[Any, Any, BaseException | None]:
        """Wait for a job to end, and return its result.

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
            worker, answer = None, None
            with suppress(queue.Empty):
                worker, answer = self._said.get(timeout=watchdog.TICK)
            if worker is None:
                for w in [w for w in self._workers if w.job is not None]:
                    # it has ended, and a child of it keeps its stdout open
                    if w.process.poll() is not None and self._said.empty():
                        return self._replaced(w)
                    self._end_late(w)
            elif worker not in self._workers:
                pass  # it was replaced
            elif answer is None:
                if worker.job is not None:
                    return self._replaced(worker)
            elif not worker.begun:
                worker.begun = True
                self.start_seconds = time.monotonic() - worker.started
                if worker.job is not None:
                    worker.until = time.monotonic() + worker.job[1]
            elif not worker.late:  # else it is about to end
                return self._taken(worker, answer)

    @staticmethod
    def _end_late(worker: _Worker) -> None:
        """End a process whose job has exceeded its time limit."""
        if time.monotonic() > worker.until:
            worker.signal(
                *([watchdog.SIGKILL] if worker.late else [signal.SIGTERM, watchdog.SIGCONT])
            )
            worker.late, worker.until = True, time.monotonic() + watchdog.PATIENCE

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
        if worker.noted:
            died.at, died.data = int.from_bytes(worker.noted[:8]), worker.noted[8:]
        return what, None, died

    def _start(self) -> _Worker:
        serve = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; "
        process = subprocess.Popen(
            [sys.executable, "-c", serve + f"serve({self._memory})"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD,
            start_new_session=True,
            # Ctrl-C interrupts this process alone, on Windows too
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        self._report(process)
        return _Worker(process, self._said)

    def _report(self, process: subprocess.Popen) -> None:
        """Tell the watchdog that a worker has started or ended."""
        if self._watchdog:
            with suppress(BrokenPipeError):
                os.write(self._watchdog.stdin.fileno(), process.pid.to_bytes(8))  # type: ignore[union-attr]


def _end_of(worker: _Worker, until: float) -> int:
    """Wait for a process until a time, then kill it, and return its exit status."""
    with suppress(subprocess.TimeoutExpired):
        worker.process.wait(max(0.0, until - time.monotonic()))
    worker.signal(watchdog.SIGKILL)
    status = worker.process.wait()
    with suppress(OSError):  # what it did not read
        worker.process.stdin.close()  # type: ignore[union-attr]
    worker.thread.join(watchdog.TICK)
    return status


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
        _sent(stream, at.to_bytes(8) + data, NOTE)


def ended(e: BaseException) -> bool:
    """Return whether an exception is a requested end of the process, or a Ctrl-C."""
    return isinstance(e, _Ended) or (isinstance(e, KeyboardInterrupt) and _driver[1] != os.getpid())


def serve(memory: int | None) -> None:
    """Run the jobs that arrive on stdin until it is closed.

    What a job prints goes to stderr, as stdout carries the answers.
    """
    global _driver
    jobs, answers = open(os.dup(0), "rb"), open(os.dup(1), "wb")
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    _driver = answers, os.getpid()
    signal.signal(signal.SIGTERM, _end)
    if memory and (resource := _resource()):
        with suppress(ValueError):  # what is permitted is less already
            resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    own, receive = os.getpid(), (lambda: _received(jobs)[1])
    if not watchdog.POSSIBLE:
        receive = _lifeline(receive)
    with suppress(EOFError, OSError):
        begun = _answer(receive())
        failed = pickle.loads(begun)[1] is not None
        _sent(answers, b"")
        while True:
            job = receive()
            answer = begun if failed else _answer(job)
            if os.getpid() != own:
                os._exit(0)  # the job has forked, and this is the other one: it was not asked
            _sent(answers, answer)
    # the watchdog's SIGTERM may come while Python ends, which shows exceptions
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _resource() -> Any:
    """Return the module ``resource``, or None on Windows, which does not have it."""
    with suppress(ImportError):
        return import_module("resource")


def _lifeline(receive: Callable[[], bytes]) -> Callable[[], bytes]:
    """Read jobs in a thread that ends this process when the driver has ended.

    It replaces the watchdog: it interrupts the job with SIGTERM, and ends the process
    after a while.
    """
    jobs: queue.Queue[bytes] = queue.Queue()

    def read() -> None:
        with suppress(EOFError, OSError):
            while True:
                jobs.put(receive())
        _thread.interrupt_main(signal.SIGTERM)
        time.sleep(watchdog.PATIENCE)
        os._exit(1)

    threading.Thread(target=read, daemon=True).start()
    return jobs.get


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


def _begin(function: Callable[..., Any] = int, *args: Any) -> None:
    function(*args)
