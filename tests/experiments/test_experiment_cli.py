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
import pytest
from refusals import refused
from typer.testing import CliRunner

from stimlib.cli import app, terminal
from stimlib.cli.experiments import experiment_of
from stimlib.cli.terminal import Terminal
from stimlib.errors import FaultError, SinkError
from stimlib.experiments import (
    Keyed,
    Psychometric,
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
from stimlib.experiments.designs import ConstantStimuli
from stimlib.experiments.trial import Stimulus
from some import TASK
design = ConstantStimuli(((TASK, 4.0), (TASK, 1.0)), 2)
known = {{"red": Stimulus("spring")}}
short = experiment(design=design, replays=1, familiarisation=known, observer=observer)
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


def test_a_mistake_in_a_later_trial_is_found_before_the_session_has_a_folder(file, tmp_path):
    wrong = 'dataclasses.replace(TASK, choices=("A", "B"))'
    later = f'Sequential({{"good": design, "wrong": ConstantStimuli((({wrong}, 4.0),))}})'
    file.write_text(
        file.read_text()
        + "import dataclasses\nfrom stimlib.experiments.designs import Sequential\n"
        + f"later = experiment(design={later})\n"
    )
    who = "--participant", "P07", "--sink", "offline", "--data", tmp_path / "data"
    said = stimlib("run", f"{file}:later", *who, status=2)
    assert "they must be the same; give the task the words of the question" in said
    assert not (tmp_path / "data").exists()


def test_a_folder_of_data_is_no_option_and_an_empty_session_may_go(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    who = "--participant", "P07", "--sink", "offline"
    stimlib("run", f"{file}:short", *who, status=2)  # no answer is typed
    said = stimlib("run", f"{file}:short", *who, status=2)
    assert "error: data/pair/P07-s1 is there already" in said
    file.write_text(file.read_text().replace("(TASK, 1.0)", "(TASK, 1.5)"))
    said = stimlib("resume", f"{file}:short", *who, status=2)
    assert "it has no answer, so you may delete its folder" in said


def test_a_session_without_a_device_says_so_before_it_begins(file, tmp_path):
    who = f"{file}:short", "--participant", "P07", "--data", tmp_path
    said = "no device plays the stimuli"
    assert said in stimlib("run", *who, status=2)
    assert said not in stimlib("run", *who, "--pilot", status=2)


def test_a_session_by_keyboard_left_and_resumed(file, tmp_path):
    who = [
        f"{file}:short",
        "--participant",
        "P07",
        "--session",
        "1",
        "--data",
        tmp_path / "data",
        "--sink",
        "offline",
    ]
    # one familiar, two answers
    said = stimlib("run", *who, typed="1\n0\n" + "\n1\n" + "\n7\nr\n2\n" + "\n", status=2)
    assert (
        "Get to know the stimuli: 1 = red, 0 = Begin\n" in said
        and "Please press one of these keys: 1, 2." in said
        and "Feel it again (1 left)" in said
    )
    again = shlex.join(["stimlib", "experiment", "resume", *map(str, who)])
    assert (
        f"the input has ended before the session; 2 answers are kept; go on with {again}\n" in said
    )
    saved = read(tmp_path / "data/pair/P07-s1")
    assert [r.answer.values["softer"] for r in saved.records] == ["first", "second"]
    assert [r.answer.replays for r in saved.records] == [0, 1] and [
        len(r.displayed) for r in saved.records
    ] == [1, 2]
    assert saved.records[0].displayed[0]["peak"]["force"] == pytest.approx(
        [s.params.get("k", 2.0) for s in saved.records[0].trial.stimuli]
    )
    assert "P07-s1 is there already: resume it" in stimlib("run", *who, status=2)
    where = f"{file}:short", "--data", tmp_path / "data"
    unfinished = "P07, session 1: 2 of 4 trials; finish it"
    assert unfinished in stimlib("analyse", *where)
    said = stimlib("resume", *who, typed="\n1\n\n1\n")
    assert unfinished not in stimlib("analyse", *where)
    assert "The session goes on where it stopped.\nTrial 3 of 4: any key = Continue\n" in said
    assert "Thank you" in said and "Get to know" not in said
    assert len(read(tmp_path / "data/pair/P07-s1").records) == 4
    told = stimlib("status", f"{file}:short", "--data", tmp_path / "data")
    assert (
        "P07 session 1: 4 trials, 0 of them training" in told
        and "1 replays" in told
        and "silent" not in told
    )
    stimlib("analyse", f"{file}:short", "--data", tmp_path / "data", "--out", tmp_path / "t.csv")
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert [r["softer"] for r in rows] == ["first", "second", "first", "first"] and rows[1][
        "replays"
    ] == "1"


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
    assert (
        f"0 answers are kept; go on with {shlex.join(['stimlib', 'experiment', 'resume', *who])}\n"
        in said
    )


def test_simulated_sessions_are_pilots(file, tmp_path):
    where = ["--data", tmp_path / "sim"]
    assert "2 sessions" in stimlib("simulate", f"{file}:made", "--participants", 2, *where)
    said = stimlib("analyse", f"{file}:made", *where, status=2)
    assert "has no sessions of pair; it has 2 pilots" in said
    note, table = stimlib("analyse", f"{file}:made", *where, "--pilot").split("\n", 1)
    assert note == "note: a simulated observer gave these answers, and no participant"
    assert (
        table.startswith("participant,session,number,condition,track,level,chance,outcome,")
        and table.count("\n") == 9
    )
    assert "PILOT SIMULATED P1 session 1: 4 trials" in stimlib("status", f"{file}:made", *where)
    told = json.loads(stimlib("status", f"{file}:made", *where, "--json"))
    assert [(s["participant"], s["pilot"], s["trials"]) for s in told] == [
        ("P1", True, 4),
        ("P2", True, 4),
    ]


PLANNED = """
levels = ConstantStimuli(tuple((TASK, k) for k in (1.0, 1.5, 2.0, 2.5, 3.0)), 6)
planned = experiment(design=levels)
"""


@pytest.mark.parametrize("log", [False, True])
def test_the_errors_of_a_planned_jnd_are_those_of_power(file, log):
    """With the same people, whose JNDs are log-normal: mean 0.4, spread 0.1."""
    file.write_text(file.read_text() + PLANNED)
    words = ["--jnd", 0.4, "--pse", 2, "--between", 0.1, "--participants", "2,3"]
    words += ["--experiments", 4, "--seed", 3, *["--log"] * log]
    said = stimlib("power", f"{file}:planned", *words)
    wide = NormalDist().inv_cdf(0.75)

    def person(rng):
        spread = math.sqrt(math.log(1 + (0.1 / 0.4) ** 2))
        jnd = 0.4 * math.exp(rng.normal(-(spread**2) / 2, spread))
        return Psychometric(2.0, (math.log10(1 + jnd / 2) if log else jnd) / wide, log=log)

    jnds = []

    def mean_jnd(columns):
        fits = fitted(columns, ["participant"], log=log, interval="none").values()
        jnds.extend(v.jnd * v.pse if log else v.jnd for v in fits)
        return np.nanmean(jnds[-len(fits) :]), np.nan

    design = experiment_of(f"{file}:planned")
    for n in (2, 3):
        jnds.clear()
        found = power(design, person, mean_jnd, n, truth=0.4, experiments=4, seed=3)
        row = next(line for line in said.splitlines() if f" {n} │" in line)
        assert row.split("│")[3:6] == [
            f" {found.trials[0]:.0f} ".rjust(13),
            f" {found.bias / 0.4:+.1%} ".rjust(22),
            f" {found.spread / 0.4:.1%} ".rjust(12),
        ]
    people = math.ceil((1.96 * np.nanstd(jnds, ddof=1) / 0.04) ** 2)
    assert f"silent: {people} participants of 30 trials for a mean JND within 10 %" in said


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--jnd", "0"], "--jnd 0: give a JND above 0"),
        (["--pse", "-2", "--log"], "--pse -2: give a finite PSE, above 0"),
        (["--between", "nan"], "--between nan: give a standard deviation"),
        (["--participants", "4,x"], "--participants 4,x: give whole numbers"),
        (["--link", "cubic"], "--link = 'cubic' must be one of probit"),
        (["--pse", "90"], "condition 'silent': no JND can be fitted to 30 trials; all answers"),
    ],
)
def test_a_plan_that_cannot_be_computed_is_refused(file, words, text):
    file.write_text(file.read_text() + PLANNED)
    plan = {"--jnd": 0.4, "--pse": 2, "--participants": 2, "--experiments": 2}
    given = [v for name, value in plan.items() if name not in words for v in (name, value)]
    assert f"error: {text}" in stimlib("power", f"{file}:planned", *given, *words, status=2)


