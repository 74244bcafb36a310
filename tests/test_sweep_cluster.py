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
from swept import HANDS, deadly_in_the_middle, last
from waiting import until

from stimlib import BadValue, Input, Scene, SinkError
from stimlib.scenes import squeeze
from stimlib.sweep import engines, grid, sweep

distributed = pytest.importorskip("distributed")
ROWS = grid(motion=HANDS, A=[0.5, 3.4], k=[500.0, 7.0], seed=range(4))
ALL = 32
WORDS = {"motion": HANDS, "fs": 8000, "seconds": 0.05, "progress": False}
SCENE = squeeze(fingers=1)
STRESS = pytest.mark.stress


@pytest.fixture(scope="module")
def cluster():
    with (
        distributed.LocalCluster(
            2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as made,
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
    here = sweep(SCENE, ROWS, measures=["rms", last], workers=0, **WORDS)
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
    there = sweep(SCENE, ROWS, measures=["rms", last], on=cluster, out=tmp_path, **WORDS)
    assert there.equals(here) and killed and whole(tmp_path) == ALL
    assert sweep(SCENE, ROWS, measures=["rms", last], on=cluster, out=tmp_path, **WORDS).equals(
        here
    ), "nothing runs again"


def test_other_versions_are_told_before_the_first_run(cluster, monkeypatch):
    monkeypatch.setattr("stimlib.sweep.study.versions", lambda: {"numpy": "1.0"})
    with pytest.raises(
        BadValue,
        match=r"worker tcp://.* has numpy .*, and not 1.0 as here: .* install the same there",
    ):
        sweep(SCENE, ROWS, measures="rms", on=cluster, **WORDS)
    with pytest.raises(SinkError, match="no Dask scheduler at tcp://127.0.0.1:1"):
        monkeypatch.setattr(engines, "PATIENCE", 0.5)
        sweep(SCENE, ROWS, measures="rms", on="tcp://127.0.0.1:1", **WORDS)


def test_that_a_cluster_has_no_workers_is_said_once_and_they_are_waited_for(monkeypatch):
    monkeypatch.setattr(engines, "LONELY", 0.2)
    said = []
    with (
        distributed.LocalCluster(
            1, processes=False, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as made,
        distributed.Client(made) as client,
    ):
        made.scale(0)
        until(lambda: not client.nthreads())

        def come(text, *_, **__):
            said.append(text)
            time.sleep(0.5)  # still nobody
            made.scale(1)

        monkeypatch.setattr(engines.warnings, "warn", come)
        table = sweep(SCENE, ROWS, measures="rms", on=client, **WORDS)
    assert [t for t in said if "has no workers: the sweep waits for some to come" in t] == said[
        :1
    ] and len(said) == 1, said
    assert table.equals(sweep(SCENE, ROWS, measures="rms", workers=0, **WORDS))


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


@STRESS
def test_a_row_that_ends_its_worker_is_an_error_of_that_row(cluster):
    table = sweep(SCENE, ROWS, measures=["rms", deadly_in_the_middle], on=cluster, **WORDS)
    bad = [r for r in table.to_pylist() if r["error"]]
    assert [(r["k"], r["A"], r["seed"], r["motion"]) for r in bad] == [(7.0, 3.4, 2, "fast")]
    assert bad[0]["error"] == "3 times: it ended its process by signal 9"


CLIENT = """
import sys
sys.path.insert(0, {tests!r})
import test_sweep_cluster as t
t.engines.FEWEST = 2
import stimlib.sweep.scheduler, stimlib.sweep.store
stimlib.sweep.scheduler.MOST_ROWS, stimlib.sweep.store.EVERY = 2, 0.0
on = sys.argv[2] if len(sys.argv) > 2 else None
try:
    words = t.WORDS | {{"on": on, "workers": None if on else 2}}
    t.sweep(t.SCENE, t.ROWS, measures=["rms", t.last], out=sys.argv[1], **words)
except KeyboardInterrupt as e:
    print(e)
    sys.exit(130)
"""


def started(tmp_path, *on):
    """A sweep in a process and session of its own; four of its rows wait while the
    file held is there.
    """
    (tmp_path / "held").touch()
    code = CLIENT.format(tests=os.path.dirname(__file__))
    words = [sys.executable, "-c", code, str(tmp_path / "out"), *on]
    env = os.environ | {"STIMLIB_HELD": str(tmp_path / "held")}
    return subprocess.Popen(words, stdout=-1, stderr=-1, text=True, start_new_session=True, env=env)


def after(job, folder, parts):
    """Wait for so many parts."""

    try:
        until(lambda: len(list(folder.glob("part-*"))) >= parts or job.poll() is not None)
        assert job.poll() is None, job.communicate()
    except BaseException:
        os.killpg(job.pid, signal.SIGKILL)
        raise


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=STRESS)])
def test_a_sweep_that_was_stopped_goes_on(tmp_path, number):
    job, folder = started(tmp_path), tmp_path / "out"
    after(job, folder, 6)
    os.kill(job.pid, number)
    out, err = job.communicate(timeout=120)
    there = whole(folder)
    assert 6 <= there <= ALL - 4 and "Traceback" not in err, (there, err)
    if number == signal.SIGINT:
        assert job.returncode == 130 and f"{there} of {ALL} rows were done; run it again" in out
    workers = ["pgrep", "-s", str(job.pid)]
    until(lambda: not subprocess.run(workers, capture_output=True).stdout)
    here = sweep(SCENE, ROWS, measures=["rms", last], workers=0, out=folder, **WORDS)
    assert whole(folder) == ALL and not here["error"].drop_null()


@STRESS
def test_a_cluster_that_goes_away_loses_only_what_flies(tmp_path, monkeypatch):
    here = sweep(SCENE, ROWS, measures=["rms", last], workers=0, **WORDS)
    monkeypatch.setenv("STIMLIB_HELD", str(tmp_path / "held"))
    words = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(2, **words) as made:
        job = started(tmp_path, made.scheduler_address)
        after(job, tmp_path / "out", 6)
    _, err = job.communicate(timeout=120)
    assert "SinkError: the cluster went away" in err, err
    assert 6 <= whole(tmp_path / "out") <= ALL - 4
    monkeypatch.undo()
    again = sweep(SCENE, ROWS, measures=["rms", last], workers=0, out=tmp_path / "out", **WORDS)
    assert again.equals(here) and whole(tmp_path / "out") == ALL
