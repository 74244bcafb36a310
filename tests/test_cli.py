"""The command line as a person uses it: real files, and processes of their own where
signals and streams count.
"""

import hashlib
import inspect
import itertools
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile
import typer
from commands import ran, refuses
from devices.servers import Jackd, needs_jack, played

import stimlib
from stimlib import demo
from stimlib.analysis.listening import vibration
from stimlib.cli import app
from stimlib.cli.app import _of_options
from stimlib.cli.scene import _ours
from stimlib.core.definitions import definitions
from stimlib.core.graph import registry
from stimlib.devices import available, jack_loopback
from stimlib.files import audio as file
from stimlib.files.sidecar import told as told_by
from stimlib.motion import minimum_jerk, parse_motion, sinusoid

# the lines of its errors are those of test_a_mistake_gets_one_line_and_leaves_nothing
OWN = """
from stimlib import Input, Param, Scene
from stimlib.sweep import measure
from math import sin


def units():
    return Scene({"y": Input("x", "m") + 1.0})


def name():
    return Scene({"y": nothing})


def deep():
    return [inner() for _ in range(2)][0]


def inner():
    return [1.0][5]


def wants(a):
    return a


def number_of_a_block():
    return Scene({"y": sin(Input("x"))})


class Odd(Scene):
    @property
    def inputs(self):
        return {}[3]


def odd():
    return Odd({"y": Input("x")})


def soft():
    return Scene({"force": Param("k", 500.0, "N/m") * Input("x", "m")})


def two():
    x = Input("x", "m")
    return Scene({"force": Param("k", 500.0, "N/m") * x, "place": 1 * x})


def broken():
    return Scene({"y": 1.0 / Input("x", "m")})


def number():
    return 3


def _hidden():
    return soft()


@measure("N")
def top(run):
    return run["force"].max()


ready = soft()
table = {"k": 1.0}
"""
PEN = """
from stimlib import Input, Scene, constant
def scene():
    return Scene({"f": constant(100.0, "N/m") * Input("x", "m") + Input("press", "N")})
def contact():
    return Scene({"f": Input("contact") * scene().outputs["f"]})
"""
GRIP = "t_s,force_N,x_mm\n0,8,1\n0.012,9,1\n0.024,11,2\n0.036,14,3\n"
FILES = {
    "own.py": OWN,
    "pen.py": PEN,
    "pen.csv": "t_s,pos_mm,force_N\n0,1,0\n0.01,2,5\n0.02,3,9\n",
    "pen(1).trc": "t_s\tpos_mm\n0\t1\n0.01\t2\n0.02\t3\n",
    "lift.csv": "t_s,pos_mm,contact\n0,1,1\n0.01,2,1\n0.02,3,0\n",
    "grip.csv": GRIP,
    "tablet.csv": "t_ms;x_mm\n0;1,0\n8;1,5\n8;2,0\n16;2,5\n24;3,0\n",
    "syntax.py": "def f(:\n",
    "absent.py": "import nothing_of_that_name\n",
    "zero.py": "1 / 0\n",
    "null.py": "\0",
    "names/numpy.py": "",
    "odd.txt": "",
    "text.wav": "hello",
}

THERE = {name.partition("/")[0] for name in FILES}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with files of a user, in which a command runs."""
    (tmp_path / "names").mkdir()
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Of a session of half a second, which tests only read."""
    folder = tmp_path_factory.mktemp("log") / "a.stimlog"
    scene, hand = stimlib.scenes.squeeze(fingers=1), {"x1": minimum_jerk(depth=0.01)}
    sink = stimlib.devices.NullSink(scene, 50.0, clocked=False, motion=hand, log=folder)
    played(sink, 0.5, channels=["force1", None])
    return folder


# What all commands have in common -----------------------------------------------------
COMMANDS = {
    f"{name} {more}".strip(): made
    for name, command in typer.main.get_command(app).commands.items()
    for more, made in getattr(command, "commands", {"": command}).items()
}
NEEDED = {
    "--out": "a.wav",
    "--participant": "P01",
    "--jnd": "1",
    "--pse": "1",
    "--device": "missing",
}
ALONE = "demo", "devices", "list", "render-set", "schema"  # they read no file of a user


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_and_refuses_options_and_files_that_are_not_there(here, name):
    params, words = COMMANDS[name].params, name.split()
    assert f"stimlib {name}" in ran([*words, "--help"], prog_name="stimlib").stdout
    refuses([*words, "--no-such-option"], "No such option", prog_name="stimlib")
    if name in ALONE:
        return
    words += ["missing.json"] if "experiment" not in name else ["missing.py:made"]
    words += ["b.wav"] * (name == "convert") + ["--bids", "b"] * (name == "experiment export")
    needed = [p.opts[0] for p in params if p.required and p.opts[0].startswith("--")]
    assert NEEDED.keys() >= {*needed}, "tests/test_cli.py: give these options a value in NEEDED"
    words += [word for option in needed for word in (option, NEEDED[option])]
    words += ["--wav", "text.wav"] * (name == "verify") + ["--axis", "k=1,2"] * (name == "sweep")
    words += ["--json"] * any("--json" in p.opts for p in params)
    refuses(words, "missing." if name != "replay" else "there is no log")
    assert {p.name for p in here.iterdir()} == THERE


@pytest.mark.parametrize(
    "words", ["render own.py:odd --out a.wav --motion minimum_jerk()", "show own.py:odd"]
)
def test_a_defect_ends_with_its_traceback_and_status_3(here, words):
    """Status 1 says that a check failed, and must say nothing else; here a scene breaks
    what stimlib relies on.
    """
    ran(words, 3, "unexpected error: KeyError: 3; this is a defect of stimlib, please report it")
    assert not (here / "a.wav").exists()


