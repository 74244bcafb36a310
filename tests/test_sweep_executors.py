"""Sweeps on executors of all kinds, and what is killed in the middle: the same bits,
nothing lost but what flew, nothing doubled.
"""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pyarrow.parquet as pq
import pytest
from laws import mostly
from refusals import refused
from swept import ROWS, SCENE, WORDS, deadly_in_the_middle, last
from waiting import until

from stimlib import BadValue, Input, Scene, SinkError
from stimlib.cli.sweeps import _where
from stimlib.sweep import sweep
from stimlib.sweep.scheduler import Scheduler

distributed = pytest.importorskip("distributed")
ALL = 32
QUIET = {"threads_per_worker": 1, "silence_logs": 50, "dashboard_address": ":0"}
EXECUTORS = {
    "own": lambda: None,
    "threads": lambda: ThreadPoolExecutor(2),
    "processes": lambda: ProcessPoolExecutor(2, get_context("spawn")),
}


def swept(measures, **words):
    """The sweep of all rows, as a rule in this process."""
    return sweep(SCENE, ROWS, measures=measures, **({"workers": 0} | words), **WORDS)


@pytest.fixture(scope="module")
def cluster():
    with (
        distributed.LocalCluster(2, **QUIET) as made,
        distributed.Client(made) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def here():
    return swept(["rms", last])


@pytest.fixture(params=mostly(["own", "dask"], [*EXECUTORS, "dask"]))
def executor(request):
    if request.param == "dask":
        yield request.getfixturevalue("cluster").get_executor()
    elif made := EXECUTORS[request.param]():
        with made:
            yield made
    else:
        yield None


def whole(folder):
    """Rows of all parts: none of them twice."""
    keys = [
        key for p in folder.glob("part-*.parquet") for key in pq.read_table(p)["key"].to_pylist()
    ]
    assert len(keys) == len(set(keys))
    return len(keys)


def test_an_executor_gives_the_bits_of_this_process_and_survives_its_rows(
    executor, here, monkeypatch
):
    monkeypatch.setattr("stimlib.sweep.scheduler.MOST_ROWS", 5)
    table = swept(["rms", deadly_in_the_middle], executor=executor, workers=2)
    (at,) = np.flatnonzero(table["error"].is_valid())
    bad = table.to_pylist()[at]
    assert (bad["k"], bad["A"], bad["seed"], bad["motion"]) == (7.0, 3.4, 2, "fast")
    assert bad["error"].startswith("3 times: it ended its process by signal 9")
    rest = np.delete(np.arange(ALL), at)
    for name, other in (("rms_force1", "rms_force1"), ("deadly_in_the_middle", "last")):
        assert table[name].take(rest).equals(here[other].take(rest))


def test_a_worker_of_a_cluster_that_is_killed_loses_nothing(cluster, here, tmp_path, monkeypatch):
    monkeypatch.setattr("stimlib.sweep.scheduler.MOST_ROWS", 2)
    monkeypatch.setattr("stimlib.sweep.store.EVERY", 0.0)
    killed = []
    take = Scheduler.take

    def kill_one(scheduler):
        if not killed:
            killed.append(next(iter(cluster.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)
        return take(scheduler)

    monkeypatch.setattr(Scheduler, "take", kill_one)
    words = {"executor": cluster.get_executor(), "workers": 2, "out": tmp_path}
    assert swept(["rms", last], **words).equals(here) and killed and whole(tmp_path) == ALL
    assert swept(["rms", last], **words).equals(here), "nothing runs again"


def test_other_versions_are_told_and_so_is_a_scheduler_that_is_not_there(cluster, monkeypatch):
    where = _where(cluster.scheduler.address, None, [])
    assert where["workers"] == 8
    monkeypatch.setattr("stimlib.sweep.study.versions", lambda: {"numpy": "1.0"})
    says = "a worker has numpy .*, and not 1.0 as here: .* install the same there"
    refused(BadValue, says, swept, "rms", **where)
    where["executor"]._client.close()
    monkeypatch.setattr("stimlib.cli.sweeps.PATIENCE", 0.5)
    says, nowhere = "no Dask scheduler at tcp://127.0.0.1:1", "tcp://127.0.0.1:1"
    refused(SinkError, says, _where, nowhere, None, [])


def test_two_sweeps_at_once_have_their_own_factories(cluster):
    def figures(k):
        def make(a):
            time.sleep(0.02)
            return Scene({"y": k * a * Input("x")})

        words = {
            "motion": np.ones(10),
            "measures": "peak",
            "fs": 1000,
            "progress": False,
            "workers": 2,
        }
        with distributed.Client(cluster.scheduler.address, set_as_default=False) as client:
            return sweep(
                make, {"a": np.arange(1.0, 31.0)}, executor=client.get_executor(), **words
            )["peak_y"].to_numpy()

    with ThreadPoolExecutor() as threads:
        one, five = threads.map(figures, (1.0, 5.0))
    np.testing.assert_array_equal(one, np.arange(1.0, 31.0))
    np.testing.assert_array_equal(five, 5.0 * one)


CLIENT = """
import sys
from stimlib.sweep import scheduler, store, sweep
from swept import ROWS, SCENE, WORDS, last
scheduler.MOST_ROWS = 2
store.EVERY = 0.0
where = {}
if len(sys.argv) > 2:
    from distributed import Client
    where = {"executor": Client(sys.argv[2]).get_executor()}
try:
    sweep(SCENE, ROWS, measures=["rms", last], out=sys.argv[1], workers=2, **where, **WORDS)
except KeyboardInterrupt as e:
    print(e)
    sys.exit(130)
"""
ENDS = {
    signal.SIGINT: (130, "{} of 32 rows done; run it again"),
    signal.SIGKILL: (-signal.SIGKILL, ""),
    "its cluster": (1, "SinkError: the executor failed"),
}


@pytest.mark.parametrize("stop", mostly([signal.SIGINT], ENDS))
def test_a_sweep_that_was_stopped_goes_on(tmp_path, monkeypatch, stop):
    (tmp_path / "held").touch()  # four of its rows wait while this is there
    monkeypatch.setenv("STIMLIB_HELD", str(tmp_path / "held"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    folder, cluster = tmp_path / "out", None
    if stop == "its cluster":
        cluster = distributed.LocalCluster(2, **QUIET)
    where = [cluster.scheduler_address] if cluster else []
    words = [sys.executable, "-c", CLIENT, folder, *where]
    with subprocess.Popen(words, stdout=-1, stderr=-1, text=True, start_new_session=True) as job:
        try:
            until(lambda: len([*folder.glob("part-*")]) >= 6 or job.poll() is not None)
        finally:
            cluster.close() if cluster else job.send_signal(stop)
        out, err = job.communicate()
    there, (code, says) = whole(folder), ENDS[stop]
    assert 6 <= there <= ALL - 4 and says.format(there) in out + err, (there, out, err)
    assert job.returncode == code and ("Traceback" in err) == (code == 1), err
    monkeypatch.undo()
    assert swept(["rms", last], workers=0, out=folder).equals(swept(["rms", last]))
    assert whole(folder) == ALL
