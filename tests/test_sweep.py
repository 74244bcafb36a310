"""Sweeps: the bits of `render`, bad input told before the first run, what is done is
kept and nothing is done twice.
"""

import copy
import dataclasses
import functools
import hashlib
import importlib
import json
import sys
import warnings
from collections import deque
from math import pi

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from refusals import refused, warned
from swept import deadly, poisoned
from typer.testing import CliRunner

import stimlib
from stimlib import BadValue, Input, Param, Scene, SinkError, UnitError, UnknownName, constant
from stimlib.analysis.physical_cues import cues
from stimlib.blocks import fir, pink_noise, white_noise
from stimlib.cli import app
from stimlib.motion.generators import minimum_jerk, sinusoid
from stimlib.motion.recorded import recording
from stimlib.scenes import squeeze
from stimlib.sweep import grid, measure, measured, rendering, sweep
from stimlib.sweep.engines import Local
from stimlib.sweep.identity import identity
from stimlib.sweep.rows import table_of
from stimlib.sweep.scheduler import job_rows

HAND = minimum_jerk(depth=0.02)
RUN = {"motion": HAND, "fs": 8000, "seconds": 0.05, "progress": False, "workers": 0}
SPRING = Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")})
COUNT: deque[float] = deque()
BAD = deque([1.0, 3.0])


@measure("N", version="1")  # COUNT changes with each row
def counted(r):
    COUNT.append(r.params.get("k", 0.0))
    return r["force"][-1]


@measure("N", version="1")
def touchy(r):
    if r.params["k"] in BAD:
        raise ZeroDivisionError(f"k = {r.params['k']:g}")
    return r["force"][-1]


def noise_of(level=1.0):
    """Before sample 0 the filter ran with the level that the scene was built with."""
    return Scene(
        {"y": fir(Param("level", level) * white_noise(seed=1), [0.25] * 64) * (Input("x") + 1.0)}
    )


def made(k=100.0, broken=False):
    if broken:
        raise BadValue("broken")
    return Scene({"force": constant(k, "N/m") * Input("x", "m")})


def unswept(error, says, out, **words):
    """No sweep of the spring goes to this folder, and ``says`` is why."""
    words = {"measures": "rms", **RUN, **words}
    refused(error, says, sweep, SPRING, {"k": [1.0]}, out=out, **words)


def columns(table, *names):
    return [table[n].to_pylist() for n in names]


# Bits ---------------------------------------------------------------------------------
def test_rows_have_the_bits_of_render():
    hands = {"slow": HAND, "fast": minimum_jerk(depth=0.02, rise=0.1)}
    rows = grid(motion=hands, fingers=[2, 1], A=[0.0, 3.4], seed=[3, 2**64 - 1])
    words = {"motion": hands, "fs": 8000, "seconds": 0.1, "live": ["A"]}
    table = sweep(squeeze, rows, measures=["rms(force1)", "peak(force1)"], **words)
    assert table.column_names == [
        "motion",
        "fingers",
        "A",
        "seed",
        "rms_force1",
        "peak_force1",
        "fault",
        "error",
    ]
    for at, row in enumerate(table.to_pylist()):
        motion = {
            f"x{i + 1}": HAND if row["motion"] == "slow" else hands["fast"]
            for i in range(row["fingers"])
        }
        params, scene = {"A": row["A"]}, squeeze(fingers=row["fingers"])
        y = stimlib.render(scene, motion, 8000, 0.1, params, seed=row["seed"])["force1"]
        assert (row["rms_force1"], row["peak_force1"]) == (np.sqrt(np.mean(y**2)), np.abs(y).max())
        if at % 5 == 0:
            alone = rendering(squeeze, rows, at, **words)
            assert np.array_equal(alone["force1"], y) and measured(alone, "peak(force1)") == {
                "peak_force1": row["peak_force1"]
            }


def test_a_live_parameter_is_set_and_an_argument_makes_a_scene():
    rows, words = {"level": [1.0, 2.0]}, RUN | {"measures": "rms"}
    refused(
        BadValue,
        r"level: both a live parameter and an argument of noise_of: say live=\['level'\]",
        sweep,
        noise_of,
        rows,
        **words,
    )
    (live,), (argument,) = (
        columns(sweep(noise_of, rows, live=chosen, **words), "rms_y") for chosen in (["level"], [])
    )
    one = stimlib.render(noise_of(), {"x": HAND}, 8000, 0.05, {"level": 2.0})
    two = stimlib.render(noise_of(2.0), {"x": HAND}, 8000, 0.05)
    assert live[1] == measured(one, "rms")["rms_y"] != argument[1] == measured(two, "rms")["rms_y"]
    assert live[0] == argument[0]


def test_processes_jobs_and_order_change_no_bit(monkeypatch):
    @measure("N")  # of no module that a worker could import
    def mean(r):
        return scale * r["force1"].mean()

    scale, rows = 2.0, grid(A=[0.0, 1.0, 3.4], seed=range(12))
    words = RUN | {"measures": ["rms", "band(20, 1000)", mean]}
    one = sweep(squeeze(fingers=1), rows, **words)
    shuffled = {n: c[::-1].copy() for n, c in rows.items()}
    monkeypatch.setattr("stimlib.sweep.scheduler.MOST_ROWS", 5)
    two = sweep(squeeze(fingers=1), shuffled, **words | {"workers": 2})
    assert one.equals(two.take(pa.array(range(35, -1, -1))).combine_chunks())
    assert len(set(one["rms_force1"].to_pylist())) == 25, "without vibration all seeds are equal"


