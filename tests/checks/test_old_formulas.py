"""Formulas that stimlib had and that did not keep their docstring: put back into a
block, verify refuses them by a law.

The rendering and its re-render are both made with the old formula, so that the law
alone can tell.
"""

import dataclasses as dc
import math

import numpy as np
import pytest
from faults import half_a_sample_early, hundred_samples, warped

import stimlib
from stimlib import Input, Scene, blocks as b
from stimlib.blocks.filters import Taps
from stimlib.blocks.fractional import ShortMemory, Springpot
from stimlib.blocks.impedance import FirstOrder
from stimlib.blocks.resonance import Resonator

X, F = Input("x", "m"), Input("f", "N")
NOW = {cls: cls.design for cls in (Taps, FirstOrder)}


def at_the_sample(block, fs):
    """The spring's position at the sample, half a sample before that of its damper."""
    return NOW[Taps](dc.replace(block, taps=np.array([1.0, 0.0])), fs)


def rounded_leak(block, fs):
    """A lag by exp(-1/(tau fs)), whose gain at 0 Hz is 1e-7 off for 1e6 s."""
    a = 1 / (block.tau * fs)
    e = math.exp(-a)
    now = a / 2 - a * a / 6 + a**3 / 24
    p, s = NOW[FirstOrder](block, fs)
    return type(p)(e, now, -math.expm1(-a) - now), s


CASES = [
    (Resonator, warped, lambda: b.resonator(X, 700.0, 5.0), 8000),
    (Resonator, warped, lambda: b.resonator(X, 250.0, 5.0), 1000),
    (Resonator, warped, lambda: b.notch(X, 50.0, 3.0), 8000),
    (Resonator, warped, lambda: b.notch(X, 400.0, 5.0), 1000),
    (Springpot, half_a_sample_early, lambda: b.compliance(F, 100.0, 0.5, "l1"), 1000),
    (Springpot, half_a_sample_early, lambda: b.compliance(F, 100.0, 0.3, "l1"), 8000),
    (ShortMemory, hundred_samples, lambda: b.springpot(X, 3.0, 0.5, "gl-short-memory"), 8000),
    (ShortMemory, hundred_samples, lambda: b.springpot(X, 3.0, 0.5, "gl-short-memory"), 500),
    (Taps, at_the_sample, lambda: b.kelvin_voigt(X, 300.0, 10.0), 1000),
    (FirstOrder, rounded_leak, lambda: b.first_order(X, 1e6), 8000),
]


@pytest.mark.parametrize(("cls", "old", "make", "fs"), CASES)
def test_an_old_formula_is_refused_by_a_law(cls, old, make, fs, monkeypatch):
    scene = Scene({"y": make()})
    rng = np.random.default_rng(3)
    motion = {
        name: 0.01 * (1 - np.cos(np.arange(2000) / 50)) + 1e-3 * rng.standard_normal(2000)
        for name in scene.inputs
    }

    def report():
        return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs, target="python"))

    assert report().passed
    monkeypatch.setattr(cls, "design", old)
    failed = [c.name for c in report().checks if not c.passed]
    assert f"{cls.__name__}: physical law" in failed and "delivered = re-render" not in failed