HAND = "--motion minimum_jerk(depth=0.01)"
GRIPPED = "--motion recording('grip.csv',{'x':'force_N*5e-4'},max_speed=2)"
SQUEEZE = f"render squeeze --out a.wav {HAND}"
SWEEP = f"sweep squeeze {HAND} --seconds 0.05 --workers 0"
PLAY = f"play squeeze {HAND} --quiet --full-scale 50"
PEN_TO = "render pen.py:scene --out a.wav --full-scale 100 --motion pen.csv --map x=pos_mm*1e-3"
LIFT = "--out a.wav --motion lift.csv --map"
DEEP = "squeeze(k=" + "(" * 5000 + ")"
LISTED = "units, name, deep, inner, number_of_a_block, odd, soft, two, broken, number"
ALL = f"{LISTED}, ready"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        # usage
        ("render squeeze", "Missing option '--out' / '-o'; see stimlib render --help"),
        ("show", "Missing argument 'SCENE'; see"),
        ("render squeeze --ou a.wav", "No such option"),
        ("rendr", "No such command 'rendr'"),
        ("list squeeze(fingers=1)", "takes no name; for one scene write stimlib show NAME; see"),
        ("play squeeze --full-scale 1 --sink x", "'null', 'jack', 'portaudio', 'nidaq'; see"),
        ("show squeeze --fs a", "Invalid value for '--fs': "),
        ("verify --log", "'--log' requires an argument; see stimlib"),
        ("render tone --seed 1 --seed=2 --out a.wav", "--seed is given twice"),
        ("experiment status softer --data a --data b", "--data is given twice"),
        # scenes
        ("show sqeeze", "no scene 'sqeeze': did you mean squeeze? Use one of bump_grid"),
        ("play squeeze --set K=3", "--set: there is no parameter 'K'"),
        ("live squeeze --range z=0:1", "error: --range: there is no input or parameter 'z'"),
        ("verify a.wav --html a.html", "No such option: --html; write --report; see"),
        ("show squeeze(fingers='a')", "squeeze: fingers = 'a' must be a whole number"),
        ("show squeeze(fingers=None)", "a whole number"),
        (f"show squeeze(fingers='{200 * 'y'}')", f"fingers = '{76 * 'y'}... must be"),
        ("show squeeze(fingers=10000000)", "limits.scene_blocks"),
        ("show squeeze(k=1e999)", "not finite"),
        ("show squeeze(contact=1)", "True or False"),
        ("show squeeze(q=1)", "squeeze: there is no argument 'q'; there are "),
        ("show squeeze(seed=" + "9" * 400 + ")", "seed"),
        ("show squeeze(k=" + "9" * 400 + ")", "beyond what a float"),
        ("show bumps(waveform=3)", "bumps: waveform = 3 must be a text or"),
        ("show viscoelastic(alpha='a')", "a number"),
        ("show squeeze(2)", "name=number"),
        ("show squeeze(**{'k':1})", "name=number"),
        ("show squeeze(k={[]:1})", "name=number"),
        (["show", DEEP], "name=number"),
        (["show", "squeeze(\0)"], "name=number"),
        ("show " + "x" * 5000 + ".json", "cannot read"),
        ("show " + "x" * 5000 + ".py:f", "cannot read"),
        (["show", "a\0.json"], "cannot read"),
        (["show", "a\0.py:f"], "cannot read"),
        ("show squeeze --draw x.txt", "the suffix of 'x.txt'"),
        # a user's own code
        ("show own.py:units", "own.py:8: cannot add [m]"),
        ("show own.py:name", "own.py:12: NameError: name 'nothing'"),
        ("show own.py:deep", "own.py:20: IndexError"),
        ("show own.py:number_of_a_block", "own.py:28: float of Input('x')"),
        ("show own.py:wants", "own.py:wants: TypeError"),
        ("show own.py:number", "returns int, not a Scene"),
        ("show own.py", f"say which function or scene in it: write own.py:NAME; it defines {ALL}"),
        ("show own.py:scne", "there is no 'scne' in it"),
        ("show own.py:table", "table is a dict, no Scene"),
        ("sweep own.py:soft --axis k=1,2 --measure own.py:tops", "there is no 'tops' in it"),
        ("sweep own.py:soft --axis k=1,2 --measure own.py:tops", f"{LISTED}, top"),
        ("show syntax.py:f", "syntax.py:1: SyntaxError"),
        ("show absent.py:f", "absent.py:1: ModuleNotFoundError"),
        ("show zero.py:f", "zero.py:1: ZeroDivisionError"),
        ("show null.py:f", "null.py:"),
        ("show squeeze --import names/numpy.py", "give the file another name"),
        ("show squeeze --import odd.txt", "name one such as click_block.py"),
        ("show squeeze --import none.py", "cannot read"),
        # options of a rendering
        ("render squeeze --out a.wav", "no motion for x1, x2"),
        ("render squeeze --out a.wav --motion jump()", "minimum_jerk, sinusoid"),
        (f"{SQUEEZE} --set k", "NAME=VALUE"),
        (f"{SQUEEZE} --set k=two", "'two' is not a number"),
        (f"{SQUEEZE} --set q=2", "there are k, A, level"),
        (f"{SQUEEZE} --fs -1", "a finite number above 0"),
        (f"{SQUEEZE} --fs 2000", "give a smaller passband"),
        (f"{SQUEEZE} --seconds nan", "seconds = nan is not finite"),
        (f"{SQUEEZE} --picture b.xyz", "must end in one of .png"),
        (f"{SQUEEZE} --picture .", "is a folder"),
        (f"render own.py:broken --out a.wav {HAND}", "a.wav was not written; look for"),
        (f"render squeeze {LIFT} x=pos_mm*1e-3", "use squeeze(contact=True)"),
        (f"render bumps(duty=0.3) {LIFT} x=pos_mm*1e-3", "use bumps(contact=True)"),
        (f"render own.py:soft {LIFT} x=pos_mm*1e-3", 'give it an Input("contact")'),
        # several motions
        ("render squeeze --out a.wav --motion no.csv", "no.csv: cannot be read (No such file"),
        ("render squeeze --out a.wav --motion no.trc --map x=X1", "no.trc: cannot be read (No"),
        ("render pen.py:scene --out a.wav --motion pen.csv", "name the column of x, press"),
        (PEN_TO, "nothing is recorded for press"),
        (PEN_TO.replace("pen.csv", "x=pen.csv"), "no motion for press"),
        (f"{PEN_TO} --map press=force_N --motion press=still()", "press has a motion of its own"),
        (f"{PEN_TO} --map q=force_N", "--map q: the scene has no input q"),
        (f"{PEN_TO} --motion still()", "say of which each is"),
        (f"{SQUEEZE.replace(HAND, GRIPPED)} --map x=z", "are for a recording"),
        (f"{PEN_TO} --map press=force_N --max-speed y=1", "there is no --map 'y'"),
        (f"{PEN_TO} --map press=force_N --max-speed x=a", "'a' is not a number"),
        (f"{PEN_TO} --map press=force_N --max-speed 0.05", "x moves at 0.1 m/s"),
        ("render own.py:soft --out a.wav --motion tablet.csv --map x=x_mm*1e-3", 'such as time="'),
        # sweeping
        (SWEEP, "name the rows"),
        (f"{SWEEP} --axis k", "NAME=FROM:TO:HOW_MANY"),
        (f"{SWEEP} --axis k=1:2:0.5", "0.5, is how many"),
        (f"{SWEEP} --axis k=1:2:inf", "inf, is how many"),
        (f"{SWEEP} --axis seed=5..", "seed = 5.. in row 0"),
        (f"{SWEEP} --axis seed=1.5,2.5", "seed = 1.5 in row 0"),
        (f"{SWEEP} --axis seed={2**64 + 1}", "seed = 18446744073709551617 in row 0"),
        (f"{SWEEP} --axis k=10:100", "FROM:TO:HOW_MANY, such as k=10:100:5"),
        (f"{SWEEP} --axis q=1,2", "no column q"),
        (f"{SWEEP} --axis k=1,soft", "'1' must be a number"),
        (f"{SWEEP} --axis k=1,2 --measure loud", "no 'loud'"),
        (f"{SWEEP} --axis k=1,2 --report none/a.html", "the folder none is not there"),
        (f"{SWEEP} --axis k=1,2 --report grip.csv", "must end in one of .html, .htm"),
        # playing
        ("play squeeze --full-scale 50 --quiet", "no motion for x1, x2"),
        (f"{PLAY} --channels 1", "fewer than 2 outputs"),
        (f"{PLAY} --device a", "--device: is for --sink jack or portaudio or nidaq"),
        (f"{PLAY} --connect a", "--connect: is for --sink jack, not for null"),
        (f"{PLAY} --client a", "--client: is for --sink jack"),
        (f"{PLAY} --map x1=z", "--map and --where are for a recording"),
        (f"{PLAY} --sink jack --fast", "--fast: is for --sink null or portaudio"),
        (f"{PLAY} --set sink_gain=1", "no parameter 'sink_gain'"),
        (f"{PLAY} --seconds 0", "at least one sample"),
        (f"{PLAY} --seconds inf", "seconds = inf must be finite"),
        (f"play own.py:broken {HAND} --full-scale 1 --peak 1 --quiet", "this scene has none: y"),
        ("play tone --quiet --full-scale -1", "--full-scale = -1 must be"),
        ("play tone --quiet --set freq=-3", "--set('freq'): oscillator or carrier"),
        ("play tone --quiet --set freq=nan", "--set freq=nan: the value must be finite"),
        ("play tone --quiet --full-scale forc=1", "--full-scale: there is no output 'forc';"),
        (f"play tone --quiet {HAND}", "the scene has no input: leave it out"),
        (f"{PLAY} --motion x3=still()", "its inputs are x1, x2"),
        (f"{PLAY} --motion x1=a() --motion x1=b()", "x1=b(): x1 is given twice"),
        ("play squeeze --quiet --motion minimum_jerk(depht=1)", "there is no argument 'depht'"),
        (f"play own.py:two {HAND} --fast --full-scale 2", "--full-scale force=..,place=.."),
        (f"play own.py:two {HAND} --fast --full-scale force=50", "no value for place; give"),
        (f"play own.py:two {HAND} --fast --full-scale force=50,place", "write OUTPUT=NUMBER"),
        (f"render own.py:two {HAND} --out a.wav --full-scale 2", "--full-scale force=..,place=.."),
        ("play none.wav --full-scale 1", "none.wav: No such file"),
        ("play text.wav --full-scale 1", "is damaged, truncated or no sound file"),
        # files and sessions
        ("replay none.stimlog", "there is no log none.stimlog"),
        ("replay LOG/session.json", "session.json is no log"),
        ("replay LOG --out a.flac", "must end in one of .wav, .rf64, .w64, .caf"),
        ("play LOG --full-scale 1", "no scene"),
        ("verify --log none.stimlog", "there is no log none.stimlog"),
        ("verify squeeze --log LOG", "is a session of another scene"),
        ("verify --log LOG --wav a.wav", "give --log without --wav and --motion"),
        ("verify --log LOG --motion minimum_jerk()", "give --log without --wav and --motion"),
        ("verify --log LOG --map x=y", "give --log without --wav and --motion"),
        ("verify", "name what to verify: FILE.wav"),
        ("verify squeeze", "name what to verify: FILE.wav"),
        ("verify p.stimlog", "stimlib verify --log p.stimlog"),
        ("verify squeeze --wav p.stimlog", "stimlib verify --log p.stimlog"),
        ("verify a.png", "a.png is not a sound file"),
        ("verify --wav a.wav --json", "there is no file a.wav"),
        ("verify a.wav --wav b.wav", "a.wav and b.wav are two files"),
        ("convert tone b.xyz", "the suffix is not known"),
    ],
    ids=lambda v: v[:60] if isinstance(v, str) else "odd",
)  # fmt: skip
def test_a_mistake_gets_one_line_and_leaves_nothing(here, log, words, says):
    words = words.replace("LOG", str(log)).split() if isinstance(words, str) else words
    refuses(words, says, prog_name="stimlib")
    assert {p.name for p in here.iterdir()} - {"__pycache__"} == THERE
    assert sys.modules["numpy"] is np


