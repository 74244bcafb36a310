"""The audio thread of the page: its ring against a server whose clock is another, and
against one that stops for a moment.
"""

import json
import math
import shutil
import subprocess
from pathlib import Path

import pytest

RING = Path(__file__).with_name("ring.js")
WORKLET = Path(__file__).parents[2] / "stimlib" / "live" / "page" / "worklet.js"
pytestmark = pytest.mark.skipif(
    shutil.which("node") is None, reason="needs node, which runs the audio thread without a browser"
)
RMS = 0.25 / math.sqrt(2)
"""Of the sine of 158 Hz."""


def heard(**options):
    words = [
        "node",
        RING,
        WORKLET,
        json.dumps(
            {"pace": 1.0, "steer": True, "seconds": 20, "jitter": 0.002, "depth": 2} | options
        ),
    ]
    return json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("pace", [0.998, 1.002])
def test_the_step_follows_the_servers_clock(pace):
    y = heard(pace=pace)
    assert (y["under"], y["skips"], y["missing"], y["depth"]) == (0, 0, 0, 2)
    assert y["ratio"] == pytest.approx(pace, abs=4e-4)
    assert y["rms"] == pytest.approx(RMS, rel=0.003) and abs(y["mean"]) < 5e-4
    assert y["step"] < 1.01 * 0.25 * 2 * math.pi * 158 / 48000  # the sine's own
    # s: two blocks, and what the card takes at once
    assert y["fill"] == pytest.approx(2 * 0.004 + 0.01, abs=0.004)


def test_a_slow_server_leaves_the_ring_its_reserve_while_its_clock_is_learnt():
    """A control of half the gain lets 6 ms go, and what is 8 ms late finds nothing."""
    assert heard(pace=0.998, jitter=0.008)["under"] == 0


def test_a_stall_forgets_no_clock():
    """What was learnt before is used at once: else the ring loses its reserve again."""
    y = heard(pace=0.998, stall=18.0, late=True)
    assert y["under"] == 1 and y["ratio"] == pytest.approx(0.998, abs=4e-4)


def test_without_the_control_it_runs_dry():
    assert heard(pace=0.998, steer=False)["under"] > 0


@pytest.mark.parametrize("late", [False, True])
def test_a_stall_is_faded_and_told(late):
    y = heard(stall=5.0, late=late)
    assert y["under"] == 1 and y["missing"] == (0 if late else 800)
    assert y["step"] < 1.05 * 0.25 * 2 * math.pi * 158 / 48000  # no click


@pytest.mark.parametrize("f", [500, 1000, 2000])
@pytest.mark.parametrize("pace", [0.998, 1.002])
def test_what_is_heard_is_the_tone_that_was_sent(f, pace):
    """A cubic polynomial had images at -44 dB of 1000 Hz and -23 dB of 2000 Hz."""
    y = heard(f=f, pace=pace)
    assert y["distortion"] < -70  # dB, against a sine that follows the step
    assert y["gain"] == pytest.approx(1, abs=1e-3)
    assert y["wander"] < 5e-4  # of the step, in 5 s: less than a cent


@pytest.mark.parametrize("hiccup", [0.05, 0.12])
def test_a_gap_teaches_how_long_the_queue_must_be(hiccup):
    """A queue that grew by one block had a gap at each of 19 pauses."""
    y = heard(pace=0.998, seconds=60, hiccup=hiccup, late=True)
    assert y["under"] == 1 and y["fill"] < hiccup + 0.03


def test_the_queue_is_long_at_first_and_shrinks_to_what_is_needed():
    assert heard(depth=None)["depth"] == 8
    calm = heard(pace=0.998, depth=None, seconds=100)
    assert calm["under"] == 0 and calm["depth"] <= 3