def test_a_row_that_ends_its_process_is_an_error_of_that_row(monkeypatch):
    monkeypatch.setattr("stimlib.sweep.scheduler.DEATHS", 2)
    rows = {"k": [4.0, 7.0, 6.0, 5.0]}
    table = sweep(SPRING, rows, measures=["rms", deadly], **RUN | {"workers": 2})
    assert [r["k"] for r in table.to_pylist() if r["deadly"] is None] == [7.0]
    assert table["error"][1].as_py() == "2 times: it ended its process with exit status 3"


def test_no_row_ends_a_sweep_whatever_it_does_and_wherever_it_is(monkeypatch, tmp_path):
    monkeypatch.setattr("stimlib.sweep.scheduler.DEATHS", 1)
    monkeypatch.setattr(stimlib.limits, "row_seconds", 4.0)
    # first, middle, last too
    harm = ["exit", "leave", "none", "large", "unspeakable", "hang", "interrupt", "ok", "crash"]
    words = RUN | {"measures": "peak", "workers": 2, "out": tmp_path}
    table = sweep(poisoned, {"kind": harm}, **words)
    says = dict(zip(harm, table["error"].to_pylist(), strict=True))
    assert says["none"] is says["ok"] is None
    assert says["exit"] == "1 times: it ended its process with exit status 3"
    assert says["crash"].startswith("1 times: it ended its process by signal 11")
    assert says["leave"] == "SystemExit: 4" and says["interrupt"] == "KeyboardInterrupt: "
    assert says["unspeakable"] == "Unspeakable: its text cannot be made: RuntimeError"
    assert says["hang"].startswith("it took longer than its 4 s") and says["large"].startswith(
        "MemoryError"
    )
    parts = set(tmp_path.glob("part-*"))
    again = sweep(poisoned, {"kind": [k for k in harm if k != "hang"]}, **words)
    assert len(again["error"].drop_null()) == 6 and set(tmp_path.glob("part-*")) == parts, (
        "nothing runs again"
    )


@pytest.mark.parametrize("kind", ["interrupt", "generator"])
def test_what_the_first_row_raises_is_its_error_whatever_it_is(kind):
    table = sweep(poisoned, {"kind": [kind, "none"]}, **RUN | {"measures": "peak", "workers": 1})
    name = {"interrupt": "KeyboardInterrupt", "generator": "GeneratorExit"}[kind]
    assert table["error"].to_pylist() == [f"{name}: ", None]


@pytest.mark.parametrize("there", ["make", "measure"])
def test_ctrl_c_ends_a_sweep_whose_rows_run_here(there):
    def made(k=0.0):
        if there == "make" and k == 1.0:
            raise KeyboardInterrupt
        return Scene({"y": 1.0 * Input("x")})

    @measure("1")
    def last(run):
        if there == "measure":
            raise KeyboardInterrupt
        return run["y"][-1]

    refused(
        KeyboardInterrupt,
        "[01] of 3 rows were done, and are lost",
        sweep,
        made,
        {"k": [0.0, 1.0, 2.0]},
        **RUN | {"measures": last, "workers": 0},
    )


def test_a_row_that_takes_memory_is_an_error_of_that_row(monkeypatch):
    @measure("1")
    def taken(run):
        return float(np.ones(int(run.params["n"])).sum())

    monkeypatch.setattr(stimlib.limits, "row_bytes", 1.5e9)
    scene = Scene({"y": Param("n", 1.0) * Input("x")})
    table = sweep(scene, {"n": [1e3, 1e9, 2e3]}, measures=[taken], **RUN | {"workers": 1})
    assert (
        table["taken"].to_pylist() == [1e3, None, 2e3]
        and "MemoryError" in table["error"][1].as_py()
    )


# Rows ---------------------------------------------------------------------------------
def test_tables_of_all_kinds_are_one(tmp_path):
    wanted = {"k": [1.5, 2.0], "seed": [0, 1], "motion": ["a", "b"]}
    (tmp_path / "rows.csv").write_text("k,seed,motion\n1.5,0,a\n2,1,b\n")
    arrow = pa.table(wanted)
    pq.write_table(arrow, tmp_path / "rows.parquet")
    categories = arrow.set_column(2, "motion", arrow["motion"].dictionary_encode())

    class Stream:  # what polars, duckdb and others have
        __arrow_c_stream__ = arrow.__arrow_c_stream__

    for rows in (
        wanted,
        arrow,
        categories,
        tmp_path / "rows.csv",
        str(tmp_path / "rows.parquet"),
        Stream(),
    ):
        assert table_of(rows).to_pydict() == wanted
    assert table_of({"k": np.float32([1, 2])}).schema.field("k").type == pa.float64()


