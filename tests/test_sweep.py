"""Sweeps: the bits of `render`, bad input told before the first run, what is done is
kept and nothing is done twice.
"""

import dataclasses
import hashlib
import importlib
import json
import re
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from math import pi

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import ran
from refusals import refused, warned
from swept import hangs, poisoned

import stimlib
from stimlib import (
    BadValue,
    Input,
    Param,
    Scene,
    SinkError,
    StimlibError,
    UnitError,
    UnknownName,
    constant,
)
from stimlib.analysis import cues
from stimlib.blocks import fir, pink_noise, white_noise
from stimlib.motion import minimum_jerk, recording, sinusoid
from stimlib.scenes import squeeze
from stimlib.sweep import grid, measure, measured, rendering, sweep
from stimlib.sweep.rows import table_of
from stimlib.sweep.scheduler import Scheduler, job_rows
from stimlib.sweep.study import _rows_to_try

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


def swept(rows, scene=SPRING, **words):
    """A sweep of the spring, as a rule: its peaks, in this process."""
    return sweep(scene, rows, **{"measures": "peak", **RUN, **words})


def unswept(error, says, rows, scene=SPRING, **words):
    """Such a sweep does not begin, and ``says`` is why."""
    refused(error, says, swept, rows, scene, **words)


def columns(table, *names):
    return [table[n].to_pylist() for n in names]


