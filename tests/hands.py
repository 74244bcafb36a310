"""Recorded hands from beside the project; tests that use them skip where they are
absent.
"""

from pathlib import Path

import pytest

from stimlib.motion.recorded import recording

DATA = Path(__file__).parents[1].parent / "shared" / "data"
RECORDINGS = {
    "grip trial": (
        "grip-trials/grip_p1.csv",
        "force_N*5e-4",
        {"where": {"grasp": "pinch", "level": "easy", "trial": "1"}},
    ),
    "touchpad scrub": (
        "touch-evemu/finger_touchpad_horizontal.csv",
        "x_raw*1e-5",
        {"reports": "on_change"},
    ),
    "touchpad dwell": (
        "touch-evemu/finger_touchpad_vertical.csv",
        "y_raw*1e-5",
        {"reports": "on_change"},
    ),
    "puck": ("touch-evemu/hand_puck_tablet.csv", "x_mm*1e-3", {"reports": "on_change"}),
    "pen": ("pen-pressure/pen_loops.csv", "x_raw*5e-6", {"reports": "on_change"}),
}


def hand(name):
    """The recording of that name, or the test is skipped."""
    path, column, options = RECORDINGS[name]
    if not (DATA / path).is_file():
        pytest.skip("the recordings are not beside the project")
    return recording(DATA / path, {"x": column}, **options)
