"""Sessions as BIDS and Psych-DS datasets: their files, and what a validator says."""

import csv
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from experiments.some import experiment, observer, simulate, some
from hypothesis import given, settings, strategies as st
from typer.testing import CliRunner

from stimlib import BadValue, SinkError
from stimlib.cli.app import app
from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    Rate,
    Sequential,
    Session,
    Simulated,
    Stimulus,
    bids,
    choice,
    columns,
    run,
    sessions,
)
from stimlib.experiments.bids import label, to_bids, to_psych_ds
from stimlib.system import safe_files

VALIDATOR = shutil.which("bids-validator-deno")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    simulate(folder)
    return folder


@pytest.fixture
def dataset(data, tmp_path):
    to_bids(experiment(), sessions("pair", data), tmp_path / "bids", ["A", "B"])
    return tmp_path / "bids"


def test_every_trial_is_a_row(data, dataset):
    place = dataset / "sub-P01" / "ses-1" / "beh" / "sub-P01_ses-1_task-pair_beh.tsv"
    head, *rows = (line.split("\t") for line in place.read_text().splitlines())
    table = columns(sessions("pair", data), training=True)
    assert [int(row[head.index("number")]) for row in rows] == table["number"]
    assert [float(row[head.index("level")]) for row in rows] == table["level"]
    assert [row[head.index("softer")] for row in rows] == table["softer"]
    assert {row[head.index("chance")] for row in rows} == {"n/a"}
    told = json.loads(place.with_suffix(".json").read_text())
    assert set(head) <= set(told) and told["softer"]["Description"].startswith("Which one")
    assert (dataset / "participants.tsv").read_text() == "participant_id\nsub-P01\n"
    described = json.loads((dataset / "dataset_description.json").read_text())
    assert (described["Name"], described["Authors"]) == ("pair", ["A", "B"])


@pytest.fixture(scope="module")
def signals(tmp_path_factory):
    """A session whose trials have logs, as a dataset."""
    at, moving = tmp_path_factory.mktemp("signals"), {"x": lambda t: 0.5 + t}
    made = experiment(motion=moving)
    with Session(made, at / "data", "P01") as session:
        run(session, Simulated(session, observer), "file")
    to_bids(made, sessions("pair", at / "data"), at / "bids")
    return at / "bids" / "sub-P01" / "ses-1", sessions("pair", at / "data")[0].records


def test_a_trial_with_a_log_is_a_run(signals):
    """Stimulus and motion in their units, and onsets, from sample 0 of the trial."""
    place, records = signals
    for r in records:
        beh = place / "beh" / f"sub-P01_ses-1_task-pair_run-{r.number}"
        motion = place / "motion" / f"sub-P01_ses-1_task-pair_tracksys-input_run-{r.number}"
        x = np.loadtxt(f"{motion}_motion.tsv")
        y = np.loadtxt(f"{beh}_stim.tsv.gz")
        k = [s.params.get("k", 2.0) for s in r.trial.stimuli]
        events = Path(f"{beh}_events.tsv").read_text()
        head, *rows = (line.split("\t") for line in events.splitlines())
        assert head == ["onset", "duration", "trial_type", "scene"] and len(rows) == 2
        for (onset, duration, *kind), stiffness in zip(rows, k, strict=True):
            a, b = (round(1000 * t) for t in (float(onset), float(onset) + float(duration)))
            assert b - a == 100 and kind == ["silent", "spring"]
            assert np.abs(x[a:b] - 0.5 - np.arange(a, b) / 1000).max() < 1e-9
            assert np.abs(y[a:b] - stiffness * x[a:b]).max() < 1e-6
        assert events == Path(f"{motion}_events.tsv").read_text()
    told = json.loads(Path(f"{beh}_events.json").read_text())
    assert told["onset"]["Description"].endswith("since sample 0 of the log, not in real time")
    told = json.loads(Path(f"{beh}_stim.json").read_text())
    assert told == {
        "TaskName": "pair",
        "StartTime": 0.0,
        "SamplingFrequency": 1000.0,
        "Columns": ["force"],
        "force": {"Units": "N"},
    }
    told = json.loads(Path(f"{motion}_motion.json").read_text())
    assert (told["SamplingFrequency"], told["MotionChannelCount"]) == (1000.0, 1)
    channels = Path(f"{motion}_channels.tsv").read_text().splitlines()
    assert channels[1].split("\t") == ["x", "x", "POS", "hand", "m"]


