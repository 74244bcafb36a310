"""The command line as a person uses it: real files, real processes."""

import hashlib
import inspect
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
import soundfile
from commands import ran
from devices.servers import Jackd, needs_jack

import stimlib
from stimlib import cli, demo
from stimlib.analysis import overview
from stimlib.analysis.listening import vibration
from stimlib.cli import app
from stimlib.cli.scene import _ours, scene_of
from stimlib.core.definitions import definitions
from stimlib.core.graph import registry
from stimlib.devices import available, loopback_test
from stimlib.files import audio as file
from stimlib.files.sidecar import told
from stimlib.motion.generators import minimum_jerk, sinusoid
from stimlib.motion.text import parse_motion

OWN = """
from stimlib import Input, Param, Scene
def soft():
    return Scene({"force": Param("k", 500.0, "N/m") * Input("x", "m")})
def two():
    x = Input("x", "m")
    return Scene({"force": Param("k", 500.0, "N/m") * x, "place": 1 * x})
def broken():
    return Scene({"y": 1.0 / Input("x", "m")})
def number():
    return 3
"""


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(OWN)
    return path


def test_render_writes_and_draws_what_the_library_renders(tmp_path, monkeypatch):
    out, drawn = tmp_path / "a.wav", []
    monkeypatch.setattr(
        overview, "picture", lambda rendering, path: drawn.append((rendering.y.tobytes(), path))
    )
    words = [
        "render",
        "squeeze",
        "--motion",
        "minimum_jerk(depth=0.01)",
        "--motion",
        "x2=sinusoid(0.001, 5)",
    ]
    ran(
        [
            *words,
            "--seconds",
            "0.5",
            "--fs",
            "4000",
            "--out",
            str(out),
            "--set",
            "k=1000",
            "--seed",
            "3",
            "--subtype",
            "DOUBLE",
        ]
        + ["--picture", str(tmp_path / "a.png")]
    )
    y, sidecar = file.read(out)
    motion = {"x1": minimum_jerk(depth=0.01), "x2": sinusoid(0.001, 5.0)}
    wanted = stimlib.render(stimlib.scenes.squeeze(), motion, 4000, 0.5, {"k": 1000.0}, seed=3)
    assert y.tobytes() == wanted.y.tobytes() and drawn == [(y.tobytes(), tmp_path / "a.png")]
    assert sidecar["params"]["k"] == 1000.0 and sidecar["seed"] == 3


def test_render_draws_a_picture(tmp_path):
    words = ["render", "squeeze", "--motion", "minimum_jerk()", "--seconds", "0.5", "--quiet"]
    done = ran(
        [
            *words,
            "--out",
            str(tmp_path / "a.flac"),
            "--full-scale",
            "100",
            "--picture",
            str(tmp_path / "a.png"),
        ]
    )
    assert done.output == ""
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_a_picture_that_cannot_be_is_refused_before_the_render(tmp_path):
    words = [
        "render",
        "squeeze",
        "--motion",
        "minimum_jerk()",
        "--seconds",
        "0.5",
        "--out",
        str(tmp_path / "a.wav"),
    ]
    for wrong, says in (("b.xyz", "must end in one of .png, .svg, .pdf"), (".", "is a folder")):
        done = ran([*words, "--picture", str(tmp_path / wrong)], 2, says)
        assert not os.listdir(tmp_path), done.output


@pytest.mark.parametrize("source", ["own.py:soft", "saved.json"])
def test_scene_from_own_code_and_from_a_file(own, tmp_path, source):
    x = stimlib.Input("x", "m")
    stimlib.Scene({"force": stimlib.Param("k", 500.0, "N/m") * x}).save(tmp_path / "saved.json")
    out = tmp_path / "a.wav"
    words = [
        "render",
        str(tmp_path / source),
        "--motion",
        "constant_speed(0.1, 0.02)",
        "--seconds",
        "0.1",
    ]
    ran([*words, "--out", str(out), "--quiet"])
    assert file.read(out)[0].max() == pytest.approx(500 * 0.1 * 0.1, rel=0.01)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["render", "sqeeze"], "no scene 'sqeeze': use one of bump_grid, bumps"),
        (["render", "squeeze"], "no motion for x1, x2"),
        (["render", "squeeze", "--motion", "jump()"], "minimum_jerk, sinusoid"),
        (["render", "squeeze", "--motion", "minimum_jerk()", "--set", "k"], "NAME=VALUE"),
        (
            ["render", "squeeze", "--motion", "minimum_jerk()", "--set", "k=two"],
            "'two' is not a number",
        ),
        (
            ["render", "squeeze", "--motion", "minimum_jerk()", "--set", "q=2"],
            "this scene has k, A, level",
        ),
        (
            ["render", "squeeze", "--motion", "minimum_jerk()", "--fs", "-1"],
            "sample rate must be a finite number above 0",
        ),
        (
            ["render", "squeeze", "--motion", "minimum_jerk()", "--fs", "2000"],
            "give a smaller passband",
        ),
        (
            ["render", "squeeze", "--motion", "minimum_jerk()", "--seconds", "nan"],
            "seconds = nan is not finite",
        ),
        (["render", "OWN:number", "--motion", "minimum_jerk()"], "returns int, not a Scene"),
        (
            ["render", "OWN:nothing", "--motion", "minimum_jerk()"],
            "own.py: there is no 'nothing' in it: write",
        ),
        (["render", "missing.py:f"], "cannot read missing.py: No such file"),
        (["render", "missing.json"], "cannot read missing.json"),
    ],
)
def test_mistakes_get_one_line_and_leave_nothing(own, tmp_path, words, says):
    words = [w.replace("OWN", str(own)) for w in words]
    ran([*words, "--out", str(tmp_path / "a.wav")], 2, says)
    assert {p.name for p in tmp_path.iterdir()} <= {"own.py", "__pycache__"}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("render squeeze", "Missing option '--out'; see stimlib render --help"),
        ("show", "Missing argument 'SCENE'; see"),
        ("render squeeze --ou a.wav", "No such option"),
        ("rendr", "No such command 'rendr'"),
        ("--verson", "--verson"),
        (
            "play squeeze --full-scale 1 --sink x",
            "'x' is not one of 'null', 'jack', 'portaudio', 'nidaq'; see stimlib play --help",
        ),
        ("show squeeze --fs a", "Invalid value for '--fs': "),
        ("verify --log", "'--log' requires an argument; see stimlib"),
        ("render tone --seed 1 --seed=2 --out a.wav", "--seed is given twice, but takes one value"),
        ("experiment status softer --data a --data b", "--data is given twice, but takes one"),
    ],
)
def test_mistakes_of_usage_get_one_line(words, says):
    done = ran(words, 2, says, prog_name="stimlib")
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert not done.stdout and "value error" not in done.stderr.lower()


def test_no_words_show_the_help():
    assert "stimlib" in ran([], 2).stdout


# What a user's own code, and a defect of ours, end with -------------------------------
FAILING = """
import stimlib
from stimlib import Input, Scene
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
"""


