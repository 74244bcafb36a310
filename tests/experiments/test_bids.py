"""Sessions as BIDS and Psych-DS datasets: their files, and what a validator says."""

import csv
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from experiments.some import TASK, experiment, observer, simulate, some
from hypothesis import given, settings, strategies as st
from laws import STRESS
from refusals import refused
from typer.testing import CliRunner

from stimlib import BadValue, RecordingError, SinkError
from stimlib.cli import app
from stimlib.experiments import (
    ConstantStimuli,
    Sequential,
    bids,
    columns,
    sessions,
)
from stimlib.experiments.bids import label, to_bids, to_psych_ds
from stimlib.motion.recorded import recording
from stimlib.motion.table import read_table
from stimlib.system import safe_files

VALIDATOR = shutil.which("bids-validator-deno")
MADE = experiment(
    design=Sequential(
        {
            "learn": ConstantStimuli(((TASK, 4.0), (TASK, 1.0)), training=True),
            "test": ConstantStimuli(((TASK, 4.0), (TASK, 1.5), (TASK, 1.0))),
        }
    ),
    motion={"x": lambda t: 0.5 + t},
)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A short session whose trials have logs, three of them training."""
    folder = tmp_path_factory.mktemp("data")
    simulate(folder, MADE, show="file")
    return folder


def test_every_trial_is_a_row(signals):
    dataset, saved = signals
    place = dataset / "sub-P01" / "ses-1" / "beh" / "sub-P01_ses-1_task-pair_beh.tsv"
    head, *rows = (line.split("\t") for line in place.read_text().splitlines())
    table, column = (
        columns([saved], training=True),
        dict(zip(head, zip(*rows, strict=True), strict=True)),
    )
    for name, kind in (("number", int), ("level", float), ("softer", str)):
        assert [kind(v) for v in column[name]] == table[name]
    assert set(column["chance"]) == {"n/a"} and columns([saved])["number"] == [3, 4, 5]
    assert column["training"] == ("true",) * 2 + ("false",) * 3
    told = json.loads(place.with_suffix(".json").read_text())
    assert set(head) <= set(told) and told["softer"]["Description"].startswith("Which one")
    assert (dataset / "participants.tsv").read_text() == "participant_id\tcode\nsub-P01\tP01\n"
    described = json.loads((dataset / "dataset_description.json").read_text())
    assert (described["Name"], described["Authors"]) == ("pair", ["A", "B"])


@pytest.fixture(scope="module")
def signals(data):
    """This session as a dataset, and its records."""
    (saved,) = sessions("pair", data)
    to_bids(MADE, [saved], data / "bids", ["A", "B"])
    return data / "bids", saved


def test_a_trial_with_a_log_is_a_run(signals):
    """Stimulus and motion in their units, and onsets, from sample 0 of the trial."""
    place = signals[0] / "sub-P01" / "ses-1"
    for r in signals[1].records:
        beh = place / "beh" / f"sub-P01_ses-1_task-pair_run-{r.number}"
        motion = place / "motion" / f"sub-P01_ses-1_task-pair_tracksys-input_run-{r.number}"
        x, y = np.loadtxt(f"{motion}_motion.tsv"), np.loadtxt(f"{beh}_stim.tsv.gz")
        events = Path(f"{beh}_events.tsv").read_text(encoding="utf-8")
        head, *rows = (line.split("\t") for line in events.splitlines())
        assert head == ["onset", "duration", "trial_type", "scene"]
        for (onset, duration, *kind), stimulus in zip(rows, r.trial.stimuli, strict=True):
            a, b = (round(1000 * t) for t in (float(onset), float(onset) + float(duration)))
            assert b - a == 100 and kind == ["silent", "spring"]
            assert np.abs(x[a:b] - 0.5 - np.arange(a, b) / 1000).max() < 1e-9
            force = np.float32(stimulus.params.get("k", 2.0) * x[a:b] / 10)  # of full scale
            assert np.abs(y[a:b] - 10 * force.astype(float)).max() < 1e-8, (
                "every digit of what was displayed"
            )
        assert events == Path(f"{motion}_events.tsv").read_text(encoding="utf-8")
    told = json.loads(Path(f"{beh}_events.json").read_text(encoding="utf-8"))
    assert told["onset"]["Description"].endswith("not in real time")
    told = json.loads(Path(f"{beh}_stim.json").read_text(encoding="utf-8"))
    assert told == {
        "TaskName": "pair",
        "StartTime": 0.0,
        "SamplingFrequency": 1000.0,
        "Columns": ["force"],
        "force": {"Units": "N"},
    }
    told = json.loads(Path(f"{motion}_motion.json").read_text(encoding="utf-8"))
    assert (told["SamplingFrequency"], told["MotionChannelCount"]) == (1000.0, 1)
    channels = Path(f"{motion}_channels.tsv").read_text(encoding="utf-8").splitlines()
    assert channels[1].split("\t") == ["x", "x", "POS", "hand", "m"]
    names = ("x", "vx", "hand_z", "velocity", "index", "x1", "y_max")
    assert list(filter(bids.AXIS.fullmatch, names)) == ["x", "vx", "hand_z"]


def test_signals_are_read_back_as_recordings(signals, tmp_path):
    """Equal samples, at the times of their rate, by the JSON file or the channels."""
    folder, saved = Path(signals[0]), signals[1]
    paths = [*folder.rglob("*_stim.tsv.gz"), *folder.rglob("*_motion.tsv")]
    assert len(paths) == 2 * len(saved.records)
    for path in paths:
        wanted = np.loadtxt(path, ndmin=2)[:, 0]
        table = read_table(path)
        (t, x), name = (
            np.concatenate([b.numbers(table.names) for b in table.batches()], 1)[:2],
            table.names[1],
        )
        assert np.array_equal(x, wanted) and np.array_equal(t, np.arange(len(x)) / 1000)
        r = recording(path, {"x": name}, max_speed=None)
        assert r.motion["x"](t) == pytest.approx(wanted, abs=1e-12) and "from sub-P01" in str(r)
    shutil.copy(path, tmp_path / "a_motion.tsv")
    for text in ("{", "{}", '{"SamplingFrequency": 10, "Columns": 3}'):
        (tmp_path / "a_motion.json").write_text(text)
        refused(
            RecordingError,
            "a_motion.json: does not describe",
            read_table,
            tmp_path / "a_motion.tsv",
        )
    facts = {"SamplingFrequency": 4, "StartTime": -0.5, "Columns": ["x"]}
    (tmp_path / "a_motion.json").write_text(json.dumps(facts))
    batch = next(iter(read_table(tmp_path / "a_motion.tsv").batches()))
    assert batch.texts("t_s")[:2] == ["-0.5", "-0.25"] and float(batch.texts("x")[0]) == wanted[0]
    (tmp_path / "a_motion.tsv").write_text("1\n\n2\n")  # a blank line takes no time
    table = read_table(tmp_path / "a_motion.tsv")
    assert [b.texts("t_s") for b in table.batches()] == [["-0.5", "-0.25"]]
    assert "1 blank lines skipped, the first in row 2" in table.notes()


def test_a_damaged_log_and_a_full_disk_are_told(data, tmp_path, monkeypatch):
    """Nothing is exported of a log that was changed, and no half of a dataset stays;
    what was lost is 0.
    """
    shutil.copytree(data / "pair", tmp_path / "pair")
    (saved,) = sessions("pair", tmp_path)
    publish, real = safe_files.publish, bids.delivered

    def full(path, data):
        if "run-3" in path.name:
            raise SinkError("the disk is full")
        publish(path, data)

    def lossy(log):
        for at, frames, _ in real(log):
            yield at, frames[:180], True
            yield at + 180, frames[180:], False

    monkeypatch.setattr(safe_files, "publish", full)
    refused(SinkError, "the disk is full", to_bids, MADE, [saved], tmp_path / "bids")
    assert not (tmp_path / "bids").exists()
    monkeypatch.undo()
    monkeypatch.setattr(bids, "delivered", lossy)
    to_bids(MADE, [saved], tmp_path / "bids")
    y = np.loadtxt(next(tmp_path.rglob("*run-2_stim.tsv.gz")))
    assert len(y) > 200 and np.abs(y[:180]).max() > 0 and (y[180:] == 0).all()
    motion = saved.folder / saved.records[0].displayed[-1]["log"] / "motion.f64"
    motion.write_bytes(motion.read_bytes()[:-8] + bytes(8))
    refused(SinkError, "trial-0001.*put back", to_bids, MADE, [saved], tmp_path / "other")
    assert len(to_bids(MADE, [saved], tmp_path / "other", signals=False)) == 6


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks")
@pytest.mark.filterwarnings("ignore:os.fork")  # of JAX, where another test has loaded it
def test_a_killed_export_is_no_dataset_and_two_do_not_meet(data, tmp_path):
    found, out = sessions("pair", data), tmp_path / "out"
    whole = to_bids(MADE, found, tmp_path / "whole", signals=False)
    held = safe_files.lock(safe_files.make_folder(out), "")  # as another export does
    refused(SinkError, "another run exports", to_bids, MADE, found, out)
    os.close(held)
    assert list(out.iterdir()) == []
    if (pid := os.fork()) == 0:
        names = iter(whole[1:])

        def die(event, _):
            if event == "os.rename" and next(names, None) is None:
                os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(die)
        try:
            to_bids(MADE, found, out, signals=False)
        finally:
            os._exit(1)
    assert os.waitpid(pid, 0)[1] == signal.SIGKILL
    names = {f.name for f in out.rglob("*") if f.is_file()}
    assert {f.name for f in whole} - names == {"dataset_description.json"}
    refused(BadValue, "has files", to_bids, MADE, found, out)


@pytest.mark.skipif(not VALIDATOR, reason="pip install bids-validator-deno (120 MB)")
def test_the_validator_of_bids_finds_no_error(signals):
    done = subprocess.run([VALIDATOR, str(signals[0])], capture_output=True, text=True)
    assert done.returncode == 0 and "[ERROR]" not in done.stdout, done.stdout


def test_psych_ds_has_a_table_for_each_session(data, tmp_path):
    """Its description names each column, as the scheme asks for."""
    files = to_psych_ds(MADE, sessions("pair", data), tmp_path / "out", ["A"])
    assert [p.relative_to(tmp_path / "out").as_posix() for p in files] == [
        "dataset_description.json",
        "data/study-pair_subject-P01_session-1_data.csv",
    ]
    told = json.loads(files[0].read_text())
    head, *rows = csv.reader(files[1].read_text().splitlines())
    table = columns(sessions("pair", data), training=True)
    assert head == list(table) and [float(r[head.index("level")]) for r in rows] == table["level"]
    assert [v["name"] for v in told["variableMeasured"]] == head
    assert told["@type"] == "Dataset" and told["author"] == [{"@type": "Person", "name": "A"}]


def test_the_command_writes_them_and_what_is_no_dataset_is_refused(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text("from experiments.test_bids import MADE as pair\n", encoding="utf-8")
    words = ["experiment", "export", "own.py:pair", "--data", str(data)]
    for more, code, said in (
        (["--bids", "out"], 0, r"\d\d files in out\n"),
        (["--psych-ds", "other"], 0, "2 files in other\n"),
        ([], 2, "--bids FOLDER, --psych-ds FOLDER, or both"),
        (["--bids", "out"], 2, "out has files"),
    ):
        done = CliRunner().invoke(app, words + more)
        assert done.exit_code == code and re.search(said, done.output), done.output
    found = sessions("pair", data)
    for call, why in (
        (lambda: to_bids(MADE, [], tmp_path / "a"), "no answers yet"),
        (lambda: to_bids(experiment(name="other"), found, tmp_path / "a"), "pair, and not of"),
        (lambda: label("--"), "no letter"),
    ):
        refused(BadValue, why, call)
    assert not (tmp_path / "a").exists()


# Each trial is a row, or nothing is written -------------------------------------------
@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    """Sessions of 3 and 5 trials: of a simulated observer, and of a participant."""
    found = []
    for by in (observer, None):
        folder = tmp_path_factory.mktemp("kind")
        some(folder, 3 if by else 5, by=by)
        found += sessions("pair", folder)
    assert [s.simulated for s in found] == [True, False]
    return found


def bids_rows(found, folder):
    """Return the rows of a BIDS dataset where capitals do not count in names."""
    kept = {str(p).casefold(): p for p in to_bids(experiment(), found, folder, signals=False)}
    tables = [p for p in kept.values() if p.name.endswith("_beh.tsv")]
    whose, listed = {p.parts[-4] for p in tables}, (folder / "participants.tsv").read_text()
    codes = dict(line.split("\t") for line in listed.splitlines()[1:])
    assert len({w.casefold() for w in whose}) == len(whose) and codes.keys() == whose
    assert sorted(codes.values()) == sorted({s.header["participant"] for s in found})
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert ("All answers are simulated." in text) == found[0].simulated
    return [
        dict(zip(head.split("\t"), row.split("\t"), strict=True))
        for head, *rows in (p.read_text(encoding="utf-8").splitlines() for p in tables)
        for row in rows
    ]


def psych_rows(found, folder):
    kept = {str(p).casefold(): p for p in to_psych_ds(experiment(), found, folder)}
    text = (folder / "dataset_description.json").read_text(encoding="utf-8")
    assert ("All answers are simulated." in text) == found[0].simulated
    return [
        row
        for p in kept.values()
        if p.suffix == ".csv"
        for row in csv.DictReader(io.StringIO(p.read_bytes().decode(), newline=""), strict=True)
    ]


def table_rows(found, folder):
    table = columns(found, training=True)
    return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]


ANY = st.tuples(
    st.sampled_from(["P1", "p1", "P01", "P-1", "Q1"]),
    st.integers(1, 2),
    st.sampled_from(["a", "b"]),
    st.integers(0, 1),
    st.text("x\r\n\t\"',\x0b\u2028", max_size=5),
)


@pytest.mark.parametrize("export", [bids_rows, psych_rows, table_rows])
@settings(max_examples=200 if STRESS else 12)
@given(drawn=st.lists(ANY, min_size=1, max_size=4))
def test_each_trial_is_a_row_of_every_export_or_it_is_refused(export, kinds, drawn):
    found = []
    for who, number, place, kind, words in drawn:
        one = kinds[kind]
        records = [
            replace(
                r,
                trial=replace(r.trial, questions=("softer", "words")),
                answer=replace(r.answer, values={**r.answer.values, "words": words}),
            )
            for r in one.records
        ]
        header = one.header | {"participant": who, "session": number}
        found.append(replace(one, folder=Path(place), header=header, records=records))
    names = {(who, number) for who, number, *_ in drawn}
    good = len(names) == len(drawn) and len({kind for *_, kind, _ in drawn}) == 1
    # not every file system tells p1 from P1
    good = good and (export is table_rows or not {"P1", "p1"} <= {who for who, _ in names})
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "out"
        if not good:
            refused(BadValue, None, export, found, folder)
            assert not folder.exists()
            return
        rows = export(found, folder)
    assert len(rows) == sum(len(s.records) for s in found)
    assert {str(row["simulated"]).lower() for row in rows} == {str(found[0].simulated).lower()}