@pytest.mark.parametrize(
    ("rows", "error", "says"),
    [
        ({"k": [1.0, 2.0], "seed": [0]}, BadValue, "unequal lengths: k 2, seed 1"),
        ({"k": []}, BadValue, "needs rows"),
        ({"k": 3.0}, BadValue, "k = 3.0 must be a list"),
        (
            {"q": [1.0]},
            UnknownName,
            "there is no q in the scene; parameters: k; besides: seed, motion",
        ),
        ({"k": [1.0, None]}, BadValue, "k has no value in row 1"),
        ({"k": [1.0, float("nan")]}, BadValue, "k = nan in row 1"),
        ({"k": ["soft"]}, BadValue, "k is a parameter, so it needs numbers"),
        ({"k": [True]}, BadValue, "k is a parameter, so it needs numbers; got bool"),
        (
            {"k": [0.5, 2**63]},
            BadValue,
            "k = 9223372036854775808 in row 1 has no place in 64 bits beside the others",
        ),
        ({"seed": [0, -1]}, BadValue, "seed = -1 in row 1"),
        ({"seed": [0.5]}, BadValue, "seed = 0.5 in row 0"),
        ({"k": [object()]}, BadValue, "rows cannot be read"),
        ({"k": [b"x"]}, BadValue, "k has values of type binary"),
        (
            {"seed": [0, 2**64]},
            BadValue,
            "seed = 18446744073709551616 in row 1 has no place in 64 bits",
        ),
        ({"k": [-1, 2**63]}, BadValue, "k = 9223372036854775808 in row 1 has no place"),
        ({"error": [1.0]}, BadValue, "a column error of its own"),
        ({"peak_force": [1.0]}, UnknownName, "no peak_force"),
        ({"motion": ["a"]}, BadValue, "motion must be a dict of motions by name"),
        ("rows.txt", BadValue, "neither a .csv nor"),
        ("missing.csv", BadValue, "cannot be read"),
        (3, BadValue, "got int"),
    ],
)
def test_bad_rows_are_told_before_the_first_run(rows, error, says):
    COUNT.clear()
    refused(error, says, sweep, SPRING, rows, measures=[counted], **RUN)
    assert not COUNT


@pytest.mark.parametrize(
    ("words", "error", "says"),
    [
        ({"measures": []}, BadValue, "needs measures"),
        ({"measures": "loudness"}, UnknownName, "no 'loudness'; there are rms, peak"),
        ({"measures": "rms(force9)"}, UnknownName, "no output 'force9'; it has force"),
        ({"measures": "band(20)"}, BadValue, r"write band\(20, 1000\)"),
        ({"measures": "band(1000, 20)"}, BadValue, "lower edge first"),
        ({"measures": "band(20, 1000"}, BadValue, "is no measure"),
        ({"measures": "__import__('os').remove('x')"}, BadValue, "is no measure"),
        ({"measures": ["rms", "rms(force)"]}, BadValue, "rms_force is there twice"),
        ({"measures": [len]}, BadValue, "sweep: measures = .* must be"),
        (
            {"measures": [measure("N")(lambda r: (1.0, 2.0))]},
            BadValue,
            "gives 2 numbers, and has 1",
        ),
        ({"measures": [measure("N")(lambda r: 1 / 0)]}, BadValue, "ZeroDivisionError"),
        ({"seconds": None}, BadValue, "how many seconds"),
        ({"motion": {"y": HAND}}, UnknownName, "x is missing"),
        ({"measures": [measure(error="N")(lambda r: 1.0)]}, BadValue, "a column error of its own"),
        ({"motion": np.ones(3)}, BadValue, "at least 400 samples"),
        ({"motion": "hand", "seconds": None}, BadValue, "motion of x must be a function"),
        ({"motion": None, "seconds": None}, UnknownName, "motion: x is missing"),
        ({"live": ["A"]}, UnknownName, "A is no parameter"),
        ({"workers": -1}, BadValue, "workers = -1"),
        ({"fs": -1}, BadValue, "fs"),
        ({"on": 7}, BadValue, "on = 7"),
    ],
)
def test_bad_words_are_told_before_the_first_run(words, error, says):
    refused(error, says, sweep, SPRING, {"k": [1.0, 2.0]}, **{"measures": "rms", **RUN, **words})


def test_units_must_fit():
    field = pa.field("k", pa.float64(), metadata={"unit": "N"})
    refused(
        UnitError,
        "k is in N, and the parameter in N/m",
        sweep,
        SPRING,
        pa.table([[1.0]], schema=pa.schema([field])),
        measures="rms",
        **RUN,
    )
    table = sweep(SPRING, {"k": [1.0]}, measures="rms", **RUN)
    assert sweep(SPRING, table.select(["k"]), measures="rms", **RUN).equals(table), (
        "k says N/m there"
    )
    refused(UnitError, None, measure, "loud")
    refused(BadValue, None, measure)


