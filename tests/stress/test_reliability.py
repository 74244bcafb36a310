"""The whole table of blocks, and the scenes, under many inputs, rates, sizes of blocks
and motions of a hand: ``make stress``; docs/explanation/reliability.rst.

With STIMLIB_RECORD=FILE, what was seen is written there as a table: in the docs it is
reliability.csv.
"""

from __future__ import annotations

import csv
import os
import platform
from collections import Counter, defaultdict
from datetime import UTC, datetime
from fractions import Fraction
from math import gamma
from pathlib import Path

import llvmlite
import numpy as np
import pytest
from contract import TABLE
from laws import (
    assert_same,
    cut_at,
    float_words,
    pair,
    rows,
    run,
)

import stimlib
from stimlib import StimlibError, blocks as b
from stimlib.checks import laws

pytestmark = pytest.mark.stress
DRIVEN = [pytest.param(e, id=e.name) for e in TABLE if e.inputs]
ALL = [pytest.param(e, id=e.name) for e in TABLE]
U = np.uint64


# Inputs: of n samples at a rate -------------------------------------------------------
DENORMALS = [5e-324, -5e-324, 1e-310, -2.2e-308, 0.0, -0.0]
WRONG = [np.nan, np.inf, -np.inf]


def step(rng, n, fs):
    return np.where(np.arange(n) < n // 3, 0.0, 1.0)


def impulse(rng, n, fs):
    return np.where(np.arange(n) == n // 3, 1.0, 0.0)


def chirp(rng, n, fs):
    """From nothing to half the sample rate."""
    return np.sin(0.5 * np.pi * np.arange(n) ** 2 / n)


def wrong(rng, n, fs):
    """What is no number: first, last, around tiles, and one in fifty."""
    x = rng.standard_normal(n)
    at = np.r_[0, 63, 64, n - 1, np.flatnonzero(rng.random(n) < 0.02)]
    x[at] = rng.choice(WRONG, at.size)
    return x


FINITE = {
    "silence": lambda rng, n, fs: np.zeros(n),
    "direct current": lambda rng, n, fs: np.full(n, 0.7),
    "step": step,
    "impulse": impulse,
    "chirp": chirp,
    "1e30": lambda rng, n, fs: 1e30 * rng.standard_normal(n),
    "1e-30": lambda rng, n, fs: 1e-30 * rng.standard_normal(n),
    "denormals": lambda rng, n, fs: rng.choice(DENORMALS, n),
}
INPUTS = FINITE | {"nan and inf anywhere": wrong}

# Rates --------------------------------------------------------------------------------
RATES = [1000.0, 2000.0, 4000.0, 8000.0, 11025.0, 22050.0, 44100.0, 48000.0, 96000.0, 192000.0]

# Ends of a number that lies from 0 to 1 -----------------------------------------------
SMALL = [5e-324, 1e-300, 1e-30, 2.0**-53, 1e-9]
LARGE = [1 - 2.0**-53, 1 - 2.0**-52, 1 - 1e-9]


# Hands: position over time, in m, within 0.04 m ---------------------------------------
def stroke(t):
    return 0.02 * (1 - np.cos(2 * np.pi * 1.5 * t))


def reports(t, f, rate=125.0, jitter=0.0):
    """What a device says that looks every 1/rate seconds, too late by up to a part of
    that.
    """
    k = np.floor(t * rate)
    late = jitter * (np.modf(np.sin(12.9898 * k) * 43758.5453)[0] ** 2) / rate
    return f(np.where(t - k / rate >= late, k, k - 1) / rate)


def stalls(t):
    """A hand that stands for a tenth of a second, again and again."""
    whole, part = np.divmod(t, 0.25)
    return stroke(0.15 * whole + np.minimum(part, 0.15))


HANDS = {
    "smooth": stroke,
    "stalls": stalls,
    "reversals": lambda t: 0.02 + 0.0004 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * 40 * t)),
    "reports at 125 Hz": lambda t: reports(t, stroke),
    "reports with jitter": lambda t: reports(t, stroke, jitter=0.8),
    "teleports": lambda t: stroke(t) + 0.01 * (np.floor(3 * t) % 2),
    "steps of 0.1 mm": lambda t: np.round(stroke(t) / 1e-4) * 1e-4,
    "a last bit that toggles": lambda t: 0.01 + 1e-6 * (np.floor(700 * t) % 2),
    "standing": lambda t: np.full(np.shape(t), 0.01),
}


