"""Processes killed outright, at random moments: what they leave reads and is right up
to its end, seconds before the kill.
"""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile as sf
from commands import ran
from laws import STRESS
from refusals import refused

import stimlib
from stimlib import Input, Scene, constant
from stimlib.blocks import white_noise
from stimlib.checks.session import verify_log
from stimlib.devices.null import NullSink
from stimlib.errors import SinkError
from stimlib.files import audio as file, commit
from stimlib.files.commit import recover
from stimlib.files.formats import FORMATS
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import delivered, replay
from stimlib.files.log_writer import LogWriter, header
from stimlib.motion.generators import sinusoid
from stimlib.run.safety import GAIN, Safety, protect, to_device

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
KINDS = [(f, s) for f, subtypes in FORMATS.items() for s in subtypes]
HAND = sinusoid(0.02, 3.0)
RNG = random.Random(7)
KILLS = 20 if STRESS else 1
QUICK = [
    ("RF64", "DOUBLE"),
    ("WAV", "FLOAT"),
    ("W64", "FLOAT"),
    ("CAF", "DOUBLE"),
    ("FLAC", "PCM_24"),
    ("WAV", "PCM_16"),
]  # each format, each subtype


def scene():
    force = constant(1000.0, "N/m") * Input("x", "m")
    return Scene({"force": force, "noisy": force + constant(5.0, "N") * white_noise(seed=7)})


def child(call, *args):
    """A function of this file in a process of its own, which says when it begins and
    how far it is.
    """
    me = Path(__file__)
    code = (
        f"import sys; sys.path[:0] = {[str(p) for p in me.parents[:2]]}; import {me.stem} as t;"
        f" t.{call.__name__}(*{args!r})"
    )
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)


def killed_after(seconds, call, *args):
    """Run it, kill it so many seconds after it began, and give the last number it
    said.
    """
    with child(call, *args) as job:
        try:
            assert job.stdout.readline() == "go\n"
            time.sleep(seconds)
            assert job.poll() is None, "it ended before it was killed"
        finally:
            job.kill()
        said = job.stdout.read().splitlines(keepends=True)
        assert job.wait() == -signal.SIGKILL
    whole = [int(line) for line in said if line.endswith("\n")]
    return whole[-1] if whole else 0


# -- the file sink


def write_at_pace(path, subtype, fs, pace):
    """A file at pace times real time; says the samples that the motion was asked
    for.
    """
    proc = stimlib.compile(scene(), fs, seed=3)
    proc.process(np.zeros((1, 0)))
    began = time.monotonic()

    def x(t):
        print(round(t[0] * fs), flush=True)  # all before is written
        time.sleep(max(0.0, began + t[-1] / pace - time.monotonic()))
        return HAND(t)

    print("go", flush=True)
    file.write(path, proc, {"x": x}, 3600.0, subtype=subtype, full_scale=64.0, block=8192)


@pytest.mark.parametrize(
    ("format", "subtype"),
    [kind if kind in QUICK else pytest.param(*kind, marks=pytest.mark.stress) for kind in KINDS],
)
@pytest.mark.longer
def test_a_killed_run_leaves_a_file_that_is_recovered(tmp_path, format, subtype):
    path = tmp_path / f"a.{format.lower()}"
    for fs in (8000.0, 1000.0) if STRESS else (1000.0,) if format == "FLAC" else (8000.0,):
        asked = killed_after(RNG.uniform(0.5, 0.8), write_at_pace, str(path), subtype, fs, 20.0)
        left = {path.name + ".part", path.name + ".part.json"} | (
            {path.name + ".new.part"} if format == "FLAC" else set()
        )
        assert {p.name for p in tmp_path.iterdir()} == left
        refused(
            SinkError,
            f"a run that was killed left {path.name}.part: try stimlib recover",
            file.read,
            path,
        )
        report = recover(path)
        assert {p.name for p in tmp_path.iterdir()} == {path.name, path.name + ".json"}
        y, sidecar = file.read(path)
        n = y.shape[1]
        # the block in the making is lost, and two before
        assert report.frames == n and -2 * fs <= n - asked <= fs, (asked, n)
        assert sidecar["recovered"] == {"frames": round(3600 * fs)} and sidecar["sha256"] is None
        whole = tmp_path / f"b.{format.lower()}"
        again = file.write(
            whole,
            stimlib.compile(scene(), fs, seed=3),
            {"x": HAND},
            n / fs,
            subtype=subtype,
            full_scale=64.0,
        )
        assert whole.read_bytes() == path.read_bytes() and np.array_equal(file.read(whole)[0], y)
        assert report.peak == pytest.approx(
            again.peak, rel=1e-6, abs=64.0 * 2**-16 if subtype == "PCM_16" else 0.0
        )
        assert report.clips == dict.fromkeys(report.clips, None if subtype.startswith("PCM") else 0)
        assert stimlib.verify(scene(), {"x": HAND}, path).passed
        for p in tmp_path.iterdir():
            p.unlink()