def test_grid_refuses_what_is_no_axis():
    large = {f"k{i}": range(1000) for i in range(6)}
    ragged = {"k": [[1], [2, 3]]}
    for axes in (
        {},
        {"k": 3.0},
        {"k": "soft"},
        {"k": []},
        {"k": [1, "a"]},
        {"k": [[1, 2], [3, 4]]},
        ragged,
        {"k": [2**64]},
        large,
    ):
        refused(BadValue, None, grid, **axes)
    assert len(grid(**{f"k{i}": [0] for i in range(70)})) == 70  # more than an array has dimensions
    assert grid(motion={"a": HAND, "b": HAND}, k=[1.0])["motion"].tolist() == ["a", "b"]


def test_seeds_have_64_bits_in_every_kind_of_row():
    seeds = [0, 2**64 - 1]
    for rows in (
        {"seed": seeds},
        {"seed": [0, np.uint64(2**64 - 1)]},
        grid(seed=seeds),
        grid(seed=[0, np.uint64(2**64 - 1)]),
    ):
        assert table_of(rows)["seed"].to_pylist() == seeds


# Failures -----------------------------------------------------------------------------
@measure("N")
def spoils(r):
    r["force"][:] = 7.0
    return 0.0


def spoiled(inputs, fs):
    inputs["x"] *= 2.0


@measure("N", prepare=spoiled)
def doubles(r, ready):
    return 0.0


def test_a_measure_cannot_change_what_others_see():
    for bad in (spoils, doubles):
        refused(BadValue, "read-only", sweep, SPRING, {"k": [1.0]}, measures=[bad, "peak"], **RUN)
    run = rendering(SPRING, {"k": [1.0]}, 0, motion=np.ones(10), fs=8000)
    refused(BadValue, "read-only", measured, run, [spoils, "peak"])
    assert run["force"].flags.writeable, "what is one's own stays so"


@pytest.mark.parametrize(
    ("given", "figure"),
    [(np.array(2.0), 2.0), (np.float32(2), 2.0), ([2], 2.0), (1j, None), ("2", None)],
)
def test_a_figure_is_a_real_number(given, figure):
    @measure("1")
    def odd(r):
        return given

    run = rendering(SPRING, {"k": [1.0]}, 0, motion=np.ones(10), fs=8000)
    if figure is None:
        refused(BadValue, "odd: TypeError: .* no real numbers", measured, run, odd)
    else:
        assert measured(run, odd) == {"odd": figure}


def test_a_row_that_fails_is_a_row_and_what_all_have_wrong_is_an_error():
    table = sweep(SPRING, {"k": [1.0, 2.0, 3.0, 4.0]}, measures=["peak", touchy], **RUN)
    assert table["error"].to_pylist()[0] == "BadValue: touchy: ZeroDivisionError: k = 1"
    assert (
        [v is None for v in table["peak_force"].to_pylist()]
        == [True, False, True, False]
        == [e is not None for e in table["error"].to_pylist()]
    )
    refused(
        BadValue,
        "the first row fails, and so do others: .*k = 1",
        sweep,
        SPRING,
        {"k": [1.0, 3.0]},
        measures=[touchy],
        **RUN,
    )
    factory = sweep(made, {"k": [1.0, 2.0], "broken": [True, False]}, measures="peak", **RUN)
    assert factory["error"].to_pylist() == ["BadValue: broken", None]
    refused(
        BadValue,
        "makes no scene of the first row: BadValue: broken",
        sweep,
        made,
        {"broken": [True]},
        measures="peak",
        **RUN,
    )


def test_what_is_not_finite_is_marked():
    scene = Scene({"y": Input("x") / Param("d", 1.0)})
    table = sweep(scene, {"d": [1.0, 0.0]}, measures="peak", **RUN | {"motion": np.ones(400)})
    assert columns(table, "fault", "error", "peak_y") == [
        [None, "y at sample 0"],
        [None, None],
        [1.0, 0.0],
    ]


def test_scenes_with_other_outputs_are_told():
    table = sweep(squeeze, {"fingers": [1, 2]}, measures="peak", **RUN)
    assert (
        table["error"][0].as_py() is None
        and "name outputs that all rows have" in table["error"][1].as_py()
    )


# Measures -----------------------------------------------------------------------------
def test_a_scene_without_inputs_needs_no_motion_and_another_says_which_it_needs():
    scene, words = Scene({"y": Param("A", 1.0) * white_noise(seed=1)}), {"fs": 1000, "seconds": 0.1}
    table = sweep(scene, {"A": [1.0, 2.0]}, measures="peak", workers=0, **words)
    for at, found in enumerate(table["peak_y"].to_pylist()):
        assert found == np.abs(rendering(scene, {"A": [1.0, 2.0]}, at, **words)["y"]).max() > 0
    refused(
        UnknownName,
        "motion: x is missing; the inputs are: x",
        sweep,
        SPRING,
        {"k": [1.0]},
        measures="peak",
        workers=0,
        **words,
    )


def test_a_band_without_a_line_of_the_spectrum_has_no_level():
    # lines from 0 to 500 Hz, 10 Hz apart
    run = stimlib.render(Scene({"y": white_noise(seed=1)}), {}, fs=1000, seconds=0.1)
    got = measured(run, ["band(600, 900)", "band(21, 29)", "band(20, 30)"])
    assert (
        np.isnan(got["band_600_900_y"])
        and np.isnan(got["band_21_29_y"])
        and got["band_20_30_y"] > 0
    )


