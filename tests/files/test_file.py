"""The file sink: exact samples, the same bytes every time, and never half a file."""

import errno
import gc
import hashlib
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
import soundfile as sf
from laws import STRESS, mostly
from memory import most_memory
from refusals import largest_file, refused

import stimlib
from stimlib import (
    BadValue,
    FaultError,
    Input,
    Param,
    Scene,
    SinkError,
    UnitError,
    UnknownName,
    constant,
)
from stimlib.blocks import lut, sqrt, white_noise
from stimlib.files import audio as file, formats
from stimlib.files.formats import BITS, FORMATS
from stimlib.motion.generators import minimum_jerk, sinusoid

KINDS = [(f, s) for f, subtypes in FORMATS.items() for s in subtypes]
MOTION = {"x": sinusoid(0.02, 3.0)}


def forces(channels=1, fs=8000.0, noise=5.0):
    """Every output is a spring and a noise of its own; a processor counts its samples
    in ``index``.
    """
    spring = constant(1000.0, "N/m") * Input("x", "m")
    outputs = {
        f"force{c}": spring + constant(noise, "N") * white_noise(seed=7, stream=c)
        for c in range(channels)
    }
    return stimlib.compile(Scene(outputs), fs)


def expected(y, scale, subtype):
    if subtype in BITS:
        top = 2.0 ** (BITS[subtype] - 1)
        return np.clip(np.rint(y / scale * top), -top, top - 1) / top * scale
    return (y / scale).astype(np.float32 if subtype == "FLOAT" else np.float64).astype(
        np.float64
    ) * scale


def listing(folder):
    return {p.name: p.is_file() and p.read_bytes() for p in Path(folder).iterdir()}


def unwritten(folder, error, says, *args, **how):
    """The error of ``file.write``, which says this and leaves the folder as it was."""
    before = listing(folder)
    told = refused(error, re.escape(says) or None, file.write, *args, **how)
    assert listing(folder) == before
    return told


# -- samples


