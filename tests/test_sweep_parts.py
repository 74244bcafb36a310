"""Parts of sweeps on their own: jobs that die, what a worker is told, units of figures,
and what is refused.
"""

import dataclasses
import os
import pickle
import types

import numpy as np
import pyarrow as pa
import pytest
from refusals import refused, warned

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnknownName
from stimlib.analysis.physical_cues import Cues, cues
from stimlib.blocks import springpot
from stimlib.core.units import unit
from stimlib.motion.generators import minimum_jerk
from stimlib.sweep import engines, measure, rendering, sweep
from stimlib.sweep.engines import Here, Local, end_beside, run_beside
from stimlib.sweep.measures import CUE_UNITS, measures_of
from stimlib.sweep.plan import row_keys
from stimlib.sweep.rows import table_of
from stimlib.sweep.scheduler import DEATHS, Death, drive, widen
from stimlib.sweep.store import Store
from stimlib.sweep.study import planned
from stimlib.sweep.worker import NO_SCENE, Runner, as_bytes, begin, error_text, from_bytes

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


class Fragile(Here):
    """An engine that takes three jobs, does the last one first, and whose process dies
    of k = 7.
    """

    final = False

    def __init__(self, plan, motions):
        super().__init__(plan, motions)
        self.plan, self.died, self.flying = plan, [], 0

    def room(self):
        return 3 - self.flying

    def submit(self, what, data, look, seconds):
        self.flying += 1
        super().submit(what, data, look, seconds)

    def take(self):
        self.flying -= 1
        job, result = super().take()
        if 7.0 in (ks := job.rows["k"].to_pylist()):
            self.died.append(len(ks))
            return job, Death("it ended", ks.index(7.0), bytes(range(16)), self.final)
        return job, result


def driven(table, engine, row_seconds=1.0):
    """The rows that an engine gives, sorted, and how many were told as done."""
    kept, told = [], []
    drive(engine.plan, table, engine, kept.append, row_seconds, told.append)
    assert sum(told) == table.num_rows
    return pa.concat_tables(kept).sort_by("k")


def test_a_job_that_dies_runs_again_without_the_row_that_ended_it():
    table, plan, motions = prepared({"k": np.arange(1.0, 11.0)})
    engine = Fragile(plan, motions)
    made = driven(table, engine, 1e-9)
    assert made["k"].to_pylist() == table["k"].to_pylist()
    assert made["peak_force"].to_pylist() == [None if k == 7 else k / 2 for k in range(1, 11)]
    assert made["error"].drop_null().to_pylist() == [f"{DEATHS} times: it ended"]
    before, died, after = made["content"].to_pylist()[5:8]
    assert died == bytes(range(16)) != before == after
    assert engine.died[0] > 1 and engine.died[1:] == [1] * (DEATHS - 1)
    engine = Fragile(plan, motions)
    engine.final = True
    assert driven(table.slice(6, 1), engine)["error"].to_pylist() == ["it ended"], "past its limit"


def test_a_worker_notes_which_row_it_is_at_before_its_scene_is_made(monkeypatch):
    table, plan, motions = prepared({"k": [1.0, 2.0]})
    noted = []
    monkeypatch.setattr("stimlib.sweep.worker.pool.note", lambda *told: noted.append(told))
    made = Runner(plan, motions).run(table.to_pylist())
    contents = made["content"].to_pylist()
    # the second row has the scene of the first
    assert noted == [(0, NO_SCENE), (0, contents[0]), (1, contents[1])] and contents[0] != NO_SCENE