@pytest.mark.filterwarnings("ignore:touch_screen. at the top of a bump")
@pytest.mark.parametrize("make", stimlib.scenes.SHIPPED.values())
def test_any_argument_of_a_shipped_scene_is_a_scene_or_an_error_of_ours(make):
    odd = None, True, "a", -1, 0, 1e308, 10**400, [], [[1]], {"a": 1}, 1j, np.nan
    for name, value in itertools.product(inspect.signature(make).parameters, odd):
        try:
            assert make(**{name: value}).outputs
        except stimlib.StimlibError as e:
            assert str(e)


# Starts, streams and signals ----------------------------------------------------------
@pytest.mark.parametrize(
    ("words", "at_once"),
    [
        ("show squeeze", ""), ("list", "1"), ("list --help", "1"),
        ("--version", "1"), ("--version", ""),
    ],
)  # fmt: skip
def test_a_reader_that_goes_away_is_no_defect(words, at_once):
    """In the middle of a table, and at the end, when a short text leaves."""
    whole = [sys.executable, "-m", "stimlib", *words.split()]
    env = os.environ | {"PYTHONUNBUFFERED": at_once}
    with subprocess.Popen(whole, stdout=-1, stderr=-1, text=True, env=env) as job:
        job.stdout.close()
        said = job.stderr.read()
    assert job.wait() == 141 and said == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize(
    ("words", "streams", "status", "says"),
    [
        ("replay LOG --out a.wav", "<&- >&-", 0, ""),
        ("show missing.json", "2>/dev/full", 2, ""),
        ("list --json", ">/dev/full", 2, "error: cannot write what is printed: No space left"),
        ("replay LOG --out é.wav --json", "| cat >/dev/null", 0, ""),
        ("show wall --draw a.svg", "", 0, ""),
    ],
)
def test_streams_that_are_closed_full_or_ascii(tmp_path, log, words, streams, status, says):
    command = f"{sys.executable} -m stimlib {words.replace('LOG', str(log))} {streams}"
    env = os.environ | {"PYTHONIOENCODING": "ascii", "COLUMNS": "0"}
    # and a backend for pictures that this environment does not have
    env["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
    how = {"shell": True, "capture_output": True, "text": True, "cwd": tmp_path, "env": env}
    done = subprocess.run(command, **how)
    assert done.returncode == status, done.stderr
    assert done.stderr.startswith(says) and bool(says) == bool(done.stderr)


STARTS = """
import os, signal, sys
class Finder:
    def find_spec(self, name, *rest):
        if name == "typer":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
from stimlib.__main__ import main
main()
"""


def test_ctrl_c_while_it_starts_is_quiet():
    done = subprocess.run([sys.executable, "-c", STARTS], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def ended(words, grows, size, what):
    """Run a command in a process of its own, send it a signal when this file of it has
    grown to the size; its status and what it printed.
    """
    whole = [sys.executable, "-m", "stimlib", *words.split()]
    with subprocess.Popen(whole, stdout=-1, stderr=-1, text=True) as job:
        while not any(p.stat().st_size > size for p in grows.parent.glob(grows.name)):
            assert job.poll() is None, job.stderr.read()
            time.sleep(0.02)
        job.send_signal(what)
        return (job.wait(60), *job.communicate())


def test_a_file_that_is_named_like_an_option_stays_a_file():
    told = [_of_options(text, ["log", "out"]) for text in ("log/a.wav: gone", "log = 3")]
    assert told == ["log/a.wav: gone", "--log = 3"]


def test_ctrl_c_in_the_middle_leaves_nothing(tmp_path):
    words = f"render squeeze {HAND} --seconds 10000 --out {tmp_path}/long.rf64"
    code, _, said = ended(words, tmp_path / "long.rf64.*.part", 1_000_000, signal.SIGINT)
    assert code == 130 and "nothing was left behind" in said
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("what", "wanted"),
    [
        (signal.SIGINT, 130),
        pytest.param(signal.SIGTERM, 143, marks=pytest.mark.stress),
        pytest.param(signal.SIGHUP, 129, marks=pytest.mark.stress),
    ],
)
def test_play_fades_out_when_it_is_told_to_end(tmp_path, what, wanted):
    log = tmp_path / "a.stimlog"
    words = (
        f"play squeeze --sink null --motion sinusoid(0.005,1,mean=0.01) --full-scale 50 --log {log}"
    )
    code, out, err = ended(words, log / "motion.f64", 4000 * 16, what)
    assert (code, "Traceback" in err) == (wanted, False), err
    assert "samples," in out and f"log: {log}" in out
    told = stimlib.files.read_log(log)
    assert stimlib.files.replay(told).matches and told.report["produced"] == told.frames
    last = [frames for _, frames, _ in stimlib.files.log_replay.delivered(told)][-1]
    assert not np.abs(last[-1]).max() > 0.01, "faded out"


@pytest.mark.parametrize(
    ("typed", "offered"), [("stimlib rend", "render render-set"), ("stimlib show sq", "squeeze")]
)
def test_the_shell_completes_commands_and_scenes(typed, offered):
    words = {"_STIMLIB_COMPLETE": "complete_bash", "COMP_WORDS": typed}
    words["COMP_CWORD"] = str(typed.count(" "))
    assert ran([], prog_name="stimlib", env=words).stdout.split() == offered.split()


def test_no_words_show_the_help_and_the_version_is_an_option():
    assert "--install-completion" in ran([], 2).stdout
    assert ran("--version").stdout == f"stimlib {stimlib.__version__}\n"


# Rendering, showing and their JSON ----------------------------------------------------
def test_render_writes_and_draws_what_the_library_renders(tmp_path):
    out, drawn = tmp_path / "a.wav", tmp_path / "a.png"
    words = f"render squeeze {HAND} --motion x2=sinusoid(0.001,5) --seconds 0.5 --fs 4000"
    more = f"--full-scale 20 --subtype DOUBLE --picture {drawn}"
    done = ran(f"{words} --out {out} --set k=1000 --seed 3 --quiet {more}")
    y, sidecar = file.read(out)
    motion = {"x1": minimum_jerk(depth=0.01), "x2": sinusoid(0.001, 5.0)}
    wanted = stimlib.render(stimlib.scenes.squeeze(), motion, 4000, 0.5, {"k": 1000.0}, seed=3)
    np.testing.assert_allclose(y, wanted.y, rtol=1e-15)
    assert done.output == ""
    assert sidecar["params"]["k"] == 1000.0 and sidecar["seed"] == 3
    assert drawn.read_bytes().startswith(b"\x89PNG")


def test_show_tells_a_scene_and_draws_and_saves_it(tmp_path):
    done = ran(f"show squeeze --draw {tmp_path}/g.svg --save {tmp_path}/s.json")
    assert "felt:  An elastic object vibrates while" in done.output and "White(" not in done.output
    assert "law:   F = k x + A level (k tau v)(tau dp/dt) while" in done.output
    done = ran("show squeeze --plan")
    assert "enabled 1  White(0, 1" in done.output and "removed:" in done.output
    assert "<svg" in (tmp_path / "g.svg").read_text("utf-8")
    assert stimlib.load(tmp_path / "s.json").hash == stimlib.scenes.squeeze().hash


@pytest.mark.parametrize("scene", [*stimlib.scenes.SHIPPED, "squeeze(fingers=1)"])
def test_the_command_that_show_names_plays_the_scene(scene):
    (command,) = [
        line.strip()
        for line in ran(["show", scene]).stdout.splitlines()
        if line.strip().startswith("stimlib play")
    ]
    words = [*shlex.split(command)[1:-1], "0.2", "--sink", "null", "--fast"]
    assert ran(words).stdout.endswith("played 0.2 s, nothing lost\n")


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_a_line_for_each_sentence_and_an_example_that_is_parsed(name):
    known, shown = COMMANDS[name], 0
    for paragraph in known.help.split("\n\n"):
        assert "\n" not in paragraph
        words = paragraph.removeprefix("[bold]").removesuffix("[/]")
        if words != paragraph and words.startswith(f"stimlib {name}"):
            assert len(words) <= 78, words
            assert known.make_context(name, shlex.split(words)[1 + len(name.split()) :])
            shown += 1
    assert shown


def data_of(words, code=0):
    done = ran(f"{words} --json", code)
    assert done.stderr == "", done.output
    return json.loads(done.stdout, parse_constant=lambda text: pytest.fail(f"{text} is no JSON"))


def test_json_says_what_the_words_say():
    listed, squeeze = data_of("list"), stimlib.scenes.squeeze()
    assert listed["motions"]["minimum_jerk"]["arguments"]["depth"] == 0.02
    assert listed["scenes"]["squeeze"]["hash"] == squeeze.hash
    assert listed["scenes"]["squeeze"]["params"]["k"] == {"value": 2000.0, "unit": "N/m"}
    shown = data_of("show squeeze --fs 4000")
    plan = stimlib.compile(squeeze, 4000, "python").plan
    assert (shown["hash"], shown["fs"], shown["removed"]) == (squeeze.hash, 4000, plan.removed)
    rows = [(row["number"], row["block"]) for row in shown["plan"]]
    assert rows == [row[:3:2] for row in plan.rows]
    ready = {"sink": "null", "ready": True, "how": "--sink null", "fs": None}
    assert data_of("devices --server none_of_this_name")[0].items() >= ready.items()


def test_json_of_a_file_and_of_its_verification(tmp_path):
    out, scene = tmp_path / "a.wav", "squeeze(fingers=1)"
    told = data_of(f"render {scene} {HAND} --seconds 0.5 --out {out} --full-scale 50")
    y, sidecar = file.read(out)
    assert (told["path"], told["sidecar"]) == (str(out), f"{out}.json")
    assert told["clips"] == {"force1": sidecar["channels"][0]["clips"]} and told["frames"] == 4000
    assert told["peak"]["force1"] == sidecar["channels"][0]["peak"] and y.shape[1] == 4000
    sidecar["channels"][0]["peak"] += 1
    out.with_suffix(".wav.json").write_text(json.dumps(sidecar))
    told = data_of(f"verify {scene} --wav {out}", code=1)
    failed = [c["name"] for c in told["checks"] if not c["passed"]]
    assert failed == ["sidecar: what it says"] and not told["passed"]
    assert told["source"] == "a.wav" and told["seconds"] == 0.5 and len(told["checks"]) > 10


def test_render_tells_once_of_millimetres_taken_for_metres(here):
    words = "render own.py:ready --motion minimum_jerk(depth=20) --seconds 0.2 --quiet"
    done = ran(f"{words} --out a.wav --picture a.png")
    assert done.stderr.count("faster than a hand (1 m/s)") == 1


@pytest.mark.parametrize(
    ("name", "full_scale", "says"),
    [
        ("a.flac", "1e7", "0.0001 % of full scale, and the file has steps of 1.2: write it with"),
        ("a.flac", "1001", "a full scale of about 10.1"),
        ("a.flac", "999", ""),
        ("a.wav", "1e7", ""),
        ("a.flac --subtype PCM_16", "1e7", "steps of 3.1e+02: write it with"),
        ("a.wav --subtype pcm_16", "1e7", "steps of 3.1e+02: write it with"),
    ],
)
def test_render_says_where_full_scale_is_far_too_large(here, name, full_scale, says):
    words = "render own.py:soft --motion constant_speed(0.2,0.02) --seconds 0.2"
    done = ran(f"{words} --out {name} --full-scale {full_scale}", says=says)
    assert done.stderr.startswith("note: ") == bool(says) == bool(done.stderr)


# Motions ------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("name", "motion"),
    [
        ("a.wav", HAND),
        ("a.flac", "--motion grip.csv --map x=force_N*5e-4 --max-speed 2"),
    ],
)
def test_a_file_tells_how_to_verify_it(here, name, motion):
    words = "--seconds 0.1 --full-scale 64 --set k=1500 --seed 4 --quiet"
    ran(f"render squeeze(fingers=1) {motion} {words} --out {name}")
    done = ran(f"verify {name}")
    assert "--scene" not in done.stdout and "mine.py:scene" in done.stdout, done.output
    ran(f"verify squeeze(fingers=2) --wav {name}", 2, "was rendered from another scene")
    ran(f"verify {name} --set k=1500")
    ran(f"verify {name} --set k=1400", 1)
    if "grip" in motion:
        text = "recording('grip.csv',{'x':'force_N*5e-4'},max_speed=2)"  # as the sidecar has it
        ran(f"verify {name} --motion x1={text}.motion['x']")
        ran(f"verify {name} --motion {text}")
        (here / "grip.csv").write_text(GRIP + "0.048,20,4\n")
        ran(f"verify {name}", 2, f"error: {name}: motion of x1: grip.csv: SHA-256 is ")
        ran(f"verify {name} {motion}", 1)  # the motion of this name is another now
        (here / "grip.csv").unlink()
        ran(f"verify {name}", 2, "or give the motion (--motion), as it was rendered")


