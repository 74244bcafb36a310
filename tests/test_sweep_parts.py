"""Parts of sweeps on their own: jobs that die, what a worker is told, units of figures,
and what is refused.
"""

import dataclasses
import os
import pickle
import types
from concurrent.futures import Executor, Future
from queue import LifoQueue

import numpy as np
import pyarrow as pa
import pytest
from refusals import refused, warned

import stimlib
from stimlib import BadValue, Input, Param, Scene, SinkError, UnknownName
from stimlib.analysis.physical_cues import Cues, cues
from stimlib.blocks import springpot
from stimlib.core.units import unit
from stimlib.motion.generators import minimum_jerk
from stimlib.sweep import measure, rendering, sweep
from stimlib.sweep.keys import row_keys
from stimlib.sweep.measures import CUE_UNITS, measures_of
from stimlib.sweep.rows import table_of
from stimlib.sweep.scheduler import DEATHS, Scheduler
from stimlib.sweep.store import Store
from stimlib.sweep.study import planned
from stimlib.sweep.worker import (
    NO_SCENE,
    Runner,
    as_bytes,
    error_text,
    from_bytes,
    packed,
    pool_of,
    run_beside,
    take,
)
from stimlib.system.pool import JobFailed, TimedOut, WorkerDied

SPRING = Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")})
STEADY = {
    "motion": np.full(400, 0.5),
    "fs": 8000,
    "seconds": None,
    "live": None,
    "measures": ["peak"],
    "kept": True,
}
RUN = {"motion": np.full(400, 0.5), "fs": 8000, "measures": "peak", "progress": False, "workers": 0}


def prepared(rows, **words):
    """Return rows with keys, plan and motions."""
    table, plan, motions, *_ = planned(SPRING, table_of(rows), {**STEADY, **words})
    return (
        table.append_column("key", row_keys(plan, table, {n: d for n, (d, _) in motions.items()})),
        plan,
        motions,
    )


class Fragile(Scheduler):
    """A scheduler that sends three jobs, takes the last one first, and whose process
    dies of k = 7.
    """

    died_of = WorkerDied

    def __init__(self, plan, motions):
        super().__init__(plan, motions, workers=0)
        self.died, self.workers, self._done = [], 3, LifoQueue()

    def take(self):
        rows, deaths, result = super().take()
        if 7.0 in (ks := rows["k"].to_pylist()):
            self.died.append(len(ks))
            result = self.died_of("it ended")
            result.at, result.data = ks.index(7.0), bytes(range(16))
        return rows, deaths, result


def driven(table, scheduler, row_seconds=1.0):
    """The rows that a scheduler gives, sorted, and how many were told as done."""
    kept, told = [], []
    scheduler.drive(table, kept.append, row_seconds, told.append)
    assert sum(told) == table.num_rows
    return pa.concat_tables(kept).sort_by("k")


def test_a_job_that_dies_runs_again_without_the_row_that_ended_it():
    table, plan, motions = prepared({"k": np.arange(1.0, 11.0)})
    fragile = Fragile(plan, motions)
    made = driven(table, fragile, 1e-9)
    assert made["k"].to_pylist() == table["k"].to_pylist()
    assert made["peak_force"].to_pylist() == [None if k == 7 else k / 2 for k in range(1, 11)]
    assert made["error"].drop_null().to_pylist() == [f"{DEATHS} times: it ended"]
    before, died, after = made["content"].to_pylist()[5:8]
    assert died == bytes(range(16)) != before == after
    assert fragile.died[0] > 1 and fragile.died[1:] == [1] * (DEATHS - 1)
    fragile = Fragile(plan, motions)
    fragile.died_of = TimedOut
    assert driven(table.slice(6, 1), fragile)["error"].to_pylist() == ["it ended"], "past its limit"


def test_a_worker_notes_which_row_it_is_at_before_its_scene_is_made(monkeypatch):
    table, plan, motions = prepared({"k": [1.0, 2.0]})
    noted = []
    monkeypatch.setattr("stimlib.sweep.worker.pool.note", lambda *told: noted.append(told))
    contents = Runner(plan, motions).run(table.to_pylist())["content"].to_pylist()
    # the second row has the scene of the first
    assert noted == [(0, NO_SCENE), (0, contents[0]), (1, contents[1])] and contents[0] != NO_SCENE


def test_a_worker_has_the_limits_of_the_sweep(monkeypatch):
    _, plan, motions = prepared({"k": [1.0]})
    monkeypatch.setattr(stimlib.limits, "table_knots", stimlib.limits.table_knots)  # to be put back
    monkeypatch.setattr("stimlib.sweep.worker._runner", None)
    take(
        pickle.dumps((dataclasses.replace(plan, limits=plan.limits | {"table_knots": 77}), motions))
    )
    assert stimlib.limits.table_knots == 77


def test_a_long_error_is_cut():
    assert error_text(ValueError(1000 * "x")) == f"ValueError: {488 * 'x'}"