def test_errors_of_the_users_own_functions_are_no_defects(file, tmp_path):
    text = file.read_text()
    file.write_text(
        text + "\ndef wrong(*words):\n    return {}['it']\nodd = experiment(design=design,"
        " observer=wrong)\n"
    )
    where = f"{file}, line {text.count(chr(10)) + 3}"
    data = ["--data", tmp_path / "sim", "--participants", 1]
    assert f"the observer ({where}): KeyError: 'it'" in stimlib(
        "simulate", f"{file}:odd", *data, status=2
    )
    file.write_text(
        file.read_text().replace("observer=wrong", "observer=observer, analysis=wrong", 1)
    )
    stimlib("simulate", f"{file}:odd", "--data", tmp_path / "b", "--participants", 1)
    assert f"the analysis ({where}): KeyError: 'it'" in stimlib(
        "analyse", f"{file}:odd", "--data", tmp_path / "b", "--pilot", status=2
    )


@pytest.mark.parametrize(
    "words, says",
    [
        (
            ["run", "{}:number", "--participant", "P1"],
            "is a int, no Experiment|there is no 'number'",
        ),
        (
            ["run", "{}:shorts", "--participant", "P1"],
            "there is no 'shorts' in it: write .*; it defines .*short",
        ),
        (
            ["run", "nothing", "--participant", "P1"],
            "write FILE.py:NAME, or one of ugrip, bounciness, firmness, roughness, nodules",
        ),
        (["run", "{}:short", "--participant", "Anna"], "must be a code"),
        (
            ["run", "{}:short", "--participant", "P1", "--sink", "jak"],
            "--sink jak: choose one of null, jack",
        ),
        (
            ["run", "{}:short", "--participant", "P1", "--device", "x"],
            "--device: is for --sink jack or portaudio or nidaq, not for null",
        ),
        (["resume", "{}:short", "--participant", "P1"], "no session .* to resume"),
        (["run", "{}:short"], "Missing option '--participant'; see stimlib experiment run --help"),
    ],
)
def test_mistakes_get_one_line(file, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(
        app, ["experiment", *(w.format(file) for w in words)], prog_name="stimlib"
    )
    assert done.exit_code == 2 and re.search(says, done.output) and done.output.count("\n") == 1, (
        done.output
    )
    assert not (tmp_path / "data").exists()


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
    ],
)
def test_every_kind_of_question_has_its_keys(monkeypatch, capsys, question, typed, value):
    lines = iter(typed.splitlines(keepends=True))
    monkeypatch.setattr(
        terminal.sys,
        "stdin",
        SimpleNamespace(isatty=lambda: False, readline=lambda: next(lines, "")),
    )
    assert Terminal().ask(None, question, 0) == value
    said = capsys.readouterr().out
    assert said.count("\nPlease ") == typed.count("\n") - 1 and not re.search(r"[\[\]'_]", said)


