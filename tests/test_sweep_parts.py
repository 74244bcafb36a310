"""Parts of sweeps on their own: jobs that die, what a worker is told, units of figures, and what is refused."""

import dataclasses
import threading
import types

import numpy as np
import pyarrow as pa
import pytest

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnknownName
from stimlib.analysis.cues import Cues, cues
from stimlib.blocks import springpot
from stimlib.core.units import unit
from stimlib.motion.generators import minimum_jerk, sinusoid
from stimlib.sweep import engines, measure, measured, rendering, sweep
from stimlib.sweep.drive import DEATHS, drive
from stimlib.sweep.engines import Here, Local, run_apart
from stimlib.sweep.measures import CUE_UNITS, measures_of
from stimlib.sweep.plan import row_keys
from stimlib.sweep.store import Store
from stimlib.sweep.study import planned
from stimlib.sweep.work import Runner, as_bytes, from_bytes, run_part

SPRING = Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")})
STEADY = {"motion": np.full(400, 0.5), "fs": 8000, "seconds": None, "live": None}
RUN = {"motion": np.full(400, 0.5), "fs": 8000, "measures": "peak", "progress": False}


def prepared(rows, **words):
    """Rows with keys, plan and motions."""
    table, plan, motions, *_ = planned(SPRING, rows, **{"measures": ["peak"], **STEADY, **words})
    return table.append_column("key", row_keys(plan, table, {n: d for n, (d, _) in motions.items()})), plan, motions


class Fragile(Here):
    """An engine that takes three jobs, does the last one first, and whose process dies of k = 7."""

    def __init__(self, runner):
        super().__init__(runner)
        self.died = []
        self.flying = 0

    def room(self):
        return 3 - self.flying

    def submit(self, what, data):
        self.flying += 1
        super().submit(what, data)

    def take(self):
        self.flying -= 1
        job, result, _ = super().take()
        if 7.0 in (ks := job.rows["k"].to_pylist()):
            self.died.append(len(ks))
            return job, None, "it ended"
        return job, result, ""


def test_a_job_that_dies_is_halved_down_to_the_row_that_ends_it():
    table, plan, motions = prepared({"k": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0]})
    engine, told = Fragile(Runner(plan, motions)), []
    with Store(None, {}, {}) as store:
        drive(plan, table, store, engine, 1e-9, told.append)
    made = pa.concat_tables(store.tables, promote_options="permissive").sort_by("k")
    assert made["k"].to_pylist() == table["k"].to_pylist() and sum(told) == 10
    assert made["peak_force"].to_pylist() == [None if k == 7 else k / 2 for k in range(1, 11)]
    assert [e for e in made["error"].to_pylist() if e] == [f"{DEATHS} times: it ended"]
    assert engine.died.count(1) == DEATHS and engine.died[0] > 1


def test_jobs_grow_where_rows_are_quicker_than_was_thought():
    """1 s each was thought, 0.5 s is seen: 3 s of work are 3 rows, then at 0.75 s 4 of them."""
    sizes = []

    class Timed(Here):
        def take(self):
            job, (data, _), text = super().take()
            sizes.append(job.rows.num_rows)
            return job, (data, 0.5 * job.rows.num_rows), text

    rows, plan, motions = prepared({"k": np.arange(1.0, 41.0)})
    with Store(None, {}, {}) as store:
        drive(plan, rows, store, Timed(Runner(plan, motions)), 1.0, lambda done: None)
    assert sizes[:2] == [3, 4] and sum(sizes) == 40


def test_a_part_is_written_as_soon_as_it_is_large(tmp_path, monkeypatch):
    monkeypatch.setattr("stimlib.sweep.store.LARGEST", 2)
    monkeypatch.setattr("stimlib.sweep.store.EVERY", 1e9)
    with Store(tmp_path, {"key": "k"}, {"units": {}, "motion": {}}) as store:
        for parts in (0, 1, 1):
            store.add(pa.table({"k": [float(store.rows)]}))
            assert len(list(tmp_path.glob("*.parquet"))) == parts


def test_a_job_in_a_process_of_its_own_gives_its_figures_in_the_order_of_its_rows(monkeypatch):
    table, plan, motions = prepared({"k": [7.0, 5.0, 1.0, 3.0]})
    monkeypatch.setattr(engines, "Local", lambda plan, motions, workers: Fragile(Runner(plan, motions)))
    figures = from_bytes(run_apart(plan, motions, as_bytes(table))[0])
    assert figures["peak_force"].to_pylist() == [None, 2.5, 0.5, 1.5]
    assert figures.column_names == ["peak_force", "fault", "error"]


def test_what_is_no_death_of_a_process_is_raised(monkeypatch):
    _, plan, motions = prepared({"k": [1.0]})
    lost = types.SimpleNamespace(take=lambda: ("job", None, ModuleNotFoundError("own_study")))
    monkeypatch.setattr(engines, "Pool", lambda *words: lost)
    with pytest.raises(ModuleNotFoundError, match="own_study"):
        Local(plan, motions, 1).take()
    lock = threading.Lock()
    with pytest.raises(BadValue, match="cannot be sent to another process"):
        sweep(SPRING, {"k": [1.0, 2.0]}, workers=2, **RUN | {"measures": [measure("1")(lambda run: lock.locked())]})