@pytest.mark.parametrize(
    ("kind", "channels", "scale"),
    [*zip(KINDS, cycle([1, 2, 8]), cycle([1.0, 64.0, 50.3, 1.0]), strict=False)],
)
def test_round_trip_is_exact(tmp_path, kind, channels, scale):
    """Each kind, with one number of channels and one full scale."""
    format, subtype = kind
    path = tmp_path / f"a.{format.lower()}"
    report = file.write(
        path, forces(channels), MOTION, 0.77, subtype=subtype, full_scale=scale, block=1000
    )
    y = forces(channels).process(MOTION["x"](np.arange(6160) / 8000.0)[None])
    got, sidecar = file.read(path)
    assert got.dtype == np.float64 and got.shape == (channels, 6160) and got.flags.c_contiguous
    assert np.array_equal(got, expected(y, scale, subtype))
    raw, fs = sf.read(path, always_2d=True)  # an independent reading
    assert fs == 8000 and np.array_equal(raw.T * scale, got)
    assert (sf.info(path).format, sf.info(path).subtype) == kind
    assert report.frames == 6160 and report.seconds == 0.77
    assert list(report.peak.values()) == np.abs(y).max(axis=1).tolist()
    top = 2.0 ** (BITS.get(subtype, 2) - 1)
    over = (np.rint(y / scale * top) > top - 1) | (np.rint(y / scale * top) < -top)
    over &= subtype in BITS
    assert list(report.clips.values()) == over.sum(axis=1).tolist()
    told = [(c["name"], c["clips"], c["peak"]) for c in sidecar["channels"]]
    assert told == [(name, report.clips[name], report.peak[name]) for name in report.clips]
    with sf.SoundFile(path) as sound:
        told = "; ".join(f"{name} [N]: 1.0 is {scale}" for name in report.peak)
        assert sound.comment == ("" if format == "W64" else told)
    assert sidecar["sha256"] == hashlib.sha256(y.T.astype("<f8").tobytes()).hexdigest()
    assert sidecar["file_sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert set(listing(tmp_path)) == {path.name, path.name + ".json"}


def test_neither_the_size_of_blocks_nor_the_time_changes_a_byte(tmp_path):
    """In other processes: tests/files/test_batch.py."""
    kinds, found = [(*kind, None) for kind in KINDS] + [("WAV", "PCM_16", 5)], []
    for block in (7, 64, 10**6):
        for format, subtype, dither in kinds:
            path = tmp_path / f"{subtype}{dither}.{format.lower()}"
            how = {"subtype": subtype, "dither": dither, "full_scale": 64.0, "block": block}
            file.write(path, forces(2), MOTION, 0.1, **how)
        found.append(listing(tmp_path))
        time.sleep(0.6)  # the time stamp that libsndfile would write counts seconds
    assert found[0] == found[1] == found[2]


def test_dither_makes_the_error_a_steady_noise_and_is_made_again(tmp_path):
    """A ramp of two steps is stairs without dither; with it the mean is the ramp."""
    step, path = 64.0 * 2**-15, tmp_path / "a.wav"
    scene, x = Scene({"y": 1 * Input("y")}), np.linspace(0, 2 * step, 64_000)
    how = {"subtype": "PCM_16", "full_scale": 64.0}
    for dither, error, apart in ((None, 1 / 12, 0.4), (7, 1 / 4, 0.02)):
        file.write(path, stimlib.compile(scene, 8000), {"y": x}, 8.0, dither=dither, **how)
        lost = (file.read(path)[0][0] - x) / step
        assert np.var(lost) == pytest.approx(error, rel=0.03)
        assert (np.abs(lost.reshape(-1, 4000).mean(axis=1)).max() > apart) == (dither is None)
    sidecar = path.with_name("a.wav.json")
    for seed in (7, 8):
        sidecar.write_text(sidecar.read_text().replace('"dither": 7', f'"dither": {seed}'))
        passed = {c.name for c in stimlib.verify(scene, {"y": x}, path).checks if c.passed}
        assert ("file = re-render as PCM_16" in passed) == (seed == 7)


@pytest.mark.parametrize("bits", [16, 24])
def test_a_code_is_the_nearest_even_one_and_stays_at_its_end(bits):
    """Each alone: 2^15 would be -2^15 in 16 bits."""
    top, most = 2 ** (bits - 1), 2 ** (bits - 1) - 1
    for value, code in [(0.5, 0), (1.5, 2), (-2.5, -2), (most, most), (most - 0.25, most)] + [
        *((beyond, most) for beyond in (most + 0.5, top, 1.5 * top, 1e300)),
        *((beyond, -top) for beyond in (-top, -top - 1, -1.5 * top, -1.7e308)),
    ]:
        y = np.array([[0.25, value / top], [0.5, 0.0]])
        made, limited = formats.encode(y, np.ones(2), f"PCM_{bits}", ("a", "b"))
        assert (made >> (32 - bits)).tolist() == [[top // 4, top // 2], [code, 0]], value
        assert limited.tolist() == [abs(value - code) > 0.5 or value == most + 0.5, 0], value


def copies(*names):
    """The outputs are the inputs."""
    return stimlib.compile(Scene({f"{n}_out": Input(n, "N") for n in names}), 8000.0)


MOST = np.finfo(float).max


@pytest.mark.parametrize(
    ("x", "subtype", "scale"),
    [([3.0, -70.0, 1e30, 1e-30], "FLOAT", 1.0), ([0.0, -MOST, MOST], "DOUBLE", 2.0**1023)],
)
def test_floats_are_not_clipped(tmp_path, x, subtype, scale):
    how = {"subtype": subtype, "full_scale": scale}
    report = file.write(tmp_path / "a.wav", copies("x"), {"x": x}, len(x) / 8000, **how)
    assert report.clips == {"x_out": 0} and report.peak == {"x_out": max(np.abs(x))}
    assert file.read(tmp_path / "a.wav")[0].tolist() == [
        expected(np.array(x), scale, subtype).tolist()
    ]


def test_inputs_and_outputs_have_their_rows_and_no_input_is_possible(tmp_path):
    scene = {"force": 1.0 * Input("a", "N"), "drive": 1.0 * Input("b", "V")}
    how = {"subtype": "DOUBLE", "full_scale": {"drive": np.float32(64.0), "force": 32}}
    motion = {"b": np.ma.array([2.1] * 8), "a": lambda t: 1.1 + 0.0 * t}
    file.write(tmp_path / "a.w64", stimlib.compile(Scene(scene), 8000), motion, 1e-3, **how)
    y, sidecar = file.read(tmp_path / "a.w64")
    assert y[:, 0].tolist() == [1.1, 2.1] and sidecar["motion"]["b"] == "array(8)"
    channels = [(c["name"], c["unit"], c["full_scale"]) for c in sidecar["channels"]]
    assert channels == [("force", "N", 32.0), ("drive", "V", 64.0)]
    proc = stimlib.compile(Scene({"noise": white_noise(seed=1)}), 8000)
    file.write(tmp_path / "b.w64", proc, {}, 0.1, subtype="DOUBLE")
    y, sidecar = file.read(tmp_path / "b.w64")
    proc.reset()
    assert np.array_equal(y, proc.process(np.empty((0, 800)))) and sidecar["motion"] == {}


def test_a_motion_sees_exact_times_once_and_cannot_spoil_them(tmp_path):
    seen = []

    def motion(t):
        seen.append(t.copy())
        t += 1.0
        return t

    hands = {"x": motion, "y": motion, "z": lambda t: motion(t)}
    file.write(tmp_path / "a.wav", copies(*hands), hands, 0.1, block=300)
    for times in (seen[::2], seen[1::2]):
        assert np.array_equal(np.concatenate(times), np.arange(800) / 8000)


def test_a_motion_must_set_no_parameter(tmp_path):
    """The sidecar would not have it."""
    proc = stimlib.compile(Scene({"y": Param("k", 2.0) * Input("x")}), 8000.0)

    def motion(t):
        if 0.1 <= t[0] < 0.2:
            proc.set("k", 1.0)
        return t

    words = tmp_path / "a.wav", proc, {"x": motion}, 0.4
    unwritten(tmp_path, BadValue, "parameter k was set while", *words, block=800)


def in_newtons_and_volts():
    x = Input("x", "m")
    scene = Scene({"force": constant(1000.0, "N/m") * x, "drive": constant(3.0, "V/m") * x})
    return stimlib.compile(scene, 8000)


# -- the sidecar


def test_sidecar_says_what_the_samples_are(tmp_path):
    scene = Scene({"force": Param("k", 1000, "N/m") * Input("x", "m")})
    proc = stimlib.compile(scene, 8000, seed=2**64 - 1)
    proc.process(np.zeros((1, 24)))  # it goes on from there
    proc.set("k", 1500.0)
    file.write(tmp_path / "a.wav", proc, MOTION, 0.1)
    sidecar = json.loads((tmp_path / "a.wav.json").read_text())
    packages = {"numpy", "scipy", "llvmlite", "soundfile", "libsndfile"}
    assert set(sidecar.pop("versions")) == packages
    assert sidecar["channels"][0].pop("peak") == pytest.approx(1500 * 0.02, rel=0.1)
    assert {"sha256", "file_sha256", "definitions"} <= set(sidecar)
    assert {k: v for k, v in sidecar.items() if "sha256" not in k and k != "definitions"} == {
        "stimlib": stimlib.__version__,
        "format": "WAV",
        "subtype": "FLOAT",
        "dither": None,
        "fs": 8000.0,
        "frames": 800,
        "channels": [{"name": "force", "unit": "N", "full_scale": 1.0, "clips": 0}],
        "seed": 2**64 - 1,
        "params": {"k": 1500.0},
        "index": 24,
        "log": [{"at": 24, "name": "k", "value": 1500.0, "ramp": 0.02}],
        "motion": {"x": "sinusoid(amplitude=0.02, freq=3.0, mean=0.0, phase=0.0)"},
        "scene": scene.to_dict(),
        "scene_hash": scene.hash,
    }


# -- memory, progress, imports


def test_memory_does_not_grow_with_the_duration_or_the_block(tmp_path):
    """A run that is killed loses only what was not written yet."""
    sizes, path = [], tmp_path / "a.rf64"
    hand = {"x": lambda t: (sizes.append(t.size), MOTION["x"](t))[1]}
    file.write(path, forces(), hand, 6.0)  # imports
    _, one = most_memory(file.write, path, forces(), hand, 60.0, block=8192)
    _, ten = most_memory(file.write, path, forces(), hand, 600.0, block=10**6)
    # a list of the blocks would be 40 MB more; how many wait depends on the moment
    assert ten < one + 1_000_000 and max(sizes) <= 8192, (one, ten)


def test_progress_bar_only_when_wanted(tmp_path, capsys):
    for progress in (True, False):  # stderr is not a terminal here
        file.write(tmp_path / "a.wav", forces(), MOTION, 0.1, progress=progress)
    assert capsys.readouterr() == ("", "")
    file.write(tmp_path / "a.wav", forces(), MOTION, 0.1, progress="always")
    out, err = capsys.readouterr()
    assert out == "" and "100%" in err


# -- never half a file


@pytest.fixture
def old(tmp_path):
    """A folder with a file and its sidecar that must survive."""
    for format in FORMATS:
        file.write(
            tmp_path / f"a.{format.lower()}", forces(2, noise=1.0), MOTION, 0.1, full_scale=64.0
        )
    return tmp_path


ERRORS = [
    KeyboardInterrupt(),
    SystemExit(3),
    MemoryError(),
    ValueError("mine"),
    OSError("mine"),
    TypeError("mine"),
]
ERRORS += [AssertionError("mine")]  # soundfile's own are errors of the disk


@pytest.mark.parametrize(("error", "format"), [*zip(ERRORS, cycle(FORMATS))], ids=repr)
def test_an_exception_leaves_the_old_file(old, format, error):
    path, proc = old / f"a.{format.lower()}", forces(2)

    def motion(t):
        if t[-1] >= 0.3:
            raise error
        return 0.01 * t

    how = {"full_scale": 64.0, "block": 1000}
    told = unwritten(old, BaseException, "", path, proc, {"x": motion}, 1.0, **how)
    assert isinstance(told, BadValue) == (type(error) in (ValueError, TypeError))
    # of what a motion calls
    assert error is (told.__cause__ if isinstance(told, BadValue) else told)
    assert proc.index == 2000
    file.read(path)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX timers")
# an interrupt between open() and the with statement leaves closing to the collector, in
# any Python program
@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
@pytest.mark.parametrize("format", ["RF64", "FLAC"])
def test_an_interrupt_at_any_moment_leaves_a_complete_pair(old, format):
    path, names, done = old / f"a.{format.lower()}", set(listing(old)), 0
    previous = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        for trial in range(30):
            proc = forces(2, noise=trial + 1.0)
            with suppress(KeyboardInterrupt):
                signal.setitimer(signal.ITIMER_REAL, 2e-4 + trial * 5e-4)
                file.write(path, proc, MOTION, 0.5, full_scale=64.0, block=64)
                signal.setitimer(signal.ITIMER_REAL, 0)
                done += 1
            file.read(path)
            assert set(listing(old)) == names
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
        gc.collect()  # what was left to the collector, before the next test
    assert done < 25


@pytest.mark.parametrize("moves", [0, 1, 2])
def test_an_interrupt_between_the_two_moves_leaves_a_complete_pair(old, monkeypatch, moves):
    path, before, replace, done = old / "a.wav", listing(old), os.replace, []

    def interrupted(*names):
        if moves == 0:
            raise KeyboardInterrupt
        replace(*names)
        done.append(names)
        if len(done) == moves:
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    refused(KeyboardInterrupt, None, file.write, path, forces(2), MOTION, 0.5)
    assert file.read(path)[0].shape[1] == (4000 if moves else 800)
    assert set(listing(old)) == set(before)


WRITES = f"""if True:
    import sys
    sys.path[:0] = {[str(folder) for folder in Path(__file__).parents[:2]]}
    from test_file import MOTION, file, forces
    proc = forces(2)
    print("go", flush=True)
    while True:
        proc.reset()
        file.write(sys.argv[1], proc, MOTION, 20.0, full_scale=64.0)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
@pytest.mark.parametrize("suffix", mostly([".flac"], [".flac", ".wav"]))
def test_whenever_it_is_killed_the_file_is_whole_or_refused(tmp_path, suffix):
    """At a random moment.  What a session leaves then: test_log.py."""
    words, chance = (MOTION, 20.0), random.Random(7)
    file.write(tmp_path / f"wanted{suffix}", forces(2), *words, full_scale=64.0)
    wanted, _ = file.read(tmp_path / f"wanted{suffix}")
    for trial in range(20 if STRESS else 1):
        path = tmp_path / f"{trial}{suffix}"
        command = [sys.executable, "-c", WRITES, str(path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as job:
            assert job.stdout.readline() == b"go\n"
            time.sleep(chance.uniform(0.0, 0.3))
            job.kill()
        assert job.returncode == -signal.SIGKILL, "it ended before it was killed"
        left = {p.name for p in tmp_path.glob(f"{trial}.*")} - {path.name, f"{path.name}.json"}
        assert all(re.search(r"\.\d+-[0-9a-f]{8}\.(json\.)?part$", name) for name in left)
        try:
            assert np.array_equal(file.read(path)[0], wanted)
        except SinkError as e:
            assert "there is no file" in str(e) or "sidecar" in str(e)
        file.write(path, forces(2), *words, full_scale=64.0)  # what is left is in nobody's way
        assert np.array_equal(file.read(path)[0], wanted)


def two_faults():
    t = Input("x", "m") / constant(1.0, "m")
    return stimlib.compile(Scene({"late": sqrt(0.4 - t), "early": sqrt(0.3 - t)}), 8000)


RAMP = {"x": lambda t: t}


@pytest.mark.parametrize("block", [64, 1000, 8192])
def test_a_fault_of_the_processor_leaves_the_old_file(old, block):
    path, proc, how = old / "a.wav", two_faults(), {"subtype": "DOUBLE", "block": block}
    error = unwritten(old, FaultError, "sample 2401", path, proc, RAMP, 1.0, **how)
    assert "early" in str(error) and f"{path} was not written" in str(error)
    index = proc.index
    assert proc.fault == ("early", 2401)
    # the guard stays as it is
    unwritten(old, FaultError, "stopped earlier, at sample 2401", path, proc, RAMP, 1.0, **how)
    assert proc.index == index
    proc.reset()  # up to the fault everything is fine
    file.write(path, proc, RAMP, 2401 / 8000, **how)
    assert file.read(path)[0].shape == (2, 2401)
    # samples count from the beginning of the file
    for more, says in ((0.3, "sample 1 (0.000125 s)"), (1.0, "sample 0 (0 s)")):
        later = {"x": lambda t, more=more: t + more}
        unwritten(old, FaultError, says, path, proc, later, 1.0, **how)
        proc.reset()


# libFLAC keeps up to 4096 frames until the file is closed, and libsndfile then ignores
# a full disk: so there also a few bytes too many, at the end
@pytest.mark.parametrize(
    ("name", "seconds", "lacks"),
    [*((f"a.{format.lower()}", 2.0, 50_000) for format in FORMATS)]
    + [("a.flac", seconds, lacks) for seconds in (0.5, 9 / 8) for lacks in (10, 3000)],
)
def test_a_write_that_fails_leaves_the_old_file(old, name, seconds, lacks):
    pytest.importorskip("resource", reason="needs POSIX limits")
    words = forces(2), MOTION, seconds
    file.write(old / f"whole_{name}", *words, full_scale=64.0)
    most = (old / f"whole_{name}").stat().st_size - lacks
    words[0].reset()
    with largest_file(most):
        error = unwritten(old, SinkError, str(old / name), old / name, *words, full_scale=64.0)
    assert os.strerror(errno.EFBIG) in str(error)


@pytest.mark.parametrize(("name", "seconds"), [("a.flac", 600.0), ("a.wav", 60.0), ("a.wav", 5.0)])
def test_disk_full(mounted, name, seconds):
    """In 5 s there is room for the samples, and not for the sidecar."""
    knots = np.linspace(-0.1, 0.1, 20_001 if seconds < 60 else 3)
    table = lut(Input("x", "m"), knots, np.sin(knots), unit="N")
    proc = stimlib.compile(Scene({"force": table, "twice": 2 * table}), 8000)
    folder, says = mounted("size=512k"), os.strerror(errno.ENOSPC)
    unwritten(folder, SinkError, says, *(folder / name, proc, MOTION, seconds), full_scale=1.0)


# -- refused before anything is written


def gain(k):
    return lambda: stimlib.compile(Scene({"force": constant(k, "N/m") * Input("x", "m")}), 8000)


HUGE = {"x": np.array([0.0, -np.finfo(float).max, np.finfo(float).max])}
LINUX = sys.platform == "linux"


def alike(channels, fs):
    """Every output is the same."""
    force = 1.0 * Input("x", "m")
    return stimlib.compile(Scene({f"y{c}": force for c in range(channels)}), fs)


REFUSED = [  # the change of a call that is fine, the error, and what it says
    ({"path": "a.mp3"}, SinkError, ".wav, .rf64, .w64, .caf, .flac"),
    ({"path": "a"}, SinkError, "suffix of 'a'"),
    ({"format": "ogg"}, SinkError, "format 'ogg'"),
    ({"subtype": "PCM_U8"}, SinkError, "FLOAT, DOUBLE, PCM_16, PCM_24 or PCM_32"),
    ({"path": "a.flac", "subtype": "FLOAT", "full_scale": 1.0}, SinkError, "PCM_24 or PCM_16"),
    ({"path": "none/a.wav"}, SinkError, "there is no folder"),
    ({"path": "folder.wav"}, SinkError, "is a folder"),
    *[({"path": "/proc/a.wav"}, SinkError, "/proc")] * LINUX,
    ({"overwrite": False}, SinkError, "a.wav is there already"),
    ({"path": "sidecar.wav", "overwrite": False}, SinkError, "sidecar.wav.json is there"),
    ({"path": "blocked.wav"}, SinkError, "not an ordinary file"),
    (
        {"proc": lambda: forces(8, fs=48000.0), "seconds": 1500.0, "subtype": "DOUBLE"},
        SinkError,
        "at most 4 GiB",
    ),
    *(
        (
            {"path": f"b.{format}", "proc": lambda fs=fs, n=n: alike(n, fs), "seconds": 10.0}
            | {"full_scale": 64.0},
            SinkError,
            says,
        )
        for format, fs, n, says in [
            ("wav", 8000.5, 1, "whole number"),
            ("caf", 0.5, 1, "whole number"),
            ("w64", 2.0**31, 1, "whole number"),
            ("flac", 65537.0, 1, "multiples of 10 Hz"),
            ("flac", 655360.0, 1, "multiples of 10 Hz"),
            ("flac", 8000.0, 9, "8 channels, not 9: write .wav"),
            ("rf64", 8000.0, 1025, "1024 channels, not 1025: write several files"),
            ("caf", 8000.0, 257, "256 channels, not 257: write .wav"),
        ]
    ),
    ({"proc": in_newtons_and_volts, "full_scale": 10.0}, UnitError, "force (N), drive (V)"),
    ({"proc": in_newtons_and_volts, "path": "a.flac"}, BadValue, "by name"),
    (
        {"proc": gain(1e39), "motion": RAMP, "seconds": 1.1, "block": 1000},
        SinkError,
        "output force / full_scale is too large for FLOAT",
    ),
    (
        {"proc": gain(1e300), "motion": RAMP, "full_scale": 1e-10, "subtype": "DOUBLE"},
        SinkError,
        "output force / full_scale is too large for DOUBLE",
    ),
    *(
        (
            {"proc": lambda: copies("x"), "motion": HUGE, "seconds": 3 / 8000}
            | {"subtype": subtype, "full_scale": scale},
            SinkError,
            f"too near the largest float to be read back from {subtype}",
        )
        for subtype, scale in [("FLOAT", 2.0**1000), ("DOUBLE", 1.2e308), ("DOUBLE", 3.0)]
    ),
    ({"proc": two_faults, "motion": RAMP, "seconds": 1.0}, FaultError, "early was not finite"),
    ({"motion": {}}, UnknownName, "x is missing"),
    ({"motion": {"x": minimum_jerk(), "y": minimum_jerk()}}, UnknownName, "no input y"),
    ({"motion": minimum_jerk()}, BadValue, "motion must map each input name"),
    ({"motion": {"x": np.zeros(799)}}, BadValue, "at least 800 samples; got (799,)"),
    ({"motion": {"x": np.zeros((2, 800))}}, BadValue, "one dimension"),
    ({"motion": {"x": "abc"}}, BadValue, "function of time or an array"),
    ({"motion": {"x": lambda t: t[1:]}}, BadValue, "one number per time"),
    ({"motion": {"x": lambda t: 1.0}}, BadValue, "np.full_like(t, 1.0)"),
    ({"motion": {"x": lambda t: t + 0j}}, BadValue, "complex128 out"),
    (
        {"motion": {"x": np.r_[np.zeros(500), np.nan, np.zeros(500)]}},
        BadValue,
        "not finite at sample 500 (0.0625 s)",
    ),
    ({"motion": {"x": lambda t: np.where(t > 0.05, np.inf, 0)}}, BadValue, "at sample 401"),
    ({"seconds": 0.0}, BadValue, "at least one sample"),
    ({"seconds": -1.0}, BadValue, "at least one sample"),
    ({"seconds": float("nan")}, BadValue, "finite"),
    ({"seconds": "long"}, BadValue, "seconds = 'long'"),
    ({"block": 0}, BadValue, "block = 0 must be"),
    ({"block": 64.0}, BadValue, "block = 64.0"),
    ({"full_scale": 0.0}, BadValue, "full_scale must be finite and above 0"),
    ({"full_scale": float("inf")}, BadValue, "full_scale = inf"),
    ({"full_scale": "loud"}, BadValue, "is no number, nor"),
    ({"full_scale": {}}, UnknownName, "force0 is missing"),
    ({"full_scale": {"force0": 1, "torque": 2}}, UnknownName, "no output torque"),
    ({"format": "flac"}, BadValue, "give full_scale, in N"),
    ({"subtype": "PCM_16"}, BadValue, "PCM_16 has no samples above"),
    ({"dither": 3}, BadValue, "dither = 3"),
    ({"dither": -1, "subtype": "PCM_16", "full_scale": 9.0}, BadValue, "dither = -1"),
    ({"progress": "never"}, BadValue, "progress"),
]


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """A folder with a file, and names that something else has."""
    folder = tmp_path_factory.mktemp("taken")
    file.write(folder / "a.wav", forces(2), MOTION, 0.1)
    (folder / "sidecar.wav.json").write_bytes(b"mine")
    for name in ("folder.wav", "blocked.wav.json"):
        (folder / name).mkdir()
    return folder


@pytest.mark.parametrize(("change", "error", "says"), REFUSED)
def test_what_cannot_be_written_leaves_the_folder_as_it_was(taken, change, error, says):
    given = {"path": "a.wav", "motion": MOTION, "seconds": 0.1, "block": 100} | change
    given |= {"path": taken / given["path"], "proc": change.get("proc", forces)()}
    assert "\n" not in str(unwritten(taken, error, says, **given))
    assert given["proc"].index == 0 or given["motion"] is not MOTION


@pytest.mark.parametrize(
    ("format", "fs", "channels"),
    [
        ("flac", 65535.0, 8),
        ("flac", 655350.0, 1),
        ("flac", 1.0, 1),
        ("wav", 1000.0, 24),
        ("caf", 192000.0, 256),
        ("w64", 8000.0, 1024),
    ],
)
def test_rate_and_channels_at_the_limit(tmp_path, format, fs, channels):
    file.write(tmp_path / f"a.{format}", alike(channels, fs), MOTION, 50 / fs, full_scale=64.0)
    y, sidecar = file.read(tmp_path / f"a.{format}")
    assert y.shape == (channels, 50) and sidecar["fs"] == fs


# -- reading


@pytest.mark.parametrize("format", FORMATS)
def test_a_file_that_is_cut_or_changed_is_refused(old, format):
    path = old / f"a.{format.lower()}"
    data = path.read_bytes()
    changed = data[:-100] + bytes([data[-100] ^ 1]) + data[-99:]
    cut = [data[:size] for size in (0, 20, len(data) // 2, len(data) - 1, len(data) - 100)]
    for bad in (changed, b"no audio at all" * 100, *cut):
        path.write_bytes(bad)
        told = refused(SinkError, re.escape(str(path)), file.read, path)
    if format != "FLAC":
        assert f"says 800 frames, the file has {sf.info(path).frames}" in str(told)


ONE_CHANNEL = {"channels": [{"name": "a", "unit": "N", "full_scale": 1.0, "clips": 0, "peak": 1.0}]}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"frames": 900}, "truncated"),
        ({"frames": 700}, "does not belong"),
        ({"fs": 8001.0}, "does not belong"),
        (ONE_CHANNEL, "does not belong"),
        ({"frames": "800"}, "not a sidecar"),
        ({"channels": [{}]}, "not a sidecar"),
        ({"channels": 3}, "not a sidecar"),
        ({"file_sha256": None}, "not a sidecar.*file_sha256"),
        ({"file_sha256": "0" * 64}, "file_sha256 differs"),
        *((text, "not a sidecar") for text in ("", "[]", "3", "{", "\xff")),
        (None, "has no sidecar a.wav.json.*put it back"),
    ],
)
def test_sidecars_that_are_missing_or_wrong(tmp_path, change, says):
    path, sidecar = tmp_path / "a.wav", tmp_path / "a.wav.json"
    file.write(path, forces(2), MOTION, 0.1)
    good = json.loads(sidecar.read_text())
    sidecar.write_text(json.dumps(good | change) if isinstance(change, dict) else change or "")
    if change is None:
        sidecar.unlink()
    refused(SinkError, says, file.read, path)


@pytest.mark.parametrize(
    ("name", "how", "format", "clipped"),
    [
        ("a.wav", {"format": "rf64"}, "RF64", ""),
        ("a.flac", {"full_scale": 1.0}, "FLAC", ", samples clipped: x_out 2"),
    ],
)
def test_report_is_one_line_and_the_format_may_be_given(tmp_path, name, how, format, clipped):
    path, hands = tmp_path / name, {"x": np.array([1.0, -2.0, 0.0, 0.5]), "y": np.zeros(4)}
    report = file.write(path, copies(*hands), hands, 4 / 8000, **how)
    assert str(report) == f"{path}: 4 frames, 0.0005 s, peak x_out 2, y_out 0{clipped}"
    assert report.sidecar == tmp_path / f"{name}.json" and sf.info(path).format == format


@pytest.mark.parametrize(
    ("format", "subtype"),
    [
        *((f, s) for f in ("WAV", "RF64", "W64") for s in ("PCM_16", "PCM_24", "FLOAT", "DOUBLE")),
        *((f, s) for f in ("WAVEX", "AIFF", "AU") for s in ("PCM_16", "FLOAT", "ULAW")),
        *(("CAF", s) for s in ("PCM_16", "ULAW", "ALAW", "PCM_S8")),
        *(("FLAC", s) for s in ("PCM_16", "PCM_24")),
    ],
)
def test_a_sound_file_that_is_cut_short_says_what_is_missing(format, subtype, tmp_path):
    path, n = tmp_path / "a.snd", 4410
    noise = np.random.default_rng(3).uniform(-0.5, 0.5, (n, 2))
    sf.write(path, noise, 44100, subtype, format=format)
    whole = path.read_bytes()
    path.write_bytes(whole + bytes(16))
    assert file.as_scene(path)[1]["channel1"].size - n in range(16)  # W64 takes them for frames
    frame = (len(whole) - 4096 if format == "CAF" else len(whole)) // n
    for cut in (1, 2 * frame, 7 * frame + 1, 1000 * frame):
        path.write_bytes(whole[:-cut])
        says = "cannot be read"
        if format != "FLAC":
            lost = n - sf.info(path).frames
            assert lost >= cut // frame
            says = f"last {lost} of its {n} frames are missing"
        refused(SinkError, says, file.as_scene, path)


@pytest.mark.skipif("MP3" not in sf.available_formats(), reason="needs libsndfile 1.1 or later")
def test_an_mp3_that_is_cut_short_says_so(tmp_path):
    """Its header has the number of frames, and no size."""
    path = tmp_path / "a.mp3"
    sf.write(path, np.random.default_rng(3).uniform(-0.5, 0.5, 44100), 44100)
    path.write_bytes(path.read_bytes()[:-2000])
    refused(SinkError, r"the last \d+ of its 44100 frames are missing", file.as_scene, path)


def test_a_sound_file_that_cannot_be_searched_or_is_from_a_pipe_is_read(tmp_path):
    path = tmp_path / "a.wav"
    sf.write(path, np.full(3200, 0.5), 8000, "GSM610")
    y = file.as_scene(path)[1]["channel1"]
    assert np.array_equal(y, sf.read(path, 3200)[0]) and y.size == 3200
    sf.write(path, np.linspace(-0.5, 0.5, 100), 8000)
    whole = path.read_bytes()
    for size in (2**32 - 1, 0x7FFFF000, 2**31):  # as long as it is
        path.write_bytes(whole.replace((200).to_bytes(4, "little"), size.to_bytes(4, "little")))
        assert file.as_scene(path)[1]["channel1"].size == 100