@pytest.mark.parametrize(
    ("function", "line", "says"),
    [
        ("units", 8, "cannot add [m]"), ("name", 12, "NameError: name 'nothing' is not defined"),
        ("deep", 20, "IndexError: list index out of range"), 
        ("number_of_a_block", 28, "float of Input('x'): a block is a signal"),
        ("wants", None, "TypeError: wants() missing 1 required positional argument: 'a'"),
    ],
)  # fmt: skip
def test_an_error_in_own_code_names_its_line(tmp_path, function, line, says):
    path = tmp_path / "own.py"
    path.write_text(FAILING)
    done = ran(["show", f"{path}:{function}"], 2)
    assert f"{path}:{line or function}: " in done.stderr and says in done.stderr


@pytest.mark.parametrize("text", ["def f(:\n", "import nothing_of_that_name\n", "1 / 0\n", "\0"])
def test_own_code_that_is_no_code(tmp_path, text):
    (tmp_path / "own.py").write_text(text)
    ran(["show", f"{tmp_path / 'own.py'}:f"], 2, f"{tmp_path / 'own.py'}:")


@pytest.mark.parametrize(
    "words",
    [
        ["render", "--out", "a.wav"],
        ["play", "--full-scale", "1"],
        ["loopback", "--full-scale", "1"],
        ["verify", "--wav", "a.wav"],
        ["show"],
    ],
)
def test_a_defect_ends_with_its_traceback_and_status_3(tmp_path, monkeypatch, words):
    """Status 1 says that a check failed, and must say nothing else; here a scene breaks
    what stimlib relies on.
    """
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(FAILING)
    done = ran(
        [
            words[0],
            "own.py:odd",
            *words[1:],
            *(["--motion", "minimum_jerk()"] if words[0] != "show" else []),
        ],
        3,
    )
    said = done.stderr.replace("\n", " ")
    assert (
        "unexpected error: KeyError: 3; this is a defect of stimlib, please report it" in said
        and "Traceback" in said
    )
    assert not (tmp_path / "a.wav").exists()


def test_every_command_ends_so():
    """``command`` alone makes commands, and runs each within ``friendly``."""
    texts = {p.name: p.read_text() for p in Path(cli.__file__).parent.glob("*.py")}
    assert {
        name: text.count(".command(") for name, text in texts.items() if ".command(" in text
    } == {"app.py": 1}
    assert "of.command(name)(sharing(friendly(options)(function), shared))" in texts["app.py"]
    groups = [app, *(g.typer_instance for g in app.registered_groups)]
    assert sum(len(g.registered_commands) for g in groups) == sum(
        text.count("\n@command(") for text in texts.values()
    )


@pytest.mark.parametrize(
    "words",
    [["show", "squeeze"], ["list", "--json"], ["list"]],
    ids=["at once", "at the end", "rich"],
)
def test_a_reader_that_goes_away_is_no_defect(words):
    with subprocess.Popen(
        [sys.executable, "-m", "stimlib", *words], stdout=-1, stderr=-1, text=True
    ) as job:
        job.stdout.close()
        said = job.stderr.read()
    assert job.wait() == 141 and said == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize(
    ("words", "streams", "status", "says"),
    [
        ("verify a.wav", "<&- >&-", 0, ""),
        ("show missing.json", "2>/dev/full", 2, ""),
        (
            "list --json",
            ">/dev/full",
            2,
            "error: cannot write what is printed: No space left on device\n",
        ),
        (
            (
                "render 'squeeze(fingers=1)' --motion 'minimum_jerk()' --full-scale 50 --seconds"
                " 0.1 --out é.wav"
            ),
            ">/dev/null",
            0,
            "",
        ),
    ],
)
def test_streams_that_are_closed_full_or_ascii(tmp_path, words, streams, status, says):
    if "a.wav" in words:
        file.write(
            tmp_path / "a.wav",
            stimlib.compile(scene_of("squeeze(fingers=1)"), 8000),
            {"x1": minimum_jerk()},
            0.1,
        )
    command = f"{sys.executable} -m stimlib {words} {streams}"
    environ = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        command, shell=True, capture_output=True, text=True, cwd=tmp_path, env=environ
    )
    assert (done.returncode, done.stderr) == (status, says)


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        ("squeeze(fingers='a')", "squeeze: fingers = 'a' must be a whole number"),
        ("squeeze(fingers=None)", "a whole number"),
        ("squeeze(fingers=10000000)", "limits.scene_blocks"),
        ("squeeze(fingers=1.5)", "a whole number"),
        ("squeeze(k=[1])", "k"),
        ("squeeze(k=1e999)", "not finite"),
        ("squeeze(contact=1)", "True or False"),
        ("squeeze(**{'k': 1})", "name=number"),
        ("squeeze(seed=" + "9" * 400 + ")", "seed"),
        ("squeeze(k=" + "9" * 400 + ")", "beyond what a float can hold"),
        ("bumps(waveform=3)", "bumps: waveform = 3 must be a text or"),
        ("bumps(bumps='a')", "a number"),
        ("bumps(rectify=1)", "a text"),
        ("viscoelastic(alpha='a')", "a number"),
        ("viscoelastic(scheme=None)", "a text"),
        ("squeeze(k={[]: 1})", "name=number"),
        ("squeeze(k=" + "(" * 5000 + ")", "name=number"),
        ("squeeze(\0)", "name=number"),
        ("x" * 5000 + ".json", "cannot read"),
        ("x" * 5000 + ".py:f", "cannot read"),
        ("a\0.json", "cannot read"),
        ("a\0.py:f", "cannot read"),
    ],
)
def test_odd_scenes_get_one_line(scene, says):
    ran(["show", scene], 2, says)


@pytest.mark.filterwarnings("ignore:touch_screen. at the top of a bump")
@pytest.mark.parametrize("make", stimlib.scenes.SHIPPED.values())
def test_any_argument_of_a_shipped_scene_is_a_scene_or_an_error_of_ours(make):
    odd = [
        None,
        True,
        "a",
        "",
        -1,
        0,
        0.5,
        1e308,
        10**400,
        [1],
        [],
        [[1]],
        {},
        {"a": 1},
        b"x",
        1j,
        (1, 2),
        2**70,
        np.nan,
        object(),
    ]
    for name in inspect.signature(make).parameters:
        for value in odd:
            try:
                assert make(**{name: value}).outputs
            except stimlib.StimlibError as e:
                assert str(e)


def test_show_prints_the_plan_draws_and_saves(tmp_path):
    done = ran(
        ["show", "squeeze", "--draw", str(tmp_path / "g.svg"), "--save", str(tmp_path / "s.json")]
    )
    assert "enabled 1  White(0, 1" in done.output and "removed:" in done.output
    assert "<svg" in (tmp_path / "g.svg").read_text()
    assert stimlib.load(tmp_path / "s.json").hash == stimlib.scenes.squeeze().hash


def test_show_says_what_it_cannot_draw_before_it_prints():
    done = ran(["show", "squeeze", "--draw", "x.txt"], 2, "the suffix of 'x.txt'")
    assert not done.stdout