def test_a_worker_that_is_kept_takes_the_plan_that_comes():
    def peaks(measures=("peak",), **words):
        table, plan, motions = prepared({"k": [2.0]}, measures=measures, **words)
        return from_bytes(run_part(plan, motions, as_bytes(table))[0]).to_pylist()[0]

    ramp = minimum_jerk(depth=1.0)
    first = peaks(motion=ramp, seconds=0.05)["peak_force"]
    assert first < peaks(motion=ramp, seconds=0.1)["peak_force"] == peaks(["rms", "peak"], motion=ramp, seconds=0.1)["peak_force"]
    table, plan, motions = prepared({"k": [3.0]}, fs=4000)
    with pytest.raises(BadValue, match="this worker has other versions: numpy .*, and not 1.0"):
        run_part(dataclasses.replace(plan, key="", versions=plan.versions | {"numpy": "1.0"}), motions, as_bytes(table))


# Figures -------------------------------------------------------------------------------------------------------------
def test_cues_scale_as_their_units_say():
    t = np.arange(1000) / 1000
    x, f = 0.01 * (1 - np.cos(8 * np.pi * t)), 3.0 - 3.0 * np.cos(8 * np.pi * t - 0.3) + np.sin(16 * np.pi * t)
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
        with pytest.raises(BadValue, match="name a displacement and a force"):
            measures_of(text, scene)
    with pytest.raises(BadValue, match="is no measure"):
        measures_of("band(20, 1e999)", scene)


def test_what_is_not_the_rendering_is_not_verified():
    run = stimlib.render(SPRING, {"x": sinusoid(0.001, 4.0)}, 8000, 0.05)
    assert measured(run, "verify") == {"verified": 1.0}
    assert measured(dataclasses.replace(run, y=run.y + 1.0), "verify") == {"verified": 0.0}


# What is refused, or told --------------------------------------------------------------------------------------------
def test_a_run_is_as_long_as_its_shortest_motion_and_no_longer_than_allowed():
    scene = Scene({"y": Input("x") + Input("z")})
    words = RUN | {"motion": {"x": np.ones(300), "z": np.ones(200)}}
    assert sweep(scene, {"seed": [0]}, dry=True, **words).samples == 200
    with pytest.raises(stimlib.StimlibError, match="bytes of a row of 1e.09 s"):
        sweep(SPRING, {"k": [1.0]}, seconds=1e9, **RUN | {"motion": minimum_jerk()})


@pytest.mark.parametrize(
    ("rows", "words", "error", "says"),
    [
        (pa.table([[1.0], [2.0]], names=["k", "k"]), {}, BadValue, "the column k is there twice"),
        ({"motion": ["a"]}, {"motion": {"b": np.ones(400)}}, UnknownName, "there is no motion 'a'.*it has b"),
        ({"k": [1.0]}, {"measures": [measure(k="N")(lambda run: 1.0)]}, BadValue, "a column k, and so do the measures"),
    ],
)
def test_rows_that_cannot_be_meant_are_refused(rows, words, error, says):
    with pytest.raises(error, match=says):
        sweep(SPRING, rows, **RUN | words)


def test_there_is_no_row_before_the_first():
    for at in (-1, 2, 0.0):
        with pytest.raises(BadValue, match=f"there is no row {at}: give a number from 0 to 1"):
            rendering(SPRING, {"k": [1.0, 2.0]}, at, motion=RUN["motion"], fs=8000)


def test_hands_that_are_too_fast_and_runs_that_are_too_long_are_told():
    with pytest.warns(RuntimeWarning, match="faster than a hand"):
        sweep(SPRING, {"k": [1.0]}, **RUN | {"motion": minimum_jerk(depth=20.0), "seconds": 0.5})
    long = Scene({"f": springpot(Input("x", "m"), 1.0, 0.5, horizon=0.01)})
    with pytest.warns(RuntimeWarning, match="longer than horizon"):
        sweep(long, {"seed": [0]}, **RUN)


def test_a_forecast_counts_what_is_there_and_an_error_of_the_rest_is_theirs(tmp_path):
    words = RUN | {"out": tmp_path}
    sweep(SPRING, {"k": [1.0, 2.0]}, **words)
    told = sweep(SPRING, {"k": [1.0, 2.0, 3.0, 4.0, 5.0]}, dry=True, **words)
    assert (told.rows, told.there, told.memory) == (5, 2, 8.0 * 5 * 2)
    assert told.hours(4) == pytest.approx(3 * told.row_seconds / 4 / 3600)
    failing = measure("N")(lambda run: 1 / (run.params["k"] < 3.0))
    kept = RUN | {"out": tmp_path / "failing", "measures": [failing]}
    sweep(SPRING, {"k": [1.0]}, **kept)
    table = sweep(SPRING, {"k": [1.0, 3.0]}, **kept)
    assert [e is None for e in table["error"].to_pylist()] == [True, False]