def test_spectra_are_those_of_scipy():
    from scipy.signal import periodogram

    run = stimlib.render(Scene({"y": pink_noise(1 / pi, seed=1) + 0.3}), {}, 8000, 2.0)
    f, p = periodogram(run["y"], 8000, "hann")
    got = measured(run, ["rms", "band(20, 1000)", "psd(12, 900)"])
    inside = (f >= 20) & (f < 1000)
    assert abs(got["band_20_1000_y"] / np.sqrt(p[inside].sum() * f[1]) - 1) < 1e-12
    names = [n for n in got if n.startswith("psd_")]
    assert names == [
        f"psd_{c}_y"
        for c in "12.5 16 20 25 31.5 40 50 63 80 100 125 160 200 250 315 400 500 630 800".split()
    ]
    for k, name in enumerate(names, start=11):
        inside = (f >= 10 ** ((k - 0.5) / 10)) & (f < 10 ** ((k + 0.5) / 10))
        assert abs(got[name] / p[inside].mean() - 1) < 1e-12
    for n in (400, 401):  # with 0 Hz, and half the sample rate where n is even
        edge = dataclasses.replace(run, y=run.y[:, :n])
        f, p = periodogram(edge["y"], 8000, "hann")
        assert (
            abs(measured(edge, "band(0, 9999)")["band_0_9999_y"] / np.sqrt(p.sum() * f[1]) - 1)
            < 1e-12
        )
    short = stimlib.render(Scene({"y": constant(1.0) * 1}), {}, 8000, 0.05)
    assert np.isnan(measured(short, "psd(10, 10)")["psd_10_y"]), "no line in it"


def test_cues_and_proofs_are_those_of_their_functions():
    motion, words = sinusoid(0.01, 4.0, mean=0.01), {"fs": 1000, "seconds": 1.0}
    table = sweep(
        SPRING,
        {"k": [100.0, 300.0]},
        motion=motion,
        measures=["cues", "verify"],
        workers=0,
        **words,
    )
    for row in table.to_pylist():
        run = stimlib.render(SPRING, {"x": motion}, params={"k": row["k"]}, **words)
        c = cues(motion(run.t), run["force"], 1000)
        assert all(row[f"{name}_force"] == value for name, value in c._asdict().items())
        assert abs(c.k_S / row["k"] - 1) < 1e-9 and row["verified"] == 1.0


def test_what_depends_on_the_motion_alone_is_made_once():
    made = []

    @measure("m", prepare=lambda x, fs: made.append(fs) or x["x"].max())
    def depth(rendering, ready):
        return ready

    table = sweep(SPRING, {"k": np.arange(1.0, 9.0)}, measures=[depth], **RUN)
    assert made == [8000.0] and set(table["depth"].to_pylist()) == {
        HAND(np.arange(400) / 8000).max()
    }


# What is kept -------------------------------------------------------------------------
def test_only_what_is_missing_runs(tmp_path):
    out, words = tmp_path / "out", RUN | {"measures": [counted]}
    COUNT.clear()
    first = sweep(SPRING, {"k": [1.0, 2.0, 2.0]}, out=out, **words)
    assert first["counted"][1] == first["counted"][2] and len(COUNT) == 2, "equal rows are one"
    COUNT.clear()
    assert sweep(SPRING, {"k": [1.0, 2.0, 2.0]}, out=out, **words).equals(first) and not COUNT
    more = sweep(SPRING, {"k": [2.0, 5.0, 1.0], "seed": [0, 0, 0]}, out=out, **words)
    assert set(COUNT) == {5.0} and more["counted"][0] == first["counted"][1], (
        "of another order, with the usual seed"
    )
    COUNT.clear()
    sweep(SPRING, {"k": [5.0]}, out=out, **words | {"seconds": 0.1})
    sweep(SPRING, {"k": [5.0]}, out=out, **words | {"motion": minimum_jerk(depth=0.01)})
    sweep(SPRING, {"k": [5.0], "motion": ["a"]}, out=out, **words | {"motion": {"a": HAND}})
    assert len(COUNT) == 2, "two of the three are new: the name of a motion says nothing"
    told = json.loads((out / "_sweep.json").read_text())
    assert (
        told["units"] == {"counted": "N"}
        and told["scene"] == SPRING.hash
        and told["versions"]["numpy"] == np.__version__
    )
    part = pq.read_table(next(out.glob("part-*.parquet")))
    assert (
        part.field("counted").metadata[b"unit"] == b"N"
        and part.field("k").metadata[b"unit"] == b"N/m"
    )
    unswept(BadValue, "another sweep, with other measures: name another folder", out)
    unswept(BadValue, "other fs", out, **words | {"fs": 4000})