@pytest.mark.parametrize(
    ("scene", "says"),
    [("", "say which function or scene in it"), (":scne", "there is no 'scne' in it")],
)
def test_a_file_without_the_name_of_a_scene_lists_them(tmp_path, scene, says):
    path = tmp_path / "pebbles.py"
    path.write_text(
        OWN + "def wants(a):\n    return a\ndef _hidden():\n    return soft()\nready = soft()\n"
    )
    done = ran(["show", f"{path}{scene}"], 2)
    assert (
        done.stderr
        == f"error: {path}: {says}: write {path}:NAME; it defines soft, two, broken, number,"
        " ready\n"
    )
    ran(["show", f"{path}:ready"])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        # no pictures in place of names
        ("def hand(t):\n    return t\n", "error: {path}:hand: TypeError: "),
        (
            OWN + "hand = {'k': 1.0}\n",
            "error: {path}: hand is a dict, no Scene: write {path}:NAME; it defines soft, two,"
            " broken, number\n",
        ),
    ],
)
def test_what_has_the_name_but_makes_no_scene(tmp_path, text, says):
    path = tmp_path / "own.py"
    path.write_text(text)
    assert ran(["show", f"{path}:hand"], 2).stderr.startswith(says.format(path=path))


def test_a_file_without_the_name_of_a_measure_lists_its_measures(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(
        OWN + "from stimlib.sweep import measure\n@measure('N')\ndef top(run):\n    return"
        " run['force'].max()\nready = soft()\n"
    )
    done = ran(
        ["sweep", f"{path}:soft", "--axis", "k=1,2", "--measure", f"{path}:tops"],
        2,
        "there is no 'tops' in it",
    )
    assert done.stderr.rstrip().endswith("number, top")


def test_list_names_scenes_and_motions():
    done = ran(["list"])
    assert "squeeze" in done.output and "minimum_jerk(depth=0.02" in done.output


def data_of(*words, code=0):
    done = ran([*words, "--json"], code)
    assert done.stderr == "", done.output
    return json.loads(done.stdout, parse_constant=lambda text: pytest.fail(f"{text} is no JSON"))


def test_json_says_what_the_words_say(tmp_path):
    listed = data_of("list")
    assert (
        listed["motions"]["minimum_jerk"]["arguments"]["depth"] == 0.02
        and "squeeze" in listed["scenes"]
    )
    assert listed["scenes"]["squeeze"]["params"]["k"] == {"value": 2000.0, "unit": "N/m"}
    shown = data_of("show", "squeeze", "--fs", "4000", "--save", tmp_path / "s.json")
    plan = stimlib.compile(stimlib.load(tmp_path / "s.json"), 4000, "python").plan
    assert (
        shown["hash"] == listed["scenes"]["squeeze"]["hash"]
        and shown["fs"] == 4000
        and shown["removed"] == plan.removed
    )
    assert [(row["number"], row["block"]) for row in shown["plan"]] == [
        row[:3:2] for row in plan.rows
    ]
    assert data_of("devices", "--server", "none_of_this_name")[0] == {
        "sink": "null",
        "ready": True,
        "what": "no device: nothing is heard or felt",
        "how": "--sink null",
        "fs": None,
    }


def tamper(session):
    data = bytearray((session / "motion.f64").read_bytes())
    data[8 * 2500 + 6] ^= 1
    (session / "motion.f64").write_bytes(data)


def test_json_of_a_file_and_of_a_replay(tmp_path, session):
    out = tmp_path / "a.wav"
    told = data_of(
        "render",
        "squeeze(fingers=1)",
        "--motion",
        "sinusoid(0.001, 1)",
        "--seconds",
        "0.1",
        "--out",
        out,
        "--full-scale",
        9,
    )
    y, sidecar = file.read(out)
    assert (
        told["path"] == str(out)
        and told["sidecar"] == f"{out}.json"
        and told["clips"] == {"force1": 0}
    )
    assert (
        told["frames"] == y.shape[1] == 800
        and told["peak"]["force1"] == sidecar["channels"][0]["peak"]
    )
    told = data_of("replay", session)
    assert told["matches"] and (told["frames"], told["spans"], told["wrong"]) == (4000, 2, [])
    tamper(session)
    told = data_of("replay", session, code=1)
    assert not told["matches"] and told["wrong"] == [[2000, 4000]]


def test_json_of_a_verification(tmp_path):
    out = tmp_path / "a.wav"
    words = [
        "render",
        "squeeze(fingers=1)",
        "--motion",
        "minimum_jerk()",
        "--seconds",
        "0.5",
        "--out",
        str(out),
        "--quiet",
    ]
    ran(words)
    sidecar = json.loads(out.with_suffix(".wav.json").read_text())
    sidecar["channels"][0]["peak"] += 1
    out.with_suffix(".wav.json").write_text(json.dumps(sidecar))
    told = data_of("verify", "squeeze(fingers=1)", "--wav", out, code=1)
    assert [c["name"] for c in told["checks"] if not c["passed"]] == [
        "sidecar: what it says"
    ] and not told["passed"]
    assert told["source"] == "a.wav" and told["seconds"] == 0.5 and len(told["checks"]) > 10
    done = ran(
        ["verify", "squeeze", "--wav", str(tmp_path / "b.wav"), "--json"], 2, "there is no file"
    )
    assert done.stdout == ""


def test_the_module_is_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "stimlib", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"stimlib {stimlib.__version__}\n"


@pytest.mark.parametrize(
    ("typed", "offered"), [("stimlib rend", "render render-set"), ("stimlib show sq", "squeeze")]
)
def test_the_shell_completes_commands_and_scenes(typed, offered):
    words = {
        "_STIMLIB_COMPLETE": "complete_bash",
        "COMP_WORDS": typed,
        "COMP_CWORD": str(typed.count(" ")),
    }
    assert ran([], prog_name="stimlib", env=words).stdout.split() == offered.split()
    assert "--install-completion" in ran(["--help"]).stdout


def test_help_teaches():
    done = ran(["render", "--help"])
    assert "minimum_jerk" in done.output


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
    with subprocess.Popen(
        [sys.executable, "-m", "stimlib", *words], stdout=-1, stderr=-1, text=True
    ) as job:
        for _ in range(600):
            if any(p.stat().st_size > size for p in grows.parent.glob(grows.name)):
                break
            assert job.poll() is None, job.stderr.read()
            time.sleep(0.1)
        job.send_signal(what)
        return (job.wait(60), *job.communicate())


LONG = ["render", "squeeze", "--motion", "minimum_jerk()", "--seconds", "10000", "--out"]


def test_ctrl_c_in_the_middle_leaves_nothing(tmp_path):
    words, part = [*LONG, tmp_path / "long.rf64"], tmp_path / "long.rf64.*.part"
    code, _, said = ended(words, part, 1_000_000, signal.SIGINT)
    assert code == 130 and "nothing was left behind" in said
    assert os.listdir(tmp_path) == []


def test_sidecar_is_enough_to_render_again(tmp_path):
    words = [
        "render",
        "squeeze",
        "--motion",
        "minimum_jerk(depth=0.005)",
        "--seconds",
        "0.3",
        "--set",
        "A=2",
        "--quiet",
    ]
    ran([*words, "--out", str(tmp_path / "a.w64"), "--subtype", "DOUBLE"])
    sidecar = json.loads((tmp_path / "a.w64.json").read_text())
    again = stimlib.render(
        stimlib.Scene.from_dict(sidecar["scene"]),
        {name: parse_motion(text) for name, text in sidecar["motion"].items()},
        sidecar["fs"],
        sidecar["frames"] / sidecar["fs"],
        sidecar["params"],
        sidecar["seed"],
    )
    assert np.array_equal(file.read(tmp_path / "a.w64")[0], again.y)


GRIP = "t_s,force_N,x_mm\n0,8,1\n0.012,9,1\n0.024,11,2\n0.036,14,3\n"


@pytest.mark.parametrize("name", ["a.wav", "a.flac"])
@pytest.mark.parametrize(
    "motion",
    [["minimum_jerk(depth=0.01)"], ["grip.csv", "--map", "x=force_N*5e-4", "--max-speed", "2"]],
)
def test_a_file_tells_how_to_verify_it(tmp_path, monkeypatch, name, motion):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "grip.csv").write_text(GRIP)
    words = ["--seconds", "0.1", "--full-scale", "64", "--set", "k=1500", "--seed", "4", "--quiet"]
    ran(["render", "squeeze(fingers=1)", "--motion", *motion, *words, "--out", name])
    done = ran(["verify", name])
    assert "--scene" not in done.stdout and "mine.py:scene" in done.stdout, done.output
    ran(["verify", "squeeze(fingers=2)", "--wav", name], 2, "was rendered from another scene")
    if motion[0] == "grip.csv":
        (tmp_path / "grip.csv").write_text(GRIP + "0.048,20,4\n")
        ran(["verify", name], 2, f"error: {name}: motion of x1: grip.csv: SHA-256 is ")
        ran(["verify", name, "--motion", *motion], 1)  # the motion of this name is another now
        (tmp_path / "grip.csv").unlink()
        ran(["verify", name], 2, "or give the motion (--motion), as it was rendered")


