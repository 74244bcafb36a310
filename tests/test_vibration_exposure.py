"""Weightings of ISO 5349-1 and ISO 2631-1, against the tables of the standards."""

import numpy as np
import pytest
from refusals import refused

from stimlib.analysis import weighted_rms, weighting
from stimlib.errors import BadValue, UnknownName

# third octaves; each standard states its factors at these, to three figures
EXACT = 10 ** (np.arange(-3, 34) / 10)  # 0.5 Hz to 2 kHz
TABLES = {
    # ISO 5349-1:2001, table A.2, from 6.3 Hz
    ("Wh", 6.3): "0.727 0.873 0.951 0.958 0.896 0.782 0.647 0.519 0.411 0.324 0.256 0.202 0.160"
    " 0.127 0.101 0.0799 0.0634 0.0503 0.0398 0.0314 0.0245 0.0186 0.0135 0.00894 0.00536 0.00295",
    # ISO 2631-1:1997, table 3, from 0.5 Hz
    ("Wk", 0.5): "0.418 0.459 0.477 0.482 0.484 0.494 0.531 0.631 0.804 0.967 1.039 1.054 1.036"
    " 0.988 0.902 0.768 0.636 0.513 0.405 0.314 0.246 0.186 0.132 0.0887 0.0540 0.0285 0.0152",
    ("Wd", 0.5): "0.853 0.944 0.992 1.011 1.008 0.968 0.890 0.776 0.642 0.512 0.409 0.323 0.253"
    " 0.212 0.161 0.125 0.100 0.0800 0.0632 0.0494 0.0388 0.0295 0.0211 0.0141 0.00863",
}


@pytest.mark.parametrize("name, first", TABLES)
def test_the_tables_of_the_standards(name, first):
    wanted = np.array(TABLES[name, first].split(), float)
    start = np.abs(EXACT - first).argmin()
    ratio = weighting(EXACT[start : start + wanted.size], name) / wanted
    # both standards allow 1 dB, 12 %; the table of ISO 2631-1 is of rounded frequencies
    assert np.abs(ratio - 1).max() < (0.005 if name == "Wh" else 0.05)
    assert np.median(np.abs(ratio - 1)) < 0.005


def test_the_rms_of_tones_and_of_several_axes():
    fs, t = 8000.0, np.arange(8000) / 8000
    tones = {16.0: 3.0, 125.0: 10.0, 1000.0: 2.0}
    y = sum(a * np.sin(2 * np.pi * f * t + f) for f, a in tones.items())
    wanted = np.sqrt(sum((weighting(f) * a) ** 2 / 2 for f, a in tones.items()))
    assert weighted_rms(y + 5.0, fs) == pytest.approx(wanted, rel=1e-12)
    assert weighted_rms([y, 2 * y], fs) == pytest.approx([wanted, 2 * wanted], rel=1e-12)
    for n in (7, 8):  # a tone at half the rate is one bin, and has its whole power
        y = np.cos(np.pi * np.arange(n)) if n == 8 else np.cos(2 * np.pi * 3 / 7 * np.arange(n))
        f = 4.0 if n == 8 else 24 / 7
        power = weighting(f, "Wk") ** 2 * (1.0 if n == 8 else 0.5)
        assert weighted_rms(y, 8.0, "Wk") ** 2 == pytest.approx(power)


def test_other_weightings_follow_the_standard():
    """Annex A: 1 below the transition, sqrt(2) Q at it, 1/f above; band limits."""
    for name, corner in (("Wc", 8.0), ("We", 1.0), ("Wd", 2.0)):
        fast = 20 * corner if corner < 8 else 40.0
        assert weighting(fast, name) * fast / corner == pytest.approx(1.0, rel=0.12)
        limits = (1 + (0.4 / corner) ** 4) * (1 + (corner / 100) ** 4)
        assert weighting(corner, name) == pytest.approx(0.63 * np.sqrt(2 / limits), rel=1e-12)
    assert weighting(20.0, "Wj") == pytest.approx(1.0, rel=0.02)
    assert weighting(1.5, "Wj") == pytest.approx((3.75 / 5.32) ** 2, rel=0.03)
    assert weighting(0.0) == 0


@pytest.mark.parametrize(
    ("error", "says", "call", "given"),
    [
        (UnknownName, "choose one of Wh, Wk", weighting, (1.0, "Wx")),
        (BadValue, "0 or above", weighting, ([-1.0],)),
        (BadValue, "at least one", weighted_rms, ([], 100.0)),
        (BadValue, "finite", weighted_rms, ([1.0, np.nan], 100.0)),
        (BadValue, "above 0", weighted_rms, ([1.0], 0.0)),
    ],
)
def test_what_cannot_be_weighted(error, says, call, given):
    refused(error, says, call, *given)
