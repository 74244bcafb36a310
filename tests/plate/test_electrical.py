"""The current of the patches: against closed forms, and the same of samples and of
renderings.
"""

from dataclasses import replace

import numpy as np
import pytest

import stimlib
from stimlib import BadValue, Input, Scene, UnitError
from stimlib.errors import UnknownName
from stimlib.plate import Patch, Plate, amplifier_load
from stimlib.scenes import bumps

FS, C = 48000, 40e-9
T, W = np.arange(FS) / FS, 2 * np.pi * 158
V = 300 * np.sin(W * T)


def test_the_capacitance_is_that_of_a_plate_capacitor():
    """By hand: 1750 x 8.854 pF/m x 14 mm x 11 mm/0.2 mm = 11.93 nF."""
    patch = Patch.duraact(0.05, 0.05)
    assert patch.capacitance() == pytest.approx(11.93e-9, rel=1e-3)
    assert patch.capacitance(875.0) == pytest.approx(patch.capacitance() / 2)
    assert Patch.duraact(0.05, 0.05, turned=True).capacitance() == patch.capacitance()


@pytest.mark.parametrize(
    ("row", "fs", "current", "rms", "slew", "power", "rel"),
    [  # w C V, w V and w C V^2/2; the same peak and less on average; a charge in one sample of ten
        (V, FS, W * C * 300, W * C * 300 / 2**0.5, W * 300, W * C * 300**2 / 2, 1e-4),
        (np.maximum(V, 0), FS, W * C * 300, W * C * 150, W * 300, W * C * 300**2 / 2, 5e-3),
        (np.r_[np.zeros(5), np.full(5, -200.0)], 1000, 8e-3, 8e-3 / 3, 2e5, 0.8, 1e-6),
    ],
    ids=["sinusoid", "half wave", "jump"],
)
def test_a_sinusoid_draws_w_c_v(row, fs, current, rms, slew, power, rel):
    load = amplifier_load(row, C, fs)
    assert (load.current, load.slew) == pytest.approx((current, slew), rel=min(rel, 1e-3))
    assert load.rms_current == pytest.approx(rms, rel=rel)
    assert load.power == pytest.approx(power, rel=rel)


def test_a_rendering_is_its_samples():
    hand = {"x": lambda t: 0.1 * t}
    r = stimlib.render(bumps("square", 6, 0.5, 7.5), hand, 8000, 0.5)
    assert amplifier_load(r, C) == amplifier_load(r["voltage"], C, 8000.0)
    # the half wave of 375 V; an edge that is met at its top may draw more
    assert amplifier_load(r, C).current >= 2 * np.pi * 158 * 375 * C * 0.999


def test_what_is_no_voltage_is_refused():
    x = Input("x", "m")
    r = stimlib.render(Scene({"voltage": x}), {"x": np.zeros(9)}, 1000)
    for error, words, text in (
        (UnitError, (r, C), r"output voltage \[m\] must be in V"),
        (UnknownName, (r, C, None, "volts"), "no output 'volts'"),
        (BadValue, (r, C, 1000.0), "own fs"),
        (BadValue, (T, C), "give fs="),
        (BadValue, (T, 0, 1000.0), "above 0; a plate without patches has none"),
        (BadValue, (T, C, -1.0), "must be above 0"),
        (BadValue, (T[:1], C, 1000.0), "at least two finite samples"),
        (BadValue, ([0.0, np.nan], C, 1000.0), "at least two finite samples"),
        (BadValue, (np.ones((2, 3)), C, 1000.0), "one row"),
    ):
        with pytest.raises(error, match=text):
            amplifier_load(*words)


def test_the_motion_adds_little_to_the_current():
    """What the note says: F^2 Q/w0 for each volt, beside w0 C; and it is the power that
    the mode loses.
    """
    glass = replace(Plate.paper(measured=True), terms=10)
    w = 2 * np.pi * glass.modes(1)[0]
    F, Q, C = glass.forces(1)[0], 1 / glass.damping, sum(p.capacitance() for p in glass.patches)
    speed = F * Q / w  # of the mode at its resonance, for 1 V
    assert speed * F == pytest.approx(w / Q * speed**2)  # V i is what damping takes
    assert F**2 * Q / w < 0.1 * w * C