def test_jobs_grow_where_rows_are_quicker_than_was_thought():
    """0.3 s each was thought, 0.15 s is seen: a second of work is 3 rows, then at 0.225
    s 4 of them.
    """
    sizes = []

    class Timed(Scheduler):
        def take(self):
            rows, deaths, (data, _) = super().take()
            sizes.append(rows.num_rows)
            return rows, deaths, (data, 0.15 * rows.num_rows)

    rows, plan, motions = prepared({"k": np.arange(1.0, 41.0)})
    Timed(plan, motions, workers=0).drive(rows, lambda made: None, 0.3, lambda done: None)
    assert sizes[:2] == [3, 4] and sum(sizes) == 40


def test_a_job_hands_back_what_it_has_done_in_its_time():
    rows, plan, motions = prepared({"k": np.arange(1.0, 6.0)})
    never = Scheduler(plan, motions, workers=0)
    never.submit(rows, 2, False, 0.0)
    _, deaths, (data, _) = never.take()
    assert (deaths, from_bytes(data)["peak_force"].to_pylist()) == (2, [0.5])
    submit = never.submit
    never.submit = lambda rows, deaths, look, seconds: submit(rows, deaths, look, 0.0)
    assert driven(rows, never, 1e-9)["peak_force"].to_pylist() == [0.5, 1.0, 1.5, 2.0, 2.5]


def test_a_part_is_written_as_soon_as_it_is_large(tmp_path, monkeypatch):
    monkeypatch.setattr("stimlib.sweep.store.LARGEST", 2)
    monkeypatch.setattr("stimlib.sweep.store.EVERY", 1e9)
    with Store(tmp_path, {"key": "k"}, {"units": {}, "motion": {}}) as store:
        for parts in (0, 1, 1):
            store.add(pa.table({"k": [float(store.rows)]}))
            assert len(list(tmp_path.glob("*.parquet"))) == parts


class Failing(Executor):
    """An executor with one result for all jobs, or one error."""

    def __init__(self, result=None, error=None):
        self.future = Future()
        self.future.set_exception(error) if error else self.future.set_result(result)

    def submit(self, *job):
        return self.future


class Waiting(Executor):
    """An executor that runs nothing."""

    def submit(self, *job):
        return Future()


def test_an_executor_has_two_jobs_for_each_worker_which_are_cancelled_at_the_end():
    table, plan, motions = prepared({"k": [1.0]})
    with Scheduler(plan, motions, Waiting(), 2) as scheduler:
        while scheduler.room > 0:
            scheduler.submit(table, 0, False, 1.0)
    assert [future.cancelled() for future in scheduler.flying] == [True] * 4


def test_what_is_no_death_of_a_process_is_raised():
    lost, words = ModuleNotFoundError("own_study"), RUN | {"workers": 1}
    for executor, error, says in (
        (Failing(lost), ModuleNotFoundError, "own_study"),
        (Failing(error=lost), SinkError, "executor failed .ModuleNotFoundError: own_study"),
    ):
        refused(error, says, sweep, SPRING, {"k": [1.0, 2.0]}, executor=executor, **words)

    class Stays:
        def __reduce__(self):
            raise RuntimeError("it stays here")

    held = Stays()
    kept = RUN | {"workers": 2, "measures": [measure("1")(lambda run: held)]}
    refused(BadValue, "cannot be sent .* process", sweep, SPRING, {"k": [1.0, 2.0]}, **kept)


def test_a_process_beside_a_thread_takes_the_plan_that_comes():
    def beside(sweep="one", name="a", k=2.0, known=True, **words):
        """The peak of a row, or the error; where that is not known, with the plan."""
        given = {"motion": {name: np.full(400, words.pop("x", 0.5))}}
        table, plan, motions = prepared({"k": [k], "motion": [name]}, **given, **words)
        told, limits = plan.versions, plan.limits
        data = b"" if known else packed((plan, motions))
        found = run_beside(0, sweep, told, limits, {name}, data, as_bytes(table), False, 1.0)
        if not isinstance(found, tuple):
            return found
        return from_bytes(found[0]).to_pylist()[0]["peak_force"]

    dies = measure("N", version="1")(lambda run: os.abort() if run.params["k"] == 7.0 else 0.0)
    try:
        assert beside() is None and beside(known=False) == 1.0 == beside()
        assert beside(name="b") is None, "of a motion that it does not know"
        assert beside(name="b", x=1.5, known=False) == 3.0 == beside(name="b") == 3 * beside()
        assert beside("two") is None and beside("two", fs=4000, known=False) == 1.0
        words = {"measures": ["peak", dies]}
        assert beside("three", known=False, **words) == 1.0
        died = beside("three", k=7.0, **words)
        assert isinstance(died, WorkerDied) and died.data != NO_SCENE
        assert beside("three", **words) is None, "a process that died knows nothing"
        assert beside() == 1.0, "the others are what they were"
    finally:
        for sweep_ in ("one", "two", "three"):
            pool_of(sweep_).__exit__()


