"""Sweeps on a Dask cluster, and whatever is killed in the middle: the same bits,
nothing lost but what flew, nothing doubled.
"""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pyarrow.parquet as pq
import pytest
from laws import mostly
from refusals import refused
from swept import ROWS, SCENE, WORDS, deadly_in_the_middle, last
from waiting import until

from stimlib import BadValue, Input, Scene, SinkError
from stimlib.sweep import engines, sweep

distributed = pytest.importorskip("distributed")
ALL = 32
QUIET = {"threads_per_worker": 1, "silence_logs": 50}


def swept(measures, **words):
    """The sweep of all rows, as a rule in this process."""
    return sweep(SCENE, ROWS, measures=measures, **(words or {"workers": 0}), **WORDS)


@pytest.fixture(scope="module")
def cluster():
    with (
        distributed.LocalCluster(2, dashboard_address=":0", **QUIET) as made,
        distributed.Client(made) as client,
    ):
        yield client


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """Workers that were killed come again, on a busy machine late: only one test is
    about that warning.
    """
    monkeypatch.setattr(engines, "LONELY", 600.0)


def whole(folder):
    """Rows of all parts: none of them twice."""
    keys = [
        key for p in folder.glob("part-*.parquet") for key in pq.read_table(p)["key"].to_pylist()
    ]
    assert len(keys) == len(set(keys))
    return len(keys)


def test_a_cluster_gives_the_bits_of_this_process_and_survives_its_workers(
    cluster, tmp_path, monkeypatch
):
    here = swept(["rms", last])
    monkeypatch.setattr(engines, "FEWEST", 2)
    monkeypatch.setattr("stimlib.sweep.scheduler.MOST_ROWS", 2)
    monkeypatch.setattr("stimlib.sweep.store.EVERY", 0.0)
    killed = []
    take = engines.Cluster.take

    def kill_one(engine):
        if not killed:
            killed.append(next(iter(cluster.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)
        return take(engine)

    monkeypatch.setattr(engines.Cluster, "take", kill_one)
    words = {"on": cluster, "out": tmp_path}
    assert swept(["rms", last], **words).equals(here) and killed and whole(tmp_path) == ALL
    assert swept(["rms", last], **words).equals(here), "nothing runs again"


def test_other_versions_are_told_before_the_first_run(cluster, monkeypatch):
    monkeypatch.setattr("stimlib.sweep.study.versions", lambda: {"numpy": "1.0"})
    says = r"worker tcp://.* has numpy .*, and not 1.0 as here: .* install the same there"
    refused(BadValue, says, swept, "rms", on=cluster)
    monkeypatch.setattr(engines, "PATIENCE", 0.5)
    says, nowhere = "no Dask scheduler at tcp://127.0.0.1:1", "tcp://127.0.0.1:1"
    refused(SinkError, says, swept, "rms", on=nowhere)


def test_that_a_cluster_has_no_workers_is_said_once_and_they_are_waited_for(monkeypatch):
    monkeypatch.setattr(engines, "LONELY", 0.2)
    said = []
    with (
        distributed.LocalCluster(1, processes=False, dashboard_address=None, **QUIET) as made,
        distributed.Client(made) as client,
    ):
        made.scale(0)
        until(lambda: not client.nthreads())

        def come(text, *_, **__):
            said.append(text)
            time.sleep(0.5)  # still nobody
            made.scale(1)

        monkeypatch.setattr(engines.warnings, "warn", come)
        table = swept("rms", on=client)
    (text,) = said
    assert "has no workers: the sweep waits for some to come" in text
    assert table.equals(swept("rms"))


def test_two_sweeps_at_once_have_their_own_factories(cluster):
    def figures(k):
        def make(a):
            time.sleep(0.02)
            return Scene({"y": k * a * Input("x")})

        words = {"motion": np.ones(10), "measures": "peak", "fs": 1000, "progress": False}
        with distributed.Client(cluster.scheduler.address, set_as_default=False) as client:
            return sweep(make, {"a": np.arange(1.0, 31.0)}, on=client, **words)["peak_y"].to_numpy()

    with ThreadPoolExecutor() as threads:
        one, five = threads.map(figures, (1.0, 5.0))
    np.testing.assert_array_equal(one, np.arange(1.0, 31.0))
    np.testing.assert_array_equal(five, 5.0 * one)


@pytest.mark.stress
def test_a_row_that_ends_its_worker_is_an_error_of_that_row(cluster):
    table = swept(["rms", deadly_in_the_middle], on=cluster)
    (bad,) = [r for r in table.to_pylist() if r["error"]]
    assert (bad["k"], bad["A"], bad["seed"], bad["motion"]) == (7.0, 3.4, 2, "fast")
    assert bad["error"].startswith("3 times: it ended its process by signal 9")


CLIENT = """
import sys
from stimlib.sweep import engines, scheduler, store, sweep
from swept import ROWS, SCENE, WORDS, last
engines.FEWEST = scheduler.MOST_ROWS = 2
store.EVERY = 0.0
where = {"on": sys.argv[2]} if len(sys.argv) > 2 else {"workers": 2}
try:
    sweep(SCENE, ROWS, measures=["rms", last], out=sys.argv[1], **where, **WORDS)
except KeyboardInterrupt as e:
    print(e)
    sys.exit(130)
"""
ENDS = {
    signal.SIGINT: (130, "{} of 32 rows were done; run it again"),
    signal.SIGKILL: (-signal.SIGKILL, ""),
    "its cluster": (1, "SinkError: the cluster went away"),
}


@pytest.mark.parametrize("stop", mostly([signal.SIGINT], ENDS))
def test_a_sweep_that_was_stopped_goes_on(tmp_path, monkeypatch, stop):
    (tmp_path / "held").touch()  # four of its rows wait while this is there
    monkeypatch.setenv("STIMLIB_HELD", str(tmp_path / "held"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    folder, cluster = tmp_path / "out", None
    if stop == "its cluster":
        cluster = distributed.LocalCluster(2, dashboard_address=None, **QUIET)
    where = [cluster.scheduler_address] if cluster else []
    words = [sys.executable, "-c", CLIENT, folder, *where]
    with subprocess.Popen(words, stdout=-1, stderr=-1, text=True, start_new_session=True) as job:
        try:
            until(lambda: len([*folder.glob("part-*")]) >= 6 or job.poll() is not None)
        finally:
            cluster.close() if cluster else job.send_signal(stop)
        out, err = job.communicate(timeout=120)
    there, (code, says) = whole(folder), ENDS[stop]
    assert 6 <= there <= ALL - 4 and says.format(there) in out + err, (there, out, err)
    assert job.returncode == code and ("Traceback" in err) == (code == 1), err
    monkeypatch.undo()
    assert swept(["rms", last], workers=0, out=folder).equals(swept(["rms", last]))
    assert whole(folder) == ALL