def test_a_worker_has_the_limits_of_the_sweep(monkeypatch):
    _, plan, motions = prepared({"k": [1.0]})
    monkeypatch.setattr(stimlib.limits, "table_knots", stimlib.limits.table_knots)  # to be put back
    monkeypatch.setattr("stimlib.sweep.worker._runner", None, raising=False)
    begin(
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

    class Timed(Here):
        def take(self):
            job, (data, _) = super().take()
            sizes.append(job.rows.num_rows)
            return job, (data, 0.15 * job.rows.num_rows)

    rows, plan, motions = prepared({"k": np.arange(1.0, 41.0)})
    drive(plan, rows, Timed(plan, motions), lambda made: None, 0.3, lambda done: None)
    assert sizes[:2] == [3, 4] and sum(sizes) == 40


def test_a_job_hands_back_what_it_has_done_in_its_time():
    rows, plan, motions = prepared({"k": np.arange(1.0, 6.0)})
    engine = Here(plan, motions)
    engine.submit("job", as_bytes(rows), False, 0.0)
    what, (data, _) = engine.take()
    assert (what, from_bytes(data)["peak_force"].to_pylist()) == ("job", [0.5])
    never = Here(plan, motions)
    never.plan, submit = plan, never.submit
    never.submit = lambda what, data, look, seconds: submit(what, data, look, 0.0)
    assert driven(rows, never, 1e-9)["peak_force"].to_pylist() == [0.5, 1.0, 1.5, 2.0, 2.5]


def test_a_part_is_written_as_soon_as_it_is_large(tmp_path, monkeypatch):
    monkeypatch.setattr("stimlib.sweep.store.LARGEST", 2)
    monkeypatch.setattr("stimlib.sweep.store.EVERY", 1e9)
    with Store(tmp_path, {"key": "k"}, {"units": {}, "motion": {}}) as store:
        for parts in (0, 1, 1):
            store.add(pa.table({"k": [float(store.rows)]}))
            assert len(list(tmp_path.glob("*.parquet"))) == parts


def test_what_is_no_death_of_a_process_is_raised(monkeypatch):
    _, plan, motions = prepared({"k": [1.0]})
    lost = types.SimpleNamespace(take=lambda: ("job", None, ModuleNotFoundError("own_study")))
    monkeypatch.setattr(engines, "Pool", lambda *words, memory: lost)
    refused(ModuleNotFoundError, "own_study", Local(plan, motions).take)
    monkeypatch.undo()

    class Stays:
        def __reduce__(self):
            raise RuntimeError("it stays here")

    held = Stays()
    kept = RUN | {"workers": 2, "measures": [measure("1")(lambda run: held)]}
    refused(BadValue, "cannot be sent .* process", sweep, SPRING, {"k": [1.0, 2.0]}, **kept)


def test_a_process_beside_a_worker_of_dask_takes_the_plan_that_comes(monkeypatch):
    def peaks(k=2.0, name="a", sweep="one", **words):
        given = {"motion": {name: words.pop("motion")}}
        table, plan, motions = prepared({"k": [k], "motion": [name]}, **words, **given)
        keys = [(n, digest) for n, (digest, _) in motions.items()]
        found = run_beside(
            sweep, plan, keys, [m for _, m in motions.values()], as_bytes(table), False, 1.0
        )
        data = None if isinstance(found, Death) else found[0]
        return data and from_bytes(data).to_pylist()[0]["peak_force"]

    ramp, higher = minimum_jerk(depth=1.0), minimum_jerk(depth=2.0)
    try:
        first = peaks(motion=ramp, seconds=0.05)
        (process,) = engines._beside.values()
        assert first < peaks(motion=higher, seconds=0.05, name="b"), "for the same process"
        assert first == peaks(motion=ramp, seconds=0.05, name="c"), "one motion by two names"
        assert (process,) == tuple(engines._beside.values())
        dies = measure("N", version="1")(lambda run: os.abort() if run.params["k"] == 7.0 else 0.0)
        for name, k, peak in (("a", 1.0, 1.0), ("b", 1.0, 2.0), ("a", 7.0, None), ("b", 1.0, 2.0)):
            motion = np.full(400, 1.0 if name == "a" else 2.0)
            assert peaks(k, name, "dies", motion=motion, measures=["peak", dies]) == peak
        end_beside("dies")
        assert first < peaks(motion=ramp, seconds=0.1, sweep="two")
        assert first == peaks(motion=ramp, seconds=0.05), "two sweeps in turns"
        assert process in engines._beside.values()
        monkeypatch.setattr(engines, "SWEEPS", 2)
        assert first == peaks(motion=ramp, seconds=0.05, sweep="three")
        left = [sweep for _, sweep in engines._beside]
        assert left == ["two", "three"], "nothing of the sweep that began first"
        end_beside("three")
        assert [sweep for _, sweep in engines._beside] == ["two"]
        table, plan, motions = prepared({"k": [3.0]}, fs=4000)
        other = dataclasses.replace(plan, versions=plan.versions | {"numpy": "1.0"})
        says = "other versions: numpy .* not 1.0"
        refused(BadValue, says, run_beside, "two", other, [], [], as_bytes(table), False, 1.0)
    finally:
        for sweep in ("one", "two", "three"):
            end_beside(sweep)
    assert not engines._beside


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
    table = sweep(SPRING, {"k": [1.0, 3.0]}, **kept)
    assert table["error"].is_null().to_pylist() == [True, False]


@pytest.mark.parametrize(
    ("start", "rows", "first", "wanted"),
    [
        (3.0, 100, 0.1, []),  # 5 s of work: two processes save 2.5 s
        (3.0, 130, 0.1, [2]),
        (3.0, 130, 4.0, []),  # of which a scene took long
        (0.0, 70, 0.1, []),  # nothing has begun
        (0.0, 90, 0.1, [2]),
        (0.1, 1, 0.1, []),
    ],
)
def test_processes_begin_where_they_save_more_than_their_start(start, rows, first, wanted):
    asked = []
    engine = types.SimpleNamespace(start_seconds=lambda: start, widen=asked.append)
    widen(engine, 2, rows, 0.05, first)
    assert asked == wanted