def test_a_process_that_cannot_take_a_plan_is_no_row_that_fails():
    def died(*job, **words):
        raise WorkerDied("it ended")

    _, plan, _ = prepared({"k": [1.0]})
    words = plan.limits, {""}, b"no pickle", b"", False, 1.0
    try:
        assert type(run_beside(0, "bad", plan.versions, *words)) is pickle.UnpicklingError
        other = str(run_beside(0, "bad", {"numpy": "1.0"}, *words))
        assert "a worker has numpy" in other and ", and not 1.0 as here" in other
        with pool_of("bad").worker() as worker:
            worker.ask = died
        assert type(run_beside(0, "bad", plan.versions, *words)) is JobFailed
    finally:
        pool_of("bad").__exit__()


# Figures ------------------------------------------------------------------------------
def test_cues_scale_as_their_units_say():
    t = np.arange(1000) / 1000
    x, f = (
        0.01 * (1 - np.cos(8 * np.pi * t)),
        3.0 - 3.0 * np.cos(8 * np.pi * t - 0.3) + np.sin(16 * np.pi * t),
    )
    one, other = cues(x, f, 1000)._asdict(), cues(2 * x, 5 * f, 250)._asdict()
    scale = {"N": 5.0, "m": 2.0, "s": 4.0, "J": 10.0}
    for name, text in CUE_UNITS.items():
        assert np.isfinite(one[name]) and one[name] != 0, name
        assert other[name] / one[name] == pytest.approx(eval(text, {}, scale), rel=1e-6), name


def test_figures_have_their_units_and_cues_take_displacement_and_force():
    scene = Scene({"force": SPRING.outputs["force"], "p": 1.0 * Input("q")})
    (density,) = measures_of("psd(100, 100)", SPRING)
    assert unit(density.units["psd_100_force"]) == unit("N^2*s")
    assert list(measures_of("cues", scene)[0].units) == [f"{name}_force" for name in Cues._fields]
    for text in ("cues(x)", "cues(force, x)", "cues(x, x)", "cues(force, force)"):
        refused(BadValue, "a displacement and a force", measures_of, text, scene)
    refused(BadValue, "is no measure", measures_of, "band(20, 1e999)", scene)


# What is refused, or told -------------------------------------------------------------
def test_a_run_is_as_long_as_its_shortest_motion():
    scene = Scene({"y": Input("x") + Input("z")})
    words = RUN | {"motion": {"x": np.ones(300), "z": np.ones(200)}}
    assert sweep(scene, {"seed": [0]}, dry=True, **words).samples == 200


def test_a_row_that_is_not_there_is_refused():
    for at, says in ((0.0, "at = 0.0 must be"), (-1, "no row -1: .* 0 to 1"), (2, "no row 2")):
        rows, words = {"k": [1.0, 2.0]}, {"motion": RUN["motion"], "fs": 8000}
        refused(BadValue, says, rendering, SPRING, rows, at, **words)
    words = RUN | {"motion": {"b": np.ones(400)}}
    refused(UnknownName, "motion 'a'.* has b", sweep, SPRING, {"motion": ["b", "a"]}, **words)


def test_hands_that_are_too_fast_and_runs_that_are_too_long_are_told():
    fast = RUN | {"motion": minimum_jerk(depth=20.0), "seconds": 0.5}
    warned(RuntimeWarning, "faster than a hand", sweep, SPRING, {"k": [1.0]}, **fast)
    long = Scene({"f": springpot(Input("x", "m"), 1.0, 0.5, horizon=0.01)})
    warned(RuntimeWarning, "longer than horizon", sweep, long, {"seed": [0]}, **RUN)


def test_a_forecast_counts_what_is_there_and_an_error_of_the_rest_is_theirs(tmp_path):
    words = RUN | {"out": tmp_path / "a"}
    told = sweep(SPRING, {"k": [1.0, 2.0]}, dry=True, **words)
    assert not words["out"].exists(), "nothing is written"
    assert "2 rows, 0 of them there" in str(told) and "2 cores" in str(told)
    sweep(SPRING, {"k": [1.0, 2.0]}, **words)
    told = sweep(SPRING, {"k": [1.0, 2.0, 3.0, 4.0, 5.0]}, dry=True, **words)
    assert (told.rows, told.there, told.memory) == (5, 2, 8.0 * 5 * 2)
    assert told.hours(4) == pytest.approx(3 * told.row_seconds / 4 / 3600) and told.samples == 400
    failing = measure("N")(lambda run: 1 / (run.params["k"] < 3.0))
    kept = RUN | {"out": tmp_path / "failing", "measures": [failing]}
    sweep(SPRING, {"k": [1.0]}, **kept)
    assert sweep(SPRING, {"k": [1.0, 3.0]}, **kept)["error"].is_null().to_pylist() == [True, False]


@pytest.mark.parametrize(
    ("rows", "first", "most", "workers"),
    [
        (35, 0.1, 2, 1),  # 1.75 s of work: two processes save 0.9 s
        (45, 0.1, 2, 2),
        (130, 4.0, 2, 1),  # of which a scene took long
        (90, 0.1, 1, 1),
        (1, 0.1, 2, 1),
    ],
)
def test_processes_begin_where_they_save_more_than_their_start(rows, first, most, workers):
    fragile = types.SimpleNamespace(most=most, workers=1)
    Scheduler.widen(fragile, rows, 0.05, first)
    assert fragile.workers == workers
