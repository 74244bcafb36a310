"""Would the verifier notice?  Faults put into a block's design or step, one at a time, and which check catches each.

``python tests/checks/test_mutations.py`` prints the table of docs/verification.rst.
"""

import contextlib
import importlib

import numpy as np
import pytest

import stimlib
from stimlib.blocks.fir import Differentiator
from stimlib.blocks.gate import Gate, GateState
from stimlib.blocks.impedance import Velocity
from stimlib.blocks.modes import Modes, PinkNoise
from stimlib.blocks.noise import White, noise_key
from stimlib.devices.motion import minimum_jerk
from stimlib.maths import modes as modes_sum
from stimlib.maths import where
from stimlib.targets import numba as target

MOTION = {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.015, rise=0.25)}
SEED = 5


def scaled(f, change):
    """A design(fs) whose parameters are changed."""

    def design(self, fs):
        p, s = f(self, fs)
        return change(p), s

    return design


def louder(p):
    return p._replace(r=p.r * 10**0.01, d=p.d * 10**0.01)


def steeper(p):
    return p._replace(taps=p.taps * 1.01)


def off_tap(p):
    taps = p.taps.copy()
    taps[40] += 1e-4 * np.abs(taps).max()
    return p._replace(taps=taps)


def inverted_tile(p, s, x, y):
    g = s.g
    for i in range(y.size):
        g = where(x[i] > where(g > 0.0, p.off, p.on), 0.0, 1.0)
        y[i] = g
    return GateState(g)


def early_tile(p, s, x, y):
    g = s.g
    for i in range(y.size):
        j = where(i + 1 < y.size, i + 1.0, i + 0.0)
        g = where(x[np.int64(j)] > where(g > 0.0, p.off, p.on), 1.0, 0.0)
        y[i] = g
    return GateState(g)


def forgetful_tile(p, s, x, y, w):
    s.q[0] = s.q[0] * 0.999
    modes_sum(p.e, p.r, s.q, p.d, x, y, w)
    return s


def one_stream(self, p, s, seed):
    return s._replace(key=noise_key(seed, self.seed, 1, 0))


def no_seed(self, p, s, seed):
    return s._replace(key=noise_key(0, self.seed, self.stream, 0))


def wrong_words(p, sizes, right=target._parameter_words):
    if "ModesParams" in type(p).__name__:
        p = p._replace(r=p.r * 10**0.01)
    return right(p, sizes)


def strong_spring(x, k, right=None):
    return stimlib.blocks.spring(x, k) * 1.01


# name: (owner, attribute, replacement, groups of which at least one check must fail)
MUTATIONS = {
    "pink 0.2 dB off, in the design": (PinkNoise, "design", scaled(PinkNoise.design, louder), {"a2"}),
    "pink 0.2 dB off, in the compiled residues": (target, "_parameter_words", wrong_words, {"a1"}),
    "FIR gain 1 % off": (Differentiator, "design", scaled(Differentiator.design, steeper), {"a2"}),
    "one tap off by 1e-4": (Differentiator, "design", scaled(Differentiator.design, off_tap), {"a2"}),
    "gate inverted": (Gate, "tile", staticmethod(inverted_tile), {"e"}),
    "gate early by one sample": (Gate, "tile", staticmethod(early_tile), {"e"}),
    "one noise for both fingers": (White, "start", one_stream, {"c"}),
    "seed ignored": (White, "start", no_seed, {"c"}),
    "rate doubled": (Velocity, "design", scaled(Velocity.design, lambda p: p._replace(fs=2 * p.fs)), {"a2", "d"}),
    "k 1 % off": ("scene", "spring", strong_spring, {"d"}),
    "state that depends on the cut": (Modes, "tile", staticmethod(forgetful_tile), {"b"}),
}  # fmt: skip


@contextlib.contextmanager
def mutated(name):
    owner, attribute, replacement, _ = MUTATIONS[name]
    if owner == "scene":
        owner = importlib.import_module("stimlib.scenes.squeeze")
    right = owner.__dict__[attribute]
    setattr(owner, attribute, replacement)
    try:
        yield
    finally:
        setattr(owner, attribute, right)


def failed(seed=SEED, seconds=2.0):
    scene = stimlib.scenes.squeeze()
    rendering = stimlib.render(scene, MOTION, 8000, seconds, seed=seed)
    return [c for c in stimlib.verify(scene, MOTION, rendering).checks if not c.passed]


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_verifier_catches(name):
    with mutated(name):
        caught = {c.group for c in failed()}
    assert caught & MUTATIONS[name][3] == MUTATIONS[name][3], caught


def test_fifty_correct_renderings_pass():
    wrong = {seed: bad for seed in range(50) if (bad := failed(seed, seconds=1.0))}
    assert not wrong


def table():
    """Rows of (fault, checks that fail)."""
    for name in MUTATIONS:
        with mutated(name):
            yield name, [f"({c.group}) {c.name}" for c in failed()]


if __name__ == "__main__":
    for fault, checks in table():
        print(fault)
        for check in checks:
            print("   ", check)