# What was seen ------------------------------------------------------------------------
MUST = {
    "inputs": (
        "Compiler and interpreter give the same samples, states and faults, and every sample is"
        " finite. No guard of a linear block stops its output while the input is finite."
    ),
    "rates": (
        "From 1 to 192 kHz, samples are finite, and the same in blocks of one sample as in one"
        " block; or the scene is rejected when it is compiled."
    ),
    "laws": (
        "From 1 to 192 kHz, the response agrees with the physical law within the tolerance of"
        " the block."
    ),
    "ends": (
        "With alpha and duty at their limits, and at the floats next to them, samples are"
        " finite, and as close to those at the limit as the operator is continuous."
    ),
    "hands": "The verification of each scene passes for every motion of the hand.",
    "run": (
        "In a run of 1e8 samples, counters, phases, noise, sums and springpot agree with formulas."
    ),
    "jump": (
        "In a state advanced by 1e8, 1e9 and 1e12 samples, noise, phases and times agree with"
        " formulas."
    ),
}
SEEN: dict[str, Counter] = defaultdict(Counter)
WORST: dict[str, tuple[float, str]] = {}


def saw(case: str, what: str = "", worst: float = 0.0, **counts: int) -> None:
    """One run of a case, what happened in it, and the largest error so far."""
    SEEN[case].update(runs=1, **counts)
    if worst > WORST.get(case, (0.0, ""))[0]:
        WORST[case] = worst, what


@pytest.fixture(scope="module", autouse=True)
def record():
    yield
    if not (path := os.environ.get("STIMLIB_RECORD")):
        return
    on = (
        f"{datetime.now(UTC):%Y-%m-%d}, {platform.machine()}, stimlib {stimlib.__version__}, Python"
        f" {platform.python_version()}, "
    )
    with Path(path).open("w", newline="") as f:
        out = csv.writer(f, lineterminator="\n")
        for case, must in MUST.items():
            if case in SEEN:
                did = [f"{n} {what}" for what, n in SEEN[case].items()]
                did += (
                    [f"largest error {WORST[case][0]:.1e} ({WORST[case][1]})"]
                    if case in WORST
                    else []
                )
                out.writerow((case, must, ", ".join(did)))
        out.writerow(("", on + f"numpy {np.__version__}, llvmlite {llvmlite.__version__}", ""))


# Every block --------------------------------------------------------------------------
def kept(proc) -> np.ndarray:
    """A state whose numbers that are none all look alike."""
    state, floats = proc.state, float_words(proc)
    state[floats & np.isnan(state.view(np.float64))] = 0
    return state


def assert_as_the_interpreter(scene, fs, x, names, cuts, sets=()):
    """Samples, states and faults; the compiled processor."""
    fast, slow = pair(scene, fs)
    x = rows(fast, x, names)
    y = run(fast, x, cuts, sets)
    assert_same(y, run(slow, x, (), sets), "llvm and python")
    assert_same(kept(fast), kept(slow), "state")
    assert fast.fault == slow.fault
    assert np.isfinite(y).all()
    return fast, y


@pytest.mark.parametrize("entry", DRIVEN)
def test_any_input(entry):
    n, fs = 200, entry.rates[0]
    usual = entry.x(n, fs)
    for kind, make in INPUTS.items():
        for k in range(len(usual)):
            x = usual.copy()
            x[k] = make(np.random.default_rng(k), n, fs)
            proc, _ = assert_as_the_interpreter(entry.scene(), fs, x, entry.inputs, [1, 70, 133])
            saw("inputs", faults=proc.fault is not None)
            if entry.lti:
                assert proc.fault is None or kind not in FINITE


