"""Programs of any width of vectors have the same bits."""

import hashlib
import os
import subprocess
import sys
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from numba import config

import stimlib
from stimlib import Block, Input, Param, Scene, SceneError
from stimlib import blocks as b
from stimlib.core.maths import each, exp, where

STRESS = bool(os.environ.get("STIMLIB_STRESS"))
TEXT = """
import sys
sys.path.insert(0, "tests")
from test_vectors import said
print(said(), end="")
"""


def scene():
    y, u = Input("y", "m"), Input("u")
    noise = b.differentiator(b.pink_noise(0.3, seed=4, f_low=5.0), passband=300.0, order=102)
    force = b.springpot(y, 10.0, 0.5, scheme="l1", tol=1e-12)
    if not STRESS:
        return Scene({"n": noise, "f": force, "e": u / (1.0 + u * u)})
    force = force + b.springpot(y, 10.0, Param("alpha", 0.4), tol=1e-10)
    touch = b.bump(u, "sine", 0.3) * b.carrier(Param("f", 220.0, "Hz")) + b.bump(u, "sawtooth", 0.3)
    return Scene({"n": noise, "f": force, "t": touch, "v": b.velocity(y), "e": b.exp(u) / (1.0 + u * u)})


def said():
    """Features in use, and a hash of the samples, at several blocks."""
    proc = stimlib.compile(scene(), 2000.0, seed=3)
    rng = np.random.default_rng(0)
    x = np.cumsum(rng.standard_normal((2, 500)) * [[1e-3], [0.02]], axis=1)
    parts = [proc.process(np.ascontiguousarray(x[:, a:z])) for a, z in ((0, 1), (1, 8), (8, 200), (200, 233), (233, 500))]
    widest = "512" if "+avx512f" in (config.CPU_FEATURES or "") else "256" if "+avx," in (config.CPU_FEATURES or "") else "128"
    return f"{widest} {hashlib.sha256(np.concatenate(parts, axis=1).tobytes()).hexdigest()}"


@pytest.mark.parametrize("bits", ["128", "256"] if STRESS else ["256"])
def test_narrow_vectors_give_the_same_bits(bits, tmp_path):
    env = os.environ | {"STIMLIB_VECTOR_BITS": bits, "STIMLIB_CACHE": str(tmp_path / "cache")}
    (tmp_path / "cache").mkdir(mode=0o700)
    done = subprocess.run([sys.executable, "-c", TEXT], env=env, capture_output=True, text=True, timeout=600)
    assert done.stderr == "" and done.stdout.split() == [bits, said().split()[1]]


def test_another_width_is_refused():
    done = subprocess.run(
        [sys.executable, "-c", "import stimlib.targets.numba.kernels"],
        env=os.environ | {"STIMLIB_VECTOR_BITS": "64"}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 1 and done.stderr.endswith("STIMLIB_VECTOR_BITS = 64: choose one of 512, 256, 128\n")


# Steps and helpers of authors -------------------------------------------------------------------------------------------
class At(NamedTuple):
    t: float


@dataclass(frozen=True, eq=False)
class Own(Block, abstract=True):
    x: Block

    def design(self, fs):
        return At(0.5), ()


@dataclass(frozen=True, eq=False)
class Pressed(Own):
    @staticmethod
    def step(p, s, x):
        return x > p.t, s


@dataclass(frozen=True, eq=False)
class Between(Own):
    @staticmethod
    def step(p, s, x):
        return where(0.0 < x < p.t, x, 0.0), s


@dataclass(frozen=True, eq=False)
class Gated(Own):
    @staticmethod
    def step(p, s, x):
        return (x > p.t) * x, s


@dataclass(frozen=True, eq=False)
class Truth(Own):
    @staticmethod
    def step(p, s, x):
        return where(x, 1.0, 0.0), s


@dataclass(frozen=True, eq=False)
class Both(Own):
    @staticmethod
    def step(p, s, x):
        return where((x > 0.0) & (x < p.t), 2, 1) + 1, s


@dataclass(frozen=True, eq=False)
class One(Own):
    @staticmethod
    def step(p, s, x):
        return 1.0, s


@pytest.mark.parametrize("cls", [Pressed, Between, Gated, Truth, Both, One])
def test_what_vectors_do_not_have_runs_as_it_is_meant(cls):
    x = np.array([[-0.25, 0.25, 0.75, 1.25, 0.0, -0.0, np.nan, np.inf, 0.5]])
    y = [stimlib.compile(Scene({"y": cls(Input("x"))}), 1000.0, target=target).process(x) for target in ("python", "numba")]
    np.testing.assert_array_equal(*y)


def chained(p, x):
    return where(0.0 < x < p.t, x, 0.0)


def compared(p, x):
    return x > p.t


def chosen(p, x):
    if x > p.t:
        return x
    return 0.0 * x


def decayed(p, x):
    return exp(x)


@dataclass(frozen=True, eq=False)
class Chained(Own):
    @staticmethod
    def tile(p, s, x, y):
        each(chained, p, (x,), y)
        return s


@dataclass(frozen=True, eq=False)
class Compared(Own):
    @staticmethod
    def tile(p, s, x, y):
        each(compared, p, (x,), y)
        return s


@dataclass(frozen=True, eq=False)
class Chosen(Own):
    @staticmethod
    def tile(p, s, x, y):
        each(chosen, p, (x,), y)
        return s


@dataclass(frozen=True, eq=False)
class Decayed(Own):
    @staticmethod
    def tile(p, s, x, y):
        each(decayed, p, (x,), y)
        return s


@pytest.mark.parametrize(
    ("cls", "why"),
    [
        (Chained, "each lane has a truth value of its own"),
        (Compared, "it returns no number"),
        (Chosen, "`if` chooses at run time"),
        (Decayed, "write a loop over the samples"),
    ],
)
def test_a_helper_that_vectors_cannot_take_is_an_error(cls, why):
    with pytest.raises(SceneError, match=why):
        stimlib.compile(Scene({"y": cls(Input("x"))}), 1000.0)


def test_without_a_compiler_it_says_so():
    text = 'import stimlib as s\ns.compile(s.Scene({"y": 1.0 * s.Input("x")}), 1000)'
    done = subprocess.run(
        [sys.executable, "-c", text], env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True
    )
    assert done.returncode == 1 and done.stderr.endswith('is compiled: unset it, or take target="python"\n')
