"""Events and what they make, against what they are said to be."""

import numpy as np
import pytest
from laws import lawful, played, refuses
from memory import most_memory
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnitError, blocks as b
from stimlib.blocks.clock import At, Every
from stimlib.blocks.events import is_event
from stimlib.design.filters import resampled

X, E = Input("x"), Input("e")


def impulse(n, *at):
    return np.isin(np.arange(n), at or (0,)).astype(float)


NAN = np.nan
U = [0.0, 0.25, 1.25, 1.0, 0.75, 3.75, 3.75, 3.5, 2.75, 2.75]
SPLIT = [0, 0, 0.25, 0.75, -1.0, 3 * (1 - 1.25 / 3), 1.25, 0, -1 + 2 / 3, -2 / 3]
AT_ANY_SPEED = [0.5, 0.5, 1.0, 1.0, 0.999, 0.94, 7.2, -3.3, -3.3, -3.3, 0.0, 5.0, 1e9]
GATE = np.repeat([0.0, 1.0, 0.0, 1.0], [10, 190, 30, 70])
RESTS = np.repeat([0.0, 0.01, 0.01, NAN, 0.01, -0.0, 0.03, 0.03], 64)
HAND = {  # block, rows of its inputs or a number of samples, samples worked out by hand
    "each line once each way": (
        b.crossing(X, 1.0, hysteresis=0.1),
        [AT_ANY_SPEED],
        [0, 0, 0, 0, 0, 0, 7, -11, 0, 0, 3, 5, 1e9 - 5],
    ),
    "lines without hysteresis": (b.crossing(X, 1.0), [AT_ANY_SPEED[:5]], [0, 0, 1, 0, -1]),
    "no number passes no line": (b.crossing(X, 1.0), [[NAN, 0.5, NAN, 2.5]], [0, 0, 0, 2]),
    "no number splits no line": (
        b.crossing(X, 1.0, split=True),
        [[0.5, NAN, 1.5, 1.5]],
        [0, 0, 0.5, 0.5],
    ),
    "no number makes no edge": (
        b.rising(X, 0.5),
        [[NAN, 1.0, NAN, 2.0, 0.5, 1.0]],
        [0, 0, 0, 0, 0, 1],
    ),
    "split where the line was passed": (b.crossing(X, 1.0, split=True), [U], SPLIT),
    "split with hysteresis": (
        b.crossing(X, 1.0, 0.25, split=True),
        [[0.0, 1.0, 1.25, 1.25, 0.5, 0.5]],
        [0, 0, 0.5, 0.5, -0.5, -0.5],
    ),
    "rest on a line": (
        b.crossing(X, 0.01),
        [RESTS],
        impulse(512, 64) - impulse(512, 320) + 3 * impulse(512, 384),
    ),
    "no edge at the first sample": (b.rising(X), [[1.0, 0.0, 1.0]], [0, 0, 1]),
    "no fall at the first sample": (b.falling(X), [[-1.0, 1.0, -1.0]], [0, 0, 1]),
    "both signs are counted": (b.count(E), [[1, -1, 2]], [1, 0, 2]),
    "both signs hold": (b.sample_and_hold(X, E), [[5, 6, 7], [0, -1, 0]], [0, 6, 6]),
    "less than a tenth is held": (
        b.deadband(X, 0.1),
        [[1, 1.09, 1.11, 1, 0, -1]],
        [1, 1, 1.11, 1.11, 0, -1],
    ),
    "near 0 a floor": (
        b.deadband(X, 0.1, 0.5),
        [[0.5, -0.5, 0.6, 0.2, 0.0]],
        [0, 0, 0.6, 0.6, 0.0],
    ),
    "none before sample 0": (b.count(b.every(0.01)), 2, [1, 1]),
    "no count before sample 0": (b.count(b.rising(b.elapsed(), -0.0015)), 2, [0, 0]),
    "no hold before sample 0": (
        b.sample_and_hold(1.0, b.rising(b.elapsed(), -0.0015)),
        2,
        [0, 0],
    ),
    "times at the nearest sample": (
        b.at([0.0, 0.0104, 0.0106, 0.0107]),
        20,
        impulse(20, 0, 10) + 2 * impulse(20, 11),
    ),
    "times of a clock that turns back": (
        At(X, np.array([0.005])),
        [[0.0, 0.005, 0.005, 0.001]],
        [0, 1, 1, 0],
    ),
    "periods at the nearest sample": (b.every(0.0104), 40, impulse(40, 0, 10, 21, 31)),
    "what comes soon is lost": (
        b.once_within(E, 0.01),
        [np.ones(100)],
        impulse(100, *range(0, 100, 10)),
    ),
    "nothing comes as soon": (b.once_within(E, 1e-9), [np.ones(5)], np.ones(5)),
    "a burst at a time": (b.burst(0.01, 0.005), 20, np.repeat([0.0, 1.0, 0.0], [10, 5, 5])),
    "a gate that closes in a tile": (b.envelope(E, 0, 0, 1.0, 0), [GATE], GATE),
    "a gate that opens again above 1": (
        b.envelope(E, 0, 0, 2.0, 0.001 / np.log(4 / 3)),
        [[1, 1, 0, 1, 1]],
        [1, 2, 1.5, 1.5, 2],
    ),
    "an attack at sample 0": (
        b.envelope(b.elapsed() < b.constant(1.0, "s"), 0.0015 / np.log(2)),
        2,
        [0.5 / (1 - np.exp(-1.5)), 0.75 / (1 - np.exp(-1.5))],
    ),
    "a slew from 0 at sample 0": (b.slew_limit(b.constant(1.0), 250.0), 5, [0.25, 0.5, 0.75, 1, 1]),
    "a limit below 0": (b.pole_swap(X, 100, 10, 2, v_max=E), [[0, 1, -1], [-1] * 3], [0, 0, 0]),
}