def test_a_motion_that_its_text_does_not_tell(here):
    ran(f"render squeeze(fingers=1) {HAND} --seconds 0.1 --quiet --out a.wav")
    sidecar = json.loads(Path("a.wav.json").read_text())
    for told, says in {
        "<function <lambda>>": "cannot be made again from",
        "log of 9": "--log",
        "recording('grip.csv', {'x': 'x_mm*1e-3'}).motion['x']": "does not have the SHA-256",
        "recording(": "--motion",
        "recording(open('grip.csv'), {}).contact": "--motion",
        "recording('grip.csv', {'x': 'x_mm'}, y=1)": "--motion",
    }.items():
        Path("a.wav.json").write_text(json.dumps(sidecar | {"motion": {"x1": told}}))
        ran("verify a.wav", 2, says)
    ran(f"verify a.wav {HAND}")


HELD = "--motion press=sinusoid(0.5,1,mean=1)"
MAP_X, MAP_PRESS = "--map x=pos_mm*1e-3", "--map press=force_N"


def rendered(*motion, scene="scene"):
    """What the sidecar tells of the motion of a rendering with a pen."""
    ran(f"render pen.py:{scene} {' '.join(motion)} --out a.wav --full-scale 100")
    return json.loads(Path("a.wav.json").read_text())["motion"]


