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
            {"pace": 1.0, "steer": True, "seconds": 20, "jitter": 0.002, "first": 0.04} | options
        ),
    ]
    return json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("pace", [0.998, 1.002])
def test_the_step_follows_the_servers_clock(pace):
    y = heard(pace=pace)
    assert (y["under"], y["skips"], y["missing"]) == (0, 0, 0)
    assert y["ratio"] == pytest.approx(pace, abs=4e-4)
    assert y["rms"] == pytest.approx(RMS, rel=0.003) and abs(y["mean"]) < 5e-4
    assert y["step"] < 1.01 * 0.25 * 2 * math.pi * 158 / 48000  # the sine's own
    # s: the least, and what the card takes at once
    assert y["depth"] == 0.04 and y["fill"] == pytest.approx(0.04 + 0.01, abs=0.002)


def test_a_slow_server_leaves_the_ring_its_reserve_while_its_clock_is_learnt():
    """A control of half the gain lets 6 ms go, and what is 8 ms late finds nothing."""
    assert heard(pace=0.998, jitter=0.008, first=0.008)["under"] == 0


def test_a_stall_forgets_no_clock():
    """What was learnt before is used at once: else the ring loses its reserve again."""
    y = heard(pace=0.998, stall=18.0, late=True)
    # faster than the server by what the queue shrinks again
    assert y["under"] == 1 and y["ratio"] == pytest.approx(0.998, abs=1.5e-3)


def test_without_the_control_it_runs_dry():
    assert heard(pace=0.998, steer=False, first=0.008)["under"] > 0


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


@pytest.mark.parametrize("hiccup", [0.07, 0.12])
def test_a_gap_teaches_how_long_the_queue_must_be(hiccup):
    """A queue that grew by one block had a gap at each of 19 pauses."""
    y = heard(pace=0.998, seconds=60, hiccup=hiccup, late=True)
    assert y["under"] == 1 and hiccup < y["depth"] < 1.5 * hiccup + 0.01


def test_the_queue_grows_before_a_pause_is_too_long_for_it():
    """By what was late, not by what was missing: from 80 to 200 ms without a gap."""
    y = heard(seconds=33, hiccup=0.07, more=0.012, late=True, first=None)
    assert (y["under"], y["skips"]) == (0, 0) and y["depth"] > 0.2


def test_the_queue_is_long_at_first_and_shrinks_to_what_is_needed():
    assert heard(seconds=9, first=None)["fill"] == pytest.approx(0.1 + 0.01, abs=0.002)
    calm = heard(pace=0.998, first=None, seconds=60)
    assert calm["under"] == 0 and calm["fill"] == pytest.approx(0.04 + 0.01, abs=0.002)


@pytest.mark.parametrize("frozen", [False, True])
def test_a_gap_is_the_servers_if_it_made_nothing_meanwhile(frozen):
    y = heard(stall=5.0, late=True, frozen=frozen)
    assert (y["under"], y["late"]) == (1, int(frozen))


def test_a_stall_that_is_caught_up_in_two_parts_is_one_gap():
    """The sound began after the first part, and was too late after the second."""
    y = heard(seconds=12, stall=5.0, lasts=0.6, late=True, halves=True, first=0.05)
    assert (y["under"], y["skips"]) == (1, 0) and y["fill"] < 0.06


def test_lost_samples_are_faded_where_the_queue_bridges_them():
    y = heard(stall=5.0, first=0.3, seconds=9)
    assert (y["under"], y["missing"]) == (0, 800)
    assert y["step"] < 1.05 * 0.25 * 2 * math.pi * 158 / 48000  # no click