CODE = 1e-6 * (5000 + np.r_[-3:1, np.tile([0, -1], 50), 1:4])  # of a position
HEIGHTS = np.where(np.random.default_rng(0).random(4000) < 0.01, 1.3, 0.0)
SHAPE, NOISE = np.random.default_rng(2).standard_normal((2, 200))
LIMITS = np.tile([-20.0, 0.0, 300.0, 500.0, 700.0], 32), np.repeat([1.0, 0.01, -1.0, 0.0], 40)
BENT = [(0.0, 1.0), (0.1, 0.3), (0.1, -1.0), (0.3, 0.7)]
FEW = impulse(160, 0, 50, 90, 130)
LAWFUL = [  # tiles have 64 samples
    (b.rising(X, 0.5), np.repeat([0.0, 0.7, 0.2, 0.2, 0.7], 64)),
    (b.falling(X, 0.5), np.repeat([0.0, 0.7, 0.2, 0.2, 0.7], 64)),
    (b.crossing(X, 1.0), np.repeat([0.5, 1.5, 1.5, 0.5], 64)),
    # the first sample is in its cell, whatever the hysteresis
    (b.crossing(X, 1.0, 0.1), np.repeat([1.03125, 0.9], 64)),
    (b.crossing(X, 0.005, hysteresis=2e-6), CODE),
    (b.crossing(X, 0.005), CODE),
    (
        b.crossing(X, 1.0, split=True),
        np.r_[np.linspace(0.5, 0.75, 128), np.full(63, 0.5), np.full(128, 1.25)],
    ),
    # from the last sample of a tile
    (b.crossing(X, 1.0, split=True), np.r_[np.linspace(0.5, 0.75, 128), 1.25]),
    (b.once_within(X, 0.2), impulse(400, 0, 130, 200, 390)),
    (b.envelope(X, attack=0.01, decay=0.005, sustain=0.4, release=0.02), GATE),
    (b.envelope(X, attack=0.0, sustain=0.5, decay=0.001, release=0.001), np.arange(300) >= 150),
    (b.ring(X, 250, 0.02), HEIGHTS),
    (b.ring(X, 250, 0.02, "cosine"), HEIGHTS),
    (b.ring(X, 100.0, Input("d", "s")), FEW),  # 0 and fs/2, and what lies beyond
    (b.ring(X, Input("f", "Hz"), Input("d", "s")), FEW),
    (b.grain(X, SHAPE, rate=1000), HEIGHTS),
    (b.grain(X, SHAPE, rate=1000), np.zeros(400)),
    (b.burst(X, 0.16, 0.04), 2.0 * impulse(400, 3, 50)),
    (b.deadband(X, 0.1, 0.02), NOISE),
    (b.integrate(X, 5.0), NOISE),
    (b.integrate(X, 1500.0), NOISE),
    *((X * b.timeline(BENT, kind), np.ones(400)) for kind in ("linear", "step", "cosine")),
]


def test_events_and_sums_are_their_laws():
    """Tiles in which nothing happens are skipped; what happens at their ends is not."""
    for block, x in LAWFUL:
        lawful(block, 1000, x=x, f=LIMITS[0], d=LIMITS[1])


