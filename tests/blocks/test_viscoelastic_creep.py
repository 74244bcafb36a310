"""Creep: a springpot under force, against the continuous law and against its dual."""

import re
from math import gamma

import numpy as np
import pytest
from laws import lawful

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnitError, constant
from stimlib.blocks import compliance, springpot
from stimlib.blocks.viscoelastic import compliance_kelvin_voigt, compliance_maxwell

ALPHAS = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0]
f = Input("f", "N")


@pytest.mark.parametrize("fs", [250, 1000, 8000])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_creep_is_exact_for_forces_that_are_straight_between_samples(alpha, fs):
    force = np.r_[0.7, np.random.default_rng(0).standard_normal(150), np.ones(100)]
    lawful(compliance(f, 100.0, alpha, "l1", tol=1e-13), fs, f=force)


@pytest.mark.parametrize("alpha", [0.35, 0.8])
def test_all_creep_has_one_convention_of_time(alpha):
    """At low frequencies each block has the phase of its law: no part of a sample is
    left.
    """
    low = np.array([1.0])
    law = {
        "springpot": (2j * np.pi * low) ** -alpha,
        "element": 1 / (1 + 0.2j * np.pi * low),
        "arm": 1 / (2j * np.pi * low),
    }
    own = {
        "springpot": compliance(f, 1.0, alpha, "l1"),
        "element": compliance_kelvin_voigt(f, 1.0, tau=0.1),
        "arm": compliance_maxwell(f, 1e30, b=1.0),
    }
    proc = stimlib.compile(Scene(own | {"dashpot": compliance(f, 1.0, 1.0, "l1")}), 1000, "python")
    for name, wanted in (law | {"dashpot": law["arm"]}).items():
        # half a sample: 3e-3
        assert np.angle(proc.response(name, "f", low) / wanted)[0] == pytest.approx(0, abs=2e-5)


@pytest.mark.parametrize("fs", [1000, 8000])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_creep_under_a_held_force(alpha, fs):
    """From 0 to 1 N within the first sample."""
    fixed, live = compliance(f, 100.0, alpha, "l1"), compliance(f, Param("chi", 100.0), alpha, "l1")
    proc = stimlib.compile(Scene({"y": fixed, "live": live}), fs)
    t = np.arange(1, 10 * fs + 1) / fs
    y = proc.process(np.ones((1, t.size)))
    rise = t ** (1 + alpha) - np.r_[0.0, t[:-1]] ** (1 + alpha)
    np.testing.assert_allclose(y, [rise * fs / (100 * gamma(2 + alpha))] * 2, rtol=1e-10)
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


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"alpha": 1.5}, "alpha = 1.5 must be from 0 (spring) to 1 (dashpot)"),
        ({"alpha": -0.5}, "alpha = -0.5 must be from 0 (spring) to 1 (dashpot)"),
        ({"alpha": "0.5"}, "alpha = '0.5' must be a number"),
        ({"alpha": Param("a", 0.5)}, "alpha is a design number"),
        ({"chi": 0.0}, "chi = 0 must be above 0"),
        ({"chi": -5.0}, "chi = -5 must be above 0"),
        ({"chi": constant(3.0, "N/m")}, "chi Const(3.0, 'N/m') is in N/m; give a plain number"),
        ({"tol": 1e-20}, "tol = 1e-20"),
        ({"scheme": "gl-downsampled"}, "scheme = 'gl-downsampled'; choose one of gl, l1"),
    ],
)
def test_what_makes_no_sense_is_refused(words, says):
    with pytest.raises(BadValue, match=f"^compliance: {re.escape(says)}"):
        compliance(f, **{"chi": 3.0, "alpha": 0.5} | words)
    with pytest.raises(UnitError, match="not in N"):
        compliance(Input("y", "m"), 1.0, 0.5)
