"""Where the rows of a sweep run: in this process, in processes beside it, or on a Dask cluster."""

from __future__ import annotations

import pickle
import time
import warnings
from collections.abc import Callable
from typing import Any, Self

from ..core.packages import package
from ..core.pool import Pool, WorkerDied
from ..errors import BadValue, MissingPackage, SinkError
from .drive import TASK, drive
from .plan import Plan, versions
from .rows import arrow
from .store import Store
from .work import Motions, Runner, as_bytes, begin, differing, figures_table, from_bytes, run_kept, run_part

BESIDE = 2  # jobs of a cluster for each thread: one that runs and one that waits
FEWEST = 8  # jobs that are sent to a cluster whose workers are still to come
Run = Callable[[Plan, Motions, bytes], tuple[bytes, float]]
PATIENCE = 20.0  # s, for a scheduler to answer
LONELY = 10.0  # s without a result, until workers are looked for
POLL = 0.01  # s


class Here:
    """This process, with the runner that made the first rows."""

    def __init__(self, runner: Runner):
        self._runner = runner
        self._done: list[tuple[Any, tuple[bytes, float], str]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def room(self) -> int:
        return 1 - len(self._done)

    def workers(self) -> int:
        return 1

    def submit(self, what: Any, data: bytes) -> None:
        began = time.perf_counter()
        table = figures_table(self._runner.plan, *self._runner.run(from_bytes(data).to_pylist()))
        self._done.append((what, (as_bytes(table), time.perf_counter() - began), ""))

    def take(self) -> tuple[Any, tuple[bytes, float], str]:
        return self._done.pop()


class Local:
    """Processes of one thread each."""

    def __init__(self, plan: Plan, motions: Motions, workers: int):
        self._workers = workers
        self._pool = Pool(workers, begin, packed((plan, motions)))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.__exit__(*error)

    def room(self) -> int:
        return self._pool.room

    def workers(self) -> int:
        return self._workers

    def submit(self, what: Any, data: bytes) -> None:
        self._pool.submit(what, run_kept, data)

    def take(self) -> tuple[Any, tuple[bytes, float] | None, str]:
        what, result, error = self._pool.take()
        if error is not None and not isinstance(error, WorkerDied):
            raise error
        return what, result, str(error or "")


def packed(what: Any) -> bytes:
    """A pickle that also carries functions of a script or a notebook."""
    try:
        return package("cloudpickle", "a sweep in several processes", "'stimlib[sweep]'").dumps(what)
    except (pickle.PicklingError, TypeError, AttributeError) as e:
        raise BadValue(f"sweep: scene, motion or measures cannot be sent to another process: {e}") from e


class Cluster:
    """A Dask cluster: the same jobs as futures, some for each thread, so that a million rows are never a million futures.

    Plan and motions are tasks and not scattered: data that was scattered dies with the worker that holds it.
    """

    def __init__(self, on: Any, plan: Plan, motions: Motions):
        self._distributed = _distributed()
        self._own = isinstance(on, str)
        if not self._own and not isinstance(on, self._distributed.Client):
            raise BadValue(f"on = {on!r:.80} must be a dask.distributed Client, or the address of a scheduler")
        self._plan, self._motions = plan, motions
        self._on = on

    def __enter__(self) -> Self:
        self._client = connected(self._on) if self._own else self._on
        try:
            self._check()
            self._held = self._client.submit(same, self._plan, key=f"plan-{self._plan.key}-{self._plan.seconds}")
            self._hands = {
                name: (digest, self._client.submit(same, given, key=f"motion-{digest.hex()}"))
                for name, (digest, given) in self._motions.items()
            }
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
        except Exception:
            pass  # it went away
        self._close()

    def _close(self) -> None:
        if self._own:
            self._client.close(timeout=5)

    def _check(self) -> None:
        """Every worker has the packages that this process has."""
        for worker, found in self._client.run(versions, on_error="return").items():
            if isinstance(found, BaseException):
                raise MissingPackage(f"worker {worker} cannot run stimlib: {found}: install stimlib[sweep] there, as here")
            if other := differing(found, self._plan.versions):
                raise BadValue(f"worker {worker} has {other} as here: the figures would differ; install the same there")

    def workers(self) -> int:
        if time.monotonic() > self._asked + 2.0:
            self._threads, self._asked = max(1, sum(self._client.nthreads().values())), time.monotonic()
        return self._threads

    def room(self) -> int:
        return max(0, max(BESIDE * self.workers(), FEWEST) - len(self._flying))

    def submit(self, what: Any, data: bytes) -> None:
        self._send(run_part, what, data)

    def _send(self, run: Run, what: Any, data: bytes) -> None:
        table = from_bytes(data)
        names = table["motion"].unique().to_pylist() if "motion" in table.column_names else [""]
        hands = [(name, *self._hands[name]) for name in names]
        future = self._client.submit(run_sent, run, self._held, [h[:2] for h in hands], [h[2] for h in hands], data, pure=False)
        self._flying[future] = what, data
        self._done.add(future)

    def take(self) -> tuple[Any, tuple[bytes, float] | None, str]:
        while True:
            self._wait()
            future = next(self._done)
            what, data = self._flying.pop(future)
            try:
                return what, future.result(), ""
            except self._distributed.KilledWorker:
                self._send(run_apart, what, data)
            except (self._distributed.CancelledError, OSError) as e:
                raise SinkError(f"the cluster went away ({type(e).__name__}); what is done is kept where out= was given") from e
            finally:
                future.release()

    def _wait(self) -> None:
        """Until a job is done; that a cluster has no workers is said, and they are waited for: a queue may take its time."""
        said, look = False, time.monotonic() + LONELY
        while not self._done.has_ready():
            time.sleep(POLL)
            if not said and time.monotonic() > look:
                look, said = time.monotonic() + LONELY, not self._client.nthreads()
                if said:
                    text = f"the cluster at {self._client.scheduler.address} has no workers: the sweep waits for some to come"
                    warnings.warn(f"{text} (look at its queue, or stop with Ctrl-C)", RuntimeWarning, stacklevel=5)


def _distributed() -> Any:
    return package("distributed", "a sweep on a cluster", "'stimlib[sweep]'")


def connected(address: str) -> Any:
    """A client of the scheduler at an address.

    Raises
    ------
    SinkError
        There is none.
    MissingPackage
        distributed is not installed.
    """
    try:
        return _distributed().Client(address, timeout=PATIENCE)
    except (OSError, ValueError) as e:
        raise SinkError(f"there is no Dask scheduler at {address}: {e}") from e


def same(what: Any) -> Any:
    """A task that holds something."""
    return what


def run_sent(run: Run, plan: Plan, names: list[tuple[str, bytes]], motions: list[Any], data: bytes) -> tuple[bytes, float]:
    """A job as a task, where motions come as results of other tasks."""
    return run(plan, {name: (digest, m) for (name, digest), m in zip(names, motions, strict=True)}, data)


def run_apart(plan: Plan, motions: Motions, data: bytes) -> tuple[bytes, float]:
    """A job whose workers died, in a process of its own beside the worker: what ends that is one row, whose error it is."""
    began, rows = time.perf_counter(), from_bytes(data)
    with Store(None, {}, {}) as store, Local(plan, motions, 1) as engine:
        drive(plan, rows, store, engine, TASK, lambda done: None)
    made = arrow().concat_tables(store.tables, promote_options="permissive").combine_chunks()
    order = arrow("pyarrow.compute").index_in(rows["key"].combine_chunks(), value_set=made["key"].combine_chunks())
    return as_bytes(made.take(order).select([*plan.units, "fault", "error"])), time.perf_counter() - began