@pytest.mark.parametrize("recorded", ["pen.csv", "x=pen.csv", "pen(1).trc"])
def test_a_recording_goes_with_a_generator_in_either_order(here, recorded):
    told = rendered("--motion", recorded, MAP_X, HELD)
    assert told == rendered(HELD, "--motion", recorded, MAP_X)
    file = recorded.removeprefix("x=")
    assert told["x"].startswith(f"recording('{file}', {{'x': 'pos_mm*1e-3'}}")
    assert told["press"].startswith("sinusoid(amplitude=0.5")


def test_the_own_motion_of_an_input_goes_before_that_of_its_group(here):
    first, both = "--motion x1=sinusoid(0.01,1)", "--motion x=sinusoid(0.001,5)"
    for words in (f"{first} {both}", f"{both} {first}"):
        ran(f"render squeeze {words} --seconds 0.1 --full-scale 50 --out a.wav")
        told = json.loads(Path("a.wav.json").read_text())["motion"]
        assert [told[x].partition(",")[0][-5:] for x in ("x1", "x2")] == ["=0.01", "0.001"]


def test_two_recordings_and_the_contact_of_one(here):
    both = f"--motion x=lift.csv {MAP_X} --motion press=pen.csv {MAP_PRESS}"
    says = "say which serves, such as --motion contact=my.csv"
    ran(f"render pen.py:contact {both} --out a.wav --full-scale 100", 2, says)
    told = rendered(both, "--motion contact=lift.csv", scene="contact")
    assert told["contact"].startswith("recording('lift.csv'")
    assert told["contact"].endswith(".contact") and "'force_N'}" in told["press"]
    told = rendered("--motion x=lift.csv", MAP_X, HELD, scene="contact")
    assert told["contact"].endswith(".contact")


