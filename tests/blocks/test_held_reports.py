"""The errors of a speed whose position is held between reports, as docs and docstrings
say them.
"""

import numpy as np
import pytest

import stimlib
from stimlib.blocks import track_velocity, velocity

FS, SPEED = 8000, 0.1


def error(block, cutoff, rate, late, seed=0):
    """The largest error, as a fraction of the speed, of reports that come so late."""
    rng = np.random.default_rng(seed)
    t, taken = np.arange(4 * FS) / FS, np.arange(0.0, 4.0, 1 / rate)
    came = taken + late * rng.uniform(0.0, 1.0, len(taken)) / rate
    x = SPEED * taken[np.maximum(np.searchsorted(came, t, side="right") - 1, 0)]
    scene = stimlib.Scene({"v": block(stimlib.Input("x", "m"), cutoff)})
    return np.abs(stimlib.compile(scene, FS).process(x[None])[0][FS:] / SPEED - 1.0).max()


@pytest.mark.parametrize("block", [velocity, track_velocity])
@pytest.mark.parametrize(
    ("rate", "cutoff", "regular", "late"),
    [
        (60, 20, 0.30, 0.58),
        (125, 20, 0.085, 0.22),
        (125, 30, 0.18, 0.39),
        (125, 100, 0.93, 1.30),
        (250, 20, 0.026, 0.076),
        (250, 60, 0.18, 0.39),
        (1000, 100, 0.053, 0.11),
    ],
)
def test_held_reports_have_the_error_that_is_said(block, rate, cutoff, regular, late):
    assert error(block, cutoff, rate, 0.0) == pytest.approx(regular, abs=0.012)
    assert error(block, cutoff, rate, 0.5) == pytest.approx(late, rel=0.15)
