"""The command line of experiments: answers by keyboard, a session that is left and resumed, simulations, tables."""

import csv
import json
import re
import shlex
from io import BytesIO, TextIOWrapper
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from stimlib.cli import app, terminal
from stimlib.cli.terminal import Terminal
from stimlib.errors import SinkError
from stimlib.experiments.questions import choice, places, ranking, rating
from stimlib.experiments.saved import read

FILE = """
import sys
sys.path.insert(0, {here!r})
from some import experiment, observer
from stimlib.experiments.designs import Listed
from stimlib.experiments.trial import Stimulus
from some import TASK
design = Listed(((TASK, 4.0), (TASK, 1.0)), 2)
short = experiment(design=design, replays=1, familiarisation={{"red": Stimulus("spring")}}, observer=observer)
def made():
    return short
number = 3
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "pair_experiment.py"
    path.write_text(FILE.format(here=str(Path(__file__).parent)))
    return path


def stimlib(*words, typed="", status=0):
    done = CliRunner().invoke(app, ["experiment", *map(str, words)], input=typed)
    assert done.exit_code == status, done.output
    return done.output


def test_a_session_by_keyboard_left_and_resumed(file, tmp_path):
    who = [f"{file}:short", "--participant", "P07", "--data", tmp_path / "data", "--sink", "offline"]
    said = stimlib("run", *who, typed="1\n0\n" + "\n1\n" + "\n7\nr\n2\n" + "\n", status=2)  # one familiar, two answers
    assert "red; 0 = begin" in said and "'7' is no answer; answer one of first, second" in said and "once more (1 left)" in said
    assert "the input has ended before the session: all answers so far are kept, resume it" in said
    saved = read(tmp_path / "data/pair/P07-s1")
    assert [r.answer.values["softer"] for r in saved.records] == ["first", "second"]
    assert [r.answer.replays for r in saved.records] == [0, 1] and [len(r.displayed) for r in saved.records] == [1, 2]
    assert saved.records[0].displayed[0]["peak"]["force"] == pytest.approx(
        [s.params.get("k", 2.0) for s in saved.records[0].trial.stimuli]
    )
    assert "P07-s1 is there already: resume it" in stimlib("run", *who, status=2)
    assert "Thank you" in stimlib("resume", *who, typed="0\n\n1\n\n1\n")
    assert len(read(tmp_path / "data/pair/P07-s1").records) == 4
    told = stimlib("status", f"{file}:short", "--data", tmp_path / "data")
    assert "P07 session 1: 4 trials, 0 of them training" in told and "1 replays" in told and "silent" not in told
    stimlib("analyse", f"{file}:short", "--data", tmp_path / "data", "--out", tmp_path / "t.csv")
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert [r["softer"] for r in rows] == ["first", "second", "first", "first"] and rows[1]["replays"] == "1"


def test_ctrl_c_says_the_whole_command_that_goes_on(file, tmp_path, monkeypatch):
    def interrupted(self, text):
        raise KeyboardInterrupt

    monkeypatch.setattr(Terminal, "pick", interrupted)
    who = [
        f"{file}:short",
        "--participant",
        "P07",
        "--session",
        "2",
        "--data",
        str(tmp_path / "of mine"),
        "--sink",
        "offline",
        "--pilot",
    ]
    said = stimlib("run", *who, status=130)
    assert f"0 answers are kept; go on with {shlex.join(['stimlib', 'experiment', 'resume', *who])}\n" in said


def test_simulated_sessions_are_pilots(file, tmp_path):
    where = ["--data", tmp_path / "sim"]
    assert "2 sessions" in stimlib("simulate", f"{file}:made", "--participants", 2, *where)
    assert "there is no session of pair" in stimlib("analyse", f"{file}:made", *where, status=2)
    table = stimlib("analyse", f"{file}:made", *where, "--pilot")
    assert table.startswith("participant,session,number,condition,track,level,outcome,") and table.count("\n") == 9
    told = json.loads(stimlib("status", f"{file}:made", *where, "--json"))
    assert [(s["participant"], s["pilot"], s["trials"]) for s in told] == [("P1", True, 4), ("P2", True, 4)]


@pytest.mark.parametrize(
    "words, says",
    [
        (["run", "{}:number", "--participant", "P1"], "is a int, no Experiment|there is no 'number'"),
        (["run", "nothing", "--participant", "P1"], "write FILE.py:NAME, or one of ugrip, bounciness, roughness, nodules"),
        (["run", "{}:short", "--participant", "Anna"], "must be a code"),
        (["run", "{}:short", "--participant", "P1", "--sink", "jak"], "--sink jak: choose one of null, offline"),
        (["run", "{}:short", "--participant", "P1", "--device", "x"], "null has no device"),
        (["resume", "{}:short", "--participant", "P1"], "no session .* to resume"),
        (["run", "{}:short"], "Missing option '--participant'; see stimlib experiment run --help"),
    ],
)
def test_mistakes_get_one_line(file, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["experiment", *(w.format(file) for w in words)], prog_name="stimlib")
    assert done.exit_code == 2 and re.search(says, done.output) and done.output.count("\n") == 1, done.output
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    "question, typed, value",
    [
        (rating("r", "How rough?", "smooth", "rough"), "8\n4\n", 4),
        (rating("r", "How rough?", "none", "most", 100), 5000 * "9" + "\n55\n", 55),
        (ranking("r", "The largest first", "A", "B"), "A\nB A\n", ["B", "A"]),
        (places("r", "Where?", 2), "1 x\n0.1 0.2; 3 4\n", [[0.1, 0.2], [3.0, 4.0]]),
        (choice("r", "Was there one?", "yes", "no", keys="yn"), "1\nn\n", "no"),
    ],
)
def test_every_kind_of_question_has_its_keys(monkeypatch, capsys, question, typed, value):
    lines = iter(typed.splitlines(keepends=True))
    monkeypatch.setattr(terminal.sys, "stdin", SimpleNamespace(isatty=lambda: False, readline=lambda: next(lines, "")))
    assert Terminal().ask(None, question, 0) == value
    assert capsys.readouterr().out.count("is no answer") == typed.count("\n") - 1


def test_the_end_of_input_in_a_terminal(monkeypatch):
    monkeypatch.setattr(terminal.sys, "stdin", SimpleNamespace(isatty=lambda: True))

    def ended():
        raise EOFError

    monkeypatch.setattr(terminal.typer, "getchar", ended)
    with pytest.raises(SinkError, match="the input has ended.*resume it"):
        Terminal().ready("trial 2")


def test_a_line_that_is_no_text_is_no_answer(monkeypatch, capsys):
    typed = TextIOWrapper(BytesIO(b"\xff\n"), "utf-8")
    monkeypatch.setattr(terminal.sys, "stdin", typed)
    with pytest.raises(SinkError, match="the input has ended"):
        Terminal().ask(None, places("r", "Where?", 2), 0)
    assert "is no answer" in capsys.readouterr().out


def test_a_key_is_enough_in_a_terminal_and_a_rest_lasts(monkeypatch, capsys):
    keys = iter("r1")
    monkeypatch.setattr(terminal.sys, "stdin", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr(terminal.typer, "getchar", lambda: next(keys))
    question = choice("softer", "?", "first", "second")
    assert Terminal().ask(None, question, 1) is None and Terminal().ask(None, question, 0) == "first"
    clock = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(terminal.time, "sleep", lambda s: clock.__setitem__(0, clock[0] + s))
    Terminal().rest(3.5)
    assert clock[0] == 3.5 and "rest for 4 s" in capsys.readouterr().out