def test_a_stimulus_is_picked_by_its_number(monkeypatch, capsys):
    monkeypatch.setattr(terminal.sys, "stdin", StringIO("7\n2\n\n"))
    assert Terminal().pick(["red", "green"]) == "green" and Terminal().pick(["red"]) is None


def test_a_line_that_is_no_text_is_no_answer(monkeypatch, capsys):
    typed = TextIOWrapper(BytesIO(b"\xff\n"), "utf-8")
    monkeypatch.setattr(terminal.sys, "stdin", typed)
    refused(SinkError, "the input has ended", Terminal().ask, None, places("r", "Where?", 2), 0)
    assert "Please give at most 2 places" in capsys.readouterr().out


class Pty:
    """A terminal whose keys are hit by ``hit``, and what it has shown so far, echo
    included.
    """

    def __init__(self):
        self.hands, self.fd = os.openpty()
        self.before = termios.tcgetattr(self.fd)
        self.shown = ""

    def hit(self, keys):
        """Until they have come."""
        os.write(self.hands, keys)
        assert select.select([self.fd], [], [], 5)[0]

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


@pytest.mark.parametrize("end", [KeyboardInterrupt, SystemExit, SinkError("gone")])
def test_the_terminal_is_as_it_was_whatever_ends_a_session(pty, end):
    usual = signal.getsignal(signal.SIGTSTP)
    with pytest.raises((KeyboardInterrupt, SystemExit, SinkError)), terminal.terminal():
        attributes = termios.tcgetattr(pty.fd)
        assert not attributes[3] & (termios.ECHO | termios.ICANON) and attributes[3] & termios.ISIG
        assert attributes[6][termios.VQUIT] == b"\0" != pty.before[6][termios.VQUIT], (
            "no key ends it without this"
        )
        raise end
    assert termios.tcgetattr(pty.fd) == pty.before and signal.getsignal(signal.SIGTSTP) is usual