def test_only_metres_are_held_to_the_speed_of_a_hand(here):
    words = f"--motion pen.csv {MAP_X} {MAP_PRESS}"
    assert "max_speed={'x': 1.0}" in rendered(words)["x"]  # force_N rises by 500 N/s
    assert "max_speed={'press': 1000.0}" in rendered(words, "--max-speed press=1000")["x"]


def test_a_tablet_in_milliseconds_and_equal_times(here):
    words = "render own.py:soft --motion tablet.csv --map x=x_mm*1e-3 --out a.wav --subtype DOUBLE"
    ran(f"{words} --time t_ms", 2, 'choose repeats="spread"')
    ran(f"{words} --time t_ms --repeats last", 2, 'time in ms? write time="t_ms*1e-3"')
    how = "--time t_ms*1e-3 --repeats spread --max-gap 0.1 --max-speed 2 --reports on_change"
    ran(f"{words} {how}")
    y, sidecar = file.read("a.wav")
    assert y[0, [0, 64, 96]] == pytest.approx([0.5, 0.75, 1.0], rel=1e-9)
    words = "time='t_ms*1e-3' repeats='spread' max_gap=0.1 max_speed=2.0 reports='on_change'"
    assert all(word in sidecar["motion"]["x"] for word in words.split())


# Sessions -----------------------------------------------------------------------------
def test_a_session_is_replayed_and_verified(tmp_path, monkeypatch, log):
    done = ran(["replay", log, "--out", tmp_path / "a.wav"])
    assert done.output == "4000 frames replayed, 0 lost; 2 of 2 hashes match\n"
    assert file.read(tmp_path / "a.wav")[0].shape == (2, 4000)
    monkeypatch.setattr(sys, "argv", "stimlib verify --log a.stimlog".split())
    done = ran(f"verify squeeze(fingers=1) --log {log} --report {tmp_path}/a.html")
    assert "log: delivered = replay" in done.output
    page = (tmp_path / "a.html").read_text("utf-8")
    assert "passed" in page and "stimlib verify --log a.stimlog" in page
    wrong = shutil.copytree(log, tmp_path / "wrong.stimlog") / "motion.f64"
    data = bytearray(wrong.read_bytes())
    data[8 * 2500 + 6] ^= 1
    wrong.write_bytes(data)
    done = ran(f"replay {wrong.parent}", 1)
    assert "1 of 2 hashes match, the first that does not is of frames 2000 to 4000" in done.output
    told = data_of(f"replay {wrong.parent}", code=1)
    assert not told["matches"] and told["wrong"] == [[2000, 4000]] and told["spans"] == 2
    assert "FAILED" in ran(f"verify --log {wrong.parent}", 1).output


# Blocks of the user's own -------------------------------------------------------------
CLICK = """
from dataclasses import dataclass
from stimlib import Block, Input, Scene

GAIN = 3.0

@dataclass(frozen=True, eq=False)
class Click(Block):
    x: Block

    @staticmethod
    def step(p, s, x):
        return GAIN * x, s

def scene():
    return Scene({"f": Click(Input("x", "m"))})
"""


@pytest.fixture(scope="module")
def clicks(tmp_path_factory):
    """A block in a file of its own, and what was made of it: a scene, a sound file, a
    log.
    """
    folder = tmp_path_factory.mktemp("clicks")
    (folder / "click_block.py").write_text(CLICK)
    own, hand = f"{folder}/click_block.py:scene", f"{HAND} --seconds 0.2 --quiet"
    ran(f"show {own} --save {folder}/click.json")
    ran(f"render {own} {hand} --out {folder}/click.wav")
    ran(f"play {own} {hand} --full-scale 1 --fast --log {folder}/click.stimlog")
    return folder


def forget():
    """As in a process of its own, that has not run the file of this module."""
    registry.pop("click_block.Click", None)
    sys.modules.pop("click_block", None)
    _ours.pop("click_block", None)


@pytest.mark.parametrize(
    "words",
    [
        "replay click.stimlog",
        "verify click.json --wav click.wav",
        "show click.json",
        f"render click.json {HAND} --seconds 0.2 --out again.wav",
        f"play click.json {HAND} --seconds 0.2 --full-scale 1 --fast",
    ],
)
def test_own_blocks_are_known_by_import(clicks, monkeypatch, words):
    monkeypatch.chdir(clicks)
    forget()
    ran(words, 2, "import click_block first; on the command line, add --import click_block.py")
    forget()
    ran(f"{words} --import click_block.py")
    forget()
    ran("verify click_block.py:scene --log click.stimlog")  # loaded before the log


