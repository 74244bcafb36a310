"""Masked arrays: a gap of a recording is no number that lies below its mask."""

import numpy as np
import pytest
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, blocks
from stimlib.analysis import cues, sensation_level, vibration, weighted_rms
from stimlib.experiments import integrated, jnd_from_dprime, line, psychometric
from stimlib.fitting import fit_springpot, fit_texture
from stimlib.motion.source import positions
from stimlib.plate import amplifier_load

WAVE = np.sin(np.arange(400) / 9)
TIME, RAMP = np.arange(400) / 1000.0, np.linspace(0.1, 1.0, 400)
SPRING = Scene({"f": Param("k", 1.0, "N/m") * Input("x", "m")})
GAP = np.ma.masked_where((np.arange(400) > 200) & (np.arange(400) < 220), WAVE)
CALLS = {
    "render": lambda y: stimlib.render(Scene({"y": Input("x") * 2.0}), {"x": y}, 1000.0),
    "design": lambda y: blocks.fir(Input("x"), y),
    "jax": lambda y: stimlib.compile(SPRING, 1e3, target="jax")({"k": y}, {"x": 1.0}),
    "cues": lambda y: cues(y, WAVE, 1000.0),
    "sensation_level": lambda y: sensation_level(y, 1000.0, "m"),
    "weighted_rms": lambda y: weighted_rms(y, 1000.0),
    "fit_springpot": lambda y: fit_springpot(TIME, y, WAVE),
    "fit": lambda y: stimlib.fit(SPRING, {"x": WAVE}, y, {"k": 2.0}, fs=1000.0, steps=1),
    "fit_texture": lambda y: fit_texture(y, RAMP, RAMP, fs=1e3, order=3, seconds=0.05),
    "psychometric": lambda y: psychometric(y, WAVE > 0),
    "line": lambda y: line(y, TIME),
    "jnd_from_dprime": lambda y: jnd_from_dprime(y, RAMP),
    "integrated": lambda y: integrated(y, RAMP),
    "amplifier_load": lambda y: amplifier_load(y, 1e-9, 1000.0),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_gap_is_refused_and_a_mask_that_hides_nothing_is_taken(name):
    refused(BadValue, "finite", CALLS[name], GAP)
    CALLS[name](np.ma.masked_less(WAVE, -2.0))


def test_a_gap_is_not_heard():
    assert np.isnan(vibration(GAP, 1000.0)).any()


def test_a_gap_of_a_function_is_no_number():
    """What lies below the mask is sound."""

    def motion(t):
        return np.ma.masked_array(np.zeros(t.size), (t > 0.2) & (t < 0.22))

    why = "motion of x is not finite at sample 201"
    refused(BadValue, why, positions, {"x": motion}, 0, 400, 1000.0)