def test_a_damaged_log_and_a_full_disk_are_told(tmp_path, monkeypatch):
    """Nothing is exported of a log that was changed, and no half of a dataset stays."""
    with Session(experiment(), tmp_path / "data", "P01") as session:
        run(session, Simulated(session, observer), "file")
    (saved,) = sessions("pair", tmp_path / "data")
    written = bids.safe_files.publish

    def full(path, data):
        if "run-9" in path.name:
            raise SinkError(f"cannot write {path}: the disk is full")
        written(path, data)

    monkeypatch.setattr(bids.safe_files, "publish", full)
    with pytest.raises(SinkError, match="the disk is full"):
        to_bids(experiment(), [saved], tmp_path / "bids")
    assert not (tmp_path / "bids").exists()
    monkeypatch.undo()
    motion = saved.folder / saved.records[0].displayed[-1]["log"] / "motion.f64"
    whole = bytearray(motion.read_bytes())
    whole[9] ^= 1
    motion.write_bytes(whole)
    with pytest.raises(SinkError, match="trial-0001.*put back a whole copy of it, or export"):
        to_bids(experiment(), [saved], tmp_path / "bids")
    assert len(to_bids(experiment(), [saved], tmp_path / "bids", signals=False)) == 5


def test_what_was_lost_is_0_and_training_is_there(tmp_path, monkeypatch):
    task = Rate("spring", ("rough",), Stimulus("spring"))
    items = ((task, None),)
    blocks = {"a": ConstantStimuli(items, training=True), "b": ConstantStimuli(items)}
    made = experiment(
        design=Sequential(blocks), questions=(choice("rough", "Rough?", "yes", "no"),)
    )
    with Session(made, tmp_path / "data", "P01") as session:
        run(session, Simulated(session, lambda trial, rng: Answer({"rough": "yes"})), "file")
    real = bids.delivered

    def lossy(log):
        for at, frames, _ in real(log):
            yield at, frames[:180], True
            yield at + 180, frames[180:], False

    monkeypatch.setattr(bids, "delivered", lossy)
    (saved,) = sessions("pair", tmp_path / "data")
    to_bids(made, [saved], tmp_path / "bids")
    beh = tmp_path / "bids" / "sub-P01" / "ses-1" / "beh"
    y = np.loadtxt(beh / "sub-P01_ses-1_task-pair_run-2_stim.tsv.gz")
    assert len(y) > 200 and np.abs(y[:180]).max() > 0 and (y[180:] == 0).all()
    table = (beh / "sub-P01_ses-1_task-pair_beh.tsv").read_text().splitlines()
    head, *rows = (line.split("\t") for line in table)
    assert [row[head.index("training")] for row in rows] == ["true", "false"]
    *_, table = to_psych_ds(made, [saved], tmp_path / "psych")
    assert len(table.read_text().splitlines()) == 3


def _die(left, event, _):
    if event == "os.rename" and not next(left):
        os.kill(os.getpid(), signal.SIGKILL)


def killed(write, data, out, files):
    """Export, and be killed before the last file has its name."""
    sys.addaudithook(partial(_die, iter(range(files - 1, -1, -1))))
    globals()[write](experiment(), sessions("pair", data), out)


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
def test_a_killed_export_is_no_dataset_and_two_do_not_meet(data, tmp_path):
    found, out = sessions("pair", data), tmp_path / "out"
    for write in (to_bids, to_psych_ds):
        whole = write(experiment(), found, tmp_path / write.__name__)
        held = safe_files.lock(safe_files.make_folder(out), "")  # as another export does
        with pytest.raises(SinkError, match="out: another run exports into it"):
            write(experiment(), found, out)
        os.close(held)
        assert list(out.iterdir()) == []
        given = write.__name__, str(data), str(out), len(whole)
        done = subprocess.run(
            [sys.executable, "-c", f"import test_bids as t; t.killed(*{given!r})"],
            env=os.environ
            | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])},
            capture_output=True,
        )
        assert done.returncode == -signal.SIGKILL, done.stderr
        names = {f.name for f in out.rglob("*") if f.is_file()}
        assert {f.name for f in whole} - names == {"dataset_description.json"}
        with pytest.raises(BadValue, match="has files"):
            write(experiment(), found, out)
        shutil.rmtree(out)


