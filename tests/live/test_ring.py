"""The audio thread of the page: its ring against a server whose clock is another, and
against one that stops for a moment.
"""

import json
import math

import pytest
from live.node import HERE, LIVE, told

WORKLET = LIVE / "page" / "worklet.js"


USUAL = {"pace": 1.0, "steer": True, "seconds": 12, "jitter": 0.002, "first": 0.04}
WHOLE = {"under": 0, "skips": 0, "missing": 0}
# of the sine of 158 Hz, in parts of full scale: its rms, and its largest step
RMS, SINE = 0.25 / math.sqrt(2), 0.25 * 2 * math.pi * 158 / 48000


def near(value, abs):
    return pytest.approx(value, abs=abs)


CLEAN = {"distortion": near(-570, 500)}  # dB: -70 at most


HEARD = [
    # the step follows the server's clock; s: the least, and what the card takes
    ({"pace": 0.998}, WHOLE | {"ratio": near(0.998, 4e-4), "fill": near(0.05, 0.002)}),
    (
        {"pace": 1.002},
        WHOLE
        | {"ratio": near(1.002, 4e-4), "depth": 0.04}
        | {"rms": near(RMS, 5e-4), "mean": near(0, 5e-4), "step": near(0, 1.01 * SINE)},
    ),
    # a control of half the gain lets 6 ms go, and what is 8 ms late finds nothing
    ({"pace": 0.998, "jitter": 0.008, "first": 0.008, "seconds": 20}, {"under": 0}),
    # what was learnt before a stall is used at once; it shrinks again
    (
        {"pace": 0.998, "stall": 18.0, "late": True, "seconds": 20},
        {"under": 1, "ratio": near(0.998, 1.5e-3)},
    ),
    # a stall is faded, without a click, and told
    ({"stall": 5.0}, {"under": 1, "missing": 800, "step": near(0, 1.05 * SINE)}),
    ({"stall": 5.0, "late": True}, {"under": 1, "missing": 0, "step": near(0, 1.05 * SINE)}),
    (
        {"stall": 5.0, "first": 0.3, "seconds": 9},
        {"under": 0, "missing": 800, "step": near(0, 1.05 * SINE)},
    ),
    # a cubic polynomial had images at -44 dB of 1000 Hz, -23 dB of 2000 Hz; the
    # step wanders by less than a cent in 5 s
    ({"f": 1000, "pace": 1.002}, CLEAN | {"gain": near(1, 1e-3)}),
    ({"f": 2000, "pace": 0.998}, CLEAN | {"wander": near(0, 5e-4)}),
    # a gap teaches how long the queue must be
    (
        {"pace": 0.998, "seconds": 60, "hiccup": 0.12, "late": True},
        {"under": 1, "depth": near(0.155, 0.035)},
    ),
    # it grows before a pause is too long, from 80 to 200 ms without a gap
    (
        {"seconds": 33, "hiccup": 0.07, "more": 0.012, "late": True, "first": None},
        {"under": 0, "skips": 0, "depth": near(0.3, 0.1)},
    ),
    # it is long at first, and shrinks to what is needed
    ({"seconds": 9, "first": None}, {"fill": near(0.11, 0.002)}),
    ({"pace": 0.998, "seconds": 60, "first": None}, {"under": 0, "fill": near(0.05, 0.002)}),
    # a gap is the server's if it made nothing meanwhile
    ({"stall": 5.0, "late": True, "frozen": False}, {"under": 1, "late": 0}),
    ({"stall": 5.0, "late": True, "frozen": True}, {"under": 1, "late": 1}),
    # caught up in two parts: the sound began after the first
    (
        {"stall": 5.0, "lasts": 0.6, "late": True, "halves": True, "first": 0.05},
        {"under": 1, "skips": 0, "fill": near(0.03, 0.03)},
    ),
    # without the control it runs dry
    ({"pace": 0.998, "steer": False, "first": 0.008}, {"under": near(5000, 4999)}),
]


@pytest.fixture(scope="module")
def heard():
    """What was heard of each, in one process."""
    return told(HERE / "ring.js", WORKLET, json.dumps([USUAL | options for options, _ in HEARD]))


@pytest.mark.parametrize("k", range(len(HEARD)))
def test_the_ring_follows_the_server(heard, k):
    wanted = HEARD[k][1]
    assert {name: heard[k][name] for name in wanted} == wanted