# Bits ---------------------------------------------------------------------------------
def test_rows_have_the_bits_of_render():
    hands = {"slow": HAND, "fast": minimum_jerk(depth=0.02, rise=0.1)}
    rows = grid(motion=hands, fingers=[2, 1], A=[0.0, 3.4], seed=[3, 2**64 - 1])
    words = {"motion": hands, "fs": 8000, "seconds": 0.1, "live": ["A"]}
    table = sweep(squeeze, rows, measures=["rms(force1)", "peak(force1)"], **words)
    assert table.column_names == "motion fingers A seed rms_force1 peak_force1 fault error".split()
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
    rows = {"level": [1.0, 2.0]}
    unswept(BadValue, "both a live parameter and an argument", rows, noise_of)
    (live,), (argument,) = (
        columns(swept(rows, noise_of, live=chosen, measures="rms"), "rms_y")
        for chosen in (["level"], [])
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


def test_no_row_ends_a_sweep_whatever_it_does_and_wherever_it_is(monkeypatch, tmp_path):
    monkeypatch.setattr("stimlib.sweep.scheduler.DEATHS", 1)
    monkeypatch.setattr(stimlib.limits, "row_bytes", 1.5e9)
    says = {
        "interrupt": "^KeyboardInterrupt: $",
        "exit": "^1 times: it ended its process with exit status 3$",
        "none": None,
        "large": "^MemoryError",
        "unspeakable": "^Unspeakable: its text cannot be made: RuntimeError$",
        "ok": None,
        "leave": "^SystemExit: 4$",
        "crash": "^1 times: it ended its process by signal 11",
        "generator": "^GeneratorExit: $",
    }
    words = {"workers": 2, "out": tmp_path}
    table = swept({"kind": list(says)}, poisoned, **words)
    for said, wanted in zip(table["error"].to_pylist(), says.values(), strict=True):
        assert said is wanted or re.search(wanted, said)
    parts = set(tmp_path.glob("part-*"))
    again = swept({"kind": [k for k in says if k != "leave"]}, poisoned, **words)
    assert again["error"].null_count == 2 and set(tmp_path.glob("part-*")) == parts, (
        "nothing runs again"
    )
    monkeypatch.setattr(stimlib.limits, "row_seconds", 0.5)
    table = swept({"k": [1.0]}, measures=hangs, workers=1)
    assert "longer than its 0.5 s" in table["error"][0].as_py()


@measure("1")
def interrupts(run):
    raise KeyboardInterrupt


@pytest.mark.parametrize(("made", "measures"), [("interrupt", "peak"), ("none", interrupts)])
def test_ctrl_c_ends_a_sweep_whose_rows_run_here(made, measures):
    rows = {"kind": ["none", made, "ok"], "seed": [0, 1, 2]}
    says = "[01] of 3 rows done, and are lost"
    unswept(KeyboardInterrupt, says, rows, poisoned, measures=measures)


# Rows ---------------------------------------------------------------------------------
def test_tables_of_all_kinds_are_one(tmp_path):
    wanted = {"k": [1.5, 2.0], "seed": [0, 1], "motion": ["a", "b"]}
    (tmp_path / "rows.csv").write_text("k,seed,motion\n1.5,0,a\n2,1,b\n")
    arrow = pa.table(wanted)
    pq.write_table(arrow, tmp_path / "rows.parquet")
    for name, encoding in (("excel.csv", "utf-8-sig"), ("unicode.csv", "utf-16")):
        text = "k;seed;motion\r\n1,5;0;a\r\n2,0;1;b\r\n".replace(
            ";", ";" if "8" in encoding else "\t"
        )
        (tmp_path / name).write_text(text, encoding)
    categories = arrow.set_column(2, "motion", arrow["motion"].dictionary_encode())

    class Stream:  # what polars, duckdb and others have
        __arrow_c_stream__ = arrow.__arrow_c_stream__

    for rows in (
        wanted,
        arrow,
        categories,
        *(tmp_path / name for name in ("rows.csv", "excel.csv", "unicode.csv")),
        str(tmp_path / "rows.parquet"),
        Stream(),
    ):
        assert table_of(rows).to_pydict() == wanted
    assert table_of({"k": np.float32([1, 2])}).schema.field("k").type == pa.float64()
    seeds = [0, 2**64 - 1]
    for given in (seeds, [0, np.uint64(2**64 - 1)]):
        for rows in ({"seed": given}, grid(seed=given)):
            assert table_of(rows)["seed"].to_pylist() == seeds


@pytest.mark.parametrize(
    ("rows", "error", "says"),
    [
        ({"k": [1.0, 2.0], "seed": [0]}, BadValue, "unequal lengths: k 2, seed 1"),
        ({"k": []}, BadValue, "needs rows"),
        ({"k": 3.0}, BadValue, "k = 3.0 must be a list"),
        ({"q": [1.0]}, UnknownName, "no column q in the scene; parameters: k; .*seed, motion"),
        ({"k": [1.0, None]}, BadValue, "k has no value in row 1"),
        ({"k": [1.0, float("nan")]}, BadValue, "k = nan in row 1"),
        ({"k": ["soft"]}, BadValue, "k is a parameter.* numbers"),
        ({"k": [True]}, BadValue, "k is a parameter.* got bool"),
        ({"k": [0.5, 2**63]}, BadValue, "k = 9223372036854775808 in row 1 .* 64 bits"),
        ({"k": [-1, 2**63]}, BadValue, "k = 9223372036854775808 in row 1"),
        ({"seed": [0, -1]}, BadValue, "seed = -1 in row 1"),
        ({"seed": [0.5]}, BadValue, "seed = 0.5 in row 0"),
        ({"seed": [0, 2**64]}, BadValue, "seed = 18446744073709551616 in row 1"),
        ({"k": [object()]}, BadValue, "rows cannot be read"),
        ({"k": [b"x"]}, BadValue, "k has values of type binary"),
        ({"error": [1.0]}, BadValue, "column error of its own"),
        ({"peak_force": [1.0]}, UnknownName, "no column peak_force"),
        ({"motion": ["a"]}, BadValue, "motion must be a dict of motions"),
        (pa.table([[1.0], [2.0]], names=["k", "k"]), BadValue, "k is there twice"),
        ("rows.txt", BadValue, "neither a .csv nor"),
        ("missing.csv", BadValue, "cannot be read"),
        (3, BadValue, "got int"),
    ],
)
def test_bad_rows_are_told_before_the_first_run(rows, error, says):
    COUNT.clear()
    unswept(error, says, rows, measures=[counted])
    assert not COUNT


@pytest.mark.parametrize(
    ("words", "error", "says"),
    [
        ({"measures": []}, BadValue, "needs measures"),
        ({"measures": "loudness"}, UnknownName, "'loudness'; there are rms, peak"),
        ({"measures": "rms(force9)"}, UnknownName, "'force9'; there are force"),
        ({"measures": "band(20)"}, BadValue, r"write band\(20, 1000\)"),
        ({"measures": "band(1000, 20)"}, BadValue, "lower edge first"),
        (
            {"measures": ["rms", "psd(11, 12)"]},
            BadValue,
            "no third octave has its centre from 11 to",
        ),
        ({"measures": "band(20, 1000"}, BadValue, "is no measure"),
        ({"measures": "__import__('os').remove('x')"}, BadValue, "is no measure"),
        ({"measures": ["rms", "rms(force)"]}, BadValue, "rms_force is there twice"),
        ({"measures": [len]}, BadValue, "measures = .* must be"),
        ({"measures": [measure("N")(lambda r: (1.0, 2.0))]}, BadValue, "2 numbers, and has 1"),
        ({"measures": [measure("N")(lambda r: 1 / 0)]}, BadValue, "ZeroDivisionError"),
        ({"measures": [measure(error="N")(lambda r: 1.0)]}, BadValue, "column error of its own"),
        ({"measures": [measure(k="N")(lambda r: 1.0)]}, BadValue, "column k.* the measures"),
        ({"seconds": None}, BadValue, "how many seconds"),
        ({"seconds": 1e9}, StimlibError, "bytes of a row of 1e.09 s"),
        ({"motion": {"y": HAND}}, UnknownName, "x is missing"),
        ({"motion": np.ones(3)}, BadValue, "at least 400 samples"),
        ({"motion": "hand", "seconds": None}, BadValue, "must be a function"),
        ({"motion": None}, UnknownName, "x is missing; the inputs are: x"),
        ({"live": ["A"]}, UnknownName, "live: there is no parameter of the scene 'A'"),
        ({"workers": -1}, BadValue, "workers = -1"),
        ({"fs": -1}, BadValue, "fs"),
        ({"executor": 7, "workers": 1}, BadValue, "executor = 7 must be"),
        ({"executor": ThreadPoolExecutor()}, BadValue, "workers = 0 how many jobs"),
    ],
)
def test_bad_words_are_told_before_the_first_run(words, error, says):
    unswept(error, says, {"k": [1.0, 2.0]}, **words)


def test_units_must_fit():
    field = pa.field("k", pa.float64(), metadata={"unit": "N"})
    unswept(UnitError, "k is in N, .* in N/m", pa.table([[1.0]], schema=pa.schema([field])))
    table = swept({"k": [1.0]})
    assert swept(table.select(["k"])).equals(table), "k says N/m there"
    refused(UnitError, None, measure, "loud")
    refused(BadValue, None, measure)


def test_grid_refuses_what_is_no_axis():
    for axes in (
        {},
        {"k": 3.0},
        {"k": "soft"},
        {"k": []},
        {"k": [1, "a"]},
        {"k": [[1, 2], [3, 4]]},
        {"k": [[1], [2, 3]]},
        {"k": [2**64]},
        {"k": np.array([2**64])},  # of objects
        {f"k{i}": range(1000) for i in range(6)},
    ):
        refused(BadValue, None, grid, **axes)
    assert len(grid(**{f"k{i}": [0] for i in range(70)})) == 70  # more than an array has dimensions
    assert grid(motion={"a": HAND, "b": HAND}, k=[1.0])["motion"].tolist() == ["a", "b"]


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
    table = swept({"k": [1.0, 2.0, 3.0, 4.0]}, measures=["peak", touchy])
    assert table["error"][0].as_py() == "BadValue: touchy: ZeroDivisionError: k = 1"
    for name, odd in (("error", [False, True] * 2), ("peak_force", [True, False] * 2)):
        assert table[name].is_null().to_pylist() == odd
    unswept(BadValue, "first row fails, .*k = 1", {"k": [1.0, 3.0]}, measures=[touchy])
    factory = swept({"k": [1.0, 2.0], "broken": [True, False]}, made)
    assert factory["error"].to_pylist() == ["BadValue: broken", None]
    unswept(BadValue, "no scene of the first row: .*broken", {"broken": [True]}, made)


def test_what_is_not_finite_is_marked():
    scene = Scene({"y": Input("x") / Param("d", 1.0)})
    table = swept({"d": [1.0, 0.0]}, scene, motion=np.ones(400))
    assert columns(table, "fault", "error", "peak_y") == [
        [None, "y at sample 0"],
        [None, None],
        [1.0, 0.0],
    ]


def test_scenes_with_other_outputs_are_told():
    one, two = swept({"fingers": [1, 2]}, squeeze)["error"].to_pylist()
    assert one is None and "this row gives" in two and "outputs that all rows have" in two


# Measures -----------------------------------------------------------------------------
def test_a_scene_without_inputs_needs_no_motion():
    scene, words = Scene({"y": Param("A", 1.0) * white_noise(seed=1)}), {"fs": 1000, "seconds": 0.1}
    (found,) = sweep(scene, {"A": [2.0]}, measures="peak", workers=0, **words)["peak_y"].to_pylist()
    assert found == np.abs(rendering(scene, {"A": [2.0]}, 0, **words)["y"]).max() > 0


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
    short = dataclasses.replace(run, y=run.y[:, :400])  # lines from 0 to 4 kHz, 20 Hz apart
    got = measured(short, ["psd(10, 10)", "band(5000, 9000)", "band(21, 39)", "band(20, 40)"])
    assert [bool(np.isnan(v)) for v in got.values()] == [True, True, True, False]
    for name in ("rms", "psd"):
        refused(BadValue, "no sample", measured, dataclasses.replace(run, y=run.y[:, :0]), name)


def test_cues_and_proofs_are_those_of_their_functions():
    motion, words = sinusoid(0.01, 4.0, mean=0.01), {"fs": 1000, "seconds": 1.0}
    table = swept({"k": [100.0, 300.0]}, motion=motion, measures=["cues", "verify"], **words)
    for row in table.to_pylist():
        run = stimlib.render(SPRING, {"x": motion}, params={"k": row["k"]}, **words)
        c = cues(motion(run.t), run["force"], 1000)
        assert all(row[f"{name}_force"] == value for name, value in c._asdict().items())
        assert abs(c.k_S / row["k"] - 1) < 1e-9 and row["verified"] == 1.0
    assert measured(dataclasses.replace(run, y=run.y + 1.0), "verify") == {"verified": 0.0}


def test_what_depends_on_the_motion_alone_is_made_once():
    made = []

    @measure("m", prepare=lambda x, fs: made.append(fs) or x["x"].max())
    def depth(rendering, ready):
        return ready

    table = swept({"k": np.arange(1.0, 9.0)}, measures=[depth])
    assert made == [8000.0]
    assert set(table["depth"].to_pylist()) == {HAND(np.arange(400) / 8000).max()}


# What is kept -------------------------------------------------------------------------
def test_only_what_is_missing_runs(tmp_path):
    words = {"measures": [counted], "out": tmp_path}

    def figures(rows, ran, **more):
        COUNT.clear()
        found = swept(rows, **words | more)["counted"].to_pylist()
        assert set(COUNT) == ran and len(COUNT) == len(ran), "equal rows are one"
        return found

    one, two, _ = figures({"k": [1.0, 2.0, 2.0]}, {1.0, 2.0})
    assert figures({"k": [1.0, 2.0, 2.0]}, set()) == [one, two, two]
    more = figures({"k": [2.0, 5.0, 1.0], "seed": [0, 0, 0]}, {5.0})
    assert (more[0], more[2]) == (two, one), "of another order, with the usual seed"
    figures({"k": [5.0]}, {5.0}, seconds=0.1)
    figures({"k": [5.0]}, {5.0}, motion=minimum_jerk(depth=0.01))
    figures({"k": [5.0], "motion": ["a"]}, set(), motion={"a": HAND})  # a name says nothing
    told = json.loads((tmp_path / "_sweep.json").read_text())
    assert told["units"] == {"counted": "N"} and told["scene"] == SPRING.hash
    assert told["versions"]["numpy"] == np.__version__
    part = pq.read_table(next(tmp_path.glob("part-*.parquet")))
    assert [part.field(n).metadata[b"unit"] for n in ("counted", "k")] == [b"N", b"N/m"]
    unswept(BadValue, "other measures: name another folder", {"k": [1.0]}, out=tmp_path)
    unswept(BadValue, "other fs", {"k": [1.0]}, **words | {"fs": 4000})


def test_damaged_parts_run_again_and_failed_rows_when_asked(tmp_path, monkeypatch):
    def done(**more):
        return swept({"k": [1.0, 2.0, 3.0, 4.0]}, measures=[touchy], out=tmp_path, **more)

    def is_damaged():
        assert warned(RuntimeWarning, "damaged", done).equals(whole)

    whole = done()
    part = next(tmp_path.glob("*.parquet"))  # a slow machine makes several
    data = bytearray(part.read_bytes())
    data[60] ^= 4  # one bit
    part.write_bytes(data)
    (tmp_path / "part-killed.parquet.part").write_bytes(b"PAR1")
    is_damaged()
    suffixes = [p.suffix for p in tmp_path.iterdir()]
    assert {*suffixes} == {".damaged", ".json", ".parquet"} and suffixes.count(".damaged") == 1
    pq.write_table(pa.table({"a": [1]}), tmp_path / "other")
    for other in ((tmp_path / "other").read_bytes(), b"PAR1"):  # by its name it is whole
        (tmp_path / f"part-{hashlib.sha256(other).hexdigest()[:32]}.parquet").write_bytes(other)
        is_damaged()
    monkeypatch.setitem(globals(), "BAD", deque([1.0]))
    assert done().equals(whole), "failed rows are done"
    for retry in (True, False):
        assert done(retry=retry)["error"].is_null().to_pylist() == [False, True, True, True]


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
    hands = {"a": lambda t: FACTOR["a"] * t, "b": lambda t: FACTOR["b"] * t}
    scenes = grid(p=[0.0, 1.0], q=[0.0, 1.0]), weighed, {"out": tmp_path / "scenes"}
    motions = {"motion": ["a", "b"]}, SPRING, {"out": tmp_path / "motions", "motion": hands}
    for (rows, scene, words), name, row in (
        (scenes, "b", "row 1 .* another scene"),
        (scenes, "a", "row 2 .* another scene"),
        (motions, "b", "row 1 .* scene or motion"),
    ):
        swept(rows, scene, **words)
        with monkeypatch.context() as changed:
            changed.setitem(FACTOR, name, 2.0)
            unswept(BadValue, row, rows, scene, **words)


def test_a_row_that_failed_runs_again_where_its_function_was_corrected(tmp_path, monkeypatch):
    def errors(p, **words):
        return swept({"p": p}, weighed, **words)["error"].to_pylist()

    monkeypatch.setitem(globals(), "BROKEN", [1.0])
    assert errors([1.0, 2.0, 3.0], out=tmp_path) == ["BadValue: broken 1.0", None, None]
    monkeypatch.setitem(FACTOR, "a", 2.0)
    again = errors([1.0, 5.0], out=tmp_path, retry=True)
    assert again == ["BadValue: broken 2.0", None], "the last error counts"
    monkeypatch.setitem(FACTOR, "a", 1.0)
    monkeypatch.setitem(globals(), "BROKEN", [])
    assert errors([1.0, 2.0, 3.0], out=tmp_path) == [None] * 3
    for good in (0, 1, 2, 4):  # those that are tried first
        monkeypatch.setitem(globals(), "BROKEN", [float(p) for p in range(5) if p != good])
        found = errors([0.0, 1.0, 2.0, 3.0, 4.0])
        assert [e is None for e in found] == [k == good for k in range(5)], "where one has none"


def test_rows_are_tried_from_the_ends_to_the_middle():
    assert _rows_to_try(1000) == [0, 999, 500, 250, 750, 125, 375, 625, 875]
    assert _rows_to_try(1) == [0]


def test_a_folder_of_others_is_left_alone(tmp_path):
    row, kept = {"k": [1.0]}, tmp_path / "a" / "_sweep.json"
    (tmp_path / "thesis.tex").write_text("")
    unswept(SinkError, "thesis.tex and no _sweep.json", row, out=tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]
    unswept(SinkError, "cannot make", row, out=tmp_path / "thesis.tex" / "x")
    swept(row, out=tmp_path / "a")
    whole = json.loads(kept.read_text())
    for text, says in (
        ("{", "damaged"),
        ("[" * 100_000, "damaged"),
        (json.dumps(whole | {"motion": None}), "damaged"),
        (json.dumps(whole | {"stimlib_sweep": 3}), "of version 3, .* reads 2"),
    ):
        kept.write_text(text)
        unswept(SinkError, says, row, out=tmp_path / "a")


def test_two_sweeps_do_not_write_into_one_folder(tmp_path):
    @measure("1")
    def nested(r):
        unswept(SinkError, "another sweep is writing", {"k": [2.0]}, out=tmp_path)
        return 1.0

    assert swept({"k": [1.0]}, measures=[nested], out=tmp_path)["nested"][0].as_py() == 1.0


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
    study, row = importlib.import_module("of_a_study"), {"a": [1.0]}
    words = RUN | {"measures": "peak", "workers": 1, "motion": np.ones(400)}
    study.K = 2.0
    assert swept(row, study.make, motion=np.ones(400))["peak_y"].to_pylist() == [2.0]
    says = "scene is not the same in the processes"
    warned(RuntimeWarning, says, sweep, study.make, row, **words)
    says, words["motion"] = "motion is not the same", study.hand
    warned(RuntimeWarning, says, sweep, lambda a: SPRING, row, **words)
    study.K = 1.0

    def edited(*words):
        (tmp_path / "of_a_study.py").write_text(OF_A_STUDY.replace("1.0", "5.0"))
        return Scheduler(*words)

    monkeypatch.setattr("stimlib.sweep.study.Scheduler", edited)
    unswept(BadValue, "has changed since .* again", row, study.make, workers=1)


def test_recorded_hands_have_their_own_lengths():
    t = np.arange(0, 0.5, 0.01)
    hands = {
        n: recording({"t_s": t[:m], "x_mm": 3 * t[:m]}, {"x": "x_mm*1e-3"})
        for n, m in (("a", 20), ("b", 40))
    }

    @measure("s")
    def long(r):
        return r.t[-1]

    assert sweep(
        SPRING, grid(motion=hands, k=[1.0, 2.0]), motion=hands, measures=[long], fs=1000, workers=0
    )["long"].to_pylist() == [0.189, 0.189, 0.389, 0.389]

    def touched(unit):
        return Scene({"y": Input("x", unit) / constant(1.0, unit), "on": Input("contact")})

    lifted = {"t_s": t, "x": np.where(abs(t - 0.2) < 0.055, np.nan, 1 + t)}
    lifted = recording(lifted, {"x": "x"}, missing="gap", max_gap=0.02, max_speed=None)
    words = {"motion": lifted, "measures": "rms(y)", "fs": 1000, "workers": 0}
    rms = [
        sweep(touched, {"unit": u}, **words)["rms_y"].to_pylist()
        for u in (["N"], ["m"], ["N", "m"])
    ]
    assert rms[0] < rms[1] and rms[2] == rms[0] + rms[1], "a force is 0 where a place is held"


# From a terminal ----------------------------------------------------------------------
OWN_STUDY = """
import stimlib
from stimlib.sweep import measure
@measure("N")
def lowest(run):
    return run["force"].min()
def made(gain, k=3.0):
    return stimlib.Scene({"force": gain * stimlib.Param("k", k, "N/m") * stimlib.Input("x", "m")})
def both(k=2.0):
    return made(k, k)
def needs(k):
    return made(k, k)
"""


def test_the_command_sweeps_a_grid_and_a_table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fixed = "--motion minimum_jerk(depth=0.02) --seconds 0.05 --workers 0"
    axes = "--axis k=500:1500:3 --axis seed=0..1 --measure peak --out out --json"
    told = json.loads(ran(f"sweep squeeze(fingers=1) {axes} {fixed}").stdout)
    rows = grid(k=[500.0, 1000.0, 1500.0], seed=[0, 1])
    wanted = max(swept(rows, squeeze(fingers=1))["peak_force1"].to_pylist())
    assert (told["rows"], told["failed"]) == (6, 0)
    assert told["figures"]["peak_force1"]["largest"] == wanted
    (tmp_path / "own_study.py").write_text(OWN_STUDY)
    (tmp_path / "rows.csv").write_text("gain,k\n1,2\n2,2\n")
    words = f"sweep own_study.py:made --rows rows.csv --measure own_study.py:lowest {fixed}"
    ran(words, 2, "a live parameter and an argument")
    for more, says in (
        ("", "2 rows over gain (2), k (1), 0 failed"),
        ("--dry", "2 rows, 0 of them there"),
    ):
        assert says in ran(f"{words} --live k {more}").stdout
    for name, ratio in (("both", 3.0), ("needs", 9.0)):  # set in one scene, or of one for each
        words = f"sweep own_study.py:{name} --measure peak --json {fixed} --axis"
        one, other = (json.loads(ran(f"{words} k={k}").stdout)["figures"] for k in ("1,3", "3,1"))
        peak = one["peak_force"]
        assert one == other and peak["largest"] == pytest.approx(ratio * peak["least"])


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
