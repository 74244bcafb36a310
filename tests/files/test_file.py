"""The file sink: exact samples, the same bytes every time, and never half a file."""

import errno
import gc
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tracemalloc
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
import soundfile as sf
from refusals import largest_file, refused

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib.blocks import exp, log, lut, sqrt, white_noise
from stimlib.errors import BadValue, FaultError, SinkError, UnitError, UnknownName
from stimlib.files import audio as file, formats
from stimlib.files.formats import BITS, FORMATS, MAX_WAV, check_format
from stimlib.motion.generators import minimum_jerk, sinusoid
from stimlib.motion.text import parse_motion
from stimlib.scenes import squeeze

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


def copies(*names):
    """The outputs are the inputs."""
    return stimlib.compile(Scene({f"{n}_out": Input(n, "N") for n in names}), 8000.0)


def signal_of(proc, frames):
    return proc.process(np.stack([MOTION[n](np.arange(frames) / proc.fs) for n in proc.inputs]))


def sha256(y):
    return hashlib.sha256(y.T.astype("<f8").tobytes()).hexdigest()


def in_a_child(call, *args, wait=True):
    """Run a function of this file in a process of its own."""
    me = Path(__file__)
    code = (
        f"import sys; sys.path[:0] = {[str(me.parent), str(me.parents[1])]!r};"
        f" import {me.stem} as t; t.{call.__name__}(*{args!r})"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    if wait:
        errors = child.communicate()[1]
        assert child.returncode == 0, errors
    return child


def expected(y, scale, subtype):
    if subtype in BITS:
        top = 2.0 ** (BITS[subtype] - 1)
        return np.clip(np.rint(y / scale * top), -top, top - 1) / top * scale
    return (y / scale).astype(np.float32 if subtype == "FLOAT" else np.float64).astype(
        np.float64
    ) * scale


def listing(folder):
    return {p.name: p.read_bytes() for p in Path(folder).iterdir()}


@contextmanager
def raises_and_leaves_as_it_was(folder, error):
    before = listing(folder)
    with pytest.raises(error) as info:
        yield info
    assert listing(folder) == before


def unwritten(folder, error, says, *args, **how):
    """The error of ``file.write``, which says this and leaves the folder as it was."""
    with raises_and_leaves_as_it_was(folder, error) as info:
        file.write(*args, **how)
    assert says in str(info.value)
    return info.value


# -- samples


@pytest.mark.parametrize("scale", [1.0, 64.0, 50.3])
@pytest.mark.parametrize("channels", [1, 2, 8])
@pytest.mark.parametrize(("format", "subtype"), KINDS)
def test_round_trip_is_exact(tmp_path, format, subtype, channels, scale):
    path = tmp_path / f"a.{format.lower()}"
    report = file.write(
        path, forces(channels), MOTION, 0.77, subtype=subtype, full_scale=scale, block=1000
    )
    y = signal_of(forces(channels), 6160)
    got, sidecar = file.read(path)
    assert got.dtype == np.float64 and got.shape == (channels, 6160) and got.flags.c_contiguous
    assert np.array_equal(got, expected(y, scale, subtype))
    raw, fs = sf.read(path, always_2d=True)  # an independent reading
    assert fs == 8000 and np.array_equal(raw.T * scale, got)
    assert (sf.info(path).format, sf.info(path).subtype) == (format, subtype)
    assert report.frames == 6160 and report.seconds == 0.77
    assert list(report.peak.values()) == np.abs(y).max(axis=1).tolist()
    top = 2.0 ** (BITS.get(subtype, 2) - 1)
    over = (np.rint(y / scale * top) > top - 1) | (np.rint(y / scale * top) < -top)
    over &= subtype in BITS
    assert list(report.clips.values()) == over.sum(axis=1).tolist()
    with sf.SoundFile(path) as sound:
        told = "; ".join(f"{name} [N]: 1.0 is {scale}" for name in report.peak)
        assert sound.comment == ("" if format == "W64" else told)
    assert sidecar["sha256"] == sha256(y)
    assert sidecar["file_sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert set(listing(tmp_path)) == {path.name, path.name + ".json"}


@pytest.mark.parametrize(
    ("format", "subtype", "dither"), [(*kind, None) for kind in KINDS] + [("WAV", "PCM_16", 5)]
)
def test_block_size_does_not_change_a_byte(tmp_path, format, subtype, dither):
    files = []
    how = {"subtype": subtype, "dither": dither}
    for block in (1, 7, 64, 8192, 10**6):
        path = tmp_path / f"{block}.{format.lower()}"
        file.write(path, forces(2), MOTION, 0.3, full_scale=64.0, block=block, **how)
        files.append((path.read_bytes(), Path(f"{path}.json").read_bytes()))
    assert len(set(files)) == 1


def write_all_kinds(folder):
    for format, subtype in KINDS:
        path = Path(folder) / f"{subtype}.{format.lower()}"
        file.write(
            path, forces(2), {"x": lambda t: 0.01 * t}, 0.3, subtype=subtype, full_scale=64.0
        )


def test_same_bytes_a_second_later_in_another_process(tmp_path):
    for name in "12":
        (tmp_path / name).mkdir()
    write_all_kinds(tmp_path / "1")
    time.sleep(1.1)  # the time stamp that libsndfile would write counts seconds
    in_a_child(write_all_kinds, str(tmp_path / "2"))
    assert listing(tmp_path / "1") == listing(tmp_path / "2")


def test_a_processor_goes_on_where_it_is(tmp_path):
    proc, x = forces(2), np.full(8000, 0.01)
    file.write(tmp_path / "1.caf", proc, {"x": x}, 0.3, subtype="DOUBLE")
    file.write(tmp_path / "2.caf", proc, {"x": x}, 0.2, subtype="DOUBLE")
    parts, sidecars = zip(*(file.read(tmp_path / f"{n}.caf") for n in "12"), strict=True)
    assert np.array_equal(np.concatenate(parts, axis=1), forces(2).process(x[None, :4000]))
    assert [s["index"] for s in sidecars] == [0, 2400]
    proc.reset()
    file.write(tmp_path / "3.caf", proc, {"x": x}, 0.3, subtype="DOUBLE")
    assert (tmp_path / "3.caf").read_bytes() == (tmp_path / "1.caf").read_bytes()


def test_dither_makes_the_error_a_steady_noise_and_is_made_again(tmp_path):
    """A ramp of two steps is stairs without dither; with it the mean is the ramp."""
    step, path = 64.0 * 2**-15, tmp_path / "a.wav"
    scene, x = Scene({"y": 1 * Input("y")}), np.linspace(0, 2 * step, 64_000)
    how = {"subtype": "PCM_16", "full_scale": 64.0}
    for dither, error, apart in ((None, 1 / 12, 0.4), (7, 1 / 4, 0.02)):
        file.write(path, stimlib.compile(scene, 8000), {"y": x}, 8.0, dither=dither, **how)
        lost = (file.read(path)[0][0] - x) / step
        assert np.var(lost) == pytest.approx(error, rel=0.03)
        means = lost.reshape(-1, 4000).mean(axis=1)
        assert (np.abs(means).max() > apart) == (dither is None)
        report = stimlib.verify(scene, {"y": x}, path)
        assert "file = re-render as PCM_16" in [c.name for c in report.checks if c.passed]
    sidecar = path.with_name("a.wav.json")
    sidecar.write_text(sidecar.read_text().replace('"dither": 7', '"dither": 8'))
    wrong = [c.name for c in stimlib.verify(scene, {"y": x}, path).checks if not c.passed]
    assert "file = re-render as PCM_16" in wrong


def test_flac_counts_clips_and_rounds_half_to_even(tmp_path):
    codes = np.array(
        [
            0,
            0.5,
            1.5,
            -2.5,
            2**23 - 1,
            2**23 - 0.75,
            2**23 - 0.5,
            2**23,
            -(2**23),
            -(2**23) - 1,
            1e300,
        ]
    )
    stored = [
        0,
        0,
        2,
        -2,
        2**23 - 1,
        2**23 - 1,
        2**23 - 1,
        2**23 - 1,
        -(2**23),
        -(2**23),
        2**23 - 1,
    ]
    x = np.concatenate([codes * 2.0**-23 * 8, [-1.7e308]])
    report = file.write(tmp_path / "a.flac", copies("x"), {"x": x}, 12 / 8000, full_scale=8.0)
    # 2**23 - 0.5 (rounds up), 2**23, -2**23 - 1, 1e300 and the last
    assert report.clips == {"x_out": 5}
    assert "samples clipped: x_out 5" in str(report) and "\n" not in str(report)
    data, _ = sf.read(tmp_path / "a.flac", dtype="int32")
    assert (data >> 8).tolist() == [*stored, -(2**23)]
    y, sidecar = file.read(tmp_path / "a.flac")
    assert y[0].tolist() == [c * 2.0**-20 for c in [*stored, -(2**23)]]
    assert sidecar["channels"][0]["clips"] == 5 and sidecar["channels"][0]["peak"] == 1.7e308


@pytest.mark.parametrize("subtype, bits", [("PCM_16", 16), ("PCM_24", 24)])
@pytest.mark.parametrize("beyond", [-1.5, -1.0, 1.0, 1.5])
def test_one_sample_beyond_one_end_alone_stays_at_it(beyond, subtype, bits):
    """2^15 would be -2^15 in 16 bits."""
    top = 2 ** (bits - 1)
    y = np.array([[0.25, beyond], [0.5, 0.0]])
    made, limited = formats.encode(y, np.ones(2), subtype, ("a", "b"))
    code = top - 1 if beyond > 0 else -top
    assert (made >> (32 - bits)).tolist() == [[top // 4, top // 2], [code, 0]]
    assert limited.tolist() == [beyond != -1.0, 0]


def test_the_seed_of_a_dither_makes_the_same_codes_for_all_time():
    y = np.array([[0.1, 0.2, 0.3, 0.4]])
    made, _ = formats.encode(y, np.ones(1), "PCM_16", ("a",), at=3, dither=5)
    dither = formats.dither_of(5, 1, 3, 4)
    assert (made[:, 0] >> 16).tolist() == np.rint(y[0] * 2**15 + dither[0]).tolist()


def test_floats_are_not_clipped(tmp_path):
    x = np.array([3.0, -70.0, 1e30, 1e-30])
    report = file.write(tmp_path / "a.wav", copies("x"), {"x": x}, 4 / 8000)
    assert report.clips == {"x_out": 0} and report.peak == {"x_out": 1e30}
    assert file.read(tmp_path / "a.wav")[0][0].tolist() == x.astype(np.float32).tolist()


def test_functions_and_arrays_give_the_same_file(tmp_path):
    t = np.arange(9000) / 8000
    file.write(tmp_path / "f.caf", forces(), {"x": minimum_jerk()}, 1.0)
    file.write(tmp_path / "a.caf", forces(), {"x": minimum_jerk()(t)}, 1.0)
    assert (tmp_path / "f.caf").read_bytes() == (tmp_path / "a.caf").read_bytes()
    assert file.read(tmp_path / "f.caf")[1]["motion"] == {"x": repr(minimum_jerk())}
    assert file.read(tmp_path / "a.caf")[1]["motion"] == {"x": "array(9000)"}


@pytest.mark.parametrize(
    ("subtype", "gain", "scale"), [("FLOAT", 1e39, 1.0), ("DOUBLE", 1e300, 1e-10)]
)
def test_values_beyond_the_largest_float_are_refused(old, subtype, gain, scale):
    proc = stimlib.compile(Scene({"force": constant(gain, "N/m") * Input("x", "m")}), 8000)
    unwritten(
        old,
        SinkError,
        f"output force / full_scale is too large for {subtype}",
        old / "a.wav",
        proc,
        {"x": lambda t: t},
        1.1,
        subtype=subtype,
        full_scale=scale,
        block=1000,
    )
    assert proc.fault is None


@pytest.mark.parametrize(
    ("subtype", "scale"), [("FLOAT", 2.0**1000), ("DOUBLE", 1.2e308), ("DOUBLE", 3.0)]
)
def test_the_largest_float_is_read_back_or_refused(old, subtype, scale):
    x = np.array([0.0, -np.finfo(float).max, np.finfo(float).max])
    unwritten(
        old,
        SinkError,
        f"output x_out is too near the largest float to be read back from {subtype}: use DOUBLE"
        " and a",
        old / "a.wav",
        copies("x"),
        {"x": x},
        3 / 8000,
        subtype=subtype,
        full_scale=scale,
    )
    file.write(
        old / "a.wav", copies("x"), {"x": x}, 3 / 8000, subtype="DOUBLE", full_scale=2.0**1023
    )
    assert file.read(old / "a.wav")[0].tolist() == [x.tolist()]


def test_inputs_go_to_their_rows_and_none_is_possible(tmp_path):
    motion = {"b": np.full(8, 2.0), "a": np.full(8, 1.0)}
    file.write(tmp_path / "a.w64", copies("a", "b"), motion, 1e-3, subtype="DOUBLE")
    assert file.read(tmp_path / "a.w64")[0][:, 0].tolist() == [1.0, 2.0]
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

    again = lambda t: motion(t)  # noqa: E731
    file.write(
        tmp_path / "a.wav",
        copies("x", "y", "z"),
        {"x": motion, "y": motion, "z": again},
        0.1,
        block=300,
    )
    t = np.arange(800) / 8000
    assert np.array_equal(np.concatenate(seen[::2]), t) and np.array_equal(
        np.concatenate(seen[1::2]), t
    )


def test_a_motion_must_set_no_parameter(tmp_path):
    """The sidecar would not have it."""
    path = tmp_path / "a.wav"
    proc = stimlib.compile(Scene({"y": Param("k", 2.0) * Input("x")}), 8000.0)

    def motion(t):
        if 0.1 <= t[0] < 0.2:
            proc.set("k", 1.0)
        return t

    proc.set("k", 0.5)
    file.write(path, proc, {"x": lambda t: t}, 0.1)
    assert file.read(path)[1]["log"][0]["name"] == "k"
    old = path.read_bytes()
    with pytest.raises(BadValue, match="^write: parameter k was set while .*a.wav was being"):
        file.write(path, proc, {"x": motion}, 0.4, block=800)
    assert path.read_bytes() == old and len(list(tmp_path.iterdir())) == 2


def test_a_large_block_is_written_in_parts(tmp_path):
    """A run that is killed loses only what was not written yet."""
    sizes = []
    scene = Scene({"y": 1.0 * Input("x")})
    for block in (64, 10000):
        proc = stimlib.compile(scene, 1000)
        motion = {"x": lambda t: (sizes.append(t.size), np.sin(t))[1]}
        file.write(tmp_path / f"{block}.wav", proc, motion, 10.0, full_scale=1.0, block=block)
    one, other = (sf.read(tmp_path / f"{block}.wav")[0] for block in (64, 10000))
    assert max(sizes) <= 1000 and np.array_equal(one, other)


def test_full_scale_per_output(tmp_path):
    scales = {"force1": np.float32(32.0), "force0": 64}
    file.write(tmp_path / "a.flac", forces(2), MOTION, 0.1, full_scale=scales)
    y, sidecar = file.read(tmp_path / "a.flac")
    assert [c["full_scale"] for c in sidecar["channels"]] == [64.0, 32.0]
    assert np.abs(y - signal_of(forces(2), 800)).max() <= 64 * 2.0**-24


def test_outputs_with_different_units(tmp_path):
    x = Input("x", "m")
    proc = stimlib.compile(
        Scene({"force": constant(1000.0, "N/m") * x, "drive": constant(3.0, "V/m") * x}), 8000
    )
    # 1 in each output's own unit
    file.write(tmp_path / "a.wav", proc, MOTION, 0.1, subtype="DOUBLE")
    y, sidecar = file.read(tmp_path / "a.wav")
    assert [(c["name"], c["unit"], c["full_scale"]) for c in sidecar["channels"]] == [
        ("force", "N", 1.0),
        ("drive", "V", 1.0),
    ]
    proc.reset()
    assert np.array_equal(y, signal_of(proc, 800))
    unwritten(
        tmp_path,
        UnitError,
        "force (N), drive (V)",
        tmp_path / "b.wav",
        proc,
        MOTION,
        0.1,
        full_scale=10.0,
    )
    unwritten(
        tmp_path,
        BadValue,
        "give full_scale, in each output's unit, by name",
        tmp_path / "b.flac",
        proc,
        MOTION,
        0.1,
    )


# -- the sidecar


def test_sidecar_says_what_the_samples_are(tmp_path):
    scene = Scene({"force": Param("k", 1000, "N/m") * Input("x", "m")})
    proc = stimlib.compile(scene, 8000, seed=2**64 - 1)
    proc.set("k", 1500.0)
    file.write(tmp_path / "a.wav", proc, MOTION, 0.1)
    sidecar = json.loads((tmp_path / "a.wav.json").read_text())
    assert list(sidecar) == [
        "stimlib",
        "format",
        "subtype",
        "dither",
        "fs",
        "frames",
        "channels",
        "seed",
        "params",
        "index",
        "log",
        "motion",
        "scene",
        "scene_hash",
        "definitions",
        "sha256",
        "versions",
        "file_sha256",
    ]
    channel = sidecar["channels"][0]
    assert list(channel) == ["name", "unit", "full_scale", "clips", "peak"]
    assert (channel["name"], channel["unit"], channel["full_scale"], channel["clips"]) == (
        "force",
        "N",
        1.0,
        0,
    )
    assert (sidecar["stimlib"], sidecar["fs"], sidecar["frames"]) == (
        stimlib.__version__,
        8000.0,
        800,
    )
    assert (sidecar["seed"], sidecar["params"], sidecar["index"]) == (2**64 - 1, {"k": 1500.0}, 0)
    assert sidecar["log"] == [{"at": 0, "name": "k", "value": 1500.0, "ramp": 0.02}]
    assert sidecar["scene"] == scene.to_dict() and sidecar["scene_hash"] == scene.hash
    assert set(sidecar["versions"]) == {"numpy", "numba", "soundfile", "libsndfile"}
    assert sidecar["motion"] == {"x": "sinusoid(amplitude=0.02, freq=3.0, mean=0.0, phase=0.0)"}


@pytest.mark.parametrize("ramp", [0.0, 0.02])
@pytest.mark.parametrize("seed", [0, 7])
def test_the_sidecar_alone_makes_the_file_again(tmp_path, seed, ramp):
    proc = stimlib.compile(squeeze(seed=3), 8000, seed=seed)
    proc.set("k", 1500.0, ramp)
    proc.set("A", 2.0, ramp)
    path = tmp_path / "a.flac"
    file.write(path, proc, {"x1": minimum_jerk(), "x2": sinusoid(0.01, 7.0)}, 0.5, full_scale=100.0)

    sidecar = json.loads(Path(f"{path}.json").read_text())
    scene = Scene.from_dict(sidecar["scene"])
    motion = {name: parse_motion(text) for name, text in sidecar["motion"].items()}
    fs, seconds, seed = sidecar["fs"], sidecar["frames"] / sidecar["fs"], sidecar["seed"]
    assert scene.hash == sidecar["scene_hash"] and sidecar["index"] == 0
    again = stimlib.compile(scene, fs, seed=seed)
    for change in sidecar["log"]:
        again.set(change["name"], change["value"], change["ramp"])
    scales = {c["name"]: c["full_scale"] for c in sidecar["channels"]}
    before = listing(tmp_path)
    file.write(
        path,
        again,
        motion,
        seconds,
        format=sidecar["format"],
        subtype=sidecar["subtype"],
        full_scale=scales,
    )
    assert listing(tmp_path) == before
    rendering = stimlib.render(scene, motion, fs, seconds, sidecar["params"], seed)
    assert (sha256(rendering.y) == sidecar["sha256"]) == (ramp == 0)  # render jumps to its params
    if ramp == 0:
        reference = stimlib.render(
            scene, motion, fs, seconds, sidecar["params"], seed, target="python"
        )
        assert sha256(reference.y) == sidecar["sha256"]


# -- memory, progress, imports


def test_memory_does_not_grow_with_the_duration(tmp_path):
    def peak(minutes):
        proc = forces()
        tracemalloc.start()
        try:
            file.write(tmp_path / "a.rf64", proc, MOTION, 60.0 * minutes, progress=False)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(0.1)  # imports
    one, ten = peak(1), peak(10)
    # a list of the blocks would be 40 MB more; how many wait depends on the moment
    assert ten < one + 1_000_000, (one, ten)


def test_progress_bar_only_when_wanted(tmp_path, capsys):
    for progress in (True, False):  # stderr is not a terminal here
        file.write(tmp_path / "a.wav", forces(), MOTION, 0.1, progress=progress)
    assert capsys.readouterr() == ("", "")
    file.write(tmp_path / "a.wav", forces(), MOTION, 0.1, progress="always")
    out, err = capsys.readouterr()
    assert out == "" and "100%" in err
    refused(BadValue, None, file.write, tmp_path / "a.wav", forces(), MOTION, 0.1, progress="never")


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


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("error", ERRORS, ids=repr)
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


def write_slowly(path):
    def position(t):
        time.sleep(0.02)
        return 0.01 * t

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
    with suppress(KeyboardInterrupt):
        file.write(path, forces(2), {"x": position}, 3600.0)


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
@pytest.mark.parametrize("how", ["SIGINT", "SIGKILL"])
def test_a_run_that_is_stopped_from_outside(old, how):
    path, before = old / "a.rf64", listing(old)
    child = in_a_child(write_slowly, str(path), wait=False)
    deadline = time.monotonic() + 60
    try:
        while not any(p.stat().st_size > 200_000 for p in old.glob("a.rf64.*.part")):
            assert child.poll() is None and time.monotonic() < deadline
            time.sleep(0.01)
        child.send_signal(getattr(signal, how))
        errors = child.communicate(timeout=60)[1]
    finally:
        child.kill()
    if how == "SIGINT":
        assert (child.returncode, errors) == (0, "") and listing(old) == before
    else:  # nobody could clean up: what is left is in nobody's way
        (left,) = listing(old).keys() - before.keys()
        assert re.fullmatch(rf"a\.rf64\.{child.pid}-[0-9a-f]{{8}}\.part", left)
        file.read(path)
        file.write(path, forces(2), MOTION, 0.1)
        assert file.read(path)[0].shape == (2, 800)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX timers")
# an interrupt between open() and the with statement leaves closing to the collector, in
# any Python program
@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
@pytest.mark.parametrize("format", ["RF64", "FLAC"])
def test_an_interrupt_at_any_moment_leaves_a_complete_pair(old, format):
    path = old / f"a.{format.lower()}"
    names = set(listing(old))

    def interrupt(signum, frame):
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGALRM, interrupt)
    interrupted = 0
    try:
        for trial in range(60):
            proc = forces(2, noise=trial + 1.0)
            try:
                signal.setitimer(signal.ITIMER_REAL, 2e-4 + trial * 2.5e-4)
                file.write(path, proc, MOTION, 0.5, full_scale=64.0, block=64)
                signal.setitimer(signal.ITIMER_REAL, 0)
            except KeyboardInterrupt:
                interrupted += 1
            signal.setitimer(signal.ITIMER_REAL, 0)
            file.read(path)
            assert set(listing(old)) == names
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
        gc.collect()  # what was left to the collector, before the next test
    assert interrupted > 5


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


FAULTS = {  # at sample 2344, t is 0.293 exactly
    "sqrt": (lambda t: sqrt(0.293 - t), 2345),
    "log": (lambda t: log(0.293 - t), 2344),
    "divide": (lambda t: 1.0 / (0.293 - t), 2344),
    "overflow": (lambda t: exp(1000.0 * t), 5679),  # 709.79 / 1000 s
    "table": (lambda t: lut(t, [0.0, 0.293], [0.0, 1.0], outside="error"), 2345),
    "first sample": (lambda t: 1.0 / t, 0),
}


def broken(make):
    x = Input("x", "m")
    t = x / constant(1.0, "m")
    noise = constant(1.0, "N") * white_noise(seed=1)
    return stimlib.compile(
        Scene(
            {"force0": constant(1000.0, "N/m") * x + noise, "force1": constant(1.0, "N") * make(t)}
        ),
        8000,
    )


@pytest.mark.parametrize("block", [64, 1000, 8192])
@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_the_processor_leaves_the_old_file(old, name, block):
    make, at = FAULTS[name]
    path, proc, motion = old / "a.wav", broken(make), {"x": lambda t: t}
    error = unwritten(old, FaultError, "", path, proc, motion, 1.0, subtype="DOUBLE", block=block)
    told = (
        f"output force1 was not finite at sample {at} ({at / 8000:.6g} s): {path} was not written;"
        " look for a division by 0, "
    )
    assert str(error) == told + "a root or logarithm below 0, or a loop of gains that grows"
    assert proc.fault == ("force1", at)

    index = proc.index
    unwritten(
        old,
        FaultError,
        f"output force1 stopped earlier, at sample {at} of the processor",
        path,
        proc,
        motion,
        1.0,
        subtype="DOUBLE",
        block=block,
    )  # the guard stays as it is
    assert proc.index == index

    if at:  # up to the fault everything is fine; then samples count from the beginning of the file
        proc.reset()
        file.write(path, proc, motion, at / 8000, subtype="DOUBLE", block=block)
        assert file.read(path)[0].shape == (2, at)
        unwritten(
            old,
            FaultError,
            "not finite at sample 1 (0.000125 s)",
            path,
            proc,
            {"x": np.arange(at - 1, at + 7999) / 8000},
            1.0,
            subtype="DOUBLE",
            block=block,
        )


def test_of_two_faults_the_first_is_told(old):
    t = Input("x", "m") / constant(1.0, "m")
    proc = stimlib.compile(Scene({"late": sqrt(0.4 - t), "early": sqrt(0.3 - t)}), 8000)
    unwritten(
        old,
        FaultError,
        "output early was not finite at sample 2401",
        old / "a.wav",
        proc,
        {"x": lambda t: t},
        1.0,
    )


def fill(folder):
    for format, subtype in KINDS:
        path, proc = folder / f"a.{format.lower()}", forces(2)
        with raises_and_leaves_as_it_was(folder, SinkError) as info, largest_file(300_000):
            file.write(path, proc, MOTION, 20.0, subtype=subtype, full_scale=64.0)
        assert os.strerror(errno.EFBIG) in str(info.value) and str(path) in str(info.value)


def fill_at_the_end(folder):
    path = folder / "b.flac"
    for frames in (4000, 9000):
        file.write(path, forces(2), MOTION, frames / 8000, full_scale=64.0)
        size = path.stat().st_size
        path.unlink()
        Path(f"{path}.json").unlink()
        for limit in (size - 10, size - 3000):
            proc = forces(2)
            with raises_and_leaves_as_it_was(folder, SinkError) as info, largest_file(limit):
                file.write(path, proc, MOTION, frames / 8000, full_scale=64.0)
            assert os.strerror(errno.EFBIG) in str(info.value)


def fill_both(folder):
    fill(Path(folder))
    # libFLAC keeps up to 4096 frames until the file is closed, and libsndfile then
    # ignores a full disk
    fill_at_the_end(Path(folder))


def test_a_write_that_fails_leaves_the_old_file(old):
    pytest.importorskip("resource", reason="needs POSIX limits")
    in_a_child(fill_both, str(old))  # the limit holds for a whole process


def test_disk_full(mounted):
    folder = mounted("size=512k")
    for format, subtype in KINDS:
        path = folder / f"a.{format.lower()}"
        file.write(path, forces(2), MOTION, 0.1, subtype=subtype, full_scale=64.0)
        unwritten(
            folder,
            SinkError,
            os.strerror(errno.ENOSPC),
            path,
            forces(2),
            MOTION,
            60.0,
            subtype=subtype,
            full_scale=64.0,
        )
        file.read(path)
        path.unlink()
        Path(f"{path}.json").unlink()
    # room for the samples, not for the sidecar
    file.write(folder / "a.wav", forces(2), MOTION, 5.0)
    for name in ("a.wav", "a.wav.json"):
        (folder / name).unlink()
    knots = np.linspace(-0.1, 0.1, 20_001)
    table = lut(Input("x", "m"), knots, np.sin(knots), unit="N")
    proc = stimlib.compile(Scene({"force": table, "twice": 2 * table}), 8000)
    unwritten(folder, SinkError, os.strerror(errno.ENOSPC), folder / "a.wav", proc, MOTION, 5.0)


# -- refused before anything is written


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        (
            "a.mp3",
            {},
            "suffix of 'a.mp3' is not known; write one of .wav, .rf64, .w64, .caf, .flac",
        ),
        ("a", {}, "suffix of 'a' is not known"),
        ("a.wav", {"format": "ogg"}, "format 'ogg' is not known"),
        (
            "a.wav",
            {"subtype": "PCM_U8"},
            "WAV is written with subtype FLOAT, DOUBLE, PCM_16, PCM_24 or PCM_32, not 'PCM_U8'",
        ),
        (
            "a.flac",
            {"subtype": "FLOAT", "full_scale": 1.0},
            "FLAC is written with subtype PCM_24 or PCM_16, not 'FLOAT'",
        ),
        ("none/a.wav", {}, "there is no folder"),
        ("folder.wav", {}, "is a folder; give the name of a file in it"),
        ("there.wav", {"overwrite": False}, "is there already, and overwrite=False"),
        ("sidecar.wav", {"overwrite": False}, "sidecar.wav.json is there already"),
        ("blocked.wav", {}, "blocked.wav.json is there and not an ordinary file"),
    ],
)
def test_place_and_format(tmp_path, name, change, says):
    (tmp_path / "there.wav").write_bytes(b"mine")
    (tmp_path / "sidecar.wav.json").write_bytes(b"mine")
    (tmp_path / "folder.wav").mkdir()
    (tmp_path / "blocked.wav.json").mkdir()
    before = sorted(tmp_path.rglob("*"))
    proc = forces()
    error = refused(SinkError, None, file.write, tmp_path / name, proc, MOTION, 1.0, **change)
    assert says in str(error) and proc.index == 0
    assert sorted(tmp_path.rglob("*")) == before


def test_format_can_be_given(tmp_path):
    file.write(tmp_path / "a.wav", forces(), MOTION, 0.1, format="rf64")
    assert sf.info(tmp_path / "a.wav").format == "RF64"
    file.read(tmp_path / "a.wav")


def test_wav_beyond_4_gib_is_refused_at_once(tmp_path):
    proc = forces(8, fs=48000.0)
    unwritten(
        tmp_path,
        SinkError,
        "WAV holds at most 4 GiB, this needs 4.29 GiB: write .rf64, .w64 or .caf",
        tmp_path / "a.wav",
        proc,
        MOTION,
        1500.0,
        subtype="DOUBLE",
    )
    assert proc.index == 0
    most = MAX_WAV // 64
    check_format("WAV", "DOUBLE", 48000.0, 8, most)
    check_format("RF64", "DOUBLE", 48000.0, 8, most + 1)
    refused(SinkError, None, check_format, "WAV", "DOUBLE", 48000.0, 8, most + 1)


@pytest.mark.parametrize(
    ("format", "fs", "channels"),
    [
        ("wav", 8000.5, 1),
        ("caf", 0.5, 1),
        ("w64", 2.0**31, 1),
        ("flac", 65537.0, 1),
        ("flac", 655360.0, 1),
        ("flac", 8000.0, 9),
        ("rf64", 8000.0, 1025),
        ("caf", 8000.0, 257),
    ],
)
def test_rate_and_channels_that_the_format_cannot_hold(tmp_path, format, fs, channels):
    proc = forces(channels, fs=fs)
    unwritten(
        tmp_path, SinkError, "", tmp_path / f"a.{format}", proc, MOTION, 10.0, full_scale=64.0
    )
    assert proc.index == 0


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
    file.write(tmp_path / f"a.{format}", forces(channels, fs=fs), MOTION, 50 / fs, full_scale=64.0)
    y, sidecar = file.read(tmp_path / f"a.{format}")
    assert y.shape == (channels, 50) and sidecar["fs"] == fs


@pytest.mark.parametrize(
    ("motion", "error", "says"),
    [
        ({}, UnknownName, "motion: x is missing; the inputs are: x"),
        (
            {"x": minimum_jerk(), "y": minimum_jerk()},
            UnknownName,
            "motion: there is no input y; the inputs are: x",
        ),
        (minimum_jerk(), BadValue, "motion must map each input name"),
        ({"x": np.zeros(799)}, BadValue, "at least 800 samples; got (799,)"),
        ({"x": np.zeros((2, 800))}, BadValue, "one dimension"),
        ({"x": "abc"}, BadValue, "function of time or an array of real numbers"),
        ({"x": lambda t: t[1:]}, BadValue, "motion of x must give one number per time"),
        ({"x": lambda t: 1.0}, BadValue, "give lambda t: np.full_like(t, 1.0)"),
        ({"x": lambda t: t + 0j}, BadValue, "complex128 out"),
        (
            {"x": np.r_[np.zeros(500), np.nan, np.zeros(500)]},
            BadValue,
            "not finite at sample 500 (0.0625 s)",
        ),
        ({"x": lambda t: np.where(t > 0.05, np.inf, 0)}, BadValue, "not finite at sample 401"),
    ],
)
def test_motion_that_does_not_fit(old, motion, error, says):
    with raises_and_leaves_as_it_was(old, error) as info:
        file.write(old / "a.wav", forces(), motion, 0.1, block=100)
    assert says in str(info.value) and "\n" not in str(info.value)


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"seconds": 0.0}, BadValue, "at least one sample"),
        ({"seconds": -1.0}, BadValue, "at least one sample"),
        ({"seconds": float("nan")}, BadValue, "finite"),
        ({"seconds": "long"}, BadValue, "write: seconds = 'long' must be a number"),
        ({"block": 0}, BadValue, "block must be"),
        ({"block": 64.0}, BadValue, "write: block = 64.0 must be a whole number"),
        ({"full_scale": 0.0}, BadValue, "full_scale must be finite and above 0"),
        ({"full_scale": float("inf")}, BadValue, "write: full_scale = inf is not finite"),
        ({"full_scale": "loud"}, BadValue, "full_scale must be a number"),
        ({"full_scale": {}}, UnknownName, "full_scale: force0 is missing; the outputs are: force0"),
        ({"full_scale": {"force0": 1, "torque": 2}}, UnknownName, "there is no output torque"),
        ({"full_scale": None, "format": "flac"}, BadValue, "give full_scale, in N"),
        ({"full_scale": None, "subtype": "PCM_16"}, BadValue, "PCM_16 has no samples above"),
        ({"dither": 3}, BadValue, "dither = 3: give a seed from 0"),
        (
            {"dither": -1, "subtype": "PCM_16", "full_scale": 9.0},
            BadValue,
            "dither = -1: give a seed from 0",
        ),
    ],
)
def test_bad_arguments(old, change, error, says):
    unwritten(
        old,
        error,
        says,
        **{"path": old / "a.wav", "proc": forces(), "motion": MOTION, "seconds": 0.1} | change,
    )


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")
def test_a_place_that_refuses_files():
    refused(SinkError, "cannot write /proc/a.wav", file.write, "/proc/a.wav", forces(), MOTION, 0.1)


