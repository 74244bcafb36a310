"""Sets of files: resumable, the same bytes whatever the number of workers, and an order
that is fixed by its seed.
"""

import importlib
import json
import os
from pathlib import Path

from commands import ran
from refusals import refused

import stimlib
from stimlib import BadValue, SinkError
from stimlib.files import audio as file
from stimlib.files.batch import order, render_set
from stimlib.motion.generators import constant_speed
from stimlib.scenes import bumps, bumps_set

MOTION = {"x": constant_speed(0.02, 0.1)}
SET = {
    f"{s.waveform}{s.bumps}": bumps(*s) for s in bumps_set() if s.duty == 0.5 and s.amplitude == 4.0
}


def listing(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir()}


OWN = """
from dataclasses import dataclass
from typing import NamedTuple
from stimlib import Block

class Numbers(NamedTuple):
    a: float

@dataclass(frozen=True, eq=False)
class Doubled(Block):
    x: Block
    def design(self, fs):
        return Numbers(2.0), Numbers(0.0)
    @staticmethod
    def step(p, s, x):
        return p.a * x, s
"""


def test_bytes_do_not_depend_on_the_workers_and_a_set_goes_on(tmp_path, monkeypatch):
    (tmp_path / "doubling.py").write_text(OWN)  # a block of the user's, which workers import
    monkeypatch.syspath_prepend(tmp_path)
    doubled = importlib.import_module("doubling").Doubled
    scenes = SET | {"own": stimlib.Scene({"y": doubled(stimlib.Input("x", "m"))})}
    how = {"full_scale": 400.0, "progress": False}
    for workers in (1, 2):
        render_set(tmp_path / str(workers), scenes, MOTION, 0.1, workers=workers, **how)
    one, two = listing(tmp_path / "1"), tmp_path / "2"
    assert one == listing(two)
    assert len(one) == 2 * len(scenes) + 1 and not [n for n in one if n.endswith(".part")]
    assert abs(file.read(two / "sine6.wav")[0]).max() <= 200.0
    kept = os.stat(two / "sine6.wav").st_mtime_ns
    (two / "index.json").unlink()
    (two / "square2.wav").unlink()
    (two / "square6.wav").write_bytes(one["square6.wav"][:1000])  # what a killed machine leaves
    render_set(two, scenes, MOTION, 0.1, workers=1, **how)
    assert listing(two) == one and os.stat(two / "sine6.wav").st_mtime_ns == kept


def test_another_job_is_rendered_again(tmp_path):
    words = {"motion": MOTION, "seconds": 0.1, "workers": 1, "progress": False}
    found = set()
    for change in (
        {},
        {"seconds": 0.12},
        {"seed": 1},
        {"full_scale": 2.0},
        {"motion": {"x": constant_speed(0.03, 0.1)}},
    ):
        path = render_set(tmp_path, {"a": SET["sine6"]}, **words | change)
        assert path == tmp_path / "index.json"
        found.add((tmp_path / "a.wav.json").read_bytes())
    assert len(found) == 5
    words["full_scale"] = 400.0
    render_set(tmp_path, {"a": SET["sine6"]}, **words)
    rendered, proc = (tmp_path / "a.wav").read_bytes(), stimlib.compile(SET["sine6"], 8000)
    for subtype in ("PCM_16", "FLOAT"):  # the second goes on from the first
        how = {"subtype": subtype, "full_scale": 400.0, "progress": False}
        file.write(tmp_path / "a.wav", proc, MOTION, 0.1, **how)
        render_set(tmp_path, {"a": SET["sine6"]}, **words)
        assert (tmp_path / "a.wav").read_bytes() == rendered


def test_orders_are_permutations_fixed_by_the_seed():
    first = order(81, 4, seed=3)
    assert first == order(81, 4, seed=3) != order(81, 4, seed=4)
    assert all(sorted(o) == list(range(81)) for o in first) and len({tuple(o) for o in first}) == 4
    assert order(5, 1, seed=0) == [[3, 2, 1, 4, 0]]  # for all time


def test_mistakes(tmp_path):
    for scenes in ({}, {"../a": SET["sine6"]}, {"": SET["sine6"]}):
        refused(BadValue, None, render_set, tmp_path, scenes, MOTION, 0.1, progress=False)
    refused(BadValue, "repetitions", render_set, tmp_path, SET, MOTION, 0.1, repetitions=0)
    (tmp_path / "file").write_text("")
    refused(SinkError, "folder", render_set, tmp_path / "file" / "in", SET, MOTION, 0.1)


def test_the_command_takes_a_recording_or_renders_the_experiment(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("finger.csv").write_text(
        "t_s,x_mm,contact\n0,1,1\n0.01,2,1\n0.02,3,0\n0.03,4,1\n", encoding="utf-8"
    )
    monkeypatch.setattr("stimlib.scenes.bumps_set", lambda: bumps_set()[::27])
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # as many workers as there are cores
    words = "render-set set --motion finger.csv --map x=x_mm*1e-3 --workers 1"
    ran(words, 2, "has no input contact; add --contact")
    ran(words + " --contact")
    ran("render-set other --seconds 0.01 --seed 7 --repetitions 3")
    for folder, frames, more in (("set", 240, (4, 0)), ("other", 80, (3, 7))):
        index = json.loads(Path(folder, "index.json").read_text(encoding="utf-8"))
        name, file_name = list(index["files"].items())[-1]
        names = list(index["files"])
        assert index["presentation"] == [[names[i] for i in one] for one in order(3, *more)]
        info = file.read(Path(folder, file_name))[1]
        assert info["frames"] == frames and info["scene_hash"] == index["scene_hashes"][name]
        ran(["verify", Path(folder, file_name)])