@pytest.mark.parametrize("words", ["replay click.stimlog", "verify click.json --wav click.wav"])
def test_what_defined_an_own_block_is_kept_and_compared(clicks, tmp_path, monkeypatch, words):
    monkeypatch.chdir(clicks)
    for name in ("click.stimlog/session.json", "click.wav.json"):
        assert json.loads(Path(name).read_text())["definitions"]["click_block"]["text"] == CLICK
    for edit in ("# another day\n", "GAIN = 2.0\n"):
        (tmp_path / "click_block.py").write_text(CLICK + edit)
        done = ran(f"{words} --import {tmp_path}/click_block.py", int("GAIN" in edit))
        assert "own blocks of click_block:" in done.stdout
    assert "own blocks" not in ran(f"{words} --import click_block.py").stdout


def test_a_definition_is_what_ran_with_what_it_derives_from(tmp_path, monkeypatch):
    """Not what its file became since, as in a notebook that imported it before."""
    base = "from stimlib import Block\n\nclass Base(Block, abstract=True):\n    pass\n"
    own = CLICK.replace("Block, Input", "Input").replace(
        "GAIN", "from bases_here import Base\nGAIN", 1
    )
    own = own.replace("Click(Block)", "Click(Base)").replace("x: Block", 'x: "Block"')
    (tmp_path / "bases_here.py").write_text(base)
    (tmp_path / "twice_here.py").write_text(own)
    monkeypatch.syspath_prepend(str(tmp_path))
    import twice_here

    for name in ("twice_here.py", "bases_here.py"):
        (tmp_path / name).write_text("# another\n")
    found = {module: d["text"] for module, d in definitions(twice_here.scene()).items()}
    assert found == {"bases_here": base, "twice_here": own}


def test_a_definition_has_its_hash(clicks, tmp_path):
    """Whoever changes both is told from today's file only."""
    path = shutil.copytree(clicks / "click.stimlog", tmp_path / "a.stimlog") / "session.json"
    told = json.loads(path.read_text())

    def replayed(code, definitions):
        path.write_text(json.dumps(told | {"definitions": definitions}))
        return ran(["replay", path.parent, "--import", clicks / "click_block.py"], code)

    ours = told["definitions"]["click_block"]
    for now in ({"text": "x = 1"}, {"sha256": "0" * 64}, {"text": "\ud800"}, {"text": 1}):
        assert "definitions" in replayed(2, {"click_block": ours | now}).stderr
    assert "definitions" in replayed(2, {}).stderr
    both = {"text": "x = 1", "sha256": hashlib.sha256(b"x = 1").hexdigest()}
    assert "is not the one that was recorded" in replayed(0, {"click_block": ours | both}).stdout


def test_a_file_that_two_options_name_is_run_once(here):
    text = f"print('ran')\n{OWN}"
    (here / "run_once.py").write_text(text)
    words = f"sweep run_once.py:soft --measure run_once.py:top {HAND} --seconds 0.1"
    assert ran(f"{words} --axis seed=1,2 --dry").stdout.count("ran") == 1
    (here / "run_once.py").write_text(text.replace("'ran'", "'ran again'"))
    assert ran("show run_once.py:soft").stdout.count("ran again") == 1


# Devices ------------------------------------------------------------------------------
def test_play_leaves_a_log_that_replays(tmp_path):
    log = tmp_path / "a.stimlog"
    words = f"{PLAY} --fast --seconds 0.5 --set k=1500 --seed 4 --channels 3 --log {log}"
    words = words.replace("--quiet ", "")
    done = ran(f"{words} --peak 40 --static 30 --slew 1e6 --passivity bound=9,damping=2")
    assert "force1 gave at most 0 mJ" in done.stdout, "what it takes it does not give"
    assert "4000 samples, 4000 delivered, 0 lost" in done.stdout and f"log: {log}" in done.stdout
    told = json.loads((log / "session.json").read_text())
    assert told["params"] == {"k": 1500.0} and told["seed"] == 4
    assert told["channels"] == ["force1", "force2", None]
    limits = told["safety"]["peak"], told["safety"]["static"], told["safety"]["slew"]
    assert limits == (40.0, 30.0, 1e6) and told["safety"]["passivity"]["damping"] == 2.0
    ran(f"verify squeeze --log {log}")


def test_a_sound_file_is_played_at_its_rate(tmp_path):
    y = 0.3 * np.random.default_rng(1).uniform(-1, 1, (2, 441))
    path, log = tmp_path / "vib.wav", tmp_path / "a.stimlog"
    soundfile.write(path, y.T, 44100, subtype="PCM_16")
    done = ran(f"play {path} --full-scale 2 --fast --log {log}")
    assert "441 samples" in done.stdout, done.output
    ran(f"replay {log} --out {tmp_path}/b.wav")
    heard, sidecar = file.read(tmp_path / "b.wav")
    names = [c["name"] for c in sidecar["channels"]]
    assert sidecar["fs"] == 44100 and names == ["channel1", "channel2"]
    assert np.array_equal(heard, 2 * np.float32(soundfile.read(path)[0].T / 2))
    steady = stimlib.Scene({"force": stimlib.constant(2.0, "N")})
    stimlib.render(steady, fs=1000, seconds=0.1).save(path, full_scale=4.0)
    done = ran(f"play {path} --full-scale 1 --peak 1 --fast")
    assert "100 samples limited (peak)" in done.stdout, "with a sidecar it is in N"
    refuses(f"play {path} --full-scale 1 --fs 8000", "is played at that: leave out --fs")
    refuses(f"play {path} --full-scale 1 {HAND}", "has no inputs: leave out --motion")


def test_outputs_of_different_units_have_a_full_scale_each(here):
    how = f"{HAND} --seconds 0.1 --full-scale force=50,place=0.1"
    done = ran(f"play own.py:two {how} --fast --slew force=1e6")
    assert "800 samples" in done.stdout, done.output
    ran(f"render own.py:two {how} --out a.wav")
    assert [c["full_scale"] for c in file.read("a.wav")[1]["channels"]] == [50.0, 0.1]


def test_play_says_that_an_output_failed(here):
    words = "play own.py:broken --motion minimum_jerk() --full-scale 1 --fast --seconds 2"
    done = ran(words, 1, "output y was not finite at sample 0")
    assert "output y failed at sample 0" in done.stdout


