"""``stimlib live``: what its options come to, and what it says where it cannot."""

import importlib
import re
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest
from typer.testing import CliRunner

from stimlib.cli import app
from stimlib.errors import MissingPackage
from stimlib.live.server import Server

SCENE = """
from stimlib import Input, Param, Scene
scene = Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m") * Input("contact")})
"""


@pytest.fixture
def live(tmp_path, monkeypatch):
    """Runs the command up to where it would serve; the server is in ``served``."""
    served = []
    monkeypatch.setattr(Server, "run", lambda self: served.append(self))
    (tmp_path / "live_spring.py").write_text(SCENE)
    monkeypatch.chdir(tmp_path)

    def run(*words):
        return CliRunner().invoke(
            app, ["live", "live_spring.py:scene", "--no-browser", "--fs", "1000", *words]
        )

    yield run, served
    for server in served:
        server._socket.close()


def test_the_options_come_to_a_server(live, tmp_path):
    run, served = live
    done = run(
        "--range",
        "x=0:0.02",
        "--motion",
        "x=sinusoid(0.01, 1, mean=0.01)",
        "--set",
        "k=1500",
        "--block",
        "10",
        "--slew",
        "9",
    )
    assert done.exit_code == 0, done.output
    (server,) = served
    stream = server.stream
    assert done.stdout == server.url + "\n" and re.fullmatch(
        r"http://127\.0\.0\.1:\d+/#[\w-]{32}", server.url
    )
    assert (
        stream.inputs.sources["x"]["from"] == "given"
        and stream.inputs.sources["contact"]["from"] == "contact"
    )
    assert stream.inputs.columns(0, 500)[0, -1] == pytest.approx(
        0.01 + 0.01 * np.sin(2 * np.pi * 0.499)
    )
    assert (
        stream.params == {"k": 1500.0} and stream.block == 10 and stream.ranges["x"] == (0.0, 0.02)
    )
    # 2 * 2000 N/m * 0.02 m = 80 N
    assert stream.safety.full_scale == {"force": 100.0} and stream.safety.slew == 9.0
    assert "others" not in done.stderr and "network" not in done.stderr


def test_a_recorded_hand_is_given_with_its_contact_and_stands_still_when_it_is_over(live, tmp_path):
    run, served = live
    (tmp_path / "hand.csv").write_text(
        "t_s,pos_mm\n" + "".join(f"{0.01 * k:.2f},{0.1 * k:.1f}\n" for k in range(21))
    )
    done = run("--motion", "x=hand.csv", "--map", "x=pos_mm*1e-3", "--full-scale", "50")
    assert done.exit_code == 0, done.output
    inputs = served[0].stream.inputs
    assert {source["from"] for source in inputs.sources.values()} == {"given"}
    x, contact = inputs.columns(0, 300)
    assert x[[50, 150, 299]] == pytest.approx([0.0005, 0.0015, 0.002], abs=1e-9) and contact.all()


def test_an_open_host_warns(live):
    run, served = live
    done = run("--host", "0.0.0.0", "--full-scale", "50")
    assert (
        done.exit_code == 0
        and "anybody who has the address below can drive the scene"
        in done.stderr.replace("\n", " ")
    )
    assert not served[0].private and served[0]._known(f"192.168.1.7:{served[0].port}")
    assert not served[0]._known(f"evil.example:{served[0].port}") and not served[0]._known(
        "192.168.1.7:1"
    )


@pytest.mark.parametrize(
    "words, why",
    [
        (["--range", "x"], "--range x: write NAME=LOW:HIGH"),
        (["--range", "x=0:a"], "'a' is not a number"),
        (["--range", "z=0:1"], "range of z: the scene has x, contact, k"),
        (["--set", "k=1e9"], "k = 1e+09 is outside its range, 0 to 5000; --range k=LOW:HIGH"),
        (["--folder", "nowhere"], "--folder nowhere: there is no such folder"),
        (["--host", "192.0.2.1", "--full-scale", "50"], "cannot listen at 192.0.2.1"),
        (["--smooth", "600", "--full-scale", "50"], "bandwidth = 600 Hz does not fit below fs/2"),
    ],
)
def test_what_cannot_be_is_said_in_a_line(live, words, why):
    done = live[0](*words)
    assert done.exit_code == 2 and why in done.stderr and not live[1]


def test_without_its_packages_it_says_how_to_get_them(monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    monkeypatch.delitem(sys.modules, "stimlib.live.server")
    with pytest.raises(
        MissingPackage,
        match=r"the live page needs the package uvicorn.*pip install 'stimlib\[live\]'",
    ):
        importlib.import_module("stimlib.live.server")


@pytest.mark.stress  # a process each
@pytest.mark.parametrize(
    "sent, code", [(["SIGINT"], 130), (["SIGINT", "SIGINT"], 130), (["SIGHUP"], -15)]
)
def test_ctrl_c_or_a_closed_terminal_ends_the_command(tmp_path, sent, code):
    (tmp_path / "live_spring.py").write_text(SCENE)
    words = [sys.executable, "-m", "stimlib", "live", "live_spring.py:scene", "--no-browser"]
    process = subprocess.Popen(
        words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    url = process.stdout.readline().strip()
    assert url.startswith("http://127.0.0.1:")
    urllib.request.urlopen(url).close()  # it serves
    for name in sent:
        process.send_signal(getattr(signal, name))
    _, said = process.communicate(timeout=30)
    assert process.returncode == code and "Traceback" not in said
    assert ("faded out" in said) == (code == 130)
