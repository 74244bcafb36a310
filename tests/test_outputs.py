"""Blocks with several outputs: one run of the block for all who listen, on every target
and in every cut.
"""

import json
import re
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from laws import twins
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, SceneError, blocks as b
from stimlib.core import units as un
from stimlib.core.graph import Block, Map
from stimlib.core.guard import Guard
from stimlib.core.maths import where

x, c = Input("x"), Input("c")
FS = 1000.0


class Angle(NamedTuple):
    a: float
    cold: float


@dataclass(frozen=True, eq=False)
class Rotor(Block):
    """x, y and turns of an angle that moves on by w per sample, in contact."""

    outputs = ("x", "y", "turns")
    w: Block
    contact: Block
    resettable = True

    def units(self, *u):
        return u[0], u[0], un.ONE

    def design(self, fs):
        return (), Angle(0.25, 1.0)

    @staticmethod
    def step(p, s, w):
        a = s.a + w
        far = 1.0 + a * a
        return (1.0 / far, a / far, a / 6.25), Angle(a, 0.0)


@dataclass(frozen=True, eq=False)
class Halves(Block):
    """A tile of two outputs, with scratch."""

    outputs = ("low", "high")
    x: Block

    def units(self, *u):
        return u[0], u[0]

    @staticmethod
    def work(p):
        return 64

    @staticmethod
    def tile(p, s, x, low, high, w):
        for i in range(x.size):
            w[i] = 0.5 * x[i]
        for i in range(x.size):
            low[i] = w[i]
            high[i] = x[i] - 0.25 * w[i]
        return s

    def through(self, p, fs, z, H, value):
        return 0.5 * H[0], 0.875 * H[0]


@dataclass(frozen=True, eq=False)
class Parts(Map):
    """What is above and below 0, without state."""

    outputs = ("above", "below")
    x: Block

    def units(self, *u):
        return u[0], u[0]

    @staticmethod
    def step(p, s, x):
        return (where(x > 0.0, x, 0.0), where(x > 0.0, 0.0, x)), s


ROTOR, PARTS, OF_PARAM = Rotor(x, c > -0.5), Parts(x), Parts(Param("k", -2.0))
CASES = {
    "one of three": {"turns": ROTOR.turns},
    "two of three": {"x": ROTOR.x, "turns": 2.0 * ROTOR.turns},
    "always": {"y": Rotor(x, 1.0).y},
    "side by side": {"y": Rotor(x, 1.0).y, "z": Rotor(c, 1.0).x},
    "of a tile": {"low": Halves(x).low, "high": Halves(x).high},
    "one of a tile": {"high": Halves(x).high},
    "of a map": {"sum": PARTS.above - PARTS.below, "below": PARTS.below},
    "of a parameter": {"y": OF_PARAM.below * x + OF_PARAM.above},
    "on a clock": {"y": b.enabled(Parts(b.white_noise(1)).above, by=x)},
    "of an output that others read": {"y": x, "z": b.first_order(abs(Guard(x)), 0.01)},
}


@pytest.mark.parametrize("name", CASES)
def test_every_target_and_cut(name):
    scene = Scene.from_dict(json.loads(json.dumps(Scene(CASES[name]).to_dict())))
    fast, u, wanted = twins(scene, FS, 200, 1, 7, 64)
    assert np.any(wanted)
    if name in ("two of three", "of a map", "on a clock"):
        y = stimlib.compile(scene, FS, target="jax")({}, u)
        rows = [y[output] for output in fast.outputs]
        np.testing.assert_allclose(rows, wanted, rtol=1e-12, atol=1e-12)


def test_the_samples():
    proc = stimlib.compile(Scene({"x": ROTOR.x, "y": ROTOR.y, "turns": ROTOR.turns}), FS)
    y = proc.process(np.array([[1.0, 1.0, 9.0, 1.0], [0.0, 0.0, -1.0, 0.0]]))
    angle = np.array([1.25, 2.25, 0.0, 1.25])
    far = 1 + angle**2
    np.testing.assert_allclose(y, [[1, 1, 0, 1] / far, angle / far, angle / 6.25], rtol=1e-15)
    assert [proc.units[n] for n in proc.outputs] == ["1", "1", "1"]


def test_the_block_runs_once_and_what_nobody_reads_is_not_stored():
    two = stimlib.compile(Scene(CASES["two of three"]), FS)
    assert [r.kind for r in two.plan.rows].count("pick") == 2
    assert sum("Rotor" in r.block and r.kind == "block" for r in two.plan.rows) == 1
    one = stimlib.compile(Scene(CASES["one of three"]), FS)
    assert set(one._engine.segments) - set(two._engine.segments), "one segment for both"


def test_response_and_latency():
    proc = stimlib.compile(Scene({"y": Halves(b.delay(x, 2)).high}), FS)
    z = np.exp(2j * np.pi * 100 / FS)
    np.testing.assert_allclose(proc.response("y", "x", [100.0]), [0.875 / z**2])
    assert proc.latency["y", "x"] == (2, 2)


def test_a_picture_names_the_outputs_that_are_read():
    svg = stimlib.draw(Scene({"a": ROTOR.y, "b": ROTOR.turns})).svg
    drawn = re.findall(r"<!-- (\w+) -->", svg)  # each text, which is drawn as paths
    assert [drawn.count(name) for name in ("Rotor", "y", "turns")] == [1, 1, 1]


def _class(**body):
    body = {"__annotations__": {"x": Block}, "__module__": __name__, **body}
    return dataclass(frozen=True, eq=False)(type("Wrong", (Block,), body))


def _three(p, s, x):
    return (x, x, x), s


def of_two_outputs():
    cls = _class(outputs=("a", "b"), units=lambda self, *u: u * 2, step=staticmethod(_three))
    return stimlib.compile(Scene({"y": cls(x).a}), FS, "python")


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: ROTOR + 1.0, SceneError, r"choose one, such as \.x"),
        (lambda: Scene({"y": ROTOR}), SceneError, "has the outputs x, y, turns"),
        (lambda: b.enabled(Parts(b.white_noise(1)), by=x), SceneError, "choose one"),
        (lambda: stimlib.core.graph.Pick(ROTOR, "z"), BadValue, "no output 'z'"),
        (lambda: stimlib.core.graph.Pick(x, "z"), BadValue, "no output 'z'"),
        (lambda: _class(outputs=("a", "b"))(x), SceneError, "one for each of a, b"),
        (of_two_outputs, SceneError, "must return 2 samples, for a, b, and returned 3"),
        (lambda: _class(outputs=("x", "b")), TypeError, "output name 'x'"),
        (lambda: _class(outputs=("children", "b")), TypeError, "output name 'children'"),
    ],
)
def test_what_is_refused(make, error, words):
    refused(error, words, make)


def test_a_file_cannot_pick_what_is_not_there():
    data = Scene(CASES["of a map"]).to_dict()
    pick = next(e for e in data["blocks"] if e["class"] == "Pick")
    pick["fields"]["output"] = "units"
    refused(SceneError, "no output 'units'", Scene.from_dict, data)
