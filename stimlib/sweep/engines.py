"""Engines that run the rows of a sweep: local processes, or a Dask cluster."""

from __future__ import annotations

import math
import threading
import time
import warnings
from contextlib import AbstractContextManager
from typing import Any, Self
from uuid import uuid4

from ..errors import BadValue, MissingPackage, SinkError, outside
from ..system.packages import package
from ..system.pool import Pool, TimedOut, WorkerDied
from .plan import Plan, versions
from .scheduler import Death
from .worker import NO_SCENE, Motions, Runner, as_bytes, begin, differing, from_bytes, run_kept

BESIDE = 2  # jobs of a cluster for each thread: one that runs and one that waits
FEWEST = 8  # jobs that are sent to a cluster whose workers are still to come
PATIENCE = 20.0  # s, for a scheduler to answer
LONELY = 10.0  # s without a result, until workers are looked for
POLL = 0.01  # s
# at once on one cluster, each with a process beside each thread; one whose client was
# killed does not end its own
SWEEPS = 4


class Here(AbstractContextManager["Here"]):
    """An engine that runs rows in the calling process, where a debugger can follow.

    The process is not protected from what a row does.
    """

    def __init__(self, plan: Plan, motions: Motions):
        self._runner = Runner(plan, motions)
        self._done: list[tuple[Any, tuple[bytes, float]]] = []

    def __exit__(self, *_: object) -> None:
        """Leave nothing behind."""

    def start_seconds(self) -> float:
        """Return 0: this process has begun."""
        return 0.0

    def widen(self, workers: int) -> None:
        """Ignore the number of workers."""

    def room(self) -> int:
        """Return how many jobs can be submitted now."""
        return 1 - len(self._done)

    def workers(self) -> int:
        """Return the number of workers."""
        return 1

    def submit(self, what: Any, data: bytes, look: bool, seconds: float) -> None:
        """Run a job at once, in this process."""
        began = time.perf_counter()
        table = self._runner.run(from_bytes(data).to_pylist(), look, seconds)
        self._done.append((what, (as_bytes(table), time.perf_counter() - began)))

    def take(self) -> tuple[Any, tuple[bytes, float]]:
        """Return a finished job."""
        return self._done.pop()


class Local(AbstractContextManager["Local"]):
    """An engine of single-threaded processes on this machine; at first only one."""

    def __init__(self, plan: Plan, motions: Motions):
        self._seconds = plan.limits["row_seconds"]
        memory = int(min(plan.limits["row_bytes"], 2**62))
        self._pool = Pool(1, begin, packed((plan, motions)), memory=memory)

    def __exit__(self, *error: object) -> None:
        self._pool.__exit__(*error)

    def start_seconds(self) -> float:
        """Return how long a process took to begin, or 0 if none has."""
        return self._pool.start_seconds

    def widen(self, workers: int) -> None:
        """Use the given number of processes, each as soon as it has begun."""
        self._pool.widen(workers)

    def room(self) -> int:
        """Return how many jobs can be submitted now."""
        return self._pool.room

    def workers(self) -> int:
        """Return the number of workers."""
        return self._pool.workers

    def submit(
        self, what: Any, data: bytes, look: bool, seconds: float, motions: bytes = b""
    ) -> None:
        """Submit a job to a worker process."""
        self._pool.submit(what, run_kept, data, look, seconds, motions, seconds=self._seconds)

    def take(self) -> tuple[Any, tuple[bytes, float] | Death]:
        """Return a finished job, or the death of its worker."""
        what, result, error = self._pool.take()
        if isinstance(error, WorkerDied):
            return what, Death(str(error), error.at, error.data, isinstance(error, TimedOut))
        if error is not None:
            raise error
        return what, result


def packed(what: Any) -> bytes:
    """Return a pickle that can include functions of a script or a notebook."""
    try:
        return package("cloudpickle", "a sweep in several processes").dumps(what)
    except Exception as e:  # of objects of the user's, too
        raise BadValue(
            f"sweep: scene, motion or measures cannot be sent to another process: {e}"
        ) from e