START = """
globalThis.sampleRate = 48000;
globalThis.AudioWorkletProcessor = class { constructor() { this.port = {}; } };
let Kind;
globalThis.registerProcessor = (_, kind) => { Kind = kind; };
(0, eval)(require("fs").readFileSync(process.argv[2], "utf8"));
const near = (a, b) => Math.abs(a - b) < 1e-3, dt = 128 / 48000, found = {};
const keep = (name, rule) => {
  try { found[name] = rule(); } catch (e) { found[name] = e.stack; }
};
"""
PLAYER = """
const p = new Kind({ processorOptions: { base: 0.01 } }), out = new Float32Array(128);
p.fs = 8000;
let at = 0, session = 1;
const run = s => { for (let k = 0; k < Math.round(s / dt); k++) p.process([], [[out]]); };
const give = (s, made = p.time) => {
  const y = new Float32Array(Math.round(8000 * s));
  p.take({ y, at, session, made, t: 0 });
  at += y.length;
};
const play = s => { for (let k = 0; k < Math.round(s / 0.008); k++) { give(0.008); run(0.008); } };
"""
RULES = {
    # a gap makes the queue remember for twice as long, for 16 minutes at most
    "memory": """give(0.2); const kept = [];
        for (let k = 0; k < 4; k++) { play(0.5); run(1); give(0.3); kept.push(p.keep); }
        return p.under === 4 && `${kept}` === "240,480,960,960";""",
    # a new session has a clock of its own, and the end of an old one is no gap
    "session": """give(0.2); play(0.3); run(1); at = 0; session = 2; give(0.2); play(0.2);
        return p.under === 0;""",
    "clock": """play(0.5); at = 4000; play(0.3); at = 5000; session = 2; play(0.3);
        return p.need < 0.01;""",
    # a page that was open for long before the first sample does not know it either
    "open": """run(20); give(0.008); run(0.008); return p.depth === 0.1;""",
    # a control at its limit learns nothing
    "limit": """p.head = 4000; p.mean = 0.5; p.control(dt);
        return p.sum === 0 && p.ratio === 1.005;""",
    # no queue is longer than 0.4 s
    "longest": """p.need = 1; run(0.1); return p.depth === 0.4;""",
    # a control that is critically damped passes its goal by little
    "damped": """p.depth = 0.1; p.mean = p.goal(); p.head = 8000 * p.goal(); let low = 0, high = 0;
        for (let k = 0; k < 30 / dt; k++) {
          p.head += 8.016 * 1000 * dt; p.control(dt); p.at += 8000 * dt * p.ratio;
          const e = p.mean - p.goal(); low = Math.min(low, e); high = Math.max(high, e);
        }
        return low > -0.1 * high;""",
    # after 5 s without samples, lateness is against those that come now
    "silence": """play(1); run(5); play(0.4); run(0.15); give(0.16);
        return p.need > 0.1;""",
    # the server has a gap that it worked in for less than half of the time
    "cause": """give(0.2); play(0.5); run(1); give(0.3, p.made + 0.3); run(0.01);
        const page = p.late; play(0.5); run(1); give(0.3, p.made + 0.9);
        return page === 0 && p.late === 1;""",
    # it is the server's, too, where a block came late that was made before the gap
    "before": """give(0.2); play(0.5); run(1); give(0.004, p.made + 0.004); let told;
        p.link = { postMessage(m) { told = m.audio; } }; p.take({ ask: true });
        const early = told.under; give(0.3, p.made + 0.9); run(0.1); p.take({ ask: true });
        return early === 0 && told.under === 1 && told.late === 1;""",
    # the mean of the queue, while the card takes 10 ms at once, is the goal
    "begin": """p.base = 4 * dt; give(0.2); let sum = 0;
        for (let k = 0; k < 4; k++) { run(dt); sum += p.fill() + p.ratio * dt; }
        return near(sum / 4, p.goal());""",
    # a queue that is 0.1 s too long begins again in the first second, not later
    "long": """give(0.2); play(0.5); give(0.1); const first = !p.on && !p.skips; play(2);
        give(0.1); return first && p.on && !p.skips;""",
}


@pytest.fixture(scope="module")
def rules(tmp_path_factory):
    """What became of each, in one process."""
    kept = (f"keep({name!r}, () => {{{PLAYER}{rule}}});" for name, rule in RULES.items())
    path = tmp_path_factory.mktemp("rules") / "rules.js"
    path.write_text("\n".join([START, *kept, "console.log(JSON.stringify(found));"]))
    return told(path, WORKLET)


@pytest.mark.parametrize("name", RULES)
def test_a_rule_of_the_queue(rules, name):
    assert rules[name] is True, rules[name]