def write_fast(path, subtype):
    proc = stimlib.compile(scene(), 8000.0, seed=3)
    print("go", flush=True)
    for _ in range(1000):
        proc.reset()
        file.write(path, proc, {"x": HAND}, 20.0, subtype=subtype, full_scale=64.0)


@pytest.mark.parametrize(
    ("format", "subtype"), [("WAV", "FLOAT"), ("RF64", "DOUBLE"), ("FLAC", "PCM_24")]
)
@pytest.mark.longer
def test_whenever_it_is_killed_the_pair_is_whole_or_recovered(tmp_path, format, subtype):
    wanted = tmp_path / f"wanted.{format.lower()}"
    file.write(
        wanted,
        stimlib.compile(scene(), 8000.0, seed=3),
        {"x": HAND},
        20.0,
        subtype=subtype,
        full_scale=64.0,
    )
    y, _ = file.read(wanted)
    for trial in range(KILLS):
        path = tmp_path / f"{trial}.{format.lower()}"
        killed_after(RNG.uniform(0.0, 0.3), write_fast, str(path), subtype)
        try:
            got = file.read(path)[0]
        except SinkError as e:
            if "recover" not in str(e):  # killed before there was a file to put samples into
                assert "there is no file" in str(e) and not {path.name, f"{path.name}.part"} & set(
                    os.listdir(tmp_path)
                )
                continue
            try:
                recover(path, overwrite=True)
            except SinkError as none:  # killed before its first sample
                assert "nothing to recover" in str(none)
                continue
            got = file.read(path)[0]
        assert np.array_equal(got, y[:, : got.shape[1]])


def begin(path):
    """Stop where NAME.part.json is there, and nothing else yet."""
    commit._draft = lambda *_: print("there", flush=True) or time.sleep(600)
    print("go", flush=True)
    file.write(path, stimlib.compile(scene(), 8000.0), {"x": HAND}, 0.5, full_scale=64.0)