class Cluster:
    """An engine that runs jobs on a Dask cluster, as a few futures per thread.

    A million rows are therefore never a million futures. Plan and motions are sent as
    tasks instead of scattered, because scattered data are lost with the worker that
    holds them.
    """

    def __init__(self, on: Any, plan: Plan, motions: Motions):
        self._distributed = _distributed()
        self._own = isinstance(on, str)
        if not self._own and not isinstance(on, self._distributed.Client):
            raise BadValue(
                f"on = {on!r:.80} must be a dask.distributed Client, or the address of a scheduler"
            )
        self._plan, self._motions = plan, motions
        self._on = on
        self._name = uuid4().hex

    def __enter__(self) -> Self:
        self._client = connected(self._on) if self._own else self._on
        try:
            self._check()
            # no key from what they hold: another sweep may call another factory or
            # motion by the same names
            self._held = self._client.submit(same, self._plan, key=f"plan-{self._name}")
            self._hands = {}
            for name, (digest, given) in self._motions.items():
                key = f"motion-{self._name}-{digest.hex()}"
                self._hands[name] = digest, self._client.submit(same, given, key=key)
        except BaseException:
            self._close()
            raise
        self._done = self._distributed.as_completed()
        self._flying: dict[Any, Any] = {}
        self._asked, self._threads = 0.0, 1
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._client.cancel(list(self._flying))
            self._client.run(end_beside, self._name)
        except Exception:
            pass  # it went away
        self._close()

    def _close(self) -> None:
        if self._own:
            self._client.close(timeout=5)

    def _check(self) -> None:
        """Raise an error unless every worker has this process's package versions."""
        for worker, found in self._client.run(versions, on_error="return").items():
            if isinstance(found, BaseException):
                raise MissingPackage(
                    f"worker {worker} cannot run stimlib: {found}: install stimlib[sweep] there, as"
                    " here"
                )
            if other := differing(found, self._plan.versions):
                raise BadValue(
                    f"worker {worker} has {other} as here: the figures would differ; install the"
                    " same there"
                )

    def workers(self) -> int:
        """Return the total number of threads of all workers."""
        if time.monotonic() > self._asked + 2.0:
            self._threads = max(1, sum(self._client.nthreads().values()))
            self._asked = time.monotonic()
        return self._threads

    def room(self) -> int:
        """Return how many jobs can be submitted now."""
        return max(0, max(BESIDE * self.workers(), FEWEST) - len(self._flying))

    def start_seconds(self) -> float:
        """Return 0: all workers have begun."""
        return 0.0

    def widen(self, workers: int) -> None:
        """Ignore the number of workers, because the cluster decides it."""

    def submit(self, what: Any, data: bytes, look: bool, seconds: float) -> None:
        """Submit a job as a future."""
        table = from_bytes(data)
        names = table["motion"].unique().to_pylist() if "motion" in table.column_names else [""]
        hands = [(name, *self._hands[name]) for name in names]
        keys, futures = [h[:2] for h in hands], [h[2] for h in hands]
        future = self._client.submit(
            run_beside, self._name, self._held, keys, futures, data, look, seconds, pure=False
        )
        self._flying[future] = what
        self._done.add(future)

    def take(self) -> tuple[Any, tuple[bytes, float] | Death]:
        """Return a finished job, or the death of its worker."""
        self._wait()
        future = next(self._done)
        what = self._flying.pop(future)
        try:
            return what, future.result()
        except self._distributed.KilledWorker as e:
            return what, Death(f"the Dask workers that ran it died: {e}", 0, NO_SCENE, False)
        except (self._distributed.CancelledError, OSError) as e:
            raise SinkError(
                f"the cluster went away ({type(e).__name__}); what is done is kept where out= was"
                " given"
            ) from e
        finally:
            future.release()

    def _wait(self) -> None:
        """Wait until a job has finished.

        If the cluster has no workers, this is reported, and the wait continues, because
        a batch queue may take some time.
        """
        look = time.monotonic() + LONELY
        while not self._done.has_ready():
            time.sleep(POLL)
            if time.monotonic() > look:
                look = time.monotonic() + LONELY
                if not self._client.nthreads():
                    text = (
                        f"the cluster at {self._client.scheduler.address} has no workers: the sweep"
                        " waits for some to come (look at its queue, or stop with Ctrl-C)"
                    )
                    warnings.warn(text, RuntimeWarning, stacklevel=outside())
                    look = math.inf  # once


def _distributed() -> Any:
    return package("distributed", "a sweep on a cluster")


def connected(address: str) -> Any:
    """Return a client of the scheduler at an address.

    Raises
    ------
    SinkError
        There is no scheduler at this address.
    MissingPackage
        distributed is not installed.
    """
    try:
        return _distributed().Client(address, timeout=PATIENCE)
    except (OSError, ValueError) as e:
        raise SinkError(f"there is no Dask scheduler at {address}: {e}") from e


def same(what: Any) -> Any:
    """Return the argument unchanged, so that a Dask task can hold it."""
    return what


_beside: dict[tuple[int, str], tuple[Local, set[str]]] = {}
"""In a Dask worker, by thread and name of the sweep: the process next to it, and the
names of its motions.
"""


def run_beside(
    sweep: str,
    plan: Plan,
    keys: list[tuple[str, bytes]],
    motions: list[Any],
    data: bytes,
    look: bool,
    seconds: float,
) -> tuple[bytes, float] | Death:
    """Run a job in a separate process next to a Dask worker.

    If a row crashes that process, only the row fails, and the worker continues.
    """
    if (here := versions()) != plan.versions:
        raise BadValue(f"this worker has other versions: {differing(here, plan.versions)}")
    given = {name: (digest, m) for (name, digest), m in zip(keys, motions, strict=True)}
    thread = threading.get_ident()
    if (thread, sweep) not in _beside:
        held = [key for key in list(_beside) if key[0] == thread]
        for key in held[: 1 - SWEEPS]:
            _end(key)
        _beside[thread, sweep] = Local(plan, given), set(given)
    engine, known = _beside[thread, sweep]
    new = {name: m for name, m in given.items() if name not in known}
    known.update(new)
    engine.submit(None, data, look, seconds, packed(new))
    _, found = engine.take()
    if isinstance(found, Death):
        _end((thread, sweep))  # the next process would have the motions of the first job alone
    return found


def end_beside(sweep: str) -> None:
    """End the processes that a sweep has started next to a Dask worker."""
    for key in list(_beside):
        if key[1] == sweep:
            _end(key)


def _end(key: tuple[int, str]) -> None:
    if key in _beside:
        _beside.pop(key)[0].__exit__()
