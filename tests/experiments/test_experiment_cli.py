"""The command line of experiments: answers by keyboard, a session that is left and
resumed, simulations, tables.
"""

import csv
import json
import math
import os
import re
import select
import shlex
import signal
import termios
from io import BytesIO, StringIO, TextIOWrapper
from pathlib import Path
from statistics import NormalDist
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from refusals import refused
from typer.testing import CliRunner

from stimlib import Input, Param, Scene
from stimlib.cli import app, terminal
from stimlib.cli.experiments import _unit, experiment_of
from stimlib.cli.terminal import Terminal
from stimlib.errors import FaultError, SinkError, counted
from stimlib.experiments import (
    Keyed,
    PsychometricObserver,
    Stimulus,
    Trial,
    TwoInterval,
    analogue,
    choice,
    fitted,
    places,
    power,
    prompted,
    ranking,
    rating,
    read,
)

FILE = """
import sys
sys.path.insert(0, {here!r})
from some import experiment, observer
from stimlib.experiments import ConstantStimuli, Stimulus
from some import TASK
design = ConstantStimuli(((TASK, 4.0), (TASK, 1.0)), 2)
known = {{"red": Stimulus("spring")}}
short = experiment(design=design, replays=1, familiarisation=known, observer=observer)
def made():
    return short
def failing():
    return {{}}['it']
def asking(code):
    return short
number = 3
levels = ConstantStimuli(tuple((TASK, k) for k in (1.0, 1.5, 2.0, 2.5, 3.0)), 6)
planned = experiment(design=levels)
"""


def plan(jnd="0.4", pse="2", people="2", more=""):
    words = f"power {{}}:planned --jnd {jnd} --pse {pse} --participants {people} --experiments 2"
    return f"{words} {more}".split()


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "pair_experiment.py"
    path.write_text(FILE.format(here=str(Path(__file__).parent)))
    return path


def stimlib(*words, typed="", status=0):
    done = CliRunner().invoke(app, ["experiment", *map(str, words)], input=typed)
    assert done.exit_code == status, done.output
    return done.output