@pytest.mark.parametrize(
    ("scene", "name"),
    [("squeeze", "x"), ("bumps(duty=0.3)", "x"), ("viscoelastic", "y"), ("OWN:soft", "x")],
)
def test_lifts_name_the_scene_that_knows_of_them(own, tmp_path, scene, name):
    (tmp_path / "lift.csv").write_text("t_s,x_mm,contact\n0,1,1\n0.01,2,1\n0.02,3,0\n0.03,4,1\n")
    words = [
        "--motion",
        str(tmp_path / "lift.csv"),
        "--map",
        f"{name}=x_mm*1e-3",
        "--out",
        str(tmp_path / "a.wav"),
    ]
    known = f"use {scene.partition('(')[0]}(contact=True)"
    wanted = 'give it an Input("contact")' if "OWN" in scene else known
    ran(["render", scene.replace("OWN", str(own)), *words], 2, wanted)


@pytest.mark.parametrize(
    "command", ["render squeeze --out a.wav", "play squeeze --full-scale 50 --fast", "verify a.wav"]
)
def test_commands_take_the_text_of_a_recording(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "grip.csv").write_text(GRIP)
    text = "recording('grip.csv', {'x': 'force_N*5e-4'})"
    if "verify" in command:
        ran(["render", "squeeze", "--motion", text, "--out", "a.wav", "--quiet"])
    one_by_one = ["--motion", f"x1={text}.motion['x']", "--motion", f"x2={text}"]
    for motion in (
        ["--motion", text],
        one_by_one,
        ["--motion", "grip.csv", "--map", "x=force_N*5e-4"],
    ):
        ran([*command.split(), *motion])
    ran(
        [*command.split(), "--motion", text, "--map", "x=force_N*5e-4"],
        2,
        "--map and --where are for a recording",
    )


PEN = """
from stimlib import Input, Scene, constant
def scene():
    return Scene({"f": constant(100.0, "N/m") * Input("x", "m") + Input("press", "N")})
def contact():
    return Scene({"f": Input("contact") * scene().outputs["f"]})
"""
ROWS = "t_s,pos_mm,force_N\n0,1,0\n0.01,2,5\n0.02,3,9\n"
MAP_X, MAP_PRESS, HELD = (
    ["--map", "x=pos_mm*1e-3"],
    ["--map", "press=force_N"],
    "press=sinusoid(0.5, 1, mean=1)",
)


@pytest.fixture
def pen(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pen.py").write_text(PEN)
    (tmp_path / "pen.csv").write_text(ROWS)
    (tmp_path / "lift.csv").write_text("t_s,pos_mm,contact\n0,1,1\n0.01,2,1\n0.02,3,0\n")

    def rendered(*motion, code=0, says="", scene="scene"):
        how = ["--out", "a.wav", "--full-scale", "100"]
        done = ran(["render", f"pen.py:{scene}", *motion, *how], code, says)
        told = {} if code else json.loads(Path("a.wav.json").read_text())["motion"]
        return done, told

    return rendered


@pytest.mark.parametrize(
    "motion",
    [
        ["--motion", "pen.csv", *MAP_X, "--motion", HELD],
        ["--motion", HELD, "--motion", "pen.csv", *MAP_X],
        ["--motion", "x=pen.csv", *MAP_X, "--motion", HELD],
        ["--motion", HELD[6:], "--motion", "x = pen.csv", *MAP_X],
    ],
)
def test_a_recording_goes_with_a_generator(pen, motion):
    done, told = pen(*motion)
    assert "0.02 s" in done.stdout, done.output
    assert told["x"].startswith("recording('pen.csv', {'x': 'pos_mm*1e-3'}") and told[
        "press"
    ].startswith("sinusoid(amplitude=0.5")


def test_two_recordings_and_the_contact_of_one(pen):
    both = ["--motion", "x=lift.csv", *MAP_X, "--motion", "press=pen.csv", *MAP_PRESS]
    says = "say which serves, such as --motion contact=my.csv"
    pen(*both, scene="contact", code=2, says=says)
    _, told = pen(*both, "--motion", "contact=lift.csv", scene="contact")
    assert told["contact"].startswith("recording('lift.csv'")
    assert told["contact"].endswith(".contact") and "'force_N'}" in told["press"]
    _, told = pen(
        "--motion", "x=lift.csv", *MAP_X, "--motion", "sinusoid(0.5, 1, mean=1)", scene="contact"
    )
    assert told["contact"].endswith(".contact")


def test_only_metres_are_held_to_the_speed_of_a_hand(pen):
    words = ["--motion", "pen.csv", *MAP_X, *MAP_PRESS]
    assert "max_speed={'x': 1.0}" in pen(*words)[1]["x"]  # force_N rises by 500 N/s
    assert "max_speed={'press': 1000.0}" in pen(*words, "--max-speed", "press=1000")[1]["x"]
    pen(*words, "--max-speed", "0.05", code=2, says="x moves at 0.1 m/s")


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        (["no.csv"], "no.csv: cannot be read (No such file"),
        (["x=no.csv", "--motion", HELD], "no.csv: cannot be read"),
        (
            ["pen.csv"],
            (
                "pen.csv: name the column of x, press, such as --map 'x=force_N*5e-4'; the columns"
                " are: t_s, pos_mm"
            ),
        ),
        (["pen.csv", *MAP_X], "nothing is recorded for press"),
        (["x=pen.csv", *MAP_X], "no motion for press"),
        (
            ["pen.csv", *MAP_X, *MAP_PRESS, "--motion", "press=sinusoid(1, 1)"],
            "--map press: press has a motion of its own",
        ),
        (
            ["pen.csv", *MAP_X, "--map", "q=force_N"],
            "--map q: the scene has no input q; the inputs are: x, press",
        ),
        (
            ["pen.csv", *MAP_X, "--motion", "minimum_jerk()"],
            "say of which each is, such as x=minimum_jerk()",
        ),
        (
            ["pen.csv", *MAP_X, *MAP_PRESS, "--max-speed", "y=1"],
            "--max-speed y: there is no --map y; there is x, press",
        ),
        (
            ["pen.csv", *MAP_X, *MAP_PRESS, "--max-speed", "x=a"],
            "--max-speed x=a: 'a' is not a number",
        ),
    ],
)
def test_mistakes_with_several_motions_get_one_line(pen, motion, says):
    pen("--motion", *motion, code=2, says=says)


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ("<function <lambda>>", "cannot be made again from"),
        ("array(800)", "cannot be made again from"),
        ("log of 9", "--log"),
        ("recording('grip.csv', {'x': 'x_mm*1e-3'}).motion['x']", "does not have the SHA-256"),
        ("recording(", "--motion"),
        ("recording(open('grip.csv'), {}).contact", "--motion"),
        ("recording('grip.csv', {'x': 'x_mm'}, y=1)", "--motion"),
    ],
)
def test_a_motion_that_its_text_does_not_tell(tmp_path, monkeypatch, told, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "grip.csv").write_text(GRIP)
    words = ["--motion", "minimum_jerk()", "--seconds", "0.1", "--quiet"]
    ran(["render", "squeeze(fingers=1)", *words, "--out", "a.wav"])
    sidecar = json.loads((tmp_path / "a.wav.json").read_text())
    (tmp_path / "a.wav.json").write_text(json.dumps(sidecar | {"motion": {"x1": told}}))
    ran(["verify", "a.wav"], 2, says)
    ran(["verify", "a.wav", *words[:2]])