@pytest.mark.skipif(not hasattr(os, "seteuid"), reason="needs POSIX permissions")
def test_unwritable_folder():
    folder = Path(tempfile.mkdtemp())  # not below tmp_path, which only its owner can enter
    root = os.geteuid() == 0
    try:
        folder.chmod(0o555)
        if root:
            os.seteuid(65534)  # root may write everywhere
        error = refused(SinkError, None, file.write, folder / "a.wav", forces(), MOTION, 0.1)
        assert str(folder) in str(error)
    finally:
        if root:
            os.seteuid(0)
        folder.chmod(0o755)
        folder.rmdir()


# -- reading


@pytest.mark.parametrize("format", FORMATS)
def test_truncated_files(old, format):
    path = old / f"a.{format.lower()}"
    data = path.read_bytes()
    for size in (0, 20, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:size])
        assert str(path) in str(refused(SinkError, None, file.read, path))


@pytest.mark.parametrize("format", FORMATS)
def test_a_changed_file_is_noticed(old, format):
    path = old / f"a.{format.lower()}"
    data = bytearray(path.read_bytes())
    data[-100] ^= 1
    path.write_bytes(data)
    refused(SinkError, None, file.read, path)


def test_sidecars_that_are_missing_or_wrong(old):
    path, sidecar = old / "a.wav", old / "a.wav.json"
    good = json.loads(sidecar.read_text())

    def says():
        error = refused(SinkError, None, file.read, path)
        return str(error)

    for change in (
        {"frames": 900},
        {"frames": 700},
        {"fs": 8001.0},
        {"channels": good["channels"][:1]},
    ):
        sidecar.write_text(json.dumps(good | change))
        assert "truncated" in says() if change.get("frames") == 900 else "does not belong" in says()
    for change in ({"frames": "800"}, {"channels": [{}]}, {"channels": 3}, {"file_sha256": None}):
        sidecar.write_text(json.dumps(good | change))
        assert "is not a sidecar that stimlib wrote" in says()
    for text in ("", "[]", "3", "{", "\xff"):
        sidecar.write_text(text)
        assert "is not a sidecar that stimlib wrote" in says()
    shutil.copy(old / "a.rf64.json", sidecar)  # the same signal, another file
    assert "file_sha256 differs" in says()
    sidecar.unlink()
    assert "has no sidecar a.wav.json" in says()
    path.unlink()
    assert "there is no file" in says()


