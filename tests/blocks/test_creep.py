"""Creep: a springpot under force, against the continuous law and against its dual."""

from math import gamma

import numpy as np
import pytest

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnitError
from stimlib.blocks import compliance, springpot

ALPHAS = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0]
f = Input("f", "N")


@pytest.mark.parametrize("fs", [1000, 8000])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_creep_under_a_held_force(alpha, fs):
    proc = stimlib.compile(Scene({"y": compliance(f, 100.0, alpha, "l1")}), fs)
    t = np.arange(1, 10 * fs + 1) / fs
    y = proc.process(np.ones((1, t.size)))[0]
    np.testing.assert_allclose(y, t**alpha / (100 * gamma(1 + alpha)), rtol=1e-10)
    assert proc.units["y"] == "m"


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_springpot_gives_the_force_back(alpha):
    y = compliance(f, 100.0, alpha)
    proc = stimlib.compile(Scene({"f": springpot(y, 100.0, alpha, onset="step")}), 1000)
    force = np.random.default_rng(0).standard_normal((1, 20000)).cumsum(axis=1)
    np.testing.assert_allclose(proc.process(force), force, rtol=0, atol=1e-9 * np.abs(force).max())


def test_the_integral_keeps_what_rounding_loses():
    proc = stimlib.compile(Scene({"y": compliance(f, 1.0, 1.0)}), 1000)
    y = proc.process(np.full((1, 1_000_000), 0.1))[0, -1]
    assert y == pytest.approx(100.0, rel=2e-16)


def test_ends_are_exact():
    force = np.random.default_rng(1).standard_normal((1, 100))
    spring = stimlib.compile(Scene({"y": compliance(f, 8.0, 0.0)}), 1000)
    assert np.array_equal(spring.process(force), force / 8.0)


def test_chi_may_be_live():
    proc = stimlib.compile(Scene({"y": compliance(f, Param("chi", 10.0), 0.5)}), 1000)
    first = proc.process(np.ones((1, 100)))
    proc.reset()
    proc.set("chi", 20.0, ramp=0.0)
    np.testing.assert_allclose(proc.process(np.ones((1, 100))), first / 2, rtol=1e-15)


def test_mistakes():
    with pytest.raises(UnitError, match="not in N"):
        compliance(Input("y", "m"), 1.0, 0.5)
    for words in ({"alpha": 1.5}, {"alpha": -0.1}, {"alpha": 0.5, "tol": 1e-20}, {"alpha": 0.5, "scheme": "gl-downsampled"}):
        with pytest.raises(BadValue):
            compliance(f, 1.0, **words)
    with pytest.raises(BadValue):
        compliance(f, -1.0, 0.5)