@pytest.fixture
def session(tmp_path):
    from stimlib.devices.null import NullSink

    folder = tmp_path / "a.stimlog"
    hand = {"x1": minimum_jerk(depth=0.01)}
    with NullSink(
        stimlib.scenes.squeeze(fingers=1), 50.0, clocked=False, motion=hand, log=folder
    ) as sink:
        sink.open(8000, channels=["force1", None])
        sink.start(seconds=0.5)
        sink.wait()
    return folder


def test_a_session_is_replayed_and_verified(tmp_path, session):
    done = ran(["replay", session])
    assert done.output == "4000 frames replayed, 0 lost; 2 of 2 hashes match\n"
    done = ran(["replay", str(session), "--out", str(tmp_path / "a.wav")])
    assert file.read(tmp_path / "a.wav")[0].shape == (2, 4000)
    for words in ([], ["squeeze(fingers=1)"]):
        done = ran(["verify", *words, "--log", str(session), "--report", str(tmp_path / "a.html")])
        assert (
            "log: delivered = replay" in done.output
            and "passed" in (tmp_path / "a.html").read_text()
        )
    tamper(session)
    done = ran(["replay", str(session)], 1)
    assert "1 of 2 hashes match, the first that does not is of frames 2000 to 4000" in done.output
    done = ran(["verify", "--log", str(session)], 1)
    assert "FAILED" in done.output


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["replay", "none.stimlog"], "there is no log none.stimlog"),
        (
            ["replay", "LOG", "--out", "a.flac"],
            "'a.flac' must end in one of .wav, .rf64, .w64, .caf",
        ),
        (["verify", "--log", "none.stimlog"], "there is no log none.stimlog"),
        (["verify", "squeeze", "--log", "LOG"], "is a session of another scene"),
        (["verify", "--log", "LOG", "--wav", "a.wav"], "give --log without --wav and --motion"),
        (
            ["verify", "--log", "LOG", "--motion", "minimum_jerk()"],
            "give --log without --wav and --motion",
        ),
        (["verify"], "name what to verify: FILE.wav, SCENE --wav FILE, or --log LOG"),
        (["verify", "squeeze"], "name what to verify: FILE.wav, SCENE --wav FILE, or --log LOG"),
        (["verify", "p.stimlog"], "p.stimlog is a log: stimlib verify --log p.stimlog"),
        (
            ["verify", "squeeze", "--wav", "p.stimlog"],
            "p.stimlog is a log: stimlib verify --log p.stimlog",
        ),
        (["verify", "a.png"], "a.png is not a sound file, which ends in one of .wav"),
        (["verify", "--wav", "a.wav"], "there is no file a.wav"),
        (["verify", "a.flac"], "there is no file a.flac"),
        (["verify", "a.wav", "--wav", "b.wav"], "a.wav and b.wav are two files"),
        (["verify", "--log", "LOG", "--map", "x=y"], "give --log without --wav and --motion"),
        (
            ["replay", "LOG/session.json"],
            "session.json is no log: that is the folder that a sink wrote",
        ),
    ],
)
def test_mistakes_with_sessions_get_one_line(tmp_path, session, words, says):
    ran([w.replace("LOG", str(session)) for w in words], 2, says)
    assert [p.name for p in tmp_path.iterdir()] == ["a.stimlog"]


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
    own, hand = f"{folder}/click_block.py:scene", ["--motion", "minimum_jerk()", "--seconds", "0.2"]
    for words in (
        ["show", own, "--save", f"{folder}/click.json"],
        ["render", own, *hand, "--out", f"{folder}/click.wav", "--quiet"],
        [
            "play",
            own,
            *hand,
            "--full-scale",
            "1",
            "--fast",
            "--quiet",
            "--log",
            f"{folder}/click.stimlog",
        ],
    ):
        ran(words)
    return folder


def forget(module):
    """As in a process of its own, that has not run the file of this module."""
    registry.pop(f"{module}.Click", None)
    sys.modules.pop(module, None)
    _ours.pop(module, None)


@pytest.mark.parametrize(
    "words",
    ["replay click.stimlog", "verify --log click.stimlog", "verify click.json --log click.stimlog",
     "verify click.json --wav click.wav", "show click.json",
     "render click.json --motion minimum_jerk() --seconds 0.2 --out again.wav",
     "play click.json --motion minimum_jerk() --seconds 0.2 --full-scale 1 --fast"],
)  # fmt: skip
def test_own_blocks_are_known_by_import(clicks, monkeypatch, words):
    monkeypatch.chdir(clicks)
    for more, code in ([], 2), (["--import", "click_block.py"], 0):
        forget("click_block")
        done = ran([*words.split(), *more], code)
        assert (
            code == 0
            or "import click_block first; on the command line, add --import click_block.py"
            in done.stderr
        )


def test_a_scene_of_own_code_is_loaded_before_the_log(clicks):
    forget("click_block")
    ran(["verify", f"{clicks}/click_block.py:scene", "--log", f"{clicks}/click.stimlog"])


@pytest.mark.parametrize("edit", ["# another day\n", "GAIN = 2.0\n"])
@pytest.mark.parametrize(
    "words",
    ["replay click.stimlog", "verify --log click.stimlog", "verify click.json --wav click.wav"],
)
def test_what_defined_an_own_block_is_kept_and_compared(clicks, tmp_path, monkeypatch, words, edit):
    monkeypatch.chdir(clicks)
    kept = [
        json.loads(Path(name).read_text())
        for name in ("click.stimlog/session.json", "click.wav.json")
    ]
    assert [k["definitions"]["click_block"]["text"] for k in kept] == [CLICK, CLICK]
    (tmp_path / "click_block.py").write_text(CLICK + edit)
    done = ran([*words.split(), "--import", str(tmp_path / "click_block.py")], "GAIN" in edit)
    assert "own blocks of click_block:" in done.stdout
    done = ran([*words.split(), "--import", "click_block.py"])
    assert "own blocks" not in done.stdout


