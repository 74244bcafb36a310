"""Work in several processes, which end with the one that gave it, however that ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, TypeVar

T = TypeVar("T")
PATIENCE = 2.0  # s, for a worker to take back what it writes


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
    futures: list[Future[T]] = []
    try:
        if workers <= 1:
            yield (_at_once(futures, function, job) for job in jobs)
        else:
            with _terminable(), _workers(workers) as pool:
                kept = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # workers inherit it: Ctrl-C is for this process
                try:
                    futures += [pool.submit(_run, function, *job) for job in jobs]
                finally:
                    signal.pthread_sigmask(signal.SIG_SETMASK, kept)
                yield (f.result() for f in futures)
    except KeyboardInterrupt:
        done = sum(f.done() and not f.cancelled() and f.exception() is None for f in futures)
        what = f"{done} of {len(jobs)} were made, every file there is whole; run it again for the rest"
        raise KeyboardInterrupt(what) from None


def _at_once(futures: list[Future[T]], function: Callable[..., T], job: tuple) -> T:
    result = function(*job)
    futures.append(Future())
    futures[-1].set_result(result)
    return result


@contextmanager
def _workers(n: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that live as long as one end of a pipe is open, which nobody writes into."""
    spawn = multiprocessing.get_context("spawn")
    theirs, ours = spawn.Pipe(duplex=False)
    pool = ProcessPoolExecutor(n, spawn, _begin, (theirs,))
    try:
        yield pool
    except BaseException:
        ours.close()  # before they are waited for
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        ours.close()
        theirs.close()


@contextmanager
def _terminable() -> Iterator[None]:
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
def _begin(parent: Connection) -> None:
    signal.signal(signal.SIGTERM, _end)
    threading.Thread(target=_follow, args=(parent,), daemon=True).start()


def _follow(parent: Connection) -> None:
    parent.poll(None)  # until the other end is closed
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(PATIENCE)
    os._exit(128 + signal.SIGTERM)


def _run(function: Callable[..., T], *job: Any) -> T:
    try:
        return function(*job)
    except SystemExit as e:  # of _end; the pool would send it to the parent and go on
        os._exit(e.code if isinstance(e.code, int) else 1)