def test_damaged_parts_run_again_and_failed_rows_when_asked(tmp_path, monkeypatch):
    rows, words = {"k": [1.0, 2.0, 3.0, 4.0]}, RUN | {"measures": [touchy]}
    whole = sweep(SPRING, rows, out=tmp_path, **words)
    part = next(tmp_path.glob("*.parquet"))  # a slow machine makes several
    data = bytearray(part.read_bytes())
    data[60] ^= 4  # one bit
    part.write_bytes(data)
    (tmp_path / "part-killed.parquet.part").write_bytes(b"PAR1")
    with pytest.warns(RuntimeWarning, match="damaged"):
        assert sweep(SPRING, rows, out=tmp_path, **words).equals(whole)
    suffixes = [p.suffix for p in tmp_path.iterdir()]
    assert {*suffixes} == {".damaged", ".json", ".parquet"} and suffixes.count(".damaged") == 1
    pq.write_table(pa.table({"a": [1]}), tmp_path / "other")
    for other in ((tmp_path / "other").read_bytes(), b"PAR1"):  # by its name it is whole
        (tmp_path / f"part-{hashlib.sha256(other).hexdigest()[:32]}.parquet").write_bytes(other)
        with pytest.warns(RuntimeWarning, match="damaged"):
            assert sweep(SPRING, rows, out=tmp_path, **words).equals(whole)
    monkeypatch.setitem(globals(), "BAD", deque([1.0]))
    assert sweep(SPRING, rows, out=tmp_path, **words).equals(whole), "failed rows are done"
    for retry in (True, False):
        again = sweep(SPRING, rows, out=tmp_path, retry=retry, **words)
        assert [e is None for e in again["error"].to_pylist()] == [False, True, True, True]


FACTOR = {"a": 1.0, "b": 1.0}
BROKEN: list[float] = []


def weighed(p=1.0, q=1.0):
    if p in BROKEN:
        raise BadValue(f"broken {FACTOR['a']}")
    return Scene({"force": constant(p * FACTOR["a"] + q * FACTOR["b"], "N/m") * Input("x", "m")})


def test_each_kept_scene_and_motion_is_compared_with_today_s(tmp_path, monkeypatch):
    """A change of one of several combinations of arguments, or of one of several
    motions, is seen in its rows.
    """
    rows, words = grid(p=[0.0, 1.0], q=[0.0, 1.0]), RUN | {"measures": "rms"}
    sweep(weighed, rows, out=tmp_path / "a", **words)
    with (
        pytest.raises(BadValue, match="row 1 .* is kept with the figures of another scene"),
        monkeypatch.context() as m,
    ):
        m.setitem(FACTOR, "b", 2.0)
        sweep(weighed, rows, out=tmp_path / "a", **words)
    with (
        pytest.raises(BadValue, match="row 2 .* is kept with the figures of another scene"),
        monkeypatch.context() as m,
    ):
        m.setitem(FACTOR, "a", 2.0)
        sweep(weighed, rows, out=tmp_path / "a", **words)
    hands = {"a": lambda t: FACTOR["a"] * t, "b": lambda t: FACTOR["b"] * t}
    rows, words = {"motion": ["a", "b"]}, words | {"motion": hands}
    sweep(SPRING, rows, out=tmp_path / "b", **words)
    with (
        pytest.raises(BadValue, match="row 1 .* of another scene or motion"),
        monkeypatch.context() as m,
    ):
        m.setitem(FACTOR, "b", 2.0)
        sweep(SPRING, rows, out=tmp_path / "b", **words)


def test_a_row_that_failed_runs_again_where_its_function_was_corrected(tmp_path, monkeypatch):
    rows, words = {"p": [1.0, 2.0, 3.0]}, RUN | {"measures": "rms", "out": tmp_path}
    monkeypatch.setattr(sys.modules[__name__], "BROKEN", [1.0])
    assert [bool(e) for e in sweep(weighed, rows, **words)["error"].to_pylist()] == [
        True,
        False,
        False,
    ]
    monkeypatch.setitem(FACTOR, "a", 2.0)
    again = sweep(weighed, {"p": [1.0, 5.0]}, retry=True, **words)["error"].to_pylist()
    assert again == ["BadValue: broken 2.0", None], "the last error counts"
    monkeypatch.setitem(FACTOR, "a", 1.0)
    monkeypatch.setattr(sys.modules[__name__], "BROKEN", [])
    assert sweep(weighed, rows, **words)["error"].null_count == 3


def test_an_error_of_most_rows_is_theirs_where_the_middle_one_has_none(monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "BROKEN", [1.0, 2.0, 4.0, 5.0])
    table = sweep(weighed, {"p": [1.0, 2.0, 3.0, 4.0, 5.0]}, measures="rms", **RUN)
    assert [bool(e) for e in table["error"].to_pylist()] == [True, True, False, True, True]


def test_a_folder_of_others_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    unswept(SinkError, "has thesis.tex and no _sweep.json", tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]
    unswept(SinkError, "cannot make", tmp_path / "thesis.tex" / "x")
    sweep(SPRING, {"k": [1.0]}, measures="rms", out=tmp_path / "a", **RUN)
    whole = json.loads((tmp_path / "a" / "_sweep.json").read_text())
    for text in ("{", "[" * 100_000, json.dumps(whole | {"motion": None})):
        (tmp_path / "a" / "_sweep.json").write_text(text)
        unswept(SinkError, "damaged", tmp_path / "a")
    (tmp_path / "a" / "_sweep.json").write_text(json.dumps(whole | {"stimlib_sweep": 3}))
    unswept(SinkError, "is of version 3", tmp_path / "a")