def test_a_definition_is_what_ran_with_what_it_derives_from(tmp_path, monkeypatch):
    """Not what its file became since, as in a notebook that imported it before."""
    base = "from stimlib import Block\n\nclass Base(Block, abstract=True):\n    pass\n"
    (tmp_path / "bases_here.py").write_text(base)
    own = "from dataclasses import dataclass\nfrom bases_here import Base, Block\n"
    own += "@dataclass(frozen=True, eq=False)\nclass Twice(Base):\n    x: Block\n"
    own += "    @staticmethod\n    def step(p, s, x):\n        return 2.0 * x, s\n"
    (tmp_path / "twice_here.py").write_text(own)
    monkeypatch.syspath_prepend(str(tmp_path))
    import twice_here

    for name in ("twice_here.py", "bases_here.py"):
        (tmp_path / name).write_text("# another\n")
    scene = stimlib.Scene({"y": twice_here.Twice(stimlib.Input("x"))})
    assert {module: d["text"] for module, d in definitions(scene).items()} == {
        "bases_here": base,
        "twice_here": own,
    }


@pytest.mark.parametrize(
    ("now", "code"),
    [
        ({"text": "x = 1"}, 2),
        ({"sha256": "0" * 64}, 2),
        ({"text": "\ud800"}, 2),
        (None, 2),
        ({"text": 1}, 2),
        ({"text": "x = 1", "sha256": hashlib.sha256(b"x = 1").hexdigest()}, 0),
    ],
)
def test_a_definition_has_its_hash(clicks, tmp_path, now, code):
    """Whoever changes both is told from today's file only."""
    shutil.copytree(clicks / "click.stimlog", tmp_path / "a.stimlog")
    path = tmp_path / "a.stimlog" / "session.json"
    told = json.loads(path.read_text())
    told["definitions"] = (
        {} if now is None else {"click_block": told["definitions"]["click_block"] | now}
    )
    path.write_text(json.dumps(told))
    done = ran(["replay", str(path.parent), "--import", f"{clicks}/click_block.py"], code)
    assert ("is not the one that was recorded" in done.stdout) == (code == 0), done.output
    assert code == 0 or "definitions" in done.stderr


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        (
            "odd_block.py",
            "x = 1\ny = nothing",
            "odd_block.py:2: NameError: name 'nothing' is not defined",
        ),
        ("odd_block.py", "def f(:", "odd_block.py:1: SyntaxError"),
        ("numpy.py", "", "give the file another name"),
        ("odd.txt", "", "name one such as click_block.py"),
        ("absent.py", None, "cannot read"),
    ],
)
def test_mistakes_of_import_get_one_line(tmp_path, name, text, says):
    if text is not None:
        (tmp_path / name).write_text(text)
    ran(["show", "squeeze", "--import", str(tmp_path / name)], 2, says)
    assert sys.modules["numpy"] is np


# Devices ------------------------------------------------------------------------------
HAND = ["--motion", "minimum_jerk(depth=0.01)", "--full-scale", "50"]


def test_play_leaves_a_log_that_replays(tmp_path):
    log = tmp_path / "a.stimlog"
    words = [
        "play",
        "squeeze",
        *HAND,
        "--fast",
        "--seconds",
        "2",
        "--set",
        "k=1500",
        "--seed",
        "4",
        "--channels",
        "3",
    ]
    done = ran([*words, "--peak", "40", "--static", "30", "--slew", "1e6", "--log", str(log)])
    assert "16000 samples, 16000 delivered, 0 lost" in done.stdout and f"log: {log}" in done.stdout
    told = json.loads((log / "session.json").read_text())
    assert (
        told["params"] == {"k": 1500.0}
        and told["seed"] == 4
        and told["channels"] == ["force1", "force2", None]
    )
    assert (told["safety"]["peak"], told["safety"]["static"], told["safety"]["slew"]) == (
        40.0,
        30.0,
        1e6,
    )
    ran(["verify", "squeeze", "--log", str(log)])


def test_a_sound_file_is_played_at_its_rate(tmp_path):
    y = 0.3 * np.random.default_rng(1).uniform(-1, 1, (2, 441))
    path, log = tmp_path / "vib.wav", tmp_path / "a.stimlog"
    soundfile.write(path, y.T, 44100, subtype="PCM_16")
    done = ran(["play", str(path), "--full-scale", "2", "--fast", "--log", str(log)])
    assert "441 samples" in done.stdout, done.output
    ran(["replay", str(log), "--out", str(tmp_path / "b.wav")])
    heard, sidecar = file.read(tmp_path / "b.wav")
    assert sidecar["fs"] == 44100 and [c["name"] for c in sidecar["channels"]] == [
        "channel1",
        "channel2",
    ]
    assert np.array_equal(heard, 2 * np.float32(soundfile.read(path)[0].T / 2))
    stimlib.render(stimlib.Scene({"force": stimlib.constant(2.0, "N")}), fs=1000, seconds=0.1).save(
        path, full_scale=4.0
    )
    done = ran(["play", path, "--full-scale", "1", "--peak", "1", "--fast"])
    assert "100 samples limited (peak)" in done.stdout, "with a sidecar it is in N"
    for words, says in [
        (
            [str(path), "--fs", "8000"],
            "was recorded at 1000 Hz and is played at that: leave out --fs",
        ),
        ([str(path), "--motion", "minimum_jerk()"], "has no inputs: leave out --motion"),
        ([str(tmp_path / "none.wav")], "none.wav: No such file"),
        ([str(log), "--fs", "1"], "no scene"),
        ([str(tmp_path / "text.wav")], "is damaged, or no sound file"),
    ]:
        (tmp_path / "text.wav").write_text("hello")
        ran(["play", *words, "--full-scale", "1"], 2, says)


def test_play_with_outputs_of_different_units(own, tmp_path):
    words = [
        "play",
        f"{own}:two",
        "--motion",
        "minimum_jerk()",
        "--fast",
        "--seconds",
        "1",
    ]
    done = ran([*words, "--full-scale", "force=50,place=0.1", "--slew", "force=1e6"])
    assert "8000 samples" in done.stdout, done.output
    for wrong, says in [
        ("50", "force [N], place [m]"),
        ("force=50", "at place"),
        ("force=50,place", "--full-scale 'place': write OUTPUT=NUMBER"),
    ]:
        done = ran([*words, "--full-scale", wrong], 2, says)
    out = tmp_path / "a.wav"
    words = ["render", *words[1:4], "--seconds", "0.1", "--out", str(out), "--full-scale"]
    done = ran([*words, "force=50,place=0.1"])
    assert [c["full_scale"] for c in file.read(out)[1]["channels"]] == [
        50.0,
        0.1,
    ], done.output


