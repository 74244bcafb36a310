"""Everything that reads a file, in one table: each must give a result or an error of
stimlib's, soon and in little memory.
"""

from __future__ import annotations

import gzip
import io
import json
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from devices.servers import played

import stimlib
from stimlib import StimlibError, files
from stimlib.blocks import equalize, load_texture, lut, save_texture, texture
from stimlib.design.texture import made_up
from stimlib.devices import NullSink
from stimlib.files import audio as file, read_log
from stimlib.files.log_replay import processor, replay
from stimlib.motion import minimum_jerk, recording
from stimlib.scenes import squeeze, viscoelastic

SECONDS = 20.0  # of CPU time for one input, on any machine
CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\ud800-\udfff]")
CASES = Path(__file__).with_name("cases")
PATTERNS = Path(__file__).parents[1] / "patterns"

CSV = """t_s,x_m,contact,kind
0,0.001,1,a
0.010,0.002,1,a
0.010,0.002,1,a
0.021,0.004,0,b
0.030,0.005,1,b
0.5,0.0050000001,1,"c"
0.51,0.007,1,a
"""
EUROPE = "t_s;x_m;kind\r\n0,00;0,001;a\r\n0,01;0,002;a\r\n0,02;0,004;b\r\n"
ABOVE = "sep=;\r\n# by hand\r\n" + EUROPE
TABLE = "# measured\nposition,displacement\n0,1e-4\n0.02,1.2e-4\n0.05,1.4e-4\n0.07,1.2e-4\n"
OPTIONS = (
    {},
    {"reports": "on_change", "max_speed": None},
    {"repeats": "spread", "max_gap": 1e9, "max_speed": {"x": None}},
    {"repeats": "mean", "contact": False},
    {"repeats": "last", "where": {"kind": "a"}},
    {
        "missing": "gap",
        "sentinels": (-9999,),
        "wrap": 65536.0,
        "time": "t_s*1e-3",
        "max_speed": None,
    },
    {"missing": "hold", "max_gap": 1e9, "rate": 100.0},
    {"missing": "interpolate", "clock": "t_s*1.001", "repeats": "mean"},
    {"where": {"kind": 1.0}, "time": "t_s*1e-3", "max_speed": None, "reports": "on_change"},
)


class Reader(NamedTuple):
    """name: of the file; seeds: good files to start from; read: what is made of a file
    of that name; beside: what else its folder holds.
    """

    name: str
    seeds: Callable[[], list[bytes]]
    read: Callable[[Path], object]
    beside: Callable[[], dict[str, bytes]] = dict


def place(name: str, folder: Path) -> Path:
    """Where the file of a reader is to be, with all that is beside it."""
    for other, data in READERS[name].beside().items():
        (folder / other).write_bytes(data)
    (folder / READERS[name].name).unlink(missing_ok=True)
    return folder / READERS[name].name


@contextmanager
def promised() -> Iterator[None]:
    """Say what to do where a reader raises an error that is not stimlib's."""
    try:
        yield
    except Exception as error:
        if not isinstance(error, StimlibError | AssertionError):
            error.add_note(
                "Whatever the file holds, a reader raises an error of stimlib.errors that names it:"
                " read it with stimlib.system.safe_files.read, and check what you take from it."
            )
        raise


def attempt(name: str, data: bytes) -> object:
    """What a reader makes of these bytes; what is against the promise goes on as it
    is.
    """
    READERS[name].seeds()  # some are made here by what may have to be compiled first
    with tempfile.TemporaryDirectory() as folder:
        path = place(name, Path(folder))
        path.write_bytes(data)
        began = time.process_time()
        try:
            with promised():
                return READERS[name].read(path)
        except StimlibError as error:
            assert not CONTROL.search(str(error)), f"control characters: {error!r}"
            return error
        finally:
            took = time.process_time() - began
            assert took < SECONDS, f"{took:.1f} s"


def _recording(path: Path) -> object:
    taken = None
    for options in OPTIONS:
        try:
            taken = recording(path, {"x": "x_m", "y": "x_m*2+1e-3"}, **options)
        except StimlibError:
            continue
        assert not CONTROL.search(f"{taken}{taken!r}{taken.motion['x']!r}")
        t = np.linspace(-0.1, 1.1, 7) * taken.duration
        motions = [taken.motion["x"], taken.motion["y"], taken.contact]
        assert all(np.isfinite(m(t)).all() for m in motions)
    return recording(path, {"x": "x_m"}) if taken is None else taken


def _npz() -> list[bytes]:
    t = np.array([0.0, 0.01, 0.01, 0.02, 0.03, 0.5])
    kind = np.array(list("aaabbb"))
    out = []
    for save, f in (
        (np.savez, np.float64),
        (np.savez_compressed, np.float32),
        (np.savez, np.longdouble),
    ):
        raw = io.BytesIO()
        save(raw, t_s=t, x_m=(t * 0.1).astype(f), contact=t < 0.2, kind=kind)
        out.append(raw.getvalue())
    return out


def _table(path: Path) -> object:
    x, done = stimlib.Input("x", "m"), None
    for kind in ("linear", "pchip", "cubic", None):
        try:
            done = equalize(x, path, kind=kind)
            proc = stimlib.compile(stimlib.Scene({"y": done}), 8000, target="python")
            proc.process(np.array([[0.0, 0.03, 1e3]]))
        except StimlibError:
            continue
    return equalize(x, path) if done is None else done