def test_two_sweeps_do_not_write_into_one_folder(tmp_path):
    @measure("1")
    def nested(r):
        if r.params["k"] == 1.0:
            unswept(SinkError, "another sweep is writing", tmp_path)
        return 1.0

    assert sweep(SPRING, {"k": [1.0]}, measures=[nested], out=tmp_path, **RUN)[
        "nested"
    ].to_pylist() == [1.0]


def test_a_function_is_known_by_what_it_does(tmp_path):
    def defined(text):
        scope: dict = {}
        exec(text, scope)
        return identity(scope["f"], "f")

    base = (
        "import numpy as np\nC = 2.0\ndef helper(x):\n    return x * 3\ndef f(r):\n    return"
        " helper(C) + np.sum(r)\n"
    )
    same = defined("# moved\n\n" + base)
    assert same == defined(base)

    def closing(c):
        return lambda r: c * r.fs

    assert identity(closing(1.0), "f") != identity(closing(2.0), "f")
    for old, new in (("2.0", "2.5"), ("x * 3", "x * 4"), ("+ np", "- np")):
        assert defined(base.replace(old, new)) != same, new


class Line:
    """A motion that is an object, as splines are."""

    def __init__(self, height):
        self.height = height

    def __call__(self, t):
        return np.full_like(t, self.height)


def test_objects_that_are_called_are_known_by_their_content(tmp_path):
    hands = {"a": Line(1.0), "b": Line(2.0)}
    table = sweep(
        SPRING,
        grid(motion=hands, k=[1.0]),
        measures="peak",
        out=tmp_path,
        **RUN | {"motion": hands},
    )
    assert table["peak_force"].to_pylist() == [1.0, 2.0]
    again = sweep(
        SPRING, {"k": [1.0]}, measures="peak", out=tmp_path, **RUN | {"motion": Line(3.0)}
    )
    assert again["peak_force"].to_pylist() == [3.0]

    def using(value):
        return lambda r: value

    table, scene = np.zeros(5000), Scene({"y": Param("d", 1.0) * Input("x")})
    other = table.copy()
    other[2500] = 1.0
    for same, different in (
        (Line(1.0), Line(2.0)),
        (Line(1.0).__call__, Line(2.0).__call__),
        (functools.partial(pow, 2, mod=3), functools.partial(pow, 2, mod=5)),
        ({"profile": [table]}, {"profile": [other]}),
        (scene, SPRING),
        (scene.outputs["y"], SPRING.outputs["force"]),
    ):
        assert (
            identity(using(same), "f")
            == identity(using(copy.deepcopy(same)), "f")
            != identity(using(different), "f")
        )


def test_what_a_package_made_has_no_content():
    from scipy.stats import norm

    def using(r):
        return norm.cdf(r.fs)

    one, kept = identity(using, "f"), norm.random_state
    norm.random_state = 1  # of numpy's as a rule, which whoever draws changes
    assert identity(using, "f") == one
    norm.random_state = kept