@pytest.mark.parametrize(
    "what, wanted", [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_play_fades_out_when_it_is_told_to_end(tmp_path, what, wanted):
    from stimlib.files.log_reader import read_log
    from stimlib.files.log_replay import delivered, replay

    log = tmp_path / "a.stimlog"
    words = [
        "play",
        "squeeze",
        "--sink",
        "null",
        "--motion",
        "sinusoid(0.005, 1, mean=0.01)",
        "--full-scale",
        "50",
        "--log",
        str(log),
    ]
    code, out, err = ended(words, log / "motion.f64", 4000 * 16, what)
    assert (code, "Traceback" in err) == (wanted, False), err
    assert "samples," in out and f"log: {log}" in out
    told = read_log(log)
    assert replay(told).matches and told.report["produced"] == told.frames
    last = [frames for _, frames, _ in delivered(told)][-1]
    assert not np.abs(last[-1]).max() > 0.01, "faded out"


def test_a_tablet_in_milliseconds_and_equal_times(own, tmp_path):
    log, out = tmp_path / "log.csv", tmp_path / "a.wav"
    log.write_text("t_ms;x_mm\n0;1,0\n8;1,5\n8;2,0\n16;2,5\n24;3,0\n")
    words = [
        "render",
        f"{own}:soft",
        "--motion",
        str(log),
        "--map",
        "x=x_mm*1e-3",
        "--out",
        str(out),
    ]
    for more, says in (
        ([], 'such as time="'),
        (["--time", "t_ms"], 'choose repeats="spread"'),
        (["--time", "t_ms", "--repeats", "last"], 'time in ms? write time="t_ms*1e-3"'),
    ):
        ran([*words, *more], 2, says)
    how = [
        "--time",
        "t_ms*1e-3",
        "--repeats",
        "spread",
        "--max-gap",
        "0.1",
        "--max-speed",
        "2",
        "--reports",
        "on_change",
    ]
    ran([*words, *how, "--subtype", "DOUBLE"])
    y, sidecar = file.read(out)
    assert y[0, [0, 64, 96]] == pytest.approx([0.5, 0.75, 1.0], rel=1e-9)
    for option in (
        "time='t_ms*1e-3'",
        "repeats='spread'",
        "max_gap=0.1",
        "max_speed=2.0",
        "reports='on_change'",
    ):
        assert option in sidecar["motion"]["x"]


def test_render_tells_once_of_millimetres_taken_for_metres(own, tmp_path):
    words = [
        "render",
        f"{own}:soft",
        "--motion",
        "minimum_jerk(depth=20)",
        "--seconds",
        "0.2",
    ]
    done = ran(
        [*words, "--out", str(tmp_path / "a.wav"), "--picture", str(tmp_path / "a.png"), "--quiet"]
    )
    assert done.stderr.count("faster than a hand (1 m/s)") == 1


@pytest.mark.parametrize(
    ("full_scale", "says"),
    [
        (
            "1e7",
            (
                "the peak uses 0.0001 % of full scale, and the file has steps of 1.2: write it with"
                " a full scale of about 10.1"
            ),
        ),
        (
            "1001",
            (
                "the peak uses 1 % of full scale, and the file has steps of 0.00012: write it with"
                " a full scale of about 10.1"
            ),
        ),
        ("999", None),
        ("10.1", None),
    ],
)
@pytest.mark.parametrize("suffix", ["flac", "wav"])
def test_render_says_where_full_scale_is_far_too_large(own, tmp_path, full_scale, says, suffix):
    words = [
        "render",
        f"{own}:soft",
        "--motion",
        "constant_speed(0.2, 0.02)",
        "--seconds",
        "0.2",
    ]
    done = ran([*words, "--out", str(tmp_path / f"a.{suffix}"), "--full-scale", full_scale])
    assert done.stderr.strip() == (f"note: {says}" if says and suffix == "flac" else "")


def test_render_says_of_a_fault_what_the_library_says(own, tmp_path):
    words = [
        "render",
        f"{own}:broken",
        "--motion",
        "minimum_jerk()",
        "--out",
        str(tmp_path / "a.wav"),
    ]
    done = ran(words, 2)
    with pytest.warns(RuntimeWarning) as told:
        stimlib.render(scene_of(words[1]), {"x": minimum_jerk()}, 8000, 0.1)
    begin, _, remedy = str(told[0].message).partition(
        "from there on it is not the scene's but a fade to 0"
    )
    assert remedy.startswith("; look for")
    assert (
        done.stderr.replace("\n", "")
        == f"error: {begin}{tmp_path / 'a.wav'} was not written{remedy}"
    )


def test_play_says_that_an_output_failed(own):
    words = [
        "play",
        f"{own}:broken",
        "--motion",
        "minimum_jerk()",
        "--full-scale",
        "1",
        "--fast",
        "--seconds",
        "2",
    ]
    done = ran(words, 1)
    assert (
        "output y was not finite at sample 0" in done.stderr
        and "output y failed at sample 0" in done.stdout
    )


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["squeeze", "--full-scale", "50"], "no motion for x1, x2"),
        (["squeeze", *HAND, "--set", "q=1"], "no parameter 'q'"),
        (["squeeze", *HAND, "--channels", "1"], "fewer than the 2 outputs"),
        (
            ["squeeze", *HAND, "--device", "a"],
            "--device: is for --sink jack or portaudio or nidaq, not for null",
        ),
        (["squeeze", *HAND, "--connect", "a"], "--connect: is for --sink jack, not for null"),
        (["squeeze", *HAND, "--client", "a"], "--client: is for --sink jack"),
        (
            ["squeeze", *HAND, "--map", "x1=z"],
            "--map and --where are for a recording, and there is none",
        ),
        (
            ["squeeze", *HAND, "--sink", "jack", "--fast"],
            "--fast: is for --sink null or portaudio, not for jack",
        ),
        (
            ["squeeze", *HAND, "--set", "sink_gain=1"],
            "no parameter 'sink_gain'; this scene has k, A, level",
        ),
        (["squeeze", *HAND, "--seconds", "0"], "must be at least one sample"),
        (["squeeze", *HAND, "--seconds", "inf"], "seconds = inf must be finite"),
        (
            ["OWN:broken", *HAND, "--peak", "1"],
            "peak and static limit outputs in N, but this scene has none: y [m⁻¹]",
        ),
        (["tone", "--full-scale", "-1"], "--full-scale = -1 must be a finite number above 0"),
        (
            ["tone", "--set", "freq=-3"],
            "--set('freq'): oscillator or carrier: freq = -3 Hz must be 0",
        ),
        (["tone", "--set", "freq=nan"], "--set freq=nan: the value must be finite"),
        (["tone", "--full-scale", "forc=1"], "--full-scale does not fit the outputs at forc"),
        (["tone", *HAND], "the scene has no input: leave it out"),
        (
            ["squeeze", *HAND, "--motion", "x3=still()"],
            "--motion x3=still(): the scene has no input of that name; its inputs are x1, x2",
        ),
        (["squeeze", "--motion", "minimum_jerk(depht=1)"], "there is no argument 'depht'"),
    ],
)
def test_mistakes_in_playing_get_one_line(own, words, says):
    done = ran(["play", *(w.replace("OWN", str(own)) for w in words)], 2, says)
    assert "Traceback" not in done.output and not done.stdout


