"""Work in several processes, which end with the one that gave it, however that ends."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from typing import Any, Self, TypeVar

from ..errors import StimlibError

T = TypeVar("T")
PATIENCE = 2.0  # s, for a worker to take back what it writes
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # processes share the cores already


class WorkerDied(StimlibError, RuntimeError):
    """A process ended in the middle of a job, or before it could begin with any."""


class _Worker:
    """One process, the connection to it, and what it is at."""

    def __init__(self, process: subprocess.Popen, connection: Connection):
        self.process, self.connection = process, connection
        self.begun = False
        self.job: Any = None


class Pool:
    """Processes of one thread each, which do one job after another.

    They are new interpreters that run nothing of the program that made them: a script needs no ``if __name__ == "__main__"``.
    Functions and arguments travel as pickles.  When the ``with`` block ends they end too, with what they write taken back; where
    this process is killed, they also do.  Ctrl-C is for this process alone.

    Parameters
    ----------
    workers : int
        Processes, at least 1.
    begin : callable and its arguments, optional
        Called once in each process, before its first job.

    Examples
    --------
    >>> from stimlib.core.pool import Pool
    >>> with Pool(1) as pool:
    ...     pool.submit("a power", pow, 2, 5)
    ...     pool.take()
    ('a power', 32, None)
    """

    def __init__(self, workers: int, *begin: Any):
        self._begin = pickle.dumps(begin)
        self._gone, self._held = os.pipe()  # nobody writes into it: it ends where this process does
        self._workers = [self._start() for _ in range(workers)]
        for worker in self._workers:
            self._send(worker, self._begin)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.connection.close()  # who has nothing to do ends
        until = time.monotonic() + PATIENCE
        told = False
        for worker in sorted(self._workers, key=lambda w: w.job is not None):
            if worker.job is not None and not told:
                os.close(self._held)  # the others are told
                told = True
            try:
                worker.process.wait(max(0.0, until - time.monotonic()))
            except subprocess.TimeoutExpired:
                worker.process.kill()
                worker.process.wait()
        if not told:
            os.close(self._held)
        os.close(self._gone)

    @property
    def room(self) -> int:
        """How many processes have nothing to do."""
        return sum(worker.job is None for worker in self._workers)

    def submit(self, what: Any, function: Callable[..., Any], *args: Any) -> None:
        """Give a job to a process that has none; ``what`` comes back with its result."""
        worker = next(w for w in self._workers if w.job is None)
        worker.job = (what,)
        self._send(worker, pickle.dumps((function, args)))

    def take(self) -> tuple[Any, Any, BaseException | None]:
        """Wait for a job.

        Returns
        -------
        (what, result, error)
            The error is what the job raised, or ``WorkerDied``: then another process has taken the place of that one.

        Raises
        ------
        WorkerDied
            A process ended before it had begun: no other would do better.
        """
        while True:
            busy = {w.connection: w for w in self._workers if w.job is not None}
            for connection in wait(list(busy)):
                worker = busy[connection]  # type: ignore[index]
                try:
                    answer = worker.connection.recv()
                except (EOFError, OSError):
                    return self._replaced(worker)
                if answer is None:
                    worker.begun = True
                    continue
                (what,), worker.job = worker.job, None
                return (what, *answer)

    def _replaced(self, worker: _Worker) -> tuple[Any, None, WorkerDied]:
        status = worker.process.wait()
        said = f"by signal {-status}" if status < 0 else f"with exit status {status}"
        if not worker.begun:
            raise WorkerDied(f"a worker process ended {said} as it began; what it wrote on stderr says why")
        worker.connection.close()
        new = self._start()
        self._workers[self._workers.index(worker)] = new
        self._send(new, self._begin)
        return worker.job[0], None, WorkerDied(f"it ended its process {said}")

    def _start(self) -> _Worker:
        ours, theirs = multiprocessing.Pipe()
        serve = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve({theirs.fileno()}, {self._gone})"
        kept = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # workers inherit it: Ctrl-C is for this process
        try:
            process = subprocess.Popen(
                [sys.executable, "-c", serve],
                stdin=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(), self._gone),
                env=os.environ | ONE_THREAD,
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, kept)
        theirs.close()
        return _Worker(process, ours)

    @staticmethod
    def _send(worker: _Worker, data: bytes) -> None:
        with suppress(BrokenPipeError, ConnectionResetError):  # `take` will find that it is gone
            worker.connection.send_bytes(data)


@contextmanager
def spread(function: Callable[..., T], jobs: Sequence[tuple], workers: int | None = None) -> Iterator[Iterator[T]]:
    """Call a function with the arguments of each job, in several processes.

    Whatever ends the ``with`` block early also ends the workers, with what they were at taken back: an exception, Ctrl-C, SIGTERM
    (which ends the program like an exception does, where nobody else takes it).  Where this process is killed, they end too.

    Parameters
    ----------
    function : callable
        Of a module; its arguments and results travel between processes.
    jobs : sequence of tuple
    workers : int, optional
        Processes; by default one for each core, at most one for each job.  One is this process itself.

    Yields
    ------
    iterator
        The results, in the order of the jobs, each as soon as it is there; what a job raises is raised here.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C; it says how many jobs were done.

    Examples
    --------
    >>> from stimlib.core.pool import spread
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
        what = f"{len(done)} of {len(jobs)} were made, every file there is whole; run it again for the rest"
        raise KeyboardInterrupt(what) from None