def test_a_file_that_is_no_audio(old):
    (old / "a.wav").write_bytes(b"no audio at all" * 100)
    refused(SinkError, "cannot be read", file.read, old / "a.wav")


def test_report_is_one_line(tmp_path):
    report = file.write(tmp_path / "a.wav", forces(2), MOTION, 0.5)
    a, b = np.abs(signal_of(forces(2), 4000)).max(axis=1)
    assert (
        str(report) == f"{tmp_path}/a.wav: 4000 frames, 0.5 s, peak force0 {a:.4g}, force1 {b:.4g}"
    )
    assert report.sidecar == tmp_path / "a.wav.json"


@pytest.mark.parametrize(
    ("format", "subtypes"),
    [
        *((f, ("PCM_16", "PCM_24", "FLOAT", "DOUBLE")) for f in ("WAV", "RF64", "W64", "CAF")),
        *((f, ("PCM_16", "FLOAT", "ULAW")) for f in ("WAVEX", "AIFF", "AU")),
        ("CAF", ("ULAW", "ALAW", "PCM_S8")),
        ("FLAC", ("PCM_16", "PCM_24")),
    ],
)
def test_a_sound_file_that_is_cut_short_says_what_is_missing(format, subtypes, tmp_path):
    path, n = tmp_path / "a.snd", 4410
    for subtype in subtypes:
        noise = np.random.default_rng(3).uniform(-0.5, 0.5, (n, 2))
        sf.write(path, noise, 44100, subtype, format=format)
        whole = path.read_bytes()
        frame = (len(whole) - 4096 if format == "CAF" else len(whole)) // n
        for cut in (0, 1, 2 * frame, 7 * frame + 1, 1000 * frame):
            path.write_bytes(whole[: len(whole) - cut] if cut else whole + bytes(16))
            if not cut:
                made = file.as_scene(path)[1]["channel1"].size
                assert made - n in range(16)  # W64 takes them for frames
            elif format == "FLAC":
                refused(SinkError, "cannot be read", file.as_scene, path)
            else:
                with suppress(sf.SoundFileError):
                    lost = n - sf.info(path).frames
                    says = f"the last {lost} of its {n} frames are missing; copy it again"
                    refused(SinkError, says, file.as_scene, path)
                    assert lost >= cut // frame