@pytest.mark.parametrize("entry", ALL)
def test_every_rate(entry):
    n = 150
    for fs in RATES:
        try:
            proc = stimlib.compile(entry.scene(), fs)
        except StimlibError as e:
            assert fs not in entry.rates and str(e).strip()
            saw("rates", refused=1)
            continue
        x = rows(proc, entry.x(n, fs), entry.inputs)
        whole = run(proc, x)
        proc.reset()
        assert_same(run(proc, x, cut_at(n, 1)), whole, f"at {fs:g} Hz")
        assert np.isfinite(whole).all() and proc.fault is None
        saw("rates")


# whose laws are written in samples
ONE_RATE = {"delay_seconds", "moving_average", "moving_average_short", "grain"}


@pytest.mark.parametrize(
    "entry", [p for p in ALL if p.values[0].laws and p.values[0].name not in ONE_RATE]
)
def test_the_law_at_every_rate(entry):
    for fs in RATES:
        try:
            proc = stimlib.compile(stimlib.Scene({"y": entry.block()}), fs)
        except StimlibError:
            continue
        source = [*proc.inputs, *proc.program.noises][0]
        for law in entry.laws:
            used = (
                law.error(lambda f, proc=proc, source=source: proc.response("y", source, f), fs)
                / law.tol
            )
            saw("laws", f"{entry.name} at {fs:g} Hz, as a part of its tolerance", used)
            assert used <= 1


# Ends ---------------------------------------------------------------------------------
X, LIVE = stimlib.Input("x"), stimlib.Input("live")
ENDS = {
    "springpot gl": lambda v: b.springpot(X, 1.0, v, "gl"),
    "springpot l1": lambda v: b.springpot(X, 1.0, v, "l1"),
    "bump square": lambda v: b.bump(X, "square", v),
    "bump sawtooth": lambda v: b.bump(X, "sawtooth", v),
    "bump sine": lambda v: b.bump(X, "sine", v),
    "bump half_sine": lambda v: b.bump(X, "half_sine", v),
    "bump table": lambda v: b.bump(X, [0.0, 0.2, 1.0, 0.3], v),
}


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("name", ENDS)
def test_next_to_the_ends(name, live):
    """A derivative along the number is at most some hundreds here; a duty is held to
    1e-6 or more.
    """
    n, fs = 300, 1000.0
    x = np.cumsum(0.02 + 0.1 * np.random.default_rng(0).random(n))

    def at(v):
        scene = stimlib.Scene({"y": ENDS[name](LIVE if live else v)})
        return assert_as_the_interpreter(
            scene, fs, np.array([x, np.full(n, v)]), ["x", "live"], [70]
        )[1][0]

    ends = {0.0: at(0.0 if "springpot" in name else 1e-6), 1.0: at(1.0)}
    for v in SMALL + LARGE:
        end = float(round(v))
        error = np.abs(at(v) - ends[end]).max() / np.abs(ends[1.0]).max()
        limit = 1e3 * abs(v - end) + 1e-10
        saw("ends", f"{name} at {v!r}, as a part of its limit", error / limit)
        assert error <= limit, v


# Hands --------------------------------------------------------------------------------
SCENES = {
    "squeeze": stimlib.scenes.squeeze(fingers=1, limits=True, motor_constant=10.0),
    "viscoelastic": stimlib.scenes.viscoelastic(0.3),
    "bumps, square": stimlib.scenes.bumps("square", 18),
    "bumps, sine": stimlib.scenes.bumps("sine", 18, duty=0.8),
    "grating": stimlib.scenes.grating(),
    "friction": stimlib.scenes.friction(),
    "touch_screen": stimlib.scenes.touch_screen(finger=True),
    "soft_surface": stimlib.scenes.soft_surface(),
}


@pytest.mark.parametrize("hand", HANDS)
@pytest.mark.parametrize("name", SCENES)
def test_whatever_the_hand_does(name, hand):
    motion = dict.fromkeys(SCENES[name].inputs, HANDS[hand])
    report = stimlib.verify(SCENES[name], motion, stimlib.render(SCENES[name], motion, 8000.0, 1.5))
    assert report.passed, str(report)
    saw("hands", checks=len(report.checks))


# Long runs ----------------------------------------------------------------------------
FS, PERIOD, FREQUENCY = 48000.0, 1 / 158.3, 157.9
CLOCKS = stimlib.Scene(
    {
        "noise": b.white_noise(7, 3),
        "carrier": b.carrier(FREQUENCY),
        "time": b.elapsed(),
        "every": b.every(PERIOD),
    }
)