@pytest.mark.parametrize("name", HAND)
def test_samples_are_those_worked_out_by_hand(name):
    block, x, wanted = HAND[name]
    for target in ("llvm", "python"):
        y = played(block, *([x] if isinstance(x, int) else x), target=target)
        np.testing.assert_allclose(y, wanted, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("weber", "floor"), [(0.1, 0.0), (0.3, 0.2), (0.0, 0.5), (0.0, 0.0)])
def test_a_deadband_sends_each_sample_that_differs_and_no_other(weber, floor):
    """The next packet is found by a search over the samples after the last one."""
    x = np.cumsum(np.random.default_rng(3).standard_normal(3000)) * 0.1
    sent, at, value = [], -1, 0.0
    while (far := np.abs(x[at + 1 :] - value) > max(weber * abs(value), floor)).any():
        at += 1 + int(far.argmax())
        value = x[at]
        sent.append(at)
    y = played(b.deadband(X, weber, floor), x)
    assert np.flatnonzero(np.diff(y, prepend=0.0)).tolist() == sent and (y[sent] == x[sent]).all()
    assert (np.abs(x - y) <= np.maximum(weber * np.abs(y), floor)).all()
    assert (len(sent) == 3000) == (weber == floor == 0)
    for wrong in ({"weber": -0.1}, {"weber": 0.1, "floor": -1.0}, {"weber": Param("w", -0.1)}):
        refused(BadValue, "deadband: .* must be 0 or above", b.deadband, X, **wrong)


def test_a_period_does_not_drift():
    """A day at 48 kHz: each event is where it should be, none is lost and none comes
    twice.
    """
    p, _ = b.every(1 / 158.3).design(48000)
    k = np.arange(158.3 * 86400 - 30, 158.3 * 86400).astype(int)
    wanted = np.floor(k * (48000 / 158.3) + 0.5)
    n = np.arange(wanted[0], wanted[-1] + 1)
    assert np.array_equal(n[np.array([Every.step(p, (), v / 48000)[0] for v in n]) > 0], wanted)


@pytest.mark.parametrize("kind", ["linear", "step", "cosine"])
def test_a_timeline_meets_its_points(kind):
    """To the last digit, and holds the last one."""
    y = played(b.timeline(BENT, kind, "N"), 3000)
    assert (y[0], y[100]) == (1.0, -1.0) and (y[300:] == 0.7).all()
    refuses(lambda: b.timeline(BENT, unit="N") + 1.0, "N", UnitError)


def test_a_grain_has_a_unit_and_an_end():
    grain = b.grain(E, np.ones(20), rate=1000, unit="N")
    memory = [grain.memory(grain.design(fs)[0]) for fs in (1000, 500)]
    assert str(grain.dim) == "N" and memory == [20, 10]


@pytest.mark.parametrize("ratio", [0.25, 44.1 / 48, 6.0])
def test_a_recording_at_another_rate_keeps_its_waves(ratio):
    n, k = np.arange(3000), np.arange(int(np.ceil(3000 * ratio)))
    middle, f, above = slice(k.size // 4, 3 * k.size // 4), 0.42 * min(1, ratio), 0.58 * ratio
    error = resampled(np.cos(2 * np.pi * f * n), 1, ratio) - np.cos(2 * np.pi * f * k / ratio)
    assert np.abs(error)[middle].max() < 1e-5
    gone = resampled(np.cos(2 * np.pi * above * n), 1, ratio)
    assert above > 0.5 or np.abs(gone)[middle].max() < 1e-5


def test_a_fast_recording_needs_little_memory():
    x = np.ones(20_000)  # at 1 MHz, for 1 kHz: each sample is a sum of 64000
    y, most = most_memory(resampled, x, 1, 1e-3)
    assert abs(y[10] - 1.0) < 0.05 and most < 64e6
    assert resampled(np.ones(2), 1, 1e-300).size == 1


@pytest.mark.parametrize(
    "made", [lambda v: b.ring(v, 100, 1), lambda v: b.grain(v, [1], 8e3), b.count]
)
@pytest.mark.parametrize(
    "lasts",
    [X > 0.5, b.hysteresis(X, 1, 0), 1.0, Param("p", 1.0), b.count(E), b.sample_and_hold(X, E)],
    ids=str,
)
def test_what_lasts_is_no_event(made, lasts):
    refuses(lambda: made(lasts), r"(ring|grain|count): .*lasting signal.*use rising")


EVENTS = b.rising(X), -b.falling(X), -2.0 * b.every(0.1) * X, abs(b.once_within(E, 0.1)) / 3.0


@pytest.mark.parametrize("event", EVENTS, ids=str)
@pytest.mark.parametrize(
    ("made", "remedy"),
    [
        (b.envelope, "burst"),
        (b.integrate, "count"),
        (b.rising, "as it is"),
        (lambda e: b.crossing(e, 1.0), "give a position"),
    ],
)
def test_an_event_does_not_last(made, remedy, event):
    refuses(lambda: made(event), f"is an event.*{remedy}")
    assert is_event(event) and not is_event(2.0 / (1.0 + X)) and not is_event(X / event)


def test_a_deep_product_is_looked_through_once():
    y = X
    for _ in range(60):
        y = y * y
    assert not is_event(y)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: b.at(np.arange(4)), "at: times.*limits.table_knots"),
        (lambda: b.timeline([(k, k) for k in range(4)]), "points.* limits.table_knots"),
        (lambda: b.grain(E, [1] * 3, 100).design(1000), "grain.* limits.state_bytes"),
        (lambda: b.playback([1] * 3, 100).design(1000), "playback.* limits.state_bytes"),
        (
            lambda: b.playback([1] * 3, 100, at=Input("t", "s")).design(1000),
            "its table.* limits.state_bytes",
        ),
    ],
)
def test_tables_are_limited(make, says, monkeypatch):
    monkeypatch.setattr(stimlib.limits, "table_knots", 3)
    monkeypatch.setattr(stimlib.limits, "state_bytes", 100)
    refuses(make, says)


