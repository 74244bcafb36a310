"""Amplitudes from levels: the forms of papers against their definitions."""

import math

import pytest
from refusals import refused

from stimlib import BadValue, UnitError
from stimlib.design.levels import amplitude


@pytest.mark.parametrize(
    ("arguments", "peak"),
    [
        (("2", ""), 2.0),
        (("2 m/s^2", "m/s^2"), 2.0),
        (("2 m/s**2 peak", "m/s^2"), 2.0),
        (("2 m/s^2 RMS", "m/s^2"), 2 * math.sqrt(2)),
        (("5 um pp", "m"), 2.5e-6),
        (("1.5 kHz", "Hz"), 1500.0),
        (("90 deg", "rad"), math.pi / 2),
        (("60 rpm", "rad/s"), 2 * math.pi),
        (("3 pp", ""), 1.5),
        (("-50 mN", "N"), -0.05),
        (("2e-10 m", "m"), 2e-10),
        (("20 dB re 1 um", "m"), 10e-6),
        (("-6 dB re 2um rms", "m"), 2e-6 * 10**-0.3 * math.sqrt(2)),
        (("0 dB re 1 g_0", "m/s^2"), 9.80665),
        (("15 dB re 0.3", ""), 0.3 * 10**0.75),
        (("20 dB SL", "m", 0.2e-6), 2e-6),
        (("-20dB sl", "m", 0.2e-6), 0.02e-6),
    ],
)
def test_a_level_is_its_amplitude(arguments, peak):
    assert amplitude(*arguments) == pytest.approx(peak, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        (("2 N", "m"), UnitError, "'2 N' is not in m"),
        (("20 dB", "m"), UnitError, "is not in m"),
        (("1000 rad/s", "Hz"), UnitError, r"not in Hz, .* \(1 Hz is 2 pi rad/s\)"),
        (("60 rpm", "1/s"), UnitError, "is not in 1/s"),
        (("100 Hz rms", "Hz"), UnitError, "is not in Hz"),
        (("20 dB re 1 Hz", "Hz"), UnitError, "is not in Hz"),
        (("5 Hz", "rad/s"), UnitError, "is not in rad/s"),
        (("loud", "m"), BadValue, "is not a level"),
        (("1e999 m", "m"), BadValue, "is not a level"),
        (("2 m m", "m"), BadValue, "is not a level"),
        (("9000 dB re 1 um", "m"), BadValue, "is not a level"),
        (("9000 dB SL", "m", 1e-6), BadValue, "is not a level"),
        (("20 dB re -1 um", "m"), BadValue, "is not a level"),
        (("20 dB re 0 um", "m"), BadValue, "is not a level"),
        (("2 9**9**9**9", "m"), BadValue, "is not a level"),
        (("2 __import__('os')", "m"), BadValue, "is not a level"),
        (("15 dB SL", "m"), BadValue, "give threshold=, its peak amplitude in m"),
        (("15 dB SL", "m", 0.0), BadValue, "above 0"),
        (("15 dB SL rms", "m", 1.0), BadValue, "write nothing after SL"),
    ],
)
def test_bad_levels(arguments, error, says):
    refused(error, says, amplitude, *arguments)
