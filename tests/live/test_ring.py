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


PLAYER = """
globalThis.sampleRate = 48000;
globalThis.AudioWorkletProcessor = class { constructor() { this.port = {}; } };
let Kind;
globalThis.registerProcessor = (_, kind) => { Kind = kind; };
(0, eval)(require("fs").readFileSync(process.argv[2], "utf8"));
const p = new Kind({ processorOptions: { base: 0.01 } });
const dt = 128 / 48000, out = new Float32Array(128);
p.fs = 8000;
let at = 0, session = 1;
const run = s => { for (let k = 0; k < Math.round(s / dt); k++) p.process([], [[out]]); };
const give = (s, made = p.time) => {
  const y = new Float32Array(Math.round(8000 * s));
  p.take({ y, at, session, made, t: 0 });
  at += y.length;
};
const play = s => { for (let k = 0; k < Math.round(s / 0.008); k++) { give(0.008); run(0.008); } };
const near = (a, b) => Math.abs(a - b) < 1e-3;
"""


@pytest.mark.parametrize(
    "script",
    [
        # a gap makes the queue remember for twice as long, for 16 minutes at most
        """give(0.2); const kept = [];
        for (let k = 0; k < 4; k++) { play(0.5); run(1); give(0.3); kept.push(p.keep); }
        console.log(p.under === 4 && `${kept}` === "240,480,960,960");""",
        # a new session has a clock of its own, and the end of an old one is no gap
        "give(0.2); play(0.3); run(1); at = 0; session = 2; give(0.2); play(0.2);"
        " console.log(p.under === 0);",
        "play(0.5); at = 4000; play(0.3); at = 5000; session = 2; play(0.3);"
        " console.log(p.need < 0.01);",
        # a page that was open for long before the first sample does not know it either
        "run(20); give(0.008); run(0.008); console.log(p.depth === 0.1);",
        # a control at its limit learns nothing
        "p.head = 4000; p.mean = 0.5; p.control(dt);"
        " console.log(p.sum === 0 && p.ratio === 1.005);",
        # no queue is longer than 0.4 s
        "p.need = 1; run(0.1); console.log(p.depth === 0.4);",
        # a control that is critically damped passes its goal by little
        """p.depth = 0.1; p.mean = p.goal(); p.head = 8000 * p.goal(); let low = 0, high = 0;
        for (let k = 0; k < 30 / dt; k++) {
          p.head += 8.016 * 1000 * dt; p.control(dt); p.at += 8000 * dt * p.ratio;
          const e = p.mean - p.goal(); low = Math.min(low, e); high = Math.max(high, e);
        }
        console.log(low > -0.1 * high);""",
        # after 5 s without samples, lateness is against those that come now
        "play(1); run(5); play(0.4); run(0.15); give(0.16); console.log(p.need > 0.1);",
        # the server has a gap that it worked in for less than half of the time
        """give(0.2); play(0.5); run(1); give(0.3, p.made + 0.3); run(0.01); const page = p.late;
        play(0.5); run(1); give(0.3, p.made + 0.9); console.log(page === 0 && p.late === 1);""",
        # it is the server's, too, where a block came late that was made before the gap
        """give(0.2); play(0.5); run(1); give(0.004, p.made + 0.004); let told;
        p.link = { postMessage(m) { told = m.audio; } }; p.take({ ask: true });
        const early = told.under; give(0.3, p.made + 0.9); run(0.1); p.take({ ask: true });
        console.log(early === 0 && told.under === 1 && told.late === 1);""",
        # the mean of the queue, while the card takes 10 ms at once, is the goal
        """p.base = 4 * dt; give(0.2); let sum = 0;
        for (let k = 0; k < 4; k++) { run(dt); sum += p.fill() + p.ratio * dt; }
        console.log(near(sum / 4, p.goal()));""",
        # a queue that is 0.1 s too long begins again in the first second, not later
        """give(0.2); play(0.5); give(0.1); const first = !p.on && !p.skips; play(2);
        give(0.1); console.log(first && p.on && !p.skips);""",
    ],
    ids="memory session clock open limit longest damped silence cause before begin long".split(),
)
def test_a_rule_of_the_queue(script, tmp_path):
    (tmp_path / "rule.js").write_text(PLAYER + script)
    words = ["node", tmp_path / "rule.js", WORKLET]
    said = subprocess.run(words, capture_output=True, text=True, check=False)
    assert said.stdout == "true\n", said