def test_helpers_in_a_module_of_ones_own_count(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # its time has whole seconds
    found = []
    for k in (1, 2, 2):
        (tmp_path / "helper_of_a_sweep.py").write_text(f"def level(r):\n    return {k}\n")
        sys.modules.pop("helper_of_a_sweep", None)
        helper = importlib.import_module("helper_of_a_sweep")
        found.append(identity(lambda r, helper=helper: np.sum(helper.level(r)), "f"))
    assert found[0] != found[1] == found[2]


OF_A_STUDY = """
from stimlib import Input, Scene
K = 1.0
def make(a): return Scene({"y": K * a * Input("x")})
def hand(t): return K + 0.0 * t
"""


def test_what_workers_import_otherwise_is_said_or_refused(tmp_path, monkeypatch):
    (tmp_path / "of_a_study.py").write_text(OF_A_STUDY)
    monkeypatch.syspath_prepend(tmp_path)
    # the time of a cached file has whole seconds
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    study = importlib.import_module("of_a_study")
    words = RUN | {"measures": "peak", "workers": 1, "seconds": 0.1, "motion": np.ones(800)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sweep(study.make, {"a": [1.0]}, **words)["peak_y"].to_pylist() == [1.0]
        study.K = 2.0
        assert sweep(study.make, {"a": [1.0]}, **words | {"workers": 0})["peak_y"].to_pylist() == [
            2.0
        ]
    warned(
        RuntimeWarning,
        "scene is not the same in the processes that run the rows",
        sweep,
        study.make,
        {"a": [1.0]},
        **words,
    )
    warned(
        RuntimeWarning,
        "motion is not the same",
        sweep,
        lambda a: SPRING,
        {"a": [1.0]},
        **words | {"motion": study.hand},
    )
    study.K = 1.0

    def edited(*words):
        (tmp_path / "of_a_study.py").write_text(OF_A_STUDY.replace("1.0", "5.0"))
        return Local(*words)

    monkeypatch.setattr("stimlib.sweep.study.Local", edited)
    refused(
        BadValue,
        "scene: a file of yours has changed since the sweep began; start it again",
        sweep,
        study.make,
        {"a": [1.0]},
        **words,
    )


def test_recorded_hands_have_their_own_lengths():
    t = np.arange(0, 0.5, 0.01)
    hands = {
        n: recording({"t_s": t[:m], "x_mm": 3 * t[:m]}, {"x": "x_mm*1e-3"})
        for n, m in (("a", 20), ("b", 40))
    }

    @measure("s")
    def long(r):
        return r.t[-1]

    table = sweep(
        SPRING, grid(motion=hands, k=[1.0, 2.0]), motion=hands, measures=[long], fs=1000, workers=0
    )
    assert table["long"].to_pylist() == [0.189, 0.189, 0.389, 0.389]


def test_a_dry_run_tells_what_it_will_take(tmp_path):
    rows = grid(k=np.arange(1.0, 101.0))
    told = sweep(SPRING, rows, measures="rms", dry=True, out=tmp_path / "out", **RUN)
    assert (told.rows, told.there, told.samples) == (100, 0, 400) and 0 < told.hours(2) < 1e-3
    (tmp_path / "empty").mkdir()
    sweep(SPRING, rows, measures="rms", dry=True, out=tmp_path / "empty", **RUN)
    assert not list((tmp_path / "empty").iterdir()), "nothing is written"
    assert (
        "100 rows, 0 of them there" in str(told)
        and "2 cores" in str(told)
        and not (tmp_path / "out").exists()
    )


# From a terminal ----------------------------------------------------------------------
def run(*words):
    return CliRunner().invoke(
        app,
        [
            "sweep",
            *words,
            "--motion",
            "minimum_jerk(depth=0.02)",
            "--seconds",
            "0.05",
            "--workers",
            "1",
        ],
    )


def test_the_command_sweeps_a_grid_and_a_table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(
        "squeeze(fingers=1)",
        "--axis",
        "k=500:1500:3",
        "--axis",
        "seed=0..1",
        "--measure",
        "peak",
        "--out",
        "out",
        "--json",
    )
    assert done.exit_code == 0, done.output
    wanted = sweep(
        squeeze(fingers=1), grid(k=[500.0, 1000.0, 1500.0], seed=[0, 1]), measures="peak", **RUN
    )["peak_force1"]
    told = json.loads(done.stdout)
    assert (told["rows"], told["failed"], told["figures"]["peak_force1"]["largest"]) == (
        6,
        0,
        max(wanted.to_pylist()),
    )
    (tmp_path / "own_study.py").write_text(
        "import stimlib\nfrom stimlib.sweep import measure\n@measure('N')\ndef lowest(run):\n   "
        " return run['force'].min()\ndef made(gain, k=3.0):\n    return stimlib.Scene({'force':"
        " gain * stimlib.Param('k', k, 'N/m') * stimlib.Input('x', 'm')})\n"
    )
    (tmp_path / "rows.csv").write_text("gain,k\n1,2\n2,2\n")
    words = ["own_study.py:made", "--rows", "rows.csv", "--measure", "own_study.py:lowest"]
    done = run(*words)
    assert done.exit_code == 2 and "k: both a live parameter and an argument of made" in done.stderr
    done = run(*words, "--live", "k")
    assert done.exit_code == 0 and "2 rows, 0 failed" in done.stdout and "lowest" in done.stdout, (
        done.output
    )
    done = run(*words, "--live", "k", "--dry")
    assert done.exit_code == 0 and "2 rows, 0 of them there" in done.stdout


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "name the rows"),
        (("--axis", "k"), "write NAME=FROM:TO:HOW_MANY"),
        (("--axis", "k=1:2:0.5"), "0.5, is how many values: 1 or more"),
        (("--axis", "k=10:100"), "write FROM:TO:HOW_MANY, such as k=10:100:5"),
        (("--axis", "q=1,2"), "there is no q in the scene"),
        (("--axis", "k=1,soft"), "k = '1' must be a number"),
        (("--axis", "k=1,2", "--measure", "loud"), "no 'loud'"),
    ],
)
def test_mistakes_on_the_command_line_are_one_line(words, says):
    done = run("squeeze", *words)
    assert done.exit_code == 2 and done.stderr.startswith("error: ") and says in done.stderr, (
        done.output
    )


@pytest.mark.parametrize(
    ("left", "workers", "row_seconds", "rows"),
    [
        (10**6, 2, 0.001, 1000),  # one second
        (40, 2, 0.1, 10),  # towards the end: a quarter of the rest for each of two workers
        (40, 2, 0.001, 30),  # but not shorter than what two jobs cost the client
        # a thousand workers: fifteen seconds, or they wait for the client
        (10**6, 1000, 0.01, 1500),
        (5, 1000, 0.01, 5),
        (10**6, 1000, 1e-5, 20_000),
        (3, 2, 60.0, 1),
    ],
)
def test_jobs_are_long_enough_for_the_client_and_short_at_the_end(left, workers, row_seconds, rows):
    assert job_rows(left, workers, row_seconds) == rows
