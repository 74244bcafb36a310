"""Programs of any width of vectors have the same bits."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, blocks as b
from stimlib.targets.llvm.machine import FEATURES, features

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
    force = force + b.springpot(y, 10.0, Param("alpha", 0.4), tol=1e-10)
    touch = b.bump(u, "sine", 0.3) * b.carrier(Param("f", 220.0, "Hz")) + b.bump(u, "sawtooth", 0.3)
    return Scene(
        {"n": noise, "f": force, "t": touch, "v": b.velocity(y), "e": b.exp(u) / (1.0 + u * u)}
    )


def said():
    """Features in use, and a hash of the samples, at several blocks."""
    proc = stimlib.compile(scene(), 2000.0, seed=3)
    x = np.cumsum(np.random.default_rng(0).standard_normal((2, 500)) * [[1e-3], [0.02]], axis=1)
    parts = [
        proc.process(np.ascontiguousarray(x[:, a:z]))
        for a, z in ((0, 1), (1, 8), (8, 200), (200, 233), (233, 500))
    ]
    widest = 512 if "+avx512f" in FEATURES else 256 if "+avx" in FEATURES else 128
    return f"{widest} {hashlib.sha256(np.concatenate(parts, axis=1).tobytes()).hexdigest()}"


@pytest.mark.stress
@pytest.mark.parametrize("bits", ["128", "256"])
def test_narrow_vectors_give_the_same_bits(bits, tmp_path):
    env = os.environ | {"STIMLIB_VECTOR_BITS": bits, "STIMLIB_CACHE": str(tmp_path / "cache")}
    (tmp_path / "cache").mkdir(mode=0o700)
    done = subprocess.run([sys.executable, "-c", TEXT], env=env, capture_output=True, text=True)
    assert done.stderr == "" and done.stdout.split() == [bits, said().split()[1]]


def test_a_width_is_that_of_all_that_is_compiled():
    """Of machine code, too: no instruction works on a wider register, also on a
    processor with features that need one.
    """
    text = """
from llvmlite import binding
has = binding.get_host_cpu_features()
has.update(dict.fromkeys({"sha512", "sm3", "sm4", "fma4", "xop", "lwp"} & {*has}, True))
binding.get_host_cpu_features = lambda: has
from stimlib.targets.llvm import engine, machine
text = (
    "define <8 x double> @f(<8 x double> %x) {\\n"
    "%y = fadd <8 x double> %x, %x\\nret <8 x double> %y\\n}"
)
made = machine._target_machine().emit_assembly(binding.parse_assembly(text))
print("+avx" in machine.FEATURES, "ymm" in made or "zmm" in made)
"""
    env = os.environ | {"STIMLIB_VECTOR_BITS": "128"}
    done = subprocess.run([sys.executable, "-c", text], env=env, capture_output=True, text=True)
    assert done.stderr == "" and done.stdout == "False False\n"


def test_a_width_that_cannot_be_is_refused(monkeypatch):
    monkeypatch.setenv("STIMLIB_VECTOR_BITS", "64")
    refused(BadValue, "STIMLIB_VECTOR_BITS = '64'; choose one of 512, 256, 128$", features)