@pytest.mark.skipif("MP3" not in sf.available_formats(), reason="needs libsndfile 1.1 or later")
def test_an_mp3_that_is_cut_short_says_so(tmp_path):
    """Its header has the number of frames, and no size."""
    path = tmp_path / "a.mp3"
    sf.write(path, np.random.default_rng(3).uniform(-0.5, 0.5, 44100), 44100)
    path.write_bytes(path.read_bytes()[:-2000])
    refused(SinkError, r"the last \d+ of its 44100 frames are missing", file.as_scene, path)


def test_a_sound_file_that_cannot_be_searched_is_read(tmp_path):
    sf.write(tmp_path / "a.wav", np.full(3200, 0.5), 8000, "GSM610")
    y = file.as_scene(tmp_path / "a.wav")[1]["channel1"]
    assert np.array_equal(y, sf.read(tmp_path / "a.wav", 3200)[0]) and y.size == 3200


def test_a_sound_file_from_a_pipe_is_as_long_as_it_is(tmp_path):
    path = tmp_path / "a.wav"
    sf.write(path, np.linspace(-0.5, 0.5, 100), 8000)
    whole = path.read_bytes()
    for size in (2**32 - 1, 0x7FFFF000, 2**31):
        path.write_bytes(whole.replace((200).to_bytes(4, "little"), size.to_bytes(4, "little")))
        assert file.as_scene(path)[1]["channel1"].size == 100


def test_a_file_that_has_fewer_frames_than_its_sidecar_says_how_many(tmp_path):
    for name in ("a.wav", "a.w64", "a.rf64", "a.caf"):
        path = tmp_path / name
        y = stimlib.render(Scene({"y": Input("x")}), MOTION, fs=8000, seconds=0.2)
        y.save(path, full_scale=1.0, subtype="PCM_16")
        path.write_bytes(path.read_bytes()[:-40])
        has = sf.info(path).frames
        refused(SinkError, f"says 1600 frames, the file has {has}; copy", file.read, path)