@pytest.mark.parametrize("suffix", ["rf64", "flac"])
def test_a_run_killed_before_its_first_sample_has_left_nothing_to_recover(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    with child(begin, str(path)) as job:
        try:
            assert [job.stdout.readline() for _ in range(2)] == ["go\n", "there\n"]
        finally:
            job.kill()
    assert os.listdir(tmp_path) == [f"{path.name}.part.json"]
    refused(SinkError, f"there is no file .*{path.name}$", file.read, path)
    refused(SinkError, f"nothing to recover: there is no .*{path.name}.part$", recover, path)
    file.write(path, stimlib.compile(scene(), 8000.0), {"x": HAND}, 0.5, full_scale=64.0)
    assert set(os.listdir(tmp_path)) == {path.name, f"{path.name}.json"}


def leave(path, frames=4000):
    """What a killed run leaves, without killing one."""

    def x(t):
        if t[0] * 8000 >= frames:
            while sf.info(f"{path}.part").frames < frames:  # other threads are writing it
                time.sleep(0.001)
            print("there", flush=True)
            time.sleep(600)
        return HAND(t)

    print("go", flush=True)
    file.write(path, stimlib.compile(scene(), 8000.0), {"x": x}, 10.0, subtype="DOUBLE", block=1000)


def test_recover_leaves_alone_what_is_not_its_own(tmp_path, capsys):
    path = tmp_path / "a.wav"
    refused(SinkError, r"nothing to recover: there is no .*a.wav.part", recover, path)
    with child(leave, str(path)) as job:
        try:
            assert [job.stdout.readline() for _ in range(2)] == ["go\n", "there\n"]
            proc = stimlib.compile(scene(), 8000.0)
            for attempt in (
                lambda: recover(path),
                lambda: file.write(path, proc, {"x": HAND}, 0.1),
            ):
                refused(SinkError, "a.wav is being written by another run", attempt)
            assert sf.info(tmp_path / "a.wav.part").frames == 4000  # readable while it is written
        finally:
            job.kill()
    kept = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    path.write_bytes(b"mine")
    refused(SinkError, "is there already, and overwrite=False", recover, path)
    refused(SinkError, "must end in '.wav'", recover, path, tmp_path / "b.flac")
    refused(SinkError, "there is no folder", recover, path, tmp_path / "none" / "b.wav")
    assert path.read_bytes() == b"mine" and kept == {n: (tmp_path / n).read_bytes() for n in kept}

    part, told = tmp_path / "a.wav.part", tmp_path / "a.wav.part.json"
    for name, junk, says in [
        (told, b"{", "is not a sidecar that stimlib wrote"),
        (told, kept[told.name].replace(b'"fs": 8000.0', b'"fs": 4000.0'), "does not belong to"),
        (
            told,
            kept[told.name].replace(b'"fs": 8000.0', b'"fs": NaN'),
            "is not a sidecar that stimlib wrote",
        ),
        (
            told,
            kept[told.name].replace(b'"WAV"', b'["WAV"]'),
            "is not a sidecar that stimlib wrote",
        ),
        (
            told,
            kept[told.name].replace(b'"frames": 80000', b'"frames": 80'),
            "has 4000 of 80 frames",
        ),
        (part, b"", "has no samples yet, or was damaged"),
        (part, kept[part.name][:100], "nothing to recover"),
        (part, kept[part.name][:-8] + np.float64(np.nan).tobytes(), "not finite"),
    ]:
        name.write_bytes(junk)
        refused(SinkError, says, recover, path, tmp_path / "b.wav")
        name.write_bytes(kept[name.name])
        assert sorted(p.name for p in tmp_path.iterdir()) == [
            "a.wav",
            "a.wav.part",
            "a.wav.part.json",
        ]
    told.unlink()
    refused(SinkError, "has no sidecar a.wav.part.json", recover, path, tmp_path / "b.wav")
    told.write_bytes(kept[told.name])

    done = ran(["recover", str(path), "--out", str(tmp_path / "b.wav")])
    assert "4000 frames, 0.5 s" in done.output
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.wav", "b.wav", "b.wav.json"]
    wanted = stimlib.compile(scene(), 8000.0).process(HAND(np.arange(4000) / 8000)[None])
    assert np.array_equal(file.read(tmp_path / "b.wav")[0], wanted)
    ran(["recover", str(path)], 2, "nothing to recover")


def test_a_full_disk_while_recovering_loses_nothing(tmp_path, mounted):
    small = mounted("size=200k")
    path = small / "a.wav"
    with child(leave, str(path), 8000) as job:  # 128 kB
        try:
            assert [job.stdout.readline() for _ in range(2)] == ["go\n", "there\n"]
        finally:
            job.kill()
    kept = {p.name: p.read_bytes() for p in small.iterdir()}
    refused(SinkError, "No space left on device", recover, path)
    assert kept == {p.name: p.read_bytes() for p in small.iterdir()}
    assert recover(path, tmp_path / "b.wav").frames == 8000
    assert list(small.iterdir()) == []


def test_killed_between_the_two_moves(tmp_path):
    path = tmp_path / "a.wav"
    report = file.write(path, stimlib.compile(scene(), 8000.0), {"x": HAND}, 0.5)
    sidecar = report.sidecar.read_bytes()
    os.replace(report.sidecar, f"{report.sidecar}.part")
    Path(f"{path}.part.json").write_text("{}")
    refused(SinkError, "try stimlib recover", file.read, path)
    assert recover(path) == report
    assert report.sidecar.read_bytes() == sidecar and {p.name for p in tmp_path.iterdir()} == {
        "a.wav",
        "a.wav.json",
    }


def test_a_new_run_takes_the_place_of_what_was_left(tmp_path):
    path = tmp_path / "a.flac"
    for p in (".part", ".part.json", ".new.part", ".json.part"):
        Path(f"{path}{p}").write_bytes(b"left")
    file.write(path, stimlib.compile(scene(), 8000.0), {"x": HAND}, 0.5, full_scale=64.0)
    assert file.read(path)[0].shape == (2, 4000) and {p.name for p in tmp_path.iterdir()} == {
        "a.flac",
        "a.flac.json",
    }


@pytest.mark.stress  # writes 4.4 GB
@pytest.mark.parametrize("format", ["rf64", "w64", "caf"])
def test_more_than_4_gib_is_exact(tmp_path, format):
    """Every sample, in the finished file; and what a killed run would leave beyond 4
    GiB.
    """
    x, path = Input("x", "m"), tmp_path / f"a.{format}"
    gain = [constant(1.0 + c, "N/m") * x for c in range(16)]
    proc = stimlib.compile(Scene({f"force{c}": g for c, g in enumerate(gain)}), 8000.0)
    frames = 2**32 // (16 * 8) + 100_000
    seen = []

    def ramp(t):
        at = round(t[0] * 8000)
        if at > 2**32 // 128 + 50_000:
            seen.append(at - sf.info(f"{path}.part").frames)  # what is still on its way to the file
        return t

    try:
        report = file.write(path, proc, {"x": ramp}, frames / 8000, subtype="DOUBLE", block=8192)
        assert report.frames == frames and path.stat().st_size > 2**32 and len(seen) > 5
        assert 0 <= min(seen) and max(seen) <= 3 * 8000 + 8192, seen
        gains = 1.0 + np.arange(16)
        with sf.SoundFile(path) as f:
            assert f.frames == frames
            at = 0
            for y in f.blocks(1 << 16):
                assert np.array_equal(y, (np.arange(at, at + len(y)) / 8000)[:, None] * gains)
                at += len(y)
            assert at == frames
    finally:
        for p in tmp_path.iterdir():
            p.unlink()


# -- the log


def session(folder, inputs):
    """A session at the pace of the clock, in odd blocks, with changes and losses; says
    the samples delivered.
    """
    made = (
        stimlib.scenes.squeeze(fingers=2)
        if inputs
        else Scene({"noise": constant(3.0, "N") * white_noise(seed=1)})
    )
    safety, rng = Safety(full_scale=50.0), np.random.default_rng(3)
    proc = stimlib.compile(protect(made, safety), 8000.0, seed=4)
    channels = list(range(len(proc.outputs)))
    proc.process(np.zeros((len(proc.inputs), 0)))
    with LogWriter(folder, header(made, safety, 8000.0, seed=4)) as log:
        proc.set(GAIN, 1.0, 160 / 8000)
        log.event(0, "set", name=GAIN, value=1.0, ramp=160)
        print("go", flush=True)
        began, at = time.monotonic(), 0
        while True:
            n = int(rng.integers(1, 200))
            time.sleep(max(0.0, began + (at + n) / 8000 - time.monotonic()))
            if inputs and rng.random() < 0.1:
                value, ramp = float(rng.uniform(500, 2000)), int(rng.integers(1, 400))
                proc.set("k", value, ramp / 8000)
                log.event(at, "set", name="k", value=value, ramp=ramp)
            x = (
                np.stack([HAND(np.arange(at, at + n) / 8000) + 0.03] * len(proc.inputs))
                if inputs
                else np.empty((0, n))
            )
            log.motion(x)
            frames = to_device(proc.process(x), safety.scales(proc.outputs), channels)
            if rng.random() < 0.05:
                log.event(at, "lost", frames=n)
            else:
                log.delivered(frames)
            at += n
            print(at, flush=True)


def play(folder):
    """A real sink at the pace of the clock."""
    hand = {"x1": HAND, "x2": HAND}
    with NullSink(
        stimlib.scenes.squeeze(), 50.0, realtime=False, motion=hand, log=folder, seed=4
    ) as sink:
        sink.open(8000, block=64)
        print("go", flush=True)
        sink.start()
        while True:
            sink.set("k", float(RNG.uniform(500, 2000)), ramp=RNG.uniform(0, 0.1))
            time.sleep(RNG.uniform(0, 0.1))
            print(sink.report().produced, flush=True)


@pytest.mark.longer
def test_a_killed_sink_leaves_a_log_that_is_verified(tmp_path):
    for trial in range(KILLS):
        folder = tmp_path / f"{trial}.stimlog"
        played = killed_after(RNG.uniform(0.3, 0.6), play, str(folder))
        log = read_log(folder)
        found = replay(log)
        assert found.matches and found.missing == 0, str(found)
        assert played - found.frames <= 8000, (played, found.frames)
        if found.frames:
            report = verify_log(log, stimlib.scenes.squeeze())
            assert report.passed, str(report)


@pytest.mark.parametrize("inputs", [True, False])
@pytest.mark.longer
def test_a_killed_session_replays_up_to_its_last_second(tmp_path, inputs):
    for trial in range(KILLS):
        folder = tmp_path / f"{trial}.stimlog"
        played = killed_after(RNG.uniform(0.3, 1.5), session, str(folder), inputs)
        log = read_log(folder)
        found = replay(log)
        assert found.matches and found.spans == len(log.spans), str(found)
        assert 0 <= played - found.frames <= 8000 * 0.26 + 400 or found.frames > played
        assert log.report is None and "no report: the session was killed" in " ".join(log.notes)
        if inputs:
            assert any(c.name == "k" for c in log.changes) or found.frames < 4000
            assert np.array_equal(log.motion[:, 0], HAND(np.arange(len(log.motion)) / 8000) + 0.03)
            assert len(log.motion) >= played
        assert sum(len(f) for _, f, given in delivered(log) if given) == found.frames - found.lost