def test_a_session_that_is_suspended_gives_the_shell_its_terminal(pty, monkeypatch):
    stopped = []
    monkeypatch.setattr(terminal.signal, "raise_signal", lambda s: stopped.append((s, *look())))

    def look():
        return termios.tcgetattr(pty.fd), signal.getsignal(signal.SIGTSTP)

    with terminal.terminal():
        inside = look()
        os.kill(os.getpid(), signal.SIGTSTP)
        assert look() == inside and stopped == [(signal.SIGTSTP, pty.before, signal.SIG_DFL)]


def test_a_rating_of_nine_is_a_key_and_one_of_ten_a_line():
    nine, ten = (prompted(rating("size", "How large?", "small", "large", most=n)) for n in (9, 10))
    assert list(nine.keys) == list("123456789") and (nine.keys["9"], nine.line) == ("large", False)
    assert len(ten.keys) == 10 and ten.line and ten.hint == ""
    many = prompted(rating("size", "How large?", "small", "large", most=12))
    assert (dict(many.keys), many.line) == ({}, True) and many.hint.endswith("to 12 (large)")
    assert prompted(ranking("order", "The largest first", "A", "B")).words == ("A", "B")


def test_a_question_that_has_the_key_r_is_answered_by_it_and_is_not_shown_again():
    question = choice("softer", "Which one?", "left", "right", keys="lr")
    assert dict(prompted(question, replays=2).keys) == {"l": "left", "r": "right"}
    face = Keyed()
    face.read = lambda prompt: "r"
    assert face.ask(None, question, replays=2) == "right"


def session_of(file, folder):
    words = f"{file}:short --participant P1 --session 1 --data {folder} --sink offline"
    return shlex.split(words)


@pytest.mark.parametrize("name, code", [("SIGTERM", 143), ("SIGHUP", 129)])
def test_sigterm_and_sighup_end_a_session_as_ctrl_c_does(file, tmp_path, monkeypatch, name, code):
    def terminated(self, text):
        signal.raise_signal(getattr(signal, name))

    monkeypatch.setattr(Terminal, "tell", terminated)
    monkeypatch.setattr(Terminal, "pick", terminated)
    who, before = session_of(file, tmp_path), signal.getsignal(getattr(signal, name))
    said = stimlib("run", *who, status=code)
    assert said.endswith(
        f"0 answers are kept; go on with {shlex.join(['stimlib', 'experiment', 'resume', *who])}\n"
    )
    assert "the sessions of pair in " in stimlib(
        "analyse", f"{file}:short", "--data", tmp_path, status=2
    ), "no answers yet"
    assert signal.getsignal(getattr(signal, name)) is before


@pytest.mark.parametrize("error", [SinkError, FaultError])
def test_a_device_that_fails_says_the_whole_command_that_goes_on(
    file, tmp_path, monkeypatch, error
):
    def failed(*_, **__):
        raise error("the device has gone")

    monkeypatch.setattr("stimlib.experiments.runner.present", failed)
    who = session_of(file, tmp_path)
    again = shlex.join(["stimlib", "experiment", "resume", *who])
    assert f"error: the device has gone; 0 answers are kept; go on with {again}\n" in stimlib(
        "run", *who, typed="0\n\n", status=2
    )


def test_a_rest_lasts(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(terminal.time, "sleep", lambda s: clock.__setitem__(0, clock[0] + s))
    Terminal().rest(3.5)
    assert clock[0] == 3.5 and "rest for 4 s" in capsys.readouterr().out