@pytest.mark.skipif(not VALIDATOR, reason="pip install bids-validator-deno (120 MB)")
def test_the_validator_of_bids_finds_no_error(dataset, signals):
    for folder in (dataset, signals[0].parents[1]):
        done = subprocess.run([VALIDATOR, str(folder)], capture_output=True, text=True)
        assert done.returncode == 0 and "[ERROR]" not in done.stdout, done.stdout


def test_psych_ds_has_a_table_for_each_session(data, tmp_path):
    """Its description names each column, as the scheme asks for."""
    files = to_psych_ds(experiment(), sessions("pair", data), tmp_path / "out", ["A"])
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
    with pytest.raises(BadValue, match="has files: give a new folder"):
        to_psych_ds(experiment(), sessions("pair", data), tmp_path / "out")


def test_the_command_writes_them(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(
        "from experiments.some import experiment\npair = experiment()\n"
    )
    words = ["experiment", "export", "own.py:pair", "--data", str(data), "--bids", "out"]
    done = CliRunner().invoke(app, words)
    assert (done.exit_code, done.stdout) == (0, "5 files in out\n"), done.output
    done = CliRunner().invoke(app, [*words[:-2], "--psych-ds", "other"])
    assert (done.exit_code, done.stdout) == (0, "2 files in other\n"), done.output
    done = CliRunner().invoke(app, words[:-2])
    assert done.exit_code == 2 and "--bids FOLDER, --psych-ds FOLDER, or both" in done.stderr
    again = CliRunner().invoke(app, words)
    assert again.exit_code == 2 and "out has files: give a new folder" in again.stderr


def test_what_cannot_be_a_dataset_is_refused(data, tmp_path):
    with pytest.raises(BadValue, match="have no answers yet"):
        to_bids(experiment(), [], tmp_path / "a")
    (one,) = sessions("pair", data)
    with pytest.raises(BadValue, match="sessions of pair, and not of other"):
        to_bids(experiment(name="other"), [one], tmp_path / "a")
    with pytest.raises(BadValue, match="no letter or digit"):
        label("--")
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


def is_said(path):
    return "All answers are simulated." in path.read_text(encoding="utf-8")


def bids_rows(found, folder):
    """Return the rows of a BIDS dataset where capitals do not count in names."""
    kept = {str(p).casefold(): p for p in to_bids(experiment(), found, folder, signals=False)}
    assert is_said(folder / "README.md") == found[0].simulated
    whose = {p.parts[-4] for p in kept.values() if p.name.endswith("_beh.tsv")}
    listed = (folder / "participants.tsv").read_text().split()[1:]
    assert len({w.casefold() for w in whose}) == len(listed) and {*listed} == whose
    return [
        dict(zip(head.split("\t"), row.split("\t"), strict=True))
        for p in kept.values()
        if p.name.endswith("_beh.tsv")
        for head, *rows in [p.read_text(encoding="utf-8").splitlines()]
        for row in rows
    ]


def psych_rows(found, folder):
    kept = {str(p).casefold(): p for p in to_psych_ds(experiment(), found, folder)}
    tables = [p for p in kept.values() if p.suffix == ".csv"]
    assert is_said(folder / "dataset_description.json") == found[0].simulated
    return [
        row
        for p in tables
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
@settings(max_examples=60, deadline=None, derandomize=True)
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
    alike = {label(who).casefold() for who, _ in names}
    good = len(names) == len(drawn) and len({kind for *_, kind, _ in drawn}) == 1
    if export is not table_rows:
        good = good and len(alike) == len({who for who, _ in names})
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "out"
        try:
            rows = export(found, folder)
        except BadValue:
            assert not good and not folder.exists()
            return
    assert good and len(rows) == sum(len(s.records) for s in found)
    mark = {str(row["simulated"]).lower() for row in rows}
    assert mark == {str(found[0].simulated).lower()}
