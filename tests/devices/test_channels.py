"""Channels that carry nothing, as in front of a game controller's actuators: by the
command, on devices of four channels.
"""

import json

import numpy as np
import pytest
from commands import ran, refuses
from devices.servers import Capture, Jackd, needs_jack
from devices.stands import alsa, from_file, needs_portaudio, portaudio

import stimlib

FS = 8000
SCENE = """
import stimlib
from stimlib.blocks import oscillator

scene = stimlib.Scene({"left": 0.5 * oscillator(80.0), "right": 0.25 * oscillator(120.0)})
"""
WORDS = "--fs 8000 --seconds 0.3 --full-scale 1 --channels none,none,left,right"


def played(folder, words):
    """Play the scene by the command; its rendering, as frames of four channels."""
    own, log, made = folder / "own.py", folder / "a.stimlog", {}
    own.write_text(SCENE)
    ran(["play", f"{own}:scene", *WORDS.split(), "--log", log, *words])
    ran(["replay", log])
    told = json.loads((log / "session.json").read_text())
    assert told["channels"] == [None, None, "left", "right"]
    exec(SCENE, made)
    both = stimlib.render(made["scene"], fs=FS, seconds=0.3)
    silent = np.zeros(len(both["left"]))
    return np.stack([silent, silent, both["left"], both["right"]], axis=1).astype(np.float32)


@pytest.mark.parametrize("words", ["--fast", "--sink null"])
def test_the_null_device_logs_and_replays_them(tmp_path, words):
    played(tmp_path, words.split())


@needs_portaudio()
def test_a_file_of_alsa_has_them_silent(tmp_path):
    with portaudio(alsa(tmp_path)):
        expected = played(tmp_path, "--sink portaudio --device stimfile --fast".split())
    frames = from_file(tmp_path, 4)
    assert not frames[:, :2].any()
    first, start = (int(np.flatnonzero(a.any(axis=1))[0]) for a in (expected, frames))
    assert np.array_equal(frames[start - first :][: len(expected)], expected)


@needs_jack
@needs_portaudio()
@pytest.mark.parametrize("kind", ["jack", "portaudio"])
def test_a_server_has_ports_for_them(tmp_path, kind):
    with (
        Jackd(FS, 64) as server,
        portaudio({"JACK_DEFAULT_SERVER": server.name}),
        Capture(server.name, 4, 60 * FS) as capture,
    ):
        words = ["--device", "system"]
        if kind == "jack":
            words = ["--device", server.name]
            for name in capture.names:
                words += ["--connect", name]
        expected = played(tmp_path, ["--sink", kind, *words])
        frames = capture.frames.copy()
    assert not frames[:, :2].any()
    if kind == "jack":  # PortAudio's ports go to the physical ones alone
        assert frames[:, 2:].any(axis=0).all()
        heard, wanted = ({tuple(row) for row in a.tolist()} for a in (frames, expected))
        assert len(heard & wanted) > 0.5 * len(wanted)


def test_a_channel_of_no_output_is_refused(tmp_path):
    (tmp_path / "own.py").write_text(SCENE)
    words = ["--fast", "--full-scale", "1", "--channels", "none,middle"]
    refuses(["play", f"{tmp_path}/own.py:scene", *words], "middle")