def test_an_integral_is_exact_for_straight_lines_and_after_hours():
    assert played(b.integrate(1.0), 2, fs=4).tolist() == [0.125, 0.375]
    proc = stimlib.compile(Scene({"y": b.integrate(X)}), 1000)
    for _ in range(2):
        y = proc.process(np.full((1, 1_000_000), 0.1))[0]
        proc.state = proc.state  # goes on where it was
    assert abs(y[-1] - (2e6 - 0.5) * 1e-4) < 1e-13 * y[-1]


REFUSED = [
    (lambda: b.crossing(X, 0.0), "crossing: spacing = 0.0 .*above 0"),
    (lambda: b.crossing(X, 1.0, -1.0), "hysteresis = -1.0 must .*or above"),
    (lambda: b.hysteresis(X, 0.0, 1.0), "off = 1 must .*= 0"),
    (lambda: b.rising(Input("v", "m/s"), Input("w", "m")), "cannot compare", UnitError),
    (lambda: b.at([-1.0]), "each 0 or above"),
    (lambda: b.at([]), "times must be one row"),
    (lambda: b.timeline([(1, 0), (0, 1)]), "0 s comes after 1 s"),
    (lambda: b.timeline([1, 2]), "points must be pairs"),
    (lambda: b.timeline([(0, 1)], "cubic"), "kind = 'cubic'; choose one of step"),
    (lambda: b.crossing(X, stimlib.constant(0.01)), r"Const\(0.01\); write the number 0.01"),
    (lambda: b.ring(E, -1, 1), "freq = -1 must be above 0"),
    (lambda: b.ring(E, 100, Input("d")), "decay .* must be in s", UnitError),
    (lambda: b.ring(E, 100, 1, "square"), "onset = 'square'; choose one of sine, cosine"),
    (lambda: b.grain(E, [[1.0]], 8000), "one row of numbers"),
    (lambda: b.burst(E, 0.1, 0.06), "ramp = 0.06 s .*of duration"),
    (lambda: b.envelope(X, attack=-1), "attack = -1.0 must .*or above"),
    (lambda: b.once_within(E, 0), "refractory = 0.0 must be a number above 0"),
    (b.ring(E, 600, 1), "ring: freq = 600 .*not fit"),
    (b.every(9e-4), "less than a sample"),
    (b.burst(E, 1e-4), "less than half a sample"),
]


@pytest.mark.parametrize("given", REFUSED, ids=lambda given: given[1])
def test_what_makes_no_sense_is_refused(given):
    refuses(*given)


@pytest.mark.parametrize("start", [0.0, 0.3])
def test_energy_is_that_of_a_held_force(start):
    """Of a force that no motion makes, too, which began before sample 0."""
    x = Input("x", "m")
    force = b.spring(x, 50.0) + stimlib.constant(2.0, "N") * b.white_noise(3)
    scene = Scene({"f": force, "w": b.energy(force, x)})
    way = start + 0.01 * np.random.default_rng(1).standard_normal((1, 500))
    f, w = stimlib.compile(scene, 1000.0).process(way)
    want = np.cumsum(np.r_[0.0, f[:-1]] * np.r_[0.0, np.diff(way[0])])
    np.testing.assert_allclose(w, want, atol=1e-13)