def assert_clocks(y, n):
    """Rows of CLOCKS from sample n on, an even one, against formulas."""
    k = range(n, n + y.shape[1])
    assert np.abs(y[0] - laws.white(0, 7, 3, n, len(k))).max() <= 1e-13
    turns = [float(Fraction(FREQUENCY) * i / Fraction(FS) % 1) for i in k]
    error = np.abs(y[1] - np.sin(2 * np.pi * np.array(turns))).max()
    # half a bit of the phase's 64 is lost at each sample
    assert error <= 2 * np.pi * k[-1] * 2.0**-65 + 1e-14
    assert_same(y[2], np.array([float(Fraction(i) / Fraction(FS)) for i in k]))
    first = int(n / FS / PERIOD) - 1
    events = np.floor(
        np.arange(first, first + 20) * Fraction(PERIOD) * Fraction(FS) + Fraction(1, 2)
    ).astype(int)
    assert np.flatnonzero(y[3]).tolist() == [e - n for e in events if n <= e < k[-1] + 1]
    return error


def counters(proc):
    """Its first state, and by what its counters and phases go on at each sample; as
    words, and where they are floats.
    """
    proc.reset()
    first = proc.state
    proc.process(np.empty((0, 1)))
    one = proc.state
    proc.process(np.empty((0, 1)))
    floats = float_words(proc) & (proc.state.view(float) - one.view(float) == 1.0)
    return first, np.where(float_words(proc), U(0), proc.state - one), floats


def jumped(proc, n):
    """Its first state, moved on by n samples; the last value that a guard keeps is
    not.
    """
    state, more, floats = counters(proc)
    state += U(n) * more
    state[floats] = (state.view(float)[floats] + n).view(U)
    return state


def test_a_jump_is_a_run():
    proc = stimlib.compile(CLOCKS, FS)
    _, more, floats = counters(proc)
    there = jumped(proc, 1_000_000)
    proc.reset()
    for _ in range(100):
        proc.process(np.empty((0, 10_000)))
    moving = (more > 0) | floats
    assert moving.sum() >= 6
    assert_same(proc.state[moving], there[moving])


@pytest.mark.parametrize("n", [10**8, 10**9, 10**12])
def test_after_a_jump(n):
    proc = stimlib.compile(CLOCKS, FS)
    proc.state = jumped(proc, n)
    assert proc.index == n
    saw(
        "jump",
        f"carrier after {n:.0e} samples",
        assert_clocks(proc.process(np.empty((0, 1000))), n),
    )


def test_samples_really_run(n=10**8, block=100_000):
    """A position that rises by 10 um/s, and a constant: sums, means, filters and
    history have had time to drift.
    """
    speed, alpha, size = 1e-5, 0.4, 80
    memory = {
        "springpot": b.springpot(X, 1.0, alpha, "l1"),
        "integral": b.integrate(LIVE),
        "mean": b.moving_average(X, size / FS),
        "lowpass": b.lowpass(LIVE, 1.0),
    }
    proc = stimlib.compile(stimlib.Scene({**CLOCKS.outputs, **memory}), FS)
    for start in range(0, n, block):
        y = proc.process(
            rows(
                proc,
                np.array([speed / FS * np.arange(start, start + block), np.full(block, 0.7)]),
                ["x", "live"],
            )
        )
    assert proc.index == n and proc.fault is None
    saw("run", "carrier", assert_clocks(y[:4, -1000:], n - 1000))
    t = np.arange(n - 1000, n) / FS
    wanted = {
        # the scheme is exact for a straight line
        "springpot": speed * t ** (1 - alpha) / gamma(2 - alpha),
        "integral": 0.7 * (t + 0.5 / FS),  # straight from 0 before the first sample
        "mean": speed * (t - (size - 1) / 2 / FS),
        "lowpass": np.full(1000, 0.7),
    }
    for row, (name, exact) in zip(y[4:], wanted.items(), strict=True):
        error = float(np.abs(row[-1000:] / exact - 1).max())
        saw("run", name, error)
        assert error <= (1e-10 if name == "springpot" else 1e-12), name