def _here(function: Callable[..., T], jobs: Sequence[tuple], done: list[int]) -> Iterator[T]:
    for k, job in enumerate(jobs):
        result = function(*job)
        done.append(k)
        yield result


def _in_order(pool: Pool, function: Callable[..., T], jobs: Sequence[tuple], done: list[int]) -> Iterator[T]:
    results: dict[int, tuple[T, BaseException | None]] = {}
    given = 0
    for k in range(len(jobs)):
        while k not in results:
            while pool.room and given < len(jobs):
                pool.submit(given, function, *jobs[given])
                given += 1
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
    """SIGTERM ends the program like an exception does, where nobody else takes it."""
    free = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if free:
        signal.signal(signal.SIGTERM, _end)
    try:
        yield
    finally:
        if free:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _end(number: int, frame: Any) -> None:
    signal.signal(number, signal.SIG_IGN)  # once is enough
    raise SystemExit(128 + number)


# In a worker -------------------------------------------------------------------------------------------------------------
def serve(connection: int, parent: int) -> None:
    """Do what comes, until nobody is left who gives anything; both arguments are file descriptors."""
    signal.signal(signal.SIGTERM, _end)
    threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    client, own = Connection(connection), os.getpid()
    failed: Exception | None = None
    with suppress(EOFError, OSError):
        begin = client.recv_bytes()
        try:
            function, *args = pickle.loads(begin) or [_nothing]
            function(*args)
        except Exception as e:
            failed = e
        client.send(None)
        while True:
            answer = _answer(client.recv_bytes(), failed)
            if os.getpid() != own:
                os._exit(0)  # the job has forked, and this is the other one: it was not asked
            client.send_bytes(answer)


def _answer(data: bytes, failed: Exception | None) -> bytes:
    try:
        if failed is not None:
            raise failed
        function, args = pickle.loads(data)
        return pickle.dumps((function(*args), None))
    except Exception as e:
        try:
            pickle.loads(answer := pickle.dumps((None, e)))  # some exceptions cannot be made again
        except Exception:
            answer = pickle.dumps((None, RuntimeError(f"{type(e).__name__}: {e}")))
        return answer


def _nothing() -> None:
    pass


def _follow(parent: int) -> None:
    os.read(parent, 1)  # until the other end is closed
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(PATIENCE)
    os._exit(128 + signal.SIGTERM)