@cache
def made(write: Callable[[Path], object]) -> dict[str, bytes]:
    """Return the files that a function writes into a folder."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder))
        return {path.name: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


def _written_texture(folder: Path) -> None:
    save_texture(made_up(1, (0.0, 0.1), (0.0, 1.0)), folder / "a.xml")


def _texture(path: Path) -> object:
    model = load_texture(path)
    with suppress(StimlibError):  # a rate that does not fit
        scene = stimlib.Scene({"a": texture(0.05, stimlib.Input("N", "N"), model, seed=1)})
        y = stimlib.compile(scene, 8000, target="python").process(np.array([[0.0, 0.5, 1e3]]))
        assert np.isfinite(y).all()
    return model


def _scene(path: Path) -> object:
    scene = stimlib.load(path)
    repr(scene)
    proc = stimlib.compile(scene, 8000, target="python")
    proc.process(np.zeros((len(proc.inputs), 4)))
    return scene


@cache
def _scenes() -> list[bytes]:
    x = stimlib.Input("x", "m")
    table = lut(x, [0.0, 0.1, 0.3], [1.0, 2.0, 4.0], "pchip")
    late = stimlib.Scene({"y": table, "z": stimlib.blocks.delay(x, 3)})
    made = [squeeze(fingers=1), viscoelastic(), late]
    return [json.dumps(scene.to_dict()).encode() for scene in made]


SPRING = stimlib.Scene({"f": stimlib.Param("k", 2.0, "N/m") * stimlib.Input("x", "m")})
HAND = {"x": minimum_jerk()}


def _written_audio(folder: Path) -> None:
    proc = stimlib.compile(SPRING, 8000, target="python")
    for name in ("a.wav", "a.flac"):
        proc.reset()
        file.write(folder / name, proc, HAND, 0.01, full_scale=1.0, progress=False)


def _sound(path: Path) -> object:
    found = file.read(path)
    stimlib.verify(SPRING, HAND, path)
    return found


def _written_log(folder: Path) -> None:
    how = {"motion": HAND, "clocked": False, "log": folder / "a.stimlog"}
    played(NullSink(SPRING, 50.0, **how), 0.05)


def _logged(name: str) -> Reader:
    def read(path: Path) -> object:
        log = read_log(path.parent)
        processor(log, target="python")
        if log.frames < 10_000:
            replay(log)
        return log

    return Reader(name, lambda: [made(_written_log)[name]], read, partial(made, _written_log))


def _pattern(suffix: str) -> Reader:
    def read(path: Path) -> object:
        pattern = files.read_pattern(path)
        for written in (".ahap", ".haptic", ".hjif"):
            if pattern.seconds < 2.0 and len(pattern.patterns) < 3:
                with suppress(StimlibError):  # what the format cannot say
                    files.write_pattern(path.with_name(f"b{written}"), pattern, fs=1000)
        return pattern

    seeds = sorted(PATTERNS.glob(f"*{suffix}"))
    return Reader(f"a{suffix}", lambda: [path.read_bytes() for path in seeds], read)


TABLES = [CSV.encode(), EUROPE.encode(), CSV.replace('"', "").encode(), ABOVE.encode()]
DIALECTS = [
    CSV.replace(",", "\t").encode("utf-16"),
    gzip.compress(CSV.encode(), mtime=0),
    b"Tracker\xb5 3\n\n% by hand\nt_s  x_m\n  s    m\n" + b"0 1e-3\n# pause\n\n.01 2e-3\n.02 n/a\n",
    b"t_s|x_m|\n12:30:00.5|0.001|\n12:30:00.51|0.002|\n12:30:00.52||\n",
    b"t_s,x_m\n65534,0.001\n65535,0.002\n0,0.003\n1,-9999\n3,0.002\n",
]
AUDIO = partial(made, _written_audio)
READERS: dict[str, Reader] = {
    "csv": Reader("log.csv", lambda: TABLES, _recording),
    "dialects": Reader("log.tsv", lambda: DIALECTS, _recording),
    "bids": Reader(
        "a_stim.tsv",
        lambda: [b"0.001\t2\n0.002\t3\n0.004\t3\n"],
        _recording,
        lambda: {"a_stim.json": b'{"SamplingFrequency": 100.0, "Columns": ["x_m", "f"]}'},
    ),
    "npz": Reader("log.npz", _npz, _recording),
    "table": Reader("profile.csv", lambda: [TABLE.encode()], _table),
    "texture": Reader("a.xml", lambda: [made(_written_texture)["a.xml"]], _texture),
    "scene": Reader("scene.json", _scenes, _scene),
    "sidecar": Reader(
        "a.wav.json",
        lambda: [made(_written_audio)["a.wav.json"]],
        lambda path: _sound(path.with_suffix("")),
        AUDIO,
    ),
    "audio": Reader("a.wav", lambda: [made(_written_audio)["a.wav"]], _sound, AUDIO),
    "flac": Reader("a.flac", lambda: [made(_written_audio)["a.flac"]], _sound, AUDIO),
    "ahap": _pattern(".ahap"),
    "haptic": _pattern(".haptic"),
    "hjif": _pattern(".hjif"),
    "session": _logged("session.json"),
    "events": _logged("events.jsonl"),
    "motion": _logged("motion.f64"),
    "report": _logged("report.json"),
}