def test_devices_says_what_there_is_and_how_to_get_the_rest():
    done = ran(["devices", "--server", "stimlib_none"])
    lines = done.stdout.splitlines()
    assert lines[0].split() == "ready null no device: nothing is heard or felt: --sink null".split()
    (jack,) = [line for line in lines if line.split()[1] == "jack"]
    assert jack.startswith("missing") and (
        "start one, such as jackd" in jack or "apt-get install jackd2" in jack
    )
    assert any(line.split()[1] == "portaudio" for line in lines)


def test_what_is_asked_of_a_server_reaches_it(monkeypatch):
    asked = {}

    def compare(scene, safety, fs, seconds, **options):
        asked.update(options, fs=fs, seconds=seconds, full_scale=safety.full_scale)
        return SimpleNamespace(passed=True)

    monkeypatch.setattr(available, "devices", lambda server=None: asked.update(looked=server) or [])
    monkeypatch.setattr(loopback_test, "loopback", compare)
    words = (
        "--motion minimum_jerk() --full-scale 50 --seconds 2 --fs 4000 --device lab --connect none"
        " --capture in_1"
    )
    more = "--channels 3 --tolerance 0.2 --set k=1000 --seed 7 --log a.stimlog"
    for command in ("devices --server lab", f"loopback squeeze(fingers=1) {words} {more}"):
        ran(command.split())
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
        done = ran(["devices", "--server", server.name])
        assert (
            "a server at 8000 Hz, blocks of 64, 24 outputs, 8 inputs: --sink jack --fs 8000"
            in done.stdout
        )
        words = ["squeeze", *HAND, "--sink", "jack", "--device", server.name, "--seconds", "1"]
        done = ran(["play", *words, "--connect", "none"])
        assert "8000 samples" in done.stdout, done.output
        monkeypatch.setenv("JACK_DEFAULT_SERVER", server.name)
        first = ["play", "tone", "--seconds", "0.2", "--connect", "none"]
        done = ran(first)  # without --sink and --fs: the server's
        assert "1600 samples" in done.stdout, done.output
        assert done.stderr.startswith("jack: a server at 8000 Hz"), done.stderr
        assert "20 dB below full scale: --full-scale 1" in " ".join(done.stderr.split())
        assert "20 dB" not in ran([*first, "--full-scale", "2"]).stderr
        with JackSink(
            stimlib.Scene({"y": stimlib.constant(1.0)}), 1.0, server=server.name, realtime=False
        ) as other:
            other.open(8000)
            done = ran(["play", *words], 2, "has a client 'stimlib' already")
            assert "play --client" in done.stderr
            done = ran(["play", *words, "--client", "another"])
            assert "8000 samples" in done.stdout, done.output
        done = ran(["loopback", *words])
        assert "all equal the offline render" in done.stdout and "passed" in done.stdout, (
            done.output
        )
        silent = ["--capture", "system:capture_1", "--capture", "system:capture_2"]
        done = ran(["loopback", *words, *silent], 1)
        assert "nothing could be compared" in done.stdout, done.output
        ran(
            ["loopback", *words, "--capture", "system:capture_1"],
            2,
            "capture names 1 ports for 2 channels",
        )


def test_what_an_empty_cache_compiles_is_said_once_before(tmp_path, monkeypatch, capsys):
    """The words come before the text runs, which is what takes long; of a block class
    there are none.
    """
    from stimlib.cli.app import friendly
    from stimlib.system import cache_folder
    from stimlib.targets.numba import cache

    monkeypatch.setenv("STIMLIB_CACHE", str(tmp_path / "empty"))
    monkeypatch.setattr(cache_folder, "_folder", None)
    seen = "import sys; print('running', file=sys.stderr)"
    with friendly():
        cache.load("x = 1", "Add")
        assert capsys.readouterr().err == ""
        for stem in ("runtime", "pump"):
            cache.load(seen, stem)
    assert (
        capsys.readouterr().err
        == "compiling for this machine, once: about ten seconds\nrunning\nrunning\n"
    )
    cache.load(f"{seen} # again", "pump")
    assert capsys.readouterr().err == "running\n", "nobody is told outside of a command"


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
    done = ran(["demo", "new/folder"], status)
    assert (
        "new/folder/[b]squeeze.wav" in done.stdout
        and "a spring" in done.stdout
        and (tmp_path / "new" / "folder").is_dir()
    )
    assert (
        "the first time also compiling" in done.stderr
        and f"squeeze: {'passed' if passed else 'FAILED'}" in done.stderr
    )


def test_demo_writes_each_file_with_its_full_scale(tmp_path, monkeypatch):
    for name in ("render", "verify", "picture"):
        monkeypatch.setattr(demo, name, MagicMock())
    monkeypatch.setattr(demo, "listen", lambda *given: SimpleNamespace(peak={"force": 1.0}))
    monkeypatch.setattr(demo, "compile", partial(stimlib.compile, target="python"))
    monkeypatch.setattr(demo, "SECONDS", 0.01)
    s = demo.STIMULI[1]
    path = demo.show(tmp_path, s).files[0][0]
    assert [c["full_scale"] for c in told(path)["channels"]] == [s.full_scale]


def test_demo_refuses_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("mine")
    done = ran(["demo", str(tmp_path / "file")], 2, "cannot make the folder")
    assert "name another" in done.stderr
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("s", demo.STIMULI, ids=lambda s: s.make.__name__)
def test_demo_stays_within_full_scale_and_vibrates(s):
    y = stimlib.render(s.make(), s.motion, demo.FS, demo.SECONDS)
    assert 0.5 * s.full_scale < np.abs(y.y).max() <= s.full_scale
    assert np.abs(vibration(y[s.output], demo.FS)).max() > 1e-3 * np.abs(y.y).max()
    # as stimlib verify reads it from the sidecar
    motion = {n: parse_motion(repr(m)) for n, m in s.motion.items()}
    assert motion == s.motion
    let_go = np.arange(4.5, demo.SECONDS, 1 / demo.FS)
    assert len({m(let_go).tobytes() for m in motion.values()}) == len(motion), (
        "each encoder toggles on its own"
    )


@pytest.mark.parametrize("command", ["render --out a.wav", "play --fast"])
def test_outputs_in_different_units_are_told_the_option_that_has_both(
    own, tmp_path, monkeypatch, command
):
    monkeypatch.chdir(tmp_path)
    name, *words = command.split()
    words += ["--motion", "sinusoid(0.001, 1)", "--seconds", "0.1", "--full-scale", "2"]
    ran([name, "own.py:two", *words], 2, "on the command line --full-scale force=..,place=..")


def test_a_file_that_two_options_name_is_run_once(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (
        "import stimlib\nprint('ran')\n\ndef tone():\n    return stimlib.Scene({'y':"
        " stimlib.Input('x', 'm')})\n\n@stimlib.sweep.measure(unit='m')\ndef peak(r):\n    return"
        " float(r['y'].max())\n"
    )
    (tmp_path / "run_once.py").write_text(text)
    words = "sweep run_once.py:tone --measure run_once.py:peak --motion minimum_jerk()"
    done = ran([*words.split(), "--seconds", "0.1", "--axis", "seed=1,2", "--dry"])
    assert done.stdout.count("ran") == 1
    (tmp_path / "run_once.py").write_text(text.replace("'ran'", "'ran again'"))
    assert ran(["show", "run_once.py:tone"]).stdout.count("ran again") == 1
