"""``stimlib live``: what its options come to, and what it says where it cannot."""

import importlib
import re
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest
from commands import ran
from refusals import refused

from stimlib.errors import MissingPackage
from stimlib.live.server import Server

SCENE = """
from stimlib import Input, Param, Scene
scene = Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m") * Input("contact")})
"""


WORDS = "live live_spring.py:scene --no-browser --fs 1000"


@pytest.fixture
def served(tmp_path, monkeypatch):
    """The servers that a command would run."""
    made = []
    monkeypatch.setattr(Server, "run", lambda self: made.append(self))
    (tmp_path / "live_spring.py").write_text(SCENE)
    monkeypatch.chdir(tmp_path)
    yield made
    for server in made:
        server._socket.close()


def test_the_options_come_to_a_server(served):
    hand = "--range x=0:0.02 --motion x=sinusoid(0.01,1,mean=0.01)"
    done = ran(f"{WORDS} {hand} --set k=1500 --block 10 --slew 9")
    (server,) = served
    stream, sources = server.stream, server.stream.inputs.sources
    assert done.stdout == server.url + "\n"
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/#[\w-]{32}", server.url)
    assert (sources["x"]["from"], sources["contact"]["from"]) == ("given", "contact")
    x = stream.inputs.columns(0, 500)[0, -1]
    assert x == pytest.approx(0.01 + 0.01 * np.sin(2 * np.pi * 0.499))
    assert (stream.params, stream.block) == ({"k": 1500.0}, 10)
    # 2 * 2000 N/m * 0.02 m = 80 N
    assert stream.safety.full_scale == {"force": 100.0} and stream.safety.slew == 9.0
    assert stream.ranges["x"] == (0.0, 0.02) and "network" not in done.stderr


def test_a_recorded_hand_is_given_with_its_contact_and_stands_still_when_it_is_over(
    served, tmp_path
):
    rows = "".join(f"{0.01 * k:.2f},{0.1 * k:.1f}\n" for k in range(21))
    (tmp_path / "hand.csv").write_text(f"t_s,pos_mm\n{rows}")
    ran(f"{WORDS} --motion x=hand.csv --map x=pos_mm*1e-3 --full-scale 50")
    inputs = served[0].stream.inputs
    assert {source["from"] for source in inputs.sources.values()} == {"given"}
    x, contact = inputs.columns(0, 300)
    assert x[[50, 150, 299]] == pytest.approx([0.0005, 0.0015, 0.002], abs=1e-9) and contact.all()


def test_an_open_host_warns(served):
    warns = "anybody who has the address below can drive the scene"
    ran(f"{WORDS} --host 0.0.0.0 --full-scale 50", says=warns)
    (server,) = served
    assert not server.private and server._known(f"192.168.1.7:{server.port}")
    assert not server._known(f"evil.example:{server.port}") and not server._known("192.168.1.7:1")


@pytest.mark.parametrize(
    "words, why",
    [
        ("--range x", "--range x: write NAME=LOW:HIGH"),
        ("--range x=0:a", "'a' is not a number"),
        ("--range z=0:1", "--range: there is no input or parameter 'z'; there are x, contact, k"),
        ("--set k=1e9", "outside its range, 0 to 5000; --range k=LOW:HIGH"),
        ("--folder nowhere", "--folder nowhere: there is no such folder"),
        ("--host 192.0.2.1 --full-scale 50", "cannot listen at 192.0.2.1"),
        ("--smooth 600 --full-scale 50", "give at most 250 Hz"),
        ("--block 500 --full-scale 50", "blocks of 500 frames"),  # before a page is served
    ],
)
def test_what_cannot_be_is_said_in_a_line(served, words, why):
    ran(f"{WORDS} {words}", 2, why)
    assert not served


def test_without_its_packages_it_says_how_to_get_them(monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    monkeypatch.delitem(sys.modules, "stimlib.live.server")
    says = r"needs the package uvicorn.*pip install 'stimlib\[live\]'"
    refused(MissingPackage, says, importlib.import_module, "stimlib.live.server")


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
    _, said = process.communicate()
    assert process.returncode == code and "Traceback" not in said
    assert ("faded out" in said) == (code == 130)