def test_a_folder_of_data_is_no_option_and_an_empty_session_may_go(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    who = f"{file}:short", "--participant", "P07", "--sink", "offline"
    stimlib("run", *who, status=2)  # no answer is typed
    assert "data/pair/P07-s1 is there already" in stimlib("run", *who, status=2)
    second = int(file.stat().st_mtime)
    file.write_text(file.read_text().replace("(TASK, 1.0)", "(TASK, 1.5)"))
    os.utime(file, (second, second))  # an edit of equal length within a second is one, too
    assert "it has no answer" in stimlib("resume", *who, status=2)
    said = "no device plays"
    other = f"{file}:short", "--participant", "P08"
    assert said in stimlib("run", *other, status=2)
    assert said not in stimlib("run", *other, "--pilot", status=2)


def test_a_session_by_keyboard_left_and_resumed(file, tmp_path):
    who = words_of(file, tmp_path)
    where = f"{file}:short", "--data", tmp_path
    # one familiar, two answers
    said = stimlib("run", *who, typed="1\n0\n" + "\n1\n" + "\n7\nr\n2\n" + "\n", status=2)
    for text in ("1 = red, 0 = Begin\n", "press one of these keys: 1, 2.", "again (1 left)"):
        assert text in said
    assert f"the input has ended before the session; {goes_on(who, 2)}" in said
    saved = read(tmp_path / "pair/P07-s1")
    kept = [(r.answer.values["softer"], r.answer.replays, len(r.displayed)) for r in saved.records]
    assert kept == [("first", 0, 1), ("second", 1, 2)]
    assert saved.records[0].displayed[0]["peak"]["force"] == pytest.approx(
        [s.params.get("k", 2.0) for s in saved.records[0].trial.stimuli]
    )
    assert "resume it" in stimlib("run", *who, status=2)
    unfinished = "P07, session 1: 2 of 4 trials; finish it"
    assert unfinished in stimlib("analyse", *where)
    said = stimlib("resume", *who, typed="\n1\n\n1\n")
    assert unfinished not in stimlib("analyse", *where)
    assert "goes on where it stopped.\nTrial 3 of 4: any key = Continue\n" in said
    assert "Thank you" in said and "Get to know" not in said
    told = stimlib("status", *where)
    assert "P07 session 1: 4 trials, none of them training" in told
    assert max(map(len, told.splitlines()[:-1])) <= 80 and "limited" not in told
    assert "  1 replay\n" in told and "silent" not in told
    stimlib("analyse", *where, "--out", tmp_path / "t.csv")
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert [r["softer"] for r in rows] == ["first", "second", "first", "first"]
    assert rows[1]["replays"] == "1"
    excel = "--separator", ";", "--decimal", ",", "--bom", "--out", tmp_path / "e.csv"
    stimlib("analyse", *where, *excel)
    told = pd.read_csv(tmp_path / "e.csv", sep=";", decimal=",")
    pd.testing.assert_frame_equal(told, pd.read_csv(tmp_path / "t.csv"))
    assert (tmp_path / "e.csv").read_bytes().startswith(b"\xef\xbb\xbfparticipant;session;")
    assert "not both by one sign" in stimlib("analyse", *where, "--decimal", ",", status=2)


def typed(line):
    """A command that was printed, as a shell takes it apart."""
    return shlex.split(line.removeprefix("next: "))[2:]


def test_simulated_sessions_are_pilots(file, tmp_path):
    (tmp_path / "my own").mkdir()
    file = file.rename(tmp_path / "my own" / file.name)
    where = f"{file}:made", "--data", str(tmp_path / "my own" / "sim")
    told = stimlib("status", *where)
    assert typed(told.splitlines()[1]) == ["run", *where, "--participant", "P1"]
    told = stimlib("simulate", *where, "--participants", 2)
    assert "2 sessions" in told and typed(told.splitlines()[-1]) == ["analyse", *where, "--pilot"]
    assert "has no sessions of pair; it has 2 pilots" in stimlib("analyse", *where, status=2)
    note, table = stimlib("analyse", *where, "--pilot").split("\n", 1)
    assert note.startswith("note: a simulated observer") and table.count("\n") == 9
    assert table.startswith("participant,session,number,condition,track,level,chance,outcome,")
    told = stimlib("status", *where)
    assert "PILOT SIMULATED P1 session 1: 4 trials" in told
    assert typed(told.splitlines()[-1]) == ["analyse", *where, "--pilot"]
    page = tmp_path / "page.html"
    stimlib("analyse", *where, "--pilot", "--report", page)
    assert "<li>All answers are simulated" in page.read_text("utf-8")
    assert "PILOT sessions: kept apart from the data." in page.read_text("utf-8")
    told = stimlib("status", *where, "--pilot")
    assert told.startswith("PILOT SIMULATED P1") and "\nPILOT" in told
    told = json.loads(stimlib("status", *where, "--json"))
    assert [(s["participant"], s["pilot"], s["trials"]) for s in told] == [
        ("P1", True, 4),
        ("P2", True, 4),
    ]


@pytest.mark.parametrize(("unit", "told"), [("Hz", "Hz"), ("N/m", "N/m"), ("", ""), ("1", "")])
def test_a_page_has_the_unit_of_the_level(unit, told):
    scene = Scene({"y": 1.0 * Param("k", 1.0, unit)})
    trial = Trial("c", (Stimulus("a", {"k": 5.0}),), ("q",), 5.0)
    found = [SimpleNamespace(records=[SimpleNamespace(trial=trial)])]
    assert _unit(SimpleNamespace(scenes={"a": scene}), found) == told


@pytest.mark.parametrize(("log", "sizes"), [(False, "2,3"), (True, "2")])
def test_the_errors_of_a_planned_jnd_are_those_of_power(file, log, sizes):
    """With the same people, whose JNDs are log-normal: mean 0.4, spread 0.1."""
    words = ["--jnd", 0.4, "--pse", 2, "--between", 0.1, "--participants", sizes]
    words += ["--experiments", 2, "--seed", 3, *["--log"] * log]
    said = stimlib("power", f"{file}:planned", *words)
    wide = NormalDist().inv_cdf(0.75)

    def person(rng):
        spread = math.sqrt(math.log(1 + (0.1 / 0.4) ** 2))
        jnd = 0.4 * math.exp(rng.normal(-(spread**2) / 2, spread))
        return PsychometricObserver(2.0, (math.log10(1 + jnd / 2) if log else jnd) / wide, log=log)

    def mean_jnd(columns):
        fits = fitted(columns, ["participant"], log=log, interval="none").values()
        jnds.append([v.jnd * v.pse if log else v.jnd for v in fits])
        return np.nanmean(jnds[-1]), np.nan

    for n in map(int, sizes.split(",")):
        jnds = []
        design = experiment_of(f"{file}:planned")
        found = power(design, person, mean_jnd, n, truth=0.4, experiments=2, seed=3)
        row = next(line for line in said.splitlines() if f" {n} │" in line)
        numbers = f"{found.trials[0]:.0f} {found.bias / 0.4:+.1%} {found.spread / 0.4:.1%}"
        assert [v.strip() for v in row.split("│")[3:6]] == numbers.split()
    people = math.ceil((1.96 * np.nanstd(jnds, ddof=1) / 0.04) ** 2)
    assert f"silent: {people} participants of 30 trials" in said


def test_the_unit_of_a_page_is_that_of_the_level_not_of_an_equal_number():
    x, f = Input("x", "m"), Param("f", 1.0, "N")
    scene = Scene({"force": Param("k", 2.0, "N/m") * x + f})
    task = TwoInterval("f", "more", Stimulus("s", {"k": 2.0}), Stimulus("s", {"k": 2.0}), "f")
    trials = [SimpleNamespace(trial=task.trial(f, 1, n)) for n, f in enumerate((2.0, 1.0, 3.0))]
    made, saved = SimpleNamespace(scenes={"s": scene}), SimpleNamespace(records=trials)
    assert _unit(made, [saved]) == "N" and _unit(made, []) == ""


def test_errors_of_the_users_own_functions_are_no_defects(file, tmp_path):
    text = file.read_text()
    text += "\ndef wrong(*words):\n    return {}['it']\nodd = experiment(design=design,"
    data = f"{file}:odd", "--data", tmp_path / "sim"
    where = f"({file}, line {text.count(chr(10))}): KeyError: 'it'"
    file.write_text(f"{text} observer=wrong)\n")
    one = "simulate", *data, "--participants", 1
    assert f"the observer {where}" in stimlib(*one, status=2)
    file.write_text(f"{text} observer=observer, analysis=wrong)\n")
    stimlib(*one[:3], tmp_path / "b", *one[4:])
    data = *data[:2], tmp_path / "b"
    assert f"the analysis {where}" in stimlib("analyse", *data, "--pilot", status=2)


@pytest.mark.parametrize(
    "words, says",
    [
        (["run", "{}:number", "--participant", "P1"], "is a int, no Experiment"),
        (["run", "{}:shorts", "--participant", "P1"], "no 'shorts' in it.*short"),
        (["run", "nothing", "--participant", "P1"], "one of ugrip, bounciness"),
        (["status", "{}:failing"], r"function failing \(.*py, line 13\): KeyError: 'it'"),
        (["status", "{}:asking"], "the function asking: TypeError: .* argument: 'code'"),
        (["run", "{}:short", "--participant", "Anna"], "must be a code"),
        (["run", "{}:short", "--participant", "P1", "--sink", "jak"], "--sink = 'jak'; choose"),
        (["run", "{}:short", "--participant", "P1", "--device", "x"], "--device.*not for null"),
        (["resume", "{}:short", "--participant", "P1"], "no session .* to resume"),
        (["run", "{}:short"], "Missing option '--participant'"),
        (plan(jnd="0"), "--jnd 0: give"),
        (plan(pse="-2", more="--log"), "--pse -2: give a finite"),
        (plan(more="--between nan"), "--between nan: give"),
        (plan(pse="0.5", more="--log --between nan"), "--between nan: give"),  # takes that PSE
        (plan(people="4,x"), "--participants 4,x: give whole"),
        (plan(more="--link cubic"), "--link = 'cubic'; choose one of probit"),
        (plan(pse="90"), "condition 'silent': no JND"),
    ],
)
def test_mistakes_get_one_line(file, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    told = [w.format(file) for w in words]
    done = CliRunner().invoke(app, ["experiment", *told], prog_name="stimlib")
    assert done.exit_code == 2 and re.search(says, done.output), done.output
    assert done.output.count("\n") == 1 and not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    "question, typed, value",
    [
        (rating("r", "How rough?", "smooth", "rough"), "8\n4\n", 4),
        (rating("r", "How rough?", "none", "most", 100), 5000 * "9" + "\n55\n", 55),
        (ranking("r", "The largest first", "A", "B"), "A\nB A\n", ["B", "A"]),
        (places("r", "Where?", 2), "1 x\n0.1 0.2; 3 4\n", [[0.1, 0.2], [3.0, 4.0]]),
        (places("r", "Where?", 2), "\n;\nn\n", []),
        (choice("r", "Was there one?", "yes", "no", keys="yn"), "1\nn\n", "no"),
        (analogue("r", "How rough?", "smooth", "rough"), "101\n62.5\n", 62.5),
        (("red", "green"), "7\n2\n", "green"),
        (("red",), "\n", None),
    ],
)
def test_every_kind_of_question_has_its_keys(monkeypatch, capsys, question, typed, value):
    monkeypatch.setattr(terminal.sys, "stdin", StringIO(typed))
    face = Terminal()
    if isinstance(question, tuple):
        assert face.pick(list(question)) == value
    else:
        assert face.ask(None, question, 0) == value
        said = capsys.readouterr().out
        assert said.count("\nPlease ") == typed.count("\n") - 1
        assert not re.search(r"[\[\]'_]", said)
        refused(SinkError, "the input has ended", face.ask, None, question, 0)


def test_a_line_that_is_no_text_is_no_answer(monkeypatch, capsys):
    monkeypatch.setattr(terminal.sys, "stdin", TextIOWrapper(BytesIO(b"\xff\n"), "utf-8"))
    refused(SinkError, "the input has ended", Terminal().ask, None, places("r", "Where?", 2), 0)
    assert "at most 2 places" in capsys.readouterr().out


class Pty:
    """A terminal whose keys are hit by ``hit``, and what it has shown so far, echo
    included.
    """

    def __init__(self):
        self.hands, self.fd = os.openpty()
        self.before = termios.tcgetattr(self.fd)
        self.shown = ""

    def hit(self, keys):
        """Until they have come, or somebody has read them already."""
        os.write(self.hands, keys)
        select.select([self.fd], [], [], 1)

    def screen(self):
        """All that has been shown; the mark comes after it."""
        os.write(self.fd, b"|")
        while not self.shown.endswith("|"):
            self.shown += os.read(self.hands, 4096).decode()
        self.shown = self.shown[:-1]
        return self.shown

    def at(self, text, keys):
        """Hits keys when a text has been shown: after what was hit before is
        dropped.
        """

        def print_(words, **options):
            os.write(self.fd, words.encode() + b"\n")
            if text in words:
                os.write(self.hands, keys)

        return print_


@pytest.fixture
def pty(monkeypatch):
    made = Pty()
    with open(made.fd) as stdin:
        monkeypatch.setattr(terminal.sys, "stdin", stdin)
        yield made
    os.close(made.hands)


def test_keys_of_a_terminal_are_taken_and_shown_only_where_they_are_asked_for(pty, monkeypatch):
    question, order = choice("softer", "?", "first", "second"), ranking("size", "Order", "A", "B")
    with terminal.terminal() as face:
        pty.hit(b"2")  # while a stimulus plays
        for keys, answer in ((b"r", None), (b"1", "first")):
            monkeypatch.setattr(terminal, "print", pty.at("?", keys), raising=False)
            assert face.ask(None, question, 1) == answer
        pty.hit(b"A B\n")  # all of it for nothing
        assert pty.screen() == 2 * "? 1 = first, 2 = second, r = Feel it again (1 left)\r\n"
        monkeypatch.setattr(terminal, "print", pty.at("Order", b"B A\n"), raising=False)
        assert face.ask(None, order, 0) == ["B", "A"]
        assert pty.screen().endswith("B A\r\n"), "a line is seen while it is typed"
        pty.hit(b"1")
        assert pty.screen().endswith("B A\r\n")
        monkeypatch.setattr(terminal, "print", pty.at("r", b"\x04"), raising=False)
        for ask in (lambda: face.ready("trial 2"), lambda: face.ask(None, order, 0)):
            refused(SinkError, "the input has ended before the session", ask)
        pty.hit(b"rm -r data\n")
    assert termios.tcgetattr(pty.fd) == pty.before and not select.select([pty.fd], [], [], 0)[0], (
        "nothing for the shell"
    )


def test_the_terminal_is_as_it_was_whatever_ends_or_suspends_a_session(pty, monkeypatch):
    def look():
        return termios.tcgetattr(pty.fd), signal.getsignal(signal.SIGTSTP)

    before, stopped = look(), []
    monkeypatch.setattr(terminal.signal, "raise_signal", lambda s: stopped.append((s, *look())))
    for end in (KeyboardInterrupt, SystemExit, SinkError("gone")):
        with pytest.raises((KeyboardInterrupt, SystemExit, SinkError)), terminal.terminal():
            attributes, _ = inside = look()
            assert not attributes[3] & (termios.ECHO | termios.ICANON)
            assert attributes[3] & termios.ISIG
            no_key = attributes[6][termios.VQUIT]
            assert no_key == b"\0" != pty.before[6][termios.VQUIT], "no key ends it without this"
            os.kill(os.getpid(), signal.SIGTSTP)
            assert look() == inside and stopped.pop() == (
                signal.SIGTSTP,
                pty.before,
                signal.SIG_DFL,
            )
            raise end
        assert look() == before


def test_a_rating_of_nine_is_a_key_and_one_of_ten_a_line():
    nine, ten, many = (prompted(rating("size", "?", "small", "large", n)) for n in (9, 10, 12))
    assert list(nine.keys) == list("123456789") and (nine.keys["9"], nine.line) == ("large", False)
    assert len(ten.keys) == 10 and ten.line and ten.hint == ""
    assert (dict(many.keys), many.line) == ({}, True) and many.hint.endswith("to 12 (large)")
    assert prompted(ranking("order", "The largest first", "A", "B")).words == ("A", "B")


def test_a_question_that_has_the_key_r_is_answered_by_it_and_is_not_shown_again():
    question = choice("softer", "Which one?", "left", "right", keys="lr")
    assert dict(prompted(question, replays=2).keys) == {"l": "left", "r": "right"}
    face = Keyed()
    face.read = lambda prompt: "r"
    assert face.ask(None, question, replays=2) == "right"


def interrupted(*_, **__):
    raise KeyboardInterrupt


def failed(*_, **__):
    raise FaultError("the device has gone")


@pytest.mark.parametrize(
    ("end", "code", "more"),
    [
        (interrupted, 130, ["--pilot"]),
        (lambda *_: signal.raise_signal(signal.SIGTERM), 143, []),
        (lambda *_: signal.raise_signal(signal.SIGHUP), 129, []),
        (failed, 2, []),
    ],
)
def test_sigterm_and_sighup_end_a_session_as_ctrl_c_does(
    file, tmp_path, monkeypatch, end, code, more
):
    """And a device that fails: each says the whole command that goes on."""
    monkeypatch.setattr(Terminal, "pick", end)
    numbers = signal.SIGTERM, signal.SIGHUP
    who, before = words_of(file, tmp_path / "of mine", *more), list(map(signal.getsignal, numbers))
    assert stimlib("run", *who, status=code).endswith(goes_on(who))
    assert list(map(signal.getsignal, numbers)) == before


def test_a_rest_lasts(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(terminal.time, "sleep", lambda s: clock.__setitem__(0, clock[0] + s))
    Terminal().rest(3.5)
    assert clock[0] == 3.5 and "rest for 4 s" in capsys.readouterr().out


def words_of(file, folder, *more):
    words = "--participant P07 --session 1 --data".split()
    return [f"{file}:short", *words, str(folder), "--sink", "offline", *more]


def goes_on(words, answers=0):
    again = shlex.join(["stimlib", "experiment", "resume", *words])
    return f"{counted(answers, 'answer')} kept; go on with {again}\n"