def test_devices_says_what_there_is_and_how_to_get_the_rest():
    lines = ran("devices --server stimlib_none").stdout.splitlines()
    assert lines[0].split() == "ready null no device: nothing is heard or felt: --sink null".split()
    (jack,) = [line for line in lines if line.split()[1] == "jack"]
    assert jack.startswith("missing") and ("such as jackd" in jack or "apt-get install" in jack)
    assert any(line.split()[1] == "portaudio" for line in lines)


def test_what_is_asked_of_a_server_reaches_it(monkeypatch):
    asked = {}

    def compare(scene, safety, fs, seconds, **options):
        asked.update(options, fs=fs, seconds=seconds, full_scale=safety.full_scale)
        return SimpleNamespace(passed=True)

    monkeypatch.setattr(available, "devices", lambda server=None: asked.update(looked=server) or [])
    monkeypatch.setattr(jack_loopback, "loopback", compare)
    ran("devices --server lab")
    words = f"loopback squeeze(fingers=1) {HAND} --full-scale 50 --seconds 2 --fs 4000 --device lab"
    more = "--channels 3 --tolerance 0.2 --set k=1000 --seed 7 --log a.stimlog"
    ran(f"{words} --connect none --capture in_1 {more}")
    assert asked.pop("motion").keys() == {"x1"} and asked == {
        "looked": "lab",
        "server": "lab",
        "fs": 4000.0,
        "seconds": 2.0,
        "full_scale": 50.0,
        "connect": None,
        "capture": ["in_1"],
        "channels": 3,
        "tolerance": 0.2,
        "params": {"k": 1000.0},
        "seed": 7,
        "log": Path("a.stimlog"),
    }


@needs_jack
def test_play_and_loopback_on_a_server(monkeypatch):
    from stimlib.devices.jack import JackSink

    with Jackd(8000, 64) as server:
        told = ran(f"devices --server {server.name}").stdout
        assert "a server at 8000 Hz, blocks of 64" in told and "--sink jack --fs 8000" in told
        words = f"squeeze {HAND} --full-scale 50 --sink jack --device {server.name} --seconds 0.5"
        assert "4000 samples" in ran(f"play {words} --connect none").stdout
        monkeypatch.setenv("JACK_DEFAULT_SERVER", server.name)
        first = "play tone --seconds 0.2 --connect none"
        done = ran(first, says="20 dB below full scale: --full-scale 1")  # the server's sink and fs
        assert "1600 samples" in done.stdout, done.output
        assert done.stderr.startswith("jack: a server at 8000 Hz"), done.stderr
        assert "20 dB" not in ran(f"{first} --full-scale 2").stderr
        level = stimlib.Scene({"y": stimlib.constant(1.0)})
        with JackSink(level, 1.0, server=server.name, realtime=False) as other:
            other.open(8000)
            ran(f"play {words}", 2, "has a client 'stimlib' already")
            assert "4000 samples" in ran(f"play {words} --client another").stdout
        assert "all equal the offline render" in ran(f"loopback {words}").stdout
        one = f"loopback {words} --capture system:capture_1"
        done = ran(f"{one} --capture system:capture_2", 1)  # where it is silent
        assert "nothing could be compared" in done.stdout, done.output
        ran(one, 2, "capture names 1 port for 2 channels")


# The demo -----------------------------------------------------------------------------
@pytest.mark.parametrize(("passed", "status"), [(True, 0), (False, 1)])
def test_demo_tells_what_each_file_is_and_fails_with_its_proofs(
    tmp_path, monkeypatch, passed, status
):
    def made(folder, s):
        return demo.Shown("squeeze", passed, [(folder / "[b]squeeze.wav", "a spring", "the force")])

    monkeypatch.setattr(demo, "STIMULI", demo.STIMULI[:1])
    monkeypatch.setattr(demo, "show", made)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "file").touch()
    done = ran("demo new/folder", status, f"squeeze: {'passed' if passed else 'FAILED'}")
    assert "new/folder/[b]squeeze.wav" in done.stdout and "a spring" in done.stdout
    assert (tmp_path / "new" / "folder").is_dir() and "the first time also" in done.stderr
    ran("demo new/file", 2, "cannot make the folder")


def test_demo_writes_each_file_with_its_full_scale(tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "SECONDS", 0.1)
    s = demo.STIMULI[1]
    made = demo.show(tmp_path, s)
    begins = [path.read_bytes()[:4] for path, *_ in made.files]
    assert made.passed and begins == [b"RIFF", b"RIFF", b"\x89PNG", b"<!do"]
    assert [c["full_scale"] for c in told_by(made.files[0][0])["channels"]] == [s.full_scale]


@pytest.mark.parametrize("s", demo.STIMULI, ids=lambda s: s.make.__name__)
def test_demo_stays_within_full_scale_and_vibrates(s):
    y = stimlib.render(s.make(), s.motion, demo.FS, demo.SECONDS)
    assert 0.5 * s.full_scale < np.abs(y.y).max() <= s.full_scale
    assert np.abs(vibration(y[s.output], demo.FS)).max() > 1e-3 * np.abs(y.y).max()
    # as stimlib verify reads it from the sidecar
    motion = {n: parse_motion(repr(m)) for n, m in s.motion.items()}
    let_go = np.arange(4.5, demo.SECONDS, 1 / demo.FS)
    assert motion == s.motion and len({m(let_go).tobytes() for m in motion.values()}) == len(motion)


def test_pages_of_a_sweep_and_of_mutations_say_their_result_first(tmp_path):
    wall = f"wall --motion sinusoid(0.002,5) --seconds 0.1 --report {tmp_path}"
    said = ran(f"sweep {wall}/sweep.html --axis k=500:3000:3 --axis b=0,10").stdout
    assert "6 rows over k (3), b (2), 0 failed" in said and "nothing is kept: --out" in said
    page = (tmp_path / "sweep.html").read_text("utf-8")
    assert "<h1>wall: 6 rows over k (3), b (2), 0 failed</h1>" in page and page.count("<svg") == 1
    for text in ("k / N/m", "b / N·s/m", "rms_force / N"):
        assert text in page
    ran(f"mutate {wall}/mutate.html")
    page = (tmp_path / "mutate.html").read_text("utf-8")
    assert "<h1>Passed: changed numbers of wall</h1><p>23 refused, 2 equal samples" in page
    assert "<td>argument k</td><td>1000</td><td>1.01 times, 1.25 times, 0, 1</td>" in page
