"""By what a row is known again: whatever changes its figures changes its key, and making the same thing again does not."""

import functools
import json

import numba
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from stimlib import BadValue, Input, Param, Scene, SinkError, UnknownName, constant
from stimlib.motion.generators import minimum_jerk
from stimlib.sweep import grid, measure, sweep
from stimlib.sweep.plan import identity, motion_digest

RUN = {"motion": np.ones(400), "fs": 8000, "progress": False}
SPRING = Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")})


class Hand:
    def __init__(self, depth):
        self.depth = depth

    def __call__(self, t):
        return self.depth * t

    def back(self, t):
        return -self.depth * t


def level(run, low=0.0, high=1.0):
    return low + high


def of(value):
    return lambda run: value


def guarded(a, b):
    try:
        return a(b)
    except ZeroDivisionError:
        return b


TABLES = [{"x": np.zeros(5000)}, {"x": np.zeros(5000)}]
TABLES[1]["x"][2500] = 1.0
CACHED = [functools.cache(lambda t: t), functools.cache(lambda t: 2 * t)]
COMPILED = [numba.njit(lambda t: t), numba.njit(lambda t: 2 * t)]
PAIRS = {
    "splines": (CubicSpline([0, 1, 2], [0, 1, 2]), CubicSpline([0, 1, 2], [0, 1, 3])),
    "objects": (Hand(0.01), Hand(0.02)),
    "methods": (Hand(0.01).back, Hand(0.02).back),
    "methods by name": (Hand(0.01).back, Hand(0.01).__call__),
    "ufuncs": (np.sin, np.cos),
    "lambdas of one line": (lambda t: 0.01 * t, lambda t: 0.02 * t),
    "cached": tuple(CACHED),
    "keywords": (functools.partial(level, low=1, high=2), functools.partial(level, high=1, low=2)),
    "large arrays in a dict": tuple(map(of, TABLES)),
    "named splines": (of(CubicSpline([0, 1, 2], [0, 1, 2])), of(CubicSpline([0, 1, 2], [0, 1, 3]))),
    "named compiled functions": tuple(map(of, COMPILED)),
    "scenes": (of(Scene({"y": constant(1.0) * 2})), of(Scene({"y": constant(1.0) * 3}))),
    "blocks": (of(2.0 * Input("x")), of(3.0 * Input("x"))),
    "defaults": (lambda run, a=TABLES[0]: a, lambda run, a=TABLES[1]: a),
    "what is prepared": tuple(measure("N", prepare=lambda x, fs, g=g: g)(level) for g in (1.0, 2.0)),
}  # fmt: skip


@pytest.mark.parametrize("name", PAIRS)
def test_what_does_something_else_is_something_else(name):
    one, other = PAIRS[name]
    assert identity(one) != identity(other)


def test_the_same_made_again_is_the_same():
    for make in (
        lambda: CubicSpline([0, 1, 2], [0, 1, 3]),
        lambda: Hand(0.01).back,
        lambda: of({"b": np.ones(3), "a": {"x", "y"}}),
    ):
        assert identity(make()) == identity(make())
    ring: list = [1.0]
    ring.append(ring)
    assert "1.0" in identity(ring)


def test_every_sample_of_a_motion_counts():
    end = np.ones(400)
    end[-1] = 2.0
    assert motion_digest(np.ones(400), 8000, None) == motion_digest([1.0] * 400, 8000, None) != motion_digest(end, 8000, None)
    hands = {"slow": lambda t: 0.01 * t, "fast": lambda t: 0.02 * t}
    words = RUN | {"motion": hands, "seconds": 0.05}
    slow, fast = sweep(SPRING, {"motion": ["slow", "fast"]}, measures="peak", **words)["peak_force"].to_pylist()
    assert fast == 2 * slow > 0


def test_arguments_of_all_kinds_tell_rows_apart(tmp_path):
    def made(shape="flat", twice=False, k=1.0):
        gain = {"flat": 1.0, "steep": 3.0}[shape] * (2.0 if twice else 1.0)
        return Scene({"y": gain * Param("k", k) * Input("x")})

    rows = grid(shape=["flat", "steep"], twice=[False, True])
    words = RUN | {"measures": "peak", "out": tmp_path}
    table = sweep(made, rows, live=[], **words)
    assert table["peak_y"].to_pylist() == [1.0, 2.0, 3.0, 6.0]
    with pytest.raises(BadValue, match="with other arguments: name"):
        sweep(made, {"k": [1.0]}, live=[], **words)
    with pytest.raises(BadValue, match="with other live, arguments: name"):
        sweep(made, {"k": [1.0]}, live=["k"], **words)
    with pytest.raises(UnknownName, match="k is no column"):
        sweep(made, rows, live=["k"], **words)


def test_other_versions_are_another_sweep_and_the_folder_tells_its_motions(tmp_path, monkeypatch):
    words = RUN | {"measures": "peak", "out": tmp_path}
    hand = minimum_jerk(depth=0.02)
    for name, motion in (("a", np.ones(400)), ("b", hand)):
        sweep(SPRING, {"motion": [name], "k": [1.0]}, **words | {"motion": {name: motion}, "seconds": 0.05})
    sidecar = tmp_path / "sweep.json"
    told = json.loads(sidecar.read_text())
    assert set(told["motion"]) == {"a", "b"} and repr(hand) in told["motion"]["b"]
    monkeypatch.setattr("stimlib.sweep.plan.version", lambda package: "0")
    with pytest.raises(BadValue, match="with other versions: name"):
        sweep(SPRING, {"k": [1.0]}, **words)
    monkeypatch.undo()
    monkeypatch.setattr("stimlib.sweep.plan.definitions", lambda scene: {"click_block": {"sha256": "0"}})
    with pytest.raises(BadValue, match="with other blocks: name"):
        sweep(SPRING, {"k": [1.0]}, **words)
    monkeypatch.undo()
    sidecar.write_text(json.dumps(told | {"stimlib_sweep": 2}))
    with pytest.raises(SinkError, match="of version 2, this stimlib reads 1"):
        sweep(SPRING, {"k": [1.0]}, **words)


def test_another_factory_is_another_sweep_and_its_scenes_have_the_same_figures(tmp_path):
    def factory(gain):
        def made(name="y"):
            return Scene({name: gain * Input("x")})

        return made

    words = RUN | {"measures": "peak"}
    sweep(factory(2.0), {"name": ["y"]}, out=tmp_path, **words)
    with pytest.raises(BadValue, match="with other scene: name"):
        sweep(factory(3.0), {"name": ["y"]}, out=tmp_path, **words)
    told = sweep(factory(2.0), {"name": ["y", "z"]}, **words)
    assert told["error"][0].as_py() is None and "the scene of this row gives peak_z" in told["error"][1].as_py()
